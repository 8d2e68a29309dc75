"""M1 and M2: Craig-Bampton reductions (component mode synthesis) with fixed boundary points.

M1 treats the bore as interior, (18)-(20). M2 keeps every bore dof in a first Craig-Bampton step,
and reduces the result by a second one, (21)-(25).

Only the reduced matrices of the first step are needed. Its static modes, one part-size column for
every bore dof, are never stored together. With the interior flexibility X and the static mode
``Psi = e - X K e`` of a unit displacement e of a bore dof, the reduced stiffness ``Psi^T K Psi``
consists of the bore rows of ``K Psi``. The reduced mass ``Psi^T M Psi`` consists of the bore rows
of ``y - K X y``, where ``y = M Psi``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.reduction.eigenmodes import (
    FixedBoundary,
    Flexibility,
    LowestModes,
    lowest_modes,
)
from fenics_ehd.reduction.matrices import (
    blocks,
    combine,
    inner,
    load_columns,
    some_columns,
    symmetric,
    transpose_multiply,
)
from fenics_ehd.reduction.reductor import (
    Basis,
    Reductor,
    gram_matrices,
    require_small,
)
from fenics_ehd.reduction.static import StaticSolver, bore_rows, on_bores
from fenics_ehd.reduction.structure import Structure


def craig_bampton(
    part: Structure | Reductor,
    n_modes: int,
    *,
    estimate_error: bool = True,
    keep_basis: bool = False,
) -> ReducedBody:
    """M1: reduce a part with fixed-boundary modes and one static mode per boundary dof.

    The floating frame of a free part is attached to the bore's centre C2: the mean translation and
    rotation of the bore are zero in every mode. For a clamped part C2 is not held. The boundary
    dofs ``x_b`` are the `Reductor.attachment_directions` of every boundary point.

    Parameters
    ----------
    part
        The part, free or clamped, or its `Reductor`.
    n_modes
        Number of fixed-boundary modes of (20).
    estimate_error, keep_basis
        See `load_dependent`.

    Returns
    -------
    ReducedBody
        Body with its frame at C2. Coordinates are those of the fixed-boundary modes by frequency,
        then the boundary dofs. These two groups are coupled in mass, not in stiffness.

    Raises
    ------
    SettingsError
        If no mode is requested, or more modes than a quarter of the degrees of freedom.
    SolverError, VerificationError
        If a solver or a check of the result fails.
    """
    reductor = Reductor.of(part)
    if n_modes < 1:
        raise SettingsError(f"modes {n_modes}: at least 1 fixed-boundary mode is needed")
    centre, constraint_modes, lowest = reductor.once("m1", None, lambda: _boundary(reductor))
    basis = boundary_basis(reductor, *lowest(n_modes), constraint_modes, centre)
    return reductor.project(
        basis, "m1", frame="bore-centre", estimate_error=estimate_error, keep_basis=keep_basis
    )


def _boundary(reductor: Reductor) -> tuple[np.ndarray | None, np.ndarray, LowestModes]:
    """Constraints of C2 (None if clamped), static modes of boundary dofs, fixed-boundary modes.

    The fixed-boundary modes are computed on request, see `LowestModes`.
    """
    centre = centre_constraints(reductor.structure) if reductor.free else None
    support, constraint_modes = hold(reductor.static, centre, reductor.points)
    return centre, constraint_modes, LowestModes(support, f"{reductor.options_prefix}modes_")


def centre_weights(structure: Structure) -> np.ndarray:
    """Weights that give the mean motion of the first bore from displacements of all bore nodes.

    The shape is (m, 3, 6), see `Bore.reference`; weights of other bores are zero.

    Raises
    ------
    SettingsError
        If the first bore has no reference weights.
    """
    reference = structure.every_bore()[0].reference
    if reference is None:
        raise SettingsError(
            "the first bore has no reference weights, which M1 and M2 need to hold its mean motion"
        )
    others = len(structure.bore_nodes) - len(reference)
    return np.concatenate([reference, np.zeros((others, 3, 6))])


def centre_constraints(structure: Structure) -> np.ndarray:
    """Columns C of the constraints that hold the motion of C2, rows of this rank, (owned dofs, 6).

    As loads, the columns are unit forces and moments at C2.
    """
    return on_bores(structure, centre_weights(structure))


def hold(
    support: Flexibility, centre: np.ndarray | None, points: np.ndarray
) -> tuple[Flexibility, np.ndarray]:
    """Hold C2 and the boundary dofs of a part.

    Parameters
    ----------
    support
        Static response of the part before these dofs are held.
    centre, points
        Constraint columns of C2 (None: C2 is not held) and of n_b boundary dofs, rows of this rank.

    Returns
    -------
    support : Flexibility
        Static response with C2 and the boundary held; the argument itself if there is nothing to
        hold.
    constraint_modes : numpy.ndarray
        Static modes for unit boundary dofs with C2 held, shape (owned dofs, n_b).
    """
    constraints = points if centre is None else np.hstack([centre, points])
    count = constraints.shape[1]
    boundary = points.shape[1]
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
    """Make the basis T of (19) from fixed-boundary and constraint modes, and check it.

    Parameters
    ----------
    reductor
        Reductor of the part.
    angular, modes
        Angular frequencies [rad/s] and fixed-boundary modes.
    constraint_modes
        Static modes of unit boundary dofs.
    centre
        Constraint columns that hold the bore's centre C2; None if the centre is not held.

    Raises
    ------
    VerificationError
        If the two groups of modes are coupled in stiffness, or if the boundary moves in a
        fixed-boundary mode.
    """
    structure = reductor.structure
    points = reductor.points
    columns = np.asfortranarray(np.hstack([modes, constraint_modes]))
    stiffness, mass = gram_matrices(reductor, columns)
    n = modes.shape[1]
    comm = structure.comm
    scale = np.sqrt(np.diag(stiffness))
    wanted = np.zeros_like(stiffness)
    wanted[:n, :n] = np.diag(angular**2)
    wanted[n:, n:] = stiffness[n:, n:]
    boundary = np.hstack([np.zeros((points.shape[1], n)), np.eye(points.shape[1])])
    # Motions are relative to each column's largest displacement; rotations times the part's size.
    sizes = np.max(comm.allgather(np.abs(columns).max(axis=0, initial=0.0)), axis=0)
    defects = {
        "mass_defect": np.abs(mass[:n, :n] - np.eye(n)).max(initial=0.0),
        "stiffness_defect": np.abs((stiffness - wanted) / np.outer(scale, scale)).max(),
        "boundary_defect": np.abs((inner(points, columns, comm) - boundary) / sizes).max(
            initial=0.0
        ),
    }
    if centre is not None:
        moved = (
            np.repeat([1.0, structure.largest_coordinate], 3)[:, None]
            * inner(centre, columns, comm)
            / sizes
        )
        defects["centre_motion"] = np.abs(moved).max(initial=0.0)
    mass[:n, :n] = np.eye(n)
    kinds = ("fixed-boundary",) * n + ("constraint",) * constraint_modes.shape[1]
    return Basis(columns, wanted, mass, kinds, (), require_small(defects))


# M2

#: Largest share of a boundary point's squared weights off the bores that counts as zero.
ON_BORE = 1e-12


def two_step_craig_bampton(
    part: Structure | Reductor,
    n_modes: int,
    n_interior_modes: int = 20,
    *,
    estimate_error: bool = True,
    keep_basis: bool = False,
) -> ReducedBody:
    """M2: reduce a part to all its bore dofs, then reduce the result to fixed-boundary modes.

    The second step is a complete Craig-Bampton reduction of the result of the first step, so that
    the bore deforms in the static modes of the boundary dofs. (With the zeros in (22) and (23) of
    the paper, the bore would be rigid under a force at the boundary point A.) PETSc options of the
    solver for the interior have the prefix ``interior_``.

    Parameters
    ----------
    part
        The part, free or clamped, or its `Reductor`.
    n_modes
        Number of fixed-boundary modes of (24).
    n_interior_modes
        Number of modes of the first step, with bores and boundary held.
    estimate_error, keep_basis
        See `craig_bampton`.

    Returns
    -------
    ReducedBody
        Body as from `craig_bampton`.

    Raises
    ------
    SettingsError
        If no mode is requested, or more modes than the first step has coordinates.
    SolverError, VerificationError
        If a solver or a check of the result fails.
    """
    reductor = Reductor.of(part)
    structure = reductor.structure
    free = reductor.free
    held = _held_weights(reductor)
    available = 3 * len(structure.bore_nodes) - held.shape[1] + n_interior_modes
    if not 1 <= n_modes <= available:
        raise SettingsError(
            f"modes {n_modes} is not between 1 and {available}, the number of free coordinates "
            "after the first step"
        )
    first = reductor.once("m2", n_interior_modes, lambda: _first_step(reductor, n_interior_modes))
    angular, modes, constraints = _second_step(first, held, n_modes)
    columns = _expand(first, np.hstack([modes, constraints]))
    centre = centre_constraints(structure) if free else None
    basis = boundary_basis(reductor, angular, columns[:, :n_modes], columns[:, n_modes:], centre)
    return reductor.project(
        basis, "m2", frame="bore-centre", estimate_error=estimate_error, keep_basis=keep_basis
    )


@dataclass(frozen=True, eq=False)
class FirstStep:
    """Reduced system (22), with coordinates in the order of (21).

    The coordinates are v interior modes, b boundary dofs off the bores, and the 3 m bore dofs. A
    boundary point that is the mean of a bore has no coordinates of its own: its motion follows from
    the bore dofs.

    Attributes
    ----------
    support
        Static response of the interior, with bores and boundary points held.
    bore
        Stiffness columns of all bore dofs.
    on_bore
        Whether each boundary dof is a mean over bore nodes, shape (all boundary dofs,).
    modes
        Number v of interior modes.
    columns
        Interior modes, then static modes of the b boundary dofs with the bores held; rows of this
        rank, shape (owned dofs, v + b).
    stiffness, mass
        Reduced matrices, shape (v + b + 3 m, v + b + 3 m).
    """

    support: Flexibility
    bore: BoreColumns
    on_bore: np.ndarray
    modes: int
    columns: np.ndarray
    stiffness: np.ndarray
    mass: np.ndarray


def _first_step(reductor: Reductor, n_interior_modes: int) -> FirstStep:
    """Reduce a part to interior modes, boundary dofs and all bore dofs, (21) and (22)."""
    structure = reductor.structure
    on_bore = _on_bore(reductor)
    nodes = structure.bore_nodes
    prefix = reductor.options_prefix
    interior = reductor.once(
        "interior",
        None,
        lambda: StaticSolver(
            structure,
            solver=reductor.solver,
            options_prefix=f"{prefix}interior_",
            mass=reductor.mass,
            clamped=nodes,
            work=reductor.work,
        ),
    )
    support, boundary_modes = hold(interior, None, reductor.points[:, ~on_bore])
    modes = lowest_modes(support, n_interior_modes, options_prefix=f"{prefix}modes_")[1]
    comm = structure.comm
    bore = BoreColumns(structure)
    others = np.hstack([modes, boundary_modes])
    # Only entries on one side of the diagonal are computed; the others are copied at the end.
    o = others.shape[1]
    p = 3 * len(nodes)
    stiffness = np.zeros((o + p,) * 2)
    mass = np.zeros((o + p,) * 2)
    stiffness[:o, :o], mass[:o, :o] = gram_matrices(interior, others)
    stiffness[o:, n_interior_modes:o] = bore.forces(boundary_modes)
    for part in blocks(p, len(modes), comm):
        bore_modes = bore.static_modes(support, np.eye(p, part.stop - part.start, -part.start))
        inertia = reductor.mass.multiply(bore_modes)
        into = slice(o + part.start, o + part.stop)
        stiffness[o:, into] = bore.forces(bore_modes)
        mass[o:, into] = bore.rows(inertia) - bore.forces(support.apply(inertia))
        mass[into, :o] = inner(inertia, others, comm)
    for matrix in (stiffness, mass):
        matrix[o:, o:] = symmetric(matrix[o:, o:])
        matrix[:o, o:] = matrix[o:, :o].T
    return FirstStep(support, bore, on_bore, n_interior_modes, others, stiffness, mass)


def _on_bore(reductor: Reductor) -> np.ndarray:
    """Whether each boundary dof is a mean over bore nodes only, shape (all boundary dofs,)."""
    points = reductor.points
    comm = reductor.structure.comm
    on_bores_squared = np.sum(bore_rows(reductor.structure, points) ** 2, axis=(0, 1))
    return on_bores_squared >= (1 - ON_BORE) * comm.allreduce(np.sum(points**2, axis=0))


def _held_weights(reductor: Reductor) -> np.ndarray:
    """Weights of the bore dofs in the motions that the second step holds.

    These motions are the mean motion of the first bore (of C2), if the part is free, and every
    boundary dof that is a mean over bore nodes.

    Returns
    -------
    numpy.ndarray
        Weights, shape (3 m, w), one column for each motion.
    """
    structure = reductor.structure
    points = reductor.points[:, _on_bore(reductor)]
    means = bore_rows(structure, points).reshape(3 * len(structure.bore_nodes), -1)
    if not reductor.free:
        return means
    return np.hstack([centre_weights(structure).reshape(len(means), 6), means])


def _second_step(
    first: FirstStep, held: np.ndarray, n_modes: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fixed-boundary modes (24) and static modes of the boundary dofs, in the coordinates of (22).

    Returns
    -------
    angular, modes, constraint_modes
        Angular frequencies, shape (n,) [rad/s], fixed-boundary modes, shape (v + b + 3 m, n), and
        static modes, shape (v + b + 3 m, all boundary dofs).
    """
    v = first.modes
    o = first.columns.shape[1]
    size = len(first.stiffness)
    b = o - v
    # Bore displacements that are orthogonal to the weights leave the held motions at zero.
    free = np.linalg.qr(held, mode="complete")[0][:, held.shape[1] :]
    admissible = np.zeros((size, v + free.shape[1]))
    admissible[:v, :v] = np.eye(v)
    admissible[o:, v:] = free
    # A unit boundary dof on a bore is imposed by the bore displacement of the smallest norm.
    count = int(first.on_bore.sum())
    unit = np.zeros((size, b + count))
    unit[o:, first.on_bore] = np.linalg.pinv(held.T)[:, held.shape[1] - count :]
    unit[v:o, ~first.on_bore] = np.eye(b)
    stiffness, mass = (
        admissible.T @ matrix @ admissible for matrix in (first.stiffness, first.mass)
    )
    # Coordinates of interior modes and bore dofs have different units: all get unit stiffness.
    scale = 1.0 / np.sqrt(np.diag(stiffness))
    stiffness, mass = (matrix * np.outer(scale, scale) for matrix in (stiffness, mass))
    last = len(scale) - 1
    values, vectors = linalg.eigh(mass, stiffness, subset_by_index=[last + 1 - n_modes, last])
    values = values[::-1]
    vectors = vectors[:, ::-1]
    modes = scale[:, None] * vectors / np.sqrt(values)
    coupling = admissible.T @ first.stiffness @ unit
    static = -linalg.solve(stiffness, scale[:, None] * coupling, assume_a="pos")
    unit += admissible @ (scale[:, None] * static)
    return 1.0 / np.sqrt(values), admissible @ modes, unit


def _expand(first: FirstStep, coordinates: np.ndarray) -> np.ndarray:
    """Displacements of the part for columns of coordinates of (21), shape (owned dofs, n)."""
    others, bores = np.split(coordinates, [first.columns.shape[1]])
    columns = combine(first.columns, others)
    for part in blocks(coordinates.shape[1], len(columns), first.support.structure.comm):
        columns[:, part] += first.bore.static_modes(first.support, bores[:, part])
    return columns


class BoreColumns:
    """Columns of K that belong to the bore dofs of a part, and their products with fields.

    Attributes
    ----------
    structure
        Matrices and geometry of the part.
    stiffness
        Columns of K of the 3 m bore dofs, in the order of the bore nodes; rows are distributed
        over the ranks.
    """

    def __init__(self, structure: Structure):
        dofs = (3 * structure.bore_nodes[:, None] + np.arange(3)).ravel()
        self.structure = structure
        self.stiffness = some_columns(structure.stiffness, dofs)

    def static_modes(self, support: Flexibility, values: np.ndarray) -> np.ndarray:
        """Static modes for bore displacements `values`, shape (3 m, w); result (owned dofs, w)."""
        columns = on_bores(self.structure, values.reshape(-1, 3, values.shape[1]))
        columns -= support.apply(load_columns(self.stiffness, values))
        return columns

    def forces(self, columns: np.ndarray) -> np.ndarray:
        """Forces ``K @ columns`` at the bore dofs, shape (3 m, w), the same on every rank."""
        return transpose_multiply(self.stiffness, columns)

    def rows(self, columns: np.ndarray) -> np.ndarray:
        """Values of part-size columns at the bore dofs, shape (3 m, w), the same on every rank."""
        rows = bore_rows(self.structure, columns)
        return rows.reshape(3 * len(rows), -1)
