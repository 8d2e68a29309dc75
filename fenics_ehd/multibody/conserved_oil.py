"""Oil of a lubricated joint that its film keeps account of, within the steps of a mechanism.

The equation is that of `fenics_ehd.film.mass_conserving`, the bore elastic, time by the formula of
the motion: with the content ``M = int rho h N (1 - s)`` of every node

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

Unknown beside the pressures are the void fractions, free variables of the equation d = 0; that of
the pressures is ``s + gamma d`` (`fenics_ehd.film.mass_conserving_solver`). A Newton step finds
pressures of the full nodes and void fractions of the others with one sparse matrix.

With one-step formulas no fluid fraction falls below zero. With more steps a
node that runs dry within few of them undershoots (`UNDERSHOOT`); steps that do more are refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy import sparse

from fenics_ehd.base.errors import CavitationError
from fenics_ehd.film.cavitation import CavitationResult, Complementarity, verify_complementarity
from fenics_ehd.film.kinematics import Gap, GapDerivatives
from fenics_ehd.film.oil_balance import OilBalance, OilProblem, OilStep
from fenics_ehd.film.oil_state import DEFECT_WEIGHT, OilState
from fenics_ehd.film.reynolds import SMALLEST_SOURCE
from fenics_ehd.multibody.implicit_step import ImplicitStep
from fenics_ehd.multibody.system import FilmPlace

#: Largest excess of a void fraction over 1.
UNDERSHOOT = 0.02

#: Largest excess of the density over that at ambient pressure that a state is taken to hold:
#: Dowson and Higginson's law at any pressure.
DENSEST = 0.6 / 1.7

#: Round-off of the contents over a step, which the defects of the shortest steps consist of.
ROUND_OFF = 1e-13


@dataclass(frozen=True, eq=False)
class OilPoint:
    """Oil of one film at one evaluation.

    Attributes
    ----------
    values, void
        Pressures, outflows at dry sides, and void fractions of the unknown nodes, shape (m,).
    step
        See there.
    defect
        What the balance lacks at these nodes, shape (m,).
    nodal_void
        Void fractions of all nodes.
    transport
        Entries of the derivative of their transport.
    """

    values: np.ndarray
    void: np.ndarray
    step: OilStep
    defect: np.ndarray
    nodal_void: np.ndarray
    transport: np.ndarray


class Evaluated(Protocol):
    """A film at one evaluation, see `FilmPoint`."""

    @property
    def nodal(self) -> np.ndarray:
        """Dimensionless pressures of all nodes."""

    @property
    def gap(self) -> Gap:
        """At the Gauss points."""

    @property
    def problem(self) -> Complementarity:
        """The oil's balance."""


class ConservedOil:
    """Oil of one joint.

    Parameters
    ----------
    place
        The joint, its cavitation mass-conserving.
    first
        Place of its first volume in the state of the integration.

    Attributes
    ----------
    balance
        Its equation.
    nodes, inside
        Nodes with unknowns, and which of these have a pressure.
    volumes
        Places in the state of what the contents of all nodes lack.
    scale
        Norm of the source of the step's first point, to which tolerances refer.
    """

    def __init__(self, place: FilmPlace, first: int):
        joint = place.joint
        assert joint.oil is not None
        self._place, self._filling = place, joint.oil.filling
        # Not the joint's own film, which heat does not warm.
        self.balance = OilBalance(place.film.film, oil_outside=joint.oil.oil_outside)
        self.nodes, self.inside = self.balance.unknown, ~self.balance.dry
        self.volumes = slice(first, first + self.balance.assembly.size)
        self._areas = self.balance.stored(np.ones_like(joint.film.assembly.area))[self.nodes]

    def _full(self, thickness: np.ndarray) -> np.ndarray:
        """``int rho h N`` at all nodes of a gap at the Gauss points, over the volume scale."""
        film = self._place.film.film
        thickness = thickness.reshape(film.assembly.area.shape) / film.parameters.clearance
        return self.balance.stored(film.equation.factors[1] * thickness)

    def affine_gap(self, xi: np.ndarray, patterns: np.ndarray | float = 0.0) -> np.ndarray:
        """Gap at the Gauss points that is affine in the state, of coordinates and patterns [m]."""
        film = self._place.film
        fixed = 0.0 if film.shape is None else film.shape.fixed[: len(film.thickness)]
        return film.clearance + fixed + film.thickness @ xi + patterns

    def _closed(self, z: np.ndarray) -> np.ndarray | float:
        """What a turning journal's shape takes from the affine gap at the Gauss points [m]."""
        shape = self._place.film.shape
        if shape is None or not shape.turning:
            return 0.0
        return shape.closing(self._place.ahead(z))[: len(self._place.film.thickness)]

    def _taken(self, z: np.ndarray, nominal: np.ndarray) -> np.ndarray:
        """What the full contents lack of those of the affine gap, over the volume scale.

        A turning journal's shape takes it; between rough surfaces the average gap adds what it has
        beyond the `nominal` one (Gauss points).
        """
        closed, surfaces = self._closed(z), self._place.film.film.parameters.surfaces
        taken = np.zeros(self.balance.assembly.size)
        if isinstance(closed, np.ndarray):
            taken = self._full(closed)
        if surfaces is not None:
            taken = taken - self._full(surfaces.excess(nominal))
        return taken

    def _resting(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Full contents without residual patterns, and what is taken, over the volume scale."""
        affine = self.affine_gap(z[self._place.xi])
        taken = self._taken(z, affine - self._closed(z))
        return self._full(affine) - taken, taken

    def volumes_at(self, z: np.ndarray) -> np.ndarray:
        """The state's volumes of the initial filling, for coordinates z, shape (nodes,) [m^3]."""
        full, taken = self._resting(z)
        lacking = np.where(self.balance.reservoir, 0.0, 1.0 - self._filling) * full
        return self.balance.volume_scale * (lacking + taken)

    def _observed(self, state: np.ndarray, observed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Full contents of a state, over the volume scale, and void volumes of its nodes [m^3]."""
        surfaces = self._place.film.film.parameters.surfaces
        # Gauss points come first.
        gap = observed[: self._place.film.film.assembly.area.size]
        seen = gap if surfaces is None else gap + surfaces.excess(gap)
        void = state[self.volumes] - self.balance.volume_scale * self._taken(state, gap)
        return self._full(seen), void[self.nodes]

    def within_gap(self, state: np.ndarray, observed: np.ndarray) -> np.ndarray:
        """What brings a state's void volumes between none and the gap's, where it is observed.

        Compressed oil may be more than the gap's, by `DENSEST`.
        """
        full, void = self._observed(state, observed)
        full = self.balance.volume_scale * full[self.nodes]
        constant = self._place.film.film.parameters.lubricant.density_law.constant
        least = 0.0 if constant else -DENSEST
        change = np.zeros(self.balance.assembly.size)
        change[self.nodes] = np.clip(void, least * full, full) - void
        return change

    def content(self, state: np.ndarray, observed: np.ndarray) -> float:
        """Oil in a state of a gap, where it is observed [m^3]."""
        full, void = self._observed(state, observed)
        return float(self.balance.volume_scale * full.sum() - void.sum())

    def void_shares(self, state: np.ndarray, observed: np.ndarray) -> np.ndarray:
        """Void fractions of all nodes in a state of a gap, where it is observed."""
        full, void = self._observed(state, observed)
        shares = np.zeros(self.balance.assembly.size)
        full = self.balance.volume_scale * full[self.nodes]
        shares[self.nodes] = np.clip(void / full, 0.0, 1.0)
        return shares

    def volumes_with(self, shares: np.ndarray, z: np.ndarray, observed: np.ndarray) -> np.ndarray:
        """The state's volumes of such void fractions [m^3]."""
        gap = observed[: self._place.film.film.assembly.area.size]
        surfaces = self._place.film.film.parameters.surfaces
        full = self._full(gap if surfaces is None else gap + surfaces.excess(gap))
        void = np.zeros(self.balance.assembly.size)
        void[self.nodes] = (full * shares)[self.nodes]
        return self.balance.volume_scale * (void + self._taken(z, gap))

    def fractions(self, state: np.ndarray) -> np.ndarray:
        """Void fractions of a state without residual patterns."""
        scale, (full, taken) = self.balance.volume_scale, self._resting(state)
        return (state[self.volumes] - scale * taken)[self.nodes] / (scale * full[self.nodes])

    def begin(self, step: ImplicitStep, past_thickness: np.ndarray) -> None:
        """Take another step; the affine gap's rate is ``shift h + past_thickness`` [m/s]."""
        rate = self._place.film.film.parameters.rate
        self._shift, self._length = step.shift, rate / step.shift
        self._past_volumes = step.past_x[self.volumes]
        self._past_void = self._past_volumes / (self.balance.volume_scale * rate)
        self._former = self._past_void - self._full(past_thickness) / rate
        self._rows: np.ndarray | None = None

    def evaluate(
        self, gap: Gap, values: np.ndarray, void: np.ndarray
    ) -> tuple[OilProblem, np.ndarray, OilPoint]:
        """The balance at a point, the equations of the pressures, and what is known of it."""
        balance = self.balance
        step = balance.ending(gap, self._length, self._former)
        problem = balance.problem(step)
        defect = problem.residual(values) - problem.transport(void)
        if self._rows is None:
            zero = np.zeros(len(values))
            source = (problem.residual(zero) + self._past_void[self.nodes])[self.inside]
            least = SMALLEST_SOURCE * float(np.linalg.norm(self._areas))
            self.scale = max(float(np.linalg.norm(source)), least)
            self._rows = problem.rows
        transport = problem.transport_entries(void)
        point = OilPoint(values, void, step, defect, balance.spread(void), transport)
        return problem, void + DEFECT_WEIGHT * defect / self._rows, point

    def gap_derivatives(
        self, nodal: np.ndarray, point: OilPoint
    ) -> tuple[sparse.csc_matrix, sparse.csc_matrix, sparse.csc_matrix | None]:
        """See `OilBalance.gap_derivatives`."""
        return self.balance.gap_derivatives(point.step, nodal, point.nodal_void)

    def change(self, nodal: np.ndarray, point: OilPoint, changes: GapDerivatives) -> np.ndarray:
        """See `OilBalance.change`; of the nodes with unknowns."""
        return self.balance.change(point.step, nodal, point.nodal_void, changes)[self.nodes]

    def given(
        self, point: OilPoint, full: np.ndarray, pressures: np.ndarray, defect: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Right-hand side of a Newton step, and what it takes from void fractions of full nodes.

        Parameters
        ----------
        point, full
            Evaluation and numbers of the full nodes.
        pressures, defect
            Rest of the pressures' equations, at full nodes, and of the balance, shape (m,).
        """
        assert self._rows is not None
        void = np.zeros(len(defect))
        void[full] = pressures[full] - DEFECT_WEIGHT * defect[full] / self._rows[full]
        return defect + self.balance.pattern.multiply(point.transport, void), void

    def settled(self, point: OilPoint, tolerance: float) -> bool:
        """Whether balance and complementarity hold, in the maximum norm."""
        assert self._rows is not None
        limit = tolerance * self.scale + ROUND_OFF * self._rows.max()
        overlap = np.minimum(point.values, point.void)
        return bool(
            np.abs(point.defect).max(initial=0.0) <= limit
            and np.abs(overlap).max(initial=0.0) <= tolerance
        )

    def as_pressures(self, point: OilPoint) -> np.ndarray:
        """Pressures of all nodes [Pa] with outflows on the same scale, to start from."""
        nodal = self.balance.film.equation.given.copy()
        nodal[self.nodes] = point.values
        return self.balance.film.parameters.pressure_scale * nodal

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
        volumes = point.step.full * point.nodal_void
        volumes[self.nodes] += point.defect
        film = self._place.film.film
        if not film.parameters.lubricant.density_law.constant:
            nodal = self.balance.nodal(point.values)
            denser = self.balance.oil(point.step, nodal).density - film.equation.factors[1]
            volumes -= self.balance.stored(denser * point.step.thickness / point.step.length)
        return self.balance.volume_scale * point.step.length * volumes

    def state(
        self,
        film: Evaluated,
        point: OilPoint,
        result: tuple[np.ndarray, int],
        tolerance: float,
    ) -> OilState:
        """The end of a step; `result` has full nodes and iterations.

        Raises
        ------
        CavitationError
            It violates complementarity, oil is lost, or a void fraction is above 1.
        """
        balance, step, nodal = self.balance, point.step, film.nodal
        p = self._place.film.film.parameters
        verify_complementarity(point.values, point.void, 1.0, 10 * tolerance)
        excess = float(point.void.max(initial=0.0)) - 1.0
        if not excess <= UNDERSHOOT:
            raise CavitationError(f"fluid fraction below 0: by {excess:.2g}, at most {UNDERSHOOT}")
        lost, outflow = balance.ends(step, nodal, point.values, point.nodal_void)
        reference = np.sum(np.abs(step.flows) + step.full + np.abs(step.former))
        stored = balance.volume_scale * step.length * step.full - self._void(point)
        full, iterations = result
        return OilState(
            pressure=p.pressure_scale * nodal,
            gap=film.gap,
            cavitation=CavitationResult(
                point.values, point.void, full.astype(np.int32), iterations
            ),
            problem=film.problem,
            fluid_fraction=1.0 - point.nodal_void,
            content=stored,
            outflow=balance.volume_scale * p.rate * outflow,
            time_step=step.length / p.rate,
            imbalance=float(np.abs(lost + outflow).sum() / reference),
        )


def conserved_oils(places: Sequence[FilmPlace], first: int) -> list[ConservedOil | None]:
    """Of every film, None where Reynolds' condition holds; void volumes begin at `first`."""
    found: list[ConservedOil | None] = []
    for place in places:
        oil = None
        if place.joint.oil is not None:
            oil = ConservedOil(place, first)
            first = oil.volumes.stop
        found.append(oil)
    return found
