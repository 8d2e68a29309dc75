"""A rigid rod by mechanics written out for itself: no coordinates, no frame, no code of the scene.

The shaft's eccentricity changes the motion of a slider-crank by clearance over crank length,
some 1e-4. Without it crank, rod and piston move as in every textbook, and Newton's laws give the
force between rod and crank as a function of time. The film then has to bear it: an equation of
first order for the eccentricity of a journal without mass in a bearing at rest.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

import fenics_ehd as ehd
from fenics_ehd.multibody.forces import Table

#: Local error of a step of the balance, relative to the gap, and its first steps over a radian.
TOLERANCE, FIRST_STEP = 1e-5, 1e-5


class RigidSliderCrank:
    """Textbook slider-crank: crank l, rod L, its mass m at d from the crank pin, piston M."""

    def __init__(self, built: ehd.Machine):
        bodies = built.mechanism.bodies
        self.crank, self.piston = bodies["crank"].points["pin"][0], bodies["piston"].mass
        rod = bodies["rod"]
        self.rod, self.centre = rod.points["pin"][0], rod.centre[0]
        self.mass, self.inertia = rod.mass, rod.inertia
        gas = built.mechanism.forces.get("gas")
        self._gas = gas.size if isinstance(gas, ehd.PointForce) else None

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


class _JournalLoad:
    """The crank's force in the rod's frame, which turns, and the journal's angle in there."""

    def __init__(self, machine: RigidSliderCrank, speed: float):
        self._machine, self._speed = machine, speed

    def component(self, axis: int) -> Table:
        """Of the force over time [N]; its derivative is not used."""
        return lambda time: (self._machine.load(self._speed * time, self._speed)[axis], 0.0)

    def angle(self, time: float) -> tuple[float, float]:
        """Of the journal relative to the rod [rad], and its rate."""
        crank = self._speed * time
        rod, rate, _ = self._machine.rod_angle(crank, self._speed)
        return crank - rod, self._speed - rate


def balanced(built: ehd.Machine, end: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, peak pressures [Pa], thinnest films [m] at the speed of the crank's drive."""
    film = built.mechanism.joints["big_end"].film
    speed = built.mechanism.drives["crank"](0.0)[1]
    load = _JournalLoad(RigidSliderCrank(built), speed)
    mechanism = ehd.Mechanism(
        bodies={"journal": ehd.MasslessBody()},
        joints={"bearing": ehd.LubricatedJoint("journal", "ground", film)},
        drives={"journal": load.angle},
        forces={
            "x": ehd.PointForce("journal", (1.0, 0.0), load.component(0)),
            "y": ehd.PointForce("journal", (0.0, 1.0), load.component(1)),
        },
    )
    steps = {"first": FIRST_STEP / speed, "smallest": 1e-10 / speed, "largest": 0.05 / speed / end}
    result = ehd.simulate(mechanism, end, tolerance=TOLERANCE, order=2, **steps)
    joint = result.joints["bearing"]
    return result.time, joint.max_pressure, joint.min_film_thickness
