"""The quadratic elements of parts.

Two families on quadrilaterals and hexahedra, one on triangles and tetrahedra.

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

FAMILIES = ("serendipity", "lagrange")

#: Cells on which every quadratic family is the same.
SIMPLICES = ("triangle", "tetrahedron")


def superlinear_degree(exponents: tuple[int, ...]) -> int:
    """Degree of a monomial that counts only the variables entering at least squared."""
    return sum(e for e in exponents if e > 1)


def _expansion_coefficients(cell: basix.CellType, dimension: int) -> np.ndarray:
    """Serendipity monomials in basix's orthonormal basis of degree 2."""
    points, weights = basix.make_quadrature(cell, 6)
    legendre = basix.tabulate_polynomials(basix.PolynomialType.legendre, cell, 2, points)
    exponents = [
        e for e in itertools.product(range(3), repeat=dimension) if superlinear_degree(e) <= 2
    ]
    monomials = np.array(
        [np.prod([points[:, d] ** k for d, k in enumerate(e)], axis=0) for e in exponents]
    )
    return monomials @ (weights * legendre).T


def _point_evaluations(
    cell: basix.CellType, dimension: int
) -> tuple[list[list[np.ndarray]], list[list[np.ndarray]]]:
    """Points and identity interpolation matrices at vertices and edge midpoints."""
    geometry, topology = basix.geometry(cell), basix.topology(cell)
    points: list[list[np.ndarray]] = []
    matrices: list[list[np.ndarray]] = []
    for entity_dimension in range(4):
        entities = topology[entity_dimension] if entity_dimension <= dimension else []
        nodal = entity_dimension < 2
        points.append(
            [
                geometry[entity].mean(axis=0)[None, :] if nodal else np.zeros((0, dimension))
                for entity in entities
            ]
        )
        size = int(nodal)
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
    dimension = len(basix.topology(cell_type)) - 1
    coefficients = _expansion_coefficients(cell_type, dimension)
    points, matrices = _point_evaluations(cell_type, dimension)
    return compat.custom_element(cell, coefficients, points, matrices, 1, 2, shape)
