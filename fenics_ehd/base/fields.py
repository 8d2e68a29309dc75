"""Kinds of fields of settings: numbers with units and limits, words, lists, each value checked."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any

import attrs

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.units import in_unit

#: Sizes of a number whose powers and products are still numbers.
SMALLEST, LARGEST = 1e-30, 1e30


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


def described(
    default: Any,
    help_text: str,
    holds: Callable[[Any], bool],
    wanted: str,
    converter: Callable[[Any], Any] | None = None,
) -> Any:
    """A field whose value must be as words say, which is so where `holds` is true."""

    def check(name: str, value: Any) -> None:
        if not holds(value):
            shown = list(value) if isinstance(value, tuple) else value
            raise SettingsError(f"{name} = {shown!r} must be {wanted}")

    return checked(default, help_text, check, converter)


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
        if value and not SMALLEST <= abs(value) <= LARGEST:
            raise SettingsError(
                f"{name} = {value!r} must be 0 or from {SMALLEST:g} to {LARGEST:g} in size"
            )

    return checked(default, help_text, check, partial(as_float, unit=unit), usual=(usual, hint))


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
    if not finite(value):
        raise SettingsError(f"{name} = {value!r} must be a finite number")


def as_float(value: Any, unit: str | None = None) -> Any:
    """A whole number, or a text with a `unit`, as a float; anything else as it is."""
    if unit is not None and isinstance(value, str):
        with suppress(SettingsError):  # told by the check, which knows the name
            return in_unit(value, unit)
    if type(value) is not int:
        return value
    try:
        return float(value)
    except OverflowError:
        return float("inf")


def finite(value: Any) -> bool:
    """Whether something is a float and finite."""
    return isinstance(value, float) and abs(value) < float("inf")


def as_tuple(value: Any, unit: str | None = None) -> Any:
    """Lists within lists as tuples, their whole numbers, and texts with a `unit`, as floats."""
    if isinstance(value, (list, tuple)):
        return tuple(as_tuple(entry, unit) for entry in value)
    return as_float(value, unit)


def count(default: int, help_text: str, least: int = 0, most: int | None = None) -> Any:
    """Whole number of at least `least` and at most `most`."""
    limits = f"at least {least}" + (f" and at most {most}" if most is not None else "")
    return described(
        default,
        help_text,
        lambda n: type(n) is int and least <= n and (most is None or n <= most),
        f"a whole number, {limits}",
    )


def rows(columns: tuple[str, ...], help_text: str, units: tuple[str, ...]) -> Any:
    """List of rows of numbers with the given columns and their units, empty by default."""
    wanted = f"a list of [{', '.join(columns)}]"

    def row_of(row: Any) -> Any:
        if not isinstance(row, (list, tuple)) or len(row) != len(units):
            return as_tuple(row)
        return tuple(map(as_float, row, units))

    def convert(value: Any) -> Any:
        return tuple(map(row_of, value)) if isinstance(value, (list, tuple)) else value

    def check(name: str, value: Any) -> None:
        if not isinstance(value, tuple):
            raise SettingsError(f"{name} = {value!r} must be {wanted}")
        for row in value:
            if not isinstance(row, tuple) or len(row) != len(columns):
                raise SettingsError(f"{name}: {row!r} must be one of {wanted}")
            for column, unit, entry in zip(columns, units, row, strict=True):
                require_finite(f"{name}: {column}", entry, unit)

    return checked((), help_text, check, convert)


def choice(default: str, options: tuple[str, ...], help_text: str) -> Any:
    """One of several words."""
    listed = ", ".join(options)
    text = f"{help_text}: {listed}"
    return described(default, text, lambda word: word in options, f"one of {listed}")


def text(default: str, help_text: str) -> Any:
    """Non-empty text that can name a file."""
    return described(
        default,
        help_text,
        lambda word: isinstance(word, str) and word != "" and "\0" not in word,
        "a non-empty text",
    )


def flag(default: bool, help_text: str) -> Any:
    """True or false."""
    return described(default, help_text, lambda word: isinstance(word, bool), "true or false")


def section(cls: type) -> Any:
    """Nested table."""
    return attrs.field(factory=cls, metadata={"section": cls})


def option(cls: type) -> Any:
    """Nested table that is not there unless it is listed: None."""
    return attrs.field(default=None, metadata={"section": cls, "optional": True})


def table(help_text: str, check: Callable[[str, Any], None], converter: Any = None) -> Any:
    """Free table of names and what a function may refuse, which `converter` makes of each."""

    def check_all(name: str, value: Any) -> None:
        for key, entry in value.items():
            check(f"{name}.{key}", entry)

    def convert(value: Any) -> Any:
        if not isinstance(value, Mapping):
            return value
        return {key: converter(entry) for key, entry in value.items()}

    factory: Any = attrs.Factory(dict)
    return checked(factory, help_text, check_all, convert if converter else None, table=True)


def numbers(help_text: str) -> Any:
    """Free table of names and numbers, those with a unit in that of the help text."""
    unit = unit_of(help_text)

    def check(name: str, value: Any) -> None:
        require_finite(name, as_float(value), unit)

    # Whole ones stay so: cells of a mesh.
    return table(help_text, check, lambda v: as_float(v, unit) if isinstance(v, str) else v)


def entries(help_text: str, kinds: Mapping[str, type], make: Callable[..., Any]) -> Any:
    """Free table of tables by name, each of a settings class by its ``kind``.

    `make` builds settings from class, table and path, as `fenics_ehd.base.settings.build`.
    """

    def entry(value: Any, path: str = "") -> Any:
        if not isinstance(value, Mapping):
            raise SettingsError(f"{path.rstrip('.')} = {value!r} must be a table")
        kind = value.get("kind")
        if not isinstance(kind, str) or kind not in kinds:
            told = "is missing" if kind is None else f"= {kind!r}"
            raise SettingsError(f"{path}kind {told}: one of {', '.join(kinds)}")
        return make(kinds[kind], {k: v for k, v in value.items() if k != "kind"}, path)

    def attempt(value: Any) -> Any:
        try:
            return entry(value)
        except SettingsError:  # told by the check, which knows the path
            return value

    def check(name: str, value: Any) -> None:
        word = name.rpartition(".")[2]
        if not word.replace("_", "").replace("-", "").isalnum():
            raise SettingsError(f"[{name}]: a name must be of letters, digits, _ and -")
        if isinstance(value, tuple(kinds.values())):
            return
        try:
            entry(value, f"{name}.")
        except SettingsError as error:  # the path above comes before the message
            told, unknown, rest = str(error).partition("unknown key ")
            key, _, meant = rest.partition(": ")
            raise SettingsError(f"{key}: unknown key, {meant}" if unknown else told) from None

    field = table(help_text, check, attempt)
    field.metadata["kinds"] = kinds
    return field
