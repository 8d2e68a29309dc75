"""Weak form of the Reynolds equation (1) in UFL, with one flux law for the form and for arrays.

All quantities are dimensionless: pressure ``P = p / p_s`` with ``p_s = 12 eta Omega (R / c)^2``,
gap ``H = h / c``, time in units of ``1 / Omega``, lengths in units of the bore radius ``R``. With
the flux and the source

    f = k grad P - rho H V e_phi,     s = d(rho H) / dt,     k = rho H^3 / eta

the weak form on the flat mesh of the unwrapped bore, for test functions v, is

    r(v) = int f . grad v + s v

`flow_law` defines eta, rho, H, V and k once: for the symbols of the weak form, and for arrays, from
which losses, friction and heat are evaluated. UFL differentiates the weak form with respect to the
pressure and to the gap's data, which are functions of the quadrature space. The derivative with
respect to the mean velocity is ``-rho H`` times the slope of v.

Between rough surfaces (`fenics_ehd.film.rough_surfaces`) H is the average gap ``h_T``, and with
flow factors ``k = rho (sigma / c)^3 (h / sigma)^3 phi_p / eta`` and ``V + (U / 2) sigma w phi_s /
h_T`` replace k and V.

The source is ``rho (a dH/dt + b H)``: a = 1, b = 0 for a density constant in time; a = 0, b = 1 /
step for the oil content at the end of a step. Supplies add ``(H^3 q + t) P - (H^3 q_s + t_s)``: q
and t are the conductances of supplies without and with a resistance, q_s and t_s these conductances
times the supply pressures.

Coefficients of the laws are constants of the form: only another combination of laws requires
another form.

**On a mesh** dolfinx assembles vectors and matrices of the weak form. A combination of laws is
compiled once; other meshes, oils and temperatures use the same kernels.

The mesh is the unwrapped bore, flat. Node numbers make it periodic: a node at one end of the
circumference and its counterpart at the other end have the same number in the film's grid. Gap data
are functions of the quadrature space, numbered cell by cell like arrays (cells, points). Matrices
have rows for all nodes; solvers pick the entries of their own sparsity pattern, which omits nodes
of given pressure. Derivatives with respect to the gap are assembled transposed, with a row for
every Gauss point: the entries of these rows are those of the columns of a sparse matrix (nodes,
points).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache, cached_property
from itertools import islice
from typing import Any, NamedTuple

import fenics_ehd.base.petsc_start  # noqa: F401  # isort: skip
import numpy as np
import ufl
from dolfinx import cpp, fem
from scipy import sparse

from fenics_ehd.base import compat
from fenics_ehd.fem.elements import quadratic_element
from fenics_ehd.film import rough_surfaces
from fenics_ehd.film.assembly import GAUSS_POINTS, Pattern, with_data
from fenics_ehd.film.grid import FilmGrid
from fenics_ehd.film.lubricant import Functions, Law, PressureLaw
from fenics_ehd.film.parameters import FilmParameters

#: Polynomial degree up to which integrals over the Gauss points are exact.
DEGREE = 2 * GAUSS_POINTS - 1

SYMBOLS = Functions(ufl.exp, ufl.erf, ufl.conditional)

GAP = ("thickness", "thickness_rate", "mean_velocity", "sliding_velocity")
FIELDS = ("viscosity_field", "density_field")
SUPPLIES = ("film_conductance", "film_supply", "passage_conductance", "passage_supply")


@dataclass(frozen=True)
class Laws:
    """Element family and combination of laws for which the forms of a film are compiled.

    Attributes
    ----------
    family
        Element family, see `FilmGrid`.
    viscosity, density, thinning
        Classes of the oil's laws of viscosity, density and shear thinning; `thinning` is None if
        the oil does not thin.
    rough, flow_factors, dragging
        Whether the surfaces are rough, so that H is the average gap; whether Patir and Cheng's flow
        factors are used; whether sliding changes the flow because one surface is rougher.
    fields
        Whether viscosity or density depend on position.
    supplies
        Whether supplies conduct oil into the film.
    """

    family: str
    viscosity: type[PressureLaw]
    density: type[PressureLaw]
    thinning: type[Law] | None = None
    rough: bool = False
    flow_factors: bool = False
    dragging: bool = False
    fields: bool = False
    supplies: bool = False

    @classmethod
    def of(cls, p: FilmParameters) -> Laws:
        """Element family and laws of a film with the parameters `p`."""
        oil = p.lubricant
        surfaces = p.surfaces
        return cls(
            p.grid.family,
            type(oil.viscosity_law),
            type(oil.density_law),
            None if oil.shear_law is None else type(oil.shear_law),
            surfaces is not None,
            surfaces is not None and surfaces.flow_factors,
            surfaces is not None and surfaces.dragging,
            bool(oil.viscosity_field or oil.density_field or p.recesses),
            bool(p.feeds),
        )

    @property
    def values(self) -> tuple[str, ...]:
        """Names of all input fields at the Gauss points: gap, properties of the oil, supplies."""
        fields = FIELDS if self.fields else ()
        return GAP + fields + (SUPPLIES if self.supplies else ())

    @property
    def sliding(self) -> bool:
        """Whether the flow depends on the sliding velocity."""
        return self.thinning is not None or self.dragging


@dataclass(frozen=True)
class Numbers:
    """Constants of the weak form of the Reynolds equation: numbers, or UFL symbols for them.

    Attributes
    ----------
    squeeze, storage
        Coefficients a and b of the source ``rho (a dH/dt + b H)``, with the thickness H.
    rate_shift
        Derivative ``d h' / d h`` of the thickness rate with respect to the thickness [1/s]. It
        enters the derivative of the residual with respect to the thickness.
    level
        Constant that is subtracted from the dragged flow ``rho H V``. A uniform flow has no
        divergence, but its round-off would decide which nodes are full if the journal is centred.
    clearance, speed, rate, pressure_scale
        Clearance c [m], reference velocity ``Omega R`` [m/s], reference angular speed Omega
        [rad/s], and unit p_s of the dimensionless pressure [Pa].
    viscosity, density
        Viscosity and density of the oil at ambient pressure, over those in the scales of the
        equation.
    viscosity_law, density_law, shear_law
        Coefficients of the laws of viscosity, density and shear thinning, see `Law.numbers`.
    surfaces
        Roughness sigma [m], weight w (`RoughSurfaces.weight`), and the coefficients of
        `rough_surfaces.mobility`; empty for smooth surfaces.
    """

    squeeze: Any
    storage: Any
    rate_shift: Any
    level: Any
    clearance: Any
    speed: Any
    rate: Any
    pressure_scale: Any
    viscosity: Any
    density: Any
    viscosity_law: tuple
    density_law: tuple
    shear_law: tuple
    surfaces: tuple

    @cached_property
    def flat(self) -> np.ndarray:
        """All constants of the weak form in one array, in the order of the attributes."""
        return np.hstack([getattr(self, number.name) for number in fields(self)]).astype(float)

    @property
    def layout(self) -> tuple[int | None, ...]:
        """Length of each attribute, in the attributes' order; None for a single number."""
        values = [getattr(self, number.name) for number in fields(self)]
        return tuple(len(value) if isinstance(value, tuple) else None for value in values)

    @classmethod
    def spread(cls, layout: Sequence[int | None], constants: Iterable[Any]) -> Numbers:
        """Make `Numbers` from all constants, in the order of `flat`.

        `layout` has the length of each attribute, see `Numbers.layout`.
        """
        rest = iter(constants)
        return cls(*(next(rest) if n is None else tuple(islice(rest, n)) for n in layout))


class Flow(NamedTuple):
    """Oil in a gap and its flow, dimensionless: UFL's expressions, or arrays (cells, points).

    Attributes
    ----------
    viscosity, density
        Viscosity eta and density rho, over those in the scales of the equation.
    conductance
        Factor ``k = rho H^3 / eta`` of the pressure gradient in the flux.
    thickness, slope
        Thickness H, which is the average gap h_T between rough surfaces; and the derivative ``dh_T
        / dh`` of the average gap with respect to the nominal gap, 1 between smooth surfaces.
    velocity
        Velocity V at which the surfaces drag the oil, mean over the thickness.
    """

    viscosity: Any
    density: Any
    conductance: Any
    thickness: Any
    slope: Any
    velocity: Any


def flow_law(laws: Laws, n: Numbers, q: Mapping[str, Any], pressure: Any, f: Functions) -> Flow:
    """Oil and its flow in a gap at a dimensionless pressure, as UFL expressions or as arrays.

    Parameters
    ----------
    laws, n
        Combination of laws, and its constants.
    q
        Input fields at the Gauss points (gap, oil, supplies) by name, see `Laws.values`.
    pressure
        Dimensionless pressure at the Gauss points.
    f
        Elementary functions of UFL expressions, or of arrays.
    """
    # Interpolated pressures may be negative between nodes; the oil's laws require at least zero.
    p = n.pressure_scale * f.where(pressure >= 0.0, pressure, 0.0)
    density = n.density * laws.density.ratio(f, p, *n.density_law)
    viscosity = n.viscosity * laws.viscosity.ratio(f, p, *n.viscosity_law)
    if laws.fields:
        density = density * q["density_field"]
        viscosity = viscosity * q["viscosity_field"]
    thickness = q["thickness"] / n.clearance
    slope = 1.0
    velocity = q["mean_velocity"]
    sliding = q["sliding_velocity"]
    mobility = thickness * thickness * thickness
    if laws.rough:
        sigma, weight, *continuation = n.surfaces
        ratio = q["thickness"] / sigma
        unit = sigma / n.clearance
        average, slope = rough_surfaces.mean_gap(ratio, f)
        thickness = unit * average
        mobility = thickness * thickness * thickness
        if laws.flow_factors:
            mobility = unit * unit * unit * rough_surfaces.mobility(ratio, average, continuation, f)
        if laws.dragging:
            drag = 0.5 * weight * rough_surfaces.shear_factor(ratio, f) / average
            velocity = velocity + sliding * drag
    if laws.thinning is not None:
        speed = f.where(sliding < 0.0, -sliding, sliding)
        rate = speed / (n.clearance * thickness)
        viscosity = viscosity * laws.thinning.ratio(f, rate, *n.shear_law)
    conductance = density * mobility / viscosity
    return Flow(viscosity, density, conductance, thickness, slope, velocity / n.speed)


def pressure_element(family: str) -> Any:
    """Finite element of the pressure on the flat mesh, for an element family."""
    if family == "serendipity":
        return compat.plane(quadratic_element(family, "quadrilateral"))
    degree = 1 if family == "bilinear" else 2
    return compat.lagrange_element("quadrilateral", degree, dimension=2)


class WeakForm:
    """UFL forms of the Reynolds equation's residual and its derivatives, independent of a mesh.

    Parameters
    ----------
    laws
        Combination of laws.
    layout
        Layout of the constants of the laws, see `Numbers.layout`.

    Attributes
    ----------
    laws
        Combination of laws of these forms.
    coefficients
        UFL symbols of the nodal pressure and of the input fields (`Laws.values`), by name.
    forms
        Forms by name: ``"residual"``, and its derivatives with respect to ``"pressure"``,
        ``"thickness"`` and ``"sliding_velocity"``. The last two are transposed, with a row for
        every Gauss point.
    """

    def __init__(self, laws: Laws, layout: Sequence[int | None]):
        self.laws = laws
        domain = compat.plane_domain()
        gauss = ufl.FunctionSpace(domain, compat.quadrature_element(DEGREE))
        nodes = ufl.FunctionSpace(domain, pressure_element(laws.family))
        count = sum(1 if n is None else n for n in layout)
        constant = ufl.Constant(domain, shape=(count,))
        n = Numbers.spread(layout, [constant[i] for i in range(count)])
        q = {name: compat.Coefficient(gauss) for name in laws.values}
        pressure = compat.Coefficient(nodes)
        self.coefficients = {"pressure": pressure, **q}
        u = ufl.TrialFunction(nodes)
        v = ufl.TestFunction(nodes)
        w = ufl.TrialFunction(gauss)
        dx = ufl.dx(domain, metadata={"quadrature_degree": DEGREE, "quadrature_rule": "default"})
        residual = self._integrand(laws, n, q, pressure, v) * dx
        thickness, rate = (ufl.derivative(residual, q[name], w) for name in GAP[:2])
        self.forms = {
            "residual": residual,
            "pressure": ufl.derivative(residual, pressure, u),
            "thickness": ufl.adjoint(thickness + n.rate_shift * rate),
        }
        if laws.sliding:
            sliding = ufl.derivative(residual, q["sliding_velocity"], w)
            self.forms["sliding_velocity"] = ufl.adjoint(sliding)

    @staticmethod
    def _integrand(laws: Laws, n: Numbers, q: Mapping[str, Any], pressure: Any, v: Any) -> Any:
        """Integrand of the residual: Reynolds equation times test function v, with supply flow."""
        flow = flow_law(laws, n, q, pressure, SYMBOLS)
        dragged = flow.density * flow.thickness * flow.velocity - n.level
        around = flow.conductance * pressure.dx(0) - dragged
        growth = n.squeeze * flow.slope * q["thickness_rate"] / (n.clearance * n.rate)
        source = flow.density * (growth + n.storage * flow.thickness)
        if laws.supplies:
            cube = flow.thickness * flow.thickness * flow.thickness
            source += (cube * q["film_conductance"] + q["passage_conductance"]) * pressure
            source -= cube * q["film_supply"] + q["passage_supply"]
        return around * v.dx(0) + flow.conductance * pressure.dx(1) * v.dx(1) + source * v


#: Number of Gauss points in a cell.
POINTS = GAUSS_POINTS**2


@cache
def compiled(laws: Laws, layout: tuple[int | None, ...]) -> tuple[WeakForm, dict[str, Any]]:
    """Weak form of a combination of laws, and its compiled forms by name, cached in the process."""
    weak = WeakForm(laws, layout)
    handles = compat.compile_forms(list(weak.forms.values()))
    return weak, dict(zip(weak.forms, handles, strict=True))


@dataclass(frozen=True, eq=False)
class Inputs:
    """Data with which the forms are assembled, except for the pressure.

    Attributes
    ----------
    numbers
        Constants of the forms, in the order of `Numbers.flat`.
    values
        Fields at the Gauss points by the names of `Laws.values`, shape (cells, points) each.
    """

    numbers: np.ndarray
    values: Mapping[str, np.ndarray]


class FilmForms:
    """Forms of a combination of laws on one film mesh, with their vectors and matrices.

    Parameters
    ----------
    grid
        The film mesh.
    laws, layout
        Combination of laws, and layout of its constants, see `WeakForm`.
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
                ("points", compat.quadrature_element(DEGREE), points, points.size),
            )
        }
        self._functions = {
            name: fem.Function(self._spaces["nodes" if name == "pressure" else "points"])
            for name in self._weak.coefficients
        }
        self._arrays = {name: function.x.array for name, function in self._functions.items()}
        count = sum(1 if n is None else n for n in layout)
        self._constant = fem.Constant(self._mesh, np.zeros(count))
        self._make_forms()
        shape = (self._size, points.size)
        nodes = grid.cell_nodes.shape[1]
        rows = np.repeat(np.sort(grid.cell_nodes, axis=1)[:, None, :], POINTS, axis=1).ravel()
        starts = np.arange(points.size + 1) * nodes
        self._columns = sparse.csc_matrix((np.zeros(rows.size), rows, starts), shape)

    def vector(self, inputs: Inputs, nodal: np.ndarray) -> np.ndarray:
        """Residual at every node, shape (nodes,), for dimensionless nodal pressures `nodal`."""
        form = self._forms["residual"]
        values = np.zeros(self._size)
        cpp.fem.assemble_vector(values, form, inputs.numbers, self._packed(form, inputs, nodal))
        return values

    def matrix(self, inputs: Inputs, nodal: np.ndarray) -> np.ndarray:
        """Entries of the derivative of the residual with respect to the nodal pressures.

        They are in dolfinx's order; `entry_indices` finds those of a sparsity pattern.
        """
        return self._entries("pressure", "nodes", inputs, nodal)

    def along_gap(
        self, inputs: Inputs, nodal: np.ndarray
    ) -> tuple[sparse.csc_matrix, sparse.csc_matrix | None]:
        """Derivatives of the residual with respect to thickness and sliding velocity.

        Both have the shape (nodes, points), with a column for every Gauss point. The derivative
        with respect to thickness includes that of the thickness rate, which changes by
        `Numbers.rate_shift` per thickness. The derivative with respect to sliding velocity is None
        if the flow does not depend on it.
        """
        thickness = self._entries("thickness", "points", inputs, nodal)
        if not self._weak.laws.sliding:
            return with_data(self._columns, thickness), None
        sliding = self._entries("sliding_velocity", "points", inputs, nodal)
        return with_data(self._columns, thickness), with_data(self._columns, sliding)

    def entry_indices(self, pattern: Pattern, nodes: np.ndarray) -> np.ndarray:
        """Index of every entry of a sparsity pattern in the array of entries from `matrix`.

        Row and column i of the pattern belong to node ``nodes[i]``. An entry of the pattern that
        `matrix` does not have gets the index after the last one.
        """
        matrix = self._matrices["nodes"]
        starts = np.array(matrix.indptr)
        columns = np.array(matrix.indices)
        rows = np.repeat(np.arange(self._size), np.diff(starts))
        codes = rows * self._size + columns
        order = np.argsort(codes)
        wanted = nodes[pattern.rows] * self._size + nodes[pattern.indices]
        position = np.searchsorted(codes, wanted, sorter=order)
        entries = order[np.minimum(position, len(order) - 1)]
        return np.where(codes[entries] == wanted, entries, len(codes))

    def _make_forms(self) -> None:
        """Make the forms on this mesh, and matrices with a row for every node or Gauss point."""
        self._forms: dict[str, Any] = {}
        self._matrices: dict[str, Any] = {}
        named = {id(symbol): name for name, symbol in self._weak.coefficients.items()}
        for name, handle in self._handles.items():
            symbols = self._weak.forms[name].coefficients()
            taken = [named[id(symbols[i])] for i in compat.coefficient_positions(handle)]
            rows = {"residual": [], "pressure": ["nodes"]}.get(name, ["points"])
            spaces = [self._spaces[space] for space in [*rows, "nodes"]]
            functions = [self._functions[coefficient] for coefficient in taken]
            form = compat.create_form(handle, spaces, functions, self._constant, self._mesh)
            self._forms[name] = form
            for space in rows:
                self._matrices[space] = compat.native_matrix(form, spaces, self._mesh)

    def _packed(self, form: Any, inputs: Inputs, nodal: np.ndarray) -> Any:
        self._arrays["pressure"][:] = nodal
        for name, values in inputs.values.items():
            self._arrays[name][:] = values.ravel()
        return cpp.fem.pack_coefficients(form)

    def _entries(self, name: str, rows: str, inputs: Inputs, nodal: np.ndarray) -> np.ndarray:
        form = self._forms[name]
        matrix = self._matrices[rows]
        data = matrix.data
        data[:] = 0.0
        packed = self._packed(form, inputs, nodal)
        cpp.fem.assemble_matrix(matrix, form, inputs.numbers, packed, [])
        return data.copy()


def _flat_mesh(grid: FilmGrid) -> Any:
    """Flat dolfinx mesh of the unwrapped bore, with the coordinates angle and height / radius."""
    around, along = grid.cells
    heights = grid.heights / grid.radius
    x = np.column_stack([np.repeat(grid.angles, along + 1), np.tile(heights, around + 1)])
    i, j = (a.ravel() for a in np.meshgrid(range(around), range(along), indexing="ij"))
    corners = [(i + a) * (along + 1) + j + b for b in (0, 1) for a in (0, 1)]
    return compat.plane_mesh(np.column_stack(corners), x)
