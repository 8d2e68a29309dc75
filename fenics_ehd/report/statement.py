"""A statement of the paper, the rule by which it holds, and what a study's runs say of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from fenics_ehd.report.curves import REFERENCE_RUN, History, error_curve
from fenics_ehd.report.study_data import PRESSURE, QUANTITIES, Quantity, Study, StudyRun
from fenics_ehd.report.style import family

T = TypeVar("T")

HOLDS, FAILS, PARTLY, OPEN, NOT_RUN = (
    "holds",
    "does not hold",
    "holds in part",
    "undecided",
    "not run",
)

#: A curve is followed well when its largest error is at most this.
WELL = 0.05

#: Loads are high where the reference's peak pressure exceeds this share of its largest.
HIGH_LOAD = 0.75

#: Numbers of coordinates this close count as equal.
EQUAL_COORDINATES = 0.1


class MissingRunsError(LookupError):
    """The study does not hold, or not yet, what a statement is judged by."""


@dataclass(frozen=True)
class Finding:
    """What was measured, in words, and the verdict."""

    measured: str
    verdict: str


@dataclass(frozen=True)
class Statement:
    """One statement.

    Attributes
    ----------
    place
        Section or figure of the paper.
    says
        What it says, in our words.
    rule
        When we call it true.
    scene
        Whose study can tell.
    check
        Measures and judges; raises `MissingRunsError`.
    """

    place: str
    says: str
    rule: str
    scene: str
    check: Callable[[Study], Finding]

    def judge(self, study: Study) -> Finding:
        """Finding of this study's runs."""
        if study.scene != self.scene:
            return Finding(f"told by fenics-ehd study {self.scene}", NOT_RUN)
        try:
            return self.check(study)
        except MissingRunsError as error:
            return Finding(f"needs {error}", NOT_RUN)


def need(found: Sequence[T], what: str) -> list[T]:
    """What was found.

    Raises
    ------
    MissingRunsError
        Nothing was.
    """
    if not found:
        raise MissingRunsError(what)
    return list(found)


def runs_of(study: Study, what: str, **wanted: Any) -> list[StudyRun]:
    """Runs of the comparison of methods with these values, by coordinates, at least one."""
    return need(study.pick(**wanted), what)


def near(runs: Iterable[StudyRun], coordinates: float) -> list[StudyRun]:
    """Runs with about this many coordinates, the nearest first."""
    distance = {run: abs(run.coordinates / coordinates - 1) for run in runs}
    close = [run for run, value in distance.items() if value <= EQUAL_COORDINATES]
    return sorted(close, key=lambda run: (distance[run], run.run))


def reference_history(study: Study) -> History:
    """History of the reference, or `MissingRunsError`."""
    history = study.history(REFERENCE_RUN)
    if history is None:
        raise MissingRunsError("the reference")
    return history


def history_of(study: Study, run: StudyRun) -> History:
    """History of a run, or `MissingRunsError`."""
    history = study.history(run.run)
    if history is None:
        raise MissingRunsError(f"the history of {run.run}")
    return history


def high_load_excess(study: Study, run: StudyRun) -> float:
    """Mean error of the peak pressure where loads are high, of the largest pressure; + is above.

    Weighted by time. A part that is too stiff gives too high a pressure.
    """
    reference, history = reference_history(study), history_of(study, run)
    column, time = PRESSURE.column, history["time_s"]
    truth = np.interp(time, reference["time_s"], reference[column])
    high = truth >= HIGH_LOAD * reference[column].max()
    weights = np.gradient(time)[high]
    error = error_curve(history, reference, PRESSURE)[high]
    return float(weights @ error / weights.sum())


def percent(value: float) -> str:
    """A share with two digits that mean something."""
    if not math.isfinite(value):
        return "?"
    return f"{100 * value:.0f} %" if abs(value) >= 0.995 else f"{100 * value:.2g} %"


def errors(run: StudyRun) -> str:
    """Largest errors of both curves, pressure first; none below the reference's own."""
    return " / ".join(bounded(run, quantity) for quantity in QUANTITIES)


def bounded(run: StudyRun, quantity: Quantity, norm: str = "max") -> str:
    """One error; where the reference's own is larger, that one as an upper limit."""
    value, floor = run.error(quantity, norm), run.floor(quantity, norm)
    return f"≤ {percent(floor)}" if value < floor else percent(value)


def told(run: StudyRun) -> str:
    """A run with its size and errors."""
    return f"{family(run)}, {run.coordinates:.0f}: {errors(run)}"


def listed(runs: Iterable[StudyRun]) -> str:
    """Several runs of one family: sizes and errors."""
    return ", ".join(f"{run.coordinates:.0f} coordinates {errors(run)}" for run in runs)


def verdict(truths: Iterable[bool]) -> str:
    """Whether all, some or none of several cases are as stated."""
    values = list(truths)
    return HOLDS if all(values) else PARTLY if any(values) else FAILS
