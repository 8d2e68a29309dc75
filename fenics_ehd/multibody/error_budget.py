"""What a run is worth: errors of its peak pressures and thinnest films, by where they come from.

The last cycle of a periodic run, or all of another one, is solved again beside itself
(`fenics_ehd.multibody.beside`), with one thing different at a time:

step size
    in steps as long as two or more of the run's: what changes is a multiple of the error, by the
    order of the formula (Richardson); of a run of many cycles by another formula;
film mesh
    in the same long steps, on films of half as many cells again either way (`other_films`);
basis
    in the same steps, the gaps changed by what the basis lacks (`basis_error`): missing
    flexibility, or with M4 the inertia of the residual patterns;
part mesh
    the same with what another mesh of the part changes in its flexibility;
start
    from how far the last cycles began from one another, how much of that was left at their ends,
    and what their extremes differed.

Errors so travel along the motion as they do in the run. A cycle is followed beyond its end until
what is different has found its own cycle.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from time import process_time
from typing import Any, TypeVar

import numpy as np

from fenics_ehd.base.errors import EhdError
from fenics_ehd.multibody.basis_error import BasisErrorEstimate
from fenics_ehd.multibody.bdf import IntegratorState, StepControl
from fenics_ehd.multibody.beside import Beside
from fenics_ehd.multibody.course import Course, course_of
from fenics_ehd.multibody.disturbance import Disturbance
from fenics_ehd.multibody.error_curves import SETTLED, Change, ErrorCurves
from fenics_ehd.multibody.error_shares import (
    COMPONENTS,
    NOT_APPLICABLE,
    NOT_ESTIMATED,
    QUANTITIES,
    Extreme,
    summed,
)
from fenics_ehd.multibody.lacking import lacking_gaps, lacking_in_basis, lacking_in_mesh
from fenics_ehd.multibody.other_films import FINER, on_finer_films, with_finer_films
from fenics_ehd.multibody.periodic import Cycles
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.solver_state import SolverState
from fenics_ehd.multibody.step_solver import CoupledSteps
from fenics_ehd.multibody.system import FilmPlace, System
from fenics_ehd.multibody.tracking import Tracker

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
    """

    def __init__(
        self,
        run: Run,
        cycles: Cycles | None,
        began: IntegratorState[SolverState],
        course: Course,
        tracker: Tracker,
    ):
        self._run, self._cycles, self._course = run, cycles, course
        self._system = run.equations.system
        self._extremes, self._former = tracker.extremes, tracker.former
        control, share_of_run = run.control, len(course.times) / tracker.counts["steps"]
        self._other_formula = share_of_run <= SMALL_SHARE and control.order > 1
        growth = (LONG_ERROR / control.tolerance) ** (1.0 / (control.order + 1))
        coarse = control.tolerance >= COARSE and not self._other_formula
        self._stride = 1 if coarse else int(np.clip(growth, *STRIDES))
        self._began = IntegratorState(**began.points())
        self._grids = [place.film.film.parameters.grid for place in self._system.films]
        self.iterations = 0
        self._long, self._curves = course, ErrorCurves(course, self._began.time)
        if cycles is not None:
            self._curves = ErrorCurves(course, self._began.time, cycles.period)
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
        again = self._try("step_size", notes, lambda: self._follow(self._long, self._stride))
        if again is not None:
            step = self._try("step_size", notes, lambda: self._change_by_steps(again))
            if step is not None:
                changes["step_size"] = step
            film = self._try("film_mesh", notes, lambda: self._change_by_films(again))
            if film is not None:
                changes["film_mesh"] = film
            if any(place.bore for place in self._system.films):
                system = self._system
                for name, lacking in (
                    ("basis", partial(lacking_in_basis, system)),
                    ("part_mesh", partial(lacking_in_mesh, system)),
                ):
                    found = self._try(name, notes, partial(self._change_by_gaps, again, lacking))
                    if found is not None:
                        changes[name] = found
        else:
            notes |= dict.fromkeys(("film_mesh", *OF_BORES), notes["step_size"])
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

    def _follow(
        self,
        course: Course,
        stride: int,
        disturbance: Disturbance | None = None,
        corners: Collection[float] | None = None,
        control: StepControl | None = None,
    ) -> Course:
        beside = Beside(self._run.solve, control or self._run.control, self._grids)
        found = beside.follow(self._began, course, stride, disturbance, corners)
        if corners is None:
            self._corners = beside.corners
        self.iterations += beside.iterations
        return found

    def _change_by_steps(self, again: Course) -> Change:
        control = self._run.control
        if self._stride == 1:
            start = self._began.x[0][: self._long.x.shape[1]]
            found = self._follow(self._long.halved(self._began.time, start), 1)
            return self._change(self._long, found, 1.0 / (1.0 - 2.0**-control.order))
        if not self._other_formula:
            factor = -1.0 / (self._stride**control.order - 1.0)
            return self._change(self._long, again, factor)
        # Errors are as what a blend leaves of the lower order.
        blend = 0.0 if control.blend else OTHER_BLEND
        factor = (1.0 - control.blend) / (blend - control.blend)
        found = self._follow(self._long, 1, control=replace(control, blend=blend))
        return self._change(self._long, found, factor)

    def _change(self, before: Course, after: Course, factor: float | np.ndarray) -> Change:
        return self._curves.change(before, after, factor, self._left(before, after))

    def _left(self, before: Course, after: Course) -> float:
        """Share of what differs after one cycle that the next leaves of it, - of other sign.

        How far a cycle forgets says nothing of that: a whirl at half the speed comes back with the
        other sign, and what a cycle changes is most of the error then.
        """
        cycles, norm, size = self._cycles, self._run.norm, self._course.x.shape[1]
        if cycles is None or cycles.contraction < SETTLED:
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

    def _film_factors(self) -> np.ndarray:
        """Errors of the films' meshes over what finer ones change."""
        orders = [FILM_ORDERS[grid.family != "bilinear"] for grid in self._grids]
        return 1.0 / (1.0 - FINER ** -np.array(orders))

    def _change_by_films(self, again: Course) -> Change:
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
        change = self._change(again, found, self._film_factors())
        return change.and_also(self._curves.sampling)

    def _change_by_gaps(
        self, again: Course, lacking: Callable[[], Mapping[str, BasisErrorEstimate]]
    ) -> Change:
        periodic = self._cycles is not None
        began = self._began.time
        missing = lacking_gaps(self._run.equations, again, began, lacking(), periodic)
        none = np.zeros(len(again.times))
        sizes = np.column_stack(
            [none if change is None else np.abs(change).max(axis=1) for change in missing.observed]
        )
        if not (sizes / again.films).max() > SMALL:
            return self._curves.given(again.times, sizes / again.films * again.peaks, sizes)
        found = self._follow(again, 1, missing, self._corners)
        return self._change(again, found, 1.0)

    def _joint(self, i: int, place: FilmPlace, changes: Mapping[str, Change]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        largest: dict[str, Any] = {}
        known: dict[str, Any] = dict.fromkeys(COMPONENTS, NOT_ESTIMATED)
        if not place.bore:
            known |= dict.fromkeys(OF_BORES, NOT_APPLICABLE)
            changes = {name: own for name, own in changes.items() if name not in OF_BORES}
        for quantity in QUANTITIES:
            extreme = Extreme(quantity, i, getattr(self._extremes[place.name], quantity))
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
        if joint not in self._former:  # the first cycle on the orbit of another run
            return left, left
        now, then = (getattr(found[joint], quantity) for found in (self._extremes, self._former))
        part = left / cycles.moved if cycles.moved else 0.0
        extreme = float(part * abs(now - then) / now)
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
