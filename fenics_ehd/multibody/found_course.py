"""Collects the course of what is solved beside a run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_ehd.film import FilmState
from fenics_ehd.multibody.bdf import Step
from fenics_ehd.multibody.between_nodes import BetweenNodes, extremes
from fenics_ehd.multibody.course import Course
from fenics_ehd.multibody.solver_state import CoupledState, SolverState
from fenics_ehd.multibody.step_norm import StepNorm
from fenics_ehd.multibody.step_solver import CoupledSteps


class FoundCourse:
    """Steps of a mechanism, one by one.

    Parameters
    ----------
    solve, norm
        Of the mechanism.
    between
        Of every film.
    """

    def __init__(self, solve: CoupledSteps, norm: StepNorm, between: Sequence[BetweenNodes]):
        self._norm, self._multipliers = norm, 2 * solve.system.m
        self._between = between
        self._size = solve.system.n + solve.equations.responses.size
        self._voids = solve.equations.voids
        self._rows: list[tuple[np.ndarray | float, ...]] = []
        self._films: list[list[FilmState]] = []
        self._gaps: list[list[np.ndarray]] = []

    def add(
        self,
        step: Step[CoupledState],
        solver: SolverState,
        changes: Sequence[np.ndarray | float] | None,
    ) -> None:
        """Account for a step in gaps with some changes."""
        gaps, films = self._norm.film_gaps(step.observed), step.solution.films
        if changes is not None:
            gaps = [gap + change for gap, change in zip(gaps, changes, strict=True)]
        self._films.append(films)
        self._gaps.append(
            [gap[-len(film.pressure) :] for gap, film in zip(gaps, films, strict=True)]
        )
        multipliers = solver.values[0][len(solver.values[0]) - self._multipliers :]
        x, acceleration = step.x[: self._size], step.acceleration[: self._size]
        self._rows.append((step.time, x, multipliers, acceleration))

    def course(self) -> Course:
        """All of them."""
        times, x, multipliers, acceleration = map(np.array, zip(*self._rows, strict=True))
        gaps = [np.array(gap) for gap in zip(*self._gaps, strict=True)]
        films = list(zip(*self._films, strict=True))
        pressures = [np.array([state.pressure for state in film]) for film in films]
        voids = {
            i: 1.0 - np.array([state.fluid_fraction for state in films[i]]) for i in self._voids
        }
        return Course(
            times,
            x,
            pressures,
            voids,
            *extremes(self._between, pressures, gaps),
            multipliers,
            acceleration,
        )
