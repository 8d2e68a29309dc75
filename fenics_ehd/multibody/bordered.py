"""Newton systems of film and mechanism: the film's matrix, bordered by the coordinates.

On a partition of the film with full nodes I (`fenics_ehd.film.partition`), pressures P and
coordinates xi change by

    (A + C)_II dP_I + B_I dxi = f_I
      -L_I dP_I     + S   dxi = g

with B and S the derivatives of film and mechanism along the coordinates, L the force of unit
pressures and ``C = D V`` what the residual patterns of M4 let the pressures do to the gap.
Small films are solved as one dense matrix (`dense_system`), large ones by factorising A alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from mpi4py import MPI
from scipy import linalg

from fenics_ehd.errors import SolverError
from fenics_ehd.film.partition import PartitionedSystem
from fenics_ehd.film.pattern import Pattern


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
    pattern_block
        Rows and columns of C by their numbers, or None.
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
    pattern_block: Callable[[np.ndarray, np.ndarray], np.ndarray] | None
    coupling: np.ndarray
    slope: np.ndarray


class BorderedSystem(Protocol):
    """Solves the system above."""

    def factorise(self, linearisation: Linearisation, full_film: np.ndarray) -> None:
        """Take derivatives and the full nodes."""

    def repartition(self, full_film: np.ndarray) -> bool:
        """Take other full nodes, derivatives as they are; False: better factorise."""

    def solve(self, film: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``dP``, zero at the cavitated nodes, and ``dxi`` for f, shape (m,), and g, shape (n,).

        f comes before the weights are applied to it, zero at the cavitated nodes.
        """


class SparseSystem:
    """The sparse film matrix factorised alone; coordinates and patterns by its Schur complement."""

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

    def repartition(self, full_film: np.ndarray) -> bool:
        """See `BorderedSystem`: the film's matrix alone is cheap."""
        return False

    def solve(self, film: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `BorderedSystem`."""
        if self._weights is not None:
            film = self._pattern.multiply(self._weights, film)
        alone = self._system.pressures(film)
        given = np.zeros(len(self._outputs))
        given[: self._n] = rest
        unknown, _ = linalg.lapack.dgetrs(*self._schur, given - self._outputs @ alone)
        return alone - self._answers @ unknown, unknown[: self._n]
