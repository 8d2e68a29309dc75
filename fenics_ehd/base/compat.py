"""Everything that differs between dolfinx versions, detected by feature at import.

Spelled as the newest version spells it. No other module tests a version.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import Any, TypeAlias

import fenics_ehd.base.petsc_start  # noqa: F401  # isort: skip
import basix
import numpy as np
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI

try:
    import basix.ufl as _basix_ufl
except ImportError:
    _basix_ufl = None
    from basix.ufl_wrapper import BasixElement as _BasixElement


#: For annotations: classes that every version names differently or keeps private.
Element: TypeAlias = Any
MeshTags: TypeAlias = Any


def model_to_mesh(
    model: Any, comm: MPI.Comm, rank: int = 0
) -> tuple[mesh.Mesh, MeshTags, MeshTags]:
    """Mesh, cell tags and facet tags of the current Gmsh model (held by `rank`)."""
    # Here, as Gmsh 4.8 takes Ctrl-C away from Python when it is imported: a run without a mesh
    # must not meet it.
    try:
        from dolfinx.io import gmsh as gmshio
    except ImportError:
        from dolfinx.io import gmshio
    return tuple(gmshio.model_to_mesh(model, comm, rank, gdim=3))[:3]


def _cell_in_space(cell: str) -> ufl.Cell:
    """UFL cell with geometric dimension 3: the old UFL asks elements on a surface for it."""
    return ufl.Cell(cell, geometric_dimension=3)


def lagrange_element(cell: str, degree: int, shape: tuple[int, ...] = ()) -> Element:
    """Nodal Lagrange element, blocked when `shape` is ``(3,)``."""
    if _basix_ufl is not None:
        return _basix_ufl.element("Lagrange", cell, degree, shape=shape)
    if shape:
        return ufl.VectorElement("Lagrange", _cell_in_space(cell), degree, dim=shape[0])
    return ufl.FiniteElement("Lagrange", _cell_in_space(cell), degree)


def custom_element(
    cell: str,
    wcoeffs: np.ndarray,
    x: Sequence[Sequence[np.ndarray]],
    interpolation: Sequence[Sequence[np.ndarray]],
    degree: int,
    superdegree: int,
    shape: tuple[int, ...] = (),
) -> Element:
    """Element from its polynomial span and point evaluations, blocked when `shape` is ``(3,)``."""
    cell_type = getattr(basix.CellType, cell)
    if _basix_ufl is not None:
        scalar = _basix_ufl.custom_element(
            cell_type,
            (),
            wcoeffs,
            x,
            interpolation,
            0,
            basix.MapType.identity,
            basix.SobolevSpace.H1,
            False,
            degree,
            superdegree,
        )
        return _basix_ufl.blocked_element(scalar, shape=shape) if shape else scalar
    scalar = _BasixElement(
        basix.create_custom_element(
            cell_type,
            [],
            wcoeffs,
            x,
            interpolation,
            0,
            basix.MapType.identity,
            False,
            degree,
            superdegree,
        )
    )
    scalar._cell = _cell_in_space(cell)
    return ufl.VectorElement(scalar, dim=shape[0]) if shape else scalar


def functionspace(domain: mesh.Mesh, element: Element) -> fem.FunctionSpace:
    """Function space on a mesh."""
    if hasattr(fem, "functionspace"):
        return fem.functionspace(domain, element)
    return fem.FunctionSpace(domain, element)


def _cell_rows(dofmap: Any, domain: mesh.Mesh) -> np.ndarray:
    """Rows of a dofmap, one for each local cell (ghosts included)."""
    cells = domain.topology.index_map(domain.topology.dim)
    raw = np.asarray(getattr(dofmap, "array", dofmap))
    return raw.reshape(cells.size_local + cells.num_ghosts, -1)


def geometry_dofmap(domain: mesh.Mesh) -> np.ndarray:
    """Geometry nodes of every local cell, shape (cells, nodes per cell)."""
    geometry = domain.geometry
    dofmap = geometry.dofmaps[0] if hasattr(geometry, "dofmaps") else geometry.dofmap
    return _cell_rows(dofmap, domain)


def space_dofmap(space: fem.FunctionSpace) -> np.ndarray:
    """Scalar dofs (block indices) of every local cell of a space, shape (cells, dofs)."""
    return _cell_rows(space.dofmap.list, space.mesh)


def fem_petsc() -> ModuleType:
    """Return `dolfinx.fem.petsc`, which 0.11 no longer imports by itself."""
    import dolfinx.fem.petsc as module

    return module
