"""Inertia of a flexible rod in its floating frame, with exact derivatives.

A material point lies at ``C1 + A(theta) p``, ``p = B s`` with
``s = (1, xi)`` and ``B`` the fields of `InertiaIntegrals`. In the rod's frame
its acceleration is

    p'' + A^T C1'' + 2 theta' S p' + theta'' S p + theta'^2 S S p:

relative, Coriolis, Euler and centrifugal terms, complete and without
approximation, because p is affine in xi. A free angle of the crank is the last
of xi; its field in B is zero, its generalised force ``C1_phi . A f`` with the resultant f.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fenics_ehd.multibody.crank import AngleSlopes, CrankMotion
from fenics_ehd.multibody.guide import RodAngle
from fenics_ehd.plane import rotation
from fenics_ehd.reduction.body import InertiaIntegrals


@dataclass(frozen=True, eq=False)
class InertiaForces:
    """Generalised inertia forces on ``xi`` and ``theta``.

    Attributes
    ----------
    on_xi, on_theta
        shape (n,), and a number.
    linearise
        Makes their slopes.
    """

    on_xi: np.ndarray
    on_theta: float
    linearise: Callable[[], tuple[np.ndarray, np.ndarray]]

    @cached_property
    def _slopes(self) -> tuple[np.ndarray, np.ndarray]:
        return self.linearise()

    @property
    def on_xi_slope(self) -> np.ndarray:
        """Total derivative of `on_xi` along xi, shape (n, n)."""
        return self._slopes[0]

    @property
    def on_theta_slope(self) -> np.ndarray:
        """Total derivative of `on_theta` along xi, shape (n,)."""
        return self._slopes[1]


def with_point_mass(inertia: InertiaIntegrals, point: np.ndarray, mass: float) -> InertiaIntegrals:
    """Inertia with a point mass fixed to a boundary point, shape of `point` (2, 3 + n).

    A piston whose pin stays on a line has no transverse acceleration, so it may
    be carried as a full point mass there.
    """
    spun = np.array([-point[1], point[0]])
    return InertiaIntegrals(
        mass=inertia.mass + mass * point.T @ point,
        spin=inertia.spin + mass * point.T @ spun,
        centrifugal=inertia.centrifugal + mass * spun.T @ spun,
    )


def inertia_forces(
    inertia: InertiaIntegrals,
    crank: CrankMotion,
    angle: RodAngle,
    state: tuple[np.ndarray, np.ndarray, np.ndarray],
    shifts: tuple[float, float],
) -> InertiaForces:
    """Virtual work of the inertia forces.

    Parameters
    ----------
    inertia
        Inertia integrals, the piston's mass included.
    crank, angle
        Motion of C1 and of the frame.
    state
        ``xi``, ``xi'``, ``xi''``, shape (2 + n,) each, one more with a free angle of the crank.
    shifts
        ``d xi' / d xi`` and ``d xi'' / d xi`` of the time integration formula.
    """
    xi, xi_rate, xi_acceleration = state
    m, g, c = inertia.mass, inertia.spin, inertia.centrifugal
    rate, acceleration = angle.rate, angle.acceleration
    s = np.concatenate([[1.0], xi])
    s_rate = np.concatenate([[0.0], xi_rate])
    carried = rotation(angle.angle).T @ crank.acceleration
    a = np.concatenate([[0.0], xi_acceleration])
    a[1:3] += carried

    # (S B)^T M B = -G
    g_s, g_rate, g_a = g @ s, g @ s_rate, g @ a
    c_s, c_rate = c @ s, c @ s_rate
    on_s = m @ a + 2 * rate * g_rate + acceleration * g_s - rate**2 * c_s
    on_theta = -s @ g_a + 2 * rate * (s @ c_rate) + acceleration * (s @ c_s)
    if crank.along is not None:
        on_s[-1] = _arm(crank.along, angle) @ on_s[1:3]

    def slopes() -> tuple[np.ndarray, np.ndarray]:
        alpha, beta = shifts
        # d(A^T C1'')/d theta = -S A^T C1''
        a_slope = np.zeros((len(s), len(xi)))
        a_slope[1:] = beta * np.eye(len(xi))
        a_slope[1:3] += np.outer([carried[1], -carried[0]], angle.angle_slope)
        if crank.along is not None:
            a_slope[1:3, -1] += rotation(angle.angle).T @ crank.along.acceleration
        on_s_slope = (
            m @ a_slope
            + (2 * rate * alpha + acceleration) * g[:, 1:]
            - rate**2 * c[:, 1:]
            + np.outer(2 * g_rate - 2 * rate * c_s, angle.rate_slope)
            + np.outer(g_s, angle.acceleration_slope)
        )
        on_theta_slope = (
            -g_a[1:]
            - (s @ g) @ a_slope
            + 2 * rate * (c_rate[1:] + alpha * c_s[1:])
            + 2 * acceleration * c_s[1:]
            + 2 * (s @ c_rate) * angle.rate_slope
            + (s @ c_s) * angle.acceleration_slope
        )
        if crank.along is not None:
            on_s_slope[-1] = _arm(crank.along, angle) @ on_s_slope[1:3]
            on_s_slope[-1] += on_s[1:3] @ _arm_slope(crank.along, angle)
        return on_s_slope[1:], on_theta_slope

    return InertiaForces(on_s[1:], float(on_theta), slopes)


def _arm(along: AngleSlopes, angle: RodAngle) -> np.ndarray:
    """What a resultant in the rod's frame does on the crank's angle, shape (2,) [m]."""
    return rotation(angle.angle).T @ along.position


def _arm_slope(along: AngleSlopes, angle: RodAngle) -> np.ndarray:
    """Derivative of `_arm` along xi, shape (2, n)."""
    arm = _arm(along, angle)
    slope = np.outer([arm[1], -arm[0]], angle.angle_slope)
    slope[:, -1] += rotation(angle.angle).T @ along.curvature
    return slope


def kinetic_energy(
    inertia: InertiaIntegrals,
    crank: CrankMotion,
    angle: RodAngle,
    xi: np.ndarray,
    xi_rate: np.ndarray,
) -> float:
    """Kinetic energy of the rod and the masses fixed to it [J]."""
    s = np.concatenate([[1.0], xi])
    velocity = np.concatenate([[0.0], xi_rate])
    velocity[1:3] += rotation(angle.angle).T @ crank.velocity
    return float(
        0.5 * velocity @ inertia.mass @ velocity
        + angle.rate * velocity @ inertia.spin @ s
        + 0.5 * angle.rate**2 * s @ inertia.centrifugal @ s
    )
