"""Weak form of the Reynolds equation on one film cell, tabulated Gauss point by Gauss point.

Dimensionless: ``P = p / p_s`` with ``p_s = 12 eta Omega (R / c)^2``, gap
``H = h / c``, time in units of ``1 / Omega``, lengths in units of the bore
radius ``R``. With the flux and the source

    f = k grad P - rho H V e_phi,     s = d(rho H) / dt,     k = rho H^3 / eta

the weak form of (1) and its derivative along a pressure trial function u are

    r(v)    = int f . grad v + s v
    a(u, v) = int (k_phi u_phi + k_c u) v_phi + (k_z u_z + k_d u) v_z + k_m u v

that is, in UFL, on a mesh of the unwrapped bore with u and v of the pressure's space,

    r = ((k * P.dx(0) - rho * H * V) * v.dx(0) + k * P.dx(1) * v.dx(1) + s * v) * dx
    a = ((k_phi * u.dx(0) + k_c * u) * v.dx(0) + (k_z * u.dx(1) + k_d * u) * v.dx(1)
         + k_m * u * v) * dx

Both are linear in values of their coefficients at the Gauss points: a film of any number of cells
is assembled by multiplying what is tabulated here, on a unit cell, with the coefficients
(`fenics_ehd.film.assembly`). The tests compare it with what dolfinx assembles.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from fenics_ehd.reduction.surface_elements import ELEMENTS

#: Gauss points a direction, the rule of the bore load matrix: it integrates
#: pressure force and squeeze flow exactly. 4 points change the load of a rigid
#: bearing (L/D = 1, 20 x 5 cells) by 0.03 % at eccentricity 0.9.
GAUSS_POINTS = 3


@dataclass(frozen=True, eq=False)
class CellTensors:
    """Shape functions and integrals on the unit cell, (q Gauss points, k nodes).

    Attributes
    ----------
    points, weights
        Gauss points, shape (q, 2), and weights, shape (q,).
    value, around, along
        Shape functions and their derivatives in the two directions at the Gauss
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
    points, weights = ELEMENTS[family].rule(GAUSS_POINTS)
    value, (around, along) = ELEMENTS[family].tabulate(points)
    vectors = [weights[:, None] * shape for shape in (around, along, value)]
    pairs = [(around, around), (along, along), (around, value), (along, value), (value, value)]
    matrices = [np.einsum("q,qi,qj->qij", weights, v, u) for v, u in pairs]
    return CellTensors(points, weights, value, around, along, *vectors, *matrices)
