"""Cauchy stresses of displacement fields of a part, where quadratic cells know them best.

Stresses are those of the finite-element displacement, ``sigma = C : sym(grad u)``, at points
inside the cells, neither extrapolated nor averaged: at the 2x2x2 Gauss points of hexahedra, where
they converge one order faster than elsewhere (Barlow, Int. J. Numer. Meth. Eng. 10, 1976), and at
the 4 points of the rule of degree 2 of tetrahedra.

In every cell the stresses at its sampling points are continued to its nodes, by the polynomial
through these points: trilinear in hexahedra, linear in tetrahedra; what cells around a node say is
averaged (G. Dhondt, The Finite Element Method for Three-Dimensional Thermomechanical Applications,
section 2.4). All of it is linear: the tensor is averaged, and invariants are taken of that. How far
the cells around a node differ shows what the mesh does not resolve.

Fatigue is judged by the largest half-range of a cycle, its mean and the largest principal stress.
The half-range of a pair of instants i, j is the tensor ``(s_i - s_j) / 2``; of all pairs that one
counts whose half-range has the largest von Mises stress. Code_Aster's R7.04.04 has the same
maximum over pairs of instants (DEPSPE, of plastic strains,
docaster-en-codeaster-doc-4113bb35b8213385c636b94f1536856d7f617.gitlab.io,
man_r/r7/r7.04.04/Crit_res_en_formule). Directions that turn are followed, which a difference of two
von Mises stresses does not do.

The mean is ``(s_i + s_j) / 2`` of the same pair, so that both belong to one cycle between two
states that were there, as in a Haigh diagram; a mean over time would depend on how long the load
lingers where.

In the five coordinates of `deviatoric` a von Mises stress is a length, and the largest range the
diameter of a set of points. It is found exactly, not by trying all pairs: two sweeps to the
farthest point give a pair at distance L; about its middle, another pair can only be farther apart
if one point's distance and the largest of any exceed L together. Where stress swings along a line
that leaves a few points near its ends; where it turns on a circle all, and all pairs are tried.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import basix
import numpy as np
from mpi4py import MPI
from scipy import sparse

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


# At nodes

#: Memory of the stresses of a block of cells, all that leads to them included.
_NODAL_BYTES = 1 << 27


class NodalStress:
    """Stresses at the nodes of a part that is whole on one rank.

    Parameters
    ----------
    field
        Of displacement columns.

    Attributes
    ----------
    nodes
        Number of nodes.
    """

    def __init__(self, field: StressField):
        self._field, self._operator = field, field.operator
        cells, size = self._operator.nodes.shape
        self.nodes = self._operator.owned
        self._continued = continuation(self._operator.cell, size)
        columns = np.arange(cells * size)
        share = sparse.csr_matrix(
            (np.ones(cells * size), (self._operator.nodes.ravel(), columns)),
            shape=(self.nodes, cells * size),
        )
        share.data /= np.repeat(np.diff(share.indptr), np.diff(share.indptr))
        self._share = share

    def blocks(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Nodes and their stresses, shape (b,) and (b, 6, columns) [Pa], until all are through."""
        size = self._operator.nodes.shape[1]
        first_cell = self._share.indices[self._share.indptr[:-1]] // size
        order = np.argsort(first_cell, kind="stable")
        # Of displacement derivatives and stresses at its points, and stresses at its nodes.
        points, columns = len(self._operator.derivatives), max(1, self._field.shape[3])
        each = 8 * columns * (15 * points + 6 * size)
        count = max(1, _NODAL_BYTES // each) * self.nodes // max(1, len(self._operator.nodes))
        for start in range(0, self.nodes, max(1, count)):
            nodes = order[start : start + max(1, count)]
            share = self._share[nodes]
            cells, values = self._in_cells(share.indices // size)
            place = np.searchsorted(cells, share.indices // size) * size + share.indices % size
            local = sparse.csr_matrix(
                (share.data, place, share.indptr), shape=(len(nodes), values.shape[0] * size)
            )
            flat = values.reshape(values.shape[0] * size, -1)
            yield nodes, (local @ flat).reshape(len(nodes), *values.shape[2:])

    def around(self, node: int) -> np.ndarray:
        """What each cell around a node says of it, shape (cells around, 6, columns) [Pa]."""
        size = self._operator.nodes.shape[1]
        cell, place = np.divmod(self._share[node].indices, size)
        cells, values = self._in_cells(cell)
        return values[np.searchsorted(cells, cell), place]

    def _in_cells(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Some cells, ascending, and stresses at the nodes of each, (c, nodes, 6, columns)."""
        cells = np.unique(cells)
        stresses = self._field.block(cells)
        count, points = stresses.shape[:2]
        flat = self._continued @ stresses.reshape(count, points, -1)
        return cells, flat.reshape(count, -1, *stresses.shape[2:])


# Over a cycle

#: Numbers in memory at a time while pairs are tried.
_PAIRS = 1 << 22

_ROOT3 = np.sqrt(3.0)

#: Places of the Voigt stresses xx, yy, zz, yz, xz, xy in the tensor.
_TENSOR = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])


def deviatoric(stress: np.ndarray) -> np.ndarray:
    """Coordinates in which the von Mises stress is the Euclidean norm.

    Parameters
    ----------
    stress
        Voigt stresses xx, yy, zz, yz, xz, xy, shape (..., 6) [Pa].

    Returns
    -------
    numpy.ndarray
        Linear in the stress, shape (..., 5) [Pa].
    """
    xx, yy, zz = (stress[..., i] for i in range(3))
    plane = [xx - 0.5 * (yy + zz), 0.5 * _ROOT3 * (yy - zz)]
    return np.stack([*plane, *(_ROOT3 * stress[..., i] for i in range(3, 6))], axis=-1)


@dataclass(frozen=True, eq=False)
class HalfRange:
    """Largest half-range of points [Pa].

    Attributes
    ----------
    instants
        The pair, ascending, shape (points, 2).
    von_mises
        Of the half-range, shape (points,) [Pa].
    half_range, mean
        Half the later stress less the earlier one, and half their sum, shape (points, 6) [Pa].
    """

    instants: np.ndarray
    von_mises: np.ndarray
    half_range: np.ndarray
    mean: np.ndarray


def largest_half_range(stress: np.ndarray) -> HalfRange:
    """Largest half-range over all pairs of instants, exact to round-off.

    Parameters
    ----------
    stress
        Histories, shape (points, 6, instants) [Pa].
    """
    points = deviatoric(np.moveaxis(stress, 1, 2))
    pair = _farthest(points)
    pair.sort(axis=1)
    first, last = (np.take_along_axis(stress, pair[:, None, i : i + 1], 2)[..., 0] for i in (0, 1))
    half = 0.5 * (last - first)
    return HalfRange(pair, np.linalg.norm(deviatoric(half), axis=1), half, 0.5 * (first + last))


def _farthest(points: np.ndarray) -> np.ndarray:
    """The pair of instants farthest apart, of every set of points (sets, instants, 5)."""
    pair = np.zeros((len(points), 2), dtype=np.int64)
    reach = np.zeros(len(points))
    for end in (0, 1, 0):
        distances = _distances(points, _at(points, pair[:, 1 - end]))
        pair[:, end] = distances.argmax(axis=1)
        reach = distances.max(axis=1)
    centred = points - 0.5 * (_at(points, pair[:, 0]) + _at(points, pair[:, 1]))[:, None]
    radii = np.linalg.norm(centred, axis=2)
    candidate = radii + radii.max(axis=1)[:, None] > reach[:, None]
    counts = candidate.sum(axis=1)
    # Sets of about as many candidates together, these first.
    order = np.argsort(~candidate, axis=1, kind="stable")
    sets = np.argsort(counts, kind="stable")
    sets = sets[counts[sets] > 1]
    while len(sets):
        ahead = np.arange(1, len(sets) + 1) * counts[sets] ** 2
        block, sets = np.split(sets, [max(1, int(np.searchsorted(ahead, _PAIRS)))])
        chosen = order[block, : counts[block[-1]]]
        _try_all(
            block, chosen, np.take_along_axis(centred[block], chosen[..., None], 1), pair, reach
        )
    return pair


def _try_all(
    sets: np.ndarray, chosen: np.ndarray, points: np.ndarray, pair: np.ndarray, reach: np.ndarray
) -> None:
    """Take the farthest pair of some instants of some sets where it beats the one known."""
    squares = np.einsum("pic,pic->pi", points, points)
    apart = squares[:, :, None] + squares[:, None] - 2 * points @ points.swapaxes(1, 2)
    best = apart.reshape(len(sets), -1).argmax(axis=1)
    first, last = np.divmod(best, apart.shape[2])
    row = np.arange(len(sets))
    better = np.linalg.norm(points[row, first] - points[row, last], axis=1) > reach[sets]
    found = np.column_stack([chosen[row, first], chosen[row, last]])
    pair[sets[better]] = found[better]


def _at(points: np.ndarray, instants: np.ndarray) -> np.ndarray:
    return points[np.arange(len(points)), instants]


def _distances(points: np.ndarray, origins: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points - origins[:, None], axis=2)


def largest_principal(stress: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Largest principal stress over the cycle.

    Parameters
    ----------
    stress
        Histories, shape (points, 6, instants) [Pa].

    Returns
    -------
    values, instants : numpy.ndarray
        shape (points,) each [Pa].
    """
    mean = stress[:, :3].mean(axis=1)
    equivalent = np.linalg.norm(deviatoric(np.moveaxis(stress, 1, 2)), axis=2)
    # With von Mises stress q and mean stress m it lies from m + q / 3 to m + 2 q / 3, so that few
    # instants can have it; of the others the bound below stands for it.
    values = mean + equivalent / 3
    possible = mean + 2 * equivalent / 3 >= values.max(axis=1)[:, None]
    tensors = np.moveaxis(stress, 1, 2)[possible][:, _TENSOR]
    values[possible] = np.linalg.eigvalsh(tensors)[:, 2]
    instants = values.argmax(axis=1)
    return _at(values, instants), instants
