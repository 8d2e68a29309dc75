"""What a mechanism with one lubricated joint offers to the solution of a step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
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
    slope
        Its derivative along the coordinates, rates and accelerations following with the
        factors of the time integration formula, pressures held, shape (n, n).
    coupling
        Force of unit nodal pressures, minus its derivative along them, shape (n, nodes).
    shaft_rate, shaft_rate_slope
        Speed of the shaft relative to the bore [rad/s] and its derivative, shape (n,).
    state
        What the mechanism knows about the instant, for output.
    shear
        Forces of the oil's shear for a state of the film, shape (n,), to be taken from the
        residual; None: the mechanism is without friction.
    """

    residual: np.ndarray
    slope: np.ndarray
    coupling: np.ndarray
    shaft_rate: float
    shaft_rate_slope: np.ndarray
    state: Any
    shear: Callable[[FilmState], np.ndarray] | None = None


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
