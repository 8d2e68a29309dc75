"""M4: a few dynamic modes, all remaining bore flexibility answered at once.

A residual mode of M3 has a frequency of up to 700 kHz and carries no dynamics. Here
the pressure meets the whole flexibility ``G_c = G J`` of the bore, of which the
coordinates q keep what they cover:

    u_bore = Psi q + S_res w,   S_res = G_c - T K_r^-1 T^T J,   w + zeta dw/dt = P.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Unpack

import numpy as np

from fenics_ehd.base.errors import SettingsError, VerificationError
from fenics_ehd.reduction.body import ReducedBody, ResidualFlexibility
from fenics_ehd.reduction.bore import all_outward
from fenics_ehd.reduction.completion import centrifugal_load, missing_answer
from fenics_ehd.reduction.distributed import (
    blocks,
    load_columns,
    symmetric,
    transpose_multiply,
)
from fenics_ehd.reduction.load_dependent import dual_basis, static_modes
from fenics_ehd.reduction.loads import LoadSet, StaticResponses
from fenics_ehd.reduction.projection import Basis, bore_rows
from fenics_ehd.reduction.reductor import Options, Reductor
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.reduction.structure import Structure

#: Largest bore displacement of a dropped residual pattern, relative to the largest of any.
TRUNCATION = 1e-4

#: Largest difference of the patterns' whole fields from the body's own bore rows, relative to the
#: largest of these.
AGREEMENT = 1e-6


def residual_flexibility(
    part: Structure | Reductor,
    n_vibration: int,
    *,
    truncation: float = TRUNCATION,
    centrifugal: bool = True,
    estimate_error: bool = True,
    keep_basis: bool = False,
    **options: Unpack[Options],
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
    keep_basis, options
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
    reductor = Reductor.of(part, **options)
    if n_vibration < 0:
        raise SettingsError(f"vibration_modes {n_vibration} is below 0")
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
    angular, modes = reductor.vibration(n_vibration)
    responses = StaticResponses(
        reductor.static, LoadSet(reductor.structure, fields, None), angular, modes
    )
    found = static_modes(responses, np.eye(fields.shape[1]))
    accuracy = {"static_dropped": float(found.dependent)}
    basis = dual_basis(reductor.static, angular, modes, found, (), accuracy)
    return basis, _residual(reductor, basis)


def _residual(reductor: Reductor, basis: Basis) -> ResidualFlexibility:
    """``S_res`` by the eigenvectors of ``J^T S_res``, the most flexible first, without mass.

    ``J^T S_res`` is symmetric and positive semidefinite: its eigenvectors V are pressure
    patterns that store energy apart from each other, ``S_res = (S_res V) V^T``.
    """
    structure, whole = reductor.structure, reductor.flexibility
    load = transpose_multiply(structure.load, basis.columns).T
    covered = np.linalg.solve(basis.stiffness, load)
    shape = bore_rows(structure, basis.columns)
    m = len(shape)
    rest = whole.displacement - (shape.reshape(3 * m, -1) @ covered).reshape(m, 3, -1)
    values, vectors = np.linalg.eigh(symmetric(whole.energy - load.T @ covered))
    values, vectors = values[::-1], vectors[:, ::-1]
    moved = (rest.reshape(3 * m, -1) @ vectors).reshape(m, 3, -1)
    return ResidualFlexibility(moved, vectors.T, values, np.zeros((0, 0)))


def _truncated(
    reductor: Reductor, residual: ResidualFlexibility, truncation: float
) -> ResidualFlexibility:
    """Patterns up to the last that moves the bore, but no round-off."""
    values = residual.stiffness
    sizes = np.abs(all_outward(reductor.structure.bores, residual.displacement)).max(axis=0)
    # Round-off of the covered part leaves eigenvalues of either sign at the end.
    largest = np.abs(np.diag(reductor.flexibility.energy)).max()
    real = values > 1e-13 * largest * len(values)
    wanted = (sizes > truncation * sizes.max()) & real
    rank = int(np.flatnonzero(wanted)[-1]) + 1 if wanted.any() else 0
    rank = min(rank, int(np.argmin(real)) if not real.all() else len(real))
    return ResidualFlexibility(
        residual.displacement[:, :, :rank], residual.patterns[:rank], values[:rank], residual.mass
    )


def _inertia(reductor: Reductor, basis: Basis, patterns: np.ndarray) -> np.ndarray:
    """Mass matrix of the residual responses to pressure patterns (k, r), shape (r, r)."""
    modes = basis.columns
    angular = np.sqrt(np.diag(basis.stiffness))
    # The static modes are covered like vibration modes: both are uncoupled in stiffness.
    loads = LoadSet(reductor.structure, modes[:, :0], patterns)
    return StaticResponses(reductor.static, loads, angular, modes).mass


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

    Raises
    ------
    VerificationError
        The bore rows are not those of the body: it was made from another part.
    """
    residual = body.residual
    rank = 0 if residual is None else residual.rank
    wanted = np.eye(rank) if amplitudes is None else amplitudes
    if residual is None or not rank:
        return np.zeros((len(columns), wanted.shape[1]))
    pressures = residual.patterns.T @ wanted
    static, fields = StaticSolver(structure), np.empty((len(columns), wanted.shape[1]))
    for some in blocks(fields.shape[1], len(columns), structure.comm):
        loads = load_columns(structure.load, pressures[:, some])
        fields[:, some] = missing_answer(static, body, columns, loads)
    own = residual.displacement @ wanted
    defect = np.abs(bore_rows(structure, fields) - own).max()
    if not defect <= AGREEMENT * np.abs(own).max():
        raise VerificationError(
            f"residual patterns move the bore by {defect:.1e} m/Pa else than the body says, "
            f"limit {AGREEMENT:.0e} of the largest: was the body made from this part?"
        )
    return fields
