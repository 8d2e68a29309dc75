"""Extremes between nodes and between steps: peak pressure, thinnest film, extremes of a cycle.

A film is solved at nodes, a run at steps, and the extreme of a smooth curve lies between them. The
largest of nodal values rises and falls as a peak passes from node to node, by more than meshes and
steps change it. One rule serves both directions of a film and the time: between two points the
curve is the cubic that has the values v and slopes v' of both,

    v'_i = slope at i of the parabola through i - 1, i, i + 1,

and the extreme is that of the cubic next to the largest point, on the side to which it rises. Curve
and slope are continuous, so that the extreme does not jump as it passes a point. At the edge of a
groove, or of a step in a surface, a cubic overshoots: towards the extreme the curve is at most
`STEEPER` times as steep as between the points at this side. A pressure that is level in a groove
has no higher maximum.

On a film the rule is applied to every row of nodes around, then to the extremes of these rows along
the width: ``max_z max_phi p(phi, z)``. Errors of this and other rules: `docs/measurements.md`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

#: Largest slope towards an extreme over the slopes between the points at this side of it.
STEEPER = 1.5

#: Relative difference of heights, over the width, and of angles [rad], that is rounding.
EQUAL = 1e-9


def between_points(
    positions: np.ndarray, values: np.ndarray, period: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Largest values of curves between their points, and the positions of these values.

    Parameters
    ----------
    positions
        Ascending positions of the points, shape (n,).
    values
        Values of k curves at the points, shape (k, n).
    period
        Length after which the curves repeat; None: they end at the first and the last point.

    Returns
    -------
    largest, where
        Shape (k,). A curve has its largest value at a point if it has fewer than three points, or
        if it does not repeat and the largest point is one of its ends.
    """
    peaks = np.argmax(values, axis=1)
    points = positions.tolist()
    # A step evaluates few curves: plain numbers take a fifth of the time of arrays of five.
    curves = _neighbours(values, peaks)
    largest = np.empty(len(values))
    where = np.empty(len(values))
    for number, (peak, around) in enumerate(zip(peaks.tolist(), curves, strict=True)):
        largest[number], where[number] = _peak(points, peak, around, period)
    return largest, where


#: Points before and after the largest one that decide on an extreme.
REACH = 2


def _neighbours(values: np.ndarray, peaks: np.ndarray) -> list[list[float]]:
    """Values of every curve at its largest point and two points before and after it."""
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
        At this point and two before and after it, in turn around the ends.
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
    # Beyond an end the parabola through the last three points continues.
    if peak - REACH < 0:
        x[0], v[0] = _beyond(x[3:0:-1], v[3:0:-1])
    if peak + REACH >= count:
        x[-1], v[-1] = _beyond(x[1:-1], v[1:-1])
    return _between(x, v)


def _beyond(x: list[float], v: list[float]) -> tuple[float, float]:
    """Point beyond the last of three on the parabola through them, as far as those before."""
    a, b, c = x
    beyond = c + (c - b)
    value = (
        v[0] * ((beyond - b) * (beyond - c) / ((a - b) * (a - c)))
        + v[1] * ((beyond - a) * (beyond - c) / ((b - a) * (b - c)))
        + v[2] * ((beyond - a) * (beyond - b) / ((c - a) * (c - b)))
    )
    return beyond, value


def _between(x: list[float], v: list[float]) -> tuple[float, float]:
    """Largest value near the middle one of five points, which is the largest, and its position."""
    widths = [x[i + 1] - x[i] for i in range(4)]
    secants = [(v[i + 1] - v[i]) / widths[i] for i in range(4)]
    # Slope of the parabola through three points at the middle one of them.
    slopes = [
        (secants[i] * widths[i + 1] + secants[i + 1] * widths[i]) / (widths[i] + widths[i + 1])
        for i in range(3)
    ]
    # The curve rises into the interval that begins at this one of the five points.
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
    """Largest value within the unit interval of a cubic that begins at 0, and its position.

    Parameters
    ----------
    change, first, last
        Value at the end, slopes at the start and the end.
    """
    cubic = first + last - 2.0 * change
    square = 3.0 * change - 2.0 * first - last
    # first + 2 square s + 3 cubic s^2 = 0: the root that is a maximum.
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
    """Extreme of a curve between its steps, and its time.

    Parameters
    ----------
    times, values
        At the steps, shape (steps,).
    period
        Of a cycle whose last step is its start; None: the curve does not repeat.
    sign
        1 for the maximum, -1 for the minimum.
    """
    largest, where = between_points(times, sign * values[None], period)
    return float(sign * largest[0]), float(where[0])


@dataclass(frozen=True, eq=False)
class FilmRows:
    """Nodes of a film in rows around: each row has all angles, from the lower side upwards.

    Of 8-node cells rows through the middles of cells, which have every other angle, are left out.

    Attributes
    ----------
    nodes
        Indices of the nodes of every row by ascending angle, shape (rows, n).
    angles
        Of the nodes of a row, shape (n,) [rad].
    heights
        Of the rows, shape (rows,) [m].
    """

    nodes: np.ndarray
    angles: np.ndarray
    heights: np.ndarray

    @classmethod
    def of(cls, angle: np.ndarray, height: np.ndarray) -> FilmRows:
        """Rows of points at angles [rad] and heights [m], shape (k,)."""
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
        """Largest values between the nodes, and their positions.

        Parameters
        ----------
        values
            At all points of the film at k instants, shape (k, points).

        Returns
        -------
        largest, angle, height
            Shape (k,); of values, [rad], [m].
        """
        each = np.asarray(values)[:, self.nodes]
        k, rows, n = each.shape
        around, angles = between_points(self.angles, each.reshape(k * rows, n), 2 * np.pi)
        around = around.reshape(k, rows)
        largest, height = between_points(self.heights, around)
        # The angle at which the row nearest to the extreme has its own.
        row = np.argmax(around, axis=1)
        return largest, angles.reshape(k, rows)[np.arange(k), row], height

    def film_extremes(self, pressure: np.ndarray, gap: np.ndarray) -> np.ndarray:
        """Peak pressures and thinnest films at k instants, shape (2, k) [Pa], [m].

        Parameters
        ----------
        pressure, gap
            Shape (k, points) [Pa], [m].
        """
        return np.array([self.largest(pressure)[0], -self.largest(-np.asarray(gap))[0]])
