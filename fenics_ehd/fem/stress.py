"""Stresses of displacement fields of a part: at points of its cells, at nodes, over a cycle.

The stress is ``sigma = C : sym(grad u)`` for the finite-element displacement u. It is evaluated at
the 2x2x2 Gauss points of hexahedra, where stresses converge one order faster than elsewhere
(Barlow, Int. J. Numer. Meth. Eng. 10, 1976), and at the 4 points of the rule of degree 2 in
tetrahedra.

Nodal stresses are computed in two steps. In every cell, stresses are extrapolated from these points
to the nodes by a polynomial, which is trilinear in hexahedra and linear in tetrahedra. The values
of all cells around a node are then averaged (G. Dhondt, The Finite Element Method for
Three-Dimensional Thermomechanical Applications, section 2.4). Tensors are averaged, and invariants
are computed afterwards. The scatter of the cells around a node indicates the error of the mesh.

Fatigue is assessed by three values: the largest half-range of a cycle, the mean stress of the same
pair of instants, and the largest principal stress. The half-range of two instants i, j is the
tensor ``(s_i - s_j) / 2``; the pair with the largest von Mises stress of the half-range is used.
Code_Aster's R7.04.04 has the same maximum over pairs of instants (DEPSPE, for plastic strains,
docaster-en-codeaster-doc-4113bb35b8213385c636b94f1536856d7f617.gitlab.io,
man_r/r7/r7.04.04/Crit_res_en_formule). Thus rotations of the principal directions are taken into
account, unlike in a difference of two von Mises stresses.

The mean stress is ``(s_i + s_j) / 2`` for the same pair, so that half-range and mean belong to one
cycle between two existing states, as in a Haigh diagram. A mean over time would depend on the
durations of the states.

In the five coordinates of `deviatoric`, the von Mises stress is a length, so that the largest range
is the diameter of a set of points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import fenics_ehd.base.petsc_start  # noqa: F401  # isort: skip
import basix
import numpy as np
import ufl
from dolfinx import fem
from scipy import sparse
from scipy.spatial.distance import cdist
from ufl.core.expr import Expr

from fenics_ehd.base import compat
from fenics_ehd.base.shared_settings import Material
from fenics_ehd.fem.elements import solid_element
from fenics_ehd.reduction.part_files import deviatoric, von_mises

#: Selection of cells that this rank owns.
Cells = slice | np.ndarray


def sampling_points(cell: str) -> np.ndarray:
    """Reference coordinates of the points at which stresses are evaluated, shape (8 or 4, 3).

    A hexahedron has 8 points, a tetrahedron 4.
    """
    degree = 3 if cell == "hexahedron" else 2
    return basix.make_quadrature(getattr(basix.CellType, cell), degree)[0]


def continuation(cell: str, size: int) -> np.ndarray:
    """Matrix that extrapolates values at the sampling points of a cell to its nodes.

    The shape is (size, 8) for a hexahedron with `size` nodes, and (size, 4) for a tetrahedron. The
    extrapolating polynomial is trilinear in hexahedra, linear in tetrahedra.
    """
    points = sampling_points(cell)
    linear = solid_element(cell, len(points))
    nodes = solid_element(cell, size).nodes
    return linear.shapes(nodes) @ np.linalg.inv(linear.shapes(points))


def hooke(displacement: Expr, material: Material) -> Expr:
    """Stress tensor [Pa] of a displacement in a linear isotropic material, as a UFL expression."""
    modulus = material.youngs_modulus
    ratio = material.poissons_ratio
    mu = modulus / (2 * (1 + ratio))
    lame = modulus * ratio / ((1 + ratio) * (1 - 2 * ratio))
    strain = ufl.sym(ufl.grad(displacement))
    return 2 * mu * strain + lame * ufl.tr(strain) * ufl.Identity(3)


class StressField:
    """Stresses in the cells of this rank, for n displacement fields.

    Stresses in blocks of cells are computed on request. The constructor must be called on all
    ranks; the methods communicate with no other rank.

    Parameters
    ----------
    space
        Function space of quadratic displacements on hexahedra or tetrahedra.
    material
        Elastic constants of the part.
    columns
        Displacement fields as columns, shape (dofs of this rank, n) [m]; the row of a component of
        the displacement of a node is ``3 * node + component``. The array is not copied.

    Attributes
    ----------
    cell
        Name of the cell, ``"hexahedron"`` or ``"tetrahedron"``.
    owned
        Number of nodes that this rank owns.
    nodes
        Local node indices of every cell, owned nodes before ghosts, shape (cells, nodes of a
        cell).
    shape
        Shape of the array of all stresses: cells of this rank, sampling points of a cell, 6
        components, n displacement fields.
    """

    def __init__(self, space: fem.FunctionSpace, material: Material, columns: np.ndarray):
        topology = space.mesh.topology
        self.cell = topology.cell_type.name
        self.owned = space.dofmap.index_map.size_local
        self.nodes = compat.space_dofmap(space)[: topology.index_map(topology.dim).size_local]
        points = sampling_points(self.cell)
        (size, count) = columns.shape
        self.shape = len(self.nodes), len(points), 6, count
        self._moved = fem.Function(space)
        self._columns = columns
        s = hooke(self._moved, material)
        voigt = ufl.as_vector([s[0, 0], s[1, 1], s[2, 2], s[1, 2], s[0, 2], s[0, 1]])
        self._stresses = fem.Expression(voigt, points)
        self._positions = fem.Expression(ufl.SpatialCoordinate(space.mesh), points)
        vector = self._moved.x
        self._ghosts = np.empty((len(vector.array) - size, count))
        for number, column in enumerate(columns.T):
            vector.array[:size] = column
            vector.scatter_forward()
            self._ghosts[:, number] = vector.array[size:]

    def positions(self, cells: Cells = slice(None)) -> np.ndarray:
        """Positions of the sampling points of some cells, shape (cells, points, 3) [m]."""
        return self._evaluated(self._positions, cells)

    def block(self, cells: Cells = slice(None), columns: slice = slice(None)) -> np.ndarray:
        """Stresses xx, yy, zz, yz, xz, xy at the sampling points of some cells [Pa].

        The shape is (cells, points, 6, columns), with a column for each displacement field.
        """
        stresses = []
        for number in range(self.shape[3])[columns]:
            rows = self._columns[:, number], self._ghosts[:, number]
            self._moved.x.array[:] = np.concatenate(rows)
            stresses.append(self._evaluated(self._stresses, cells))
        return np.stack(stresses, axis=-1)

    def _evaluated(self, expression: fem.Expression, cells: Cells) -> np.ndarray:
        """Values of an expression at the sampling points of some cells.

        The shape is (cells, points, components).
        """
        numbers = np.arange(self.shape[0], dtype=np.int32)[cells]
        values = compat.evaluated(expression, self._moved.function_space.mesh, numbers)
        return values.reshape(len(numbers), self.shape[1], -1)


# At nodes

#: Memory limit for the stresses of a block of nodes, with intermediate arrays [bytes].
_NODAL_BYTES = 1 << 27


class NodalStress:
    """Stresses at the nodes of a part whose cells are all on one rank.

    Parameters
    ----------
    field
        Stresses in the cells of the part.

    Attributes
    ----------
    nodes
        Number of nodes.
    """

    def __init__(self, field: StressField):
        self._field = field
        self.nodes = field.owned
        self._size = field.nodes.shape[1]
        self._continued = continuation(field.cell, self._size)
        entries = np.ones(field.nodes.size), (field.nodes.ravel(), np.arange(field.nodes.size))
        self._share = sparse.csr_matrix(entries, shape=(self.nodes, field.nodes.size))
        counts = np.diff(self._share.indptr)
        self._share.data /= np.repeat(counts, counts)

    def blocks(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Iterate over blocks of nodes: node indices, shape (b,), and stresses at the nodes [Pa].

        Stresses have the shape (b, 6, columns), with a column for each displacement field.
        """
        cells, points, _, columns = self._field.shape
        first_cell = self._share.indices[self._share.indptr[:-1]] // self._size
        order = np.argsort(first_cell, kind="stable")
        # Number of bytes for a cell: two copies of stresses at its points, one at its nodes.
        each = 8 * max(1, columns) * 6 * (2 * points + self._size)
        count = max(1, max(1, _NODAL_BYTES // each) * self.nodes // max(1, cells))
        for start in range(0, self.nodes, count):
            nodes = order[start : start + count]
            share = self._share[nodes]
            used, values = self._in_cells(share.indices // self._size)
            columns_used = (used[:, None] * self._size + np.arange(self._size)).ravel()
            flat = values.reshape(len(columns_used), -1)
            yield nodes, (share[:, columns_used] @ flat).reshape(len(nodes), *values.shape[2:])

    def around(self, node: int) -> np.ndarray:
        """Stresses at a node from each cell around it, before averaging [Pa].

        The shape is (cells around the node, 6, columns).
        """
        cell, corner = np.divmod(self._share[node].indices, self._size)
        cells, values = self._in_cells(cell)
        return values[np.searchsorted(cells, cell), corner]

    def _in_cells(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Extrapolate stresses in some cells to the nodes of the cells.

        The result has the distinct indices of the cells in ascending order, shape (c,), and the
        stresses at their nodes, shape (c, nodes of a cell, 6, columns) [Pa].
        """
        cells = np.unique(cells)
        stresses = self._field.block(cells)
        return cells, np.einsum("np,cpik->cnik", self._continued, stresses, optimize=True)


# Over a cycle

#: Index, among the components xx, yy, zz, yz, xz, xy, of each entry of the stress tensor.
_TENSOR = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])


@dataclass(frozen=True, eq=False)
class HalfRange:
    """Largest half-range of the stress over a cycle at each point.

    Attributes
    ----------
    instants
        Indices of the two instants, the earlier one first, shape (points, 2).
    von_mises
        Von Mises stress of the half-range, shape (points,) [Pa].
    half_range, mean
        Half the difference of the stresses at the two instants, later minus earlier, and half their
        sum, both of shape (points, 6) [Pa].
    """

    instants: np.ndarray
    von_mises: np.ndarray
    half_range: np.ndarray
    mean: np.ndarray


def largest_half_range(stress: np.ndarray) -> HalfRange:
    """Find the largest half-range over all pairs of instants, by comparing all pairs.

    Parameters
    ----------
    stress
        Stress at each point and instant, shape (points, 6, instants) [Pa].
    """
    points = deviatoric(np.moveaxis(stress, 1, 2))
    pair = np.sort(_farthest(points), axis=1)
    first, last = (np.take_along_axis(stress, pair[:, None, i : i + 1], 2)[..., 0] for i in (0, 1))
    half = 0.5 * (last - first)
    return HalfRange(pair, von_mises(half), half, 0.5 * (first + last))


def _farthest(points: np.ndarray) -> np.ndarray:
    """Indices of the two most distant points of every set of points, shape (sets, 2).

    `points` has the shape (sets, points, 5), with the five coordinates of each point.
    """
    indices = [cdist(states, states).argmax() for states in points]
    return np.stack(np.unravel_index(indices, (points.shape[1],) * 2), axis=1)


def largest_principal(stress: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Largest principal stress of each point over the cycle.

    Parameters
    ----------
    stress
        Stress at each point and instant, shape (points, 6, instants) [Pa].

    Returns
    -------
    values, instants : numpy.ndarray
        Largest principal stress [Pa] and index of its instant, each of shape (points,).
    """
    mean = stress[:, :3].mean(axis=1)
    equivalent = von_mises(np.moveaxis(stress, 1, 2))
    # For von Mises stress q and mean normal stress m, it is between m + q / 3 and m + 2 q / 3. Only
    # instants whose upper bound reaches the largest lower bound are evaluated.
    values = mean + equivalent / 3
    possible = mean + 2 * equivalent / 3 >= values.max(axis=1)[:, None]
    tensors = np.moveaxis(stress, 1, 2)[possible][:, _TENSOR]
    values[possible] = np.linalg.eigvalsh(tensors)[:, 2]
    instants = values.argmax(axis=1)
    return values.max(axis=1), instants
