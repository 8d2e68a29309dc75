"""The common refinement of two meshes of one cylinder: triangles that tile all intersections."""

from __future__ import annotations

from dataclasses import dataclass

import basix
import numpy as np

from fenics_ehd.base.errors import InterfaceMismatchError
from fenics_ehd.film.surface import TURN, Surface, unwrap
from fenics_ehd.film.surface_reading import near_pairs, scaled_reach

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
    cell, other, shift = cell[touching], other[touching], shift[touching]
    triangles, pair = _triangulate(_clip_to_cell(polygons[touching], structure.triangular))
    cell, other, shift = cell[pair], other[pair], shift[pair]
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
    following, next_side = np.roll(polygons, -1, axis=1), np.roll(side, -1, axis=1)
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
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
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
