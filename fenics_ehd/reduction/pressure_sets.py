"""Pressure distributions that generate residual modes, (34) and (35)."""

from __future__ import annotations

import numpy as np

from fenics_ehd.reduction.structure import Bore

#: Mean pressure of the long and peak pressure of the short bearing solution, section 4.2.
LONG_BEARING_PRESSURE = 1.0
SHORT_BEARING_PRESSURE = 1.5

#: Circumferential positions on an unstructured bore, those of the paper's.
HAT_POSITIONS = 40


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
    around = _hats(angle) if bore.pressure_family == "triangle" else _columns(angle)
    parabola = 1.0 - (2.0 * z / bore.width) ** 2
    return np.hstack(
        [
            LONG_BEARING_PRESSURE * around,
            SHORT_BEARING_PRESSURE * parabola[:, None] * around,
        ]
    )


def _columns(angle: np.ndarray) -> np.ndarray:
    """One at the nodes of each circumferential position of a structured bore."""
    _, position = np.unique(np.round(angle, 6), return_inverse=True)
    return np.eye(position.max() + 1)[position]


def _hats(angle: np.ndarray) -> np.ndarray:
    """Piecewise linear hats at evenly spaced positions, for a bore without columns of nodes.

    At the nodes of a structured bore with as many positions they are `_columns`.
    """
    place = angle / (2 * np.pi) * HAT_POSITIONS
    distance = place[:, None] - np.arange(HAT_POSITIONS)
    distance -= HAT_POSITIONS * np.round(distance / HAT_POSITIONS)
    return np.maximum(1.0 - np.abs(distance), 0.0)


PRESSURE_SETS = {"pc1": unit_pressures, "pc2": bearing_shapes}
