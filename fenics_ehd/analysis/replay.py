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
one and its neighbours, around and along, does not (`largest_between_nodes`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, cast

import numpy as np
from scipy import sparse

from fenics_ehd.base.arguments import require_class, require_count
from fenics_ehd.base.errors import InputError, StepSizeError
from fenics_ehd.film.film import Film
from fenics_ehd.film.grid import FilmGrid, aligned_grid
from fenics_ehd.multibody.bdf import NEWTON_FRACTION, IntegratorState, Step
from fenics_ehd.multibody.history import History, fixed
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.newton import FEWEST_PATTERNS, CoupledState, MechanismStep, SolverState
from fenics_ehd.multibody.periodic import PeriodicSolver
from fenics_ehd.multibody.recorder import Recorder, history_of, solution
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.simulation import summarised_history
from fenics_ehd.multibody.trust import QUANTITIES

#: Angles and shares of the width that differ by less are equal.
EQUAL = 1e-9

#: Cells of a finer mesh in one of its own, either way. What the finer mesh changes is most of the
#: error already, whatever the order; meshes half as fine tell less: from 10 x 3 to 20 x 5 cells
#: errors of a rod's film fall to a thirty-fifth, of a small pin's to a third.
FINER = 1.5

#: Largest growth of a step: from one step of the run to two, which grow themselves. Formulas of
#: order two are zero-stable below 2.41.
LONGEST = 2.4

RunState = IntegratorState[SolverState]


def largest_between_nodes(angle: np.ndarray, height: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Largest of a film's nodal values at every instant, between the nodes, shape (k,).

    Parameters
    ----------
    angle, height
        Of the nodes, shape (nodes,) [rad], [m].
    values
        shape (k, nodes).
    """
    angle, values = np.asarray(angle), np.asarray(values)
    share = np.asarray(height) / np.ptp(height)
    rows, node = np.arange(len(values)), np.argmax(values, axis=1)
    top = values[rows, node]
    found = top.copy()
    for place, row, closed in ((angle, share, True), (share, angle, False)):
        others, far = _neighbours(place, row, closed)
        lower = values[rows[:, None], others[node]] - top[:, None]
        found += _rise(far[node], lower)
    return found


def _neighbours(place: np.ndarray, row: np.ndarray, closed: bool) -> tuple[np.ndarray, np.ndarray]:
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

    That of a replay has ``state/accelerations`` of coordinates and amplitudes of residual patterns,
    shape (k, n + r), too.

    Attributes
    ----------
    base, search
        Run that took the steps, and its search for a periodic solution, whose last cycle they are.
    start
        State that they begin after.
    """

    base: Run = field(kw_only=True)
    start: RunState = field(kw_only=True)
    search: PeriodicSolver | None = field(default=None, kw_only=True)

    @property
    def period(self) -> float | None:
        """Period of a cycle that repeats [s]."""
        return None if self.search is None else self.search.period

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

    def state(self, name: str) -> np.ndarray:
        """One of the arrays that are of no joint or body, ``multipliers``, say."""
        return np.asarray(self.values[f"state/{name}"])

    @cached_property
    def between_nodes(self) -> np.ndarray:
        """`QUANTITIES` of every film between its nodes, shape (2, k, films) [Pa], [m]."""
        films = [joint.film for joint in self.joints.values()]
        peaks = [largest_between_nodes(own.angle, own.height, own.pressure) for own in films]
        closest = [largest_between_nodes(own.angle, own.height, -own.gap) for own in films]
        return np.array([peaks, np.negative(closest)]).swapaxes(1, 2)

    @property
    def sampled(self) -> np.ndarray:
        """The same at nodes and Gauss points alone, as a run says them."""
        joints = self.joints.values()
        return np.array([[own[name] for own in joints] for name in QUANTITIES]).swapaxes(1, 2)

    def with_next(self, share: float) -> Course:
        """The course of a cycle, and a share of the cycle after it.

        Angles go on by whole turns.
        """
        assert self.search is not None
        period, angles = self.search.period, self.search.angles
        again = np.flatnonzero(self.times - (self.times[-1] - period) <= share * period)
        turns = np.zeros(self.coordinates.shape[1])
        over = self.x[-1, angles] - self.start.x[0][angles]
        turns[angles] = 2 * np.pi * np.round(over / (2 * np.pi))
        more = {"time": period, "state/coordinates": turns}
        return self.changed(
            {
                path: np.concatenate([values, values[again] + more.get(path, 0.0)])
                for path, values in self.values.items()
                if not fixed(path)
            }
        )

    def widened(self, changes: Sequence[np.ndarray]) -> Course:
        """The same with changes of the gaps of all films where they are observed [m]."""
        gaps = {}
        for (name, joint), change in zip(self.joints.items(), changes, strict=True):
            nodal = np.asarray(joint.film.gap)
            gaps[f"joints/{name}/film/gap"] = nodal + change[:, -nodal.shape[1] :]
        return self.changed(gaps)

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
            if values.dtype == bool:  # of corners there are no more
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
    """The run that a history of `simulate` was made by.

    Raises
    ------
    InputError
        It was read from a folder.
    """
    require_class("history", history, History)
    if history.solved is None:
        raise InputError("a history that was read says nothing more of its run: simulate it")
    return cast(Recorder, history.solved)


def course_of(solved: Recorder) -> Course:
    """Course of a run, or of the cycle under way, after the state that it began with."""
    first = solved.first
    found = solved.history().each(lambda own: own[first:])
    return Course(**vars(found), base=solved.run, start=solved.began, search=solved.cycles)


def recorded(
    run: Run,
    end: float,
    cycles: PeriodicSolver | None = None,
    look: Callable[[MechanismStep], Mapping[str, float]] = lambda step: {},
) -> Course:
    """Steps of a run to its end [s], or of the last cycle of a search, with columns of each."""
    size = run.equations.system.n + run.equations.responses.size
    start, number = run.state, 1
    rows: list[dict[str, Any]] = []
    for step in run.until(end) if cycles is None else cycles:
        if cycles is not None and (not rows or cycles.number != number):
            start, rows, number = cycles.began, [], cycles.number
        row: dict[str, Any] = {"time_s": step.time, **look(step), **solution(run, step)}
        row["state/accelerations"] = step.acceleration[:size]
        rows.append(row)
    found = history_of(run.equations.system, rows)
    return Course(**vars(found), base=run, start=start, search=cycles)


def finer_grid(grid: FilmGrid) -> FilmGrid:
    """`FINER` times as many cells either way, graded alike."""
    return FilmGrid(grid.radius, _divided(grid.angles), _divided(grid.heights), grid.family)


def _divided(boundaries: np.ndarray) -> np.ndarray:
    cells = len(boundaries) - 1
    finer = np.linspace(0.0, cells, int(np.ceil(FINER * cells)) + 1)
    return np.interp(finer, np.arange(cells + 1), boundaries)


def with_finer_films(mechanism: Mechanism) -> Mechanism:
    """The mechanism, all its films on `finer_grid`, its boundaries on the edges of grooves.

    Raises
    ------
    SettingsError
        Edges of grooves are nearer than its cells.
    """
    joints = dict(mechanism.joints)
    for name, joint in mechanism.joints.items():
        if isinstance(joint, LubricatedJoint):
            own = joint.film.parameters
            edges = np.array([edge for groove in own.regions for edge in groove.edges])
            grid = aligned_grid(finer_grid(own.grid), edges)
            joints[name] = replace(joint, film=Film(replace(own, grid=grid)))
    return replace(mechanism, joints=joints)


def readings(own: Run, other: Run) -> list[sparse.spmatrix]:
    """Interpolations of nodal values of a run's films on the nodes of the same films of another.

    Where there are as many, these are the same, maybe moved.
    """
    found = []
    for films in zip(own.equations.system.films, other.equations.system.films, strict=True):
        grid, wanted = (binding.film.film.parameters.grid for binding in films)
        angle, height = wanted.node_positions.T
        if len(grid.nodes) == len(wanted.nodes):
            found.append(sparse.identity(len(grid.nodes), format="csr"))
        else:
            found.append(grid.interpolation(angle, height * grid.width / wanted.width))
    return found


def taken_over(state: RunState, own: Run, other: Run, span: float = 1.0) -> RunState:
    """A state of a run for another one with the same coordinates.

    Parameters
    ----------
    state, own, other
        Motion is taken as it is, of oil that is accounted for the void's share of the gap.
    span
        Time in the other run over that in this one.
    """
    size = other.equations.system.n + other.equations.responses.size
    read, moved = readings(own, other), []
    for point in state.x:
        gaps, wanted = (run.norm.film_gaps(run.norm.observe(point)) for run in (own, other))
        volumes = []
        for i, film in enumerate(other.equations.films):
            fractions = own.equations.films[i].content.void_fractions(point, gaps[i])
            if fractions is not None:
                fractions = read[i] @ fractions
            volumes.append(film.content.of_void_fractions(fractions, point, wanted[i]))
        moved.append(np.concatenate([point[:size], *volumes]))
    x = np.array(moved)
    rate = np.zeros_like(x)
    rate[:, :size] = state.rate[:, :size] / span
    observed = np.array([other.norm.observe(point) for point in x])
    return IntegratorState(state.times * span, x, rate, observed, state.step * span)


#: Smallest part of a step that is tried, and largest share of a course's time that may be left out
#: for want of a solution: with more there is no estimate.
LEAST_PART, MOST_LEFT_OUT = 1 / 16, 0.1


class Replay(Run):
    """A run along the course of another one.

    Parameters
    ----------
    run
        Which takes the steps, and stays where it is.
    course
        Of a run of the same mechanism, or of one that differs a little from it.
    tolerance
        On Newton's last update.
    start
        State that it begins in; None: that of the course.
    stride
        Steps of the course in one, where they grow slowly and no table has a row.
    changes
        Of the gap of every film where it is observed at the times of the course, shape (k, w) [m].
    alike
        Whether coordinates mean what they mean in the course, so that it is a guess.
    forgiving
        Whether a step without a solution is taken in parts and, if a part has none either, left
        out: the replay then continues from the course at its end.

    Attributes
    ----------
    iterations
        Of Newton's so far.
    left_out
        Time that was left out [s].
    """

    def __init__(
        self,
        run: Run,
        course: Course,
        tolerance: float,
        *,
        start: RunState | None = None,
        stride: int = 1,
        changes: Sequence[np.ndarray] = (),
        alike: bool = True,
        forgiving: bool = False,
    ):
        vars(self).update(vars(run))
        self.state = start or course.start
        self._course, self._tolerance, self._stride = course, tolerance, stride
        self._corners = course.state("corner")
        self._guess = _Guess(run, course) if alike else None
        self._changes = []
        for binding, observed in zip(self._system.films, changes, strict=False):
            gap = observed[:, : len(binding.film.thickness)]
            self._changes.append((gap, np.gradient(gap, course.times, axis=0)))
        self.iterations = 0
        self.left_out = 0.0
        self._forgiving = forgiving

    def until(self, end: float) -> Iterator[MechanismStep]:
        """All steps of the course, from the state it is in; `end` [s] is where they lead to.

        Raises
        ------
        StepSizeError
            There is no solution near the course.
        """
        course, began = self._course, self.state.time
        span = (end - began) / (course.times[-1] - course.began)
        times = began + span * (course.times - course.began)
        times[-1] = end
        if self._guess:
            self._guess.begin(self.state)
        past, row = float(np.ptp(self.state.times[:2])), -1
        while row < len(times) - 1:
            before = self.state.time
            ahead = self._next(times, row, past)
            step = self._step(ahead, float(times[ahead]))
            if step is None and ahead > row + 1:
                ahead = row + 1
                step = self._step(ahead, float(times[ahead]))
            if step is not None:
                yield step
            elif self._forgiving:
                yield from self._in_parts(ahead, float(times[ahead]))
                self._rejoin(ahead, float(times[ahead]))
            lost = self.left_out > MOST_LEFT_OUT * (end - began)
            if lost or (step is None and not self._forgiving):
                raise StepSizeError(f"no step from t = {before:.6g} s beside those of the run")
            row, past = ahead, self.state.time - before

    def _in_parts(self, row: int, time: float) -> Iterator[MechanismStep]:
        """Steps to a row of the course in two parts or more, as far as there are solutions."""
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
        """Continue from the course at one of its rows, unless it has been reached."""
        if self.state.time >= time:
            return
        self.left_out += time - self.state.time
        course, base = self._course, self._course.base
        x = course.x[row]
        gaps = base.norm.film_gaps(base.norm.observe(x))
        volumes = []
        for film, gap in zip(base.equations.films, gaps, strict=True):
            filled = course.joints[film.binding.name].film.fluid_fraction
            void = None if filled is None else 1.0 - np.asarray(filled[row])
            volumes.append(film.content.of_void_fractions(void, x, gap))
        point = np.concatenate([x, *volumes])
        rate = np.zeros_like(point)
        rate[: course.rates.shape[1]] = course.rates[row]
        state: RunState = IntegratorState.begin(base.norm, time, point, rate, self.control)
        self.state = taken_over(state, base, self)
        if self._guess:
            self._guess.forget()

    def _next(self, times: np.ndarray, row: int, past: float) -> int:
        """Row of the course to step to; no step leads over a corner, or misses a table's row."""
        time, ahead = self.state.time, min(row + self._stride, len(times) - 1)
        while ahead > row + 1 and times[ahead] - time > LONGEST * past:
            ahead -= 1
        if ahead > row + 1:
            order, nearest = self.state.usable_order(self.control.order), self.control.smallest
            tables, end = self._system.tables, float(times[ahead])
            reached = self.state.reach(self.norm, tables, end, order, nearest)
            if reached < end or self._corners[row + 1 : ahead].any():
                return row + 1
        return ahead

    def _step(self, row: int, time: float, share: float = 1.0) -> MechanismStep | None:
        """The step to a row of the course, or a share of the way there; None: no solution."""
        control, state, norm = self.control, self.state, self.norm
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
            (_along(gap, row, share), _along(rate, row, share)) for gap, rate in self._changes
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
        keep = 1 if self._corners[row] and share == 1.0 else control.order + 2
        self.state = state.after(new, time - state.time, solved.solver, keep)
        if self._guess:
            self._guess.learn(row, share, new, solved.solver)
        return new


def _along(
    values: np.ndarray, row: int, share: float, first: np.ndarray | None = None
) -> np.ndarray:
    """Values at a share of the way to a row of a course, whose start has the first or none."""
    if share == 1.0:
        return values[row]
    before = values[row - 1] if row else values[0] if first is None else first
    return (1.0 - share) * before + share * values[row]


class _Guess:
    """The next point: that of the course, and what differed from it at the last one.

    Parameters
    ----------
    run, course
        Which follows it.

    Attributes
    ----------
    patterns
        Residual patterns to take into the derivatives.
    """

    def __init__(self, run: Run, course: Course):
        equations = run.equations
        self._course, self.patterns = course, FEWEST_PATTERNS
        self._pressures = equations.lower == 0.0
        self._voids = ~self._pressures
        self._voids[equations.rest] = False
        # Unknowns of the course on the nodes of these films, coordinates left out.
        self._values = np.zeros((len(course), len(equations.lower)))
        multipliers = course.state("multipliers")
        # Another drive or joint has others: they begin at zero.
        if multipliers.shape[1] == equations.rest_size - equations.system.n:
            self._values[:, equations.rest][:, equations.system.n :] = multipliers
        each = zip(equations.films, equations.film_indices, readings(course.base, run), strict=True)
        for film, own, read in each:
            if not film.conserves_oil:
                self._voids[own] = False
            result = course.joints[film.binding.name].film
            for row, pressure in enumerate(np.asarray(result.pressure)):
                filled = result.fluid_fraction
                void = None if filled is None else read @ (1.0 - np.asarray(filled[row]))
                self._values[row, own] = film.unknowns(read @ pressure, void)
        self._last = np.zeros(course.x.shape[1]), np.zeros(len(equations.lower))

    def begin(self, state: RunState) -> None:
        """Begin at the start of the course, angles maybe whole turns further."""
        start = self._course.start.x[0][: self._course.x.shape[1]]
        self._last = state.x[0][: len(start)] - start, self._last[1]

    def forget(self) -> None:
        """Expect no difference from the course."""
        self._last = np.zeros_like(self._last[0]), np.zeros_like(self._last[1])

    def _course_at(self, row: int, share: float) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates with patterns, and values, of the course itself."""
        start = self._course.start.x[0][: self._course.x.shape[1]]
        x = _along(self._course.x, row, share, start)
        return x, _along(self._values, row, share)

    def at(self, row: int, share: float) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates with patterns, and values, at a share of the way to a row."""
        difference, more = self._last
        x, values = self._course_at(row, share)
        guess = values + more
        # Where the course cavitates there is no pressure, whatever differed there a step ago.
        guess[self._pressures] *= values[self._pressures] > 0.0
        guess[self._voids] = np.clip(guess[self._voids], 0.0, 1.0)
        return x + difference, guess

    def learn(self, row: int, share: float, step: Step[CoupledState], solver: SolverState) -> None:
        """Take the solution at a share of the way to a row."""
        x, values = self._course_at(row, share)
        self._last = step.x[: len(x)] - x, solver.values[0] - values
        self.patterns = solver.patterns


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
    course = course_of(solved_run(history))
    require_class("mechanism", mechanism, Mechanism)
    require_count("stride", stride, least=1)
    run = course.base.with_mechanism(mechanism)
    start = taken_over(course.start, course.base, run)
    tolerance = NEWTON_FRACTION * run.control.tolerance
    again = Replay(run, course, tolerance, start=start, stride=stride)
    recorder = Recorder(again, float(course.times[-1]))
    deque(recorder.steps(), maxlen=0)
    return summarised_history(recorder)
