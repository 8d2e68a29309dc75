"""Transfer of pressure and displacement between film and bore meshes that do not match.

A `Surface` is a mesh of a full cylinder, unwrapped to the plane (phi, z) and periodic in phi. It
may have holes. Points are located in cells, and nodal values are interpolated there. Within a hole
the interpolation is extended from the rim by mean value coordinates (K. Hormann and M. S. Floater,
ACM Transactions on Graphics 25, 2006). They reproduce linear functions. The extension is continuous
at the rim if its edges are straight: curved edges are replaced by straight ones.

**Transfer.** Section 2.2 of the paper has two ways from a film pressure to nodal forces. The mortar
(14) gives pressures at the nodes of the bore, whose forces are (15). The conservative transfer
integrates the film's pressure times the shape functions of the bore: resultant force and moment are
those of the film to round-off. Displacements are interpolated to the Gauss points of the film by
the shape functions of the bore, which is the transpose of the conservative transfer: force and gap
are then conjugate. With the mortar they are conjugate up to the error of the projection. Integrals
are computed over the common refinement of both meshes: triangles that tile all intersections of
their cells.
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

#: Largest distance of a node from its position in an affine cell, in reference coordinates.
SHAPE_TOLERANCE = 1e-6

#: Largest such distance of a mid-side node on the rim of a hole, which follows the curved rim.
RIM_TOLERANCE = 0.2


def unwrap(angle: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Angles [rad] shifted by whole turns to within half a turn of the angles `near`."""
    return angle - TURN * np.round((angle - near) / TURN)


@dataclass(frozen=True, eq=False)
class Surface:
    """Mesh of a full cylinder about the z axis, in the plane of angle and height.

    Attributes
    ----------
    nodes
        Angle [rad] and height [m] of the nodes, shape (m, 2). Angles may differ by whole turns:
        those of one cell are shifted to lie together.
    cells
        Node numbers of each cell, shape (c, k): corners, edge midpoints, centre, in
        dolfinx order, as `FilmGrid.cell_nodes`.
    family
        ``"bilinear"``, ``"serendipity"``, ``"lagrange"`` (4, 8, 9 nodes on
        quadrilaterals) or ``"triangle"`` (6 nodes).

    Raises
    ------
    InterfaceMismatchError
        If the cells have curved edges, or do not cover the cylinder once except for holes.
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
                "circumference, not a whole turn: they must be narrower than half a turn, without "
                "overlaps and gaps"
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
                f"a surface node lies {defect:.1e} cell sizes from its position in an affine cell, "
                f"above the limit of {SHAPE_TOLERANCE:.0e}: quadrilaterals must be parallelograms "
                "in (phi, z), with mid-side nodes at the middle of the edges"
            )

    @classmethod
    def on_cylinder(cls, positions: np.ndarray, cells: np.ndarray, family: str) -> Surface:
        """Make a surface from Cartesian positions of its nodes, shape (m, 3) [m]."""
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
        """Area of all cells in the plane of angle and height [rad m]."""
        return float(self.determinants.sum() * (0.5 if self.triangular else 1.0))

    @cached_property
    def holes(self) -> list[BoreHole]:
        """Holes of the surface, which no cell covers."""
        if not self.covered < (1 - SHAPE_TOLERANCE) * TURN * self.width:
            return []
        angle, z = self.nodes.T
        try:
            holes = bore_holes(
                np.column_stack([np.cos(angle), np.sin(angle), z]), self.cells, self.family
            )
        except StructureError:  # the uncovered area is no hole
            return []
        return [hole.straight() for hole in holes] if self.family != "bilinear" else holes

    @property
    def triangular(self) -> bool:
        """Whether the cells are triangles."""
        return ELEMENTS[self.family].corners == 3

    @cached_property
    def cell_nodes(self) -> np.ndarray:
        """Angle and height of the nodes of every cell, shape (c, k, 2).

        Angles of one cell are within half a turn of that of its first node.
        """
        x = self.nodes[self.cells]
        x[:, :, 0] = unwrap(x[:, :, 0], x[:, :1, 0])
        return x

    @cached_property
    def corners(self) -> np.ndarray:
        """Angle and height of the corners of every cell in dolfinx order, (c, 3 or 4, 2)."""
        return self.cell_nodes[:, : 3 if self.triangular else 4]

    @cached_property
    def jacobians(self) -> np.ndarray:
        """Derivative of (phi, z) with respect to the reference coordinates, shape (c, 2, 2)."""
        first = self.corners[:, 0]
        return np.stack([self.corners[:, 1] - first, self.corners[:, 2] - first], axis=2)

    @cached_property
    def determinants(self) -> np.ndarray:
        """Area of every cell [rad m] over the area of the reference cell, shape (c,)."""
        return np.abs(np.linalg.det(self.jacobians))

    @cached_property
    def _inverse_transposes(self) -> np.ndarray:
        return np.linalg.inv(self.jacobians).swapaxes(1, 2)

    def reference(self, cells: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Reference coordinates of n points in each of p cells, shape (p, n, 2).

        `cells` are the indices of the cells, shape (p,); `points` have angles and heights, shape
        (p, n, 2).
        """
        offsets = points - self.corners[:, 0][cells][:, None]
        return offsets @ self._inverse_transposes[cells]

    @cached_property
    def centres(self) -> np.ndarray:
        """Angle and height of the centre of every cell, shape (c, 2)."""
        return self.corners.mean(axis=1)


#: Largest distance of a located point from its cell, in reference coordinates.
OUTSIDE_TOLERANCE = 1e-6

#: Number of triangles over which integrals are computed at once.
BLOCK = 20_000


def near_pairs(surface: Surface, points: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Find pairs of a cell and a point for which the cell may overlap an object around the point.

    Parameters
    ----------
    surface
        Surface with the cells.
    points
        Angle and height of the points, shape (p, 2).
    reach
        Radius of an object around each point, with heights scaled as in `scaled_reach`; 0 for the
        points alone.

    Returns
    -------
    cells, points : numpy.ndarray
        Indices of cells and points, shape (pairs,) each.
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
    """Factor from heights to angles with which cells are about as wide as high [rad/m]."""
    extents = np.ptp(surface.corners, axis=1).mean(axis=0)
    return extents[0] / extents[1]


def scaled_reach(surface: Surface, other: Surface) -> float:
    """Largest distance of a corner from the centre of its cell, in all cells of `other` [rad].

    Heights are multiplied by the factor with which cells of `surface` are about as wide as high.
    """
    offsets = (other.corners - other.centres[:, None]) * [1.0, _scale(surface)]
    return float(np.linalg.norm(offsets, axis=2).max())


def locate(surface: Surface, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the cell of each point, and the reference coordinates of the point in this cell.

    Parameters
    ----------
    surface
        Surface with the cells.
    points
        Angle and height of the points, shape (p, 2); angles may differ by whole turns.

    Returns
    -------
    cells : numpy.ndarray
        Index of the cell of each point, shape (p,).
    reference : numpy.ndarray
        Reference coordinates of each point, shape (p, 2).

    Raises
    ------
    InterfaceMismatchError
        If a point lies outside all cells.
    """
    cell, point = near_pairs(surface, points, 0.0)
    x = points[point]
    x[:, 0] = unwrap(x[:, 0], surface.centres[cell, 0])
    xi = surface.reference(cell, x[:, None])[:, 0]
    far = 1 - xi.sum(axis=1) if surface.triangular else (1 - xi).min(axis=1)
    # A point on a common edge lies in several cells, up to round-off: the cell in which it lies
    # deepest is chosen.
    depth = np.minimum(xi.min(axis=1), far)
    order = np.lexsort((depth, point))
    last = np.append(np.flatnonzero(np.diff(point[order])), len(order) - 1)[: len(order)]
    best = order[last]
    inside = depth[best] >= -OUTSIDE_TOLERANCE
    if np.count_nonzero(inside) < len(points):
        missing = np.setdiff1d(np.arange(len(points)), point[best[inside]])[0]
        low, high = surface.bounds
        raise InterfaceMismatchError(
            f"a point at z = {points[missing, 1]:.6g} m lies outside the surface, which reaches "
            f"from z = {low:.6g} to {high:.6g} m"
        )
    return cell[best], xi[best]


def interpolation_matrix(surface: Surface, phi: np.ndarray, z: np.ndarray) -> sparse.csr_matrix:
    """Matrix from nodal values of a surface to values at points.

    Parameters
    ----------
    surface
        Surface with m nodes.
    phi, z
        Angles [rad] and heights [m] of the points, shape (p,) each.

    Returns
    -------
    scipy.sparse.csr_matrix
        Shape functions at the points, extended into holes from their rims, shape (p, m).

    Raises
    ------
    InterfaceMismatchError
        If a point lies outside all cells and holes.
    """
    points = np.column_stack([phi, z])
    if surface.holes:
        return _around_holes(surface, points)
    return _within(surface, points)


def _within(surface: Surface, points: np.ndarray) -> sparse.csr_matrix:
    """Shape functions at points (p, 2) within cells, shape (p, m)."""
    cells, xi = locate(surface, points)
    values = ELEMENTS[surface.family].shapes(xi)
    starts = np.arange(0, values.size + 1, values.shape[1])
    shape = (len(cells), len(surface.nodes))
    return sparse.csr_matrix((values.ravel(), surface.cells[cells].ravel(), starts), shape)


def _around_holes(surface: Surface, points: np.ndarray) -> sparse.csr_matrix:
    """Shape functions at points (p, 2), shape (p, m); in holes, the extension from the rim."""
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
    """Mean value coordinates of points (p, 2) within a polygon (r, 2), shape (p, r).

    Points and polygon are angles and heights; `scale` is a factor on heights [rad/m].
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


#: Largest difference in height between the ends of the two meshes, relative to the width.
WIDTH_TOLERANCE = 1e-8

#: Largest relative difference between the area of all intersections and that of the cylinder.
AREA_TOLERANCE = 1e-10

#: Area over that of the reference cell below which a triangle is round-off of adjacent cells.
SLIVER = 1e-15


@dataclass(frozen=True, eq=False)
class Overlay:
    """Common refinement of two meshes: t triangles, each within one cell of either mesh.

    Attributes
    ----------
    structure_cells, film_cells
        Indices of the cells of bore and film in which each triangle lies, shape (t,).
    on_structure, on_film
        Corners of each triangle in the reference coordinates of these cells, shape (t, 3, 2).
    areas
        Area of each triangle, shape (t,) [rad m].
    """

    structure_cells: np.ndarray
    film_cells: np.ndarray
    on_structure: np.ndarray
    on_film: np.ndarray
    areas: np.ndarray


def overlay(structure: Surface, film: Surface) -> Overlay:
    """Intersect the cells of two meshes of one cylinder.

    Cells of the film are clipped in the reference coordinates of cells of the structure, in which
    the clipping lines are the same for all pairs.

    Raises
    ------
    InterfaceMismatchError
        If the meshes do not cover the same cylinder.
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
            f"the area of all intersections of film and bore cells has a relative difference of "
            f"{defect:.1e} from the area of the bore, above the limit of {AREA_TOLERANCE:.0e}: "
            "cells of one mesh overlap"
        )
    return result


def _check_ends(structure: Surface, film: Surface) -> None:
    ends = np.array([structure.bounds, film.bounds])
    if not np.abs(ends[1] - ends[0]).max() <= WIDTH_TOLERANCE * structure.width:
        raise InterfaceMismatchError(
            f"the film mesh is {film.width:.9g} m wide, from z = {ends[1, 0]:.9g} m, but the bore "
            f"mesh is {structure.width:.9g} m wide, from z = {ends[0, 0]:.9g} m: give the film the "
            "same ends"
        )


def _clip_to_cell(polygons: np.ndarray, triangular: bool) -> np.ndarray:
    """Parts of convex polygons (p, n, 2) within the reference cell; vertices may repeat."""
    lines = [([1, 0], 0), ([0, 1], 0)]
    lines += [([-1, -1], 1)] if triangular else [([-1, 0], 1), ([0, -1], 1)]
    for direction, offset in lines:
        polygons = _clip(polygons, polygons @ np.array(direction, dtype=float) + offset)
    return polygons


def _clip(polygons: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Parts of convex polygons (p, n, 2) in which a linear function is not negative.

    `side`, shape (p, n), has the values of the function at the vertices. The algorithm is that of
    Sutherland and Hodgman, Comm. ACM 17 (1974), for all polygons at once. A cut adds at most one
    vertex; polygons with fewer vertices repeat their first one.
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
    """Triangles (t, 3, 2) that tile convex polygons (p, n, 2), and index of the polygon of each.

    Triangles of a polygon share its first vertex; degenerate ones are omitted.
    """
    size = polygons.shape[1]
    fan = np.stack([polygons[:, [0, i, i + 1]] for i in range(1, size - 1)], axis=1)
    owner = np.repeat(np.arange(len(polygons)), size - 2)
    triangles = fan.reshape(-1, 3, 2)
    real = _areas(triangles) > SLIVER
    return triangles[real], owner[real]


def triangle_rule(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Quadrature rule on a triangle that is exact for polynomials up to a total degree.

    Returned are the barycentric coordinates of q points, shape (q, 3), and their weights of sum 1,
    shape (q,).
    """
    points, weights = basix.make_quadrature(basix.CellType.triangle, degree)
    barycentric = np.column_stack([1 - points.sum(axis=1), points])
    return barycentric, weights / weights.sum()


#: Weights of three Gauss points on the unit interval.
GAUSS_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0

#: Relative round-off of the area of a film cell that is summed over its parts.
WHOLE = 1e-9


class Mortar:
    """L2 projection of film pressures onto the mesh of the bore, ``P_s = H_sf P_f`` (14).

    ``H = D^-1 M`` with ``D = int N_s N_s dA`` and ``M = int N_s N_f dA``, with the shape functions
    N_s of the bore and N_f of the film. M is integrated exactly over the intersections of the cells
    of both meshes. Functions that both meshes can represent are reproduced, and the integral of
    every pressure is preserved. H itself is dense and is not formed.

    Parameters
    ----------
    structure
        Mesh of the bore, m nodes, whose nodal pressures give the forces (15).
    film
        Film mesh, k nodes.
    radius
        Bore radius [m].

    Attributes
    ----------
    mass, coupling
        Sparse matrices D, shape (m, m), and M, shape (m, k) [m^2].

    Raises
    ------
    InterfaceMismatchError
        If the meshes do not cover the same cylinder.
    """

    def __init__(self, structure: Surface, film: Surface, radius: float):
        self.mass = radius * _coupling(structure, structure)
        self.coupling = radius * _coupling(structure, film)
        self._factor = splu(self.mass.tocsc())

    def to_structure(self, pressures: np.ndarray) -> np.ndarray:
        """Pressures at the m nodes of the bore, projected from pressures at the k film nodes.

        `pressures` has the shape (k,) or (k, columns), the result (m,) or (m, columns).
        """
        return self._factor.solve(self.coupling @ pressures)


def _coupling(structure: Surface, film: Surface) -> sparse.csr_matrix:
    """Matrix ``int N_s N_f dphi dz``, shape (m, k), integrated over intersections of cells.

    N_s are the shape functions of the m nodes of the bore, N_f those of the k nodes of the film.
    """
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
    """Factors on the weights of a film's Gauss points that exclude holes of a bore from integrals.

    With these factors the Gauss rule integrates all biquadratic functions exactly over the part of
    a film cell outside the holes. The pressure of the film then acts on the remaining surface.

    Parameters
    ----------
    structure
        Mesh of the bore, whose holes are polygons.
    film
        Film mesh.
    points
        3 x 3 Gauss points of the unit cell, shape (9, 2).

    Returns
    -------
    numpy.ndarray
        Factors [-], shape (cells, 9); 1 for cells that no hole touches.
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
    """Matrix from displacements u of bore nodes to gap changes ``n . N_s u`` at points of a film.

    N_s are the shape functions of the bore, n is its outward normal.

    Parameters
    ----------
    structure
        Mesh of the bore, m nodes.
    phi, z
        Angles [rad] and heights [m] of the points, shape (p,) each.

    Returns
    -------
    scipy.sparse.csr_matrix
        Matrix, shape (p, 3 m), with the columns ``3 node + component``.
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
