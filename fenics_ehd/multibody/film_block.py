"""One film's own part of a Newton system: its matrix, and factors of that on its full nodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy import linalg

from fenics_ehd.base.errors import SolverError
from fenics_ehd.film.active_set import ActiveSetSystem
from fenics_ehd.film.pattern import Pattern
from fenics_ehd.multibody.conserved_oil import ConservedOil
from fenics_ehd.multibody.system import FilmPlace


@dataclass(frozen=True, eq=False)
class FilmMatrix:
    """Derivatives of one film's equations along its own pressures.

    Attributes
    ----------
    pattern, entries, weights
        A by its entries, and W of (11) where the film has it.
    answer
        What the bore's answer adds, dense: some rows and columns by their numbers; or None.
    """

    pattern: Pattern
    entries: np.ndarray
    weights: np.ndarray | None
    answer: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None

    def block(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Some rows and columns, dense, W left out."""
        pattern = self.pattern
        row, column = (np.full(pattern.size, -1) for _ in range(2))
        row[rows], column[columns] = np.arange(len(rows)), np.arange(len(columns))
        i, j = row[pattern.rows], column[pattern.indices]
        inside = (i >= 0) & (j >= 0)
        block = np.zeros((len(rows), len(columns)))
        block[i[inside], j[inside]] = self.entries[inside]
        if self.answer is not None:
            block += self.answer(rows, columns)
        return block


class FilmBlock(Protocol):
    """Factors of one film's matrix on its full nodes."""

    def prepare(self, matrix: FilmMatrix, full_film: np.ndarray) -> None:
        """Factorise for a set of full nodes."""

    def pressures(self, rhs: np.ndarray) -> np.ndarray:
        """Pressures for right-hand sides (m,) or (m, k), zero where the film cavitates."""


class DenseFilm:
    """A `FilmBlock` for films of a few hundred nodes, factorised by LAPACK."""

    def __init__(self, *, symmetric: bool):
        self._symmetric = symmetric

    def prepare(self, matrix: FilmMatrix, full_film: np.ndarray) -> None:
        """See `FilmBlock`.

        Raises
        ------
        SolverError
            The matrix is singular.
        """
        self._full, self._weights = full_film, matrix.weights
        if not len(full_film):
            return
        if matrix.weights is None:
            block = matrix.block(full_film, full_film)
        else:
            # Pressures of the full and defects of the other nodes: all rows at once.
            every = np.arange(matrix.pattern.size)
            block = -matrix.pattern.matrix(matrix.weights).toarray()
            block[:, full_film] = matrix.block(every, full_film)
        if self._symmetric and matrix.weights is None and matrix.answer is None:
            self._factor, failure = linalg.lapack.dpotrf(block.T, lower=0, overwrite_a=True)
        else:
            *self._factor, failure = linalg.lapack.dgetrf(block.T, overwrite_a=True)
        if failure:
            raise SolverError(f"the film's matrix is singular (row {failure})")

    def pressures(self, rhs: np.ndarray) -> np.ndarray:
        """See `FilmBlock`."""
        if not len(self._full):
            return np.zeros_like(rhs)
        rows = self._full if self._weights is None else slice(None)
        given = np.asfortranarray(rhs[rows])
        if isinstance(self._factor, list):
            found = linalg.lapack.dgetrs(*self._factor, given, trans=1)[0]
        else:
            found = linalg.lapack.dpotrs(self._factor, given, lower=0)[0]
        result = np.zeros_like(rhs)
        result[self._full] = found if self._weights is None else found[self._full]
        return result


class SparseFilm:
    """A `FilmBlock` for large films."""

    def __init__(self, system: ActiveSetSystem):
        self._system = system
        self.pressures = system.pressures

    def prepare(self, matrix: FilmMatrix, full_film: np.ndarray) -> None:
        """See `FilmBlock`."""
        self._system.prepare(matrix.entries, matrix.weights, full_film)


class OilFilm(SparseFilm):
    """A `FilmBlock` of a film that conserves its oil.

    Where the film is not full its "pressures" are void fractions.
    """

    def __init__(self, system: ActiveSetSystem):
        super().__init__(system)
        self.pressures = system.solution


def film_block(
    place: FilmPlace, dense_limit: int, options_prefix: str, oil: ConservedOil | None = None
) -> FilmBlock:
    """Dense factors of a small film, sparse ones of another or of conserved oil."""
    film = place.film.film
    symmetric = film.parameters.lubricant.linear
    if oil is not None:
        pattern = oil.balance.pattern
        return OilFilm(
            ActiveSetSystem(pattern, weighted=True, symmetric=False, options_prefix=options_prefix)
        )
    if len(film.free) <= dense_limit:
        return DenseFilm(symmetric=symmetric)
    return SparseFilm(
        ActiveSetSystem(
            film.assembly.pattern,
            weighted=film.equation.weights is not None,
            symmetric=symmetric,
            options_prefix=options_prefix,
        )
    )
