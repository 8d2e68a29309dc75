"""Settings with units and limits, read from TOML and checked value by value."""

from __future__ import annotations

import json
import operator
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import attrs

from fenics_ehd.errors import SettingsError
from fenics_ehd.key_hints import key_hint, setting_names
from fenics_ehd.text_file import read_text

T = TypeVar("T", bound=attrs.AttrsInstance)

#: Sizes of a number whose powers and products are still numbers.
SMALLEST, LARGEST = 1e-30, 1e30

#: Characters of a key or number in a scene file. Time and memory to parse a key grow with the
#: square of its dots, and Python does not print numbers of thousands of digits.
LONGEST = 300


def number(
    default: float,
    help_text: str,
    *,
    above: float | None = None,
    least: float | None = None,
    below: float | None = None,
    usual: tuple[float, float] | None = None,
    example: str = "",
) -> Any:
    """Real number with limits: `above` and `below` exclusive, `least` inclusive.

    A value beyond a limit, perhaps in another unit, is told the unit and the `example`; one whose
    size is not between the `usual` ones is told so by `unusual`.
    """
    unit = re.search(r"\[([^];-]+)\]", help_text)
    measured = f" in {unit[1]}" if unit else ""
    hint = f":{measured}, {example}" if example else ""

    def check(_instance: Any, attribute: attrs.Attribute, value: Any) -> None:
        if not isinstance(value, float) or not abs(value) < float("inf"):
            bare = f"{measured}, without unit or quotes" if isinstance(value, str) else ""
            raise SettingsError(f"{attribute.name} = {value!r} must be a finite number{bare}")
        for limit, words, holds in (
            (above, "above", operator.gt),
            (least, "at least", operator.ge),
            (below, "below", operator.lt),
        ):
            if limit is not None and not holds(value, limit):
                raise SettingsError(
                    f"{attribute.name} = {value!r} must be {words} {limit:g}"
                    + (hint if words != "above" else "")
                )
        if value and not SMALLEST <= abs(value) <= LARGEST:
            raise SettingsError(
                f"{attribute.name} = {value!r} must be 0 or from {SMALLEST:g} to {LARGEST:g} "
                "in size"
            )

    return attrs.field(
        default=default,
        validator=check,
        converter=_as_float,
        metadata={"help": help_text, "usual": (usual, hint)},
    )


def count(default: int, help_text: str, least: int = 0, most: int | None = None) -> Any:
    """Whole number of at least `least` and at most `most`."""
    limits = f"at least {least}" + (f" and at most {most}" if most is not None else "")

    def check(_instance: Any, attribute: attrs.Attribute, value: Any) -> None:
        whole = isinstance(value, int) and not isinstance(value, bool)
        if not whole or value < least or (most is not None and value > most):
            raise SettingsError(f"{attribute.name} = {value!r} must be a whole number, {limits}")

    return attrs.field(default=default, validator=check, metadata={"help": help_text})


def counts(
    default: tuple[int, ...],
    help_text: str,
    *,
    least: tuple[int, int],
    most: int,
    optional: bool = False,
) -> Any:
    """Two whole numbers, as cells in two directions; an empty list where `optional`.

    Each has its `least`, and `most` is the limit of their product.
    """

    def check(_instance: Any, attribute: attrs.Attribute, value: Any) -> None:
        given = f"{attribute.name} = {list(value)!r}"
        if optional and not value:
            return
        whole = all(isinstance(n, int) and not isinstance(n, bool) and n > 0 for n in value)
        if not whole or len(value) != 2:
            raise SettingsError(
                f"{given} must be two whole numbers above 0" + (", or empty" if optional else "")
            )
        if any(n < fewest for n, fewest in zip(value, least, strict=True)):
            raise SettingsError(f"{given} must be at least {list(least)}: fewer are too coarse")
        if value[0] * value[1] > most:
            raise SettingsError(f"{given}: {value[0] * value[1]} cells, at most {most} are allowed")

    def as_tuple(value: Any) -> Any:
        return tuple(value) if isinstance(value, (list, tuple)) else (value,)

    return attrs.field(
        default=default, validator=check, converter=as_tuple, metadata={"help": help_text}
    )


def rows(columns: tuple[str, ...], help_text: str) -> Any:
    """List of rows of numbers with the given columns, empty by default."""

    def check(_instance: Any, attribute: attrs.Attribute, value: Any) -> None:
        wanted = f"a list of [{', '.join(columns)}]"
        if not isinstance(value, tuple):
            raise SettingsError(f"{attribute.name} = {value!r} must be {wanted}")
        for row in value:
            if not isinstance(row, tuple) or len(row) != len(columns):
                raise SettingsError(f"{attribute.name}: {row!r} must be one of {wanted}")
            for name, entry in zip(columns, row, strict=True):
                if not isinstance(entry, float) or not abs(entry) < float("inf"):
                    raise SettingsError(
                        f"{attribute.name}: {name} = {entry!r} must be a finite number"
                    )

    def as_tuples(value: Any) -> Any:
        if not isinstance(value, (list, tuple)):
            return value
        return tuple(
            tuple(map(_as_float, row)) if isinstance(row, (list, tuple)) else row for row in value
        )

    return attrs.field(
        default=(), validator=check, converter=as_tuples, metadata={"help": help_text}
    )


def choice(default: str, options: tuple[str, ...], help_text: str) -> Any:
    """One of several words."""

    def check(_instance: Any, attribute: attrs.Attribute, value: Any) -> None:
        if value not in options:
            raise SettingsError(f"{attribute.name} = {value!r} must be one of {', '.join(options)}")

    help_text = f"{help_text}: {', '.join(options)}"
    return attrs.field(default=default, validator=check, metadata={"help": help_text})


def text(default: str, help_text: str) -> Any:
    """Non-empty text that can name a file."""

    def check(_instance: Any, attribute: attrs.Attribute, value: Any) -> None:
        if not isinstance(value, str) or not value or "\0" in value:
            raise SettingsError(f"{attribute.name} = {value!r} must be a non-empty text")

    return attrs.field(default=default, validator=check, metadata={"help": help_text})


def flag(default: bool, help_text: str) -> Any:
    """True or false."""

    def check(_instance: Any, attribute: attrs.Attribute, value: Any) -> None:
        if not isinstance(value, bool):
            raise SettingsError(f"{attribute.name} = {value!r} must be true or false")

    return attrs.field(default=default, validator=check, metadata={"help": help_text})


def section(cls: type) -> Any:
    """Nested table."""
    return attrs.field(factory=cls, metadata={"section": cls})


def numbers(help_text: str) -> Any:
    """Free table of names and numbers."""

    def check(_instance: Any, attribute: attrs.Attribute, value: Any) -> None:
        for key, entry in value.items():
            if not isinstance(_as_float(entry), float) or not abs(_as_float(entry)) < float("inf"):
                raise SettingsError(f"{attribute.name}.{key} = {entry!r} must be a finite number")

    return attrs.field(factory=dict, validator=check, metadata={"help": help_text, "table": True})


def _as_float(value: Any) -> Any:
    if not isinstance(value, int) or isinstance(value, bool):
        return value
    try:
        return float(value)
    except OverflowError:
        return float("inf")


def build(
    cls: type[T], table: Mapping[str, Any], path: str = "", names: Iterable[str] | None = None
) -> T:
    """Settings object from nested tables.

    Parameters
    ----------
    cls
        Settings class.
    table
        Values by key, those of a section in a table of their own.
    path
        Sections above, ``"rod."`` for instance.
    names
        Every key there is, to find the one that is meant; None: those of `cls`.

    Raises
    ------
    SettingsError
        An unknown key, or a value outside its limits; the message starts with the key.
    """
    if not isinstance(table, Mapping):
        raise SettingsError(f"{path.rstrip('.')} = {table!r} must be a table")
    known = {a.name: a for a in attrs.fields(cls)}
    names = list(setting_names(cls, path) if names is None else names)
    values = {}
    for key, value in table.items():
        if key not in known:
            raise SettingsError(f"unknown key {path}{key}: {key_hint(names, f'{path}{key}')}")
        nested = known[key].metadata.get("section")
        values[key] = build(nested, value, f"{path}{key}.", names) if nested else value
        if known[key].metadata.get("table") and not isinstance(value, Mapping):
            raise SettingsError(f"{path}{key} = {value!r} must be a table")
    try:
        return cls(**values)
    except SettingsError as error:
        raise SettingsError(f"{path}{error}") from None


def unusual(settings: Any, path: str = "") -> list[str]:
    """One line for every number whose size is not a usual one: its unit may be another."""
    found = []
    for attribute in attrs.fields(type(settings)):
        value, name = getattr(settings, attribute.name), f"{path}{attribute.name}"
        usual, hint = attribute.metadata.get("usual", (None, ""))
        if attribute.metadata.get("section"):
            found += unusual(value, f"{name}.")
        elif usual and value and not usual[0] <= abs(value) <= usual[1]:
            found.append(
                f"{name} = {value:g} is outside the usual {usual[0]:g} to {usual[1]:g}{hint}"
            )
    return found


def read_toml(path: str | Path) -> dict[str, Any]:
    """Tables of a TOML file.

    Raises
    ------
    SettingsError
        The file cannot be read or is not TOML.
    """
    try:
        content = read_text(path)
        if max(map(len, _bare_words(content))) > LONGEST:
            raise ValueError(f"a key or a number has more than {LONGEST} characters")
        return tomllib.loads(content)
    except OSError as error:
        raise SettingsError(f"scene file {path}: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise SettingsError(f"scene file {path}: {error}") from None


def _bare_words(content: str) -> list[str]:
    """Keys, dots included, and values of a TOML text without what is quoted in them."""
    bare = re.sub(r"\"[^\"\n]*\"|'[^'\n]*'|#.*|[ \t]", "", content)
    return re.split(r"[][{}=,\n]", bare)


def _literal(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_literal, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, int):
        return str(value)
    plain = format(value, ".12g")
    mantissa, exponent = format(value, ".11e").split("e")
    short = f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"
    if not set(plain) & set(".en"):
        plain += ".0"
    return plain if len(plain) <= 8 else min(plain, short, key=len)


def to_toml(settings: Any, path: str = "") -> str:
    """TOML text of a settings object, every key with its meaning; `build` reads it back."""
    own, nested = [], []
    for attribute in attrs.fields(type(settings)):
        value = getattr(settings, attribute.name)
        name = f"{path}{attribute.name}"
        help_text = attribute.metadata.get("help", "")
        if attribute.metadata.get("section"):
            nested.append(f"\n[{name}]\n{to_toml(value, name + '.')}")
        elif attribute.metadata.get("table"):
            lines = [f"{key} = {_literal(entry)}\n" for key, entry in value.items()]
            nested.append(f"\n# {help_text}\n[{name}]\n{''.join(lines)}")
        else:
            own.append(f"{attribute.name} = {_literal(value)}  # {help_text}\n")
    return "".join(own) + "".join(nested)
