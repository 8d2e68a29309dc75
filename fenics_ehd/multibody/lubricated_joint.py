"""Lubricated joints: the journal of one body in the bore of another, both of any shape.

The additional coordinates of a joint are the eccentricity e of the journal in the bore's frame and,
if the journal's body tilts, the tilt psi. Constraints tie them to the bodies,

    x_bore + A(theta) e - x_journal = 0,    A(theta) psi - psi_journal = 0,

and the multipliers of these are the film's force. The gap is not computed from a difference of
positions: the error of the large motion would be a false squeeze velocity, as large as the true
one.

With the bore's elastic displacement ``u = Psi q`` at its undeformed place, to leading order in
c / R,

    h = c - n . (e + z (psi_y, -psi_x)) + n . u,

and surfaces that are not round add their deviations (`fenics_ehd.multibody.surface`, which has
the terms of either side). Forces are the integrals of the same fields times the pressure: gap and
force are conjugate, except in holes and with the mortar (`fenics_ehd.multibody.elastic_bore`). They
act on both bodies at the journal's centre. The torque about the centre is that of the oil's shear,
and of the pressure on a journal that is not round: ``T = int p dh/dalpha dA`` on the journal, -T on
the bore, alpha the angle of the journal relative to the bore.

The eccentricity of an elastic part refers to the part's mean axes, which may be several clearances
away from the deformed bore. The centre of the deformed bore is that of the least-squares circle of
its surface (the LSCI of roundness measurement,
weisang.com/en/documents-articles/leastsquarescircle_en). For deviations u that are small against
the radius it is the circle ``u_0 + d . n`` with the least ``int (u - u_0 - d . n)^2 dA`` over the
film. Without gaps in the surface d is the first harmonic, ``d = 2 <u n>``. The first harmonic of
the gap ``h = c + u - n . e`` is ``n . (d - e)``: minus the eccentricity ``e - d`` of the journal in
the circle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fenics_ehd.base.arguments import (
    require_class,
    require_number,
    require_pair,
    require_word,
)
from fenics_ehd.base.fields import CAVITATIONS, SHEAR_RULES, TRANSFERS
from fenics_ehd.base.plane import rotation
from fenics_ehd.film.film import Film
from fenics_ehd.film.heat import Heat, require_graded
from fenics_ehd.film.kinematics import Gap, Shape, require_inside, require_shape
from fenics_ehd.film.supply import AMBIENTS
from fenics_ehd.multibody.body import ANGLE, POSITION, TILT
from fenics_ehd.multibody.elastic_bore import BoreFilm, ElasticBore
from fenics_ehd.multibody.joints import ADDITIONAL, SECOND, Geometry, Joint
from fenics_ehd.multibody.surface import BORE, JOURNAL, Side, Surface, observed_positions
from fenics_ehd.multibody.tabulated import Variation, variations_of

#: Unit matrix of the plane.
UNIT = np.eye(2)

#: Rotation by a quarter turn.
QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])

#: Rows of e and of psi, their indices in u, and the indices of the journal's position and tilt,
#: which they are tied to.
TIED = (
    (slice(0, 2), slice(ADDITIONAL, ADDITIONAL + 2), slice(SECOND, SECOND + 2)),
    (
        slice(2, 4),
        slice(ADDITIONAL + 2, ADDITIONAL + 4),
        slice(SECOND + TILT, SECOND + TILT + 2),
    ),
)


#: Allowed words of a lubricated joint, by argument.
WORDS = {
    "transfer": TRANSFERS,
    "shear_rule": SHEAR_RULES,
    "cavitation": CAVITATIONS,
    "ambient": AMBIENTS,
}


@dataclass(frozen=True, eq=False)
class LubricatedJoint:
    """Lubricated joint of a mechanism: its markers, film and models.

    Attributes
    ----------
    journal, bore
        Markers of journal and bore; a flexible body without a named bore has the point ``bore``.
    film
        Film on the bore.
    transfer
        Transfer of pressures to a bore whose mesh does not match that of the film, see
        `fenics_ehd.multibody.elastic_bore.BoreFilm`.
    friction
        Whether the oil's shear acts on the bodies.
    eccentricity, eccentricity_rate
        Eccentricity of the journal in the bore's frame and its rate, at the start [m], [m/s].
    smallest_film
        Film thickness over clearance at which a run ends. For a value up to 0.01 the limit is at
        most 0.2 um (`fenics_ehd.multibody.run.touching_film`).
    bore_shape, journal_shape
        Radial deviations in the frames of the two bodies; None: round.
    shear_rule
        Rule for shear in the cavitated zone, see `fenics_ehd.film.forces`.
    heat
        Balance of the film's heat over a cycle; None: the temperature of the oil is constant.
    cavitation
        Cavitation condition, one of `CAVITATIONS`. ``"mass-conserving"``, the condition of
        Jakobsson, Floberg and Olsson (JFO), needs a bilinear mesh.
    initial_filling
        Fluid fraction of the gap at the start, 0 to 1, with mass-conserving cavitation.
    ambient
        Medium outside the sides, ``"air"`` or ``"oil"``; oil flows back in at a side with suction.
        Outside a side above cavitation pressure the medium is always oil.
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
    cavitation: str = "reynolds"
    initial_filling: float = 1.0
    ambient: str = "air"

    def __post_init__(self) -> None:
        self._check_arguments()
        parameters = self.film.parameters
        if self.heat is not None:
            require_graded(parameters.lubricant.oil is not None)
        x, y = self.eccentricity
        share = x / parameters.clearance, y / parameters.clearance
        require_inside(share, rough=parameters.surfaces is not None)

    def _check_arguments(self) -> None:
        """Refuse words, numbers and classes of single arguments."""
        for name in ("journal", "bore"):
            require_class(name, getattr(self, name), str)
        require_class("film", self.film, Film)
        for name, words in WORDS.items():
            require_word(name, getattr(self, name), words)
        require_class("friction", self.friction, bool)
        for name in ("eccentricity", "eccentricity_rate"):
            require_pair(name, getattr(self, name))
        require_number("smallest_film", self.smallest_film, least=0, below=1)
        require_number("initial_filling", self.initial_filling, least=0, most=1)
        for name in ("bore_shape", "journal_shape"):
            require_shape(name, getattr(self, name))
        require_class("heat", self.heat, Heat, optional=True)

    @property
    def markers(self) -> tuple[str, ...]:
        """Markers of bore and journal."""
        return self.bore, self.journal

    @property
    def variations(self) -> tuple[Variation, ...]:
        """Variations of the supplies' pressures, see `fenics_ehd.multibody.tabulated`."""
        return tuple(
            variation
            for feed in self.film.parameters.feeds
            for variation in variations_of(feed.curve, setting=f"supply.{feed.name}")
        )


@dataclass(frozen=True)
class Eccentric(Joint):
    """Constraints of a lubricated joint.

    Attributes
    ----------
    first, second
        Markers of bore and journal.
    additional
        Number of additional coordinates: 2 of the eccentricity and 2 of the tilt, if any.
    """

    first: str
    second: str
    additional: int

    @property
    def markers(self) -> tuple[str, ...]:
        """Markers of bore and journal."""
        return self.first, self.second

    @property
    def rows(self) -> int:  # type: ignore[override]
        """Number of constraints, one for each additional coordinate."""
        return self.additional

    def geometry(self, u: np.ndarray) -> Geometry:
        """Difference of eccentricity and tilt from those of the bodies, see `Joint`."""
        turn = rotation(u[ANGLE])
        turn_derivative = QUARTER @ turn
        pairs = TIED[: self.additional // 2]
        value = np.empty(self.rows)
        jacobian = np.zeros((self.rows, len(u)))
        for rows, coordinates, tied in pairs:
            value[rows] = turn @ u[coordinates] - u[tied]
            jacobian[rows, coordinates] = turn
            jacobian[rows, tied] = -UNIT
            jacobian[rows, ANGLE] = turn_derivative @ u[coordinates]
        value[POSITION] += u[POSITION]
        jacobian[POSITION, POSITION] = UNIT

        def curvature() -> np.ndarray:
            result = np.zeros((self.rows, len(u), len(u)))
            for rows, coordinates, _ in pairs:
                result[rows, ANGLE, ANGLE] = -turn @ u[coordinates]
                result[rows, ANGLE, coordinates] = turn_derivative
                result[rows, coordinates, ANGLE] = turn_derivative
            return result

        return Geometry(value, jacobian, curvature)


#: Function that makes the surface of a body at one of its points, for a side of a film.
SurfaceOf = Callable[[Side], Surface]


class JointFilm:
    """Linear maps between a joint's film and ``xi = (e, psi, q)``: n coordinates.

    The elastic coordinates q are those of surfaces at rest in the bore's frame. What a turning
    surface adds is not linear in its coordinates, see `Surface.turning_rows`.

    Parameters
    ----------
    joint
        Lubricated joint.
    bore, journal
        Functions that make the two surfaces (`Body.surface`).
    tilting
        Whether the journal tilts.

    Attributes
    ----------
    film
        Film of the joint, with a temperature of the joint's own if its heat is balanced.
    surfaces
        Surfaces of bore and journal.
    turning
        The surface that turns through the film; None: none.
    plain
        Whether both surfaces are round.
    elastic
        Whether a surface deforms.
    shaft_radius
        Radius of the journal [m].
    friction, shear_rule
        See `LubricatedJoint`.
    journal_coordinates
        Number of coordinates of the journal in the bore: 2 of e, and 2 of psi if it tilts.
    thickness, mean_velocity, sliding_velocity
        Change of the gap and, per rate, of the two velocities of `Gap` for unit coordinates, at
        the g Gauss points, shape (g, n).
    observed
        Change of the gap at Gauss points and nodes, shape (w, n).
    deviation
        Constant change of the gap at Gauss points and nodes, shape (w,) [m].
    load
        Generalised forces of nodal pressures on xi, shape (n, nodes).
    """

    def __init__(
        self,
        joint: LubricatedJoint,
        bore: SurfaceOf = Surface,
        journal: SurfaceOf = Surface,
        *,
        tilting: bool = False,
    ):
        # Joints may share a film, but not the temperature of the film.
        film = self.film = joint.film if joint.heat is None else joint.film.with_own_temperature()
        self.shaft_radius = film.parameters.grid.radius - self.clearance
        self.friction = joint.friction
        self.journal_coordinates = 4 if tilting else 2
        self.shear_rule = joint.shear_rule
        self.surfaces = (
            bore(Side(film, BORE, joint.bore_shape, joint.transfer)),
            journal(Side(film, JOURNAL, joint.journal_shape)),
        )
        self.turning = next((surface for surface in self.surfaces if surface.turning), None)
        round_sides = all(surface.side.shape is None for surface in self.surfaces)
        self.elastic = any(surface.elastic for surface in self.surfaces)
        self.plain = round_sides and self.turning is None
        self.deviation = self.surfaces[0].deviation + self.surfaces[1].deviation
        inside = film.points.angle.size
        positions = observed_positions(film)
        outward, around = _journal_fields(*positions, self.journal_coordinates)
        around = around[:inside]
        gap = [-outward]
        mean = [0.5 * around]
        sliding = [around]
        load = [-film.load(outward[:inside].reshape((*film.points.angle.shape, -1)))]
        for surface in self.surfaces:
            rows = surface.rows
            if rows is None:
                continue
            mean.append(rows.mean_velocity)
            sliding.append(rows.sliding_velocity)
            gap.append(rows.gap)
            load.append(rows.load)
            if rows.resultant is not None:
                load[0][:2] = -rows.resultant
        self.mean_velocity, self.sliding_velocity, self.observed = (
            np.ascontiguousarray(np.hstack(parts)) for parts in (mean, sliding, gap)
        )
        self.thickness = self.observed[:inside]
        self.load = np.vstack(load)

    @property
    def size(self) -> int:
        """Number n of coordinates."""
        return self.thickness.shape[1]

    @property
    def bore(self) -> BoreFilm | None:
        """Maps of an elastic bore; None: the bore is rigid."""
        bore = self.surfaces[0]
        return bore.maps if isinstance(bore, ElasticBore) else None

    @property
    def clearance(self) -> float:
        """Radial clearance, that of the film's parameters [m]."""
        return self.film.parameters.clearance

    @cached_property
    def circle(self) -> np.ndarray:
        """Rows whose product with a gap at the film's nodes is the journal's eccentricity.

        It is the distance of the centres of the least-squares circles of both surfaces.

        Returns
        -------
        numpy.ndarray
            Rows of x and y in the frame of the bore, shape (2, k).
        """
        angle, _ = self.film.parameters.grid.node_positions.T
        waves = np.stack([np.ones_like(angle), -np.cos(angle), -np.sin(angle)])
        # Weights of the nodes are the integrals of their shape functions over the bore.
        weighted = waves * np.ravel(self.film.pressure_areas.sum(axis=0))
        # Weights of the corners of 8-node cells are negative, but not the sums over the cells.
        return np.linalg.solve(weighted @ waves.T, weighted)[1:]

    def lengths(self, thickness: np.ndarray) -> np.ndarray:
        """Lengths that changes of gaps are compared with [m]; the gaps between smooth surfaces."""
        surfaces = self.film.parameters.surfaces
        return thickness if surfaces is None else surfaces.length(thickness)

    def gap(
        self,
        xi: np.ndarray,
        xi_rate: np.ndarray,
        shaft_rate: float,
        relative_angle: float = 0.0,
        time: float = 0.0,
        modes: tuple[np.ndarray, np.ndarray] = (np.zeros(0), np.zeros(0)),
    ) -> Gap:
        """Gap and velocities at the Gauss points, without residual patterns.

        Parameters
        ----------
        xi, xi_rate
            Coordinates of the joint and their rates, shape (n,).
        shaft_rate, relative_angle
            Angular speed [rad/s] and angle [rad] of the journal relative to the bore. The angle
            has an influence if the journal is not round or has supplies.
        time
            Time, which pressures of supplies may depend on [s].
        modes
            Elastic coordinates of the turning surface, if any, and their rates.
        """
        speed = self.shaft_radius * shaft_rate
        shape = self.film.points.angle.shape
        gap = Gap(
            (self.clearance + self.thickness @ xi).reshape(shape),
            (self.thickness @ xi_rate).reshape(shape),
            (0.5 * speed + self.mean_velocity @ xi_rate).reshape(shape),
            (speed + self.sliding_velocity @ xi_rate).reshape(shape),
            relative_angle,
            time,
        )
        if self.plain:
            return gap
        change = self.deviation[: shape[0] * shape[1]]
        rate = np.zeros(change.size)
        if self.turning is not None:
            coordinates, rates = (
                np.append(values, last)
                for values, last in zip(modes, (relative_angle, shaft_rate), strict=True)
            )
            turned, rate = self.turning.turning_gap(coordinates, rates)
            change = change + turned
        return gap.changed(change, rate)


def _journal_fields(
    angle: np.ndarray, height: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Outward and tangential motion of the journal for unit ``e_x, e_y, psi_x, psi_y``."""
    cosine = np.cos(angle)
    sine = np.sin(angle)
    outward = np.stack([cosine, sine, -height * sine, height * cosine], axis=-1)
    around = np.stack([-sine, cosine, -height * cosine, -height * sine], axis=-1)
    return outward[:, :count], around[:, :count]
