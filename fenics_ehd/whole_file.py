"""Files that are there whole or not at all, whatever ends the program or fills the disk."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from fenics_ehd.errors import OutputError


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Have failures to write name the file.

    Raises
    ------
    OutputError
        In place of an `OSError`.
    """
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error).splitlines()[0]
        raise OutputError(f"{path}: {reason}") from error


def write_whole(path: Path, content: str | bytes | memoryview) -> None:
    """Write a file aside, put it on the disk and rename it; links are replaced, not followed.

    Raises
    ------
    OutputError
        It cannot be written; a former file of that name is as it was.
    """
    partial = path.with_name(path.name + ".part")
    with naming(path):
        partial.unlink(missing_ok=True)
        try:
            with open(partial, "xb") as file:
                file.write(content.encode() if isinstance(content, str) else content)
                file.flush()
                os.fsync(file.fileno())
            partial.replace(path)
        except OSError:
            partial.unlink(missing_ok=True)
            raise


@contextmanager
def whole_hdf5(path: Path, libver: str | None = None) -> Iterator[h5py.File]:
    """An HDF5 file to fill, made in memory: HDF5 crashes where it cannot write.

    Raises
    ------
    OutputError
        From `write_whole`.
    """
    content = io.BytesIO()
    with h5py.File(content, "w", libver=libver) as file:
        yield file
    write_whole(path, content.getbuffer())
