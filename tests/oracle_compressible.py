"""A compressible film in one dimension without fenics_ehd: finite volumes, LSODA in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp


@dataclass(frozen=True)
class CompressibleArc:
    """Half of an infinitely wide journal film between two lines of supply, that is full.

    ``(rho h)' = (rho h^3 / (12 eta R^2) p_phi)_phi`` between angles `middle` -+ pi/2, where the
    pressure is given, with ``rho = 1 + a p / (1 + b p)`` after Dowson and Higginson and the gap
    ``c (1 - e(t) cos phi)``. At the start there is no pressure.
    """

    middle: float
    clearance: float
    radius: float
    viscosity: float
    supply: float
    eccentricity: Callable[[float], float]
    cells: int = 200

    A, B = 0.6e-9, 1.7e-9

    def _density(self, pressure: np.ndarray) -> np.ndarray:
        return 1 + self.A * pressure / (1 + self.B * pressure)

    def pressures(self, end: float) -> tuple[np.ndarray, np.ndarray]:
        """Angles and pressures [Pa] at a time [s]."""
        width = np.pi / self.cells
        edges = self.middle - np.pi / 2 + width * np.arange(self.cells + 1)
        inside = edges[:-1] + width / 2

        def gap(time: float, angle: np.ndarray) -> np.ndarray:
            return self.clearance * (1 - self.eccentricity(time) * np.cos(angle))

        def pressure(time: float, held: np.ndarray) -> np.ndarray:
            excess = held / gap(time, inside) - 1
            return excess / (self.A - self.B * excess)

        def rate(time: float, held: np.ndarray) -> np.ndarray:
            p = np.concatenate([[self.supply], pressure(time, held), [self.supply]])
            steps = width * np.concatenate([[0.5], np.ones(self.cells - 1), [0.5]])
            rho = self._density(p)
            between = 0.5 * (rho[1:] + rho[:-1])
            between[0], between[-1] = rho[0], rho[-1]
            conductance = between * gap(time, edges) ** 3
            flow = -conductance / (12 * self.viscosity * self.radius**2) * np.diff(p) / steps
            return -np.diff(flow) / width

        run = solve_ivp(
            rate, (0.0, end), gap(0.0, inside), method="LSODA", rtol=1e-8,
            atol=1e-12 * self.clearance, lband=1, uband=1,
        )  # fmt: skip
        assert run.success
        return inside, pressure(end, run.y[:, -1])
