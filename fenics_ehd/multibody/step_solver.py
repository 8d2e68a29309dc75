"""One implicit step of a mechanism by SNES-VI, on all films' pressures and all coordinates at once.

Pressures are bounded below by zero, coordinates are free: complementarity and motion converge
in one iteration, quadratically on the active set that SNES-VI settles on. It stops when what is
left of the Newton update changes the gaps by less than the tolerance of the step, relative, the
coordinates by less than that in the norm of the step control, and every film's complementarity
holds to the same tolerance, relative to its source, or to round-off of its flow; all in the
maximum norm. A factorisation serves as long as the active set stays, the updates shrink fast, and
balances of conserved oil hold, whose transport is not linear.

Full updates may lead from one active set to another and back: few residual patterns, hardly
damped, resist a short step far more than the oil does. A step that failed is tried again with
half of every update as long as the active set changes.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from fenics_ehd.base.errors import CavitationError, SolverError
from fenics_ehd.film import FilmState
from fenics_ehd.film.cavitation import CavitationResult, verify_complementarity
from fenics_ehd.film.snes_vi import SnesVi
from fenics_ehd.multibody.implicit_step import BOUNDARY_FRACTION, Attempt, ImplicitStep, Solved
from fenics_ehd.multibody.solver_state import CoupledState, SolverState
from fenics_ehd.multibody.step_equations import Point, StepEquations
from fenics_ehd.multibody.step_factors import LEADING, StepFactors
from fenics_ehd.multibody.step_norm import StepNorm
from fenics_ehd.multibody.system import System
from fenics_ehd.multibody.thickening import told_apart

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

#: Tolerance below which round-off is met.
FINEST = 1e-11

#: Round-off of a film's balances over the largest flow that squeezes empty nodes, 4e-13 in a film
#: of 697 nodes: oil as thin as air flows 1e8 times as fast as the source that it is compared with.
ROUND_OFF = 1e-11

#: Dimensionless pressure that SNES-VI takes for zero.
ZERO_PRESSURE = 1e-14

#: Free film nodes up to which a dense factorisation is faster.
DENSE_LIMIT = 700


class CoupledSteps:
    """Solves the steps of one mechanism: a `StepSolver`.

    Parameters
    ----------
    system
        The mechanism.
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
        sizes, voids = self.equations.sizes, self.equations.voids
        self._ends = np.cumsum([0, *sizes])
        self._rest = int(self._ends[-1]) + sum(sizes[i] for i in voids)
        self._factors = StepFactors(
            self.equations, dense_limit=dense_limit, options_prefix=options_prefix
        )
        self._snes = self._solver(MAX_ITERATIONS)

    @cached_property
    def _patient(self) -> SnesVi:
        return self._solver(PATIENT_ITERATIONS)

    def _solver(self, iterations: int) -> SnesVi:
        free = np.full(self._rest - self._ends[-1] + self.equations.rest_size, -np.inf)
        return SnesVi(
            self,
            np.concatenate([np.zeros(self._ends[-1]), free]),
            options_prefix=self._prefix,
            tolerance=None,
            max_iterations=iterations,
        )

    @property
    def solves(self) -> int:
        """Solves by SNES-VI so far."""
        patient = self.__dict__.get("_patient")
        return self._snes.solves + (patient.solves if patient else 0)

    def pattern(self) -> dict[str, Any]:
        """Names, types and shapes of what it remembers, for `require_like`."""
        nodes = sum(place.film.film.assembly.size for place in self.system.films)
        voids = self._rest - int(self._ends[-1])
        values = np.zeros((1, nodes + voids + 2 * self.system.m))
        return vars(SolverState(np.zeros(1), values, LEADING))

    def __call__(
        self, problem: StepNorm, step: ImplicitStep, former: SolverState | None
    ) -> Attempt:
        """Solve one step; `problem` judges errors."""
        self._problem, self._tolerance = problem, max(step.tolerance, FINEST)
        self._iterations = 0
        self._factors.begin(problem, LEADING if former is None else former.patterns)
        self.equations.begin(step)
        try:
            iterations = self._solve(self._start(step, former))
            state = self._state()
        except SolverError as caught:
            error = told_apart(caught, self.system.films, former)
            failure = f"{type(error).__name__}: {error}"
            return Attempt(max(1, self._iterations), failure=failure, cause=error)
        point = self._point
        values = [film.pressure for film in state.films]
        for i in self.equations.voids:
            oil_point = point.films[i].oil
            assert oil_point is not None
            values[i] = self.equations.oil(i).as_pressures(oil_point)
            values.append(oil_point.void)
        kept = SolverState.after(
            former,
            step.time,
            np.concatenate([*values, point.multipliers, point.drift]),
            self._factors.patterns_wanted,
        )
        x, rate = self.equations.state(point)
        return Attempt(iterations, Solved(x, rate, state, kept))

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
        self._full = [np.empty(0, dtype=np.int32) for _ in self.system.films]
        self._factors.forget()
        self._close = False
        self._size, self._fraction, self._contracts = np.inf, 1.0, False
        self._damping, self._settled = damping, False

    def _start(self, step: ImplicitStep, former: SolverState | None) -> np.ndarray:
        """First iterate: extrapolated, as far as the gaps stay open."""
        before, predicted = (self._problem.gaps(observed) for observed in step.observed)
        closing = self._problem.closing(before, predicted)
        fraction = min(1.0, BOUNDARY_FRACTION / closing) if closing > 0.0 else 1.0
        x = step.start + fraction * (step.predicted - step.start)
        system, start = self.system, []
        values = None if former is None else former.extrapolated(step.time)
        place = 0
        for film, oil, count in zip(
            (place.film.film for place in system.films),
            self.equations.oils,
            self.equations.sizes,
            strict=True,
        ):
            size = film.assembly.size
            if values is None:
                start.append(np.zeros(count))
            else:
                nodal = np.maximum(values[place : place + size], 0.0)
                nodes = film.free if oil is None else oil.nodes
                start.append(nodal[nodes] / film.parameters.pressure_scale)
            place += size
        for i in self.equations.voids:
            size = self.equations.sizes[i]
            if values is None:
                start.append(self.equations.oil(i).fractions(step.start))
            else:
                start.append(np.maximum(values[place : place + size], 0.0))
                place += size
        multipliers = np.zeros(2 * system.m) if values is None else values[place:]
        return np.concatenate([*start, x[: system.n], multipliers])

    def _split(
        self, values: np.ndarray
    ) -> tuple[list[np.ndarray], np.ndarray, dict[int, np.ndarray]]:
        """Pressures of every film, the other unknowns, and void fractions of some films."""
        films = [values[first:last] for first, last in pairwise(self._ends)]
        return films, values[self._rest :], self._voids(values[self._ends[-1] : self._rest])

    def _voids(self, values: np.ndarray) -> dict[int, np.ndarray]:
        """Values of all nodes of films with void fractions, by the film's number."""
        found, place = {}, 0
        for i in self.equations.voids:
            found[i] = values[place : place + self.equations.sizes[i]]
            place += self.equations.sizes[i]
        return found

    # --- Called by SNES-VI during a solve.

    def function(self, x: np.ndarray) -> np.ndarray:
        """See `VariationalInequality`."""
        # PETSc writes to its array again; a point lasts.
        self._point: Point = self.equations.evaluate(*self._split(x.copy()))
        defects = [film.defect for film in self._point.films]
        oils = [film.oil.defect for film in self._point.films if film.oil is not None]
        return np.concatenate([*defects, *oils, self._point.rest])

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
        if self._contracts and self._settled and self._factors.known and self._oils_settled():
            return
        if not (self._close and self._factors.change(full)):
            self._factors.factorise(self._point, full)

    def _oils_settled(self) -> bool:
        """Whether the balances of all films that conserve their oil hold."""
        return all(
            film.oil is None or self.equations.oil(i).settled(film.oil, self._tolerance)
            for i, film in enumerate(self._point.films)
        )

    def update(self, rhs: np.ndarray) -> np.ndarray:
        """See `VariationalInequality`; shortened where it would close a gap."""
        self._iterations += 1
        films, place = [], 0
        for full, size in zip(self._full, self.equations.sizes, strict=True):
            film = np.zeros(size)
            film[full] = rhs[place : place + len(full)]
            films.append(film)
            place += len(full)
        rest = place + self._rest - self._ends[-1]
        voids = {}
        for i, defect in self._voids(rhs[place:rest]).items():
            films[i], voids[i] = self._given(i, films[i], defect)
        former = self._size
        found = self._factors.update(self._point, self._full, films, rhs[rest:])
        self._size, closing = found.size, found.closing
        self._contracts = self._size <= CONTRACTION * former
        self._close = self._size <= min(NEAR, SHRINKING * former)
        self._fraction = min(1.0, BOUNDARY_FRACTION / closing) if closing > 0 else 1.0
        if not self._settled:
            self._fraction *= self._damping
        inner = [p[full] for p, full in zip(found.pressures, self._full, strict=True)]
        for i, void in voids.items():
            changes = found.pressures[i].copy()
            changes[self._full[i]] = void[self._full[i]]
            inner.append(changes)
        return self._fraction * np.concatenate([*inner, found.rest])

    def _given(
        self, i: int, pressures: np.ndarray, defect: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `ConservedOil.given`."""
        point = self._point.films[i].oil
        assert point is not None
        return self.equations.oil(i).given(point, self._full[i], pressures, defect)

    def converged(self, iteration: int) -> bool:
        """See `SelfJudging`: what is left of the update is small, by the last derivatives."""
        if not iteration or self._fraction < 1.0 or not self._oils_settled():
            return False
        point, films = self._point, []
        for i, (place, film) in enumerate(zip(self.system.films, point.films, strict=True)):
            if film.oil is not None:
                films.append(self._given(i, film.defect, film.oil.defect)[0])
                continue
            pressures = film.nodal[place.film.film.free]
            # Elsewhere pressure is zero and the flux positive: nothing is left to do.
            unsettled = (pressures > ZERO_PRESSURE) | (film.defect < 0.0)
            defect = np.where(unsettled, film.defect, 0.0)
            if not np.abs(defect).max(initial=0.0) <= self._limit(film.defect):
                return False
            films.append(defect)
        return self._factors.solve(point, films, point.rest).size <= self._tolerance

    def _limit(self, defect: np.ndarray) -> float:
        """Complementarity that counts as met, relative to the source; see the module."""
        return max(self._tolerance, ROUND_OFF * float(np.abs(defect).max(initial=0.0)))

    def _state(self) -> CoupledState:
        """The end of the step, its films verified."""
        point = self._point
        films: list[FilmState] = []
        for i, (place, film) in enumerate(zip(self.system.films, point.films, strict=True)):
            if film.oil is not None:
                found = self._full[i], self._iterations
                oil = self.equations.oil(i)
                films.append(oil.state(film, film.oil, found, self._tolerance))
                continue
            scale = self.equations.scales[i]
            free, flux = film.nodal[place.film.film.free], film.defect * scale
            verify_complementarity(free, flux, scale, 10 * self._limit(film.defect))
            result = CavitationResult(free, flux, self._full[i].astype(np.int32), self._iterations)
            pressure = place.film.film.parameters.pressure_scale * film.nodal
            films.append(FilmState(pressure, film.gap, result, film.problem))
        return CoupledState(films, point.motion, self.equations.integrals(films))
