"""A mechanism from its start to an end time, or to the cycle that repeats itself."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fenics_ehd.errors import FilmTooThinError, PeriodicityError, SettingsError
from fenics_ehd.multibody.assembly import assemble
from fenics_ehd.multibody.bdf import IntegratorState, Step, StepControl, advance
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.result import Recorder, Result
from fenics_ehd.multibody.step_norm import StepNorm
from fenics_ehd.multibody.step_solver import CoupledSteps, StepMemory
from fenics_ehd.multibody.system import FilmPlace, System

#: Damping ratio above which the formula of order 3 damps a mode at every step: it is A(82)-stable.
DAMPED = float(np.cos(np.radians(82.0)))


@dataclass(frozen=True)
class Steps:
    """How to step.

    Attributes
    ----------
    tolerance
        Local error of a step: relative change of every gap, and of coordinates as
        `Body.error_measure` has them.
    order
        Of the backward differentiation formula, 1 to 3; 2 for 3 where modes lack damping.
    first, smallest
        [s].
    largest
        Share of the time to simulate, or of a cycle.
    """

    tolerance: float = 1e-5
    order: int = 3
    first: float = 1e-8
    smallest: float = 1e-13
    largest: float = 0.02


class Run:
    """A mechanism on its way; see `simulate` and `simulate_periodic`.

    Parameters
    ----------
    mechanism
        It is assembled from its rough pose.
    steps, span
        How to step, and the time that `Steps.largest` is a share of [s].

    Attributes
    ----------
    equations, norm
        Of the mechanism.
    state
        Of the integration.

    Raises
    ------
    SettingsError
        The mechanism cannot be assembled, or the span is not above 0.
    """

    def __init__(self, mechanism: Mechanism, steps: Steps, span: float):
        if not span > 0.0:
            raise SettingsError(f"end or period = {span:g} s must be above 0")
        self._system = system = System(mechanism)
        self._solve = CoupledSteps(system)
        self.equations = self._solve.equations
        self.norm = StepNorm(self.equations)
        # Order 3 feeds modes of little damping, by 5 to 10 % a step where a step is a radian of
        # theirs: a full interface without damping was 71 % off (`docs/extremes.md`).
        order = steps.order if system.least_damping >= DAMPED else min(steps.order, 2)
        self._control = StepControl(
            steps.tolerance, steps.first, steps.smallest, steps.largest * span, order
        )
        z, rates = assemble(system)
        resting = np.zeros(self.equations.patterns)
        start = np.concatenate([z, resting]), np.concatenate([rates, resting])
        self.state = IntegratorState.begin(self.norm, 0.0, *start, self._control)

    @property
    def integrator(self) -> IntegratorState:
        """The state, as `fenics_ehd.checkpoint.Stored` names it."""
        return self.state

    def memory(self) -> dict[str, Any]:
        """The state as nested dictionaries of arrays and numbers, for `restore`."""
        state, solver = self.state, self.state.memory
        points = {name: getattr(state, name) for name in ("times", "x", "rate", "watched", "step")}
        return {"integrator": points, "solver": {} if solver is None else vars(solver)}

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Go on where another run of the same mechanism was."""
        solver = StepMemory(**memory["solver"]) if memory["solver"] else None
        self.state = IntegratorState(**memory["integrator"], memory=solver)

    def until(self, end: float) -> Iterator[Step]:
        """Accepted steps up to a time [s].

        Raises
        ------
        StepSizeError
            No step is short enough.
        FilmTooThinError
            After the step whose film is too thin.
        """
        while self.state.time < end:
            step, self.state = advance(
                self.norm, self.state, end, self._control, self._solve, self._system.tables
            )
            yield step
            gaps = self.norm.film_gaps(step.watched)
            for place, gap in zip(self._system.films, gaps, strict=True):
                _check_film(place, float(gap.min()), step.time)


def simulate(mechanism: Mechanism, end: float, **steps: Any) -> Result:
    """Solve the initial value problem.

    Parameters
    ----------
    mechanism
        What moves; it is assembled from its rough pose.
    end
        End time [s].
    steps
        Fields of `Steps`: ``tolerance=1e-6``.

    Raises
    ------
    SettingsError
        The mechanism cannot be assembled, or the end is not after the start.
    StepSizeError
        No step is short enough.
    FilmTooThinError
        A film became thinner than its joint's `smallest_film`.
    """
    run = Run(mechanism, Steps(**steps), end)
    record = Recorder(run.equations, run.norm)
    for step in run.until(end):
        record.add(step)
    return record.result()


def simulate_periodic(
    mechanism: Mechanism,
    period: float,
    *,
    periodicity: float = 1e-4,
    cycles: int = 20,
    **steps: Any,
) -> Result:
    """The cycle that repeats itself, of a mechanism whose forcing repeats.

    Cycle after cycle is integrated, without a stop in between, until no film changes by more
    than `periodicity` from the start of a cycle to its end.

    Parameters
    ----------
    mechanism, steps
        As for `simulate`.
    period
        Of all drives and forces [s].
    periodicity
        Relative to the film.
    cycles
        To give up after.

    Returns
    -------
    Result
        Of the last cycle, its time from 0 to the period.

    Raises
    ------
    PeriodicityError
        The films still change after so many cycles.
    SettingsError, StepSizeError, FilmTooThinError
        As `simulate`; there is no film to repeat.
    """
    run = Run(mechanism, Steps(**steps), period)
    before = run.norm.gaps(run.state.watched[0])
    if not len(before):
        raise SettingsError("a mechanism without a lubricated joint has no film to repeat")
    defect = np.inf
    for cycle in range(1, cycles + 1):
        record = Recorder(run.equations, run.norm)
        for step in run.until(cycle * period):
            record.add(step)
        after = run.norm.gaps(run.state.watched[0])
        defect, before = float(np.max(np.abs(after - before) / after)), after
        if defect <= periodicity:
            result = record.result(cycle, defect)
            return replace(result, time=result.time - (cycle - 1) * period)
    raise PeriodicityError(
        f"after cycles = {cycles} of {period:g} s the films still change by {defect:.2e} from "
        f"cycle to cycle, above periodicity = {periodicity:g}: allow more cycles or check the loads"
    )


def _check_film(place: FilmPlace, thickness: float, time: float) -> None:
    smallest = place.joint.smallest_film * place.film.clearance
    if thickness < smallest:
        raise FilmTooThinError(
            f"the film of {place.name} is {thickness * 1e6:.3g} um thin at t = {time:.6g} s, below "
            f"smallest_film of the clearance, {smallest * 1e6:.3g} um: surfaces would touch"
        )
