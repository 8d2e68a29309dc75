"""M4: a few dynamic modes, all remaining bore flexibility answered at once.

A residual mode of M3 has a frequency of up to 700 kHz and carries no dynamics. Here
the pressure meets the whole flexibility ``G_c = G J`` of the bore, of which the
coordinates q keep what they cover:

    u_bore = Psi q + S_res w,   S_res = G_c - T K_r^-1 T^T J,   w + zeta dw/dt = P.
"""

from __future__ import annotations

import numpy as np

from fenics_ehd.errors import SettingsError
from fenics_ehd.reduction.body import ReducedBody, ResidualFlexibility, outward
from fenics_ehd.reduction.checks import check_structure
from fenics_ehd.reduction.distributed import node_rows, symmetric
from fenics_ehd.reduction.eigenmodes import lowest_modes
from fenics_ehd.reduction.load_dependent import bore_flexibility, dual_basis
from fenics_ehd.reduction.loads import LoadSet, StaticResponses, attachment_loads
from fenics_ehd.reduction.projection import Basis, BoreFlexibility, project
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.reduction.static_basis import static_modes
from fenics_ehd.reduction.structure import Structure

#: Largest bore displacement of a dropped residual pattern, relative to the largest of any.
TRUNCATION = 1e-4


def residual_flexibility(
    structure: Structure,
    n_vibration: int,
    *,
    truncation: float = TRUNCATION,
    attachment_directions: tuple[int, ...] = (0, 1),
    centrifugal: bool = True,
    estimate_error: bool = True,
    keep_basis: bool = False,
    solver: str = "auto",
    options_prefix: str = "",
) -> ReducedBody:
    """M4: reduce a part to vibration and static modes with the rest of the bore quasi-static.

    Parameters
    ----------
    structure
        The part, free or clamped.
    n_vibration
        Vibration modes.
    truncation
        Residual pressure patterns that move no bore node by more than this fraction of what
        the first pattern does are dropped; 0 keeps all that are not round-off.
    attachment_directions
        As in `load_dependent`.
    centrifugal
        Also keep the static response to the centrifugal load ``M x`` (x and y components) of
        a part that turns about z.
    estimate_error
        Also compute the inertia of the residual patterns, which the method neglects.
    keep_basis, solver, options_prefix
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
    check_structure(structure)
    if n_vibration < 0:
        raise SettingsError(f"vibration_modes {n_vibration} is below 0")
    if not 0.0 <= truncation < 1.0:
        raise SettingsError(f"residual_truncation {truncation:g} is not in [0, 1)")
    static = StaticSolver(structure, solver=solver, options_prefix=f"{options_prefix}static_")
    fields = attachment_loads(structure, attachment_directions)
    if centrifugal:
        fields = np.hstack([fields, _centrifugal_load(static)])
    if not n_vibration + fields.shape[1]:
        raise SettingsError("vibration_modes 0, no boundary point and no centrifugal mode: no mode")
    basis = _dynamic_basis(static, n_vibration, fields, f"{options_prefix}modes_")
    whole = bore_flexibility(static)
    residual = _residual(static, basis, whole, truncation, estimate_error)
    return project(
        structure,
        static.mass,
        basis,
        method="m4",
        frame="mean-axis" if static.rigid_modes.shape[1] else "clamped",
        residual=residual,
        full_flexibility=whole,
        keep_basis=keep_basis,
    )


def _centrifugal_load(static: StaticSolver) -> np.ndarray:
    """``M (x, y, 0)``: inertia of unit rate about z, owned rows (owned dofs, 1)."""
    radius = static.structure.coordinates.copy()
    radius[:, 2] = 0.0
    return static.mass.multiply(np.asfortranarray(radius.reshape(-1, 1)))


def _dynamic_basis(
    static: StaticSolver, n_vibration: int, fields: np.ndarray, modes_prefix: str
) -> Basis:
    """Vibration modes and the static responses to the given loads."""
    angular, modes = lowest_modes(static, n_vibration, options_prefix=modes_prefix)
    loads = LoadSet(static.structure, fields, None)
    responses = StaticResponses.of(static, loads, angular, modes)
    found = static_modes(responses, np.eye(loads.count))
    accuracy = {"static_dropped": float(found.dependent)}
    return dual_basis(static, angular, modes, found, (), accuracy)


def _residual(
    static: StaticSolver,
    basis: Basis,
    whole: BoreFlexibility,
    truncation: float,
    with_mass: bool,
) -> ResidualFlexibility:
    """Low-rank factors of ``S_res`` by the eigenvectors of ``J^T S_res``.

    ``J^T S_res`` is symmetric and positive semidefinite: its eigenvectors V are pressure
    patterns that store energy apart from each other, ``S_res = (S_res V) V^T``.
    """
    structure = static.structure
    bore = structure.lubricated_bore
    load = LoadSet(structure, basis.columns[:, :0], None).nodal_work(basis.columns).T
    covered = np.linalg.solve(basis.stiffness, load)
    first = structure.stiffness.getOwnershipRange()[0] // 3
    shape = node_rows(basis.columns, first, bore.nodes, structure.comm)
    m = len(shape)
    rest = whole.displacement - (shape.reshape(3 * m, -1) @ covered).reshape(m, 3, -1)
    values, vectors = np.linalg.eigh(symmetric(whole.energy - load.T @ covered))
    values, vectors = values[::-1], vectors[:, ::-1]
    moved = (rest.reshape(3 * m, -1) @ vectors).reshape(m, 3, -1)
    sizes = np.abs(outward(bore.coordinates, moved)).max(axis=0)
    # Round-off of the covered part leaves eigenvalues of either sign at the end.
    real = values > 1e-13 * np.abs(np.diag(whole.energy)).max() * len(values)
    wanted = (sizes > truncation * sizes.max()) & real
    rank = int(np.flatnonzero(wanted)[-1]) + 1 if wanted.any() else 0
    rank = min(rank, int(np.argmin(real)) if not real.all() else len(real))
    values, vectors = values[:rank], vectors[:, :rank]
    mass = _inertia(static, basis, vectors) if with_mass else np.zeros((0, 0))
    return ResidualFlexibility(moved[:, :, :rank], vectors.T, values, mass)


def _inertia(static: StaticSolver, basis: Basis, patterns: np.ndarray) -> np.ndarray:
    """Mass matrix of the residual responses to pressure patterns (k, r), shape (r, r)."""
    structure = static.structure
    modes = basis.columns
    angular = np.sqrt(np.diag(basis.stiffness))
    # The static modes are covered like vibration modes: both are uncoupled in stiffness.
    loads = LoadSet(structure, modes[:, :0], patterns)
    return StaticResponses.of(static, loads, angular, modes).mass
