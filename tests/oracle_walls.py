"""Tractions of a film on the two walls it wets, added up on each where it is.

For a round bore and a shaft parallel to it: the shaft's surface lies h further in and is inclined,
which lubrication theory leaves out as c / R of the pressure. Constant viscosity.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Walls:
    """Forces (2,) [N] on shaft and bore, of shear alone too; torques about their own axes [N m]."""

    on_shaft: np.ndarray
    on_bore: np.ndarray
    shear_on_shaft: np.ndarray
    shear_on_bore: np.ndarray
    shaft_torque: float
    bore_torque: float
    dissipation: float


def walls(film, state, eccentricity, filled):
    """Walls of a film whose cavities are filled to a share at the Gauss points."""
    p, gap, angle = film.parameters, state.gap, film.points.angle
    radius, viscosity, h = p.grid.radius, p.lubricant.viscosity, gap.thickness
    patch = radius * film.assembly.area  # dphi dz
    pressure, around, along = film.assembly.at_points(state.pressure)
    couette = filled * viscosity * gap.sliding_velocity / h
    driven = 0.5 * h * around / radius
    x, y = eccentricity
    incline = x * np.sin(angle) - y * np.cos(angle)  # dh / dphi

    def total(normal, tangential):
        cosine, sine = film.points.normal
        forces = normal * cosine - tangential * sine, normal * sine + tangential * cosine
        return np.array([np.sum(patch * force) for force in forces])

    inner, lever = (radius - h) * (-couette - driven), radius - h
    on_shaft = -pressure * lever, inner - pressure * incline
    outer = radius * (couette - driven)
    force = total(*on_shaft)
    own = np.sum(patch * lever * on_shaft[1]) - (x * force[1] - y * force[0])
    lost = h**3 / (12 * viscosity) * (around**2 + along**2) / radius**2
    lost = lost + couette * gap.sliding_velocity
    return Walls(
        force,
        total(radius * pressure, outer),
        total(0.0, inner),
        total(0.0, outer),
        float(own),
        float(np.sum(patch * radius * outer)),
        float(np.sum(patch * radius * lost)),
    )
