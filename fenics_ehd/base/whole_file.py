"""Files that are there whole or not at all, whatever ends the program or fills the disk."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from secrets import token_hex
from tempfile import TemporaryDirectory

import h5py

from fenics_ehd.base.errors import OutputError

#: Room for what HDF5 notes of its datasets [bytes].
BOOKKEEPING = 1 << 18

#: What a disk that was filled to its end has no room for [bytes].
BLOCK = 1 << 12

#: How the name ends that a file has until it is whole.
PART = ".part"


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
    with naming(path):
        partial = new_part(path)
        try:
            with open(partial, "wb") as file:
                file.write(content.encode() if isinstance(content, str) else content)
            put_in_place(partial, path)
        except BaseException:
            with suppress(OSError):
                partial.unlink()
            raise


def new_part(path: Path) -> Path:
    """An empty file beside another one, to become it: nobody else's, and no former one."""
    partial = path.with_name(path.name + PART)
    while True:
        try:
            partial.open("xb").close()
            return partial
        except FileExistsError:
            partial = path.with_name(f"{path.name}.{token_hex(4)}{PART}")


@contextmanager
def written_aside(path: Path) -> Iterator[Path]:
    """Path of the same name in a folder of its own, for a program to write; it then becomes `path`.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    with naming(path), TemporaryDirectory(dir=path.absolute().parent) as folder:
        aside = Path(folder, path.name)
        yield aside
        put_in_place(aside, path)


def put_in_place(partial: Path, path: Path) -> None:
    """Have a written file on the disk before it gets its name, in place of a former one."""
    sync_path(partial)
    partial.replace(path)
    sync_path(path.parent)


def require_room(path: Path, size: int) -> None:
    """Refuse what the disk has no room for: HDF5 crashes where it cannot write.

    Parameters
    ----------
    path
        File, created when missing.
    size
        By which it is about to grow [bytes].

    Raises
    ------
    OSError
        There is none.
    """
    with open(path, "ab") as file:
        end = file.tell()
        try:
            os.posix_fallocate(file.fileno(), end, size)
        finally:
            file.truncate(end)


def sync_path(path: Path) -> None:
    """Have the system write a file, or a folder's entries, to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


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
