"""Pressure distributions that generate residual modes, (34) and (35)."""

from __future__ import annotations

import numpy as np

from fenics_ehd.reduction.structure import Bore

#: Mean pressure of the long and peak pressure of the short bearing solution, section 4.2.
LONG_BEARING_PRESSURE = 1.0
SHORT_BEARING_PRESSURE = 1.5


def unit_pressures(bore: Bore) -> np.ndarray:
    """``P_c1 = I`` (34), shape (k, k)."""
    return np.eye(len(bore.pressure_coordinates))


def bearing_shapes(bore: Bore) -> np.ndarray:
    """``P_c2`` (35): long and short bearing shapes at every circumferential position.

    Returns
    -------
    numpy.ndarray
        shape (k, 2 m_sy): first the long (constant in z), then the short
        (parabolic in z) bearing solutions, by ascending angle.
    """
    x, y, z = bore.pressure_coordinates.T
    angle = np.mod(np.arctan2(y, x) + 1e-9, 2 * np.pi)
    _, position = np.unique(np.round(angle, 6), return_inverse=True)
    indicator = np.eye(position.max() + 1)[position]
    parabola = 1.0 - (2.0 * z / bore.width) ** 2
    return np.hstack(
        [
            LONG_BEARING_PRESSURE * indicator,
            SHORT_BEARING_PRESSURE * parabola[:, None] * indicator,
        ]
    )


PRESSURE_SETS = {"pc1": unit_pressures, "pc2": bearing_shapes}
