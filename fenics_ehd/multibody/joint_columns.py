"""What a history has of a lubricated joint at an accepted step, whatever its models."""

from __future__ import annotations

import numpy as np

from fenics_ehd.film import FilmState
from fenics_ehd.multibody.solver_state import MechanismStep
from fenics_ehd.multibody.system import FilmPlace


def joint_columns(
    place: FilmPlace, step: MechanismStep, film: FilmState, gap: np.ndarray
) -> dict[str, float]:
    """Columns by name with their unit; `gap` is the film's where it is observed [m]."""
    peak = int(np.argmax(film.pressure))
    angle, _ = place.film.film.parameters.grid.node_positions[peak]
    force = step.solution.motion.multipliers[place.rows]
    return {
        "max_pressure_Pa": float(film.pressure[peak]),
        "min_film_thickness_m": float(gap.min()),
        "max_pressure_angle_deg": np.degrees(np.mod(angle + np.pi, 2 * np.pi) - np.pi),
        "eccentricity_x_m": step.x[place.xi[0]],
        "eccentricity_y_m": step.x[place.xi[1]],
        "force_x_N": force[0],
        "force_y_N": force[1],
    }
