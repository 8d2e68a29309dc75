"""M3: load-dependent dual basis, (26)-(35); with every pressure kept, the full interface.

Its static modes come in diagonal form: orthonormal in mass, uncoupled in stiffness.
"""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256
from typing import Unpack

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.reduction.body import ModeRecord, ReducedBody
from fenics_ehd.reduction.distributed import combine, inner
from fenics_ehd.reduction.loads import LoadSet, StaticResponses
from fenics_ehd.reduction.pressure_sets import pressure_patterns
from fenics_ehd.reduction.projection import (
    Basis,
    gram_matrices,
    require_small,
)
from fenics_ehd.reduction.reductor import Options, Reductor
from fenics_ehd.reduction.residual_modes import (
    RANKINGS,
    check_selection,
    energy_orthonormal,
    without_redundancy,
    without_round_off,
)
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.reduction.structure import Structure


def load_dependent(
    part: Structure | Reductor,
    n_vibration: int,
    n_residual: int,
    pressure_set: str | np.ndarray = "pc2",
    selection: str = "lowest-frequency",
    *,
    estimate_error: bool = True,
    keep_basis: bool = False,
    **options: Unpack[Options],
) -> ReducedBody:
    """M3: reduce a part with vibration, attachment and load-dependent residual modes.

    Parameters
    ----------
    part
        The part, free or clamped, or a `Reductor` that shares what has been computed of it.
    n_vibration
        Vibration modes ``n_v`` (27).
    n_residual
        Residual modes ``n_r`` kept of the pressure set (32).
    pressure_set
        Name of one of `PRESSURE_SETS`, or columns of nodal pressures, shape (k, p) [Pa]: patterns
        trained on snapshots, for instance, see `proper_orthogonal`.
    selection
        Which residual modes: one of `SELECTIONS`.
    estimate_error
        Also compute the bore flexibility that the basis misses, one static
        solve per pressure node.
    keep_basis
        Leave the part-size basis in the body.
    options
        Of a `Reductor`: `attachment_directions`, `solver`, `options_prefix`.

    Returns
    -------
    ReducedBody
        Frame at the mean axis; vibration coordinates first, then the static
        ones by frequency.

    Raises
    ------
    SettingsError
        An unknown set or selection, more residual modes than the set has columns,
        or no mode at all.
    SolverError, VerificationError
        From the solvers and the checks of the result.
    """
    reductor = Reductor.of(part, **options)
    check_selection(selection)
    patterns = pressure_patterns(reductor.structure, pressure_set)
    _check_counts(n_vibration, n_residual, patterns.shape[1])
    if selection != "every-column":
        patterns = without_redundancy(patterns)
    basis = _basis(reductor, n_vibration, n_residual, patterns, selection)
    return reductor.project(basis, "m3", estimate_error=estimate_error, keep_basis=keep_basis)


def full_interface(
    part: Structure | Reductor,
    n_vibration: int = 20,
    *,
    keep_basis: bool = False,
    **options: Unpack[Options],
) -> ReducedBody:
    """Keep the response to every nodal pressure: the reference.

    `load_dependent` with all columns of ``P_c1`` (34). It misses no flexibility, so its
    error estimate is zero; parameters as there.
    """
    reductor = Reductor.of(part, **options)
    patterns = pressure_patterns(reductor.structure, "pc1")
    basis = _basis(reductor, n_vibration, patterns.shape[1], patterns, "every-column")
    return reductor.project(basis, "full", keep_basis=keep_basis)


def _check_counts(n_vibration: int, n_residual: int, available: int) -> None:
    if not 0 <= n_residual <= available:
        raise SettingsError(
            f"residual_modes {n_residual} is not between 0 and {available}, "
            "the size of the pressure set"
        )
    if n_vibration < 0:
        raise SettingsError(f"vibration_modes {n_vibration} is below 0")
    if n_vibration + n_residual == 0:
        raise SettingsError("vibration_modes and residual_modes are both 0: a rigid part has none")


def _basis(
    reductor: Reductor, n_vibration: int, n_residual: int, patterns: np.ndarray, selection: str
) -> Basis:
    """T of (26) without the rigid-body modes."""

    def respond() -> tuple[np.ndarray, np.ndarray, StaticResponses]:
        angular, modes = reductor.vibration(n_vibration)
        loads = LoadSet(reductor.structure, reductor.points, patterns)
        return angular, modes, StaticResponses(reductor.static, loads, angular, modes)

    # Of one rank, or some might have to solve while the others have not.
    digest = reductor.structure.comm.bcast(sha256(patterns.tobytes()).digest())
    angular, modes, responses = reductor.once("responses", (n_vibration, digest), respond)
    count, a = responses.loads.count, reductor.points.shape[1]
    candidates = slice(a, None)
    stiffness = responses.stiffness[candidates, candidates]
    by_frequency = selection == "lowest-frequency"
    mass = responses.mass[candidates, candidates] if by_frequency else None
    ranked = RANKINGS[selection](stiffness, mass)
    chosen = without_round_off(ranked[:, :n_residual], stiffness)
    weights = np.zeros((count, a + chosen.shape[1]))
    weights[:a, :a] = np.eye(a)
    weights[a:, a:] = chosen
    found = static_modes(responses, weights)
    accuracy = {
        "static_candidates": float(count),
        "static_requested": float(a + n_residual),
        "static_rank": float(len(found.angular)),
        "static_dropped": float(a + n_residual - len(found.angular)),
        "static_exactness": _exactness(responses, weights, found),
    }
    dropped = dropped_patterns(responses, candidates, mass, ranked, n_residual)
    return dual_basis(reductor.static, angular, modes, found, dropped, accuracy)


def _exactness(responses: StaticResponses, weights: np.ndarray, found: StaticModes) -> float:
    """Largest part of the kept static responses' energy that the static modes lack, relative."""
    exact = weights.T @ responses.stiffness @ weights
    work = responses.loads.work(found.columns).T @ weights
    missing = np.diag(exact) - np.sum((work / found.angular[:, None]) ** 2, axis=0)
    return float(np.abs(missing).max(initial=0.0) / max(np.diag(exact).max(initial=0.0), 1e-300))


def dual_basis(
    static: StaticSolver,
    angular: np.ndarray,
    modes: np.ndarray,
    found: StaticModes,
    dropped: tuple,
    accuracy: dict[str, float],
) -> Basis:
    """Vibration and static modes together, checked against their diagonal form.

    Raises
    ------
    VerificationError
        The reduced matrices are not diagonal, or a column moves the mean axis.
    """
    structure = static.structure
    columns = np.asfortranarray(np.hstack([modes, found.columns]))
    frequencies = np.concatenate([angular, found.angular])
    stiffness, mass = gram_matrices(structure, static.mass, columns)
    identity = np.eye(len(mass))
    scaled = stiffness / np.outer(frequencies, frequencies)
    moved = inner(static.mass.multiply(static.rigid_modes), columns, structure.comm)
    defects = require_small(
        {
            "mass_defect": np.abs(mass - identity).max(initial=0.0),
            "stiffness_defect": np.abs(scaled - identity).max(initial=0.0),
            "rigid_motion": np.abs(moved).max(initial=0.0),
            "static_exactness": accuracy.get("static_exactness", 0.0),
        }
    )
    kinds = ("vibration",) * modes.shape[1] + ("static",) * len(found.angular)
    return Basis(columns, np.diag(frequencies**2), identity, kinds, dropped, accuracy | defects)


# Static modes


@dataclass(frozen=True, eq=False)
class StaticModes:
    """Combinations of static responses, mass-normalised, by ascending frequency.

    Attributes
    ----------
    columns
        Owned rows, shape (owned dofs, r).
    angular
        Natural angular frequency of each alone [rad/s], shape (r,).
    dependent
        How many directions were dropped as linearly dependent.
    """

    columns: np.ndarray
    angular: np.ndarray
    dependent: int


def static_modes(responses: StaticResponses, weights: np.ndarray) -> StaticModes:
    """Diagonalise ``X @ weights``, nearly dependent directions dropped.

    Parameters
    ----------
    responses
        X with its reduced stiffness.
    weights
        Combinations wanted, shape (count, r).
    """
    stiffness = weights.T @ responses.stiffness @ weights
    independent = energy_orthonormal(stiffness)
    columns = responses.combination(weights @ independent)
    # Twice: the first pass orthonormalises in products of solved columns, whose round-off
    # is as large as the smallest direction kept; the second in the columns themselves.
    for _ in range(2):
        columns, angular = _diagonalise(responses, columns)
    return StaticModes(columns, angular, weights.shape[1] - columns.shape[1])


def _diagonalise(responses: StaticResponses, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    solver = responses.solver
    stiffness, mass = gram_matrices(solver.structure, solver.mass, columns)
    rotation = energy_orthonormal(stiffness)
    values, vectors = np.linalg.eigh(rotation.T @ mass @ rotation)
    # Ascending frequency is descending modal mass per unit strain energy.
    values, vectors = values[::-1], vectors[:, ::-1]
    return combine(columns, rotation @ vectors / np.sqrt(values)), 1.0 / np.sqrt(values)


def dropped_patterns(
    responses: StaticResponses,
    candidates: slice,
    mass: np.ndarray | None,
    combinations: np.ndarray,
    kept: int,
) -> tuple[ModeRecord, ...]:
    """Inventory lines of the selected-against combinations of the candidates.

    Parameters
    ----------
    responses
        All static responses.
    candidates
        Where the pressure patterns are among them.
    mass
        Of these; None when unknown.
    combinations
        Every combination that the selection ranked, best first, shape (candidates, c).
    kept
        How many of them were kept.
    """
    left = combinations[:, kept:]
    energy = np.einsum("ij,ij->j", left, responses.stiffness[candidates, candidates] @ left)
    inertia = np.zeros(len(energy)) if mass is None else np.einsum("ij,ij->j", left, mass @ left)
    work = np.sum((responses.nodal_work[:, candidates] @ left) ** 2, axis=0)
    records = []
    for e, i, w in zip(energy, inertia, work, strict=True):
        if not e > 0:
            records.append(ModeRecord("static", np.inf, 0.0, "depends on the others"))
            continue
        frequency = np.sqrt(e / i) / (2 * np.pi) if i > 0 else np.inf
        records.append(ModeRecord("static", float(frequency), float(w / e), "not selected"))
    return tuple(records)
