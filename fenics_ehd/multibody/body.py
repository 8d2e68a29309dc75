"""Bodies of a mechanism: markers, inertia in a planar floating frame, rigid and flexible ones.

A point of a body with its angle, as a function of the body's coordinates.

Joints, drives and forces know bodies by their markers alone: ``u = (x, y, angle)`` in the
frame at rest and, where a body offers it, the tilt ``(psi_x, psi_y)`` of its axis.

Interface of a body to a mechanism.

Inertia of a body in a planar floating frame, with exact derivatives.

A material point lies at ``x + A(theta) p`` with ``p = B s``, ``s = (0, 0, 1, q)`` and B the
fields of `InertiaIntegrals` in the order of ``(x, y, theta, q)``. In the body's frame its
acceleration is

    p'' + A^T x'' + 2 theta' S p' + theta'' S p + theta'^2 S S p:

relative, Coriolis, Euler and centrifugal terms, complete, because p is affine in q.

Common part of bodies with planar rigid motion.

Rigid bodies, and the ground.

A reduced part as a body, free or held.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Protocol

import numpy as np
from scipy import linalg

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.plane import rotation
from fenics_ehd.reduction.body import ELASTIC, InertiaIntegrals, ReducedBody

#: Places of position, angle and tilt in a marker's values.
POSITION, ANGLE, TILT = slice(0, 2), 2, slice(3, 5)


@dataclass(frozen=True, eq=False)
class Marker:
    """One marker at one instant, k values of n coordinates.

    Attributes
    ----------
    values
        ``u``, shape (k,) [m], [rad].
    jacobian
        ``du/dz``, shape (k, n).
    bend
        For f of shape (k,), the derivative of ``jacobian^T f``, shape (n, n); None: zero.
    carry
        For rates of shape (n,), the derivative of ``jacobian @ rates``, shape (k, n); None: zero.
    """

    values: np.ndarray
    jacobian: np.ndarray
    bend: Callable[[np.ndarray], np.ndarray] | None = None
    carry: Callable[[np.ndarray], np.ndarray] | None = None


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of forces along coordinates, their rates and accelerations, (n, n) each."""

    position: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray


class FrameInertia:
    """Inertia forces on ``(x, y, theta, q)`` at one instant.

    Parameters
    ----------
    integrals
        Of the body, `in_order_of_coordinates`.
    coordinates, rates, accelerations
        shape (3 + n,).
    lift
        Added to the accelerations of x and y: gravity, against its pull, shape (2,) [m/s^2].
    """

    def __init__(
        self,
        integrals: InertiaIntegrals,
        coordinates: np.ndarray,
        rates: np.ndarray,
        accelerations: np.ndarray,
        lift: np.ndarray,
    ):
        self._integrals, self._frame_rates = integrals, rates[:3]
        self._turn = rotation(coordinates[2])
        self._omega, self._alpha = rates[2], accelerations[2]
        # s, s' and p'' + A^T x'' in the fields of the integrals.
        s, rate, acceleration = coordinates.copy(), rates.copy(), accelerations.copy()
        s[:2], s[2], rate[:3], acceleration[2] = 0.0, 1.0, 0.0, 0.0
        acceleration[:2] = (accelerations[:2] + lift) @ self._turn
        self._fields = s, rate, acceleration
        self._spun, self._drawn = integrals.spin @ s, integrals.centrifugal @ s

    @cached_property
    def _on_fields(self) -> np.ndarray:
        """Forces on x and y in the body's frame, moment, forces on q."""
        s, rate, acceleration = self._fields
        swung = 2 * self._omega * rate + self._alpha * s
        forces = self._integrals.mass @ acceleration + self._integrals.spin @ swung
        forces -= self._omega**2 * self._drawn
        # (S B)^T M B = -G, antisymmetric.
        forces[2] = self._drawn @ swung + self._spun @ acceleration
        return forces

    @property
    def forces(self) -> np.ndarray:
        """Generalised inertia forces, shape (3 + n,)."""
        forces = self._on_fields.copy()
        forces[:2] = self._turn @ forces[:2]
        return forces

    def derivatives(self) -> Derivatives:
        """Derivatives of `forces`."""
        s, rate, acceleration = self._fields
        omega, alpha = self._omega, self._alpha
        m, g, c = self._integrals.mass, self._integrals.spin, self._integrals.centrifugal
        g_s, c_s, c_rate = self._spun, self._drawn, c @ rate
        n = len(s)
        # x and y in the body's frame.
        parts = np.zeros((3, n, n))
        position, by_rate, by_acceleration = parts
        by_acceleration[:] = m
        by_acceleration[:, 2] = by_acceleration[2] = g_s
        by_acceleration[2, 2] = s @ c_s
        by_rate[:, 2] = 2 * (g @ rate - omega * c_s)
        by_rate[2, 2] = 2 * (s @ c_rate)
        if n > 3:
            by_rate[:, 3:] = 2 * omega * g[:, 3:]
            by_rate[2, 3:] = 2 * omega * c_s[3:]
            position[:, 3:] = alpha * g[:, 3:] - omega**2 * c[:, 3:]
            position[2, 3:] = (2 * (omega * c_rate + alpha * c_s) - g @ acceleration)[3:]
        # d(A^T x'')/d theta = -S A^T x''
        position[:, 2] = acceleration[1] * m[:, 0] - acceleration[0] * m[:, 1]
        position[0, 2] -= self._on_fields[1]
        position[1, 2] += self._on_fields[0]
        position[2, 2] = g_s[0] * acceleration[1] - g_s[1] * acceleration[0]
        # x and y at rest.
        parts[:, :2] = self._turn @ parts[:, :2]
        by_acceleration[:, :2] = by_acceleration[:, :2] @ self._turn.T
        return Derivatives(position, by_rate, by_acceleration)

    @property
    def kinetic_energy(self) -> float:
        """[J]."""
        s, rate, _ = self._fields
        velocity = rate.copy()
        velocity[:2] = self._frame_rates[:2] @ self._turn
        omega, i = self._omega, self._integrals
        return float(
            0.5 * velocity @ i.mass @ velocity
            + omega * velocity @ self._spun
            + 0.5 * omega**2 * s @ self._drawn
        )


def in_order_of_coordinates(integrals: InertiaIntegrals) -> InertiaIntegrals:
    """With the fields in the order ``(x, y, theta, q)``: the position moves with the angle."""
    order = np.arange(len(integrals.mass))
    order[:3] = 1, 2, 0
    names = ("mass", "spin", "centrifugal")
    return replace(integrals, **{n: getattr(integrals, n)[np.ix_(order, order)] for n in names})


def rigid_integrals(mass: float, inertia: float, centre: np.ndarray) -> InertiaIntegrals:
    """Integrals of a body without elastic coordinates.

    Parameters
    ----------
    mass, inertia
        [kg], [kg m^2] about the centre of mass.
    centre
        Centre of mass from the body's origin, shape (2,) [m].
    """
    x, y = centre
    m = np.diag([inertia + mass * (x * x + y * y), mass, mass])
    m[0, 1:] = m[1:, 0] = mass * x, mass * y
    spin = mass * np.array([[0.0, y, -x], [-y, 0.0, -1.0], [x, 1.0, 0.0]])
    return InertiaIntegrals(m, spin, m.copy())


def with_total(
    integrals: InertiaIntegrals,
    mass: float | None,
    inertia: float | None,
    centre: np.ndarray | None,
) -> InertiaIntegrals:
    """Integrals with another total mass, inertia and centre; None keeps what is there.

    Only the rigid part changes, by what a rigid body fixed to the frame would add.
    """
    own = integrals.total_mass, integrals.polar_inertia, integrals.centre_of_mass
    present = rigid_integrals(*own)
    wanted = rigid_integrals(
        own[0] if mass is None else mass,
        own[1] if inertia is None else inertia,
        own[2] if centre is None else centre,
    )
    parts = {}
    for name in ("mass", "spin", "centrifugal"):
        matrix = getattr(integrals, name).copy()
        matrix[:3, :3] += getattr(wanted, name) - getattr(present, name)
        parts[name] = matrix
    return replace(integrals, **parts)


#: Weight of multipliers on coordinates that the films see, next to 1 on frames: about the square
#: of clearance over length. A weight of 1 turns the drift of the large motion into false squeeze
#: velocities, 0 is singular where two films carry one body (DESIGN, fact 6).
FINE_WEIGHT = 1e-7


@dataclass(frozen=True)
class Energies:
    """Energies of one body at one instant [J], and the power that its damping takes [W]."""

    kinetic: float = 0.0
    strain: float = 0.0
    dissipated: float = 0.0


@dataclass(frozen=True, eq=False)
class Balance:
    """Forces of one body at one instant.

    Attributes
    ----------
    forces
        Generalised, shape (n,).
    derivatives
        Makes theirs.
    """

    forces: np.ndarray
    derivatives: Callable[[], Derivatives]


class Body(Protocol):
    """A body with n coordinates."""

    @property
    def size(self) -> int:
        """Number n of coordinates."""

    @property
    def weights(self) -> np.ndarray:
        """Share of the multipliers that each coordinate takes (`FINE_WEIGHT`), shape (n,)."""

    @property
    def mobility(self) -> np.ndarray:
        """Readiness of each coordinate to change in assembly, shape (n,)."""

    @property
    def start(self) -> np.ndarray:
        """Coordinates of the rough pose, shape (n,)."""

    @property
    def start_rates(self) -> np.ndarray:
        """Their rates, shape (n,)."""

    @property
    def angle(self) -> int | None:
        """Place of the body's angle among its coordinates; None: it cannot turn."""

    @property
    def least_damping(self) -> float:
        """Smallest damping ratio of its modes, infinite without any."""

    @property
    def reach(self) -> float:
        """Largest distance of a point from the body's origin [m]."""

    def points(self) -> tuple[str, ...]:
        """Names of its points beside the origin."""

    def marker(self, point: str, coordinates: np.ndarray) -> Marker:
        """A point, or the origin for an empty name, at given coordinates."""

    def balance(
        self,
        coordinates: np.ndarray,
        rates: np.ndarray,
        accelerations: np.ndarray,
        *,
        lift: np.ndarray,
    ) -> Balance:
        """Inertia, stiffness and damping forces, to be balanced by all others.

        `lift` is the acceleration that gravity is felt as, against its pull, shape (2,) [m/s^2].
        """

    def energies(self, coordinates: np.ndarray, rates: np.ndarray) -> Energies:
        """Energies at an instant."""

    def error_measure(self) -> np.ndarray:
        """Rows that make coordinates dimensionless for the step control, shape (k, n)."""


#: Elastic displacements count for the step control relative to this share of the body's size:
#: about what the strain of a sound part allows.
ELASTIC_SHARE = 1e-3


class PlanarBody:
    """Coordinates ``(x, y, theta, q)`` of which `held` bodies have q alone.

    A subclass offers `integrals`, `fields` and, with elastic coordinates, `stiffness` and
    `damping_time`.
    """

    position: tuple[float, float]
    orientation: float
    velocity: tuple[float, float]
    speed: float
    held: bool = False
    integrals: InertiaIntegrals
    #: Fields of every point, shape (2, 3 + n): position, unit translations, elastic modes.
    fields: Mapping[str, np.ndarray]
    stiffness: np.ndarray | None = None
    damping_time: float = 0.0

    @cached_property
    def _frame(self) -> int:
        """Coordinates of the frame."""
        return 0 if self.held else 3

    @cached_property
    def modes(self) -> int:
        """Number of elastic coordinates."""
        return len(self.integrals.mass) - 3

    @cached_property
    def size(self) -> int:
        """Number of coordinates."""
        return self._frame + self.modes

    @cached_property
    def weights(self) -> np.ndarray:
        """Share of the multipliers: 1 of the frame, `FINE_WEIGHT` of elastic coordinates."""
        return np.concatenate([np.ones(self._frame), np.full(self.modes, FINE_WEIGHT)])

    @property
    def mobility(self) -> np.ndarray:
        """Readiness to change in assembly: the frame moves, elastic coordinates hardly do."""
        return self.weights

    @cached_property
    def _pose(self) -> np.ndarray:
        return np.array([*self.position, self.orientation])

    @cached_property
    def start(self) -> np.ndarray:
        """Coordinates of the rough pose, undeformed."""
        return np.concatenate([self._pose[: self._frame], np.zeros(self.modes)])

    @cached_property
    def start_rates(self) -> np.ndarray:
        """Rates of the rough pose."""
        motion = np.array([*self.velocity, self.speed])
        return np.concatenate([motion[: self._frame], np.zeros(self.modes)])

    @property
    def angle(self) -> int | None:
        """Place of the angle among the coordinates; None of a held body."""
        return None if self.held else 2

    @property
    def least_damping(self) -> float:
        """Smallest damping ratio; infinite of a rigid body."""
        return float("inf")

    @cached_property
    def reach(self) -> float:
        """Largest distance of a point from the origin [m]."""
        return max((float(np.hypot(*f[:, 0])) for f in self.fields.values()), default=0.0)

    def points(self) -> tuple[str, ...]:
        """Names of the points beside the origin."""
        return tuple(self.fields)

    def _whole(self, values: np.ndarray, pose: np.ndarray | float) -> np.ndarray:
        """Values of frame and elastic coordinates, of a held body too."""
        if not self.held:
            return values
        return np.concatenate([np.broadcast_to(pose, 3), values])

    def marker(self, point: str, coordinates: np.ndarray) -> Marker:
        """Marker of a point at given coordinates, see `Body`."""
        z = self._whole(coordinates, self._pose)
        if point not in self._arms:
            return self._cut(Marker(z[:3], self._unit))
        field, shapes = self._arms[point]
        turn = rotation(z[2])
        arm, shape = turn @ (field + shapes @ z[3:]), turn @ shapes
        jacobian = self._unit.copy()
        jacobian[0, 2], jacobian[1, 2], jacobian[:2, 3:] = -arm[1], arm[0], shape
        values = z[:3].copy()
        values[:2] += arm

        def bend(force: np.ndarray) -> np.ndarray:
            result = np.zeros((len(z), len(z)))
            result[2, 2] = -arm @ force[:2]
            result[2, 3:] = result[3:, 2] = force[1] * shape[0] - force[0] * shape[1]
            return result

        def carry(rates: np.ndarray) -> np.ndarray:
            result, spun = np.zeros((3, len(z))), np.stack([-shape[1], shape[0]])
            result[:2, 2] = spun @ rates[3:] - arm * rates[2]
            result[:2, 3:] = spun * rates[2]
            return result

        return self._cut(Marker(values, jacobian, bend, carry))

    @cached_property
    def _arms(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Position and elastic modes of the points that do not stay at the origin."""
        arms = {name: (field[:, 0], field[:, 3:]) for name, field in self.fields.items()}
        return {name: arm for name, arm in arms.items() if any(part.any() for part in arm)}

    @cached_property
    def _unit(self) -> np.ndarray:
        """Jacobian of the origin."""
        return np.eye(3, 3 + self.modes)

    def _cut(self, marker: Marker) -> Marker:
        """The marker of a held body: linear in its elastic coordinates."""
        if not self.held:
            return marker
        return Marker(marker.values, marker.jacobian[:, 3:])

    @cached_property
    def _inertia_integrals(self) -> InertiaIntegrals:
        return in_order_of_coordinates(self.integrals)

    def _inertia(
        self,
        coordinates: np.ndarray,
        rates: np.ndarray,
        accelerations: np.ndarray,
        lift: np.ndarray,
    ) -> FrameInertia:
        return FrameInertia(
            self._inertia_integrals,
            self._whole(coordinates, self._pose),
            self._whole(rates, 0.0),
            self._whole(accelerations, 0.0),
            lift,
        )

    def balance(
        self,
        coordinates: np.ndarray,
        rates: np.ndarray,
        accelerations: np.ndarray,
        *,
        lift: np.ndarray,
    ) -> Balance:
        """Inertia, stiffness and damping forces, see `Body`."""
        inertia = self._inertia(coordinates, rates, accelerations, lift)
        forces = inertia.forces[3 - self._frame :]
        if self.stiffness is not None:
            q = coordinates[self._frame :] + self.damping_time * rates[self._frame :]
            forces[self._frame :] += self.stiffness @ q
        return Balance(forces, partial(self._derivatives, inertia))

    def _derivatives(self, inertia: FrameInertia) -> Derivatives:
        whole = inertia.derivatives()
        own = slice(3 - self._frame, None)
        parts = Derivatives(
            whole.position[own, own], whole.rate[own, own], whole.acceleration[own, own]
        )
        if self.stiffness is not None:
            elastic = slice(self._frame, None)
            parts.position[elastic, elastic] += self.stiffness
            parts.rate[elastic, elastic] += self.damping_time * self.stiffness
        return parts

    def energies(self, coordinates: np.ndarray, rates: np.ndarray) -> Energies:
        """Kinetic and strain energy, and the power that damping takes."""
        rest = np.zeros_like(rates), np.zeros(2)
        kinetic = self._inertia(coordinates, rates, *rest).kinetic_energy
        if self.stiffness is None:
            return Energies(kinetic)
        q, q_rate = coordinates[self._frame :], rates[self._frame :]
        return Energies(
            kinetic,
            float(0.5 * q @ self.stiffness @ q),
            float(self.damping_time * q_rate @ self.stiffness @ q_rate),
        )

    def error_measure(self) -> np.ndarray:
        """Error measure: angle in rad, positions over the size, elastic motion in mass norm."""
        size = self.reach or 1.0
        measure = np.zeros((self.size, self.size))
        for place in range(self._frame):
            measure[place, place] = 1.0 if place == 2 else 1.0 / size
        if self.modes:
            elastic = self.integrals.mass[ELASTIC, ELASTIC]
            values, vectors = linalg.eigh(elastic)
            root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
            scale = ELASTIC_SHARE * size * np.sqrt(self.integrals.total_mass)
            measure[self._frame :, self._frame :] = root / scale
        return measure


@dataclass(frozen=True, eq=False)
class RigidBody(PlanarBody):
    """A rigid body.

    Attributes
    ----------
    mass, inertia
        [kg], [kg m^2] about the centre of mass; zero of both: a massless body.
    centre
        Centre of mass from the body's origin, in the body's frame [m].
    named_points
        Points by name, in the body's frame [m].
    position, orientation, velocity, speed
        Rough pose of origin and angle at the start, in the frame at rest [m], [rad], and their
        rates where nothing else gives them [m/s], [rad/s].
    held
        Whether it stays there: a part of the ground.
    """

    mass: float
    inertia: float = 0.0
    named_points: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    centre: tuple[float, float] = (0.0, 0.0)
    position: tuple[float, float] = (0.0, 0.0)
    orientation: float = 0.0
    velocity: tuple[float, float] = (0.0, 0.0)
    speed: float = 0.0
    held: bool = False

    def __post_init__(self) -> None:
        for name in ("mass", "inertia"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise SettingsError(f"{name} = {value:g} of a rigid body must be at least 0")

    @cached_property
    def integrals(self) -> InertiaIntegrals:  # type: ignore[override]
        """Inertia integrals of mass, inertia and centre."""
        return rigid_integrals(self.mass, self.inertia, np.array(self.centre))

    @cached_property
    def fields(self) -> dict[str, np.ndarray]:  # type: ignore[override]
        """Fields of the named points, see `PlanarBody`."""
        return {
            name: np.column_stack([np.array(at, dtype=float), np.eye(2)])
            for name, at in self.named_points.items()
        }


def ground(points: Mapping[str, tuple[float, float]] | None = None) -> RigidBody:
    """The ground with points of its own."""
    return RigidBody(0.0, named_points=points or {}, held=True)


@dataclass(frozen=True, eq=False)
class FlexibleBody(PlanarBody):
    """A reduced part, free in a floating frame or held.

    The frame's origin is the undeformed first bore's centre. A bore is a point of the same name:
    its centre at rest or, where it is a boundary point of the part, too, the mean of its deformed
    surface. A film's bore deforms about the centre at rest, see `at_rest`.

    Attributes
    ----------
    reduced
        The part.
    damping_time
        zeta of ``D_e = zeta K_e`` [s].
    position, orientation, velocity, speed
        Rough pose at the start and its rates, of a held body its place [m], [rad], [m/s], [rad/s].
    mass, inertia, centre
        In place of the part's own: [kg], [kg m^2] about the centre of mass, [m].
    """

    reduced: ReducedBody
    damping_time: float = 0.0
    position: tuple[float, float] = (0.0, 0.0)
    orientation: float = 0.0
    velocity: tuple[float, float] = (0.0, 0.0)
    speed: float = 0.0
    mass: float | None = None
    inertia: float | None = None
    centre: tuple[float, float] | None = None

    @cached_property
    def held(self) -> bool:  # type: ignore[override]
        """True of a part that was clamped when it was reduced."""
        return self.reduced.frame == "clamped"

    @property
    def least_damping(self) -> float:
        """Smallest damping ratio of the part's modes."""
        ratios = np.pi * self.reduced.frequencies * self.damping_time
        return float(ratios.min(initial=np.inf))

    @cached_property
    def integrals(self) -> InertiaIntegrals:  # type: ignore[override]
        """Inertia integrals, with the total that the body gives in place of the part's."""
        centre = None if self.centre is None else np.array(self.centre)
        return with_total(self.reduced.inertia, self.mass, self.inertia, centre)

    @cached_property
    def stiffness(self) -> np.ndarray | None:  # type: ignore[override]
        """Stiffness of the elastic coordinates, shape (n, n) [N/m]."""
        return self.reduced.stiffness if self.reduced.modes else None

    @cached_property
    def fields(self) -> dict[str, np.ndarray]:  # type: ignore[override]
        """Fields of bores and boundary points, see `PlanarBody`."""
        elastic = np.zeros((2, self.reduced.modes))
        bores = {
            name: np.column_stack([bore.centre[:2], np.eye(2), elastic])
            for name, bore in self.reduced.bores.items()
        }
        points = {name: field[:2] for name, field in self.reduced.points.items()}
        return points | {self.at_rest(name): field for name, field in bores.items()}

    def at_rest(self, bore: str) -> str:
        """Point that is the centre of an undeformed bore."""
        return f"{bore}.at_rest" if bore in self.reduced.points else bore
