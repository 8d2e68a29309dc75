"""Quantities in settings, with limits that catch a wrong unit or warnings where it may be one.

A length written in millimetres or micrometres is a thousand times too large or more: the limits
are generous, and still below that.
"""

from __future__ import annotations

from typing import Any

from fenics_ehd.base.fields import number

#: Largest bearing radius, bearing width or crank radius [m].
LARGEST_LENGTH = 5.0

#: Largest radial clearance [m].
LARGEST_CLEARANCE = 5e-3

#: Smallest clearance over bore radius; bearings have 100 times that, so that a smaller one is a
#: radius in millimetres or a clearance that nobody can make.
SMALLEST_RATIO = 1e-5

#: Rounding of a ratio that is meant to be the limit itself.
_ROUNDING = 1e-9


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


def mass(default: float, help_text: str, largest: float) -> Any:
    """Mass of something rigid [kg], zero included; a larger one may be in grams."""
    return number(default, help_text, least=0, usual=(1e-4, largest), example="0.5 for 500 g")


def speed(default: float, help_text: str) -> Any:
    """Angular speed [rad/s]; a larger one may be in revolutions per minute."""
    return number(default, help_text, usual=(0.01, 2e4), example="314 for 3000 rpm")


def metres(default: float, help_text: str, *, below: float = LARGEST_LENGTH) -> Any:
    """Length of a machine [m]."""
    return number(default, help_text, above=0, below=below, example="0.025 for 25 mm")


def radial_clearance(default: float) -> Any:
    """Radial clearance of a bearing [m]."""
    return number(
        default, "radial clearance [m]", above=0, below=LARGEST_CLEARANCE, example="30e-6 for 30 um"
    )


def roughness(help_text: str) -> Any:
    """Root mean square height of a surface [m]; ground ones have 0.1 to 1 um."""
    return number(
        0.0, help_text, least=0, below=1e-4, usual=(1e-9, 1e-5), example="0.4e-6 for 0.4 um"
    )


def summit_offset() -> Any:
    """How far the mean planes of asperities' tips stand out: of Gaussian surfaces up to 1.84."""
    return number(
        0.0,
        "mean planes of the asperities' tips above those of the surfaces, together, over the "
        "combined roughness [-]; 0: not above, the least contact",
        least=0,
        most=2,
    )


def deviation(help_text: str) -> Any:
    """Deviation of a surface from the round one [m], of either sign."""
    return number(
        0.0,
        help_text,
        above=-LARGEST_CLEARANCE,
        below=LARGEST_CLEARANCE,
        usual=(1e-8, 1e-3),
        example="5e-6 for 5 um",
    )


def too_narrow(clearance: float, radius: float) -> bool:
    """Whether a clearance is too small a part of the bore's radius to be in the same unit."""
    return clearance < SMALLEST_RATIO * (1 - _ROUNDING) * radius
