"""Elastic parts with lubricated bores: from a Gmsh model to the matrices for a reduction.

A bore has two surface meshes, one for displacement and one for pressure. A surface mesh consists of
the nodes of a function space on the surface of the bore, and of the cells that these nodes form.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import fenics_ehd.base.gmsh_start  # isort: skip
import fenics_ehd.base.petsc_start  # noqa: F401  # isort: skip
from functools import partial

import gmsh
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh
from mpi4py import MPI
from petsc4py import PETSc

from fenics_ehd.base import compat
from fenics_ehd.base.arguments import require_class, require_number, require_word
from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import MeshError, StructureError
from fenics_ehd.base.shared_settings import Material
from fenics_ehd.fem.elements import FAMILIES, quadratic_element, solid_element
from fenics_ehd.fem.faces import cylinder_centre, rounded_middles
from fenics_ehd.fem.gmsh_session import (
    HEXAHEDRON_27,
    QUADRILATERAL_9,
    SWITCH,
    TETRAHEDRON_10,
    TRIANGLE_6,
    cell_name,
    nodes_of_cells,
    numbered_nodes,
    opened_model,
)
from fenics_ehd.fem.solid import Solid, require_sound_cells
from fenics_ehd.fem.stress import StressField, hooke
from fenics_ehd.reduction.bore import (
    BORE,
    CYLINDER_TOLERANCE,
    Bore,
    in_order,
    mean_motion,
    require_cylinder,
    surface_gram,
)
from fenics_ehd.reduction.matrices import inner, multiply, some_columns
from fenics_ehd.reduction.mesh_error import SmoothResponses, smooth_responses
from fenics_ehd.reduction.static import StaticSolver, mean_diagonal
from fenics_ehd.reduction.structure import Recovery, Structure

#: Gmsh's type of the cells, by their names in scenes.
CELLS = {"hex": HEXAHEDRON_27, "tet": TETRAHEDRON_10}

#: Gmsh's type of the facets of these cells, and number of corners of a facet.
FACETS = {"hex": (QUADRILATERAL_9, 4), "tet": (TRIANGLE_6, 3)}


@dataclass(frozen=True, eq=False)
class PartMesh(Described):
    """Second-order mesh of hexahedra or tetrahedra, with its facet tags and named groups.

    Attributes
    ----------
    mesh
        Distributed dolfinx mesh.
    facet_tags
        Facets that belong to named surfaces, with the group number of each.
    groups
        Numbers of the physical groups by name.
    """

    mesh: Mesh
    facet_tags: compat.MeshTags
    groups: Mapping[str, int]

    @property
    def cell(self) -> str:
        """Name of the cells, ``"hexahedron"`` or ``"tetrahedron"``."""
        return self.mesh.topology.cell_type.name

    def group(self, name: str) -> int:
        """Number of a named physical group.

        Raises
        ------
        MeshError
            If the model has no group of this name.
        """
        if name not in self.groups:
            raise MeshError(
                f"the mesh has no physical group {name!r} (it has {', '.join(self.groups)}): "
                f"name the surface in the Gmsh model, Physical Surface({name!r})"
            )
        return self.groups[name]


def _kind_of_cells(path: str | Path, asked: str) -> str:
    """Kind of the current model's cells, ``"hex"`` or ``"tet"``.

    Raises
    ------
    MeshError
        If the model has no solid cells, or cells of another kind or of several kinds; if it has no
        physical volume; or if tetrahedra were requested and the model has none.
    """
    kinds = set(gmsh.model.mesh.getElementTypes(3))
    if not kinds:
        raise MeshError(f"model {path} gives no solid cells: check its numbers of cells")
    kind = next((name for name in CELLS if kinds == {CELLS[name]}), None)
    if kind is None:
        types, numbers, _ = gmsh.model.mesh.getElements(3)
        counts = zip(types, numbers, strict=True)
        cells = ", ".join(f"{len(tags)} {cell_name(cell)}" for cell, tags in counts)
        raise MeshError(
            f"model {path} has {cells}: it must have only 27-node hexahedra or only 10-node "
            "tetrahedra; 'fenics-ehd part' converts other meshes of one kind"
        )
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
        Path of a ``.geo`` model, which is a program that Gmsh runs, or of a ``.msh`` file.
    parameters
        Values for the model's ``DefineConstant`` parameters, by name.
    comm
        Communicator of the ranks over which the mesh is distributed.
    serendipity_geometry
        Whether nodes at face and cell centres of hexahedra are moved to the positions that are
        interpolated from the 20 corner and edge nodes. A 20-node displacement element needs this to
        represent linear fields exactly.
    cells
        ``"hex"`` or ``"tet"``, for a model that has the parameter ``tetrahedra``.
    bores
        Names of surfaces on cylinders along z. Their mid-side nodes are moved to the cylinder,
        half way between the corners in angle and height. In a ``.geo`` model, only nodes of
        tetrahedra are moved.
    size
        Factor by which cell sizes are multiplied; for a model that has no parameters for numbers
        of cells.

    Returns
    -------
    PartMesh
        Distributed mesh with the numbers of its groups.

    Raises
    ------
    MeshError
        If Gmsh cannot read or mesh the model, if its cells are of several kinds, or if tetrahedra
        are requested and the model has none.
    """
    require_class("path", path, str, Path)
    require_class("comm", comm, MPI.Comm)
    require_word("cells", cells, tuple(CELLS))
    require_number("size", size, above=0)
    require_class("bores", bores, tuple, list)
    groups = None
    failure = None
    with ExitStack() as model:
        if comm.rank == 0:
            try:
                opened = opened_model(Path(path), parameters or {}, cells, size)
                groups = model.enter_context(opened)
                cells = _kind_of_cells(path, cells)
                for bore in groups.keys() & set(bores):
                    if cells == "tet" or Path(path).suffix == ".msh":
                        _round_bore(groups[bore], cells)
                points, row = numbered_nodes()
                solid = Solid(points, row[nodes_of_cells(CELLS[cells])], cells)
                require_sound_cells(solid, path)
            except MeshError as error:
                failure = str(error)
        failure, groups, cells = comm.bcast((failure, groups, cells))
        if failure:
            raise MeshError(failure)
        mesh, _, facet_tags = compat.model_to_mesh(gmsh.model, comm)
    if serendipity_geometry and cells == "hex":
        _place_centre_nodes(mesh)
    return PartMesh(mesh, facet_tags, groups)


def _round_bore(group: int, cells: str) -> None:
    """Move mid-side nodes of a bore's facets to the cylinder, see `rounded_middles`.

    Nodes of hexahedra that are on the cylinder already are not changed at all. Only nodes of
    straight edges, and facet centres between them, are moved.
    """
    x, row = numbered_nodes()
    entities = gmsh.model.getEntitiesForPhysicalGroup(2, group)
    facet, count = FACETS[cells]
    facets = np.vstack([nodes_of_cells(facet, entity) for entity in entities])
    corners = x[row[facets[:, :count]]]
    centre = cylinder_centre(corners.reshape(-1, 3))
    middle = rounded_middles(corners - centre)
    if cells == "hex":
        opposite = np.stack([middle[:, 0], middle[:, 2]], axis=1)
        middle = np.concatenate([middle, rounded_middles(opposite)[:, :1]], axis=1)
    edge_nodes, first = np.unique(facets[:, count:], return_index=True)
    positions = centre + middle.reshape(-1, 3)[first]
    if cells == "hex":
        distances, radii = (
            np.linalg.norm((nodes - centre)[:, :2], axis=1)
            for nodes in (x[row[edge_nodes]], positions)
        )
        moved = np.abs(distances - radii) > CYLINDER_TOLERANCE * radii
        edge_nodes = edge_nodes[moved]
        positions = positions[moved]
    for node, position in zip(edge_nodes, positions, strict=True):
        gmsh.model.mesh.setNode(node, position, [])


def _place_centre_nodes(mesh: Mesh) -> None:
    """Interpolate positions of nodes at face and cell centres of hexahedra from the other nodes."""
    centres = solid_element("hexahedron", 27).nodes[20:]
    shapes = solid_element("hexahedron", 20).shapes(centres)
    nodes = compat.geometry_dofmap(mesh)
    x = mesh.geometry.x
    x[nodes[:, 20:]] = shapes @ x[nodes[:, :20]]


# Matrices

#: Degrees of the quadrature rules for stiffness, mass and surface loads. On straight hexahedra,
#: 3 Gauss points in each direction integrate the stiffness of both families exactly, and on a
#: cylinder the bore load; the mass of a triquadratic field needs 4. On curved tetrahedra, mass and
#: load have degree 4 + 3 and 4 + 2; the stiffness is rational, and of degree 2 on straight ones.
DEGREES = {
    "hexahedron": {"stiffness": 5, "mass": 6, "surface": 5},
    "tetrahedron": {"stiffness": 5, "mass": 7, "surface": 6},
}

#: Indices in dolfinx's order of the nodes of a quadratic cell, in VTK's order: corners, then edges.
_VTK_ORDER = {
    "hexahedron": [0, 1, 3, 2, 4, 5, 7, 6, 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 15, 14],
    "tetrahedron": [0, 1, 2, 3, 9, 6, 8, 7, 5, 4],
}


def assemble_structure(
    part: PartMesh,
    material: Material,
    *,
    family: str = "serendipity",
    pressure_family: str = "lagrange",
    bores: Sequence[str] = (BORE,),
    attachments: tuple[str, ...] = ("pin",),
    clamped: str | None = None,
) -> Structure:
    """Assemble K and M of a part, load matrices of its bores and load vectors of its points.

    Parameters
    ----------
    part
        Mesh of the part with named groups.
    material
        Elastic constants and density of the part.
    family
        Family of the displacement element: ``"serendipity"`` (20-node hexahedra) or
        ``"lagrange"`` (27-node hexahedra). Tetrahedra always have 10 nodes.
    pressure_family
        Family of the pressure shape functions in equation (15) of the paper; a film with a matching
        mesh has the same family.
    bores, attachments
        Names of the lubricated surfaces, the first with z as axis; and names of the surfaces whose
        mean displacements are the displacements of the boundary points.
    clamped
        Name of the surface at which the part is clamped; None if the part is free.

    Returns
    -------
    Structure
        Structure whose matrix rows are distributed over the ranks of the mesh.

    Raises
    ------
    MeshError
        If a named surface is missing or empty, or if a bore is not a cylinder along z.
    """
    require_class("part", part, PartMesh)
    require_class("material", material, Material)
    require_word("family", family, FAMILIES)
    require_word("pressure_family", pressure_family, FAMILIES)
    mesh = part.mesh
    cell = part.cell
    space = compat.functionspace(mesh, quadratic_element(family, cell, (3,)))
    pressures = compat.functionspace(mesh, quadratic_element(pressure_family, cell))
    names = (*bores, *attachments, *(() if clamped is None else (clamped,)))
    surfaces = {name: part.group(name) for name in names}
    for name, tag in surfaces.items():
        if not mesh.comm.allreduce(len(part.facet_tags.find(tag)), op=MPI.SUM):
            raise MeshError(
                f"physical group {name!r} has no facets of the mesh: assign a surface to it"
            )
    ds = ufl.Measure("ds", domain=mesh, subdomain_data=part.facet_tags)
    stiffness, mass = _elastic_matrices(space, material)
    if clamped is not None:
        _clamp(space, part.facet_tags.find(surfaces[clamped]), stiffness, mass)
    index_map = space.dofmap.index_map
    return Structure(
        stiffness=stiffness,
        mass=mass,
        coordinates=space.tabulate_dof_coordinates()[: index_map.size_local].copy(),
        bores={
            name: _bore(part, space, pressures, name, ds, first=not index)
            for index, name in enumerate(bores)
        },
        attachments={name: _mean_displacement(space, ds(surfaces[name])) for name in attachments},
        recovery=_recovery(space, material),
        owner=mesh,
    )


def _elastic_matrices(space: fem.FunctionSpace, material: Material) -> tuple[PETSc.Mat, PETSc.Mat]:
    """Stiffness matrix K and mass matrix M of equation (16) of the paper."""
    u = ufl.TrialFunction(space)
    v = ufl.TestFunction(space)
    dx = ufl.Measure("dx", domain=space.mesh)
    work = ufl.inner(hooke(u, material), ufl.sym(ufl.grad(v)))
    energy = work * dx(metadata=_rule(space, "stiffness"))
    inertia = material.density * ufl.inner(u, v) * dx(metadata=_rule(space, "mass"))
    return _matrix(energy), _matrix(inertia)


def _clamp(
    space: fem.FunctionSpace, facets: np.ndarray, stiffness: PETSc.Mat, mass: PETSc.Mat
) -> None:
    """Clamp the nodes of a surface: in K and M, set their off-diagonal entries to zero.

    Rows of zeros would make both matrices singular. The diagonal entries of K are therefore set to
    the mean of its diagonal. The diagonal entries of M are set so that the total mass is unchanged.
    """
    nodes = fem.locate_dofs_topological(space, space.mesh.topology.dim - 1, facets)
    nodes = nodes[nodes < space.dofmap.index_map.size_local]
    held = (3 * nodes[:, None] + np.arange(3)).ravel()
    comm = space.mesh.comm
    ones = np.ones((mass.local_size[0], 1))
    cut = inner(ones, multiply(mass, ones), comm)[0, 0]
    ones[held] = 0.0
    cut -= inner(ones, multiply(mass, ones), comm)[0, 0]
    rows = (held + mass.getOwnershipRange()[0]).astype(np.int32)
    stiffness.zeroRowsColumns(rows, diag=mean_diagonal(stiffness))
    mass.zeroRowsColumns(rows, diag=cut / comm.allreduce(len(held), op=MPI.SUM))


def _rule(space: fem.FunctionSpace, integral: str) -> dict[str, int]:
    """Metadata of a UFL measure with the quadrature degree of an integral, see `DEGREES`."""
    return {"quadrature_degree": DEGREES[space.mesh.topology.cell_type.name][integral]}


def _matrix(form: ufl.Form) -> PETSc.Mat:
    """Assemble a bilinear form."""
    matrix = compat.fem_petsc().assemble_matrix(fem.form(form))
    matrix.assemble()
    return matrix


def _vector(form: ufl.Form) -> PETSc.Vec:
    """Assemble a linear form."""
    vector = compat.fem_petsc().assemble_vector(fem.form(form))
    vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    return vector


def _mean_displacement(
    space: fem.FunctionSpace, surface: ufl.Measure
) -> tuple[PETSc.Vec, PETSc.Vec, PETSc.Vec]:
    """Vectors that give the mean displacement of a surface, weighted by area.

    The product of the i-th vector with the nodal displacements is component i of the mean.
    """
    v = ufl.TestFunction(space)
    mesh = space.mesh
    one = fem.Constant(mesh, PETSc.ScalarType(1.0))
    # With the same quadrature rule for the area, the mean of a constant is exactly the constant.
    surface = surface(metadata=_rule(space, "surface"))
    area = mesh.comm.allreduce(fem.assemble_scalar(fem.form(one * surface)), op=MPI.SUM)
    return tuple(_vector(v[i] / area * surface) for i in range(3))


def _bore(
    part: PartMesh,
    space: fem.FunctionSpace,
    pressures: fem.FunctionSpace,
    name: str,
    ds: ufl.Measure,
    *,
    first: bool,
) -> Bore:
    """Make a bore: nodes, surface meshes of displacement and pressure, load matrix, mean motion.

    Raises
    ------
    MeshError
        If the surface is not a cylinder along z.
    """
    tag = part.group(name)
    facets = part.facet_tags.find(tag)
    # The centre of the first bore is exactly the origin of the part.
    centre = np.zeros(3) if first else cylinder_centre(surface_nodes(space, facets)[1])
    nodes, x, cells = surface_mesh(space, facets, centre)
    loaded, pressure_x, pressure_cells = surface_mesh(pressures, facets, centre)
    family = _FAMILIES[cells.shape[1]]
    try:
        radius = require_cylinder(x, cells, family, nodes, f"the {name}")
    except StructureError as error:
        raise MeshError(str(error)) from None
    return Bore(
        radius=radius,
        width=float(np.ptp(x[:, 2])),
        nodes=nodes,
        coordinates=x,
        pressure_coordinates=pressure_x,
        load=_load_matrix(space, pressures, loaded, ds(tag)),
        cells=cells,
        family=family,
        pressure_cells=pressure_cells,
        pressure_family=_FAMILIES[pressure_cells.shape[1]],
        reference=mean_motion(x, surface_gram(x, cells, family)),
        centre=centre,
    )


def _load_matrix(
    space: fem.FunctionSpace,
    pressures: fem.FunctionSpace,
    pressure_nodes: np.ndarray,
    surface: ufl.Measure,
) -> PETSc.Mat:
    """Assemble the load matrix, equation (15) of the paper, with one column per pressure node.

    The outward normal of the solid points into the oil: a positive pressure acts against it.
    """
    p = ufl.TrialFunction(pressures)
    v = ufl.TestFunction(space)
    normal = ufl.FacetNormal(space.mesh)
    surface = surface(metadata=_rule(space, "surface"))
    return some_columns(_matrix(-p * ufl.inner(normal, v) * surface), pressure_nodes)


def _recovery(space: fem.FunctionSpace, material: Material) -> Recovery:
    """Make the data for stresses: corner and edge nodes of this rank's cells, and a function.

    The function makes a `StressField` from displacement fields.
    """
    topology = space.mesh.topology
    cells = topology.index_map(topology.dim).size_local
    dofs = compat.space_dofmap(space)[:cells, _VTK_ORDER[topology.cell_type.name]]
    numbers = space.dofmap.index_map.local_to_global(dofs.ravel().astype(np.int32))
    return Recovery(np.asarray(numbers).reshape(dofs.shape), partial(StressField, space, material))


# Surfaces

#: Families of surface cells by their numbers of nodes.
_FAMILIES = {8: "serendipity", 9: "lagrange", 6: "triangle"}


def surface_mesh(
    space: fem.FunctionSpace, facets: np.ndarray, centre: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes of a quadratic function space on the surface of a bore, and the cells they form.

    The result is the same on every rank.

    Parameters
    ----------
    space
        Function space of the part.
    facets
        Local indices of the facets of the surface, on the boundary of the part.
    centre
        Centre of the bore, shape (3,) [m].

    Returns
    -------
    nodes : numpy.ndarray
        Global node numbers, sorted by z, then by angle about the bore's axis, shape (m,).
    coordinates : numpy.ndarray
        Positions of the nodes relative to the bore's centre, shape (m, 3) [m].
    cells : numpy.ndarray
        Indices in `nodes` of the nodes of each cell, shape (c, 6, 8 or 9).
    """
    nodes, x = surface_nodes(space, facets)
    x = x - centre
    order, cells = in_order(nodes, x, _surface_cells(space, facets))
    cells = cells[np.lexsort(np.sort(cells, axis=1).T[::-1])]
    return nodes[order].astype(np.int32), x[order], cells


def surface_nodes(space: fem.FunctionSpace, facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Global numbers, shape (m,), and positions, shape (m, 3) [m], of the nodes of a surface.

    The result is the same on every rank.
    """
    comm = space.mesh.comm
    dofs = fem.locate_dofs_topological(space, space.mesh.topology.dim - 1, facets)
    owned = dofs[dofs < space.dofmap.index_map.size_local]
    nodes = np.concatenate(comm.allgather(space.dofmap.index_map.local_range[0] + owned))
    x = np.vstack(comm.allgather(space.tabulate_dof_coordinates()[owned]))
    return nodes, x


def _surface_cells(space: fem.FunctionSpace, facets: np.ndarray) -> np.ndarray:
    """Global node numbers of the facets of all ranks, shape (c, k); facets are not sorted."""
    topology = space.mesh.topology
    dimension = topology.dim
    topology.create_connectivity(dimension - 1, dimension)
    topology.create_connectivity(dimension, dimension - 1)
    to_cell = topology.connectivity(dimension - 1, dimension)
    to_facet = topology.connectivity(dimension, dimension - 1)
    cells = np.array([to_cell.links(facet)[0] for facet in facets], dtype=np.int64)
    # Only facets of cells that this rank owns: each facet then occurs once over all ranks.
    owned = cells < topology.index_map(dimension).size_local
    cells = cells[owned]
    facets = facets[owned]
    sides = [
        list(to_facet.links(cell)).index(facet) for cell, facet in zip(cells, facets, strict=True)
    ]
    # Local dofs of each side of a cell, in the order of a surface cell: corners, midpoints, centre.
    layout = space.dofmap.dof_layout
    count = to_facet.links(0).size
    rows = np.array([layout.entity_closure_dofs(dimension - 1, i) for i in range(count)])
    local = compat.space_dofmap(space)[cells[:, None], rows[np.array(sides, dtype=np.int64)]]
    numbers = space.dofmap.index_map.local_to_global(local.ravel().astype(np.int32))
    gathered = space.mesh.comm.allgather(np.asarray(numbers).reshape(local.shape))
    return np.concatenate(gathered)


def part_responses(
    path: Path,
    material: Material,
    bores: Sequence[str],
    clamped: str | None,
    parameters: Mapping[str, float] | None = None,
    points: tuple[str, ...] = (),
) -> tuple[Structure, SmoothResponses]:
    """Assemble a model on one rank, and compute responses to smooth pressures on its bores.

    Raises
    ------
    MeshError, StructureError, VerificationError
        If the model is not a valid part.
    """
    mesh = build_mesh(path, parameters, comm=MPI.COMM_SELF, bores=bores)
    structure = assemble_structure(mesh, material, bores=bores, attachments=points, clamped=clamped)
    return structure, smooth_responses(StaticSolver(structure))
