"""The figure of an animation: the mechanism, and the film of one of its joints."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fenics_ehd.plotting.animation_bearing import Bearing, Show
from fenics_ehd.plotting.animation_body import automatic_scale, body_view
from fenics_ehd.plotting.animation_machine import draw_mechanism
from fenics_ehd.plotting.animation_shape import PartShape
from fenics_ehd.plotting.paths import clearance_circle
from fenics_ehd.plotting.picture import BLUE, RED, plt
from fenics_ehd.results.replay import Replay

#: Inches.
SIZE = (32 / 3, 6.0)


def draw(
    run: Replay,
    columns: Mapping[str, np.ndarray],
    frames: Replay,
    shapes: Mapping[str, PartShape],
    joint: str,
    scale: float | None,
) -> tuple[Figure, Show]:
    """The figure, and what draws one of its frames.

    Parameters
    ----------
    run, columns
        All recorded steps, and the columns of the joint's history.
    frames
        The instants that are drawn.
    shapes
        What shows of the flexible bodies, by name.
    joint
        Name of the lubricated joint whose film is drawn; empty for a mechanism without one.
    scale
        Enlargement of displacements and clearances, None: automatic.
    """
    mechanism, time = frames.system.mechanism, frames.motion.time
    scale = scale or automatic_scale(frames, shapes)
    bodies = {name: body_view(frames, name, shapes.get(name), scale) for name in frames.bodies}
    bearings = {place.name: Bearing(frames, place, bodies, scale) for place in frames.system.films}
    figure = plt.figure(figsize=SIZE, layout="constrained")
    layout = [["mechanism"]]
    if joint:
        layout = [["mechanism", "mechanism", "close up"], ["orbit", "film", "curves"]]
    panels = figure.subplot_mosaic(layout, height_ratios=(1.35, 1.0)[: len(layout)])
    parts = [draw_mechanism(panels["mechanism"], mechanism, bodies, bearings)]
    start = run.motion.time[0]
    if joint:
        bearing = bearings[joint]
        start = start - columns["time_s"][0]
        parts += [
            bearing.draw(panels["close up"], bearing.pressure.max(), close_up=True),
            bearing.unwrap(panels["film"]),
            _orbit(panels["orbit"], *(r.orbits[joint] / bearing.clearance for r in (run, frames))),
            _curves(panels["curves"], columns, time - start),
        ]
        panels["film"].set_xlabel(f"angle from the x axis of {bearing.body.name} [°]")
    note = f"displacements and clearances × {scale:g}, dashed: without"
    if any(not shape.mesh for shape in shapes.values()):
        note = f"{note}; of flexible bodies, only bores are known"
    figure.text(0.012, 0.985, note, ha="left", va="top", color="0.3")
    title = figure.suptitle(" ", x=0.988, ha="right", fontsize="large")

    def show(frame: int) -> None:
        for part in parts:
            part(frame)
        now = [joint] if joint else []
        now.append(f"t = {1e3 * (time[frame] - start):.2f} ms")
        for name in mechanism.drives:
            now.append(f"{name} {np.degrees(bodies[name].pose[frame, 2]) % 360:.0f}°")
        title.set_text(", ".join(now))

    # Sizes are settled on one frame: labels of changing width must not move the panels.
    show(0)
    figure.canvas.draw()
    figure.set_layout_engine("none")
    return figure, show


def _orbit(axes: Axes, path: np.ndarray, places: np.ndarray) -> Show:
    """Path of a journal over the clearance, shape (s, 2), and its places, shape (t, 2)."""
    clearance_circle(axes)
    axes.plot(*path.T, color="0.6", linewidth=1.0)
    (dot,) = axes.plot([], [], "o", color=BLUE, markeredgecolor="white")
    return lambda frame: dot.set_data(*places[frame][:, None])


def _curves(axes: Axes, columns: Mapping[str, np.ndarray], times: np.ndarray) -> Show:
    """Peak pressure and thinnest film of the whole run, with a mark that moves."""
    now = [axes.axvline(0.0, color="0.3", linewidth=0.9)]
    for panel, column, factor, colour, label in (
        (axes, "max_pressure_Pa", 1e-6, RED, "max. pressure [MPa]"),
        (axes.twinx(), "min_film_thickness_m", 1e6, BLUE, "min. film [µm]"),
    ):
        panel.plot(1e3 * columns["time_s"], factor * columns[column], color=colour)
        panel.set_ylabel(label, color=colour)
        panel.set_ylim(0, None)
    axes.set_xlabel("time [ms]")
    axes.margins(x=0)
    axes.grid(alpha=0.3)
    return lambda frame: now[0].set_xdata([1e3 * times[frame]] * 2)
