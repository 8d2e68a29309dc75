"""Cauchy stresses of displacement fields of a part, where quadratic cells know them best.

Stresses are those of the finite-element displacement, ``sigma = C : sym(grad u)``, at points
inside the cells, neither extrapolated nor averaged: at the 2x2x2 Gauss points of hexahedra, where
they converge one order faster than elsewhere (Barlow, Int. J. Numer. Meth. Eng. 10, 1976), and at
the 4 points of the rule of degree 2 of tetrahedra.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import basix
import numpy as np
from mpi4py import MPI

from fenics_ehd.base import compat
from fenics_ehd.fem.elements import superlinear_degree
from fenics_ehd.fem.material import Material

if TYPE_CHECKING:
    from dolfinx import fem


#: Which of the owned cells.
Cells = slice | np.ndarray

#: Memory of the stresses computed at a time; what leads to them takes some five times as much.
_BLOCK_BYTES = 1 << 22

#: Derivatives, as 3 * direction + component, that each Voigt strain xx, yy, zz, yz, xz, xy sums.
_VOIGT = ((0, 0), (4, 4), (8, 8), (5, 7), (2, 6), (1, 3))


def sampling_points(cell: str) -> np.ndarray:
    """Reference points of the stresses in a cell, shape (8 or 4, 3)."""
    if cell == "hexahedron":
        return 0.5 + np.array(list(itertools.product((-0.5, 0.5), repeat=3))) / np.sqrt(3)
    inner = (5 - np.sqrt(5)) / 20
    return inner + np.vstack([np.zeros(3), (1 - 4 * inner) * np.eye(3)])


def _exponents(cell: str, size: int) -> np.ndarray:
    """Exponents of the monomials that a solid cell of `size` nodes spans, shape (size, 3)."""
    exponents = itertools.product(range(3), repeat=3)
    kept = {
        ("hexahedron", 8): lambda e: max(e) <= 1,
        ("hexahedron", 20): lambda e: superlinear_degree(e) <= 2,
        ("hexahedron", 27): lambda e: True,
        ("tetrahedron", 4): lambda e: sum(e) <= 1,
        ("tetrahedron", 10): lambda e: sum(e) <= 2,
    }[cell, size]
    return np.array([e for e in exponents if kept(e)])


def solid_shape_functions(
    cell: str, size: int, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Nodal shape functions of a solid cell and their derivatives.

    Parameters
    ----------
    cell, size
        ``"hexahedron"`` with 8, 20 or 27 nodes, ``"tetrahedron"`` with 4 or 10.
    points
        Reference points, shape (p, 3).

    Returns
    -------
    values : numpy.ndarray
        shape (p, size), nodes in dolfinx order.
    derivatives : numpy.ndarray
        By the reference coordinates, shape (p, 3, size).
    """
    exponents = _exponents(cell, size)
    nodal = np.linalg.inv(_monomials(_nodes(cell, size), exponents))
    derivatives = [
        2 * exponents[:, d] * _monomials(points, np.maximum(exponents - unit, 0)) @ nodal
        for d, unit in enumerate(np.eye(3, dtype=int))
    ]
    return _monomials(points, exponents) @ nodal, np.stack(derivatives, axis=1)


def _nodes(cell: str, size: int) -> np.ndarray:
    """Reference nodes of a solid cell in dolfinx order, shape (size, 3)."""
    kind = getattr(basix.CellType, cell)
    corners = basix.geometry(kind)
    entities = itertools.chain.from_iterable(basix.topology(kind))
    return np.array([corners[entity].mean(axis=0) for entity in entities])[:size]


def _monomials(x: np.ndarray, powers: np.ndarray) -> np.ndarray:
    """Monomials about the middle of the cube, better conditioned than about its corner."""
    return np.prod((2 * x[:, None, :] - 1) ** powers, axis=2)


def continuation(cell: str, size: int) -> np.ndarray:
    """Values at the nodes of a cell of the polynomial through its sampling points.

    Trilinear of hexahedra, linear of tetrahedra; shape (size, 8 or 4).
    """
    points = sampling_points(cell)
    exponents = _exponents(cell, len(points))
    return _monomials(_nodes(cell, size), exponents) @ np.linalg.inv(_monomials(points, exponents))


def _hooke(material: Material) -> np.ndarray:
    """Voigt stresses of the displacement derivatives 3 * direction + component, shape (6, 9)."""
    modulus, ratio = material.youngs_modulus, material.poissons_ratio
    shear = modulus / (2 * (1 + ratio))
    law = np.zeros((6, 9))
    for row, pair in enumerate(_VOIGT):
        for derivative in pair:
            law[row, derivative] += shear
    law[:3, [0, 4, 8]] += modulus * ratio / ((1 + ratio) * (1 - 2 * ratio))
    return law


@dataclass(frozen=True, eq=False)
class _Halo:
    """Exchange of the rows of nodes that cells of one rank use and another owns.

    `wanted` holds, for every rank, which of this rank's nodes it asks for.
    """

    comm: MPI.Comm
    wanted: list[np.ndarray]

    def fetch(self, rows: np.ndarray) -> np.ndarray:
        """Rows of the ghosts, from those that every rank owns; collective."""
        return np.concatenate(self.comm.alltoall([rows[wanted] for wanted in self.wanted]))


def _halo(comm: MPI.Comm, first_node: int, ghosts: np.ndarray) -> _Halo:
    """Exchange for ghosts with these ascending global numbers; collective."""
    starts = np.array(comm.allgather(first_node))
    # From the right: a rank without nodes starts where its successor does.
    owners = np.searchsorted(starts, ghosts, side="right") - 1
    asked = [ghosts[owners == rank] - starts[rank] for rank in range(comm.size)]
    return _Halo(comm, comm.alltoall(asked))


@dataclass(frozen=True, eq=False)
class StressOperator:
    """From displacements to stresses in the cells that this rank owns.

    Attributes
    ----------
    nodes
        Nodes of every cell, shape (cells, nodes of a cell): owned ones as this
        rank counts them, then the ghosts.
    derivatives
        Reference derivatives of the shape functions at the points of a cell,
        shape (points, 3, nodes of a cell).
    geometry
        Geometry nodes of every cell, shape (cells, nodes of a cell's geometry).
    x
        Positions of the geometry nodes [m].
    shapes
        Shape functions of the geometry, shape (points, nodes), and derivatives.
    law
        Voigt stresses of displacement derivatives, shape (6, 9) [Pa].
    owned
        Nodes that this rank owns.
    halo
        Exchange of the ghosts' rows.
    mesh
        dolfinx frees the communicator together with it.
    cell
        ``"hexahedron"`` or ``"tetrahedron"``.
    """

    nodes: np.ndarray
    derivatives: np.ndarray
    geometry: np.ndarray
    x: np.ndarray
    shapes: tuple[np.ndarray, np.ndarray]
    law: np.ndarray
    owned: int
    halo: _Halo
    mesh: object
    cell: str

    @property
    def shape(self) -> tuple[int, int]:
        """Owned cells and points of a cell."""
        return len(self.nodes), len(self.derivatives)

    def positions(self, cells: Cells = slice(None)) -> np.ndarray:
        """Points of the stresses of owned cells, shape (cells, points, 3) [m]."""
        return self.shapes[0] @ self.x[self.geometry[cells]]

    def gradients(self, cells: Cells = slice(None)) -> np.ndarray:
        """Derivatives by x, y and z of the shape functions, shape (cells, points, 3, nodes)."""
        jacobians = self.shapes[1] @ self.x[self.geometry[cells]][:, None]
        return np.linalg.inv(jacobians) @ self.derivatives

    def __call__(self, columns: np.ndarray) -> StressField:
        """Stresses of displacement columns; collective, as it fetches the ghosts' rows.

        Parameters
        ----------
        columns
            Displacements of the owned nodes, ``3 * node + component``, shape
            (owned dofs, n) [m]. Not copied.
        """
        columns = columns.reshape(self.owned, 3, columns.shape[1])
        return StressField(self, columns, self.halo.fetch(columns))


@dataclass(frozen=True, eq=False)
class StressField:
    """Stresses of displacement columns, computed block by block when asked for.

    An array of shape `shape` to ``numpy.asarray``; only `block` keeps memory bounded.
    Nothing here needs other ranks.

    Attributes
    ----------
    operator
        Cells, their geometry and the material.
    columns
        Displacement of the owned nodes, shape (owned nodes, 3, n) [m].
    ghosts
        The same of the nodes that others own, shape (ghost nodes, 3, n) [m].
    """

    operator: StressOperator
    columns: np.ndarray
    ghosts: np.ndarray

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Owned cells, points of a cell, 6, n."""
        return (*self.operator.shape, 6, self.columns.shape[2])

    def positions(self, cells: Cells = slice(None)) -> np.ndarray:
        """Where the stresses of owned cells are, shape (cells, points, 3) [m]."""
        return self.operator.positions(cells)

    def block(self, cells: Cells = slice(None), columns: slice = slice(None)) -> np.ndarray:
        """Voigt stresses xx, yy, zz, yz, xz, xy, shape (cells, points, 6, columns) [Pa]."""
        gradients = self.operator.gradients(cells)
        values = self._nodal_values(self.operator.nodes[cells], columns)
        count, points, _, nodes = gradients.shape
        width = values.shape[3]
        slopes = gradients.reshape(count, 3 * points, nodes) @ values.reshape(
            count, nodes, 3 * width
        )
        return self.operator.law @ slopes.reshape(count, points, 9, width)

    def _nodal_values(self, nodes: np.ndarray, columns: slice) -> np.ndarray:
        """Displacements of cells, shape (cells, nodes, 3, columns)."""
        owned = len(self.columns)
        ours, theirs = self.columns[:, :, columns], self.ghosts[:, :, columns]
        values = np.empty((*nodes.shape, *ours.shape[1:]))
        ghost = nodes >= owned
        values[~ghost], values[ghost] = ours[nodes[~ghost]], theirs[nodes[ghost] - owned]
        return values

    def __array__(self, dtype: np.dtype | None = None, copy: bool | None = None) -> np.ndarray:
        result = np.empty(self.shape)
        step = max(1, _BLOCK_BYTES // max(1, 8 * int(np.prod(self.shape[1:]))))
        for start in range(0, len(result), step):
            cells = slice(start, start + step)
            result[cells] = self.block(cells)
        return result if dtype is None else result.astype(dtype)


def stress_operator(space: fem.FunctionSpace, material: Material) -> StressOperator:
    """Stresses of the displacements of a part; collective.

    Parameters
    ----------
    space
        Quadratic displacements on hexahedra or tetrahedra.
    material
        Elastic constants.
    """
    mesh, index_map = space.mesh, space.dofmap.index_map
    cell, owned = mesh.topology.cell_type.name, index_map.size_local
    cells = mesh.topology.index_map(mesh.topology.dim).size_local
    points = sampling_points(cell)
    geometry = compat.geometry_dofmap(mesh)[:cells].copy()
    nodes = compat.space_dofmap(space)[:cells].copy()
    ghost = nodes >= owned
    numbers = np.asarray(index_map.ghosts)[nodes[ghost] - owned]
    ghosts, places = np.unique(numbers, return_inverse=True)
    nodes[ghost] = owned + places
    return StressOperator(
        nodes=nodes,
        derivatives=solid_shape_functions(cell, nodes.shape[1], points)[1],
        geometry=geometry,
        x=mesh.geometry.x.copy(),
        shapes=solid_shape_functions(cell, geometry.shape[1], points),
        law=_hooke(material),
        owned=owned,
        halo=_halo(mesh.comm, index_map.local_range[0], ghosts),
        mesh=mesh,
        cell=cell,
    )
