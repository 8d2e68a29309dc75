"""Derivatives of all steps of a run, or of a cycle that repeats itself, along numbers.

Through the formula of every step, whose times are held, the derivatives of its past give those of
its end. A run begins with those of its initial state. A cycle ends as it began: the map from the
derivatives at its start to those at its end is affine, and is gone through until they repeat,
from the combination of former ends for which the same combination of changes is least, as
`periodic` does it for the cycle itself. Points before the start are those of the end, a
period later, where need be between its steps by a cubic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fenics_ehd.base.errors import PeriodicityError
from fenics_ehd.multibody.cycle_record import REACH, CycleRecord, RecordedStep
from fenics_ehd.multibody.differentiation import extrapolation_weights
from fenics_ehd.multibody.periodic import NOISE, REMEMBERED
from fenics_ehd.multibody.perturbed import Columns, Perturbed, StepView
from fenics_ehd.multibody.step_derivative import TOLERANCE, Direction, StepDerivatives

#: Largest change over a cycle, over the largest derivative in it; and cycles at most.
PERIODICITY, MOST_SWEEPS = 2e-4, 30

#: Share of a direction that a state is moved by to see what it means.
SMALL = 1e-6

#: Columns of a history over the steps, by joint and name.
Curves = dict[str, dict[str, np.ndarray]]


@dataclass(frozen=True, eq=False)
class _Points:
    """Derivatives at the points before a step, newest first: times, x and rates by row."""

    times: np.ndarray
    x: np.ndarray
    rate: np.ndarray

    def after(self, time: float, found: Direction) -> _Points:
        """With one more point."""
        return _Points(
            np.concatenate([[time], self.times])[:REACH],
            np.concatenate([found.x[None], self.x])[:REACH],
            np.concatenate([found.rate[None], self.rate])[:REACH],
        )

    def combined(self, others: Sequence[_Points], shares: np.ndarray) -> _Points:
        """Less so much of some others."""
        x, rate = self.x, self.rate
        for other, share in zip(others, shares, strict=True):
            x, rate = x - share * other.x, rate - share * other.rate
        return _Points(self.times, x, rate)

    def less(self, other: _Points) -> _Points:
        """Difference."""
        return _Points(self.times, self.x - other.x, self.rate - other.rate)


class _Measure:
    """What derivatives of a state mean: relative changes of gaps and of oil, and of coordinates.

    Parameters
    ----------
    view, x
        Of which mechanism, and where.
    """

    def __init__(self, view: StepView, x: np.ndarray):
        self._view, self._x = view, x
        self._observed = view.norm.observe(x)
        self._contents = view.contents(x)

    def changes(self, direction: np.ndarray) -> np.ndarray:
        """All of them; of oil that is accounted for as heavy as all gaps of a film together."""
        norm, observed = self._view.norm, self._view.observed(direction)
        gaps = norm.gaps(self._observed)
        observed[: len(gaps)] /= norm.lengths(gaps)
        return np.concatenate([observed, np.sqrt(len(gaps)) * self._oil(direction)])

    def size(self, direction: np.ndarray) -> float:
        """Largest of them in the norm of the steps."""
        change = SMALL * self._view.observed(direction)
        oil = float(np.abs(self._oil(direction)).max(initial=0.0))
        return max(self._view.norm.error_norm(self._observed, change) / SMALL, oil)

    def _oil(self, direction: np.ndarray) -> np.ndarray:
        if not len(self._contents):
            return self._contents
        return (self._view.contents(self._x + SMALL * direction) - self._contents) / SMALL


class _Number:
    """One number on its way to derivatives that repeat themselves."""

    def __init__(self, perturbed: Perturbed, record: CycleRecord):
        self.perturbed = perturbed
        x, rate = perturbed.start(record.start)
        ahead = record.before[:, None] - record.before[0]
        self.points = _Points(record.before, x + ahead * rate, np.tile(rate, (len(ahead), 1)))
        self._ends: list[_Points] = []
        self._changes: list[np.ndarray] = []
        self.settled, self.largest = False, 0.0
        self.columns: list[Columns] = []
        self._states: list[np.ndarray] = []
        self.begin()

    def begin(self) -> None:
        """Begin a sweep."""
        self.now, self._former = self.points, (self.largest, self._states, self.columns)
        self.largest, self._states, self.columns = 0.0, [], []
        self._last: list[tuple[float, Direction]] = []

    def add(
        self, step: RecordedStep, measure: _Measure, derivatives: StepDerivatives, number: int
    ) -> None:
        """One step of a sweep, and what derivatives mean at its end."""
        past = step.weights[1:]
        own = past @ self.now.x[: len(past)], past @ self.now.rate[: len(past)]
        guess = self._last[-1][1].unknowns if self._last else None
        found = derivatives.along(number, self.perturbed, own, guess)
        self.now = self.now.after(step.time, found)
        self._last = [*self._last, (step.time, found)][-2 * REACH :]
        self.columns.append(found.columns)
        self._states.append(found.x)
        self.largest = max(self.largest, measure.size(found.x))
        self._measure = measure

    @property
    def repeats(self) -> bool:
        """Whether the last step is as it was in the sweep before, columns and all."""
        largest, states, columns = self._former
        k = len(self._states) - 1
        if not states or not columns[k]:
            return False
        return self._measure.size(self._states[k] - states[k]) <= PERIODICITY * largest

    def keep(self) -> None:
        """Take the steps that are left as they were in the sweep before."""
        self.columns += self._former[2][len(self.columns) :]
        self.largest = max(self.largest, self._former[0])

    def end(self, record: CycleRecord) -> float:
        """Take the end of a cycle for the start of the next one; change over the largest."""
        assert record.period is not None
        ends = _Points(record.before, *self._at(record.before + record.period))
        change = ends.x[0] - self.points.x[0]
        defect = self._measure.size(change)
        self.settled = defect <= PERIODICITY * self.largest + TOLERANCE
        self._ends = [*self._ends, ends][-REMEMBERED:]
        self._changes = [*self._changes, self._measure.changes(change)][-REMEMBERED:]
        if not self.settled and len(self._ends) > 1:
            changes = np.diff(self._changes, axis=0)
            sizes = np.linalg.norm(changes, axis=1)
            shares = np.linalg.lstsq(changes.T / sizes, self._changes[-1], rcond=NOISE)[0] / sizes
            apart = [b.less(a) for a, b in zip(self._ends, self._ends[1:], strict=False)]
            ends = ends.combined(apart, shares)
        self.points = ends
        return defect / (self.largest + TOLERANCE)

    def _at(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives at times between the last steps."""
        times, x, rate = np.array([time for time, _ in self._last]), [], []
        for time in wanted:
            near = np.sort(np.argsort(np.abs(times - time))[:4])
            weights = extrapolation_weights(times[near], time)
            x.append(weights @ np.array([self._last[i][1].x for i in near]))
            rate.append(weights @ np.array([self._last[i][1].rate for i in near]))
        return np.array(x), np.array(rate)


class CycleDerivatives:
    """Derivatives of the steps of a record along numbers.

    Parameters
    ----------
    record
        Of a run that has ended.
    perturbed
        Its mechanism with one number changed each.

    Attributes
    ----------
    sweeps
        Times that the steps were gone through.
    largest
        For every number, of all relative changes of gaps, over its own relative change.
    """

    def __init__(self, record: CycleRecord, perturbed: Sequence[Perturbed]):
        self._record = record
        self._view = StepView(record.run.equations, record.run.norm)
        self._steps = StepDerivatives(self._view)
        self._numbers = [_Number(own, record) for own in perturbed]
        self.sweeps, self._repeated = 0, False
        self._values: list[Columns] = []

    def solve(self) -> tuple[Curves, list[Curves]]:
        """Columns of the history at the steps, and their derivatives along every number.

        Raises
        ------
        PeriodicityError
            Derivatives do not repeat: with the number the cycle would not either.
        SolverError
            From `StepDerivatives.along`.
        """
        periodic = self._record.period is not None
        if not periodic:
            return self._sweep(columns=True)
        worst = np.inf
        while self.sweeps < MOST_SWEEPS:
            columns = self._sweep(columns=self.sweeps > 0)
            if self._repeated:
                return columns
            worst = max(number.end(self._record) for number in self._numbers)
            if all(number.settled for number in self._numbers) and self.sweeps > 1:
                return columns
        raise PeriodicityError(
            f"derivatives still change by {worst:.2e} of their size from cycle to cycle after "
            f"{self.sweeps} of them: forces and drives must repeat with the period whatever the "
            "number is"
        )

    @property
    def largest(self) -> list[float]:
        """See there."""
        return [number.largest for number in self._numbers]

    def _sweep(self, *, columns: bool) -> tuple[Curves, list[Curves]]:
        """Go through all steps once."""
        for number in self._numbers:
            number.begin()
        values: list[Columns] = []
        same = 0
        for step in self._record.steps:
            self._steps.begin(step, columns=columns)
            values.append(self._steps.columns)
            measure = _Measure(self._view, step.x)
            for i, number in enumerate(self._numbers):
                number.add(step, measure, self._steps, i)
            same = same + 1 if all(number.repeats for number in self._numbers) else 0
            if same > REACH:
                for number in self._numbers:
                    number.keep()
                self._repeated = True
                break
        self.sweeps += 1
        self._values = [*values, *self._values[len(values) :]]
        return _stacked(self._values), [_stacked(number.columns) for number in self._numbers]


def _stacked(rows: Sequence[Columns]) -> Curves:
    """Columns over the steps."""
    return {
        joint: {name: np.array([row[joint][name] for row in rows]) for name in names}
        for joint, names in rows[0].items()
    }


def curves_of(record: CycleRecord) -> Curves:
    """Columns of the history at the steps of a record."""
    equations, rows = record.run.equations, []
    view = StepView(equations, record.run.norm)
    for step in record.steps:
        asked, own = step.equations_of(equations), step.unknowns(equations)
        equations.begin(asked)
        point = equations.evaluate(own.films, own.rest, own.voids)
        rows.append(view.columns(asked, point, view.held(point)))
    return _stacked(rows)
