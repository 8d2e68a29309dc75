"""Whether a film's mesh shows how its oil thickens with the pressure."""

from __future__ import annotations

import numpy as np

from fenics_ehd.base.errors import ViscosityError
from fenics_ehd.film.film import Film

#: Factor of the viscosity within a cell up to which the mesh is fine enough. Up to there peak
#: pressures of a journal under Barus' law are within 2 % of those on 64 x 12 cells from 24 x 4 on,
#: 12 % on 16 x 3; beyond it, at 17 to 220, they are the mesh's own: 105 to 144 MPa where finer ones
#: have 196 and 1670 MPa. Of one bearing they are within 0.5 % of the reduced pressure's at 8, 5 %
#: off at 28, and at 45 have 215 MPa of 500.
MOST_WITHIN_A_CELL = 10.0


def steepest_thickening(film: Film, pressure: np.ndarray) -> float:
    """Largest factor of the viscosity between nodes of one cell, for nodal pressures [Pa]."""
    law = film.equation.lubricant.viscosity_law  # at the film's own temperature
    if law.constant:
        return 1.0
    try:
        ratio = law(np.maximum(pressure, 0.0))[0][film.parameters.grid.cell_nodes]
    except ViscosityError:
        return np.inf
    return float((ratio.max(axis=1) / ratio.min(axis=1)).max())
