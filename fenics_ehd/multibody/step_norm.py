"""What the step control watches of a mechanism: the gap of every film, and its coordinates."""

from __future__ import annotations

import numpy as np

from fenics_ehd.multibody.bdf import relative_error
from fenics_ehd.multibody.step_equations import StepEquations


class StepNorm:
    """Errors of the gaps, relative to the gaps, and of the bodies' coordinates (`Body`).

    Without a film the coordinates alone control the steps.

    Parameters
    ----------
    equations
        Of the mechanism.
    """

    def __init__(self, equations: StepEquations):
        system = equations.system
        size = system.n + equations.patterns
        rows, constants, place = [], [], system.n
        for film, flexibility in zip(system.films, equations.flexibilities, strict=True):
            watched = np.zeros((len(film.film.watched), size))
            watched[:, film.xi] = film.film.watched
            if flexibility is not None:
                watched[:, place : place + flexibility.size] = flexibility.watched
                place += flexibility.size
            rows.append(watched)
            constants.append(np.full(len(watched), film.film.clearance))
        self._ends = np.cumsum([len(r) for r in rows])
        self._gaps = int(self._ends[-1]) if rows else 0
        self._measure = system.error_measure
        coordinates = np.zeros((len(self._measure), size))
        coordinates[:, : system.n] = self._measure
        self._rows = np.vstack([*rows, coordinates])
        self._constant = np.concatenate([*constants, np.zeros(len(coordinates))])

    def watch(self, x: np.ndarray) -> np.ndarray:
        """Gaps [m], then dimensionless coordinates, for a state ``(z, y)``."""
        return self._constant + self._rows @ x

    def gaps(self, watched: np.ndarray) -> np.ndarray:
        """Those of what is watched that must stay positive."""
        return watched[: self._gaps]

    def film_gaps(self, watched: np.ndarray) -> list[np.ndarray]:
        """The gap of every film."""
        return np.split(self.gaps(watched), self._ends[:-1]) if self._gaps else []

    def error_norm(self, watched: np.ndarray, error: np.ndarray) -> float:
        """Largest error, see `Watched`."""
        coordinates = float(np.abs(error[self._gaps :]).max(initial=0.0))
        if not self._gaps:
            return coordinates
        return max(relative_error(self.gaps(watched), self.gaps(error)), coordinates)

    def coordinate_error(self, change: np.ndarray) -> float:
        """Largest dimensionless change of coordinates z, shape (n,)."""
        return float(np.abs(self._measure @ change).max(initial=0.0))
