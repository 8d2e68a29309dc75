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

import numpy as np

#: Largest slope towards an extreme over the slopes between the points at this side of it.
STEEPER = 1.5

#: Relative difference of heights, over the width, and of angles [rad], that is rounding.
EQUAL = 1e-9


def between_points(
    positions: np.ndarray, values: np.ndarray, period: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Largest values of curves between their points, and the positions where they are.

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
        Shape (k,); the values at the points themselves of fewer than three points, and where the
        largest one ends a curve that does not repeat.
    """
    count = len(positions)
    curves = np.arange(len(values))
    peak = np.argmax(values, axis=1)
    top = values[curves, peak]
    if count < 3:
        return top, positions[peak]
    points, padded = _padded(positions, values, period)
    # Two points at either side of the largest one; padding puts it two further on.
    near = peak[:, None] + np.arange(5)
    x = points[near]
    v = padded[curves[:, None], near]
    secants = np.diff(v, axis=1) / np.diff(x, axis=1)
    widths = np.diff(x, axis=1)
    # Slopes of parabolas through three points at the middle one of them.
    slopes = (secants[:, :-1] * widths[:, 1:] + secants[:, 1:] * widths[:, :-1]) / (
        widths[:, :-1] + widths[:, 1:]
    )
    # Interval that the curve rises into: it begins at 1 or 2 of the five points.
    begin = np.where(slopes[:, 1] > 0.0, 2, 1)
    width = widths[curves, begin]
    first = v[curves, begin]
    last = v[curves, begin + 1]
    rise, share = _highest(
        last - first,
        width * slopes[curves, begin - 1],
        width * slopes[curves, begin],
    )
    limit = np.minimum(
        first + STEEPER * width * _steepest(secants, curves, begin - 1, begin),
        last + STEEPER * width * _steepest(-secants, curves, begin, begin + 1),
    )
    largest = np.minimum(first + rise, limit)
    inside = largest > top
    if period is None:
        inside &= (peak > 0) & (peak < count - 1)
    where = np.where(inside, x[curves, begin] + share * width, x[:, 2])
    return np.where(inside, largest, top), where


def _steepest(
    secants: np.ndarray, curves: np.ndarray, one: np.ndarray, other: np.ndarray
) -> np.ndarray:
    """Larger of two slopes of every curve, at least 0, shape (k,)."""
    return np.maximum(np.maximum(secants[curves, one], secants[curves, other]), 0.0)


def _padded(
    positions: np.ndarray, values: np.ndarray, period: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and values with two points more at either end.

    Of curves that repeat these are points of the curve; beyond an end the parabola through the last
    three points continues, which gives the end the slope of that parabola.
    """
    if period is not None:
        before = np.arange(-2, 0)
        after = np.arange(2)
        points = [positions[before] - period, positions, positions[after] + period]
        padded = [values[:, before], values, values[:, after]]
        return np.concatenate(points), np.concatenate(padded, axis=1)
    start, early = _beyond(positions[2::-1], values[:, 2::-1])
    end, late = _beyond(positions[-3:], values[:, -3:])
    points = np.concatenate([start[::-1], positions, end])
    return points, np.concatenate([early[:, ::-1], values, late], axis=1)


def _beyond(positions: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two points beyond the last of three on the parabola through them."""
    a, b, c = positions
    beyond = c + (c - b) * np.arange(1, 3)
    weights = np.array(
        [
            (beyond - b) * (beyond - c) / ((a - b) * (a - c)),
            (beyond - a) * (beyond - c) / ((b - a) * (b - c)),
            (beyond - a) * (beyond - b) / ((c - a) * (c - b)),
        ]
    )
    return beyond, values @ weights


def _highest(
    change: np.ndarray, first: np.ndarray, last: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Largest value within the unit interval of cubics that begin at 0, and its position.

    Parameters
    ----------
    change, first, last
        Value at the end, slopes at the start and the end, shape (k,).
    """
    cubic = first + last - 2.0 * change
    square = 3.0 * change - 2.0 * first - last
    # first + 2 square s + 3 cubic s^2 = 0: the root that is a maximum.
    under = square**2 - 3.0 * cubic * first
    root = np.sqrt(np.maximum(under, 0.0))
    divisor = root - square
    usable = (under >= 0.0) & (divisor > 0.0)
    share = np.where(usable, first / np.where(usable, divisor, 1.0), 0.0)
    share = np.clip(share, 0.0, 1.0)
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
