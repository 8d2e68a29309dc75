"""One implicit step of a second-order system: what is asked, and how an attempt ended."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

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
    observed
        What the step control observes, at the start and as predicted.
    tolerance
        On the last update of an iteration, in the problem's norm.
    """

    time: float
    shift: float
    past_x: np.ndarray
    past_rate: np.ndarray
    start: np.ndarray
    predicted: np.ndarray
    observed: tuple[np.ndarray, np.ndarray]
    tolerance: float

    def acceleration(self, rate: np.ndarray) -> np.ndarray:
        """``x''`` for a rate at the end of the step."""
        return self.shift * rate + self.past_rate


#: Problem, what a solution has beside x, and what the solver carries from step to step.
Problem = TypeVar("Problem")
Solution = TypeVar("Solution")
Carried = TypeVar("Carried")


@dataclass(frozen=True, eq=False)
class Solved(Generic[Solution, Carried]):
    """Solution of one step.

    Attributes
    ----------
    x, rate
        At the end of the step.
    solution
        For whoever looks at the step.
    solver
        For the solution of the next step.
    """

    x: np.ndarray
    rate: np.ndarray
    solution: Solution
    solver: Carried


@dataclass(frozen=True, eq=False)
class Attempt(Generic[Solution, Carried]):
    """Outcome of the solution of one step: solved, or why it failed."""

    iterations: int
    solved: Solved[Solution, Carried] | None = None
    failure: str = ""
    cause: Exception | None = None


#: Solves a step, after what the solver carries from the one before, None for the first.
StepSolver = Callable[[Problem, ImplicitStep, Carried | None], Attempt[Solution, Carried]]
