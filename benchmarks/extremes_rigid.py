"""A rigid rod by mechanics written out for itself: no coordinates, no frame, no code of the scene.

The shaft's eccentricity changes the motion of a slider-crank by clearance over crank length,
some 1e-4. Without it crank, rod and piston move as every textbook says, and Newton's laws give the
force between rod and crank as a function of time. The film then has to bear it: an equation of
first order for the eccentricity, with all terms of order c / R that the scene drops.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import process_time

import numpy as np
from scipy.integrate import solve_ivp

from fenics_ehd.film import Film, FilmParameters, Lubricant, ShaftMotion
from fenics_ehd.film.layout import film_grid
from fenics_ehd.multibody.bdf import StepControl, integrate
from fenics_ehd.multibody.massless_journal import JournalState, MasslessJournal
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings

#: Local error of a step of the balance, relative to the gap, and its first steps over a radian.
TOLERANCE, FIRST_STEP = 1e-6, 1e-5


class RigidSliderCrank:
    """Textbook slider-crank: crank l, rod L, its mass m at d from the crank pin, piston M."""

    def __init__(
        self,
        settings: SliderCrankSettings,
        body: ReducedBody,
        gas: Callable[[float], tuple[float, float]] | None = None,
    ):
        self.crank, self.piston = settings.mechanism.crank_length, settings.mechanism.piston_mass
        self.rod = float(body.points["pin"][0, 0])
        self.mass, self.inertia = body.inertia.total_mass, body.inertia.polar_inertia
        self.centre = float(body.inertia.centre_of_mass[0])
        self._gas = gas

    def rod_angle(self, angle: float, speed: float, acceleration: float = 0.0) -> tuple:
        """``theta`` with ``L sin(theta) = -l sin(phi)`` and its two rates."""
        ratio = self.crank / self.rod
        sine, cosine = np.sin(angle), np.cos(angle)
        theta = -np.arcsin(ratio * sine)
        rate = -ratio * cosine * speed / np.cos(theta)
        second = (
            ratio * (sine * speed**2 - cosine * acceleration) + np.sin(theta) * rate**2
        ) / np.cos(theta)
        return theta, rate, second

    def load(self, angle: float, speed: float) -> np.ndarray:
        """Force of the crank on the rod in the rod's frame at constant speed [N]."""
        theta, rate, second = self.rod_angle(angle, speed)
        along = np.array([np.cos(theta), np.sin(theta)])
        across = np.array([-along[1], along[0]])
        pin = -self.crank * speed**2 * np.array([np.cos(angle), np.sin(angle)])

        def point(distance: float) -> np.ndarray:
            return pin + distance * (second * across - rate**2 * along)

        gas = self._gas(angle)[0] if self._gas else 0.0
        inertia = self.mass * point(self.centre)
        axial = -self.piston * point(self.rod)[0] - gas
        # Moments about the mass centre, of the crank's force P and the guide's Y at the pin:
        # (L - d) (u x (axial, Y)) - d (u x P) = I theta'', with P = inertia - (axial, Y).
        moment = self.inertia * second + self.centre * (
            along[0] * inertia[1] - along[1] * inertia[0]
        )
        guide = (moment / self.rod + along[1] * axial) / along[0]
        force = inertia - np.array([axial, guide])
        return np.array([along @ force, across @ force])

    def reduced_inertia(self, angle: float) -> tuple[float, float]:
        """Of rod and piston on the crank [kg m^2], and its derivative along the angle."""

        def value(phi: float) -> float:
            theta, rate, _ = self.rod_angle(phi, 1.0)
            pin = self.crank * np.array([-np.sin(phi), np.cos(phi)])
            across = np.array([-np.sin(theta), np.cos(theta)])
            centre, end = (pin + x * rate * across for x in (self.centre, self.rod))
            return float(
                self.mass * centre @ centre + self.inertia * rate**2 + self.piston * end[0] ** 2
            )

        h = 1e-5
        return value(angle), (value(angle + h) - value(angle - h)) / (2 * h)

    def driven(self, speed: float, inertia: float, torque: float, times: np.ndarray) -> np.ndarray:
        """Crank angle at some times under a constant torque [rad]."""

        def slope(_time: float, state: np.ndarray) -> list[float]:
            own, change = self.reduced_inertia(state[0])
            return [state[1], (torque - 0.5 * change * state[1] ** 2) / (inertia + own)]

        start, span = [0.0, speed], (0.0, times[-1])
        return solve_ivp(slope, span, start, "DOP853", times, rtol=1e-10, atol=1e-10).y[0]


class _Balance(MasslessJournal):
    """The shaft in the rod's frame, which turns: its speed in there changes."""

    def __init__(self, film: Film, machine: RigidSliderCrank, speed: float):
        self._machine, self._speed = machine, speed
        motion = ShaftMotion(np.zeros(2), speed)
        super().__init__(film, self.load_at, motion)

    def load_at(self, time: float) -> np.ndarray:
        """Force on the shaft that the film has to balance [N]."""
        return self._machine.load(self._speed * time, self._speed)

    def state(self, time: float, x: np.ndarray, rate: np.ndarray, guess) -> JournalState:
        """With the shaft's speed of the moment."""
        turning = self._machine.rod_angle(self._speed * time, self._speed)[1]
        self._speeds = replace(self._speeds, shaft_speed=self._speed - turning)
        return super().state(time, x, rate, guess)


def balanced(
    settings: SliderCrankSettings,
    body: ReducedBody,
    end: float,
    gas: Callable[[float], tuple[float, float]] | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Times, peak pressures [Pa], thinnest films [m] at a given crank speed; processor time."""
    began = process_time()
    bearing, speed = settings.bearing, settings.mechanism.crank_speed
    grid = film_grid(body.pressure_nodes)
    film = Film(FilmParameters(grid, bearing.clearance, Lubricant(bearing.viscosity), speed))
    problem = _Balance(film, RigidSliderCrank(settings, body, gas), speed)
    control = StepControl(TOLERANCE, FIRST_STEP / speed, 1e-10 / speed, 0.05 / speed)
    x, rows = np.zeros(2), []
    # Where the scene looks for the thinnest film: nodes and Gauss points, not between them.
    angles = np.append(film.points.angle.ravel(), grid.node_positions[:, 0])
    normals = np.stack([np.cos(angles), np.sin(angles)])
    rate = problem.starting_rate(0.0, x, float(np.hypot(*problem.load_at(0.0))))
    for step in integrate(problem, (0.0, end), x, rate, control):
        thinnest = bearing.clearance - (step.x @ normals).max()
        rows.append((step.time, step.auxiliary.film.pressure.max(), thinnest))
    times, pressure, thickness = np.array(rows).T
    return times, pressure, thickness, process_time() - began
