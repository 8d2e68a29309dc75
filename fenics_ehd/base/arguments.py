"""Checks of arguments of public functions and classes, the same as those of scene keys.

Settings classes check their fields themselves (`fenics_ehd.base.fields`). The functions of this
module check arguments of functions, and of classes that are not settings classes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

from fenics_ehd.base.checks import as_float, as_tuple, limits, one_of, plane_vector, whole_number
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.printed import key_hint, shown


def require_word(name: str, value: Any, words: tuple[str, ...]) -> None:
    """Refuse a value that is not one of some words.

    Raises
    ------
    SettingsError
        If the value is another one; the message lists the accepted words.
    """
    one_of(words)(name, value)


def require_number(name: str, value: Any, **bounds: Any) -> float:
    """Return an argument as a float, after a check that it is finite and within bounds.

    The bounds are `above`, `least`, `below` and `most`, see `checks.limits`.

    Raises
    ------
    SettingsError
        If the argument is not a finite number, or is outside a bound; the message has the bound.
    """
    number: Any = as_float(value)
    if isinstance(number, str):
        raise SettingsError(f"{name} = {shown(value)} must be a finite number")
    limits(**bounds, sized=False)(name, number)
    return float(number)


def require_count(name: str, value: Any, least: int = 0) -> int:
    """Return an argument as an int, after a check that it is whole and at least `least`.

    Raises
    ------
    SettingsError
        If it is not; the message has the limit. Whole numbers of NumPy are accepted.
    """
    number: int = value.tolist() if hasattr(value, "tolist") else value
    whole_number(least)(name, number)
    return number


def require_pair(name: str, value: Any, *, zero: bool = True) -> tuple[float, float]:
    """Return a vector of the plane, x and y, after a check of its two numbers.

    Raises
    ------
    SettingsError
        If the argument does not have two finite numbers, or if both are 0 and `zero` is false.
    """
    pair: Any = as_tuple(value)
    plane_vector(zero=zero)(name, pair)
    return pair[0], pair[1]


def require_class(name: str, value: Any, *classes: type, optional: bool = False) -> None:
    """Refuse an argument that is not of one of some classes; None is accepted if it is optional.

    Raises
    ------
    SettingsError
        If the class is another one; the message has it and the accepted classes.
    """
    if isinstance(value, classes) or (optional and value is None):
        return
    needed = " or ".join(cls.__name__ for cls in classes)
    raise SettingsError(
        f"{name} = {shown(value)} is of class {type(value).__name__}: {needed} is needed"
    )


def require_callable(name: str, value: Any, *, optional: bool = False) -> None:
    """Refuse a value that cannot be called; None is accepted if it is optional.

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
        Function of the full name (``bodies['rod']``) and value of an entry that raises an error.

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
    """Refuse keyword arguments that a function does not have.

    Raises
    ------
    SettingsError
        If a name is unknown; the message suggests a similar argument.
    """
    known = list(known)
    for name in names:
        if name not in known:
            raise SettingsError(f"{function} has no argument {name}: {key_hint(known, name)}")
