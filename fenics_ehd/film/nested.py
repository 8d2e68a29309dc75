"""First guess of a film without history, from the same film on coarser meshes.

From nothing, SNES-VI moves the edge of the cavitated zone by about one row of
nodes an iteration, so that iterations grow with the mesh. Solving first with
half as many cells, and there first with a quarter, leaves a few iterations on
every mesh.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from fenics_ehd.film.forms import CellTensors
from fenics_ehd.film.grid import FilmGrid
from fenics_ehd.film.kinematics import Gap


class CoarseTransfer:
    """Between a film mesh and its next coarser one.

    Parameters
    ----------
    fine, coarse
        A grid and its `FilmGrid.coarser`.
    tensors
        Of their family.
    """

    def __init__(self, fine: FilmGrid, coarse: FilmGrid, tensors: CellTensors):
        self._prolongation = coarse.interpolation(*fine.node_positions.T)
        axes = [np.unique(np.round(tensors.points[:, d], 12)) for d in range(2)]
        ratios = [f // c for f, c in zip(fine.cells, coarse.cells, strict=True)]
        lines = [_line(points, ratio) for points, ratio in zip(axes, ratios, strict=True)]
        self._restriction = _point_map(fine, coarse, tensors, axes, lines)
        self._shape = (int(np.prod(coarse.cells)), len(tensors.points))

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
        )

    def prolong(self, pressure: np.ndarray) -> np.ndarray:
        """Pressure at the fine mesh's nodes, not negative."""
        return np.maximum(self._prolongation @ pressure, 0.0)


def _line(points: np.ndarray, ratio: int) -> list[list[tuple[int, np.ndarray]]]:
    """Per Gauss point of a coarse interval: fine intervals and Lagrange weights on their points."""
    rows = []
    for x in points:
        position = x * ratio
        child = min(int(position), ratio - 1)
        # Half way, at the border of two fine intervals, both sides count.
        children = [child - 1, child] if child and abs(position - child) < 1e-9 else [child]
        rows.append([(c, _lagrange(points, position - c) / len(children)) for c in children])
    return rows


def _lagrange(points: np.ndarray, x: float) -> np.ndarray:
    """Weights of the polynomial through `points`, evaluated at x."""
    weights = np.ones(len(points))
    for i, own in enumerate(points):
        for other in np.delete(points, i):
            weights[i] *= (x - other) / (own - other)
    return weights


def _point_map(
    fine: FilmGrid, coarse: FilmGrid, tensors: CellTensors, axes: list, lines: list
) -> sparse.csr_matrix:
    """Matrix from fine to coarse Gauss point values."""
    places = [
        [int(np.argmin(np.abs(axis - x))) for x in tensors.points[:, d]]
        for d, axis in enumerate(axes)
    ]
    number = {pair: q for q, pair in enumerate(zip(*places, strict=True))}
    i, j = np.meshgrid(*(np.arange(n) for n in coarse.cells), indexing="ij")
    i, j = i.ravel(), j.ravel()
    count = len(tensors.points)
    ratios = [f // c for f, c in zip(fine.cells, coarse.cells, strict=True)]
    rows, columns, values = [], [], []
    for q in range(count):
        for a, around in lines[0][places[0][q]]:
            for b, along in lines[1][places[1][q]]:
                cell = (ratios[0] * i + a) * fine.cells[1] + ratios[1] * j + b
                for m, weight_m in enumerate(around):
                    for n, weight_n in enumerate(along):
                        rows.append((i * coarse.cells[1] + j) * count + q)
                        columns.append(cell * count + number[m, n])
                        values.append(np.full(len(i), weight_m * weight_n))
    shape = (len(i) * count, int(np.prod(fine.cells)) * count)
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sparse.csr_matrix(entries, shape)
