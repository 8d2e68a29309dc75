"""Reads a study's folder, of any age and as far as it got."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from fenics_ehd.errors import InputError
from fenics_ehd.report.study_data import LIMITING, NORMS, QUANTITIES, SETTINGS, Study, StudyRun

#: Groups of runs that are compared with the reference itself.
COMPARED = ("methods", "tolerance")

#: All of its errors.
OWN_ERRORS = (*LIMITING, "film")


def read_study(directory: str | Path) -> Study:
    """Read a study folder.

    Raises
    ------
    InputError
        The folder holds no study, or a file of it cannot be read.
    """
    folder = Path(directory)
    info = _read_json(folder / "study.json")
    if info is None:
        raise InputError(f"{folder}: not a study, study.json is missing: run fenics-ehd study")
    _require_readable(info, folder / "study.json")
    reference = _read_json(folder / "reference.json") or {}
    floors = _floors(reference, folder / "reference.json")
    runs = tuple(_with_floors(run, floors) for run in _read_table(folder / "table.csv"))
    return Study(folder, info, reference, runs)


def _require_readable(info: Mapping[str, Any], path: Path) -> None:
    """What a report works with has the type that it must have."""
    scene = info.get("scene", "slider-crank")
    if not isinstance(scene, str) or scene not in SETTINGS:
        raise InputError(f"{path}: scene = {scene}, not {' or '.join(SETTINGS)}")
    runs = info.get("runs", 0)
    if isinstance(runs, bool) or not isinstance(runs, int):
        raise InputError(f"{path}: runs = {runs!r} is no whole number")
    _number(info.get("errors_count_from_s", 0.0), f"{path}: errors_count_from_s")
    settings = info.get("settings", {})
    if not isinstance(settings, Mapping):
        raise InputError(f"{path}: settings = {settings!r} are no object")


def _number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{name} = {value!r} is no number")
    return float(value)


def _floors(reference: Mapping[str, Any], path: Path) -> dict[str, float]:
    """Errors of the reference's steps and basis: the larger known one for each curve and norm."""
    own: dict[tuple[str, str], float] = {}
    for kind in OWN_ERRORS:
        entry = reference.get(kind) or {}
        if not isinstance(entry, Mapping):
            raise InputError(f"{path}: {kind} = {entry!r} is no object")
        for name in (f"{quantity.key}_{norm}" for quantity in QUANTITIES for norm in NORMS):
            if entry.get(name) is not None:
                own[kind, name] = _number(entry[name], f"{path}: {kind}.{name}")
    found = {}
    for quantity in QUANTITIES:
        for norm, column in (("max", "floor"), ("l2", "floor_l2")):
            known = [own.get((kind, f"{quantity.key}_{norm}"), math.nan) for kind in LIMITING]
            finite = [value for value in known if math.isfinite(value)]
            found[f"{quantity.key}_{column}"] = max(finite, default=math.nan)
    return found


def _with_floors(run: StudyRun, floors: Mapping[str, float]) -> StudyRun:
    """A run with what is known of the reference where its own row tells nothing."""
    if run.group not in COMPARED:
        return run
    unknown: dict[str, Any] = {
        name: value for name, value in floors.items() if not math.isfinite(getattr(run, name))
    }
    return replace(run, **unknown)


def _read_json(path: Path) -> dict[str, Any] | None:
    if not path.is_file():
        return None
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    if not isinstance(values, dict):
        raise InputError(f"{path}: holds no object")
    return values


def _read_table(path: Path) -> tuple[StudyRun, ...]:
    """Rows of a table; the last one of a writer that was killed may be unfinished."""
    if not path.is_file():
        return ()
    try:
        with open(path, newline="", encoding="utf-8") as file:
            header, *rows = list(csv.reader(file)) or [[]]
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    missing = {"run", "group", "method", "status"} - set(header)
    if missing:
        raise InputError(f"{path}: not the table of a study, no column {', '.join(missing)}")
    whole = [row for row in rows if len(row) == len(header)]
    return tuple(_run(dict(zip(header, row, strict=True)), path) for row in whole)


def _run(cells: Mapping[str, str], path: Path) -> StudyRun:
    lower = {name.lower(): cell for name, cell in cells.items()}
    values: dict[str, Any] = {}
    for field in fields(StudyRun):
        cell = lower.get(field.name, "")
        if field.type == "str":
            values[field.name] = cell
            continue
        try:
            values[field.name] = float(cell) if cell else math.nan
        except ValueError:
            raise InputError(
                f"{path}: {field.name} = {cell!r} of run {cells['run']} is no number"
            ) from None
    return StudyRun(**values)
