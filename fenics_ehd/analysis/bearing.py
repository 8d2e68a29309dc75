"""One rigid bearing: equilibrium, forces, losses, heat and dynamic coefficients.

The smallest mechanism: a journal without mass under a load along x, in one lubricated joint. Load
and pressure balance (`fenics_ehd.analysis.equilibrium`); shear adds a force of relative size c / R,
the order that lubrication theory leaves out, and enters the friction torque and the power alone.

The film's mesh is made for a place of the journal, in a frame turned to it where the bore is round,
and anew when the journal settles elsewhere. At a given eccentricity the journal is held, at the
attitude at which the film's force lies on the load line.

Where the supply's temperature is given, that of the oil is the one at which the oil that leaves
carries away the power (`fenics_ehd.film.heat`): a hotter film is thinner, dissipates less and lets
as much oil out or more, so that there is one solution.

Coefficients are ``k_ij = -dF_i / dx_j`` and ``b_ij = -dF_i / dv_j`` of the film's force on the
shaft, x along the load, y a quarter turn on in direction of rotation, lines and grooves held. They
jump, by up to 1 % on 64 x 12 cells, whenever the edge of the film moves on by a row of nodes; the
mean over four meshes with slightly different cells cancels most of that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import attrs
import numpy as np

from fenics_ehd.analysis.bearing_settings import BearingSettings
from fenics_ehd.analysis.equilibrium import (
    DynamicCoefficients,
    Equilibrium,
    balanced,
    linearise,
    stability,
)
from fenics_ehd.base.arguments import require_class, require_names, require_number
from fenics_ehd.base.checks import as_float, require_finite
from fenics_ehd.base.errors import (
    EhdError,
    GapClosedError,
    HeatError,
    SettingsError,
    SolverError,
    VerificationError,
    ViscosityError,
)
from fenics_ehd.base.plane import rotation
from fenics_ehd.film.film import MOST_WITHIN_A_CELL, Film, FilmState, steepest_thickening
from fenics_ehd.film.forces import FlowBalance
from fenics_ehd.film.grid import gap_graded_grid
from fenics_ehd.film.heat import Heat, TemperatureSearch, run_away
from fenics_ehd.film.kinematics import Shape
from fenics_ehd.film.lubricant import make_lubricant
from fenics_ehd.film.parameters import FilmParameters
from fenics_ehd.film.rough_surfaces import DEEPEST_CONTACT, RoughSurfaces
from fenics_ehd.film.supply import AxialGroove, Sides
from fenics_ehd.multibody.body import MasslessBody, ground
from fenics_ehd.multibody.forces import PointForce
from fenics_ehd.multibody.joints import Revolute, Speed
from fenics_ehd.multibody.lubricated_joint import QUARTER, LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism, System
from fenics_ehd.multibody.quantities import JointStep, film_power

#: Angles and heights at which the gap is looked at. Between them a parabola in either direction
#: has the minimum, 1e-5 off where it lies askew.
ANGLES, HEIGHTS = 720, 41
AROUND = np.linspace(0.0, 2 * np.pi, ANGLES, endpoint=False)

#: A mesh made for one gap serves another as long as no thickness differs by more than this factor.
MESH_REACH = 1.2

#: Angle [rad] by which the journal may leave the place that a mesh of a round bore was made for,
#: the line without pressure at the maximum film; meshes of one search.
ALIGNED = 1e-3
LINED = 1e-7
MOST_MESHES = 60

#: Angle [rad] between force and load line at which the search for an attitude ends.
TOLERANCE = 1e-9

#: A load is approached by loads at least this factor apart.
NEAREST = 1.02

#: A load that needs a film thinner than this share of the clearance is refused: accuracy was
#: measured up to eccentricity 0.999.
THINNEST_FILM = 5e-4

#: Below this share of the largest pressure, times the area, a force is round-off; so is a pressure
#: below this share of ``12 eta Omega (R / c)^2``.
ROUND_OFF, NO_PRESSURE = 1e-11, 1e-13

#: Direction error [rad] allowed where no attitude can correct it.
STRAIGHT = 1e-6

#: Cells around that the other three meshes of the coefficients have more.
EXTRA_CELLS = (2, 4, 6)

#: Of the effective temperature [K]; change of ln(viscosity) that shows how power over flow follows
#: it, as nothing but the temperature changes them here; operating points of its search.
WARM = 1e-6
TELLING = 1e-6
MOST_STEPS = 50


def shape_of(settings: BearingSettings, angle: float = 0.0) -> Shape:
    """Shape of the bore as the straight shaft sees it, a round one in a frame at an angle [rad]."""
    shape = settings.bore_shape or Shape()
    if not any(settings.tilt):
        return shape
    tilt = shape.misalignment - rotation(-angle) @ settings.tilt
    return attrs.evolve(shape, misalignment=tilt.tolist())


def gaps(settings: BearingSettings, position: np.ndarray) -> np.ndarray:
    """Film thickness [m] at `ANGLES` and `HEIGHTS`, angles from the load line."""
    shape, height = shape_of(settings), settings.width * np.linspace(-0.5, 0.5, HEIGHTS)
    found = settings.clearance - np.stack([np.cos(AROUND), np.sin(AROUND)], axis=-1) @ position
    return found[:, None] + shape.radial(AROUND[:, None], height)


def minimum_film(settings: BearingSettings, position: np.ndarray) -> float:
    """Smallest film thickness for an eccentricity, shape (2,), from the load line [m].

    Raises
    ------
    GapClosedError
        It is not positive; rough surfaces may overlap, up to a limit.
    """
    film = gaps(settings, position)
    i, k = np.unravel_index(int(np.argmin(film)), film.shape)
    around = film[np.arange(i - 1, i + 2) % ANGLES, k]
    along = film[i, k - 1 : k + 2] if 0 < k < HEIGHTS - 1 else film[i, [k, k, k]]
    thinnest = float(film[i, k]) - _below(around) - _below(along)
    least = DEEPEST_CONTACT * settings.roughness
    if not thinnest > least:
        also = ", or the deviations of the bore" if settings.bore_shape is not None else ""
        raise GapClosedError(
            f"the film thickness is {thinnest * 1e6:.3g} um at its thinnest, it must be "
            f"{f'above {least * 1e6:.3g} um' if least else 'positive'}: "
            f"lower the eccentricity or the tilt{also}"
        )
    return thinnest


def _below(values: np.ndarray) -> float:
    """Depth of a parabola's vertex below the middle one of three values, the least."""
    bend, slope = values[0] - 2 * values[1] + values[2], 0.5 * (values[2] - values[0])
    return float(0.5 * slope**2 / bend) if bend > 0 else 0.0


@attrs.frozen
class _Held(Revolute):
    """A point that is at another, with a velocity [m/s]."""

    velocity: np.ndarray = attrs.field(factory=lambda: np.zeros(2))

    def imposed(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Motion of the point, as of `Joint`."""
        return np.zeros(2), self.velocity


class _Bearing:
    """Mechanism of a bearing, its film's mesh made for a place of the journal [m].

    The bore's frame, in which film, grooves and shape are, is turned from the load's by an angle.
    """

    def __init__(self, settings: BearingSettings, position: np.ndarray):
        s = self.settings = settings
        minimum_film(s, position)
        self.angle = 0.0 if s.bore_shape is not None else _direction(position)
        self._surfaces = RoughSurfaces.of(s, s.contact_modulus)
        self._made_for = self._profile(position)
        regions = tuple(replace(g, angle=g.angle - self.angle) for g in s.grooves)
        if s.line_at_max_film:
            regions = (AxialGroove(np.pi, 0.0),)
        edges = sorted(edge for region in regions for edge in region.edges)
        grid = gap_graded_grid(
            s.radius, s.width, (s.cells_around, s.cells_along), s.element, self._thickness, edges
        )
        oil = make_lubricant(s, 0.0 if s.graded else s.viscosity)
        squeeze = float(np.hypot(*s.squeeze)) / s.clearance
        rate = max(abs(s.speed), abs(s.bore_speed), squeeze) or 1.0
        sides = Sides(lower=s.ambient, upper=s.ambient)
        self.film = Film(
            FilmParameters(grid, s.clearance, oil, rate, sides, regions, surfaces=self._surfaces)
        )

    def _profile(self, position: np.ndarray) -> np.ndarray:
        """Thickness that the mesh follows: smallest by angle, or length of rough surfaces there."""
        thickness = gaps(self.settings, position).min(axis=1)
        return thickness if self._surfaces is None else self._surfaces.length(thickness)

    def _thickness(self, angle: np.ndarray) -> np.ndarray:
        return np.asarray(np.interp(angle + self.angle, AROUND, self._made_for, period=2 * np.pi))

    def suits(self, position: np.ndarray) -> bool:
        """True where the mesh is good for an eccentricity, too."""
        if self.settings.bore_shape is None:
            off = _direction(rotation(-self.angle) @ position)
            if abs(off) > (LINED if self.settings.line_at_max_film else ALIGNED):
                return False
        factor = self._profile(position) / self._made_for
        return bool(np.all((factor < MESH_REACH) & (factor > 1 / MESH_REACH)))

    def fitting(self, position: np.ndarray) -> _Bearing:
        """A bearing whose mesh suits an eccentricity: itself, or another one."""
        return self if self.suits(position) else _Bearing(self.settings, position)

    def rest(self, position: np.ndarray, load: float | None = None) -> _Found:
        """The journal at rest under a load [N], or held where it is."""
        s, held, back = self.settings, tuple(position), rotation(-self.angle)
        # As the bore sees it, which turns.
        rate = s.squeeze - s.direction * s.bore_speed * np.array([-position[1], position[0]])
        joint = LubricatedJoint(
            "shaft",
            "bore",
            self.film,
            eccentricity=tuple(back @ position),
            eccentricity_rate=tuple(back @ rate),
            bore_shape=shape_of(s, self.angle),
            shear_rule=s.shear_rule,
            cavitation=s.cavitation,
        )
        joints: dict[str, Any] = {"film": joint, "axis": Revolute(("bore", "ground"))}
        forces = {}
        if load is None:
            joints["held"] = _Held(("shaft", "ground.place"), np.array(s.squeeze))
        else:
            forces["load"] = PointForce("shaft", (1.0, 0.0), lambda _: (load, 0.0))
        shaft = MasslessBody(position=held, velocity=s.squeeze)
        bodies = {"shaft": shaft, "bore": MasslessBody(), "ground": ground({"place": held})}
        drives = {
            "shaft": Speed(s.direction * s.speed),
            "bore": Speed(s.direction * s.bore_speed, self.angle),
        }
        return _Found(self, balanced(System(Mechanism(bodies, joints, drives, forces))))


@dataclass(frozen=True, eq=False)
class _Found:
    """A journal somewhere in its bearing."""

    bearing: _Bearing
    rest: Equilibrium

    @cached_property
    def joint(self) -> JointStep:
        """The lubricated joint."""
        return self.rest.joints()["film"]

    @property
    def state(self) -> FilmState:
        """State of the film."""
        return self.joint.state

    @property
    def position(self) -> np.ndarray:
        """Eccentricity from the load line, shape (2,) [m]."""
        own = self.rest.z[self.rest.system.bodies["shaft"]][:2]
        centred = np.hypot(*own) < ROUND_OFF * self.bearing.settings.clearance
        return np.zeros(2) if centred else own

    @property
    def push(self) -> np.ndarray:
        """Force on the bore, x along the load, shape (2,) [N]."""
        return -self.joint.force

    @property
    def carries(self) -> bool:
        """True of a force above round-off of the pressures it is the sum of."""
        s, film = self.bearing.settings, self.bearing.film
        least = ROUND_OFF * self.state.pressure.max() + NO_PRESSURE * film.parameters.pressure_scale
        return float(np.hypot(*self.push)) > least * s.radius * s.width


def _direction(position: np.ndarray) -> float:
    return float(np.arctan2(position[1], position[0]))


def _expected_attitude(settings: BearingSettings) -> float:
    """First guess: ahead of the load when something turns, else where the squeeze goes."""
    entrainment = settings.direction * settings.entrainment
    if entrainment:
        return float(np.copysign(np.radians(50.0), entrainment))
    return _direction(np.array(settings.squeeze))


def _settled(start: _Found, load: float) -> _Found:
    """Under a load, the mesh made for where the journal is then.

    Raises
    ------
    SolverError
        There is no equilibrium, or it was not found from there.
    """
    bearing, position = start.bearing, start.position
    for _ in range(MOST_MESHES):
        bearing = bearing.fitting(position)
        found = bearing.rest(position, load)
        position = found.position
        if bearing.suits(position):
            return found
    raise SolverError(f"load = {load:g} N: no mesh suits the place it leads to")


def _at_load(settings: BearingSettings, load: float) -> _Found:
    """Under a load, approached by others where that is too far at once.

    Raises
    ------
    SettingsError
        The film carries no such load.
    """
    start = _open(settings, 0.6)
    if not start.carries:
        raise SettingsError(
            f"load = {load:g} N: the film has no pressure at speed = {settings.speed:g} rad/s, "
            f"squeeze = {settings.squeeze[0]:g}, {settings.squeeze[1]:g} m/s"
        )
    found, reached, aim = start, float(np.hypot(*start.push)), load
    while True:
        try:
            found = _settled(found, aim)
        except (SolverError, GapClosedError) as error:
            if max(aim / reached, reached / aim) < NEAREST:
                raise SettingsError(
                    f"load = {load:g} N: no equilibrium found, the nearest one is under "
                    f"{reached:.4g} N: take another load, speed or squeeze"
                ) from error
            aim = float(np.sqrt(aim * reached))
            continue
        film = minimum_film(settings, found.position)
        if not settings.roughness and film < THINNEST_FILM * settings.clearance:
            raise SettingsError(
                f"load = {load:g} N is too high: a film of {film / settings.clearance:.3g} "
                f"clearance, below {THINNEST_FILM:g}, the thinnest allowed, carries {aim:.4g} N"
            )
        if aim == load:
            return found
        reached, aim = aim, load


def _open(settings: BearingSettings, ratio: float) -> _Found:
    """Journal held at an eccentricity, as near to the expected attitude as it leaves a film.

    Raises
    ------
    SettingsError
        The shaft touches the bore at every attitude.
    """
    first, message = _expected_attitude(settings), ""
    # Across the way that the tilted shaft's ends go there is most room.
    across = np.arctan2(settings.tilt[1], settings.tilt[0])
    for angle in (*(first + np.radians([0, 90, -90, 180])), across, across + np.pi):
        position = rotation(angle)[:, 0] * ratio * settings.clearance
        try:
            return _Bearing(settings, position).rest(position)
        except GapClosedError as error:
            message = str(error)
    raise SettingsError(f"eccentricity and tilt close the gap at every attitude: {message}")


def _at_eccentricity(settings: BearingSettings, ratio: float) -> _Found:
    """At an eccentricity ratio in 0..1, the attitude found; without pressure at whatever attitude.

    By the secant rule, beginning with a force that turns with the journal, as in a plain bearing.

    Raises
    ------
    SettingsError
        No attitude puts the force on the load line, or the shaft touches the bore.
    """
    found = _open(settings, ratio)
    off = _direction(found.push)
    if not found.carries:
        return found
    if not ratio:
        if abs(off) > STRAIGHT:
            raise SettingsError(
                f"eccentricity = 0: the film's force is {np.degrees(off):.4g} degrees off the "
                "load line and no attitude can turn it: change squeeze or grooves"
            )
        return found
    turn = -off
    for _ in range(MOST_ATTITUDES):
        if abs(off) <= TOLERANCE:
            return found
        position = rotation(turn) @ found.position
        try:
            found = found.bearing.fitting(position).rest(position)
        except GapClosedError:
            turn *= 0.5
            continue
        before, off = off, _direction(found.push)
        slope = (off - before) / turn
        turn = -off / slope if slope > FLAT else -np.sign(slope or 1.0) * off
        turn = float(np.clip(turn, -LONGEST_TURN, LONGEST_TURN))
    raise SolverError(
        f"eccentricity = {ratio:g}: no attitude found; the film's force stays "
        f"{np.degrees(off):.3g} degrees off the load line"
    )


#: Attitudes of one search, longest step [rad], and slope of the force's direction over the
#: attitude below which the secant is not trusted.
MOST_ATTITUDES = 60
LONGEST_TURN = 1.0
FLAT = 0.05


@dataclass(frozen=True)
class BearingHeat:
    """Balanced heat of a bearing.

    Attributes
    ----------
    effective_temperature, outlet_temperature
        Of the oil [C].
    flow
        Of the oil that leaves [m3/s], see `FilmFlows.leaving`.
    """

    effective_temperature: float
    outlet_temperature: float
    flow: float


def _balanced(
    settings: BearingSettings, find: Callable[[BearingSettings], _Found]
) -> tuple[BearingHeat, _Found]:
    """Bearing at the effective temperature of its oil.

    Raises
    ------
    SettingsError
        The oil has one viscosity, or none at the supply's temperature.
    HeatError
        There is no such temperature.
    """
    given = settings.supply_temperature
    if not settings.graded:
        raise SettingsError(
            f"supply_temperature = {given:g} C: the oil has one viscosity; "
            "give a grade, or viscosity_40 and viscosity_100"
        )
    heat = Heat(
        supply_temperature=given,
        conducted_share=settings.conducted,
        outlet_weight=settings.mixing,
        tolerance=WARM,
    )
    oil = make_lubricant(attrs.evolve(settings, temperature=given), 0.0).oil
    assert oil is not None
    search = TemperatureSearch(heat, oil, telling=TELLING)
    for _ in range(MOST_STEPS):
        temperature = search.temperature
        try:
            found = find(attrs.evolve(settings, temperature=temperature))
        except EhdError as error:
            if search.without_balance:
                raise run_away("bearing", search, error) from error
            if temperature > given:
                raise type(error)(
                    f"at {temperature:.4g} C, the oil's effective temperature by its balance: "
                    f"{error}"
                ) from error
            raise
        power, flow = found.joint.dissipated, found.joint.flows.leaving
        if abs(search.defect(power, flow)) <= WARM:
            outlet = heat.outlet(oil, temperature, power, flow)
            return BearingHeat(temperature, outlet, flow), found
        if not search.move(power, flow):
            raise run_away("bearing", search)
    raise HeatError(
        f"supply_temperature = {given:g} C: the effective temperature, "
        f"{search.temperature:.6g} C, is not within {WARM:g} K of its balance after "
        f"{MOST_STEPS} operating points"
    )


@dataclass(frozen=True)
class ContactFigures:
    """Contact of a bearing in operation.

    Attributes
    ----------
    load
        Resultant of the contact pressure [N].
    share
        Over the load; contact and film act along different lines, their sizes do not add up.
    max_pressure
        [Pa].
    power
        Lost by boundary friction [W].
    """

    load: float
    share: float
    max_pressure: float
    power: float


def _coefficients(found: _Found, load: float) -> DynamicCoefficients:
    """Dynamic coefficients of a bearing under a load.

    Raises
    ------
    SettingsError
        There is no force or no eccentricity: no derivative exists. Or the oil is compressible:
        the rate of its density is not in the derivatives.
    """
    settings = found.bearing.settings
    if settings.density_law != "constant":
        raise SettingsError(
            f"density_law = '{settings.density_law}': the damping of compressible oil is not "
            "known: coefficients need density_law = 'constant'"
        )
    if not load or not np.any(found.position):
        raise SettingsError(
            "coefficients need a film with pressure and an eccentricity above 0: the cavitating "
            "film of a centred shaft has no derivative"
        )
    parts = []
    for extra in (0, *EXTRA_CELLS):
        other = attrs.evolve(settings, cells_around=settings.cells_around + extra)
        rest = _Bearing(other, found.position).rest(found.position, load).rest
        linear = linearise(rest).along(rest.system.bodies["shaft"].start + np.arange(2))
        parts.append([linear.stiffness, linear.damping])
    stiffness, damping = np.mean(parts, axis=0)
    if settings.plain:
        # Its force turns with the journal, which a mesh that stays shows to a row of nodes only.
        distance = np.hypot(*found.position)
        across = QUARTER @ found.position / distance
        turned = QUARTER @ found.push / distance
        stiffness += np.outer(turned - stiffness @ across, across)
    mass, whirl = stability(stiffness, damping)
    speed = abs(settings.speed)
    threshold = None if mass is None else speed * float(np.sqrt(settings.clearance * mass / load))
    ratio = None if whirl is None or not speed else whirl / speed
    return DynamicCoefficients(stiffness, damping, mass, ratio, threshold)


@dataclass(frozen=True, eq=False)
class BearingResult:
    """A bearing in equilibrium. None stands for what is not defined.

    Attributes
    ----------
    settings
        The bearing.
    load
        W, carried by the film's pressure [N].
    attitude
        From the load line to the line of centres, in direction of rotation [rad];
        None for a centred shaft or a film without pressure.
    max_pressure
        [Pa].
    max_pressure_angle
        From the maximum film, in direction of rotation, 0..2 pi [rad].
    min_film_thickness
        [m].
    eccentricity_ratio
        e / c at mid-width [-].
    sommerfeld_number
        ``eta N / p (R / c)^2`` with N, of shaft and bore together, in revolutions per second and
        ``p = W / (2 R B)`` [-].
    friction_torque
        With which the film brakes the shaft, about its own axis [N m].
    power_loss
        Mechanical power that goes into the film [W].
    dissipation
        Power that becomes heat [W]: the mechanical power and that of the oil supplied under
        pressure, less what flows out against an ambient pressure.
    tilting_moment
        Of pressure and contact on the shaft, about x and y at mid-width, shape (2,) [N m].
    flow
        Sides, supply and cavities [m3/s].
    contact
        Of rough surfaces; None for smooth ones.
    coefficients
        Stiffness, damping and stability, if asked for.
    heat
        Temperatures, where they follow from that of the supply.
    position
        Eccentricity, x along the load, shape (2,) [m].
    film, state, angle
        The film, its solution, and the angle from the load line to its frame [rad].
    """

    settings: BearingSettings
    load: float
    attitude: float | None
    max_pressure: float
    max_pressure_angle: float | None
    min_film_thickness: float
    eccentricity_ratio: float
    sommerfeld_number: float | None
    friction_torque: float
    power_loss: float
    dissipation: float
    tilting_moment: np.ndarray
    flow: FlowBalance
    contact: ContactFigures | None
    coefficients: DynamicCoefficients | None
    heat: BearingHeat | None
    position: np.ndarray
    film: Film
    state: FilmState
    angle: float

    @property
    def friction_coefficient(self) -> float | None:
        """Friction torque over load and radius of the bore."""
        return self.friction_torque / (self.settings.radius * self.load) if self.load else None


def solve_bearing(
    settings: BearingSettings,
    *,
    eccentricity: float | None = None,
    load: float | None = None,
    with_coefficients: bool = False,
) -> BearingResult:
    """Operating point of a bearing.

    Parameters
    ----------
    settings
        The bearing.
    eccentricity, load
        Eccentricity ratio in 0..1 or load [N], exactly one of them.
    with_coefficients
        Whether to add stiffness, damping and the stability threshold.

    Raises
    ------
    SettingsError
        A value out of its limits, or no equilibrium for it.
    HeatError
        The heat cannot leave.
    CavitationError
        No film was found.
    ViscosityError
        The viscosity runs away with the pressure, or grows faster than the cells show.
    VerificationError
        A figure of the result is no finite number.
    """
    require_class("settings", settings, BearingSettings)
    if (eccentricity is None) == (load is None):
        raise SettingsError("exactly one of eccentricity and load must be given")
    if eccentricity is not None and not 0 <= require_number("eccentricity", eccentricity) < 1:
        raise SettingsError(
            f"eccentricity = {eccentricity:g} must be at least 0 and below 1 (of the clearance)"
        )
    if load is not None and not 0 < require_number("load", load):
        raise SettingsError(f"load = {load:g} N must be a finite number above 0")

    def find(at: BearingSettings) -> _Found:
        if load is not None:
            return _at_load(at, load)
        assert eccentricity is not None
        return _at_eccentricity(at, eccentricity)

    # What overflows is named below.
    with np.errstate(all="ignore"):
        heat, found = _balanced(settings, find) if settings.heated else (None, find(settings))
        _require_resolved(found)
        result = _result(found, with_coefficients, heat)
    unknown = []
    for part in (result, result.flow, result.contact, result.coefficients, result.heat):
        figures = {} if part is None else vars(part)
        for name, value in figures.items():
            if isinstance(value, float | np.ndarray) and not np.isfinite(value).all():
                unknown.append(name)
    if unknown:
        raise VerificationError(
            f"{', '.join(unknown)}: no finite number: is one of radius, clearance, width, "
            "viscosity, speed and pressures far from any bearing's?"
        )
    return result


def bearing(
    *,
    eccentricity: float | None = None,
    load: float | None = None,
    with_coefficients: bool = False,
    **settings: Any,
) -> BearingResult:
    """`solve_bearing` of `BearingSettings` that are given by name, and a load, ``"5 kN"``."""
    require_names("bearing", settings, attrs.fields_dict(BearingSettings))
    size = as_float(load, "N")
    if load is not None:
        require_finite("load", size, "N")
    return solve_bearing(
        BearingSettings(**settings),
        eccentricity=eccentricity,
        load=size,
        with_coefficients=with_coefficients,
    )


def _require_resolved(found: _Found) -> None:
    """Refuse pressures that are the mesh's own: oil that thickens too much within a cell."""
    steepest = steepest_thickening(found.bearing.film, found.state.pressure)
    if not steepest <= MOST_WITHIN_A_CELL:
        raise ViscosityError(
            f"the viscosity grows {steepest:.3g} times within a film cell, above "
            f"{MOST_WITHIN_A_CELL:g}: use more cells; where that does not help the viscosity runs "
            "away, lower load, eccentricity or the pressure coefficient (barus, roelands)"
        )


def _tilting_moment(found: _Found) -> np.ndarray:
    """Moment of pressure and contact on the shaft, from the load line, shape (2,) [N m]."""
    film, joint = found.bearing.film, found.joint
    area = film.parameters.grid.radius**2 * film.assembly.area
    pressing = area * film.assembly.at_points(joint.pressure)[0]
    if joint.contact is not None:
        pressing += (joint.contact.area * joint.touch.pressure).reshape(area.shape)
    x, y = film.points.normal * film.points.height * pressing
    return np.asarray(rotation(found.bearing.angle) @ np.array([y.sum(), -x.sum()]))


def _result(found: _Found, with_coefficients: bool, heat: BearingHeat | None) -> BearingResult:
    bearing, position, state = found.bearing, found.position, found.state
    settings, film, joint = bearing.settings, bearing.film, found.joint
    load = float(np.hypot(*found.push)) if found.carries else 0.0
    pressure, pressure_angle = _peak(found)
    # The load at a Sommerfeld number of 1.
    stress = film.parameters.lubricant.viscosity * abs(settings.entrainment) / (2 * np.pi)
    unit = 2 * settings.width * stress * settings.radius**3 / settings.clearance**2
    return BearingResult(
        settings=settings,
        load=load,
        attitude=_direction(position) if load and position.any() else None,
        max_pressure=pressure,
        max_pressure_angle=pressure_angle,
        min_film_thickness=minimum_film(settings, position),
        eccentricity_ratio=float(np.hypot(*position)) / settings.clearance,
        sommerfeld_number=unit / load if load else None,
        # Of nothing no minus zero.
        friction_torque=0.0 + joint.braking,
        power_loss=0.0 + film_power(joint),
        dissipation=joint.dissipated,
        tilting_moment=_tilting_moment(found),
        flow=joint.flows.balance,
        contact=_contact(found, load),
        coefficients=_coefficients(found, load) if with_coefficients else None,
        heat=heat,
        position=position,
        film=film,
        state=state,
        angle=bearing.angle,
    )


def _contact(found: _Found, load: float) -> ContactFigures | None:
    joint = found.joint
    if joint.contact is None:
        return None
    force = float(np.hypot(*joint.contact.forces(joint.touch, joint.state.gap)[:2]))
    share = force / load if load else 0.0
    return ContactFigures(force, share, joint.touch.pressure.max(), joint.rubbed)


#: Points a direction at which the pressure is sampled about the highest node, and how often, every
#: time about the best of the last.
SAMPLES, CLOSER = 21, 3


def _peak(found: _Found) -> tuple[float, float | None]:
    """Largest pressure, between the nodes too, and its angle from the maximum film."""
    film, nodal = found.bearing.film, found.state.pressure
    grid, highest = film.parameters.grid, float(nodal.max())
    if not highest > NO_PRESSURE * film.parameters.pressure_scale:
        return 0.0, None
    place = grid.node_positions[int(np.argmax(nodal))]
    reach = np.array([np.diff(grid.angles).max(), np.diff(grid.heights).max()])
    offsets = np.linspace(-1.0, 1.0, SAMPLES)
    for _ in range(CLOSER):
        a, z = (x.ravel() for x in np.meshgrid(*(place[:, None] + np.outer(reach, offsets))))
        z = np.clip(z, grid.heights[0], grid.heights[-1])
        values = grid.interpolation(a, z) @ nodal
        best = int(np.argmax(values))
        highest, place = float(values[best]), np.array([a[best], z[best]])
        reach = reach * 2 / SAMPLES
    if not found.position.any():
        return highest, None
    centre = _direction(found.position) - found.bearing.angle
    return highest, float(np.mod(place[0] - centre - np.pi, 2 * np.pi))
