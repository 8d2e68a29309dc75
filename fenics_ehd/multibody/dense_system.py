"""Newton systems of small films: one dense matrix, factorised by LAPACK.

A partition that differs a little from the factorised one needs no other factorisation. With
nodes a that fill and nodes r that empty, defects y_r,

    [ K    B_a   E_r ] [x_I, dxi]   [f_I, g]
    [ L_a  A_aa   0  ] [  x_a   ] = [ f_a  ]
    [ E_r'  0     0  ] [  y_r   ]   [  0   ]

where K is what was factorised, for the full nodes I of then.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from fenics_ehd.errors import SolverError
from fenics_ehd.film.pattern import Pattern
from fenics_ehd.multibody.bordered import Linearisation

#: Free film nodes up to which one dense matrix is faster.
DENSE_LIMIT = 700

#: Nodes that may fill and empty, over the size of the factorised matrix.
LARGEST_BORDER = 0.25


class _Factors:
    """LU factors of a matrix in C order, taken as those of its transpose: no copy."""

    def __init__(self, matrix: np.ndarray):
        self._factors, self._pivots, failure = linalg.lapack.dgetrf(matrix.T, overwrite_a=True)
        if failure:
            raise SolverError(f"the matrix of film and mechanism is singular (row {failure})")

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        return linalg.lapack.dgetrs(self._factors, self._pivots, rhs, trans=1)[0]


@dataclass(frozen=True, eq=False)
class _Border:
    """Nodes that filled and positions of those that emptied, and what couples them to K."""

    added: np.ndarray
    emptied: np.ndarray
    rows: np.ndarray
    answers: np.ndarray
    schur: _Factors


class DenseSystem:
    """A `BorderedSystem` for films of a few hundred nodes."""

    def __init__(self, pattern: Pattern):
        self._pattern = pattern
        self._border: _Border | None = None

    def factorise(self, linearisation: Linearisation, full_film: np.ndarray) -> None:
        """See `BorderedSystem`.

        Raises
        ------
        SolverError
            The matrix is singular.
        """
        lin, m = linearisation, self._pattern.size
        rows = full_film if lin.weights is None else np.arange(m)
        k, n = len(rows), len(lin.slope)
        matrix = np.zeros((k + n, k + n))
        columns = full_film if lin.weights is not None else slice(k)
        if lin.weights is not None:
            matrix[:k, :k] = -self._block(lin.weights, rows, rows)
        matrix[:k, columns] = self._film_block(lin, rows, full_film)
        matrix[k:, columns] = -lin.coupling[:, full_film]
        matrix[:k, k:], matrix[k:, k:] = lin.along[rows], lin.slope
        self._factors, self._border = _Factors(matrix), None
        self._rows, self._full, self._linearisation = rows, full_film, lin

    def _film_block(self, lin: Linearisation, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Rows and columns of ``A + C``."""
        block = self._block(lin.entries, rows, columns)
        if lin.pattern_block is not None:
            block += lin.pattern_block(rows, columns)
        return block

    def _block(self, entries: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Rows and columns of a matrix given by its entries in the order of the pattern."""
        pattern = self._pattern
        row, column = (np.full(pattern.size, -1) for _ in range(2))
        row[rows], column[columns] = np.arange(len(rows)), np.arange(len(columns))
        places = row[pattern.rows], column[pattern.indices]
        inside = (places[0] >= 0) & (places[1] >= 0)
        block = np.zeros((len(rows), len(columns)))
        block[places[0][inside], places[1][inside]] = entries[inside]
        return block

    def repartition(self, full_film: np.ndarray) -> bool:
        """See `BorderedSystem`."""
        lin = self._linearisation
        added = np.setdiff1d(full_film, self._full, assume_unique=True)
        emptied = np.flatnonzero(~np.isin(self._full, full_film, assume_unique=True))
        k, n, a = len(self._full), len(lin.slope), len(added)
        if lin.weights is not None or a + len(emptied) > LARGEST_BORDER * (k + n):
            return False
        if not a + len(emptied):
            self._border = None
            return True
        columns = np.zeros((k + n, a + len(emptied)), order="F")
        columns[:k, :a] = self._film_block(lin, self._full, added)
        columns[k:, :a] = -lin.coupling[:, added]
        columns[emptied, a + np.arange(len(emptied))] = 1.0
        answers = self._factors.solve(columns)
        beside = self._film_block(lin, added, np.append(self._full, added))
        rows = np.hstack([beside[:, :k], lin.along[added]])
        schur = np.zeros((columns.shape[1],) * 2)
        schur[:a, :a] = beside[:, k:]
        schur[:a] -= rows @ answers
        schur[a:] -= answers[emptied]
        self._border = _Border(added, emptied, rows, answers, _Factors(schur))
        return True

    def solve(self, film: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `BorderedSystem`."""
        weights, border = self._linearisation.weights, self._border
        if weights is not None:
            film = self._pattern.multiply(weights, film)
        solution = self._factors.solve(np.concatenate([film[self._rows], rest]))
        pressures = np.zeros(self._pattern.size)
        if border is not None:
            given = np.concatenate(
                [film[border.added] - border.rows @ solution, -solution[border.emptied]]
            )
            beside = border.schur.solve(given)
            solution = solution - border.answers @ beside
            solution[border.emptied] = 0.0
            pressures[border.added] = beside[: len(border.added)]
        k = len(self._rows)
        values = solution[:k] if weights is None else solution[self._full]
        pressures[self._full] = values
        return pressures, solution[k:]
