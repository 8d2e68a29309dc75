"""Checkpoints: nested dictionaries of arrays and numbers in one HDF5 file, whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from fenics_ehd.errors import InputError
from fenics_ehd.history_file import HistoryWriter, read_fields, read_history
from fenics_ehd.sealed_file import named, open_sealed, read_tree, require_like, save_tree

if TYPE_CHECKING:  # slow to import
    from fenics_ehd.multibody.bdf import IntegratorState

CHECKPOINT = "checkpoint.h5"
FORMAT = "fenics_ehd checkpoint"
FORMAT_VERSION = 1

#: What every checkpoint holds; the rest is the machine's.
PATTERN = {
    "rows": 0,
    "reduction_seconds": 0.0,
    "scene": {},
    "memory": {"totals": {"steps": 0}, "integrator": {}},
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


def load_progress(folder: Path) -> dict[str, Any]:
    """The checkpoint of a run, which its history must reach.

    Raises
    ------
    InputError
        See `load_checkpoint`; or there is no history, or the state of the checkpoint is not in it.
    """
    tree = load_checkpoint(folder / CHECKPOINT)
    with named(InputError, f"{folder / CHECKPOINT}: no checkpoint to go on from"):
        require_like(tree, PATTERN)
        rows, memory = tree["rows"], tree["memory"]
        times = read_history(folder)["time_s"]
        # A loaded journal's coordinates are those of its shaft alone.
        fields = read_fields(folder, ("coordinates", "eccentricity_m"), optional=True)
        (coordinates,) = fields.values()
        found = [len(values) for values in (times, coordinates)]
        if not 0 < rows <= min(found):
            raise ValueError(f"it counts {rows} steps, the history has {min(found)}: start anew")
        row, x = coordinates[rows - 1], memory["integrator"]["x"][0]
        if rows != memory["totals"]["steps"] or not np.array_equal(row, x[: len(row)]):
            raise ValueError(f"it is not of step {rows} of the history: start anew")
    return tree


class Stored(Protocol):
    """A run that can be stored: frozen states, one after the other, and what goes with them."""

    @property
    def integrator(self) -> IntegratorState:
        """The state it is in."""

    def memory(self) -> dict[str, Any]:
        """As nested dictionaries of arrays, numbers and text."""


class Checkpoints:
    """Stores a run every so often, after its history, and where it ends.

    Parameters
    ----------
    history
        Of the run; it is put on the disk before each checkpoint, which counts its rows.
    interval
        Seconds between two checkpoints; the first one is due at once.
    figures
        Stored along with each.
    """

    def __init__(self, history: HistoryWriter, interval: float, figures: Mapping[str, Any]):
        self._history, self._interval, self._figures = history, interval, figures
        self._last = -inf
        self._run: Stored | None = None

    def follow(self, run: Stored) -> None:
        """Account for a step whose row is in the history."""
        self._run, self._state = run, run.integrator
        if monotonic() - self._last >= self._interval:
            self._save(run)

    def __enter__(self) -> Checkpoints:
        return self

    def __exit__(self, *_: object) -> None:
        # In the middle of a step, by a second Ctrl-C say, there is nothing to go on from.
        if self._run is not None and self._run.integrator is self._state:
            self._save(self._run)

    def _save(self, run: Stored) -> None:
        self._history.sync()
        tree = {**self._figures, "rows": self._history.rows, "memory": run.memory()}
        save_checkpoint(self._history.directory / CHECKPOINT, tree)
        self._last = monotonic()
