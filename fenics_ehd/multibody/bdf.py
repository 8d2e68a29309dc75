"""Variable-step backward differentiation of implicit second-order systems.

The system is ``r(t, x, x', x'') = 0``. The formula `tabulated.blended` gives ``x'`` from values of
x, and ``x''`` from values of ``x'``.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, Protocol, TypeVar

import attrs
import numpy as np

from fenics_ehd.base.described import Described
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

#: Largest share of a gap by which one update may reduce it.
BOUNDARY_FRACTION = 0.7


@dataclass(frozen=True, eq=False)
class ImplicitStep:
    """Time integration formula at the end of one step.

    Attributes
    ----------
    time
        Time at the end of the step [s].
    shift, past_x, past_rate
        Coefficients of ``x' = shift x + past_x`` and ``x'' = shift x' + past_rate``, shift in
        [1/s], the others of shape (n,).
    start, predicted
        Values of x at the start of the step, and extrapolated to its end, shape (n,).
    observed
        Observed quantities (`Observed.observe`) at the start, and extrapolated to the end.
    tolerance
        Largest accepted size of the last Newton update, in the norm of the problem.
    error_share
        Ratio of the local error of the formula to the distance between solution and extrapolation.
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
        """Second derivative ``x''`` for a rate ``x'`` at the end of the step."""
        return self.shift * rate + self.past_rate


#: Types of the further results of a solution, and of the state that a solver keeps between steps.
Solution = TypeVar("Solution")
Carried = TypeVar("Carried")


@dataclass(frozen=True, eq=False)
class Solved(Generic[Solution, Carried]):
    """Solution of one step.

    Attributes
    ----------
    x, rate
        Solution x and its rate at the end of the step, shape (n,) each.
    observed
        Observed quantities at x, see `Observed.observe`.
    solution
        Further results for the caller.
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
    """Outcome of an attempt to solve one step.

    Attributes
    ----------
    iterations
        Number of Newton iterations.
    solved
        Solution of the step; None if the attempt failed.
    cause
        Error that made the attempt fail, or None.
    work
        Counts of other work of the attempt by name; the solver defines the names.
    """

    iterations: int
    solved: Solved[Solution, Carried] | None = None
    cause: Exception | None = None
    work: Mapping[str, int] = field(default_factory=dict)


#: Function that solves one step of a problem. Its last argument is the state of the solver after
#: the previous step, None in the first one.
StepSolver = Callable[[Any, ImplicitStep, Carried | None], Attempt[Solution, Carried]]


#: Largest ratio of a step to the one before, by order k. Variable-step formulas are zero-stable for
#: ratios below 2.41 (k = 2) and 1.61 (k = 3) (Guglielmi and Zennaro, Numer. Math. 2001). For k = 4
#: the limit is 1.28, too small to start a film from steps of 1e-8 s.
GROWTH = {1: 2.0, 2: 2.0, 3: 1.5}

#: Smallest ratio of a step to a failed one.
SHRINKAGE = 0.2

#: Safety factor on the step that would just meet the tolerance.
SAFETY = 0.9

#: Tolerance of the last Newton update over that of a step.
NEWTON_FRACTION = 1e-2


class Observed(Protocol):
    """Problem that defines observed quantities and the norm of their errors for step control."""

    def observe(self, x: np.ndarray) -> np.ndarray:
        """Observed quantities, whose errors control the step: an affine function of x."""

    def error_norm(self, observed: np.ndarray, error: np.ndarray) -> float:
        """Relative size of an error of the observed quantities, 1 for an error of 100 %."""


@attrs.frozen(slots=False)
class IntegratorOptions(Described):
    """Options of the integrator.

    Attributes
    ----------
    tolerance
        Largest estimated local error of a step, in the norm of the problem: for a mechanism, the
        relative change of every gap, and of coordinates scaled by `Body.error_measure`.
    order
        Number of past points k in the formula, 1 to 3.
    first, smallest
        First and smallest step [s].
    largest
        Largest step [s]; for a run of a mechanism, relative to the time to simulate or to the
        length of the cycle [-].
    blend
        Share b of the formula of order k + 1, for k > 1; with 0 the formula is plain backward
        differentiation.
    """

    tolerance: float = number(1e-5, "relative", above=0)
    order: int = count(3, "of the formula", least=1, most=3)
    first: float = number(1e-8, "step [s]", above=0)
    smallest: float = number(1e-13, "step [s]", above=0)
    largest: float = number(0.02, "step", above=0)
    blend: float = number(0.5, "[-]", least=0, most=1)


@dataclass(frozen=True, eq=False)
class Step(Generic[Solution]):
    """Accepted step.

    Attributes
    ----------
    time
        Time at the end of the step [s].
    x, rate, acceleration
        Solution x and its first and second derivative at the end of the step, shape (n,) each.
    observed
        Observed quantities at x, see `Observed.observe`.
    solution
        Further results at x. A further Newton update would change x and these results by less than
        `ImplicitStep.tolerance`.
    newton_iterations
        Number of Newton iterations since the last accepted step, failed attempts included.
    rejected
        Number of failed attempts since the last accepted step, by reason.
    work
        Other work since the last accepted step (`Attempt.work`), failed attempts included.
    """

    time: float
    x: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    observed: np.ndarray
    solution: Solution
    newton_iterations: int
    rejected: dict[str, int] = field(default_factory=dict)
    work: Mapping[str, int] = field(default_factory=dict)


#: Layout of a stored `IntegratorState`, without the state of its solver.
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
        Times [s], solutions, rates and observed quantities at past points, a row for each point,
        newest first.
    step
        Length of the next step [s].
    solver
        State of the step solver; None before the first step.
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
        """Make the state of an integration before its first step, from x and its rate at a time."""
        step = min(control.first, control.largest)
        return cls(np.array([time]), x[None], rate[None], problem.observe(x)[None], step)

    @property
    def time(self) -> float:
        """Time of the newest point of the integration [s]."""
        return float(self.times[0])

    def after(
        self, new: Step[Solution], step: float, solver: Carried, keep: int
    ) -> IntegratorState[Carried]:
        """Return the state after an accepted step, which adds a point.

        Parameters
        ----------
        new
            The accepted step.
        step
            Length of the next step [s].
        solver
            State of the step solver.
        keep
            Largest number of points to keep, including the new one.
        """

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
        """Largest order up to `order` for which enough past points are known, at least 1.

        The extrapolation needs one more point than the order. The first step has only one point,
        and extrapolates along the initial rate.
        """
        return max(1, min(order, len(self.times) - 1))

    def predict(self, problem: Observed, time: float, points: int) -> tuple[np.ndarray, np.ndarray]:
        """Extrapolate x and the observed quantities from past points to a time [s].

        The first step extrapolates along the initial rate.
        """
        if len(self.times) == 1:
            x = self.x[0] + (time - self.times[0]) * self.rate[0]
            return x, problem.observe(x)
        weights = extrapolation_weights(self.times[:points], time)
        return weights @ self.x[:points], weights @ self.observed[:points]

    def misses(
        self, loads: Sequence[TabulatedLoad], time: float, x: np.ndarray, nearest: float
    ) -> bool:
        """Whether a step misses a row of a table; the step ends at `time` with the solution x.

        See `rows_missed` for `loads` and `nearest`.
        """
        return bool(loads) and rows_missed(loads, *self._ahead(time, x), nearest)[1]

    def _ahead(self, time: float, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Times [s] and solutions x of the next point and of past points, newest first."""
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
        """Latest time at which a step may end without missing a row of a table [s].

        The result is `time` if a step to this time misses no row, else the time of the last row at
        which a step may end.
        """
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
        """Make the formula of a step that ends at a time [s].

        The formula of order k is blended with that of order k + 1, see `tabulated.blended`.
        """
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
    """Take steps until one is accepted, and return this step with the state after it.

    The local error is estimated from the distance between the solution and the extrapolation of the
    last k + 1 points. Steps end at rows of tables that past loads do not predict, see
    `rows_missed`.

    Parameters
    ----------
    problem
        Problem that `solve` solves, and whose norm measures errors.
    state
        State of the integration before the step.
    end
        Latest time for the end of the step [s].
    control
        Tolerance and step sizes.
    solve
        Function that solves the equations of one step.
    tables
        Loads from tables; no step may miss a row, see `rows_missed`.

    Raises
    ------
    StepSizeError
        If the step becomes shorter than the smallest allowed step.
    """
    step = state.step
    iterations = 0
    rejected: dict[str, int] = {}
    work: Counter[str] = Counter()
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
        work.update(attempt.work)
        error = np.inf
        cause = attempt.cause
        solved = attempt.solved
        failure = f"{type(cause).__name__}: {cause}" if cause else "error above tolerance"
        if solved is not None:
            observed = solved.observed
            distance = problem.error_norm(observed, observed - asked.observed[1])
            error = asked.error_share * distance
            # With an angle that differs from its prediction, the step may miss other rows.
            if error <= control.tolerance and state.misses(tables, time, solved.x, nearest):
                error = np.inf
                failure = "row of a table missed"
        step = _next_step(step, error, order, control)
        if solved is not None and error <= control.tolerance:
            moved = solved.x, solved.rate, asked.acceleration(solved.rate)
            new = Step(time, *moved, observed, solved.solution, iterations, rejected, work)
            # Points before a corner of a load do not predict points after it.
            keep = 1 if corner else control.order + 2
            return new, state.after(new, step, solved.solver, keep)
        first = state.solver is None and np.isfinite(error)
        if solved is not None and first and step < nearest:
            # A start that contradicts the equations causes a jump in a step of any length, for
            # example of a massless journal on an unsupported bore. Integration starts after it.
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
    """Length of the next step [s], from the estimated error of the last one.

    The change is limited by `GROWTH` and, for failed steps with an infinite error, by `SHRINKAGE`.
    """
    ratio = control.tolerance / max(error, 1e-10 * control.tolerance)
    factor = SAFETY * ratio ** (1.0 / (order + 1))
    return min(step * min(max(factor, SHRINKAGE), GROWTH[order]), control.largest)


def _target(time: float, end: float, step: float) -> tuple[float, float]:
    """Time at the end of the next step, and its length [s].

    Before `end`, two equal steps replace a long and a tiny one.
    """
    remaining = end - time
    if step >= remaining:
        return end, remaining
    step = min(step, max(0.5 * remaining, remaining - step))
    return time + step, step
