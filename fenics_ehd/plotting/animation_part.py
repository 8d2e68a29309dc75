"""A part seen along the bore's axis: the faces that show, moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

#: Nodes around each face of VTK's quadratic cells, by their number of nodes; outward normals.
_FACES = {
    20: [
        [0, 11, 3, 10, 2, 9, 1, 8],
        [4, 12, 5, 13, 6, 14, 7, 15],
        [0, 8, 1, 17, 5, 12, 4, 16],
        [1, 9, 2, 18, 6, 13, 5, 17],
        [2, 10, 3, 19, 7, 14, 6, 18],
        [3, 11, 0, 16, 4, 15, 7, 19],
    ],
    10: [
        [0, 6, 2, 5, 1, 4],
        [0, 4, 1, 8, 3, 7],
        [1, 5, 2, 9, 3, 8],
        [2, 6, 0, 7, 3, 9],
    ],
}

#: Cosine to the axis of the flattest face that still counts as turned to the viewer.
FACING = 0.1

STEEL, EDGE, GHOST = "#c9d3dc", "#8594a3", "0.45"


def front_faces(nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Faces on the surface that look along +z, the farthest first.

    Parameters
    ----------
    nodes
        shape (p, 3) [m].
    cells
        Quadratic hexahedra or tetrahedra in VTK's order, shape (c, 20 or 10).

    Returns
    -------
    numpy.ndarray
        Nodes around each face, corners and edge midpoints in turn, shape (f, 8 or 6).
    """
    faces = cells[:, np.array(_FACES[cells.shape[1]])].reshape(-1, len(_FACES[cells.shape[1]][0]))
    # An inner face belongs to two cells.
    _, first, counts = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    outside = faces[first[counts == 1]]
    corners = nodes[outside[:, ::2]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    cosine = normal[:, 2] / np.linalg.norm(normal, axis=1)
    front = outside[cosine > FACING]
    return front[np.argsort(nodes[front, 2].mean(axis=1), kind="stable")]


def outline(faces: np.ndarray) -> np.ndarray:
    """Edges that only one of the faces has, as three nodes each, shape (e, 3)."""
    following = np.roll(faces, -2, axis=1)
    edges = np.stack([faces[:, ::2], faces[:, 1::2], following[:, ::2]], axis=2).reshape(-1, 3)
    ends = np.sort(edges[:, ::2], axis=1)
    _, first, counts = np.unique(ends, axis=0, return_index=True, return_counts=True)
    return edges[first[counts == 1]]


@dataclass(frozen=True, eq=False)
class PartView:
    """What shows of a part, and where it is drawn.

    Attributes
    ----------
    rest
        Undeformed nodes in the part's own frame, shape (p, 2) [m].
    local
        The same as drawn, displacements enlarged, shape (t, p, 2) [m].
    faces
        Nodes around each face that shows, shape (f, v).
    mesh
        Whether the faces are a finite-element mesh, whose lines are worth drawing.
    """

    rest: np.ndarray
    local: np.ndarray
    faces: np.ndarray
    mesh: bool = True


class PartDrawing:
    """The part in a pair of axes, its undeformed outline dashed.

    Parameters
    ----------
    axes
        Where.
    view
        What.
    """

    def __init__(self, axes: Axes, view: PartView):
        self._view = view
        edge = EDGE if view.mesh else "none"
        self._faces = PolyCollection(
            [], facecolors=STEEL, edgecolors=edge, linewidths=0.35, zorder=3
        )
        self._edge = LineCollection([], colors="0.2", linewidths=0.9, zorder=3.1)
        self._ghost = LineCollection([], colors=GHOST, linewidths=0.7, linestyles="--", zorder=3.2)
        for collection in (self._faces, self._edge, self._ghost):
            axes.add_collection(collection)
        self._outline = outline(view.faces)

    def show(self, frame: int, place: Sequence[np.ndarray]) -> None:
        """Draw one instant; `place` is the origin (2,) [m] and the rotation (2, 2) of the part."""
        origin, turn = place
        nodes = origin + self._view.local[frame] @ turn.T
        rest = origin + self._view.rest @ turn.T
        self._faces.set_verts(nodes[self._view.faces])
        self._edge.set_segments(nodes[self._outline])
        self._ghost.set_segments(rest[self._outline])
