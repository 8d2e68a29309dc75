"""Replay: another mechanism repeats the recorded steps of a run, or takes longer steps.

The solutions at the steps of a run are its trajectory. Errors and derivatives are differences
between this trajectory and the trajectory of a slightly different run: with longer steps, a finer
film, a gap with the flexibility that a basis lacks, a parameter that is one per cent larger, or
another start. A replay computes such a trajectory at chosen times. Newton's method starts from the
recorded solution, interpolated to the nodes of the other film, plus the difference at the previous
time,

    u_k = trajectory_k + (u_(k-1) - trajectory_(k-1)).

Newton's method then needs little more than one iteration per step. Errors grow and decay along the
motion as in the run. Since the steps are given, differences contain no noise of a step control.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, cast

import numpy as np
from scipy import sparse

from fenics_ehd.base.arguments import require_class, require_count
from fenics_ehd.base.errors import InputError, StepSizeError
from fenics_ehd.base.extremes import FilmRows
from fenics_ehd.base.progress import Progress, chosen_progress
from fenics_ehd.film.film import Film
from fenics_ehd.film.grid import FilmGrid, aligned_grid
from fenics_ehd.multibody.bdf import NEWTON_FRACTION, IntegratorState, Step
from fenics_ehd.multibody.history import History, fixed
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.newton import (
    FEWEST_PATTERNS,
    CoupledState,
    MechanismStep,
    SolverState,
)
from fenics_ehd.multibody.periodic import PeriodicSolver
from fenics_ehd.multibody.quantities import joints_row
from fenics_ehd.multibody.recorder import Recorder, history_of, solution
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.simulation import summarised_history

#: Ratio of the numbers of cells in `finer_grid` and in the given grid, in both directions. Most of
#: the error vanishes on the finer mesh, for all orders. Meshes half as fine show less: from 10 x 3
#: to 20 x 5 cells, errors of a rod's film fall to a thirty-fifth, those of a small pin to a third.
FINER = 1.5

#: Largest ratio of a step to the step before, for steps that combine several steps of the run.
#: Formulas of order two are zero-stable below 2.41.
LONGEST = 2.4

RunState = IntegratorState[SolverState]


@dataclass(frozen=True, eq=False)
class Trajectory(History):
    """A history that replays follow: solutions at ascending times after a start.

    If `recorded` made the trajectory, it also has the array ``state/accelerations``: accelerations
    of the coordinates and of the amplitudes of residual patterns, shape (k, n + r).

    Attributes
    ----------
    base
        Run that took the steps.
    start
        State before the first step.
    search
        Search for a periodic solution; the steps are its last cycle. None without a search.
    """

    base: Run = field(kw_only=True)
    start: RunState = field(kw_only=True)
    search: PeriodicSolver | None = field(default=None, kw_only=True)

    @property
    def period(self) -> float | None:
        """Period of the cycle [s]; None if the run is not periodic."""
        return None if self.search is None else self.search.period

    @property
    def began(self) -> float:
        """Time at the start of the first step [s]."""
        return self.start.time

    @cached_property
    def times(self) -> np.ndarray:
        """Times at the ends of the steps, shape (k,) [s]."""
        return np.asarray(self.values["time"])

    @cached_property
    def x(self) -> np.ndarray:
        """Coordinates and amplitudes of residual patterns at the steps, shape (k, n + r)."""
        return np.hstack([self.coordinates, self.quasi_static])

    def state(self, name: str) -> np.ndarray:
        """Array of the history by its name in the group ``state``, for instance ``multipliers``."""
        return np.asarray(self.values[f"state/{name}"])

    @cached_property
    def extremes(self) -> np.ndarray:
        """Peak pressure [Pa] and minimum film thickness [m] of every film at each of the k steps.

        The shape is (2, k, films). The extremes may lie between nodes, see
        `fenics_ehd.base.extremes`.
        """
        films = [joint.film for joint in self.joints.values()]
        each = [
            FilmRows.of(film.angle, film.height).film_extremes(film.pressure, film.gap)
            for film in films
        ]
        return np.array(each).transpose(1, 2, 0)

    def curves(self, columns: Sequence[str]) -> np.ndarray:
        """Extremes and further columns of every film at each of the k steps.

        The shape is (2 + n, k, films): the `extremes`, then the n `columns` by name with unit. A
        column that a joint does not have is zero.
        """
        joints = [joint.columns for joint in self.joints.values()]
        without = np.zeros(len(self.times))
        others = [[joint.get(name, without) for joint in joints] for name in columns]
        further = np.array(others).reshape(len(columns), len(joints), len(self.times))
        return np.concatenate([self.extremes, further.transpose(0, 2, 1)])

    def with_next(self, share: float) -> Trajectory:
        """The trajectory of a cycle, extended by the first part of the next cycle.

        The part is the fraction `share` of the period. It repeats the cycle, but angles of rotating
        bodies are larger by whole turns.
        """
        assert self.search is not None
        period = self.search.period
        angles = self.search.angles
        again = np.flatnonzero(self.times - (self.times[-1] - period) <= share * period)
        turns = np.zeros(self.coordinates.shape[1])
        turned = self.x[-1, angles] - self.start.x[0][angles]
        turns[angles] = 2 * np.pi * np.round(turned / (2 * np.pi))
        increase = {"time": period, "state/coordinates": turns}
        return self.changed(
            {
                path: np.concatenate([values, values[again] + increase.get(path, 0.0)])
                for path, values in self.values.items()
                if not fixed(path)
            }
        )

    def widened(self, changes: Sequence[np.ndarray]) -> Trajectory:
        """The trajectory with changes added to the gaps of all films.

        Parameters
        ----------
        changes
            Change of the gap of every film at its w observed points and the k steps, shape (k, w)
            [m].
        """
        gaps = {}
        for (name, joint), change in zip(self.joints.items(), changes, strict=True):
            nodal = np.asarray(joint.film.gap)
            gaps[f"joints/{name}/film/gap"] = nodal + change[:, -nodal.shape[1] :]
        return self.changed(gaps)

    def halved(self) -> Trajectory:
        """The trajectory with an additional point in the middle of each step."""
        n = self.coordinates.shape[1]
        size = self.x.shape[1]
        first = {
            "time": self.began,
            "state/coordinates": self.start.x[0][:n],
            "state/quasi_static": self.start.x[0][n:size],
        }

        def halved(values: np.ndarray, before: Any) -> np.ndarray:
            middles = 0.5 * (np.concatenate([[before], values[:-1]]) + values)
            if values.dtype == bool:  # there is no corner within a step
                middles = np.zeros_like(values)
            return np.stack([middles, values], axis=1).reshape(-1, *values.shape[1:])

        return self.changed(
            {
                path: halved(np.asarray(values), first.get(path, values[0]))
                for path, values in self.values.items()
                if not fixed(path)
            }
        )


def solved_run(history: History) -> Recorder:
    """Recorder of the run from which `simulate` made a history.

    Raises
    ------
    InputError
        The history was read from a folder.
    """
    require_class("history", history, History)
    if history.solved is None:
        raise InputError(
            "this history was read from a folder, which does not contain the state of its run: "
            "simulate the mechanism, or run the scene, in this program"
        )
    return cast(Recorder, history.solved)


def trajectory_of(solved: Recorder) -> Trajectory:
    """Trajectory of a complete run, or of the last cycle of a search for a periodic solution."""
    first = solved.first
    steps = solved.history().each(lambda values: values[first:])
    return Trajectory(**vars(steps), base=solved.run, start=solved.began, search=solved.cycles)


def recorded(
    run: Run,
    end: float,
    cycles: PeriodicSolver | None = None,
    look: Callable[[MechanismStep], Mapping[str, float]] = lambda step: {},
) -> Trajectory:
    """Take the steps of a run, and record them as a trajectory.

    Parameters
    ----------
    run
        Run that takes the steps.
    end
        End time of a run without a search [s].
    cycles
        Search for a periodic solution, which determines the end; its last cycle is recorded. None
        if the run has no search.
    look
        Function that returns further values to record at a step, by the paths of their columns,
        with units.
    """
    size = run.equations.system.n + run.equations.responses.size
    start = run.state
    number = 1
    rows: list[dict[str, Any]] = []
    for step in run.until(end) if cycles is None else cycles:
        if cycles is not None and (not rows or cycles.number != number):
            start = cycles.began
            rows = []
            number = cycles.number
        row: dict[str, Any] = {"time_s": step.time, **look(step), **solution(run, step)}
        row["state/accelerations"] = step.acceleration[:size]
        rows.append(row)
    steps = history_of(run.equations.system, rows)
    return Trajectory(**vars(steps), base=run, start=start, search=cycles)


def finer_grid(grid: FilmGrid) -> FilmGrid:
    """Film mesh with `FINER` times as many cells in both directions and the same grading."""
    return FilmGrid(grid.radius, _divided(grid.angles), _divided(grid.heights), grid.family)


def _divided(boundaries: np.ndarray) -> np.ndarray:
    cells = len(boundaries) - 1
    finer = np.linspace(0.0, cells, int(np.ceil(FINER * cells)) + 1)
    return np.interp(finer, np.arange(cells + 1), boundaries)


def with_finer_films(mechanism: Mechanism) -> Mechanism:
    """Mechanism with the film meshes of `finer_grid`, and cell boundaries at edges of grooves.

    Raises
    ------
    SettingsError
        Edges of grooves are closer to each other than the length of a cell.
    """
    joints = dict(mechanism.joints)
    for name, joint in mechanism.joints.items():
        if isinstance(joint, LubricatedJoint):
            parameters = joint.film.parameters
            edges = np.array([edge for groove in parameters.regions for edge in groove.edges])
            grid = aligned_grid(finer_grid(parameters.grid), edges)
            joints[name] = replace(joint, film=Film(replace(parameters, grid=grid)))
    return replace(mechanism, joints=joints)


def interpolations(source: Run, target: Run) -> list[sparse.spmatrix]:
    """Matrices that interpolate nodal values of a run's films to the film nodes of another run.

    There is one matrix for each film. If the film has the same number of nodes in both runs, its
    matrix is the identity, even if the nodes have moved.
    """
    matrices = []
    for films in zip(source.equations.system.films, target.equations.system.films, strict=True):
        grid, wanted = (binding.film.film.parameters.grid for binding in films)
        angle, height = wanted.node_positions.T
        if len(grid.nodes) == len(wanted.nodes):
            matrices.append(sparse.identity(len(grid.nodes), format="csr"))
        else:
            matrices.append(grid.interpolation(angle, height * grid.width / wanted.width))
    return matrices


def transferred_state(state: RunState, source: Run, target: Run, span: float = 1.0) -> RunState:
    """Convert the state of a run to a state of another run with the same coordinates.

    The coordinates do not change. In films with mass-conserving cavitation, the void fractions do
    not change.

    Parameters
    ----------
    state
        State of `source`.
    source, target
        Run with the state, and run for which the state is converted.
    span
        Factor from times of `source` to the corresponding times of `target`; rates are divided by
        it.
    """
    size = target.equations.system.n + target.equations.responses.size
    matrices = interpolations(source, target)
    points = []
    for point in state.x:
        gaps, wanted = (run.norm.film_gaps(run.norm.observe(point)) for run in (source, target))
        volumes = []
        for i, film in enumerate(target.equations.films):
            void = source.equations.films[i].content.void_fractions(point, gaps[i])
            if void is not None:
                void = matrices[i] @ void
            volumes.append(film.content.of_void_fractions(void, point, wanted[i]))
        points.append(np.concatenate([point[:size], *volumes]))
    x = np.array(points)
    rate = np.zeros_like(x)
    rate[:, :size] = state.rate[:, :size] / span
    observed = np.array([target.norm.observe(point) for point in x])
    return IntegratorState(state.times * span, x, rate, observed, state.step * span)


#: Smallest part of a step that is tried if the step has no solution.
LEAST_PART = 1 / 16

#: Largest part of a trajectory's time that may be left out because no solution was found. Beyond
#: it there is no estimate.
MOST_LEFT_OUT = 0.1


class Replay(Run):
    """A run that follows the trajectory of another run.

    Parameters
    ----------
    run
        Run whose equations are solved; its state does not change.
    trajectory
        Trajectory of a run of the same mechanism, or of a slightly different one.
    tolerance
        Tolerance of the last update of Newton's method.
    start
        State before the first step; by default that of the trajectory.
    stride
        Number of steps of the trajectory that form one step of the replay. The number is smaller
        if steps would grow fast, or if a row of a table would lie within a step.
    changes
        Changes that are added to the gap of every film, at its w observed points and the k times of
        the trajectory, shape (k, w) [m].
    same_coordinates
        Whether the coordinates have the same meaning as those of the trajectory. If so, the first
        guess of a step is made from the trajectory.
    forgiving
        Whether a step without a solution is divided. If a part has no solution either, the rest of
        the step is left out, and the replay continues from the trajectory at the end of the step.

    Attributes
    ----------
    iterations
        Number of Newton iterations so far.
    left_out
        Time that was left out because no solution was found [s].
    """

    def __init__(
        self,
        run: Run,
        trajectory: Trajectory,
        tolerance: float,
        *,
        start: RunState | None = None,
        stride: int = 1,
        changes: Sequence[np.ndarray] = (),
        same_coordinates: bool = True,
        forgiving: bool = False,
    ):
        self._begin(run.solve, run.norm, run.control, start or trajectory.start)
        self._trajectory = trajectory
        self._tolerance = tolerance
        self._stride = stride
        self._corners = trajectory.state("corner")
        self._guess = _Guess(run, trajectory) if same_coordinates else None
        self._observed = changes
        self._changes = []
        for binding, observed in zip(self._system.films, changes, strict=False):
            gap = observed[:, : len(binding.film.thickness)]
            self._changes.append((gap, np.gradient(gap, trajectory.times, axis=0)))
        self._position = (0, 1.0)
        self.iterations = 0
        self.left_out = 0.0
        self._forgiving = forgiving

    def until(self, end: float) -> Iterator[MechanismStep]:
        """Follow the trajectory from the present state to an end time [s], and yield the steps.

        Raises
        ------
        StepSizeError
            No solution near the trajectory was found, or too much time was left out.
        """
        trajectory = self._trajectory
        began = self.state.time
        span = (end - began) / (trajectory.times[-1] - trajectory.began)
        times = began + span * (trajectory.times - trajectory.began)
        times[-1] = end
        if self._guess:
            self._guess.begin(self.state)
        last_size = float(np.ptp(self.state.times[:2]))
        row = -1
        while row < len(times) - 1:
            before = self.state.time
            target = self._next(times, row, last_size)
            step = self._step(target, float(times[target]))
            if step is None and target > row + 1:
                target = row + 1
                step = self._step(target, float(times[target]))
            if step is not None:
                yield step
            elif self._forgiving:
                yield from self._in_parts(target, float(times[target]))
                self._rejoin(target, float(times[target]))
            lost = self.left_out > MOST_LEFT_OUT * (end - began)
            if lost or (step is None and not self._forgiving):
                raise StepSizeError(
                    f"no solution near the recorded one was found after t = {before:.6g} s: lower "
                    "time.tolerance"
                )
            row = target
            last_size = self.state.time - before

    def columns(self, step: MechanismStep) -> dict[str, float]:
        """Columns of the lubricated joints at the last step, by path, with changes of the gaps."""
        joints = step.solution.joints
        if self._observed:
            each = zip(joints, self._observed, strict=True)
            joints = [
                replace(joint, gap=joint.gap + _between(change, *self._position))
                for joint, change in each
            ]
        return joints_row(joints, reported=True)

    def _in_parts(self, row: int, time: float) -> Iterator[MechanismStep]:
        """Take a step to a row of the trajectory in several parts, and yield each solved part."""
        began = self.state.time
        reached = 0.0
        part = 0.5
        while reached < 1.0 and part >= LEAST_PART:
            share = reached + part
            step = self._step(row, began + share * (time - began), share)
            if step is None:
                part *= 0.5
                continue
            reached = share
            yield step

    def _rejoin(self, row: int, time: float) -> None:
        """Set the state of the replay to that of the trajectory at a row.

        If the replay has already reached the time of the row, `time` [s], nothing is done.
        """
        if self.state.time >= time:
            return
        self.left_out += time - self.state.time
        trajectory = self._trajectory
        base = trajectory.base
        x = trajectory.x[row]
        gaps = base.norm.film_gaps(base.norm.observe(x))
        volumes = []
        for film, gap in zip(base.equations.films, gaps, strict=True):
            fractions = trajectory.joints[film.binding.name].film.fluid_fraction
            void = None if fractions is None else 1.0 - np.asarray(fractions[row])
            volumes.append(film.content.of_void_fractions(void, x, gap))
        point = np.concatenate([x, *volumes])
        rate = np.zeros_like(point)
        rate[: trajectory.rates.shape[1]] = trajectory.rates[row]
        state: RunState = IntegratorState.begin(base.norm, time, point, rate, self.control)
        self.state = transferred_state(state, base, self)
        if self._guess:
            self._guess.forget()

    def _next(self, times: np.ndarray, row: int, last_size: float) -> int:
        """Row of the trajectory at which the next step ends.

        The step does not pass over a corner of a load, which is at a row of the load's table. The
        same holds for rows at which the recorded run ended a step because of such a corner.

        Parameters
        ----------
        times
            Times of all rows of the trajectory, shape (k,) [s].
        row, last_size
            Row at which the last step ended, and size of the last step [s].
        """
        time = self.state.time
        target = min(row + self._stride, len(times) - 1)
        while target > row + 1 and times[target] - time > LONGEST * last_size:
            target -= 1
        if target > row + 1:
            order = self.state.usable_order(self.control.order)
            end = float(times[target])
            tables = self._system.tables
            reached = self.state.reach(self.norm, tables, end, order, self.control.smallest)
            if reached < end or self._corners[row + 1 : target].any():
                return row + 1
        return target

    def _step(self, row: int, time: float, share: float = 1.0) -> MechanismStep | None:
        """Take a step to `time`: the time of a row of the trajectory, or an earlier time.

        An earlier time is at the fraction `share` of the way from the previous row to this row. The
        result is None if the step has no solution.
        """
        control = self.control
        state = self.state
        norm = self.norm
        order = state.usable_order(control.order)
        asked = state.implicit_step(norm, time, order, control.blend, self._tolerance)
        former = state.solver
        if self._guess:
            x, values = self._guess.at(row, share)
            predicted = np.concatenate([x, asked.predicted[len(x) :]])
            observed = asked.observed[0], norm.observe(predicted)
            asked = replace(asked, predicted=predicted, observed=observed)
            former = SolverState(np.array([time]), values[None], self._guess.patterns)
        gap_changes = [
            (_between(gap, row, share), _between(rate, row, share)) for gap, rate in self._changes
        ]
        attempt = self.solve(norm, asked, former, gap_changes)
        self.iterations += attempt.iterations
        solved = attempt.solved
        if solved is None:
            return None
        new: MechanismStep = Step(
            time,
            solved.x,
            solved.rate,
            asked.acceleration(solved.rate),
            solved.observed,
            solved.solution,
            attempt.iterations,
        )
        self._position = (row, share)
        keep = 1 if self._corners[row] and share == 1.0 else control.order + 2
        self.state = state.after(new, time - state.time, solved.solver, keep)
        if self._guess:
            self._guess.learn(row, share, new, solved.solver)
        return new


def _between(
    values: np.ndarray, row: int, share: float, first: np.ndarray | None = None
) -> np.ndarray:
    """Interpolate an array linearly between a row and the row before.

    The position is the fraction `share` of the way to the row. The values before row 0 are `first`,
    or the values of row 0 if `first` is None.
    """
    if share == 1.0:
        return values[row]
    before = values[row - 1] if row else values[0] if first is None else first
    return (1.0 - share) * before + share * values[row]


class _Guess:
    """First guess for a step of a replay.

    It is the trajectory at the time of the step, plus the difference between the replay and the
    trajectory at the last step.

    Parameters
    ----------
    run
        Run that follows the trajectory.
    trajectory
        Trajectory that is followed.

    Attributes
    ----------
    patterns
        Number of residual patterns that the derivatives of the last step contained.
    """

    def __init__(self, run: Run, trajectory: Trajectory):
        equations = run.equations
        self._trajectory = trajectory
        self.patterns = FEWEST_PATTERNS
        self._pressures = equations.lower == 0.0
        self._voids = ~self._pressures
        self._voids[equations.rest] = False
        # Unknowns of the trajectory at the nodes of this run's films; coordinates are stored
        # separately.
        self._values = np.zeros((len(trajectory), len(equations.lower)))
        multipliers = trajectory.state("multipliers")
        # If the drives or joints differ, there are other multipliers, which start from zero.
        if multipliers.shape[1] == equations.rest_size - equations.system.n:
            self._values[:, equations.rest][:, equations.system.n :] = multipliers
        matrices = interpolations(trajectory.base, run)
        each = zip(equations.films, equations.film_indices, matrices, strict=True)
        for film, dofs, matrix in each:
            if not film.conserves_oil:
                self._voids[dofs] = False
            result = trajectory.joints[film.binding.name].film
            fractions = result.fluid_fraction
            for row, pressure in enumerate(np.asarray(result.pressure)):
                void = None if fractions is None else matrix @ (1.0 - np.asarray(fractions[row]))
                self._values[row, dofs] = film.unknowns(matrix @ pressure, void)
        self.forget()

    def begin(self, state: RunState) -> None:
        """Store the difference of `state` from the start of the trajectory for the first guess.

        Angles of `state` may be larger by whole turns.
        """
        start = self._trajectory.start.x[0][: self._trajectory.x.shape[1]]
        self._x_difference = state.x[0][: len(start)] - start

    def forget(self) -> None:
        """Make the next first guess equal to the trajectory itself."""
        self._x_difference = np.zeros(self._trajectory.x.shape[1])
        self._value_difference = np.zeros(self._values.shape[1])

    def _recorded_at(self, row: int, share: float) -> tuple[np.ndarray, np.ndarray]:
        """State x and step unknowns of the trajectory at a row, or between it and the row before.

        The fraction `share` is that of `at`.

        x has the coordinates and the amplitudes of residual patterns.
        """
        start = self._trajectory.start.x[0][: self._trajectory.x.shape[1]]
        x = _between(self._trajectory.x, row, share, start)
        return x, _between(self._values, row, share)

    def at(self, row: int, share: float) -> tuple[np.ndarray, np.ndarray]:
        """First guess of the state x and of the step unknowns, at a row of the trajectory.

        x has the coordinates and the amplitudes of residual patterns. If `share` is below 1, the
        guess is for this fraction of the way from the previous row.
        """
        x, values = self._recorded_at(row, share)
        guess = values + self._value_difference
        # In the cavities of the trajectory the guess of the pressure is zero.
        guess[self._pressures] *= values[self._pressures] > 0.0
        guess[self._voids] = np.clip(guess[self._voids], 0.0, 1.0)
        return x + self._x_difference, guess

    def learn(self, row: int, share: float, step: Step[CoupledState], solver: SolverState) -> None:
        """Store the difference of a step's solution from the trajectory at the time of the step."""
        x, values = self._recorded_at(row, share)
        self._x_difference = step.x[: len(x)] - x
        self._value_difference = solver.values[0] - values
        self.patterns = solver.patterns


def replay(
    history: History,
    mechanism: Mechanism,
    *,
    stride: int = 1,
    progress: Progress | bool = True,
) -> History:
    """Repeat the steps of a run, or of its last cycle, with another mechanism.

    Parameters
    ----------
    history
        History that `simulate` returned.
    mechanism
        Mechanism with the same coordinates as that of the run; its films may have other meshes.
    stride
        Number of steps of the run that form one step of the replay.
    progress
        Whether progress is shown in a terminal or notebook; or the progress in which the replay is
        a stage.

    Returns
    -------
    History
        History of `mechanism`.

    Raises
    ------
    InputError
        The history was read from a folder.
    StepSizeError
        No solution near that of the run was found.
    """
    trajectory = trajectory_of(solved_run(history))
    require_class("mechanism", mechanism, Mechanism)
    require_count("stride", stride, least=1)
    run = trajectory.base.with_mechanism(mechanism)
    start = transferred_state(trajectory.start, trajectory.base, run)
    tolerance = NEWTON_FRACTION * run.control.tolerance
    run_again = Replay(run, trajectory, tolerance, start=start, stride=stride)
    recorder = Recorder(run_again, float(trajectory.times[-1]))
    length = 1e3 * (float(trajectory.times[-1]) - trajectory.began)
    with chosen_progress(progress).stage("replay", length, "ms") as stage:
        for step, _ in recorder.steps():
            stage.to(1e3 * (step.time - trajectory.began))
    return summarised_history(recorder)
