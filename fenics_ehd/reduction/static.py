"""Static responses of a free or clamped part, (29), and its rigid-body modes, (26).

Rigid-body modes are computed from the geometry. Static responses are solved for with one
factorisation of the stiffness matrix for all loads, or iteratively with algebraic multigrid. Large
factors and many part-size columns are stored in temporary files.

Imports inside functions: scipy.linalg is needed only for free parts.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from mmap import mmap

import fenics_ehd.base.petsc_start  # noqa: F401  # isort: skip
import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fenics_ehd.base.errors import SettingsError, SolverError, VerificationError
from fenics_ehd.base.petsc_options import configured, destroy_with, solve_columns
from fenics_ehd.base.progress import SILENT, Progress
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
from fenics_ehd.reduction.matrix_check import RigidMotions, rigid_motions
from fenics_ehd.reduction.structure import Structure


def _owned_nodes(structure: Structure) -> tuple[np.ndarray, np.ndarray]:
    """Mask of the nodes of all bores that this rank owns, and local indices of the owned nodes."""
    local = structure.bore_nodes - structure.node_range[0]
    mine = (local >= 0) & (local < len(structure.coordinates))
    return mine, local[mine]


def bore_rows(structure: Structure, columns: np.ndarray) -> np.ndarray:
    """Values of part-size columns at the nodes of all bores, on every rank, shape (m, 3, n)."""
    mine, local = _owned_nodes(structure)
    rows = np.zeros((len(mine), 3, columns.shape[1]))
    rows[mine] = columns[3 * local[:, None] + np.arange(3)]
    return structure.comm.allreduce(rows, op=MPI.SUM)


def on_bores(structure: Structure, values: np.ndarray) -> np.ndarray:
    """Part-size fields from values at the bores' nodes, shape (m, 3, n), and zero elsewhere.

    Returns
    -------
    numpy.ndarray
        Fields, rows of this rank, shape (owned dofs, n).
    """
    mine, local = _owned_nodes(structure)
    columns = np.zeros((len(structure.coordinates), 3, values.shape[2]))
    columns[local] = values[mine]
    return np.asfortranarray(columns.reshape(-1, values.shape[2]))


def _mass_orthonormal(structure: Structure, motions: RigidMotions) -> np.ndarray:
    """Mass-orthonormal rigid-body modes of a free part, shape (owned dofs, 6); else (..., 0)."""
    fields = motions.fields
    if not motions.free:
        return fields[:, :0]
    gram = inner(fields, multiply(structure.mass, fields), structure.comm)
    return np.linalg.solve(np.linalg.cholesky(gram), fields.T).T


SOLVERS = ("auto", "direct", "iterative")

#: Number of degrees of freedom above which factors are stored on disk. For compact parts above it,
#: factors and matrices exceed 16 GB (measured: factors of 1.1 GB at 134 000 degrees of freedom,
#: 15.6 GB at 1 081 000).
IN_CORE_LIMIT = 700_000

#: Number of degrees of freedom above which ``"auto"`` is iterative: factors would need 40 GB or
#: more.
DIRECT_LIMIT = 2_000_000

DIRECT_OPTIONS: dict[str, object] = {
    "ksp_type": "preonly",
    "pc_type": "cholesky",
    "pc_factor_mat_solver_type": "mumps",
    # Number of right-hand sides that MUMPS solves at once.
    "mat_mumps_icntl_27": 64,
}

#: Options for factors on disk, which every solve reads twice.
OUT_OF_CORE = {"mat_mumps_icntl_22": 1}

#: Value of MUMPS's INFOG(1) if the disk is full.
NO_ROOM_ON_DISK = -90

#: Environment variable that sets the folder for MUMPS's factors; MUMPS's default is ``/tmp``.
FACTORS_FOLDER = "MUMPS_OOC_TMPDIR"

#: Conjugate gradients, preconditioned by smoothed aggregation on the rigid motions of the part. The
#: relative tolerance is between the round-off in the residual of a smooth load (1e-9 at 70 000
#: degrees of freedom) and `RESIDUAL_TOLERANCE`, the limit in the check of the responses.
ITERATIVE_OPTIONS: dict[str, object] = {
    "ksp_type": "cg",
    "ksp_rtol": 3e-9,
    # The true residual, which the check of the responses uses as well.
    "ksp_norm_type": "unpreconditioned",
    "ksp_max_it": 1000,
    "pc_type": "gamg",
    "pc_gamg_threshold": 0.02,
    # Chebyshev with Jacobi, PETSc's default. Gauss-Seidel fails: an aggregate of one node causes
    # zeros on the diagonal of a coarse matrix.
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_pc_type": "jacobi",
    # The coarse matrix is singular if the part is free.
    "mg_coarse_pc_type": "redundant",
    "mg_coarse_redundant_pc_type": "svd",
}


def is_direct(solver: str, size: int) -> bool:
    """Whether a part of `size` degrees of freedom is solved directly, not iteratively.

    Raises
    ------
    SettingsError
        If `solver` is not one of `SOLVERS`.
    """
    if solver not in SOLVERS:
        raise SettingsError(f"solver {solver!r} is not one of {', '.join(SOLVERS)}")
    return solver == "direct" or (solver == "auto" and size <= DIRECT_LIMIT)


@contextmanager
def _factors_on_disk() -> Iterator[None]:
    """Set the folder for MUMPS's factors to the scratch folder, unless the user has set one."""
    is_set = FACTORS_FOLDER in os.environ
    os.environ.setdefault(FACTORS_FOLDER, scratch_folder())
    try:
        yield
    finally:
        if not is_set:
            del os.environ[FACTORS_FOLDER]


#: Names of counts of work in the provenance of a body.
WORK = ("part_factorisations", "static_solves", "eigensolver_applications")


@dataclass
class Work:
    """Counts of the work of a reduction, the same on every rank, and its progress.

    Attributes
    ----------
    factorisations
        Number of factorisations of the part; with an iterative solver, of multigrid hierarchies.
    solved_columns
        Number of load columns that were solved for.
    eigensolver_applications
        Number of solved columns that an eigensolver generated; it depends on round-off.
    progress
        Progress in which solvers open their stages.
    """

    factorisations: int = 0
    solved_columns: int = 0
    eigensolver_applications: int = 0
    progress: Progress = SILENT

    def take(self) -> dict[str, str]:
        """Return the counts since the last call for a body's provenance, and reset them."""
        static = self.solved_columns - self.eigensolver_applications
        counts = (self.factorisations, static, self.eigensolver_applications)
        self.factorisations = self.solved_columns = self.eigensolver_applications = 0
        return dict(zip(WORK, map(str, counts), strict=True))


class LinearSolver:
    """Linear solver of ``A x = b`` for several right-hand sides at once.

    Parameters
    ----------
    matrix
        Symmetric positive definite matrix A. For an iterative solver with `kernel`, it may be
        semidefinite.
    direct
        True to factorise the matrix, false for an iterative solver.
    near_kernel
        Fields with almost no strain energy, for the multigrid hierarchy: rows of this rank, shape
        (owned rows, p).
    kernel
        Whether the null space of the matrix is the span of `near_kernel`.
    options_prefix
        Prefix of the PETSc options of the KSP.
    on_disk
        Whether factors are stored in temporary files.

    Raises
    ------
    SolverError
        If the matrix cannot be factorised or has negative pivots.
    """

    def __init__(
        self,
        matrix: PETSc.Mat,
        *,
        direct: bool,
        near_kernel: np.ndarray,
        kernel: bool,
        options_prefix: str,
        on_disk: bool = False,
    ):
        self._comm = matrix.comm
        if not direct and near_kernel.shape[1]:
            _describe_kernel(matrix, near_kernel, kernel)
        self._ksp = ksp = PETSc.KSP().create(matrix.comm)
        ksp.setOperators(matrix)
        destroy_with(self, ksp)
        options = DIRECT_OPTIONS if direct else ITERATIVE_OPTIONS
        if direct and on_disk:
            options = DIRECT_OPTIONS | OUT_OF_CORE
        try:
            with configured(ksp, options_prefix, options), _factors_on_disk():
                ksp.setUp()
        except PETSc.Error as error:
            raise SolverError(
                f"the stiffness matrix cannot be factorised ({str(error).splitlines()[-1]}): "
                f"choose solver = 'iterative', or run with PETSC_OPTIONS='-{options_prefix}"
                "mat_mumps_icntl_4 2' for details"
            ) from None
        self._factor: PETSc.Mat | None = None
        if ksp.getType() == "preonly" and ksp.pc.getType() in ("lu", "cholesky"):
            # Only the factors are kept: the memory of the KSP and of the matrix is freed.
            self._factor = ksp.pc.getFactorMatrix()
            destroy_with(self, self._factor)
            _check_factors(self._factor, ksp.pc.getFactorSolverType(), options_prefix)
            ksp.destroy()

    def solve(self, loads: np.ndarray) -> np.ndarray:
        """Solve ``A x = b`` for k columns b; columns and solutions have the shape (owned rows, k).

        Raises
        ------
        SolverError
            If the iteration does not converge, or the factors cannot be used.
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
                f"the solve with the factorised stiffness matrix failed "
                f"({str(error).splitlines()[-1]}): is the matrix singular?"
            ) from None
        for matrix in (rhs, response):
            matrix.destroy()
        return result


def _describe_kernel(matrix: PETSc.Mat, near_kernel: np.ndarray, kernel: bool) -> None:
    """Set the near null space of a matrix for multigrid; if `kernel`, also its null space."""
    gram = inner(near_kernel, near_kernel, matrix.comm.tompi4py())
    orthonormal = np.linalg.solve(np.linalg.cholesky(gram), near_kernel.T).T
    vectors = column_vectors(matrix, orthonormal)
    space = PETSc.NullSpace().create(vectors=vectors, comm=matrix.comm)
    matrix.setNearNullSpace(space)
    if kernel:
        matrix.setNullSpace(space)


def _check_factors(factor: PETSc.Mat, package: str, options_prefix: str) -> None:
    """Check the factors of MUMPS; other packages raise errors in the factorisation.

    Raises
    ------
    SolverError
        If MUMPS failed or found negative pivots.
    """
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
            f"{detail}): choose solver = 'iterative', or run with PETSC_OPTIONS='-{options_prefix}"
            "mat_mumps_icntl_4 2' for details"
        )
    if negative:
        raise SolverError(
            f"the stiffness matrix has {negative} negative pivots: it is not positive "
            "semidefinite, or it is singular for motions other than the rigid ones"
        )


# Room for columns

#: Largest number of columns that `room_for_columns` keeps in memory.
KEPT_COLUMNS = 128


def scratch_folder() -> str:
    """Folder for large temporary files: TMPDIR if set, else /var/tmp (/tmp may be in memory)."""
    folder = os.environ.get("TMPDIR")
    if folder:
        return folder
    return "/var/tmp" if os.access("/var/tmp", os.W_OK) else tempfile.gettempdir()


def room_for_columns(rows: int, count: int, comm: MPI.Comm) -> np.ndarray:
    """Make a column-major array (rows, count): in memory if small, else in a temporary file.

    An array with a column for every bore node would need as much memory as all other data of a
    reduction. Above `KEPT_COLUMNS` columns, each rank therefore uses a temporary file without a
    name, which is deleted with the array.

    Parameters
    ----------
    rows
        Number of owned rows.
    count
        Number of columns.
    comm
        Communicator of the ranks that share the columns.

    Raises
    ------
    SolverError
        If the file of a rank does not fit on its disk.
    """
    if count <= KEPT_COLUMNS:
        return np.empty((rows, count), order="F")
    size = max(1, 8 * rows * count)
    failure = ""
    file = tempfile.TemporaryFile(dir=scratch_folder())
    try:
        os.posix_fallocate(file.fileno(), 0, size)  # on a full disk, a mapped file kills the run
    except OSError as error:
        failure = error.strerror or str(error)
    failures = [text for text in comm.allgather(failure) if text]
    if failures:
        raise SolverError(
            f"{count} static responses, {1e-9 * size:.2g} GB per rank, do not fit in "
            f"{scratch_folder()} ({failures[0]}): set TMPDIR to a larger folder"
        )
    return np.ndarray((rows, count), buffer=mmap(file.fileno(), size), order="F")


#: Largest relative residual of a static solve, in the 2-norm. The residual is evaluated for a
#: random combination of the columns, which is wrong if any column is.
RESIDUAL_TOLERANCE = 1e-8

#: Largest number of refinements of the responses of a part whose K is rounded, and the residual
#: after which no further one is needed, relative to the load. Each makes the residual smaller by
#: the forces in rigid motions times the compliance, 1e-4 for files with 10 digits.
REFINEMENTS = 4
REFINED = 1e-11

#: Largest dimensionless response to balanced loads: displacement over load, times the mean diagonal
#: of K. It is 1e8 for slender parts, and 1e15 or more for a part with a further free motion.
COMPLIANCE_LIMIT = 1e13


def supporting_rows(modes: np.ndarray, comm: MPI.Comm) -> np.ndarray:
    """Global numbers of dofs which, if held, are a statically determinate support of a part.

    These dofs are the pivot rows of the rigid-body modes `modes`. Loads in equilibrium cause no
    reactions at the support, so that the support changes the response by a rigid motion only.
    """
    from scipy import linalg

    rows = np.vstack(comm.allgather(modes))
    return linalg.qr(rows.T, mode="r", pivoting=True)[1][: modes.shape[1]]


class StaticSolver:
    """Solver for the elastic static response of a part: the ``G`` block of (29).

    The load is brought into equilibrium with the inertia forces of the rigid acceleration that it
    causes. The response is computed with a statically determinate support, and its rigid motion is
    subtracted. The result is the solution of the saddle-point system (29), but no dense rows are
    needed. For a clamped part, which has no rigid-body modes, this is an ordinary solve. An
    iterative solver uses the singular matrix without a support, because supports at single nodes
    would slow the iteration down.

    If K was rounded in a file, rigid motions U have small elastic forces, so that the support of a
    free part has reactions. The response is then that of ``P^T K P`` with ``P = 1 - U U^T M``,
    which differs from K by no more than the rounding and has no such forces; it is computed by
    iterative refinement.

    Parameters
    ----------
    structure
        Matrices and geometry of the part.
    solver
        ``"direct"``, ``"iterative"``, or ``"auto"`` to choose by the number of dofs.
    options_prefix
        Prefix of the PETSc options of the linear solver.
    mass
        Operator of products with the mass matrix M, if it exists already; None to make a new one.
    motions
        Rigid motions of the part, if `check_structure` has computed them; None to compute them.
    clamped
        Global numbers of the nodes that are held, the same on every rank; None if no nodes are
        held. With held nodes, the flexibility is the inverse of ``K_ii`` of (21), and the part has
        no rigid-body modes.
    once
        Whether only this solver uses the structure, for a few solves. The mass matrix is then
        freed, and factors are stored on disk, which needs less than two thirds of the memory.
    work
        Counts to which the counts of this solver are added; None: new counts.

    Attributes
    ----------
    rigid_modes
        Mass-orthonormal rigid-body modes U of (26), rows of this rank, shape (owned dofs, 6 or 0).
    mass
        Operator of products with M.
    work
        Counts of factorisations and solves.

    Raises
    ------
    SolverError
        If the matrix cannot be factorised.
    VerificationError
        If the part has a motion of nearly no strain energy that is not rigid.
    """

    def __init__(
        self,
        structure: Structure,
        *,
        solver: str = "auto",
        options_prefix: str = "static_",
        mass: MassOperator | None = None,
        motions: RigidMotions | None = None,
        clamped: np.ndarray | None = None,
        once: bool = False,
        work: Work | None = None,
    ):
        self.structure = structure
        self.work = work or Work()
        self.mass = mass or MassOperator(structure.mass)
        matrix = structure.stiffness.copy()
        direct = is_direct(solver, structure.size)
        rows = structure.stiffness.local_size[0]
        first, last = matrix.getOwnershipRange()
        self.rigid_modes = np.zeros((rows, 0))
        self._rounded = False
        held = np.zeros(0, dtype=np.int32)
        if clamped is not None:
            held = (3 * clamped[:, None] + np.arange(3)).ravel()
        else:
            if motions is None:
                motions = rigid_motions(
                    structure.stiffness, structure.coordinates, structure.digits
                )
            self.rigid_modes = _mass_orthonormal(structure, motions)
            self._rounded = motions.free and motions.rounding is not None
            if direct and self.rigid_modes.shape[1]:
                held = supporting_rows(self.rigid_modes, structure.comm)
        held = held[(held >= first) & (held < last)].astype(np.int32)
        self._held = held - first
        self._clamped = self._held[: 0 if clamped is None else None]
        self._mass_rigid = self.mass.multiply(self.rigid_modes)
        if once:
            self.mass.free_matrix()
        matrix.zeroRowsColumns(held, diag=mean_diagonal(structure.stiffness))
        with self.work.progress.stage(f"factorisation, {structure.size} unknowns"):
            self.linear = LinearSolver(
                matrix,
                direct=direct,
                near_kernel=rigid_fields(structure.coordinates),
                kernel=self.rigid_modes.shape[1] > 0,
                options_prefix=options_prefix,
                on_disk=once or structure.size > IN_CORE_LIMIT,
            )
        self.work.factorisations += 1
        if direct:
            matrix.destroy()
        self._check_compliance()

    def equilibrate(self, loads: np.ndarray) -> np.ndarray:
        """Subtract from loads the inertia forces of the rigid acceleration; zero at held nodes."""
        moved = inner(self.rigid_modes, loads, self.structure.comm)
        balanced = loads - combine(self._mass_rigid, moved)
        balanced[self._clamped] = 0.0
        return balanced

    def admissible(self, columns: np.ndarray) -> np.ndarray:
        """Make columns mass-orthogonal to the rigid-body modes and zero at held nodes."""
        moved = inner(self._mass_rigid, columns, self.structure.comm)
        elastic = columns - combine(self.rigid_modes, moved)
        elastic[self._clamped] = 0.0
        return elastic

    #: Part of given forces that deforms the part; eigensolvers use `equilibrate` under this name.
    without_reactions = equilibrate

    def apply(self, loads: np.ndarray) -> np.ndarray:
        """Compute static responses as `solve` does, but without a check, for an eigensolver."""
        balanced = self.equilibrate(loads)
        response = self._supported(balanced.copy() if self._rounded else balanced)
        size = norm(balanced, self.structure.comm) if self._rounded else 0.0
        for _ in range(REFINEMENTS if self._rounded else 0):
            defect = balanced - self.elastic_forces(response)
            if norm(defect, self.structure.comm) <= REFINED * size:
                break
            response += self._supported(defect)
        return response

    def _supported(self, balanced: np.ndarray) -> np.ndarray:
        """Responses of the supported part, without their rigid motions; `balanced` is changed."""
        balanced[self._held] = 0.0
        self.work.solved_columns += balanced.shape[1]
        return self.admissible(self.linear.solve(balanced))

    def solve(self, loads: np.ndarray) -> np.ndarray:
        """Compute and check static responses to loads: G of (29) times the loads.

        Parameters
        ----------
        loads
            Load columns, rows of this rank, shape (owned dofs, k) [N].

        Returns
        -------
        numpy.ndarray
            Displacements, same shape [m], mass-orthogonal to the rigid-body modes.

        Raises
        ------
        VerificationError
            If the residual of (29), relative to the loads, exceeds `RESIDUAL_TOLERANCE`.
        """
        response = self.apply(loads)
        verify_responses(self, self.equilibrate(loads), response)
        return response

    def elastic_forces(self, columns: np.ndarray) -> np.ndarray:
        """Elastic forces ``K x`` of displacements x; of a rounded K those of ``P^T K P``."""
        if not self._rounded:
            return multiply(self.structure.stiffness, columns)
        return self.equilibrate(multiply(self.structure.stiffness, self.admissible(columns)))

    def _check_compliance(self) -> None:
        """Refuse a part with a motion of nearly no strain energy that is not a rigid motion.

        Raises
        ------
        VerificationError
            If the compliance times the mean diagonal entry of K exceeds `COMPLIANCE_LIMIT`.
        """
        structure = self.structure
        first = structure.stiffness.getOwnershipRange()[0]
        rows = structure.stiffness.local_size[0]
        # Two steps of inverse iteration are enough to find a motion without energy.
        load = np.cos(0.7 * np.arange(first, first + rows) ** 2.0)[:, None]
        for _ in range(2):
            load = self.equilibrate(load)
            load /= norm(load, structure.comm)
            response = self.apply(load)
            compliance = norm(response, structure.comm) * mean_diagonal(structure.stiffness)
            if not compliance <= COMPLIANCE_LIMIT:
                raise VerificationError(
                    "the part has a motion of nearly no strain energy besides its "
                    f"{self.rigid_modes.shape[1]} rigid ones (compliance {compliance:.1e}, limit "
                    f"{COMPLIANCE_LIMIT:.0e}): is a node or a piece of the part loose?"
                )
            load = response


def mean_diagonal(matrix: PETSc.Mat) -> float:
    """Mean of the diagonal entries of a matrix."""
    diagonal = matrix.getDiagonal()
    mean = diagonal.sum() / diagonal.getSize()
    diagonal.destroy()
    return mean


def verify_responses(solver: StaticSolver, loads: np.ndarray, responses: np.ndarray) -> None:
    """Check ``K x = f`` for a random combination of static responses x and of their loads f.

    Raises
    ------
    VerificationError
        If the residual, relative to the combined load, exceeds `RESIDUAL_TOLERANCE`.
    """
    if not loads.shape[1]:
        return
    # Columns are scaled to unit norm, so that errors of small columns count as those of large ones.
    comm = solver.structure.comm
    sizes = np.sqrt(comm.allreduce(np.sum(loads**2, axis=0)))
    signs = np.random.default_rng(0).choice([-1.0, 1.0], loads.shape[1])
    weights = signs / np.where(sizes > 0, sizes, 1.0)
    load = loads @ weights[:, None]
    defect = solver.elastic_forces(responses @ weights[:, None]) - load
    ratio = norm(defect, comm) / max(norm(load, comm), 1e-300)
    if not ratio <= RESIDUAL_TOLERANCE:
        raise VerificationError(
            f"static responses have a relative residual of {ratio:.1e}, above "
            f"{RESIDUAL_TOLERANCE:.0e}: is the stiffness matrix symmetric and non-singular, and "
            "were all digits written (check_matrices reports on them)?"
        )
