"""Gauss points of a film mesh: shape functions there, and the sparsity pattern of film matrices.

Vectors and matrices that contain the oil's laws are assembled by dolfinx
(`fenics_ehd.film.weak_form`). Forces, oil contents and areas need only shape functions: they are
products of the matrices of this module.
"""

from __future__ import annotations

from copy import copy

import numpy as np
from scipy import sparse

from fenics_ehd.film.grid import FilmGrid
from fenics_ehd.reduction.elements import ELEMENTS

#: Number of Gauss points in each direction, as in the bore load matrix: this rule integrates
#: pressure force and squeeze flow exactly. 4 points change the load of a rigid
#: bearing (L/D = 1, 20 x 5 cells) by 0.03 % at eccentricity 0.9.
GAUSS_POINTS = 3


class Pattern:
    """CSR sparsity pattern of n x n matrices, each given by its entries in the pattern's order.

    Attributes
    ----------
    size
        Number n of rows and of columns.
    indptr, indices
        CSR arrays: index of the first entry of every row, and column of every entry.
    rows
        Row number of every entry.
    diagonal
        Indices of the diagonal entries, shape (n,).
    """

    def __init__(self, indptr: np.ndarray, indices: np.ndarray):
        self.indptr = indptr
        self.indices = indices
        self.size = len(indptr) - 1
        self.rows = np.repeat(np.arange(self.size), np.diff(indptr))
        self.diagonal = np.flatnonzero(self.rows == indices)
        shape = (self.size, self.size)
        self._template = sparse.csr_matrix((np.zeros(len(indices)), indices, indptr), shape)

    def matrix(self, entries: np.ndarray) -> sparse.csr_matrix:
        """Sparse matrix with this pattern and the given `entries`, shape (n, n)."""
        return with_data(self._template, entries)

    def multiply(self, entries: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Multiply the matrix that has the given `entries` by the vector `values`, shape (n,)."""
        self._template.data = entries
        return self._template @ values


def with_data(template: sparse.spmatrix, data: np.ndarray) -> sparse.spmatrix:
    """Make a matrix with the sparsity of `template` and other entries, without SciPy's checks."""
    matrix = copy(template)
    matrix.data = data
    return matrix


class Assembly:
    """Shape functions of a film mesh at its Gauss points.

    Values at Gauss points are arrays of shape (c, q): c cells with q points each. Lengths are
    divided by the bore radius R.

    Parameters
    ----------
    grid
        The film mesh.

    Attributes
    ----------
    reference
        Coordinates of the Gauss points in the unit cell, shape (q, 2).
    area
        Weight of each Gauss point in integrals over the bore: an area over R^2, shape (c, q).
    size
        Number of nodes.
    tested
        Matrix that integrates shape functions times values at the Gauss points, shape (nodes,
        c * q). As in all matrices of this shape, a column has one entry for each of the k nodes of
        its cell, with rows ascending.
    drag
        Derivative of the weak form of the Reynolds equation with respect to the dragged flow
        ``rho H V`` (density, gap, mean velocity of the surfaces) at every Gauss point: entries of a
        matrix of the shape of `tested`, shape (c, q, k).
    """

    def __init__(self, grid: FilmGrid):
        self.grid = grid
        element = ELEMENTS[grid.family]
        self.reference, weights = element.rule(GAUSS_POINTS)
        self.value, (self._around, self._along) = element.tabulate(self.reference)
        self.slopes_around = weights[:, None] * self._around
        around, along = (size[:, None] for size in grid.cell_sizes)
        self._lengths = around, along
        self.area = around * along * weights
        self.size = len(grid.node_positions)
        cells, k = grid.cell_nodes.shape
        rows = np.repeat(grid.cell_nodes[:, None, :], len(weights), axis=1).ravel()
        values = np.tile(self.value.ravel(), cells)
        starts = np.arange(self.area.size + 1) * k
        shape = (self.area.size, self.size)
        self._values = sparse.csr_matrix((values, rows.astype(np.int32), starts), shape)
        self._values.sort_indices()
        self.tested = with_weights(self._values.T, self.area[:, :, None])
        slopes = self.slopes_around[:, np.argsort(grid.cell_nodes, axis=1)].transpose(1, 0, 2)
        self.drag = -along[:, :, None] * slopes

    def at_points(self, nodal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Values of a nodal field at the Gauss points, and its derivatives around and along z.

        Each of the three arrays has the shape (c, q), for c cells with q points each. `nodal` has
        the values of the field at all nodes. Lengths in the derivatives are divided by the bore
        radius.
        """
        values = nodal[self.grid.cell_nodes]
        around, along = self._lengths
        return (
            values @ self.value.T,
            values @ self._around.T / around,
            values @ self._along.T / along,
        )

    def source(self, source: np.ndarray) -> np.ndarray:
        """Integral over the bore of a field times the shape function of every node, shape (nodes,).

        `source` has the values of the field at the Gauss points, for example the source of the
        Reynolds equation. The integrals are divided by the squared bore radius.
        """
        return self.tested @ source.ravel()

    def by_nodes(self, nodal: np.ndarray) -> np.ndarray:
        """Values of a nodal field at the k nodes of every cell, in ascending order of the nodes.

        The shape is (c, 1, k), so that products with arrays (c, q, k) repeat the values for the q
        Gauss points of a cell.
        """
        return nodal[np.sort(self.grid.cell_nodes, axis=1)][:, None, :]

    def mass(self, nodes: np.ndarray) -> sparse.csr_matrix:
        """Mass matrix of the given nodes, in units of R^2: integrals ``int N_i N_j dA``."""
        mass = (self.tested @ self._values).tocsr()[nodes][:, nodes]
        mass.sort_indices()
        return mass

    def pattern(self, nodes: np.ndarray) -> Pattern:
        """Sparsity pattern on the given nodes: an entry for every two nodes that share a cell."""
        mass = self.mass(nodes)
        return Pattern(mass.indptr, mass.indices)


def with_weights(columns: sparse.csc_matrix, weights: np.ndarray) -> sparse.csc_matrix:
    """Multiply the entries of a matrix with the pattern of `Assembly.tested` by weights; a copy.

    Weights have the shape (c, q, k), for the k nodes of c cells with q Gauss points each. Weights
    that do not depend on the Gauss point or on the node may have the length 1 in that axis.
    """
    entries = columns.data.reshape(len(weights), -1, columns.nnz // columns.shape[1])
    return with_data(columns, (entries * weights).ravel())
