"""Checks of values: finite numbers within limits, whole numbers, pairs, words.

A check is a function of name and value that raises `SettingsError`. Fields of settings
(`fenics_ehd.base.fields`) and arguments of functions (`fenics_ehd.base.arguments`) share the
checks, and so their messages.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from contextlib import suppress
from math import inf
from typing import Any

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.printed import shown
from fenics_ehd.base.units import in_unit

#: Smallest magnitude of a number other than 0: powers and products of such numbers do not vanish.
SMALLEST = 1e-30

#: Largest magnitude of a number: powers and products of such numbers do not overflow.
LARGEST = 1e30


def unless(holds: Callable[[Any], bool], wanted: str) -> Callable[[str, Any], None]:
    """Make a check that refuses values for which `holds` is false.

    `wanted` describes the accepted values; the message puts it after "must be".
    """

    def check(name: str, value: Any) -> None:
        if not holds(value):
            raise SettingsError(f"{name} = {shown(value)} must be {wanted}")

    return check


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
    """Make a check that accepts finite numbers within limits.

    Parameters
    ----------
    above, below
        Lower and upper limit; the limits themselves are refused.
    least, most
        Lower and upper limit; the limits themselves are accepted.
    unit, hint
        Unit of the number, and text at the end of the message about a number beyond a limit.
    sized
        Whether numbers other than 0 with magnitudes outside `SMALLEST` to `LARGEST` are refused.
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
                f"{name} = {value!r} must be 0 or from {SMALLEST:g} to {LARGEST:g} in magnitude"
            )

    return check


def require_finite(name: str, value: Any, unit: str = "") -> None:
    """Refuse a value that is not a finite number.

    Raises
    ------
    SettingsError
        If the value is not a finite number. About a text that cannot be converted to a number,
        the message has the unit in which the number must be.
    """
    if isinstance(value, str):
        try:
            in_unit(value, unit)
        except SettingsError as error:
            raise SettingsError(f"{name} = {value!r} {error}") from None
    if not (isinstance(value, float) and abs(value) < float("inf")):
        raise SettingsError(f"{name} = {shown(value)} must be a finite number")


def as_float(value: Any, unit: str | None = None) -> Any:
    """Convert a number, or a text with a number and its unit, to a float.

    Other values are returned unchanged. The check that follows refuses them, with the name of the
    setting in its message.
    """
    value = value.tolist() if hasattr(value, "tolist") else value  # a number or array of NumPy
    with suppress(SettingsError, OverflowError):
        if unit is not None and isinstance(value, str):
            return in_unit(value, unit)
        if type(value) is int:
            return float(value)
    return value


def as_tuple(value: Any, unit: str | None = None) -> Any:
    """Convert nested lists to nested tuples, and numbers in them to floats, see `as_float`."""
    plain = as_float(value, unit)
    listed = isinstance(plain, (list, tuple))
    return tuple(as_tuple(entry, unit) for entry in plain) if listed else plain


def one_of(options: tuple[str, ...]) -> Callable[[str, Any], None]:
    """Make a check that accepts one of several words."""
    return unless(
        lambda word: isinstance(word, str) and word in options, f"one of {', '.join(options)}"
    )


def whole_number(least: int = 0, most: int | None = None) -> Callable[[str, Any], None]:
    """Make a check that accepts whole numbers from `least` to `most`."""
    limit = "" if most is None else f" and at most {most}"
    return unless(
        lambda n: type(n) is int and least <= n and (most is None or n <= most),
        f"a whole number, at least {least}{limit}",
    )


def plane_vector(
    unit: str = "", *, below: float = inf, zero: bool = True
) -> Callable[[str, Any], None]:
    """Make a check that accepts a tuple of two numbers, along x and y.

    Parameters
    ----------
    unit
        Unit of the numbers.
    below
        Upper limit of the magnitude of each number; the limit itself is refused.
    zero
        Whether both numbers may be 0.
    """

    def holds(value: Any) -> bool:
        if not isinstance(value, tuple) or len(value) != 2:
            return False
        numbers = all(isinstance(n, float) and abs(n) < below for n in value)
        return numbers and (zero or any(value))

    measured = f" in {unit}" if unit else ""
    limit = f", below {below:g}" if below < inf else ""
    no_zero = "" if zero else ", one of them not 0"
    return unless(holds, f"two finite numbers [x, y]{measured}{limit}{no_zero}")
