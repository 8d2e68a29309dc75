"""Fields of a scene's settings beside those of `fenics_ehd.settings`; points, names, tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import attrs

from fenics_ehd.errors import SettingsError
from fenics_ehd.lengths import LARGEST_LENGTH

#: Stands for what is not given: a file, a name.
NONE = "none"

#: A key that must be written.
REQUIRED: Any = attrs.NOTHING


def _as_floats(value: Any) -> Any:
    """A list of numbers as floats."""
    if not isinstance(value, (list, tuple)):
        return value
    return tuple(float(n) if type(n) is int and abs(n) < 2**53 else n for n in value)


def _check_pair(name: str, value: Any, below: float) -> None:
    numbers = isinstance(value, tuple) and len(value) == 2
    if not numbers or not all(isinstance(n, float) and abs(n) < below for n in value):
        shown = list(value) if isinstance(value, tuple) else value
        raise SettingsError(f"{name} = {shown!r} must be two numbers [x, y], below {below:g}")


def pair(help_text: str, default: Any = (0.0, 0.0), *, below: float = 1e15) -> Any:
    """Two numbers along x and y, each of a size below a limit."""

    def check(_instance: Any, attribute: attrs.Attribute, value: Any) -> None:
        _check_pair(attribute.name, value, below)

    return attrs.field(
        default=default, validator=check, converter=_as_floats, metadata={"help": help_text}
    )


def place(help_text: str, default: Any = (0.0, 0.0)) -> Any:
    """A place in the plane [m]."""
    return pair(help_text, default, below=100 * LARGEST_LENGTH)


def places(help_text: str) -> Any:
    """Places in the plane by name [m]."""

    def as_pairs(value: Any) -> Any:
        if not isinstance(value, Mapping):
            return value
        return {name: _as_floats(entry) for name, entry in value.items()}

    def check(_instance: Any, attribute: attrs.Attribute, value: Any) -> None:
        for name, entry in value.items():
            _check_pair(f"{attribute.name}.{name}", entry, 100 * LARGEST_LENGTH)

    return attrs.field(
        factory=dict,
        validator=check,
        converter=as_pairs,
        metadata={"help": help_text, "table": True},
    )


def names(help_text: str, default: Any = (), *, count: int | None = None) -> Any:
    """A list of names, of a given `count` or of any."""
    wanted = "a list of names" if count is None else f"a list of {count} names"

    def check(_instance: Any, attribute: attrs.Attribute, value: Any) -> None:
        listed = isinstance(value, tuple) and all(isinstance(n, str) and n for n in value)
        if not listed or (count is not None and len(value) != count):
            shown = list(value) if isinstance(value, tuple) else value
            raise SettingsError(f"{attribute.name} = {shown!r} must be {wanted}")

    return attrs.field(
        default=default,
        validator=check,
        converter=lambda value: tuple(value) if isinstance(value, list) else value,
        metadata={"help": help_text},
    )
