"""What the step control observes of a mechanism: the gap of every film, and its coordinates."""

from __future__ import annotations

import numpy as np

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
        system, responses = equations.system, equations.responses
        size = system.n + equations.responses.size
        rows, constants = [], []
        for film in system.films:
            observed = np.zeros((len(film.film.observed), size))
            observed[:, film.xi] = film.film.observed
            rows.append(observed)
            constants.append(np.full(len(observed), film.film.clearance))
        for flexibility, places in zip(responses.flexibilities, responses.amplitudes, strict=True):
            for i, observed in zip(flexibility.films, flexibility.observed, strict=True):
                rows[i][:, places] = observed
        self._ends = np.cumsum([len(r) for r in rows])
        self._gaps = int(self._ends[-1]) if rows else 0
        self._measure = system.error_measure
        coordinates = np.zeros((len(self._measure), size))
        coordinates[:, : system.n] = self._measure
        self._rows = np.vstack([*rows, coordinates])
        self._constant = np.concatenate([*constants, np.zeros(len(coordinates))])

    def observe(self, x: np.ndarray) -> np.ndarray:
        """Gaps [m], then dimensionless coordinates, for a state ``(z, y)`` and more."""
        return self._constant + self._rows @ x[: self._rows.shape[1]]

    def gaps(self, observed: np.ndarray) -> np.ndarray:
        """Those of what is observed that must stay positive."""
        return observed[: self._gaps]

    def film_gaps(self, observed: np.ndarray) -> list[np.ndarray]:
        """The gap of every film."""
        return np.split(self.gaps(observed), self._ends[:-1]) if self._gaps else []

    def error_norm(self, observed: np.ndarray, error: np.ndarray) -> float:
        """Largest error, see `Observed`."""
        coordinates = float(np.abs(error[self._gaps :]).max(initial=0.0))
        if not self._gaps:
            return coordinates
        return max(relative_error(self.gaps(observed), self.gaps(error)), coordinates)

    def coordinate_error(self, change: np.ndarray) -> float:
        """Largest dimensionless change of coordinates z, shape (n,)."""
        return float(np.abs(self._measure @ change).max(initial=0.0))


def relative_error(values: np.ndarray, error: np.ndarray) -> float:
    """Largest error relative to the value there; infinite where a value is not positive.

    Of a gap: Newton's iterates stay in h > 0 at the film's Gauss points only.
    """
    if not values.min() > 0.0:
        return np.inf
    return float(np.max(np.abs(error) / values))
