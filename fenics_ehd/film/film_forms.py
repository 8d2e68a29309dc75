"""Forms of a film on its mesh: dolfinx assembles vectors and matrices of the weak form.

A combination of laws is compiled once; other meshes, oils and temperatures take the same kernels.

The mesh is the unwrapped bore, flat. It is periodic by its numbers: the nodes at both ends of the
circumference have one number, that of the film's grid. Gap data are functions of the quadrature
space, numbered cell by cell as arrays (cells, points) are. Matrices have the rows of all nodes;
those of nodes where the pressure is given are left out by the pattern of a solver, whose entries
are picked from them. Derivatives along the gap are assembled transposed, a row for every Gauss
point: the data of these rows are those of the columns of a sparse matrix (nodes, points).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import fenics_ehd.base.petsc_start  # noqa: F401  # isort: skip
import numpy as np
from dolfinx import cpp, fem
from scipy import sparse

from fenics_ehd.base import compat
from fenics_ehd.film.assembly import GAUSS_POINTS, Pattern, with_data
from fenics_ehd.film.grid import FilmGrid
from fenics_ehd.film.weak_form import Laws, WeakForm, gauss_element, pressure_element

#: Gauss points of a cell.
POINTS = GAUSS_POINTS**2


@cache
def compiled(laws: Laws, layout: tuple[int | None, ...]) -> tuple[WeakForm, dict[str, Any]]:
    """Weak form of a combination of laws and what it compiles to, once in a process."""
    weak = WeakForm(laws, layout)
    handles = compat.compile_forms(list(weak.forms.values()))
    return weak, dict(zip(weak.forms, handles, strict=True))


@dataclass(frozen=True, eq=False)
class Inputs:
    """Data of the forms beside the pressure.

    Attributes
    ----------
    numbers
        `Numbers.flat`.
    values
        `Laws.values` by name, arrays (cells, points).
    """

    numbers: np.ndarray
    values: Mapping[str, np.ndarray]


class FilmForms:
    """Forms of a combination of laws on one grid.

    Parameters
    ----------
    grid
        The film mesh.
    laws, layout
        See `WeakForm`.
    """

    def __init__(self, grid: FilmGrid, laws: Laws, layout: tuple[int | None, ...]):
        self._weak, self._handles = compiled(laws, layout)
        self._size = len(grid.node_positions)
        self._mesh = _flat_mesh(grid)
        order = np.asarray(self._mesh.topology.original_cell_index)
        points = np.arange(grid.cells[0] * grid.cells[1] * POINTS).reshape(-1, POINTS)
        self._spaces = {
            name: compat.numbered_space(
                compat.functionspace(self._mesh, element), numbers[order], size
            )
            for name, element, numbers, size in (
                ("nodes", pressure_element(grid.family), grid.cell_nodes, self._size),
                ("points", gauss_element(), points, points.size),
            )
        }
        self._functions = {
            name: fem.Function(self._spaces["nodes" if name == "pressure" else "points"])
            for name in self._weak.coefficients
        }
        self._arrays = {name: function.x.array for name, function in self._functions.items()}
        count = sum(1 if n is None else n for n in layout)
        self._constant = fem.Constant(self._mesh, np.zeros(count))
        self._forms: dict[str, Any] = {}
        self._matrices: dict[str, Any] = {}
        shape = (self._size, points.size)
        nodes = grid.cell_nodes.shape[1]
        rows = np.repeat(np.sort(grid.cell_nodes, axis=1)[:, None, :], POINTS, axis=1).ravel()
        starts = np.arange(points.size + 1) * nodes
        self._columns = sparse.csc_matrix((np.zeros(rows.size), rows, starts), shape)

    def vector(self, inputs: Inputs, nodal: np.ndarray) -> np.ndarray:
        """Residual tested with every node, shape (nodes,), of dimensionless nodal pressures."""
        form, values = self._form("residual"), np.zeros(self._size)
        cpp.fem.assemble_vector(values, form, inputs.numbers, self._packed(form, inputs, nodal))
        return values

    def matrix(self, inputs: Inputs, nodal: np.ndarray) -> np.ndarray:
        """Entries of its derivative along the pressure, see `places`."""
        return self._entries("pressure", "nodes", inputs, nodal)

    def along_gap(
        self, inputs: Inputs, nodal: np.ndarray
    ) -> tuple[sparse.csc_matrix, sparse.csc_matrix | None]:
        """Its derivatives along thickness and sliding velocity, (nodes, points) each.

        Along the thickness its rate follows, see `Numbers`; the last is None where nothing slides.
        """
        thickness = self._entries("thickness", "points", inputs, nodal)
        if not self._weak.laws.sliding:
            return with_data(self._columns, thickness), None
        sliding = self._entries("sliding_velocity", "points", inputs, nodal)
        return with_data(self._columns, thickness), with_data(self._columns, sliding)

    def places(self, pattern: Pattern, nodes: np.ndarray) -> np.ndarray:
        """Places of a pattern's entries, that of some nodes alone, among those of `matrix`."""
        self._form("pressure")
        matrix = self._matrices["nodes"]
        starts, columns = np.array(matrix.indptr), np.array(matrix.indices)
        rows = np.repeat(np.arange(self._size), np.diff(starts))
        codes = rows * self._size + columns
        order = np.argsort(codes)
        wanted = nodes[pattern.rows] * self._size + nodes[pattern.indices]
        return order[np.searchsorted(codes, wanted, sorter=order)]

    def _form(self, name: str) -> Any:
        """A form on this mesh, and a matrix for it."""
        if name not in self._forms:
            own = self._weak.forms[name].coefficients()
            named = {id(symbol): name for name, symbol in self._weak.coefficients.items()}
            places = compat.coefficient_places(self._handles[name])
            taken = [self._functions[named[id(own[i])]] for i in places]
            rows = {"residual": [], "pressure": ["nodes"]}.get(name, ["points"])
            spaces = [self._spaces[space] for space in [*rows, "nodes"]]
            form = compat.create_form(
                self._handles[name], spaces, taken, self._constant, self._mesh
            )
            for space in rows:
                if space not in self._matrices:
                    self._matrices[space] = compat.native_matrix(form, spaces, self._mesh)
            self._forms[name] = form
        return self._forms[name]

    def _packed(self, form: Any, inputs: Inputs, nodal: np.ndarray) -> Any:
        self._arrays["pressure"][:] = nodal
        for name, values in inputs.values.items():
            self._arrays[name][:] = values.ravel()
        return cpp.fem.pack_coefficients(form)

    def _entries(self, name: str, rows: str, inputs: Inputs, nodal: np.ndarray) -> np.ndarray:
        form = self._form(name)
        matrix = self._matrices[rows]
        data = matrix.data
        data[:] = 0.0
        packed = self._packed(form, inputs, nodal)
        cpp.fem.assemble_matrix(matrix, form, inputs.numbers, packed, [])
        return data.copy()


def _flat_mesh(grid: FilmGrid) -> Any:
    """The unwrapped bore, angles and heights over the radius."""
    around, along = grid.cells
    heights = grid.heights / grid.radius
    x = np.column_stack([np.repeat(grid.angles, along + 1), np.tile(heights, around + 1)])
    i, j = (a.ravel() for a in np.meshgrid(range(around), range(along), indexing="ij"))
    corners = [(i + a) * (along + 1) + j + b for b in (0, 1) for a in (0, 1)]
    return compat.plane_mesh(np.column_stack(corners), x)
