"""Solids from meshes of other programs."""

from __future__ import annotations

from io import StringIO
from pathlib import Path
from xml.etree import ElementTree

import meshio
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from fenics_ehd.base.errors import MeshError
from fenics_ehd.base.interrupt import interrupt_kept
from fenics_ehd.base.silence import printing_kept
from fenics_ehd.base.units import in_unit
from fenics_ehd.fem.abaqus_deck import read_deck
from fenics_ehd.fem.gmsh_session import read_by_gmsh
from fenics_ehd.fem.solid import Solid, raised, used
from fenics_ehd.fem.sound_cells import require_sound_cells

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

#: Of Nastran, which meshio reads if they begin as a whole deck does.
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
    """Refuse a mesh whose numbers are in a pipe, which would be waited for, or in a device."""
    others = []
    if path.suffix.lower() in (".xdmf", ".xmf"):
        items = [i for i in ElementTree.parse(path).iter("DataItem") if i.get("Format") != "XML"]
        names = [(item.text or "").partition(":")[0].strip() for item in items]
        # HDF5 is looked for beside the file, the rest in the working directory.
        others = [folder / name for name in names if name for folder in (path.parent, Path())]
    elif path.suffix.lower() in (".node", ".ele"):
        others = [path.with_suffix(".node"), path.with_suffix(".ele")]
    for other in others:
        if other.exists() and not other.is_file():
            raise ValueError(f"{other} is not a regular file")


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
