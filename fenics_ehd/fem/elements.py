"""Quadratic families of finite elements.

Quadrilaterals and hexahedra have two families, triangles and tetrahedra one.

``serendipity``: 8 nodes on the quadrilateral, 20 on the hexahedron, all
monomials of superlinear degree at most 2 (Arnold and Awanou, Found. Comput.
Math. 11, 2011), evaluated at vertices and edge midpoints. dolfinx's own
serendipity element is not nodal, so this one is built as a custom element.
``lagrange``: 9 and 27 nodes. On triangles and tetrahedra, 6 and 10 nodes, the
two are the same.
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
    """Shape functions in basix's orthonormal basis of degree 2."""
    points, weights = basix.make_quadrature(cell, 6)
    legendre = basix.tabulate_polynomials(basix.PolynomialType.legendre, cell, 2, points)
    return element.shapes(points).T @ (weights * legendre).T


def _point_evaluations(
    cell: basix.CellType,
) -> tuple[list[list[np.ndarray]], list[list[np.ndarray]]]:
    """Points at vertices and edge midpoints, and interpolation matrices, which are identities."""
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
        ``"serendipity"`` (8 or 20 nodes) or ``"lagrange"`` (9 or 27 nodes);
        either gives the 6 or 10 nodes of triangle and tetrahedron.
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
    """Solid cell with `size` nodes in dolfinx order.

    ``"hexahedron"`` with 8, 20 or 27 nodes, ``"tetrahedron"`` with 4 or 10.
    """
    kind = getattr(basix.CellType, cell)
    corners = basix.geometry(kind)
    entities = itertools.chain.from_iterable(basix.topology(kind))
    nodes = np.array([corners[entity].mean(axis=0) for entity in entities])[:size]
    family = {4: "simplex", 10: "simplex", 20: "serendipity"}.get(size, "lagrange")
    return NodalElement.of(nodes, family, 1 if size == len(corners) else 2)
