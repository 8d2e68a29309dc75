"""Rows of all ranks, one rank's after the other's, in the datasets of one HDF5 file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from mpi4py import MPI

from fenics_ehd.base.sealed_file import HEAD, seal
from fenics_ehd.base.whole_file import BOOKKEEPING, PART, new_part, require_room
from fenics_ehd.reduction.row_blocks import agree, together

#: Bytes of an HDF5 chunk: whole rows.
_CHUNK = 1 << 18


class Rows(NamedTuple):
    """Rows of a rank that are made block by block.

    Attributes
    ----------
    shape
        Of all of them.
    blocks
        Some rows each.
    """

    shape: tuple[int, ...]
    blocks: Iterable[np.ndarray]


@contextmanager
def sealed_by_ranks(
    path: Path, comm: MPI.Comm, begin: Callable[[h5py.File], None], size: int = 0
) -> Iterator[Path]:
    """A file beside another one for `append`, which replaces that one in the end; collective.

    Parameters
    ----------
    path
        The same on every rank.
    comm
        Ranks that write to it.
    begin
        Called on the first rank with the empty file.
    size
        Of what it writes [bytes].

    Raises
    ------
    StructureError
        On every rank what any rank could not do; a former file stays then.
    """

    def on_first(act: Callable[[], Any]) -> Any:
        return together(
            comm, f"file {path} cannot be written", lambda: None if comm.rank else act()
        )

    partial = comm.bcast(on_first(lambda: new_part(path)))

    def start() -> None:
        require_room(partial, size + BOOKKEEPING)
        with h5py.File(partial, "w", userblock_size=HEAD) as file:
            begin(file)

    try:
        on_first(start)
        yield partial
        on_first(lambda: seal(partial, path))
    except BaseException:
        if not comm.rank:
            with suppress(OSError):
                partial.unlink()
        raise


def append(path: Path, comm: MPI.Comm, arrays: Mapping[str, np.ndarray | Rows]) -> None:
    """New datasets of a file that is there, float64 where rows come in blocks; collective.

    Raises
    ------
    StructureError
        On every rank what any rank could not do, the others' turns after it.
    """
    problem = None
    rows = {n: a if isinstance(a, Rows) else Rows(a.shape, [a]) for n, a in arrays.items()}
    lengths = {name: comm.allgather(own.shape[0]) for name, own in rows.items()}
    for turn in range(comm.size):
        if turn == comm.rank:
            try:
                size = sum(8 * int(np.prod(own.shape)) + _CHUNK for own in rows.values())
                require_room(path, size + BOOKKEEPING)
                with h5py.File(path, "r+") as file:
                    for name, own in rows.items():
                        if not turn:
                            kind = getattr(arrays[name], "dtype", np.dtype(float))
                            _create(file, name, (sum(lengths[name]), *own.shape[1:]), kind)
                        place = sum(lengths[name][:turn])
                        for block in own.blocks:
                            file[name][place : place + len(block)] = block
                            place += len(block)
            except Exception as error:  # Whatever it is, the others wait for this rank.
                line = next(iter(str(error).splitlines()), "")
                whole = str(path).removesuffix(PART)
                problem = f"file {whole} cannot be written: {type(error).__name__}: {line}"
        comm.barrier()
    agree(comm, problem)


def _create(file: h5py.File, name: str, shape: tuple[int, ...], kind: np.dtype) -> None:
    rows = _CHUNK // max(1, 8 * int(np.prod(shape[1:], dtype=int)))
    chunks = (min(shape[0], max(1, rows)), *shape[1:]) if all(shape) else None
    file.create_dataset(name, shape, kind, chunks=chunks)
