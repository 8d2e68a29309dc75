"""A scene file: bodies, joints, drives and forces of one mechanism, read and checked.

What needs no mesh is checked here: keys, kinds, values, and that every name is the name of
something. `fenics_ehd.scenes.build` makes a mechanism of it.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.key_hints import key_hint, setting_names
from fenics_ehd.base.settings import build, read_toml, unusual
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.scene import GROUND, Scene
from fenics_ehd.scenes.scene_checks import check_names, check_time, notices

#: Tables of a scene file.
TABLES = (*schema.KINDS, "time", "output")

#: Some of a scene file of version 0.1.
OLD = {"mechanism", "bearing", "rod", "housing", "shaft", "journal", "film", "reduction"}

#: What files of a scene end with.
FILES = (".csv", ".h5", ".geo", ".msh")

#: Kind of an entry that does not say its own.
USUAL_KINDS = {"lubricants": "oil"}

#: Kinds by the names that they had.
FORMER_KINDS = {("lubricants", "constant"): "oil"}


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


def shipped_names() -> tuple[str, ...]:
    """Names of the scenes that come with the package."""
    return tuple(sorted(path.name.removesuffix(".toml") for path in _shipped().iterdir()
                        if path.name.endswith(".toml")))  # fmt: skip


def shipped(name: str) -> str:
    """Text of a scene that comes with the package.

    Raises
    ------
    SettingsError
        There is none of that name.
    """
    return _known(name).read_text(encoding="utf-8")


def _shipped() -> Any:
    return resources.files("fenics_ehd.scenes") / "shipped"


def _known(name: str) -> Any:
    known = shipped_names()
    if name not in known:
        close = difflib.get_close_matches(name, known, n=1)
        meant = f"did you mean {close[0]}? " if close else ""
        raise SettingsError(f"scene {name!r}: {meant}not a .toml file, nor {', '.join(known)}")
    return _shipped() / f"{name}.toml"


def read_scene(source: str | Path) -> Scene:
    """Scene of a TOML file or of the package.

    Parameters
    ----------
    source
        Path that ends in ``.toml``, or name of a shipped scene. Files that it names are found
        beside it.

    Raises
    ------
    SettingsError
        The file cannot be read, or naming the key that cannot be used.
    """
    path = Path(source)
    if path.suffix != ".toml":
        return scene_of(read_toml(_known(str(source))), str(source))
    return scene_of(beside(read_toml(path), path.parent), str(source))


def scene_of(tables: Mapping[str, Any], name: str) -> Scene:
    """Scene of tables as a TOML file has them.

    Raises
    ------
    SettingsError
        Naming the key that cannot be used.
    """
    if "bodies" not in tables:
        old = "scene" in tables or OLD & set(tables)
        raise SettingsError(
            f"{name}: {'a scene file of version 0.1' if old else 'no [bodies.NAME] tables'}; write "
            "bodies, joints, drives and forces: 'fenics-ehd init slider-crank-paper' prints them "
            "with every setting explained"
        )
    for key in tables:
        if key not in TABLES:
            raise SettingsError(f"unknown table [{key}]: {key_hint(TABLES, key)}")
    entries = {table: _entries(table, tables.get(table, {})) for table in schema.KINDS}
    time = _settings(schema.TimeSettings, tables.get("time", {}), "time")
    output = _settings(schema.OutputSettings, tables.get("output", {}), "output")
    warnings = unusual(time, "time.")
    for table, found in entries.items():
        for entry, settings in found.items():
            warnings += unusual(settings, f"{table}.{entry}.")
    scene = Scene(name, tables, **entries, time=time, output=output, warnings=())
    check_names(scene)
    check_time(scene)
    return replace(scene, warnings=(*warnings, *notices(scene)))


def _entries(table: str, given: Any) -> dict[str, Any]:
    """Settings of every entry of a table, by name."""
    if not isinstance(given, Mapping):
        raise SettingsError(f"{table} = {given!r} must be tables: [{table}.NAME]")
    return {name: _entry(table, name, values) for name, values in given.items()}


def _entry(table: str, name: str, values: Any) -> Any:
    path, kinds = f"{table}.{name}", schema.KINDS[table]
    if not name or not name.replace("_", "").replace("-", "").isalnum():
        raise SettingsError(f"[{path}]: a name must be of letters, digits, _ and -")
    if not isinstance(values, Mapping):
        raise SettingsError(f"{path} = {values!r} must be a table: [{path}]")
    if table == "bodies" and name == GROUND:
        return _settings(schema.GroundSettings, values, path)
    kind = values.get("kind", USUAL_KINDS.get(table))
    if kind is None:
        raise SettingsError(f"{path}.kind is missing: one of {', '.join(kinds)}")
    kind = FORMER_KINDS.get((table, kind), kind) if isinstance(kind, str) else kind
    if not isinstance(kind, str) or kind not in kinds:
        raise SettingsError(f"{path}.kind = {kind!r}: {key_hint(kinds, str(kind))}")
    return _settings(kinds[kind], {k: v for k, v in values.items() if k != "kind"}, path, kind)


def _settings(cls: type, values: Any, path: str, kind: str = "") -> Any:
    """Settings object; what is said of an unknown key knows the other kinds."""
    known = setting_names(cls, f"{path}.")
    table = path.partition(".")[0]

    def hint(key: str) -> str:
        name = key.removeprefix(f"{path}.")
        below = [other for other in known if other.rpartition(".")[2] == name]
        having = [o for o, its in schema.KINDS.get(table, {}).items() if name in setting_names(its)]
        elsewhere = [
            f"{other}.NAME.{name}"
            for other, its in schema.KINDS.items()
            if other != table and any(name in setting_names(one) for one in its.values())
        ]
        of = f" of kind {kind!r}" if kind else ""
        if having and not below:
            return f"{of}: a key of kind {' or '.join(having)}"
        if elsewhere and not below:
            return f"{of}: did you mean {' or '.join(elsewhere)}?"
        of_model = f"; a model's dimensions are keys of {path}.geometry" * (kind == "flexible")
        return f"{of}: {key_hint(known, key)}{of_model}"

    return build(cls, values, f"{path}.", hint)
