"""Sparse matrices by the rows each rank owns, whole nodes at a time, and errors all ranks share.

In an HDF5 file they lie one rank's after the other's, in one dataset.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fenics_ehd.base.errors import StructureError
from fenics_ehd.base.sealed_file import HEAD, seal
from fenics_ehd.base.whole_file import BOOKKEEPING, PART, new_part, require_room


class RowBlock(NamedTuple):
    """The rows of a matrix that one rank owns, in CSR form, and the shape of the whole."""

    indptr: np.ndarray
    indices: np.ndarray
    data: np.ndarray
    shape: tuple[int, int]


def agree(comm: MPI.Comm, problem: str | None, cause: Exception | None = None) -> None:
    """Raise on every rank what any rank found; on the rank itself because of `cause`.

    Raises
    ------
    StructureError
        A rank has a problem; the message is that of the lowest such rank.
    """
    for found in comm.allgather(problem):
        if found is not None:
            raise StructureError(found) from cause


def together(comm: MPI.Comm, name: str, function: Callable[[], Any]) -> Any:
    """Call a function that may fail on some ranks only, a missing file say, and fail on all.

    Raises
    ------
    StructureError
        `function` raised one, or anything else: `name` is put before its message.
    """
    result, problem = None, None
    cause: Exception | None = None
    try:
        result = function()
    except StructureError as error:
        problem, cause = str(error), error
    except Exception as error:  # whatever it is, the other ranks must not wait for this one
        first_line = next(iter(str(error).splitlines()), type(error).__name__)
        problem, cause = f"{name}: {first_line}", error
    agree(comm, problem, cause)
    return result


def even_range(count: int, comm: MPI.Comm) -> tuple[int, int]:
    """First and last + 1 of the things this rank owns, as PETSc deals out `count` of them."""
    each, rest = divmod(count, comm.size)
    first = comm.rank * each + min(comm.rank, rest)
    return first, first + each + (comm.rank < rest)


def before(count: int, comm: MPI.Comm) -> int:
    """Sum of the counts of the ranks before this one."""
    return sum(comm.allgather(count)[: comm.rank])


def owned_range(
    shape: tuple[int, int], comm: MPI.Comm, name: str, rows: int | None
) -> tuple[int, int]:
    """First and last + 1 of the rows this rank owns: `rows` of them, or its share of the nodes.

    Raises
    ------
    StructureError
        There are not three rows for every node, or not as many as all ranks want.
    """
    if shape[0] % 3:
        raise StructureError(f"{name} has {shape[0]} rows, not 3 for every node")
    if rows is None:
        rows = 3 * int(np.diff(even_range(shape[0] // 3, comm))[0])
    total = comm.allreduce(rows)
    if total != shape[0]:
        raise StructureError(f"{name} has {shape[0]} rows, the stiffness matrix has {total}")
    first = before(rows, comm)
    return first, first + rows


def empty_matrix(shape: tuple[int, int], owned: int, comm: MPI.Comm) -> PETSc.Mat:
    """AIJ matrix of the given rows on this rank: columns alike when square, else evenly."""
    square = shape[0] == shape[1]
    columns = owned if square else int(np.diff(even_range(shape[1], comm))[0])
    matrix = PETSc.Mat().create(comm)
    matrix.setSizes(((owned, shape[0]), (columns, shape[1])))
    matrix.setType(PETSc.Mat.Type.AIJ)
    if square:
        matrix.setBlockSizes(3, 3)
    return matrix


def assemble(block: RowBlock, comm: MPI.Comm, name: str) -> PETSc.Mat:
    """PETSc matrix of the rows that each rank holds; entries given twice are summed.

    Raises
    ------
    StructureError
        The arrays contradict each other or hold complex numbers.
    """
    agree(comm, _defect(block, name))
    owned = len(block.indptr) - 1
    matrix = empty_matrix(block.shape, owned, comm)
    columns = matrix.getLocalSize()[1]
    first = before(columns, comm)
    near = (block.indices >= first) & (block.indices < first + columns)
    own = np.diff(np.concatenate([[0], np.cumsum(near)])[block.indptr])
    others = np.diff(block.indptr) - own
    # Entries given twice may be more than fit into a row.
    own, others = np.minimum(own, columns), np.minimum(others, block.shape[1] - columns)
    matrix.setPreallocationNNZ((own.astype(PETSc.IntType), others.astype(PETSc.IntType)))
    indptr, indices = (np.asarray(a, dtype=PETSc.IntType) for a in (block.indptr, block.indices))
    data = np.asarray(block.data, dtype=PETSc.ScalarType)
    # PETSc's own ways from CSR arrays keep the last of two entries in one place only.
    matrix.setValuesCSR(indptr, indices, data, addv=PETSc.InsertMode.ADD)
    matrix.assemble()
    return matrix


def _defect(block: RowBlock, name: str) -> str | None:
    """What contradicts itself in CSR arrays; PETSc would ignore some of it."""
    largest = np.iinfo(PETSc.IntType).max
    entries = len(block.data)
    if np.iscomplexobj(block.data):
        return f"{name} is complex, real numbers are needed"
    if not entries == len(block.indices) == block.indptr[-1]:
        return (
            f"{name}: {entries} values, {len(block.indices)} column numbers and row pointers up "
            f"to {block.indptr[-1]} do not fit"
        )
    if block.indptr[0] != 0 or (np.diff(block.indptr) < 0).any():
        return f"{name}: the row pointers do not ascend from 0"
    if max(entries, *block.shape) > largest:
        return f"{name} has more entries on a rank than this PETSc can count, {largest}"
    if entries and not 0 <= block.indices.min() <= block.indices.max() < block.shape[1]:
        return (
            f"{name}: column numbers reach from {block.indices.min()} to {block.indices.max()}, "
            f"there are {block.shape[1]} columns"
        )
    return None


# Files

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
