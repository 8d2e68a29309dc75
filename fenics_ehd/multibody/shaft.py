"""Elastic shafts: beams with disks, reduced to their modes at rest, at any speed.

A node of the beam has four degrees of freedom: the deflections u, v along x and y and the rotations
of the cross section in both planes of bending. Without shear they are the slopes u', v' along the
shaft (Bernoulli). With shear (Timoshenko) the slope is the rotation psi plus the angle of shear,

    u' = psi + Q / (kappa G A),    E I psi'' + kappa G A (u' - psi) = 0 along an element,

of which the element's shape functions are the exact solution, with one parameter for the ratio of
bending to shear stiffness, ``Phi = 12 E I / (kappa G A h^2)``. At ``Phi = 0`` they are the cubic
polynomials of a Bernoulli beam; the element does not lock (J. S. Przemieniecki, Theory of Matrix
Structural Analysis, 1968). Rotary inertia is that of psi.

Without shear, frequencies converge with order 4. The effect of shear on a frequency converges with
order 2: its relative error is ``(k h)^2 / 24`` at the wave number k.

A round shaft has the same matrices in both planes, so that only one plane is assembled, with two
degrees of freedom per node. Only the gyroscopic matrix G couples the planes. At the angular speed
Omega about z

    M u'' + Omega G v' + K u = f_x,      M v'' - Omega G u' + K v = f_y,

where dashes are, from here on, derivatives with respect to time. G is the sum of the polar inertia
of the disks and twice the rotary inertia of the shaft, because the polar inertia of a circular
section is twice the diametral one.

Both planes use the mass-normalised modes of one plane. Coordinates are the angle theta about the
axis and the amplitudes ``(a, b)`` of the deflections ``u = Phi a`` along x and ``v = Phi b`` along
y. With ``C = Phi^T G Phi`` and the polar inertia J, the equations

    a'' + 2 zeta Omega_r a' + theta' C b' + theta'' C b / 2 + Omega_r^2 a = Phi^T f_x
    b'' + 2 zeta Omega_r b' - theta' C a' - theta'' C a / 2 + Omega_r^2 b = Phi^T f_y
    J theta'' + (a'' . C b - b'' . C a) / 2 = torque

follow from the kinetic energy
``(|a'|^2 + |b'|^2 + J theta'^2 + theta' (a' . C b - b' . C a)) / 2`` and modal damping.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import attrs
import numpy as np
from scipy.linalg import eigh

from fenics_ehd.base import fields
from fenics_ehd.base.checks import as_float, unless
from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.fields import (
    LARGEST_LENGTH,
    choice,
    count,
    metres,
    number,
    place,
    rows,
    table,
)
from fenics_ehd.base.needs import only_with
from fenics_ehd.multibody.body import (
    ELASTIC_SHARE,
    FINE_WEIGHT,
    Balance,
    Body,
    Derivatives,
    Energies,
    Marker,
)

#: Beam theories: without and with deflection by shear.
THEORIES = ("bernoulli", "timoshenko")


@attrs.frozen(eq=False, slots=False)
class Shaft(Described):
    """Uniform round shaft on two springs at its ends, with equal stiffness in all directions."""

    length: float = metres(1.0, "[m]", below=100)
    diameter: float = metres(0.045, "[m]", below=2 * LARGEST_LENGTH)
    youngs_modulus: float = fields.youngs_modulus(210e9)
    density: float = fields.density(7850.0, "[kg/m3], 1e-12 for a shaft without mass", 1e-12)
    support_stiffness: float = number(
        1.58e8,
        "of a spring at either end [N/m], 0: carried only by its bearings",
        least=0,
        usual=(1e4, 1e13),
        example="1e8 for 100 N/um",
    )
    elements: int = count(20, "beam elements, of equal length", least=1)
    theory: str = choice(
        "bernoulli", THEORIES, "beam without shear deformation, or with it (timoshenko)"
    )
    poissons_ratio: float = only_with(
        number(0.3, "Poisson's ratio [-]", above=-1, below=0.5), "theory", among=("timoshenko",)
    )

    @property
    def area(self) -> float:
        """Area of the cross section [m^2]."""
        return np.pi / 4 * self.diameter**2

    @property
    def second_moment(self) -> float:
        """Second moment of area about a diameter [m^4]."""
        return np.pi / 64 * self.diameter**4

    @property
    def shear_flexibility(self) -> float:
        """Bending over shear stiffness ``E I / (kappa G A)`` [m^2]; 0 without shear deformation."""
        if self.theory == "bernoulli":
            return 0.0
        shear_over_youngs_modulus = 0.5 / (1 + self.poissons_ratio)
        stiffness = shear_coefficient(self.poissons_ratio) * shear_over_youngs_modulus * self.area
        return self.second_moment / stiffness

    @property
    def mass(self) -> float:
        """Mass of the shaft without disks [kg]."""
        return self.density * self.area * self.length

    @property
    def bending(self) -> float:
        """Square of the first angular bending frequency of a free shaft, roughly [rad^2/s^2]."""
        flexural = self.youngs_modulus * self.second_moment
        return 500.0 * flexural / (self.density * self.area * self.length**4)

    @property
    def polar_inertia(self) -> float:
        """Moment of inertia of the shaft about its axis, without disks [kg m^2]."""
        return 2 * self.density * self.second_moment * self.length


def shear_coefficient(poissons_ratio: float) -> float:
    """Shear coefficient kappa of a solid circular section [-].

    G. R. Cowper, The shear coefficient in Timoshenko's beam theory, J. Appl. Mech. 33 (1966) 335:
    ``6 (1 + nu) / (7 + 6 nu)``, 0.886 for steel.
    """
    return 6 * (1 + poissons_ratio) / (7 + 6 * poissons_ratio)


@dataclass(frozen=True, eq=False)
class BeamPlane:
    """Beam model of a shaft in one plane of bending.

    Degrees of freedom are ``2 * node`` (deflection) and ``2 * node + 1`` (rotation of the section,
    which is the slope without shear deformation).

    Attributes
    ----------
    shaft
        The shaft.
    stiffness, mass, gyroscopic
        Symmetric matrices K, M and G, shape (d, d) each with d = 2 (elements + 1).
    """

    shaft: Shaft
    stiffness: np.ndarray
    mass: np.ndarray
    gyroscopic: np.ndarray

    def point(self, position: float) -> np.ndarray:
        """Matrix from degrees of freedom to deflection and rotation at a position, shape (2, d).

        The position is relative to the length, from 0 to 1. The rows are also the generalised
        forces of a unit force and of a unit moment at this position.
        """
        n = self.shaft.elements
        element = min(int(position * n), n - 1)
        size = self.shaft.length / n
        rows = np.zeros((2, 2 * (n + 1)))
        rows[:, 2 * element : 2 * element + 4] = _shape_functions(
            position * n - element, size, shear_ratio(self.shaft)
        )
        return rows


def beam_plane(shaft: Shaft, disks: Sequence[Sequence[float]] = ()) -> BeamPlane:
    """Assemble the beam model of one plane, with rotary inertia, disks and springs at the ends.

    Parameters
    ----------
    shaft
        The shaft.
    disks
        Position as a share of the length [-], mass [kg], polar and diametral moment of inertia
        [kg m2] of every disk.
    """
    n = shaft.elements
    size = shaft.length / n
    bending, translation, rotation = _element(size, shear_ratio(shaft))
    rotary = shaft.density * shaft.second_moment * rotation
    stiffness, mass, gyroscopic = (np.zeros((2 * n + 2, 2 * n + 2)) for _ in range(3))
    for e in range(n):
        dofs = slice(2 * e, 2 * e + 4)
        stiffness[dofs, dofs] += shaft.youngs_modulus * shaft.second_moment * bending
        mass[dofs, dofs] += shaft.density * shaft.area * translation + rotary
        gyroscopic[dofs, dofs] += 2 * rotary
    for end in (0, 2 * n):
        stiffness[end, end] += shaft.support_stiffness
    beam = BeamPlane(shaft, stiffness, mass, gyroscopic)
    for position, disk_mass, polar_inertia, diametral_inertia in disks:
        deflection, slope = beam.point(position)
        mass += disk_mass * np.outer(deflection, deflection)
        mass += diametral_inertia * np.outer(slope, slope)
        gyroscopic += polar_inertia * np.outer(slope, slope)
    return beam


def shear_ratio(shaft: Shaft) -> float:
    """Ratio Phi of bending to shear stiffness of an element; 0 without shear deformation [-]."""
    return 12 * shaft.shear_flexibility / (shaft.length / shaft.elements) ** 2


def _element(h: float, phi: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stiffness over E I, and integrals of ``N^T N`` and ``P^T P`` over an element, (4, 4) each.

    N are the shape functions of the deflection, P the shape functions of the rotation, see
    `_shape_functions`.

    Parameters
    ----------
    h, phi
        Length of the element [m], and its ratio of bending to shear stiffness [-].
    """
    bending = np.array(
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, (4 + phi) * h**2, -6 * h, (2 - phi) * h**2],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, (2 - phi) * h**2, -6 * h, (4 + phi) * h**2],
        ]
    )
    square = phi**2
    near = 156 + 294 * phi + 140 * square
    far = 54 + 126 * phi + 70 * square
    near_turn = (22 + 38.5 * phi + 17.5 * square) * h
    far_turn = (13 + 31.5 * phi + 17.5 * square) * h
    turn = (4 + 7 * phi + 3.5 * square) * h**2
    across = (3 + 7 * phi + 3.5 * square) * h**2
    translation = np.array(
        [
            [near, near_turn, far, -far_turn],
            [near_turn, turn, far_turn, -across],
            [far, far_turn, near, -near_turn],
            [-far_turn, -across, -near_turn, turn],
        ]
    )
    lift = (3 - 15 * phi) * h
    turn = (4 + 5 * phi + 10 * square) * h**2
    across = (1 + 5 * phi - 5 * square) * h**2
    rotation = np.array(
        [
            [36, lift, -36, lift],
            [lift, turn, -lift, -across],
            [-36, -lift, 36, -lift],
            [lift, -across, -lift, turn],
        ]
    )
    raised = 1 + phi
    return (
        bending / (h**3 * raised),
        translation * h / (420 * raised**2),
        rotation / (30 * h * raised**2),
    )


def _shape_functions(s: float, h: float, phi: float) -> np.ndarray:
    """Shape functions of deflection and rotation of an element at s, shape (2, 4).

    s is 0 at one end of the element and 1 at the other.

    Parameters
    ----------
    s, h, phi
        Position in the element [-], its length [m], its ratio of bending to shear stiffness [-].
    """
    deflections = [
        1 - 3 * s**2 + 2 * s**3 + phi * (1 - s),
        h * (s - 2 * s**2 + s**3 + 0.5 * phi * (s - s**2)),
        3 * s**2 - 2 * s**3 + phi * s,
        h * (s**3 - s**2 + 0.5 * phi * (s**2 - s)),
    ]
    rotations = [
        6 * (s**2 - s) / h,
        1 - 4 * s + 3 * s**2 + phi * (1 - s),
        6 * (s - s**2) / h,
        3 * s**2 - 2 * s + phi * s,
    ]
    return np.array([deflections, rotations]) / (1 + phi)


#: Squared frequency of a mode, over that of the first bending mode, below which the mode is a rigid
#: motion of the shaft.
FREE = 1e-9


@dataclass(frozen=True, eq=False)
class ModalRotor(Described):
    """Shaft with disks in modal coordinates ``(a, b)``, m modes in each plane.

    Attributes
    ----------
    beam
        Beam model of one plane.
    shapes
        Mass-normalised modes Phi, shape (d, m).
    angular
        Angular frequencies of the modes at rest, without the films of bearings, shape (m,) [rad/s].
    """

    beam: BeamPlane
    shapes: np.ndarray
    angular: np.ndarray

    @classmethod
    def of(cls, beam: BeamPlane, modes: int) -> ModalRotor:
        """Make the rotor with the lowest `modes` modes of each plane."""
        # The lowest modes have the largest eigenvalues 1 / omega^2, which are exact to round-off,
        # however high the highest frequency is. Rigid motions of a shaft without supports have
        # omega = 0, and with a shift 1 / (omega^2 + shift) is finite.
        d = len(beam.mass)
        shift = 0.0 if beam.shaft.support_stiffness else beam.shaft.bending
        raised = beam.stiffness + shift * beam.mass
        values, shapes = eigh(beam.mass, raised, subset_by_index=(d - modes, d - 1))
        squares = 1.0 / values[::-1]
        angular = np.sqrt(np.where(squares - shift > FREE * shift, squares - shift, 0.0))
        return cls(beam, shapes[:, ::-1] * np.sqrt(squares), angular)

    def motion(self, position: float) -> np.ndarray:
        """Matrix from ``(a, b)`` to ``(u, v, psi_x, psi_y)`` at a position, shape (4, 2 m).

        The position is relative to the length, from 0 to 1. Small rotations about x and y are
        ``psi_x = -dv/dz`` and ``psi_y = du/dz``. The rows are also the generalised forces of unit
        forces and moments at this position.
        """
        deflection, slope = (
            np.kron(np.eye(2), row) for row in self.beam.point(position) @ self.shapes
        )
        return np.vstack([deflection, -slope[1], slope[0]])


def require_shaft_point(key: str, marker: str, body: object) -> None:
    """Refuse a shaft without a point for a joint or force; other bodies have an origin.

    The marker of a shaft without a point lies on the undeformed axis, which does not move.

    Raises
    ------
    SettingsError
        If `body` is a shaft and `marker` names no point; the message has the key and all points.
    """
    name, dot, _ = marker.partition(".")
    if isinstance(body, ShaftBody) and not dot:
        points = ", ".join(f"{name}.{point}" for point in body.points) or "it has none"
        raise SettingsError(f"{key} = {marker!r}: a shaft needs one of its points: {points}")


#: Names of the values of a disk.
DISK = ("position", "mass", "polar_inertia", "diametral_inertia")


def _shares(help_text: str) -> Any:
    """Make a setting for a table of positions by name, as shares of the shaft's length."""
    check = unless(
        lambda n: isinstance(n, float) and 0.0 <= n <= 1.0, "a share of the length, 0 to 1"
    )
    return table(help_text, check, partial(as_float, unit=""))


@attrs.frozen(slots=False)
class ShaftBody(Shaft, Body):
    """Elastic shaft of beam elements, reduced to modes; its axis tilts at its points."""

    position: tuple[float, float] = place("of the undeformed axis [m]")
    angle: float = number(0.0, "at the start [degrees]")
    speed: float = fields.speed(0.0, "at the start, unless a drive gives it [rad/s]")
    modes: int = count(20, "number of modes, half of them in either plane: an even number", least=2)
    damping_ratio: float = number(1e-3, "zeta of every mode [-]", least=0, below=1)
    disks: tuple[tuple[float, ...], ...] = rows(
        DISK,
        "rigid disks [share of the length, kg, kg m2 about the axis, kg m2 about a diameter]",
        ("", "kg", "kg m2", "kg m2"),
    )
    points: dict = _shares("points by name, share of the length from one end, 0 to 1")
    angle_index = 0
    tilts = True

    def __attrs_post_init__(self) -> None:
        available = 4 * (self.elements + 1)
        if self.modes % 2 or self.modes > available:
            raise SettingsError(
                f"modes = {self.modes} must be even, half of them for either plane, and at most "
                f"{available}, the degrees of freedom of elements = {self.elements}"
            )
        for position, *inertias in self.disks:
            if not 0.0 <= position <= 1.0:
                raise SettingsError(
                    f"disks: position = {position:g} must be at least 0 and at most 1: it is a "
                    "share of the length of the shaft, not a distance"
                )
            for name, value in zip(DISK[1:], inertias, strict=True):
                if value < 0.0:
                    raise SettingsError(f"disks: {name} = {value:g} must be at least 0")

    @cached_property
    def rotor(self) -> ModalRotor:
        """Shaft and disks in modal coordinates."""
        return ModalRotor.of(beam_plane(self, self.disks), self.modes // 2)

    @cached_property
    def _polar_inertia(self) -> float:
        """Moment of inertia of shaft and disks about the axis [kg m^2]."""
        return self.polar_inertia + sum(disk[2] for disk in self.disks)

    @property
    def size(self) -> int:
        """Number of coordinates: the angle, and the modes of both planes."""
        return 1 + self.modes

    @cached_property
    def weights(self) -> np.ndarray:
        """Weight of velocity multipliers: 1 on the angle, `FINE_WEIGHT` on the modes."""
        return np.concatenate([[1.0], np.full(self.modes, FINE_WEIGHT)])

    @cached_property
    def mobility(self) -> np.ndarray:
        """Compliance of each coordinate when the mechanism is assembled, shape (n,).

        With these compliances a shaft without supports moves as a rigid body, and other shafts
        bend with the least energy.
        """
        return np.concatenate([[1.0], 1.0 / np.maximum(self._angular, 1.0)])

    @cached_property
    def start(self) -> np.ndarray:
        """Coordinates at the start, without deformation, shape (n,)."""
        return np.concatenate([[np.radians(self.angle)], np.zeros(self.modes)])

    @cached_property
    def start_rates(self) -> np.ndarray:
        """Rates of the coordinates at the start, shape (n,)."""
        return np.concatenate([[self.speed], np.zeros(self.modes)])

    @property
    def axisymmetric(self) -> bool:
        """Always true, because shafts and disks are round."""
        return True

    @property
    def least_damping(self) -> float:
        """Smallest damping ratio of the modes, which is that of every mode."""
        return self.damping_ratio

    @property
    def reach(self) -> float:
        """Length of the shaft, as the largest distance of a point from the origin [m]."""
        return self.length

    @property
    def point_names(self) -> tuple[str, ...]:
        """Names of the points along the shaft."""
        return tuple(self.points)

    @cached_property
    def _shapes(self) -> dict[str, np.ndarray]:
        """Derivatives of the values of every point's marker, shape (5, n) each, by name.

        The values are ``(x, y, angle, psi_x, psi_y)``; they are differentiated with respect to the
        n coordinates.
        """
        shapes = {"": np.zeros((5, self.size))}
        for name, share in self.points.items():
            motion = self.rotor.motion(share)
            shape = shapes[name] = np.zeros((5, self.size))
            shape[:2, 1:] = motion[:2]
            shape[3:, 1:] = motion[2:]
        for shape in shapes.values():
            shape[2, 0] = 1.0
        return shapes

    def marker(self, point: str, coordinates: np.ndarray) -> Marker:
        """Marker of a point, see `Body.marker`; the origin lies on the undeformed axis."""
        shape = self._shapes[point]
        values = shape @ coordinates
        values[:2] += self.position
        return Marker(values, shape)

    @cached_property
    def _gyroscopic(self) -> np.ndarray:
        """Gyroscopic matrix of both planes, ``[[0, C], [-C, 0]]``, antisymmetric."""
        coupling = self.rotor.shapes.T @ self.rotor.beam.gyroscopic @ self.rotor.shapes
        return np.kron(np.array([[0.0, 1.0], [-1.0, 0.0]]), coupling)

    @cached_property
    def _angular(self) -> np.ndarray:
        return np.concatenate([self.rotor.angular, self.rotor.angular])

    @cached_property
    def _translation(self) -> tuple[np.ndarray, float]:
        """Nodal inertia forces for a unit acceleration along one axis, and the mass [kg]."""
        beam = self.rotor.beam
        translation = np.zeros(len(beam.mass))
        translation[::2] = 1.0
        return beam.mass @ translation, float(translation @ beam.mass @ translation)

    @cached_property
    def _carried(self) -> np.ndarray:
        """Modal inertia forces for unit accelerations of the rotor along x and y, (2 m, 2)."""
        return np.kron(np.eye(2), (self.rotor.shapes.T @ self._translation[0])[:, None])

    def balance(
        self,
        coordinates: np.ndarray,
        rates: np.ndarray,
        accelerations: np.ndarray,
        *,
        minus_gravity: np.ndarray,
    ) -> Balance:
        """Inertia, gyroscopic, stiffness and damping forces, see `Body.balance`."""
        q = coordinates[1:]
        q_rate = rates[1:]
        q_acceleration = accelerations[1:]
        gyroscopic = self._gyroscopic @ (rates[0] * q_rate + 0.5 * accelerations[0] * q)
        damping = 2 * self.damping_ratio * self._angular * q_rate
        weight = self._carried @ minus_gravity
        on_q = q_acceleration + gyroscopic + damping + self._angular**2 * q + weight
        on_angle = self._polar_inertia * accelerations[0]
        on_angle += 0.5 * q_acceleration @ (self._gyroscopic @ q)
        derivatives = partial(self._derivatives, coordinates, rates, accelerations)
        return Balance(np.concatenate([[on_angle], on_q]), derivatives)

    def _derivatives(
        self, coordinates: np.ndarray, rates: np.ndarray, accelerations: np.ndarray
    ) -> Derivatives:
        g = self._gyroscopic
        n = self.size
        position, by_rate, by_acceleration = (np.zeros((n, n)) for _ in range(3))
        position[1:, 1:] = np.diag(self._angular**2) + 0.5 * accelerations[0] * g
        position[0, 1:] = 0.5 * accelerations[1:] @ g
        by_rate[1:, 1:] = np.diag(2 * self.damping_ratio * self._angular) + rates[0] * g
        by_rate[1:, 0] = g @ rates[1:]
        by_acceleration[1:, 1:] = np.eye(n - 1)
        by_acceleration[0, 1:] = by_acceleration[1:, 0] = 0.5 * g @ coordinates[1:]
        by_acceleration[0, 0] = self._polar_inertia
        return Derivatives(position, by_rate, by_acceleration)

    def energies(self, coordinates: np.ndarray, rates: np.ndarray) -> Energies:
        """Kinetic and strain energy [J], and power lost to damping [W], see `Body.energies`."""
        q = coordinates[1:]
        q_rate = rates[1:]
        turning = self._polar_inertia * rates[0] + q_rate @ (self._gyroscopic @ q)
        return Energies(
            float(0.5 * (q_rate @ q_rate + rates[0] * turning)),
            float(0.5 * np.sum((self._angular * q) ** 2)),
            float(2 * self.damping_ratio * self._angular @ q_rate**2),
        )

    def error_measure(self) -> np.ndarray:
        """Matrix from changes of coordinates to dimensionless errors, see `Body.error_measure`.

        Errors are the angle [rad], and deflections in the mass norm over `ELASTIC_SHARE` of the
        length.
        """
        scale = ELASTIC_SHARE * self.reach * np.sqrt(self._translation[1])
        return np.diag(np.concatenate([[1.0], np.full(self.modes, 1.0 / scale)]))
