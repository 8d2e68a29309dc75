"""The obvious formulation of a lubricated mechanism: the film solved within every evaluation.

`fenics_ehd.multibody.coupled` solves pressures and coordinates together. Here pressures
are a function of coordinates and rates, made by a whole solution of the film, and what is
left is an implicit second-order system for any integrator. Tests use it as the independent
formulation, benchmarks to drive PETSc's and SciPy's integrators.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_ehd.film import FilmState
from fenics_ehd.film.kinematics import GapSlopes
from fenics_ehd.multibody.bdf import relative_error
from fenics_ehd.multibody.equations import Mechanism


@dataclass(frozen=True, eq=False)
class NestedState:
    """Film and mechanism of one evaluation."""

    film: FilmState
    mechanism: Any


class NestedFilm:
    """A mechanism without residual patterns as a `SecondOrderProblem`.

    Parameters
    ----------
    mechanism
        Its journal without compliance.
    """

    def __init__(self, mechanism: Mechanism):
        assert mechanism.journal.compliance is None
        self.mechanism, self.journal = mechanism, mechanism.journal
        self.film = mechanism.journal.film
        self.size = mechanism.journal.coordinates

    def solve_film(
        self,
        time: float,
        x: np.ndarray,
        rate: np.ndarray,
        guess: FilmState | None,
        shifts: tuple[float, float] = (0.0, 0.0),
    ) -> tuple[FilmState, np.ndarray]:
        """Film at a position and velocity, and the slope of the shaft's speed.

        The guide's angular rate depends on no acceleration and no pressure.
        """
        nothing, rest = np.zeros(self.film.assembly.size), np.zeros(self.size)
        free = self.mechanism.equations(time, x, rate, rest, shifts, nothing)
        gap = self.journal.film_gap(x, rate, free.shaft_rate)
        return self.film.solve(gap, guess), free.shaft_rate_slope

    def linearise(
        self,
        time: float,
        x: np.ndarray,
        rate: np.ndarray,
        acceleration: np.ndarray,
        shifts: tuple[float, float],
        guess: NestedState | None,
    ) -> tuple[np.ndarray, np.ndarray, NestedState]:
        """Residual and its total derivative along x."""
        film, speed_slope = self.solve_film(time, x, rate, guess.film if guess else None, shifts)
        found = self.mechanism.equations(time, x, rate, acceleration, shifts, film.pressure)
        shape = (*film.gap.thickness.shape, -1)
        thickness = self.journal.thickness.reshape(shape)
        velocity = self.journal.mean_velocity_slope(shifts[0], speed_slope).reshape(shape)
        slopes = GapSlopes(thickness, shifts[0] * thickness, velocity)
        slope = found.slope - found.coupling @ self.film.sensitivity(film, slopes)
        return found.residual, slope, NestedState(film, found.state)

    def watch(self, x: np.ndarray) -> np.ndarray:
        """Gap at the watched points [m]."""
        return self.journal.gap(x)

    def error_norm(self, watched: np.ndarray, error: np.ndarray) -> float:
        """See `relative_error`."""
        return relative_error(watched, error)

    def norm(self, x: np.ndarray, change: np.ndarray) -> float:
        """Largest change of the gap relative to the gap there."""
        gap = self.watch(x)
        return self.error_norm(gap, self.watch(x + change) - gap)

    def admissible_fraction(self, x: np.ndarray, change: np.ndarray) -> float:
        """Fraction of a change at which the gap closes somewhere."""
        gap = self.watch(x)
        largest = float(((gap - self.watch(x + change)) / gap).max())
        return 1.0 / largest if largest > 0.0 else np.inf
