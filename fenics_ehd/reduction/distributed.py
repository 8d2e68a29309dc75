"""Products of distributed matrices with tall arrays, each rank holding its own rows.

Those with a mass matrix use a third of it when it is the same for x, y and z.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fenics_ehd.base.petsc_options import destroy_with

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
    if columns.shape[1] == 0:
        return np.zeros((matrix.size[1], 0))
    dense = dense_matrix(columns, matrix.comm)
    product = matrix.transposeMatMult(dense)
    result = np.concatenate(matrix.comm.tompi4py().allgather(product.getDenseArray()))
    product.destroy()
    dense.destroy()
    return result


def some_columns(matrix: PETSc.Mat, numbers: np.ndarray) -> PETSc.Mat:
    """All rows and some columns of a matrix, as their numbers go; the ranks share them."""
    comm, (first, last) = matrix.comm, matrix.getOwnershipRange()
    mine = np.array_split(numbers, comm.size)[comm.rank].astype(PETSc.IntType)
    rows = PETSc.IS().createStride(last - first, first, 1, comm=comm)
    return matrix.createSubMatrix(rows, PETSc.IS().createGeneral(mine, comm=comm))


def load_columns(load: PETSc.Mat, pressures: np.ndarray) -> np.ndarray:
    """Owned rows of ``load @ pressures`` for pressures known on every rank, shape (k, p)."""
    first, last = load.getOwnershipRangeColumn()
    return multiply(load, pressures[first:last])


#: Largest defect of ``M = m (x) I_3`` from M, of a random product, relative to its largest entry.
SAME_TOLERANCE = 1e-13


class MassOperator:
    """M of (16), applied to columns of owned rows.

    Masses of isotropic density are ``M = m (x) I_3`` with a matrix m of the nodes:
    products with it read a ninth of the entries that finite-element programs store.

    Parameters
    ----------
    mass
        M, rows in whole nodes.
    """

    def __init__(self, mass: PETSc.Mat):
        self._mass, comm = mass, mass.comm.tompi4py()
        first, last = mass.getOwnershipRange()
        rows = PETSc.IS().createStride((last - first) // 3, first, 3, comm=mass.comm)
        self._nodal: PETSc.Mat | None = mass.createSubMatrix(rows, rows)
        x = np.cos(0.3 * np.arange(first, last) ** 2.0)[:, None]
        product = multiply(mass, x)
        found = np.hstack([product, self.multiply(x) - product])
        largest, defect = np.max(comm.allgather(np.abs(found).max(axis=0, initial=0.0)), axis=0)
        if defect <= SAME_TOLERANCE * largest:
            destroy_with(self, self._nodal)
        else:
            self._nodal.destroy()
            self._nodal = None

    def multiply(self, columns: np.ndarray) -> np.ndarray:
        """Owned rows of ``M @ columns``, shape (owned dofs, k)."""
        rows, k = columns.shape
        if self._nodal is None or not k:
            return multiply(self._mass, columns)
        # One column for each component: (node, component, k) to (node, component k).
        by_component = columns.T.reshape(k, rows // 3, 3).transpose(0, 2, 1)
        product = multiply(self._nodal, by_component.reshape(3 * k, rows // 3).T)
        by_node = product.T.reshape(k, 3, rows // 3).transpose(0, 2, 1)
        return by_node.reshape(k, rows).T
