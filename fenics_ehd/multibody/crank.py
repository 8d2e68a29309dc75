"""Crank pin centre C1 as a known function of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class CrankMotion:
    """Position, velocity and acceleration of C1 [m], [m/s], [m/s^2]; shaft speed [rad/s]."""

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    speed: float


@dataclass(frozen=True)
class ConstantSpeedCrank:
    """Crank of length [m] turning at constant speed [rad/s], at angle zero at time zero."""

    length: float
    speed: float

    def at(self, time: float) -> CrankMotion:
        """Motion at a time [s]."""
        angle = self.speed * time
        direction = np.array([np.cos(angle), np.sin(angle)])
        normal = np.array([-direction[1], direction[0]])
        return CrankMotion(
            position=self.length * direction,
            velocity=self.length * self.speed * normal,
            acceleration=-self.length * self.speed**2 * direction,
            speed=self.speed,
        )
