"""Lubricated joints: the journal of one body in the bore of another, both of any shape.

A joint's own coordinates are the eccentricity e of the journal in the bore's frame and, where the
journal's body tilts, the tilt psi. Constraints tie them to the bodies,

    x_bore + A(theta) e - x_journal = 0,    A(theta) psi - psi_journal = 0,

and their multipliers are the film's force. Positions are never subtracted to get the gap: the
error of the large motion would be a false squeeze velocity as large as the true one.

With the bore's elastic displacement ``u = Psi q`` at its undeformed place, to leading order in
c / R,

    h = c - n . (e + z (psi_y, -psi_x)) + n . u,

and what shapes add where bore or journal are not round (`JointShape`). Forces are the integrals of
the same fields times the pressure: gap and force are conjugate, but in holes and with the mortar,
see below. They act at the journal's centre on
both bodies; the torque about it is that of the oil's shear, and of the pressure on a journal that
is not round: with the gap's derivative along the angle alpha of the journal ahead of the bore,
``dh/dalpha = d delta/dphi (phi - alpha)``,

    T = int p dh/dalpha dA    on the journal, -T on the bore.

Where the meshes of a body's bore and of its film match, shape functions of the bore are evaluated
at the film's Gauss points and nothing else is needed. Where they do not, pressures go to the bore
either conservatively, ``F = int N_s n p``, with resultants that are the film's own, or by the
paper's mortar (14) and the body's load matrix. A bore may have holes. The gap in one follows the
bore as extended from the rim (`fenics_ehd.film.transfer`). The film's pressure there bends nothing:
elastic modes are loaded on the remaining surface alone, as in the body's own matrix. It is part of
the force between journal and body, for the oil in the hole presses on the far end of its passage.

The mean axes of an elastic part, to which its own eccentricity refers, may be clearances away from
its bore as it is, deformed and with its deviations. The centre of that is the one of the
least-squares circle of its surface (the LSCI of roundness measurement,
weisang.com/en/documents-articles/leastsquarescircle_en): for deviations u that are small against
the radius, as those of a film's bore are, the circle ``u_0 + d . n`` with the least
``int (u - u_0 - d . n)^2 dA`` over the film. Without gaps in the surface d is the first harmonic,
``d = 2 <u n>``. The gap ``h = c + u - n . e`` knows it: its first harmonic is ``n . (d - e)``,
less the eccentricity ``e - d`` of the journal in the circle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fenics_ehd.base.arguments import (
    require_class,
    require_number,
    require_pair,
    require_word,
)
from fenics_ehd.base.errors import InterfaceMismatchError
from fenics_ehd.base.fields import CAVITATIONS, SHEAR_RULES, TRANSFERS
from fenics_ehd.base.plane import rotation
from fenics_ehd.film.film import Film
from fenics_ehd.film.grid import FilmGrid, film_grid, film_layout, match, uniform_grid
from fenics_ehd.film.heat import Heat, require_graded
from fenics_ehd.film.kinematics import Gap, Shape, require_inside, require_shape
from fenics_ehd.film.supply import AMBIENTS
from fenics_ehd.film.transfer import Mortar, Surface, outward_displacement, solid_share
from fenics_ehd.multibody.body import ANGLE, POSITION, TILT
from fenics_ehd.multibody.joints import OWN, SECOND, Geometry, Joint
from fenics_ehd.multibody.tabulated import Variation, variations_of
from fenics_ehd.reduction.body import TRANSLATIONS, ReducedBody
from fenics_ehd.reduction.bore import SAMPLED, BoreSurface, turned


@dataclass(frozen=True, eq=False)
class RotatedShape:
    """A turning journal's shape at one angle ahead of its bore, at the g Gauss points.

    Attributes
    ----------
    slope, rate_slope
        Derivatives along that angle of the gap [m/rad] and of its rate [m/s/rad], shape (g,).
    torque, stiffness
        Torque on the journal of unit nodal pressures [N m/Pa] and its derivative along the angle,
        shape (nodes,).
    second_derivative
        Second derivative of the gap along the angle, shape (g,) [m/rad2].
    """

    slope: np.ndarray
    rate_slope: np.ndarray
    torque: np.ndarray
    stiffness: np.ndarray
    second_derivative: np.ndarray


class JointShape:
    """Addition of the shapes of bore and journal to the gap of a film.

    Parameters
    ----------
    film
        On the bore.
    bore, journal
        Their shapes; None: round.

    Attributes
    ----------
    plain
        Whether both are round and nothing is added.
    fixed
        Change of the gap at Gauss points and nodes that does not turn, shape (w,) [m].
    turning
        Whether the journal's shape does.
    largest_second_derivative
        Bound of the shapes' second derivative along the angle [m].
    """

    def __init__(self, film: Film, bore: Shape | None, journal: Shape | None):
        self._film, self._inside = film, film.points.angle.size
        self._angle, self._height = observed_places(film)
        self.plain = bore is None and journal is None
        bore, self._journal = bore or Shape(), journal or Shape()
        self.fixed = bore.radial(self._angle, self._height)
        self.turning = not self._journal.round
        if not self.turning:
            self.fixed -= self._journal.radial(self._angle, self._height)
        self.largest_second_derivative = sum(
            float(np.abs(shape.radial(self._angle, self._height, 2)).max())
            for shape in (bore, self._journal)
        )

    def _deviation_of_journal(self, relative_angle: float, order: int = 0) -> np.ndarray:
        """Radial deviation of the turned journal at the Gauss points."""
        angle, height = self._angle[: self._inside], self._height[: self._inside]
        return self._journal.radial(angle - relative_angle, height, order)

    def gap_reduction(self, relative_angle: float) -> np.ndarray:
        """Gap taken by the turning shape at Gauss points and nodes, shape (w,) [m]."""
        return self._journal.radial(self._angle - relative_angle, self._height)

    def added(self, gap: Gap, relative_angle: float, speed: float) -> Gap:
        """A round joint's gap with the shapes, the journal at an angle [rad] and speed [rad/s]."""
        if self.plain:
            return gap
        added, rate = self.fixed[: self._inside], np.zeros(self._inside)
        if self.turning:
            added = added - self._deviation_of_journal(relative_angle)
            rate = speed * self._deviation_of_journal(relative_angle, 1)
        return gap.changed(added, rate)

    def rotated(self, relative_angle: float, speed: float) -> RotatedShape:
        """Derivatives there."""
        slope = self._deviation_of_journal(relative_angle, 1)
        curvature = self._deviation_of_journal(relative_angle, 2)
        fields = np.stack([slope, -curvature], axis=-1)
        torque, stiffness = self._film.load(fields.reshape(*self._film.points.angle.shape, 2))
        return RotatedShape(slope, -speed * curvature, torque, stiffness, -curvature)


def observed_places(film: Film) -> tuple[np.ndarray, np.ndarray]:
    """Angle and height where a gap is observed: Gauss points, then nodes, shape (w,) each."""
    nodes, points = film.parameters.grid.node_positions, film.points
    return (
        np.concatenate([points.angle.ravel(), nodes[:, 0]]),
        np.concatenate([points.height.ravel(), nodes[:, 1]]),
    )


#: Largest difference of the film's load from the body's own, relative to the largest, of a cosine
#: pressure. The body integrates over its quadratic cells, 1e-5 off the cylinder with 20 of them.
LOAD_TOLERANCE = 5e-4


def bore_surface(nodes: np.ndarray, cells: np.ndarray, family: str) -> Surface:
    """Surface mesh of a body's bore; a body without cells must have a structured one."""
    if cells.size:
        return Surface.on_cylinder(nodes, cells, family)
    grid = film_grid(nodes)
    order = match(grid.nodes, nodes)
    assert order is not None
    return Surface.on_cylinder(nodes, order[grid.cell_nodes], grid.family)


def sampling_grid(bore: BoreSurface) -> FilmGrid:
    """Places where it is kept what a part's mesh misses in one of its bores."""
    return uniform_grid(bore.radius, bore.width, SAMPLED)


class BoreFilm:
    """Linear maps of one film in the bore of one body.

    Parameters
    ----------
    body
        Reduced body.
    film
        Film on its bore.
    transfer
        How pressures reach a bore whose mesh the film's does not match.

    Attributes
    ----------
    outward, tangential
        Components of the elastic modes at the Gauss points, shape (g, n).
    normal
        Outward displacement at the Gauss points of displacements of the bore nodes, sparse,
        shape (g, 3 m).
    observed_normal
        The same where the gap is observed, shape (w, 3 m).
    projected
        Mortar from the film's nodal pressures to the bore's, None where there is none.
    observed
        Outward component at Gauss points and film nodes, where the gap is
        observed, shape (w, n).
    force, load
        Force of nodal film pressures along x and y, shape (2, nodes), and generalised forces on
        the elastic modes, shape (n, nodes).
    holes, solid
        Holes of the bore's mesh, and what they leave of every Gauss point's area, shape (cells,
        points); None: the bore is whole.

    Raises
    ------
    InterfaceMismatchError
        The bore is not the film's cylinder, or the body's load matrix does not
        belong to it.
    """

    def __init__(self, body: ReducedBody, film: Film, transfer: str = "conservative"):
        require_class("body", body, ReducedBody)
        require_class("film", film, Film)
        require_word("transfer", transfer, TRANSFERS)
        grid = film.parameters.grid
        self._check_size(body, film)
        surface = bore_surface(body.bore_nodes, body.bore.cells, body.bore.family)
        m = len(body.bore_nodes)
        # Unit translations along x and y, then the elastic modes.
        fields = np.zeros((m, 3, 2 + body.modes))
        fields[:, 0, 0] = fields[:, 1, 1] = 1.0
        fields[:, :, 2:] = body.bore_basis
        fields = fields.reshape(3 * m, -1)
        inside = film.points.angle.size
        self.observed_normal = outward_displacement(surface, *observed_places(film))
        normal = self.normal = self.observed_normal[:inside]
        self.observed = (self.observed_normal @ fields)[:, 2:]
        outward = normal @ fields
        self.outward = self.observed[:inside]
        # n . (e_z x u) is minus the component of u along the circumference.
        self.tangential = -(normal @ turned(fields[:, 2:], 2))
        # 4-node cells may have 9-node cells' nodes, whose equal pressures are others.
        family = body.bore.pressure_family or film_layout(body.pressure_nodes)[1]
        alike = grid.family == family
        self._order = match(body.pressure_nodes, grid.nodes) if alike else None
        self._mortar = self._mortar_of(body, grid) if self._order is None else None
        fields = outward.reshape(*film.points.angle.shape, -1)
        self.holes, self.solid, whole = surface.holes, None, None
        if surface.holes:
            mesh = Surface(grid.node_positions, grid.cell_nodes, grid.family)
            self.solid = solid_share(surface, mesh, film.assembly.reference)
            whole, fields = film.load(fields[..., :2]), self.solid[..., None] * fields
        load = film.load(fields)
        self.projected: np.ndarray | None = None
        if transfer == "mortar" and self._mortar is not None:
            matrix = self.projected = self._mortar.to_structure(np.eye(len(grid.nodes)))
            load = body.load_projection[1:] @ matrix
        self.force, self.load = load[:2], load[2:]
        self._check_load(body, film)
        if whole is not None:
            self.force = whole

    @staticmethod
    def _check_size(body: ReducedBody, film: Film) -> None:
        grid = film.parameters.grid
        for name, own, given in (
            ("radius", grid.radius, body.bore.radius),
            ("width", grid.width, body.bore.width),
        ):
            if not abs(own - given) <= 1e-6 * given:
                raise InterfaceMismatchError(
                    f"the film's {name} of {own:g} m is not that of the bore, {given:g} m"
                )

    def _mortar_of(self, body: ReducedBody, grid: FilmGrid) -> Mortar:
        structure = bore_surface(
            body.pressure_nodes, body.bore.pressure_cells, body.bore.pressure_family
        )
        film = Surface(grid.node_positions, grid.cell_nodes, grid.family)
        return Mortar(structure, film, grid.radius)

    def structure_pressure(self, pressure: np.ndarray) -> np.ndarray:
        """Pressure on the body's pressure nodes, shape (k,): ``P_s`` of (14)."""
        if self._mortar is not None:
            return self._mortar.to_structure(pressure)
        return pressure[self._order]

    def _check_load(self, body: ReducedBody, film: Film) -> None:
        """A smooth pressure must do the same work by the film's integrals and by the body's J."""
        grid = film.parameters.grid
        for angle_of, component in ((np.cos, 1), (np.sin, 2)):
            pressure = 1.0 + angle_of(grid.node_positions[:, 0])
            own = self.force @ pressure
            expected = body.load_projection[TRANSLATIONS] @ self.structure_pressure(pressure)
            defect = np.abs(own - expected).max() / np.abs(expected).max()
            if not defect <= LOAD_TOLERANCE:
                raise InterfaceMismatchError(
                    f"film and body disagree on the work of a pressure by {defect:.1e} "
                    f"(relative, component {component}), above {LOAD_TOLERANCE:.0e}: the body's "
                    "load matrix does not belong to its bore"
                )


#: Unit matrix of the plane, and a quarter turn.
UNIT, QUARTER = np.eye(2), np.array([[0.0, -1.0], [1.0, 0.0]])

#: Rows of e and of psi, their places in u, and those of what they are tied to: position and tilt
#: of the journal.
TIED = (
    (slice(0, 2), slice(OWN, OWN + 2), slice(SECOND, SECOND + 2)),
    (slice(2, 4), slice(OWN + 2, OWN + 4), slice(SECOND + TILT, SECOND + TILT + 2)),
)


#: Words of a lubricated joint, by argument.
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
        Film thickness at which a run ends, share of the clearance; of a share up to 0.01 at most
        0.2 um (`fenics_ehd.multibody.run.touching_film`).
    bore_shape, journal_shape
        Radial deviations in the frames of the two bodies; None: round.
    shear_rule
        For the cavitated zone, see `fenics_ehd.film.forces`.
    heat
        Balance of the film's heat over a cycle; None: the oil keeps its temperature.
    cavitation
        Condition, one of `CAVITATIONS`; with ``"mass-conserving"``, on a bilinear mesh, the film
        keeps account of its oil.
    initial_filling
        Fluid fraction of the gap at the start, 0 to 1, of such a film.
    ambient
        Outside its sides, ``"air"`` or ``"oil"``, which flows back in where the film sucks; beside
        sides above cavitation pressure there always is oil.
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
        """Words, numbers and classes of the arguments, each by itself."""
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
        """Variations of the pressures of its supplies."""
        return tuple(
            variation
            for feed in self.film.parameters.feeds
            for variation in variations_of(feed.curve, setting=f"supply.{feed.name}")
        )


@dataclass(frozen=True)
class Eccentric(Joint):
    """The joint's constraints, a `Joint`.

    Attributes
    ----------
    first, second
        Markers of bore and journal.
    own
        Number of own coordinates: 2 of the eccentricity and, of a journal that tilts, 2 more.
    """

    first: str
    second: str
    own: int

    @property
    def markers(self) -> tuple[str, ...]:
        """Markers of bore and journal."""
        return self.first, self.second

    @property
    def rows(self) -> int:  # type: ignore[override]
        """Number of constraints, one for each own coordinate."""
        return self.own

    def geometry(self, u: np.ndarray) -> Geometry:
        """Distance of the journal from its place in the bore, see `Joint`."""
        turn = rotation(u[ANGLE])
        turned = QUARTER @ turn
        pairs = TIED[: self.own // 2]
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
        film = self.film = joint.film if joint.heat is None else joint.film.with_own_temperature()
        p = film.parameters
        self.clearance, self.shaft_radius = p.clearance, p.grid.radius - p.clearance
        self.friction, self.own = joint.friction, 4 if tilting else 2
        self.shear_rule = joint.shear_rule
        self.shape = JointShape(film, joint.bore_shape, joint.journal_shape)
        self.bore = None if part is None else BoreFilm(part, film, joint.transfer)
        inside, shape = film.points.angle.size, (*film.points.angle.shape, -1)
        outward, around = _journal_fields(*observed_places(film), self.own)
        around, gap = around[:inside], [-outward]
        mean, sliding = [0.5 * around], [around]
        load = [-film.load(outward[:inside].reshape(shape))]
        if self.bore is not None:
            elastic, tangential = self.bore.outward, self.bore.tangential
            carried = _mean_translation(film, elastic, tangential)
            # As seen from the bore's mean place, which carries the frame of the film.
            mean.append(0.5 * tangential - carried)
            sliding.append(-tangential)
            gap.append(self.bore.observed)
            load[0][:2] = -self.bore.force
            load.append(self.bore.load)
        self.mean_velocity, self.sliding_velocity, self.observed = (
            np.ascontiguousarray(np.hstack(parts)) for parts in (mean, sliding, gap)
        )
        self.thickness = self.observed[:inside]
        self.load = np.vstack(load)

    @property
    def size(self) -> int:
        """Number n of coordinates."""
        return self.thickness.shape[1]

    @cached_property
    def circle(self) -> np.ndarray:
        """Rows that make of a gap at the film's nodes the place of the journal in the bore.

        Both are taken for the circles that are nearest to their surfaces.

        Returns
        -------
        numpy.ndarray
            shape (2, k): along x and y, in the frame of the bore.
        """
        angle, _ = self.film.parameters.grid.node_positions.T
        waves = np.stack([np.ones_like(angle), -np.cos(angle), -np.sin(angle)])
        # Weights of the nodes are the integrals of their shape functions over the bore.
        weighted = waves * np.ravel(self.film.pressure_areas.sum(axis=0))
        # Areas of a quadrature: those of 8-node corners are negative, their sums are not.
        return np.linalg.solve(weighted @ waves.T, weighted)[1:]

    def lengths(self, thickness: np.ndarray) -> np.ndarray:
        """Lengths that changes of gaps are compared with [m]: the gaps, if surfaces are smooth."""
        surfaces = self.film.parameters.surfaces
        return thickness if surfaces is None else surfaces.length(thickness)

    def gap(
        self,
        xi: np.ndarray,
        xi_rate: np.ndarray,
        shaft_rate: float,
        relative_angle: float = 0.0,
        time: float = 0.0,
    ) -> Gap:
        """Gap and velocities at the Gauss points, residual patterns left out.

        Parameters
        ----------
        xi, xi_rate
            shape (n,).
        shaft_rate, relative_angle
            Speed of the journal relative to the bore [rad/s] and its angle, which matters where
            the journal is not round, or carries supplies [rad].
        time
            Which supplies may depend on [s].
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
        return self.shape.added(gap, relative_angle, shaft_rate)


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
