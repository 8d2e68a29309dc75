"""From one cycle of a periodically driven system to the cycle that repeats itself.

A cycle maps its start to its end, ``x_1 = Phi(x_0)``. Its derivative, the monodromy
matrix, follows from the equation ``K y + D y' = 0`` of small variations, integrated
by the formula and the steps of the cycle itself. Newton's method for
``Phi(x) = x`` then starts the next cycle at ``x_0 + (I - Phi')^-1 (x_1 - x_0)``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.multibody.bdf import SecondOrderProblem, Step, derivative_weights

#: Newton's start is tried when a cycle ends this close to its start (in the problem's norm).
NEAR = 0.3

#: Of the way from the end of a cycle to the boundary, Newton's start may take this share.
BOUNDARY_SHARE = 0.7

#: Singular values of ``I - Phi'`` below this share of the largest belong to neutral directions:
#: orbits side by side, each of them periodic. No correction is made along them.
NEUTRAL = 1e-3


@dataclass(frozen=True, eq=False)
class Cycle:
    """One cycle and what follows from it.

    Attributes
    ----------
    start, end
        shape (n,).
    monodromy
        ``d end / d start``, shape (n, n).
    defect
        Distance of the end from the start, in the problem's norm.
    correction
        Change of the start that would close the cycle to first order, shape (n,).
    """

    start: np.ndarray
    end: np.ndarray
    monodromy: np.ndarray
    defect: float
    correction: np.ndarray

    @property
    def largest_multiplier(self) -> float:
        """Modulus of the largest Floquet multiplier; below 1 the orbit attracts."""
        return float(np.abs(np.linalg.eigvals(self.monodromy)).max())


class CycleVariation:
    """Accumulates the monodromy matrix along the steps of one cycle.

    Parameters
    ----------
    start
        Initial value, shape (n,).
    time
        Initial time [s].
    order
        Of the formula, as in `StepControl`.
    """

    def __init__(self, start: np.ndarray, time: float, order: int):
        self._start, self._order = start, order
        self._times = np.array([time])
        self._variations = [np.eye(len(start))]
        self._end = start

    def add(self, step: Step) -> None:
        """Account for an accepted step; its auxiliary state has `stiffness` and `damping`."""
        order = max(1, min(self._order, len(self._times) - 1))
        times = np.concatenate([[step.time], self._times[:order]])
        weights = derivative_weights(times)
        past = sum(w * y for w, y in zip(weights[1:], self._variations, strict=False))
        stiffness, damping = step.auxiliary.stiffness, step.auxiliary.damping
        variation = -np.linalg.solve(stiffness + weights[0] * damping, damping @ past)
        keep = self._order + 2
        self._times = np.concatenate([[step.time], self._times])[:keep]
        self._variations = [variation, *self._variations][:keep]
        self._end = step.x

    def finish(self, problem: SecondOrderProblem) -> Cycle:
        """The whole cycle."""
        monodromy, change = self._variations[0], self._end - self._start
        identity = np.eye(len(change))
        correction = np.linalg.lstsq(identity - monodromy, change, rcond=NEUTRAL)[0]
        defect = problem.norm(self._end, change)
        return Cycle(self._start, self._end, monodromy, defect, correction)


def repeats(problem: SecondOrderProblem, cycle: Cycle, tolerance: float) -> bool:
    """Whether both the defect and the correction are within a tolerance, in the problem's norm.

    The second one tells a periodic orbit from one that still creeps towards it.
    """
    return max(cycle.defect, problem.norm(cycle.end, cycle.correction)) <= tolerance


def next_start(problem: SecondOrderProblem, cycle: Cycle) -> tuple[np.ndarray, bool]:
    """Where to start the next cycle, and whether Newton chose it.

    Far from a periodic orbit, or where Newton's start would come near the
    boundary of the admissible set, the next cycle goes on from the end of the last.
    """
    change = cycle.start + cycle.correction - cycle.end
    room = BOUNDARY_SHARE * problem.admissible_fraction(cycle.end, change)
    if cycle.defect > NEAR or room < 1.0 or not np.isfinite(change).all():
        return cycle.end, False
    return cycle.end + change, True
