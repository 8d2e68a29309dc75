"""Statements of the paper by Krinner and Rixen: rules, verdicts, and comparisons of runs.

A statement has a rule, by which it is judged from the runs of a study. There is no verdict before
all planned runs that the rule needs have ended. A run whose steps or film broke down is a result:
it is not better than any other run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from fenics_ehd.base.errors import (
    CavitationError,
    FilmTooThinError,
    GapClosedError,
    StepSizeError,
)
from fenics_ehd.multibody.history import History
from fenics_ehd.study.paper import HOUSING_M3, ROD_M3, ROTOR, SLIDER_CRANK
from fenics_ehd.study.plan import REFERENCE
from fenics_ehd.study.report.figures import family
from fenics_ehd.study.report.study_data import (
    CURVES,
    FILM,
    PRESSURE,
    Curve,
    JointData,
    StudyRow,
)
from fenics_ehd.study.report.write import bounded

T = TypeVar("T")

#: Verdicts on a statement.
HOLDS = "holds"
FAILS = "does not hold"
PARTLY = "holds in part"
OPEN = "undecided"
NOT_RUN = "not run"

#: Verdicts with their meanings.
MEANINGS = {
    HOLDS: "the rule is met",
    FAILS: "the rule is not met",
    PARTLY: "some cases meet the rule; the others do not meet it, or cannot be judged",
    OPEN: "the measured values are only limits, or differ by less than their own errors",
    NOT_RUN: "a run that the rule needs is missing or failed",
}

#: Beginnings of the status of a run that failed because of its model: steps or film broke down.
BREAKDOWNS = tuple(
    f"failed: {kind.__name__}"
    for kind in (StepSizeError, GapClosedError, FilmTooThinError, CavitationError)
)

#: Pressure set and selection of the paper's M3, by scene.
PAPER_M3 = {
    scene: dict(zip(("pressure_set", "selection"), names, strict=True))
    for scene, names in ((SLIDER_CRANK, ROD_M3), (ROTOR, HOUSING_M3))
}

#: Largest error of a curve that is followed well, relative.
WELL = 0.05

#: Peak pressure of the reference above which the load is high, over its largest peak pressure.
HIGH_LOAD = 0.75

#: Relative difference up to which two numbers of coordinates count as equal.
EQUAL_COORDINATES = 0.1

#: Largest number of coordinates that a basis has in addition to the requested modes.
RIGID_MOTION = 6

#: Largest number of missing runs that a message names.
NAMED = 3


class MissingRunsError(LookupError):
    """Runs that the rule of a statement needs are missing; the message names them."""


@dataclass(frozen=True)
class Finding:
    """Result of judging a statement.

    Attributes
    ----------
    measured
        Text with the measured values.
    verdict
        Verdict, one of `MEANINGS`.
    """

    measured: str
    verdict: str


@dataclass(frozen=True)
class Statement:
    """Statement of the paper.

    Attributes
    ----------
    section
        Section or equations of the paper, and the figure if there is one, ``4.2, fig. 5``.
    text
        The statement in our words.
    rule
        Condition under which the statement holds.
    check
        Function that measures and judges the runs of a joint; it raises `MissingRunsError` if runs
        are missing.
    """

    section: str
    text: str
    rule: str
    check: Callable[[JointData], Finding]

    @property
    def figure(self) -> int | None:
        """Number of the figure to which the statement refers; None without a figure."""
        number = self.section.partition("fig. ")[2]
        return int(number) if number else None

    def judge(self, joint: JointData) -> Finding:
        """Judge the statement by the runs of a joint."""
        try:
            return self.check(joint)
        except MissingRunsError as error:
            return Finding(f"needs {error}", NOT_RUN)


def verdict(truths: Iterable[bool | None]) -> str:
    """Verdict on several cases: True, False, or None for a case that cannot be decided."""
    values = list(truths)
    if all(values):
        return HOLDS
    if any(values):
        return PARTLY
    return OPEN if None in values else FAILS


def clearly(truth: bool, difference: float, error: float) -> bool | None:
    """Result `truth` of a comparison; None if the difference does not exceed its error."""
    return truth if abs(difference) > error else None


def smaller(one: StudyRow, two: StudyRow, quantity: Curve) -> bool | None:
    """True if run `one` has a smaller error than run `two`; None if the reference cannot tell.

    The difference must exceed the reference's own error.
    """
    difference = two.visible_error(quantity) - one.visible_error(quantity)
    return clearly(difference > 0, difference, max(one.floor(quantity), two.floor(quantity)))


def errors(row: StudyRow) -> str:
    """Text with the largest errors of both curves, peak pressure first."""
    return " / ".join(bounded(row, quantity) for quantity in CURVES)


def description(row: StudyRow) -> str:
    """Text with the family of a run, its number of coordinates, and its errors."""
    return f"{family(row)}, {row['coordinates']:.0f}: {errors(row)}"


def listed(rows: Iterable[StudyRow]) -> str:
    """Text with the numbers of coordinates and the errors of several runs."""
    return ", ".join(f"{row['coordinates']:.0f} coordinates {errors(row)}" for row in rows)


def broke_down(row: StudyRow) -> bool:
    """True if steps or film of a run broke down; False for other failures, such as a full disk."""
    return bool(row["status"].startswith(BREAKDOWNS))


def paper_m3(joint: JointData) -> dict[str, str]:
    """Values of the columns that all runs of the paper's M3 have in common, by column."""
    return {"method": "m3", **PAPER_M3[joint.study.info["scene"]]}


def need(items: Sequence[T], description: str) -> list[T]:
    """Return items, usually runs, as a list; refuse an empty one.

    Raises
    ------
    MissingRunsError
        There are no items; the message is their description.
    """
    if not items:
        raise MissingRunsError(description)
    return list(items)


def ended(joint: JointData, **wanted: Any) -> list[StudyRow]:
    """Measured runs with given values of some columns, sorted by the number of coordinates.

    Runs whose steps or film broke down are not included.

    Raises
    ------
    MissingRunsError
        A planned run has not ended, or failed for a reason that does not concern its model.
    """
    planned = joint.planned("methods", **wanted)
    _refuse([row for row in planned if not (row.measured or broke_down(row))])
    return joint.measured("methods", **wanted)


def every(joint: JointData, **wanted: Any) -> list[StudyRow]:
    """Measured runs as `ended` returns them, if every planned run is among them.

    Raises
    ------
    MissingRunsError
        A planned run is not measured, for any reason.
    """
    rows = ended(joint, **wanted)
    _refuse([row for row in joint.planned("methods", **wanted) if not row.measured])
    return rows


def runs_of(joint: JointData, description: str, **wanted: Any) -> list[StudyRow]:
    """Measured runs as `every` returns them, at least one; otherwise `MissingRunsError`."""
    return need(every(joint, **wanted), description)


def of_size(joint: JointData, coordinates: float, **wanted: Any) -> list[StudyRow]:
    """List of one run: the one whose number of coordinates is nearest; empty if none is near.

    Raises
    ------
    MissingRunsError
        A run that may have this number of coordinates is not measured.
    """
    planned = joint.planned("methods", **wanted)
    planned = [row for row in planned if _may_have(row, coordinates)]
    _refuse([row for row in planned if not row.measured])
    return near(planned, coordinates)[:1]


def _refuse(missing: Sequence[StudyRow]) -> None:
    if missing:
        names = [f"{row['run']} ({_state(row)})" for row in missing[:NAMED]]
        names += [f"{len(missing) - NAMED} more"] if len(missing) > NAMED else []
        raise MissingRunsError(", ".join(names))


def _state(row: StudyRow) -> str:
    return "not compared with the reference" if row.complete else row["status"]


def _may_have(row: StudyRow, coordinates: float) -> bool:
    """True if a run has about this number of coordinates, or may have it once it has ended."""
    if math.isfinite(row["coordinates"]):
        return bool(near([row], coordinates))
    residual = row["residual_modes"] if math.isfinite(row["residual_modes"]) else 0.0
    modes = row["vibration_modes"] + residual
    if not math.isfinite(modes):
        return True
    least = (1 - EQUAL_COORDINATES) * coordinates
    most = (1 + EQUAL_COORDINATES) * coordinates
    return bool(modes <= most and modes + RIGID_MOTION >= least)


def near(rows: Iterable[StudyRow], coordinates: float) -> list[StudyRow]:
    """Runs with about this number of coordinates, the nearest first."""

    def distance(row: StudyRow) -> float:
        return abs(row["coordinates"] / coordinates - 1)

    close = [row for row in rows if distance(row) <= EQUAL_COORDINATES]
    return sorted(close, key=lambda row: (distance(row), row["run"]))


def reference_history(joint: JointData, until: float = 0.0, *, films: bool = True) -> History:
    """History of the reference, complete and at least until a time [s].

    Raises
    ------
    MissingRunsError
        The reference is not complete, or ends earlier.
    """
    complete = joint.study.reference.get("status") == "complete"
    history = joint.study.history(REFERENCE, films=films) if complete else None
    if history is None:
        raise MissingRunsError("the reference, complete")
    # Steps end at sums of binary fractions.
    if history.time[-1] < until * (1 - 1e-9):
        raise MissingRunsError(f"a reference that reaches {1e3 * until:g} ms")
    return history


def pressure_errors(joint: JointData, row: StudyRow) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors of a run's peak pressure over time, loads, and weights of the steps.

    Returns
    -------
    errors
        Signed errors over the reference's largest peak pressure, shape (n,).
    loads
        Peak pressures of the reference over the largest one, shape (n,).
    weights
        Lengths of the steps, shape (n,) [s].

    Raises
    ------
    MissingRunsError
        The run has no stored errors.
    """
    reference = reference_history(joint, films=False)
    curves = joint.errors_over_time(row["run"])
    if curves is None:
        raise MissingRunsError(f"the errors of {row['run']} over time")
    peaks = np.asarray(reference.joints[joint.name].max_pressure)
    loads = np.interp(curves["time_s"], reference.time, peaks) / peaks.max()
    return curves["pressure_error"], loads, np.gradient(curves["time_s"])


def many_modes(joint: JointData, method: str) -> Finding:
    """Judge whether a method needs at least twice as many coordinates as M3 for 5 %."""
    rows = need(ended(joint, method=method), method.upper())
    rival = [row for row in ended(joint, **paper_m3(joint)) if row.worst_error <= WELL]
    need(rival, "a run of M3 within 5 %")
    measured = f"{listed(rows)}; M3: {listed(rival[:1])}"
    return Finding(measured, needs_more(rows, WELL, 2 * rival[0]["coordinates"]))


def needs_more(rows: Sequence[StudyRow], error: float, coordinates: float) -> str:
    """Verdict on the statement that an error needs at least this number of coordinates.

    The number that the error needs is larger than that of the last run with a larger error, and not
    larger than that of the first run without one. Without such a run, there is no bound.
    """
    first = min((row["coordinates"] for row in rows if row.worst_error <= error), default=math.inf)
    below = (row["coordinates"] for row in rows if row["coordinates"] < first)
    if max(below, default=0.0) >= coordinates:
        return HOLDS
    return FAILS if first < coordinates else OPEN


def m2_ahead_of_m1(joint: JointData) -> Finding:
    """Judge whether M2 has smaller errors of both curves than M1 with equally many coordinates."""
    rivals = every(joint, method="m2")
    pairs = [
        (one, two)
        for one in runs_of(joint, "M1", method="m1")
        for two in near(rivals, one["coordinates"])[:1]
    ]
    need(pairs, "M1 and M2 with equally many coordinates")
    ahead = [smaller(two, one, quantity) for one, two in pairs for quantity in CURVES]
    measured = "; ".join(
        f"{one['coordinates']:.0f}: M1 {errors(one)}, M2 {errors(two)}" for one, two in pairs
    )
    return Finding(measured, verdict(ahead))


def too_stiff(joint: JointData, rows: Sequence[StudyRow]) -> Finding:
    """Judge whether the mean error of the peak pressure at high loads is positive in all runs."""
    excess = []
    for row in rows:
        error, load, weight = pressure_errors(joint, row)
        high = load >= HIGH_LOAD
        excess.append((row, float(weight[high] @ error[high] / weight[high].sum())))
    values = ", ".join(
        f"{row['method'].upper()} with {row['coordinates']:.0f}: {100 * value:+.1f} %"
        for row, value in excess
    )
    above = (clearly(value > 0, value, row.floor(PRESSURE)) for row, value in excess)
    return Finding(f"mean pressure error at high loads: {values}", verdict(above))


def at_size(joint: JointData, coordinates: float) -> dict[str, StudyRow]:
    """Runs of M1, M2 and the paper's M3 with about this number of coordinates, by method."""
    wanted = {"m1": {"method": "m1"}, "m2": {"method": "m2"}, "m3": paper_m3(joint)}
    runs = {name: of_size(joint, coordinates, **values) for name, values in wanted.items()}
    missing = [name.upper() for name, rows in runs.items() if not rows]
    if missing:
        raise MissingRunsError(f"{', '.join(missing)} with about {coordinates:.0f} coordinates")
    return {name: rows[0] for name, rows in runs.items()}


def compared(rows: dict[str, StudyRow]) -> str:
    """Text with the errors of several methods."""
    return ", ".join(f"{name.upper()} {errors(row)}" for name, row in rows.items())


def m3_best(joint: JointData, sizes: Sequence[float]) -> Finding:
    """Judge whether M3 has the smallest errors of both curves, for some numbers of coordinates."""
    sets = {size: at_size(joint, size) for size in sizes}
    pairs = [(rows["m3"], rows[other]) for rows in sets.values() for other in ("m1", "m2")]
    best = [smaller(run, other, quantity) for run, other in pairs for quantity in CURVES]
    measured = "; ".join(f"{size:.0f}: {compared(rows)}" for size, rows in sets.items())
    return Finding(measured, verdict(best))


def m1_worst(joint: JointData, size: float) -> Finding:
    """Judge whether M1 has the largest errors of both curves."""
    rows = at_size(joint, size)
    pairs = [(rows[other], quantity) for other in ("m2", "m3") for quantity in (PRESSURE, FILM)]
    worst = (smaller(other, rows["m1"], quantity) for other, quantity in pairs)
    return Finding(compared(rows), verdict(worst))
