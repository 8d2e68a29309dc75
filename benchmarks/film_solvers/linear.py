"""Sparse direct solves by PETSc."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from time import perf_counter

import numpy as np
from petsc4py import PETSc
from scipy import sparse

from fenics_ehd.base.petsc_options import configure

#: Solution of ``A x = b`` for a csr matrix and an array (n,).
LinearSolver = Callable[[sparse.csr_matrix, np.ndarray], np.ndarray]


class PetscLinearSolver:
    """Keeps the symbolic factorisation as long as the pattern stays the same.

    Parameters
    ----------
    options
        PETSc options without prefix; Cholesky means that the matrices are symmetric
        positive definite.
    options_prefix
        Under which the options database can overrule them.

    Attributes
    ----------
    seconds
        Time spent so far in factorisations and solves [s].
    """

    def __init__(self, options: Mapping[str, str], options_prefix: str = "competitor_"):
        self._options, self._prefix = dict(options), options_prefix
        self._pattern: tuple[np.ndarray, np.ndarray] | None = None
        self._objects: tuple[PETSc.Object, ...] = ()
        self.seconds = 0.0

    def __call__(self, matrix: sparse.csr_matrix, rhs: np.ndarray) -> np.ndarray:
        """Factorise the matrix and solve; an empty system has an empty solution."""
        if not len(rhs):
            return np.zeros(0)
        start = perf_counter()
        pattern = matrix.indptr, matrix.indices
        if self._pattern is None or not all(map(np.array_equal, pattern, self._pattern)):
            self._renew(pattern)
        self._data[:] = matrix.data
        ksp, own, given, unknown = self._objects
        own.assemble()  # tells PETSc that the values behind its back have changed
        given.array[:] = rhs
        ksp.solve(given, unknown)
        self.seconds += perf_counter() - start
        return unknown.array.copy()

    def _renew(self, pattern: tuple[np.ndarray, np.ndarray]) -> None:
        """Another matrix and another KSP, PETSc does not change the pattern of either."""
        self.destroy()
        self._pattern = pattern
        self._data = np.zeros(len(pattern[1]))
        csr = (*(array.astype(PETSc.IntType) for array in pattern), self._data)
        n = len(pattern[0]) - 1
        matrix = PETSc.Mat().createAIJWithArrays((n, n), csr, comm=PETSc.COMM_SELF)
        matrix.setOption(PETSc.Mat.Option.SPD, self._options.get("pc_type") == "cholesky")
        ksp = PETSc.KSP().create(PETSc.COMM_SELF)
        ksp.setOperators(matrix)
        configure(ksp, self._prefix, self._options)
        self._objects = (ksp, matrix, *matrix.createVecs())

    def destroy(self) -> None:
        """Give the memory back: petsc4py 3.18 leaks matrices made with arrays unless told."""
        for item in self._objects:
            item.destroy()
        self._pattern, self._objects = None, ()
