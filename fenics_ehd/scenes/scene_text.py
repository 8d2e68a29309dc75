"""A scene as text again: every setting with its value and its meaning, files by their own paths."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from fenics_ehd.scenes import schema
from fenics_ehd.scenes.scene_file import GROUND, TABLES, Scene, read_scene, scene_of
from fenics_ehd.settings import to_toml

#: What files of a scene end with.
FILES = (".csv", ".h5", ".geo", ".msh")


def beside(tables: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Tables with every file that they name, relative to the scene's folder, by its own path."""
    found: dict[str, Any] = {}
    for key, value in tables.items():
        if isinstance(value, Mapping):
            found[key] = beside(value, folder)
        elif isinstance(value, str) and Path(value).suffix in FILES:
            found[key] = str((folder / value).absolute())
        else:
            found[key] = value
    return found


def as_stored(source: str | Path) -> Scene:
    """A scene with the values that its text keeps: a run that goes on has no others.

    Parameters
    ----------
    source
        As for `read_scene`; files are found beside a scene file.
    """
    scene = read_scene(source)
    path = Path(source)
    if path.suffix == ".toml":
        scene = scene_of(beside(scene.tables, path.parent), scene.name)
    return scene_of(tomllib.loads(scene_text(scene)), path.stem)


def files_of(tables: Mapping[str, Any]) -> Iterator[Path]:
    """Files that tables name and that are there."""
    for value in tables.values():
        if isinstance(value, Mapping):
            yield from files_of(value)
        elif isinstance(value, str) and Path(value).suffix in FILES and Path(value).is_file():
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
            path = f"{table}.{name}"
            blocks.append(f"[{path}]\n{kind}{to_toml(entry, f'{path}.')}")
    return "\n".join(blocks)
