"""The lower left hull of points: what no other point beats in both coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

T = TypeVar("T")


def lower_left(points: Sequence[tuple[float, float, T]]) -> list[tuple[float, float, T]]:
    """Points that no other point reaches with less of one coordinate and no more of the other.

    Parameters
    ----------
    points
        Coordinates x and y, both the smaller the better, and what they stand for.

    Returns
    -------
    list
        Such points by ascending x, so by descending y.
    """
    hull: list[tuple[float, float, T]] = []
    for point in sorted(points, key=lambda p: (p[0], p[1])):
        if not hull or point[1] < hull[-1][1]:
            hull.append(point)
    return hull
