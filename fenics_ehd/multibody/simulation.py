"""A mechanism from its start to an end time or a cycle that repeats itself, and its history.

A `Simulation` makes a row of every accepted step and keeps it. Figures are extremes, means and
energies over columns of these rows; what no row has, past loads of an estimate, say, goes on from
step to step, and is what a run that goes on needs beside its history.

Figures ``cycle_...`` of the summary are of the last complete cycle, which
`fenics_ehd.multibody.cycle` decides.

With one lubricated joint its columns and figures stand alone, with several they bear its name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from time import perf_counter, process_time
from typing import Any, ClassVar

import attrs
import numpy as np

from fenics_ehd.base.arguments import (
    require_callable,
    require_class,
    require_count,
    require_names,
    require_number,
)
from fenics_ehd.base.columns import Quantity, split_unit, with_unit
from fenics_ehd.base.errors import InputError, SettingsError
from fenics_ehd.base.layout import Group, Sizes, Stateful, Value
from fenics_ehd.film.film import steepest_thickening
from fenics_ehd.film.heat import require_cycle
from fenics_ehd.multibody.bdf import IntegratorOptions, IntegratorState
from fenics_ehd.multibody.cycle import Cycle, Recurrence, first_of_last
from fenics_ehd.multibody.history import (
    FIELD_UNITS,
    TURN_ROUNDING,
    History,
    column_name,
    fixed,
    is_column,
)
from fenics_ehd.multibody.mechanism import FilmBinding, Mechanism, System
from fenics_ehd.multibody.newton import (
    INTEGRATOR_STATE,
    MechanismStep,
    SolverState,
    unresolved,
)
from fenics_ehd.multibody.notices import stepped_shapes, unusual_totals
from fenics_ehd.multibody.periodic import PeriodicSolver, crank, recurrence_of, temperatures
from fenics_ehd.multibody.quantities import (
    CONTENT,
    averaged,
    joint_row,
    oil_balance,
    rubbing,
    wear,
)
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.trust import (
    ENERGY_LIMIT,
    RINGING,
    SIGNS,
    SPIKE,
    BasisErrorEstimate,
    above,
    balance_error,
    bore_body,
    bore_loads,
    energy_row,
    estimate_at,
    in_one_step,
    integral,
    rings,
    stated,
    step_powers,
    too_coarse,
)

Columns = Mapping[str, np.ndarray]

#: A step: numbers by path with unit, ``joints/big_end/force_x_N``, arrays by path.
Row = Mapping[str, Any]


#: Extremes over a cycle: name, column, what stands before that in the summary, and columns that are
#: told of the same step.
EXTREMES = (
    ("max_pressure", "max_pressure_Pa", "", ("max_pressure_angle_deg", "max_pressure_height_m")),
    ("min_film", "min_film_thickness_m", "", ("min_film_angle_deg", "min_film_height_m")),
    ("max_force", "force_N", "max_", ("force_angle_deg",)),
    ("max_eccentricity", "eccentricity_ratio", "max_", ()),
)

#: Columns of which a summary has the extreme over the run, or the cycle under way, and when it is.
PEAKS = ("max_pressure_Pa", "min_film_thickness_m", "max_contact_pressure_Pa")


def extreme_step(column: str, values: np.ndarray) -> int:
    """Step of the extreme of a column: of ``min_film_thickness_m`` the least, else the largest."""
    return int(np.argmin(values) if column.startswith("min_") else np.argmax(values))


#: Columns that decide which cycle is the last complete one.
DECIDE_CYCLE = ("time_s", "run/crank_angle_deg", "run/cycle", "run/cycle_time_s")


def cycle_of(columns: Columns, recurrence: Recurrence) -> Cycle:
    """The last complete cycle of a run, from its columns by path.

    Parameters
    ----------
    columns
        Of the run; of a search for a periodic solution of its last cycle at least.
    recurrence
        Of the loads, which decide the cycle of a run once through.
    """
    times = columns["time_s"]
    if "run/cycle" in columns:
        return Cycle.of_search(times, columns["run/cycle"], columns["run/cycle_time_s"])
    return Cycle.of_run(times, columns["run/crank_angle_deg"], recurrence)


def cycle_figures(
    cycle: Cycle, columns: Columns, joint: str, rates: Iterable[str]
) -> dict[str, float]:
    """Entries ``cycle_...`` of the summary on a joint: extremes, and means of some of its rates.

    Means are entered if they are not those over the cycle under way, or over the whole run, which
    have entries without ``cycle_``.
    """
    figures: dict[str, float] = {}
    times = columns["time_s"]
    rows = cycle.rows(times)
    for name, column, prefix, others in EXTREMES:
        values = columns[f"joints/{joint}/{column}"][rows]
        row = rows.start + extreme_step(column, values)
        for reported in (column, *others):
            value = columns[f"joints/{joint}/{reported}"][row]
            figures[f"cycle_{prefix}{reported}"] = float(value)
        angle = columns["run/crank_angle_deg"][row]
        figures[f"cycle_{name}_crank_angle_deg"] = float(angle)
    under_way = rows.stop == len(times) and (cycle.periodic or not cycle.start)
    for name in ("force_N", *(() if under_way else rates)):
        values = columns[f"joints/{joint}/{name}"]
        figures[f"cycle_mean_{name}"] = _mean_after(cycle.start, times, values, rows)
    return figures


def _mean_after(start: float, times: np.ndarray, values: np.ndarray, rows: slice) -> float:
    """Mean of a column over time from a start [s], between two steps or not, to the last row."""
    knots = np.append(start, times[rows])
    values = np.append(np.interp(start, times, values), values[rows])
    return float(integral(knots, values[:, None])[0] / (knots[-1] - knots[0]))


#: Pressure beyond which a notice asks for the reason [Pa]: bearing metals yield far below, and
#: films of gears and rollers, whose solids are not those of a bearing, begin there.
HIGHEST = 1e9

#: Pressure over that of a film which moves in the time simulated, below which it is rounding.
RESTING = 1e-6

#: Names of a body's frame coordinates in a history.
FRAME = ("x_m", "y_m", "angle_rad")


#: Value and time [s], in a periodic run since the start of the cycle, by quantity.
Extremes = dict[str, tuple[float, float]]

#: A joint's own coordinates, as columns.
JOURNAL = ("eccentricity_x_m", "eccentricity_y_m", "tilt_x_rad", "tilt_y_rad")

#: Unit of the amplitude of an elastic mode: as its basis is scaled.
MODAL = "modal"


def meshes_of(system: System) -> dict[str, np.ndarray]:
    """Nodes, cells and sizes of every film, by path."""
    found: dict[str, np.ndarray] = {}
    for binding in system.films:
        parameters, path = binding.film.film.parameters, f"joints/{binding.name}/film"
        angles, heights = parameters.grid.node_positions.T
        found |= {
            f"{path}/radius": np.array(parameters.grid.radius),
            f"{path}/clearance": np.array(parameters.clearance),
            f"{path}/angle": angles,
            f"{path}/height": heights,
            f"{path}/cells": parameters.grid.cell_nodes.astype(np.int32),
        }
    return found


def history_of(system: System, rows: Sequence[Row]) -> History:
    """History of rows at its steps."""
    values: dict[str, Quantity] = {}
    found = {name: np.array([row[name] for row in rows]) for name in (rows[0] if rows else ())}
    for name, own in {**found, **meshes_of(system)}.items():
        path, unit = split_unit(name)
        number = own.astype(float) if is_column(name) else own
        values[path] = Quantity(number, FIELD_UNITS.get(path.rpartition("/")[2], unit))
    known = _coordinates(system)
    return History(values, tuple(name for name, _ in known), tuple(unit for _, unit in known))


def solution(run: Run, step: MechanismStep) -> dict[str, np.ndarray]:
    """Arrays by path that a history has of the last accepted step of a run."""
    system, patterns = run.equations.system, run.equations.responses.size
    found = {"state/coordinates": step.x[: system.n], "state/rates": step.rate[: system.n]}
    assert run.state.solver is not None
    values = run.state.solver.values[0]
    found["state/multipliers"] = values[len(values) - 2 * system.m :]
    found["state/corner"] = np.array(len(run.state.times) == 1)
    if patterns:
        found["state/quasi_static"] = step.x[system.n : system.n + patterns]
    for joint in step.solution.joints:
        path = f"joints/{joint.place.name}/film"
        found[f"{path}/pressure"] = joint.pressure
        found[f"{path}/gap"] = joint.gap[-len(joint.pressure) :]
        if joint.state.fluid_fraction is not None:
            found[f"{path}/fluid_fraction"] = joint.state.fluid_fraction
    # Copies: parts of larger arrays would keep these.
    return {path: np.array(values) for path, values in found.items()}


def _coordinates(system: System) -> list[tuple[str, str]]:
    """Path and unit of every coordinate of a mechanism."""
    found: list[tuple[str, str]] = []
    for name, own in system.bodies.items():
        angle = system.angles.get(name)
        frame = [] if angle is None else FRAME[2 - (angle - own.start) :]
        found += [split_unit(f"bodies/{name}/{column}") for column in frame]
        modes = own.stop - own.start - len(frame)
        found += [(f"bodies/{name}/mode_{i + 1}", MODAL) for i in range(modes)]
    for binding in system.films:
        names = JOURNAL[: binding.film.journal_coordinates]
        found += [split_unit(f"joints/{binding.name}/{n}") for n in names]
    return found


def columns_of(rows: Sequence[Row]) -> dict[str, np.ndarray]:
    """Columns of rows by path, of no rows nothing."""
    names = filter(is_column, rows[0] if rows else ())
    return {name: np.array([row[name] for row in rows]) for name in names}


def extremes_of(columns: Columns) -> dict[str, Extremes]:
    """Extremes of every film, by joint, over columns by path."""
    found: dict[str, Extremes] = {}
    for path, values in columns.items():
        joint, _, column = path.removeprefix("joints/").partition("/")
        if column in PEAKS:
            step, clock = extreme_step(column, values), columns.get("run/cycle_time_s")
            time = (columns["time_s"] if clock is None else clock)[step]
            own = found.setdefault(joint, {})
            own[split_unit(column)[0]] = float(values[step]), float(time)
    return found


def _require_alike(row: Row, stored: Row) -> None:
    """Refuse rows of a stored history that are not those of this mechanism.

    Raises
    ------
    InputError
        Naming a column.
    """
    for name in dict.fromkeys([*row, *stored]):
        if name not in row or name not in stored or np.shape(row[name]) != np.shape(stored[name]):
            raise InputError(
                f"the stored history is not of this scene: {name} is missing or has another shape; "
                "run the scene anew"
            )


#: Layout of a number of steps or iterations.
COUNT = Value("integer", least=0)


class Simulation(Stateful):
    """A run on its way, with its history so far; ended, for those who look at it again.

    Its state is all that a run goes on from, beside its history. Of a search for a periodic
    solution rows are those of the last two cycles.

    Parameters
    ----------
    run
        At its start.
    end
        Time at which it stops, if it is not periodic [s].
    cycles
        Search for its periodic solution, or None.

    Attributes
    ----------
    system
        The mechanism.
    wall_time, processor_time
        Of its steps so far [s].
    rows
        Of every step.
    counts, rejected_because
        Of all steps, also of those whose rows are not kept.
    estimates
        Of errors of the basis, by joint.
    rubbing, slid
        Of rough surfaces by joint, see `fenics_ehd.multibody.quantities.rubbing`: at the last step,
        and its integral over the run, or the cycle.
    worth
        What is known of how far figures of joints are off, by joint, see `error_budget`.
    """

    carried: ClassVar = {
        "integrator": INTEGRATOR_STATE,
        "cycles": Group(PeriodicSolver.carried, required=False),
        "wall_time": Value("real"),
        "processor_time": Value("real"),
        "counts": Group(
            dict.fromkeys(("steps", "newton_iterations", "rejected_steps"), COUNT), each=COUNT
        ),
        "rejected_because": Group(each=COUNT),
        "estimates": Group(each=Group(BasisErrorEstimate.carried)),
        "rubbing": Group(each=Value("float", ("points",))),
        "slid": Group(each=Value("float", ("points",))),
    }

    def __init__(self, run: Run, end: float, cycles: PeriodicSolver | None = None):
        self.run, self.end, self.cycles = run, end, cycles
        self.system, self._start = run.equations.system, run.state
        self.wall_time = self.processor_time = 0.0
        films = self.system.films
        self.rows: list[Row] = []
        self._stored = False
        self.worth: dict[str, dict[str, Any]] = {}
        self._crank, self.recurrence = crank(self.system), recurrence_of(self.system)
        self._coordinates = _coordinates(self.system)
        self.estimates = {
            binding.name: estimate_at(bore_body(self.system, binding), binding.bore)
            for binding in films
            if binding.film.bore
        }
        rough = zip(films, run.equations.contacts.joints, strict=True)
        self.slid = {p.name: np.zeros(len(own.area)) for p, own in rough if own is not None}
        self.rubbing = dict(self.slid)
        self.counts = {"steps": 0, "newton_iterations": 0, "rejected_steps": 0}
        self.rejected_because: dict[str, int] = {}

    @property
    def integrator(self) -> IntegratorState[SolverState]:
        """State of the integration."""
        return self.run.state

    @integrator.setter
    def integrator(self, state: IntegratorState[SolverState]) -> None:
        self.run.state = state

    @property
    def began(self) -> IntegratorState[SolverState]:
        """State at the start of the run, or of the cycle under way."""
        return self._start if self.cycles is None else self.cycles.began

    @property
    def time(self) -> float:
        """Time of the last step [s]."""
        return self.rows[-1]["time_s"] if self.rows else self._start.time

    @property
    def first(self) -> int:
        """Row of the first step of the cycle under way."""
        if not self.rows or "run/cycle" not in self.rows[0]:
            return 0
        return first_of_last([row["run/cycle"] for row in self.rows])

    @property
    def last_cycle(self) -> Cycle | None:
        """The last complete cycle; None before the first step."""
        if not self.rows:
            return None
        names = [name for name in DECIDE_CYCLE if name in self.rows[0]]
        columns = {name: np.array([row[name] for row in self.rows]) for name in names}
        return cycle_of(columns, self.recurrence)

    def known_sizes(self) -> Sizes:
        """Number of unknowns of a step."""
        owners = ("/integrator", "/cycles/began")
        return dict.fromkeys(
            (f"{owner} unknowns" for owner in owners), len(self.run.equations.lower)
        )

    def take(self, history: History) -> None:
        """Go on after the steps of a history.

        Raises
        ------
        ValueError
            It lacks what the next step needs.
        """
        columns = {
            with_unit(path, own.units) if is_column(path) else path: np.asarray(own)
            for path, own in history.values.items()
            if not fixed(path)
        }
        needed = energy_row((), 0.0, dict.fromkeys((*SIGNS, "kinetic", "strain"), 0.0))
        needed |= {"time_s": 0.0, "run/crank_angle_deg": 0.0}
        if self.cycles is not None:
            needed |= {"run/cycle": 0.0, "run/cycle_time_s": 0.0}
        for name, value in needed.items():
            if name not in columns or columns[name].shape[1:] != np.shape(value):
                raise ValueError(f"/{name} is missing, or of another shape than this scene's")
        self.rows = [{name: own[i] for name, own in columns.items()} for i in range(len(history))]
        self._stored = bool(self.rows)

    def steps(self) -> Iterator[tuple[MechanismStep, dict[str, float]]]:
        """Accepted steps, which the history then has, and their rows of ``history.csv``."""
        began, busy = perf_counter() - self.wall_time, process_time() - self.processor_time
        for step in self.run.until(self.end) if self.cycles is None else self.cycles:
            row = self.add(step)
            self.wall_time, self.processor_time = perf_counter() - began, process_time() - busy
            yield step, row

    def add(self, step: MechanismStep) -> dict[str, float]:
        """Account for an accepted step, of a search in its current cycle.

        Returns
        -------
        dict
            Its row of ``history.csv``.
        """
        cycles = self.cycles
        begins = bool(cycles and self.rows and cycles.number != self.rows[-1]["run/cycle"])
        if begins:
            # Works and wear begin anew; counts and the estimates' past go on.
            self.rows = self.rows[self.first :]
            self.slid = {name: np.zeros_like(own) for name, own in self.slid.items()}
        size, rejected = step.time - self.time, sum(step.rejected.values())
        self.counts["steps"] += 1
        self.counts["newton_iterations"] += step.newton_iterations
        self.counts["rejected_steps"] += rejected
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
        if self._stored:
            _require_alike(row, self.rows[-1])
            self._stored = False
        self.rows.append(row)
        films = self.system.films
        return {column_name(name, films): own for name, own in row.items() if is_column(name)}

    def _angle(self, step: MechanismStep) -> float:
        """Angle of the crank [degrees], continuous over a cycle; 0 where nothing turns.

        Every cycle but the first of a search begins within the first one of the loads: an engine's
        last one is 0 to 720 degrees, not 1440 to 2160.
        """
        if self._crank is None:
            return 0.0
        former, cycles = 0.0, self.cycles
        if cycles is not None and cycles.number > 1:
            began = float(np.degrees(cycles.began.x[0, self._crank]))
            turn = self.recurrence.angle
            former = turn * np.floor(began / turn + TURN_ROUNDING)
        return float(np.degrees(step.x[self._crank]) - former)

    def _joints(self, step: MechanismStep, size: float) -> dict[str, float]:
        """Columns of the lubricated joints at a step of a size [s]; wear and estimates go on."""
        row: dict[str, float] = {}
        loads = bore_loads(self.system, [film.pressure for film in step.solution.films])
        for joint in step.solution.joints:
            binding, name = joint.binding, joint.binding.name
            figures = joint_row(joint)
            if name in self.slid:
                former, self.rubbing[name] = self.rubbing[name], rubbing(joint)
                if self.rows:
                    slid = 0.5 * size * (former + self.rubbing[name])
                    self.slid[name] = self.slid[name] + slid
            if name in self.estimates:
                amplitudes = self.run.equations.responses.of_body(binding.bore_body)
                figures["basis_error_estimate_m"] = self.estimates[name].add(
                    size, loads[binding.bore_body], step.acceleration[amplitudes]
                )
            row |= {f"joints/{name}/{column}": value for column, value in figures.items()}
        return row

    def _bodies(self, step: MechanismStep) -> dict[str, float]:
        """Columns of the bodies' frames; a shaft has an angle alone."""
        row: dict[str, float] = {}
        for (path, unit), x, rate in zip(self._coordinates, step.x, step.rate, strict=False):
            if path.startswith("bodies/") and unit != MODAL:
                row[with_unit(path, unit)] = x
                if path.endswith("/angle"):
                    row[f"{path.removesuffix('angle')}speed_rad_per_s"] = rate
        return row

    def history(self) -> History:
        """History of the steps that are kept."""
        return replace(history_of(self.system, self.rows), stored_cycle=self.last_cycle)

    def ended(self) -> History:
        """History of a run that has ended, of a search its last cycle, both its ends."""
        found, first = self.history(), self.first
        if self.cycles is not None:
            found = found.each(lambda values: values[first:]).with_start()
        told = {"status": self.verdict(), **self.figures()}
        return replace(found, told=told, solved=self)

    @property
    def extremes(self) -> dict[str, Extremes]:
        """Extremes of every film over the cycle under way, or the run."""
        return extremes_of(columns_of(self.rows[self.first :]))

    @property
    def former(self) -> dict[str, Extremes]:
        """Those over the cycle before."""
        return extremes_of(columns_of(self.rows[: self.first]))

    def steepest_thickening(self, binding: FilmBinding) -> float:
        """Largest factor of a film's viscosity within a cell, over the cycle, or the run."""
        path = f"joints/{binding.name}/film/pressure"
        own = [row[path] for row in self.rows[self.first :]]
        return max((steepest_thickening(binding.film.film, p) for p in own), default=1.0)

    @property
    def energy_error(self) -> float:
        """Largest defect over the largest energy exchanged, of the cycle under way, or the run."""
        return balance_error(columns_of(self.rows[self.first :])) if self.rows else 0.0

    def figures(self) -> dict[str, Any]:
        """Entries of ``summary.json`` on the run and its last complete cycle."""
        columns = columns_of(self.rows)
        joints: dict[str, dict[str, Any]] = {binding.name: {} for binding in self.system.films}
        cycle = self.last_cycle
        if cycle is not None:
            for binding in self.system.films:
                joints[binding.name] = self._joint(binding, columns, cycle)
        alone: dict[str, Any] = {"joints": joints}
        if len(joints) == 1:
            ((name, found),) = joints.items()
            alone = {"joint": name, **found}
        return {
            **alone,
            **({} if cycle is None else cycle.entries()),
            "energy_balance_error": self.energy_error,
            "simulated_time_s": self.time,
            **self.counts,
            "rejected_because": dict(self.rejected_because),
            "notices": self._notices(),
            **({} if self.cycles is None else self.cycles.figures()),
        }

    def _joint(self, binding: FilmBinding, columns: Columns, cycle: Cycle) -> dict[str, Any]:
        """Entries on a lubricated joint, from columns by path."""
        name, start = binding.name, f"joints/{binding.name}/"
        own = {key.removeprefix(start): v for key, v in columns.items() if key.startswith(start)}
        time, extremes = columns["time_s"], self.extremes[name]
        found: dict[str, Any] = {}
        for column in filter(own.__contains__, PEAKS):
            quantity = split_unit(column)[0]
            found[column], found[f"{quantity}_time_s"] = extremes[quantity]
        found["basis_error_estimate_m"] = float("nan")
        if name in self.estimates:
            estimate, errors = self.estimates[name], own["basis_error_estimate_m"]
            counted = errors[self.first :][time[self.first :] > estimate.start]
            least = 0.0 if estimate.known else float("nan")
            found["basis_error_estimate_m"] = float(np.max(counted, initial=least))
        rates = averaged(own)
        if rates:
            found |= self._means(binding, time, rates)
        if name in self.slid:
            found |= wear(binding, self.slid[name])
        if name in self.worth:
            found["error_budget"] = self.worth[name]
        return found | cycle_figures(cycle, columns, name, rates)

    def _means(self, binding: FilmBinding, time: np.ndarray, rates: Columns) -> dict[str, float]:
        """Means of a joint's rates over the run, or the cycle, and what follows from them."""
        begin = max(self.first - 1, 0)
        values = np.column_stack([*rates.values()])
        whole, length = integral(time, values, begin), time[-1] - time[begin]
        means = dict(zip(rates, (whole / length if length else values[-1]).tolist(), strict=True))
        found = {f"mean_{name}": value for name, value in means.items()}
        if CONTENT in rates:
            totals = dict(zip(rates, whole.tolist(), strict=True))
            content = rates[CONTENT]
            found |= oil_balance(float(content[begin]), float(content[-1]), totals)
        return found if binding.joint.heat is None else found | temperatures(binding, means)

    def _notices(self) -> list[str]:
        """One line each of what is hardly meant."""
        largest = {name: own["max_pressure"][0] for name, own in self.extremes.items()}
        told = [
            f"{name}: {1e-6 * largest[name]:.6g} MPa, more than {1e-6 * HIGHEST:g} MPa: no "
            "lining bears that, and no model here is made for it: see loads, units, size and "
            "whether a bore is meant to be rigid"
            for name in largest
            if largest[name] > HIGHEST
        ]
        for name in self._resting:
            told.append(
                f"{name}: nothing moves or loads its film, the {largest[name]:.2g} Pa in it are "
                "rounding"
            )
        mechanism = self.system.mechanism
        told += self._single_peaks()
        return [*told, *unusual_totals(mechanism.bodies), *stepped_shapes(mechanism.joints)]

    def _single_peaks(self) -> list[str]:
        """One line for every peak of a single step or of the ringing of a start."""
        columns = columns_of(self.rows[self.first :])
        lines: list[str] = []
        ringing = self.cycles is None and self.system.least_damping < RINGING
        for name in (binding.name for binding in self.system.films):
            values = columns.get(f"joints/{name}/max_pressure_Pa")
            if values is None or name in self._resting:
                continue
            peak = 1e-6 * float(values.max())
            ratio = in_one_step(values)
            if ratio > SPIKE:
                lines.append(
                    f"{name}: the peak of {peak:.4g} MPa is in a single step, {ratio:.3g} times "
                    "those around it: lower time.tolerance, and see what jumps there"
                )
            elif ringing and rings(values):
                lines.append(
                    f"{name}: the peak of {peak:.4g} MPa is the first swing of a start that rings, "
                    "with modes of hardly any damping: let loads grow (ramp), damp the bodies "
                    "(damping_time, damping_ratio), or see later cycles (time.periodic = true)"
                )
        return lines

    @property
    def _resting(self) -> list[str]:
        """Names of the films whose pressures are nothing beside what a motion would make."""
        scales = {p.name: p.film.film.parameters.pressure_scale for p in self.system.films}
        extremes = self.extremes.items()
        return [name for name, own in extremes if own["max_pressure"][0] < RESTING * scales[name]]

    def verdict(self, limit: float = np.inf) -> str:
        """``"complete"``, or why the figures cannot be trusted.

        They cannot where what is known of their errors exceeds a relative limit, or a defect of the
        energy what is known of the steps. What stands for errors of the films' meshes counts as far
        as they are not known.
        """
        if self.system.films and len(self._resting) == len(self.system.films):
            return "complete"  # errors of nothing are no shares
        if told := above(self.worth, limit):
            return told
        mesh, steps = (stated(self.worth, component) for component in ("film_mesh", "step_size"))
        extremes = self.extremes
        for binding in self.system.films if mesh is None else ():
            told = too_coarse(binding, extremes[binding.name]["min_film_thickness"][0])
            told = told or unresolved(binding, self.steepest_thickening(binding))
            if told:
                return told
        error, known = self.energy_error, max(steps or 0.0, ENERGY_LIMIT)
        if error <= known:
            return "complete"
        return (
            f"untrustworthy: energy balance error {100 * error:.2g} % of the energy exchanged, "
            f"above {100 * known:.2g} %: lower time.tolerance or time.largest_step"
        )


def simulate(
    mechanism: Mechanism,
    end: float | None = None,
    *,
    period: float | None = None,
    periodicity: float = 1e-4,
    cycles: int = 20,
    progress: Callable[[MechanismStep], None] = lambda step: None,
    **steps: Any,
) -> History:
    """A mechanism from its start to an end time, or the cycle that repeats itself.

    Parameters
    ----------
    mechanism
        What moves; it is assembled from its rough pose.
    end
        End time of an initial value problem [s]; or
    period, periodicity, cycles
        Of a mechanism whose forcing repeats, see `PeriodicSolver`.
    progress
        Called after every accepted step: ``lambda step: print(step.time)``.
    steps
        Fields of `IntegratorOptions`: ``tolerance=1e-6``.

    Returns
    -------
    History
        Of all steps; of a periodic solution of the last cycle, its time from 0 to the period.

    Raises
    ------
    SettingsError
        The mechanism cannot be assembled, neither or both of end and period are given, or the end
        is not after the start; a joint has `heat` and no period; there is no film to repeat.
    StepSizeError
        No step is short enough.
    FilmTooThinError
        A film became thinner than its joint's `smallest_film`.
    PeriodicityError
        The films still change after so many cycles.
    """
    require_class("mechanism", mechanism, Mechanism)
    require_names("simulate", steps, attrs.fields_dict(IntegratorOptions))
    if (end is None) == (period is None):
        raise SettingsError("simulate takes either end, a time, or period, of what repeats itself")
    duration = ("end", end) if period is None else ("period", period)
    span = require_number(*duration, above=0)
    require_number("periodicity", periodicity, above=0)
    require_count("cycles", cycles, least=1)
    require_callable("progress", progress)
    run = Run(mechanism, IntegratorOptions(**steps), span)
    for name, joint in mechanism.joints.items():
        if getattr(joint, "heat", None) is not None:
            require_cycle(period is not None, f"joints.{name}.heat")
    search = None if period is None else PeriodicSolver(run, span, periodicity, cycles)
    found = Simulation(run, span, search)
    for step, _ in found.steps():
        progress(step)
    return found.ended()
