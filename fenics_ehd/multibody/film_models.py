"""Films in the equations of a step, under Reynolds' condition or with their oil conserved.

A film model brings its unknowns, their equations with derivatives along them and along the gap, its
own test of convergence and complementarity, and its solution at the end of a step. Unknown are
the dimensionless pressures at m nodes, where oil is conserved void fractions behind them. Under
Reynolds' condition (`fenics_ehd.film.cavitation`) equations are ``W^-1 r(p)`` over their source.

Where oil is conserved the equation is that of `fenics_ehd.film.oil_balance`, the bore elastic, time
by the formula of the motion: with the content ``M = int rho h N (1 - s)`` of every node

    M' + outflow = 0,    M' = shift M + past,    0 <= p complementary to s >= 0.

The state of the integration has, behind coordinates and residual patterns, what the contents lack
of the part of the gap that is affine in these: the void volumes ``int rho h N s``, and what the
shape of a turning journal takes. So a round film that is full everywhere is Reynolds' one to the
last step of Newton. Rates are differences of contents: what a closed film holds stays the same to
round-off, whatever the formula.

Between rough surfaces contents are those of the average gap ``h_T(h)``, of which the fraction 1 - s
is oil, and the state lacks less by ``int rho (h_T - h) N``. Nothing of it is linearised in time:
the formula differentiates contents. Full films are those of Reynolds' condition, whose squeeze
term is ``(dh_T / dh) h'``, to the order of the formula only. Oil that pressure makes denser is
more than the gap's: its void volumes are negative in the state.

The void fractions are free variables of the equation d = 0; that of the pressures is
``s + gamma d`` (`fenics_ehd.film.oil_balance`). A Newton step finds pressures of the full nodes and
void fractions of the others with one sparse matrix. With one-step formulas no fluid fraction falls
below zero. With more steps a node that runs dry within few of them undershoots (`UNDERSHOOT`);
steps that do more are refused.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, TypeVar

import numpy as np
from scipy import sparse

from fenics_ehd.base.errors import CavitationError
from fenics_ehd.film.assembly import Pattern
from fenics_ehd.film.cavitation import (
    ActiveSetSystem,
    CavitationResult,
    Complementarity,
    verify_complementarity,
)
from fenics_ehd.film.film import DEFECT_WEIGHT, FilmState
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.film.oil_balance import (
    SMALLEST_SOURCE,
    OilBalance,
    OilStep,
    Transport,
    require_monotone,
)
from fenics_ehd.film.rough_surfaces import AsperityContact
from fenics_ehd.multibody.bdf import ImplicitStep
from fenics_ehd.multibody.border import FilmBlock
from fenics_ehd.multibody.lubricated_joint import RotatedShape
from fenics_ehd.multibody.mechanism import FilmBinding
from fenics_ehd.multibody.static_correction import BoreResponses

#: Round-off of a film's balances over the largest flow that squeezes empty nodes, 4e-13 in a film
#: of 697 nodes: oil as thin as air flows 1e8 times as fast as the source that it is compared with.
FLOW_ROUND_OFF = 1e-11

#: Dimensionless pressure that SNES-VI takes for zero.
ZERO_PRESSURE = 1e-14

#: Share of drift in the rates of a joint's coordinates from which on derivatives have it: motion
#: has 1e-8, mechanisms at rest have all of it in a bore that turns.
LEAST_DRIFT = 1e-4

#: Largest excess of a void fraction over 1.
UNDERSHOOT = 0.02

#: Largest excess of the density over that at ambient pressure that a state is taken to hold:
#: Dowson and Higginson's law at any pressure.
DENSEST = 0.6 / 1.7

#: Round-off of the contents over a step, which the defects of the shortest steps consist of.
ROUND_OFF = 1e-13

#: Derivatives of a film's equations along the gap, its rate following, along the mean and along
#: the sliding velocity, see `ReynoldsEquation.gap_derivatives`.
AlongGap = tuple[sparse.csc_matrix, sparse.csc_matrix, sparse.csc_matrix | None]


@dataclass(frozen=True, eq=False)
class FilmPoint:
    """One film at one evaluation.

    Attributes
    ----------
    values
        Pressures of the nodes with unknowns, shape (m,), where oil leaves at dry sides outflows.
    nodal
        Dimensionless pressure at all nodes.
    gap, problem
        The `Gap` it is of, and the `Complementarity` that the equation makes of it.
    defect
        Equations of all unknowns, of order one.
    contact
        Contact at the Gauss points, None between smooth surfaces.
    turned
        Of a joint's shape that turns, else None.
    """

    values: np.ndarray
    nodal: np.ndarray
    gap: Gap
    problem: Complementarity
    defect: np.ndarray
    contact: AsperityContact | None = field(default=None, kw_only=True)
    rotated: RotatedShape | None = field(default=None, kw_only=True)

    @property
    def fluid_fraction(self) -> np.ndarray | None:
        """Share of oil in the gap at all nodes; None where the condition does not tell."""
        return None

    @property
    def weights(self) -> np.ndarray | None:
        """Entries of W; None: there is none."""
        return self.problem.weights


PointT = TypeVar("PointT", bound=FilmPoint)


class FilmModel(ABC, Generic[PointT]):
    """A film in the equations of a step.

    Parameters
    ----------
    binding
        The joint.
    nodes, inside
        Nodes with unknowns, shape (m,), and which of these have a pressure.
    pattern
        Of the derivatives along these.
    contents
        Number of void volumes in the state of the integration.

    Attributes
    ----------
    place, nodes, inside, pattern, contents
        As given.
    film
        Of the joint.
    lower
        Lower bounds of the unknowns.
    scale
        What the equations are divided by, from the first point of a step on.
    retained
        Columns of the retained residual patterns of the bore among the film's inputs.
    volumes
        Places in the state of the integration of what the oil's contents of all nodes lack.
    """

    #: True of a matrix W that comes with the derivatives, of these being symmetric, of equations
    #: that are nearly linear on an active set, so that factors serve on, and of oil that is
    #: conserved, so that the state of the integration has its void volumes.
    weighted = True
    symmetric = False
    nearly_linear = False
    conserves_oil = False

    volumes = slice(0, 0)

    def __init__(
        self,
        binding: FilmBinding,
        nodes: np.ndarray,
        inside: np.ndarray,
        pattern: Pattern,
        contents: int = 0,
    ):
        self.binding = binding
        self.nodes = nodes
        self.inside = inside
        self.pattern = pattern
        self.contents = contents
        joint = binding.film
        self.film = joint.film
        self.scale = 1.0
        self.lower = np.zeros(len(nodes))
        turning = np.full((len(joint.thickness), 1), 0.5 * joint.shaft_radius)
        self._velocity = np.hstack([joint.mean_velocity, turning])
        self._sliding = np.hstack([joint.sliding_velocity, 2.0 * turning])
        self._moving = np.hstack([joint.thickness, np.zeros_like(turning)])
        self._forces = -self.of_pressures(joint.load)

    def retain_patterns(self, gap: np.ndarray, shares: np.ndarray) -> None:
        """Take retained residual patterns into the derivatives.

        Parameters
        ----------
        gap
            Their change of the gap at the Gauss points, shape (g, k).
        shares
            Their shares of nodal pressures, shape (k, nodes).
        """
        first = self._moving.shape[1]
        self._gap = np.hstack([self._moving, gap])
        self._shares = -self.of_pressures(shares)
        self.retained = slice(first, first + len(shares))

    def system(self, options_prefix: str) -> ActiveSetSystem:
        """Factors of the film's matrix on its full nodes, and of W on the others."""
        return ActiveSetSystem(
            self.pattern,
            weighted=self.weighted,
            symmetric=self.symmetric,
            options_prefix=f"{options_prefix}{self.place.name}_",
        )

    def of_pressures(self, per_pressure: np.ndarray) -> np.ndarray:
        """Effect of unit pressures [Pa] of all nodes, shape (..., nodes), by the unknown ones."""
        scale = self.film.parameters.pressure_scale
        return scale * per_pressure[..., self.nodes] * self.inside

    def nodal(self, values: np.ndarray) -> np.ndarray:
        """Dimensionless pressures at all nodes for unknowns."""
        nodal = self.film.equation.given.copy()
        nodal[self.nodes] = values[: len(self.nodes)] * self.inside
        return nodal

    def pressure(self, values: np.ndarray) -> np.ndarray:
        """Pressures at all nodes for unknowns [Pa]."""
        return self.film.parameters.pressure_scale * self.nodal(values)

    def nodal_change(self, values: np.ndarray, full: np.ndarray) -> np.ndarray:
        """Change of the pressure at all nodes [Pa] with that of the full ones."""
        nodal = np.zeros(self.film.assembly.size)
        pressed = full[self.inside[full]]
        nodal[self.nodes[pressed]] = self.film.parameters.pressure_scale * values[pressed]
        return nodal

    def values(self, pressure: np.ndarray, void: np.ndarray | None = None) -> np.ndarray:
        """Unknowns for pressures [Pa] and void fractions of all nodes."""
        return pressure[self.nodes] / self.film.parameters.pressure_scale

    def begin(self, step: ImplicitStep, responses: BoreResponses, i: int) -> None:
        """Take another step; the film is the i-th."""
        self.scale = 0.0

    def volumes_at(self, z: np.ndarray) -> np.ndarray:
        """The state's volumes of the initial filling, for coordinates z, shape (nodes,) [m^3]."""
        return np.zeros(0)

    def volumes_with(self, shares: np.ndarray, z: np.ndarray, observed: np.ndarray) -> np.ndarray:
        """The state's volumes of void fractions of all nodes in a gap, where it is observed."""
        return np.zeros(0)

    def volume_rates(self, point: PointT, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The state's volumes [m^3] at a point with coordinates z, and their rates."""
        return np.zeros(0), np.zeros(0)

    def void_fractions(self, state: np.ndarray, observed: np.ndarray) -> np.ndarray:
        """Void fractions of all nodes in a state of a gap, where it is observed."""
        return np.zeros(self.film.assembly.size)

    def content(self, state: np.ndarray, observed: np.ndarray) -> float:
        """Oil in a state of a gap, where it is observed [m^3]; 0 where nobody keeps account."""
        return 0.0

    def keep_within(self, states: np.ndarray, observed: np.ndarray) -> None:
        """Bring void volumes of the first of some states back into its gap, the others along."""

    @abstractmethod
    def evaluate(self, gap: Gap, values: np.ndarray) -> PointT:
        """Equations of the film at unknowns."""

    @abstractmethod
    def along_gap(self, point: PointT, shift: float) -> AlongGap:
        """Derivatives along the gap, for all nodes and not scaled."""

    @abstractmethod
    def along_turn(self, point: PointT) -> np.ndarray:
        """Derivative along the angle of a journal that carries supplies, not scaled."""

    @abstractmethod
    def given(self, point: PointT, full: np.ndarray) -> np.ndarray:
        """Right-hand side of a Newton step, shape (m,), with full nodes."""

    def update(self, point: PointT, full: np.ndarray, found: np.ndarray) -> np.ndarray:
        """Newton update of all unknowns from what is found at the nodes, shape (m,)."""
        return found

    @abstractmethod
    def settled(self, point: PointT, tolerance: float) -> bool:
        """True if equations and complementarity hold, in the maximum norm."""

    @abstractmethod
    def end(self, point: PointT, tolerance: float) -> FilmState:
        """The film at the end of a step, verified.

        Raises
        ------
        CavitationError
            It violates complementarity or more.
        """

    def state(self, point: PointT) -> FilmState:
        """The film as it is known at a point."""
        free = point.nodal[self.film.free]
        result = CavitationResult(free, self.scale * point.defect, np.flatnonzero(free > 0.0), 0)
        pressure = self.film.parameters.pressure_scale * point.nodal
        return FilmState(pressure, point.gap, result, point.fluid_fraction)

    def linearise(
        self,
        point: PointT,
        shift: float,
        speed: np.ndarray,
        patterns: slice,
        share: float,
        size: int,
    ) -> FilmBlock:
        """Derivatives at a point; where their share of drift is tiny, rates of xi follow xi alone.

        Parameters
        ----------
        point
            Of the film.
        shift
            Of the step.
        speed
            Derivative of all rates along all unknowns x but the patterns.
        patterns, share
            Places of the retained patterns in x, and how they answer within the step.
        size
            Number of unknowns x.
        """
        binding = self.binding
        n = self.binding.film.size
        along_h, along_v, along_u = self.along_gap(point, shift)
        inputs = along_h @ self._gap
        velocity = along_v @ self._velocity
        if along_u is not None:
            velocity += along_u @ self._sliding
        inputs[:, :n] += shift * velocity[:, :n]
        inputs[:, n] += velocity[:, n]
        spread = np.zeros((inputs.shape[1], size))
        ahead = np.zeros((2, size))
        ahead[0, binding.turning] = binding.signs
        ahead[1, : speed.shape[1]] = binding.signs @ speed[binding.turning]
        spread[np.arange(n), binding.xi] = 1.0
        spread[n] = ahead[1]
        spread[self.retained, patterns] = np.eye(patterns.stop - patterns.start)
        found = FilmBlock(
            self.pattern,
            self._entries(point),
            point.weights,
            inputs=inputs[self.nodes] / self.scale,
            spread=spread,
            outputs=np.vstack([self._forces, share * self._shares]),
            rows=np.concatenate([binding.xi, np.arange(patterns.start, patterns.stop)]),
            gap=self._gap,
            along_gap=along_h,
        )
        follows = np.zeros((n, size))
        follows[:, : speed.shape[1]] = speed[binding.xi]
        follows[np.arange(n), binding.xi] -= shift
        if np.abs(follows).max() > LEAST_DRIFT:
            along = self._along_rate(point, shift, along_h) @ self._gap[:, :n] + velocity[:, :n]
            found = found.extended(
                along[self.nodes] / self.scale, follows, np.zeros((len(self._gap), n))
            )
        if self.film.equation.feeds is not None and self.film.equation.feeds.turning:
            along = self.along_turn(point)[self.nodes, None] / self.scale
            found = found.extended(along, ahead[:1], np.zeros((len(self._gap), 1)))
        if point.rotated is not None:
            # The gap's rate follows the angle otherwise than the gap.
            slope = point.rotated.slope
            along_rate = self._along_rate(point, shift, along_h)
            along = along_h @ slope + along_rate @ (point.rotated.rate_slope - shift * slope)
            inputs = np.stack([along, along_rate @ slope], axis=-1)[self.nodes] / self.scale
            gap = np.stack([slope, np.zeros_like(slope)], axis=-1)
            outputs = -binding.signs[:, None] * self.of_pressures(point.rotated.torque)
            found = found.extended(inputs, ahead, gap, (outputs, binding.turning))
        return found

    def _along_rate(self, point: PointT, shift: float, along_gap: Any) -> sparse.csc_matrix:
        """Derivative along the rate of the gap alone, by those along the gap at two shifts."""
        rate = self.film.parameters.rate
        return (self.along_gap(point, shift + rate)[0] - along_gap) / rate

    def _entries(self, point: PointT) -> np.ndarray:
        """Entries of the derivative along the film's own unknowns."""
        return point.problem.entries(point.values) / self.scale

    def with_matrix(self, former: FilmBlock, point: PointT) -> FilmBlock:
        """Former derivatives, but for the film's own matrices, which are those at a point."""
        return replace(former, entries=self._entries(point), weights=point.weights)

    def twist(self, point: PointT, core: np.ndarray) -> None:
        """Add to the core how the torque of the pressures changes with the angle of the journal."""
        if point.rotated is not None:
            pressure = self.film.parameters.pressure_scale * point.nodal
            stiffness = point.rotated.stiffness @ pressure
            turning = self.binding.turning
            signs = self.binding.signs
            core[np.ix_(turning, turning)] -= stiffness * np.outer(signs, signs)


class ReynoldsFilm(FilmModel[FilmPoint]):
    """A film under Reynolds' condition: pressures where it is full, empty where they are zero."""

    nearly_linear = True

    def __init__(self, binding: FilmBinding):
        film = binding.film.film
        super().__init__(
            binding, film.free, np.ones(len(film.free), dtype=bool), film.equation.pattern
        )
        self.weighted = film.equation.weights is not None
        self.symmetric = film.parameters.lubricant.linear

    def evaluate(self, gap: Gap, values: np.ndarray) -> FilmPoint:
        """Reynolds' equation, over the source of the step's first point."""
        problem = self.film.equation.problem(gap)
        self.scale = self.scale or problem.scale
        defect = self.film.cavitation.defect(problem, values) / self.scale
        return FilmPoint(values, self.nodal(values), gap, problem, defect)

    def along_gap(self, point: FilmPoint, shift: float) -> AlongGap:
        """Derivatives as of `ReynoldsEquation.gap_derivatives`."""
        return self.film.equation.gap_derivatives(point.gap, point.nodal, shift)

    def along_turn(self, point: FilmPoint) -> np.ndarray:
        """Derivative along the angle as of `ReynoldsEquation.along_turn`."""
        return self.film.equation.along_turn(point.gap, point.nodal)

    def _left(self, point: FilmPoint) -> np.ndarray:
        """Defects that are to vanish: elsewhere pressure is zero and the flux positive."""
        open_ = (point.values > ZERO_PRESSURE) | (point.defect < 0.0)
        return np.where(open_, point.defect, 0.0)

    def given(self, point: FilmPoint, full: np.ndarray) -> np.ndarray:
        """Defects that are to vanish, W put back in."""
        left = self._left(point)
        weights = point.weights
        return left if weights is None else self.pattern.multiply(weights, left)

    def settled(self, point: FilmPoint, tolerance: float) -> bool:
        """True if what is left is below the tolerance, relative to the source, or round-off."""
        left: float = np.abs(self._left(point)).max(initial=0.0)
        return left <= self._limit(point, tolerance)

    def _limit(self, point: FilmPoint, tolerance: float) -> float:
        """Complementarity that counts as met."""
        return max(tolerance, FLOW_ROUND_OFF * np.abs(point.defect).max(initial=0.0))

    def end(self, point: FilmPoint, tolerance: float) -> FilmState:
        """The end of a step, its complementarity verified."""
        found = self.state(point)
        limit = 10 * self._limit(point, tolerance)
        result = found.cavitation
        verify_complementarity(result.pressure, result.flux, self.scale, limit)
        return found


@dataclass(frozen=True, eq=False)
class OilPoint(FilmPoint):
    """A film that conserves its oil at one evaluation.

    Attributes
    ----------
    void
        Void fractions of these nodes, shape (m,).
    step, transport
        See there.
    """

    void: np.ndarray
    step: OilStep
    transport: Transport

    @property
    def fluid_fraction(self) -> np.ndarray:
        """Share of oil in the gap at all nodes."""
        return 1.0 - self.transport.void

    @property
    def weights(self) -> np.ndarray:
        """Derivative of the transport along the void fractions, by its entries."""
        return self.transport.entries

    @property
    def balance(self) -> np.ndarray:
        """Defect of the balance at the unknown nodes, shape (m,)."""
        return self.defect[len(self.void) :]


class ConservedOil(FilmModel[OilPoint]):
    """A film that conserves its oil.

    Parameters
    ----------
    binding
        The joint, its cavitation mass-conserving.

    Attributes
    ----------
    balance
        Its equation.
    """

    conserves_oil = True

    def __init__(self, binding: FilmBinding):
        joint = binding.joint
        require_monotone(joint.film.parameters.grid.family)
        self._filling = joint.initial_filling
        # Not the joint's own film, which heat does not warm.
        self.balance = b = OilBalance(binding.film.film, oil_outside=joint.ambient == "oil")
        super().__init__(binding, b.unknown, ~b.dry, b.pattern, b.assembly.size)
        self._areas = b.assembly.source(np.ones_like(b.assembly.area))[self.nodes]
        # Void fractions are free.
        self.lower = np.concatenate([self.lower, np.full(len(self.nodes), -np.inf)])

    def values(self, pressure: np.ndarray, void: np.ndarray | None = None) -> np.ndarray:
        """Unknowns for pressures [Pa] and void fractions of all nodes, full if None are given."""
        nodal = np.zeros(self.balance.assembly.size) if void is None else void
        return np.concatenate([super().values(pressure), nodal[self.nodes]])

    def _full(self, thickness: np.ndarray) -> np.ndarray:
        """``int rho h N`` at all nodes of a gap at the Gauss points, over the volume scale."""
        shape = self.film.assembly.area.shape
        clearance = self.film.parameters.clearance
        thickness = thickness.reshape(shape) / clearance
        return self.film.assembly.source(self.film.equation.factors[1] * thickness)

    def _taken(self, z: np.ndarray, nominal: np.ndarray) -> np.ndarray:
        """Contents that the full gap lacks of the affine one, over the volume scale.

        A turning journal's shape takes it; between rough surfaces the average gap adds what it has
        beyond the `nominal` one (Gauss points).
        """
        shape = self.binding.film.shape
        surfaces = self.film.parameters.surfaces
        taken = np.zeros(nominal.size)
        if shape.turning:
            taken += shape.gap_reduction(self.binding.relative_angle(z))[: nominal.size]
        if surfaces is not None:
            taken -= surfaces.excess(nominal).ravel()
        return self._full(taken)

    def volumes_at(self, z: np.ndarray) -> np.ndarray:
        """The state's volumes of the initial filling, for coordinates z, shape (nodes,) [m^3]."""
        gap = self.binding.gap(z, np.zeros_like(z), 0.0)
        empty = np.full(self.balance.assembly.size, 1.0 - self._filling)
        return self.volumes_with(empty, z, gap.thickness.ravel())

    def _seen(self, observed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gap at the Gauss points, which come first, and its full contents over the scale."""
        surfaces = self.film.parameters.surfaces
        gap = observed[: self.film.assembly.area.size]
        return gap, self._full(gap if surfaces is None else gap + surfaces.excess(gap))

    def _observed(self, state: np.ndarray, observed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Full contents of a state, over the volume scale, and void volumes of its nodes [m^3]."""
        gap, full = self._seen(observed)
        void = state[self.volumes] - self.balance.volume_scale * self._taken(state, gap)
        return full, void[self.nodes]

    def keep_within(self, states: np.ndarray, observed: np.ndarray) -> None:
        """Bring void volumes of the first of some states between none and the gap's.

        The others change by as much. Compressed oil may be more than the gap's, by `DENSEST`.
        """
        full, void = self._observed(states[0], observed)
        full = self.balance.volume_scale * full[self.nodes]
        constant = self.film.parameters.lubricant.density_law.constant
        least = 0.0 if constant else -DENSEST
        change = np.zeros(self.balance.assembly.size)
        change[self.nodes] = np.clip(void, least * full, full) - void
        states[:, self.volumes] += change

    def content(self, state: np.ndarray, observed: np.ndarray) -> float:
        """Oil in a state of a gap, where it is observed [m^3]."""
        full, void = self._observed(state, observed)
        return float(self.balance.volume_scale * full.sum() - void.sum())

    def void_fractions(self, state: np.ndarray, observed: np.ndarray) -> np.ndarray:
        """Void fractions of all nodes in a state of a gap, where it is observed."""
        full, void = self._observed(state, observed)
        shares = np.zeros(self.balance.assembly.size)
        full = self.balance.volume_scale * full[self.nodes]
        shares[self.nodes] = np.clip(void / full, 0.0, 1.0)
        return shares

    def volumes_with(self, shares: np.ndarray, z: np.ndarray, observed: np.ndarray) -> np.ndarray:
        """The state's volumes of such void fractions [m^3]."""
        gap, full = self._seen(observed)
        void = np.zeros(self.balance.assembly.size)
        void[self.nodes] = (full * shares)[self.nodes]
        return self.balance.volume_scale * (void + self._taken(z, gap))

    def begin(self, step: ImplicitStep, responses: BoreResponses, i: int) -> None:
        """Take another step; the film is the i-th."""
        joint = self.binding.film
        rate = self.film.parameters.rate
        # The rate of the gap that is affine in the state is ``shift h + past``.
        constant = joint.clearance + joint.shape.fixed[: len(joint.thickness)]
        past = (
            joint.thickness @ step.past_x[self.binding.xi] + responses.past_gap[responses.points[i]]
        )
        past = past - step.shift * constant
        self._shift = step.shift
        self._length = rate / step.shift
        self._past_volumes = step.past_x[self.volumes]
        self._past_void = self._past_volumes / (self.balance.volume_scale * rate)
        self._former = self._past_void - self._full(past) / rate
        self._rows = np.zeros(0)

    def evaluate(self, gap: Gap, values: np.ndarray) -> OilPoint:
        """The balance, and the equations of the pressures before it."""
        pressures, void = np.split(values, 2)
        step = self.balance.ending(gap, self._length, self._former)
        problem = self.balance.problem(step)
        transport = self.balance.transport(step, void)
        defect = problem.residual(pressures) - transport.values
        if not len(self._rows):
            source = (problem.source + self._past_void[self.nodes])[self.inside]
            least = SMALLEST_SOURCE * float(np.linalg.norm(self._areas))
            self._source = max(float(np.linalg.norm(source)), least)
            self._rows = self.balance.rows(step, problem)
        defects = np.concatenate([void + DEFECT_WEIGHT * defect / self._rows, defect])
        return OilPoint(pressures, self.nodal(values), gap, problem, defects, void, step, transport)

    def along_gap(self, point: OilPoint, shift: float) -> AlongGap:
        """Derivatives as of `OilBalance.gap_derivatives`."""
        return self.balance.gap_derivatives(point.step, point.nodal, point.transport)

    def along_turn(self, point: OilPoint) -> np.ndarray:
        """Derivative along the angle as of `OilBalance.along_turn`."""
        return self.balance.along_turn(point.step, point.nodal)

    def _taken_away(self, point: OilPoint, full: np.ndarray) -> np.ndarray:
        """Newton update of the void fractions of full nodes, shape (m,)."""
        void = np.zeros(len(point.void))
        void[full] = point.defect[full] - DEFECT_WEIGHT * point.balance[full] / self._rows[full]
        return void

    def given(self, point: OilPoint, full: np.ndarray) -> np.ndarray:
        """Defect of the balance, and what full nodes carry."""
        void = self._taken_away(point, full)
        return point.balance + self.pattern.multiply(point.weights, void)

    def update(self, point: OilPoint, full: np.ndarray, found: np.ndarray) -> np.ndarray:
        """Pressures, and void fractions, which stand in their place where the film is not full."""
        void = found.copy()
        void[full] = self._taken_away(point, full)[full]
        return np.concatenate([found, void])

    def settled(self, point: OilPoint, tolerance: float) -> bool:
        """True if balance and complementarity hold, in the maximum norm."""
        limit = tolerance * self._source + ROUND_OFF * self._rows.max()
        overlap = np.minimum(point.values, point.void)
        return bool(
            np.abs(point.balance).max(initial=0.0) <= limit
            and np.abs(overlap).max(initial=0.0) <= tolerance
        )

    def volume_rates(self, point: OilPoint, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The state's volumes [m^3] at a point with coordinates z, and their rates.

        They follow from the flows: what Newton leaves of the balance goes to the next step, no oil
        is lost.
        """
        volumes = self._void(point)
        volumes += self.balance.volume_scale * self._taken(z, point.step.gap.thickness)
        return volumes, self._shift * volumes + self._past_volumes

    def _void(self, point: OilPoint) -> np.ndarray:
        """Void volumes of all nodes [m^3], less what pressure makes room for."""
        volumes = point.step.full * point.transport.void
        volumes[self.nodes] += point.balance
        if not self.film.parameters.lubricant.density_law.constant:
            flow = point.step.flow
            denser = self.film.equation.flow(point.gap, point.nodal).density
            denser = (denser - self.film.equation.factors[1]) * flow.thickness / point.step.length
            volumes -= self.film.assembly.source(denser)
        return self.balance.volume_scale * point.step.length * volumes

    def end(self, point: OilPoint, tolerance: float) -> FilmState:
        """The end of a step.

        Raises
        ------
        CavitationError
            It violates complementarity, oil is lost, or a void fraction is above 1.
        """
        balance = self.balance
        step = point.step
        rate = self.film.parameters.rate
        verify_complementarity(point.values, point.void, 1.0, 10 * tolerance)
        excess = float(point.void.max(initial=0.0)) - 1.0
        if not excess <= UNDERSHOOT:
            raise CavitationError(f"fluid fraction below 0: by {excess:.2g}, at most {UNDERSHOOT}")
        outflow = balance.outflow(step, point.nodal, point.values, point.transport)
        return replace(
            self.state(point),
            content=balance.volume_scale * step.length * step.full - self._void(point),
            outflow=balance.volume_scale * rate * outflow,
        )


#: Model of every condition of cavitation.
MODELS: Mapping[str, Callable[[FilmBinding], FilmModel[Any]]] = {
    "reynolds": ReynoldsFilm,
    "mass-conserving": ConservedOil,
}


def film_models(places: Sequence[FilmBinding], first: int) -> list[FilmModel[Any]]:
    """Models of all films; void volumes begin at `first` in the state of the integration."""
    found = [MODELS[binding.joint.cavitation](binding) for binding in places]
    for film in found:
        film.volumes = slice(first, first + film.contents)
        first = film.volumes.stop
    return found
