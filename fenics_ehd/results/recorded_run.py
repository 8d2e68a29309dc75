"""A run in its folder: history, checkpoints, and a summary of every run, failed or not.

Imports inside functions: `largest_multiplier` is slow to import, and most runs do without.

One process at a time locks the folder of a run, and a complete result is deleted only when its
replacement is complete. A run writes to its folder and replaces a former run that is not complete.
In a folder with a complete result the run writes to the subfolder ``replacement``; its files
replace the former ones as soon as it is complete. If the process is killed at any instant, the
folder contains a run to continue, or results, or both.

A checkpoint is one file with the history so far and the state that rows do not contain: points of
the integrator's formula, the search for a cycle, times. The steps of a resumed run are bitwise
those of an uninterrupted run.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import AbstractContextManager, closing, nullcontext, suppress
from dataclasses import dataclass, replace
from io import FileIO
from math import inf
from pathlib import Path
from time import monotonic
from types import TracebackType
from typing import Any

import click
from mpi4py import MPI
from tqdm import tqdm

from fenics_ehd.analysis.error_budget import Estimator
from fenics_ehd.analysis.flexibility_check import Responding
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
from fenics_ehd.base.printed import escaped
from fenics_ehd.base.processes import interrupt_between_steps
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


class _Unobserved:
    """The error output; errors of writing to it, by a closed pipe or a full disk, are ignored."""

    def write(self, text: str) -> None:
        """Write a text, if possible."""
        with suppress(OSError):
            sys.stderr.write(text)

    def flush(self) -> None:
        """Flush the stream, if possible."""
        with suppress(OSError):
            sys.stderr.flush()


def progress_bar(end: float, shown: bool) -> tqdm:
    """Bar of the simulated time up to `end` [s]; redrawn rarely if the output is no terminal."""
    return tqdm(
        total=1e3 * end,
        disable=not shown,
        unit="ms",
        file=_Unobserved(),
        mininterval=0.2 if sys.stderr.isatty() else 10.0,
        bar_format="{percentage:3.0f}% |{bar:24}| {n:.3f}/{total:.3f} ms {postfix} [{elapsed}, "
        "ends in {remaining}]",
    )


#: File of the stresses over the cycle, computed from a run's result.
STRESS = "stress.json"

#: File of a flexible body in the folder of its run.
BODY_FILE = "body-{}.h5"

#: Folder of the series for ParaView.
SERIES = "vtk/"

#: Subfolder of a run that will replace the complete result in its parent folder.
REPLACEMENT = "replacement/"

#: Files of a run without its bodies. The history exists from the first step on.
RUN = (FIELDS_NAME, CSV_NAME, SCENE_NAME, ACCURACY)

#: Files made of a run that has ended. The summary means that all others are complete: it is the
#: first to be removed and the last to be written.
MADE = (
    SUMMARY,
    ERROR_BUDGET,
    FAILED_FILM,
    SERIES,
    *(f"{name}.{ending}" for name in PICTURES for ending in PICTURE_FORMATS),
)


def written_by_run(bodies: Iterable[str]) -> tuple[str, ...]:
    """Names in the folder of a run with these flexible bodies."""
    return (*MADE, *RUN, *(BODY_FILE.format(name) for name in bodies))


def _of_run(name: str) -> bool:
    """True of a file without which a run cannot be resumed."""
    return name in RUN or name.startswith("body-")


def require_folder_of(directory: Path, command: str) -> None:
    """Refuse a folder made by another command, and for a run a subfolder of another run.

    Raises
    ------
    InputError
        The message contains the folder.
    """
    require_made_by(directory, command)
    if command == "run" and is_part(directory):
        raise InputError(f"{directory}: a part of the folder above: choose another folder")


def require_no_result(directory: Path) -> None:
    """Refuse a folder that holds a complete result, or a run that was stopped.

    Raises
    ------
    InputError
        The message contains the folder.
    """
    if complete_result(directory):
        raise InputError(
            f"{directory}: holds a complete result, choose another folder or --overwrite"
        )
    if _stopped(directory):
        raise InputError(
            f"{directory}: holds a run that was stopped: go on with it by --resume {directory}, or "
            "--overwrite it"
        )


#: First words of the status of a run that can be resumed once the disk has space.
NOT_WRITTEN = tuple(f"failed: {name}: " for name in (FIELDS_NAME, CSV_NAME, ERROR_BUDGET))


def _stopped(directory: Path) -> bool:
    """True of a folder whose run was killed or interrupted and has a checkpoint."""
    status = status_of(directory)
    ended_early = status in ("", "interrupted") or status.startswith(NOT_WRITTEN)
    return ended_early and (directory / FIELDS_NAME).is_file()


def first_rank_folder(
    directory: Path, overwrite: bool, bodies: Iterable[str]
) -> RunFolder | AbstractContextManager[None]:
    """`RunFolder` on the first rank, which writes; the other ranks raise the same errors."""
    if MPI.COMM_WORLD.rank == 0:
        return RunFolder(directory, bodies, overwrite=overwrite)
    require_folder_of(directory, "run")
    if not overwrite:
        require_no_result(directory)
    return nullcontext()


class RunFolder:
    """Lock on the folder of one run while the run writes there.

    Parameters
    ----------
    directory
        Created when missing.
    bodies
        Names of the flexible bodies, whose files will be in the folder.
    overwrite
        Whether a complete result in the folder may be replaced by a new one.
    resume
        Whether to resume the run that was stopped in the folder.
    command
        Name of the command that makes the folder.

    Attributes
    ----------
    path
        Folder that the run writes to.

    Raises
    ------
    InputError
        The folder is not writable, or contains a complete result, no run to resume, or files that
        are not of a run.
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
            raise InputError(f"{directory}: no checkpoint to go on from, no such folder")
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
        """Replace the files of a former run by those of a complete run, one by one."""
        names = listed(complete)
        claim(self.directory, (*names, REPLACEMENT))
        claim(complete, names)
        if (complete / FIELDS_NAME).exists():  # the first to move: no file has moved
            clear(self.directory, set(listed(self.directory)) - {REPLACEMENT})
        for name in sorted(names, key=lambda name: (name == SUMMARY) - (name == FIELDS_NAME)):
            if (complete / name).exists():
                (complete / name).replace(self.directory / name)
        clear(self.directory, [REPLACEMENT])

    def _release(self) -> None:
        """Delete the files of a run without a step, except the film that failed."""

        def holds(name: str, *more: str) -> bool:
            there = (FIELDS_NAME, SUMMARY, *more)
            return any((self.directory / name / file).exists() for file in there)

        with suppress(OSError, InputError):
            if not holds(REPLACEMENT, FAILED_FILM):
                clear(self.directory, [REPLACEMENT])
            if not holds("."):
                clear(self.directory, [name for name in listed(self.directory) if _of_run(name)])
            let_go(self.directory, folder=self._made)
        self._lock.close()

    def _explain(self, error: BaseException | None) -> None:
        """Print where the files of a run that ended early are, and how to resume the run."""
        lines = []
        if self.path != self.directory and self.path.exists():
            lines.append(f"{self.directory}: its complete result stays, this run is in {self.path}")
        begun = (self.path / FIELDS_NAME).exists()
        if begun and isinstance(error, KeyboardInterrupt | OutputError):
            lines.append(f"go on with: fenics-ehd run --resume {self.directory}")
        with suppress(OSError):  # the reader of the error output may have ended
            for line in lines:
                click.echo(escaped(line), err=True)


class CsvFile:
    """Rows of ``history.csv``, appended to the rows of a former run.

    Raises
    ------
    InputError
        At the first row: the file does not belong to the former run.
    OutputError
        The file cannot be written; all rows before stay readable.
    """

    def __init__(self, path: Path, rows: int):
        self._path = path
        self._rows = rows
        self._file: FileIO | None = None

    def write(self, row: Mapping[str, float]) -> None:
        """The next row, by names of columns."""
        if self._file is None:
            self._file = self._begun(csv_line([*row]))
        line = csv_line([f"{value:.10g}" for value in row.values()])
        with naming(self._path):
            while line:
                line = line[self._file.write(line) :]

    def _begun(self, header: bytes) -> FileIO:
        """The file with its header and the rows before."""
        lines = [header]
        if self._rows:
            lines = self._path.read_bytes().splitlines(keepends=True)[: 1 + self._rows]
            # A killed writer may have left its last row unfinished.
            if len(lines) <= self._rows or lines[0] != header or lines[-1][-1:] != b"\n":
                raise InputError(
                    f"{self._path}: not the history of the run to go on with: start anew"
                )
        write_whole(self._path, b"".join(lines))
        # Unbuffered: a buffer that did not fit on a full disk would be written once more on
        # closing.
        return open(self._path, "ab", buffering=0)


#: Default number of seconds between two checkpoints.
CHECKPOINT_EVERY = 10.0

#: Time between two checkpoints over the time to write one.
REST = 10.0

#: Error budget of every joint, by its name.
Budgets = Mapping[str, Mapping[str, Any]]

#: Judges a complete run whose history is in a folder: error budgets, and entries of the summary.
Judge = Callable[[Recorder, Path], tuple[Budgets, Mapping[str, Any]]]


#: Entries of a summary that stay those of the first start when a run is resumed.
BEGAN = ("reduction_time_s", "scene")


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A run that can be resumed.

    Attributes
    ----------
    about
        Entries of the summary that stay those of the run that began: `BEGAN`.
    digests
        Digests of the inputs that must not change, by the names of files.
    state
        State of the run after its last step, see `Recorder`.
    history
        History up to that step.
    """

    about: dict[str, Any]
    digests: dict[str, str]
    state: dict[str, Any]
    history: History


#: Layout of a stored `Checkpoint`, its history apart.
CHECKPOINT = Group(
    {
        "about": Group({"reduction_time_s": Value("real"), "scene": Value("text")}),
        "digests": Group(each=Value("text")),
        "state": Group(Recorder.carried),
    }
)


def load_run_state(folder: Path) -> Checkpoint:
    """The checkpoint of a run.

    Raises
    ------
    InputError
        The folder contains no run to resume, or a run of another version, or a file that has
        changed.
    """
    path = folder / FIELDS_NAME
    refused = "no checkpoint to go on from"
    if not path.exists():
        raise InputError(f"{folder}: {refused}, {missing(path, 'it has no')}")
    with opened_history(path, refused) as file:
        require_present_format(file)
        if RESUME not in file:
            raise ValueError("it is of a run that came to its end")
        tree = read_declared(file[RESUME], CHECKPOINT)
    state = tree["state"]
    state["integrator"] = _integration(state["integrator"])
    if "cycles" in state:
        state["cycles"]["began"] = _integration(state["cycles"]["began"])
    return Checkpoint(**tree, history=load_history(folder))


def _integration(tree: Mapping[str, Any]) -> IntegratorState[SolverState]:
    """State of an integration from a stored tree; the first one has no state of the solver."""
    values = INTEGRATOR_STATE.arguments(tree)
    solver = values.get("solver")
    values["solver"] = solver and SolverState(**SolverState.layout.arguments(solver))
    return IntegratorState(**values)


def continue_from(former: Checkpoint, run: Recorder, directory: Path) -> None:
    """Set a run to the state of a checkpoint.

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
    """Store a run and its history.

    Parameters
    ----------
    run, directory
        The run, and its folder.
    fields
        Fields of `Checkpoint` about the first start of the run.
    """
    tree = CHECKPOINT.tree({**fields, "state": run.state})
    run.history().write(directory / FIELDS_NAME, state=tree)


def recorded_steps(
    run: Recorder, directory: Path, fields: Mapping[str, Any], interval: float
) -> Generator[MechanismStep, None, None]:
    """Accepted steps, their rows written to disk, with checkpoints, the last one at the end.

    Parameters
    ----------
    run, directory, fields
        As of `save_run_state`.
    interval
        Time between two checkpoints [s], at least `REST` times the duration of the last one; the
        first checkpoint is written at once.
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
        # A step that is interrupted, by a second Ctrl-C for example, leaves no consistent state to
        # store.
        if run.run.state is recorded:
            save_run_state(run, directory, fields)


def estimate_errors(
    run: Recorder, directory: Path, parts: Mapping[str, Responding] | None = None
) -> tuple[Budgets, dict[str, Any]]:
    """Estimate the errors of a run that is complete, and store them in its folder.

    Parameters
    ----------
    run, directory
        The run and its folder.
    parts
        Static responses of the parts that are at hand, see `Estimator`.

    Returns
    -------
    budgets
        Error budget of every joint, by its name.
    entries
        For ``summary.json``: processor time, Newton iterations, reasons of missing estimates,
        shares of the time without an estimate.
    """
    budget = Estimator(run, parts).budget()
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
    """Entries of the summary on the multiplier of a periodic solution; `between` every two steps.

    The computation simulates further cycles of the run.
    """
    from fenics_ehd.analysis.multiplier import largest_multiplier

    if run.cycles is None:
        return {}
    try:
        return largest_multiplier(run.run, run.cycles.period, between).figures()
    except SolverError as error:  # the solution remains valid
        return {"multiplier_failure": str(error)}


def record_run(
    run: Recorder,
    directory: Path,
    about: Mapping[str, Any],
    fingerprints: Mapping[str, str],
    *,
    interval: float,
    shown: bool,
    former: Checkpoint | None,
    multiplier: bool,
    judge: Judge | None,
) -> dict[str, Any]:
    """Integrate to the end, or until the films repeat, and return the summary.

    Parameters
    ----------
    run
        Run at its start.
    directory
        Folder for ``history.csv``, ``history.h5``, ``summary.json`` and the checkpoint.
    about
        Further entries of the summary; ``reduction_time_s`` stays that of the first start.
    fingerprints
        Digests of the inputs that a resumed run must have in common with the first start.
    interval
        Time between two checkpoints [s].
    shown
        Whether a bar shows the progress; it is closed before an error is printed.
    former
        Checkpoint to resume from.
    multiplier
        Whether to compute the largest multiplier of a periodic solution, too.
    judge
        Estimates the errors of the complete run; None: errors are not estimated.

    Raises
    ------
    InputError
        An input has changed since the former run began.
    SolverError
        See `Run.until` and `PeriodicSolver`.
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
        seconds = {"wall_time_s": run.wall_time, "processor_time_s": run.processor_time}
        figures = RunSummary(run, budgets).entries()
        summary = {"status": status, **about, **figures, **seconds, **later_entries}
        if run.rows:
            write_summary(directory, summary)
        return summary

    try:
        with (
            keeping_failed_film(directory),
            progress_bar(run.end, shown) as bar,
            interrupt_between_steps() as check,
            closing(steps),
        ):
            for number, step in enumerate(steps):
                if former is not None and number == 0:
                    # Files made of the run are stale as soon as it is resumed.
                    clear(directory, [name for name in listed(directory) if not _of_run(name)])
                _show(bar, run, step)
                check()
            if multiplier:
                later_entries |= multiplier_figures(run, check)
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
        # The remaining files are no run that can be resumed.
        replace(run.final_history(), entries=summary).save(directory)
    return summary


def _how_it_ended(error: BaseException, directory: Path) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    if not isinstance(error, EhdError):
        return "failed"
    # Names of the run's files without their folder, which is about to change.
    return f"failed: {' '.join(str(error).replace(f'{directory}/', '').split())}"


def _show(bar: tqdm, run: Recorder, step: MechanismStep) -> None:
    pressure = max((film.pressure.max() for film in step.solution.films), default=0.0)
    cycle = f"cycle {run.cycles.number}, " if run.cycles else ""
    start = run.cycles.start if run.cycles else 0.0
    bar.set_postfix_str(
        f"{cycle}step {run.counts['steps']}, p {pressure * 1e-6:.1f} MPa", refresh=False
    )
    bar.update(min(1e3 * (step.time - start), bar.total) - bar.n)


def require_same_scene(former: Checkpoint, scene: Mapping[str, str], directory: Path) -> None:
    """Refuse to resume a run with other settings, tables or bodies.

    Raises
    ------
    InputError
        The message contains the file.
    """
    changed = {name for name, _ in former.digests.items() ^ scene.items()}
    if changed:
        raise InputError(
            f"{directory}: {', '.join(sorted(changed))} changed since the run began: put back what "
            "it was, or run the scene anew"
        )
