"""Curves of two runs compared: their largest and their mean difference.

A run is compared at its own steps: its curves of extremes have kinks between them, where the
extreme moves from one place to the next, that no interpolation meets. The other run, with many
more steps, is interpolated point by point before its extremes are taken.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import attrs
import numpy as np
from scipy.integrate import trapezoid
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from fenics_ehd.errors import InputError
from fenics_ehd.film.layout import match
from fenics_ehd.history_file import read_fields, read_history
from fenics_ehd.multibody.journal import Journal
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.scenes import rotor_run
from fenics_ehd.scenes import run as slider_crank_run

#: What puts the parts of each scene together.
BUILD: Mapping[str, Callable[..., Any]] = {
    "slider-crank": slider_crank_run.build_mechanism,
    "rotor": rotor_run.build_mechanism,
}

#: Steps whose gap is made at once.
BLOCK = 256


@dataclass(frozen=True)
class Errors:
    """Differences of two runs.

    Attributes
    ----------
    pressure_max, pressure_l2
        Of the curves of the peak pressure: largest, over the largest peak; and root mean square
        over time, over that of the curve.
    film_max, film_l2
        Of the curves of the minimum film thickness: largest relative one; and root mean square,
        over that of the curve.
    gap
        Largest difference of the gap anywhere in the bearing [m].
    """

    pressure_max: float
    pressure_l2: float
    film_max: float
    film_l2: float
    gap: float

    def relative(self) -> dict[str, float]:
        """All but the last, by name."""
        names = ("pressure_max", "pressure_l2", "film_max", "film_l2")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True, eq=False)
class Differences:
    """Differences of two runs at the steps of one of them.

    Attributes
    ----------
    time
        Its steps, shape (n,) [s].
    pressure
        Of the curves of the peak pressure, over the largest peak, shape (n,).
    film
        Of the curves of the minimum film thickness, relative, shape (n,).
    errors
        What they amount to.
    """

    time: np.ndarray
    pressure: np.ndarray
    film: np.ndarray
    errors: Errors


class RunCurves:
    """Curves and fields of a run on disk.

    Parameters
    ----------
    directory
        With ``history.csv`` and ``history.h5``.
    settings, body
        Of the run.
    """

    def __init__(self, directory: Path, settings: Any, body: ReducedBody):
        self.settings, self.directory, self._body = settings, directory, body
        history = read_history(directory)
        self.times = history["time_s"]
        self.pressure = history["max_pressure_Pa"]
        self.film = history["min_film_thickness_m"]

    def prepare(self, start: float) -> Self:
        """Read what a comparison from `start` [s] on needs: damage is found before it begins.

        Raises
        ------
        InputError
            A file cannot be read, or there is hardly a step after the start.
        """
        self._require_steps(start)
        _ = self.states
        return self

    def _require_steps(self, start: float) -> None:
        if np.count_nonzero(self.times >= start) < 2:
            raise InputError(f"{self.directory}: fewer than two steps after {start:g} s")

    def journal(self, film: Any) -> Journal:
        """Shaft and bore, the gap watched where a film of these settings does."""
        settings = attrs.evolve(self.settings, film=film)
        return BUILD[settings.scene](settings, self._body).journal

    @cached_property
    def states(self) -> np.ndarray:
        """Coordinates and residual amplitudes at every step, shape (steps, n)."""
        found = self._fields("coordinates", *self._residual)
        return np.hstack([found[name] for name in ("coordinates", *self._residual)])

    @property
    def _residual(self) -> tuple[str, ...]:
        residual = self._body.residual
        return ("quasi_static",) if residual is not None and residual.rank else ()

    def _fields(self, *names: str) -> Mapping[str, np.ndarray]:
        return read_fields(self.directory, names)


class Reference(RunCurves):
    """A run that others are compared with."""

    def prepare(self, start: float) -> Self:
        """Read what comparisons from `start` [s] on need, see `RunCurves.prepare`."""
        self._require_steps(start)
        _ = self._states, self._pressures
        return self

    @cached_property
    def _journal(self) -> Journal:
        return self.journal(self.settings.film)

    @cached_property
    def _states(self) -> tuple[CubicHermiteSpline, PchipInterpolator | None]:
        found = self._fields("coordinates", "rates", *self._residual)
        coordinates = CubicHermiteSpline(self.times, found["coordinates"], found["rates"])
        if not self._residual:
            return coordinates, None
        return coordinates, PchipInterpolator(self.times, found["quasi_static"])

    @cached_property
    def _pressures(self) -> PchipInterpolator:
        """Of nodal pressures; of their maximum where the body has other nodes than the film."""
        if not self._nodal:
            return PchipInterpolator(self.times, self.pressure[:, None])
        return PchipInterpolator(self.times, self._fields("pressure_Pa")["pressure_Pa"])

    @cached_property
    def _nodal(self) -> bool:
        """Whether its history holds the film's own nodal pressures."""
        grid = self._journal.film.parameters.grid
        return match(self._body.pressure_nodes, grid.nodes) is not None

    def interpolation_error(self, start: float) -> float:
        """Error of the peak pressure between its steps, over the largest peak; 0 if negligible.

        Where only the curve of the maximum is known it has kinks that no interpolation meets.
        Each second step is left out and interpolated from the others, then the rest of them. The
        error of a kink grows with the step, so that this is rather more than the error looked for:
        1.4 to 3 times on the default machines, whose true curve is known.
        """
        if self._nodal:
            return 0.0
        error = np.zeros_like(self.pressure)
        for first in (0, 1):
            kept = slice(first, None, 2)
            without = PchipInterpolator(self.times[kept], self.pressure[kept], extrapolate=False)
            left_out = np.abs(without(self.times) - self.pressure)
            error = np.fmax(error, left_out)
        return float(error[self.times >= start].max() / self._peak(start))

    def _gaps(self, times: np.ndarray) -> np.ndarray:
        """Gap at every watched point [m], shape (len(times), points)."""
        coordinates, residual = self._states
        states = coordinates(times)
        if residual is not None:
            states = np.hstack([states, residual(times)])
        return self._journal.gap(states.T).T

    def errors(self, run: RunCurves, start: float) -> Errors:
        """Of a run, see `differences`."""
        return self.differences(run, start).errors

    def differences(self, run: RunCurves, start: float) -> Differences:
        """Of a run at its own steps from `start` [s] on.

        Raises
        ------
        InputError
            A history is missing, or has hardly a step after the start.
        """
        inside = (run.times >= start) & (run.times <= self.times[-1])
        times, pressure, film = run.times[inside], run.pressure[inside], run.film[inside]
        if len(times) < 2:
            raise InputError(f"{run.directory}: fewer than two steps after {start:g} s")
        exact_pressure = self._pressures(times).max(axis=1)
        exact_film, gap = self._film_and_gap(run, times, run.states[inside])
        off_pressure = (pressure - exact_pressure) / self._peak(start)
        off_film = film / exact_film - 1
        errors = Errors(
            float(np.abs(off_pressure).max()),
            _mean(times, pressure - exact_pressure) / _mean(times, exact_pressure),
            float(np.abs(off_film).max()),
            _mean(times, film - exact_film) / _mean(times, exact_film),
            gap,
        )
        return Differences(times, off_pressure, off_film, errors)

    def _peak(self, start: float) -> float:
        return float(self.pressure[self.times >= start].max())

    def _film_and_gap(
        self, run: RunCurves, times: np.ndarray, states: np.ndarray
    ) -> tuple[np.ndarray, float]:
        """Minimum film thickness of the reference at a run's steps [m], shape (n,).

        With it the largest difference of the gap of both, anywhere [m].
        """
        journal, film, largest = run.journal(self.settings.film), [], 0.0
        for first in range(0, len(times), BLOCK):
            block = slice(first, first + BLOCK)
            exact = self._gaps(times[block])
            film.append(exact.min(axis=1))
            largest = max(largest, float(np.abs(journal.gap(states[block].T).T - exact).max()))
        return np.concatenate(film), largest


def _mean(times: np.ndarray, values: np.ndarray) -> float:
    """Root mean square over time."""
    return float(np.sqrt(trapezoid(values**2, times) / (times[-1] - times[0])))
