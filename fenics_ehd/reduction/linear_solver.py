"""Solvers of a stiffness matrix for many loads: one factorisation, or algebraic multigrid.

What does not fit into memory goes to a file: factors, and tall columns while more of them are made.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import IO

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fenics_ehd.base.errors import SettingsError, SolverError
from fenics_ehd.base.petsc_options import configured, destroy_with, solve_columns
from fenics_ehd.reduction.distributed import blocks, column_vectors, dense_matrix

SOLVERS = ("auto", "direct", "iterative")

#: Degrees of freedom above which factors go to disk: those of parts as thick as they are wide
#: outgrow 16 GB with the matrices there (measured: 1.1 GB at 134 000, 15.6 GB at 1 081 000).
IN_CORE_LIMIT = 700_000

#: Degrees of freedom above which ``"auto"`` iterates: factors of 40 GB and more.
DIRECT_LIMIT = 2_000_000

DIRECT_OPTIONS = {
    "ksp_type": "preonly",
    "pc_type": "cholesky",
    "pc_factor_mat_solver_type": "mumps",
    # Right-hand sides that MUMPS takes at once.
    "mat_mumps_icntl_27": 64,
}

#: Read from the disk once forward and once back in every solve.
OUT_OF_CORE = {"mat_mumps_icntl_22": 1}

#: INFOG(1) of MUMPS.
NO_ROOM_ON_DISK = -90

#: Where MUMPS writes factors; it would take ``/tmp``.
FACTORS_FOLDER = "MUMPS_OOC_TMPDIR"

#: Smoothed aggregation on the rigid motions of the part; conjugate gradients to a residual between
#: what round-off leaves of a smooth load (1e-9 of it at 70 000 degrees of freedom) and the check of
#: the responses.
ITERATIVE_OPTIONS = {
    "ksp_type": "cg",
    "ksp_rtol": 3e-9,
    # Of the true residual, which the responses are checked by.
    "ksp_norm_type": "unpreconditioned",
    "ksp_max_it": 1000,
    "pc_type": "gamg",
    "pc_gamg_threshold": 0.02,
    # Chebyshev and Jacobi, as PETSc has it: an aggregate of one node leaves zeros on the diagonal
    # of a coarse matrix, on which Gauss-Seidel fails.
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_pc_type": "jacobi",
    # The coarse matrix is as singular as the part is free.
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


def _options(direct: bool, size: int) -> Mapping[str, object]:
    if not direct:
        return ITERATIVE_OPTIONS
    return DIRECT_OPTIONS | OUT_OF_CORE if size > IN_CORE_LIMIT else DIRECT_OPTIONS


@contextmanager
def _factors_on_disk() -> Iterator[None]:
    """Where temporary bases go too, unless MUMPS was told a folder of its own."""
    given = FACTORS_FOLDER in os.environ
    os.environ.setdefault(FACTORS_FOLDER, scratch_folder())
    try:
        yield
    finally:
        if not given:
            del os.environ[FACTORS_FOLDER]


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
        self._comm = matrix.comm
        if not direct and near_kernel.shape[1]:
            _describe_kernel(matrix, near_kernel, kernel)
        self._ksp = ksp = PETSc.KSP().create(matrix.comm)
        ksp.setOperators(matrix)
        destroy_with(self, ksp)
        options = _options(direct, matrix.size[0])
        try:
            with configured(ksp, options_prefix, options), _factors_on_disk():
                ksp.setUp()
        except PETSc.Error as error:
            raise SolverError(
                f"the stiffness matrix cannot be factorised ({str(error).splitlines()[-1]}): "
                f"see -{options_prefix}mat_mumps_icntl_4 2, or choose solver = 'iterative'"
            ) from None
        self._factor: PETSc.Mat | None = None
        if ksp.getType() == "preonly" and ksp.pc.getType() in ("lu", "cholesky"):
            # The factors need neither the solver around them nor, what counts, the matrix.
            self._factor = ksp.pc.getFactorMatrix()
            destroy_with(self, self._factor)
            _check_factors(self._factor, ksp.pc.getFactorSolverType(), options_prefix)
            ksp.destroy()

    def solve(self, loads: np.ndarray) -> np.ndarray:
        """Owned rows of the solutions for owned rows of the loads, (rows, k).

        Raises
        ------
        SolverError
            The iteration did not converge.
        """
        result = np.zeros_like(loads, order="F")
        rhs, response = (dense_matrix(columns, self._comm) for columns in (loads, result))
        if self._factor is not None:
            try:
                self._factor.matSolve(rhs, response)
            except PETSc.Error as error:
                raise SolverError(
                    f"the factorised stiffness matrix cannot be solved with "
                    f"({str(error).splitlines()[-1]}): is it singular?"
                ) from None
        else:
            try:
                solve_columns(self._ksp, rhs, response)
            except SolverError as error:
                raise SolverError(
                    f"the stiffness matrix: {error}, or choose solver = 'direct'"
                ) from None
        for matrix in (rhs, response):
            matrix.destroy()
        return result


def _describe_kernel(matrix: PETSc.Mat, near_kernel: np.ndarray, kernel: bool) -> None:
    """Tell the multigrid hierarchy which fields cost next to nothing, the solver which nothing."""
    vectors = column_vectors(matrix, near_kernel)
    for i, vector in enumerate(vectors):
        for other in vectors[:i]:
            vector.axpy(-vector.dot(other), other)
        vector.normalize()
    space = PETSc.NullSpace().create(vectors=vectors, comm=matrix.comm)
    matrix.setNearNullSpace(space)
    if kernel:
        matrix.setNullSpace(space)


def _check_factors(factor: PETSc.Mat, package: str, options_prefix: str) -> None:
    """Raise if MUMPS failed or met a negative pivot; other packages say so themselves."""
    if package != "mumps":
        return
    failure, detail, negative = (factor.getMumpsInfog(i) for i in (1, 2, 12))
    if failure == NO_ROOM_ON_DISK:
        raise SolverError(
            f"the factors of the stiffness matrix do not fit in "
            f"{os.environ.get(FACTORS_FOLDER, scratch_folder())}: set TMPDIR to a larger folder"
        )
    if failure < 0:
        raise SolverError(
            f"the stiffness matrix cannot be factorised (MUMPS: INFOG(1) = {failure}, INFOG(2) = "
            f"{detail}): see -{options_prefix}mat_mumps_icntl_4 2, or choose solver = 'iterative'"
        )
    if negative:
        raise SolverError(
            f"the stiffness matrix has {negative} negative pivots: it is not positive "
            "semidefinite, or more than the rigid motions store no energy"
        )


# Room for columns

#: Columns up to which they stay in memory.
KEPT_COLUMNS = 128


def scratch_folder() -> str:
    """Where large temporary files go: TMPDIR, else /var/tmp, since /tmp may be memory."""
    given = os.environ.get("TMPDIR")
    if given:
        return given
    return "/var/tmp" if os.access("/var/tmp", os.W_OK) else tempfile.gettempdir()


class ColumnStore:
    """Owned rows of `count` columns, in memory while they are few, else in a file of this rank.

    A block for every bore node would be as large as everything else of a reduction together.
    The file has no name and is gone with the store.

    Parameters
    ----------
    rows
        Owned rows.
    count
        Columns.
    comm
        Ranks that share the columns.
    """

    def __init__(self, rows: int, count: int, comm: MPI.Comm):
        self.count, self._rows, self._comm = count, rows, comm
        self._memory: np.ndarray | None = None
        self._file: IO[bytes] | None = None
        if count <= KEPT_COLUMNS:
            self._memory = np.empty((rows, count), order="F")

    @property
    def parts(self) -> list[slice]:
        """Blocks that columns come and go in, the same on every rank."""
        return blocks(self.count, self._rows, self._comm)

    def put(self, part: slice, columns: np.ndarray) -> None:
        """Keep a block.

        Raises
        ------
        SolverError
            A rank finds no room on its disk.
        """
        if self._memory is not None:
            self._memory[:, part] = columns
            return
        failure = ""
        try:
            if self._file is None:
                self._file = tempfile.TemporaryFile(dir=scratch_folder())
            self._file.seek(part.start * self._rows * 8)
            self._file.write(np.ascontiguousarray(columns.T).data)
            self._file.flush()
        except OSError as error:
            failure = error.strerror or str(error)
        failures = [text for text in self._comm.allgather(failure) if text]
        if failures:
            gigabytes = 8e-9 * self._rows * self.count
            raise SolverError(
                f"{self.count} static responses, {gigabytes:.2g} GB a rank, do not fit in "
                f"{scratch_folder()} ({failures[0]}): set TMPDIR to a larger folder"
            )

    def get(self, part: slice) -> np.ndarray:
        """A block, column-major, shape (rows, width)."""
        if self._memory is not None:
            return self._memory[:, part]
        columns = np.empty((part.stop - part.start, self._rows))
        assert self._file is not None
        self._file.seek(part.start * self._rows * 8)
        self._file.readinto(columns.data)  # type: ignore[attr-defined]
        return columns.T

    def __iter__(self) -> Iterator[tuple[slice, np.ndarray]]:
        return ((part, self.get(part)) for part in self.parts)
