"""Norm of the step control: errors of the gaps of every film, and of the coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_ehd.multibody.lubricated_joint import JointShape
from fenics_ehd.multibody.mechanism import FilmBinding, consecutive
from fenics_ehd.multibody.step_equations import StepEquations


class StepNorm:
    """Norm of the errors of the gaps, relative to the gaps, and of the bodies' coordinates.

    Without a film the coordinates alone control the steps. Observed values are gaps and
    dimensionless coordinates (`Body.error_measure`), both affine in the state, and the angles of
    journals whose shape turns, from which the gap reduction by the shape follows.

    Parameters
    ----------
    equations
        Equations of the mechanism.
    """

    def __init__(self, equations: StepEquations):
        system = equations.system
        responses = equations.responses
        rows = []
        constants = []
        for film in system.films:
            observed = np.zeros((len(film.film.observed), system.n))
            observed[:, film.xi] = film.film.observed
            rows.append(observed)
            constants.append(film.film.clearance + film.film.shape.fixed)
        self._joints = [film.film for film in system.films]
        self._rough = any(joint.film.parameters.surfaces is not None for joint in self._joints)
        self._films = consecutive(0, [len(r) for r in rows])
        self._gaps = self._films[-1].stop if rows else 0
        self._responses = responses
        self._measure = system.error_measure
        angles = self._turning_angles(system.films, system.n)
        self._rows = np.vstack([*rows, self._measure, *angles])
        self._constant = np.concatenate([*constants, np.zeros(len(self._measure) + len(angles))])

    def _turning_angles(self, films: Sequence[FilmBinding], size: int) -> list[np.ndarray]:
        """Rows of the angles of journals whose shape turns, and the gaps that follow from each."""
        self._turning: list[tuple[slice, int, float, JointShape]] = []
        angles: list[np.ndarray] = []
        for indices, film in zip(self._films, films, strict=True):
            shape = film.film.shape
            if shape.turning:
                row = self._gaps + len(self._measure) + len(angles)
                self._turning.append((indices, row, film.relative_angle(np.zeros(size)), shape))
                angles.append(np.zeros((1, size)))
                angles[-1][0, film.turning] = film.signs
        return angles

    def observe(self, x: np.ndarray) -> np.ndarray:
        """Observed gaps [m], dimensionless coordinates and angles of a state ``(z, y, ...)``."""
        observed = self._constant + self._rows @ x[: self._rows.shape[1]]
        if self._responses.size:
            observed[: self._gaps] += self._responses.observed(x[self._responses.indices])
        return observed

    def gaps(self, observed: np.ndarray) -> np.ndarray:
        """Gaps, with the shapes of turning journals, of observed values [m]."""
        gaps = observed[: self._gaps]
        if self._turning:
            gaps = gaps.copy()
            for indices, angle, mounted, shape in self._turning:
                gaps[indices] -= shape.gap_reduction(observed[angle] + mounted)
        return gaps

    def lengths(self, gaps: np.ndarray) -> np.ndarray:
        """Reference lengths of gap changes [m]: the gaps themselves between smooth surfaces."""
        if not self._rough:
            return gaps
        each = zip(self._joints, self._films, strict=True)
        return np.concatenate([joint.lengths(gaps[indices]) for joint, indices in each])

    def gap_reduction(self, before: np.ndarray, after: np.ndarray) -> float:
        """Largest relative reduction of a gap; -inf without gaps."""
        return float(((before - after) / self.lengths(before)).max(initial=-np.inf))

    def film_gaps(self, observed: np.ndarray) -> list[np.ndarray]:
        """Gap of every film, where gaps are observed [m]."""
        gaps = self.gaps(observed)
        return [gaps[indices] for indices in self._films]

    def error_norm(self, observed: np.ndarray, error: np.ndarray) -> float:
        """Largest error of observed values, see `Observed`."""
        measured = error[self._gaps : self._gaps + len(self._measure)]
        coordinates = float(np.abs(measured).max(initial=0.0))
        if not self._gaps:
            return coordinates
        gaps = self.gaps(observed)
        change = gaps - self.gaps(observed - error) if self._turning else self.gaps(error)
        lengths = self.lengths(gaps)
        # Newton's method keeps h > 0 at the films' Gauss points only, not at the nodes.
        if not lengths.min() > 0.0:
            return np.inf
        return max(float(np.max(np.abs(change) / lengths)), coordinates)

    def coordinate_error(self, change: np.ndarray) -> float:
        """Largest dimensionless change of coordinates z, shape (n,)."""
        return float(np.abs(self._measure @ change).max(initial=0.0))
