"""Tall columns set aside while more of them are made."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from typing import IO

import numpy as np
from mpi4py import MPI

from fenics_ehd.base.errors import SolverError
from fenics_ehd.reduction.distributed import blocks

#: Columns up to which they stay in memory.
KEPT_COLUMNS = 128


def scratch_folder() -> str:
    """Where large temporary files go: TMPDIR, else /var/tmp, since /tmp may be memory."""
    given = os.environ.get("TMPDIR")
    if given:
        return given
    return "/var/tmp" if os.access("/var/tmp", os.W_OK) else tempfile.gettempdir()


class ColumnStore:
    """Owned rows of `count` columns, in memory while they are few, else in a file of this rank.

    A block for every bore node would be as large as everything else of a reduction together.
    The file has no name and is gone with the store.

    Parameters
    ----------
    rows
        Owned rows.
    count
        Columns.
    comm
        Ranks that share the columns.
    """

    def __init__(self, rows: int, count: int, comm: MPI.Comm):
        self.count, self._rows, self._comm = count, rows, comm
        self._memory: np.ndarray | None = None
        self._file: IO[bytes] | None = None
        if count <= KEPT_COLUMNS:
            self._memory = np.empty((rows, count), order="F")

    @property
    def parts(self) -> list[slice]:
        """Blocks that columns come and go in, the same on every rank."""
        return blocks(self.count, self._rows, self._comm)

    def put(self, part: slice, columns: np.ndarray) -> None:
        """Keep a block.

        Raises
        ------
        SolverError
            A rank finds no room on its disk.
        """
        if self._memory is not None:
            self._memory[:, part] = columns
            return
        failure = ""
        try:
            if self._file is None:
                self._file = tempfile.TemporaryFile(dir=scratch_folder())
            self._file.seek(part.start * self._rows * 8)
            self._file.write(np.ascontiguousarray(columns.T).data)
            self._file.flush()
        except OSError as error:
            failure = error.strerror or str(error)
        failures = [text for text in self._comm.allgather(failure) if text]
        if failures:
            gigabytes = 8e-9 * self._rows * self.count
            raise SolverError(
                f"{self.count} static responses, {gigabytes:.2g} GB a rank, do not fit in "
                f"{scratch_folder()} ({failures[0]}): set TMPDIR to a larger folder"
            )

    def get(self, part: slice) -> np.ndarray:
        """A block, column-major, shape (rows, width)."""
        if self._memory is not None:
            return self._memory[:, part]
        columns = np.empty((part.stop - part.start, self._rows))
        assert self._file is not None
        self._file.seek(part.start * self._rows * 8)
        self._file.readinto(columns.data)  # type: ignore[attr-defined]
        return columns.T

    def __iter__(self) -> Iterator[tuple[slice, np.ndarray]]:
        return ((part, self.get(part)) for part in self.parts)
