"""Reynolds equation (1) of one film: residual, complementarity problem, derivatives.

The equation is dimensionless, see `fenics_ehd.film.weak_form`, whose forms dolfinx assembles. It is
linear in the pressure if viscosity and density do not depend on pressure. The angle of the journal
is not a coefficient of the forms: derivatives with respect to this angle are computed from arrays.
"""

from __future__ import annotations

from copy import copy
from functools import cache, cached_property, partial

import numpy as np
from scipy import sparse

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film.assembly import Assembly, with_data
from fenics_ehd.film.cavitation import Complementarity
from fenics_ehd.film.grid import FilmGrid
from fenics_ehd.film.kinematics import Gap, SurfacePoints
from fenics_ehd.film.lubricant import ARRAYS
from fenics_ehd.film.parameters import Feeds, FeedTerm, FilmParameters, recess_viscosity
from fenics_ehd.film.rough_surfaces import continuation_below
from fenics_ehd.film.supply import given_pressures
from fenics_ehd.film.weak_form import (
    FIELDS,
    GAP,
    SUPPLIES,
    FilmForms,
    Flow,
    Inputs,
    Laws,
    Numbers,
    flow_law,
)

#: Dimensionless rate of gap change below which the source of (11) counts as zero. The assembled
#: source of a uniform gap is round-off, 1e-15 of the flow, for which the problem of 8-node elements
#: may have no solution.
SMALLEST_SOURCE = 1e-4


class ReynoldsEquation:
    """Reynolds equation on the nodes of a film whose pressure is unknown.

    Attributes
    ----------
    free
        Indices of the free nodes, whose pressure is unknown.
    given
        Dimensionless pressure at all nodes, zero at the free ones.
    points
        Gauss points on the bore.
    pattern
        Sparsity pattern of the derivative with respect to the pressures of the free nodes.
    lubricant
        The oil; its temperature may differ from that of `parameters`, which define the scales.
    factors
        Viscosity and density at ambient pressure over those of `parameters`: numbers, or arrays at
        the Gauss points if they depend on position.
    weights
        Entries of the mass matrix N of the complementarity problem (11), in the order of `pattern`;
        None unless the film has 8-node cells.
    laws
        Element family and laws of the film, which determine its compiled forms.
    feeds
        Supplies that conduct oil into the film; None without supplies.
    """

    def __init__(self, parameters: FilmParameters):
        self.parameters = parameters
        grid = parameters.grid
        fixed, pressure = given_pressures(grid, parameters.sides, parameters.regions)
        self.free = np.flatnonzero(~fixed)
        self.given = pressure / parameters.pressure_scale
        self.assembly = Assembly(grid)
        self.points = gauss_points(grid, self.assembly.reference)
        self.lubricant = parameters.lubricant
        weighted = grid.family == "serendipity"
        mass = self.assembly.mass(self.free)
        self.pattern = self.assembly.pattern(self.free)
        self.weights = mass.data if weighted else None
        self._diagonal = mass.diagonal() if weighted else np.ones(len(self.free))
        # Source for a dimensionless rate of one: nodal areas, or ones if divided by the mass
        # matrix.
        unit = np.ones(len(self.free)) if weighted else mass.sum(axis=1)
        self._smallest = SMALLEST_SOURCE * float(np.linalg.norm(unit))
        self.laws = Laws.of(parameters)
        self._set_viscosity(1.0)

    def _set_viscosity(self, ratio: float) -> None:
        """Set the viscosity of film and supplies to `ratio` times that of the parameters."""
        p = self.parameters
        oil = self.lubricant
        surfaces = self.parameters.surfaces
        viscosity, density = (self._field(name) for name in FIELDS)
        if p.recesses:
            viscosity = viscosity * recess_viscosity(p, self.points)
        self.factors = [ratio * viscosity, density]
        supplied = (p, self.points, self.assembly.area, density / self.factors[0])
        self.feeds = Feeds(*supplied) if p.feeds else None
        self._numbers = Numbers(
            squeeze=1.0,
            storage=0.0,
            rate_shift=0.0,
            level=0.0,
            clearance=p.clearance,
            speed=p.rate * p.grid.radius,
            rate=p.rate,
            pressure_scale=p.pressure_scale,
            viscosity=1.0 if self.laws.fields else self.factors[0],
            density=1.0 if self.laws.fields else self.factors[1],
            viscosity_law=oil.viscosity_law.numbers,
            density_law=oil.density_law.numbers,
            shear_law=() if oil.shear_law is None else oil.shear_law.numbers,
            surfaces=()
            if surfaces is None
            else (surfaces.roughness, surfaces.weight, *continuation_below()),
        )

    @cached_property
    def forms(self) -> FilmForms:
        """Forms on this mesh, made on first use because plots of films need none."""
        return FilmForms(self.parameters.grid, self.laws, self._numbers.layout)

    @cached_property
    def _entry_indices(self) -> np.ndarray:
        return self.forms.entry_indices(self.pattern, self.free)

    def _field(self, name: str) -> np.ndarray | float:
        function = getattr(self.parameters.lubricant, name)
        if function is None:
            return 1.0
        values = np.asarray(function(self.points.angle, self.points.height), dtype=float)
        if not np.all(np.isfinite(values) & (values > 0)):
            raise SettingsError(f"the lubricant's {name} must be finite and above 0 everywhere")
        return values

    def at_temperature(self, temperature: float) -> ReynoldsEquation:
        """Return this equation with the viscosity of the oil at another temperature [C].

        Densities are not changed: the equation balances volumes at ambient density. Both equations
        share forms and sparsity patterns.

        Raises
        ------
        SettingsError
            If the lubricant has no viscosity at this temperature, see `Lubricant.at`.
        """
        reference = self.parameters.lubricant
        equation = copy(self)
        equation.lubricant = reference.at(temperature)
        equation._set_viscosity(equation.lubricant.viscosity / reference.viscosity)
        return equation

    def fed(self, gap: Gap, flow: Flow | None = None, *, lumped: bool = False) -> FeedTerm | None:
        """Term of the supplies in the equation for a gap, see `Feeds.term`; None without supplies.

        `flow` is the film's flow without pressure; it is computed if it is None.
        """
        if self.feeds is None:
            return None
        return self.feeds.term(gap, (flow or self.flow(gap)).thickness, lumped=lumped)

    def nodal(self, pressure: np.ndarray) -> np.ndarray:
        """Dimensionless pressures at all nodes, shape (nodes,), from those at the free nodes."""
        values = self.given.copy()
        values[self.free] = pressure
        return values

    def inputs(
        self,
        gap: Gap,
        *,
        squeeze: float = 1.0,
        storage: float = 0.0,
        rate_shift: float = 0.0,
        supplied: bool = True,
    ) -> Inputs:
        """Data with which the forms of the equation are assembled for a gap.

        Parameters
        ----------
        gap
            Gap at the Gauss points.
        squeeze, storage, rate_shift
            Coefficients of the source and of its derivative, see `Numbers`.
        supplied
            Whether the forms contain the flow of supplies.
        """
        values = {name: getattr(gap, name) for name in GAP}
        shape = gap.thickness.shape
        if self.laws.fields:
            fields = (np.broadcast_to(factor, shape) for factor in self.factors)
            values |= zip(FIELDS, fields, strict=True)
        if self.laws.supplies:
            assert self.feeds is not None
            supplies = self.feeds.values(gap) if supplied else np.zeros((len(SUPPLIES), *shape))
            values |= zip(SUPPLIES, supplies, strict=True)
        numbers = self._numbers.flat.copy()
        level = self._numbers.density * gap.thickness.flat[0] / self.parameters.clearance
        level *= gap.mean_velocity.flat[0] / self._numbers.speed
        numbers[:4] = squeeze, storage, rate_shift, level
        return Inputs(numbers, values)

    def balance(self, inputs: Inputs, nodal: np.ndarray) -> np.ndarray:
        """Residual of the Reynolds equation at every node, from dimensionless nodal pressures.

        It is the weak form tested with the shape function of the node, shape (nodes,).

        Raises
        ------
        ViscosityError
            If the viscosity at the largest pressure is above its limit.
        """
        law = self.lubricant.viscosity_law
        if not law.constant:
            law(self.parameters.pressure_scale * np.maximum(nodal.max(keepdims=True), 0.0))
        return self.forms.vector(inputs, nodal)

    def problem(self, gap: Gap) -> Complementarity:
        """Complementarity problem (11) for a gap; its functions assemble the forms when called."""
        inputs = self.inputs(gap)

        def residual(pressure: np.ndarray) -> np.ndarray:
            return self.balance(inputs, self.nodal(pressure))[self.free]

        def entries(pressure: np.ndarray) -> np.ndarray:
            return self.forms.matrix(inputs, self.nodal(pressure))[self._entry_indices]

        first = cache(partial(entries, np.zeros(len(self.free))))
        return Complementarity(
            residual,
            (lambda p: first()) if self.parameters.lubricant.linear else entries,
            self._diagonal,
            self._smallest,
            self.weights,
        )

    def flow(self, gap: Gap, nodal: np.ndarray | None = None) -> Flow:
        """Dimensionless viscosity, density and flow of the oil at the Gauss points.

        `nodal` are dimensionless nodal pressures; None for a film at ambient pressure.
        """
        pressure = np.zeros(gap.thickness.shape)
        if nodal is not None:
            pressure = self.assembly.at_points(nodal)[0]
        return flow_law(
            self.laws, self._numbers, self.inputs(gap, supplied=False).values, pressure, ARRAYS
        )

    def gap_derivatives(
        self,
        gap: Gap,
        pressure: np.ndarray,
        rate_shift: float = 0.0,
        *,
        inputs: Inputs | None = None,
    ) -> tuple[sparse.csc_matrix, sparse.csc_matrix, sparse.csc_matrix | None]:
        """Sparse derivatives of the residual with respect to the gap, shape (nodes, c * q) each.

        The mesh has c cells with q Gauss points each.

        Parameters
        ----------
        gap, pressure
            Gap at the Gauss points, and dimensionless nodal pressures, shape (nodes,).
        rate_shift
            Derivative ``d h' / d h`` of the thickness rate [1/s].
        inputs
            Data of the forms to use instead of `inputs(gap)`; `rate_shift` is then ignored.

        Returns
        -------
        thickness, velocity, sliding
            Derivatives with respect to the thickness at the Gauss points [1/m], including that of
            the thickness rate; to the mean velocity [s/m]; and to the sliding velocity [s/m].
            `sliding` is None unless the oil thins or one surface is rougher than the other.
        """
        inputs = inputs or self.inputs(gap, rate_shift=rate_shift)
        thickness, sliding = self.forms.along_gap(inputs, pressure)
        flow = self.flow(gap, pressure)
        carried = flow.density * flow.thickness / self._numbers.speed
        drag = carried[:, :, None] * self.assembly.drag
        return thickness, with_data(self.assembly.tested, drag.ravel()), sliding

    def along_turn(self, gap: Gap, pressure: np.ndarray) -> np.ndarray:
        """Derivative of the residual with respect to the journal's angle [1/rad], (nodes,)."""
        feed = self.fed(gap)
        if feed is None:
            return np.zeros(self.assembly.size)
        slope = feed.outflow(self.assembly.at_points(pressure)[0], feed.along_turn)
        return self.assembly.source(slope.sum(axis=0))


def gauss_points(grid: FilmGrid, reference: np.ndarray) -> SurfacePoints:
    """Gauss points of every cell of a film mesh, arrays of shape (cells, points).

    `reference` has the Gauss points of the unit cell, shape (points, 2).
    """
    around, along = grid.cells
    widths = np.diff(grid.angles)
    heights = np.diff(grid.heights)
    angle = grid.angles[:-1, None] + widths[:, None] * reference[:, 0]
    height = grid.heights[:-1, None] + heights[:, None] * reference[:, 1]
    return SurfacePoints(np.repeat(angle, along, axis=0), np.tile(height, (around, 1)))
