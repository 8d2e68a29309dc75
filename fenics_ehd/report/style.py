"""One look for every figure: a colour and a marker for each method, the same everywhere.

Yellow, red and blue of Paul Tol's high-contrast scheme beside black: they stay apart for
colour-blind readers and printed in grey. What a colour does not say, markers and lines do.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # the backend must be chosen first
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from fenics_ehd.report.study_data import StudyRun
from fenics_ehd.scenes.slider_crank_settings import Reduction

COLOURS = {"m1": "#DDAA33", "m2": "#BB5566", "m3": "#004488", "m4": "#000000"}
MARKERS = {"m1": "s", "m2": "^", "m3": "o", "m4": "D"}

#: Of M3, by pressure set; how a marker is filled tells the selection.
PRESSURE_MARKERS = {"pc1": "p", "pc2-long": ">", "pc2-short": "<", "journal": "P"}

#: An error of which only a bound is known, and what the legend says.
BOUND, BOUND_LABEL = "v", "at most this, where the reference cannot tell"
FILLS = {"largest-eigenvalue": "none", "smallest-eigenvalue": "bottom"}

#: Truncation of M4 that goes without saying.
TRUNCATION = Reduction().residual_truncation

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
    "proper-orthogonal": ("proper orthogonal", (0, (5, 1, 1, 1, 1, 1))),
}

#: How far lines of one colour go towards white and black.
LIGHTER, DARKER = 0.35, 0.55

#: Width of a figure [inches], columns of its legend.
WIDTH, LEGEND_COLUMNS = 10.5, 3

_SETTINGS: dict[str, Any] = {
    "font.size": 10,
    "axes.labelsize": 10,
    "legend.fontsize": 8.5,
    "legend.handlelength": 2.8,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "lines.linewidth": 1.5,
    "lines.markersize": 6,
    "svg.hashsalt": "fenics_ehd",  # the same ids every time
}


@contextmanager
def house_style() -> Iterator[None]:
    """Fonts and grids of the report."""
    with matplotlib.rc_context(_SETTINGS):
        yield


def family(run: StudyRun) -> str:
    """Method with what distinguishes its variants, not the number of modes."""
    name = {"full": "full interface", "rigid": "rigid"}.get(run.method, run.method.upper())
    if run.method == "m4" and truncated(run):
        return f"{name}, truncated at {run.residual_truncation:g}"
    if run.method != "m3":
        return name
    selection = SELECTIONS.get(run.selection, (run.selection, "-"))[0]
    return f"{name} {run.pressure_set}, {selection}"


def truncated(run: StudyRun) -> bool:
    """Whether M4 keeps less of the flexibility than it does by default."""
    return math.isfinite(run.residual_truncation) and run.residual_truncation != TRUNCATION


def line_style(run: StudyRun) -> dict[str, Any]:
    """Arguments of `Axes.plot` for a family of runs."""
    style: dict[str, Any] = {
        "color": COLOURS.get(run.method, "0.4"),
        "marker": MARKERS.get(run.method, "x"),
        "markerfacecoloralt": "white",
        "linestyle": "-",
        "fillstyle": "full",
    }
    if run.method == "m3":
        style["marker"] = PRESSURE_MARKERS.get(run.pressure_set, style["marker"])
        style["fillstyle"] = FILLS.get(run.selection, "full")
        style["linestyle"] = SELECTIONS.get(run.selection, ("", "-"))[1]
    elif truncated(run):
        style["fillstyle"] = "none" if run.residual_truncation >= COARSE else "bottom"
    return style


def shade(colour: str, share: float) -> tuple[float, ...]:
    """A colour from light, 0, to dark, 1."""
    rgb = np.array(to_rgb(colour))
    light, dark = rgb + LIGHTER * (1 - rgb), (1 - DARKER) * rgb
    return tuple(float(value) for value in light + share * (dark - light))


def percent_axis(axes: Axes, label: str) -> None:
    """Logarithmic axis of relative errors, told in percent."""
    axes.set(yscale="log", ylabel=f"{label} [%]")
    _plain_figures(axes.yaxis, 100.0)


def plain_log_axis(axes: Axes, label: str) -> None:
    """Logarithmic x axis with figures in full at 1, 2 and 5."""
    axes.set(xscale="log", xlabel=label)
    _plain_figures(axes.xaxis, 1.0)


def _plain_figures(axis: Axis, factor: float) -> None:
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(lambda value, _: f"{factor * value:g}")
    axis.set_minor_locator(NullLocator())


def draw_floor(axes: Axes, floor: float, label: str = FLOOR_LABEL) -> None:
    """Band of the errors that mean nothing, the reference's own, and an axis that ends in it."""
    if floor > 0:
        axes.axhspan(floor / 10, floor, color=FLOOR, zorder=0, linewidth=0, label=label)
        axes.set_ylim(bottom=floor / 1.6)


def two_panels(height: float) -> tuple[Figure, list[Axes]]:
    """A figure of two panels side by side, this high [inches] without its legend."""
    figure, panels = plt.subplots(1, 2, figsize=(WIDTH, height), layout="constrained")
    return figure, list(panels)


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


def save(figure: Figure, folder: Path, name: str) -> tuple[str, str]:
    """Write ``NAME.svg`` and ``NAME.png``, the same bytes for the same figure; their names."""
    folder.mkdir(parents=True, exist_ok=True)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # laid out once for both files
    figure.savefig(folder / f"{name}.svg", metadata={"Date": None})
    figure.savefig(folder / f"{name}.png", dpi=150)
    plt.close(figure)
    return f"{name}.svg", f"{name}.png"
