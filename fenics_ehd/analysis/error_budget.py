"""Error budget of a run: errors of peak pressure and thinnest film of every joint, by cause.

The last cycle of a periodic run, or the whole of any other run, is solved again (`Replay`) with one
difference at a time:

step size
    Each step is as long as two or more steps of the run. The ratio of the resulting change to the
    error follows from the order of the formula (Richardson). If the run has a coarse tolerance, its
    steps are halved instead. The last cycle of a run of many cycles is solved with another blend of
    the formulas of two orders instead.
film mesh
    The steps are the same long steps, and the films have 1.5 times as many cells in both
    directions.
basis
    The steps are the same long steps, and the gaps are changed by the flexibility that the basis
    lacks. For a basis of the reduction method M4, this is the verified error of its flexibility, if
    possible verified with the pressures of the run, and the inertia of its residual patterns.
part mesh
    As for the basis, with the flexibility that another mesh of the part adds.
start
    Nothing is solved again. The error follows from the distance between the starts of the last two
    cycles, the share of this distance that remains after a cycle, and the difference between the
    extremes of both cycles.

Errors thus grow or decay along the motion of a replay, as in the run. The replay of a cycle is
continued into a second cycle, and the change in the second cycle is the result.

A long step can end before or after an extreme. Near an extreme, differences between values at steps
would therefore have an arbitrary sign, so that trajectories are compared as smooth curves
(`ErrorCurves`). Extremes of a run are interpolated between nodes and steps
(`fenics_ehd.base.extremes`), so that the budget needs no component for the distances of nodes and
steps.
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

from fenics_ehd.analysis.error_curves import EXTREME_COLUMNS, SLOWEST, ErrorCurves, Extreme
from fenics_ehd.analysis.figure_errors import FigureErrors
from fenics_ehd.analysis.flexibility_check import PartInMemory, checked_errors
from fenics_ehd.analysis.replay import (
    FINER,
    Replay,
    Trajectory,
    recorded,
    solved_run,
    trajectory_of,
    transferred_state,
    with_finer_films,
)
from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import EhdError, SettingsError
from fenics_ehd.base.progress import SILENT, Progress, chosen_progress
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.history import History
from fenics_ehd.multibody.mechanism import Instant, Motion, System
from fenics_ehd.multibody.newton import MechanismStep
from fenics_ehd.multibody.periodic import CYCLE_NOISE, PeriodicSolver
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.multibody.summary import RunSummary
from fenics_ehd.multibody.surface import MissingFlexibility
from fenics_ehd.multibody.trust import (
    COMPONENTS,
    NOT_APPLICABLE,
    NOT_ESTIMATED,
    QUANTITIES,
    BasisErrorEstimate,
    surface_loads,
)

#: Tolerance of the last Newton update in a replay, relative to the tolerance of a step.
SETTLED = 5.0

#: Largest tolerance of the last Newton update, small against the differences of trajectories.
LITTLE = 5e-4

#: A difference is continued into a second cycle until this share of its initial size remains, but
#: not beyond the end of that cycle.
FAST = 0.3


def summed(errors: Mapping[str, Any]) -> dict[str, Any]:
    """Add the sum of all components to errors by component.

    The errors have no signs, because a cancellation of opposite errors is a coincidence.

    Returns
    -------
    dict
        The errors by component; ``known``, the sum of all estimated errors; and ``total``, the same
        sum, or ``"not estimated"`` if a component is not estimated.
    """
    each = [errors[component] for component in COMPONENTS]
    estimated = [error for error in each if not isinstance(error, str)]
    known = float(sum(estimated)) if estimated else NOT_ESTIMATED
    return {**errors, "known": known, "total": NOT_ESTIMATED if NOT_ESTIMATED in each else known}


#: Components of surfaces that deform, with the reason why such an error is not estimated. The texts
#: have fields for the names of a joint and of a body.
UNKNOWN = {
    "basis": "{joint}: reduction.estimate_error is off",
    "part_mesh": "{body}: no other mesh of the part is known, see output.part_mesh_error",
}


def missing_gaps(
    equations: StepEquations,
    trajectory: Trajectory,
    component: str,
    periodic: bool,
    scales: Mapping[str, float] | None = None,
) -> list[np.ndarray]:
    """Changes of the gaps of all films along a trajectory by flexibility that models lack.

    Parameters
    ----------
    equations, trajectory
        Equations of the mechanism, and the trajectory.
    component
        ``"basis"``: flexibility that the basis of a surface's body lacks; ``"part_mesh"``:
        flexibility that another mesh of the body's part adds.
    periodic
        Whether the trajectory is a cycle.
    scales
        Factors on the flexibility that a basis lacks, by body; 1 for bodies that are not listed.

    Returns
    -------
    list
        Change of the gap of every film at its w observed points and the k steps, shape (k, w) [m];
        0 between rigid surfaces.

    Raises
    ------
    SettingsError
        The flexibility is unknown, or the trajectory has a single step and therefore no rates.
    """
    times = trajectory.times
    if len(times) < 2:
        raise SettingsError("one step is too few to estimate errors: raise time.end")
    loads = _loads(equations.system, trajectory)
    changes = []
    for binding in equations.system.films:
        change = np.zeros((len(times), len(binding.film.observed)))
        own_angles = np.transpose([binding.own_angles(x) for x in trajectory.x])
        for bound, angles in zip(binding.surfaces, own_angles, strict=True):
            if not bound.surface.elastic:
                continue
            missing = bound.surface.missing_flexibility(component)
            if missing is None or not missing.known:
                reason = UNKNOWN[component].format(joint=binding.name, body=bound.body)
                raise SettingsError(reason)
            if component == "basis":
                missing = missing.scaled((scales or {}).get(bound.body, 1.0))
            of_body = [load[bound.body] for load in loads]
            amplitudes = equations.responses.of_body(bound.body)
            accelerations = trajectory.state("accelerations")[:, amplitudes]
            fields = _missing_fields(missing, trajectory, of_body, accelerations, periodic)
            change += missing.gap_changes(fields, angles)
        changes.append(change)
    return changes


def _missing_fields(
    missing: MissingFlexibility,
    trajectory: Trajectory,
    loads: Sequence[np.ndarray],
    accelerations: np.ndarray,
    periodic: bool,
) -> np.ndarray:
    """Displacements of a surface by its missing flexibility at all steps, shape (k, m) [m].

    `loads` are the loads on the surface's body at every step. `accelerations` are the accelerations
    of the amplitudes of its residual patterns at every step, shape (k, r).
    """
    estimate = BasisErrorEstimate.of(missing)
    fields: list[np.ndarray] = []
    # The second pass starts with the state of the structure at the end of the cycle.
    for _ in range(2 if periodic else 1):
        fields = []
        before = trajectory.began
        for time, load, accelerated in zip(trajectory.times, loads, accelerations, strict=True):
            starts = not periodic and time - trajectory.began <= estimate.start
            acceleration = None if starts else accelerated
            fields.append(estimate.field(time - before, load[: estimate.loads], acceleration))
            before = time
    return np.array(fields)


def _loads(system: System, trajectory: Trajectory) -> list[dict[str, np.ndarray]]:
    """Loads on each body at every step: pressures on surfaces [Pa], then forces on points [N]."""
    rates = np.gradient(trajectory.x[:, : system.n], trajectory.times, axis=0)
    accelerations = trajectory.state("accelerations")
    multipliers = trajectory.state("multipliers")
    each = []
    for row, time in enumerate(trajectory.times):
        pressures = [pressure[row] for pressure in trajectory.pressures.values()]
        loads = surface_loads(system, pressures, trajectory.x[row])
        instant = Instant(system, time, trajectory.x[row, : system.n])
        motion = Motion(
            instant, rates[row], accelerations[row, : system.n], multipliers[row, : system.m]
        )
        for name, load in loads.items():
            part = system.mechanism.bodies[name].reduced
            points = () if part is None else part.points
            loads[name] = np.append(load, motion.on_points(name, points))
        each.append(loads)
    return each


#: Largest local error of the long steps of a replay.
LONG_ERROR = 0.03

#: Smallest and largest number of the run's steps in a long step.
STRIDES = (2, 4)

#: Tolerance of a step from which steps are halved instead of made longer. At a tolerance of 3e-3
#: and order 3, steps twice as long give an estimated error of 0.7 % for a crank driven by a torque
#: (true: 3.4 %) and of 26 % for a journal (true: 0.7 %); steps half as long give 4.2 and 8.8 %.
COARSE = 2e-3

#: Ratio of the trajectory's steps to those of the run, up to which the step error is estimated with
#: a formula of another blend: long steps might not resolve a mode of the mechanism.
SMALL_SHARE = 0.2

#: Blend of the other formula.
OTHER_BLEND = 0.5

#: Assumed orders of film mesh errors: for 4-node cells, and for other cells.
FILM_ORDERS = (2.0, 4.0)

#: Relative change of the gap up to which the relative errors of film thickness and of pressure are
#: taken as equal to it, without a replay.
SMALL = 1e-3

#: Curves of a component in ``error_budget.json``.
OVER_TIME = (
    "time_s",
    "max_pressure_Pa",
    "min_film_thickness_m",
    "more_max_pressure_Pa",
    "more_min_film_thickness_m",
)

#: Exceptions that end an estimate, but not the run.
FAILURES = (EhdError, ArithmeticError, ValueError)


@dataclass(frozen=True, eq=False)
class ErrorBudget(Described):
    """Estimated errors of a run by component: step size, film mesh, basis, part mesh, start.

    Attributes
    ----------
    joints
        Relative errors of the extremes, by joint and quantity, then by component and as sums. In
        place of an error that is not estimated there is a text. The key ``largest_over_cycle`` of
        a joint has the largest errors over time in the same form.
    curves
        Curves of the run over time.
    changes
        Curves of errors (exact minus computed values), by component, see `ErrorCurves`; components
        without such curves are missing.
    notes
        Reasons why components are not estimated, by component.
    left_out
        Share of the simulated time in which a replay found no solution, by component.
    iterations
        Number of Newton iterations of the estimate.
    seconds
        Processor time of the estimate [s].
    flexibility_errors
        Relative errors of displacements under pressures of the run, by body, see
        `checked_errors`.
    """

    joints: dict[str, dict[str, Any]]
    curves: ErrorCurves
    changes: dict[str, np.ndarray]
    notes: dict[str, str] = field(default_factory=dict)
    left_out: dict[str, float] = field(default_factory=dict)
    iterations: int = 0
    seconds: float = 0.0
    flexibility_errors: dict[str, float] = field(default_factory=dict)

    def over_time(self, start: float) -> dict[str, Any]:
        """Values and errors over time since `start` [s], by joint, component and column."""
        joints: dict[str, Any] = {name: {} for name in self.joints}
        for component, change in self.changes.items():
            for i, components in enumerate(joints.values()):
                curves = [*self.curves.reported[:2, :, i], *change[:2, :, i]]
                values = np.vstack([self.curves.times - start, *curves])
                components[component] = dict(zip(OVER_TIME, values.tolist(), strict=True))
        return joints


class Estimator:
    """Estimator of the errors of a finished run.

    Parameters
    ----------
    solved
        Recorder of the run.
    parts
        Parts in memory, by the name of their body, see `checked_errors`.
    progress
        Progress in which the replays open their stages.
    """

    def __init__(
        self,
        solved: Recorder,
        parts: Mapping[str, PartInMemory] | None = None,
        progress: Progress = SILENT,
    ):
        self._progress = progress
        self._parts = parts or {}
        self._summary = RunSummary(solved)
        self._trajectory = trajectory_of(solved)
        self._run = solved.run
        self._cycles = solved.cycles
        self._system = solved.run.equations.system
        self._curves = ErrorCurves(self._trajectory)
        self.iterations = 0
        self._left_out = 0.0
        self._growths: list[tuple[float, float]] = []
        control = solved.run.control
        share_of_run = len(self._trajectory.times) / solved.counts["steps"]
        self._other_formula = share_of_run <= SMALL_SHARE and control.order > 1
        growth = (LONG_ERROR / control.tolerance) ** (1.0 / (control.order + 1))
        coarse = control.tolerance >= COARSE and not self._other_formula
        self._stride = 1 if coarse else int(np.clip(growth, *STRIDES))
        self._long = self._trajectory
        if self._cycles is not None:
            contraction = self._cycles.contraction
            least = max(contraction, float(np.finfo(float).tiny))
            share = float(np.log(FAST) / np.log(least)) if contraction < FAST else 1.0
            self._long = self._trajectory.with_next(share)

    def budget(self) -> ErrorBudget:
        """Estimate all error components."""
        began = process_time()
        changes: dict[str, np.ndarray] = {}
        notes: dict[str, str] = {}
        estimates: dict[str, Callable[[Trajectory], np.ndarray]] = {
            "step_size": self._change_by_steps,
            "film_mesh": self._change_by_films,
        }
        if any(binding.film.elastic for binding in self._system.films):
            for component in UNKNOWN:
                estimates[component] = partial(self._change_by_gaps, component)
        left_out: dict[str, float] = {}
        with self._progress.stage("error budget", 1 + len(estimates), "estimates") as stage:
            try:
                again = self._follow(self._long, stride=self._stride)
            except FAILURES as error:
                notes = dict.fromkeys(estimates, _one_line(error))
                estimates = {}
            common = self._left_out
            for number, (name, change) in enumerate(estimates.items(), start=1):
                stage.to(number, name.replace("_", " "))
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
        return ErrorBudget(
            joints,
            self._curves,
            changes,
            notes,
            left_out,
            self.iterations,
            seconds,
            self._flexibility_errors,
        )

    @property
    def _checked_shares(self) -> dict[str, float]:
        """Displacement error under pressures of the run over the verified error, by body.

        Both are relative errors of the displacements in the bores.
        """
        return {
            name: error / self._parts[name].reduced.flexibility_error
            for name, error in self._flexibility_errors.items()
        }

    @cached_property
    def _flexibility_errors(self) -> dict[str, float]:
        """Relative errors of displacements under pressures of the run, by body."""
        try:
            return checked_errors(self._system, self._trajectory, self._parts)
        except FAILURES:  # the verified errors of the bodies remain
            return {}

    def _follow(self, trajectory: Trajectory, run: Run | None = None, **how: Any) -> Trajectory:
        """Replay a trajectory with the equations of `run`, by default those of the estimated run.

        `how` has further arguments of `Replay`.
        """
        tolerance = min(SETTLED * self._run.control.tolerance, LITTLE)
        replay = Replay(run or self._run, trajectory, tolerance, forgiving=True, **how)
        end = float(trajectory.times[-1])
        began = trajectory.began
        try:
            with self._progress.stage("replay", 1e3 * (end - began), "ms") as stage:

                def look(step: MechanismStep) -> Mapping[str, float]:
                    stage.to(1e3 * (step.time - began))
                    return replay.columns(step)

                return recorded(replay, end, look=look)
        finally:
            self.iterations += replay.iterations
            self._left_out = max(self._left_out, replay.left_out / (end - began))

    def _change_by_steps(self, again: Trajectory) -> np.ndarray:
        """Curves of the step-size error; `again` is the replay of the run in long steps."""
        control = self._run.control
        if self._stride == 1:
            halved = self._follow(self._long.halved())
            return self._change(self._long, halved, 1.0 / (1.0 - 2.0**-control.order))
        if not self._other_formula:
            factor = -1.0 / (self._stride**control.order - 1.0)
            return self._change(self._long, again, factor)
        # Errors are proportional to the share of the lower order in the blend.
        blend = 0.0 if control.blend else OTHER_BLEND
        factor = (1.0 - control.blend) / (blend - control.blend)
        other = copy(self._run)
        other.control = attrs.evolve(control, blend=blend)
        return self._change(self._long, self._follow(self._long, other), factor)

    def _change(
        self, before: Trajectory, after: Trajectory, factor: float | np.ndarray
    ) -> np.ndarray:
        """Curves of the change between two trajectories, times a factor, after many cycles."""
        return self._curves.change(before, after, factor, self._remaining(before, after))

    @property
    def _decay(self) -> float:
        """Ratio by which differences between trajectories are multiplied in a cycle.

        It is the ratio of the sums over all components, of their growth in the second cycle and in
        the first, so that components with large differences count most. It is at most `SLOWEST`,
        and `SLOWEST` if no ratio is known.
        """
        first, second = np.sum(self._growths, axis=0) if self._growths else (0.0, 0.0)
        return float(min(second / first, SLOWEST)) if first else SLOWEST

    def _remaining(self, before: Trajectory, after: Trajectory) -> float:
        """Ratio by which the growth of a change between trajectories is multiplied in a cycle.

        The ratio is the growth in the second cycle over the growth in the first cycle. It has a
        sign, unlike the contraction of a cycle. For instance, a whirl at half the speed reverses
        the sign of the change from cycle to cycle. The sizes of both growths are stored for
        `_decay`.
        """
        cycles = self._cycles
        norm = self._run.norm
        size = self._trajectory.x.shape[1]
        if cycles is None or cycles.contraction < FAST:
            return 0.0
        times, *rows = np.intersect1d(before.times, after.times, return_indices=True)
        gaps, changed = (
            np.array([norm.gaps(norm.observe(x[:size])) for x in trajectory.x[common]])
            for trajectory, common in zip((before, after), rows, strict=True)
        )
        difference = changed - gaps
        first = times[-1] - cycles.period
        once = np.array([np.interp(first, times, column) for column in difference.T])
        growth = difference[-1] - once
        self._growths.append((float(np.linalg.norm(once)), float(np.linalg.norm(growth))))
        return float(growth @ once / (once @ once)) if once.any() else 0.0

    def _change_by_films(self, again: Trajectory) -> np.ndarray:
        """Curves of the film mesh error; `again` is the replay of the run in long steps."""
        finer = self._run.with_mechanism(with_finer_films(self._system.mechanism))
        start = transferred_state(again.start, self._run, finer)
        refined = self._follow(again, finer, start=start)
        grids = [binding.film.film.parameters.grid for binding in self._system.films]
        orders = np.array([FILM_ORDERS[grid.family != "bilinear"] for grid in grids])
        # The factors are errors of the film meshes over their changes by finer meshes.
        return self._change(again, refined, 1.0 / (1.0 - FINER**-orders))

    def _change_by_gaps(self, component: str, again: Trajectory) -> np.ndarray:
        """Curves of the error by missing flexibility of surfaces, see `missing_gaps`.

        `again` is the replay of the run in long steps.
        """
        periodic = self._cycles is not None
        equations = self._run.equations
        changes = missing_gaps(equations, again, component, periodic, self._checked_shares)
        sizes = np.column_stack([np.abs(change).max(axis=1) for change in changes])
        films = again.extremes[1]
        if not (sizes / films).max() > SMALL:
            return self._curves.interpolated(again.times, [*self._small_changes(again, sizes)])
        widened = self._follow(again, changes=changes).widened(changes)
        return self._change(again, widened, 1.0)

    def _small_changes(self, again: Trajectory, sizes: np.ndarray) -> np.ndarray:
        """Changes of all quantities by a small change of the gaps, shape (q, k, joints).

        Relative changes are taken as equal to that of the film thickness, changes of the journal's
        position as equal to that of the gap. `sizes` are the largest changes of the gaps at every
        step of the trajectory `again`, shape (k, joints) [m].
        """
        values = again.curves(self._curves.columns)
        changes = sizes / values[1] * np.abs(values)
        clearances = np.array([binding.film.clearance for binding in self._system.films])
        changes[1] = sizes
        for row, name in enumerate(self._curves.columns, start=len(QUANTITIES)):
            if name.startswith("eccentricity"):
                changes[row] = sizes / clearances if name.endswith("_ratio") else sizes
        return changes

    def _joint(
        self, i: int, binding: FilmBinding, changes: Mapping[str, np.ndarray]
    ) -> dict[str, Any]:
        """Relative errors of joint `i` by quantity and component, from the curves in `changes`."""
        errors: dict[str, Any] = {}
        largest: dict[str, Any] = {}
        known: dict[str, Any] = dict.fromkeys(COMPONENTS, NOT_ESTIMATED)
        if not binding.film.elastic:
            known |= dict.fromkeys(UNKNOWN, NOT_APPLICABLE)
            changes = {name: each for name, each in changes.items() if name not in UNKNOWN}
        for quantity in QUANTITIES:
            value = self._summary.extremes[binding.name][quantity][0]
            extreme = Extreme(quantity, i, value, self._curves.reported)
            start_errors = self._start(binding.name, quantity)
            shares, over = (known | {"start": start} for start in start_errors)
            for name, change in changes.items():
                shares[name] = extreme.share(change)
                over[name] = extreme.over(change)
            errors[quantity] = summed(shares)
            largest[quantity] = summed(over)
            errors[quantity]["between_nodes"] = extreme.near(self._curves.between_nodes)
            errors[quantity]["bias"] = extreme.bias([*changes.values()])
        figures = FigureErrors(
            self._summary,
            binding,
            (*EXTREME_COLUMNS, *self._curves.columns),
            self._curves.times,
            self._curves.steps,
            self._curves.reported[..., i],
            {name: change[..., i] for name, change in changes.items()},
            self._remaining_part,
        ).errors
        for quantity, column in zip(QUANTITIES, EXTREME_COLUMNS, strict=True):
            error = errors[quantity]["known"]
            if not isinstance(error, str):
                error *= self._summary.extremes[binding.name][quantity][0]
            figures |= {column: error, f"cycle_{column}": error}
        return errors | {"largest_over_cycle": largest, "figures": figures}

    def _start(self, joint: str, quantity: str) -> tuple[Any, Any]:
        """Relative errors of an extreme and of its curve, due to a cycle that is not yet periodic.

        The curve is that of the quantity over the cycle. Its error is the largest at any time.
        """
        cycles = self._cycles
        if cycles is None:
            return NOT_APPLICABLE, NOT_APPLICABLE
        part = self._remaining_part
        if part is None:
            return NOT_ESTIMATED, NOT_ESTIMATED
        now = self._summary.extremes[joint][quantity][0]
        then = self._summary.former_extremes[joint][quantity][0]
        extreme = float(part * abs(now - then) / now)
        return extreme, max(extreme, float(part * cycles.moved))

    @property
    def _remaining_part(self) -> float | None:
        """Distance from the periodic state, over that between the last two cycles [-]."""
        return remaining_part(self._cycles, self._run.control.tolerance, self._decay)


def remaining_part(
    cycles: PeriodicSolver | None, tolerance: float, decay: float = SLOWEST
) -> float | None:
    """Distance from the periodic state, over that between the starts of the last two cycles [-].

    The result is 0 for a run without cycles, and None if the distance is not known.

    Parameters
    ----------
    cycles, tolerance
        Search for a periodic solution, and tolerance of the steps.
    decay
        Ratio by which a difference between two trajectories is multiplied in a cycle. It replaces
        the contraction of the cycles if the changes from cycle to cycle are only noise.
    """
    if cycles is None or not cycles.moved:
        return 0.0
    contraction = cycles.contraction
    if not contraction < 1.0:
        noise = max(cycles.periodicity, CYCLE_NOISE * tolerance)
        if not max(cycles.moved, cycles.left) <= noise:
            return None
        contraction = decay
    return cycles.left / (1.0 - contraction) / cycles.moved


def _one_line(error: Exception) -> str:
    """Message of an exception, without line breaks."""
    return " ".join(str(error).split())


def error_budget(history: History, *, progress: Progress | bool = True) -> ErrorBudget:
    """Estimate the errors of a run whose history `simulate` returned.

    Parameters
    ----------
    history
        History of the run.
    progress
        Whether progress is shown in a terminal or notebook; or the progress in which the replays
        open their stages.

    Raises
    ------
    InputError
        The history was read from a folder.
    """
    return Estimator(solved_run(history), progress=chosen_progress(progress)).budget()
