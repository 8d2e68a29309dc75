"""Lubricated bores of a part: cylinders along z with their surface meshes, and rigid motion.

The load matrix (15) and the mean motion of a part from another program are computed from the faces
of its surface. Faces may have holes, such as oil passages, whose rims, positions and sizes are
found.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from fenics_ehd.base.errors import SettingsError, StructureError
from fenics_ehd.base.layout import Value
from fenics_ehd.reduction.elements import (
    ELEMENTS,
    NodalElement,
    package_order,
    summed,
    surface_element,
)

if TYPE_CHECKING:  # the import would start MPI
    from petsc4py import PETSc


def rigid_fields(coordinates: np.ndarray) -> np.ndarray:
    """Unit translations and rotations about the origin, shape (3 nodes, 6)."""
    x, y, z = coordinates.T
    fields = np.zeros((len(coordinates), 3, 6))
    fields[:, range(3), range(3)] = 1.0
    fields[:, 1, 3] = -z
    fields[:, 2, 3] = y
    fields[:, 0, 4] = z
    fields[:, 2, 4] = -x
    fields[:, 0, 5] = -y
    fields[:, 1, 5] = x
    return fields.reshape(-1, 6)


def turned(columns: np.ndarray, axis: int) -> np.ndarray:
    """``e_axis x u`` node by node, for displacement fields of shape (3 nodes, k)."""
    result = np.zeros_like(columns)
    first = (axis + 1) % 3
    second = (axis + 2) % 3
    result[first::3] = -columns[second::3]
    result[second::3] = columns[first::3]
    return result


B = TypeVar("B", bound="BoreSurface")

#: Name of the bore of a part with exactly one bore.
BORE = "bore"


def make_row_major(record: Any) -> None:
    """Store arrays of a dataclass in row-major order, as in files; part-size columns excepted.

    Products of arrays in another order round differently, and a body from a file must give the
    same run to the last bit.
    """
    for name, value in vars(record).items():
        if isinstance(value, np.ndarray) and name != "columns":
            object.__setattr__(record, name, np.ascontiguousarray(value))


#: Largest number of waves around a bore in the smooth pressures.
WAVES = 9

#: Legendre polynomials along the bore, whose products with the waves are the smooth pressures.
HEIGHTS = 3
SMOOTH = (2 * WAVES + 1) * HEIGHTS

#: Quadratic cells around and along a bore at whose nodes displacements are stored.
SAMPLED = 40, 8

#: Number of nodes of these cells.
SAMPLED_NODES = 2 * SAMPLED[0] * (2 * SAMPLED[1] + 1)


def no_cells() -> np.ndarray:
    """Empty array of cells, for a bore whose surface mesh is unknown."""
    return np.zeros((0, 0), dtype=np.int64)


@dataclass(frozen=True, eq=False, kw_only=True)
class BoreSurface:
    """Surface of a bore; positions are relative to its centre.

    Attributes
    ----------
    radius, width
        Bore radius R2 and bearing width B [m]; the axis is along z through the centre.
    coordinates
        Positions of the bore's nodes, shape (m, 3) [m].
    pressure_coordinates
        Positions of the pressure nodes, shape (k, 3) [m].
    cells, family
        Surface mesh of the displacement: positions in `coordinates` of the nodes of each
        bore cell, shape (c, 8, 9 or 6), corners, edge midpoints, centre in dolfinx
        order, and ``"serendipity"``, ``"lagrange"`` or ``"triangle"``. Empty when
        unknown; a film that does not match the bore needs it.
    pressure_cells, pressure_family
        Surface mesh of the pressure nodes, with the same conventions.
    centre
        Centre of the bore relative to the origin of the part, shape (3,) [m]. The origin is the
        centre of the part's first bore.
    """

    radius: float
    width: float
    coordinates: np.ndarray
    pressure_coordinates: np.ndarray
    cells: np.ndarray = field(default_factory=no_cells)
    family: str = ""
    pressure_cells: np.ndarray = field(default_factory=no_cells)
    pressure_family: str = ""
    centre: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        make_row_major(self)

    def surface(self) -> BoreSurface:
        """The surface without the further attributes of a `Bore`."""
        return BoreSurface(**{f.name: getattr(self, f.name) for f in fields(BoreSurface)})


@dataclass(frozen=True, eq=False, kw_only=True)
class Bore(BoreSurface):
    """Lubricated interface of a part: surface, nodes and pressure load.

    Attributes
    ----------
    nodes
        Global node numbers, shape (m,), sorted by z, then angle, the same on every rank.
    load
        J = M_ss of (15), (3 nodes) x k: nodal forces [N] of unit nodal pressures
        [Pa], pushing the bore outward. Any source of `as_matrix`; in a `Structure` it is
        a PETSc matrix with the rows of K.
    reference
        Mean motion of the bore, its centre C2: ``sum_ic reference[i, c, k] u[i, c]`` is for
        k < 3 the mean translation [m], else the mean rotation about its centre [rad], see
        `mean_motion`; shape (m, 3, 6). Read the other way it spreads a unit force or moment
        at C2 over the nodes. None when unknown; M1 and M2 need that of the first bore.
    """

    nodes: np.ndarray
    load: PETSc.Mat
    reference: np.ndarray | None = None


def surface_layout(number: str, *, attribute: bool) -> dict[str, Value]:
    """Layout of a stored `BoreSurface`.

    Parameters
    ----------
    number
        Kind of its numbers, see `fenics_ehd.base.layout.KINDS`.
    attribute
        Whether single values are attributes.
    """
    single = Value(number, attribute=attribute)
    family = Value("text", attribute=attribute, required=False)
    mesh = Value("integer", ("cells", "vertices"), required=False)
    return {
        "radius": single,
        "width": single,
        "coordinates": Value(number, ("nodes", 3)),
        "pressure_coordinates": Value(number, ("pressure_nodes", 3)),
        "cells": mesh,
        "family": family,
        "pressure_cells": replace(mesh, axes=("pressure_cells", "pressure_vertices")),
        "pressure_family": family,
        "centre": Value(number, (3,), required=False),
    }


def only(bores: Mapping[str, B], of: str) -> B:
    """The bore of a part with exactly one bore.

    Raises
    ------
    SettingsError
        The part has no bore, or several; the message lists their names.
    """
    if len(bores) == 1:
        return next(iter(bores.values()))
    if bores:
        raise SettingsError(f"the {of} has the bores {', '.join(bores)}: name one of them")
    raise SettingsError(f"the {of} has no bore: pressure loads need one")


def outward(nodes: np.ndarray, displacements: np.ndarray) -> np.ndarray:
    """Radial component at nodes of one bore, shape (m, 3, n) to (m, n)."""
    radial = nodes[:, :2] / np.linalg.norm(nodes[:, :2], axis=1)[:, None]
    return np.einsum("ic,icn->in", radial, displacements[:, :2])


def all_outward(bores: Mapping[str, BoreSurface], displacements: np.ndarray) -> np.ndarray:
    """Radial component at the nodes of all bores in turn, relative to the axis of each."""
    nodes = np.vstack([bore.coordinates for bore in bores.values()])
    return outward(nodes, displacements)


def mean_motion(coordinates: np.ndarray, weights: Any) -> np.ndarray:
    """Mean rigid motion of a surface as linear functions of its nodal displacements.

    Least-squares fit of ``a + b x r`` to the displacement u over the surface: the
    a and b that minimise ``int |u - a - b x r|^2 dA``. On a surface centred at the
    origin a is the area-weighted mean of u.

    Parameters
    ----------
    coordinates
        Positions r of the nodes, shape (m, 3) [m].
    weights
        ``int N_i N_j dA`` of the shape functions, shape (m, m), an array or a SciPy sparse
        matrix; or lumped nodal areas, shape (m,) [m^2].

    Returns
    -------
    numpy.ndarray
        shape (m, 3, 6): weights of u_i for the components of a, and those of b about the
        Shape (m, 3, 6): weights of u_i for the components of a, and for those of b about the
        origin. For a rigid motion the result is this motion. As nodal forces, column k has the
        resultant of a unit force or moment along its axis at the origin, and no other.

    Raises
    ------
    StructureError
        The nodes lie on one line, so that they have no rotation about it.
    """
    size = np.abs(coordinates).max()
    fields = rigid_fields(coordinates / size).reshape(len(coordinates), 18)
    weighted = weights[:, None] * fields if weights.ndim == 1 else weights @ fields
    weighted, fields = (a.reshape(-1, 6) for a in (weighted, fields))
    gram = fields.T @ weighted
    if not np.linalg.cond(gram) < 1e12:
        raise StructureError("the nodes of a surface lie on one line: it has no mean rotation")
    motion = np.linalg.solve(gram, weighted.T).T
    motion[:, 3:] /= size
    return motion.reshape(-1, 3, 6)


# Faces


#: Smallest number of edges of a rim: a rim with fewer edges surrounds one or two missing faces.
FEWEST_EDGES = 6

#: Tolerance, relative to the width, for an edge to lie at an end of the bore.
END_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class BoreHole:
    """A hole in a bore.

    Attributes
    ----------
    rim
        Nodes around the hole in order, midpoints of edges included.
    polygon
        Angle of these nodes [rad], within half a turn of the first one, and height [m], shape
        (r, 2).
    angle, height
        Centroid of the hole [rad], [m].
    diameter
        Diameter of the circle of the same area on the unwrapped bore [m].
    radius
        Radius of the bore [m].
    """

    rim: np.ndarray
    polygon: np.ndarray
    angle: float
    height: float
    diameter: float
    radius: float

    @property
    def area(self) -> float:
        """Area in the plane of angle and height [rad m]."""
        return abs(_moments(self.polygon)[0])

    def straight(self) -> BoreHole:
        """Hole with straight edges between corners, of a mesh of quadratic cells."""
        polygon = self.polygon.copy()
        closed = np.vstack([polygon[0::2], polygon[:1]])
        polygon[1::2] = 0.5 * (closed[:-1] + closed[1:])
        return replace(self, polygon=polygon)

    def contains(self, angle: np.ndarray, height: np.ndarray) -> np.ndarray:
        """True at points within the rim."""
        x = self.angle + np.mod(angle - self.angle + np.pi, 2 * np.pi) - np.pi
        # Crossings of a ray along the circumference with every edge.
        (a, low) = self.polygon.T
        (b, high) = np.roll(self.polygon, -1, axis=0).T
        x = x[..., None]
        z = np.asarray(height)[..., None]
        with np.errstate(divide="ignore", invalid="ignore"):
            beyond = x < a + (z - low) / (high - low) * (b - a)
        return np.sum(((low > z) != (high > z)) & beyond, axis=-1) % 2 == 1


def bore_holes(coordinates: np.ndarray, cells: np.ndarray, family: str) -> list[BoreHole]:
    """Holes of a bore's surface mesh, by height, then angle.

    Parameters
    ----------
    coordinates
        Positions of the nodes about the bore's centre, shape (m, 3) [m].
    cells, family
        Surface mesh, see `BoreSurface`.

    Raises
    ------
    StructureError
        A rim does not close around a hole, or has fewer than `FEWEST_EDGES` edges.
    """
    radius = float(np.linalg.norm(coordinates[:, :2], axis=1).mean())
    holes = []
    for rim in _rims(coordinates, cells, family):
        angle = np.unwrap(np.arctan2(coordinates[rim, 1], coordinates[rim, 0]))
        polygon = np.column_stack([angle, coordinates[rim, 2]])
        turned = abs(angle[-1] - angle[0]) > np.pi
        edges = len(rim) // (1 if family in ("bilinear", "linear triangle") else 2)
        if turned or edges < FEWEST_EDGES:
            raise StructureError(
                f"the bore is not a whole cylinder: a rim of {edges} edges "
                + ("goes all around it" if turned else f"is no hole, which has {FEWEST_EDGES}")
            )
        area, x, z = _moments(polygon)
        diameter = float(np.sqrt(4 * radius * abs(area) / np.pi))
        holes.append(BoreHole(rim, polygon, float(x), float(z), diameter, radius))
    return sorted(holes, key=lambda hole: (round(hole.height / radius, 6), hole.angle))


def _moments(polygon: np.ndarray) -> tuple[float, float, float]:
    """Signed area of a polygon, and its centroid."""
    first = polygon[0]
    a = polygon - first
    b = np.roll(polygon, -1, axis=0) - first
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    area = 0.5 * cross.sum()
    middle = first + ((a + b) * cross[:, None]).sum(axis=0) / (6 * area)
    return float(area), float(middle[0]), float(middle[1])


def _rims(coordinates: np.ndarray, cells: np.ndarray, family: str) -> list[np.ndarray]:
    """Nodes around every hole: along edges of a single cell that are not at an end of the bore."""
    kind = ELEMENTS[family]
    ends, first, uses, at_end = _edges(coordinates, cells, family)
    count = len(kind.edges)
    single = first[(uses == 1) & ~at_end]
    ways = corners = ends[single]
    if cells.shape[1] >= kind.corners + count:
        # Mid-side nodes come behind the corners, edge by edge.
        middle = cells[single // count, kind.corners + single % count]
        ways = np.vstack([np.column_stack([end, middle]) for end in corners.T])
    meeting = np.bincount(ways.ravel(), minlength=len(coordinates))
    odd = np.flatnonzero((meeting != 0) & (meeting != 2))
    if len(odd):
        raise StructureError(
            f"the bore is not a whole cylinder: {meeting[odd[0]]} edges of a rim meet at node "
            f"{odd[0]}"
        )
    graph = summed(np.ones(len(ways)), ways[:, 0], ways[:, 1], (len(coordinates),) * 2)
    loops = []
    unvisited = set(corners.ravel().tolist())
    while unvisited:
        loops.append(csgraph.depth_first_order(graph, min(unvisited), False, False))
        unvisited -= set(loops[-1].tolist())
    return loops


def _edges(
    coordinates: np.ndarray, cells: np.ndarray, element: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Edges of a surface mesh.

    Returns
    -------
    ends
        End nodes of every edge of every cell, shape (cells edges, 2).
    first
        Row in `ends` of each distinct edge, shape (edges,).
    uses
        Number of cells of each distinct edge, shape (edges,).
    at_end
        Whether each distinct edge is at an end of the bore, shape (edges,).
    """
    ends = cells[:, ELEMENTS[element].edges].reshape(-1, 2)
    _, first, uses = np.unique(np.sort(ends, axis=1), axis=0, return_index=True, return_counts=True)
    z = coordinates[:, 2]
    heights = z[ends[first]]
    slack = END_TOLERANCE * np.ptp(z)
    at_end = (heights < z.min() + slack).all(axis=1) | (heights > z.max() - slack).all(axis=1)
    return ends, first, uses, at_end


#: Gauss points in each direction for load matrices, whose integrands are polynomials of degree 7 in
#: each variable with 9 nodes, and of degree 6 with 6 nodes: the rule is exact.
_LOAD_POINTS = 4

#: Gauss points in each direction for areas, which are no polynomials: enough for a cell bent by 30
#: degrees.
_AREA_POINTS = 8

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
        The orientation of a face does not matter: the force points away from the axis.
    element
        A key of `elements.ELEMENTS`: ``"serendipity"`` (8 nodes), ``"lagrange"``
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
    nodes, faces, kind = _checked(nodes, faces, element)
    numbers, cells = _ordered(nodes, faces)
    values, normals = _normals(nodes, faces, kind)
    blocks = np.einsum("cqd,qi,qj->cidj", normals, values, values)
    rows = (3 * faces[:, :, None] + np.arange(3))[..., None]
    return summed(blocks, rows, cells[:, None, None, :], (3 * len(nodes), len(numbers)))


def bore_from_faces(
    nodes: np.ndarray, faces: np.ndarray, element: str, centre: tuple = (0.0, 0.0, 0.0)
) -> Bore:
    """The bore of a part from the faces of its surface.

    Parameters
    ----------
    nodes, faces, element
        See `bore_load_matrix`. Pressures have the nodes and shape functions of the faces.
    centre
        Centre of the bore [m].

    Returns
    -------
    Bore
        Nodes sorted by z, then angle, with `load` as SciPy matrix and `reference`. The family of
        linear triangles stays unknown: films have no such elements.

    Raises
    ------
    StructureError
        The faces are not a complete cylinder along z, centred at the centre.
    """
    nodes, faces, _ = _checked(nodes, faces, element, np.asarray(centre, dtype=float))
    numbers, cells = _ordered(nodes, faces)
    x = nodes[numbers]
    load = bore_load_matrix(nodes, faces, element)
    radius = require_cylinder(x, cells, element, numbers)
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
        A key of `elements.ELEMENTS`.

    Returns
    -------
    scipy.sparse.csr_matrix
        shape (m, m) [m^2].
    """
    kind = surface_element(element, np.asarray(cells))
    values, normals = _area_vectors(coordinates, cells, kind, _AREA_POINTS)
    blocks = np.einsum("cq,qi,qj->cij", np.linalg.norm(normals, axis=2), values, values)
    return summed(blocks, cells[:, :, None], cells[:, None, :], (len(coordinates),) * 2)


def _checked(
    nodes: np.ndarray, faces: np.ndarray, element: str, centre: np.ndarray | float = 0.0
) -> tuple[np.ndarray, np.ndarray, NodalElement]:
    """Nodes relative to the centre, faces in the package's order of nodes, and their element."""
    nodes = np.asarray(nodes, dtype=float)
    faces = np.asarray(faces)
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
    """Nodes of faces, shape (c, k, 3), on the unrolled cylinder, shape (c, k, 2) [m]."""
    angle = np.arctan2(x[:, :, 1], x[:, :, 0])
    middle = x.mean(axis=1, keepdims=True)
    angle = np.mod(angle - np.arctan2(middle[:, :, 1], middle[:, :, 0]) + np.pi, 2 * np.pi)
    return np.stack([np.linalg.norm(x[:, :, :2], axis=2).mean() * angle, x[:, :, 2]], axis=2)


def in_order(
    numbers: np.ndarray, x: np.ndarray, faces: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Order of a bore's nodes by z, then angle, and the faces in positions of that order.

    Parameters
    ----------
    numbers, x
        Numbers of the nodes, shape (m,), and positions relative to the bore's centre, shape
        (m, 3) [m].
    faces
        Numbers of the nodes of each face, shape (c, k).
    """
    radius = np.linalg.norm(x[:, :2], axis=1).mean()
    angle = np.mod(np.arctan2(x[:, 1], x[:, 0]) + 1e-9, 2 * np.pi)
    order = np.lexsort((np.round(angle, 6), np.round(x[:, 2] / radius, 6)))
    by_number = np.argsort(numbers[order])
    return order, by_number[np.searchsorted(numbers[order], faces, sorter=by_number)]


def _ordered(nodes: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of the faces by z, then angle, and the faces in positions of that order."""
    numbers = np.unique(faces)
    order, cells = in_order(numbers, nodes[numbers], faces)
    return numbers[order], cells


def _area_vectors(
    nodes: np.ndarray, faces: np.ndarray, kind: NodalElement, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions at the Gauss points, shape (q, k), and normals times area, (c, q, 3)."""
    points, weights = kind.rule(count)
    values, derivatives = kind.tabulate(points)
    along, across = np.einsum("dqk,ckx->dcqx", derivatives, nodes[faces])
    return values, np.cross(along, across) * weights[:, None]


def _normals(
    nodes: np.ndarray, faces: np.ndarray, kind: NodalElement
) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions and normals of `_area_vectors`, all pointing away from the z axis."""
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


def require_cylinder(
    x: np.ndarray, cells: np.ndarray, element: str, numbers: np.ndarray, name: str = "the bore"
) -> float:
    """Radius of a bore's nodes about the z axis [m].

    Parameters
    ----------
    x, cells, element
        Nodes, shape (m, 3) [m], and their surface mesh.
    numbers, name
        Numbers of the nodes and name of the bore, for messages.

    Raises
    ------
    StructureError
        The nodes are not a complete cylinder, apart from holes, centred at z = 0.
    """
    radii = np.linalg.norm(x[:, :2], axis=1)
    radius = float(radii.mean())
    worst = int(np.argmax(np.abs(radii - radius)))
    if not abs(radii[worst] - radius) <= CYLINDER_TOLERANCE * radius:
        raise StructureError(
            f"{name} is not a cylinder about the z axis: node {numbers[worst]} lies "
            f"{radii[worst] - radius:.1e} m off the mean radius {radius:.6g} m, above "
            f"{CYLINDER_TOLERANCE:.0e} radii; midpoints of edges must lie on it too"
        )
    middle = 0.5 * (x[:, 2].min() + x[:, 2].max())
    if not abs(middle) <= CYLINDER_TOLERANCE * radius:
        raise StructureError(
            f"{name} must be centred at z = 0, its middle is at z = {middle:.3e} m"
        )
    ends, first, uses, at_end = _edges(x, cells, element)
    # Every edge has two faces, those of the two ends and of holes have one.
    wrong = np.flatnonzero(uses != np.where(at_end, 1, 2))
    if len(wrong) >= FEWEST_EDGES and (uses[wrong] == 1).all():
        bore_holes(x, cells, element)  # refuses gaps that are no holes
    elif len(wrong):
        one, other = numbers[ends[first[wrong[0]]]]
        raise StructureError(
            f"{name} is not a whole cylinder: the edge of nodes {one} and {other} belongs to "
            f"{uses[wrong[0]]} faces, not {1 if at_end[wrong[0]] else 2}"
        )
    return radius
