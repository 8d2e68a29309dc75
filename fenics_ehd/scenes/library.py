"""Scenes and tables that come with the package; read without importing what a scene is."""

from __future__ import annotations

import difflib
from importlib import resources
from pathlib import Path

from fenics_ehd.base.errors import SettingsError


def shipped_names() -> tuple[str, ...]:
    """Names of the scenes that come with the package."""
    return tuple(_files("shipped"))


def shipped(name: str) -> str:
    """Text of a scene that comes with the package.

    Raises
    ------
    SettingsError
        There is none of that name.
    """
    return shipped_scene(name).read_text(encoding="utf-8")


def shipped_scene(name: str) -> Path:
    """File of a scene that comes with the package.

    Raises
    ------
    SettingsError
        There is none of that name.
    """
    known = _files("shipped")
    if name not in known:
        close = difflib.get_close_matches(name, known, n=1)
        meant = f"did you mean {close[0]}? " if close else ""
        raise SettingsError(f"scene {name!r}: {meant}not a .toml file, nor {', '.join(known)}")
    return known[name]


def table_file(name: str, key: str) -> Path:
    """File of a table that a key names: a table of the package, or a file of the user.

    Raises
    ------
    SettingsError
        There is no shipped one of that name.
    """
    known = _files("tables")
    if not Path(name).suffix and name not in known:
        listed = ", ".join(known)
        raise SettingsError(f"{key} = {name!r}: neither a .csv file nor a shipped table: {listed}")
    return known.get(name, Path(name))


def _files(folder: str) -> dict[str, Path]:
    """Files of a folder of this package by name, in order."""
    paths = Path(str(resources.files("fenics_ehd.scenes") / folder)).iterdir()
    return {path.stem: path for path in sorted(paths) if path.suffix in (".csv", ".toml")}
