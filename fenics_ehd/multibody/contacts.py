"""Contact in all joints of a mechanism, at one evaluation of a step's equations.

Where residual patterns answer pressures at once (M4) the contact moves the gap that it depends on,
``p_c = p_c(h_0 + S p_c)``. Every evaluation solves that by Newton's method, which comes from below
without a step too far: the pressure is convex.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fenics_ehd.base.errors import SettingsError, SolverError
from fenics_ehd.film.asperities import Touch
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.multibody.bore_responses import BoreResponses
from fenics_ehd.multibody.film_columns import FilmPoint
from fenics_ehd.multibody.joint_contact import JointContact, joint_contact
from fenics_ehd.multibody.system import System

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
        self.joints = [joint_contact(place) for place in system.films]
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

    @classmethod
    def of(cls, system: System, responses: BoreResponses) -> Contacts | None:
        """None where all surfaces are smooth."""
        found = cls(system, responses)
        return found if any(found.joints) else None

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
        share, shift = self._responses.share(body), self._responses.shift(body)
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
            gap, shape = gaps[i], gaps[i].thickness.shape
            gaps[i] = replace(
                gap,
                thickness=gap.thickness + change.reshape(shape),
                thickness_rate=gap.thickness_rate + shift * change.reshape(shape),
            )

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
        """See `JointContact.near`, at all Gauss points of a body's films."""
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
        """Of a body's residual patterns at rest under contact, shape (r,) [Pa].

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
                share = self._responses.share(body) * self.amplitudes(body, np.concatenate(own))
                values[body] = values[body] + share
                rates[body] = rates[body] + self._responses.shift(body) * share
