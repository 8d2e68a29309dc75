"""Settings of one rigid bearing; the defaults are those of the paper's Table 1."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import attrs

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.fields import choice, count, flag, number
from fenics_ehd.base.oil import NO_TEMPERATURE, OilSettings
from fenics_ehd.base.quantities import (
    SMALLEST_RATIO,
    metres,
    radial_clearance,
    roughness,
    summit_offset,
    too_narrow,
)

if TYPE_CHECKING:  # slow to import, and --help does without
    from fenics_ehd.film.shape import Shape

ELEMENTS = ("lagrange", "bilinear", "serendipity")
SHEAR_RULES = ("streamers", "full", "none")
CAVITATION = ("reynolds", "mass-conserving")
CLOSED_SIDES = ("none", "lower", "upper")

#: Of the paper's oil, where nothing is said of another [Pa s].
VISCOSITY = 0.01

#: Effective temperature of the oil between supply and outlet, as practice takes it.
MIXING = 0.5

#: Cells of a mesh that still solves in minutes.
MOST_CELLS = 100_000

#: Of a supply [Pa]: more than any part of steel bears.
MOST_PRESSURE = 1e12

#: Clearance over radius for which lubrication theory, which drops terms of that order, is meant.
LARGEST_CLEARANCE_RATIO = 0.1


def _pair(help_text: str) -> Any:
    """Two finite numbers."""

    def check(_instance: Any, attribute: attrs.Attribute, value: Any) -> None:
        if len(value) != 2 or not all(math.isfinite(v) for v in value):
            raise SettingsError(f"{attribute.name} = {value!r} must be two finite numbers")

    return attrs.field(
        default=(0.0, 0.0), converter=tuple, validator=check, metadata={"help": help_text}
    )


@attrs.frozen
class Groove:
    """Axial groove over the whole width."""

    angle: float = number(0.0, "of its middle, from the load line in direction of rotation [rad]")
    width: float = number(0.0, "along the circumference [rad]", least=0, below=2 * math.pi)
    pressure: float = number(0.0, "supply pressure [Pa]", least=0, below=MOST_PRESSURE)


def _as_tuple(grooves: Iterable[Groove]) -> tuple[Groove, ...]:
    return tuple(grooves)


@attrs.frozen
class BearingSettings(OilSettings):
    """A bearing, its oil and how its shaft moves.

    Directions refer to the load: x along it, y a quarter turn on in the direction of
    rotation, z along the axis so that the shaft turns in the positive sense about it.
    """

    radius: float = metres(0.0225, "of the bore [m]")
    clearance: float = radial_clearance(17e-6)
    width: float = metres(0.022, "of the bearing [m]")
    viscosity: float = number(VISCOSITY, "dynamic viscosity of the oil [Pa s]", above=0)
    speed: float = number(500.0, "of the shaft [rad/s]")
    bore_speed: float = number(0.0, "of the bore [rad/s]")
    tilt: tuple[float, float] = _pair("of the shaft about x and y [rad]")
    squeeze: tuple[float, float] = _pair("velocity of the shaft's centre, x and y [m/s]")
    cells_around: int = count(64, "cells along the circumference", 3)
    cells_along: int = count(12, "cells along the axis", 1)
    element: str = choice("lagrange", ELEMENTS, "9-node, 4-node or 8-node")
    grooves: tuple[Groove, ...] = attrs.field(default=(), converter=_as_tuple)
    line_at_max_film: bool = flag(False, "no pressure where the film is thickest")
    line_held: bool = flag(False, "for the coefficients that line does not turn with the shaft")
    ambient: float = number(
        0.0, "pressure at the sides above that of cavitation [Pa]", least=0, below=MOST_PRESSURE
    )
    closed_side: str = choice("none", CLOSED_SIDES, "side through which nothing flows")
    cavitation: str = choice("reynolds", CAVITATION, "cavitation condition")
    shear_rule: str = choice("streamers", SHEAR_RULES, "shear in the cavitated zone")
    supply_temperature: float = number(
        NO_TEMPERATURE,
        f"of the oil that comes in [C], from which its own follows; {NO_TEMPERATURE:g}: not given",
        least=NO_TEMPERATURE,
        below=1000,
    )
    conducted: float = number(
        0.0, "share of the dissipated power that shaft and bore conduct away", least=0, below=1
    )
    mixing: float = number(
        MIXING, "where the effective temperature lies between supply, 0, and outlet, 1", above=0
    )
    journal_roughness: float = roughness("of the shaft, rms [m], 0: smooth")
    bore_roughness: float = roughness("of the bore, rms [m], 0: smooth")
    asperity_product: float = number(
        0.04, "density x radius x roughness of asperities [-]", above=0
    )
    asperity_slenderness: float = number(1e-3, "roughness over radius of asperities [-]", above=0)
    summit_offset: float = summit_offset()
    contact_modulus: float = number(115e9, "1 / sum of (1 - nu^2) / E of both [Pa]", above=0)
    boundary_friction: float = number(0.1, "coefficient of friction of asperities", least=0)
    flow_factors: bool = flag(True, "Patir and Cheng's factors of rough surfaces")
    #: Of the bore, angles from the load line; None: round.
    bore_shape: Shape | None = None

    @property
    def heated(self) -> bool:
        """Whether the temperature of the oil follows from the balance of its heat."""
        return self.supply_temperature > NO_TEMPERATURE

    def __attrs_post_init__(self) -> None:
        if self.cells_around * self.cells_along > MOST_CELLS:
            raise SettingsError(
                f"cells = {self.cells_around}x{self.cells_along}: at most {MOST_CELLS} are allowed"
            )
        wide = self.clearance / self.radius > LARGEST_CLEARANCE_RATIO
        if wide or too_narrow(self.clearance, self.radius):
            raise SettingsError(
                f"clearance = {self.clearance:g} m must lie between {SMALLEST_RATIO:g} "
                f"and {LARGEST_CLEARANCE_RATIO:g} of radius = {self.radius:g} m: lengths "
                "are in metres"
            )
        # At this slope one end touches when the middle is centred.
        limit = 2 * self.clearance / self.width
        if not math.hypot(*self.tilt) < limit:
            raise SettingsError(
                f"tilt = {math.hypot(*self.tilt):g} rad closes the gap: it must be below "
                f"2 clearance / width = {limit:.4g} rad"
            )
        if self.barus and self.roelands:
            raise SettingsError("barus and roelands exclude each other: give one of them")
        if self.graded and self.viscosity != VISCOSITY:
            raise SettingsError(
                f"viscosity = {self.viscosity:g} Pa s: give a viscosity, a grade, or viscosity_40 "
                "and viscosity_100, one of them"
            )
        if not self.heated and (self.conducted or self.mixing != MIXING):
            raise SettingsError("conducted and mixing do nothing without supply_temperature")
        if self.cavitation == "mass-conserving":
            self._check_mass_conserving()
        if self.grooves and self.line_at_max_film:
            raise SettingsError(
                "grooves and line_at_max_film exclude each other: the line belongs to the plain "
                "bearing of the classical tables"
            )
        if self.bore_shape is not None and not self.bore_shape.round:
            self._check_shape()
        if self.line_held and not self.line_at_max_film:
            raise SettingsError("line_held needs line_at_max_film: there is no line to hold")
        if self.grooves and self.speed and self.bore_speed:
            raise SettingsError(
                f"bore_speed = {self.bore_speed:g} rad/s with grooves: they stand still, so shaft "
                "or bore must"
            )

    def _check_shape(self) -> None:
        """A bore that is not round stands still, and its thickest film is not where one thinks."""
        if self.line_at_max_film:
            raise SettingsError(
                "bore_shape and line_at_max_film exclude each other: the line belongs to the plain "
                "bearing of the classical tables"
            )
        if self.bore_speed:
            raise SettingsError(
                f"bore_speed = {self.bore_speed:g} rad/s with a bore_shape that is not the same "
                "all around: it stands still, so the bore must"
            )

    def _check_mass_conserving(self) -> None:
        """What a steady film needs that keeps account of its oil."""
        if self.element != "bilinear":
            raise SettingsError(
                f"element = {self.element!r}: cavitation = 'mass-conserving' needs 'bilinear'"
            )
        if not (self.ambient or self.grooves) or self.line_at_max_film:
            raise SettingsError(
                "cavitation = 'mass-conserving' needs a supply, a groove or an ambient pressure "
                "above 0: without one the bearing runs dry"
            )
        if any(self.squeeze):
            raise SettingsError(
                f"squeeze = {self.squeeze[0]:g}, {self.squeeze[1]:g} m/s: cavitation = "
                "'mass-conserving' gives the steady film of a shaft at rest in the bearing"
            )

    @property
    def direction(self) -> int:
        """1 or -1: sense of rotation of the shaft, or of the bore when the shaft stands."""
        return -1 if (self.speed or self.bore_speed) < 0 else 1
