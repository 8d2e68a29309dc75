"""A solid with every cell cut in eight, its shape kept."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fenics_ehd.fem.solid import EDGES, REFERENCE, Solid, shape_functions

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
    places = np.array([_with_middles(corners, solid.kind) for corners in _children(solid.kind)])
    count = places.shape[1]
    shapes = shape_functions(places.reshape(-1, 3), solid.kind)
    x = np.einsum("mn,cnk->cmk", shapes, solid.points[solid.cells]).reshape(-1, 3)
    # Those of the given mesh come first and keep their numbers.
    every = np.vstack([solid.points, x])
    near = SAME * np.ptp(solid.points, axis=0).max()
    pairs = cKDTree(every).query_pairs(near, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(every), len(every)))
    group = connected_components(graph, directed=False)[1]
    _, first, number = np.unique(group, return_index=True, return_inverse=True)
    order = np.argsort(first)
    number = np.argsort(order)[number]
    cells = number[len(solid.points) :].reshape(-1, count)
    made = Solid(every[first[order]], cells, solid.kind)
    return made, *_labelled(made, len(solid.points), facets, labels)


def _with_middles(corners: np.ndarray, kind: str) -> np.ndarray:
    return np.vstack([corners, corners[np.array(EDGES[kind])].mean(axis=1)])


def _children(kind: str) -> list[np.ndarray]:
    """Corners of the eight in the reference cell."""
    if kind == "hex":
        return [0.5 * (REFERENCE["hex"] + corner) for corner in REFERENCE["hex"]]
    nodes = _with_middles(REFERENCE["tet"], "tet")
    found = []
    for four in _TETRAHEDRA:
        x = nodes[list(four)]
        found.append(x if np.linalg.det(x[1:] - x[0]) > 0 else x[[0, 2, 1, 3]])
    return found


def _labelled(
    made: Solid, former: int, facets: np.ndarray, labels: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Facets and their labels, told by the nodes of the former mesh at their corners."""
    count = facets.shape[1] // 2
    known = {}
    for nodes, label in zip(facets.tolist(), labels.tolist(), strict=True):
        for side in range(count):
            beside = (nodes[count + side], nodes[count + (side - 1) % count])
            known[frozenset((nodes[side], *beside))] = label
        known[frozenset(nodes[count:])] = label
    found = made.facets()
    corners = found[:, :count].tolist()
    return found, np.array([known[frozenset(n for n in row if n < former)] for row in corners])
