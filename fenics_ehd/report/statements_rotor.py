"""Statements of section 5.2, the rotor, and those of section 6 that it can tell."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from fenics_ehd.report.comparisons import (
    at_size,
    compared,
    m1_worst,
    m3_best,
    smaller,
    too_stiff,
)
from fenics_ehd.report.curves import error_curve
from fenics_ehd.report.needed import (
    MissingRunsError,
    ended,
    history_of,
    need,
    reference_history,
)
from fenics_ehd.report.pressure_map import read_pressures
from fenics_ehd.report.statement import (
    FAILS,
    HOLDS,
    Finding,
    Statement,
    clearly,
    percent,
    told,
    verdict,
)
from fenics_ehd.report.study_data import (
    FILM,
    PRESSURE,
    QUANTITIES,
    Quantity,
    Study,
    StudyRun,
)
from fenics_ehd.report.style import family

#: Overall modes of figures 10 and 11.
FEW, MANY = 30, 50


def unsymmetric(study: Study) -> Finding:
    """Pressure at the highest peak against its mirror image about mid-width."""
    reference_history(study)
    fields = read_pressures(study)
    if fields is None:
        raise MissingRunsError("pressure fields of the reference")
    pressure = fields.pressure[fields.pressure.max(axis=1).argmax()]
    mirrored = fields.nodes * np.array([1.0, 1.0, -1.0])
    distance, partner = cKDTree(fields.nodes).query(mirrored)
    if distance.max() > 1e-6 * np.ptp(fields.nodes[:, 0]):
        raise MissingRunsError("a film mesh that is symmetric about mid-width")
    defect = np.abs(pressure - pressure[partner]).max() / pressure.max()
    words = f"largest difference of mirrored pressures {percent(float(defect))} of the peak"
    return Finding(words, HOLDS if defect > 0.05 else FAILS)


def large_where_high(study: Study) -> Finding:
    """Mean error of the peak pressure above half the reference's peak, and below it."""
    reference = reference_history(study)
    peak = reference[PRESSURE.column].max()
    words, larger = [], []
    for name, run in at_size(study, FEW).items():
        history = history_of(study, run)
        truth = np.interp(history["time_s"], reference["time_s"], reference[PRESSURE.column])
        error, weight = (
            np.abs(error_curve(history, reference, PRESSURE)),
            np.gradient(history["time_s"]),
        )
        high = truth > 0.5 * peak
        need(list(error[high]), "steps at high pressure")
        above, below = (
            float(weight[part] @ error[part] / weight[part].sum()) for part in (high, ~high)
        )
        words.append(f"{name.upper()} {percent(above)} above, {percent(below)} below")
        larger.append(clearly(above > below, above - below, run.floor(PRESSURE, "l2")))
    return Finding(", ".join(words), verdict(larger))


def still_stiff(study: Study) -> Finding:
    """M1 and M2 with 50 modes at high loads."""
    runs = at_size(study, MANY)
    return too_stiff(study, [runs["m1"], runs["m2"]])


def small_for_m3(study: Study) -> Finding:
    """M3 with 50 modes against the two others."""
    runs = at_size(study, MANY)
    small = (_half(runs["m3"], [runs["m1"], runs["m2"]], quantity) for quantity in QUANTITIES)
    return Finding(compared(runs), verdict(small))


def _half(run: StudyRun, others: list[StudyRun], quantity: Quantity) -> bool | None:
    """Whether an error is at most half of the others'; None: the reference is not that good."""
    limit = 0.5 * min(other.visible_error(quantity) for other in others)
    difference = limit - run.visible_error(quantity)
    return clearly(difference >= 0, difference, run.floor(quantity))


def shapes_fail(study: Study) -> Finding:
    """Symmetric pressure shapes against unit pressures, equally many residual modes."""
    sizes = sorted({run.residual_modes for run in study.planned(pressure_set="pc2")})
    words, worse = [], []
    for size in sizes:
        shape = _best(study, pressure_set="pc2", residual_modes=size)
        unit = _best(study, pressure_set="pc1", residual_modes=size)
        if unit is None or shape is None or not unit.complete:
            continue
        reason = ":".join(shape.status.split(":")[:2])
        broken = f"{family(shape)}, {size:.0f} residual modes: {reason}"
        words.append(f"{told(shape) if shape.complete else broken}; {told(unit)}")
        worse += [
            not shape.complete or smaller(unit, shape, quantity) for quantity in (PRESSURE, FILM)
        ]
    need(words, "M3 pc2, and M3 pc1 with as many residual modes")
    return Finding("; ".join(words), verdict(worse))


def _best(study: Study, **wanted: Any) -> StudyRun | None:
    """The most accurate one of some runs, one that broke down where all did; None without any."""
    found = ended(study, **wanted) or study.planned(**wanted)
    return min(found, key=lambda run: run.worst_error, default=None)


_SCENE = "rotor"

STATEMENTS = (
    Statement("5.2", "the tilting shaft makes the pressure unsymmetric along the axis",
              "mirrored pressures differ by more than 5 % of the peak", _SCENE, unsymmetric),
    Statement("5.2, fig. 10", "with 30 modes the pressure is far off, most of all when it is high",
              "mean error above half the reference's peak larger than below, each method",
              _SCENE, large_where_high),
    Statement("5.2, fig. 10", "with 30 modes M3 comes nearest to the reference",
              "smallest errors of both curves", _SCENE, partial(m3_best, sizes=(FEW,))),
    Statement("5.2, fig. 10", "with 30 modes M1 is farthest off", "largest errors of both curves",
              _SCENE, partial(m1_worst, size=FEW)),
    Statement("5.2, fig. 11", "with 50 modes M1 and M2 are still too stiff",
              "mean error positive where the reference is above 75 % of its peak",
              _SCENE, still_stiff),
    Statement("5.2, fig. 11", "with 50 modes the error of M3 is small beside theirs",
              "at most half of the better one's, both curves", _SCENE, small_for_m3),
    Statement("6", "pressures without symmetry need the general choice, unit pressures",
              "with equally many residual modes, the best selection of each, both curves worse "
              "with pressure shapes; a run that breaks down is worse",
              _SCENE, shapes_fail),
)  # fmt: skip
