"""M1: Craig-Bampton with the boundary points held, the bore treated as interior, (18)-(20)."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from fenics_ehd.errors import SettingsError
from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.reduction.checks import check_structure
from fenics_ehd.reduction.distributed import inner, spread_rows
from fenics_ehd.reduction.eigenmodes import lowest_modes
from fenics_ehd.reduction.fixed_boundary import FixedBoundary, Flexibility
from fenics_ehd.reduction.load_dependent import bore_flexibility
from fenics_ehd.reduction.loads import attachment_loads
from fenics_ehd.reduction.projection import Basis, gram_matrices, project, require_small
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.reduction.structure import Bore, Structure


def craig_bampton(
    structure: Structure,
    n_modes: int,
    *,
    attachment_directions: tuple[int, ...] = (0, 1),
    estimate_error: bool = True,
    keep_basis: bool = False,
    solver: str = "auto",
    options_prefix: str = "",
) -> ReducedBody:
    """M1: reduce a part with fixed-boundary modes and one static mode per boundary dof.

    C2, the bore's centre, carries the floating frame of a free part: its mean
    translation and rotation are zero in every mode. A clamped part holds no C2.

    Parameters
    ----------
    structure
        The part, free or clamped.
    n_modes
        Fixed-boundary modes kept of (20).
    attachment_directions
        Components of the boundary points that are boundary dofs ``x_b``.
    estimate_error, keep_basis, solver, options_prefix
        As in `load_dependent`.

    Returns
    -------
    ReducedBody
        Frame at C2; fixed-boundary coordinates by frequency, then the boundary
        dofs. The stiffness is block diagonal, the mass couples the two.

    Raises
    ------
    SettingsError
        No mode asked for, or more than a quarter of the degrees of freedom.
    SolverError, VerificationError
        From the solvers and the checks of the result.
    """
    check_structure(structure)
    if n_modes < 1:
        raise SettingsError(f"modes {n_modes}: ask for at least 1 fixed-boundary mode")
    static = StaticSolver(structure, solver=solver, options_prefix=f"{options_prefix}static_")
    held = centre_constraints(structure) if static.rigid_modes.shape[1] else None
    points = attachment_loads(structure, attachment_directions)
    support, constraint_modes = hold(static, held, points)
    angular, modes = lowest_modes(support, n_modes, options_prefix=f"{options_prefix}modes_")
    basis = boundary_basis(static, angular, modes, constraint_modes, held, points)
    return project(
        structure,
        static.mass,
        basis,
        method="m1",
        frame="clamped" if held is None else "bore-centre",
        full_flexibility=bore_flexibility(static) if estimate_error else None,
        keep_basis=keep_basis,
    )


def centre_weights(bore: Bore) -> np.ndarray:
    """Weights of the mean translation and rotation of the bore, shape (m, 3, 6).

    Raises
    ------
    SettingsError
        The bore has none.
    """
    if bore.reference is None:
        raise SettingsError("the bore has no reference weights: M1 and M2 hold its mean motion")
    return bore.reference


def centre_constraints(structure: Structure) -> np.ndarray:
    """C2 as six load columns, owned rows (owned dofs, 6)."""
    bore = structure.lubricated_bore
    first, last = (row // 3 for row in structure.stiffness.getOwnershipRange())
    return spread_rows(centre_weights(bore), first, last - first, bore.nodes)


def hold(
    support: Flexibility, centre: np.ndarray | None, points: np.ndarray
) -> tuple[Flexibility, np.ndarray]:
    """Hold C2 and the boundary dofs.

    Returns
    -------
    support : Flexibility
        With ``C^T x = 0``; the given one if there is nothing to hold.
    constraint_modes : numpy.ndarray
        Static modes of unit boundary dofs with C2 held, shape (owned dofs, n_b).
    """
    constraints = points if centre is None else np.hstack([centre, points])
    count, boundary = constraints.shape[1], points.shape[1]
    if not count:
        return support, points
    fixed = FixedBoundary(support, constraints)
    return fixed, fixed.constraint_modes(np.eye(count)[:, count - boundary :])


def boundary_basis(
    static: Flexibility,
    angular: np.ndarray,
    modes: np.ndarray,
    constraint_modes: np.ndarray,
    centre: np.ndarray | None,
    points: np.ndarray,
) -> Basis:
    """T of (19) with its reduced matrices, checked against their block form.

    Raises
    ------
    VerificationError
        The blocks are not decoupled in stiffness, or the boundary is not where it should be.
    """
    structure = static.structure
    columns = np.asfortranarray(np.hstack([modes, constraint_modes]))
    stiffness, mass = gram_matrices(structure, static.mass, columns)
    n, comm = modes.shape[1], structure.comm
    scale = np.sqrt(np.diag(stiffness))
    wanted = np.zeros_like(stiffness)
    wanted[:n, :n] = np.diag(angular**2)
    wanted[n:, n:] = stiffness[n:, n:]
    boundary = np.hstack([np.zeros((points.shape[1], n)), np.eye(points.shape[1])])
    # Relative to the largest displacement of each column, rotations with the size of the part.
    sizes = np.max(comm.allgather(np.abs(columns).max(axis=0, initial=0.0)), axis=0)
    length = comm.allreduce(np.abs(structure.coordinates).max(initial=0.0), op=MPI.MAX)
    defects = {
        "mass_defect": np.abs(mass[:n, :n] - np.eye(n)).max(initial=0.0),
        "stiffness_defect": np.abs((stiffness - wanted) / np.outer(scale, scale)).max(),
        "boundary_defect": np.abs((inner(points, columns, comm) - boundary) / sizes).max(
            initial=0.0
        ),
    }
    if centre is not None:
        moved = np.array([1.0] * 3 + [length] * 3)[:, None] * inner(centre, columns, comm) / sizes
        defects["centre_motion"] = np.abs(moved).max(initial=0.0)
    mass[:n, :n] = np.eye(n)
    kinds = ("fixed-boundary",) * n + ("constraint",) * constraint_modes.shape[1]
    return Basis(columns, wanted, mass, kinds, (), require_small(defects))
