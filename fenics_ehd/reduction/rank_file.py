"""Rows of all ranks, one rank's after the other's, in the datasets of one HDF5 file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
from mpi4py import MPI

from fenics_ehd.base.whole_file import BOOKKEEPING, require_room
from fenics_ehd.reduction.row_blocks import agree

#: How the name ends that a file has until it is whole.
PART = ".part"

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
