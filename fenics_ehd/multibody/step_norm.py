"""Norm of errors for the step control: relative errors of gaps, and errors of coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.mechanism import consecutive
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.multibody.surface import Surface


class StepNorm:
    """Norm of errors in a mechanism: the largest of relative gap errors and coordinate errors.

    Without films, only coordinates control the steps. Observed values are gaps, dimensionless
    coordinates (`Body.error_measure`), and the coordinates ``(q, alpha)`` of turning surfaces; all
    are affine in the state. Gap changes due to turning surfaces are computed from ``(q, alpha)``.

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
            constants.append(film.film.clearance + film.film.deviation)
        self._joints = [film.film for film in system.films]
        self._rough = any(joint.film.parameters.surfaces is not None for joint in self._joints)
        self._films = consecutive(0, [len(r) for r in rows])
        self._gaps = self._films[-1].stop if rows else 0
        self._responses = responses
        self._measure = system.error_measure
        turning = self._turning_coordinates(system.films, system.n)
        self._rows = np.vstack([*rows, self._measure, turning])
        self._constant = np.concatenate([*constants, np.zeros(len(self._measure) + len(turning))])

    def _turning_coordinates(self, films: Sequence[FilmBinding], size: int) -> np.ndarray:
        """Rows that select the coordinates of all turning surfaces from a state.

        The method also sets `_turning`: for every turning surface, the indices of its gaps and of
        its coordinates among the observed values, the values of its coordinates if the state is
        zero, and the surface.
        """
        self._turning: list[tuple[slice, slice, np.ndarray, Surface]] = []
        rows = [np.zeros((0, size))]
        last = self._gaps + len(self._measure)
        for indices, film in zip(self._films, films, strict=True):
            surface = film.film.turning
            if surface is not None:
                selection = np.zeros((len(film.turning_map), size))
                selection[:, film.turning_dofs] = film.turning_map
                rows.append(selection)
                first = last
                last += len(selection)
                mounted = film.turning_coordinates(np.zeros(size))
                self._turning.append((indices, slice(first, last), mounted, surface))
        return np.vstack(rows)

    def observe(self, x: np.ndarray) -> np.ndarray:
        """Observed values of a state ``(z, y, ...)``: gaps [m], then coordinates.

        Gaps do not contain the changes by turning surfaces, see `gaps`. Coordinates are those of
        bodies in the units of their error measure, followed by those of turning surfaces.
        """
        observed = self._constant + self._rows @ x[: self._rows.shape[1]]
        if self._responses.size:
            observed[: self._gaps] += self._responses.observed(x[self._responses.indices])
        return observed

    def gaps(self, observed: np.ndarray) -> np.ndarray:
        """Gaps of all films, with turning surfaces, from observed values [m]."""
        gaps = observed[: self._gaps]
        if self._turning:
            gaps = gaps.copy()
            for indices, rows, mounted, surface in self._turning:
                gaps[indices] += surface.gap_change(observed[rows] + mounted)
        return gaps

    def lengths(self, gaps: np.ndarray) -> np.ndarray:
        """Divisors [m] that make gap changes relative, see `JointFilm.lengths`."""
        if not self._rough:
            return gaps
        each = zip(self._joints, self._films, strict=True)
        return np.concatenate([joint.lengths(gaps[indices]) for joint, indices in each])

    def gap_reduction(self, before: np.ndarray, after: np.ndarray) -> float:
        """Largest relative reduction of a gap between two sets of gaps [m]; -inf without gaps."""
        return float(((before - after) / self.lengths(before)).max(initial=-np.inf))

    def film_gaps(self, observed: np.ndarray) -> list[np.ndarray]:
        """Gap of every film at the points where gaps are observed [m], from observed values."""
        gaps = self.gaps(observed)
        return [gaps[indices] for indices in self._films]

    def error_norm(self, observed: np.ndarray, error: np.ndarray) -> float:
        """Largest relative error of observed values, see `Observed.error_norm`."""
        measured = error[self._gaps : self._gaps + len(self._measure)]
        coordinates = float(np.abs(measured).max(initial=0.0))
        if not self._gaps:
            return coordinates
        gaps = self.gaps(observed)
        change = gaps - self.gaps(observed - error) if self._turning else self.gaps(error)
        lengths = self.lengths(gaps)
        # Newton's method keeps h > 0 at the Gauss points of films, but not at the nodes.
        if not lengths.min() > 0.0:
            return np.inf
        return max(float(np.max(np.abs(change) / lengths)), coordinates)

    def coordinate_error(self, change: np.ndarray) -> float:
        """Largest dimensionless error that belongs to a change of the coordinates z, (n,)."""
        return float(np.abs(self._measure @ change).max(initial=0.0))
