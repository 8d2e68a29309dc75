"""Film equations in a step, with the Reynolds condition or mass-conserving cavitation (JFO).

Every film is a complementarity problem of its nodal unknowns w for a gap,

    r(w; gap) = W(gap) y,    0 <= w complementary to y >= 0,

where W is the identity, the mass matrix of 8-node elements, or the transport of void fractions. A
film model (`FilmModel`) defines the unknowns, the residual, its derivatives with respect to
unknowns and gap, the test of convergence, and the state of the film at the end of a step. Its
`FilmContent` has the values in the state of the time integration. `FilmCoupling` couples it to
motion and bores, in the same way for all models. No other module depends on the model of a film.

The first unknowns are the dimensionless pressures of m nodes, bounded below by zero. A model may
have any number of further unknowns without bounds, with their own equations: void fractions, a
temperature. Either its linear system (`pattern`) contains them, or `update` computes them.

**Reynolds condition** (`fenics_ehd.film.cavitation`). The equations are ``W^-1 r(p)``, divided by
the norm of their source.

**Mass-conserving cavitation.** The equation is that of `fenics_ehd.film.oil_balance`; the formula
of the integrator gives the time derivative. With the oil content ``M = int rho h N (1 - s)`` of
every node,

    M' + outflow = 0,    M' = shift M + past,    0 <= p complementary to s >= 0.

Between rough surfaces contents are those of the average gap ``h_T(h)``. The integrator
differentiates the contents themselves, without linearisation in time. Full films therefore agree
with those of the Reynolds condition, whose squeeze term is ``(dh_T / dh) h'``, to the order of the
formula.

The void fractions are unknowns without bounds, whose equation is the balance d = 0. The equation of
the pressures is ``s + gamma d`` (`fenics_ehd.film.oil_balance`). One sparse matrix gives the Newton
updates of the pressures of full nodes and of the void fractions of the other nodes. With one-step
formulas all fluid fractions remain positive. With multistep formulas the fluid fraction of a node
that runs dry within a few steps becomes negative; steps with more than `UNDERSHOOT` are refused.
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

#: Round-off of a film's equations over their largest defect at cavitated nodes. It was 4e-13 in a
#: film of 697 nodes with oil as thin as air, whose flows are 1e8 times the source of the equation.
FLOW_ROUND_OFF = 1e-11

#: Dimensionless pressure up to which SNES-VI treats a pressure as zero.
ZERO_PRESSURE = 1e-14

#: Largest excess of a void fraction over 1 in an accepted step.
UNDERSHOOT = 0.02

#: Relative round-off of oil contents, of which the defects of the shortest steps consist.
ROUND_OFF = 1e-13

#: Derivatives of a film's equations with respect to the gap (on which its rate depends), the mean
#: velocity and the sliding velocity, see `ReynoldsEquation.gap_derivatives`.
AlongGap = tuple[sparse.csc_matrix, sparse.csc_matrix, sparse.csc_matrix | None]


PointT = TypeVar("PointT", bound=FilmPoint)


class FilmModel(ABC, Generic[PointT]):
    """Equations of one film in a step.

    Parameters
    ----------
    binding
        Binding of the film to the mechanism.
    nodes
        Indices of the nodes with unknowns, shape (m,).
    inside
        Mask of the nodes in `nodes` whose unknown is a pressure, shape (m,).
    pattern
        Sparsity pattern of the linear system, with the m nodes first.
    content
        Values of the film in the state of the time integration.

    Attributes
    ----------
    binding, nodes, inside, pattern, content
        Arguments of the constructor.
    film
        Film of the joint.
    lower
        Lower bounds of all unknowns: zero for the m pressures, which come first.
    scale
        Divisor of the equations, set by the first evaluation in a step.
    """

    #: Whether the linear system has a matrix W.
    weighted = True

    #: Whether the derivative with respect to the unknowns is symmetric positive definite.
    symmetric = False

    #: Whether the equations are nearly linear on one active set, so that factors are reused.
    nearly_linear = False

    #: Whether the film conserves oil: `content` is its oil content.
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
        """Vector of the film's unknowns from pressures [Pa] and void fractions of all nodes.

        If no void fractions are given, every node is full of oil.
        """
        return pressure[self.nodes] / self.film.parameters.pressure_scale

    def admissible(self, unknowns: np.ndarray) -> np.ndarray:
        """Extrapolated unknowns of the film, clipped to their lower bounds."""
        return np.maximum(unknowns, self.lower)

    def nodal(self, unknowns: np.ndarray) -> np.ndarray:
        """Dimensionless pressures of all nodes, shape (nodes,), from the vector of unknowns."""
        nodal = self.film.equation.given.copy()
        nodal[self.nodes] = unknowns[: len(self.nodes)] * self.inside
        return nodal

    def pressure(self, unknowns: np.ndarray) -> np.ndarray:
        """Pressures of all nodes, shape (nodes,) [Pa], from the vector of unknowns."""
        return self.film.parameters.pressure_scale * self.nodal(unknowns)

    def full_nodes(self, free: np.ndarray) -> np.ndarray:
        """Indices of the full nodes in the linear system.

        `free` are the indices of the unknowns that are above their bounds.
        """
        return free[free < len(self.nodes)]

    # Residual

    def begin(self, step: ImplicitStep, past_gap: np.ndarray) -> None:
        """Start a time step with a formula of the time integration.

        `past_gap`, shape (g,) [m/s], is the part of the gap's rate at the Gauss points that comes
        from past amplitudes of residual patterns.
        """
        self.content.begin(step)
        self.scale = 0.0

    @abstractmethod
    def evaluate(self, gap: Gap, unknowns: np.ndarray) -> PointT:
        """Evaluate the equations of the film for a gap and a vector of unknowns."""

    @abstractmethod
    def settled(self, point: PointT, tolerance: float) -> bool:
        """Whether the film's equations and complementarity hold to a tolerance.

        Defects are compared in the maximum norm.
        """

    # Derivatives, and the linear system of a Newton step

    def linear_system(self, options_prefix: str) -> ActiveSetSystem:
        """Make the solver of the film's linear system in a Newton step.

        Its matrix has the columns of the film matrix at full nodes, and those of W at other nodes.
        """
        return ActiveSetSystem(
            self.pattern,
            weighted=self.weighted,
            symmetric=self.symmetric,
            options_prefix=f"{options_prefix}{self.binding.name}_",
        )

    def along_unknowns(self, point: PointT) -> np.ndarray:
        """Entries of the derivative of a film's equations with respect to its unknowns."""
        return point.problem.entries(point.pressures) / self.scale

    @abstractmethod
    def along_gap(self, point: PointT, shift: float) -> AlongGap:
        """Derivatives of the equations of all nodes with respect to the gap, without scaling.

        `shift` is the derivative of the thickness rate with respect to the thickness [1/s].
        """

    @abstractmethod
    def along_turn(self, point: PointT) -> np.ndarray:
        """Derivative of the equations of all nodes with respect to the journal's angle, (nodes,).

        It is not scaled. It is zero unless the journal has supplies.
        """

    def rows(self, nodal: np.ndarray) -> np.ndarray:
        """Rows of the linear system: values for its nodes, divided by `scale`.

        `nodal` has the values for the equations of all nodes, without scaling, shape (nodes, ...).
        """
        return nodal[self.nodes] / self.scale

    def columns(self, per_pressure: np.ndarray) -> np.ndarray:
        """Convert derivatives with respect to nodal pressures to those with respect to m unknowns.

        `per_pressure` has the derivatives with respect to nodal pressures [Pa], shape (..., nodes).
        The unknown pressures are dimensionless. The result has the shape (..., m), and is 0 for
        unknowns that are not pressures.
        """
        scale = self.film.parameters.pressure_scale
        return scale * per_pressure[..., self.nodes] * self.inside

    @abstractmethod
    def right_side(self, point: PointT, full: np.ndarray) -> np.ndarray:
        """Right-hand side of the film's linear system in a Newton step.

        `full` are the indices of the full nodes of the active set.
        """

    def update(self, point: PointT, full: np.ndarray, solution: np.ndarray) -> np.ndarray:
        """Newton update of all unknowns of the film, from the solution of its linear system.

        `full` are the indices of the full nodes.
        """
        return solution

    def pressure_update(self, solution: np.ndarray, full: np.ndarray) -> np.ndarray:
        """Newton update of the pressures of all nodes [Pa], from the solution of the linear system.

        It is zero at nodes that are not full.
        """
        nodal = np.zeros(self.film.assembly.size)
        pressed = full[self.inside[full]]
        nodal[self.nodes[pressed]] = self.film.parameters.pressure_scale * solution[pressed]
        return nodal

    # State

    def state(self, point: PointT) -> FilmState:
        """State of the film at one iterate of Newton's method, without verification."""
        free = point.nodal[self.film.free]
        result = CavitationResult(free, self.scale * point.defect, np.flatnonzero(free > 0.0), 0)
        pressure = self.film.parameters.pressure_scale * point.nodal
        return FilmState(pressure, point.gap, result, point.fluid_fraction)

    @abstractmethod
    def end(self, point: PointT, tolerance: float) -> FilmState:
        """State of the film at the end of a step, after its complementarity is verified.

        Raises
        ------
        CavitationError
            If the state violates complementarity, or a condition of the model.
        """


class ReynoldsFilm(FilmModel[FilmPoint]):
    """Film with the Reynolds condition (8) of cavitation.

    Parameters
    ----------
    binding
        Binding of the film to the mechanism.
    first
        Index at which the values of the film begin in the state of the integration; this film has
        none.
    """

    nearly_linear = True

    def __init__(self, binding: FilmBinding, first: int):
        film = binding.film.film
        inside = np.ones(len(film.free), dtype=bool)
        super().__init__(binding, film.free, inside, film.equation.pattern, FilmContent(first))
        self.weighted = film.equation.weights is not None
        self.symmetric = film.parameters.lubricant.linear

    def evaluate(self, gap: Gap, unknowns: np.ndarray) -> FilmPoint:
        """Evaluate the Reynolds equation for a gap and unknowns.

        It is divided by the norm of its source at the first evaluation in the step.
        """
        problem = self.film.equation.problem(gap)
        self.scale = self.scale or problem.scale
        defect = self.film.cavitation.defect(problem, unknowns) / self.scale
        return FilmPoint(unknowns, self.nodal(unknowns), gap, problem, defect)

    def along_gap(self, point: FilmPoint, shift: float) -> AlongGap:
        """Derivatives of the equations with respect to the gap, for `shift` = ``d h' / d h`` [1/s].

        See `ReynoldsEquation.gap_derivatives`.
        """
        return self.film.equation.gap_derivatives(point.gap, point.nodal, shift)

    def along_turn(self, point: FilmPoint) -> np.ndarray:
        """Derivative of the equations with respect to the journal's angle.

        See `ReynoldsEquation.along_turn`.
        """
        return self.film.equation.along_turn(point.gap, point.nodal)

    def _open_defect(self, point: FilmPoint) -> np.ndarray:
        """Defects that must vanish; 0 at nodes with zero pressure and a positive defect."""
        is_open = (point.pressures > ZERO_PRESSURE) | (point.defect < 0.0)
        return np.where(is_open, point.defect, 0.0)

    def right_side(self, point: FilmPoint, full: np.ndarray) -> np.ndarray:
        """Right-hand side of the film's linear system: W times the defects that must vanish."""
        defect = self._open_defect(point)
        weights = point.weights
        return defect if weights is None else self.pattern.multiply(weights, defect)

    def settled(self, point: FilmPoint, tolerance: float) -> bool:
        """Whether the defects that must vanish are below the tolerance, or only round-off."""
        largest: float = np.abs(self._open_defect(point)).max(initial=0.0)
        return largest <= self._limit(point, tolerance)

    def _limit(self, point: FilmPoint, tolerance: float) -> float:
        """Largest defect of the film's equations that counts as zero: tolerance or round-off."""
        return max(tolerance, FLOW_ROUND_OFF * np.abs(point.defect).max(initial=0.0))

    def end(self, point: FilmPoint, tolerance: float) -> FilmState:
        """State of the film at the end of a step, whose complementarity is verified."""
        state = self.state(point)
        limit = 10 * self._limit(point, tolerance)
        result = state.cavitation
        verify_complementarity(result.pressure, result.flux, self.scale, limit)
        return state


class MassConservingFilm(FilmModel[OilPoint]):
    """Film with mass-conserving cavitation (JFO).

    Parameters
    ----------
    binding
        Binding of the film to the mechanism.
    first
        Index at which the oil content of the film begins in the state of the integration.

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
        # The binding's film has the temperature of the heat balance, unlike the joint's film.
        balance = OilBalance(binding.film.film, oil_outside=joint.ambient == "oil")
        content = OilContent(binding, balance, first)
        super().__init__(binding, balance.unknown, ~balance.dry, balance.pattern, content)
        self.balance = balance
        self._areas = balance.assembly.source(np.ones_like(balance.assembly.area))[self.nodes]
        # Void fractions have no bounds.
        self.lower = np.concatenate([self.lower, np.full(len(self.nodes), -np.inf)])

    def unknowns(self, pressure: np.ndarray, void: np.ndarray | None = None) -> np.ndarray:
        """Vector of the film's unknowns from pressures [Pa] and void fractions of all nodes.

        See `FilmModel.unknowns`.
        """
        nodal = np.zeros(self.balance.assembly.size) if void is None else void
        return np.concatenate([super().unknowns(pressure), nodal[self.nodes]])

    def admissible(self, unknowns: np.ndarray) -> np.ndarray:
        """Extrapolated unknowns with pressures and void fractions clipped to at least zero."""
        return np.maximum(unknowns, 0.0)

    def begin(self, step: ImplicitStep, past_gap: np.ndarray) -> None:
        """Start a time step with past oil contents and past gaps, see `FilmModel.begin`."""
        self.content.begin(step)
        joint = self.binding.film
        rate = self.film.parameters.rate
        # The rate of the affine part of the gap is ``shift h + past``.
        constant = joint.clearance + joint.deviation[: len(joint.thickness)]
        past = joint.thickness @ step.past_x[self.binding.xi] + past_gap
        past = past - step.shift * constant
        self._length = rate / step.shift
        self._past_void = self.content.past / (self.balance.volume_scale * rate)
        self._former = self._past_void - self.content.full(past) / rate
        self._rows = np.zeros(0)

    def evaluate(self, gap: Gap, unknowns: np.ndarray) -> OilPoint:
        """Evaluate the equations for a gap: those of the pressures, followed by the oil balance."""
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
        """Derivatives of the oil balance with respect to the gap.

        See `OilBalance.gap_derivatives`.
        """
        return self.balance.gap_derivatives(point.step, point.nodal, point.transport)

    def along_turn(self, point: OilPoint) -> np.ndarray:
        """Derivative of the oil balance with respect to the journal's angle.

        See `OilBalance.along_turn`.
        """
        return self.balance.along_turn(point.step, point.nodal)

    def _void_update_of_full(self, point: OilPoint, full: np.ndarray) -> np.ndarray:
        """Newton update of the void fractions at full nodes, shape (m,); zero at other nodes."""
        void = np.zeros(len(point.void))
        void[full] = point.defect[full] - DEFECT_WEIGHT * point.balance[full] / self._rows[full]
        return void

    def right_side(self, point: OilPoint, full: np.ndarray) -> np.ndarray:
        """Right-hand side of the film's linear system: defect of the oil balance, shape (m,).

        It includes the effect of the void fractions of full nodes, whose Newton update is known.
        """
        void = self._void_update_of_full(point, full)
        return point.balance + self.pattern.multiply(point.weights, void)

    def update(self, point: OilPoint, full: np.ndarray, solution: np.ndarray) -> np.ndarray:
        """Newton update of pressures and void fractions.

        The solution of the linear system has updates of pressures at full nodes, and of void
        fractions at the other nodes.
        """
        void = solution.copy()
        void[full] = self._void_update_of_full(point, full)[full]
        return np.concatenate([solution, void])

    def settled(self, point: OilPoint, tolerance: float) -> bool:
        """Whether oil balance and complementarity hold to a tolerance, in the maximum norm."""
        limit = tolerance * self._source + ROUND_OFF * self._rows.max()
        overlap = np.minimum(point.pressures, point.void)
        return bool(
            np.abs(point.balance).max(initial=0.0) <= limit
            and np.abs(overlap).max(initial=0.0) <= tolerance
        )

    def end(self, point: OilPoint, tolerance: float) -> FilmState:
        """State of the film at the end of a step, with oil content and outflow of the nodes.

        Raises
        ------
        CavitationError
            If the state violates complementarity, or a void fraction is above 1.
        """
        balance = self.balance
        step = point.step
        verify_complementarity(point.pressures, point.void, 1.0, 10 * tolerance)
        excess = float(point.void.max(initial=0.0)) - 1.0
        if not excess <= UNDERSHOOT:
            raise CavitationError(
                f"the fluid fraction of a node is {-excess:.2g}, below the limit of {-UNDERSHOOT}"
            )
        outflow = balance.outflow(step, point.nodal, point.pressures, point.transport)
        content = balance.volume_scale * step.length * step.full - self.content.void_volumes(point)
        return replace(
            self.state(point),
            content=content,
            outflow=balance.volume_scale * self.film.parameters.rate * outflow,
        )


#: Film model for every cavitation condition; arguments are a binding, and the index at which the
#: content begins in the state of the integration.
MODELS: Mapping[str, Callable[[FilmBinding, int], FilmModel[Any]]] = {
    "reynolds": ReynoldsFilm,
    "mass-conserving": MassConservingFilm,
}


def film_models(bindings: Sequence[FilmBinding], first: int) -> list[FilmModel[Any]]:
    """Make the models of all films.

    The values of the films in the state of the time integration begin at index `first`.
    """
    models = []
    for binding in bindings:
        model = MODELS[binding.joint.cavitation](binding, first)
        first = model.content.indices.stop
        models.append(model)
    return models
