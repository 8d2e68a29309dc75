"""M3: reduction with a load-dependent dual basis, (26)-(35), and its reference, the full interface.

The static modes are mass-orthonormal and uncoupled in stiffness.

Residual modes are selected by (31) and (32) from the responses to a set of pressure distributions.
The set is (34), (35) or any other set, for instance one computed from the pressures of a former
run. The full interface uses all responses to the set (34), a unit pressure at every node.

Imports inside functions: scipy.linalg is needed only for pressure sets given by name.
"""

from __future__ import annotations

from dataclasses import replace
from hashlib import sha256

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.reduction.body import ModeRecord, ReducedBody
from fenics_ehd.reduction.bore import Bore
from fenics_ehd.reduction.matrices import combine, falling_eigenpairs, inner
from fenics_ehd.reduction.reductor import (
    Basis,
    Reductor,
    StaticResponses,
    gram_matrices,
    require_small,
)
from fenics_ehd.reduction.structure import Structure

#: Strain energy, relative to the largest, below which directions count as linearly dependent.
RANK_TOLERANCE = 1e-11

#: Singular value, relative to the largest, below which a combination of pressures is redundant.
REDUNDANT = 1e-8

#: Strain energy of a combination of candidates, relative to its squared norm times the trace of
#: ``K_cc``, up to which the energy counts as round-off.
ROUND_OFF = 1e-14

#: Strain energy of a column, relative to the largest, up to which it counts as round-off.
NULL_COLUMN = 1e-22


#: Ways to select residual modes.
SELECTIONS = ("smallest-eigenvalue", "largest-eigenvalue", "lowest-frequency", "every-column")


def ranked(selection: str, stiffness: np.ndarray, mass: np.ndarray | None) -> np.ndarray:
    """Combinations of candidate responses, as columns, in the order in which modes are selected.

    ``"smallest-eigenvalue"`` follows (31), (32) literally. ``"largest-eigenvalue"`` puts the most
    flexible pressure patterns first. Both depend on ``K_cc`` only. ``"lowest-frequency"`` sorts by
    the frequencies of ``K_cc`` and ``M_cc``, within the range of ``K_cc``. ``"every-column"``
    returns the candidates themselves, in their order.

    Parameters
    ----------
    selection
        One of `SELECTIONS`.
    stiffness, mass
        Reduced matrices ``K_cc`` and ``M_cc`` of the candidates, shape (c, c); the mass matrix is
        only needed for ``"lowest-frequency"``.
    """
    if selection == "every-column":
        return np.eye(len(stiffness))
    if selection == "lowest-frequency":
        assert mass is not None
        return lowest_first(stiffness, mass)[1]
    if selection == "largest-eigenvalue":
        return falling_eigenpairs(stiffness)[1]
    return np.linalg.eigh(stiffness)[1]


def without_redundancy(patterns: np.ndarray) -> np.ndarray:
    """Replace pressure patterns P by linearly independent ones with the same ``P P^T``.

    Fewer static solves are then needed. Selections by energy or frequency give the same modes.

    Parameters
    ----------
    patterns
        Pressure patterns, shape (k, p) [Pa].

    Returns
    -------
    numpy.ndarray
        Patterns, shape (k, rank); `patterns` itself if its columns are independent.
    """
    vectors, sizes, _ = np.linalg.svd(patterns, full_matrices=False)
    kept = sizes > REDUNDANT * sizes.max(initial=0.0)
    if kept.sum() == patterns.shape[1]:
        return patterns
    return vectors[:, kept] * sizes[kept]


def without_round_off(combinations: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Remove combinations of candidates whose strain energy is only round-off of ``K_cc``.

    If the pressure element is of higher order than the displacement element, some combinations of
    pressures cause no nodal forces.
    """
    energy = np.einsum("ij,ij->j", combinations, stiffness @ combinations)
    size = np.sum(combinations**2, axis=0) * np.trace(stiffness)
    return combinations[:, energy > ROUND_OFF * size]


def lowest_first(stiffness: np.ndarray, mass: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvectors of unit strain energy in the range of K, lowest frequency first.

    Returns
    -------
    tuple of numpy.ndarray
        Modal masses, descending, and eigenvectors as columns.
    """
    basis = energy_orthonormal(stiffness)
    values, vectors = falling_eigenpairs(basis.T @ mass @ basis)
    return values, basis @ vectors


def energy_orthonormal(stiffness: np.ndarray) -> np.ndarray:
    """Combinations Z of columns with ``Z^T K Z = I``; linearly dependent directions are dropped.

    Columns are first scaled to unit strain energy, so that the rank does not depend on the scaling
    of the load columns.

    Parameters
    ----------
    stiffness
        Reduced stiffness ``G^T K G`` of the columns, positive semidefinite, shape (n, n).

    Returns
    -------
    numpy.ndarray
        Combinations, shape (n, rank).
    """
    diagonal = np.diag(stiffness)
    alive = diagonal > NULL_COLUMN * diagonal.max(initial=0.0)
    scale = np.where(alive, 1.0 / np.sqrt(np.where(alive, diagonal, 1.0)), 0.0)
    values, vectors = np.linalg.eigh(scale[:, None] * stiffness * scale)
    kept = values > RANK_TOLERANCE * values.max(initial=0.0)
    return scale[:, None] * vectors[:, kept] / np.sqrt(values[kept])


#: Mean pressure of a long-bearing pattern, section 4.2 of the paper.
LONG_BEARING_PRESSURE = 1.0

#: Peak pressure of a short-bearing pattern, section 4.2 of the paper; its mean along z is 1.
SHORT_BEARING_PRESSURE = 1.5

#: Largest deviation of a node's angle from that of its circumferential position [rad].
ANGLE_TOLERANCE = 1e-5

#: Relative eccentricities of the pressures in `journal_shapes`.
JOURNAL_ECCENTRICITIES = (0.5, 0.8, 0.9, 0.95)

#: Exponents of the axial parabola in `journal_shapes`.
AXIAL_POWERS = (0.5, 1.0)

#: Number of circumferential positions on an unstructured bore, the same as in the paper.
HAT_POSITIONS = 40


def unit_pressures(bore: Bore) -> np.ndarray:
    """Patterns ``P_c1 = I`` of (34): unit pressure at one node each, shape (k, k)."""
    return np.eye(len(bore.pressure_coordinates))


def long_bearing_shapes(bore: Bore) -> np.ndarray:
    """Long-bearing patterns of (35), shape (k, m_sy): one per circumferential position.

    Each pattern is constant in z.
    """
    return LONG_BEARING_PRESSURE * _circumferential_patterns(bore)


def short_bearing_shapes(bore: Bore) -> np.ndarray:
    """Short-bearing patterns of (35), shape (k, m_sy): one per circumferential position.

    Each pattern is a parabola in z, zero at the ends of the bore.
    """
    parabola = 1.0 - (2.0 * bore.pressure_coordinates[:, 2] / bore.width) ** 2
    return SHORT_BEARING_PRESSURE * parabola[:, None] * _circumferential_patterns(bore)


def bearing_shapes(bore: Bore) -> np.ndarray:
    """Patterns ``P_c2`` of (35): long and short bearing at each circumferential position.

    Returns
    -------
    numpy.ndarray
        Patterns, shape (k, 2 m_sy): first the long-bearing patterns, constant in z, then the
        short-bearing patterns, parabolic in z; both by ascending angle.
    """
    return np.hstack([long_bearing_shapes(bore), short_bearing_shapes(bore)])


def _circumferential_patterns(bore: Bore) -> np.ndarray:
    """Patterns that are each 1 at one circumferential position and 0 at the others, (k, m_sy).

    The positions are in ascending order of their angles.
    """
    x, y, _ = bore.pressure_coordinates.T
    # Round-off puts angles of the position 0 on both sides of zero.
    angle = np.mod(np.arctan2(y, x) + ANGLE_TOLERANCE, 2 * np.pi)
    return _hats(angle - ANGLE_TOLERANCE) if bore.pressure_family == "triangle" else _columns(angle)


def _columns(angle: np.ndarray) -> np.ndarray:
    """Patterns on a structured bore: 1 at the nodes of one circumferential position, else 0."""
    order = np.argsort(angle)
    steps = np.diff(angle[order], prepend=angle[order[0]]) > 2 * ANGLE_TOLERANCE
    position = np.empty(len(angle), dtype=int)
    position[order] = np.cumsum(steps)
    return np.eye(position.max() + 1)[position]


def _hats(angle: np.ndarray) -> np.ndarray:
    """Patterns on an unstructured bore: piecewise linear hat functions at evenly spaced angles.

    On a structured bore with `HAT_POSITIONS` circumferential positions, the result is that of
    `_columns`.
    """
    position = angle / (2 * np.pi) * HAT_POSITIONS
    distance = position[:, None] - np.arange(HAT_POSITIONS)
    distance -= HAT_POSITIONS * np.round(distance / HAT_POSITIONS)
    return np.maximum(1.0 - np.abs(distance), 0.0)


def journal_shapes(bore: Bore) -> np.ndarray:
    """Short-bearing pressures of an eccentric journal, for eccentricities in all directions.

    The patterns are half-Sommerfeld pressures for several eccentricities and both directions of
    rotation. Along the bore they are parabolas or flatter profiles, as they occur in a bent bore.
    The patterns are as smooth as film pressures. Fewer of their most energetic combinations are
    therefore needed than of the patterns (35).

    Returns
    -------
    numpy.ndarray
        Patterns, shape (k, 16 `HAT_POSITIONS`); their rank is much lower.
    """
    x, y, z = bore.pressure_coordinates.T
    parabola = np.maximum(1.0 - (2.0 * z / bore.width) ** 2, 0.0)
    angle = np.arctan2(y, x)
    turn = 2 * np.pi * np.arange(HAT_POSITIONS) / HAT_POSITIONS
    columns = []
    for eccentricity in JOURNAL_ECCENTRICITIES:
        for direction in (-1.0, 1.0):
            theta = direction * (angle[:, None] - turn)
            around = np.maximum(np.sin(theta), 0.0) / (1.0 + eccentricity * np.cos(theta)) ** 3
            around /= around.max()
            columns += [parabola[:, None] ** power * around for power in AXIAL_POWERS]
    return np.hstack(columns)


#: Functions that make the pressure patterns of a bore, by name of the pressure set.
PRESSURE_SETS = {
    "pc1": unit_pressures,
    "pc2": bearing_shapes,
    "pc2-long": long_bearing_shapes,
    "pc2-short": short_bearing_shapes,
    "journal": journal_shapes,
}


def pressure_patterns(structure: Structure, pressure_set: str | np.ndarray) -> np.ndarray:
    """Pressure patterns ``P_c`` of a set by its name; patterns in an array are checked.

    Returns
    -------
    numpy.ndarray
        Patterns, shape (k, p) [Pa]; patterns of a named set are zero except on one bore.

    Raises
    ------
    SettingsError
        If no set has this name, or if the given array does not consist of columns of finite
        nodal pressures of all bores.
    """
    bores = structure.every_bore()
    if isinstance(pressure_set, str):
        if pressure_set not in PRESSURE_SETS:
            known = ", ".join(PRESSURE_SETS)
            raise SettingsError(f"pressure_set {pressure_set!r} is not one of {known}")
        from scipy.linalg import block_diag

        return np.asarray(block_diag(*(PRESSURE_SETS[pressure_set](bore) for bore in bores)))
    patterns = np.asarray(pressure_set, dtype=float)
    nodes = structure.pressures
    if patterns.ndim != 2 or len(patterns) != nodes or not patterns.shape[1]:
        raise SettingsError(
            f"pressure_set has shape {patterns.shape}: it needs columns of {nodes} nodal pressures"
        )
    if not np.isfinite(patterns).all():
        raise SettingsError("pressure_set has a value that is not finite")
    return patterns


# Patterns from the pressures of a run

#: Relative difference of singular values below which their vectors are determined by round-off.
EQUAL = 1e-6


def proper_orthogonal(snapshots: np.ndarray, count: int) -> np.ndarray:
    """Proper orthogonal decomposition of recorded pressures, largest singular value first.

    The patterns minimise the least-squares error of the nodal pressures, which have equal weights;
    the patterns do not depend on the part. (A selection by the largest eigenvalues of ``K_cc`` is
    the same decomposition in the norm of strain energy, but needs a static solve per column.)

    Patterns of equal singular values span a space whose basis is determined by round-off. Such a
    space is returned completely, so that there may be more patterns than `count`.

    Parameters
    ----------
    snapshots
        Nodal pressures, shape (k, p) [Pa].
    count
        Requested number of patterns.

    Returns
    -------
    numpy.ndarray
        Orthonormal patterns, shape (k, r): at least `count`, unless the rank is smaller.
    """
    vectors, sizes, _ = np.linalg.svd(snapshots, full_matrices=False)
    rank = int(np.sum(sizes > RANK_TOLERANCE * sizes.max(initial=0.0)))
    while 0 < count < rank and sizes[count] > (1.0 - EQUAL) * sizes[count - 1]:
        count += 1
    return vectors[:, : min(count, rank)]


def load_dependent(
    part: Structure | Reductor,
    n_vibration: int,
    n_residual: int,
    pressure_set: str | np.ndarray = "pc2",
    selection: str = "lowest-frequency",
    *,
    estimate_error: bool = True,
    keep_basis: bool = False,
) -> ReducedBody:
    """M3: reduce a part with vibration, attachment and load-dependent residual modes.

    Parameters
    ----------
    part
        The part, free or clamped, or its `Reductor`. Reductions with one `Reductor` share
        results, and it has further options: `attachment_directions`, `solver`, `options_prefix`.
    n_vibration
        Number ``n_v`` of vibration modes (27).
    n_residual
        Number ``n_r`` of residual modes selected from the pressure set (32).
    pressure_set
        Name of one of `PRESSURE_SETS`, or an array of nodal pressures, shape (k, p) [Pa], one
        pattern per column, for instance from `proper_orthogonal`.
    selection
        Rule that selects residual modes, one of `SELECTIONS`.
    estimate_error
        Whether to compute the flexibility of the bores that the basis does not contain; this needs
        static solves for the pressures of the base family, see `Reductor`.
    keep_basis
        Whether to store the part-size basis in the body.

    Returns
    -------
    ReducedBody
        Body with a mean-axis frame; vibration coordinates come first, then static ones by
        frequency.

    Raises
    ------
    SettingsError
        If the set or the selection is unknown, if there are more residual modes than columns of
        the set, or if there is no mode at all.
    SolverError, VerificationError
        If a solver or a check of the result fails.
    """
    reductor = Reductor.of(part)
    if selection not in SELECTIONS:
        raise SettingsError(f"selection {selection!r} is not one of {', '.join(SELECTIONS)}")
    patterns = pressure_patterns(reductor.structure, pressure_set)
    if not 0 <= n_residual <= patterns.shape[1]:
        raise SettingsError(
            f"residual_modes {n_residual} is not between 0 and {patterns.shape[1]}, "
            "the number of patterns in the pressure set"
        )
    if n_vibration + n_residual == 0:
        raise SettingsError(
            "vibration_modes and residual_modes are both 0: a flexible part needs at least one mode"
        )
    if selection != "every-column":
        patterns = without_redundancy(patterns)
    basis = _basis(reductor, n_vibration, n_residual, patterns, selection)
    return reductor.project(basis, "m3", estimate_error=estimate_error, keep_basis=keep_basis)


def full_interface(
    part: Structure | Reductor,
    n_vibration: int = 20,
    *,
    keep_basis: bool = False,
) -> ReducedBody:
    """Reduce a part with the static response to every nodal pressure, as a reference.

    This is `load_dependent` with all columns of ``P_c1`` (34); the parameters have the same
    meaning. The basis contains the whole static flexibility of the bores, so that the error
    estimate is zero.
    """
    reductor = Reductor.of(part)
    every = reductor.structure.pressures, "pc1", "every-column"
    body = load_dependent(reductor, n_vibration, *every, keep_basis=keep_basis)
    return replace(body, method="full")


def _basis(
    reductor: Reductor, n_vibration: int, n_residual: int, patterns: np.ndarray, selection: str
) -> Basis:
    """Compute the basis T of (26), without rigid-body modes, and the inventory of dropped modes."""

    def respond() -> StaticResponses:
        """Solve for the static responses to boundary loads and pressure patterns."""
        modes = reductor.vibration(n_vibration)
        return StaticResponses(reductor.static, reductor.points, patterns, *modes)

    # All ranks use the checksum of the first rank, so that either all of them solve or none.
    digest = reductor.structure.comm.bcast(sha256(patterns.tobytes()).digest())
    responses = reductor.once("responses", (n_vibration, digest), respond)
    a = reductor.points.shape[1]
    candidates = slice(a, None)
    stiffness = responses.stiffness[candidates, candidates]
    by_frequency = selection == "lowest-frequency"
    mass = responses.mass[candidates, candidates] if by_frequency else None
    ordered = ranked(selection, stiffness, mass)
    chosen = without_round_off(ordered[:, :n_residual], stiffness)
    dropped = dropped_patterns(responses, candidates, mass, ordered, n_residual, reductor.measure)
    weights = np.zeros((responses.count, a + chosen.shape[1]))
    weights[:a, :a] = np.eye(a)
    weights[a:, a:] = chosen
    return dual_basis(responses, weights, a + n_residual, dropped)


def dual_basis(
    responses: StaticResponses,
    weights: np.ndarray,
    requested: int,
    dropped: tuple[ModeRecord, ...] = (),
) -> Basis:
    """Make a basis of the vibration modes and of combinations of static responses, and check it.

    The reduced matrices of the basis are diagonal.

    Parameters
    ----------
    responses
        Static responses, from which the share of the vibration modes is subtracted.
    weights
        Weights of the responses in each combination, shape (count, r); nearly dependent
        combinations are dropped.
    requested
        Number of static modes that were requested, for the accuracy figures.
    dropped
        Records of the modes that were not selected.

    Raises
    ------
    VerificationError
        If the reduced matrices are not diagonal, if a column moves the mean axis, or if the
        static modes do not contain the whole strain energy of the combinations.
    """
    solver = responses.solver
    angular = responses.angular
    modes = responses.modes
    exact = weights.T @ responses.stiffness @ weights
    columns = combine(responses.columns, weights @ energy_orthonormal(exact))
    # Two passes: round-off of the products in the first one is as large as the smallest direction.
    for _ in range(2):
        columns, static = _diagonalise(responses, columns)
    # Largest share of the responses' energy that the static modes do not contain.
    work = responses.work(columns).T @ weights
    missing = np.diag(exact) - np.sum((work / static[:, None]) ** 2, axis=0)
    exactness = np.abs(missing).max(initial=0.0) / max(np.diag(exact).max(initial=0.0), 1e-300)
    columns = np.asfortranarray(np.hstack([modes, columns]))
    frequencies = np.concatenate([angular, static])
    stiffness, mass = gram_matrices(solver, columns)
    identity = np.eye(len(mass))
    scaled = stiffness / np.outer(frequencies, frequencies)
    moved = inner(solver.mass.multiply(solver.rigid_modes), columns, solver.structure.comm)
    defects = require_small(
        {
            "mass_defect": np.abs(mass - identity).max(initial=0.0),
            "stiffness_defect": np.abs(scaled - identity).max(initial=0.0),
            "rigid_motion": np.abs(moved).max(initial=0.0),
            "static_exactness": exactness,
        }
    )
    accuracy = {
        "static_candidates": responses.count,
        "static_requested": requested,
        "static_rank": len(static),
        "static_dropped": requested - len(static),
    }
    kinds = ("vibration",) * modes.shape[1] + ("static",) * len(static)
    return Basis(columns, np.diag(frequencies**2), identity, kinds, dropped, accuracy | defects)


def _diagonalise(responses: StaticResponses, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Combine columns to mass-orthonormal modes; return modes and angular frequencies [rad/s]."""
    solver = responses.solver
    stiffness, mass = gram_matrices(solver, columns)
    values, combinations = lowest_first(stiffness, mass)
    return combine(columns, combinations / np.sqrt(values)), 1.0 / np.sqrt(values)


def dropped_patterns(
    responses: StaticResponses,
    candidates: slice,
    mass: np.ndarray | None,
    combinations: np.ndarray,
    kept: int,
    measure: np.ndarray,
) -> tuple[ModeRecord, ...]:
    """Inventory of the combinations of candidates that were not selected.

    Parameters
    ----------
    responses
        Static responses to boundary loads and pressure patterns.
    candidates
        Range of the columns of `responses` that belong to pressure patterns.
    mass
        Reduced mass matrix of the candidates; None if unknown: frequencies are then infinite.
    combinations
        All combinations in the order of `ranked`, shape (candidates, c).
    kept
        Number of combinations that were selected; they are the first columns of `combinations`.
    measure
        Orthonormal pressures over which flexibility is measured, shape (k, r).
    """
    rest = combinations[:, kept:]
    energy = np.einsum("ij,ij->j", rest, responses.stiffness[candidates, candidates] @ rest)
    inertia = np.zeros(len(energy)) if mass is None else np.einsum("ij,ij->j", rest, mass @ rest)
    work = np.sum((measure.T @ (responses.nodal_work[:, candidates] @ rest)) ** 2, axis=0)
    records = []
    for e, i, w in zip(energy, inertia, work, strict=True):
        if not e > 0:
            records.append(ModeRecord("static", np.inf, 0.0, "depends on the others"))
            continue
        frequency = np.sqrt(e / i) / (2 * np.pi) if i > 0 else np.inf
        records.append(ModeRecord("static", float(frequency), float(w / e), "not selected"))
    return tuple(records)
