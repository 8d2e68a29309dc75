"""A linear mechanism without its film: everything but the oil."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from fenics_ehd.multibody.energy import Powers


def no_force(size: int) -> Callable[[float], np.ndarray]:
    """No force at any time on coordinates of this number."""
    zero = np.zeros(size)
    return lambda time: zero


@dataclass(frozen=True, eq=False)
class DrySystem:
    """``M x'' + C x' + K x = f(t)`` in n coordinates.

    Attributes
    ----------
    mass, damping, stiffness
        M, C and K, shape (n, n). M and K are symmetric, M may be singular; C holds the
        gyroscopic terms as its antisymmetric part, which do no work.
    force
        f at a time [s], shape (n,).
    """

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    force: Callable[[float], np.ndarray]

    @property
    def size(self) -> int:
        """Number n of coordinates."""
        return len(self.mass)

    def residual(
        self, time: float, x: np.ndarray, rate: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """``M x'' + C x' + K x - f``."""
        return (
            self.mass @ acceleration + self.damping @ rate + self.stiffness @ x - self.force(time)
        )

    def derivative(self, shifts: tuple[float, float]) -> np.ndarray:
        """Total derivative of the residual when rates follow x with the factors `shifts`."""
        return self.stiffness + shifts[0] * self.damping + shifts[1] * self.mass

    def beside(self, other: DrySystem) -> DrySystem:
        """Both systems, uncoupled: the coordinates of this one come first."""
        return DrySystem(
            block_diag(self.mass, other.mass),
            block_diag(self.damping, other.damping),
            block_diag(self.stiffness, other.stiffness),
            lambda time: np.concatenate([self.force(time), other.force(time)]),
        )

    def powers(
        self, time: float, x: np.ndarray, rate: np.ndarray, film: float = 0.0, drag: float = 0.0
    ) -> Powers:
        """Energies and powers, those of the film as given [W]."""
        return Powers(
            kinetic=float(0.5 * rate @ self.mass @ rate),
            strain=float(0.5 * x @ self.stiffness @ x),
            drive=float(self.force(time) @ rate),
            drag=drag,
            film=film,
            damping=float(rate @ self.damping @ rate),
        )
