"""One implicit step of a mechanism by SNES-VI, on all films' pressures and all coordinates at once.

Pressures are bounded below by zero, coordinates are free: complementarity and motion converge
in one iteration, quadratically on the active set that SNES-VI settles on. It stops when what is
left of the Newton update changes the gaps by less than the tolerance of the step, relative, the
coordinates by less than that in the norm of the step control, and every film's complementarity
holds to the same tolerance, relative to its source; all in the maximum norm. A factorisation
serves as long as the active set stays and the updates shrink fast.

Full updates may lead from one active set to another and back: few residual patterns, hardly
damped, resist a short step far more than the oil does. A step that failed is tried again with
half of every update as long as the active set changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_ehd.errors import CavitationError, SolverError
from fenics_ehd.film import FilmState
from fenics_ehd.film.cavitation import CavitationResult, verify_complementarity
from fenics_ehd.film.partition import PartitionedSystem
from fenics_ehd.film.snes_vi import SnesVi
from fenics_ehd.multibody.border import (
    BorderedSystem,
    ChangedSystem,
    DenseFilm,
    FilmBlock,
    SparseFilm,
)
from fenics_ehd.multibody.newton import BOUNDARY_FRACTION, Attempt, ImplicitStep
from fenics_ehd.multibody.step_equations import Derivative, Point, StepEquations
from fenics_ehd.multibody.system import FilmPlace, Motion, System

#: Iterations of one step. Those that converge need one to five.
MAX_ITERATIONS = 25

#: A factorisation is kept for another iteration when the last update shrank by this.
CONTRACTION = 0.1

#: Derivatives are kept for another active set when the last update changed the gaps by no more
#: than this, relative, and shrank by this.
NEAR, SHRINKING = 0.05, 0.3

#: Iterations of a step that failed so, and the part of an update that they take as long as the
#: active set changes.
PATIENT_ITERATIONS, DAMPING = 100, 0.5

#: Iterations after which the sheared share of the films stays as it is, if it does not before.
FREE_SHEAR = 4

#: Nodes that may fill and empty, over the number of full ones, before all is factorised anew.
LARGEST_BORDER = 0.25

#: Tolerance below which round-off is met.
FINEST = 1e-11

#: Dimensionless pressure that SNES-VI takes for zero.
ZERO_PRESSURE = 1e-14

#: Free film nodes up to which a dense factorisation is faster.
DENSE_LIMIT = 700

#: Residual patterns in the factorised derivatives of a sparse film, at first and at least. What the
#: others add to an update is found by repeated substitution, until it changes by less than this
#: share. Where that shrinks changes by less than `SLOW`, twice the patterns are taken, by more
#: than `FAST` half of them in the next step.
LEADING, REFINED, MAX_REFINEMENTS = 30, 0.02, 8
SLOW, FAST = 0.4, 0.02


@dataclass(frozen=True, eq=False)
class CoupledState:
    """Films and motion at the end of a step.

    Attributes
    ----------
    films
        Solution of every film, in the order of `System.films`.
    motion
        See `Motion`.
    """

    films: list[FilmState]
    motion: Motion


@dataclass(frozen=True, eq=False)
class StepMemory:
    """What one step leaves to the next.

    Attributes
    ----------
    times, values
        Pressures at all nodes [Pa] and multipliers at the last one or two steps, newest first.
    patterns
        Residual patterns to take into the derivatives.
    """

    times: np.ndarray
    values: np.ndarray
    patterns: int

    def extrapolated(self, time: float) -> np.ndarray:
        """On the line through the last two steps."""
        if len(self.times) == 1:
            return self.values[0]
        share = (time - self.times[0]) / (self.times[0] - self.times[1])
        return (1 + share) * self.values[0] - share * self.values[1]

    @classmethod
    def after(
        cls, memory: StepMemory | None, time: float, values: np.ndarray, patterns: int
    ) -> StepMemory:
        """With one more step."""
        if memory is None:
            return cls(np.array([time]), values[None], patterns)
        times, before = np.array([time, memory.times[0]]), memory.values[0]
        return cls(times, np.stack([values, before]), patterns)


class CoupledSteps:
    """Solves the steps of one mechanism: a `StepSolver`.

    Parameters
    ----------
    system
        The mechanism, its oils of constant density.
    options_prefix
        Of SNES-VI.
    dense_limit
        Free nodes of a film up to which it is one dense matrix.
    """

    def __init__(
        self,
        system: System,
        *,
        options_prefix: str = "motion_",
        dense_limit: int = DENSE_LIMIT,
    ):
        self.system, self._prefix = system, options_prefix
        self.equations = StepEquations(system, dense_limit=dense_limit)
        self._ends = np.cumsum([0, *self.equations.sizes])
        self._lead(LEADING)
        self._blocks = [
            _block(film, dense_limit, f"{options_prefix}{film.name}_") for film in system.films
        ]
        self._snes = self._solver(MAX_ITERATIONS)

    @cached_property
    def _patient(self) -> SnesVi:
        return self._solver(PATIENT_ITERATIONS)

    def _solver(self, iterations: int) -> SnesVi:
        free = np.full(self.equations.rest_size, -np.inf)
        return SnesVi(
            self,
            np.concatenate([np.zeros(self._ends[-1]), free]),
            comm=MPI.COMM_SELF,
            options_prefix=self._prefix,
            tolerance=None,
            max_iterations=iterations,
        )

    @property
    def solves(self) -> int:
        """Solves by SNES-VI so far."""
        patient = self.__dict__.get("_patient")
        return self._snes.solves + (patient.solves if patient else 0)

    def __call__(self, problem: Any, step: ImplicitStep, memory: StepMemory | None) -> Attempt:
        """Solve one step; `problem` judges errors."""
        self._problem, self._tolerance = problem, max(step.tolerance, FINEST)
        self._iterations = 0
        wanted = LEADING if memory is None else memory.patterns
        if wanted != self._patterns:
            self._lead(wanted)
        self._reduction = 0.0
        self.equations.begin(step)
        try:
            iterations = self._solve(self._start(step, memory))
            state = self._state()
        except SolverError as error:
            failure = f"{type(error).__name__}: {error}"
            return Attempt(max(1, self._iterations), failure, cause=error)
        point = self._point
        values = [film.pressure for film in state.films]
        patterns = self._patterns // 2 if self._reduction < FAST else self._patterns
        kept = StepMemory.after(
            memory,
            step.time,
            np.concatenate([*values, point.multipliers, point.drift]),
            max(patterns, LEADING),
        )
        x, rate = self.equations.state(point)
        return Attempt(iterations, None, x, state, kept, rate=rate)

    def _solve(self, start: np.ndarray) -> int:
        """Iterations to a solution, by full updates and else by damped ones."""
        self._begin(damping=1.0)
        try:
            return self._snes.solve(start)[2]
        except CavitationError:
            self._begin(damping=DAMPING)
        self._patient.solve(start)
        return self._iterations

    def _begin(self, damping: float) -> None:
        self._full = [np.empty(0, dtype=np.int32) for _ in self._blocks]
        self._base: BorderedSystem | None = None
        self._factored: BorderedSystem | ChangedSystem | None = None
        self._derivative: Derivative | None = None
        self._close = False
        self._size, self._fraction, self._contracts = np.inf, 1.0, False
        self._damping, self._settled = damping, False

    def _start(self, step: ImplicitStep, memory: StepMemory | None) -> np.ndarray:
        """First iterate: extrapolated, as far as the gaps stay open."""
        before, predicted = (self._problem.gaps(watched) for watched in step.watched)
        closing = 1.0 - float((predicted / before).min(initial=np.inf))
        fraction = min(1.0, BOUNDARY_FRACTION / closing) if closing > 0.0 else 1.0
        x = step.start + fraction * (step.predicted - step.start)
        system, start = self.system, []
        values = None if memory is None else memory.extrapolated(step.time)
        place = 0
        for film in (place.film.film for place in system.films):
            size = film.assembly.size
            if values is None:
                start.append(np.zeros(len(film.free)))
            else:
                nodal = np.maximum(values[place : place + size], 0.0)
                start.append(nodal[film.free] / film.parameters.pressure_scale)
            place += size
        multipliers = np.zeros(2 * system.m) if values is None else values[place:]
        return np.concatenate([*start, x[: system.n], multipliers])

    def _split(self, values: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """Pressures of every film and the other unknowns."""
        films = [values[first:last] for first, last in pairwise(self._ends)]
        return films, values[self._ends[-1] :]

    # --- Called by SNES-VI during a solve.

    def function(self, x: np.ndarray) -> np.ndarray:
        """See `VariationalInequality`."""
        # PETSc writes to its array again; a point lasts.
        self._point: Point = self.equations.evaluate(*self._split(x.copy()))
        return np.concatenate([*(film.defect for film in self._point.films), self._point.rest])

    def linearise(self, x: np.ndarray) -> None:
        """See `VariationalInequality`: derivatives are made for an active set, when it is known."""

    def factorise(self, nodes: np.ndarray) -> None:
        """See `VariationalInequality`."""
        ends = self._ends
        full = [nodes[(nodes >= first) & (nodes < last)] - first for first, last in pairwise(ends)]
        self._settled = all(
            np.array_equal(now, then) for now, then in zip(full, self._full, strict=True)
        )
        self._full = full
        if self._settled or self._iterations >= FREE_SHEAR:
            self.equations.hold_filled()
        if self._contracts and self._settled and self._factored is not None:
            return
        if not (self._close and self._change(full)):
            self._derivative = self.equations.linearise(self._point)
            self._base = self._factored = self._factorise(self._derivative, full)

    def _change(self, full: Sequence[np.ndarray]) -> bool:
        """Take other full nodes, derivatives as they are; False: better factorise."""
        derivative, changes = self._derivative, []
        if derivative is None or self._base is None or not all(self.equations.dense):
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

    def _lead(self, patterns: int) -> None:
        """Take so many residual patterns into the derivatives."""
        self._patterns, self._reduction = max(patterns, LEADING), 0.0
        self.equations.lead(self._patterns)

    def _factorise(self, derivative: Derivative, full: Sequence[np.ndarray]) -> BorderedSystem:
        for block, matrix, nodes in zip(self._blocks, derivative.matrices, full, strict=True):
            block.prepare(matrix, nodes.astype(np.int32))
        self._base_full = full
        return BorderedSystem(self._blocks, derivative.borders, derivative.core)

    def _update(
        self, films: Sequence[np.ndarray], rest: np.ndarray
    ) -> tuple[list[np.ndarray], np.ndarray, float, float]:
        """Solve: pressures, other unknowns, largest relative closing of a gap, and size."""
        factored = self._factored
        assert factored is not None
        given = np.zeros(factored.size)
        given[: len(rest)] = rest
        pressures, x = factored.solve(films, given)
        changes, left = self.equations.gap_change(factored.borders, pressures, x)
        closing, size = self._measure(changes, x)
        former = size
        for _ in range(MAX_REFINEMENTS):
            if left is None or not size:
                break
            more, x_more = factored.solve([-film for film in left], np.zeros(factored.size))
            further, left = self.equations.gap_change(factored.borders, more, x_more)
            pressures = [p + q for p, q in zip(pressures, more, strict=True)]
            changes = [c + d for c, d in zip(changes, further, strict=True)]
            x = x + x_more
            changed = self._measure(further, x_more)[1]
            closing, size = self._measure(changes, x)
            self._reduction, former = changed / former, changed
            if changed <= REFINED * size or self._reduction > SLOW:
                break
        return pressures, x[: len(rest)], closing, size

    def _measure(self, changes: list[np.ndarray], x: np.ndarray) -> tuple[float, float]:
        """Largest relative closing of a gap, and largest change in the norm of the steps.

        SNES takes changes away: one that opens a gap closes it.
        """
        closing, size = 0.0, self._problem.coordinate_error(x[: self.system.n])
        for change, film in zip(changes, self._point.films, strict=True):
            relative = change / film.gap.thickness.ravel()
            closing = max(closing, float(relative.max()))
            size = max(size, float(np.abs(relative).max()))
        return closing, size

    def update(self, rhs: np.ndarray) -> np.ndarray:
        """See `VariationalInequality`; shortened where it would close a gap."""
        self._iterations += 1
        films, place = [], 0
        for full, size in zip(self._full, self.equations.sizes, strict=True):
            film = np.zeros(size)
            film[full] = rhs[place : place + len(full)]
            films.append(film)
            place += len(full)
        former = self._size
        pressures, rest, closing, self._size = self._update(films, rhs[place:])
        while self._reduction > SLOW and self._patterns < self.equations.most_patterns:
            self._lead(2 * self._patterns)
            self._derivative = self.equations.linearise(self._point)
            self._base = self._factored = self._factorise(self._derivative, self._full)
            pressures, rest, closing, self._size = self._update(films, rhs[place:])
        self._contracts = self._size <= CONTRACTION * former
        self._close = self._size <= min(NEAR, SHRINKING * former)
        self._fraction = min(1.0, BOUNDARY_FRACTION / closing) if closing > 0 else 1.0
        if not self._settled:
            self._fraction *= self._damping
        inner = [p[full] for p, full in zip(pressures, self._full, strict=True)]
        return self._fraction * np.concatenate([*inner, rest])

    def converged(self, iteration: int) -> bool:
        """See `SelfJudging`: what is left of the update is small, by the last derivatives."""
        if not iteration or self._fraction < 1.0:
            return False
        point, films = self._point, []
        for place, film in zip(self.system.films, point.films, strict=True):
            pressures = film.nodal[place.film.film.free]
            # Elsewhere pressure is zero and the flux positive: nothing is left to do.
            unsettled = (pressures > ZERO_PRESSURE) | (film.defect < 0.0)
            defect = np.where(unsettled, film.defect, 0.0)
            if not np.abs(defect).max(initial=0.0) <= self._tolerance:
                return False
            films.append(defect)
        return self._update(films, point.rest)[3] <= self._tolerance

    def _state(self) -> CoupledState:
        """The end of the step, its films verified."""
        point, films = self._point, []
        for i, (place, film) in enumerate(zip(self.system.films, point.films, strict=True)):
            scale = self.equations.scales[i]
            free, flux = film.nodal[place.film.film.free], film.defect * scale
            verify_complementarity(free, flux, scale, 10 * self._tolerance)
            result = CavitationResult(free, flux, self._full[i].astype(np.int32), self._iterations)
            pressure = place.film.film.parameters.pressure_scale * film.nodal
            films.append(FilmState(pressure, film.gap, result, film.problem))
        return CoupledState(films, point.motion)


def _block(place: FilmPlace, dense_limit: int, prefix: str) -> FilmBlock:
    film = place.film.film
    symmetric = film.parameters.lubricant.linear
    if len(film.free) <= dense_limit:
        return DenseFilm(symmetric=symmetric)
    return SparseFilm(
        PartitionedSystem(
            film.assembly.pattern,
            weighted=film.equation.weights is not None,
            symmetric=symmetric,
            comm=MPI.COMM_SELF,
            options_prefix=prefix,
        )
    )
