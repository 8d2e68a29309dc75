"""Reading of solids from mesh files of other programs.

This package has readers for decks of Abaqus and CalculiX and for bulk data of Nastran. Gmsh reads
I-DEAS files, meshio all other formats. A file with solid cells of two kinds is refused; entities
that are not solid are counted and reported.
"""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from xml.etree import ElementTree

import h5py
import meshio
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from fenics_ehd.base.errors import MeshError
from fenics_ehd.base.processes import interrupt_kept, printing_kept
from fenics_ehd.base.sealed_file import named, require_own_data
from fenics_ehd.base.units import in_unit
from fenics_ehd.fem.bulk_data import read_bulk_data
from fenics_ehd.fem.deck import read_deck
from fenics_ehd.fem.foreign_mesh import FileMaterial, ForeignMesh, one_solid_kind
from fenics_ehd.fem.gmsh_session import read_by_gmsh
from fenics_ehd.fem.models import MESH_BEGINS
from fenics_ehd.fem.solid import Solid, require_extent, require_sound_cells, used

#: Extensions of meshes that Gmsh reads and meshio does not (I-DEAS).
READ_BY_GMSH = (".unv",)

#: Extensions of bulk data files, of Nastran and of programs that read them.
NASTRAN = (".bdf", ".fem", ".nas")

#: Pattern of the first line of a matrix file of Abaqus, which no mesh file begins with.
_MATRIX = re.compile(r"\s*(\d+\s*,\s*\d+\s*,|\d+\s+\d+\s+[-+.\d])")


@dataclass(frozen=True, eq=False)
class ForeignPart:
    """Solid from a file, with a description of the other contents.

    Attributes
    ----------
    solid
        Solid with node positions in [m]; cells are of first or second order as in the file, and
        nodes have the sequence of the file.
    left_out
        Elements, sets and constraints that are not part of the solid, as text; empty if none.
    materials
        Materials of the cells, which are equal unless several were allowed; empty if the file has
        no materials.
    """

    solid: Solid
    left_out: str = ""
    materials: Sequence[FileMaterial] = ()


def read_mesh(path: Path, unit: str, *, several_materials: bool = False) -> Solid:
    """Read the solid of a mesh file; its cells are of first or second order as in the file.

    Nodes without a cell are removed. The remaining nodes have the sequence of the file; nodes of a
    deck are sorted by their numbers. A `UserWarning` lists the other contents of the file.

    Parameters
    ----------
    path
        Path of a mesh with one kind of tetrahedra or hexahedra.
    unit
        Unit of length of the file.
    several_materials
        Whether cells of several materials are accepted. This is useful if the stiffness and mass
        matrices come from another program, which knows the materials.

    Raises
    ------
    MeshError
        If the file cannot be read; if it has no solid cells, or cells of several kinds or several
        materials; if cells are invalid; or if the size of the solid shows that the unit is wrong.
    """
    part = read_part(path, unit, several_materials=several_materials)
    if part.left_out:
        warnings.warn(f"{path}: left out are {part.left_out}", stacklevel=2)
    return part.solid


def read_part(path: Path, unit: str, *, several_materials: bool = False) -> ForeignPart:
    """Read the solid, the materials and the other contents of a mesh file; see `read_mesh`."""
    mesh = _read(path).check(path)
    kind, cells = mesh.solid_cells(path)
    if not several_materials:
        mesh.require_one_material(path)
    points = np.asarray(mesh.points, dtype=float) * in_unit(f"1 {unit}", "m")
    solid = used(Solid(points, cells, kind))
    if not np.isfinite(solid.points).all():
        raise MeshError(f"{path}: a node has a coordinate that is not a finite number")
    require_sound_cells(solid, path)
    _require_one_piece(path, cells)
    require_extent(np.ptp(solid.points, axis=0), path)
    return ForeignPart(solid, mesh.left_out(), mesh.materials)


def _read(path: Path) -> ForeignMesh:
    """Read the contents of a mesh file of any format."""
    ending = path.suffix.lower()
    if ending == ".inp":
        return read_deck(path)
    if ending in NASTRAN:
        return read_bulk_data(path)
    if ending in READ_BY_GMSH:
        return _read_ideas(path)
    return _read_by_meshio(path)


#: Meshio's names of I-DEAS elements, by FE descriptor.
_DESCRIPTORS = {
    **{"111": "tetra", "118": "tetra10", "115": "hexahedron", "116": "hexahedron20"},
    **{"112": "wedge", "113": "wedge15", "114": "pyramid"},
}

#: FE descriptors of beams, whose records have an additional line.
_BEAMS = (11, 21, 22, 23, 24)


def _read_ideas(path: Path) -> ForeignMesh:
    """Read the contents of an I-DEAS file; elements are counted before Gmsh reads the file.

    Raises
    ------
    MeshError
        If the file has several kinds of solid elements, or if Gmsh does not read all of them.
    """
    with named(MeshError, str(path)):
        counts = _elements_of_ideas(path)
    others = ", ".join(f"{n} {name}" for name, n in counts.items())
    kind = one_solid_kind(counts, others, path)
    mesh = ForeignMesh(*read_by_gmsh(path))
    if mesh.counts.get(kind, 0) != counts[kind]:
        raise MeshError(
            f"{path}: Gmsh reads {mesh.counts.get(kind, 0)} of its {counts[kind]} {kind} elements: "
            "export another format"
        )
    return mesh


def _elements_of_ideas(path: Path) -> Counter[str]:
    """Count the elements in an I-DEAS file by name; they are in datasets 2412 or 780 (older)."""
    counts: Counter[str] = Counter()
    text = path.read_text(errors="replace")
    for dataset in re.split(r"^ {4}-1\s*$", text, flags=re.MULTILINE):
        number, *lines = dataset.strip("\n").splitlines() or [""]
        at = 0
        while number.strip() in ("2412", "780") and at < len(lines):
            record = lines[at].split()
            if len(record) < 6 or not all(word.lstrip("-").isdecimal() for word in record):
                raise MeshError(f"{path}: a line of its elements is no record of six numbers")
            counts[_DESCRIPTORS.get(record[1], f"elements of FE descriptor {record[1]}")] += 1
            at += 1 + (int(record[1]) in _BEAMS) + max(1, -(-int(record[-1]) // 8))
    return counts


def _read_by_meshio(path: Path) -> ForeignMesh:
    """Read the contents of a file by meshio, or by Gmsh if meshio fails on a Gmsh mesh."""
    try:
        with interrupt_kept(), printing_kept() as printed:
            _require_files(path)
            mesh = meshio.read(path)
    except MeshError:
        raise
    except (meshio.ReadError, OSError, SystemExit) as error:  # meshio exits to refuse a file
        reason = printed.getvalue() if isinstance(error, SystemExit) else str(error)
        lines = [line for line in reason.splitlines() if line.strip()] or ["it gives no reason"]
        raise MeshError(
            f"{path}: meshio cannot read it: {lines[0].rstrip('.')}{_hint(path)}"
        ) from None
    except Exception:
        if _is_gmsh(path):  # a file with groups of only some cells, for instance, fails in meshio
            return ForeignMesh(*read_by_gmsh(path))
        # Messages of other exceptions do not describe the file.
        raise MeshError(
            f"{path}: meshio cannot read it: the contents are not those of a "
            f"{path.suffix or 'mesh'} file, or meshio does not know their kind{_hint(path)}"
        ) from None
    blocks = [(block.type, block.data) for block in mesh.cells]
    sets = Counter({"sets": len(mesh.point_sets) + len(mesh.cell_sets)})
    return ForeignMesh(mesh.points, blocks, sets)


def _is_gmsh(path: Path) -> bool:
    """Whether a file is a mesh in Gmsh's format; Gmsh would execute other files as models."""
    if path.suffix != ".msh":
        return False
    with open(path, "rb") as file:
        return file.read(len(MESH_BEGINS)) == MESH_BEGINS


def _hint(path: Path) -> str:
    """Text about what an unreadable mesh file seems to be, for the end of a message, or empty."""
    try:
        with open(path, encoding="ascii") as file:
            lines = [line for line in islice(file, 100) if not line.startswith("**")]
    except (OSError, ValueError):
        return ""
    if lines and _MATRIX.match(lines[0]):
        return ": rows of numbers as in a matrix of Abaqus, which read_abaqus reads"
    return ""


def _require_files(path: Path) -> None:
    """Refuse a mesh whose data are in a pipe or a device, whose reading may never end.

    HDF5 files must not refer to such a file, and must not declare more data than they contain.

    Raises
    ------
    MeshError
        If a file is refused; the message names it.
    """
    others = []
    if path.suffix.lower() in (".xdmf", ".xmf"):
        items = [i for i in ElementTree.parse(path).iter("DataItem") if i.get("Format") != "XML"]
        names = [(item.text or "").partition(":")[0].strip() for item in items]
        # HDF5 looks for external files in the folder of the file, in that of a link's target, and
        # in the working directory.
        named_files = [name for name in names if name]
        folders = (path.parent, path.resolve().parent, Path())
        others = [folder / name for name in named_files for folder in folders]
    elif path.suffix.lower() in (".node", ".ele"):
        others = [path.with_suffix(".node"), path.with_suffix(".ele")]
    for other in others:
        if other.exists() and not other.is_file():
            raise MeshError(f"{path}: {other} is not a regular file")
    for file in (path, *others):
        if file.is_file() and h5py.is_hdf5(file):
            with named(MeshError, str(path)):
                require_own_data(file)


def _require_one_piece(path: Path, cells: np.ndarray) -> None:
    """Refuse cells that form several solids without a common node.

    Raises
    ------
    MeshError
        If there are several solids; the message has their number.
    """
    owners = np.repeat(np.arange(len(cells)), cells.shape[1])
    shape = len(cells), int(cells.max()) + 1
    holds = coo_matrix((np.ones(cells.size), (owners, cells.ravel())), shape=shape).tocsr()
    pieces = connected_components(holds.T @ holds, directed=False)[1]
    count = len(np.unique(pieces[cells[:, 0]]))
    if count > 1:
        raise MeshError(
            f"{path} has {count} solids, but must have one: export the part alone, or merge nodes "
            "at the same position"
        )
