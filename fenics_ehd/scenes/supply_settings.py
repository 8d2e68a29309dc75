"""What a scene file may say of the supply of a film: regions of a bore or a journal.

Angles are counted from the x axis of the body with the bore, or with the journal, positive from x
to y; heights along the axis from the middle of the bore.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import attrs

from fenics_ehd.base.fields import choice, entries, number, text
from fenics_ehd.base.quantities import LARGEST_LENGTH
from fenics_ehd.base.settings import build
from fenics_ehd.scenes.fields import NONE, REQUIRED

SURFACES = ("bore", "journal")


@attrs.frozen(kw_only=True)
class SupplySettings:
    """Oil under pressure at a region of the bore or of the journal."""

    on: str = choice("bore", SURFACES, "the surface that it is in and turns with")
    pressure: float = number(
        0.0,
        "of the supply, above that at which the film cavitates [Pa]",
        least=0,
        usual=(1e3, 1e9),
        example="3e5 for 3 bar",
    )
    table: str = text(NONE, "in its place: CSV file time_s,pressure_Pa, or none")
    resistance: float = number(
        0.0,
        "of the passage to the region, pressure over flow [Pa s/m3], 0: none",
        least=0,
        usual=(1e6, 1e16),
        example="3e11 for 1 cm3/s at 3 bar",
    )
    angle: float = number(0.0, "of the middle, from the body's x axis [degrees]")
    height: float = number(
        0.0,
        "of the middle, from that of the bore [m]",
        above=-LARGEST_LENGTH,
        below=LARGEST_LENGTH,
    )


@attrs.frozen(kw_only=True)
class HoleSettings(SupplySettings):
    """A round hole."""

    diameter: float = number(
        0.0, "[m]; 0: place and size of the hole in the mesh of a flexible bore, nearest to angle "
        "and height", least=0, below=LARGEST_LENGTH,
    )  # fmt: skip


@attrs.frozen(kw_only=True)
class AxialGrooveSettings(SupplySettings):
    """A groove along the axis."""

    length: float = number(REQUIRED, "along the axis [m]", above=0, below=LARGEST_LENGTH)
    extent: float = number(REQUIRED, "along the circumference [degrees]", above=0, below=360)


@attrs.frozen(kw_only=True)
class CircumferentialGrooveSettings(SupplySettings):
    """A groove along the circumference."""

    width: float = number(REQUIRED, "along the axis [m]", above=0, below=LARGEST_LENGTH)
    extent: float = number(
        360.0, "along the circumference [degrees], 360: all around", above=0, below=360.0001
    )


SUPPLIES: Mapping[str, type] = MappingProxyType(
    {
        "hole": HoleSettings,
        "axial-groove": AxialGrooveSettings,
        "circumferential-groove": CircumferentialGrooveSettings,
    }
)


def supplies(help_text: str) -> dict[str, SupplySettings]:
    """Field of supplies by name."""
    found: dict[str, SupplySettings] = entries(help_text, SUPPLIES, build)
    return found
