"""A scene file: bodies, joints, drives and forces of one mechanism, read and checked.

What needs no mesh is checked here: keys, kinds, values, and that every name is the name of
something. `fenics_ehd.scenes.build` makes a mechanism of it.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from fenics_ehd.errors import SettingsError
from fenics_ehd.key_hints import key_hint, setting_names
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.fields import NONE
from fenics_ehd.settings import build, read_toml, unusual

#: The frame at rest.
GROUND = "ground"

#: Point of a flexible body that is its lubricated bore.
BORE = "bore"

#: Tables of a scene file.
TABLES = (*schema.KINDS, "time", "output")

#: Kind of an entry that does not say its own.
USUAL_KINDS = {"lubricants": "constant"}

#: Keys that name points, by the settings class's field.
POINT_KEYS = ("between", "line", "point", "journal", "bore")

#: Keys of a flexible body that only its mesh and reduction read.
MODEL_KEYS = ("points", "held_by", "cells", "element", "material", "geometry", "reduction")


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene as written and checked.

    Attributes
    ----------
    name
        File or shipped scene it was read from.
    tables
        As written.
    bodies, joints, drives, forces, lubricants
        Settings by name, classes of `fenics_ehd.scenes.schema`; drives by the body they turn.
    time, output
        See there.
    warnings
        Values that may be in another unit, one line each.
    """

    name: str
    tables: Mapping[str, Any]
    bodies: Mapping[str, Any]
    joints: Mapping[str, Any]
    drives: Mapping[str, Any]
    forces: Mapping[str, Any]
    lubricants: Mapping[str, Any]
    time: schema.Time
    output: schema.Output
    warnings: tuple[str, ...]

    def joints_of(self, kind: type) -> Iterator[tuple[str, Any]]:
        """Names and settings of all joints of a class."""
        return ((name, j) for name, j in self.joints.items() if isinstance(j, kind))

    @property
    def span(self) -> float:
        """End or period [s]."""
        time = self.time
        given = time.period if time.periodic else time.end
        return given or time.revolutions * 2 * np.pi / abs(self.speed_of(time.of))

    def speed_of(self, body: str) -> float:
        """Angular speed of a body at the start as written [rad/s]."""
        drive = self.drives.get(body)
        if isinstance(drive, schema.Speed):
            return drive.speed
        return getattr(self.bodies.get(body), "speed", 0.0)


def has_bodies(tables: Mapping[str, Any]) -> bool:
    """Whether the tables of a scene file are those of a mechanism."""
    return "bodies" in tables


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
        Path that ends in ``.toml``, or name of a shipped scene.

    Raises
    ------
    SettingsError
        The file cannot be read, or naming the key that cannot be used.
    """
    path = Path(source)
    tables = read_toml(path if path.suffix == ".toml" else _known(str(source)))
    return scene_of(tables, str(source))


def scene_of(tables: Mapping[str, Any], name: str) -> Scene:
    """Scene of tables as a TOML file has them.

    Raises
    ------
    SettingsError
        Naming the key that cannot be used.
    """
    if not has_bodies(tables):
        raise SettingsError(
            f"{name}: no [bodies.NAME] tables; a scene lists bodies, joints, drives and forces: "
            "'fenics-ehd init slider-crank-paper' prints one with every setting explained"
        )
    for key in tables:
        if key not in TABLES:
            raise SettingsError(f"unknown table [{key}]: {key_hint(TABLES, key)}")
    entries = {table: _entries(table, tables.get(table, {})) for table in schema.KINDS}
    time = _settings(schema.Time, tables.get("time", {}), "time")
    output = _settings(schema.Output, tables.get("output", {}), "output")
    warnings = unusual(time, "time.")
    for table, found in entries.items():
        for entry, settings in found.items():
            warnings += unusual(settings, f"{table}.{entry}.")
    scene = Scene(name, tables, **entries, time=time, output=output, warnings=tuple(warnings))
    _check_names(scene)
    _check_time(scene)
    return scene


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
        return _settings(schema.Ground, values, path)
    kind = values.get("kind", USUAL_KINDS.get(table))
    if kind is None:
        raise SettingsError(f"{path}.kind is missing: one of {', '.join(kinds)}")
    if kind not in kinds:
        raise SettingsError(f"{path}.kind = {kind!r}: {key_hint(kinds, str(kind))}")
    return _settings(kinds[kind], {k: v for k, v in values.items() if k != "kind"}, path, kind)


def _settings(cls: type, values: Any, path: str, kind: str = "") -> Any:
    """Settings object, its missing keys named."""
    known = setting_names(cls, f"{path}.")
    if isinstance(values, Mapping):
        for key in values:
            if f"{path}.{key}" not in known:
                others = _elsewhere(path, key)
                hint = others or key_hint(known, f"{path}.{key}")
                of = f" of kind {kind!r}" if kind else ""
                raise SettingsError(f"unknown key {path}.{key}{of}: {hint}")
        for attribute in attrs.fields(cls):  # type: ignore[arg-type]
            if attribute.default is attrs.NOTHING and attribute.name not in values:
                told = attribute.metadata["help"]
                raise SettingsError(f"{path}.{attribute.name} is missing: {told}")
    return build(cls, values, f"{path}.", known)


def _elsewhere(path: str, key: str) -> str:
    """Which kinds have a key, or which section of them."""
    kinds = schema.KINDS.get(path.partition(".")[0], {})
    having = [k for k, cls in kinds.items() if key in setting_names(cls)]
    return f"a key of kind {' or '.join(having)}" if having else ""


def _check_names(scene: Scene) -> None:
    """Refuse names of what is not there, and a bore used twice."""
    for name, body in scene.bodies.items():
        if isinstance(body, schema.Flexible):
            _check_source(scene, name, body)
    for table in ("joints", "forces"):
        for name, settings in getattr(scene, table).items():
            for key in POINT_KEYS:
                value = getattr(settings, key, ())
                for marker in (value,) if isinstance(value, str) else value:
                    _check_point(scene, f"{table}.{name}.{key}", marker)
            if len(set(getattr(settings, "between", "ab"))) < 2:
                raise SettingsError(f"{table}.{name}.between names the same point twice")
            if not any(getattr(settings, "direction", (1.0,))):
                raise SettingsError(f"{table}.{name}.direction = [0, 0] is none")
    for name, force in scene.forces.items():
        if isinstance(force, schema.AngleTable):
            _check_turning(scene, f"forces.{name}.angle_of", force.angle_of)
    for name in scene.drives:
        _check_turning(scene, f"drives.{name}", name)
    bores: dict[str, str] = {}
    for name, joint in scene.joints_of(schema.Lubricated):
        _check_film(scene, name, joint)
        if joint.bore in bores:
            raise SettingsError(
                f"joints.{name}.bore = {joint.bore!r} is the bore of joints.{bores[joint.bore]} "
                "already: a bore holds one journal; give the second a point of its own"
            )
        bores[joint.bore] = name


def _check_source(scene: Scene, name: str, body: schema.Flexible) -> None:
    """Refuse a part of a model and a file, of neither, or keys of the other one."""
    key = f"bodies.{name}"
    if (body.model == NONE) == (body.body == NONE):
        raise SettingsError(f"{key}: give a model or a body, one of them")
    idle = [k for k in MODEL_KEYS if k in scene.tables["bodies"][name]]
    if body.body != NONE and idle:
        raise SettingsError(
            f"{key}.{idle[0]} does nothing beside body = {body.body!r}, which was reduced before: "
            "drop it, or give a model"
        )


def points_of(body: Any) -> tuple[str, ...] | None:
    """Names of a body's points, None where only its file knows them."""
    if isinstance(body, schema.Flexible):
        return None if body.body != NONE else (BORE, *body.points)
    return tuple(body.points)


def _check_point(scene: Scene, key: str, marker: str) -> None:
    name, dot, point = marker.partition(".")
    if name != GROUND:
        _body(scene, key, name)
    known = points_of(scene.bodies.get(name, schema.Ground()))
    if dot and known is not None and point not in known:
        has = f"its points: {', '.join(known)}" if known else "it has none but its origin"
        raise SettingsError(f"{key} = {marker!r}: body {name} has no point {point!r}, {has}")


def _body(scene: Scene, key: str, name: str) -> Any:
    if name not in scene.bodies:
        known = ", ".join(sorted({GROUND, *scene.bodies}))
        raise SettingsError(f"{key}: there is no body {name!r}, there are {known}")
    return scene.bodies[name]


def _check_turning(scene: Scene, key: str, name: str) -> None:
    body = _body(scene, key, name)
    if isinstance(body, schema.Ground) or getattr(body, "held_by", NONE) != NONE:
        raise SettingsError(f"{key}: body {name} cannot turn")


def _check_film(scene: Scene, name: str, joint: schema.Lubricated) -> None:
    """Refuse an oil that is not there, and a rigid bore without a size."""
    key = f"joints.{name}"
    if (joint.lubricant == NONE) == (joint.viscosity == 0.0):
        raise SettingsError(f"{key}: give a lubricant or a viscosity, one of them")
    if joint.lubricant not in (NONE, *scene.lubricants):
        known = ", ".join(scene.lubricants) or "none"
        raise SettingsError(
            f"{key}.lubricant = {joint.lubricant!r}: there is no [lubricants.{joint.lubricant}], "
            f"there are: {known}"
        )
    if not np.hypot(*joint.eccentricity) < 1.0:
        raise SettingsError(
            f"{key}.eccentricity = {list(joint.eccentricity)} lies on the bore or beyond: its "
            "length must be below 1"
        )
    body, _, point = joint.bore.partition(".")
    bored = scene.bodies.get(body)
    if isinstance(bored, schema.Shaft):
        raise SettingsError(f"{key}.bore = {joint.bore!r}: a shaft has no bore, only journals")
    elastic = isinstance(bored, schema.Flexible) and point == BORE
    if isinstance(bored, schema.Flexible) and not point:
        raise SettingsError(f"{key}.bore = {joint.bore!r}: the bore of {body} is {body}.{BORE}")
    for size in ("radius", "width"):
        if not elastic and not getattr(joint, size):
            raise SettingsError(f"{key}.{size} is missing: that of a rigid bore must be given [m]")


def _check_time(scene: Scene) -> None:
    """Refuse a time that is given twice or not at all."""
    time, key = scene.time, "time.period" if scene.time.periodic else "time.end"
    given, other = (time.period, time.end) if time.periodic else (time.end, time.period)
    if other:
        raise SettingsError(f"time.periodic = {str(time.periodic).lower()}: give {key}")
    if bool(given) == bool(time.revolutions):
        raise SettingsError(f"give {key} or time.revolutions, one of them")
    if time.revolutions:
        _body(scene, "time.of", time.of)
        if not scene.speed_of(time.of):
            raise SettingsError(
                f"time.of = {time.of!r}: its speed at the start is 0, so that revolutions say no "
                f"time: give {key}"
            )
    share = time.largest_step * scene.span / (time.revolutions or 1.0)
    for name, value in (("time.first_step", time.first_step), ("time.largest_step", share)):
        if not time.smallest_step < value:
            raise SettingsError(
                f"time.smallest_step = {time.smallest_step:g} s must be below {name} = {value:g} s"
            )
