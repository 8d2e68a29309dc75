"""Where the journal is in its bore as it is, deformed and with its deviations.

The mean axes of an elastic part, to which its own eccentricity refers, may be clearances away from
its bore. The bore's centre is that of the least-squares circle of its surface (the LSCI of
roundness measurement, weisang.com/en/documents-articles/leastsquarescircle_en): for deviations u
that are small against the radius, as those of a film's bore are, the circle ``u_0 + d . n`` with
the least ``int (u - u_0 - d . n)^2 dA`` over the film. Without gaps in the surface d is the first
harmonic, ``d = 2 <u n>``. The gap ``h = c + u - n . e`` knows it: its own first harmonic is that
of the journal in the circle, ``d - e``.
"""

from __future__ import annotations

import numpy as np

from fenics_ehd.film import Film


def node_areas(film: Film) -> np.ndarray:
    """Weights of the nodes: integrals of their shape functions over the bore, shape (k,) [m^2]."""
    return np.asarray(film.pressure_areas.sum(axis=0)).ravel()


def nearest_circle(film: Film) -> np.ndarray:
    """Rows that make of a gap at the film's nodes that of the nearest circles of its surfaces.

    Returns
    -------
    numpy.ndarray
        shape (3, k): their difference in radius and the eccentricity of the journal's along x and
        y, in the frame of the bore.
    """
    angle, _ = film.parameters.grid.node_positions.T
    waves = np.stack([np.ones_like(angle), -np.cos(angle), -np.sin(angle)])
    weighted = waves * node_areas(film)
    # Areas of a quadrature: those of 8-node corners are negative, their sums are not.
    circle: np.ndarray = np.linalg.solve(weighted @ waves.T, weighted)
    return circle
