"""Static responses of a free or clamped part, (29), and its rigid-body modes, (26).

Rigid-body modes are computed from the geometry. Static responses to many loads need one
factorisation of the stiffness matrix, or algebraic multigrid. Large factors and many part-size
columns are stored in temporary files.

Imports inside functions: scipy.linalg is needed only for free parts.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from mmap import mmap

import fenics_ehd.base.petsc_start  # noqa: F401  # isort: skip
import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fenics_ehd.base.errors import SettingsError, SolverError, VerificationError
from fenics_ehd.base.petsc_options import configured, destroy_with, solve_columns
from fenics_ehd.reduction.bore import rigid_fields
from fenics_ehd.reduction.matrices import (
    MassOperator,
    column_vectors,
    combine,
    dense_matrix,
    inner,
    multiply,
    norm,
)
from fenics_ehd.reduction.structure import Structure, rigid_motions


def rigid_body_modes(structure: Structure) -> np.ndarray:
    """Mass-orthonormal rigid-body modes of a free part, none of a clamped one.

    Returns
    -------
    numpy.ndarray
        Owned rows, shape (owned dofs, 6) or (owned dofs, 0).

    Raises
    ------
    StructureError
        See `rigid_motions`.
    """
    fields, free = rigid_motions(structure)
    if not free:
        return fields[:, :0]
    gram = inner(fields, multiply(structure.mass, fields), structure.comm)
    return np.linalg.solve(np.linalg.cholesky(gram), fields.T).T


SOLVERS = ("auto", "direct", "iterative")

#: Degrees of freedom above which factors are stored on disk: those of compact parts and the
#: matrices exceed 16 GB there (measured: 1.1 GB at 134 000, 15.6 GB at 1 081 000).
IN_CORE_LIMIT = 700_000

#: Degrees of freedom above which ``"auto"`` is iterative: the factors would need 40 GB and more.
DIRECT_LIMIT = 2_000_000

DIRECT_OPTIONS: dict[str, object] = {
    "ksp_type": "preonly",
    "pc_type": "cholesky",
    "pc_factor_mat_solver_type": "mumps",
    # Right-hand sides that MUMPS solves at once.
    "mat_mumps_icntl_27": 64,
}

#: Options for factors on disk, which every solve reads twice.
OUT_OF_CORE = {"mat_mumps_icntl_22": 1}

#: INFOG(1) of MUMPS if there is no room on the disk.
NO_ROOM_ON_DISK = -90

#: Variable with the folder of MUMPS's factors, whose default is ``/tmp``.
FACTORS_FOLDER = "MUMPS_OOC_TMPDIR"

#: Smoothed aggregation on the rigid motions of the part, and conjugate gradients. Their tolerance
#: is between the round-off of a smooth load (1e-9 of it at 70 000 degrees of freedom) and that of
#: the check of the responses.
ITERATIVE_OPTIONS: dict[str, object] = {
    "ksp_type": "cg",
    "ksp_rtol": 3e-9,
    # The true residual, which the check of the responses uses as well.
    "ksp_norm_type": "unpreconditioned",
    "ksp_max_it": 1000,
    "pc_type": "gamg",
    "pc_gamg_threshold": 0.02,
    # Chebyshev and Jacobi, PETSc's default: an aggregate of one node causes zeros on the diagonal
    # of a coarse matrix, on which Gauss-Seidel fails.
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_pc_type": "jacobi",
    # The coarse matrix is singular if the part is free.
    "mg_coarse_pc_type": "redundant",
    "mg_coarse_redundant_pc_type": "svd",
}


def is_direct(solver: str, size: int) -> bool:
    """Choice of factorisation (True) or iteration for a part of `size` degrees of freedom.

    Raises
    ------
    SettingsError
        `solver` is none of `SOLVERS`.
    """
    if solver not in SOLVERS:
        raise SettingsError(f"solver {solver!r} is not one of {', '.join(SOLVERS)}")
    return solver == "direct" or (solver == "auto" and size <= DIRECT_LIMIT)


@contextmanager
def _factors_on_disk() -> Iterator[None]:
    """Set MUMPS's folder of factors to the scratch folder, unless the user has set it."""
    is_set = FACTORS_FOLDER in os.environ
    os.environ.setdefault(FACTORS_FOLDER, scratch_folder())
    try:
        yield
    finally:
        if not is_set:
            del os.environ[FACTORS_FOLDER]


class LinearSolver:
    """Solves ``A x = b`` for blocks of columns.

    Parameters
    ----------
    matrix
        Symmetric positive definite matrix; with `kernel` and an iterative solver, semidefinite.
    Whether the matrix is factorised; otherwise the solver is iterative.
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
        options = DIRECT_OPTIONS if direct else ITERATIVE_OPTIONS
        if direct and matrix.size[0] > IN_CORE_LIMIT:
            options = DIRECT_OPTIONS | OUT_OF_CORE
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
            # The factors outlive the solver, and the matrix, whose memory is thus freed.
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
        try:
            if self._factor is not None:
                self._factor.matSolve(rhs, response)
            else:
                solve_columns(self._ksp, rhs, response)
        except SolverError as error:
            raise SolverError(
                f"the stiffness matrix: {error}, or choose solver = 'direct'"
            ) from None
        except PETSc.Error as error:
            raise SolverError(
                f"the factorised stiffness matrix cannot be solved with "
                f"({str(error).splitlines()[-1]}): is it singular?"
            ) from None
        for matrix in (rhs, response):
            matrix.destroy()
        return result


def _describe_kernel(matrix: PETSc.Mat, near_kernel: np.ndarray, kernel: bool) -> None:
    """Set the near null space for the multigrid hierarchy, and the null space for the solver."""
    gram = inner(near_kernel, near_kernel, matrix.comm.tompi4py())
    orthonormal = np.linalg.solve(np.linalg.cholesky(gram), near_kernel.T).T
    vectors = column_vectors(matrix, orthonormal)
    space = PETSc.NullSpace().create(vectors=vectors, comm=matrix.comm)
    matrix.setNearNullSpace(space)
    if kernel:
        matrix.setNullSpace(space)


def _check_factors(factor: PETSc.Mat, package: str, options_prefix: str) -> None:
    """Raise if MUMPS failed or found a negative pivot; other packages raise errors themselves."""
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

#: Largest number of columns that are stored in memory.
KEPT_COLUMNS = 128


def scratch_folder() -> str:
    """Folder of large temporary files: TMPDIR, else /var/tmp, since /tmp may be memory."""
    folder = os.environ.get("TMPDIR")
    if folder:
        return folder
    return "/var/tmp" if os.access("/var/tmp", os.W_OK) else tempfile.gettempdir()


def room_for_columns(rows: int, count: int, comm: MPI.Comm) -> np.ndarray:
    """Column-major array (rows, count), in memory for few columns, else in a temporary file.

    Columns for every bore node would need as much memory as all other data of a reduction. Each
    rank has a file, without a name, which is deleted with the array.

    Parameters
    ----------
    rows
        Number of owned rows.
    count
        Number of columns.
    comm
        Ranks that share the columns.

    Raises
    ------
    SolverError
        A rank finds no room on its disk.
    """
    if count <= KEPT_COLUMNS:
        return np.empty((rows, count), order="F")
    size = max(1, 8 * rows * count)
    failure = ""
    file = tempfile.TemporaryFile(dir=scratch_folder())
    try:
        os.posix_fallocate(file.fileno(), 0, size)  # a mapped file without room ends the process
    except OSError as error:
        failure = error.strerror or str(error)
    failures = [text for text in comm.allgather(failure) if text]
    if failures:
        raise SolverError(
            f"{count} static responses, {1e-9 * size:.2g} GB a rank, do not fit in "
            f"{scratch_folder()} ({failures[0]}): set TMPDIR to a larger folder"
        )
    return np.ndarray((rows, count), buffer=mmap(file.fileno(), size), order="F")


#: Largest relative residual of a static solve, in the 2-norm of a random combination of the
#: columns, which detects a wrong column with probability one.
RESIDUAL_TOLERANCE = 1e-8

#: Largest response to balanced loads: mean diagonal of K times displacement over load. Slender
#: parts have 1e8; a part with a further free motion 1e15 and more.
COMPLIANCE_LIMIT = 1e13


def supporting_rows(modes: np.ndarray, comm: MPI.Comm) -> np.ndarray:
    """Global dofs of a statically determinate support: pivot rows of the rigid modes.

    Loads in equilibrium cause no reactions there, so that holding these dofs changes the response
    by a rigid motion only.
    """
    from scipy import linalg

    rows = np.vstack(comm.allgather(modes))
    return linalg.qr(rows.T, mode="r", pivoting=True)[1][: modes.shape[1]]


class StaticSolver:
    """Applies the elastic flexibility of a part: the ``G`` block of (29).

    The load is made self-equilibrated with the inertia of its rigid acceleration, the response is
    solved for on a determinate support, and its rigid motion is removed. The result is that of the
    saddle-point system (29) without its dense rows. A clamped part has no rigid modes, and the same
    lines are a plain solve. An iterative solver uses the singular matrix without a support: point
    supports slow it down.

    Parameters
    ----------
    structure
        The part.
    solver
        ``"direct"``, ``"iterative"`` or ``"auto"``, by size.
    options_prefix
        Prefix of the PETSc options of the linear solver.
    mass
        Products with M, to be shared; None: they are set up.
    clamped
        Global numbers of nodes that are held in addition, the same on every rank: the flexibility
        is then that of ``K_ii`` of (21), without rigid modes.

    Attributes
    ----------
    rigid_modes
        Mass-orthonormal U of (26), owned rows, shape (owned dofs, 6 or 0).
    mass
        Operator of products with M.

    Raises
    ------
    SolverError
        The matrix cannot be factorised.
    VerificationError
        The part moves without energy in more ways than a rigid body.
    """

    def __init__(
        self,
        structure: Structure,
        *,
        solver: str = "auto",
        options_prefix: str = "static_",
        mass: MassOperator | None = None,
        clamped: np.ndarray | None = None,
    ):
        self.structure = structure
        self.mass = mass or MassOperator(structure.mass)
        matrix = structure.stiffness.copy()
        direct = is_direct(solver, structure.size)
        rows = structure.stiffness.local_size[0]
        first, last = matrix.getOwnershipRange()
        self.rigid_modes = np.zeros((rows, 0))
        held = np.zeros(0, dtype=np.int32)
        if clamped is not None:
            held = (3 * clamped[:, None] + np.arange(3)).ravel()
        else:
            self.rigid_modes = rigid_body_modes(structure)
            if direct and self.rigid_modes.shape[1]:
                held = supporting_rows(self.rigid_modes, structure.comm)
        held = held[(held >= first) & (held < last)].astype(np.int32)
        self._held = held - first
        self._clamped = self._held[: 0 if clamped is None else None]
        self._mass_rigid = self.mass.multiply(self.rigid_modes)
        matrix.zeroRowsColumns(held, diag=mean_diagonal(structure.stiffness))
        self.linear = LinearSolver(
            matrix,
            direct=direct,
            near_kernel=rigid_fields(structure.coordinates),
            kernel=self.rigid_modes.shape[1] > 0,
            options_prefix=options_prefix,
        )
        if direct:
            matrix.destroy()
        self._check_compliance()

    def equilibrate(self, loads: np.ndarray) -> np.ndarray:
        """Loads minus the inertia of the rigid acceleration they cause; zero at clamps."""
        moved = inner(self.rigid_modes, loads, self.structure.comm)
        balanced = loads - combine(self._mass_rigid, moved)
        balanced[self._clamped] = 0.0
        return balanced

    def admissible(self, columns: np.ndarray) -> np.ndarray:
        """Columns made mass-orthogonal to the rigid-body modes, and zero at clamps."""
        moved = inner(self._mass_rigid, columns, self.structure.comm)
        elastic = columns - combine(self.rigid_modes, moved)
        elastic[self._clamped] = 0.0
        return elastic

    #: Part of the forces that causes an elastic response.
    without_reactions = equilibrate

    def apply(self, loads: np.ndarray) -> np.ndarray:
        """Static response without the check of `solve`, for use inside an eigensolver."""
        balanced = self.equilibrate(loads)
        balanced[self._held] = 0.0
        return self.admissible(self.linear.solve(balanced))

    def solve(self, loads: np.ndarray) -> np.ndarray:
        """Static responses G of (29).

        Parameters
        ----------
        loads
            Owned rows of the load columns, shape (owned dofs, k) [N].

        Returns
        -------
        numpy.ndarray
            Owned rows, same shape [m], mass-orthogonal to the rigid-body modes.

        Raises
        ------
        VerificationError
            The residual of (29) exceeds `RESIDUAL_TOLERANCE` relative to the loads.
        """
        response = self.apply(loads)
        verify_responses(self.structure, self.equilibrate(loads), response)
        return response

    def _check_compliance(self) -> None:
        structure = self.structure
        first = structure.stiffness.getOwnershipRange()[0]
        rows = structure.stiffness.local_size[0]
        # Two steps of inverse iteration find a motion without energy.
        load = np.cos(0.7 * np.arange(first, first + rows) ** 2.0)[:, None]
        for _ in range(2):
            load = self.equilibrate(load)
            load /= norm(load, structure.comm)
            response = self.apply(load)
            compliance = norm(response, structure.comm) * mean_diagonal(structure.stiffness)
            if not compliance <= COMPLIANCE_LIMIT:
                raise VerificationError(
                    "the stiffness matrix has a motion of nearly no energy beyond the "
                    f"{self.rigid_modes.shape[1]} rigid ones (compliance {compliance:.1e}, limit "
                    f"{COMPLIANCE_LIMIT:.0e}): is a node or a piece of the part loose?"
                )
            load = response


def mean_diagonal(matrix: PETSc.Mat) -> float:
    """Mean of the diagonal of a matrix."""
    diagonal = matrix.getDiagonal()
    mean = diagonal.sum() / diagonal.getSize()
    diagonal.destroy()
    return mean


def verify_responses(structure: Structure, loads: np.ndarray, responses: np.ndarray) -> None:
    """Check ``K x = f`` for a random combination of the columns.

    Raises
    ------
    VerificationError
        The residual exceeds `RESIDUAL_TOLERANCE`, relative to the load.
    """
    if not loads.shape[1]:
        return
    # Scaled to unit size, so that small columns matter as much as large ones.
    sizes = np.sqrt(structure.comm.allreduce(np.sum(loads**2, axis=0)))
    signs = np.random.default_rng(0).choice([-1.0, 1.0], loads.shape[1])
    weights = signs / np.where(sizes > 0, sizes, 1.0)
    load = loads @ weights[:, None]
    defect = multiply(structure.stiffness, responses @ weights[:, None]) - load
    ratio = norm(defect, structure.comm) / max(norm(load, structure.comm), 1e-300)
    if not ratio <= RESIDUAL_TOLERANCE:
        raise VerificationError(
            f"static responses leave a relative residual of {ratio:.1e}, above "
            f"{RESIDUAL_TOLERANCE:.0e}: is the stiffness matrix symmetric and non-singular?"
        )
