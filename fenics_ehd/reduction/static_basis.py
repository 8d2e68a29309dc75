"""Static modes in diagonal form: orthonormal in mass, uncoupled in stiffness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.reduction.body import ModeRecord
from fenics_ehd.reduction.distributed import combine
from fenics_ehd.reduction.loads import StaticResponses
from fenics_ehd.reduction.projection import gram_matrices
from fenics_ehd.reduction.residual_modes import energy_orthonormal


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
