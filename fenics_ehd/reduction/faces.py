"""Bore of a foreign part: load matrix (15) and mean motion from the faces of its surface."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fenics_ehd.base.errors import StructureError
from fenics_ehd.reduction.bore import Bore, mean_motion, no_cells
from fenics_ehd.reduction.bore_holes import FEWEST_EDGES, bore_holes
from fenics_ehd.reduction.surface_elements import (
    SurfaceElement,
    package_order,
    surface_element,
)

if TYPE_CHECKING:
    from scipy import sparse

#: Gauss points a direction. A load is polynomial, of degree 7 in each variable on 9 nodes and 6
#: in both on 6: exact. An area is not, and needs more where a cell is bent by 30 degrees.
_LOAD_POINTS, _AREA_POINTS = 4, 8

#: Largest distance of a bore node from the cylinder, relative to its radius.
CYLINDER_TOLERANCE = 1e-6


def bore_load_matrix(nodes: np.ndarray, faces: np.ndarray, element: str) -> sparse.csr_matrix:
    """Load matrix J of (15): nodal forces of nodal pressures that push the bore outward.

    Parameters
    ----------
    nodes
        Positions of all nodes of the part, shape (n, 3) [m]; the bore's axis is z.
    faces
        Global numbers of the nodes of each face, shape (c, k): corners, then edge midpoints and
        centre, each in any order (`package_order` finds it), or corners and midpoints in turn.
        Which side of a face is its outer one does not matter: the force points away from the
        axis.
    element
        A key of `surface_elements.ELEMENTS`: ``"serendipity"`` (8 nodes), ``"lagrange"``
        (9), ``"triangle"`` (6), ``"bilinear"`` (4) or ``"linear triangle"`` (3).

    Returns
    -------
    scipy.sparse.csr_matrix
        shape (3 n, m) [m^2]: entry (3 i + c, j) is the integral of ``N_i N_j n_c``, n the
        normal away from the axis. The columns are the nodes of the faces by z, then angle.

    Raises
    ------
    StructureError
        Faces that do not fit the element or the nodes, or are folded.
    """
    nodes, faces, _ = _checked(nodes, faces, element)
    numbers, cells = _ordered(nodes, faces)
    return surface_load_matrix((nodes, faces, element), (nodes[numbers], cells, element))


def surface_load_matrix(
    surface: tuple[np.ndarray, np.ndarray, str], pressures: tuple[np.ndarray, np.ndarray, str]
) -> sparse.csr_matrix:
    """The same of any nodes of the pressures, on the same cells.

    Parameters
    ----------
    surface
        Positions (n, 3) [m], cells (c, k) and element of the displacement.
    pressures
        The same of the pressures, cell by cell in the same place and direction.

    Returns
    -------
    scipy.sparse.csr_matrix
        shape (3 n, m) [m^2].
    """
    from scipy import sparse

    nodes, faces, element = surface
    kind = surface_element(element, faces)
    values, normals = _normals(nodes, faces, kind)
    shapes, _ = surface_element(pressures[2], pressures[1]).tabulate(kind.rule(_LOAD_POINTS)[0])
    blocks = np.einsum("cqd,qi,qj->cidj", normals, values, shapes)
    rows = (3 * faces[:, :, None] + np.arange(3))[..., None]
    columns = pressures[1][:, None, None, :]
    rows, columns = (np.broadcast_to(a, blocks.shape).ravel() for a in (rows, columns))
    shape = (3 * len(nodes), len(pressures[0]))
    return sparse.coo_matrix((blocks.ravel(), (rows, columns)), shape=shape).tocsr()


def bore_from_faces(
    nodes: np.ndarray, faces: np.ndarray, element: str, centre: tuple = (0.0, 0.0, 0.0)
) -> Bore:
    """The bore of a part from the faces of its surface.

    Parameters
    ----------
    nodes, faces, element
        As in `bore_load_matrix`. Pressures have the nodes and shape functions of the faces.
    centre
        Of the bore [m].

    Returns
    -------
    Bore
        Nodes sorted by z, then angle, with `load` as SciPy matrix and `reference`. No film
        knows a mesh of linear triangles: its family stays unknown.

    Raises
    ------
    StructureError
        The faces are no whole cylinder along z about the centre, half of it on either side.
    """
    nodes, faces, _ = _checked(nodes, faces, element, np.asarray(centre, dtype=float))
    numbers, cells = _ordered(nodes, faces)
    x = nodes[numbers]
    radii = np.linalg.norm(x[:, :2], axis=1)
    radius = float(radii.mean())
    _check_cylinder(numbers, x, radii - radius, radius)
    load = bore_load_matrix(nodes, faces, element)
    _check_closed(nodes, faces, element, radius)
    family = "" if element == "linear triangle" else element
    known = cells[np.lexsort(np.sort(cells, axis=1).T[::-1])] if family else no_cells()
    return Bore(
        radius=radius,
        width=float(np.ptp(x[:, 2])),
        nodes=numbers.astype(np.int32),
        coordinates=x,
        pressure_coordinates=x,
        load=load,
        cells=known,
        family=family,
        pressure_cells=known,
        pressure_family=family,
        reference=mean_motion(x, surface_gram(x, cells, element)),
        centre=np.asarray(centre, dtype=float),
    )


def surface_gram(coordinates: np.ndarray, cells: np.ndarray, element: str) -> sparse.csr_matrix:
    """Consistent surface mass ``int N_i N_j dA`` on any surface.

    Parameters
    ----------
    coordinates
        Positions of the nodes, shape (m, 3) [m].
    cells
        Positions in `coordinates` of the nodes of each cell, shape (c, k), as in
        `bore_load_matrix`.
    element
        A key of `surface_elements.ELEMENTS`.

    Returns
    -------
    scipy.sparse.csr_matrix
        shape (m, m) [m^2].
    """
    from scipy import sparse

    kind = surface_element(element, np.asarray(cells))
    values, normals = _area_vectors(coordinates, cells, kind, _AREA_POINTS)
    blocks = np.einsum("cq,qi,qj->cij", np.linalg.norm(normals, axis=2), values, values)
    rows = np.broadcast_to(cells[:, :, None], blocks.shape).ravel()
    columns = np.broadcast_to(cells[:, None, :], blocks.shape).ravel()
    shape = (len(coordinates), len(coordinates))
    return sparse.coo_matrix((blocks.ravel(), (rows, columns)), shape=shape).tocsr()


def _checked(
    nodes: np.ndarray, faces: np.ndarray, element: str, centre: np.ndarray | float = 0.0
) -> tuple[np.ndarray, np.ndarray, SurfaceElement]:
    """Nodes from the centre, and faces in the order of the package."""
    nodes, faces = np.asarray(nodes, dtype=float), np.asarray(faces)
    kind = surface_element(element, faces)
    if nodes.ndim != 2 or nodes.shape[1] != 3:
        raise StructureError(f"nodes have shape {nodes.shape}, (nodes, 3) is needed")
    if faces.dtype.kind not in "iu" or not 0 <= faces.min() <= faces.max() < len(nodes):
        raise StructureError(
            f"faces name nodes {faces.min()} to {faces.max()} (type {faces.dtype}), there are 0 to "
            f"{len(nodes) - 1}"
        )
    ordered = np.sort(faces, axis=1)
    repeated = np.flatnonzero((ordered[:, 1:] == ordered[:, :-1]).any(axis=1))
    if len(repeated):
        raise StructureError(f"face {repeated[0]} names a node twice: {faces[repeated[0]]}")
    used = nodes[np.unique(faces)]
    if not np.isfinite(used).all():
        raise StructureError("a node of the faces has a coordinate that is not finite")
    nodes = nodes - centre
    faces = faces.astype(np.int64)
    return nodes, package_order(_unrolled(nodes[faces]), faces, element), kind


def _unrolled(x: np.ndarray) -> np.ndarray:
    """Nodes of faces (c, k, 3) on the cylinder unrolled, (c, k, 2) [m]."""
    angle = np.arctan2(x[:, :, 1], x[:, :, 0])
    middle = x.mean(axis=1, keepdims=True)
    angle = np.mod(angle - np.arctan2(middle[:, :, 1], middle[:, :, 0]) + np.pi, 2 * np.pi)
    return np.stack([np.linalg.norm(x[:, :, :2], axis=2).mean() * angle, x[:, :, 2]], axis=2)


def _ordered(nodes: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of the faces by z, then angle, and the faces in these positions."""
    numbers = np.unique(faces)
    x = nodes[numbers]
    radius = np.linalg.norm(x[:, :2], axis=1).mean()
    angle = np.mod(np.arctan2(x[:, 1], x[:, 0]) + 1e-9, 2 * np.pi)
    order = np.lexsort((np.round(angle, 6), np.round(x[:, 2] / radius, 6)))
    place = np.empty(len(numbers), dtype=np.int64)
    place[order] = np.arange(len(numbers))
    return numbers[order], place[np.searchsorted(numbers, faces)]


def _area_vectors(
    nodes: np.ndarray, faces: np.ndarray, kind: SurfaceElement, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions (q, k) at the Gauss points, and normals times area there, (c, q, 3)."""
    points, weights = kind.rule(count)
    values, derivatives = kind.tabulate(points)
    along, across = np.einsum("dqk,ckx->dcqx", derivatives, nodes[faces])
    return values, np.cross(along, across) * weights[:, None]


def _normals(
    nodes: np.ndarray, faces: np.ndarray, kind: SurfaceElement
) -> tuple[np.ndarray, np.ndarray]:
    """As `_area_vectors`, all pointing away from the z axis."""
    values, normals = _area_vectors(nodes, faces, kind, _LOAD_POINTS)
    x = values @ nodes[faces]
    outward = np.einsum("cqx,cqx->cq", normals[:, :, :2], x[:, :, :2])
    signs = np.sign(outward[:, :1])
    folded = np.flatnonzero((outward * signs <= 0).any(axis=1))
    if len(folded):
        raise StructureError(
            f"face {folded[0]} with nodes {faces[folded[0]]} is folded or does not face the z "
            "axis: its corners must come first, or corners and middles of edges in turn"
        )
    return values, normals * signs[:, :, None]


def _check_cylinder(
    numbers: np.ndarray, x: np.ndarray, deviation: np.ndarray, radius: float
) -> None:
    """Every node on the cylinder, half of it on either side of z = 0."""
    worst = int(np.argmax(np.abs(deviation)))
    if not abs(deviation[worst]) <= CYLINDER_TOLERANCE * radius:
        raise StructureError(
            f"the bore is not a cylinder about the z axis: node {numbers[worst]} lies "
            f"{deviation[worst]:.1e} m off the mean radius {radius:.6g} m, above "
            f"{CYLINDER_TOLERANCE:.0e} radii; midpoints of edges must lie on it too"
        )
    middle = 0.5 * (x[:, 2].min() + x[:, 2].max())
    if not abs(middle) <= CYLINDER_TOLERANCE * radius:
        raise StructureError(
            f"the bore must be centred at z = 0, its middle is at z = {middle:.3e} m"
        )


def _check_closed(nodes: np.ndarray, faces: np.ndarray, element: str, radius: float) -> None:
    """Two faces at every edge, but one at the edges of the two ends and of holes."""
    edges = np.sort(faces[:, surface_element(element, faces).edges].reshape(-1, 2), axis=1)
    edges, uses = np.unique(edges, axis=0, return_counts=True)
    z = nodes[:, 2]
    heights, ends = z[edges], z[faces].max()
    at_end = (np.abs(np.abs(heights) - ends) <= CYLINDER_TOLERANCE * radius).all(axis=1)
    at_end &= heights[:, 0] * heights[:, 1] > 0
    wrong = np.flatnonzero(uses != np.where(at_end, 1, 2))
    if len(wrong) >= FEWEST_EDGES and (uses[wrong] == 1).all():
        used = np.unique(faces)
        bore_holes(nodes[used], np.searchsorted(used, faces), element)  # refuses what is no hole
        return
    if len(wrong):
        first, second = edges[wrong[0]]
        raise StructureError(
            f"the bore is not a whole cylinder: the edge of nodes {first} and {second} belongs to "
            f"{uses[wrong[0]]} faces, not {1 if at_end[wrong[0]] else 2}"
        )
