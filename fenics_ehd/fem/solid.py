"""A solid of second-order cells as arrays, from any mesh, and the facets of its surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Corners of the edges of a cell, in the order of their nodes (that of VTK).
EDGES = {
    "tet": ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)),
    "hex": (
        *((0, 1), (1, 2), (2, 3), (0, 3), (4, 5), (5, 6)),
        *((6, 7), (4, 7), (0, 4), (1, 5), (2, 6), (3, 7)),
    ),
}

#: Corners of its faces, seen from outside against the clock.
FACES = {
    "tet": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    "hex": (
        *((0, 3, 2, 1), (0, 1, 5, 4), (0, 4, 7, 3)),
        *((1, 2, 6, 5), (2, 3, 7, 6), (4, 5, 6, 7)),
    ),
}

#: Corners of a cell.
CORNERS = {"tet": 4, "hex": 8}


@dataclass(frozen=True, eq=False)
class Solid:
    """Second-order cells.

    Attributes
    ----------
    points
        Nodes, shape (n, 3) [m].
    cells
        Nodes of each cell, corners, then edges as in `EDGES`, shape (c, 10) or (c, 20).
    kind
        ``"tet"`` or ``"hex"``.
    """

    points: np.ndarray
    cells: np.ndarray
    kind: str

    def face_rows(self) -> np.ndarray:
        """Places in a cell of the nodes of each face: corners in turn, then the edges between."""
        number = {
            frozenset(edge): CORNERS[self.kind] + i for i, edge in enumerate(EDGES[self.kind])
        }
        rows = []
        for face in FACES[self.kind]:
            sides = zip(face, face[1:] + face[:1], strict=True)
            rows.append([*face, *(number[frozenset(side)] for side in sides)])
        return np.array(rows)

    def facets(self) -> np.ndarray:
        """Nodes of the facets of the surface, corners, then edges, shape (f, 6) or (f, 8)."""
        nodes = self.cells[:, self.face_rows()].reshape(-1, 2 * len(FACES[self.kind][0]))
        corners = np.sort(nodes[:, : len(FACES[self.kind][0])], axis=1)
        _, first, uses = np.unique(corners, axis=0, return_index=True, return_counts=True)
        return nodes[np.sort(first[uses == 1])]


def raised(points: np.ndarray, corners: np.ndarray, kind: str) -> Solid:
    """Second-order solid of first-order cells, whose edges are straight."""
    pairs = np.sort(corners[:, np.array(EDGES[kind])], axis=2)
    edges, numbers = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    middles = len(points) + numbers.reshape(pairs.shape[:2])
    return Solid(
        np.vstack([points, points[edges].mean(axis=1)]), np.hstack([corners, middles]), kind
    )


def used(solid: Solid) -> Solid:
    """Without nodes that no cell has: reference points of assemblies, say."""
    nodes, cells = np.unique(solid.cells, return_inverse=True)
    return Solid(solid.points[nodes], cells.reshape(solid.cells.shape), solid.kind)
