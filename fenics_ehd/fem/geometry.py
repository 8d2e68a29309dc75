"""Gmsh models to dolfinx meshes."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import fenics_ehd.base.petsc_start  # noqa: F401  # isort: skip
import basix
import numpy as np
from dolfinx.mesh import Mesh
from mpi4py import MPI

from fenics_ehd.base import compat
from fenics_ehd.base.errors import MeshError
from fenics_ehd.base.interrupt import interrupt_kept
from fenics_ehd.fem.models import check_model
from fenics_ehd.fem.solid import GMSH_HEX, GMSH_TET, Solid
from fenics_ehd.fem.sound_cells import require_sound_cells
from fenics_ehd.fem.surface_mesh import cylinder_centre
from fenics_ehd.reduction.bore import BORE

with interrupt_kept():
    import gmsh

#: Gmsh's numbers of the second-order cells and of the triangle on their faces.
_GMSH_CELLS = {"hexahedron": 12, "tetrahedron": 11}
_TRIANGLE_6 = 9

#: Cells that can be asked for, by their short names.
CELLS = {"hex": "hexahedron", "tet": "tetrahedron"}

#: How Gmsh begins the names of what it puts beside a model's own parameters.
_GMSH_OWN = ("Gmsh/", "0Gmsh/", "1Gmsh/")

#: Parameter of a model that can be meshed with either.
_SWITCH = "tetrahedra"


@dataclass(frozen=True, eq=False)
class PartMesh:
    """Second-order mesh of hexahedra or tetrahedra with the numbers of its named groups."""

    mesh: Mesh
    cell_tags: compat.MeshTags
    facet_tags: compat.MeshTags
    groups: Mapping[str, int]

    @property
    def cell(self) -> str:
        """``"hexahedron"`` or ``"tetrahedron"``."""
        return self.mesh.topology.cell_type.name

    def group(self, name: str) -> int:
        """Number of a named physical group.

        Raises
        ------
        MeshError
            The model has no group of this name.
        """
        if name not in self.groups:
            raise MeshError(
                f"the mesh has no physical group {name!r} (it has {', '.join(self.groups)}): "
                f"name the surface in the Gmsh model, Physical Surface({name!r})"
            )
        return self.groups[name]


@contextmanager
def _by_itself(path: Path) -> Iterator[str]:
    """Name of a model beside which no file of options lies, which Gmsh would obey."""
    check_model(path)
    with TemporaryDirectory() as folder:
        alone = Path(folder, f"model{path.suffix}")
        if path.suffix == ".msh":
            alone.symlink_to(path.absolute())
        else:
            if set(str(path.absolute())) & set('"\\\n'):
                raise MeshError(f"model {path}: quotes and backslashes in its path are Gmsh's")
            alone.write_text(f'Include "{path.absolute()}";\n')
        yield str(alone)


def _parameters(model: str) -> dict[str, Any]:
    """What ONELAB knows of every number that is a parameter, by the last part of its name."""
    gmsh.onelab.clear()
    gmsh.open(model)
    names = [name for name in gmsh.onelab.getNames() if not name.startswith(_GMSH_OWN)]
    found = {name.rsplit("/", 1)[-1]: json.loads(gmsh.onelab.get(name)) for name in names}
    gmsh.clear()
    # Values survive in ONELAB, so those of a former model would override this one's.
    gmsh.onelab.clear()
    return {name: entry for name, entry in found.items() if entry["type"] == "number"}


def _set_parameter(model: Path, known: Mapping[str, Any], name: str, value: float) -> None:
    """Give a parameter a value within the limits that the model sets to it."""
    if name not in known:
        close = difflib.get_close_matches(name, known, n=2, cutoff=0.55)
        meant = f"did you mean {' or '.join(close)}? " if close else ""
        has = f"it has {', '.join(known)}" if known else "it has none"
        raise MeshError(f"model {model.name} has no parameter {name!r}: {meant}{has}")
    entry = known[name]
    if not entry["min"] <= value <= entry["max"]:
        limits = f"from {entry['min']:g} to {entry['max']:g}"
        raise MeshError(f"geometry.{name} = {value:g} must be {limits}, says {model.name}")
    if value not in entry.get("choices", [value]):
        choices = " or ".join(f"{choice:g}" for choice in entry["choices"])
        raise MeshError(f"geometry.{name} = {value:g} must be {choices}, says {model.name}")
    gmsh.onelab.setNumber(entry["name"], [float(value)])


def _begin_session() -> None:
    """Gmsh without options of its user, silent."""
    with interrupt_kept():
        gmsh.initialize([""], readConfigFiles=False)
    gmsh.option.setNumber("General.Terminal", 0)


def model_parameters(path: Path) -> dict[str, float]:
    """Numbers that may be given to a model, by name, as they are if nobody does; of a mesh none.

    Serial.

    Raises
    ------
    MeshError
        Gmsh cannot read it.
    """
    if path.suffix == ".msh":
        return {}
    try:
        _begin_session()
        with _by_itself(path) as model:
            return {name: entry["values"][0] for name, entry in _parameters(model).items()}
    except MeshError:
        raise
    except Exception as error:  # Gmsh raises plain Exception
        raise MeshError(f"Gmsh cannot read {path}: {error}") from error
    finally:
        with interrupt_kept():
            gmsh.finalize()


def _generate(path: Path, parameters: Mapping[str, float], cells: str) -> dict[str, int]:
    """Mesh a model in a fresh Gmsh session; the caller finalises Gmsh."""
    _begin_session()
    with _by_itself(path) as model:
        known = {} if path.suffix == ".msh" else _parameters(model)
        for name, value in parameters.items():
            _set_parameter(path, known, name, value)
        if _SWITCH in known and _SWITCH not in parameters:
            _set_parameter(path, known, _SWITCH, cells == "tet")
        gmsh.open(model)
    if not gmsh.model.mesh.getNodes()[0].size:
        gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)
    return {
        gmsh.model.getPhysicalName(*group): group[1] for group in gmsh.model.getPhysicalGroups()
    }


def _found_cells(path: str | Path, asked: str) -> str:
    """Which cells the current model holds, ``"hex"`` or ``"tet"``, and no other solids."""
    found = set(gmsh.model.mesh.getElementTypes(3))
    if not found:
        raise MeshError(f"model {path} gives no solid cells: check its numbers of cells")
    kind = next((name for name in CELLS if found == {_GMSH_CELLS[CELLS[name]]}), None)
    if kind is None:
        kinds = ", ".join(gmsh.model.mesh.getElementProperties(cell)[0] for cell in sorted(found))
        raise MeshError(f"model {path} holds {kinds}: mesh it with hexahedra or tetrahedra alone")
    if asked == "tet" != kind:
        raise MeshError(
            f"model {path} gives no tetrahedra: it needs a parameter {_SWITCH} for cells = 'tet'"
        )
    if not gmsh.model.getPhysicalGroups(3):
        raise MeshError(f"model {path} has no physical volume: name the part's solid")
    return kind


def build_mesh(
    path: str | Path,
    parameters: Mapping[str, float] | None = None,
    *,
    comm: MPI.Comm = MPI.COMM_WORLD,
    serendipity_geometry: bool = True,
    cells: str = "hex",
    bores: Sequence[str] = (BORE,),
) -> PartMesh:
    """Mesh a Gmsh model on rank 0 and distribute it.

    Parameters
    ----------
    path
        A ``.geo`` model, which is a program that Gmsh runs, or a ``.msh`` file.
    parameters
        Values for the model's ``DefineConstant`` parameters, by name.
    comm
        Communicator the mesh is distributed over.
    serendipity_geometry
        Put face and cell centres of hexahedra where the 20 edge and corner nodes
        put them, which a 20-node element needs to represent linear fields.
    cells
        ``"hex"`` or ``"tet"``, for a model whose parameter ``tetrahedra`` decides; others
        have what they have.
    bores
        Surfaces on cylinders along z: mid-side nodes of tetrahedra there are put
        on the cylinder, half way in angle and height.

    Returns
    -------
    PartMesh

    Raises
    ------
    MeshError
        Gmsh cannot read or mesh the model, or it mixes cells, or has no tetrahedra to be asked
        for.
    """
    groups, failure = None, None
    if comm.rank == 0:
        try:
            groups = _generate(Path(path), parameters or {}, cells)
            cells = _found_cells(path, cells)
            if cells == "tet":
                for bore in bores:
                    _round_bore(groups.get(bore))
            require_sound_cells(_meshed(cells), path)
        except MeshError as error:
            failure = str(error)
        except Exception as error:  # Gmsh raises plain Exception
            failure = f"Gmsh cannot mesh {path}: {error}"
    failure, groups, cells = comm.bcast((failure, groups, cells))
    try:
        if failure:
            raise MeshError(failure)
        mesh, cell_tags, facet_tags = compat.model_to_mesh(gmsh.model, comm)
    finally:
        if comm.rank == 0:
            with interrupt_kept():
                gmsh.finalize()
    if serendipity_geometry and cells == "hex":
        _place_centre_nodes(mesh)
    return PartMesh(mesh, cell_tags, facet_tags, groups)


def _round_bore(group: int | None) -> None:
    """Put mid-side nodes of the bore's triangles on the cylinder, half way in angle and height.

    There the isoparametric bore is the best quadratic one, and straight edges in
    the unwrapped plane are what the mesh transfer takes them for.
    """
    if group is None:
        return
    tags, x, _ = gmsh.model.mesh.getNodes()
    x = x.reshape(-1, 3)
    row = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    row[tags] = np.arange(len(tags))
    nodes = [
        gmsh.model.mesh.getElementsByType(_TRIANGLE_6, entity)[1]
        for entity in gmsh.model.getEntitiesForPhysicalGroup(2, group)
    ]
    triangles = np.concatenate(nodes).reshape(-1, 6)
    corners = x[row[triangles[:, :3]]]
    centre = cylinder_centre(corners.reshape(-1, 3))
    corners = corners - centre
    # Gmsh orders the edges 0-1, 1-2, 2-0.
    following = np.roll(corners, -1, axis=1)
    middle = 0.5 * (corners + following)
    reach = [np.linalg.norm(end[:, :, :2], axis=2) for end in (corners, following, middle)]
    middle[:, :, :2] *= (0.5 * (reach[0] + reach[1]) / np.maximum(reach[2], 1e-300))[:, :, None]
    edge_nodes, first = np.unique(triangles[:, 3:], return_index=True)
    for node, position in zip(edge_nodes, centre + middle.reshape(-1, 3)[first], strict=True):
        gmsh.model.mesh.setNode(node, position, [])


def _meshed(cells: str) -> Solid:
    """The current model's second-order cells."""
    tags, x, _ = gmsh.model.mesh.getNodes()
    row = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    row[tags] = np.arange(len(tags))
    nodes = gmsh.model.mesh.getElementsByType(_GMSH_CELLS[CELLS[cells]])[1]
    order = GMSH_TET if cells == "tet" else np.argsort(GMSH_HEX)
    rows = row[nodes].reshape(-1, 10 if cells == "tet" else 27)
    return Solid(x.reshape(-1, 3), rows[:, order], cells)


def _place_centre_nodes(mesh: Mesh) -> None:
    """Move face and cell centres of 27-node hexahedra to the 20-node interpolation."""
    topology = basix.topology(basix.CellType.hexahedron)
    edges = {frozenset(edge): 8 + i for i, edge in enumerate(topology[1])}
    nodes = compat.geometry_dofmap(mesh)
    x = mesh.geometry.x
    for i, face in enumerate(topology[2]):
        sides = [number for edge, number in edges.items() if edge <= set(face)]
        corners, middles = (x[nodes[:, part]].sum(axis=1) for part in (face, sides))
        x[nodes[:, 20 + i]] = -0.25 * corners + 0.5 * middles
    x[nodes[:, 26]] = -0.25 * x[nodes[:, :8]].sum(axis=1) + 0.25 * x[nodes[:, 8:20]].sum(axis=1)
