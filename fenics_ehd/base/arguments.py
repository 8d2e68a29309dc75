"""Arguments of public functions and classes, checked as keys of scenes are.

Settings classes check their fields (`fenics_ehd.base.fields`). These functions refuse in the same
words what a function, or a class that is none of settings, is called with. Fields are imported
where they are used: reductions do without attrs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

from fenics_ehd.base.errors import SettingsError

#: Characters of a value in a message.
SHOWN = 60


def require_word(name: str, value: Any, words: tuple[str, ...]) -> None:
    """Refuse what is none of some words.

    Raises
    ------
    SettingsError
        Naming all of them.
    """
    from fenics_ehd.base.fields import one_of

    one_of(words)(name, value)


def require_number(name: str, value: Any, **bounds: Any) -> float:
    """A finite number within bounds: `above`, `least`, `below`, `most`, see `fields.limits`.

    Raises
    ------
    SettingsError
        Naming the bound.
    """
    from fenics_ehd.base.fields import as_float, limits

    number: Any = as_float(value)
    if isinstance(number, str):
        raise SettingsError(f"{name} = {shown(value)} must be a finite number")
    limits(**bounds, sized=False)(name, number)
    return float(number)


def require_count(name: str, value: Any, least: int = 0) -> int:
    """A whole number of at least `least`, also one of NumPy.

    Raises
    ------
    SettingsError
        Naming the limit.
    """
    number = value.tolist() if hasattr(value, "tolist") else value
    if type(number) is not int or number < least:
        raise SettingsError(f"{name} = {shown(value)} must be a whole number, at least {least}")
    return number


def require_pair(name: str, value: Any, *, zero: bool = True) -> tuple[float, float]:
    """Two finite numbers along x and y, unless `zero` not both 0.

    Raises
    ------
    SettingsError
        Naming the argument.
    """
    from fenics_ehd.base.fields import as_tuple

    pair = as_tuple(value)
    finite = isinstance(pair, tuple) and all(
        isinstance(number, float) and abs(number) < float("inf") for number in pair
    )
    if not finite or len(pair) != 2:
        raise SettingsError(f"{name} = {shown(value)} must be two finite numbers, [x, y]")
    if not (zero or any(pair)):
        raise SettingsError(f"{name} = {shown(value)} must be two numbers, one of them not 0")
    return pair[0], pair[1]


def require_class(name: str, value: Any, *classes: type, optional: bool = False) -> None:
    """Refuse an argument of another class; None is accepted if it is optional.

    Raises
    ------
    SettingsError
        Naming the argument, its class and the one that is needed.
    """
    if isinstance(value, classes) or (optional and value is None):
        return
    needed = " or ".join(cls.__name__ for cls in classes)
    raise SettingsError(
        f"{name} = {shown(value)} is of class {type(value).__name__}: {needed} is needed"
    )


def require_callable(name: str, value: Any, *, optional: bool = False) -> None:
    """Refuse what is no function of one number; None is accepted if it is optional.

    Raises
    ------
    SettingsError
        Naming the argument and its class.
    """
    if not (callable(value) or (optional and value is None)):
        raise SettingsError(
            f"{name} = {shown(value)} is of class {type(value).__name__}: a function is needed"
        )


Value = TypeVar("Value")


def copied(
    name: str, values: Mapping[str, Value], check: Callable[[str, Any], None]
) -> dict[str, Value]:
    """A dictionary of the caller, copied, its values checked under their full names.

    Raises
    ------
    SettingsError
        It is no dictionary, or from the check.
    """
    require_class(name, values, Mapping)
    for key, value in values.items():
        check(f"{name}[{key!r}]", value)
    return dict(values)


def require_names(function: str, given: Iterable[str], known: Iterable[str]) -> None:
    """Refuse a keyword that a function does not have.

    Raises
    ------
    SettingsError
        Naming the one that is perhaps meant.
    """
    from fenics_ehd.base.settings import key_hint

    known = list(known)
    for name in given:
        if name not in known:
            raise SettingsError(f"{function} has no argument {name}: {key_hint(known, name)}")


def shown(value: Any) -> str:
    """A value in one short line."""
    text = " ".join(repr(value).split())
    return text if len(text) <= SHOWN else f"{text[: SHOWN - 3]}..."
