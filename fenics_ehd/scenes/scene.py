"""Scenes: settings of mechanisms, read from files, checked, and written as text again.

A `Scene` holds the settings of one mechanism: bodies, joints, drives and forces by name. Checks
that need no mesh are made here: keys, kinds and values, names of bodies and points, times, and
settings without effect. Each value is checked by its class; a scene adds the key to the message.
`fenics_ehd.scenes.build` makes the mechanism. The text of a scene lists every setting with its
value and its meaning, and files with absolute paths.

Imports inside functions: `--help` and rigid scenes must not import films, meshes and models.
"""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from copy import deepcopy
from pathlib import Path
from typing import Any, NamedTuple

import attrs
import numpy as np

from fenics_ehd.base.arguments import require_class
from fenics_ehd.base.described import Described, Named, names_or_none
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.fields import entries, section
from fenics_ehd.base.files import MANIFEST, SCENE_NAME
from fenics_ehd.base.needs import NONE, no_effect
from fenics_ehd.base.printed import key_hint, shown
from fenics_ehd.base.settings import (
    UnknownKeyError,
    build,
    idle_settings,
    read_toml,
    require_effects,
    setting_names,
    to_toml,
    unusual,
    without_effect,
)
from fenics_ehd.film.heat import require_cycle, require_graded
from fenics_ehd.film.kinematics import require_inside
from fenics_ehd.film.lubricant import Lubricant, make_lubricant
from fenics_ehd.multibody.body import MasslessBody, RigidBody
from fenics_ehd.multibody.forces import Unbalance
from fenics_ehd.multibody.joints import (
    ACTING_POINTS,
    Speed,
    named_points,
    require_body,
    require_point,
    require_single_bores,
    require_turning,
    require_two_bodies,
)
from fenics_ehd.multibody.shaft import ShaftBody, require_shaft_point
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.library import shipped_scene
from fenics_ehd.scenes.part_settings import ELEMENTS, OutputSettings

#: Name of the frame at rest.
GROUND = "ground"


#: Sides of a joint on which a flexible body has a surface that deforms (`Body.surface`).
ELASTIC_SIDES = ("bore",)


class ElasticSurface(NamedTuple):
    """Surface of a joint that deforms.

    Attributes
    ----------
    side
        ``"bore"`` or ``"journal"``, a key of the joint.
    body, point
        Names of the flexible body, and of its point.
    """

    side: str
    body: str
    point: str


@attrs.frozen(eq=False, kw_only=True, repr=False)
class Scene(Described):
    """Checked settings of a scene.

    Attributes
    ----------
    bodies, joints, drives, forces, lubricants
        Settings by name, of the classes in `fenics_ehd.scenes.schema`; a drive has the name of the
        body that it turns.
    time, output
        Settings of the run, and of its files and accuracy.
    name
        Scene file or shipped scene from which the settings were read.
    tables
        Tables of the scene as they were written.
    renamed
        Notices of keys with former names, one line each.
    warnings
        Notices of values that are accepted but probably not intended, one line each.
    """

    bodies: dict = entries(
        "moving bodies by name", schema.KINDS["bodies"], {GROUND: schema.GroundSettings}
    )
    joints: dict = entries("connections of points of two bodies", schema.KINDS["joints"])
    drives: dict = entries("drives by the name of the driven body", schema.KINDS["drives"])
    forces: dict = entries("forces on points of bodies", schema.KINDS["forces"])
    lubricants: dict = entries("oils of lubricated joints by name", schema.KINDS["lubricants"])
    time: schema.TimeSettings = section(schema.TimeSettings)
    output: OutputSettings = section(OutputSettings)
    name: str = ""
    tables: Mapping[str, Any] = attrs.Factory(dict)
    renamed: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def __attrs_post_init__(self) -> None:
        for name in schema.KINDS:
            require_class(name, getattr(self, name), dict)
            getattr(self, name).label = f"scene.{name}"

    def described(self) -> Iterator[tuple[str, str]]:
        """Yield bodies, joints, drives, forces, lubricants and time span of the scene."""
        yield "Scene", self.name or "without a file"
        for kind in ("bodies", "joints", "drives", "forces", "lubricants"):
            settings = getattr(self, kind)
            tables = self.tables.get(kind, {})
            kinds = ((name, tables.get(name, {}).get("kind", "")) for name in settings)
            yield kind, names_or_none(f"{name} ({word})" if word else name for name, word in kinds)
        time = self.tables.get("time", {})
        yield "time", names_or_none(f"{name} = {shown(value)}" for name, value in time.items())
        yield "warnings", str(len(self.warnings))

    @property
    def films(self) -> dict[str, schema.LubricatedSettings]:
        """Settings of the lubricated joints, by name."""
        lubricated = schema.LubricatedSettings
        joints = self.joints.items()
        films = {name: joint for name, joint in joints if isinstance(joint, lubricated)}
        return Named(films, "scene.films")

    def elastic_surfaces(self, joint: schema.LubricatedSettings) -> list[ElasticSurface]:
        """Surfaces of a joint that deform; an empty list if bore and journal are rigid."""
        surfaces = []
        for side in ELASTIC_SIDES:
            name, _, point = getattr(joint, side).partition(".")
            body = self.bodies.get(name)
            if isinstance(body, schema.FlexibleSettings) and point in body.bores:
                surfaces.append(ElasticSurface(side, name, point))
        return surfaces

    def film_element(self, body: str) -> str:
        """Element family in which the pressures on a flexible body are interpolated.

        The family is that of the film in the first bore that has a film, or 9-node elements if that
        film has bilinear elements. The pressures of the other films are transferred to this family.
        """
        by_point = {
            (surface.body, surface.point): joint.element
            for joint in self.films.values()
            for surface in self.elastic_surfaces(joint)
        }
        elements = (by_point.get((body, point), "") for point in self.bodies[body].bores)
        element = next(filter(None, elements), "lagrange")
        return element if element in ELEMENTS else "lagrange"

    def film_edges(self, body: str) -> dict[str, tuple[float, ...]]:
        """Heights z at which the film pressures on a flexible body may change abruptly [m].

        Heights are listed by the name of the surface: the edges of oil supplies, and -inf and inf
        for the ends of rough surfaces, see `fenics_ehd.reduction.pressure_family`. Holes in the
        mesh of a bore are not included.
        """
        edges: dict[str, tuple[float, ...]] = {}
        for joint in self.films.values():
            reaches = [supply.reach for supply in joint.supply.values()]
            if joint.contact.roughness:
                reaches.append((-np.inf, np.inf))
            heights = np.unique([reach for reach in reaches if reach[0] < reach[1]])
            for surface in self.elastic_surfaces(joint):
                if surface.body == body and len(heights):
                    edges[surface.point] = tuple(heights.tolist())
        return edges

    @property
    def has_duration(self) -> bool:
        """Whether the scene has the duration of a run; a scene for rotor maps needs none."""
        return bool(self.time.end or self.time.period or self.time.revolutions)

    @property
    def span(self) -> float:
        """End time of a run [s]; in a periodic run, the period.

        Raises
        ------
        SettingsError
            The scene has no duration, which only rotor maps do not need.
        """
        time = self.time
        if not self.has_duration:
            check_time(self)
        duration = time.period if time.periodic else time.end
        return duration or time.revolutions * 2 * np.pi / abs(self.speed_of(time.of))

    def speed_of(self, body: str) -> float:
        """Angular speed of a body at the start [rad/s], from its drive or settings; else 0."""
        drive = self.drives.get(body)
        if isinstance(drive, Speed):
            return drive.speed
        return getattr(self.bodies.get(body), "speed", 0.0)


def flexible(scene: Scene) -> tuple[str, ...]:
    """Names of the flexible bodies of a scene."""
    bodies = scene.bodies.items()
    return tuple(name for name, body in bodies if isinstance(body, schema.FlexibleSettings))


def meshed(scene: Scene) -> tuple[str, ...]:
    """Names of the flexible bodies that must be meshed and reduced, not read from files."""
    return tuple(name for name in flexible(scene) if scene.bodies[name].model != NONE)


def joint_lubricant(scene: Scene, joint: schema.LubricatedSettings) -> Lubricant:
    """Oil of a joint; if the joint has a heat balance, at the temperature of the supplied oil."""
    if joint.lubricant == NONE:
        return Lubricant(joint.viscosity)
    settings = scene.lubricants[joint.lubricant]
    if joint.heat is not None and settings.graded:
        settings = attrs.evolve(settings, temperature=joint.heat.supply_temperature)
    return make_lubricant(settings)


def check_lubricants(scene: Scene) -> None:
    """Refuse oils whose settings are incomplete.

    An oil needs no temperature if all joints with this oil have a heat balance.

    Raises
    ------
    SettingsError
        An oil cannot be made; the message names it.
    """
    for name, settings in scene.lubricants.items():
        users = [joint for joint in scene.films.values() if joint.lubricant == name]
        try:
            for joint in users:
                joint_lubricant(scene, joint)
            if not users:
                make_lubricant(settings)
        except SettingsError as error:
            raise SettingsError(f"lubricants.{name}: {error}") from None


def check_heat(scene: Scene, name: str) -> None:
    """Refuse a heat balance without a periodic cycle, or for an oil with constant viscosity.

    Raises
    ------
    SettingsError
        The heat balance is refused; the message names the key to change.
    """
    joint = scene.joints[name]
    key = f"joints.{name}.heat"
    if joint.heat is None:
        return
    if scene.has_duration:
        require_cycle(scene.time.periodic, key)
    if joint.lubricant == NONE:
        require_graded(False, key=key, lubricant=f"joints.{name}")
    else:
        graded = scene.lubricants[joint.lubricant].graded
        require_graded(graded, key=key, lubricant=f"lubricants.{joint.lubricant}")


#: Classes of bodies that have a mass with any settings.
ELASTIC = (schema.FlexibleSettings, ShaftBody)

#: Largest Reynolds number of laminar flow in a bearing: turbulence starts at about 1000 and is
#: complete near 1600 (chapter 5.5 of Bearing Design in Machinery, opened at 1library.net).
LAMINAR = 1000.0

#: Combined roughness over the clearance, above which no film separates the surfaces.
ROUGHEST = 0.3


def check_names(scene: Scene) -> None:
    """Refuse unknown names of bodies, points and oils, and a bore that two joints use.

    Raises
    ------
    SettingsError
        A name is unknown or used twice; the message names the key.
    """
    for name, body in scene.bodies.items():
        if isinstance(body, schema.FlexibleSettings):
            _check_source(scene, name, body)
    points = {GROUND: (), **{name: points_of(body) for name, body in scene.bodies.items()}}
    for table in ("joints", "forces"):
        for name, settings in getattr(scene, table).items():
            named = named_points(settings)
            for attribute, marker in named:
                key = f"{table}.{name}.{attribute}"
                require_point(key, marker, points)
                if attribute in ACTING_POINTS:
                    require_shaft_point(key, marker, scene.bodies.get(marker.partition(".")[0]))
            ends = [marker for attribute, marker in named if attribute != "angle_of"]
            require_two_bodies(f"{table}.{name}", ends)
    for name, force in scene.forces.items():
        if isinstance(force, schema.AngleTableSettings):
            _check_turning(scene, f"forces.{name}.angle_of", force.angle_of)
        if isinstance(force, Unbalance):
            _check_turning(scene, f"forces.{name}.point", force.point)
    for name, drive in scene.drives.items():
        require_body(f"drives.{name}", name, points)
        _check_turning(scene, f"drives.{name}", name)
        speed = scene.bodies[name].speed
        if isinstance(drive, Speed) and speed not in (0.0, drive.speed):
            raise no_effect(f"bodies.{name}.speed", speed, f"with drives.{name}.kind = 'speed'")
    check_lubricants(scene)
    for name, joint in scene.films.items():
        _check_film(scene, name, joint)
        check_heat(scene, name)
    require_single_bores({name: joint.bore for name, joint in scene.films.items()})


def _check_source(scene: Scene, name: str, body: schema.FlexibleSettings) -> None:
    """Refuse a flexible body that has neither a model nor a file, or both, or equal bore names."""
    key = f"bodies.{name}"
    if not body.bores or len(set(body.bores)) < len(body.bores):
        raise SettingsError(f"{key}.bores = {list(body.bores)} must be one or more different names")
    if (body.model == NONE) == (body.body == NONE):
        raise SettingsError(f"{key}: give either a model or a body")


def points_of(body: Any) -> tuple[str, ...] | None:
    """Names of a body's points; None if they are only in the file of the reduced body."""
    if isinstance(body, schema.FlexibleSettings):
        return None if body.body != NONE else (*body.bores, *body.points)
    return tuple(body.points)


def _check_turning(scene: Scene, key: str, marker: str) -> None:
    name = marker.partition(".")[0]
    body = scene.bodies.get(name, schema.GroundSettings())
    held = isinstance(body, schema.GroundSettings) or getattr(body, "clamped", NONE) != NONE
    require_turning(key, name, turns=not held)


def _check_film(scene: Scene, name: str, joint: schema.LubricatedSettings) -> None:
    """Refuse a film whose oil, size, surfaces or bore are missing or do not fit each other."""
    key = f"joints.{name}"
    if (joint.lubricant == NONE) == (joint.viscosity == 0.0):
        raise SettingsError(f"{key}: give either a lubricant or a viscosity")
    if joint.lubricant not in (NONE, *scene.lubricants):
        known = ", ".join(scene.lubricants) or "none"
        raise SettingsError(
            f"{key}.lubricant = {joint.lubricant!r}: there is no [lubricants.{joint.lubricant}]: "
            f"choose from {known}"
        )
    _check_oil(scene, name, joint)
    require_inside(
        joint.eccentricity, rough=bool(joint.contact.roughness), key=f"{key}.eccentricity"
    )
    _check_contact(joint, key)
    elastic = scene.elastic_surfaces(joint)
    if joint.transfer != schema.TRANSFERS[0] and not elastic:
        raise no_effect(f"{key}.transfer", joint.transfer, "without a flexible bore")
    body, _, point = joint.bore.partition(".")
    bored = scene.bodies.get(body)
    if isinstance(bored, ShaftBody):
        raise SettingsError(f"{key}.bore = {joint.bore!r}: a shaft has journals, but no bore")
    if isinstance(bored, schema.FlexibleSettings) and not point:
        bores = ", ".join(f"{body}.{bore}" for bore in bored.bores)
        raise SettingsError(f"{key}.bore = {joint.bore!r}: name one of the bores {bores}")
    for size in ("radius", "width"):
        if not elastic and not getattr(joint, size):
            raise SettingsError(f"{key}.{size} is missing [m]: a rigid bore needs it")


def _check_contact(joint: schema.LubricatedSettings, key: str) -> None:
    """Refuse surfaces that are too rough for the clearance.

    Raises
    ------
    SettingsError
        The roughness exceeds its limit; the message has both, and the clearance.
    """
    contact = joint.contact
    if not contact.roughness < ROUGHEST * joint.clearance:
        raise SettingsError(
            f"{key}.contact: the combined roughness of {contact.roughness:g} m must be below "
            f"{ROUGHEST:g} of the clearance, {joint.clearance:g} m"
        )


def _check_oil(scene: Scene, name: str, joint: schema.LubricatedSettings) -> None:
    """Refuse settings of a joint that exclude mass-conserving cavitation.

    These are film elements that cannot conserve mass, and a massless journal in a gap that is not
    filled with oil at the start.
    """
    if joint.cavitation != "mass-conserving":
        return
    from fenics_ehd.film.oil_balance import require_monotone  # slow to import

    key = f"joints.{name}"
    require_monotone(joint.element, f"{key}.element")
    body = joint.journal.partition(".")[0]
    massless = type(scene.bodies.get(body)) is MasslessBody
    if massless and joint.initial_filling < 1.0:
        raise SettingsError(
            f"{key}.initial_filling = {joint.initial_filling:g}: no force holds the massless body "
            f"{body} until the gap is full: set the key to 1, or give the body a mass"
        )


def notices(scene: Scene) -> list[str]:
    """Notices of values that are accepted but probably not intended, one line each."""
    weights = [n for n, f in scene.forces.items() if isinstance(f, schema.GravitySettings)]
    lines = []
    if len(weights) > 1:
        x, y = np.sum([scene.forces[name].acceleration for name in weights], axis=0)
        lines.append(f"forces.{', forces.'.join(weights)}: several entries of gravity act with "
                     f"their sum, [{x:g}, {y:g}] m/s2")  # fmt: skip
    stiff = [b for b in scene.bodies.values() if isinstance(b, MasslessBody)]
    all_stiff = not any(isinstance(b, ELASTIC) for b in scene.bodies.values())
    massive = weights or any(isinstance(body, RigidBody) for body in stiff)
    if all_stiff and massive and not any(getattr(body, "mass", 0.0) for body in stiff):
        lines.append("bodies: no body has a mass, so gravity and inertia have no effect")
    for name, joint in scene.films.items():
        lines += _turbulent(scene, name, joint)
    return lines


def _turbulent(scene: Scene, name: str, joint: schema.LubricatedSettings) -> list[str]:
    """Notice, as a list of one line, if the flow of a film at the start is not laminar.

    The list is empty if the Reynolds number is at most `LAMINAR`.
    """
    lubricant = joint_lubricant(scene, joint)
    radius = joint.radius
    if not radius and (elastic := scene.elastic_surfaces(joint)):
        radius = float(scene.bodies[elastic[0].body].geometry.get("bore_radius", 0.0))
    journal, bore = (scene.speed_of(at.partition(".")[0]) for at in (joint.journal, joint.bore))
    flow = lubricant.density * abs(journal - bore) * radius * joint.clearance
    number = flow / lubricant.viscosity
    if number <= LAMINAR:
        return []
    return [
        f"joints.{name}: its film has a Reynolds number of {number:.4g}, but the equations hold "
        f"for laminar flow, up to {LAMINAR:g}: check speed, clearance and viscosity"
    ]


def check_time(scene: Scene) -> None:
    """Refuse a duration that is missing or given twice, and limits of steps that contradict it.

    The duration is given either by time.end (time.period for a periodic run) or by
    time.revolutions.

    Raises
    ------
    SettingsError
        The duration or a limit of the steps is refused; the message names the key.
    """
    time = scene.time
    key = "time.period" if time.periodic else "time.end"
    duration = time.period if time.periodic else time.end
    if bool(duration) == bool(time.revolutions):
        raise SettingsError(f"give either {key} or time.revolutions")
    if time.revolutions:
        require_body("time.of", time.of, {GROUND: (), **scene.bodies})
        if not scene.speed_of(time.of):
            raise SettingsError(
                f"time.of = {time.of!r} has the speed 0 at the start, so that revolutions give no "
                f"duration: give {key} instead"
            )
    largest_step = time.largest_step * scene.span / (time.revolutions or 1.0)
    for name, value in (("time.first_step", time.first_step), ("time.largest_step", largest_step)):
        if not time.smallest_step < value:
            raise SettingsError(
                f"time.smallest_step = {time.smallest_step:g} s must be below {name} = {value:g} s"
            )


#: Names of the tables of a scene file.
TABLES = (*schema.KINDS, "time", "output")

#: Endings of texts in a scene that are paths of files.
FILES = (".csv", ".h5", ".geo", ".msh")

#: Present names of keys from versions 0.2 and 0.3, by the path of the former key without names of
#: entries.
RENAMED = {
    ("bodies", "held_by"): "clamped",
    ("bodies", "reduction", "residual_truncation"): "flexibility_tolerance",
    ("joints", "heat", "conducted"): "conducted_share",
    ("joints", "heat", "mixing"): "outlet_weight",
}

#: Present name by the last word of the former key; no other key has such a word.
NOW = {path[-1]: new for path, new in RENAMED.items()}


def today(key: str) -> str:
    """Replace a former name at the end of a key by its present name."""
    before, dot, last = key.rpartition(".")
    return before + dot + NOW.get(last, last)


def renamed(tables: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Tables with present names in place of former ones, and a notice for each former name."""
    current = deepcopy(dict(tables))
    lines = []
    for (table, *between, old), new in RENAMED.items():
        entries_of = current.get(table)
        for name, entry in entries_of.items() if isinstance(entries_of, Mapping) else ():
            for key in between:
                entry = entry.get(key) if isinstance(entry, Mapping) else None
            if isinstance(entry, dict) and old in entry and new not in entry:
                entry[new] = entry.pop(old)
                lines.append(f"{'.'.join((table, name, *between, old))} is now named {new}")
    oils = current.get("lubricants")
    for oil in oils.values() if isinstance(oils, Mapping) else ():
        if isinstance(oil, dict) and oil.get("kind", "constant") == "constant":
            oil["kind"] = "oil"  # the only kind; "constant" is its former name
    return current, lines


def with_absolute_paths(tables: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Tables with absolute paths of files; relative paths refer to the scene's folder."""
    resolved: dict[str, Any] = {}
    for key, value in tables.items():
        if isinstance(value, Mapping):
            resolved[key] = with_absolute_paths(value, folder)
        elif isinstance(value, str) and Path(value).suffix in FILES:
            resolved[key] = str((folder / value).absolute())
        else:
            resolved[key] = value
    return resolved


def read_scene(source: str | Path | Mapping[str, Any], **changes: Any) -> Scene:
    """Read a scene from a TOML file, from the package, or from tables as in a TOML file.

    Parameters
    ----------
    source
        Path that ends with ``.toml``, whose files are relative to its folder; name of a shipped
        scene; or tables, whose files are relative to the working directory.
    changes
        New values by full key, which replace values of the source:
        ``**{"time.tolerance": 1e-4}``.

    Raises
    ------
    SettingsError
        The file cannot be read, or a key or value is refused; the message names it.
    """
    require_class("source", source, str, Path, Mapping)
    if isinstance(source, Mapping):
        scene = scene_of(with_absolute_paths(source, Path()), "scene")
    elif Path(source).suffix != ".toml":
        scene = scene_of(read_toml(shipped_scene(str(source))), str(source))
    else:
        tables = with_absolute_paths(read_toml(source), Path(source).parent)
        if _of_run(Path(source)):
            tables = _without_idle(renamed(tables)[0], ())
        scene = scene_of(tables, str(source))
    return changed(scene, changes) if changes else scene


def _of_run(path: Path) -> bool:
    """True if the scene file is in a run's folder, where version 0.3 wrote keys without effect."""
    return path.name == SCENE_NAME and (path.parent / MANIFEST).is_file()


def changed(scene: Scene, values: Mapping[str, Any], optional: Collection[str] = ()) -> Scene:
    """Replace values of a scene by full keys such as ``time.end`` or ``bodies.rod.mass``.

    Parameters
    ----------
    scene
        Scene, which is not modified.
    values
        New values by full key; files are relative to the working directory.
    optional
        Keys in `values` that are dropped, not refused, if other new values leave them without
        effect.

    Raises
    ------
    SettingsError
        A key or value is refused; the message names the key.
    """
    tables = deepcopy(dict(scene.tables))
    renamed_lines = list(scene.renamed)
    for key, value in values.items():
        *path, last = today(key).split(".")
        if last != key.rpartition(".")[2]:
            renamed_lines.append(f"{key} is now named {last}")
        table = tables
        for name in path:
            table = table.setdefault(name, {})
            if not isinstance(table, dict):
                raise SettingsError(f"unknown key {key}: {name} is not a table")
        table[last] = deepcopy(value)  # the caller's tables must not change
    changes = {today(key) for key in values if key not in optional}
    absolute = with_absolute_paths(tables, Path())
    return scene_of(_without_idle(absolute, changes), scene.name, renamed_lines)


def _without_idle(tables: Mapping[str, Any], changes: Collection[str]) -> dict[str, Any]:
    """Drop keys that have no effect because of changes of other keys.

    If ``method = "m4"`` replaces "m3", ``residual_modes`` is dropped. A sweep over methods keeps it
    in the cases with M3.
    """
    remaining = deepcopy(dict(tables))
    try:
        scene = build(Scene, remaining)
    except SettingsError:
        return remaining  # `scene_of` refuses the tables, with a hint
    for name, *_ in idle_settings(scene):
        if not any(name == key or name.startswith(f"{key}.") for key in changes):
            *path, last = name.split(".")
            table = remaining
            for key in path:
                table = table[key]
            table.pop(last, None)
    return remaining


def scene_of(tables: Mapping[str, Any], name: str, renamed_before: Iterable[str] = ()) -> Scene:
    """Make a checked scene from tables as in a TOML file.

    Parameters
    ----------
    tables
        Settings by table and key.
    name
        Name of the scene, for messages and results.
    renamed_before
        Notices of former keys that were already replaced in the tables.

    Raises
    ------
    SettingsError
        A key or value is refused; the message names the key.
    """
    tables, lines = renamed(tables)
    lines = [*dict.fromkeys((*renamed_before, *lines))]
    if "bodies" not in tables:
        raise SettingsError(
            f"{name}: no [bodies.NAME] tables: write bodies, joints, drives and forces; "
            "'fenics-ehd init slider-crank-paper' prints a scene with every setting explained"
        )
    for key in tables:
        if key not in TABLES:
            raise SettingsError(f"unknown table [{key}]: {key_hint(TABLES, key)}")
    try:
        scene = attrs.evolve(build(Scene, tables), name=name, tables=tables)
    except UnknownKeyError as error:
        raise SettingsError(f"unknown key {error}{_hint(tables, str(error))}") from None
    scene, replaced = with_model_materials(scene)
    check_names(scene)
    require_effects(scene)
    if scene.has_duration:
        check_time(scene)
    warnings = (*lines, *replaced, *unusual(scene), *without_effect(scene), *notices(scene))
    return attrs.evolve(scene, renamed=tuple(lines), warnings=warnings)


def with_model_materials(scene: Scene) -> tuple[Scene, list[str]]:
    """Add the materials that are stored in models to a scene; return the scene and notices.

    Values in the tables of the scene have priority over values that
    `fenics_ehd.fem.models.store_material` wrote into a model. A notice reports different values.

    Raises
    ------
    MeshError
        The material of a model cannot be read.
    """
    bodies = dict(scene.bodies)
    lines = []
    for name in meshed(scene):
        body = scene.bodies[name]
        path = Path(body.model)
        if path.suffix != ".msh" or not path.is_file():
            continue
        from fenics_ehd.fem.models import stored_material  # with the reduction

        written = scene.tables["bodies"][name].get("material", {})
        stored_values = stored_material(path)
        for key, value in stored_values.items():
            if key in written and (used := getattr(body.material, key)) != value:
                full = f"bodies.{name}.material.{key}"
                lines.append(f"{full} = {used:g} is used, but model {path.name} has {value:g}")
        values = {key: value for key, value in stored_values.items() if key not in written}
        bodies[name] = attrs.evolve(body, material=attrs.evolve(body.material, **values))
    return attrs.evolve(scene, bodies=bodies), lines


def _hint(tables: Mapping[str, Any], key: str) -> str:
    """Hint for an unknown key: a similar key, or the kinds or tables that have this key."""
    table, *entry = key.split(".")
    name = entry[-1]
    kinds = schema.KINDS.get(table)
    if kinds is None:
        section = attrs.fields_dict(Scene)[table].metadata["section"]
        return f": {key_hint(setting_names(section, f'{table}.'), key)}"
    path = f"{table}.{entry[0]}."
    kind = tables[table][entry[0]].get("kind", "")
    known = setting_names(kinds[kind] if kind else schema.GroundSettings, path)
    of = f" of kind {kind!r}" if kind else ""
    if not any(other.endswith(f".{name}") for other in known):
        having = [other for other, settings in kinds.items() if name in setting_names(settings)]
        if having:
            return f"{of}: a key of kind {' or '.join(having)}"
        elsewhere = [other for other in setting_names(Scene) if other.endswith(f".NAME.{name}")]
        if elsewhere:
            return f"{of}: did you mean {' or '.join(elsewhere)}?"
    of_model = f"; a model's dimensions are keys of {path}geometry" * (kind == "flexible")
    return f"{of}: {key_hint(known, key)}{of_model}"


def as_stored(source: str | Path) -> Scene:
    """Read a scene with its values rounded as in the text that is stored with a run.

    A run and its resumption, which reads that text, thus calculate with the same values.

    Parameters
    ----------
    source
        Source of the scene, as for `read_scene`.
    """
    return attrs.evolve(stored(read_scene(source)), name=Path(source).stem)


def stored(scene: Scene) -> Scene:
    """Round the values of a scene to the digits in its text."""
    return scene_of(tomllib.loads(scene_text(scene)), scene.name, scene.renamed)


def by_key(tables: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Values of nested tables, each with its dotted key."""
    for name, value in tables.items():
        if isinstance(value, Mapping):
            yield from by_key(value, f"{path}{name}.")
        else:
            yield f"{path}{name}", value


def csv_files(tables: Mapping[str, Any]) -> list[Path]:
    """Paths of the existing CSV files to which a scene refers."""
    names = [value for _, value in by_key(tables) if str(value).endswith(".csv")]
    return [Path(name) for name in names if Path(name).is_file()]


def input_files(source: str | Path, scene: Scene) -> list[Path]:
    """Files from which a scene is read: its own file, and files and folders to which it refers.

    Parameters
    ----------
    source
        Source of the scene, as for `read_scene`.
    scene
        Scene that was read, whose tables have absolute paths.
    """
    texts = [str(value) for _, value in by_key(scene.tables) if isinstance(value, str)]
    paths = [Path(text) for text in texts if "\0" not in text and Path(text).is_absolute()]
    files = [Path(source)] if Path(source).suffix == ".toml" else []
    for path in paths:
        with suppress(OSError):  # the path is too long, or not readable
            files += sorted(path.iterdir()) if path.is_dir() else [path]
    return files


def scene_text(scene: Scene) -> str:
    """TOML text of a scene, from which `read_scene` reads the same scene."""
    return to_toml(scene).lstrip("\n")
