"""Numbers with a written unit, ``"9000 rpm"`` or ``"20 um"``, in the unit of a setting.

A table, not a library: pint would read "40 C" as coulombs, multiply "1 / 3 m" out and accept
hertz for radians per second, and it is larger than the rest of `base`. Here C is a temperature,
an angle is a dimension of its own, so that a frequency is no angular speed, and factors are exact
until the last product: ``"20 um"`` is the number that ``20e-6`` is.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from math import pi

from fenics_ehd.base.errors import SettingsError

#: A number and its unit. No digits grouped, no exponent beyond what a float has.
WRITTEN = re.compile(
    r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)\s*((?:1\s*)?/.*?|[^\W\d].*?|[%\u00b0].*?)\s*"
)

#: Characters of a number; Python converts no integer of more than 4300 digits.
LONGEST = 400

#: Powers of ten that a prefix stands for; u, and the micro and mu signs.
PREFIXES = {"n": -9, "u": -6, "\u00b5": -6, "\u03bc": -6, "m": -3, "c": -2, "k": 3, "M": 6, "G": 9}

#: Of a unit: factor to kg, m, s, K and rad, power of pi in it, powers of these.
Row = tuple[str, int, str]
_PLAIN: dict[str, Row] = {
    "m": ("1", 0, "m"),
    "g": ("1/1000", 0, "kg"),
    "s": ("1", 0, "s"),
    "K": ("1", 0, "K"),
    "rad": ("1", 0, "rad"),
    "N": ("1", 0, "kg m s-2"),
    "Pa": ("1", 0, "kg m-1 s-2"),
    "bar": ("100000", 0, "kg m-1 s-2"),
    "J": ("1", 0, "kg m2 s-2"),
    "W": ("1", 0, "kg m2 s-3"),
    "P": ("1/10", 0, "kg m-1 s-1"),
    "St": ("1/10000", 0, "m2 s-1"),
    "l": ("1/1000", 0, "m3"),
    "Hz": ("1", 0, "s-1"),
}
_ALONE: dict[str, Row] = {
    "t": ("1000", 0, "kg"),
    "deg": ("1/180", 1, "rad"),
    "degree": ("1/180", 1, "rad"),
    "degrees": ("1/180", 1, "rad"),
    "\u00b0": ("1/180", 1, "rad"),
    "rev": ("2", 1, "rad"),
    "rpm": ("1/30", 1, "rad s-1"),
    "min": ("60", 0, "s"),
    "h": ("3600", 0, "s"),
    "L": ("1/1000", 0, "m3"),
    "%": ("1/100", 0, ""),
    "in": ("127/5000", 0, "m"),
}

#: Temperatures that do not begin at absolute zero: kelvins a degree, and what zero is [K].
SCALES = {
    **dict.fromkeys(("C", "degC", "\u00b0C"), (Fraction(1), Fraction("273.15"))),
    **dict.fromkeys(("F", "degF", "\u00b0F"), (Fraction(5, 9), Fraction("459.67") * 5 / 9)),
}

_FACTOR = re.compile(r"([^\W\d_]+|[%\u00b0])\^?(-?\d)?")


@dataclass(frozen=True)
class Unit:
    """Factor, times a power of pi, to kg, m, s, K and rad, and the powers of these."""

    factor: Fraction
    turns: int
    powers: frozenset[tuple[str, int]]


def _row(factor: str, turns: int, powers: str) -> Unit:
    found = {m[1]: int(m[2] or 1) for m in map(_FACTOR.fullmatch, powers.split()) if m}
    return Unit(Fraction(factor), turns, frozenset(found.items()))


def _symbol(symbol: str) -> Unit | None:
    """Of a unit with or without a prefix; a unit that looks like a prefixed one comes first."""
    if symbol in _PLAIN or symbol in _ALONE:
        return _row(*(_PLAIN.get(symbol) or _ALONE[symbol]))
    if symbol[:1] in PREFIXES and symbol[1:] in _PLAIN:
        plain = _row(*_PLAIN[symbol[1:]])
        return Unit(plain.factor * Fraction(10) ** PREFIXES[symbol[0]], plain.turns, plain.powers)
    return None


@lru_cache(maxsize=256)
def unit(text: str) -> Unit | None:
    """Unit of a text, ``kg m2``, ``N s/m``, ``J/(kg K)`` or ``1/Pa``; None: it is none.

    After the only slash, in parentheses or not, all is divided by.
    """
    above, slash, below = text.replace("\u00b2", "2").replace("\u00b3", "3").partition("/")
    if slash and re.fullmatch(r"\s*\(.*\)\s*", below):
        below = below.strip()[1:-1]
    factor, turns, powers = Fraction(1), 0, Counter[str]()
    parts = [(-1, below)] if slash else []
    if not (slash and above.strip() in ("", "1")):
        parts.append((1, above))
    for sign, part in parts:
        for word in re.split(r"[\s*\u00b7]+", part.strip()):
            match = _FACTOR.fullmatch(word)
            found = _symbol(match[1]) if match else None
            if match is None or found is None:
                return None
            power = sign * int(match[2] or 1)
            factor *= found.factor**power
            turns += power * found.turns
            for name, own in found.powers:
                powers[name] += power * own
    return Unit(factor, turns, frozenset((n, p) for n, p in powers.items() if p))


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
    match = WRITTEN.fullmatch(written)
    if match is None or len(match[1]) > LONGEST:
        raise SettingsError(f"must be a finite number{_told(wanted)}, or one with its unit")
    number, symbol = Fraction(match[1]), match[2]
    if wanted in SCALES:
        return _temperature(number, symbol, wanted)
    have, want = unit(symbol), unit(wanted) if wanted else _row("1", 0, "")
    if have is None and symbol not in SCALES:
        raise SettingsError(f"must be a number{_told(wanted)}: {symbol!r} is no unit known here")
    if have is None or want is None or have.powers != want.powers:
        raise SettingsError(f"must be a number{_told(wanted)} or a unit like it: {symbol} is none")
    ratio, turns = number * have.factor / want.factor, have.turns - want.turns
    return _finite(ratio, wanted) * pi**turns if turns else _finite(ratio, wanted)


def _temperature(number: Fraction, symbol: str, wanted: str) -> float:
    """On the scale of a setting."""
    have, size = unit(symbol), SCALES.get(symbol)
    if size is None:
        if have is None or have.powers != {("K", 1)}:
            raise SettingsError(f"must be a temperature in {wanted}, F or K: {symbol} is none")
        size = have.factor, Fraction(0)
    (degree, zero), (own, origin) = size, SCALES[wanted]
    return _finite((number * degree + zero - origin) / own, wanted)


def _finite(number: Fraction, wanted: str) -> float:
    """Nearest float."""
    try:
        return float(number)
    except OverflowError:
        raise SettingsError(f"must be a finite number{_told(wanted)}") from None


def _told(wanted: str) -> str:
    return f" in {wanted}" if wanted else ""
