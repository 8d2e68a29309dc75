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
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property, partial
from time import process_time
from typing import Any

import attrs
import numpy as np
from scipy import sparse

from fenics_ehd.analysis.replay import (
    FINER,
    Course,
    Replay,
    course_of,
    recorded,
    solved_run,
    taken_over,
    with_finer_films,
)
from fenics_ehd.base.errors import EhdError, SettingsError
from fenics_ehd.film.transfer import interpolation_matrix
from fenics_ehd.multibody.body import FlexibleBody
from fenics_ehd.multibody.history import History
from fenics_ehd.multibody.lubricated_joint import bore_surface, observed_positions, sampling_grid
from fenics_ehd.multibody.mechanism import FilmBinding, Instant, Motion, System
from fenics_ehd.multibody.periodic import CYCLE_NOISE
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.multibody.summary import RunSummary
from fenics_ehd.multibody.trust import (
    COMPONENTS,
    NOT_APPLICABLE,
    NOT_ESTIMATED,
    QUANTITIES,
    BasisErrorEstimate,
    bore_body,
    bore_loads,
    estimate_at,
)
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

#: Near an extreme the quantity is within this of it.
NEAR = 0.1


@dataclass(frozen=True, eq=False)
class ErrorCurves:
    """Curves over time of a run, or its last cycle, and of what the exact solution has more.

    All are of `QUANTITIES` of every joint, shape (2, k, joints) [Pa], [m].

    Attributes
    ----------
    course
        Of the run.
    """

    course: Course

    @cached_property
    def times(self) -> np.ndarray:
        """All at which curves are read, those of the run's steps among them, shape (k,) [s]."""
        times = self.course.times
        before = np.append(self.course.began, times[:-1])
        between = [times - share * (times - before) for share in np.arange(PARTS) / PARTS]
        return np.unique(between)

    def _at_steps(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Times and values of the run; of a cycle its end is its beginning, too."""
        times, period = self.course.times, self.course.period
        if period is None:
            return times, values
        return np.append(times[-1] - period, times), np.vstack([values[-1:], values])

    @cached_property
    def said(self) -> np.ndarray:
        """Peaks and films as the run says them."""
        return np.array([_linear(self.times, *self._at_steps(own)) for own in self.course.sampled])

    @cached_property
    def sampling(self) -> np.ndarray:
        """Excess of the values between nodes and steps over those at nodes and steps."""
        smooth = []
        for values in self.course.between_nodes:
            times, points = self._at_steps(values)
            found = _curve(times, points)(self.times)
            smooth.append(np.where(np.isfinite(found), found, points[0]))
        return np.array(smooth) - self.said

    def change(
        self, before: Course, after: Course, factor: float | np.ndarray, left: float = 0.0
    ) -> np.ndarray:
        """From a course to a changed one, times a factor.

        Of a change over a cycle the next one leaves a share of either sign, 0: nothing is known of
        cycles beyond the second.
        """
        found = []
        for own, changed in zip(before.between_nodes, after.between_nodes, strict=True):
            curves = _curve(before.times, own), _curve(after.times, changed)
            found.append(factor * self._between(*curves, min(left, SLOWEST)))
        return np.array(found)

    def _between(self, before: Callable, after: Callable, left: float) -> np.ndarray:
        first = after(self.times) - before(self.times)
        if self.course.period is None:
            return np.nan_to_num(first)
        later = self.times + self.course.period
        second = after(later) - before(later)
        more = second - np.where(np.isfinite(first), first, second)
        settled = second + left / (1.0 - left) * more
        return np.nan_to_num(np.where(np.isfinite(second), settled, first))

    def given(self, times: np.ndarray, more: Sequence[np.ndarray]) -> np.ndarray:
        """Changes of both quantities that are known at some times, shape (k, joints)."""
        return np.array([_linear(self.times, times, values) for values in more])


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
    said
        Curves of the run, see `ErrorCurves`.
    """

    quantity: str
    joint: int
    value: float
    said: np.ndarray

    def _outward(self, curves: np.ndarray) -> np.ndarray:
        """The quantity of the joint, + away from the extreme."""
        own = curves[QUANTITIES.index(self.quantity), :, self.joint]
        return own if self.quantity == "max_pressure" else -own

    def bias(self, changes: Sequence[np.ndarray]) -> float:
        """Relative error of the extreme by all of them together, + where the run says too much."""
        values = self._outward(self.said)
        more = sum(self._outward(change) for change in changes)
        moved = float((values + more).max() - values.max()) / abs(self.value)
        return 0.0 - moved if self.quantity == "max_pressure" else moved

    def near(self, change: np.ndarray) -> float:
        """Relative root mean square of a change near the extreme."""
        values, more = self._outward(self.said), self._outward(change)
        near = values >= values.max() - NEAR * abs(values.max())
        return float(np.sqrt(np.mean(more[near] ** 2)) / abs(self.value))

    def share(self, change: np.ndarray) -> float:
        """Error of the extreme by one component: the mean of what moves it and what moves nearby.

        That an extreme stays as it is while what surrounds it moves is luck.
        """
        return 0.5 * (abs(self.bias([change])) + self.near(change))

    def over(self, change: np.ndarray) -> float:
        """Largest relative change: of pressures over their peak, of films place by place."""
        values, more = self._outward(self.said), self._outward(change)
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


#: Displacement that a bore lacks, and how it is read where the gap of its film is observed.
Lacking = tuple[BasisErrorEstimate, sparse.spmatrix]


def lacking_in_basis(body: FlexibleBody, binding: FilmBinding) -> Lacking:
    """Displacement that the basis of a body lacks in the bore of a film.

    Raises
    ------
    SettingsError
        Its missing flexibility is not known.
    """
    estimate, bore = estimate_at(body, binding.bore), binding.film.bore
    if not estimate.known:
        raise SettingsError(f"{binding.name}: reduction.estimate_error is off")
    assert bore is not None
    # Outward displacements of the bore's nodes.
    radial = body.reduced.at_bore(binding.bore).bore_nodes * [1.0, 1.0, 0.0]
    radial /= np.linalg.norm(radial, axis=1)[:, None]
    nodes = np.repeat(np.arange(len(radial)), 3)
    outward = sparse.csr_matrix((radial.ravel(), (np.arange(radial.size), nodes)))
    return estimate, bore.observed_normal @ outward


def lacking_in_mesh(body: FlexibleBody, binding: FilmBinding) -> Lacking:
    """Displacement that the mesh of a part lacks under pressures and boundary forces.

    Raises
    ------
    SettingsError
        Of the part's mesh nothing is known.
    """
    missing, bores = body.reduced.mesh_flexibility, body.reduced.bores
    if not missing.size:
        raise SettingsError(
            f"{binding.bore_body}: no other mesh of the part is known, see output.part_mesh_error"
        )
    error = np.vsplit(missing, len(bores))[[*bores].index(binding.bore)]
    smooth = smooth_part(bores)
    pressed, forced = np.split(error, [len(smooth)], axis=1)
    error = np.hstack([pressed @ smooth, forced])
    grid, film = sampling_grid(bores[binding.bore]), binding.film.film
    surface = bore_surface(grid.nodes, grid.cell_nodes, grid.family)
    reading = interpolation_matrix(surface, *observed_positions(film))
    return BasisErrorEstimate(error, body.damping_time), reading


def lacking_gaps(
    equations: StepEquations,
    course: Course,
    lacking: Callable[[FlexibleBody, FilmBinding], Lacking],
    periodic: bool,
) -> list[np.ndarray]:
    """Changes of the gaps of all films along a course by the flexibility that their bores lack.

    Returns
    -------
    list
        Where the gaps are observed, shape (k, w) [m]; 0 of rigid bores.

    Raises
    ------
    SettingsError
        The flexibility is not known, or the course has a single step, of which no rate is known.
    """
    system, times, found = equations.system, course.times, []
    if len(times) < 2:
        raise SettingsError("a run of one step is too short to tell: raise time.end")
    loads, accelerations = _loads(system, course), course.state("accelerations")
    for binding in system.films:
        if not binding.bore:
            found.append(np.zeros((len(times), len(binding.film.observed))))
            continue
        estimate, reading = lacking(bore_body(system, binding), binding)
        own = equations.responses.of_body(binding.bore_body)
        fields: list[np.ndarray] = []
        # Twice, as the memory of the structure is that of the cycle before.
        for _ in range(2 if periodic else 1):
            fields, before = [], course.began
            for time, load, moved in zip(times, loads, accelerations, strict=True):
                starts = not periodic and time - course.began <= estimate.start
                pressed = load[binding.bore_body][: estimate.loads]
                acceleration = None if starts else moved[own]
                fields.append(estimate.field(time - before, pressed, acceleration))
                before = time
        found.append((reading @ np.transpose(fields)).T)
    return found


def _loads(system: System, course: Course) -> list[dict[str, np.ndarray]]:
    """At every step pressures in all bores of a body, then forces on its points, by its name."""
    rates = np.gradient(course.x[:, : system.n], course.times, axis=0)
    accelerations, multipliers = course.state("accelerations"), course.state("multipliers")
    found = []
    for row, time in enumerate(course.times):
        loads = bore_loads(system, [pressure[row] for pressure in course.pressures.values()])
        instant = Instant(system, time, course.x[row, : system.n])
        motion = Motion(
            instant, rates[row], accelerations[row, : system.n], multipliers[row, : system.m]
        )
        for name, pressures in loads.items():
            body = system.mechanism.bodies[name]
            assert isinstance(body, FlexibleBody)
            loads[name] = np.append(pressures, motion.on_points(name, body.reduced.points))
        found.append(loads)
    return found


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

#: What may go wrong beside a run, which is complete all the same.
FAILURES = (EhdError, ArithmeticError, ValueError)


@dataclass(frozen=True, eq=False)
class ErrorBudget:
    """Errors of a run by component.

    Attributes
    ----------
    joints
        By name: by quantity, extreme and ``largest_over_cycle``, a relative error of every
        component and in total, or why there is none.
    curves
        Of the run.
    changes
        Of components that are known over time: what the exact solution has more.
    notes
        Why a component is not estimated.
    left_out
        By component, share of the time at which it is not known: nothing was found there that the
        run could be compared with.
    iterations, seconds
        Newton iterations and processor time that it took [s].
    """

    joints: dict[str, dict[str, Any]]
    curves: ErrorCurves
    changes: dict[str, np.ndarray]
    notes: dict[str, str] = field(default_factory=dict)
    left_out: dict[str, float] = field(default_factory=dict)
    iterations: int = 0
    seconds: float = 0.0

    def over_time(self, start: float) -> dict[str, Any]:
        """What the exact solution has more by joint and component, from a time on [s]."""
        found: dict[str, Any] = {name: {} for name in self.joints}
        for component, change in self.changes.items():
            for i, own in enumerate(found.values()):
                curves = [*self.curves.said[..., i], *change[..., i]]
                values = np.vstack([self.curves.times - start, *curves])
                own[component] = dict(zip(OVER_TIME, values.tolist(), strict=True))
        return found


class Estimator:
    """Estimates the errors of a run that has come to its end.

    Parameters
    ----------
    solved
        The run.
    """

    def __init__(self, solved: Recorder):
        self._summary = RunSummary(solved)
        self._course = course_of(solved)
        self._run, self._cycles = solved.run, solved.cycles
        self._system = solved.run.equations.system
        self._curves, self.iterations = ErrorCurves(self._course), 0
        self._left_out = 0.0
        control = solved.run.control
        share_of_run = len(self._course.times) / solved.counts["steps"]
        self._other_formula = share_of_run <= SMALL_SHARE and control.order > 1
        growth = (LONG_ERROR / control.tolerance) ** (1.0 / (control.order + 1))
        coarse = control.tolerance >= COARSE and not self._other_formula
        self._stride = 1 if coarse else int(np.clip(growth, *STRIDES))
        self._long = self._course
        if self._cycles is not None:
            contraction = self._cycles.contraction
            least = max(contraction, float(np.finfo(float).tiny))
            share = float(np.log(FAST) / np.log(least)) if contraction < FAST else 1.0
            self._long = self._course.with_next(share)

    def budget(self) -> ErrorBudget:
        """All components."""
        began = process_time()
        changes: dict[str, np.ndarray] = {}
        notes: dict[str, str] = {}
        ways: dict[str, Callable[[Course], np.ndarray]] = {
            "step_size": self._change_by_steps,
            "film_mesh": self._change_by_films,
        }
        if any(binding.bore for binding in self._system.films):
            ways["basis"] = partial(self._change_by_gaps, lacking_in_basis)
            ways["part_mesh"] = partial(self._change_by_gaps, lacking_in_mesh)
        try:
            again = self._follow(self._long, stride=self._stride)
        except FAILURES as error:
            notes = dict.fromkeys(ways, _one_line(error))
            ways = {}
        left_out: dict[str, float] = {}
        common = self._left_out
        for name, change in ways.items():
            self._left_out = common
            try:
                changes[name] = change(again)
            except FAILURES as error:
                notes[name] = _one_line(error)
                continue
            if self._left_out:
                left_out[name] = self._left_out
        joints = {
            binding.name: self._joint(i, binding, changes)
            for i, binding in enumerate(self._system.films)
        }
        seconds = process_time() - began
        return ErrorBudget(joints, self._curves, changes, notes, left_out, self.iterations, seconds)

    def _follow(self, course: Course, run: Run | None = None, **how: Any) -> Course:
        """A course of the run once more, maybe by another run; see `Replay`."""
        tolerance = min(SETTLED * self._run.control.tolerance, LITTLE)
        replay = Replay(run or self._run, course, tolerance, forgiving=True, **how)
        end = float(course.times[-1])
        try:
            return recorded(replay, end)
        finally:
            self.iterations += replay.iterations
            self._left_out = max(self._left_out, replay.left_out / (end - course.began))

    def _change_by_steps(self, again: Course) -> np.ndarray:
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
        other = copy(self._run)
        other.control = attrs.evolve(control, blend=blend)
        return self._change(self._long, self._follow(self._long, other), factor)

    def _change(self, before: Course, after: Course, factor: float | np.ndarray) -> np.ndarray:
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

    def _change_by_films(self, again: Course) -> np.ndarray:
        finer = self._run.with_mechanism(with_finer_films(self._system.mechanism))
        found = self._follow(again, finer, start=taken_over(again.start, self._run, finer))
        grids = [binding.film.film.parameters.grid for binding in self._system.films]
        orders = np.array([FILM_ORDERS[grid.family != "bilinear"] for grid in grids])
        # Errors of the films' meshes over what finer ones change.
        return self._curves.sampling + self._change(again, found, 1.0 / (1.0 - FINER**-orders))

    def _change_by_gaps(
        self, lacking: Callable[[FlexibleBody, FilmBinding], Lacking], again: Course
    ) -> np.ndarray:
        missing = lacking_gaps(self._run.equations, again, lacking, self._cycles is not None)
        sizes = np.column_stack([np.abs(change).max(axis=1) for change in missing])
        peaks, films = again.between_nodes
        if not (sizes / films).max() > SMALL:
            return self._curves.given(again.times, [sizes / films * peaks, sizes])
        found = self._follow(again, changes=missing)
        return self._change(again, found.widened(missing), 1.0)

    def _joint(
        self, i: int, binding: FilmBinding, changes: Mapping[str, np.ndarray]
    ) -> dict[str, Any]:
        found: dict[str, Any] = {}
        largest: dict[str, Any] = {}
        known: dict[str, Any] = dict.fromkeys(COMPONENTS, NOT_ESTIMATED)
        if not binding.bore:
            known |= dict.fromkeys(OF_BORES, NOT_APPLICABLE)
            changes = {name: own for name, own in changes.items() if name not in OF_BORES}
        for quantity in QUANTITIES:
            value = self._summary.extremes[binding.name][quantity][0]
            extreme = Extreme(quantity, i, value, self._curves.said)
            own, over = (known | {"start": start} for start in self._start(binding.name, quantity))
            for name, change in changes.items():
                own[name], over[name] = extreme.share(change), extreme.over(change)
            found[quantity], largest[quantity] = summed(own), summed(over)
            found[quantity]["between_nodes"] = extreme.near(self._curves.sampling)
            found[quantity]["bias"] = extreme.bias([*changes.values()])
        return found | {"largest_over_cycle": largest}

    def _start(self, joint: str, quantity: str) -> tuple[Any, Any]:
        """Distance from the periodic state."""
        cycles = self._cycles
        if cycles is None:
            return NOT_APPLICABLE, NOT_APPLICABLE
        contraction = cycles.contraction
        if not contraction < 1.0:
            noise = max(cycles.periodicity, CYCLE_NOISE * self._run.control.tolerance)
            if not max(cycles.moved, cycles.left) <= noise:
                return NOT_ESTIMATED, NOT_ESTIMATED
            # The changes are noise: their ratio is not the rate at which a cycle forgets its start.
            contraction = SLOWEST
        left = cycles.left / (1.0 - contraction)
        now = self._summary.extremes[joint][quantity][0]
        then = self._summary.former_extremes[joint][quantity][0]
        part = left / cycles.moved if cycles.moved else 0.0
        extreme = float(part * abs(now - then) / now)
        return extreme, max(extreme, float(left))


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def error_budget(history: History) -> ErrorBudget:
    """Estimate the errors of a run from `simulate`.

    Raises
    ------
    InputError
        The history was read from a folder.
    """
    return Estimator(solved_run(history)).budget()
