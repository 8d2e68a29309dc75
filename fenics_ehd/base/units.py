"""Conversion of numbers with units, such as ``"9000 rpm"`` or ``"20 um"``, to the setting's unit.

The unit of a setting is in brackets in its help text. Units are in a table of this module. The
library pint would read "40 C" as coulombs and accept hertz for radians per second. Here C is a
temperature, and an angle is a dimension of its own, so that a frequency is not an angular speed.
Factors are exact until the last product: ``"20 um"`` is the same number as ``20e-6``.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from math import pi

from fenics_ehd.base.errors import SettingsError

#: Revolutions per minute in one radian per second.
RPM = 30.0 / pi

#: Pattern of a number in the digits 0 to 9 without grouping. Python would also read 1_0 as 10, and
#: digits of other scripts.
NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"

#: Pattern of a number and its unit; an exponent has at most three digits.
WRITTEN = re.compile(
    rf"\s*({NUMBER.replace('[0-9]+)?', '[0-9]{1,3})?')})\s*"
    r"((?:1\s*)?/.*?|[^\W\d].*?|[%\u00b0].*?)\s*"
)

#: Largest number of characters of a number; Python does not convert integers of over 4300 digits.
LONGEST = 400

#: Power of ten of each prefix; micro is u, the micro sign or the letter mu.
PREFIXES = {"n": -9, "u": -6, "\u00b5": -6, "\u03bc": -6, "m": -3, "c": -2, "k": 3, "M": 6, "G": 9}


@dataclass(frozen=True)
class Unit:
    """A unit in terms of base units, ``factor pi^turns kg^a m^b s^c K^d rad^e``.

    Attributes
    ----------
    factor, turns
        Rational factor and exponent of pi.
    powers
        Exponents of the base units by name, a to e.
    zero
        Temperature of the zero of a temperature scale [K]; 0 for other units.
    """

    factor: Fraction
    powers: Counter[str]
    turns: int = 0
    zero: Fraction = Fraction(0)


#: Units of a speed of rotation that count revolutions, without spaces. Of a quantity that is no
#: angular speed they are rates, such as 1/s.
REVOLUTIONS = ("1/min", "/min", "min-1", "min^-1", "r/min", "rev/min")

#: Pattern of one factor of a unit, such as ``m2``.
_WORD = re.compile(r"[^\s*\u00b7]+")

#: Pattern of the symbol and the exponent in a factor.
_SYMBOL = re.compile(r"([^\W\d_]+|[%\u00b0])\^?(-?[0-9])?")


def _unit(factor: str, powers: str = "", turns: int = 0, zero: str = "0") -> Unit:
    """Make a unit from a factor and a text with the exponents of the base units, ``kg m s-2``."""
    by_symbol = {m[1]: int(m[2] or 1) for m in map(_SYMBOL.fullmatch, powers.split()) if m}
    return Unit(Fraction(factor), Counter(by_symbol), turns, Fraction(zero))


#: Units that may have a prefix.
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

#: Units that cannot have a prefix, by all their names.
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

#: Units of temperature scales, which cannot be factors of other units.
SCALES = {
    **dict.fromkeys(("C", "degC", "\u00b0C"), _unit("1", "K", zero="273.15")),
    **dict.fromkeys(("F", "degF", "\u00b0F"), _unit("5/9", "K", zero="45967/180")),
}


def _symbol(symbol: str) -> Unit | None:
    """Unit of a symbol such as ``mm`` or ``s``, with or without a prefix; None if it is unknown.

    A unit without a prefix has precedence: ``min`` is a minute, not a milli-inch.
    """
    known = _PLAIN.get(symbol) or _ALONE.get(symbol)
    if known is None and symbol[:1] in PREFIXES and symbol[1:] in _PLAIN:
        plain = _PLAIN[symbol[1:]]
        return replace(plain, factor=plain.factor * Fraction(10) ** PREFIXES[symbol[0]])
    return known


@lru_cache(maxsize=256)
def unit(text: str) -> Unit | None:
    """Unit of a text such as ``C``, ``kg m2``, ``N s/m``, ``J/(kg K)`` or ``1/Pa``.

    All units behind the slash are in the denominator, with or without parentheses. The result is
    None if the text is not a known unit.
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
        base = _symbol(match[1]) if match else None
        if match is None or base is None:
            return None
        power = sign * int(match[2] or 1)
        factor *= base.factor**power
        turns += power * base.turns
        for name, exponent in base.powers.items():
            powers[name] += power * exponent
    return Unit(factor, powers, turns)


def parse_number(text: str) -> float:
    """Convert a text without a unit to a number; infinite if it exceeds the largest float.

    Raises
    ------
    ValueError
        If the text does not match `NUMBER`.
    """
    if not re.fullmatch(NUMBER, text.strip()):
        raise ValueError(f"{text!r} is no number")
    return float(text)


def in_unit(written: str, wanted: str) -> float:
    """Convert a text with a number and a unit to the number in the unit of a setting.

    Parameters
    ----------
    written
        Number and unit, for instance ``"20 um"``.
    wanted
        Unit of the setting, for instance ``"m"``; empty if the setting has no unit. The value of
        such a setting may be written in per cent.

    Raises
    ------
    SettingsError
        If the text is not a number with a unit of the same quantity as `wanted`. The message
        begins with "must be", so that the caller can put the name of the setting before it.
    """
    expected = f" in {wanted}" if wanted else ""
    match = WRITTEN.fullmatch(written)
    if match is None or len(match[1]) > LONGEST:
        raise SettingsError(f"must be a finite number{expected}, or a number with a unit")
    symbol = match[2]
    speed = wanted == "rad/s" and "".join(symbol.split()) in REVOLUTIONS
    have = unit("rpm" if speed else symbol)
    want = unit(wanted)
    if have is None:
        raise SettingsError(f"must be a number{expected}: {symbol!r} is not a known unit")
    if want is None or have.powers != want.powers or (have.zero and not want.zero):
        raise SettingsError(
            f"must be a number{expected}, or a number with a unit of that quantity: {symbol} is a "
            "unit of another quantity"
        )
    number = (Fraction(match[1]) * have.factor + have.zero - want.zero) / want.factor
    try:
        return float(number) * pi ** (have.turns - want.turns)
    except OverflowError:
        raise SettingsError(f"must be a finite number{expected}") from None


def unit_of(help_text: str) -> str:
    """Unit in brackets in a help text; empty if there is none."""
    match = re.search(r"\[([^];-]+)\]", help_text)
    return match[1] if match else ""
