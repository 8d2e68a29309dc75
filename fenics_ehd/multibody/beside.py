"""Steps of a mechanism beside those of a run: at chosen times of its course, which is the guess.

What differs, the length of the steps, the mesh of a film or the shape of a gap, changes little, and
what it has changed so far is added to the guess. Newton then takes hardly more than an iteration a
step, and errors travel along the motion as those of the run do.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from scipy import sparse

from fenics_ehd.base.errors import StepSizeError
from fenics_ehd.film import FilmGrid
from fenics_ehd.multibody.bdf import IntegratorState, Step, StepControl
from fenics_ehd.multibody.between_nodes import BetweenNodes
from fenics_ehd.multibody.course import Course
from fenics_ehd.multibody.differentiation import blended
from fenics_ehd.multibody.disturbance import Disturbance
from fenics_ehd.multibody.found_course import FoundCourse
from fenics_ehd.multibody.solver_state import CoupledState, SolverState
from fenics_ehd.multibody.step_factors import LEADING
from fenics_ehd.multibody.step_norm import StepNorm
from fenics_ehd.multibody.step_solver import CoupledSteps

#: Newton stops when what is left of its update is below so many tolerances of a step, but not above
#: this where that tolerance is smaller: of differences that are looked for it is little.
SETTLED, LITTLE = 5.0, 5e-4

#: Largest growth of a step: from one step of the run to two, which grow themselves. Formulas of
#: order two are zero-stable below 2.41.
LONGEST = 2.4

#: Slack in taking a time of the course for that of a table's row, share of the step.
NEAR_ROW = 1e-2


class Beside:
    """Takes steps along the course of a run.

    Parameters
    ----------
    solve
        Of the mechanism, or one that differs from it by its films' meshes.
    control
        Of the run.
    grids
        Of the films of the course's pressures.

    Attributes
    ----------
    iterations
        Of Newton's so far.
    corners
        Times after which steps began anew.
    """

    def __init__(self, solve: CoupledSteps, control: StepControl, grids: Sequence[FilmGrid]):
        self._solve, self._control = solve, control
        self._norm = StepNorm(solve.equations)
        system = solve.system
        self._own = [place.film.film.parameters.grid for place in system.films]
        self._read: list[sparse.csr_matrix | None] = [
            None if own is given else given.interpolation(*own.node_positions.T)
            for own, given in zip(self._own, grids, strict=True)
        ]
        self._between = [BetweenNodes(own) for own in self._own]
        self.iterations = 0
        self.corners: set[float] = set()

    def follow(
        self,
        state: IntegratorState[SolverState],
        course: Course,
        stride: int,
        disturbance: Disturbance | None = None,
        corners: Collection[float] | None = None,
    ) -> Course:
        """Steps from a state along a course, which begins after it.

        Parameters
        ----------
        state
            Of the integration.
        course
            Of the run.
        stride
            Steps of the course in one, where they grow slowly and no table has a row.
        disturbance
            Of the gaps.
        corners
            Times after which steps begin anew, as those that this is compared with; None: at rows
            of tables that a step would miss.

        Raises
        ------
        StepSizeError
            There is no solution near the course.
        """
        guess = _Guess(self, course)
        found = FoundCourse(self._solve, self._norm, self._between)
        row, past = -1, float(state.times[0] - state.times[1]) if len(state.times) > 1 else 0.0
        last = len(course.times) - 1
        while row < last:
            if corners is None:
                ahead, corner = self._next(state, course, row, stride, past)
            else:
                ahead = min(row + stride, last)
                corner = float(course.times[ahead]) in corners
            step = None
            while step is None:
                step = self._step(state, guess, ahead, disturbance)
                if step is None and ahead == row + 1:
                    raise StepSizeError(
                        f"no step from t = {state.time:.6g} s beside those of the run"
                    )
                if step is None:
                    ahead, corner = row + 1, False
            new, solver = step
            past = new.time - state.time
            if corner:
                self.corners.add(new.time)
            keep = 1 if corner else self._control.order + 2
            state = state.after(new, past, solver, keep)
            guess.learn(ahead, new, solver)
            changes = None if disturbance is None else disturbance.observed_at(ahead)
            found.add(new, solver, changes)
            row = ahead
        return found.course()

    def _next(
        self,
        state: IntegratorState[SolverState],
        course: Course,
        row: int,
        stride: int,
        past: float,
    ) -> tuple[int, bool]:
        """Row of the course to step to, and whether a table's row ends the step."""
        control, times = self._control, course.times
        order = state.usable_order(control.order)
        ahead = min(row + stride, len(times) - 1)
        most = LONGEST * past
        while ahead > row + 1 and times[ahead] - state.time > most:
            ahead -= 1
        if not self._solve.system.tables:
            return ahead, False
        if ahead > row + 1 and self._reach(state, order, float(times[ahead])) < times[ahead]:
            ahead = row + 1
        if ahead > row + 1:
            return ahead, False
        # The run begins anew at a row that it could not step over.
        step = float(times[ahead]) - state.time
        beyond = state.time + 2.0 * step
        reached = self._reach(state, order, beyond)
        return ahead, bool(reached < beyond and abs(reached - times[ahead]) <= NEAR_ROW * step)

    def _reach(self, state: IntegratorState[SolverState], order: int, time: float) -> float:
        """The time, or that of the last row of a table before it that a step must not miss [s]."""
        nearest, tables = self._control.smallest_step, self._solve.system.tables
        return state.reach(self._norm, tables, time, order, nearest)

    def _step(
        self,
        state: IntegratorState[SolverState],
        guess: _Guess,
        row: int,
        disturbance: Disturbance | None,
    ) -> tuple[Step[CoupledState], SolverState] | None:
        control = self._control
        time = float(guess.course.times[row])
        order = state.usable_order(control.order)
        formula = blended(time, state.times, order, control.blend)
        limit = min(SETTLED * control.tolerance, LITTLE)
        asked = state.implicit_step(self._norm, time, formula, order, limit)
        x, values = guess.at(row)
        predicted = np.concatenate([x, asked.predicted[len(x) :]])
        observed = asked.observed[0], self._norm.observe(predicted)
        asked = replace(asked, predicted=predicted, observed=observed)
        former = SolverState(np.array([time]), values[None], guess.patterns)
        equations = self._solve.equations
        equations.disturbance = None if disturbance is None else disturbance.at(row)
        try:
            attempt = self._solve(self._norm, asked, former)
        finally:
            equations.disturbance = None
        self.iterations += attempt.iterations
        if attempt.solved is None:
            return None
        solved = attempt.solved
        acceleration = asked.acceleration(solved.rate)
        step = Step(
            time,
            solved.x,
            solved.rate,
            acceleration,
            self._norm.observe(solved.x),
            solved.solution,
            attempt.iterations,
        )
        return step, solved.solver

    def read(self, i: int, values: np.ndarray) -> np.ndarray:
        """Nodal values of a film of the course on this film's own nodes."""
        matrix = self._read[i]
        return values if matrix is None else matrix @ values

    @property
    def voids(self) -> dict[int, np.ndarray]:
        """Nodes with unknowns of the films that keep account of their oil, by their numbers."""
        equations = self._solve.equations
        return {i: equations.oil(i).nodes for i in equations.voids}

    @property
    def multipliers(self) -> int:
        """Their number on both levels."""
        return 2 * self._solve.system.m


class _Guess:
    """The next point: that of the course, and what differed from it at the last one."""

    def __init__(self, beside: Beside, course: Course):
        self.course, self._beside = course, beside
        self.patterns = LEADING
        self._x: np.ndarray | float = 0.0
        self._pressures: list[np.ndarray | float] = [0.0] * len(course.pressures)
        self._voids: dict[int, np.ndarray | float] = dict.fromkeys(course.voids, 0.0)
        self._multipliers: np.ndarray = np.zeros(beside.multipliers)

    def _read(self, row: int) -> tuple[list[np.ndarray], dict[int, np.ndarray]]:
        course, read = self.course, self._beside.read
        pressures = [read(i, values[row]) for i, values in enumerate(course.pressures)]
        return pressures, {i: read(i, values[row]) for i, values in course.voids.items()}

    def at(self, row: int) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates with patterns, and values as a `SolverState` has them."""
        pressures, voids = self._read(row)
        # Where the course cavitates there is no pressure, whatever differed there a step ago.
        values = [
            np.where(own > 0.0, own + more, 0.0)
            for own, more in zip(pressures, self._pressures, strict=True)
        ]
        for i, nodes in self._beside.voids.items():
            values.append(np.clip(voids[i] + self._voids[i], 0.0, 1.0)[nodes])
        multipliers = self._multipliers
        if len(self.course.multipliers):
            multipliers = self.course.multipliers[row] + multipliers
        return self.course.x[row] + self._x, np.concatenate([*values, multipliers])

    def learn(self, row: int, step: Step[CoupledState], solver: SolverState) -> None:
        """Take the solution at a point."""
        course, films = self.course, step.solution.films
        pressures, voids = self._read(row)
        self.patterns = solver.patterns
        self._x = step.x[: course.x.shape[1]] - course.x[row]
        self._pressures = [film.pressure - own for film, own in zip(films, pressures, strict=True)]
        for i, own in voids.items():
            fraction = films[i].fluid_fraction
            assert fraction is not None
            self._voids[i] = 1.0 - fraction - own
        self._multipliers = solver.values[0][-self._beside.multipliers :]
        if len(course.multipliers):
            self._multipliers = self._multipliers - course.multipliers[row]
