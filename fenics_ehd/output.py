"""Results of a run on disk: history row by row, fields in HDF5, a summary."""

from __future__ import annotations

import csv
import json
import math
import platform
from collections.abc import Mapping
from importlib import import_module, metadata
from pathlib import Path
from types import TracebackType

import h5py
import numpy as np

from fenics_ehd import __version__
from fenics_ehd.errors import InputError

#: Rows of the HDF5 datasets written between two flushes to disk.
FLUSH_EVERY = 50


class HistoryWriter:
    """Writes ``history.csv`` and ``history.h5`` while a run goes on.

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
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            (self.directory / "summary.json").unlink(missing_ok=True)
            # HDF5 first: it also fails when another program has the file open.
            self._file = h5py.File(self.directory / "history.h5", "w")
            self._csv = open(self.directory / "history.csv", "w", newline="")
        except OSError as error:
            reason = error.strerror or str(error).splitlines()[0]
            raise InputError(f"output directory {directory}: {reason}") from None
        self._rows: csv.DictWriter | None = None
        for name, values in constants.items():
            self._file[name] = values
        self._sets = {
            name: self._file.create_dataset(
                name, (0, length), maxshape=(None, length), chunks=(64, max(length, 1)), dtype="f8"
            )
            for name, length in fields.items()
        }
        self._count = 0

    def add(self, row: Mapping[str, float], fields: Mapping[str, np.ndarray]) -> None:
        """Append one accepted step."""
        if self._rows is None:
            self._rows = csv.DictWriter(self._csv, list(row))
            self._rows.writeheader()
        self._rows.writerow({name: f"{value:.10g}" for name, value in row.items()})
        self._csv.flush()
        for name, values in fields.items():
            dataset = self._sets[name]
            dataset.resize(self._count + 1, axis=0)
            dataset[self._count] = values
        self._count += 1
        if self._count % FLUSH_EVERY == 0:
            self._file.flush()

    def __enter__(self) -> HistoryWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._csv.close()
        self._file.close()


def write_summary(directory: str | Path, summary: Mapping[str, object]) -> None:
    """Write ``summary.json``, whole or not at all."""
    path = Path(directory) / "summary.json"
    partial = path.with_suffix(".part")
    partial.write_text(to_json(summary) + "\n")
    partial.replace(path)


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
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not a history of a run ({error})") from None
    return dict(zip(header, columns, strict=True))


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
