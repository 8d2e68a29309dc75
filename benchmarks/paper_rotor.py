"""Statements of section 5.2, the rotor, and those of section 6 that it can tell."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from paper_statement import (
    FAILS,
    HOLDS,
    Finding,
    MissingRunsError,
    Statement,
    at_size,
    clearly,
    compared,
    description,
    ended,
    m1_worst,
    m3_best,
    need,
    pressure_errors,
    reference_history,
    smaller,
    too_stiff,
    verdict,
)
from scipy.spatial import cKDTree

from fenics_ehd.study.compare import LIMITING
from fenics_ehd.study.report.figures import family
from fenics_ehd.study.report.study_data import (
    CURVES,
    PRESSURE,
    Curve,
    JointData,
    StudyRow,
)
from fenics_ehd.study.report.write import percent

#: Overall modes of figures 10 and 11.
FEW, MANY = 30, 50


def unsymmetric(joint: JointData) -> Finding:
    """Pressure at the highest peak against its mirror image about mid-width."""
    film = reference_history(joint).joints[joint.name].film
    angle, height, pressures = map(np.asarray, (film.angle, film.height, film.pressure))
    pressure, height = pressures[pressures.max(axis=1).argmax()], height / np.ptp(height)
    places = np.column_stack([np.cos(angle), np.sin(angle), height - height.mean()])
    distance, partner = cKDTree(places).query(places * [1.0, 1.0, -1.0])
    if distance.max() > 1e-6:
        raise MissingRunsError("a film mesh that is symmetric about mid-width")
    defect = np.abs(pressure - pressure[partner]).max() / pressure.max()
    words = f"largest difference of mirrored pressures {percent(float(defect))} of the peak"
    return Finding(words, HOLDS if defect > 0.05 else FAILS)


def large_where_high(joint: JointData) -> Finding:
    """Mean error of the peak pressure above half the reference's peak, and below it."""
    words, larger = [], []
    own = [joint.own_error(kind, PRESSURE, "l2") for kind in LIMITING]
    limit = float(np.nanmax([0.0, *own]))
    for name, row in at_size(joint, FEW).items():
        error, load, weight = pressure_errors(joint, row)
        high = load > 0.5
        need(list(error[high]), "steps at high pressure")
        above, below = (
            float(weight[part] @ np.abs(error[part]) / weight[part].sum()) for part in (high, ~high)
        )
        words.append(f"{name.upper()} {percent(above)} above, {percent(below)} below")
        larger.append(clearly(above > below, above - below, limit))
    return Finding(", ".join(words), verdict(larger))


def still_stiff(joint: JointData) -> Finding:
    """M1 and M2 with 50 modes at high loads."""
    runs = at_size(joint, MANY)
    return too_stiff(joint, [runs["m1"], runs["m2"]])


def small_for_m3(joint: JointData) -> Finding:
    """M3 with 50 modes against the two others."""
    runs = at_size(joint, MANY)
    small = (_half(runs["m3"], [runs["m1"], runs["m2"]], quantity) for quantity in CURVES)
    return Finding(compared(runs), verdict(small))


def _half(row: StudyRow, others: list[StudyRow], quantity: Curve) -> bool | None:
    """Whether an error is at most half of the others'; None: the reference is not that good."""
    limit = 0.5 * min(other.visible_error(quantity) for other in others)
    difference = limit - row.visible_error(quantity)
    return clearly(difference >= 0, difference, row.floor(quantity))


def shapes_fail(joint: JointData) -> Finding:
    """Symmetric pressure shapes against unit pressures, equally many residual modes."""
    sizes = sorted({row["residual_modes"] for row in joint.planned("methods", pressure_set="pc2")})
    words, worse = [], []
    for size in sizes:
        shape = _best(joint, pressure_set="pc2", residual_modes=size)
        unit = _best(joint, pressure_set="pc1", residual_modes=size)
        if unit is None or shape is None or not unit.complete:
            continue
        reason = ":".join(shape["status"].split(":")[:2])
        broken = f"{family(shape)}, {size:.0f} residual modes: {reason}"
        words.append(f"{description(shape) if shape.complete else broken}; {description(unit)}")
        worse += [not shape.complete or smaller(unit, shape, quantity) for quantity in CURVES]
    need(words, "M3 pc2, and M3 pc1 with as many residual modes")
    return Finding("; ".join(words), verdict(worse))


def _best(joint: JointData, **wanted: Any) -> StudyRow | None:
    """The most accurate one of some runs, one that broke down where all did; None without any."""
    found = ended(joint, **wanted) or joint.planned("methods", **wanted)
    return min(found, key=lambda row: row.worst_error, default=None)


STATEMENTS = (
    Statement("5.2", "the tilting shaft makes the pressure unsymmetric along the axis",
              "mirrored pressures differ by more than 5 % of the peak", unsymmetric),
    Statement("5.2, fig. 10", "with 30 modes the pressure is far off, most of all when it is high",
              "mean error above half the reference's peak larger than below, each method",
              large_where_high),
    Statement("5.2, fig. 10", "with 30 modes M3 comes nearest to the reference",
              "smallest errors of both curves", partial(m3_best, sizes=(FEW,))),
    Statement("5.2, fig. 10", "with 30 modes M1 is farthest off", "largest errors of both curves",
              partial(m1_worst, size=FEW)),
    Statement("5.2, fig. 11", "with 50 modes M1 and M2 are still too stiff",
              "mean error positive where the reference is above 75 % of its peak",
              still_stiff),
    Statement("5.2, fig. 11", "with 50 modes the error of M3 is small compared with M1 and M2",
              "at most half of the better one's, both curves", small_for_m3),
    Statement("6", "pressures without symmetry need the general choice, unit pressures",
              "with equally many residual modes, the best selection of each, both curves worse "
              "with pressure shapes; a run that breaks down is worse",
              shapes_fail),
)  # fmt: skip
