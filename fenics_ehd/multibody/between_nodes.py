"""Largest and least values of a film between its nodes.

The largest of nodal values goes up and down as a film's peak passes from node to node, by a few
per mille: what meshes and steps change is less. The vertex of the parabolas through the largest
one and its neighbours, around and along, does not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_ehd.film import FilmGrid

#: Angles and shares of the width that differ by less are equal.
EQUAL = 1e-9


class BetweenNodes:
    """Of the films on one mesh.

    Parameters
    ----------
    grid
        The mesh.
    """

    def __init__(self, grid: FilmGrid):
        angle, height = grid.node_positions.T
        around, self._across = _neighbours(angle, height / grid.width)
        along, self._up = _neighbours(height / grid.width, angle, closed=False)
        self._around, self._along = around, along

    def largest(self, values: np.ndarray) -> np.ndarray:
        """Of nodal values of every instant, shape (k, n)."""
        rows, node = np.arange(len(values)), np.argmax(values, axis=1)
        top = values[rows, node]
        found = top.copy()
        for others, places in ((self._around, self._across), (self._along, self._up)):
            lower = values[rows[:, None], others[node]] - top[:, None]
            found += _rise(places[node], lower)
        return found

    def least(self, values: np.ndarray) -> np.ndarray:
        """Of nodal values of every instant, shape (k, n)."""
        return -self.largest(-values)


def extremes(
    between: Sequence[BetweenNodes], pressures: Sequence[np.ndarray], gaps: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Largest pressure and least gap of every film, shape (k, films), of nodal ones (k, n) each."""
    return (
        np.column_stack([own.largest(p) for own, p in zip(between, pressures, strict=True)]),
        np.column_stack([own.least(gap) for own, gap in zip(between, gaps, strict=True)]),
    )


def _neighbours(
    place: np.ndarray, row: np.ndarray, closed: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the nodes before and after each in its row, and how far they are.

    A row is once around if it is closed, else it ends: the nodes there have none, distance 0.
    """
    number = np.lexsort((place, np.round(row / EQUAL)))
    others, far = np.empty((len(place), 2), dtype=int), np.zeros((len(place), 2))
    ends = np.flatnonzero(np.diff(row[number]) > EQUAL) + 1
    for own in np.split(number, ends):
        for k, shift in enumerate((1, -1)):
            others[own, k] = np.roll(own, shift)
            far[own, k] = place[others[own, k]] - place[own]
        first, last = own[0], own[-1]
        far[first, 0], far[last, 1] = (
            (far[first, 0] - 2 * np.pi, far[last, 1] + 2 * np.pi) if closed else (0.0, 0.0)
        )
    return others, far


def _rise(place: np.ndarray, value: np.ndarray) -> np.ndarray:
    """How far parabolas through 0 and two lower values, at either side, rise above 0.

    Shapes (k, 2); 0 at the end of a row.
    """
    inside = (place[:, 0] < 0.0) & (place[:, 1] > 0.0)
    place = np.where(inside[:, None], place, [-1.0, 1.0])
    slopes = value / place
    # a s + b s^2 through both.
    bend = (slopes[:, 1] - slopes[:, 0]) / (place[:, 1] - place[:, 0])
    slope = slopes[:, 0] - bend * place[:, 0]
    inside &= bend < 0.0
    return np.where(inside, -(slope**2) / (4.0 * np.where(inside, bend, -1.0)), 0.0)
