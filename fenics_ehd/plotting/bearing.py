"""Picture of one bearing: pressure map, mid-plane curves, shaft in its bore."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.patches import Arc, Circle

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.output import require_writable
from fenics_ehd.plotting.picture import BLUE, PRESSURES, RED, plt, save

if TYPE_CHECKING:
    from fenics_ehd.bearing.operating_point import BearingResult

PRESSURE, FILM, LOAD = RED, BLUE, "0.15"

#: Share of the largest pressure at which the edge of the film is drawn.
EDGE = 1e-4

#: Clearance of the sketch, bore radius 1, and height of the largest pressure in it.
SKETCH_CLEARANCE, SKETCH_PRESSURE = 0.28, 0.55


def require_format(path: str | Path) -> None:
    """Refuse a picture that cannot be written, before any work is done for it.

    Raises
    ------
    SettingsError
        The file's ending is no format of matplotlib.
    InputError
        No permission.
    """
    suffix = Path(path).suffix.lstrip(".").lower()
    known = sorted(FigureCanvasBase.get_supported_filetypes())
    if suffix not in known:
        raise SettingsError(f"--plot {path}: its ending must be one of {', '.join(known)}")
    require_writable(path)


def plot_bearing(result: BearingResult, path: str | Path) -> None:
    """Draw a bearing in operation.

    Parameters
    ----------
    result
        From `solve_bearing`.
    path
        The picture; its ending tells the format.
    """
    figure, axes = plt.subplot_mosaic(
        [["map", "sketch"], ["curves", "sketch"]],
        figsize=(11.0, 5.8),
        width_ratios=(1.45, 1.0),
        layout="constrained",
    )
    # From half a turn before the load line to half a turn after it, mesh frame and heights.
    angle = np.linspace(-np.pi, np.pi, 721)
    grid = result.bearing.film.parameters.grid
    height = np.linspace(grid.heights[0], grid.heights[-1], 81)
    a, z = np.meshgrid(angle - result.operation.angle, height)
    sampled = grid.interpolation(a.ravel(), z.ravel()) @ result.operation.state.pressure
    pressure = 1e-6 * np.maximum(sampled, 0.0).reshape(a.shape)
    _draw_map(axes["map"], result, angle, height, pressure)
    _draw_curves(axes["curves"], result, angle, pressure[len(height) // 2])
    axes["map"].sharex(axes["curves"])
    _draw_sketch(axes["sketch"], result, angle, pressure[len(height) // 2])
    save(figure, [path])


def _draw_map(
    axes: Axes, result: BearingResult, angle: np.ndarray, height: np.ndarray, pressure: np.ndarray
) -> None:
    """Pressure over angle and height, with the edge of the film."""
    degrees, millimetres = np.degrees(angle), 1e3 * height
    highest = pressure.max()
    colours = plt.get_cmap(PRESSURES).copy()
    colours.set_under("white")  # no film
    image = axes.pcolormesh(
        degrees,
        millimetres,
        pressure,
        cmap=colours,
        shading="gouraud",
        vmin=EDGE * highest,
        rasterized=True,  # as vectors it is tens of thousands of triangles
    )
    axes.figure.colorbar(image, ax=axes, label="pressure [MPa]", pad=0.01)
    if EDGE * highest > 0:
        axes.contour(
            degrees, millimetres, pressure, levels=[EDGE * highest], colors="0.2", linewidths=1.0
        )
        axes.plot([], [], color="0.2", linewidth=1.0, label="edge of the film")
    _mark(axes, result, millimetres[[0, -1]])
    axes.set(ylabel="z [mm]", xlabel="")
    axes.tick_params(labelbottom=False)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper left", fontsize=8, framealpha=0.9)


def _mark(axes: Axes, result: BearingResult, ends: np.ndarray) -> None:
    """Grooves from end to end [mm], imposed zero pressure, and the thinnest film."""
    grooves = [
        (np.degrees(groove.angle - groove.width / 2) + turn, np.degrees(groove.width))
        for groove in result.settings.grooves
        for turn in (-360.0, 0.0, 360.0)
    ]
    if grooves:
        axes.broken_barh(grooves, (ends[0], np.ptp(ends)), color=FILM, alpha=0.25, label="groove")
    if result.attitude is None:
        return
    if result.settings.line_at_max_film:
        line = np.degrees(np.mod(result.attitude, 2 * np.pi)) - 180.0
        axes.axvline(line, color=FILM, label="p = 0 imposed")
    axes.axvline(np.degrees(result.attitude), color=FILM, linestyle=":", label="minimum film")


def _draw_curves(axes: Axes, result: BearingResult, angle: np.ndarray, middle: np.ndarray) -> None:
    """Pressure and film thickness at mid-width."""
    degrees = np.degrees(angle)
    axes.fill_between(degrees, middle, color=PRESSURE, alpha=0.15, linewidth=0)
    axes.plot(degrees, middle, color=PRESSURE)
    axes.set_ylabel("pressure at mid-width [MPa]", color=PRESSURE)
    axes.set(
        xlabel="angle from the load line in direction of rotation [degrees]",
        xlim=(-180, 180),
        xticks=np.arange(-180, 181, 45),
        ylim=(0, 1.05 * middle.max() or 1.0),
    )
    axes.grid(alpha=0.3)
    x, y = result.operation.position
    thickness = result.settings.clearance - x * np.cos(angle) - y * np.sin(angle)
    if result.settings.bore_shape is not None:
        thickness += result.settings.bore_shape.radial(angle, np.zeros_like(angle))
    film = axes.twinx()
    film.plot(degrees, 1e6 * thickness, color=FILM, linestyle="--")
    film.set_ylabel("film thickness [µm]", color=FILM)
    film.set_ylim(0, 1.05e6 * thickness.max())


def _draw_sketch(axes: Axes, result: BearingResult, angle: np.ndarray, middle: np.ndarray) -> None:
    """Bore and shaft seen along the axis, clearance exaggerated: x down, y to the right."""
    highest = middle.max()
    bulge = 1 + SKETCH_PRESSURE * (middle / highest if highest else middle)
    right, down = np.sin(angle), np.cos(angle)
    axes.fill(
        np.concatenate([right, (bulge * right)[::-1]]),
        -np.concatenate([down, (bulge * down)[::-1]]),
        color=PRESSURE,
        alpha=0.15,
        linewidth=0,
    )
    loaded = middle > 0
    axes.plot(
        np.where(loaded, bulge * right, np.nan), -np.where(loaded, bulge * down, np.nan), PRESSURE
    )
    axes.add_patch(Circle((0, 0), 1.0, fill=False, color="0.3", linewidth=1.6))
    x, y = SKETCH_CLEARANCE * result.operation.position / result.settings.clearance
    radius = 1.0 - SKETCH_CLEARANCE
    axes.add_patch(Circle((y, -x), radius, facecolor="0.93", edgecolor="0.3", linewidth=1.2))
    for groove in result.settings.grooves:
        span = groove.angle + groove.width * np.linspace(-0.5, 0.5, 30)
        axes.plot(np.sin(span), -np.cos(span), color=FILM, linewidth=5, solid_capstyle="butt")
    _draw_directions(axes, result, (y, -x), radius)
    axes.set_aspect("equal")
    axes.set(xlim=(-1.65, 1.65), ylim=(-1.95, 1.65))
    axes.axis("off")
    axes.set_title(_caption(result), fontsize=9, loc="left")


def _draw_directions(
    axes: Axes, result: BearingResult, centre: tuple[float, float], radius: float
) -> None:
    """Load, line of centres, attitude and sense of rotation."""
    arrow = {"arrowstyle": "-|>", "color": LOAD, "linewidth": 1.8, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (centre[0], -1.85), (centre[0], centre[1] - radius), arrowprops=arrow)
    axes.text(centre[0] + 0.06, -1.85, "W", fontsize=11, va="bottom")
    axes.plot([0, 0], [0, -0.62], color="0.5", linewidth=0.8, linestyle="--")
    axes.plot(*zip((0, 0), centre, strict=True), "+", color="0.3")
    if result.attitude is not None:
        reach = 0.55
        phi = result.attitude
        axes.plot([0, reach * np.sin(phi)], [0, -reach * np.cos(phi)], color=FILM, linewidth=1.0)
        start, end = sorted((-90.0, -90.0 + np.degrees(phi)))
        axes.add_patch(Arc((0, 0), 0.8, 0.8, theta1=start, theta2=end, color=FILM))
        half = 0.5 * phi
        axes.text(
            0.48 * np.sin(half), -0.48 * np.cos(half), "φ", color=FILM, ha="center", va="center"
        )
    if result.settings.speed or result.settings.bore_speed:
        inner = 0.8 * radius if result.settings.speed else 0.93
        where = np.array(centre if result.settings.speed else (0.0, 0.0))
        ends = [where + inner * np.array([np.sin(t), -np.cos(t)]) for t in np.radians([100, 170])]
        turning = {"color": "0.3", "linewidth": 1.4, "connectionstyle": "arc3,rad=0.32"}
        axes.annotate("", ends[1], ends[0], arrowprops=arrow | turning)


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
