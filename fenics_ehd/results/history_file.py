"""The history of a run on disk: ``history.csv`` row by row, all of it in ``history.h5``.

Both files are only ever appended to, and can be read at any moment, also after the writer
was killed: rows of the CSV are whole lines, and HDF5 writes in its single-writer mode. A run
that goes on repeats the steps since its last checkpoint; rows that are there already are the
same to the last bit and are kept.

What ``history.h5`` holds, and where, is in ``docs/results.md``.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np

from fenics_ehd import __version__
from fenics_ehd.base.columns import DIMENSIONLESS
from fenics_ehd.base.errors import InputError
from fenics_ehd.base.sealed_file import named, open_hdf5, require_file, require_numbers
from fenics_ehd.base.whole_file import BOOKKEEPING, naming, sync_path, whole_hdf5, write_whole
from fenics_ehd.multibody.history_layout import beginning, path_of
from fenics_ehd.results.csv_file import CSV_NAME, CsvFile, csv_line

#: Steps of the HDF5 datasets written at a time, unless a checkpoint asks for them before.
FLUSH_EVERY = 50

#: Rows of a chunk of these datasets.
CHUNK = 64

FIELDS_NAME = "history.h5"

FORMAT = "fenics_ehd history"

#: Version 1, of 0.1, had pressures by other names and no units.
FORMAT_VERSION = 2

#: How what is large is packed, once no rows come any more.
PACKED: Mapping[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True}

#: What is stored in single precision: 6e-8 of a pressure or a gap.
SINGLE = ("pressure", "gap", "fluid_fraction")


class HistoryWriter:
    """Writes ``history.csv`` and ``history.h5`` while a run goes on.

    The files are made with the first step, which says what they hold.

    Parameters
    ----------
    directory
        Of the run, see `fenics_ehd.results.run_folder`.
    constants
        Arrays stored once, by path.
    attributes
        Of groups and datasets by path, units among them; what has none is dimensionless.
    groups
        See `path_of`; asked at every step.
    resumed
        Rows of a former run to go on after; None: a new run.

    Attributes
    ----------
    rows
        Steps of the run so far.

    Raises
    ------
    OutputError
        A file cannot be written; all rows before stay, and can be read.
    """

    def __init__(
        self,
        directory: str | Path,
        constants: Mapping[str, np.ndarray],
        attributes: Mapping[str, Mapping[str, Any]] | None = None,
        groups: Mapping[str, str] | None = None,
        *,
        resumed: int | None = None,
    ):
        self.directory = Path(directory)
        self._constants = constants
        self._attributes, self._groups = attributes or {}, {} if groups is None else groups
        self._resumed = resumed
        self.rows = resumed or 0
        self._csv: CsvFile | None = None
        self._file: h5py.File | None = None
        # Rows that wait for the HDF5 file, by path, and how much room they need there.
        self._waiting: dict[str, list[Any]] = {}
        self._chunks = 0

    def add(self, row: Mapping[str, float], fields: Mapping[str, np.ndarray]) -> None:
        """Append one accepted step: columns of the CSV, and fields by path."""
        values: dict[str, Any] = {}
        units: dict[str, str] = {}
        for column, value in row.items():
            path, units[path] = path_of(column, self._groups)
            values[path] = value
        values |= fields
        if self._csv is None:
            self._open(list(row), {path: np.shape(value) for path, value in values.items()}, units)
        assert self._csv is not None
        self._reserve()
        self._csv.write(self.rows, [f"{value:.10g}" for value in row.values()])
        for path, value in values.items():
            self._waiting.setdefault(path, []).append(np.array(value))
        self.rows += 1
        if self.rows % FLUSH_EVERY == 0:
            self._flush()

    def _flush(self) -> None:
        """Write the rows that wait."""
        assert self._file is not None
        for path, rows in self._waiting.items():
            data, first = self._file[path], self.rows - len(rows)
            if len(data) < self.rows:
                data.resize(self.rows, axis=0)
            data[first : self.rows] = rows
        self._waiting = {}
        self._file.flush()

    def _reserve(self) -> None:
        """Have the system keep room for the next rows: HDF5 crashes where it cannot write."""
        assert self._file is not None
        with naming(self._path):
            # Twice, as the former chunk may still be in memory.
            end, room = self._file.id.get_filesize(), 2 * self._chunks + BOOKKEEPING
            os.posix_fallocate(self._file.id.get_vfd_handle(), end, room)

    def sync(self) -> None:
        """Put all rows on the disk itself."""
        if self._csv is not None and self._file is not None:
            self._reserve()
            self._flush()
            for path in (self.directory / CSV_NAME, self._path):
                with naming(path):
                    sync_path(path)

    @property
    def _path(self) -> Path:
        return self.directory / FIELDS_NAME

    def _open(
        self, names: list[str], shapes: Mapping[str, tuple[int, ...]], units: Mapping[str, str]
    ) -> None:
        former = {
            path: np.empty((0, *shape), np.float32 if _single(path) else float)
            for path, shape in shapes.items()
        }
        if self._resumed is not None:
            with opened_history(self.directory) as file:
                former = {path: numbers(file[path]) for path in shapes}
            short = min(len(values) for values in former.values())
            if short < self.rows:
                raise InputError(
                    f"{self._path}: holds {short} steps, its checkpoint {self.rows}: start anew"
                )
        with naming(self.directory):
            self.directory.mkdir(parents=True, exist_ok=True)
        # A copy, as a killed writer leaves its file marked as open.
        with whole_hdf5(self._path, "latest") as file:
            for path, values in self._constants.items():
                file[path] = values
            for path, data in former.items():
                chunks = (CHUNK, *(max(n, 1) for n in data.shape[1:]))
                maximum = (None, *(n or None for n in data.shape[1:]))
                data = file.create_dataset(path, data=data, maxshape=maximum, chunks=chunks)
                self._chunks += data.dtype.itemsize * int(np.prod(chunks))
            _describe(file, self._attributes, units)
        self._csv = CsvFile(self.directory / CSV_NAME, names, self._resumed)
        with naming(self._path):
            self._file = h5py.File(self._path, "r+", libver="latest")
        self._file.swmr_mode = True

    def __enter__(self) -> HistoryWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._csv is not None:
            self._csv.close()
        if self._file is not None:
            self._flush()
            self._file.close()
            # Once more, which returns the room that was kept, unless a reader has it open.
            with suppress(OSError):
                h5py.File(self._path, "r+", libver="latest").close()


def _single(path: str) -> bool:
    """Whether a dataset is stored in single precision."""
    return path.rpartition("/")[2] in SINGLE


def _describe(
    file: h5py.File, attributes: Mapping[str, Mapping[str, Any]], units: Mapping[str, str]
) -> None:
    """Say what a file is, and the unit of every dataset."""
    file.attrs.update(
        format=_text(FORMAT), format_version=FORMAT_VERSION, fenics_ehd=_text(__version__)
    )

    def describe(path: str, item: Any) -> None:
        given = attributes.get(path, {})
        for name, value in given.items():
            item.attrs[name] = _text(value) if isinstance(value, str | list) else value
        if isinstance(item, h5py.Dataset) and "units" not in given:
            item.attrs["units"] = _text(units.get(path, DIMENSIONLESS))

    file.visititems(describe)


def _text(value: str | list[str]) -> np.ndarray:
    """Of fixed length: text of any length lies where HDF5 has no checksums, and crashes it."""
    return np.char.encode(np.array(value, dtype=str), "utf-8")


def keep_last_cycle(directory: str | Path, first: int, groups: Mapping[str, str]) -> None:
    """Drop all rows of a periodic run's history but its last cycle, which gets one at its start.

    What is left is packed: by a third, in 0.1 s (slider-crank, 108 steps of 1680 nodes).

    Parameters
    ----------
    directory
        Of the run.
    first
        Row of the cycle's first step.
    groups
        See `path_of`.
    """
    csv_path, path = (Path(directory) / name for name in (CSV_NAME, FIELDS_NAME))
    header, *lines = csv_path.read_bytes().splitlines(keepends=True)
    with opened_history(directory) as former, whole_hdf5(path, "latest") as file:
        file.attrs.update(former.attrs)
        kept: dict[str, np.ndarray] = {}

        def keep(name: str, item: Any) -> None:
            if not isinstance(item, h5py.Dataset):
                file.create_group(name)
            elif item.chunks:
                kept[name] = item[first:]
            else:
                file[name] = item[()]

        former.visititems(keep)
        names = [name.decode() for name in former["state/coordinates"].attrs["names"]]
        start = beginning(kept, names)
        for name, rows in kept.items():
            rows = np.concatenate([start[name][None], rows])
            file.create_dataset(name, data=rows, **(PACKED if rows.ndim == 2 else {}))
        former.visititems(lambda name, item: file[name].attrs.update(item.attrs))
    columns = header.decode().strip().split(",")
    row = csv_line([f"{start[path_of(own, groups)[0]]:.10g}" for own in columns])
    write_whole(csv_path, b"".join([header, row, *lines[first:]]))


def _no_results(path: Path) -> str:
    """What a missing file of a run means."""
    if path.parent.is_dir():
        return f"{path.parent}: not a results folder, it has no {path.name}"
    return f"{path.parent}: no such folder"


@contextmanager
def opened_history(directory: str | Path) -> Iterator[h5py.File]:
    """``history.h5`` of a run, also of one that goes on or was killed.

    Raises
    ------
    InputError
        The directory holds no such file, or one that is damaged or of another version; or what is
        done with it fails.
    """
    path = Path(directory) / FIELDS_NAME
    if not path.exists():
        raise InputError(_no_results(path))
    with named(InputError, f"{path}: not a history of a run"), _opened(path) as file:
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
        yield file


def read_fields(directory: str | Path, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Arrays of ``history.h5`` by path.

    Raises
    ------
    InputError
        See `opened_history`; or it lacks one of them.
    """
    with opened_history(directory) as file:
        return {name: finite(file[name]) for name in names}


def _opened(path: Path) -> h5py.File:
    """The file, as a reader beside a writer if it is of a run that goes on, or was killed.

    Not without need: such a reader tries for minutes to read what is damaged.
    """
    require_file(path)
    with open(path, "rb") as file:
        # The superblock's consistency flags: open for writing.
        marked = file.read(12)[11:] not in (b"", b"\0")
    return open_hdf5(path, libver="latest", swmr=marked)


def numbers(dataset: h5py.Dataset) -> np.ndarray:
    """Its numbers.

    Raises
    ------
    ValueError
        It holds something else, or no rows.
    """
    require_numbers(dataset)
    if not dataset.ndim:
        raise ValueError(f"{dataset.name} holds no rows")
    return np.array(dataset)


def finite(dataset: h5py.Dataset) -> np.ndarray:
    """Its numbers, all of which must be ones.

    Raises
    ------
    ValueError
        One is not.
    """
    values = numbers(dataset)
    if not np.isfinite(values).all():
        raise ValueError(f"{dataset.name} holds a value that is not finite")
    return values
