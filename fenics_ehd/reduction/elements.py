"""Shape functions and Gauss rules of surface and solid cells, which need only NumPy and SciPy.

The nodes of a surface cell are in the order of this package: corners, edge midpoints, centre, each
group as dolfinx numbers it. In the reference coordinates (s, t),

    quadrilateral  corners (0,0) (1,0) (0,1) (1,1)      2 - 7 - 3
                   edges   (.5,0) (0,.5) (1,.5) (.5,1)  5   8   6
                   centre  (.5,.5)                      0 - 4 - 1

    triangle       corners (0,0) (1,0) (0,1)            2
                   edges   (.5,.5) (0,.5) (.5,0)        4   3
                                                        0 - 5 - 1

Most programs number corners and edges *around* the cell. `package_order` recognises the order from
the geometry.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse

from fenics_ehd.base.errors import StructureError

#: Corners at the ends of each edge of a cell, by dimension and number of corners of the cell.
_EDGES = {
    (2, 4): [(0, 1), (0, 2), (1, 3), (2, 3)],
    (2, 3): [(1, 2), (0, 2), (0, 1)],
    (3, 4): [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)],
    (3, 8): [
        *((0, 1), (1, 2), (2, 3), (0, 3), (4, 5), (5, 6)),
        *((6, 7), (4, 7), (0, 4), (1, 5), (2, 6), (3, 7)),
    ],
}

#: Corners of the reference cells.
_SQUARE = [(0, 0), (1, 0), (0, 1), (1, 1)]
_TRIANGLE = [(0, 0), (1, 0), (0, 1)]
_TETRAHEDRON = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
_CUBE = [(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]

#: The three ways to pair opposite corners of a quadrilateral, as orders of its corners in which the
#: first and the last are opposite: this package's order, the order around the cell, a third one.
_OPPOSITE = ((0, 1, 2, 3), (0, 1, 3, 2), (0, 2, 3, 1))

#: Relative difference of two lengths or costs up to which the given order of nodes is kept.
_TIE = 1e-6


#: Whether an element of a family and degree contains a monomial with exponents e.
_SPANNED = {
    "lagrange": lambda e, degree: True,
    # Superlinear degree: total degree of the variables whose power is at least 2.
    "serendipity": lambda e, degree: sum(k for k in e if k > 1) <= degree,
    "simplex": lambda e, degree: sum(e) <= degree,
}


@dataclass(frozen=True, eq=False)
class NodalElement:
    """Nodal element on a reference cell of d dimensions: unit square, unit cube or unit simplex.

    Attributes
    ----------
    nodes
        Reference coordinates of the k nodes, corners first, shape (k, d).
    exponents
        Exponents a, b, ... of the monomials ``s^a t^b ...`` that the shape functions span, shape
        (k, d).
    corners
        Number of corners.
    """

    nodes: np.ndarray
    exponents: np.ndarray
    corners: int

    @classmethod
    def of(cls, nodes: Any, family: str, degree: int) -> NodalElement:
        """Make an element from its nodes, the family of its monomials and their degree.

        The family is ``"lagrange"``, ``"serendipity"`` or ``"simplex"``.
        """
        nodes = np.asarray(nodes, dtype=float)
        dimension = nodes.shape[1]
        every = itertools.product(range(degree + 1), repeat=dimension)
        exponents = np.array([e for e in every if _SPANNED[family](e, degree)])
        return cls(nodes, exponents, dimension + 1 if family == "simplex" else 2**dimension)

    @property
    def degree(self) -> int:
        """Largest total degree of the monomials."""
        return int(self.exponents.sum(axis=1).max())

    @property
    def edges(self) -> np.ndarray:
        """Corners at the ends of each edge, shape (edges, 2)."""
        return np.array(_EDGES[self.nodes.shape[1], self.corners])

    def rule(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Points, shape (q, d), and weights, shape (q,), of a Gauss rule on the reference cell.

        The rule has `count` points in each direction. On a square or cube it is exact for
        polynomials up to degree ``2 count - 1`` in each variable, on a simplex up to the total
        degree ``2 count - d``.
        """
        dimension = self.nodes.shape[1]
        x, w = np.polynomial.legendre.leggauss(count)
        points, weights = (
            np.array(list(itertools.product(0.5 * a, repeat=dimension))) for a in (x + 1, w)
        )
        weights = weights.prod(axis=1)
        if self.corners == dimension + 1:
            # The rule on the cube is mapped to the simplex, with one face collapsed to a corner.
            for axis in range(1, dimension):
                shrinkage = 1 - points[:, axis]
                points[:, :axis] *= shrinkage[:, None]
                weights = weights * shrinkage**axis
        return points, weights

    def tabulate(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Evaluate the shape functions and their derivatives.

        Parameters
        ----------
        points
            Reference coordinates of points, shape (q, d).

        Returns
        -------
        values : numpy.ndarray
            Values of the shape functions, shape (q, k).
        derivatives : numpy.ndarray
            Derivatives with respect to each reference coordinate, shape (d, q, k).
        """
        slopes = [
            2 * self.exponents[:, d] * self._monomials(points, unit) @ self._nodal
            for d, unit in enumerate(np.eye(self.nodes.shape[1], dtype=int))
        ]
        return self.shapes(points), np.array(slopes)

    def shapes(self, points: np.ndarray) -> np.ndarray:
        """Values of the shape functions, shape (q, k), at reference points, shape (q, d)."""
        return self._monomials(points) @ self._nodal

    @cached_property
    def _nodal(self) -> np.ndarray:
        """Coefficients of the monomials (rows) in each shape function (columns), shape (k, k)."""
        return np.linalg.inv(self._monomials(self.nodes))

    def _monomials(self, points: np.ndarray, less: np.ndarray | int = 0) -> np.ndarray:
        """Values of the monomials at reference points, shape (q, k).

        The variables of the monomials are ``2 s - 1``, ``2 t - 1``, ..., from -1 to 1. For
        derivatives, `less` is subtracted from the exponents.
        """
        powers = np.maximum(self.exponents - less, 0)
        return np.prod((2 * np.asarray(points)[:, None, :] - 1) ** powers, axis=2)


def with_middles(corners: Any, edges: Any, *others: tuple) -> np.ndarray:
    """Coordinates of the nodes of an element: corners, midpoints of its edges, then `others`."""
    ends = np.array(corners, dtype=float)
    return np.vstack([ends, ends[np.array(edges)].mean(axis=1), *others])


#: Elements of surface cells by name: quadrilaterals with 4, 8 and 9 nodes, triangles with 3 and 6.
ELEMENTS = {
    "bilinear": NodalElement.of(_SQUARE, "lagrange", 1),
    "serendipity": NodalElement.of(with_middles(_SQUARE, _EDGES[2, 4]), "serendipity", 2),
    "lagrange": NodalElement.of(with_middles(_SQUARE, _EDGES[2, 4], (0.5, 0.5)), "lagrange", 2),
    "linear triangle": NodalElement.of(_TRIANGLE, "simplex", 1),
    "triangle": NodalElement.of(with_middles(_TRIANGLE, _EDGES[2, 3]), "simplex", 2),
}

#: Elements of solid cells with 10 and 20 nodes: corners, then midpoints of edges, in the order of
#: VTK, Abaqus and CalculiX.
SOLIDS = {
    "tet": NodalElement.of(with_middles(_TETRAHEDRON, _EDGES[3, 4]), "simplex", 2),
    "hex": NodalElement.of(with_middles(_CUBE, _EDGES[3, 8]), "serendipity", 2),
}


def summed(
    blocks: np.ndarray, rows: np.ndarray, columns: np.ndarray, shape: tuple[int, int]
) -> sparse.csr_matrix:
    """Assemble a sparse matrix from blocks of cells.

    Parameters
    ----------
    blocks
        Entries, one block for each cell; entries of equal row and column are added.
    rows, columns
        Row and column number of every entry, of shapes that broadcast to that of `blocks`.
    shape
        Numbers of rows and columns of the matrix.
    """
    indices = tuple(np.broadcast_to(a, blocks.shape).ravel() for a in (rows, columns))
    return sparse.coo_matrix((blocks.ravel(), indices), shape=shape).tocsr()


def surface_element(name: str, cells: np.ndarray, label: str = "faces") -> NodalElement:
    """Return the element of a name, after a check that cells, shape (c, k), fit it.

    Messages call the cells `label`.

    Raises
    ------
    StructureError
        If there is no element of this name, or if its cells have another number of nodes.
    """
    if name not in ELEMENTS:
        raise StructureError(f"{label}: element {name!r} is not one of {', '.join(ELEMENTS)}")
    size = len(ELEMENTS[name].nodes)
    if cells.ndim != 2 or cells.shape[1] != size or not len(cells):
        raise StructureError(
            f"{label} have shape {cells.shape}, but {name} needs (number of faces, {size})"
        )
    return ELEMENTS[name]


def package_order(positions: np.ndarray, faces: np.ndarray, element: str) -> np.ndarray:
    """Sort the nodes of each face into the order of this package.

    The order is recognised from the geometry, face by face. Of the three ways to pair four corners,
    the two diagonals of a convex quadrilateral have the largest total length; they join opposite
    corners. Other nodes are assigned to midpoints of edges and centre so that the sum of squared
    distances is smallest. Corners may come first or alternate with midpoints (corner, midpoint,
    corner, ...); the assumption with the smaller distances is used.

    Parameters
    ----------
    positions
        Positions of the nodes of each face, shape (c, k, d), in coordinates in which faces are
        nearly flat.
    faces
        Node numbers of each face, shape (c, k).
    element
        A key of `ELEMENTS`.

    Returns
    -------
    numpy.ndarray
        Sorted node numbers of each face, shape (c, k); a face in the right order is unchanged.
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
    """Sort the nodes of faces whose corners come first; return the order and its misfit.

    Parameters
    ----------
    x
        Positions of the nodes of each face, shape (c, k, d).
    corners
        Number of corners of a face.

    Returns
    -------
    tuple of numpy.ndarray
        Indices that sort the nodes of each face, shape (c, k); for each face, sum of the squared
        distances of its other nodes from the midpoints or centre to which they are assigned,
        shape (c,).
    """
    first = _corner_order(x[:, :corners])
    targets = np.take_along_axis(x, first[:, :, None], axis=1)
    middles = targets[:, np.array(_EDGES[2, corners])].mean(axis=2)
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
    """Indices that sort the corners of each face, shape (c, 3 or 4).

    The first and the last of four sorted corners are opposite corners. `x` has the positions of the
    corners, shape (c, 3 or 4, d).
    """
    if x.shape[1] == 3:
        return np.tile(np.arange(3), (len(x), 1))
    orders = np.array(_OPPOSITE)
    ends = x[:, orders]
    lengths = np.linalg.norm(ends[:, :, :2] - ends[:, :, :1:-1], axis=3).sum(axis=2)
    lengths[:, 0] *= 1 + _TIE
    return orders[np.argmax(lengths, axis=1)]
