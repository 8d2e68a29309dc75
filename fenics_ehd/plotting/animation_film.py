"""The film of an animation: gap and pressure over the unwrapped bore, and around the shaft."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Polygon
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay

#: Points around and along the bore to which nodal values are interpolated.
AROUND, ALONG = 181, 17

#: From the colour of oil to red, lighter to darker also in grey.
PRESSURE_COLOURS = "YlOrRd"

#: Height of the largest pressure drawn around a bore, over its radius.
FAN = 0.45


@dataclass(frozen=True, eq=False)
class FilmFrames:
    """Film on a regular raster of the unwrapped bore, the last column again the first.

    Attributes
    ----------
    angle
        From the x axis of the part, ascending over one turn, shape (a,) [rad].
    height
        shape (b,) [m].
    pressure
        shape (t, b, a) [Pa].
    gap
        shape (t, b, a) [m].
    radius, clearance
        Of the bore, and the radial clearance [m].
    """

    angle: np.ndarray
    height: np.ndarray
    pressure: np.ndarray
    gap: np.ndarray
    radius: float
    clearance: float


def film_frames(
    pressure_nodes: np.ndarray,
    pressure: np.ndarray,
    bore_nodes: np.ndarray,
    gap: np.ndarray,
    clearance: float,
) -> FilmFrames:
    """Interpolate nodal values to a raster.

    Parameters
    ----------
    pressure_nodes, bore_nodes
        Positions, shape (k, 3) and (m, 3) [m].
    pressure, gap
        Values there, shape (t, k) [Pa] and (t, m) [m].
    clearance
        [m].
    """
    radius = float(np.hypot(*bore_nodes[:, :2].T).mean())
    angle = np.linspace(-np.pi, np.pi, AROUND)
    half = 0.5 * np.ptp(bore_nodes[:, 2])
    height = bore_nodes[:, 2].min() + half + np.linspace(-half, half, ALONG)
    pressures = _raster(pressure_nodes, pressure, radius, angle, height)
    gaps = _raster(bore_nodes, gap, radius, angle, height)
    # The seam belongs where nothing is to be seen.
    highest = pressures.max(axis=(0, 1))
    if highest[0] > highest[AROUND // 2]:
        angle, pressures, gaps = angle + np.pi, _half_a_turn(pressures), _half_a_turn(gaps)
    return FilmFrames(angle, height, pressures, gaps, radius, clearance)


def _half_a_turn(field: np.ndarray) -> np.ndarray:
    """A field over one turn, begun half a turn later."""
    rolled = np.roll(field[..., :-1], -(AROUND // 2), axis=-1)
    return np.concatenate([rolled, rolled[..., :1]], axis=-1)


def _raster(
    nodes: np.ndarray, values: np.ndarray, radius: float, angle: np.ndarray, height: np.ndarray
) -> np.ndarray:
    """Values (t, n) at nodes on the bore, linearly interpolated, shape (t, heights, angles)."""
    around = np.arctan2(nodes[:, 1], nodes[:, 0])
    turns = np.concatenate([around - 2 * np.pi, around, around + 2 * np.pi])
    places = np.column_stack([radius * turns, np.tile(nodes[:, 2], 3)])
    found = LinearNDInterpolator(Delaunay(places), np.tile(values.T, (3, 1)))
    low, high = nodes[:, 2].min(), nodes[:, 2].max()
    middle = 0.5 * (low + high)
    # On the very edge of the nodes, round-off may put a point outside.
    inside = middle + (np.clip(height, low, high) - middle) * (1 - 1e-9)
    grid = np.meshgrid(radius * angle, inside)
    return np.moveaxis(found(*grid), -1, 0)


class UnwrappedBore:
    """Pressure over the unwrapped bore, and where the film is thinnest.

    Parameters
    ----------
    axes
        Where.
    film
        What.
    zero
        What lies at angle zero, for the label.
    """

    def __init__(self, axes: Axes, film: FilmFrames, zero: str):
        self._film = film
        angle, height = np.degrees(film.angle), 1e3 * film.height
        self._image = axes.imshow(
            1e-6 * film.pressure[0],
            extent=(angle[0], angle[-1], height[0], height[-1]),
            origin="lower",
            aspect="auto",
            interpolation="bilinear",
            cmap=PRESSURE_COLOURS,
            vmin=0.0,
            vmax=1e-6 * film.pressure.max(),
        )
        (self._thinnest,) = axes.plot(
            [],
            [],
            marker="o",
            linestyle="none",
            color="white",
            markeredgecolor="black",
            label="thinnest film",
            clip_on=False,
            zorder=5,
        )
        axes.set(
            xlabel=f"angle from {zero} [°]",
            ylabel="z [mm]",
            title="film pressure on the unwrapped bore",
            xticks=np.arange(angle[0], angle[-1] + 1, 90),
        )
        axes.legend(loc="upper right", fontsize="small", handletextpad=0.2, framealpha=0.8)
        axes.figure.colorbar(self._image, ax=axes, label="pressure [MPa]", aspect=14, pad=0.02)

    def show(self, frame: int) -> None:
        """Draw one instant."""
        film = self._film
        self._image.set_data(1e-6 * film.pressure[frame])
        row, column = np.unravel_index(np.argmin(film.gap[frame]), film.gap[frame].shape)
        self._thinnest.set_data([np.degrees(film.angle[column])], [1e3 * film.height[row]])


class FilmRing:
    """Oil between shaft and bore, coloured by the highest pressure over the width.

    Parameters
    ----------
    axes
        Where.
    film
        What.
    scale
        Enlargement of clearance and gap.
    """

    def __init__(self, axes: Axes, film: FilmFrames, scale: float):
        self._film, self._scale = film, scale
        self._normal = np.column_stack([np.cos(film.angle), np.sin(film.angle)])
        self._oil = PolyCollection([], cmap=PRESSURE_COLOURS, zorder=2, linewidths=0.4)
        self._oil.set_clim(0.0, 1e-6 * film.pressure.max())
        axes.add_collection(self._oil)

    @property
    def shaft_radius(self) -> float:
        """Of the shaft as drawn [m]."""
        return self._film.radius - self._scale * self._film.clearance

    def show(self, frame: int, centre: np.ndarray, shaft: np.ndarray, turn: np.ndarray) -> None:
        """Draw one instant: centre of the bore and of the shaft (2,) [m], rotation (2, 2)."""
        film = self._film
        # The bore as seen from its centre: the shaft, and beyond it the widest gap; where the gap
        # is narrower, the part's front covers the oil.
        along = (shaft - centre) @ turn @ self._normal.T
        reach = self.shaft_radius + along + self._scale * film.gap[frame].max(axis=0)
        inner = shaft + self.shaft_radius * self._normal @ turn.T
        outer = centre + reach[:, None] * self._normal @ turn.T
        quads = np.stack([inner[:-1], inner[1:], outer[1:], outer[:-1]], axis=1)
        pressure = 1e-6 * film.pressure[frame].max(axis=0)
        self._oil.set_verts(quads)
        self._oil.set_array(0.5 * (pressure[1:] + pressure[:-1]))
        self._oil.set_edgecolor("face")


class PressureFan:
    """Highest pressure over the width, drawn outwards from the bore.

    Parameters
    ----------
    axes
        Where.
    film
        What.
    scale
        Enlargement of clearance and gap.
    """

    def __init__(self, axes: Axes, film: FilmFrames, scale: float):
        self._film, self._scale = film, scale
        self._normal = np.column_stack([np.cos(film.angle), np.sin(film.angle)])
        self._height = FAN * film.radius / max(film.pressure.max(), 1e-300)
        self._fan = Polygon(np.zeros((3, 2)), facecolor="#b03a2e55", edgecolor="none", zorder=4)
        axes.add_patch(self._fan)
        (self._tip,) = axes.plot([], [], color="#b03a2e", linewidth=1.2, zorder=4)

    def show(self, frame: int, centre: np.ndarray, shaft: np.ndarray) -> None:
        """Draw one instant: centre of the bore and of the shaft, shape (2,) [m]."""
        film = self._film
        # The mean over the width has no share of the shaft's tilt.
        gap = film.gap[frame].mean(axis=0)
        foot = film.radius + self._normal @ (shaft - centre) + self._scale * (gap - film.clearance)
        height = self._height * film.pressure[frame].max(axis=0)
        inner, outer = (r[:, None] * self._normal + centre for r in (foot, foot + height))
        self._fan.set_xy(np.concatenate([inner[::-1], outer]))
        shown = height > 0.01 * FAN * film.radius
        self._tip.set_data(*np.where(shown[:, None], outer, np.nan).T)


class Curves:
    """Peak pressure and thinnest film of the whole run, with a mark that moves.

    Parameters
    ----------
    axes
        Two, one above the other.
    time
        shape (s,) [s].
    pressure, thickness
        shape (s,) [Pa], [m].
    """

    def __init__(
        self, axes: Sequence[Axes], time: np.ndarray, pressure: np.ndarray, thickness: np.ndarray
    ):
        self._time = 1e3 * time
        self._values = (1e-6 * pressure, 1e6 * thickness)
        self._marks, self._dots = [], []
        labels = ("max. pressure [MPa]", "min. film [µm]")
        for ax, values, label, colour in zip(
            axes, self._values, labels, ("#b03a2e", "#21618c"), strict=True
        ):
            ax.plot(self._time, values, color=colour, linewidth=1.2)
            self._marks.append(ax.axvline(self._time[0], color="0.3", linewidth=0.9))
            self._dots += ax.plot([], [], "o", color=colour, markersize=5, markeredgecolor="white")
            ax.set(ylim=(0, None), xlim=(0, self._time[-1]))
            ax.set_title(label, loc="left", fontsize="medium")
            ax.grid(alpha=0.3)
        axes[0].tick_params(labelbottom=False)
        axes[1].set_xlabel("time [ms]")

    def show(self, time: float) -> None:
        """Draw one instant [s]."""
        now = 1e3 * time
        for mark, dot, values in zip(self._marks, self._dots, self._values, strict=True):
            mark.set_xdata([now, now])
            dot.set_data([now], [np.interp(now, self._time, values)])
