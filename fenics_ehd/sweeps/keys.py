"""Keys of a scene by name, and settings with some of them replaced."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import attrs

from fenics_ehd.errors import SettingsError
from fenics_ehd.key_hints import key_hint, setting_names
from fenics_ehd.settings import build


def known_keys(cls: type) -> dict[str, attrs.Attribute]:
    """Every ``section.key`` of a scene's settings, with its attribute."""
    return {name: found for name, found in setting_names(cls).items() if "." in name}


def resolve_key(cls: type, name: str) -> str:
    """``section.key`` of a key that may be given without its section.

    Raises
    ------
    SettingsError
        No section or more than one has the key, or it is a free table and the name in it
        is missing.
    """
    known = known_keys(cls)
    tables = [key for key, attribute in known.items() if "table" in attribute.metadata]
    if any(name.startswith(f"{table}.") and name != f"{table}." for table in tables):
        return name
    found = [name] if name in known else [k for k in known if k.split(".")[1] == name]
    if not found:
        raise SettingsError(f"unknown key {name}: {key_hint(known, name)}")
    if len(found) > 1:
        raise SettingsError(f"key {name} is ambiguous: {' or '.join(found)}")
    if found[0] in tables:
        raise SettingsError(f"key {name} is a table: write {found[0]}.NAME for a name in it")
    return found[0]


def value_like(cls: type, key: str) -> object:
    """A value of the kind that a resolved key takes."""
    attribute = known_keys(cls).get(key)
    return 0.0 if attribute is None else attribute.default  # a free table holds numbers


def with_values(settings: Any, values: Mapping[str, Any]) -> Any:
    """Settings with resolved keys replaced, checked as those of a scene file.

    Raises
    ------
    SettingsError
        A value outside its limits; the message starts with the key.
    """
    tables = attrs.asdict(settings)
    for key, value in values.items():
        *path, last = key.split(".", 2)
        table = tables
        for name in path:
            table = table[name]
        table[last] = value
    return build(type(settings), tables)
