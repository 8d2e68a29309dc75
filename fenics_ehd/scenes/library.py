"""Scenes and tables that come with the package; the module imports no settings of scenes."""

from __future__ import annotations

import difflib
from importlib import resources
from pathlib import Path

from fenics_ehd.base.errors import SettingsError


def shipped_names() -> tuple[str, ...]:
    """Names of all scenes that come with the package."""
    return tuple(_files("shipped"))


def shipped(name: str) -> str:
    """TOML text of a scene that comes with the package.

    Raises
    ------
    SettingsError
        No shipped scene has this name.
    """
    return shipped_scene(name).read_text(encoding="utf-8")


def shipped_scene(name: str) -> Path:
    """Path of a scene file that comes with the package.

    Raises
    ------
    SettingsError
        No shipped scene has this name; the message suggests a similar one.
    """
    known = _files("shipped")
    if name not in known:
        close = difflib.get_close_matches(name, known, n=1)
        meant = f"did you mean {close[0]}? " if close else ""
        raise SettingsError(f"scene {name!r}: {meant}give a .toml file or {', '.join(known)}")
    return known[name]


def table_file(name: str, key: str) -> Path:
    """Path of a table to which a setting refers: a shipped table, or a file of the user.

    Raises
    ------
    SettingsError
        The name has no suffix, and no shipped table has this name.
    """
    known = _files("tables")
    if not Path(name).suffix and name not in known:
        listed = ", ".join(known)
        raise SettingsError(f"{key} = {name!r}: give a .csv file or a shipped table: {listed}")
    return known.get(name, Path(name))


def _files(folder: str) -> dict[str, Path]:
    """Paths of the scenes or tables in a folder of this package, by name, sorted."""
    paths = Path(str(resources.files("fenics_ehd.scenes") / folder)).iterdir()
    return {path.stem: path for path in sorted(paths) if path.suffix in (".csv", ".toml")}
