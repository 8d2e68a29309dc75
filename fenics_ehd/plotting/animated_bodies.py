"""Bodies of an animation: their visible faces and positions, with small motions magnified.

A flexible body is viewed along the bore's axis: as the front of the part, if a basis of the
complete part is available, otherwise as rings around its bores.

Elastic motion and clearances are magnified by ``scale``; large motions are drawn in true size. The
part of the elastic motion in which bores and points move like a rigid body is not magnified. If it
were, points would be separated from the bodies to which they are joined. In a rod, for example,
this part is the motion of the line between the two ends.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import fenics_ehd.base.matplotlib_start  # noqa: F401  # isort: skip
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

from fenics_ehd.base.plane import rotation
from fenics_ehd.fem.solid import Solid
from fenics_ehd.plotting.maps import round_scale
from fenics_ehd.reduction.body import ReducedBody, bore_fields
from fenics_ehd.results.motion import RecordedMotion
from fenics_ehd.results.paraview import PartFields

#: Kinds of solid cells, by their number of nodes.
KINDS = {20: "hex", 10: "tet"}

#: Least cosine between a face's normal and the axis for a face that is visible from the front.
FACING = 0.1

STEEL = "#c9d3dc"
EDGE = "#8594a3"
GHOST = "0.45"


def front_faces(nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Faces of a part's surface whose normals point along +z, the farthest face first.

    Parameters
    ----------
    nodes
        Positions of the nodes, shape (p, 3) [m].
    cells
        Quadratic hexahedra or tetrahedra in VTK's order, shape (c, 20 or 10).

    Returns
    -------
    numpy.ndarray
        Node indices around each face, corners and edge midpoints in turn, shape (f, 8 or 6).
    """
    facets = Solid(nodes, cells, KINDS[cells.shape[1]]).facets()
    count = facets.shape[1] // 2
    corners = nodes[facets[:, :count]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    front = facets[normal[:, 2] > FACING * np.linalg.norm(normal, axis=1)]
    front = front[np.argsort(nodes[front, 2].mean(axis=1), kind="stable")]
    return np.stack([front[:, :count], front[:, count:]], axis=2).reshape(-1, 2 * count)


def outline(faces: np.ndarray) -> np.ndarray:
    """Edges that belong to only one face: indices of their three nodes, shape (e, 3)."""
    following = np.roll(faces, -2, axis=1)
    edges = np.stack([faces[:, ::2], faces[:, 1::2], following[:, ::2]], axis=2).reshape(-1, 3)
    ends = np.sort(edges[:, ::2], axis=1)
    _, first, counts = np.unique(ends, axis=0, return_index=True, return_counts=True)
    return edges[first[counts == 1]]


#: Outer over inner radius of the ring that is drawn for a part without a basis.
RING = 1.42


@dataclass(frozen=True, eq=False)
class PartShape:
    """Visible nodes and faces of a part, and the displacement fields of its coordinates.

    Attributes
    ----------
    nodes
        Positions of the visible nodes, shape (p, 3) [m].
    faces
        Node indices around each visible face, shape (f, v).
    fields
        Displacements of the nodes along x and y, shape (p, 2, n + r): first for n unit elastic
        coordinates, then for unit amplitudes of r residual patterns.
    mesh
        True if the faces are those of a finite-element mesh, whose lines are drawn; false if they
        are rings around bores.
    """

    nodes: np.ndarray
    faces: np.ndarray
    fields: np.ndarray
    mesh: bool = True

    @cached_property
    def edges(self) -> np.ndarray:
        """Edges of the drawn outline, see `outline`."""
        return outline(self.faces)


def shape_of_part(part: PartFields) -> PartShape:
    """Shape of a complete part, viewed from the front."""
    faces = front_faces(part.nodes, part.cells)
    shown, local = np.unique(faces, return_inverse=True)
    fields = np.concatenate([part.basis[shown, :2], part.patterns[shown, :2]], axis=2)
    return PartShape(part.nodes[shown], local.reshape(faces.shape), fields)


def shape_of_bores(body: ReducedBody) -> PartShape:
    """Shape of a body without a basis: rings around its bores, which move with the bores' edges."""
    nodes: list[np.ndarray] = []
    faces = []
    fields = []
    first = 0
    for rows in body.each_bore():
        x = rows.surface.coordinates
        edge = np.flatnonzero(x[:, 2] > x[:, 2].max() - 1e-6 * rows.surface.radius)
        edge = edge[np.argsort(np.arctan2(x[edge, 1], x[edge, 0]), kind="stable")]
        outer = len(edge)
        i = first + np.arange(outer)
        j = np.roll(i, -1)
        first = first + 2 * outer
        faces.append(np.column_stack([i, i + outer, i + outer, j + outer, j + outer, j, j, i]))
        nodes.append(rows.surface.centre + np.vstack([x[edge], x[edge] * [RING, RING, 1.0]]))
        fields += 2 * [bore_fields(body)[rows.nodes][edge, :2]]
    return PartShape(np.vstack(nodes), np.vstack(faces), np.vstack(fields), False)


#: Limits of an automatic scale: drawn clearance over the bore's radius, and largest drawn
#: displacement over the extent of the part.
DRAWN_CLEARANCE = 0.18
DRAWN_DISPLACEMENT = 0.08


@dataclass(frozen=True, eq=False)
class BodyView:
    """A body as it is drawn at the instants of an animation.

    Attributes
    ----------
    name
        Name of the body.
    pose, turns
        Position and angle of the body's frame, shape (t, 3) [m], [rad]; rotation matrices of these
        angles, shape (t, 2, 2).
    points
        Positions of the body's points by name, shape (t, 2) [m]; the origin has an empty name.
    held
        Whether the body is fixed to the ground.
    nodes
        Positions of the nodes of `shape` with magnified displacements, shape (t, p, 2) [m]; p = 0
        without a shape.
    shape
        Visible faces of a flexible body; None for other bodies.
    """

    name: str
    pose: np.ndarray
    turns: np.ndarray
    points: Mapping[str, np.ndarray]
    held: bool
    nodes: np.ndarray
    shape: PartShape | None = None


def draw_part(axes: Axes, body: BodyView, frame: int) -> None:
    """Draw a flexible body at one instant, with its undeformed outline dashed."""
    shape = body.shape
    nodes = body.nodes[frame]
    assert shape is not None
    rest = body.pose[frame, :2] + shape.nodes[:, :2] @ body.turns[frame].T
    mesh = {"edgecolors": EDGE if shape.mesh else "none", "linewidths": 0.35}
    dashed = {"colors": GHOST, "linewidths": 0.7, "linestyles": "--"}
    for drawn in (
        PolyCollection(nodes[shape.faces], facecolors=STEEL, zorder=3, **mesh),
        LineCollection(nodes[shape.edges], colors="0.2", linewidths=0.9, zorder=3.1),
        LineCollection(rest[shape.edges], zorder=3.2, **dashed),
    ):
        axes.add_collection(drawn, autolim=False)


def body_view(replay: RecordedMotion, name: str, shape: PartShape | None, scale: float) -> BodyView:
    """View of a body at the recorded instants; `shape` is None for a body that is not flexible."""
    body = replay.bodies[name]
    coordinates = replay.coordinates(name)
    pose = replay.marker(name, "")
    turns = np.array([rotation(angle) for angle in pose[:, 2]])
    carried = np.zeros((len(pose), 3))
    nodes = np.zeros((len(pose), 0, 2))
    if shape is not None:
        moved, carried = part_motion(replay, name, shape)
        rest = shape.nodes[:, :2]
        local = rest + scale * moved - (scale - 1) * rigid_motion(rest, carried)
        nodes = pose[:, None, :2] + local @ turns.transpose(0, 2, 1)
    # Coordinates on which films depend are small motions, all other coordinates large motions.
    resting = np.where(body.weights < 1.0, 0.0, coordinates)
    points = {}
    for point in ("", *body.point_names):
        there, rest = (replay.marker(name, point, z)[:, :2] for z in (coordinates, resting))
        position = (rest[0] - pose[0, :2]) @ turns[0]
        kept = np.einsum("tij,tj->ti", turns, rigid_motion(position[None], carried)[:, 0])
        points[point] = there + (scale - 1) * (there - rest - kept)
    return BodyView(name, pose, turns, points, body.angle_index is None, nodes, shape)


def part_motion(
    replay: RecordedMotion, name: str, shape: PartShape
) -> tuple[np.ndarray, np.ndarray]:
    """Elastic motion of a flexible body in its own frame, and the rigid part of this motion.

    Returns
    -------
    moved : numpy.ndarray
        Displacements of the visible nodes, shape (t, p, 2) [m].
    carried : numpy.ndarray
        Rigid part of this motion, fitted to bores and points: translation along x and y, rotation
        about the bore's centre, shape (t, 3) [m], [rad]; zero for a clamped body.
    """
    values = np.hstack(replay.elastic(name))
    part = replay.part(name)
    fields = carried_fields(part) * float(part.frame != "clamped")
    return np.moveaxis(shape.fields @ values.T, -1, 0), values @ fields.T


def automatic_scale(replay: RecordedMotion, shapes: Mapping[str, PartShape]) -> float:
    """Magnification that makes clearances and displacements visible, a round number, at least 1."""
    largest = []
    for binding in replay.system.films:
        film = binding.film.film.parameters
        largest.append(DRAWN_CLEARANCE * film.grid.radius / film.clearance)
    for name, shape in shapes.items():
        moved, carried = part_motion(replay, name, shape)
        rest = shape.nodes[:, :2]
        furthest = np.abs(moved - rigid_motion(rest, carried)).max()
        extent = DRAWN_DISPLACEMENT * np.ptp(rest, axis=0).max()
        largest.append(float(extent / max(furthest, 1e-3 * extent)))
    return round_scale(min(largest, default=1.0))


def carried_fields(part: ReducedBody) -> np.ndarray:
    """Rigid part of the elastic motion, fitted to bores and points, for unit coordinates.

    Returns
    -------
    numpy.ndarray
        Translation along x and y, and rotation about the bore's centre, shape (3, n + r): for n
        unit elastic coordinates, then for unit amplitudes of r residual patterns.
    """
    moved = bore_fields(part)[:, :2]
    still = np.zeros((2, moved.shape[2] - part.modes))
    positions = [bore.centre[:2] for bore in part.bores.values()]
    fields = [moved[bore.nodes].mean(axis=0) for bore in part.each_bore()]
    for name, point in part.points.items():
        if name not in part.bores:
            positions.append(point[:2, 0])
            fields.append(np.hstack([point[:2, 3:], still]))
    unit = rigid_motion(np.array(positions), np.eye(3))
    return np.linalg.lstsq(unit.reshape(3, -1).T, np.vstack(fields), rcond=None)[0]


def rigid_motion(positions: np.ndarray, motions: np.ndarray) -> np.ndarray:
    """Displacements of points in small rigid motions, shape (t, p, 2) [m].

    Parameters
    ----------
    positions
        Positions of the points relative to the centre of rotation, shape (p, 2) [m].
    motions
        Translation along x and y, and rotation, shape (t, 3) [m], [rad].
    """
    about = np.stack([-positions[:, 1], positions[:, 0]], axis=1)
    return motions[:, None, :2] + motions[:, None, 2:] * about
