"""Newton systems of films and motion: every film is factorised alone, what is left is small.

With pressures P_f of film f at its full nodes, and all other unknowns x (coordinates, their
multipliers, amplitudes of the leading residual patterns),

    A_f dP_f + B_f T_f dx = r_f,      S dx + sum_f O_f dP_f = g

leave ``(S - sum O_f A_f^-1 B_f T_f) dx = g - sum O_f A_f^-1 r_f``. B_f has few columns: one for
every coordinate that the film sees, one for the speed of the shaft.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg, sparse

from fenics_ehd.base.errors import SolverError
from fenics_ehd.multibody.film_block import FilmBlock, FilmMatrix


@dataclass(frozen=True, eq=False)
class FilmBorder:
    """What couples one film to the other unknowns x.

    Attributes
    ----------
    inputs
        B, shape (m, b).
    spread
        T, shape (b, x).
    outputs
        O's rows that are not zero, shape (o, m).
    rows
        Their places in x, shape (o,).
    patterns
        Places in x of the leading residual patterns.
    along_gap
        Derivative along the gap at the Gauss points, its rate following, shape (m, g).
    contact
        Places in x of the contact pressures that move its bore, and the gap change at the Gauss
        points for unit values of them; None: there are none.
    slope
        Gap change there per angle of the journal ahead of the bore, shape (g,); None: none.
    """

    inputs: np.ndarray
    spread: np.ndarray
    outputs: np.ndarray
    rows: np.ndarray
    patterns: slice
    along_gap: sparse.csc_matrix
    contact: tuple[slice, np.ndarray] | None = None
    slope: np.ndarray | None = None

    def on(self, full: np.ndarray) -> FilmBorder:
        """The same, with outputs of full nodes alone."""
        outputs = np.zeros_like(self.outputs)
        outputs[:, full] = self.outputs[:, full]
        return replace(self, outputs=outputs)


class BorderedSystem:
    """The system above.

    Parameters
    ----------
    blocks
        Of every film, prepared by the caller.
    borders
        Of every film.
    core
        S, shape (x, x).
    answers
        ``A^-1 B`` of every film where it is known, shape (m, b).

    Attributes
    ----------
    size
        Number of unknowns x.

    Raises
    ------
    SolverError
        What is left is singular.
    """

    def __init__(
        self,
        blocks: Sequence[FilmBlock],
        borders: Sequence[FilmBorder],
        core: np.ndarray,
        answers: Sequence[np.ndarray] | None = None,
    ):
        self.blocks, self.borders, self.core, self.size = blocks, borders, core, len(core)
        if answers is None:
            answers = [b.pressures(d.inputs) for b, d in zip(blocks, borders, strict=True)]
        self.answers = answers
        matrix = core.copy()
        for border, answer in zip(borders, answers, strict=True):
            matrix[border.rows] -= (border.outputs @ answer) @ border.spread
        # Forces, lengths and rates side by side: pivots are chosen among equals.
        self._row_scale = 1.0 / np.abs(matrix).max(axis=1)
        matrix *= self._row_scale[:, None]
        self._column_scale = 1.0 / np.abs(matrix).max(axis=0)
        matrix *= self._column_scale
        if not np.isfinite(matrix).all():
            raise SolverError("an equation of motion or a coordinate has no coefficients")
        factor, pivots, failure = linalg.lapack.dgetrf(matrix)
        if failure:
            raise SolverError(f"the matrix of films and motion is singular (row {failure})")
        self._factor = factor, pivots

    def solve(
        self, films: Sequence[np.ndarray], rest: np.ndarray
    ) -> tuple[list[np.ndarray], np.ndarray]:
        """Pressures of every film and x, for right-hand sides (m,) of each and (x,)."""
        alone = [b.pressures(r) for b, r in zip(self.blocks, films, strict=True)]
        given = rest.copy()
        for border, pressure in zip(self.borders, alone, strict=True):
            given[border.rows] -= border.outputs @ pressure
        found = linalg.lapack.dgetrs(*self._factor, given * self._row_scale)[0]
        x = found * self._column_scale
        pressures = [
            p - answer @ (border.spread @ x)
            for p, answer, border in zip(alone, self.answers, self.borders, strict=True)
        ]
        return pressures, x


class ChangedSystem:
    """A `BorderedSystem` for full nodes that differ a little from those factorised.

    Nodes that filled are unknowns more, and so are the defects of those that emptied:

        [ A_II  A_Ia  E_r ] [P_I]
        [ A_aI  A_aa   0  ] [P_a]
        [ E_r'   0     0  ] [y_r]

    Parameters
    ----------
    former
        What was factorised.
    changes
        Of every film: its matrix, and the nodes that filled and emptied.
    """

    def __init__(
        self,
        former: BorderedSystem,
        changes: Sequence[tuple[FilmMatrix, np.ndarray, np.ndarray]],
    ):
        self._filled = [(added, emptied) for _, added, emptied in changes]
        self.size = first = former.size
        total = first + sum(len(a) + len(e) for a, e in self._filled)
        core = np.zeros((total, total))
        core[:first, :first] = former.core
        borders, answers, self._places = [], [], []
        for block, border, answer, (matrix, added, emptied) in zip(
            former.blocks, former.borders, former.answers, changes, strict=True
        ):
            m, a, e = len(border.inputs), len(added), len(emptied)
            new = slice(first, first + a)
            last = first + a + e
            everywhere = np.arange(m)
            inputs = np.zeros((m, a + e))
            inputs[:, :a] = matrix.block(everywhere, added)
            inputs[emptied, a + np.arange(e)] = 1.0
            outputs = np.zeros((a + e, m))
            outputs[:a] = matrix.block(added, everywhere)
            outputs[a + np.arange(e), emptied] = 1.0
            core[new, new] = outputs[:a, added]
            core[new, : former.size] = border.inputs[added] @ border.spread
            core[border.rows, new] = border.outputs[:, added]
            spread = np.zeros((len(border.spread) + a + e, total))
            spread[: len(border.spread), : former.size] = border.spread
            spread[len(border.spread) + np.arange(a + e), np.arange(first, last)] = 1.0
            borders.append(
                replace(
                    border,
                    inputs=np.hstack([border.inputs, inputs]),
                    spread=spread,
                    outputs=np.vstack([border.outputs, outputs]),
                    rows=np.concatenate([border.rows, np.arange(first, last)]),
                )
            )
            answers.append(np.hstack([answer, block.pressures(inputs)]))
            self._places.append(new)
            first = last
        self._total, self.borders = total, former.borders
        self._system = BorderedSystem(former.blocks, borders, core, answers)

    def solve(
        self, films: Sequence[np.ndarray], rest: np.ndarray
    ) -> tuple[list[np.ndarray], np.ndarray]:
        """See `BorderedSystem`."""
        given = np.zeros(self._total)
        given[: self.size] = rest
        for film, place, (added, _) in zip(films, self._places, self._filled, strict=True):
            given[place] = film[added]
        pressures, x = self._system.solve(films, given)
        for pressure, place, (added, emptied) in zip(
            pressures, self._places, self._filled, strict=True
        ):
            pressure[added], pressure[emptied] = x[place], 0.0
        return pressures, x[: self.size]
