"""Newton updates of a step's equations, by a factorisation that serves as long as it can.

Films whose active set changes by few nodes are bordered (`ChangedSystem`), and residual patterns
that the derivatives leave out are found by repeated substitution.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fenics_ehd.multibody.border import BorderedSystem, ChangedSystem
from fenics_ehd.multibody.film_block import film_block
from fenics_ehd.multibody.step_equations import Derivative, Point, StepEquations
from fenics_ehd.multibody.step_norm import StepNorm

#: Nodes that may fill and empty, over the number of full ones, before all is factorised anew.
LARGEST_BORDER = 0.25

#: Residual patterns in the factorised derivatives of a sparse film, at first and at least. What the
#: others add to an update is found by repeated substitution, until it changes by less than this
#: share. Where that shrinks changes by less than `SLOW`, twice the patterns are taken, by more
#: than `FAST` half of them in the next step.
LEADING, REFINED, MAX_REFINEMENTS = 30, 0.02, 8
SLOW, FAST = 0.4, 0.02


class Update(NamedTuple):
    """What SNES takes away in one iteration.

    Attributes
    ----------
    pressures, rest
        Of every film at its free nodes, where oil is conserved with void fractions in place of
        pressures where the film is not full; and of ``(z, l, m)``.
    closing
        Largest closing of a gap, relative.
    size
        Largest change of a gap, relative, or of a coordinate in the norm of the steps.
    """

    pressures: list[np.ndarray]
    rest: np.ndarray
    closing: float
    size: float


class StepFactors:
    """Factors of the equations of one step after another.

    Parameters
    ----------
    equations
        Of the mechanism.
    dense_limit
        Free nodes of a film up to which its matrix is dense.
    options_prefix
        Of the others' factorisations.

    Attributes
    ----------
    patterns
        Residual patterns in the derivatives.
    """

    def __init__(self, equations: StepEquations, *, dense_limit: int, options_prefix: str):
        self._equations = equations
        self._blocks = [
            film_block(film, dense_limit, f"{options_prefix}{film.name}_", oil)
            for film, oil in zip(equations.system.films, equations.oils, strict=True)
        ]
        self.lead(LEADING)

    def lead(self, patterns: int) -> None:
        """Take so many residual patterns into the derivatives."""
        self.patterns, self._reduction = max(patterns, LEADING), 0.0
        self._equations.lead(self.patterns)

    @property
    def patterns_wanted(self) -> int:
        """Residual patterns for the next step: half, where few would have done."""
        patterns = self.patterns // 2 if self._reduction < FAST else self.patterns
        return max(patterns, LEADING)

    def begin(self, norm: StepNorm, patterns: int) -> None:
        """Take another step, whose errors `norm` judges."""
        self._norm = norm
        if patterns != self.patterns:
            self.lead(patterns)
        self._reduction = 0.0
        self.forget()

    def forget(self) -> None:
        """Keep no factors."""
        self._base: BorderedSystem | None = None
        self._factored: BorderedSystem | ChangedSystem | None = None
        self._derivative: Derivative | None = None

    @property
    def known(self) -> bool:
        """Whether there are factors."""
        return self._factored is not None

    def change(self, full: Sequence[np.ndarray]) -> bool:
        """Take other full nodes, derivatives as they are; False: better factorise."""
        derivative, changes = self._derivative, []
        if derivative is None or self._base is None or not all(self._equations.dense):
            return False
        border = 0
        for matrix, then, now in zip(derivative.matrices, self._base_full, full, strict=True):
            added = np.setdiff1d(now, then, assume_unique=True)
            emptied = np.setdiff1d(then, now, assume_unique=True)
            border += len(added) + len(emptied)
            if matrix.weights is not None or border > LARGEST_BORDER * (len(then) + 1):
                return False
            changes.append((matrix, added, emptied))
        self._factored = ChangedSystem(self._base, changes) if border else self._base
        return True

    def factorise(self, point: Point, full: Sequence[np.ndarray]) -> None:
        """Derivatives at a point, factorised for the full nodes of every film."""
        derivative = self._derivative = self._equations.linearise(point)
        for block, matrix, nodes in zip(self._blocks, derivative.matrices, full, strict=True):
            block.prepare(matrix, nodes.astype(np.int32))
        self._base_full = full
        borders = list(derivative.borders)
        for i in self._equations.voids:
            borders[i] = borders[i].on(full[i])
        system = BorderedSystem(self._blocks, borders, derivative.core)
        self._base = self._factored = system

    def update(
        self,
        point: Point,
        full: Sequence[np.ndarray],
        films: Sequence[np.ndarray],
        rest: np.ndarray,
    ) -> Update:
        """As `solve`, with more patterns in the derivatives if substitution is slow."""
        found = self.solve(point, films, rest)
        while self._reduction > SLOW and self.patterns < self._equations.most_patterns:
            self.lead(2 * self.patterns)
            self.factorise(point, full)
            found = self.solve(point, films, rest)
        return found

    def solve(self, point: Point, films: Sequence[np.ndarray], rest: np.ndarray) -> Update:
        """Solve for what is left of the equations."""
        factored, derivative = self._factored, self._derivative
        assert factored is not None
        assert derivative is not None
        given = np.zeros(factored.size)
        given[: len(rest)] = rest
        # Defects are what is left of the equations with W of (11) taken out.
        left_over = [
            film if m.weights is None or oil else m.pattern.multiply(m.weights, film)
            for film, m, oil in zip(films, derivative.matrices, self._equations.oils, strict=True)
        ]
        pressures, x = factored.solve(left_over, given)
        changes, left = self._gap_change(factored, pressures, x)
        closing, size = self._measure(point, changes, x)
        former = size
        for _ in range(MAX_REFINEMENTS):
            if left is None or not size:
                break
            more, x_more = factored.solve([-film for film in left], np.zeros(factored.size))
            further, left = self._gap_change(factored, more, x_more)
            pressures = [p + q for p, q in zip(pressures, more, strict=True)]
            changes = [c + d for c, d in zip(changes, further, strict=True)]
            x = x + x_more
            changed = self._measure(point, further, x_more)[1]
            closing, size = self._measure(point, changes, x)
            self._reduction, former = changed / former, changed
            if changed <= REFINED * size or self._reduction > SLOW:
                break
        return Update(pressures, x[: len(rest)], closing, size)

    def _gap_change(
        self, factored: BorderedSystem | ChangedSystem, pressures: list[np.ndarray], x: np.ndarray
    ) -> tuple[list[np.ndarray], list[np.ndarray] | None]:
        """See `StepEquations.gap_change`; void fractions move no bore."""
        for i in self._equations.voids:
            only = np.zeros_like(pressures[i])
            only[self._base_full[i]] = pressures[i][self._base_full[i]]
            pressures = [*pressures[:i], only, *pressures[i + 1 :]]
        found = self._equations.pressures(pressures)
        return self._equations.gap_change(factored.borders, found, x)

    def _measure(
        self, point: Point, changes: list[np.ndarray], x: np.ndarray
    ) -> tuple[float, float]:
        """Largest relative closing of a gap, and largest change in the norm of the steps.

        SNES takes changes away: one that opens a gap closes it.
        """
        n = self._equations.system.n
        closing, size = 0.0, self._norm.coordinate_error(x[:n])
        places = self._equations.system.films
        for place, change, film in zip(places, changes, point.films, strict=True):
            relative = change / place.film.lengths(film.gap.thickness.ravel())
            closing = max(closing, float(relative.max()))
            size = max(size, float(np.abs(relative).max()))
        return closing, size
