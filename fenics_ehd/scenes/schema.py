"""What a scene file may say: bodies, joints, drives, forces, lubricants, time, output.

One settings class for every kind of entry; the docstrings and help texts are the reference.
Angles are counted from the x axis, positive from x to y, and a body's angle is that of its own x
axis; a crank whose pin lies on its x axis has its outer (top) dead centre, for a piston on the
positive x axis, at angle 0.

Longer than other modules: it is one list, in the order of the reference that is made of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import attrs

from fenics_ehd.base import quantities
from fenics_ehd.base.fields import (
    choice,
    count,
    flag,
    number,
    numbers,
    option,
    rows,
    section,
    text,
)
from fenics_ehd.base.oil import NO_TEMPERATURE, OilSettings
from fenics_ehd.base.quantities import LARGEST_LENGTH, deviation, metres, radial_clearance
from fenics_ehd.bearing.settings import SHEAR_RULES
from fenics_ehd.scenes import part_settings
from fenics_ehd.scenes.fields import NONE, REQUIRED, film_cells, names, pair, place, places
from fenics_ehd.scenes.supply_settings import supplies

INTERPOLATIONS = ("cubic", "linear")
BASES = ("angle", "time")
CAVITATIONS = ("reynolds", "mass-conserving")
AMBIENTS = ("air", "oil")


@attrs.frozen
class GroundSettings:
    """The frame at rest; it is there without being listed."""

    points: dict = places("points of the frame at rest [m]")


@attrs.frozen
class MovingSettings:
    """Where a body's origin and angle are at the start, roughly: assembly closes the joints."""

    position: tuple[float, float] = place("origin at the start, roughly [m]")
    angle: float = number(0.0, "at the start, of the body's x axis from x, + from x to y [degrees]")
    velocity: tuple[float, float] = pair("of the origin at the start, where nothing gives it [m/s]")
    speed: float = quantities.speed(
        0.0, "of the angle at the start, where no drive gives it [rad/s]"
    )


@attrs.frozen
class MasslessSettings(MovingSettings):
    """A rigid body without mass, as a journal under a given load."""

    points: dict = places("points in the body's frame [m]")


@attrs.frozen(kw_only=True)
class RigidSettings(MasslessSettings):
    """A rigid body."""

    mass: float = quantities.mass(REQUIRED, "[kg]", 100)
    inertia: float = number(
        0.0,
        "about the centre of mass [kg m2]",
        least=0,
        usual=(1e-8, 1e4),
        example="1e-3 for 10 kg cm2",
    )
    centre: tuple[float, float] = place("centre of mass in the body's frame [m]")


@attrs.frozen
class MaterialSettings:
    """Of an elastic part."""

    youngs_modulus: float = quantities.youngs_modulus(210e9)
    poissons_ratio: float = number(
        0.3, "[-]; quadratic elements lock above 0.49", above=-1, below=0.49
    )
    density: float = quantities.density(7850.0)


@attrs.frozen
class FlexibleSettings(MovingSettings):
    """An elastic part with lubricated bores, meshed and reduced, or reduced before.

    Its origin is the centre of its first bore; a bore is a point, `bore` if no other is named.
    """

    model: str = text(NONE, "shipped model, or a .geo file, which is a program, or .msh")
    body: str = text(NONE, "HDF5 file of the reduced part, in place of a model")
    bores: tuple[str, ...] = names("surfaces that films bend, the first one's axis is z", ("bore",))
    points: tuple[str, ...] = names("surfaces of the model whose mean places are points")
    held_by: str = text(NONE, "surface of the model that does not move, or none")
    cells: str = choice(
        "hex", part_settings.CELLS, "of a model that can give either: hexahedra, 10-node tetrahedra"
    )
    element: str = choice("serendipity", part_settings.ELEMENTS, "of hexahedra, 20- or 27-node")
    damping_time: float = number(
        0.0, "zeta of D = zeta K [s]", least=0, usual=(1e-12, 0.1), example="1e-3 for 1 ms"
    )
    mass: float = quantities.mass(0.0, "in place of the model's [kg], 0: the model's", 1e4)
    inertia: float = number(
        0.0, "in place of the model's, about the centre of mass [kg m2], 0: the model's", least=0
    )
    centre: tuple[float, float] = place(
        "centre of mass from the bore in place of the model's [m], [0, 0]: the model's"
    )
    material: MaterialSettings = section(MaterialSettings)
    geometry: dict = numbers("parameters of the Gmsh model by name, lengths in [m]")
    reduction: part_settings.ReductionSettings = section(part_settings.ReductionSettings)


@attrs.frozen
class ShaftSettings:
    """An elastic shaft of Bernoulli beam elements, reduced to modes; its points tilt."""

    position: tuple[float, float] = place("of the undeformed axis [m]")
    angle: float = number(0.0, "at the start [degrees]")
    speed: float = quantities.speed(0.0, "at the start, where no drive gives it [rad/s]")
    length: float = metres(1.0, "[m]", below=100)
    diameter: float = metres(0.045, "[m]", below=2 * LARGEST_LENGTH)
    youngs_modulus: float = quantities.youngs_modulus(210e9)
    density: float = quantities.density(7850.0)
    elements: int = count(20, "beam elements, of equal length", least=1)
    modes: int = count(20, "modes kept, half of them in either plane: an even number", least=2)
    damping_ratio: float = number(1e-3, "zeta of every mode [-]", least=0, below=1)
    support_stiffness: float = number(
        1.58e8,
        "of a spring at either end [N/m], 0: carried by its bearings alone",
        least=0,
        usual=(1e4, 1e13),
        example="1e8 for 100 N/um",
    )
    disks: tuple[tuple[float, ...], ...] = rows(
        ("position", "mass", "polar_inertia", "diametral_inertia"),
        "rigid disks [share of the length, kg, kg m2 about the axis, kg m2 about a diameter]",
        ("", "kg", "kg m2", "kg m2"),
    )
    points: dict = numbers("points by name, share of the length from one end, 0 to 1")


@attrs.frozen(kw_only=True)
class RevoluteSettings:
    """Two points that stay together and turn freely."""

    between: tuple[str, ...] = names("the points, ground.hook or crank (its origin)", REQUIRED,
                                     count=2)  # fmt: skip


@attrs.frozen(kw_only=True)
class FixedSettings(RevoluteSettings):
    """Two points that stay together and do not turn."""

    angle: float = number(0.0, "of the second body ahead of the first [degrees]")


@attrs.frozen(kw_only=True)
class SliderSettings:
    """A point on a line of another body."""

    line: str = text(REQUIRED, "point through which the line goes, fixed to its body")
    point: str = text(REQUIRED, "point that stays on the line")
    direction: tuple[float, float] = pair("of the line in the frame of its body", (1.0, 0.0))
    hold_rotation: bool = flag(True, "whether the bodies keep their relative angle")
    angle: float = number(0.0, "held, of the point's body ahead of the line's [degrees]")


@attrs.frozen
class ContactSettings:
    """Rough surfaces of a journal and its bore, which may touch; smooth without a roughness."""

    journal_roughness: float = quantities.roughness("of the journal, rms [m], 0: smooth")
    bore_roughness: float = quantities.roughness("of the bore, rms [m], 0: smooth")
    asperity_product: float = number(
        0.04, "asperities per area x their radius x combined roughness [-]", above=0, below=1
    )
    asperity_slenderness: float = number(
        1e-3, "combined roughness over radius of the asperities [-]", above=0, below=1
    )
    asperity_density: float = number(
        0.0, "per area, with asperity_radius in place of both [1/m2], 0: not given", least=0
    )
    asperity_radius: float = number(0.0, "of their tips [m], 0: not given", least=0, below=1e-2)
    summit_offset: float = quantities.summit_offset()
    journal_modulus: float = quantities.youngs_modulus(210e9)
    journal_poissons_ratio: float = number(0.3, "[-]", above=-1, below=0.5)
    bore_modulus: float = number(
        0.0,
        "[Pa], 0: that of the flexible body's material, of another bore 210e9",
        least=0,
        below=1e18,
        usual=(1e9, 2e12),
        example="70e9 for 70 GPa",
    )
    bore_poissons_ratio: float = number(
        0.3, "[-], where bore_modulus is given", above=-1, below=0.5
    )
    boundary_friction: float = number(
        0.1, "coefficient of friction of asperities that touch [-], with friction", least=0, below=5
    )
    flow_factors: bool = flag(
        True, "whether oil flows as Patir and Cheng have it, or as in a smooth average gap"
    )


@attrs.frozen
class ShapeSettings:
    """How far the surface of a bore or a journal lies outside the round one, + outward.

    In the frame of its body, which a journal's shape turns with; what is given adds up.
    """

    ovality: float = deviation("amplitude of a wave around [m]")
    ovality_angle: float = number(0.0, "where it is outermost, from the body's x axis [degrees]")
    lobes: int = count(2, "waves in a turn", least=1, most=100)
    barrel: float = deviation("at both ends, 0 at mid-width, a parabola; crowned journal: - [m]")
    taper: float = deviation("at the upper end, minus that at the lower one, linear [m]")
    misalignment: tuple[float, float] = pair("tilt of the axis about x and y [rad]", below=0.1)
    table: str = text(NONE, "CSV file angle_deg,height_m,deviation_m of more, or none")


@attrs.frozen(kw_only=True)
class HeatSettings:
    """Balance of a film's heat over a cycle; needs time.periodic and an oil by grade or like it."""

    supply_temperature: float = number(
        REQUIRED,
        "of the oil that comes in [C]",
        above=NO_TEMPERATURE,
        below=1000,
        usual=(1, 200),
        example="80 for 353 K",
    )
    conducted: float = number(
        0.0, "share of the dissipated power that journal and bore conduct away", least=0, below=1
    )
    mixing: float = number(
        0.5, "where the effective temperature lies between supply, 0, and outlet, 1", above=0
    )
    tolerance: float = number(
        0.1, "largest difference of the effective temperature from its balance [K]", above=0
    )


@attrs.frozen(kw_only=True)
class LubricatedSettings:
    """The journal of one body in the bore of another."""

    journal: str = text(REQUIRED, "point of the body with the journal, crank.pin")
    bore: str = text(REQUIRED, "point of the body with the bore; of a flexible one: rod.bore")
    clearance: float = radial_clearance(REQUIRED)
    lubricant: str = text(NONE, "name in [lubricants], or none and a viscosity")
    viscosity: float = number(
        0.0,
        "of a lubricant without a name [Pa s]",
        least=0,
        below=1e6,
        usual=(1e-5, 1.0),
        example="0.01 for 10 mPa s",
    )
    radius: float = number(0.0, "of the bore [m]; 0: a flexible bore's own", least=0,
                           below=LARGEST_LENGTH)  # fmt: skip
    width: float = number(0.0, "of the bore [m]; 0: a flexible bore's own", least=0,
                          below=LARGEST_LENGTH)  # fmt: skip
    cells: tuple[int, ...] = film_cells(
        "film cells around and along, [40, 10]; empty: a flexible bore's own, 20 x 5 of a rigid"
    )
    element: str = choice(
        "lagrange", part_settings.FILM_ELEMENTS, "9-node (lagrange), 8-node or bilinear"
    )
    transfer: str = choice(
        "conservative", part_settings.TRANSFERS, "of pressures to a bore with another mesh"
    )
    ambient_pressure: float = number(
        0.0,
        "at both sides, above that at which the film cavitates [Pa]",
        least=0,
        usual=(1e3, 1e9),
        example="1e5 for 1 bar",
    )
    grooves: tuple[tuple[float, ...], ...] = rows(
        ("angle", "width", "pressure"),
        "axial grooves in the bore [angle from its x axis in degrees, width in degrees, Pa]",
        ("degrees", "degrees", "Pa"),
    )
    supply: dict = supplies("holes and grooves of bore or journal that feed the film")
    cavitation: str = choice(
        "reynolds", CAVITATIONS,
        "reynolds, or mass-conserving: the film keeps account of its oil; needs bilinear elements",
    )  # fmt: skip
    initial_filling: float = number(
        1.0, "share of the gap that holds oil at the start (mass-conserving)", least=0
    )
    ambient: str = choice(
        "air", AMBIENTS,
        "around sides without ambient_pressure: air, or oil beside them (mass-conserving)",
    )  # fmt: skip
    friction: bool = flag(False, "whether the oil's shear acts on the bodies")
    shear_rule: str = choice(
        "streamers", SHEAR_RULES, "oil that is sheared where the film cavitates"
    )
    smallest_film: float = number(
        0.01,
        "film thickness at which the run ends, share of the clearance; none with contact",
        least=0,
        below=1,
    )
    eccentricity: tuple[float, float] = pair(
        "of the journal in the bore's frame at the start, share of the clearance", below=1.0
    )
    eccentricity_rate: tuple[float, float] = pair("its rate [m/s]")
    contact: ContactSettings = section(ContactSettings)
    bore_shape: ShapeSettings = section(ShapeSettings)
    journal_shape: ShapeSettings = section(ShapeSettings)
    heat: HeatSettings | None = option(HeatSettings)


@attrs.frozen(kw_only=True)
class SpeedSettings:
    """A body's angle turns at a given speed, from the body's angle at the start on."""

    speed: float = quantities.speed(0.0, "constant [rad/s]")
    table: str = text(NONE, "in its place: CSV file time_s,speed_rad_per_s, or none")


@attrs.frozen
class TorqueSettings:
    """A torque turns a body, from the body's angle and speed at the start on."""

    torque: float = number(0.0, "constant part, + in the sense of the angle [N m]")
    table: str = text(NONE, "more torque: CSV file angle_deg,torque_Nm or time_s,torque_Nm")
    over: str = choice("angle", BASES, "what the table is over, the body's own angle or time")
    damping: float = number(0.0, "more torque per speed below the given one [N m s/rad]", least=0)
    speed: float = quantities.speed(0.0, "the given one [rad/s]")


@attrs.frozen(kw_only=True)
class ConstantForceSettings:
    """A force that stays the same in the frame at rest."""

    point: str = text(REQUIRED, "where it acts, piston or rod.pin")
    force: tuple[float, float] = pair("[N]", REQUIRED)


@attrs.frozen(kw_only=True)
class TimeTableSettings:
    """A force over time, over and over."""

    point: str = text(REQUIRED, "where it acts")
    file: str = text(REQUIRED, "CSV file time_s,Fx_N,Fy_N, or a shipped table: main-bearing")
    scale: float = number(1.0, "factor on the forces", above=0, below=1e9)
    interpolation: str = choice("cubic", INTERPOLATIONS, "periodic, between the rows")
    period: float = number(
        0.0, "[s]; 0: the last time of the file, whose force is the first", least=0
    )


@attrs.frozen(kw_only=True)
class AngleTableSettings:
    """A force along a line at rest over a body's angle, over and over."""

    point: str = text(REQUIRED, "where it acts")
    file: str = text(REQUIRED, "CSV file angle_deg,force_N over 360 or 720 degrees, or "
                     "a shipped table: gas-force")  # fmt: skip
    angle_of: str = text(REQUIRED, "body whose angle the table is over, from x, + from x to y")
    direction: tuple[float, float] = pair("of a positive force, in the frame at rest", (-1.0, 0.0))
    scale: float = number(1.0, "factor on the forces", above=0, below=1e9)


@attrs.frozen(kw_only=True)
class RotatingSettings:
    """A force that turns at constant speed, along x at time zero."""

    point: str = text(REQUIRED, "where it acts, shaft.disk")
    amplitude: float = number(
        REQUIRED, "[N]", above=0, usual=(1e-3, 1e8), example="3600 for 3.6 kN"
    )
    speed: float = quantities.speed(REQUIRED, "[rad/s]")
    ramp: float = number(0.0, "time over which it grows [s], 0: there from the start", least=0)


@attrs.frozen(kw_only=True)
class SpringDamperSettings:
    """A spring and a damper between two points, the same in all directions of the plane."""

    between: tuple[str, ...] = names("the points", REQUIRED, count=2)
    stiffness: float = number(0.0, "[N/m]", least=0, below=1e18)
    damping: float = number(0.0, "[N s/m]", least=0, below=1e18)


@attrs.frozen
class GravitySettings:
    """The weight of every body."""

    acceleration: tuple[float, float] = pair("[m/s2]", (0.0, -9.81))


@attrs.frozen
class TimeSettings:
    """How long, and in which steps."""

    end: float = number(0.0, "[s]; 0: as revolutions say", least=0)
    revolutions: float = number(
        0.0, "to simulate, or in a period; 0: as end or period say", least=0
    )
    of: str = text("crank", "body whose revolutions count, at its speed at the start")
    periodic: bool = flag(False, "whether cycles are run until the films repeat")
    period: float = number(0.0, "of all drives and forces [s]; 0: as revolutions say", least=0)
    periodicity: float = number(
        1e-4, "largest change of a film from cycle to cycle, relative", above=0, below=1
    )
    cycles: int = count(20, "to give up after", least=1)
    tolerance: float = number(
        1e-5, "local error of a step, relative change of the gap", above=1e-12, below=1
    )
    order: int = count(
        3,
        "of the backward differentiation formula, 1 to 3; 2 for 3 where modes lack damping or oil "
        "is conserved",
        least=1,
        most=3,
    )
    first_step: float = number(1e-8, "[s]; the film builds up from zero eccentricity", above=0)
    smallest_step: float = number(1e-13, "[s]", above=0)
    largest_step: float = number(
        0.02, "share of a revolution where those are given, else of end or period",
        above=0, below=1,
    )  # fmt: skip


@attrs.frozen
class OutputSettings:
    """What a run writes beside history and summary."""

    plots: bool = flag(True, "curves as pictures")
    error_budget: bool = flag(True, "whether the run says what its figures are worth")
    error_limit: float = number(
        0.2,
        "largest estimated error of a peak pressure or thinnest film of a run that is complete; "
        "above it the run is untrustworthy",
        above=0,
        example="0.1 for 10 %",
    )
    part_mesh_error: bool = flag(
        True, "whether parts are meshed again, more finely, to know what their meshes are worth"
    )
    accuracy: float = number(
        0.0,
        "that estimated errors of peak pressures and thinnest films must meet: meshes, steps and "
        "modes are chosen for it, 0: as written",
        least=0,
        below=0.5,
        usual=(1e-3, 0.1),
        example="0.01 for 1 %",
    )
    accuracy_keeps: tuple[str, ...] = names(
        "keys that stay as written, of those that accuracy chooses: tolerance, joints.pin.cells"
    )
    paraview: bool = flag(False, "ParaView series of bodies and films")
    frames: int = count(60, "of the series", least=2)


#: Class of an entry by its table and kind.
KINDS: Mapping[str, Mapping[str, type]] = MappingProxyType(
    {
        "bodies": {
            "rigid": RigidSettings,
            "flexible": FlexibleSettings,
            "shaft": ShaftSettings,
            "massless": MasslessSettings,
        },
        "joints": {
            "revolute": RevoluteSettings,
            "fixed": FixedSettings,
            "slider": SliderSettings,
            "lubricated": LubricatedSettings,
        },
        "drives": {"speed": SpeedSettings, "torque": TorqueSettings},
        "forces": {
            "constant": ConstantForceSettings,
            "time-table": TimeTableSettings,
            "angle-table": AngleTableSettings,
            "rotating": RotatingSettings,
            "spring-damper": SpringDamperSettings,
            "gravity": GravitySettings,
        },
        "lubricants": {"oil": OilSettings},
    }
)
