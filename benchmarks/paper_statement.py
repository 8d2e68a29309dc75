"""A statement of the paper, the rule by which it holds, and the verdict of a study's runs.

There is no verdict before all planned runs of a rule have ended. A run whose steps or film
broke down is a result: it is no better than the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

import fenics_ehd as ehd
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

HOLDS, FAILS, PARTLY = "holds", "does not hold", "holds in part"
OPEN, NOT_RUN = "undecided", "not run"

#: Ends of a run that tell something about its model: it could not be integrated to the end.
BREAKDOWNS = tuple(
    f"failed: {kind.__name__}"
    for kind in (
        ehd.errors.StepSizeError,
        ehd.errors.GapClosedError,
        ehd.errors.FilmTooThinError,
        ehd.errors.CavitationError,
    )
)

#: M3 as the paper has it in either example.
PAPER_M3 = {
    scene: dict(zip(("pressure_set", "selection"), names, strict=True))
    for scene, names in ((SLIDER_CRANK, ROD_M3), (ROTOR, HOUSING_M3))
}

#: A curve is followed well when its largest error is at most this.
WELL = 0.05

#: Loads are high where the reference's peak pressure exceeds this share of its largest.
HIGH_LOAD = 0.75

#: Numbers of coordinates this close count as equal.
EQUAL_COORDINATES = 0.1

#: Coordinates that a basis may have in addition to the modes asked for.
RIGID_MOTION = 6

#: Missing runs that are named.
NAMED = 3


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
    text
        Statement in our words.
    rule
        When we call it true.
    check
        Measures and judges; raises `MissingRunsError`.
    """

    place: str
    text: str
    rule: str
    check: Callable[[JointData], Finding]

    def judge(self, joint: JointData) -> Finding:
        """Finding of this study's runs."""
        try:
            return self.check(joint)
        except MissingRunsError as error:
            return Finding(f"needs {error}", NOT_RUN)


def verdict(truths: Iterable[bool | None]) -> str:
    """Whether all, some or none of several cases are as stated; None: not decided."""
    values = list(truths)
    if all(values):
        return HOLDS
    if any(values):
        return PARTLY
    return OPEN if None in values else FAILS


def clearly(truth: bool, difference: float, error: float) -> bool | None:
    """A comparison, unless the difference is no larger than the error of what is compared."""
    return truth if abs(difference) > error else None


def smaller(one: StudyRow, two: StudyRow, quantity: Curve) -> bool | None:
    """Whether the first one's error is the smaller one; None within the reference's own error."""
    difference = two.visible_error(quantity) - one.visible_error(quantity)
    return clearly(difference > 0, difference, max(one.floor(quantity), two.floor(quantity)))


def errors(row: StudyRow) -> str:
    """Largest errors of both curves, pressure first; none below the reference's own."""
    return " / ".join(bounded(row, quantity) for quantity in CURVES)


def description(row: StudyRow) -> str:
    """A run with its size and errors."""
    return f"{family(row)}, {row['coordinates']:.0f}: {errors(row)}"


def listed(rows: Iterable[StudyRow]) -> str:
    """Several runs of one family: sizes and errors."""
    return ", ".join(f"{row['coordinates']:.0f} coordinates {errors(row)}" for row in rows)


def broke_down(row: StudyRow) -> bool:
    """Whether steps or film came to an end: that is a result, a full disk is none."""
    return bool(row["status"].startswith(BREAKDOWNS))


def paper_m3(joint: JointData) -> dict[str, str]:
    """What the runs of M3 with the paper's pressure set and selection have in common."""
    return {"method": "m3", **PAPER_M3[joint.study.info["scene"]]}


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


def ended(joint: JointData, **wanted: Any) -> list[StudyRow]:
    """Measured runs of the comparison of methods with these values, by coordinates.

    Runs whose steps or film broke down are left out: they are no better than the others.

    Raises
    ------
    MissingRunsError
        One of them has not ended, or failed for a reason that does not concern its model.
    """
    planned = joint.planned("methods", **wanted)
    _refuse([row for row in planned if not (row.measured or broke_down(row))])
    return joint.measured("methods", **wanted)


def every(joint: JointData, **wanted: Any) -> list[StudyRow]:
    """The same where a run that broke down leaves a hole: `MissingRunsError` for it as well."""
    found = ended(joint, **wanted)
    _refuse([row for row in joint.planned("methods", **wanted) if not row.measured])
    return found


def runs_of(joint: JointData, what: str, **wanted: Any) -> list[StudyRow]:
    """Every run with these values, at least one, or `MissingRunsError`."""
    return need(every(joint, **wanted), what)


def of_size(joint: JointData, coordinates: float, **wanted: Any) -> list[StudyRow]:
    """The run with about so many coordinates, the nearest; none where none was planned.

    Raises
    ------
    MissingRunsError
        One that may have so many is not measured.
    """
    planned = joint.planned("methods", **wanted)
    planned = [row for row in planned if _may_have(row, coordinates)]
    _refuse([row for row in planned if not row.measured])
    return near(planned, coordinates)[:1]


def _refuse(missing: Sequence[StudyRow]) -> None:
    if missing:
        words = [f"{row['run']} ({_state(row)})" for row in missing[:NAMED]]
        words += [f"{len(missing) - NAMED} more"] if len(missing) > NAMED else []
        raise MissingRunsError(", ".join(words))


def _state(row: StudyRow) -> str:
    return "not compared with the reference" if row.complete else row["status"]


def _may_have(row: StudyRow, coordinates: float) -> bool:
    """Whether a run has about so many coordinates, or may turn out to have."""
    if math.isfinite(row["coordinates"]):
        return bool(near([row], coordinates))
    residual = row["residual_modes"] if math.isfinite(row["residual_modes"]) else 0.0
    modes = row["vibration_modes"] + residual
    if not math.isfinite(modes):
        return True
    least, most = (1 - EQUAL_COORDINATES) * coordinates, (1 + EQUAL_COORDINATES) * coordinates
    return bool(modes <= most and modes + RIGID_MOTION >= least)


def near(rows: Iterable[StudyRow], coordinates: float) -> list[StudyRow]:
    """Runs with about this many coordinates, the nearest first."""

    def distance(row: StudyRow) -> float:
        return abs(row["coordinates"] / coordinates - 1)

    close = [row for row in rows if distance(row) <= EQUAL_COORDINATES]
    return sorted(close, key=lambda row: (distance(row), row["run"]))


def reference_history(joint: JointData, until: float = 0.0, *, films: bool = True) -> ehd.History:
    """History of a reference that came to its end, and that at this time [s] or later.

    Raises
    ------
    MissingRunsError
        There is none.
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
    """Signed errors of a run's peak pressure over the largest, its load, the steps' lengths [s].

    The load is the reference's peak pressure then, over the largest.

    Raises
    ------
    MissingRunsError
        The run left none.
    """
    reference = reference_history(joint, films=False)
    found = joint.errors_over_time(row["run"])
    if found is None:
        raise MissingRunsError(f"the errors of {row['run']} over time")
    peaks = np.asarray(reference.joints[joint.name].max_pressure)
    load = np.interp(found["time_s"], reference.time, peaks) / peaks.max()
    return found["pressure_error"], load, np.gradient(found["time_s"])


def many_modes(joint: JointData, method: str) -> Finding:
    """A method needs many coordinates before it follows both curves well."""
    rows = need(ended(joint, method=method), method.upper())
    rival = [row for row in ended(joint, **paper_m3(joint)) if row.worst_error <= WELL]
    need(rival, "a run of M3 within 5 %")
    words = f"{listed(rows)}; M3: {listed(rival[:1])}"
    return Finding(words, needs_more(rows, WELL, 2 * rival[0]["coordinates"]))


def needs_more(rows: Sequence[StudyRow], error: float, coordinates: float) -> str:
    """Whether an error takes at least so many coordinates.

    The number that it takes lies above the last run that is not as good and not above the first
    one that is; no such run, no bound on that side.
    """
    first = min((row["coordinates"] for row in rows if row.worst_error <= error), default=math.inf)
    below = (row["coordinates"] for row in rows if row["coordinates"] < first)
    if max(below, default=0.0) >= coordinates:
        return HOLDS
    return FAILS if first < coordinates else OPEN


def m2_ahead_of_m1(joint: JointData) -> Finding:
    """With equally many coordinates M2's errors are the smaller ones, in both curves."""
    rivals = every(joint, method="m2")
    pairs = [
        (one, two)
        for one in runs_of(joint, "M1", method="m1")
        for two in near(rivals, one["coordinates"])[:1]
    ]
    need(pairs, "M1 and M2 with equally many coordinates")
    ahead = [smaller(two, one, quantity) for one, two in pairs for quantity in CURVES]
    words = "; ".join(
        f"{one['coordinates']:.0f}: M1 {errors(one)}, M2 {errors(two)}" for one, two in pairs
    )
    return Finding(words, verdict(ahead))


def too_stiff(joint: JointData, rows: Sequence[StudyRow]) -> Finding:
    """Peak pressures come out too high where loads are high: mean error, weighted by time."""
    excess = []
    for row in rows:
        error, load, weight = pressure_errors(joint, row)
        high = load >= HIGH_LOAD
        excess.append((row, float(weight[high] @ error[high] / weight[high].sum())))
    words = ", ".join(
        f"{row['method'].upper()} with {row['coordinates']:.0f}: {100 * value:+.1f} %"
        for row, value in excess
    )
    above = (clearly(value > 0, value, row.floor(PRESSURE)) for row, value in excess)
    return Finding(f"mean pressure error at high loads: {words}", verdict(above))


def at_size(joint: JointData, coordinates: float) -> dict[str, StudyRow]:
    """M1, M2 and the paper's M3 with about this many coordinates."""
    wanted = {"m1": {"method": "m1"}, "m2": {"method": "m2"}, "m3": paper_m3(joint)}
    found = {name: of_size(joint, coordinates, **values) for name, values in wanted.items()}
    missing = [name.upper() for name, rows in found.items() if not rows]
    if missing:
        raise MissingRunsError(f"{', '.join(missing)} with about {coordinates:.0f} coordinates")
    return {name: rows[0] for name, rows in found.items()}


def compared(rows: dict[str, StudyRow]) -> str:
    """Errors of the three methods."""
    return ", ".join(f"{name.upper()} {errors(row)}" for name, row in rows.items())


def m3_best(joint: JointData, sizes: Sequence[float]) -> Finding:
    """M3 is nearest to the reference in both curves."""
    sets = {size: at_size(joint, size) for size in sizes}
    best = [
        smaller(rows["m3"], rows[other], quantity)
        for rows in sets.values()
        for other in ("m1", "m2")
        for quantity in CURVES
    ]
    words = "; ".join(f"{size:.0f}: {compared(rows)}" for size, rows in sets.items())
    return Finding(words, verdict(best))


def m1_worst(joint: JointData, size: float) -> Finding:
    """M1 is farthest from the reference in both curves."""
    rows = at_size(joint, size)
    pairs = [(rows[other], quantity) for other in ("m2", "m3") for quantity in (PRESSURE, FILM)]
    worst = (smaller(other, rows["m1"], quantity) for other, quantity in pairs)
    return Finding(compared(rows), verdict(worst))
