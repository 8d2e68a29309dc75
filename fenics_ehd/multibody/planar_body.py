"""Bodies with planar rigid motion: the ground, rigid bodies, flexible bodies free or held."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy import linalg

from fenics_ehd.errors import SettingsError
from fenics_ehd.multibody.body import FINE_WEIGHT, Energies
from fenics_ehd.multibody.inertia_forces import (
    Derivatives,
    FrameInertia,
    in_order_of_coordinates,
    rigid_integrals,
    with_total,
)
from fenics_ehd.multibody.marker import Marker
from fenics_ehd.plane import rotation
from fenics_ehd.reduction.body import InertiaIntegrals, ReducedBody

#: Elastic displacements count for the step control relative to this share of the body's size:
#: about what the strain of a sound part allows.
ELASTIC_SHARE = 1e-3


def _pair() -> tuple[float, float]:
    return (0.0, 0.0)


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
        *,
        lift: np.ndarray,
    ) -> FrameInertia:
        return FrameInertia(
            self._inertia_integrals,
            self._whole(coordinates, self._pose),
            self._whole(rates, 0.0),
            self._whole(accelerations, 0.0),
            lift,
        )

    def forces(
        self,
        coordinates: np.ndarray,
        rates: np.ndarray,
        accelerations: np.ndarray,
        *,
        lift: np.ndarray,
    ) -> np.ndarray:
        """See `Body`."""
        skipped = 3 - self._frame
        forces = self._inertia(coordinates, rates, accelerations, lift=lift).forces[skipped:]
        if self.stiffness is not None:
            q = coordinates[self._frame :] + self.damping_time * rates[self._frame :]
            forces[self._frame :] += self.stiffness @ q
        return forces

    def derivatives(
        self,
        coordinates: np.ndarray,
        rates: np.ndarray,
        accelerations: np.ndarray,
        *,
        lift: np.ndarray,
    ) -> Derivatives:
        """See `Body`."""
        whole = self._inertia(coordinates, rates, accelerations, lift=lift).derivatives()
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
        kinetic = self._inertia(
            coordinates, rates, np.zeros_like(rates), lift=np.zeros(2)
        ).kinetic_energy
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
            elastic = self.integrals.mass[3:, 3:]
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
    centre: tuple[float, float] = field(default_factory=_pair)
    position: tuple[float, float] = field(default_factory=_pair)
    orientation: float = 0.0
    velocity: tuple[float, float] = field(default_factory=_pair)
    speed: float = 0.0
    held: bool = False

    def __post_init__(self) -> None:
        for name in ("mass", "inertia"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise SettingsError(f"{name} = {value:g} of a rigid body must be at least 0")

    @cached_property
    def integrals(self) -> InertiaIntegrals:  # type: ignore[override]
        """See `InertiaIntegrals`."""
        return rigid_integrals(self.mass, self.inertia, np.array(self.centre))

    @cached_property
    def fields(self) -> dict[str, np.ndarray]:  # type: ignore[override]
        """See `PlanarBody`."""
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

    The frame's origin is the undeformed bore's centre; its point ``bore`` is that, not what
    the bore's deformation moves.

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
    position: tuple[float, float] = field(default_factory=_pair)
    orientation: float = 0.0
    velocity: tuple[float, float] = field(default_factory=_pair)
    speed: float = 0.0
    mass: float | None = None
    inertia: float | None = None
    centre: tuple[float, float] | None = None

    @cached_property
    def held(self) -> bool:  # type: ignore[override]
        """Whether the part was clamped when it was reduced."""
        return self.reduced.frame == "clamped"

    @property
    def least_damping(self) -> float:
        """See `Body`."""
        ratios = np.pi * self.reduced.frequencies * self.damping_time
        return float(ratios.min(initial=np.inf))

    @cached_property
    def integrals(self) -> InertiaIntegrals:  # type: ignore[override]
        """See `InertiaIntegrals`."""
        centre = None if self.centre is None else np.array(self.centre)
        return with_total(self.reduced.inertia, self.mass, self.inertia, centre)

    @cached_property
    def stiffness(self) -> np.ndarray | None:  # type: ignore[override]
        """Of the elastic coordinates, shape (n, n) [N/m]."""
        return self.reduced.stiffness if self.reduced.modes else None

    @cached_property
    def fields(self) -> dict[str, np.ndarray]:  # type: ignore[override]
        """See `PlanarBody`."""
        bore = np.zeros((2, 3 + self.reduced.modes))
        bore[0, 1] = bore[1, 2] = 1.0
        return {"bore": bore, **{name: f[:2] for name, f in self.reduced.points.items()}}
