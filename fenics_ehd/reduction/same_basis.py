"""The part-size basis of a reduced body that was made again."""

from __future__ import annotations

import numpy as np

from fenics_ehd.base.errors import VerificationError
from fenics_ehd.reduction.body import ReducedBody

#: Largest difference of the two bodies, relative.
AGREEMENT = 1e-6


def basis_of(body: ReducedBody, made: ReducedBody, columns: np.ndarray) -> np.ndarray:
    """The basis T of a body whose file does not hold it, from the same part reduced again.

    On another machine the signs of modes may differ, and modes of one frequency be other
    combinations of the same: the coordinates' meaning is read off the bores and points.

    Parameters
    ----------
    body
        As it was.
    made
        As it is now.
    columns
        The basis of `made`, owned rows, shape (owned dofs, n).

    Raises
    ------
    VerificationError
        They are not reductions of the same part by the same method.
    """
    old, new = _seen(body), _seen(made)
    if old.shape != new.shape:
        raise VerificationError(
            f"the part made again has {made.modes} modes and {len(made.bore_basis)} bore nodes, "
            f"its run's body {body.modes} and {len(body.bore_basis)}: was its model changed?"
        )
    size = np.abs(old).max(initial=0.0)
    if np.abs(new - old).max(initial=0.0) <= 1e-3 * AGREEMENT * size:
        return columns
    scale = np.linalg.norm(new, axis=0)
    turn = np.linalg.lstsq(new / scale, old, rcond=None)[0] / scale[:, None]
    defects = [np.abs(new @ turn - old).max() / size]
    for matrix, own in ((made.stiffness, body.stiffness), (made.mass, body.mass)):
        root = np.sqrt(np.diag(own))
        defects.append(np.abs((turn.T @ matrix @ turn - own) / np.outer(root, root)).max())
    if not max(defects) <= AGREEMENT:
        raise VerificationError(
            f"the part made again differs from its run's body by {max(defects):.1e}, above "
            f"{AGREEMENT:.0e}: was its model changed?"
        )
    return columns @ turn


def _seen(body: ReducedBody) -> np.ndarray:
    """What each coordinate does to bores and points, shape (rows, n)."""
    points = [field[:, 3:] for field in body.points.values()]
    return np.vstack([body.bore_basis.reshape(-1, body.modes), *points])
