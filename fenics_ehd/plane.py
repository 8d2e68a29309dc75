"""Vectors of the plane of motion."""

from __future__ import annotations

import math

import numpy as np


def rotation(angle: float) -> np.ndarray:
    """Matrix that turns a vector by an angle [rad], shape (2, 2).

    It also takes components in a frame turned by that angle to the frame at rest.
    """
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[cosine, -sine], [sine, cosine]])
