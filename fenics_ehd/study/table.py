"""``table.csv``: a row for every run of a study and lubricated joint, in each of its groups."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from fenics_ehd.base.output import write_whole
from fenics_ehd.scenes.part import METHOD_KEYS
from fenics_ehd.study.case import Case
from fenics_ehd.study.compare import Comparison
from fenics_ehd.study.curves import Errors
from fenics_ehd.study.plan import Row
from fenics_ehd.study.values import as_text

#: Columns of settings, of errors, and of figures of the run.
ABOUT = (
    "run",
    "group",
    "joint",
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
STEPS = ("steps", "rejected_steps", "newton_iterations")
EXTREMES = ("max_pressure_Pa", "min_film_thickness_m")
FIGURES = ("coordinates", "offline_s", "highest_frequency_Hz", *STEPS, *EXTREMES)
OWN = tuple(f"own_{name}" for name in ERRORS)

COLUMNS = (
    *ABOUT,
    *ERRORS,
    *FLOORS,
    "offline_s",
    "online_s",
    *STEPS,
    "highest_frequency_Hz",
    "estimated_gap_error_m",
    "true_gap_error_m",
    *EXTREMES,
    "against",
    *OWN,
    "residual_truncation",
    "body",
    "online_wall_s",
)


def table_row(row: Row, joint: str, case: Case, comparison: Comparison) -> dict[str, Any]:
    """One row; what is not known is None, of a run that has not ended all but its settings."""
    outcome = comparison.outcome(row.run)
    values: dict[str, Any] = dict.fromkeys(COLUMNS)
    values |= {"run": row.run, "group": row.group, "joint": joint, "against": row.against or None}
    values |= _settings(case, joint)
    values["status"] = outcome.status if outcome else "not run"
    if outcome is None or not outcome.complete:
        return values
    figures = {**outcome.figures, **outcome.figures.get("joints", {}).get(joint, {})}
    values |= {name: figures[name] for name in FIGURES}
    values |= {
        "film_cells": figures["film_cells"][joint],
        "online_s": figures["processor_time_s"],
        "online_wall_s": figures["wall_time_s"],
        "estimated_gap_error_m": comparison.estimates(row.run).get(joint),
    }
    errors = _errors(comparison, row.run, row.against, joint)
    values |= zip(ERRORS, _relative(errors), strict=True)
    values["true_gap_error_m"] = errors.gap if errors else None
    values |= zip(OWN, _relative(_errors(comparison, row.run, row.own, joint)), strict=True)
    values |= zip(FLOORS, comparison.floor(row, joint), strict=True)
    return {name: _known(value) for name, value in values.items()}


def _settings(case: Case, joint: str) -> dict[str, Any]:
    """Columns that the settings alone fill; of a reduction what the method reads."""
    reduction = next(iter(case.bodies.values())).settings.reduction
    time, cells = case.scene.time, case.scene.joints[joint].cells
    values = {"method": reduction.method, "tolerance": time.tolerance, "order": time.order}
    for name in METHOD_KEYS[reduction.method]:
        values["vibration_modes" if name == "modes" else name] = getattr(reduction, name)
    values.pop("snapshots", None)
    if cells:
        values["film_cells"] = "x".join(map(str, cells))
    return values | {"body": " ".join(body.name for body in case.bodies.values())}


def _errors(comparison: Comparison, run: str, against: str, joint: str) -> Errors | None:
    found = comparison.errors(run, against) if against else None
    return found[joint] if found else None


def _relative(errors: Errors | None) -> tuple[float | None, ...]:
    return tuple(errors.relative().values()) if errors else (None,) * len(ERRORS)


def _known(value: Any) -> Any:
    """The value, None for a number that is not finite."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_table(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write the rows, whole or not at all; what is not known is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows:
        writer.writerow(["" if row[name] is None else as_text(row[name]) for name in COLUMNS])
    write_whole(path, text.getvalue())
