"""Values of a swept key as written on the command line."""

from __future__ import annotations

import decimal
import json
from decimal import Decimal
from typing import Any

from fenics_ehd.errors import SettingsError

#: Cases of one sweep, and so values of one key.
MOST_CASES = 10_000

#: Digits of the arithmetic between the ends of a range, and those that are kept of it: far more
#: than a float has, so that 10e-6:30e-6:5 gives the float 2e-05 and not a neighbour of it.
_WORKING, _KEPT = decimal.Context(prec=40), decimal.Context(prec=28)


def parse_values(key: str, text: str, like: object) -> tuple[Any, ...]:
    """Values for a key, in the order given.

    Parameters
    ----------
    key
        Named in errors.
    text
        ``a:b:n``, `n` numbers from `a` to `b` with equal distances, ``a:b:n:log`` with
        equal ratios; numbers and ranges, or words, with commas between; lists with
        semicolons between.
    like
        A value of the kind that the key takes. What does not fit stays text, which the
        settings then refuse with their own words.

    Raises
    ------
    SettingsError
        A range or list is malformed, a value is missing or given twice.
    """
    items = [item.strip() for item in text.split(";" if isinstance(like, tuple) else ",")]
    if not all(items):
        raise SettingsError(f"{key} = {text!r}: a value is missing")
    values: list[Any] = []
    for item in items:
        if isinstance(like, tuple):
            values.append(_list(key, item))
        elif isinstance(like, bool):
            values.append({"true": True, "false": False}.get(item.lower(), item))
        elif isinstance(like, str):
            values.append(item)
        elif ":" in item:
            values += [_plain(number, like) for number in _range(key, item)]
        else:
            number = _decimal(item)
            values.append(item if number is None else _plain(number, like))
    _require_distinct(key, values)
    return tuple(values)


def as_text(value: object) -> str:
    """A value in a table: words as they are, all else as JSON, floats with every digit."""
    return value if isinstance(value, str) else json.dumps(value)


def _require_distinct(key: str, values: list[Any]) -> None:
    seen = set()
    for text in map(as_text, values):
        if text in seen:
            raise SettingsError(f"{key} = {text}: the value is given twice")
        seen.add(text)


def _list(key: str, item: str) -> list[Any]:
    try:
        value = json.loads(item)
    except (json.JSONDecodeError, RecursionError):
        value = None
    if not isinstance(value, list):
        raise SettingsError(
            f"{key} = {item!r} must be a list, [20, 5] say; put semicolons between several"
        )
    return value


def _decimal(item: str) -> Decimal | None:
    """Number of a text, None where it holds none."""
    try:
        return Decimal(item)
    except decimal.InvalidOperation:
        return None


def _plain(number: Decimal, like: object) -> float | int:
    """The number as a float, or as an int where the key takes whole numbers and this is one."""
    whole = isinstance(like, int) and number.is_finite() and number.adjusted() < _KEPT.prec
    return int(number) if whole and number == int(number) else float(number)


def _range(key: str, item: str) -> list[Decimal]:
    """Numbers of ``a:b:n`` or ``a:b:n:log``; both ends are among them exactly."""
    parts = [part.strip() for part in item.split(":")]
    ends = [_decimal(part) for part in parts[:2]]
    logarithmic = len(parts) == 4 and parts[3] == "log"
    if len(parts) != 3 and not logarithmic:
        raise SettingsError(f"{key} = {item!r} must be first:last:count or first:last:count:log")
    first, last = ends
    if first is None or last is None or not (first.is_finite() and last.is_finite()):
        raise SettingsError(f"{key} = {item!r}: first and last must be finite numbers")
    count = int(parts[2]) if parts[2].isdecimal() and len(parts[2]) < 10 else 0
    if not 2 <= count <= MOST_CASES:
        raise SettingsError(
            f"{key} = {item!r}: count = {parts[2]} must be a whole number from 2 to {MOST_CASES}"
        )
    if logarithmic and not (first > 0 and last > 0):
        raise SettingsError(f"{key} = {item!r}: first and last must be above 0 for log")
    try:
        between = [_point(first, last, i, count - 1, logarithmic) for i in range(1, count - 1)]
    except decimal.DecimalException:
        raise SettingsError(f"{key} = {item!r}: its ends are too far apart") from None
    return [first, *between, last]


def _point(first: Decimal, last: Decimal, i: int, parts: int, logarithmic: bool) -> Decimal:
    """Point `i` of those that divide a range into `parts`."""
    with decimal.localcontext(_WORKING):
        if logarithmic:
            point = first * (last / first) ** (Decimal(i) / parts)
        else:
            point = first + (last - first) * i / parts
    return _KEPT.plus(point)
