"""Reads a study's folder, as far as the study got."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from fenics_ehd.base.errors import InputError
from fenics_ehd.base.sealed_file import named
from fenics_ehd.base.text_file import read_json, read_text
from fenics_ehd.study.report.study_data import (
    LIMITING,
    NORMS,
    QUANTITIES,
    JointData,
    StudyData,
    StudyRow,
)

#: Columns of the table that hold text; the others hold numbers.
TEXTS = ("run", "group", "joint", "method", "pressure_set", "selection", "film_cells", "status",
         "against", "body")  # fmt: skip

#: Groups of runs that are compared with the reference itself.
COMPARED = ("methods", "tolerance")

#: Types of what ``study.json`` must hold, as far as a report works with it.
INFO: dict[str, Any] = {"scene": str, "joints": list, "runs": int, "start": (int, float)}


def read_study(directory: str | Path) -> StudyData:
    """Read a study's folder.

    Raises
    ------
    InputError
        The folder holds no study, or a file of it cannot be read.
    """
    folder = Path(directory)
    path = folder / "study.json"
    if not path.is_file():
        raise InputError(f"{folder}: not a study, study.json is missing: run fenics-ehd study")
    info = _read_json(path)
    for key, kind in INFO.items():
        if not isinstance(info.get(key), kind) or info[key] == []:
            raise InputError(
                f"{path}: {key} = {info.get(key)!r} cannot be, another version's file: "
                "run fenics-ehd study again"
            )
    path = folder / "reference.json"
    study = StudyData(folder, info, _read_json(path) if path.is_file() else {}, ())
    with named(InputError, f"{path}: not the reference of a study"):
        floors = {joint.name: _floors(joint) for joint in study.joints}
    return replace(study, rows=_read_table(folder / "table.csv", floors))


def _read_json(path: Path) -> dict[str, Any]:
    with named(InputError, f"{path}: cannot be read"):
        return dict(read_json(path))


def _floors(joint: JointData) -> dict[str, float]:
    """Errors of the reference's steps and basis: the larger known one of each curve and norm."""
    found = {}
    for quantity in QUANTITIES:
        for norm, ending in zip(NORMS, ("", "_l2"), strict=True):
            own = [joint.own_error(kind, quantity, norm) for kind in LIMITING]
            known = [error for error in own if math.isfinite(error)]
            found[f"{quantity.key}_floor{ending}"] = max(known, default=math.nan)
    return found


def _read_table(path: Path, floors: Mapping[str, Mapping[str, float]]) -> tuple[StudyRow, ...]:
    """Rows of the table, none before there is one; with the floors where they tell nothing."""
    if not path.is_file():
        return ()
    with named(InputError, f"{path}: not the table of a study"):
        rows = [_row(cells) for cells in csv.DictReader(io.StringIO(read_text(path), newline=""))]
        for row in rows:
            known = floors[row["joint"] or next(iter(floors))]
            if row["group"] not in COMPARED:
                known = dict.fromkeys(known, math.nan)
            row |= {**known, **{k: v for k, v in row.items() if v == v}}
    return tuple(map(StudyRow, rows))


def _row(cells: Mapping[str, str]) -> dict[str, Any]:
    values: dict[str, Any] = {"joint": ""}
    for name, cell in cells.items():
        try:
            values[name] = cell if name in TEXTS else float(cell or "nan")
        except ValueError:
            raise ValueError(f"{name} = {cell!r} of run {cells['run']} is no number") from None
    return values
