"""What the cells of a solid must be, and how good they are."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np

from fenics_ehd.base.errors import MeshError
from fenics_ehd.fem.solid import CORNERS, EDGES, REFERENCE, Solid, shape_functions

#: Where cells are looked at: Gauss points of three a direction, and Keast's 11 of a tetrahedron.
_GAUSS = np.array(list(product((0.5 - 0.15**0.5, 0.5, 0.5 + 0.15**0.5), repeat=3)))
_PAIR = 0.25 + 0.25 * np.sqrt(5 / 14) * np.array([1, -1])
_KEAST = np.array(
    [
        (0.25, 0.25, 0.25),
        *(np.where(np.arange(4) == k, 11 / 14, 1 / 14)[1:] for k in range(4)),
        *(_PAIR[[i, j, k]] for i, j, k in product((0, 1), repeat=3) if 0 < i + j + k < 3),
    ]
)
_POINTS = {"tet": _KEAST, "hex": _GAUSS}


def corner_volumes(solid: Solid) -> np.ndarray:
    """Smallest volume that the edges at a corner of a cell span, of each cell, shape (c,).

    Relative to the product of their lengths: 1 at the corners of a cube, 0.71 in an even
    tetrahedron; in a cell turned inside out it is negative.
    """
    x = solid.points[solid.cells[:, : CORNERS[solid.kind]]]
    edges = EDGES[solid.kind]
    found = []
    for corner in range(CORNERS[solid.kind]):
        ends = [a + b - corner for a, b in edges if corner in (a, b)]
        rays = x[:, ends] - x[:, corner, None]
        lengths = np.linalg.norm(rays, axis=2).prod(axis=1)
        sign = np.sign(np.linalg.det(REFERENCE[solid.kind][ends] - REFERENCE[solid.kind][corner]))
        found.append(sign * np.linalg.det(rays) / np.maximum(lengths, 1e-300))
    return np.min(found, axis=0)


def inside_out(solid: Solid) -> np.ndarray:
    """Whether a cell is turned inside out or flat, by its corners or its curvature, shape (c,)."""
    wrong = corner_volumes(solid) <= 0
    x = solid.points[solid.cells]
    for point in _POINTS[solid.kind]:
        # Exact of polynomials, by a step into the complex plane.
        steps = point + 1e-30j * np.eye(3)
        slopes = shape_functions(steps, solid.kind).imag / 1e-30
        wrong |= np.linalg.det(slopes @ x) <= 0
    return wrong


def require_sound_cells(solid: Solid, path: str | Path) -> None:
    """Refuse what is no solid; Gmsh and dolfinx die of faces of more than two cells.

    Raises
    ------
    MeshError
        Cells are there twice, overlap or are turned inside out; it says how many.
    """
    corners = solid.cells[:, : CORNERS[solid.kind]]
    count = len(corners)
    if twice := count - len(np.unique(np.sort(corners, axis=1), axis=0)):
        raise MeshError(f"{path}: {twice} of {count} cells are there twice: export the part once")
    if many := solid.overlaps():
        raise MeshError(f"{path}: {many} faces are shared by more than two cells: mesh it again")
    if wrong := int(inside_out(solid).sum()):
        remedy = "take smaller ones, more cells around and along its bores"
        if wrong == count:
            remedy = "list their nodes the other way round"
        raise MeshError(
            f"{path}: {wrong} of {count} cells are turned inside out, by their corners or by the "
            f"curvature of the surface: {remedy}"
        )
