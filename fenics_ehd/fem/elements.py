"""Families of quadratic finite elements.

Quadrilaterals and hexahedra have two families. ``serendipity`` has 8 nodes on the quadrilateral and
20 on the hexahedron, at vertices and edge midpoints. It contains all monomials of superlinear
degree at most 2 (Arnold and Awanou, Found. Comput. Math. 11, 2011). dolfinx's own serendipity
element is not nodal, so that this one is a custom element. ``lagrange`` has 9 and 27 nodes.

On triangles (6 nodes) and tetrahedra (10 nodes) both families are the same.
"""

from __future__ import annotations

import itertools

import basix
import numpy as np

from fenics_ehd.base import compat
from fenics_ehd.reduction.elements import ELEMENTS, SOLIDS, NodalElement

FAMILIES = ("serendipity", "lagrange")

#: Cells for which both quadratic families are the same.
SIMPLICES = ("triangle", "tetrahedron")


def _expansion_coefficients(cell: basix.CellType, element: NodalElement) -> np.ndarray:
    """Coefficients of shape functions in basix's orthonormal basis of degree 2.

    The matrix has one row for each shape function.
    """
    points, weights = basix.make_quadrature(cell, 6)
    legendre = basix.tabulate_polynomials(basix.PolynomialType.legendre, cell, 2, points)
    return element.shapes(points).T @ (weights * legendre).T


def _point_evaluations(
    cell: basix.CellType,
) -> tuple[list[list[np.ndarray]], list[list[np.ndarray]]]:
    """Interpolation points of an element, and its interpolation matrices, as basix needs them.

    The points are the vertices and edge midpoints of the cell. The matrices are identities, because
    degrees of freedom are values at these points.
    """
    geometry = basix.geometry(cell)
    points = []
    matrices = []
    topology = [*basix.topology(cell), []][:4]
    for entities, size in zip(topology, (1, 1, 0, 0), strict=True):
        points.append([geometry[entity].mean(axis=0)[None][:size] for entity in entities])
        matrices.append([np.ones((size, 1, size, 1)) for _ in entities])
    return points, matrices


def quadratic_element(family: str, cell: str, shape: tuple[int, ...] = ()) -> compat.Element:
    """UFL element of a quadratic family.

    Parameters
    ----------
    family
        ``"serendipity"`` (8 or 20 nodes) or ``"lagrange"`` (9 or 27 nodes). On triangles (6
        nodes) and tetrahedra (10 nodes) both are the same.
    cell
        ``"quadrilateral"``, ``"hexahedron"``, ``"triangle"`` or ``"tetrahedron"``.
    shape
        ``()`` for a scalar field, ``(3,)`` for a displacement.
    """
    if family not in FAMILIES:
        raise ValueError(f"element family {family!r} is not one of {', '.join(FAMILIES)}")
    if family == "lagrange" or cell in SIMPLICES:
        return compat.lagrange_element(cell, 2, shape)
    cell_type = getattr(basix.CellType, cell)
    element = SOLIDS["hex"] if cell == "hexahedron" else ELEMENTS["serendipity"]
    coefficients = _expansion_coefficients(cell_type, element)
    points, matrices = _point_evaluations(cell_type)
    return compat.custom_element(cell, coefficients, points, matrices, 1, 2, shape)


def solid_element(cell: str, size: int) -> NodalElement:
    """Element of a solid cell with `size` nodes in dolfinx order.

    The cell is ``"hexahedron"`` with 8, 20 or 27 nodes, or ``"tetrahedron"`` with 4 or 10.
    """
    kind = getattr(basix.CellType, cell)
    corners = basix.geometry(kind)
    entities = itertools.chain.from_iterable(basix.topology(kind))
    nodes = np.array([corners[entity].mean(axis=0) for entity in entities])[:size]
    family = {4: "simplex", 10: "simplex", 20: "serendipity"}.get(size, "lagrange")
    return NodalElement.of(nodes, family, 1 if size == len(corners) else 2)
