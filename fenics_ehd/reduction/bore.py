"""Lubricated bores of a part: cylinders along z with their surface meshes, and their mean motion.

If a part comes from another program, the load matrix (15) and the mean motion of its bores are
computed from the faces of its surface. The bore may have holes, such as oil passages: their rims,
positions and sizes are detected.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from fenics_ehd.base.described import Described
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
    """Displacements of unit translations and rotations about the origin, shape (3 nodes, 6)."""
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
    """Cross product ``e_axis x u`` at every node, for displacements u of shape (3 nodes, k)."""
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
    """Store the arrays of a dataclass in row-major order, as in files; `columns` is left out.

    The round-off of products depends on the order in memory. A body that is read from a file must
    give the same run, to the last bit, as the body that was stored. The part-size array `columns`
    is not stored in files.
    """
    for name, value in vars(record).items():
        if isinstance(value, np.ndarray) and name != "columns":
            object.__setattr__(record, name, np.ascontiguousarray(value))


#: Largest number of waves around a bore in the smooth pressures.
WAVES = 9

#: Number of Legendre polynomials along the bore; smooth pressures are products of a wave and one.
HEIGHTS = 3

#: Number of smooth pressures of a bore: a constant, sines and cosines, times the polynomials.
SMOOTH = (2 * WAVES + 1) * HEIGHTS

#: Numbers of quadratic cells around and along a bore; the mesh error is stored at their nodes.
SAMPLED = 40, 8

#: Number of nodes of the `SAMPLED` cells of one bore.
SAMPLED_NODES = 2 * SAMPLED[0] * (2 * SAMPLED[1] + 1)


def no_cells() -> np.ndarray:
    """Return an empty array of cells, for a bore whose surface mesh is unknown."""
    return np.zeros((0, 0), dtype=np.int64)


@dataclass(frozen=True, eq=False, kw_only=True)
class BoreSurface(Described):
    """Surface of a bore; positions of nodes are relative to the bore's centre.

    Attributes
    ----------
    radius, width
        Bore radius R2 and bearing width B [m]; the axis of the bore is parallel to z.
    coordinates
        Positions of the bore's nodes, shape (m, 3) [m].
    pressure_coordinates
        Positions of the pressure nodes, shape (k, 3) [m].
    cells, family
        Surface mesh of the displacement. `cells` has the row numbers in `coordinates` of the
        nodes of each cell, shape (c, 8, 9 or 6): corners, edge midpoints and centre, in dolfinx
        order. `family` is ``"serendipity"``, ``"lagrange"`` or ``"triangle"``. Both are empty if
        the mesh is unknown; a film whose mesh does not match the bore needs them.
    pressure_cells, pressure_family
        Surface mesh of the pressure, described as `cells` and `family`; row numbers are those of
        `pressure_coordinates`.
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
        """Copy only the attributes of a `BoreSurface`, not the further attributes of a `Bore`."""
        return BoreSurface(**{f.name: getattr(self, f.name) for f in fields(BoreSurface)})


@dataclass(frozen=True, eq=False, kw_only=True)
class Bore(BoreSurface):
    """Lubricated bore of a part: surface, node numbers, load matrix and mean motion.

    Attributes
    ----------
    nodes
        Global numbers of the bore's nodes, shape (m,), sorted by z, then angle; the same on every
        rank.
    load
        Load matrix J = M_ss of (15), shape (3 nodes of the part, k): nodal forces [N] due to unit
        nodal pressures [Pa], which push the bore outward. Its type is any that `as_matrix` accepts;
        in a `Structure`, it is a PETSc matrix with rows distributed as those of K.
    reference
        Weights of the mean motion at the bore's centre C2, shape (m, 3, 6), see `mean_motion`:
        ``sum_ic reference[i, c, k] u[i, c]`` is the mean translation [m] for k < 3, the mean
        rotation [rad] for k >= 3. Column k is also the set of nodal forces with the resultant of
        a unit force or moment at C2. None if unknown; M1 and M2 need the weights of the first
        bore.
    """

    nodes: np.ndarray
    load: PETSc.Mat
    reference: np.ndarray | None = None


def surface_layout(number: str, *, attribute: bool) -> dict[str, Value]:
    """Layout of a `BoreSurface` in a file.

    Parameters
    ----------
    number
        Kind of the floating-point values, see `fenics_ehd.base.layout.KINDS`.
    attribute
        True to store single values as attributes of the HDF5 group, not as datasets.
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
    """Return the only bore of a part; refuse another number of bores.

    Parameters
    ----------
    bores
        Bores of the part by name.
    of
        Noun for the part in messages, such as ``"body"``.

    Raises
    ------
    SettingsError
        If the part has no bore or several bores; the message lists their names.
    """
    if len(bores) == 1:
        return next(iter(bores.values()))
    if bores:
        raise SettingsError(f"the {of} has the bores {', '.join(bores)}: name one of them")
    raise SettingsError(f"the {of} has no bore: pressure loads need one")


def outward(nodes: np.ndarray, displacements: np.ndarray) -> np.ndarray:
    """Outward radial component, shape (m, n), of displacements of a bore's nodes, (m, 3, n)."""
    radial = nodes[:, :2] / np.linalg.norm(nodes[:, :2], axis=1)[:, None]
    return np.einsum("ic,icn->in", radial, displacements[:, :2])


def all_outward(bores: Mapping[str, BoreSurface], displacements: np.ndarray) -> np.ndarray:
    """Radial component of displacements of the nodes of all bores, each away from its bore's axis.

    `displacements` has the shape (m, 3, n), with the m nodes of all bores, one bore after the
    other; the result has the shape (m, n).
    """
    nodes = np.vstack([bore.coordinates for bore in bores.values()])
    return outward(nodes, displacements)


def mean_motion(coordinates: np.ndarray, weights: Any) -> np.ndarray:
    """Weights that give the mean rigid motion of a surface from its nodal displacements.

    The mean motion is the least-squares fit of ``a + b x r`` to the displacement u over the
    surface: the translation a and the rotation b minimise ``int |u - a - b x r|^2 dA``. On a
    surface centred at the origin, a is the area-weighted mean of u.

    Parameters
    ----------
    coordinates
        Positions r of the nodes, shape (m, 3) [m].
    weights
        Integrals ``int N_i N_j dA`` of the shape functions, shape (m, m) [m^2], an array or a
        SciPy sparse matrix; or lumped nodal areas, shape (m,) [m^2].

    Returns
    -------
    numpy.ndarray
        Weights of the nodal displacements, shape (m, 3, 6): for the three components of a, then
        for the three components of b, about the origin. For displacements of a rigid motion, the
        weighted sums are this motion. If column k is regarded as nodal forces, their resultant is
        a unit force (k < 3) or a unit moment (k >= 3) at the origin.

    Raises
    ------
    StructureError
        If the nodes lie on one line, so that their rotation about it is undefined.
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


#: Smallest number of edges of a hole's rim: fewer edges surround only one or two missing faces.
FEWEST_EDGES = 6

#: Largest distance of an edge at an end of the bore from that end, relative to the bore's width.
END_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class BoreHole(Described):
    """A hole in a bore.

    Attributes
    ----------
    rim
        Numbers of the r nodes around the hole, in order, midpoints of edges included.
    polygon
        Angle [rad] and height [m] of the rim's nodes, shape (r, 2); angles differ from the first
        angle by at most half a turn.
    angle, height
        Angle [rad] and height [m] of the hole's centroid.
    diameter
        Diameter [m] of the circle that has the hole's area on the unwrapped bore.
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
        """Area of the hole in the plane of angle and height [rad m]."""
        return abs(_moments(self.polygon)[0])

    def straight(self) -> BoreHole:
        """Copy the hole with straight edges, without the midpoints of the mesh's curved edges."""
        polygon = self.polygon.copy()
        closed = np.vstack([polygon[0::2], polygon[:1]])
        polygon[1::2] = 0.5 * (closed[:-1] + closed[1:])
        return replace(self, polygon=polygon)

    def contains(self, angle: np.ndarray, height: np.ndarray) -> np.ndarray:
        """Whether each point, given by angle [rad] and height [m], is within the rim."""
        x = self.angle + np.mod(angle - self.angle + np.pi, 2 * np.pi) - np.pi
        # A point is inside if a ray along the circumference crosses an odd number of edges.
        (a, low) = self.polygon.T
        (b, high) = np.roll(self.polygon, -1, axis=0).T
        x = x[..., None]
        z = np.asarray(height)[..., None]
        with np.errstate(divide="ignore", invalid="ignore"):
            beyond = x < a + (z - low) / (high - low) * (b - a)
        return np.sum(((low > z) != (high > z)) & beyond, axis=-1) % 2 == 1


def bore_holes(coordinates: np.ndarray, cells: np.ndarray, family: str) -> list[BoreHole]:
    """Find the holes of a bore's surface mesh, sorted by height, then angle.

    Parameters
    ----------
    coordinates
        Positions of the nodes about the bore's centre, shape (m, 3) [m].
    cells, family
        Surface mesh, see `BoreSurface`.

    Raises
    ------
    StructureError
        If a rim runs around the whole bore, meets another rim, or has fewer than `FEWEST_EDGES`
        edges.
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
                f"the bore is not a complete cylinder: a rim of {edges} edges "
                + (
                    "runs around the whole bore"
                    if turned
                    else f"is too short for a hole, which has at least {FEWEST_EDGES}"
                )
            )
        area, x, z = _moments(polygon)
        diameter = float(np.sqrt(4 * radius * abs(area) / np.pi))
        holes.append(BoreHole(rim, polygon, float(x), float(z), diameter, radius))
    return sorted(holes, key=lambda hole: (round(hole.height / radius, 6), hole.angle))


def _moments(polygon: np.ndarray) -> tuple[float, float, float]:
    """Signed area of a polygon and the two coordinates of its centroid."""
    first = polygon[0]
    a = polygon - first
    b = np.roll(polygon, -1, axis=0) - first
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    area = 0.5 * cross.sum()
    middle = first + ((a + b) * cross[:, None]).sum(axis=0) / (6 * area)
    return float(area), float(middle[0]), float(middle[1])


def _rims(coordinates: np.ndarray, cells: np.ndarray, family: str) -> list[np.ndarray]:
    """Indices of the nodes around every hole, in order along its rim.

    A rim consists of the edges that belong to one cell only and are not at an end of the bore.
    """
    kind = ELEMENTS[family]
    ends, first, uses, at_end = _edges(coordinates, cells, family)
    count = len(kind.edges)
    single = first[(uses == 1) & ~at_end]
    ways = corners = ends[single]
    if cells.shape[1] >= kind.corners + count:
        # In a cell, midpoints of edges follow the corners, in the order of the edges.
        middle = cells[single // count, kind.corners + single % count]
        ways = np.vstack([np.column_stack([end, middle]) for end in corners.T])
    meeting = np.bincount(ways.ravel(), minlength=len(coordinates))
    odd = np.flatnonzero((meeting != 0) & (meeting != 2))
    if len(odd):
        raise StructureError(
            f"the bore is not a complete cylinder: {meeting[odd[0]]} edges of a rim meet at node "
            f"{odd[0]}, not 2"
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
        Two end nodes of every edge of every cell, shape (cells x edges per cell, 2).
    first
        First row in `ends` of each distinct edge, shape (edges,).
    uses
        Number of cells that share each distinct edge, shape (edges,).
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


#: Number of Gauss points in each direction for load matrices. The rule is exact: the integrands are
#: polynomials of degree 7 in each variable for cells of 9 nodes, of degree 6 for cells of 6 nodes.
_LOAD_POINTS = 4

#: Number of Gauss points in each direction for areas, whose integrands are not polynomials: enough
#: for a cell that spans 30 degrees of the bore.
_AREA_POINTS = 8

#: Largest distance of a bore node from the fitted cylinder, relative to the bore's radius.
CYLINDER_TOLERANCE = 1e-6


def bore_load_matrix(nodes: np.ndarray, faces: np.ndarray, element: str) -> sparse.csr_matrix:
    """Load matrix J of (15): nodal forces due to nodal pressures, which push the bore outward.

    Parameters
    ----------
    nodes
        Positions of all nodes of the part, shape (n, 3) [m]; the bore's axis is z.
    faces
        Global numbers of the nodes of each face, shape (c, k). Either corners come first, then
        edge midpoints, then the centre, in any order within these groups; or corners and
        midpoints alternate. `package_order` detects the order. The orientation of a face does not
        matter: the force points away from the axis.
    element
        A key of `elements.ELEMENTS`: ``"serendipity"`` (8 nodes), ``"lagrange"``
        (9), ``"triangle"`` (6), ``"bilinear"`` (4) or ``"linear triangle"`` (3).

    Returns
    -------
    scipy.sparse.csr_matrix
        Load matrix, shape (3 n, m) [m^2]: entry (3 i + c, j) is the integral of ``N_i N_j n_c``,
        where the normal n points away from the axis. Columns are the nodes of the faces, sorted
        by z, then angle.

    Raises
    ------
    StructureError
        If the faces do not fit the element or the nodes, or if a face is folded.
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
    """Make the bore of a part from the faces of its surface.

    Parameters
    ----------
    nodes, faces, element
        See `bore_load_matrix`. The pressure has the nodes and shape functions of the faces.
    centre
        Centre of the bore, three coordinates [m].

    Returns
    -------
    Bore
        Bore with nodes sorted by z, then angle; `load` is a SciPy matrix. For linear triangles
        `family` is empty, as films have no such elements.

    Raises
    ------
    StructureError
        If the faces are not a complete cylinder along z about `centre`.
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
    """Integrals ``int N_i N_j dA`` of the shape functions over any surface.

    Parameters
    ----------
    coordinates
        Positions of the nodes, shape (m, 3) [m].
    cells
        Row numbers in `coordinates` of the nodes of each cell, shape (c, k), in the order of
        `bore_load_matrix`.
    element
        A key of `elements.ELEMENTS`.

    Returns
    -------
    scipy.sparse.csr_matrix
        Integrals, shape (m, m) [m^2].
    """
    kind = surface_element(element, np.asarray(cells))
    values, normals = _area_vectors(coordinates, cells, kind, _AREA_POINTS)
    blocks = np.einsum("cq,qi,qj->cij", np.linalg.norm(normals, axis=2), values, values)
    return summed(blocks, cells[:, :, None], cells[:, None, :], (len(coordinates),) * 2)


def _checked(
    nodes: np.ndarray, faces: np.ndarray, element: str, centre: np.ndarray | float = 0.0
) -> tuple[np.ndarray, np.ndarray, NodalElement]:
    """Check nodes and faces; return positions relative to the centre, sorted faces, the element."""
    nodes = np.asarray(nodes, dtype=float)
    faces = np.asarray(faces)
    kind = surface_element(element, faces)
    if nodes.ndim != 2 or nodes.shape[1] != 3:
        raise StructureError(f"nodes have shape {nodes.shape}, but (number of nodes, 3) is needed")
    if faces.dtype.kind not in "iu" or not 0 <= faces.min() <= faces.max() < len(nodes):
        raise StructureError(
            f"faces refer to nodes {faces.min()} to {faces.max()} (type {faces.dtype}), but nodes "
            f"are numbered 0 to {len(nodes) - 1} by integers"
        )
    ordered = np.sort(faces, axis=1)
    repeated = np.flatnonzero((ordered[:, 1:] == ordered[:, :-1]).any(axis=1))
    if len(repeated):
        raise StructureError(f"face {repeated[0]} has a node twice: {faces[repeated[0]]}")
    used = nodes[np.unique(faces)]
    if not np.isfinite(used).all():
        raise StructureError("a node of the faces has a coordinate that is not finite")
    nodes = nodes - centre
    faces = faces.astype(np.int64)
    return nodes, package_order(_unrolled(nodes[faces]), faces, element), kind


def _unrolled(x: np.ndarray) -> np.ndarray:
    """Map nodes of faces, shape (c, k, 3), to the unrolled cylinder, shape (c, k, 2) [m].

    Each face has its own zero of the circumferential coordinate, half a turn before its middle.
    """
    angle = np.arctan2(x[:, :, 1], x[:, :, 0])
    middle = x.mean(axis=1, keepdims=True)
    angle = np.mod(angle - np.arctan2(middle[:, :, 1], middle[:, :, 0]) + np.pi, 2 * np.pi)
    return np.stack([np.linalg.norm(x[:, :, :2], axis=2).mean() * angle, x[:, :, 2]], axis=2)


def in_order(
    numbers: np.ndarray, x: np.ndarray, faces: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Sort a bore's nodes by z, then angle, and renumber its faces.

    Parameters
    ----------
    numbers, x
        Numbers of the nodes, shape (m,), and positions relative to the bore's centre, shape
        (m, 3) [m].
    faces
        Numbers of the nodes of each face, shape (c, k).

    Returns
    -------
    tuple of numpy.ndarray
        Indices that sort `numbers` and `x`, shape (m,); and for each face the indices of its
        nodes in the sorted arrays, shape (c, k).
    """
    radius = np.linalg.norm(x[:, :2], axis=1).mean()
    angle = np.mod(np.arctan2(x[:, 1], x[:, 0]) + 1e-9, 2 * np.pi)
    order = np.lexsort((np.round(angle, 6), np.round(x[:, 2] / radius, 6)))
    by_number = np.argsort(numbers[order])
    return order, by_number[np.searchsorted(numbers[order], faces, sorter=by_number)]


def _ordered(nodes: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sort the nodes of faces by z, then angle; return their numbers, and the faces renumbered.

    A renumbered face has the indices of its nodes in the sorted array of numbers.
    """
    numbers = np.unique(faces)
    order, cells = in_order(numbers, nodes[numbers], faces)
    return numbers[order], cells


def _area_vectors(
    nodes: np.ndarray, faces: np.ndarray, kind: NodalElement, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions and area vectors at the Gauss points.

    Returns
    -------
    tuple of numpy.ndarray
        Values of the shape functions, shape (q, k), and normals of the surface times the area of
        each Gauss point, shape (c, q, 3) [m^2].
    """
    points, weights = kind.rule(count)
    values, derivatives = kind.tabulate(points)
    along, across = np.einsum("dqk,ckx->dcqx", derivatives, nodes[faces])
    return values, np.cross(along, across) * weights[:, None]


def _normals(
    nodes: np.ndarray, faces: np.ndarray, kind: NodalElement
) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions and area vectors, see `_area_vectors`; vectors point away from the z axis."""
    values, normals = _area_vectors(nodes, faces, kind, _LOAD_POINTS)
    x = values @ nodes[faces]
    outward = np.einsum("cqx,cqx->cq", normals[:, :, :2], x[:, :, :2])
    signs = np.sign(outward[:, :1])
    folded = np.flatnonzero((outward * signs <= 0).any(axis=1))
    if len(folded):
        raise StructureError(
            f"face {folded[0]} with nodes {faces[folded[0]]} is folded or does not face the z "
            "axis: its corners must come first, or corners and midpoints of edges must alternate"
        )
    return values, normals * signs[:, :, None]


def require_cylinder(
    x: np.ndarray, cells: np.ndarray, element: str, numbers: np.ndarray, name: str = "the bore"
) -> float:
    """Check that a bore is a cylinder about the z axis and return its radius [m].

    Parameters
    ----------
    x, cells, element
        Positions of the nodes, shape (m, 3) [m], and their surface mesh.
    numbers, name
        Numbers of the nodes and name of the bore, for messages.

    Raises
    ------
    StructureError
        If the nodes do not form a complete cylinder, apart from holes, or if it is not centred
        at z = 0.
    """
    radii = np.linalg.norm(x[:, :2], axis=1)
    radius = float(radii.mean())
    worst = int(np.argmax(np.abs(radii - radius)))
    if not abs(radii[worst] - radius) <= CYLINDER_TOLERANCE * radius:
        raise StructureError(
            f"{name} is not a cylinder about the z axis: node {numbers[worst]} lies "
            f"{radii[worst] - radius:.1e} m off the mean radius {radius:.6g} m, above "
            f"{CYLINDER_TOLERANCE:.0e} radii; midpoints of edges must lie on the cylinder too"
        )
    middle = 0.5 * (x[:, 2].min() + x[:, 2].max())
    if not abs(middle) <= CYLINDER_TOLERANCE * radius:
        raise StructureError(
            f"{name} must be centred at z = 0, but its middle is at z = {middle:.3e} m"
        )
    ends, first, uses, at_end = _edges(x, cells, element)
    # An edge belongs to two faces, but to one at an end of the bore and at the rim of a hole.
    wrong = np.flatnonzero(uses != np.where(at_end, 1, 2))
    if len(wrong) >= FEWEST_EDGES and (uses[wrong] == 1).all():
        bore_holes(x, cells, element)  # raises if a gap is not a hole
    elif len(wrong):
        one, other = numbers[ends[first[wrong[0]]]]
        raise StructureError(
            f"{name} is not a complete cylinder: the edge of nodes {one} and {other} belongs to "
            f"{uses[wrong[0]]} faces, not {1 if at_end[wrong[0]] else 2}"
        )
    return radius
