"""Stresses at the nodes of a part, from those at the points where cells know them best.

In every cell the stresses at its sampling points are continued to its nodes, by the polynomial
through these points: trilinear in hexahedra, linear in tetrahedra; what cells around a node say is
averaged (G. Dhondt, The Finite Element Method for Three-Dimensional Thermomechanical Applications,
section 2.4). All of it is linear: the tensor is averaged, and invariants are taken of that. How far
the cells around a node differ shows what the mesh does not resolve.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import sparse

from fenics_ehd.fem.stress import StressField, continuation

#: Memory of the stresses of a block of cells.
_BLOCK_BYTES = 1 << 27


class NodalStress:
    """Stresses at the nodes of a part that is whole on one rank.

    Parameters
    ----------
    field
        Of displacement columns.

    Attributes
    ----------
    nodes
        Number of nodes.
    """

    def __init__(self, field: StressField):
        self._field, self._operator = field, field.operator
        cells, size = self._operator.nodes.shape
        self.nodes = self._operator.owned
        self._continued = continuation(self._operator.cell, size)
        columns = np.arange(cells * size)
        share = sparse.csr_matrix(
            (np.ones(cells * size), (self._operator.nodes.ravel(), columns)),
            shape=(self.nodes, cells * size),
        )
        share.data /= np.repeat(np.diff(share.indptr), np.diff(share.indptr))
        self._share = share

    def blocks(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Nodes and their stresses, shape (b,) and (b, 6, columns) [Pa], until all are through."""
        size = self._operator.nodes.shape[1]
        first_cell = self._share.indices[self._share.indptr[:-1]] // size
        order = np.argsort(first_cell, kind="stable")
        # Of displacement derivatives and stresses at its points, and stresses at its nodes.
        points, columns = len(self._operator.derivatives), max(1, self._field.shape[3])
        each = 8 * columns * (15 * points + 6 * size)
        count = max(1, _BLOCK_BYTES // each) * self.nodes // max(1, len(self._operator.nodes))
        for start in range(0, self.nodes, max(1, count)):
            nodes = order[start : start + max(1, count)]
            share = self._share[nodes]
            cells, values = self._in_cells(share.indices // size)
            place = np.searchsorted(cells, share.indices // size) * size + share.indices % size
            local = sparse.csr_matrix(
                (share.data, place, share.indptr), shape=(len(nodes), values.shape[0] * size)
            )
            flat = values.reshape(values.shape[0] * size, -1)
            yield nodes, (local @ flat).reshape(len(nodes), *values.shape[2:])

    def around(self, node: int) -> np.ndarray:
        """What each cell around a node says of it, shape (cells around, 6, columns) [Pa]."""
        size = self._operator.nodes.shape[1]
        cell, place = np.divmod(self._share[node].indices, size)
        cells, values = self._in_cells(cell)
        return values[np.searchsorted(cells, cell), place]

    def _in_cells(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Some cells, ascending, and stresses at the nodes of each, (c, nodes, 6, columns)."""
        cells = np.unique(cells)
        stresses = self._field.block(cells)
        count, points = stresses.shape[:2]
        flat = self._continued @ stresses.reshape(count, points, -1)
        return cells, flat.reshape(count, -1, *stresses.shape[2:])
