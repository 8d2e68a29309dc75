"""Checkpoints: nested dictionaries of arrays and numbers in one HDF5 file, whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fenics_ehd.base.errors import InputError
from fenics_ehd.base.sealed_file import named, open_sealed, read_tree, require_like, save_tree
from fenics_ehd.results.history_file import read_fields

CHECKPOINT = "checkpoint.h5"
FORMAT = "fenics_ehd checkpoint"
FORMAT_VERSION = 1

#: What every checkpoint holds; the rest is the machine's.
PATTERN = {
    "rows": 0,
    "reduction_seconds": 0.0,
    "name": "",
    "scene": {},
    "state": {"totals": {"steps": 0}, "integrator": {}},
}


def save_checkpoint(path: str | Path, tree: Mapping[str, Any]) -> None:
    """Write a checkpoint aside, put it on the disk and rename it over the former one.

    Parameters
    ----------
    path
        File.
    tree
        Dictionaries of dictionaries, arrays, numbers and text.

    Raises
    ------
    OutputError
        It cannot be written; the former one stays.
    """
    save_tree(path, tree, FORMAT, FORMAT_VERSION)


def load_checkpoint(path: str | Path) -> dict[str, Any]:
    """The tree of a checkpoint: arrays, and Python numbers and text in place of scalars.

    Raises
    ------
    InputError
        There is no checkpoint, or the file is none, or it changed since it was written.
    """
    folder = Path(path).parent
    if not Path(path).exists():
        missing = "no such folder" if not folder.is_dir() else f"it has no {Path(path).name}"
        raise InputError(f"{folder}: no checkpoint to go on from, {missing}")
    with (
        named(InputError, f"{path}: no checkpoint to go on from"),
        open_sealed(path, FORMAT, FORMAT_VERSION, remedy="run the scene anew") as file,
    ):
        return read_tree(file)


def load_run_state(folder: Path) -> dict[str, Any]:
    """The checkpoint of a run, which its history must reach.

    Raises
    ------
    InputError
        See `load_checkpoint`; or there is no history, or the state of the checkpoint is not in it.
    """
    tree = load_checkpoint(folder / CHECKPOINT)
    with named(InputError, f"{folder / CHECKPOINT}: no checkpoint to go on from"):
        require_like(tree, PATTERN)
        rows, state = tree["rows"], tree["state"]
        fields = read_fields(folder, ("time", "state/coordinates"))
        coordinates = fields["state/coordinates"]
        found = [len(values) for values in fields.values()]
        if not 0 < rows <= min(found):
            raise ValueError(f"it counts {rows} steps, the history has {min(found)}: start anew")
        row, x = coordinates[rows - 1], state["integrator"]["x"][0]
        if rows != state["totals"]["steps"] or not np.array_equal(row, x[: len(row)]):
            raise ValueError(f"it is not of step {rows} of the history: start anew")
    return tree
