"""The sparsity pattern that all matrices of one film share."""

from __future__ import annotations

from copy import copy

import numpy as np
from scipy import sparse


class Pattern:
    """CSR pattern of n x n matrices, each given by its entries in the order of the pattern.

    Attributes
    ----------
    size
        n.
    indptr, indices
        The CSR arrays.
    rows
        Row number of every entry.
    diagonal
        Places of the diagonal entries, shape (n,).
    """

    def __init__(self, indptr: np.ndarray, indices: np.ndarray):
        self.indptr, self.indices = indptr, indices
        self.size = len(indptr) - 1
        self.rows = np.repeat(np.arange(self.size), np.diff(indptr))
        self.diagonal = np.flatnonzero(self.rows == indices)
        shape = (self.size, self.size)
        self._template = sparse.csr_matrix((np.zeros(len(indices)), indices, indptr), shape)

    def matrix(self, entries: np.ndarray) -> sparse.csr_matrix:
        """Matrix with these entries."""
        return with_data(self._template, entries)

    def multiply(self, entries: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Product of the matrix with these entries and a vector."""
        self._template.data = entries
        return self._template @ values


def with_data(template: sparse.spmatrix, data: np.ndarray) -> sparse.spmatrix:
    """Matrix of a pattern known to be right, which scipy's constructor would check once more."""
    matrix = copy(template)
    matrix.data = data
    return matrix


def with_arrays(
    template: sparse.spmatrix,
    data: np.ndarray,
    indices: np.ndarray,
    indptr: np.ndarray,
    shape: tuple[int, int],
) -> sparse.spmatrix:
    """Matrix of the format of another one from arrays known to be right, as `with_data`."""
    matrix = copy(template)
    matrix.data, matrix.indices, matrix.indptr = data, indices, indptr
    matrix._shape = shape
    return matrix
