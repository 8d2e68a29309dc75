"""Runs of the slider-crank with their curves, and rods reduced once for each material."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time

import attrs
import numpy as np
from mpi4py import MPI
from nested_film import NestedFilm
from scipy.interpolate import PchipInterpolator

from fenics_ehd.errors import EhdError
from fenics_ehd.multibody.bdf import integrate
from fenics_ehd.reduction import ReducedBody, Structure, load_body, save_body
from fenics_ehd.scenes.rod import build_structure, origin, reduce_structure
from fenics_ehd.scenes.run import (
    Totals,
    build_mechanism,
    initial_state,
    simulate,
    simulated_time,
    step_control,
)
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings

#: The first film build-up, from no pressure at all, is left out of comparisons: this share of the
#: simulated time, and no more crank angle than this [rad].
START_SHARE, START_ANGLE = 0.1, 0.1

#: Steps of a run for which it is given up as one that does not advance.
MOST_STEPS = 40_000

#: Makes the body of a case from the part.
Reducer = Callable[[Structure], ReducedBody]


def changed(settings: SliderCrankSettings, **values: object) -> SliderCrankSettings:
    """Settings with other values, named ``section__key``."""
    for name, value in values.items():
        section, key = name.split("__")
        part = attrs.evolve(getattr(settings, section), **{key: value})
        settings = attrs.evolve(settings, **{section: part})
    return settings


@dataclass(frozen=True, eq=False)
class Run:
    """Curves of a run.

    Attributes
    ----------
    times, pressure, film
        Of every step: time [s], peak pressure [Pa], thinnest film [m].
    columns
        Everything else that its history has, by name.
    totals
        Figures.
    error
        What ended it early, or None.
    seconds
        Processor time.
    """

    times: np.ndarray
    pressure: np.ndarray
    film: np.ndarray
    columns: dict[str, np.ndarray]
    totals: Totals
    error: EhdError | None
    seconds: float

    @property
    def eccentricity(self) -> np.ndarray:
        """In the rod's frame, shape (2, steps) [m]."""
        return np.stack([self.columns[f"eccentricity_{axis}_m"] for axis in "xy"])

    def at(self, name: str, times: np.ndarray) -> np.ndarray:
        """A column of the history at other times."""
        return PchipInterpolator(self.times, self.columns[name])(times)

    @classmethod
    def of(cls, rows: list[dict], totals: Totals, error: EhdError | None, began: float) -> Run:
        """Curves from rows of the history."""
        columns = {name: np.array([row[name] for row in rows]) for name in (rows or [{}])[0]}
        names = "time_s", "max_pressure_Pa", "min_film_thickness_m"
        curves = (columns.get(name, np.empty(0)) for name in names)
        return cls(*curves, columns, totals, error, process_time() - began)


def difference(run: Run, reference: Run, settings: SliderCrankSettings) -> tuple[float, float]:
    """Of peak pressure over its peak and of film thickness, pointwise, at the run's own steps."""
    begin = min(START_SHARE * run.times[-1], START_ANGLE / settings.mechanism.crank_speed)
    end = min(run.times[-1], reference.times[-1])
    own = (run.times >= begin) & (run.times <= end)
    times = run.times[own]
    pressure = PchipInterpolator(reference.times, reference.pressure)(times)
    film = PchipInterpolator(reference.times, reference.film)(times)
    return (
        float(np.abs(run.pressure[own] - pressure).max() / pressure.max()),
        float(np.abs(run.film[own] / film - 1).max()),
    )


class Workshop:
    """Runs scenes, and keeps bodies and runs that are asked for again.

    Parameters
    ----------
    folder
        For reduced bodies and tables; None: a temporary one, gone with the workshop.
    """

    def __init__(self, folder: Path | None = None):
        self._temporary = tempfile.TemporaryDirectory() if folder is None else None
        self.folder = Path(self._temporary.name) if self._temporary else folder
        self._structures: dict[str, Structure] = {}
        self._runs: dict[tuple, Run] = {}

    def structure(self, settings: SliderCrankSettings) -> Structure:
        """The part, meshed and assembled once for each material."""
        key = repr((settings.rod.youngs_modulus, settings.film.element))
        if key not in self._structures:
            self._structures[key] = build_structure(settings, MPI.COMM_SELF)
        return self._structures[key]

    def body(self, settings: SliderCrankSettings, reducer: Reducer | None = None) -> ReducedBody:
        """Reduced rod of a scene, or what `reducer` makes of it."""
        if reducer is not None:
            return reducer(self.structure(settings))
        path = self.folder / f"{abs(hash(repr(sorted(origin(settings).items()))))}.h5"
        if not path.exists():
            body = reduce_structure(self.structure(settings), settings.reduction)
            save_body(replace(body, columns=None), path)
        return load_body(path)

    def run(self, settings: SliderCrankSettings, reducer: Reducer | None = None) -> Run:
        """Run a scene; an error of ours that ends it is part of the result."""
        key = repr(settings), reducer
        if key not in self._runs:
            body = self.body(settings, reducer)
            rows: list[dict] = []
            totals, error, began = Totals(), None, process_time()
            try:
                simulate(settings, body, totals, lambda row, _: rows.append(_counted(row, rows)))
            except EhdError as failure:
                error = failure
            self._runs[key] = Run.of(rows, totals, error, began)
        return self._runs[key]

    def nested(self, settings: SliderCrankSettings) -> Run:
        """The same scene with the film solved within every evaluation, by Newton's method."""
        body = self.body(settings)
        machine = build_mechanism(settings, body)
        end = simulated_time(settings)
        nested, start = NestedFilm(machine), initial_state(settings, machine)
        control = step_control(settings, end, body)
        rows: list[dict] = []
        began = process_time()
        for step in integrate(nested, (0.0, end), *start, control):
            row = {
                "time_s": step.time,
                "max_pressure_Pa": step.auxiliary.film.pressure.max(),
                "min_film_thickness_m": step.watched.min(),
            }
            rows.append(_counted(row, rows))
        return Run.of(rows, Totals(), None, began)


class GivenUpError(EhdError):
    """A run takes more steps than any of these should."""


def _counted(row: dict, rows: list[dict]) -> dict:
    if len(rows) >= MOST_STEPS:
        raise GivenUpError(f"{MOST_STEPS} steps led to {row['time_s']:.3g} s only")
    return row
