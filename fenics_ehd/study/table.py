"""``table.csv``: one row for every run of a study, in each group that it belongs to."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenics_ehd.errors import InputError
from fenics_ehd.film.layout import film_layout
from fenics_ehd.output import write_whole
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.scenes.film_mesh import DEFAULT_CELLS
from fenics_ehd.scenes.part import METHOD_KEYS
from fenics_ehd.study.plan import Row, StudyRun
from fenics_ehd.sweeps.values import as_text
from fenics_ehd.sweeps.work import PROCESSOR_SECONDS

if TYPE_CHECKING:
    from fenics_ehd.study.compare import Comparison
    from fenics_ehd.study.curves import Errors

#: Columns of settings, of errors, and of figures of the run.
ABOUT = (
    "run",
    "group",
    "method",
    "pressure_set",
    "selection",
    "vibration_modes",
    "residual_modes",
    "interior_modes",
    "film_cells",
    "tolerance",
    "order",
    "status",
    "coordinates",
)
ERRORS = ("pressure_error_max", "pressure_error_l2", "film_error_max", "film_error_l2")
FLOORS = ("pressure_floor", "film_floor")
FIGURES = {
    "steps": "steps",
    "rejected_steps": "rejected_steps",
    "newton_iterations": "newton_iterations",
    "max_pressure_Pa": "max_pressure_Pa",
    "min_film_thickness_m": "min_film_thickness_m",
    "online_wall_s": "wall_time_s",
}
OWN = tuple(f"own_{name}" for name in ERRORS)

COLUMNS = (
    *ABOUT,
    *ERRORS,
    *FLOORS,
    "offline_s",
    "online_s",
    "steps",
    "rejected_steps",
    "newton_iterations",
    "highest_frequency_Hz",
    "estimated_gap_error_m",
    "true_gap_error_m",
    "max_pressure_Pa",
    "min_film_thickness_m",
    "against",
    *OWN,
    "residual_truncation",
    "body",
    "online_wall_s",
)

#: Columns that hold text.
TEXTS = (
    "run",
    "group",
    "method",
    "pressure_set",
    "selection",
    "film_cells",
    "status",
    "against",
    "body",
)


def cells_of(settings: Any, body: ReducedBody) -> tuple[int, ...]:
    """Cells of a run's film, around and along."""
    if settings.film.cells:
        return tuple(settings.film.cells)
    unstructured = body.pressure_family == "triangle"
    return DEFAULT_CELLS if unstructured else film_layout(body.pressure_nodes)[0]


def film_cells(settings: Any, body: ReducedBody) -> str:
    """Cells around and along, ``"20x5"``."""
    return "x".join(map(str, cells_of(settings, body)))


class TableRows:
    """Makes the rows of a study's table.

    Parameters
    ----------
    comparison
        Its results.
    """

    def __init__(self, comparison: Comparison):
        self._comparison = comparison

    def row(self, row: Row, run: StudyRun) -> dict[str, Any]:
        """One row; what is not known is None, of a run that has not ended all but its settings."""
        outcome = self._comparison.outcome(run.name)
        values: dict[str, Any] = dict.fromkeys(COLUMNS)
        values |= {"run": run.name, "group": row.group, "against": row.against or None}
        values |= _settings(run) | {"body": run.body}
        values["status"] = outcome.status if outcome else "not run"
        body = self._comparison.body(run.name)
        if outcome is None or body is None:
            return values
        values |= {
            "film_cells": film_cells(run.case.settings, body),
            "coordinates": body.modes,
            "highest_frequency_Hz": float(body.frequencies.max(initial=0.0)),
            "offline_s": float(body.provenance.get(PROCESSOR_SECONDS, math.nan)),
            "online_s": outcome.figures.get("processor_time_s"),
        }
        values |= {column: outcome.figures.get(name) for column, name in FIGURES.items()}
        values["estimated_gap_error_m"] = self._comparison.estimate(run.name)
        errors = self._comparison.errors(run.name, row.against) if row.against else None
        values |= zip(ERRORS, _relative(errors), strict=True)
        values["true_gap_error_m"] = errors.gap if errors else None
        own = self._comparison.errors(run.name, row.own) if row.own else None
        values |= zip(OWN, _relative(own), strict=True)
        values |= zip(FLOORS, self._comparison.floor(row), strict=True)
        return {name: _known(value) for name, value in values.items()}


def _settings(run: StudyRun) -> dict[str, Any]:
    """Columns that the settings alone fill; of [reduction] what the method reads."""
    settings = run.case.settings
    reduction, time = settings.reduction, settings.time
    values = {"method": reduction.method, "tolerance": time.tolerance, "order": time.order}
    for name in METHOD_KEYS[reduction.method]:
        values["vibration_modes" if name == "modes" else name] = getattr(reduction, name)
    values.pop("snapshots", None)
    if settings.film.cells:
        values["film_cells"] = "x".join(map(str, settings.film.cells))
    return values


def _relative(errors: Errors | None) -> tuple[float | None, ...]:
    return tuple(errors.relative().values()) if errors else (None,) * len(ERRORS)


def write_table(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write the rows, whole or not at all; what is not known is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows:
        writer.writerow(["" if row[name] is None else as_text(row[name]) for name in COLUMNS])
    write_whole(path, text.getvalue())


def _known(value: Any) -> Any:
    """The value, None for a number that is not finite."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def read_table(path: Path) -> list[dict[str, Any]]:
    """Rows of a table, numbers as numbers, None where a cell is empty.

    Raises
    ------
    InputError
        There is no such file, or it is no table of a study.
    """
    try:
        with open(path, newline="") as file:
            rows = list(csv.DictReader(file))
        if rows and tuple(rows[0]) != COLUMNS:
            raise ValueError("its columns are others")
        return [{name: _value(name, cell) for name, cell in row.items()} for row in rows]
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not the table of a study ({error})") from None


def _value(name: str, cell: str) -> Any:
    if not cell:
        return None
    return cell if name in TEXTS else json.loads(cell)
