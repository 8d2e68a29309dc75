"""Mechanisms of bodies, joints, drives and forces: unknowns, and equations of motion.

Coordinates z are those of the bodies, followed by the additional coordinates of every lubricated
joint. With constraints g, multipliers l on position level and m on velocity level (Gear, Gupta and
Leimkuhler 1985), the equations without the forces of the films are

    z' = v + W G^T m,   F(z, v, v') + G^T l = Q(z, v, t),   g(z, t) = 0,   G v + g_t = 0.

`assemble` computes positions and velocities that satisfy every constraint, from a rough pose.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import linalg

from fenics_ehd.base.arguments import copied, require_callable, require_class, require_pair
from fenics_ehd.base.described import Described, Named, names_or_none
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.plane import rotation
from fenics_ehd.film.kinematics import require_read
from fenics_ehd.multibody.body import (
    ANGLE,
    FINE_WEIGHT,
    POSITION,
    WIDTH,
    Balance,
    Body,
    Derivatives,
    Marker,
    ground,
)
from fenics_ehd.multibody.film_binding import BoundSurface, FilmBinding
from fenics_ehd.multibody.forces import Force, Load, Torque
from fenics_ehd.multibody.joints import (
    ACTING_POINTS,
    AngleDrive,
    AngleOverTime,
    Joint,
    Speed,
    named_points,
    require_body,
    require_point,
    require_single_bores,
    require_turning,
    require_two_bodies,
)
from fenics_ehd.multibody.lubricated_joint import Eccentric, JointFilm, LubricatedJoint
from fenics_ehd.multibody.shaft import require_shaft_point
from fenics_ehd.multibody.surface import BORE, Surface
from fenics_ehd.multibody.tabulated import TabulatedLoad, Variation, variations_of


def _require_drive(name: str, value: Any) -> None:
    """Refuse a drive that is not a function of time.

    A torque is accepted here: `System` refuses it with a message of its own.
    """
    if not isinstance(value, Torque):
        require_callable(name, value)


@dataclass(frozen=True, eq=False, repr=False)
class Mechanism(Described):
    """Mechanism: bodies with their joints, drives and forces.

    Attributes
    ----------
    bodies
        Bodies by name; ``ground`` need not be listed.
    joints
        Ideal and lubricated joints by name; their markers are ``"body.point"``, or ``"body"``
        for the body's origin.
    drives
        Functions of time [s] that return angle [rad] and angular speed [rad/s], by name of the
        driven body.
    forces
        Forces and torques by name.
    gravity
        Gravitational acceleration, shape (2,) [m/s^2].
    """

    bodies: Mapping[str, Body]
    joints: Mapping[str, Joint | LubricatedJoint]
    drives: Mapping[str, AngleOverTime] = field(default_factory=dict)
    forces: Mapping[str, Force] = field(default_factory=dict)
    gravity: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        checks: Mapping[str, Callable[[str, Any], None]] = {
            "bodies": lambda name, value: require_class(name, value, Body),
            "joints": lambda name, value: require_class(name, value, Joint, LubricatedJoint),
            "drives": _require_drive,
            "forces": lambda name, value: require_class(name, value, Force),
        }
        for name, check in checks.items():
            members = copied(name, getattr(self, name), check)
            object.__setattr__(self, name, Named(members, f"mechanism.{name}"))
        require_pair("gravity", self.gravity)

    def described(self) -> Iterator[tuple[str, str]]:
        """Yield bodies, joints, drives and forces, with the classes of bodies and joints."""
        yield "Mechanism", f"gravity {tuple(self.gravity)} m/s^2"
        for kind in ("bodies", "joints", "drives", "forces"):
            members = getattr(self, kind).items()
            classes = (f"{name} ({type(member).__name__})" for name, member in members)
            yield kind, names_or_none(getattr(self, kind) if kind == "drives" else classes)

    def variations(self) -> Iterator[tuple[str, Variation]]:
        """Yield the key and the variation of every force, drive and supply that is not constant."""
        for kind in ("forces", "drives", "joints"):
            for name, source in getattr(self, kind).items():
                # A force of two components has two names: "wind.x" and "wind.y".
                key = f"{kind}.{name.partition('.')[0]}"
                for variation in variations_of(source):
                    yield ".".join(filter(None, (key, variation.setting))), variation


@dataclass(frozen=True, eq=False)
class BoundMarker:
    """Marker of joints or forces, bound to the coordinates of the mechanism.

    Attributes
    ----------
    body, point
        Body of the marker, and name of its point on the body.
    dofs
        Indices of the body's coordinates among the coordinates z of the mechanism.
    columns
        Indices of the marker's values in the vector u of the values of all joints and forces, one
        slice for each joint and force with this marker.
    """

    body: Body
    point: str
    dofs: slice
    columns: list[slice] = field(default_factory=list)

    @cached_property
    def _rough(self) -> Marker:
        return self.body.marker(self.point, self.body.start)

    def at(self, z: np.ndarray) -> Marker:
        """Values of the marker and their derivatives at coordinates z of the mechanism."""
        return self.body.marker(self.point, z[self.dofs]) if self.body.size else self._rough


@dataclass(frozen=True, eq=False)
class Constraint:
    """Joint or drive, with the indices of its equations and values among those of all joints.

    Attributes
    ----------
    name, joint
        Name of the joint or drive, and its object.
    rows
        Indices of its equations in the vector g of all constraints.
    columns
        Indices of the values of its markers, and of its additional coordinates, in the vector u of
        the values of all joints and forces.
    """

    name: str
    joint: Joint
    rows: slice
    columns: slice


class System:
    """Mechanism with the indices of its bodies, joints and forces among all unknowns.

    The equations are in `fenics_ehd.multibody.mechanism`.

    Attributes
    ----------
    mechanism
        The mechanism.
    n, m, k
        Numbers of coordinates z, of constraints g, and of values u of all joints and forces.
    bodies, angles
        Indices in z of every body's coordinates, and of the angle of every body that can turn, by
        name of the body.
    markers
        Markers of all joints and forces by name.
    additional
        Pairs of slices: indices of a joint's additional coordinates in u and in z.
    films
        Bindings of the films of all lubricated joints.
    constraints
        Constraints of ideal and lubricated joints, then those of drives.
    forces
        Pairs of a force and the indices of its markers' values in u.
    weights, mobility
        Weights of the velocity multipliers in the rates of the coordinates (diagonal of W), and
        compliances of the coordinates when the mechanism is assembled, shape (n,) each.
    minus_gravity
        Negative gravitational acceleration, shape (2,) [m/s^2].
    """

    def __init__(self, mechanism: Mechanism):
        self.mechanism = mechanism
        for name, load in (*mechanism.drives.items(), *mechanism.forces.items()):
            if isinstance(load, Speed | Torque):
                require_read(load.table, load.curve, f"{name}: table")
        for name, drive in mechanism.drives.items():
            if not callable(drive):
                raise SettingsError(
                    f"drives.{name} must be a Speed or a function that returns angle and angular "
                    "speed at a time: a Torque belongs to forces"
                )
        bodies: dict[str, Body] = {"ground": ground(), **mechanism.bodies}
        # Bodies are sorted by name, so that results do not depend on their order in the mechanism.
        self._bodies = {name: bodies[name] for name in sorted(bodies)}
        self._check_names()
        self.bodies: dict[str, slice] = {}
        self.n = self.m = self.k = 0
        self.angles: dict[str, int] = {}
        for name, body in self._bodies.items():
            self.bodies[name] = slice(self.n, self.n + body.size)
            if body.angle_index is not None:
                self.angles[name] = self.n + body.angle_index
            self.n += body.size
        self._mounted = {
            name: float(body.marker("", body.start).values[ANGLE])
            for name, body in self._bodies.items()
            if body.angle_index is None
        }
        self.markers: dict[str, BoundMarker] = {}
        self.additional: list[tuple[slice, slice]] = []
        self.films: list[FilmBinding] = []
        self.constraints: list[Constraint] = []
        for name in sorted(mechanism.joints):
            joint = mechanism.joints[name]
            if isinstance(joint, LubricatedJoint):
                film = self._film(name, joint)
                self.films.append(film)
                size = film.film.journal_coordinates
                joint = Eccentric(film.surfaces[0].marker, joint.journal, size)
            self._constrain(name, joint)
        for name in sorted(mechanism.drives):
            self._constrain(f"drive of {name}", AngleDrive(name, mechanism.drives[name]))
        count = sum(film.film.journal_coordinates for film in self.films)
        fine = np.full(count, FINE_WEIGHT)
        self.weights = np.concatenate([*(b.weights for b in self._bodies.values()), fine])
        self.mobility = np.concatenate([*(b.mobility for b in self._bodies.values()), fine])
        forces = [mechanism.forces[name] for name in sorted(mechanism.forces)]
        self.forces = [(force, self._columns(force.markers)) for force in forces]
        self.minus_gravity = -np.array(mechanism.gravity)

    def _constrain(self, name: str, joint: Joint) -> None:
        rows = slice(self.m, self.m + joint.rows)
        columns = self._columns(joint.markers, joint.additional)
        self.constraints.append(Constraint(name, joint, rows, columns))
        self.m += joint.rows

    def _columns(self, markers: tuple[str, ...], additional: int = 0) -> slice:
        """Assign new indices in u to the values of markers and to additional coordinates."""
        first = self.k
        for marker in markers:
            name, body, point = self._named(marker)
            bound = self.markers.setdefault(marker, BoundMarker(body, point, self.bodies[name]))
            bound.columns.append(slice(self.k, self.k + WIDTH))
            self.k += WIDTH
        if additional:
            in_u = slice(self.k, self.k + additional)
            in_z = slice(self.n, self.n + additional)
            self.additional.append((in_u, in_z))
            self.k += additional
            self.n += additional
        return slice(first, self.k)

    def _film(self, name: str, joint: LubricatedJoint) -> FilmBinding:
        markers = [self._named(marker) for marker in joint.markers]
        bore, journal = (partial(body.surface, point) for _, body, point in markers)
        film = JointFilm(joint, bore, journal, tilting=markers[1][1].tilts)
        surfaces = [
            self._bound(name, surface, marker)
            for surface, marker in zip(film.surfaces, joint.markers, strict=True)
        ]
        first = np.arange(self.n, self.n + film.journal_coordinates)
        modes = [bound.modes for bound in surfaces if not bound.surface.turning]
        return FilmBinding(
            name,
            joint,
            film,
            np.concatenate([first, *modes]),
            slice(self.m, self.m + film.journal_coordinates),
            (surfaces[0], surfaces[1]),
        )

    def _bound(self, joint: str, surface: Surface, marker: str) -> BoundSurface:
        """Bind a surface of a joint, at a marker, to the coordinates of its body."""
        name, body, point = self._named(marker)
        last = self.bodies[name].stop
        at_rest = f"{name}.{body.at_rest(point)}" if surface.elastic and point else marker
        return BoundSurface(
            surface,
            name,
            point,
            at_rest,
            np.arange(last - surface.modes, last),
            self.angles.get(name),
            self._mounted.get(name, 0.0),
            joint if surface.side.sign == BORE else f"{joint}.journal",
        )

    def _check_names(self) -> None:
        """Refuse names of bodies and points that do not exist, and a bore of two joints.

        Raises
        ------
        SettingsError
            If such a name or bore is found; the message has the key of the joint, force or drive.
        """
        points = {name: body.point_names for name, body in self._bodies.items()}
        mechanism = self.mechanism
        for kind, sources in (("joints", mechanism.joints), ("forces", mechanism.forces)):
            for name, source in sources.items():
                key = f"{kind}.{name}"
                for attribute, marker in named_points(source):
                    require_point(f"{key}.{attribute}", marker, points)
                    if attribute in ACTING_POINTS:
                        body = self._bodies[marker.partition(".")[0]]
                        require_shaft_point(f"{key}.{attribute}", marker, body)
                for marker in source.markers:
                    require_point(key, marker, points)
        for name in mechanism.drives:
            require_body(f"drives.{name}", name, points)
            turns = self._bodies[name].angle_index is not None
            require_turning(f"drives.{name}", name, turns=turns)
        bores: dict[str, str] = {}
        for name, joint in mechanism.joints.items():
            if isinstance(joint, LubricatedJoint):
                require_two_bodies(f"joints.{name}", (joint.journal, joint.bore))
                bores[name] = joint.bore
        require_single_bores(bores)

    def _named(self, marker: str) -> tuple[str, Body, str]:
        """Name of the body of a marker, the body itself, and the name of the marker's point."""
        name, _, point = marker.partition(".")
        return name, self._bodies[name], point

    def each_body(self, *values: np.ndarray) -> Iterator[tuple[slice, Body, list[np.ndarray]]]:
        """Yield indices in z, body, and entries of `values`, for every body that has coordinates.

        `values` are arrays in the order of z. The third item is a list of the body's entries in
        each array.
        """
        for name, body in self._bodies.items():
            dofs = self.bodies[name]
            if body.size:
                yield dofs, body, [value[dofs] for value in values]

    @cached_property
    def tables(self) -> list[TabulatedLoad]:
        """Loads, drives and supplies given by tables, whose rows no time step may miss."""
        return [
            TabulatedLoad(variation.curve, self.angles.get(variation.angle_of))
            for _, variation in self.mechanism.variations()
            if variation.curve is not None
            and (not variation.angle_of or variation.angle_of in self.angles)
        ]

    @cached_property
    def rough_pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates of the mechanism before assembly, and their rates, shape (n,) each."""
        z = np.zeros(self.n)
        v = np.zeros(self.n)
        for dofs, body, _ in self.each_body():
            z[dofs] = body.start
            v[dofs] = body.start_rates
        for film in self.films:
            eccentricity = film.xi[:2]
            z[eccentricity] = film.joint.eccentricity
            v[eccentricity] = film.joint.eccentricity_rate
        return z, v

    def worst(self, rows: np.ndarray) -> tuple[str, float]:
        """Name of the joint or drive with the largest absolute value in its rows, and this value.

        `rows` has a value for each of the m constraints.
        """
        row = int(np.argmax(np.abs(rows)))
        worst = next(c for c in self.constraints if c.rows.start <= row < c.rows.stop)
        return worst.name, float(np.abs(rows[row]))

    @property
    def least_damping(self) -> float:
        """Smallest damping ratio of all modes of all bodies; infinite without modes."""
        return min((body.least_damping for body in self._bodies.values()), default=np.inf)

    @cached_property
    def error_measure(self) -> np.ndarray:
        """Matrix from changes of the coordinates z to dimensionless errors, shape (k, n).

        See `Body.error_measure`.
        """
        measure = linalg.block_diag(*(body.error_measure() for body in self._bodies.values()))
        return np.pad(measure, ((0, 0), (0, self.n - measure.shape[1])))


def consecutive(first: int, sizes: Sequence[int]) -> list[slice]:
    """Slices of the given sizes that follow each other; the first one begins at index `first`."""
    ends = [first, *(first + np.cumsum(sizes, dtype=int))]
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]


class Instant:
    """Markers and constraints of a mechanism at given coordinates.

    Attributes
    ----------
    system, time, z
        Mechanism, time [s] and coordinates, shape (n,).
    u, values_along
        Values u of all joints and forces, shape (k,), and their derivative U with respect to z,
        shape (k, n).
    gradient
        Derivative of all constraints with respect to u, shape (m, k).
    jacobian, defect
        Derivative G of all constraints with respect to z, shape (m, n), and values g of the
        constraints, shape (m,).
    imposed_rate
        Rates that the drives impose on the constraints, ``-g_t``, shape (m,).
    """

    def __init__(self, system: System, time: float, z: np.ndarray):
        self.system = system
        self.time = time
        self.z = z
        self.u = np.zeros(system.k)
        self.values_along = np.zeros((system.k, system.n))
        self._markers = [(bound, bound.at(z)) for bound in system.markers.values()]
        for bound, marker in self._markers:
            for columns in bound.columns:
                self.u[columns] = marker.values
                self.values_along[columns, bound.dofs] = marker.jacobian
        for in_u, in_z in system.additional:
            self.u[in_u] = z[in_z]
            self.values_along[in_u, in_z] = np.eye(in_z.stop - in_z.start)
        self.gradient = np.zeros((system.m, system.k))
        self.defect = np.zeros(system.m)
        self.imposed_rate = np.zeros(system.m)
        self._curved: list[tuple[Constraint, Callable[[], np.ndarray]]] = []
        for constraint in system.constraints:
            rows = constraint.rows
            joint = constraint.joint
            geometry = joint.geometry(self.u[constraint.columns])
            self.gradient[rows, constraint.columns] = geometry.jacobian
            self.defect[rows] = geometry.value
            if geometry.curvature is not None:
                self._curved.append((constraint, geometry.curvature))
            imposed = joint.imposed(time)
            if imposed is not None:
                self.defect[rows] -= imposed[0]
                self.imposed_rate[rows] = imposed[1]
        self.jacobian = self.gradient @ self.values_along

    @cached_property
    def _curvatures(self) -> list[tuple[Constraint, np.ndarray]]:
        """Constraints that are not linear in u, each with its second derivatives."""
        return [(constraint, curvature()) for constraint, curvature in self._curved]

    def rate_defect(self, rates: np.ndarray) -> np.ndarray:
        """Defect of the constraints on velocity level, ``G v + g_t``, shape (m,)."""
        return self.jacobian @ rates - self.imposed_rate

    def force_derivative(self, multipliers: np.ndarray) -> np.ndarray:
        """Derivative of the constraint forces ``G^T l`` with respect to z, for multipliers l.

        Its shape is (n, n).
        """
        return self.values_derivative(multipliers @ self.gradient, self.form(multipliers))

    def form(self, multipliers: np.ndarray) -> np.ndarray:
        """Second derivative of ``l . phi`` with respect to u, shape (k, k).

        phi are the constraints as functions of the values u of all joints and forces, l their
        multipliers, shape (m,).
        """
        result = np.zeros((len(self.u),) * 2)
        for constraint, curvature in self._curvatures:
            columns = constraint.columns
            result[columns, columns] = multipliers[constraint.rows] @ curvature.swapaxes(0, 1)
        return result

    def values_derivative(self, force: np.ndarray, form: np.ndarray) -> np.ndarray:
        """Derivative of the generalised forces ``U^T f`` with respect to z, shape (n, n).

        U is the derivative of the values u of all joints and forces with respect to z. `force` are
        the forces f on u, shape (k,), and `form` is the derivative of f with respect to u, shape
        (k, k).
        """
        result = self.values_along.T @ (form @ self.values_along)
        for bound, marker in self._markers:
            if marker.force_derivative is not None:
                for columns in bound.columns:
                    result[bound.dofs, bound.dofs] += marker.force_derivative(force[columns])
        return result

    def rate_derivative(self, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives with respect to z of the rates of values and of constraints, for rates v.

        They are the derivatives of ``U v``, the rates of the values u of all joints and forces,
        shape (k, n), and of ``G v``, the rates of the constraints, shape (m, n).
        """
        values = np.zeros_like(self.values_along)
        along = np.zeros_like(self.gradient)
        for bound, marker in self._markers:
            if marker.rate_derivative is not None:
                carried = marker.rate_derivative(rates[bound.dofs])
                for columns in bound.columns:
                    values[columns, bound.dofs] = carried
        value_rates = self.values_along @ rates
        for constraint, curvature in self._curvatures:
            columns = constraint.columns
            along[constraint.rows, columns] = curvature @ value_rates[columns]
        return values, along @ self.values_along + self.gradient @ values


class Motion:
    """Equations of motion of a mechanism without the forces of the films.

    Attributes
    ----------
    instant
        Markers and constraints at the coordinates z.
    rates, accelerations, multipliers
        Rates v and accelerations v', shape (n,) each, and multipliers l, shape (m,).
    value_rates
        Rates ``u'`` of the values of joints and forces, shape (k,).
    on_values
        Generalised forces on the values u of joints and forces, shape (k,): constraint forces
        ``l . phi_u`` less the applied forces.
    residual
        Residual ``F + G^T l - Q`` of the equations of motion, shape (n,): forces F of inertia,
        stiffness and damping, plus constraint forces, less the applied forces Q.
    """

    def __init__(
        self,
        instant: Instant,
        rates: np.ndarray,
        accelerations: np.ndarray,
        multipliers: np.ndarray,
    ):
        self.instant = instant
        self.rates = rates
        self.accelerations = accelerations
        self.multipliers = multipliers
        self.value_rates = instant.values_along @ rates
        self._applied: list[tuple[slice, Load]] = []
        self.on_values = multipliers @ instant.gradient
        system = instant.system
        for force, columns in system.forces:
            load = force.load(instant.time, instant.u[columns], self.value_rates[columns])
            self._applied.append((columns, load))
            self.on_values[columns] -= load.value
        self.residual = self.on_values @ instant.values_along
        self._balances: list[tuple[slice, Balance]] = []
        for dofs, body, motion in system.each_body(instant.z, rates, accelerations):
            balance = body.balance(*motion, minus_gravity=system.minus_gravity)
            self.residual[dofs] += balance.forces
            self._balances.append((dofs, balance))

    @cached_property
    def carried(self) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives with respect to z of the rates of values and of constraints.

        See `Instant.rate_derivative`, of which these are the results for the rates v.
        """
        return self.instant.rate_derivative(self.rates)

    def on_points(self, name: str, points: Collection[str]) -> np.ndarray:
        """Forces that joints and loads exert on points of a body, two components per point [N].

        `name` is that of the body, `points` are the names of its points. The components are x and y
        in the frame of the body, for points in the order of their names.
        """
        instant = self.instant
        forces = np.zeros((len(points), 2))
        for force, point in zip(forces, sorted(points), strict=True):
            marker = instant.system.markers.get(f"{name}.{point}")
            for columns in () if marker is None else marker.columns:
                force -= self.on_values[columns][POSITION] @ rotation(instant.u[columns][ANGLE])
        return forces.ravel()

    def derivatives(self) -> Derivatives:
        """Derivatives of the residual of motion with respect to z, v and v', shape (n, n) each.

        z, v and v' are the coordinates, their rates and their accelerations.
        """
        instant = self.instant
        along = instant.values_along
        form = instant.form(self.multipliers)
        damping = np.zeros_like(form)
        for columns, load in self._applied:
            if load.position is not None:
                form[columns, columns] -= load.position
            if load.rate is not None:
                damping[columns, columns] -= load.rate
        position = instant.values_derivative(self.on_values, form)
        rate = np.zeros_like(position)
        acceleration = np.zeros_like(position)
        if damping.any():
            damping = along.T @ damping
            position += damping @ self.carried[0]
            rate += damping @ along
        for dofs, balance in self._balances:
            parts = balance.derivatives()
            position[dofs, dofs] += parts.position
            rate[dofs, dofs] += parts.rate
            acceleration[dofs, dofs] = parts.acceleration
        return Derivatives(position, rate, acceleration)

    @property
    def drive_power(self) -> float:
        """Power of all drives on the mechanism [W]."""
        return float(-self.multipliers @ self.instant.imposed_rate)

    @property
    def applied_power(self) -> float:
        """Power of all applied forces and of gravity on the mechanism [W]."""
        system = self.instant.system
        power = sum(load.value @ self.value_rates[columns] for columns, load in self._applied)
        if system.minus_gravity.any():
            resting = np.zeros_like(self.rates)
            for _, body, (z, rates, rest) in system.each_body(self.instant.z, self.rates, resting):
                heavy = body.balance(z, rest, rest, minus_gravity=system.minus_gravity)
                weightless = body.balance(z, rest, rest, minus_gravity=np.zeros(2))
                power -= (heavy.forces - weightless.forces) @ rates
        return float(power)


#: Largest number of Newton iterations on positions, and of halvings of one Newton step.
MAX_ITERATIONS = 50

#: Largest defect of the constraints after assembly [m], [rad].
TOLERANCE = 1e-12

#: Distance of a constraint's gradient from the span of the other gradients, over the length of the
#: gradient, above which the constraint is independent of the others.
INDEPENDENT = 1e-9

#: Smallest singular value of inertia, stiffness and constraints, over the largest one, below which
#: nothing resists a motion.
NOTHING = 1e-10


def assemble(
    system: System,
    time: float = 0.0,
    rough: np.ndarray | None = None,
    rates: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates and rates near to rough values that satisfy all constraints, shape (n,) each.

    Frames of bodies move, and shafts move as rigid bodies. Eccentricities and elastic coordinates
    change as little as possible. The rough coordinates and rates are those of the bodies unless
    `rough` and `rates` are given.

    Raises
    ------
    SettingsError
        If the constraints cannot be satisfied from the rough values, or contradict or repeat each
        other.
    """
    start, start_rates = system.rough_pose
    instant = Instant(system, time, start if rough is None else rough)
    rates = start_rates if rates is None else rates
    unknown = ~np.isfinite(instant.defect)
    if unknown.any():
        name, _ = system.worst(unknown.astype(float))
        raise SettingsError(f"joint {name}: the positions of its bodies must be finite numbers")
    # Refuses joints that repeat each other, which they do in the rough pose, too.
    _correction(system, instant, instant.defect)
    for _ in range(MAX_ITERATIONS):
        if np.abs(instant.defect).max(initial=0.0) <= TOLERANCE:
            return instant.z, rates + _correction(system, instant, instant.rate_defect(rates))
        try:
            instant = _closer(instant, _correction(system, instant, instant.defect))
        except SettingsError:
            break
    name, defect = system.worst(instant.defect)
    raise SettingsError(
        f"the mechanism cannot be assembled from its rough pose: joint {name} stays open by "
        f"{defect:.3g} (m or rad): check lengths, or give better positions at the start"
    )


def _closer(instant: Instant, change: np.ndarray) -> Instant:
    """Markers and constraints after a Newton step on the constraints.

    The step `change` of the coordinates is halved until the largest defect decreases.
    """
    before = np.abs(instant.defect).max()
    for halving in range(MAX_ITERATIONS):
        trial = Instant(instant.system, instant.time, instant.z + 0.5**halving * change)
        if np.abs(trial.defect).max() < before:
            break
    return trial


def _correction(system: System, instant: Instant, defect: np.ndarray) -> np.ndarray:
    """Smallest change of the coordinates that removes a defect of the constraints, shape (n,).

    Changes are weighted by the compliance of the coordinates. `defect` has the shape (m,).
    """
    weights = system.mobility
    if not len(defect):  # no joints: LAPACK refuses empty matrices
        return np.zeros_like(weights)
    gradients = (instant.jacobian * weights).T
    lengths = np.linalg.norm(gradients, axis=0)
    if not lengths.all():
        name, _ = system.worst((lengths == 0.0).astype(float))
        raise SettingsError(
            f"joint {name} connects only bodies that cannot move: remove it, or let a body move"
        )
    q, r, order = linalg.qr(gradients / lengths, mode="economic", pivoting=True)
    rank = int(np.sum(np.abs(np.diag(r)) > INDEPENDENT))
    if rank < len(order):
        name, _ = system.worst(np.arange(len(order)) == order[rank])
        raise SettingsError(
            f"joint {name} repeats or contradicts other joints: remove one of them, or let {name} "
            "turn or slide; a linkage at a change point has to be assembled in another position"
        )
    scaled = (defect / lengths)[order]
    return -weights * (q @ linalg.solve_triangular(r, scaled, trans="T"))


def check_inertia(system: System, z: np.ndarray) -> None:
    """Refuse a mechanism with a motion of frames that nothing resists.

    Constraints, inertia, springs and dampers resist a motion. The shear of the oil does not count,
    because the equations of a step do not contain its derivative.

    Raises
    ------
    SettingsError
        If such a motion exists; the message has the name of the body that moves.
    """
    frames = np.flatnonzero(system.weights == 1.0)
    rest = np.zeros(system.n)
    instant = Instant(system, 0.0, z)
    forces = Motion(instant, rest, rest, np.zeros(system.m)).derivatives()
    blocks = [
        instant.jacobian[:, frames],
        *(part[np.ix_(frames, frames)] for part in vars(forces).values()),
    ]
    name = unresisted(system, frames, blocks)
    if name:
        raise SettingsError(
            f"body {name} can move or turn freely without inertia: give it mass and inertia, or a "
            "joint or drive that holds it"
        )


def unresisted(system: System, columns: np.ndarray, blocks: Sequence[np.ndarray]) -> str:
    """Name of the body that moves most in a motion without resistance; empty if there is none.

    Parameters
    ----------
    system
        The mechanism.
    columns
        Indices in z of the k coordinates that may move.
    blocks
        Matrices of constraints, stiffness and inertia with a column for each of these coordinates,
        shape (any, k) each.
    """
    _, sizes, motions = linalg.svd(np.vstack([_directions(block) for block in blocks]))
    if not len(columns) or (len(sizes) == len(columns) and sizes[-1] >= NOTHING * sizes[0]):
        return ""
    free = np.zeros(system.n)
    free[columns] = np.abs(motions[-1])
    return max(system.bodies, key=lambda name: free[system.bodies[name]].max(initial=0.0))


def _directions(rows: np.ndarray) -> np.ndarray:
    """Rows of a matrix scaled to length 1; rows that are only round-off are omitted."""
    lengths = np.linalg.norm(rows, axis=1)
    kept = lengths > 1e-14 * lengths.max(initial=0.0)
    return rows[kept] / lengths[kept, None]
