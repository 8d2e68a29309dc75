"""Error budget of a run: errors of its peak pressures and thinnest films, by their causes.

The last cycle of a periodic run, or all of another one, is solved again beside itself (`Replay`),
with one thing different at a time:

step size
    in steps as long as two or more of the run's: what changes is a multiple of the error, by the
    order of the formula (Richardson); of a run of many cycles by another formula;
film mesh
    in the same long steps, on films of half as many cells again either way;
basis
    in the same steps, the gaps changed by what the basis lacks: missing flexibility, or with M4
    the inertia of the residual patterns;
part mesh
    the same with what another mesh of the part changes in its flexibility;
start
    from how far the last cycles began from one another, how much of that was left at their ends,
    and what their extremes differed.

Errors so travel along the motion as they do in the run. A cycle is followed beyond its end until
what is different has found its own cycle; a change is then what it is the second time.

Steps that are long meet an extreme on either side of it, and what they change there changes its
sign: courses are compared as smooth curves (`ErrorCurves`). What a run says of itself is sampled,
at nodes and at steps: how far that is from its own smooth curve is part of the errors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from time import process_time
from typing import Any, NamedTuple, TypeVar

import numpy as np
from scipy import sparse

from fenics_ehd.analysis.replay import (
    FINER,
    Course,
    CourseRecorder,
    Replay,
    course_of,
    grids_of,
    solved_run,
    taken_over,
    with_finer_films,
)
from fenics_ehd.base.errors import EhdError, SettingsError
from fenics_ehd.film.transfer import interpolation_matrix
from fenics_ehd.multibody.body import FlexibleBody
from fenics_ehd.multibody.error_shares import (
    COMPONENTS,
    NOT_APPLICABLE,
    NOT_ESTIMATED,
    QUANTITIES,
    BasisErrorEstimate,
    bore_body,
    bore_loads,
    estimate_at,
)
from fenics_ehd.multibody.history import History
from fenics_ehd.multibody.lubricated_joint import bore_surface, sampling_grid
from fenics_ehd.multibody.mechanism import FilmPlace, Instant, Motion, System
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.simulation import Simulation
from fenics_ehd.multibody.step_equations import Disturbance, StepEquations
from fenics_ehd.reduction.mesh_error import smooth_part

#: Newton stops when what is left of its update is below so many tolerances of a step, but not above
#: this where that tolerance is smaller: of differences that are looked for it is little.
SETTLED, LITTLE = 5.0, 5e-4

#: Parts of a step between which curves are read.
PARTS = 5

#: What differs is followed beyond a cycle's end until this share is left of its beginning, at
#: most for a second cycle.
FAST = 0.3

#: Share left from cycle to cycle above which what is to come is not extrapolated further.
SLOWEST = 0.9


@dataclass(frozen=True, eq=False)
class Change:
    """Estimated error of a component over time: what the exact solution has more.

    Attributes
    ----------
    times
        shape (k,) [s].
    said
        `QUANTITIES` as the run says them, shape (2, k, joints) [Pa], [m].
    more
        Likewise.
    """

    times: np.ndarray
    said: np.ndarray
    more: np.ndarray


@dataclass(frozen=True, eq=False)
class ErrorCurves:
    """Curves of a run's course and of its errors, over time.

    Attributes
    ----------
    course
        Of its last cycle, or all of it.
    period
        Of a cycle [s], None of a run that is not periodic.
    """

    course: Course
    period: float | None = None

    @cached_property
    def times(self) -> np.ndarray:
        """All at which curves are read, those of the run's steps among them [s]."""
        times = self.course.times
        before = np.append(self.course.began, times[:-1])
        between = [times - share * (times - before) for share in np.arange(PARTS) / PARTS]
        return np.unique(between)

    def _at_steps(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Times and values of the run; of a cycle its end is its beginning, too."""
        times = self.course.times
        if self.period is None:
            return times, values
        return np.append(times[-1] - self.period, times), np.vstack([values[-1:], values])

    @cached_property
    def own(self) -> np.ndarray:
        """Peaks and films as the run says them, shape (2, k, joints)."""
        return np.array([_linear(self.times, *self._at_steps(own)) for own in self.course.sampled])

    @cached_property
    def sampling(self) -> Change:
        """Excess of the values between nodes and steps over those at nodes and steps."""
        smooth = []
        for values in self.course.between_nodes:
            times, points = self._at_steps(values)
            found = _curve(times, points)(self.times)
            smooth.append(np.where(np.isfinite(found), found, points[0]))
        return Change(self.times, self.own, np.array(smooth) - self.own)

    def change(
        self, before: Course, after: Course, factor: float | np.ndarray, left: float = 0.0
    ) -> Change:
        """From a course to a changed one, times a factor.

        Of a change over a cycle the next one leaves a share of either sign, 0: nothing is known of
        cycles beyond the second.
        """
        found = []
        for quantity in range(len(QUANTITIES)):
            curves = [_curve(each.times, each.between_nodes[quantity]) for each in (before, after)]
            found.append(factor * self._between(curves, min(left, SLOWEST)))
        return Change(self.times, self.own, np.array(found))

    def _between(self, curves: Sequence[Callable], left: float) -> np.ndarray:
        before, after = curves
        first = after(self.times) - before(self.times)
        if self.period is None:
            return np.nan_to_num(first)
        later = self.times + self.period
        second = after(later) - before(later)
        more = second - np.where(np.isfinite(first), first, second)
        settled = second + left / (1.0 - left) * more
        return np.nan_to_num(np.where(np.isfinite(second), settled, first))

    def given(self, times: np.ndarray, more: Sequence[np.ndarray]) -> Change:
        """Changes of both quantities that are known at some times, shape (k, joints)."""
        found = np.array([_linear(self.times, times, values) for values in more])
        return Change(self.times, self.own, found)


def _linear(wanted: np.ndarray, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Broken lines through values, shape (k, joints)."""
    return np.column_stack([np.interp(wanted, times, own) for own in values.T])


def _curve(times: np.ndarray, values: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Smooth curves through values, shape (k, joints); nan where there are none."""
    if len(times) < 2:
        return lambda wanted: np.full((len(wanted), values.shape[1]), np.nan)
    from scipy.interpolate import Akima1DInterpolator  # slow to import, and for budgets alone

    curve = Akima1DInterpolator(times, values)
    return lambda wanted: np.asarray(curve(wanted, extrapolate=False))


#: Near an extreme the quantity is within this of it.
NEAR = 0.1


@dataclass(frozen=True, eq=False)
class Extreme:
    """Peak pressure or thinnest film of a joint, as a run says it.

    Attributes
    ----------
    quantity
        ``"max_pressure"`` or ``"min_film_thickness"``.
    joint
        Its number.
    value
        [Pa], [m].
    """

    quantity: str
    joint: int
    value: float

    def curves(self, change: Change) -> tuple[np.ndarray, np.ndarray]:
        """Values of the run and what the exact solution has more, + away from the extreme."""
        place, sign = (
            QUANTITIES.index(self.quantity),
            1.0 if self.quantity == "max_pressure" else -1.0,
        )
        said, more = (own[place, :, self.joint] for own in (change.said, change.more))
        return sign * said, sign * more

    def bias(self, changes: Sequence[Change]) -> float:
        """Relative error of the extreme by all of them together, + where the run says too much."""
        curves = [self.curves(change) for change in changes]
        values = curves[0][0]
        more = np.sum([own for _, own in curves], axis=0)
        moved = float((values + more).max() - values.max()) / abs(self.value)
        return -moved if self.quantity == "max_pressure" else moved

    def near(self, change: Change) -> float:
        """Relative root mean square of a change near the extreme."""
        values, more = self.curves(change)
        near = values >= values.max() - NEAR * abs(values.max())
        return float(np.sqrt(np.mean(more[near] ** 2)) / abs(self.value))

    def share(self, change: Change) -> float:
        """Error of the extreme by one component: the mean of what moves it and what moves nearby.

        That an extreme stays as it is while what surrounds it moves is luck.
        """
        return 0.5 * (abs(self.bias([change])) + self.near(change))

    def over(self, change: Change) -> float:
        """Largest relative change: of pressures over their peak, of films place by place."""
        values, more = self.curves(change)
        scale = np.abs(values) if self.quantity == "min_film_thickness" else abs(self.value)
        return float((np.abs(more) / scale).max())


def summed(errors: Mapping[str, Any]) -> dict[str, Any]:
    """Errors by component with their plain sum.

    Errors of one sign add up, and that those of two cancel is luck.

    Returns
    -------
    dict
        Also ``known``, the sum of those that are estimated, and ``total``, which is the same, or
        ``"not estimated"`` where one of them is.
    """
    own = [errors[component] for component in COMPONENTS]
    shares = [error for error in own if not isinstance(error, str)]
    known = float(sum(shares)) if shares else NOT_ESTIMATED
    return {**errors, "known": known, "total": NOT_ESTIMATED if NOT_ESTIMATED in own else known}


class Lacking(NamedTuple):
    """Displacement that a bore lacks, and how it is read where the gap of its film is observed."""

    estimate: BasisErrorEstimate
    reading: sparse.spmatrix


def lacking_in_basis(system: System) -> dict[str, Lacking]:
    """Displacements that bases lack, by joint.

    Raises
    ------
    SettingsError
        Their missing flexibility is not known.
    """
    found = {}
    for place in system.films:
        if place.bore:
            estimate = estimate_at(bore_body(system, place), place.bore)
            if not estimate.known:
                raise SettingsError(f"{place.name}: reduction.estimate_error is off")
            found[place.name] = Lacking(estimate, _reading_of_nodes(system, place))
    return found


def lacking_in_mesh(system: System) -> dict[str, Lacking]:
    """Displacements that meshes of parts lack under pressures and boundary forces, by joint.

    Raises
    ------
    SettingsError
        Of a part's mesh nothing is known.
    """
    found = {}
    for place in system.films:
        if place.bore:
            body = bore_body(system, place)
            missing = body.reduced.mesh_flexibility
            if not missing.size:
                raise SettingsError(
                    f"{place.bore_body}: no other mesh of the part is known, see "
                    "output.part_mesh_error"
                )
            bores = body.reduced.bores
            error = np.vsplit(missing, len(bores))[[*bores].index(place.bore)]
            smooth = smooth_part(bores)
            pressed, forced = np.split(error, [len(smooth)], axis=1)
            error = np.hstack([pressed @ smooth, forced])
            estimate = BasisErrorEstimate(error, body.damping_time)
            grid, film = sampling_grid(bores[place.bore]), place.film.film
            surface = bore_surface(grid.nodes, grid.cell_nodes, grid.family)
            inside = np.column_stack([film.points.angle.ravel(), film.points.height.ravel()])
            observed = np.vstack([inside, film.parameters.grid.node_positions])
            found[place.name] = Lacking(estimate, interpolation_matrix(surface, *observed.T))
    return found


def lacking_gaps(
    equations: StepEquations,
    course: Course,
    lacking: Mapping[str, Lacking],
    periodic: bool,
) -> Disturbance:
    """Changes of the gaps along a course by the flexibility that joints lack."""
    system = equations.system
    rows, began = range(len(course.times)), course.began
    rates = np.gradient(course.x[:, : system.n], course.times, axis=0)
    loads = [_loads(system, course, k, rates[k]) for k in rows]
    steps = np.diff(course.times, prepend=began)
    fields: dict[str, list[np.ndarray]] = {}
    # Twice, as the memory of the structure is that of the cycle before.
    for _ in range(2 if periodic else 1):
        fields = {name: [] for name in lacking}
        for k in rows:
            for place in system.films:
                if place.bore:
                    own = equations.responses.of_body(place.bore_body)
                    estimate, load = lacking[place.name].estimate, loads[k][place.bore_body]
                    starts = not periodic and course.times[k] - began <= estimate.start
                    moved = None if starts else course.accelerations[k][own]
                    fields[place.name].append(
                        estimate.field(steps[k], load[: estimate.loads], moved)
                    )
    observed = [
        lacking[place.name].reading.dot(np.transpose(fields[place.name])).T if place.bore else None
        for place in system.films
    ]
    return Disturbance(
        course.times, observed, [len(place.film.thickness) for place in system.films]
    )


def _loads(system: System, course: Course, row: int, rates: np.ndarray) -> dict[str, np.ndarray]:
    """Nodal pressures in all bores of a body, then forces on its boundary points, by its name."""
    found = bore_loads(system, [pressure[row] for pressure in course.pressures.values()])
    instant = Instant(system, course.times[row], course.x[row, : system.n])
    accelerations, multipliers = course.accelerations[row], course.multipliers[row]
    motion = Motion(instant, rates, accelerations[: system.n], multipliers[: system.m])
    for name, pressures in found.items():
        body = system.mechanism.bodies[name]
        assert isinstance(body, FlexibleBody)
        found[name] = np.append(pressures, motion.on_points(name, body.reduced.points))
    return found


def _reading_of_nodes(system: System, place: FilmPlace) -> sparse.spmatrix:
    """Change of the gap where it is observed, of outward displacements of the bore's nodes."""
    bore = place.film.bore
    assert bore is not None
    radial = bore_body(system, place).reduced.at_bore(place.bore).bore_nodes * [1.0, 1.0, 0.0]
    radial /= np.linalg.norm(radial, axis=1)[:, None]
    nodes = np.repeat(np.arange(len(radial)), 3)
    return bore.observed_normal @ sparse.csr_matrix(
        (radial.ravel(), (np.arange(radial.size), nodes))
    )


#: Those of flexible bores.
OF_BORES = ("basis", "part_mesh")

#: Local error that long steps may have, and least and most steps of the run in one of them.
LONG_ERROR, STRIDES = 0.03, (2, 4)

#: Tolerance of a step from which on longer ones tell nothing, and shorter ones are taken. By twice
#: as long ones the steps of a crank that a torque drives are taken for 0.7 % where 3.4 % are true
#: (3e-3, order 3), those of a journal for 26 % in place of 0.7 %; by half as long ones for 4.2 and
#: 8.8 %.
COARSE = 2e-3

#: Share of the course in the run's steps below which the error of the steps is found in as many of
#: them by a formula of another blend: long ones may be too long for a mode that they must resolve.
SMALL_SHARE, OTHER_BLEND = 0.2, 0.5

#: Orders that errors of the film's mesh are taken to have, of 4-node cells and of others.
FILM_ORDERS = (2.0, 4.0)

#: Gap errors below this, relative to the film, stand for what they do to it and to the pressure.
SMALL = 1e-3

#: Curves of a component in ``error_budget.json``.
OVER_TIME = (
    "time_s",
    "max_pressure_Pa",
    "min_film_thickness_m",
    "more_max_pressure_Pa",
    "more_min_film_thickness_m",
)

Found = TypeVar("Found")


@dataclass(frozen=True, eq=False)
class ErrorBudget:
    """Errors of a run by component.

    Attributes
    ----------
    joints
        By name: by quantity, extreme and ``largest_over_cycle``, a relative error of every
        component and in total, or why there is none.
    changes
        Of components that are known over time.
    notes
        Why a component is not estimated.
    iterations, seconds
        Newton iterations and processor time that it took [s].
    """

    joints: dict[str, dict[str, Any]]
    changes: dict[str, Change]
    notes: dict[str, str] = field(default_factory=dict)
    iterations: int = 0
    seconds: float = 0.0

    def over_time(self, start: float) -> dict[str, Any]:
        """What the exact solution has more by joint and component, from a time on [s]."""
        found: dict[str, Any] = {name: {} for name in self.joints}
        for component, change in self.changes.items():
            for i, own in enumerate(found.values()):
                values = np.vstack(
                    [change.times - start, *change.said[..., i], *change.more[..., i]]
                )
                own[component] = dict(zip(OVER_TIME, values.tolist(), strict=True))
        return found


class Estimator:
    """Estimates the errors of a run that has come to its end.

    Parameters
    ----------
    solved
        The run.
    """

    def __init__(self, solved: Simulation):
        run, cycles, tracker = solved.run, solved.cycles, solved.tracker
        course = course_of(solved)
        self._run, self._cycles, self._course = run, cycles, course
        self._system = run.equations.system
        self._extremes, self._former = tracker.extremes, tracker.former
        control, share_of_run = run.control, len(course.times) / tracker.counts["steps"]
        self._other_formula = share_of_run <= SMALL_SHARE and control.order > 1
        growth = (LONG_ERROR / control.tolerance) ** (1.0 / (control.order + 1))
        coarse = control.tolerance >= COARSE and not self._other_formula
        self._stride = 1 if coarse else int(np.clip(growth, *STRIDES))
        self._grids = grids_of(run)
        self.iterations = 0
        self._long, self._curves = course, ErrorCurves(course)
        if cycles is not None:
            self._curves = ErrorCurves(course, cycles.period)
            slow = not cycles.contraction < FAST
            least = max(cycles.contraction, float(np.finfo(float).tiny))
            share = 1.0 if slow else float(np.log(FAST) / np.log(least))
            self._long = course.repeated(cycles.period, cycles.angles, share)

    def budget(self) -> ErrorBudget:
        """All components."""
        began = process_time()
        changes: dict[str, Change] = {}
        notes: dict[str, str] = {}
        again = self._try("step_size", notes, lambda: self._follow(self._long, stride=self._stride))
        if again is None:
            notes |= dict.fromkeys(("film_mesh", *OF_BORES), notes["step_size"])
        else:
            for name, change in self._ways().items():
                found = self._try(name, notes, partial(change, again))
                if found is not None:
                    changes[name] = found
        joints = {
            place.name: self._joint(i, place, changes) for i, place in enumerate(self._system.films)
        }
        return ErrorBudget(joints, changes, notes, self.iterations, process_time() - began)

    def _ways(self) -> dict[str, Callable[[Course], Change]]:
        """Methods that find the change by a component, from the course in long steps."""
        found: dict[str, Callable[[Course], Change]] = {
            "step_size": self._change_by_steps,
            "film_mesh": self._change_by_films,
        }
        if any(place.bore for place in self._system.films):
            found["basis"] = partial(self._change_by_gaps, lacking_in_basis)
            found["part_mesh"] = partial(self._change_by_gaps, lacking_in_mesh)
        return found

    @staticmethod
    def _try(component: str, notes: dict[str, str], solve: Callable[[], Found]) -> Found | None:
        try:
            return solve()
        # Whatever goes wrong beside a run, the run is complete.
        except (EhdError, ArithmeticError, ValueError) as error:
            notes[component] = " ".join(str(error).split())
            return None

    def _follow(self, course: Course, run: Run | None = None, **how: Any) -> Course:
        """A course of the run once more, maybe by a run of another mechanism; see `Replay`."""
        tolerance = min(SETTLED * self._run.control.tolerance, LITTLE)
        replay = Replay(run or self._run, course, tolerance, grids=self._grids, **how)
        if run is None:
            replay.state = course.start
        recorder, missing = CourseRecorder(replay), how.get("disturbance")
        try:
            for step in replay.until(float(course.times[-1])):
                recorder.add(step, missing and missing.observed_at(replay.row))
        finally:
            self.iterations += replay.iterations
        return recorder.course()

    def _change_by_steps(self, again: Course) -> Change:
        control = self._run.control
        if self._stride == 1:
            found = self._follow(self._long.halved())
            return self._change(self._long, found, 1.0 / (1.0 - 2.0**-control.order))
        if not self._other_formula:
            factor = -1.0 / (self._stride**control.order - 1.0)
            return self._change(self._long, again, factor)
        # Errors are as what a blend leaves of the lower order.
        blend = 0.0 if control.blend else OTHER_BLEND
        factor = (1.0 - control.blend) / (blend - control.blend)
        found = self._follow(self._long, control=replace(control, blend=blend))
        return self._change(self._long, found, factor)

    def _change(self, before: Course, after: Course, factor: float | np.ndarray) -> Change:
        return self._curves.change(before, after, factor, self._left(before, after))

    def _left(self, before: Course, after: Course) -> float:
        """Share of what differs after one cycle that the next leaves of it, - of other sign.

        How far a cycle forgets says nothing of that: a whirl at half the speed comes back with the
        other sign, and what a cycle changes is most of the error then.
        """
        cycles, norm, size = self._cycles, self._run.norm, self._course.x.shape[1]
        if cycles is None or cycles.contraction < FAST:
            return 0.0
        times, *rows = np.intersect1d(before.times, after.times, return_indices=True)
        own, changed = (
            np.array([norm.gaps(norm.observe(x[:size])) for x in course.x[found]])
            for course, found in zip((before, after), rows, strict=True)
        )
        apart = changed - own
        first = times[-1] - cycles.period
        once = np.array([np.interp(first, times, column) for column in apart.T])
        return float((apart[-1] - once) @ once / (once @ once)) if once.any() else 0.0

    def _change_by_films(self, again: Course) -> Change:
        finer = self._run.with_mechanism(with_finer_films(self._system.mechanism))
        finer.state = taken_over(again.start, self._run, finer)
        found = self._follow(again, finer)
        orders = np.array([FILM_ORDERS[grid.family != "bilinear"] for grid in self._grids])
        # Errors of the films' meshes over what finer ones change.
        change = self._change(again, found, 1.0 / (1.0 - FINER**-orders))
        return replace(change, more=change.more + self._curves.sampling.more)

    def _change_by_gaps(
        self, lacking: Callable[[System], Mapping[str, Lacking]], again: Course
    ) -> Change:
        periodic = self._cycles is not None
        missing = lacking_gaps(self._run.equations, again, lacking(self._system), periodic)
        none = np.zeros(len(again.times))
        sizes = np.column_stack(
            [none if change is None else np.abs(change).max(axis=1) for change in missing.observed]
        )
        peaks, films = again.between_nodes
        if not (sizes / films).max() > SMALL:
            return self._curves.given(again.times, [sizes / films * peaks, sizes])
        found = self._follow(again, disturbance=missing)
        return self._change(again, found, 1.0)

    def _joint(self, i: int, place: FilmPlace, changes: Mapping[str, Change]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        largest: dict[str, Any] = {}
        known: dict[str, Any] = dict.fromkeys(COMPONENTS, NOT_ESTIMATED)
        if not place.bore:
            known |= dict.fromkeys(OF_BORES, NOT_APPLICABLE)
            changes = {name: own for name, own in changes.items() if name not in OF_BORES}
        for quantity in QUANTITIES:
            extreme = Extreme(quantity, i, self._extremes[place.name][quantity][0])
            own, over = (known | {"start": start} for start in self._start(place.name, quantity))
            for name, change in changes.items():
                own[name], over[name] = extreme.share(change), extreme.over(change)
            found[quantity], largest[quantity] = summed(own), summed(over)
            found[quantity]["between_nodes"] = extreme.near(self._curves.sampling)
            found[quantity]["bias"] = extreme.bias([*changes.values()]) if changes else 0.0
        return found | {"largest_over_cycle": largest}

    def _start(self, joint: str, quantity: str) -> tuple[Any, Any]:
        """Distance from the periodic state."""
        cycles = self._cycles
        if cycles is None:
            return NOT_APPLICABLE, NOT_APPLICABLE
        if not cycles.contraction < 1.0:
            return NOT_ESTIMATED, NOT_ESTIMATED
        left = cycles.left / (1.0 - cycles.contraction)
        now, then = (found[joint][quantity][0] for found in (self._extremes, self._former))
        part = left / cycles.moved if cycles.moved else 0.0
        extreme = float(part * abs(now - then) / now)
        return extreme, max(extreme, float(left))


def error_budget(history: History) -> ErrorBudget:
    """Estimate the errors of a run from `simulate`.

    Raises
    ------
    InputError
        The history was read from a folder.
    """
    return Estimator(solved_run(history)).budget()
