"""How errors follow from the step tolerance, the film mesh; and what a run says of its own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from fenics_ehd.report.cost import families
from fenics_ehd.report.curves import REFERENCE_RUN
from fenics_ehd.report.study_data import FILM, QUANTITIES, Quantity, Study, StudyRun
from fenics_ehd.report.style import (
    FLOOR,
    FLOOR_LABEL,
    draw_floor,
    family,
    legend_below,
    line_style,
    percent_axis,
    plain_log_axis,
    plt,
    save,
    two_panels,
)

Points = list[tuple[float, float]]


def tolerance_series(study: Study, quantity: Quantity) -> dict[str, tuple[StudyRun, Points]]:
    """Error of the steps over the tolerance asked for, from tight to loose, by model.

    Against the same model with very fine steps, and none below the reference's own step error.
    """
    series: dict[str, tuple[StudyRun, dict[float, float]]] = {}
    for run in study.group("tolerance"):
        error, floor = run.step_error(quantity), study.own_error("step", quantity)
        if not math.isfinite(error):
            continue  # the very fine steps themselves
        label = f"{family(run)}, {run.coordinates:.0f} coordinates"
        series.setdefault(label, (run, {}))[1].setdefault(run.tolerance, max(error, floor))
    return {
        label: (run, sorted(points.items()))
        for label, (run, points) in sorted(series.items())
        if len(points) > 1
    }


def slope(points: Points, floor: float) -> float:
    """Exponent of error over tolerance.

    A least-squares line through the logarithms of the points well above the floor, twice it;
    nan with fewer than two.
    """
    above = [point for point in points if point[1] > 2 * floor]
    if len(above) < 2:
        return math.nan
    tolerance, error = np.log(np.array(above)).T
    return float(np.polyfit(tolerance, error, 1)[0])


def draw_tolerances(study: Study, folder: Path, name: str) -> bool:
    """Error of the steps against the tolerance with the slope of each series."""
    if not tolerance_series(study, FILM):
        return False
    figure, panels = two_panels(4.2)
    for axes, quantity in zip(panels, QUANTITIES, strict=True):
        floor = study.own_error("step", quantity)
        slopes = []
        series = tolerance_series(study, quantity)
        for label, (run, points) in series.items():
            exponent = slope(points, floor)
            slopes.append(f"{family(run)}: {exponent:.2f}")
            axes.plot(*zip(*points, strict=True), label=label, **line_style(run))
        percent_axis(axes, f"largest step error of {quantity.title}")
        axes.set(xscale="log", xlabel="time.tolerance")
        _draw_guide(axes, list(series.values()))
        draw_floor(axes, floor)
        told = "\n".join(["slopes", *(line for line in slopes if "nan" not in line)])
        axes.text(0.03, 0.97, told, transform=axes.transAxes, va="top", fontsize=8.5)
    legend_below(figure)
    save(figure, folder, name)
    return True


def _draw_guide(axes: Axes, series: Sequence[tuple[StudyRun, Points]]) -> None:
    """A line under the points with the slope that a formula of their order gives.

    The local error of order p + 1 in the step follows the tolerance, so that steps go with
    tolerance^(1/(p+1)), and the error of the curve, of order p, with tolerance^(p/(p+1)).
    """
    run, points = min(series, key=lambda item: item[1][-1][1])
    if not math.isfinite(run.order):
        return
    tolerance, error = points[-1]
    line, order = np.array([points[0][0], tolerance]), round(run.order)
    exponent = order / (order + 1)
    axes.plot(line, 0.5 * error * (line / tolerance) ** exponent, color="0.5", linewidth=1,
              linestyle=(0, (6, 2)), label=f"slope {order}/{order + 1}")  # fmt: skip


def draw_film_meshes(study: Study, folder: Path, name: str) -> bool:
    """Error against the number of cells of the film."""
    runs = [run for run in study.group("film") if cells(run)]
    if len({cells(run) for run in runs}) < 2:
        return False
    figure, panels = two_panels(3.9)
    for axes, quantity in zip(panels, QUANTITIES, strict=True):
        for label, members in families(runs).items():
            ordered = sorted(members, key=cells)
            axes.plot(
                [cells(run) for run in ordered],
                [run.visible_error(quantity) for run in ordered],
                label=label,
                **line_style(ordered[0]),
            )
        percent_axis(axes, f"largest error of {quantity.title}\nagainst {finest_mesh(study)} cells")
        plain_log_axis(axes, "cells of the film")
        sizes = sorted({cells(run): run.film_cells for run in runs}.items())
        axes.set_xticks([n for n, _ in sizes], [f"{n}\n{text}" for n, text in sizes])
        draw_floor(axes, max(r.floor(quantity) for r in runs), "error of the last mesh but one")
    legend_below(figure)
    save(figure, folder, name)
    return True


def finest_mesh(study: Study) -> str:
    """Cells of the film that the others are measured against, ``60x15`` say; empty: none."""
    runs = [run for run in study.planned("film") if run.complete]
    return max(runs, key=cells).film_cells if runs else ""


def cells(run: StudyRun) -> int:
    """Number of film cells, of ``20x5`` say; 0 where the table does not tell."""
    words = "".join(c if c.isdigit() else " " for c in run.film_cells).split()
    return math.prod(map(int, words)) if words else 0


def gap_floor(study: Study) -> float:
    """What the reference's own gap may be wrong by, anywhere and at any time [m].

    As its other runs show it, except the one on another film mesh, whose error all runs share;
    without them, by the error of the film's minimum.
    """
    rows = [run for run in study.planned("reference") if run.complete]
    film = (study.reference.get("film") or {}).get("run")
    meshes = {run.film_cells for run in rows if run.run == REFERENCE_RUN}
    shown = [
        run.true_gap_error_m
        for run in rows
        if run.run != film and run.film_cells in meshes and math.isfinite(run.true_gap_error_m)
    ]
    least = (run.floor(FILM) * run.min_film_thickness_m for run in study.group("methods"))
    return max(shown) if shown else max(least, default=0.0)


def draw_estimates(study: Study, folder: Path, name: str) -> bool:
    """Every run's own estimate of its gap error against the true one."""
    runs = [
        run
        for run in study.group("methods")
        if run.estimated_gap_error_m > 0 and run.true_gap_error_m > 0
    ]
    if not runs:
        return False
    floor = gap_floor(study)
    figure, axes = plt.subplots(figsize=(8.2, 4.9), layout="constrained")
    for label, members in families(runs).items():
        axes.plot(
            [1e6 * max(run.true_gap_error_m, floor) for run in members],
            [1e6 * run.estimated_gap_error_m for run in members],
            label=label,
            **(line_style(members[0]) | {"linestyle": ""}),
        )
    values = [value for r in runs for value in (max(r.true_gap_error_m, floor),
                                                r.estimated_gap_error_m)]  # fmt: skip
    line = np.array([0.5e6 * min(values), 2e6 * max(values)])
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
        xlabel="true error of the gap, largest anywhere and at any time [µm]",
        ylabel="the run's own estimate [µm]",
    )
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
    save(figure, folder, name)
    return True
