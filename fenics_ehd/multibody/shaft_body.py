"""An elastic shaft with disks, by its modes at rest, turning at any speed.

The modes of one plane of bending, mass-normalised, serve both planes: coordinates are the angle
theta about the axis and ``(a, b)`` with the deflections ``u = Phi a`` along x and ``v = Phi b``
along y. With ``C = Phi^T G Phi`` and the polar inertia J,

    a'' + 2 zeta Omega_r a' + theta' C b' + theta'' C b / 2 + Omega_r^2 a = Phi^T f_x
    b'' + 2 zeta Omega_r b' - theta' C a' - theta'' C a / 2 + Omega_r^2 b = Phi^T f_y
    J theta'' + (a'' . C b - b'' . C a) / 2 = torque

follow from the kinetic energy
``(|a'|^2 + |b'|^2 + J theta'^2 + theta' (a' . C b - b' . C a)) / 2``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.multibody.body import FINE_WEIGHT, Balance, Energies
from fenics_ehd.multibody.inertia_forces import Derivatives
from fenics_ehd.multibody.marker import Marker
from fenics_ehd.multibody.planar_body import ELASTIC_SHARE
from fenics_ehd.multibody.rotor import ModalRotor


@dataclass(frozen=True, eq=False)
class ShaftBody:
    """A `Body`; its markers tilt.

    Attributes
    ----------
    rotor
        Shaft and disks in modes.
    polar_inertia
        Of shaft and disks about the axis [kg m^2].
    damping_ratio
        zeta of every mode.
    stations
        Points by name: share of the length.
    position
        Of the undeformed axis in the plane [m].
    orientation, speed
        Angle and angular speed at the start where nothing else gives them [rad], [rad/s].
    """

    rotor: ModalRotor
    polar_inertia: float
    damping_ratio: float = 0.0
    stations: Mapping[str, float] = field(default_factory=dict)
    position: tuple[float, float] = (0.0, 0.0)
    orientation: float = 0.0
    speed: float = 0.0
    angle = 0

    def __post_init__(self) -> None:
        for name, share in self.stations.items():
            if not 0.0 <= share <= 1.0:
                raise SettingsError(
                    f"point {name} = {share:g} of the shaft must be a share, 0 to 1"
                )

    @property
    def _modes(self) -> int:
        return len(self.rotor.angular)

    @property
    def size(self) -> int:
        """See `Body`."""
        return 1 + 2 * self._modes

    @cached_property
    def weights(self) -> np.ndarray:
        """See `Body`."""
        return np.concatenate([[1.0], np.full(2 * self._modes, FINE_WEIGHT)])

    @cached_property
    def mobility(self) -> np.ndarray:
        """See `Body`: a free shaft moves as a whole, any other bends with the least energy."""
        return np.concatenate([[1.0], 1.0 / np.maximum(self._angular, 1.0)])

    @cached_property
    def start(self) -> np.ndarray:
        """See `Body`."""
        return np.concatenate([[self.orientation], np.zeros(2 * self._modes)])

    @cached_property
    def start_rates(self) -> np.ndarray:
        """See `Body`."""
        return np.concatenate([[self.speed], np.zeros(2 * self._modes)])

    @property
    def least_damping(self) -> float:
        """See `Body`."""
        return self.damping_ratio

    @property
    def reach(self) -> float:
        """See `Body`."""
        return self.rotor.beam.shaft.length

    def points(self) -> tuple[str, ...]:
        """See `Body`."""
        return tuple(self.stations)

    @cached_property
    def _shapes(self) -> dict[str, np.ndarray]:
        """Of every marker, shape (5, n)."""
        shapes = {"": np.zeros((5, self.size))}
        for name, share in self.stations.items():
            motion = self.rotor.motion(share)
            shape = shapes[name] = np.zeros((5, self.size))
            shape[:2, 1:], shape[3:, 1:] = motion[:2], motion[2:]
        for shape in shapes.values():
            shape[2, 0] = 1.0
        return shapes

    def marker(self, point: str, coordinates: np.ndarray) -> Marker:
        """See `Body`; the origin is the undeformed axis."""
        shape = self._shapes[point]
        values = shape @ coordinates
        values[:2] += self.position
        return Marker(values, shape)

    @cached_property
    def _gyroscopic(self) -> np.ndarray:
        """``[[0, C], [-C, 0]]``, antisymmetric."""
        coupling = self.rotor.shapes.T @ self.rotor.beam.gyroscopic @ self.rotor.shapes
        return np.kron(np.array([[0.0, 1.0], [-1.0, 0.0]]), coupling)

    @cached_property
    def _angular(self) -> np.ndarray:
        return np.concatenate([self.rotor.angular, self.rotor.angular])

    @cached_property
    def _moved(self) -> tuple[np.ndarray, float]:
        """Nodal forces that accelerate the whole along one axis by 1, and the total mass [kg]."""
        beam = self.rotor.beam
        whole = np.zeros(len(beam.mass))
        whole[::2] = 1.0
        return beam.mass @ whole, float(whole @ beam.mass @ whole)

    @cached_property
    def _carried(self) -> np.ndarray:
        """Generalised mass of unit accelerations of the frame at rest, shape (2 modes, 2)."""
        return np.kron(np.eye(2), (self.rotor.shapes.T @ self._moved[0])[:, None])

    def balance(
        self,
        coordinates: np.ndarray,
        rates: np.ndarray,
        accelerations: np.ndarray,
        *,
        lift: np.ndarray,
    ) -> Balance:
        """See `Body`."""
        q, q_rate, q_acceleration = coordinates[1:], rates[1:], accelerations[1:]
        turned = self._gyroscopic @ (rates[0] * q_rate + 0.5 * accelerations[0] * q)
        damping = 2 * self.damping_ratio * self._angular * q_rate
        on_q = q_acceleration + turned + damping + self._angular**2 * q + self._carried @ lift
        on_angle = self.polar_inertia * accelerations[0]
        on_angle += 0.5 * q_acceleration @ (self._gyroscopic @ q)
        derivatives = partial(self._derivatives, coordinates, rates, accelerations)
        return Balance(np.concatenate([[on_angle], on_q]), derivatives)

    def _derivatives(
        self, coordinates: np.ndarray, rates: np.ndarray, accelerations: np.ndarray
    ) -> Derivatives:
        g, n = self._gyroscopic, self.size
        position, by_rate, by_acceleration = (np.zeros((n, n)) for _ in range(3))
        position[1:, 1:] = np.diag(self._angular**2) + 0.5 * accelerations[0] * g
        position[0, 1:] = 0.5 * accelerations[1:] @ g
        by_rate[1:, 1:] = np.diag(2 * self.damping_ratio * self._angular) + rates[0] * g
        by_rate[1:, 0] = g @ rates[1:]
        by_acceleration[1:, 1:] = np.eye(n - 1)
        by_acceleration[0, 1:] = by_acceleration[1:, 0] = 0.5 * g @ coordinates[1:]
        by_acceleration[0, 0] = self.polar_inertia
        return Derivatives(position, by_rate, by_acceleration)

    def energies(self, coordinates: np.ndarray, rates: np.ndarray) -> Energies:
        """See `Body`."""
        q, q_rate = coordinates[1:], rates[1:]
        turning = self.polar_inertia * rates[0] + q_rate @ (self._gyroscopic @ q)
        return Energies(
            float(0.5 * (q_rate @ q_rate + rates[0] * turning)),
            float(0.5 * np.sum((self._angular * q) ** 2)),
            float(2 * self.damping_ratio * self._angular @ q_rate**2),
        )

    def error_measure(self) -> np.ndarray:
        """See `Body`: angle in rad, deflections in their mass norm."""
        scale = ELASTIC_SHARE * self.reach * np.sqrt(self._moved[1])
        return np.diag(np.concatenate([[1.0], np.full(2 * self._modes, 1.0 / scale)]))
