"""Rod angle from the condition that the piston pin stays on its line.

The rod's coordinates are ``xi = (translation of the bore relative to the shaft,
elastic coordinates)``, the translation being ``-e`` in the rod's frame. A
material point of the rod lies at ``C1 + A(theta) p`` with ``p`` affine in
``xi``; positions of the rod itself are never integrated, because the error of
the large motion would appear as a false squeeze velocity.

The pin's condition ``y(C1 + A p_pin) = 0`` gives the angle ``theta`` and its
rates as functions of ``xi``, ``xi'``, ``xi''``: no constraint is left over. Where the
crank's angle is free it is the last of ``xi``; C1 then depends on it, and p does not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fenics_ehd.errors import SolverError
from fenics_ehd.multibody.crank import CrankMotion
from fenics_ehd.plane import rotation


@dataclass(frozen=True, eq=False)
class RodAngle:
    """Angle of the rod's frame with its rates and their derivatives.

    Attributes
    ----------
    angle, rate, acceleration
        theta [rad], [rad/s], [rad/s^2].
    angle_slope, rate_slope, acceleration_slope
        Derivatives along ``xi`` when ``xi'`` and ``xi''`` follow it with the
        factors of the time integration formula, shape (n,).
    curvature
        Makes `angle_curvature`.
    """

    angle: float
    rate: float
    acceleration: float
    angle_slope: np.ndarray
    rate_slope: np.ndarray
    acceleration_slope: np.ndarray
    curvature: Callable[[], np.ndarray]

    @cached_property
    def angle_curvature(self) -> np.ndarray:
        """Second derivative of theta with respect to ``xi``, shape (n, n)."""
        return self.curvature()


def rod_angle(
    crank: CrankMotion,
    pin: np.ndarray,
    xi: np.ndarray,
    xi_rate: np.ndarray,
    xi_acceleration: np.ndarray,
    shifts: tuple[float, float],
) -> RodAngle:
    """Solve the pin's condition and differentiate it.

    Parameters
    ----------
    crank
        Motion of C1.
    pin
        Pin position field: columns (position, then one per coordinate), shape (2, 1 + n) [m].
    xi, xi_rate, xi_acceleration
        Coordinates and rates, shape (n,).
    shifts
        ``d xi' / d xi`` and ``d xi'' / d xi`` of the time integration formula.

    Raises
    ------
    SolverError
        The crank pin is farther from the line than the rod is long.
    """
    arm = pin[:, 0] + pin[:, 1:] @ xi
    length = np.hypot(*arm)
    if not abs(crank.position[1]) < length:
        raise SolverError(
            f"the rod, {length:.4g} m, is not longer than the crank pin's height "
            f"{abs(crank.position[1]):.4g} m: set rod length above crank length"
        )
    theta = -np.arcsin(crank.position[1] / length) - np.arctan2(arm[1], arm[0])
    # Inertial components of the pin's columns: x_xi and y_xi are derivatives of its position.
    x_xi, y_xi = rotation(theta) @ pin[:, 1:]
    x, y = rotation(theta) @ arm
    alpha, beta = shifts

    along = crank.along
    slope = -y_xi / x
    if along is not None:
        slope[-1] -= along.position[1] / x
    x_slope = x_xi - y * slope

    x_rate, y_rate = x_xi @ xi_rate, y_xi @ xi_rate
    rate = -(crank.velocity[1] + y_rate) / x
    rate_slope = -(x_rate * slope + alpha * y_xi + rate * x_slope) / x
    if along is not None:
        rate_slope[-1] -= along.velocity[1] / x

    x_rate_slope = alpha * x_xi - y_rate * slope
    acceleration = (
        -(crank.acceleration[1] + y_xi @ xi_acceleration + 2 * rate * x_rate - rate**2 * y) / x
    )
    acceleration_slope = (
        -(
            (x_xi @ xi_acceleration) * slope
            + beta * y_xi
            + 2 * rate_slope * (x_rate - rate * y)
            + 2 * rate * x_rate_slope
            + acceleration * x_slope
        )
        / x
    )
    if along is not None:
        # The arm's height is that of C1, negative.
        acceleration_slope[-1] -= (along.acceleration[1] + rate**2 * along.position[1]) / x

    def curvature() -> np.ndarray:
        result = -(np.outer(x_xi, slope) + np.outer(slope, x_slope)) / x
        if along is not None:
            result[-1, -1] -= along.curvature[1] / x
        return result

    return RodAngle(theta, rate, acceleration, slope, rate_slope, acceleration_slope, curvature)
