"""What a worker does: reduce a body, run a case. Errors come back as text, in one line.

Errors themselves may not survive the way between processes, and a film that failed
carries its arrays.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any, TypeVar

from mpi4py import MPI

from fenics_ehd.commands.machine_run import leave_scene
from fenics_ehd.commands.recording import record
from fenics_ehd.errors import BodyFileError
from fenics_ehd.output import HistoryWriter
from fenics_ehd.reduction import ReducedBody, load_body, save_body
from fenics_ehd.run_folder import BODY_NAME, RunFolder
from fenics_ehd.sweeps.errors import one_line
from fenics_ehd.sweeps.plan import Case
from fenics_ehd.sweeps.scenes import SCENES, Run

T = TypeVar("T")

#: Entries of a body's provenance: what its reduction took, by the clock and of the processor.
SECONDS, PROCESSOR_SECONDS = "reduction_time_s", "reduction_processor_time_s"

#: How often a form is waited for that another worker is compiling, ten seconds each time.
COMPILATIONS = 6


@dataclass(frozen=True)
class BodyTask:
    """A body to reduce: its name, settings that lead to it, the file for it."""

    name: str
    settings: Any
    path: Path


@dataclass(frozen=True)
class CaseTask:
    """A case to run, the file of its body, the folder for its history; None: without."""

    case: Case
    body: Path | None
    directory: Path | None


@dataclass(frozen=True)
class Outcome:
    """``"complete"`` or what went wrong, and the figures of a run that came to its end."""

    status: str
    figures: Mapping[str, Any]


def failed(error: BaseException) -> Outcome:
    """Outcome of an error."""
    return Outcome(f"failed: {one_line(error)}", {})


def reduce_body(task: BodyTask) -> Outcome:
    """Reduce a body on this process alone and save it, unless its file is there."""
    try:
        _patiently(lambda: _reduce(task))
    except Exception as error:
        return failed(error)
    return Outcome("complete", {})


def _reduce(task: BodyTask) -> None:
    try:
        load_body(task.path)
        return
    except BodyFileError:
        pass
    part = SCENES[task.settings.scene].part
    assert part is not None
    before = process_time()
    reduced = part.reduce(task.settings, MPI.COMM_SELF)
    seconds = {SECONDS: repr(reduced.seconds), PROCESSOR_SECONDS: repr(process_time() - before)}
    provenance = {**reduced.body.provenance, **seconds}
    task.path.parent.mkdir(parents=True, exist_ok=True)
    save_body(replace(reduced.body, provenance=provenance), task.path)


def run_case(task: CaseTask) -> Outcome:
    """Run a case; what ends it early is its status."""
    try:
        body = load_body(task.body) if task.body else None
        summary = _patiently(lambda: _run(task, body))
    except Exception as error:
        return failed(error)
    return Outcome(str(summary["status"]), summary)


def _run(task: CaseTask, body: ReducedBody | None) -> dict[str, object]:
    seconds = float(body.provenance[SECONDS]) if body else 0.0
    run = SCENES[task.case.settings.scene].prepare(task.case.settings, body, seconds)
    if task.directory is not None:
        with RunFolder(task.directory, overwrite=True) as folder:
            _leave_scene(task, folder)
            return _run_with_history(run, folder.path)
    run.simulate(None)
    return run.summarise(run.verdict())


def _leave_scene(task: CaseTask, folder: RunFolder) -> None:
    """Scene and body beside the history, for pictures of the machine and another run of it."""
    leave_scene(task.case.settings, folder.path)
    if task.body is not None:
        # A link, not a copy: many runs share a body.
        (folder.path / BODY_NAME).symlink_to(os.path.relpath(task.body, folder.directory))


def _run_with_history(run: Run, directory: Path) -> dict[str, object]:
    """Leave in the folder what a run on its own leaves there."""
    history = HistoryWriter(directory, run.constants)

    def simulate(_check: Callable[[], None]) -> str:
        run.simulate(history.add)
        return run.verdict()

    return record(directory, history, nullcontext(), simulate, run.summarise)


def _patiently(function: Callable[[], T]) -> T:
    """Call again while another worker compiles a form: dolfinx waits for it ten seconds only."""
    for _ in range(COMPILATIONS - 1):
        try:
            return function()
        except TimeoutError:
            pass
    return function()
