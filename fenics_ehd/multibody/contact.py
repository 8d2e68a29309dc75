"""Asperity contact in lubricated joints with rough surfaces: forces, and their exact derivatives.

At the Gauss points of a film the asperities carry the contact pressure ``p_c(h)`` at the nominal
gap h, and the boundary friction ``mu p_c s(U)`` with ``s = U / sqrt(U^2 + U_0^2)``. Grooves and
supply holes are deep and have no contact. The power of the generalised forces Q at the rates v of
the coordinates, on which h and U depend, is

    Q . v = int p_c dh/dt - mu p_c s(U) U dA,

so that contact is conservative, friction dissipates, and action equals reaction. If contact depends
on coordinates alone, the core matrix S of `fenics_ehd.multibody.border` contains the stiffness
``N^T p_c' N`` of its forces, where N is the derivative of the gap with respect to coordinates.

Residual patterns (M4) deform the bore under contact pressures, which depend on the gap: ``p_c =
p_c(h_0 + S p_c)``, where S is here the gap change due to unit contact pressures. Every evaluation
solves this equation by Newton's method, which converges from below without overshoot, because p_c
is convex. Contact pressures near zero separation are then additional unknowns, after the others in
x. Their equations

    dp_c - p_c' (N dxi + S dp_c + sum_f S_f dP_f) = 0

contain the gap change S_f due to unit pressures of film f. The right-hand side is zero, because the
contact pressures are known at every evaluation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fenics_ehd.base.errors import SettingsError, SolverError
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.film.rough_surfaces import AsperityContact
from fenics_ehd.multibody.border import FilmBlock
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.film_models import FilmModel
from fenics_ehd.multibody.film_point import FilmPoint
from fenics_ehd.multibody.mechanism import System
from fenics_ehd.multibody.static_correction import PatternResponses
from fenics_ehd.multibody.surface import TurningRows

#: Largest separation over sigma at which derivatives contain contact. The contact pressure there is
#: 4e-6 of that at zero separation.
REACH = 4.0


class JointContact:
    """Asperity contact in one joint.

    Parameters
    ----------
    binding
        Binding of a film with rough surfaces.

    Attributes
    ----------
    surfaces
        Rough surfaces of the film.
    area
        Area of every Gauss point, 0 in grooves and holes, shape (g,) [m2].
    friction
        Whether boundary friction acts on the bodies.
    rows
        Indices in z of the k coordinates on which contact does work, shape (k,).
    normal, sliding
        Gap change for unit coordinates, without that of a turning surface, and sliding velocity
        for unit rates, shape (g, k) each.
    """

    def __init__(self, binding: FilmBinding):
        joint = binding.film
        film = joint.film
        assert film.parameters.surfaces is not None
        self.surfaces = film.parameters.surfaces
        self._shaft_radius = joint.shaft_radius
        area = film.parameters.grid.radius**2 * film.assembly.area
        self.area = np.where(film.supplied_points, 0.0, area).ravel()
        self.friction = joint.friction and self.surfaces.boundary_friction > 0.0
        self.rows = np.concatenate([binding.xi, binding.turning_dofs])
        self._turning_map = binding.turning_map
        speeds = joint.shaft_radius * np.tile(self._turning_map[-1], (len(self.area), 1))
        self._first_turning = joint.size
        self.normal = np.hstack([joint.thickness, np.zeros_like(speeds)])
        self.sliding = np.hstack([joint.sliding_velocity, speeds])

    def at_gap(self, thickness: np.ndarray) -> AsperityContact:
        """Asperity contact at the g Gauss points for the nominal gaps there [m], (g,) each."""
        contact = self.surfaces.contact(thickness.ravel())
        return AsperityContact(*(np.where(self.area > 0.0, values, 0.0) for values in contact))

    def friction_factor(self, gap: Gap) -> tuple[np.ndarray, np.ndarray]:
        """Shear stress of boundary friction over contact pressure, and its derivative, (g,) each.

        The stress depends on the sliding velocity U, with respect to which it is differentiated.
        """
        return self.surfaces.boundary_friction_factor(gap.sliding_velocity.ravel())

    def friction_torque(self, contact: AsperityContact, gap: Gap) -> float:
        """Torque of boundary friction against the rotation of the journal [N m]."""
        friction = contact.pressure * self.friction_factor(gap)[0]
        return float(self._shaft_radius * np.sum(self.area * friction))

    def friction_power(self, contact: AsperityContact, gap: Gap) -> float:
        """Power that boundary friction dissipates [W]."""
        friction = self.area * contact.pressure * self.friction_factor(gap)[0]
        return float(np.sum(friction * gap.sliding_velocity.ravel()))

    def near(self, thickness: np.ndarray) -> np.ndarray:
        """Mask of the Gauss points with a gap so small that derivatives contain contact, (g,)."""
        return (self.surfaces.separation(thickness.ravel()) < REACH) & (self.area > 0.0)

    def gap_rows(self, turning: TurningRows | None) -> np.ndarray:
        """Gap change at g points for unit changes of the k coordinates of the contact, (g, k).

        `turning` has the derivatives of the gap with respect to the coordinates of a surface that
        turns through the film.
        """
        if turning is None:
            return self.normal
        rows = self.normal.copy()
        rows[:, self._first_turning :] = turning.gap @ self._turning_map
        return rows

    def forces(
        self, contact: AsperityContact, gap: Gap, turning: TurningRows | None = None
    ) -> np.ndarray:
        """Generalised forces of contact and boundary friction on the k coordinates, shape (k,)."""
        normal_force = self.area * contact.pressure
        forces = normal_force @ self.gap_rows(turning)
        if self.friction:
            forces -= (normal_force * self.friction_factor(gap)[0]) @ self.sliding
        return forces

    def turning_stiffness(self, contact: AsperityContact, turning: TurningRows) -> np.ndarray:
        """Derivative of `forces` with respect to the k coordinates at constant contact pressure.

        It arises because the derivatives of the gap change when a surface turns; shape (k, k).
        """
        stiffness = np.zeros((len(self.rows), len(self.rows)))
        first = self._first_turning
        along_angle = self.area @ (contact.pressure[:, None] * turning.second_derivative)
        of_surface = turning.stiffness(along_angle)
        stiffness[first:, first:] = self._turning_map.T @ of_surface @ self._turning_map
        return stiffness

    def forces_of_unit_pressures(
        self, gap: Gap, points: np.ndarray, turning: TurningRows | None = None
    ) -> np.ndarray:
        """Generalised forces on the k coordinates for unit contact pressures at some Gauss points.

        The result has the shape (k, points).
        """
        forces = self.gap_rows(turning)[points]
        if self.friction:
            forces = forces - self.friction_factor(gap)[0][points, None] * self.sliding[points]
        return (self.area[points, None] * forces).T

    def friction_damping(
        self, contact: AsperityContact, gap: Gap, points: np.ndarray
    ) -> np.ndarray:
        """Negative derivative of `forces` with respect to rates of the k coordinates, (k, k)."""
        factor = (self.area * contact.pressure * self.friction_factor(gap)[1])[points]
        return self.sliding[points].T @ (factor[:, None] * self.sliding[points])


#: Largest number of Newton iterations for contact pressures that deform a bore.
MAX_ITERATIONS = 60

#: Change of a gap over the roughness below which these iterations end: one more iteration would
#: change the gap by round-off.
SETTLED = 1e-9


class Contacts:
    """Asperity contact in all joints of a mechanism.

    Parameters
    ----------
    system, responses
        Mechanism, and responses of its bores through residual patterns.

    Attributes
    ----------
    joints
        Contact of every film; None for smooth surfaces.
    areas
        Areas of the Gauss points of all films, one film after the other [m2]; 0 at points without
        contact or without residual patterns.
    coupled
        Whether contact deforms a bore through residual patterns (an area is above 0).

    Raises
    ------
    SettingsError
        If the mortar transfers pressures to a rough bore with residual patterns.
    """

    def __init__(self, system: System, responses: PatternResponses):
        self._responses = responses
        self.joints = [
            None if binding.film.film.parameters.surfaces is None else JointContact(binding)
            for binding in system.films
        ]
        self.areas = np.zeros(sum(len(binding.film.thickness) for binding in system.films))
        for i, (binding, joint) in enumerate(zip(system.films, self.joints, strict=True)):
            bodies = responses.bodies_of(i)
            if not bodies:
                continue
            if joint is not None:
                self.areas[responses.points[i]] = joint.area
            rough = any(self.joints[other] for body in bodies for other in body.films)
            if rough and any(surface.mortar for surface in binding.film.surfaces):
                raise SettingsError(
                    f"joints.{binding.name}.transfer = 'mortar' does not transfer contact "
                    "pressures: use 'conservative' with rough surfaces"
                )
        self.coupled = bool(self.areas.any())

    def start_step(self) -> None:
        """Discard pressures and responses of earlier steps, so that a resumed run is identical."""
        self._last = np.zeros(len(self.areas))
        self._known_points = np.zeros(0, dtype=int)
        self._known_changes = np.zeros((len(self.areas), 0))

    def at_gaps(self, gaps: list[Gap]) -> list[AsperityContact | None]:
        """Asperity contact of every film at its gap; None for smooth surfaces.

        Entries of the list `gaps` are replaced by gaps that include the deformation due to contact.
        """
        if self.coupled:
            self._solve_coupled(gaps)
        return [
            None if joint is None else joint.at_gap(gap.thickness)
            for joint, gap in zip(self.joints, gaps, strict=True)
        ]

    def subtract_from_residual(self, i: int, film: FilmPoint, residual: np.ndarray) -> None:
        """Subtract the contact forces of film i from the residual of motion."""
        joint = self.joints[i]
        if joint is not None and film.contact is not None:
            residual[joint.rows] -= joint.forces(film.contact, film.gap, film.turning)

    def _solve_coupled(self, gaps: list[Gap]) -> None:
        """Solve for contact pressures that deform bores; replace the gaps in the list."""
        responses = self._responses
        pressure = self._last
        undeformed = np.concatenate([gap.thickness.ravel() for gap in gaps])
        least = min(joint.surfaces.roughness for joint in self.joints if joint is not None)
        for _ in range(MAX_ITERATIONS):
            thickness = undeformed + responses.gap_change_from_forces(self.areas * pressure)
            of_gap, slope = self._pressures(thickness)
            step = of_gap - pressure
            points = self.near(thickness)
            if len(points):
                matrix = -slope[points, None] * self.gap_change_from_pressures(points)[points]
                matrix[np.diag_indices_from(matrix)] += 1.0
                step[points] = np.linalg.solve(matrix, step[points])
            pressure = pressure + step
            if np.abs(responses.gap_change_from_forces(self.areas * step)).max() <= SETTLED * least:
                break
        else:
            raise SolverError(
                "contact pressures that deform a bore did not converge within "
                f"{MAX_ITERATIONS} iterations: use shorter steps (time.largest_step)"
            )
        self._last = pressure
        change = responses.gap_change_from_forces(self.areas * pressure)
        for i, of_film in enumerate(responses.points):
            gaps[i] = gaps[i].changed(change[of_film], responses.shift * change[of_film])

    def _pressures(self, thickness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Contact pressures [Pa] and their slopes [Pa/m] at nominal gaps of all films [m]."""
        pressure = np.zeros(len(thickness))
        slope = np.zeros(len(thickness))
        for joint, points in zip(self.joints, self._responses.points, strict=True):
            if joint is not None:
                _, pressure[points], slope[points] = joint.at_gap(thickness[points])
        return pressure, slope

    def near(self, thickness: np.ndarray) -> np.ndarray:
        """Indices of the Gauss points of coupled bores at which derivatives contain contact."""
        near = np.zeros(len(thickness), dtype=bool)
        for joint, points in zip(self.joints, self._responses.points, strict=True):
            if joint is not None:
                near[points] = joint.near(thickness[points])
        return np.flatnonzero(near & (self.areas > 0.0))

    def gap_change_from_pressures(self, points: np.ndarray) -> np.ndarray:
        """Gap change at all g Gauss points for unit contact pressures at some of them [m/Pa].

        `points` has the indices of the loaded points, shape (a,); the result has the shape (g, a).
        """
        new = np.setdiff1d(points, self._known_points, assume_unique=True)
        if len(new):
            change = self._responses.unit_force_response(new) * self.areas[new]
            self._known_points = np.concatenate([self._known_points, new])
            self._known_changes = np.hstack([self._known_changes, change])
        order = np.argsort(self._known_points)
        columns = order[np.searchsorted(self._known_points, points, sorter=order)]
        return self._known_changes[:, columns]

    def forces(self, thickness: Sequence[np.ndarray]) -> np.ndarray:
        """Normal forces of contact at the Gauss points of all films [N], from their gaps [m].

        Forces are 0 at points of bores that contact does not deform through residual patterns.
        """
        if not self.coupled:
            return self.areas
        return self.areas * self._pressures(np.concatenate(thickness))[0]


class ContactColumns:
    """Derivatives of asperity contact at one iterate of Newton's method.

    Parameters
    ----------
    contacts, responses, films
        Contact, responses of bores, and films evaluated at the iterate.
    first
        Number of unknowns x without contact pressures.

    Attributes
    ----------
    size
        Number of unknowns x with contact pressures.
    """

    def __init__(
        self,
        contacts: Contacts,
        responses: PatternResponses,
        films: Sequence[FilmPoint],
        first: int,
    ):
        self._contacts = contacts
        self._responses = responses
        self._films = films
        self._points = np.zeros(0, dtype=int)
        if contacts.coupled:
            thickness = np.concatenate([film.gap.thickness.ravel() for film in films])
            self._points = contacts.near(thickness)
            slopes = np.zeros(len(thickness))
            for film, points in zip(films, responses.points, strict=True):
                if film.contact is not None:
                    slopes[points] = film.contact.slope
            self._slopes = slopes[self._points]
            self._gap_change = contacts.gap_change_from_pressures(self._points)
        self.size = first + len(self._points)
        self._unknowns = np.arange(first, self.size)

    def add_to_core(self, core: np.ndarray, speed: np.ndarray) -> None:
        """Add the derivatives of contact with respect to the unknowns x to the core matrix.

        Parameters
        ----------
        core
            Matrix of derivatives with respect to x, with ones on the diagonal of the contact
            pressures; changed in place.
        speed
            Derivatives of all rates with respect to the unknowns of motion.
        """
        for i, (film, joint) in enumerate(zip(self._films, self._contacts.joints, strict=True)):
            contact = film.contact
            if joint is None or contact is None:
                continue
            points, unknowns = self._points_of_film(i, joint)
            stiffness = contact.slope[points, None] * joint.gap_rows(film.turning)[points]
            forces = joint.forces_of_unit_pressures(film.gap, points, film.turning)
            if unknowns is None:
                core[np.ix_(joint.rows, joint.rows)] -= forces @ stiffness
            else:
                core[np.ix_(joint.rows, unknowns)] -= forces
                core[np.ix_(unknowns, joint.rows)] -= stiffness
            if film.turning is not None:
                stiffness = joint.turning_stiffness(contact, film.turning)
                core[np.ix_(joint.rows, joint.rows)] -= stiffness
            if joint.friction:
                damping = joint.friction_damping(contact, film.gap, points)
                core[joint.rows, : speed.shape[1]] += damping @ speed[joint.rows]
        if len(self._points):
            pressures = np.ix_(self._unknowns, self._unknowns)
            core[pressures] -= self._slopes[:, None] * self._gap_change[self._points]

    def _points_of_film(self, i: int, joint: JointContact) -> tuple[np.ndarray, np.ndarray | None]:
        """Gauss points of film i with contact, and the indices of their contact pressures in x.

        The indices are None if the contact depends on coordinates alone.
        """
        if not self._responses.bodies_of(i):
            return np.flatnonzero(joint.near(self._films[i].gap.thickness)), None
        of_film = self._responses.points[i]
        inside = np.flatnonzero((of_film.start <= self._points) & (self._points < of_film.stop))
        return self._points[inside] - of_film.start, self._unknowns[inside]

    def extend(self, i: int, block: FilmBlock, model: FilmModel[Any]) -> FilmBlock:
        """Return the derivatives of film i, extended by inputs and outputs for contact pressures.

        Contact pressures deform the bore of the film, and depend on the film's pressures.
        """
        if not self._responses.bodies_of(i) or not len(self._points):
            return block
        gap_change = self._gap_change[self._responses.points[i]]
        near = np.flatnonzero(gap_change.any(axis=0))  # other points belong to other bodies
        gap_change = gap_change[:, near]
        unknowns = self._unknowns[near]
        spread = np.zeros((len(near), block.spread.shape[1]))
        spread[np.arange(len(near)), unknowns] = 1.0
        response = model.columns(self._responses.unit_pressure_response(i, self._points[near]))
        return block.extended(
            model.rows(block.along_gap @ gap_change),
            spread,
            gap_change,
            (-self._slopes[near, None] * response, unknowns),
        )
