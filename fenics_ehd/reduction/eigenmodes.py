"""Lowest vibration modes of a part, computed by SLEPc: fixed-boundary (20), free (27), (28).

Fixed-boundary modes need static responses of the part with its boundary held, (18) and (19). The
motions of the boundary points A and of the bore's centre C2 are means over surfaces, so that
holding them is the constraint ``C^T x = 0``. With the elastic flexibility G of (29) and the
rigid-body modes U, the response to forces f is ``G (f - C mu) + U alpha``, where the reactions mu
and the rigid motion alpha satisfy

    C^T G C mu - C^T U alpha = C^T G f,       U^T C mu = U^T f.

Thus the factorisation of the free part is used again, with a correction of a few columns.
"""

from __future__ import annotations

from typing import Any

import fenics_ehd.base.petsc_start  # noqa: F401  # isort: skip
import numpy as np
from petsc4py import PETSc

from fenics_ehd.base.errors import SettingsError, SolverError, VerificationError
from fenics_ehd.base.petsc_options import configure
from fenics_ehd.base.processes import in_neutral_folder
from fenics_ehd.base.progress import Stage
from fenics_ehd.reduction.matrices import MassOperator, column_vectors, combine, inner
from fenics_ehd.reduction.static import StaticSolver, Work
from fenics_ehd.reduction.structure import Structure

with in_neutral_folder():  # slepc4py searches the current folder for petsc.cfg
    from slepc4py import SLEPc

#: Tolerance of the residual in SLEPc, relative to the eigenvalue.
EIGEN_TOLERANCE = 1e-10

#: Largest residual of a mode in the check of the result, relative to the eigenvalue.
RESIDUAL_TOLERANCE = 1e-6

#: Relative tolerance of the lowest eigenvalue that may have been missed. It is loose, as a missed
#: eigenvalue is well below the highest computed one, and tight convergence above it is slow: the
#: eigenvalues there are close to each other.
COUNT_TOLERANCE = 1e-2

#: Expected number of solves over the number of vectors in the basis of the eigensolver, for the
#: progress (measured: 1.28 for 20 and for 37 modes).
EXPECTED = 1.3

#: Largest number of times that missed modes are added.
ROUNDS = 4


class _Inverse:
    """Python preconditioner that applies a flexibility, the inverse of K on admissible motions.

    Parameters
    ----------
    flexibility
        Static response of the part.
    stage
        Stage of the progress, in solves.
    """

    def __init__(self, flexibility: Flexibility, stage: Stage):
        self._flexibility = flexibility
        self._stage = stage
        self._solves = 0
        self._converged = ""

    def restart(self, _eps: SLEPc.EPS, _its: int, count: int, _values: Any, _errors: Any) -> None:
        """Keep the number of converged modes for the progress; SLEPc calls this at restarts."""
        self._converged = f"{count} converged"

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Set y to the static response to x; PETSc calls this method."""
        self._flexibility.work.eigensolver_applications += 1
        self._solves += 1
        self._stage.to(self._solves, self._converged)
        y.array = self._flexibility.apply(x.getArray(readonly=True).reshape(-1, 1))[:, 0]


def lowest_modes(
    flexibility: Flexibility, count: int, *, options_prefix: str = "modes_"
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the lowest elastic modes of a part, mass-normalised.

    The eigensolver uses shift-and-invert with zero shift, on the space orthogonal to the exact
    rigid-body modes. The inverse is the static response with its factorisation. If the eigensolver
    misses modes, they are searched for and added.

    Parameters
    ----------
    flexibility
        Static response of the part, free, clamped or with its boundary held.
    count
        Number of modes.
    options_prefix
        Prefix of the PETSc options of the eigensolver.

    Returns
    -------
    angular_frequencies : numpy.ndarray
        Angular frequencies in ascending order, shape (count,) [rad/s].
    modes : numpy.ndarray
        Modes with ``Phi^T M Phi = I`` (28), rows of this rank, shape (owned dofs, count).

    Raises
    ------
    SettingsError
        If the number exceeds a quarter of the number of degrees of freedom.
    SolverError
        If SLEPc converges fewer modes than requested.
    VerificationError
        If a residual exceeds `RESIDUAL_TOLERANCE`, or if modes are still missing after `ROUNDS`
        attempts.
    """
    structure = flexibility.structure
    if not 0 <= count <= structure.size // 4:
        raise SettingsError(
            f"{count} modes: must be between 0 and {structure.size // 4}, a quarter of the "
            "degrees of freedom"
        )
    if count == 0:
        return np.zeros(0), np.zeros((structure.stiffness.local_size[0], 0))
    start = flexibility.apply(_scattered(structure, 0.0)[:, None])
    progress = flexibility.work.progress
    with progress.stage(f"{count} vibration modes", unit="solves") as stage:
        eigenvalues, modes = _solve(
            flexibility,
            count,
            start,
            flexibility.rigid_modes,
            EIGEN_TOLERANCE,
            options_prefix,
            stage,
        )
    with progress.stage("search for missed modes", unit="solves") as stage:
        eigenvalues, modes = _with_missed(flexibility, eigenvalues, modes, options_prefix, stage)
    # Round-off in the Krylov vectors causes small rigid motions and motions of the boundary.
    modes = flexibility.admissible(modes)
    norms = structure.comm.allreduce(np.sum(modes * flexibility.mass.multiply(modes), axis=0))
    modes /= np.sqrt(norms)
    _verify(flexibility, eigenvalues, modes)
    return np.sqrt(eigenvalues), _orient(structure, modes)


class LowestModes:
    """Lowest modes of a part, as a function of the number of modes.

    The modes are computed again only if more modes are requested than before.
    """

    def __init__(self, flexibility: Flexibility, options_prefix: str):
        self._flexibility = flexibility
        self._prefix = options_prefix
        self._angular, self._modes = lowest_modes(flexibility, 0)

    def __call__(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Angular frequencies [rad/s] and modes, see `lowest_modes`."""
        if not 0 <= count <= len(self._angular):
            self._angular, self._modes = lowest_modes(
                self._flexibility, count, options_prefix=self._prefix
            )
        return self._angular[:count], self._modes[:, :count]


def _solve(
    flexibility: Flexibility,
    count: int,
    start: np.ndarray,
    deflated: np.ndarray,
    tolerance: float,
    options_prefix: str,
    stage: Stage,
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the lowest eigenvalues, ascending, and modes by SLEPc.

    Parameters
    ----------
    flexibility, count, options_prefix
        See `lowest_modes`.
    start
        Start vector, rows of this rank, shape (owned dofs, 1).
    deflated
        Known modes, to which the computed modes are M-orthogonal; rows of this rank.
    tolerance
        Tolerance of the residual, relative to the eigenvalue.
    stage
        Stage of the progress.
    """
    structure = flexibility.structure
    eps = SLEPc.EPS().create(structure.stiffness.comm)
    eps.setOperators(structure.stiffness, flexibility.mass.matrix)
    eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    eps.setTarget(0.0)
    # The basis has only few more vectors than modes: to orthogonalise more costs as much as solves.
    vectors_kept = min(count + int(np.clip(count, 15, 45)), structure.size)
    eps.setDimensions(count, vectors_kept)
    stage.total = round(EXPECTED * vectors_kept)
    eps.setTolerances(tolerance, 500)
    # Purification costs one more solve for every mode; `admissible` replaces it.
    eps.setPurify(False)
    vectors = [column_vectors(structure.stiffness, columns) for columns in (start, deflated)]
    eps.setInitialSpace(vectors[0])
    if vectors[1]:
        eps.setDeflationSpace(vectors[1])
    transform = eps.getST()
    transform.setType(SLEPc.ST.Type.SINVERT)
    ksp = transform.getKSP()
    ksp.setType(PETSc.KSP.Type.PREONLY)
    ksp.pc.setType(PETSc.PC.Type.PYTHON)
    inverse = _Inverse(flexibility, stage)
    ksp.pc.setPythonContext(inverse)
    eps.setMonitor(inverse.restart)
    configure(eps, options_prefix, {})
    vector = structure.stiffness.createVecLeft()
    try:
        eps.solve()
        if eps.getConverged() < count:
            raise SolverError(
                f"SLEPc converged {eps.getConverged()} of {count} modes: "
                f"request fewer modes or raise -{options_prefix}eps_max_it"
            )
        modes = np.empty((len(start), count), order="F")
        eigenvalues = np.empty(count)
        for i in range(count):
            eigenvalues[i] = eps.getEigenpair(i, vector).real
            modes[:, i] = vector.array
    finally:
        # Destroyed explicitly, the solver before its parts: otherwise PETSc keeps them until exit.
        # The preconditioner refers to the factors, which must not outlive the interpreter.
        for owned in [eps, transform, ksp, vector, *vectors[0], *vectors[1]]:
            owned.destroy()
    order = np.argsort(eigenvalues)
    return eigenvalues[order], modes[:, order]


def _scattered(structure: Structure, phase: float) -> np.ndarray:
    """Pseudo-random nodal loads, shape (owned dofs,), the same on any number of ranks.

    The loads contain every mode. Different phases give different loads.
    """
    angle = (
        structure.coordinates / structure.largest_coordinate @ np.array([12.9898, 78.233, 37.719])
        + phase
    )
    scattered = [1e4 * np.sin(angle + component) for component in (0.3, 1.7, 3.1)]
    return np.mod(np.stack(scattered, axis=1), 1.0).ravel() - 0.5


def _verify(flexibility: Flexibility, eigenvalues: np.ndarray, modes: np.ndarray) -> None:
    """Check the residual of every mode.

    Whether modes are orthonormal is checked later, together with the other columns of a basis.

    Raises
    ------
    VerificationError
        If the largest residual, relative to the inertia forces, exceeds `RESIDUAL_TOLERANCE`.
    """
    structure = flexibility.structure
    inertia = flexibility.mass.multiply(modes) * eigenvalues
    defect = flexibility.without_reactions(flexibility.elastic_forces(modes) - inertia)
    norms = np.sqrt([structure.comm.allreduce(np.sum(a**2, axis=0)) for a in (defect, inertia)])
    worst = np.max(norms[0] / norms[1])
    if not worst <= RESIDUAL_TOLERANCE:
        raise VerificationError(
            f"a mode has a relative residual of {worst:.1e}, above {RESIDUAL_TOLERANCE:.0e}"
        )


def _with_missed(
    flexibility: Flexibility,
    eigenvalues: np.ndarray,
    modes: np.ndarray,
    options_prefix: str,
    stage: Stage,
) -> tuple[np.ndarray, np.ndarray]:
    """Add modes that the solver has missed, such as the second of two modes of equal frequency.

    The lowest mode that is orthogonal to the known modes is computed with another start vector. If
    its eigenvalue is below the highest known eigenvalue, a mode was missed: further modes are
    computed, and the lowest of all modes are kept. This is repeated until no mode is missing.

    Raises
    ------
    VerificationError
        If modes are still missing after `ROUNDS` attempts.
    """
    structure = flexibility.structure
    count = len(eigenvalues)
    if structure.size < 3 * count:
        return eigenvalues, modes
    start = flexibility.apply(_scattered(structure, 0.5)[:, None])
    for _ in range(ROUNDS):
        known = np.hstack([flexibility.rigid_modes, modes])
        lowest, _ = _solve(flexibility, 1, start, known, COUNT_TOLERANCE, options_prefix, stage)
        # A Ritz value is not below its eigenvalue: an equal one is the next mode, not a missed one.
        if lowest[0] > (1.0 - 1e-6) * eigenvalues[-1]:
            return eigenvalues, modes
        further, further_modes = _solve(
            flexibility, count, start, known, EIGEN_TOLERANCE, options_prefix, stage
        )
        values = np.concatenate([eigenvalues, further])
        order = np.argsort(values)[:count]
        eigenvalues = values[order]
        modes = np.hstack([modes, further_modes])[:, order]
    frequencies = np.sqrt([lowest[0], eigenvalues[-1]]) / (2 * np.pi)
    raise VerificationError(
        f"SLEPc misses modes: after {ROUNDS} attempts, a mode of {frequencies[0]:.6g} Hz was still "
        f"missing among the modes up to {frequencies[1]:.6g} Hz: raise -{options_prefix}eps_ncv"
    )


def _orient(structure: Structure, modes: np.ndarray) -> np.ndarray:
    """Choose the sign of each mode so that its product with an unsymmetric field is positive."""
    x, y, z = (structure.coordinates / structure.largest_coordinate).T
    field = np.stack([x + y**2, x**2 + 2 * y - z, 3 * z + x * y], axis=1).reshape(-1, 1)
    signs = np.sign(inner(modes, field, structure.comm)[:, 0])
    return modes * np.where(signs == 0, 1.0, signs)


# Parts with held boundary

#: Reciprocal condition number above which constraints count as independent.
INDEPENDENT = 1e-12


class FixedBoundary:
    """Static response of a part under the constraints ``C^T x = 0``, which hold its boundary.

    Parameters
    ----------
    support
        Static response of the part without these constraints.
    constraints
        Columns of C, rows of this rank, shape (owned dofs, c), c >= 1.

    Raises
    ------
    VerificationError
        If the constraints do not hold every rigid motion, or are linearly dependent.
    """

    def __init__(self, support: Flexibility, constraints: np.ndarray):
        self.structure: Structure = support.structure
        self.mass: MassOperator = support.mass
        self.work: Work = support.work
        self.rigid_modes: np.ndarray = support.rigid_modes[:, :0]
        self._support = support
        comm = self.structure.comm
        rigid = support.rigid_modes
        self._constraints = constraints
        self._responses = support.apply(constraints)
        flexibility = inner(constraints, self._responses, comm)
        self._lever = inner(constraints, rigid, comm)
        # Scaled, as flexibilities are about 1e-9 and lever arms 1: the system would be singular.
        sizes = np.sqrt(np.abs(np.diag(flexibility)))
        self._sizes = np.where(sizes > 0, sizes, 1.0)
        lever = self._lever / self._sizes[:, None]
        self._motion = 1.0 / max(np.abs(lever).max(initial=0.0), 1e-300)
        lever = lever * self._motion
        n = rigid.shape[1]
        self._matrix = np.block(
            [
                [flexibility / np.outer(self._sizes, self._sizes), -lever],
                [lever.T, np.zeros((n, n))],
            ]
        )
        singular = np.linalg.svd(self._matrix, compute_uv=False)
        if not singular[-1] > INDEPENDENT * singular[0]:
            raise VerificationError(
                f"the {constraints.shape[1]} boundary constraints are linearly dependent or do not "
                f"hold every rigid motion (reciprocal condition {singular[-1] / singular[0]:.1e}, "
                f"limit {INDEPENDENT:.0e}): is a boundary point given twice?"
            )

    def _hold(self, prescribed: np.ndarray, balance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Solve for the reactions mu at the boundary and the rigid motion alpha.

            C^T G C mu - C^T U alpha = prescribed,       U^T C mu = balance

        C are the constraints, G is the elastic flexibility and U the rigid-body modes.

        Parameters
        ----------
        prescribed
            Right-hand side of the first equation, shape (c, k).
        balance
            Right-hand side of the second equation, shape (rigid-body modes, k).
        """
        right = np.vstack([prescribed / self._sizes[:, None], balance * self._motion])
        solution = np.linalg.solve(self._matrix, right)
        c = len(self._sizes)
        return solution[:c] / self._sizes[:, None], solution[c:] * self._motion

    def apply(self, loads: np.ndarray) -> np.ndarray:
        """Static responses to loads with the boundary held; both have shape (owned dofs, k)."""
        comm = self.structure.comm
        rigid = self._support.rigid_modes
        response = self._support.apply(loads)
        reactions, motion = self._hold(
            inner(self._constraints, response, comm), inner(rigid, loads, comm)
        )
        response -= combine(self._responses, reactions)
        if rigid.shape[1]:
            response += combine(rigid, motion)
        return response

    def elastic_forces(self, columns: np.ndarray) -> np.ndarray:
        """Elastic forces ``K x`` of displacements x, see `StaticSolver.elastic_forces`."""
        return self._support.elastic_forces(columns)

    def constraint_modes(self, prescribed: np.ndarray) -> np.ndarray:
        """Static modes of (19): displacements under reactions alone, with prescribed ``C^T x``.

        Parameters
        ----------
        prescribed
            Values of ``C^T x``, shape (c, k).

        Returns
        -------
        numpy.ndarray
            Displacements, rows of this rank, shape (owned dofs, k).
        """
        rigid = self._support.rigid_modes
        reactions, motion = self._hold(-prescribed, np.zeros((rigid.shape[1], prescribed.shape[1])))
        return combine(rigid, motion) - combine(self._responses, reactions)

    def _orthogonal(self, columns: np.ndarray) -> np.ndarray:
        """Make columns orthogonal to C, by subtracting combinations of the columns of C."""
        constraints = self._constraints
        comm = self.structure.comm
        gram = inner(constraints, constraints, comm)
        share = np.linalg.solve(gram, inner(constraints, columns, comm))
        return columns - combine(constraints, share)

    def admissible(self, columns: np.ndarray) -> np.ndarray:
        """Subtract constraint columns from displacements, so that the boundary is at rest."""
        return self._orthogonal(columns if self._lever.size else self._support.admissible(columns))

    def without_reactions(self, forces: np.ndarray) -> np.ndarray:
        """Subtract from forces the reactions at the boundary, which are fitted by least squares."""
        return self._orthogonal(
            forces if self._lever.size else self._support.without_reactions(forces)
        )


#: Static response of a part: free or clamped, or with a held boundary.
Flexibility = StaticSolver | FixedBoundary
