"""First guess of a film without history, from the same film on coarser meshes.

From nothing, SNES-VI moves the edge of the cavitated zone by about one row of
nodes an iteration, so that iterations grow with the mesh. Solving first with
half as many cells, and there first with a quarter, leaves a few iterations on
every mesh.
"""

from __future__ import annotations

import numpy as np

from fenics_ehd.film.grid import FilmGrid
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.film.reynolds import gauss_points


class CoarseTransfer:
    """Between a film mesh and its next coarser one.

    Parameters
    ----------
    fine, coarse
        A grid and its `FilmGrid.coarser`.
    reference
        Gauss points of a cell, shape (q, 2).
    """

    def __init__(self, fine: FilmGrid, coarse: FilmGrid, reference: np.ndarray):
        self._prolongation = coarse.interpolation(*fine.node_positions.T)
        here, there = (gauss_points(grid, reference) for grid in (fine, coarse))
        self._shape = there.angle.shape
        # The fine mesh's Gauss points as the nodes of a bilinear mesh, around first.
        angles, i = np.unique(here.angle.round(12), return_inverse=True)
        heights, j = np.unique((here.height / fine.radius).round(12), return_inverse=True)
        turn = np.append(angles, angles[0] + 2 * np.pi)
        points = FilmGrid(fine.radius, turn, fine.radius * heights, "bilinear")
        columns = i.ravel() * len(heights) + j.ravel()
        restriction = points.interpolation(there.angle.ravel(), there.height.ravel())
        self._restriction = restriction[:, columns]

    def restrict(self, gap: Gap) -> Gap:
        """Gap at the coarse mesh's Gauss points."""

        def sample(values: np.ndarray) -> np.ndarray:
            return (self._restriction @ values.ravel()).reshape(self._shape)

        # Interpolation may undershoot where the gap is steep.
        thickness = np.maximum(sample(gap.thickness), gap.thickness.min())
        return Gap(
            thickness,
            sample(gap.thickness_rate),
            sample(gap.mean_velocity),
            sample(gap.sliding_velocity),
            gap.turn,
            gap.time,
        )

    def prolong(self, pressure: np.ndarray) -> np.ndarray:
        """Pressure at the fine mesh's nodes, not negative."""
        return np.maximum(self._prolongation @ pressure, 0.0)
