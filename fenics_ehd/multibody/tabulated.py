"""Rates from past points in time, and tables whose rows no step may miss.

With the derivative ``D_k`` of the polynomial through the new point and the last k points, rates are

    x' = (1 - b) D_k x + b D_(k+1) x.

For k = 2 and b = 1/2 this is the numerical differentiation formula of Klopfenstein, also known as
BDF2-OPT, with half the error of BDF2. Like BDF2 it is A-stable at constant steps and damps
high-frequency modes, so that they respond statically (Shampine and Reichelt, SIAM J. Sci. Comput.
1997; Vatsa, Carpenter and Lockard 2010). For k = 3 it is A(82)-stable, while BDF3 is A(86)-stable.

A load is evaluated only at the ends of steps. A row of a table between two ends has no influence on
the solution, unless the values at the ends predict it. The estimated error of the solution does not
show this, because a solution without the load is as smooth as one with it. Steps therefore end at
rows that the polynomial through the past points misses (`rows_missed`).

Imports inside functions: SciPy's interpolation is slow to import.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_ehd.base.described import Described

if TYPE_CHECKING:
    from scipy.interpolate import PPoly


#: Largest ratio of successive steps, by order k, for which the formula of order k + 1 is used:
#: above it that formula is not zero-stable.
BLENDED_GROWTH = {2: 1.55, 3: 1.25}


def derivative_weights(times: np.ndarray) -> np.ndarray:
    """Weights with which values at n times give their derivative at the first of these times.

    It is the derivative of the polynomial through all values. `times` [s] and the weights [1/s]
    have the shape (n,).
    """
    distance = times[0] - times[1:]
    share = 1.0 / _products(times[:, None] - times)
    weights = np.empty(len(times))
    weights[0] = np.sum(1.0 / distance)
    weights[1:] = share[1:] / (share[0] * distance)
    return weights


def extrapolation_weights(times: np.ndarray, target: float | np.ndarray) -> np.ndarray:
    """Weights with which values at n times give the value at another time, `target`.

    It is the value of the polynomial through all values. The weights have the shape (n,), or (n, k)
    for k targets, given in an array of shape (k, 1).
    """
    distance = (target - times)[..., None, :]
    return (_products(distance) / _products(times[:, None] - times)).T


def _products(factors: np.ndarray) -> np.ndarray:
    """Product of the entries of every row of an n x n matrix except the diagonal, shape (n,).

    If `factors` is a single row, all n rows are equal to it.
    """
    return np.prod(np.where(np.eye(factors.shape[-1]), 1.0, factors), axis=-1)


def blended(time: float, past: np.ndarray, order: int, blend: float) -> tuple[np.ndarray, float]:
    """Weights of the formula for the rate at a new point, blended from two orders.

    The formulas are those of order k and of order k + 1.

    Parameters
    ----------
    time, past
        Time of the new point, and times of the past points, newest first [s].
    order
        Order k, at most the number of past points.
    blend
        Share b of the formula of order k + 1. It is used for k > 1 if there are more than k past
        points and the step does not grow too much.

    Returns
    -------
    weights : numpy.ndarray
        Weights of the values at the new point, then at the past points [1/s].
    share : float
        Share of the formula of order k: ``1 - b``, or 1 if that of order k + 1 is not used.
    """
    times = np.concatenate([[time], past[: order + 1]])
    weights = derivative_weights(times[: order + 1])
    if not blend or order not in BLENDED_GROWTH or len(times) < order + 2:
        return weights, 1.0
    if time - times[1] > BLENDED_GROWTH[order] * (times[1] - times[2]):
        return weights, 1.0
    higher = blend * derivative_weights(times)
    higher[:-1] += (1 - blend) * weights
    return higher, 1.0 - blend


#: Distance of a row's value from the polynomial, over the largest value of the table, above which
#: a step misses the row. It is below a third of this for gas forces of an engine in rows of two
#: degrees at the default tolerances.
MISSED = 0.01

#: Number of past points of this polynomial, which is cubic like the curves through tables.
POINTS = 3

#: Largest number of periods of a table in one step.
PERIODS = 10


@dataclass(frozen=True, eq=False)
class Curve(Described):
    """Function through the rows of a table, none of which a step may miss.

    Attributes
    ----------
    curve
        Piecewise polynomial whose breakpoints are the rows.
    periodic
        Whether the values recur. If not, values before the first row are those of the first row,
        and values after the last row those of the last row.
    scale
        Value by which differences of values are divided before they are compared with `MISSED`; 0
        for the largest absolute value of the rows.
    """

    curve: PPoly
    periodic: bool
    scale: float = 0.0

    @property
    def period(self) -> float:
        """Distance between the first and the last row [s] or [rad]."""
        return float(self.curve.x[-1] - self.curve.x[0])

    @property
    def variations(self) -> tuple[Variation, ...]:
        """Variation of a load that follows this curve, see `variations_of`."""
        if self.periodic:
            return (Variation(period=self.period, curve=self),)
        return (Variation(settled=self.settled, curve=self),)

    @property
    def settled(self) -> float:
        """Time [s] or angle [rad] from which a non-periodic curve is constant.

        It is 0 if the curve is constant everywhere.
        """
        moving = np.flatnonzero(self.curve.c[:-1].any(axis=0))
        return float(self.curve.x[moving[-1] + 1]) if len(moving) else 0.0

    def _inside(self, positions: Any) -> Any:
        """Shift times or angles into the range of the rows, without changing the curve's values."""
        first, last = self.curve.x[[0, -1]]
        if self.periodic:
            return first + (positions - first) % self.period
        return np.clip(positions, first, last)

    def values(self, positions: np.ndarray) -> np.ndarray:
        """Values of the curve at times [s] or angles [rad], in an array of the same shape."""
        return self.curve(self._inside(positions))

    @cached_property
    def largest(self) -> float:
        """Value, above 0, by which differences of the curve's values are divided, see `scale`."""
        largest = self.scale or float(np.abs(self.curve(self.curve.x)).max())
        return max(largest, float(np.finfo(float).tiny))

    def __call__(self, position: float) -> tuple[float, float]:
        """Value and derivative of the curve at a time or angle."""
        inside = self._inside(position)
        varies = self.periodic or inside == position
        return float(self.curve(inside)), float(self.curve(inside, 1)) if varies else 0.0

    def integral(self, position: float) -> float:
        """Integral of a non-periodic curve from zero to a time or angle."""
        first = self.curve.x[0]
        ends = [
            float(self.curve.integrate(first, self._inside(end)))
            + (end - self._inside(end)) * self(end)[0]
            for end in (0.0, position)
        ]
        return ends[1] - ends[0]

    def scaled(self, factor: float) -> Curve:
        """Return the curve multiplied by a factor."""
        from scipy.interpolate import PPoly

        curve = PPoly(factor * self.curve.c, self.curve.x)
        return Curve(curve, self.periodic, abs(factor) * self.scale)


@dataclass(frozen=True, eq=False)
class Variation(Described):
    """Variation of a force, drive or supply over time or over the angle of a body.

    Attributes
    ----------
    period
        Time [s] or angle [rad] after which the values recur; 0 if they do not recur.
    settled
        Time [s] or angle [rad] from which the values recur or are constant.
    angle_of
        Name of the body over whose angle the values vary; empty if they vary over time.
    curve
        Table whose rows no step may miss; None if the values are smooth.
    setting
        Key of the variation within the settings of the force, drive or supply; empty if none.
    """

    period: float = 0.0
    settled: float = 0.0
    angle_of: str = ""
    curve: Curve | None = None
    setting: str = ""


def variations_of(
    source: object, *, angle_of: str = "", setting: str = ""
) -> tuple[Variation, ...]:
    """Variations of a force, drive or table; empty for a plain function.

    Parameters
    ----------
    source
        Force, drive, table or function; only an object with an attribute `variations` has any.
    angle_of, setting
        Body over whose angle a table is given, and key of the table, see `Variation`.
    """
    stated: tuple[Variation, ...] = getattr(source, "variations", ())
    if angle_of or setting:
        return tuple(replace(each, angle_of=angle_of, setting=setting) for each in stated)
    return stated


@dataclass(frozen=True, eq=False)
class TabulatedLoad:
    """Load with a curve over time, or over an angle in the state of a mechanism.

    Attributes
    ----------
    curve
        Curve through the rows of a table.
    angle
        Index of the angle in the state; None for a curve over time.
    """

    curve: Curve
    angle: int | None = None

    def positions(self, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Times [s] or angles [rad] at which the curve is read at points of the integration.

        `times` and `states` are those of the points; the result has the shape (points,).
        """
        return times if self.angle is None else states[:, self.angle]

    def missed(self, times: np.ndarray, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows of the table within a step, and how far the step misses their values.

        The polynomial through the load's values at the points of the integration predicts values
        within the step.

        Parameters
        ----------
        times, states
            Times [s] and states of points of the integration, newest first: the end of the step,
            its start, and earlier points.

        Returns
        -------
        when, amount : numpy.ndarray
            Times of the rows strictly within the step [s], and difference of the rows' values from
            the predicted ones, over `Curve.largest`. If the step spans more than `PERIODS` periods
            or its end is not finite, they are the middle of the step and infinity.
        """
        positions = self.positions(times, states)
        end, start = positions[:2]
        curve = self.curve
        breakpoints = curve.curve.x
        period = curve.period
        if not abs(end - start) <= PERIODS * period:
            return 0.5 * (times[:1] + times[1:2]), np.array([np.inf])
        first, last = np.floor((np.sort(positions[:2]) - breakpoints[0]) / period)
        if curve.periodic:
            turns = period * np.arange(first, last + 1)
            rows = np.add.outer(turns, breakpoints[:-1]).ravel()
        else:
            rows = breakpoints
        within = rows[(rows - start) * (rows - end) < 0]
        when = times[1] + (within - start) / (end - start) * (times[0] - times[1])
        predicted = extrapolation_weights(times, when[:, None]).T @ curve.values(positions)
        return when, np.abs(predicted - curve.values(within)) / curve.largest


def rows_missed(
    loads: Sequence[TabulatedLoad], times: np.ndarray, states: np.ndarray, nearest: float
) -> tuple[np.ndarray, bool]:
    """Times of the rows of tables within a step, and whether the step misses one of the rows.

    The step misses a row if the polynomial through the load's values at the ends of past steps
    differs from the row's value.

    Parameters
    ----------
    loads
        Loads with tables.
    times, states
        Points of the integration, see `TabulatedLoad.missed`.
    nearest
        Distance from the start of the step within which rows belong to a jump, and do not count
        [s].

    Returns
    -------
    when : numpy.ndarray
        Times of the rows, ascending [s].
    missed : bool
        Whether the difference of a row's value from the polynomial, over the largest value of the
        table, exceeds `MISSED`.
    """
    parts = zip(*(load.missed(times, states) for load in loads), strict=True)
    when, amount = (np.concatenate(part) for part in parts)
    late = when > times[1] + nearest
    return np.sort(when[late]), bool((amount[late] > MISSED).any())
