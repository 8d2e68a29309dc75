"""A solid from elsewhere as a model of a part: turned, its bores round, its surfaces named."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fenics_ehd.base.errors import MeshError
from fenics_ehd.base.interrupt import interrupt_kept
from fenics_ehd.base.whole_file import BLOCK, require_room
from fenics_ehd.fem.cylinder_fit import Cylinder, fit_cylinder
from fenics_ehd.fem.solid import CORNERS, FACES, GMSH_HEX, GMSH_TET, Solid

with interrupt_kept():
    import gmsh

#: Largest distance that a bore's node is moved onto the cylinder, relative to the radius: of
#: second-order cells or of the corners of first-order ones.
PROJECTED = 1e-3

#: Distance of a bore's ends from planes, and of its middle from z = 0, that is taken for rounding,
#: relative to the radius: 0.1 um at 12 mm is 1e-5.
FLAT = 1e-4

#: Gmsh's cells of 10 and 27 nodes with their facets, and its faces by their corners.
_GMSH = {"tet": (11, 9), "hex": (12, 10)}
_HEX_FACES = ((0, 3, 2, 1), (0, 1, 5, 4), (0, 4, 7, 3), (1, 2, 6, 5), (2, 3, 7, 6), (4, 5, 6, 7))


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a part comes to lie: ``turn @ (x - origin)``, the first bore about z."""

    origin: np.ndarray
    turn: np.ndarray

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Points of the file in the part's frame."""
        return (points - self.origin) @ self.turn.T


def placement(bore: Cylinder, towards: np.ndarray | None) -> Placement:
    """The bore's axis along z, its centre at the origin, x towards a point.

    Parameters
    ----------
    bore
        The first one.
    towards
        Point of the file on the positive x axis, (3,) [m]; None: x stays as it is, as nearly as
        may be.
    """
    z = bore.axis
    x = np.eye(3)[np.argmin(np.abs(z) - 1e-9 * np.array([2, 1, 0]))]
    if towards is not None:
        x = towards - bore.centre
        if np.linalg.norm(x - (x @ z) * z) < 1e-3 * bore.radius:
            raise MeshError("the first point lies on the bore's axis: it gives no direction of x")
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    return Placement(bore.centre, np.vstack([x, np.cross(z, x), z]))


def round_bore(
    points: np.ndarray, facets: np.ndarray, given: np.ndarray, name: str, *, first: bool
) -> tuple[np.ndarray, float]:
    """Points with those of a bore along z put on its cylinder, and the largest move [m].

    Middles of facets' edges go half way in angle and height, the isoparametric bore is then the
    best quadratic one. Nodes at the ends within the same distance of a plane are put on it, and
    corners of quadrilaterals along one line of the bore or around it on that.

    Parameters
    ----------
    points
        Nodes of the part in its frame, shape (n, 3) [m].
    facets
        Of the bore, corners, then edges.
    given
        Which nodes the file has, as others were made on straight edges.
    name
        Of the bore.
    first
        Whether its centre is the origin.

    Raises
    ------
    MeshError
        A node has to be moved by more than `PROJECTED` radii.
    """
    count = facets.shape[1] // 2
    corners, nodes = np.unique(facets[:, :count]), np.unique(facets)
    x = points[corners]
    cylinder = fit_cylinder(x, np.column_stack([x[:, :2], np.zeros(len(x))]))
    centre = np.zeros(3) if first else cylinder.centre * [1.0, 1.0, 0.0]
    new = points.copy()
    reach = np.linalg.norm((points[corners] - centre)[:, :2], axis=1)
    new[corners, :2] = centre[:2] + (x - centre)[:, :2] * (cylinder.radius / reach)[:, None]
    low, high = x[:, 2].min(), x[:, 2].max()
    near = FLAT * cylinder.radius
    # In the middle, but for rounding: exactly there.
    offset = 0.5 * (low + high) if abs(low + high) < near else 0.0
    for end in (low, high):
        new[corners[np.abs(x[:, 2] - end) < near], 2] = end - offset
    if count == 4:
        # Rounded ones are no parallelograms, as films on them need.
        new[corners] = _lined_up(new[corners] - centre, cylinder.radius) + centre
    for side in range(count):
        a, b = new[facets[:, side]], new[facets[:, (side + 1) % count]]
        middle = 0.5 * (a + b) - centre
        length = np.linalg.norm(middle[:, :2], axis=1)
        middle[:, :2] *= (cylinder.radius / np.maximum(length, 1e-300))[:, None]
        new[facets[:, count + side]] = middle + centre
    known = nodes[given[nodes]]
    # Along the bore a middle may be moved far and do no harm.
    radial = np.linalg.norm((points[known] - centre)[:, :2], axis=1) - cylinder.radius
    moved = float(np.abs(radial).max())
    if moved > PROJECTED * cylinder.radius:
        raise MeshError(
            f"{name}: a node lies {moved:.2e} m off the cylinder of radius {cylinder.radius:g} m, "
            f"above {PROJECTED:g} radii: choose a face that is round"
        )
    return new, moved


def _lined_up(x: np.ndarray, radius: float) -> np.ndarray:
    """Points on a cylinder about z, equal angles and heights made exactly so."""
    angle = np.arctan2(x[:, 1], x[:, 0])
    ordered = np.sort(angle)
    gaps = np.diff(ordered, append=ordered[0] + 2 * np.pi)
    start = ordered[np.argmax(gaps)] + 0.5 * gaps.max()  # no line of nodes lies there
    angle = _levels(np.mod(angle - start, 2 * np.pi), FLAT) + start
    z = _levels(x[:, 2], FLAT * radius)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


def _levels(values: np.ndarray, near: float) -> np.ndarray:
    """Values (n,), those that lie within `near` of the next one replaced by their mean."""
    order = np.argsort(values)
    first = np.diff(values[order], prepend=-np.inf) > near
    level = np.empty(len(values), dtype=np.int64)
    level[order] = np.cumsum(first) - 1
    lowest = values[order][first]
    return (lowest + np.bincount(level, values - lowest[level]) / np.bincount(level))[level]


def write_part(path: Path, solid: Solid, surfaces: Mapping[str, np.ndarray]) -> None:
    """A ``.msh`` file of the solid as the physical volume ``part``, with named surfaces.

    Parameters
    ----------
    path
        To write.
    solid
        In the part's frame.
    surfaces
        Facets of each surface by its name, as `Solid.facets` gives them.
    """
    points, cells, facets = solid.points, solid.cells, dict(surfaces)
    if solid.kind == "hex":
        points, cells, facets = _with_centres(solid, facets)
    else:
        cells = cells[:, GMSH_TET]
    cell, facet = _GMSH[solid.kind]
    with interrupt_kept():
        gmsh.initialize([""], readConfigFiles=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.Binary", 1)
        gmsh.model.addDiscreteEntity(3, 1)
        gmsh.model.mesh.addNodes(3, 1, np.arange(1, len(points) + 1), points.ravel())
        gmsh.model.mesh.addElementsByType(1, cell, [], cells.ravel() + 1)
        gmsh.model.addPhysicalGroup(3, [1], 1)
        gmsh.model.setPhysicalName(3, 1, "part")
        for number, (name, nodes) in enumerate(facets.items(), 1):
            gmsh.model.addDiscreteEntity(2, number)
            gmsh.model.mesh.addElementsByType(number, facet, [], nodes.ravel() + 1)
            gmsh.model.addPhysicalGroup(2, [number], 1 + number)
            gmsh.model.setPhysicalName(2, 1 + number, name)
        gmsh.write(str(path))
        require_room(path, BLOCK)  # Gmsh does not tell when the disk was full
    finally:
        with interrupt_kept():
            gmsh.finalize()


def _with_centres(
    solid: Solid, surfaces: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Nodes, 27-node cells and 9-node facets of 20-node hexahedra, as Gmsh orders them.

    Centres are where the other nodes put them: the solid is the same.
    """
    cells, rows = solid.cells, solid.face_rows()
    faces = cells[:, rows].reshape(-1, 8)
    corners = np.sort(faces[:, :4], axis=1)
    _, first, numbers = np.unique(corners, axis=0, return_index=True, return_inverse=True)
    x = solid.points[faces[first]]
    middle = 0.5 * x[:, 4:].sum(axis=1) - 0.25 * x[:, :4].sum(axis=1)
    of_cell = solid.points[cells]
    inside = 0.25 * of_cell[:, CORNERS["hex"] :].sum(axis=1)
    inside -= 0.25 * of_cell[:, : CORNERS["hex"]].sum(axis=1)
    n = len(solid.points)
    centre = n + numbers.reshape(len(cells), 6)
    order = [next(i for i, f in enumerate(FACES["hex"]) if {*f} == {*g}) for g in _HEX_FACES]
    whole = n + len(middle) + np.arange(len(cells))[:, None]
    full = np.hstack([cells[:, GMSH_HEX], centre[:, order], whole])
    place = {tuple(row): n + i for i, row in enumerate(corners[first])}
    named = {
        name: np.hstack([nodes, [[place[tuple(sorted(row[:4]))]] for row in nodes]])
        for name, nodes in surfaces.items()
    }
    return np.vstack([solid.points, middle, inside]), full, named
