"""Coordinates and equations of motion of a mechanism, the films' forces left out.

Coordinates z are those of the bodies, then each lubricated joint's own. With constraints g and
multipliers l on position and m on velocity level (Gear, Gupta and Leimkuhler 1985),

    z' = v + W G^T m,   F(z, v, v') + G^T l = Q(z, v, t),   g(z, t) = 0,   G v + g_t = 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from fenics_ehd.errors import SettingsError
from fenics_ehd.multibody.body import FINE_WEIGHT, Body
from fenics_ehd.multibody.inertia_forces import Derivatives
from fenics_ehd.multibody.joints import AngleDrive, Joint
from fenics_ehd.multibody.lubricated_joint import Eccentric, JointFilm, LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.planar_body import FlexibleBody, ground
from fenics_ehd.multibody.relation import Geometry, Layout, Load, Relations, Values
from fenics_ehd.multibody.tabulated import TabulatedLoad


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
    bore_body
        Name of the body that has the bore.
    """

    name: str
    joint: LubricatedJoint
    film: JointFilm
    xi: np.ndarray
    rows: slice
    journal_angle: int | None
    bore_angle: int | None
    bore_body: str

    def shaft_rate(self, rates: np.ndarray) -> float:
        """Speed of the journal relative to the bore [rad/s]."""
        ahead = 0.0 if self.journal_angle is None else rates[self.journal_angle]
        return float(ahead - (0.0 if self.bore_angle is None else rates[self.bore_angle]))


@dataclass(frozen=True, eq=False)
class Place:
    """A constraint of the mechanism."""

    name: str
    joint: Joint
    rows: slice
    layout: Layout


class System:
    """Layout of a mechanism; see `Instant` for its equations.

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
    weights
        Diagonal of W, shape (n,).
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
        for name in sorted(mechanism.joints):
            joint = mechanism.joints[name]
            if isinstance(joint, LubricatedJoint):
                film = self._film(name, joint)
                self.films.append(film)
                self._constrain(name, Eccentric(joint.bore, joint.journal, film.film.own == 4))
                weights.append(np.full(film.film.own, FINE_WEIGHT))
            else:
                self._constrain(name, joint)
        for name in sorted(mechanism.drives):
            self._constrain(f"drive of {name}", AngleDrive(name, mechanism.drives[name]))
        self.weights = np.concatenate(weights)
        self.forces = [
            (force, self._layout(force.markers))
            for force in (mechanism.forces[name] for name in sorted(mechanism.forces))
        ]
        self.lift = -np.array(mechanism.gravity)

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
        (bore_name, bore, point), (_, journal, _) = (
            self._named(joint.bore),
            self._named(joint.journal),
        )
        part = bore.reduced if isinstance(bore, FlexibleBody) and point == "bore" else None
        tilting = len(journal.marker(self._named(joint.journal)[2], journal.start).values) == 5
        film = JointFilm(joint, part, tilting)
        last = self.bodies[bore_name].stop
        elastic = np.arange(last - film.size + film.own, last)
        return FilmPlace(
            name,
            joint,
            film,
            np.concatenate([np.arange(self.n, self.n + film.own), elastic]),
            slice(self.m, self.m + film.own),
            self._angle(joint.journal),
            self._angle(joint.bore),
            bore_name,
        )

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
        found: list[TabulatedLoad] = []
        for force in self.mechanism.forces.values():
            table, body = force.table or (None, "")
            rows = getattr(table, "tabulated", None)
            if rows is not None:
                found.append(rows(partial(_read_at, self._angle(body) if body else None)))
        return found

    def at(self, time: float, z: np.ndarray) -> Instant:
        """The mechanism at given coordinates."""
        return Instant(self, time, z)

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


def _read_at(angle: int | None, time: float, state: np.ndarray) -> float:
    """Where a table is read: at an angle of the state, or at the time."""
    return time if angle is None else float(state[angle])


class Instant:
    """Markers and constraints of a system at given coordinates.

    Attributes
    ----------
    values
        Of all relations.
    gradient
        Derivative of all constraints along the values, shape (m, k).
    jacobian, defect
        G, shape (m, n), and g, shape (m,).
    imposed_rate
        What ``G v`` has to be: ``-g_t``, shape (m,).
    """

    def __init__(self, system: System, time: float, z: np.ndarray):
        self.system, self.time, self.z = system, time, z
        self.values = Values(system.relations, z)
        self.gradient = np.zeros((system.m, system.relations.size))
        self.defect, self.imposed_rate = np.empty(system.m), np.zeros(system.m)
        self._geometries: list[tuple[Place, Geometry]] = []
        for place in system.constraints:
            rows, layout = place.rows, place.layout
            geometry = place.joint.geometry(self.values.u[layout.columns], layout.sizes)
            self._geometries.append((place, geometry))
            self.gradient[rows, layout.columns] = geometry.jacobian
            self.defect[rows] = geometry.value
            imposed = place.joint.imposed(time)
            if imposed is not None:
                self.defect[rows] -= imposed.value
                self.imposed_rate[rows] = imposed.rate
        self.jacobian = self.gradient @ self.values.slopes

    @cached_property
    def curvatures(self) -> list[tuple[Place, np.ndarray]]:
        """Constraints that are not linear in the values, and their second derivatives."""
        return [
            (place, geometry.curvature())
            for place, geometry in self._geometries
            if geometry.curvature is not None
        ]

    def rate_defect(self, rates: np.ndarray) -> np.ndarray:
        """``G v + g_t``, shape (m,)."""
        return self.jacobian @ rates - self.imposed_rate

    def form(self, multipliers: np.ndarray) -> np.ndarray:
        """Second derivative of ``multipliers . phi`` along the values, shape (k, k)."""
        result = np.zeros((len(self.values.u),) * 2)
        for place, curvature in self.curvatures:
            own = place.layout.columns
            result[own, own] = multipliers[place.rows] @ curvature.swapaxes(0, 1)
        return result

    def bend(self, multipliers: np.ndarray) -> np.ndarray:
        """Derivative of ``G^T multipliers``, shape (n, n)."""
        return self.values.bend(multipliers @ self.gradient, self.form(multipliers))

    def motion(
        self, rates: np.ndarray, accelerations: np.ndarray, multipliers: np.ndarray
    ) -> Motion:
        """Equations of motion."""
        return Motion(self, rates, accelerations, multipliers)


class Motion:
    """Equations of motion of a system, the films' forces left out.

    Attributes
    ----------
    instant, rates, accelerations, multipliers
        What they are for: v and v', shape (n,), l, shape (m,).
    value_rates
        ``u'``, shape (k,).
    residual
        ``F + G^T l - Q``, shape (n,).
    """

    def __init__(
        self,
        instant: Instant,
        rates: np.ndarray,
        accelerations: np.ndarray,
        multipliers: np.ndarray,
    ):
        self.instant, self.rates, self.accelerations = instant, rates, accelerations
        self.multipliers = multipliers
        values = instant.values
        self.value_rates = values.slopes @ rates
        self._applied: list[tuple[slice, Load]] = []
        self._on_values = multipliers @ instant.gradient
        for force, layout in instant.system.forces:
            own = layout.columns
            load = force.load(instant.time, values.u[own], self.value_rates[own], layout.sizes)
            self._applied.append((own, load))
            self._on_values[own] -= load.value
        self.residual = self._on_values @ values.slopes
        for places, body, motion in self._bodies():
            self.residual[places] += body.forces(*motion, lift=instant.system.lift)

    def _bodies(self) -> Iterator[tuple[slice, Body, list[np.ndarray]]]:
        instant = self.instant
        return instant.system.each_body(instant.z, self.rates, self.accelerations)

    @cached_property
    def _carried(self) -> np.ndarray:
        """Derivative of the values' rates along z, shape (k, n)."""
        return self.instant.values.carry(self.rates)

    def derivatives(self) -> Derivatives:
        """Of the residual along z, v and v', shape (n, n) each."""
        instant, slopes = self.instant, self.instant.values.slopes
        form = instant.form(self.multipliers)
        damping = np.zeros_like(form)
        for own, load in self._applied:
            if load.position is not None:
                form[own, own] -= load.position
            if load.rate is not None:
                damping[own, own] -= load.rate
        damping = slopes.T @ damping
        position = instant.values.bend(self._on_values, form) + damping @ self._carried
        rate, acceleration = damping @ slopes, np.zeros_like(position)
        for places, body, motion in self._bodies():
            parts = body.derivatives(*motion, lift=instant.system.lift)
            position[places, places] += parts.position
            rate[places, places] += parts.rate
            acceleration[places, places] = parts.acceleration
        return Derivatives(position, rate, acceleration)

    def carry(self) -> np.ndarray:
        """Derivative of ``G v`` along z, shape (m, n)."""
        instant = self.instant
        along = np.zeros_like(instant.gradient)
        for place, curvature in instant.curvatures:
            own = place.layout.columns
            along[place.rows, own] = curvature @ self.value_rates[own]
        return along @ instant.values.slopes + instant.gradient @ self._carried

    @property
    def drive_power(self) -> float:
        """Power of what is imposed over time [W]."""
        return float(-self.multipliers @ self.instant.imposed_rate)

    @property
    def applied_power(self) -> float:
        """Power of all forces and of gravity [W]."""
        system = self.instant.system
        power = sum(load.value @ self.value_rates[own] for own, load in self._applied)
        if system.lift.any():
            zero = np.zeros_like(self.rates)
            none = np.zeros(2)
            for _, body, (z, rates, rest) in system.each_body(self.instant.z, self.rates, zero):
                weight = body.forces(z, rest, rest, lift=system.lift)
                weight = weight - body.forces(z, rest, rest, lift=none)
                power -= weight @ rates
        return float(power)
