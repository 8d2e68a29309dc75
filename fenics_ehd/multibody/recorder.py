"""What a run records, step by step, and the result that this makes in memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_ehd.base.columns import Quantity, split_unit
from fenics_ehd.multibody.history_layout import (
    FIELD_UNITS,
    assemble_result,
    beginning,
    field_unit,
    path_of,
)
from fenics_ehd.multibody.periodic import Cycles
from fenics_ehd.multibody.result import Result
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.solver_state import MechanismStep
from fenics_ehd.multibody.system import System
from fenics_ehd.multibody.tracking import FRAME, Tracker

#: A joint's own coordinates, as columns.
JOURNAL = ("eccentricity_x_m", "eccentricity_y_m", "tilt_x_rad", "tilt_y_rad")

#: Unit of the amplitude of an elastic mode: as its basis is scaled.
MODAL = "modal"


@dataclass(frozen=True, eq=False)
class Fixed:
    """What does not change from step to step.

    Attributes
    ----------
    arrays
        Nodes and cells of every film, by path.
    films
        Family, radius [m] and clearance [m] of the film of every lubricated joint.
    names, units
        Of the mechanism's coordinates: ``bodies/rod/x``, ``bodies/rod/mode_1``.
    """

    arrays: Mapping[str, np.ndarray]
    films: Mapping[str, Mapping[str, Any]]
    names: tuple[str, ...]
    units: tuple[str, ...]

    def attributes(self) -> dict[str, dict[str, Any]]:
        """What a file says of its groups and datasets, by path."""
        state = {"names": list(self.names), "units": list(self.units)}
        rates = {**state, "units": [f"{unit}/s" for unit in self.units]}
        found: dict[str, dict[str, Any]] = {"state/coordinates": state, "state/rates": rates}
        for joint, film in self.films.items():
            group = f"joints/{joint}/film"
            found[group] = {**film, "radius_units": "m", "clearance_units": "m"}
            for name in ("angle", "height", "cells", "pressure", "gap", "fluid_fraction"):
                found[f"{group}/{name}"] = {"units": FIELD_UNITS[name]}
        return found | {"state/quasi_static": {"units": FIELD_UNITS["quasi_static"]}}

    @classmethod
    def of(cls, system: System) -> Fixed:
        """Of a mechanism."""
        arrays: dict[str, np.ndarray] = {}
        films = {}
        for place in system.films:
            parameters = place.film.film.parameters
            grid, path = parameters.grid, f"joints/{place.name}/film"
            arrays[f"{path}/angle"], arrays[f"{path}/height"] = grid.node_positions.T
            arrays[f"{path}/cells"] = grid.cell_nodes.astype(np.int32)
            films[place.name] = {
                "family": grid.family,
                "radius": grid.radius,
                "clearance": parameters.clearance,
            }
        names, units = zip(*_coordinates(system), strict=True) if system.n else ((), ())
        return cls(arrays, films, names, units)


def _coordinates(system: System) -> list[tuple[str, str]]:
    """Path and unit of every coordinate of a mechanism."""
    found: list[tuple[str, str]] = []
    for name, body in system.each_name():
        own = system.bodies[name]
        frame = [] if body.angle is None else FRAME[2 - body.angle :]
        found += [split_unit(f"bodies/{name}/{column}") for column in frame]
        modes = own.stop - own.start - len(frame)
        found += [(f"bodies/{name}/mode_{i + 1}", MODAL) for i in range(modes)]
    for place in system.films:
        found += [split_unit(f"joints/{place.name}/{n}") for n in JOURNAL[: place.film.own]]
    return found


def cycle_columns(cycles: Cycles | None, time: float) -> dict[str, float]:
    """Columns of a step of a periodic search; none of another run."""
    if cycles is None:
        return {}
    return {"cycle": cycles.number, "cycle_time_s": time - cycles.start}


def cycle_figures(cycles: Cycles | None) -> dict[str, float]:
    """What the summary has of a periodic search."""
    if cycles is None:
        return {}
    return {"cycles": cycles.number, "periodicity_defect": cycles.defect}


def gathered(rows: Sequence[Mapping[str, Any]]) -> dict[str, np.ndarray]:
    """Columns of rows."""
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


class Recorder:
    """Collects the steps of a run, or of its last cycle.

    Parameters
    ----------
    run
        At its start.

    Attributes
    ----------
    tracker
        What they have shown.
    """

    def __init__(self, run: Run):
        self._fixed = Fixed.of(run.equations.system)
        self.tracker = Tracker(run.equations, run.norm)
        self._rows: list[dict[str, float]] = []
        self._fields: list[dict[str, np.ndarray]] = []

    def add(self, step: MechanismStep, cycles: Cycles | None = None) -> None:
        """Account for an accepted step, of a periodic search in its current cycle."""
        if self.tracker.begins(cycles):
            self._rows, self._fields = [], []
        row, fields = self.tracker.add(step)
        self._rows.append(row | cycle_columns(cycles, step.time))
        # Copies: parts of larger arrays would keep these.
        self._fields.append({path: np.array(values) for path, values in fields.items()})

    def rows(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Columns, and fields by path, of the steps so far or of the last cycle."""
        return gathered(self._rows), gathered(self._fields)

    def result(self, cycles: Cycles | None = None) -> Result:
        """Of the steps so far, or of the last cycle of a search, both its ends."""
        columns, fields = self.rows()
        units = {column: path_of(column, self.tracker.groups) for column in columns}
        rows = {units[column][0]: values.astype(float) for column, values in columns.items()}
        rows |= fields
        if cycles is not None:
            first = beginning(rows, self._fixed.names)
            rows = {path: np.concatenate([[first[path]], found]) for path, found in rows.items()}
        own = dict(units.values())
        values = {
            path: Quantity(array, own.get(path, field_unit(path)))
            for path, array in {**self._fixed.arrays, **rows}.items()
        }
        figures = self.tracker.figures(self.tracker.answer(columns))
        figures |= cycle_figures(cycles)
        summary = {"status": self.tracker.verdict(), **figures}
        return assemble_result(values, self._fixed.names, self._fixed.films, summary)
