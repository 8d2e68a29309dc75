"""Static responses of a free or clamped part, (29), from one factorisation."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fenics_ehd.errors import VerificationError
from fenics_ehd.petsc_options import configure, solve_columns
from fenics_ehd.reduction.distributed import dense_matrix, inner, multiply
from fenics_ehd.reduction.rigid_body import rigid_body_modes
from fenics_ehd.reduction.structure import Structure

DEFAULT_OPTIONS = {
    "ksp_type": "preonly",
    "pc_type": "cholesky",
    "pc_factor_mat_solver_type": "mumps",
}

#: Largest relative residual of a static solve, in the 2-norm over all columns.
RESIDUAL_TOLERANCE = 1e-8


def supporting_rows(modes: np.ndarray, first_row: int, comm: MPI.Comm) -> np.ndarray:
    """Global dofs that hold every rigid mode exactly once (pivoted Gram-Schmidt on the rows).

    A statically determinate support: loads in equilibrium cause no reaction
    there, so holding these dofs changes the response by a rigid motion only.
    """
    remaining = modes.copy()
    rows = []
    for _ in range(modes.shape[1]):
        norms = np.einsum("ij,ij->i", remaining, remaining)
        local = int(np.argmax(norms)) if len(norms) else -1
        best = (norms[local], -(first_row + local)) if len(norms) else (-1.0, 0)
        value, negative_row = comm.allreduce(best, op=MPI.MAX)
        owner = len(norms) and first_row + local == -negative_row
        pivot = comm.allreduce(remaining[local] if owner else np.zeros(modes.shape[1]), op=MPI.SUM)
        remaining -= np.outer(remaining @ pivot, pivot) / value
        rows.append(-negative_row)
    return np.array(rows, dtype=np.int32)


class StaticSolver:
    """Applies the elastic flexibility of a part: the ``G`` block of (29).

    The load is made self-equilibrated with the inertia of its rigid
    acceleration, solved on a determinate support, and the rigid motion removed,
    which is the saddle-point system (29) without its dense rows. A clamped part
    has no rigid modes, and the same lines are a plain solve.

    Parameters
    ----------
    structure
        The part.
    options_prefix
        Prefix of the PETSc options of the factorisation.
    """

    def __init__(self, structure: Structure, *, options_prefix: str = "static_"):
        self.structure = structure
        self.rigid_modes = rigid_body_modes(structure)
        self._mass_rigid = multiply(structure.mass, self.rigid_modes)
        first = structure.stiffness.getOwnershipRange()[0]
        held = supporting_rows(self.rigid_modes, first, structure.comm)
        rows = structure.stiffness.local_size[0]
        self._held = held[(held >= first) & (held < first + rows)] - first
        matrix = structure.stiffness.copy()
        scale = structure.stiffness.getDiagonal().sum() / structure.size
        matrix.zeroRowsColumns(held, diag=scale)
        self._ksp = PETSc.KSP().create(structure.stiffness.comm)
        self._ksp.setOperators(matrix)
        configure(self._ksp, options_prefix, DEFAULT_OPTIONS)
        self._ksp.setUp()

    def equilibrate(self, loads: np.ndarray) -> np.ndarray:
        """Loads less the inertia of the rigid acceleration they cause."""
        return loads - self._mass_rigid @ inner(self.rigid_modes, loads, self.structure.comm)

    def remove_rigid_motion(self, columns: np.ndarray) -> np.ndarray:
        """Columns made mass-orthogonal to the rigid-body modes."""
        return columns - self.rigid_modes @ inner(self._mass_rigid, columns, self.structure.comm)

    def apply(self, loads: np.ndarray) -> np.ndarray:
        """Static response without the check of `solve`, for use inside an eigensolver."""
        balanced = self.equilibrate(loads)
        balanced[self._held] = 0.0
        comm = self.structure.stiffness.comm
        rhs = dense_matrix(balanced, comm)
        response = dense_matrix(np.zeros_like(balanced), comm)
        solve_columns(self._ksp, rhs, response)
        columns = np.array(response.getDenseArray())
        rhs.destroy()
        response.destroy()
        return self.remove_rigid_motion(columns)

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
        if loads.shape[1] == 0:
            return np.zeros_like(loads)
        response = self.apply(loads)
        balanced = self.equilibrate(loads)
        defect = multiply(self.structure.stiffness, response) - balanced
        comm = self.structure.comm
        ratio = np.sqrt(
            comm.allreduce(np.sum(defect**2)) / max(comm.allreduce(np.sum(balanced**2)), 1e-300)
        )
        if not ratio <= RESIDUAL_TOLERANCE:
            raise VerificationError(
                f"static responses leave a relative residual of {ratio:.1e}, above "
                f"{RESIDUAL_TOLERANCE:.0e}: is the stiffness matrix symmetric and non-singular?"
            )
        return response
