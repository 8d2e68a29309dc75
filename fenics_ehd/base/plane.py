"""Vectors of the plane of motion."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np


@lru_cache(maxsize=64)
def rotation(angle: float) -> np.ndarray:
    """Matrix that rotates a vector by an angle [rad], shape (2, 2), read-only.

    It also transforms components in a frame that is rotated by this angle to the frame at rest.
    """
    cosine = math.cos(angle)
    sine = math.sin(angle)
    matrix = np.array([[cosine, -sine], [sine, cosine]])
    matrix.setflags(write=False)
    return matrix
