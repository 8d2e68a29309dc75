"""M1 and M2: Craig-Bampton reductions (component mode synthesis) with fixed boundary points.

M1 treats the bore as interior, (18)-(20). M2 keeps every bore dof in a first Craig-Bampton step,
and reduces the result by a second one, (21)-(25).

Only the reduced matrices of the first step are needed. Its static modes of the bore, as tall as the
part and as many as the bore has dofs, are never stored together: with X the interior flexibility
and ``Psi = e - X K e`` the static mode of a bore dof, ``Psi^T K Psi`` and ``Psi^T M Psi`` are bore
rows of ``K Psi`` and of ``y - K X y``, ``y = M Psi``.
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
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.reduction.structure import Structure, bore_rows, on_bores


def craig_bampton(
    part: Structure | Reductor,
    n_modes: int,
    *,
    estimate_error: bool = True,
    keep_basis: bool = False,
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
    estimate_error, keep_basis
        See `load_dependent`; the boundary dofs ``x_b`` are the `attachment_directions` of
        every boundary point.

    Returns
    -------
    ReducedBody
        Frame at C2; fixed-boundary coordinates by frequency, then the boundary
        dofs. The stiffness is block diagonal, the mass couples the two.

    Raises
    ------
    SettingsError
        No mode is requested, or more than a quarter of the degrees of freedom.
    SolverError, VerificationError
        A solver or a check of the result fails.
    """
    reductor = Reductor.of(part)
    if n_modes < 1:
        raise SettingsError(f"modes {n_modes}: ask for at least 1 fixed-boundary mode")
    centre, constraint_modes, lowest = reductor.once("m1", None, lambda: _boundary(reductor))
    basis = boundary_basis(reductor, *lowest(n_modes), constraint_modes, centre)
    return reductor.project(
        basis, "m1", frame="bore-centre", estimate_error=estimate_error, keep_basis=keep_basis
    )


def _boundary(reductor: Reductor) -> tuple[np.ndarray | None, np.ndarray, LowestModes]:
    """Constraints of C2, static modes of the boundary dofs, and modes with both held."""
    centre = centre_constraints(reductor.structure) if reductor.free else None
    support, constraint_modes = hold(reductor.static, centre, reductor.points)
    return centre, constraint_modes, LowestModes(support, f"{reductor.options_prefix}modes_")


def centre_weights(structure: Structure) -> np.ndarray:
    """Weights of the first bore's mean translation and rotation at all bores' nodes, (m, 3, 6).

    Raises
    ------
    SettingsError
        The part has no bore with reference weights.
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
    """Fix C2 and the boundary dofs.

    Returns
    -------
    support : Flexibility
        Flexibility with ``C^T x = 0``; the argument itself if nothing is to be fixed.
    constraint_modes : numpy.ndarray
        Static modes of unit boundary dofs with C2 held, shape (owned dofs, n_b).
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
    """T of (19) with its reduced matrices, checked against their block form.

    Raises
    ------
    VerificationError
        The blocks are coupled in stiffness, or the boundary moves in a fixed-boundary mode.
    """
    structure = reductor.structure
    points = reductor.points
    columns = np.asfortranarray(np.hstack([modes, constraint_modes]))
    stiffness, mass = gram_matrices(structure, reductor.mass, columns)
    n = modes.shape[1]
    comm = structure.comm
    scale = np.sqrt(np.diag(stiffness))
    wanted = np.zeros_like(stiffness)
    wanted[:n, :n] = np.diag(angular**2)
    wanted[n:, n:] = stiffness[n:, n:]
    boundary = np.hstack([np.zeros((points.shape[1], n)), np.eye(points.shape[1])])
    # Relative to the largest displacement of each column, rotations with the size of the part.
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

#: Largest share of a boundary point's weights off the bores that is treated as zero.
ON_BORE = 1e-12


def two_step_craig_bampton(
    part: Structure | Reductor,
    n_modes: int,
    n_interior_modes: int = 20,
    *,
    estimate_error: bool = True,
    keep_basis: bool = False,
) -> ReducedBody:
    """M2: reduce a part to all bore dofs first, then to fixed-boundary modes of that.

    The second step is a complete Craig-Bampton reduction of the first: its static
    modes of the boundary dofs let the bore deform. (The zeros that (22) and (23)
    print there would hold the bore rigid under a force at A.)

    Parameters
    ----------
    part
        The part, free or clamped, or a `Reductor` of it.
    n_modes
        Fixed-boundary modes kept of (24).
    n_interior_modes
        Fixed-interface modes of the first step, bore and boundary held.
    estimate_error, keep_basis
        See `craig_bampton`; options of the interior have the prefix ``interior_``.

    Returns
    -------
    ReducedBody
        See `craig_bampton`.

    Raises
    ------
    SettingsError
        No mode is requested, or more than the first step has.
    SolverError, VerificationError
        A solver or a check of the result fails.
    """
    reductor = Reductor.of(part)
    structure = reductor.structure
    free = reductor.free
    held = _held_weights(reductor)
    available = 3 * len(structure.bore_nodes) - held.shape[1] + n_interior_modes
    if not 1 <= n_modes <= available:
        raise SettingsError(
            f"modes {n_modes} is not between 1 and {available}, what the first step leaves"
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
    """Reduced system (22), coordinates in the order of (21): interior modes, boundary, bores.

    A boundary point that is the mean of a bore is given by the bore's own dofs.

    Attributes
    ----------
    support
        Flexibility of the interior, with the boundary points held.
    bore
        The dofs of all bores.
    on_bore
        True for boundary dofs that are means of bores, shape (all boundary dofs,).
    modes
        Number v of interior modes.
    columns
        Fixed-interface modes, then static modes of the other boundary dofs with the bores held,
        owned rows (owned dofs, v + b).
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
    """Reduce to interior modes, the boundary dofs and every bore dof (21), (22)."""
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
        ),
    )
    support, boundary_modes = hold(interior, None, reductor.points[:, ~on_bore])
    modes = lowest_modes(support, n_interior_modes, options_prefix=f"{prefix}modes_")[1]
    comm = structure.comm
    bore = BoreColumns(structure)
    others = np.hstack([modes, boundary_modes])
    # Entries that follow from symmetry are filled in at the end.
    o = others.shape[1]
    p = 3 * len(nodes)
    stiffness = np.zeros((o + p,) * 2)
    mass = np.zeros((o + p,) * 2)
    stiffness[:o, :o], mass[:o, :o] = gram_matrices(structure, reductor.mass, others)
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
    """Mask of the boundary dofs that are means over nodes of the bores alone, shape (b,)."""
    points = reductor.points
    comm = reductor.structure.comm
    on_bores_squared = np.sum(bore_rows(reductor.structure, points) ** 2, axis=(0, 1))
    return on_bores_squared >= (1 - ON_BORE) * comm.allreduce(np.sum(points**2, axis=0))


def _held_weights(reductor: Reductor) -> np.ndarray:
    """Weights at the bores of the motions fixed in the second step: C2 of a free part, then means.

    Returns
    -------
    numpy.ndarray
        Weights, shape (3 m, w).
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
    """Fixed-boundary modes (24) and static modes of the boundary dofs, in coordinates of (22).

    Returns
    -------
    angular, modes, constraint_modes
        Frequencies, shape (n,), fixed-boundary modes, shape (v + b + 3 m, n), and static modes,
        shape (v + b + 3 m, all boundary dofs).
    """
    v = first.modes
    o = first.columns.shape[1]
    size = len(first.stiffness)
    b = o - v
    # Bore displacements orthogonal to the weights have no fixed motion.
    free = np.linalg.qr(held, mode="complete")[0][:, held.shape[1] :]
    admissible = np.zeros((size, v + free.shape[1]))
    admissible[:v, :v] = np.eye(v)
    admissible[o:, v:] = free
    # Unit boundary dofs on a bore are imposed by the smallest displacement of the bore.
    count = int(first.on_bore.sum())
    unit = np.zeros((size, b + count))
    unit[o:, first.on_bore] = np.linalg.pinv(held.T)[:, held.shape[1] - count :]
    unit[v:o, ~first.on_bore] = np.eye(b)
    stiffness, mass = (
        admissible.T @ matrix @ admissible for matrix in (first.stiffness, first.mass)
    )
    # Interior modes are in sqrt(kg) m and bore dofs in m: both are scaled to unit stiffness.
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
    """``T_1`` of (21) times columns of coordinates, owned rows (owned dofs, n)."""
    others, bores = np.split(coordinates, [first.columns.shape[1]])
    columns = combine(first.columns, others)
    for part in blocks(coordinates.shape[1], len(columns), first.support.structure.comm):
        columns[:, part] += first.bore.static_modes(first.support, bores[:, part])
    return columns


class BoreColumns:
    """The bore dofs of a part: their columns of K, and products between them and part-size fields.

    Attributes
    ----------
    structure
        The part.
    stiffness
        ``K_p``, all rows and the columns of the bore dofs in the bore's order, which the ranks
        share.
    """

    def __init__(self, structure: Structure):
        dofs = (3 * structure.bore_nodes[:, None] + np.arange(3)).ravel()
        self.structure = structure
        self.stiffness = some_columns(structure.stiffness, dofs)

    def static_modes(self, support: Flexibility, values: np.ndarray) -> np.ndarray:
        """Static modes of bore displacements, shape (3 m, w), owned rows (owned dofs, w)."""
        columns = on_bores(self.structure, values.reshape(-1, 3, values.shape[1]))
        columns -= support.apply(load_columns(self.stiffness, values))
        return columns

    def forces(self, columns: np.ndarray) -> np.ndarray:
        """Bore rows of ``K @ columns`` on every rank, shape (3 m, w)."""
        return transpose_multiply(self.stiffness, columns)

    def rows(self, columns: np.ndarray) -> np.ndarray:
        """Bore rows of part-size columns on every rank, shape (3 m, w)."""
        rows = bore_rows(self.structure, columns)
        return rows.reshape(3 * len(rows), -1)
