"""One implicit step of a mechanism and its film, by SNES-VI on pressures and coordinates at once.

Pressures are bounded below by zero, coordinates are free: complementarity and motion converge
in one iteration, quadratically on the partition that SNES-VI settles on. It stops when what is
left of the Newton update changes the gap by less than the tolerance of the step, relative, and
the film's complementarity holds to the same tolerance, relative to its source, both in the
maximum norm. A factorisation serves as long as the partition stays
and the updates shrink fast.

Full updates may lead from one partition to another and back: few residual patterns, hardly damped,
resist a short step far more than the oil does. A step that failed is tried again with half of
every update as long as the partition changes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_ehd.errors import CavitationError, SolverError
from fenics_ehd.film import FilmState
from fenics_ehd.film.cavitation import CavitationResult, verify_complementarity
from fenics_ehd.film.snes_vi import SnesVi
from fenics_ehd.multibody.bordered import BorderedSystem, SparseSystem
from fenics_ehd.multibody.coupled_equations import CoupledEquations, Point
from fenics_ehd.multibody.dense_system import DENSE_LIMIT, DenseSystem
from fenics_ehd.multibody.equations import Mechanism
from fenics_ehd.multibody.newton import BOUNDARY_FRACTION, Attempt, ImplicitStep

#: Iterations of one step. Those that converge need one to five.
MAX_ITERATIONS = 25

#: A factorisation is kept for another iteration when the last update shrank by this.
CONTRACTION = 0.1

#: Derivatives are kept for another partition when the last update changed the gap by no more
#: than this, relative, and shrank by this.
NEAR, SHRINKING = 0.05, 0.3

#: Iterations of a step that failed so, and the part of an update that they take as long as the
#: partition changes.
PATIENT_ITERATIONS, DAMPING = 100, 0.5

#: Tolerance below which round-off is met.
FINEST = 1e-11

#: Dimensionless pressure that SNES-VI takes for zero.
ZERO_PRESSURE = 1e-14


@dataclass(frozen=True, eq=False)
class CoupledState:
    """Film and mechanism at the end of a step.

    Attributes
    ----------
    film
        Solution of the film.
    mechanism
        What the mechanism knows, `Equations.state`.
    """

    film: FilmState
    mechanism: Any


@dataclass(frozen=True, eq=False)
class PressureMemory:
    """Nodal pressures [Pa] at the last one or two steps, newest first, to extrapolate from."""

    times: np.ndarray
    pressures: np.ndarray

    def extrapolated(self, time: float) -> np.ndarray:
        """Pressures on the line through the last two steps, not negative."""
        if len(self.times) == 1:
            return self.pressures[0]
        share = (time - self.times[0]) / (self.times[0] - self.times[1])
        return np.maximum((1 + share) * self.pressures[0] - share * self.pressures[1], 0.0)

    @classmethod
    def after(
        cls, memory: PressureMemory | None, time: float, pressure: np.ndarray
    ) -> PressureMemory:
        """With the pressures of one more step."""
        if memory is None:
            return cls(np.array([time]), pressure[None])
        return cls(np.array([time, memory.times[0]]), np.stack([pressure, memory.pressures[0]]))


class CoupledSteps:
    """Solves the steps of one mechanism: a `StepSolver`.

    Parameters
    ----------
    mechanism
        With the film in its journal, an oil of constant density.
    options_prefix
        Of SNES-VI.
    dense_limit
        Free film nodes up to which film and mechanism are one dense matrix.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        *,
        options_prefix: str = "film_",
        dense_limit: int = DENSE_LIMIT,
    ):
        film = mechanism.journal.film
        pattern = film.assembly.pattern
        self._system: BorderedSystem
        dense = len(film.free) <= dense_limit
        if dense:
            self._system = DenseSystem(pattern)
        else:
            self._system = SparseSystem(
                pattern,
                weighted=film.equation.weights is not None,
                symmetric=film.parameters.lubricant.linear,
                options_prefix=f"{options_prefix}partition_",
            )
        self.equations = CoupledEquations(mechanism, dense_patterns=dense)
        self._m, self._n = self.equations.m, self.equations.n
        self._prefix = options_prefix
        self._snes = self._solver(MAX_ITERATIONS)

    @cached_property
    def _patient(self) -> SnesVi:
        return self._solver(PATIENT_ITERATIONS)

    def _solver(self, iterations: int) -> SnesVi:
        return SnesVi(
            self,
            np.concatenate([np.zeros(self._m), np.full(self._n, -np.inf)]),
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

    def __call__(self, problem: Any, step: ImplicitStep, memory: PressureMemory | None) -> Attempt:
        """Solve one step; `problem` is the mechanism."""
        self._tolerance = max(step.tolerance, FINEST)
        self._iterations = 0
        self.equations.begin(step)
        try:
            iterations = self._solve(self._start(step, memory))
            state = self._state()
        except SolverError as error:
            failure = f"{type(error).__name__}: {error}"
            return Attempt(max(1, self._iterations), failure, cause=error)
        remembered = PressureMemory.after(memory, step.time, state.film.pressure)
        return Attempt(iterations, None, self.equations.state(self._point), state, remembered)

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
        self._full = np.empty(0, dtype=np.int32)
        self._size, self._fraction, self._contracts = np.inf, 1.0, False
        self._close = False
        self._damping, self._settled = damping, False

    def _start(self, step: ImplicitStep, memory: PressureMemory | None) -> np.ndarray:
        """First iterate: extrapolated, as far as the gap stays open."""
        before, predicted = step.watched
        closing = 1.0 - float((predicted / before).min())
        fraction = min(1.0, BOUNDARY_FRACTION / closing) if closing > 0.0 else 1.0
        x = step.start + fraction * (step.predicted - step.start)
        pressure = np.zeros(self.equations.film.assembly.size)
        if memory is not None:
            pressure = memory.extrapolated(step.time)
        return self.equations.unknowns(pressure, x[: self._n])

    # --- Called by SNES-VI during a solve.

    def function(self, x: np.ndarray) -> np.ndarray:
        """See `VariationalInequality`."""
        self._point: Point = self.equations.evaluate(x)
        return np.concatenate([self._point.film, self._point.motion])

    def linearise(self, x: np.ndarray) -> None:
        """See `VariationalInequality`: derivatives are made for a partition, when it is known."""

    def factorise(self, nodes: np.ndarray) -> None:
        """See `VariationalInequality`."""
        full = nodes[nodes < self._m]
        self._settled = np.array_equal(full, self._full)
        if self._contracts and self._settled:
            return
        if not (self._close and self._system.repartition(full)):
            self._system.factorise(self.equations.linearise(self._point), full)
        self._full = full

    def update(self, rhs: np.ndarray) -> np.ndarray:
        """See `VariationalInequality`; shortened where it would close the gap."""
        self._iterations += 1
        k = len(rhs) - self._n
        film = np.zeros(self._m)
        film[self._full] = rhs[:k]
        pressures, xi = self._system.solve(film, rhs[k:])
        closing = self.equations.relative_gap_change(self._point, pressures, xi)
        former, self._size = self._size, float(np.abs(closing).max())
        self._contracts = self._size <= CONTRACTION * former
        self._close = self._size <= min(NEAR, SHRINKING * former)
        largest = float(closing.max())
        self._fraction = min(1.0, BOUNDARY_FRACTION / largest) if largest > 0 else 1.0
        if not self._settled:
            self._fraction *= self._damping
        return self._fraction * np.concatenate([pressures[self._full], xi])

    def converged(self, iteration: int) -> bool:
        """See `SelfJudging`: what is left of the update is small, by the last derivatives."""
        if not iteration or self._fraction < 1.0:
            return False
        point = self._point
        pressures = point.nodal[self.equations.film.free]
        # Elsewhere pressure is zero and the flux positive: nothing is left to do.
        unsettled = (pressures > ZERO_PRESSURE) | (point.film < 0.0)
        film = np.where(unsettled, point.film, 0.0)
        if not np.abs(film).max(initial=0.0) <= self._tolerance:
            return False
        left = self.equations.relative_gap_change(point, *self._system.solve(film, point.motion))
        return bool(np.abs(left).max() <= self._tolerance)

    def _state(self) -> CoupledState:
        """The end of the step, its film verified."""
        point, film = self._point, self.equations.film
        free, flux = point.nodal[film.free], point.film * self.equations.scale
        verify_complementarity(free, flux, self.equations.scale, 10 * self._tolerance)
        result = CavitationResult(free, flux, self._full.astype(np.int32), self._iterations)
        pressure = film.parameters.pressure_scale * point.nodal
        state = FilmState(pressure, point.gap, result, point.problem)
        return CoupledState(state, point.equations.state)
