"""A statement of the paper, the rule by which it holds, and what a study's runs say of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from fenics_ehd.report.curves import error_curve
from fenics_ehd.report.needed import MissingRunsError, history_of, reference_history
from fenics_ehd.report.study_data import (
    NOT_ENDED,
    PRESSURE,
    QUANTITIES,
    Quantity,
    Study,
    StudyRun,
)
from fenics_ehd.report.style import family

HOLDS, FAILS, PARTLY, OPEN, NOT_RUN = (
    "holds",
    "does not hold",
    "holds in part",
    "undecided",
    NOT_ENDED,
)

#: A curve is followed well when its largest error is at most this.
WELL = 0.05

#: Loads are high where the reference's peak pressure exceeds this share of its largest.
HIGH_LOAD = 0.75


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
    words = percent(run.visible_error(quantity, norm))
    return f"≤ {words}" if run.bounded(quantity, norm) else words


def told(run: StudyRun) -> str:
    """A run with its size and errors."""
    return f"{family(run)}, {run.coordinates:.0f}: {errors(run)}"


def listed(runs: Iterable[StudyRun]) -> str:
    """Several runs of one family: sizes and errors."""
    return ", ".join(f"{run.coordinates:.0f} coordinates {errors(run)}" for run in runs)


def verdict(truths: Iterable[bool | None]) -> str:
    """Whether all, some or none of several cases are as stated; None: that cannot be told."""
    values = list(truths)
    if all(values):
        return HOLDS
    if any(values):
        return PARTLY
    return OPEN if None in values else FAILS


def clearly(truth: bool, difference: float, error: float) -> bool | None:
    """A comparison, unless the difference is no larger than the error of what is compared."""
    return truth if abs(difference) > error else None
