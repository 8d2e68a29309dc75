"""Products of distributed matrices with tall arrays, each rank holding its own rows."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

#: Size of the blocks of columns that are worked on at once [bytes].
BLOCK_BYTES = 1.5e8

#: Most columns of a block; solvers gain nothing from more.
BLOCK_COLUMNS = 128


def blocks(count: int, rows: int, comm: MPI.Comm) -> list[slice]:
    """Slices of `count` columns, so narrow that a block of the owned rows stays small.

    The same on every rank, whatever it owns.
    """
    largest = max(comm.allreduce(rows, op=MPI.MAX), 1)
    width = int(np.clip(BLOCK_BYTES / (8 * largest), 8, BLOCK_COLUMNS))
    return [slice(start, min(start + width, count)) for start in range(0, count, width)]


def dense_matrix(columns: np.ndarray, comm: PETSc.Comm) -> PETSc.Mat:
    """PETSc dense matrix of the rows this rank owns, shape (owned, k).

    Shares the memory of a column-major array; the others are copied.
    """
    rows, width = columns.shape
    array = np.asfortranarray(columns)
    return PETSc.Mat().createDense(((rows, None), (None, width)), array=array, comm=comm)


def column_vectors(matrix: PETSc.Mat, columns: np.ndarray) -> list[PETSc.Vec]:
    """Vectors with the rows of a matrix, of columns of the rows this rank owns."""
    vectors = [matrix.createVecLeft() for _ in columns.T]
    for vector, column in zip(vectors, columns.T, strict=True):
        vector.array = column
    return vectors


def multiply(matrix: PETSc.Mat, columns: np.ndarray) -> np.ndarray:
    """Owned rows of ``matrix @ columns``."""
    if columns.shape[1] == 0:
        return np.zeros((matrix.local_size[0], 0))
    dense = dense_matrix(columns, matrix.comm)
    product = matrix.matMult(dense)
    result = np.array(product.getDenseArray(), order="F")
    product.destroy()
    dense.destroy()
    return result


def combine(columns: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """``columns @ weights``, column-major as PETSc takes it without a copy."""
    return (weights.T @ columns.T).T


def inner(left: np.ndarray, right: np.ndarray, comm: MPI.Comm) -> np.ndarray:
    """``left.T @ right`` summed over the ranks, on every rank."""
    return comm.allreduce(left.T @ right, op=MPI.SUM)


def symmetric(matrix: np.ndarray) -> np.ndarray:
    """Symmetric part: removes the round-off of a product that is symmetric by construction."""
    return 0.5 * (matrix + matrix.T)


def transpose_multiply(matrix: PETSc.Mat, columns: np.ndarray) -> np.ndarray:
    """``matrix.T @ columns`` on every rank, shape (matrix columns, k)."""
    source, target = matrix.createVecLeft(), matrix.createVecRight()
    comm = matrix.comm.tompi4py()
    result = np.empty((matrix.size[1], columns.shape[1]))
    for i in range(columns.shape[1]):
        source.array = columns[:, i]
        matrix.multTranspose(source, target)
        result[:, i] = np.concatenate(comm.allgather(target.array))
    source.destroy()
    target.destroy()
    return result


def load_columns(load: PETSc.Mat, pressures: np.ndarray) -> np.ndarray:
    """Owned rows of ``load @ pressures`` for pressures known on every rank, shape (k, p)."""
    first, last = load.getOwnershipRangeColumn()
    return multiply(load, pressures[first:last])


def node_rows(
    columns: np.ndarray, first_node: int, nodes: np.ndarray, comm: MPI.Comm
) -> np.ndarray:
    """Rows of given global nodes on every rank, shape (nodes, 3, k)."""
    owned = len(columns) // 3
    local = nodes - first_node
    mine = (local >= 0) & (local < owned)
    rows = np.zeros((len(nodes), 3, columns.shape[1]))
    rows[mine] = columns[3 * local[mine][:, None] + np.arange(3)]
    return comm.allreduce(rows, op=MPI.SUM)


def spread_rows(values: np.ndarray, first_node: int, owned: int, nodes: np.ndarray) -> np.ndarray:
    """Owned rows (3 owned, k) of fields that are zero but at given global nodes, (nodes, 3, k)."""
    columns = np.zeros((owned, 3, values.shape[2]))
    local = nodes - first_node
    mine = (local >= 0) & (local < owned)
    columns[local[mine]] = values[mine]
    return np.asfortranarray(columns.reshape(3 * owned, values.shape[2]))
