"""Forces of touching asperities (`fenics_ehd.film.contact`) in one lubricated joint.

Pressure and boundary friction do work on what changes h and U,

    Q . v = int p_c dh/dt - mu p_c s(U) U dA,

so that contact is conservative, friction dissipates, and action is reaction.
"""

from __future__ import annotations

import numpy as np

from fenics_ehd.film.asperities import Touch
from fenics_ehd.film.contact import FilmContact
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.multibody.joint_shape import Turned
from fenics_ehd.multibody.system import FilmPlace

#: Distance of the tips' mean planes over sigma beyond which contact, below 4e-6 of that at 0, is
#: left out of derivatives.
REACH = 4.0


class JointContact(FilmContact):
    """Contact in one joint.

    Parameters
    ----------
    place
        The joint, its surfaces rough.

    Attributes
    ----------
    friction
        Whether the friction of asperities that rub acts on the bodies.
    rows
        Places in z of all coordinates on which contact does work, shape (k,).
    normal, sliding
        Change of the gap and sliding velocity for unit values of, or rates of these, shape (g, k);
        the first without what the journal's shape does.
    """

    def __init__(self, place: FilmPlace):
        joint = place.film
        super().__init__(joint.film)
        self.friction = joint.friction and self.surfaces.boundary_friction > 0.0
        self.rows = np.concatenate([place.xi, [angle for angle, _ in place.turning]]).astype(int)
        self._signs = np.array([sign for _, sign in place.turning])
        speeds = joint.shaft_radius * np.tile(self._signs, (len(self.area), 1))
        self.normal = np.hstack([joint.thickness, np.zeros_like(speeds)])
        self.sliding = np.hstack([joint.sliding_velocity, speeds])

    def near(self, thickness: np.ndarray) -> np.ndarray:
        """Whether the contact of a Gauss point counts in derivatives, shape (g,)."""
        return (self.surfaces.asperities.apart(thickness.ravel()) < REACH) & (self.area > 0.0)

    def outward(self, turned: Turned | None) -> np.ndarray:
        """Change of the gap for unit values of all coordinates, shape (g, k)."""
        if turned is None:
            return self.normal
        found = self.normal.copy()
        found[:, found.shape[1] - len(self._signs) :] = turned.slope[:, None] * self._signs
        return found

    def forces(self, touch: Touch, gap: Gap, turned: Turned | None = None) -> np.ndarray:
        """Generalised forces on `rows`, shape (k,)."""
        force = self.area * touch.pressure
        found = force @ self.outward(turned)
        if self.friction:
            found -= (force * self.rubbing(gap)[0]) @ self.sliding
        return found

    def bent(self, touch: Touch, turned: Turned) -> np.ndarray:
        """Change of the forces on `rows` as the shape of the journal turns, shape (k, k)."""
        found, size = np.zeros((len(self.rows),) * 2), len(self._signs)
        factor = float(self.area @ (touch.pressure * turned.curve))
        found[len(found) - size :, len(found) - size :] = factor * np.outer(
            self._signs, self._signs
        )
        return found

    def per_pressure(
        self, gap: Gap, points: np.ndarray, turned: Turned | None = None
    ) -> np.ndarray:
        """Forces on `rows` of unit contact pressures at some points, shape (k, points)."""
        forces = self.outward(turned)[points]
        if self.friction:
            forces = forces - self.rubbing(gap)[0][points, None] * self.sliding[points]
        return (self.area[points, None] * forces).T

    def rubbing_per_rate(self, touch: Touch, gap: Gap, points: np.ndarray) -> np.ndarray:
        """Minus the derivative of the forces on `rows` along the rates of these, shape (k, k)."""
        factor = (self.area * touch.pressure * self.rubbing(gap)[1])[points]
        return self.sliding[points].T @ (factor[:, None] * self.sliding[points])


def joint_contact(place: FilmPlace) -> JointContact | None:
    """Contact in a joint, None for smooth surfaces."""
    return None if place.film.film.parameters.surfaces is None else JointContact(place)
