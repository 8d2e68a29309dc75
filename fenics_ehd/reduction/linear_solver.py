"""Solvers of a stiffness matrix for many loads: one factorisation, or algebraic multigrid."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from fenics_ehd.errors import SettingsError, SolverError
from fenics_ehd.petsc_options import configure, destroy_with, solve_columns
from fenics_ehd.reduction.distributed import dense_matrix

SOLVERS = ("auto", "direct", "iterative")

#: Degrees of freedom above which ``"auto"`` iterates: factors of parts as thick as they are wide
#: outgrow 16 GB there (measured: 1.1 GB at 134 000, growing as N^1.4).
DIRECT_LIMIT = 700_000

DIRECT_OPTIONS = {
    "ksp_type": "preonly",
    "pc_type": "cholesky",
    "pc_factor_mat_solver_type": "mumps",
    # Right-hand sides that MUMPS takes at once.
    "mat_mumps_icntl_27": 64,
}

#: Smoothed aggregation on the rigid motions of the part; conjugate gradients to a residual that
#: leaves room below the check of the responses.
ITERATIVE_OPTIONS = {
    "ksp_type": "cg",
    "ksp_rtol": 1e-10,
    "ksp_max_it": 1000,
    "pc_type": "gamg",
    "pc_gamg_threshold": 0.05,
    "mg_levels_ksp_type": "richardson",
    "mg_levels_pc_type": "sor",
    "mg_coarse_pc_type": "redundant",
    "mg_coarse_redundant_pc_type": "svd",
}


def is_direct(solver: str, size: int) -> bool:
    """Whether a part of `size` degrees of freedom is factorised.

    Raises
    ------
    SettingsError
        `solver` is none of `SOLVERS`.
    """
    if solver not in SOLVERS:
        raise SettingsError(f"solver {solver!r} is not one of {', '.join(SOLVERS)}")
    return solver == "direct" or (solver == "auto" and size <= DIRECT_LIMIT)


class LinearSolver:
    """Solves ``A x = b`` for blocks of columns.

    Parameters
    ----------
    matrix
        Symmetric positive definite; semidefinite for an iterative solver if `kernel`
        spans what it does not see.
    direct
        Factorise, or iterate.
    near_kernel
        Fields of nearly no energy for the multigrid hierarchy, owned rows (rows, p).
    kernel
        Whether the matrix is singular exactly on `near_kernel`.
    options_prefix
        Prefix of the PETSc options of the KSP.

    Raises
    ------
    SolverError
        The matrix cannot be factorised, or has negative pivots.
    """

    def __init__(
        self,
        matrix: PETSc.Mat,
        *,
        direct: bool,
        near_kernel: np.ndarray,
        kernel: bool,
        options_prefix: str,
    ):
        self.direct = direct
        self._prefix = options_prefix
        self._matrix = matrix
        if not direct:
            self._describe_kernel(near_kernel, kernel)
        self._ksp = ksp = PETSc.KSP().create(matrix.comm)
        ksp.setOperators(matrix)
        configure(ksp, options_prefix, DIRECT_OPTIONS if direct else ITERATIVE_OPTIONS)
        destroy_with(self, ksp)
        try:
            ksp.setUp()
        except PETSc.Error as error:
            raise SolverError(
                f"the stiffness matrix cannot be factorised ({str(error).splitlines()[-1]}): "
                f"see -{options_prefix}mat_mumps_icntl_4 2, or choose solver = 'iterative'"
            ) from None
        self._check_pivots()

    def _describe_kernel(self, near_kernel: np.ndarray, kernel: bool) -> None:
        if not near_kernel.shape[1]:
            return
        vectors = []
        for column in near_kernel.T:
            vector = self._matrix.createVecLeft()
            vector.array = column
            vectors.append(vector)
        for i, vector in enumerate(vectors):
            for other in vectors[:i]:
                vector.axpy(-vector.dot(other), other)
            vector.normalize()
        space = PETSc.NullSpace().create(vectors=vectors, comm=self._matrix.comm)
        self._matrix.setNearNullSpace(space)
        if kernel:
            self._matrix.setNullSpace(space)

    def _check_pivots(self) -> None:
        if not self.direct or self._ksp.pc.getFactorSolverType() != "mumps":
            return
        negative = self._ksp.pc.getFactorMatrix().getMumpsInfog(12)
        if negative:
            raise SolverError(
                f"the stiffness matrix has {negative} negative pivots: it is not positive "
                "semidefinite, or more than the rigid motions store no energy"
            )

    @property
    def factor_memory(self) -> float:
        """Memory of the factors over all ranks [bytes], 0 when unknown."""
        if not self.direct or self._ksp.pc.getFactorSolverType() != "mumps":
            return 0.0
        # Negative: millions.
        entries = self._ksp.pc.getFactorMatrix().getMumpsInfog(9)
        return 8.0 * (entries if entries >= 0 else -1e6 * entries)

    def solve(self, loads: np.ndarray) -> np.ndarray:
        """Owned rows of the solutions for owned rows of the loads, (rows, k).

        Raises
        ------
        SolverError
            The iteration did not converge.
        """
        rhs = dense_matrix(loads, self._matrix.comm)
        result = np.zeros_like(loads, order="F")
        response = dense_matrix(result, self._matrix.comm)
        solve_columns(self._ksp, rhs, response)
        reason = self._ksp.getConvergedReason()
        for matrix in (rhs, response):
            matrix.destroy()
        if not self.direct and reason < 0:
            raise SolverError(
                f"the stiffness matrix: no convergence in {self._ksp.getIterationNumber()} "
                f"iterations (reason {reason}): see -{self._prefix}ksp_monitor, or choose "
                "solver = 'direct'"
            )
        return result
