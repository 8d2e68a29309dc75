"""The discrete Reynolds equation of one film: its residual and exact derivatives.

Dimensionless, see `forms`; oils of constant properties make it linear in the
pressure, others do not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film.assembly import Assembly, Coefficients
from fenics_ehd.film.balance import (
    OilProperties,
    balance,
    balance_derivative,
    flux_change,
    flux_derivatives,
    sliding_derivative,
)
from fenics_ehd.film.cavitation import Complementarity
from fenics_ehd.film.feeding import Feeds, FeedTerm, recess_viscosity
from fenics_ehd.film.grid import FilmGrid
from fenics_ehd.film.kinematics import Gap, GapDerivatives, SurfacePoints
from fenics_ehd.film.parameters import FilmParameters
from fenics_ehd.film.supply import given_pressures
from fenics_ehd.film.thinning import Thinning, thinning

#: Below this dimensionless rate of gap change the source of (11) counts as zero.
SMALLEST_SOURCE = 1e-6

#: The same for 8-node elements: their problem may have no solution for a source of round-off.
SMALLEST_WEIGHTED_SOURCE = 1e-4


@dataclass(frozen=True, eq=False)
class DensityRate:
    """Rate of the density, ``d rho / dt = shift * rho + history``, the last term of (1).

    Attributes
    ----------
    shift
        Of the time integration formula, 1 / step for implicit Euler [1/s].
    history
        At the Gauss points, shape (cells, points), of the density over that of
        the oil at zero pressure [1/s]; implicit Euler: minus the shift times
        `Film.density` of the step before.
    """

    shift: float
    history: np.ndarray


class ReynoldsEquation:
    """Reynolds equation on the nodes of a film whose pressure is unknown.

    Attributes
    ----------
    free
        Those nodes.
    given
        Dimensionless pressure at all nodes, zero at the free ones.
    points
        Gauss points on the bore.
    lubricant
        The oil, at another temperature perhaps than that of `parameters`, which give the scales.
    factors
        Viscosity and density that depend on place and temperature, over those of `parameters`.
    surfaces
        See `FilmParameters`.
    weights
        Entries of the mass matrix N of (11) for the 8-node element, else None.
    feeds
        Supplies that conduct oil into the film; None: there are none.
    """

    def __init__(self, parameters: FilmParameters):
        self.parameters = parameters
        grid = parameters.grid
        fixed, pressure = given_pressures(grid, parameters.sides, parameters.regions)
        self.free = np.flatnonzero(~fixed)
        self.given = pressure / parameters.pressure_scale
        self._supplied = bool(pressure.any())
        self.assembly = Assembly(grid, self.free)
        self.points = gauss_points(grid, self.assembly.tensors.points)
        self.lubricant = parameters.lubricant
        self.surfaces = parameters.surfaces
        self._conductance = (
            None if self.surfaces is None else self.surfaces.conductance(parameters.clearance)
        )
        self.factors = [self._field(f) for f in ("viscosity_field", "density_field")]
        if parameters.recesses:
            self.factors[0] = self.factors[0] * recess_viscosity(parameters, self.points)
        self.feeds: Feeds | None = None
        if parameters.feeds:
            mobility = self.factors[1] / self.factors[0]
            self.feeds = Feeds(parameters, self.points, self.assembly.area, mobility)
        weighted = grid.family == "serendipity"
        zero = np.zeros(self.assembly.area.shape)
        mass = self.assembly.matrix(Coefficients(zero, zero, mass=zero + 1))
        self.weights = mass if weighted else None
        pattern = self.assembly.pattern
        self._weight_diagonal = mass[pattern.diagonal] if weighted else 1.0
        # The source of a film at unit speed: nodal areas, or ones when divided by the mass matrix.
        unit = np.ones(len(self.free)) if weighted else pattern.matrix(mass).sum(axis=1)
        smallest = SMALLEST_WEIGHTED_SOURCE if weighted else SMALLEST_SOURCE
        self._smallest = smallest * float(np.linalg.norm(unit))

    def _field(self, name: str) -> np.ndarray | float:
        function = getattr(self.parameters.lubricant, name)
        if function is None:
            return 1.0
        values = np.asarray(function(self.points.angle, self.points.height), dtype=float)
        if not np.all(np.isfinite(values) & (values > 0)):
            raise SettingsError(f"the {name} of the lubricant must be above 0 everywhere")
        return values

    def warm(self, temperature: float) -> None:
        """Give the oil the viscosity of another temperature [C]; volumes stay volumes.

        Raises
        ------
        SettingsError
            See `Lubricant.at`.
        """
        given = self.parameters.lubricant
        self.lubricant = given.at(temperature)
        ratio = self.lubricant.viscosity / given.viscosity
        self.factors = [ratio * self._field("viscosity_field"), self.factors[1]]

    def dimensionless(self, gap: Gap) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``H``, ``dH/dt`` and the mean velocity over ``Omega R``; rough surfaces' average ones."""
        p, gap = self.parameters, self.seen(gap)
        return (
            gap.thickness / p.clearance,
            gap.thickness_rate / (p.clearance * p.rate),
            gap.mean_velocity / (p.rate * p.grid.radius),
        )

    def seen(self, gap: Gap) -> Gap:
        """The gap in which oil flows: the average one between rough surfaces."""
        return gap if self.surfaces is None else self.surfaces.average(gap)

    def fed(self, gap: Gap, *, lumped: bool = False) -> FeedTerm | None:
        """What supplies add to the equation at a gap, see `Feeds.term`; None without any."""
        if self.feeds is None:
            return None
        return self.feeds.term(gap, self.dimensionless(gap)[0], lumped=lumped)

    def nodal(self, pressure: np.ndarray) -> np.ndarray:
        """Dimensionless pressure at all nodes from that at the free ones."""
        values = self.given.copy()
        values[self.free] = pressure
        return values

    def thinning(self, gap: Gap) -> Thinning | None:
        """What the shear rate does to the viscosity in a gap; None: nothing."""
        p = self.parameters
        law = p.lubricant.shear_law
        if law is None:
            return None
        speed = p.rate * p.grid.radius
        thickness = self.seen(gap).thickness
        return thinning(law, thickness, gap.sliding_velocity, p.clearance, speed)

    def problem(self, gap: Gap, density_rate: DensityRate | None = None) -> Complementarity:
        """The complementarity problem (11) of a gap."""
        if not self.parameters.lubricant.linear:
            return self._nonlinear_problem(gap, density_rate)
        thickness, rate, velocity = self.dimensionless(gap)
        viscosity, density = self.factors
        thinned = self.thinning(gap)
        if thinned is not None:
            viscosity = viscosity * thinned.ratio
        mobility = density * thickness**3 / viscosity
        if self._conductance is not None:
            mobility = mobility * self._conductance(thickness)[0]
        feed = self.fed(gap)
        mass = None if feed is None else feed.total
        entries = self.assembly.matrix(Coefficients(mobility, mobility, mass=mass))
        around, along, source = -density * thickness * velocity, None, density * rate
        if self._supplied:
            _, slope_around, slope_along = self.assembly.at_points(self.given)
            around, along = around + mobility * slope_around, mobility * slope_along
        if feed is not None:
            source = source + feed.outflow(self.assembly.at_points(self.given)[0])
        constant = self.assembly.vector(around, along, source)[self.free]
        return self._complementarity(
            lambda p: self.assembly.pattern.multiply(entries, p) + constant,
            lambda p: entries,
            constant,
            entries,
        )

    def _nonlinear_problem(self, gap: Gap, density_rate: DensityRate | None) -> Complementarity:
        """Problem of an oil whose properties change with pressure; derivatives by hand, exact."""
        thickness, rate, velocity = self.dimensionless(gap)
        thinned, feed = self.thinning(gap), self.fed(gap)

        def residual(pressure: np.ndarray) -> np.ndarray:
            nodal = self.nodal(pressure)
            oil = self.oil(nodal, thinned, density_rate)
            values = balance(self.assembly, oil, thickness, velocity, rate)
            if feed is not None:
                values += self.assembly.source(feed.outflow(self.assembly.at_points(nodal)[0]))
            return values[self.free]

        def entries(pressure: np.ndarray) -> np.ndarray:
            oil = self.oil(self.nodal(pressure), thinned, density_rate)
            coefficients = balance_derivative(oil, thickness, velocity, rate)
            if feed is not None:
                coefficients = replace(coefficients, mass=coefficients.mass + feed.total)
            return self.assembly.matrix(coefficients)

        zero = np.zeros(len(self.free))
        return self._complementarity(residual, entries, residual(zero), entries(zero))

    def _complementarity(
        self,
        residual: Callable[[np.ndarray], np.ndarray],
        entries: Callable[[np.ndarray], np.ndarray],
        start: np.ndarray,
        first: np.ndarray,
    ) -> Complementarity:
        """Problem from its residual and derivative and their values at zero pressure."""
        scale = max(float(np.linalg.norm(start / self._weight_diagonal)), self._smallest)
        # What the source builds up over one cell.
        unit = max(float(np.abs(start).max()), self._smallest) / float(first.max())
        return Complementarity(residual, entries, scale, self.weights, unit)

    def oil(
        self,
        nodal: np.ndarray,
        thinned: Thinning | None,
        density_rate: DensityRate | None = None,
    ) -> OilProperties:
        """Oil and pressure derivatives at the Gauss points, dimensionless; see `thinning`."""
        p = self.parameters
        value, around, along = self.assembly.at_points(nodal)
        factors = self.factors
        if thinned is not None:
            factors = [factors[0] * thinned.ratio, factors[1]]
        if p.lubricant.linear and density_rate is None:
            viscosity, density = factors
            none = np.zeros(value.shape)
            return OilProperties(
                around,
                along,
                none + viscosity,
                none,
                none + density,
                none,
                none,
                none,
                thinned,
                self._conductance,
            )
        # Shape functions may undershoot between nodes, where the laws are not meant: the oil
        # keeps its properties there.
        inside = value >= 0.0
        pressure = np.where(inside, value, 0.0) * p.pressure_scale
        viscosity, viscosity_derivative = self.lubricant.viscosity_law(pressure)
        density, density_derivative = self.lubricant.density_law(pressure)
        viscosity_derivative, density_derivative = (
            inside * viscosity_derivative,
            inside * density_derivative,
        )
        expansion, expansion_derivative = np.zeros_like(value), np.zeros_like(value)
        density_derivative = factors[1] * density_derivative * p.pressure_scale
        if density_rate is not None:
            shift = density_rate.shift / p.rate
            expansion = shift * factors[1] * density + density_rate.history / p.rate
            expansion_derivative = shift * density_derivative
        return OilProperties(
            around,
            along,
            factors[0] * viscosity,
            factors[0] * viscosity_derivative * p.pressure_scale,
            factors[1] * density,
            density_derivative,
            expansion,
            expansion_derivative,
            thinned,
            self._conductance,
        )

    def change(
        self,
        gap: Gap,
        pressure: np.ndarray,
        derivatives: GapDerivatives,
        density_rate: DensityRate | None = None,
    ) -> np.ndarray:
        """Change of the residual at the free nodes along changes of the gap.

        Parameters
        ----------
        gap, pressure, density_rate
            A gap and dimensionless nodal pressures, shape (nodes,).
        derivatives
            Changes of gap, its rate and the mean velocity in n directions, each
            (cells, points, n).

        Returns
        -------
        numpy.ndarray
            shape (free nodes, n).
        """
        p = self.parameters
        thickness, _, velocity = self.dimensionless(gap)
        oil = self.oil(pressure, self.thinning(gap), density_rate)
        if self.surfaces is not None:
            derivatives = self.surfaces.along(gap, derivatives)
        shape = (thickness.size, derivatives.thickness.shape[-1])
        changes = derivatives.thickness.reshape(shape) / p.clearance
        speeds = derivatives.mean_velocity.reshape(shape) / (p.rate * p.grid.radius)
        slidings = self.slidings(derivatives, shape)
        change = flux_change(self.assembly, oil, thickness, velocity, changes, speeds, slidings)
        rates = derivatives.thickness_rate.reshape(shape) / (p.clearance * p.rate)
        change += self.assembly.source_vectors(oil.density, rates)
        if density_rate is not None:
            change += self.assembly.source_vectors(oil.expansion, changes)
        feed = self.fed(gap)
        if feed is not None:
            slope = feed.change(feed.along_thickness, self.assembly.at_points(pressure)[0])
            change += self.assembly.source_vectors(slope, changes)
        return change[self.free]

    def slidings(self, derivatives: GapDerivatives, shape: tuple[int, ...]) -> np.ndarray | None:
        """Changes of the sliding velocity, dimensionless, where the oil asks for them."""
        p, sliding = self.parameters, derivatives.sliding_velocity
        if p.lubricant.shear_law is None or sliding is None:
            return None
        return sliding.reshape(shape) / (p.rate * p.grid.radius)

    def gap_derivatives(
        self,
        gap: Gap,
        pressure: np.ndarray,
        rate_shift: float,
        density_rate: DensityRate | None = None,
    ) -> tuple[sparse.csc_matrix, sparse.csc_matrix, sparse.csc_matrix | None]:
        """Sparse derivatives of the residual, for what moves many directions at once.

        Parameters
        ----------
        gap, pressure, density_rate
            A gap and dimensionless nodal pressures, shape (nodes,).
        rate_shift
            ``d h' / d h`` [1/s].

        Returns
        -------
        thickness, velocity, sliding
            Along h [m] at the Gauss points, its rate following, along the mean and along the
            sliding velocity [m/s]: shape (nodes, c * q) each. The last is None for an oil that
            does not thin, unless one of the surfaces is rougher.
        """
        p = self.parameters
        thickness, _, velocity = self.dimensionless(gap)
        oil = self.oil(pressure, self.thinning(gap), density_rate)
        along_h, along_v = flux_derivatives(self.assembly, oil, thickness, velocity)
        along_h += self.assembly.source_elements(oil.density * (rate_shift / p.rate))
        if density_rate is not None:
            along_h += self.assembly.source_elements(oil.expansion)
        feed = self.fed(gap)
        if feed is not None:
            slope = feed.change(feed.along_thickness, self.assembly.at_points(pressure)[0])
            along_h += self.assembly.source_elements(slope)
        along_u = sliding_derivative(self.assembly, oil, thickness)
        speed = p.rate * p.grid.radius
        if self.surfaces is not None:
            along_u = self.of_nominal(gap, along_h, along_v, along_u, oil.density)
        return (
            self.assembly.gather(along_h / p.clearance),
            self.assembly.gather(along_v / speed),
            None if along_u is None else self.assembly.gather(along_u / speed),
        )

    def of_nominal(
        self,
        gap: Gap,
        along_h: np.ndarray,
        along_v: np.ndarray,
        along_u: np.ndarray | None,
        stored: np.ndarray | None = None,
    ) -> np.ndarray | None:
        """Derivatives along the nominal gap of rough surfaces from those along the average one.

        Element data, dimensionless; `along_h` is changed.

        Parameters
        ----------
        gap
            The nominal one.
        along_h, along_v, along_u
            Along thickness, mean velocity, and sliding velocity (None: zero).
        stored
            Density where the equation has the rate of the average gap; None: it has not.

        Returns
        -------
        numpy.ndarray or None
            Along the sliding velocity.
        """
        assert self.surfaces is not None
        p, change = self.parameters, self.surfaces.change(gap)
        along_h *= change.thickness[:, :, None]
        if stored is not None:
            along_h += self.assembly.source_elements(stored * change.rate / p.rate)
        speed = p.rate * p.grid.radius
        along_h += (p.clearance / speed * change.velocity)[:, :, None] * along_v
        if not self.surfaces.dragging:
            return along_u
        dragged = change.sliding[:, :, None] * along_v
        return dragged if along_u is None else along_u + dragged

    def along_turn(self, gap: Gap, pressure: np.ndarray) -> np.ndarray:
        """Change of the residual with the journal's angle, shape (nodes,) [1/rad]."""
        feed = self.fed(gap)
        if feed is None:
            return np.zeros(self.assembly.size)
        slope = feed.change(feed.along_turn, self.assembly.at_points(pressure)[0])
        return self.assembly.source(slope)


def gauss_points(grid: FilmGrid, reference: np.ndarray) -> SurfacePoints:
    """Gauss points of every cell, each array (cells, points)."""
    around, along = grid.cells
    widths, heights = np.diff(grid.angles), np.diff(grid.heights)
    angle = grid.angles[:-1, None] + widths[:, None] * reference[:, 0]
    height = grid.heights[:-1, None] + heights[:, None] * reference[:, 1]
    return SurfacePoints(np.repeat(angle, along, axis=0), np.tile(height, (around, 1)))
