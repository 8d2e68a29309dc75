"""A run read from its folder, as the object that a run in memory answers with."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import h5py

from fenics_ehd.base.columns import Quantity
from fenics_ehd.base.errors import InputError
from fenics_ehd.base.output import SCENE_NAME, SUMMARY
from fenics_ehd.base.sealed_file import named
from fenics_ehd.base.text_file import read_json, read_text
from fenics_ehd.multibody.history_layout import assemble_result
from fenics_ehd.multibody.result import Result
from fenics_ehd.results.history_file import finite, numbers, opened_history

#: What a film has once.
MESH = ("angle", "height", "cells")

#: In place of one unit where every column has its own, in the attribute ``units`` of the file.
MIXED = "mixed"


def load_results(directory: str | Path, *, films: bool = True) -> Result:
    """Results of a run: complete, interrupted, failed, killed, or one that goes on.

    Parameters
    ----------
    directory
        Of the run.
    films
        Whether to read pressures and gaps at all nodes, most of the file.

    Returns
    -------
    Result
        All steps on the disk; of a complete periodic run those of its last cycle.

    Raises
    ------
    InputError
        The folder holds no run of at least one step, or files that are damaged or of another
        version.
    """
    folder = Path(directory)
    summary = _summary(folder)
    with opened_history(folder) as file:
        values = _read(file, films)
        steps = {len(found) for path, found in values.items() if not _fixed(path)}
        if summary and len(steps) > 1:
            raise ValueError(f"its arrays have {min(steps)} to {max(steps)} steps")
        values = _cut(values, min(steps))
        names = [name.decode() for name in file["state/coordinates"].attrs["names"]]
        return assemble_result(
            values, names, _films(file) if films else {}, summary, _scene(folder)
        )


def _read(file: h5py.File, films: bool) -> dict[str, Quantity]:
    """Every array of a history by path."""
    values: dict[str, Quantity] = {}

    def read(path: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and (films or not _of_film(path)):
            values[path] = _quantity(path, item)

    file.visititems(read)
    return values


def _quantity(path: str, data: h5py.Dataset) -> Quantity:
    # Of quantities, one that was not computed is nan.
    strict = path == "time" or path.startswith("state/") or _of_film(path)
    values = finite(data) if strict else numbers(data)
    if values.dtype.kind == "f":
        values = values.astype(float, copy=False)
    units = data.attrs["units"]
    return Quantity(values, units.decode() if isinstance(units, bytes) else MIXED)


def _films(file: h5py.File) -> dict[str, dict[str, Any]]:
    """Family and sizes of the film of every joint."""
    found = {}
    for joint in file.get("joints", ()):
        told = file[f"joints/{joint}/film"].attrs
        sizes = {name: float(told[name]) for name in ("radius", "clearance")}
        found[joint] = {"family": told["family"].decode(), **sizes}
    return found


def _of_film(path: str) -> bool:
    """Whether a dataset is of the nodes of a film, ``joints/NAME/film/pressure``."""
    return path.count("/") == 3


def _fixed(path: str) -> bool:
    """Whether it does not change from step to step."""
    return _of_film(path) and path.rpartition("/")[2] in MESH


def _cut(values: dict[str, Quantity], steps: int) -> dict[str, Quantity]:
    """The steps that all arrays have: of a run that was killed some may be longer."""
    if not steps:
        raise ValueError("no steps")
    return {
        path: found if _fixed(path) else Quantity(found[:steps], found.units)
        for path, found in values.items()
    }


def _summary(folder: Path) -> dict[str, Any]:
    """Of the folder, empty where there is none yet."""
    path = folder / SUMMARY
    if not path.exists():
        return {}
    with named(InputError, f"{path}: not a summary of a run"):
        found = read_json(path)
        if not isinstance(found, dict):
            raise ValueError("not an object")
        return _with_nan(found)


def _with_nan(value: Any) -> Any:
    """JSON has null for numbers that are not finite."""
    if isinstance(value, dict):
        return {name: _with_nan(entry) for name, entry in value.items()}
    return float("nan") if value is None else value


def _scene(folder: Path) -> dict[str, Any]:
    path = folder / SCENE_NAME
    if not path.exists():
        return {}
    with named(InputError, f"{path}: not a scene"):
        return tomllib.loads(read_text(path))
