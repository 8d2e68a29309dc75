"""M4: a few dynamic modes, and the remaining bore flexibility as a quasi-static response.

A residual mode of M3 has a frequency of up to 700 kHz, and its dynamics are negligible. M4 uses the
complete flexibility ``G_c = G J`` of the bore: the coordinates q contain a part of it, the residual
S_res the rest,

    u_bore = Psi q + S_res w,   S_res = G_c - T K_r^-1 T^T J,   w + zeta dw/dt = P.

For the complete part and any load f the static response that a basis misses is

    (G - T K_r^-1 T^T) f.

Added to the displacement ``T q`` it recovers the static response to the loads: the mode
acceleration method (T. Irvine, The mode acceleration method, 2014,
scribd.com/document/659487661). Loads of a free part are made self-equilibrated first. The
displacement is correct up to a rigid motion, which depends on the frame and causes no stress.
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


def missing_response(
    static: StaticSolver,
    body: ReducedBody,
    columns: np.ndarray,
    loads: Callable[[slice], np.ndarray],
    count: int,
) -> np.ndarray:
    """Static response minus that of the basis, owned rows (owned dofs, count); collective.

    Parameters
    ----------
    static
        Static responses of the part.
    Reduced body of the part.
        Reduction of the part.
    columns
        The part-size basis T, owned rows, shape (owned dofs, n).
    loads
        Function that returns a range of the loads, owned rows [N].
    count
        Number of loads.
    """
    comm = static.structure.comm
    fields = np.empty((len(columns), count))
    for some in blocks(count, len(columns), comm):
        forces = loads(some)
        work = inner(columns, static.equilibrate(forces), comm)
        covered = combine(columns, np.linalg.solve(body.stiffness, work))
        fields[:, some] = static.solve(forces) - covered
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

    Every basis has the response to forces on boundary points. The rigid inertia that balances them
    in the frame of M1 and M2, and the inertia of elastic motion, are neglected.

    Parameters
    ----------
    structure, body, columns
        See `missing_response`.
    forces
        Forces on the nodes of all bores, shape (c, m, 3) [N].
    speeds
        Angular speeds of the part about z, shape (c,) [rad/s].

    Returns
    -------
    numpy.ndarray
        Owned rows, shape (owned dofs, c) [m].
    """
    static = StaticSolver(structure)
    turning = centrifugal_load(structure, static.mass)

    def loads(some: slice) -> np.ndarray:
        return on_bores(structure, np.moveaxis(forces[some], 0, 2)) + turning * speeds[some] ** 2

    return missing_response(static, body, columns, loads, len(speeds))


#: Largest relative difference of two reductions of the same part.
SAME_BASIS = 1e-6


def basis_of(body: ReducedBody, made: ReducedBody, columns: np.ndarray) -> np.ndarray:
    """Basis T of a body that was stored without it, from the same part reduced again.

    On another machine the signs of modes may differ, and modes of equal frequency may be other
    combinations. The displacements of bores and points determine the relation of the coordinates.

    Parameters
    ----------
    body
        The stored body.
    made
        The body of the new reduction.
    columns
        The basis of `made`, owned rows, shape (owned dofs, n).

    Raises
    ------
    VerificationError
        The bodies are not reductions of the same part by the same method.
    """
    old = _displacements(body)
    new = _displacements(made)
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
    for matrix, stored in ((made.stiffness, body.stiffness), (made.mass, body.mass)):
        root = np.sqrt(np.diag(stored))
        defects.append(np.abs((turn.T @ matrix @ turn - stored) / np.outer(root, root)).max())
    if not max(defects) <= SAME_BASIS:
        raise VerificationError(
            f"the part made again differs from its run's body by {max(defects):.1e}, above "
            f"{SAME_BASIS:.0e}: was its model changed?"
        )
    return columns @ turn


def _displacements(body: ReducedBody) -> np.ndarray:
    """Displacements of bores and points for unit coordinates, shape (rows, n)."""
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
    """M4: reduce a part to vibration and static modes, with the residual flexibility quasi-static.

    Parameters
    ----------
    part
        The part, free or clamped, or a `Reductor` of it.
    n_vibration
        Vibration modes.
    truncation
        Largest bore displacement of dropped residual pressure patterns, relative to that of the
        first pattern; 0 drops only round-off.
    centrifugal
        Also keep the static response to the centrifugal load ``M x`` (x and y components) of
        a part that rotates about z.
    estimate_error
        Also compute the inertia of the residual patterns, which the method neglects.
    keep_basis
        See `load_dependent`.

    Returns
    -------
    ReducedBody
        Body with `residual`; its missing flexibility is that of the dropped patterns.

    Raises
    ------
    SettingsError
        A number of modes is negative, no mode is requested, or `truncation` is outside [0, 1).
    SolverError, VerificationError
        A solver or a check of the result fails.
    """
    reductor = Reductor.of(part)
    if not 0.0 <= truncation < 1.0:
        raise SettingsError(f"residual_truncation {truncation:g} is not in [0, 1)")
    if not n_vibration + reductor.points.shape[1] + centrifugal:
        raise SettingsError("vibration_modes 0, no boundary point and no centrifugal mode: no mode")
    basis, residual = reductor.once(
        "m4", (n_vibration, centrifugal), lambda: _complete(reductor, n_vibration, centrifugal)
    )
    residual = _truncated(reductor, residual, truncation)
    if estimate_error:
        residual = replace(residual, mass=_inertia(reductor, basis, residual.patterns.T))
    return reductor.project(basis, "m4", residual=residual, keep_basis=keep_basis)


def _complete(
    reductor: Reductor, n_vibration: int, centrifugal: bool
) -> tuple[Basis, ResidualFlexibility]:
    """Vibration modes and static responses, and the complete residual flexibility of the bore."""
    fields = reductor.points
    if centrifugal:
        fields = np.hstack([fields, centrifugal_load(reductor.structure, reductor.mass)])
    none = np.zeros((reductor.structure.pressures, 0))
    responses = StaticResponses(reductor.static, fields, none, *reductor.vibration(n_vibration))
    basis = dual_basis(responses, np.eye(responses.count), responses.count)
    return basis, _residual(reductor, basis)


def _residual(reductor: Reductor, basis: Basis) -> ResidualFlexibility:
    """``S_res`` by the eigenvectors of ``J^T S_res``, the most flexible first, without mass.

    ``J^T S_res`` is symmetric and positive semidefinite. Its eigenvectors V are pressure patterns
    without mutual energy, ``S_res = (S_res V) V^T``.
    """
    structure = reductor.structure
    displacement, energy = reductor.flexibility
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
    """Patterns up to the last one above the truncation, without round-off."""
    sizes = np.abs(all_outward(reductor.structure.bores, residual.displacement)).max(axis=0)
    # Round-off of the covered part causes small eigenvalues of either sign at the end.
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
    """Part-size displacements of the residual patterns V.

        (G_c - T K_r^-1 T^T J) V

    A body stores only the bore rows of these fields, `ResidualFlexibility.displacement`. The
    complete fields are solved for again, by one solve per pattern or combination of patterns.
    Collective.

    Parameters
    ----------
    structure
        The part.
    body
        Reduction of the part with M4.
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

    return missing_response(StaticSolver(structure), body, columns, loads, pressures.shape[1])
