"""Extremes between nodes and between steps: peak pressure, thinnest film, extremes of a cycle.

A film is solved at nodes and a run at steps, but the extreme of a smooth curve lies between them.
While a peak moves from node to node, the largest nodal value varies by more than the error due to
mesh and steps. Peaks are therefore interpolated, by one rule for both directions of a film and for
time. Between two points, the curve is the cubic with the values v and the slopes v' at both points:

    v'_i = slope at i of the parabola through i - 1, i, i + 1.

The extreme is that of the cubic next to the largest point, on the side to which the curve rises.
Curve and slope are continuous, so that the extreme does not jump when it passes a point. At the
edge of a groove, or at a step in a surface, a cubic overshoots. The slope towards the extreme is
therefore limited to `STEEPER` times the largest slope between points on that side. The maximum of a
constant pressure in a groove is thus this pressure itself.

On a film the rule is applied to every row of nodes around the bore, then across the width to the
extremes of these rows: ``max_z max_phi p(phi, z)``. `docs/measurements.md` compares the errors of
this rule and of others.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

#: Largest slope towards an extreme, relative to the slopes between points on that side of it.
STEEPER = 1.5

#: Largest round-off in the positions of nodes: in heights over the width, and in angles [rad].
EQUAL = 1e-9


def between_points(
    positions: np.ndarray, values: np.ndarray, period: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Largest values of interpolated curves, and the positions of these values.

    In two cases a curve is not interpolated, and the result is its largest value at a point: if
    there are fewer than three points, and if the first or last point of a curve that does not
    repeat is the largest.

    Parameters
    ----------
    positions
        Positions of the points in ascending order, shape (n,).
    values
        Values of k curves at the points, shape (k, n).
    period
        Length after which the curves repeat; None if they end at the first and the last point.

    Returns
    -------
    largest, where
        Largest value of each curve, and its position, both of shape (k,).
    """
    peaks = np.argmax(values, axis=1)
    points = positions.tolist()
    # A step evaluates few curves: Python numbers take a fifth of the time of arrays of length 5.
    curves = _neighbours(values, peaks)
    largest = np.empty(len(values))
    where = np.empty(len(values))
    for number, (peak, around) in enumerate(zip(peaks.tolist(), curves, strict=True)):
        largest[number], where[number] = _peak(points, peak, around, period)
    return largest, where


#: Number of points before the largest one, and after it, on which the extreme depends.
REACH = 2


def _neighbours(values: np.ndarray, peaks: np.ndarray) -> list[list[float]]:
    """Values of every curve at its largest point, two points before it and two after it."""
    near = (peaks[:, None] + np.arange(-REACH, REACH + 1)) % values.shape[1]
    neighbours: list[list[float]] = np.take_along_axis(values, near, axis=1).tolist()
    return neighbours


def _peak(
    points: list[float], peak: int, values: list[float], period: float | None
) -> tuple[float, float]:
    """Largest value of one curve and its position.

    Parameters
    ----------
    points
        Positions of all points.
    peak
        Index of the point with the largest value.
    values
        Values at five points, from two before to two after this point; beyond an end of the
        array, they continue at its other end.
    period
        See `between_points`.
    """
    count = len(points)
    top = values[REACH]
    if count <= REACH or (period is None and peak in (0, count - 1)):
        return top, points[peak]
    if period is not None:
        indices = range(peak - REACH, peak + REACH + 1)
        x = [points[index % count] + period * (index // count) for index in indices]
        return _between(x, values)
    x = [points[index % count] for index in range(peak - REACH, peak + REACH + 1)]
    v = list(values)
    # A point beyond an end is on the parabola through the last three points.
    if peak - REACH < 0:
        x[0], v[0] = _beyond(x[3:0:-1], v[3:0:-1])
    if peak + REACH >= count:
        x[-1], v[-1] = _beyond(x[1:-1], v[1:-1])
    return _between(x, v)


def _beyond(x: list[float], v: list[float]) -> tuple[float, float]:
    """Extrapolate the parabola through three points by one point; return its position and value.

    The new point is as far from the third point as the third from the second.
    """
    a, b, c = x
    beyond = c + (c - b)
    value = (
        v[0] * ((beyond - b) * (beyond - c) / ((a - b) * (a - c)))
        + v[1] * ((beyond - a) * (beyond - c) / ((b - a) * (b - c)))
        + v[2] * ((beyond - a) * (beyond - b) / ((c - a) * (c - b)))
    )
    return beyond, value


def _between(x: list[float], v: list[float]) -> tuple[float, float]:
    """Largest value of a curve through five points, the third of them largest, and its position.

    Parameters
    ----------
    x, v
        Positions of the points, and values of the curve there.
    """
    widths = [x[i + 1] - x[i] for i in range(4)]
    secants = [(v[i + 1] - v[i]) / widths[i] for i in range(4)]
    # Slopes at the three middle points, each of the parabola through the point and its neighbours.
    slopes = [
        (secants[i] * widths[i + 1] + secants[i + 1] * widths[i]) / (widths[i] + widths[i + 1])
        for i in range(3)
    ]
    # Number of the point at the begin of the interval into which the curve rises.
    begin = REACH if slopes[1] > 0.0 else REACH - 1
    width = widths[begin]
    rise, share = _highest(
        v[begin + 1] - v[begin], width * slopes[begin - 1], width * slopes[begin]
    )
    before = max(secants[begin - 1], secants[begin], 0.0)
    after = max(-secants[begin], -secants[begin + 1], 0.0)
    limit = min(v[begin] + STEEPER * width * before, v[begin + 1] + STEEPER * width * after)
    largest = min(v[begin] + rise, limit)
    if largest > v[REACH]:
        return largest, x[begin] + share * width
    return v[REACH], x[REACH]


def _highest(change: float, first: float, last: float) -> tuple[float, float]:
    """Largest value, and its position, of a cubic on the interval from 0 to 1.

    Parameters
    ----------
    change, first, last
        Value of the cubic at 1, and its slopes at 0 and 1; its value at 0 is 0.
    """
    cubic = first + last - 2.0 * change
    square = 3.0 * change - 2.0 * first - last
    # The maximum is at one of the roots of first + 2 square s + 3 cubic s^2 = 0.
    discriminant = square * square - 3.0 * cubic * first
    share = 0.0
    if discriminant >= 0.0:
        divisor = sqrt(discriminant) - square
        if divisor > 0.0:
            share = min(max(first / divisor, 0.0), 1.0)
    return share * (first + share * (square + share * cubic)), share


def over_time(
    times: np.ndarray, values: np.ndarray, period: float | None, sign: int = 1
) -> tuple[float, float]:
    """Extreme of a quantity over a run, interpolated between steps, and the time of the extreme.

    Parameters
    ----------
    times, values
        Time and value at every step, shape (steps,).
    period
        Length of the cycle, of which `times` has the end but not the start; None if the curve
        does not repeat.
    sign
        1 for the maximum, -1 for the minimum.
    """
    largest, where = between_points(times, sign * values[None], period)
    return float(sign * largest[0]), float(where[0])


@dataclass(frozen=True, eq=False)
class FilmRows:
    """Nodes of a film in rows around the bore, from the lower side upwards.

    All rows have the same angles. Rows through the middles of 8-node cells, which have only every
    other angle, are omitted.

    Attributes
    ----------
    nodes
        Indices of the nodes of every row by ascending angle, shape (rows, n).
    angles
        Angles of the nodes of every row, shape (n,) [rad].
    heights
        Height of every row, shape (rows,) [m].
    """

    nodes: np.ndarray
    angles: np.ndarray
    heights: np.ndarray

    @classmethod
    def of(cls, angle: np.ndarray, height: np.ndarray) -> FilmRows:
        """Arrange points in rows, from their angles [rad] and heights [m], shape (points,)."""
        angle = np.asarray(angle)
        height = np.asarray(height)
        turn = np.mod(angle, 2 * np.pi)
        turn = np.where(turn > 2 * np.pi - EQUAL, 0.0, turn)
        level = np.round(height / (np.ptp(height) * EQUAL))
        order = np.lexsort((turn, level))
        ends = np.flatnonzero(np.diff(level[order])) + 1
        rows = np.split(order, ends)
        longest = max(len(row) for row in rows)
        nodes = np.array([row for row in rows if len(row) == longest])
        return cls(nodes, turn[nodes[0]], height[nodes[:, 0]])

    def largest(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Largest values of a field, interpolated between nodes of the film, and their positions.

        Parameters
        ----------
        values
            Values of the field at all points of the film for k instants, shape (k, points).

        Returns
        -------
        largest, angle, height
            Largest value, its angle [rad] and its height [m] at each instant, shape (k,).
        """
        each = np.asarray(values)[:, self.nodes]
        k, rows, n = each.shape
        around, angles = between_points(self.angles, each.reshape(k * rows, n), 2 * np.pi)
        around = around.reshape(k, rows)
        largest, height = between_points(self.heights, around)
        # The angle is that of the extreme in the row with the largest value.
        row = np.argmax(around, axis=1)
        return largest, angles.reshape(k, rows)[np.arange(k), row], height

    def film_extremes(self, pressure: np.ndarray, gap: np.ndarray) -> np.ndarray:
        """Peak pressures [Pa] and smallest film thicknesses [m] at k instants, shape (2, k).

        Parameters
        ----------
        pressure, gap
            Pressure [Pa] and film thickness [m] at all points of the film, shape (k, points).
        """
        return np.array([self.largest(pressure)[0], -self.largest(-np.asarray(gap))[0]])
