"""What a worker does for a study: run a case into a folder as ``fenics-ehd run`` leaves it."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

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
    """Run a case anew and leave its files and outcome in its folder."""
    try:
        shutil.rmtree(task.directory, ignore_errors=True)
        outcome = run_case(CaseTask(task.run.case, task.body, task.directory))
        store_outcome(task.directory, task.run.identity, outcome)
    except OSError as error:
        return failed(error)
    return outcome
