"""Gmsh models to dolfinx meshes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import fenics_ehd.base.petsc_start  # noqa: F401  # isort: skip
import numpy as np
from dolfinx.mesh import Mesh
from mpi4py import MPI

from fenics_ehd.base import compat
from fenics_ehd.base.errors import MeshError
from fenics_ehd.base.processes import interrupt_kept
from fenics_ehd.fem.elements import solid_element
from fenics_ehd.fem.faces import cylinder_centre, rounded_middles
from fenics_ehd.fem.gmsh_session import (
    HEXAHEDRON_27,
    SWITCH,
    TETRAHEDRON_10,
    TRIANGLE_6,
    nodes_of_cells,
    numbered_nodes,
    opened_model,
)
from fenics_ehd.fem.solid import Solid, require_sound_cells
from fenics_ehd.reduction.bore import BORE

with interrupt_kept():
    import gmsh

#: Cells that can be asked for, by their short names.
CELLS = {"hex": HEXAHEDRON_27, "tet": TETRAHEDRON_10}


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


def _found_cells(path: str | Path, asked: str) -> str:
    """Kind of cells that the current model holds, ``"hex"`` or ``"tet"``, and no other solids."""
    found = set(gmsh.model.mesh.getElementTypes(3))
    if not found:
        raise MeshError(f"model {path} gives no solid cells: check its numbers of cells")
    kind = next((name for name in CELLS if found == {CELLS[name]}), None)
    if kind is None:
        kinds = ", ".join(gmsh.model.mesh.getElementProperties(cell)[0] for cell in sorted(found))
        raise MeshError(f"model {path} holds {kinds}: mesh it with hexahedra or tetrahedra alone")
    if asked == "tet" != kind:
        raise MeshError(
            f"model {path} gives no tetrahedra: it needs a parameter {SWITCH} for cells = 'tet'"
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
    size: float = 1.0,
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
    size
        Of a model's cells over what it says, where they are not counted.

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
    with ExitStack() as model:
        if comm.rank == 0:
            try:
                opened = opened_model(Path(path), parameters or {}, cells, size)
                groups = model.enter_context(opened)
                cells = _found_cells(path, cells)
                if cells == "tet":
                    for bore in bores:
                        _round_bore(groups.get(bore))
                points, row = numbered_nodes()
                solid = Solid(points, row[nodes_of_cells(CELLS[cells])], cells)
                require_sound_cells(solid, path)
            except MeshError as error:
                failure = str(error)
        failure, groups, cells = comm.bcast((failure, groups, cells))
        if failure:
            raise MeshError(failure)
        mesh, cell_tags, facet_tags = compat.model_to_mesh(gmsh.model, comm)
    if serendipity_geometry and cells == "hex":
        _place_centre_nodes(mesh)
    return PartMesh(mesh, cell_tags, facet_tags, groups)


def _round_bore(group: int | None) -> None:
    """Put mid-side nodes of the bore's triangles on the cylinder, as `rounded_middles`."""
    if group is None:
        return
    x, row = numbered_nodes()
    entities = gmsh.model.getEntitiesForPhysicalGroup(2, group)
    triangles = np.vstack([nodes_of_cells(TRIANGLE_6, entity) for entity in entities])
    corners = x[row[triangles[:, :3]]]
    centre = cylinder_centre(corners.reshape(-1, 3))
    middle = rounded_middles(corners - centre)
    edge_nodes, first = np.unique(triangles[:, 3:], return_index=True)
    for node, position in zip(edge_nodes, centre + middle.reshape(-1, 3)[first], strict=True):
        gmsh.model.mesh.setNode(node, position, [])


def _place_centre_nodes(mesh: Mesh) -> None:
    """Move face and cell centres of 27-node hexahedra to the 20-node interpolation."""
    centres = solid_element("hexahedron", 27).nodes[20:]
    shapes = solid_element("hexahedron", 20).shapes(centres)
    nodes, x = compat.geometry_dofmap(mesh), mesh.geometry.x
    x[nodes[:, 20:]] = shapes @ x[nodes[:, :20]]
