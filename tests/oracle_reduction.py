"""The reduction methods a second time, on a small part: dense matrices, numpy and scipy alone.

M1 to M4 and the full interface as printed in section 3 of Krinner and Rixen and in DESIGN.md,
section 4: constraints in null-space or saddle-point form, whole spectra by `scipy.linalg.eigh`.
Of the package only the matrices of a part are taken.

Displacements are numbered ``3 * node + component``; N of them on n nodes, m nodes on the
bore, k pressure nodes. SI units.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import linalg

AXES = np.eye(3)


@dataclass(frozen=True, eq=False)
class Part:
    """Dense part.

    Attributes
    ----------
    stiffness, mass
        K and M of (16), shape (N, N).
    nodes
        shape (n, 3).
    load
        J of (15), shape (N, k).
    bore
        Node numbers, shape (m,).
    mean
        Mean translation and rotation of the bore, C2, as columns, shape (N, 6).
    points
        By name, the mean displacement of each boundary point as columns, shape (N, 3).
    pressure_nodes
        shape (k, 3).
    free
        Whether the part has rigid motions; else it is clamped.
    """

    stiffness: np.ndarray
    mass: np.ndarray
    nodes: np.ndarray
    load: np.ndarray
    bore: np.ndarray
    mean: np.ndarray
    points: dict[str, np.ndarray]
    pressure_nodes: np.ndarray
    free: bool = True

    @property
    def size(self) -> int:
        return len(self.stiffness)

    @cached_property
    def motions(self) -> np.ndarray:
        """Unit translations and rotations about the origin, (N, 6), whether free or not."""
        fields = [np.broadcast_to(axis, self.nodes.shape) for axis in AXES]
        fields += [np.cross(axis, self.nodes) for axis in AXES]
        return np.column_stack([field.ravel() for field in fields])

    @cached_property
    def rigid(self) -> np.ndarray:
        """Mass-orthonormal U of (26), (N, 6) or (N, 0)."""
        if not self.free:
            return self.motions[:, :0]
        gram = self.motions.T @ self.mass @ self.motions
        return self.motions @ linalg.inv(linalg.cholesky(gram))

    @cached_property
    def centre(self) -> np.ndarray:
        """What holds the floating frame at C2: nothing of a clamped part."""
        return self.mean if self.free else self.mean[:, :0]

    @cached_property
    def bore_dofs(self) -> np.ndarray:
        return (3 * self.bore[:, None] + np.arange(3)).ravel()

    def boundary(self, directions=(0, 1)) -> np.ndarray:
        """Unit forces at the boundary points along some axes, J_a, (N, n_a)."""
        columns = [self.points[name][:, [d]] for name in self.points for d in directions]
        return np.hstack([np.zeros((self.size, 0)), *columns])

    def outward(self, rows: np.ndarray) -> np.ndarray:
        """Radial part (m, c) of displacements of the bore (3 m, c)."""
        x, y = self.nodes[self.bore, :2].T / np.hypot(*self.nodes[self.bore, :2].T)
        return x[:, None] * rows[0::3] + y[:, None] * rows[1::3]

    @cached_property
    def pressure_answers(self) -> np.ndarray:
        """``G_c`` of (29) for unit nodal pressures, (N, k) [m/Pa]."""
        return static_responses(self, self.load)

    @property
    def full_flexibility(self) -> np.ndarray:
        """Its bore rows, (3 m, k)."""
        return self.pressure_answers[self.bore_dofs]

    @cached_property
    def spectrum(self) -> tuple[np.ndarray, np.ndarray]:
        """Every elastic mode of (27): angular frequencies (e,) and Phi (N, e)."""
        values, modes = linalg.eigh(self.stiffness, self.mass)
        count = self.rigid.shape[1]
        return np.sqrt(values[count:]), modes[:, count:]


def in_other_units(part: Part, length=1.0, mass=1.0, stiffness=1.0) -> Part:
    """The part with other numbers for lengths, K and M: 1000, 1e-3, 1e-3 for mm and t."""
    turned = np.array([1.0, 1.0, 1.0, 1 / length, 1 / length, 1 / length])
    return replace(
        part,
        stiffness=stiffness * part.stiffness,
        mass=mass * part.mass,
        nodes=length * part.nodes,
        load=length**2 * part.load,
        mean=part.mean * turned,
        pressure_nodes=length * part.pressure_nodes,
    )


def renumbered(part: Part, order: np.ndarray) -> Part:
    """The part with node ``order[i]`` as node i; those not in `order` are held and left out."""
    dofs = (3 * order[:, None] + np.arange(3)).ravel()
    new = np.full(len(part.nodes), -1)
    new[order] = np.arange(len(order))
    return replace(
        part,
        stiffness=part.stiffness[np.ix_(dofs, dofs)],
        mass=part.mass[np.ix_(dofs, dofs)],
        nodes=part.nodes[order],
        load=part.load[dofs],
        bore=new[part.bore],
        mean=part.mean[dofs],
        points={name: columns[dofs] for name, columns in part.points.items()},
        free=part.free and len(order) == len(part.nodes),
    )


def mean_of(nodes: np.ndarray, count: int) -> np.ndarray:
    """Mean displacement of some of `count` nodes as columns (3 count, 3)."""
    columns = np.zeros((count, 3, 3))
    columns[nodes] = AXES / len(nodes)
    return columns.reshape(-1, 3)


def saddle_point(stiffness, border, loads, given):
    """x of ``[K C; C^T 0] [x; y] = [f; g]``, C scaled like K, which only scales y."""
    count = border.shape[1]
    if not count:
        return linalg.solve(stiffness, loads, assume_a="sym")
    scale = np.abs(np.diag(stiffness)).mean() / linalg.norm(border, axis=0)
    matrix = np.block([[stiffness, border * scale], [(border * scale).T, np.zeros((count, count))]])
    right = np.vstack([loads, scale[:, None] * given])
    return linalg.solve(matrix, right, assume_a="sym")[: len(stiffness)]


def static_responses(part: Part, loads: np.ndarray) -> np.ndarray:
    """G of (29), shape (N, c)."""
    rigid = part.rigid
    zeros = np.zeros((rigid.shape[1], loads.shape[1]))
    return saddle_point(part.stiffness, part.mass @ rigid, loads, zeros)


def held_modes(stiffness, mass, constraints, count):
    """Lowest modes with ``C^T x = 0`` in null-space form: angular frequencies, (N, count)."""
    allowed = np.eye(len(stiffness))
    if constraints.shape[1]:
        allowed = linalg.null_space((constraints / linalg.norm(constraints, axis=0)).T)
    values, modes = linalg.eigh(allowed.T @ stiffness @ allowed, allowed.T @ mass @ allowed)
    return np.sqrt(values[:count]), allowed @ modes[:, :count]


def craig_bampton(part: Part, n_modes: int, directions=(0, 1)) -> np.ndarray:
    """M1: T of (19) with the modes (20), C2 and the boundary points held."""
    boundary = part.boundary(directions)
    return _craig_bampton(part.stiffness, part.mass, part.centre, boundary, n_modes)


def _craig_bampton(stiffness, mass, centre, boundary, n_modes) -> np.ndarray:
    constraints = np.hstack([centre, boundary])
    fixed, moved = centre.shape[1], boundary.shape[1]
    modes = held_modes(stiffness, mass, constraints, n_modes)[1]
    static = np.zeros((len(stiffness), moved))
    if moved:
        static = saddle_point(stiffness, constraints, static, np.eye(fixed + moved)[:, fixed:])
    return np.hstack([modes, static])


@dataclass(frozen=True, eq=False)
class FirstStep:
    """``T_1`` of (21), K and M of (22), and how many interior modes, bore and boundary dofs."""

    basis: np.ndarray
    stiffness: np.ndarray
    mass: np.ndarray
    sizes: tuple[int, int, int]


def first_step(part: Part, n_interior: int, directions=(0, 1)) -> FirstStep:
    """(21), (22): interior modes and one static mode for every dof of bore and boundary."""
    boundary = part.boundary(directions)
    held = np.hstack([np.eye(part.size)[:, part.bore_dofs], boundary])
    modes = held_modes(part.stiffness, part.mass, held, n_interior)[1]
    modes /= linalg.norm(modes, axis=0)
    static = saddle_point(
        part.stiffness, held, np.zeros((part.size, held.shape[1])), np.eye(held.shape[1])
    )
    basis = np.hstack([modes, static])
    return FirstStep(
        basis,
        basis.T @ part.stiffness @ basis,
        basis.T @ part.mass @ basis,
        (modes.shape[1], len(part.bore_dofs), boundary.shape[1]),
    )


def two_step(part: Part, n_modes: int, n_interior: int, directions=(0, 1)) -> np.ndarray:
    """M2: ``T_1 T_2`` of (25), the second step by a whole Craig-Bampton reduction.

    The zeros of (22) and (23) to the letter, where bore and boundary meet, would hold the bore
    undeformed under a force at a boundary point: K has none there after the first step.
    """
    first = first_step(part, n_interior, directions)
    v, p, b = first.sizes
    centre = np.zeros((v + p + b, part.centre.shape[1]))
    centre[v : v + p] = part.centre[part.bore_dofs]
    boundary = np.eye(v + p + b)[:, v + p :]
    second = _craig_bampton(first.stiffness, first.mass, centre, boundary, n_modes)
    return first.basis @ second


def pressure_set(part: Part, name: str) -> np.ndarray:
    """``P_c`` of (34) or (35), or one half of (35), for a bore with columns of nodes."""
    x, y, z = part.pressure_nodes.T
    if name == "pc1":
        return np.eye(len(z))
    angle = np.round(np.degrees(np.arctan2(y, x)), 4) % 360.0
    long = (angle[:, None] == np.unique(angle)).astype(float)
    width = np.ptp(z)
    short = 4 * 1.5 / width**2 * (width**2 / 4 - z[:, None] ** 2) * long
    halves = {"pc2-long": [long], "pc2-short": [short], "pc2": [long, short]}
    return np.hstack(halves[name])


def in_range(matrix: np.ndarray, largest: float | None = None) -> np.ndarray:
    """Eigenvectors of a semidefinite matrix that are not null vectors, smallest eigenvalue first.

    J has null vectors, pressures that push no node: of 1e-16 where all others are above 1e-9,
    relative to the largest eigenvalue, that of `matrix` unless given.
    """
    values, vectors = linalg.eigh(matrix)
    relative = values / (values[-1] if largest is None else largest)
    kept = relative > 1e-12
    assert not kept.any() or relative[kept][0] > 1e-9, "no gap: which are null is unclear"
    return vectors[:, kept]


def select(stiffness, mass, name):
    """Combinations of candidates, best first, by (31), (32) or another choice.

    Returns the values that order them, the largest first but for the smallest eigenvalues, and
    the combinations as columns.
    """
    if name == "every-column":
        return np.arange(len(stiffness))[::-1] / len(stiffness), np.eye(len(stiffness))
    if name == "lowest-frequency":
        vectors = in_range(stiffness)
        # 1 / omega^2, because K is the definite one.
        values, inner = linalg.eigh(*(vectors.T @ a @ vectors for a in (mass, stiffness)))
        return values[::-1], (vectors @ inner)[:, ::-1]
    values, vectors = linalg.eigh(stiffness)
    order = slice(None, None, 1 if name == "smallest-eigenvalue" else -1)
    return values[order], vectors[:, order]


def residual_candidates(part: Part, n_vibration, pressures, selection):
    """All of (32): values and combinations as from `select`, and the filtered ``G_c``, (N, c)."""
    omega, modes = (a[..., :n_vibration] for a in part.spectrum)
    covered = modes / omega**2 @ (modes.T @ (part.load @ pressures))
    answers = part.pressure_answers @ pressures - covered  # (30)
    reduced = (answers.T @ matrix @ answers for matrix in (part.stiffness, part.mass))
    return *select(*reduced, selection), answers


def clear_count(part: Part, n_vibration, pressures, selection, counts) -> int:
    """That of `counts` residual modes after which the widest gap leaves no doubt which they are."""
    if selection == "proper-orthogonal":
        values = linalg.svdvals(pressures)
    else:
        values = residual_candidates(part, n_vibration, pressures, selection)[0]
    gaps = np.abs(np.diff(values)) / np.abs(values).max()
    return max(counts, key=lambda count: gaps[count - 1])


def load_dependent(
    part: Part, n_vibration, n_residual, pressures, selection, directions=(0, 1)
) -> np.ndarray:
    """M3: T of (26), the residual modes chosen by name, or of pressures by their SVD.

    Static modes that depend on the others are left out.
    """
    if selection == "proper-orthogonal":
        left, sizes, _ = linalg.svd(pressures, full_matrices=False)
        pressures = left[:, sizes > 1e-12 * sizes[0]][:, :n_residual]
        selection, n_residual = "every-column", pressures.shape[1]
    omega, modes = (a[..., :n_vibration] for a in part.spectrum)
    attachment = part.boundary(directions)
    attached = static_responses(part, attachment)
    attached = attached - modes / omega**2 @ (modes.T @ attachment)  # (30)
    if not n_residual:
        return np.hstack([modes, attached])
    _, ranked, answers = residual_candidates(part, n_vibration, pressures, selection)
    chosen = ranked[:, :n_residual]
    stiffness = answers.T @ part.stiffness @ answers
    # Each group by itself: a unit force and a unit pressure are worlds apart.
    chosen = chosen @ in_range(chosen.T @ stiffness @ chosen, linalg.eigvalsh(stiffness)[-1])
    static = np.hstack([attached, answers @ chosen])
    static = static / np.sqrt(np.einsum("ij,ij->j", static, part.stiffness @ static))
    return np.hstack([modes, static @ in_range(static.T @ part.stiffness @ static)])


def full_interface(part: Part, n_vibration: int, directions=(0, 1)) -> np.ndarray:
    """M3 with every column of (34)."""
    every = pressure_set(part, "pc1")
    return load_dependent(part, n_vibration, len(every), every, "every-column", directions)


def residual_flexibility(
    part: Part, n_vibration: int, directions=(0, 1), *, centrifugal: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """M4: its T, and the responses ``G J - T K_r^-1 T^T J`` that no coordinate has, (N, k)."""
    omega, modes = (a[..., :n_vibration] for a in part.spectrum)
    radius = (part.nodes * [1.0, 1.0, 0.0]).reshape(-1, 1)
    loads = np.hstack([part.boundary(directions), (part.mass @ radius)[:, : int(centrifugal)]])
    responses = static_responses(part, loads) - modes / omega**2 @ (modes.T @ loads)  # (30)
    basis = np.hstack([modes, responses])
    return basis, part.pressure_answers - basis @ coordinates(part, basis, part.load)


def coordinates(part: Part, basis: np.ndarray, loads: np.ndarray) -> np.ndarray:
    """``K_r^-1 T^T f``: static answer of the reduced part."""
    sizes = linalg.norm(basis, axis=0)
    unit = basis / sizes
    answer = linalg.solve(unit.T @ part.stiffness @ unit, unit.T @ loads, assume_a="pos")
    return answer / sizes[:, None]


def without_rigid_motion(part: Part, columns: np.ndarray) -> np.ndarray:
    """Columns made mass-orthogonal to U."""
    return columns - part.rigid @ (part.rigid.T @ part.mass @ columns)


def basis_flexibility(part: Part, basis: np.ndarray) -> np.ndarray:
    """Bore answer (3 m, k) to pressures in balance, of a basis, rigid motion removed [m/Pa]."""
    balanced = part.load - part.mass @ part.rigid @ (part.rigid.T @ part.load)
    answer = basis @ coordinates(part, basis, balanced)
    return without_rigid_motion(part, answer)[part.bore_dofs]


def pencil(part: Part, basis: np.ndarray) -> np.ndarray:
    """Elastic angular frequencies of the part reduced to rigid motions and basis, ascending."""
    elastic = without_rigid_motion(part, basis)
    elastic = elastic / linalg.norm(elastic, axis=0)
    values = linalg.eigvalsh(elastic.T @ part.mass @ elastic, elastic.T @ part.stiffness @ elastic)
    return 1.0 / np.sqrt(values[::-1])


def spun(columns: np.ndarray) -> np.ndarray:
    """``e_z x u`` node by node."""
    by_node = columns.reshape(-1, 3, columns.shape[1])
    return np.cross(AXES[2], by_node, axisb=1, axisc=1).reshape(columns.shape)
