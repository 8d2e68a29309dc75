"""M4: a few dynamic modes, and the remaining bore flexibility as a quasi-static response.

A residual mode of M3 has a frequency of up to 700 kHz, so that its dynamics are negligible. M4 uses
the complete flexibility ``G_c = G J`` of the bores. The coordinates q contain a part of it, and the
residual flexibility S_res is the rest. With nodal pressures P, the displacement of the bores is

    u_bore = Psi q + S_res w,   S_res = G_c - T K_r^-1 T^T J,   w + zeta dw/dt = P.

For all nodes of a part and any load f, the static response that a basis does not contain is

    (G - T K_r^-1 T^T) f.

The sum of this response and the displacement ``T q`` contains the full static response to the
loads. This is the mode acceleration method (T. Irvine, The mode acceleration method, 2014,
scribd.com/document/659487661). Loads on a free part are first brought into equilibrium with
inertia forces. The displacement is correct up to a rigid motion, which depends on the frame and
causes no stress.
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
    """Static response of a part minus that of its reduced body; collective.

    Parameters
    ----------
    static
        Static solver of the part.
    body
        Reduced body of the part.
    columns
        Basis T of the body, rows of this rank, shape (owned dofs, n).
    loads
        Function that returns the load columns of a range, rows of this rank [N].
    count
        Number of loads.

    Returns
    -------
    numpy.ndarray
        Displacements that the basis does not contain, shape (owned dofs, count) [m].
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
    """Centrifugal load ``M (x, y, 0)`` of unit angular speed about z, shape (owned dofs, 1)."""
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
    """Static displacements that a basis does not contain, for forces on bores and rotation.

    Every basis contains the response to forces on boundary points. Two loads are neglected: the
    rigid inertia that balances these forces in the frame of M1 and M2, and the inertia of elastic
    motion.

    Parameters
    ----------
    structure, body, columns
        See `missing_response`.
    forces
        Forces on the nodes of all bores for each of c cases, shape (c, m, 3) [N].
    speeds
        Angular speed of the part about z for each case, shape (c,) [rad/s].

    Returns
    -------
    numpy.ndarray
        Displacements, rows of this rank, shape (owned dofs, c) [m].
    """
    static = StaticSolver(structure)
    turning = centrifugal_load(structure, static.mass)

    def loads(some: slice) -> np.ndarray:
        return on_bores(structure, np.moveaxis(forces[some], 0, 2)) + turning * speeds[some] ** 2

    return missing_response(static, body, columns, loads, len(speeds))


#: Largest relative difference at which two reductions count as those of the same part.
SAME_BASIS = 1e-6


def basis_of(body: ReducedBody, made: ReducedBody, columns: np.ndarray) -> np.ndarray:
    """Compute the basis T of a body that was stored without it, from a new reduction of the part.

    If the part is reduced on another machine, signs of modes may differ, and modes of equal
    frequency may be combined differently. The relation between the coordinates of the two bodies
    follows from the displacements of bores and boundary points.

    Parameters
    ----------
    body
        Stored body.
    made
        Body of the new reduction.
    columns
        Basis of `made`, rows of this rank, shape (owned dofs, n).

    Raises
    ------
    VerificationError
        If the bodies are not reductions of the same part by the same method.
    """
    old = _displacements(body)
    new = _displacements(made)
    if old.shape != new.shape:
        raise VerificationError(
            f"the part reduced again has {made.modes} modes and {len(made.bore_basis)} bore nodes, "
            f"but the body of the run has {body.modes} and {len(body.bore_basis)}: was the model "
            "changed?"
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
            f"the part reduced again differs from the body of the run by {max(defects):.1e}, above "
            f"{SAME_BASIS:.0e}: was the model changed?"
        )
    return columns @ turn


def _displacements(body: ReducedBody) -> np.ndarray:
    """Displacements of bore nodes and boundary points for unit coordinates, shape (rows, n)."""
    points = [field[:, 3:] for field in body.points.values()]
    return np.vstack([body.bore_basis.reshape(-1, body.modes), *points])


#: Largest bore displacement due to a dropped residual pattern, relative to that of any pattern.
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
        The part, free or clamped, or its `Reductor`.
    n_vibration
        Number of vibration modes.
    truncation
        Largest bore displacement due to a dropped residual pattern, relative to the largest due
        to any pattern; 0 to drop only round-off.
    centrifugal
        Whether the basis contains the static response to the centrifugal load of a part that
        rotates about z.
    estimate_error
        Whether to compute the inertia of the residual patterns, which the method neglects.
    keep_basis
        See `load_dependent`.

    Returns
    -------
    ReducedBody
        Body with `residual`; its missing flexibility is that of the dropped patterns.

    Raises
    ------
    SettingsError
        If a number of modes is negative, if there is no mode at all, or if `truncation` is
        outside [0, 1).
    SolverError, VerificationError
        If a solver or a check of the result fails.
    """
    reductor = Reductor.of(part)
    if not 0.0 <= truncation < 1.0:
        raise SettingsError(f"residual_truncation {truncation:g} is not in [0, 1)")
    if not n_vibration + reductor.points.shape[1] + centrifugal:
        raise SettingsError(
            "vibration_modes is 0, and the part has no boundary point and no centrifugal mode: at "
            "least one mode is needed"
        )
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
    """Compute the basis of M4 and the complete residual flexibility of the bores.

    The basis consists of vibration modes and of static responses to boundary and centrifugal loads.
    """
    fields = reductor.points
    if centrifugal:
        fields = np.hstack([fields, centrifugal_load(reductor.structure, reductor.mass)])
    none = np.zeros((reductor.structure.pressures, 0))
    responses = StaticResponses(reductor.static, fields, none, *reductor.vibration(n_vibration))
    basis = dual_basis(responses, np.eye(responses.count), responses.count)
    return basis, _residual(reductor, basis)


def _residual(reductor: Reductor, basis: Basis) -> ResidualFlexibility:
    """Decompose S_res by the eigenvectors of ``J^T S_res``, most flexible first; mass stays empty.

    ``J^T S_res`` is symmetric and positive semidefinite. Its eigenvectors V are pressure patterns
    that do no work on each other's displacements, and ``S_res = (S_res V) V^T``.
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
    """Drop the patterns behind the last one above the truncation limit, and those of round-off."""
    sizes = np.abs(all_outward(reductor.structure.bores, residual.displacement)).max(axis=0)
    # Round-off in the subtraction of the basis causes small last eigenvalues of either sign.
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
    # Static modes can be subtracted as vibration modes are: both are uncoupled in stiffness.
    return StaticResponses(reductor.static, modes[:, :0], patterns, angular, modes).mass


def pattern_fields(
    structure: Structure,
    body: ReducedBody,
    columns: np.ndarray,
    amplitudes: np.ndarray | None = None,
) -> np.ndarray:
    """Displacements of all nodes due to the residual patterns V; collective.

        (G_c - T K_r^-1 T^T J) V

    A body stores only the displacements of the bores, `ResidualFlexibility.displacement`. The
    complete fields are computed again, with one static solve per pattern or per combination of
    patterns.

    Parameters
    ----------
    structure
        Matrices and geometry of the part.
    body
        Body of the part reduced by M4.
    columns
        Basis T of the body, rows of this rank, shape (owned dofs, n).
    amplitudes
        Amplitudes of the patterns in c combinations, shape (r, c) [Pa]; None for each of the r
        patterns with unit amplitude.

    Returns
    -------
    numpy.ndarray
        Displacements, rows of this rank, shape (owned dofs, r) [m/Pa] or (owned dofs, c) [m];
        zeros if the body has no patterns.
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
