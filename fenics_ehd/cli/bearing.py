"""``fenics-ehd bearing``: its options."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.oil import DENSITY_LAWS, NO_TEMPERATURE
from fenics_ehd.bearing.settings import (
    CAVITATION,
    CLOSED_SIDES,
    ELEMENTS,
    SHEAR_RULES,
    BearingSettings,
    Groove,
)
from fenics_ehd.cli.bearing_answer import report, summary
from fenics_ehd.cli.bearing_help import DESCRIPTION
from fenics_ehd.cli.bearing_shape import bore_shape, shape_options
from fenics_ehd.cli.options import Measured, json_option

if TYPE_CHECKING:  # slow to import, and --help does without
    from fenics_ehd.bearing.operating_point import BearingResult


def _groove(numbers: tuple[float, float, float]) -> Groove:
    """Groove from degrees and Pa."""
    angle, width, pressure = numbers
    if not 0 <= width < 360:
        raise SettingsError(f"--groove: a width of {width:g} degrees must lie in 0..360")
    try:
        return Groove(math.radians(angle), math.radians(width), pressure)
    except SettingsError as error:
        raise SettingsError(f"--groove: {error}") from None


def _cells(text: str) -> tuple[int, int]:
    """Two whole numbers from 64x12."""
    match = re.fullmatch(r"(\d{1,9})x(\d{1,9})", text.strip().lower())
    if not match:
        raise SettingsError(f"--cells {text!r} must be two whole numbers, around x along: 64x12")
    return int(match[1]), int(match[2])


def _default(name: str) -> Any:
    return getattr(BearingSettings(), name)


def _number(name: str, help_text: str, metavar: str, *, optional: bool = False) -> Callable:
    """Option for a number of the settings, with its default; that of `optional` ones says none."""
    measured = Measured(help_text)
    return _setting(name, help_text, type=measured, show_default=not optional, metavar=metavar)


def _choice(name: str, options: tuple[str, ...], help_text: str) -> Callable:
    return _setting(name, help_text, type=click.Choice(options))


def _setting(name: str, help_text: str, *, show_default: bool = True, **more: Any) -> Callable:
    """Option for one of the settings, with its default; `more` is click's."""
    option = f"--{name.replace('_', '-')}"
    return click.option(
        option, default=_default(name), show_default=show_default, help=help_text, **more
    )


def _pair(name: str, metavar: str, help_text: str) -> Callable:
    both = (Measured(help_text), Measured(help_text))
    return click.option(f"--{name}", type=both, default=(0.0, 0.0), metavar=metavar, help=help_text)


@click.command(help=DESCRIPTION, short_help="Operating point of one rigid bearing.")
@click.option("--eccentricity", type=float, metavar="E", help="Eccentricity over clearance, 0..1.")
@click.option("--load", type=Measured("[N]"), metavar="W", help="Load on the shaft [N], instead.")
@_number("radius", "Radius R of the bore [m].", "R")
@_number("clearance", "Radial clearance c [m].", "C")
@_number("width", "Width B [m].", "B")
@_number("viscosity", "Dynamic viscosity of the oil [Pa s].", "ETA")
@_number("speed", "Speed of the shaft [rad/s].", "OMEGA")
@_number("bore_speed", "Speed of the bore [rad/s], the load standing still.", "OMEGA")
@_pair("tilt", "AX AY", "Tilt of the shaft about x and y [rad].")
@_pair("squeeze", "VX VY", "Velocity of the shaft's centre along x and y [m/s].")
@click.option(
    "--groove",
    "grooves",
    type=(Measured("[degrees]"), Measured("[degrees]"), Measured("[Pa]")),
    multiple=True,
    metavar="ANGLE WIDTH PRESSURE",
    help="Axial groove over the whole width: its middle from the load line in direction of "
    "rotation, its width [degrees], its pressure [Pa]. It stands still. Repeatable.",
)
@click.option(
    "--line-at-max-film",
    is_flag=True,
    help="p = 0 along the maximum film, as the classical tables have it. For --coefficients it "
    "turns with the shaft's eccentricity.",
)
@click.option(
    "--line-held",
    is_flag=True,
    help="For --coefficients the line of --line-at-max-film stays where it is when the shaft "
    "moves, as a groove does.",
)
@_number("ambient", "Pressure at the sides above that of cavitation [Pa].", "P")
@_choice("closed_side", CLOSED_SIDES, "Side without flow; lower is at z = -B/2.")
@_setting(
    "grade",
    "Oil by its grade at --temperature, in place of --viscosity: 'ISO VG 46', 'SAE 10W-40'.",
    show_default=False,
    metavar="NAME",
)
@_number("viscosity_40", "Or kinematic viscosity at 40 C [mm2/s],", "NU", optional=True)
@_number("viscosity_100", "and at 100 C [mm2/s].", "NU", optional=True)
@_number("temperature", "Effective temperature of such an oil [C].", "T", optional=True)
@_number(
    "supply_temperature",
    "Or temperature of the oil that comes in [C], from which the effective one follows: the power "
    "dissipated leaves with the oil.",
    "T",
    optional=True,
)
@_number("conducted", "But for this share, which shaft and bore conduct away.", "SHARE")
@_number("mixing", "Effective temperature between supply (0) and outlet (1).", "SHARE")
@_number("specific_heat", "Of the oil [J/(kg K)].", "C")
@_number("density", "Density of the oil, at 15 C of such an oil [kg/m3].", "RHO")
@_number("barus", "Viscosity exp(ALPHA p), ALPHA [1/Pa].", "ALPHA")
@_number("roelands", "Viscosity after Roelands with pressure index Z, 0.6 say.", "Z")
@_choice("density_law", DENSITY_LAWS, "Density of the oil by its pressure.")
@_number("compressibility", "a of its 1 + a p / (1 + b p) [1/Pa].", "A")
@_number("stiffening", "b of that [1/Pa].", "B")
@_number("cross_rate", "Shear rate of Cross's shear thinning [1/s].", "RATE", optional=True)
@_number("cross_exponent", "Its exponent.", "M")
@_number("cross_second_viscosity", "Viscosity at the highest shear rates over that at rest.", "R")
@shape_options
@_number("journal_roughness", "rms roughness of the shaft [m], 0: smooth.", "SIGMA")
@_number("bore_roughness", "rms roughness of the bore [m], 0: smooth.", "SIGMA")
@_number("asperity_product", "Density x radius x combined roughness of the asperities.", "X")
@_number("asperity_slenderness", "Combined roughness over radius of the asperities.", "X")
@_number("summit_offset", "Tips' mean planes above the surfaces', over the roughness.", "D")
@_number("contact_modulus", "E' of asperities, 1 / E' = sum (1 - nu^2) / E [Pa].", "E")
@_number("boundary_friction", "Coefficient of friction of asperities that touch.", "MU")
@click.option(
    "--flow-factors/--no-flow-factors",
    default=_default("flow_factors"),
    show_default=True,
    help="Whether oil between rough surfaces flows as Patir and Cheng have it.",
)
@_choice(
    "cavitation",
    CAVITATION,
    "Cavitation condition; mass-conserving: that of Jakobsson, Floberg and Olsson, needs a supply.",
)
@_choice("shear_rule", SHEAR_RULES, "Shear in the cavitated zone.")
@click.option(
    "--cells",
    default=f"{_default('cells_around')}x{_default('cells_along')}",
    show_default=True,
    metavar="NxM",
    help="Cells around and along, more where the film is thin. The default gives the load to 0.1 % "
    "for eccentricities from 0.1 to 0.999 and B from R/2 to 8R.",
)
@click.option(
    "--element",
    type=click.Choice(ELEMENTS),
    help="9-node, 4-node or 8-node (the paper's).  [default: lagrange, the first; mass-conserving: "
    "bilinear]",
)
@click.option("--coefficients", is_flag=True, help="Add stiffness, damping and stability.")
@click.option("--plot", type=click.Path(dir_okay=False), help="Draw pressure, film and forces.")
@json_option
def bearing(
    eccentricity: float | None,
    load: float | None,
    grooves: tuple[tuple[float, float, float], ...],
    cells: str,
    element: str | None,
    coefficients: bool,
    plot: str | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Read the options, solve, print."""
    if (eccentricity is None) == (load is None):
        raise SettingsError("give either --eccentricity or --load")
    around, along = _cells(cells)
    conserving = options["cavitation"] == "mass-conserving"
    if conserving and coefficients:
        raise SettingsError(
            "--coefficients: those of --cavitation mass-conserving depend on the frequency, take "
            "reynolds"
        )
    element = element or ("bilinear" if conserving else _default("element"))
    shape = bore_shape(options)
    settings = BearingSettings(
        bore_shape=shape,
        cells_around=around,
        cells_along=along,
        element=element,
        grooves=[_groove(groove) for groove in grooves],
        **options,
    )
    if settings.heated and settings.temperature > NO_TEMPERATURE:
        raise SettingsError(
            "--temperature and --supply-temperature exclude each other: the effective one is "
            "given, or it follows"
        )
    if plot:
        from fenics_ehd.plotting.bearing import require_format

        require_format(plot)
    result = _solve(settings, eccentricity, load, coefficients)
    if plot:
        from fenics_ehd.plotting.bearing import plot_bearing

        plot_bearing(result, plot)
    from fenics_ehd.base.output import to_json

    click.echo(to_json(summary(result)) if as_json else report(result))


def _solve(
    settings: BearingSettings, eccentricity: float | None, load: float | None, coefficients: bool
) -> BearingResult:
    """Solve; a film that fails is kept in the current folder."""
    from fenics_ehd.base.output import keeping_failed_film
    from fenics_ehd.bearing.operating_point import solve_bearing

    with keeping_failed_film("."):
        return solve_bearing(
            settings, eccentricity=eccentricity, load=load, with_coefficients=coefficients
        )
