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

_SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]

#: Where they are in the reference cell.
REFERENCE = {
    "tet": np.vstack([np.zeros(3), np.eye(3)]),
    "hex": np.array([(x, y, z) for z in (0, 1) for x, y in _SQUARE], dtype=float),
}


#: Gmsh's order of the nodes of a cell, in places of this one's; that of tetrahedra both ways.
GMSH_TET = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]
GMSH_HEX = [*range(8), 8, 11, 16, 9, 17, 10, 18, 19, 12, 15, 13, 14]


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
        nodes, first, uses = self._faces()
        return nodes[np.sort(first[uses == 1])]

    def overlaps(self) -> int:
        """Number of faces that more than two cells share: 0 in a solid."""
        return int((self._faces()[2] > 2).sum())

    def _faces(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Nodes of the faces of every cell, the first of each kind, and how often it is there."""
        nodes = self.cells[:, self.face_rows()].reshape(-1, 2 * len(FACES[self.kind][0]))
        corners = np.sort(nodes[:, : len(FACES[self.kind][0])], axis=1)
        return nodes, *np.unique(corners, axis=0, return_index=True, return_counts=True)[1:]


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


def shape_functions(x: np.ndarray, kind: str) -> np.ndarray:
    """Of the second-order cell at points of the reference cell, shape (points, nodes)."""
    edges = np.array(EDGES[kind])
    if kind == "tet":
        share = np.column_stack([1 - x.sum(axis=1), x])
        middle = 4 * share[:, edges[:, 0]] * share[:, edges[:, 1]]
        return np.hstack([share * (2 * share - 1), middle])
    # Of the 20-node hexahedron: quadratic along its own edge, linear across; corners without
    # what the middles take.
    corner = np.prod(np.where(REFERENCE["hex"] > 0.5, x[:, None], 1 - x[:, None]), axis=2)
    ends = REFERENCE["hex"][edges]
    along = np.abs(ends[:, 1] - ends[:, 0])
    t = x @ along.T
    across = corner[:, edges[:, 0]] + corner[:, edges[:, 1]]
    middle = 4 * t * (1 - t) * across
    taken = np.zeros((len(edges), CORNERS["hex"]))
    taken[np.arange(len(edges))[:, None], edges] = 0.5
    return np.hstack([corner - middle @ taken, middle])
