"""Fields of settings: numbers with units and limits, words, switches, and the oil's own.

**Units.** A number may have a written unit, ``"9000 rpm"`` or ``"20 um"``; it is converted to that
of its setting, which stands in brackets in the help text. A table, not a library: pint would read
"40 C" as coulombs, multiply "1 / 3 m" out and accept hertz for radians per second, and it is larger
than the rest of `base`. Here C is a temperature, an angle is a dimension of its own, so that a
frequency is no angular speed, and factors are exact until the last product: ``"20 um"`` is the
number that ``20e-6`` is.

**Limits.** Quantities have limits that catch a wrong unit, or warnings where it may be one. A
length written in millimetres or micrometres is a thousand times too large or more: the limits are
generous, and still below that.

**Shared settings** stand behind the fields: of an oil, of rough surfaces, of shapes, the material
of a part.
"""

from __future__ import annotations

import operator
import re
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache, partial
from math import hypot, pi
from types import MappingProxyType
from typing import Any

import attrs

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.needs import NO_TEMPERATURE, NONE, not_with, only_with

#: A number in the digits 0 to 9, none of them grouped: Python reads 1_0 as 10, and digits of other
#: scripts.
NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"

#: A number and its unit. No exponent beyond what a float has.
WRITTEN = re.compile(
    rf"\s*({NUMBER.replace('[0-9]+)?', '[0-9]{1,3})?')})\s*"
    r"((?:1\s*)?/.*?|[^\W\d].*?|[%\u00b0].*?)\s*"
)

#: Characters of a number; Python converts no integer of more than 4300 digits.
LONGEST = 400

#: Powers of ten that a prefix stands for; u, and the micro and mu signs.
PREFIXES = {"n": -9, "u": -6, "\u00b5": -6, "\u03bc": -6, "m": -3, "c": -2, "k": 3, "M": 6, "G": 9}


@dataclass(frozen=True)
class Unit:
    """A unit in kg, m, s, K and rad.

    Attributes
    ----------
    factor, turns
        Its size is the factor times so many powers of pi.
    powers
        Of kg, m, s, K and rad.
    zero
        Where a scale of temperatures begins [K].
    """

    factor: Fraction
    powers: Counter[str]
    turns: int = 0
    zero: Fraction = Fraction(0)


#: A word of a unit, and its symbol and power.
_WORD = re.compile(r"[^\s*\u00b7]+")
_SYMBOL = re.compile(r"([^\W\d_]+|[%\u00b0])\^?(-?[0-9])?")


def _unit(factor: str, powers: str = "", turns: int = 0, zero: str = "0") -> Unit:
    """A unit whose powers are written as ``kg m s-2``."""
    found = {m[1]: int(m[2] or 1) for m in map(_SYMBOL.fullmatch, powers.split()) if m}
    return Unit(Fraction(factor), Counter(found), turns, Fraction(zero))


#: Units that take a prefix.
_PLAIN = {
    "m": _unit("1", "m"),
    "g": _unit("1/1000", "kg"),
    "s": _unit("1", "s"),
    "K": _unit("1", "K"),
    "rad": _unit("1", "rad"),
    "N": _unit("1", "kg m s-2"),
    "Pa": _unit("1", "kg m-1 s-2"),
    "bar": _unit("100000", "kg m-1 s-2"),
    "J": _unit("1", "kg m2 s-2"),
    "W": _unit("1", "kg m2 s-3"),
    "P": _unit("1/10", "kg m-1 s-1"),
    "St": _unit("1/10000", "m2 s-1"),
    "l": _unit("1/1000", "m3"),
    "Hz": _unit("1", "s-1"),
}

#: Units that take none; names of one unit share it.
_ALONE = {
    "t": _unit("1000", "kg"),
    **dict.fromkeys(("deg", "degree", "degrees", "\u00b0"), _unit("1/180", "rad", 1)),
    "rev": _unit("2", "rad", 1),
    "rpm": _unit("1/30", "rad s-1", 1),
    "min": _unit("60", "s"),
    "h": _unit("3600", "s"),
    "L": _unit("1/1000", "m3"),
    "%": _unit("1/100"),
    "in": _unit("127/5000", "m"),
}

#: Scales of temperature, which are no factors of other units.
SCALES = {
    **dict.fromkeys(("C", "degC", "\u00b0C"), _unit("1", "K", zero="273.15")),
    **dict.fromkeys(("F", "degF", "\u00b0F"), _unit("5/9", "K", zero="45967/180")),
}


def _symbol(symbol: str) -> Unit | None:
    """A unit with or without a prefix; one that looks like a prefixed one comes first."""
    known = _PLAIN.get(symbol) or _ALONE.get(symbol)
    if known is None and symbol[:1] in PREFIXES and symbol[1:] in _PLAIN:
        plain = _PLAIN[symbol[1:]]
        return replace(plain, factor=plain.factor * Fraction(10) ** PREFIXES[symbol[0]])
    return known


@lru_cache(maxsize=256)
def unit(text: str) -> Unit | None:
    """Unit of a text, ``C``, ``kg m2``, ``N s/m``, ``J/(kg K)`` or ``1/Pa``; None: it is none.

    After the only slash, in parentheses or not, all is divided by.
    """
    if text in SCALES:
        return SCALES[text]
    above, slash, below = text.replace("\u00b2", "2").replace("\u00b3", "3").partition("/")
    if slash and re.fullmatch(r"\s*\(.*\)\s*", below):
        below = below.strip()[1:-1]
    if slash and above.strip() == "1":
        above = ""
    words = [(1, word) for word in _WORD.findall(above)]
    words += [(-1, word) for word in _WORD.findall(below)]
    factor = Fraction(1)
    turns = 0
    powers = Counter[str]()
    for sign, word in words:
        match = _SYMBOL.fullmatch(word)
        found = _symbol(match[1]) if match else None
        if match is None or found is None:
            return None
        power = sign * int(match[2] or 1)
        factor *= found.factor**power
        turns += power * found.turns
        for name, own in found.powers.items():
            powers[name] += power * own
    return Unit(factor, powers, turns)


def parse_number(text: str) -> float:
    """Number of a text without a unit; it may be larger than any float, and then is infinite.

    Raises
    ------
    ValueError
        The text is no number in plain digits.
    """
    if not re.fullmatch(NUMBER, text.strip()):
        raise ValueError(f"{text!r} is no number")
    return float(text)


def in_unit(written: str, wanted: str) -> float:
    """A text's number in the unit of a setting.

    Parameters
    ----------
    written
        Number and unit, ``"20 um"``.
    wanted
        Unit of the setting, ``"m"``; empty: it has none, and takes per cent.

    Raises
    ------
    SettingsError
        What is to be written instead.
    """
    told = f" in {wanted}" if wanted else ""
    match = WRITTEN.fullmatch(written)
    if match is None or len(match[1]) > LONGEST:
        raise SettingsError(f"must be a finite number{told}, or one with its unit")
    symbol = match[2]
    have = unit(match[2])
    want = unit(wanted)
    if have is None:
        raise SettingsError(f"must be a number{told}: {symbol!r} is no unit known here")
    if want is None or have.powers != want.powers or (have.zero and not want.zero):
        raise SettingsError(f"must be a number{told} or a unit like it: {symbol} is none")
    number = (Fraction(match[1]) * have.factor + have.zero - want.zero) / want.factor
    try:
        return float(number) * pi ** (have.turns - want.turns)
    except OverflowError:
        raise SettingsError(f"must be a finite number{told}") from None


#: A key that must be written.
REQUIRED: Any = attrs.NOTHING

#: Sizes of a number whose powers and products are still numbers.
SMALLEST = 1e-30
LARGEST = 1e30


def checked(
    default: Any,
    help_text: str,
    check: Callable[[str, Any], None],
    converter: Callable[[Any], Any] | None = None,
    **more: Any,
) -> Any:
    """A field whose name and value a function may refuse; `more` goes into its metadata."""
    return attrs.field(
        default=default,
        converter=converter,
        validator=lambda _, attribute, value: check(attribute.name, value),
        metadata={"help": help_text, **more},
    )


def unless(holds: Callable[[Any], bool], wanted: str) -> Callable[[str, Any], None]:
    """A check that refuses a value for which something does not hold, saying what is wanted."""

    def check(name: str, value: Any) -> None:
        if not holds(value):
            shown = list(value) if isinstance(value, tuple) else value
            raise SettingsError(f"{name} = {shown!r} must be {wanted}")

    return check


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

    A text is a number with its unit, which the help text has in brackets. A value beyond a limit,
    perhaps in another unit, is told the unit and the `example`; one whose size is not between the
    `usual` ones is told so by `unusual`.
    """
    unit = unit_of(help_text)
    measured = f"in {unit}, " if unit else ""
    hint = f": {measured}{example}" if example else ""
    check = limits(above=above, least=least, below=below, most=most, unit=unit, hint=hint)
    return checked(default, help_text, check, partial(as_float, unit=unit), usual=(usual, hint))


def limits(
    *,
    above: float | None = None,
    least: float | None = None,
    below: float | None = None,
    most: float | None = None,
    unit: str = "",
    hint: str = "",
    sized: bool = True,
) -> Callable[[str, Any], None]:
    """A check that refuses what is no finite number within limits, see `number`.

    One that is `sized` refuses numbers other than 0 whose powers are no numbers, too.
    """

    def check(name: str, value: Any) -> None:
        require_finite(name, value, unit)
        for limit, words, holds in (
            (above, "above", operator.gt),
            (least, "at least", operator.ge),
            (below, "below", operator.lt),
            (most, "at most", operator.le),
        ):
            if limit is not None and not holds(value, limit):
                raise SettingsError(
                    f"{name} = {value!r} must be {words} {limit:g}"
                    + (hint if words != "above" else "")
                )
        if sized and value and not SMALLEST <= abs(value) <= LARGEST:
            raise SettingsError(
                f"{name} = {value!r} must be 0 or from {SMALLEST:g} to {LARGEST:g} in size"
            )

    return check


def unit_of(help_text: str) -> str:
    """Unit in brackets of a help text, empty where there is none."""
    found = re.search(r"\[([^];-]+)\]", help_text)
    return found[1] if found else ""


def require_finite(name: str, value: Any, unit: str = "") -> None:
    """Refuse what is no finite number, nor one with a unit.

    Raises
    ------
    SettingsError
        Naming the unit.
    """
    if isinstance(value, str):
        try:
            in_unit(value, unit)
        except SettingsError as error:
            raise SettingsError(f"{name} = {value!r} {error}") from None
    if not (isinstance(value, float) and abs(value) < float("inf")):
        raise SettingsError(f"{name} = {value!r} must be a finite number")


def as_float(value: Any, unit: str | None = None) -> Any:
    """A number, or a text with a `unit`, as a float; anything else as it is."""
    value = value.tolist() if hasattr(value, "tolist") else value  # of NumPy
    with suppress(SettingsError, OverflowError):  # told by the check, which knows the name
        if unit is not None and isinstance(value, str):
            return in_unit(value, unit)
        if type(value) is int:
            return float(value)
    return value


def as_tuple(value: Any, unit: str | None = None) -> Any:
    """Lists within lists as tuples, their whole numbers, and texts with a `unit`, as floats."""
    plain = as_float(value, unit)
    listed = isinstance(plain, (list, tuple))
    return tuple(as_tuple(entry, unit) for entry in plain) if listed else plain


def count(default: int, help_text: str, least: int = 0, most: int | None = None) -> Any:
    """Whole number of at least `least` and at most `most`."""
    limits = f"at least {least}" + (f" and at most {most}" if most is not None else "")
    check = unless(
        lambda n: type(n) is int and least <= n and (most is None or n <= most),
        f"a whole number, {limits}",
    )
    return checked(default, help_text, check)


def rows(columns: tuple[str, ...], help_text: str, units: tuple[str, ...]) -> Any:
    """List of rows of numbers with the given columns and their units, empty by default."""

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


def one_of(options: tuple[str, ...]) -> Callable[[str, Any], None]:
    """A check that refuses what is none of several words."""
    return unless(
        lambda word: isinstance(word, str) and word in options, f"one of {', '.join(options)}"
    )


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
    """Nested table that is not there unless it is listed: None."""
    return attrs.field(default=None, metadata={"section": cls, "optional": True})


def table(
    help_text: str,
    check: Callable[[str, Any], None],
    converter: Callable[[Any], Any],
    kept: Callable[[str], bool] = lambda key: False,
) -> Any:
    """Free table of names and what a function may refuse, which `converter` makes of each.

    Values of keys that are `kept` are not converted.
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
    """Free table of names and numbers, those with a unit in that of the help text.

    Numbers of cells have none.
    """
    unit = unit_of(help_text)

    def check(name: str, value: Any) -> None:
        if isinstance(value, str) and is_cell_count(name.rpartition(".")[2]):
            raise SettingsError(f"{name} = {value!r} must be a number of cells, without a unit")
        require_finite(name, as_float(value), unit)

    return table(
        help_text,
        check,
        # Whole ones stay so: cells of a mesh.
        lambda value: as_float(value, unit) if isinstance(value, str) else value,
        is_cell_count,
    )


def entries(
    help_text: str, kinds: Mapping[str, type], named: Mapping[str, type] = MappingProxyType({})
) -> Any:
    """Free table of tables by name, each of a class by its ``kind``, or by its name alone."""
    return attrs.field(
        factory=dict, metadata={"help": help_text, "table": True, "kinds": kinds, "named": named}
    )


#: Elements of a film mesh: 9-node, 8-node, 4-node; where its oil is sheared in cavities; conditions
#: of cavitation; transfers of pressures to a bore with another mesh; curves between rows of a load.
FILM_ELEMENTS = ("lagrange", "serendipity", "bilinear")
SHEAR_RULES = ("streamers", "full", "none")
CAVITATIONS = ("reynolds", "mass-conserving")
TRANSFERS = ("conservative", "mortar")
INTERPOLATIONS = ("cubic", "linear")

#: Largest bearing radius, bearing width or crank radius [m].
LARGEST_LENGTH = 5.0

#: Largest radial clearance [m].
LARGEST_CLEARANCE = 5e-3

#: Least and largest clearance over bore radius. Bearings have 100 times the least, so that a
#: smaller one is a radius in millimetres or a clearance that nobody can make; lubrication theory
#: drops terms of the order of the ratio.
CLEARANCE_RATIOS = (1e-5, 0.1)


def _plane_vector(unit: str, below: float, zero: bool) -> Callable[[str, Any], None]:
    """A check that refuses what is no pair of numbers below a limit in size, or zero."""
    no_zero = "" if zero else ", one of them not 0"

    def holds(value: Any) -> bool:
        if not isinstance(value, tuple) or len(value) != 2:
            return False
        numbers = all(isinstance(n, float) and abs(n) < below for n in value)
        return numbers and (zero or any(value))

    told = f" in {unit}" if unit else ""
    return unless(holds, f"two numbers [x, y]{told}, below {below:g}{no_zero}")


def pair(
    help_text: str, default: Any = (0.0, 0.0), *, below: float = 1e15, zero: bool = True
) -> Any:
    """Two numbers along x and y, each of a size below a limit, and perhaps not both 0."""
    unit = unit_of(help_text)
    check = _plane_vector(unit, below, zero)
    return checked(default, help_text, check, partial(as_tuple, unit=unit))


#: Largest coordinate of a place in the plane [m].
FARTHEST = 100 * LARGEST_LENGTH


def place(help_text: str, default: Any = (0.0, 0.0)) -> Any:
    """A place in the plane [m]."""
    return pair(help_text, default, below=FARTHEST)


def places(help_text: str) -> Any:
    """Places in the plane by name [m]."""
    unit = unit_of(help_text)
    return table(help_text, _plane_vector(unit, FARTHEST, True), partial(as_tuple, unit=unit))


def names(help_text: str, default: Any = (), *, count: int | None = None) -> Any:
    """A list of names, of a given `count` or of any."""

    def listed(value: Any) -> bool:
        words = isinstance(value, tuple) and all(isinstance(n, str) and n for n in value)
        return words and count in (None, len(value))

    wanted = "a list of names" if count is None else f"a list of {count} names"
    return checked(default, help_text, unless(listed, wanted), as_tuple)


def youngs_modulus(default: float) -> Any:
    """Young's modulus of a part [Pa]; 210 is no part's, nor is 210e3."""
    return number(
        default, "[Pa]", least=1e6, below=1e18, usual=(1e9, 2e12), example="210e9 for 210 GPa"
    )


def density(default: float, help_text: str = "[kg/m3]", least: float = 100.0) -> Any:
    """Density of a part [kg/m3]; 7.85 is no part's, nor is 7.85e6."""
    return number(
        default, help_text, least=least, below=1e5, usual=(500, 25e3), example="7850 for 7.85 g/cm3"
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
    """Refuse a clearance that is no small part of the bore's radius [m], or hardly any.

    Raises
    ------
    SettingsError
        Naming both.
    """
    least, most = CLEARANCE_RATIOS
    # One that is the limit is rounded.
    if not least * (1 - 1e-9) * radius <= clearance < most * radius:
        raise SettingsError(
            f"{key} = {clearance:g} m must be at least {least:g} and below {most:g} of the bore "
            f"radius {radius:g} m: lengths are in metres, and the film is taken as thin"
        )


#: Of mineral oils at 15 C [kg/m3]; paraffinic ones of The Tribology Handbook (table 25, opened at
#: digilib.universitaspertamina.ac.id) have 862 to 891 at 25 C.
DENSITY = 870.0

#: Of mineral oil [J/(kg K)], rounded from 1966 (www.pantherlubes.com/tl_12.html). It grows with
#: temperature by 0.2 % per K.
SPECIFIC_HEAT = 2000.0

#: Of Dowson's and Higginson's law (1966), mineral oils [1/Pa]: rise at ambient pressure, and how it
#: ends.
COMPRESSIBILITY = 0.6e-9
STIFFENING = 1.7e-9


def _kinematic(temperature: int) -> Any:
    return number(
        0.0,
        f"kinematic, at {temperature} C [mm2/s], both in place of viscosity; 0: not given",
        least=0,
        below=1e7,
        usual=(1.0, 5000.0),
        example="46 for 46 cSt",
    )


#: What makes an oil one of a grade, and surfaces rough, in messages.
GRADED = "a grade, or viscosity_40 and viscosity_100"
ROUGH = "journal_roughness or bore_roughness"


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
    grade: str = text(NONE, "ISO VG 46, SAE 10W-40 and others, in place of viscosity, or none")
    viscosity_40: float = _kinematic(40)
    viscosity_100: float = _kinematic(100)
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
            "b of that, by which oil under pressure is stiffer [1/Pa]",
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
        """True for a viscosity that comes from a grade or two kinematic viscosities."""
        return self.grade != NONE or bool(self.viscosity_40 or self.viscosity_100)


def only_if_rough(field: Any) -> Any:
    """A field that has an effect only between rough surfaces."""
    return only_with(field, "roughness", words=ROUGH)


def _roughness(of: str) -> Any:
    """Root mean square height of a surface [m]; ground ones have 0.1 to 1 um."""
    return number(
        0.0, f"of the {of}, rms [m], 0: smooth", least=0, below=1e-4, usual=(1e-9, 1e-5),
        example="0.4e-6 for 0.4 um",
    )  # fmt: skip


@attrs.frozen(kw_only=True, slots=False)
class Roughness:
    """Rough surfaces of a journal and its bore, which may touch; smooth without a roughness."""

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
    boundary_friction: float = only_with(
        only_if_rough(
            number(
                0.1,
                "coefficient of friction of asperities that touch [-], with friction",
                least=0,
                below=5,
            )
        ),
        "friction",
        "heat",
    )
    flow_factors: bool = only_if_rough(
        flag(True, "whether oil flows as Patir and Cheng have it, or as in a smooth average gap")
    )

    @property
    def roughness(self) -> float:
        """Combined rms roughness sigma [m]."""
        return hypot(self.journal_roughness, self.bore_roughness)


@attrs.frozen(slots=False)
class Deviations:
    """Deviations of the surface of a bore or a journal from the round one, + outward.

    In the frame of its body, which a journal's shape turns with; what is given adds up.
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
    taper: float = deviation("at the upper end, minus that at the lower one, linear [m]")
    misalignment: tuple[float, float] = pair("tilt of the axis about x and y [rad]", below=0.1)
    table: str = text(NONE, "CSV file angle_deg,height_m,deviation_m of more, or none")


@attrs.frozen
class Material:
    """Isotropic elastic material."""

    youngs_modulus: float = youngs_modulus(210e9)
    poissons_ratio: float = number(
        0.3, "[-]; quadratic elements lock above 0.49", above=-1, below=0.49
    )
    density: float = density(7850.0)
