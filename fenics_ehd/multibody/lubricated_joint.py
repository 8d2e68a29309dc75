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

and bores or journals that are not round add their deviations (`JointShape`). Forces are the
integrals of the same fields times the pressure: gap and force are conjugate, except in holes and
with the mortar, see below. They act on both bodies at the journal's centre. The torque about the
centre is that of the oil's shear, and of the pressure on a journal that is not round. With the
gap's derivative along the angle alpha of the journal relative to the bore,
``dh/dalpha = d delta/dphi (phi - alpha)``,

    T = int p dh/dalpha dA    on the journal, -T on the bore.

If the meshes of a body's bore and of its film match, shape functions of the bore are evaluated at
the film's Gauss points. If they do not match, pressures are transferred to the bore either
conservatively, ``F = int N_s n p``, with the resultants of the film, or by the paper's mortar (14)
and the body's load matrix. A bore may have holes. The gap in a hole follows the bore as extended
from the rim (`fenics_ehd.film.transfer`). The film's pressure in a hole does not load the elastic
modes: these are loaded on the remaining surface alone, as in the body's load matrix. The pressure
in a hole is part of the force between journal and body, because the oil in the hole presses on the
far end of its passage.

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
from fenics_ehd.multibody.joints import ADDITIONAL, SECOND, Geometry, Joint
from fenics_ehd.multibody.tabulated import Variation, variations_of
from fenics_ehd.reduction.body import TRANSLATIONS, ReducedBody
from fenics_ehd.reduction.bore import SAMPLED, BoreSurface, turned


@dataclass(frozen=True, eq=False)
class RotatedShape:
    """Shape of a journal at one angle relative to its bore, at the g Gauss points.

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
        Film on the bore.
    bore, journal
        Shapes of the two surfaces; None: round.

    Attributes
    ----------
    plain
        Whether both surfaces are round: the gap does not change.
    fixed
        Constant change of the gap at Gauss points and nodes, shape (w,) [m].
    turning
        Whether the gap changes as the journal turns: the journal is not round.
    largest_second_derivative
        Bound of the shapes' second derivative along the angle [m/rad^2].
    """

    def __init__(self, film: Film, bore: Shape | None, journal: Shape | None):
        self._film = film
        self._inside = film.points.angle.size
        self._angle, self._height = observed_positions(film)
        self.plain = bore is None and journal is None
        bore = bore or Shape()
        self._journal = journal or Shape()
        self.fixed = bore.radial(self._angle, self._height)
        self.turning = not self._journal.round
        if not self.turning:
            self.fixed -= self._journal.radial(self._angle, self._height)
        self.largest_second_derivative = sum(
            float(np.abs(shape.radial(self._angle, self._height, 2)).max())
            for shape in (bore, self._journal)
        )

    def _deviation_of_journal(self, relative_angle: float, order: int = 0) -> np.ndarray:
        """Radial deviation of the turned journal at the Gauss points, or a derivative of it."""
        angle = self._angle[: self._inside]
        height = self._height[: self._inside]
        return self._journal.radial(angle - relative_angle, height, order)

    def gap_reduction(self, relative_angle: float) -> np.ndarray:
        """Reduction of the gap by the turned journal at Gauss points and nodes, (w,) [m]."""
        return self._journal.radial(self._angle - relative_angle, self._height)

    def added(self, gap: Gap, relative_angle: float, speed: float) -> Gap:
        """Gap with both shapes.

        Parameters
        ----------
        gap
            Gap between round surfaces.
        relative_angle, speed
            Angle [rad] and angular speed [rad/s] of the journal relative to the bore.
        """
        if self.plain:
            return gap
        added = self.fixed[: self._inside]
        rate = np.zeros(self._inside)
        if self.turning:
            added = added - self._deviation_of_journal(relative_angle)
            rate = speed * self._deviation_of_journal(relative_angle, 1)
        return gap.changed(added, rate)

    def rotated(self, relative_angle: float, speed: float) -> RotatedShape:
        """Derivatives along the angle, at an angle [rad] and angular speed [rad/s]."""
        slope = self._deviation_of_journal(relative_angle, 1)
        curvature = self._deviation_of_journal(relative_angle, 2)
        fields = np.stack([slope, -curvature], axis=-1)
        torque, stiffness = self._film.load(fields.reshape(*self._film.points.angle.shape, 2))
        return RotatedShape(slope, -speed * curvature, torque, stiffness, -curvature)


def observed_positions(film: Film) -> tuple[np.ndarray, np.ndarray]:
    """Angles and heights at which a gap is computed: Gauss points, then nodes, shape (w,) each."""
    nodes = film.parameters.grid.node_positions
    points = film.points
    return (
        np.concatenate([points.angle.ravel(), nodes[:, 0]]),
        np.concatenate([points.height.ravel(), nodes[:, 1]]),
    )


#: Largest difference of the film's load from the body's load, over the largest load, of a cosine
#: pressure. The body integrates over quadratic cells, whose areas differ from those of the cylinder
#: by 1e-5 with 20 cells.
LOAD_TOLERANCE = 5e-4


def bore_surface(nodes: np.ndarray, cells: np.ndarray, family: str) -> Surface:
    """Surface mesh of a body's bore; the nodes of a bore without cells must be structured."""
    if cells.size:
        return Surface.on_cylinder(nodes, cells, family)
    grid = film_grid(nodes)
    order = match(grid.nodes, nodes)
    assert order is not None
    return Surface.on_cylinder(nodes, order[grid.cell_nodes], grid.family)


def sampling_grid(bore: BoreSurface) -> FilmGrid:
    """Grid at whose nodes the mesh error of a part's bore is stored."""
    return uniform_grid(bore.radius, bore.width, SAMPLED)


class BoreFilm:
    """Linear maps of one film in the bore of one body.

    Parameters
    ----------
    body
        Reduced body.
    film
        Film on the body's bore.
    transfer
        Transfer of pressures to a bore whose mesh does not match that of the film, one of
        `TRANSFERS`.

    Attributes
    ----------
    outward, tangential
        Components of the elastic modes at the Gauss points, shape (g, n).
    normal
        Outward displacement at the Gauss points of displacements of the bore nodes, sparse,
        shape (g, 3 m).
    observed_normal
        The same at Gauss points and film nodes, shape (w, 3 m).
    projected
        Mortar from nodal pressures of the film to those of the bore; None: without mortar.
    observed
        Outward components of the elastic modes at Gauss points and film nodes, shape (w, n).
    force, load
        Force of nodal film pressures along x and y, shape (2, nodes), and generalised forces on
        the elastic modes, shape (n, nodes).
    holes, solid
        Holes of the bore's mesh, and solid fraction of every Gauss point's area, shape (cells,
        points); None: the bore has no holes.

    Raises
    ------
    InterfaceMismatchError
        The bore is not the film's cylinder, or the body's load matrix does not
        belong to the bore.
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
        self.observed_normal = outward_displacement(surface, *observed_positions(film))
        normal = self.normal = self.observed_normal[:inside]
        self.observed = (self.observed_normal @ fields)[:, 2:]
        outward = normal @ fields
        self.outward = self.observed[:inside]
        # n . (e_z x u) is minus the component of u along the circumference.
        self.tangential = -(normal @ turned(fields[:, 2:], 2))
        # Cells of 4 and of 9 nodes may have the same nodes, with other shape functions.
        family = body.bore.pressure_family or film_layout(body.pressure_nodes)[1]
        alike = grid.family == family
        self._order = match(body.pressure_nodes, grid.nodes) if alike else None
        self._mortar = self._mortar_of(body, grid) if self._order is None else None
        fields = outward.reshape(*film.points.angle.shape, -1)
        self.holes = surface.holes
        self.solid = None
        force_with_holes = None
        if surface.holes:
            mesh = Surface(grid.node_positions, grid.cell_nodes, grid.family)
            self.solid = solid_share(surface, mesh, film.assembly.reference)
            force_with_holes = film.load(fields[..., :2])
            fields = self.solid[..., None] * fields
        load = film.load(fields)
        self.projected: np.ndarray | None = None
        if transfer == "mortar" and self._mortar is not None:
            matrix = self.projected = self._mortar.to_structure(np.eye(len(grid.nodes)))
            load = body.load_projection[1:] @ matrix
        self.force = load[:2]
        self.load = load[2:]
        self._check_load(body, film)
        if force_with_holes is not None:
            self.force = force_with_holes

    @staticmethod
    def _check_size(body: ReducedBody, film: Film) -> None:
        grid = film.parameters.grid
        for name, of_film, of_bore in (
            ("radius", grid.radius, body.bore.radius),
            ("width", grid.width, body.bore.width),
        ):
            if not abs(of_film - of_bore) <= 1e-6 * of_bore:
                raise InterfaceMismatchError(
                    f"the film's {name} of {of_film:g} m must be that of the bore, {of_bore:g} m"
                )

    def _mortar_of(self, body: ReducedBody, grid: FilmGrid) -> Mortar:
        structure = bore_surface(
            body.pressure_nodes, body.bore.pressure_cells, body.bore.pressure_family
        )
        film = Surface(grid.node_positions, grid.cell_nodes, grid.family)
        return Mortar(structure, film, grid.radius)

    def structure_pressure(self, pressure: np.ndarray) -> np.ndarray:
        """Pressures ``P_s`` of (14) at the body's pressure nodes, shape (k,) [Pa]."""
        if self._mortar is not None:
            return self._mortar.to_structure(pressure)
        return pressure[self._order]

    def _check_load(self, body: ReducedBody, film: Film) -> None:
        """Refuse a load matrix J whose work of a smooth pressure is not that of the film."""
        grid = film.parameters.grid
        for angle_of, component in ((np.cos, 1), (np.sin, 2)):
            pressure = 1.0 + angle_of(grid.node_positions[:, 0])
            of_film = self.force @ pressure
            expected = body.load_projection[TRANSLATIONS] @ self.structure_pressure(pressure)
            defect = np.abs(of_film - expected).max() / np.abs(expected).max()
            if not defect <= LOAD_TOLERANCE:
                raise InterfaceMismatchError(
                    f"film and body disagree on the work of a pressure by {defect:.1e} "
                    f"(relative, component {component}), above {LOAD_TOLERANCE:.0e}: the body's "
                    "load matrix does not belong to its bore"
                )


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
        Transfer of pressures to a bore whose mesh does not match that of the film, see `BoreFilm`.
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


class JointFilm:
    """Linear maps between a joint's film and ``xi = (e, psi, q)``: n coordinates.

    Parameters
    ----------
    joint
        Lubricated joint.
    part
        Reduced body with the bore; None: the bore is rigid.
    tilting
        Whether the journal tilts.

    Attributes
    ----------
    film
        Film of the joint, with a temperature of the joint's own if its heat is balanced.
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
    load
        Generalised forces of nodal pressures on xi, shape (n, nodes).
    bore
        Maps of a flexible bore; None: the bore is rigid.
    shape
        Shapes of bore and journal.
    """

    def __init__(self, joint: LubricatedJoint, part: ReducedBody | None, tilting: bool):
        # Joints may share a film, but not the temperature of the film.
        film = self.film = joint.film if joint.heat is None else joint.film.with_own_temperature()
        self.shaft_radius = film.parameters.grid.radius - self.clearance
        self.friction = joint.friction
        self.journal_coordinates = 4 if tilting else 2
        self.shear_rule = joint.shear_rule
        self.shape = JointShape(film, joint.bore_shape, joint.journal_shape)
        self.bore = None if part is None else BoreFilm(part, film, joint.transfer)
        inside = film.points.angle.size
        positions = observed_positions(film)
        outward, around = _journal_fields(*positions, self.journal_coordinates)
        around = around[:inside]
        gap = [-outward]
        mean = [0.5 * around]
        sliding = [around]
        load = [-film.load(outward[:inside].reshape((*film.points.angle.shape, -1)))]
        if self.bore is not None:
            tangential = self.bore.tangential
            carried = _mean_translation(film, self.bore.outward, tangential)
            # The frame of the film moves with the mean translation of the bore.
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
    """Outward and tangential motion of the journal for unit ``e_x, e_y, psi_x, psi_y``."""
    cosine = np.cos(angle)
    sine = np.sin(angle)
    outward = np.stack([cosine, sine, -height * sine, height * cosine], axis=-1)
    around = np.stack([-sine, cosine, -height * cosine, -height * sine], axis=-1)
    return outward[:, :count], around[:, :count]


def _mean_translation(film: Film, outward: np.ndarray, tangential: np.ndarray) -> np.ndarray:
    """Tangential component of the mean translation of every field, at the Gauss points."""
    cosine, sine = (x.ravel()[:, None] for x in film.points.normal)
    area = film.assembly.area.ravel() / film.assembly.area.sum()
    x = area @ (cosine * outward - sine * tangential)
    y = area @ (sine * outward + cosine * tangential)
    return cosine * y - sine * x
