"""A nested film as integrators of others want it: scaled unknowns, derivatives one by one.

Unknowns are ``x / length``: a length changes the gap by up to a clearance. Forces are scaled by
those that the film exerts.
"""

from __future__ import annotations

import numpy as np
from integrators_case import Case
from nested_film import NestedFilm

from fenics_ehd.film import FilmState
from fenics_ehd.film.kinematics import GapSlopes

#: Shift at which the parts of a derivative are told apart [1/s].
PROBE = 1e6


class ScaledFilm(NestedFilm):
    """`NestedFilm` in scaled unknowns, its film remembered."""

    def __init__(self, case: Case):
        super().__init__(case.machine)
        moved = np.abs(self.journal.thickness).max(axis=0)
        clearance = self.film.parameters.clearance
        self.length = clearance / np.maximum(moved, 1e-6 * moved.max())
        reach = np.abs(self.journal.load[1:]).sum(axis=1) * self.film.parameters.pressure_scale
        self.force = np.maximum(reach, 1e-6 * reach.max())
        self.evaluations = 0
        self._key: tuple[float, bytes, bytes] | None = None
        self._state: FilmState | None = None

    def film_at(self, time: float, x: np.ndarray, rate: np.ndarray) -> FilmState:
        """Film, solved once for every position and velocity."""
        key = (time, x.tobytes(), rate.tobytes())
        if key != self._key:
            self._key = None
            self._state, _ = self.solve_film(time, x, rate, self._state)
            self._key = key
            self.evaluations += 1
        assert self._state is not None
        return self._state

    def residual(
        self, time: float, x: np.ndarray, rate: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """Unbalanced forces, scaled."""
        pressure = self.film_at(time, x, rate).pressure
        found = self.mechanism.equations(time, x, rate, acceleration, (0.0, 0.0), pressure)
        return found.residual / self.force

    def derivatives(
        self, time: float, x: np.ndarray, rate: np.ndarray, acceleration: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the residual along position, rate and acceleration, scaled."""
        film = self.film_at(time, x, rate)
        at = [
            self.mechanism.equations(time, x, rate, acceleration, shifts, film.pressure)
            for shifts in ((0.0, 0.0), (PROBE, 0.0), (0.0, PROBE**2))
        ]
        stiffness = at[0].slope
        damping, mass = (at[1].slope - stiffness) / PROBE, (at[2].slope - stiffness) / PROBE**2
        shape = (*film.gap.thickness.shape, -1)
        thickness = self.journal.thickness
        speed = at[0].shaft_rate_slope
        speed_rate = (at[1].shaft_rate_slope - speed) / PROBE
        velocity = self.journal.mean_velocity_slope(0.0, speed)
        velocity_rate = self.journal.mean_velocity_slope(1.0, speed_rate)
        nothing = np.zeros_like(thickness)
        slopes = GapSlopes(
            np.hstack([thickness, nothing]).reshape(shape),
            np.hstack([nothing, thickness]).reshape(shape),
            np.hstack([velocity, velocity_rate]).reshape(shape),
        )
        forces = at[0].coupling @ self.film.sensitivity(film, slopes)
        scale = self.length / self.force[:, None]
        n = self.size
        return (
            (stiffness - forces[:, :n]) * scale,
            (damping - forces[:, n:]) * scale,
            mass * scale,
        )

    def combined(
        self,
        time: float,
        x: np.ndarray,
        rate: np.ndarray,
        acceleration: np.ndarray,
        shifts: tuple[float, float],
    ) -> np.ndarray:
        """Stiffness, damping and mass with these shifts, scaled, by one derivative of the film."""
        film = self.film_at(time, x, rate)
        found = self.mechanism.equations(time, x, rate, acceleration, shifts, film.pressure)
        shape = (*film.gap.thickness.shape, -1)
        thickness = self.journal.thickness.reshape(shape)
        velocity = self.journal.mean_velocity_slope(shifts[0], found.shaft_rate_slope)
        slopes = GapSlopes(thickness, shifts[0] * thickness, velocity.reshape(shape))
        slope = found.slope - found.coupling @ self.film.sensitivity(film, slopes)
        return slope * (self.length / self.force[:, None])
