"""What a mechanism with one lubricated joint offers to the solution of a step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from fenics_ehd.film import Film, FilmState
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.multibody.bore_film import BoreFilm
from fenics_ehd.multibody.compliance import BoreCompliance


@dataclass(frozen=True, eq=False)
class Equations:
    """Equations of motion at one instant, film forces included.

    Attributes
    ----------
    residual
        shape (n,).
    shaft_rate, shaft_rate_slope
        Speed of the shaft relative to the bore [rad/s] and its derivative, shape (n,).
    linearise
        Makes `slope` and `coupling`, which most evaluations of a step do without.
    state
        What the mechanism knows about the instant, for output.
    shear
        Forces of the oil's shear for a state of the film, shape (n,), to be taken from the
        residual; None: the mechanism is without friction.
    """

    residual: np.ndarray
    shaft_rate: float
    shaft_rate_slope: np.ndarray
    linearise: Callable[[], tuple[np.ndarray, np.ndarray]]
    state: Any
    shear: Callable[[FilmState], np.ndarray] | None = None

    @cached_property
    def _derivatives(self) -> tuple[np.ndarray, np.ndarray]:
        return self.linearise()

    @property
    def slope(self) -> np.ndarray:
        """Derivative of the residual along the coordinates, shape (n, n).

        Rates and accelerations follow with the factors of the time integration formula,
        pressures are held.
        """
        return self._derivatives[0]

    @property
    def coupling(self) -> np.ndarray:
        """Force of unit nodal pressures, minus the residual's derivative along them.

        Shape (n, nodes).
        """
        return self._derivatives[1]


class LubricatedJoint(Protocol):
    """What film and coordinates have to do with each other; `Journal` says what is what."""

    film: Film
    bore: BoreFilm
    thickness: np.ndarray
    load: np.ndarray
    compliance: BoreCompliance | None

    @property
    def coordinates(self) -> int:
        """Number n of coordinates."""

    @property
    def size(self) -> int:
        """Length of the state ``x = (xi, y)``."""

    def gap(self, x: np.ndarray) -> np.ndarray:
        """Gap at every watched point [m] for a state."""

    def film_gap(self, xi: np.ndarray, xi_rate: np.ndarray, shaft_rate: float) -> Gap:
        """Gap and surface velocities at the film's Gauss points, residual patterns left out."""

    def mean_velocity_slope(self, rate_shift: float, shaft_rate_slope: np.ndarray) -> np.ndarray:
        """Derivative of the mean velocity along xi at the Gauss points, shape (g, n)."""


class Mechanism(Protocol):
    """A mechanism in minimal coordinates.

    Its state is ``x = (xi, y)``: n coordinates, and the amplitudes of the bore's residual
    patterns where it has them (`BoreCompliance`).
    """

    @property
    def journal(self) -> LubricatedJoint:
        """The joint."""

    def equations(
        self,
        time: float,
        xi: np.ndarray,
        rate: np.ndarray,
        acceleration: np.ndarray,
        shifts: tuple[float, float],
        pressure: np.ndarray,
    ) -> Equations:
        """Equations of motion for given nodal pressures [Pa]."""
