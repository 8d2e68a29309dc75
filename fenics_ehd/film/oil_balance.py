"""Oil balance of a film that may be partly empty, node by node.

The equation of `fenics_ehd.film.mass_conserving`, its matrices, and its derivatives along
changes of the gap.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy import sparse

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film.assembly import Assembly, Coefficients
from fenics_ehd.film.balance import (
    OilProperties,
    balance,
    balance_derivative,
    flux_derivatives,
    sliding_derivative,
)
from fenics_ehd.film.cavitation import Complementarity
from fenics_ehd.film.feeding import FeedTerm
from fenics_ehd.film.film import Film
from fenics_ehd.film.kinematics import Gap, GapDerivatives
from fenics_ehd.film.reynolds import SMALLEST_SOURCE
from fenics_ehd.film.strips import Strips
from fenics_ehd.film.supply import in_regions
from fenics_ehd.film.thinning import Thinning


@dataclass(frozen=True, eq=False)
class OilStep:
    """One time step, dimensionless.

    The nominal `gap` at its end; `thickness` and `velocity` there at the Gauss points, between
    rough surfaces the average ones; its `length`, the full-film
    `flows` from node to node, and, over the length, the `full` contents of the
    pressureless gap and the `former` contents; what the shear rate does to the viscosity, and
    what supplies add, None without any. Of a formula with several steps the length is one over its
    shift, and `former` minus the rate of contents that are zero at the end.
    """

    gap: Gap
    thickness: np.ndarray
    velocity: np.ndarray
    length: float
    flows: np.ndarray
    full: np.ndarray
    former: np.ndarray
    thinned: Thinning | None
    feed: FeedTerm | None = None


@dataclass(frozen=True, eq=False)
class OilProblem(Complementarity):
    """``r(p) = t(s)``, pressure and void fraction complementary.

    Attributes
    ----------
    transport
        ``t(s)`` of the void fractions of the unknown nodes, shape (m,).
    transport_entries
        Entries of its derivative, in the order of the solver's pattern.
    diagonal
        Places of the diagonal in it, shape (m,).
    """

    transport: Callable[[np.ndarray], np.ndarray] = field(kw_only=True)
    transport_entries: Callable[[np.ndarray], np.ndarray] = field(kw_only=True)
    diagonal: np.ndarray = field(kw_only=True)

    @property
    def rows(self) -> np.ndarray:
        """Size of the equations of a nearly full film, shape (m,)."""
        zero = np.zeros(len(self.diagonal))
        both = self.unit * self.entries(zero) + self.transport_entries(zero)
        return both[self.diagonal]


class OilBalance:
    """Balance of one film.

    Parameters
    ----------
    film
        Bearing and oil, on a bilinear mesh.
    oil_outside
        Whether there is oil outside the sides at cavitation pressure, too.

    Attributes
    ----------
    reservoir
        Whether a node has a given pressure and oil to give, shape (nodes,).
    unknown
        Nodes with an unknown: pressure or void fraction where the pressure is
        free, outflow or void fraction at a side at cavitation pressure.
    dry
        Which of these are of the second kind.
    pattern
        Of the derivatives along both.
    """

    def __init__(self, film: Film, *, oil_outside: bool = False):
        self.film = film
        self.reservoir, dry = _reservoirs_and_dry_sides(film, oil_outside)
        self.unknown = np.union1d(film.free, np.flatnonzero(dry))
        self.dry = dry[self.unknown]
        self.assembly = a = Assembly(film.parameters.grid, self.unknown)
        self.strips = Strips(a)
        self.pattern = self.strips.pattern
        self._dry_column = self.dry[a.pattern.indices]
        self._dry_diagonal = a.pattern.diagonal[self.dry]

    @property
    def volume_scale(self) -> float:
        """``c R^2`` [m^3], the unit of oil contents."""
        p = self.film.parameters
        return p.clearance * p.grid.radius**2

    def stored(self, filling: np.ndarray) -> np.ndarray:
        """``int rho H N_i`` at all nodes."""
        return self.assembly.vector(np.zeros_like(filling), None, filling)

    def step(self, gap: Gap, content: np.ndarray, time_step: float) -> OilStep:
        """One time step [s] to a gap, from the oil content (nodes,) [m^3] before."""
        length = time_step * self.film.parameters.rate
        return self.ending(gap, length, content / (self.volume_scale * length))

    def ending(self, gap: Gap, length: float, former: np.ndarray) -> OilStep:
        """A step of a length that ends with a gap, see `OilStep`."""
        thickness, _, velocity = self.film.equation.dimensionless(gap)
        density = self.film.equation.factors[1]
        return OilStep(
            gap,
            thickness,
            velocity,
            length,
            flows=self.strips.flows(density * thickness * velocity),
            full=self.stored(density * thickness) / length,
            former=former,
            thinned=self.film.equation.thinning(gap),
            feed=self.film.equation.fed(gap, lumped=True),
        )

    def problem(self, step: OilStep) -> OilProblem:
        """``r`` and t of the unknown nodes; an outflow stands for the pressure of a dry side."""

        def residual(values: np.ndarray) -> np.ndarray:
            defect = self.full_film(step, self.nodal(values))[self.unknown]
            return defect + np.where(self.dry, values, 0.0)

        def entries(values: np.ndarray) -> np.ndarray:
            matrix = self.assembly.matrix(self._derivative(step, self.nodal(values)))
            if step.feed is not None:
                lumped = self.assembly.source(step.feed.total)
                matrix[self.assembly.pattern.diagonal] += lumped[self.unknown]
            matrix[self._dry_column] = 0.0
            matrix[self._dry_diagonal] = 1.0
            return self.strips.widened(matrix)

        def transport(void: np.ndarray) -> np.ndarray:
            return self.strips.apply(step.flows, step.full, self.spread(void))[self.unknown]

        def transport_entries(void: np.ndarray) -> np.ndarray:
            return self.strips.derivative(step.flows, step.full, self.spread(void))

        zero = np.zeros(len(self.unknown))
        constant, first = residual(zero), entries(zero)
        linear = self.film.parameters.lubricant.linear
        return OilProblem(
            (lambda p: self.pattern.multiply(first, p) + constant) if linear else residual,
            (lambda p: first) if linear else entries,
            # The void fraction is of order one.
            scale=1.0,
            unit=max(float(np.abs(constant).max()), SMALLEST_SOURCE) / float(first.max()),
            transport=transport,
            transport_entries=transport_entries,
            diagonal=self.pattern.diagonal,
        )

    def spread(self, void: np.ndarray) -> np.ndarray:
        """Void fractions of all nodes from those of the unknown ones."""
        nodal = np.zeros(self.assembly.size)
        nodal[self.unknown] = void
        return nodal

    def nodal(self, values: np.ndarray) -> np.ndarray:
        """Dimensionless pressures at all nodes."""
        nodal = self.film.equation.given.copy()
        nodal[self.unknown] = np.where(self.dry, 0.0, values)
        return nodal

    def oil(self, step: OilStep, nodal: np.ndarray) -> OilProperties:
        """Oil at the Gauss points, dimensionless."""
        return self.film.equation.oil(nodal, step.thinned)

    def full_film(self, step: OilStep, nodal: np.ndarray) -> np.ndarray:
        """Balance at all nodes without the void fraction."""
        oil = self.oil(step, nodal)
        growth = step.thickness / step.length
        lost = balance(self.assembly, oil, step.thickness, step.velocity, growth) - step.former
        return lost if step.feed is None else lost + step.feed.lumped(self.assembly, nodal)

    def ends(
        self, step: OilStep, nodal: np.ndarray, values: np.ndarray, void: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """What the balance lacks at all nodes, and flows through the ends of the film.

        Parameters
        ----------
        step, nodal, void
            One time step, pressures and void fractions of all nodes.
        values
            Of the unknown nodes; an outflow stands for the pressure of a dry side.
        """
        lost = self.full_film(step, nodal) - self.strips.apply(step.flows, step.full, void)
        outflow = -lost
        outflow[self.film.free] = 0.0
        outflow[self.unknown[self.dry]] = values[self.dry]
        return lost, outflow

    def _derivative(self, step: OilStep, nodal: np.ndarray) -> Coefficients:
        oil = self.oil(step, nodal)
        if self.film.parameters.lubricant.linear:
            mobility = oil.mobility(step.thickness)
            return Coefficients(mobility, mobility)
        growth = step.thickness / step.length
        return balance_derivative(oil, step.thickness, step.velocity, growth)

    def change(
        self, step: OilStep, nodal: np.ndarray, void: np.ndarray, derivatives: GapDerivatives
    ) -> np.ndarray:
        """Derivative of the balance at a solution along n changes of the gap, shape (nodes, n)."""
        shape = (-1, derivatives.thickness.shape[-1])
        along_h, along_v, along_u = self.gap_derivatives(step, nodal, void)
        total = along_h @ derivatives.thickness.reshape(shape)
        total += along_v @ derivatives.mean_velocity.reshape(shape)
        if along_u is not None and derivatives.sliding_velocity is not None:
            total += along_u @ derivatives.sliding_velocity.reshape(shape)
        return total

    def gap_derivatives(
        self, step: OilStep, nodal: np.ndarray, void: np.ndarray
    ) -> tuple[sparse.csc_matrix, sparse.csc_matrix, sparse.csc_matrix | None]:
        """Derivatives of the balance, where flows come from held, see `ReynoldsEquation`."""
        p = self.film.parameters
        oil = self.oil(step, nodal)
        density = np.broadcast_to(self.film.equation.factors[1], step.velocity.shape)
        along_h, along_v = flux_derivatives(self.assembly, oil, step.thickness, step.velocity)
        carried = self.strips.carried(step.flows, void)
        along_h += self.assembly.source_elements(oil.density / step.length)
        along_h -= self.strips.elements(density * step.velocity, carried)
        storage = self.assembly.source_elements(density / step.length)
        along_h -= storage * void[self.assembly.grid.cell_nodes][:, None, :]
        along_v -= self.strips.elements(density * step.thickness, carried)
        along_u = sliding_derivative(self.assembly, oil, step.thickness)
        if step.feed is not None:
            slope = step.feed.along_thickness
            along_h += step.feed.lumped_elements(self.assembly, slope, nodal)
        if p.surfaces is not None:
            along_u = self.film.equation.of_nominal(step.gap, along_h, along_v, along_u)
        speed = p.rate * p.grid.radius
        return (
            self.assembly.gather(along_h / p.clearance),
            self.assembly.gather(along_v / speed),
            None if along_u is None else self.assembly.gather(along_u / speed),
        )

    def along_turn(self, step: OilStep, nodal: np.ndarray) -> np.ndarray:
        """Change of the balance with the journal's angle, shape (nodes,) [1/rad]."""
        assert step.feed is not None
        fed = step.feed.lumped_elements(self.assembly, step.feed.along_turn, nodal)
        return self.assembly.gather(fed) @ np.ones(step.thickness.size)


def require_monotone(family: str, key: str = "film.element") -> None:
    """Refuse elements whose matrices are no M-matrices.

    Raises
    ------
    SettingsError
        Naming the setting.
    """
    if family != "bilinear":
        raise SettingsError(
            f"{key} = '{family}' cannot conserve mass without negative fluid fractions: "
            "cavitation = 'mass-conserving' needs element = 'bilinear'"
        )


def _reservoirs_and_dry_sides(film: Film, oil_outside: bool) -> tuple[np.ndarray, np.ndarray]:
    """Nodes that supply oil, and those of sides that cannot, shape (nodes,) each."""
    p = film.parameters
    fixed = np.ones(len(film.equation.given), dtype=bool)
    fixed[film.free] = False
    angle, height = p.grid.node_positions.T
    in_region = in_regions(p.regions, angle, height, p.grid.radius)
    dry = fixed & (film.equation.given == 0.0) & ~in_region & (not oil_outside)
    return fixed & ~dry, dry
