"""Statements of the paper about the rotor: section 5.2, and one of section 6."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from fenics_ehd.study.compare import LIMITING
from fenics_ehd.study.report.figures import family
from fenics_ehd.study.report.paper_statement import (
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
from fenics_ehd.study.report.study_data import (
    CURVES,
    PRESSURE,
    Curve,
    JointData,
    StudyRow,
)
from fenics_ehd.study.report.write import percent

#: Numbers of modes of every method in figures 10 and 11.
FEW = 30
MANY = 50


def unsymmetric(joint: JointData) -> Finding:
    """Compare the pressure at its highest peak with its mirror image about mid-width."""
    film = reference_history(joint).joints[joint.name].film
    angle, height, pressures = map(np.asarray, (film.angle, film.height, film.pressure))
    pressure = pressures[pressures.max(axis=1).argmax()]
    height = height / np.ptp(height)
    positions = np.column_stack([np.cos(angle), np.sin(angle), height - height.mean()])
    distance, partner = cKDTree(positions).query(positions * [1.0, 1.0, -1.0])
    if distance.max() > 1e-6:
        raise MissingRunsError("a film mesh that is symmetric about mid-width")
    defect = np.abs(pressure - pressure[partner]).max() / pressure.max()
    measured = f"largest difference of mirrored pressures {percent(float(defect))} of the peak"
    return Finding(measured, HOLDS if defect > 0.05 else FAILS)


def large_where_high(joint: JointData) -> Finding:
    """Compare mean errors of the peak pressure above and below half the reference's peak."""
    parts = []
    larger = []
    floors = [joint.own_error(kind, PRESSURE, "l2") for kind in LIMITING]
    limit = float(np.nanmax([0.0, *floors]))
    for name, row in at_size(joint, FEW).items():
        error, load, weight = pressure_errors(joint, row)
        high = load > 0.5
        need(list(error[high]), "steps at high pressure")
        above, below = (
            float(weight[part] @ np.abs(error[part]) / weight[part].sum()) for part in (high, ~high)
        )
        parts.append(f"{name.upper()} {percent(above)} above, {percent(below)} below")
        larger.append(clearly(above > below, above - below, limit))
    return Finding(", ".join(parts), verdict(larger))


def still_stiff(joint: JointData) -> Finding:
    """Judge the pressures of M1 and M2 with 50 modes at high loads."""
    runs = at_size(joint, MANY)
    return too_stiff(joint, [runs["m1"], runs["m2"]])


def small_for_m3(joint: JointData) -> Finding:
    """Compare M3 with 50 modes with M1 and M2."""
    runs = at_size(joint, MANY)
    small = (_half(runs["m3"], [runs["m1"], runs["m2"]], quantity) for quantity in CURVES)
    return Finding(compared(runs), verdict(small))


def _half(row: StudyRow, others: list[StudyRow], quantity: Curve) -> bool | None:
    """True if an error is at most half of the smallest error of other runs; None if undecided.

    It is undecided if the difference does not exceed the reference's own error.
    """
    limit = 0.5 * min(other.visible_error(quantity) for other in others)
    difference = limit - row.visible_error(quantity)
    return clearly(difference >= 0, difference, row.floor(quantity))


def shapes_fail(joint: JointData) -> Finding:
    """Compare symmetric pressure shapes with unit pressures and equally many residual modes."""
    sizes = sorted({row["residual_modes"] for row in joint.planned("methods", pressure_set="pc2")})
    parts = []
    worse: list[bool | None] = []
    for size in sizes:
        shape = _best(joint, pressure_set="pc2", residual_modes=size)
        unit = _best(joint, pressure_set="pc1", residual_modes=size)
        if unit is None or shape is None or not unit.complete:
            continue
        reason = ":".join(shape["status"].split(":")[:2])
        broken = f"{family(shape)}, {size:.0f} residual modes: {reason}"
        parts.append(f"{description(shape) if shape.complete else broken}; {description(unit)}")
        worse += [not shape.complete or smaller(unit, shape, quantity) for quantity in CURVES]
    need(parts, "M3 pc2, and M3 pc1 with as many residual modes")
    return Finding("; ".join(parts), verdict(worse))


def _best(joint: JointData, **wanted: Any) -> StudyRow | None:
    """Most accurate run with given values of some columns; None without runs.

    If all runs broke down, the result is one of them.
    """
    rows = ended(joint, **wanted) or joint.planned("methods", **wanted)
    return min(rows, key=lambda row: row.worst_error, default=None)


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
