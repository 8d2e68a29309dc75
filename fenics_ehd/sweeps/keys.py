"""Keys of a scene by name, and settings with some of them replaced."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Any

import attrs

from fenics_ehd.errors import SettingsError
from fenics_ehd.settings import build


def known_keys(cls: type) -> dict[str, attrs.Attribute]:
    """Every ``section.key`` of a scene's settings, with its attribute."""
    return {
        f"{section.name}.{attribute.name}": attribute
        for section in attrs.fields(cls)
        if "section" in section.metadata
        for attribute in attrs.fields(section.metadata["section"])
    }


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
        raise SettingsError(f"unknown key {name}: {_hint(known, name)}")
    if len(found) > 1:
        raise SettingsError(f"key {name} is ambiguous: {' or '.join(found)}")
    if found[0] in tables:
        raise SettingsError(f"key {name} is a table: write {found[0]}.NAME for a name in it")
    return found[0]


def _hint(known: Mapping[str, attrs.Attribute], name: str) -> str:
    """Keys that are meant perhaps: those of the section, if there is such a section."""
    section, _, bare = name.rpartition(".")
    if any(key.startswith(f"{section}.") for key in known):
        close = difflib.get_close_matches(name, known, n=1)
    else:
        words = difflib.get_close_matches(bare, [key.split(".")[1] for key in known], n=1)
        close = [key for key in known if key.split(".")[1] in words]
    return f"did you mean {' or '.join(close)}?" if close else f"known: {', '.join(known)}"


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
