"""What a worker does for a study: run a case into a folder as ``fenics-ehd run`` leaves it."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from fenics_ehd.commands.machine_run import BODY_NAME, SCENE_NAME
from fenics_ehd.output import write_whole
from fenics_ehd.settings import to_toml
from fenics_ehd.study.folder import store_outcome
from fenics_ehd.study.plan import StudyRun
from fenics_ehd.sweeps.work import CaseTask, Outcome, failed, run_case


@dataclass(frozen=True)
class RunTask:
    """A run, the file of its body, the folder for its results."""

    run: StudyRun
    body: Path
    directory: Path


def run_study_case(task: RunTask) -> Outcome:
    """Run a case and leave scene, body, history, summary and outcome in its folder."""
    try:
        shutil.rmtree(task.directory, ignore_errors=True)
        task.directory.mkdir(parents=True)
        write_whole(task.directory / SCENE_NAME, to_toml(task.run.case.settings))
        # A link, not a copy: many runs share a body.
        (task.directory / BODY_NAME).symlink_to(os.path.relpath(task.body, task.directory))
        outcome = run_case(CaseTask(task.run.case, task.body, task.directory))
        store_outcome(task.directory, task.run.identity, outcome)
    except OSError as error:
        return failed(error)
    return outcome
