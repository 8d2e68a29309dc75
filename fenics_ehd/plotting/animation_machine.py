"""Bodies and ideal joints of an animation, each drawn as what it is."""

from __future__ import annotations

from collections.abc import Mapping
from functools import singledispatch

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from matplotlib.patheffects import Normal, Stroke

from fenics_ehd.multibody.joints import Fixed, Revolute, Slider
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.plotting.animation_bearing import HATCH, WALL, Bearing, Show
from fenics_ehd.plotting.animation_body import BodyView
from fenics_ehd.plotting.animation_part import PartDrawing

LINKS = ("#e3d5c0", "#cfd9e3", "#d5e0cc", "#e4cfd3", "#d9d2e6")

#: Size of a joint's symbol over the mechanism's extent.
SYMBOL = 0.02

#: Corners of a square around the origin.
SQUARE = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])

Bodies = Mapping[str, BodyView]


def draw_mechanism(
    axes: Axes, mechanism: Mechanism, bodies: Bodies, bearings: Mapping[str, Bearing]
) -> Show:
    """All bodies and joints."""
    places = [points for body in bodies.values() for points in body.points.values()]
    for bearing in bearings.values():
        places += [bearing.centre + s * (1 + WALL) * bearing.radius for s in (-1, 1)]
    for body in bodies.values():
        for i, nodes in enumerate(() if body.part is None else body.part.local):
            origin, turn = body.place(i)
            places.append(origin + nodes @ turn.T)
    limits = np.array([f(np.vstack(places), axis=0) for f in (np.min, np.max)])
    size = SYMBOL * float(np.ptp(limits, axis=0).max())
    highest = max((bearing.pressure.max() for bearing in bearings.values()), default=0.0)
    shows = [_body(axes, body, LINKS[i % 5]) for i, body in enumerate(bodies.values())]
    shows += [symbol(joint, axes, bodies, size) for joint in mechanism.joints.values()]
    shows += [bearing.draw(axes, highest) for bearing in bearings.values()]

    def show(frame: int) -> None:
        for part in shows:
            part(frame)

    show(0)
    axes.relim()
    axes.update_datalim(limits)
    axes.margins(0.03)
    axes.autoscale_view()
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    return show


def _body(axes: Axes, body: BodyView, colour: str) -> Show:
    """Its part, or bars from its origin to its points."""
    part = PartDrawing(axes, body.part) if body.part is not None else None
    border = [Stroke(linewidth=10, foreground="0.35"), Normal()]
    style = {"color": colour, "lw": 8, "solid_capstyle": "round", "path_effects": border}
    (bars,) = axes.plot([], [], zorder=1, **style)
    hidden = body.held or (body.part is not None and body.part.mesh)

    def show(frame: int) -> None:
        if part is not None:
            part.show(frame, body.place(frame))
        if not hidden:
            origin = body.points[""][frame]
            ends = [(origin, points[frame], (np.nan, np.nan)) for points in body.points.values()]
            bars.set_data(*np.concatenate(ends).T)

    return show


@singledispatch
def symbol(joint: object, axes: Axes, bodies: Bodies, size: float) -> Show:
    """What stands for an ideal joint; a lubricated one draws itself."""
    return lambda frame: None


def at(bodies: Bodies, marker: str) -> tuple[BodyView, np.ndarray]:
    """Body of a marker and the marker as drawn, shape (t, 2) [m]."""
    name, _, point = marker.partition(".")
    return bodies[name], bodies[name].points[point]


@symbol.register
def _(joint: Revolute, axes: Axes, bodies: Bodies, size: float) -> Show:
    return _pin(joint.markers, axes, bodies, size, "o")


@symbol.register
def _(joint: Fixed, axes: Axes, bodies: Bodies, size: float) -> Show:
    return _pin(joint.markers, axes, bodies, size, "s")


def _pin(markers: tuple[str, ...], axes: Axes, bodies: Bodies, size: float, sign: str) -> Show:
    """Two points that stay together, on a pedestal where one of them is held."""
    ends = [at(bodies, marker) for marker in markers]
    held = [place[0] for body, place in ends if body.held]
    style = {"color": "white", "markeredgecolor": "0.2", "markersize": 8}
    (mark,) = axes.plot([], [], sign, zorder=1.2 if held else 5, **style)
    for foot in held:
        corners = foot + size * np.array([(0, 0), (-1, -2), (1, -2)])
        axes.add_patch(Polygon(corners, facecolor="white", edgecolor="0.35", zorder=0.8))
        _ground(axes, foot + size * np.array([(-2, -2), (2, -2), (2, -2.7), (-2, -2.7)]))
    return lambda frame: mark.set_data(*ends[0][1][frame][:, None])


def _ground(axes: Axes, corners: np.ndarray) -> None:
    """Hatched, its first side the surface."""
    axes.add_patch(Polygon(corners, facecolor="white", edgecolor="0.6", hatch=HATCH, lw=0))
    axes.plot(*corners[:2].T, color="0.35", linewidth=0.9)


@symbol.register
def _(joint: Slider, axes: Axes, bodies: Bodies, size: float) -> Show:
    """A block on a line, between walls where the line is held."""
    (body, origin), (_, place) = at(bodies, joint.first), at(bodies, joint.second)
    along = np.array(joint.direction) / np.hypot(*joint.direction)
    base = np.array([along, (-along[1], along[0])])
    turns = [base @ body.place(i)[1].T for i in range(len(origin))]
    travel = [turn[0] @ (p - o) for p, o, turn in zip(place, origin, turns, strict=True)]
    length = np.array([min(travel) - 4.5 * size, max(travel) + 4.5 * size])
    (line,) = axes.plot([], [], color="0.6", linewidth=0.8, linestyle="-.", zorder=0)
    block = Polygon(SQUARE, facecolor="#dfe5ea", edgecolor="0.35", zorder=1.5)
    axes.add_patch(block)
    for side in (-size, size) if body.held else ():
        wall = np.column_stack([length[[0, 1, 1, 0]], side * np.array([2.1, 2.1, 2.8, 2.8])])
        _ground(axes, origin[0] + wall @ turns[0])

    def show(frame: int) -> None:
        line.set_data(*(origin[frame] + np.outer(length, turns[frame][0])).T)
        block.set_xy(place[frame] + size * SQUARE * [3.0, 2.0] @ turns[frame])

    return show
