"""How errors follow from step tolerance and film mesh, and what a run says of its own."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fenics_ehd.study.report.study_data import (
    FILM,
    JointData,
    Quantity,
    StudyRow,
)
from fenics_ehd.study.report.style import (
    FLOOR,
    FLOOR_LABEL,
    WIDTH,
    draw_floor,
    families,
    family,
    joint_panels,
    legend_below,
    line_style,
    percent_axis,
    plain_figures,
    plain_log_axis,
    plt,
    sized,
)

#: Range of a short axis from which on only powers of ten have room.
CROWDED = 100

Points = list[tuple[float, float]]


def tolerance_series(joint: JointData, quantity: Quantity) -> dict[str, tuple[StudyRow, Points]]:
    """Error of the steps over the tolerance asked for, from tight to loose, by model.

    Against the same model with very fine steps, and none below the reference's own step error.
    """
    column, floor = f"own_{quantity.key}_error_max", joint.own_error("step", quantity)
    # The very fine steps themselves have no such error.
    rows = [row for row in joint.measured("tolerance") if math.isfinite(row[column])]
    return {
        name: (
            members[0],
            [(row["tolerance"], float(np.fmax(row[column], floor))) for row in members],
        )
        for name, members in families(rows, sized).items()
        if len(members) > 1
    }


def slope(points: Points, floor: float) -> float:
    """Exponent of error over tolerance.

    A least-squares line through the logarithms of the points well above the floor, twice it;
    nan with fewer than two.
    """
    above = [point for point in points if not point[1] <= 2 * floor]
    if len(above) < 2:
        return math.nan
    tolerance, error = np.log(np.array(above)).T
    return float(np.polyfit(tolerance, error, 1)[0])


def draw_tolerances(joints: Sequence[JointData]) -> Figure | None:
    """Error of the steps against the tolerance with the slope of each series, if any."""
    if not all(tolerance_series(joint, FILM) for joint in joints):
        return None
    figure, panels = joint_panels(joints, 4.2)
    for axes, joint, quantity in panels:
        floor = joint.own_error("step", quantity)
        series, told = tolerance_series(joint, quantity), ["slopes"]
        for label, (row, points) in series.items():
            exponent = slope(points, floor)
            told += [f"{family(row)}: {exponent:.2f}"] if math.isfinite(exponent) else []
            axes.plot(*zip(*points, strict=True), label=label, **line_style(row))
        percent_axis(axes, f"largest step error of {quantity.title}")
        axes.set(xscale="log", xlabel="time.tolerance")
        _draw_guide(axes, *min(series.values(), key=lambda item: item[1][-1][1]))
        draw_floor(axes, floor)
        axes.text(0.03, 0.97, "\n".join(told), transform=axes.transAxes, va="top", fontsize=8.5)
    legend_below(figure)
    return figure


def _draw_guide(axes: Axes, row: StudyRow, points: Points) -> None:
    """A line under the points with the slope that a formula of their order gives.

    The local error of order p + 1 in the step follows the tolerance, so that steps go with
    tolerance^(1/(p+1)), and the error of the curve, of order p, with tolerance^(p/(p+1)).
    """
    if not math.isfinite(row["order"]):
        return
    (first, _), (last, error) = points[0], points[-1]
    line, order = np.array([first, last]), round(row["order"])
    axes.plot(line, 0.5 * error * (line / last) ** (order / (order + 1)), color="0.5",
              linewidth=1, linestyle=(0, (6, 2)), label=f"slope {order}/{order + 1}")  # fmt: skip


def draw_film_meshes(joints: Sequence[JointData]) -> Figure | None:
    """Error against the number of cells of the film, None without two meshes."""
    rows = {joint: joint.measured("film") for joint in joints}
    if any(len({cells(row) for row in found}) < 2 for found in rows.values()):
        return None
    figure, panels = joint_panels(joints, 3.9)
    for axes, joint, quantity in panels:
        for label, members in families(rows[joint]).items():
            ordered = sorted(members, key=cells)
            errors = [row.visible_error(quantity) for row in ordered]
            axes.plot([*map(cells, ordered)], errors, label=label, **line_style(ordered[0]))
        percent_axis(axes, f"largest error of {quantity.title}\nagainst {finest_mesh(joint)} cells")
        plain_log_axis(axes, "cells of the film")
        sizes = sorted({cells(row): row["film_cells"] for row in rows[joint]}.items())
        axes.set_xticks([n for n, _ in sizes], [f"{n}\n{text}" for n, text in sizes])
        floor = max(row.floor(quantity) for row in rows[joint])
        draw_floor(axes, floor, "error of the last mesh but one")
    legend_below(figure)
    return figure


def finest_mesh(joint: JointData) -> str:
    """Cells of the film that the others are measured against, ``60x15`` say; empty: none."""
    rows = [row for row in joint.planned("film") if row.complete]
    return str(max(rows, key=cells)["film_cells"]) if rows else ""


def cells(row: StudyRow) -> int:
    """Number of film cells, of ``20x5`` say; 0 where the table does not tell."""
    return math.prod(map(int, row["film_cells"].split("x"))) if row["film_cells"] else 0


def gap_floor(joint: JointData) -> float:
    """What the reference's own gap may be wrong by, anywhere and at any time [m].

    As its other runs show it, except that on another film mesh, whose error all runs share; 0
    without them.
    """
    film = (joint.study.reference.get("film") or {}).get("run")
    rows = [row for row in joint.measured("reference") if row["run"] != film]
    return float(np.nanmax([0.0, *(row["true_gap_error_m"] for row in rows)]))


def draw_estimates(joints: Sequence[JointData]) -> Figure | None:
    """Every run's own estimate of its gap error against the true one, if there is any."""
    rows = {
        joint: [
            row
            for row in joint.measured("methods")
            if row["estimated_gap_error_m"] > 0 and row["true_gap_error_m"] > 0
        ]
        for joint in joints
    }
    told = [joint for joint in joints if rows[joint]]  # a rigid bore's joint has no estimate
    if not told:
        return None
    figure, panels = plt.subplots(
        1, len(told), figsize=(WIDTH, 4.9), layout="constrained", squeeze=False
    )
    for axes, joint in zip(panels.flat, told, strict=True):
        _draw_estimate(axes, rows[joint], gap_floor(joint))
        axes.set_title(joint.title, loc="left", fontweight="bold")
    legend_below(figure)
    return figure


def _draw_estimate(axes: Axes, rows: Sequence[StudyRow], floor: float) -> None:
    values = []
    for label, members in families(rows).items():
        true = [1e6 * max(row["true_gap_error_m"], floor) for row in members]
        own = [1e6 * row["estimated_gap_error_m"] for row in members]
        values += true + own
        axes.plot(true, own, label=label, **(line_style(members[0]) | {"linestyle": ""}))
    line = np.array([0.5 * min(values), 2 * max(values)])
    axes.plot(line, line, color="0.4", linewidth=1)
    axes.fill_between(line, line / 2, 2 * line, color="#33AA55", alpha=0.15, linewidth=0,
                      label="within a factor of two")  # fmt: skip
    if 1e6 * floor > line[0]:
        axes.axvspan(line[0], 1e6 * floor, color=FLOOR, linewidth=0, zorder=0, label=FLOOR_LABEL)
    axes.set(
        xscale="log",
        yscale="log",
        xlim=line,
        ylim=line,
        aspect="equal",
        xlabel="true error of the gap, largest ever [µm]",
        ylabel="the run's own estimate [µm]",
    )
    for axis in (axes.xaxis, axes.yaxis):
        plain_figures(axis, at=(1.0,) if line[1] > CROWDED * line[0] else (1.0, 2.0, 5.0))
