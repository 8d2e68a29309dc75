"""Quantities in settings, with limits that catch a wrong unit or warnings where it may be one."""

from __future__ import annotations

from typing import Any

from fenics_ehd.settings import number


def youngs_modulus(default: float) -> Any:
    """Young's modulus of a part [Pa]; 210 is no part's, nor is 210e3."""
    return number(
        default, "[Pa]", least=1e6, below=1e18, usual=(1e9, 2e12), example="210e9 for 210 GPa"
    )


def density(default: float) -> Any:
    """Density of a part [kg/m3]; 7.85 is no part's, nor is 7.85e6."""
    return number(
        default, "[kg/m3]", least=100, below=1e5, usual=(500, 25e3), example="7850 for 7.85 g/cm3"
    )


def viscosity(default: float) -> Any:
    """Dynamic viscosity of an oil [Pa s]; that of air is 2e-5, thick cold oil has 1."""
    return number(
        default,
        "dynamic viscosity of the oil [Pa s]",
        above=0,
        below=1e6,
        usual=(1e-5, 1.0),
        example="0.01 for 10 mPa s",
    )


def mass(default: float, help_text: str, largest: float) -> Any:
    """Mass of something rigid [kg], zero included; a larger one may be in grams."""
    return number(default, help_text, least=0, usual=(1e-4, largest), example="0.5 for 500 g")


def speed(default: float, help_text: str, *, above: float | None = None) -> Any:
    """Angular speed [rad/s]; a larger one may be in revolutions per minute."""
    return number(default, help_text, above=above, usual=(0.01, 2e4), example="314 for 3000 rpm")


def damping_time(default: float) -> Any:
    """Structural damping over stiffness [s]."""
    return number(
        default, "zeta of D = zeta K [s]", least=0, usual=(1e-12, 0.1), example="1e-3 for 1 ms"
    )
