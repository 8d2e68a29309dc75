"""What one film's equations have to do with the unknowns of motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.film.asperities import Touch
from fenics_ehd.film.cavitation import Complementarity
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.film.reynolds import DensityRate
from fenics_ehd.multibody.border import FilmBorder
from fenics_ehd.multibody.conserved_oil import ConservedOil, OilPoint
from fenics_ehd.multibody.joint_shape import Turned
from fenics_ehd.multibody.system import FilmPlace


@dataclass(frozen=True, eq=False)
class FilmPoint:
    """One film at one evaluation.

    Attributes
    ----------
    nodal
        Dimensionless pressure at all nodes.
    gap, problem
        See `Film`.
    defect
        Scaled equations, shape (m,).
    touch
        Contact at the Gauss points, None between smooth surfaces.
    turned
        Of a joint's shape that turns, else None.
    oil
        Where it is conserved.
    density_rate
        Where it is compressible, and not conserved.
    """

    nodal: np.ndarray
    gap: Gap
    problem: Complementarity
    defect: np.ndarray
    touch: Touch | None = None
    turned: Turned | None = None
    oil: OilPoint | None = None
    density_rate: DensityRate | None = None


@dataclass(frozen=True, eq=False)
class FilmColumns:
    """What does not change in the border of one film.

    Attributes
    ----------
    place
        Whose.
    gap
        Gap change at the Gauss points for unit xi, shaft's angle and leading patterns, shape
        (g, n + 1 + k).
    velocity, sliding
        Mean and sliding velocity for unit rates of xi and of the shaft's angle, shape
        (g, n + 1); None: the oil does not thin, nor is one surface rougher.
    forces
        Minus the force of unit pressures at free nodes on xi, shape (n, m).
    shares
        Minus the leading patterns' share of such pressures, shape (k, m); None: no patterns.
    oil
        Where it is conserved; there are nodes without pressure then.
    """

    place: FilmPlace
    gap: np.ndarray
    velocity: np.ndarray
    forces: np.ndarray
    shares: np.ndarray | None
    sliding: np.ndarray | None = None
    oil: ConservedOil | None = None

    @property
    def nodes(self) -> np.ndarray:
        """Nodes of the film's equations, shape (m,)."""
        return self.place.film.film.free if self.oil is None else self.oil.nodes

    @classmethod
    def of(
        cls,
        place: FilmPlace,
        patterns: tuple[np.ndarray, np.ndarray] | None = None,
        oil: ConservedOil | None = None,
    ) -> FilmColumns:
        """With leading patterns: gap changes and shares of nodal pressures."""
        joint = place.film
        scale = joint.film.parameters.pressure_scale
        free = joint.film.free if oil is None else oil.nodes
        turning = np.full((len(joint.thickness), 1), 0.5 * joint.shaft_radius)
        velocity = np.hstack([joint.mean_velocity, turning])
        gap = np.hstack([joint.thickness, np.zeros_like(turning)])
        forces = -scale * joint.load[:, free]
        sliding, surfaces = None, joint.film.parameters.surfaces
        dragging = surfaces is not None and surfaces.dragging
        if dragging or joint.film.parameters.lubricant.shear_law is not None:
            sliding = np.hstack([joint.sliding_velocity, 2.0 * turning])
        shares = None
        if patterns is not None:
            gap = np.hstack([gap, patterns[0]])
            shares = -scale * patterns[1][:, free]
        if oil is not None:
            forces = forces * oil.inside
            shares = None if shares is None else shares * oil.inside
        return cls(place, gap, velocity, forces, shares, sliding, oil)

    def of_pressures(self, per_pressure: np.ndarray) -> np.ndarray:
        """What unit pressures of all nodes do, shape (..., nodes), by those that are unknown."""
        found = per_pressure[..., self.nodes]
        return found if self.oil is None else found * self.oil.inside

    @property
    def leading(self) -> int:
        """Number k of leading patterns."""
        return 0 if self.shares is None else len(self.shares)

    def border(
        self,
        point: FilmPoint,
        scale: float,
        shift: float,
        speed: np.ndarray,
        patterns: slice,
        share: float,
        size: int,
    ) -> FilmBorder:
        """At one point; the rates of xi follow xi alone: their share of the drift is tiny.

        Parameters
        ----------
        point, scale
            Of the film, and what its equations are divided by.
        shift
            Of the step.
        speed
            Derivative of all rates along all unknowns x but the patterns.
        patterns, share
            Places of the leading patterns in x, and how they answer within the step.
        size
            Number of unknowns x.
        """
        place = self.place
        film, n = place.film.film, place.film.size
        if self.oil is None:
            derivatives = film.equation.gap_derivatives(
                point.gap, point.nodal, shift, point.density_rate
            )
        else:
            assert point.oil is not None
            derivatives = self.oil.gap_derivatives(point.nodal, point.oil)
        along_h, along_v, along_u = derivatives
        inputs, velocity = along_h @ self.gap, along_v @ self.velocity
        if along_u is not None:
            velocity += along_u @ self.sliding
        inputs[:, :n] += shift * velocity[:, :n]
        inputs[:, n] += velocity[:, n]
        spread = np.zeros((inputs.shape[1], size))
        spread[np.arange(n), place.xi] = 1.0
        for angle, sign in place.turning:
            spread[n, : speed.shape[1]] += sign * speed[angle]
        outputs, rows = self.forces, place.xi
        if self.shares is not None:
            outputs = np.vstack([outputs, share * self.shares])
            rows = np.concatenate([rows, np.arange(patterns.start, patterns.stop)])
            spread[n + 1 :, patterns] = np.eye(patterns.stop - patterns.start)
        if film.equation.feeds is not None and film.equation.feeds.turning:
            inputs, spread = self._turning(point, inputs, spread)
        return FilmBorder(inputs[self.nodes] / scale, spread, outputs, rows, patterns, along_h)

    def _turning(
        self, point: FilmPoint, inputs: np.ndarray, spread: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """One more input: the angle of the journal, which carries what supplies the film."""
        place, equation = self.place, self.place.film.film.equation
        row = np.zeros((1, spread.shape[1]))
        for angle, sign in place.turning:
            row[0, angle] += sign
        if self.oil is None:
            along = equation.along_turn(point.gap, point.nodal)
        else:
            assert point.oil is not None
            along = self.oil.balance.along_turn(point.oil.step, point.nodal)
        return np.column_stack([inputs, along]), np.vstack([spread, row])
