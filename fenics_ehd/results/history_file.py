"""History and checkpoints of a run on disk.

``history.csv`` grows row by row. ``history.h5`` and the checkpoint are written now and then, each
whole in place of the former one, so that both can be read at any moment, also after the writer was
killed. A run that goes on begins after the step of its last checkpoint and repeats those since.

What ``history.h5`` holds, and where, is in ``docs/results.md``. A checkpoint is nested
dictionaries of arrays and numbers in one sealed HDF5 file.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from io import FileIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fenics_ehd.base.columns import Quantity, csv_line
from fenics_ehd.base.errors import InputError
from fenics_ehd.base.files import (
    SCENE_NAME,
    SUMMARY,
    naming,
    read_json,
    read_text,
    write_whole,
)
from fenics_ehd.base.sealed_file import (
    named,
    open_hdf5,
    open_sealed,
    read_tree,
    require_numbers,
    save_tree,
)
from fenics_ehd.multibody.history import (
    CSV_NAME,
    FIELDS_NAME,
    FORMAT_VERSION,
    MIXED,
    History,
    of_film,
)


class CsvFile:
    """Append-only rows, after as many of a former run.

    Raises
    ------
    InputError
        With the first row: the file is not that of the former run.
    OutputError
        It cannot be written; all rows before stay, and can be read.
    """

    def __init__(self, path: Path, rows: int):
        self._path, self._rows = path, rows
        self._file: FileIO | None = None

    def write(self, row: Mapping[str, float]) -> None:
        """The next row, by names of columns."""
        if self._file is None:
            self._file = self._begun(csv_line([*row]))
        line = csv_line([f"{value:.10g}" for value in row.values()])
        with naming(self._path):
            while line:
                line = line[self._file.write(line) :]

    def _begun(self, header: bytes) -> FileIO:
        """The file with its header and the rows before."""
        lines = [header]
        if self._rows:
            lines = self._path.read_bytes().splitlines(keepends=True)[: 1 + self._rows]
            # A killed writer may have left its last row unfinished.
            if len(lines) <= self._rows or lines[0] != header or lines[-1][-1:] != b"\n":
                raise InputError(
                    f"{self._path}: not the history of the run to go on with: start anew"
                )
        write_whole(self._path, b"".join(lines))
        # Without a buffer, which would be written once more when there is no room for it.
        return open(self._path, "ab", buffering=0)


CHECKPOINT = "checkpoint.h5"
CHECKPOINT_FORMAT = "fenics_ehd checkpoint"
CHECKPOINT_VERSION = 4


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
    save_tree(path, tree, CHECKPOINT_FORMAT, CHECKPOINT_VERSION)


def load_checkpoint(path: str | Path) -> dict[str, Any]:
    """The tree of a checkpoint: arrays, and Python numbers and text in place of scalars.

    Raises
    ------
    InputError
        There is no checkpoint, or the file is none, or it changed since it was written.
    """
    folder = Path(path).parent
    if not Path(path).exists():
        missing = _missing(Path(path), "it has no")
        raise InputError(f"{folder}: no checkpoint to go on from, {missing}")
    with (
        named(InputError, f"{path}: no checkpoint to go on from"),
        open_sealed(
            path, CHECKPOINT_FORMAT, CHECKPOINT_VERSION, remedy="run the scene anew"
        ) as file,
    ):
        return read_tree(file)


def _missing(path: Path, lacks: str) -> str:
    """Explanation of a missing file of a run."""
    return f"{lacks} {path.name}" if path.parent.is_dir() else "no such folder"


def load_history(directory: str | Path, *, films: bool = True) -> History:
    """History of a run: complete, interrupted, failed, killed, or one that goes on.

    Parameters
    ----------
    directory
        Of the run.
    films
        Whether to read pressures and gaps at all nodes, most of the file.

    Returns
    -------
    History
        Steps up to the last checkpoint; of a periodic run that is complete its last cycle, of
        another the last two.

    Raises
    ------
    InputError
        The folder holds no run of at least one step, or files that are damaged or of another
        version.
    """
    folder, path = Path(directory), Path(directory) / FIELDS_NAME
    summary, scene = _summary(folder), _scene(folder)
    if not path.exists():
        raise InputError(f"{folder}: {_missing(path, 'not a results folder, it has no')}")
    with named(InputError, f"{path}: not a history of a run"), open_hdf5(path) as file:
        version = file.attrs.get("format_version", 1)
        if version != FORMAT_VERSION:
            raise InputError(
                f"{path}: a history of layout {version}, this program reads {FORMAT_VERSION}: run "
                f"the scene anew, or read {CSV_NAME} beside it"
            )
        # HDF5 1.14 reads zeros beyond the end of a file that was cut off.
        whole, size = file.id.get_filesize(), path.stat().st_size
        if size < whole:
            raise OSError(f"it ends after {size} of {whole} bytes")
        state = file["state/coordinates"].attrs
        names, units = (tuple(text.decode() for text in state[n]) for n in ("names", "units"))
        return History(_read(file, films), names, units, summary, scene)


#: Its name in version 0.2.
load_results = load_history


def _read(file: h5py.File, films: bool) -> dict[str, Quantity]:
    """Every array of a history by path, columns in their order."""
    paths = [path.decode() for path in file.attrs["columns"]]
    file.visit(paths.append)
    found = {}
    for path in dict.fromkeys(paths):
        data = file[path]
        if isinstance(data, h5py.Dataset) and (films or not of_film(path)):
            require_numbers(data)
            units = data.attrs["units"]
            # One for every column, of the state.
            mixed = isinstance(units, np.ndarray)
            found[path] = Quantity(np.array(data), MIXED if mixed else units.decode())
    return found


def _summary(folder: Path) -> dict[str, Any]:
    """Summary of the folder, empty where there is none yet."""
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
