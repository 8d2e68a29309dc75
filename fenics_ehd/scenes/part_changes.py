"""Scenes with another reduction of their parts: a body from a file, or another method.

A body from a file must have been made with the settings of the scene file.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.needs import NONE
from fenics_ehd.base.settings import keys_excluded_by
from fenics_ehd.reduction.body import ReducedBody, load_body
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.part import model_file, reduction_provenance, structure_provenance
from fenics_ehd.scenes.scene import Scene, changed, flexible, meshed, renamed

#: Present names of entries of a body's provenance, by the former name of version 0.2.
FORMER_PROVENANCE = {"held_by": "clamped"}


def require_provenance(
    body: ReducedBody, asked: Mapping[str, str], written: set[str], section: str
) -> None:
    """Refuse a body from a file if its settings differ from those in a scene file.

    A body whose provenance names no model is accepted without a comparison. A body of version 0.3
    is accepted for any tolerance of M4: its flexibility was computed from all nodal pressures.

    Parameters
    ----------
    body
        Body read from a file.
    asked
        Provenance that a body has if it is made with the settings of the scene.
    written
        Names of the settings that the scene file contains; other settings are not compared.
    section
        Section of the part, for messages.

    Raises
    ------
    SettingsError
        A value in the scene file differs from that of the body; the message has both.
    """
    made = dict(body.provenance)
    if "model" not in made:
        return
    for former, name in FORMER_PROVENANCE.items():
        if former in made:
            made[name] = made.pop(former)
    if made.pop("residual_truncation", ""):
        written = written - {"flexibility_tolerance"}
    if "geometry" in written:
        written = written | {name for name in {*asked, *made} if name.startswith("geometry.")}
    for name in sorted(written & {*asked, *made}):
        if asked.get(name) != made.get(name):
            raise SettingsError(
                f"the body was made with {name} = {made.get(name, 'default')}, but {section} has "
                f"{asked.get(name, 'default')}: reduce the part again or drop the key"
            )


def with_body(scene: Scene, file: str, written: Mapping[str, Any]) -> Scene:
    """Scene with the reduced body in a file in place of its flexible body.

    Parameters
    ----------
    scene
        Scene with one flexible body.
    file
        File written by ``fenics-ehd reduce``.
    written
        Tables of the scene file, without default values; the body must have been made with these
        values.

    Raises
    ------
    SettingsError
        The scene has several flexible bodies or none, or the body was made with other values.
    BodyFileError
        The file cannot be read.
    """
    names = flexible(scene)
    if len(names) != 1:
        raise SettingsError(
            f"--body {file}: scene {scene.name} has {len(names)} flexible bodies, but must have "
            "one: give body = FILE in [bodies.NAME]"
        )
    (name,) = names
    settings = scene.bodies[name]
    if settings.model != NONE:
        model = model_file(settings, f"bodies.{name}")
        element = scene.film_element(name)
        asked = structure_provenance(settings, model, element)
        asked |= reduction_provenance(settings.reduction)
        table = renamed(written)[0].get("bodies", {}).get(name, {})
        require_provenance(
            load_body(file),
            asked,
            {*table, *table.get("material", {}), *table.get("reduction", {})},
            f"bodies.{name}",
        )
    entry = {
        k: v
        for k, v in scene.tables["bodies"][name].items()
        if k not in (*keys_excluded_by(schema.FlexibleSettings, "body"), "model")
    }
    return changed(scene, {f"bodies.{name}": {**entry, "body": str(file)}})


def with_method(scene: Scene, method: str) -> Scene:
    """Scene with another reduction method for every part that has a model.

    Raises
    ------
    SettingsError
        The scene has no part with a model.
    """
    names = meshed(scene)
    if not names:
        raise SettingsError(f"--method {method}: scene {scene.name} has no part with a model")
    return changed(scene, {f"bodies.{name}.reduction.method": method for name in names})
