"""Newton systems of film and mechanism: the film's matrix, bordered by the coordinates.

On a partition of the film with full nodes I (`fenics_ehd.film.partition`), pressures P and
coordinates xi change by

    (A + C)_II dP_I + B_I dxi = f_I
      -L_I dP_I     + S   dxi = g

with B and S the derivatives of film and mechanism along the coordinates, L the force of unit
pressures and ``C = D V`` what the residual patterns of M4 let the pressures do to the gap.
Small films are solved as one dense matrix, large ones by factorising A alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from mpi4py import MPI
from scipy import linalg

from fenics_ehd.errors import SolverError
from fenics_ehd.film.partition import PartitionedSystem
from fenics_ehd.film.pattern import Pattern

#: Free film nodes up to which one dense matrix is faster (`benchmarks/coupled_steps.py`).
DENSE_LIMIT = 700


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Derivatives at one iterate, of m film nodes and n coordinates.

    Attributes
    ----------
    entries, weights
        Entries of A, and of W of (11) where the film has it.
    along
        B, shape (m, n).
    patterns_along, patterns
        D, shape (m, r), and V, shape (r, m); no patterns: r = 0.
    dense_patterns
        C, columns of the full nodes, rows of the full ones or, with weights, of all; or None.
    coupling
        L, shape (n, m).
    slope
        S, shape (n, n).
    """

    entries: np.ndarray
    weights: np.ndarray | None
    along: np.ndarray
    patterns_along: np.ndarray
    patterns: np.ndarray
    dense_patterns: np.ndarray | None
    coupling: np.ndarray
    slope: np.ndarray


class BorderedSystem(Protocol):
    """Solves the system above."""

    #: Whether it asks for C itself rather than its factors.
    wants_dense_patterns: bool

    def factorise(self, linearisation: Linearisation, full_film: np.ndarray) -> None:
        """Take derivatives and the full nodes."""

    def solve(self, film: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``dP``, zero at the cavitated nodes, and ``dxi`` for f, shape (m,), and g, shape (n,).

        f comes before the weights are applied to it, zero at the cavitated nodes.
        """


class DenseSystem:
    """One dense matrix, factorised by LAPACK."""

    wants_dense_patterns = True

    def __init__(self, pattern: Pattern):
        self._pattern = pattern
        self._places = pattern.rows * pattern.size + pattern.indices

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
        matrix = np.zeros((k + n, k + n), order="F")
        columns = full_film if lin.weights is not None else np.arange(k)
        if lin.weights is not None:
            matrix[:k, :k] = -self._dense(lin.weights)
        film = self._dense(lin.entries)[np.ix_(rows, full_film)]
        matrix[:k, columns] = film if lin.dense_patterns is None else film + lin.dense_patterns
        matrix[k:, columns] = -lin.coupling[:, full_film]
        matrix[:k, k:], matrix[k:, k:] = lin.along[rows], lin.slope
        self._factors, self._pivots, failure = linalg.lapack.dgetrf(matrix, overwrite_a=True)
        if failure:
            raise SolverError(f"the matrix of film and mechanism is singular (row {failure})")
        self._rows, self._full, self._weights = rows, full_film, lin.weights

    def _dense(self, entries: np.ndarray) -> np.ndarray:
        m = self._pattern.size
        flat = np.zeros(m * m)
        flat[self._places] = entries
        return flat.reshape(m, m)

    def solve(self, film: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `BorderedSystem`."""
        if self._weights is not None:
            film = self._pattern.multiply(self._weights, film)
        rhs = np.concatenate([film[self._rows], rest])
        solution, _ = linalg.lapack.dgetrs(self._factors, self._pivots, rhs)
        k = len(self._rows)
        pressures = np.zeros(self._pattern.size)
        values = solution[:k] if self._weights is None else solution[self._full]
        pressures[self._full] = values
        return pressures, solution[k:]


class SparseSystem:
    """The sparse film matrix factorised alone; coordinates and patterns by its Schur complement."""

    wants_dense_patterns = False

    def __init__(self, pattern: Pattern, *, weighted: bool, symmetric: bool, options_prefix: str):
        self._pattern = pattern
        self._system = PartitionedSystem(
            pattern,
            weighted=weighted,
            symmetric=symmetric,
            comm=MPI.COMM_SELF,
            options_prefix=options_prefix,
        )

    def factorise(self, linearisation: Linearisation, full_film: np.ndarray) -> None:
        """See `BorderedSystem`.

        Raises
        ------
        SolverError
            The Schur complement is singular.
        """
        lin = linearisation
        self._system.prepare(lin.entries, lin.weights, full_film.astype(np.int32))
        columns = np.hstack([lin.along, lin.patterns_along])
        self._answers = self._system.pressures(columns)
        self._outputs = np.vstack([-lin.coupling, -lin.patterns])
        n, r = len(lin.slope), len(lin.patterns)
        schur = np.zeros((n + r, n + r))
        schur[:n, :n] = lin.slope
        schur[n:, n:] = np.eye(r)
        schur -= self._outputs @ self._answers
        factors, pivots, failure = linalg.lapack.dgetrf(schur)
        if failure:
            raise SolverError(f"the matrix of film and mechanism is singular (row {failure})")
        self._schur, self._n, self._weights = (factors, pivots), n, lin.weights

    def solve(self, film: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `BorderedSystem`."""
        if self._weights is not None:
            film = self._pattern.multiply(self._weights, film)
        alone = self._system.pressures(film)
        given = np.zeros(len(self._outputs))
        given[: self._n] = rest
        unknown, _ = linalg.lapack.dgetrs(*self._schur, given - self._outputs @ alone)
        return alone - self._answers @ unknown, unknown[: self._n]
