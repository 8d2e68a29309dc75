"""What a run is worth: errors of its peak pressures and thinnest films, by where they come from.

The last cycle of a periodic run, or all of another one, is solved again beside itself
(`fenics_ehd.multibody.beside`), with one thing different at a time:

step size
    in steps as long as two or more of the run's: what changes is a multiple of the error, by the
    order of the formula (Richardson); of a run of many cycles in steps half as long;
film mesh
    in the same long steps, on films of half as many cells again either way (`other_films`);
basis
    in the same steps, the gaps changed by what the basis lacks (`basis_error`): missing
    flexibility, or with M4 the inertia of the residual patterns;
part mesh
    the same with what a coarser mesh of the part changes in its flexibility;
start
    from how far the last cycles began from one another, how much of that was left at their ends,
    and what their extremes differed.

Errors so travel along the motion as they do in the run. A cycle is followed beyond its end until
what is different has found its own cycle.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from time import process_time
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from fenics_ehd.base.errors import EhdError, SettingsError
from fenics_ehd.multibody.basis_error import BasisErrorEstimate, bore_body, bore_loads, estimate_at
from fenics_ehd.multibody.bdf import IntegratorState
from fenics_ehd.multibody.beside import Beside
from fenics_ehd.multibody.course import Course, course_of
from fenics_ehd.multibody.disturbance import Disturbance
from fenics_ehd.multibody.error_shares import NOT_APPLICABLE, NOT_ESTIMATED, Change, relative, total
from fenics_ehd.multibody.other_films import FINER, on_finer_films, with_finer_films
from fenics_ehd.multibody.part_mesh import flexibility_error
from fenics_ehd.multibody.periodic import Cycles
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.solver_state import SolverState
from fenics_ehd.multibody.step_solver import CoupledSteps
from fenics_ehd.multibody.system import FilmPlace, System
from fenics_ehd.multibody.tracking import Tracker
from fenics_ehd.reduction import ReducedBody

COMPONENTS = ("basis", "film_mesh", "part_mesh", "step_size", "start")

#: Quantities by their names in a summary.
QUANTITIES = ("max_pressure", "min_film_thickness")

#: Local error that long steps may have, and least and most steps of the run in one of them.
LONG_ERROR, STRIDES = 0.03, (2, 4)

#: Share of the course below which the error of the steps is found in half as long ones: those twice
#: as long may be too long for a mode that they must resolve.
HALVED = 0.2

#: Orders that errors of the film's mesh are taken to have, of 4-node cells and of others.
FILM_ORDERS = (2.0, 4.0)

#: What differs is followed beyond a cycle's end until this share is left of its beginning, at
#: most for a second cycle.
SETTLED = 0.3

#: Gap errors below this, relative to the film, stand for what they do to it and to the pressure.
SMALL = 1e-3

Found = TypeVar("Found")


@dataclass(frozen=True, eq=False)
class ErrorBudget:
    """Of a run.

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


class Estimator:
    """Estimates the errors of a run that has come to its end.

    Parameters
    ----------
    run, cycles
        The run, and its search for a periodic solution.
    began
        State at the beginning of the course.
    course
        Of the last cycle, or the run.
    tracker
        Of the run.
    coarser
        Flexible bodies by name, rigid, of coarser meshes of their parts (`part_mesh`).
    """

    def __init__(
        self,
        run: Run,
        cycles: Cycles | None,
        began: IntegratorState[SolverState],
        course: Course,
        tracker: Tracker,
        coarser: Mapping[str, ReducedBody] = MappingProxyType({}),
    ):
        self._run, self._cycles, self._course = run, cycles, course
        self._system = run.equations.system
        self._coarser = coarser
        self._extremes, self._former = tracker.extremes, tracker.former
        share_of_run = len(course.times) / tracker.counts["steps"]
        self._halve = share_of_run <= HALVED
        control = run.control
        growth = (LONG_ERROR / control.tolerance) ** (1.0 / (control.order + 1))
        self._stride = int(np.clip(growth, *STRIDES))
        self._began = IntegratorState(**began.points())
        self._grids = [place.film.film.parameters.grid for place in self._system.films]
        self.iterations = 0
        self._long = course
        if cycles is not None:
            size = course.x.shape[1]
            slow = not cycles.contraction < SETTLED
            least = max(cycles.contraction, float(np.finfo(float).tiny))
            share = 1.0 if slow else float(np.log(SETTLED) / np.log(least))
            angles = cycles.angles
            self._long = course.repeated(cycles.period, self._began.x[0][:size], angles, share)

    def budget(self) -> ErrorBudget:
        """All components."""
        began = process_time()
        changes: dict[str, Change] = {}
        notes: dict[str, str] = {}
        again = self._try("step_size", notes, self._longer_steps)
        if again is not None:
            step = self._try("step_size", notes, lambda: self._change_by_steps(again))
            if step is not None:
                changes["step_size"] = step
            film = self._try("film_mesh", notes, lambda: self._finer_films(again))
            if film is not None:
                changes["film_mesh"] = self._change(again, film, self._film_factors())
            if any(place.bore for place in self._system.films):
                for name, lacking in (("basis", self._basis), ("part_mesh", self._part_mesh)):
                    if name == "basis" or self._coarser:
                        found = self._try(
                            name, notes, partial(self._change_by_gaps, again, lacking)
                        )
                        if found is not None:
                            changes[name] = found
        else:
            notes |= dict.fromkeys(("film_mesh", "basis"), notes["step_size"])
        joints = {
            place.name: self._joint(i, place, changes) for i, place in enumerate(self._system.films)
        }
        return ErrorBudget(joints, changes, notes, self.iterations, process_time() - began)

    @staticmethod
    def _try(component: str, notes: dict[str, str], solve: Callable[[], Found]) -> Found | None:
        try:
            return solve()
        # Whatever goes wrong beside a run, the run is complete.
        except (EhdError, ArithmeticError, ValueError) as error:
            notes[component] = " ".join(str(error).split())
            return None

    def _longer_steps(self) -> Course:
        beside = Beside(self._run.solve, self._run.control, self._grids)
        found = beside.follow(self._began, self._long, self._stride)
        self._corners = beside.corners
        self.iterations += beside.iterations
        return found

    def _change_by_steps(self, again: Course) -> Change:
        order = self._run.control.order
        if not self._halve:
            run = self._long.at(np.searchsorted(self._long.times, again.times))
            return self._change(run, again, -1.0 / (self._stride**order - 1.0))
        x = self._began.x[0][: self._course.x.shape[1]]
        beside = Beside(self._run.solve, self._run.control, self._grids)
        found = beside.follow(self._began, self._long.halved(self._began.time, x), 1)
        self.iterations += beside.iterations
        same = found.at(np.searchsorted(found.times, self._long.times))
        return self._change(self._long, same, 1.0 / (1.0 - 0.5**order))

    def _film_factors(self) -> np.ndarray:
        """Errors of the films' meshes over what finer ones change."""
        orders = [FILM_ORDERS[grid.family != "bilinear"] for grid in self._grids]
        return 1.0 / (1.0 - FINER ** -np.array(orders))

    def _finer_films(self, again: Course) -> Course:
        system = System(with_finer_films(self._system.mechanism))
        for place, own in zip(system.films, self._system.films, strict=True):
            temperature = own.film.film.equation.lubricant.temperature
            if place.joint.heat is not None and temperature is not None:
                place.film.film.warm(temperature)
        finer = CoupledSteps(system)
        beside = Beside(finer, self._run.control, self._grids)
        found = beside.follow(
            on_finer_films(self._began, self._run.solve, finer), again, 1, None, self._corners
        )
        self.iterations += beside.iterations
        return found

    def _basis(self) -> dict[str, BasisErrorEstimate]:
        """What bases lack, by joint."""
        estimates = {
            place.name: estimate_at(bore_body(self._system, place), place.bore)
            for place in self._system.films
            if place.bore
        }
        for name, estimate in estimates.items():
            if np.isnan(estimate.largest):
                raise SettingsError(f"{name}: reduction.estimate_error is off")
        return estimates

    def _part_mesh(self) -> dict[str, BasisErrorEstimate]:
        """What meshes of parts lack, by joint."""
        found = {}
        for place in self._system.films:
            if place.bore:
                body = bore_body(self._system, place)
                if place.bore_body not in self._coarser:
                    raise SettingsError(f"{place.bore_body}: no coarser mesh of the part is known")
                error = flexibility_error(body.reduced, self._coarser[place.bore_body])
                nodes = body.reduced.rows_of(place.bore).nodes
                found[place.name] = BasisErrorEstimate(error[nodes], body.damping_time)
        return found

    def _change_by_gaps(
        self, again: Course, lacking: Callable[[], Mapping[str, BasisErrorEstimate]]
    ) -> Change:
        missing = self._missing(again, lacking())
        none = np.zeros(len(again.times))
        sizes = np.column_stack(
            [none if change is None else np.abs(change).max(axis=1) for change in missing.observed]
        )
        if not (sizes / again.films).max() > SMALL:
            more = [sizes / again.films * again.peaks, sizes]
            return self._over_course(again.times, more)
        beside = Beside(self._run.solve, self._run.control, self._grids)
        found = beside.follow(self._began, again, 1, missing, self._corners)
        self.iterations += beside.iterations
        return self._change(again, found, 1.0)

    def _missing(self, again: Course, estimates: Mapping[str, BasisErrorEstimate]) -> Disturbance:
        """What gaps lack along a course."""
        system, equations = self._system, self._run.equations
        rows = range(len(again.times))
        loads = [bore_loads(system, [p[k] for p in again.pressures]) for k in rows]
        steps = np.diff(again.times, prepend=self._began.time)
        fields: dict[str, list[np.ndarray]] = {}
        # Twice, as the memory of the structure is that of the cycle before.
        for _ in range(2 if self._cycles else 1):
            fields = {name: [] for name in estimates}
            for k in rows:
                for place in system.films:
                    if place.bore:
                        own = equations.responses.of_body(place.bore_body)
                        fields[place.name].append(
                            estimates[place.name].field(
                                steps[k], loads[k][place.bore_body], again.accelerations[k][own]
                            )
                        )
        observed = [
            _observed(system, place, np.array(fields[place.name])) if place.bore else None
            for place in system.films
        ]
        points = [len(place.film.thickness) for place in system.films]
        return Disturbance(again.times, observed, points)

    def _change(self, before: Course, after: Course, factor: float | np.ndarray) -> Change:
        """From a course to a changed one, times a factor, over a cycle."""
        more = [
            factor * (getattr(after, name) - getattr(before, name)) for name in ("peaks", "films")
        ]
        count = int(np.searchsorted(before.times, self._course.times[-1], "right"))
        if self._cycles is not None:
            more = [self._settled(before.times, own, count) for own in more]
        return self._over_course(before.times[:count], more)

    def _over_course(self, times: np.ndarray, more: Sequence[np.ndarray]) -> Change:
        """Changes at all steps of the run, between those they were found at."""
        course = self._course
        found = [
            np.column_stack(
                [
                    np.interp(course.times, times, values[: len(times), joint])
                    for joint in range(values.shape[1])
                ]
            )
            for values in more
        ]
        return Change(course.times, course.peaks, course.films, *found)

    def _settled(self, times: np.ndarray, more: np.ndarray, count: int) -> np.ndarray:
        """Changes over a cycle, as they are the second time where it was followed twice."""
        assert self._cycles is not None
        again = times[count:] - self._cycles.period
        found = more[:count].copy()
        if not len(again):
            return found
        inside = times[:count] <= again[-1]
        contraction = min(self._cycles.contraction, 0.9)
        beyond = contraction / (1.0 - contraction) if contraction > SETTLED else 0.0
        for joint in range(more.shape[1]):
            later = np.interp(times[:count][inside], again, more[count:, joint])
            found[inside, joint] = later + beyond * (later - found[inside, joint])
        return found

    def _joint(self, i: int, place: FilmPlace, changes: Mapping[str, Change]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        largest: dict[str, Any] = {}
        extremes = self._extremes[place.name]
        for quantity in QUANTITIES:
            values: dict[str, float | str] = dict.fromkeys(COMPONENTS, NOT_ESTIMATED)
            over, together = dict(values), 0.0
            if not place.bore:
                values |= dict.fromkeys(("basis", "part_mesh"), NOT_APPLICABLE)
                over |= dict.fromkeys(("basis", "part_mesh"), NOT_APPLICABLE)
            for component, change in changes.items():
                if component in ("basis", "part_mesh") and not place.bore:
                    continue
                moved, over[component] = relative(change, i, quantity, extremes)
                values[component] = abs(moved)
                together += moved
            values["start"], over["start"] = self._start(place.name, quantity)
            whole, largest_whole = total(values, together), total(over)
            if not isinstance(whole, str) and not isinstance(largest_whole, str):
                largest_whole = max(largest_whole, whole)  # the extreme is of the cycle
            found[quantity] = values | {"total": whole}
            largest[quantity] = over | {"total": largest_whole}
        return found | {"largest_over_cycle": largest}

    def _start(self, joint: str, quantity: str) -> tuple[Any, Any]:
        """Distance from the periodic state."""
        cycles = self._cycles
        if cycles is None:
            return NOT_APPLICABLE, NOT_APPLICABLE
        if not cycles.contraction < 1.0:
            return NOT_ESTIMATED, NOT_ESTIMATED
        left = cycles.left / (1.0 - cycles.contraction)
        now, then = (getattr(found[joint], quantity) for found in (self._extremes, self._former))
        share = left / cycles.moved if cycles.moved else 0.0
        extreme = float(share * abs(now - then) / now)
        return extreme, max(extreme, float(left))


def judged(run: Run, end: float, cycles: Cycles | None = None) -> tuple[Tracker, ErrorBudget]:
    """Integrate a run from its start to an end [s], or until its films repeat, and judge it.

    Raises
    ------
    SolverError
        See `Run.until` and `Cycles`.
    """
    recorder, start = Recorder(run), run.state
    for step in run.until(end) if cycles is None else cycles:
        recorder.add(step, cycles)
    course = course_of(run.equations.system, *recorder.rows())
    began = start if cycles is None else cycles.began
    return recorder.tracker, Estimator(run, cycles, began, course, recorder.tracker).budget()


def _observed(system: System, place: FilmPlace, outward: np.ndarray) -> np.ndarray:
    """Change of the gap where it is observed, of outward displacements of the bore's nodes."""
    bore = place.film.bore
    assert bore is not None
    part = bore_body(system, place).reduced.at_bore(place.bore)
    radial = part.bore_nodes - np.append(part.bore.centre[:2], 0.0)
    radial[:, 2] = 0.0
    radial /= np.linalg.norm(radial, axis=1)[:, None]
    fields = outward[:, :, None] * radial
    return np.asarray((bore.observed_normal @ fields.reshape(len(outward), -1).T).T)
