"""What settings say of an oil, in scene files and for a single bearing."""

from __future__ import annotations

from typing import Any

import attrs

from fenics_ehd.base.fields import choice, number, text

#: Stands for a grade that is not given.
NO_GRADE = "none"

#: Stands for a temperature that is not given: absolute zero [C].
NO_TEMPERATURE = -273.15

#: Of mineral oils at 15 C [kg/m3]; paraffinic ones of The Tribology Handbook (table 25, opened at
#: digilib.universitaspertamina.ac.id) have 862 to 891 at 25 C.
DENSITY = 870.0

#: Of mineral oil [J/(kg K)], rounded from 1966 (www.pantherlubes.com/tl_12.html). It grows with
#: temperature by 0.2 % per K.
SPECIFIC_HEAT = 2000.0

#: How the density follows the pressure.
DENSITY_LAWS = ("constant", "dowson-higginson")

#: Of Dowson's and Higginson's law (1966), mineral oils [1/Pa]: rise at ambient pressure, and how it
#: ends.
COMPRESSIBILITY, STIFFENING = 0.6e-9, 1.7e-9

#: Exponent of Cross's law, and second viscosity over the first, where its shear rate is given.
CROSS_EXPONENT, CROSS_SECOND = 1.0, 0.5


def _kinematic(temperature: int) -> Any:
    return number(
        0.0,
        f"kinematic, at {temperature} C [mm2/s], both in place of viscosity; 0: not given",
        least=0,
        below=1e7,
        usual=(1.0, 5000.0),
        example="46 for 46 cSt",
    )


@attrs.frozen(kw_only=True)
class OilSettings:
    """An oil: of one viscosity, or at a temperature by its grade or two kinematic viscosities."""

    viscosity: float = number(
        0.0,
        "dynamic [Pa s]; 0: by a grade or kinematic viscosities",
        least=0,
        below=1e6,
        usual=(1e-5, 1.0),
        example="0.01 for 10 mPa s",
    )
    grade: str = text(NO_GRADE, "ISO VG 46, SAE 10W-40 and others, in place of viscosity, or none")
    viscosity_40: float = _kinematic(40)
    viscosity_100: float = _kinematic(100)
    temperature: float = number(
        NO_TEMPERATURE,
        f"of an oil by grade or kinematic viscosities [C]; {NO_TEMPERATURE:g}: not given",
        least=NO_TEMPERATURE,
        below=1000,
        example="90 for 363 K",
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
    density_law: str = choice("constant", DENSITY_LAWS, "density by pressure")
    compressibility: float = number(
        COMPRESSIBILITY,
        "a of the density's 1 + a p / (1 + b p) in dowson-higginson [1/Pa]",
        above=0,
        usual=(1e-11, 1e-8),
        example="0.6e-9 for 0.6 1/GPa",
    )
    stiffening: float = number(
        STIFFENING,
        "b of that, by which oil under pressure is stiffer [1/Pa]",
        least=0,
        usual=(1e-11, 1e-7),
        example="1.7e-9 for 1.7 1/GPa",
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
    cross_exponent: float = number(CROSS_EXPONENT, "of Cross's law [-]", above=0, below=10)
    cross_second_viscosity: float = number(
        CROSS_SECOND, "at the highest shear rates, over that at rest [-]", least=0, below=1
    )

    @property
    def graded(self) -> bool:
        """Whether the viscosity is that of a grade or of two kinematic viscosities."""
        return self.grade != NO_GRADE or bool(self.viscosity_40 or self.viscosity_100)
