"""Shear of the oil in a journal as forces on the coordinates and a torque on the shaft.

The velocities v_2 of the bore and v_1 of the shaft along the circumference are linear in the
rates xi' and in the speed Omega of the shaft relative to the bore, as the film takes them
(`Journal`). The tractions tau_2 and tau_1 of `fenics_ehd.film.shear` do the work on them,

    Q . xi' + T Omega = int tau_2 v_2 + tau_1 v_1 dA,

so that shear and pressure together take from the mechanism what the oil dissipates, to round-off:
with ``U = v_1 - v_2``

    int p dh/dt dA + Q . xi' + T Omega = -int h^3 / (12 eta) |grad p|^2 + theta eta U^2 / h dA.

Being a function of relative motion alone, action is reaction: -T turns the rod. T is the shaft's
friction torque of `fenics_ehd.film.forces` up to c / R. The resultant on the rod is
``-int tau_1 t dA``, where ``int tau_2 t dA`` belongs to a gap that keeps the terms with e_t: the
difference is c / R of the pressure's, as these terms are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fenics_ehd.film import Film, FilmState
from fenics_ehd.film.shear import beside_drag, film_fields, sheared_heights


@dataclass(frozen=True, eq=False)
class FilmFriction:
    """What the oil's shear does to its two bodies.

    Attributes
    ----------
    on_xi
        Generalised forces on the coordinates, shape (n,).
    torque
        On the shaft about its axis [N m], negative when it brakes a shaft that turns in the
        positive sense; its opposite turns the rod.
    sheared
        ``int theta eta U^2 / h dA`` [W]; of rough surfaces all that is lost beside the pressure
        flow.
    filled
        Share theta of the width that is sheared, at the Gauss points.
    """

    on_xi: np.ndarray
    torque: float
    sheared: float
    filled: np.ndarray


class ShearedFilm(Protocol):
    """A film and the velocities of its surfaces, as the joint has them."""

    film: Film
    mean_velocity: np.ndarray
    sliding_velocity: np.ndarray
    shear_rule: str


def film_friction(
    journal: ShearedFilm, state: FilmState, filled: np.ndarray | None = None
) -> FilmFriction:
    """Friction of a film whose gap is that of the journal; None: filled as the state says."""
    film, gap = journal.film, state.gap
    p = film.parameters
    fields = film_fields(film, state, journal.shear_rule)
    area = p.grid.radius**2 * film.assembly.area
    filled = fields.filled if filled is None else filled
    thin, deep = sheared_heights(film, gap)
    couette = area * filled * fields.viscosity * gap.sliding_velocity / thin
    driven = area * deep * fields.slope_around
    sheared = np.sum(couette * gap.sliding_velocity)
    if p.surfaces is not None:
        sheared += np.sum(area * beside_drag(film, gap, fields))
    # tau_1 + tau_2 acts on the mean velocity, (tau_1 - tau_2) / 2 on the sliding.
    on_xi = -driven.ravel() @ journal.mean_velocity - couette.ravel() @ journal.sliding_velocity
    shaft_radius = p.grid.radius - p.clearance
    return FilmFriction(
        on_xi,
        float(-shaft_radius * (couette.sum() + 0.5 * driven.sum())),
        float(sheared),
        filled,
    )
