"""Schema of scene files: bodies, joints, drives, forces, lubricants, supplies, output.

Every kind of entry has one settings class; docstrings and help texts are the reference.
Angles are counted from the x axis, positive from x to y, and a body's angle is that of its own x
axis; a crank whose pin lies on its x axis has its outer (top) dead centre, for a piston on the
positive x axis, at angle 0.

Longer than other modules: it is one list, in the order of the reference that is made of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil
from typing import Any

import attrs

from fenics_ehd.base import fields as quantities
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
from fenics_ehd.multibody.forces import RotatingForce, SpringDamper, Torque
from fenics_ehd.multibody.joints import Fixed, Revolute, Slider, Speed
from fenics_ehd.multibody.shaft import ShaftBody
from fenics_ehd.scenes.part_settings import (
    CELLS,
    ELEMENTS,
    ReductionSettings,
)

#: Fewest film cells around and along: with 3 around the largest pressure is 12 % too low.
FEWEST_CELLS = (8, 2)

#: Film cells around times along that still fit into the memory of a usual machine.
MOST_CELLS = 200_000


def film_cells(help_text: str) -> Any:
    """Field for the cells of a film mesh around and along, or an empty list."""

    def check(name: str, value: Any) -> None:
        setting = f"{name} = {list(value)!r}"
        if value and (len(value) != 2 or any(type(n) is not int or n <= 0 for n in value)):
            raise SettingsError(f"{setting} must be two whole numbers above 0, or empty")
        if any(n < fewest for n, fewest in zip(value, FEWEST_CELLS, strict=False)):
            raise SettingsError(
                f"{setting} must be at least {list(FEWEST_CELLS)}: fewer are too coarse"
            )
        if value and value[0] * value[1] > MOST_CELLS:
            raise SettingsError(
                f"{setting}: {value[0] * value[1]} cells, at most {MOST_CELLS} are allowed"
            )

    return checked(
        (),
        help_text,
        check,
        lambda value: tuple(value) if isinstance(value, (list, tuple)) else (value,),
    )


SUPPLIES: Mapping[str, type] = {
    "hole": HoleSupply,
    "axial-groove": AxialGrooveSupply,
    "circumferential-groove": CircumferentialGrooveSupply,
}


@attrs.frozen
class GroundSettings:
    """The frame at rest; it exists without being listed."""

    points: dict = places("points of the frame at rest [m]")


#: Cells around a bore of the shipped models are a multiple of this.
AROUND = 10

#: Relative round-off of a factor that does not add a cell.
ROUNDING = 1e-9


@attrs.frozen
class FlexibleSettings(Pose):
    """An elastic part with lubricated bores, meshed and reduced, or read from a file.

    Its origin is the centre of its first bore; a bore is a point, `bore` if no other is named.
    """

    model: str = text(NONE, "shipped model, or a .geo file, which is a program, or .msh")
    body: str = text(NONE, "HDF5 file of the reduced part, in place of a model")
    bores: tuple[str, ...] = names("surfaces that films bend, the first one's axis is z", ("bore",))
    points: tuple[str, ...] = not_with(
        names("surfaces of the model whose mean positions are points"), "body"
    )
    clamped: str = not_with(text(NONE, "surface of the model that does not move, or none"), "body")
    cells: str = not_with(
        choice("hex", CELLS, "of a model that can give either: hexahedra, 10-node tetrahedra"),
        "body",
    )
    element: str = only_with(
        not_with(choice("serendipity", ELEMENTS, "of hexahedra, 20- or 27-node"), "body"),
        "cells",
        among=("hex",),
    )
    damping_time: float = number(
        0.0, "zeta of D = zeta K [s]", least=0, usual=(1e-12, 0.1), example="1e-3 for 1 ms"
    )
    mass: float = not_with(
        quantities.mass(0.0, "in place of the model's [kg], 0: the model's", 1e4), "clamped"
    )
    inertia: float = not_with(
        number(
            0.0,
            "in place of the model's, about the centre of mass [kg m2], 0: the model's",
            least=0,
            usual=(1e-8, 1e4),
            example="1e-3 for 10 kg cm2",
        ),
        "clamped",
    )
    centre: tuple[float, float] = not_with(
        place("centre of mass from the bore in place of the model's [m], [0, 0]: the model's"),
        "clamped",
    )
    material: Material = not_with(section(Material), "body")
    geometry: dict = not_with(
        numbers("parameters of the Gmsh model by name, lengths in [m]"), "body"
    )
    reduction: ReductionSettings = not_with(section(ReductionSettings), "body")

    @property
    def idle(self) -> tuple[str, ...]:
        """Keys that have no effect if the reduced part is read from a file."""
        return () if self.body == NONE else keys_excluded_by(type(self), "body")

    @property
    def cell_counts(self) -> tuple[str, ...]:
        """Names of the given parameters that are numbers of cells."""
        return tuple(filter(quantities.is_cell_count, self.geometry))

    def geometry_of(self, factor: float) -> dict[str, float]:
        """Parameters of the model with its numbers of cells times a factor."""
        geometry = dict(self.geometry)
        for key in self.cell_counts:
            step = AROUND if "around" in key else 1
            geometry[key] = step * ceil(int(geometry[key]) * factor / step - ROUNDING)
        return geometry


@attrs.frozen(kw_only=True)
class ContactSettings(Roughness):
    """Rough surfaces of a journal and its bore, with contact; smooth without a roughness."""

    asperity_density: float = only_with(
        only_if_rough(
            number(
                0.0, "per area, with asperity_radius in place of both [1/m2], 0: not given", least=0
            )
        ),
        "asperity_radius",
    )
    asperity_radius: float = only_with(
        only_if_rough(number(0.0, "of their tips [m], 0: not given", least=0, below=1e-2)),
        "asperity_density",
    )
    journal_modulus: float = only_if_rough(quantities.youngs_modulus(210e9))
    journal_poissons_ratio: float = only_if_rough(number(0.3, "[-]", above=-1, below=0.5))
    bore_modulus: float = only_if_rough(
        number(
            0.0,
            "[Pa], 0: that of the flexible body's material, of another bore 210e9",
            least=0,
            below=1e18,
            usual=(1e9, 2e12),
            example="70e9 for 70 GPa",
        )
    )
    bore_poissons_ratio: float = only_with(
        only_if_rough(number(0.3, "[-], where bore_modulus is given", above=-1, below=0.5)),
        "bore_modulus",
    )


@attrs.frozen(kw_only=True)
class LubricatedSettings:
    """The journal of one body in the bore of another."""

    journal: str = text(REQUIRED, "point of the body with the journal, crank.pin")
    bore: str = text(REQUIRED, "point of the body with the bore; of a flexible one: rod.bore")
    clearance: float = radial_clearance(REQUIRED)
    lubricant: str = text(NONE, "name in [lubricants], or none and a viscosity")
    viscosity: float = quantities.viscosity(0.0, "of a lubricant without a name [Pa s]")
    radius: float = metres(0.0, "of the bore [m]; 0: a flexible bore's own")
    width: float = metres(0.0, "of the bore [m]; 0: a flexible bore's own")
    cells: tuple[int, ...] = film_cells(
        "film cells around and along, [40, 10]; empty: a flexible bore's own, 20 x 5 of a rigid"
    )
    element: str = quantities.film_element()
    transfer: str = choice("conservative", TRANSFERS, "of pressures to a bore with another mesh")
    ambient_pressure: float = quantities.ambient_pressure()
    grooves: tuple[tuple[float, ...], ...] = rows(
        ("angle", "width", "pressure"),
        "axial grooves in the bore [angle from its x axis in degrees, width in degrees, Pa]",
        ("degrees", "degrees", "Pa"),
    )
    supply: dict = entries("holes and grooves of bore or journal that feed the film", SUPPLIES)
    cavitation: str = quantities.cavitation()
    initial_filling: float = only_with(
        number(
            1.0, "share of the gap that holds oil at the start (mass-conserving)", least=0, most=1
        ),
        "cavitation",
        among=("mass-conserving",),
    )
    ambient: str = not_with(only_with(choice(
        "air", AMBIENTS,
        "outside of sides without ambient_pressure: air or oil (mass-conserving)",
    ), "cavitation", among=("mass-conserving",)), "ambient_pressure", notice=True)  # fmt: skip
    friction: bool = flag(False, "whether the oil's shear acts on the bodies")
    shear_rule: str = only_with(quantities.shear_rule(), "friction", "heat")
    smallest_film: float = not_with(
        number(
            0.01,
            "film thickness at which the run ends, share of the clearance; up to 0.01 at most 0.2 "
            "um; none with contact",
            least=0,
            below=1,
        ),
        "contact.roughness",
        words=f"contact.{ROUGH}",
        notice=True,
    )
    eccentricity: tuple[float, float] = pair(
        "of the journal in the bore's frame at the start, share of the clearance", below=1.0
    )
    eccentricity_rate: tuple[float, float] = pair("its rate [m/s]")
    contact: ContactSettings = section(ContactSettings)
    bore_shape: Deviations = section(Deviations)
    journal_shape: Deviations = section(Deviations)
    heat: Heat | None = option(Heat)


@attrs.frozen(kw_only=True)
class ConstantForceSettings:
    """A force that stays the same in the frame at rest."""

    point: str = text(REQUIRED, "where it acts, piston or rod.pin")
    force: tuple[float, float] = pair("[N]", REQUIRED, zero=False)


@attrs.frozen(kw_only=True)
class TimeTableSettings:
    """A periodic force over time."""

    point: str = text(REQUIRED, "where it acts")
    file: str = text(REQUIRED, "CSV file time_s,Fx_N,Fy_N, or a shipped table: main-bearing")
    scale: float = number(1.0, "factor on the forces", above=0, below=1e9)
    interpolation: str = choice("cubic", INTERPOLATIONS, "periodic, between the rows")
    period: float = number(
        0.0, "[s]; 0: the last time of the file, whose force is the first", least=0
    )


@attrs.frozen(kw_only=True)
class AngleTableSettings:
    """A force along a line at rest, periodic over a body's angle."""

    point: str = text(REQUIRED, "where it acts")
    file: str = text(REQUIRED, "CSV file angle_deg,force_N over 360 or 720 degrees, or "
                     "a shipped table: gas-force")  # fmt: skip
    angle_of: str = text(REQUIRED, "body whose angle the table is over, from x, + from x to y")
    direction: tuple[float, float] = pair(
        "of a positive force, in the frame at rest", (-1.0, 0.0), zero=False
    )
    scale: float = number(1.0, "factor on the forces", above=0, below=1e9)


@attrs.frozen
class GravitySettings:
    """The weight of every body."""

    acceleration: tuple[float, float] = pair("[m/s2]", (0.0, -9.81))


@attrs.frozen
class TimeSettings:
    """Duration of a run, and its steps."""

    end: float = not_with(number(0.0, "[s]; 0: given by revolutions", least=0), "periodic")
    revolutions: float = number(
        0.0, "to simulate, or in a period; 0: given by end or period", least=0
    )
    of: str = text("crank", "body whose revolutions count, at its speed at the start")
    periodic: bool = flag(False, "whether cycles are run until the films repeat")
    period: float = only_with(
        number(0.0, "of all drives and forces [s]; 0: given by revolutions", least=0),
        "periodic",
        among=(True,),
    )
    periodicity: float = only_with(
        number(1e-4, "largest change of a film from cycle to cycle, relative", above=0, below=1),
        "periodic",
        among=(True,),
        notice=True,
    )
    cycles: int = only_with(
        count(20, "to give up after", least=1), "periodic", among=(True,), notice=True
    )
    tolerance: float = number(
        1e-5, "local error of a step, relative change of the gap", above=1e-12, below=1
    )
    order: int = count(
        3,
        "of the backward differentiation formula, 1 to 3; lowered from 3 to 2 if modes lack "
        "damping or oil is conserved",
        least=1,
        most=3,
    )
    first_step: float = number(1e-8, "[s]; the film builds up from zero eccentricity", above=0)
    smallest_step: float = number(1e-13, "[s]", above=0)
    largest_step: float = number(
        0.02, "share of a revolution if revolutions are given, else of end or period",
        above=0, below=1,
    )  # fmt: skip


#: Class of an entry by its table and kind.
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
        "spring-damper": SpringDamper,
        "gravity": GravitySettings,
    },
    "lubricants": {"oil": OilSettings},
}
