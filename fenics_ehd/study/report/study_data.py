"""Data for the report of a study that is complete or in progress: rows, histories, errors."""

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

#: Norms of an error over time: largest value, and root mean square.
NORMS = {"max": "largest", "l2": "L2"}

Columns = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Curve:
    """A quantity over time by which runs are compared: peak pressure or minimum film thickness.

    Attributes
    ----------
    key
        Beginning of the quantity's columns in ``table.csv``.
    title
        Name in words.
    quantity
        Name of the joint's array in the history.
    label
        Label of an axis, with unit.
    """

    key: str
    title: str
    quantity: str
    label: str


PRESSURE = Curve("pressure", "peak pressure", "max_pressure", "peak pressure [MPa]")
FILM = Curve("film", "minimum film thickness", "min_film_thickness", "minimum film thickness [µm]")
CURVES = (PRESSURE, FILM)


class StudyRow(dict[str, Any]):
    """Row of ``table.csv``: one lubricated joint in one run, as a dictionary by column.

    Values are text or numbers in SI units, nan for an empty cell. Pressure errors are divided by
    the peak pressure of the reference, film errors by the film thickness. Columns ``own_...`` have
    errors relative to a run of the same model with very fine steps.
    """

    @property
    def complete(self) -> bool:
        """True if the run is complete, so that its results are valid."""
        return bool(self["status"] == "complete")

    def error(self, curve: Curve) -> float:
        """Largest error of a curve over time, relative to the reference."""
        return float(self[f"{curve.key}_error_max"])

    def floor(self, curve: Curve) -> float:
        """Error of the reference itself for a curve, relative; 0 if it is unknown."""
        value = float(self[f"{curve.key}_floor"])
        return value if math.isfinite(value) else 0.0

    def visible_error(self, curve: Curve) -> float:
        """Error to show for a curve: the larger of its error and the reference's own error."""
        return max(self.error(curve), self.floor(curve))

    def bounded(self, curve: Curve) -> bool:
        """True if the error to show is only an upper limit: the reference's own error is larger."""
        return self.error(curve) < self.floor(curve)

    @property
    def worst_error(self) -> float:
        """Larger value of the errors to show for peak pressure and film thickness."""
        return max(self.visible_error(curve) for curve in CURVES)

    @property
    def measured(self) -> bool:
        """True if the run is complete and has errors relative to a reference."""
        return self.complete and all(math.isfinite(self.error(q)) for q in CURVES)


@dataclass(frozen=True, eq=False)
class StudyData:
    """Contents of the folder of a study.

    Attributes
    ----------
    directory
        Path of the folder.
    info
        Contents of ``study.json``. Its ``start`` is the time after which errors are evaluated [s];
        in a periodic study, it is measured from the start of the cycle.
    reference
        Contents of ``reference.json``; empty if the file does not exist.
    rows
        Rows of ``table.csv`` in their order, of all lubricated joints.
    """

    directory: Path
    info: Mapping[str, Any]
    reference: Mapping[str, Any]
    rows: tuple[StudyRow, ...]

    @cached_property
    def joints(self) -> tuple[JointData, ...]:
        """Data of the lubricated joints, one by one."""
        return tuple(JointData(self, name) for name in self.info["joints"])

    def worst_error(self, run: str) -> float:
        """Largest error of a run, over both curves and all joints; nan if it was not compared."""
        rows = (row for joint in self.joints for row in joint.measured("methods", run=run))
        return max((row.worst_error for row in rows), default=math.nan)

    def folder(self, run: str) -> Path:
        """Path of the folder of a run."""
        return self.directory / "runs" / run

    def history(self, run: str, *, films: bool = False) -> History | None:
        """History of a run, with film pressures if requested; None if the run stored none."""
        try:
            return load_history(self.folder(run), films=films)
        except InputError:
            return None


@dataclass(frozen=True, eq=False)
class JointData:
    """Data of one lubricated joint in a study.

    Attributes
    ----------
    study
        Study with the joint.
    name
        Name of the joint.
    """

    study: StudyData
    name: str

    def planned(self, *groups: str, **wanted: Any) -> list[StudyRow]:
        """Rows of the table for the joint, in the given groups.

        `wanted` has required values of some columns, by column.
        """
        return [
            row
            for row in self.study.rows
            if row["joint"] in (self.name, "")
            and row["group"] in groups
            and all(row[column] == value for column, value in wanted.items())
        ]

    def measured(self, *groups: str, **wanted: Any) -> list[StudyRow]:
        """Rows that have errors relative to a reference, sorted by the number of coordinates.

        The arguments are those of `planned`.
        """
        chosen = [row for row in self.planned(*groups, **wanted) if row.measured]
        return sorted(chosen, key=lambda row: row["coordinates"])

    def own_error(self, kind: str, curve: Curve, norm: str = "max") -> float:
        """Error of the reference itself for a curve, relative; nan if it is unknown.

        `kind` is the cause, ``"step"``, ``"film"`` or ``"basis"``; `norm` is ``"max"`` or ``"l2"``.
        """
        entry = self.study.reference.get(kind) or {}
        value = entry.get("joints", {}).get(self.name, entry).get(f"{curve.key}_{norm}")
        return math.nan if value is None else float(value)

    def errors_over_time(self, run: str) -> Columns | None:
        """Arrays ``time_s``, ``pressure_error``, ``film_error`` of a run; None if missing."""
        try:
            stored = read_errors(errors_path(self.study.folder(run), REFERENCE))
        except InputError:
            return None
        # Versions before 0.4 stored bare names for studies of one joint.
        return {column.removeprefix(f"{self.name}."): v for column, v in stored.items()}


#: Columns of the table with text; the others have numbers.
TEXTS = ("run", "group", "joint", "method", "pressure_set", "selection", "film_cells", "status",
         "against", "body")  # fmt: skip


def require_study(directory: str | Path) -> None:
    """Check that a folder has a study.

    Raises
    ------
    InputError
        The folder has no study; the message has those of its subfolders that have one.
    """
    folder = Path(directory)
    if (folder / "study.json").is_file():
        return
    inside = sorted(str(path.parent) for path in folder.glob("*/study.json"))
    remedy = " or ".join(inside) or "the folder of fenics-ehd run or fenics-ehd study"
    raise InputError(
        f"{folder} has neither a run nor a study, because it has neither history.h5 nor "
        f"study.json: give {remedy}"
    )


def read_study(directory: str | Path) -> StudyData:
    """Read the folder of a study.

    Raises
    ------
    InputError
        The folder has no study, or one of its files cannot be read.
    """
    folder = Path(directory)
    info, reference, table = (
        folder / name for name in ("study.json", "reference.json", "table.csv")
    )
    require_study(folder)
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
    """Values of a row of the table by column: text or number, nan for an empty cell."""
    return {name: cells[name] if name in TEXTS else float(cells[name] or "nan") for name in COLUMNS}
