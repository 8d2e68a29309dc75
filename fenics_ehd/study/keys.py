"""Keys of a scene by their dotted names, and the scene with some of them replaced."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import attrs

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.key_hints import key_hint
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.given import changed
from fenics_ehd.scenes.scene import Scene
from fenics_ehd.scenes.scene_file import TABLES
from fenics_ehd.scenes.scene_text import stored


def scene_values(scene: Scene) -> tuple[dict[str, Any], list[str]]:
    """Values by dotted key, ``joints.big_end.clearance``, and keys of tables with free names."""
    values: dict[str, Any] = {}
    free: list[str] = []
    for table in TABLES:
        settings = getattr(scene, table)
        if table not in schema.KINDS:
            _collect(settings, table, values, free)
            continue
        for name, entry in settings.items():
            _collect(entry, f"{table}.{name}", values, free)
    return values, free


def _collect(settings: Any, path: str, values: dict[str, Any], free: list[str]) -> None:
    for attribute in attrs.fields(type(settings)):
        key, value = f"{path}.{attribute.name}", getattr(settings, attribute.name)
        if "section" in attribute.metadata and value is None:
            continue
        if "section" in attribute.metadata:
            _collect(value, key, values, free)
        elif "table" in attribute.metadata:
            free.append(key)
            for name, entry in value.items():
                if "kinds" in attribute.metadata:
                    _collect(entry, f"{key}.{name}", values, free)
                else:
                    values[f"{key}.{name}"] = entry
        else:
            values[key] = value


def resolve_key(scene: Scene, name: str) -> str:
    """Full key of one that may be given by its end, where that is the end of one key only.

    Raises
    ------
    SettingsError
        No key or more than one ends so, or it is a table with free names and the name in it is
        missing.
    """
    values, free = scene_values(scene)
    found = _ending(values, name)
    if not found and _ending(free, name):
        table = _ending(free, name)[0]
        raise SettingsError(f"key {name} is a table: write {table}.NAME for a name in it")
    table, _, entry = name.rpartition(".")
    if not found and entry:
        found = [f"{key}.{entry}" for key in _ending(free, table)]
    if not found:
        raise SettingsError(f"unknown key {name}: {key_hint(values, name)}")
    if len(found) > 1:
        raise SettingsError(f"key {name} is ambiguous: {' or '.join(found)}")
    return found[0]


def _ending(keys: Any, name: str) -> list[str]:
    """The key of that name, or all that end with it."""
    return [name] if name in keys else [key for key in keys if key.endswith(f".{name}")]


def with_values(scene: Scene, values: Mapping[str, Any]) -> Scene:
    """A scene with full keys replaced, checked and as its file would keep it.

    Parameters
    ----------
    scene
        As stored.
    values
        By key; files are relative to the working directory.

    Raises
    ------
    SettingsError
        Naming the key that cannot be used.
    """
    return stored(changed(scene, values))
