"""Linear map from bore displacement to gap change at the points where the gap is watched."""

from __future__ import annotations

import basix
import numpy as np
from dolfinx.fem import FunctionSpace
from dolfinx.mesh import Mesh
from scipy import sparse

from fenics_ehd import compat
from fenics_ehd.elements import shape_functions
from fenics_ehd.film.forms import QUADRATURE_DEGREE


def _reference_points() -> np.ndarray:
    """Nodes of the 9-node cell and the Gauss points of the forms."""
    nodes = basix.geometry(basix.CellType.quadrilateral)
    edges = basix.topology(basix.CellType.quadrilateral)[1]
    centres = [nodes[edge].mean(axis=0) for edge in edges]
    gauss = basix.make_quadrature(basix.CellType.quadrilateral, QUADRATURE_DEGREE)[0]
    return np.vstack([nodes, centres, nodes.mean(axis=0), gauss])


def _normals(mesh: Mesh, points: np.ndarray) -> np.ndarray:
    """Outward normal of the discrete bore at reference points of every cell, (cells, points, 3)."""
    lagrange = basix.create_element(
        basix.ElementFamily.P, basix.CellType.quadrilateral, 2, basix.LagrangeVariant.equispaced
    )
    slopes = lagrange.tabulate(1, points)[1:3, :, :, 0]
    x = mesh.geometry.x[compat.geometry_dofmap(mesh)]
    tangents = np.einsum("dpi,cik->dcpk", slopes, x)
    normal = np.cross(tangents[0], tangents[1])
    return normal / np.linalg.norm(normal, axis=2)[:, :, None]


def gap_rows(space: FunctionSpace, family: str) -> sparse.csr_matrix:
    """Gap change per nodal displacement, ``n . u``, at nodes and Gauss points of every cell.

    Parameters
    ----------
    space
        Displacement space on the film mesh, blocked, with m nodes.
    family
        Its element family.

    Returns
    -------
    scipy.sparse.csr_matrix
        shape (cells * points, 3 m).
    """
    points = _reference_points()
    shape = shape_functions(family, points)
    normals = _normals(space.mesh, points)
    dofs = compat.space_dofmap(space)
    cells = len(dofs)
    columns = 3 * dofs[:, None, :, None] + np.arange(3)
    values = shape[None, :, :, None] * normals[:, :, None, :]
    columns = np.broadcast_to(columns, values.shape)
    rows = np.broadcast_to(np.arange(cells * len(points)).reshape(cells, -1, 1, 1), values.shape)
    size = 3 * (space.dofmap.index_map.size_local + space.dofmap.index_map.num_ghosts)
    return sparse.csr_matrix(
        (values.ravel(), (rows.ravel(), columns.ravel())), shape=(cells * len(points), size)
    )
