"""Selection of residual modes from static responses, (31) and (32)."""

from __future__ import annotations

import numpy as np

from fenics_ehd.base.errors import SettingsError

#: Directions whose energy is below this fraction of the largest are linearly dependent.
RANK_TOLERANCE = 1e-11

#: Share of the largest singular value below which a combination of pressures is none.
REDUNDANT = 1e-8

#: Energy of a combination, relative to its size times the trace of ``K_cc``, that means nothing.
ROUND_OFF = 1e-14

#: A column with less than this fraction of the largest energy is round-off.
NULL_COLUMN = 1e-22


def _ascending(stiffness: np.ndarray) -> np.ndarray:
    return np.linalg.eigh(stiffness)[1]


def smallest_eigenvalue(stiffness: np.ndarray, mass: np.ndarray | None) -> np.ndarray:
    """(31), (32) to the letter: eigenvectors of ``K_cc``, smallest eigenvalues first."""
    return _ascending(stiffness)


def largest_eigenvalue(stiffness: np.ndarray, mass: np.ndarray | None) -> np.ndarray:
    """Eigenvectors of ``K_cc``, the most flexible pressure patterns first."""
    return _ascending(stiffness)[:, ::-1]


def lowest_frequency(stiffness: np.ndarray, mass: np.ndarray | None) -> np.ndarray:
    """Eigenvectors of ``(K_cc, M_cc)``, lowest frequency first, within the range of ``K_cc``."""
    basis = energy_orthonormal(stiffness)
    return basis @ np.linalg.eigh(basis.T @ mass @ basis)[1][:, ::-1]


def every_column(stiffness: np.ndarray, mass: np.ndarray | None) -> np.ndarray:
    """The columns themselves, in their own order."""
    return np.eye(len(stiffness))


#: Selections by what they make of the reduced matrices ``K_cc``, ``M_cc`` of all candidates.
RANKINGS = {
    "smallest-eigenvalue": smallest_eigenvalue,
    "largest-eigenvalue": largest_eigenvalue,
    "lowest-frequency": lowest_frequency,
    "every-column": every_column,
}

SELECTIONS = tuple(RANKINGS)


def check_selection(name: str) -> None:
    """Raise unless there is a selection of this name.

    Raises
    ------
    SettingsError
        There is none.
    """
    if name not in SELECTIONS:
        raise SettingsError(f"selection {name!r} is not one of {', '.join(SELECTIONS)}")


def without_redundancy(patterns: np.ndarray) -> np.ndarray:
    """As few patterns as the given ones have rank, with the same ``P P^T``.

    Selections by energy or frequency find the same modes in them, after fewer solves.

    Parameters
    ----------
    patterns
        shape (k, p) [Pa].

    Returns
    -------
    numpy.ndarray
        shape (k, rank); the given patterns if they are independent.
    """
    left, sizes, _ = np.linalg.svd(patterns, full_matrices=False)
    kept = sizes > REDUNDANT * sizes.max(initial=0.0)
    if kept.sum() == patterns.shape[1]:
        return patterns
    return left[:, kept] * sizes[kept]


def without_round_off(combinations: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Combinations of candidates but those whose energy is the round-off of ``K_cc``.

    Pressures of a richer element than the displacement's have combinations that push no node.
    """
    energy = np.einsum("ij,ij->j", combinations, stiffness @ combinations)
    size = np.sum(combinations**2, axis=0) * np.trace(stiffness)
    return combinations[:, energy > ROUND_OFF * size]


def energy_orthonormal(stiffness: np.ndarray) -> np.ndarray:
    """Combinations ``Z`` with ``Z^T K Z = I``, dependent directions dropped.

    Columns are scaled to unit energy first, so that the rank does not depend on
    how the load columns were scaled.

    Parameters
    ----------
    stiffness
        ``G^T K G``, symmetric positive semidefinite, shape (n, n).

    Returns
    -------
    numpy.ndarray
        shape (n, rank).
    """
    diagonal = np.diag(stiffness)
    alive = diagonal > NULL_COLUMN * diagonal.max(initial=0.0)
    scale = np.where(alive, 1.0 / np.sqrt(np.where(alive, diagonal, 1.0)), 0.0)
    values, vectors = np.linalg.eigh(scale[:, None] * stiffness * scale)
    kept = values > RANK_TOLERANCE * values.max(initial=0.0)
    return scale[:, None] * vectors[:, kept] / np.sqrt(values[kept])
