"""Checks of arguments of public functions and classes, the same as those of scene keys.

Settings classes check their fields themselves (`fenics_ehd.base.fields`). The functions of this
module check arguments of functions, and of classes that are not settings classes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

from fenics_ehd.base.checks import (
    as_float,
    as_tuple,
    limits,
    one_of,
    plane_vector,
    require_finite,
    whole_number,
)
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.printed import key_hint, shown


def require_word(name: str, value: Any, words: tuple[str, ...]) -> None:
    """Refuse an argument that is not one of the accepted words.

    Raises
    ------
    SettingsError
        If the argument is none of these words; the message lists them.
    """
    one_of(words)(name, value)


def require_number(name: str, value: Any, *, unit: str | None = None, **bounds: Any) -> float:
    """Return an argument as a float, after a check that it is finite and within bounds.

    The bounds are `above`, `least`, `below` and `most`, see `checks.limits`. With a `unit`, a text
    with a number and a unit of the same quantity is accepted.

    Raises
    ------
    SettingsError
        If the argument is not a finite number, or is outside a bound; the message has the bound.
    """
    number: Any = as_float(value, unit)
    if unit and isinstance(number, str):
        require_finite(name, number, unit)
    if isinstance(number, str):
        raise SettingsError(f"{name} = {shown(value)} must be a finite number")
    limits(**bounds, sized=False)(name, number)
    return float(number)


def require_count(name: str, value: Any, least: int = 0, most: int | None = None) -> int:
    """Return an argument as an int, after a check that it is whole and from `least` to `most`.

    Raises
    ------
    SettingsError
        If the argument is not whole or is outside a limit; the message has the limits. Whole
        numbers of NumPy are accepted.
    """
    number: int = value.tolist() if hasattr(value, "tolist") else value
    whole_number(least, most)(name, number)
    return number


def require_list(name: str, value: Any, entries: str) -> list[Any]:
    """Return an argument as a list, after a check that it has entries.

    An array is converted to a list of Python's numbers. `entries` describes the entries, for the
    message.

    Raises
    ------
    SettingsError
        If the argument is a text, a dictionary or a single value.
    """
    plain: Any = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(plain, Iterable) or isinstance(plain, str | bytes | Mapping):
        raise SettingsError(f"{name} = {shown(plain)} must be a list of {entries}")
    return list(plain)


def require_pair(name: str, value: Any, *, zero: bool = True) -> tuple[float, float]:
    """Return a vector in the plane as two floats, x and y, after a check of both numbers.

    Raises
    ------
    SettingsError
        If the argument does not have two finite numbers, or if both are 0 and `zero` is false.
    """
    pair: Any = as_tuple(value)
    plane_vector(zero=zero)(name, pair)
    return pair[0], pair[1]


def require_class(name: str, value: Any, *classes: type, optional: bool = False) -> None:
    """Refuse an argument that is not an instance of an accepted class; None passes if `optional`.

    Raises
    ------
    SettingsError
        If the argument is of another class; the message has this class and the accepted ones.
    """
    if isinstance(value, classes) or (optional and value is None):
        return
    needed = " or ".join(cls.__name__ for cls in classes)
    raise SettingsError(
        f"{name} = {shown(value)} is of class {type(value).__name__}: {needed} is needed"
    )


def require_callable(name: str, value: Any, *, optional: bool = False) -> None:
    """Refuse an argument that cannot be called; None passes if `optional`.

    Raises
    ------
    SettingsError
        If the argument is not callable; the message has its class.
    """
    if not (callable(value) or (optional and value is None)):
        raise SettingsError(
            f"{name} = {shown(value)} is of class {type(value).__name__}: a function is needed"
        )


Value = TypeVar("Value")


def copied(
    name: str, values: Mapping[str, Value], check: Callable[[str, Any], None]
) -> dict[str, Value]:
    """Copy a dictionary after a check of every value.

    Parameters
    ----------
    name
        Name of the argument, for messages.
    values
        Dictionary to be copied.
    check
        Function that is called with the full name (``bodies['rod']``) and the value of each entry;
        it raises SettingsError for a wrong value.

    Raises
    ------
    SettingsError
        If the argument is not a dictionary, or if a value fails the check.
    """
    require_class(name, values, Mapping)
    for key, value in values.items():
        check(f"{name}[{key!r}]", value)
    return dict(values)


def require_names(function: str, names: Iterable[str], known: Iterable[str]) -> None:
    """Refuse names of keyword arguments that a function does not accept.

    Raises
    ------
    SettingsError
        If a name is unknown; the message suggests a similar argument.
    """
    known = list(known)
    for name in names:
        if name not in known:
            raise SettingsError(f"{function} has no argument {name}: {key_hint(known, name)}")
