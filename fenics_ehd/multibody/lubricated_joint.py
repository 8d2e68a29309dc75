"""Lubricated joints: the journal of one body in the bore of another, with surfaces of any shape.

The additional coordinates of a joint are the eccentricity e of the journal in the bore's frame and,
if the journal's body tilts, the tilt psi. The constraints

    x_bore + A(theta) e - x_journal = 0,    A(theta) psi - psi_journal = 0

tie them to the bodies, and the multipliers of the constraints are the force of the film. The gap is
not computed from a difference of positions, because errors of the large motion would cause a false
squeeze velocity as large as the true one.

With the elastic displacement ``u = Psi q`` of the bore in its undeformed position, the gap to
leading order in c / R is

    h = c - n . (e + z (psi_y, -psi_x)) + n . u.

Surfaces that are not round add their deviations; `fenics_ehd.multibody.surface` has the terms of
both sides. Forces are the integrals of the same fields times the pressure, so that gap and force
are conjugate, except in holes and with the mortar (`fenics_ehd.multibody.elastic_bore`). They act
on both bodies at the centre of the journal. The torque about this centre is that of the oil's
shear, and that of the pressure on a journal that is not round: ``T = int p dh/dalpha dA`` on the
journal and -T on the bore, with the angle alpha of the journal relative to the bore.

The eccentricity in an elastic part refers to the part's mean axes, which may be several clearances
away from the deformed bore. The centre of the deformed bore is defined as that of the least-squares
circle of its surface (the LSCI of roundness measurement,
weisang.com/en/documents-articles/leastsquarescircle_en). For deviations u that are small against
the radius it is the circle ``u_0 + d . n`` with the smallest ``int (u - u_0 - d . n)^2 dA`` over
the film. For a surface without holes d is the first harmonic, ``d = 2 <u n>``. The first harmonic
of the gap ``h = c + u - n . e`` is ``n . (d - e)``, which gives the eccentricity ``e - d`` of the
journal in the circle.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fenics_ehd.base.arguments import (
    require_class,
    require_number,
    require_pair,
    require_word,
)
from fenics_ehd.base.described import Described
from fenics_ehd.base.fields import CAVITATIONS, SHEAR_RULES, TRANSFERS
from fenics_ehd.base.plane import rotation
from fenics_ehd.film.film import Film
from fenics_ehd.film.heat import Heat, require_graded
from fenics_ehd.film.kinematics import Gap, Shape, require_inside, require_shape
from fenics_ehd.film.supply import AMBIENTS
from fenics_ehd.multibody.body import ANGLE, POSITION, TILT
from fenics_ehd.multibody.joints import ADDITIONAL, SECOND, Geometry, Joint
from fenics_ehd.multibody.surface import BORE, JOURNAL, Side, Surface, observed_positions
from fenics_ehd.multibody.tabulated import Variation, variations_of

#: Unit matrix, shape (2, 2).
UNIT = np.eye(2)

#: Matrix of a rotation by a quarter turn, shape (2, 2).
QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])

#: For e and for psi: rows of their constraints, their indices in u, and the indices in u of the
#: journal's position or tilt.
TIED = (
    (slice(0, 2), slice(ADDITIONAL, ADDITIONAL + 2), slice(SECOND, SECOND + 2)),
    (
        slice(2, 4),
        slice(ADDITIONAL + 2, ADDITIONAL + 4),
        slice(SECOND + TILT, SECOND + TILT + 2),
    ),
)


#: Allowed words for arguments of a lubricated joint.
WORDS = {
    "transfer": TRANSFERS,
    "shear_rule": SHEAR_RULES,
    "cavitation": CAVITATIONS,
    "ambient": AMBIENTS,
}


@dataclass(frozen=True, eq=False)
class LubricatedJoint(Described):
    """Lubricated joint of a mechanism: its markers, film and models.

    Attributes
    ----------
    journal, bore
        Markers of journal and bore. The bore of a flexible body has the name ``bore`` by default.
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
        Ratio of film thickness to clearance below which a run ends. A ratio up to 0.01 ends a run
        only below 0.2 um (`fenics_ehd.multibody.run.touching_film`).
    bore_shape, journal_shape
        Radial deviations of both surfaces in the frames of their bodies; None for round surfaces.
    shear_rule
        Rule for shear in the cavitated zone, see `fenics_ehd.film.forces`.
    heat
        Settings of the heat balance over a cycle; None for a constant temperature of the oil.
    cavitation
        Cavitation condition, one of `CAVITATIONS`. ``"mass-conserving"``, the condition of
        Jakobsson, Floberg and Olsson (JFO), needs a bilinear mesh.
    initial_filling
        Fluid fraction of the gap at the start, 0 to 1, with mass-conserving cavitation.
    ambient
        Medium outside the sides, ``"air"`` or ``"oil"``, with mass-conserving cavitation. Oil can
        flow back into the film, air cannot. At a side with a pressure above cavitation pressure the
        medium is always oil.
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

    def described(self) -> Iterator[tuple[str, str]]:
        """Yield markers, film, oil and models of the joint."""
        yield "LubricatedJoint", f"journal {self.journal} in bore {self.bore}"
        for name, text in self.film.described():
            yield name, text
        models = [self.cavitation, f"friction on the bodies {'on' if self.friction else 'off'}"]
        models += ["heat balance"] if self.heat is not None else []
        yield "models", ", ".join(models)
        for name in ("bore_shape", "journal_shape"):
            if getattr(self, name) is not None:
                yield name, "not round"

    def _check_arguments(self) -> None:
        """Refuse arguments of a wrong class, unknown words and numbers out of range."""
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
        """Variations of supply pressures over time, see `fenics_ehd.multibody.tabulated`."""
        return tuple(
            variation
            for feed in self.film.parameters.feeds
            for variation in variations_of(feed.curve, setting=f"supply.{feed.name}")
        )


@dataclass(frozen=True)
class Eccentric(Joint):
    """Constraints that tie eccentricity and tilt of a lubricated joint to its bodies.

    Attributes
    ----------
    first, second
        Markers of bore and journal.
    additional
        Number of additional coordinates: 2 for the eccentricity, and 2 for the tilt if the journal
        tilts.
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
        """Constraint function: eccentricity and tilt of the joint less those of its bodies.

        See `Joint.geometry`.
        """
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
    """Linear maps between a joint's film and its n coordinates ``xi = (e, psi, q)``.

    They are the eccentricity e, the tilt psi, and the elastic coordinates q of surfaces at rest in
    the bore's frame. The effect of a turning surface is not linear in its coordinates, see
    `Surface.turning_rows`.

    Parameters
    ----------
    joint
        Lubricated joint.
    bore, journal
        Functions that make the two surfaces (`Body.surface`).
    tilting
        Whether the axis of the journal tilts.

    Attributes
    ----------
    film
        Film of the joint; if the heat of the joint is balanced, a copy of the film with a
        temperature of its own.
    surfaces
        Surfaces of bore and journal.
    turning
        Surface that turns through the film; None if no surface turns.
    plain
        Whether both surfaces are round.
    elastic
        Whether a surface deforms.
    shaft_radius
        Radius of the journal [m].
    friction, shear_rule
        Settings of the joint, see `LubricatedJoint`.
    journal_coordinates
        Number of coordinates of the journal in the bore: 2 for e, and 2 for psi if it tilts.
    thickness
        Change of the gap at the g Gauss points for unit coordinates, shape (g, n).
    mean_velocity, sliding_velocity
        Change of mean and sliding velocity at the g Gauss points for unit rates of the coordinates,
        shape (g, n) each.
    observed
        Change of the gap at the w Gauss points and nodes for unit coordinates, shape (w, n).
    deviation
        Constant change of the gap at the w Gauss points and nodes due to the shapes of surfaces,
        shape (w,) [m].
    load
        Generalised forces on the coordinates xi for unit nodal pressures, shape (n, nodes).
    """

    def __init__(
        self,
        joint: LubricatedJoint,
        bore: SurfaceOf = Surface,
        journal: SurfaceOf = Surface,
        *,
        tilting: bool = False,
    ):
        # Joints may have the same film, but not the same temperature.
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
        """Number n of the joint's coordinates ``xi = (e, psi, q)``."""
        return self.thickness.shape[1]

    @property
    def clearance(self) -> float:
        """Radial clearance of the film [m]."""
        return self.film.parameters.clearance

    @cached_property
    def circle(self) -> np.ndarray:
        """Matrix, shape (2, k), from the gap at the film's k nodes to the journal's eccentricity.

        The eccentricity, x and y in the frame of the bore, is the distance between the centres of
        the least-squares circles of both surfaces.
        """
        angle, _ = self.film.parameters.grid.node_positions.T
        waves = np.stack([np.ones_like(angle), -np.cos(angle), -np.sin(angle)])
        # The weight of a node is the integral of its shape function over the bore.
        weighted = waves * np.ravel(self.film.pressure_areas.sum(axis=0))
        # Corners of 8-node cells have negative weights, but the weight of every cell is positive.
        return np.linalg.solve(weighted @ waves.T, weighted)[1:]

    def lengths(self, thickness: np.ndarray) -> np.ndarray:
        """Lengths by which changes of the gaps `thickness` are divided to make them relative [m].

        The lengths are the gaps; for rough surfaces, those of `RoughSurfaces.length`.
        """
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
        """Gap and surface velocities at the Gauss points, without effects of residual patterns.

        Parameters
        ----------
        xi, xi_rate
            Coordinates of the joint and their rates, shape (n,).
        shaft_rate, relative_angle
            Angular speed [rad/s] and angle [rad] of the journal relative to the bore. The angle has
            an effect only if the journal is not round or has supplies.
        time
            Time [s], on which supply pressures may depend.
        modes
            Elastic coordinates of the turning surface and their rates; empty if none turns.
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
    """Outward and tangential displacement of the journal at points of a bore.

    The displacements are those for unit eccentricities and tilts ``e_x, e_y, psi_x, psi_y``. Both
    arrays have the shape (points, count); `count` is 4, or 2 for a journal that does not tilt.
    """
    cosine = np.cos(angle)
    sine = np.sin(angle)
    outward = np.stack([cosine, sine, -height * sine, height * cosine], axis=-1)
    around = np.stack([-sine, cosine, -height * cosine, -height * sine], axis=-1)
    return outward[:, :count], around[:, :count]
