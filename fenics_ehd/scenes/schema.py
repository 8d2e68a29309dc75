"""Schema of scene files: bodies, joints, drives, forces, lubricants, supplies, output.

Every kind of entry has one settings class. The reference of settings consists of the docstrings and
help texts of these classes.
Angles are measured from the x axis, positive from x to y. A body's angle is that of its own x
axis. A crank whose pin lies on its x axis has its outer (top) dead centre at angle 0, if the
piston is on the positive x axis.

This module is longer than others, because the reference of settings is made from it as one list, in
the same order.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil
from typing import Any

import attrs

from fenics_ehd.base import fields as quantities
from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.fields import (
    INTERPOLATIONS,
    REQUIRED,
    TRANSFERS,
    checked,
    choice,
    count,
    entries,
    flag,
    metres,
    names,
    number,
    numbers,
    option,
    pair,
    place,
    places,
    radial_clearance,
    rows,
    section,
    text,
)
from fenics_ehd.base.needs import NONE, not_with, only_with
from fenics_ehd.base.settings import keys_excluded_by
from fenics_ehd.base.shared_settings import (
    ROUGH,
    Deviations,
    Material,
    OilSettings,
    Roughness,
    only_if_rough,
)
from fenics_ehd.film.heat import Heat
from fenics_ehd.film.supply import (
    AMBIENTS,
    AxialGrooveSupply,
    CircumferentialGrooveSupply,
    HoleSupply,
)
from fenics_ehd.multibody.body import MasslessBody, Pose, RigidBody
from fenics_ehd.multibody.forces import RotatingForce, SpringDamper, Torque, Unbalance
from fenics_ehd.multibody.joints import Fixed, Revolute, Slider, Speed
from fenics_ehd.multibody.shaft import ShaftBody
from fenics_ehd.scenes.part_settings import (
    CELLS,
    ELEMENTS,
    ReductionSettings,
)

#: Least numbers of film cells around and along: with 3 around, the peak pressure is 12 % too low.
FEWEST_CELLS = (8, 2)

#: Largest number of film cells, around times along, for the memory of a usual computer.
MOST_CELLS = 200_000


def film_cells(help_text: str) -> Any:
    """Field for the numbers of cells of a film mesh, around and along, or an empty list."""

    def check(name: str, value: Any) -> None:
        setting = f"{name} = {list(value)!r}"
        if value and (len(value) != 2 or any(type(n) is not int or n <= 0 for n in value)):
            raise SettingsError(f"{setting} must be two whole numbers above 0, or empty")
        if any(n < fewest for n, fewest in zip(value, FEWEST_CELLS, strict=False)):
            raise SettingsError(
                f"{setting} must be at least {list(FEWEST_CELLS)}: coarser films are inaccurate"
            )
        if value and value[0] * value[1] > MOST_CELLS:
            raise SettingsError(
                f"{setting}: {value[0] * value[1]} cells are above the limit of {MOST_CELLS}"
            )

    return checked(
        (),
        help_text,
        check,
        lambda value: tuple(value) if isinstance(value, (list, tuple)) else (value,),
    )


#: Revolutions in a cycle of an engine, by words for it.
STROKES: Mapping[str, float] = {"two-stroke": 1.0, "four-stroke": 2.0}

SUPPLIES: Mapping[str, type] = {
    "hole": HoleSupply,
    "axial-groove": AxialGrooveSupply,
    "circumferential-groove": CircumferentialGrooveSupply,
}


@attrs.frozen
class GroundSettings(Described):
    """The frame at rest, which every scene has, even if the scene file does not list it."""

    points: dict = places("points of the frame at rest [m]")


#: Step of the numbers of cells around a bore of the shipped models.
AROUND = 10

#: Relative round-off up to which a number of cells is not rounded up.
ROUNDING = 1e-9


@attrs.frozen
class FlexibleSettings(Pose):
    """An elastic part with lubricated bores, meshed and reduced, or read from a file.

    Its origin is the centre of its first bore. Each bore is also a point of the body; the default
    name of a bore is `bore`.
    """

    model: str = text(NONE, "shipped model, .msh file, or .geo file, which is a program")
    body: str = text(NONE, "HDF5 file of the reduced part, used instead of a model")
    bores: tuple[str, ...] = names(
        "surfaces that are loaded by films; the axis of the first is z", ("bore",)
    )
    points: tuple[str, ...] = not_with(
        names("surfaces of the model whose mean positions are points"), "body"
    )
    clamped: str = not_with(text(NONE, "surface of the model that is held at rest"), "body")
    cells: str = not_with(
        choice("hex", CELLS, "cells of a model that has a choice: hexahedra, 10-node tetrahedra"),
        "body",
    )
    element: str = only_with(
        not_with(choice("serendipity", ELEMENTS, "hexahedra with 20 or 27 nodes"), "body"),
        "cells",
        among=("hex",),
    )
    damping_time: float = number(
        0.0,
        "factor zeta of the damping D = zeta K [s]",
        least=0,
        usual=(1e-12, 0.1),
        example="1e-3 for 1 ms",
    )
    mass: float = not_with(
        quantities.mass(0.0, "mass that replaces the model's [kg], 0: model's", 1e4), "clamped"
    )
    inertia: float = not_with(
        number(
            0.0,
            "moment of inertia about the centre of mass that replaces the model's [kg m2], "
            "0: model's",
            least=0,
            usual=(1e-8, 1e4),
            example="1e-3 for 10 kg cm2",
        ),
        "clamped",
    )
    centre: tuple[float, float] = not_with(
        place("centre of mass from the bore that replaces the model's [m], [0, 0]: model's"),
        "clamped",
    )
    material: Material = not_with(section(Material), "body")
    geometry: dict = not_with(
        numbers("parameters of the Gmsh model by name, lengths in [m]"), "body"
    )
    reduction: ReductionSettings = not_with(section(ReductionSettings), "body")

    @property
    def idle(self) -> tuple[str, ...]:
        """Keys that have no effect, because the reduced part is read from a file."""
        return () if self.body == NONE else keys_excluded_by(type(self), "body")

    @property
    def cell_counts(self) -> tuple[str, ...]:
        """Names of the given model parameters that are numbers of cells."""
        return tuple(filter(quantities.is_cell_count, self.geometry))

    def geometry_of(self, factor: float) -> dict[str, float]:
        """Parameters of the model, with numbers of cells multiplied by a factor and rounded up."""
        geometry = dict(self.geometry)
        for key in self.cell_counts:
            step = AROUND if "around" in key else 1
            geometry[key] = step * ceil(int(geometry[key]) * factor / step - ROUNDING)
        return geometry


@attrs.frozen(kw_only=True)
class ContactSettings(Roughness):
    """Roughness and contact of a journal and its bore; surfaces without a roughness are smooth."""

    asperity_density: float = only_with(
        only_if_rough(
            number(
                0.0,
                "asperities per area [1/m2]; with asperity_radius it replaces asperity_product and "
                "asperity_slenderness, 0: not used",
                least=0,
            )
        ),
        "asperity_radius",
    )
    asperity_radius: float = only_with(
        only_if_rough(number(0.0, "radius of asperity tips [m], 0: not used", least=0, below=1e-2)),
        "asperity_density",
    )
    journal_modulus: float = only_if_rough(quantities.youngs_modulus(210e9))
    journal_poissons_ratio: float = only_if_rough(
        number(0.3, "Poisson's ratio of the journal [-]", above=-1, below=0.5)
    )
    bore_modulus: float = only_if_rough(
        number(
            0.0,
            "Young's modulus of the bore [Pa], 0: that of the flexible body, 210e9 for others",
            least=0,
            below=1e18,
            usual=(1e9, 2e12),
            example="70e9 for 70 GPa",
        )
    )
    bore_poissons_ratio: float = only_with(
        only_if_rough(number(0.3, "Poisson's ratio of the bore [-]", above=-1, below=0.5)),
        "bore_modulus",
    )


@attrs.frozen(kw_only=True)
class LubricatedSettings(Described):
    """A lubricated joint: the journal of one body in the bore of another."""

    journal: str = text(REQUIRED, "point on the axis of the journal, crank.pin")
    bore: str = text(REQUIRED, "point on the axis of the bore, or a flexible bore, rod.bore")
    clearance: float = radial_clearance(REQUIRED)
    lubricant: str = text(NONE, "name in [lubricants], or none if a viscosity is given")
    viscosity: float = quantities.viscosity(0.0, "viscosity, if no lubricant is named [Pa s]")
    radius: float = metres(0.0, "radius of the bore [m]; 0: that of the flexible bore")
    width: float = metres(0.0, "width of the bore [m]; 0: that of the flexible bore")
    cells: tuple[int, ...] = film_cells(
        "film cells around and along, 40 and 10; empty: as the flexible bore, or 20 x 5 if rigid"
    )
    element: str = quantities.film_element()
    transfer: str = choice(
        "conservative", TRANSFERS, "method to transfer pressures to a bore with another mesh"
    )
    ambient_pressure: float = quantities.ambient_pressure()
    grooves: tuple[tuple[float, ...], ...] = rows(
        ("angle", "width", "pressure"),
        "axial grooves in the bore [angle from its x axis in degrees, width in degrees, Pa]",
        ("degrees", "degrees", "Pa"),
    )
    supply: dict = entries("holes and grooves in bore or journal that feed the film", SUPPLIES)
    cavitation: str = quantities.cavitation()
    initial_filling: float = only_with(
        number(
            1.0,
            "fraction of the gap filled with oil at the start (mass-conserving)",
            least=0,
            most=1,
        ),
        "cavitation",
        among=("mass-conserving",),
    )
    ambient: str = not_with(only_with(choice(
        "air", AMBIENTS,
        "what surrounds the sides if ambient_pressure is 0: air or oil (mass-conserving)",
    ), "cavitation", among=("mass-conserving",)), "ambient_pressure", notice=True)  # fmt: skip
    friction: bool = flag(
        False, "whether the shear stress of the oil acts on the bodies; it is reported anyway"
    )
    shear_rule: str = quantities.shear_rule()
    smallest_film: float = not_with(
        number(
            0.01,
            "film thickness at which the run stops, over the clearance; up to 0.01 the limit is at "
            "most 0.2 um; not used with contact",
            least=0,
            below=1,
        ),
        "contact.roughness",
        words=f"contact.{ROUGH}",
        notice=True,
    )
    eccentricity: tuple[float, float] = pair(
        "eccentricity of the journal in the bore's frame at the start, over the clearance",
        below=1.0,
    )
    eccentricity_rate: tuple[float, float] = pair("rate of the eccentricity at the start [m/s]")
    contact: ContactSettings = section(ContactSettings)
    bore_shape: Deviations = section(Deviations)
    journal_shape: Deviations = section(Deviations)
    heat: Heat | None = option(Heat)


@attrs.frozen(kw_only=True)
class ConstantForceSettings:
    """A constant force in the frame at rest."""

    point: str = text(REQUIRED, "point on which the force acts, piston or rod.pin")
    force: tuple[float, float] = pair("components of the force [N]", REQUIRED, zero=False)


@attrs.frozen(kw_only=True)
class TimeTableSettings:
    """A periodic force, given by a table over time."""

    point: str = text(REQUIRED, "point on which the force acts")
    file: str = text(REQUIRED, "CSV file time_s,Fx_N,Fy_N, or a shipped table: main-bearing")
    scale: float = number(1.0, "factor on the forces", above=0, below=1e9)
    interpolation: str = choice("cubic", INTERPOLATIONS, "periodic curve between the rows")
    period: float = number(
        0.0, "period [s]; 0: last time of the file, whose force is that of the first row", least=0
    )


@attrs.frozen(kw_only=True)
class AngleTableSettings:
    """A force along a fixed direction, given by a periodic table over the angle of a body.

    A table of gas pressures p gives the force ``(p - p_c) pi d^2 / 4`` on a piston with the
    diameter d; p_c is the pressure in the crankcase.
    """

    point: str = text(REQUIRED, "point on which the force acts")
    file: str = text(
        REQUIRED,
        "CSV file angle_deg,force_N, or angle_deg,pressure_bar with piston_diameter, over 360 or "
        "720 degrees, or a shipped table: gas-force",
    )
    piston_diameter: float = metres(
        0.0,
        "diameter of the piston on which the pressures of the table act [m]; 0: a table of forces",
    )
    crankcase_pressure: float = only_with(
        number(
            0.0,
            "pressure below the piston [Pa]; 0 if those of the table are above it",
            least=0,
            below=1e7,
        ),
        "piston_diameter",
    )
    angle_of: str = text(REQUIRED, "body whose angle the table uses, from x, + from x to y")
    direction: tuple[float, float] = pair(
        "direction of a positive force, in the frame at rest", (-1.0, 0.0), zero=False
    )
    scale: float = number(1.0, "factor on the forces", above=0, below=1e9)


@attrs.frozen
class GravitySettings(Described):
    """Gravity, which acts on every body with a mass."""

    acceleration: tuple[float, float] = pair("gravitational acceleration [m/s2]", (0.0, -9.81))


@attrs.frozen
class TimeSettings(Described):
    """Duration of a run, and control of its time steps."""

    end: float = not_with(
        number(0.0, "end of the run [s]; 0: given by revolutions", least=0), "periodic"
    )
    revolutions: float = number(
        0.0,
        "number of revolutions in the run or period, or two-stroke or four-stroke; 0: given by "
        "end or period",
        least=0,
        words=STROKES,
    )
    of: str = text("crank", "body whose revolutions are counted, with its speed at the start")
    periodic: bool = flag(False, "whether cycles are run until the films repeat")
    period: float = only_with(
        number(0.0, "common period of drives and forces [s]; 0: given by revolutions", least=0),
        "periodic",
        among=(True,),
    )
    periodicity: float = only_with(
        number(
            1e-4,
            "largest relative change of a film between two cycles that counts as periodic",
            above=0,
            below=1,
        ),
        "periodic",
        among=(True,),
        notice=True,
    )
    cycles: int = only_with(
        count(20, "largest number of cycles before the run gives up", least=1),
        "periodic",
        among=(True,),
        notice=True,
    )
    tolerance: float = number(
        1e-5, "largest local error of a step, relative to the gap", above=1e-12, below=1
    )
    order: int = count(
        3,
        "order of the backward differentiation formula, 1 to 3; 3 becomes 2 if modes lack damping "
        "or cavitation is mass-conserving",
        least=1,
        most=3,
    )
    first_step: float = number(
        1e-8, "size of the first step [s]; small, because film forces grow from zero", above=0
    )
    smallest_step: float = number(1e-13, "smallest size of a step [s]", above=0)
    largest_step: float = number(
        0.02, "largest step, over a revolution if revolutions are given, else over end or period",
        above=0, below=1,
    )  # fmt: skip


#: Settings class of an entry, by its table and its kind.
KINDS: Mapping[str, Mapping[str, type]] = {
    "bodies": {
        "rigid": RigidBody,
        "flexible": FlexibleSettings,
        "shaft": ShaftBody,
        "massless": MasslessBody,
    },
    "joints": {
        "revolute": Revolute,
        "fixed": Fixed,
        "slider": Slider,
        "lubricated": LubricatedSettings,
    },
    "drives": {"speed": Speed, "torque": Torque},
    "forces": {
        "constant": ConstantForceSettings,
        "time-table": TimeTableSettings,
        "angle-table": AngleTableSettings,
        "rotating": RotatingForce,
        "unbalance": Unbalance,
        "spring-damper": SpringDamper,
        "gravity": GravitySettings,
    },
    "lubricants": {"oil": OilSettings},
}
