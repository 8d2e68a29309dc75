"""Rigid bodies, and the ground."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.multibody.inertia_forces import rigid_integrals
from fenics_ehd.multibody.planar_body import PlanarBody
from fenics_ehd.reduction.inertia import InertiaIntegrals


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
