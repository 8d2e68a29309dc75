"""A drawing or a mesh with the faces that matter named, as a model that scenes take."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fenics_ehd.base.errors import MeshError, SettingsError
from fenics_ehd.base.units import in_unit
from fenics_ehd.fem.faces import SHARP, Face, find_faces
from fenics_ehd.fem.gmsh_session import COARSE, CellSizes, mesh_drawing
from fenics_ehd.fem.part_mesh import Placement, placement, round_bore, write_part
from fenics_ehd.fem.refine import refined
from fenics_ehd.fem.solid import CORNERS, Solid
from fenics_ehd.fem.solid_file import DRAWINGS, read_mesh

#: Cells around the bores of a drawing.
AROUND = 40

#: Cells around cylinders without a name: the rim of an oil hole needs 6.
AROUND_OTHERS = 12

#: Largest difference between a radius asked for and a face's, relative.
RADIUS_MATCH = 1e-3

#: Largest inclination of a bore to the first one [rad].
TILT = 1e-4


@dataclass(frozen=True, eq=False)
class OpenedPart:
    """A file with its faces, numbered from 1.

    Attributes
    ----------
    path, unit
        Of the file; drawings have their own unit.
    solid, facets, faces
        Coarsely meshed, if it is a drawing.
    labels
        The drawing's face of each facet, or None.
    """

    path: Path
    unit: str
    solid: Solid
    facets: np.ndarray
    faces: Sequence[Face]
    labels: np.ndarray | None

    @property
    def drawn(self) -> bool:
        """Whether it can be meshed more finely."""
        return self.labels is not None

    def radius(self, number: int) -> float:
        """Of a cylindrical face [m]."""
        cylinder = self.faces[number - 1].cylinder
        assert cylinder is not None
        return cylinder.radius

    def face(self, wanted: str, kinds: Sequence[str] = ()) -> int:
        """Number of a face asked for by its number, or by a radius with its unit, ``22.5mm``.

        Raises
        ------
        MeshError
            There is none, or more than one.
        """
        if re.fullmatch(r"\d+", wanted):
            found = [int(wanted)] if 1 <= int(wanted) <= len(self.faces) else []
            known = f"1 to {len(self.faces)}"
        else:
            radius = _length(wanted)
            round_ones = [
                (number, face.cylinder.radius)
                for number, face in enumerate(self.faces, 1)
                if face.cylinder is not None and (not kinds or face.kind in kinds)
            ]
            found = [n for n, r in round_ones if abs(r - radius) <= RADIUS_MATCH * radius]
            known = ", ".join(f"{n} of {r * 1e3:.6g} mm" for n, r in round_ones) or "none"
        if len(found) != 1:
            which = f"faces {', '.join(map(str, found))} are" if found else "no face is"
            raise MeshError(
                f"{self.path}: {which} {wanted!r}; there are {known}: name one by number"
            )
        face = self.faces[found[0] - 1]
        if kinds and face.kind not in kinds:
            raise MeshError(
                f"{self.path}: face {found[0]} is a {face.kind}, not a {' or '.join(kinds)}"
            )
        return found[0]


def _length(text: str) -> float:
    try:
        return in_unit(text, "m")
    except SettingsError:
        raise MeshError(
            f"face {text!r}: give its number, or its radius with a unit: 22.5mm"
        ) from None


def open_part(path: Path, unit: str = "m", sharp: float = SHARP) -> OpenedPart:
    """Read a drawing or a mesh and find its faces.

    Parameters
    ----------
    path
        STEP or IGES, or any mesh that meshio reads.
    unit
        Of a mesh.
    sharp
        Angle at which a face of a mesh ends [degrees].

    Raises
    ------
    MeshError
        See `read_mesh` and `mesh_drawing`.
    """
    if not 1.0 <= sharp <= 90.0:
        raise MeshError(f"--angle {sharp:g} degrees must be 1 to 90")
    if not path.is_file():
        raise MeshError(f"part {str(path)!r}: there is no such file")
    labels = None
    if path.suffix.lower() in DRAWINGS:
        solid, labels = mesh_drawing(path)
    else:
        solid = read_mesh(path, unit)
    facets = solid.facets()
    faces = find_faces(solid, facets, labels, sharp=sharp)
    return OpenedPart(path, unit, solid, facets, faces, labels)


@dataclass(frozen=True, eq=False)
class NamedFaces:
    """Numbers of the faces that a part's surfaces are made of.

    Attributes
    ----------
    bores, points
        By name, the first bore is the origin, the first point lies on x.
    held
        Of the surface ``held``, or empty.
    """

    bores: Mapping[str, int]
    points: Mapping[str, int]
    held: Sequence[int] = ()

    def all(self) -> dict[str, Sequence[int]]:
        """Faces of every surface."""
        single = {name: (face,) for name, face in {**self.bores, **self.points}.items()}
        return single | ({"held": tuple(self.held)} if self.held else {})


def bore_sizes(
    part: OpenedPart, named: NamedFaces, around: float, coarser: float = 1.0
) -> CellSizes:
    """Size of the cells of a drawing: so many around each bore, larger ones away from it.

    All of them are larger by a factor of `coarser`.
    """
    cells = dict.fromkeys(range(1, len(part.faces) + 1), float(AROUND_OTHERS))
    cells |= dict.fromkeys(named.points.values(), around / 2)
    cells |= dict.fromkeys(named.bores.values(), around)
    sized = [(f.cylinder, cells[n]) for n, f in enumerate(part.faces, 1) if f.cylinder is not None]
    return CellSizes(sized, COARSE * float(np.ptp(part.solid.points, axis=0).max()), coarser)


@dataclass(frozen=True, eq=False)
class PlacedPart:
    """A part in its own frame.

    Attributes
    ----------
    solid, facets
        In metres, the first bore about z.
    numbers
        Face of each facet.
    named
        Which faces are surfaces.
    moved
        How far nodes of each bore were moved onto its cylinder [m].
    place
        Where the file's points come to lie: matrices of the same nodes are turned likewise.
    """

    solid: Solid
    facets: np.ndarray
    numbers: np.ndarray
    named: NamedFaces
    moved: Mapping[str, float]
    place: Placement

    def surfaces(self) -> dict[str, np.ndarray]:
        """Facets of every surface."""
        return {
            name: self.facets[np.isin(self.numbers, faces)]
            for name, faces in self.named.all().items()
        }

    def write(self, path: Path) -> None:
        """As a model."""
        write_part(path, self.solid, self.surfaces())

    def refined(self) -> PlacedPart:
        """The same with every cell cut in eight."""
        solid, facets, numbers = refined(self.solid, self.facets, self.numbers)
        return _rounded(PlacedPart(solid, facets, numbers, self.named, {}, self.place))


def _rounded(part: PlacedPart) -> PlacedPart:
    """Bores put on their cylinders, middles of edges as they then have to be."""
    points, moved = part.solid.points, {}
    corners = np.zeros(len(points), dtype=bool)
    corners[part.solid.cells[:, : CORNERS[part.solid.kind]]] = True
    surfaces = part.surfaces()
    for place, name in enumerate(part.named.bores):
        points, moved[name] = round_bore(points, surfaces[name], corners, name, first=place == 0)
    return replace(part, solid=replace(part.solid, points=points), moved=moved)


def place_part(
    part: OpenedPart, named: NamedFaces, around: float = AROUND, coarser: float = 1.0
) -> PlacedPart:
    """Turn a part into its frame, a drawing meshed with so many cells around its bores.

    All cells of a drawing are larger by a factor of `coarser`.

    Raises
    ------
    MeshError
        It cannot be meshed, or a bore is not round enough or not along the first one.
    """
    solid, facets, faces = part.solid, part.facets, part.faces
    numbers = np.zeros(len(facets), dtype=np.int64)
    for number, face in enumerate(faces, 1):
        numbers[face.facets] = number
    if part.labels is not None:
        owner = dict(zip(part.labels.tolist(), numbers.tolist(), strict=True))
        solid, labels = mesh_drawing(part.path, bore_sizes(part, named, around, coarser))
        facets = solid.facets()
        numbers = np.array([owner[label] for label in labels.tolist()])
    first, *others = (faces[number - 1].cylinder for number in named.bores.values())
    assert first is not None
    for name, other in zip(list(named.bores)[1:], others, strict=True):
        tilt = np.linalg.norm(np.cross(first.axis, other.axis))  # type: ignore[union-attr]
        if tilt > TILT:
            raise MeshError(f"{name} is inclined by {tilt:.1e} to the first bore, above {TILT:g}")
    towards = [faces[number - 1].centre for number in named.points.values()]
    place = placement(first, towards[0] if towards else None)
    solid = replace(solid, points=place(solid.points))
    return _rounded(PlacedPart(solid, facets, numbers, named, {}, place))
