"""Bodies of a mechanism: markers, inertia in a planar floating frame, rigid and flexible ones.

Joints, drives and forces access a body through its markers. A marker is a point whose values
``u = (x, y, angle, psi_x, psi_y)`` in the frame at rest are functions of the body's coordinates.
The tilt psi of the axis is zero for all bodies except shafts.

A material point has the position ``x + A(theta) p`` with ``p = B s`` and ``s = (0, 0, 1, q)``. B
contains the fields of `InertiaIntegrals` in the order of ``(x, y, theta, q)``. With the quarter
turn S, the acceleration of the point in the body's frame is

    p'' + A^T x'' + 2 theta' S p' + theta'' S p + theta'^2 S S p,

with relative, Coriolis, Euler and centrifugal terms. These terms are exact, because p is affine in
q.

Imports inside functions: `FlexibleBody.surface` imports film meshes when it is called, so that
settings that only name bodies load none.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import attrs
import numpy as np
from scipy import linalg

from fenics_ehd.base import fields as quantities
from fenics_ehd.base.arguments import require_class, require_number, require_pair
from fenics_ehd.base.described import Described
from fenics_ehd.base.fields import REQUIRED, number, pair, place, places
from fenics_ehd.base.needs import only_with
from fenics_ehd.base.plane import rotation
from fenics_ehd.base.renamed import accept_former_parameter
from fenics_ehd.multibody.surface import BORE, Side, Surface
from fenics_ehd.reduction.body import ELASTIC, InertiaIntegrals, ReducedBody

#: Indices of position, angle and the first of two tilts in a marker's values, and number of values.
POSITION = slice(0, 2)
ANGLE = 2
TILT = 3
WIDTH = 5


@dataclass(frozen=True, eq=False)
class Marker:
    """Values of one marker at one instant, and their derivatives with respect to n coordinates z.

    Attributes
    ----------
    values
        Position, angle and tilt ``u = (x, y, angle, psi_x, psi_y)``, shape (5,) [m], [rad].
    jacobian
        Derivative ``du/dz``, shape (5, n).
    force_derivative
        Function of a force f, shape (5,): derivative of ``jacobian^T f`` with respect to z, shape
        (n, n). None if the derivative is zero.
    rate_derivative
        Function of rates z', shape (n,): derivative of ``jacobian @ z'`` with respect to z, shape
        (5, n). None if the derivative is zero.
    """

    values: np.ndarray
    jacobian: np.ndarray
    force_derivative: Callable[[np.ndarray], np.ndarray] | None = None
    rate_derivative: Callable[[np.ndarray], np.ndarray] | None = None


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of n generalised forces with respect to coordinates, rates and accelerations.

    Attributes
    ----------
    position, rate, acceleration
        Derivatives with respect to the n coordinates, their rates, and their accelerations, shape
        (n, n) each.
    """

    position: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray


class FrameInertia:
    """Inertia forces of a planar body on its coordinates ``(x, y, theta, q)`` at one instant.

    Parameters
    ----------
    integrals
        Inertia integrals of the body, with fields in the order of the coordinates, see
        `in_order_of_coordinates`.
    coordinates, rates, accelerations
        Coordinates ``(x, y, theta, q)`` and their time derivatives, shape (3 + n,) each.
    minus_gravity
        Negative gravitational acceleration, which is added to the accelerations of x and y, shape
        (2,) [m/s^2].
    """

    def __init__(
        self,
        integrals: InertiaIntegrals,
        coordinates: np.ndarray,
        rates: np.ndarray,
        accelerations: np.ndarray,
        minus_gravity: np.ndarray,
    ):
        self._integrals = integrals
        self._frame_rates = rates[:3]
        self._turn = rotation(coordinates[2])
        self._omega = rates[2]
        self._alpha = accelerations[2]
        # Coefficients of p, p' and p'' + A^T x'' in the fields of the integrals.
        s = coordinates.copy()
        s[:2] = 0.0
        s[2] = 1.0
        rate = rates.copy()
        rate[:3] = 0.0
        acceleration = accelerations.copy()
        acceleration[:2] = (accelerations[:2] + minus_gravity) @ self._turn
        acceleration[2] = 0.0
        self._fields = s, rate, acceleration
        self._spin_s = integrals.spin @ s
        self._centrifugal_s = integrals.centrifugal @ s

    @cached_property
    def _on_fields(self) -> np.ndarray:
        """Inertia forces on x and y in the body's frame, on theta and on q, shape (3 + n,)."""
        s, rate, acceleration = self._fields
        coriolis_and_euler = 2 * self._omega * rate + self._alpha * s
        forces = self._integrals.mass @ acceleration + self._integrals.spin @ coriolis_and_euler
        forces -= self._omega**2 * self._centrifugal_s
        # (S B)^T M B = -G, antisymmetric.
        forces[2] = self._centrifugal_s @ coriolis_and_euler + self._spin_s @ acceleration
        return forces

    @property
    def forces(self) -> np.ndarray:
        """Generalised inertia forces on ``(x, y, theta, q)``, shape (3 + n,)."""
        forces = self._on_fields.copy()
        forces[:2] = self._turn @ forces[:2]
        return forces

    def derivatives(self) -> Derivatives:
        """Derivatives of the inertia forces with respect to coordinates, rates and accelerations.

        Each of the three matrices has the shape (3 + n, 3 + n).
        """
        s, rate, acceleration = self._fields
        omega = self._omega
        alpha = self._alpha
        m = self._integrals.mass
        g = self._integrals.spin
        c = self._integrals.centrifugal
        g_s = self._spin_s
        c_s = self._centrifugal_s
        c_rate = c @ rate
        n = len(s)
        # First with x and y in the body's frame.
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
        # Then with x and y in the frame at rest.
        parts[:, :2] = self._turn @ parts[:, :2]
        by_acceleration[:, :2] = by_acceleration[:, :2] @ self._turn.T
        return Derivatives(position, by_rate, by_acceleration)

    @property
    def kinetic_energy(self) -> float:
        """Kinetic energy of the body [J]."""
        s, rate, _ = self._fields
        velocity = rate.copy()
        velocity[:2] = self._frame_rates[:2] @ self._turn
        return float(
            0.5 * velocity @ self._integrals.mass @ velocity
            + self._omega * velocity @ self._spin_s
            + 0.5 * self._omega**2 * s @ self._centrifugal_s
        )


def in_order_of_coordinates(integrals: InertiaIntegrals) -> InertiaIntegrals:
    """Inertia integrals with fields in the order of the coordinates ``(x, y, theta, q)``.

    In `integrals`, the field of a point's position comes first, before the translations along x and
    y. In the result it comes third, at the index of theta.
    """
    order = np.arange(len(integrals.mass))
    order[:3] = 1, 2, 0
    return InertiaIntegrals(*(matrix[np.ix_(order, order)] for matrix in integrals.matrices))


def rigid_integrals(mass: float, inertia: float, centre: np.ndarray) -> InertiaIntegrals:
    """Inertia integrals of a body without elastic coordinates.

    Parameters
    ----------
    mass, inertia
        Mass [kg], and moment of inertia about the centre of mass [kg m^2].
    centre
        Centre of mass in the body's frame, shape (2,) [m].
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
    """Inertia integrals with another total mass, inertia and centre of mass.

    An argument that is None keeps the value of the integrals. The elastic part of the integrals
    does not change, because the difference is added as the inertia of a rigid body that is fixed to
    the frame.
    """
    present = rigid_integrals(
        integrals.total_mass, integrals.polar_inertia, integrals.centre_of_mass
    )
    wanted = rigid_integrals(
        integrals.total_mass if mass is None else mass,
        integrals.polar_inertia if inertia is None else inertia,
        integrals.centre_of_mass if centre is None else centre,
    )
    elastic = (0, len(integrals.mass) - 3)
    matrices = zip(integrals.matrices, wanted.matrices, present.matrices, strict=True)
    return InertiaIntegrals(*(part + np.pad(new - old, elastic) for part, new, old in matrices))


#: Weight of velocity multipliers on elastic coordinates and others on which gaps depend, while it
#: is 1 on frames: about the square of clearance over length. A weight of 1 would turn drift of the
#: large motion into false squeeze velocities. With 0 the equations are singular if two films carry
#: one body.
FINE_WEIGHT = 1e-7


@dataclass(frozen=True)
class Energies:
    """Kinetic and strain energy of one body at one instant [J], and power lost to damping [W]."""

    kinetic: float = 0.0
    strain: float = 0.0
    dissipated: float = 0.0


@dataclass(frozen=True, eq=False)
class Balance:
    """Inertia, stiffness and damping forces of one body with n coordinates, at one instant.

    Attributes
    ----------
    forces
        Generalised forces on the n coordinates, shape (n,).
    derivatives
        Function without arguments that computes the derivatives of the forces.
    """

    forces: np.ndarray
    derivatives: Callable[[], Derivatives]


class Body(Described, ABC):
    """Body of a mechanism, with n coordinates."""

    #: Whether the axis tilts at the body's points, as that of a bent shaft does.
    tilts = False

    def __init_subclass__(cls, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        accept_former_parameter(cls, "balance", "lift", "minus_gravity")

    @property
    @abstractmethod
    def size(self) -> int:
        """Number n of coordinates."""

    @property
    @abstractmethod
    def weights(self) -> np.ndarray:
        """Weight of the velocity multipliers in the rate of each coordinate, shape (n,)."""

    @property
    @abstractmethod
    def start(self) -> np.ndarray:
        """Coordinates of the body in its rough pose at the start, shape (n,)."""

    @property
    @abstractmethod
    def start_rates(self) -> np.ndarray:
        """Rates of the body's coordinates in its rough pose at the start, shape (n,)."""

    @property
    @abstractmethod
    def angle_index(self) -> int | None:
        """Index of the body's angle among its coordinates; None if the body cannot turn."""

    @property
    @abstractmethod
    def reach(self) -> float:
        """Largest distance of a point from the body's origin [m]."""

    @property
    def axisymmetric(self) -> bool:
        """Whether all points and the centre of mass lie on the axis about which the body turns."""
        return False

    @property
    def least_damping(self) -> float:
        """Smallest damping ratio of the body's modes; infinite without modes."""
        return np.inf

    @property
    def mobility(self) -> np.ndarray:
        """Compliance of each coordinate when the mechanism is assembled, shape (n,).

        Coordinates with a large compliance change most.
        """
        return self.weights

    @property
    @abstractmethod
    def point_names(self) -> tuple[str, ...]:
        """Names of the body's points, except for the origin."""

    #: Reduced part whose elastic motion the body has; None: it has none.
    reduced: ReducedBody | None = None

    @abstractmethod
    def marker(self, point: str, coordinates: np.ndarray) -> Marker:
        """Marker of a point of the body at given coordinates, shape (n,).

        An empty name of the point means the body's origin.
        """

    def surface(self, point: str, side: Side) -> Surface:
        """Make the surface of the body at a point, on one side of a film; by default rigid."""
        return Surface(side)

    def at_rest(self, point: str) -> str:
        """Name of the point at the undeformed centre of the surface with the name `point`."""
        return point

    @abstractmethod
    def balance(
        self,
        coordinates: np.ndarray,
        rates: np.ndarray,
        accelerations: np.ndarray,
        *,
        minus_gravity: np.ndarray,
    ) -> Balance:
        """Inertia, stiffness and damping forces of the body, which balance all other forces on it.

        Parameters
        ----------
        coordinates, rates, accelerations
            Coordinates and their time derivatives, shape (n,) each.
        minus_gravity
            Negative gravitational acceleration, shape (2,) [m/s^2].
        """

    @abstractmethod
    def energies(self, coordinates: np.ndarray, rates: np.ndarray) -> Energies:
        """Kinetic energy, strain energy and power lost to damping of the body.

        They are those at given coordinates and rates, shape (n,) each.
        """

    @abstractmethod
    def error_measure(self) -> np.ndarray:
        """Matrix from changes of the body's coordinates to dimensionless errors, shape (k, n).

        The control of the time step limits each of the k errors.
        """


#: Elastic displacement that counts as an error of 1 in the step control, over the body's size:
#: about the largest elastic strain of metals.
ELASTIC_SHARE = 1e-3


@attrs.frozen(eq=False, slots=False, kw_only=True)
class Pose(Described):
    """Rough position, angle and velocities of a body at the start, before `assemble`."""

    position: tuple[float, float] = place("origin at the start, roughly [m]")
    angle: float = number(0.0, "at the start, of the body's x axis from x, + from x to y [degrees]")
    velocity: tuple[float, float] = pair("of the origin at the start, unless joints give it [m/s]")
    speed: float = quantities.speed(
        0.0, "of the angle at the start, unless a drive gives it [rad/s]"
    )


class PlanarBody(Pose, Body):
    """Body in a planar floating frame, with elastic coordinates q.

    Its coordinates are ``(x, y, theta, q)``, or q only if its frame is held at rest.
    """

    #: Whether the frame is at rest, because the body is a part of the ground.
    held: bool

    #: Coefficient zeta of the structural damping ``D_e = zeta K_e`` [s].
    damping_time: float

    #: Centre of mass in the body's frame [m]; None for that of `integrals`.
    centre: tuple[float, float] | None

    @property
    @abstractmethod
    def integrals(self) -> InertiaIntegrals:
        """Inertia integrals of the body."""

    @property
    @abstractmethod
    def fields(self) -> Mapping[str, np.ndarray]:
        """Displacement fields at every point of the body by name, shape (2, 3 + n) each.

        The columns are the position of the point [m], two unit translations, and the displacement
        of the point in each of the n elastic modes.
        """

    @property
    @abstractmethod
    def stiffness(self) -> np.ndarray:
        """Stiffness matrix of the elastic coordinates, shape (n, n)."""

    @cached_property
    def _free(self) -> slice:
        """Indices of the body's coordinates among ``(x, y, theta, q)``."""
        return slice(3 if self.held else 0, None)

    @cached_property
    def modes(self) -> int:
        """Number of elastic coordinates."""
        return len(self.integrals.mass) - 3

    @cached_property
    def weights(self) -> np.ndarray:
        """Weight of velocity multipliers: 1 on the frame, `FINE_WEIGHT` on elastic coordinates."""
        return np.repeat([1.0, FINE_WEIGHT], [3, self.modes])[self._free]

    @cached_property
    def size(self) -> int:
        """Number of coordinates of the body."""
        return len(self.weights)

    @cached_property
    def _pose(self) -> np.ndarray:
        return np.array([*self.position, np.radians(self.angle), *np.zeros(self.modes)])

    @cached_property
    def start(self) -> np.ndarray:
        """Coordinates of the rough pose at the start, without deformation, shape (n,)."""
        return self._pose[self._free]

    @cached_property
    def start_rates(self) -> np.ndarray:
        """Rates of the coordinates in the rough pose at the start, shape (n,)."""
        return np.array([*self.velocity, self.speed, *np.zeros(self.modes)])[self._free]

    @property
    def angle_index(self) -> int | None:
        """Index of the angle among the coordinates; None for a held body."""
        return None if self.held else ANGLE

    @cached_property
    def reach(self) -> float:
        """Largest distance of a point from the body's origin [m]."""
        return max((float(np.hypot(*f[:, 0])) for f in self.fields.values()), default=0.0)

    @property
    def axisymmetric(self) -> bool:
        """Whether all points and the centre of mass are at the origin."""
        return not (self.reach or any(self.centre or ()))

    @property
    def point_names(self) -> tuple[str, ...]:
        """Names of the body's points, except for the origin."""
        return tuple(self.fields)

    def _with_frame(self, values: np.ndarray, frame: np.ndarray | float = 0.0) -> np.ndarray:
        """Values for ``(x, y, theta, q)`` from values for the body's coordinates.

        A held body has only the coordinates q; `frame` gives the values for ``(x, y, theta)``.
        """
        if not self.held:
            return values
        return np.concatenate([np.broadcast_to(frame, 3), values])

    @cached_property
    def _unit(self) -> np.ndarray:
        """Jacobian of the origin's marker, shape (5, 3 + n)."""
        unit = np.zeros((WIDTH, 3 + self.modes))
        unit[:3, :3] = np.eye(3)
        return unit

    @cached_property
    def _arms(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Position of every point, shape (2,), and its elastic modes, shape (2, n), by name.

        Points at the origin without elastic motion are omitted.
        """
        arms = {name: (field[:, 0], field[:, 3:]) for name, field in self.fields.items()}
        return {name: arm for name, arm in arms.items() if any(part.any() for part in arm)}

    def marker(self, point: str, coordinates: np.ndarray) -> Marker:
        """Marker of a point at given coordinates, see `Body.marker`."""
        z = self._with_frame(coordinates, self._pose[:3])
        values = np.zeros(WIDTH)
        values[:3] = z[:3]
        if point not in self._arms:
            return Marker(values, self._unit[:, self._free])
        field, shapes = self._arms[point]
        turn = rotation(z[2])
        arm = turn @ (field + shapes @ z[3:])
        shape = turn @ shapes
        jacobian = self._unit.copy()
        jacobian[0, 2] = -arm[1]
        jacobian[1, 2] = arm[0]
        jacobian[:2, 3:] = shape
        values[:2] += arm
        if self.held:
            return Marker(values, jacobian[:, self._free])

        def force_derivative(force: np.ndarray) -> np.ndarray:
            result = np.zeros((len(z), len(z)))
            result[2, 2] = -arm @ force[:2]
            result[2, 3:] = result[3:, 2] = force[1] * shape[0] - force[0] * shape[1]
            return result

        def rate_derivative(rates: np.ndarray) -> np.ndarray:
            quarter_turned = np.stack([-shape[1], shape[0]])
            result = np.zeros((WIDTH, len(z)))
            result[:2, 2] = quarter_turned @ rates[3:] - arm * rates[2]
            result[:2, 3:] = quarter_turned * rates[2]
            return result

        return Marker(values, jacobian, force_derivative, rate_derivative)

    @cached_property
    def _ordered(self) -> InertiaIntegrals:
        return in_order_of_coordinates(self.integrals)

    def balance(
        self,
        coordinates: np.ndarray,
        rates: np.ndarray,
        accelerations: np.ndarray,
        *,
        minus_gravity: np.ndarray,
    ) -> Balance:
        """Inertia, stiffness and damping forces, see `Body.balance`."""
        z = self._with_frame(coordinates, self._pose[:3])
        v = self._with_frame(rates)
        acceleration = self._with_frame(accelerations)
        inertia = FrameInertia(self._ordered, z, v, acceleration, minus_gravity)
        forces = inertia.forces
        forces[3:] += self.stiffness @ (z[3:] + self.damping_time * v[3:])
        return Balance(forces[self._free], partial(self._derivatives, inertia))

    def _derivatives(self, inertia: FrameInertia) -> Derivatives:
        derivatives = inertia.derivatives()
        derivatives.position[3:, 3:] += self.stiffness
        derivatives.rate[3:, 3:] += self.damping_time * self.stiffness
        free = self._free
        return Derivatives(*(part[free, free] for part in vars(derivatives).values()))

    def energies(self, coordinates: np.ndarray, rates: np.ndarray) -> Energies:
        """Kinetic and strain energy [J], and power lost to damping [W], see `Body.energies`."""
        z = self._with_frame(coordinates, self._pose[:3])
        v = self._with_frame(rates)
        inertia = FrameInertia(self._ordered, z, v, np.zeros_like(v), np.zeros(2))
        strain = 0.5 * z[3:] @ self.stiffness @ z[3:]
        dissipated = self.damping_time * v[3:] @ self.stiffness @ v[3:]
        return Energies(inertia.kinetic_energy, float(strain), float(dissipated))

    def error_measure(self) -> np.ndarray:
        """Matrix from changes of coordinates to dimensionless errors, see `Body.error_measure`.

        The errors are the change of the angle [rad], that of the position over the body's size, and
        the elastic motion in the mass norm over `ELASTIC_SHARE` of the size.
        """
        size = self.reach or 1.0
        measure = np.diag([1.0 / size, 1.0 / size, 1.0])
        if self.modes:
            values, vectors = linalg.eigh(self.integrals.mass[ELASTIC, ELASTIC])
            root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
            scale = ELASTIC_SHARE * size * np.sqrt(self.integrals.total_mass)
            measure = linalg.block_diag(measure, root / scale)
        return measure[self._free, self._free]


@attrs.frozen(slots=False)
class MasslessBody(PlanarBody):
    """Rigid body without mass, such as a journal under a prescribed load."""

    points: dict = places("points in the body's frame [m]")
    held: bool = attrs.field(
        default=False,
        kw_only=True,
        validator=lambda _, field, value: require_class(field.name, value, bool),
    )
    mass = 0.0
    inertia = 0.0
    centre = (0.0, 0.0)
    stiffness = np.zeros((0, 0))
    damping_time = 0.0

    @cached_property
    def integrals(self) -> InertiaIntegrals:
        """Inertia integrals of the body, from mass, inertia and centre of mass."""
        return rigid_integrals(self.mass, self.inertia, np.array(self.centre))

    @cached_property
    def fields(self) -> dict[str, np.ndarray]:
        """Fields of every point by name, see `PlanarBody.fields`."""
        return {
            name: np.column_stack([np.array(at, dtype=float), np.eye(2)])
            for name, at in self.points.items()
        }


@attrs.frozen(slots=False)
class RigidBody(MasslessBody):
    """Rigid body with mass."""

    mass: float = quantities.mass(REQUIRED, "[kg]", 100)
    inertia: float = number(
        0.0,
        "about the centre of mass [kg m2]",
        least=0,
        usual=(1e-8, 1e4),
        example="1e-3 for 10 kg cm2",
    )
    points: dict = places("points in the body's frame [m]")
    centre: tuple[float, float] = only_with(place("centre of mass in the body's frame [m]"), "mass")


def ground(points: dict[str, tuple[float, float]] | None = None) -> MasslessBody:
    """Make the ground: a body at rest, with the positions of its points by name [m]."""
    return MasslessBody({} if points is None else points, held=True)


@attrs.frozen(eq=False, slots=False)
class FlexibleBody(PlanarBody):
    """Flexible body made of a reduced part, free in a floating frame or held.

    The frame's origin is the centre of the undeformed first bore. Every bore gives a point of the
    same name. If the bore is also a boundary point of the part, this point is the mean position of
    the deformed surface; if not, it is the centre of the undeformed bore. The bore of a film
    deforms about the centre of the undeformed bore, see `at_rest`.

    Attributes
    ----------
    reduced
        Reduced part.
    damping_time
        Coefficient zeta of the structural damping ``D_e = zeta K_e`` [s].
    mass, inertia, centre
        Mass [kg], moment of inertia about the centre of mass [kg m^2] and centre of mass [m]; None
        for those of the part.
    """

    reduced: ReducedBody
    damping_time: float = 0.0
    mass: float | None = None
    inertia: float | None = None
    centre: tuple[float, float] | None = None

    def __attrs_post_init__(self) -> None:
        require_class("reduced", self.reduced, ReducedBody)
        require_number("damping_time", self.damping_time, least=0)
        for name in ("mass", "inertia"):
            if getattr(self, name) is not None:
                require_number(name, getattr(self, name), above=0)
        if self.centre is not None:
            require_pair("centre", self.centre)

    @cached_property
    def held(self) -> bool:  # type: ignore[override]
        """Whether the body is held: its part was clamped when it was reduced."""
        return self.reduced.frame == "clamped"

    @property
    def least_damping(self) -> float:
        """Smallest damping ratio of the part's modes; infinite without modes."""
        ratios = np.pi * self.reduced.frequencies * self.damping_time
        return float(ratios.min(initial=np.inf))

    @cached_property
    def integrals(self) -> InertiaIntegrals:
        """Inertia integrals of the part, with the body's mass, inertia and centre of mass."""
        centre = None if self.centre is None else np.array(self.centre)
        return with_total(self.reduced.inertia, self.mass, self.inertia, centre)

    @cached_property
    def stiffness(self) -> np.ndarray:
        """Stiffness matrix of the elastic coordinates, shape (n, n) [N/m]."""
        return self.reduced.stiffness

    @cached_property
    def fields(self) -> dict[str, np.ndarray]:
        """Fields of bores and boundary points by name, see `PlanarBody.fields`."""
        elastic = np.zeros((2, self.reduced.modes))
        bores = {
            name: np.column_stack([bore.centre[:2], np.eye(2), elastic])
            for name, bore in self.reduced.bores.items()
        }
        points = {name: field[:2] for name, field in self.reduced.points.items()}
        return points | {self.at_rest(name): field for name, field in bores.items()}

    def at_rest(self, point: str) -> str:
        """Name of the point at the undeformed centre of the bore with the name `point`."""
        moves = point in self.reduced.bores and point in self.reduced.points
        return f"{point}.at_rest" if moves else point

    def surface(self, point: str, side: Side) -> Surface:
        """Make the body's surface at a point: elastic for a bore, rigid for a journal."""
        from fenics_ehd.multibody.elastic_bore import ElasticBore

        if side.sign == BORE and point in self.reduced.bores:
            return ElasticBore(self.reduced, point, side, self.damping_time)
        return Surface(side)
