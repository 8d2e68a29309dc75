"""Derivatives of one step's equations along the angle of a journal that is not round."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fenics_ehd.film.kinematics import GapDerivatives
from fenics_ehd.multibody.border import FilmBorder
from fenics_ehd.multibody.film_columns import FilmColumns, FilmPoint
from fenics_ehd.multibody.joint_shape import Turned
from fenics_ehd.multibody.system import FilmPlace


def turned_border(
    columns: FilmColumns,
    point: FilmPoint,
    turned: Turned,
    border: FilmBorder,
    scale: float,
    speed: np.ndarray,
) -> FilmBorder:
    """A film's border with the angle of its journal: two inputs more, and the pressure's torque.

    Parameters
    ----------
    columns, point, turned, scale
        The film at a point, and what its equations are divided by.
    border
        Of a round joint.
    speed
        Derivative of all rates along all unknowns x but the patterns.
    """
    place = columns.place
    film, size = place.film.film, border.spread.shape[1]
    still = np.zeros_like(turned.slope)
    # Along the angle ahead, and along its rate.
    changes = GapDerivatives(
        np.stack([turned.slope, still], axis=-1),
        np.stack([turned.rate_slope, turned.slope], axis=-1),
        np.stack([still, still], axis=-1),
    )
    if columns.oil is None:
        inputs = film.equation.change(point.gap, point.nodal, changes, point.density_rate)
        inputs = inputs / scale
    else:
        assert point.oil is not None
        inputs = columns.oil.change(point.nodal, point.oil, changes)
    spread = np.zeros((2, size))
    outputs, rows = [], []
    unit = film.parameters.pressure_scale * columns.of_pressures(turned.torque)
    for angle, sign in place.turning:
        spread[0, angle] += sign
        spread[1, : speed.shape[1]] += sign * speed[angle]
        outputs.append(-sign * unit)
        rows.append(angle)
    return replace(
        border,
        inputs=np.hstack([border.inputs, inputs]),
        spread=np.vstack([border.spread, spread]),
        outputs=np.vstack([border.outputs, *outputs]),
        rows=np.concatenate([border.rows, np.array(rows, dtype=int)]),
        slope=turned.slope,
    )


def twist(place: FilmPlace, point: FilmPoint, turned: Turned, core: np.ndarray) -> None:
    """Add to the core how the torque of the pressures changes with the angle."""
    stiffness = place.film.film.parameters.pressure_scale * float(turned.stiffness @ point.nodal)
    for row, sign in place.turning:
        for column, other in place.turning:
            core[row, column] -= sign * other * stiffness
