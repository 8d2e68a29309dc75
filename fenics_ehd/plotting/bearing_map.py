"""Picture of a map of one rigid bearing: coefficients and stability over speed or load."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import fenics_ehd.base.matplotlib_start  # noqa: F401  # isort: skip
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.units import RPM
from fenics_ehd.plotting.picture import RED, SETTINGS, WIDTH, legend, plt, save, style

if TYPE_CHECKING:
    from fenics_ehd.scenes.bearing_map import BearingMap

#: Weight of a mass of 1 kg [N].
GRAVITY = 9.80665

#: Axis of a map by the column of the table: label with unit.
ALONG = {"frequency": "speed of the shaft [rad/s]", "load_N": "load [N]"}

#: Units in the names of the columns of scatter, by the first letter of the coefficients.
UNITS = {"k": "N_per_m", "c": "Ns_per_m"}

#: Ratio of the largest to the smallest value above which a logarithmic axis has labels at powers
#: of ten only.
DECADES = 1e3

#: Largest number of values without a result that a picture lists.
MOST_LISTED = 3

#: Height of a line of a legend, as a share of the height of its panel.
ROOM = 0.09

#: Ratio of the largest to the smallest value above which an axis is logarithmic.
WIDE = 30.0


def plot_bearing_map(points: BearingMap, path: str | Path) -> None:
    """Draw a map of a bearing to a file; its ending determines the format."""
    save(bearing_map_figure(points), [path])


def bearing_map_figure(points: BearingMap) -> Figure:
    """Draw stiffness, damping, whirl ratio and critical mass of a map over speed or load.

    Points without a result are marked by crosses.

    Raises
    ------
    SettingsError
        The map has no result, or has several speeds and several loads.
    """
    rows = points.rows()
    if not rows:
        raise SettingsError("the map has no point with a result: see its attribute failed")
    speeds = {result.settings.speed for result in points.results}
    speeds |= {point.speed for point in points.failed}
    by_load = len(speeds) == 1 and len(points.results) + len(points.failed) > 1
    if not by_load and len(speeds) < len(points.results) + len(points.failed):
        raise SettingsError(
            "the map has several speeds and several loads, but a picture has one axis: make a map "
            "over one of them"
        )
    along = "load_N" if by_load else "frequency"
    failed = [
        value
        for point in points.failed
        if (value := point.load if by_load else point.speed) is not None
    ]
    columns = {name: points[name] for name in rows[0]}
    x = columns[along]
    with plt.rc_context(SETTINGS):
        figure, axes = plt.subplots(
            2, 2, figsize=(1.4 * WIDTH, 0.95 * WIDTH), layout="constrained", sharex=True
        )
        _draw_entries(axes[0, 0], x, columns, "k", "stiffness [MN/m]", 1e-6)
        _draw_entries(axes[0, 1], x, columns, "c", "damping [kN s/m]", 1e-3)
        axes[1, 0].plot(x, columns["whirl_frequency_ratio"], marker=".", **style(0))
        axes[1, 0].set_ylabel("whirl ratio at the stability limit")
        axes[1, 0].set_ylim(0.0, max(0.6, axes[1, 0].get_ylim()[1]))
        _draw_critical_mass(axes[1, 1], x, columns)
        for lower in axes[1]:
            lower.set_xlabel(ALONG[along])
            if x.min() > 0 and x.max() > WIDE * x.min():
                lower.set_xscale("log")
                if x.max() > DECADES * x.min():
                    continue
                lower.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                lower.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
                lower.xaxis.set_minor_formatter(NullFormatter())
        if len(failed):
            _mark_failures(axes, failed)
        for panel in axes.flat:
            _legend_with_room(panel)
        if along == "frequency":
            for upper in axes[0]:
                turns = upper.secondary_xaxis("top", functions=(_to_rpm, _from_rpm))
                turns.set_xlabel("speed of the shaft [1/min]")
    return figure


def _mark_failures(axes: np.ndarray, failed: Sequence[float]) -> None:
    """Mark values without a result on the horizontal axes of all panels; the last one lists them.

    `axes` are the panels, whose horizontal axis keeps its range.
    """
    values = np.array(failed, dtype=float)
    low, high = axes[1, 0].get_xlim()
    within = values[(values >= low) & (values <= high)]
    look = {"color": RED, "marker": "x", "markersize": 8, "markeredgewidth": 2.0}
    for panel in axes.flat if len(within) else ():
        heights = np.zeros(len(within))
        across = panel.get_xaxis_transform()
        panel.plot(within, heights, linestyle="none", transform=across, clip_on=False, **look)
    listed = ", ".join(f"{value:g}" for value in values[:MOST_LISTED])
    omitted = " ..." if len(values) > MOST_LISTED else ""
    axes[1, 1].plot([], [], linestyle="none", label=f"no result at {listed}{omitted}", **look)
    axes[1, 0].set_xlim(low, high)


def _to_rpm(speed: np.ndarray) -> np.ndarray:
    """Convert speeds in rad/s to revolutions per minute."""
    return speed * RPM


def _from_rpm(turns: np.ndarray) -> np.ndarray:
    """Convert revolutions per minute to speeds in rad/s."""
    return turns / RPM


def _draw_entries(
    axes: Axes,
    x: np.ndarray,
    columns: Mapping[str, np.ndarray],
    letter: str,
    label: str,
    factor: float,
) -> None:
    """Draw the four entries of a matrix over `x`, times a factor, with their scatter as bands.

    `letter` is the first letter of their columns, k in ``kxx``.
    """
    for number, entry in enumerate(("xx", "xy", "yx", "yy")):
        name = f"{letter}{entry}"
        look = style(number)
        axes.plot(x, factor * columns[name], label=name, marker=".", **look)
        scatter = columns[f"{name}_scatter_{UNITS[letter]}"]
        low, high = (factor * (columns[name] + sign * scatter) for sign in (-1.0, 1.0))
        axes.fill_between(x, low, high, color=look["color"], alpha=0.25, linewidth=0.0)
    axes.axhline(0.0, color="0.5", linewidth=0.8)
    axes.set_ylabel(label)


def _legend_with_room(axes: Axes) -> None:
    """Add a legend at the top of a panel, with room for it above the curves."""
    handles = axes.get_legend_handles_labels()[0]
    if not handles:
        return
    lines = -(-len(handles) // 4) if len(handles) > 3 else len(handles)
    low, high = axes.get_ylim()
    share = ROOM * (lines + 0.5)
    if axes.get_yscale() == "log":
        axes.set_ylim(low, high * (high / low) ** share)
    else:
        axes.set_ylim(low, high + share * (high - low))
    columns = 1 if lines == len(handles) else 4
    legend(axes, loc="upper center", ncol=columns, columnspacing=1.0)


def _draw_critical_mass(axes: Axes, x: np.ndarray, columns: Mapping[str, np.ndarray]) -> None:
    """Draw the critical mass per bearing, and the mass whose weight is the load."""
    mass = columns["critical_mass_kg"]
    weight = columns["load_N"] / GRAVITY
    label = "critical mass of a rigid rotor, per bearing"
    axes.plot(x, mass, label=label, marker=".", **style(0))
    axes.plot(x, weight, label="mass whose weight is the load", **style(1))
    positive = np.concatenate([mass, weight])
    positive = positive[np.isfinite(positive) & (positive > 0)]
    if positive.size and positive.max() > WIDE * positive.min():
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0.0)
    if np.isnan(mass).any():
        axes.set_title("no critical mass: every mass is stable", fontsize=8.5, loc="left")
    axes.set_ylabel("mass [kg]")
