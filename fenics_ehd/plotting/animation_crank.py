"""The slider-crank of an animation: crank, rod and piston, and the big end close up.

Displacements are enlarged about the rod's chord, the line from the shaft's centre to the piston's
pin: the gap does not change when the rod turns about the shaft, and the pin stays on its line.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyBboxPatch, Polygon

from fenics_ehd.plane import rotation
from fenics_ehd.plotting.animation_film import FilmFrames, FilmRing, PressureFan
from fenics_ehd.plotting.animation_part import PartDrawing, PartView

CRANK, SHAFT, PISTON = "#e3d5c0", "#9c8465", "#dfe5ea"


@dataclass(frozen=True, eq=False)
class CrankFrames:
    """Where everything of a slider-crank is drawn.

    Attributes
    ----------
    crank_pin
        Centre C1 of the shaft, shape (t, 2) [m].
    crank_angle
        shape (t,) [rad].
    rod_angle
        Direction of the rod's x axis as drawn, shape (t,) [rad].
    pin
        Of the piston in the rod's own frame as drawn, shape (t, 2) [m].
    rod
        The rod in a frame at C1 turned by `rod_angle`.
    pin_radius
        [m].
    """

    crank_pin: np.ndarray
    crank_angle: np.ndarray
    rod_angle: np.ndarray
    pin: np.ndarray
    rod: PartView
    pin_radius: float

    def place(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Origin and rotation of the rod."""
        return self.crank_pin[frame], rotation(self.rod_angle[frame])


def chord_frames(
    crank_pin: np.ndarray,
    crank_angle: np.ndarray,
    pin: np.ndarray,
    pin_motion: np.ndarray,
    nodes: np.ndarray,
    motion: Callable[[int], np.ndarray],
    scale: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Enlarge displacements about the chord.

    Parameters
    ----------
    crank_pin, crank_angle
        shape (t, 2) [m] and (t,) [rad].
    pin
        Of the piston in the undeformed rod, shape (2,) [m].
    pin_motion
        Its displacement relative to the shaft in the rod's frame, shape (t, 2) [m].
    nodes
        Undeformed, shape (p, 2) [m].
    motion
        Displacement of the nodes relative to the shaft at an instant, shape (p, 2) [m].
    scale
        Enlargement.

    Returns
    -------
    local : numpy.ndarray
        Nodes as drawn, in the chord's frame, shape (t, p, 2) [m].
    pins : numpy.ndarray
        The piston's pin there, shape (t, 2) [m].
    angle : numpy.ndarray
        Direction of that frame, with the pin on the piston's line, shape (t,) [rad].
    """
    count, length = len(crank_pin), float(np.hypot(*pin))
    local = np.empty((count, *nodes.shape))
    pins, angle = np.empty((count, 2)), np.empty(count)
    rest = np.arctan2(pin[1], pin[0])
    for i in range(count):
        moved = pin + pin_motion[i]
        back = rotation(rest - np.arctan2(moved[1], moved[0]))
        local[i] = nodes + scale * ((nodes + motion(i)) @ back.T - nodes)
        pins[i] = pin + scale * (back @ moved - pin)
        drawn = length + scale * (np.hypot(*moved) - length)
        angle[i] = -np.arcsin(crank_pin[i, 1] / drawn) - rest
    return local, pins, angle


class CrankDrawing:
    """The whole machine.

    Parameters
    ----------
    axes
        Where.
    frames, film
        What.
    scale
        Enlargement of displacements and clearance.
    """

    def __init__(self, axes: Axes, frames: CrankFrames, film: FilmFrames, scale: float):
        self._frames = frames
        length = float(np.hypot(*frames.pin.mean(axis=0)))
        crank = float(np.hypot(*frames.crank_pin[0]))
        r = film.radius
        half, back, front = 0.19 * length, 0.14 * length, 0.22 * length
        self._set_up(axes, crank, length, r, half, back, front)
        self._web = Polygon(np.zeros((3, 2)), facecolor=CRANK, edgecolor="0.35", lw=0.8, zorder=1)
        self._ring = FilmRing(axes, film, scale)
        self._shaft = Disc(axes, self._ring.shaft_radius)
        self._box = (-back, -half)
        self._piston = FancyBboxPatch(
            self._box,
            back + front,
            2 * half,
            boxstyle=f"round,pad=0,rounding_size={0.02 * length}",
            facecolor=PISTON,
            edgecolor="0.35",
            linewidth=0.9,
            zorder=1.5,
        )
        self._rod = PartDrawing(axes, frames.rod)
        self._pin = Circle((0, 0), frames.pin_radius, fc=SHAFT, ec="0.25", lw=0.8, zorder=3.5)
        for patch in (self._web, self._piston, self._pin):
            axes.add_patch(patch)
        self._hull = crank, r

    def _set_up(
        self,
        axes: Axes,
        crank: float,
        length: float,
        radius: float,
        half: float,
        back: float,
        front: float,
    ) -> None:
        far, near = length + crank, length - crank
        for side in (-1, 1):
            wall = np.array([near - back - 0.05 * length, far + front + 0.02 * length])
            axes.fill_between(wall, side * half, side * (half + 0.03 * length), color="0.75", lw=0)
            axes.plot(wall, np.full(2, side * half), color="0.45", linewidth=0.8)
        axes.add_patch(Circle((0, 0), crank, fill=False, ec="0.7", lw=0.8, ls=":", zorder=0))
        axes.plot([0, far], [0, 0], color="0.7", linewidth=0.7, linestyle="-.", zorder=0)
        axes.add_patch(Circle((0, 0), 0.55 * radius, fc="white", ec="0.25", lw=0.9, zorder=1.2))
        axes.plot(0, 0, "+", color="0.25", markersize=6, zorder=1.3)
        reach = crank + 1.75 * radius
        _scale_bar(axes, -reach, -0.92 * reach, length)
        tail, head = crank * _circle(np.radians([222.0, 225.0]))
        style = {"arrowstyle": "-|>", "color": "0.5", "linewidth": 0, "mutation_scale": 14}
        axes.annotate("", xy=head, xytext=tail, arrowprops=style, zorder=0)
        axes.set(
            aspect="equal",
            xlim=(-reach, far + front + 0.03 * length),
            ylim=(-reach, reach),
        )
        axes.axis("off")

    def show(self, frame: int) -> None:
        """Draw one instant."""
        frames = self._frames
        c1, turn = frames.place(frame)
        pin = c1 + turn @ frames.pin[frame]
        self._web.set_xy(_web(c1, *self._hull))
        self._ring.show(frame, c1, c1, turn)
        self._shaft.show(c1, frames.crank_angle[frame])
        self._rod.show(frame, (c1, turn))
        self._pin.center = pin
        self._piston.set_x(pin[0] + self._box[0])


class BigEnd:
    """The bearing close up, in the rod's frame, so that angles are those of the unwrapped bore."""

    def __init__(self, axes: Axes, frames: CrankFrames, film: FilmFrames, scale: float):
        self._frames = frames
        self._ring = FilmRing(axes, film, scale)
        self._pressure = PressureFan(axes, film, scale)
        self._shaft = Disc(axes, self._ring.shaft_radius)
        self._rod = PartDrawing(axes, frames.rod)
        frame_close_up(axes, film, "big end, turned with the rod")

    def show(self, frame: int) -> None:
        """Draw one instant."""
        origin, unturned = np.zeros(2), np.eye(2)
        self._ring.show(frame, origin, origin, unturned)
        self._pressure.show(frame, origin, origin)
        frames = self._frames
        self._shaft.show(origin, frames.crank_angle[frame] - frames.rod_angle[frame])
        self._rod.show(frame, (origin, unturned))


def _scale_bar(axes: Axes, left: float, low: float, length: float) -> None:
    """A round length of about a quarter of the rod."""
    power = 10.0 ** np.floor(np.log10(0.3 * length))
    bar = max(digit for digit in (1, 2, 5) if digit * power <= 0.3 * length) * power
    axes.plot([left, left + bar], [low, low], color="0.25", linewidth=2.0, solid_capstyle="butt")
    place = left + 0.5 * bar, low + 0.015 * length
    axes.text(*place, f"{1e3 * bar:g} mm", ha="center", va="bottom", color="0.25")


def frame_close_up(axes: Axes, film: FilmFrames, title: str) -> None:
    """Limits and angles of a bore seen along its axis."""
    reach = 1.72 * film.radius
    axes.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach), title=title)
    axes.axis("off")
    mark_angles(axes, film)


def mark_angles(axes: Axes, film: FilmFrames) -> None:
    """Angles of the unwrapped bore, written on the shaft."""
    below = "-90°" if film.angle[0] < -0.1 else "270°"
    for degrees, side in ((0, "0°"), (90, "90°"), (180, "180°"), (270, below)):
        direction = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
        place = 0.5 * film.radius * direction
        axes.text(*place, side, ha="center", va="center", color="0.3", zorder=5)


class Disc:
    """A shaft: a disc with a mark that shows it turning."""

    def __init__(self, axes: Axes, radius: float):
        self._radius = radius
        self._disc = Circle((0, 0), radius, facecolor=CRANK, edgecolor=SHAFT, lw=0.8, zorder=2.5)
        axes.add_patch(self._disc)
        (self._mark,) = axes.plot([], [], color=SHAFT, linewidth=2.5, zorder=2.6)
        (self._centre,) = axes.plot([], [], "+", color="0.25", markersize=6, zorder=2.7)

    def show(self, centre: np.ndarray, angle: float) -> None:
        """Draw one instant."""
        direction = np.array([np.cos(angle), np.sin(angle)])
        self._disc.center = centre
        ends = centre + self._radius * np.outer([0.8, 0.97], direction)
        self._mark.set_data(*ends.T)
        self._centre.set_data([centre[0]], [centre[1]])


def _web(c1: np.ndarray, crank: float, radius: float) -> np.ndarray:
    """Outline of the crank's web around its axis and around C1, shape (n, 2)."""
    direction = c1 / crank
    near, far = 0.85 * radius, 1.12 * radius
    # Common tangents of the two circles.
    open_angle = np.arccos(np.clip((near - far) / crank, -1, 1))
    around_c1 = np.linspace(-open_angle, open_angle, 40)
    around_axis = np.linspace(open_angle, 2 * np.pi - open_angle, 40)
    axis_angle = np.arctan2(direction[1], direction[0])
    return np.vstack(
        [
            c1 + far * _circle(axis_angle + around_c1),
            near * _circle(axis_angle + around_axis),
        ]
    )


def _circle(angle: np.ndarray) -> np.ndarray:
    return np.column_stack([np.cos(angle), np.sin(angle)])
