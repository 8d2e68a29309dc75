"""Newton's method for one implicit step, with iterates that stay in the admissible set."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from fenics_ehd.errors import SolverError

MAX_NEWTON = 12

#: An update may not take more than this fraction of the distance to the boundary.
BOUNDARY_FRACTION = 0.7


@dataclass(frozen=True, eq=False)
class ImplicitStep:
    """What a time integration formula asks for at the end of a step.

    Attributes
    ----------
    time
        End of the step [s].
    shift, past_x, past_rate
        ``x' = shift x + past_x`` and ``x'' = shift x' + past_rate``.
    start, predicted
        Values at the beginning of the step and extrapolated to its end.
    watched
        What the step control watches, at the start and as predicted.
    tolerance
        On the last update of an iteration, in the problem's norm.
    """

    time: float
    shift: float
    past_x: np.ndarray
    past_rate: np.ndarray
    start: np.ndarray
    predicted: np.ndarray
    watched: tuple[np.ndarray, np.ndarray]
    tolerance: float

    def rates(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``x'`` and ``x''`` for a value at the end of the step."""
        rate = self.shift * x + self.past_x
        return rate, self.shift * rate + self.past_rate

    def acceleration(self, rate: np.ndarray) -> np.ndarray:
        """``x''`` for a rate at the end of the step."""
        return self.shift * rate + self.past_rate

    @property
    def shifts(self) -> tuple[float, float]:
        """``d x' / d x`` and ``d x'' / d x``."""
        return self.shift, self.shift**2


@dataclass(frozen=True, eq=False)
class Attempt:
    """Outcome of the solution of one step; `failure` says why there is none.

    `auxiliary` is for whoever looks at the step, `memory` for the solution of the next. `rate`
    is given where it is not the formula's of x.
    """

    iterations: int
    failure: str | None = None
    x: np.ndarray = field(default_factory=lambda: np.empty(0))
    auxiliary: Any = None
    memory: Any = None
    cause: Exception | None = None
    rate: np.ndarray | None = None


#: Solves a step with the memory of the one before, None for the first.
StepSolver = Callable[[Any, ImplicitStep, Any], Attempt]


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


def newton(problem: SecondOrderProblem, step: ImplicitStep, auxiliary: Any) -> Attempt:
    """Solve one step."""
    change = step.predicted - step.start
    limit = BOUNDARY_FRACTION * problem.admissible_fraction(step.start, change)
    x = step.start + min(1.0, limit) * change
    for iteration in range(1, MAX_NEWTON + 1):
        try:
            residual, jacobian, auxiliary = problem.linearise(
                step.time, x, *step.rates(x), step.shifts, auxiliary
            )
            update = -np.linalg.solve(jacobian, residual)
        except (SolverError, np.linalg.LinAlgError) as error:
            return Attempt(iteration, f"{type(error).__name__}: {error}", cause=error)
        if not np.isfinite(update).all():
            return Attempt(iteration, "Newton's update is not finite")
        fraction = min(1.0, BOUNDARY_FRACTION * problem.admissible_fraction(x, update))
        x = x + fraction * update
        # One iteration would leave the auxiliary state that of the prediction.
        if iteration > 1 and fraction == 1.0 and problem.norm(x, update) <= step.tolerance:
            return Attempt(iteration, None, x, auxiliary, auxiliary)
    return Attempt(MAX_NEWTON, f"Newton did not converge in {MAX_NEWTON} iterations")
