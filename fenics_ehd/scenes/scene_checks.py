"""What a scene may not say although every value is a possible one: names and times."""

from __future__ import annotations

from typing import Any

import attrs
import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.oil import DENSITY
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.fields import NONE
from fenics_ehd.scenes.heat import check_heat, check_lubricants, joint_lubricant
from fenics_ehd.scenes.scene import GROUND, Scene

#: Bodies that have a mass whatever is written.
ELASTIC = (schema.FlexibleSettings, schema.ShaftSettings)

#: Reynolds number up to which films of bearings are laminar: turbulence begins at about 1000 and is
#: complete near 1600 (chapter 5.5 of Bearing Design in Machinery, opened at 1library.net).
LAMINAR = 1000.0

#: Keys that name points, by the settings class's field.
POINT_KEYS = ("between", "line", "point", "journal", "bore")

#: Keys of a flexible body that only its mesh and reduction read.
MODEL_KEYS = ("points", "held_by", "cells", "element", "material", "geometry", "reduction")

#: Combined roughness over the clearance above which there is no film between rough surfaces.
ROUGHEST = 0.3


def check_names(scene: Scene) -> None:
    """Refuse names of what is not there, and a bore used twice."""
    for name, body in scene.bodies.items():
        if isinstance(body, schema.FlexibleSettings):
            _check_source(scene, name, body)
    for table in ("joints", "forces"):
        for name, settings in getattr(scene, table).items():
            for key in POINT_KEYS:
                value = getattr(settings, key, ())
                for marker in (value,) if isinstance(value, str) else value:
                    _check_point(scene, f"{table}.{name}.{key}", marker)
            _check_apart(f"{table}.{name}", settings)
            if not any(getattr(settings, "direction", (1.0,))):
                raise SettingsError(f"{table}.{name}.direction = [0, 0] is none")
    for name, force in scene.forces.items():
        if isinstance(force, schema.AngleTableSettings):
            _check_turning(scene, f"forces.{name}.angle_of", force.angle_of)
    for name in scene.drives:
        _check_turning(scene, f"drives.{name}", name)
    check_lubricants(scene)
    bores: dict[str, str] = {}
    for name, joint in scene.joints_of(schema.LubricatedSettings):
        _check_film(scene, name, joint)
        check_heat(scene, name)
        if joint.bore in bores:
            raise SettingsError(
                f"joints.{name}.bore = {joint.bore!r} is the bore of joints.{bores[joint.bore]} "
                "already: a bore holds one journal; give the second a point of its own"
            )
        bores[joint.bore] = name


def _check_apart(key: str, settings: Any) -> None:
    """Refuse a joint or a spring of a body with itself."""
    for first, second in (("between", "between"), ("line", "point"), ("journal", "bore")):
        if hasattr(settings, first):
            ends = getattr(settings, first), getattr(settings, second)
            a, b = ends[0] if first == second else ends
            if a.partition(".")[0] == b.partition(".")[0]:
                raise SettingsError(f"{key}: {a} and {b} are points of one body")


def _check_source(scene: Scene, name: str, body: schema.FlexibleSettings) -> None:
    """Refuse a part of a model and a file, of neither, or keys of the other one."""
    key = f"bodies.{name}"
    if not body.bores or len(set(body.bores)) < len(body.bores):
        raise SettingsError(f"{key}.bores = {list(body.bores)} must be names, each of them once")
    if (body.model == NONE) == (body.body == NONE):
        raise SettingsError(f"{key}: give a model or a body, one of them")
    idle = [k for k in MODEL_KEYS if k in scene.tables["bodies"][name]]
    if body.body != NONE and idle:
        raise SettingsError(
            f"{key}.{', '.join(idle)} do nothing beside body = {body.body!r}, which was reduced "
            "before: drop them, or give a model"
        )


def points_of(body: Any) -> tuple[str, ...] | None:
    """Names of a body's points, None where only its file knows them."""
    if isinstance(body, schema.FlexibleSettings):
        return None if body.body != NONE else (*body.bores, *body.points)
    return tuple(body.points)


def _check_point(scene: Scene, key: str, marker: str) -> None:
    name, dot, point = marker.partition(".")
    if name != GROUND:
        _body(scene, key, name)
    known = points_of(scene.bodies.get(name, schema.GroundSettings()))
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
    if isinstance(body, schema.GroundSettings) or getattr(body, "held_by", NONE) != NONE:
        raise SettingsError(f"{key}: body {name} cannot turn")


def _check_film(scene: Scene, name: str, joint: schema.LubricatedSettings) -> None:
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
    _check_oil(scene, name, joint)
    if not np.hypot(*joint.eccentricity) < 1.0:
        raise SettingsError(
            f"{key}.eccentricity = {list(joint.eccentricity)} lies on the bore or beyond: its "
            "length must be below 1"
        )
    _check_contact(joint, key)
    body, _, point = joint.bore.partition(".")
    bored = scene.bodies.get(body)
    if isinstance(bored, schema.ShaftSettings):
        raise SettingsError(f"{key}.bore = {joint.bore!r}: a shaft has no bore, only journals")
    if isinstance(bored, schema.FlexibleSettings) and not point:
        bores = ", ".join(f"{body}.{bore}" for bore in bored.bores)
        raise SettingsError(f"{key}.bore = {joint.bore!r}: the bores of {body} are {bores}")
    for size in ("radius", "width"):
        if not scene.elastic_bore(joint) and not getattr(joint, size):
            raise SettingsError(f"{key}.{size} is missing: that of a rigid bore must be given [m]")


def _check_contact(joint: schema.LubricatedSettings, key: str) -> None:
    """Refuse what is no pair of rough surfaces.

    Raises
    ------
    SettingsError
        Keys of smooth surfaces, one of two that belong together, or surfaces too rough.
    """
    contact, key = joint.contact, f"{key}.contact"
    roughness = np.hypot(contact.journal_roughness, contact.bore_roughness)
    if not roughness:
        if contact != schema.ContactSettings():
            raise SettingsError(
                f"{key}: journal_roughness and bore_roughness are 0: give one of them, or drop it"
            )
        return
    if bool(contact.asperity_density) != bool(contact.asperity_radius):
        raise SettingsError(f"{key}: asperity_density and asperity_radius belong together")
    if not roughness < ROUGHEST * joint.clearance:
        raise SettingsError(
            f"{key}: the combined roughness of {roughness:g} m must be below {ROUGHEST:g} of the "
            f"clearance, {joint.clearance:g} m"
        )


def _check_oil(scene: Scene, name: str, joint: schema.LubricatedSettings) -> None:
    """Refuse elements that cannot conserve oil, and settings of oil where it is not conserved."""
    key = f"joints.{name}"
    if not joint.initial_filling <= 1.0:
        raise SettingsError(
            f"{key}.initial_filling = {joint.initial_filling:g} must be at most 1, a full gap"
        )
    if joint.cavitation == "mass-conserving":
        from fenics_ehd.film.oil_balance import require_monotone  # slow to import

        require_monotone(joint.element, f"{key}.element")
        body = joint.journal.partition(".")[0]
        massless = type(scene.bodies.get(body)) is schema.MasslessSettings
        if massless and joint.initial_filling < 1.0:
            raise SettingsError(
                f"{key}.initial_filling = {joint.initial_filling:g}: before the gap is full "
                f"nothing holds the massless body {body}: it must be 1, or the body have a mass"
            )
        return
    for idle in ("initial_filling", "ambient"):
        if getattr(joint, idle) != getattr(attrs.fields(type(joint)), idle).default:
            raise SettingsError(
                f"{key}.{idle} does nothing under Reynolds' condition: set {key}.cavitation = "
                "'mass-conserving'"
            )


def notices(scene: Scene) -> list[str]:
    """What a scene may say and hardly means, one line each."""
    weights = [n for n, f in scene.forces.items() if isinstance(f, schema.GravitySettings)]
    found = []
    if len(weights) > 1:
        x, y = np.sum([scene.forces[name].acceleration for name in weights], axis=0)
        found.append(f"forces.{', forces.'.join(weights)}: all of them are gravity, and act with "
                     f"their sum, [{x:g}, {y:g}] m/s2")  # fmt: skip
    stiff = [b for b in scene.bodies.values() if isinstance(b, schema.MasslessSettings)]
    plain = not any(isinstance(b, ELASTIC) for b in scene.bodies.values())
    given = weights or any(isinstance(body, schema.RigidSettings) for body in stiff)
    if plain and given and not any(getattr(body, "mass", 0.0) for body in stiff):
        found.append("bodies: none has a mass, so that gravity and inertia do nothing")
    for name, joint in scene.joints_of(schema.LubricatedSettings):
        found += _turbulent(scene, name, joint)
    return found


def _turbulent(scene: Scene, name: str, joint: schema.LubricatedSettings) -> list[str]:
    """A line where a film's Reynolds number, by speeds as written, is not that of laminar flow."""
    oil, radius = scene.lubricants.get(joint.lubricant), joint.radius
    if not radius and (elastic := scene.elastic_bore(joint)):
        radius = float(scene.bodies[elastic[0]].geometry.get("bore_radius", 0.0))
    journal, bore = (scene.speed_of(at.partition(".")[0]) for at in (joint.journal, joint.bore))
    flow = (oil.density if oil else DENSITY) * abs(journal - bore) * radius * joint.clearance
    number = flow / joint_lubricant(scene, joint).viscosity
    if number <= LAMINAR:
        return []
    return [
        f"joints.{name}: its film has a Reynolds number of {number:.4g}, and is laminar, as the "
        f"equations take it, up to {LAMINAR:g}: see speed, clearance and viscosity"
    ]


def check_time(scene: Scene) -> None:
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
