"""Variable-step backward differentiation for implicit second-order systems.

Solves ``r(t, x, x', x'') = 0``. Rates are those of the interpolation
polynomial through the newest and the last k points, at the newest point, for
``x`` and again for ``x'``; k = 2 is A-stable at constant steps and damps the
high-frequency static modes, which carry no dynamics.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from fenics_ehd.errors import SolverError, StepSizeError

#: Largest growth of the step by order. Variable-step formulas are zero-stable for ratios below
#: 2.41 (k = 2) and 1.61 (k = 3) (Guglielmi and Zennaro, Numer. Math. 2001); for k = 4 only 1.28
#: is left, too little to start a film from steps of 1e-8 s.
GROWTH = {1: 2.0, 2: 2.0, 3: 1.5}

#: A failed step shrinks by at most this factor; steps aim this far below the tolerance.
SHRINKAGE, SAFETY = 0.2, 0.9

#: Newton stops when its last update is below this fraction of the step tolerance.
NEWTON_FRACTION = 1e-2
MAX_NEWTON = 12

#: An update may not take more than this fraction of the distance to the boundary.
BOUNDARY_FRACTION = 0.7


class SecondOrderProblem(Protocol):
    """What the integrator asks of a problem; `norm` makes the tolerance mean something."""

    def linearise(
        self,
        time: float,
        x: np.ndarray,
        rate: np.ndarray,
        acceleration: np.ndarray,
        shifts: tuple[float, float],
        guess: Any,
    ) -> tuple[np.ndarray, np.ndarray, Any]:
        """Residual, its total derivative along x, and an auxiliary state."""

    def norm(self, x: np.ndarray, change: np.ndarray) -> float:
        """Size of a change of x, relative: 1 is a change of the size of the quantity watched."""

    def admissible_fraction(self, x: np.ndarray, change: np.ndarray) -> float:
        """Largest f with x + f * change on the boundary of the admissible set."""


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
    """

    tolerance: float
    first_step: float
    smallest_step: float
    largest_step: float
    order: int = 2


@dataclass(frozen=True, eq=False)
class Step:
    """One accepted step.

    `rejected` counts the attempts since the last accepted step that failed,
    by reason; `newton_iterations` includes theirs. `auxiliary` belongs to the
    last iterate but one, which differs from x by less than the Newton tolerance.
    """

    time: float
    x: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    auxiliary: Any
    newton_iterations: int
    rejected: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Attempt:
    """Outcome of Newton's iteration for one step; `failure` says why there is no solution."""

    iterations: int
    failure: str | None = None
    x: np.ndarray = field(default_factory=lambda: np.empty(0))
    rate: np.ndarray = field(default_factory=lambda: np.empty(0))
    acceleration: np.ndarray = field(default_factory=lambda: np.empty(0))
    auxiliary: Any = None
    cause: Exception | None = None


def derivative_weights(times: np.ndarray) -> np.ndarray:
    """Weights of the derivative, at the first time, of the polynomial through all times."""
    distance = times[0] - times[1:]
    weights = np.empty(len(times))
    weights[0] = np.sum(1.0 / distance)
    for j in range(1, len(times)):
        others = np.delete(times, [0, j])
        weights[j] = np.prod(times[0] - others) / np.prod(times[j] - others) / (times[j] - times[0])
    return weights


def extrapolate(times: np.ndarray, values: np.ndarray, target: float) -> np.ndarray:
    """Value at `target` of the polynomial through all points."""
    weights = np.array(
        [
            np.prod((target - np.delete(times, j)) / (t - np.delete(times, j)))
            for j, t in enumerate(times)
        ]
    )
    return weights @ values


class _History:
    """Past points, newest first."""

    def __init__(self, time: float, x: np.ndarray, rate: np.ndarray):
        self.times = np.array([time])
        self.x = x[None]
        self.rate = rate[None]

    def push(self, time: float, x: np.ndarray, rate: np.ndarray, keep: int) -> None:
        self.times = np.concatenate([[time], self.times])[:keep]
        self.x = np.vstack([x, self.x])[:keep]
        self.rate = np.vstack([rate, self.rate])[:keep]

    def usable_order(self, order: int) -> int:
        """Order with one more past point for the extrapolation; the first step has the rate."""
        return max(1, min(order, len(self.times) - 1))

    def predict(self, time: float, points: int) -> np.ndarray:
        """Extrapolation of the newest points, or along the initial rate."""
        if len(self.times) == 1:
            return self.x[0] + (time - self.times[0]) * self.rate[0]
        return extrapolate(self.times[:points], self.x[:points], time)

    def local_error(
        self,
        problem: SecondOrderProblem,
        order: int,
        time: float,
        x: np.ndarray,
        predicted: np.ndarray,
    ) -> float:
        """Part of the distance from the extrapolation that the formula leaves, in the norm."""
        implicit = 1.0 / np.sum(1.0 / (time - self.times[:order]))
        oldest = self.times[order] if len(self.times) > order else self.times[0]
        share = implicit / (time - oldest + implicit)
        return share * problem.norm(x, x - predicted)


def _newton(
    problem: SecondOrderProblem,
    time: float,
    history: _History,
    order: int,
    predicted: np.ndarray,
    tolerance: float,
    auxiliary: Any,
) -> _Attempt:
    """Solve one step with iterates that stay in the admissible set."""
    times = np.concatenate([[time], history.times[:order]])
    weights = derivative_weights(times)
    alpha = weights[0]
    past_x = weights[1:] @ history.x[:order]
    past_rate = weights[1:] @ history.rate[:order]
    start = history.x[0]
    change = predicted - start
    limit = BOUNDARY_FRACTION * problem.admissible_fraction(start, change)
    x = start + min(1.0, limit) * change
    for iteration in range(1, MAX_NEWTON + 1):
        rate = alpha * x + past_x
        acceleration = alpha * rate + past_rate
        try:
            residual, jacobian, auxiliary = problem.linearise(
                time, x, rate, acceleration, (alpha, alpha**2), auxiliary
            )
            update = -np.linalg.solve(jacobian, residual)
        except (SolverError, np.linalg.LinAlgError) as error:
            return _Attempt(iteration, f"{type(error).__name__}: {error}", cause=error)
        if not np.isfinite(update).all():
            return _Attempt(iteration, "Newton's update is not finite")
        fraction = min(1.0, BOUNDARY_FRACTION * problem.admissible_fraction(x, update))
        x = x + fraction * update
        # One iteration would leave the auxiliary state that of the prediction.
        if iteration > 1 and fraction == 1.0 and problem.norm(x, update) <= tolerance:
            rate = alpha * x + past_x
            return _Attempt(iteration, None, x, rate, alpha * rate + past_rate, auxiliary)
    return _Attempt(MAX_NEWTON, f"Newton did not converge in {MAX_NEWTON} iterations")


def integrate(
    problem: SecondOrderProblem,
    span: tuple[float, float],
    x: np.ndarray,
    rate: np.ndarray,
    control: StepControl,
) -> Iterator[Step]:
    """Integrate and yield every accepted step.

    The local error is estimated from the distance between the solution and the
    extrapolation of the last k + 1 points.

    Parameters
    ----------
    problem
        The system.
    span
        Start and end time [s]; the last step ends at the end.
    x, rate
        Initial values, shape (n,).
    control
        Tolerance and step sizes.

    Raises
    ------
    StepSizeError
        The step fell below the smallest allowed one.
    """
    time, end = span
    history = _History(time, x, rate)
    step = min(control.first_step, control.largest_step)
    auxiliary, iterations = None, 0
    rejected: dict[str, int] = {}
    while time < end:
        target, step = _target(time, end, step)
        order = history.usable_order(control.order)
        predicted = history.predict(target, order + 1)
        attempt = _newton(
            problem,
            target,
            history,
            order,
            predicted,
            NEWTON_FRACTION * control.tolerance,
            auxiliary,
        )
        iterations += attempt.iterations
        failure, error = attempt.failure, np.inf
        if failure is None:
            error = history.local_error(problem, order, target, attempt.x, predicted)
            if not error <= control.tolerance:
                failure = "error above tolerance"
        ratio = control.tolerance / max(error, 1e-10 * control.tolerance)
        factor = SAFETY * ratio ** (1.0 / (order + 1))
        step *= float(np.clip(factor, SHRINKAGE, GROWTH[order]))
        step = min(step, control.largest_step)
        if failure is None:
            time, auxiliary = target, attempt.auxiliary
            history.push(time, attempt.x, attempt.rate, control.order + 2)
            yield Step(
                time,
                attempt.x,
                attempt.rate,
                attempt.acceleration,
                attempt.auxiliary,
                iterations,
                rejected,
            )
            iterations, rejected = 0, {}
        else:
            reason = failure.split(":")[0]
            rejected[reason] = rejected.get(reason, 0) + 1
        if step < control.smallest_step and time < end:
            raise StepSizeError(
                f"the step fell to {step:.1e} s at t = {time:.6g} s, below time.smallest_step = "
                f"{control.smallest_step:.1e} s (last attempt: {failure or 'accepted'}): "
                "raise time.tolerance or check the load on the bearing"
            ) from attempt.cause


def _target(time: float, end: float, step: float) -> tuple[float, float]:
    """End of the next step and its length: two equal last steps, not a long and a tiny one."""
    remaining = end - time
    if step >= remaining:
        return end, remaining
    step = min(step, max(0.5 * remaining, remaining - step))
    return time + step, step
