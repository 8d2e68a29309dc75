"""Largest and least values over a film between the places where they are known.

The largest of nodal values jumps from node to node as it moves around the bore: over time, and
along any number of the mechanism, it is a saw-tooth, whose teeth have the height of the squared
distance of nodes and slopes that are wrong by the distance itself. The parabola through the
extreme place and its neighbours of equal height has neither.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.multibody.cycle_figures import extreme_weights
from fenics_ehd.multibody.system import FilmPlace

#: Decimals to which heights of one row are equal, over the width, and turns of one place.
EQUAL = 9

#: Relative difference of values of which either may be the extreme.
LEVEL = 1e-9


@dataclass(frozen=True, eq=False)
class Stencil:
    """An extreme as a weighted sum of values at some places."""

    places: np.ndarray
    weights: np.ndarray

    def of(self, values: np.ndarray) -> float:
        """The extreme of other values, as if it were at the same place."""
        return float(self.weights @ values[self.places])


@dataclass(frozen=True, eq=False)
class FilmStencils:
    """Of one film: largest pressure, thinnest gap, and largest pressure of contact."""

    pressure: Stencil
    gap: Stencil
    contact: Stencil | None


class Rows:
    """Places around a film, in rows of one height.

    Parameters
    ----------
    angle, height
        Of the places, shape (k,) [rad], [m].
    width
        Of the film [m].
    """

    def __init__(self, angle: np.ndarray, height: np.ndarray, width: float):
        self._turn = np.round(angle / (2 * np.pi), EQUAL) % 1.0
        self._row, size = np.unique(
            np.round(height / width, EQUAL), return_inverse=True, return_counts=True
        )[1:]
        self._size = size[self._row]

    def extreme(self, values: np.ndarray, sign: int) -> Stencil:
        """Largest of ``sign * values``, shape (k,); of equal ones that of the finest row."""
        largest = (sign * values).max()
        equal = sign * values >= largest - LEVEL * abs(largest)
        row = np.flatnonzero(self._row == self._row[np.argmax(equal * self._size)])
        row = row[np.argsort(self._turn[row])]
        weights = extreme_weights(self._turn[row], values[row], 1.0, sign)[0]
        used = np.flatnonzero(weights)
        return Stencil(row[used], weights[used])


class FilmRows:
    """Nodes and Gauss points of a film, for those of its columns that are extremes."""

    def __init__(self, place: FilmPlace):
        film = place.film.film
        grid, points = film.parameters.grid, film.points
        angles, heights = grid.node_positions.T
        self._nodes = Rows(angles, heights, grid.width)
        self._points = Rows(points.angle.ravel(), points.height.ravel(), grid.width)
        self._count = points.angle.size

    def stencils(
        self, pressure: np.ndarray, gap: np.ndarray, contact: np.ndarray | None
    ) -> FilmStencils:
        """Of nodal pressures, the gap where it is observed, contact pressures at Gauss points.

        Gaps are taken at the nodes: with the Gauss points between them rows are uneven, and where
        the gap is the same over the width, the extreme would jump from one to another.
        """
        thin = self._nodes.extreme(gap[self._count :], -1)
        return FilmStencils(
            self._nodes.extreme(pressure, 1),
            Stencil(self._count + thin.places, thin.weights),
            None if contact is None else self._points.extreme(contact, 1),
        )
