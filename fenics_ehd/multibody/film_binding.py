"""Binding of films and their surfaces to the coordinates of a mechanism.

A `JointFilm` has coordinates of its own: eccentricity, tilt and elastic coordinates. `FilmBinding`
has the indices of these coordinates, and of those of both surfaces, in the vector z of all
coordinates of a mechanism. It evaluates the gap and a turning surface from z.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import linalg

from fenics_ehd.base.renamed import renamed_attributes
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.multibody.lubricated_joint import JointFilm, LubricatedJoint
from fenics_ehd.multibody.surface import Surface, TurningRows


@dataclass(frozen=True, eq=False)
class BoundSurface:
    """Surface of a film, bound to the coordinates of the mechanism.

    Attributes
    ----------
    surface
        The surface.
    body, point
        Name of the surface's body, and name of the point of this body at which the surface is.
    marker
        Marker at the centre of the undeformed surface.
    modes
        Indices of the surface's elastic coordinates among the coordinates z of the mechanism, shape
        (n,).
    angle
        Index of the body's angle in z; None if the body cannot turn.
    mounted
        Angle of a body that cannot turn; 0 for other bodies [rad].
    key
        Name of the surface in files: name of the joint, followed by ``.journal`` for a journal.
    """

    surface: Surface
    body: str
    point: str
    marker: str
    modes: np.ndarray
    angle: int | None
    mounted: float
    key: str

    def angle_of(self, values: np.ndarray) -> float:
        """Angle of the surface's body from the coordinates z of a mechanism [rad].

        If `values` are rates of z, it is the angular speed [rad/s]. It is 0 for a body that cannot
        turn.
        """
        return 0.0 if self.angle is None else values[self.angle]


@renamed_attributes(
    bore_body="surfaces[0].body",
    bore_angle="surfaces[0].angle",
    journal_angle="surfaces[1].angle",
)
@dataclass(frozen=True, eq=False)
class FilmBinding:
    """Film of a lubricated joint, bound to the coordinates of the mechanism.

    Attributes
    ----------
    name, joint
        Name and object of the lubricated joint.
    film
        Linear maps of the joint; `film.film` is the `Film`.
    xi
        Indices of the joint's coordinates ``(e, psi, q)`` in z, shape (n,).
    rows
        Indices of the joint's equations in the vector g of all constraints.
    surfaces
        Surfaces of bore and journal, bound to the coordinates.
    """

    name: str
    joint: LubricatedJoint
    film: JointFilm
    xi: np.ndarray
    rows: slice
    surfaces: tuple[BoundSurface, BoundSurface]

    def relative_angle(self, z: np.ndarray) -> float:
        """Angle of the journal less that of the bore, from coordinates z of the mechanism [rad]."""
        bore, journal = self.surfaces
        return self.relative_speed(z) + journal.mounted - bore.mounted

    def relative_speed(self, rates: np.ndarray) -> float:
        """Angular speed of the journal less that of the bore, from rates of z [rad/s]."""
        return float(self.signs @ rates[self.turning])

    def own_angles(self, z: np.ndarray) -> tuple[float, float]:
        """Angles of bore and journal relative to the bore: 0 and the relative angle [rad]."""
        return 0.0, self.relative_angle(z)

    def gap(self, z: np.ndarray, rates: np.ndarray, time: float) -> Gap:
        """Gap and surface velocities from coordinates z of a mechanism, their rates and the time.

        See `JointFilm.gap`.
        """
        speed = self.relative_speed(rates)
        angle = self.relative_angle(z)
        modes = z[self.turning_modes], rates[self.turning_modes]
        return self.film.gap(z[self.xi], rates[self.xi], speed, angle, time, modes)

    def turning_coordinates(self, z: np.ndarray) -> np.ndarray:
        """Coordinates ``(q, alpha)`` of the film's turning surface, shape (k,).

        They are computed from the coordinates z of the mechanism.
        """
        return np.append(z[self.turning_modes], self.relative_angle(z))

    def turning_rows(self, z: np.ndarray, rates: np.ndarray) -> TurningRows | None:
        """Derivatives of the gap with respect to the coordinates of a turning surface.

        None if no surface of the film turns.
        """
        surface = self.film.turning
        if surface is None:
            return None
        speeds = np.append(rates[self.turning_modes], self.relative_speed(rates))
        return surface.turning_rows(self.turning_coordinates(z), speeds)

    @cached_property
    def turning(self) -> np.ndarray:
        """Indices of the angles of journal and bore in the coordinates z of the mechanism.

        Angles of bodies that cannot turn are omitted.
        """
        angles = [surface.angle for surface in reversed(self.surfaces)]
        return np.array([angle for angle in angles if angle is not None], dtype=int)

    @cached_property
    def signs(self) -> np.ndarray:
        """Sign of each angle of `turning` in the relative angle: journal +1, bore -1."""
        known = [surface.angle is not None for surface in reversed(self.surfaces)]
        return np.array([1.0, -1.0])[known]

    @cached_property
    def turning_modes(self) -> np.ndarray:
        """Indices of the turning surface's elastic coordinates in the coordinates z.

        The array is empty if no surface turns.
        """
        modes = [bound.modes for bound in self.surfaces if bound.surface.turning]
        return np.concatenate([*modes, np.zeros(0, dtype=int)])

    @cached_property
    def turning_dofs(self) -> np.ndarray:
        """Indices in z of a turning surface's elastic coordinates, then of the angles `turning`."""
        return np.concatenate([self.turning_modes, self.turning])

    @cached_property
    def turning_map(self) -> np.ndarray:
        """Matrix from the coordinates z with the indices `turning_dofs` to ``(q, alpha)``.

        q are the elastic coordinates of the turning surface, alpha is its angle relative to the
        bore.
        """
        return linalg.block_diag(np.eye(len(self.turning_modes)), self.signs)

    def angles(self, values: np.ndarray) -> tuple[float, float]:
        """Angles of journal and bore from the coordinates z of a mechanism [rad].

        If `values` are rates of z, they are angular speeds [rad/s]. The value of a body that cannot
        turn is 0.
        """
        bore, journal = self.surfaces
        return journal.angle_of(values), bore.angle_of(values)
