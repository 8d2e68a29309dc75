"""The rotor of an animation: housing and shaft, the shaft's deflection, its orbit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from fenics_ehd.plotting.animation_crank import Disc, mark_angles
from fenics_ehd.plotting.animation_film import FilmFrames, FilmRing, PressureFan
from fenics_ehd.plotting.animation_part import PartDrawing, PartView

ACROSS = ("#7b4f9d", "#2a7f62")


@dataclass(frozen=True, eq=False)
class RotorFrames:
    """Where a rotor and its housing are drawn.

    Attributes
    ----------
    housing
        In the frame at rest.
    shaft
        Centre of the shaft at mid-width of the bore, not enlarged, shape (t, 2) [m].
    slope
        Of its axis along z, shape (t, 2) [-].
    angle
        By which it has turned, shape (t,) [rad].
    position
        Along the shaft, shape (p,) [m].
    deflection
        There, along x and y, shape (t, p, 2) [m].
    marks
        Positions along the shaft worth naming [m], by name.
    """

    housing: PartView
    shaft: np.ndarray
    slope: np.ndarray
    angle: np.ndarray
    position: np.ndarray
    deflection: np.ndarray
    marks: dict[str, float]


class HousingDrawing:
    """Housing, film and shaft seen along the axis."""

    def __init__(self, axes: Axes, frames: RotorFrames, film: FilmFrames, scale: float):
        self._frames, self._scale = frames, scale
        self._ring = FilmRing(axes, film, scale)
        self._pressure = PressureFan(axes, film, scale)
        self._shaft = Disc(axes, self._ring.shaft_radius)
        self._reach = 0.5 * np.ptp(film.height)
        radius = self._ring.shaft_radius
        self._ends = [
            Circle((0, 0), radius, fill=False, ec="0.25", lw=0.8, ls=style, zorder=4)
            for style in ("-", ":")
        ]
        for end in self._ends:
            axes.add_patch(end)
        self._housing = PartDrawing(axes, frames.housing)
        low, high = frames.housing.rest.min(axis=0), frames.housing.rest.max(axis=0)
        margin = 0.06 * (high - low).max()
        axes.set(
            aspect="equal",
            xlim=(low[0] - margin, high[0] + margin),
            ylim=(low[1] - margin, high[1] + margin),
            title="shaft in the housing",
        )
        axes.axis("off")
        mark_angles(axes, film)

    def show(self, frame: int) -> None:
        """Draw one instant."""
        origin, unturned = np.zeros(2), np.eye(2)
        shaft = self._scale * self._frames.shaft[frame]
        self._ring.show(frame, origin, shaft, unturned)
        self._pressure.show(frame, origin, shaft)
        self._shaft.show(shaft, self._frames.angle[frame])
        self._housing.show(frame, (origin, unturned))
        # Where the tilted shaft leaves the bore, in front and behind.
        for end, side in zip(self._ends, (1, -1), strict=True):
            end.center = shaft + side * self._reach * self._scale * self._frames.slope[frame]


class Deflection:
    """Deflection of the shaft along its length, with its bearing, disk and force."""

    def __init__(self, axes: Axes, frames: RotorFrames):
        self._frames = frames
        self._lines = [
            axes.plot([], [], color=colour, linewidth=2.0, label=label)[0]
            for colour, label in zip(ACROSS, ("x, across", "y, upwards"), strict=True)
        ]
        reach = 1.15e6 * np.abs(frames.deflection).max()
        length = frames.position[-1]
        axes.axhline(0.0, color="0.7", linewidth=0.8, linestyle="-.")
        for name, position in frames.marks.items():
            axes.axvline(position, color="0.6", linewidth=0.8, linestyle=":")
            axes.text(position + 0.005 * length, 0.96 * reach, name, va="top", color="0.35")
        axes.set(
            xlim=(0, length),
            ylim=(-reach, reach),
            xlabel="along the shaft [m]",
            ylabel="deflection [µm]",
            title="deflection of the shaft",
        )
        axes.grid(alpha=0.3)
        axes.legend(loc="lower left", ncols=2, framealpha=0.9)

    def show(self, frame: int) -> None:
        """Draw one instant."""
        for line, values in zip(self._lines, self._frames.deflection[frame].T, strict=True):
            line.set_data(self._frames.position, 1e6 * values)


class Orbit:
    """Path of the shaft's centre relative to the bore's.

    Parameters
    ----------
    axes
        Where.
    path
        Of the whole run, shape (s, 2) [m].
    time, frame_time
        Of the path and of the frames, shape (s,) and (t,) [s].
    clearance
        [m].
    """

    def __init__(
        self,
        axes: Axes,
        path: np.ndarray,
        time: np.ndarray,
        frame_time: np.ndarray,
        clearance: float,
    ):
        self._path, self._time, self._frame_time = 1e6 * path, time, frame_time
        c = 1e6 * clearance
        axes.add_patch(Circle((0, 0), c, fill=False, color="0.3", linewidth=1.2))
        axes.plot(*self._path.T, color="0.82", linewidth=0.8)
        (self._line,) = axes.plot([], [], color="#21618c", linewidth=1.3)
        (self._dot,) = axes.plot([], [], "o", color="#21618c", markeredgecolor="white")
        reach = 1.06 * max(c, np.abs(self._path).max())
        axes.set(
            aspect="equal",
            xlim=(-reach, reach),
            ylim=(-reach, reach),
            xlabel="eccentricity x [µm]",
            ylabel="y [µm]",
            title=f"orbit, clearance {c:.3g} µm",
        )
        axes.grid(alpha=0.3)

    def show(self, frame: int) -> None:
        """Draw one instant."""
        now = self._frame_time[frame]
        past = self._path[self._time < now]
        here = [np.interp(now, self._time, values) for values in self._path.T]
        self._line.set_data(*np.vstack([past, here]).T)
        self._dot.set_data([here[0]], [here[1]])
