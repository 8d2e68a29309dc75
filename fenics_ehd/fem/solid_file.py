"""Solids from meshes of other programs.

meshio reads them, but for those of I-DEAS, which Gmsh reads. Of a deck of Abaqus and CalculiX it is
given the nodes and solid cells alone: meshio 5.3 forgets all nodes at a second ``*NODE`` (reference
points of an assembly, say), knows type names in capitals alone and refuses a deck for any type of
element that it does not know.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from xml.etree import ElementTree

import h5py
import meshio
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from fenics_ehd.base.errors import MeshError
from fenics_ehd.base.fields import in_unit
from fenics_ehd.base.processes import interrupt_kept, printing_kept
from fenics_ehd.base.sealed_file import named, require_file, require_own_data
from fenics_ehd.fem.gmsh_session import read_by_gmsh
from fenics_ehd.fem.solid import Solid, raised, require_sound_cells, used

#: Drawings, whose units are in the file.
DRAWINGS = (".step", ".stp", ".iges", ".igs")

#: A part longer than this in metres is in millimetres [m].
LONGEST = 5.0

#: Solid cells by meshio's names: kind, nodes that are kept, whether they are of second order.
CELLS = {
    "tetra": ("tet", 4, False),
    "tetra10": ("tet", 10, True),
    "hexahedron": ("hex", 8, False),
    "hexahedron20": ("hex", 20, True),
    "hexahedron27": ("hex", 20, True),
}

#: Meshes that Gmsh reads and meshio does not, of I-DEAS.
READ_BY_GMSH = (".unv",)

#: Files of Nastran, which meshio reads if they begin as a whole deck does.
NASTRAN = (".bdf", ".fem", ".nas")


def read_mesh(path: Path, unit: str) -> Solid:
    """Solid of a mesh file; cells of first order get straight edges.

    Raises
    ------
    MeshError
        It cannot be read, has no solid cells or several kinds, is of another unit, or its cells
        are no solid.
    """
    points, blocks = read_deck(path) if path.suffix.lower() == ".inp" else _read(path)
    kinds = sorted({name for name, _ in blocks if name in CELLS})
    if len(kinds) != 1:
        there = ", ".join(kinds or sorted({name for name, _ in blocks})) or "nothing"
        raise MeshError(
            f"{path} has {there}: it needs one kind of solid cells, of {', '.join(CELLS)}"
        )
    kind, count, quadratic = CELLS[kinds[0]]
    cells = np.concatenate([cells[:, :count] for name, cells in blocks if name in CELLS])
    cells = cells.astype(np.int64)
    points = np.asarray(points, dtype=float) * in_unit(f"1 {unit}", "m")
    solid = used(Solid(points, cells, kind) if quadratic else raised(points, cells, kind))
    if not np.isfinite(solid.points).all():
        raise MeshError(f"{path}: a node has coordinates that are no finite numbers")
    require_sound_cells(solid, path)
    _require_one_piece(path, cells)
    longest = np.ptp(solid.points, axis=0).max()
    if longest > LONGEST:
        raise MeshError(f"{path} is {longest:g} m long, above {LONGEST:g}: give its --unit, mm say")
    return solid


def _read(path: Path) -> tuple[np.ndarray, list[tuple[str, np.ndarray]]]:
    """Points and cells by meshio's names."""
    if path.suffix.lower() in READ_BY_GMSH:
        return read_by_gmsh(path)
    try:
        with interrupt_kept(), printing_kept() as said:
            _require_files(path)
            mesh = _bulk_data(path) or meshio.read(path)
    except (Exception, SystemExit) as error:  # the latter is how meshio refuses a file
        reason = said.getvalue() if isinstance(error, SystemExit) else str(error)
        lines = [line for line in reason.splitlines() if line.strip()] or [type(error).__name__]
        raise MeshError(f"{path}: meshio cannot read it: {lines[0]}") from None
    return mesh.points, [(block.type, block.data) for block in mesh.cells]


def _require_files(path: Path) -> None:
    """Refuse a mesh whose numbers are in a pipe, which would be waited for, or in a device.

    Nor may HDF5 lead to another file, or claim more than it holds.
    """
    others = []
    if path.suffix.lower() in (".xdmf", ".xmf"):
        items = [i for i in ElementTree.parse(path).iter("DataItem") if i.get("Format") != "XML"]
        names = [(item.text or "").partition(":")[0].strip() for item in items]
        # HDF5 is looked for beside the file, that of a link where it leads, the rest in the
        # working directory.
        folders = (path.parent, path.resolve().parent, Path())
        others = [folder / name for name in names if name for folder in folders]
    elif path.suffix.lower() in (".node", ".ele"):
        others = [path.with_suffix(".node"), path.with_suffix(".ele")]
    for other in others:
        if other.exists() and not other.is_file():
            raise ValueError(f"{other} is not a regular file")
    for file in (path, *others):
        if file.is_file() and h5py.is_hdf5(file):
            require_own_data(file)


def _bulk_data(path: Path) -> meshio.Mesh | None:
    """Mesh of a file of Nastran that holds its bulk data alone."""
    if path.suffix.lower() not in NASTRAN or "BEGIN BULK" in (text := path.read_text()):
        return None
    text = text.partition("ENDDATA")[0]
    return meshio.read(StringIO(f"BEGIN BULK\n{text}\nENDDATA\n"), file_format="nastran")


def _require_one_piece(path: Path, cells: np.ndarray) -> None:
    owners = np.repeat(np.arange(len(cells)), cells.shape[1])
    shape = len(cells), int(cells.max()) + 1
    holds = coo_matrix((np.ones(cells.size), (owners, cells.ravel())), shape=shape).tocsr()
    pieces = connected_components(holds.T @ holds, directed=False)[1]
    count = len(np.unique(pieces[cells[:, 0]]))
    if count > 1:
        raise MeshError(
            f"{path} has {count} solids, it must have one: export the part alone, or merge the "
            "nodes that lie in one place"
        )


# Decks of Abaqus and CalculiX

#: Behind these, node numbers mean other nodes: they are those of one part or instance.
_SCOPES = {
    *("PART", "ENDPART", "INSTANCE", "ENDINSTANCE", "ASSEMBLY", "ENDASSEMBLY"),
}

#: Keywords that make or move nodes and elements without listing them.
_GENERATORS = {"NCOPY", "NFILL", "NGEN", "NMAP", "SYSTEM", "ELCOPY", "ELGEN"}

#: Most files that a deck includes, each as often as it is included.
MOST_FILES = 100


@dataclass
class _Scope:
    """Lines of nodes, and of solid elements by their type."""

    nodes: list[str] = field(default_factory=list)
    elements: dict[str, list[str]] = field(default_factory=dict)


def read_deck(path: Path) -> tuple[np.ndarray, list[tuple[str, np.ndarray]]]:
    """Nodes and solid cells; other elements, sets and steps are passed over.

    Parameters
    ----------
    path
        Flat, or of parts and instances, of which one has solid cells: instances are not moved to
        where the assembly has them. ``*INCLUDE`` is followed.

    Returns
    -------
    tuple
        Points (n, 3), and of each type of cell its name in meshio and the nodes (c, k).

    Raises
    ------
    MeshError
        It has no solid cells, those of several parts, or what cannot be read.
    """
    scopes = [_Scope()]
    # Before each keyword a star, before a comment two, which are gone already.
    for section in re.split(r"^\*", _text(path, []), flags=re.MULTILINE)[1:]:
        header, _, text = section.partition("\n")
        keyword, type_name = _keyword(header)
        rows = [line for line in text.splitlines() if line.strip()]
        if keyword in _SCOPES:
            scopes.append(_Scope())
        elif keyword in _GENERATORS:
            raise MeshError(f"{path} has *{keyword}: write a deck that lists nodes and elements")
        elif keyword == "NODE":
            scopes[-1].nodes += rows
        elif keyword == "ELEMENT" and re.fullmatch(r"C3D\d+[A-Z]*", type_name):
            scopes[-1].elements.setdefault(type_name, []).extend(rows)
    solid = [scope for scope in scopes if scope.elements]
    if not solid:
        raise MeshError(f"{path} has no C3D4, C3D8, C3D10, C3D20: it needs one kind of solid cells")
    if len(solid) > 1:
        raise MeshError(
            f"{path} has {len(solid)} parts of solid cells, it must have one: export the part alone"
        )
    # A row may leave out what is zero.
    flat = ["*NODE", *(",".join(f"{line},0,0,0".split(",")[:4]) for line in solid[0].nodes)]
    for type_name, lines in solid[0].elements.items():
        # meshio does not know all of a family, as C3D8RT.
        family = re.sub(r"(C3D\d+).*", r"\1", type_name)
        flat += [f"*ELEMENT, TYPE={family}", *lines]
    try:
        mesh = meshio.read(StringIO("\n".join(flat)), file_format="abaqus")
    except (Exception, SystemExit):
        # What it says is not shown: it may be any file, which a deck from elsewhere includes.
        raise MeshError(
            f"{path}: its rows are not nodes with coordinates and {', '.join(solid[0].elements)} "
            "with as many of these nodes as they have"
        ) from None
    return mesh.points, [(block.type, block.data) for block in mesh.cells]


def _text(path: Path, opened: list[Path]) -> str:
    """A deck with those that it includes; keywords with their options in one line, no comments."""
    opened.append(path)
    if len(opened) > MOST_FILES:
        raise MeshError(
            f"{opened[0]} includes more than {MOST_FILES} files, the last is {path}: does one "
            "include itself?"
        )
    with named(MeshError, str(path)):
        require_file(path)
        text = path.read_text(encoding="utf-8", errors="replace")

    def included(line: re.Match[str]) -> str:
        return _text(path.parent / line[1].strip().strip('"'), opened)

    text = re.sub(r"^\*\*.*\n?", "", text, flags=re.MULTILINE)
    text = re.sub(r"^(\*.*,)[ \t]*\n", r"\1", text, flags=re.MULTILINE)
    include = r"^\*\s*INCLUDE\s*,.*INPUT\s*=\s*([^,\n]+).*$"
    return re.sub(include, included, text, flags=re.IGNORECASE | re.MULTILINE)


def _keyword(line: str) -> tuple[str, str]:
    """Keyword without blanks, and the option TYPE or nothing, in capitals."""
    keyword, *options = re.sub(r"\s", "", line).upper().split(",")
    pairs = dict(option.partition("=")[::2] for option in options)
    return keyword, pairs.get("TYPE", "")
