"""Pictures of a rotor map: Campbell diagram, decrement, mode shapes, unbalance response.

Speeds are drawn in revolutions per minute and frequencies in Hz, as is usual in the field.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any

import fenics_ehd.base.matplotlib_start  # noqa: F401  # isort: skip
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from fenics_ehd.analysis.modes import (
    STRAIGHT,
    damping_ratio,
    log_decrement,
    whirl_direction,
    whirl_name,
)
from fenics_ehd.analysis.rotor_map import CRITICAL_DAMPING, OVERDAMPED, RotorMap, StabilityLimit
from fenics_ehd.analysis.unbalance import UnbalanceResponse, larger_axes, phases
from fenics_ehd.base.arguments import require_number, require_word
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.printed import shown
from fenics_ehd.base.units import RPM
from fenics_ehd.plotting.picture import (
    BLUE,
    PANEL,
    RED,
    SETTINGS,
    WIDTH,
    plt,
    save_in_formats,
    style,
)

#: Hz in one radian per second.
HERTZ = 0.5 / np.pi

#: Highest frequency in the diagrams over the largest speed, or over the lowest frequency of a mode
#: if this is larger. Modes with higher frequencies are not excited by an unbalance in this range.
HIGHEST = 1.15

#: Label of the axis of speeds.
SPEED_LABEL = "speed [1/min]"

#: Colour map of damping ratios, and the largest one that it distinguishes.
DAMPING = "viridis_r"
MOST_DAMPING = 0.3

#: Dashes of the line at a limit of stability.
LIMIT_DASHES = (0, (6, 2, 1, 2))

#: Half width of the axis of a single speed, as a share of the speed; and distance of the first and
#: last of several speeds from the ends of the axis, as a share of their range.
ALONE = 0.1
MARGIN = 0.015

#: Highest value on an axis that starts at 0, over the largest value drawn.
ROOM = 1.08

#: Smallest distance of labels at the end of curves, as a share of the height of the diagram; and
#: their distance from the end of a curve, as a share of its width.
LABEL_DISTANCE = 0.034
LABEL_OFFSET = 0.015

#: Share of the width of the diagram below which the labels of two critical speeds would overlap.
NEAR_SPEEDS = 0.08

#: Number of characters in a line of a title.
TITLE_WIDTH = 72

#: Largest number of modes in a picture of mode shapes.
MOST_SHAPES = 6

#: Number of points on the orbit of a station.
ORBIT = 73

#: Names of the pictures; the number of a speed follows that of mode shapes.
CAMPBELL = "campbell"
DECREMENT = "decrement"
MODE_SHAPES = "mode_shapes"
UNBALANCE = "unbalance"


def plot_map(chart: RotorMap, directory: str | Path, shown: Sequence[int]) -> list[Path]:
    """Draw all pictures of a rotor map into a folder; return the paths of the pictures.

    Parameters
    ----------
    chart, directory
        The map, and the folder.
    shown
        Indices of the speeds whose mode shapes are drawn.
    """
    with plt.rc_context(SETTINGS):
        figures = {CAMPBELL: campbell(chart), DECREMENT: decrement(chart)}
        if chart.stations.heights.any():  # otherwise there is no shaft
            for number, n in enumerate(shown, 1):
                figures[f"{MODE_SHAPES}-{number}"] = mode_shapes(chart, n)
        if chart.response is not None:
            figures[UNBALANCE] = unbalance(chart, chart.response)
        paths = []
        for name, figure in figures.items():
            paths += save_in_formats(figure, directory, name)
    return paths


def map_figure(chart: RotorMap, quantity: str, speed: float | str | None = None) -> Figure:
    """Draw one picture of a rotor map.

    Parameters
    ----------
    chart
        The map.
    quantity
        Name of the picture: ``campbell``, ``decrement``, ``mode_shapes`` or ``unbalance``.
    speed
        Speed whose mode shapes are drawn, in magnitude the nearest of the map [rad/s], or a text
        with a unit; None for the first stability limit, or a speed in the middle of the map.

    Raises
    ------
    SettingsError
        There is no such picture, the rotor has no shaft, or the map has no response to unbalances.
    """
    require_word("quantity", quantity, (CAMPBELL, DECREMENT, MODE_SHAPES, UNBALANCE))
    if speed is not None and quantity != MODE_SHAPES:
        raise SettingsError(f"speed = {shown(speed)} has an effect on mode_shapes only: drop speed")
    with plt.rc_context(SETTINGS):
        if quantity == UNBALANCE:
            if chart.response is None:
                raise SettingsError(
                    "quantity = 'unbalance': the map has no response: give unbalance to rotor_map"
                )
            return unbalance(chart, chart.response)
        if quantity == MODE_SHAPES:
            if not chart.stations.heights.any():
                raise SettingsError("quantity = 'mode_shapes': the rotor has no elastic shaft")
            return mode_shapes(chart, nearest_speed(chart, speed))
        return campbell(chart) if quantity == CAMPBELL else decrement(chart)


def nearest_speed(chart: RotorMap, speed: float | str | None) -> int:
    """Index of the map's speed whose magnitude is nearest to that of a speed, see `map_figure`."""
    if speed is None:
        middle = chart.points[len(chart.points) // 2].speed
        speed = chart.limits[0].speed if chart.limits else middle
    wanted = require_number("speed", speed, unit="rad/s")
    return int(np.argmin(np.abs(np.abs(chart.speeds) - abs(wanted))))


def _along(chart: RotorMap, body: str) -> np.ndarray:
    """Indices of the stations along the axis of a shaft; empty for a body that is not a shaft."""
    indices = [k for k, name in enumerate(chart.stations.bodies) if name == body]
    heights = chart.stations.heights[indices]
    return (
        np.array(indices, dtype=int) if len(indices) > 1 and np.ptp(heights) else np.zeros(0, int)
    )


def _speed_axis(axes: Axes, chart: RotorMap) -> None:
    """Set the horizontal axis, which has the speeds; mark stability limits and failed speeds."""
    for limit in chart.limits:
        axes.axvline(RPM * abs(limit.speed), color=RED, linewidth=1.2, linestyle=LIMIT_DASHES)
    failed = RPM * np.abs([*chart.failures])
    if len(failed):
        axes.plot(
            failed, np.zeros(len(failed)), "x", color=RED, markersize=8, markeredgewidth=2.0,
            transform=axes.get_xaxis_transform(), clip_on=False, zorder=4,
        )  # fmt: skip
    speeds = np.concatenate([RPM * np.abs(chart.speeds), failed])
    margin = MARGIN * np.ptp(speeds) or ALONE * speeds[0]
    axes.set_xlim(speeds.min() - margin, speeds.max() + margin)
    if len(speeds) == 1:
        axes.set_xticks(speeds)


def _failure_handles(chart: RotorMap) -> list[Line2D]:
    """Entry of the legend for speeds without equilibrium; an empty list if there are none."""
    if not chart.failures:
        return []
    cross = Line2D(
        [], [], linestyle="none", marker="x", color=RED, markeredgewidth=2.0,
        label="no equilibrium",
    )  # fmt: skip
    return [cross]


def _limit_text(limit: StabilityLimit) -> str:
    change = "stability limit" if limit.lost else "stable again"
    return f"{change} {RPM * abs(limit.speed):.0f}/min, whirl ratio {limit.whirl_ratio:.3f}"


def _listed(
    chart: RotorMap, highest: float, most_damping: float = OVERDAMPED
) -> list[tuple[int, np.ndarray]]:
    """Tracks of a rotor map with frequencies below a limit [rad/s], and their speed indices.

    Speeds at which the damping ratio of the mode exceeds a limit are not included.
    """
    tracks = []
    for track in range(len(chart.tracks)):
        roots = chart.roots[track]
        vibrates = np.nan_to_num(roots.imag) > 0.0
        little = np.nan_to_num(-roots.real) < most_damping * np.nan_to_num(np.abs(roots))
        drawn = np.flatnonzero(vibrates & little & (np.nan_to_num(roots.imag) < highest))
        if len(drawn):
            tracks.append((track, drawn))
    return tracks


def _highest(chart: RotorMap) -> float:
    """Highest frequency in the diagrams of a rotor map [rad/s], see `HIGHEST`."""
    lowest = [
        float(chart.roots[track, drawn].imag.min()) for track, drawn in _listed(chart, np.inf)
    ]
    return HIGHEST * max(float(np.abs(chart.speeds).max()), min(lowest, default=0.0))


def campbell(chart: RotorMap) -> Figure:
    """Campbell diagram: frequencies over the speed, with the 1x line and critical speeds."""
    figure, axes = plt.subplots(figsize=(WIDTH, 4.8), layout="constrained")
    speeds = np.abs(chart.speeds)
    highest = _highest(chart)
    image = None
    ends: dict[int, tuple[float, float]] = {}
    for track, drawn in _listed(chart, highest):
        roots = chart.roots[track, drawn]
        axes.plot(RPM * speeds[drawn], HERTZ * roots.imag, color="0.7", linewidth=0.8, zorder=1)
        directions = np.array([chart.direction(int(n), track) for n in drawn])
        ratios = np.array([damping_ratio(root) for root in roots])
        marks = {
            "^": directions > STRAIGHT,
            "v": directions < -STRAIGHT,
            "o": np.abs(directions) <= STRAIGHT,
        }
        for mark, where in marks.items():
            image = axes.scatter(
                RPM * speeds[drawn][where],
                HERTZ * roots.imag[where],
                c=ratios[where],
                marker=mark,
                s=26,
                cmap=DAMPING,
                vmin=0.0,
                vmax=MOST_DAMPING,
                edgecolors=[RED if ratio < 0.0 else "none" for ratio in ratios[where]],
                linewidths=1.2,
                zorder=2,
            )
        ends[track] = (RPM * float(speeds[drawn[-1]]), HERTZ * float(roots.imag[-1]))
    line = np.array([0.0, 2.0 * speeds.max()])
    axes.plot(RPM * line, HERTZ * line, color="black", linewidth=1.0, linestyle="--", zorder=1)
    before = -np.inf
    above = False
    for critical in chart.critical_speeds:
        speed = abs(critical.speed)
        # Labels of neighbouring critical speeds are alternately below and above their circles.
        above = speed - before < NEAR_SPEEDS * float(speeds.max()) and not above
        before = speed
        axes.plot(
            RPM * speed, HERTZ * speed, "o", markersize=11, markerfacecolor="none",
            markeredgecolor=BLUE, zorder=3,
        )  # fmt: skip
        axes.annotate(
            f"{RPM * speed:.0f}", (RPM * speed, HERTZ * speed), ha="center",
            xytext=(0, 9 if above else -16), textcoords="offset points", color=BLUE, fontsize=8.5,
        )  # fmt: skip
    axes.set(xlabel=SPEED_LABEL, ylabel="frequency [Hz]", ylim=(0.0, HERTZ * highest))
    _speed_axis(axes, chart)
    label_curves(axes, ends)
    if image is not None:
        figure.colorbar(image, ax=axes, label="damping ratio", extend="max", pad=0.02)
    _legend_below(axes, _campbell_handles(chart))
    return figure


def label_curves(axes: Axes, ends: Mapping[int, tuple[float, float]]) -> None:
    """Write the numbers of modes at the ends of their curves, with lines to the curves.

    Numbers of curves that end at the same speed are moved apart, upwards from the lowest one or
    downwards from the end of the axis.

    Parameters
    ----------
    axes
        Axes of the diagram, whose limits are final.
    ends
        Speed and frequency at the end of the curve of each track, in the units of the axes.
    """
    width = float(np.ptp(axes.get_xlim()))
    top = axes.get_ylim()[1]
    distance = LABEL_DISTANCE * top
    at_speed: dict[float, list[int]] = {}
    for track in sorted(ends, key=lambda track: ends[track][1]):
        at_speed.setdefault(ends[track][0], []).append(track)
    for speed, tracks in at_speed.items():
        heights: list[float] = []
        for track in tracks:
            heights.append(max(ends[track][1], heights[-1] + distance if heights else 0.0))
        for k in range(len(tracks) - 1, -1, -1):
            limit = heights[k + 1] if k + 1 < len(tracks) else top + 0.5 * distance
            heights[k] = min(heights[k], limit - distance)
        offset = LABEL_OFFSET * width
        for track, height in zip(tracks, heights, strict=True):
            axes.annotate(
                str(track + 1), ends[track], xytext=(speed + 1.6 * offset, height), va="center",
                fontsize=8, annotation_clip=False,
                arrowprops={"arrowstyle": "-", "color": "0.5", "linewidth": 0.6, "shrinkA": 0.0},
            )  # fmt: skip


def _legend_below(axes: Axes, handles: Sequence[Line2D]) -> None:
    """Put a legend below the label of the horizontal axis."""
    axes.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncol=3, columnspacing=1.2
    )


def _campbell_handles(chart: RotorMap) -> list[Line2D]:
    """Entries of the legend of a Campbell diagram."""

    def mark(symbol: str, label: str, edge: str = "0.4", face: str = "0.4") -> Line2D:
        return Line2D(
            [], [], linestyle="none", marker=symbol, markeredgecolor=edge, markerfacecolor=face,
            label=label,
        )  # fmt: skip

    handles = [mark("^", "forward whirl"), mark("v", "backward whirl"), mark("o", "straight line")]
    handles.append(Line2D([], [], color="black", linestyle="--", linewidth=1.0, label="1x"))
    if chart.critical_speeds:
        handles.append(mark("o", "critical speed", BLUE, "none"))
    return [*handles, *_limit_handles(chart), *_failure_handles(chart)]


def _limit_handles(chart: RotorMap) -> list[Line2D]:
    """Entries of the legend for the limits of stability."""
    return [
        Line2D([], [], color=RED, linestyle=LIMIT_DASHES, label=_limit_text(limit))
        for limit in chart.limits
    ]


def decrement(chart: RotorMap) -> Figure:
    """Logarithmic decrement over the speed, of modes with a damping ratio below 0.4."""
    figure, axes = plt.subplots(figsize=(WIDTH, 4.2), layout="constrained")
    speeds = np.abs(chart.speeds)
    tracks = _listed(chart, _highest(chart), CRITICAL_DAMPING)
    for number, (track, drawn) in enumerate(tracks):
        values = [log_decrement(root) for root in chart.roots[track, drawn]]
        axes.plot(
            RPM * speeds[drawn], np.array(values, dtype=float), label=f"mode {track + 1}",
            marker="o" if len(drawn) == 1 else None, **style(number),
        )  # fmt: skip
    axes.axhline(0.0, color="black", linewidth=0.8)
    low, high = axes.get_ylim()
    axes.axhspan(min(low, 0.0), 0.0, color=RED, alpha=0.12, linewidth=0.0)
    axes.set(xlabel=SPEED_LABEL, ylabel="logarithmic decrement", ylim=(low, high))
    _speed_axis(axes, chart)
    handles = [
        *axes.get_legend_handles_labels()[0], *_limit_handles(chart), *_failure_handles(chart),
    ]  # fmt: skip
    _legend_below(axes, handles)
    return figure


def mode_shapes(chart: RotorMap, n: int) -> Figure:
    """Mode shapes in space at speed n: orbits of the stations, and the axis at one instant.

    The axis is drawn at the instant at which its largest deflection has its full size, and the part
    of the orbit over the next quarter of the period is thick.
    """
    tracks = [
        track
        for track in range(len(chart.tracks))
        if chart.tracks[track, n] >= 0
        and chart.roots[track, n].imag > 0.0
        and damping_ratio(chart.roots[track, n]) < OVERDAMPED
    ]
    tracks = sorted(tracks, key=lambda track: chart.roots[track, n].imag)[:MOST_SHAPES]
    columns = min(3, max(1, len(tracks)))
    rows = max(1, -(-len(tracks) // columns))
    figure = plt.figure(figsize=(0.8 * PANEL * columns, 0.8 * PANEL * rows))
    figure.subplots_adjust(0.01, 0.04, 0.95, 0.9 if rows > 1 else 0.8, wspace=0.12, hspace=0.2)
    speed = abs(chart.points[n].speed)
    figure.suptitle(f"mode shapes at {RPM * speed:.0f} 1/min")
    for number, track in enumerate(tracks):
        axes = figure.add_subplot(rows, columns, number + 1, projection="3d")
        _draw_shape(axes, chart, n, track)
    return figure


def _draw_shape(axes: Axes, chart: RotorMap, n: int, track: int) -> None:
    """Draw one mode shape: orbits of the nodes of every shaft, bearings and axis in space."""
    shape = chart.shape(n, track)
    root = complex(chart.roots[track, n])
    instants = np.exp(1j * np.linspace(0.0, 2 * np.pi, ORBIT))
    quarter = ORBIT // 4 + 1
    for body in dict.fromkeys(chart.stations.bodies):
        along = _along(chart, body)
        if not len(along):
            continue
        heights = chart.stations.heights[along]
        u, v = shape[along].T
        axes.plot(heights, 0 * heights, 0 * heights, color="0.6", linewidth=0.8)
        axes.plot(heights, u.real, v.real, color=BLUE, linewidth=1.8)
        for k, z in enumerate(heights):
            orbit = np.array([(u[k] * instants).real, (v[k] * instants).real])
            axes.plot(np.full(ORBIT, z), *orbit, color="0.5", linewidth=0.5)
            axes.plot(np.full(quarter, z), *orbit[:, :quarter], color=RED, linewidth=1.0)
    direction = whirl_direction(shape, chart.points[n].speed)
    ratio = round(damping_ratio(root), 3) + 0.0
    axes.set_title(
        f"mode {track + 1}: {HERTZ * root.imag:.4g} Hz, ζ = {ratio:.3f}\n"
        f"{whirl_name(direction)}, κ = {direction:.2f}",
        fontsize=8.5,
    )
    axes.set(ylim=(-1.0, 1.0), zlim=(-1.0, 1.0), yticklabels=[], zticklabels=[])
    axes.set_xlabel("z [m]", fontsize=8)
    axes.set_ylabel("x", fontsize=8, labelpad=-10)
    axes.set_zlabel("y", fontsize=8, labelpad=-10)
    axes.tick_params(labelsize=7, pad=0)
    axes.set_box_aspect((1.8, 1.0, 1.0))


def unbalance(chart: RotorMap, response: UnbalanceResponse) -> Figure:
    """Unbalance response over the speed: amplitudes and phases of points, forces in bearings.

    Points on the curves are the speeds of the map; between them M, D and K are interpolated.

    Parameters
    ----------
    chart, response
        The map, and its response to unbalances.
    """
    panels = 3 if response.forces else 2
    figure, axes = plt.subplots(
        panels, 1, figsize=(WIDTH, 2.4 * panels), layout="constrained", sharex=True
    )
    curves = response.interpolated
    speeds = RPM * np.abs(curves.speeds)
    # Of the interpolated speeds, those that were computed have marks.
    marks = {"marker": ".", "markersize": 5, "markevery": np.isin(curves.speeds, response.speeds)}
    sense = float(np.sign(response.speeds[0]))

    def look(number: int, label: str) -> dict[str, Any]:
        """Style of a curve; rings of a single speed have several sizes, so that all are visible."""
        common = {"label": label, **style(number), **marks}
        ring = {"marker": "o", "markersize": 5 + 3 * number, "fillstyle": "none"}
        return common if len(speeds) > 1 else common | ring

    for number, name in enumerate(response.points):
        amplitudes = 1e6 * larger_axes(curves.deflections[:, number])
        axes[0].plot(speeds, amplitudes, **look(number, name))
        turned = np.unwrap(phases(curves.deflections[:, number], sense))
        axes[1].plot(speeds, np.degrees(turned), **look(number, name))
    for number, joint in enumerate(response.forces):
        axes[2].plot(speeds, larger_axes(curves.forces[joint]), **look(number, joint))
    axes[0].set_ylabel("amplitude [µm]")
    axes[1].set_ylabel("phase from the angle\nof the shaft [°]")
    if response.forces:
        axes[2].set_ylabel("bearing force [N]")
    for panel in (*axes[:1], *axes[2:]):
        largest = max(float(np.max(line.get_ydata())) for line in panel.lines)
        panel.set_ylim(0.0, ROOM * largest or 1.0)
        _legend_above(panel, panel.get_legend_handles_labels()[0])
    if len(speeds) == 1:
        axes[1].margins(y=0.2)
    for panel in axes:
        _speed_axis(panel, chart)
    _legend_above(axes[1], [*_limit_handles(chart), *_failure_handles(chart)])
    axes[-1].set_xlabel(SPEED_LABEL)
    listed = ", ".join(
        f"{1e6 * each.magnitude:.4g}\u00a0g\u00a0mm at\u00a0{each.point}"
        for each in response.unbalances
    )
    title = wrap(f"response to {listed}", TITLE_WIDTH, max_lines=3, placeholder=" ...")
    figure.suptitle("\n".join(title), fontsize=10)
    return figure


def _legend_above(axes: Axes, handles: Sequence[Artist]) -> None:
    """Put a legend above a panel, if it has entries."""
    if handles:
        axes.legend(
            handles=handles, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncol=4,
            columnspacing=1.2, frameon=False,
        )  # fmt: skip
