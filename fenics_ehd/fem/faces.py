"""Recognition of cylindrical and flat faces in the surface mesh of a solid.

Cylinders are fitted to nodes by least squares of the distances. Circles are fitted by a linear
system, because ``x^2 + y^2`` is linear in x and y on a circle.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from fenics_ehd.fem.solid import Solid, facet_corners


@dataclass(frozen=True, eq=False)
class Cylinder:
    """A cylinder of finite width.

    Attributes
    ----------
    centre
        Centre, half way along the axis, shape (3,) [m].
    axis
        Unit vector whose largest component is positive, shape (3,).
    radius, width
        Radius, and width along the axis [m].
    deviation
        Largest distance between the cylinder and the points to which it was fitted [m].
    """

    centre: np.ndarray
    axis: np.ndarray
    radius: float
    width: float
    deviation: float

    def split(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Axial and radial components of points relative to the centre [m].

        Axial components are heights, shape (n,); radial components are vectors, shape (n, 3).
        """
        x = points - self.centre
        height = x @ self.axis
        return height, x - np.outer(height, self.axis)

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Distance of points from the cylinder's surface, shape (n,) [m]."""
        height, across = self.split(points)
        beyond = np.maximum(np.abs(height) - 0.5 * self.width, 0.0)
        return np.hypot(np.linalg.norm(across, axis=1) - self.radius, beyond)


def fit_circle(plane: np.ndarray) -> tuple[np.ndarray, float]:
    """Fit a circle to points, shape (n, 2); return its centre, shape (2,), and its radius."""
    # On a circle, x^2 + y^2 is linear in x and y.
    rows = np.column_stack([2 * plane, np.ones(len(plane))])
    solution = np.linalg.lstsq(rows, np.sum(plane**2, axis=1), rcond=None)[0]
    return solution[:2], float(np.sqrt(max(solution[2] + solution[:2] @ solution[:2], 0.0)))


def cylinder_centre(x: np.ndarray) -> np.ndarray:
    """Centre, shape (3,), of a cylinder along z that is fitted to nodes, shape (m, 3) [m]."""
    middle = x.mean(axis=0)
    middle[:2] += fit_circle(x[:, :2] - x[:, :2].mean(axis=0))[0]
    middle[2] = 0.5 * (x[:, 2].min() + x[:, 2].max())
    return middle


def rounded_middles(corners: np.ndarray) -> np.ndarray:
    """Mid-side nodes of facets on a cylinder, half way in angle and height between the corners.

    With these nodes, quadratic cells approximate the bore best, and their edges are straight in the
    unwrapped plane, as the transfer between meshes assumes.

    Parameters
    ----------
    corners
        Positions of the c corners of each facet, in order around the facet, shape (f, c, 3) [m].
        The origin lies on the axis of the cylinder, and the axis is parallel to z.

    Returns
    -------
    numpy.ndarray
        Position of the node between each corner and the next one, shape (f, c, 3) [m].
    """
    following = np.roll(corners, -1, axis=1)
    middle = 0.5 * (corners + following)
    reach = [np.linalg.norm(end[..., :2], axis=2) for end in (corners, following, middle)]
    middle[..., :2] *= (0.5 * (reach[0] + reach[1]) / np.maximum(reach[2], 1e-300))[..., None]
    return middle


def axis_across(normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the axis that is most nearly perpendicular to k normals, shape (k, 3).

    Returns
    -------
    axis : numpy.ndarray
        Unit vector with a positive largest component, shape (3,).
    across : numpy.ndarray
        Two unit vectors perpendicular to the axis and to each other, shape (2, 3).
    """
    axis = np.linalg.svd(normals, full_matrices=False)[2][-1]
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
    return axis, np.linalg.svd(axis[None, :])[2][1:]


def fit_cylinder(points: np.ndarray, normals: np.ndarray) -> Cylinder:
    """Fit a cylinder to points by least squares; normals of the surface give the initial guess.

    Parameters
    ----------
    points
        Points on the surface, shape (n, 3) [m].
    normals
        Normals of any number of facets of the surface, shape (k, 3).
    """
    axis, across = axis_across(normals)
    middle = points.mean(axis=0)
    size = np.linalg.norm(points - middle, axis=1).max()
    x = (points - middle) / size
    foot, first_radius = fit_circle(x @ across.T)

    def off(unknowns: np.ndarray) -> np.ndarray:
        """Signed distances of the points from the cylinder that the unknowns describe [m].

        The unknowns are a point of the axis, the direction of the axis, and the radius.
        """
        start, along, radius = np.split(unknowns, [3, 6])
        return np.linalg.norm(np.cross(x - start, along), axis=1) / np.linalg.norm(along) - radius

    parameters = [*foot @ across, *axis, first_radius]
    best = least_squares(off, parameters, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    start = best[:3]
    direction = best[3:6] / np.linalg.norm(best[3:6])
    height = (x - start) @ direction
    centre = middle + size * (start + 0.5 * (height.min() + height.max()) * direction)
    deviation = size * np.abs(off(best)).max()
    return Cylinder(
        centre, direction, float(size * best[6]), float(size * np.ptp(height)), float(deviation)
    )


#: Largest distance of a node from the fitted cylinder or plane, relative to the size of the face.
#: Round-off in a file is far below it, the deviation of a cone or a chamfer far above.
SHAPE_TOLERANCE = 1e-3

#: Largest difference in position and radius of two pieces of one cylinder, relative to the radius.
SAME = 1e-4

#: Angle between normals of two facets above which they belong to different faces [degrees]. Normals
#: differ by 30 degrees in a bore with 12 cells around, by 45 degrees at a chamfer.
SHARP = 35.0

#: Value of `SHARP` that cylinders with only 8 first-order cells around need [degrees].
COARSE_CELLS = 50.0


@dataclass(frozen=True, eq=False)
class Face:
    """A face of a solid.

    Attributes
    ----------
    kind
        ``"bore"`` (a hollow cylinder), ``"shaft"`` (a full one), ``"plane"`` or ``"other"``.
    facets
        Numbers of the facets that make up the face.
    area
        Area of the face [m2].
    centre
        Centre of the cylinder; for other kinds, mean of the facets' centres, shape (3,) [m].
    axis
        Axis of the cylinder; for other kinds, mean outward normal, shape (3,).
    cylinder
        Fitted cylinder of a bore or a shaft; None for other kinds.
    """

    kind: str
    facets: np.ndarray
    area: float
    centre: np.ndarray
    axis: np.ndarray
    cylinder: Cylinder | None = None

    @property
    def arc(self) -> float:
        """Area of the face over that of a complete cylinder; below 1 for a bore with holes."""
        assert self.cylinder is not None
        return self.area / (2 * np.pi * self.cylinder.radius * self.cylinder.width)


F = TypeVar("F", bound=Face)


def find_faces(solid: Solid, facets: np.ndarray, *, sharp: float = SHARP) -> list[Face]:
    """Divide the surface of a solid at sharp edges into faces, sorted by `in_order`.

    Parameters
    ----------
    solid
        Solid with its nodes.
    facets
        Facets of the surface in the node order of `Solid.facets`. Cylinders and planes are fitted
        to all nodes of a facet.
    sharp
        Angle between the normals of two facets above which their common edge is sharp [degrees].
    """
    labels = _smooth_pieces(solid, facets, sharp)
    groups = [np.flatnonzero(labels == label) for label in np.unique(labels)]

    def both(one: Face, other: Face) -> Face:
        return _shaped(solid, facets, np.concatenate([one.facets, other.facets]))

    return in_order(with_joined_cylinders([_shaped(solid, facets, g) for g in groups], both))


def split_cylinders(
    solid: Solid, facets: np.ndarray, faces: Sequence[Face], sharp: float
) -> list[Face]:
    """Find cylinders that `find_faces` has divided into pieces because their cells are coarse.

    Parameters
    ----------
    solid, facets
        Solid and the facets of its surface.
    faces
        Faces from `find_faces` with the angle `sharp`.
    sharp
        Angle of sharp edges [degrees]. If it is at least `COARSE_CELLS`, the result is empty.
    """
    if sharp >= COARSE_CELLS:
        return []
    number = np.empty(len(facets), dtype=np.int64)
    for n, face in enumerate(faces):
        number[face.facets] = n
    labels = _smooth_pieces(solid, facets, COARSE_CELLS)
    groups = [np.flatnonzero(labels == label) for label in np.unique(labels)]
    shaped = [_shaped(solid, facets, g) for g in groups if len(np.unique(number[g])) > 1]
    return [face for face in shaped if face.cylinder is not None]


def in_order(faces: Sequence[F]) -> list[F]:
    """Sort faces: bores and shafts by falling radius, then planes and others by falling area."""
    order = {"bore": 0, "shaft": 1, "plane": 2, "other": 3}

    def place(face: Face) -> tuple[float, ...]:
        size = face.area if face.cylinder is None else face.cylinder.radius
        # Faces of equal size are sorted by their centres.
        return (order[face.kind], -float(f"{size:.4g}"), *np.round(face.centre, 6))

    return sorted(faces, key=place)


def _area_vectors(solid: Solid, facets: np.ndarray) -> np.ndarray:
    """Area vectors of facets: outward normals of the length of the facet's area, (f, 3) [m2]."""
    corners = solid.points[facet_corners(facets)]
    if corners.shape[1] == 3:
        return 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])


def _smooth_pieces(solid: Solid, facets: np.ndarray, sharp: float) -> np.ndarray:
    """Divide a surface at sharp edges into pieces; return the piece number of each facet, (f,)."""
    corners = facet_corners(facets)
    count = corners.shape[1]
    sides = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)
    edges = np.sort(sides.reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    edges = edges[order]
    owners = np.repeat(np.arange(len(facets)), count)[order]
    twins = np.flatnonzero((edges[1:] == edges[:-1]).all(axis=1))
    a = owners[twins]
    b = owners[twins + 1]
    vectors = _area_vectors(solid, facets)
    normals = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    smooth = np.einsum("ij,ij->i", normals[a], normals[b]) > np.cos(np.radians(sharp))
    a = a[smooth]
    b = b[smooth]
    graph = coo_matrix((np.ones(len(a)), (a, b)), shape=(len(facets), len(facets)))
    return connected_components(graph, directed=False)[1]


def _shaped(solid: Solid, facets: np.ndarray, group: np.ndarray) -> Face:
    """Make a face from a group of facets: a plane, a cylinder or neither."""
    nodes = np.unique(facets[group])
    x = solid.points[nodes]
    normal = _area_vectors(solid, facets[group])
    areas = np.linalg.norm(normal, axis=1)
    area = float(areas.sum())
    mean = normal.sum(axis=0)
    corners = solid.points[facet_corners(facets[group])].mean(axis=1)
    centre = areas @ corners / area
    size = np.linalg.norm(x - centre, axis=1).max()
    axis = mean / max(np.linalg.norm(mean), 1e-300)
    if np.linalg.norm(mean) > (1 - SHAPE_TOLERANCE) * area:
        if np.abs((x - centre) @ axis).max() < SHAPE_TOLERANCE * size:
            return Face("plane", group, area, centre, axis)
    if len(nodes) >= 6:
        cylinder = fit_cylinder(x, normal / areas[:, None])
        _, across = cylinder.split(corners)
        outward = np.einsum("ij,ij->i", across, normal)
        if (
            cylinder.deviation < SHAPE_TOLERANCE * min(size, cylinder.radius)
            and cylinder.radius < 10 * size
            and (np.all(outward < 0) or np.all(outward > 0))
        ):
            kind = "bore" if outward[0] < 0 else "shaft"
            return Face(kind, group, area, cylinder.centre, cylinder.axis, cylinder)
    return Face("other", group, area, centre, axis)


def with_joined_cylinders(faces: Sequence[F], both: Callable[[F, F], F]) -> list[F]:
    """Join adjacent pieces of one cylinder to one face; other faces are unchanged.

    Parameters
    ----------
    faces
        Faces of a solid.
    both
        Function that joins two pieces to one face.
    """
    joined: list[F] = []
    for face in faces:
        twin = next((i for i, other in enumerate(joined) if same_cylinder(face, other)), None)
        if twin is None:
            joined.append(face)
        else:
            joined[twin] = both(joined[twin], face)
    return joined


def same_cylinder(one: Face, other: Face) -> bool:
    """Whether two faces are adjacent pieces of one cylinder."""
    a = one.cylinder
    b = other.cylinder
    if a is None or b is None or one.kind != other.kind:
        return False
    height, across = b.split(a.centre[None, :])
    return bool(
        abs(a.radius - b.radius) < SAME * b.radius
        and abs(a.axis @ b.axis) > 1 - SAME**2
        and np.linalg.norm(across) < SAME * b.radius
        # Lands on both sides of a groove are not adjacent: they remain two faces.
        and abs(height[0]) < 0.25 * (a.width + b.width)
    )
