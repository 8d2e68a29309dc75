"""Errors of all figures of a run, from curves of the errors of its columns.

A figure is computed from columns of the run: it is an extreme, a mean over the cycle, a value at an
instant, or a combination of these. Every component of the error budget has curves of errors (exact
minus computed) of all columns. The figure is computed again from the columns plus these curves, by
the same summary (`RunSummary.figures`), and the change of the figure is its error by the component.

Errors that cancel by coincidence count:

- The error of an extreme is the mean of this change and of the root mean square of the error curve
  near the extreme, as for peak pressures.
- Amplitude and phase of an orbit's part are one complex number. The error of each is the mean of
  its own change and of the change of this number, for the phase relative to the amplitude.
- A quantity that acts over a part p of the cycle, such as the force of asperities, has a mean whose
  error may cancel within a short event. With the change d of the mean and the mean a of the
  absolute value of the error curve, the error of a mean is
  ``|d| + max((1 - p) / 2, 1 - 2 p) (a - |d|)``: nearly a for a short event, ``|d|`` for p = 1.

The total is the sum of all components.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fenics_ehd.analysis.error_curves import near_extreme, smooth_curve
from fenics_ehd.multibody.figures import numbers, reason_of
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.summary import RunSummary
from fenics_ehd.multibody.trust import NOT_ESTIMATED

#: Columns of a run about its cycles: number of the cycle, and time since its start [s].
CYCLE = "run/cycle"
CLOCK = "run/cycle_time_s"


def extreme_column(name: str, columns: tuple[str, ...]) -> str | None:
    """Column of which a figure is the extreme over the cycle or run; None for other figures.

    ``cycle_max_force_N`` is the extreme of ``force_N``, ``cycle_max_pressure_Pa`` that of
    ``max_pressure_Pa``.
    """
    base = name.removeprefix("cycle_")
    for column in (base, base.removeprefix("max_"), base.removeprefix("min_")):
        if column in columns and base.startswith(("max_", "min_")):
            return column
    return None


def mean_column(name: str, columns: tuple[str, ...]) -> str | None:
    """Column of which a figure is the mean over the cycle or run; None for other figures."""
    prefix, mean, column = name.partition("mean_")
    return column if mean and prefix in ("", "cycle_") and column in columns else None


def acting_part(values: np.ndarray, weights: np.ndarray) -> float:
    """Part of the time over which a quantity acts [-]: 1 if it is constant.

    Parameters
    ----------
    values, weights
        Values at k times, and the lengths of time that these represent, shape (k,).
    """
    square = float(weights @ values**2) * float(weights.sum())
    return float(weights @ np.abs(values)) ** 2 / square if square else 1.0


def midpoints_added(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns of steps with another row in the middle of each step, from smooth curves.

    Columns that are not finite everywhere, and the number of the cycle, have the values of the next
    step in these rows.
    """
    times = columns["time_s"]
    finer = np.interp(np.arange(2 * len(times) - 1) / 2, np.arange(len(times)), times)
    following = np.searchsorted(times, finer)
    smooth = {
        name: values
        for name, values in columns.items()
        if name not in (CYCLE, CLOCK) and np.isfinite(values).all()
    }
    curves = smooth_curve(times, np.column_stack([*smooth.values()]))(finer)
    rows = {name: values[following] for name, values in columns.items()}
    rows |= dict(zip(smooth, curves.T, strict=True))
    if CLOCK in columns:
        rows[CLOCK] = rows[CLOCK] - (times[following] - finer)
    return rows


def distance(name: str, figures: Mapping[str, float], others: Mapping[str, float]) -> float:
    """Distance of the figure `name` in `figures` from that in `others`; nan if it is not in both.

    For the amplitude or phase of an orbit's part, it is the mean of its own distance and that in
    the complex plane, see the module.
    """
    difference = abs(others.get(name, np.nan) - figures[name])
    if name.endswith("_deg"):
        difference = abs((difference + 180.0) % 360.0 - 180.0)
    amplitude = name.replace("_phase_deg", "_amplitude_m")
    if not name.startswith("orbit_") or amplitude not in others:
        return difference
    apart = abs(_complex(others, amplitude) - _complex(figures, amplitude))
    if name != amplitude:
        size = figures[amplitude]
        apart = min(np.degrees(apart / size), 180.0) if size else 180.0
    return 0.5 * (difference + apart)


def _complex(figures: Mapping[str, float], amplitude: str) -> complex:
    """Part of an orbit as a complex number, by the name of its `amplitude` [m]."""
    phase = figures[amplitude.replace("_amplitude_m", "_phase_deg")]
    return complex(figures[amplitude] * np.exp(1j * np.radians(phase)))


@dataclass(frozen=True, eq=False)
class FigureErrors:
    """Errors of the figures of a joint.

    Attributes
    ----------
    summary, binding
        Summary of the run, and film of the joint.
    columns
        Names of the q columns that have error curves.
    times
        Times of the curves, shape (k,) [s].
    steps
        Indices of the steps of the current cycle, or of the run, in `times`, shape (s,).
    reported, changes
        Curves of the run, and of its errors by component, of all columns, shape (q, k) each.
    remaining
        Distance from the periodic state, over that between the starts of the last two cycles; None
        if it is not known.
    """

    summary: RunSummary
    binding: FilmBinding
    columns: tuple[str, ...]
    times: np.ndarray
    steps: np.ndarray
    reported: np.ndarray
    changes: Mapping[str, np.ndarray]
    remaining: float | None

    @cached_property
    def figures(self) -> dict[str, float]:
        """Figures of the joint in the run."""
        return self._figures(self.summary)

    def _figures(self, summary: RunSummary) -> dict[str, float]:
        cycle = summary.last_cycle
        assert cycle is not None
        return dict(numbers(summary.figures(self.binding, cycle)))

    @cached_property
    def errors(self) -> dict[str, float | str]:
        """Absolute error of every figure in its unit, or the reason why it has none."""
        errors: dict[str, float | str] = {name: reason_of(name) for name in self.figures}
        if not self.changes:
            return errors
        names = [name for name, reason in errors.items() if reason == NOT_ESTIMATED]
        each = [self._by_change(change, names) for change in self.changes.values()]
        each += [self._by_start(names), self._by_quadrature(names)]
        totals = {name: sum(component[name] for component in each) for name in names}
        heat = self.binding.joint.heat
        if heat is not None and "outlet_temperature_C" in totals:
            # The effective temperature follows from that of the outlet, up to its tolerance.
            totals["effective_temperature_C"] = (
                heat.outlet_weight * totals["outlet_temperature_C"] + heat.tolerance
            )
        return errors | {name: total for name, total in totals.items() if np.isfinite(total)}

    def _by_change(self, change: np.ndarray, names: list[str]) -> dict[str, float]:
        """Errors of the figures in `names` by one component with the error curves `change`."""
        changed = self._figures(self._changed(change))
        errors = {}
        for name in names:
            errors[name] = self._distance(name, changed)
            column = extreme_column(name, self.columns)
            if column is not None:
                row = self.columns.index(column)
                sign = -1.0 if name.removeprefix("cycle_").startswith("min_") else 1.0
                near = near_extreme(sign * self.reported[row], change[row])
                errors[name] = 0.5 * (errors[name] + near)
            column = mean_column(name, self.columns)
            if column is not None:
                row = self.columns.index(column)
                errors[name] = self._mean_error(name, row, change[row], errors[name])
        return errors

    def _mean_error(self, name: str, row: int, change: np.ndarray, error: float) -> float:
        """Error of a mean by one component, with errors that cancel by coincidence.

        Parameters
        ----------
        name, row
            Figure that is the mean, and row of its column.
        change, error
            Error curve of the column, shape (k,), and change of the mean by it.
        """
        cycle = self.summary.last_cycle
        assert cycle is not None
        weights = np.gradient(self.times)
        if name.startswith("cycle_"):
            weights = np.where(self.times >= cycle.start, weights, 0.0)
        absolute = float(weights @ np.abs(change) / weights.sum())
        part = acting_part(self.reported[row], weights)
        counted = max(0.5 * (1.0 - part), 1.0 - 2.0 * part)
        return error + counted * max(absolute - error, 0.0)

    def _changed(self, change: np.ndarray) -> RunSummary:
        """Summary of the run with error curves added to the columns of the joint."""
        columns = dict(self.summary.columns)
        first = self.summary.first
        for name, curve in zip(self.columns, change, strict=True):
            path = f"joints/{self.binding.name}/{name}"
            if path in columns:
                values = columns[path].copy()
                at_steps = curve[self.steps]
                values[first:] += at_steps
                if first:  # the start of the cycle is the end of the cycle before
                    values[first - 1] += at_steps[-1]
                columns[path] = values
        return self.summary.with_columns(columns)

    def _by_start(self, names: list[str]) -> dict[str, float]:
        """Errors of the figures in `names` due to a cycle that is not yet periodic."""
        former = self.summary.former
        if former is None or not self.remaining:
            return dict.fromkeys(names, 0.0)
        before = self._figures(former)
        return {name: self.remaining * self._distance(name, before) for name in names}

    def _by_quadrature(self, names: list[str]) -> dict[str, float]:
        """Errors of the figures in `names` because columns are known at the steps only.

        They are the changes of the figures if every column has values in the middle of each step,
        too, by smooth curves. Extremes are interpolated between steps, and have no such error.
        """
        start = max(self.summary.first - 1, 0)
        columns = {name: values[start:] for name, values in self.summary.columns.items()}
        if len(columns["time_s"]) < 2:
            return dict.fromkeys(names, 0.0)
        finer = self._figures(self.summary.with_columns(midpoints_added(columns)))
        return {
            name: 0.0 if extreme_column(name, self.columns) else self._distance(name, finer)
            for name in names
        }

    def _distance(self, name: str, others: Mapping[str, float]) -> float:
        """Distance of a figure of the run from the same figure in `others`; nan if unknown."""
        return distance(name, self.figures, others)
