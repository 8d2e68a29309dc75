"""History of a run: arrays over its accepted steps, with the same paths in memory and on disk.

Every recorded quantity is an array over the steps and has a path: ``time``, ``run/QUANTITY``,
``bodies/NAME/QUANTITY``, ``joints/NAME/QUANTITY``, ``joints/NAME/film/FIELD`` and ``state/FIELD``.
Meshes of films, ``joints/NAME/film/angle``, ``height`` and ``cells``, do not change. A column of
``history.csv`` is a quantity of a joint, a body or the run with one number per step; its name ends
with its unit.

`History.with_start` adds a row at the start of a periodic cycle: the row at the end of the cycle,
with a period subtracted from the time and whole turns from angles. Works begin at zero.

Imports inside functions: figures need matplotlib, which is loaded when one is drawn.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import h5py
import numpy as np

from fenics_ehd import __version__
from fenics_ehd.base.arguments import require_class, require_word
from fenics_ehd.base.columns import DIMENSIONLESS, Quantity, csv_line, with_unit
from fenics_ehd.base.described import Described, Named, names_or_none, unknown_name
from fenics_ehd.base.errors import InputError
from fenics_ehd.base.files import (
    SCENE_NAME,
    naming,
    read_text,
    write_summary,
    write_whole,
)
from fenics_ehd.base.layout import Group, Value, attribute, read_declared
from fenics_ehd.base.renamed import (
    renamed_arguments,
    renamed_attributes,
)
from fenics_ehd.base.sealed_file import named, open_sealed, put_tree, sealed_hdf5, values
from fenics_ehd.multibody.cycle import TURN_ROUNDING, Cycle
from fenics_ehd.multibody.names_without_joint import Columns, Summary
from fenics_ehd.multibody.recorded_quantities import (
    FAMILIES,
    BodyResult,
    FilmResult,
    JointResult,
    Quantities,
)
from fenics_ehd.multibody.stored_summary import read_summary

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import Dataset


#: Names of the files, and name and version of the layout of ``history.h5``.
FIELDS_NAME = "history.h5"
CSV_NAME = "history.csv"
FORMAT = "fenics_ehd history"
FORMAT_VERSION = 4

#: Earlier versions of the layout that can be read: version 3, of release 0.3, has no group `CYCLE`.
READ_VERSIONS = (3,)

#: Group of the file with the state for a restart that is not recorded in the rows.
RESUME = "resume"

#: Group of the file with the last complete cycle.
CYCLE = "cycle"

#: Unit of arrays whose columns have different units. The file has the units of coordinates and
#: rates in the attribute ``units``; multipliers are forces [N] and torques [N m].
MIXED = "mixed"

#: Units of fields and of arrays of the state, by the last part of their path.
FIELD_UNITS = {
    "pressure": "Pa",
    "gap": "m",
    "fluid_fraction": DIMENSIONLESS,
    "quasi_static": "Pa",
    "quasi_static_rates": "Pa/s",
    "multipliers": MIXED,
    "corner": DIMENSIONLESS,
    "powers": "W",
    "angle": "rad",
    "height": "m",
    "radius": "m",
    "clearance": "m",
    "cells": DIMENSIONLESS,
}

#: Extremes that describe a joint: name in the error budget, entry of the summary, factor and unit.
SHOWN_EXTREMES = (
    ("max_pressure", "max_pressure_Pa", 1e-6, "MPa"),
    ("min_film_thickness", "min_film_thickness_m", 1e6, "um"),
)

#: Fields of which `History.plot_map` draws maps.
MAPS = ("pressure", "film", "contact")

#: Start of the paths of quantities with one number per step, except for nodal fields.
COLUMNS = ("time", "run/", "bodies/", "joints/")

#: Arrays of the state whose attribute ``units`` has one unit for every column.
STATE_IN_UNITS = ("state/coordinates", "state/rates")

_STEPS = Value("float", ("STEPS",), finite=False)
_FIELD = Value("float", ("STEPS", "nodes"))

#: Layout of ``history.h5``. A quantity may be undefined in a step; the state that a run starts from
#: may not.
LAYOUT = Group(
    {
        "time": Value("float", ("STEPS",)),
        "state": Group(
            {
                "coordinates": Value("float", ("STEPS", "coordinates")),
                "rates": Value("float", ("STEPS", "coordinates")),
                "multipliers": Value("float", ("STEPS", "multipliers"), required=False),
                "corner": Value("truth", ("STEPS",), required=False),
                "quasi_static": Value("float", ("STEPS", "patterns"), required=False),
                "quasi_static_rates": Value("float", ("STEPS", "patterns"), required=False),
                "powers": Value("float", ("STEPS", "powers"), required=False),
            }
        ),
        "run": Group(each=_STEPS, required=False),
        "bodies": Group(each=Group(each=_STEPS), required=False),
        "joints": Group(
            each=Group(
                {
                    "film": Group(
                        {
                            "angle": Value("float", ("nodes",)),
                            "height": Value("float", ("nodes",)),
                            "cells": Value("integer", ("cells", "vertices"), least=0),
                            "radius": Value("float", least=0.0),
                            "clearance": Value("float", least=0.0),
                            "pressure": _FIELD,
                            "gap": _FIELD,
                            "fluid_fraction": replace(_FIELD, required=False),
                        },
                        required=False,
                    )
                },
                each=_STEPS,
            ),
            required=False,
        ),
        RESUME: Group(foreign=True, required=False),
        CYCLE: Cycle.layout,
    }
)

#: Names of a film's arrays that are the same at all steps.
MESH = ("angle", "height", "cells", "radius", "clearance")

#: Options of h5py that compress fields once the run has ended.
PACKED: Mapping[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True}


def of_film(path: str) -> bool:
    """Whether a path is that of a film's array, such as ``joints/NAME/film/pressure``."""
    return path.count("/") == 3


def column_name(path: str) -> str:
    """Name of a column in ``history.csv`` from its path in a history, with or without a unit.

    Parameters
    ----------
    path
        Path of the column: ``joints/big_end/force_x_N``, ``run/step_s``, ``time_s``.

    Returns
    -------
    str
        Name of the column: ``big_end.force_x_N``, ``step_s``, ``time_s``.
    """
    group, _, name = path.partition("/")
    return (name or group).replace("/", ".", 1)


def fixed(path: str) -> bool:
    """Whether a path is that of a film's mesh, which is the same at all steps."""
    return of_film(path) and path.rpartition("/")[2] in MESH


def is_column(path: str) -> bool:
    """Whether a path, with or without a unit, is that of a column with one number per step."""
    return path.startswith(COLUMNS) and not of_film(path)


@renamed_attributes(told="entries")  # words: literal
@renamed_arguments(told="entries")  # words: literal
@dataclass(frozen=True, eq=False, repr=False)
class History(Described):
    """Quantities of a run over its steps, with its summary and scene.

    Attributes
    ----------
    values
        Arrays by path; except for meshes of films, their first axis is the step.
    coordinate_names, coordinate_units
        Names and units of the mechanism's n coordinates: ``bodies/rod/x``, ``bodies/rod/mode_1``.
    entries
        Entries of ``summary.json``; empty if the run is in progress or was killed.
    scene
        Tables of the scene file as the run read it; empty for a mechanism made in Python.
    stored_cycle
        Last complete cycle that was stored with the run; None if there is none, see `cycle`.
    solved
        Recorder of a run from `simulate`, for `replay`, `error_budget`, `multiplier` and
        `sensitivity`; None for a run that was read from a folder.
    folder
        Folder from which the history was read; None for a history of `simulate`.
    """

    values: Mapping[str, Quantity]
    coordinate_names: tuple[str, ...] = ()
    coordinate_units: tuple[str, ...] = ()
    entries: Mapping[str, Any] = field(default_factory=dict)
    scene: Mapping[str, Any] = field(default_factory=dict)
    stored_cycle: Cycle | None = None
    solved: Any = None
    folder: Path | None = None

    def __len__(self) -> int:
        """Number of steps."""
        return len(self.values["time"])

    @cached_property
    def _paths(self) -> dict[str, str]:
        """Paths of the columns by name without unit, such as ``big_end.max_pressure``."""
        return {column_name(path): path for path in self.values if is_column(path)}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all columns without units: ``big_end.max_pressure``, ``rod.angle``."""
        return tuple(self._paths)

    def __getitem__(self, name: str) -> Quantity:
        """Column over the steps, shape (steps,), by its name without unit (`names`)."""
        if name not in self._paths:
            raise unknown_name("result", name, self._paths, "result.names")
        return self.values[self._paths[name]]

    def __contains__(self, name: object) -> bool:
        return name in self._paths

    def units(self, name: str) -> str:
        """Unit of a column, by its name without unit (`names`)."""
        return self[name].units

    def _group(self, path: str) -> dict[str, Quantity]:
        """Quantities directly under a path, by name: those of ``joints/big_end`` for instance."""
        quantities = {}
        for full_path, quantity in self.values.items():
            group, _, name = full_path.rpartition("/")
            if group == path:
                quantities[name] = quantity
        return quantities

    @staticmethod
    def _owners(kind: str, paths: Iterable[str]) -> list[str]:
        """Names of the joints or bodies, depending on `kind`, that occur in paths."""
        parts = [path.split("/") for path in paths]
        return list(dict.fromkeys(path[1] for path in parts if path[0] == kind))

    @cached_property
    def run(self) -> Quantities:
        """Quantities that belong to no joint or body: energies, works, step sizes."""
        return Quantities({"time": self.values["time"]} | self._group("run"))

    @cached_property
    def joints(self) -> dict[str, JointResult]:
        """Results of every lubricated joint, by its name."""
        joints = {
            name: JointResult(self._group(f"joints/{name}"), self._film(name))
            for name in self._owners("joints", self.values)
        }
        return Named(joints, "result.joints")

    def _film(self, joint: str) -> FilmResult | None:
        fields: dict[str, Any] = self._group(f"joints/{joint}/film")
        if not fields:
            return None
        sizes = {name: float(fields[name]) for name in ("radius", "clearance")}
        return FilmResult(**(fields | sizes))

    @property
    def _body_names(self) -> list[str]:
        """Names of the bodies with columns or coordinates."""
        return self._owners("bodies", [*self.values, *self.coordinate_names])

    @cached_property
    def bodies(self) -> dict[str, BodyResult]:
        """Results of every body that can move, by its name."""
        owners = np.array([name.rpartition("/")[0] for name in self.coordinate_names], str)
        bodies = {}
        for name in self._body_names:
            of_body = owners == f"bodies/{name}"
            bodies[name] = BodyResult(
                self._group(f"bodies/{name}"), self.coordinates[:, of_body], self.rates[:, of_body]
            )
        return Named(bodies, "result.bodies")

    @property
    def time(self) -> Quantity:
        """Times of the accepted steps, shape (steps,) [s].

        They are counted from the start of the run. If the history has one cycle of a search for a
        periodic solution, they are counted from the start of this cycle.
        """
        numbers = self.values.get("run/cycle")
        one = numbers is not None and len(numbers) and numbers[0] == numbers[-1]
        return self.values["run/cycle_time" if one else "time"]

    @property
    def coordinates(self) -> np.ndarray:
        """Coordinates of the mechanism at every step, shape (steps, n)."""
        return np.asarray(self.values["state/coordinates"])

    @property
    def rates(self) -> np.ndarray:
        """Rates of the coordinates at every step, shape (steps, n)."""
        return np.asarray(self.values["state/rates"])

    @property
    def quasi_static(self) -> np.ndarray:
        """Amplitudes of the r residual patterns of M4, shape (steps, r) [Pa]; r may be 0."""
        return np.asarray(self.values.get("state/quasi_static", np.zeros((len(self), 0))))

    @property
    def pressures(self) -> dict[str, np.ndarray]:
        """Nodal pressures of every film, by name of the joint, shape (steps, nodes) each [Pa].

        The dictionary is empty if the history was read without films.
        """
        parts = [(path.split("/"), v) for path, v in self.values.items()]
        films = {path[1]: np.asarray(v) for path, v in parts if path[2:] == ["film", "pressure"]}
        return Named(films, "result.pressures")

    def summary(self) -> Mapping[str, Any]:
        """Entries of ``summary.json``; empty if the run is in progress or was killed."""
        return Summary(self.entries)

    @property
    def status(self) -> str:
        """Status of the run: ``"complete"``, or why its results are rejected or missing."""
        return str(
            self.entries.get(
                "status", "no summary found: the run is in progress or was interrupted"
            )
        )

    @property
    def figures(self) -> Mapping[str, Mapping[str, Any]]:
        """Extremes and means in the summary of every lubricated joint, by name of the joint."""
        return Named(self.entries.get("joints", {}), "result.figures")

    @property
    def cycles(self) -> int:
        """Number of cycles of a search for a periodic solution; 0 for other runs."""
        return int(self.entries.get("cycles", 0))

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """Columns of ``history.csv`` by name with unit, such as ``big_end.max_pressure_Pa``."""
        columns = Columns(
            (with_unit(column_name(path), quantity.units), np.asarray(quantity))
            for path, quantity in self.values.items()
            if is_column(path)
        )
        columns.joints = self._owners("joints", self.values)
        return columns

    def to_dataframe(self) -> DataFrame:
        """Return `columns` as a pandas table with the index ``time_s``.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        pandas = _wanted("pandas", "to_dataframe")
        columns = {name: v for name, v in self.columns.items() if name != "time_s"}
        return pandas.DataFrame(columns, index=pandas.Index(np.asarray(self.time), name="time_s"))

    def to_xarray(self) -> Dataset:
        """Return all columns as an xarray dataset over the time, with their units as attributes.

        Raises
        ------
        InputError
            If xarray is not installed.
        """
        xarray = _wanted("xarray", "to_xarray")
        columns = {name: self[name] for name in self.names} | {"time": self.time}
        return xarray.Dataset(
            {name: ("time", np.asarray(v), {"units": v.units}) for name, v in columns.items()}
        )

    def plot(self, quantity: str) -> Figure:
        """Draw a quantity, or any column of a joint, over the last cycle.

        The name is that of the column, such as ``"big_end.min_film_thickness"``. See
        `fenics_ehd.plot`, which draws several runs.
        """
        from fenics_ehd import plot

        return plot(self, quantity)

    def plot_orbit(self, joint: str) -> Figure:
        """Draw the orbit of the journal of a lubricated joint over the last cycle."""
        return self.plot(f"{joint}.orbit")

    def plot_map(self, joint: str, field: str = "pressure") -> Figure:
        """Draw a map over the bore of a lubricated joint for the last cycle.

        Parameters
        ----------
        joint
            Name of the joint.
        field
            ``"pressure"`` for the largest pressure, ``"film"`` for the least film thickness, or
            ``"contact"`` for the mean contact pressure.
        """
        require_word("field", field, MAPS)
        return self.plot(f"{joint}.{field}_map")

    def described(self) -> Iterator[tuple[str, str]]:
        """Yield scene, status, steps, bodies, and the extremes of every lubricated joint."""
        yield "History", f"of {self.entries.get('scene') or self.folder or 'a mechanism'}"
        yield "status", self.status
        yield "steps", f"{len(self)}, {np.min(self.time):.4g} to {np.max(self.time):.4g} s"
        yield "bodies", names_or_none(self.bodies)
        yield "columns", f"{len(self.names)}: see names, result[NAME]; of joints: result.plot(NAME)"
        for name in self._owners("joints", self.values):
            yield name, self._extremes(name)

    def _extremes(self, joint: str) -> str:
        """Peak pressure and minimum film thickness of a joint in the summary, with their errors."""
        figures = self.figures.get(joint, {})
        budget = figures.get("error_budget", {})
        texts = []
        for label, name, factor, unit in SHOWN_EXTREMES:
            value = figures.get(name)
            if isinstance(value, int | float):
                error = budget.get(label, {}).get("total")
                bound = f" ± {100 * error:.2g} %" if isinstance(error, float) else ""
                texts.append(f"{label} {factor * value:.4g} {unit}{bound}")
        return ", ".join(texts) or "lubricated"

    def each(self, change: Callable[[np.ndarray], np.ndarray]) -> Self:
        """Return a history with `change` applied to every array over the steps."""
        return self.changed({path: change(v) for path, v in self.values.items() if not fixed(path)})

    def changed(self, arrays: Mapping[str, np.ndarray]) -> Self:
        """Return a history in which `arrays`, by path, replace arrays; units do not change."""
        changed = {path: Quantity(array, self.values[path].units) for path, array in arrays.items()}
        return replace(self, values={**self.values, **changed})

    @property
    def cycle(self) -> Cycle:
        """Last complete cycle: as stored with the run, else from its summary or its columns."""
        if self.stored_cycle is not None:
            return self.stored_cycle
        columns = (self.values.get(f"run/{name}") for name in ("cycle", "cycle_time"))
        numbers, clock = (None if array is None else np.asarray(array) for array in columns)
        times = np.asarray(self.values["time"])
        return Cycle.of_summary(self.entries) or Cycle.of_stored_columns(times, numbers, clock)

    def last_cycle(self) -> History:
        """Return a history of the last complete cycle (`cycle`), or all steps if there is none.

        Entries ``cycle_...`` of the summary are those of this cycle. The step at the start of the
        cycle is included if the history has this step.
        """
        numbers = self.values.get("run/cycle")
        rows = self.cycle.rows_from_start(np.asarray(self.values["time"]), numbers)
        return self.each(lambda values: values[rows])

    def angle_of(self, body: str) -> np.ndarray | None:
        """Angle of a body at every step, continuous, shape (steps,) [degrees].

        It is the run's reference angle, `run.crank_angle`, if the body turns with it; the angle of
        any other body begins between 0 and 360 degrees. None for a body without an angle, and
        without columns of bodies.

        Raises
        ------
        UnknownNameError
            If the history has columns of bodies, but none of this one.
        """
        known = self._body_names
        if known and body not in known:
            raise unknown_name("result.bodies", body, known)
        radians = self.values.get(f"bodies/{body}/angle")
        if radians is None:
            return None
        angle = np.degrees(np.asarray(radians))
        reference = self.run.get("crank_angle")
        if reference is not None and len(angle):
            turns = (angle - reference) / 360.0
            if np.abs(turns - np.round(turns[0])).max() < TURN_ROUNDING:
                return np.asarray(reference)
        return angle - 360.0 * np.floor(angle[:1] / 360.0 + TURN_ROUNDING)

    def with_start(self) -> History:
        """Return this periodic cycle with a row at its start, computed from the row at its end."""
        turning = np.array([name.endswith("/angle") for name in self.coordinate_names], bool)
        turns = {path: 2 * np.pi for path in self.values if re.fullmatch("bodies/.*/angle", path)}
        turns |= {"run/crank_angle": 360.0, "state/coordinates": 2 * np.pi}
        clock = np.asarray(self.values["run/cycle_time"])
        arrays = {}
        for path, quantity in self.values.items():
            if fixed(path):
                continue
            start = np.array(quantity[-1])
            if path in turns:
                change = turns[path] * np.round((quantity[-1] - quantity[0]) / turns[path])
                start -= change * turning if path == "state/coordinates" else change
            elif path == "time":
                start -= clock[-1]
            elif path.endswith("_work") or path in ("run/energy_defect", "run/cycle_time"):
                start = np.zeros_like(start)
            arrays[path] = np.concatenate([start[None], quantity])
        return self.changed(arrays)

    def save(self, folder: str | Path) -> None:
        """Write ``history.h5``, ``history.csv`` and ``summary.json``, each complete or not at all.

        Parameters
        ----------
        folder
            Folder of the files, which is made if it does not exist.

        Raises
        ------
        OutputError
            If a file cannot be written.
        """
        require_class("folder", folder, str, Path)
        folder = Path(folder)
        with naming(folder):
            folder.mkdir(parents=True, exist_ok=True)
        self.write(folder / FIELDS_NAME, PACKED)
        self.write_columns(folder / CSV_NAME)
        if self.entries:
            write_summary(folder, self.entries)

    def write_columns(self, path: Path) -> None:
        """Write all columns to a file ``history.csv``, with ten digits.

        Raises
        ------
        OutputError
            If the file cannot be written; an existing file is then unchanged.
        """
        columns = self.columns
        rows = np.column_stack([*columns.values()])
        lines = [csv_line([*columns]), *(csv_line([f"{x:.10g}" for x in row]) for row in rows)]
        write_whole(path, b"".join(lines))

    def write(
        self,
        path: Path,
        packing: Mapping[str, Any] | None = None,
        state: Mapping[str, Any] | None = None,
    ) -> None:
        """Write everything except the summary to a file ``history.h5``.

        Parameters
        ----------
        path, packing
            Path of the file, and options of h5py that compress fields; None: no compression.
        state
            State from which the run can be resumed, a tree for `put_tree`; None: not stored.

        Raises
        ------
        OutputError
            If the file cannot be written; an existing file is then unchanged.
        """
        with sealed_hdf5(path, FORMAT, FORMAT_VERSION) as file:
            if state is not None:
                put_tree(file.create_group(RESUME), state)
            if len(self):
                attributes = vars(self.cycle) | {"label": _text(self.cycle.label)}
                file.create_group(CYCLE).attrs.update(attributes)
            file.attrs["fenics_ehd"] = _text(__version__)
            file.attrs["columns"] = _text([name for name in self.values if is_column(name)])
            for name, v in self.values.items():
                how = packing if packing and v.ndim == 2 and not fixed(name) else {}
                data = file.create_dataset(name, data=np.asarray(v), **how)
                data.attrs["units"] = _text(v.units)
            for name, over in (("state/coordinates", ""), ("state/rates", "/s")):
                units = [f"{unit}{over}" for unit in self.coordinate_units]
                file[name].attrs["names"] = _text([*self.coordinate_names])
                file[name].attrs["units"] = _text(units)


def _wanted(package: str, method: str) -> Any:
    """Import an optional package that one method needs.

    Raises
    ------
    InputError
        If the package is not installed; the message names the method.
    """
    try:
        return import_module(package)
    except ImportError:
        raise InputError(
            f"{method} needs {package}, which is not installed (python3-{package} on Debian): "
            "install it, or use History.columns, a dictionary of arrays"
        ) from None


def _text(value: str | list[str]) -> np.ndarray:
    """Text of fixed length, because HDF5 has no checksums for other text.

    HDF5 would crash when it reads damaged text of variable length.
    """
    return np.char.encode(np.array(value, dtype=str), "utf-8")


def missing(path: Path, lacks: str) -> str:
    """Reason for a missing file: ``no such folder``, or else `lacks` and the name of the file."""
    return f"{lacks} {path.name}" if path.parent.is_dir() else "no such folder"


@contextmanager
def opened_history(path: Path, refused: str) -> Iterator[h5py.File]:
    """Open ``history.h5`` of a run for reading, after its seal is checked.

    Raises
    ------
    InputError
        If the file is no history, or reading it fails; the message has the path, `refused` and the
        reason.
    """
    remedy = f"run the scene anew, or read {CSV_NAME} in its folder"
    with (
        named(InputError, f"{path}: {refused}"),
        open_sealed(path, FORMAT, FORMAT_VERSION, remedy=remedy, former=READ_VERSIONS) as file,
    ):
        yield file


def require_present_format(file: h5py.File) -> None:
    """Refuse to continue a history of an earlier version, which can only be read.

    Raises
    ------
    ValueError
        If the version differs; the message has the version that made the file.
    """
    if file.attrs["format_version"] != FORMAT_VERSION:
        version = attribute(file, "fenics_ehd", Value("text"))
        raise ValueError(
            f"the history was written by version {version}, and version {__version__} cannot "
            "continue it: run the scene again"
        )


def load_history(directory: str | Path, *, films: bool = True) -> History:
    """Read the history of a run that is complete, interrupted, failed, killed or in progress.

    Parameters
    ----------
    directory
        Folder of the run.
    films
        Whether to read pressures and gaps at all nodes, which are most of the file.

    Returns
    -------
    History
        Steps up to the last checkpoint. Of a search for a periodic solution, steps of the last
        cycle if the search is complete, else of the last two cycles.

    Raises
    ------
    InputError
        If the folder has no run with at least one step, or files are damaged or of an unknown
        version.
    """
    require_class("directory", directory, str, Path)
    folder = Path(directory)
    path = folder / FIELDS_NAME
    summary = read_summary(folder)
    scene = _scene(folder)
    if not path.exists():
        raise InputError(f"{folder}: {missing(path, 'not a results folder, it has no')}")
    with opened_history(path, "not a history of a run") as file:
        arrays = _read(file, films)
        state = file["state/coordinates"]
        each = Value("text", (state.shape[1],))
        names, units = (attribute(state, name, each) for name in ("names", "units"))
        cycle = Cycle(**read_declared(file[CYCLE], Cycle.layout)) if CYCLE in file else None
        return History(arrays, names, units, summary, scene, cycle, folder=folder)


#: Name of the function in version 0.2.
load_results = load_history


def _read(file: h5py.File, films: bool) -> dict[str, Quantity]:
    """Read all arrays of a history by path, columns in the order of ``history.csv``."""
    columns = attribute(file, "columns", Value("text", ("columns",)))
    LAYOUT.check(file, "", {})
    every: list[str] = []
    file.visit(every.append)
    paths = [path for path in every if isinstance(file[path], h5py.Dataset)]
    absent = [path for path in columns if path not in paths]
    if absent:
        raise ValueError(f"/{absent[0]} is missing")
    arrays = {}
    for path in dict.fromkeys([*columns, *paths]):
        if path.startswith((f"{RESUME}/", f"{CYCLE}/")) or not (films or not of_film(path)):
            continue
        data = file[path]
        # Coordinates and rates have one unit for every column.
        mixed = path in STATE_IN_UNITS
        units = MIXED if mixed else attribute(data, "units", Value("text"))
        array = np.asarray(values(data))
        LAYOUT.value_at(path).require_content(array, f"/{path}")
        arrays[path] = Quantity(array, units)
    _require_cells(arrays)
    return arrays


def _require_cells(arrays: Mapping[str, np.ndarray]) -> None:
    """Refuse films whose cells have an unknown number of nodes or do not cover all nodes."""
    for path, cells in arrays.items():
        if not path.endswith("/film/cells"):
            continue
        nodes = len(arrays[path.replace("/cells", "/angle")])
        used = np.unique(cells)
        if cells.shape[1] not in FAMILIES or not np.array_equal(used, np.arange(nodes)):
            raise ValueError(
                f"/{path} has the shape {cells.shape}, or indices that do not fit {nodes} nodes"
            )


def _scene(folder: Path) -> dict[str, Any]:
    path = folder / SCENE_NAME
    if not path.exists():
        return {}
    with named(InputError, f"{path}: not a scene"):
        return tomllib.loads(read_text(path))
