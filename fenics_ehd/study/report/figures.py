"""Figures of a study's report: errors against cost, tolerance and film mesh, and over time; bores.

Every method has a colour and a marker. Black and the yellow, red and blue of Paul Tol's
high-contrast scheme are distinct for colour-blind readers and in grey print; markers and lines
distinguish the rest. Errors below the reference's own error, a grey band, are not drawn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import fenics_ehd.base.matplotlib_start  # noqa: F401  # isort: skip
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from fenics_ehd.film.transfer import interpolation_matrix
from fenics_ehd.multibody.elastic_bore import bore_surface
from fenics_ehd.multibody.history import History
from fenics_ehd.multibody.summary import extreme_step
from fenics_ehd.plotting.maps import ANGLES, NORMALS, draw_rasters, raster_of
from fenics_ehd.plotting.picture import BLACK, BLUE, PRESSURES, RED, YELLOW, factor_of, plt
from fenics_ehd.plotting.shown import TIME, ShownRun, film_grid
from fenics_ehd.reduction.body import ReducedBody, load_body
from fenics_ehd.reduction.bore import outward, rigid_fields
from fenics_ehd.scenes.part_settings import ReductionSettings
from fenics_ehd.study.plan import REFERENCE
from fenics_ehd.study.report.study_data import (
    CURVES,
    FILM,
    Columns,
    Curve,
    JointData,
    StudyData,
    StudyRow,
)

COLOURS = {"m1": YELLOW, "m2": RED, "m3": BLUE, "m4": BLACK}
MARKERS = {"m1": "s", "m2": "^", "m3": "o", "m4": "D"}

#: Markers of M3 by pressure set; the fill of the marker shows the selection of modes.
PRESSURE_MARKERS = {"pc1": "p", "pc2-long": ">", "pc2-short": "<", "journal": "P"}

#: Marker of an error that is below the reference's own error.
BOUND = "v"

#: Label of such errors in the legend.
BOUND_LABEL = "below the reference's own error, an upper limit"
FILLS = {"largest-eigenvalue": "none", "smallest-eigenvalue": "bottom"}

#: Default tolerance of M4, which labels do not mention.
TOLERANCE = ReductionSettings().flexibility_tolerance

#: Colour of the reference's curve, which is a broad band behind all others.
GREY = "#BBBBBB"

#: Colour of the band of the reference's own errors, and its label.
FLOOR = "#DDDDDD"
FLOOR_LABEL = "reference's own error"

SELECTIONS = {
    "lowest-frequency": ("lowest frequencies", "-"),
    "largest-eigenvalue": ("largest eigenvalues", "--"),
    "smallest-eigenvalue": ("smallest eigenvalues", ":"),
    "every-column": ("every column", "-."),
}

#: Width of a figure [inches], and number of columns of its legend.
WIDTH = 10.5
LEGEND_COLUMNS = 3


def family(row: StudyRow) -> str:
    """Name of a family of runs: the method and its settings, except the number of modes."""
    name = {"full": "full interface", "rigid": "rigid"}.get(row["method"], row["method"].upper())
    if row["method"] == "m3":
        return f"{name} {row['pressure_set']}, {selection(row)[0]}"
    if not tightened(row):
        return name
    tolerance = row["flexibility_tolerance"]
    return f"{name}, verified to {tolerance:g}" if tolerance else f"{name}, every nodal pressure"


def sized(row: StudyRow) -> str:
    """Name of a run: its family, and its number of coordinates."""
    return f"{family(row)}, {row['coordinates']:.0f} coordinates"


def selection(row: StudyRow) -> tuple[str, Any]:
    """Name in words and line style of the rule by which M3 selects residual modes in a run."""
    return SELECTIONS.get(row["selection"], (row["selection"], "-"))


def tightened(row: StudyRow) -> bool:
    """True if M4 has a smaller flexibility tolerance in a run than by default."""
    return row["method"] == "m4" and row["flexibility_tolerance"] < TOLERANCE


def line_style(row: StudyRow) -> dict[str, Any]:
    """Arguments of `Axes.plot` for the curve of a run's family."""
    marker = MARKERS.get(row["method"], "x")
    fill = FILLS.get(row["selection"], "full")
    if tightened(row):
        fill = "bottom" if row["flexibility_tolerance"] else "none"
    return {
        "color": colour(row),
        "marker": PRESSURE_MARKERS.get(row["pressure_set"], marker),
        "markerfacecoloralt": "white",
        "linestyle": selection(row)[1],
        "fillstyle": fill,
    }


def families(
    rows: Iterable[StudyRow], name: Callable[[StudyRow], str] = family
) -> dict[str, list[StudyRow]]:
    """Lists of runs by the name of their family.

    A list is sorted by the numbers of coordinates, step tolerances and numbers of film cells.
    """

    def order(row: StudyRow) -> tuple[str, float, float, int]:
        return name(row), row["coordinates"], row["tolerance"], cells(row)

    grouped: dict[str, list[StudyRow]] = {}
    for row in sorted(rows, key=order):
        grouped.setdefault(name(row), []).append(row)
    return grouped


def colour(row: StudyRow) -> str:
    """Colour of a run, which is that of its method."""
    return COLOURS.get(row["method"], "0.4")


def percent_axes(axes: Axes, xlabel: str, ylabel: str) -> None:
    """Make both axes of a panel logarithmic, with labels; y has errors in per cent."""
    axes.set(xscale="log", yscale="log", xlabel=xlabel, ylabel=ylabel)
    plain_figures(axes.yaxis)


def plain_figures(axis: Axis, at: tuple[float, ...] = (1.0, 2.0, 5.0)) -> None:
    """Label ticks with plain numbers at the given multiples of every power of ten."""
    axis.set_major_locator(LogLocator(subs=at))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(NullLocator())


def draw_floor(axes: Axes, floor: float, label: str = FLOOR_LABEL) -> None:
    """Draw a grey band below the reference's own error `floor` [%].

    The y axis starts within the band.
    """
    if floor > 0:
        axes.axhspan(floor / 10, floor, color=FLOOR, zorder=0, linewidth=0, label=label)
        axes.set_ylim(bottom=floor / 1.6)


def joint_figure(
    shown: Mapping[JointData, Any],
    height: float,
    draw: Callable[[Axes, Any, JointData, Curve], None],
    curves: Sequence[Curve] = CURVES,
) -> Figure | None:
    """Figure with a row of panels for each joint, one panel for each curve.

    The result is None if there is no joint, or if a joint has no data.

    Parameters
    ----------
    shown
        Data for the panels of a joint, by joint.
    height
        Height of a row [inches].
    draw
        Function that draws one panel from its axes, the data, the joint and the curve.
    curves
        Curves of the panels in a row, by default peak pressure and minimum film thickness.
    """
    if not shown or not all(shown.values()):
        return None
    size = (WIDTH, height * len(shown))
    figure, panels = plt.subplots(
        len(shown), len(curves), figsize=size, layout="constrained", squeeze=False
    )
    for row, (joint, content) in zip(panels, shown.items(), strict=True):
        row[0].set_title(joint.name, loc="left", fontweight="bold")
        for axes, curve in zip(row, curves, strict=True):
            draw(axes, content, joint, curve)
    legend_below(figure)
    return figure


def legend_below(figure: Figure) -> None:
    """Add one legend below all panels, in added space; every label appears once."""
    handles = {
        label: handle
        for axes in figure.axes
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    width, height = figure.get_size_inches()
    room = 0.2 * math.ceil(len(handles) / LEGEND_COLUMNS) + 0.12
    figure.set_size_inches(width, height + room)
    share = room / (height + room)
    figure.get_layout_engine().set(rect=(0, share, 1, 1 - share))
    figure.legend(
        list(handles.values()),
        list(handles),
        loc="lower center",
        ncols=LEGEND_COLUMNS,
        frameon=False,
        borderaxespad=0.2,
    )


#: Columns of the table with costs, and their labels on an axis.
ONLINE = "online_s"
COORDINATES = "coordinates"
LABELS = {
    ONLINE: "time integration [s of processor time]",
    COORDINATES: "elastic coordinates",
}

#: Style of markers for runs with other step tolerances than the scene's.
SMALL = {"linestyle": "", "alpha": 0.55, "markersize": 4, "zorder": 1.5}

#: Smallest ratio of the costs or of the errors of two labelled points of the Pareto front.
LABEL_DISTANCE = 1.6

#: Type for a run in a diagram: cost, error [%], row of the table.
Point = tuple[float, float, StudyRow]


def lower_left(points: Sequence[Point]) -> list[Point]:
    """Points of the Pareto front: no other point has both a lower cost and a lower error.

    The points are sorted by ascending cost, and therefore by descending error.
    """
    hull: list[Point] = []
    for point in sorted(points, key=lambda p: (p[0], p[1])):
        if not hull or point[1] < hull[-1][1]:
            hull.append(point)
    return hull


def draw_cost(joints: Sequence[JointData], cost: str) -> Figure | None:
    """Draw the errors of pressure and film thickness of all runs against their cost.

    `cost` is the column of the table with a time or with the number of coordinates. If it is the
    time of the run, the Pareto front is drawn as well. The result is None if there are no runs.
    """
    groups = ("methods", "tolerance") if cost == ONLINE else ("methods",)

    def draw(axes: Axes, rows: list[StudyRow], _: JointData, curve: Curve) -> None:
        percent_axes(axes, LABELS[cost], f"largest error of {curve.title} [%]")
        plain_figures(axes.xaxis)
        if cost == ONLINE:
            _draw_hull(axes, [(row[cost], 100 * row.visible_error(curve), row) for row in rows])
        _draw_points(axes, rows, cost, curve)
        draw_floor(axes, 100 * max(row.floor(curve) for row in rows))

    shown = {joint: [row for row in joint.measured(*groups) if row[cost] > 0] for joint in joints}
    return joint_figure(shown, 4.4, draw)


def _draw_points(axes: Axes, rows: Sequence[StudyRow], cost: str, curve: Curve) -> None:
    """Draw the errors of runs against a cost, with lines from few modes to many.

    Runs at other step tolerances have small markers.

    A run whose error is below the reference's own error is drawn at the edge of the grey band, with
    the marker `BOUND`.
    """
    for label, members in families([r for r in rows if r["group"] == "methods"]).items():
        errors = [100 * row.visible_error(curve) for row in members]
        seen = [i for i, row in enumerate(members) if not row.bounded(curve)]
        style = line_style(members[0]) | {"linewidth": 1.2}
        axes.plot([row[cost] for row in members], errors, label=label, markevery=seen, **style)
    others = "small markers: other step tolerances"
    for row in rows:
        style = line_style(row)
        point = (row[cost], 100 * row.visible_error(curve))
        if row.bounded(curve):
            axes.plot(*point, BOUND, color=style["color"], label=BOUND_LABEL)
        elif row["group"] != "methods":
            axes.plot(*point, label=others, **(style | SMALL))


def _draw_hull(axes: Axes, points: Sequence[Point]) -> None:
    """Draw the Pareto front, with labels for method, coordinates and tolerance of its runs."""
    hull = lower_left(points)
    costs, errors, _ = zip(*hull, strict=True)
    axes.plot(
        costs,
        errors,
        drawstyle="steps-post",
        color="#33AA55",
        linewidth=5,
        alpha=0.35,
        zorder=1,
        solid_capstyle="round",
        label="Pareto front: no run is both faster and more accurate",
    )
    for x, y, row in _apart(hull):
        words = f"{row['method'].upper()}, {row['coordinates']:.0f}, {row['tolerance']:.0e}"
        # Labels are below and to the left of the Pareto front, where there are no points.
        label = axes.annotate(words.replace("e-0", "e-"), (x, y), xytext=(-4, -4), fontsize=7.5,
                              textcoords="offset points", ha="right", va="top")  # fmt: skip
        label.set_in_layout(False)
    # The axis is extended to the left for the labels.
    axes.set_xlim(costs[0] / 2.5, 1.3 * max(x for x, _, _ in points))


def _apart(hull: Sequence[Point]) -> list[Point]:
    """Points of the Pareto front that are far enough apart for labels, most accurate first."""
    kept = [hull[-1]]
    for x, y, row in reversed(hull[:-1]):
        last_x, last_y, _ = kept[-1]
        if max(last_x / x, y / last_y) >= LABEL_DISTANCE:
            kept.append((x, y, row))
    return kept


#: Ratio of the limits of a short axis, above which only powers of ten are labelled.
CROWDED = 100

Points = list[tuple[float, float]]


def tolerance_series(joint: JointData, curve: Curve) -> dict[str, tuple[StudyRow, Points]]:
    """Step errors against tolerance, for every model that is run with several tolerances.

    For each model, by name, the result has the row of its first run, and points (tolerance, step
    error) of all its runs. A step error is relative to a run of the same model with very fine
    steps; it is at least the step error of the reference.
    """
    column = f"own_{curve.key}_error_max"
    floor = joint.own_error("step", curve)
    # Runs with the very fine steps themselves have no such error.
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
    """Exponent of the step error as a power of the tolerance.

    A straight line is fitted by least squares to the logarithms of all points with errors above
    twice the `floor`. The result is nan if there are fewer than two such points.
    """
    above = [point for point in points if not point[1] <= 2 * floor]
    if len(above) < 2:
        return math.nan
    tolerance, error = np.log(np.array(above)).T
    return float(np.polyfit(tolerance, error, 1)[0])


def draw_tolerances(joints: Sequence[JointData]) -> Figure | None:
    """Draw step errors against tolerance, with the slope of each series; None without points."""

    def draw(axes: Axes, _: object, joint: JointData, curve: Curve) -> None:
        floor = joint.own_error("step", curve)
        series = tolerance_series(joint, curve)
        slopes = ["slopes"]
        percent_axes(axes, "time.tolerance", f"largest step error of {curve.title} [%]")
        for label, (row, points) in series.items():
            exponent = slope(points, floor)
            slopes += [f"{family(row)}: {exponent:.2f}"] if math.isfinite(exponent) else []
            axes.plot(*(np.array(points) * [1, 100]).T, label=label, **line_style(row))
        _draw_guide(axes, *min(series.values(), key=lambda item: item[1][-1][1]))
        draw_floor(axes, 100 * floor)
        axes.text(0.03, 0.97, "\n".join(slopes), transform=axes.transAxes, va="top", fontsize=8.5)

    return joint_figure({joint: tolerance_series(joint, FILM) for joint in joints}, 4.2, draw)


def _draw_guide(axes: Axes, row: StudyRow, points: Points) -> None:
    """Draw a line below the points with the theoretical slope p / (p + 1), for formulas of order p.

    The local error, which is of order p + 1 in the step, is proportional to the tolerance. Steps
    are therefore proportional to tolerance^(1/(p+1)), and the error of the curve to
    tolerance^(p/(p+1)).
    """
    if not math.isfinite(row["order"]):
        return
    (first, _) = points[0]
    (last, error) = points[-1]
    line = np.array([first, last])
    order = round(row["order"])
    axes.plot(line, 50 * error * (line / last) ** (order / (order + 1)), color="0.5",
              linewidth=1, linestyle=(0, (6, 2)), label=f"slope {order}/{order + 1}")  # fmt: skip


def draw_film_meshes(joints: Sequence[JointData]) -> Figure | None:
    """Draw errors against the number of film cells; None if a joint has fewer than two meshes."""

    def draw(axes: Axes, rows: list[StudyRow], joint: JointData, curve: Curve) -> None:
        finest = max((row for row in joint.planned("film") if row.complete), key=cells)
        against = f"against {finest['film_cells']} cells [%]"
        percent_axes(axes, "cells of the film", f"largest error of {curve.title}\n{against}")
        plain_figures(axes.xaxis)
        for label, members in families(rows).items():
            errors = [100 * row.visible_error(curve) for row in members]
            axes.plot([*map(cells, members)], errors, label=label, **line_style(members[0]))
        sizes = {cells(row): f"{cells(row)}\n{row['film_cells']}" for row in rows}
        axes.set_xticks([*sizes], [*sizes.values()])
        floor = max(row.floor(curve) for row in rows)
        draw_floor(axes, 100 * floor, "error of the last mesh but one")

    rows = {joint: joint.measured("film") for joint in joints}
    several = [len(set(map(cells, members))) > 1 for members in rows.values()]
    return joint_figure(rows, 3.9, draw) if all(several) else None


def cells(row: StudyRow) -> int:
    """Number of film cells, from a text such as ``20x5``; 0 if the table has none."""
    return math.prod(map(int, row["film_cells"].split("x"))) if row["film_cells"] else 0


def gap_floor(joint: JointData) -> float:
    """Error of the gap in the reference itself, largest over all points and times [m].

    The error is computed from the runs that check the reference. The run on another film mesh is
    excluded, because its error is common to all runs. The result is 0 if the error is unknown.
    """
    film = (joint.study.reference.get("film") or {}).get("run")
    rows = [row for row in joint.measured("reference") if row["run"] != film]
    return float(np.nanmax([0.0, *(row["true_gap_error_m"] for row in rows)]))


def draw_estimates(joints: Sequence[JointData]) -> Figure | None:
    """Draw estimated against true gap errors of every run; None if no run has an estimate."""

    def draw(axes: Axes, rows: list[StudyRow], joint: JointData, _: Curve) -> None:
        values = []
        floor = gap_floor(joint)
        for label, members in families(rows).items():
            true = [1e6 * max(row["true_gap_error_m"], floor) for row in members]
            estimates = [1e6 * row["estimated_gap_error_m"] for row in members]
            values += true + estimates
            axes.plot(true, estimates, label=label, **(line_style(members[0]) | {"linestyle": ""}))
        line = np.array([0.5 * min(values), 2 * max(values)])
        axes.plot(line, line, color="0.4", linewidth=1)
        axes.fill_between(line, line / 2, 2 * line, color="#33AA55", alpha=0.15, linewidth=0,
                          label="within a factor of two")  # fmt: skip
        if 1e6 * floor > line[0]:
            axes.axvspan(line[0], 1e6 * floor, color=FLOOR, linewidth=0, zorder=0,
                         label=FLOOR_LABEL)  # fmt: skip
        axes.set(xscale="log", yscale="log", xlim=line, ylim=line, aspect="equal")
        axes.set_xlabel("largest true error of the gap [µm]")
        axes.set_ylabel("error of the gap estimated by the run [µm]")
        for axis in (axes.xaxis, axes.yaxis):
            plain_figures(axis, (1.0,) if line[1] > CROWDED * line[0] else (1.0, 2.0, 5.0))

    rows = {
        joint: [
            row
            for row in joint.measured("methods")
            if row["estimated_gap_error_m"] > 0 and row["true_gap_error_m"] > 0
        ]
        for joint in joints
    }
    # Joints with a rigid bore have no estimate.
    estimated = {joint: members for joint, members in rows.items() if members}
    return joint_figure(estimated, 4.9, draw, (FILM,))


#: Line styles of the curves of one method, from few modes to many.
LINES = (":", "--", "-.", "-")

#: Part of the simulated time in which the film builds up; its large films do not set the scale.
BUILD_UP = 0.1


def best(study: StudyData, method: str) -> list[StudyRow]:
    """List of one run: the run of a method whose largest error is smallest; empty without runs."""
    rows = study.joints[0].measured("methods", method=method)
    return sorted(rows, key=lambda row: study.worst_error(row["run"]))[:1]


def alike(study: StudyData) -> list[StudyRow]:
    """One run of every method: runs with similar numbers of coordinates, and the best run of M4."""
    methods = sorted(COLOURS.keys() - {"m4"})
    runs = [study.joints[0].measured("methods", method=method) for method in methods]
    size = float(np.median([row["coordinates"] for members in runs for row in members] or [0.0]))

    def distance(row: StudyRow) -> tuple[float, float]:
        return abs(row["coordinates"] - size), study.worst_error(row["run"])

    return [min(members, key=distance) for members in runs if members] + best(study, "m4")


def _time_label(study: StudyData) -> str:
    """Label of the time axis: the curves of a periodic study are those of its last cycle."""
    reference = study.history(REFERENCE)
    periodic = reference is not None and reference.cycle.periodic
    return "time in the cycle [ms]" if periodic else "time [ms]"


def draw_methods(study: StudyData, rows: Sequence[StudyRow]) -> Figure | None:
    """Draw pressure and film curves of some runs and of the reference over time.

    The result is None without a run of the reference.
    """
    runs = [study.history(row["run"]) for row in rows]

    def draw(axes: Axes, reference: History, joint: JointData, curve: Curve) -> None:
        time = reference.time
        true = factor_of(curve.label) * reference.joints[joint.name][curve.quantity]
        axes.plot(1e3 * time, true, color=GREY, linewidth=4.5, solid_capstyle="butt",
                  label="reference")  # fmt: skip
        for i, (row, history) in enumerate(zip(rows, runs, strict=True)):
            if history is None:
                continue
            dashes = LINES[(i - len(rows)) % len(LINES)]
            values = factor_of(curve.label) * history.joints[joint.name][curve.quantity]
            axes.plot(
                1e3 * history.time, values, color=colour(row), linestyle=dashes, label=sized(row)
            )
        axes.set(xlabel=_time_label(study), ylabel=curve.label)
        axes.margins(x=0)
        axes.set_ylim(bottom=0)
        if curve is FILM:
            later = time >= (BUILD_UP * time[-1] if study.info["start"] > 0 else 0.0)
            axes.set_ylim(top=1.15 * float(true[later].max()))

    return joint_figure(dict.fromkeys(study.joints, study.history(REFERENCE)), 3.9, draw)


def draw_errors(study: StudyData, rows: Sequence[StudyRow]) -> Figure | None:
    """Draw the errors of some runs over time; None without runs.

    Errors below the reference's own error are not drawn.
    """

    def draw(
        axes: Axes, errors: list[tuple[StudyRow, Columns]], joint: JointData, curve: Curve
    ) -> None:
        floor = max((row.floor(curve) for row in joint.measured("methods")), default=0.0)
        if floor > 0:
            # The scale is linear up to the first power of ten outside the band, where ticks start.
            linear = 10.0 ** np.ceil(np.log10(100 * floor))
            axes.set_yscale("symlog", linthresh=linear, linscale=0.4)
            axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
            axes.axhspan(-100 * floor, 100 * floor, color=FLOOR, linewidth=0, label=FLOOR_LABEL)
        for row, over_time in errors:
            error = over_time[f"{curve.key}_error"]
            axes.plot(
                1e3 * over_time["time_s"],
                100 * np.where(np.abs(error) < floor, np.nan, error),
                color=colour(row),
                linestyle=selection(row)[1],
                label=sized(row),
            )
        axes.axhline(0, color="0.3", linewidth=0.8)
        axes.margins(x=0)
        of = "of the film" if curve is FILM else "of the reference's peak"
        axes.set(xlabel=_time_label(study), ylabel=f"error of {curve.title}\n[% {of}]")
        axes.set_xlim(left=1e3 * study.info["start"])

    errors = {
        joint: [(row, curves) for row in rows if (curves := joint.errors_over_time(row["run"]))]
        for joint in study.joints
    }
    return joint_figure(errors, 3.9, draw)


#: Height of a row of mode shapes [inches].
ROW_HEIGHT = 1.75

#: Number of modes in a row, and largest deflection in the picture over the bore radius.
COLUMNS = 6
DEFLECTION = 0.32

#: Line styles of the circles of the bore that are drawn, by the height of the circle.
RINGS: dict[str, dict[str, Any]] = {
    "lower edge": {"linewidth": 0.9, "linestyle": ":"},
    "upper edge": {"linewidth": 0.9, "linestyle": "--"},
    "middle": {"linewidth": 1.8},
}

#: Kinds of modes that are drawn for each method.
SHOWN = {
    "m1": ("fixed-boundary",),
    "m2": ("fixed-boundary",),
    "m3": ("vibration", "static"),
    "m4": ("quasi-static",),
}


def best_bodies(study: StudyData) -> dict[str, dict[str, ReducedBody]]:
    """Reduced bodies of the best run of each method, by bore and by method.

    The name of a bore is that of its body; if the body has several bores, the bore's name is added.
    """
    by_joint: dict[str, dict[str, ReducedBody]] = {}
    for row in (row for method in SHOWN for row in best(study, method)):
        for path in sorted(study.folder(row["run"]).glob("body-*.h5")):
            body = load_body(path)
            name = path.stem.removeprefix("body-")
            for bore in body.bores:
                key = f"{name}_{bore}" if len(body.bores) > 1 else name
                by_joint.setdefault(key, {})[row["method"]] = body.at_bore(bore)
    return by_joint


def first_shapes(body: ReducedBody, kind: str) -> tuple[np.ndarray, list[str]]:
    """Displacements of a bore's m nodes in the first c modes of a kind, and a note on each mode.

    The displacements have the shape (m, 3, c). Modes are sorted by frequency. Quasi-static patterns
    have no frequency and are sorted by their largest displacement.
    """
    if kind == "quasi-static":
        patterns = body.residual.displacement if body.residual else np.empty((0, 3, 0))
        order = np.argsort(-np.abs(patterns).max(axis=(0, 1), initial=0.0), kind="stable")
        return patterns[:, :, order[:COLUMNS]], ["no inertia"] * min(len(order), COLUMNS)
    order = np.argsort(body.frequencies, kind="stable")
    members = [i for i in order if body.kinds[i] == kind][:COLUMNS]
    notes = [f"{body.frequencies[i] * 1e-3:.3g} kHz" for i in members]
    return body.bore_basis[:, :, members], notes


def draw_mode_shapes(bodies: Mapping[str, ReducedBody]) -> Figure | None:
    """Draw the first mode shapes of a bore, reduced by several methods; None without bodies."""
    shown = [
        (method, kind, body, *first_shapes(body, kind))
        for method, body in bodies.items()
        for kind in SHOWN[method]
    ]
    shown = [row for row in shown if row[-1]]
    if not shown:
        return None
    size = (WIDTH, ROW_HEIGHT * len(shown))
    figure, panels = plt.subplots(
        len(shown), COLUMNS, figsize=size, layout="constrained", squeeze=False
    )
    for axes in panels.flat:
        axes.set_axis_off()
    for row, (method, kind, body, shapes, notes) in zip(panels, shown, strict=True):
        title = f"{method.upper()}, {kind} modes"
        row[0].set_title(title, loc="left", fontsize=10, fontweight="bold")
        circles = _circles(body, shapes)
        for axes, circle, note in zip(row, np.moveaxis(circles, -1, 0), notes, strict=False):
            _draw_shape(axes, circle, COLOURS[method])
            axes.text(0, 0, note, ha="center", va="center", fontsize=8.5)
    legend_below(figure)
    return figure


def _circles(body: ReducedBody, shapes: np.ndarray) -> np.ndarray:
    """Radial displacements of three circles of a bore, in c modes, without its rigid motion.

    The circles are those of `RINGS`, evaluated at the a angles `ANGLES`: shape (3, a, c). `shapes`
    are the displacements of the bore's m nodes in the modes, shape (m, 3, c).
    """
    bore = body.bore
    rigid = rigid_fields(bore.coordinates)
    flat = shapes.reshape(len(rigid), -1)
    share, *_ = np.linalg.lstsq(rigid, flat, rcond=None)
    radial = outward(bore.coordinates, (flat - rigid @ share).reshape(shapes.shape))
    ends = bore.coordinates[:, 2].min(), bore.coordinates[:, 2].max()
    angle, height = np.meshgrid(ANGLES, [*ends, np.mean(ends)])
    surface = bore_surface(bore.coordinates, bore.cells, bore.family)
    reading = interpolation_matrix(surface, angle.ravel(), height.ravel())
    return (reading @ radial).reshape(*angle.shape, -1)


def _draw_shape(axes: Axes, circles: np.ndarray, colour: str) -> None:
    """Draw a bore in one mode; `circles` are radial displacements of its circles, shape (3, a)."""
    axes.plot(*NORMALS, color="0.75", linewidth=0.8)
    radii = 1 + DEFLECTION * circles / np.abs(circles).max()
    for radius, (label, style) in zip(radii, RINGS.items(), strict=True):
        axes.plot(*(radius * NORMALS), color=colour, label=label, **style)
    axes.set(aspect="equal", xlim=(-1.38, 1.38), ylim=(-1.38, 1.38))


def draw_pressure(joint: JointData) -> Figure | None:
    """Draw the reference's pressure at its peak and at the thinnest film; None without a run."""
    history = joint.study.history(REFERENCE, films=True)
    if history is None:
        return None
    film_history = history.joints[joint.name]
    grid = film_grid(film_history.film)
    pressure = 1e-6 * film_history.film.pressure
    shown = ShownRun(REFERENCE, history).joints[joint.name]
    rasters = []
    for moment, column in (
        ("highest pressure", "max_pressure_Pa"),
        ("thinnest film", "min_film_thickness_m"),
    ):
        step = extreme_step(column, film_history.columns[column])
        time, value = shown.extreme(column, TIME) or (1e3 * history.time[step], None)
        raster = raster_of(grid, pressure[step], f"{moment}, {time:.3f} ms")
        if value is not None and column == "max_pressure_Pa":
            raster = raster._replace(mark=(1e-6 * value, *raster.mark[1:]))
        rasters.append(raster)
    return draw_rasters([rasters], "pressure [MPa]", PRESSURES)
