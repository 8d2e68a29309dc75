"""A mesh of a whole cylinder, unwrapped to the plane (phi, z) and periodic in phi.

It may have holes. Within one, what nodes of the mesh know is extended from its rim by mean value
coordinates (K. Hormann and M. S. Floater, ACM Transactions on Graphics 25, 2006): exact where it is
linear, and continuous but for the bend of the rim's edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from fenics_ehd.base.errors import InterfaceMismatchError, StructureError
from fenics_ehd.reduction.bore_holes import BoreHole, bore_holes
from fenics_ehd.reduction.surface_elements import ELEMENTS

TURN = 2 * np.pi

#: Largest distance of a node from its place in the affine cell, in reference coordinates.
SHAPE_TOLERANCE = 1e-6

#: Largest distance of a located point from its cell, in reference coordinates.
OUTSIDE_TOLERANCE = 1e-6

#: The same as the first for nodes in the middle of the edges of a hole: they lie on its rim.
RIM_TOLERANCE = 0.2

#: Points located at once.
BLOCK = 20_000


def unwrap(angle: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Angles moved by whole turns to within half a turn of others."""
    return angle - TURN * np.round((angle - near) / TURN)


@dataclass(frozen=True, eq=False)
class Surface:
    """Mesh of a cylinder about the z axis.

    Attributes
    ----------
    nodes
        Angle [rad] and height [m] of the nodes, shape (m, 2); angles may lie
        anywhere, cells across the seam unwrap themselves.
    cells
        Nodes of each cell, shape (c, k): corners, edge midpoints, centre, in
        dolfinx order; those of a `FilmGrid` are its `cell_nodes`.
    family
        ``"bilinear"``, ``"serendipity"``, ``"lagrange"`` (4, 8, 9 nodes on
        quadrilaterals) or ``"triangle"`` (6 nodes).

    Raises
    ------
    InterfaceMismatchError
        The cells are no straight-edged ones that cover a whole cylinder once, but for holes.
    """

    nodes: np.ndarray
    cells: np.ndarray
    family: str

    def __post_init__(self) -> None:
        size = len(ELEMENTS[self.family].nodes)
        if self.cells.ndim != 2 or self.cells.shape[1] != size:
            raise InterfaceMismatchError(
                f"surface cells of family {self.family} have {size} nodes each, the array of "
                f"cells has shape {self.cells.shape}"
            )
        used = np.unique(self.cells)
        if not np.array_equal(used, np.arange(len(self.nodes))):
            raise InterfaceMismatchError(
                f"surface cells use {len(used)} nodes numbered up to {used.max(initial=-1)}, "
                f"they must use each of the {len(self.nodes)} given"
            )
        self._check_shape()

    @classmethod
    def on_cylinder(cls, positions: np.ndarray, cells: np.ndarray, family: str) -> Surface:
        """Surface of nodes on a cylinder about the z axis, positions of shape (m, 3) [m]."""
        angle = np.arctan2(positions[:, 1], positions[:, 0])
        return cls(np.column_stack([angle, positions[:, 2]]), cells, family)

    @property
    def bounds(self) -> tuple[float, float]:
        """Lowest and highest z [m]."""
        return float(self.nodes[:, 1].min()), float(self.nodes[:, 1].max())

    @property
    def width(self) -> float:
        """Length along z [m]."""
        return self.bounds[1] - self.bounds[0]

    @cached_property
    def covered(self) -> float:
        """Area of the cells [rad m]."""
        return float(self.determinants.sum() * (0.5 if self.triangular else 1.0))

    @cached_property
    def holes(self) -> list[BoreHole]:
        """Holes that the cells leave."""
        if not self.covered < (1 - SHAPE_TOLERANCE) * TURN * self.width:
            return []
        angle, z = self.nodes.T
        try:
            found = bore_holes(
                np.column_stack([np.cos(angle), np.sin(angle), z]), self.cells, self.family
            )
        except StructureError:  # what they leave is no hole
            return []
        return [hole.straight() for hole in found] if self.family != "bilinear" else found

    @property
    def triangular(self) -> bool:
        """Whether the cells are triangles."""
        return ELEMENTS[self.family].corners == 3

    @cached_property
    def cell_nodes(self) -> np.ndarray:
        """Nodes of every cell side by side in the plane, shape (c, k, 2)."""
        x = self.nodes[self.cells]
        x[:, :, 0] = unwrap(x[:, :, 0], x[:, :1, 0])
        return x

    @cached_property
    def corners(self) -> np.ndarray:
        """Corners of every cell in dolfinx order, shape (c, 3 or 4, 2)."""
        return self.cell_nodes[:, : 3 if self.triangular else 4]

    @cached_property
    def jacobians(self) -> np.ndarray:
        """Derivative of (phi, z) with respect to the reference coordinates, shape (c, 2, 2)."""
        first = self.corners[:, 0]
        return np.stack([self.corners[:, 1] - first, self.corners[:, 2] - first], axis=2)

    @cached_property
    def determinants(self) -> np.ndarray:
        """Area [rad m] per reference area of every cell, shape (c,)."""
        return np.abs(np.linalg.det(self.jacobians))

    @cached_property
    def _inverse_transposes(self) -> np.ndarray:
        return np.linalg.inv(self.jacobians).swapaxes(1, 2)

    def reference(self, cells: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Reference coordinates of points (p, n, 2), each row in the cell given for it (p,)."""
        offsets = points - self.corners[:, 0][cells][:, None]
        return offsets @ self._inverse_transposes[cells]

    def _check_shape(self) -> None:
        covered = self.covered
        if not abs(covered - TURN * self.width) <= SHAPE_TOLERANCE * TURN * self.width:
            covered += sum(hole.area for hole in self.holes)
        if not abs(covered - TURN * self.width) <= SHAPE_TOLERANCE * TURN * self.width:
            raise InterfaceMismatchError(
                f"surface cells cover {covered / max(self.width, 1e-300):.6g} rad of the "
                "circumference, not a whole turn: they must be narrower than half a turn and "
                "neither overlap nor leave gaps"
            )
        places = ELEMENTS[self.family].nodes
        found = self.reference(np.arange(len(self.cells)), self.cell_nodes)
        off = np.abs(found - places).max(axis=2)
        for hole in self.holes:
            on_rim = np.isin(self.cells, hole.rim)
            off[on_rim & (off <= RIM_TOLERANCE)] = 0.0
        defect = off.max()
        if not defect <= SHAPE_TOLERANCE:
            raise InterfaceMismatchError(
                f"a surface node lies {defect:.1e} cells off its place, above "
                f"{SHAPE_TOLERANCE:.0e}: quadrilaterals must be parallelograms in (phi, z), with "
                "mid-side nodes at the middle of the edges"
            )

    @cached_property
    def centres(self) -> np.ndarray:
        """Centres of the cells, shape (c, 2)."""
        return self.corners.mean(axis=1)


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
