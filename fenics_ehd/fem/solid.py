"""A solid as arrays of nodes and cells, from any mesh, and the facets of its surface.

Cells are of first order, as a file has them, or of second order, as a part is computed with. They
must neither overlap nor be inside out; second-order cells can be cut in eight, the shape kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from fenics_ehd.base.errors import MeshError
from fenics_ehd.reduction.elements import SOLIDS, NodalElement, with_middles

#: Corners of the faces of a cell, seen from outside against the clock.
FACES = {
    "tet": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    "hex": (
        *((0, 3, 2, 1), (0, 1, 5, 4), (0, 4, 7, 3)),
        *((1, 2, 6, 5), (2, 3, 7, 6), (4, 5, 6, 7)),
    ),
}

#: Gmsh's order of the nodes of a cell, in places of this one's; that of tetrahedra both ways.
GMSH_TET = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]
GMSH_HEX = [*range(8), 8, 11, 16, 9, 17, 10, 18, 19, 12, 15, 13, 14]


#: Surface elements of `ELEMENTS` on the facets of first- and of second-order cells.
FACET_ELEMENTS = {"tet": ("linear triangle", "triangle"), "hex": ("bilinear", "serendipity")}


@dataclass(frozen=True, eq=False)
class Solid:
    """Cells of one kind and one order.

    Attributes
    ----------
    points
        Nodes, shape (n, 3) [m].
    cells
        Nodes of each cell: corners, shape (c, 4) or (c, 8); of second-order cells then edges as in
        `SOLIDS`, shape (c, 10) or (c, 20).
    kind
        ``"tet"`` or ``"hex"``.
    """

    points: np.ndarray
    cells: np.ndarray
    kind: str

    @property
    def element(self) -> NodalElement:
        """Shape functions of a second-order cell."""
        return SOLIDS[self.kind]

    @property
    def quadratic(self) -> bool:
        """True of second-order cells."""
        return self.cells.shape[1] > self.element.corners

    @property
    def facet_element(self) -> str:
        """Name of the surface element of the facets, as `bore_from_faces` takes it."""
        return FACET_ELEMENTS[self.kind][int(self.quadratic)]

    @property
    def corners(self) -> np.ndarray:
        """Nodes at the corners of each cell, shape (c, 4 or 8)."""
        return self.cells[:, : self.element.corners]

    def face_rows(self) -> np.ndarray:
        """Places in a cell of the nodes of each face: corners in turn, then the edges between."""
        if not self.quadratic:
            return np.array(FACES[self.kind])
        edges = self.element.edges.tolist()
        number = {frozenset(edge): i for i, edge in enumerate(edges, self.element.corners)}
        rows = []
        for face in FACES[self.kind]:
            sides = zip(face, face[1:] + face[:1], strict=True)
            rows.append([*face, *(number[frozenset(side)] for side in sides)])
        return np.array(rows)

    def facets(self) -> np.ndarray:
        """Nodes of the facets of the surface: corners, then the edges of second-order cells.

        shape (f, 3), (f, 4), (f, 6) or (f, 8); facets come in the same order for both orders.
        """
        nodes, first, uses = self.faces()
        return nodes[np.sort(first[uses == 1])]

    def faces(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Nodes of the faces of every cell, the first of each kind, and how often it is there."""
        rows = self.face_rows()
        nodes = self.cells[:, rows].reshape(-1, rows.shape[1])
        corners = np.sort(nodes[:, : len(FACES[self.kind][0])], axis=1)
        return nodes, *np.unique(corners, axis=0, return_index=True, return_counts=True)[1:]


def raised(points: np.ndarray, corners: np.ndarray, kind: str) -> Solid:
    """Second-order solid of first-order cells, whose edges are straight."""
    pairs = np.sort(corners[:, SOLIDS[kind].edges], axis=2)
    edges, numbers = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    middles = len(points) + numbers.reshape(pairs.shape[:2])
    return Solid(
        np.vstack([points, points[edges].mean(axis=1)]), np.hstack([corners, middles]), kind
    )


def second_order(solid: Solid) -> Solid:
    """The solid with nodes in the middles of straight edges, behind its own, where it has none."""
    return solid if solid.quadratic else raised(solid.points, solid.cells, solid.kind)


#: Distance of an edge's middle from half way that is taken for rounding, relative to its length:
#: that of an arc of a circle of 1000 cells is 8e-4.
STRAIGHT = 1e-4


def straight(solid: Solid) -> bool:
    """True of a solid all of whose edges are straight, as of every one of first order."""
    if not solid.quadratic:
        return True
    for middle, edge in enumerate(solid.element.edges.tolist(), solid.element.corners):
        ends = solid.points[solid.cells[:, edge]]
        off = solid.points[solid.cells[:, middle]] - ends.mean(axis=1)
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        if (np.linalg.norm(off, axis=1) > STRAIGHT * length).any():
            return False
    return True


def first_order(solid: Solid) -> Solid:
    """The solid of the corners alone; facets come in the same order, nodes keep their numbers."""
    return Solid(solid.points, solid.corners, solid.kind)


def facet_corners(facets: np.ndarray) -> np.ndarray:
    """Corners of facets of first or second order, shape (f, 3) or (f, 4)."""
    return facets[:, : 3 if facets.shape[1] in (3, 6) else 4]


def used(solid: Solid) -> Solid:
    """Without nodes that no cell has: reference points of assemblies, say."""
    nodes, cells = np.unique(solid.cells, return_inverse=True)
    return Solid(solid.points[nodes], cells.reshape(solid.cells.shape), solid.kind)


def corner_volumes(solid: Solid) -> np.ndarray:
    """Smallest volume that the edges at a corner of a cell span, of each cell, shape (c,).

    Relative to the product of their lengths: 1 at the corners of a cube, 0.71 in an even
    tetrahedron; in a cell turned inside out it is negative.
    """
    x = solid.points[solid.corners]
    element = solid.element
    volumes = []
    for corner in range(element.corners):
        ends = [a + b - corner for a, b in element.edges if corner in (a, b)]
        rays = x[:, ends] - x[:, corner, None]
        lengths = np.linalg.norm(rays, axis=2).prod(axis=1)
        sign = np.sign(np.linalg.det(element.nodes[ends] - element.nodes[corner]))
        volumes.append(sign * np.linalg.det(rays) / np.maximum(lengths, 1e-300))
    return np.min(volumes, axis=0)


def inside_out(solid: Solid) -> np.ndarray:
    """Mask of cells turned inside out or flat, by corners or curvature, shape (c,)."""
    wrong = corner_volumes(solid) <= 0
    solid = second_order(solid)
    x = solid.points[solid.cells]
    slopes = solid.element.tabulate(solid.element.rule(4)[0])[1]
    for at_point in slopes.swapaxes(0, 1):
        wrong |= np.linalg.det(at_point @ x) <= 0
    return wrong


def require_sound_cells(solid: Solid, path: str | Path) -> None:
    """Refuse cells that are no solid: Gmsh and dolfinx crash on faces of more than two cells.

    Raises
    ------
    MeshError
        Cells are repeated, overlap or are turned inside out; the message has their number.
    """
    corners = solid.corners
    count = len(corners)
    if twice := count - len(np.unique(np.sort(corners, axis=1), axis=0)):
        raise MeshError(f"{path}: {twice} of {count} cells are there twice: export the part once")
    if many := int((solid.faces()[2] > 2).sum()):
        raise MeshError(f"{path}: {many} faces are shared by more than two cells: mesh it again")
    if wrong := int(inside_out(solid).sum()):
        remedy = "take smaller ones, more cells around and along its bores"
        if wrong == count:
            remedy = "list their nodes the other way round"
        raise MeshError(
            f"{path}: {wrong} of {count} cells are turned inside out, by their corners or by the "
            f"curvature of the surface: {remedy}"
        )


#: Limits of a part's longest side [m]: outside of them its lengths are in another unit.
SHORTEST = 1e-3
LONGEST = 5.0


def require_extent(extent: np.ndarray, path: str | Path) -> None:
    """Refuse a part whose lengths are in another unit than the one it was read in.

    Parameters
    ----------
    extent
        Sides of the box around it, shape (3,) [m].
    path
        Of its file.

    Raises
    ------
    MeshError
        The longest side is below `SHORTEST` or above `LONGEST`.
    """
    longest = float(np.max(extent))
    if longest < SHORTEST:
        raise MeshError(f"{path} is {longest:g} m long, below {SHORTEST:g}: give its --unit, m say")
    if longest > LONGEST:
        raise MeshError(f"{path} is {longest:g} m long, above {LONGEST:g}: give its --unit, mm say")


#: Distance of nodes that are one, relative to the size of the part.
SAME = 1e-9

#: Tetrahedra in one by its nodes: at the corners, then about the diagonal from node 6 to 8.
_TETRAHEDRA = (
    *((0, 4, 6, 7), (4, 1, 5, 8), (6, 5, 2, 9), (7, 8, 9, 3)),
    *((6, 8, 4, 5), (6, 8, 5, 9), (6, 8, 9, 7), (6, 8, 7, 4)),
)


def refined(
    solid: Solid, facets: np.ndarray, labels: np.ndarray
) -> tuple[Solid, np.ndarray, np.ndarray]:
    """Cells cut in eight, whose nodes lie where the second-order cells have them.

    Parameters
    ----------
    facets, labels
        Of its surface, and a number for each.

    Returns
    -------
    tuple
        The solid, its facets, and the label of the facet that each was cut from.
    """
    references = np.array([with_middles(x, solid.element.edges) for x in _children(solid.kind)])
    count = references.shape[1]
    shapes = solid.element.shapes(references.reshape(-1, 3))
    x = np.einsum("mn,cnk->cmk", shapes, solid.points[solid.cells]).reshape(-1, 3)
    # Those of the given mesh come first and keep their numbers.
    every = np.vstack([solid.points, x])
    near = SAME * np.ptp(solid.points, axis=0).max()
    references = cKDTree(every).query_ball_point(every, near)
    kept, number = np.unique([min(group) for group in references], return_inverse=True)
    cells = number[len(solid.points) :].reshape(-1, count)
    made = Solid(every[kept], cells, solid.kind)
    return made, *_labelled(made, len(solid.points), facets, labels)


def _children(kind: str) -> list[np.ndarray]:
    """Corners of the eight in the reference cell."""
    if kind == "hex":
        corners = SOLIDS["hex"].nodes[:8]
        return [0.5 * (corners + corner) for corner in corners]
    nodes = SOLIDS["tet"].nodes
    children = []
    for four in _TETRAHEDRA:
        x = nodes[list(four)]
        children.append(x if np.linalg.det(x[1:] - x[0]) > 0 else x[[0, 2, 1, 3]])
    return children


def _labelled(
    made: Solid, former: int, facets: np.ndarray, labels: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Facets and their labels, from the nodes of the former mesh at their corners."""
    count = facets.shape[1] // 2
    known = {}
    for nodes, label in zip(facets.tolist(), labels.tolist(), strict=True):
        for side in range(count):
            middles = (nodes[count + side], nodes[count + (side - 1) % count])
            known[frozenset((nodes[side], *middles))] = label
        known[frozenset(nodes[count:])] = label
    all_facets = made.facets()
    corners = all_facets[:, :count].tolist()
    return all_facets, np.array([known[frozenset(n for n in row if n < former)] for row in corners])
