"""Lowest modes of a part by SLEPc: fixed-boundary ones (20), free-floating ones (27), (28).

Modes with boundary points held need responses of the held part, (18) and (19). The boundary points
A and the bore's centre C2 are means over surfaces, so that holding them is ``C^T x = 0``. With G
the elastic flexibility of (29) and U the rigid-body modes, the response to f is
``G (f - C mu) + U alpha`` where

    C^T G C mu - C^T U alpha = C^T G f,       U^T C mu = U^T f,

so the factorisation of the free part serves, corrected by a few columns.
"""

from __future__ import annotations

import fenics_ehd.base.petsc_start  # noqa: F401  # isort: skip
import numpy as np
from petsc4py import PETSc

from fenics_ehd.base.errors import SettingsError, SolverError, VerificationError
from fenics_ehd.base.petsc_options import configure
from fenics_ehd.base.processes import in_neutral_folder
from fenics_ehd.reduction.matrices import MassOperator, column_vectors, combine, inner, multiply
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.reduction.structure import Structure

with in_neutral_folder():  # slepc4py searches the current folder for petsc.cfg
    from slepc4py import SLEPc

#: Tolerance of SLEPc's residual, relative to the eigenvalue.
EIGEN_TOLERANCE = 1e-10

#: Largest residual of a mode in the check of the result, relative to the eigenvalue.
RESIDUAL_TOLERANCE = 1e-6

#: Tolerance of the eigenvalue that is compared with the highest one, to detect missed modes. It is
#: loose because a missed mode is well below the highest one, and modes above are close to each
#: other.
COUNT_TOLERANCE = 1e-2

#: Largest number of attempts to add missed modes.
ROUNDS = 4


class _Inverse:
    """Python preconditioner that applies a flexibility, exact on motions its support admits."""

    def __init__(self, flexibility: Flexibility):
        self._flexibility = flexibility

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.array = self._flexibility.apply(x.getArray(readonly=True).reshape(-1, 1))[:, 0]


def lowest_modes(
    flexibility: Flexibility, count: int, *, options_prefix: str = "modes_"
) -> tuple[np.ndarray, np.ndarray]:
    """Lowest elastic modes of a supported part, mass-normalised.

    Shift-invert at zero on the space deflated by the exact rigid-body modes, so that no mode is
    missed and the factorisation of the static responses is used again.

    Parameters
    ----------
    flexibility
        Flexibility of the part on its support.
    count
        Number of modes.
    options_prefix
        Prefix of the PETSc options of the eigensolver.

    Returns
    -------
    angular_frequencies : numpy.ndarray
        shape (count,) [rad/s], ascending.
    modes : numpy.ndarray
        Owned rows, shape (owned dofs, count), ``Phi^T M Phi = I`` (28).

    Raises
    ------
    SettingsError
        The number exceeds a quarter of the degrees of freedom.
    SolverError
        SLEPc converged fewer modes than requested.
    VerificationError
        A residual exceeds `RESIDUAL_TOLERANCE`, or a lower mode was missed.
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
    eigenvalues, modes = _solve(
        flexibility, count, start, flexibility.rigid_modes, EIGEN_TOLERANCE, options_prefix
    )
    eigenvalues, modes = _with_missed(flexibility, eigenvalues, modes, options_prefix)
    # Round-off of the Krylov vectors reintroduces small motions that the support forbids.
    modes = flexibility.admissible(modes)
    norms = structure.comm.allreduce(np.sum(modes * flexibility.mass.multiply(modes), axis=0))
    modes /= np.sqrt(norms)
    _verify(flexibility, eigenvalues, modes)
    return np.sqrt(eigenvalues), _orient(structure, modes)


class LowestModes:
    """Lowest modes for any number; a smaller number is read from an earlier, larger result."""

    def __init__(self, flexibility: Flexibility, options_prefix: str):
        self._flexibility = flexibility
        self._prefix = options_prefix
        self._angular, self._modes = lowest_modes(flexibility, 0)

    def __call__(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies and modes, see `lowest_modes`."""
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
) -> tuple[np.ndarray, np.ndarray]:
    """Ascending eigenvalues and modes of SLEPc, M-orthogonal to `deflated`."""
    structure = flexibility.structure
    eps = SLEPc.EPS().create(structure.stiffness.comm)
    eps.setOperators(structure.stiffness, flexibility.mass.matrix)
    eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    eps.setTarget(0.0)
    # Few more vectors than modes: orthogonalising long bases costs as much as the solves.
    eps.setDimensions(count, min(count + int(np.clip(count, 15, 45)), structure.size))
    eps.setTolerances(tolerance, 500)
    # Purification costs one more product with the inverse for every mode; `admissible` replaces it.
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
    ksp.pc.setPythonContext(_Inverse(flexibility))
    configure(eps, options_prefix, {})
    vector = structure.stiffness.createVecLeft()
    try:
        eps.solve()
        if eps.getConverged() < count:
            raise SolverError(
                f"SLEPc converged {eps.getConverged()} of {count} modes: "
                f"ask for fewer or raise -{options_prefix}eps_max_it"
            )
        modes = np.empty((len(start), count), order="F")
        eigenvalues = np.empty(count)
        for i in range(count):
            eigenvalues[i] = eps.getEigenpair(i, vector).real
            modes[:, i] = vector.array
    finally:
        # Destroyed explicitly, the solver before its parts: otherwise PETSc keeps them until exit,
        # and with the preconditioner the factors, which must not outlive the interpreter.
        for owned in [eps, transform, ksp, vector, *vectors[0], *vectors[1]]:
            owned.destroy()
    order = np.argsort(eigenvalues)
    return eigenvalues[order], modes[:, order]


def _scattered(structure: Structure, phase: float) -> np.ndarray:
    """Pseudo-random loads, the same on any number of ranks: no mode is orthogonal to them."""
    angle = (
        structure.coordinates / structure.largest_coordinate @ np.array([12.9898, 78.233, 37.719])
        + phase
    )
    scattered = [1e4 * np.sin(angle + component) for component in (0.3, 1.7, 3.1)]
    return np.mod(np.stack(scattered, axis=1), 1.0).ravel() - 0.5


def _verify(flexibility: Flexibility, eigenvalues: np.ndarray, modes: np.ndarray) -> None:
    """Check the residual of every mode; orthonormality is checked for the basis made of them."""
    structure = flexibility.structure
    inertia = flexibility.mass.multiply(modes) * eigenvalues
    defect = flexibility.without_reactions(multiply(structure.stiffness, modes) - inertia)
    norms = np.sqrt([structure.comm.allreduce(np.sum(a**2, axis=0)) for a in (defect, inertia)])
    worst = np.max(norms[0] / norms[1])
    if not worst <= RESIDUAL_TOLERANCE:
        raise VerificationError(
            f"a mode has relative residual {worst:.1e}, above {RESIDUAL_TOLERANCE:.0e}"
        )


def _with_missed(
    flexibility: Flexibility, eigenvalues: np.ndarray, modes: np.ndarray, options_prefix: str
) -> tuple[np.ndarray, np.ndarray]:
    """The lowest modes with missed ones added: one start vector finds one mode of a pair.

    The lowest mode orthogonal to the known ones, computed from another start vector, must not be
    below them. As long as it is, more modes are computed and the lowest of all are kept.
    """
    structure = flexibility.structure
    count = len(eigenvalues)
    if structure.size < 3 * count:
        return eigenvalues, modes
    start = flexibility.apply(_scattered(structure, 0.5)[:, None])
    for _ in range(ROUNDS):
        known = np.hstack([flexibility.rigid_modes, modes])
        lowest, _ = _solve(flexibility, 1, start, known, COUNT_TOLERANCE, options_prefix)
        # Ritz values are above the eigenvalue: a tie differs from a missed mode.
        if lowest[0] > (1.0 - 1e-6) * eigenvalues[-1]:
            return eigenvalues, modes
        further, further_modes = _solve(
            flexibility, count, start, known, EIGEN_TOLERANCE, options_prefix
        )
        values = np.concatenate([eigenvalues, further])
        order = np.argsort(values)[:count]
        eigenvalues = values[order]
        modes = np.hstack([modes, further_modes])[:, order]
    frequencies = np.sqrt([lowest[0], eigenvalues[-1]]) / (2 * np.pi)
    raise VerificationError(
        f"SLEPc misses modes: {frequencies[0]:.6g} Hz below {frequencies[1]:.6g} Hz, the highest "
        f"one, after {ROUNDS} attempts: raise -{options_prefix}eps_ncv"
    )


def _orient(structure: Structure, modes: np.ndarray) -> np.ndarray:
    """Fix the sign of each mode by its product with a field without symmetry."""
    x, y, z = (structure.coordinates / structure.largest_coordinate).T
    field = np.stack([x + y**2, x**2 + 2 * y - z, 3 * z + x * y], axis=1).reshape(-1, 1)
    signs = np.sign(inner(modes, field, structure.comm)[:, 0])
    return modes * np.where(signs == 0, 1.0, signs)


# Boundaries held

#: Smallest reciprocal condition number at which constraints count as independent.
INDEPENDENT = 1e-12


class FixedBoundary:
    """Flexibility of a part with ``C^T x = 0``.

    Parameters
    ----------
    support
        Flexibility of the part without these constraints.
    constraints
        C, owned rows, shape (owned dofs, c), c >= 1.

    Raises
    ------
    VerificationError
        The constraints do not hold every rigid motion, or depend on each other.
    """

    def __init__(self, support: Flexibility, constraints: np.ndarray):
        self.structure: Structure = support.structure
        self.mass: MassOperator = support.mass
        self.rigid_modes: np.ndarray = support.rigid_modes[:, :0]
        self._support = support
        comm = self.structure.comm
        rigid = support.rigid_modes
        self._constraints = constraints
        self._responses = support.apply(constraints)
        flexibility = inner(constraints, self._responses, comm)
        self._lever = inner(constraints, rigid, comm)
        # Flexibilities are 1e-9 and lever arms 1: the unscaled system is numerically singular.
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
                f"the {constraints.shape[1]} boundary constraints depend on each other or leave a "
                f"rigid motion free (reciprocal condition {singular[-1] / singular[0]:.1e}, limit "
                f"{INDEPENDENT:.0e}): is a boundary point named twice?"
            )

    def _hold(self, prescribed: np.ndarray, balance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Reactions mu and rigid motion alpha for the right sides of the system above."""
        right = np.vstack([prescribed / self._sizes[:, None], balance * self._motion])
        solution = np.linalg.solve(self._matrix, right)
        c = len(self._sizes)
        return solution[:c] / self._sizes[:, None], solution[c:] * self._motion

    def apply(self, loads: np.ndarray) -> np.ndarray:
        """Static response with the boundary held, owned rows (owned dofs, k)."""
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

    def constraint_modes(self, prescribed: np.ndarray) -> np.ndarray:
        """Static modes of (19): ``C^T x`` as given, no load but the reactions.

        Parameters
        ----------
        prescribed
            Values of ``C^T x``, shape (c, k).
        """
        rigid = self._support.rigid_modes
        reactions, motion = self._hold(-prescribed, np.zeros((rigid.shape[1], prescribed.shape[1])))
        return combine(rigid, motion) - combine(self._responses, reactions)

    def _orthogonal(self, columns: np.ndarray) -> np.ndarray:
        """Columns made orthogonal to the constraints by subtracting a combination of them."""
        constraints = self._constraints
        comm = self.structure.comm
        gram = inner(constraints, constraints, comm)
        share = np.linalg.solve(gram, inner(constraints, columns, comm))
        return columns - combine(constraints, share)

    def admissible(self, columns: np.ndarray) -> np.ndarray:
        """Columns without motion of the boundary, which forces there remove."""
        return self._orthogonal(columns if self._lever.size else self._support.admissible(columns))

    def without_reactions(self, forces: np.ndarray) -> np.ndarray:
        """Forces minus the reactions of the boundary (least squares)."""
        return self._orthogonal(
            forces if self._lever.size else self._support.without_reactions(forces)
        )


#: Static response of a part, on its supports or with a held boundary.
Flexibility = StaticSolver | FixedBoundary
