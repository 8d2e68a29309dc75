"""A run in its folder: history, checkpoints, and a summary of every run, failed or not.

Imports inside functions: `largest_multiplier` is slow to import, and most runs do not need it.

The folder of a run is locked by one process at a time. A run replaces a former, incomplete run in
its folder. If the folder has a complete result, the run writes to the subfolder ``replacement``;
these files replace the former files as soon as the run is complete. Therefore, if the process is
killed at any instant, the folder has a complete result, a run to resume, or both.

A checkpoint is one file with the history so far and the state that rows of the history do not
contain: points of the integrator's formula, the search for a cycle, computing times. The steps of a
resumed run are bitwise those of an uninterrupted run.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import AbstractContextManager, closing, nullcontext, suppress
from dataclasses import dataclass, replace
from io import FileIO
from math import inf
from pathlib import Path
from time import monotonic
from types import TracebackType
from typing import Any

from mpi4py import MPI

from fenics_ehd.analysis.error_budget import Estimator
from fenics_ehd.analysis.flexibility_check import PartInMemory
from fenics_ehd.base.columns import csv_line
from fenics_ehd.base.errors import EhdError, InputError, OutputError, SolverError
from fenics_ehd.base.files import (
    ACCURACY,
    ERROR_BUDGET,
    FAILED_FILM,
    PICTURE_FORMATS,
    PICTURES,
    SCENE_NAME,
    SUMMARY,
    claim,
    clear,
    complete_result,
    is_part,
    keeping_failed_film,
    let_go,
    listed,
    locked,
    naming,
    require_made_by,
    require_writable,
    status_of,
    to_json,
    write_summary,
    write_whole,
)
from fenics_ehd.base.layout import Group, Value, read_declared
from fenics_ehd.base.processes import interrupt_between_steps
from fenics_ehd.base.progress import SILENT, Progress, say
from fenics_ehd.base.sealed_file import named
from fenics_ehd.multibody.bdf import IntegratorState
from fenics_ehd.multibody.history import (
    CSV_NAME,
    FIELDS_NAME,
    RESUME,
    History,
    load_history,
    missing,
    opened_history,
    require_present_format,
)
from fenics_ehd.multibody.newton import INTEGRATOR_STATE, MechanismStep, SolverState
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.summary import RunSummary
from fenics_ehd.multibody.verdict import verdict

#: File with the stresses over the cycle, which are computed from the result of a run.
STRESS = "stress.json"

#: Page with the report of a run, which the command ``report`` writes.
REPORT = "report.html"

#: Name of the file of a flexible body in the folder of a run.
BODY_FILE = "body-{}.h5"

#: Folder with the ParaView series of a run.
SERIES = "vtk/"

#: Subfolder of a run that will replace the complete result in its parent folder.
REPLACEMENT = "replacement/"

#: Files without which a run cannot be resumed, except its bodies; they exist from the first step.
RUN = (FIELDS_NAME, CSV_NAME, SCENE_NAME, ACCURACY)

#: Files written after the end of a run. The summary is the first to be removed and the last to be
#: written, so that all other files are complete if it exists.
MADE = (
    SUMMARY,
    ERROR_BUDGET,
    FAILED_FILM,
    REPORT,
    SERIES,
    *(f"{name}.{ending}" for name in PICTURES for ending in PICTURE_FORMATS),
)


def written_by_run(bodies: Iterable[str]) -> tuple[str, ...]:
    """Names of all files and folders that a run with flexible `bodies` writes."""
    return (*MADE, *RUN, *(BODY_FILE.format(name) for name in bodies))


def _needed_to_resume(name: str) -> bool:
    """True if the file of this name is needed to resume a run."""
    return name in RUN or name.startswith("body-")


def require_folder_of(directory: Path, command: str) -> None:
    """Refuse a folder that another command made; for a run, also a subfolder of another run.

    Raises
    ------
    InputError
        The folder is refused; the message has its path.
    """
    require_made_by(directory, command)
    if command == "run" and is_part(directory):
        raise InputError(
            f"{directory} belongs to the run in its parent folder: choose another folder"
        )


def require_no_result(directory: Path) -> None:
    """Refuse a folder that has a complete result, or a run that was stopped.

    Raises
    ------
    InputError
        The folder is refused; the message has its path.
    """
    if complete_result(directory):
        raise InputError(
            f"{directory} has a complete result: choose another folder or use --overwrite "
            "(overwrite=True in Python)"
        )
    if _stopped(directory):
        raise InputError(
            f"{directory} has a run that was stopped: continue it by --resume {directory}, or "
            "replace it by --overwrite (resume=True or overwrite=True in Python)"
        )


#: Beginnings of the status of a run that stopped because the disk was full.
NOT_WRITTEN = tuple(f"failed: {name}: " for name in (FIELDS_NAME, CSV_NAME, ERROR_BUDGET))


def _stopped(directory: Path) -> bool:
    """True if the folder has a checkpoint of a run that ended before it was complete."""
    status = status_of(directory)
    ended_early = status in ("", "interrupted") or status.startswith(NOT_WRITTEN)
    return ended_early and (directory / FIELDS_NAME).is_file()


def first_rank_folder(
    directory: Path, overwrite: bool, bodies: Iterable[str]
) -> RunFolder | AbstractContextManager[None]:
    """`RunFolder` on the first rank, None on the others, which raise the same errors."""
    if MPI.COMM_WORLD.rank == 0:
        return RunFolder(directory, bodies, overwrite=overwrite)
    require_folder_of(directory, "run")
    if not overwrite:
        require_no_result(directory)
    return nullcontext()


class RunFolder:
    """Folder of a run, locked by this process while the run writes to it.

    Parameters
    ----------
    directory
        Path of the folder; it is created if it does not exist.
    bodies
        Names of the flexible bodies whose files will be in the folder.
    overwrite
        Whether a complete result in the folder may be replaced.
    resume
        Whether the run that was stopped in the folder is resumed.
    command
        Name of the command to which the folder belongs.

    Attributes
    ----------
    path
        Folder to which the run writes: `directory` or its subfolder for a replacement.

    Raises
    ------
    InputError
        The folder is not writable, has a complete result or foreign files, or has no run to
        resume.
    InUseError
        Another process has locked the folder.
    """

    def __init__(
        self,
        directory: Path,
        bodies: Iterable[str] = (),
        *,
        overwrite: bool = False,
        resume: bool = False,
        command: str = "run",
    ):
        self.directory = self.path = directory
        if resume and not self.directory.is_dir():
            raise InputError(f"{directory}: no checkpoint to resume from, no such folder")
        require_writable(self.directory)
        self._made = not self.directory.exists()
        require_folder_of(self.directory, command)
        self.directory.mkdir(parents=True, exist_ok=True)
        names = written_by_run(bodies)
        replacement = self.directory / REPLACEMENT
        self._lock = locked(self.directory)
        try:
            if complete_result(replacement):
                self._replace(replacement)
            if not (overwrite or resume):
                require_no_result(self.directory)
            claim(self.directory, (*names, REPLACEMENT), command)
            if (replacement / FIELDS_NAME).exists() if resume else complete_result(self.directory):
                self.path = replacement
                claim(self.path, names, command)
        except BaseException:
            self._release()
            raise

    def __enter__(self) -> RunFolder:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if self.path != self.directory and complete_result(self.path):
                self._replace(self.path)
                self.path = self.directory
        except OSError as failure:
            where = failure.filename2 or failure.filename or self.directory
            raise OutputError(f"{where}: {failure.strerror}; results in {self.path}") from error
        finally:
            self._release()
        self._explain(error)

    def _replace(self, complete: Path) -> None:
        """Replace the files of a former run one by one by the files of a complete run."""
        names = listed(complete)
        claim(self.directory, (*names, REPLACEMENT))
        claim(complete, names)
        if (complete / FIELDS_NAME).exists():  # it is moved first, so no file has been moved
            clear(self.directory, set(listed(self.directory)) - {REPLACEMENT})
        for name in sorted(names, key=lambda name: (name == SUMMARY) - (name == FIELDS_NAME)):
            if (complete / name).exists():
                (complete / name).replace(self.directory / name)
        clear(self.directory, [REPLACEMENT])

    def _release(self) -> None:
        """Delete files of a run that has no step, except a saved failed film; unlock the folder."""

        def holds(name: str, *more: str) -> bool:
            there = (FIELDS_NAME, SUMMARY, *more)
            return any((self.directory / name / file).exists() for file in there)

        with suppress(OSError, InputError):
            if not holds(REPLACEMENT, FAILED_FILM):
                clear(self.directory, [REPLACEMENT])
            if not holds("."):
                clear(
                    self.directory,
                    [name for name in listed(self.directory) if _needed_to_resume(name)],
                )
            let_go(self.directory, folder=self._made)
        self._lock.close()

    def _explain(self, error: BaseException | None) -> None:
        """Print the folder of a run that ended early, and the command to resume it."""
        lines = []
        if self.path != self.directory and self.path.exists():
            lines.append(f"{self.directory} keeps its complete result, this run is in {self.path}")
        begun = (self.path / FIELDS_NAME).exists()
        if begun and isinstance(error, KeyboardInterrupt | OutputError):
            lines.append(
                f"resume it with: fenics-ehd run --resume {self.directory} "
                "(ehd.run(scene, folder, resume=True) in Python)"
            )
        for line in lines:
            say(line)


class CsvFile:
    """File ``history.csv``, to which rows are appended; a resumed run keeps the first `rows` rows.

    Raises
    ------
    InputError
        At the first row, if the file does not belong to the resumed run.
    OutputError
        The file cannot be written; all rows that were written before remain readable.
    """

    def __init__(self, path: Path, rows: int):
        self._path = path
        self._rows = rows
        self._file: FileIO | None = None

    def write(self, row: Mapping[str, float]) -> None:
        """Append a row, given as values by column."""
        if self._file is None:
            self._file = self._opened(csv_line([*row]))
        line = csv_line([f"{value:.10g}" for value in row.values()])
        with naming(self._path):
            while line:
                line = line[self._file.write(line) :]

    def _opened(self, header: bytes) -> FileIO:
        """Write the header and the former rows again, and open the file for appending."""
        lines = [header]
        if self._rows:
            lines = self._path.read_bytes().splitlines(keepends=True)[: 1 + self._rows]
            # The last row may be incomplete if the writer was killed.
            if len(lines) <= self._rows or lines[0] != header or lines[-1][-1:] != b"\n":
                raise InputError(
                    f"{self._path} does not belong to the run to resume: run the scene again"
                )
        write_whole(self._path, b"".join(lines))
        # Unbuffered, since a buffer that did not fit on a full disk would be written again on
        # closing.
        return open(self._path, "ab", buffering=0)


#: Default time between two checkpoints [s].
CHECKPOINT_EVERY = 10.0

#: Least time between two checkpoints, over the time that it takes to write one.
REST = 10.0

#: Type for error budgets by joint.
Budgets = Mapping[str, Mapping[str, Any]]

#: Type of a function that estimates the errors of a complete run, stored in a folder: it returns
#: error budgets, and entries of the summary.
Judge = Callable[[Recorder, Path], tuple[Budgets, Mapping[str, Any]]]


#: Entries of a summary that a resumed run keeps from its first start.
BEGAN = ("reduction_time_s", "scene")


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """State and history from which a run is resumed.

    Attributes
    ----------
    about
        Entries of the summary that are kept from the first start of the run, see `BEGAN`.
    digests
        Checksums of the input files by file name; a resumed run must have the same inputs.
    state
        State of the run after its last step, see `Recorder`.
    history
        History up to this step.
    """

    about: dict[str, Any]
    digests: dict[str, str]
    state: dict[str, Any]
    history: History


#: Layout of a stored `Checkpoint` without its history.
CHECKPOINT = Group(
    {
        "about": Group({"reduction_time_s": Value("real"), "scene": Value("text")}),
        "digests": Group(each=Value("text")),
        "state": Group(Recorder.carried),
    }
)


def load_run_state(folder: Path) -> Checkpoint:
    """Read the checkpoint of a run from its folder.

    Raises
    ------
    InputError
        The folder has no run to resume, or a run of another version, or a damaged file.
    """
    path = folder / FIELDS_NAME
    refused = "no checkpoint to resume from"
    if not path.exists():
        raise InputError(f"{folder}: {refused}, {missing(path, 'it has no')}")
    with opened_history(path, refused) as file:
        require_present_format(file)
        if RESUME not in file:
            raise ValueError("the run is complete, and its history has no checkpoint any more")
        tree = read_declared(file[RESUME], CHECKPOINT)
    state = tree["state"]
    state["integrator"] = _integration(state["integrator"])
    if "cycles" in state:
        state["cycles"]["began"] = _integration(state["cycles"]["began"])
    return Checkpoint(**tree, history=load_history(folder))


def _integration(tree: Mapping[str, Any]) -> IntegratorState[SolverState]:
    """Make an integrator state from a stored tree; at the start of a run, `solver` is None."""
    values = INTEGRATOR_STATE.arguments(tree)
    solver = values.get("solver")
    values["solver"] = solver and SolverState(**SolverState.layout.arguments(solver))
    return IntegratorState(**values)


def continue_from(former: Checkpoint, run: Recorder, directory: Path) -> None:
    """Set a run to the state and history of a checkpoint.

    Raises
    ------
    InputError
        The checkpoint belongs to another mechanism.
    """
    with named(InputError, f"{directory / FIELDS_NAME}: not of a run of its {SCENE_NAME}"):
        run.require_fitting(former.state)
        run.state = former.state
        run.take(former.history)


def save_run_state(run: Recorder, directory: Path, fields: Mapping[str, Any]) -> None:
    """Store the state and the history of a run in its folder.

    Parameters
    ----------
    run, directory
        The run, and the path of its folder.
    fields
        Entries ``about`` and ``digests`` of the `Checkpoint`.
    """
    tree = CHECKPOINT.tree({**fields, "state": run.state})
    run.history().write(directory / FIELDS_NAME, state=tree)


def recorded_steps(
    run: Recorder, directory: Path, fields: Mapping[str, Any], interval: float
) -> Generator[MechanismStep, None, None]:
    """Integrate a run and yield its steps; write their rows and checkpoints.

    A last checkpoint is written at the end of the run.

    Parameters
    ----------
    run, directory, fields
        As for `save_run_state`.
    interval
        Time between two checkpoints [s]. If it is below `REST` times the time that the last
        checkpoint took to write, that time is used instead. The first checkpoint is written after
        the first step.
    """
    table = CsvFile(directory / CSV_NAME, run.counts["steps"])
    due = -inf
    recorded = None
    try:
        for step, row in run.steps():
            table.write(row)
            recorded = run.run.state
            began = monotonic()
            if began >= due:
                save_run_state(run, directory, fields)
                due = monotonic() + max(interval, REST * (monotonic() - began))
            yield step
    finally:
        # If a step is interrupted, by a second Ctrl-C for example, there is no consistent state to
        # store.
        if run.run.state is recorded:
            save_run_state(run, directory, fields)


def estimate_errors(
    run: Recorder,
    directory: Path,
    parts: Mapping[str, PartInMemory] | None = None,
    progress: Progress = SILENT,
) -> tuple[Budgets, dict[str, Any]]:
    """Estimate the errors of a complete run, and store them over time in its folder.

    Parameters
    ----------
    run, directory
        The run and its folder.
    parts
        Parts in memory, by the name of their body, see `Estimator`.
    progress
        Progress in which the estimates open their stages.

    Returns
    -------
    budgets
        Error budget of every joint, by its name.
    entries
        Entries of ``summary.json`` about the estimates: processor time [s], Newton iterations,
        reasons for missing estimates, time intervals without an estimate, and errors of the
        flexibility.
    """
    budget = Estimator(run, parts, progress).budget()
    over_time = budget.over_time(run.began.time)
    write_whole(directory / ERROR_BUDGET, to_json(over_time) + "\n")
    return budget.joints, {
        "error_budget_notes": budget.notes,
        "error_budget_left_out": budget.left_out,
        "error_budget_iterations": budget.iterations,
        "error_budget_processor_time_s": budget.seconds,
        "flexibility_errors": budget.flexibility_errors,
    }


def multiplier_figures(run: Recorder, between: Callable[[], None]) -> dict[str, Any]:
    """Summary entries on the largest multiplier of a periodic solution; empty for other runs.

    Further cycles of the run are simulated; `between` is called between two steps.
    """
    from fenics_ehd.analysis.multiplier import largest_multiplier

    if run.cycles is None:
        return {}
    try:
        return largest_multiplier(run.run, run.cycles.period, between).figures()
    except SolverError as error:  # the solution remains valid
        return {"multiplier_failure": str(error)}


def _nothing() -> None:
    """Do nothing between two steps."""


def _entries(
    run: Recorder, status: str, about: Mapping[str, Any], budgets: Budgets
) -> dict[str, Any]:
    """Entries of the summary of a run that has ended."""
    seconds = {"wall_time_s": run.wall_time, "processor_time_s": run.processor_time}
    return {"status": status, **about, **RunSummary(run, budgets).entries(), **seconds}


def summarised_run(
    run: Recorder,
    about: Mapping[str, Any],
    between: Callable[[], None] = _nothing,
    progress: Progress = SILENT,
) -> dict[str, Any]:
    """Integrate a run as `record_run` does, but without files; return its summary.

    The parameters are those of `record_run`.

    Raises
    ------
    SolverError
        Raised by `Run.until` and `PeriodicSolver`.
    """
    with run.shown(progress, about["scene"]) as show, interrupt_between_steps() as check:
        for step, _ in run.steps():
            show(step)
            check()
            between()
    run.add_reported()
    return _entries(run, verdict(RunSummary(run)), about, {})


def record_run(
    run: Recorder,
    directory: Path,
    about: Mapping[str, Any],
    fingerprints: Mapping[str, str],
    *,
    interval: float,
    progress: Progress,
    former: Checkpoint | None,
    multiplier: bool,
    judge: Judge | None,
    between: Callable[[], None] = _nothing,
) -> dict[str, Any]:
    """Integrate a run to its end, or until it is periodic; write its files, return its summary.

    Parameters
    ----------
    run
        Run at its start.
    directory
        Folder for ``history.csv``, ``history.h5``, ``summary.json`` and the checkpoint.
    about
        Further entries of the summary. A resumed run keeps the entries named in `BEGAN` as they
        were at its first start.
    fingerprints
        Checksums of the inputs by file name; they must be the same as at the first start.
    interval
        Time between two checkpoints [s].
    progress
        Progress in which the run opens its stages.
    former
        Checkpoint from which the run is resumed; None for a new run.
    multiplier
        Whether the largest Floquet multiplier of a periodic solution is computed.
    judge
        Function that estimates the errors of the complete run; None for no estimate.
    between
        Function that is called between two steps; it may raise an error, which ends the run.

    Raises
    ------
    InputError
        An input has changed since the first start of the run.
    SolverError
        Raised by `Run.until` and `PeriodicSolver`.
    """
    later_entries = dict[str, Any]()
    budgets: Budgets = {}
    if former is not None:
        require_same_scene(former, fingerprints, directory)
        continue_from(former, run, directory)
        about = {**about, **former.about}
    began = {"about": {name: about[name] for name in BEGAN}, "digests": fingerprints}
    steps = recorded_steps(run, directory, began, interval)

    def leave(status: str) -> dict[str, Any]:
        summary = _entries(run, status, about, budgets) | later_entries
        if run.rows:
            write_summary(directory, summary)
        return summary

    try:
        with (
            keeping_failed_film(directory),
            run.shown(progress, about["scene"]) as show,
            interrupt_between_steps() as check,
            closing(steps),
        ):
            for number, step in enumerate(steps):
                if former is not None and number == 0:
                    # Files made from the former steps are obsolete as soon as the run is resumed.
                    clear(
                        directory,
                        [name for name in listed(directory) if not _needed_to_resume(name)],
                    )
                show(step)
                check()
                between()
            if multiplier:
                with progress.stage("largest multiplier"):
                    later_entries |= multiplier_figures(run, check)
            run.add_reported()
            status = verdict(RunSummary(run))
        if judge is not None:
            budgets, judged = judge(run, directory)
            later_entries |= judged
    except BaseException as error:
        with suppress(OutputError):  # the disk may be full
            leave(_how_it_ended(error, directory))
        raise
    summary = leave(status)
    if run.cycles is not None:
        # Without its checkpoint, the complete periodic solution cannot be resumed.
        replace(run.final_history(), entries=summary).save(directory)
    else:
        # Rows that were written during the run lack the columns of `Recorder.add_reported`.
        save_run_state(run, directory, began)
        run.history().write_columns(directory / CSV_NAME)
    return summary


def _how_it_ended(error: BaseException, directory: Path) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    if not isinstance(error, EhdError):
        return "failed"
    # The files of the run are named without their folder, which may change.
    return f"failed: {' '.join(str(error).replace(f'{directory}/', '').split())}"


def require_same_scene(former: Checkpoint, scene: Mapping[str, str], directory: Path) -> None:
    """Refuse to resume a run with other settings, tables or bodies.

    Raises
    ------
    InputError
        An input has changed; the message names the files.
    """
    changed = {name for name, _ in former.digests.items() ^ scene.items()}
    if changed:
        raise InputError(
            f"{directory}: {', '.join(sorted(changed))} changed since the run started: restore the "
            "former files, or run the scene again"
        )
