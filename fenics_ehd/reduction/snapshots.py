"""Pressure patterns trained on snapshots: what a former run recorded, in a few columns."""

from __future__ import annotations

import numpy as np

from fenics_ehd.reduction.residual_modes import RANK_TOLERANCE

#: Relative difference of singular values below which round-off chooses their vectors.
EQUAL = 1e-6


def proper_orthogonal(snapshots: np.ndarray, count: int) -> np.ndarray:
    """Proper orthogonal decomposition of recorded pressures, largest share first.

    Equal singular values belong to a space, and its basis is round-off of the linear algebra
    library: what `count` would cut is kept whole, so there may be more patterns than asked for.

    The columns are nodal pressures of equal weight; the
    directions of least squares error keep what the pressures were and
    know nothing of the part. (Largest eigenvalues of ``K_cc`` are the same
    decomposition in the norm of the strain energy, after solving for every column.)

    Parameters
    ----------
    snapshots
        Nodal pressures, shape (k, p) [Pa].
    count
        Patterns wanted.

    Returns
    -------
    numpy.ndarray
        Orthonormal patterns, shape (k, r): `count` or more, or fewer if the rank is.
    """
    left, sizes, _ = np.linalg.svd(snapshots, full_matrices=False)
    rank = int(np.sum(sizes > RANK_TOLERANCE * sizes.max(initial=0.0)))
    while 0 < count < rank and sizes[count] > (1.0 - EQUAL) * sizes[count - 1]:
        count += 1
    return left[:, : min(count, rank)]
