"""Which machine a scene file is of."""

from __future__ import annotations

import difflib
from pathlib import Path

from fenics_ehd.errors import SettingsError
from fenics_ehd.settings import read_toml

#: Key of a scene file that says which machine it is.
SCENE_KEY = "scene"

#: Machines there are.
SLIDER_CRANK, ROTOR, LOADED_JOURNAL = KINDS = ("slider-crank", "rotor", "loaded-journal")


def scene_tables(scene: str) -> tuple[str, dict]:
    """Kind of a scene given by name or TOML file, and the tables as written.

    Raises
    ------
    SettingsError
        There is no such scene, or the file does not say which one it is.
    """
    if scene in KINDS:
        return scene, {}
    tables = read_tables(scene)
    if SCENE_KEY not in tables:
        raise SettingsError(f"{scene}: scene is missing: {_either(KINDS)}")
    kind = tables[SCENE_KEY]
    if kind not in KINDS:
        raise SettingsError(f"{scene}: scene = {kind!r} must be {_either(KINDS)}{_meant(kind)}")
    return kind, tables


def is_mechanism(scene: str) -> bool:
    """Whether a name or a file is that of a scene of bodies and joints."""
    from fenics_ehd.scenes.scene_file import has_bodies, shipped_names

    if scene in KINDS:
        return False
    path = Path(scene)
    if path.suffix == ".toml":
        return path.exists() and has_bodies(read_toml(scene))
    return scene in shipped_names()


def read_tables(scene: str) -> dict:
    """Tables of a scene file, whatever machine it is of.

    Raises
    ------
    SettingsError
        It is no TOML file, or cannot be read.
    """
    if Path(scene).suffix != ".toml":
        from fenics_ehd.scenes.scene_file import shipped_names

        names = tuple(dict.fromkeys((*KINDS, *shipped_names())))
        known = _either((*names, "a .toml file"))
        raise SettingsError(f"scene {scene!r}: not {known}{_meant(scene, names)}")
    return read_toml(scene)


def _either(names: tuple[str, ...]) -> str:
    return f"{', '.join(names[:-1])} or {names[-1]}"


def _meant(name: object, known: tuple[str, ...] = KINDS) -> str:
    close = difflib.get_close_matches(str(name), known, n=1)
    return f": did you mean {close[0]}?" if close else ""


def tables_of(scene: str, kind: str) -> dict | None:
    """Tables of a scene of this kind given by name or file, None for another kind of scene.

    Raises
    ------
    SettingsError
        From `scene_tables`.
    """
    found, tables = scene_tables(scene)
    return tables if found == kind else None
