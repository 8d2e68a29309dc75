"""What a study left in its folder, as a report reads it; a study that goes on is read as well."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fenics_ehd.errors import BodyFileError, InputError
from fenics_ehd.history_file import read_history
from fenics_ehd.reduction import ReducedBody, load_body
from fenics_ehd.scenes.rotor_settings import RotorSettings
from fenics_ehd.scenes.slider_crank_settings import Reduction, SliderCrankSettings

#: Norms of the error of a curve: largest over the revolution, L2 over the revolution.
NORMS = {"max": "largest", "l2": "L2"}

#: Kinds of scene that are studied.
SETTINGS: dict[str, Any] = {"slider-crank": SliderCrankSettings, "rotor": RotorSettings}

#: Groups of runs that are compared with the reference itself.
COMPARED = ("methods", "tolerance")


@dataclass(frozen=True)
class Quantity:
    """One of the two curves that a bearing is judged by."""

    key: str
    title: str
    column: str
    factor: float
    unit: str

    @property
    def label(self) -> str:
        """Name and unit, for an axis."""
        return f"{self.title} [{self.unit}]"


PRESSURE = Quantity("pressure", "peak pressure", "max_pressure_Pa", 1e-6, "MPa")
FILM = Quantity("film", "minimum film thickness", "min_film_thickness_m", 1e6, "µm")
QUANTITIES = (PRESSURE, FILM)


@dataclass(frozen=True)
class StudyRun:
    """A row of ``table.csv``; its columns in lower case, SI units, nan where a cell is empty.

    Errors are relative: of the pressure to the reference's peak, of the film to the film. Those
    called own are relative to the same model with very fine steps.
    """

    run: str
    group: str
    method: str
    status: str
    pressure_set: str = ""
    selection: str = ""
    film_cells: str = ""
    body: str = ""
    vibration_modes: float = math.nan
    residual_modes: float = math.nan
    interior_modes: float = math.nan
    residual_truncation: float = math.nan
    tolerance: float = math.nan
    order: float = math.nan
    coordinates: float = math.nan
    pressure_error_max: float = math.nan
    pressure_error_l2: float = math.nan
    film_error_max: float = math.nan
    film_error_l2: float = math.nan
    own_pressure_error_max: float = math.nan
    own_film_error_max: float = math.nan
    pressure_floor: float = math.nan
    film_floor: float = math.nan
    pressure_floor_l2: float = math.nan
    film_floor_l2: float = math.nan
    offline_s: float = math.nan
    online_s: float = math.nan
    steps: float = math.nan
    rejected_steps: float = math.nan
    newton_iterations: float = math.nan
    highest_frequency_hz: float = math.nan
    estimated_gap_error_m: float = math.nan
    true_gap_error_m: float = math.nan
    max_pressure_pa: float = math.nan
    min_film_thickness_m: float = math.nan

    @property
    def complete(self) -> bool:
        """Whether its figures count."""
        return self.status == "complete"

    def error(self, quantity: Quantity, norm: str = "max") -> float:
        """Relative error of a curve against the reference, as measured."""
        return float(getattr(self, f"{quantity.key}_error_{norm}"))

    def floor(self, quantity: Quantity, norm: str = "max") -> float:
        """Error of the reference itself; 0 where it is not known."""
        name = f"{quantity.key}_floor" + ("_l2" if norm == "l2" else "")
        value = float(getattr(self, name))
        return value if math.isfinite(value) else 0.0

    def step_error(self, quantity: Quantity) -> float:
        """Largest relative error that the steps make, nan where it was not taken."""
        return float(getattr(self, f"own_{quantity.key}_error_max"))

    def visible_error(self, quantity: Quantity, norm: str = "max") -> float:
        """Error that may be shown: none below the reference's own."""
        return max(self.error(quantity, norm), self.floor(quantity, norm))

    @property
    def worst_error(self) -> float:
        """The larger one of both curves' largest errors, none below the reference's own."""
        return max(self.visible_error(quantity) for quantity in QUANTITIES)

    @property
    def measured(self) -> bool:
        """Whether it came to its end and was compared with a reference."""
        return self.complete and all(math.isfinite(self.error(q)) for q in QUANTITIES)


@dataclass(frozen=True, eq=False)
class Study:
    """A study folder.

    Attributes
    ----------
    directory
        Where it is.
    info
        ``study.json``.
    reference
        ``reference.json``, empty before there is one.
    runs
        Rows of ``table.csv`` in their order.
    """

    directory: Path
    info: Mapping[str, Any]
    reference: Mapping[str, Any]
    runs: tuple[StudyRun, ...]

    @property
    def scene(self) -> str:
        """``"slider-crank"`` or ``"rotor"``."""
        return str(self.info.get("scene", "slider-crank"))

    def group(self, *names: str) -> list[StudyRun]:
        """Measured runs of some groups."""
        return [run for run in self.runs if run.group in names and run.measured]

    def pick(self, group: str = "methods", **wanted: Any) -> list[StudyRun]:
        """Measured runs of a group with these values, by coordinates."""
        chosen = [
            run
            for run in self.group(group)
            if all(getattr(run, name) == value for name, value in wanted.items())
        ]
        return sorted(chosen, key=lambda run: run.coordinates)

    @cached_property
    def bodies(self) -> tuple[ReducedBody, ...]:
        """Reduced bodies, few coordinates first; a broken file is left out."""
        paths = sorted(self.directory.glob("bodies/*.h5"))
        bodies = []
        for path in paths or sorted(self.directory.glob("runs/*/body.h5")):
            try:
                bodies.append(load_body(path))
            except BodyFileError:
                continue
        return tuple(sorted(bodies, key=lambda body: body.modes))

    @property
    def start(self) -> float:
        """Time from which on errors count [s]."""
        return float(self.info.get("errors_count_from_s", 0.0))

    def own_error(self, kind: str, quantity: Quantity) -> float:
        """One of the reference's own largest errors, 0 where it is not known."""
        entry = self.reference.get(kind)
        value = entry.get(f"{quantity.key}_max") if isinstance(entry, Mapping) else None
        return float(value) if value is not None else 0.0

    def folder(self, run: str) -> Path:
        """Results of a run."""
        return self.directory / "runs" / run

    def history(self, run: str) -> dict[str, np.ndarray] | None:
        """Columns of a run's history, None when it left none."""
        if run not in self._histories:
            try:
                self._histories[run] = read_history(self.folder(run))
            except InputError:
                return None
        return self._histories[run]

    @cached_property
    def _histories(self) -> dict[str, dict[str, np.ndarray]]:
        """Histories read so far: most figures show the reference's."""
        return {}


def default_reduction(scene: str) -> Reduction:
    """What a scene's part is reduced by when nothing is said."""
    reduction: Reduction = SETTINGS[scene]().reduction
    return reduction


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
    scene = info.get("scene", "slider-crank")
    if scene not in SETTINGS:
        raise InputError(f"{folder / 'study.json'}: scene = {scene}, not {' or '.join(SETTINGS)}")
    reference = _read_json(folder / "reference.json") or {}
    mean_floors = _mean_floors(reference)
    runs = tuple(
        replace(run, **mean_floors) if run.group in COMPARED else run
        for run in _read_table(folder / "table.csv")
    )
    return Study(folder, info, reference, runs)


def _mean_floors(reference: Mapping[str, Any]) -> dict[str, Any]:
    """L2 errors of the reference's steps and basis, the larger one of the two for each curve."""
    found: dict[str, Any] = {}
    for quantity in QUANTITIES:
        own = [reference.get(kind) or {} for kind in ("step", "basis")]
        values = [entry.get(f"{quantity.key}_l2") for entry in own]
        known = [float(value) for value in values if value is not None]
        found[f"{quantity.key}_floor_l2"] = max(known, default=math.nan)
    return found


def _read_json(path: Path) -> dict[str, Any] | None:
    if not path.is_file():
        return None
    try:
        values = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    if not isinstance(values, dict):
        raise InputError(f"{path}: holds no object")
    return values


def _read_table(path: Path) -> tuple[StudyRun, ...]:
    """Rows of a table; the last one of a writer that was killed may be unfinished."""
    if not path.is_file():
        return ()
    with open(path, newline="") as file:
        header, *rows = list(csv.reader(file)) or [[]]
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
