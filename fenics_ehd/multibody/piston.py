"""The piston on its line, and the gas that pushes it towards the crank's axis.

The pin lies at ``x = C1_x + (A p_pin)_x`` on the line y = 0, so that its height over C1 is
``-C1_y``. A force F towards the crank's axis, at the origin, has the virtual work

    -F dx,   dx = C1x_phi dphi + x_xi dxi + C1_y dtheta.
"""

from __future__ import annotations

import numpy as np

from fenics_ehd.multibody.crank import AngleFunction, CrankMotion
from fenics_ehd.multibody.guide import RodAngle
from fenics_ehd.plane import rotation


def piston_velocity(
    crank: CrankMotion, angle: RodAngle, pin: np.ndarray, xi_rate: np.ndarray
) -> float:
    """Velocity of the pin along its line [m/s]."""
    along = rotation(angle.angle)[0] @ pin[:, 1:] @ xi_rate
    return float(crank.velocity[0] + along + crank.position[1] * angle.rate)


def piston_slopes(
    crank: CrankMotion, angle: RodAngle, pin: np.ndarray, xi: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """First and second derivatives of the pin's place along the coordinates, (n,) and (n, n)."""
    turn = rotation(angle.angle)[0]
    reach = turn @ (pin[:, 0] + pin[:, 1:] @ xi)
    height, turned = crank.position[1], angle.angle_slope
    slope = turn @ pin[:, 1:] + height * turned
    # d x_xi = -y_xi dtheta, and y_xi = -reach theta_xi where the pin is held on its line.
    curvature = reach * np.outer(turned, turned) + height * angle.angle_curvature
    if crank.along is not None:
        lift = crank.along.position[1] * turned
        slope[-1] += crank.along.position[0]
        curvature[-1] += lift
        curvature[:, -1] += lift
        curvature[-1, -1] += crank.along.curvature[0]
    return slope, curvature


def gas_forces(
    force: AngleFunction, crank: CrankMotion, angle: RodAngle, pin: np.ndarray, xi: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Generalised forces of the gas and their derivatives along the coordinates.

    Parameters
    ----------
    force
        F over the crank's angle, positive towards the crank's axis [N].
    crank, angle
        Motion of C1 and of the rod.
    pin
        Pin position field, see `rod_angle`.
    xi
        Coordinates, shape (n,).

    Returns
    -------
    forces, derivatives : numpy.ndarray
        shape (n,) and (n, n).
    """
    value, along_angle = force(crank.angle)
    slope, curvature = piston_slopes(crank, angle, pin, xi)
    derivatives = -value * curvature
    if crank.along is not None:
        derivatives[:, -1] -= along_angle * slope
    return -value * slope, derivatives
