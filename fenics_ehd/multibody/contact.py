"""Contact of rough surfaces in lubricated joints, within a step, with exact derivatives.

At the Gauss points of a film the asperities press with ``p_c(h)``, h the nominal gap there, and rub
with ``mu p_c s(U)``, ``s = U / sqrt(U^2 + U_0^2)``. Grooves and supply holes are deep and touch
nothing. Pressure and boundary friction do work on what changes h and U,

    Q . v = int p_c dh/dt - mu p_c s(U) U dA,

so that contact is conservative, friction dissipates, and action is reaction. Contact that depends
on coordinates alone has the stiffness ``N^T p_c' N`` of its forces in the core.

Where residual patterns answer pressures at once (M4) the contact moves the gap that it depends on,
``p_c = p_c(h_0 + S p_c)``. Every evaluation solves that by Newton's method, which comes from below
without a step too far: the pressure is convex. The contact pressures that count are then unknowns
in x behind the others,

    dp_c - p_c' (N dxi + S dp_c + sum_f S_f dP_f) = 0,

and change the gaps of all films by S. The pressures themselves are known at every evaluation, so
that the right-hand side is zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fenics_ehd.base.errors import SettingsError, SolverError
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.film.rough_surfaces import AsperityContact
from fenics_ehd.multibody.border import FilmBlock
from fenics_ehd.multibody.film_models import FilmModel, FilmPoint
from fenics_ehd.multibody.lubricated_joint import RotatedShape
from fenics_ehd.multibody.mechanism import FilmBinding, System
from fenics_ehd.multibody.static_correction import BoreResponses

#: Distance of the tips' mean planes over sigma beyond which contact, below 4e-6 of that at 0, is
#: left out of derivatives.
REACH = 4.0


class JointContact:
    """Contact in one joint.

    Parameters
    ----------
    binding
        The joint, its surfaces rough.

    Attributes
    ----------
    surfaces
        See `FilmParameters`.
    area
        That a Gauss point stands for, 0 in grooves and holes, shape (g,) [m2].
    friction
        Whether the friction of asperities that rub acts on the bodies.
    rows
        Places in z of all coordinates on which contact does work, shape (k,).
    normal, sliding
        Change of the gap and sliding velocity for unit values of, or rates of these, shape (g, k);
        the first without what the journal's shape does.
    """

    def __init__(self, binding: FilmBinding):
        joint, film = binding.film, binding.film.film
        assert film.parameters.surfaces is not None
        self.surfaces, self._shaft_radius = film.parameters.surfaces, joint.shaft_radius
        area = film.parameters.grid.radius**2 * film.assembly.area
        self.area = np.where(film.supplied_points, 0.0, area).ravel()
        self.friction = joint.friction and self.surfaces.boundary_friction > 0.0
        self.rows = np.concatenate([binding.xi, binding.turning])
        self._signs = binding.signs
        speeds = joint.shaft_radius * np.tile(self._signs, (len(self.area), 1))
        self.normal = np.hstack([joint.thickness, np.zeros_like(speeds)])
        self.sliding = np.hstack([joint.sliding_velocity, speeds])

    def touch(self, thickness: np.ndarray) -> AsperityContact:
        """Contact of nominal gaps at the Gauss points, of any shape that has g values [m]."""
        found = self.surfaces.contact(thickness.ravel())
        return AsperityContact(*(np.where(self.area > 0.0, values, 0.0) for values in found))

    def rubbing(self, gap: Gap) -> tuple[np.ndarray, np.ndarray]:
        """``mu s`` and its derivative along U, shape (g,)."""
        return self.surfaces.boundary_friction_factor(gap.sliding_velocity.ravel())

    def braking(self, touch: AsperityContact, gap: Gap) -> float:
        """Torque of boundary friction against the journal's turning [N m]."""
        rubbing = touch.pressure * self.rubbing(gap)[0]
        return float(self._shaft_radius * np.sum(self.area * rubbing))

    def rubbing_power(self, touch: AsperityContact, gap: Gap) -> float:
        """Lost by boundary friction [W]."""
        rubbing = self.area * touch.pressure * self.rubbing(gap)[0]
        return float(np.sum(rubbing * gap.sliding_velocity.ravel()))

    def near(self, thickness: np.ndarray) -> np.ndarray:
        """Gauss points whose contact counts in derivatives, shape (g,)."""
        return (self.surfaces.separation(thickness.ravel()) < REACH) & (self.area > 0.0)

    def outward(self, rotated: RotatedShape | None) -> np.ndarray:
        """Change of the gap for unit values of all coordinates, shape (g, k)."""
        if rotated is None:
            return self.normal
        found = self.normal.copy()
        found[:, found.shape[1] - len(self._signs) :] = rotated.slope[:, None] * self._signs
        return found

    def forces(
        self, touch: AsperityContact, gap: Gap, rotated: RotatedShape | None = None
    ) -> np.ndarray:
        """Generalised forces on `rows`, shape (k,)."""
        force = self.area * touch.pressure
        found = force @ self.outward(rotated)
        if self.friction:
            found -= (force * self.rubbing(gap)[0]) @ self.sliding
        return found

    def bent(self, touch: AsperityContact, rotated: RotatedShape) -> np.ndarray:
        """Change of the forces on `rows` as the shape of the journal turns, shape (k, k)."""
        found, size = np.zeros((len(self.rows),) * 2), len(self._signs)
        factor = float(self.area @ (touch.pressure * rotated.second_derivative))
        found[len(found) - size :, len(found) - size :] = factor * np.outer(
            self._signs, self._signs
        )
        return found

    def per_pressure(
        self, gap: Gap, points: np.ndarray, rotated: RotatedShape | None = None
    ) -> np.ndarray:
        """Forces on `rows` of unit contact pressures at some points, shape (k, points)."""
        forces = self.outward(rotated)[points]
        if self.friction:
            forces = forces - self.rubbing(gap)[0][points, None] * self.sliding[points]
        return (self.area[points, None] * forces).T

    def rubbing_per_rate(self, touch: AsperityContact, gap: Gap, points: np.ndarray) -> np.ndarray:
        """Minus the derivative of the forces on `rows` along the rates of these, shape (k, k)."""
        factor = (self.area * touch.pressure * self.rubbing(gap)[1])[points]
        return self.sliding[points].T @ (factor[:, None] * self.sliding[points])


#: Iterations for the contact of a bore that answers at once, and the change of a gap over the
#: roughness at which they end: one more would change it by round-off.
MAX_ITERATIONS, SETTLED = 60, 1e-9


class Contacts:
    """Contact in the joints of a mechanism.

    Parameters
    ----------
    system, responses
        Of the mechanism.

    Attributes
    ----------
    joints
        Of every film, None where its surfaces are smooth.
    areas, answering
        Of the Gauss points of all films, 0 where nothing can touch, or no pattern answers it; and
        whether there are others.

    Raises
    ------
    SettingsError
        Pressures reach a rough bore that answers at once by a mortar.
    """

    def __init__(self, system: System, responses: BoreResponses):
        self._responses = responses
        self.joints = [
            None if binding.film.film.parameters.surfaces is None else JointContact(binding)
            for binding in system.films
        ]
        self.areas = np.zeros(sum(len(binding.film.thickness) for binding in system.films))
        for i, (binding, joint) in enumerate(zip(system.films, self.joints, strict=True)):
            body = responses.body_of(i)
            if body is None:
                continue
            if joint is not None:
                self.areas[responses.points[i]] = joint.area
            rough = any(self.joints[other] for other in body.films)
            if rough and binding.film.bore is not None and binding.film.bore.projected is not None:
                raise SettingsError(
                    f"joints.{binding.name}.transfer = 'mortar': contact needs 'conservative'"
                )
        self.answering = bool(self.areas.any())

    def begin(self) -> None:
        """Take another step: nothing is carried over, so that a resumed run is the same."""
        self._last = np.zeros(len(self.areas))
        self._reached, self._moved = np.zeros(0, dtype=int), np.zeros((len(self.areas), 0))

    def touch(self, gaps: list[Gap]) -> list[AsperityContact | None]:
        """Contact of all films; where it moves a bore at once the gaps are changed by it."""
        if self.answering:
            self._settle(gaps)
        return [
            None if joint is None else joint.touch(gap.thickness)
            for joint, gap in zip(self.joints, gaps, strict=True)
        ]

    def subtract_from_residual(self, i: int, film: FilmPoint, residual: np.ndarray) -> None:
        """Take a film's contact forces from the residual of motion."""
        joint = self.joints[i]
        if joint is not None and film.contact is not None:
            residual[joint.rows] -= joint.forces(film.contact, film.gap, film.rotated)

    def _settle(self, gaps: list[Gap]) -> None:
        """Contact that bores answer, with the gaps that it makes."""
        responses, pressure = self._responses, self._last
        open_ = np.concatenate([gap.thickness.ravel() for gap in gaps])
        least = min(joint.surfaces.roughness for joint in self.joints if joint is not None)
        for _ in range(MAX_ITERATIONS):
            thickness = open_ + responses.gap_change_from_forces(self.areas * pressure)
            found, slope = self._pressures(thickness)
            step = found - pressure
            points = self.near(thickness)
            if len(points):
                matrix = -slope[points, None] * self.moved_by(points)[points]
                matrix[np.diag_indices_from(matrix)] += 1.0
                step[points] = np.linalg.solve(matrix, step[points])
            pressure = pressure + step
            if np.abs(responses.gap_change_from_forces(self.areas * step)).max() <= SETTLED * least:
                break
        else:
            raise SolverError("the contact of a bore that answers it at once was not found")
        self._last = pressure
        moved = responses.gap_change_from_forces(self.areas * pressure)
        for i, own in enumerate(responses.points):
            gaps[i] = gaps[i].changed(moved[own], responses.shift * moved[own])

    def _pressures(self, thickness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Contact pressures and their slopes at the Gauss points of all films."""
        found = np.zeros((2, len(thickness)))
        for joint, own in zip(self.joints, self._responses.points, strict=True):
            if joint is not None:
                found[:, own] = joint.touch(thickness[own])[1:]
        return found[0], found[1]

    def near(self, thickness: np.ndarray) -> np.ndarray:
        """Gauss points whose contact counts, see `JointContact.near`, and is answered, (a,)."""
        found = np.zeros(len(thickness), dtype=bool)
        for joint, own in zip(self.joints, self._responses.points, strict=True):
            if joint is not None:
                found[own] = joint.near(thickness[own])
        return np.flatnonzero(found & (self.areas > 0.0))

    def moved_by(self, points: np.ndarray) -> np.ndarray:
        """Gap change of all Gauss points for unit contact pressures at some, (g, a) [m/Pa]."""
        new = np.setdiff1d(points, self._reached, assume_unique=True)
        if len(new):
            found = self._responses.unit_force_response(new) * self.areas[new]
            self._reached = np.concatenate([self._reached, new])
            self._moved = np.hstack([self._moved, found])
        order = np.argsort(self._reached)
        return self._moved[:, order[np.searchsorted(self._reached, points, sorter=order)]]

    def forces(self, thickness: Sequence[np.ndarray]) -> np.ndarray:
        """Normal forces on the Gauss points that bores answer, of gaps of every film [N]."""
        if not self.answering:
            return self.areas
        return self.areas * self._pressures(np.concatenate(thickness))[0]


class ContactColumns:
    """Derivatives of contact at one point.

    Parameters
    ----------
    contacts, responses, films
        Of the mechanism, the last of every film.
    first
        Number of the other unknowns x.

    Attributes
    ----------
    size
        Number of all unknowns x.
    """

    def __init__(
        self,
        contacts: Contacts,
        responses: BoreResponses,
        films: Sequence[FilmPoint],
        first: int,
    ):
        self._contacts, self._responses, self._films = contacts, responses, films
        self._points = np.zeros(0, dtype=int)
        if contacts.answering:
            thickness = np.concatenate([film.gap.thickness.ravel() for film in films])
            self._points = contacts.near(thickness)
            slopes = np.zeros(len(thickness))
            for film, own in zip(films, responses.points, strict=True):
                if film.contact is not None:
                    slopes[own] = film.contact.slope
            self._slopes = slopes[self._points]
            self._moved = contacts.moved_by(self._points)
        self.size = first + len(self._points)
        self._unknowns = np.arange(first, self.size)

    def enter(self, core: np.ndarray, speed: np.ndarray) -> None:
        """Take all that does not depend on film pressures into S.

        Parameters
        ----------
        core
            Ones on the diagonal of the contact pressures.
        speed
            Derivative of all rates along the unknowns of motion.
        """
        for i, (film, joint) in enumerate(zip(self._films, self._contacts.joints, strict=True)):
            touch = film.contact
            if joint is None or touch is None:
                continue
            points, unknowns = self._own(i, joint)
            stiffness = touch.slope[points, None] * joint.outward(film.rotated)[points]
            forces = joint.per_pressure(film.gap, points, film.rotated)
            if unknowns is None:
                core[np.ix_(joint.rows, joint.rows)] -= forces @ stiffness
            else:
                core[np.ix_(joint.rows, unknowns)] -= forces
                core[np.ix_(unknowns, joint.rows)] -= stiffness
            if film.rotated is not None:
                core[np.ix_(joint.rows, joint.rows)] -= joint.bent(touch, film.rotated)
            if joint.friction:
                along = joint.rubbing_per_rate(touch, film.gap, points)
                core[joint.rows, : speed.shape[1]] += along @ speed[joint.rows]
        if len(self._points):
            own = np.ix_(self._unknowns, self._unknowns)
            core[own] -= self._slopes[:, None] * self._moved[self._points]

    def _own(self, i: int, joint: JointContact) -> tuple[np.ndarray, np.ndarray | None]:
        """A film's Gauss points that count, and their unknowns where they have any."""
        if self._responses.body_of(i) is None:
            return np.flatnonzero(joint.near(self._films[i].gap.thickness)), None
        own = self._responses.points[i]
        inside = np.flatnonzero((own.start <= self._points) & (self._points < own.stop))
        return self._points[inside] - own.start, self._unknowns[inside]

    def extend(self, i: int, found: FilmBlock, model: FilmModel[Any]) -> FilmBlock:
        """Derivatives of a film with what contact and pressures do by its bore."""
        if self._responses.body_of(i) is None or not len(self._points):
            return found
        moved = self._moved[self._responses.points[i]]
        near = np.flatnonzero(moved.any(axis=0))  # others touch the bores of other bodies
        moved, unknowns = moved[:, near], self._unknowns[near]
        spread = np.zeros((len(near), found.spread.shape[1]))
        spread[np.arange(len(near)), unknowns] = 1.0
        answered = model.of_pressures(self._responses.unit_pressure_response(i, self._points[near]))
        return found.extended(
            (found.along_gap @ moved)[model.nodes] / model.scale,
            spread,
            moved,
            (-self._slopes[near, None] * answered, unknowns),
        )
