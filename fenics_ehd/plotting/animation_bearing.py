"""A lubricated joint of an animation: bore, journal, and the film between them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Annulus, Circle, Polygon

from fenics_ehd.base.plane import rotation
from fenics_ehd.multibody.flexible_body import FlexibleBody
from fenics_ehd.multibody.system import FilmPlace
from fenics_ehd.plotting.animation_body import BodyView
from fenics_ehd.plotting.animation_part import STEEL, PartDrawing
from fenics_ehd.plotting.picture import PRESSURES, RED
from fenics_ehd.results.replay import Replay

#: Points around and along the bore to which nodal values are interpolated.
AROUND, ALONG = 181, 17

#: The lightest colour of pressures.
OIL = "#ffffcc"
JOURNAL, EDGE, HATCH = "#e3d5c0", "#9c8465", "////"

#: Wall of a rigid bore as drawn, height of the largest pressure and half the side of a close-up,
#: over the bore's radius.
WALL, FAN, REACH = 0.3, 0.45, 1.72

Show = Callable[[int], None]


class Bearing:
    """A lubricated joint at the instants of a replay.

    Parameters
    ----------
    replay, place
        Of which joint.
    bodies
        As drawn.
    scale
        Enlargement of clearances and displacements.

    Attributes
    ----------
    body, journal_body
        As drawn.
    elastic
        Whether the bore is drawn as its body's part.
    radius, clearance
        Of the bore [m].
    centre
        Of the undeformed bore, shape (t, 2) [m].
    offset
        Of the journal from there as drawn, in the bore's frame, shape (t, 2) [m].
    angle, height
        Raster of the unwrapped bore, shape (a,) [rad], (b,) [m].
    pressure, gap
        On it, shape (t, b, a) [Pa], [m].
    """

    def __init__(
        self, replay: Replay, place: FilmPlace, bodies: Mapping[str, BodyView], scale: float
    ):
        parameters, joint = place.film.film.parameters, place.joint
        self.radius, self.clearance = parameters.grid.radius, parameters.clearance
        self.elastic, self._scale = bool(place.bore), scale
        self.body, self.journal_body = bodies[place.bore_body], bodies[joint.journal.split(".")[0]]
        turns = np.array([rotation(angle) for angle in self.body.pose[:, 2]])
        # Of the undeformed bore in its body's frame; for one of a part, with its name there.
        self._rest, point = np.zeros(2), joint.bore.partition(".")[2]
        bore_body = replay.bodies[place.bore_body]
        if isinstance(bore_body, FlexibleBody) and place.bore:
            self._rest = bore_body.reduced.bores[place.bore].centre[:2]
            point = bore_body.at_rest(place.bore)
        bore, eccentricity = self.body.points[point], replay.motion.coordinates[:, place.xi[:2]]
        self.centre = self.body.pose[:, :2] + turns @ self._rest if self.elastic else bore
        self.offset = scale * eccentricity + np.einsum("tji,tj->ti", turns, bore - self.centre)
        values = replay.motion.pressures[place.name], replay.gaps[place.name]
        self.angle = np.linspace(-np.pi, np.pi, AROUND)
        self.height = np.linspace(parameters.grid.heights[0], parameters.grid.heights[-1], ALONG)
        # The seam belongs where nothing is to be seen.
        behind = np.cos(parameters.grid.node_positions[:, 0]) < 0
        if values[0][:, behind].max() > values[0][:, ~behind].max():
            self.angle = self.angle + np.pi
        around, along = (x.ravel() for x in np.meshgrid(self.angle, self.height))
        reading = parameters.grid.interpolation(around, along)
        self.pressure, self.gap = (
            np.maximum(reading @ x.T, 0.0).T.reshape(len(x), ALONG, AROUND) for x in values
        )

    def draw(self, axes: Axes, highest: float, *, close_up: bool = False) -> Show:
        """Where it moves, or close up in the frame of the bore, whose angles it then shows.

        `highest` is the pressure that reaches farthest out [Pa].
        """
        radius = self.radius - self._scale * self.clearance
        normal = np.column_stack([np.cos(self.angle), np.sin(self.angle)])
        oil, wall = Circle((0, 0), self.radius, color=OIL, zorder=1.8), None
        disc = Circle((0, 0), radius, facecolor=JOURNAL, edgecolor=EDGE, zorder=2.5)
        fan = Polygon(normal, facecolor=RED, alpha=0.5, zorder=4)
        patches, part = [oil, disc, fan], None
        if not self.elastic:
            colours = {"facecolor": "white" if self.body.held else STEEL, "edgecolor": "0.45"}
            hatch = HATCH if self.body.held else ""
            wall = Annulus((0, 0), (1 + WALL) * self.radius, WALL * self.radius, **colours)
            wall.set(hatch=hatch, zorder=2)
            patches.append(wall)
        elif close_up and self.body.part is not None:
            part = PartDrawing(axes, self.body.part)
        for patch in patches:
            axes.add_patch(patch)
        (mark,) = axes.plot([], [], color=EDGE, linewidth=2.5, zorder=2.6)
        if close_up:
            self._show_angles(axes)

        def show(frame: int) -> None:
            bore, journal = self.body.pose[frame, 2], self.journal_body.pose[frame, 2]
            turn, centre = rotation(bore), self.centre[frame]
            if close_up:
                turn, centre, journal = np.eye(2), np.zeros(2), journal - bore
            oil.center, disc.center = centre, centre + turn @ self.offset[frame]
            if wall is not None:
                wall.set_center(centre)
            if part is not None:
                part.show(frame, (centre - self._rest, turn))
            ends = np.outer([0.8 * radius, 0.97 * radius], [np.cos(journal), np.sin(journal)])
            mark.set_data(*(disc.center + ends).T)
            # The mean over the width has no share of the journal's tilt.
            widening = self.gap[frame].mean(axis=0) - self.clearance
            foot = self.radius + normal @ self.offset[frame] + self._scale * widening
            tip = foot + FAN * self.radius * self.pressure[frame].max(axis=0) / highest
            edges = foot[:, None] * normal, (tip[:, None] * normal)[::-1]
            fan.set_xy(centre + np.concatenate(edges) @ turn.T)

        return show

    def _show_angles(self, axes: Axes) -> None:
        reach = REACH * self.radius
        axes.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach))
        axes.axis("off")
        for turn in np.radians([0, 90, 180, 270]):
            place = 0.5 * self.radius * np.array([np.cos(turn), np.sin(turn)])
            degrees = np.degrees(turn if turn <= self.angle[-1] + 1e-9 else turn - 2 * np.pi)
            axes.text(*place, f"{degrees:.0f}°", ha="center", va="center", zorder=5)

    def unwrap(self, axes: Axes) -> Show:
        """Pressure over the unwrapped bore, and where the film is thinnest."""
        angle, height = np.degrees(self.angle), 1e3 * self.height
        image = axes.imshow(
            1e-6 * self.pressure[0],
            extent=(angle[0], angle[-1], height[0], height[-1]),
            origin="lower",
            aspect="auto",
            interpolation="bilinear",
            cmap=PRESSURES,
            vmin=0.0,
            vmax=1e-6 * self.pressure.max(),
        )
        style = {"color": "white", "markeredgecolor": "black", "clip_on": False}
        (thinnest,) = axes.plot([], [], "o", label="thinnest film", zorder=5, **style)
        axes.set(ylabel="z [mm]", xticks=np.arange(angle[0], angle[-1] + 1, 90))
        axes.legend(loc="upper right", fontsize="small", framealpha=0.8)
        axes.figure.colorbar(image, ax=axes, label="pressure [MPa]", aspect=14, pad=0.02)

        def show(frame: int) -> None:
            image.set_data(1e-6 * self.pressure[frame])
            row, column = np.unravel_index(np.argmin(self.gap[frame]), self.gap[frame].shape)
            thinnest.set_data([angle[column]], [height[row]])

        return show
