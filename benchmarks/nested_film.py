"""The obvious formulation of a lubricated mechanism: the film solved within every evaluation.

`fenics_ehd.multibody.newton` solves pressures and coordinates together. Here pressures are
a function of coordinates and rates, made by a whole solution of every film, and Newton's method
is left with coordinates and multipliers alone. Tests and benchmarks use it as the independent
way to solve a step.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

import fenics_ehd as ehd
from fenics_ehd.film.film import FilmState
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.multibody.bdf import BOUNDARY_FRACTION, Attempt, ImplicitStep, Solved
from fenics_ehd.multibody.newton import CoupledState
from fenics_ehd.multibody.quantities import joint_steps
from fenics_ehd.multibody.run import IntegratorOptions, Run
from fenics_ehd.multibody.step_equations import Point, StepEquations

MAX_NEWTON = 12


class GapChange(NamedTuple):
    """Changes of a `Gap` in n directions, each (cells, points, n); the last None for none."""

    thickness: np.ndarray
    thickness_rate: np.ndarray
    mean_velocity: np.ndarray
    sliding_velocity: np.ndarray | None = None


def residual_change(film: ehd.Film, gap: Gap, nodal: np.ndarray, change: GapChange) -> np.ndarray:
    """Change of a film's residual, its nodal pressures held, shape (nodes, n)."""
    thickness, rate, mean, sliding = (
        None if own is None else own.reshape(gap.thickness.size, -1) for own in change
    )
    # Two shifts tell the thickness from its rate.
    shift = film.parameters.rate
    still, along_mean, along_sliding = film.equation.gap_derivatives(gap, nodal)
    following, *_ = film.equation.gap_derivatives(gap, nodal, shift)
    total: np.ndarray = still @ thickness + (following - still) @ rate / shift + along_mean @ mean
    if along_sliding is not None and sliding is not None:
        total += along_sliding @ sliding
    return total


def pressure_derivative(film: ehd.Film, state: FilmState, derivatives: GapChange) -> np.ndarray:
    """Derivative of a solved film's nodal pressures along n changes of the gap, (nodes, n) [Pa].

    The active set held: with ``A`` the residual's derivative and W its weights, the pressures of
    the full nodes I and the defects of the others C answer a change of the residual by
    ``A_I dp_I - W_C dy_C = -dr``.
    """
    scale, pattern = film.parameters.pressure_scale, film.equation.pattern
    problem = film.equation.problem(state.gap)
    change = residual_change(film, state.gap, state.pressure / scale, derivatives)[film.free]
    full = np.zeros(pattern.size, dtype=bool)
    full[state.cavitation.full_film] = True
    matrix = pattern.matrix(problem.entries(state.cavitation.pressure)).toarray()
    weights = np.eye(pattern.size)
    if problem.weights is not None:
        weights = pattern.matrix(problem.weights).toarray()
    answer = np.linalg.solve(np.where(full, matrix, -weights), -change)
    found = np.zeros((film.assembly.size, change.shape[1]))
    found[film.free[full]] = scale * answer[full]
    return found


class NestedSteps:
    """A `StepSolver` of mechanisms without residual patterns, by Newton's method.

    Parameters
    ----------
    equations
        Of the mechanism.
    """

    def __init__(self, equations: StepEquations):
        assert not equations.responses.size
        self.equations, self.system = equations, equations.system

    def evaluate(
        self, rest: np.ndarray, guesses: list[FilmState | None]
    ) -> tuple[Point, list[FilmState]]:
        """All equations at ``(z, l, m)`` with the pressures that belong to it."""
        # Without patterns a gap does not depend on pressures.
        u = np.zeros(len(self.equations.lower))
        u[self.equations.rest] = rest
        point, films = self.equations.evaluate(u), self.equations.films
        found = [
            film.film.solve(own.gap, guess)
            for film, own, guess in zip(films, point.films, guesses, strict=True)
        ]
        for film, own, state in zip(films, self.equations.film_indices, found, strict=True):
            u[own] = film.unknowns(state.pressure)
        return self.equations.evaluate(u), found

    def jacobian(self, point: Point, films: list[FilmState], shift: float) -> np.ndarray:
        """Total derivative of motion and constraints along ``(z, l, m)``."""
        derivative = self.equations.linearise(point)
        jacobian = derivative.core
        for place, border, state in zip(self.system.films, derivative.films, films, strict=True):
            film = place.film
            shape = (*film.film.points.angle.shape, -1)
            unmoved = np.zeros((len(film.thickness), 1))
            turning = np.full_like(unmoved, 0.5 * film.shaft_radius)
            thickness = np.hstack([film.thickness, unmoved])
            velocity = np.hstack([shift * film.mean_velocity, turning])
            slopes = (thickness, shift * thickness, velocity)
            changes = GapChange(*(s.reshape(shape) for s in slopes))
            answer = pressure_derivative(film.film, state, changes)
            jacobian[place.xi] -= film.load @ answer @ border.spread
        return jacobian

    def __call__(self, problem: Any, step: ImplicitStep, former: Any) -> Attempt:
        """Solve one step; `problem` judges errors."""
        self.equations.begin(step)
        system, n = self.system, self.system.n
        guesses, multipliers = former or ([None] * len(system.films), np.zeros(2 * system.m))
        change = step.predicted - step.start
        fraction = _open(*(problem.gaps(observed) for observed in step.observed))
        rest = np.concatenate([step.start + fraction * change, multipliers])
        for iteration in range(1, MAX_NEWTON + 1):
            try:
                point, films = self.evaluate(rest, guesses)
                update = -np.linalg.solve(self.jacobian(point, films, step.shift), point.rest)
            except (ehd.errors.SolverError, np.linalg.LinAlgError) as error:
                return Attempt(iteration, cause=error)
            guesses = films
            observed, moved = problem.observe(rest[:n]), problem.observe(rest[:n] + update[:n])
            fraction = _open(problem.gaps(observed), problem.gaps(moved))
            rest = rest + fraction * update
            small = problem.error_norm(observed, moved - observed) <= step.tolerance
            # One iteration would leave the films those of the prediction.
            if iteration > 1 and fraction == 1.0 and small:
                x, rate = self.equations.state(point)
                observed, motion = problem.observe(x), point.motion
                gaps = problem.film_gaps(observed)
                joints = joint_steps(self.equations, films, motion.multipliers, x, rate, gaps)
                found = CoupledState(joints, motion)
                return Attempt(iteration, Solved(x, rate, observed, found, (films, rest[n:])))
        failure = ehd.errors.SolverError(f"Newton did not converge in {MAX_NEWTON} iterations")
        return Attempt(MAX_NEWTON, cause=failure)


class NestedRun(Run):
    """A run whose steps are solved so."""

    def __init__(self, mechanism: ehd.Mechanism, steps: IntegratorOptions, span: float):
        super().__init__(mechanism, steps, span)
        self.solve: Any = NestedSteps(self.equations)


def _open(before: np.ndarray, after: np.ndarray) -> float:
    """Share of a change that leaves every gap open."""
    closing = 1.0 - float((after / before).min(initial=np.inf))
    return min(1.0, BOUNDARY_FRACTION / closing) if closing > 0.0 else 1.0
