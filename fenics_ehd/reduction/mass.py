"""Products with a mass matrix, by its third when it is the same for x, y and z."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from fenics_ehd.base.petsc_options import destroy_with
from fenics_ehd.reduction.distributed import multiply

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

    Attributes
    ----------
    matrix
        M for an eigensolver: a Mat whose products take the short way.
    """

    def __init__(self, mass: PETSc.Mat):
        self._mass = mass
        self.matrix = mass
        self._nodal = self._nodal_matrix()
        if self._nodal is None:
            return
        context = _ComponentWise(self._nodal)
        self.matrix = PETSc.Mat().createPython(mass.getSizes(), context, comm=mass.comm)
        self.matrix.setUp()
        destroy_with(self, self.matrix, self._nodal)

    def _nodal_matrix(self) -> PETSc.Mat | None:
        """The matrix m, or None when there is no such."""
        mass = self._mass
        first, last = mass.getOwnershipRange()
        rows = PETSc.IS().createStride((last - first) // 3, first, 3, comm=mass.comm)
        nodal = mass.createSubMatrix(rows, rows)
        x, product = mass.createVecs()
        x.array = np.cos(0.3 * np.arange(first, last) ** 2.0)
        mass.mult(x, product)
        _ComponentWise(nodal).mult(mass, x, other := product.duplicate())
        other.axpy(-1.0, product)
        defect, largest = (v.norm(PETSc.NormType.INFINITY) for v in (other, product))
        for vector in (x, product, other):
            vector.destroy()
        if defect <= SAME_TOLERANCE * largest:
            return nodal
        nodal.destroy()
        return None

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


class _ComponentWise:
    """Python context of ``m (x) I_3``."""

    def __init__(self, nodal: PETSc.Mat):
        self._nodal = nodal
        self._given, self._found = nodal.createVecs()

    def mult(self, matrix: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        for component in range(3):
            x.setBlockSize(3)
            y.setBlockSize(3)
            x.strideGather(component, self._given)
            self._nodal.mult(self._given, self._found)
            self._found.strideScatter(component, y)
