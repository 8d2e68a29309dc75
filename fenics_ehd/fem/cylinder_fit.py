"""The circle and the cylinder through scattered points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares


@dataclass(frozen=True, eq=False)
class Cylinder:
    """A cylinder of finite width.

    Attributes
    ----------
    centre
        Half way along the axis, shape (3,) [m].
    axis
        Unit vector whose largest component is positive, shape (3,).
    radius, width
        [m].
    deviation
        Largest distance of a point that it was laid through [m].
    """

    centre: np.ndarray
    axis: np.ndarray
    radius: float
    width: float
    deviation: float

    def split(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Height from the centre, shape (n,), and vector from the axis, (n, 3) [m]."""
        x = points - self.centre
        height = x @ self.axis
        return height, x - np.outer(height, self.axis)

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Distance of points from its surface, shape (n,) [m]."""
        height, across = self.split(points)
        beyond = np.maximum(np.abs(height) - 0.5 * self.width, 0.0)
        return np.hypot(np.linalg.norm(across, axis=1) - self.radius, beyond)


def fit_circle(plane: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre (2,) and radius of the circle through points, shape (n, 2), by least squares."""
    # Of a circle, x^2 + y^2 is linear in x and y.
    rows = np.column_stack([2 * plane, np.ones(len(plane))])
    found = np.linalg.lstsq(rows, np.sum(plane**2, axis=1), rcond=None)[0]
    return found[:2], float(np.sqrt(max(found[2] + found[:2] @ found[:2], 0.0)))


def cylinder_centre(x: np.ndarray) -> np.ndarray:
    """Centre of the cylinder along z that nodes lie on, shape (m, 3) to (3,) [m]."""
    middle = x.mean(axis=0)
    middle[:2] += fit_circle(x[:, :2] - x[:, :2].mean(axis=0))[0]
    middle[2] = 0.5 * (x[:, 2].min() + x[:, 2].max())
    return middle


def fit_cylinder(points: np.ndarray, normals: np.ndarray) -> Cylinder:
    """Cylinder through points by least squares, begun from the normals of the surface.

    Parameters
    ----------
    points
        On the surface, shape (n, 3) [m].
    normals
        Of facets there, in any number, shape (k, 3).
    """
    axis = np.linalg.svd(normals, full_matrices=False)[2][-1]
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
    across = np.linalg.svd(axis[None, :])[2][1:]
    middle = points.mean(axis=0)
    size = np.linalg.norm(points - middle, axis=1).max()
    x = (points - middle) / size
    plane = x @ across.T
    found, reach = fit_circle(plane)

    def line(unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        tilted = axis + unknowns[2:4] @ across
        return unknowns[:2] @ across, tilted / np.linalg.norm(tilted)

    def off(unknowns: np.ndarray) -> np.ndarray:
        start, direction = line(unknowns)
        offset = x - start
        offset = offset - np.outer(offset @ direction, direction)
        return np.linalg.norm(offset, axis=1) - unknowns[4]

    best = least_squares(off, [*found, 0.0, 0.0, reach], xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    start, direction = line(best)
    height = (x - start) @ direction
    centre = middle + size * (start + 0.5 * (height.min() + height.max()) * direction)
    deviation = size * np.abs(off(best)).max()
    return Cylinder(
        centre, direction, float(size * best[4]), float(size * np.ptp(height)), float(deviation)
    )
