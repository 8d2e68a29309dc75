"""Inertia of a body in a planar floating frame, with exact derivatives.

A material point lies at ``x + A(theta) p`` with ``p = B s``, ``s = (0, 0, 1, q)`` and B the
fields of `InertiaIntegrals` in the order of ``(x, y, theta, q)``. In the body's frame its
acceleration is

    p'' + A^T x'' + 2 theta' S p' + theta'' S p + theta'^2 S S p:

relative, Coriolis, Euler and centrifugal terms, complete, because p is affine in q.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fenics_ehd.base.plane import rotation
from fenics_ehd.reduction.inertia import InertiaIntegrals


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of forces along coordinates, their rates and accelerations, (n, n) each."""

    position: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray


class FrameInertia:
    """Inertia forces on ``(x, y, theta, q)`` at one instant.

    Parameters
    ----------
    integrals
        Of the body, `in_order_of_coordinates`.
    coordinates, rates, accelerations
        shape (3 + n,).
    lift
        Added to the accelerations of x and y: gravity, against its pull, shape (2,) [m/s^2].
    """

    def __init__(
        self,
        integrals: InertiaIntegrals,
        coordinates: np.ndarray,
        rates: np.ndarray,
        accelerations: np.ndarray,
        lift: np.ndarray,
    ):
        self._integrals, self._frame_rates = integrals, rates[:3]
        self._turn = rotation(coordinates[2])
        self._omega, self._alpha = rates[2], accelerations[2]
        # s, s' and p'' + A^T x'' in the fields of the integrals.
        s, rate, acceleration = coordinates.copy(), rates.copy(), accelerations.copy()
        s[:2], s[2], rate[:3], acceleration[2] = 0.0, 1.0, 0.0, 0.0
        acceleration[:2] = (accelerations[:2] + lift) @ self._turn
        self._fields = s, rate, acceleration
        self._spun, self._drawn = integrals.spin @ s, integrals.centrifugal @ s

    @cached_property
    def _on_fields(self) -> np.ndarray:
        """Forces on x and y in the body's frame, moment, forces on q."""
        s, rate, acceleration = self._fields
        swung = 2 * self._omega * rate + self._alpha * s
        forces = self._integrals.mass @ acceleration + self._integrals.spin @ swung
        forces -= self._omega**2 * self._drawn
        # (S B)^T M B = -G, antisymmetric.
        forces[2] = self._drawn @ swung + self._spun @ acceleration
        return forces

    @property
    def forces(self) -> np.ndarray:
        """Generalised inertia forces, shape (3 + n,)."""
        forces = self._on_fields.copy()
        forces[:2] = self._turn @ forces[:2]
        return forces

    def derivatives(self) -> Derivatives:
        """Of `forces`."""
        s, rate, acceleration = self._fields
        omega, alpha = self._omega, self._alpha
        m, g, c = self._integrals.mass, self._integrals.spin, self._integrals.centrifugal
        g_s, c_s, c_rate = self._spun, self._drawn, c @ rate
        n = len(s)
        # x and y in the body's frame.
        parts = np.zeros((3, n, n))
        position, by_rate, by_acceleration = parts
        by_acceleration[:] = m
        by_acceleration[:, 2] = by_acceleration[2] = g_s
        by_acceleration[2, 2] = s @ c_s
        by_rate[:, 2] = 2 * (g @ rate - omega * c_s)
        by_rate[2, 2] = 2 * (s @ c_rate)
        if n > 3:
            by_rate[:, 3:] = 2 * omega * g[:, 3:]
            by_rate[2, 3:] = 2 * omega * c_s[3:]
            position[:, 3:] = alpha * g[:, 3:] - omega**2 * c[:, 3:]
            position[2, 3:] = (2 * (omega * c_rate + alpha * c_s) - g @ acceleration)[3:]
        # d(A^T x'')/d theta = -S A^T x''
        position[:, 2] = acceleration[1] * m[:, 0] - acceleration[0] * m[:, 1]
        position[0, 2] -= self._on_fields[1]
        position[1, 2] += self._on_fields[0]
        position[2, 2] = g_s[0] * acceleration[1] - g_s[1] * acceleration[0]
        # x and y at rest.
        parts[:, :2] = self._turn @ parts[:, :2]
        by_acceleration[:, :2] = by_acceleration[:, :2] @ self._turn.T
        return Derivatives(position, by_rate, by_acceleration)

    @property
    def kinetic_energy(self) -> float:
        """[J]."""
        s, rate, _ = self._fields
        velocity = rate.copy()
        velocity[:2] = self._frame_rates[:2] @ self._turn
        omega, i = self._omega, self._integrals
        return float(
            0.5 * velocity @ i.mass @ velocity
            + omega * velocity @ self._spun
            + 0.5 * omega**2 * s @ self._drawn
        )


def in_order_of_coordinates(integrals: InertiaIntegrals) -> InertiaIntegrals:
    """With the fields in the order ``(x, y, theta, q)``: the position moves with the angle."""
    order = np.arange(len(integrals.mass))
    order[:3] = 1, 2, 0
    names = ("mass", "spin", "centrifugal")
    return replace(integrals, **{n: getattr(integrals, n)[np.ix_(order, order)] for n in names})


def rigid_integrals(mass: float, inertia: float, centre: np.ndarray) -> InertiaIntegrals:
    """Integrals of a body without elastic coordinates.

    Parameters
    ----------
    mass, inertia
        [kg], [kg m^2] about the centre of mass.
    centre
        Centre of mass from the body's origin, shape (2,) [m].
    """
    x, y = centre
    m = np.diag([inertia + mass * (x * x + y * y), mass, mass])
    m[0, 1:] = m[1:, 0] = mass * x, mass * y
    spin = mass * np.array([[0.0, y, -x], [-y, 0.0, -1.0], [x, 1.0, 0.0]])
    return InertiaIntegrals(m, spin, m.copy())


def with_total(
    integrals: InertiaIntegrals,
    mass: float | None,
    inertia: float | None,
    centre: np.ndarray | None,
) -> InertiaIntegrals:
    """Integrals with another total mass, inertia and centre; None keeps what is there.

    Only the rigid part changes, by what a rigid body fixed to the frame would add.
    """
    own = integrals.total_mass, integrals.polar_inertia, integrals.centre_of_mass
    present = rigid_integrals(*own)
    wanted = rigid_integrals(
        own[0] if mass is None else mass,
        own[1] if inertia is None else inertia,
        own[2] if centre is None else centre,
    )
    parts = {}
    for name in ("mass", "spin", "centrifugal"):
        matrix = getattr(integrals, name).copy()
        matrix[:3, :3] += getattr(wanted, name) - getattr(present, name)
        parts[name] = matrix
    return replace(integrals, **parts)
