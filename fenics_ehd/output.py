"""Results of a run on disk: history row by row, fields in HDF5, a summary."""

from __future__ import annotations

import csv
import json
import math
import os
import platform
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module, metadata
from pathlib import Path
from types import TracebackType
from typing import TextIO

import h5py
import numpy as np

from fenics_ehd import __version__
from fenics_ehd.errors import CavitationError, EhdError, InputError

#: Rows of the HDF5 datasets written between two flushes to disk.
FLUSH_EVERY = 50


#: Where the film of a failed solve is kept.
FAILED_FILM = "failed_film.h5"

#: Files of a run, beside the history itself, that a new run in the same folder makes stale.
STALE = (
    "summary.json",
    "max_pressure.*",
    "min_film_thickness.*",
    "orbit.*",
    FAILED_FILM,
    "vtk/rod.pvd",
    "vtk/rod_*.vtu",
)


def require_writable(path: str | Path) -> None:
    """Refuse an output path early, before any work is done for it.

    Raises
    ------
    InputError
        Neither the path nor the nearest folder above it can be written to.
    """
    existing = Path(path).absolute()
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    if existing != Path(path).absolute() and not existing.is_dir():
        raise InputError(f"output {path}: {existing} is not a folder")
    if not os.access(existing, os.W_OK):
        raise InputError(f"output {path}: no permission to write to {existing}")


class HistoryWriter:
    """Writes ``history.csv`` and ``history.h5`` while a run goes on.

    The files are made with the first step, so that a run that cannot start
    leaves the results of a former one alone.

    Parameters
    ----------
    directory
        Created when missing; files of a former run are replaced.
    fields
        Names and lengths of the HDF5 rows.
    constants
        Arrays stored once.
    """

    def __init__(
        self, directory: str | Path, fields: Mapping[str, int], constants: Mapping[str, np.ndarray]
    ):
        self.directory = Path(directory)
        self._fields, self._constants = fields, constants
        self._files: tuple[h5py.File, TextIO, csv.DictWriter] | None = None
        self._count = 0

    @property
    def started(self) -> bool:
        """Whether a step was written."""
        return self._count > 0

    def _open(self, names: list[str]) -> tuple[h5py.File, TextIO, csv.DictWriter]:
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            for pattern in STALE:
                for old in self.directory.glob(pattern):
                    old.unlink()
            # HDF5 first: it also fails when another program has the file open.
            file = h5py.File(self.directory / "history.h5", "w")
            rows = open(self.directory / "history.csv", "w", newline="")
        except OSError as error:
            reason = error.strerror or str(error).splitlines()[0]
            raise InputError(f"output directory {self.directory}: {reason}") from None
        for name, values in self._constants.items():
            file[name] = values
        for name, length in self._fields.items():
            file.create_dataset(
                name, (0, length), maxshape=(None, length), chunks=(64, max(length, 1)), dtype="f8"
            )
        writer = csv.DictWriter(rows, names)
        writer.writeheader()
        return file, rows, writer

    def add(self, row: Mapping[str, float], fields: Mapping[str, np.ndarray]) -> None:
        """Append one accepted step."""
        if self._files is None:
            self._files = self._open(list(row))
        file, rows, writer = self._files
        writer.writerow({name: f"{value:.10g}" for name, value in row.items()})
        rows.flush()
        for name, values in fields.items():
            file[name].resize(self._count + 1, axis=0)
            file[name][self._count] = values
        self._count += 1
        if self._count % FLUSH_EVERY == 0:
            file.flush()

    def __enter__(self) -> HistoryWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._files is not None:
            self._files[0].close()
            self._files[1].close()


def write_summary(directory: str | Path, summary: Mapping[str, object]) -> None:
    """Write ``summary.json``, whole or not at all."""
    path = Path(directory) / "summary.json"
    partial = path.with_suffix(".part")
    partial.write_text(to_json(summary) + "\n")
    partial.replace(path)


@contextmanager
def keeping_failed_film(directory: str | Path) -> Iterator[None]:
    """Save the film of a `CavitationError` that ends a command, itself or as the cause.

    Raises
    ------
    EhdError
        The error, its message naming the file.
    """
    try:
        yield
    except EhdError as error:
        cause: BaseException | None = error
        while cause is not None and not (isinstance(cause, CavitationError) and cause.state):
            cause = cause.__cause__
        if cause is None:
            raise
        path = Path(directory) / FAILED_FILM
        save_film_state(path, cause.state)
        raise type(error)(f"{error}; the film is kept in {path}") from error


def save_film_state(path: str | Path, state: Mapping[str, object]) -> None:
    """Write the arrays of a film solve, `CavitationError.state` for instance, to an HDF5 file."""
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        with h5py.File(path, "w") as file:
            for name, values in state.items():
                file[name] = np.asarray(values)
    except OSError as error:
        reason = error.strerror or str(error).splitlines()[0]
        raise InputError(f"{path}: {reason}") from None


def to_json(values: Mapping[str, object]) -> str:
    """JSON text; a number that is not finite becomes null, which JSON has."""
    plain = {
        key: None if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in values.items()
    }
    return json.dumps(plain, indent=2, allow_nan=False)


def read_history(directory: str | Path) -> dict[str, np.ndarray]:
    """Columns of ``history.csv`` by name.

    Raises
    ------
    InputError
        The directory holds no history of at least one step.
    """
    path = Path(directory) / "history.csv"
    try:
        with open(path, newline="") as file:
            header, *rows = list(csv.reader(file))
        # A run that was killed may have left its last row unfinished.
        whole = [row for row in rows if len(row) == len(header)]
        columns = np.array(whole, dtype=float).T
        if not len(whole):
            raise ValueError("no steps")
        if header[:3] != ["time_s", "max_pressure_Pa", "min_film_thickness_m"]:
            raise ValueError("not its columns")
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not a history of a run ({error})") from None
    return dict(zip(header, columns, strict=True))


def read_fields(directory: str | Path, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Arrays of ``history.h5`` by name, one row a step.

    Raises
    ------
    InputError
        The directory holds no such file, or it lacks one of them.
    """
    path = Path(directory) / "history.h5"
    try:
        with h5py.File(path, "r") as file:
            return {name: np.array(file[name]) for name in names}
    except (OSError, KeyError) as error:
        reason = str(error).splitlines()[0].strip("'\"")
        raise InputError(f"{path}: not a history of a run ({reason})") from None


def versions() -> dict[str, str]:
    """Versions of everything that takes part in a result."""
    names = ("numpy", "scipy", "h5py", "petsc4py", "slepc4py", "dolfinx", "gmsh", "matplotlib")
    return {
        "fenics_ehd": __version__,
        "python": platform.python_version(),
        **{name: _version(name) for name in names},
    }


def _version(name: str) -> str:
    """Version of a package; Debian ships some without the metadata that pip leaves."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        pass
    try:
        return str(getattr(import_module(name), "__version__", "unknown"))
    except ImportError:
        return "missing"
