"""A film of forms on one mesh, behind the seams of `ReynoldsEquation`."""

from __future__ import annotations

from functools import cache
from time import perf_counter
from typing import Any

import film_forms_compat as compat_forms
import numpy as np
from dolfinx import cpp, fem
from film_forms_laws import DEGREE, NUMBERS, FilmForms, Laws, element_of
from scipy import sparse

from fenics_ehd.base import compat
from fenics_ehd.film.cavitation import Complementarity
from fenics_ehd.film.grid import FilmGrid
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.film.lubricant import Barus, DowsonHigginson, Roelands
from fenics_ehd.film.parameters import FilmParameters
from fenics_ehd.film.pattern import with_data
from fenics_ehd.film.reynolds import DensityRate, ReynoldsEquation

SECONDS = {"ufl": 0.0, "compiled": 0.0, "forms": 0}


@cache
def compiled(laws: Laws) -> tuple[FilmForms, dict[str, Any]]:
    """Forms of a combination of laws and what they compile to, once in a process."""
    began = perf_counter()
    forms = FilmForms(laws)
    middle = perf_counter()
    handles = compat_forms.compile_forms(list(forms.forms.values()))
    SECONDS["ufl"] += middle - began
    SECONDS["compiled"] += perf_counter() - middle
    SECONDS["forms"] += len(handles)
    return forms, dict(zip(forms.forms, handles, strict=True))


class FilmMesh:
    """Flat mesh of a grid and its folded spaces: nodes as the grid's, Gauss points cell by cell."""

    def __init__(self, grid: FilmGrid):
        around, along = grid.cells
        heights = grid.heights / grid.radius
        x = np.column_stack([np.repeat(grid.angles, along + 1), np.tile(heights, around + 1)])
        i, j = (a.ravel() for a in np.meshgrid(range(around), range(along), indexing="ij"))
        corners = [(i + a) * (along + 1) + j + b for b in (0, 1) for a in (0, 1)]
        self.mesh = compat_forms.plane_mesh(np.column_stack(corners), x)
        order = np.asarray(self.mesh.topology.original_cell_index)
        nodes = compat.functionspace(self.mesh, element_of(grid.family))
        self.nodes = compat_forms.numbered_space(
            nodes, grid.cell_nodes[order], len(grid.node_positions)
        )
        gauss = compat.functionspace(self.mesh, compat_forms.quadrature_element(DEGREE))
        points = np.arange(9 * len(order)).reshape(-1, 9)
        self.gauss = compat_forms.numbered_space(gauss, points[order], points.size)


class Kernel:
    """One compiled form on a mesh."""

    def __init__(self, handle: Any, spaces: list, values: list, constant: Any, domain: Any):
        self.form = compat_forms.create_form(handle, spaces, values, [constant], domain)
        self.constants = constant.value
        if len(spaces) == 2:
            self.matrix = compat_forms.native_matrix(self.form, spaces, domain)
            self.data = self.matrix.data

    def vector(self, size: int) -> np.ndarray:
        """Of a form with one argument."""
        values = np.zeros(size)
        packed = cpp.fem.pack_coefficients(self.form)
        cpp.fem.assemble_vector(values, self.form, self.constants, packed)
        return values

    def entries(self) -> np.ndarray:
        """Of the matrix of a form with two, row by row."""
        self.data[:] = 0.0
        packed = cpp.fem.pack_coefficients(self.form)
        cpp.fem.assemble_matrix(self.matrix, self.form, self.constants, packed, [])
        return self.data.copy()


class LazyComplementarity:
    """As `Complementarity`, what nobody asks for is not made."""

    def __init__(self, equation: FormsEquation, residual: Any, entries: Any):
        self._equation, self.residual, self.entries = equation, residual, entries
        self.weights = equation.weights

    @property
    def _start(self) -> np.ndarray:
        return self.residual(np.zeros(len(self._equation.free)))

    @property
    def scale(self) -> float:
        """See `Complementarity`."""
        e = self._equation
        return max(float(np.linalg.norm(self._start / e._weight_diagonal)), e._smallest)

    @property
    def unit(self) -> float:
        """See `Complementarity`."""
        e = self._equation
        first = self.entries(np.zeros(len(e.free)))
        return max(float(np.abs(self._start).max()), e._smallest) / float(first.max())


def laws_of(p: FilmParameters) -> Laws:
    """What a film's form contains."""
    oil, surfaces = p.lubricant, p.surfaces
    viscosity = {Barus: "barus", Roelands: "roelands"}.get(type(oil.viscosity_law), "constant")
    density = "dowson-higginson" if isinstance(oil.density_law, DowsonHigginson) else "constant"
    kind = "smooth"
    if surfaces is not None:
        kind = "factors" if surfaces.flow_factors else "rough"
    return Laws(
        p.grid.family,
        viscosity,
        density,
        thinning=oil.shear_law is not None,
        surfaces=kind,
        dragging=surfaces is not None and surfaces.dragging,
        fields=bool(oil.viscosity_field or oil.density_field or p.recesses),
        supplies=bool(p.feeds),
    )


class FormsEquation(ReynoldsEquation):
    """`ReynoldsEquation` with its residual and derivatives from forms."""

    def __init__(self, parameters: FilmParameters, laws: Laws | None = None):
        super().__init__(parameters)
        self.laws = laws_of(parameters) if laws is None else laws
        forms, handles = compiled(self.laws)
        self.film_mesh = FilmMesh(parameters.grid)
        spaces = {"pressure": self.film_mesh.nodes}
        self.values = {
            name: fem.Function(spaces.get(name, self.film_mesh.gauss))
            for name in forms.coefficients
        }
        self.arrays = {name: f.x.array for name, f in self.values.items()}
        self.numbers = np.zeros(len(NUMBERS))
        constant = fem.Constant(self.film_mesh.mesh, self.numbers)
        self.kernels = {}
        rows = {"residual": ["pressure"], "pressure": ["pressure", "pressure"]}
        for name, handle in handles.items():
            own = forms.forms[name].coefficients()
            named = {id(c): n for n, c in forms.coefficients.items()}
            places = compat_forms.coefficient_places(handle)
            taken = [self.values[named[id(own[i])]] for i in places]
            arguments = rows.get(name, ["gauss", "pressure"])
            spaces = [getattr(self.film_mesh, "nodes" if a == "pressure" else a) for a in arguments]
            self.kernels[name] = Kernel(handle, spaces, taken, constant, self.film_mesh.mesh)
        self.numbers = constant.value
        self._number_pattern()
        self._set_numbers()
        cells, points = self.assembly.area.shape
        k = grid_nodes = parameters.grid.cell_nodes.shape[1]
        matrix = self.kernels["thickness"].matrix
        size = cells * points
        self._columns = sparse.csc_matrix(
            (np.zeros(size * k), np.array(matrix.indices), np.arange(size + 1) * grid_nodes),
            (self.assembly.size, size),
        )

    def _number_pattern(self) -> None:
        """Places of the free nodes' entries in the matrix of all nodes."""
        matrix = self.kernels["pressure"].matrix
        indptr, indices = np.array(matrix.indptr), np.array(matrix.indices)
        free = np.zeros(self.assembly.size, dtype=bool)
        free[self.free] = True
        self.rows, self.columns = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr)), indices
        self._kept = np.flatnonzero(free[self.rows] & free[self.columns])

    def set(self, **numbers: float) -> None:
        """Give numbers of the laws."""
        for name, value in numbers.items():
            self.numbers[NUMBERS.index(name)] = value

    def _set_numbers(self) -> None:
        p, oil = self.parameters, self.lubricant
        factors = [1.0, 1.0]
        if self.laws.fields:
            for name, values in zip(
                ("viscosity_field", "density_field"), self.factors, strict=True
            ):
                self.arrays[name][:] = np.broadcast_to(values, self.assembly.area.shape).ravel()
        else:
            factors = self.factors
        self.set(
            clearance=p.clearance, speed=p.rate * p.grid.radius, rate=p.clearance * p.rate,
            pressure_scale=p.pressure_scale, viscosity=factors[0], density=factors[1],
            squeeze=1.0, storage=0.0, rate_shift=0.0,
        )  # fmt: skip
        law = oil.viscosity_law
        if isinstance(law, Barus):
            self.set(pressure_coefficient=law.coefficient)
        if isinstance(law, Roelands):
            strength = np.log(law.viscosity) - law.LOG_LIMIT
            self.set(pressure_coefficient=strength, pressure_index=law.index)
        if oil.shear_law is not None:
            c = oil.shear_law
            self.set(thinning_rate=c.rate, thinning_exponent=c.exponent, second_viscosity=c.second)
        if p.surfaces is not None:
            (least, mobility), power = p.surfaces._continuation
            self.set(
                roughness=p.surfaces.roughness, roughness_weight=p.surfaces.weight,
                least_gap=least, least_mobility=mobility, least_power=power,
            )  # fmt: skip

    def warm(self, temperature: float) -> None:
        """See `ReynoldsEquation`."""
        super().warm(temperature)
        self._set_numbers()

    def put(self, gap: Gap, density_rate: DensityRate | None = None) -> None:
        """Take a gap."""
        a = self.arrays
        a["thickness"][:] = gap.thickness.ravel()
        a["thickness_rate"][:] = gap.thickness_rate.ravel()
        a["mean_velocity"][:] = gap.mean_velocity.ravel()
        a["sliding_velocity"][:] = gap.sliding_velocity.ravel()
        if self.laws.history:
            assert density_rate is not None
            self.set(storage=density_rate.shift / self.parameters.rate)
            a["history"][:] = density_rate.history.ravel() / self.parameters.rate
        if self.laws.supplies:
            self._put_supplies(gap)

    def _put_supplies(self, gap: Gap) -> None:
        assert self.feeds is not None
        ones = np.ones_like(gap.thickness)
        term = self.feeds.term(gap, ones)
        own = np.array([value is not None for value in self.feeds._own], dtype=float)
        for name, chosen in (("own", own), ("resistive", 1 - own)):
            self.arrays[name][:] = np.tensordot(chosen, term.conductance, 1).ravel()
            given = np.tensordot(chosen * term.pressure, term.conductance, 1)
            self.arrays[f"{name}_given"][:] = given.ravel()

    def balance(self, nodal: np.ndarray) -> np.ndarray:
        """Residual at all nodes, of the gap that was put last."""
        self.arrays["pressure"][:] = nodal
        return self.kernels["residual"].vector(self.assembly.size)

    def matrix(self, name: str) -> sparse.csc_matrix:
        """Derivative along values at the Gauss points, shape (nodes, points)."""
        return with_data(self._columns, self.kernels[name].entries())

    def problem(self, gap: Gap, density_rate: DensityRate | None = None) -> Complementarity:
        """See `ReynoldsEquation`."""

        def residual(pressure: np.ndarray) -> np.ndarray:
            self._put_once(gap, density_rate)
            return self.balance(self.nodal(pressure))[self.free]

        def entries(pressure: np.ndarray) -> np.ndarray:
            self._put_once(gap, density_rate)
            self.arrays["pressure"][:] = self.nodal(pressure)
            return self.kernels["pressure"].entries()[self._kept]

        return LazyComplementarity(self, residual, entries)  # type: ignore[return-value]

    def _put_once(self, gap: Gap, density_rate: DensityRate | None = None) -> None:
        key = gap, density_rate, id(self)
        if getattr(self, "_put_key", None) is None or any(
            a is not b for a, b in zip(self._put_key[:2], key[:2], strict=True)
        ):
            self.put(gap, density_rate)
            self._put_key = key

    def gap_derivatives(self, gap: Gap, pressure: np.ndarray, rate_shift: float) -> tuple:
        """See `ReynoldsEquation`."""
        self._put_once(gap)
        self.set(rate_shift=rate_shift)
        self.arrays["pressure"][:] = pressure
        names = ["thickness", "mean_velocity"]
        if self.laws.slides:
            names.append("sliding_velocity")
        found = [self.matrix(name) for name in names]
        return (*found, None) if len(found) < 3 else tuple(found)
