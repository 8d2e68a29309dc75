"""Matrices of any finite-element program as distributed PETSc matrices, and products with them.

Degrees of freedom are ``3 * node + component``; a rank owns all three degrees of freedom of a node.
An error on one rank is raised on all ranks. "Columns" are tall arrays with a row for every degree
of freedom; each rank has the rows that it owns. If the mass matrices along x, y and z are equal,
products use only the entries for x.

Imports inside functions: scipy.io, gzip and inspect are needed only for files in their formats.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import fenics_ehd.base.petsc_start  # noqa: F401  # isort: skip
import h5py
import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy import sparse

from fenics_ehd.base.errors import StructureError
from fenics_ehd.base.layout import Group, Value, attribute
from fenics_ehd.base.petsc_options import destroy_with
from fenics_ehd.base.sealed_file import open_hdf5, require_file, require_numbers, values

#: Extensions of the files that `as_matrix` reads, for messages.
FILE_TYPES = ".mtx, .mtx.gz, .npz, .dat, .bin, .petsc, .h5, .hdf5"

#: First number in PETSc's binary format of a matrix.
_BINARY_MATRIX = 1211216

#: Shape of a matrix, and a function that returns the rows of a range in CSR form: as a SciPy
#: matrix, or as a tuple of data, column numbers and row pointers.
Opened = tuple[tuple[int, int], Callable[[int, int], Any]]


def agree(comm: MPI.Comm, problem: str | None, cause: Exception | None = None) -> None:
    """Raise an error on every rank if any rank has a problem.

    Parameters
    ----------
    comm
        Communicator of the ranks.
    problem
        Message of this rank's problem; None if it has none.
    cause
        Exception that caused the problem, to be chained on this rank.

    Raises
    ------
    StructureError
        If a rank has a problem; the message is that of the lowest rank with a problem.
    """
    for message in comm.allgather(problem):
        if message is not None:
            raise StructureError(message) from cause


def together(comm: MPI.Comm, name: str, function: Callable[[], Any]) -> Any:
    """Call a function on every rank; if it fails on some ranks, raise an error on all of them.

    Raises
    ------
    StructureError
        If the function raises an exception on any rank. The message of a `StructureError` is
        unchanged; the message of another exception is put after `name`.
    """
    result = None
    problem = None
    cause: Exception | None = None
    try:
        result = function()
    except StructureError as error:
        problem = str(error)
        cause = error
    except Exception as error:  # of any kind: the other ranks must not wait for this one
        first_line = next(iter(str(error).splitlines()), type(error).__name__)
        problem = f"{name}: {first_line}"
        cause = error
    agree(comm, problem, cause)
    return result


def even_range(count: int, comm: MPI.Comm) -> tuple[int, int]:
    """Distribute `count` items over the ranks as PETSc does; return the range of this rank.

    The range consists of the index of the first item, and the index of the last item + 1.
    """
    each, rest = divmod(count, comm.size)
    first = comm.rank * each + min(comm.rank, rest)
    return first, first + each + (comm.rank < rest)


def before(count: int, comm: MPI.Comm) -> int:
    """Sum of `count` over the ranks before this one."""
    return sum(comm.allgather(count)[: comm.rank])


def owned_range(
    total: int, comm: MPI.Comm, name: str, rows: int | None, owned: int | None = None
) -> tuple[int, int]:
    """Range of the rows of a matrix or vector that this rank owns: first row, and last row + 1.

    Parameters
    ----------
    total, name
        Number of rows on all ranks, and the name of the matrix or vector for messages.
    rows
        Number of rows of the stiffness matrix on this rank; None if there is no stiffness matrix
        yet. This rank then has `owned` rows or, without `owned`, an even share of the nodes.
    owned
        Number of rows on this rank if the rows are distributed already, else None.

    Raises
    ------
    StructureError
        If the rows are not three for every node, or differ in number from those of the stiffness
        matrix.
    """
    if total % 3 or not total:
        raise StructureError(f"{name} has {total} rows, not 3 for every node")
    share = 3 * int(np.diff(even_range(total // 3, comm))[0])
    wanted = next(count for count in (rows, owned, share) if count is not None)
    of_stiffness = comm.allreduce(wanted)
    if of_stiffness != total:
        raise StructureError(
            f"{name} has {total} rows, but the stiffness matrix has {of_stiffness}"
        )
    split = owned is not None and (owned % 3 != 0 or owned != wanted)
    problem = f"{name}: a rank owns {owned} rows, not 3 for every node of the part that it owns"
    agree(comm, problem if split else None)
    first = before(wanted, comm)
    return first, first + wanted


def as_matrix(
    source: Any, comm: MPI.Comm, name: str = "matrix", *, rows: int | None = None
) -> PETSc.Mat:
    """Convert a matrix in memory or in a file to a PETSc matrix.

    Parameters
    ----------
    source
        A PETSc matrix, which is returned unchanged if its format is AIJ; a SciPy sparse matrix or a
        NumPy array of two dimensions, the same on every rank; or the path of a file. Files are
        Matrix Market (``.mtx``, ``.mtx.gz``, also with one triangle stored), SciPy (``.npz``),
        PETSc binary (``.dat``, ``.bin``, ``.petsc``) or HDF5 (``.h5``, ``.hdf5``, or
        ``file.h5:/group`` for a group). An HDF5 file has the CSR arrays ``data``, ``indices`` and
        ``indptr`` as datasets, and ``shape`` as a dataset or attribute. Each rank reads only its
        own rows from PETSc and HDF5 files; from other files, each rank reads all rows.
    comm
        Communicator of the ranks that share the rows; a PETSc matrix keeps its own.
    name
        Name of the matrix in messages.
    rows
        Number of rows on this rank, which is that of another matrix of the part; None for an even
        distribution of nodes.

    Returns
    -------
    PETSc.Mat
        Matrix in AIJ format; a new square matrix has block size 3.

    Raises
    ------
    StructureError
        If the source cannot be read, if its numbers are complex, or if its rows are not three for
        every node or not as many as requested.
    """
    if isinstance(source, PETSc.Mat):
        owned_range(source.size[0], source.comm.tompi4py(), name, rows, source.local_size[0])
        return source if source.getType() in ("seqaij", "mpiaij") else _converted(source, name)
    if isinstance(source, np.ndarray) and source.ndim == 2 and source.dtype.kind in "iufc":
        source = sparse.csr_matrix(source)
    if hasattr(source, "tocsr"):
        shape, read = _in_memory(source.tocsr())
    elif isinstance(source, str | Path):
        name = f"{name}, file {source}"
        shape, read = together(comm, name, lambda: _open(str(source)))
    else:
        raise StructureError(
            f"{name} is a {type(source).__name__}: give a PETSc matrix, a SciPy sparse matrix "
            f"or the path of a file ({FILE_TYPES})"
        )
    first, last = owned_range(shape[0], comm, name, rows)

    def checked() -> sparse.csr_matrix:
        """Read and check the rows of this rank."""
        block = sparse.csr_matrix(read(first, last), shape=(last - first, shape[1]))
        block.check_format(full_check=True)
        if np.iscomplexobj(block.data):
            raise StructureError(f"{name} has complex numbers, but real numbers are needed")
        if max(block.nnz, *shape) > np.iinfo(PETSc.IntType).max:
            raise StructureError(
                f"{name} has {max(block.nnz, *shape)} rows, columns or entries on one rank, above "
                f"{np.iinfo(PETSc.IntType).max}: use more ranks, or PETSc with 64-bit indices"
            )
        return block

    return assemble(together(comm, name, checked), comm)


def assemble(block: sparse.csr_matrix, comm: MPI.Comm) -> PETSc.Mat:
    """Make a PETSc matrix from the rows of each rank; repeated entries are added.

    Columns of a square matrix are distributed as its rows; columns of other matrices evenly.
    """
    # PETSc would keep only the last of repeated entries.
    block.sum_duplicates()
    owned, width = block.shape
    height = comm.allreduce(owned)
    columns = owned if height == width else int(np.diff(even_range(width, comm))[0])
    indptr, indices = (np.asarray(a, dtype=PETSc.IntType) for a in (block.indptr, block.indices))
    return PETSc.Mat().createAIJ(
        ((owned, height), (columns, width)),
        bsize=3 if height == width else None,
        csr=(indptr, indices, np.asarray(block.data, dtype=PETSc.ScalarType)),
        comm=comm,
    )


def _converted(matrix: PETSc.Mat, name: str) -> PETSc.Mat:
    """Convert a PETSc matrix of another format to AIJ.

    Raises
    ------
    StructureError
        If PETSc cannot convert it.
    """
    try:
        return matrix.convert("aij", out=PETSc.Mat())
    except PETSc.Error as error:
        raise StructureError(
            f"{name}: PETSc cannot convert a matrix of type {matrix.getType()} to AIJ"
        ) from error


def _in_memory(matrix: sparse.csr_matrix) -> Opened:
    """Shape of a matrix in memory, and a function that copies a range of its rows."""
    return matrix.shape, lambda first, last: matrix[first:last].copy()


def _open(path: str) -> Opened:
    """Open the matrix in a file; the extension determines the format."""
    inside = re.fullmatch(r"(.*\.(?:h5|hdf5))(?::(.*))?", path, re.IGNORECASE)
    require_file(inside[1] if inside else path)
    if inside:
        return _in_hdf5(inside[1], inside[2] or "/")
    if re.search(r"\.(dat|bin|petsc)$", path, re.IGNORECASE):
        return _in_binary(path)
    if not re.search(r"\.(mtx|mtx\.gz|npz)$", path, re.IGNORECASE):
        raise ValueError(f"the name of the file ends in none of {FILE_TYPES}")
    # Newer SciPy would report a missing file as one that is not Matrix Market.
    Path(path).stat()
    if not path.lower().endswith(".npz"):
        return _in_memory(sparse.csr_matrix(read_matrix_market(path)))
    matrix = sparse.load_npz(path)
    if matrix.format in ("csr", "csc", "bsr"):
        # With wrong indices, SciPy would read and write beyond its arrays.
        matrix.check_format(full_check=True)
    return _in_memory(sparse.csr_matrix(matrix))


def csr_layout(rows: str, entries: str = "entries") -> Group:
    """Layout of a matrix in CSR form in an HDF5 file; ``shape`` is an attribute or a dataset.

    Parameters
    ----------
    rows, entries
        Symbols for the numbers of rows and of entries, as in the axes of a `Value`.
    """
    return Group(
        {
            "indptr": Value("integer", (f"{rows} + 1",), least=0),
            "indices": Value("integer", (entries,), least=0),
            "data": Value("number", (entries,)),
        },
        foreign=True,
    )


def read_matrix_market(path: str | Path) -> Any:
    """Read a Matrix Market file: a sparse matrix or sparse array of SciPy, or a NumPy array.

    Exponents of Fortran (``1.5D+03``) are accepted, which SciPy does not read.
    SciPy 1.15 to 1.19 return a sparse matrix by default, later versions a sparse array,
    earlier versions only a matrix. Callers convert what they get.

    Raises
    ------
    ValueError
        If the file does not begin with ``%%MatrixMarket``: SciPy's message would be obscure; or
        if it has no line with its size.
    """
    import gzip
    import inspect

    from scipy import io

    opened: Callable[..., Any] = gzip.open if str(path).lower().endswith(".gz") else open
    with opened(path, "rb") as file:
        if not file.read(14).lower().startswith(b"%%matrixmarket"):
            raise ValueError(
                "the file does not begin with %%MatrixMarket: read a matrix of Abaqus by "
                "read_abaqus"
            )
        file.seek(0)
        text = file.read()
    lines = BytesIO(text)
    lines.readline()
    # SciPy would read on for ever.
    if all(line.startswith(b"%") or not line.strip() for line in lines):
        raise ValueError("the file ends before the line with its size: was it cut off?")
    known = "spmatrix" in inspect.signature(io.mmread).parameters
    options = {"spmatrix": False} if known else {}
    # Exponents of Fortran: SciPy before 1.12 refuses them, and later versions ignore them.
    changed, exponents = re.subn(rb"(?<=[\d.])[dD](?=[+-]?\d)", b"e", text)
    return io.mmread(BytesIO(changed) if exponents else path, **options)


def _in_hdf5(path: str, group: str) -> Opened:
    """Open CSR arrays in a group of an HDF5 file.

    Raises
    ------
    ValueError
        If the arrays, or the arrays and the shape, do not fit each other.
    """

    def read(first: int, last: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        with open_hdf5(path) as file:
            csr = file[group]
            indptr = csr["indptr"][first : last + 1].astype(np.int64)
            entries = slice(indptr[0], indptr[-1])
            return csr["data"][entries], csr["indices"][entries], indptr - indptr[0]

    with open_hdf5(path) as file:
        csr = file[group]
        csr_layout("rows").check(csr, "" if csr.name == "/" else csr.name, {})
        height, width = _shape(csr)
        if csr["indptr"].shape != (height + 1,):
            raise ValueError(
                f"{height} rows need {height + 1} row pointers, but indptr has shape "
                f"{csr['indptr'].shape}"
            )
    return (height, width), read


def _shape(csr: h5py.Group) -> tuple[int, int]:
    """Numbers of rows and columns of a matrix in CSR form, from an HDF5 group."""
    if "shape" in csr:
        require_numbers(csr["shape"], "iu")
        shape = np.asarray(values(csr["shape"]))
    else:
        shape = np.asarray(attribute(csr, "shape", Value("integer", (2,))))
    if shape.shape != (2,) or shape.min() < 0:
        raise ValueError(
            f"shape of {csr.name} is {shape.tolist()}, not the numbers of rows and columns"
        )
    return int(shape[0]), int(shape[1])


def _in_binary(path: str) -> Opened:
    """Open a matrix in PETSc's binary format, which PETSc would read without checking its columns.

    The file has a header, row lengths, column numbers and values, all big-endian.
    """
    number = np.dtype(PETSc.IntType).newbyteorder(">")
    kind, height, width, entries = map(int, np.fromfile(path, number, 4))
    if kind != _BINARY_MATRIX:
        raise ValueError("not a sparse matrix in PETSc's binary format")
    starts = np.cumsum([4, height, entries]) * number.itemsize
    lengths = np.memmap(path, number, "r", starts[0], height)
    columns = np.memmap(path, number, "r", starts[1], entries)
    reals = np.memmap(path, ">f8", "r", starts[2], entries)
    indptr = np.concatenate([[0], np.cumsum(lengths, dtype=np.int64)])
    if lengths.min() < 0 or indptr[-1] != entries:
        raise ValueError(f"the rows have {indptr[-1]} entries, but the header states {entries}")

    def read(first: int, last: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        entries = slice(indptr[first], indptr[last])
        data = reals[entries].astype(float)
        indices = columns[entries].astype(PETSc.IntType)
        return data, indices, indptr[first : last + 1] - indptr[first]

    return (height, width), read


def reorder(matrix: sparse.spmatrix, dofs: np.ndarray) -> sparse.csr_matrix:
    """Bring the degrees of freedom of a foreign matrix into the order ``3 * node + component``.

    Parameters
    ----------
    matrix
        K or M as a SciPy sparse matrix, in the numbering of the other program, shape (d, d).
    dofs
        Row number in `matrix` of each node's degree of freedom along x, y and z, shape (nodes, 3);
        -1 for a held degree of freedom that has no row.

    Returns
    -------
    scipy.sparse.csr_matrix
        Matrix of shape (3 nodes, 3 nodes). A held degree of freedom is not coupled to others; its
        diagonal entry is the mean diagonal entry of `matrix`. The part remains clamped there, but
        its inertia integrals contain these masses.

    Raises
    ------
    StructureError
        If `matrix` is not square, or if `dofs` does not contain each of its rows once.
    """
    foreign = matrix.tocsr()
    numbers = np.asarray(dofs)
    if foreign.shape[0] != foreign.shape[1]:
        raise StructureError(f"a matrix of shape {foreign.shape} cannot be reordered: not square")
    if numbers.ndim != 2 or numbers.shape[1] != 3 or numbers.dtype.kind not in "iu":
        raise StructureError(
            f"dofs have shape {numbers.shape} and type {numbers.dtype}: three whole numbers for "
            "every node are needed"
        )
    flat = numbers.ravel()
    free = np.flatnonzero(flat != -1)
    size = foreign.shape[0]
    named, uses = np.unique(flat[free], return_counts=True)
    if not np.array_equal(named, np.arange(size)) or uses.max(initial=1) > 1:
        wrong = [*named[uses > 1], *np.setxor1d(named, np.arange(size))][0]
        raise StructureError(
            f"dofs must have each of the {size} row numbers once, but row {wrong} is missing, "
            "repeated or not in the matrix"
        )
    order = sparse.csr_matrix((np.ones(len(free)), (free, flat[free])), shape=(len(flat), size))
    held = np.ones(len(flat))
    held[free] = 0.0
    return (order @ foreign @ order.T + sparse.diags(held * foreign.diagonal().mean())).tocsr()


# Products

#: Largest size of a block of columns that is processed at once [bytes].
BLOCK_BYTES = 1.5e8

#: Largest number of columns of a block; solvers are no faster with larger blocks.
BLOCK_COLUMNS = 128


def blocks(count: int, rows: int, comm: MPI.Comm) -> list[slice]:
    """Divide `count` columns into ranges, so that a block of columns on a rank stays small.

    `rows` is the number of rows on this rank. The result is the same on every rank.
    """
    largest = max(comm.allreduce(rows, op=MPI.MAX), 1)
    width = int(np.clip(BLOCK_BYTES / (8 * largest), 8, BLOCK_COLUMNS))
    return [slice(start, min(start + width, count)) for start in range(0, count, width)]


def dense_matrix(columns: np.ndarray, comm: PETSc.Comm) -> PETSc.Mat:
    """Make a dense PETSc matrix from the rows of this rank, shape (owned rows, k).

    The matrix uses the memory of a column-major array; other arrays are copied.
    """
    shape = (len(columns), None), (None, columns.shape[1])
    return PETSc.Mat().createDense(shape, array=np.asfortranarray(columns), comm=comm)


def column_vectors(matrix: PETSc.Mat, columns: np.ndarray) -> list[PETSc.Vec]:
    """Convert columns to PETSc vectors; every rank owns the same rows of them as of `matrix`."""
    vectors = [matrix.createVecLeft() for _ in columns.T]
    for vector, column in zip(vectors, columns.T, strict=True):
        vector.array = column
    return vectors


def multiply(matrix: PETSc.Mat, columns: np.ndarray) -> np.ndarray:
    """Product ``matrix @ columns``: the rows that this rank owns."""
    if columns.shape[1] == 0:
        return np.zeros((matrix.local_size[0], 0))
    dense = dense_matrix(columns, matrix.comm)
    product = matrix.matMult(dense)
    result = np.array(product.getDenseArray(), order="F")
    product.destroy()
    dense.destroy()
    return result


def combine(columns: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Product ``columns @ weights`` in column-major order, which PETSc uses without a copy."""
    return (weights.T @ columns.T).T


def inner(left: np.ndarray, right: np.ndarray, comm: MPI.Comm) -> np.ndarray:
    """Product ``left.T @ right`` of columns, summed over all ranks and returned on each."""
    return comm.allreduce(left.T @ right, op=MPI.SUM)


def norm(columns: np.ndarray, comm: MPI.Comm) -> float:
    """Frobenius norm of columns over the rows of all ranks."""
    return float(np.sqrt(comm.allreduce(np.sum(columns**2))))


def symmetric(matrix: np.ndarray) -> np.ndarray:
    """Symmetric part of a matrix, without the round-off of a product that must be symmetric."""
    return 0.5 * (matrix + matrix.T)


def falling_eigenpairs(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues of a symmetric matrix, the largest first, and the eigenvectors as columns.

    The eigenvectors are copied into a contiguous array. NumPy multiplies a reversed view without
    BLAS, 80 times slower (3840 x 1280 by 1280 x 1280: 21 s instead of 0.25 s).
    """
    values, vectors = np.linalg.eigh(matrix)
    return values[::-1].copy(), np.ascontiguousarray(vectors[:, ::-1])


def transpose_multiply(matrix: PETSc.Mat, columns: np.ndarray) -> np.ndarray:
    """Product ``matrix.T @ columns``, shape (columns of the matrix, k), the same on every rank."""
    if columns.shape[1] == 0:
        return np.zeros((matrix.size[1], 0))
    dense = dense_matrix(columns, matrix.comm)
    product = matrix.transposeMatMult(dense)
    result = np.concatenate(matrix.comm.tompi4py().allgather(product.getDenseArray()))
    product.destroy()
    dense.destroy()
    return result


def some_columns(matrix: PETSc.Mat, numbers: np.ndarray) -> PETSc.Mat:
    """Copy the columns `numbers` of a matrix; the copy is evenly distributed over the ranks."""
    comm = matrix.comm
    (first, last) = matrix.getOwnershipRange()
    mine = np.array_split(numbers, comm.size)[comm.rank].astype(PETSc.IntType)
    rows = PETSc.IS().createStride(last - first, first, 1, comm=comm)
    return matrix.createSubMatrix(rows, PETSc.IS().createGeneral(mine, comm=comm))


def load_columns(load: PETSc.Mat, pressures: np.ndarray) -> np.ndarray:
    """Nodal forces ``load @ pressures``, rows of this rank, shape (owned dofs, p).

    The pressures, shape (k, p), are the same on every rank. If a rank owns no pressure, their
    columns are multiplied one by one, because PETSc 3.25 crashes in the product of two matrices.
    """
    first, last = load.getOwnershipRangeColumn()
    if load.size[1] == 0 or np.diff(load.getOwnershipRangesColumn()).all():
        return multiply(load, pressures[first:last])
    vector = load.createVecRight()
    force = load.createVecLeft()
    forces = np.zeros((load.local_size[0], pressures.shape[1]), order="F")
    for number, column in enumerate(pressures.T):
        vector.array = column[first:last]
        load.mult(vector, force)
        forces[:, number] = force.array
    return forces


#: Largest difference between products of a test vector with M and with ``m (x) I_3``, relative to
#: the largest entry, at which the two matrices count as equal.
SAME_TOLERANCE = 1e-13


class MassOperator:
    """Operator that multiplies columns by the mass matrix M of (16).

    If the density is a scalar, M is ``m (x) I_3`` with a matrix m that has one row per node.
    Products with m read a ninth of the entries that finite-element programs store for M.

    Parameters
    ----------
    mass
        Mass matrix M; each rank owns all rows of a node.

    Attributes
    ----------
    matrix
        M as a PETSc matrix for an eigensolver; its products use m if this exists.
    """

    def __init__(self, mass: PETSc.Mat):
        self._mass = mass
        comm = mass.comm.tompi4py()
        self.matrix = mass
        first, last = mass.getOwnershipRange()
        rows = PETSc.IS().createStride((last - first) // 3, first, 3, comm=mass.comm)
        self._nodal: PETSc.Mat | None = mass.createSubMatrix(rows, rows)
        x = np.cos(0.3 * np.arange(first, last) ** 2.0)[:, None]
        product = multiply(mass, x)
        both = np.hstack([product, self.multiply(x) - product])
        largest, defect = np.max(comm.allgather(np.abs(both).max(axis=0, initial=0.0)), axis=0)
        if not defect <= SAME_TOLERANCE * largest:
            self._nodal.destroy()
            self._nodal = None
            return
        context = NodalProduct(self._nodal)
        self.matrix = PETSc.Mat().createPython(mass.getSizes(), context, comm=mass.comm)
        self.matrix.setUp()
        destroy_with(self, self.matrix, self._nodal, *context.vectors)

    def free_matrix(self) -> None:
        """Free the memory of M if its products need only m.

        Only the function that made M may call this method. M is then an empty matrix, and PETSc
        raises an error if M is used.
        """
        if self._nodal is not None:
            comm = self._mass.comm
            self._mass.destroy()
            self._mass.create(comm)

    def multiply(self, columns: np.ndarray) -> np.ndarray:
        """Product ``M @ columns``, rows of this rank, shape (owned dofs, k)."""
        rows, k = columns.shape
        if self._nodal is None or not k:
            return multiply(self._mass, columns)
        # Each of the k columns becomes three, one per component, with a row for each node.
        by_component = columns.T.reshape(k, rows // 3, 3).transpose(0, 2, 1)
        product = multiply(self._nodal, by_component.reshape(3 * k, rows // 3).T)
        by_node = product.T.reshape(k, 3, rows // 3).transpose(0, 2, 1)
        return by_node.reshape(k, rows).T


class NodalProduct:
    """Python context of a PETSc matrix ``m (x) I_3``.

    Parameters
    ----------
    nodal
        Matrix m, with one row for each node.
    """

    def __init__(self, nodal: PETSc.Mat):
        self.nodal = nodal
        #: Values of one component and their product with m.
        self.vectors: tuple[PETSc.Vec, PETSc.Vec] = nodal.createVecs()

    def mult(self, matrix: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Compute ``y = M x``, one component after the other; PETSc calls this method."""
        values, product = self.vectors
        source = x.getArray(readonly=True)
        target = y.array
        for component in range(3):
            values.array = source[component::3]
            self.nodal.mult(values, product)
            target[component::3] = product.getArray(readonly=True)
