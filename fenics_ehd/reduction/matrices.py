"""Matrices of any finite-element program as distributed PETSc matrices.

Degrees of freedom are ``3 * node + component``; each rank owns whole nodes.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fenics_ehd.base.errors import StructureError
from fenics_ehd.base.sealed_file import open_hdf5, require_file, require_numbers, values
from fenics_ehd.reduction.row_blocks import (
    RowBlock,
    agree,
    assemble,
    owned_range,
    together,
)

if TYPE_CHECKING:
    from scipy import sparse

#: Files that `as_matrix` reads, for its messages.
FILE_TYPES = ".mtx, .mtx.gz, .npz, .dat, .bin, .petsc, .h5, .hdf5"

#: First number of a matrix in PETSc's binary format.
_BINARY_MATRIX = 1211216

#: Most bytes that mpi4py sends in one message, with room for its own.
_LARGEST_MESSAGE = 2**31 - 2**20


def as_matrix(
    source: Any, comm: MPI.Comm, name: str = "matrix", *, rows: int | None = None
) -> PETSc.Mat:
    """PETSc matrix of whatever holds one.

    Parameters
    ----------
    source
        A PETSc matrix, returned as it is when its format is AIJ; a SciPy sparse
        matrix, the same on every rank; or the path of a file: Matrix Market
        (``.mtx``, ``.mtx.gz``, also with one triangle stored), SciPy (``.npz``), PETSc
        binary (``.dat``, ``.bin``, ``.petsc``) or HDF5 (``.h5``, ``.hdf5``; a group in
        it as ``file.h5:/group``) with the CSR arrays ``data``, ``indices`` and
        ``indptr`` as datasets and ``shape`` as dataset or attribute. Of the last two
        every rank reads its own rows only; the others rank 0 reads and sends around.
    comm
        Ranks that share the rows; a PETSc matrix keeps its own.
    name
        What the messages call it.
    rows
        Rows this rank shall own, those of another matrix of the part; None for an
        even distribution of whole nodes.

    Returns
    -------
    PETSc.Mat
        Format AIJ; one made here has block size 3 when square.

    Raises
    ------
    StructureError
        The file or the type cannot be read, the numbers are complex, or the rows are not
        three for every node or not as many as the ranks want.
    """
    if isinstance(source, PETSc.Mat):
        return source if source.getType() in ("seqaij", "mpiaij") else _converted(source, name)
    if hasattr(source, "tocsr"):
        whole = source.tocsr()
        block = _sliced(whole, *owned_range(whole.shape, comm, name, rows))
        return assemble(block, comm, name)
    if not isinstance(source, str | Path):
        raise StructureError(
            f"{name} is a {type(source).__name__}: give a PETSc matrix, a SciPy sparse matrix "
            f"or the path of a file ({FILE_TYPES})"
        )
    return _read(str(source), comm, name, rows)


def _converted(matrix: PETSc.Mat, name: str) -> PETSc.Mat:
    try:
        return matrix.convert("aij", out=PETSc.Mat())
    except PETSc.Error as error:
        raise StructureError(
            f"{name}: a PETSc matrix of type {matrix.getType()} cannot be made AIJ"
        ) from error


def _sliced(whole: Any, first: int, last: int) -> RowBlock:
    part = whole[first:last]
    return RowBlock(part.indptr, part.indices, part.data, whole.shape)


def _read(path: str, comm: MPI.Comm, name: str, rows: int | None) -> PETSc.Mat:
    """Matrix in a file, by the ending of its name."""
    label = f"{name}, file {path}"
    inside = re.fullmatch(r"(.*\.(?:h5|hdf5))(?::(.*))?", path, re.IGNORECASE)
    together(comm, label, lambda: require_file(inside[1] if inside else path))
    if inside:
        return _read_hdf5(inside[1], inside[2] or "/", comm, label, rows)
    if re.search(r"\.(dat|bin|petsc)$", path, re.IGNORECASE):
        return _read_binary(path, comm, label, rows)
    if re.search(r"\.(mtx|mtx\.gz|npz)$", path, re.IGNORECASE):
        return assemble(_scattered(path, comm, label, rows), comm, label)
    raise StructureError(f"{label}: its name ends in none of {FILE_TYPES}")


def _read_hdf5(path: str, group: str, comm: MPI.Comm, name: str, rows: int | None) -> PETSc.Mat:
    """CSR arrays in a group of an HDF5 file; every rank reads its own rows."""

    def shape() -> tuple[int, int]:
        with open_hdf5(path) as file:
            csr = file[group]
            height, width = values(csr["shape"]) if "shape" in csr else csr.attrs["shape"]
            for key, kinds in (("indptr", "iu"), ("indices", "iu"), ("data", "fiuc")):
                require_numbers(csr[key], kinds)
            if csr["indptr"].shape != (height + 1,):
                raise StructureError(
                    f"{name}: {height} rows need {height + 1} row pointers, "
                    f"indptr has shape {csr['indptr'].shape}"
                )
            return int(height), int(width)

    whole = together(comm, name, shape)
    first, last = owned_range(whole, comm, name, rows)

    def block() -> RowBlock:
        with open_hdf5(path) as file:
            csr = file[group]
            indptr = csr["indptr"][first : last + 1].astype(np.int64)
            entries = slice(indptr[0], indptr[-1])
            return RowBlock(
                indptr - indptr[0], csr["indices"][entries], csr["data"][entries], whole
            )

    return assemble(together(comm, name, block), comm, name)


def _read_binary(path: str, comm: MPI.Comm, name: str, rows: int | None) -> PETSc.Mat:
    """PETSc's own format: header, row lengths, column numbers, values, all big-endian.

    PETSc itself believes the column numbers.
    """
    number = np.dtype(PETSc.IntType).newbyteorder(">")
    real = np.dtype(">f8")

    def shape() -> tuple[int, int, int]:
        kind, height, width, entries = map(int, np.fromfile(path, number, 4))
        if kind != _BINARY_MATRIX or min(height, width, entries) < 0:
            raise StructureError(f"{name}: not a sparse matrix in PETSc's binary format")
        needed = (4 + height + entries) * number.itemsize + real.itemsize * entries
        found = Path(path).stat().st_size
        if found < needed:
            raise StructureError(f"{name}: {found} bytes, {entries} entries need {needed}")
        return height, width, entries

    height, width, entries = together(comm, name, shape)
    first, last = owned_range((height, width), comm, name, rows)

    def block() -> RowBlock:
        def read(kind: np.dtype, place: int, count: int) -> np.ndarray:
            return np.fromfile(path, kind, count, offset=place).astype(kind.newbyteorder("="))

        columns = (4 + height) * number.itemsize
        lengths = read(number, 4 * number.itemsize, height).astype(np.int64)
        if lengths.min(initial=0) < 0 or lengths.sum() != entries:
            raise StructureError(
                f"{name}: rows of {lengths.sum()} entries, the shortest of {lengths.min()}, do not "
                f"make its {entries} entries"
            )
        start, count = int(lengths[:first].sum()), int(lengths[first:last].sum())
        return RowBlock(
            np.concatenate([[0], np.cumsum(lengths[first:last])]),
            read(number, columns + start * number.itemsize, count),
            read(real, columns + entries * number.itemsize + start * real.itemsize, count),
            (height, width),
        )

    return assemble(together(comm, name, block), comm, name)


def _scattered(path: str, comm: MPI.Comm, name: str, rows: int | None) -> RowBlock:
    """Rows of a file that can only be read whole: rank 0 does, and sends the others theirs."""

    def read() -> Any:
        from scipy import io, sparse

        if comm.rank:
            return None
        # Newer SciPy says of a missing file that it is no Matrix Market file.
        Path(path).stat()
        npz = path.lower().endswith(".npz")
        found = sparse.load_npz(path) if npz else io.mmread(path)
        if npz and found.format in ("csr", "csc", "bsr"):
            # SciPy would read and write wherever a wrong number points to.
            found.check_format(full_check=True)
        return sparse.csr_matrix(found)

    whole = together(comm, name, read)
    shape = comm.bcast(None if comm.rank else whole.shape)
    ranges = comm.allgather(owned_range(shape, comm, name, rows))
    parts = [] if comm.rank else [_sliced(whole, *part) for part in ranges]
    largest = max((sum(a.nbytes for a in part[:3]) for part in parts[1:]), default=0)
    too_large = f"{name}: {largest} bytes for one rank are too many to send, write it as HDF5"
    agree(comm, too_large if largest > _LARGEST_MESSAGE else None)
    if comm.rank:
        return comm.recv(source=0)
    for rank, part in enumerate(parts[1:], 1):
        comm.send(part, rank)
    return parts[0]


def reorder(matrix: sparse.spmatrix, dofs: np.ndarray) -> sparse.csr_matrix:
    """Bring the degrees of freedom of a foreign matrix into the order ``3 * node + component``.

    Parameters
    ----------
    matrix
        K or M, SciPy sparse, as the program numbers it, shape (d, d).
    dofs
        Number of each node's degree of freedom along x, y and z there, shape
        (nodes, 3); -1 where it is held and the program has left it out.

    Returns
    -------
    scipy.sparse.csr_matrix
        shape (3 nodes, 3 nodes). A held degree of freedom is coupled to nothing and has
        the mean diagonal entry of `matrix`: the part stays clamped there, but its inertia
        integrals count that mass as well.

    Raises
    ------
    StructureError
        `matrix` is not square, or `dofs` does not name each of its rows once.
    """
    from scipy import sparse

    given = matrix.tocsr()
    numbers = np.asarray(dofs)
    if given.shape[0] != given.shape[1]:
        raise StructureError(f"a matrix of shape {given.shape} cannot be reordered: not square")
    if numbers.ndim != 2 or numbers.shape[1] != 3 or numbers.dtype.kind not in "iu":
        raise StructureError(
            f"dofs of shape {numbers.shape} and type {numbers.dtype}: three whole numbers for "
            "every node are needed"
        )
    flat = numbers.ravel()
    free = np.flatnonzero(flat != -1)
    size = given.shape[0]
    if len(free) and not 0 <= flat[free].min() <= flat[free].max() < size:
        raise StructureError(
            f"dofs reach from {flat[free].min()} to {flat[free].max()}, the matrix has {size} rows"
        )
    uses = np.bincount(flat[free], minlength=size)
    if (uses != 1).any():
        wrong = int(np.flatnonzero(uses != 1)[0])
        raise StructureError(f"row {wrong} of the matrix is named {uses[wrong]} times in dofs")
    place = sparse.csr_matrix((np.ones(len(free)), (free, flat[free])), shape=(len(flat), size))
    held = np.ones(len(flat))
    held[free] = 0.0
    return (place @ given @ place.T + sparse.diags(held * given.diagonal().mean())).tocsr()
