"""The steps of a record once more, by a mechanism that differs a little from the one recorded.

Runs that choose their steps differ by the noise of their choice, 1e-4 of an extreme at a tolerance
of 1e-4, which is a hundredth of a derivative along 1 %. In the same steps, solved to round-off,
figures are as smooth as the equations.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from fenics_ehd.multibody.bdf import IntegratorState, follow
from fenics_ehd.multibody.cycle_record import CycleRecord
from fenics_ehd.multibody.periodic import Cycles
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.solver_state import MechanismStep

#: Of Newton's last update, and of a cycle that repeats: what they leave of a difference along 1 %.
NEWTON, PERIODICITY = 1e-9, 1e-6

#: Cycles at most.
MOST = 40


class HeldRun(Run):
    """A run that takes the steps of a record, from where it is.

    Parameters
    ----------
    run
        At its start; if the record is one of a cycle, at the end of whole cycles.
    record
        Of another run that has ended.
    span
        Time to simulate, or period, over that of the record.
    """

    def __init__(self, run: Run, record: CycleRecord, span: float):
        vars(self).update(vars(run))
        self._ends = record.times * span
        self._corners = [step.corner for step in record.steps]

    def until(self, end: float) -> Iterator[MechanismStep]:
        """All steps of the record; `end` is where they lead to.

        Raises
        ------
        StepSizeError
            A step has no solution.
        """
        began, solve = self.state.time, self.solve
        for time, corner in zip(self._ends, self._corners, strict=True):
            at = end if time == self._ends[-1] else began + time
            step, self.state = follow(
                self.norm, self.state, at, corner, self.control, solve, NEWTON
            )
            yield step

    def take(self, state: IntegratorState, span: float) -> None:
        """Begin where a mechanism of the same unknowns is."""
        x = state.x.copy()
        observed = np.array([self.norm.observe(point) for point in x])
        self.equations.keep_within(x, self.norm.film_gaps(observed[0]))
        self.state = IntegratorState(
            state.times * span, x, state.rate / span, observed, state.step * span
        )


def recorded_again(record: CycleRecord, run: Run, span: float, *, alike: bool) -> CycleRecord:
    """Record of another run through the steps of a record.

    Parameters
    ----------
    record
        Of a run that has ended.
    run
        Of another mechanism, at its start.
    span
        Time to simulate, or period, over that of the record.
    alike
        Whether its state means what that of the record means: bodies reduced to the same modes.
        Else it finds a cycle of its own to begin with.

    Raises
    ------
    PeriodicityError, SolverError
        From its steps and `Cycles`.
    """
    if record.period is None:
        held = HeldRun(run, record, span)
        found = CycleRecord(held)
        steps: Iterable[MechanismStep] = held.until(float(record.times[-1]) * span)
    else:
        held = _at_a_cycle(record, run, span, alike)
        period = record.period * span
        # Of the search for its own cycle nothing is left but where it is.
        before = round(held.state.time / period)
        cycles = Cycles(held, period, PERIODICITY, before + MOST)
        cycles.number = before + 1
        found, steps = CycleRecord(held, cycles), cycles
        found.start = record.start
    for _ in found.follow(steps):
        pass
    return found


def _at_a_cycle(record: CycleRecord, run: Run, span: float, alike: bool) -> HeldRun:
    """At the end of a cycle, to go on through the steps of the record."""
    assert record.period is not None
    if alike and not run.equations.system.heated:
        held = HeldRun(run, record, span)
        held.take(record.run.state, span)
        return held
    for _ in run.until(record.period * span):
        pass
    return HeldRun(run, record, span)
