"""A scene in words: bodies, joints, oils, drives, forces and time span, one sentence each.

A sentence has the kind of the entry and every setting that differs from its default, with unit.
Flexible bodies also have mass, moment of inertia, sizes and mesh of the part, with its reduction.
Lubricated joints have the sizes that they take from a flexible bore, and the mesh of the film.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from math import pi
from types import MappingProxyType
from typing import Any, NamedTuple

import attrs

from fenics_ehd.base.needs import NONE
from fenics_ehd.base.settings import declared
from fenics_ehd.base.units import RPM, unit_of
from fenics_ehd.multibody.history import History
from fenics_ehd.multibody.joints import Speed
from fenics_ehd.multibody.shaft import Shaft
from fenics_ehd.plotting.shown import film_grid
from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.scenes.scene import GROUND, Scene
from fenics_ehd.scenes.schema import FlexibleSettings, LubricatedSettings

#: Larger and smaller units of settings in SI units: limit from which a unit is used, factor, name.
SCALES: Mapping[str, tuple[tuple[float, float, str], ...]] = {
    "m": ((0.1, 1.0, "m"), (1e-3, 1e3, "mm"), (0.0, 1e6, "µm")),
    "Pa": ((1e9, 1e-9, "GPa"), (1e5, 1e-6, "MPa"), (0.0, 1.0, "Pa")),
}

#: Settings that are not written: points, the state at the start, and a limit of the solver.
SKIPPED = ("points", "position", "velocity", "eccentricity", "eccentricity_rate", "smallest_film")

#: Words for settings whose name does not explain them.
NAMES = {
    "inertia": "moment of inertia",
    "centre": "centre of mass",
    "friction": "shear stress of the oil acts on the bodies",
}

#: Words for a film element by the name of its family.
ELEMENTS = {"lagrange": "9-node", "serendipity": "8-node", "bilinear": "bilinear"}

#: Words for kinds of entries; the kind of an oil is not written.
KINDS = {"oil": "", "massless": "without mass"}

#: Words for the elements of a part by the settings `cells` and `element`.
CELLS = {
    ("hex", "serendipity"): "20-node hexahedra",
    ("hex", "lagrange"): "27-node hexahedra",
    ("tet", "serendipity"): "10-node tetrahedra",
    ("tet", "lagrange"): "10-node tetrahedra",
}

#: Sentences about entries with few settings, by the kind of the entry; names in braces are
#: settings.
SENTENCES = {
    "revolute": "pin joint without play between {between[0]} and {between[1]}",
    "fixed": "rigid connection between {between[0]} and {between[1]}",
    "slider": "slider without play: {point} moves along a line through {line}",
    "constant": "constant force on {point}",
    "time-table": "force over time on {point}, table {file}",
    "angle-table": "force over the angle of {angle_of} on {point}, table {file}",
    "unbalance": "unbalance at {point}",
    "rotating": "rotating force on {point}",
    "spring-damper": "spring and damper between {between[0]} and {between[1]}",
}

#: Smallest coordinate of a centre of mass that is not round-off [m].
ROUNDING = 1e-9

#: Words for one entry of a table of a scene.
TABLES = {
    "bodies": "body",
    "joints": "joint",
    "lubricants": "oil",
    "drives": "drive",
    "forces": "force",
}


class Entry(NamedTuple):
    """Sentence about one entry of a scene.

    Attributes
    ----------
    kind, name
        Word for the table of the entry, ``"joint"``, and the name of the entry.
    words
        The sentence.
    """

    kind: str
    name: str
    words: str


def setting_text(value: Any, unit: str = "") -> str:
    """Text of a setting with its unit, in the larger or smaller unit of `SCALES` that fits."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    unit = unit.replace("m2", "m²").replace("m3", "m³").replace("s2", "s²")
    if isinstance(value, list | tuple):
        if unit == "m":
            return _position(value)
        parts = ", ".join(setting_text(part) for part in value)
        if not any(isinstance(part, list | tuple) for part in value):
            parts = f"({parts})"
        return f"{parts} [{unit}]" if "," in unit else f"{parts} {unit}".rstrip()
    if not isinstance(value, int | float):
        return str(value)
    factor = 1.0
    for limit, scale, name in SCALES.get(unit, ()):
        if abs(value) >= limit:
            factor = scale
            unit = name
            break
    shown = {"degrees": "°", "C": " °C"}.get(unit, f" {unit}")
    return f"{factor * value:.6g}{shown}".rstrip()


def changed_settings(
    settings: Any, skipped: tuple[str, ...] = (), *, defaults: bool = False
) -> list[str]:
    """Texts of the settings of an entry that differ from their defaults, ``mass 0.5 kg``.

    With `defaults`, the result has the other settings, too.
    """
    texts = []
    for field in declared(type(settings)):
        value = getattr(settings, field.name)
        default = field.default
        if isinstance(default, attrs.Factory):  # type: ignore[arg-type]
            default = default.factory()  # type: ignore[union-attr]
        if field.name in (*SKIPPED, *skipped) or value is None:
            continue
        if value == default and not defaults:
            continue
        name = NAMES.get(field.name, field.name.replace("_", " "))
        if attrs.has(type(value)):
            texts += [f"{name}: {', '.join(changed_settings(value)) or 'as by default'}"]
        elif isinstance(value, Mapping):
            kinds = {kind: word for word, kind in field.metadata.get("kinds", {}).items()}
            for key, entry in value.items():
                if attrs.has(type(entry)):
                    words = [kinds.get(type(entry), ""), *changed_settings(entry)]
                    texts.append(f"{name} {key}: {', '.join(filter(None, words))}")
        elif isinstance(value, bool):
            texts.append(name if value else f"{name}: no")
        else:
            unit = unit_of(field.metadata.get("help", ""))
            texts.append(f"{name} {setting_text(value, unit if unit != '-' else '')}")
    return texts


def scene_entries(
    scene: Scene, history: History, parts: Mapping[str, ReducedBody] = MappingProxyType({})
) -> Iterator[Entry]:
    """Yield a sentence for every entry of a scene.

    Parameters
    ----------
    scene, history
        Scene, and history of its run.
    parts
        Reduced flexible bodies of the run by name; the sentences of others lack mass and mesh.
    """
    for table, word in TABLES.items():
        for name, settings in getattr(scene, table).items():
            if table == "bodies" and name == GROUND:
                continue
            kind = str(scene.tables.get(table, {}).get(name, {}).get("kind", ""))
            if isinstance(settings, FlexibleSettings):
                words = _flexible(settings, parts.get(name))
            elif isinstance(settings, LubricatedSettings):
                words = _lubricated(name, settings, history)
            elif isinstance(settings, Speed):
                words = _speed(settings)
            else:
                words = _other(kind, settings)
            if table == "bodies":
                words = [re.sub("^angle ", "angle at the start ", text) for text in words]
                words += _points(settings)
            yield Entry(word, name, ", ".join(filter(None, words)))
    yield Entry("time", "", _time(scene))


def _other(kind: str, settings: Any) -> list[str]:
    """Words about an entry without a sentence of its own: its kind, and changed settings."""
    if kind not in SENTENCES:
        if isinstance(settings, Shaft):
            return ["elastic shaft", *_shaft(settings)]
        words = changed_settings(settings, defaults=kind == "gravity")
        return [KINDS.get(kind, kind), *words]
    sentence = SENTENCES[kind].format_map(vars_of(settings))
    named = tuple(re.findall(r"{(\w+)", SENTENCES[kind]))
    return [sentence, *changed_settings(settings, named)]


def _shaft(shaft: Shaft) -> list[str]:
    """Words about a shaft of beams: sizes, material and mass, also those of defaults."""
    written = ("length", "diameter", "youngs_modulus", "density", "support_stiffness")
    return [
        f"length {setting_text(shaft.length, 'm')}",
        f"diameter {setting_text(shaft.diameter, 'm')}",
        f"Young's modulus {setting_text(shaft.youngs_modulus, 'Pa')}",
        f"density {setting_text(shaft.density, 'kg/m3')}",
        f"mass {shaft.mass:.4g} kg without disks",
        f"spring of {setting_text(shaft.support_stiffness, 'N/m')} at either end"
        if shaft.support_stiffness
        else "carried by its bearings alone",
        *changed_settings(shaft, written),
    ]


def vars_of(settings: Any) -> dict[str, Any]:
    """Values of the settings of an entry, by name."""
    return {field.name: getattr(settings, field.name) for field in declared(type(settings))}


def _speed(drive: Speed) -> list[str]:
    """Words about a drive with a given speed."""
    if drive.table != NONE:
        return [f"speed over time, table {drive.table}", *changed_settings(drive, ("table",))]
    turns = f"{drive.speed * RPM:.5g} 1/min"
    return [f"speed {drive.speed:.6g} rad/s ({turns})", *changed_settings(drive, ("speed",))]


def _points(body: Any) -> list[str]:
    """Words with the positions of the points of a body."""
    points = getattr(body, "points", {})
    if not isinstance(points, Mapping):
        return []
    return [
        f"point {name} at {position:g} of the length"
        if isinstance(position, int | float)
        else f"point {name} at {_position(position)}"
        for name, position in points.items()
    ]


def _position(position: Sequence[float]) -> str:
    """Text of a position in the frame of a body, in mm."""
    return f"({', '.join(f'{1e3 * x + 0.0:.4g}' for x in position)}) mm"


def _flexible(body: FlexibleSettings, part: ReducedBody | None) -> list[str]:
    """Words about a flexible body: source, sizes, mass, material, mesh, and reduction."""
    if body.model == NONE:
        words = [f"elastic part from the file {body.body}"]
    else:
        sizes = (
            f"{name.replace('_', ' ')} {setting_text(value, 'm')}"
            for name, value in body.geometry.items()
            if name not in body.cell_counts
        )
        material = body.material
        words = [
            f"elastic part of the model {body.model}",
            *sizes,
            f"Young's modulus {setting_text(material.youngs_modulus, 'Pa')}",
            f"Poisson's ratio {material.poissons_ratio:g}",
            f"density {setting_text(material.density, 'kg/m3')}",
        ]
    words += changed_settings(body, WRITTEN)
    if part is not None and body.clamped == NONE:
        words += _mass(body, part)
    elif body.clamped != NONE:
        words.append(f"held at {body.clamped}")
    if body.model != NONE:
        counts = (f"{name.replace('_', ' ')} {body.geometry[name]:g}" for name in body.cell_counts)
        words.append(f"mesh of {CELLS[body.cells, body.element]}: {', '.join(counts)}".rstrip(": "))
    if part is not None:
        unknowns = part.provenance.get("degrees_of_freedom")
        reduced = f"reduced by {part.method.upper()} to {part.modes} modes"
        words.append(f"{unknowns} unknowns, {reduced}" if unknowns else reduced)
    return words


#: Settings of a flexible body that `_flexible` writes in its own words.
WRITTEN = ("model", "body", "bores", "clamped", "cells", "element", "mass", "inertia", "centre",
           "material", "geometry", "reduction")  # fmt: skip


def _mass(body: FlexibleSettings, part: ReducedBody) -> list[str]:
    """Words about mass, moment of inertia and centre of mass of a flexible body.

    Settings of the scene that are not zero replace those of the meshed part.
    """
    inertia = part.inertia
    centre = body.centre if any(body.centre) else inertia.centre_of_mass
    return [
        f"mass {body.mass or inertia.total_mass:.4g} kg",
        f"moment of inertia {body.inertia or inertia.polar_inertia:.4g} kg m² about the centre of "
        f"mass at {_position([float(x) if abs(x) > ROUNDING else 0.0 for x in centre])}",
    ]


def _lubricated(name: str, joint: LubricatedSettings, history: History) -> list[str]:
    """Words about a lubricated joint: sides, sizes, oil, film mesh, and settings of its models."""
    words = [f"oil film between journal {joint.journal} and bore {joint.bore}"]
    clearance = f"radial clearance {setting_text(joint.clearance, 'm')}"
    mesh = ""
    if name in history.joints:
        film = history.joints[name].film
        grid = film_grid(film)
        radius = float(film.radius)
        words.append(f"bore diameter {2e3 * radius:.6g} mm, width {1e3 * grid.width:.6g} mm")
        clearance += f" ({1e3 * joint.clearance / radius:.3g} ‰ of the radius)"
        around, along = grid.cells
        mesh = f"film mesh {around} × {along} ({ELEMENTS.get(joint.element, joint.element)})"
    oil = f"lubricant {joint.lubricant}"
    if joint.lubricant == NONE:
        oil = f"viscosity {setting_text(joint.viscosity, 'Pa s')}"
    skipped = ("journal", "bore", "clearance", "lubricant", "viscosity", "radius", "width", "cells",
               "element")  # fmt: skip
    return [*words, clearance, oil, mesh, *changed_settings(joint, skipped)]


def _time(scene: Scene) -> str:
    """Sentence about the simulated time and the control of the steps."""
    time = scene.time
    speed = abs(scene.speed_of(time.of))
    turns = time.revolutions or scene.span * speed / (2 * pi)
    span = f"{1e3 * scene.span:.6g} ms"
    if turns:
        span += f", {turns:.6g} revolution{'s' * (turns != 1)} of {time.of}"
    if time.periodic:
        span = f"cycles of {span}, until the films repeat within {time.periodicity:g}"
    return (
        f"{span}; backward differentiation of order {time.order} at most, local error of a step at "
        f"most {time.tolerance:g} of the gap"
    )
