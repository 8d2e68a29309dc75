"""Reynolds equation (1) on the bore, dimensionless, as UFL forms.

Unknown ``P = p / p_s`` with ``p_s = 12 eta Omega (R / c)^2``; gap ``H = h / c``;
time in units of ``1 / Omega``; lengths in units of the bore radius ``R``.

The film mesh rides on the bore. With ``W`` the displacement of the bore
relative to the shaft, divided by the clearance,

    H = 1 + n . W,        dH/dt = n . dW/dt,

``n`` the outward normal of the bore: for a rigid bore ``W = -e / c`` this is
(3)-(5), ``h = c - e_r``. Kept to leading order in ``c / R``: the term
``e_t^2 / (2 R_1)`` of (4) and the stretching of the bore are smaller than the
gap by that factor. Relative to the bore the mean surface speed is half of
``shaft speed - dw/dt . t``, the ``v`` components of (6).
"""

from __future__ import annotations

from dataclasses import dataclass

import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh
from petsc4py import PETSc
from ufl.core.expr import Expr

from fenics_ehd import compat
from fenics_ehd.elements import quadratic_element

#: 3 Gauss points a direction, the rule of the bore load matrix: it integrates
#: pressure force and squeeze flow exactly. 4 points change the load of a rigid
#: bearing (L/D = 1, 20 x 5 cells) by 0.03 % at eccentricity 0.9.
QUADRATURE_DEGREE = 5


@dataclass(frozen=True)
class ReynoldsForms:
    """Spaces, coefficients and compiled forms of one film mesh.

    ``stiffness``: A of (11), ``source``: b, ``gap_derivative``: the derivative
    of ``A P - b`` in the direction of nodal ``W`` plus `rate_shift` times that
    of nodal ``dW/dt``; ``speed_derivative``: the one with respect to the shaft
    speed; ``couette``: the Couette part of b alone; ``mass``: N of (11).
    """

    pressure: fem.Function
    displacement: fem.Function
    displacement_rate: fem.Function
    shaft_speed: fem.Constant
    rate_shift: fem.Constant
    stiffness: compat.CompiledForm
    source: compat.CompiledForm
    gap_derivative: compat.CompiledForm
    speed_derivative: compat.CompiledForm
    couette: compat.CompiledForm
    mass: compat.CompiledForm


def surface_frame(mesh: Mesh) -> tuple[Expr, Expr]:
    """Outward normal of the bore and circumferential direction, as UFL vectors.

    The normal is that of the discrete surface, as `FacetNormal` gives it on the
    part: gap and pressure force are then conjugate to round-off.
    """
    jacobian = ufl.Jacobian(mesh)
    normal = ufl.cross(jacobian[:, 0], jacobian[:, 1])
    normal = normal / ufl.sqrt(ufl.dot(normal, normal))
    tangent = ufl.cross(ufl.as_vector((0, 0, 1)), normal)
    return normal, tangent


def reynolds_forms(
    mesh: Mesh, radius: float, clearance: float, pressure_family: str, displacement_family: str
) -> ReynoldsForms:
    """Build and compile the forms.

    Parameters
    ----------
    mesh
        Cylinder from `cylinder_mesh`.
    radius, clearance
        Bore radius ``R`` and radial clearance ``c`` [m].
    pressure_family, displacement_family
        ``"serendipity"`` or ``"lagrange"``, for pressure and bore displacement.
    """
    cell = "quadrilateral"
    pressures = compat.functionspace(mesh, quadratic_element(pressure_family, cell))
    displacements = compat.functionspace(mesh, quadratic_element(displacement_family, cell, (3,)))
    p, w, w_rate = (fem.Function(v) for v in (pressures, displacements, displacements))
    speed, shift = (fem.Constant(mesh, PETSc.ScalarType(0.0)) for _ in range(2))
    trial, test = ufl.TrialFunction(pressures), ufl.TestFunction(pressures)
    normal, tangent = surface_frame(mesh)

    dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": QUADRATURE_DEGREE})
    area = 1.0 / radius**2
    gap = 1 + ufl.inner(normal, w)
    mean_speed = 0.5 * (speed - (clearance / radius) * ufl.inner(w_rate, tangent))

    def poiseuille(pressure: Expr) -> ufl.Form:
        return gap**3 * ufl.inner(ufl.grad(pressure), ufl.grad(test)) * dx

    couette = area * radius * gap * mean_speed * ufl.inner(tangent, ufl.grad(test)) * dx
    squeeze = area * ufl.inner(normal, w_rate) * test * dx
    residual = poiseuille(p) - couette + squeeze
    direction = ufl.TrialFunction(displacements)
    gap_derivative = ufl.derivative(residual, w, direction) + shift * ufl.derivative(
        residual, w_rate, direction
    )
    # The residual is affine in the shaft speed.
    speed_derivative = -area * radius * gap * 0.5 * ufl.inner(tangent, ufl.grad(test)) * dx
    return ReynoldsForms(
        pressure=p,
        displacement=w,
        displacement_rate=w_rate,
        shaft_speed=speed,
        rate_shift=shift,
        stiffness=fem.form(poiseuille(trial)),
        source=fem.form(couette - squeeze),
        gap_derivative=fem.form(gap_derivative),
        speed_derivative=fem.form(speed_derivative),
        couette=fem.form(couette),
        mass=fem.form(area * trial * test * dx),
    )
