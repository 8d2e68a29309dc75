"""One look for every figure: a colour and a marker for each method, the same everywhere.

Yellow, red and blue of Paul Tol's high-contrast scheme beside black: they stay apart for
colour-blind readers and printed in grey. What a colour does not say, markers and lines do.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from fenics_ehd.plotting.picture import BLACK, BLUE, RED, YELLOW, plt
from fenics_ehd.scenes.part_settings import ReductionSettings
from fenics_ehd.study.report.study_data import QUANTITIES, JointData, Quantity, StudyRow

COLOURS = {"m1": YELLOW, "m2": RED, "m3": BLUE, "m4": BLACK}
MARKERS = {"m1": "s", "m2": "^", "m3": "o", "m4": "D"}

#: Of M3, by pressure set; how a marker is filled tells the selection.
PRESSURE_MARKERS = {"pc1": "p", "pc2-long": ">", "pc2-short": "<", "journal": "P"}

#: An error of which only a bound is known, and what the legend says.
BOUND, BOUND_LABEL = "v", "at most this, where the reference cannot tell"
FILLS = {"largest-eigenvalue": "none", "smallest-eigenvalue": "bottom"}

#: Truncation of M4 that goes without saying.
TRUNCATION = ReductionSettings().residual_truncation

#: Truncation from which on its marker is empty, not half full.
COARSE = 1e-2

#: The reference is a broad band of this grey, behind everything else.
REFERENCE = "#BBBBBB"

#: Errors of the reference itself.
FLOOR, FLOOR_LABEL = "#DDDDDD", "reference's own error"

SELECTIONS = {
    "lowest-frequency": ("lowest frequencies", "-"),
    "largest-eigenvalue": ("largest eigenvalues", "--"),
    "smallest-eigenvalue": ("smallest eigenvalues", ":"),
    "every-column": ("every column", "-."),
}

#: How far lines of one colour go towards white and black.
LIGHTER, DARKER = 0.35, 0.55

#: Width of a figure [inches], columns of its legend.
WIDTH, LEGEND_COLUMNS = 10.5, 3


def family(row: StudyRow) -> str:
    """Method with what distinguishes its variants, not the number of modes."""
    name = {"full": "full interface", "rigid": "rigid"}.get(row["method"], row["method"].upper())
    if row["method"] == "m3":
        return f"{name} {row['pressure_set']}, {selection(row)[0]}"
    return f"{name}, truncated at {row['residual_truncation']:g}" if truncated(row) else name


def sized(row: StudyRow) -> str:
    """The same with the number of coordinates."""
    return f"{family(row)}, {row['coordinates']:.0f} coordinates"


def selection(row: StudyRow) -> tuple[str, Any]:
    """How the residual modes of M3 were selected, in words, and the dashes of its lines."""
    return SELECTIONS.get(row["selection"], (row["selection"], "-"))


def truncated(row: StudyRow) -> bool:
    """Whether M4 keeps less of the flexibility than it does by default."""
    return row["method"] == "m4" and row["residual_truncation"] > TRUNCATION


def line_style(row: StudyRow) -> dict[str, Any]:
    """Arguments of `Axes.plot` for a family of runs."""
    marker, fill = MARKERS.get(row["method"], "x"), FILLS.get(row["selection"], "full")
    if truncated(row):
        fill = "none" if row["residual_truncation"] >= COARSE else "bottom"
    return {
        "color": COLOURS.get(row["method"], "0.4"),
        "marker": PRESSURE_MARKERS.get(row["pressure_set"], marker),
        "markerfacecoloralt": "white",
        "linestyle": selection(row)[1],
        "fillstyle": fill,
    }


def families(
    rows: Iterable[StudyRow], name: Callable[[StudyRow], str] = family
) -> dict[str, list[StudyRow]]:
    """Runs that have a name in common, few coordinates and tight tolerances first."""
    grouped: dict[str, list[StudyRow]] = {}
    for row in sorted(rows, key=lambda row: (name(row), row["coordinates"], row["tolerance"])):
        grouped.setdefault(name(row), []).append(row)
    return grouped


def shade(row: StudyRow, share: float | None = None) -> tuple[float, ...]:
    """Colour of a run's method, of several from light, 0, to dark, 1."""
    rgb = np.array(to_rgb(COLOURS.get(row["method"], "0.4")))
    if share is not None:
        light, dark = rgb + LIGHTER * (1 - rgb), (1 - DARKER) * rgb
        rgb = light + share * (dark - light)
    return tuple(map(float, rgb))


def percent_axis(axes: Axes, label: str) -> None:
    """Logarithmic axis of relative errors, told in percent."""
    axes.set(yscale="log", ylabel=f"{label} [%]")
    plain_figures(axes.yaxis, 100.0)


def plain_log_axis(axes: Axes, label: str) -> None:
    """Logarithmic x axis with figures in full at 1, 2 and 5."""
    axes.set(xscale="log", xlabel=label)
    plain_figures(axes.xaxis)


def plain_figures(axis: Axis, factor: float = 1.0, at: tuple[float, ...] = (1.0, 2.0, 5.0)) -> None:
    """Figures in full at these places of every decade."""
    axis.set_major_locator(LogLocator(subs=at))
    axis.set_major_formatter(lambda value, _: f"{factor * value:g}")
    axis.set_minor_locator(NullLocator())


def draw_floor(axes: Axes, floor: float, label: str = FLOOR_LABEL) -> None:
    """Band of the errors that mean nothing, the reference's own, and an axis that ends in it."""
    if floor > 0:
        axes.axhspan(floor / 10, floor, color=FLOOR, zorder=0, linewidth=0, label=label)
        axes.set_ylim(bottom=floor / 1.6)


def joint_panels(
    joints: Sequence[JointData], height: float
) -> tuple[Figure, list[tuple[Axes, JointData, Quantity]]]:
    """A row of panels for each joint, so high [inches]: its peak pressure, its minimum film."""
    figure, panels = plt.subplots(
        len(joints), 2, figsize=(WIDTH, height * len(joints)), layout="constrained", squeeze=False
    )
    cells = [(joint, quantity) for joint in joints for quantity in QUANTITIES]
    for axes, joint in zip(panels[:, 0], joints, strict=True):
        if joint.title:
            axes.set_title(joint.title, loc="left", fontweight="bold")
    return figure, [(axes, *cell) for axes, cell in zip(panels.flat, cells, strict=True)]


def legend_below(figure: Figure) -> None:
    """One legend for all panels, in room added under them; every label once."""
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
