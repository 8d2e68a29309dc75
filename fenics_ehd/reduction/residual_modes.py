"""Selection of residual modes from static responses, (31) and (32)."""

from __future__ import annotations

import numpy as np

#: Directions whose energy is below this fraction of the largest are linearly dependent.
RANK_TOLERANCE = 1e-12

#: A column with less than this fraction of the largest energy is round-off.
NULL_COLUMN = 1e-22


def _ascending(stiffness: np.ndarray) -> np.ndarray:
    return np.linalg.eigh(stiffness)[1]


def smallest_eigenvalue(stiffness: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """(31), (32) to the letter: eigenvectors of ``K_cc``, smallest eigenvalues first."""
    return _ascending(stiffness)


def largest_eigenvalue(stiffness: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Eigenvectors of ``K_cc``, the most flexible pressure patterns first."""
    return _ascending(stiffness)[:, ::-1]


def lowest_frequency(stiffness: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Eigenvectors of ``(K_cc, M_cc)``, lowest frequency first, within the range of ``K_cc``."""
    basis = energy_orthonormal(stiffness)
    return basis @ np.linalg.eigh(basis.T @ mass @ basis)[1][:, ::-1]


SELECTIONS = {
    "smallest-eigenvalue": smallest_eigenvalue,
    "largest-eigenvalue": largest_eigenvalue,
    "lowest-frequency": lowest_frequency,
}


def energy_orthonormal(stiffness: np.ndarray, tolerance: float = RANK_TOLERANCE) -> np.ndarray:
    """Combinations ``Z`` with ``Z^T K Z = I``, dependent directions dropped.

    Columns are scaled to unit energy first, so that the rank does not depend on
    how the load columns were scaled.

    Parameters
    ----------
    stiffness
        ``G^T K G``, symmetric positive semidefinite, shape (n, n).
    tolerance
        Smallest kept eigenvalue of the scaled matrix, relative to the largest.

    Returns
    -------
    numpy.ndarray
        shape (n, rank).
    """
    diagonal = np.diag(stiffness)
    alive = diagonal > NULL_COLUMN * diagonal.max(initial=0.0)
    scale = np.where(alive, 1.0 / np.sqrt(np.where(alive, diagonal, 1.0)), 0.0)
    values, vectors = np.linalg.eigh(scale[:, None] * stiffness * scale)
    kept = values > tolerance * values.max(initial=0.0)
    return scale[:, None] * vectors[:, kept] / np.sqrt(values[kept])
