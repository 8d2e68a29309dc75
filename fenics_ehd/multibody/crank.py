"""Crank pin centre C1 as a function of the crank's angle, which is given or free.

    C1 = l d,   C1' = l phi' n,   C1'' = l (phi'' n - phi'^2 d),   d = (cos phi, sin phi)

with ``n`` 90 degrees ahead of ``d``. At angle zero the piston is farthest from the crank's axis.
A free angle is the last coordinate of its mechanism, by its lead ``psi`` over the steady rotation,
``phi = omega t + psi``: what is integrated stays small, as the eccentricity does, and begins at
rest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

#: Value and derivative of something periodic at a crank angle [rad].
AngleFunction = Callable[[float], tuple[float, float]]


@dataclass(frozen=True, eq=False)
class AngleSlopes:
    """Derivatives of a crank's motion along its angle, rates following with the formula's shifts.

    Attributes
    ----------
    position, velocity, acceleration
        Of C1, shape (2,) [m], [m/s], [m/s^2] per rad.
    curvature
        Second derivative of the position, shape (2,) [m].
    speed, angular_acceleration
        Of the crank: the shifts themselves.
    """

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    curvature: np.ndarray
    speed: float
    angular_acceleration: float


@dataclass(frozen=True)
class CrankMotion:
    """Position, velocity and acceleration of C1 [m], [m/s], [m/s^2]; shaft speed [rad/s].

    The angle [rad], its acceleration [rad/s^2] and the derivatives along it, the last
    coordinate; None: the angle is given.
    """

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    speed: float
    angle: float = 0.0
    angular_acceleration: float = 0.0
    along: AngleSlopes | None = None


@dataclass(frozen=True)
class ConstantSpeedCrank:
    """Crank of length [m] turning at constant speed [rad/s], at angle zero at time zero."""

    length: float
    speed: float

    def at(self, time: float) -> CrankMotion:
        """Motion at a time [s]."""
        angle = self.speed * time
        direction, normal = _directions(angle)
        return CrankMotion(
            position=self.length * direction,
            velocity=self.length * self.speed * normal,
            acceleration=-self.length * self.speed**2 * direction,
            speed=self.speed,
            angle=angle,
        )


@dataclass(frozen=True)
class DrivenCrank:
    """Crank turned by a torque, at angle zero and its nominal speed at time zero.

    The torque is ``torque(phi) + damping (speed - phi')``.

    Attributes
    ----------
    length
        [m].
    speed
        Nominal speed omega [rad/s].
    inertia
        About its axis [kg m^2].
    torque
        [N m].
    damping
        What holds the speed [N m s/rad].
    """

    length: float
    speed: float
    inertia: float
    torque: AngleFunction
    damping: float = 0.0

    def at(
        self, time: float, lead: tuple[float, float, float], shifts: tuple[float, float]
    ) -> CrankMotion:
        """Motion at a time [s].

        Parameters
        ----------
        time
            [s].
        lead
            ``psi``, ``psi'``, ``psi''``.
        shifts
            ``d psi' / d psi`` and ``d psi'' / d psi`` of the time integration formula.
        """
        angle, speed, acceleration = self.speed * time + lead[0], self.speed + lead[1], lead[2]
        direction, normal = _directions(angle)
        length, (alpha, beta) = self.length, shifts
        along = AngleSlopes(
            position=length * normal,
            velocity=length * (alpha * normal - speed * direction),
            acceleration=length
            * ((beta - speed**2) * normal - (acceleration + 2 * alpha * speed) * direction),
            curvature=-length * direction,
            speed=alpha,
            angular_acceleration=beta,
        )
        return CrankMotion(
            position=length * direction,
            velocity=length * speed * normal,
            acceleration=length * (acceleration * normal - speed**2 * direction),
            speed=speed,
            angle=angle,
            angular_acceleration=acceleration,
            along=along,
        )

    def moment(self, motion: CrankMotion) -> tuple[float, float]:
        """Driving torque [N m] and its derivative along the angle [N m/rad]."""
        assert motion.along is not None
        torque, slope = self.torque(motion.angle)
        return (
            torque + self.damping * (self.speed - motion.speed),
            slope - self.damping * motion.along.speed,
        )

    def kinetic_energy(self, motion: CrankMotion) -> float:
        """[J]."""
        return 0.5 * self.inertia * motion.speed**2


def _directions(angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors along the crank and 90 degrees ahead."""
    direction = np.array([np.cos(angle), np.sin(angle)])
    return direction, np.array([-direction[1], direction[0]])
