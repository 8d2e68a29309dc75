"""Data of a study for its report, complete or in progress: rows, histories, errors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fenics_ehd.base.errors import InputError
from fenics_ehd.base.files import read_json
from fenics_ehd.base.sealed_file import named
from fenics_ehd.multibody.history import History, load_history
from fenics_ehd.study.cases import read_table
from fenics_ehd.study.compare import COLUMNS, errors_path, read_errors
from fenics_ehd.study.plan import REFERENCE

#: Norms of the error of a curve: largest value, and root mean square, over time.
NORMS = {"max": "largest", "l2": "L2"}

Columns = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Curve:
    """Curve of peak pressure or of minimum film thickness, by which a joint is assessed."""

    key: str
    title: str
    quantity: str
    label: str


PRESSURE = Curve("pressure", "peak pressure", "max_pressure", "peak pressure [MPa]")
FILM = Curve("film", "minimum film thickness", "min_film_thickness", "minimum film thickness [µm]")
CURVES = (PRESSURE, FILM)


class StudyRow(dict[str, Any]):
    """Row of ``table.csv``: one lubricated joint in one run.

    Values by column are text or numbers in SI units, nan for an empty cell. Errors are relative:
    pressure errors to the reference's peak, film errors to the film thickness. Errors in columns
    ``own_...`` are relative to the same model with very fine steps.
    """

    @property
    def complete(self) -> bool:
        """True if the run is complete, so that its figures are valid."""
        return bool(self["status"] == "complete")

    def error(self, curve: Curve) -> float:
        """Largest measured error of a curve relative to the reference."""
        return float(self[f"{curve.key}_error_max"])

    def floor(self, curve: Curve) -> float:
        """Error of the reference itself; 0 if it is unknown."""
        value = float(self[f"{curve.key}_floor"])
        return value if math.isfinite(value) else 0.0

    def visible_error(self, curve: Curve) -> float:
        """Error to be shown: at least that of the reference."""
        return max(self.error(curve), self.floor(curve))

    def bounded(self, curve: Curve) -> bool:
        """True if the measured error is below that of the reference, which is then a bound."""
        return self.error(curve) < self.floor(curve)

    @property
    def worst_error(self) -> float:
        """Larger one of the errors to be shown of both curves."""
        return max(self.visible_error(curve) for curve in CURVES)

    @property
    def measured(self) -> bool:
        """True if the run is complete and was compared with a reference."""
        return self.complete and all(math.isfinite(self.error(q)) for q in CURVES)


@dataclass(frozen=True, eq=False)
class StudyData:
    """Contents of a study's folder.

    Attributes
    ----------
    directory
        Path of the folder.
    info
        ``study.json``; its ``start`` is the time from which on errors count, of a periodic study
        in its cycle [s].
    reference
        Contents of ``reference.json``, empty if there is none.
    rows
        Rows of ``table.csv`` in their order, for all lubricated joints.
    """

    directory: Path
    info: Mapping[str, Any]
    reference: Mapping[str, Any]
    rows: tuple[StudyRow, ...]

    @cached_property
    def joints(self) -> tuple[JointData, ...]:
        """Data of each lubricated joint."""
        return tuple(JointData(self, name) for name in self.info["joints"])

    def worst_error(self, run: str) -> float:
        """Largest error of both curves in all joints; nan if the run was not compared."""
        rows = (row for joint in self.joints for row in joint.measured("methods", run=run))
        return max((row.worst_error for row in rows), default=math.nan)

    def folder(self, run: str) -> Path:
        """Folder of a run's results."""
        return self.directory / "runs" / run

    def history(self, run: str, *, films: bool = False) -> History | None:
        """History of a run, with films if requested; None if the run stored none."""
        try:
            return load_history(self.folder(run), films=films)
        except InputError:
            return None


@dataclass(frozen=True, eq=False)
class JointData:
    """One lubricated joint in a study.

    Attributes
    ----------
    study
        Study of the joint.
    name
        Name of the joint.
    """

    study: StudyData
    name: str

    def planned(self, *groups: str, **wanted: Any) -> list[StudyRow]:
        """Rows of some groups with given values in their columns, complete or not."""
        return [
            row
            for row in self.study.rows
            if row["joint"] in (self.name, "")
            and row["group"] in groups
            and all(row[column] == value for column, value in wanted.items())
        ]

    def measured(self, *groups: str, **wanted: Any) -> list[StudyRow]:
        """Planned rows that were compared with a reference, sorted by coordinates."""
        chosen = [row for row in self.planned(*groups, **wanted) if row.measured]
        return sorted(chosen, key=lambda row: row["coordinates"])

    def own_error(self, kind: str, curve: Curve, norm: str = "max") -> float:
        """Error of the reference of one kind; nan if it is unknown."""
        entry = self.study.reference.get(kind) or {}
        value = entry.get("joints", {}).get(self.name, entry).get(f"{curve.key}_{norm}")
        return math.nan if value is None else float(value)

    def errors_over_time(self, run: str) -> Columns | None:
        """``time_s``, signed ``pressure_error`` and ``film_error`` of a run; None if missing."""
        try:
            stored = read_errors(errors_path(self.study.folder(run), REFERENCE))
        except InputError:
            return None
        # Versions before 0.4 stored bare names for studies of one joint.
        return {column.removeprefix(f"{self.name}."): v for column, v in stored.items()}


#: Columns of the table that hold text; the others hold numbers.
TEXTS = ("run", "group", "joint", "method", "pressure_set", "selection", "film_cells", "status",
         "against", "body")  # fmt: skip


def read_study(directory: str | Path) -> StudyData:
    """Read a study's folder.

    Raises
    ------
    InputError
        The folder holds no study, or a file of it cannot be read.
    """
    folder = Path(directory)
    info, reference, table = (
        folder / name for name in ("study.json", "reference.json", "table.csv")
    )
    if not info.is_file():
        raise InputError(f"{folder}: not a study, study.json is missing: run fenics-ehd study")
    with named(InputError, f"{info}: cannot be read"):
        about = dict(read_json(info))
        about |= {key: about[key] for key in ("scene", "joints", "runs", "start")}
    with named(InputError, f"{reference}: cannot be read"):
        figures = dict(read_json(reference)) if reference.is_file() else {}
    with named(InputError, f"{table}: not the table of a study"):
        cells = read_table(table, COLUMNS) if table.is_file() else []
        rows = tuple(StudyRow(_row(row)) for row in cells)
    return StudyData(folder, about, figures, rows)


def _row(cells: Mapping[str, str]) -> dict[str, Any]:
    """Text or a number by column; nan where a cell is empty."""
    return {name: cells[name] if name in TEXTS else float(cells[name] or "nan") for name in COLUMNS}
