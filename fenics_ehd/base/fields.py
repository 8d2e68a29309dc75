"""Fields of settings classes: numbers with units and limits, words, switches, tables.

A number may be written with its unit, see `fenics_ehd.base.units`. Limits refuse values that can
only be in a wrong unit; notices report unusual values, which may be in a wrong unit. The upper
limit of a length is above the lengths of real machines [m], but below the numbers that express such
lengths in millimetres or micrometres.
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
from fenics_ehd.base.described import Named
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
    """Make a field of an attrs class whose value is checked.

    Parameters
    ----------
    default, help_text
        Default of the field and description of its value.
    check
        Function of the name and the value that raises `SettingsError` for a wrong value.
    converter
        Function that converts the value before the check.
    more
        Further metadata of the field.
    """
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
    words: Mapping[str, float] | None = None,
) -> Any:
    """Field for a real number with limits.

    The limits `above` and `below` are exclusive, `least` and `most` are inclusive. The help text
    has the unit of the setting in brackets. A text is accepted if it is a number with a unit, or
    one of the `words`. A value beyond a limit may be a number in another unit; the message
    therefore has the `example` and the unit of the setting. Magnitudes outside `usual` are reported
    by `fenics_ehd.base.settings.unusual`.
    """
    unit = unit_of(help_text)
    measured = f"in {unit}, " if unit else ""
    hint = f": {measured}{example}" if example else ""
    check = limits(above=above, least=least, below=below, most=most, unit=unit, hint=hint)

    def convert(value: Any) -> Any:
        if words and isinstance(value, str) and value in words:
            return words[value]
        return as_float(value, unit)

    def check_words(name: str, value: Any) -> None:
        if words and isinstance(value, str):
            raise SettingsError(f"{name} = {value!r} must be a number or {' or '.join(words)}")
        check(name, value)

    return checked(default, help_text, check_words, convert, usual=(usual, hint))


def count(default: int, help_text: str, least: int = 0, most: int | None = None) -> Any:
    """Field for a whole number from `least` to `most`."""
    return checked(default, help_text, whole_number(least, most))


def rows(columns: tuple[str, ...], help_text: str, units: tuple[str, ...]) -> Any:
    """Field for a list of rows of numbers, empty by default.

    `columns` and `units` have the name and the unit of each column.
    """

    def is_row(row: Any) -> bool:
        return isinstance(row, (list, tuple)) and len(row) == len(columns)

    def convert(value: Any) -> Any:
        if not isinstance(value, (list, tuple)) or not all(map(is_row, value)):
            return value
        return tuple(tuple(map(as_float, row, units)) for row in value)

    def check(name: str, value: Any) -> None:
        if not isinstance(value, tuple) or not all(map(is_row, value)):
            raise SettingsError(
                f"{name} = {value!r} must be a list of rows with {len(columns)} numbers each, "
                f"[[{', '.join(columns)}], ...]"
            )
        for row in value:
            for column, unit, entry in zip(columns, units, row, strict=True):
                require_finite(f"{name}: {column}", entry, unit)

    return checked((), help_text, check, convert)


def choice(default: str, options: tuple[str, ...], help_text: str) -> Any:
    """Field for one of several words."""
    listed = ", ".join(options)
    return checked(default, f"{help_text}: {listed}", one_of(options), options=options)


def text(default: str, help_text: str) -> Any:
    """Field for a text that is not empty and can be the name of a file."""
    check = unless(
        lambda word: isinstance(word, str) and word != "" and "\0" not in word, "a non-empty text"
    )
    return checked(default, help_text, check)


def flag(default: bool, help_text: str) -> Any:
    """Field for true or false."""
    check = unless(lambda word: isinstance(word, bool), "true or false")
    return checked(default, help_text, check)


def section(cls: type) -> Any:
    """Field for a nested table with the settings of a class."""
    return attrs.field(factory=cls, metadata={"section": cls})


def option(cls: type) -> Any:
    """Field for a nested table that is None unless the scene has it."""
    return attrs.field(default=None, metadata={"section": cls, "optional": True})


def table(
    help_text: str,
    check: Callable[[str, Any], None],
    converter: Callable[[Any], Any],
    kept: Callable[[str], bool] = lambda key: False,
) -> Any:
    """Field for a table with free keys, whose values are converted and checked one by one.

    A value is not converted if `kept` returns true for its key.
    """

    def check_all(name: str, value: Any) -> None:
        if not isinstance(value, Mapping):
            raise SettingsError(f"{name} = {value!r} must be a table")
        for key, entry in value.items():
            check(f"{name}.{key}", entry)

    def convert(value: Any) -> Any:
        if not isinstance(value, Mapping):
            return value  # the check refuses the value, with the name in its message
        return {key: entry if kept(key) else converter(entry) for key, entry in value.items()}

    factory: Any = attrs.Factory(dict)
    return checked(factory, help_text, check_all, convert, table=True)


def is_cell_count(key: str) -> bool:
    """Whether a parameter of a model is a number of cells, judged by the parameter's name."""
    return "cells" in key or "layers" in key


def numbers(help_text: str) -> Any:
    """Field for a table of numbers with free names, in the unit of the help text.

    Numbers of cells have no unit.
    """
    unit = unit_of(help_text)

    def check(name: str, value: Any) -> None:
        if isinstance(value, str) and is_cell_count(name.rpartition(".")[2]):
            raise SettingsError(f"{name} = {value!r} must be a number of cells, without a unit")
        require_finite(name, as_float(value), unit)

    return table(
        help_text,
        check,
        # Whole numbers are not converted to floats: they may be numbers of cells.
        lambda value: as_float(value, unit) if isinstance(value, str) else value,
        is_cell_count,
    )


def entries(
    help_text: str, kinds: Mapping[str, type], named: Mapping[str, type] = MappingProxyType({})
) -> Any:
    """Field for a table of named tables.

    Parameters
    ----------
    help_text
        Description of the tables.
    kinds
        Settings classes by the value of the key ``kind`` in a table.
    named
        Settings classes by the name of a table, for names with a fixed meaning.
    """
    return attrs.field(
        factory=Named,
        converter=lambda value: Named(value, "table") if isinstance(value, dict) else value,
        metadata={"help": help_text, "table": True, "kinds": kinds, "named": named},
    )


#: Elements of a film mesh: 9-node, 8-node, 4-node.
FILM_ELEMENTS = ("lagrange", "serendipity", "bilinear")


#: Number of film meshes over which dynamic coefficients are averaged: the default, and the largest.
FILM_MESHES = 4


def film_meshes() -> Any:
    """Field for the number of film meshes over which dynamic coefficients are averaged."""
    help_text = (
        "film meshes over which stiffness and damping are averaged, with 0, 2, 4 and 6 cells more "
        "around; 1: the given mesh alone"
    )
    return count(FILM_MESHES, help_text, least=1, most=FILM_MESHES)


def film_element() -> Any:
    """Field for the element of a film mesh."""
    return choice("lagrange", FILM_ELEMENTS, "9-node (lagrange), 8-node or bilinear")


#: Rules for the part of the cavitated zone in which oil is sheared.
SHEAR_RULES = ("streamers", "full", "none")


def shear_rule() -> Any:
    """Field for the rule for shear in the cavitated zone."""
    return choice("streamers", SHEAR_RULES, "oil that is sheared where the film cavitates")


#: Cavitation models.
CAVITATIONS = ("reynolds", "mass-conserving")


def cavitation() -> Any:
    """Field for the cavitation model."""
    help_text = "reynolds, or mass-conserving (JFO), which needs bilinear elements"
    return choice("reynolds", CAVITATIONS, help_text)


#: Limit of an ambient pressure [Pa], above any pressure that parts of steel withstand.
MOST_PRESSURE = 1e12


def ambient_pressure() -> Any:
    """Field for the pressure at both sides of a film [Pa]."""
    return number(
        0.0,
        "at both sides, above that at which the film cavitates [Pa]",
        least=0,
        below=MOST_PRESSURE,
        usual=(1e3, 1e9),
        example="1e5 for 1 bar",
    )


#: Methods of transfer between a film mesh and a bore with another mesh.
TRANSFERS = ("conservative", "mortar")

#: Interpolations in time between the rows of a table of loads.
INTERPOLATIONS = ("cubic", "linear")

#: Largest bearing radius, bearing width or crank radius [m].
LARGEST_LENGTH = 5.0

#: Largest radial clearance [m].
LARGEST_CLEARANCE = 5e-3

#: Smallest and largest accepted ratio of clearance to bore radius. Ratios of real bearings are at
#: least 100 times the smallest: below it, the radius is in millimetres, or the clearance cannot be
#: manufactured. The largest ratio is a limit of lubrication theory, which neglects terms of its
#: order.
CLEARANCE_RATIOS = (1e-5, 0.1)


def pair(
    help_text: str, default: Any = (0.0, 0.0), *, below: float = 1e15, zero: bool = True
) -> Any:
    """Field for two numbers along x and y, with magnitudes below a limit.

    Both may be 0 if `zero` is true.
    """
    unit = unit_of(help_text)
    check = plane_vector(unit, below=below, zero=zero)
    return checked(default, help_text, check, partial(as_tuple, unit=unit))


#: Largest coordinate of a point in the plane [m].
FARTHEST = 100 * LARGEST_LENGTH


def place(help_text: str, default: Any = (0.0, 0.0)) -> Any:
    """Field for the position of a point in the plane [m]."""
    return pair(help_text, default, below=FARTHEST)


def places(help_text: str) -> Any:
    """Field for positions of points in the plane by name [m]."""
    unit = unit_of(help_text)
    check = plane_vector(unit, below=FARTHEST)
    return table(help_text, check, partial(as_tuple, unit=unit))


def names(help_text: str, default: Any = (), *, count: int | None = None) -> Any:
    """Field for a list of `count` names, or of any number of names if `count` is None."""

    def listed(value: Any) -> bool:
        words = isinstance(value, tuple) and all(isinstance(n, str) and n for n in value)
        return words and count in (None, len(value))

    wanted = "a list of names" if count is None else f"a list of {count} names"
    return checked(default, help_text, unless(listed, wanted), as_tuple)


def youngs_modulus(default: float) -> Any:
    """Field for Young's modulus of a part [Pa]; 210 (GPa) and 210e3 (MPa) are refused."""
    return number(
        default, "[Pa]", least=1e6, below=1e18, usual=(1e9, 2e12), example="210e9 for 210 GPa"
    )


def density(default: float, help_text: str = "[kg/m3]", least: float = 100.0) -> Any:
    """Field for the density of a part [kg/m3]; 7.85 and 7.85e6, in other units, are refused."""
    return number(
        default, help_text, least=least, below=1e5, usual=(500, 25e3), example="7850 for 7.85 g/cm3"
    )


def mass(default: float, help_text: str, largest: float) -> Any:
    """Field for the mass of a rigid body [kg], 0 or more; above `largest` it is unusual."""
    return number(default, help_text, least=0, usual=(1e-4, largest), example="0.5 for 500 g")


def speed(default: float, help_text: str) -> Any:
    """Field for an angular speed [rad/s]; a value above 2e4 gives a notice, it may be in rpm."""
    return number(default, help_text, usual=(0.01, 2e4), example="314 for 3000 rpm")


def metres(default: float, help_text: str, *, below: float = LARGEST_LENGTH) -> Any:
    """Field for a length of a machine [m]; if `default` is 0, 0 means that no length is set."""
    return number(
        default, help_text, **_above_zero(default), below=below, example="0.025 for 25 mm"
    )


def viscosity(default: float, help_text: str) -> Any:
    """Field for a dynamic viscosity [Pa s]; if `default` is 0, 0 means that none is set."""
    return number(
        default,
        help_text,
        **_above_zero(default),
        below=1e6,
        usual=(1e-5, 1.0),
        example="0.01 for 10 mPa s",
    )


def _above_zero(default: float) -> dict[str, Any]:
    """Lower limit 0 of a positive quantity; the value 0 is accepted only if it is the default."""
    return {"above": 0.0} if default else {"least": 0.0}


def radial_clearance(default: float) -> Any:
    """Field for the radial clearance of a bearing [m]."""
    return number(
        default, "radial clearance [m]", above=0, below=LARGEST_CLEARANCE, example="30e-6 for 30 um"
    )


def deviation(help_text: str) -> Any:
    """Field for the deviation of a surface from a round one [m], of either sign."""
    return number(
        0.0,
        help_text,
        above=-LARGEST_CLEARANCE,
        below=LARGEST_CLEARANCE,
        usual=(1e-8, 1e-3),
        example="5e-6 for 5 um",
    )


def require_thin_film(clearance: float, radius: float, key: str) -> None:
    """Refuse a clearance [m] whose ratio to the bore radius [m] is outside `CLEARANCE_RATIOS`.

    Raises
    ------
    SettingsError
        If the ratio is outside these limits; the message has `key` and both lengths.
    """
    least, most = CLEARANCE_RATIOS
    # A clearance at the limit may be rounded down.
    if not least * (1 - 1e-9) * radius <= clearance < most * radius:
        raise SettingsError(
            f"{key} = {clearance:g} m must be at least {least:g} and below {most:g} times the "
            f"bore radius {radius:g} m: lengths must be in metres, and the film must be thin"
        )
