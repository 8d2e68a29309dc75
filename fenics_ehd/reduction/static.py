"""Static responses of a free or clamped part, (29), from one factorisation."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from fenics_ehd.base.errors import VerificationError
from fenics_ehd.reduction.distributed import combine, inner, multiply
from fenics_ehd.reduction.linear_solver import LinearSolver, is_direct
from fenics_ehd.reduction.mass import MassOperator
from fenics_ehd.reduction.rigid_body import rigid_body_modes
from fenics_ehd.reduction.rigid_motion import rigid_fields
from fenics_ehd.reduction.structure import Structure

#: Largest relative residual of a static solve, in the 2-norm of one random combination of the
#: columns: a wrong column hides from it with probability zero.
RESIDUAL_TOLERANCE = 1e-8

#: Largest response to random loads in balance, as stiffness of its diagonal times displacement over
#: load. Slender parts reach 1e8; a part with a further free motion 1e15 and more.
COMPLIANCE_LIMIT = 1e13


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
    has no rigid modes, and the same lines are a plain solve. An iterative solver
    sees the unsupported, singular matrix instead: point supports slow it down.

    Parameters
    ----------
    structure
        The part.
    solver
        ``"direct"``, ``"iterative"`` or ``"auto"``, by size.
    options_prefix
        Prefix of the PETSc options of the linear solver.
    mass
        Products with M, if there are some already.

    Attributes
    ----------
    rigid_modes
        Mass-orthonormal U of (26), owned rows, shape (owned dofs, 6 or 0).
    mass
        Products with M.

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
    ):
        self.structure = structure
        self.mass = mass or MassOperator(structure.mass)
        self.rigid_modes = rigid_body_modes(structure)
        self._mass_rigid = self.mass.multiply(self.rigid_modes)
        first, last = structure.stiffness.getOwnershipRange()
        held = np.zeros(0, dtype=np.int32)
        if is_direct(solver, structure.size):
            held = supporting_rows(self.rigid_modes, first, structure.comm)
            held = held[(held >= first) & (held < last)]
        self._held = held - first
        self.linear = held_solver(
            structure, held, solver, options_prefix, kernel=self.rigid_modes.shape[1] > 0
        )
        self._check_compliance()

    def equilibrate(self, loads: np.ndarray) -> np.ndarray:
        """Loads less the inertia of the rigid acceleration they cause."""
        moved = inner(self.rigid_modes, loads, self.structure.comm)
        return loads - combine(self._mass_rigid, moved)

    def admissible(self, columns: np.ndarray) -> np.ndarray:
        """Columns made mass-orthogonal to the rigid-body modes."""
        moved = inner(self._mass_rigid, columns, self.structure.comm)
        return columns - combine(self.rigid_modes, moved)

    #: Part of the forces that an elastic response answers.
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
        # Two steps of inverse iteration find a motion that costs nothing.
        load = np.cos(0.7 * np.arange(first, first + rows) ** 2.0)[:, None]
        for _ in range(2):
            load = self.equilibrate(load)
            load /= norm(load, structure.comm)
            response = self.apply(load)
            compliance = norm(response, structure.comm) * mean_stiffness(structure)
            if not compliance <= COMPLIANCE_LIMIT:
                raise VerificationError(
                    "the stiffness matrix has a motion of nearly no energy beyond the "
                    f"{self.rigid_modes.shape[1]} rigid ones (compliance {compliance:.1e}, limit "
                    f"{COMPLIANCE_LIMIT:.0e}): is a node or a piece of the part loose?"
                )
            load = response


def held_solver(
    structure: Structure, held: np.ndarray, solver: str, options_prefix: str, *, kernel: bool
) -> LinearSolver:
    """Solver of K with given dofs held, those owned by this rank.

    Parameters
    ----------
    structure, solver, options_prefix
        As in `StaticSolver`.
    held
        Global dofs.
    kernel
        Whether a rigid motion is left free where the solver iterates.
    """
    matrix, direct = structure.stiffness.copy(), is_direct(solver, structure.size)
    matrix.zeroRowsColumns(held.astype(np.int32), diag=mean_stiffness(structure))
    linear = LinearSolver(
        matrix,
        direct=direct,
        near_kernel=rigid_fields(structure.coordinates),
        kernel=kernel,
        options_prefix=options_prefix,
    )
    if direct:
        matrix.destroy()
    return linear


def norm(columns: np.ndarray, comm: MPI.Comm) -> float:
    """Frobenius norm of owned rows."""
    return float(np.sqrt(comm.allreduce(np.sum(columns**2))))


def mean_stiffness(structure: Structure) -> float:
    """Mean of the diagonal of K [N/m]."""
    diagonal = structure.stiffness.getDiagonal()
    mean = diagonal.sum() / structure.size
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
    # Of unit size each, so that small columns count as much as large ones.
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
