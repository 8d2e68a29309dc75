"""One rigid bearing: equilibrium, forces, losses, heat and dynamic coefficients.

The mechanism (`fenics_ehd.scenes.bearing`) is a massless journal in one lubricated joint, under a
load along x (`fenics_ehd.analysis.bearing_mechanism`). Its equilibrium is that of load and film
pressure (`fenics_ehd.analysis.equilibrium`). Shear stresses add a force of relative size c / R,
which lubrication theory neglects; they enter the friction torque and the power only. At a given
eccentricity the journal is held, at the attitude at which the film's force lies on the load line.

If the supply temperature is given, the oil has the temperature at which the leaving oil carries
away the dissipated power (`fenics_ehd.film.heat`). The solution is unique, because a hotter film is
thinner, dissipates less power, and lets at least as much oil out.

Coefficients are ``k_ij = -dF_i / dx_j`` and ``b_ij = -dF_i / dv_j`` of the film's force on the
shaft. x is along the load, y is a quarter turn from x in direction of rotation; zero-pressure lines
and grooves are at rest. They are means over film meshes, see `fenics_ehd.analysis.film_meshes`.

Imports inside functions: figures need matplotlib, which is loaded when one is drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import attrs
import numpy as np

from fenics_ehd.analysis.bearing_mechanism import (
    NO_PRESSURE,
    Bearing,
    MeshedBearing,
    OperatingPoint,
    direction_of,
)
from fenics_ehd.analysis.bearing_settings import BearingSettings
from fenics_ehd.analysis.dynamic_coefficients import DynamicCoefficients, stability
from fenics_ehd.analysis.equilibrium import linearise
from fenics_ehd.analysis.film_meshes import MeshMean, extra_cells
from fenics_ehd.base.arguments import require_number
from fenics_ehd.base.described import Described
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
from fenics_ehd.film.heat import TemperatureSearch, require_graded
from fenics_ehd.film.lubricant import make_lubricant
from fenics_ehd.multibody.lubricated_joint import QUARTER
from fenics_ehd.multibody.quantities import film_power, max_contact_pressure, min_film_thickness

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Largest number of meshes in one search for an equilibrium.
MOST_MESHES = 60

#: Angle between force and load line below which the search for an attitude ends [rad].
TOLERANCE = 1e-9

#: Smallest ratio of two loads in a sequence that approaches a load.
NEAREST = 1.02

#: Smallest minimum film over the clearance; accuracy was tested up to an eccentricity of 0.999.
THINNEST_FILM = 5e-4

#: Largest angle between force and load line for a centred shaft, which has no attitude [rad].
STRAIGHT = 1e-6

#: Smallest change of ln(viscosity) between two operating points from which the exponent of power
#: over flow is computed; it is small because the points differ in temperature only.
LEAST_CHANGE = 1e-6

#: Largest number of operating points in the search for a temperature.
MOST_POINTS = 50


def _expected_attitude(settings: BearingSettings) -> float:
    """First guess of the attitude angle [rad].

    It is 50 degrees in the direction of rotation. Without rotation, it is the squeeze direction.
    """
    entrainment = settings.direction * settings.entrainment
    if entrainment:
        return float(np.copysign(np.radians(50.0), entrainment))
    return direction_of(np.array(settings.squeeze))


def _under_load(start: OperatingPoint, load: float) -> OperatingPoint:
    """Equilibrium under a load [N], with a film mesh made for the position of the journal in it.

    The search begins at the operating point `start`.

    Raises
    ------
    SolverError
        The search from `start` found no equilibrium.
    """
    meshed = start.meshed
    position = start.position
    for _ in range(MOST_MESHES):
        meshed = meshed.meshed_for(position)
        point = meshed.rest(position, load)
        position = point.position
        if meshed.suits(position):
            return point
    raise SolverError(f"load = {load:g} N: none of {MOST_MESHES} film meshes suits the equilibrium")


def _at_load(bearing: Bearing, load: float) -> OperatingPoint:
    """Equilibrium under a load [N].

    If the search at this load fails, equilibria are computed at intermediate loads, which approach
    it.

    Raises
    ------
    SettingsError
        The film cannot carry the load, or no equilibrium was found.
    """
    settings = bearing.settings
    point = _held(bearing, 0.6)
    if not point.carries:
        raise SettingsError(
            f"load = {load:g} N: the film has no pressure at speed = {settings.speed:g} rad/s, "
            f"squeeze = {settings.squeeze[0]:g}, {settings.squeeze[1]:g} m/s: increase speed or "
            "squeeze"
        )
    reached = float(np.hypot(*point.force_on_bore))
    aim = load
    while True:
        try:
            point = _under_load(point, aim)
        except (SolverError, GapClosedError) as error:
            if max(aim / reached, reached / aim) < NEAREST:
                raise SettingsError(
                    f"load = {load:g} N: no equilibrium was found; the nearest load with one is "
                    f"{reached:.4g} N: use another load, speed or squeeze"
                ) from error
            aim = float(np.sqrt(aim * reached))
            continue
        film = min_film_thickness(point.joint)
        if not settings.roughness and film < THINNEST_FILM * settings.clearance:
            raise SettingsError(
                f"load = {load:g} N is too high: under {aim:.4g} N the film has a thickness of "
                f"{film / settings.clearance:.3g} clearance, below the limit of {THINNEST_FILM:g}"
            )
        if aim == load:
            return point
        reached = aim
        aim = load


def _held(bearing: Bearing, ratio: float) -> OperatingPoint:
    """Operating point of a journal that is held at an eccentricity ratio.

    The attitude is the first of six angles at which the shaft does not touch the bore.

    Raises
    ------
    SettingsError
        The shaft touches the bore at every attitude that was tried.
    """
    settings = bearing.settings
    expected = _expected_attitude(settings)
    # The gap at the ends of a tilted shaft is largest perpendicular to the tilt.
    across = np.arctan2(settings.tilt[1], settings.tilt[0])
    message = ""
    for angle in (*(expected + np.radians([0, 90, -90, 180])), across, across + np.pi):
        position = rotation(angle)[:, 0] * ratio * settings.clearance
        try:
            return MeshedBearing(bearing, position).rest(position)
        except GapClosedError as error:
            message = str(error)
    raise SettingsError(f"eccentricity and tilt close the gap at every attitude: {message}")


#: Largest number of attitudes in one search.
MOST_ATTITUDES = 60

#: Largest step of the attitude [rad].
LONGEST_TURN = 1.0

#: Smallest change of the force's direction per change of attitude for a step of the secant method.
FLAT = 0.05


def _at_eccentricity(bearing: Bearing, ratio: float) -> OperatingPoint:
    """Operating point at an eccentricity ratio in 0..1, with the film's force on the load line.

    The attitude is found by the secant method. The first step assumes that the force rotates with
    the journal, as in a plain bearing. If the film has no pressure, the attitude is arbitrary.

    Raises
    ------
    SettingsError
        The force on a centred shaft is not on the load line, or the shaft touches the bore.
    SolverError
        No attitude was found at which the force of the film is on the load line.
    """
    point = _held(bearing, ratio)
    off = direction_of(point.force_on_bore)
    if not point.carries:
        return point
    if not ratio:
        if abs(off) > STRAIGHT:
            raise SettingsError(
                f"eccentricity = 0: the force of the film is {np.degrees(off):.4g} degrees off "
                "the load line, at any attitude: change squeeze or grooves"
            )
        return point
    turn = -off
    for _ in range(MOST_ATTITUDES):
        if abs(off) <= TOLERANCE:
            return point
        position = rotation(turn) @ point.position
        try:
            point = point.meshed.meshed_for(position).rest(position)
        except GapClosedError:
            turn *= 0.5
            continue
        before = off
        off = direction_of(point.force_on_bore)
        slope = (off - before) / turn
        turn = -off / slope if slope > FLAT else -np.sign(slope or 1.0) * off
        turn = float(np.clip(turn, -LONGEST_TURN, LONGEST_TURN))
    raise SolverError(
        f"eccentricity = {ratio:g}: no attitude was found; the force of the film remains "
        f"{np.degrees(off):.3g} degrees off the load line"
    )


@dataclass(frozen=True)
class BearingHeat(Described):
    """Result of a bearing's heat balance.

    Attributes
    ----------
    effective_temperature, outlet_temperature
        Effective temperature of the oil in the film, and temperature of the leaving oil [C].
    flow
        Flow of the leaving oil, see `FilmFlows.leaving` [m3/s].
    """

    effective_temperature: float
    outlet_temperature: float
    flow: float


def _with_balanced_heat(
    bearing: Bearing, solve: Callable[[Bearing], OperatingPoint]
) -> tuple[BearingHeat, OperatingPoint]:
    """Result of the heat balance, and operating point at the effective temperature of the oil.

    Raises
    ------
    SettingsError
        The viscosity of the oil is constant, or unknown at the supply temperature.
    HeatError
        No temperature satisfies the heat balance.
    """
    settings = bearing.settings
    heat = settings.heat
    supply = heat.supply_temperature
    require_graded(
        settings.graded, key=f"supply_temperature = {supply:g} C", lubricant="the bearing"
    )
    oil = make_lubricant(attrs.evolve(settings, temperature=supply).oil).oil
    assert oil is not None
    search = TemperatureSearch(heat, oil, "bearing", least_change=LEAST_CHANGE)
    for _ in range(MOST_POINTS):
        temperature = search.temperature
        try:
            point = solve(bearing.changed(temperature=temperature))
        except EhdError as error:
            cause: EhdError | None = search.cause_of(error)
            if cause is None and temperature > supply:
                cause = type(error)(
                    f"at {temperature:.4g} C, the oil's effective temperature by its balance: "
                    f"{error}"
                )
            if cause is None:
                raise
            raise cause from error
        power = point.joint.dissipated
        flow = point.joint.flows.leaving
        if search.settled(power, flow):
            outlet = heat.outlet(oil, temperature, power, flow)
            return BearingHeat(temperature, outlet, flow), point
        search.move(power, flow)
    raise HeatError(
        f"supply_temperature = {supply:g} C: the effective temperature, "
        f"{search.temperature:.6g} C, is not within {heat.tolerance:g} K of the temperature that "
        f"balances the heat, after {MOST_POINTS} operating points"
    )


@dataclass(frozen=True)
class ContactFigures(Described):
    """Results on the contact of rough surfaces in a bearing.

    Attributes
    ----------
    load
        Size of the resultant of the contact pressure [N].
    share
        Size of this resultant over the load [-]. Contact and film act in different directions, so
        that their shares do not add up to 1.
    max_pressure
        Largest contact pressure, interpolated between the Gauss points [Pa].
    power
        Power lost by boundary friction [W].
    """

    load: float
    share: float
    max_pressure: float
    power: float


def _coefficients(point: OperatingPoint, load: float) -> DynamicCoefficients:
    """Dynamic coefficients of a bearing under a load [N].

    Raises
    ------
    SettingsError
        The film has no force or the shaft has no eccentricity, so that the derivatives do not
        exist; or the oil is compressible.
    """
    settings = point.meshed.settings
    if settings.density_law != "constant":
        raise SettingsError(
            f"density_law = '{settings.density_law}': the damping by compressible oil is not "
            "computed: use density_law = 'constant'"
        )
    if not load or not np.any(point.position):
        raise SettingsError(
            "coefficients need a film with pressure and an eccentricity above 0, since the force "
            "of the cavitating film has no derivatives at a centred shaft"
        )
    parts = [
        _film_matrices(point, settings.cells_around + extra, load)
        for extra in extra_cells(settings.meshes)
    ]
    stiffness, damping = (MeshMean.of(matrices) for matrices in zip(*parts, strict=True))
    speed = abs(settings.speed)

    def limits(matrices: Sequence[np.ndarray]) -> tuple[float | None, float | None, float | None]:
        """Critical mass, whirl ratio and stability threshold for a stiffness and a damping."""
        mass, whirl = stability(*matrices)
        ratio = None if whirl is None or not speed else whirl / speed
        if mass is None:
            return None, ratio, None
        return mass, ratio, speed * float(np.sqrt(settings.clearance * mass / load))

    each = [limits(matrices) for matrices in parts]
    return DynamicCoefficients(
        stiffness.value,
        damping.value,
        *limits((stiffness.value, damping.value)),
        stiffness.scatter,
        damping.scatter,
        *(_half_range(values) for values in zip(*each, strict=True)),
    )


def _half_range(values: Sequence[float | None]) -> float | None:
    """Half the range of the values on several meshes; None for one mesh or a missing value."""
    known = [value for value in values if value is not None]
    return 0.5 * float(np.ptp(known)) if len(known) == len(values) > 1 else None


def _film_matrices(point: OperatingPoint, around: int, load: float) -> list[np.ndarray]:
    """Stiffness and damping of the film under a load [N].

    The film mesh has `around` cells around the bearing.
    """
    finer = point.meshed.bearing.changed(cells_around=around)
    rest = MeshedBearing(finer, point.position).rest(point.position, load).rest
    linear = linearise(rest).along(rest.system.bodies["shaft"].start + np.arange(2))
    stiffness = linear.stiffness
    if finer.settings.plain:
        # In a plain bearing the force rotates with the journal. A mesh at rest rounds the edge of
        # the film to a row of nodes, so that the computed force does not rotate exactly.
        distance = np.hypot(*point.position)
        across = QUARTER @ point.position / distance
        turned = QUARTER @ point.force_on_bore / distance
        stiffness = stiffness + np.outer(turned - stiffness @ across, across)
    return [stiffness, linear.damping]


@dataclass(frozen=True, eq=False)
class BearingResult(Described):
    """Results of a bearing in equilibrium; values that are not defined are None.

    Attributes
    ----------
    settings
        Settings of the bearing.
    load
        Load W that the pressure of the film carries [N].
    attitude
        Attitude angle, from the load line to the line of centres in direction of rotation [rad];
        None for a centred shaft or a film without pressure.
    max_pressure
        Peak oil film pressure (POFP) [Pa].
    max_pressure_angle
        Angle of the peak from the maximum film in direction of rotation, 0..2 pi [rad].
    min_film_thickness
        Minimum oil film thickness (MOFT) [m].
    eccentricity_ratio
        Eccentricity ratio e / c at mid-width [-].
    sommerfeld_number
        ``eta N / p (R / c)^2``, with the sum N of the speeds of shaft and bore in revolutions per
        second, and ``p = W / (2 R B)`` [-].
    friction_torque
        Torque of the film on the shaft about its axis, positive if it brakes the shaft [N m].
    power_loss
        Mechanical power that shaft and bore transfer to the film [W].
    dissipation
        Power that becomes heat: mechanical power, plus the power of oil supplied under pressure,
        minus the power of oil that flows out against an ambient pressure [W].
    tilting_moment
        Moment of pressure and contact on the shaft, about x and y at mid-width, shape (2,) [N m].
    flow
        Flows through sides, supplies and cavities [m3/s].
    contact
        Results on the contact of rough surfaces; None for smooth surfaces.
    coefficients
        Stiffness, damping and stability; None if they were not requested.
    heat
        Temperatures from the heat balance; None without a supply temperature.
    position
        Eccentricity of the journal, x along the load, shape (2,) [m].
    film, state
        Film, and its solution.
    angle
        Angle from the load line to the x axis of the film's frame [rad].
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

    def described(self) -> Iterator[tuple[str, str]]:
        """Yield size, load, film, pressure, losses, and coefficients with their scatter."""
        settings = self.settings
        yield (
            "Bearing",
            f"radius {1e3 * settings.radius:.5g} mm, width {1e3 * settings.width:.5g} mm, "
            f"clearance {1e6 * settings.clearance:.5g} um, {settings.speed:.5g} rad/s",
        )
        yield "load", f"{self.load:.5g} N, eccentricity ratio {self.eccentricity_ratio:.4g}"
        if self.attitude is not None:
            yield "attitude", f"{np.degrees(self.attitude):.4g} degrees"
        yield "min_film_thickness", f"{1e6 * self.min_film_thickness:.4g} um"
        yield "max_pressure", f"{1e-6 * self.max_pressure:.4g} MPa"
        yield (
            "losses",
            f"friction torque {self.friction_torque:.4g} N m, power {self.power_loss:.4g} W",
        )
        yield "side flow", f"{1e6 * self.flow.side:.4g} cm3/s"
        if self.heat is not None:
            yield "temperature", f"{self.heat.effective_temperature:.4g} C of the film"
        if self.contact is not None:
            yield "contact", f"{self.contact.load:.4g} N, share {self.contact.share:.3g}"
        if self.coefficients is not None:
            yield from [*self.coefficients.described()][1:]

    def plot(self) -> Figure:
        """Draw pressure over the bore, pressure and film at mid-width, and the journal in it."""
        from fenics_ehd import plot

        return plot(self)

    @property
    def friction_coefficient(self) -> float | None:
        """Coefficient of friction: friction torque over load and radius of the bore [-]."""
        return self.friction_torque / (self.settings.radius * self.load) if self.load else None


def bearing_result(
    bearing: Bearing,
    *,
    eccentricity: float | None = None,
    load: float | None = None,
    with_coefficients: bool = False,
) -> BearingResult:
    """Compute the operating point of a bearing.

    Parameters
    ----------
    bearing
        The bearing.
    eccentricity, load
        Eccentricity ratio in 0..1 or load [N], exactly one of them.
    with_coefficients
        Whether stiffness, damping and the stability threshold are computed.

    Raises
    ------
    SettingsError
        A value is outside its limits, or there is no equilibrium.
    HeatError
        The oil cannot carry away the heat.
    CavitationError
        The film could not be solved.
    ViscosityError
        Pressure and viscosity grow without bound, or faster than the cells resolve.
    VerificationError
        A result is not a finite number.
    """
    if (eccentricity is None) == (load is None):
        raise SettingsError("exactly one of eccentricity and load must be given")
    if eccentricity is not None and not 0 <= require_number("eccentricity", eccentricity) < 1:
        raise SettingsError(
            f"eccentricity = {eccentricity:g} must be at least 0 and below 1 (of the clearance)"
        )
    if load is not None and not 0 < require_number("load", load):
        raise SettingsError(f"load = {load:g} N must be a finite number above 0")

    def solve(at_temperature: Bearing) -> OperatingPoint:
        if load is not None:
            return _at_load(at_temperature, load)
        assert eccentricity is not None
        return _at_eccentricity(at_temperature, eccentricity)

    # Results that overflow are refused below.
    with np.errstate(all="ignore"):
        heat = None
        if bearing.settings.heated:
            heat, point = _with_balanced_heat(bearing, solve)
        else:
            point = solve(bearing)
        _require_resolved(point)
        result = _result(point, with_coefficients, heat)
    _require_finite_figures(result)
    return result


def _require_finite_figures(result: BearingResult) -> None:
    """Refuse a result that is not a finite number; results that are None are accepted.

    Raises
    ------
    VerificationError
        Some results are not finite; the message names all of them.
    """
    unknown = []
    for part in (result, result.flow, result.contact, result.coefficients, result.heat):
        figures = {} if part is None else vars(part)
        for name, value in figures.items():
            if isinstance(value, float | np.ndarray) and not np.isfinite(value).all():
                unknown.append(name)
    if unknown:
        raise VerificationError(
            f"{', '.join(unknown)}: not a finite number: check whether radius, clearance, width, "
            "viscosity, speed and pressures are those of a bearing"
        )


def _require_resolved(point: OperatingPoint) -> None:
    """Refuse a solution in which the viscosity varies too much within a cell of the film mesh."""
    steepest = steepest_thickening(point.meshed.film, point.state.pressure)
    if not steepest <= MOST_WITHIN_A_CELL:
        raise ViscosityError(
            f"the viscosity grows by a factor of {steepest:.3g} within a film cell, above the "
            f"limit of {MOST_WITHIN_A_CELL:g}: use more cells; if that does not help, pressure and "
            "viscosity grow without bound: lower load, eccentricity, barus or roelands"
        )


def _tilting_moment(point: OperatingPoint) -> np.ndarray:
    """Moment of pressure and contact on the shaft, x along the load, shape (2,) [N m]."""
    film = point.meshed.film
    joint = point.joint
    area = film.parameters.grid.radius**2 * film.assembly.area
    pressing = area * film.assembly.at_points(joint.pressure)[0]
    if joint.contact is not None:
        pressing += (joint.contact.area * joint.touch.pressure).reshape(area.shape)
    x, y = film.points.normal * film.points.height * pressing
    return np.asarray(rotation(point.meshed.angle) @ np.array([y.sum(), -x.sum()]))


def _result(
    point: OperatingPoint, with_coefficients: bool, heat: BearingHeat | None
) -> BearingResult:
    """Results of a bearing at an operating point, without heat balance and coefficients."""
    position = point.position
    settings = point.meshed.settings
    film = point.meshed.film
    joint = point.joint
    load = float(np.hypot(*point.force_on_bore)) if point.carries else 0.0
    pressure, pressure_angle = _peak(point)
    # Load for which the Sommerfeld number is 1.
    stress = film.parameters.lubricant.viscosity * abs(settings.entrainment) / (2 * np.pi)
    unit = 2 * settings.width * stress * settings.radius**3 / settings.clearance**2
    return BearingResult(
        settings=settings,
        load=load,
        attitude=direction_of(position) if load and position.any() else None,
        max_pressure=pressure,
        max_pressure_angle=pressure_angle,
        min_film_thickness=min_film_thickness(joint),
        eccentricity_ratio=float(np.hypot(*position)) / settings.clearance,
        sommerfeld_number=unit / load if load else None,
        # 0.0 + x turns a negative zero into zero.
        friction_torque=0.0 + joint.braking,
        power_loss=0.0 + film_power(joint),
        dissipation=joint.dissipated,
        tilting_moment=_tilting_moment(point),
        flow=joint.flows.balance,
        contact=_contact(point, load),
        coefficients=_coefficients(point, load) if with_coefficients else None,
        heat=heat,
        position=position,
        film=film,
        state=point.state,
        angle=point.meshed.angle,
    )


def _contact(point: OperatingPoint, load: float) -> ContactFigures | None:
    """Results on the contact of rough surfaces at an operating point; None for smooth surfaces."""
    joint = point.joint
    if joint.contact is None:
        return None
    force = float(np.hypot(*joint.contact.forces(joint.touch, joint.state.gap)[:2]))
    share = force / load if load else 0.0
    return ContactFigures(force, share, max_contact_pressure(joint), joint.rubbed)


def _peak(point: OperatingPoint) -> tuple[float, float | None]:
    """Peak pressure, interpolated between nodes [Pa], and its angle from the maximum film [rad]."""
    joint = point.joint
    scale = point.meshed.film.parameters.pressure_scale
    if not float(joint.pressure.max()) > NO_PRESSURE * scale:
        return 0.0, None
    (highest,), (angle,), _ = joint.rows.largest(joint.pressure[None])
    if not point.position.any():
        return float(highest), None
    centre = direction_of(point.position) - point.meshed.angle
    return float(highest), float(np.mod(angle - centre - np.pi, 2 * np.pi))
