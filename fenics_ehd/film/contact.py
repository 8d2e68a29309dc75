"""Touching asperities of one film: pressure, boundary friction and what it loses.

At the Gauss points the asperities press with ``p_c(h)``, h the nominal gap there, and rub with
``mu p_c s(U)``, ``s = U / sqrt(U^2 + U_0^2)``. Grooves and supply holes are deep and touch nothing.
"""

from __future__ import annotations

import numpy as np

from fenics_ehd.film.asperities import Touch
from fenics_ehd.film.film import Film
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.film.shear import in_supply


class FilmContact:
    """Contact in a film between rough surfaces.

    Parameters
    ----------
    film
        With `FilmParameters.surfaces`.

    Attributes
    ----------
    surfaces
        See `FilmParameters`.
    area
        That a Gauss point stands for, 0 in grooves and holes, shape (g,) [m2].
    """

    def __init__(self, film: Film):
        p = film.parameters
        assert p.surfaces is not None
        self.surfaces = p.surfaces
        self.shaft_radius = p.grid.radius - p.clearance
        supplied = in_supply(film, film.points.angle, film.points.height)
        area = p.grid.radius**2 * film.assembly.area
        self.area = np.where(supplied, 0.0, area).ravel()

    def touch(self, thickness: np.ndarray) -> Touch:
        """Contact of nominal gaps at the Gauss points, of any shape that has g values [m]."""
        found = self.surfaces.asperities.touch(thickness.ravel())
        return Touch(*(np.where(self.area > 0.0, values, 0.0) for values in found))

    def stored(self, touch: Touch) -> float:
        """Energy of the asperities [J]."""
        return float(self.area @ touch.potential)

    def rubbing(self, gap: Gap) -> tuple[np.ndarray, np.ndarray]:
        """``mu s`` and its derivative along U, shape (g,)."""
        return self.surfaces.rubbing(gap.sliding_velocity.ravel())

    def braking(self, touch: Touch, gap: Gap) -> float:
        """Torque of boundary friction against the journal's turning [N m]."""
        rubbing = touch.pressure * self.rubbing(gap)[0]
        return float(self.shaft_radius * np.sum(self.area * rubbing))

    def rubbing_power(self, touch: Touch, gap: Gap) -> float:
        """Lost by boundary friction [W]."""
        rubbing = self.area * touch.pressure * self.rubbing(gap)[0]
        return float(np.sum(rubbing * gap.sliding_velocity.ravel()))
