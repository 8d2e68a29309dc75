"""A run of a mechanism into a folder: history, checkpoints, a summary whatever happens."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from time import monotonic, perf_counter, process_time
from typing import Any

import numpy as np
from tqdm import tqdm

from fenics_ehd.base.errors import EhdError, InputError, OutputError, SolverError
from fenics_ehd.base.interrupt import interrupt_between_steps
from fenics_ehd.base.output import keeping_failed_film, write_summary
from fenics_ehd.base.sealed_file import named, require_like
from fenics_ehd.multibody.bdf import IntegratorState
from fenics_ehd.multibody.periodic import Cycles
from fenics_ehd.multibody.recorder import Fixed, cycle_columns, cycle_figures
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.solver_state import MechanismStep, SolverState
from fenics_ehd.multibody.tracking import Tracker
from fenics_ehd.results.checkpoint import CHECKPOINT, save_checkpoint
from fenics_ehd.results.history_file import HistoryWriter, keep_last_cycle
from fenics_ehd.results.load import load_results
from fenics_ehd.results.run_folder import clear_made

#: Seconds between two checkpoints, unless told otherwise.
CHECKPOINT_EVERY = 10.0

#: What else a summary says of a complete run, whose history is in a folder.
Judge = Callable[["RecordedRun", Path], Mapping[str, Any]]


@dataclass
class RecordedRun:
    """A run with all that it carries from step to step.

    Attributes
    ----------
    run, tracker
        The integration and what it has shown.
    end
        Where it stops, if it is not periodic [s].
    cycles
        The search for the periodic solution, or None.
    multiplier
        Whether its largest multiplier is to be found, with more cycles.
    margin
        What the summary has of that.
    first_row
        Of the history of the cycle under way.
    wall_time, processor_time
        So far [s].
    """

    run: Run
    tracker: Tracker
    end: float
    cycles: Cycles | None
    multiplier: bool = False
    margin: dict[str, Any] = field(default_factory=dict)
    first_row: int = 0
    wall_time: float = 0.0
    processor_time: float = 0.0

    def __post_init__(self) -> None:
        self._start = self.run.state

    @property
    def began(self) -> IntegratorState[SolverState]:
        """State at the start of the run, or of the cycle under way."""
        return self._start if self.cycles is None else self.cycles.began

    def stored_state(self) -> dict[str, Any]:
        """As nested dictionaries of arrays and numbers, for `load_state`."""
        own = {name: getattr(self, name) for name in ("first_row", "wall_time", "processor_time")}
        search = {} if self.cycles is None else self.cycles.stored_state()
        return {
            **self.run.stored_state(),
            **self.tracker.stored_state(),
            "recorded": own,
            "cycles": search,
        }

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Go on where another one was.

        Raises
        ------
        InputError
            The state is not of such a run.
        """
        with named(InputError, "the checkpoint's state"):
            own = self.stored_state()
            require_like(state, {name: own[name] for name in ("recorded", "cycles")})
        self.run.load_state(state)
        self.tracker.load_state(state)
        if self.cycles is not None:
            self.cycles.load_state(state["cycles"])
        for name, value in state["recorded"].items():
            setattr(self, name, value)

    def steps(self, history: HistoryWriter) -> Iterator[MechanismStep]:
        """Accepted steps, which the history then has."""
        began, busy = perf_counter() - self.wall_time, process_time() - self.processor_time
        for step in self.run.until(self.end) if self.cycles is None else self.cycles:
            if self.tracker.begins(self.cycles):
                self.first_row = history.rows
            row, fields = self.tracker.add(step)
            history.add(row | cycle_columns(self.cycles, step.time), fields)
            self.wall_time, self.processor_time = perf_counter() - began, process_time() - busy
            yield step

    def find_multiplier(self, between: Callable[[], None]) -> None:
        """Of the periodic solution that was found, if it is wanted; `between` every two steps."""
        if self.multiplier and self.cycles is not None:
            from fenics_ehd.multibody.multiplier import largest_multiplier

            try:
                self.margin = largest_multiplier(self.run, self.cycles.period, between).figures()
            except SolverError as error:  # the solution stays
                self.margin = {"multiplier_failure": str(error)}

    def figures(self, columns: Mapping[str, np.ndarray] | None) -> dict[str, Any]:
        """What ``summary.json`` has of it, with the columns of its history, if they can be read."""
        answer = None if columns is None else self.tracker.answer(columns)
        return self.tracker.figures(answer) | cycle_figures(self.cycles) | self.margin


class Checkpoints:
    """Stores a run every so often, after its history, and where it ends.

    Parameters
    ----------
    history
        Of the run; it is put on the disk before each checkpoint, which counts its rows.
    interval
        Seconds between two checkpoints; the first one is due at once.
    figures
        RecordedRun along with each.
    """

    def __init__(self, history: HistoryWriter, interval: float, figures: Mapping[str, Any]):
        self._history, self._interval, self._figures = history, interval, figures
        self._last = -inf
        self._run: RecordedRun | None = None

    def follow(self, run: RecordedRun) -> None:
        """Account for a step whose row is in the history."""
        self._run, self._state = run, run.run.state
        if monotonic() - self._last >= self._interval:
            self._save(run)

    def __enter__(self) -> Checkpoints:
        return self

    def __exit__(self, *_: object) -> None:
        # In the middle of a step, by a second Ctrl-C say, there is nothing to go on from.
        if self._run is not None and self._run.run.state is self._state:
            self._save(self._run)

    def _save(self, run: RecordedRun) -> None:
        self._history.sync()
        tree = {**self._figures, "rows": self._history.rows, "state": run.stored_state()}
        save_checkpoint(self._history.directory / CHECKPOINT, tree)
        self._last = monotonic()


def record_run(
    recorded: RecordedRun,
    directory: Path,
    about: Mapping[str, Any],
    fingerprints: Mapping[str, str],
    *,
    interval: float,
    bar: tqdm,
    former: Mapping[str, Any] | None = None,
    judge: Judge | None = None,
) -> dict[str, Any]:
    """Integrate to the end, or until the films repeat, and return the summary.

    Parameters
    ----------
    recorded
        At its start.
    directory
        For ``history.csv``, ``history.h5``, ``summary.json`` and the checkpoint.
    about
        What else the summary says; ``reduction_time_s`` stays that of the run that began.
    fingerprints
        Digests of what a run that goes on must have in common with the one that began.
    interval
        Between two checkpoints [s].
    bar
        Shows the progress.
    former
        Checkpoint to go on from.
    judge
        Says what the figures of the complete run are worth; None: nobody asks.

    Raises
    ------
    InputError
        Something changed since the former run began.
    SolverError
        See `Run.until` and `Cycles`.
    """
    rows = None if former is None else int(former["rows"])
    if former is not None:
        require_same_scene(former, fingerprints, directory)
        recorded.load_state(former["state"])
        seconds = float(former["reduction_seconds"])
        about = {**about, "reduction_time_s": seconds, "scene": former["name"]}
    history = history_of(recorded, directory, rows)
    stored = {"reduction_seconds": about["reduction_time_s"], "name": about["scene"]}
    checkpoints = Checkpoints(history, interval, {**stored, "scene": fingerprints})

    worth: dict[str, Any] = {}

    def leave(status: str) -> dict[str, Any]:
        times = {name: getattr(recorded, name) for name in ("wall_time", "processor_time")}
        seconds = {f"{name}_s": value for name, value in times.items()}
        columns = None
        with suppress(InputError):  # a failed run may not have a whole row
            columns = load_results(directory, films=False).columns if history.rows else None
        summary = {"status": status, **about, **recorded.figures(columns), **seconds, **worth}
        if history.rows:
            write_summary(directory, summary)
        return summary

    try:
        with (
            keeping_failed_film(directory),
            bar,
            history,
            interrupt_between_steps() as check,
            checkpoints,
        ):
            for step in recorded.steps(history):
                if history.rows - 1 == rows:
                    clear_made(directory)
                checkpoints.follow(recorded)
                _show(bar, recorded, step)
                check()
            recorded.find_multiplier(check)
            status = recorded.tracker.verdict()
        if judge is not None:
            worth |= judge(recorded, directory)
    except BaseException as error:
        with suppress(OutputError):  # the disk may be full
            leave(_how_it_ended(error, directory))
        raise
    summary = leave(status)
    if recorded.cycles is not None:
        # What is left is no run to go on with.
        (directory / CHECKPOINT).unlink()
        keep_last_cycle(directory, recorded.first_row, recorded.tracker.groups)
    return summary


def _how_it_ended(error: BaseException, directory: Path) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    if not isinstance(error, EhdError):
        return "failed"
    # Files of the run by their names: the folder they are in is about to change.
    return f"failed: {' '.join(str(error).replace(f'{directory}/', '').split())}"


def _show(bar: tqdm, recorded: RecordedRun, step: MechanismStep) -> None:
    pressure = max((film.pressure.max() for film in step.solution.films), default=0.0)
    cycle = f"cycle {recorded.cycles.number}, " if recorded.cycles else ""
    bar.set_postfix_str(
        f"{cycle}step {recorded.tracker.counts['steps']}, p {pressure * 1e-6:.1f} MPa",
        refresh=False,
    )
    into = 1e3 * (step.time - (recorded.cycles.start if recorded.cycles else 0.0))
    bar.update(min(into, bar.total) - bar.n)


def history_of(recorded: RecordedRun, directory: Path, resumed: int | None = None) -> HistoryWriter:
    """Writer of a run's history, which goes on after `resumed` rows."""
    fixed = Fixed.of(recorded.run.equations.system)
    groups = recorded.tracker.groups
    return HistoryWriter(directory, fixed.arrays, fixed.attributes(), groups, resumed=resumed)


def require_same_scene(
    former: Mapping[str, Any], scene: Mapping[str, str], directory: Path
) -> None:
    """Refuse to go on with other settings, tables or bodies.

    Raises
    ------
    InputError
        Naming the file.
    """
    stored = former["scene"]
    changed = [name for name in {**stored, **scene} if stored.get(name) != scene.get(name)]
    if changed:
        raise InputError(
            f"{directory}: {', '.join(sorted(changed))} changed since the run began: put back what "
            "it was, or run the scene anew"
        )
