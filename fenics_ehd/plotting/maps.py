"""Maps over the unwrapped bore, sections of the deformed bore, and a bearing's picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import fenics_ehd.base.matplotlib_start  # noqa: F401  # isort: skip
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator

from fenics_ehd.base.plane import rotation
from fenics_ehd.film.grid import FilmGrid
from fenics_ehd.multibody.summary import extreme_step
from fenics_ehd.plotting.curves import Rows, common_axis, position_label, pressure_and_film
from fenics_ehd.plotting.picture import (
    BLUE,
    PANEL,
    PRESSURES,
    RED,
    WIDTH,
    factor_of,
    legend,
    plt,
    save,
    with_unit,
)
from fenics_ehd.plotting.shown import ANGLE, TIME, ShownJoint, mean

if TYPE_CHECKING:
    from fenics_ehd.analysis.bearing import BearingResult

#: Largest number of colours in a map.
LEVELS = 12

#: Height of a map [inches].
HEIGHT = 2.5

#: Least numbers of intervals of a raster around and along the bore. Within the cells of a coarser
#: film the raster has the film's own shape functions.
FINEST = (240, 48)


class Raster(NamedTuple):
    """Values on a raster of angles and heights, with a title and a marked point.

    Attributes
    ----------
    values
        Values at all heights and angles, shape (b, a).
    angle, height
        Angles around the bore [degrees], shape (a,), and heights along it [mm], shape (b,).
    title
        Title of the map.
    mark
        Value, angle [degrees] and height [mm] of the marked point.
    """

    values: np.ndarray
    angle: np.ndarray
    height: np.ndarray
    title: str
    mark: tuple[float, float, float]


@dataclass(frozen=True)
class Map:
    """Map of a field over angle and width of the bore, one for every joint and run.

    Attributes
    ----------
    label
        Label of the colours, with its unit in brackets.
    fields
        Name of the field of a film, ``"pressure"``, ``"gap"`` or ``"contact"``.
    colours
        Name of the colour map.
    extreme
        Function that reduces the values of every node over the cycle to one value, `numpy.max` or
        `numpy.min`; None for the mean over time.
    marked
        Names of the columns with value, angle [degrees] and height [m] of the extreme to mark. This
        extreme may lie between nodes; without columns, the largest nodal value is marked.
    """

    label: str
    fields: str
    colours: str
    extreme: Callable[..., np.ndarray] | None = None
    marked: tuple[str, ...] = ()

    def has(self, joint: ShownJoint) -> bool:
        """True if a joint has the field."""
        return self._values(joint) is not None

    def _values(self, joint: ShownJoint) -> np.ndarray | None:
        return joint.contact if self.fields == "contact" else getattr(joint.film, self.fields)

    def draw(self, rows: Rows) -> Figure:
        """Draw the maps of joints in one or more runs; maps of a joint share a colour scale."""
        groups = []
        for title, joints in rows.items():
            groups.append([self.raster(j, _title(title, j, len(joints))) for j in joints])
        return draw_rasters(groups, self.label, self.colours, from_zero=self.extreme is not np.min)

    def raster(self, joint: ShownJoint, title: str) -> Raster:
        """Reduce the field of a joint over the cycle; the raster has the lines of the film mesh."""
        values = np.asarray(self._values(joint))
        if self.extreme is None:
            nodal = mean(values, joint.columns[TIME])
        else:
            nodal = self.extreme(values, axis=0)
        factor = factor_of(self.label)
        raster = raster_of(joint.grid, factor * nodal, title)
        if not self.marked:
            return raster
        column, angle, height = (joint.columns[name] for name in self.marked)
        step = column.argmin() if self.extreme is np.min else column.argmax()
        _, value = joint.extreme(self.marked[0], TIME) or (0.0, column[step])
        mark = factor * value, angle[step], 1e3 * height[step]
        return raster._replace(mark=mark)


def raster_of(grid: FilmGrid, nodal: np.ndarray, title: str) -> Raster:
    """Raster of nodal values on and between the lines of a film mesh.

    The nodal value of the largest magnitude is marked. Between the nodes, values are limited to the
    range of the nodal values.
    """
    angle, height = (np.unique(x.round(9)) for x in grid.node_positions.T)
    angle = np.unique(np.append((np.degrees(angle) + 180.0) % 360.0 - 180.0, [-180.0, 180.0]))
    on_lines = sampled(grid, nodal, np.radians(angle), height)
    mark = largest(on_lines, angle, 1e3 * height)
    angle, height = (
        refined(lines, least) for lines, least in zip((angle, height), FINEST, strict=True)
    )
    values = sampled(grid, nodal, np.radians(angle), height)
    values = np.clip(values, on_lines.min(), on_lines.max())
    return Raster(values, angle, 1e3 * height, title, mark)


def refined(lines: np.ndarray, least: int) -> np.ndarray:
    """Divide all intervals between lines, shape (k,), into parts, so that there are `least`."""
    intervals = len(lines) - 1
    parts = -(-least // intervals)
    return np.interp(np.arange(parts * intervals + 1) / parts, np.arange(intervals + 1), lines)


def sampled(grid: FilmGrid, nodal: np.ndarray, angle: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Interpolate nodal values to a raster of angles [rad] and heights [m], shape (..., b, a).

    Shapes are (..., k) for values at k nodes, (a,) for angles and (b,) for heights.
    """
    around, along = (x.ravel() for x in np.meshgrid(angle, height))
    values = (grid.interpolation(around, along) @ nodal.T).T
    return values.reshape(*nodal.shape[:-1], len(height), len(angle))


def draw_rasters(
    groups: Sequence[Sequence[Raster]], label: str, colours: str, *, from_zero: bool = True
) -> Figure:
    """Draw maps below each other; maps of a group share a colour scale, see `draw_raster`."""
    count = sum(map(len, groups))
    figure, grid_axes = plt.subplots(
        count, figsize=(WIDTH, HEIGHT * count + 0.5), layout="constrained",
        sharex=True, squeeze=False,
    )  # fmt: skip
    next_axes = iter(grid_axes.flat)
    for rasters in groups:
        lowest = 0.0 if from_zero else min(raster.values.min() for raster in rasters)
        levels = levels_between(lowest, max(raster.values.max() for raster in rasters))
        for raster in rasters:
            axes = next(next_axes)
            draw_raster(axes, raster, levels, label, colours)
    axes.set_xlabel("angle on the bore from its body's x axis, from x to y [°]")
    return figure


def draw_raster(axes: Axes, raster: Raster, levels: np.ndarray, label: str, colours: str) -> None:
    """Draw a map and its marked point; `label` names the colours, with the unit in brackets."""
    values, angle, height, title, (value, where, z) = raster
    # Round-off below the lowest colour would leave holes in the map.
    values = np.maximum(values, levels[0])
    image = axes.contourf(angle, height, values, levels, cmap=colours)
    if np.ptp(values):
        axes.contour(angle, height, values, levels[1:], colors="0.2", linewidths=0.4)
    axes.plot(where, z, "o", markerfacecolor="white", markeredgecolor="black", clip_on=False)
    decimals = max(0, 4 - int(np.ceil(np.log10(np.ptp(height)))))  # a ten-thousandth of the width
    position = f"at {where:.0f}°, z = {round(z, decimals) + 0.0:g} mm"
    axes.set_title(f"{with_unit(value, label)} {position}", loc="right")
    axes.set_title(title, loc="left", fontweight="bold")
    axes.set(ylabel="z [mm]", xticks=np.arange(-180, 181, 45))
    axes.grid(False)
    axes.figure.colorbar(image, ax=axes, label=label, pad=0.02)


def levels_between(low: float, high: float) -> np.ndarray:
    """Round values between two limits, at which the colour of a map changes."""
    return MaxNLocator(LEVELS).tick_values(low, high if high > low else low + 1.0)


def largest(
    values: np.ndarray, angle: np.ndarray, height: np.ndarray
) -> tuple[float, float, float]:
    """Value with the largest magnitude on a raster, and its angle and height."""
    row, column = np.unravel_index(np.argmax(np.abs(values)), values.shape)
    return values[row, column], angle[column], height[row]


def _title(title: str, joint: ShownJoint, runs: int) -> str:
    return ", ".join(filter(None, (title, joint.run.name if runs > 1 else "")))


#: Sizes over the bore's radius: the larger one of drawn clearance and drawn radial displacement,
#: the drawn height of the largest pressure, and half the side of a panel.
ENLARGED = 0.2
FAN = 0.35
REACH = 1.62

#: Angles of points around the bore [rad], and outward unit vectors at these points.
ANGLES = np.linspace(-np.pi, np.pi, 361)
NORMALS = np.array([np.cos(ANGLES), np.sin(ANGLES)])


#: Instants of which the bore is drawn: names, by the column with the extreme.
INSTANTS = {"max_pressure_Pa": "peak pressure", "min_film_thickness_m": "minimum film"}


@dataclass(frozen=True)
class Bores:
    """Bore, journal and pressure at the instants of peak pressure and of minimum film.

    The bore is drawn about the centre of its best-fitting circle, as in the orbit. The area between
    bore and journal is the film in the section with the minimum film.
    """

    def has(self, joint: ShownJoint) -> bool:
        """True for a joint, which has a bore to draw; false for a run as a whole."""
        return bool(joint.name)

    def draw(self, rows: Rows) -> Figure:
        """Draw both instants in a row, with a row for every joint and run."""
        cells = [(title, joint, joints) for title, joints in rows.items() for joint in joints]
        figure, panels = plt.subplots(
            len(cells), 2, figsize=(2 * PANEL, (PANEL + 0.4) * len(cells)), layout="constrained",
            squeeze=False,
        )  # fmt: skip
        for pair, (title, joint, joints) in zip(panels, cells, strict=True):
            name = _title(title, joint, len(joints))
            steps = [extreme_step(column, joint.columns[column]) for column in INSTANTS]
            scale = _scale(joint, steps)
            for axes, (column, instant), step in zip(pair, INSTANTS.items(), steps, strict=True):
                over = common_axis([joint])
                now = joint.columns[over][step] * (1.0 if over == ANGLE else 1e3)
                values = {other: joint.columns[other][step] for other in INSTANTS}
                now, values[column] = joint.extreme(column, over) or (now, values[column])
                _draw(axes, joint, step, scale, values)
                title = (
                    f"{instant}, {position_label(now, over)}\nclearance and deformation × {scale:g}"
                )
                axes.set_title(f"{name}: {title}" if name else title)
        return figure


def profile(joint: ShownJoint, step: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gap and pressure around the bore at a step, and the journal's position in the bore.

    Returns
    -------
    gap, pressure
        Gap in the section with the minimum film [m], and largest pressure over the width of the
        bore [Pa], both at `ANGLES`, shape (a,).
    position
        Eccentricity of the journal in the circle that fits the bore in this section, shape (2,)
        [m].
    """
    height = np.unique(joint.grid.node_positions[:, 1].round(9))
    nodal = np.array([joint.film.gap[step], joint.film.pressure[step]])
    gaps, pressures = sampled(joint.grid, nodal, ANGLES, height)
    gap = gaps[np.argmin(gaps.min(axis=1))]
    waves = np.column_stack([np.ones(len(ANGLES)), -NORMALS.T])
    position = np.linalg.lstsq(waves[:-1], gap[:-1], rcond=None)[0][1:]
    return gap, np.maximum(pressures, 0.0).max(axis=0), position


def outward(gap: np.ndarray, position: np.ndarray, clearance: float) -> np.ndarray:
    """Radial deviation of a bore from a round bore at `ANGLES`, shape (a,) [m].

    Parameters
    ----------
    gap
        Gap at `ANGLES`, shape (a,) [m].
    position
        Eccentricity of the journal, shape (2,) [m].
    clearance
        Radial clearance [m].
    """
    return gap - clearance + position @ NORMALS


def _scale(joint: ShownJoint, steps: list[int]) -> float:
    """Magnification of clearance and deformation for the drawings at `steps`, a round number."""
    largest = clearance = joint.film.clearance
    for step in steps:
        gap, _, position = profile(joint, step)
        largest = max(largest, float(np.abs(outward(gap, position, clearance)).max()))
    return round_scale(ENLARGED * joint.film.radius / largest)


def round_scale(largest: float) -> float:
    """Round a number down to one significant digit, and to at least 1."""
    power = 10.0 ** np.floor(np.log10(largest))
    return float(max(1.0, power * np.floor(largest / power * (1 + 1e-9))))


def _draw(
    axes: Axes, joint: ShownJoint, step: int, scale: float, values: Mapping[str, float]
) -> None:
    """Draw the bore at a step; `values` has peak pressure and minimum film for the legend."""
    film = joint.film
    gap, pressure, position = profile(joint, step)
    labels = (
        f"pressure, up to {1e-6 * values['max_pressure_Pa']:.4g} MPa",
        f"thinnest, {1e6 * values['min_film_thickness_m']:.4g} µm",
    )
    share = pressure / (film.pressure.max() or 1.0)
    enlarged = scale / film.radius
    draw_section(
        axes, enlarged * gap, share, enlarged * position, enlarged * film.clearance, labels
    )
    lay_out_section(axes)


def draw_section(
    axes: Axes,
    gap: np.ndarray,
    pressure: np.ndarray,
    position: np.ndarray,
    clearance: float,
    labels: tuple[str, str],
    *,
    turn: float = 0.0,
    centre: Sequence[float] | np.ndarray = (0.0, 0.0),
    radius: float = 1.0,
) -> None:
    """Draw bore, journal and pressure in a section, viewed along the axis.

    Parameters
    ----------
    axes
        Axes to draw in.
    gap, pressure
        Magnified gap over the bore's radius, and pressure over the largest pressure, both at
        `ANGLES`, shape (a,).
    position, clearance
        Magnified eccentricity of the journal, shape (2,), and magnified radial clearance, both over
        the bore's radius.
    labels
        Labels of the pressure and of the thinnest film in the legend.
    turn, centre, radius
        Angle of the bore's x axis [rad], centre and radius of the bore in the picture.
    """
    turned = radius * rotation(turn)
    middle = np.reshape(centre, (2, 1))
    bore = (1.0 + outward(gap, position, clearance)) * NORMALS
    fan = np.hstack([bore, (bore + FAN * pressure * NORMALS)[:, ::-1]])
    journal = middle[:, 0] + turned @ position
    axes.fill(
        *(middle + turned @ fan), color=RED, alpha=0.35, linewidth=0, clip_on=False,
        label=labels[0], zorder=4,
    )  # fmt: skip
    round_bore = middle + radius * NORMALS
    axes.plot(*round_bore, color="0.4", linewidth=1.0, linestyle=":", label="round bore", zorder=4)
    axes.add_patch(
        Circle(
            journal, (1.0 - clearance) * radius, facecolor="0.92", edgecolor="0.35", linewidth=1.2,
            zorder=4,
        )
    )  # fmt: skip
    axes.plot(*(middle + turned @ bore), color=BLUE, linewidth=2.0, label="deformed bore", zorder=4)
    axes.plot(*journal, "+", color="0.35", zorder=4)
    thinnest = middle[:, 0] + turned @ bore[:, int(gap.argmin())]
    axes.plot(*thinnest, "o", color="white", markeredgecolor="black", label=labels[1], zorder=4)


def lay_out_section(axes: Axes, turn: float = 0.0) -> None:
    """Set limits, legend and angle labels of the axes of a section whose bore has the radius 1."""
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlim=(-REACH, REACH), ylim=(-REACH, REACH))
    axes.axis("off")
    for degrees in (0, 90, 180, -90):
        where = 0.5 * rotation(turn + np.radians(degrees))[:, 0]
        style = {"color": "0.4", "fontsize": 8, "zorder": 5}
        axes.text(*where, f"{degrees}°", ha="center", va="center", **style)
    legend(axes, loc="upper center", bbox_to_anchor=(0.5, 0.02), ncols=2, frameon=False)


def plot_bearing(result: BearingResult, path: str | Path) -> None:
    """Draw the result of a bearing to a file; its ending determines the format."""
    save(bearing_figure(result), [path])


def bearing_figure(result: BearingResult) -> Figure:
    """Draw the result of a bearing: map, curves and section. Angles are from the load line."""
    figure, axes = plt.subplot_mosaic(
        [["map", "section"], ["curves", "section"]],
        figsize=(11.0, 5.8),
        width_ratios=(1.45, 1.0),
        layout="constrained",
    )
    settings = result.settings
    position = result.position
    grid = result.film.parameters.grid
    height = np.linspace(grid.heights[0], grid.heights[-1], 81)
    sampled_pressure = sampled(grid, result.state.pressure, ANGLES - result.angle, height)
    pressure = 1e-6 * np.maximum(sampled_pressure, 0.0)
    gap = settings.clearance - position @ NORMALS
    if settings.bore_shape is not None:
        gap += settings.bore_shape.radial(ANGLES, np.zeros_like(ANGLES))
    degrees = np.degrees(ANGLES)
    millimetres = 1e3 * height
    highest = pressure.max()
    mark = largest(pressure, degrees, millimetres)
    raster = Raster(pressure, degrees, millimetres, "", mark)
    levels = levels_between(0.0, highest)
    draw_raster(axes["map"], raster, levels, "pressure [MPa]", PRESSURES)
    _mark(axes["map"], result, millimetres[[0, -1]])
    middle = pressure[len(height) // 2]
    axes["curves"].fill_between(degrees, middle, color=RED, alpha=0.15, linewidth=0)
    labels = "pressure at mid-width [MPa]", "film thickness [µm]"
    pressure_and_film(axes["curves"], degrees, middle, 1e6 * gap, labels)
    along = "angle from the load line in direction of rotation [degrees]"
    axes["curves"].set(xlabel=along, xlim=(-180, 180), xticks=np.arange(-180, 181, 45))
    axes["map"].sharex(axes["curves"])
    enlarged = ENLARGED / settings.clearance
    share = middle / (highest or 1.0)
    section_labels = ("pressure at mid-width", "thinnest there")
    draw_section(
        axes["section"],
        enlarged * gap,
        share,
        enlarged * position,
        ENLARGED,
        section_labels,
        turn=-np.pi / 2,
    )
    lay_out_section(axes["section"], -np.pi / 2)
    axes["section"].set_aspect("equal", adjustable="box")
    arrow = {"arrowstyle": "-|>", "color": "0.15", "linewidth": 1.8}
    axes["section"].annotate("W", (0, 0.62), (0, 1.4), ha="center", arrowprops=arrow)
    axes["section"].set_title(_caption(result), fontsize=9, loc="left")
    return figure


def _mark(axes: Axes, result: BearingResult, ends: np.ndarray) -> None:
    """Mark grooves, the line with imposed zero pressure, and the angle of the minimum film.

    `ends` are the heights of the lower and upper end of the bearing [mm].
    """
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
