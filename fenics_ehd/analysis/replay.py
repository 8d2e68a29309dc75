"""One run once more: along its recorded times, by another mechanism or in longer steps.

A run leaves its course, the solutions at its steps. What is asked of it afterwards is what a
little difference does: longer steps, a finer film, a gap with what a basis misses, a number that
is larger by a hundredth, a start that is moved. All of these are replays. At chosen times of the
course the solution there, read on the other film's nodes, with what differed at the time before,

    u_k = course_k + (u_(k-1) - course_(k-1)),

is the first guess. Newton then takes hardly more than an iteration a step, errors travel along the
motion as those of the run do, and no choice of steps makes any noise.

The largest of nodal values goes up and down as a film's peak passes from node to node, by a few
per mille: what meshes and steps change is less. The vertex of the parabolas through the largest
one and its neighbours, around and along, does not (`BetweenNodes`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from scipy import sparse

from fenics_ehd.base.errors import InputError, StepSizeError
from fenics_ehd.film.film import Film
from fenics_ehd.film.grid import FilmGrid, aligned_grid
from fenics_ehd.film.parameters import FilmParameters
from fenics_ehd.film.supply import AxialGroove
from fenics_ehd.multibody.bdf import NEWTON_FRACTION, IntegratorState, Step, StepControl
from fenics_ehd.multibody.error_shares import QUANTITIES
from fenics_ehd.multibody.history import FilmResult, History, fixed
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.newton import LEADING, CoupledState, MechanismStep, SolverState
from fenics_ehd.multibody.periodic import Cycles
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.simulation import Simulation
from fenics_ehd.multibody.step_equations import Disturbance
from fenics_ehd.multibody.tabulated import blended
from fenics_ehd.multibody.tracking import history_of, solution

#: Angles and shares of the width that differ by less are equal.
EQUAL = 1e-9

#: Cells of a finer mesh in one of its own, either way. What the finer mesh changes is most of the
#: error already, whatever the order; meshes half as fine tell less: from 10 x 3 to 20 x 5 cells
#: errors of a rod's film fall to a thirty-fifth, of a small pin's to a third.
FINER = 1.5

#: Largest growth of a step: from one step of the run to two, which grow themselves. Formulas of
#: order two are zero-stable below 2.41.
LONGEST = 2.4

#: Slack in taking a time of the course for that of a table's row, share of the step.
NEAR_ROW = 1e-2

RunState = IntegratorState[SolverState]


class BetweenNodes:
    """Extremes of the films on one mesh between its nodes.

    Parameters
    ----------
    angle, height
        Of the nodes, shape (nodes,) [rad], [m].
    """

    def __init__(self, angle: np.ndarray, height: np.ndarray):
        share = np.asarray(height) / np.ptp(height)
        around, self._across = _neighbours(np.asarray(angle), share)
        along, self._up = _neighbours(share, np.asarray(angle), closed=False)
        self._around, self._along = around, along

    def largest(self, values: np.ndarray) -> np.ndarray:
        """Largest of the nodal values of every instant, shape (k, n)."""
        values = np.asarray(values)
        rows, node = np.arange(len(values)), np.argmax(values, axis=1)
        top = values[rows, node]
        found = top.copy()
        for others, places in ((self._around, self._across), (self._along, self._up)):
            lower = values[rows[:, None], others[node]] - top[:, None]
            found += _rise(places[node], lower)
        return found

    def least(self, values: np.ndarray) -> np.ndarray:
        """Least of the nodal values of every instant, shape (k, n)."""
        return -self.largest(-values)


def _neighbours(
    place: np.ndarray, row: np.ndarray, closed: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the nodes before and after each in its row, and how far they are.

    A row is once around if it is closed, else it ends: the nodes there have none, distance 0.
    """
    number = np.lexsort((place, np.round(row / EQUAL)))
    others, far = np.empty((len(place), 2), dtype=int), np.zeros((len(place), 2))
    ends = np.flatnonzero(np.diff(row[number]) > EQUAL) + 1
    for own in np.split(number, ends):
        for k, shift in enumerate((1, -1)):
            others[own, k] = np.roll(own, shift)
            far[own, k] = place[others[own, k]] - place[own]
        first, last = own[0], own[-1]
        far[first, 0], far[last, 1] = (
            (far[first, 0] - 2 * np.pi, far[last, 1] + 2 * np.pi) if closed else (0.0, 0.0)
        )
    return others, far


def _rise(place: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Rise above 0 of parabolas through 0 and two lower values, at either side.

    Shapes (k, 2); 0 at the end of a row.
    """
    inside = (place[:, 0] < 0.0) & (place[:, 1] > 0.0)
    place = np.where(inside[:, None], place, [-1.0, 1.0])
    slopes = value / place
    # a s + b s^2 through both.
    bend = (slopes[:, 1] - slopes[:, 0]) / (place[:, 1] - place[:, 0])
    slope = slopes[:, 0] - bend * place[:, 0]
    inside &= bend < 0.0
    return np.where(inside, -(slope**2) / (4.0 * np.where(inside, bend, -1.0)), 0.0)


@dataclass(frozen=True, eq=False)
class Course(History):
    """A history that replays follow: solutions at ascending times, after a state.

    That of a replay has ``state/multipliers``, shape (k, 2 m), and ``state/accelerations`` of
    coordinates and amplitudes of residual patterns, shape (k, n + r), too.

    Attributes
    ----------
    start
        State that it begins after.
    corners
        Whether a step forgets what was before it, as at a row of a table, shape (k,); None: not
        known.
    """

    start: RunState = field(kw_only=True)
    corners: np.ndarray | None = field(default=None, kw_only=True)

    @property
    def began(self) -> float:
        """Time at which it begins [s]."""
        return self.start.time

    @cached_property
    def times(self) -> np.ndarray:
        """Times of its steps, shape (k,) [s]."""
        return np.asarray(self.values["time"])

    @cached_property
    def x(self) -> np.ndarray:
        """Coordinates and amplitudes of residual patterns, shape (k, n + r)."""
        return np.hstack([self.coordinates, self.quasi_static])

    @property
    def multipliers(self) -> np.ndarray:
        """Multipliers of the constraints; none where they are not known."""
        return np.asarray(self.values.get("state/multipliers", ()))

    @property
    def accelerations(self) -> np.ndarray:
        """Accelerations of x; none where they are not known."""
        return np.asarray(self.values.get("state/accelerations", ()))

    @cached_property
    def nodal(self) -> list[FilmResult]:
        """Films of all lubricated joints, by number."""
        return [joint.film for joint in self.joints.values()]

    @cached_property
    def voids(self) -> dict[int, np.ndarray]:
        """Void fractions of films that keep account of their oil, by the film's number."""
        filled = [film.fluid_fraction for film in self.nodal]
        return {i: 1.0 - np.asarray(own) for i, own in enumerate(filled) if own is not None}

    @cached_property
    def between_nodes(self) -> np.ndarray:
        """`QUANTITIES` of every film between its nodes, shape (2, k, films) [Pa], [m]."""
        films = [(BetweenNodes(own.angle, own.height), own) for own in self.nodal]
        peaks = [between.largest(own.pressure) for between, own in films]
        thinnest = [between.least(own.gap) for between, own in films]
        return np.array([peaks, thinnest]).swapaxes(1, 2)

    @property
    def sampled(self) -> np.ndarray:
        """The same at nodes and Gauss points alone, as a run says them."""
        joints = self.joints.values()
        return np.array([[own[name] for own in joints] for name in QUANTITIES]).swapaxes(1, 2)

    def repeated(self, period: float, angles: list[int], share: float) -> Course:
        """The course of a cycle, and the beginning of the cycle after it.

        Parameters
        ----------
        period
            Of the cycle [s].
        angles
            Places of angles, which go on by whole turns.
        share
            Of the next cycle.
        """
        again = np.flatnonzero(self.times - (self.times[-1] - period) <= share * period)
        turns = np.zeros(self.coordinates.shape[1])
        over = self.x[-1, angles] - self.start.x[0][angles]
        turns[angles] = 2 * np.pi * np.round(over / (2 * np.pi))
        later = {
            "time": self.times[again] + period,
            "state/coordinates": self.coordinates[again] + turns,
        }
        return self.changed(
            {
                path: np.concatenate([values, later.get(path, values[again])])
                for path, values in self.values.items()
                if not fixed(path)
            }
        )

    def halved(self) -> Course:
        """Its points and those halfway between."""
        n, size = self.coordinates.shape[1], self.x.shape[1]
        first = {
            "time": self.began,
            "state/coordinates": self.start.x[0][:n],
            "state/quasi_static": self.start.x[0][n:size],
        }

        def halved(values: np.ndarray, before: Any) -> np.ndarray:
            middles = 0.5 * (np.concatenate([[before], values[:-1]]) + values)
            return np.stack([middles, values], axis=1).reshape(-1, *values.shape[1:])

        return self.changed(
            {
                path: halved(np.asarray(values), first.get(path, values[0]))
                for path, values in self.values.items()
                if not fixed(path)
            }
        )


def course_of(solved: Simulation) -> Course:
    """Course of a run, or of the cycle under way, after the state that it began with."""
    first = solved.tracker.first
    found = solved.tracker.history().each(lambda own: own[first:])
    return Course(**vars(found), start=solved.began)


class CourseRecorder:
    """Steps of a run that become a course.

    Parameters
    ----------
    run
        Before the first of them.
    start
        What the course begins after, if not the state it is in.
    """

    def __init__(self, run: Run, start: RunState | None = None):
        self._run, self._start = run, run.state if start is None else start
        self._rows: list[Mapping[str, Any]] = []
        self._corners: list[bool] = []

    def add(
        self,
        step: MechanismStep,
        changes: Sequence[np.ndarray | float] | None = None,
        row: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        """Account for the step that the run has just taken.

        Parameters
        ----------
        step
            As accepted.
        changes
            Of the films' gaps, where they are observed.
        row
            Columns that the course is to have, by path with unit.
        """
        run, equations = self._run, self._run.equations
        assert run.state.solver is not None
        values, gaps = run.state.solver.values[0], run.norm.film_gaps(step.observed)
        if changes is not None:
            gaps = [gap + change for gap, change in zip(gaps, changes, strict=True)]
        found = solution(equations, step, gaps)
        found["state/multipliers"] = values[len(values) - 2 * equations.system.m :]
        size = equations.system.n + equations.responses.size
        found["state/accelerations"] = step.acceleration[:size]
        self._rows.append({"time_s": step.time, **row, **found})
        self._corners.append(len(run.state.times) == 1)

    def course(self) -> Course:
        """All of them."""
        found = history_of(self._run.equations.system, self._rows)
        return Course(**vars(found), start=self._start, corners=np.array(self._corners))


def finer_grid(grid: FilmGrid) -> FilmGrid:
    """`FINER` times as many cells either way, graded alike."""
    return FilmGrid(grid.radius, _divided(grid.angles), _divided(grid.heights), grid.family)


def _divided(boundaries: np.ndarray) -> np.ndarray:
    cells = len(boundaries) - 1
    finer = np.linspace(0.0, cells, int(np.ceil(FINER * cells)) + 1)
    return np.interp(finer, np.arange(cells + 1), boundaries)


def finer_parameters(parameters: FilmParameters) -> FilmParameters:
    """Parameters of the same film on `finer_grid`, its boundaries on the edges of grooves.

    Raises
    ------
    SettingsError
        Edges of grooves are nearer than its cells.
    """
    grooves = [region for region in parameters.regions if isinstance(region, AxialGroove)]
    edges = np.array([edge for groove in grooves for edge in groove.edges])
    return replace(parameters, grid=aligned_grid(finer_grid(parameters.grid), edges))


def with_finer_films(mechanism: Mechanism) -> Mechanism:
    """The mechanism, all its films finer.

    Raises
    ------
    SettingsError
        See `finer_parameters`.
    """
    joints = dict(mechanism.joints)
    for name, joint in mechanism.joints.items():
        if isinstance(joint, LubricatedJoint):
            film = Film(finer_parameters(joint.film.parameters))
            joints[name] = replace(joint, film=film)
    return replace(mechanism, joints=joints)


def on_nodes(grid: FilmGrid, other: FilmGrid) -> sparse.csr_matrix | None:
    """Interpolation of nodal values on another mesh; None: its nodes are the same, maybe moved."""
    if len(grid.nodes) == len(other.nodes):
        return None
    angle, height = other.node_positions.T
    return grid.interpolation(angle, height * grid.width / other.width)


def taken_over(state: RunState, own: Run, other: Run, span: float = 1.0) -> RunState:
    """A state of a run for another one with the same coordinates.

    Parameters
    ----------
    state, own, other
        Motion is taken as it is, of oil that is accounted for the void's share of the gap.
    span
        Time in the other run over that in this one.
    """
    equations = own.equations, other.equations
    size = equations[1].system.n + equations[1].responses.size
    moved = []
    for point in state.x:
        gaps, wanted = (run.norm.film_gaps(run.norm.observe(point)) for run in (own, other))
        volumes = []
        for i, oil in equations[1].oils.items():
            grids = [each.system.films[i].film.film.parameters.grid for each in equations]
            shares = equations[0].oils[i].void_shares(point, gaps[i])
            matrix = on_nodes(*grids)
            read = shares if matrix is None else matrix @ shares
            volumes.append(oil.volumes_with(read, point, wanted[i]))
        moved.append(np.concatenate([point[:size], *volumes]))
    x = np.array(moved)
    rate = np.zeros_like(x)
    rate[:, :size] = state.rate[:, :size] / span
    observed = np.array([other.norm.observe(point) for point in x])
    return IntegratorState(state.times * span, x, rate, observed, state.step * span)


def grids_of(run: Run) -> list[FilmGrid]:
    """Meshes of all films of a run."""
    return [place.film.film.parameters.grid for place in run.equations.system.films]


class Replay(Run):
    """A run along the course of another one.

    Parameters
    ----------
    run
        Which takes the steps, from the state it is in.
    course
        Of a run of the same mechanism, or of one that differs a little from it.
    tolerance
        On Newton's last update.
    stride
        Steps of the course in one, where they grow slowly and no table has a row.
    control
        Formula, if not that of the run.
    disturbance
        Of the gaps, at the times of the course.
    span
        Time here over that of the course.
    grids
        Of the films of the course, if they are others.
    alike
        Whether coordinates mean what they mean in the course, so that it is a guess.

    Attributes
    ----------
    iterations
        Of Newton's so far.
    row
        Of the course, where it is.
    """

    def __init__(
        self,
        run: Run,
        course: Course,
        tolerance: float,
        *,
        stride: int = 1,
        control: StepControl | None = None,
        disturbance: Disturbance | None = None,
        span: float = 1.0,
        grids: Sequence[FilmGrid] | None = None,
        alike: bool = True,
    ):
        vars(self).update(vars(run))
        self.control = control or run.control
        self._course, self._tolerance, self._stride = course, tolerance, stride
        self._disturbance, self._span = disturbance, span
        self._guess = _Guess(run, course, grids) if alike else None
        self.iterations, self.row = 0, -1

    def until(self, end: float) -> Iterator[MechanismStep]:
        """All steps of the course, from the state it is in; `end` [s] is where they lead to.

        Raises
        ------
        StepSizeError
            There is no solution near the course.
        """
        shift = self.state.time - self._course.began * self._span
        times = self._course.times * self._span + shift
        times[-1] = end
        if self._guess:
            self._guess.begin(self.state)
        corners = self._course.corners if self._stride == 1 else None
        past, last = float(np.ptp(self.state.times[:2])), len(times) - 1
        self.row = -1
        while self.row < last:
            row, before = self.row + 1, self.state.time
            ahead, corner = (
                (row, bool(corners[row])) if corners is not None else self._next(times, past)
            )
            step = self._step(ahead, float(times[ahead]), corner)
            if step is None and ahead > row:
                ahead = row
                step = self._step(row, float(times[row]), False)
            if step is None:
                raise StepSizeError(f"no step from t = {before:.6g} s beside those of the run")
            self.row, past = ahead, step.time - before
            yield step

    def _next(self, times: np.ndarray, past: float) -> tuple[int, bool]:
        """Row of the course to step to, and whether a table's row ends the step."""
        control, row, time = self.control, self.row, self.state.time
        order = self.state.usable_order(control.order)
        ahead = min(row + self._stride, len(times) - 1)
        most = LONGEST * past
        while ahead > row + 1 and times[ahead] - time > most:
            ahead -= 1
        if not self._system.tables:
            return ahead, False
        if ahead > row + 1 and self._reach(order, float(times[ahead])) < times[ahead]:
            ahead = row + 1
        if ahead > row + 1:
            return ahead, False
        # The run begins anew at a row that it could not step over.
        step = float(times[ahead]) - time
        beyond = time + 2.0 * step
        reached = self._reach(order, beyond)
        return ahead, bool(reached < beyond and abs(reached - times[ahead]) <= NEAR_ROW * step)

    def _reach(self, order: int, time: float) -> float:
        """The time, or that of the last row of a table before it that a step must not miss [s]."""
        nearest = self.control.smallest_step
        return self.state.reach(self.norm, self._system.tables, time, order, nearest)

    def _step(self, row: int, time: float, corner: bool) -> MechanismStep | None:
        """The step to a row of the course; None: it has no solution."""
        control, state, norm = self.control, self.state, self.norm
        order = state.usable_order(control.order)
        formula = blended(time, state.times, order, control.blend)
        asked = state.implicit_step(norm, time, formula, order, self._tolerance)
        former = state.solver
        if self._guess:
            x, values = self._guess.at(row)
            predicted = np.concatenate([x, asked.predicted[len(x) :]])
            observed = asked.observed[0], norm.observe(predicted)
            asked = replace(asked, predicted=predicted, observed=observed)
            former = SolverState(np.array([time]), values[None], self._guess.patterns)
        if self._disturbance:
            self.equations.disturbance = self._disturbance.at(row)
        try:
            attempt = self.solve(norm, asked, former)
        finally:
            self.equations.disturbance = None
        self.iterations += attempt.iterations
        solved = attempt.solved
        if solved is None:
            return None
        new: MechanismStep = Step(
            time,
            solved.x,
            solved.rate,
            asked.acceleration(solved.rate),
            norm.observe(solved.x),
            solved.solution,
            attempt.iterations,
        )
        keep = 1 if corner else control.order + 2
        self.state = state.after(new, time - state.time, solved.solver, keep)
        if self._guess:
            self._guess.learn(row, new, solved.solver)
        return new


class _Guess:
    """The next point: that of the course, and what differed from it at the last one."""

    def __init__(self, run: Run, course: Course, grids: Sequence[FilmGrid] | None):
        equations = run.equations
        own = grids_of(run)
        self._read = [on_nodes(then, now) for now, then in zip(own, grids or own, strict=True)]
        self._course, self._equations, self.patterns = course, equations, LEADING
        self._pressures = equations.lower == 0.0
        self._voids = ~self._pressures
        self._voids[equations.rest] = False
        self._last = np.zeros(course.x.shape[1]), np.zeros(0)

    def begin(self, state: RunState) -> None:
        """Begin at the start of the course, angles maybe whole turns further."""
        size = self._course.x.shape[1]
        values = self._last[1] if len(self._last[1]) else np.zeros_like(self._values(0))
        self._last = state.x[0][:size] - self._course.start.x[0][:size], values

    def _values(self, row: int) -> np.ndarray:
        """Unknowns of the course on the nodes of these films, coordinates left out."""

        def read(i: int, values: np.ndarray) -> np.ndarray:
            matrix = self._read[i]
            return values[row] if matrix is None else matrix @ values[row]

        course, equations = self._course, self._equations
        found = np.zeros(len(equations.lower))
        for i, (film, own) in enumerate(zip(equations.films, equations.places, strict=True)):
            void = read(i, course.voids[i]) if i in course.voids else None
            found[own] = film.values(read(i, course.pressures[film.place.name]), void)
        if len(course.multipliers):
            found[equations.rest][equations.system.n :] = course.multipliers[row]
        return found

    def at(self, row: int) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates with patterns, and values."""
        x, more = self._last
        values = self._values(row)
        found = values + more
        # Where the course cavitates there is no pressure, whatever differed there a step ago.
        found[self._pressures] *= values[self._pressures] > 0.0
        found[self._voids] = np.clip(found[self._voids], 0.0, 1.0)
        return self._course.x[row] + x, found

    def learn(self, row: int, step: Step[CoupledState], solver: SolverState) -> None:
        """Take the solution at a point."""
        x = step.x[: self._course.x.shape[1]] - self._course.x[row]
        self._last, self.patterns = (x, solver.values[0] - self._values(row)), solver.patterns


def solved_run(history: History) -> Simulation:
    """The run that a history of `simulate` was made by.

    Raises
    ------
    InputError
        It was read from a folder.
    """
    if history.solved is None:
        raise InputError("a history that was read says nothing more of its run: simulate it")
    return cast(Simulation, history.solved)


def replay(history: History, mechanism: Mechanism, *, stride: int = 1) -> History:
    """Another mechanism along the steps of a run, or of its last cycle.

    Parameters
    ----------
    history
        From `simulate`.
    mechanism
        With the same coordinates; films may have other meshes.
    stride
        Steps of the run in one.

    Raises
    ------
    InputError
        The history was read from a folder.
    StepSizeError
        There is no solution near that of the run.
    """
    solved = solved_run(history)
    base, course = solved.run, course_of(solved)
    run = base.with_mechanism(mechanism)
    tolerance = NEWTON_FRACTION * base.control.tolerance
    again = Replay(run, course, tolerance, stride=stride, grids=grids_of(base))
    again.state = taken_over(solved.began, base, run)
    found = Simulation(again, float(course.times[-1]))
    for _ in found.steps():
        pass
    return found.history()


def recorded(
    run: Run,
    end: float,
    cycles: Cycles | None = None,
    look: Callable[[MechanismStep], Any] = lambda step: {},
) -> Course:
    """Steps of a run to its end [s], or of the last cycle of a search, with columns of each."""
    recorder, number = CourseRecorder(run), 0 if cycles is None else cycles.number
    for step in run.until(end) if cycles is None else cycles:
        if cycles is not None and cycles.number != number:
            recorder, number = CourseRecorder(run, cycles.began), cycles.number
        recorder.add(step, row=look(step) or {})
    return recorder.course()
