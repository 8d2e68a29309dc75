"""Weak form of the Reynolds equation on one film cell, tabulated Gauss point by Gauss point.

Dimensionless: ``P = p / p_s`` with ``p_s = 12 eta Omega (R / c)^2``, gap
``H = h / c``, time in units of ``1 / Omega``, lengths in units of the bore
radius ``R``. With the flux and the source

    f = k grad P - rho H V e_phi,     s = d(rho H) / dt,     k = rho H^3 / eta

the weak form of (1) and its derivative along a pressure trial function u are

    r(v)    = int f . grad v + s v
    a(u, v) = int (k_phi u_phi + k_c u) v_phi + (k_z u_z + k_d u) v_z + k_m u v

Both are linear in values of their coefficients at the Gauss points. dolfinx
compiles them once, on a unit cell, and evaluates them for a unit value at one
Gauss point after another; a film of any number of cells is then assembled by
multiplying these tensors with the coefficients (`fenics_ehd.film.assembly`),
which for the small meshes of a bearing is several times faster than running
the compiled kernel again cell by cell.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from fenics_ehd import compat
from fenics_ehd.elements import quadratic_element

#: 3 Gauss points a direction, the rule of the bore load matrix: it integrates
#: pressure force and squeeze flow exactly. 4 points change the load of a rigid
#: bearing (L/D = 1, 20 x 5 cells) by 0.03 % at eccentricity 0.9.
QUADRATURE_DEGREE = 5


@dataclass(frozen=True, eq=False)
class CellTensors:
    """Shape functions and integrals on the unit cell, (q Gauss points, k nodes).

    Attributes
    ----------
    points, weights
        Gauss points, shape (q, 2), and weights, shape (q,).
    value, around, along
        Shape functions and their slopes in the two directions at the Gauss
        points, shape (q, k).
    flux_around, flux_along, source
        Element vectors of ``r`` for unit ``f_phi``, ``f_z``, ``s`` at one point, shape (q, k).
    stiffness_around, stiffness_along, convection_around, convection_along, mass
        Element matrices of ``a`` for unit ``k_phi``, ``k_z``, ``k_c``, ``k_d``,
        ``k_m`` at one point, test functions first, shape (q, k, k).
    """

    points: np.ndarray
    weights: np.ndarray
    value: np.ndarray
    around: np.ndarray
    along: np.ndarray
    flux_around: np.ndarray
    flux_along: np.ndarray
    source: np.ndarray
    stiffness_around: np.ndarray
    stiffness_along: np.ndarray
    convection_around: np.ndarray
    convection_along: np.ndarray
    mass: np.ndarray


@cache
def cell_tensors(family: str) -> CellTensors:
    """Tabulate the weak form for an element family (``FilmGrid.family``)."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    geometry = compat.lagrange_element("quadrilateral", 1, (3,))
    mesh = compat.create_mesh(MPI.COMM_SELF, np.arange(4)[None, :], geometry, corners)
    space = compat.functionspace(mesh, _element(family))
    points = compat.functionspace(
        mesh, compat.quadrature_element("quadrilateral", QUADRATURE_DEGREE)
    )
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": QUADRATURE_DEGREE})

    f_phi, f_z, s = fluxes = [fem.Function(points) for _ in range(3)]
    residual = fem.form((f_phi * v.dx(0) + f_z * v.dx(1) + s * v) * dx)
    k_phi, k_z, k_c, k_d, k_m = mobilities = [fem.Function(points) for _ in range(5)]
    derivative = fem.form(
        ((k_phi * u.dx(0) + k_c * u) * v.dx(0) + (k_z * u.dx(1) + k_d * u) * v.dx(1) + k_m * u * v)
        * dx
    )
    order = compat.space_dofmap(space)[0]

    def vector() -> np.ndarray:
        return compat.fem_petsc().assemble_vector(residual).array[order]

    def matrix() -> np.ndarray:
        whole = compat.fem_petsc().assemble_matrix(derivative)
        whole.assemble()
        return whole.getValues(order, order)

    vectors = [_tabulate(coefficient, points, vector) for coefficient in fluxes]
    matrices = [_tabulate(coefficient, points, matrix) for coefficient in mobilities]
    weights = vectors[2].sum(axis=1)
    around, along, value = (tensor / weights[:, None] for tensor in vectors)
    gauss = value @ _node_coordinates(space, order)
    return CellTensors(gauss, weights, value, around, along, *vectors, *matrices)


def _element(family: str) -> compat.Element:
    if family == "bilinear":
        return compat.lagrange_element("quadrilateral", 1)
    return quadratic_element(family, "quadrilateral")


def _tabulate(
    coefficient: fem.Function, points: fem.FunctionSpace, assemble: Callable[[], np.ndarray]
) -> np.ndarray:
    """Integrals for a unit value of the coefficient at each Gauss point."""
    rows = []
    for dof in compat.space_dofmap(points)[0]:
        coefficient.x.array[:] = 0.0
        coefficient.x.array[dof] = 1.0
        rows.append(assemble())
    coefficient.x.array[:] = 0.0
    return np.array(rows)


def _node_coordinates(space: fem.FunctionSpace, order: np.ndarray) -> np.ndarray:
    return space.tabulate_dof_coordinates()[order, :2]
