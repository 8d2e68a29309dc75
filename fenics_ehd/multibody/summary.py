"""Summary of a run: entries of ``summary.json`` about its joints, its cycle and its steps.

Entries of a joint are extremes, means over time or integrals of columns of the history. Entries
``cycle_...`` are those of the last complete cycle, which `fenics_ehd.multibody.cycle` defines.
Entries without ``cycle_`` are those of the current cycle of a search for a periodic solution, or of
the complete run otherwise.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from fenics_ehd.base.columns import split_unit
from fenics_ehd.base.extremes import over_time
from fenics_ehd.film.film import steepest_thickening
from fenics_ehd.multibody.cycle import END_ROUNDING, Cycle, angle_before, first_of_last
from fenics_ehd.multibody.figures import reported_errors
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.notices import (
    RINGING,
    resting_films,
    stepped_shapes,
    unfed_film,
    unusual_peaks,
    unusual_pressures,
    unusual_totals,
)
from fenics_ehd.multibody.orbit import orbit_figures
from fenics_ehd.multibody.periodic import temperatures
from fenics_ehd.multibody.quantities import CONTENT, FLOW, SIDE_FLOW, averaged, oil_balance, wear
from fenics_ehd.multibody.recorder import STEP_COUNTS, Columns, Recorder, columns_of
from fenics_ehd.multibody.trust import balance_error, integral

#: Cycle extremes of a joint that has the source column: summary name, source column, prefix in the
#: summary, and columns reported at the step of the extreme.
EXTREMES = (
    ("max_pressure", "max_pressure_Pa", "", ("max_pressure_angle_deg", "max_pressure_height_m")),
    ("min_film", "min_film_thickness_m", "", ("min_film_angle_deg", "min_film_height_m")),
    ("max_force", "force_N", "max_", ("force_angle_deg",)),
    ("max_specific_load", "specific_load_Pa", "max_", ()),
    ("min_lambda_ratio", "min_lambda_ratio", "", ()),
    ("max_contact_share", "contact_share", "max_", ()),
    ("max_eccentricity", "eccentricity_ratio", "max_", ()),
)

#: Columns whose mean over the last complete cycle is always an entry.
CYCLE_MEANS = ("force_N", "specific_load_Pa")

#: Columns whose extreme over the current cycle of a search, or over the run, and its time are
#: entries.
PEAKS = ("max_pressure_Pa", "min_film_thickness_m", "max_contact_pressure_Pa")

#: Value of an extreme and its time [s] by quantity; in a search, time is counted from the start of
#: the cycle.
Extremes = dict[str, tuple[float, float]]


def extreme_step(column: str, values: np.ndarray) -> int:
    """Step of the extreme of a column: of the minimum for ``min_...``, else of the maximum."""
    return int(np.argmin(values) if column.startswith("min_") else np.argmax(values))


def extreme_of(
    column: str, times: np.ndarray, values: np.ndarray, period: float | None
) -> tuple[float, float]:
    """Extreme of a column, interpolated between its steps, and its time [s].

    The extreme is the minimum for ``min_...``, else the maximum. With a `period` [s] the values are
    periodic, see `fenics_ehd.base.extremes`.
    """
    return over_time(times, values, period, -1 if column.startswith("min_") else 1)


def extremes_of(columns: Columns, period: float | None = None) -> dict[str, Extremes]:
    """Extremes of the columns `PEAKS` by joint.

    Parameters
    ----------
    columns
        Columns by path, for all steps of a run or of one cycle.
    period
        Period of a search for a periodic solution [s]; None without a search.
    """
    extremes: dict[str, Extremes] = {}
    clock = columns.get("run/cycle_time_s", columns.get("time_s"))
    if clock is None or period is None or clock[-1] < (1.0 - END_ROUNDING) * period:
        period = None
    for path, values in columns.items():
        joint, _, column = path.removeprefix("joints/").partition("/")
        if column in PEAKS:
            assert clock is not None
            extreme = extreme_of(column, np.asarray(clock), values, period)
            extremes.setdefault(joint, {})[split_unit(column)[0]] = extreme
    return extremes


def cycle_figures(
    cycle: Cycle, columns: Columns, joint: str, rates: Iterable[str]
) -> dict[str, float]:
    """Entries ``cycle_...`` of the summary of a joint: extremes, and means of columns.

    Parameters
    ----------
    cycle, columns
        Last complete cycle, and columns by path.
    joint, rates
        Name of the joint, and names of its columns with a mean over the cycle. These means are
        omitted if they are equal to the entries ``mean_...``.
    """
    figures: dict[str, float] = {}
    times = columns["time_s"]
    rows = cycle.rows(times)
    period = float(times[rows][-1]) - cycle.start if cycle.periodic else None
    angles = columns["run/crank_angle_deg"]
    if not cycle.periodic:  # the angles of a search begin anew in every cycle
        at_start = np.interp(cycle.start, times, angles)
        angles = angles - angle_before(np.append(at_start, angles[rows]))
    for name, column, prefix, others in EXTREMES:
        if f"joints/{joint}/{column}" not in columns:
            continue
        values = columns[f"joints/{joint}/{column}"][rows]
        row = rows.start + extreme_step(column, values)
        value, time = extreme_of(column, times[rows], values, period)
        figures[f"cycle_{prefix}{column}"] = value
        for reported in others:
            figures[f"cycle_{prefix}{reported}"] = float(columns[f"joints/{joint}/{reported}"][row])
        angle = float(np.interp(time, times[rows], angles[rows]))
        figures[f"cycle_{name}_crank_angle_deg"] = angle
    under_way = rows.stop == len(times) and (cycle.periodic or not cycle.start)
    for name in (*CYCLE_MEANS, *(() if under_way else rates)):
        values = columns[f"joints/{joint}/{name}"]
        figures[f"cycle_mean_{name}"] = _mean_after(cycle.start, times, values, rows)
    return figures


def _mean_after(start: float, times: np.ndarray, values: np.ndarray, rows: slice) -> float:
    """Mean of a column over time, from a time `start` [s] to the last step in `rows`."""
    knots = np.append(start, times[rows])
    values = np.append(np.interp(start, times, values), values[rows])
    return float(integral(knots, values[:, None])[0] / (knots[-1] - knots[0]))


@dataclass(frozen=True, eq=False)
class RunSummary:
    """Results of a run up to its last recorded step.

    Attributes
    ----------
    recorder
        Recorder of the run, which must not take steps while the summary is used.
    error_budget
        Estimated errors by name of the joint, see `fenics_ehd.analysis.error_budget`: relative
        errors of peak pressure and smallest film thickness, and absolute errors of all figures.
        Empty if errors were not estimated.
    other_columns
        Columns that are used in place of those of the recorder; None to use the latter.
    """

    recorder: Recorder
    error_budget: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    other_columns: Columns | None = None

    @cached_property
    def first(self) -> int:
        """Index of the row at the first step of the current cycle of a search; 0 for other runs."""
        return first_of_last(self.columns.get("run/cycle", ()))

    @cached_property
    def columns(self) -> Columns:
        """Columns of all stored rows by name with unit, shape (steps,) each."""
        if self.other_columns is not None:
            return self.other_columns
        return columns_of(self.recorder.rows)

    def with_columns(self, columns: Columns) -> RunSummary:
        """Summary of the same run with other columns, whose errors are not estimated."""
        return RunSummary(self.recorder, other_columns=columns)

    @cached_property
    def former(self) -> RunSummary | None:
        """Summary of the previous cycle of a search; None if there is no previous cycle.

        The start of that cycle is not recorded: it has the values of its end.
        """
        first = self.first
        if not first:
            return None
        columns = {name: np.append(v[first - 1], v[:first]) for name, v in self.columns.items()}
        columns["time_s"][0] = columns["time_s"][1] - columns["run/cycle_time_s"][1]
        columns["run/cycle"][0] -= 1
        return self.with_columns(columns)

    @property
    def last_cycle(self) -> Cycle | None:
        """Last complete cycle of the columns; None before the first step."""
        if not self.columns:
            return None
        return Cycle.of_columns(self.columns, self.recorder.recurrence)

    @cached_property
    def extremes(self) -> dict[str, Extremes]:
        """Extremes of every film by name of the joint, over the current cycle or over the run.

        The current cycle is that of a search for a periodic solution.
        """
        columns = {name: v[self.first :] for name, v in self.columns.items()}
        return extremes_of(columns, self._period)

    @property
    def _period(self) -> float | None:
        """Period of a search for a periodic solution [s]; None for other runs."""
        cycles = self.recorder.cycles
        return None if cycles is None else cycles.period

    @property
    def former_extremes(self) -> dict[str, Extremes]:
        """Extremes of every film over the previous cycle, by joint; empty if there is none."""
        return {} if self.former is None else self.former.extremes

    @property
    def peaks(self) -> dict[str, float]:
        """Largest pressure of every film by name of the joint [Pa].

        Pressures are those of the current cycle of a search for a periodic solution, or of the run.
        """
        return {name: extremes["max_pressure"][0] for name, extremes in self.extremes.items()}

    @property
    def energy_error(self) -> float:
        """Error of the energy balance over the current cycle or the run [-].

        It is the largest energy defect over the largest energy exchanged.
        """
        if not self.recorder.rows:
            return 0.0
        return balance_error({name: v[self.first :] for name, v in self.columns.items()})

    def steepest_thickening(self, binding: FilmBinding) -> float:
        """Largest ratio of viscosities within a cell of a film, over the current cycle or run."""
        path = f"joints/{binding.name}/film/pressure"
        pressures = (row[path] for row in self.recorder.rows[self.first :])
        film = binding.film.film
        return max((steepest_thickening(film, pressure) for pressure in pressures), default=1.0)

    def entries(self) -> dict[str, Any]:
        """Entries of ``summary.json`` about the run, its joints and its last complete cycle."""
        recorder = self.recorder
        joints: dict[str, dict[str, Any]] = {b.name: {} for b in recorder.system.films}
        cycle = self.last_cycle
        if cycle is not None:
            for binding in recorder.system.films:
                joints[binding.name] = self._joint(binding, cycle)
        return {
            "joints": joints,
            **({} if cycle is None else cycle.entries()),
            "reference_body": recorder.reference_body,
            "energy_balance_error": self.energy_error,
            "simulated_time_s": recorder.time,
            **{name: recorder.counts[name] for name in STEP_COUNTS},
            "rejected_because": dict(recorder.rejected_because),
            "counts": dict(recorder.counts),
            "notices": self.notices(),
            **({} if recorder.cycles is None else recorder.cycles.figures()),
        }

    def _joint(self, binding: FilmBinding, cycle: Cycle) -> dict[str, Any]:
        """Entries of ``summary.json`` about a lubricated joint."""
        figures = self.figures(binding, cycle)
        if binding.name in self.error_budget:
            budget = dict(self.error_budget[binding.name])
            errors = budget.pop("figures", {})
            figures |= {"error_budget": budget, "errors": reported_errors(figures, errors)}
        return figures

    def figures(self, binding: FilmBinding, cycle: Cycle) -> dict[str, Any]:
        """Entries of ``summary.json`` about a lubricated joint, without those about errors.

        Everything is computed from the columns, so that errors of columns give errors of figures.
        """
        name = binding.name
        columns = self._columns_of(name)
        figures: dict[str, Any] = {}
        for column in filter(columns.__contains__, PEAKS):
            quantity = split_unit(column)[0]
            figures[column], figures[f"{quantity}_time_s"] = self.extremes[name][quantity]
        figures["basis_error_estimate_m"] = self._basis_error(binding)
        rates = averaged(columns)
        if rates:
            figures |= self._means(binding, rates)
        if name in self.recorder.slid:
            figures |= wear(binding, self.recorder.slid[name])
        figures |= orbit_figures(binding, cycle, self.columns)
        return figures | cycle_figures(cycle, self.columns, name, rates)

    def _columns_of(self, name: str) -> dict[str, np.ndarray]:
        """Columns of a joint by name without that of the joint, for all stored rows."""
        prefix = f"joints/{name}/"
        return {
            path.removeprefix(prefix): values
            for path, values in self.columns.items()
            if path.startswith(prefix)
        }

    def _basis_error(self, binding: FilmBinding) -> float:
        """Largest estimated gap error at a joint due to the basis of a reduced body [m].

        Steps do not count until the oscillations that follow the start have decayed. The result is
        0 if no later step exists, and NaN if the error is not estimated.
        """
        estimates = self.recorder.estimates_at(binding).values()
        if not estimates:
            return float("nan")
        errors = self.columns[f"joints/{binding.name}/basis_error_estimate_m"][self.first :]
        start = max(estimate.start for estimate in estimates)
        counted = errors[self.columns["time_s"][self.first :] > start]
        known = all(estimate.known for estimate in estimates)
        return float(np.max(counted, initial=0.0 if known else float("nan")))

    def _means(self, binding: FilmBinding, rates: Columns) -> dict[str, float]:
        """Entries of the summary for the means over time of the columns `rates` of a joint.

        Means are those over the current cycle of a search, or over the run. The oil balance and the
        temperatures, which are computed from means, are included.
        """
        begin = max(self.first - 1, 0)
        times = self.columns["time_s"]
        values = np.column_stack([*rates.values()])
        integrals = integral(times, values, begin)
        length = times[-1] - times[begin]
        averages = (integrals / length if length else values[-1]).tolist()
        means = dict(zip(rates, averages, strict=True))
        figures = {f"mean_{name}": value for name, value in means.items()}
        if CONTENT in rates:
            totals = dict(zip(rates, integrals.tolist(), strict=True))
            content = rates[CONTENT]
            figures |= oil_balance(float(content[begin]), float(content[-1]), totals)
        return figures if binding.joint.heat is None else figures | temperatures(binding, means)

    def _unfed(self, binding: FilmBinding) -> list[str]:
        """Notice of a joint whose film loses more oil than it is fed, without mass conservation."""
        rates = averaged(self._columns_of(binding.name))
        flows = [name for name in rates if name.endswith(f".{FLOW}")]
        if not flows or SIDE_FLOW not in rates or CONTENT in rates:
            return []
        means = self._means(binding, rates)
        fed = sum(means[f"mean_{name}"] for name in flows)
        return unfed_film(binding.name, means[f"mean_{SIDE_FLOW}"], fed)

    def notices(self) -> list[str]:
        """Notices, one line each, of values of the mechanism or run that are probably mistakes."""
        system = self.recorder.system
        lines = unusual_pressures(system, self.peaks)
        may_ring = self.recorder.cycles is None and system.least_damping < RINGING
        resting = resting_films(system, self.peaks)
        for name in self.peaks:
            if name not in resting:
                pressures = self.columns[f"joints/{name}/max_pressure_Pa"][self.first :]
                lines += unusual_peaks(name, pressures, may_ring=may_ring)
        for binding in system.films:
            lines += self._unfed(binding)
        mechanism = system.mechanism
        return [*lines, *unusual_totals(mechanism.bodies), *stepped_shapes(mechanism.joints)]
