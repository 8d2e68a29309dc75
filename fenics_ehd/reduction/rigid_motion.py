"""Displacement fields of rigid motion."""

from __future__ import annotations

import numpy as np


def rigid_fields(coordinates: np.ndarray) -> np.ndarray:
    """Unit translations and rotations about the origin, shape (3 nodes, 6)."""
    x, y, z = coordinates.T
    fields = np.zeros((len(coordinates), 3, 6))
    fields[:, range(3), range(3)] = 1.0
    fields[:, 1, 3], fields[:, 2, 3] = -z, y
    fields[:, 0, 4], fields[:, 2, 4] = z, -x
    fields[:, 0, 5], fields[:, 1, 5] = -y, x
    return fields.reshape(-1, 6)


def turned(columns: np.ndarray, axis: int) -> np.ndarray:
    """``e_axis x u`` node by node, for displacement fields of shape (3 nodes, k)."""
    result = np.zeros_like(columns)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    result[first::3] = -columns[second::3]
    result[second::3] = columns[first::3]
    return result
