"""Records of a run: a row for every accepted step, and state that is kept for a restart.

A row has every column of the history, nodal fields of the films, and the state of the mechanism.
Columns are numbers by path with unit, ``joints/big_end/force_x_N``; fields and state are arrays
by path. In a search for a periodic solution only rows of the last two cycles are kept.

State that is not in the rows (the integrator's points, the estimator's load history, accumulated
wear) is kept for a restart, see `Recorder.carried`. `fenics_ehd.multibody.summary` computes results
from the rows, and `fenics_ehd.multibody.verdict` accepts or rejects them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from time import perf_counter, process_time
from typing import Any, ClassVar

import numpy as np

from fenics_ehd.base.columns import Quantity, split_unit, with_unit
from fenics_ehd.base.errors import InputError
from fenics_ehd.base.layout import Group, Sizes, Stateful, Value
from fenics_ehd.base.progress import Progress
from fenics_ehd.multibody.bdf import IntegratorState
from fenics_ehd.multibody.cycle import TURN_ROUNDING, Cycle, first_of_last
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.history import (
    FIELD_UNITS,
    History,
    column_name,
    fixed,
    is_column,
)
from fenics_ehd.multibody.mechanism import System
from fenics_ehd.multibody.newton import INTEGRATOR_STATE, CoupledSteps, MechanismStep, SolverState
from fenics_ehd.multibody.periodic import PeriodicSolver, recurrence_of, reference_angle
from fenics_ehd.multibody.quantities import joint_row, rubbing
from fenics_ehd.multibody.reported_rows import (
    AMPLITUDE_RATES,
    AMPLITUDES,
    Row,
    with_reported,
)
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.trust import (
    SIGNS,
    BasisErrorEstimate,
    energy_row,
    step_powers,
    surface_loads,
)

#: Columns of a history by path with unit, each of shape (steps,).
Columns = Mapping[str, np.ndarray]

#: Columns of the frame coordinates of a body.
FRAME = ("x_m", "y_m", "angle_rad")

#: Columns of the coordinates of a joint, the displacement and tilt of its journal in the bore.
JOURNAL = ("eccentricity_x_m", "eccentricity_y_m", "tilt_x_rad", "tilt_y_rad")

#: Unit of the amplitude of an elastic mode, which depends on the scaling of the mode.
MODAL = "modal"

#: Columns from which the last complete cycle is found.
CYCLE_COLUMNS = ("time_s", "run/crank_angle_deg", "run/cycle", "run/cycle_time_s")


def film_meshes(system: System) -> dict[str, np.ndarray]:
    """Nodes, cells, radius and clearance of every film, by path without units."""
    meshes: dict[str, np.ndarray] = {}
    for binding in system.films:
        parameters = binding.film.film.parameters
        path = f"joints/{binding.name}/film"
        angles, heights = parameters.grid.node_positions.T
        meshes |= {
            f"{path}/radius": np.array(parameters.grid.radius),
            f"{path}/clearance": np.array(parameters.clearance),
            f"{path}/angle": angles,
            f"{path}/height": heights,
            f"{path}/cells": parameters.grid.cell_nodes.astype(np.int32),
        }
    return meshes


def history_of(system: System, rows: Sequence[Row]) -> History:
    """Make the history of a mechanism from the rows of its steps."""
    values: dict[str, Quantity] = {}
    arrays = {name: np.array([row[name] for row in rows]) for name in (rows[0] if rows else ())}
    for name, array in {**arrays, **film_meshes(system)}.items():
        path, unit = split_unit(name)
        numbers = array.astype(float) if is_column(name) else array
        values[path] = Quantity(numbers, FIELD_UNITS.get(path.rpartition("/")[2], unit))
    coordinates = coordinate_units(system)
    return History(values, tuple(coordinates), tuple(coordinates.values()))


def solution(run: Run, step: MechanismStep) -> dict[str, np.ndarray]:
    """State and nodal fields of the last accepted step of a run, by their paths in a history."""
    system = run.equations.system
    arrays = {"state/coordinates": step.x[: system.n], "state/rates": step.rate[: system.n]}
    assert run.state.solver is not None
    values = run.state.solver.values[0]
    arrays["state/multipliers"] = values[len(values) - 2 * system.m :]
    arrays["state/corner"] = np.array(len(run.state.times) == 1)
    if run.equations.responses.size:
        indices = run.equations.responses.indices
        arrays[AMPLITUDES] = step.x[indices]
        arrays[AMPLITUDE_RATES] = step.rate[indices]
    for joint in step.solution.joints:
        path = f"joints/{joint.binding.name}/film"
        arrays[f"{path}/pressure"] = joint.pressure
        arrays[f"{path}/gap"] = joint.gap[-len(joint.pressure) :]
        if joint.state.fluid_fraction is not None:
            arrays[f"{path}/fluid_fraction"] = joint.state.fluid_fraction
    # Copies, because views would keep the larger arrays in memory.
    return {path: np.array(array) for path, array in arrays.items()}


def coordinate_units(system: System) -> dict[str, str]:
    """Unit of every coordinate of a mechanism by its path, in the order of the coordinates."""
    units: dict[str, str] = {}
    for name, dofs in system.bodies.items():
        angle = system.angles.get(name)
        frame = () if angle is None else FRAME[2 - (angle - dofs.start) :]
        units |= dict(split_unit(f"bodies/{name}/{column}") for column in frame)
        modes = dofs.stop - dofs.start - len(frame)
        units |= {f"bodies/{name}/mode_{i + 1}": MODAL for i in range(modes)}
    for binding in system.films:
        columns = JOURNAL[: binding.film.journal_coordinates]
        units |= dict(split_unit(f"joints/{binding.name}/{column}") for column in columns)
    return units


def columns_of(rows: Sequence[Row], names: Sequence[str] = ()) -> dict[str, np.ndarray]:
    """Columns of recorded rows by path with unit, each of shape (steps,).

    They are all columns, or those whose paths are in `names`. Without rows the result is empty.
    """
    present = rows[0] if rows else {}
    chosen = [name for name in names or filter(is_column, present) if name in present]
    return {name: np.array([row[name] for row in rows]) for name in chosen}


def _require_alike(row: Row, stored: Row) -> None:
    """Refuse a stored history whose rows have other columns or shapes than those of this run.

    Raises
    ------
    InputError
        If a column differs; the message names it.
    """
    for name in dict.fromkeys([*row, *stored]):
        if name not in row or name not in stored or np.shape(row[name]) != np.shape(stored[name]):
            raise InputError(
                "the stored history does not belong to this scene, because "
                f"{name} is missing or has another shape: run the scene again"
            )


#: Layout of a stored number of steps or iterations.
COUNT = Value("integer", least=0)

#: Counts of a run that its summary and sweeps have had from the start.
STEP_COUNTS = ("steps", "newton_iterations", "rejected_steps")

#: All counts of a run: no machine changes them, so that tests can detect lost speed.
COUNTS = (*STEP_COUNTS, *CoupledSteps.WORK)


class Recorder(Stateful):
    """Recorder of a run: it takes the steps, and stores a row for each.

    Parameters
    ----------
    run
        Run at its start.
    end
        Time at which the run ends if it is no search for a periodic solution [s].
    cycles
        Search for a periodic solution; None for other runs.

    Attributes
    ----------
    system
        Equations of the mechanism.
    recurrence
        Angle and time after which the loads recur.
    wall_time, processor_time
        Wall time and processor time of all steps so far [s].
    rows
        Rows of the steps that are kept.
    counts, rejected_because
        Counts of the run by the names `COUNTS`, and number of rejected attempts by reason. Both
        include steps whose rows are not kept.
    estimates
        Estimates of the basis error by `BoundSurface.key`.
    rubbing, slid
        Contact pressure times sliding speed at the Gauss points of rough surfaces by joint: at the
        last step [W/m2], and integrated over the current cycle of a search, or the run [J/m2].
    """

    carried: ClassVar = {
        "integrator": INTEGRATOR_STATE,
        "cycles": Group(PeriodicSolver.carried, required=False),
        "wall_time": Value("real"),
        "processor_time": Value("real"),
        "counts": Group(dict.fromkeys(COUNTS, COUNT)),
        "rejected_because": Group(each=COUNT),
        "estimates": Group(each=Group(BasisErrorEstimate.carried)),
        "rubbing": Group(each=Value("float", ("points",))),
        "slid": Group(each=Value("float", ("points",))),
    }

    def __init__(self, run: Run, end: float, cycles: PeriodicSolver | None = None):
        self.run = run
        self.end = end
        self.cycles = cycles
        self.system = run.equations.system
        self._start = run.state
        self.wall_time = self.processor_time = 0.0
        self.rows: list[Row] = []
        self._resumed = False
        self._reference = reference_angle(self.system)
        self.recurrence = recurrence_of(self.system)
        self._coordinates = coordinate_units(self.system)
        films = self.system.films
        self.estimates: dict[str, BasisErrorEstimate] = {}
        for bound in (bound for binding in films for bound in binding.surfaces):
            missing = bound.surface.missing_flexibility("basis")
            if missing is not None:
                self.estimates[bound.key] = BasisErrorEstimate.of(missing)
        self.slid = {
            binding.name: np.zeros(len(contact.area))
            for binding, contact in zip(films, run.equations.contacts.joints, strict=True)
            if contact is not None
        }
        self.rubbing = dict(self.slid)
        self.counts = dict.fromkeys(COUNTS, 0)
        self.rejected_because: dict[str, int] = {}

    @property
    def integrator(self) -> IntegratorState[SolverState]:
        """State of the time integration after the last step."""
        return self.run.state

    @integrator.setter
    def integrator(self, state: IntegratorState[SolverState]) -> None:
        self.run.state = state

    @property
    def began(self) -> IntegratorState[SolverState]:
        """State of the integration at the start of the current cycle of a search, or of the run."""
        return self._start if self.cycles is None else self.cycles.began

    @property
    def time(self) -> float:
        """Time of the last recorded step [s]; before the first step, time of the start."""
        return self.rows[-1]["time_s"] if self.rows else self._start.time

    @property
    def first(self) -> int:
        """Index of the row at the first step of the current cycle of a search; 0 for other runs."""
        numbers = columns_of(self.rows, ["run/cycle"]).values()
        return first_of_last(*numbers) if numbers else 0

    @property
    def last_cycle(self) -> Cycle | None:
        """Last complete cycle of the run; None before the first step."""
        columns = columns_of(self.rows, CYCLE_COLUMNS)
        return Cycle.of_columns(columns, self.recurrence) if columns else None

    def known_sizes(self) -> Sizes:
        """Sizes of arrays in a stored state, by name of the size.

        Every size is the number of unknowns of a step.
        """
        owners = ("/integrator", "/cycles/began")
        return dict.fromkeys(
            (f"{owner} unknowns" for owner in owners), len(self.run.equations.lower)
        )

    def take(self, history: History) -> None:
        """Continue a run after the steps of its stored history.

        Raises
        ------
        ValueError
            If a column that the next step needs is missing, or has another shape.
        """
        columns = {
            with_unit(path, array.units) if is_column(path) else path: np.asarray(array)
            for path, array in history.values.items()
            if not fixed(path)
        }
        needed = energy_row((), 0.0, dict.fromkeys((*SIGNS, "kinetic", "strain"), 0.0))
        needed |= {"time_s": 0.0, "run/crank_angle_deg": 0.0}
        if self.cycles is not None:
            needed |= {"run/cycle": 0.0, "run/cycle_time_s": 0.0}
        for name, value in needed.items():
            if name not in columns or columns[name].shape[1:] != np.shape(value):
                raise ValueError(f"/{name} is missing, or its shape is not that of this scene")
        self.rows = [
            {name: array[i] for name, array in columns.items()} for i in range(len(history))
        ]
        self._resumed = bool(self.rows)

    def steps(self) -> Iterator[tuple[MechanismStep, dict[str, float]]]:
        """Yield every accepted step after it is recorded, with its row of ``history.csv``."""
        began = perf_counter() - self.wall_time
        processor_began = process_time() - self.processor_time
        for step in self.run.until(self.end) if self.cycles is None else self.cycles:
            row = self.add(step)
            self.wall_time = perf_counter() - began
            self.processor_time = process_time() - processor_began
            yield step, row

    @contextmanager
    def shown(self, progress: Progress, name: str) -> Iterator[Callable[[MechanismStep], None]]:
        """Open a stage of `progress` for the run; yield the function that shows a step in it."""
        start = 0.0 if self.cycles is None else self.cycles.start
        done = 1e3 * max(self.time - start, 0.0)
        with progress.stage(name, 1e3 * self.end, "ms", done=done) as stage:

            def note_of(step: MechanismStep) -> str:
                peak = max((film.pressure.max() for film in step.solution.films), default=0.0)
                cycle = "" if self.cycles is None else f"cycle {self.cycles.number}, "
                return f"{cycle}step {self.counts['steps']}, p {1e-6 * peak:.1f} MPa"

            def show(step: MechanismStep) -> None:
                start = 0.0 if self.cycles is None else self.cycles.start
                stage.to(1e3 * min(step.time - start, self.end), partial(note_of, step))

            yield show

    def add(self, step: MechanismStep) -> dict[str, float]:
        """Record an accepted step; in a search it belongs to the current cycle.

        Returns
        -------
        dict
            Row of ``history.csv`` by the names of its columns.
        """
        cycles = self.cycles
        begins = bool(cycles and self.rows and cycles.number != self.rows[-1]["run/cycle"])
        if begins:
            # Works and wear begin at zero in every cycle; counts and estimates continue.
            self.rows = self.rows[self.first :]
            self.slid = {name: np.zeros_like(wear) for name, wear in self.slid.items()}
        size = step.time - self.time
        rejected = sum(step.rejected.values())
        self.counts["steps"] += 1
        self.counts["newton_iterations"] += step.newton_iterations
        self.counts["rejected_steps"] += rejected
        for name, count in step.work.items():
            self.counts[name] += count
        for reason, count in step.rejected.items():
            self.rejected_because[reason] = self.rejected_because.get(reason, 0) + count
        row: dict[str, Any] = {"time_s": step.time}
        row["run/crank_angle_deg"] = self._angle(step)
        row |= self._joints(step, size) | self._bodies(step)
        powers = step_powers(self.run.equations, step)
        row |= energy_row(self.rows, step.time, powers, begins=begins)
        row |= {"run/step_s": size, "run/newton_iterations": step.newton_iterations}
        row["run/rejected_steps"] = rejected
        if cycles is not None:
            row |= {"run/cycle": cycles.number, "run/cycle_time_s": step.time - cycles.start}
        row |= solution(self.run, step)
        if self._resumed:
            _require_alike(row, self.rows[-1])
            self._resumed = False
        self.rows.append(row)
        return {column_name(name): value for name, value in row.items() if is_column(name)}

    @property
    def reference_body(self) -> str:
        """Name of the body whose angle is the reference angle; empty if no body turns."""
        angles = self.system.angles.items()
        return next((name for name, index in angles if index == self._reference), "")

    def _angle(self, step: MechanismStep) -> float:
        """Reference angle at a step [degrees], continuous over a cycle; 0 if no body turns.

        From the second cycle of a search on, periods of the loads before the cycle are subtracted:
        the last cycle of an engine is from 0 to 720 degrees, not from 1440 to 2160.
        """
        if self._reference is None:
            return 0.0
        former = 0.0
        cycles = self.cycles
        if cycles is not None and cycles.number > 1:
            began = float(np.degrees(cycles.began.x[0, self._reference]))
            turn = self.recurrence.angle
            former = turn * np.floor(began / turn + TURN_ROUNDING)
        return float(np.degrees(step.x[self._reference]) - former)

    def _joints(self, step: MechanismStep, size: float) -> dict[str, float]:
        """Columns of the lubricated joints at a step of length `size` [s].

        Wear and the estimates of the basis error are updated by the step.
        """
        row: dict[str, float] = {}
        responses = self.run.equations.responses
        pressures = [film.pressure for film in step.solution.films]
        loads = surface_loads(self.system, pressures, step.x)
        for joint in step.solution.joints:
            name = joint.binding.name
            columns = joint_row(joint)
            if name in self.slid:
                former = self.rubbing[name]
                self.rubbing[name] = rubbing(joint)
                if self.rows:
                    slid = 0.5 * size * (former + self.rubbing[name])
                    self.slid[name] = self.slid[name] + slid
            estimates = self.estimates_at(joint.binding)
            if estimates:
                columns["basis_error_estimate_m"] = sum(
                    estimate.add(size, loads[body], step.acceleration[responses.of_body(body)])
                    for body, estimate in estimates.items()
                )
            row |= {f"joints/{name}/{column}": value for column, value in columns.items()}
        return row

    def estimates_at(self, binding: FilmBinding) -> dict[str, BasisErrorEstimate]:
        """Estimates of the basis error of both surfaces of a film, by body; at most two."""
        return {
            bound.body: self.estimates[bound.key]
            for bound in binding.surfaces
            if bound.key in self.estimates
        }

    def _bodies(self, step: MechanismStep) -> dict[str, float]:
        """Columns of the frames of all bodies at a step; the frame of a shaft has only an angle."""
        row: dict[str, float] = {}
        coordinates = self._coordinates.items()
        for (path, unit), x, rate in zip(coordinates, step.x, step.rate, strict=False):
            if path.startswith("bodies/") and unit != MODAL:
                row[with_unit(path, unit)] = x
                if path.endswith("/angle"):
                    row[f"{path.removesuffix('angle')}speed_rad_per_s"] = rate
        return row

    def add_reported(self) -> None:
        """Add the quantities that are computed from recorded rows to all rows that are kept.

        The method is called when the run has ended, and not at its steps.
        """
        if self.rows and with_reported(self.run, self.rows[-1]).keys() != self.rows[-1].keys():
            self.rows = [with_reported(self.run, row) for row in self.rows]

    def history(self) -> History:
        """Make the history of the steps whose rows are kept."""
        return replace(history_of(self.system, self.rows), stored_cycle=self.last_cycle)

    def final_history(self) -> History:
        """Make the history of a run that has ended.

        For a search it has the last cycle only, with a step at its start.
        """
        history = self.history()
        if self.cycles is None:
            return history
        first = self.first
        return history.each(lambda values: values[first:]).with_start()
