"""Where everything of a mechanism is: coordinates of bodies and films, constraints, forces.

Coordinates z are those of the bodies, then each lubricated joint's own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.multibody.body import FINE_WEIGHT, Body
from fenics_ehd.multibody.flexible_body import FlexibleBody
from fenics_ehd.multibody.joints import AngleDrive, Joint, SpeedTable
from fenics_ehd.multibody.lubricated_joint import Eccentric, JointFilm, LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.relation import Layout, Relations
from fenics_ehd.multibody.rigid_body import ground
from fenics_ehd.multibody.tabulated import Curve, TabulatedLoad


@dataclass(frozen=True, eq=False)
class FilmPlace:
    """A lubricated joint's film and where its coordinates are.

    Attributes
    ----------
    name, joint, film
        See there.
    xi
        Places of ``(e, psi, q)`` in z, shape (n,).
    rows
        Places of the joint's constraints in g.
    journal_angle, bore_angle
        Places of the bodies' angles in z, None for one that cannot turn.
    bore_body, bore
        Name of the body that has the bore, and of the bore where it is flexible, else empty.
    """

    name: str
    joint: LubricatedJoint
    film: JointFilm
    xi: np.ndarray
    rows: slice
    journal_angle: int | None
    bore_angle: int | None
    bore_body: str
    bore: str

    def ahead(self, values: np.ndarray) -> float:
        """Journal's angle less the bore's, of coordinates [rad] or of their rates [rad/s]."""
        journal, bore = self.angles(values)
        return float(journal - bore)

    @cached_property
    def turning(self) -> list[tuple[int, float]]:
        """Places of the angles that `ahead` is made of, and their signs in it."""
        ends = (self.journal_angle, 1.0), (self.bore_angle, -1.0)
        return [(angle, sign) for angle, sign in ends if angle is not None]

    def angles(self, values: np.ndarray) -> tuple[float, float]:
        """Of journal and bore in the frame at rest, of coordinates or of their rates."""
        journal, bore = (
            0.0 if place is None else values[place]
            for place in (self.journal_angle, self.bore_angle)
        )
        return journal, bore


@dataclass(frozen=True, eq=False)
class Place:
    """A constraint of the mechanism."""

    name: str
    joint: Joint
    rows: slice
    layout: Layout


class System:
    """Layout of a mechanism; see `fenics_ehd.multibody.motion` for its equations.

    Attributes
    ----------
    mechanism
        What it is of.
    n, m
        Numbers of coordinates and constraints.
    bodies
        Places of every body's coordinates in z, by name.
    films
        Lubricated joints.
    weights, mobility
        Diagonal of W, and how readily assembly changes each coordinate, shape (n,).
    """

    def __init__(self, mechanism: Mechanism):
        self.mechanism = mechanism
        bodies: dict[str, Body] = {"ground": ground(), **mechanism.bodies}
        # By name: results do not depend on the order in which things are listed.
        self._bodies = {name: bodies[name] for name in sorted(bodies)}
        self.relations = Relations()
        self.bodies: dict[str, slice] = {}
        self.n = 0
        for name, body in self._bodies.items():
            self.bodies[name] = slice(self.n, self.n + body.size)
            self.n += body.size
        self.m = 0
        self.films: list[FilmPlace] = []
        self.constraints: list[Place] = []
        weights = [body.weights for body in self._bodies.values()]
        mobility = [body.mobility for body in self._bodies.values()]
        for name in sorted(mechanism.joints):
            joint = mechanism.joints[name]
            if isinstance(joint, LubricatedJoint):
                film = self._film(name, joint)
                self.films.append(film)
                bore = self.bore_at_rest(film)
                self._constrain(name, Eccentric(bore, joint.journal, film.film.own == 4))
                weights.append(np.full(film.film.own, FINE_WEIGHT))
            else:
                self._constrain(name, joint)
        for name in sorted(mechanism.drives):
            self._constrain(f"drive of {name}", AngleDrive(name, mechanism.drives[name]))
        self.weights = np.concatenate(weights)
        self.mobility = np.concatenate([*mobility, *weights[len(mobility) :]])
        self.forces = [
            (force, self._layout(force.markers))
            for force in (mechanism.forces[name] for name in sorted(mechanism.forces))
        ]
        self.lift = -np.array(mechanism.gravity)

    @property
    def heated(self) -> bool:
        """Whether the heat of a film is balanced."""
        return any(place.joint.heat is not None for place in self.films)

    def _constrain(self, name: str, joint: Joint) -> None:
        own = slice(self.n, self.n + joint.own)
        rows = slice(self.m, self.m + joint.rows)
        self.constraints.append(Place(name, joint, rows, self._layout(joint.markers, own)))
        self.n, self.m = self.n + joint.own, self.m + joint.rows

    def _layout(self, markers: tuple[str, ...], own: slice = slice(0, 0)) -> Layout:
        """Of markers and own coordinates."""
        named = [(marker, *self._named(marker)) for marker in markers]
        return self.relations.add(
            [(marker, body, point, self.bodies[name]) for marker, name, body, point in named], own
        )

    def _film(self, name: str, joint: LubricatedJoint) -> FilmPlace:
        (bore_name, bore, point), (journal_name, journal, _) = (
            self._named(joint.bore),
            self._named(joint.journal),
        )
        if journal_name == bore_name:
            raise SettingsError(
                f"joint {name}: journal and bore are points of one body, {bore_name}"
            )
        for other in self.films:
            if other.joint.bore == joint.bore:
                raise SettingsError(
                    f"joint {name}: {joint.bore} is the bore of {other.name} already; a bore holds "
                    "one journal: give the second a point of its own"
                )
        part = None
        if isinstance(bore, FlexibleBody) and point in bore.reduced.bores:
            part = bore.reduced.at_bore(point)
        tilting = len(journal.marker(self._named(joint.journal)[2], journal.start).values) == 5
        film = JointFilm(joint, part, tilting)
        last = self.bodies[bore_name].stop
        modes = np.arange(last - film.size + film.own, last)
        return FilmPlace(
            name,
            joint,
            film,
            np.concatenate([np.arange(self.n, self.n + film.own), modes]),
            slice(self.m, self.m + film.own),
            self._angle(joint.journal),
            self._angle(joint.bore),
            bore_name,
            "" if part is None else point,
        )

    def bore_at_rest(self, place: FilmPlace) -> str:
        """Marker of the undeformed bore of a film."""
        body = self._bodies[place.bore_body]
        if isinstance(body, FlexibleBody) and place.bore:
            return f"{place.bore_body}.{body.at_rest(place.bore)}"
        return place.joint.bore

    def _named(self, marker: str) -> tuple[str, Body, str]:
        """Body and point of a marker.

        Raises
        ------
        SettingsError
            There is no such body or point.
        """
        name, _, point = marker.partition(".")
        if name not in self._bodies:
            raise SettingsError(f"{marker!r}: no body {name}, there are {', '.join(self._bodies)}")
        body = self._bodies[name]
        if point and point not in body.points():
            known = ", ".join(body.points()) or "none but its origin"
            raise SettingsError(
                f"{marker!r}: body {name} has no point {point}, its points: {known}"
            )
        return name, body, point

    def _angle(self, marker: str) -> int | None:
        name, body, _ = self._named(marker)
        return None if body.angle is None else self.bodies[name].start + body.angle

    def each_body(self, *values: np.ndarray) -> Iterator[tuple[slice, Body, list[np.ndarray]]]:
        """Places, body and its share of some arrays over z, body by body."""
        for name, body in self._bodies.items():
            places = self.bodies[name]
            if body.size:
                yield places, body, [value[places] for value in values]

    def each_name(self) -> Iterator[tuple[str, Body]]:
        """Name and body of all that have coordinates."""
        return ((name, body) for name, body in self._bodies.items() if body.size)

    @cached_property
    def tables(self) -> list[TabulatedLoad]:
        """Loads whose rows no step may jump over."""
        found = [
            TabulatedLoad(drive.speed, partial(_read_at, None))
            for drive in self.mechanism.drives.values()
            if isinstance(drive, SpeedTable)
        ]
        for force in self.mechanism.forces.values():
            table, body = force.table or (None, "")
            if isinstance(table, Curve):
                read_at = partial(_read_at, self._angle(body) if body else None)
                found.append(TabulatedLoad(table, read_at))
        for film in self.films:
            for feed in film.joint.film.parameters.feeds:
                if isinstance(feed.pressure, Curve):
                    found.append(TabulatedLoad(feed.pressure, partial(_read_at, None)))
        return found

    @cached_property
    def linear_constraints(self) -> tuple[np.ndarray, np.ndarray, list[Place]]:
        """Gradient (m, k) and constants (m,) of those linear in the values, and the other ones."""
        gradient, constant = np.zeros((self.m, self.relations.size)), np.zeros(self.m)
        curved = []
        for place in self.constraints:
            columns, sizes = place.layout.columns, place.layout.sizes
            geometry = place.joint.geometry(np.zeros(columns.stop - columns.start), sizes)
            if geometry.curvature is None:
                gradient[place.rows, columns] = geometry.jacobian
                constant[place.rows] = geometry.value
            else:
                curved.append(place)
        return gradient, constant, curved

    @cached_property
    def start(self) -> np.ndarray:
        """Coordinates of the rough pose, shape (n,)."""
        z = np.zeros(self.n)
        for name, body in self._bodies.items():
            z[self.bodies[name]] = body.start
        for film in self.films:
            z[film.xi[:2]] = film.joint.eccentricity
        return z

    @cached_property
    def start_rates(self) -> np.ndarray:
        """Their rates, shape (n,)."""
        v = np.zeros(self.n)
        for name, body in self._bodies.items():
            v[self.bodies[name]] = body.start_rates
        for film in self.films:
            v[film.xi[:2]] = film.joint.eccentricity_rate
        return v

    def worst(self, rows: np.ndarray) -> tuple[str, float]:
        """Name of the constraint with the largest of some values, shape (m,), and its size."""
        row = int(np.argmax(np.abs(rows)))
        place = next(p for p in self.constraints if p.rows.start <= row < p.rows.stop)
        return place.name, float(np.abs(rows[row]))

    @property
    def least_damping(self) -> float:
        """Smallest damping ratio of a mode of any body."""
        return min((body.least_damping for body in self._bodies.values()), default=np.inf)

    @cached_property
    def error_measure(self) -> np.ndarray:
        """Rows that make body coordinates dimensionless for the step control, shape (k, n)."""
        rows = []
        for name, body in self._bodies.items():
            measure = body.error_measure()
            wide = np.zeros((len(measure), self.n))
            wide[:, self.bodies[name]] = measure
            rows.append(wide)
        return np.vstack(rows)


def consecutive(first: int, sizes: Sequence[int]) -> list[slice]:
    """Places of so many values, one after the other, the first behind `first` others."""
    ends = [first, *(first + np.cumsum(sizes, dtype=int))]
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]


def _read_at(angle: int | None, time: float, state: np.ndarray) -> float:
    """Where a table is read: at an angle of the state, or at the time."""
    return time if angle is None else float(state[angle])
