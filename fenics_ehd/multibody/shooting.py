"""From one cycle of a periodically driven system to the cycle that repeats itself.

A cycle maps its start to its end, ``x_1 = Phi(x_0)``. Its derivative, the monodromy
matrix, follows from the equation ``K y + D y' = 0`` of small variations, integrated
by the formula and the steps of the cycle itself. Newton's method for
``Phi(x) = x`` then starts the next cycle at ``x_0 + (I - Phi')^-1 (x_1 - x_0)``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_ehd.multibody.bdf import Step, StepControl
from fenics_ehd.multibody.cycles import Cycle
from fenics_ehd.multibody.newton import SecondOrderProblem

#: Newton's start is tried when a cycle ends this close to its start (in the problem's norm).
NEAR = 0.3

#: Of the way from the end of a cycle to the boundary, Newton's start may take this share.
BOUNDARY_SHARE = 0.7

#: Singular values of ``I - Phi'`` below this share of the largest belong to neutral directions:
#: orbits side by side, each of them periodic. No correction is made along them.
NEUTRAL = 1e-3


@dataclass(frozen=True, eq=False)
class ShotCycle(Cycle):
    """A cycle with its derivative, `monodromy`: ``d end / d start``, shape (n, n)."""

    monodromy: np.ndarray


class Shooting:
    """Search for the periodic cycle, see `PeriodicSearch`.

    Parameters
    ----------
    problem
        The system; the auxiliary state of its steps has `stiffness` and `damping`.
    control
        Of the integration, whose formula this is.
    """

    def __init__(self, problem: SecondOrderProblem, control: StepControl):
        self._problem, self._control = problem, control

    def begin(self, start: np.ndarray) -> None:
        """A cycle begins, at time zero."""
        self._start = self._end = start
        self._variations = [np.eye(len(start))]

    def add(self, step: Step) -> None:
        """Account for an accepted step."""
        weights = step.weights
        past = sum(w * y for w, y in zip(weights[1:], self._variations, strict=False))
        stiffness, damping = step.auxiliary.stiffness, step.auxiliary.damping
        variation = -np.linalg.solve(stiffness + weights[0] * damping, damping @ past)
        self._variations = [variation, *self._variations][: self._control.order + 1]
        self._end = step.x

    def memory(self) -> dict[str, Any]:
        """See `PeriodicSearch`."""
        names = ("start", "end", "variations")
        return {name: getattr(self, f"_{name}") for name in names}

    def restore(self, memory: Mapping[str, Any]) -> None:
        """See `PeriodicSearch`."""
        for name, value in memory.items():
            setattr(self, f"_{name}", value)

    def finish(self) -> ShotCycle:
        """The whole cycle."""
        monodromy, change = self._variations[0], self._end - self._start
        identity = np.eye(len(change))
        correction = np.linalg.lstsq(identity - monodromy, change, rcond=NEUTRAL)[0]
        defect = self._problem.norm(self._end, change)
        next_start, corrected = self._next_start(defect, correction)
        return ShotCycle(
            start=self._start,
            end=self._end,
            defect=defect,
            remaining=self._problem.norm(self._end, correction),
            largest_multiplier=float(np.abs(np.linalg.eigvals(monodromy)).max()),
            next_start=next_start,
            corrected=corrected,
            monodromy=monodromy,
        )

    def _next_start(self, defect: float, correction: np.ndarray) -> tuple[np.ndarray, bool]:
        """Start of the next cycle, and whether Newton chose it.

        Far from a periodic orbit, or where Newton's start would come near the
        boundary of the admissible set, the next cycle goes on from the end of the last.
        """
        change = self._start + correction - self._end
        room = BOUNDARY_SHARE * self._problem.admissible_fraction(self._end, change)
        if defect > NEAR or room < 1.0 or not np.isfinite(change).all():
            return self._end, False
        return self._end + change, True
