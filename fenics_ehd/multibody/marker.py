"""A point of a body with its angle, as a function of the body's coordinates.

Joints, drives and forces know bodies by their markers alone: ``u = (x, y, angle)`` in the
frame at rest and, where a body offers it, the tilt ``(psi_x, psi_y)`` of its axis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

#: Places of position, angle and tilt in a marker's values.
POSITION, ANGLE, TILT = slice(0, 2), 2, slice(3, 5)


@dataclass(frozen=True, eq=False)
class Marker:
    """One marker at one instant, k values of n coordinates.

    Attributes
    ----------
    values
        ``u``, shape (k,) [m], [rad].
    jacobian
        ``du/dz``, shape (k, n).
    bend
        For f of shape (k,), the derivative of ``jacobian^T f``, shape (n, n); None: zero.
    carry
        For rates of shape (n,), the derivative of ``jacobian @ rates``, shape (k, n); None: zero.
    """

    values: np.ndarray
    jacobian: np.ndarray
    bend: Callable[[np.ndarray], np.ndarray] | None = None
    carry: Callable[[np.ndarray], np.ndarray] | None = None
