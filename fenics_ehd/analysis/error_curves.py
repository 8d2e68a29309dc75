"""Curves over time of a run and of its errors, and the errors of extremes that follow from them.

A long step can end before or after an extreme. Near an extreme, differences between values at steps
would have an arbitrary sign, so that trajectories are compared as smooth curves.

Imports inside functions: SciPy's interpolation is slow to import, and only budgets need it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fenics_ehd.analysis.replay import Trajectory
from fenics_ehd.multibody.trust import QUANTITIES

#: Columns of the first two quantities of error curves.
EXTREME_COLUMNS = ("max_pressure_Pa", "min_film_thickness_m")

#: Ends of columns without error curves: angles and heights of points, and estimates of errors.
WITHOUT_CURVE = ("_deg", "_height_m", "_error_estimate_m")

#: Relative distance of a quantity from its extreme, within which a time counts as near the extreme.
NEAR = 0.1

#: Number of parts of a step at whose ends curves are evaluated.
PARTS = 5

#: Largest share that remains from cycle to cycle, with which later cycles are extrapolated.
SLOWEST = 0.9


def has_error_curve(column: str) -> bool:
    """Whether a column of a joint, by its name with unit, has curves, except the extremes."""
    return column not in EXTREME_COLUMNS and not column.endswith(WITHOUT_CURVE)


def near_extreme(values: np.ndarray, change: np.ndarray) -> float:
    """Root mean square of an error curve at times when a curve is near its maximum.

    Parameters
    ----------
    values, change
        Curve and its error at k times, shape (k,).
    """
    near = values >= values.max() - NEAR * abs(values.max())
    return float(np.sqrt(np.mean(change[near] ** 2)))


@dataclass(frozen=True, eq=False)
class ErrorCurves:
    """Curves over time of a run or its last cycle, and curves of its errors.

    Every array of curves has q quantities of every joint, or errors of these (exact minus
    computed), shape (q, k, joints), at the k `times`. The first two quantities are the peak
    pressure [Pa] and the minimum film thickness [m]; the others are the `columns`.

    Attributes
    ----------
    trajectory
        Trajectory of the run.
    """

    trajectory: Trajectory

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of all columns of joints that have error curves, except the two extremes."""
        names = [name for joint in self.trajectory.joints.values() for name in joint.columns]
        return tuple(filter(has_error_curve, dict.fromkeys(names)))

    @cached_property
    def times(self) -> np.ndarray:
        """Times at which the curves are evaluated: the steps of the run and times between them [s].

        The shape is (k,).
        """
        times = self.trajectory.times
        before = np.append(self.trajectory.began, times[:-1])
        between = [times - share * (times - before) for share in np.arange(PARTS) / PARTS]
        return np.unique(between)

    def _at_steps(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Times and values at the steps of the run.

        The start of a cycle is added, with the values at the end of the cycle.
        """
        times = self.trajectory.times
        period = self.trajectory.period
        if period is None:
            return times, values
        return np.append(times[-1] - period, times), np.vstack([values[-1:], values])

    @cached_property
    def reported(self) -> np.ndarray:
        """Curves of the quantities of the run, shape (q, k, joints)."""
        return self._linear_at_steps(self.trajectory.curves(self.columns))

    @cached_property
    def between_nodes(self) -> np.ndarray:
        """Curves of the extremes between nodes, minus the extremes at the nodes alone."""
        films = [joint.film for joint in self.trajectory.joints.values()]
        peaks = [np.max(film.pressure, axis=1) for film in films]
        thinnest = [np.min(film.gap, axis=1) for film in films]
        nodal = np.array([peaks, thinnest]).swapaxes(1, 2)
        return self.reported[: len(nodal)] - self._linear_at_steps(nodal)

    def _linear_at_steps(self, values: np.ndarray) -> np.ndarray:
        """Curves by linear interpolation of values at the steps, shape (q, steps, joints)."""
        return np.array([_linear(self.times, *self._at_steps(each)) for each in values])

    def change(
        self,
        before: Trajectory,
        after: Trajectory,
        factor: float | np.ndarray,
        remaining: float = 0.0,
    ) -> np.ndarray:
        """Curves of the change between two trajectories, times a factor, after many cycles.

        Parameters
        ----------
        before, after, factor
            Trajectories of the run and of the changed run, and the factor.
        remaining
            Ratio r, with its sign, by which the growth of the change is multiplied from cycle to
            cycle. With r = 0, the result is the change in the second cycle.
        """
        changes = []
        each = (trajectory.curves(self.columns) for trajectory in (before, after))
        for values, changed in zip(*each, strict=True):
            curves = smooth_curve(before.times, values), smooth_curve(after.times, changed)
            changes.append(factor * self._between(*curves, min(remaining, SLOWEST)))
        return np.array(changes)

    def _between(self, before: Callable, after: Callable, remaining: float) -> np.ndarray:
        """Change of one quantity between two trajectories, after many cycles, shape (k, joints).

        `before` and `after` are functions that evaluate the quantity at given times.
        """
        first = after(self.times) - before(self.times)
        if self.trajectory.period is None:
            return np.nan_to_num(first)
        later = self.times + self.trajectory.period
        second = after(later) - before(later)
        growth = second - np.where(np.isfinite(first), first, second)
        limit = second + remaining / (1.0 - remaining) * growth
        return np.nan_to_num(np.where(np.isfinite(second), limit, first))

    @cached_property
    def steps(self) -> np.ndarray:
        """Indices of the ends of the steps in `times`, shape (steps,)."""
        return np.searchsorted(self.times, self.trajectory.times)

    def interpolated(self, times: np.ndarray, changes: Sequence[np.ndarray]) -> np.ndarray:
        """Curves from the changes of all quantities at `times`, each of shape (times, joints)."""
        return np.array([_linear(self.times, times, values) for values in changes])


def _linear(wanted: np.ndarray, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Interpolate values linearly at the times `wanted`; values have the shape (times, joints)."""
    return np.column_stack([np.interp(wanted, times, column) for column in values.T])


def smooth_curve(times: np.ndarray, values: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Function that evaluates smooth curves through values at given times, shape (k, joints).

    The function takes times; it returns nan outside of the range of the given times.
    """
    if len(times) < 2:
        return lambda wanted: np.full((len(wanted), values.shape[1]), np.nan)
    from scipy.interpolate import Akima1DInterpolator

    curve = Akima1DInterpolator(times, values)
    return lambda wanted: np.asarray(curve(wanted, extrapolate=False))


@dataclass(frozen=True, eq=False)
class Extreme:
    """Peak pressure or minimum film thickness of one joint over a run or cycle.

    Attributes
    ----------
    quantity
        ``"max_pressure"`` or ``"min_film_thickness"``.
    joint
        Index of the joint.
    value
        Value in the summary of the run [Pa] or [m].
    reported
        Curves of all joints over time, see `ErrorCurves.reported`, shape (q, k, joints).
    """

    quantity: str
    joint: int
    value: float
    reported: np.ndarray

    def _outward(self, curves: np.ndarray) -> np.ndarray:
        """Curve of this quantity and joint, shape (k,); multiplied by -1 for a film thickness."""
        curve = curves[QUANTITIES.index(self.quantity), :, self.joint]
        return curve if self.quantity == "max_pressure" else -curve

    def bias(self, changes: Sequence[np.ndarray]) -> float:
        """Relative error of the extreme from the sum of error curves, positive if it is too large.

        Each of the `changes` is the curves of one error component, shape (q, k, joints).
        """
        values = self._outward(self.reported)
        total = sum(self._outward(change) for change in changes)
        growth = float((values + total).max() - values.max()) / abs(self.value)
        return 0.0 - growth if self.quantity == "max_pressure" else growth

    def near(self, change: np.ndarray) -> float:
        """Root mean square of an error curve at times near the extreme, over the extreme [-]."""
        values = self._outward(self.reported)
        return near_extreme(values, self._outward(change)) / abs(self.value)

    def share(self, change: np.ndarray) -> float:
        """Relative error of the extreme by one component: mean of `near` and the size of `bias`.

        `near` is included because an unchanged extreme between changed neighbours is a coincidence.
        """
        return 0.5 * (abs(self.bias([change])) + self.near(change))

    def over(self, change: np.ndarray) -> float:
        """Largest relative error of the curve at any time.

        An error of pressure is relative to the peak over all times, an error of film thickness to
        the film thickness at the same time.
        """
        values = self._outward(self.reported)
        scale = np.abs(values) if self.quantity == "min_film_thickness" else abs(self.value)
        return float((np.abs(self._outward(change)) / scale).max())
