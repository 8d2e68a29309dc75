"""Variable-step backward differentiation of implicit second-order systems.

Solves ``r(t, x, x', x'') = 0``; rates are those of `tabulated.blended`, for ``x`` and again
for ``x'``.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, Protocol, TypeVar

import attrs
import numpy as np

from fenics_ehd.base.errors import StepSizeError
from fenics_ehd.base.fields import count, number
from fenics_ehd.base.layout import Value
from fenics_ehd.multibody.tabulated import (
    POINTS,
    TabulatedLoad,
    blended,
    extrapolation_weights,
    rows_missed,
)

#: Largest fraction of the distance to the boundary that an update may use.
BOUNDARY_FRACTION = 0.7


@dataclass(frozen=True, eq=False)
class ImplicitStep:
    """Equations of a time integration formula at the end of a step.

    Attributes
    ----------
    time
        End of the step [s].
    shift, past_x, past_rate
        ``x' = shift x + past_x`` and ``x'' = shift x' + past_rate``.
    start, predicted
        Values at the beginning of the step and extrapolated to its end.
    observed
        Quantities observed by the step control, at the start and as predicted.
    tolerance
        Tolerance on the last update of an iteration, in the problem's norm.
    error_share
        Local error of the formula over the distance of the solution from the extrapolation.
    """

    time: float
    shift: float
    past_x: np.ndarray
    past_rate: np.ndarray
    start: np.ndarray
    predicted: np.ndarray
    observed: tuple[np.ndarray, np.ndarray]
    tolerance: float
    error_share: float = 1.0

    def acceleration(self, rate: np.ndarray) -> np.ndarray:
        """``x''`` for a rate at the end of the step."""
        return self.shift * rate + self.past_rate


#: Further results of a solution, and state that the solver keeps from step to step.
Solution = TypeVar("Solution")
Carried = TypeVar("Carried")


@dataclass(frozen=True, eq=False)
class Solved(Generic[Solution, Carried]):
    """Solution of one step.

    Attributes
    ----------
    x, rate
        Solution x and its rate at the end of the step.
    observed
        See `Observed`.
    solution
        Further results, for callers.
    solver
        State of the solver for the next step.
    """

    x: np.ndarray
    rate: np.ndarray
    observed: np.ndarray
    solution: Solution
    solver: Carried


@dataclass(frozen=True, eq=False)
class Attempt(Generic[Solution, Carried]):
    """Outcome of the solution of one step: its solution, or the cause of its failure."""

    iterations: int
    solved: Solved[Solution, Carried] | None = None
    cause: Exception | None = None


#: Solves a step of a problem, with the solver's state of the step before, None at first.
StepSolver = Callable[[Any, ImplicitStep, Carried | None], Attempt[Solution, Carried]]


#: Largest growth of the step by order. Variable-step formulas are zero-stable for ratios below
#: 2.41 (k = 2) and 1.61 (k = 3) (Guglielmi and Zennaro, Numer. Math. 2001); for k = 4 the limit is
#: 1.28, too small to start a film from steps of 1e-8 s.
GROWTH = {1: 2.0, 2: 2.0, 3: 1.5}

#: Smallest factor by which a failed step shrinks.
SHRINKAGE = 0.2

#: Factor on the step that would just meet the tolerance.
SAFETY = 0.9

#: Newton stops when its last update is below this fraction of the step tolerance.
NEWTON_FRACTION = 1e-2


class Observed(Protocol):
    """Problem whose errors the step control judges, relative to its own sizes."""

    def observe(self, x: np.ndarray) -> np.ndarray:
        """Quantities whose errors count, an affine function of x."""

    def error_norm(self, observed: np.ndarray, error: np.ndarray) -> float:
        """Relative size of an error of the observed quantities: 1 if it is as large as they are."""


@attrs.frozen(slots=False)
class IntegratorOptions:
    """Options of the integrator.

    Attributes
    ----------
    tolerance
        Largest estimated local error of a step, in the problem's norm: of a mechanism relative
        change of every gap, and of coordinates as `Body.error_measure` has them.
    order
        Number of past points k in the formula, 1 to 3.
    first, smallest
        [s].
    largest
        [s]; a mechanism's run takes it as a share of the time to simulate, or of a cycle.
    blend
        Share b of order k + 1, for k > 1; 0 leaves plain backward differentiation.
    """

    tolerance: float = number(1e-5, "relative", above=0)
    order: int = count(3, "of the formula", least=1, most=3)
    first: float = number(1e-8, "step [s]", above=0)
    smallest: float = number(1e-13, "step [s]", above=0)
    largest: float = number(0.02, "step", above=0)
    blend: float = number(0.5, "[-]", least=0, most=1)


@dataclass(frozen=True, eq=False)
class Step(Generic[Solution]):
    """One accepted step; `observed` is `Observed.observe` of x.

    `rejected` counts the failed attempts since the last accepted step by reason;
    `newton_iterations` includes the iterations of failed attempts. `solution` belongs to x; a
    further update would change both by less than `ImplicitStep.tolerance`.
    """

    time: float
    x: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    observed: np.ndarray
    solution: Solution
    newton_iterations: int
    rejected: dict[str, int] = field(default_factory=dict)


#: Layout of a stored `IntegratorState`, its solver's apart.
INTEGRATOR: Mapping[str, Value] = {
    "times": Value("float", ("PAST",)),
    "x": Value("float", ("PAST", "x")),
    "rate": Value("float", ("PAST", "x")),
    "observed": Value("float", ("PAST", "observed")),
    "step": Value("real", least=0.0),
}


@dataclass(frozen=True, eq=False)
class IntegratorState(Generic[Carried]):
    """Complete state of an integration between steps, from which a stored run is resumed.

    Attributes
    ----------
    times, x, rate, observed
        Past points, newest first, one row each.
    step
        Length of the next step [s].
    solver
        State of the step solver.
    """

    times: np.ndarray
    x: np.ndarray
    rate: np.ndarray
    observed: np.ndarray
    step: float
    solver: Carried | None = None

    @classmethod
    def begin(
        cls,
        problem: Observed,
        time: float,
        x: np.ndarray,
        rate: np.ndarray,
        control: IntegratorOptions,
    ) -> IntegratorState[Carried]:
        """State before the first step."""
        step = min(control.first, control.largest)
        return cls(np.array([time]), x[None], rate[None], problem.observe(x)[None], step)

    @property
    def time(self) -> float:
        """Time of the newest point [s]."""
        return float(self.times[0])

    def after(
        self, new: Step[Solution], step: float, solver: Carried, keep: int
    ) -> IntegratorState[Carried]:
        """State with one more point."""

        def rows(first: np.ndarray, others: np.ndarray) -> np.ndarray:
            return np.concatenate([first[None], others])[:keep]

        return IntegratorState(
            rows(np.array(new.time), self.times),
            rows(new.x, self.x),
            rows(new.rate, self.rate),
            rows(new.observed, self.observed),
            step,
            solver,
        )

    def usable_order(self, order: int) -> int:
        """Order with one more past point for the extrapolation; the first step has the rate."""
        return max(1, min(order, len(self.times) - 1))

    def predict(self, problem: Observed, time: float, points: int) -> tuple[np.ndarray, np.ndarray]:
        """Extrapolation of x and of the observed quantities; at first along the initial rate."""
        if len(self.times) == 1:
            x = self.x[0] + (time - self.times[0]) * self.rate[0]
            return x, problem.observe(x)
        weights = extrapolation_weights(self.times[:points], time)
        return weights @ self.x[:points], weights @ self.observed[:points]

    def misses(
        self, loads: Sequence[TabulatedLoad], time: float, x: np.ndarray, nearest: float
    ) -> bool:
        """True if a step to this point misses a row, see `rows_missed`."""
        return bool(loads) and rows_missed(loads, *self._ahead(time, x), nearest)[1]

    def _ahead(self, time: float, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Times and states of the next and of past points, for a comparison with tables."""
        times = np.concatenate([[time], self.times[:POINTS]])
        return times, np.vstack([x, self.x[:POINTS]])

    def reach(
        self,
        problem: Observed,
        loads: Sequence[TabulatedLoad],
        time: float,
        order: int,
        nearest: float,
    ) -> float:
        """The time, or the time of the last row before it up to which a step misses no row [s]."""
        if not loads:
            return time

        def look(end: float) -> tuple[np.ndarray, bool]:
            x = self.predict(problem, end, order + 1)[0]
            return rows_missed(loads, *self._ahead(end, x), nearest)

        rows, missed = look(time)
        if not missed:
            return time
        return float(rows[bisect_left(rows, True, lo=1, key=lambda end: look(end)[1]) - 1])

    def implicit_step(
        self, problem: Observed, time: float, order: int, blend: float, tolerance: float
    ) -> ImplicitStep:
        """Equations for the next point, by the formula of an order `blended` with the next."""
        predicted, observed = self.predict(problem, time, order + 1)
        weights, lower = blended(time, self.times, order, blend)
        past = weights[1:]
        implicit = lower / weights[0]
        oldest = self.times[order] if len(self.times) > order else self.times[0]
        return ImplicitStep(
            time,
            shift=float(weights[0]),
            past_x=past @ self.x[: len(past)],
            past_rate=past @ self.rate[: len(past)],
            start=self.x[0],
            predicted=predicted,
            observed=(self.observed[0], observed),
            tolerance=tolerance,
            error_share=float(implicit / (time - oldest + implicit)),
        )


def advance(
    problem: Observed,
    state: IntegratorState[Carried],
    end: float,
    control: IntegratorOptions,
    solve: StepSolver[Carried, Solution],
    tables: Sequence[TabulatedLoad] = (),
) -> tuple[Step[Solution], IntegratorState[Carried]]:
    """One accepted step, and the state after it.

    The local error is estimated from the distance between the solution and the
    extrapolation of the last k + 1 points. No step misses a row of a table.

    Parameters
    ----------
    problem
        Problem that `solve` solves, and whose norm measures errors.
    state
        State of the integration before the step.
    end
        Time that the step may reach at most [s].
    control
        Tolerance and step sizes.
    solve
        Solves the equations of one step.
    tables
        Loads whose rows no step may jump over.

    Raises
    ------
    StepSizeError
        The step fell below the smallest allowed one.
    """
    step = state.step
    iterations = 0
    rejected: dict[str, int] = {}
    nearest = control.smallest
    cause = None
    failure = "none"
    order = state.usable_order(control.order)
    while not step < nearest:
        time, step = _target(state.time, end, step)
        row = state.reach(problem, tables, time, order, nearest)
        corner = row < time
        if corner:
            time = row
            step = row - state.time
        limit = NEWTON_FRACTION * control.tolerance
        asked = state.implicit_step(problem, time, order, control.blend, limit)
        attempt = solve(problem, asked, state.solver)
        iterations += attempt.iterations
        error = np.inf
        cause = attempt.cause
        solved = attempt.solved
        failure = f"{type(cause).__name__}: {cause}" if cause else "error above tolerance"
        if solved is not None:
            observed = solved.observed
            distance = problem.error_norm(observed, observed - asked.observed[1])
            error = asked.error_share * distance
            # An angle that differs from its prediction may have passed other rows.
            if error <= control.tolerance and state.misses(tables, time, solved.x, nearest):
                error = np.inf
                failure = "row of a table missed"
        step = _next_step(step, error, order, control)
        if solved is not None and error <= control.tolerance:
            moved = solved.x, solved.rate, asked.acceleration(solved.rate)
            new = Step(time, *moved, observed, solved.solution, iterations, rejected)
            # Points before a corner of a load do not predict points after it.
            keep = 1 if corner else control.order + 2
            return new, state.after(new, step, solved.solver, keep)
        first = state.solver is None and np.isfinite(error)
        if solved is not None and first and step < nearest:
            # A start that contradicts the equations leaps in a step of any length: a journal
            # without mass presses at once on a bore without support. Integration begins after it.
            step = state.step
            state = IntegratorState(
                np.array([time]), solved.x[None], state.rate, observed[None], step, solved.solver
            )
        reason = failure.split(":")[0]
        rejected[reason] = rejected.get(reason, 0) + 1
    raise StepSizeError(
        f"the step fell to {step:.1e} s at t = {state.time:.6g} s, below time.smallest_step = "
        f"{nearest:.1e} s (last attempt: {failure}): "
        "raise time.tolerance or time.first_step, or check the load on the bearing"
    ) from cause


def _next_step(step: float, error: float, order: int, control: IntegratorOptions) -> float:
    """Step that would have met the tolerance [s]; an infinite error shortens by `SHRINKAGE`."""
    ratio = control.tolerance / max(error, 1e-10 * control.tolerance)
    factor = SAFETY * ratio ** (1.0 / (order + 1))
    return min(step * min(max(factor, SHRINKAGE), GROWTH[order]), control.largest)


def _target(time: float, end: float, step: float) -> tuple[float, float]:
    """End of the next step and its length: two equal last steps, not a long and a tiny one."""
    remaining = end - time
    if step >= remaining:
        return end, remaining
    step = min(step, max(0.5 * remaining, remaining - step))
    return time + step, step
