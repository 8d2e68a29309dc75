"""A mechanism from its start to an end time or a cycle that repeats itself, and its history."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from time import perf_counter, process_time
from typing import Any

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.sealed_file import Stateful
from fenics_ehd.multibody.bdf import IntegratorState
from fenics_ehd.multibody.history import History
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.newton import MechanismStep, SolverState
from fenics_ehd.multibody.periodic import Cycles
from fenics_ehd.multibody.run import Run, Steps
from fenics_ehd.multibody.tracking import Tracker


class Simulation(Stateful):
    """A run on its way, with its history so far; ended, for those who look at it again.

    Its state is all that a run goes on from, beside its history.

    Parameters
    ----------
    run
        At its start.
    end
        Time at which it stops, if it is not periodic [s].
    cycles
        Search for its periodic solution, or None.

    Attributes
    ----------
    tracker
        Keeps its history.
    wall_time, processor_time
        Of its steps so far [s].
    """

    carried = ("integrator", "tracker", "cycles", "wall_time", "processor_time")

    def __init__(self, run: Run, end: float, cycles: Cycles | None = None):
        self.run, self.end, self.cycles = run, end, cycles
        self.tracker, self._start = Tracker(run.equations, run.norm, run.state.time), run.state
        self.wall_time = self.processor_time = 0.0

    @property
    def integrator(self) -> IntegratorState[SolverState]:
        """State of the integration."""
        return self.run.state

    @integrator.setter
    def integrator(self, state: IntegratorState[SolverState]) -> None:
        self.run.state = state

    @property
    def began(self) -> IntegratorState[SolverState]:
        """State at the start of the run, or of the cycle under way."""
        return self._start if self.cycles is None else self.cycles.began

    def steps(self) -> Iterator[tuple[MechanismStep, dict[str, float]]]:
        """Accepted steps, which the history then has, and their rows of ``history.csv``."""
        began, busy = perf_counter() - self.wall_time, process_time() - self.processor_time
        for step in self.run.until(self.end) if self.cycles is None else self.cycles:
            row = self.tracker.add(step, self.cycles)
            self.wall_time, self.processor_time = perf_counter() - began, process_time() - busy
            yield step, row

    def figures(self) -> dict[str, Any]:
        """Entries of ``summary.json``."""
        search = {} if self.cycles is None else self.cycles.figures()
        return self.tracker.figures() | search

    def history(self) -> History:
        """History of a run that has ended, of a search its last cycle, both its ends."""
        found, first = self.tracker.history(), self.tracker.first
        if self.cycles is not None:
            found = found.each(lambda values: values[first:]).with_start()
        told = {"status": self.tracker.verdict(), **self.figures()}
        return replace(found, told=told, solved=self)


def simulate(
    mechanism: Mechanism,
    end: float | None = None,
    *,
    period: float | None = None,
    periodicity: float = 1e-4,
    cycles: int = 20,
    progress: Callable[[MechanismStep], None] = lambda step: None,
    **steps: Any,
) -> History:
    """A mechanism from its start to an end time, or the cycle that repeats itself.

    Parameters
    ----------
    mechanism
        What moves; it is assembled from its rough pose.
    end
        End time of an initial value problem [s]; or
    period, periodicity, cycles
        Of a mechanism whose forcing repeats, see `Cycles`.
    progress
        Called after every accepted step: ``lambda step: print(step.time)``.
    steps
        Fields of `Steps`: ``tolerance=1e-6``.

    Returns
    -------
    History
        Of all steps; of a periodic solution of the last cycle, its time from 0 to the period.

    Raises
    ------
    SettingsError
        The mechanism cannot be assembled, neither or both of end and period are given, or the end
        is not after the start; a joint has `heat` and no period; there is no film to repeat.
    StepSizeError
        No step is short enough.
    FilmTooThinError
        A film became thinner than its joint's `smallest_film`.
    PeriodicityError
        The films still change after so many cycles.
    """
    if (end is None) == (period is None):
        raise SettingsError("simulate takes either end, a time, or period, of what repeats itself")
    span = end if period is None else period
    assert span is not None
    run = Run(mechanism, Steps(**steps), span)
    if period is None and run.equations.system.heated:
        raise SettingsError(
            "a joint's heat is balanced over a cycle, and an initial value problem has none: give "
            "a period, or leave `heat` out, the oil at the lubricant's temperature"
        )
    search = None if period is None else Cycles(run, period, periodicity, cycles)
    found = Simulation(run, span, search)
    for step, _ in found.steps():
        progress(step)
    return found.history()
