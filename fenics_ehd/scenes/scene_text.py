"""A scene as text again: every setting with its value and its meaning, files by their own paths."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from fenics_ehd.base.settings import to_toml, toml_key
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.fields import NONE
from fenics_ehd.scenes.scene_checks import MODEL_KEYS
from fenics_ehd.scenes.scene_file import GROUND, TABLES, Scene, read_scene, scene_of


def as_stored(source: str | Path) -> Scene:
    """A scene with the values that its text keeps: a run that goes on has no others.

    Parameters
    ----------
    source
        As for `read_scene`.
    """
    return replace(stored(read_scene(source)), name=Path(source).stem)


def stored(scene: Scene) -> Scene:
    """A scene with the values that its text keeps."""
    return scene_of(tomllib.loads(scene_text(scene)), scene.name)


def csv_files(tables: Mapping[str, Any]) -> Iterator[Path]:
    """Tables that a scene names and that are there."""
    for value in tables.values():
        if isinstance(value, Mapping):
            yield from csv_files(value)
        elif isinstance(value, str) and value.endswith(".csv") and Path(value).is_file():
            yield Path(value)


def scene_text(scene: Scene) -> str:
    """TOML text, which `read_scene` reads back as the same scene."""
    blocks = []
    for table in TABLES:
        settings = getattr(scene, table)
        if table not in schema.KINDS:
            blocks.append(f"[{table}]\n{to_toml(settings, f'{table}.')}")
            continue
        kinds = {cls: kind for kind, cls in schema.KINDS[table].items()}
        for name, entry in settings.items():
            kind = "" if name == GROUND else f'kind = "{kinds[type(entry)]}"\n'
            path = f"{table}.{toml_key(name)}"
            without = MODEL_KEYS if getattr(entry, "body", NONE) != NONE else ()
            blocks.append(f"[{path}]\n{kind}{to_toml(entry, f'{path}.', without=without)}")
    return "\n".join(blocks)
