"""Checkpoints: nested dictionaries of arrays and numbers in one HDF5 file, whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, Protocol

import h5py
import numpy as np

from fenics_ehd.errors import InputError
from fenics_ehd.history_file import HistoryWriter, sync_path
from fenics_ehd.whole_file import whole_hdf5

if TYPE_CHECKING:  # slow to import
    from fenics_ehd.multibody.bdf import IntegratorState

CHECKPOINT = "checkpoint.h5"


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
    path = Path(path)
    with whole_hdf5(path) as file:
        _write(file, tree)
    sync_path(path.parent)


def _write(group: h5py.Group, tree: Mapping[str, Any]) -> None:
    for name, value in tree.items():
        if isinstance(value, Mapping):
            _write(group.create_group(name), value)
        else:
            group[name] = value


def load_checkpoint(path: str | Path) -> dict[str, Any]:
    """The tree of a checkpoint: arrays, and Python numbers and text in place of scalars.

    Raises
    ------
    InputError
        There is no checkpoint, or the file is none.
    """
    try:
        with h5py.File(path, "r") as file:
            return _read(file)
    except FileNotFoundError:
        folder = Path(path).parent
        missing = "no such folder" if not folder.is_dir() else f"it has no {Path(path).name}"
        raise InputError(f"{folder}: no checkpoint to go on from, {missing}") from None
    except OSError as error:
        reason = error.strerror or str(error).splitlines()[0]
        raise InputError(f"{path}: no checkpoint to go on from ({reason})") from None


def _read(group: h5py.Group) -> dict[str, Any]:
    tree: dict[str, Any] = {}
    for name, item in group.items():
        if isinstance(item, h5py.Group):
            tree[name] = _read(item)
            continue
        value = item[()]
        if isinstance(value, bytes):
            value = value.decode()
        tree[name] = value.item() if isinstance(value, np.generic) else value
    return tree


class Stored(Protocol):
    """A run that can be stored: frozen states, one after the other, and what goes with them."""

    integrator: IntegratorState

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
