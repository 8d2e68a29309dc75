"""Transfer of pressure and displacement between film and bore meshes that do not match.

A `Surface` is a mesh of a whole cylinder, unwrapped to the plane (phi, z) and periodic in phi. It
may have holes. Points are located in the cells, in which nodal values are interpolated. Within a
hole the interpolation is extended from the rim by mean value coordinates (K. Hormann and M. S.
Floater, ACM Transactions on Graphics 25, 2006): exact where it is linear, and continuous but for
the bend of the rim's edges.

**Section 2.2** has two ways to the nodal forces of a film pressure. The mortar (14) gives pressures
on the bore's nodes, to be loaded with (15). The conservative one integrates the
film's pressure against the bore's shape functions: resultant force and moment
stay those of the film to round-off. Displacements are interpolated to the film's Gauss points by
the bore's shape functions, the transpose of the conservative transfer: force and gap are then
conjugate. With the mortar they are conjugate up to the error of the projection. Integrals are taken
over the common refinement of the two meshes, triangles that tile all intersections of their cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import basix
import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from fenics_ehd.base.errors import InterfaceMismatchError, StructureError
from fenics_ehd.reduction.bore import BoreHole, bore_holes
from fenics_ehd.reduction.elements import ELEMENTS, summed

TURN = 2 * np.pi

#: Largest distance of a node from its position in the affine cell, in reference coordinates.
SHAPE_TOLERANCE = 1e-6

#: The same distance for nodes in the middle of the edges of a hole, which lie on its rim.
RIM_TOLERANCE = 0.2


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
        covered = self.covered
        if not abs(covered - TURN * self.width) <= SHAPE_TOLERANCE * TURN * self.width:
            covered += sum(hole.area for hole in self.holes)
        if not abs(covered - TURN * self.width) <= SHAPE_TOLERANCE * TURN * self.width:
            raise InterfaceMismatchError(
                f"surface cells cover {covered / max(self.width, 1e-300):.6g} rad of the "
                "circumference, not a whole turn: they must be narrower than half a turn and "
                "neither overlap nor leave gaps"
            )
        expected = ELEMENTS[self.family].nodes
        reference = self.reference(np.arange(len(self.cells)), self.cell_nodes)
        off = np.abs(reference - expected).max(axis=2)
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
        """Holes that no cell covers."""
        if not self.covered < (1 - SHAPE_TOLERANCE) * TURN * self.width:
            return []
        angle, z = self.nodes.T
        try:
            holes = bore_holes(
                np.column_stack([np.cos(angle), np.sin(angle), z]), self.cells, self.family
            )
        except StructureError:  # what they leave is no hole
            return []
        return [hole.straight() for hole in holes] if self.family != "bilinear" else holes

    @property
    def triangular(self) -> bool:
        """True where the cells are triangles."""
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

    @cached_property
    def centres(self) -> np.ndarray:
        """Centres of the cells, shape (c, 2)."""
        return self.corners.mean(axis=1)


#: Largest distance of a located point from its cell, in reference coordinates.
OUTSIDE_TOLERANCE = 1e-6

#: Triangles integrated at once.
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
    half_diagonal = scaled_reach(surface, surface)
    pairs = trees[0].sparse_distance_matrix(
        trees[1], (1 + 1e-9) * (half_diagonal + reach), output_type="ndarray"
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
    # A point on a common edge may belong to any of the cells: the one with the largest distance to
    # its edges is chosen.
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
    cells, xi = locate(surface, points)
    values = ELEMENTS[surface.family].shapes(xi)
    starts = np.arange(0, values.size + 1, values.shape[1])
    shape = (len(cells), len(surface.nodes))
    return sparse.csr_matrix((values.ravel(), surface.cells[cells].ravel(), starts), shape)


def _around_holes(surface: Surface, points: np.ndarray) -> sparse.csr_matrix:
    """Shape functions at points, in a hole the extension from its rim."""
    matrix = sparse.lil_matrix((len(points), len(surface.nodes)))
    outside = np.ones(len(points), dtype=bool)
    for hole in surface.holes:
        inside = np.flatnonzero(outside & hole.contains(*points.T))
        outside[inside] = False
        x = points[inside]
        x[:, 0] = unwrap(x[:, 0], np.array(hole.angle))
        for row, weights in zip(inside, mean_value(hole.polygon, x, _scale(surface)), strict=True):
            matrix[row, hole.rim] = weights
    matrix[outside] = _within(surface, points[outside])
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
    half = np.tan(0.5 * np.arctan2(cross, dot))
    corner = distance == 0.0
    weights = (half + np.roll(half, 1, axis=1)) / np.where(corner, 1.0, distance)
    weights = np.where(corner.any(axis=1, keepdims=True), corner, weights)
    return weights / weights.sum(axis=1, keepdims=True)


#: Largest difference of the two meshes' ends, relative to the width.
WIDTH_TOLERANCE = 1e-8

#: Largest relative difference of the intersections' area from the cylinder's.
AREA_TOLERANCE = 1e-10

#: Triangles smaller than this share of the cell are round-off of cells that only touch.
SLIVER = 1e-15


@dataclass(frozen=True, eq=False)
class Overlay:
    """Triangles, each within one cell of either mesh.

    Attributes
    ----------
    structure_cells, film_cells
        Cells that each triangle lies in, shape (t,).
    on_structure, on_film
        Its corners in the reference coordinates of these cells, shape (t, 3, 2).
    areas
        shape (t,) [rad m].
    """

    structure_cells: np.ndarray
    film_cells: np.ndarray
    on_structure: np.ndarray
    on_film: np.ndarray
    areas: np.ndarray


def overlay(structure: Surface, film: Surface) -> Overlay:
    """Intersect the cells of two meshes of one cylinder.

    The film's cells are clipped in the reference coordinates of the
    structure's, where the clipping lines are the same for all pairs.

    Raises
    ------
    InterfaceMismatchError
        The meshes do not cover the same cylinder.
    """
    _check_ends(structure, film)
    cell, other = near_pairs(structure, film.centres, scaled_reach(structure, film))
    polygons = film.corners[other]
    polygons = polygons if film.triangular else polygons[:, [0, 1, 3, 2]]
    near = unwrap(film.centres[other, 0], structure.centres[cell, 0]) - film.centres[other, 0]
    shift = np.stack([near, np.zeros_like(near)], axis=1)[:, None]
    polygons = structure.reference(cell, polygons + shift)
    touching = (polygons.min(axis=1) < 1).all(axis=1) & (polygons.max(axis=1) > 0).all(axis=1)
    cell = cell[touching]
    other = other[touching]
    shift = shift[touching]
    triangles, pair = _triangulate(_clip_to_cell(polygons[touching], structure.triangular))
    cell = cell[pair]
    other = other[pair]
    shift = shift[pair]
    plane = structure.corners[cell][:, :1] + triangles @ structure.jacobians[cell].swapaxes(1, 2)
    result = Overlay(
        structure_cells=cell,
        film_cells=other,
        on_structure=triangles,
        on_film=film.reference(other, plane - shift),
        areas=_areas(triangles) * structure.determinants[cell],
    )
    area = structure.covered if structure.holes else TURN * structure.width
    defect = abs(result.areas.sum() / area - 1)
    if not defect <= AREA_TOLERANCE:
        raise InterfaceMismatchError(
            f"the intersections of film and bore cells miss the cylinder's area by {defect:.1e} "
            f"(relative), above {AREA_TOLERANCE:.0e}: cells of one mesh overlap"
        )
    return result


def _check_ends(structure: Surface, film: Surface) -> None:
    ends = np.array([structure.bounds, film.bounds])
    if not np.abs(ends[1] - ends[0]).max() <= WIDTH_TOLERANCE * structure.width:
        raise InterfaceMismatchError(
            f"the film mesh is {film.width:.9g} m wide (z from {ends[1, 0]:.9g} m), the bore mesh "
            f"{structure.width:.9g} m (from {ends[0, 0]:.9g} m): give the film the bore's width"
        )


def _clip_to_cell(polygons: np.ndarray, triangular: bool) -> np.ndarray:
    """Convex polygons (p, n, 2) cut to the reference cell; vertices may repeat."""
    lines = [([1, 0], 0), ([0, 1], 0)]
    lines += [([-1, -1], 1)] if triangular else [([-1, 0], 1), ([0, -1], 1)]
    for direction, offset in lines:
        polygons = _clip(polygons, polygons @ np.array(direction, dtype=float) + offset)
    return polygons


def _clip(polygons: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Part of convex polygons (p, n, 2) where a linear function, `side` (p, n), is not negative.

    Sutherland and Hodgman, Comm. ACM 17 (1974), all polygons at once. A cut adds
    at most one vertex; polygons with fewer repeat their first kept one.
    """
    count, size = side.shape
    following = np.roll(polygons, -1, axis=1)
    next_side = np.roll(side, -1, axis=1)
    crosses = (side >= 0) != (next_side >= 0)
    share = side / np.where(crosses, side - next_side, 1.0)
    crossing = polygons + share[:, :, None] * (following - polygons)
    vertices = np.stack([polygons, crossing], axis=2).reshape(count, 2 * size, 2)
    kept = np.stack([side >= 0, crosses], axis=2).reshape(count, 2 * size)
    order = np.argsort(~kept, axis=1, kind="stable")[:, : size + 1]
    vertices = np.take_along_axis(vertices, order[:, :, None], axis=1)
    filled = np.take_along_axis(kept, order, axis=1)
    return np.where(filled[:, :, None], vertices, vertices[:, :1])


def _areas(triangles: np.ndarray) -> np.ndarray:
    a = triangles[:, 1] - triangles[:, 0]
    b = triangles[:, 2] - triangles[:, 0]
    return 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _triangulate(polygons: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fans from the first vertex, degenerate triangles left out, and the polygon of each."""
    size = polygons.shape[1]
    fan = np.stack([polygons[:, [0, i, i + 1]] for i in range(1, size - 1)], axis=1)
    owner = np.repeat(np.arange(len(polygons)), size - 2)
    triangles = fan.reshape(-1, 3, 2)
    real = _areas(triangles) > SLIVER
    return triangles[real], owner[real]


def triangle_rule(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Barycentric points (q, 3) and weights (q,), sum 1, exact for a total polynomial degree."""
    points, weights = basix.make_quadrature(basix.CellType.triangle, degree)
    barycentric = np.column_stack([1 - points.sum(axis=1), points])
    return barycentric, weights / weights.sum()


#: Weights of three Gauss points on the unit interval.
GAUSS_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0

#: Round-off of the area of a film cell's parts.
WHOLE = 1e-9


class Mortar:
    """``P_s = H_sf P_f`` (14), the L2 projection of film pressures onto the bore's mesh.

    ``H = D^-1 M`` with ``D = int N_s N_s dA`` and ``M = int N_s N_f dA``, the
    latter integrated exactly over the true intersections of the cells, D over those of the bore's
    with themselves: what both meshes can represent is reproduced, and the integral of every
    pressure is kept. H itself is full and is not formed.

    Parameters
    ----------
    structure
        Bore mesh of the pressures of (15), m nodes.
    film
        Film mesh, k nodes.
    radius
        Radius of both [m].

    Attributes
    ----------
    mass, coupling
        D, shape (m, m), and M, shape (m, k), sparse [m^2].

    Raises
    ------
    InterfaceMismatchError
        The meshes do not cover the same cylinder.
    """

    def __init__(self, structure: Surface, film: Surface, radius: float):
        self.mass = radius * _coupling(structure, structure)
        self.coupling = radius * _coupling(structure, film)
        self._factor = splu(self.mass.tocsc())

    def to_structure(self, pressures: np.ndarray) -> np.ndarray:
        """``H P_f`` for film pressures of shape (k,) or (k, columns)."""
        return self._factor.solve(self.coupling @ pressures)


def _coupling(structure: Surface, film: Surface) -> sparse.csr_matrix:
    """``int N_s N_f dphi dz`` on the intersections of the cells."""
    tiles = overlay(structure, film)
    degree = ELEMENTS[structure.family].degree + ELEMENTS[film.family].degree
    barycentric, weights = triangle_rule(degree)
    size = (len(structure.nodes), len(film.nodes))
    total = sparse.csr_matrix(size)
    for start in range(0, len(tiles.areas), BLOCK):
        part = slice(start, start + BLOCK)
        of_structure, of_film = (
            ELEMENTS[surface.family]
            .shapes((barycentric @ corners[part]).reshape(-1, 2))
            .reshape(-1, len(weights), surface.cells.shape[1])
            for surface, corners in ((structure, tiles.on_structure), (film, tiles.on_film))
        )
        scaled = (tiles.areas[part, None] * weights)[:, :, None] * of_film
        entries = of_structure.swapaxes(1, 2) @ scaled
        rows = structure.cells[tiles.structure_cells[part]][:, :, None]
        columns = film.cells[tiles.film_cells[part]][:, None, :]
        total = total + summed(entries, rows, columns, size)
    return total


def solid_share(structure: Surface, film: Surface, points: np.ndarray) -> np.ndarray:
    """Share of the area of each Gauss point of a film that lies outside the holes of a bore.

    Weights that integrate all products of quadratics exactly over the part of a film cell outside
    the holes. With these weights the pressure of the film acts on the remaining surface.

    Parameters
    ----------
    structure
        Bore mesh, its holes polygons.
    film
        Film mesh.
    points
        3 x 3 Gauss points of a film cell, shape (9, 2).

    Returns
    -------
    numpy.ndarray
        shape (cells, 9), 1 where a cell is whole.
    """
    tiles = overlay(structure, film)
    barycentric, weights = triangle_rule(4)
    x = (barycentric @ tiles.on_film).reshape(-1, 2)
    powers = [(i, j) for i in range(3) for j in range(3)]

    def monomials(at: np.ndarray) -> np.ndarray:
        return np.stack([at[:, 0] ** i * at[:, 1] ** j for i, j in powers], axis=1)

    lagrange = (monomials(x) @ np.linalg.inv(monomials(points))).reshape(-1, len(weights), 9)
    moments = tiles.areas[:, None] * np.einsum("q,tqg->tg", weights, lagrange)
    solid = np.zeros((len(film.cells), 9))
    np.add.at(solid, tiles.film_cells, moments)
    complete = film.determinants[:, None] * np.outer(*[GAUSS_WEIGHTS] * 2).ravel()
    share = solid / complete
    share[np.abs(solid.sum(axis=1) / complete.sum(axis=1) - 1.0) < WHOLE] = 1.0
    return share


def outward_displacement(structure: Surface, phi: np.ndarray, z: np.ndarray) -> sparse.csr_matrix:
    """Gap change ``n . N_s u`` at points of the film per displacement of the bore nodes.

    Parameters
    ----------
    structure
        Bore mesh of the displacements, m nodes.
    phi, z
        Points, shape (p,) [rad], [m]; ``n = (cos phi, sin phi, 0)``.

    Returns
    -------
    scipy.sparse.csr_matrix
        shape (p, 3 m), columns ``3 node + component``.
    """
    shape = interpolation_matrix(structure, phi, z)
    normal = np.repeat(np.column_stack([np.cos(phi), np.sin(phi)]), np.diff(shape.indptr), axis=0)
    return sparse.csr_matrix(
        (
            (shape.data[:, None] * normal).ravel(),
            (3 * shape.indices[:, None] + np.arange(2)).ravel(),
            2 * shape.indptr,
        ),
        shape=(len(phi), 3 * len(structure.nodes)),
    )
