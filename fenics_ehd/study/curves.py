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
from typing import Any

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
        grid = self._journal.film.parameters.grid
        if match(self._body.pressure_nodes, grid.nodes) is None:
            return PchipInterpolator(self.times, self.pressure[:, None])
        return PchipInterpolator(self.times, self._fields("pressure_Pa")["pressure_Pa"])

    def _gaps(self, times: np.ndarray) -> np.ndarray:
        """Gap at every watched point [m], shape (len(times), points)."""
        coordinates, residual = self._states
        states = coordinates(times)
        if residual is not None:
            states = np.hstack([states, residual(times)])
        return self._journal.gap(states.T).T

    def errors(self, run: RunCurves, start: float) -> Errors:
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
        return Errors(
            float(np.abs(pressure - exact_pressure).max() / self._peak(start)),
            _mean(times, pressure - exact_pressure) / _mean(times, exact_pressure),
            float(np.abs(film / exact_film - 1).max()),
            _mean(times, film - exact_film) / _mean(times, exact_film),
            gap,
        )

    def _peak(self, start: float) -> float:
        return float(self.pressure[self.times >= start].max())

    def _film_and_gap(
        self, run: RunCurves, times: np.ndarray, states: np.ndarray
    ) -> tuple[np.ndarray, float]:
        """Minimum film thickness of this run, and the largest difference of the gap [m]."""
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
