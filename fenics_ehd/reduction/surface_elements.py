"""Shape functions and Gauss rules of surface cells, in numpy alone.

The nodes of a cell come in the package's order: corners, edge midpoints, centre,
each group as dolfinx numbers it. In the reference coordinates (s, t),

    quadrilateral  corners (0,0) (1,0) (0,1) (1,1)      2 - 7 - 3
                   edges   (.5,0) (0,.5) (1,.5) (.5,1)  5   8   6
                   centre  (.5,.5)                      0 - 4 - 1

    triangle       corners (0,0) (1,0) (0,1)            2
                   edges   (.5,.5) (0,.5) (.5,0)        4   3
                                                        0 - 5 - 1

Most programs number corners and edges *around* the cell instead; `from_cyclic` turns
theirs.
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

#: Place of each node of ours in the order around the cell: corners, then the edges that
#: follow each corner.
_FROM_CYCLIC = {4: [0, 1, 3, 2, 4, 7, 5, 6, 8], 3: [0, 1, 2, 4, 5, 3]}


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


def from_cyclic(faces: np.ndarray, element: str) -> np.ndarray:
    """Faces numbered around, as most programs do, in the order of this package.

    Parameters
    ----------
    faces
        Node numbers, shape (c, k): the corners in order around the face, then the edge
        midpoints, the first one between the first two corners, then the centre.
    element
        A key of `ELEMENTS`.

    Returns
    -------
    numpy.ndarray
        The same numbers, shape (c, k).
    """
    faces = np.asarray(faces)
    kind = surface_element(element, faces)
    return faces[:, _FROM_CYCLIC[kind.corners][: faces.shape[1]]]
