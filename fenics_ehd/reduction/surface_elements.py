"""Shape functions and Gauss rules of surface cells, in numpy alone.

The nodes of a cell come in the package's order: corners, edge midpoints, centre,
each group as dolfinx numbers it. In the reference coordinates (s, t),

    quadrilateral  corners (0,0) (1,0) (0,1) (1,1)      2 - 7 - 3
                   edges   (.5,0) (0,.5) (1,.5) (.5,1)  5   8   6
                   centre  (.5,.5)                      0 - 4 - 1

    triangle       corners (0,0) (1,0) (0,1)            2
                   edges   (.5,.5) (0,.5) (.5,0)        4   3
                                                        0 - 5 - 1

Most programs number corners and edges *around* the cell instead; `package_order` finds
the order in the geometry.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fenics_ehd.base.errors import StructureError

_QUADRILATERAL = [
    (0, 0),
    (1, 0),
    (0, 1),
    (1, 1),
    (0.5, 0),
    (0, 0.5),
    (1, 0.5),
    (0.5, 1),
    (0.5, 0.5),
]
_TRIANGLE = [(0, 0), (1, 0), (0, 1), (0.5, 0.5), (0, 0.5), (0.5, 0)]

#: Edges of a cell with n corners: their ends.
_EDGES = {4: [(0, 1), (0, 2), (1, 3), (2, 3)], 3: [(1, 2), (0, 2), (0, 1)]}

#: Orders of four corners that differ in which are opposite, the first and the last here: ours,
#: that around the cell, the third.
_OPPOSITE = ((0, 1, 2, 3), (0, 1, 3, 2), (0, 2, 3, 1))

#: Relative difference below which the order given is kept.
_TIE = 1e-6


@dataclass(frozen=True, eq=False)
class SurfaceElement:
    """Nodal element on a quadrilateral or triangle.

    Attributes
    ----------
    nodes
        Reference nodes, shape (k, 2).
    exponents
        Monomials ``s^a t^b`` that the shape functions span, shape (k, 2).
    corners
        4 or 3.
    """

    nodes: np.ndarray
    exponents: np.ndarray
    corners: int

    @property
    def degree(self) -> int:
        """Total polynomial degree."""
        return int(self.exponents.sum(axis=1).max())

    @property
    def edges(self) -> np.ndarray:
        """Corners at the ends of each edge, shape (edges, 2)."""
        return np.array(_EDGES[self.corners])

    def rule(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Points, shape (q, 2), and weights, shape (q,), of a rule on the reference cell.

        `count` Gauss points a direction: exact to degree ``2 count - 1`` in each
        variable on the quadrilateral, ``2 count - 2`` in both together on the triangle.
        """
        x, w = np.polynomial.legendre.leggauss(count)
        x, w = 0.5 * (x + 1), 0.5 * w
        s, t = (a.ravel() for a in np.meshgrid(x, x, indexing="ij"))
        weights = np.outer(w, w).ravel()
        if self.corners == 3:
            # The square with one side collapsed to a point.
            s, weights = s * (1 - t), weights * (1 - t)
        return np.column_stack([s, t]), weights

    def tabulate(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Shape functions and their derivatives.

        Parameters
        ----------
        points
            Reference points, shape (q, 2).

        Returns
        -------
        values : numpy.ndarray
            shape (q, k).
        derivatives : numpy.ndarray
            With respect to s and t, shape (2, q, k).
        """
        derivatives = [self._monomials(points, direction) @ self._nodal for direction in (0, 1)]
        return self.shapes(points), np.array(derivatives)

    def shapes(self, points: np.ndarray) -> np.ndarray:
        """Shape functions at reference points (q, 2), shape (q, k)."""
        return self._monomials(points) @ self._nodal

    @cached_property
    def _nodal(self) -> np.ndarray:
        """Shape functions by their monomials, shape (k, k)."""
        return np.linalg.inv(self._monomials(self.nodes))

    def _monomials(self, points: np.ndarray, direction: int | None = None) -> np.ndarray:
        """Monomials at points, or their derivatives, shape (q, k)."""
        exponents = self.exponents.copy()
        factor = np.ones(len(exponents))
        if direction is not None:
            factor = exponents[:, direction].astype(float)
            exponents[:, direction] = np.maximum(exponents[:, direction] - 1, 0)
        return factor * np.prod(np.asarray(points)[:, None, :] ** exponents, axis=2)


def _element(reference: list, size: int, degree: int, largest: int) -> SurfaceElement:
    """First `size` of the nodes, monomials of at most `degree` each and `largest` together."""
    exponents = [e for e in itertools.product(range(degree + 1), repeat=2) if sum(e) <= largest]
    return SurfaceElement(
        np.array(reference[:size], dtype=float),
        np.array(exponents),
        4 if reference is _QUADRILATERAL else 3,
    )


#: By name: 4, 8 and 9 nodes on the quadrilateral, 3 and 6 on the triangle.
ELEMENTS = {
    "bilinear": _element(_QUADRILATERAL, 4, 1, 2),
    "serendipity": _element(_QUADRILATERAL, 8, 2, 3),
    "lagrange": _element(_QUADRILATERAL, 9, 2, 4),
    "linear triangle": _element(_TRIANGLE, 3, 1, 1),
    "triangle": _element(_TRIANGLE, 6, 2, 2),
}


def surface_element(name: str, cells: np.ndarray) -> SurfaceElement:
    """The element of a name, for cells of shape (c, k).

    Raises
    ------
    StructureError
        There is no such element, or its cells have another number of nodes.
    """
    if name not in ELEMENTS:
        raise StructureError(f"element {name!r} is not one of {', '.join(ELEMENTS)}")
    size = len(ELEMENTS[name].nodes)
    if cells.ndim != 2 or cells.shape[1] != size or not len(cells):
        raise StructureError(f"faces of shape {cells.shape}, {name} needs (faces, {size})")
    return ELEMENTS[name]


def package_order(positions: np.ndarray, faces: np.ndarray, element: str) -> np.ndarray:
    """Faces numbered in any order, in that of this package.

    The order is found in the geometry, face by face. Opposite corners: of the three ways to pair
    four corners, that of the diagonals is the longest, as in a convex quadrilateral the diagonals
    together are longer than two opposite sides. The other nodes: those pairings with middles of
    edges and the centre whose squared distances have the smallest sum. Corners come first, or
    every other one (corner, middle, corner, ...), whichever puts middles where they belong.

    Parameters
    ----------
    positions
        Of the nodes of each face, where it is nearly flat, shape (c, k, d).
    faces
        Node numbers, shape (c, k).
    element
        A key of `ELEMENTS`.

    Returns
    -------
    numpy.ndarray
        The same numbers, shape (c, k); faces in order already are what they were.
    """
    corners = surface_element(element, faces).corners
    size = faces.shape[1]
    order, costs = _placed(positions, corners)
    if size > corners:
        turn = np.arange(2 * corners).reshape(corners, 2).T.ravel()
        turn = np.r_[turn, np.arange(2 * corners, size)]
        other, less = _placed(positions[:, turn], corners)
        order = np.where((less < (1 - _TIE) * costs)[:, None], turn[other], order)
    return np.take_along_axis(faces, order, axis=1)


def _placed(x: np.ndarray, corners: int) -> tuple[np.ndarray, np.ndarray]:
    """Order of nodes (c, k) whose corners come first, and the squared distances that remain."""
    first = _corner_order(x[:, :corners])
    targets = np.take_along_axis(x, first[:, :, None], axis=1)
    middles = targets[:, np.array(_EDGES[corners])].mean(axis=2)
    targets = np.concatenate([middles, targets.mean(axis=1)[:, None]], axis=1)
    others = x[:, corners:]
    count = others.shape[1]
    squares = ((targets[:, :count, None] - others[:, None]) ** 2).sum(axis=3)
    ways = np.array(list(itertools.permutations(range(count))), dtype=np.int64)
    costs = squares[:, np.arange(count), ways].sum(axis=2)
    costs[:, 0] *= 1 - _TIE
    best = np.argmin(costs, axis=1)
    return np.hstack([first, corners + ways[best]]), costs[np.arange(len(x)), best]


def _corner_order(x: np.ndarray) -> np.ndarray:
    """Order of corners (c, 3 or 4), of four so that the first and the last are opposite."""
    if x.shape[1] == 3:
        return np.tile(np.arange(3), (len(x), 1))
    orders = np.array(_OPPOSITE)
    ends = x[:, orders]
    lengths = np.linalg.norm(ends[:, :, :2] - ends[:, :, :1:-1], axis=3).sum(axis=2)
    lengths[:, 0] *= 1 + _TIE
    return orders[np.argmax(lengths, axis=1)]
