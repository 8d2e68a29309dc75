"""Vectors and matrices of a film from values at its Gauss points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from fenics_ehd.film.forms import CellTensors, cell_tensors
from fenics_ehd.film.grid import FilmGrid
from fenics_ehd.film.pattern import Pattern, with_arrays, with_data


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Coefficients of the derivative ``a(u, v)`` (see `forms`) at the Gauss points, each (c, q).

    None stands for zero.
    """

    around: np.ndarray
    along: np.ndarray
    convection_around: np.ndarray | None = None
    convection_along: np.ndarray | None = None
    mass: np.ndarray | None = None


class Assembly:
    """Assembly on one grid, for the ``n`` nodes where the pressure is unknown.

    Values at Gauss points come and go as arrays (c cells, q points), element
    vectors as (c, k). The factors that the size of a cell puts on derivatives
    and areas, lengths divided by the bore radius, are applied here.

    Parameters
    ----------
    grid
        The film mesh.
    free
        Nodes whose pressure is unknown, ascending.

    Attributes
    ----------
    pattern
        Sparsity pattern of every matrix on the free nodes.
    area
        Area that each Gauss point stands for, over R^2, shape (c, q).
    """

    def __init__(self, grid: FilmGrid, free: np.ndarray):
        self.grid = grid
        self.free = free
        self.tensors: CellTensors = cell_tensors(grid.family)
        self._nodes = grid.cell_nodes
        around, along = grid.cell_sizes
        self._around, self._along = around[:, None], along[:, None]
        self._cell_area = self._around * self._along
        self._flat_nodes = self._nodes.ravel()
        # Factors of the five coefficients, in the order of `_flat`.
        self._scales = (
            self._along / self._around,
            self._around / self._along,
            self._along,
            self._around,
            self._cell_area,
        )
        self.area = self._cell_area * self.tensors.weights
        self.size = len(grid.node_positions)
        self._flat = [
            tensor.reshape(len(tensor), -1)
            for tensor in (
                self.tensors.stiffness_around,
                self.tensors.stiffness_along,
                self.tensors.convection_around,
                self.tensors.convection_along,
                self.tensors.mass,
            )
        ]
        self._number_entries()

    @cached_property
    def _gathering(self) -> sparse.csc_matrix:
        """Pattern of `gather`: every Gauss point feeds the nodes of its cell."""
        cells, k = self._nodes.shape
        points = self.area.shape[1]
        rows = np.repeat(self._nodes[:, None, :], points, axis=1).ravel().astype(np.int32)
        starts = np.arange(cells * points + 1) * k
        return sparse.csc_matrix((np.zeros(len(rows)), rows, starts), (self.size, cells * points))

    def _number_entries(self) -> None:
        """Pattern of the free-node matrix and the place of every element matrix entry in it."""
        k = self._nodes.shape[1]
        number = np.full(self.size, -1)
        number[self.free] = np.arange(len(self.free))
        rows = np.repeat(number[self._nodes], k, axis=1).ravel()
        columns = np.tile(number[self._nodes], (1, k)).ravel()
        inside = (rows >= 0) & (columns >= 0)
        code = rows[inside] * len(self.free) + columns[inside]
        unique, place = np.unique(code, return_inverse=True)
        counts = np.bincount(unique // len(self.free), minlength=len(self.free))
        self.pattern = Pattern(
            np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
            (unique % len(self.free)).astype(np.int32),
        )
        # Entries of fixed nodes go to a bin behind the last one.
        self._place = np.full(len(rows), len(unique))
        self._place[inside] = place

    def at_points(self, nodal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Value and derivatives along the circumference and the axis, from all nodal values."""
        values = nodal[self._nodes]
        t = self.tensors
        return (
            values @ t.value.T,
            values @ t.around.T / self._around,
            values @ t.along.T / self._along,
        )

    def vector(
        self,
        flux_around: np.ndarray,
        flux_along: np.ndarray | None,
        source: np.ndarray,
    ) -> np.ndarray:
        """``r`` for all nodes, shape (size,), from flux and source (c, q); None stands for zero."""
        t = self.tensors
        element = (flux_around * self._along) @ t.flux_around
        if flux_along is not None:
            element += (flux_along * self._around) @ t.flux_along
        element += (source * self._cell_area) @ t.source
        return np.bincount(self._flat_nodes, element.ravel(), self.size)

    def source(self, source: np.ndarray) -> np.ndarray:
        """``r`` of a source (c, q) alone."""
        element = (source * self._cell_area) @ self.tensors.source
        return np.bincount(self._flat_nodes, element.ravel(), self.size)

    def source_vectors(self, coefficient: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Vectors of the source term for many directions (c * q, n), coefficient (c, q)."""
        return self.gather(self.source_elements(coefficient)) @ directions

    def flux_elements(self, flux_around: np.ndarray, flux_along: np.ndarray | None) -> np.ndarray:
        """Element data (c, q, k) of the vectors of fluxes at single Gauss points."""
        t = self.tensors
        element = (flux_around * self._along)[:, :, None] * t.flux_around
        if flux_along is not None:
            element += (flux_along * self._around)[:, :, None] * t.flux_along
        return element

    def source_elements(self, coefficient: np.ndarray) -> np.ndarray:
        """As `flux_elements`, for the source term."""
        return (coefficient * self._cell_area)[:, :, None] * self.tensors.source

    def gather(self, element: np.ndarray) -> sparse.csc_matrix:
        """Sparse map (size, c * q) from element data (c, q, k)."""
        return with_data(self._gathering, element.ravel())

    def restrict(self, gathered: sparse.csc_matrix, nodes: np.ndarray) -> sparse.csc_matrix:
        """Rows of what `gather` made that belong to some nodes."""
        number = np.full(self.size, -1, dtype=np.int32)
        number[nodes] = np.arange(len(nodes), dtype=np.int32)
        rows = number[gathered.indices]
        kept = rows >= 0
        columns = gathered.shape[1]
        starts = np.zeros(columns + 1, dtype=np.int32)
        # Every Gauss point feeds the same number of nodes.
        kept.reshape(columns, -1).sum(axis=1).cumsum(out=starts[1:])
        return with_arrays(gathered, gathered.data[kept], rows[kept], starts, (len(nodes), columns))

    def matrix(self, c: Coefficients) -> np.ndarray:
        """Entries of the matrix of ``a`` on the free nodes, in the order of the pattern."""
        element = (c.around * self._scales[0]) @ self._flat[0]
        element += (c.along * self._scales[1]) @ self._flat[1]
        others = (c.convection_around, c.convection_along, c.mass)
        for values, factor, tensor in zip(others, self._scales[2:], self._flat[2:], strict=True):
            if values is not None:
                element += (values * factor) @ tensor
        return np.bincount(self._place, element.ravel(), len(self.pattern.indices) + 1)[:-1]
