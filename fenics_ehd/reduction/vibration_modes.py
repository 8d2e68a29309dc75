"""Free-floating vibration modes (27), (28) by SLEPc."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from slepc4py import SLEPc

from fenics_ehd.errors import SolverError, VerificationError
from fenics_ehd.petsc_options import configure
from fenics_ehd.reduction.distributed import inner, multiply
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.reduction.structure import Structure

#: Tolerance of SLEPc's residual, and of our own check of it, relative to the eigenvalue.
EIGEN_TOLERANCE = 1e-10
RESIDUAL_TOLERANCE = 1e-6


class _Flexibility:
    """Python preconditioner that applies the elastic flexibility: exact on deflated vectors."""

    def __init__(self, solver: StaticSolver):
        self._solver = solver

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.array = self._solver.apply(x.getArray(readonly=True).reshape(-1, 1))[:, 0]


def vibration_modes(
    solver: StaticSolver, count: int, *, options_prefix: str = "modes_"
) -> tuple[np.ndarray, np.ndarray]:
    """Lowest elastic modes of the part, mass-normalised.

    Shift-invert at zero on the space deflated by the exact rigid-body modes, so
    none is lost and the factorisation of the static responses serves again.

    Parameters
    ----------
    solver
        Static solver of the part.
    count
        Number of modes ``n_v``.

    Returns
    -------
    angular_frequencies : numpy.ndarray
        shape (count,) [rad/s], ascending.
    modes : numpy.ndarray
        Owned rows, shape (owned dofs, count), ``Phi^T M Phi = I`` (28).

    Raises
    ------
    SolverError
        SLEPc converged fewer modes than asked for.
    VerificationError
        A residual exceeds `RESIDUAL_TOLERANCE`.
    """
    structure = solver.structure
    rows = structure.stiffness.local_size[0]
    if count == 0:
        return np.zeros(0), np.zeros((rows, 0))
    eps = SLEPc.EPS().create(structure.stiffness.comm)
    eps.setOperators(structure.stiffness, structure.mass)
    eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    eps.setTarget(0.0)
    eps.setDimensions(count)
    eps.setTolerances(EIGEN_TOLERANCE, 500)
    template = structure.stiffness.createVecLeft()
    deflated = []
    for column in solver.rigid_modes.T:
        vector = template.duplicate()
        vector.array = column
        deflated.append(vector)
    if deflated:
        eps.setDeflationSpace(deflated)
    transform = eps.getST()
    transform.setType(SLEPc.ST.Type.SINVERT)
    ksp = transform.getKSP()
    ksp.setType(PETSc.KSP.Type.PREONLY)
    ksp.pc.setType(PETSc.PC.Type.PYTHON)
    ksp.pc.setPythonContext(_Flexibility(solver))
    configure(eps, options_prefix, {})
    eps.solve()
    if eps.getConverged() < count:
        raise SolverError(
            f"SLEPc converged {eps.getConverged()} of {count} vibration modes: "
            f"ask for fewer or raise -{options_prefix}eps_max_it"
        )
    modes = np.empty((rows, count))
    eigenvalues = np.empty(count)
    for i in range(count):
        eigenvalues[i] = eps.getEigenpair(i, template).real
        modes[:, i] = template.array
    order = np.argsort(eigenvalues)
    # SLEPc's purification applies K, whose round-off reintroduces rigid motion in a soft part.
    eigenvalues, modes = eigenvalues[order], solver.remove_rigid_motion(modes[:, order])
    modes /= np.sqrt(np.diag(inner(modes, multiply(structure.mass, modes), structure.comm)))
    _verify(structure, eigenvalues, modes)
    return np.sqrt(eigenvalues), _orient(structure, modes)


def _verify(structure: Structure, eigenvalues: np.ndarray, modes: np.ndarray) -> None:
    inertia = multiply(structure.mass, modes) * eigenvalues
    defect = multiply(structure.stiffness, modes) - inertia
    norms = np.sqrt([structure.comm.allreduce(np.sum(a**2, axis=0)) for a in (defect, inertia)])
    worst = np.max(norms[0] / norms[1])
    if not worst <= RESIDUAL_TOLERANCE:
        raise VerificationError(
            f"a vibration mode has relative residual {worst:.1e}, above {RESIDUAL_TOLERANCE:.0e}"
        )
    gram = inner(modes, multiply(structure.mass, modes), structure.comm)
    defect = np.abs(gram - np.eye(len(gram))).max()
    if not defect <= RESIDUAL_TOLERANCE:
        raise VerificationError(f"vibration modes are not mass-orthonormal: defect {defect:.1e}")


def _orient(structure: Structure, modes: np.ndarray) -> np.ndarray:
    """Fix the sign of each mode by its product with a field of no symmetry."""
    size = structure.comm.allreduce(np.abs(structure.coordinates).max(initial=0.0), op=MPI.MAX)
    x, y, z = (structure.coordinates / size).T
    field = np.stack([x + y**2, x**2 + 2 * y - z, 3 * z + x * y], axis=1).reshape(-1, 1)
    signs = np.sign(inner(modes, field, structure.comm)[:, 0])
    return modes * np.where(signs == 0, 1.0, signs)
