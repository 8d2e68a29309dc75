"""Consistent mass of 10-node tetrahedra: CalculiX integrates theirs with too few points."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from fenics_ehd.base.errors import StructureError

if TYPE_CHECKING:
    from scipy import sparse

#: Corners of each edge, in the order of the nodes 5 to 10 of C3D10 and of VTK.
_EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))

#: Gauss points a direction: on a curved cell the integrand is of degree 4 + 3, and collapsing
#: the cube adds 2.
_POINTS = 5


def tetrahedron_mass(nodes: np.ndarray, cells: np.ndarray, density: float) -> sparse.csr_matrix:
    """Consistent mass matrix of curved 10-node tetrahedra, integrated exactly.

    Parameters
    ----------
    nodes
        Positions, shape (n, 3) [m].
    cells
        Places of the nodes of each cell, shape (c, 10): corners, then the edges 12, 23, 31, 14,
        24, 34, as in Abaqus, CalculiX and VTK.
    density
        [kg/m^3].

    Returns
    -------
    scipy.sparse.csr_matrix
        shape (3 n, 3 n) [kg], degree of freedom ``3 * node + component``.

    Raises
    ------
    StructureError
        `cells` are no 10-node tetrahedra of these nodes, or one is turned inside out.
    """
    from scipy import sparse

    nodes, cells = np.asarray(nodes, dtype=float), np.asarray(cells)
    if cells.ndim != 2 or cells.shape[1] != 10 or cells.dtype.kind not in "iu" or not len(cells):
        raise StructureError(
            f"cells of shape {cells.shape}: (cells, 10) of whole numbers is needed"
        )
    if not 0 <= cells.min() <= cells.max() < len(nodes):
        raise StructureError(
            f"cells name nodes {cells.min()} to {cells.max()}, there are 0 to {len(nodes) - 1}"
        )
    points, weights = _rule()
    values, slopes = _shapes(points)
    jacobians = np.einsum("qid,cix->cqdx", slopes, nodes[cells])
    volumes = np.linalg.det(jacobians)
    # The sign is that of the numbering; within a cell it must not change.
    signs = np.sign(volumes[:, :1])
    folded = np.flatnonzero((volumes * signs <= 0).any(axis=1))
    if len(folded):
        raise StructureError(f"cell {folded[0]} with nodes {cells[folded[0]]} is folded")
    blocks = density * np.einsum("q,cq,qi,qj->cij", weights, volumes * signs, values, values)
    rows, columns = (np.broadcast_to(a, blocks.shape) for a in (cells[:, :, None], cells[:, None]))
    shape = len(nodes), len(nodes)
    scalar = sparse.coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=shape)
    return sparse.kron(scalar.tocsr(), sparse.eye(3), format="csr")


def _rule() -> tuple[np.ndarray, np.ndarray]:
    """Points (q, 3) and weights (q,) on the reference tetrahedron, a cube collapsed to it."""
    x, w = np.polynomial.legendre.leggauss(_POINTS)
    x, w = 0.5 * (x + 1), 0.5 * w
    a, b, c = np.array(list(itertools.product(x, repeat=3))).T
    weights = np.array(list(itertools.product(w, repeat=3))).prod(axis=1)
    points = np.column_stack([a, b * (1 - a), c * (1 - a) * (1 - b)])
    return points, weights * (1 - a) ** 2 * (1 - b)


def _shapes(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quadratic shape functions (q, 10) and their derivatives (q, 10, 3)."""
    corner = np.column_stack([1 - points.sum(axis=1), points])
    slope = np.vstack([-np.ones(3), np.eye(3)])
    first, second = np.array(_EDGES).T
    values = [corner * (2 * corner - 1), 4 * corner[:, first] * corner[:, second]]
    slopes = [
        (4 * corner - 1)[:, :, None] * slope,
        4 * (corner[:, first, None] * slope[second] + corner[:, second, None] * slope[first]),
    ]
    return np.hstack(values), np.concatenate(slopes, axis=1)
