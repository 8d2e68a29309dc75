"""Where the bodies of an animation are drawn, their small motions enlarged.

What is small, elastic motion and clearance, is drawn ``scale`` times as large; the large motion
is drawn as it is. Of a flexible body's motion, that which carries its bore and its points as a
whole is not enlarged: they would leave the bodies they are joined to. Along a rod, that is its
chord.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fenics_ehd.base.plane import rotation
from fenics_ehd.plotting.animation_part import PartView
from fenics_ehd.plotting.animation_shape import PartShape
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.reduction.body import bore_fields
from fenics_ehd.results.replay import Replay

#: Clearance as drawn over the bore's radius, and largest displacement as drawn over the part's
#: extent, that an automatic scale may reach.
DRAWN_CLEARANCE, DRAWN_DISPLACEMENT = 0.18, 0.08


@dataclass(frozen=True, eq=False)
class BodyView:
    """A body as drawn.

    Attributes
    ----------
    name
        Of it.
    pose
        Of its frame, position and angle, shape (t, 3) [m], [rad].
    points
        By name, its origin empty, shape (t, 2) [m].
    held
        Whether it is a part of the ground.
    part
        What shows of a flexible body, in its frame.
    """

    name: str
    pose: np.ndarray
    points: Mapping[str, np.ndarray]
    held: bool
    part: PartView | None = None

    def place(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Origin (2,) and rotation (2, 2) of its frame."""
        return self.pose[frame, :2], rotation(self.pose[frame, 2])


def body_view(replay: Replay, name: str, shape: PartShape | None, scale: float) -> BodyView:
    """A body at the instants of a replay; `shape` is that of a flexible one."""
    body, own = replay.bodies[name], replay.coordinates(name)
    pose = replay.marker(name, "")
    carried, part = np.zeros((len(pose), 3)), None
    if shape is not None:
        moved, carried = part_motion(replay, name, shape)
        rest = shape.nodes[:, :2]
        local = rest + scale * moved - (scale - 1) * rigid_motion(rest, carried)
        part = PartView(rest, local, shape.faces, shape.mesh)
    # Coordinates that the films see are small motions, all others large ones.
    resting = np.where(body.weights < 1.0, 0.0, own)
    turns = np.array([rotation(angle) for angle in pose[:, 2]])
    points = {}
    for point in ("", *body.points()):
        there, rest = (replay.marker(name, point, z)[:, :2] for z in (own, resting))
        place = (rest[0] - pose[0, :2]) @ turns[0]
        kept = np.einsum("tij,tj->ti", turns, rigid_motion(place[None], carried)[:, 0])
        points[point] = there + (scale - 1) * (there - rest - kept)
    return BodyView(name, pose, points, body.angle is None, part)


def part_motion(replay: Replay, name: str, shape: PartShape) -> tuple[np.ndarray, np.ndarray]:
    """Elastic motion of a flexible body in its frame.

    Returns
    -------
    moved : numpy.ndarray
        Displacement of what shows, shape (t, p, 2) [m].
    carried : numpy.ndarray
        What of it moves bore and points as a whole, along x, y, and about the bore's centre,
        shape (t, 3) [m], [rad]; zero of a held body.
    """
    values, part = np.hstack(replay.elastic(name)), replay.part(name)
    fields = carried_fields(part) * float(part.frame != "clamped")
    return np.moveaxis(shape.fields @ values.T, -1, 0), values @ fields.T


def automatic_scale(replay: Replay, shapes: Mapping[str, PartShape]) -> float:
    """Enlargement at which clearances and displacements are seen, a round number of at least 1."""
    largest = []
    for place in replay.system.films:
        film = place.film.film.parameters
        largest.append(DRAWN_CLEARANCE * film.grid.radius / film.clearance)
    for name, shape in shapes.items():
        moved, carried = part_motion(replay, name, shape)
        rest = shape.nodes[:, :2]
        furthest = np.abs(moved - rigid_motion(rest, carried)).max()
        extent = DRAWN_DISPLACEMENT * np.ptp(rest, axis=0).max()
        largest.append(float(extent / max(furthest, 1e-3 * extent)))
    return round_scale(min(largest, default=1.0))


def round_scale(largest: float) -> float:
    """The number with one digit that comes next below another one, at least 1."""
    power = 10.0 ** np.floor(np.log10(largest))
    return float(max(1.0, power * np.floor(largest / power * (1 + 1e-9))))


def carried_fields(part: ReducedBody) -> np.ndarray:
    """Translation and rotation of bores and points as a whole, by elastic motion.

    Returns
    -------
    numpy.ndarray
        Along x, y, and about the bore's centre, of unit elastic coordinates and amplitudes of
        residual patterns, shape (3, n + r).
    """
    moved = bore_fields(part)[:, :2]
    still = np.zeros((2, moved.shape[2] - part.modes))
    places = [bore.centre[:2] for bore in part.bores.values()]
    fields = [moved[bore.nodes].mean(axis=0) for bore in part.each_bore()]
    for name, point in part.points.items():
        if name not in part.bores:
            places.append(point[:2, 0])
            fields.append(np.hstack([point[:2, 3:], still]))
    unit = rigid_motion(np.array(places), np.eye(3))
    return np.linalg.lstsq(unit.reshape(3, -1).T, np.vstack(fields), rcond=None)[0]


def rigid_motion(places: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Small rigid motions (t, 3) at places (p, 2), shape (t, p, 2)."""
    about = np.stack([-places[:, 1], places[:, 0]], axis=1)
    return motion[:, None, :2] + motion[:, None, 2:] * about
