"""What one film's equations have to do with the unknowns of motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.film.asperities import Touch
from fenics_ehd.film.cavitation import Complementarity
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.multibody.border import FilmBorder
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
    """

    nodal: np.ndarray
    gap: Gap
    problem: Complementarity
    defect: np.ndarray
    touch: Touch | None = None
    turned: Turned | None = None


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
    """

    place: FilmPlace
    gap: np.ndarray
    velocity: np.ndarray
    forces: np.ndarray
    shares: np.ndarray | None
    sliding: np.ndarray | None = None

    @classmethod
    def of(
        cls, place: FilmPlace, patterns: tuple[np.ndarray, np.ndarray] | None = None
    ) -> FilmColumns:
        """With leading patterns: gap changes and shares of nodal pressures."""
        joint = place.film
        free, scale = joint.film.free, joint.film.parameters.pressure_scale
        turning = np.full((len(joint.thickness), 1), 0.5 * joint.shaft_radius)
        velocity = np.hstack([joint.mean_velocity, turning])
        gap = np.hstack([joint.thickness, np.zeros_like(turning)])
        forces = -scale * joint.load[:, free]
        sliding, surfaces = None, joint.film.parameters.surfaces
        dragging = surfaces is not None and surfaces.dragging
        if dragging or joint.film.parameters.lubricant.shear_law is not None:
            sliding = np.hstack([joint.sliding_velocity, 2.0 * turning])
        if patterns is None:
            return cls(place, gap, velocity, forces, None, sliding)
        shapes, shares = patterns
        gap, shares = np.hstack([gap, shapes]), -scale * shares[:, free]
        return cls(place, gap, velocity, forces, shares, sliding)

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
        along_h, along_v, along_u = film.equation.gap_derivatives(point.gap, point.nodal, shift)
        inputs, velocity = along_h @ self.gap, along_v @ self.velocity
        if along_u is not None:
            velocity += along_u @ self.sliding
        inputs[:, :n] += shift * velocity[:, :n]
        inputs[:, n] += velocity[:, n]
        spread = np.zeros((inputs.shape[1], size))
        spread[np.arange(n), place.xi] = 1.0
        if place.journal_angle is not None:
            spread[n, : speed.shape[1]] += speed[place.journal_angle]
        if place.bore_angle is not None:
            spread[n, : speed.shape[1]] -= speed[place.bore_angle]
        outputs, rows = self.forces, place.xi
        if self.shares is not None:
            outputs = np.vstack([outputs, share * self.shares])
            rows = np.concatenate([rows, np.arange(patterns.start, patterns.stop)])
            spread[n + 1 :, patterns] = np.eye(patterns.stop - patterns.start)
        if film.equation.feeds is not None and film.equation.feeds.turning:
            inputs, spread = self._turning(point, inputs, spread)
        return FilmBorder(inputs[film.free] / scale, spread, outputs, rows, patterns, along_h)

    def _turning(
        self, point: FilmPoint, inputs: np.ndarray, spread: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """One more input: the angle of the journal, which carries what supplies the film."""
        place, equation = self.place, self.place.film.film.equation
        row = np.zeros((1, spread.shape[1]))
        if place.journal_angle is not None:
            row[0, place.journal_angle] = 1.0
        if place.bore_angle is not None:
            row[0, place.bore_angle] = -1.0
        along = equation.along_turn(point.gap, point.nodal)
        return np.column_stack([inputs, along]), np.vstack([spread, row])
