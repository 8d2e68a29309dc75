"""A surface of a part as a mesh of its own: nodes of a space there and the cells they make."""

from __future__ import annotations

from dataclasses import dataclass

import fenics_ehd.base.petsc_start  # noqa: F401  # isort: skip
import basix
import numpy as np
from dolfinx import fem

from fenics_ehd.base import compat
from fenics_ehd.fem.cylinder_fit import fit_circle

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


def cylinder_centre(x: np.ndarray) -> np.ndarray:
    """Centre of the cylinder along z that nodes lie on, shape (m, 3) to (3,) [m]."""
    middle = x.mean(axis=0)
    middle[:2] += fit_circle(x[:, :2] - x[:, :2].mean(axis=0))[0]
    middle[2] = 0.5 * (x[:, 2].min() + x[:, 2].max())
    return middle


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
