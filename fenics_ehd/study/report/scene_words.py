"""A scene in words: bodies, joints, oils, drives, forces and time span, one sentence each.

A sentence has the kind of the entry and every setting that differs from its default, with unit.
Flexible bodies and lubricated joints also have results of the run: method and number of modes, film
mesh, and sizes that a joint takes from its flexible bore.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import pi
from typing import Any, NamedTuple

import attrs

from fenics_ehd.base.needs import NONE
from fenics_ehd.base.settings import declared
from fenics_ehd.base.units import RPM, unit_of
from fenics_ehd.multibody.history import History
from fenics_ehd.multibody.joints import Speed
from fenics_ehd.plotting.shown import film_grid
from fenics_ehd.scenes.scene import GROUND, Scene
from fenics_ehd.scenes.schema import FlexibleSettings, LubricatedSettings

#: Larger and smaller units of settings in SI units: limit from which a unit is used, factor, name.
SCALES: Mapping[str, tuple[tuple[float, float, str], ...]] = {
    "m": ((0.1, 1.0, "m"), (1e-3, 1e3, "mm"), (0.0, 1e6, "µm")),
    "Pa": ((1e9, 1e-9, "GPa"), (1e5, 1e-6, "MPa"), (0.0, 1.0, "Pa")),
}

#: Settings that are not written: points, the state at the start, and a limit of the solver.
SKIPPED = ("points", "position", "velocity", "eccentricity", "eccentricity_rate", "smallest_film")

#: Words for a film element by the name of its family.
ELEMENTS = {"lagrange": "9-node", "serendipity": "8-node", "bilinear": "bilinear"}


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
    if isinstance(value, list | tuple):
        parts = ", ".join(setting_text(part) for part in value)
        return f"({parts}) [{unit}]" if "," in unit else f"({parts}) {unit}".rstrip()
    if not isinstance(value, int | float):
        return str(value)
    factor = 1.0
    for limit, scale, name in SCALES.get(unit, ()):
        if abs(value) >= limit:
            factor = scale
            unit = name
            break
    return f"{factor * value:.6g} {unit.replace('m2', 'm²').replace('m3', 'm³')}".rstrip()


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
        name = field.name.replace("_", " ")
        if attrs.has(type(value)):
            texts += [f"{name}: {', '.join(changed_settings(value)) or 'as by default'}"]
        elif isinstance(value, Mapping):
            texts += [
                f"{name} {key}: {', '.join(changed_settings(entry)) or 'as by default'}"
                for key, entry in value.items()
                if attrs.has(type(entry))
            ]
        else:
            unit = unit_of(field.metadata.get("help", ""))
            texts.append(f"{name} {setting_text(value, unit if unit != '-' else '')}")
    return texts


def scene_entries(scene: Scene, history: History) -> Iterator[Entry]:
    """Yield a sentence for every entry of a scene, from its settings and the history of its run."""
    for table, word in TABLES.items():
        for name, settings in getattr(scene, table).items():
            kind = str(scene.tables.get(table, {}).get(name, {}).get("kind", ""))
            if table == "bodies" and name == GROUND:
                continue
            if isinstance(settings, FlexibleSettings):
                words = _flexible(settings, history.summary().get("bodies", {}).get(name, {}))
            elif isinstance(settings, LubricatedSettings):
                words = _lubricated(name, settings, history)
            elif isinstance(settings, Speed) and settings.speed:
                words = [
                    f"speed {settings.speed:.6g} rad/s ({settings.speed * RPM:.5g} rpm)",
                    *changed_settings(settings, ("speed",)),
                ]
            else:
                texts = changed_settings(settings)
                if table == "forces":
                    texts = texts or changed_settings(settings, defaults=True)
                words = [kind.replace("-", " "), *texts]
            yield Entry(word, name, ", ".join(filter(None, words)))
    yield Entry("time", "", _time(scene))


def _flexible(body: FlexibleSettings, reduced: Mapping[str, Any]) -> list[str]:
    """Words about a flexible body: source, material, and its reduction in the run."""
    words = [f"elastic part of {body.model}"]
    if body.model == NONE:
        words = [f"elastic part from the file {body.body}"]
    else:
        words.append(
            f"Young's modulus {setting_text(body.material.youngs_modulus, 'Pa')}, density "
            f"{body.material.density:g} kg/m3"
        )
        counts = (f"{name.replace('_', ' ')} {body.geometry[name]:g}" for name in body.cell_counts)
        if mesh := ", ".join(counts):
            words.append(f"mesh: {mesh}")
    if "method" in reduced:
        words.append(f"reduced by {reduced['method'].upper()} to {reduced['modes']} modes")
    if body.damping_time:
        words.append(f"damping time {body.damping_time:g} s")
    return words


def _lubricated(name: str, joint: LubricatedSettings, history: History) -> list[str]:
    """Words about a lubricated joint: sides, sizes, oil, film mesh, and settings of its models."""
    words = [f"oil film between journal {joint.journal} and bore {joint.bore}"]
    if name in history.joints:
        film = history.joints[name].film
        grid = film_grid(film)
        words.append(
            f"bore diameter {2e3 * float(film.radius):.6g} mm, width {1e3 * grid.width:.6g} mm"
        )
    words.append(f"radial clearance {setting_text(joint.clearance, 'm')}")
    if name in history.joints:
        around, along = grid.cells
        words.append(f"film mesh {around} × {along} ({ELEMENTS.get(joint.element, joint.element)})")
    words.append(
        f"viscosity {joint.viscosity:g} Pa s" if joint.lubricant == NONE else f"{joint.lubricant}"
    )
    skipped = ("journal", "bore", "clearance", "lubricant", "viscosity", "radius", "width", "cells",
               "element")  # fmt: skip
    return [*words, *changed_settings(joint, skipped)]


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
    return f"{span}; step tolerance {time.tolerance:g}, formulas of order up to {time.order}"
