"""Error of each method against its cost, run time or number of coordinates, on one mesh."""

from __future__ import annotations

import math
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fenics_ehd.study.report.study_data import NORMS, JointData, StudyRow
from fenics_ehd.study.report.style import (
    BOUND,
    BOUND_LABEL,
    draw_floor,
    families,
    joint_panels,
    legend_below,
    line_style,
    percent_axis,
    plain_log_axis,
)

#: What is paid: columns of the table, and their names on an axis.
ONLINE, COORDINATES = "online_s", "coordinates"
LABELS = {
    ONLINE: "time integration [s of processor time]",
    COORDINATES: "elastic coordinates",
}

#: Runs at other step tolerances than the study's.
SMALL = {"linestyle": "", "alpha": 0.55, "markersize": 4, "zorder": 1.5}

#: Closest points of the hull with a label each, in decades.
LABEL_DISTANCE = 0.2

#: Cost, error, and the run that has them.
Point = tuple[float, float, StudyRow]


def lower_left(points: Sequence[Point]) -> list[Point]:
    """Points that no other point reaches with less of one coordinate and no more of the other.

    By ascending cost, so by descending error.
    """
    hull: list[Point] = []
    for point in sorted(points, key=lambda p: (p[0], p[1])):
        if not hull or point[1] < hull[-1][1]:
            hull.append(point)
    return hull


def draw_cost(joints: Sequence[JointData], cost: str, norm: str = "max") -> Figure | None:
    """Error of both curves against a cost, log-log, the hull where it is a time.

    None where there is nothing to draw.
    """
    groups = ("methods", "tolerance") if cost == ONLINE else ("methods",)
    rows = {joint: [row for row in joint.measured(*groups) if row[cost] > 0] for joint in joints}
    if not all(rows.values()):
        return None
    figure, panels = joint_panels(joints, 4.4)
    for axes, joint, quantity in panels:
        points = [(r[cost], r.visible_error(quantity, norm), r) for r in rows[joint]]
        bounded = {row for row in rows[joint] if row.bounded(quantity, norm)}
        percent_axis(axes, f"{NORMS[norm]} error of {quantity.title}")
        plain_log_axis(axes, LABELS[cost])
        if cost == ONLINE:
            _draw_hull(axes, points)
        _draw_points(axes, points, bounded)
        draw_floor(axes, max(row.floor(quantity, norm) for row in rows[joint]))
    legend_below(figure)
    return figure


def _draw_points(axes: Axes, points: Sequence[Point], bounded: set[StudyRow]) -> None:
    """Runs of a method joined from few modes to many, small signs at other step tolerances.

    Runs of which only a bound is known stand on the edge of the grey band with a sign of it.
    """
    place = {row: (x, y) for x, y, row in points}
    for label, members in families([row for row in place if row["group"] == "methods"]).items():
        seen = [i for i, row in enumerate(members) if row not in bounded]
        style = line_style(members[0]) | {"linewidth": 1.2}
        axes.plot(*zip(*map(place.get, members), strict=True), label=label, markevery=seen, **style)
    others = [row for row in place if row["group"] != "methods"]
    for row in others:
        if row not in bounded:
            axes.plot(*place[row], **(line_style(row) | SMALL))
    if others:
        axes.plot([], [], "o", color="0.5", label="small signs: other step tolerances",
                  markersize=4, alpha=0.55)  # fmt: skip
    for row in filter(bounded.__contains__, place):
        axes.plot(*place[row], BOUND, color=line_style(row)["color"], label=BOUND_LABEL)


def _draw_hull(axes: Axes, points: Sequence[Point]) -> None:
    """Runs that no other one beats in both error and cost, with coordinates and tolerance."""
    hull = lower_left(points)
    axes.plot(
        [x for x, _, _ in hull],
        [y for _, y, _ in hull],
        drawstyle="steps-post",
        color="#33AA55",
        linewidth=5,
        alpha=0.35,
        zorder=1,
        solid_capstyle="round",
        label="lower left hull: nothing is both faster and more accurate",
    )
    usual = {row["order"] for _, _, row in points if row["group"] == "methods"}
    for x, y, row in _apart(hull):
        words = f"{row['method'].upper()}, {row['coordinates']:.0f}, {row['tolerance']:.0e}"
        words += "" if row["order"] in usual else f", order {row['order']:.0f}"
        # Below and to the left of the hull there is nothing by definition.
        label = axes.annotate(words.replace("e-0", "e-"), (x, y), xytext=(-4, -4), fontsize=7.5,
                              textcoords="offset points", ha="right", va="top")  # fmt: skip
        label.set_in_layout(False)
    costs = [x for x, _, _ in points]
    axes.set_xlim(min(costs) / 2.5, 1.3 * max(costs))  # room for the labels on the left


def _apart(hull: Sequence[Point]) -> list[Point]:
    """Points far enough from each other for a label, the more accurate ones first."""
    kept: list[Point] = []
    for x, y, row in reversed(hull):
        steps = (math.log10(kept[-1][0] / x), math.log10(y / kept[-1][1])) if kept else (math.inf,)
        if max(steps) >= LABEL_DISTANCE:
            kept.append((x, y, row))
    return kept
