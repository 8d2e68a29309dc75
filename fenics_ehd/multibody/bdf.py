"""Variable-step backward differentiation for implicit second-order systems.

Solves ``r(t, x, x', x'') = 0``; rates are those of `differentiation`, for ``x`` and again
for ``x'``.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from fenics_ehd.errors import StepSizeError
from fenics_ehd.multibody.differentiation import Formula, blended, extrapolation_weights
from fenics_ehd.multibody.newton import ImplicitStep, StepSolver, newton
from fenics_ehd.multibody.tabulated import POINTS, TabulatedLoad, rows_missed

#: Largest growth of the step by order. Variable-step formulas are zero-stable for ratios below
#: 2.41 (k = 2) and 1.61 (k = 3) (Guglielmi and Zennaro, Numer. Math. 2001); for k = 4 only 1.28
#: is left, too little to start a film from steps of 1e-8 s.
GROWTH = {1: 2.0, 2: 2.0, 3: 1.5}

#: A failed step shrinks by at most this factor; steps aim this far below the tolerance.
SHRINKAGE, SAFETY = 0.2, 0.9

#: Newton stops when its last update is below this fraction of the step tolerance.
NEWTON_FRACTION = 1e-2


class Watched(Protocol):
    """What the step control asks of a problem: it makes the tolerance mean something."""

    def watch(self, x: np.ndarray) -> np.ndarray:
        """Quantities whose error counts, an affine function of x."""

    def error_norm(self, watched: np.ndarray, error: np.ndarray) -> float:
        """Size of their error: 1 is an error of the size of the quantities themselves."""


def relative_error(values: np.ndarray, error: np.ndarray) -> float:
    """Largest error relative to the value there; infinite where a value is not positive.

    Of a gap: Newton's iterates stay in h > 0 at the film's Gauss points only.
    """
    if not values.min() > 0.0:
        return np.inf
    return float(np.max(np.abs(error) / values))


@dataclass(frozen=True)
class StepControl:
    """Settings of the integration.

    Attributes
    ----------
    tolerance
        Largest estimated local error of a step, in the problem's norm.
    first_step, smallest_step, largest_step
        [s].
    order
        Number of past points k in the formula, 1 to 3.
    blend
        Share b of order k + 1, for k > 1; 0 leaves plain backward differentiation.
    """

    tolerance: float
    first_step: float
    smallest_step: float
    largest_step: float
    order: int = 2
    blend: float = 0.5


@dataclass(frozen=True, eq=False)
class Step:
    """One accepted step; `watched` is `Watched.watch` of x, `weights` are those of its rate.

    `rejected` counts the attempts since the last accepted step that failed,
    by reason; `newton_iterations` includes theirs. `auxiliary` belongs to the
    last iterate but one, which differs from x by less than the Newton tolerance.
    """

    time: float
    x: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    watched: np.ndarray
    auxiliary: Any
    newton_iterations: int
    rejected: dict[str, int] = field(default_factory=dict)
    weights: np.ndarray = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True, eq=False)
class IntegratorState:
    """All that an integration carries from step to step: it can be stored and gone on with.

    Attributes
    ----------
    times, x, rate, watched
        Past points, newest first, one row each.
    step
        Length of the next step [s].
    memory
        What the step solver remembers (`Attempt.memory`).
    """

    times: np.ndarray
    x: np.ndarray
    rate: np.ndarray
    watched: np.ndarray
    step: float
    memory: Any = None

    @classmethod
    def begin(
        cls, problem: Watched, time: float, x: np.ndarray, rate: np.ndarray, control: StepControl
    ) -> IntegratorState:
        """Before the first step."""
        step = min(control.first_step, control.largest_step)
        return cls(np.array([time]), x[None], rate[None], problem.watch(x)[None], step)

    @property
    def time(self) -> float:
        """Of the newest point [s]."""
        return float(self.times[0])

    def after(self, new: Step, step: float, memory: Any, keep: int) -> IntegratorState:
        """With one more point."""

        def rows(first: np.ndarray, others: np.ndarray) -> np.ndarray:
            return np.concatenate([first[None], others])[:keep]

        return IntegratorState(
            rows(np.array(new.time), self.times),
            rows(new.x, self.x),
            rows(new.rate, self.rate),
            rows(new.watched, self.watched),
            step,
            memory,
        )

    def usable_order(self, order: int) -> int:
        """Order with one more past point for the extrapolation; the first step has the rate."""
        return max(1, min(order, len(self.times) - 1))

    def predict(self, problem: Watched, time: float, points: int) -> tuple[np.ndarray, np.ndarray]:
        """Extrapolation of x and what is watched, or along the initial rate."""
        if len(self.times) == 1:
            x = self.x[0] + (time - self.times[0]) * self.rate[0]
            return x, problem.watch(x)
        weights = extrapolation_weights(self.times[:points], time)
        return weights @ self.x[:points], weights @ self.watched[:points]

    def misses(
        self, loads: Sequence[TabulatedLoad], time: float, x: np.ndarray, nearest: float
    ) -> bool:
        """Whether a step to this point misses a row, see `rows_missed`."""
        return bool(loads) and rows_missed(loads, *self._ahead(time, x), nearest)[1]

    def _ahead(self, time: float, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Times and states of a next point and of those that a table is compared with."""
        times = np.concatenate([[time], self.times[:POINTS]])
        return times, np.vstack([x, self.x[:POINTS]])

    def reach(
        self,
        problem: Watched,
        loads: Sequence[TabulatedLoad],
        time: float,
        order: int,
        nearest: float,
    ) -> float:
        """The time, or that of the last row before it that a step can reach and miss none [s]."""
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
        self, problem: Watched, time: float, formula: Formula, order: int, tolerance: float
    ) -> ImplicitStep:
        """The formula's equations for the next point."""
        predicted, watched = self.predict(problem, time, order + 1)
        past = formula.weights[1:]
        return ImplicitStep(
            time,
            shift=float(formula.weights[0]),
            past_x=past @ self.x[: len(past)],
            past_rate=past @ self.rate[: len(past)],
            start=self.x[0],
            predicted=predicted,
            watched=(self.watched[0], watched),
            tolerance=tolerance,
        )

    def error_share(self, formula: Formula, order: int, time: float) -> float:
        """Part of the distance from the extrapolation that the formula leaves as local error."""
        implicit = formula.lower / formula.weights[0]
        oldest = self.times[order] if len(self.times) > order else self.times[0]
        return float(implicit / (time - oldest + implicit))


def integrate(
    problem: Any,
    span: tuple[float, float],
    x: np.ndarray,
    rate: np.ndarray,
    control: StepControl,
    solve: StepSolver = newton,
    tables: Sequence[TabulatedLoad] = (),
) -> Iterator[Step]:
    """Integrate and yield every accepted step.

    The local error is estimated from the distance between the solution and the
    extrapolation of the last k + 1 points. No step misses a row of a table.

    Parameters
    ----------
    problem
        The system: `Watched`, and what `solve` asks for.
    span
        Start and end time [s]; the last step ends at the end.
    x, rate
        Initial values, shape (n,).
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
    time, end = span
    state = IntegratorState.begin(problem, time, x, rate, control)
    while state.time < end:
        step, state = advance(problem, state, end, control, solve, tables)
        yield step


def advance(
    problem: Any,
    state: IntegratorState,
    end: float,
    control: StepControl,
    solve: StepSolver = newton,
    tables: Sequence[TabulatedLoad] = (),
) -> tuple[Step, IntegratorState]:
    """One accepted step towards the end time [s], and what to go on from; see `integrate`."""
    step, iterations = state.step, 0
    rejected: dict[str, int] = {}
    nearest = control.smallest_step
    cause, failure = None, "none"
    order = state.usable_order(control.order)
    while not step < control.smallest_step:
        time, step = _target(state.time, end, step)
        row = state.reach(problem, tables, time, order, nearest)
        corner = row < time
        if corner:
            time, step = row, row - state.time
        formula = blended(time, state.times, order, control.blend)
        limit = NEWTON_FRACTION * control.tolerance
        asked = state.implicit_step(problem, time, formula, order, limit)
        attempt = solve(problem, asked, state.memory)
        iterations += attempt.iterations
        error, cause = np.inf, attempt.cause
        failure = attempt.failure or "error above tolerance"
        if attempt.failure is None:
            watched = problem.watch(attempt.x)
            distance = problem.error_norm(watched, watched - asked.watched[1])
            error = state.error_share(formula, order, time) * distance
            # An angle that is not where it was foretold to be may have passed other rows.
            if error <= control.tolerance and state.misses(tables, time, attempt.x, nearest):
                error, failure = np.inf, "row of a table missed"
        step = _next_step(step, error, order, control)
        if error <= control.tolerance:
            x, rates, found = attempt.x, asked.rates(attempt.x), attempt.auxiliary
            new = Step(time, x, *rates, watched, found, iterations, rejected, formula.weights)
            # What was before a corner of a load says nothing of the time after it.
            keep = 1 if corner else control.order + 2
            return new, state.after(new, step, attempt.memory, keep)
        reason = failure.split(":")[0]
        rejected[reason] = rejected.get(reason, 0) + 1
    raise StepSizeError(
        f"the step fell to {step:.1e} s at t = {state.time:.6g} s, below time.smallest_step = "
        f"{control.smallest_step:.1e} s (last attempt: {failure}): "
        "raise time.tolerance or time.first_step, or check the load on the bearing"
    ) from cause


def _next_step(step: float, error: float, order: int, control: StepControl) -> float:
    """Step that would have met the tolerance [s]; an infinite error shortens by `SHRINKAGE`."""
    ratio = control.tolerance / max(error, 1e-10 * control.tolerance)
    factor = SAFETY * ratio ** (1.0 / (order + 1))
    return min(step * float(np.clip(factor, SHRINKAGE, GROWTH[order])), control.largest_step)


def _target(time: float, end: float, step: float) -> tuple[float, float]:
    """End of the next step and its length: two equal last steps, not a long and a tiny one."""
    remaining = end - time
    if step >= remaining:
        return end, remaining
    step = min(step, max(0.5 * remaining, remaining - step))
    return time + step, step
