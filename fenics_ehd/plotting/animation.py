"""Animation of a mechanism and of one joint's film, as GIF or MP4.

Bodies and ideal joints are drawn as symbols. Lubricated joints are drawn with bore, journal and
film. Further panels show one lubricated joint in close-up, its unwrapped film, the orbit of its
journal, and curves of pressure and film thickness.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import fenics_ehd.base.matplotlib_start  # noqa: F401  # isort: skip
import numpy as np
from matplotlib.animation import FFMpegWriter
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Annulus, Polygon
from matplotlib.patheffects import Normal, Stroke
from PIL import Image

from fenics_ehd.base.errors import InputError, SettingsError
from fenics_ehd.base.files import written_aside
from fenics_ehd.base.plane import rotation
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.history import load_history
from fenics_ehd.multibody.joints import Fixed, Revolute, Slider
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.plotting.animated_bodies import (
    STEEL,
    BodyView,
    PartShape,
    automatic_scale,
    body_view,
    draw_part,
    shape_of_bores,
    shape_of_part,
)
from fenics_ehd.plotting.curves import clearance_circle, pressure_and_film
from fenics_ehd.plotting.maps import ANGLES, draw_section, lay_out_section, sampled
from fenics_ehd.plotting.picture import BLUE, PRESSURES, require_format
from fenics_ehd.plotting.shown import moving_part, recorded
from fenics_ehd.results.motion import RecordedMotion, between_steps
from fenics_ehd.results.paraview import parts_of_bases
from fenics_ehd.results.recorded_run import SCENE_NAME
from fenics_ehd.scenes.scene import as_stored, meshed

#: Number of heights along the bore at which nodal values are sampled.
ALONG = 17

#: Drawn wall thickness of a rigid bore over its radius, and hatching of bodies at rest.
WALL = 0.3
HATCH = "////"

Show = Callable[[int], None]
Bodies = Mapping[str, BodyView]


def at(bodies: Bodies, marker: str) -> tuple[BodyView, np.ndarray]:
    """View of the body of a marker, and drawn positions of the marker, shape (t, 2) [m]."""
    name, _, point = marker.partition(".")
    return bodies[name], bodies[name].points[point]


class Bearing:
    """Drawing of a lubricated joint at the instants of a recorded motion.

    Parameters
    ----------
    replay, binding
        Recorded motion at t instants, and binding of the joint's film.
    bodies
        Views of the bodies by name.
    scale
        Magnification of clearances and displacements [-].

    Attributes
    ----------
    body, journal_body
        Views of the bodies that have the bore and the journal.
    meshed
        Whether the bore belongs to a flexible body, whose drawing contains the bore.
    radius, clearance
        Radius and radial clearance of the bore [m].
    centre
        Drawn position of the undeformed bore's centre, shape (t, 2) [m].
    offset
        Magnified vector from `centre` to the journal's centre, in the bore's frame, shape (t, 2)
        [m].
    height
        Heights along the bore, shape (b,) [m].
    pressure, gap
        Pressure [Pa] and film thickness [m] at `height` and at the angles
        `fenics_ehd.plotting.maps.ANGLES`, shape (t, b, a).
    """

    def __init__(self, replay: RecordedMotion, binding: FilmBinding, bodies: Bodies, scale: float):
        self.film = binding.film.film.parameters
        grid = self.film.grid
        self.radius = grid.radius
        bore_surface = binding.surfaces[0]
        rest = bore_surface.surface.centre
        self.meshed = rest is not None
        self._enlarged = scale / grid.radius
        self.body, bore = at(bodies, bore_surface.marker)
        self.journal_body, _ = at(bodies, binding.joint.journal)
        eccentricity = replay.motion.coordinates[:, binding.xi[:2]]
        turns = self.body.turns
        self.centre = bore
        if rest is not None:
            self.centre = self.body.pose[:, :2] + turns @ rest[:2]
        self.offset = scale * eccentricity + np.einsum("tji,tj->ti", turns, bore - self.centre)
        self.height = np.linspace(grid.heights[0], grid.heights[-1], ALONG)
        pressure = sampled(grid, replay.motion.pressures[binding.name], ANGLES, self.height)
        self.pressure = np.maximum(pressure, 0.0)
        self.gap = np.maximum(sampled(grid, replay.gaps[binding.name], ANGLES, self.height), 0.0)

    def draw(
        self, axes: Axes, frame: int, highest: float, centre: np.ndarray, turn: float, radius: float
    ) -> None:
        """Draw the cross section of the joint, see `draw_section`.

        A rigid bore is drawn as a ring. A mark on the journal shows its rotation.

        Parameters
        ----------
        axes, frame
            Axes to draw in, and index of the instant.
        highest
            Pressure at the top of the drawn pressure curve [Pa].
        centre, turn, radius
            Drawn centre, angle of the body [rad], and drawn radius of the bore [m].
        """
        if not self.meshed:
            face, hatch = ("white", HATCH) if self.body.held else (STEEL, "")
            style = {"facecolor": face, "edgecolor": "0.45", "hatch": hatch, "zorder": 2}
            axes.add_patch(Annulus(centre, (1 + WALL) * radius, WALL * radius, **style))
        # The mean of the gap over the width does not depend on the tilt of the journal.
        gap = self.gap[frame].mean(axis=0)
        pressure = self.pressure[frame].max(axis=0)
        position = self.offset[frame] / self.radius
        clearance = self._enlarged * self.film.clearance
        labels = f"pressure, {1e-6 * pressure.max():.3g} MPa", f"thinnest, {1e6 * gap.min():.3g} µm"
        draw_section(
            axes, self._enlarged * gap, pressure / highest, position, clearance, labels,
            turn=turn, centre=centre, radius=radius,
        )  # fmt: skip
        journal = turn + self.journal_body.pose[frame, 2] - self.body.pose[frame, 2]
        middle = centre + radius * rotation(turn) @ position
        towards = rotation(journal)[:, 0]
        ends = middle + np.outer([0.8, 0.97], radius * (1 - clearance) * towards)
        axes.plot(*ends.T, color="0.35", linewidth=2.5, zorder=4.6)

    def close_up(self, axes: Axes, frame: int) -> None:
        """Draw the joint in close-up, in the frame of its bore."""
        axes.clear()
        self.draw(axes, frame, self.pressure.max(), np.zeros(2), 0.0, 1.0)
        lay_out_section(axes)

    def unwrap(self, axes: Axes, frame: int) -> None:
        """Draw the pressure over the unwrapped bore, and mark the minimum film thickness."""
        axes.clear()
        angle = np.degrees(ANGLES)
        height = 1e3 * self.height
        row, column = np.unravel_index(np.argmin(self.gap[frame]), self.gap[frame].shape)
        style = {"color": "white", "markeredgecolor": "black", "clip_on": False}
        axes.plot(angle[column], height[row], "o", label="thinnest film", zorder=5, **style)
        axes.set(ylabel="z [mm]", xticks=np.arange(-180, 181, 90))
        axes.set_xlabel(f"angle from the x axis of {self.body.name} [°]")
        axes.legend(loc="upper right", fontsize="small", framealpha=0.8)
        axes.imshow(
            1e-6 * self.pressure[frame],
            extent=(angle[0], angle[-1], height[0], height[-1]),
            origin="lower",
            aspect="auto",
            interpolation="bilinear",
            cmap=PRESSURES,
            vmin=0.0,
            vmax=1e-6 * self.pressure.max(),
        )


#: Fill colours of the bodies, in turn.
LINKS = ("#e3d5c0", "#cfd9e3", "#d5e0cc", "#e4cfd3", "#d9d2e6")

#: Size of a joint's symbol relative to the mechanism's extent, and margin around the mechanism
#: relative to the size of a symbol.
SYMBOL = 0.02
ROOM = 3.0

#: Corners of a square of side 2 around the origin.
SQUARE = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])


def extent(bodies: Bodies, bearings: Mapping[str, Bearing]) -> np.ndarray:
    """Smallest, then largest x and y over all bodies and instants, shape (2, 2) [m]."""
    positions = [points for body in bodies.values() for points in body.points.values()]
    for bearing in bearings.values():
        positions += [bearing.centre + s * (1 + WALL) * bearing.radius for s in (-1, 1)]
    positions += [body.nodes.reshape(-1, 2) for body in bodies.values()]
    everywhere = np.vstack(positions)
    return np.array([everywhere.min(axis=0), everywhere.max(axis=0)])


def draw_mechanism(
    axes: Axes,
    mechanism: Mechanism,
    bodies: Bodies,
    bearings: Mapping[str, Bearing],
    limits: np.ndarray,
    frame: int,
) -> None:
    """Draw all bodies and joints at an instant, between the limits that `extent` returns."""
    axes.clear()
    size = SYMBOL * float(np.ptp(limits, axis=0).max())
    highest = max((bearing.pressure.max() for bearing in bearings.values()), default=0.0)
    for i, body in enumerate(bodies.values()):
        draw_body(axes, body, LINKS[i % 5], frame)
    for joint in mechanism.joints.values():
        if isinstance(joint, Slider):
            draw_slider(axes, joint, bodies, size, frame)
        elif isinstance(joint, Revolute | Fixed):
            draw_pin(axes, joint, bodies, size, frame)
    for bearing in bearings.values():
        turn = bearing.body.pose[frame, 2]
        bearing.draw(axes, frame, highest, bearing.centre[frame], turn, bearing.radius)
    lower, upper = limits + ROOM * size * np.array([[-1.0], [1.0]])
    axes.set(xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]), aspect="equal")
    axes.set(xlabel="x [m]", ylabel="y [m]")


def draw_body(axes: Axes, body: BodyView, colour: str, frame: int) -> None:
    """Draw the faces of a body; without a mesh, also bars from its origin to its points."""
    if body.shape is not None:
        draw_part(axes, body, frame)
    if body.held or (body.shape is not None and body.shape.mesh):
        return
    origin = body.points[""][frame]
    ends = [(origin, points[frame], (np.nan, np.nan)) for points in body.points.values()]
    border = [Stroke(linewidth=10, foreground="0.35"), Normal()]
    style = {"color": colour, "lw": 8, "solid_capstyle": "round", "path_effects": border}
    axes.plot(*np.concatenate(ends).T, zorder=1, **style)


def draw_pin(axes: Axes, joint: Revolute | Fixed, bodies: Bodies, size: float, frame: int) -> None:
    """Draw a revolute or fixed joint, on a pedestal if one of its bodies is held."""
    ends = [at(bodies, marker) for marker in joint.markers]
    held = [positions[0] for body, positions in ends if body.held]
    style = {"color": "white", "markeredgecolor": "0.2", "markersize": 8}
    sign = "s" if isinstance(joint, Fixed) else "o"
    axes.plot(*ends[0][1][frame], sign, zorder=1.2 if held else 5, **style)
    for foot in held:
        corners = foot + size * np.array([(0, 0), (-1, -2), (1, -2)])
        axes.add_patch(Polygon(corners, facecolor="white", edgecolor="0.35", zorder=0.8))
        _ground(axes, foot + size * np.array([(-2, -2), (2, -2), (2, -2.7), (-2, -2.7)]))


def _ground(axes: Axes, corners: np.ndarray) -> None:
    """Draw a hatched polygon, with a line along its first side for the ground's surface."""
    axes.add_patch(Polygon(corners, facecolor="white", edgecolor="0.6", hatch=HATCH, lw=0))
    axes.plot(*corners[:2].T, color="0.35", linewidth=0.9)


def draw_slider(axes: Axes, joint: Slider, bodies: Bodies, size: float, frame: int) -> None:
    """Draw a sliding joint: a block on its line, between walls if the line is at rest."""
    body, origin = at(bodies, joint.line)
    _, position = at(bodies, joint.point)
    along = np.array(joint.direction) / np.hypot(*joint.direction)
    base = np.array([along, (-along[1], along[0])])
    turns = base @ body.turns.transpose(0, 2, 1)
    travel = np.einsum("tj,tj->t", turns[:, 0], position - origin)
    length = np.array([travel.min() - 4.5 * size, travel.max() + 4.5 * size])
    line = origin[frame] + np.outer(length, turns[frame][0])
    axes.plot(*line.T, color="0.6", linewidth=0.8, linestyle="-.", zorder=0)
    block = position[frame] + size * SQUARE * [3.0, 2.0] @ turns[frame]
    axes.add_patch(Polygon(block, facecolor="#dfe5ea", edgecolor="0.35", zorder=1.5))
    for side in (-size, size) if body.held else ():
        wall = np.column_stack([length[[0, 1, 1, 0]], side * np.array([2.1, 2.1, 2.8, 2.8])])
        _ground(axes, origin[0] + wall @ turns[0])


#: Pixels per inch by file format; lower for GIF, whose files are larger.
RESOLUTION = {".gif": 90, ".mp4": 120}

#: Number of colours of a GIF, which are the same in all frames. They are chosen from `SAMPLES`
#: frames, of which every `SPARSE`-th pixel in both directions is used.
COLOURS = 256
SAMPLES = 6
SPARSE = 3

#: Smallest value of red, green and blue, out of 255, at which a colour counts as white.
NEARLY_WHITE = 248

#: Options of ffmpeg that leave out dates and versions, so that a run always gives the same file.
_REPEATABLE = ["-fflags", "+bitexact", "-flags:v", "+bitexact", "-threads", "1"]


def require_animation_format(path: Path, inputs: Iterable[str | Path] = ()) -> None:
    """Refuse the path of an animation that cannot be written, before any work is done for it.

    Raises
    ------
    SettingsError
        The file's ending is neither .gif nor .mp4.
    InputError
        The folder is not writable, ffmpeg is missing (MP4), or the path is that of an input or of a
        file that is no animation.
    """
    require_format("-o", path, RESOLUTION, inputs)
    if path.suffix.lower() == ".mp4" and shutil.which("ffmpeg") is None:
        raise InputError(f"-o {path}: MP4 needs ffmpeg, Debian's package ffmpeg; or choose .gif")


def save_animation(
    figure: Figure,
    show: Show,
    count: int,
    path: Path,
    rate: int,
    progress: Callable[[], None],
) -> Path:
    """Write an animation; the file is complete or absent.

    Parameters
    ----------
    figure, show
        Figure, and function that draws the frame with a number into the figure.
    count
        Number of frames.
    path
        Path of the file, whose ending selects GIF or MP4, see `require_animation_format`.
    rate
        Frames per second.
    progress
        Function without arguments that is called after every frame.

    Returns
    -------
    Path
        Path of the file.
    """
    suffix = path.suffix.lower()
    figure.set_dpi(RESOLUTION[suffix])
    path.parent.mkdir(parents=True, exist_ok=True)
    write = _write_gif if suffix == ".gif" else _write_mp4
    with written_aside(path) as aside:
        write(figure, show, count, aside, rate, progress)
    return path


def _write_gif(
    figure: Figure, show: Show, count: int, path: Path, rate: int, progress: Callable[[], None]
) -> None:
    """Write a GIF with one palette for all frames, so that colours do not flicker."""
    chosen = np.linspace(0, count - 1, min(count, SAMPLES)).astype(int)
    samples = [_picture(figure, show, i)[::SPARSE, ::SPARSE] for i in chosen]
    palette = _with_white(Image.fromarray(np.vstack(samples)).quantize(COLOURS))

    def frames() -> Iterator[Image.Image]:
        for i in range(count):
            picture = Image.fromarray(_picture(figure, show, i))
            yield picture.quantize(palette=palette, dither=Image.Dither.NONE)
            progress()

    first, *others = frames()
    delays = _delays(count, rate)
    first.save(path, save_all=True, append_images=others, duration=delays, loop=0)


def _delays(count: int, rate: int) -> list[int]:
    """Duration of every frame [ms], a multiple of 10 ms, the resolution of GIF."""
    ends = np.round(100 / rate * np.arange(count + 1)).astype(int)
    return (10 * np.diff(ends)).tolist()


def _with_white(palette: Image.Image) -> Image.Image:
    """Replace the lightest colours of a palette by white, because quantisation makes white grey."""
    colours = np.array(palette.getpalette()).reshape(-1, 3)
    colours[colours.min(axis=1) >= NEARLY_WHITE] = 255
    palette.putpalette(colours.ravel().tolist())
    return palette


def _picture(figure: Figure, show: Show, frame: int) -> np.ndarray:
    """Pixels of one frame, shape (height, width, 3)."""
    show(frame)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.array(canvas.buffer_rgba())[..., :3]


def _write_mp4(
    figure: Figure, show: Show, count: int, path: Path, rate: int, progress: Callable[[], None]
) -> None:
    options = ["-pix_fmt", "yuv420p", "-crf", "20", *_REPEATABLE]
    writer = FFMpegWriter(fps=rate, codec="libx264", extra_args=options)
    with writer.saving(figure, path, dpi=figure.dpi):
        for i in range(count):
            show(i)
            writer.grab_frame()
            progress()


#: Width and height of the figure [inches].
SIZE = (32 / 3, 6.0)


def draw_run(
    directory: Path, joint: str | None, count: int, scale: float | None, bases: Sequence[str]
) -> tuple[Figure, Show, list[str]]:
    """Make the animation of a run's last cycle.

    Gmsh models in the scene are programs; they are not executed.

    Parameters
    ----------
    directory
        Folder of the run, which may be in progress or stopped.
    joint
        Name of the lubricated joint whose film is drawn; None: the joint with the highest pressure.
    count
        Number of instants, equally spaced in time.
    scale
        Magnification of displacements and clearances; None: automatic.
    bases
        Paths of basis files (``reduce --basis``), with which flexible bodies are drawn completely.

    Returns
    -------
    tuple
        Figure; function from the number of a frame that draws the frame into the figure; hints for
        the user, one line each.

    Raises
    ------
    InputError
        The run has fewer than two steps.
    SettingsError
        The joint does not exist, or a basis file belongs to no body of the run.
    """
    result = moving_part(load_history(directory))
    run = recorded(directory, result)
    pressures = run.motion.pressures
    if len(run.time) < 2:
        raise InputError(
            f"{directory}: the run has stored 1 step, but an animation needs 2: let the run "
            "continue"
        )
    if joint is not None and joint not in pressures:
        known = ", ".join(pressures) or "none"
        raise SettingsError(f"--joint {joint}: the lubricated joints of the run are {known}")
    name = joint or max(pressures, key=lambda name: pressures[name].max(), default="")
    complete_parts = parts_of_bases(run.bodies, bases)
    shapes = {name: shape_of_part(part) for name, part in complete_parts.items()}
    scene = directory / SCENE_NAME
    hints = []
    for body, model in run.bodies.items():
        part = model.reduced
        if part is None or body in complete_parts:
            continue
        shapes[body] = shape_of_bores(part)
        made = (
            f"made by fenics-ehd reduce {body} --scene {scene} --method "
            f"{part.method} -o body.h5 --basis part.h5"
            if body in meshed(as_stored(scene))
            else "which can be made where the file of this body is"
        )
        hints.append(f"of {body} only the bores are drawn; all of it with --basis part.h5, {made}")
    instants = between_steps(run.motion, np.linspace(run.time[0], run.time[-1], count))
    frames = RecordedMotion(run.system.mechanism, instants)
    return *draw(run, frames, shapes, name, scale), hints


def draw(
    run: RecordedMotion,
    frames: RecordedMotion,
    shapes: Mapping[str, PartShape],
    joint: str,
    scale: float | None,
) -> tuple[Figure, Show]:
    """Make the figure of an animation, and the function that draws a frame into it by its number.

    Parameters
    ----------
    run, frames
        All recorded steps, and the instants that are drawn.
    shapes
        Visible faces of the flexible bodies, by name.
    joint
        Name of the lubricated joint whose film is drawn; empty for a mechanism without one.
    scale
        Magnification of displacements and clearances; None: automatic.
    """
    mechanism = frames.system.mechanism
    time = frames.time
    scale = scale or automatic_scale(frames, shapes)
    bodies = {name: body_view(frames, name, shapes.get(name), scale) for name in frames.bodies}
    bearings = {
        binding.name: Bearing(frames, binding, bodies, scale) for binding in frames.system.films
    }
    limits = extent(bodies, bearings)
    figure = Figure(figsize=SIZE, layout="constrained")
    layout = [["mechanism"]]
    if joint:
        layout = [["mechanism", "mechanism", "close up"], ["orbit", "film", "curves"]]
    panels = figure.subplot_mosaic(layout, height_ratios=(1.35, 1.0)[: len(layout)])
    start = run.time[0] - run.motion.time[0]
    if joint:
        bearing = bearings[joint]
        path, positions = (r.orbits[joint] / bearing.film.clearance for r in (run, frames))
        clearance_circle(panels["orbit"])
        panels["orbit"].plot(*path.T, color="0.6", linewidth=1.0)
        (dot,) = panels["orbit"].plot(*positions[0], "o", color=BLUE, mec="white")
        clock = 1e3 * run.motion.time
        recorded_joint = run.motion.joints[joint]
        films = 1e6 * recorded_joint.min_film_thickness
        labels = ("max. pressure [MPa]", "min. film [µm]")
        pressure_and_film(
            panels["curves"], clock, 1e-6 * recorded_joint.max_pressure, films, labels
        )
        panels["curves"].set(xlabel="time [ms]", xlim=clock[[0, -1]])
        now = panels["curves"].axvline(0.0, color="0.3", lw=0.9)
        colours = ScalarMappable(Normalize(0.0, 1e-6 * bearing.pressure.max()), PRESSURES)
        figure.colorbar(colours, ax=panels["film"], label="pressure [MPa]", aspect=14, pad=0.02)
    note = f"displacements and clearances × {scale:g}, dashed: without"
    if any(not shape.mesh for shape in shapes.values()):
        note = f"{note}; of flexible bodies, only bores are known"
    figure.text(0.012, 0.985, note, ha="left", va="top", color="0.3")
    angles = {
        name: frames.motion.angle_of(name)
        for name in mechanism.drives
        if f"{name}.angle" in frames.motion
    }
    driven = {name: angle for name, angle in angles.items() if angle is not None}
    title = figure.suptitle(" ", x=0.988, ha="right", fontsize="large")

    def show(frame: int) -> None:
        moment = 1e3 * (time[frame] - start)
        draw_mechanism(panels["mechanism"], mechanism, bodies, bearings, limits, frame)
        if joint:
            bearing.close_up(panels["close up"], frame)
            bearing.unwrap(panels["film"], frame)
            dot.set_data(*positions[frame, :, None])
            now.set_xdata([moment])
        words = [joint] if joint else []
        words.append(f"t = {moment:.2f} ms")
        words += [f"{name} {angle[frame]:.0f}°" for name, angle in driven.items()]
        title.set_text(", ".join(words))

    # The layout is computed for the first frame and kept, because labels of changing width would
    # move the panels.
    show(0)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    return figure, show
