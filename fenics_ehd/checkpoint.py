"""Checkpoints: nested dictionaries of arrays and numbers in one HDF5 file, whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from time import monotonic
from typing import Any

import h5py
import numpy as np

from fenics_ehd.errors import InputError
from fenics_ehd.history_file import HistoryWriter, sync_path

CHECKPOINT = "checkpoint.h5"


def save_checkpoint(path: str | Path, tree: Mapping[str, Any]) -> None:
    """Write a checkpoint aside, put it on the disk and rename it over the former one.

    Parameters
    ----------
    path
        File.
    tree
        Dictionaries of dictionaries, arrays, numbers and text.
    """
    path = Path(path)
    partial = path.with_suffix(".part")
    with h5py.File(partial, "w") as file:
        _write(file, tree)
    sync_path(partial)
    partial.replace(path)
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


class Checkpoints:
    """Stores a run every so often, after its history.

    Parameters
    ----------
    history
        Of the run; it is put on the disk before each checkpoint, which counts its rows.
    interval
        Seconds between two checkpoints.
    figures
        Stored along with each.
    """

    def __init__(self, history: HistoryWriter, interval: float, figures: Mapping[str, Any]):
        self._history, self._interval, self._figures = history, interval, figures
        self._last = monotonic()

    def due(self) -> bool:
        """Whether it is time for another one."""
        return monotonic() - self._last >= self._interval

    def save(self, memory: Mapping[str, Any]) -> None:
        """Store a run now."""
        self._history.sync()
        tree = {**self._figures, "rows": self._history.rows, "memory": memory}
        save_checkpoint(self._history.directory / CHECKPOINT, tree)
        self._last = monotonic()
