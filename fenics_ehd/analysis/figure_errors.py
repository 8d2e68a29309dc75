"""Errors of all figures of a run, from curves of the errors of its columns.

A figure is computed from columns of the run: it is an extreme, a mean over the cycle, a value at an
instant, or a combination of these. Every component of the error budget has curves of errors (exact
minus computed) of all columns. The figure is computed again from the columns plus these curves, by
the same summary (`RunSummary.figures`), and the change of the figure is its error by the component.

The error of an extreme is the mean of this change and of the root mean square of the error curve
near the extreme, as for peak pressures. The mean of a quantity that acts over a small part of the
cycle, such as the force of asperities, is similar: a cancellation within a short event is a
coincidence. With the change d of the mean, the mean a of the absolute value of the error curve, and
the part p of the cycle over which the quantity acts, the error of a mean is

    |d| + (1 - p) (a - |d|) / 2.

The total is the sum of all components.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fenics_ehd.analysis.error_curves import near_extreme
from fenics_ehd.multibody.figures import numbers, reason_of
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.summary import RunSummary
from fenics_ehd.multibody.trust import NOT_ESTIMATED

#: Assumed order of the error of a mean over steps, for columns whose slopes jump.
QUADRATURE_ORDER = 2


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
                errors[name] += self._cancelled(name, row, change[row], errors[name])
        return errors

    def _cancelled(self, name: str, row: int, change: np.ndarray, error: float) -> float:
        """Part of an error curve that cancels in a mean, and counts as its error.

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
        return 0.5 * (1.0 - part) * max(absolute - error, 0.0)

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

        They are estimated from the change of a figure if every other step is left out. Extremes are
        interpolated between steps, and have no such error.
        """
        start = max(self.summary.first - 1, 0)
        last = len(self.summary.columns["time_s"]) - 1
        rows = np.unique(np.append(start, np.arange(last, start, -2)))
        columns = {name: values[rows] for name, values in self.summary.columns.items()}
        coarse = self._figures(self.summary.with_columns(columns))
        return {
            name: 0.0
            if extreme_column(name, self.columns)
            else self._distance(name, coarse) / (2.0**QUADRATURE_ORDER - 1.0)
            for name in names
        }

    def _distance(self, name: str, others: Mapping[str, float]) -> float:
        """Distance of a figure of the run from the same figure in `others`; nan if unknown."""
        difference = abs(others.get(name, np.nan) - self.figures[name])
        return abs((difference + 180.0) % 360.0 - 180.0) if name.endswith("_deg") else difference
