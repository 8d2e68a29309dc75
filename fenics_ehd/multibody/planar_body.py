"""What bodies with planar rigid motion have in common."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property, partial

import numpy as np
from scipy import linalg

from fenics_ehd.base.plane import rotation
from fenics_ehd.multibody.body import FINE_WEIGHT, Balance, Energies
from fenics_ehd.multibody.inertia_forces import (
    Derivatives,
    FrameInertia,
    in_order_of_coordinates,
)
from fenics_ehd.multibody.marker import Marker
from fenics_ehd.reduction.inertia import ELASTIC, InertiaIntegrals

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
        """See `Body`."""
        return self._frame + self.modes

    @cached_property
    def weights(self) -> np.ndarray:
        """See `Body`."""
        return np.concatenate([np.ones(self._frame), np.full(self.modes, FINE_WEIGHT)])

    @property
    def mobility(self) -> np.ndarray:
        """See `Body`: the frame moves, elastic coordinates stay as far as they can."""
        return self.weights

    @cached_property
    def _pose(self) -> np.ndarray:
        return np.array([*self.position, self.orientation])

    @cached_property
    def start(self) -> np.ndarray:
        """See `Body`."""
        return np.concatenate([self._pose[: self._frame], np.zeros(self.modes)])

    @cached_property
    def start_rates(self) -> np.ndarray:
        """See `Body`."""
        motion = np.array([*self.velocity, self.speed])
        return np.concatenate([motion[: self._frame], np.zeros(self.modes)])

    @property
    def angle(self) -> int | None:
        """See `Body`."""
        return None if self.held else 2

    @property
    def least_damping(self) -> float:
        """See `Body`."""
        return float("inf")

    @cached_property
    def reach(self) -> float:
        """See `Body`."""
        return max((float(np.hypot(*f[:, 0])) for f in self.fields.values()), default=0.0)

    def points(self) -> tuple[str, ...]:
        """See `Body`."""
        return tuple(self.fields)

    def _whole(self, values: np.ndarray, pose: np.ndarray | float) -> np.ndarray:
        """Values of frame and elastic coordinates, of a held body too."""
        if not self.held:
            return values
        return np.concatenate([np.broadcast_to(pose, 3), values])

    def marker(self, point: str, coordinates: np.ndarray) -> Marker:
        """See `Body`."""
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
        """See `Body`."""
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
        """See `Body`."""
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
        """See `Body`: angle in rad, positions over the size, elastic motion in its mass norm."""
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
