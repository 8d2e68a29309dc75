"""M4: a few dynamic modes, all remaining bore flexibility answered at once.

A residual mode of M3 has a frequency of up to 700 kHz and carries no dynamics. Here
the pressure meets the whole flexibility ``G_c = G J`` of the bore, of which the
coordinates q keep what they cover:

    u_bore = Psi q + S_res w,   S_res = G_c - T K_r^-1 T^T J,   w + zeta dw/dt = P.

The same of the whole part and of any load, the static answer that a basis misses,

    (G - T K_r^-1 T^T) f,

added to the displacement ``T q`` makes a recovery of what the loads balance statically: the mode
acceleration method (T. Irvine, The mode acceleration method, 2014, scribd.com/document/659487661).
Of a free part f is made self-equilibrated first. The answer is right but for a rigid motion, which
is another one in another frame and has no stress.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fenics_ehd.base.errors import SettingsError, VerificationError
from fenics_ehd.reduction.body import ReducedBody, ResidualFlexibility
from fenics_ehd.reduction.bore import all_outward
from fenics_ehd.reduction.load_dependent_basis import dual_basis
from fenics_ehd.reduction.matrices import (
    MassOperator,
    blocks,
    combine,
    falling_eigenpairs,
    inner,
    load_columns,
    symmetric,
    transpose_multiply,
)
from fenics_ehd.reduction.reductor import (
    Basis,
    Reductor,
    StaticResponses,
    bore_rows,
    on_bores,
)
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.reduction.structure import Structure


def missing_answers(
    static: StaticSolver,
    body: ReducedBody,
    columns: np.ndarray,
    loads: Callable[[slice], np.ndarray],
    count: int,
) -> np.ndarray:
    """Static answers less what the basis answers, owned rows (owned dofs, count); collective.

    Parameters
    ----------
    static
        Of the part.
    body
        Its reduction.
    columns
        The part-size basis T, owned rows, shape (owned dofs, n).
    loads
        Some of the loads, owned rows [N].
    count
        How many there are.
    """
    comm = static.structure.comm
    fields = np.empty((len(columns), count))
    for some in blocks(count, len(columns), comm):
        given = loads(some)
        work = inner(columns, static.equilibrate(given), comm)
        answered = combine(columns, np.linalg.solve(body.stiffness, work))
        fields[:, some] = static.solve(given) - answered
    return fields


def centrifugal_load(structure: Structure, mass: MassOperator) -> np.ndarray:
    """``M (x, y, 0)``: inertia of unit rate about z, owned rows (owned dofs, 1)."""
    radius = structure.coordinates.copy()
    radius[:, 2] = 0.0
    return mass.multiply(np.asfortranarray(radius.reshape(-1, 1)))


def missing_fields(
    structure: Structure,
    body: ReducedBody,
    columns: np.ndarray,
    forces: np.ndarray,
    speeds: np.ndarray,
) -> np.ndarray:
    """Displacements that a basis misses under forces on bores and under rotation, in any frame.

    Forces of boundary points are in every basis. The rigid inertia that balances them in M1's and
    M2's frame, and that of elastic motion, stay left out.

    Parameters
    ----------
    structure, body, columns
        As in `missing_answers`.
    forces
        On the nodes of all bores, shape (c, m, 3) [N].
    speeds
        Of the part about z, shape (c,) [rad/s].

    Returns
    -------
    numpy.ndarray
        Owned rows, shape (owned dofs, c) [m].
    """
    static = StaticSolver(structure)
    turning = centrifugal_load(structure, static.mass)

    def loads(some: slice) -> np.ndarray:
        return on_bores(structure, np.moveaxis(forces[some], 0, 2)) + turning * speeds[some] ** 2

    return missing_answers(static, body, columns, loads, len(speeds))


#: Largest difference of the two bodies, relative.
SAME_BASIS = 1e-6


def basis_of(body: ReducedBody, made: ReducedBody, columns: np.ndarray) -> np.ndarray:
    """The basis T of a body whose file does not hold it, from the same part reduced again.

    On another machine the signs of modes may differ, and modes of one frequency be other
    combinations of the same: the coordinates' meaning is read off the bores and points.

    Parameters
    ----------
    body
        As it was.
    made
        As it is now.
    columns
        The basis of `made`, owned rows, shape (owned dofs, n).

    Raises
    ------
    VerificationError
        They are not reductions of the same part by the same method.
    """
    old = _seen(body)
    new = _seen(made)
    if old.shape != new.shape:
        raise VerificationError(
            f"the part made again has {made.modes} modes and {len(made.bore_basis)} bore nodes, "
            f"its run's body {body.modes} and {len(body.bore_basis)}: was its model changed?"
        )
    size = np.abs(old).max(initial=0.0)
    if np.abs(new - old).max(initial=0.0) <= 1e-3 * SAME_BASIS * size:
        return columns
    scale = np.linalg.norm(new, axis=0)
    turn = np.linalg.lstsq(new / scale, old, rcond=None)[0] / scale[:, None]
    defects = [np.abs(new @ turn - old).max() / size]
    for matrix, own in ((made.stiffness, body.stiffness), (made.mass, body.mass)):
        root = np.sqrt(np.diag(own))
        defects.append(np.abs((turn.T @ matrix @ turn - own) / np.outer(root, root)).max())
    if not max(defects) <= SAME_BASIS:
        raise VerificationError(
            f"the part made again differs from its run's body by {max(defects):.1e}, above "
            f"{SAME_BASIS:.0e}: was its model changed?"
        )
    return columns @ turn


def _seen(body: ReducedBody) -> np.ndarray:
    """Displacements of bores and points by each coordinate, shape (rows, n)."""
    points = [field[:, 3:] for field in body.points.values()]
    return np.vstack([body.bore_basis.reshape(-1, body.modes), *points])


#: Largest bore displacement of a dropped residual pattern, relative to the largest of any.
TRUNCATION = 1e-4


def residual_flexibility(
    part: Structure | Reductor,
    n_vibration: int,
    *,
    truncation: float = TRUNCATION,
    centrifugal: bool = True,
    estimate_error: bool = True,
    keep_basis: bool = False,
) -> ReducedBody:
    """M4: reduce a part to vibration and static modes with the rest of the bore quasi-static.

    Parameters
    ----------
    part
        The part, free or clamped, or a `Reductor` of it.
    n_vibration
        Vibration modes.
    truncation
        Residual pressure patterns that move no bore node by more than this fraction of what
        the first pattern does are dropped; 0 keeps all that are not round-off.
    centrifugal
        Also keep the static response to the centrifugal load ``M x`` (x and y components) of
        a part that turns about z.
    estimate_error
        Also compute the inertia of the residual patterns, which the method neglects.
    keep_basis
        As in `load_dependent`.

    Returns
    -------
    ReducedBody
        With `residual`; its missing flexibility is what the truncation dropped.

    Raises
    ------
    SettingsError
        A negative number of modes, no mode at all, or `truncation` outside [0, 1).
    SolverError, VerificationError
        From the solvers and the checks of the result.
    """
    reductor = Reductor.of(part)
    if not 0.0 <= truncation < 1.0:
        raise SettingsError(f"residual_truncation {truncation:g} is not in [0, 1)")
    if not n_vibration + reductor.points.shape[1] + centrifugal:
        raise SettingsError("vibration_modes 0, no boundary point and no centrifugal mode: no mode")
    basis, residual = reductor.once(
        "m4", (n_vibration, centrifugal), lambda: _whole(reductor, n_vibration, centrifugal)
    )
    residual = _truncated(reductor, residual, truncation)
    if estimate_error:
        residual = replace(residual, mass=_inertia(reductor, basis, residual.patterns.T))
    return reductor.project(basis, "m4", residual=residual, keep_basis=keep_basis)


def _whole(
    reductor: Reductor, n_vibration: int, centrifugal: bool
) -> tuple[Basis, ResidualFlexibility]:
    """Vibration modes and static responses, and all that is left of the bore's flexibility."""
    fields = reductor.points
    if centrifugal:
        fields = np.hstack([fields, centrifugal_load(reductor.structure, reductor.mass)])
    none = np.zeros((reductor.structure.pressures, 0))
    responses = StaticResponses(reductor.static, fields, none, *reductor.vibration(n_vibration))
    basis = dual_basis(responses, np.eye(responses.count), responses.count)
    return basis, _residual(reductor, basis)


def _residual(reductor: Reductor, basis: Basis) -> ResidualFlexibility:
    """``S_res`` by the eigenvectors of ``J^T S_res``, the most flexible first, without mass.

    ``J^T S_res`` is symmetric and positive semidefinite: its eigenvectors V are pressure
    patterns that store energy apart from each other, ``S_res = (S_res V) V^T``.
    """
    structure = reductor.structure
    (displacement, energy) = reductor.flexibility
    load = transpose_multiply(structure.load, basis.columns).T
    covered = np.linalg.solve(basis.stiffness, load)
    shape = bore_rows(structure, basis.columns)
    m = len(shape)
    rest = displacement - (shape.reshape(3 * m, -1) @ covered).reshape(m, 3, -1)
    values, vectors = falling_eigenpairs(symmetric(energy - load.T @ covered))
    moved = (rest.reshape(3 * m, -1) @ vectors).reshape(m, 3, -1)
    return ResidualFlexibility(moved, vectors.T, values, np.zeros((0, 0)))


def _truncated(
    reductor: Reductor, residual: ResidualFlexibility, truncation: float
) -> ResidualFlexibility:
    """Patterns up to the last that moves the bore, but no round-off."""
    sizes = np.abs(all_outward(reductor.structure.bores, residual.displacement)).max(axis=0)
    # Round-off of the covered part leaves eigenvalues of either sign at the end.
    largest = np.abs(np.diag(reductor.flexibility[1])).max()
    real = np.sum(residual.stiffness > 1e-13 * largest * len(sizes))
    wanted = np.flatnonzero(sizes[:real] > truncation * sizes.max())
    rank = wanted[-1] + 1 if len(wanted) else 0
    return replace(
        residual,
        displacement=residual.displacement[:, :, :rank],
        patterns=residual.patterns[:rank],
        stiffness=residual.stiffness[:rank],
    )


def _inertia(reductor: Reductor, basis: Basis, patterns: np.ndarray) -> np.ndarray:
    """Mass matrix of the residual responses to pressure patterns (k, r), shape (r, r)."""
    modes = basis.columns
    angular = np.sqrt(np.diag(basis.stiffness))
    # The static modes are covered like vibration modes: both are uncoupled in stiffness.
    return StaticResponses(reductor.static, modes[:, :0], patterns, angular, modes).mass


def pattern_fields(
    structure: Structure,
    body: ReducedBody,
    columns: np.ndarray,
    amplitudes: np.ndarray | None = None,
) -> np.ndarray:
    """Displacements of amplitudes of the residual patterns V.

        (G_c - T K_r^-1 T^T J) V

    A body keeps their bore rows only, `ResidualFlexibility.displacement`; this solves for all
    rows again, one solve per pattern or combination of them. Collective.

    Parameters
    ----------
    structure
        The part.
    body
        Its reduction with M4.
    columns
        The part-size basis T, owned rows, shape (owned dofs, n).
    amplitudes
        Combinations, shape (r, c) [Pa]; None: unit amplitudes of each pattern.

    Returns
    -------
    numpy.ndarray
        Owned rows, shape (owned dofs, r or c) [m/Pa, m]; zeros for a body without patterns.
    """
    residual = body.residual
    if residual is None:
        return np.zeros((len(columns), 0 if amplitudes is None else amplitudes.shape[1]))
    pressures = residual.patterns.T
    if amplitudes is not None:
        pressures = pressures @ amplitudes

    def loads(some: slice) -> np.ndarray:
        return load_columns(structure.load, pressures[:, some])

    return missing_answers(StaticSolver(structure), body, columns, loads, pressures.shape[1])
