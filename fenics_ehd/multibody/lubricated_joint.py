"""A lubricated joint: the journal of one body in the bore of another.

Its own coordinates are the eccentricity e of the journal in the bore's frame and, where the
journal's body offers it, the tilt psi. Constraints tie them to the bodies,

    x_bore + A(theta) e - x_journal = 0,    A(theta) psi - psi_journal = 0,

and their multipliers are the film's force. Positions are never subtracted to get the gap: the
error of the large motion would be a false squeeze velocity as large as the true one.

With the bore's elastic displacement ``u = Psi q`` at its undeformed place, to leading order in
c / R,

    h = c - n . (e + z (psi_y, -psi_x)) + n . u,

and what `joint_shape` adds where bore or journal are not round.

Forces are the integrals of the same fields times the pressure: gap and force are conjugate. They
act at the journal's centre on both bodies; the torque about it is that of the oil's shear, and of
the pressure on a journal that is not round.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.plane import rotation
from fenics_ehd.film import Film
from fenics_ehd.film.heat import Heat
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.film.oil_balance import require_monotone
from fenics_ehd.film.shape import Shape
from fenics_ehd.multibody.bore_film import BoreFilm
from fenics_ehd.multibody.joint_shape import JointShape
from fenics_ehd.multibody.joints import Pair
from fenics_ehd.multibody.marker import ANGLE, POSITION, TILT
from fenics_ehd.multibody.relation import Geometry
from fenics_ehd.reduction.body import ReducedBody

#: Unit matrix of the plane, and a quarter turn.
UNIT, QUARTER = np.eye(2), np.array([[0.0, -1.0], [1.0, 0.0]])


@dataclass(frozen=True)
class ConservedContent:
    """Oil that a film keeps account of (mass-conserving cavitation).

    Attributes
    ----------
    filling
        Fluid fraction of the gap at the start, 0 to 1.
    oil_outside
        Whether there is oil outside the sides, which flows back in where the film sucks; beside
        sides above cavitation pressure there always is.
    """

    filling: float = 1.0
    oil_outside: bool = False

    def __post_init__(self) -> None:
        if not 0.0 <= self.filling <= 1.0:
            raise SettingsError(f"initial_filling = {self.filling:g} must lie in 0..1")


@dataclass(frozen=True, eq=False)
class LubricatedJoint:
    """What the joint is made of.

    Attributes
    ----------
    journal, bore
        Markers; the point of a flexible body's own bore is ``bore``.
    film
        Film on the bore.
    transfer
        How pressures reach a bore whose mesh the film's does not match, see `BoreFilm`.
    friction
        Whether the oil's shear acts on the bodies.
    eccentricity, eccentricity_rate
        At the start, in the bore's frame [m], [m/s].
    smallest_film
        Film thickness at which a run ends, share of the clearance.
    bore_shape, journal_shape
        Radial deviations in the frames of the two bodies; None: round.
    shear_rule
        For the cavitated zone, see `fenics_ehd.film.shear`.
    heat
        Balance of the film's heat over a cycle; None: the oil keeps its temperature.
    oil
        How the film keeps account of its oil, on a bilinear mesh; None: Reynolds' condition.
    """

    journal: str
    bore: str
    film: Film
    transfer: str = "conservative"
    friction: bool = False
    eccentricity: tuple[float, float] = (0.0, 0.0)
    eccentricity_rate: tuple[float, float] = (0.0, 0.0)
    smallest_film: float = 0.01
    bore_shape: Shape | None = None
    journal_shape: Shape | None = None
    shear_rule: str = "streamers"
    heat: Heat | None = None
    oil: ConservedContent | None = None

    def __post_init__(self) -> None:
        if self.heat is not None and self.film.parameters.lubricant.oil is None:
            raise SettingsError(
                f"heat of {self.journal} in {self.bore}: the lubricant's viscosity does not depend "
                "on its temperature: give it a grade, or viscosity_40 and viscosity_100"
            )
        share = np.hypot(*self.eccentricity) / self.film.parameters.clearance
        if not share < 1.0:
            raise SettingsError(
                f"eccentricity = {self.eccentricity} m of {self.journal} in {self.bore} is "
                f"{share:.3g} of the clearance: it must be below 1"
            )
        if self.oil is not None:
            require_monotone(self.film.parameters.grid.family)

    @property
    def markers(self) -> tuple[str, ...]:
        """See `Joint`."""
        return self.bore, self.journal


@dataclass(frozen=True)
class Eccentric(Pair):
    """The joint's constraints, a `Joint`.

    Attributes
    ----------
    first, second
        Markers of bore and journal.
    tilting
        Whether the journal tilts.
    """

    tilting: bool

    @property
    def own(self) -> int:
        """See `Joint`."""
        return 4 if self.tilting else 2

    @property
    def rows(self) -> int:
        """See `Joint`."""
        return self.own

    def geometry(self, u: np.ndarray, sizes: tuple[int, ...]) -> Geometry:
        """See `Joint`."""
        turn = rotation(u[ANGLE])
        turned = QUARTER @ turn
        pairs = _pairs(self.tilting, sizes)
        value, jacobian = np.empty(self.rows), np.zeros((self.rows, len(u)))
        for rows, own, tied in pairs:
            value[rows] = turn @ u[own] - u[tied]
            jacobian[rows, own], jacobian[rows, tied] = turn, -UNIT
            jacobian[rows, ANGLE] = turned @ u[own]
        value[POSITION] += u[POSITION]
        jacobian[POSITION, POSITION] = UNIT

        def curvature() -> np.ndarray:
            result = np.zeros((self.rows, len(u), len(u)))
            for rows, own, _ in pairs:
                result[rows, ANGLE, ANGLE] = -turn @ u[own]
                result[rows, ANGLE, own] = result[rows, own, ANGLE] = turned
            return result

        return Geometry(value, jacobian, curvature)


@cache
def _pairs(tilting: bool, sizes: tuple[int, ...]) -> list[tuple[slice, slice, slice]]:
    """Rows of e and psi, and where they and what they are tied to are in u."""
    own, other = sum(sizes), sizes[0]
    return [
        (
            slice(row, row + 2),
            slice(own + row, own + row + 2),
            slice(other + place.start, other + place.stop),
        )
        for row, place in zip((0, 2), (POSITION, TILT) if tilting else (POSITION,), strict=False)
    ]


class JointFilm:
    """Linear maps between a joint's film and ``xi = (e, psi, q)``: n coordinates.

    Parameters
    ----------
    joint
        With its film.
    part
        The reduced body whose bore it is, None for a rigid bore.
    tilting
        Whether the journal tilts.

    Attributes
    ----------
    film
        See `LubricatedJoint`.
    thickness, mean_velocity, sliding_velocity
        Change of the gap and, per rate, of the two velocities of `Gap` for unit coordinates, at
        the g Gauss points, shape (g, n).
    observed
        Change of the gap at Gauss points and nodes, shape (w, n).
    load
        Generalised forces of nodal pressures on xi, shape (n, nodes).
    bore
        The flexible bore, None for a rigid one.
    shape
        Of bore and journal, None where both are round.
    """

    def __init__(self, joint: LubricatedJoint, part: ReducedBody | None, tilting: bool):
        # Joints may share a film, not its temperature.
        film = self.film = joint.film if joint.heat is None else joint.film.apart()
        p = film.parameters
        self.clearance, self.shaft_radius = p.clearance, p.grid.radius - p.clearance
        self.friction, self.own = joint.friction, 4 if tilting else 2
        self.shear_rule = joint.shear_rule
        shapes = joint.bore_shape, joint.journal_shape
        self.shape = None if shapes == (None, None) else JointShape(film, *shapes)
        self.bore = None if part is None else BoreFilm(part, film, joint.transfer)
        inside = film.points.angle.ravel(), film.points.height.ravel()
        nodes = p.grid.node_positions
        outward, around = _journal_fields(*inside, self.own)
        thickness, mean, sliding = [-outward], [0.5 * around], [around]
        observed = np.vstack([outward, _journal_fields(nodes[:, 0], nodes[:, 1], self.own)[0]])
        gap, shape = [-observed], (*film.points.angle.shape, -1)
        load = [-film.load(outward.reshape(shape))]
        if self.bore is not None:
            elastic, tangential = self.bore.outward, self.bore.tangential
            carried = _mean_translation(film, elastic, tangential)
            thickness.append(elastic)
            # As seen from the bore's mean place, which carries the frame of the film.
            mean.append(0.5 * tangential - carried)
            sliding.append(-tangential)
            gap.append(self.bore.observed)
            load[0][:2] = -self.bore.force
            load.append(self.bore.load)
        self.thickness, self.mean_velocity, self.sliding_velocity, self.observed = (
            np.ascontiguousarray(np.hstack(parts)) for parts in (thickness, mean, sliding, gap)
        )
        self.load = np.vstack(load)

    @property
    def size(self) -> int:
        """Number n of coordinates."""
        return self.thickness.shape[1]

    def lengths(self, thickness: np.ndarray) -> np.ndarray:
        """What changes of gaps are compared with [m]: the gaps, if surfaces are smooth."""
        surfaces = self.film.parameters.surfaces
        return thickness if surfaces is None else surfaces.length(thickness)

    def gap(
        self, xi: np.ndarray, xi_rate: np.ndarray, shaft_rate: float, ahead: float = 0.0
    ) -> Gap:
        """Gap and velocities at the Gauss points, residual patterns left out.

        Parameters
        ----------
        xi, xi_rate
            shape (n,).
        shaft_rate, ahead
            Speed of the journal relative to the bore [rad/s] and its angle, which matters where
            the journal is not round [rad].
        """
        speed = self.shaft_radius * shaft_rate
        shape = self.film.points.angle.shape
        gap = Gap(
            (self.clearance + self.thickness @ xi).reshape(shape),
            (self.thickness @ xi_rate).reshape(shape),
            (0.5 * speed + self.mean_velocity @ xi_rate).reshape(shape),
            (speed + self.sliding_velocity @ xi_rate).reshape(shape),
        )
        return gap if self.shape is None else self.shape.added(gap, ahead, shaft_rate)


def _journal_fields(
    angle: np.ndarray, height: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Components of the journal's motion for ``e_x, e_y, psi_x, psi_y``, outward and around."""
    cosine, sine = np.cos(angle), np.sin(angle)
    outward = np.stack([cosine, sine, -height * sine, height * cosine], axis=-1)
    around = np.stack([-sine, cosine, -height * cosine, -height * sine], axis=-1)
    return outward[:, :count], around[:, :count]


def _mean_translation(film: Film, outward: np.ndarray, tangential: np.ndarray) -> np.ndarray:
    """Tangential component of every field's mean over the bore, at the Gauss points."""
    cosine, sine = (x.ravel()[:, None] for x in film.points.normal)
    area = film.assembly.area.ravel() / film.assembly.area.sum()
    x = area @ (cosine * outward - sine * tangential)
    y = area @ (sine * outward + cosine * tangential)
    return cosine * y - sine * x
