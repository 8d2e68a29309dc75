"""Points on a surface: the cells they lie in, and what the nodes of the mesh know there.

Within a hole of the mesh that is extended from its rim by mean value coordinates (K. Hormann and
M. S. Floater, ACM Transactions on Graphics 25, 2006): exact where it is linear, and continuous but
for the bend of the rim's edges.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from fenics_ehd.base.errors import InterfaceMismatchError
from fenics_ehd.film.surface import TURN, Surface, unwrap
from fenics_ehd.reduction.surface_elements import ELEMENTS

#: Largest distance of a located point from its cell, in reference coordinates.
OUTSIDE_TOLERANCE = 1e-6

#: Points located at once.
BLOCK = 20_000


def near_pairs(surface: Surface, points: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of a cell and a point that may touch.

    Parameters
    ----------
    surface
        The cells.
    points
        Angle and height, shape (p, 2).
    reach
        Radius of what is around the points, in the length of `scaled_reach`.

    Returns
    -------
    cells, points : numpy.ndarray
        Indices, shape (pairs,).
    """
    scale = _scale(surface)
    trees = [
        cKDTree(np.column_stack([np.mod(x[:, 0], TURN) % TURN, scale * x[:, 1]]), boxsize=[TURN, 0])
        for x in (surface.centres, points)
    ]
    own = scaled_reach(surface, surface)
    pairs = trees[0].sparse_distance_matrix(
        trees[1], (1 + 1e-9) * (own + reach), output_type="ndarray"
    )
    return pairs["i"], pairs["j"]


def _scale(surface: Surface) -> float:
    """Angle per height that makes the cells about as wide as high."""
    extents = np.ptp(surface.corners, axis=1).mean(axis=0)
    return extents[0] / extents[1]


def scaled_reach(surface: Surface, other: Surface) -> float:
    """Largest distance of a corner of `other` from its cell's centre, heights scaled alike."""
    offsets = (other.corners - other.centres[:, None]) * [1.0, _scale(surface)]
    return float(np.linalg.norm(offsets, axis=2).max())


def locate(surface: Surface, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cell of each point and its reference coordinates there.

    Parameters
    ----------
    surface
        The mesh.
    points
        Angle and height, shape (p, 2); any turn.

    Returns
    -------
    cells : numpy.ndarray
        shape (p,).
    reference : numpy.ndarray
        shape (p, 2).

    Raises
    ------
    InterfaceMismatchError
        A point lies beyond an end of the cylinder.
    """
    cell, point = near_pairs(surface, points, 0.0)
    x = points[point]
    x[:, 0] = unwrap(x[:, 0], surface.centres[cell, 0])
    xi = surface.reference(cell, x[:, None])[:, 0]
    far = 1 - xi.sum(axis=1) if surface.triangular else (1 - xi).min(axis=1)
    # On a common edge any of the cells will do: the one the point is deepest in.
    depth = np.minimum(xi.min(axis=1), far)
    order = np.lexsort((depth, point))
    last = np.append(np.flatnonzero(np.diff(point[order])), len(order) - 1)[: len(order)]
    best = order[last]
    inside = depth[best] >= -OUTSIDE_TOLERANCE
    if np.count_nonzero(inside) < len(points):
        missing = np.setdiff1d(np.arange(len(points)), point[best[inside]])[0]
        low, high = surface.bounds
        raise InterfaceMismatchError(
            f"the point at z = {points[missing, 1]:.6g} m lies outside the surface, which reaches "
            f"from {low:.6g} to {high:.6g} m"
        )
    return cell[best], xi[best]


def interpolation_matrix(surface: Surface, phi: np.ndarray, z: np.ndarray) -> sparse.csr_matrix:
    """Shape functions of a surface at points.

    Parameters
    ----------
    surface
        The mesh, m nodes.
    phi, z
        Points, shape (p,) [rad], [m].

    Returns
    -------
    scipy.sparse.csr_matrix
        shape (p, m).

    Raises
    ------
    InterfaceMismatchError
        A point lies beyond an end of the cylinder.
    """
    points = np.column_stack([phi, z])
    if surface.holes:
        return _around_holes(surface, points)
    return _within(surface, points)


def _within(surface: Surface, points: np.ndarray) -> sparse.csr_matrix:
    """Shape functions at points of the cells."""
    blocks = [sparse.csr_matrix((0, len(surface.nodes)))]
    for start in range(0, len(points), BLOCK):
        cells, xi = locate(surface, points[start : start + BLOCK])
        values = ELEMENTS[surface.family].shapes(xi)
        starts = np.arange(0, values.size + 1, values.shape[1])
        blocks.append(
            sparse.csr_matrix(
                (values.ravel(), surface.cells[cells].ravel(), starts),
                shape=(len(cells), len(surface.nodes)),
            )
        )
    return sparse.vstack(blocks, format="csr")


def _around_holes(surface: Surface, points: np.ndarray) -> sparse.csr_matrix:
    """Shape functions at points, in a hole the extension from its rim."""
    matrix = sparse.lil_matrix((len(points), len(surface.nodes)))
    left = np.ones(len(points), dtype=bool)
    for hole in surface.holes:
        inside = np.flatnonzero(left & hole.contains(*points.T))
        left[inside] = False
        x = points[inside]
        x[:, 0] = unwrap(x[:, 0], np.array(hole.angle))
        for row, weights in zip(inside, mean_value(hole.polygon, x, _scale(surface)), strict=True):
            matrix[row, hole.rim] = weights
    matrix[left] = _within(surface, points[left])
    return matrix.tocsr()


def mean_value(polygon: np.ndarray, points: np.ndarray, scale: float) -> np.ndarray:
    """Mean value coordinates of points within a polygon, shape (p, r).

    `scale` is the angle that is as long as a unit of height.
    """
    offsets = (polygon - points[:, None]) * [1.0, scale]
    following = np.roll(offsets, -1, axis=1)
    cross = offsets[..., 0] * following[..., 1] - offsets[..., 1] * following[..., 0]
    dot = (offsets * following).sum(axis=2)
    distance = np.linalg.norm(offsets, axis=2)
    # tan(a / 2) = sin a / (1 + cos a)
    half = cross / (distance * np.roll(distance, -1, axis=1) + dot)
    weights = (half + np.roll(half, 1, axis=1)) / distance
    return weights / weights.sum(axis=1, keepdims=True)
