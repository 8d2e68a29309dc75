"""Settings that several scenes and commands share: oil, roughness, deviations, part material."""

from __future__ import annotations

from math import hypot
from typing import Any

import attrs

from fenics_ehd.base.described import Described
from fenics_ehd.base.fields import (
    REQUIRED,
    choice,
    count,
    density,
    deviation,
    flag,
    number,
    pair,
    text,
    viscosity,
    youngs_modulus,
)
from fenics_ehd.base.needs import NO_TEMPERATURE, NONE, not_with, only_with

#: Density of mineral oils at 15 C [kg/m3]. Paraffinic oils have 862 to 891 at 25 C (The Tribology
#: Handbook, table 25, opened at digilib.universitaspertamina.ac.id).
DENSITY = 870.0

#: Specific heat of mineral oil [J/(kg K)], rounded from 1966 (www.pantherlubes.com/tl_12.html). It
#: grows with temperature by 0.2 % per K.
SPECIFIC_HEAT = 2000.0

#: Compressibility a of mineral oils at ambient pressure [1/Pa], in the density law of Dowson and
#: Higginson (1966), in which density is proportional to ``1 + a p / (1 + b p)``.
COMPRESSIBILITY = 0.6e-9

#: Coefficient b of this law [1/Pa], which limits the density at high pressure.
STIFFENING = 1.7e-9


def _kinematic(temperature: int) -> Any:
    """Field for the kinematic viscosity at a temperature [C]."""
    return number(
        0.0,
        f"kinematic, at {temperature} C [mm2/s], both in place of viscosity; 0: not given",
        least=0,
        below=1e7,
        usual=(1.0, 5000.0),
        example="46 for 46 cSt",
    )


def supply_temperature(default: float, help_text: str) -> Any:
    """Field for the temperature of the supplied oil [C].

    The default `NO_TEMPERATURE` means that the setting is not used.
    """
    lower: dict[str, Any] = {"above" if default is REQUIRED else "least": NO_TEMPERATURE}
    return number(default, help_text, **lower, below=1000, usual=(1, 200), example="80 for 353 K")


def conducted_share(help_text: str) -> Any:
    """Field for the fraction of the dissipated power that the oil does not carry away [-]."""
    return number(0.0, help_text, least=0, below=1)


def outlet_weight() -> Any:
    """Field for the weight of the outlet temperature in the effective temperature [-].

    A weight of 0.5 is common practice.
    """
    return number(
        0.5,
        "where the effective temperature lies between supply, 0, and outlet, 1",
        above=0,
        most=1,
    )


#: Settings that describe an oil by its grade or kinematic viscosities, for messages.
GRADED = "a grade, or viscosity_40 and viscosity_100"

#: Values of `OilSettings.temperature_law`; `fenics_ehd.film.lubricant` implements them.
TEMPERATURE_LAWS = ("walther",)

#: Settings that make surfaces rough, for messages.
ROUGH = "journal_roughness or bore_roughness"


@attrs.frozen(kw_only=True)
class OilSettings(Described):
    """Settings of an oil.

    The viscosity of the oil is set directly, or it follows from a temperature together with either
    a grade or two kinematic viscosities.
    """

    viscosity: float = viscosity(0.0, "dynamic [Pa s]; 0: by a grade or kinematic viscosities")
    grade: str = text(NONE, "ISO VG 46, SAE 10W-40 and others, in place of viscosity, or none")
    viscosity_40: float = _kinematic(40)
    viscosity_100: float = _kinematic(100)
    temperature_law: str = choice("walther", TEMPERATURE_LAWS, "viscosity by temperature")
    temperature: float = only_with(
        number(
            NO_TEMPERATURE,
            f"of an oil by grade or kinematic viscosities [C]; {NO_TEMPERATURE:g}: not given",
            least=NO_TEMPERATURE,
            below=1000,
            example="90 for 363 K",
        ),
        "graded",
        words=GRADED,
    )
    density: float = number(
        DENSITY,
        "[kg/m3], at 15 C by grade or kinematic viscosities",
        least=100,
        below=1e4,
        usual=(600, 1500),
        example="870 for 0.87 g/cm3",
    )
    specific_heat: float = number(
        SPECIFIC_HEAT,
        "[J/(kg K)]",
        least=10,
        below=1e5,
        usual=(1000, 5000),
        example="2000 for 2 kJ/(kg K)",
    )
    density_law: str = choice("constant", ("constant", "dowson-higginson"), "density by pressure")
    compressibility: float = only_with(
        number(
            COMPRESSIBILITY,
            "a of the density's 1 + a p / (1 + b p) in dowson-higginson [1/Pa]",
            above=0,
            usual=(1e-11, 1e-8),
            example="0.6e-9 for 0.6 1/GPa",
        ),
        "density_law",
        among=("dowson-higginson",),
    )
    stiffening: float = only_with(
        number(
            STIFFENING,
            "b of the density's 1 + a p / (1 + b p) in dowson-higginson [1/Pa]",
            least=0,
            usual=(1e-11, 1e-7),
            example="1.7e-9 for 1.7 1/GPa",
        ),
        "density_law",
        among=("dowson-higginson",),
    )
    barus: float = number(
        0.0,
        "viscosity exp(barus p) [1/Pa], 0: none",
        least=0,
        usual=(1e-10, 1e-7),
        example="2e-8 for 20 1/GPa",
    )
    roelands: float = number(
        0.0,
        "viscosity after Roelands with this pressure index [-], 0: none",
        least=0,
        usual=(0.1, 2.0),
        example="0.6 for mineral oil",
    )
    cross_rate: float = number(
        0.0,
        "shear rate at which half of Cross's shear thinning has come [1/s], 0: none",
        least=0,
        usual=(1e2, 1e9),
        example="1e6 for an oil with polymers",
    )
    cross_exponent: float = only_with(
        number(1.0, "of Cross's law [-]", above=0, below=10), "cross_rate"
    )
    cross_second_viscosity: float = only_with(
        number(0.5, "at the highest shear rates, over that at rest [-]", least=0, below=1),
        "cross_rate",
    )

    @property
    def graded(self) -> bool:
        """Whether the viscosity follows from a grade or from kinematic viscosities."""
        return self.grade != NONE or bool(self.viscosity_40 or self.viscosity_100)


def only_if_rough(field: Any) -> Any:
    """Add to a field the condition that a surface is rough."""
    return only_with(field, "roughness", words=ROUGH)


def _roughness(of: str) -> Any:
    """Field for the rms roughness of a surface [m]; ground surfaces have 0.1 to 1 um."""
    return number(
        0.0, f"of the {of}, rms [m], 0: smooth", least=0, below=1e-4, usual=(1e-9, 1e-5),
        example="0.4e-6 for 0.4 um",
    )  # fmt: skip


@attrs.frozen(kw_only=True, slots=False)
class Roughness(Described):
    """Settings of the roughness of a journal and its bore, whose asperities may be in contact."""

    journal_roughness: float = _roughness("journal")
    bore_roughness: float = _roughness("bore")
    asperity_product: float = not_with(
        only_if_rough(
            number(
                0.04,
                "asperities per area x their radius x combined roughness [-]",
                above=0,
                below=1,
            )
        ),
        "asperity_radius",
    )
    asperity_slenderness: float = not_with(
        only_if_rough(
            number(1e-3, "combined roughness over radius of the asperities [-]", above=0, below=1)
        ),
        "asperity_radius",
    )
    summit_offset: float = only_if_rough(
        number(
            0.0,
            "mean planes of the asperities' tips above those of the surfaces, together, over the "
            "combined roughness [-]; 0: not above, the least contact",
            least=0,
            most=2,
        )
    )
    boundary_friction: float = only_if_rough(
        number(0.1, "coefficient of friction of asperities that touch [-]", least=0, below=5)
    )
    flow_factors: bool = only_if_rough(
        flag(True, "whether oil flows as Patir and Cheng have it, or as in a smooth average gap")
    )

    @property
    def roughness(self) -> float:
        """Combined rms roughness sigma of both surfaces [m]."""
        return hypot(self.journal_roughness, self.bore_roughness)


@attrs.frozen(slots=False)
class Deviations(Described):
    """Settings of the deviations of a bore or journal from a round surface, positive outward.

    The deviation at a point is the sum of all deviations here. They are given in the frame of the
    body: the shape of a journal rotates with the journal.
    """

    ovality: float = deviation("amplitude of a wave around [m]")
    ovality_angle: float = only_with(
        number(
            0.0, "where it is outermost, from the body's x axis; of a bearing, the load [degrees]"
        ),
        "ovality",
    )
    lobes: int = only_with(count(2, "waves in a turn", least=1, most=100), "ovality")
    barrel: float = deviation("at both ends, 0 at mid-width, a parabola; crowned journal: - [m]")
    taper: float = deviation("at the upper end, its negative at the lower one, linear [m]")
    misalignment: tuple[float, float] = pair("tilt of the axis about x and y [rad]", below=0.1)
    table: str = text(NONE, "CSV file angle_deg,height_m,deviation_m of more, or none")


@attrs.frozen
class Material(Described):
    """Settings of an isotropic elastic material."""

    youngs_modulus: float = youngs_modulus(210e9)
    poissons_ratio: float = number(
        0.3, "[-]; quadratic elements lock above 0.49", above=-1, below=0.49
    )
    density: float = density(7850.0)
