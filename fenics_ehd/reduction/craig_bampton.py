"""M1: Craig-Bampton with the boundary points held, the bore treated as interior, (18)-(20)."""

from __future__ import annotations

from typing import Unpack

import numpy as np
from mpi4py import MPI

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.reduction.distributed import inner
from fenics_ehd.reduction.eigenmodes import LowestModes
from fenics_ehd.reduction.fixed_boundary import FixedBoundary, Flexibility
from fenics_ehd.reduction.projection import Basis, gram_matrices, on_bores, require_small
from fenics_ehd.reduction.reductor import Options, Reductor
from fenics_ehd.reduction.structure import Structure


def craig_bampton(
    part: Structure | Reductor,
    n_modes: int,
    *,
    estimate_error: bool = True,
    keep_basis: bool = False,
    **options: Unpack[Options],
) -> ReducedBody:
    """M1: reduce a part with fixed-boundary modes and one static mode per boundary dof.

    C2, the bore's centre, carries the floating frame of a free part: its mean
    translation and rotation are zero in every mode. A clamped part holds no C2.

    Parameters
    ----------
    part
        The part, free or clamped, or a `Reductor` of it.
    n_modes
        Fixed-boundary modes kept of (20).
    estimate_error, keep_basis, options
        As in `load_dependent`; the boundary dofs ``x_b`` are the `attachment_directions` of
        every boundary point.

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
    reductor = Reductor.of(part, **options)
    if n_modes < 1:
        raise SettingsError(f"modes {n_modes}: ask for at least 1 fixed-boundary mode")
    centre, constraint_modes, lowest = reductor.once("m1", None, lambda: _boundary(reductor))
    basis = boundary_basis(reductor, *lowest(n_modes), constraint_modes, centre)
    return reductor.project(
        basis, "m1", frame="bore-centre", estimate_error=estimate_error, keep_basis=keep_basis
    )


def _boundary(reductor: Reductor) -> tuple[np.ndarray | None, np.ndarray, LowestModes]:
    """Constraints of C2, static modes of the boundary dofs, modes with both held."""
    centre = centre_constraints(reductor.structure) if reductor.free else None
    support, constraint_modes = hold(reductor.static, centre, reductor.points)
    return centre, constraint_modes, LowestModes(support, f"{reductor.options_prefix}modes_")


def centre_weights(structure: Structure) -> np.ndarray:
    """Weights of the first bore's mean translation and rotation at all bores' nodes, (m, 3, 6).

    Raises
    ------
    SettingsError
        The bore has none.
    """
    reference = structure.every_bore()[0].reference
    if reference is None:
        raise SettingsError("the bore has no reference weights: M1 and M2 hold its mean motion")
    others = len(structure.bore_nodes) - len(reference)
    return np.concatenate([reference, np.zeros((others, 3, 6))])


def centre_constraints(structure: Structure) -> np.ndarray:
    """C2 as six load columns, owned rows (owned dofs, 6)."""
    return on_bores(structure, centre_weights(structure))


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
    reductor: Reductor,
    angular: np.ndarray,
    modes: np.ndarray,
    constraint_modes: np.ndarray,
    centre: np.ndarray | None,
) -> Basis:
    """T of (19) with its reduced matrices, checked against their block form.

    Raises
    ------
    VerificationError
        The blocks are not decoupled in stiffness, or the boundary is not where it should be.
    """
    structure, points = reductor.structure, reductor.points
    columns = np.asfortranarray(np.hstack([modes, constraint_modes]))
    stiffness, mass = gram_matrices(structure, reductor.mass, columns)
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
