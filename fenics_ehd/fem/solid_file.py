"""Solids from drawings, which Gmsh meshes, and from meshes of other programs."""

from __future__ import annotations

from collections.abc import Callable
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import meshio
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from fenics_ehd.base.errors import MeshError
from fenics_ehd.base.interrupt import interrupt_kept
from fenics_ehd.base.silence import printing_kept
from fenics_ehd.base.units import in_unit
from fenics_ehd.fem.abaqus_deck import read_deck
from fenics_ehd.fem.solid import GMSH_HEX, GMSH_TET, Solid, raised, used
from fenics_ehd.fem.sound_cells import require_sound_cells

with interrupt_kept():
    import gmsh

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

#: Gmsh's 10-node tetrahedron and its 6-node triangle.
_TETRAHEDRON, _TRIANGLE = 11, 9

#: Meshes that Gmsh reads and meshio does not, of I-DEAS.
READ_BY_GMSH = (".unv",)

#: Of Nastran, which meshio reads if they begin as a whole deck does.
NASTRAN = (".bdf", ".fem", ".nas")

#: Gmsh's numbers of solid cells, their names in meshio and the order of their nodes there.
_BY_GMSH = {
    4: ("tetra", [*range(4)]),
    11: ("tetra10", GMSH_TET),
    5: ("hexahedron", [*range(8)]),
    17: ("hexahedron20", np.argsort(GMSH_HEX).tolist()),
}

#: Size of cells where nothing asks for smaller ones, relative to the part's longest side.
COARSE = 1 / 20

#: Size of the cells at a point, shape (3,) [m].
SizeAt = Callable[[np.ndarray], float]


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
        return _read_by_gmsh(path)
    try:
        with interrupt_kept(), printing_kept() as said:
            mesh = _bulk_data(path) or meshio.read(path)
    except (Exception, SystemExit) as error:  # the latter is how meshio refuses a file
        reason = said.getvalue() if isinstance(error, SystemExit) else str(error)
        lines = [line for line in reason.splitlines() if line.strip()] or [type(error).__name__]
        raise MeshError(f"{path}: meshio cannot read it: {lines[0]}") from None
    return mesh.points, [(block.type, block.data) for block in mesh.cells]


def _bulk_data(path: Path) -> meshio.Mesh | None:
    """Mesh of a file of Nastran that holds its bulk data alone."""
    if path.suffix.lower() not in NASTRAN or "BEGIN BULK" in (text := path.read_text()):
        return None
    text = text.partition("ENDDATA")[0]
    return meshio.read(StringIO(f"BEGIN BULK\n{text}\nENDDATA\n"), file_format="nastran")


def _read_by_gmsh(path: Path) -> tuple[np.ndarray, list[tuple[str, np.ndarray]]]:
    """The same by Gmsh."""
    with interrupt_kept(), printing_kept(), TemporaryDirectory() as folder:
        alone = Path(folder, f"model{path.suffix}")  # no file of options lies beside it
        alone.symlink_to(path.absolute())
        gmsh.initialize([""], readConfigFiles=False)
        try:
            gmsh.option.setNumber("General.Terminal", 0)
            gmsh.merge(str(alone))
            tags, x, _ = gmsh.model.mesh.getNodes()
            row = np.zeros(int(tags.max(initial=0)) + 1, dtype=np.int64)
            row[tags] = np.arange(len(tags))
            blocks = [
                (name, row[nodes].reshape(-1, len(order))[:, order])
                for number, (name, order) in _BY_GMSH.items()
                if len(nodes := gmsh.model.mesh.getElementsByType(number)[1])
            ]
            return x.reshape(-1, 3), blocks
        except Exception as error:  # Gmsh raises plain Exception
            raise MeshError(f"{path}: Gmsh cannot read it: {error}") from None
        finally:
            gmsh.finalize()


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


def mesh_drawing(path: Path, size: SizeAt | None = None) -> tuple[Solid, np.ndarray]:
    """Second-order tetrahedra of a drawing in metres, and the drawing's face of each facet.

    Parameters
    ----------
    path
        STEP or IGES; lengths in its own unit.
    size
        Of the cells; None: coarse ones.

    Returns
    -------
    tuple
        The solid, and a number for each of its `facets`.

    Raises
    ------
    MeshError
        Gmsh cannot read or mesh it, or it is not one solid.
    """
    with interrupt_kept():
        gmsh.initialize([""], readConfigFiles=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setString("Geometry.OCCTargetUnit", "M")
        with printing_kept():  # by OpenCASCADE, of a file that is broken
            gmsh.model.occ.importShapes(str(path))
        gmsh.model.occ.synchronize()
        volumes = gmsh.model.getEntities(3)
        if len(volumes) != 1:
            raise MeshError(f"{path} has {len(volumes)} solids, it must have one: export the part")
        box = np.array(gmsh.model.getBoundingBox(-1, -1)).reshape(2, 3)
        coarse = COARSE * np.ptp(box, axis=0).max()
        if size is not None:
            at = size
            gmsh.model.mesh.setSizeCallback(lambda d, t, x, y, z, *_: at(np.array([x, y, z])))
        for name in ("FromPoints", "ExtendFromBoundary"):
            gmsh.option.setNumber(f"Mesh.MeshSize{name}", 0)
        if size is None:
            gmsh.option.setNumber("Mesh.MeshSizeMax", coarse)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        # Straight cells beside curved ones where a facet bulges through them.
        gmsh.model.mesh.optimize("HighOrderFastCurving")
        return _taken()
    except MeshError:
        raise
    except Exception as error:  # Gmsh raises plain Exception
        raise MeshError(f"Gmsh cannot mesh {path}: {error}") from None
    finally:
        with interrupt_kept():
            gmsh.finalize()


def _taken() -> tuple[Solid, np.ndarray]:
    """The current model's tetrahedra and the entity of each facet."""
    tags, x, _ = gmsh.model.mesh.getNodes()
    row = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    row[tags] = np.arange(len(tags))
    cells = gmsh.model.mesh.getElementsByType(_TETRAHEDRON)[1]
    if not len(cells):
        raise MeshError("it gives no tetrahedra")
    kept = row[cells].reshape(-1, 10)[:, GMSH_TET]
    nodes, cells = np.unique(kept, return_inverse=True)
    solid = Solid(x.reshape(-1, 3)[nodes], cells.reshape(kept.shape), "tet")
    corners, owners = [], []
    for _, entity in gmsh.model.getEntities(2):
        triangles = row[gmsh.model.mesh.getElementsByType(_TRIANGLE, entity)[1]].reshape(-1, 6)
        corners.append(np.searchsorted(nodes, triangles[:, :3]))
        owners.append(np.full(len(triangles), entity))
    facets = solid.facets()
    known = np.sort(np.vstack([*corners, facets[:, :3]]), axis=1)
    numbers = np.unique(known, axis=0, return_inverse=True)[1].ravel()
    label = np.zeros(numbers.max() + 1, dtype=np.int64)
    drawn = np.concatenate(owners)
    label[numbers[: len(drawn)]] = drawn
    return solid, label[numbers[len(drawn) :]]
