"""Elastic part with lubricated bores: dolfinx matrices for the reduction.

A bore's surface is a mesh of its own: nodes of a space there and the cells they make.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import fenics_ehd.base.petsc_start  # noqa: F401  # isort: skip
import basix
import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc
from ufl.core.expr import Expr

from fenics_ehd.base import compat
from fenics_ehd.base.errors import MeshError, StructureError
from fenics_ehd.fem.cylinder_fit import cylinder_centre
from fenics_ehd.fem.elements import quadratic_element
from fenics_ehd.fem.geometry import PartMesh
from fenics_ehd.fem.material import Material
from fenics_ehd.fem.stress import stress_operator
from fenics_ehd.reduction.bore import BORE, Bore, mean_motion
from fenics_ehd.reduction.bore_holes import area_vector, bore_holes
from fenics_ehd.reduction.faces import surface_gram
from fenics_ehd.reduction.structure import Recovery, Structure


@dataclass(frozen=True)
class QuadratureDegrees:
    """Degrees of the rules for elastic energy, kinetic energy and surface loads."""

    stiffness: int
    mass: int
    surface: int


#: 3 Gauss points a direction integrate the elastic energy of both families on
#: straight hexahedra and the bore load on a cylinder exactly; the mass of a
#: triquadratic field needs 4. On curved tetrahedra mass and load are of degree
#: 4 + 3 and 4 + 2; the energy is rational there, and of degree 2 on straight ones.
DEGREES = {
    "hexahedron": QuadratureDegrees(stiffness=5, mass=6, surface=5),
    "tetrahedron": QuadratureDegrees(stiffness=5, mass=7, surface=6),
}

#: Largest distance of a bore node from the cylinder, relative to its radius.
CYLINDER_TOLERANCE = 1e-6

#: Largest difference of the areas within both ends of a bore, relative to the squared radius:
#: with parabolas in place of arcs 6e-5 is lacking at 20 cells around, and ends may differ in cells.
END_TOLERANCE = 1e-4

#: Corner, edge order of VTK's quadratic cells in dolfinx's node numbers.
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
    """Assemble K, M, the bore load matrix and the attachment loads.

    Parameters
    ----------
    part
        Mesh with the named groups.
    material
        Elastic constants and density.
    family
        ``"serendipity"``: 20-node hexahedra, ``"lagrange"``: 27-node ones;
        tetrahedra have 10 nodes.
    pressure_family
        Family of the pressure shape functions in (15), that of a matching film.
    bores, attachments
        Names of the lubricated surfaces, the first about the z axis, and of the boundary points'
        surfaces.
    clamped
        Name of a surface that is held; None: the part is free.

    Returns
    -------
    Structure
        Rows distributed over the ranks of the mesh.

    Raises
    ------
    MeshError
        A named surface is missing or empty, or a bore is not a cylinder along z.
    """
    mesh = part.mesh
    cell = part.cell
    space = compat.functionspace(mesh, quadratic_element(family, cell, (3,)))
    pressures = compat.functionspace(mesh, quadratic_element(pressure_family, cell))
    names = (*bores, *attachments, *(() if clamped is None else (clamped,)))
    surfaces = {name: part.group(name) for name in names}
    for name, tag in surfaces.items():
        if not mesh.comm.allreduce(len(part.facet_tags.find(tag)), op=MPI.SUM):
            raise MeshError(f"physical group {name!r} holds no facets of the mesh")
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
            name: _bore(part, space, pressures, name, ds, first=not place)
            for place, name in enumerate(bores)
        },
        attachments={name: _mean_displacement(space, ds(surfaces[name])) for name in attachments},
        recovery=_recovery(space, material),
        owner=mesh,
    )


def _elastic_matrices(space: fem.FunctionSpace, material: Material) -> tuple[PETSc.Mat, PETSc.Mat]:
    """K and M of (16)."""
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    modulus, ratio = material.youngs_modulus, material.poissons_ratio
    mu = modulus / (2 * (1 + ratio))
    lame = modulus * ratio / ((1 + ratio) * (1 - 2 * ratio))

    def strain(w: Expr) -> Expr:
        return ufl.sym(ufl.grad(w))

    stress = 2 * mu * strain(u) + lame * ufl.tr(strain(u)) * ufl.Identity(3)
    dx = ufl.Measure("dx", domain=space.mesh)
    degrees, key = _degrees(space), "quadrature_degree"
    energy = ufl.inner(stress, strain(v)) * dx(metadata={key: degrees.stiffness})
    inertia = material.density * ufl.inner(u, v) * dx(metadata={key: degrees.mass})
    return _matrix(energy), _matrix(inertia)


def _clamp(
    space: fem.FunctionSpace, facets: np.ndarray, stiffness: PETSc.Mat, mass: PETSc.Mat
) -> None:
    """Hold the nodes of a surface: coupled to nothing, they keep a stiffness and a mass.

    Rows of zeros would leave both matrices singular. The stiffness is the mean one, the mass the
    one that is cut off with the couplings, so that the part keeps its own.
    """
    nodes = fem.locate_dofs_topological(space, space.mesh.topology.dim - 1, facets)
    nodes = nodes[nodes < space.dofmap.index_map.size_local]
    held = (3 * nodes[:, None] + np.arange(3)).ravel()
    count = mass.comm.tompi4py().allreduce(len(held), op=MPI.SUM)
    one, product = mass.createVecs()
    one.set(1.0)
    mass.mult(one, product)
    cut = one.dot(product)
    one.array[held] = 0.0
    mass.mult(one, product)
    cut -= one.dot(product)
    diagonal = stiffness.getDiagonal()
    mean = diagonal.sum() / diagonal.getSize()
    for vector in (one, product, diagonal):
        vector.destroy()
    rows = (held + mass.getOwnershipRange()[0]).astype(np.int32)
    stiffness.zeroRowsColumns(rows, diag=mean)
    mass.zeroRowsColumns(rows, diag=cut / count)


def _degrees(space: fem.FunctionSpace) -> QuadratureDegrees:
    return DEGREES[space.mesh.topology.cell_type.name]


def _matrix(form: ufl.Form) -> PETSc.Mat:
    matrix = compat.fem_petsc().assemble_matrix(fem.form(form))
    matrix.assemble()
    return matrix


def _vector(form: ufl.Form) -> PETSc.Vec:
    vector = compat.fem_petsc().assemble_vector(fem.form(form))
    vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    return vector


def _mean_displacement(
    space: fem.FunctionSpace, surface: ufl.Measure
) -> tuple[PETSc.Vec, PETSc.Vec, PETSc.Vec]:
    """Area-weighted mean of each displacement component over a surface, as load vectors."""
    v = ufl.TestFunction(space)
    mesh = space.mesh
    one = fem.Constant(mesh, PETSc.ScalarType(1.0))
    # The same rule for the area: the mean of a constant is that constant.
    surface = surface(metadata={"quadrature_degree": _degrees(space).surface})
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
    """Bore nodes, surface meshes of displacement and pressure, and the load matrix."""
    tag = part.group(name)
    facets = part.facet_tags.find(tag)
    # The first bore's centre is the origin of the part, to the last bit.
    centre = np.zeros(3) if first else cylinder_centre(surface_nodes(space, facets)[1])
    own, loaded = (surface_mesh(s, facets, centre) for s in (space, pressures))
    radii = np.linalg.norm(own.coordinates[:, :2], axis=1)
    radius = radii.mean()
    deviation = np.abs(radii - radius).max() / radius
    if not deviation <= CYLINDER_TOLERANCE:
        raise MeshError(
            f"the {name} is not a cylinder about the z axis: a node lies {deviation:.1e} radii "
            f"off, above {CYLINDER_TOLERANCE:.0e}"
        )
    load = _load_matrix(space, pressures, loaded.nodes, ds(tag))
    _check_closed(name, own, load, radius)
    return Bore(
        radius=float(radius),
        width=float(np.ptp(own.coordinates[:, 2])),
        nodes=own.nodes,
        coordinates=own.coordinates,
        pressure_coordinates=loaded.coordinates,
        load=load,
        cells=own.cells,
        family=own.family,
        pressure_cells=loaded.cells,
        pressure_family=loaded.family,
        reference=mean_motion(
            own.coordinates, surface_gram(own.coordinates, own.cells, own.family)
        ),
        centre=centre,
    )


def _load_matrix(
    space: fem.FunctionSpace,
    pressures: fem.FunctionSpace,
    pressure_nodes: np.ndarray,
    surface: ufl.Measure,
) -> PETSc.Mat:
    """Rectangular load matrix (15) with the columns of the given pressure nodes.

    The outward normal of the solid points to the oil, so a positive pressure
    pushes along its negative.
    """
    p, v = ufl.TrialFunction(pressures), ufl.TestFunction(space)
    normal = ufl.FacetNormal(space.mesh)
    surface = surface(metadata={"quadrature_degree": _degrees(space).surface})
    whole = _matrix(-p * ufl.inner(normal, v) * surface)
    share = np.array_split(np.arange(len(pressure_nodes)), space.mesh.comm.size)
    mine = share[space.mesh.comm.rank]
    rows = PETSc.IS().createStride(
        whole.local_size[0], whole.getOwnershipRange()[0], 1, comm=whole.comm
    )
    columns = PETSc.IS().createGeneral(pressure_nodes[mine], comm=whole.comm)
    return whole.createSubMatrix(rows, columns)


def _check_closed(name: str, own: SurfaceMesh, load: PETSc.Mat, radius: float) -> None:
    """The bore must be a whole cylinder but for holes, half of it on either side of z = 0."""
    x = own.coordinates
    middle = 0.5 * (x[:, 2].min() + x[:, 2].max())
    if not abs(middle) <= CYLINDER_TOLERANCE * radius:
        raise MeshError(f"the {name} must be centred at z = 0, its middle is at z = {middle:.3e} m")
    ones, force = load.createVecs()
    ones.set(1.0)
    load.mult(ones, force)
    comm = load.comm.tompi4py()
    net = comm.allreduce(force.array.reshape(-1, 3).sum(axis=0), op=MPI.SUM)
    limit = radius**2 * np.array([CYLINDER_TOLERANCE, CYLINDER_TOLERANCE, END_TOLERANCE])
    if not (np.abs(net) <= limit).all():
        try:
            holes = bore_holes(x, own.cells, own.family)
        except StructureError as error:
            raise MeshError(f"{name}: {error}") from None
        net = net + sum((area_vector(x, hole, own.family) for hole in holes), np.zeros(3))
    if not (np.abs(net) <= limit).all():
        raise MeshError(
            f"the {name} is not a whole cylinder: a constant pressure leaves a net force of "
            f"{np.abs(net).max():.1e} m2 times it"
        )


def _recovery(space: fem.FunctionSpace, material: Material) -> Recovery:
    """Owned cells with their corner and edge nodes, and the stresses in them."""
    topology = space.mesh.topology
    cells = topology.index_map(topology.dim).size_local
    dofs = compat.space_dofmap(space)[:cells, _VTK_ORDER[topology.cell_type.name]]
    numbers = space.dofmap.index_map.local_to_global(dofs.ravel().astype(np.int32))
    return Recovery(np.asarray(numbers).reshape(dofs.shape), stress_operator(space, material))


# Surfaces

#: Cell on the boundary of each solid cell.
_FACETS = {"hexahedron": "quadrilateral", "tetrahedron": "triangle"}

#: Family of a surface cell by its number of nodes.
_FAMILIES = {8: "serendipity", 9: "lagrange", 6: "triangle"}


@dataclass(frozen=True, eq=False)
class SurfaceMesh:
    """Nodes of a space on a bore's surface, the same on every rank.

    Attributes
    ----------
    nodes
        Global numbers, sorted by z, then angle about the bore's axis, shape (m,).
    coordinates
        From the bore's centre, shape (m, 3) [m].
    cells
        Positions in `nodes` of the nodes of each cell, shape (c, 6, 8 or 9).
    family
        ``"triangle"``, ``"serendipity"`` or ``"lagrange"``.
    """

    nodes: np.ndarray
    coordinates: np.ndarray
    cells: np.ndarray
    family: str


def surface_mesh(space: fem.FunctionSpace, facets: np.ndarray, centre: np.ndarray) -> SurfaceMesh:
    """Surface mesh of a quadratic space.

    Parameters
    ----------
    space
        Space on the part.
    facets
        Local facets of the surface, on the boundary of the part.
    centre
        Of the bore, shape (3,) [m].
    """
    nodes, x = surface_nodes(space, facets)
    x = x - centre
    radius = np.linalg.norm(x[:, :2], axis=1).mean()
    angle = np.mod(np.arctan2(x[:, 1], x[:, 0]) + 1e-9, 2 * np.pi)
    order = np.lexsort((np.round(angle, 6), np.round(x[:, 2] / radius, 6)))
    nodes, x = nodes[order].astype(np.int32), x[order]
    cells = _surface_cells(space, facets)
    order = np.argsort(nodes)
    cells = order[np.searchsorted(nodes, cells, sorter=order)]
    cells = cells[np.lexsort(np.sort(cells, axis=1).T[::-1])]
    return SurfaceMesh(nodes, x, cells, _FAMILIES[cells.shape[1]])


def surface_nodes(space: fem.FunctionSpace, facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Global numbers (m,) and positions (m, 3) of the nodes of a surface, on every rank."""
    comm = space.mesh.comm
    dofs = fem.locate_dofs_topological(space, space.mesh.topology.dim - 1, facets)
    owned = dofs[dofs < space.dofmap.index_map.size_local]
    nodes = np.concatenate(comm.allgather(space.dofmap.index_map.local_range[0] + owned))
    x = np.vstack(comm.allgather(space.tabulate_dof_coordinates()[owned]))
    return nodes, x


def facet_nodes(cell: str, size: int) -> np.ndarray:
    """Nodes of each face of a cell: corners, edge midpoints, centre, as on a surface cell.

    Parameters
    ----------
    cell
        ``"hexahedron"`` or ``"tetrahedron"``.
    size
        Nodes of the cell: 20 or 27, 10.

    Returns
    -------
    numpy.ndarray
        Node numbers in the cell, shape (faces, nodes of a face).
    """
    vertices, edges, faces = basix.topology(getattr(basix.CellType, cell))[:3]
    edge_node = {frozenset(edge): len(vertices) + i for i, edge in enumerate(edges)}
    sides = basix.topology(getattr(basix.CellType, _FACETS[cell]))[1]
    rows = [
        [*face, *(edge_node[frozenset(face[corner] for corner in side)] for side in sides)]
        for face in faces
    ]
    centres = len(vertices) + len(edges)
    if size > centres:
        rows = [[*row, centres + i] for i, row in enumerate(rows)]
    return np.array(rows)


def _surface_cells(space: fem.FunctionSpace, facets: np.ndarray) -> np.ndarray:
    """Global nodes of the facets, shape (c, k), in no particular order of cells."""
    topology = space.mesh.topology
    dimension = topology.dim
    topology.create_connectivity(dimension - 1, dimension)
    topology.create_connectivity(dimension, dimension - 1)
    to_cell = topology.connectivity(dimension - 1, dimension)
    to_facet = topology.connectivity(dimension, dimension - 1)
    cells = np.array([to_cell.links(facet)[0] for facet in facets], dtype=np.int64)
    # Each cell has one owner, so its facets are counted once.
    owned = cells < topology.index_map(dimension).size_local
    cells, facets = cells[owned], facets[owned]
    sides = [
        list(to_facet.links(cell)).index(facet) for cell, facet in zip(cells, facets, strict=True)
    ]
    dofs = compat.space_dofmap(space)
    rows = facet_nodes(topology.cell_type.name, dofs.shape[1])[np.array(sides, dtype=np.int64)]
    local = dofs[cells[:, None], rows]
    numbers = space.dofmap.index_map.local_to_global(local.ravel().astype(np.int32))
    gathered = space.mesh.comm.allgather(np.asarray(numbers).reshape(local.shape))
    return np.concatenate(gathered)
