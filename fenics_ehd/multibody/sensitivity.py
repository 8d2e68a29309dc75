"""Derivatives of what a run, or its periodic cycle, answers along numbers of the mechanism.

Extremes and means of a joint's columns (`cycle_figures`), by forward sensitivity through the steps
that the run took (`cycle_derivative`): a fraction of the run's own time for each number. Where
the heat of films is balanced over the cycle, their temperatures are further numbers T, and with the
balances F(T, p) = 0

    dq/dp = q_p + q_T dT/dp,    F_T dT/dp = -F_p.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fenics_ehd.base.columns import split_unit
from fenics_ehd.base.errors import SensitivityError
from fenics_ehd.multibody.cycle_derivative import Curves, CycleDerivatives
from fenics_ehd.multibody.cycle_figures import extreme_weights, mean_weights
from fenics_ehd.multibody.cycle_record import CycleRecord
from fenics_ehd.multibody.heat_derivative import Balances
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.periodic import Cycles, repeats
from fenics_ehd.multibody.perturbed import Perturbed
from fenics_ehd.multibody.run import Run

#: Change of a number, over its scale: round-off of the equations over it, and it times their
#: second derivatives, leave 1e-5 of a derivative.
AMOUNT = 3e-6

#: Change of a gap, relative, up to which derivatives are taken to say what a number does.
CLOSE = 0.1

#: Change of a count of periods in a cycle that is round-off.
SAME = 1e-9

#: What a figure is called by, and its sign in `extreme_weights`; a mean has none.
KINDS = {"max": 1, "min": -1, "mean": 0}


@dataclass(frozen=True, eq=False)
class Number:
    """A number that a mechanism is made with.

    Attributes
    ----------
    name
        For messages.
    value, scale
        The number, and what a small change of it is a share of; they have its unit.
    mechanism
        With ``value + AMOUNT * scale``, all else as it was.
    span
        Time to simulate, or period, of that mechanism over that of the other.
    """

    name: str
    value: float
    scale: float
    mechanism: Mechanism
    span: float = 1.0


@dataclass(frozen=True)
class Figure:
    """An extreme or a mean of a column of one joint.

    Attributes
    ----------
    joint, kind, column
        Kind: ``"max"``, ``"min"`` or ``"mean"``; column with its unit, as in a history.
    """

    joint: str
    kind: str
    column: str

    @property
    def name(self) -> str:
        """As in a summary: ``min_film_thickness_m``, ``mean_friction_power_W``."""
        extreme = self.column.startswith(("max_", "min_"))
        return self.column if extreme else f"{self.kind}_{self.column}"

    def value(self, record: CycleRecord, curves: Curves) -> float:
        """Of a record with its curves."""
        return float(self.weights(record, curves) @ curves[self.joint][self.column])

    def weights(self, record: CycleRecord, curves: Curves) -> np.ndarray:
        """Weights of the steps of a record in it, shape (steps,)."""
        if self.kind == "mean":
            return mean_weights(record.times, record.period)
        values = curves[self.joint][self.column]
        return extreme_weights(record.times, values, record.period, KINDS[self.kind])[0]


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Values of figures and their derivatives.

    Attributes
    ----------
    values
        By figure, of parabolas through the steps where they are extremes.
    derivatives
        By figure, then by the number's name, in the units of both.
    """

    values: Mapping[Figure, float]
    derivatives: Mapping[Figure, Mapping[str, float]]


def recorded(run: Run, span: float, cycles: Cycles | None = None) -> CycleRecord:
    """A run to its end [s], or through a periodic search, and the record of it."""
    record = CycleRecord(run, cycles)
    for _ in record.follow(run.until(span) if cycles is None else cycles):
        pass
    return record


def check_periods(mechanism: Mechanism, period: float | None, numbers: Sequence[Number]) -> None:
    """Refuse numbers along which there is no periodic solution.

    Parameters
    ----------
    mechanism, period
        Of the run [s]; None: it is not periodic.
    numbers
        To differentiate along.

    Raises
    ------
    SensitivityError
        Naming what keeps its own period where the cycle's changes, or the other way round.
    """
    if period is None:
        return
    was = repeats(mechanism, period)
    for number in numbers:
        would = repeats(number.mechanism, number.span * period)
        off = [key for key in was if abs(would[key] - was[key]) > SAME * max(1.0, was[key])]
        if off:
            raise SensitivityError(
                f"{number.name}: along it alone {', '.join(off)} would not repeat with the cycle "
                "any more, and no derivative exists: ask along a number that leaves all periods "
                "as they are, or run the scene with both changed together"
            )


class Derivatives:
    """Curves of a record and their derivatives along numbers.

    Parameters
    ----------
    record
        Of a run that has ended.
    numbers
        What to differentiate along.

    Attributes
    ----------
    curves
        Columns of the history at the steps, by joint and name.
    sweeps
        Times that the steps were gone through for that.
    reach
        By number: share of its scale that changes a gap somewhere by `CLOSE`.
    refused
        Names of numbers that change how many unknowns there are: none through the steps.

    Raises
    ------
    SensitivityError
        See `check_periods`.
    PeriodicityError, SolverError
        From `CycleDerivatives`.
    """

    def __init__(self, record: CycleRecord, numbers: Sequence[Number]):
        equations = record.run.equations
        check_periods(equations.system.mechanism, record.period, numbers)
        balances = Balances(equations.system, AMOUNT) if equations.system.heated else None
        temperatures = {} if balances is None else balances.temperatures
        self.refused, perturbed = [], []
        for number in numbers:
            try:
                perturbed.append(
                    Perturbed(number.mechanism, AMOUNT, number.span, equations, temperatures)
                )
            except SensitivityError:
                self.refused.append(number.name)
        numbers = [number for number in numbers if number.name not in self.refused]
        if balances is not None:
            mechanism = equations.system.mechanism
            perturbed += [
                Perturbed(mechanism, AMOUNT, 1.0, equations, warmer) for warmer in balances.warmer
            ]
        solver = CycleDerivatives(record, perturbed)
        self.curves, along = solver.solve()
        self.sweeps, self._record, self._numbers = solver.sweeps, record, numbers
        if balances is not None:
            means = mean_weights(record.times, record.period)
            systems = [own.equations.system for own in perturbed[: len(numbers)]]
            along = balances.total(systems, self.curves, along, means)
        self.reach = {
            number.name: CLOSE / max(largest, CLOSE)
            for number, largest in zip(numbers, solver.largest, strict=False)
        }
        self.along = {number.name: own for number, own in zip(numbers, along, strict=True)}

    def of(self, figures: Sequence[Figure]) -> Sensitivity:
        """Values and derivatives of figures."""
        values, derivatives = {}, {}
        for figure in figures:
            weights = figure.weights(self._record, self.curves)
            values[figure] = float(weights @ self.curves[figure.joint][figure.column])
            derivatives[figure] = {
                number.name: float(
                    weights @ self.along[number.name][figure.joint][figure.column] / number.scale
                )
                for number in self._numbers
            }
        return Sensitivity(values, derivatives)


def figure_of(name: str, curves: Curves) -> Figure:
    """The figure of a name, ``big_end.min_film_thickness``.

    Its unit may stand behind, and the joint be left out where there is one.

    Raises
    ------
    SensitivityError
        There is none of that name.
    """
    known = {
        f"{figure.joint}.{figure.name}": figure
        for joint, columns in curves.items()
        for column in columns
        for figure in _figures(joint, column)
    }
    alone = len(curves) == 1 and name.partition(".")[0] not in curves
    full = f"{next(iter(curves))}.{name}" if alone else name
    found = [key for key in known if full in (key, split_unit(key)[0])]
    if len(found) == 1:
        return known[found[0]]
    if not known:
        raise SensitivityError(f"unknown quantity {name}: no joint is lubricated")
    short = sorted(split_unit(key)[0] for key in known)
    if alone:
        short = [key.partition(".")[2] for key in short]
    close = difflib.get_close_matches(name, short, n=1)
    hint = f"did you mean {close[0]}?" if close else f"known: {', '.join(short)}"
    raise SensitivityError(f"unknown quantity {name}: {hint}")


def _figures(joint: str, column: str) -> list[Figure]:
    if column.endswith("_deg"):  # a place, and it goes around
        return []
    kind = column.partition("_")[0]
    if kind in KINDS:
        return [Figure(joint, kind, column)]
    return [Figure(joint, kind, column) for kind in KINDS]
