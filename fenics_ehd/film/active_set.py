"""Linear systems of one sparsity pattern, for one active set of the film after another.

An active set says at which nodes the film is full (pressure unknown, equation
holds) and at which it cavitates (pressure zero, defect unknown). SNES-VI cuts
the block of the full nodes out of its Jacobian, a new matrix with a new pattern
for every active set. Here that block keeps the pattern of the whole film: ones
stand on the diagonal of the cavitated nodes, so that ordering and symbolic
factorisation are done once in the life of a film.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from fenics_ehd.base.errors import CavitationError
from fenics_ehd.base.petsc_options import configure, destroy_with, solve_columns
from fenics_ehd.film.pattern import Pattern

#: Fastest of PETSc's factorisations on these matrices when only values change; CHOLMOD takes over
#: for large ones (`docs/measurements.md`). Film matrices need no pivoting for
#: stability that was ever seen to matter; every solution is verified.
SYMMETRIC_OPTIONS = {
    "ksp_type": "preonly",
    "pc_type": "cholesky",
    "pc_factor_mat_solver_type": "petsc",
    "pc_factor_mat_ordering_type": "nd",
}
LARGE_OPTIONS = {**SYMMETRIC_OPTIONS, "pc_factor_mat_solver_type": "cholmod"}
GENERAL_OPTIONS = {**SYMMETRIC_OPTIONS, "pc_type": "lu"}

#: Unknowns from which a matrix is large.
LARGE = 20_000


def _defaults(size: int, symmetric: bool) -> dict[str, str]:
    if not symmetric:
        return GENERAL_OPTIONS
    return LARGE_OPTIONS if size >= LARGE else SYMMETRIC_OPTIONS


class FactoredMatrix:
    """Factorisations of matrices that share a sparsity pattern.

    Parameters
    ----------
    pattern
        Of the n x n matrices.
    symmetric
        Whether they are symmetric positive definite.
    options_prefix
        Prefix of the KSP's options.
    """

    def __init__(
        self,
        pattern: Pattern,
        *,
        symmetric: bool,
        options_prefix: str,
    ):
        n = pattern.size
        # PETSc uses these arrays themselves.
        self._csr = (
            np.array(pattern.indptr, dtype=PETSc.IntType),
            np.array(pattern.indices, dtype=PETSc.IntType),
            np.zeros(len(pattern.indices)),
        )
        self._matrix = PETSc.Mat().createAIJWithArrays((n, n), self._csr, comm=PETSc.COMM_SELF)
        self._matrix.setOption(PETSc.Mat.Option.SPD, symmetric)
        self._ksp = PETSc.KSP().create(PETSc.COMM_SELF)
        self._ksp.setOperators(self._matrix)
        configure(self._ksp, options_prefix, _defaults(n, symmetric))
        self._rhs, self._solution = self._matrix.createVecs()
        destroy_with(self, self._ksp, self._matrix, self._rhs, self._solution)

    def factorise(self, entries: np.ndarray) -> None:
        """Take a matrix given by its entries in the order of the pattern."""
        self._csr[2][:] = entries
        # Assembly tells PETSc that the values behind its back have changed.
        self._matrix.assemble()
        # The PC's, not the KSP's: that leaves it to its own solve, which `solve_columns` avoids.
        self._ksp.pc.setUp()

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Solve for one right-hand side, shape (n,).

        Raises
        ------
        CavitationError
            The factorisation failed.
        """
        self._rhs.array[:] = rhs
        self._ksp.solve(self._rhs, self._solution)
        if self._ksp.getConvergedReason() < 0:
            raise CavitationError(
                "the film matrix cannot be factorised (KSP reason "
                f"{self._ksp.getConvergedReason()}): is the gap extremely uneven?"
            )
        return self._solution.array.copy()

    def solve_columns(self, rhs: np.ndarray) -> np.ndarray:
        """Solve for many right-hand sides, shape (n, k)."""
        right = PETSc.Mat().createDense(
            rhs.shape, array=np.asfortranarray(rhs), comm=self._matrix.comm
        )
        solution = right.duplicate()
        solve_columns(self._ksp, right, solution)
        values = np.array(solution.getDenseArray())
        right.destroy()
        solution.destroy()
        return values


class ActiveSetSystem:
    """Systems of a complementarity problem ``y = W^-1 (A p - b)`` on any active set.

    With I the full and C the cavitated nodes, the pressure of the full nodes
    and the defect y of the others solve

        A_I p_I - W_C y_C = b,

    all rows at once. Without weights W the defect decouples and the block
    ``A_II`` is what remains.

    Parameters
    ----------
    pattern
        Of A and W.
    weighted
        Whether there is a W.
    symmetric
        Whether A is symmetric.
    """

    def __init__(
        self,
        pattern: Pattern,
        *,
        weighted: bool,
        symmetric: bool,
        options_prefix: str,
    ):
        # Of the type NumPy indexes with: it would convert others at every active set.
        self._counts = np.diff(pattern.indptr)
        self._columns = pattern.indices.astype(np.intp)
        self._diagonal = pattern.diagonal
        self._weighted, self._size = weighted, pattern.size
        self._factor = FactoredMatrix(
            pattern,
            symmetric=symmetric and not weighted,
            options_prefix=options_prefix,
        )
        self._current: tuple[np.ndarray, np.ndarray | None, np.ndarray] | None = None

    def prepare(
        self, entries: np.ndarray, weights: np.ndarray | None, full_film: np.ndarray
    ) -> None:
        """Factorise for an active set, unless that is what was factorised last.

        Parameters
        ----------
        entries, weights
            Entries of A and W. A caller that changes values passes new arrays.
        full_film
            Indices of the full nodes.
        """
        if self._current is not None:
            former, former_weights, nodes = self._current
            if former is entries and former_weights is weights and np.array_equal(nodes, full_film):
                return
        full = np.zeros(self._size, dtype=bool)
        full[full_film] = True
        self.full = full
        if self._weighted:
            assert weights is not None
            values = np.where(full[self._columns], entries, -weights)
        else:
            values = entries * (full[self._columns] & np.repeat(full, self._counts))
            values[self._diagonal[~full]] = 1.0
        self._current = None
        self._factor.factorise(values)
        self._current = (entries, weights, full_film.copy())

    def solution(self, rhs: np.ndarray) -> np.ndarray:
        """Pressure of the full and defect of the other nodes, right-hand sides (n,) or (n, k)."""
        if not self._weighted:
            rhs = np.where(self.full if rhs.ndim == 1 else self.full[:, None], rhs, 0.0)
        solve = self._factor.solve if rhs.ndim == 1 else self._factor.solve_columns
        return solve(rhs)

    def pressures(self, rhs: np.ndarray) -> np.ndarray:
        """Pressure part of the solution; zero where cavitated."""
        solution = self.solution(rhs)
        solution[~self.full] = 0.0
        return solution
