"""The history of a run on disk: ``history.csv`` row by row, fields in ``history.h5``.

Both files are only ever appended to, and can be read at any moment, also after the writer
was killed: rows of the CSV are whole lines, and HDF5 writes in its single-writer mode. A run
that goes on repeats the steps since its last checkpoint; rows that are there already are the
same to the last bit and are kept.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

import h5py
import numpy as np

from fenics_ehd.errors import InputError
from fenics_ehd.sealed_file import named, require_file, require_numbers, sync_path

#: Rows of the HDF5 datasets written between two flushes to disk.
FLUSH_EVERY = 50

CSV_NAME, FIELDS_NAME = "history.csv", "history.h5"

#: First columns of every history.
FIRST_COLUMNS = ["time_s", "max_pressure_Pa", "min_film_thickness_m"]


#: Where the film of a failed solve is kept.
FAILED_FILM = "failed_film.h5"

#: Files of a run, beside the history itself, that a new run in the same folder makes stale.
STALE = (
    "summary.json",
    "checkpoint.h5",
    "max_pressure.*",
    "min_film_thickness.*",
    "energy.*",
    "basis_error.*",
    "orbit.*",
    "animation.*",
    FAILED_FILM,
    "vtk/*.pvd",
    "vtk/*_[0-9][0-9][0-9][0-9].vtu",
)


class HistoryWriter:
    """Writes ``history.csv`` and ``history.h5`` while a run goes on.

    The files are made with the first step, which says what they hold, so that a run
    that cannot start leaves the results of a former one alone.

    Parameters
    ----------
    directory
        Created when missing; files of a former run are replaced.
    constants
        Arrays stored once.
    resumed
        Rows of a former run to go on after; None: a new run.
    """

    def __init__(
        self,
        directory: str | Path,
        constants: Mapping[str, np.ndarray],
        *,
        resumed: int | None = None,
    ):
        self.directory = Path(directory)
        self._constants = constants
        self._resumed = resumed
        self._count = resumed or 0
        self._csv: _CsvFile | None = None
        self._file: h5py.File | None = None

    @property
    def started(self) -> bool:
        """Whether there is a step in the files."""
        return self._count > 0

    @property
    def rows(self) -> int:
        """Steps of the run so far."""
        return self._count

    def add(self, row: Mapping[str, float], fields: Mapping[str, np.ndarray]) -> None:
        """Append one accepted step."""
        if self._csv is None:
            self._open(list(row), {name: len(values) for name, values in fields.items()})
        assert self._csv is not None
        assert self._file is not None
        self._csv.write(self._count, [f"{value:.10g}" for value in row.values()])
        for name, values in fields.items():
            data = self._file[name]
            if len(data) <= self._count:
                data.resize(self._count + 1, axis=0)
            data[self._count] = values
        self._count += 1
        if self._count % FLUSH_EVERY == 0:
            self._file.flush()

    def sync(self) -> None:
        """Put all rows on the disk itself."""
        if self._csv is not None and self._file is not None:
            self._csv.sync()
            self._file.flush()
            sync_path(self.directory / FIELDS_NAME)

    def _open(self, names: list[str], lengths: Mapping[str, int]) -> None:
        path = self.directory / FIELDS_NAME
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            if self._resumed is None:
                for pattern in STALE:
                    for old in self.directory.glob(pattern):
                        old.unlink()
            # HDF5 first: it also fails when another program has the file open.
            if self._resumed is None:
                self._file = self._new_fields(
                    path, {n: np.empty((0, k)) for n, k in lengths.items()}
                )
            else:
                self._file = self._copied(path, tuple(lengths))
            self._csv = _CsvFile(self.directory / CSV_NAME, names, self._resumed)
        except OSError as error:
            reason = error.strerror or str(error).splitlines()[0]
            raise InputError(f"output directory {self.directory}: {reason}") from None
        self._file.swmr_mode = True

    def _new_fields(self, path: Path, rows: Mapping[str, np.ndarray]) -> h5py.File:
        file = h5py.File(path, "w", libver="latest")
        for name, values in self._constants.items():
            file[name] = values
        for name, data in rows.items():
            length = data.shape[1]
            file.create_dataset(
                name, data=data, maxshape=(None, length), chunks=(64, max(length, 1)), dtype="f8"
            )
        return file

    def _copied(self, path: Path, names: tuple[str, ...]) -> h5py.File:
        """A killed writer leaves its file marked as open: go on in a copy."""
        former = read_fields(self.directory, names)
        short = min(len(values) for values in former.values())
        if short < self._count:
            raise InputError(
                f"{path}: holds {short} steps, its checkpoint {self._count}: start anew"
            )
        partial = path.with_suffix(".part")
        file = self._new_fields(partial, former)
        file.flush()
        partial.replace(path)
        return file

    def __enter__(self) -> HistoryWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._file is not None:
            self._file.close()
        if self._csv is not None:
            self._csv.close()


class _CsvFile:
    """Append-only rows; those of a former run are compared with, not written again."""

    def __init__(self, path: Path, names: list[str], resumed: int | None):
        self._former: list[bytes] = []
        if resumed is None:
            self._file: BinaryIO = open(path, "wb")
            self._write(names)
            return
        self._file = open(path, "r+b")
        lines = self._file.read().splitlines(keepends=True)
        # A killed writer may have left its last row unfinished.
        whole = [line for line in lines if line.endswith(b"\n")]
        if len(whole) < 1 + resumed or whole[0] != _line(names):
            raise InputError(f"{path}: not the history of the run to go on with: start anew")
        self._truncate(whole)
        self._former = whole[1:]

    def _truncate(self, lines: list[bytes]) -> None:
        self._file.seek(sum(map(len, lines)))
        self._file.truncate()

    def write(self, index: int, values: list[str]) -> None:
        """Row number `index`."""
        line = _line(values)
        if index < len(self._former):
            if self._former[index] == line:
                return
            # Another machine rounds differently: its rows stand from here on.
            header = 1
            self._file.seek(0)
            lines = self._file.read().splitlines(keepends=True)
            self._truncate(lines[: header + index])
            self._former = []
        self._file.write(line)
        self._file.flush()

    def _write(self, values: list[str]) -> None:
        self._file.write(_line(values))
        self._file.flush()

    def sync(self) -> None:
        """Put what was written on the disk."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _line(values: list[str]) -> bytes:
    buffer = io.StringIO()
    csv.writer(buffer).writerow(values)
    return buffer.getvalue().encode()


def read_history(directory: str | Path) -> dict[str, np.ndarray]:
    """Columns of ``history.csv`` by name.

    Raises
    ------
    InputError
        The directory holds no history of at least one step.
    """
    path = Path(directory) / CSV_NAME
    try:
        require_file(path)
        with open(path, newline="") as file:
            header, *rows = list(csv.reader(file))
        # A run that was killed may have left its last row unfinished.
        whole = [row for row in rows if len(row) == len(header)]
        columns = np.array(whole, dtype=float).T
        if not len(whole):
            raise ValueError("no steps")
        if header[:3] != FIRST_COLUMNS:
            raise ValueError("not its columns")
    except FileNotFoundError:
        raise InputError(_no_results(path)) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: not a history of a run ({reason})") from None
    return dict(zip(header, columns, strict=True))


def _no_results(path: Path) -> str:
    """What a missing file of a run means."""
    if path.parent.is_dir():
        return f"{path.parent}: not a results folder, it has no {path.name}"
    return f"{path.parent}: no such folder"


def read_fields(
    directory: str | Path, names: tuple[str, ...], *, optional: bool = False
) -> dict[str, np.ndarray]:
    """Arrays of ``history.h5`` by name, one row a step; `optional` ones if they are there.

    Raises
    ------
    InputError
        The directory holds no such file, or it lacks one of them.
    """
    path = Path(directory) / FIELDS_NAME
    if not path.exists():
        raise InputError(_no_results(path))
    with named(InputError, f"{path}: not a history of a run"), _opened(path) as file:
        # HDF5 1.14 reads zeros beyond the end of a file that was cut off.
        whole, size = file.id.get_filesize(), path.stat().st_size
        if size < whole:
            raise OSError(f"it ends after {size} of {whole} bytes")
        found = {name: file[name] for name in names if name in file or not optional}
        return {name: _finite(dataset) for name, dataset in found.items()}


def _opened(path: Path) -> h5py.File:
    """The file, as a reader beside a writer if it is of a run that goes on, or was killed.

    Not without need: such a reader tries for minutes to read what is damaged.
    """
    require_file(path)
    with open(path, "rb") as file:
        # The superblock's consistency flags: open for writing.
        marked = file.read(12)[11:] not in (b"", b"\0")
    return h5py.File(path, "r", libver="latest", swmr=marked)


def _finite(dataset: h5py.Dataset) -> np.ndarray:
    require_numbers(dataset)
    values = np.array(dataset)
    if not values.ndim or not np.isfinite(values).all():
        raise ValueError(f"{dataset.name} holds a value that is not finite, or no rows")
    return values
