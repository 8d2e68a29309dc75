"""What pictures are drawn of: the last cycle of runs, joint by joint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fenics_ehd.base.errors import InputError
from fenics_ehd.base.output import ERROR_BUDGET
from fenics_ehd.base.sealed_file import named
from fenics_ehd.base.text_file import read_json
from fenics_ehd.film.grid import FilmGrid
from fenics_ehd.film.shear import in_supply
from fenics_ehd.multibody.crank_angle import WHOLE
from fenics_ehd.multibody.joint_contact import joint_contact
from fenics_ehd.multibody.result import FilmResult, Result, last_whole_cycle
from fenics_ehd.plotting.recorded import recorded
from fenics_ehd.results.load import load_results

#: Columns that a cycle is drawn over: the crank's angle, or time in a mechanism without any.
ANGLE, TIME = "crank_angle_deg", "time_s"

#: Column of kinetic and strain energy, less those at the start.
STORED = "stored_energy_J"

#: What the error budget of a run has of each component.
BUDGET = (
    "time_s",
    "max_pressure_Pa",
    "min_film_thickness_m",
    "more_max_pressure_Pa",
    "more_min_film_thickness_m",
)


@dataclass(frozen=True, eq=False)
class ShownFilm:
    """A film over the steps of a cycle.

    Attributes
    ----------
    grid
        Its mesh.
    clearance
        [m]
    pressure, gap
        At the nodes, shape (t, k) [Pa], [m].
    contact
        Contact pressure there, None between smooth surfaces.
    """

    grid: FilmGrid
    clearance: float
    pressure: np.ndarray
    gap: np.ndarray
    contact: np.ndarray | None


class ShownRun:
    """The last cycle of a run, from its start on.

    Parameters
    ----------
    name
        In legends.
    directory
        Of it.

    Attributes
    ----------
    cycle
        Its steps, and one at its start if that is not the start of the run.
    time, angle
        Of its steps [s], and of the crank [degrees], 0 where nothing turns.
    starts
        Whether it is that of an initial value problem from its start on.
    figures
        Of joints in the summary, as far as they are of that cycle.
    told
        What is to be said of a cycle that is not a full one, else nothing.

    Raises
    ------
    InputError
        It holds no history.
    """

    def __init__(self, name: str, directory: str | Path):
        self.name, self.directory = name, Path(directory)
        result = load_results(directory)
        self.figures: Mapping[str, Mapping[str, Any]] = result.figures
        used = result.cycle_used
        # Over its first cycle a search builds up its films as any other run does at its start.
        repeated = bool(result.run.get("cycle", np.ones(1))[-1] > 1)
        self.told = "" if repeated or used.startswith("last") else used
        self._start = 0.0 if "cycle" in result.run else result.cycle_start
        self.starts = self._start <= 0.0 and not repeated
        start = self._start
        if repeated:
            clock = np.asarray(result.run["cycle_time"])
            rows = last_whole_cycle(np.asarray(result.run["cycle"]), clock)
            result = result.each(lambda values: values[: rows.stop])
            start = float(result.time[rows.start] - clock[rows.start])
        self._from(result, start)

    def _from(self, result: Result, start: float) -> None:
        """Begin at a time between two steps [s]."""
        time = np.asarray(result.time)
        first = int(np.searchsorted(time, start, side="right"))
        share = (start - time[first - 1]) / (time[first] - time[first - 1]) if first else 0.0

        def cut(values: np.ndarray) -> np.ndarray:
            if not first:
                return values
            between = (1 - share) * values[first - 1] + share * values[first]
            return np.concatenate([between[None], values[first:]])

        self.cycle = result.each(cut)
        self.time = np.asarray(self.cycle.time) - start
        angle = _crank_angle(self.cycle)
        # The end of the cycle before is that many turns ahead.
        angle[:1] -= 360.0 * np.round((angle[:1] - angle[1:2]) / 360.0)
        self.angle = angle - 360.0 * np.floor(angle.min() / 360.0 + WHOLE)

    @cached_property
    def joints(self) -> dict[str, ShownJoint]:
        """Its lubricated joints by name."""
        return {
            name: ShownJoint(self, name, joint.columns | self._cycle_columns | self._errors(name))
            for name, joint in self.cycle.joints.items()
        }

    @property
    def whole(self) -> ShownJoint:
        """Itself, its energies too: works since the first step."""
        columns = self.cycle.run.columns
        stored = columns["kinetic_energy_J"] + columns["strain_energy_J"]
        return ShownJoint(self, "", columns | self._cycle_columns | {STORED: stored - stored[0]})

    @property
    def _cycle_columns(self) -> dict[str, np.ndarray]:
        """What curves are drawn over."""
        return {TIME: self.time} | ({ANGLE: self.angle} if np.ptp(self.angle) else {})

    def _errors(self, joint: str) -> dict[str, np.ndarray]:
        """Relative errors by component of the run's error budget, empty without it."""
        path = self.directory / ERROR_BUDGET
        if not path.is_file():
            return {}
        found = {}
        with named(InputError, f"{path}: not the error budget of a run"):
            for component, over in read_json(path).get(joint, {}).items():
                time, pressure, film, more_pressure, more_film = (np.array(over[k]) for k in BUDGET)
                for name, error in (
                    ("pressure_error", more_pressure / pressure.max()),
                    ("film_error", more_film / film),
                ):
                    found[f"{component}.{name}"] = np.interp(
                        self._start + self.time, time, error, left=np.nan
                    )
        return found

    def contact_pressure(self, joint: str, gap: np.ndarray) -> np.ndarray | None:
        """Of nominal gaps at the nodes of a film, None between smooth surfaces [Pa]."""
        if "contact_force" not in self.cycle.joints[joint]:
            return None
        films = recorded(self.directory, self.cycle).system.films
        place = next(place for place in films if place.name == joint)
        contact = joint_contact(place)
        assert contact is not None
        deep = in_supply(place.film.film, *place.film.film.parameters.grid.node_positions.T)
        return np.where(deep, 0.0, contact.surfaces.asperities.touch(gap).pressure)


@dataclass(frozen=True, eq=False)
class ShownJoint:
    """A lubricated joint of a run, or a run as a whole, without a name.

    Attributes
    ----------
    run, name
        Which.
    columns
        Of its history over the cycle.
    """

    run: ShownRun
    name: str
    columns: Mapping[str, np.ndarray]

    @cached_property
    def film(self) -> ShownFilm:
        """Fields of its film."""
        film = self.run.cycle.joints[self.name].film
        gap = np.asarray(film.gap)
        return ShownFilm(
            _grid(film),
            film.clearance,
            np.asarray(film.pressure),
            gap,
            self.run.contact_pressure(self.name, gap),
        )


def _crank_angle(result: Result) -> np.ndarray:
    """At all steps [degrees]."""
    return np.array(result.run.get("crank_angle", np.zeros(len(result))))


def _grid(film: FilmResult) -> FilmGrid:
    """The mesh, whose cells begin with their corner of the first angle and height."""
    corners = film.cells[:, :4]
    angles = np.unique(np.asarray(film.angle)[corners[:, 0]])
    heights = np.unique(np.asarray(film.height)[corners])
    return FilmGrid(film.radius, np.append(angles, angles[0] + 2 * np.pi), heights, film.family)
