"""Diagrams of columns over the crank angle or time, and of paths of vectors over a cycle.

Angles on a bore are from -180 to 180 degrees in all pictures, as in the files of a run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from textwrap import fill

import fenics_ehd.base.matplotlib_start  # noqa: F401  # isort: skip
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, MultipleLocator
from scipy.interpolate import PchipInterpolator

from fenics_ehd.plotting.picture import (
    BLUE,
    PANEL,
    RED,
    WIDTH,
    factor_of,
    legend,
    plt,
    style,
    with_unit,
)
from fenics_ehd.plotting.shown import ANGLE, TIME, ShownJoint

#: Type for the shown joints: results of a joint in one or more runs, by the name of the joint.
Rows = Mapping[str, Sequence[ShownJoint]]

#: Height of a single panel, and of one panel among several [inches].
ALONE = 4.0
STACKED = 2.7

#: Ending of columns with angles that jump by 360 degrees.
AROUND = "_angle_deg"

#: Part of the time of an initial value problem, at its start, that does not set the upper limit of
#: an axis: the film is thick there, and later films would not be visible.
BUILD_UP = 0.1


#: Largest ratio of the values on a logarithmic axis: the error at the start of a run is round-off.
DECADES = 1e5

#: Largest number of curves whose legend is inside of the axes; that of more is above them.
MOST_INSIDE = 4

#: Number of characters of a label after which it continues in the next line.
LABEL_WIDTH = 30


@dataclass(frozen=True)
class Panel:
    """Columns of a history that share an axis.

    Attributes
    ----------
    label
        Label of the axis, with the unit in brackets.
    columns
        Labels of curves by column name, or by a pattern of names with a star. An empty label is
        replaced by the text that the star matches.
    extreme
        Function that selects the extreme to mark and label, `numpy.argmax` or `numpy.argmin`; None
        for no mark.
    mean
        Whether the mean over time is drawn and labelled.
    scale
        ``"zero"`` for a linear axis from zero, ``"linear"``, ``"log"``, or ``"angle"`` for a turn.
    budget
        Quantity in the run's error budget whose total error is drawn as a band; empty for no band.
    unchanged
        Whether columns that are zero throughout are drawn.
    """

    label: str
    columns: Mapping[str, str]
    extreme: Callable[[np.ndarray], np.intp] | None = None
    mean: bool = False
    scale: str = "zero"
    budget: str = ""
    unchanged: bool = False

    def labels_of(self, columns: Mapping[str, np.ndarray]) -> dict[str, str]:
        """Labels of those columns of a run that the panel can draw, by column."""
        shown = {}
        for pattern, called in self.columns.items():
            for name, values in columns.items():
                if fnmatchcase(name, pattern) and (self.unchanged or _is_known(values)):
                    star = name.removesuffix(pattern.removeprefix("*")).strip("_.")
                    shown[name] = called or star.replace("_", " ")
        return shown


@dataclass(frozen=True)
class Curves:
    """Figure with panels below each other; the panels of the first joint are on top.

    Attributes
    ----------
    panels
        Panels of one joint, in the order in which they are drawn.
    of_run
        Whether the curves belong to a run, and not to a joint.
    needed
        Column without which the figure is not drawn; empty if any column of the panels suffices.
    """

    panels: tuple[Panel, ...]
    of_run: bool = False
    needed: str = ""

    def has(self, joint: ShownJoint) -> bool:
        """True if at least one column of a joint can be drawn."""
        if self.needed and not _is_known(joint.columns.get(self.needed)):
            return False
        return any(panel.labels_of(joint.columns) for panel in self.panels)

    def draw(self, rows: Rows) -> Figure:
        """Draw the figure of joints in one or more runs."""
        cells = []
        for title, joints in rows.items():
            for panel in self.panels:
                if any(panel.labels_of(joint.columns) for joint in joints):
                    cells.append((title, joints, panel))
        height = ALONE if len(cells) == 1 else STACKED * len(cells)
        figure, axes = plt.subplots(
            len(cells), figsize=(WIDTH, height), layout="constrained", sharex=True, squeeze=False
        )
        for panel_axes, (title, joints, panel) in zip(axes.flat, cells, strict=True):
            draw_panel(panel_axes, joints, panel)
            panel_axes.set_title(title, loc="left", fontweight="bold")
            panel_axes.label_outer()
        return figure

    def difference(self, rows: Rows) -> Figure:
        """Draw the figure of differences: second run minus first run of every joint."""
        less = {title: [subtracted(*joints)] for title, joints in rows.items()}
        panels = tuple(
            replace(panel, label=f"difference of\n{panel.label}", scale="linear",
                    extreme=_largest, mean=False, budget="", unchanged=True)
            for panel in self.panels
        )  # fmt: skip
        return replace(self, panels=panels).draw(less)


def _is_known(values: np.ndarray | None) -> bool:
    """True if a column has finite values that are not zero throughout."""
    return values is not None and bool(np.any(np.nan_to_num(values)))


def _largest(values: np.ndarray) -> np.intp:
    return np.argmax(np.abs(values))


def draw_panel(axes: Axes, joints: Sequence[ShownJoint], panel: Panel) -> None:
    """Draw the panel of one joint, with the curves of one or more runs."""
    over = common_axis(joints)
    curves = [
        (joint, *column) for joint in joints for column in panel.labels_of(joint.columns).items()
    ]
    drawn = []
    for number, (joint, column, called) in enumerate(curves):
        look = style(number)
        x, y = over_cycle(joint, factor_of(panel.label) * joint.columns[column], over)
        figures = []
        if panel.extreme is not None:
            known = np.flatnonzero(np.isfinite(y))  # some steps have no error estimate
            extreme = known[panel.extreme(y[known])]
            point = x[extreme], y[extreme]
            # The extreme of a difference is not in a summary.
            if panel.extreme in (np.argmax, np.argmin):
                position, of_summary = joint.extreme(column, over) or (point[0], None)
                if of_summary is not None:
                    point = position, factor_of(panel.label) * of_summary
            axes.plot(*point, "o", color=look["color"], markersize=5, zorder=4)
            value = with_unit(point[1], panel.label)
            if (errors := _reported_errors(joint, panel.budget)) is not None:
                of_extreme, largest = errors
                value += f" (± {100 * of_extreme:.2g} %)"
                # Errors of pressures are relative to the peak, those of films to the film then.
                half = largest * (y.max() if panel.extreme is np.argmax else y)
                axes.fill_between(
                    x, y - half, y + half, color=look["color"], alpha=0.25, linewidth=0
                )
            figures.append(f"{value} at {position_label(point[0], over)}")
        if panel.mean:
            average = factor_of(panel.label) * joint.mean(column)
            axes.axhline(average, color=look["color"], linewidth=0.8, alpha=0.7, zorder=1)
            figures.append(f"mean {with_unit(average, panel.label)}")
        parts = ", ".join(filter(None, (name_among(joint, joints), called)))
        label = ": ".join(filter(None, (parts, ", ".join(figures))))
        if panel.scale == "angle":
            y = np.where(np.abs(np.diff(y, append=y[-1])) > 180.0, np.nan, y)  # once around
        axes.plot(x, y, label=label or None, **look)
        drawn.append((x, y))
    _lay_out(axes, joints, panel, over, drawn)


def name_among(joint: ShownJoint, joints: Sequence[ShownJoint]) -> str:
    """Name of a joint's curve among those of several joints: of its run, or its own in one run.

    The name of the only curve is empty.
    """
    if len(joints) == 1:
        return ""
    return joint.name if len({id(other.run) for other in joints}) == 1 else joint.run.name


def _reported_errors(joint: ShownJoint, quantity: str) -> tuple[float, float] | None:
    """Estimated relative errors: of a quantity's extreme, and the largest over its curve.

    The result is None if one of them is not estimated.
    """
    budget = joint.run.figures.get(joint.name, {}).get("error_budget", {})
    if quantity not in budget:
        return None
    errors = budget[quantity]["total"], budget["largest_over_cycle"][quantity]["total"]
    return None if any(isinstance(error, str) for error in errors) else errors


def position_label(x: float, over: str) -> str:
    """Text of a position on the common axis: an angle in degrees, or a time in ms."""
    return f"{x:.0f}°" if over == ANGLE else f"{x:.3f} ms"


def common_axis(joints: Sequence[ShownJoint]) -> str:
    """Column for the horizontal axis: crank angle if all joints have this column, else time."""
    return ANGLE if all(ANGLE in joint.columns for joint in joints) else TIME


def over_cycle(joint: ShownJoint, values: np.ndarray, over: str) -> tuple[np.ndarray, np.ndarray]:
    """Sort values by their positions on the axis `over` [degrees] or [ms]; return both."""
    x = joint.columns[over] * (1.0 if over == ANGLE else 1e3)
    order = np.argsort(x, kind="stable")
    return x[order], values[order]


def span(over: str, joints: Sequence[ShownJoint]) -> float:
    """Distance between two ticks on the horizontal axis `over` [degrees] or [ms]."""
    longest = max(np.ptp(joint.columns[over]) for joint in joints)
    if over == ANGLE:
        return 90.0 if longest > 400.0 else 45.0
    ticks = MaxNLocator(8, steps=[1, 2, 5, 10]).tick_values(0.0, max(1e3 * longest, 1e-9))
    return float(ticks[1] - ticks[0])


def _lay_out(
    axes: Axes,
    joints: Sequence[ShownJoint],
    panel: Panel,
    over: str,
    curves: Sequence[tuple[np.ndarray, np.ndarray]],
) -> None:
    """Set limits, ticks, labels and legend of a panel."""
    axes.set_ylabel("\n".join(fill(line, LABEL_WIDTH) for line in panel.label.splitlines()))
    label = "".join(f", {joint.run.label}" for joint in joints[:1] if joint.run.label)
    run = joints[0].run
    axes.set_xlabel((f"{run.angle_name} [°]" if over == ANGLE else f"{run.time_name} [ms]") + label)
    known = np.concatenate([x for x, _ in curves])  # errors may be unknown at the ends
    axes.set_xlim(known.min(), known.max() if np.ptp(known) else None)
    axes.xaxis.set_major_locator(MultipleLocator(span(over, joints)))
    if panel.scale == "log":
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        low, high = axes.get_ylim()
        axes.set_ylim(max(low, high / DECADES))
        axes.grid(alpha=0.15, which="minor")
    elif panel.scale == "angle":
        axes.set(ylim=(-180, 180), yticks=np.arange(-180, 181, 90))
    elif panel.scale == "zero":
        high = axes.get_ylim()[1]
        if panel.extreme is np.argmin and all(joint.run.starts for joint in joints):
            late = [y[x >= x[0] + BUILD_UP * np.ptp(x)] for x, y in curves]
            high = 1.15 * max(np.nanmax(y) for y in late)
        lowest = min(np.nanmin(y) for _, y in curves)
        axes.set_ylim(1.05 * lowest if lowest < 0.0 else 0.0, high)
    else:
        axes.axhline(0.0, color="0.3", linewidth=0.8, zorder=1)
    if len(axes.get_legend_handles_labels()[0]) > MOST_INSIDE:
        legend(axes, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False)
    else:
        legend(axes)


def subtracted(first: ShownJoint, second: ShownJoint) -> ShownJoint:
    """Columns of a joint in the second run minus those in the first, over their common range."""
    over = common_axis((first, second))
    x = [np.sort(joint.columns[over]) for joint in (first, second)]
    low = max(v[0] for v in x)
    high = min(v[-1] for v in x)
    both = np.unique(np.concatenate(x))
    both = both[(both >= low) & (both <= high)]
    values = {
        column: _at(second, column, over, both) - _at(first, column, over, both)
        for column in first.columns
        if column in second.columns and column != over
    }
    for column in values:
        if column.endswith(AROUND):
            values[column] = (values[column] + 180.0) % 360.0 - 180.0
    return replace(second, columns=values | {over: both})


def _at(joint: ShownJoint, column: str, over: str, places: np.ndarray) -> np.ndarray:
    """Values of a column at positions on the axis `over`, by monotone cubic interpolation.

    The errors of linear interpolation would appear as a saw-tooth.
    """
    x, order = np.unique(joint.columns[over], return_index=True)
    values = joint.columns[column][order]
    if column.endswith(AROUND):
        values = np.unwrap(values, period=360.0)
    if len(x) < 2 or not np.isfinite(values).all():
        return np.interp(places, x, values)
    return PchipInterpolator(x, values)(places)


#: Largest number of panels in a row.
ACROSS = 3

#: Largest number of labelled circles in a diagram.
RINGS = 5

#: Smallest distance of two labels, over the radius of the diagram.
APART = 0.16


@dataclass(frozen=True)
class Paths:
    """Polar diagrams of a vector over a cycle, one for every joint.

    Attributes
    ----------
    label
        Label of the magnitude, with its unit in brackets.
    vector
        Function from the columns of a joint to the vector in the frame of the bore, as complex
        numbers x + i y in SI units, shape (t,).
    needed
        Names of the columns that the function needs.
    bound
        Label of the unit circle; empty if the circle is not drawn.
    of_shaft
        Whether the sense of rotation and a mark once in each revolution are drawn, if the journal
        is a rotating shaft.
    """

    label: str
    vector: Callable[[Mapping[str, np.ndarray]], np.ndarray]
    needed: tuple[str, ...]
    bound: str = ""
    of_shaft: bool = False

    def has(self, joint: ShownJoint) -> bool:
        """True if a joint has all needed columns."""
        return all(column in joint.columns for column in self.needed)

    def draw(self, rows: Rows) -> Figure:
        """Draw the figure of joints in one or more runs."""
        across = min(len(rows), ACROSS)
        down = -(-len(rows) // across)
        figure, axes = plt.subplots(
            down, across, figsize=(PANEL * across, (PANEL + 0.6) * down),
            layout="constrained", squeeze=False, subplot_kw={"projection": "polar"},
        )  # fmt: skip
        for unused in axes.flat[len(rows) :]:
            unused.remove()
        for polar_axes, (title, joints) in zip(axes.flat, rows.items(), strict=False):
            self._draw(polar_axes, joints)
            polar_axes.set_title(title, loc="left", fontweight="bold")
        return figure

    def difference(self, rows: Rows) -> Figure:
        """Draw the components of the vector over the cycle: second run minus first run."""
        panel = Panel(self.label, {"vector_x": "x", "vector_y": "y"})
        components = {}
        for title, joints in rows.items():
            vectors = [self.vector(joint.columns) for joint in joints]
            components[title] = [
                replace(j, columns={**j.columns, "vector_x": v.real, "vector_y": v.imag})
                for j, v in zip(joints, vectors, strict=True)
            ]
        return Curves((panel,)).difference(components)

    def _draw(self, axes: Axes, joints: Sequence[ShownJoint]) -> None:
        over = common_axis(joints)
        largest = float(bool(self.bound))
        curves = [
            over_cycle(joint, factor_of(self.label) * self.vector(joint.columns), over)
            for joint in joints
        ]
        largest = max([largest, *(np.abs(vector).max() for _, vector in curves)])
        for number, (joint, (x, vector)) in enumerate(zip(joints, curves, strict=True)):
            label = name_among(joint, joints) or None
            axes.plot(np.unwrap(np.angle(vector)), np.abs(vector), label=label, **style(number))
            _mark(axes, x, vector, number, span(over, joints), APART * largest)
        if self.of_shaft and joints[0].journal_angle is not None:
            vector = factor_of(self.label) * self.vector(joints[0].columns)
            _mark_rotation(axes, joints[0].journal_angle, vector, largest)
        if self.bound:
            around = np.linspace(0, 2 * np.pi, 361)
            axes.plot(around, np.ones(361), color="0.2", linewidth=1.6, label=self.bound)
        axes.set_ylim(0, largest * (1.03 if largest > 1.0 or not self.bound else 1.0))
        angles = np.arange(0, 360, 45)
        axes.set_thetagrids(angles, [f"{(angle + 179) % 360 - 179}°" for angle in angles])
        axes.yaxis.set_major_locator(MaxNLocator(RINGS, steps=[1, 2, 2.5, 5, 10], prune="lower"))
        axes.set_rlabel_position(emptiest_direction([vector for _, vector in curves], largest))
        axes.tick_params(axis="y", labelsize=8, labelcolor="0.3")
        axes.set_xlabel(f"{self.label},\nangles from the x axis of the bore's body")
        legend(axes, loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=2, frameon=False)


def emptiest_direction(vectors: Sequence[np.ndarray], largest: float) -> float:
    """Direction between two spokes of a polar diagram that is farthest from all curves [degrees].

    `vectors` are the curves, shape (t,) each; `largest` is the radius of the diagram.
    """
    directions = np.arange(22.5, 360.0, 45.0)
    radii = np.linspace(0.2, 1.0, 9) * largest  # labels of circles are not at the centre
    rays = np.exp(1j * np.radians(directions))[:, None, None] * radii[:, None]
    distances = np.abs(rays - np.concatenate(vectors)).min(axis=(1, 2))
    return float(directions[np.argmax(distances)])


def orbit(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Eccentricity of the journal in the deformed bore over the clearance, as x + i y."""
    x, y = (columns[f"eccentricity_in_bore_{axis}_m"] for axis in "xy")
    return columns["eccentricity_ratio"] * np.exp(1j * np.arctan2(y, x))


def load(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Load of the journal on the bore [N], as x + i y in the frame of the bore."""
    return columns["force_N"] * np.exp(1j * np.radians(columns["force_angle_deg"]))


def _mark(
    axes: Axes, x: np.ndarray, vector: np.ndarray, number: int, every: float, apart: float
) -> None:
    """Mark equally spaced instants of a curve by dots, and label those of the first curve."""
    instants = np.arange(np.ceil(x[0] / every - 1e-6), np.floor(x[-1] / every + 1e-6) + 1) * every
    positions = np.interp(instants, x, vector.real) + 1j * np.interp(instants, x, vector.imag)
    colour = style(number)["color"]
    axes.plot(np.angle(positions), np.abs(positions), "o", color=colour, markersize=3.5)
    labelled: list[complex] = []
    for instant, position in zip(instants, positions, strict=True):
        if number or any(abs(position - other) < apart for other in labelled):
            continue
        labelled.append(position)
        axes.annotate(
            f"{instant + 0.0:g}", (np.angle(position), abs(position)), (4, 4),
            textcoords="offset points", fontsize=7.5, color=colour,
        )  # fmt: skip


def _mark_rotation(axes: Axes, angle: np.ndarray, vector: np.ndarray, largest: float) -> None:
    """Mark an orbit once in each revolution of its shaft, and draw the sense of rotation.

    Parameters
    ----------
    axes
        Polar axes.
    angle, vector
        Angle of the shaft [rad] and points of the orbit at the steps, shape (t,).
    largest
        Radius of the diagram.
    """
    sense = float(np.sign(angle[-1] - angle[0]))
    turns = sense * angle / (2 * np.pi)
    passes = np.arange(np.ceil(turns[0] - 1e-6), np.floor(turns[-1] + 1e-6) + 1)
    marks = np.interp(passes, turns, vector.real) + 1j * np.interp(passes, turns, vector.imag)
    axes.plot(
        np.angle(marks), np.abs(marks), "o", color="white", markeredgecolor="black", markersize=8,
        markeredgewidth=1.6, zorder=5, label="1x mark: shaft at angle 0",
    )  # fmt: skip
    # Between the labels of angles at 45 and 90 degrees, outside of the clearance circle.
    ends = np.radians([67.5 - 11 * sense, 67.5 + 11 * sense])
    axes.annotate(
        "", (ends[1], 1.1 * largest), (ends[0], 1.1 * largest), annotation_clip=False,
        arrowprops={"arrowstyle": "-|>", "color": "0.15", "linewidth": 1.6,
                    "connectionstyle": f"arc3,rad={0.1 * sense}"},
    )  # fmt: skip
    axes.annotate(
        "rotation", (np.radians(67.5), 1.17 * largest), fontsize=8, ha="center", va="center",
        rotation=-22.5, annotation_clip=False,
    )  # fmt: skip


def pressure_and_film(
    axes: Axes, x: np.ndarray, pressure: np.ndarray, film: np.ndarray, labels: tuple[str, str]
) -> None:
    """Draw a pressure [MPa] and a film thickness [um] (dashed), each on its own axis from zero."""
    other = axes.twinx()
    axes.plot(x, pressure, color=RED)
    other.plot(x, film, color=BLUE, linestyle="--")
    axes.set_ylabel(labels[0], color=RED)
    other.set_ylabel(labels[1], color=BLUE)
    axes.set_ylim(0, 1.05 * pressure.max() or 1.0)
    other.set_ylim(0, 1.05 * film.max())
    axes.grid(alpha=0.3)


def clearance_circle(axes: Axes) -> None:
    """Set up axes with circles for the orbit of a journal, in multiples of the clearance."""
    for radius in (0.25, 0.5, 0.75, 1.0):
        ring = {"color": "0.2", "lw": 1.6} if radius == 1.0 else {"color": "0.85", "lw": 0.8}
        axes.add_patch(plt.Circle((0, 0), radius, fill=False, **ring))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="eccentricity x / c", ylabel="eccentricity y / c")
