"""Linear systems of Newton's method for films and motion, solved with factors of film matrices.

With pressures P_f of film f at its full nodes, and all other unknowns x (coordinates, their
multipliers, amplitudes of the retained residual patterns), the system is

    A_f dP_f + B_f T_f dx = r_f,      S dx + sum_f O_f dP_f = g.

Eliminating the pressures gives ``(S - sum O_f A_f^-1 B_f T_f) dx = g - sum O_f A_f^-1 r_f``. B_f
has few columns, one for each coordinate on which the gap depends, and one for the shaft's speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg, sparse

from fenics_ehd.base.errors import SolverError
from fenics_ehd.film.assembly import Pattern
from fenics_ehd.film.cavitation import ActiveSetSystem


@dataclass(frozen=True, eq=False)
class FilmBlock:
    """Derivatives of one film's equations, and their coupling to the other unknowns x.

    Attributes
    ----------
    pattern, entries, weights
        Sparsity pattern and entries of the film matrix A, shape (m, m), and entries of the matrix W
        in the same pattern: mass matrix of 8-node cells, or transport of void fractions. `weights`
        is None if W is the identity.
    inputs
        Derivatives B of the film's equations with respect to its b inputs, shape (m, b).
    spread
        Matrix T from unknowns x to inputs, shape (b, x).
    outputs
        Derivatives of the other equations with respect to the film's m pressures: the rows of the
        matrix O that are not zero, shape (o, m).
    rows
        Indices of the rows `outputs` in O, shape (o,).
    gap
        Gap change at the g Gauss points for unit inputs, shape (g, b).
    along_gap
        Derivative of the equations of all nodes with respect to the gap at the Gauss points,
        including that of the gap's rate, shape (nodes, g).
    """

    pattern: Pattern
    entries: np.ndarray
    weights: np.ndarray | None
    inputs: np.ndarray
    spread: np.ndarray
    outputs: np.ndarray
    rows: np.ndarray
    gap: np.ndarray
    along_gap: sparse.csc_matrix

    def block(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Dense block of the film matrix A with the given rows and columns, (rows, columns)."""
        pattern = self.pattern
        row, column = (np.full(pattern.size, -1) for _ in range(2))
        row[rows] = np.arange(len(rows))
        column[columns] = np.arange(len(columns))
        i = row[pattern.rows]
        j = column[pattern.indices]
        inside = (i >= 0) & (j >= 0)
        block = np.zeros((len(rows), len(columns)))
        block[i[inside], j[inside]] = self.entries[inside]
        return block

    def on(self, full: np.ndarray) -> FilmBlock:
        """Return the derivatives with the outputs of full nodes only.

        In a system with weights W, the solution has defects in place of the pressures of nodes that
        are not full, and defects exert no forces. Without W the derivatives are returned unchanged.
        """
        if self.weights is None:
            return self
        outputs = np.zeros_like(self.outputs)
        outputs[:, full] = self.outputs[:, full]
        return replace(self, outputs=outputs)

    def extended(
        self,
        inputs: np.ndarray,
        spread: np.ndarray,
        gap: np.ndarray,
        outputs: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> FilmBlock:
        """Return the derivatives of the film with further inputs and outputs.

        Parameters
        ----------
        inputs, spread, gap
            Further columns of `inputs`, rows of `spread`, and columns of `gap`.
        outputs
            Further rows of `outputs`, and their indices `rows`; None if there are none.
        """
        block = replace(
            self,
            inputs=np.hstack([self.inputs, inputs]),
            spread=np.vstack([self.spread, spread]),
            gap=np.hstack([self.gap, gap]),
        )
        if outputs is None:
            return block
        values, rows = outputs
        return replace(
            block,
            outputs=np.vstack([self.outputs, values]),
            rows=np.concatenate([self.rows, rows]),
        )


class BorderedSystem:
    """Factorised linear system of a Newton step, of all films and of the motion.

    Parameters
    ----------
    blocks
        Factors of the matrix A of every film, prepared by the caller.
    borders
        Derivatives of every film's equations, and their coupling.
    core
        Matrix S of the equations of motion, constraints, patterns and contact, shape (size, size).
    responses
        Products ``A^-1 B`` for every film, shape (m, b); computed if None.

    Attributes
    ----------
    size
        Number of unknowns other than pressures.

    Raises
    ------
    SolverError
        If the Schur complement is singular.
    """

    def __init__(
        self,
        blocks: Sequence[ActiveSetSystem],
        borders: Sequence[FilmBlock],
        core: np.ndarray,
        responses: Sequence[np.ndarray] | None = None,
    ):
        self.blocks = blocks
        self.borders = borders
        self.core = core
        self.size = len(core)
        if responses is None:
            responses = [b.solution(d.inputs) for b, d in zip(blocks, borders, strict=True)]
        self.responses = responses
        matrix = core.copy()
        for border, response in zip(borders, responses, strict=True):
            matrix[border.rows] -= (border.outputs @ response) @ border.spread
        # Rows and columns have different units: they are scaled so that pivots are comparable.
        self._row_scale = 1.0 / np.abs(matrix).max(axis=1)
        matrix *= self._row_scale[:, None]
        self._column_scale = 1.0 / np.abs(matrix).max(axis=0)
        matrix *= self._column_scale
        if not np.isfinite(matrix).all():
            raise SolverError(
                "an equation of motion or a coordinate has no coefficients: check masses and joints"
            )
        factor, pivots, failure = linalg.lapack.dgetrf(matrix)
        if failure:
            raise SolverError(
                f"the matrix of films and motion is singular (row {failure}): check masses, joints "
                "and drives"
            )
        self._factor = factor, pivots

    def solve(
        self, films: Sequence[np.ndarray], rest: np.ndarray
    ) -> tuple[list[np.ndarray], np.ndarray]:
        """Solve for the pressures of every film, shape (m,) each, and for the other unknowns.

        `films` are the right-hand sides of the films' equations, shape (m,) each, and `rest` is the
        right-hand side of the other equations, shape (size,). If a film has weights W, nodes that
        are not full have defects or void fractions in place of pressures.
        """
        alone = [b.solution(r) for b, r in zip(self.blocks, films, strict=True)]
        reduced = rest.copy()
        for border, pressure in zip(self.borders, alone, strict=True):
            reduced[border.rows] -= border.outputs @ pressure
        scaled = linalg.lapack.dgetrs(*self._factor, reduced * self._row_scale)[0]
        x = scaled * self._column_scale
        pressures = [
            p - response @ (border.spread @ x)
            for p, response, border in zip(alone, self.responses, self.borders, strict=True)
        ]
        return pressures, x


class ChangedSystem:
    """Linear system of films and motion after a few nodes have filled or emptied.

    It uses the factors of a `BorderedSystem` for the nodes I that were full before the change.
    Additional unknowns are the pressures P_a of nodes that filled, and the defects y_r of nodes
    that emptied:

        [ A_II  A_Ia  E_r ] [P_I]
        [ A_aI  A_aa   0  ] [P_a]
        [ E_r'   0     0  ] [y_r]

    Parameters
    ----------
    former
        Factorised system before the change.
    changes
        Indices of the nodes that filled and of those that emptied since, for every film.
    """

    def __init__(
        self,
        former: BorderedSystem,
        changes: Sequence[tuple[np.ndarray, np.ndarray]],
    ):
        self._changes = changes
        self.size = first = former.size
        total = first + sum(len(a) + len(e) for a, e in self._changes)
        core = np.zeros((total, total))
        core[:first, :first] = former.core
        borders = []
        responses = []
        self._indices = []
        for block, border, response, (added, emptied) in zip(
            former.blocks, former.borders, former.responses, changes, strict=True
        ):
            m = len(border.inputs)
            a = len(added)
            e = len(emptied)
            new = slice(first, first + a)
            last = first + a + e
            everywhere = np.arange(m)
            inputs = np.zeros((m, a + e))
            inputs[:, :a] = border.block(everywhere, added)
            inputs[emptied, a + np.arange(e)] = 1.0
            outputs = np.zeros((a + e, m))
            outputs[:a] = border.block(added, everywhere)
            outputs[a + np.arange(e), emptied] = 1.0
            core[new, new] = outputs[:a, added]
            core[new, : former.size] = border.inputs[added] @ border.spread
            core[border.rows, new] = border.outputs[:, added]
            none = np.zeros((len(border.spread), total - self.size))
            wide = replace(border, spread=np.hstack([border.spread, none]))
            still = np.zeros((len(border.gap), a + e))
            rows = np.arange(first, last)
            borders.append(wide.extended(inputs, np.eye(total)[rows], still, (outputs, rows)))
            responses.append(np.hstack([response, block.solution(inputs)]))
            self._indices.append(new)
            first = last
        self._total = total
        self.borders = former.borders
        self._system = BorderedSystem(former.blocks, borders, core, responses)

    def solve(
        self, films: Sequence[np.ndarray], rest: np.ndarray
    ) -> tuple[list[np.ndarray], np.ndarray]:
        """Solve for the pressures of every film and for the other unknowns.

        See `BorderedSystem.solve`.
        """
        right_side = np.zeros(self._total)
        right_side[: self.size] = rest
        for film, indices, (added, _) in zip(films, self._indices, self._changes, strict=True):
            right_side[indices] = film[added]
        pressures, x = self._system.solve(films, right_side)
        for pressure, indices, (added, emptied) in zip(
            pressures, self._indices, self._changes, strict=True
        ):
            pressure[added] = x[indices]
            pressure[emptied] = 0.0
        return pressures, x[: self.size]
