"""All equations of one implicit step of a mechanism and its film, scaled to order one.

Unknowns are the dimensionless pressures at the free nodes of the film and the coordinates, in
units that change the gap by a clearance. Equations are the film's, over its source, and those
of motion, over forces that the film exerts.

The derivative of the oil's shear, where it acts, is left out: it is c / R of the pressure's, so
that every iteration still shrinks the error by about 1e-3 (`tests/test_driven_crank.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import sparse

from fenics_ehd.film import FilmState
from fenics_ehd.film.cavitation import CavitationResult, Complementarity
from fenics_ehd.film.film import check_gap
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.multibody.bordered import Linearisation
from fenics_ehd.multibody.equations import Equations, Mechanism
from fenics_ehd.multibody.newton import ImplicitStep

#: Rows over columns below which a product with all columns is cheaper than to pick them first.
FEW = 0.25


@dataclass(frozen=True, eq=False)
class Point:
    """One evaluation of all equations.

    Attributes
    ----------
    xi
        Coordinates, shape (n,).
    nodal
        Dimensionless pressure at all film nodes.
    gap, problem
        The film's.
    film, motion
        The scaled equations, shape (m,) and (n,).
    equations
        Those of motion as the mechanism gave them.
    """

    xi: np.ndarray
    nodal: np.ndarray
    gap: Gap
    problem: Complementarity
    film: np.ndarray
    motion: np.ndarray
    equations: Equations


class CoupledEquations:
    """Equations of one step after another of one mechanism.

    Parameters
    ----------
    mechanism
        With the film in its journal, an oil of constant density.
    dense_patterns
        Whether to answer pressures by one matrix from nodes to Gauss points, or by the residual
        patterns one after the other (M4).

    Attributes
    ----------
    m, n
        Free nodes of the film, coordinates.
    scale
        Source of the film at the first point of the step, to which its equations refer.
    """

    def __init__(self, mechanism: Mechanism, *, dense_patterns: bool):
        self._mechanism = mechanism
        journal = self.journal = mechanism.journal
        film = self.film = journal.film
        self.m, self.n = len(film.free), journal.coordinates
        moved = np.abs(journal.thickness).max(axis=0)
        self._length = film.parameters.clearance / np.maximum(moved, 1e-6 * moved.max())
        self._pressure_scale = film.parameters.pressure_scale
        self._answer: np.ndarray | None = None
        compliance = journal.compliance
        if compliance is not None and dense_patterns:
            patterns = self._pressure_scale * compliance.patterns[:, film.free]
            self._answer = compliance.outward @ patterns

    def begin(self, step: ImplicitStep) -> None:
        """Take the equations of another step."""
        n = self.n
        self._step = replace(step, past_x=step.past_x[:n], past_rate=step.past_rate[:n])
        self.scale = 0.0
        compliance = self.journal.compliance
        if compliance is not None:
            past = step.past_x[n:]
            self._share, self._rest = compliance.answer(step.shift, past)
            # y_0 and its rate, shift y_0 + past, are multiples of the past.
            moved = compliance.outward @ past
            self._rest_gap = -self._share * compliance.damping_time * moved
            self._rest_rate = self._share * moved

    def unknowns(self, pressure: np.ndarray, xi: np.ndarray) -> np.ndarray:
        """From pressures at all nodes [Pa] and coordinates, shape (m + n,)."""
        free = pressure[self.film.free] / self._pressure_scale
        return np.concatenate([free, xi / self._length])

    def evaluate(self, unknowns: np.ndarray) -> Point:
        """All equations at one point.

        Raises
        ------
        GapClosedError
            The gap is not positive at a Gauss point.
        SolverError
            From the mechanism.
        """
        film, step, m = self.film, self._step, self.m
        xi = unknowns[m:] * self._length
        rate, acceleration = step.rates(xi)
        nodal = film.equation.nodal(unknowns[:m])
        equations = self._mechanism.equations(
            step.time, xi, rate, acceleration, step.shifts, self._pressure_scale * nodal
        )
        gap = self.journal.film_gap(xi, rate, equations.shaft_rate)
        if self.journal.compliance is not None:
            gap = self._yielding(gap, unknowns[:m])
        check_gap(gap)
        problem = film.equation.problem(gap)
        if not self.scale:
            self.scale = problem.scale
            reach = np.abs(equations.coupling).sum(axis=1) * self._pressure_scale
            self._force = np.maximum(reach, 1e-6 * reach.max())
        defect = film.cavitation.defect(problem, unknowns[:m]) / self.scale
        motion = equations.residual
        if equations.shear is not None:
            result = CavitationResult(unknowns[:m], defect, np.empty(0, dtype=np.int32), 0)
            state = FilmState(self._pressure_scale * nodal, gap, result, problem)
            motion = motion - equations.shear(state)
        motion = motion / self._force
        return Point(xi, nodal, gap, problem, defect, motion, equations)

    def _yielding(self, gap: Gap, pressure: np.ndarray) -> Gap:
        """A gap with what the residual patterns answer to free pressures."""
        moved = self._moved(pressure)
        shape = gap.thickness.shape
        rate = self._rest_rate + self._step.shift * moved
        return replace(
            gap,
            thickness=gap.thickness + (self._rest_gap + moved).reshape(shape),
            thickness_rate=gap.thickness_rate + rate.reshape(shape),
        )

    def _moved(self, pressure: np.ndarray) -> np.ndarray:
        """Gap change at the Gauss points for pressures at the free nodes [m]."""
        if self._answer is not None:
            return self._share * (self._answer @ pressure)
        compliance = self.journal.compliance
        assert compliance is not None
        share = self._share * self._pressure_scale
        return compliance.outward @ (compliance.patterns[:, self.film.free] @ (share * pressure))

    def linearise(self, point: Point) -> Linearisation:
        """Derivatives at a point."""
        film, journal, step = self.film, self.journal, self._step
        free, scale, force = film.free, self._pressure_scale, self._force[:, None]
        along_h, along_v = film.equation.gap_slopes(point.gap, point.nodal, step.shift)
        velocity = journal.mean_velocity_slope(step.shift, point.equations.shaft_rate_slope)
        along = (along_h @ journal.thickness + along_v @ velocity)[free]
        compliance = journal.compliance
        none = np.zeros((self.m, 0))
        patterns_along, patterns, dense = none, none.T, None
        if self._answer is not None:
            dense = partial(self._pattern_block, along_h * (self._share / self.scale))
        elif compliance is not None:
            patterns_along = (along_h @ compliance.outward)[free] * (self._share / self.scale)
            patterns = scale * compliance.patterns[:, free]
        return Linearisation(
            point.problem.entries(point.nodal[free]) / self.scale,
            point.problem.weights,
            along * (self._length / self.scale),
            patterns_along,
            patterns,
            dense,
            point.equations.coupling[:, free] * (scale / force),
            point.equations.slope * (self._length / force),
        )

    def _pattern_block(
        self, along_h: sparse.csc_matrix, rows: np.ndarray, columns: np.ndarray
    ) -> np.ndarray:
        """What pressures at some free nodes do to the equations at others by the patterns."""
        assert self._answer is not None
        reached = self.film.assembly.restrict(along_h, self.film.free[rows])
        if len(rows) < FEW * len(columns):
            return (reached @ self._answer)[:, columns]
        return reached @ np.take(self._answer, columns, axis=1)

    def relative_gap_change(self, point: Point, pressure: np.ndarray, xi: np.ndarray) -> np.ndarray:
        """For changes of the unknowns, over the gap at a point, at the Gauss points, shape (g,)."""
        change = self.journal.thickness @ (self._length * xi)
        if self.journal.compliance is not None:
            change += self._moved(pressure)
        return change / point.gap.thickness.ravel()

    def state(self, point: Point) -> np.ndarray:
        """``x = (xi, y)`` of a point."""
        compliance = self.journal.compliance
        if compliance is None:
            return point.xi
        pressure = self._pressure_scale * point.nodal
        return np.concatenate(
            [point.xi, self._share * (compliance.patterns @ pressure) + self._rest]
        )
