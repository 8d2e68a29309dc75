"""Picture of one bearing: pressure map, curves at mid-width, shaft in its bore."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from fenics_ehd.plotting.maps import (
    ANGLES,
    ENLARGED,
    NORMALS,
    Raster,
    draw_raster,
    draw_section,
    largest,
    lay_out_section,
    levels_between,
    sampled,
)
from fenics_ehd.plotting.picture import BLUE, PRESSURES, RED, plt, save

if TYPE_CHECKING:
    from fenics_ehd.analysis.bearing import BearingResult


def plot_bearing(result: BearingResult, path: str | Path) -> None:
    """Draw a bearing in operation, from half a turn before the load line to half a turn after it.

    Parameters
    ----------
    result
        From `solve_bearing`.
    path
        The picture; its ending tells the format.
    """
    figure, axes = plt.subplot_mosaic(
        [["map", "section"], ["curves", "section"]],
        figsize=(11.0, 5.8),
        width_ratios=(1.45, 1.0),
        layout="constrained",
    )
    settings, position = result.settings, result.position
    grid = result.film.parameters.grid
    height = np.linspace(grid.heights[0], grid.heights[-1], 81)
    found = sampled(grid, result.state.pressure, ANGLES - result.angle, height)
    pressure = 1e-6 * np.maximum(found, 0.0)
    gap = settings.clearance - position @ NORMALS
    if settings.bore_shape is not None:
        gap += settings.bore_shape.radial(ANGLES, np.zeros_like(ANGLES))
    degrees, millimetres, highest = np.degrees(ANGLES), 1e3 * height, pressure.max()
    mark = largest(pressure, degrees, millimetres)
    raster, levels = Raster(pressure, degrees, millimetres, "", mark), levels_between(0.0, highest)
    draw_raster(axes["map"], raster, levels, "pressure [MPa]", PRESSURES)
    _mark(axes["map"], result, millimetres[[0, -1]])
    middle = pressure[len(height) // 2]
    _draw_curves(axes["curves"], degrees, middle, 1e6 * gap)
    axes["map"].sharex(axes["curves"])
    enlarged = ENLARGED / settings.clearance
    share, told = middle / (highest or 1.0), ("pressure at mid-width", "thinnest there")
    draw_section(
        axes["section"], enlarged * gap, share, enlarged * position, ENLARGED, told, turn=-np.pi / 2
    )
    lay_out_section(axes["section"], -np.pi / 2)
    axes["section"].set_aspect("equal", adjustable="box")
    arrow = {"arrowstyle": "-|>", "color": "0.15", "linewidth": 1.8}
    axes["section"].annotate("W", (0, 0.62), (0, 1.4), ha="center", arrowprops=arrow)
    axes["section"].set_title(_caption(result), fontsize=9, loc="left")
    save(figure, [path])


def _mark(axes: Axes, result: BearingResult, ends: np.ndarray) -> None:
    """Grooves from end to end [mm], imposed zero pressure, and the thinnest film."""
    grooves = [
        (np.degrees(groove.angle - groove.width / 2) + turn, np.degrees(groove.width))
        for groove in result.settings.grooves
        for turn in (-360.0, 0.0, 360.0)
    ]
    if grooves:
        axes.broken_barh(grooves, (ends[0], np.ptp(ends)), color=BLUE, alpha=0.25, label="groove")
    if result.attitude is None:
        return
    if result.settings.line_at_max_film:
        line = np.degrees(np.mod(result.attitude, 2 * np.pi)) - 180.0
        axes.axvline(line, color=BLUE, label="p = 0 imposed")
    axes.axvline(np.degrees(result.attitude), color=BLUE, linestyle=":", label="minimum film")
    axes.legend(loc="upper left", fontsize=8, framealpha=0.9)


def _draw_curves(axes: Axes, degrees: np.ndarray, pressure: np.ndarray, gap: np.ndarray) -> None:
    """Pressure [MPa] and film thickness [um] at mid-width."""
    axes.fill_between(degrees, pressure, color=RED, alpha=0.15, linewidth=0)
    axes.plot(degrees, pressure, color=RED)
    axes.set_ylabel("pressure at mid-width [MPa]", color=RED)
    axes.set(
        xlabel="angle from the load line in direction of rotation [degrees]",
        xlim=(-180, 180),
        xticks=np.arange(-180, 181, 45),
        ylim=(0, 1.05 * pressure.max() or 1.0),
    )
    axes.grid(alpha=0.3)
    film = axes.twinx()
    film.plot(degrees, gap, color=BLUE, linestyle="--")
    film.set_ylabel("film thickness [µm]", color=BLUE)
    film.set_ylim(0, 1.05 * gap.max())


def _caption(result: BearingResult) -> str:
    parts = [
        f"W = {result.load:.4g} N,  e/c = {result.eccentricity_ratio:.4g}",
        f"maximum pressure {1e-6 * result.max_pressure:.4g} MPa,  "
        f"minimum film {1e6 * result.min_film_thickness:.4g} µm",
        f"friction torque {result.friction_torque:.4g} N m,  "
        f"side flow {1e6 * result.flow.side:.4g} cm³/s",
    ]
    if result.attitude is not None:
        parts[0] += f",  φ = {np.degrees(result.attitude):.4g}°"
    return "\n".join(parts)
