"""Values of a swept key as written on the command line."""

from __future__ import annotations

import json
from collections import Counter
from contextlib import suppress
from math import isfinite
from typing import Any

import numpy as np

from fenics_ehd.base.errors import SettingsError

#: Cases of one sweep, and so values of one key.
MOST_CASES = 10_000


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
            number = _number(item)
            values.append(item if number is None else _plain(number, like))
    value, times = Counter(map(as_text, values)).most_common(1)[0]
    if times > 1:
        raise SettingsError(f"{key} = {value}: the value is given twice")
    return tuple(values)


def as_text(value: object) -> str:
    """A value in a table: words as they are, all else as JSON, floats with every digit."""
    return value if isinstance(value, str) else json.dumps(value)


def _list(key: str, item: str) -> list[Any]:
    with suppress(json.JSONDecodeError, RecursionError):
        value = json.loads(item)
        if isinstance(value, list):
            return value
    raise SettingsError(
        f"{key} = {item!r} must be a list, [20, 5] say; put semicolons between several"
    )


def _number(item: str) -> float | None:
    """Number of a text, None where it holds none."""
    with suppress(ValueError):
        return float(item)
    return None


def _plain(number: float, like: object) -> float | int:
    """The number, as an int where the key takes whole numbers and this is one."""
    return int(number) if isinstance(like, int) and number.is_integer() else number


def _range(key: str, item: str) -> list[float]:
    """Numbers of ``a:b:n`` or ``a:b:n:log``; both ends are among them exactly."""
    first_text, last_text, *counted = [part.strip() for part in item.split(":")]
    logarithmic = counted[1:] == ["log"]
    if len(counted) != 1 and not logarithmic:
        raise SettingsError(f"{key} = {item!r} must be first:last:count or first:last:count:log")
    first, last = _number(first_text), _number(last_text)
    if first is None or last is None or not (isfinite(first) and isfinite(last)):
        raise SettingsError(f"{key} = {item!r}: first and last must be finite numbers")
    count = int(counted[0]) if counted[0].isdecimal() and len(counted[0]) < 10 else 0
    if not 2 <= count <= MOST_CASES:
        raise SettingsError(
            f"{key} = {item!r}: count = {counted[0]} must be a whole number from 2 to {MOST_CASES}"
        )
    if logarithmic and not (first > 0 and last > 0):
        raise SettingsError(f"{key} = {item!r}: first and last must be above 0 for log")
    numbers = (np.geomspace if logarithmic else np.linspace)(first, last, count)
    # With the digits that a scene file keeps: 2e-05 and not a neighbour of it.
    return [first, *(float(f"{number:.12g}") for number in numbers[1:-1]), last]
