"""Differentiation over points in time, and tables that no step may jump over.

With ``D_k`` the derivative of the polynomial through the newest and the last k points, rates are

    x' = (1 - b) D_k x + b D_(k+1) x.

For k = 2 and b = 1/2 this is the numerical differentiation formula of Klopfenstein, also known
as BDF2-OPT: like BDF2 it is A-stable at constant steps and damps the high-frequency static modes,
which carry no dynamics, with half the error (Shampine and Reichelt, SIAM J. Sci. Comput. 1997;
Vatsa, Carpenter and Lockard 2010). For k = 3 it is A(82)-stable, BDF3 A(86).

Nobody asks for a load between two steps: the rows of a table that lie there count only as far as
the values at the steps foretell them. An estimate of the solution's error cannot tell, as a
solution that never met a load is as smooth as one without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from scipy.interpolate import PPoly


#: The formula of order k + 1 is left out while steps grow faster than it is zero-stable for.
BLENDED_GROWTH = {2: 1.55, 3: 1.25}


def derivative_weights(times: np.ndarray) -> np.ndarray:
    """Weights of the derivative, at the first time, of the polynomial through all times."""
    distance, share = times[0] - times[1:], 1.0 / _products(times[:, None] - times)
    weights = np.empty(len(times))
    weights[0] = np.sum(1.0 / distance)
    weights[1:] = share[1:] / (share[0] * distance)
    return weights


def extrapolation_weights(times: np.ndarray, target: float | np.ndarray) -> np.ndarray:
    """Weights of the value at `target` of the polynomial through all points.

    shape (n,), or (n, k) for targets of shape (k, 1).
    """
    ahead = (target - times)[..., None, :]
    return (_products(ahead) / _products(times[:, None] - times)).T


def _products(factors: np.ndarray) -> np.ndarray:
    """Products of every row, its diagonal left out; one row stands for all."""
    return np.prod(np.where(np.eye(factors.shape[-1]), 1.0, factors), axis=-1)


def blended(time: float, past: np.ndarray, order: int, blend: float) -> tuple[np.ndarray, float]:
    """Weights of the derivative at a new point, that point first, and the share of order k.

    Parameters
    ----------
    time, past
        The new point and those before it, newest first [s].
    order
        k, at most the number of past points.
    blend
        b, for k > 1 and where there are points enough.
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


#: A row is missed if its value is further than this, of the largest one, from the polynomial. The
#: gas of an engine in rows of two degrees stays below a third of it at the default tolerances.
MISSED = 0.01

#: Past points of the polynomial, which is cubic as the curves through tables are.
POINTS = 3

#: A step over more than so many periods is no step that a table allows.
PERIODS = 10


@dataclass(frozen=True, eq=False)
class Curve:
    """A function through rows, which no step of an integration may jump over.

    Attributes
    ----------
    curve
        Piecewise polynomial whose breakpoints are the rows.
    periodic
        Whether it repeats itself; if not, its values at both ends stay.
    scale
        What counts as large; 0: the largest value.
    """

    curve: PPoly
    periodic: bool
    scale: float = 0.0

    @property
    def period(self) -> float:
        """From the first row to the last."""
        return float(self.curve.x[-1] - self.curve.x[0])

    @property
    def variations(self) -> tuple[Variation, ...]:
        """Variation of a curve that is read at the time, see `variations_of`."""
        if self.periodic:
            return (Variation(period=self.period, curve=self),)
        return (Variation(settled=self.settled, curve=self),)

    @property
    def settled(self) -> float:
        """Position from which a curve that is not periodic is constant; 0 if it always is."""
        moving = np.flatnonzero(self.curve.c[:-1].any(axis=0))
        return float(self.curve.x[moving[-1] + 1]) if len(moving) else 0.0

    def _inside(self, places: Any) -> Any:
        """Places between the first row and the last that stand for any, of numbers or arrays."""
        first, last = self.curve.x[[0, -1]]
        if self.periodic:
            return first + (places - first) % self.period
        return np.clip(places, first, last)

    def values(self, places: np.ndarray) -> np.ndarray:
        """Values at many places."""
        return self.curve(self._inside(places))

    @cached_property
    def largest(self) -> float:
        """Size of a value that counts as large."""
        largest = self.scale or float(np.abs(self.curve(self.curve.x)).max())
        return max(largest, float(np.finfo(float).tiny))

    def __call__(self, place: float) -> tuple[float, float]:
        """Value and derivative."""
        inside = self._inside(place)
        moves = self.periodic or inside == place
        return float(self.curve(inside)), float(self.curve(inside, 1)) if moves else 0.0

    def integral(self, place: float) -> float:
        """From place zero, of a curve that is not periodic."""
        first = self.curve.x[0]
        ends = [
            float(self.curve.integrate(first, self._inside(at)))
            + (at - self._inside(at)) * self(at)[0]
            for at in (0.0, place)
        ]
        return ends[1] - ends[0]

    def scaled(self, factor: float) -> Curve:
        """The same times a factor."""
        from scipy.interpolate import PPoly

        curve = PPoly(factor * self.curve.c, self.curve.x)
        return Curve(curve, self.periodic, abs(factor) * self.scale)


@dataclass(frozen=True, eq=False)
class Variation:
    """How a force, drive or supply varies over the time or over the angle of a body.

    Attributes
    ----------
    period
        Time [s] or angle [rad] after which the values recur; 0: the values do not recur.
    settled
        Time from which the values recur or stay constant [s], or such an angle [rad].
    angle_of
        Body whose angle the values are over; empty: the values are over the time.
    curve
        Table whose rows no step may cross; None: the values are smooth.
    setting
        Key below that of the force, drive or supply that states the variation; empty: none.
    """

    period: float = 0.0
    settled: float = 0.0
    angle_of: str = ""
    curve: Curve | None = None
    setting: str = ""


def variations_of(
    source: object, *, angle_of: str = "", setting: str = ""
) -> tuple[Variation, ...]:
    """Variations that a force, drive or table states; a plain function states none.

    Parameters
    ----------
    source
        Object whose attribute `variations` is read.
    angle_of, setting
        Body whose angle a table is read at, and the key of the table, see `Variation`.
    """
    stated: tuple[Variation, ...] = getattr(source, "variations", ())
    if angle_of or setting:
        return tuple(replace(each, angle_of=angle_of, setting=setting) for each in stated)
    return stated


@dataclass(frozen=True, eq=False)
class TabulatedLoad:
    """A curve over the time, or over an angle that the state of a mechanism knows.

    Attributes
    ----------
    curve
        Of rows.
    angle
        Place of the angle in the state; None: it is read at the time [s].
    """

    curve: Curve
    angle: int | None = None

    def places(self, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Places of the curve that points of the integration are at."""
        return times if self.angle is None else states[:, self.angle]

    def missed(self, times: np.ndarray, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """By how much a step misses the rows within it.

        Parameters
        ----------
        times, states
            Points of the integration, newest first: the end of the step, its beginning, and those
            before [s].

        Returns
        -------
        when, amount : numpy.ndarray
            Times of the rows strictly within the step [s], and how far their values lie from the
            polynomial through those at the points, over the largest of the table. Half the step
            and infinity, if it leads across more than `PERIODS` or to no place at all.
        """
        places = self.places(times, states)
        end, start = places[:2]
        curve, places_of_rows = self.curve, self.curve.curve.x
        period = curve.period
        if not abs(end - start) <= PERIODS * period:
            return 0.5 * (times[:1] + times[1:2]), np.array([np.inf])
        first, last = np.floor((np.sort(places[:2]) - places_of_rows[0]) / period)
        if curve.periodic:
            turns = period * np.arange(first, last + 1)
            rows = np.add.outer(turns, places_of_rows[:-1]).ravel()
        else:
            rows = places_of_rows
        within = rows[(rows - start) * (rows - end) < 0]
        when = times[1] + (within - start) / (end - start) * (times[0] - times[1])
        foretold = extrapolation_weights(times, when[:, None]).T @ curve.values(places)
        return when, np.abs(foretold - curve.values(within)) / curve.largest


def rows_missed(
    loads: Sequence[TabulatedLoad], times: np.ndarray, states: np.ndarray, nearest: float
) -> tuple[np.ndarray, bool]:
    """Rows within a step, and whether it misses one of them.

    Parameters
    ----------
    loads, times, states
        See `TabulatedLoad.missed`.
    nearest
        Rows nearer than this to the beginning of the step belong to a jump and are left out [s].

    Returns
    -------
    when : numpy.ndarray
        Ascending [s].
    missed : bool
    """
    found = [load.missed(times, states) for load in loads]
    when, amount = (np.concatenate(parts) for parts in zip(*found, strict=True))
    late = when > times[1] + nearest
    return np.sort(when[late]), bool((amount[late] > MISSED).any())
