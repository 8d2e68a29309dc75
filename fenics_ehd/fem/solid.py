"""Solids as arrays of nodes and cells, and the facets of their surface.

Cells are of first order, as in a file, or of second order, as in a computation. They must neither
overlap nor be inside out. Second-order cells can be divided into eight without a change of shape.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from fenics_ehd.base.errors import MeshError
from fenics_ehd.reduction.elements import SOLIDS, NodalElement, with_middles

#: Corners of the faces of a cell, counter-clockwise as seen from outside.
FACES = {
    "tet": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    "hex": (
        *((0, 3, 2, 1), (0, 1, 5, 4), (0, 4, 7, 3)),
        *((1, 2, 6, 5), (2, 3, 7, 6), (4, 5, 6, 7)),
    ),
}

#: Gmsh's order of the nodes of a cell, as indices in `SOLIDS`; for tetrahedra its own inverse.
GMSH_TET = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]
GMSH_HEX = [*range(8), 8, 11, 16, 9, 17, 10, 18, 19, 12, 15, 13, 14]


#: Surface elements of `ELEMENTS` on the facets of first-order and second-order cells.
FACET_ELEMENTS = {"tet": ("linear triangle", "triangle"), "hex": ("bilinear", "serendipity")}


@dataclass(frozen=True, eq=False)
class Solid:
    """A solid as a mesh of cells of one kind and order.

    Attributes
    ----------
    points
        Positions of the nodes, shape (n, 3) [m].
    cells
        Node indices of each cell in the order of `SOLIDS`. First-order cells have corners only,
        shape (c, 4) or (c, 8); second-order cells have mid-edge nodes after the corners, shape
        (c, 10) or (c, 20).
    kind
        ``"tet"`` or ``"hex"``.
    """

    points: np.ndarray
    cells: np.ndarray
    kind: str

    @property
    def element(self) -> NodalElement:
        """Element of a second-order cell of this kind."""
        return SOLIDS[self.kind]

    @property
    def quadratic(self) -> bool:
        """Whether the cells are of second order."""
        return self.cells.shape[1] > self.element.corners

    @property
    def facet_element(self) -> str:
        """Name of the surface element of the facets, for `bore_from_faces`."""
        return FACET_ELEMENTS[self.kind][int(self.quadratic)]

    @property
    def corners(self) -> np.ndarray:
        """Node indices at the corners of each cell, shape (c, 4 or 8)."""
        return self.cells[:, : self.element.corners]

    def face_rows(self) -> np.ndarray:
        """Nodes of each face of a cell, as indices within the cell, one row for each face.

        The corners come first, in order around the face, then the mid-edge nodes.
        """
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
        """Node indices of the facets of the surface, shape (f, 3), (f, 4), (f, 6) or (f, 8).

        Corners come first, then mid-edge nodes of second-order cells. Facets have the same order
        for first-order and second-order cells.
        """
        nodes, first, uses = self.faces()
        return nodes[np.sort(first[uses == 1])]

    def faces(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Node indices of the faces of all cells, and the distinct faces among them.

        Returns
        -------
        tuple of numpy.ndarray
            Node indices of every face of every cell, one row for each face; for each distinct
            face, its row in this array and the number of cells that share it.
        """
        rows = self.face_rows()
        nodes = self.cells[:, rows].reshape(-1, rows.shape[1])
        corners = np.sort(nodes[:, : len(FACES[self.kind][0])], axis=1)
        return nodes, *np.unique(corners, axis=0, return_index=True, return_counts=True)[1:]


def raised(points: np.ndarray, corners: np.ndarray, kind: str) -> Solid:
    """Make a second-order solid with straight edges from first-order cells."""
    pairs = np.sort(corners[:, SOLIDS[kind].edges], axis=2)
    edges, numbers = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    middles = len(points) + numbers.reshape(pairs.shape[:2])
    return Solid(
        np.vstack([points, points[edges].mean(axis=1)]), np.hstack([corners, middles]), kind
    )


def second_order(solid: Solid) -> Solid:
    """Convert a solid to second-order cells; mid-edge nodes of first-order cells are appended."""
    return solid if solid.quadratic else raised(solid.points, solid.cells, solid.kind)


#: Largest distance of a mid-edge node of a straight edge from the middle of the chord, relative to
#: the length of the edge. It is 8e-4 for an arc of a circle with 1000 cells around.
STRAIGHT = 1e-4


def straight(solid: Solid) -> bool:
    """Whether all edges of a solid are straight, as in every first-order solid."""
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
    """Convert a solid to first-order cells; node indices and the order of facets are unchanged."""
    return Solid(solid.points, solid.corners, solid.kind)


def facet_corners(facets: np.ndarray) -> np.ndarray:
    """Corners of facets of first or second order, shape (f, 3) or (f, 4)."""
    return facets[:, : 3 if facets.shape[1] in (3, 6) else 4]


def used(solid: Solid) -> Solid:
    """Remove nodes that belong to no cell, such as reference points of assemblies."""
    nodes, cells = np.unique(solid.cells, return_inverse=True)
    return Solid(solid.points[nodes], cells.reshape(solid.cells.shape), solid.kind)


def corner_volumes(solid: Solid) -> np.ndarray:
    """Smallest normalised volume at the corners of each cell, shape (c,).

    The normalised volume at a corner is the volume that its three edges span, over the product of
    their lengths: 1 for a cube, 0.71 for a regular tetrahedron, negative for a cell that is turned
    inside out.
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
    """Mask of cells that are inside out or flat, because of corners or curved edges, shape (c,)."""
    wrong = corner_volumes(solid) <= 0
    solid = second_order(solid)
    x = solid.points[solid.cells]
    slopes = solid.element.tabulate(solid.element.rule(4)[0])[1]
    for at_point in slopes.swapaxes(0, 1):
        wrong |= np.linalg.det(at_point @ x) <= 0
    return wrong


def require_sound_cells(solid: Solid, path: str | Path) -> None:
    """Refuse invalid cells: Gmsh and dolfinx crash if a face belongs to more than two cells.

    Raises
    ------
    MeshError
        If cells are repeated, overlap or are inside out; the message has the number of cells.
    """
    corners = solid.corners
    count = len(corners)
    if twice := count - len(np.unique(np.sort(corners, axis=1), axis=0)):
        raise MeshError(f"{path}: {twice} of {count} cells are repeated: export the part once")
    if many := int((solid.faces()[2] > 2).sum()):
        raise MeshError(
            f"{path}: {many} faces are shared by more than two cells: mesh the part again"
        )
    if wrong := int(inside_out(solid).sum()):
        remedy = "use smaller cells, more of them around and along the bores"
        if wrong == count:
            remedy = "list their nodes the other way round"
        raise MeshError(
            f"{path}: {wrong} of {count} cells are turned inside out, by their corners or by the "
            f"curvature of the surface: {remedy}"
        )


#: Limits of a part's longest side [m]: lengths outside of them are in another unit.
SHORTEST = 1e-3
LONGEST = 5.0


def require_extent(extent: np.ndarray, path: str | Path) -> None:
    """Refuse a part whose size shows that its unit of length is wrong.

    Parameters
    ----------
    extent
        Sides of the bounding box, shape (3,) [m].
    path
        Path of the part's file.

    Raises
    ------
    MeshError
        If the longest side is below `SHORTEST` or above `LONGEST`.
    """
    longest = float(np.max(extent))
    if longest < SHORTEST:
        raise MeshError(
            f"{path} is {longest:g} m long, below {SHORTEST:g}: give its --unit, for example m"
        )
    if longest > LONGEST:
        raise MeshError(
            f"{path} is {longest:g} m long, above {LONGEST:g}: give its --unit, for example mm"
        )


#: Distance below which nodes coincide, relative to the size of the part.
SAME = 1e-9

#: Nodes of the eight tetrahedra into which one is divided: four at its corners, then four around
#: the diagonal between the nodes 6 and 8.
_TETRAHEDRA = (
    *((0, 4, 6, 7), (4, 1, 5, 8), (6, 5, 2, 9), (7, 8, 9, 3)),
    *((6, 8, 4, 5), (6, 8, 5, 9), (6, 8, 9, 7), (6, 8, 7, 4)),
)


def refined(
    solid: Solid, facets: np.ndarray, labels: np.ndarray
) -> tuple[Solid, np.ndarray, np.ndarray]:
    """Divide every cell into eight, with new nodes on the second-order geometry.

    Parameters
    ----------
    solid
        Solid of second-order cells.
    facets, labels
        Facets of the surface, shape (f, k), and a label for each facet, shape (f,).

    Returns
    -------
    tuple
        Refined solid; facets of its surface, shape (4 f, k); label of each of these facets, which
        is that of the facet from which it was made, shape (4 f,).
    """
    references = np.array([with_middles(x, solid.element.edges) for x in _children(solid.kind)])
    count = references.shape[1]
    shapes = solid.element.shapes(references.reshape(-1, 3))
    x = np.einsum("mn,cnk->cmk", shapes, solid.points[solid.cells]).reshape(-1, 3)
    # Nodes of the coarse mesh come first and keep their numbers.
    every = np.vstack([solid.points, x])
    near = SAME * np.ptp(solid.points, axis=0).max()
    references = cKDTree(every).query_ball_point(every, near)
    kept, number = np.unique([min(group) for group in references], return_inverse=True)
    cells = number[len(solid.points) :].reshape(-1, count)
    made = Solid(every[kept], cells, solid.kind)
    return made, *_labelled(made, len(solid.points), facets, labels)


def _children(kind: str) -> list[np.ndarray]:
    """Corners of the eight cells into which a cell is divided, in its reference coordinates."""
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
    """Facets of a refined solid, and their labels, which are those of the facets before refinement.

    Parameters
    ----------
    made
        Refined solid.
    former
        Number of nodes before the refinement.
    facets, labels
        Facets before the refinement, shape (f, k), and their labels, shape (f,).
    """
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
