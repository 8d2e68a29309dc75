"""Contact of rough surfaces in lubricated joints, within a step, with exact derivatives.

Forces of touching asperities (`fenics_ehd.film.forces`) in one lubricated joint.

Pressure and boundary friction do work on what changes h and U,

    Q . v = int p_c dh/dt - mu p_c s(U) U dA,

so that contact is conservative, friction dissipates, and action is reaction.

Contact in all joints of a mechanism, at one evaluation of a step's equations.

Where residual patterns answer pressures at once (M4) the contact moves the gap that it depends on,
``p_c = p_c(h_0 + S p_c)``. Every evaluation solves that by Newton's method, which comes from below
without a step too far: the pressure is convex.

Exact derivatives of contact in the Newton system of a step.

Contact that depends on coordinates alone has the stiffness ``N^T p_c' N`` of its forces in the
core. Where residual patterns answer it at once (M4) the contact pressures that count are unknowns
in x behind the others,

    dp_c - p_c' (N dxi + S dp_c + sum_f S_f dP_f) = 0,

and change the gaps of all the body's films by S. The pressures themselves are known at every
evaluation (`contacts`), so that the right-hand side is zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_ehd.base.errors import SettingsError, SolverError
from fenics_ehd.film.forces import FilmContact
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.film.rough_surfaces import Touch
from fenics_ehd.multibody.border import FilmBlock
from fenics_ehd.multibody.film_models import FilmModel, FilmPoint
from fenics_ehd.multibody.lubricated_joint import Turned
from fenics_ehd.multibody.mechanism import FilmPlace, System, consecutive
from fenics_ehd.multibody.static_correction import BoreResponses

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
        self.rows = np.concatenate([place.xi, place.turning])
        self._signs = place.signs
        speeds = joint.shaft_radius * np.tile(self._signs, (len(self.area), 1))
        self.normal = np.hstack([joint.thickness, np.zeros_like(speeds)])
        self.sliding = np.hstack([joint.sliding_velocity, speeds])

    def near(self, thickness: np.ndarray) -> np.ndarray:
        """Gauss points whose contact counts in derivatives, shape (g,)."""
        return (self.surfaces.apart(thickness.ravel()) < REACH) & (self.area > 0.0)

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


#: Iterations for the contact of a bore that answers at once, and the change of a gap over the
#: roughness at which they end: one more would change it by round-off.
MAX_ITERATIONS, SETTLED = 60, 1e-9


@dataclass(frozen=True, eq=False)
class Reached:
    """Answers of a body's bores to contact.

    Attributes
    ----------
    points
        Some Gauss points among those of all the body's films, ascending, shape (a,).
    moved
        Gap change of all its Gauss points for unit pressures there, shape (g, a) [m/Pa].
    """

    points: np.ndarray
    moved: np.ndarray

    def of(self, points: np.ndarray) -> np.ndarray:
        """Columns of some of the points."""
        return self.moved[:, np.searchsorted(self.points, points)]


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
    areas
        Of all Gauss points of every body with residual patterns, 0 where nothing can touch; None
        for a body without contact.

    Raises
    ------
    SettingsError
        Pressures reach a rough bore that answers at once by a mortar.
    """

    def __init__(self, system: System, responses: BoreResponses):
        self._responses = responses
        self.joints = [
            None if place.film.film.parameters.surfaces is None else JointContact(place)
            for place in system.films
        ]
        self.areas: list[np.ndarray | None] = []
        for flexibility in responses.flexibilities:
            own = [self.joints[i] for i in flexibility.films]
            if not any(own):
                self.areas.append(None)
                continue
            sizes = [len(system.films[i].film.thickness) for i in flexibility.films]
            areas = [np.zeros(n) if j is None else j.area for j, n in zip(own, sizes, strict=True)]
            self.areas.append(np.concatenate(areas))
            for place in (system.films[i] for i in flexibility.films):
                if place.film.bore is not None and place.film.bore.projected is not None:
                    raise SettingsError(
                        f"joints.{place.name}.transfer = 'mortar': contact needs 'conservative'"
                    )

    def begin(self) -> None:
        """Take another step: nothing is carried over, so that a resumed run is the same."""
        self._last = [None if areas is None else np.zeros(len(areas)) for areas in self.areas]
        self._reached: dict[int, Reached] = {}

    def touch(self, gaps: list[Gap]) -> list[Touch | None]:
        """Contact of all films; where it moves a bore at once the gaps are changed by it."""
        for body, areas in enumerate(self.areas):
            if areas is not None:
                self._settle(body, areas, gaps)
        return [
            None if joint is None else joint.touch(gap.thickness)
            for joint, gap in zip(self.joints, gaps, strict=True)
        ]

    def take(self, i: int, film: FilmPoint, residual: np.ndarray) -> None:
        """Take a film's contact forces from the residual of motion."""
        joint = self.joints[i]
        if joint is not None and film.touch is not None:
            residual[joint.rows] -= joint.forces(film.touch, film.gap, film.turned)

    def _settle(self, body: int, areas: np.ndarray, gaps: list[Gap]) -> None:
        """Contact of a body's films with the gaps that it makes."""
        flexibility = self._responses.flexibilities[body]
        share, shift = flexibility.share, flexibility.shift
        open_ = np.concatenate([gaps[i].thickness.ravel() for i in flexibility.films])
        pressure = self._last[body]
        assert pressure is not None
        least = min(j.surfaces.roughness for j in self.joints if j is not None)
        for _ in range(MAX_ITERATIONS):
            thickness = open_ + share * flexibility.pushed(areas * pressure)
            found, slope = self._pressures(body, thickness)
            step = found - pressure
            points = np.flatnonzero(self.near(body, thickness))
            if len(points):
                reached = self.reached(body, points)
                points = reached.points
                matrix = -share * slope[points, None] * reached.moved[points]
                matrix[np.diag_indices_from(matrix)] += 1.0
                step[points] = np.linalg.solve(matrix, step[points])
            pressure = pressure + step
            change = share * flexibility.pushed(areas * step)
            if np.abs(change).max() <= SETTLED * least:
                break
        else:
            raise SolverError("the contact of a bore that answers it at once was not found")
        self._last[body] = pressure
        moved = flexibility.each(share * flexibility.pushed(areas * pressure))
        for i, change in zip(flexibility.films, moved, strict=True):
            gaps[i] = gaps[i].changed(change, shift * change)

    def _each(self, body: int, values: np.ndarray) -> list[tuple[JointContact | None, np.ndarray]]:
        """Contact of a body's films and their share of values at all its Gauss points."""
        flexibility = self._responses.flexibilities[body]
        joints = [self.joints[i] for i in flexibility.films]
        return list(zip(joints, flexibility.each(values), strict=True))

    def _pressures(self, body: int, thickness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Contact pressures and their slopes at all Gauss points of a body's films."""
        found = [
            np.zeros((2, len(h))) if joint is None else np.stack(joint.touch(h)[1:])
            for joint, h in self._each(body, thickness)
        ]
        pressure, slope = np.hstack(found)
        return pressure, slope

    def near(self, body: int, thickness: np.ndarray) -> np.ndarray:
        """Gauss points of a body's films whose contact counts, see `JointContact.near`."""
        return np.concatenate(
            [
                np.zeros(len(h), dtype=bool) if joint is None else joint.near(h)
                for joint, h in self._each(body, thickness)
            ]
        )

    def reached(self, body: int, points: np.ndarray) -> Reached:
        """Answers to contact at points, and at those reached in this step before."""
        known = self._reached.get(body)
        if known is None or len(np.setdiff1d(points, known.points, assume_unique=True)):
            if known is not None:
                points = np.union1d(points, known.points)
            areas = self.areas[body]
            assert areas is not None
            moved = self._responses.flexibilities[body].pushed_by(points) * areas[points]
            known = self._reached[body] = Reached(points, moved)
        return known

    def amplitudes(self, body: int, thickness: np.ndarray) -> np.ndarray:
        """Amplitudes of a body's residual patterns at rest under contact, shape (r,) [Pa].

        Of gaps at all Gauss points of its films; none where nothing can touch.
        """
        flexibility, areas = self._responses.flexibilities[body], self.areas[body]
        if areas is None:
            return np.zeros(flexibility.size)
        return flexibility.pushed_amplitudes(areas * self._pressures(body, thickness)[0])

    def add_amplitudes(
        self, films: Sequence[FilmPoint], values: list[np.ndarray], rates: list[np.ndarray]
    ) -> None:
        """Add what contact answers for to amplitudes of residual patterns and their rates."""
        for body, areas in enumerate(self.areas):
            if areas is not None:
                flexibility = self._responses.flexibilities[body]
                own = [films[i].gap.thickness.ravel() for i in flexibility.films]
                share = flexibility.share * self.amplitudes(body, np.concatenate(own))
                values[body] = values[body] + share
                rates[body] = rates[body] + flexibility.shift * share


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
        self._contacts, self._responses = contacts, responses
        self._films = films
        self._points = []
        for body, flexibility in enumerate(responses.flexibilities):
            found = np.zeros(0, dtype=int)
            if contacts.areas[body] is not None:
                thickness = [films[i].gap.thickness.ravel() for i in flexibility.films]
                found = np.flatnonzero(contacts.near(body, np.concatenate(thickness)))
            self._points.append(found)
        self._unknowns = consecutive(first, [len(points) for points in self._points])
        self.size = self._unknowns[-1].stop if self._unknowns else first

    def enter(self, core: np.ndarray, speed: np.ndarray) -> None:
        """Take all that does not depend on film pressures into S.

        Parameters
        ----------
        core
            Ones on the diagonal of the contact pressures.
        speed
            Derivative of all rates along the unknowns of motion.
        """
        for i, film in enumerate(self._films):
            joint = self._contacts.joints[i]
            if joint is None:
                continue
            touch = film.touch
            assert touch is not None
            points, unknowns = self._own(i)
            stiffness = touch.slope[points, None] * joint.outward(film.turned)[points]
            forces = joint.per_pressure(film.gap, points, film.turned)
            if unknowns is None:
                core[np.ix_(joint.rows, joint.rows)] -= forces @ stiffness
            else:
                core[np.ix_(joint.rows, unknowns)] -= forces
                core[np.ix_(unknowns, joint.rows)] -= stiffness
            if film.turned is not None:
                core[np.ix_(joint.rows, joint.rows)] -= joint.bent(touch, film.turned)
            if joint.friction:
                along = joint.rubbing_per_rate(touch, film.gap, points)
                core[joint.rows, : speed.shape[1]] += along @ speed[joint.rows]
        for body, points in enumerate(self._points):
            if len(points):
                own = self._unknowns[body]
                core[own, own] -= self._slopes(body)[:, None] * self._moved(body)[points]

    def _own(self, i: int) -> tuple[np.ndarray, np.ndarray | None]:
        """A film's Gauss points that count, and their unknowns where they have any."""
        body = self._responses.of_film(i)
        if body is None:
            joint = self._contacts.joints[i]
            assert joint is not None
            return np.flatnonzero(joint.near(self._films[i].gap.thickness)), None
        rows, points = self._responses.flexibilities[body].rows(i), self._points[body]
        inside = np.flatnonzero((points >= rows.start) & (points < rows.stop))
        return points[inside] - rows.start, inside + self._unknowns[body].start

    def _slopes(self, body: int) -> np.ndarray:
        """``p_c'`` at the points that count, shape (a,)."""
        flexibility = self._responses.flexibilities[body]
        touches = [self._films[i].touch for i in flexibility.films]
        values = [
            np.zeros(self._films[i].gap.thickness.size) if touch is None else touch.slope
            for i, touch in zip(flexibility.films, touches, strict=True)
        ]
        return np.concatenate(values)[self._points[body]]

    def _moved(self, body: int) -> np.ndarray:
        """Gap change at all Gauss points for unit contact pressures, shape (g, a)."""
        reached = self._contacts.reached(body, self._points[body])
        return self._responses.flexibilities[body].share * reached.of(self._points[body])

    def extend(self, i: int, found: FilmBlock, model: FilmModel[Any]) -> FilmBlock:
        """Derivatives of a film with what contact and pressures do by its bore."""
        body = self._responses.of_film(i)
        if body is None or not len(self._points[body]):
            return found
        flexibility, own = self._responses.flexibilities[body], self._unknowns[body]
        moved = self._moved(body)[flexibility.rows(i)]
        spread = np.zeros((moved.shape[1], found.spread.shape[1]))
        spread[:, own] = np.eye(len(spread))
        answered = model.of_pressures(self._responses.pressed_at(body, i, self._points[body]))
        factor = flexibility.share * self._slopes(body)
        return found.extended(
            (found.along_gap @ moved)[model.nodes] / model.scale,
            spread,
            moved,
            (-factor[:, None] * answered, np.arange(own.start, own.stop)),
        )
