"""Shapes of bore and journal at the points of one joint's film, see `fenics_ehd.film.shape`.

Pressure on a journal that is not round has a torque about its centre. With the gap's derivative
along the angle alpha of the journal ahead of the bore, ``dh/dalpha = d delta/dphi (phi - alpha)``,

    T = int p dh/dalpha dA    on the journal, -T on the bore:

gap and force are conjugate here too, and the film takes the work from the bodies that it does on
the oil.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fenics_ehd.film import Film
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.film.shape import Shape


@dataclass(frozen=True, eq=False)
class Turned:
    """A turning journal's shape at one angle ahead of its bore, at the g Gauss points.

    Attributes
    ----------
    slope, rate_slope
        Derivatives along that angle of the gap [m/rad] and of its rate [m/s/rad], shape (g,).
    torque, stiffness
        Torque on the journal of unit nodal pressures [N m/Pa] and its derivative along the angle,
        shape (nodes,).
    curve
        Second derivative of the gap along the angle, shape (g,) [m/rad2].
    """

    slope: np.ndarray
    rate_slope: np.ndarray
    torque: np.ndarray
    stiffness: np.ndarray
    curve: np.ndarray


class JointShape:
    """What the shapes of bore and journal add to the gap of a film.

    Parameters
    ----------
    film
        On the bore.
    bore, journal
        Their shapes; None: round.

    Attributes
    ----------
    fixed
        Change of the gap at Gauss points and nodes that does not turn, shape (w,) [m].
    turning
        Whether the journal's shape does.
    bend
        Bound of the shapes' second derivative along the angle [m].
    """

    def __init__(self, film: Film, bore: Shape | None, journal: Shape | None):
        nodes = film.parameters.grid.node_positions
        self._film, self._inside = film, film.points.angle.size
        self._angle = np.concatenate([film.points.angle.ravel(), nodes[:, 0]])
        self._height = np.concatenate([film.points.height.ravel(), nodes[:, 1]])
        self.fixed = np.zeros(len(self._angle))
        if bore is not None:
            self.fixed += bore.radial(self._angle, self._height)
        self._journal = journal
        self.turning = journal is not None and not journal.round
        if journal is not None and journal.round:
            self.fixed -= journal.radial(self._angle, self._height)
        self.bend = sum(
            float(np.abs(shape.radial(self._angle, self._height, 2)).max())
            for shape in (bore, journal)
            if shape is not None
        )

    def _turned(self, ahead: float, order: int = 0) -> np.ndarray:
        """Of the journal at the Gauss points."""
        assert self._journal is not None
        angle, height = self._angle[: self._inside], self._height[: self._inside]
        return self._journal.radial(angle - ahead, height, order)

    def closing(self, ahead: float) -> np.ndarray:
        """What the turning shape takes from the gap at Gauss points and nodes, shape (w,) [m]."""
        assert self._journal is not None
        return self._journal.radial(self._angle - ahead, self._height)

    def added(self, gap: Gap, ahead: float, speed: float) -> Gap:
        """A round joint's gap with the shapes, the journal at an angle [rad] and speed [rad/s]."""
        grid = gap.thickness.shape
        thickness = gap.thickness + self.fixed[: self._inside].reshape(grid)
        if not self.turning:
            return replace(gap, thickness=thickness)
        return replace(
            gap,
            thickness=thickness - self._turned(ahead).reshape(grid),
            thickness_rate=gap.thickness_rate + speed * self._turned(ahead, 1).reshape(grid),
        )

    def turned(self, ahead: float, speed: float) -> Turned | None:
        """Derivatives there; None of a journal whose turning changes nothing."""
        if not self.turning:
            return None
        slope, curve = self._turned(ahead, 1), self._turned(ahead, 2)
        fields = np.stack([slope, -curve], axis=-1)
        torque, stiffness = self._film.load(fields.reshape(*self._film.points.angle.shape, 2))
        return Turned(slope, -speed * curve, torque, stiffness, -curve)
