"""A reduced part as a body, free or held."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fenics_ehd.multibody.inertia_forces import with_total
from fenics_ehd.multibody.planar_body import PlanarBody
from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.reduction.inertia import InertiaIntegrals


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
