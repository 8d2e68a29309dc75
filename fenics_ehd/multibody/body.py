"""What a body offers to a mechanism."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fenics_ehd.multibody.inertia_forces import Derivatives
from fenics_ehd.multibody.marker import Marker

#: Weight of multipliers on coordinates that the films see, next to 1 on frames: about the square
#: of clearance over length. A weight of 1 turns the drift of the large motion into false squeeze
#: velocities, 0 is singular where two films carry one body (DESIGN, fact 6).
FINE_WEIGHT = 1e-7


@dataclass(frozen=True)
class Energies:
    """Of one body at one instant: [J], [J], and what its damping takes [W]."""

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
        """How readily assembly changes each coordinate, shape (n,)."""

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
        """See there."""

    def error_measure(self) -> np.ndarray:
        """Rows that make coordinates dimensionless for the step control, shape (k, n)."""
