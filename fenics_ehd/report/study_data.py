"""What a study left in its folder, as a report reads it; a study that goes on is read as well."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fenics_ehd.errors import (
    BodyFileError,
    CavitationError,
    FilmTooThinError,
    GapClosedError,
    InputError,
    StepSizeError,
)
from fenics_ehd.history_file import read_history
from fenics_ehd.reduction import ReducedBody, load_body
from fenics_ehd.scenes.rotor_settings import RotorSettings
from fenics_ehd.scenes.slider_crank_settings import Reduction, SliderCrankSettings

#: Norms of the error of a curve: largest over the revolution, L2 over the revolution.
NORMS = {"max": "largest", "l2": "L2"}

#: Errors of the reference below which those of runs on its film mesh mean nothing.
LIMITING = ("step", "basis")

#: Kinds of scene that are studied.
SETTINGS: dict[str, Any] = {"slider-crank": SliderCrankSettings, "rotor": RotorSettings}

#: Status of a run that has not ended.
NOT_ENDED = "not run"

#: Ends of a run that tell something about its model: it could not be integrated to the end.
BREAKDOWNS = tuple(
    f"failed: {kind.__name__}"
    for kind in (StepSizeError, GapClosedError, FilmTooThinError, CavitationError)
)


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

    @property
    def broke_down(self) -> bool:
        """Whether steps or film came to an end: that is a result, a full disk is none."""
        return self.status.startswith(BREAKDOWNS)

    @property
    def modes(self) -> float:
        """Modes that were asked for, nan where the table does not tell."""
        residual = self.residual_modes if math.isfinite(self.residual_modes) else 0.0
        return self.vibration_modes + residual

    def error(self, quantity: Quantity, norm: str = "max") -> float:
        """Relative error of a curve against the reference, as measured."""
        return float(getattr(self, f"{quantity.key}_error_{norm}"))

    def floor(self, quantity: Quantity, norm: str = "max") -> float:
        """Error of the reference itself, as far as it is known."""
        name = f"{quantity.key}_floor" + ("_l2" if norm == "l2" else "")
        value = float(getattr(self, name))
        return value if math.isfinite(value) else 0.0

    def step_error(self, quantity: Quantity) -> float:
        """Largest relative error that the steps make, nan where it was not taken."""
        return float(getattr(self, f"own_{quantity.key}_error_max"))

    def visible_error(self, quantity: Quantity, norm: str = "max") -> float:
        """Error that may be shown: none below the reference's own."""
        return max(self.error(quantity, norm), self.floor(quantity, norm))

    def bounded(self, quantity: Quantity, norm: str = "max") -> bool:
        """Whether only a bound of the error is known, the reference's own."""
        return self.error(quantity, norm) < self.floor(quantity, norm)

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

    def planned(self, group: str = "methods", **wanted: Any) -> list[StudyRun]:
        """Runs of a group with these values, whatever came of them."""
        return [
            run
            for run in self.runs
            if run.group == group
            and all(getattr(run, name) == value for name, value in wanted.items())
        ]

    def pick(self, group: str = "methods", **wanted: Any) -> list[StudyRun]:
        """The measured ones of them, by coordinates: what a figure shows."""
        chosen = [run for run in self.planned(group, **wanted) if run.measured]
        return sorted(chosen, key=lambda run: run.coordinates)

    @property
    def unnamed(self) -> int:
        """Planned runs that the table of an older version has no row for yet."""
        return max(int(self.info.get("runs", 0)) - len({run.run for run in self.runs}), 0)

    @cached_property
    def bodies(self) -> tuple[ReducedBody, ...]:
        """Reduced bodies of these runs, few coordinates first; a broken file is left out.

        A folder may hold bodies of an earlier study as well: those that no row names.
        """
        named = {run.body for run in self.runs} - {""}
        paths = sorted(self.directory.glob("bodies/*.h5"))
        paths = [path for path in paths if path.stem in named or not named]
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

    @property
    def judged(self) -> bool:
        """Whether there is a reference that came to its end."""
        return self.reference.get("status") == "complete"

    @property
    def unknown_floors(self) -> list[str]:
        """Which of the reference's own errors that limit a comparison were not taken."""
        return [kind for kind in LIMITING if any(self._own(kind, q) is None for q in QUANTITIES)]

    def own_error(self, kind: str, quantity: Quantity) -> float:
        """One of the reference's own largest errors, 0 where it is not known."""
        return self._own(kind, quantity) or 0.0

    def _own(self, kind: str, quantity: Quantity) -> float | None:
        entry = self.reference.get(kind)
        value = entry.get(f"{quantity.key}_max") if isinstance(entry, Mapping) else None
        return None if value is None else float(value)

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
