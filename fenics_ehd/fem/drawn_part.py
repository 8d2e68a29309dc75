"""Drawings and meshes with named faces, converted to part models for scenes.

The part is moved to its own frame, nodes of bores are projected onto cylinders, and surfaces get
their names.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import meshio
import numpy as np

from fenics_ehd.base.errors import MeshError, SettingsError
from fenics_ehd.base.renamed import renamed_attributes
from fenics_ehd.base.units import in_unit
from fenics_ehd.fem.drawing import CellSizes, Drawing, read_drawing
from fenics_ehd.fem.drawing_unit import IGES, STEP
from fenics_ehd.fem.faces import (
    COARSE_CELLS,
    SHARP,
    Cylinder,
    Face,
    find_faces,
    fit_cylinder,
    rounded_middles,
    split_cylinders,
)
from fenics_ehd.fem.foreign_mesh import FileMaterial
from fenics_ehd.fem.solid import (
    FACES,
    Solid,
    facet_corners,
    first_order,
    inside_out,
    refined,
    second_order,
    straight,
)
from fenics_ehd.fem.solid_file import read_part

#: Largest distance of a cell's corner on a bore from the fitted cylinder, relative to the radius.
PROJECTED = 1e-3

#: Distances below this, relative to the radius, count as rounding error of the file: of nodes at
#: the ends of a bore from planes, of its middle from z = 0. A file with steps of 0.1 um has 1e-5 at
#: a radius of 12 mm.
FLAT = 1e-4

#: Names in meshio of cells of 10 and 27 nodes, and of their facets.
_NAMES = {"tet": ("tetra10", "triangle6"), "hex": ("hexahedron27", "quad9")}

#: VTK's order of the faces of a hexahedron, low x, high x, low y and so on, as indices of `FACES`.
_VTK_FACES = [2, 3, 1, 4, 0, 5]


@dataclass(frozen=True, eq=False)
class Placement:
    """Rigid motion ``turn @ (x - origin)`` of a part into a frame with its first bore along z."""

    origin: np.ndarray
    turn: np.ndarray

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Transform points, shape (n, 3) [m], from the frame of the file to that of the part."""
        return (points - self.origin) @ self.turn.T

    def back(self, points: np.ndarray) -> np.ndarray:
        """Transform points, shape (n, 3) [m], from the frame of the part to that of the file."""
        return points @ self.turn + self.origin


def placement(bore: Cylinder, towards: np.ndarray | None) -> Placement:
    """Placement with the bore's axis along z, its centre at the origin, the x axis towards a point.

    Parameters
    ----------
    bore
        First bore of the part.
    towards
        Point of the file in the direction of the positive x axis, shape (3,) [m]. If it is None, x
        is the axis of the file that is most nearly perpendicular to the bore's axis, projected onto
        the plane perpendicular to it.
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
    points: np.ndarray, facets: np.ndarray, name: str, *, first: bool
) -> tuple[np.ndarray, float]:
    """Move the nodes of a bore onto its cylinder.

    Mid-side nodes, if there are any, follow the corners, see `rounded_middles`. Nodes within
    `FLAT` radii of an end of the bore are put on a plane there. Corners of quadrilaterals whose
    angles or heights differ by less than `FLAT` get equal angles or heights.

    Parameters
    ----------
    points
        Nodes of the part in its frame, shape (n, 3) [m].
    facets
        Facets of the bore: corners, then mid-side nodes of second-order cells.
    name
        Name of the bore.
    first
        Whether this is the first bore of the part, whose axis passes through the origin.

    Returns
    -------
    points : numpy.ndarray
        All nodes of the part with those of the bore moved, shape (n, 3) [m].
    moved : float
        Largest distance of a corner from the cylinder before the nodes are moved [m].

    Raises
    ------
    MeshError
        A corner is farther from the cylinder than `PROJECTED` radii.
    """
    sides = facet_corners(facets)
    count = sides.shape[1]
    corners = np.unique(sides)
    x = points[corners]
    cylinder = fit_cylinder(x, np.column_stack([x[:, :2], np.zeros(len(x))]))
    centre = np.zeros(3) if first else cylinder.centre * [1.0, 1.0, 0.0]
    new = points.copy()
    reach = np.linalg.norm((points[corners] - centre)[:, :2], axis=1)
    new[corners, :2] = centre[:2] + (x - centre)[:, :2] * (cylinder.radius / reach)[:, None]
    low = x[:, 2].min()
    high = x[:, 2].max()
    near = FLAT * cylinder.radius
    # A middle within rounding error of z = 0 is put exactly there.
    offset = 0.5 * (low + high) if abs(low + high) < near else 0.0
    for end in (low, high):
        new[corners[np.abs(x[:, 2] - end) < near], 2] = end - offset
    if count == 4:
        # Films need parallelograms in the unwrapped bore, which rounding errors of nodes spoil.
        new[corners] = _lined_up(new[corners] - centre, cylinder.radius) + centre
    if facets.shape[1] > count:
        new[facets[:, count:]] = rounded_middles(new[sides] - centre) + centre
    # Displacements along the bore do not count: they leave the bore round.
    moved = float(np.abs(reach - cylinder.radius).max())
    if moved > PROJECTED * cylinder.radius:
        raise MeshError(
            f"{name}: a node lies {moved:.2e} m off the cylinder of radius {cylinder.radius:g} m, "
            f"above the limit of {PROJECTED:g} radii: choose a face that is round"
        )
    return new, moved


def _lined_up(x: np.ndarray, radius: float) -> np.ndarray:
    """Make nearly equal angles, and nearly equal heights, of points on a cylinder exactly equal.

    The axis of the cylinder is z.
    """
    angle = np.arctan2(x[:, 1], x[:, 0])
    ordered = np.sort(angle)
    gaps = np.diff(ordered, append=ordered[0] + 2 * np.pi)
    start = ordered[np.argmax(gaps)] + 0.5 * gaps.max()  # in the middle of the largest gap
    angle = _levels(np.mod(angle - start, 2 * np.pi), FLAT) + start
    z = _levels(x[:, 2], FLAT * radius)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


def _levels(values: np.ndarray, near: float) -> np.ndarray:
    """Replace each chain of values less than `near` apart by its mean; values have shape (n,)."""
    order = np.argsort(values)
    first = np.diff(values[order], prepend=-np.inf) > near
    level = np.empty(len(values), dtype=np.int64)
    level[order] = np.cumsum(first) - 1
    lowest = values[order][first]
    return (lowest + np.bincount(level, values - lowest[level]) / np.bincount(level))[level]


def write_part(path: Path, solid: Solid, surfaces: Mapping[str, np.ndarray]) -> None:
    """Write a ``.msh`` file of a solid as the physical volume ``part``, with named surfaces.

    Parameters
    ----------
    path
        Path of the file to be written.
    solid
        Solid in the part's frame.
    surfaces
        Facets of each surface by its name, in the node order of `Solid.facets`.
    """
    points = solid.points
    cells = solid.cells
    facets = surfaces
    if solid.kind == "hex":
        points, cells, facets = _with_centres(solid, surfaces)
    cell, facet = _NAMES[solid.kind]
    blocks = [(cell, cells.astype(np.int32))]
    blocks += [(facet, nodes.astype(np.int32)) for nodes in facets.values()]
    groups = [np.full(len(nodes), i, dtype=np.int32) for i, (_, nodes) in enumerate(blocks, 1)]
    names = {"part": np.array([1, 3])}
    names |= {name: np.array([i, 2]) for i, name in enumerate(facets, 2)}
    data = {"gmsh:physical": groups, "gmsh:geometrical": groups}
    mesh = meshio.Mesh(points, blocks, cell_data=data, field_data=names)
    mesh.write(path, file_format="gmsh22")


def _with_centres(
    solid: Solid, surfaces: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Convert 20-node hexahedra to 27-node cells and 9-node facets, with nodes in VTK's order.

    Nodes at the centres of cells and faces are interpolated from the other nodes, so that the shape
    of the solid is unchanged.
    """
    element = solid.element
    n = len(solid.points)
    faces = np.array(FACES["hex"])[_VTK_FACES]
    references = np.vstack([element.nodes[faces].mean(axis=1), np.full(3, 0.5)])
    made = element.shapes(references) @ solid.points[solid.cells]
    corners = np.sort(solid.cells[:, faces].reshape(-1, 4), axis=1)
    _, first, numbers = np.unique(corners, axis=0, return_index=True, return_inverse=True)
    cell_centres = n + len(first) + np.arange(len(made))[:, None]
    full = np.hstack([solid.cells, n + numbers.reshape(-1, 6), cell_centres])
    centre_of = {tuple(row): n + i for i, row in enumerate(corners[first])}
    named = {
        name: np.hstack([nodes, [[centre_of[tuple(sorted(row[:4]))]] for row in nodes]])
        for name, nodes in surfaces.items()
    }
    middles = made[:, :6].reshape(-1, 3)[first]
    return np.vstack([solid.points, middles, made[:, 6]]), full, named


#: Default number of cells around the bores of a drawing.
AROUND = 40

#: Number of cells around cylinders without a name; the rim of an oil hole needs at least 6.
AROUND_OTHERS = 12

#: Cell size away from cylinders, relative to the part's longest side.
COARSE = 1 / 20

#: Largest relative difference between the radius of a face and the requested one.
RADIUS_MATCH = 1e-3

#: Largest inclination of a bore to the first bore [rad].
TILT = 1e-4


@dataclass(frozen=True, eq=False)
class OpenedPart:
    """A part as read from a file, with its faces numbered from 1.

    Attributes
    ----------
    path
        Path of the file.
    faces
        Faces, bores first.
    solid, facets
        Cells and facets of a mesh, in the file's order; None for a drawing, which is meshed once
        its faces have names.
    drawing
        Drawing; None for a mesh.
    left_out
        Description of the file's entities that do not belong to the solid; empty if none.
    materials
        Materials of the file's cells, see `ForeignPart`.
    notices
        Notices on the file for the user, a line each.
    """

    path: Path
    faces: Sequence[Face]
    solid: Solid | None = None
    facets: np.ndarray | None = None
    drawing: Drawing | None = None
    left_out: str = ""
    materials: Sequence[FileMaterial] = ()
    notices: Sequence[str] = ()

    @property
    def drawn(self) -> bool:
        """True if the file is a drawing, which can be meshed again with other cell sizes."""
        return self.drawing is not None

    def radius(self, number: int) -> float:
        """Radius of a cylindrical face [m]."""
        cylinder = self.faces[number - 1].cylinder
        assert cylinder is not None
        return cylinder.radius

    def face(self, wanted: str, kinds: Sequence[str] = ()) -> int:
        """Find a face by its number or by its radius with a unit, and return its number.

        Parameters
        ----------
        wanted
            Number, or radius such as ``22.5mm``.
        kinds
            Accepted kinds of faces; empty for all.

        Raises
        ------
        MeshError
            No face matches, several faces match, or the face is of another kind.
        """
        if re.fullmatch(r"[0-9]+", wanted):
            numbers = [int(wanted)] if 1 <= int(wanted) <= len(self.faces) else []
            known = f"1 to {len(self.faces)}"
        else:
            radius = _length(wanted)
            round_ones = [
                (number, face.cylinder.radius)
                for number, face in enumerate(self.faces, 1)
                if face.cylinder is not None and (not kinds or face.kind in kinds)
            ]
            numbers = [n for n, r in round_ones if abs(r - radius) <= RADIUS_MATCH * radius]
            known = ", ".join(f"{n} of {r * 1e3:.6g} mm" for n, r in round_ones) or "none"
        if len(numbers) != 1:
            which = f"faces {', '.join(map(str, numbers))} match" if numbers else "no face matches"
            raise MeshError(f"{self.path}: {which} {wanted!r}: give a face by its number: {known}")
        face = self.faces[numbers[0] - 1]
        if kinds and face.kind not in kinds:
            raise MeshError(
                f"{self.path}: face {numbers[0]} is a {face.kind}, not a {' or '.join(kinds)}"
            )
        return numbers[0]


def _length(text: str) -> float:
    try:
        return in_unit(text, "m")
    except SettingsError:
        raise MeshError(
            f"face {text!r}: give its number, or its radius with a unit: 22.5mm"
        ) from None


def open_part(
    path: Path,
    unit: str | None = None,
    sharp: float = SHARP,
    *,
    several_materials: bool = False,
) -> OpenedPart:
    """Read a drawing or a mesh and find its faces.

    Parameters
    ----------
    path
        STEP or IGES file, or any mesh that meshio reads.
    unit
        Unit of length; None: metres for a mesh, the declared unit for a drawing.
    sharp
        Angle between facets at which a face of a mesh ends [degrees].
    several_materials
        Accept cells of several materials, see `read_mesh`.

    Raises
    ------
    MeshError
        See `read_mesh` and `read_drawing`.
    """
    if not 1.0 <= sharp <= 90.0:
        raise MeshError(f"--angle {sharp:g} degrees must be 1 to 90")
    if not path.is_file():
        raise MeshError(f"part {str(path)!r}: there is no such file")
    if path.suffix.lower() in STEP + IGES:
        drawing = read_drawing(path, unit)
        return OpenedPart(path, drawing.faces, drawing=drawing, notices=drawing.notices)
    part = read_part(path, unit or "m", several_materials=several_materials)
    # Mid-side nodes of straight edges lie off a curved face, so that only corners are fitted.
    fitted = first_order(part.solid) if straight(part.solid) else part.solid
    faces = find_faces(fitted, fitted.facets(), sharp=sharp)
    split = split_cylinders(fitted, fitted.facets(), faces, sharp)
    facets = part.solid.facets()
    return OpenedPart(
        path,
        faces,
        part.solid,
        facets,
        None,
        part.left_out,
        part.materials,
        _angle_hint(path, split),
    )


def _angle_hint(path: Path, split: Sequence[Face]) -> list[str]:
    """Notice about cylinders that coarse cells divide into pieces; empty without such cylinders."""
    radii = sorted({f"{f.cylinder.radius * 1e3:.4g}" for f in split if f.cylinder is not None})
    if not radii:
        return []
    return [
        f"{path}: cylinders of radius {', '.join(radii)} mm are in pieces, whose cells turn by up "
        f"to {COARSE_CELLS:g} degrees: give --angle {COARSE_CELLS:g}"
    ]


@dataclass(frozen=True, eq=False)
class NamedFaces:
    """Numbers of the faces that make up each surface of a part.

    Attributes
    ----------
    bores, points
        Number of the face of each bore and boundary point, by name. The centre of the first bore is
        the origin of the part's frame; the first boundary point lies in the direction of x.
    held
        Numbers of the faces that form the surface ``held``; empty without this surface.
    """

    bores: Mapping[str, int]
    points: Mapping[str, int]
    held: Sequence[int] = ()

    def all(self) -> dict[str, Sequence[int]]:
        """Numbers of the faces of every surface, by the name of the surface."""
        single = {name: (face,) for name, face in {**self.bores, **self.points}.items()}
        return single | ({"held": tuple(self.held)} if self.held else {})


def bore_sizes(
    drawing: Drawing, named: NamedFaces, around: float, coarser: float = 1.0
) -> CellSizes:
    """Cell sizes of a drawing, which grow with the distance from its cylinders.

    Parameters
    ----------
    drawing, named
        Drawing, and the faces with names.
    around
        Number of cells around each bore. Cylinders of boundary points have half as many cells,
        all other cylinders `AROUND_OTHERS`.
    coarser
        Factor by which all cell sizes are multiplied.
    """
    cells = dict.fromkeys(range(1, len(drawing.faces) + 1), float(AROUND_OTHERS))
    cells |= dict.fromkeys(named.points.values(), around / 2)
    cells |= dict.fromkeys(named.bores.values(), around)
    sized = [
        (face.cylinder, cells[number])
        for number, face in enumerate(drawing.faces, 1)
        if face.cylinder is not None
    ]
    return CellSizes(sized, COARSE * float(drawing.extent.max()), coarser)


@renamed_attributes(place="placement")
@dataclass(frozen=True, eq=False)
class PlacedPart:
    """A part in its own frame.

    Attributes
    ----------
    solid, facets
        Solid and the facets of its surface, in the file's order of nodes; positions [m] are in the
        part's frame, whose z axis is the axis of the first bore.
    numbers
        Number of the face to which each facet belongs, shape (f,).
    named
        Faces that make up each surface.
    moved
        Largest displacement of the nodes of each bore onto its cylinder [m].
    placement
        Rigid motion from the file's frame to that of the part, for nodes and for matrices.
    cylinders
        Cylinders in the file's frame, fitted before nodes were moved, by the number of the face.
    straight
        Whether all edges of the file's cells are straight.
    size
        Relative cell size of a drawing, see `MeshedDrawing`.
    """

    solid: Solid
    facets: np.ndarray
    numbers: np.ndarray
    named: NamedFaces
    moved: Mapping[str, float]
    placement: Placement
    cylinders: Mapping[int, Cylinder]
    straight: bool
    size: float = 1.0

    def surfaces(self) -> dict[str, np.ndarray]:
        """Facets of every surface, by the name of the surface."""
        return {
            name: self.facets[np.isin(self.numbers, faces)]
            for name, faces in self.named.all().items()
        }

    def quadratic(self) -> PlacedPart:
        """Convert the cells of the part to second-order cells with curved edges.

        Mid-side nodes of all cylindrical faces are put on the cylinders. If this turns a cell
        inside out, only the mid-side nodes of bores are put on cylinders. A part that has
        curved edges in the file is returned unchanged.

        Raises
        ------
        MeshError
            A curved edge of a bore turns a cell inside out.
        """
        if not self.straight:
            return self
        solid = second_order(self.solid)
        part = replace(self, solid=solid, facets=solid.facets())
        rounded = replace(solid, points=part._on_cylinders())
        try:
            return _rounded(replace(part, solid=rounded))
        except MeshError:
            return _rounded(part)

    def _on_cylinders(self) -> np.ndarray:
        """Positions of all nodes after mid-side nodes of cylindrical faces are put on cylinders.

        The shape is (n, 3) [m].
        """
        points = self.solid.points.copy()
        for number, cylinder in self.cylinders.items():
            frame = placement(cylinder, None)
            facets = self.facets[self.numbers == number]
            corners = facet_corners(facets)
            # Cylinders are in the file's frame.
            middles = rounded_middles(frame(self.placement.back(self.solid.points[corners])))
            points[facets[:, corners.shape[1] :]] = self.placement(frame.back(middles))
        return points

    def refined(self) -> PlacedPart:
        """Divide every cell into eight, and put the new nodes of bores on the cylinders."""
        solid, facets, numbers = refined(self.solid, self.facets, self.numbers)
        return _rounded(replace(self, solid=solid, facets=facets, numbers=numbers, moved={}))


def _rounded(part: PlacedPart) -> PlacedPart:
    """Move the nodes of all bores onto their cylinders; refuse cells that become inside out."""
    points = part.solid.points
    moved = dict(part.moved)
    surfaces = part.surfaces()
    for index, name in enumerate(part.named.bores):
        points, distance = round_bore(points, surfaces[name], name, first=index == 0)
        moved[name] = max(distance, moved.get(name, 0.0))
    solid = replace(part.solid, points=points)
    if wrong := int(inside_out(solid).sum()):
        raise MeshError(
            f"{', '.join(part.named.bores)}: {wrong} of {len(solid.cells)} cells are turned inside "
            "out by the curvature of the bore: mesh the part with more cells around it"
        )
    return replace(part, solid=solid, moved=moved)


def place_part(
    part: OpenedPart, named: NamedFaces, around: float = AROUND, coarser: float = 1.0
) -> PlacedPart:
    """Move a part into its own frame; a drawing is meshed before.

    Parameters
    ----------
    part, named
        Part, and its faces with names.
    around, coarser
        For a drawing: number of cells around each bore, and a factor by which all cell sizes are
        multiplied, see `bore_sizes`.

    Raises
    ------
    MeshError
        The part cannot be meshed, a bore is not round, or a bore is not parallel to the first.
    """
    faces = part.faces
    solid, facets, numbers, size = _meshed(part, named, around, coarser)
    first, *others = (faces[number - 1].cylinder for number in named.bores.values())
    assert first is not None
    for name, other in zip(list(named.bores)[1:], others, strict=True):
        tilt = np.linalg.norm(np.cross(first.axis, other.axis))  # type: ignore[union-attr]
        if tilt > TILT:
            raise MeshError(
                f"{name} is inclined by {tilt:.1e} rad to the first bore, above the limit of "
                f"{TILT:g} rad: all bores must be parallel"
            )
    towards = [faces[number - 1].centre for number in named.points.values()]
    position = placement(first, towards[0] if towards else None)
    solid = replace(solid, points=position(solid.points))
    round_ones = {n: face.cylinder for n, face in enumerate(faces, 1) if face.cylinder is not None}
    edges = straight(solid)
    return _rounded(
        PlacedPart(solid, facets, numbers, named, {}, position, round_ones, edges, size)
    )


def _meshed(
    part: OpenedPart, named: NamedFaces, around: float, coarser: float
) -> tuple[Solid, np.ndarray, np.ndarray, float]:
    """Solid of a part, its facets, the face number of each facet, and `PlacedPart.size`."""
    if part.drawing is not None:
        drawing = part.drawing
        mesh = drawing.mesh(bore_sizes(drawing, named, around, coarser))
        owner = {s: n for n, face in enumerate(drawing.faces, 1) for s in face.surfaces}
        numbers = np.array([owner[surface] for surface in mesh.surfaces.tolist()])
        return mesh.solid, mesh.solid.facets(), numbers, mesh.size
    assert part.solid is not None
    assert part.facets is not None
    numbers = np.zeros(len(part.facets), dtype=np.int64)
    for number, face in enumerate(part.faces, 1):
        numbers[face.facets] = number
    return part.solid, part.facets, numbers, 1.0
