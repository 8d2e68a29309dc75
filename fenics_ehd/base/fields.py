"""Fields of settings: numbers with units and limits, words, switches, tables.

A number may have a written unit, see `fenics_ehd.base.units`. Limits refuse values that can only be
in a wrong unit; notices report values of unusual size, which may be in a wrong unit. The limits of
a length are above every real machine, and below the same length written in millimetres or
micrometres.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Any

import attrs

from fenics_ehd.base.checks import (
    as_float,
    as_tuple,
    limits,
    one_of,
    plane_vector,
    require_finite,
    unless,
    whole_number,
)
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.units import unit_of

#: Default of a key that must be written in every scene.
REQUIRED: Any = attrs.NOTHING


def checked(
    default: Any,
    help_text: str,
    check: Callable[[str, Any], None],
    converter: Callable[[Any], Any] | None = None,
    **more: Any,
) -> Any:
    """A field with a check of its value; `more` is further metadata."""
    return attrs.field(
        default=default,
        converter=converter,
        validator=lambda _, attribute, value: check(attribute.name, value),
        metadata={"help": help_text, **more},
    )


def number(
    default: float,
    help_text: str,
    *,
    above: float | None = None,
    least: float | None = None,
    below: float | None = None,
    most: float | None = None,
    usual: tuple[float, float] | None = None,
    example: str = "",
) -> Any:
    """Real number with limits: `above` and `below` exclusive, `least` and `most` inclusive.

    A text is a number with its unit; the help text has the unit of the setting in brackets. The
    message for a value beyond a limit has this unit and the `example`, because the value may be in
    another unit. Sizes outside `usual` are reported by `fenics_ehd.base.settings.unusual`.
    """
    unit = unit_of(help_text)
    measured = f"in {unit}, " if unit else ""
    hint = f": {measured}{example}" if example else ""
    check = limits(above=above, least=least, below=below, most=most, unit=unit, hint=hint)
    return checked(default, help_text, check, partial(as_float, unit=unit), usual=(usual, hint))


def count(default: int, help_text: str, least: int = 0, most: int | None = None) -> Any:
    """Whole number of at least `least` and at most `most`."""
    return checked(default, help_text, whole_number(least, most))


def rows(columns: tuple[str, ...], help_text: str, units: tuple[str, ...]) -> Any:
    """List of rows of numbers, empty by default; the columns have names and units."""

    def is_row(row: Any) -> bool:
        return isinstance(row, (list, tuple)) and len(row) == len(columns)

    def convert(value: Any) -> Any:
        if not isinstance(value, (list, tuple)) or not all(map(is_row, value)):
            return value
        return tuple(tuple(map(as_float, row, units)) for row in value)

    def check(name: str, value: Any) -> None:
        if not isinstance(value, tuple) or not all(map(is_row, value)):
            raise SettingsError(f"{name} = {value!r} must be a list of [{', '.join(columns)}]")
        for row in value:
            for column, unit, entry in zip(columns, units, row, strict=True):
                require_finite(f"{name}: {column}", entry, unit)

    return checked((), help_text, check, convert)


def choice(default: str, options: tuple[str, ...], help_text: str) -> Any:
    """One of several words."""
    listed = ", ".join(options)
    return checked(default, f"{help_text}: {listed}", one_of(options), options=options)


def text(default: str, help_text: str) -> Any:
    """Non-empty text that can name a file."""
    check = unless(
        lambda word: isinstance(word, str) and word != "" and "\0" not in word, "a non-empty text"
    )
    return checked(default, help_text, check)


def flag(default: bool, help_text: str) -> Any:
    """True or false."""
    check = unless(lambda word: isinstance(word, bool), "true or false")
    return checked(default, help_text, check)


def section(cls: type) -> Any:
    """Nested table."""
    return attrs.field(factory=cls, metadata={"section": cls})


def option(cls: type) -> Any:
    """Nested table that is None unless the scene has it."""
    return attrs.field(default=None, metadata={"section": cls, "optional": True})


def table(
    help_text: str,
    check: Callable[[str, Any], None],
    converter: Callable[[Any], Any],
    kept: Callable[[str], bool] = lambda key: False,
) -> Any:
    """Table with free names, whose values are converted and checked one by one.

    Values of keys for which `kept` is true are not converted.
    """

    def check_all(name: str, value: Any) -> None:
        if not isinstance(value, Mapping):
            raise SettingsError(f"{name} = {value!r} must be a table")
        for key, entry in value.items():
            check(f"{name}.{key}", entry)

    def convert(value: Any) -> Any:
        if not isinstance(value, Mapping):
            return value  # refused by the check, which knows the name
        return {key: entry if kept(key) else converter(entry) for key, entry in value.items()}

    factory: Any = attrs.Factory(dict)
    return checked(factory, help_text, check_all, convert, table=True)


def is_cell_count(key: str) -> bool:
    """True of a parameter of a model that is a number of cells."""
    return "cells" in key or "layers" in key


def numbers(help_text: str) -> Any:
    """Table with free names and numbers in the unit of the help text; those of cells have none."""
    unit = unit_of(help_text)

    def check(name: str, value: Any) -> None:
        if isinstance(value, str) and is_cell_count(name.rpartition(".")[2]):
            raise SettingsError(f"{name} = {value!r} must be a number of cells, without a unit")
        require_finite(name, as_float(value), unit)

    return table(
        help_text,
        check,
        # Whole numbers stay whole: they are numbers of cells.
        lambda value: as_float(value, unit) if isinstance(value, str) else value,
        is_cell_count,
    )


def entries(
    help_text: str, kinds: Mapping[str, type], named: Mapping[str, type] = MappingProxyType({})
) -> Any:
    """Table of named tables, whose settings classes follow from ``kind``, or from the name."""
    return attrs.field(
        factory=dict, metadata={"help": help_text, "table": True, "kinds": kinds, "named": named}
    )


#: Elements of a film mesh: 9-node, 8-node, 4-node.
FILM_ELEMENTS = ("lagrange", "serendipity", "bilinear")


def film_element() -> Any:
    """Element of a film mesh."""
    return choice("lagrange", FILM_ELEMENTS, "9-node (lagrange), 8-node or bilinear")


#: Parts of the cavities in which oil is sheared.
SHEAR_RULES = ("streamers", "full", "none")


def shear_rule() -> Any:
    """Rule for shear in the cavitated zone."""
    return choice("streamers", SHEAR_RULES, "oil that is sheared where the film cavitates")


#: Conditions of cavitation.
CAVITATIONS = ("reynolds", "mass-conserving")


def cavitation() -> Any:
    """Condition of cavitation."""
    help_text = "reynolds, or mass-conserving (JFO), which needs bilinear elements"
    return choice("reynolds", CAVITATIONS, help_text)


#: Limit of an ambient pressure, above any that parts of steel bear [Pa].
MOST_PRESSURE = 1e12


def ambient_pressure() -> Any:
    """Pressure at both sides of a film [Pa]."""
    return number(
        0.0,
        "at both sides, above that at which the film cavitates [Pa]",
        least=0,
        below=MOST_PRESSURE,
        usual=(1e3, 1e9),
        example="1e5 for 1 bar",
    )


#: Transfers of pressures between a film mesh and a bore with another mesh.
TRANSFERS = ("conservative", "mortar")

#: Interpolations between the rows of a load.
INTERPOLATIONS = ("cubic", "linear")

#: Largest bearing radius, bearing width or crank radius [m].
LARGEST_LENGTH = 5.0

#: Largest radial clearance [m].
LARGEST_CLEARANCE = 5e-3

#: Smallest and largest ratio of clearance and bore radius. Ratios of bearings are 100 times the
#: smallest or more: a smaller one means a radius in millimetres, or a clearance that cannot be
#: made. The largest follows from lubrication theory, which neglects terms of the order of the
#: ratio.
CLEARANCE_RATIOS = (1e-5, 0.1)


def pair(
    help_text: str, default: Any = (0.0, 0.0), *, below: float = 1e15, zero: bool = True
) -> Any:
    """Two numbers along x and y, of sizes below a limit; `zero`: both may be 0."""
    unit = unit_of(help_text)
    check = plane_vector(unit, below=below, zero=zero)
    return checked(default, help_text, check, partial(as_tuple, unit=unit))


#: Largest coordinate of a point in the plane [m].
FARTHEST = 100 * LARGEST_LENGTH


def place(help_text: str, default: Any = (0.0, 0.0)) -> Any:
    """A point in the plane [m]."""
    return pair(help_text, default, below=FARTHEST)


def places(help_text: str) -> Any:
    """Points in the plane by name [m]."""
    unit = unit_of(help_text)
    check = plane_vector(unit, below=FARTHEST)
    return table(help_text, check, partial(as_tuple, unit=unit))


def names(help_text: str, default: Any = (), *, count: int | None = None) -> Any:
    """A list of names, of a given `count` or of any."""

    def listed(value: Any) -> bool:
        words = isinstance(value, tuple) and all(isinstance(n, str) and n for n in value)
        return words and count in (None, len(value))

    wanted = "a list of names" if count is None else f"a list of {count} names"
    return checked(default, help_text, unless(listed, wanted), as_tuple)


def youngs_modulus(default: float) -> Any:
    """Young's modulus of a part [Pa]; 210 and 210e3 are refused, as values in GPa and MPa."""
    return number(
        default, "[Pa]", least=1e6, below=1e18, usual=(1e9, 2e12), example="210e9 for 210 GPa"
    )


def density(default: float, help_text: str = "[kg/m3]", least: float = 100.0) -> Any:
    """Density of a part [kg/m3]; 7.85 and 7.85e6 are refused, as values in other units."""
    return number(
        default, help_text, least=least, below=1e5, usual=(500, 25e3), example="7850 for 7.85 g/cm3"
    )


def mass(default: float, help_text: str, largest: float) -> Any:
    """Mass of a rigid body [kg], zero included; one above `largest` may be in grams."""
    return number(default, help_text, least=0, usual=(1e-4, largest), example="0.5 for 500 g")


def speed(default: float, help_text: str) -> Any:
    """Angular speed [rad/s]; a larger one may be in revolutions per minute."""
    return number(default, help_text, usual=(0.01, 2e4), example="314 for 3000 rpm")


def metres(default: float, help_text: str, *, below: float = LARGEST_LENGTH) -> Any:
    """Length of a machine [m]; 0 is accepted if it is the default, for a length not given."""
    return number(
        default, help_text, **_above_zero(default), below=below, example="0.025 for 25 mm"
    )


def viscosity(default: float, help_text: str) -> Any:
    """Dynamic viscosity [Pa s]; 0 is accepted if it is the default, for one not given."""
    return number(
        default,
        help_text,
        **_above_zero(default),
        below=1e6,
        usual=(1e-5, 1.0),
        example="0.01 for 10 mPa s",
    )


def _above_zero(default: float) -> dict[str, Any]:
    """Lower limit of a positive quantity, which includes 0 if that is the default."""
    return {"above": 0.0} if default else {"least": 0.0}


def radial_clearance(default: float) -> Any:
    """Radial clearance of a bearing [m]."""
    return number(
        default, "radial clearance [m]", above=0, below=LARGEST_CLEARANCE, example="30e-6 for 30 um"
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


def require_thin_film(clearance: float, radius: float, key: str) -> None:
    """Refuse a clearance outside `CLEARANCE_RATIOS` of the bore's radius, both in [m].

    Raises
    ------
    SettingsError
        The message has both lengths.
    """
    least, most = CLEARANCE_RATIOS
    # A clearance at the limit may be rounded down.
    if not least * (1 - 1e-9) * radius <= clearance < most * radius:
        raise SettingsError(
            f"{key} = {clearance:g} m must be at least {least:g} and below {most:g} of the bore "
            f"radius {radius:g} m: lengths are in metres, and the film is taken as thin"
        )
