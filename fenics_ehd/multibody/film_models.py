"""Films in the equations of a step: Reynolds condition and mass-conserving cavitation (JFO).

All films are one problem of their nodal unknowns w at a gap,

    r(w; gap) = W(gap) y,    0 <= w complementary to y >= 0,

with W the identity, the mass matrix of 8-node elements, or the transport of void fractions. A film
model (`FilmModel`) has the unknowns, the residual, the derivatives along unknowns and gap, the test
of convergence and the film's state at the end of a step. What it stores in the state of the
integration is its `FilmContent`; its coupling to motion and bores is `FilmCoupling`, the same for
all models. No other module asks which model a film has.

The first unknowns are the dimensionless pressures of m nodes, bounded below by zero. Behind them a
model may have further, free unknowns of any number, with equations of its own: void fractions, a
temperature. Its linear system (`pattern`) contains them, or `update` computes them by itself.

**Reynolds condition** (`fenics_ehd.film.cavitation`). The equations are ``W^-1 r(p)``, divided by
the norm of their source.

**Mass-conserving cavitation.** The equation is that of `fenics_ehd.film.oil_balance`, the time
derivative by the formula of the integrator. With the content ``M = int rho h N (1 - s)`` of every
node,

    M' + outflow = 0,    M' = shift M + past,    0 <= p complementary to s >= 0.

Between rough surfaces contents are those of the average gap ``h_T(h)``. The integrator
differentiates contents, so that nothing is linearised in time; full films agree with those of the
Reynolds condition, whose squeeze term is ``(dh_T / dh) h'``, to the order of the formula.

The void fractions are free unknowns of the balance d = 0; the equation of the pressures is
``s + gamma d`` (`fenics_ehd.film.oil_balance`). A Newton step computes the pressures of full nodes
and the void fractions of the other nodes with one sparse matrix. One-step formulas keep all fluid
fractions positive. With formulas of several steps the fluid fraction of a node that runs dry within
few steps undershoots; steps with more than `UNDERSHOOT` are refused.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Generic, TypeVar

import numpy as np
from scipy import sparse

from fenics_ehd.base.errors import CavitationError
from fenics_ehd.film.assembly import Pattern
from fenics_ehd.film.cavitation import (
    ActiveSetSystem,
    CavitationResult,
    verify_complementarity,
)
from fenics_ehd.film.film import DEFECT_WEIGHT, FilmState
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.film.oil_balance import (
    SMALLEST_SOURCE,
    OilBalance,
    require_monotone,
)
from fenics_ehd.multibody.bdf import ImplicitStep
from fenics_ehd.multibody.film_binding import FilmBinding
from fenics_ehd.multibody.film_content import FilmContent, OilContent
from fenics_ehd.multibody.film_point import FilmPoint, OilPoint

#: Round-off of a film's balances over the largest flow that squeezes empty nodes, 4e-13 in a film
#: of 697 nodes: oil as thin as air flows 1e8 times as fast as the source of the equation.
FLOW_ROUND_OFF = 1e-11

#: Dimensionless pressure that SNES-VI takes for zero.
ZERO_PRESSURE = 1e-14

#: Largest excess of a void fraction over 1.
UNDERSHOOT = 0.02

#: Round-off of the contents over a step, which the defects of the shortest steps consist of.
ROUND_OFF = 1e-13

#: Derivatives of a film's equations along the gap with its rate, along the mean velocity and along
#: the sliding velocity, see `ReynoldsEquation.gap_derivatives`.
AlongGap = tuple[sparse.csc_matrix, sparse.csc_matrix, sparse.csc_matrix | None]


PointT = TypeVar("PointT", bound=FilmPoint)


class FilmModel(ABC, Generic[PointT]):
    """Equations of one film in a step.

    Parameters
    ----------
    binding
        The joint in its mechanism.
    nodes
        Nodes with unknowns, shape (m,).
    inside
        Mask of these nodes that have a pressure, shape (m,).
    pattern
        Pattern of the linear system, of the m nodes first.
    content
        Values in the state of the integration.

    Attributes
    ----------
    binding, nodes, inside, pattern, content
        As given.
    film
        Film of the joint.
    lower
        Lower bounds of all unknowns: zero for the m pressures, which come first.
    scale
        Divisor of the equations, from the first evaluation of a step on.
    """

    #: Whether a matrix W comes with the derivatives.
    weighted = True

    #: Whether the matrix along the unknowns is symmetric positive definite.
    symmetric = False

    #: Whether the equations are nearly linear on one active set, so that factors are kept.
    nearly_linear = False

    #: Whether the content is oil.
    conserves_oil = False

    def __init__(
        self,
        binding: FilmBinding,
        nodes: np.ndarray,
        inside: np.ndarray,
        pattern: Pattern,
        content: FilmContent,
    ):
        self.binding = binding
        self.nodes = nodes
        self.inside = inside
        self.pattern = pattern
        self.content = content
        self.film = binding.film.film
        self.scale = 1.0
        self.lower = np.zeros(len(nodes))

    # Unknowns

    def unknowns(self, pressure: np.ndarray, void: np.ndarray | None = None) -> np.ndarray:
        """Unknowns for pressures [Pa] and void fractions of all nodes (None: full)."""
        return pressure[self.nodes] / self.film.parameters.pressure_scale

    def admissible(self, unknowns: np.ndarray) -> np.ndarray:
        """Extrapolated unknowns, brought back to their bounds."""
        return np.maximum(unknowns, self.lower)

    def nodal(self, unknowns: np.ndarray) -> np.ndarray:
        """Dimensionless pressures of all nodes."""
        nodal = self.film.equation.given.copy()
        nodal[self.nodes] = unknowns[: len(self.nodes)] * self.inside
        return nodal

    def pressure(self, unknowns: np.ndarray) -> np.ndarray:
        """Pressures of all nodes [Pa]."""
        return self.film.parameters.pressure_scale * self.nodal(unknowns)

    def full_nodes(self, free: np.ndarray) -> np.ndarray:
        """Rows of the linear system that are full nodes, from the unknowns off their bounds."""
        return free[free < len(self.nodes)]

    # Residual

    def begin(self, step: ImplicitStep, past_gap: np.ndarray) -> None:
        """Start a step.

        `past_gap` is the part of the gap's rate from past amplitudes of residual patterns, at the
        Gauss points, shape (g,) [m/s].
        """
        self.content.begin(step)
        self.scale = 0.0

    @abstractmethod
    def evaluate(self, gap: Gap, unknowns: np.ndarray) -> PointT:
        """Equations at unknowns."""

    @abstractmethod
    def settled(self, point: PointT, tolerance: float) -> bool:
        """True if equations and complementarity hold, in the maximum norm."""

    # Derivatives, and the linear system of a Newton step

    def linear_system(self, options_prefix: str) -> ActiveSetSystem:
        """Solver for the film's matrix on full nodes, and for W on the others."""
        return ActiveSetSystem(
            self.pattern,
            weighted=self.weighted,
            symmetric=self.symmetric,
            options_prefix=f"{options_prefix}{self.binding.name}_",
        )

    def along_unknowns(self, point: PointT) -> np.ndarray:
        """Entries of the derivative along the unknowns of the linear system."""
        return point.problem.entries(point.pressures) / self.scale

    @abstractmethod
    def along_gap(self, point: PointT, shift: float) -> AlongGap:
        """Derivatives along the gap of the equations of all nodes, not scaled."""

    @abstractmethod
    def along_turn(self, point: PointT) -> np.ndarray:
        """Derivative along the angle of a journal that carries supplies, of all nodes, not scaled.

        Shape (nodes,).
        """

    def rows(self, nodal: np.ndarray) -> np.ndarray:
        """Rows of the linear system from equations of all nodes that are not scaled."""
        return nodal[self.nodes] / self.scale

    def columns(self, per_pressure: np.ndarray) -> np.ndarray:
        """Columns of the linear system from effects of unit nodal pressures [1/Pa].

        Shape (..., nodes).
        """
        scale = self.film.parameters.pressure_scale
        return scale * per_pressure[..., self.nodes] * self.inside

    @abstractmethod
    def right_side(self, point: PointT, full: np.ndarray) -> np.ndarray:
        """Right-hand side of the linear system for an active set."""

    def update(self, point: PointT, full: np.ndarray, solution: np.ndarray) -> np.ndarray:
        """Newton update of all unknowns from the solution of the linear system."""
        return solution

    def pressure_update(self, solution: np.ndarray, full: np.ndarray) -> np.ndarray:
        """Newton update of the pressures of all nodes [Pa], from that of the full ones."""
        nodal = np.zeros(self.film.assembly.size)
        pressed = full[self.inside[full]]
        nodal[self.nodes[pressed]] = self.film.parameters.pressure_scale * solution[pressed]
        return nodal

    # State

    def state(self, point: PointT) -> FilmState:
        """State of the film at a point, not verified."""
        free = point.nodal[self.film.free]
        result = CavitationResult(free, self.scale * point.defect, np.flatnonzero(free > 0.0), 0)
        pressure = self.film.parameters.pressure_scale * point.nodal
        return FilmState(pressure, point.gap, result, point.fluid_fraction)

    @abstractmethod
    def end(self, point: PointT, tolerance: float) -> FilmState:
        """State of the film at the end of a step, verified.

        Raises
        ------
        CavitationError
            It violates complementarity, or a condition of the model.
        """


class ReynoldsFilm(FilmModel[FilmPoint]):
    """A film under the Reynolds condition.

    Parameters
    ----------
    binding
        The joint in its mechanism.
    first
        Index of its content, which is empty, in the state of the integration.
    """

    nearly_linear = True

    def __init__(self, binding: FilmBinding, first: int):
        film = binding.film.film
        inside = np.ones(len(film.free), dtype=bool)
        super().__init__(binding, film.free, inside, film.equation.pattern, FilmContent(first))
        self.weighted = film.equation.weights is not None
        self.symmetric = film.parameters.lubricant.linear

    def evaluate(self, gap: Gap, unknowns: np.ndarray) -> FilmPoint:
        """Reynolds equation, divided by the source of the step's first evaluation."""
        problem = self.film.equation.problem(gap)
        self.scale = self.scale or problem.scale
        defect = self.film.cavitation.defect(problem, unknowns) / self.scale
        return FilmPoint(unknowns, self.nodal(unknowns), gap, problem, defect)

    def along_gap(self, point: FilmPoint, shift: float) -> AlongGap:
        """Derivatives of `ReynoldsEquation.gap_derivatives`."""
        return self.film.equation.gap_derivatives(point.gap, point.nodal, shift)

    def along_turn(self, point: FilmPoint) -> np.ndarray:
        """Derivative of `ReynoldsEquation.along_turn`."""
        return self.film.equation.along_turn(point.gap, point.nodal)

    def _open_defect(self, point: FilmPoint) -> np.ndarray:
        """Defects that must vanish: at the other nodes the pressure is zero, the flux positive."""
        is_open = (point.pressures > ZERO_PRESSURE) | (point.defect < 0.0)
        return np.where(is_open, point.defect, 0.0)

    def right_side(self, point: FilmPoint, full: np.ndarray) -> np.ndarray:
        """Defects that must vanish, multiplied by W."""
        defect = self._open_defect(point)
        weights = point.weights
        return defect if weights is None else self.pattern.multiply(weights, defect)

    def settled(self, point: FilmPoint, tolerance: float) -> bool:
        """True if open defects are below the tolerance, relative to the source, or round-off."""
        largest: float = np.abs(self._open_defect(point)).max(initial=0.0)
        return largest <= self._limit(point, tolerance)

    def _limit(self, point: FilmPoint, tolerance: float) -> float:
        """Defect that counts as zero."""
        return max(tolerance, FLOW_ROUND_OFF * np.abs(point.defect).max(initial=0.0))

    def end(self, point: FilmPoint, tolerance: float) -> FilmState:
        """State at the end of a step, its complementarity verified."""
        state = self.state(point)
        limit = 10 * self._limit(point, tolerance)
        result = state.cavitation
        verify_complementarity(result.pressure, result.flux, self.scale, limit)
        return state


class MassConservingFilm(FilmModel[OilPoint]):
    """A film with mass-conserving cavitation (JFO).

    Parameters
    ----------
    binding
        The joint in its mechanism.
    first
        Index of its oil content in the state of the integration.

    Attributes
    ----------
    balance
        Oil balance of the film.
    content
        Oil content of the film.
    """

    conserves_oil = True
    content: OilContent

    def __init__(self, binding: FilmBinding, first: int):
        joint = binding.joint
        require_monotone(joint.film.parameters.grid.family)
        # The binding's film has the temperature of the heat balance, the joint's own has not.
        balance = OilBalance(binding.film.film, oil_outside=joint.ambient == "oil")
        content = OilContent(binding, balance, first)
        super().__init__(binding, balance.unknown, ~balance.dry, balance.pattern, content)
        self.balance = balance
        self._areas = balance.assembly.source(np.ones_like(balance.assembly.area))[self.nodes]
        # Void fractions are free.
        self.lower = np.concatenate([self.lower, np.full(len(self.nodes), -np.inf)])

    def unknowns(self, pressure: np.ndarray, void: np.ndarray | None = None) -> np.ndarray:
        """Unknowns for pressures [Pa] and void fractions of all nodes (None: full)."""
        nodal = np.zeros(self.balance.assembly.size) if void is None else void
        return np.concatenate([super().unknowns(pressure), nodal[self.nodes]])

    def admissible(self, unknowns: np.ndarray) -> np.ndarray:
        """Extrapolated unknowns, neither pressures nor void fractions below zero."""
        return np.maximum(unknowns, 0.0)

    def begin(self, step: ImplicitStep, past_gap: np.ndarray) -> None:
        """Start a step, see `FilmModel.begin`."""
        self.content.begin(step)
        joint = self.binding.film
        rate = self.film.parameters.rate
        # The rate of the gap that is affine in the state is ``shift h + past``.
        constant = joint.clearance + joint.deviation[: len(joint.thickness)]
        past = joint.thickness @ step.past_x[self.binding.xi] + past_gap
        past = past - step.shift * constant
        self._length = rate / step.shift
        self._past_void = self.content.past / (self.balance.volume_scale * rate)
        self._former = self._past_void - self.content.full(past) / rate
        self._rows = np.zeros(0)

    def evaluate(self, gap: Gap, unknowns: np.ndarray) -> OilPoint:
        """Equations of the pressures, then the oil balance."""
        pressures, void = np.split(unknowns, 2)
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
        nodal = self.nodal(unknowns)
        return OilPoint(pressures, nodal, gap, problem, defects, void, step, transport)

    def along_gap(self, point: OilPoint, shift: float) -> AlongGap:
        """Derivatives of `OilBalance.gap_derivatives`."""
        return self.balance.gap_derivatives(point.step, point.nodal, point.transport)

    def along_turn(self, point: OilPoint) -> np.ndarray:
        """Derivative of `OilBalance.along_turn`."""
        return self.balance.along_turn(point.step, point.nodal)

    def _void_update_of_full(self, point: OilPoint, full: np.ndarray) -> np.ndarray:
        """Newton update of the void fractions of full nodes, zero at the others, shape (m,)."""
        void = np.zeros(len(point.void))
        void[full] = point.defect[full] - DEFECT_WEIGHT * point.balance[full] / self._rows[full]
        return void

    def right_side(self, point: OilPoint, full: np.ndarray) -> np.ndarray:
        """Defect of the balance, less the transport of the updated void fractions."""
        void = self._void_update_of_full(point, full)
        return point.balance + self.pattern.multiply(point.weights, void)

    def update(self, point: OilPoint, full: np.ndarray, solution: np.ndarray) -> np.ndarray:
        """Newton update of pressures and void fractions.

        The solution has pressures at full nodes and void fractions at the others.
        """
        void = solution.copy()
        void[full] = self._void_update_of_full(point, full)[full]
        return np.concatenate([solution, void])

    def settled(self, point: OilPoint, tolerance: float) -> bool:
        """True if balance and complementarity hold, in the maximum norm."""
        limit = tolerance * self._source + ROUND_OFF * self._rows.max()
        overlap = np.minimum(point.pressures, point.void)
        return bool(
            np.abs(point.balance).max(initial=0.0) <= limit
            and np.abs(overlap).max(initial=0.0) <= tolerance
        )

    def end(self, point: OilPoint, tolerance: float) -> FilmState:
        """State at the end of a step, with oil content and outflow.

        Raises
        ------
        CavitationError
            It violates complementarity, or a void fraction is above 1.
        """
        balance = self.balance
        step = point.step
        verify_complementarity(point.pressures, point.void, 1.0, 10 * tolerance)
        excess = float(point.void.max(initial=0.0)) - 1.0
        if not excess <= UNDERSHOOT:
            raise CavitationError(f"fluid fraction below 0: by {excess:.2g}, at most {UNDERSHOOT}")
        outflow = balance.outflow(step, point.nodal, point.pressures, point.transport)
        content = balance.volume_scale * step.length * step.full - self.content.void_volumes(point)
        return replace(
            self.state(point),
            content=content,
            outflow=balance.volume_scale * self.film.parameters.rate * outflow,
        )


#: Film model of every cavitation condition, made of a binding and the first index of its content.
MODELS: Mapping[str, Callable[[FilmBinding, int], FilmModel[Any]]] = {
    "reynolds": ReynoldsFilm,
    "mass-conserving": MassConservingFilm,
}


def film_models(bindings: Sequence[FilmBinding], first: int) -> list[FilmModel[Any]]:
    """Models of all films; their contents begin at index `first` of the integration's state."""
    models = []
    for binding in bindings:
        model = MODELS[binding.joint.cavitation](binding, first)
        first = model.content.indices.stop
        models.append(model)
    return models
