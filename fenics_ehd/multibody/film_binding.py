"""Films of lubricated joints, bound to coordinates of a mechanism.

A `JointFilm` has its own coordinates. `FilmBinding` has their indices among all coordinates z of a
mechanism, those of both surfaces included, and evaluates gap and turning surface at values of z.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import linalg

from fenics_ehd.film.kinematics import Gap
from fenics_ehd.multibody.elastic_bore import ElasticBore
from fenics_ehd.multibody.lubricated_joint import JointFilm, LubricatedJoint
from fenics_ehd.multibody.surface import Surface, TurningRows


@dataclass(frozen=True, eq=False)
class BoundSurface:
    """A surface of a film, bound to coordinates of the mechanism.

    Attributes
    ----------
    surface
        The surface.
    body, point
        Names of its body and of the point of the body.
    marker
        Marker at the centre of the undeformed surface.
    modes
        Indices of its elastic coordinates in z, shape (n,).
    angle
        Index of the body's angle in z; None: the body cannot turn.
    mounted
        Angle of a body that cannot turn, else 0 [rad].
    key
        Name of the surface in files: that of the joint, of a journal with ``.journal`` behind.
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
        """Angle [rad] from z, or angular speed [rad/s] from rates; 0 if the body cannot turn."""
        return 0.0 if self.angle is None else values[self.angle]


@dataclass(frozen=True, eq=False)
class FilmBinding:
    """Film of a lubricated joint, bound to coordinates of the mechanism.

    Attributes
    ----------
    name, joint
        Name and object of the lubricated joint.
    film
        Linear maps of the joint; `film.film` is the `Film`.
    xi
        Indices of ``(e, psi, q)`` in z, shape (n,).
    rows
        Rows of the joint's constraints in g.
    surfaces
        Surfaces of bore and journal.
    """

    name: str
    joint: LubricatedJoint
    film: JointFilm
    xi: np.ndarray
    rows: slice
    surfaces: tuple[BoundSurface, BoundSurface]

    def relative_angle(self, z: np.ndarray) -> float:
        """Angle of the journal less that of the bore [rad]."""
        bore, journal = self.surfaces
        return self.relative_speed(z) + journal.mounted - bore.mounted

    def relative_speed(self, rates: np.ndarray) -> float:
        """Angular speed of the journal less that of the bore [rad/s]."""
        return float(self.signs @ rates[self.turning])

    def own_angles(self, z: np.ndarray) -> tuple[float, float]:
        """Angles of bore and journal relative to the bore [rad]: 0 and `relative_angle`."""
        return 0.0, self.relative_angle(z)

    def gap(self, z: np.ndarray, rates: np.ndarray, time: float) -> Gap:
        """Gap and velocities at coordinates of the mechanism and their rates, see `JointFilm`."""
        speed = self.relative_speed(rates)
        angle = self.relative_angle(z)
        modes = z[self.turning_modes], rates[self.turning_modes]
        return self.film.gap(z[self.xi], rates[self.xi], speed, angle, time, modes)

    def turning_coordinates(self, z: np.ndarray) -> np.ndarray:
        """Coordinates ``(q, alpha)`` of a turning surface, shape (k,)."""
        return np.append(z[self.turning_modes], self.relative_angle(z))

    def turning_rows(self, z: np.ndarray, rates: np.ndarray) -> TurningRows | None:
        """Rows of the turning surface at coordinates and rates; None if no surface turns."""
        surface = self.film.turning
        if surface is None:
            return None
        speeds = np.append(rates[self.turning_modes], self.relative_speed(rates))
        return surface.turning_rows(self.turning_coordinates(z), speeds)

    @cached_property
    def turning(self) -> np.ndarray:
        """Indices in z of the angles in `relative_angle`."""
        angles = [surface.angle for surface in reversed(self.surfaces)]
        return np.array([angle for angle in angles if angle is not None], dtype=int)

    @cached_property
    def signs(self) -> np.ndarray:
        """Signs of the angles in `relative_angle`."""
        known = [surface.angle is not None for surface in reversed(self.surfaces)]
        return np.array([1.0, -1.0])[known]

    @cached_property
    def turning_modes(self) -> np.ndarray:
        """Indices in z of the elastic coordinates of a turning surface."""
        modes = [bound.modes for bound in self.surfaces if bound.surface.turning]
        return np.concatenate([*modes, np.zeros(0, dtype=int)])

    @cached_property
    def turning_dofs(self) -> np.ndarray:
        """Indices in z of ``q`` of a turning surface and of the angles in `relative_angle`."""
        return np.concatenate([self.turning_modes, self.turning])

    @cached_property
    def turning_map(self) -> np.ndarray:
        """Matrix from values at `turning_dofs` to those of ``(q, alpha)``."""
        return linalg.block_diag(np.eye(len(self.turning_modes)), self.signs)

    def angles(self, values: np.ndarray) -> tuple[float, float]:
        """Angles of journal and bore [rad] from z, or angular speeds [rad/s] from rates of z.

        The value of a body that cannot turn is 0.
        """
        bore, journal = self.surfaces
        return journal.angle_of(values), bore.angle_of(values)

    @property
    def journal_angle(self) -> int | None:
        """Index of the journal's angle in z; None: the journal cannot turn."""
        return self.surfaces[1].angle

    @property
    def bore_body(self) -> str:
        """Name of the body with the bore."""
        return self.surfaces[0].body

    @property
    def bore(self) -> str:
        """Name of the bore if it is that of a flexible body, else empty."""
        return self.surfaces[0].point if isinstance(self.surfaces[0].surface, ElasticBore) else ""
