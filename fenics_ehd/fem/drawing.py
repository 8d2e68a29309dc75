"""Drawings: the solid of a STEP or IGES file, its exact faces, and meshes of it.

OpenCASCADE converts every file to millimetres. The solid is kept as text in OpenCASCADE's format,
so that its faces have the same numbers when they are listed and when they are meshed. Whether a
face is a plane or a cylinder follows from exact points and normals of its surface, without a mesh.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from fenics_ehd.base.errors import MeshError
from fenics_ehd.fem.drawing_unit import unit_ratio
from fenics_ehd.fem.faces import (
    SHAPE_TOLERANCE,
    Cylinder,
    Face,
    axis_across,
    in_order,
    with_joined_cylinders,
)
from fenics_ehd.fem.gmsh_session import (
    TETRAHEDRON_10,
    TRIANGLE_6,
    by_itself,
    called,
    gmsh,
    nodes_of_cells,
    numbered_nodes,
    session,
)
from fenics_ehd.fem.solid import Solid, inside_out, require_extent, used

#: Length of OpenCASCADE's unit [m].
MILLIMETRE = 1e-3

#: Growth of the cell size per distance from a cylinder.
GROWTH = 0.35

#: Factors of the cell size that are tried in turn until no cell is inside out. The last mesh has
#: about eight times as many cells as the first.
TRIED_SIZES = (1.0, 0.8, 0.64, 0.512)

#: Largest number of inverted cells for which Gmsh optimises the mesh. This takes 1 to 17 s for 1 to
#: 3 cells, but more than a minute for 18, so that a mesh of smaller cells is faster.
FEW = 5

#: Gmsh's number of the algorithm for surface meshes that is tried if the default one fails.
DELAUNAY = 5

#: Tolerances for sewing surfaces that are tried in turn [mm]. Files with 7 digits need the second,
#: files of programs that model to 1 um the last.
SEWING = (1e-6, 1e-4, 1e-3)

#: Largest relative change of the volume when surfaces are merged. OpenCASCADE integrates the volume
#: of tori only to 1e-5.
SAME_VOLUME = 1e-4

#: Number of sampled points of a surface in each direction; neighbours are less than half a turn
#: apart.
SAMPLES = 9

#: Largest cosine of the angle between the normals of a cylinder and its axis.
ACROSS = 1e-2


@dataclass(frozen=True, eq=False)
class DrawnFace(Face):
    """A face of a drawing.

    Attributes
    ----------
    surfaces
        Numbers of the drawing's surfaces that make up the face.
    angle
        Angle around its axis that a cylindrical face covers [rad]; 0 for other faces.
    """

    surfaces: Sequence[int] = ()
    angle: float = 0.0

    @property
    def arc(self) -> float:
        """Fraction of the circumference that the face covers, holes included."""
        return self.angle / (2 * np.pi)


@dataclass(frozen=True, eq=False)
class CellSizes:
    """Cell size of a drawing as a function of the position.

    On every cylinder, the size follows from the number of cells around it. The size grows with the
    distance from the cylinders.

    Attributes
    ----------
    around
        Cylinders, each with the number of cells around its circumference.
    largest
        Largest cell size [m], before multiplication by `coarser`.
    coarser
        Factor by which all sizes are multiplied.
    """

    around: Sequence[tuple[Cylinder, float]]
    largest: float
    coarser: float = 1.0

    def __post_init__(self) -> None:
        cylinders = [cylinder for cylinder, _ in self.around]
        columns = {
            "centre": np.array([c.centre for c in cylinders]).reshape(-1, 3),
            "axis": np.array([c.axis for c in cylinders]).reshape(-1, 3),
            "radius": np.array([c.radius for c in cylinders]),
            "half_width": np.array([0.5 * c.width for c in cylinders]),
            "size": np.array([2 * np.pi * c.radius / count for c, count in self.around]),
        }
        # Arrays of all cylinders, as Gmsh calls `__call__` some hundred thousand times.
        object.__setattr__(self, "_columns", columns)

    def __call__(self, point: np.ndarray) -> float:
        """Cell size at a point [m]; the position has shape (3,) [m]."""
        columns: dict[str, np.ndarray] = self._columns  # type: ignore[attr-defined]
        from_centre = point - columns["centre"]
        height = np.einsum("ij,ij->i", from_centre, columns["axis"])
        square = np.einsum("ij,ij->i", from_centre, from_centre) - height**2
        radial = np.sqrt(np.maximum(square, 0.0)) - columns["radius"]
        beyond = np.maximum(np.abs(height) - columns["half_width"], 0.0)
        sizes = columns["size"] + GROWTH * np.hypot(radial, beyond)
        return self.coarser * min(self.largest, float(sizes.min(initial=np.inf)))


@dataclass(frozen=True, eq=False)
class MeshedDrawing:
    """A mesh of a drawing.

    Attributes
    ----------
    solid
        Second-order tetrahedra; node positions in [m].
    surfaces
        For each of the solid's `facets`, number of the drawing's surface on which it lies, shape
        (f,).
    size
        Ratio of the cell size to the requested one; below 1 if the part was meshed again more
        finely, because cells were inside out.
    """

    solid: Solid
    surfaces: np.ndarray
    size: float


@dataclass(frozen=True, eq=False)
class Drawing:
    """The solid of a STEP or IGES file.

    Attributes
    ----------
    path
        Path of the file.
    shape
        Solid as text in OpenCASCADE's format.
    scale
        Length unit of `shape` [m].
    extent
        Sides of the bounding box, shape (3,) [m].
    faces
        Faces of the solid in the order of their numbers.
    notices
        Notices about changes of the file's geometry, one line each.
    """

    path: Path
    shape: bytes
    scale: float
    extent: np.ndarray
    faces: Sequence[DrawnFace]
    notices: Sequence[str] = ()

    def mesh(self, sizes: CellSizes) -> MeshedDrawing:
        """Mesh the solid with second-order tetrahedra.

        If cells are inside out, the solid is meshed again with smaller cells.

        Raises
        ------
        MeshError
            If Gmsh cannot mesh the solid, or if cells are inside out with every factor of the
            cell size in `TRIED_SIZES`.
        """
        return called("mesh", _mesh, self.path, self.shape, self.scale, sizes)


def read_drawing(path: Path, unit: str | None = None) -> Drawing:
    """Read the only solid of a drawing; surfaces of the same plane or cylinder are merged.

    Parameters
    ----------
    path
        Path of a STEP or IGES file.
    unit
        Unit of length; None for the unit that the file declares.

    Raises
    ------
    MeshError
        If Gmsh cannot read the file, if it does not contain exactly one solid, or if its size
        shows that the unit is wrong.
    """
    scale = MILLIMETRE * (1.0 if unit is None else unit_ratio(path, unit))
    try:
        drawing = called("read", _read, path, scale, True)
    except MeshError:  # the file is wrong, or OpenCASCADE has crashed while it merged surfaces
        drawing = called("read", _read, path, scale, False)
    require_extent(drawing.extent, path)
    return drawing


# In another process


def _opened(path: Path, shape: bytes) -> int:
    """Load a solid from text in OpenCASCADE's format as the current model; return its number."""
    gmsh.clear()
    with TemporaryDirectory() as folder:
        file = Path(folder, "shape.brep")
        file.write_bytes(shape)
        gmsh.model.occ.importShapes(str(file))
    gmsh.model.occ.synchronize()
    volumes = gmsh.model.getEntities(3)
    if len(volumes) != 1:
        raise MeshError(
            f"{path}: Gmsh makes {len(volumes)} solids from one solid: export the part again"
        )
    return volumes[0][1]


def _text() -> bytes:
    """Text of the current model in OpenCASCADE's format."""
    with TemporaryDirectory() as folder:
        file = Path(folder, "shape.brep")
        gmsh.write(str(file))
        return file.read_bytes()


def _read(path: Path, scale: float, merge: bool) -> Drawing:
    """Read a drawing; its surfaces are merged if `merge` is true and if it is possible.

    Raises
    ------
    MeshError
        If the file does not contain exactly one solid.
    """
    notices = []
    with session(), by_itself(path) as alone:
        # Colours and names are not read: Gmsh 4.8 fails on those of some files.
        gmsh.option.setNumber("Geometry.OCCImportLabels", 0)
        gmsh.model.occ.importShapes(alone)
        gmsh.model.occ.synchronize()
        surfaces = len(gmsh.model.getEntities(2))
        if surfaces and not gmsh.model.getEntities(3):
            _sew(path)
            notices.append(f"{path}: {surfaces} surfaces that enclose a volume are sewn to a solid")
        volumes = gmsh.model.getEntities(3)
        if len(volumes) != 1:
            raise MeshError(
                f"{path} has {len(volumes)} solids, but must have one: export the part alone"
            )
        _keep(volumes[0][1])
        shape = _text()
        if merge:
            shape = _merged(path, shape) or shape
        extent, pieces = _listed(path, shape, scale)
    # OpenCASCADE does not merge all pieces of a cylinder: the others are joined here.
    faces = in_order(with_joined_cylinders(pieces, _joined))
    return Drawing(path, shape, scale, extent, faces, notices)


def _sew(path: Path) -> None:
    """Sew the surfaces of the current model to a solid.

    Raises
    ------
    MeshError
        If the surfaces do not enclose a volume.
    """
    surfaces = gmsh.model.getEntities(2)
    area = sum(gmsh.model.occ.getMass(*surface) for surface in surfaces)
    for tolerance in SEWING:
        gmsh.model.occ.healShapes([], tolerance, False, False, False, True, True)
        gmsh.model.occ.synchronize()
        if _encloses(area):
            return
    raise MeshError(
        f"{path} has no solid, and its {len(surfaces)} surfaces do not enclose a volume: export "
        "the part as a solid"
    )


def _encloses(area: float) -> bool:
    """Whether the current model is one closed solid, and its surfaces have a given total area."""
    volumes = gmsh.model.getEntities(3)
    if len(volumes) != 1 or gmsh.model.occ.getMass(*volumes[0]) <= 0:
        return False
    boundary = gmsh.model.getBoundary(volumes, combined=False, oriented=False)
    total = sum(gmsh.model.occ.getMass(*surface) for surface in boundary)
    free = gmsh.model.getBoundary(boundary, combined=True, oriented=False)
    return not free and abs(total - area) < SAME_VOLUME * area


def _keep(volume: int) -> None:
    """Remove all entities that do not belong to a solid: lines, loose surfaces, other solids."""
    parts = [(3, volume)]
    belonging = set(parts)
    for _ in range(3):
        parts = gmsh.model.getBoundary(parts, combined=False, oriented=False)
        belonging |= set(parts)
    for dimension in (3, 2, 1, 0):
        loose = [e for e in gmsh.model.occ.getEntities(dimension) if e not in belonging]
        gmsh.model.occ.remove(loose)
    gmsh.model.occ.synchronize()


def _merged(path: Path, shape: bytes) -> bytes | None:
    """Merge surfaces of a solid that are on the same plane or cylinder; return the solid as text.

    The result is None if no surfaces can be merged.
    """
    volume = _opened(path, shape)
    before = gmsh.model.occ.getMass(3, volume)
    count = len(gmsh.model.getBoundary([(3, volume)]))
    try:
        merged = _fused(volume)
    except Exception:  # Gmsh raises plain Exception: OpenCASCADE cannot do it
        return None
    change = abs(gmsh.model.occ.getMass(3, merged) - before)
    fewer = len(gmsh.model.getBoundary([(3, merged)])) < count
    if not fewer or change > SAME_VOLUME * abs(before):
        return None
    _keep(merged)
    return _text()


def _fused(volume: int) -> int:
    """Unite a solid with a distant box; return the number of the solid in the result.

    In a boolean union, OpenCASCADE merges surfaces of a solid that are on one plane or cylinder.
    """
    box = np.array(gmsh.model.getBoundingBox(3, volume)).reshape(2, 3)
    side = np.ptp(box, axis=0).max()
    tool = gmsh.model.occ.addBox(*(box[1] + side), *np.full(3, 0.1 * side))
    solids, _ = gmsh.model.occ.fuse([(3, volume)], [(3, tool)])
    gmsh.model.occ.synchronize()
    # Gmsh 4.8 also returns the two solids before the union, which have more surfaces.
    return min(
        (len(gmsh.model.getBoundary([solid])), solid[1])
        for solid in solids
        if gmsh.model.occ.getCenterOfMass(*solid)[0] < box[1, 0] + 0.5 * side
    )[1]


def _listed(path: Path, shape: bytes, scale: float) -> tuple[np.ndarray, list[DrawnFace]]:
    """Sides of the bounding box of a solid [m], and its surfaces as faces."""
    volume = _opened(path, shape)
    box = np.array(gmsh.model.getBoundingBox(3, volume)).reshape(2, 3)
    outward = np.sign(gmsh.model.occ.getMass(3, volume))
    surfaces = gmsh.model.getBoundary([(3, volume)], combined=False, oriented=False)
    tags = sorted({surface for _, surface in surfaces})
    return scale * np.ptp(box, axis=0), [_face(tag, outward, scale) for tag in tags]


def _face(tag: int, outward: float, scale: float) -> DrawnFace:
    """Make a face from a surface of the drawing: a plane, a cylinder or neither."""
    low, high = (np.array(bound) for bound in gmsh.model.getParametrizationBounds(2, tag))
    sides = [np.linspace(a, b, SAMPLES) for a, b in zip(low, high, strict=True)]
    corners = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).ravel()
    points = scale * np.array(gmsh.model.getValue(2, tag, corners)).reshape(-1, 3)
    normals = outward * np.array(gmsh.model.getNormal(tag, corners)).reshape(-1, 3)
    area = scale**2 * gmsh.model.occ.getMass(2, tag)
    centre = scale * np.array(gmsh.model.occ.getCenterOfMass(2, tag))
    length = np.linalg.norm(normals, axis=1)
    regular = np.isfinite(length) & (length > 0.5)  # not at the poles of a sphere
    mean = normals[regular].sum(axis=0)
    axis = mean / max(np.linalg.norm(mean), 1e-300)
    face = DrawnFace("other", np.empty(0, dtype=int), area, centre, axis, surfaces=(tag,))
    if not regular.all() or not np.isfinite(points).all():
        return face
    size = np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    if np.abs(normals - axis).max() < SHAPE_TOLERANCE:
        return replace(face, kind="plane")
    return _cylindrical(face, points, normals, _edge_points(tag, scale), size)


def _edge_points(tag: int, scale: float) -> np.ndarray:
    """Points on the edges of a surface, shape (n, 3) [m]."""
    edges = gmsh.model.getBoundary([(2, tag)], combined=False, oriented=False)
    points = [np.empty((0, 3))]
    for edge in {number for _, number in edges}:
        low, high = gmsh.model.getParametrizationBounds(1, edge)
        values = gmsh.model.getValue(1, edge, np.linspace(low[0], high[0], 4 * SAMPLES))
        points.append(scale * np.array(values).reshape(-1, 3))
    return np.concatenate(points)


def _cylindrical(
    face: DrawnFace, points: np.ndarray, normals: np.ndarray, edges: np.ndarray, size: float
) -> DrawnFace:
    """Convert a face to a cylinder if its points and normals fit one, or return it unchanged.

    Points of a cylinder are ``x = c + r n + h a`` with a point c of the axis, the radius r, outward
    normals n, the height h and the axis a, which is perpendicular to all n. For a bore, r is
    negative.
    """
    axis, across = axis_across(normals)
    if np.abs(normals @ axis).max() > ACROSS:
        return face
    middle = points.mean(axis=0)
    plane = (points - middle) @ across.T
    directions = normals @ across.T
    ones = np.ones(len(points))
    zeros = np.zeros(len(points))
    rows = np.vstack(
        [
            np.column_stack([ones, zeros, directions[:, 0]]),
            np.column_stack([zeros, ones, directions[:, 1]]),
        ]
    )
    *centre, radius = np.linalg.lstsq(rows, plane.T.ravel(), rcond=None)[0]
    rays = plane - centre
    deviation = float(np.abs(np.linalg.norm(rays, axis=1) - abs(radius)).max())
    if deviation > SHAPE_TOLERANCE * min(size, abs(radius)) or abs(radius) > 10 * size:
        return face
    height = ((edges if len(edges) else points) - middle) @ axis
    on_axis = middle + centre @ across + 0.5 * (height.min() + height.max()) * axis
    cylinder = Cylinder(on_axis, axis, abs(float(radius)), float(np.ptp(height)), deviation)
    return replace(
        face,
        kind="bore" if radius < 0 else "shaft",
        centre=on_axis,
        axis=axis,
        cylinder=cylinder,
        angle=_covered_angle(rays),
    )


def _covered_angle(rays: np.ndarray) -> float:
    """Angle around the axis that a cylindrical face covers [rad], at most a full turn.

    `rays` are vectors from the axis to a grid of `SAMPLES` x `SAMPLES` points of the face.
    """
    grid = np.arctan2(rays[:, 1], rays[:, 0]).reshape(SAMPLES, SAMPLES)
    unwrapped = np.unwrap(np.unwrap(grid, axis=0), axis=1)
    return min(float(np.ptp(unwrapped)), 2 * np.pi)


def _joined(one: DrawnFace, other: DrawnFace) -> DrawnFace:
    """Join two pieces of a cylinder to one face."""
    a = one.cylinder
    b = other.cylinder
    assert a is not None
    assert b is not None
    height = float((b.centre - a.centre) @ a.axis)
    low = min(-0.5 * a.width, height - 0.5 * b.width)
    high = max(0.5 * a.width, height + 0.5 * b.width)
    centre = a.centre + 0.5 * (low + high) * a.axis
    deviation = max(a.deviation, b.deviation)
    return replace(
        one,
        area=one.area + other.area,
        centre=centre,
        cylinder=replace(a, centre=centre, width=high - low, deviation=deviation),
        surfaces=(*one.surfaces, *other.surfaces),
        angle=min(one.angle + other.angle, 2 * np.pi),
    )


def _mesh(path: Path, shape: bytes, scale: float, sizes: CellSizes) -> MeshedDrawing:
    """Mesh a solid with the size factors of `TRIED_SIZES` in turn until no cell is inside out.

    Raises
    ------
    MeshError
        If meshing fails, or cells are inside out, for every factor.
    """
    with session():
        _opened(path, shape)
        for name in ("FromPoints", "ExtendFromBoundary"):
            gmsh.option.setNumber(f"Mesh.MeshSize{name}", 0)
        for size in TRIED_SIZES:
            finer = replace(sizes, coarser=sizes.coarser * size)
            try:
                _generate(scale, finer)
                solid, wrong = _tetrahedra(scale)
                if 0 < wrong <= FEW:
                    gmsh.model.mesh.optimize("HighOrder")
                    solid, wrong = _tetrahedra(scale)
            except Exception:  # Gmsh raises plain Exception if facets intersect
                failure = "Gmsh cannot fill its surface with tetrahedra"
                gmsh.option.setNumber("Mesh.Algorithm", DELAUNAY)
                continue
            if not wrong:
                return MeshedDrawing(used(solid), _surfaces(solid), size)
            failure = f"{wrong} of {len(solid.cells)} cells are turned inside out"
        raise MeshError(
            f"{path}: {failure}, even with cells of {size:g} times the requested size: give more "
            "--cells-around, or export the part without its smallest faces"
        )


def _generate(scale: float, sizes: CellSizes) -> None:
    """Generate second-order tetrahedra in the current model."""

    def size_at(_d: int, _t: int, x: float, y: float, z: float, *_: float) -> float:
        return sizes(scale * np.array([x, y, z])) / scale

    gmsh.model.mesh.clear()
    gmsh.model.mesh.setSizeCallback(size_at)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)
    # Straight cells become curved if the curved facet of a neighbour would intersect them.
    gmsh.model.mesh.optimize("HighOrderFastCurving")


def _tetrahedra(scale: float) -> tuple[Solid, int]:
    """Solid of the tetrahedra in the current model, and the number of cells that are inside out.

    `scale` is the length unit of the model [m].
    """
    points, row = numbered_nodes()
    solid = Solid(scale * points, row[nodes_of_cells(TETRAHEDRON_10)], "tet")
    if not len(solid.cells):
        raise MeshError("Gmsh makes no tetrahedra")
    return solid, int(inside_out(solid).sum())


def _surfaces(solid: Solid) -> np.ndarray:
    """Number of the model's surface on which each facet of the solid lies, shape (facets,)."""
    _, row = numbered_nodes()
    owner: dict[tuple, int] = {}
    for _, entity in gmsh.model.getEntities(2):
        corners = np.sort(row[nodes_of_cells(TRIANGLE_6, entity)[:, :3]], axis=1)
        owner |= dict.fromkeys(map(tuple, corners.tolist()), entity)
    facets = np.sort(solid.facets()[:, :3], axis=1).tolist()
    return np.array([owner[tuple(corners)] for corners in facets])
