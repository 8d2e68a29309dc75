"""What is said in place of a scene: other values, a body of a file, a method."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.reduction import load_body
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.fields import NONE
from fenics_ehd.scenes.part import (
    model_file,
    reduction_provenance,
    require_provenance,
    structure_provenance,
)
from fenics_ehd.scenes.scene import Scene, meshed
from fenics_ehd.scenes.scene_checks import MODEL_KEYS
from fenics_ehd.scenes.scene_file import beside, scene_of


def changed(scene: Scene, values: Mapping[str, Any]) -> Scene:
    """A scene with values replaced, by their full keys, ``time.end`` or ``bodies.rod.mass``.

    Files are relative to the working directory.

    Raises
    ------
    SettingsError
        Naming the key that cannot be used.
    """
    tables = deepcopy(dict(scene.tables))
    for key, value in values.items():
        *path, last = key.split(".")
        table = tables
        for name in path:
            table = table.setdefault(name, {})
        table[last] = deepcopy(value)  # of the caller's tables nothing is changed below
    return scene_of(beside(tables, Path()), scene.name)


def with_body(scene: Scene, file: str, written: Mapping[str, Any]) -> Scene:
    """The scene with the reduced body of a file.

    Parameters
    ----------
    scene
        With one flexible body.
    file
        Made by ``fenics-ehd reduce``.
    written
        Tables as the user wrote them: what they say of the body must be so.

    Raises
    ------
    SettingsError
        There are several flexible bodies or none, or the file's was made otherwise than written.
    BodyFileError
        The file cannot be read.
    """
    flexible = [
        name for name, body in scene.bodies.items() if isinstance(body, schema.FlexibleSettings)
    ]
    if len(flexible) != 1:
        raise SettingsError(
            f"--body {file}: scene {scene.name} has {len(flexible)} flexible bodies, not one: "
            "give body = FILE in [bodies.NAME]"
        )
    (name,) = flexible
    settings = scene.bodies[name]
    if settings.model != NONE:
        model, element = model_file(settings, f"bodies.{name}"), scene.film_element(name)
        asked = structure_provenance(settings, model, element)
        asked |= reduction_provenance(settings.reduction)
        own = written.get("bodies", {}).get(name, {})
        require_provenance(
            load_body(file),
            asked,
            {*own, *own.get("material", {}), *own.get("reduction", {})},
            f"bodies.{name}",
        )
    entry = {
        k: v for k, v in scene.tables["bodies"][name].items() if k not in (*MODEL_KEYS, "model")
    }
    return changed(scene, {f"bodies.{name}": {**entry, "body": str(file)}})


def with_method(scene: Scene, method: str) -> Scene:
    """The scene with another reduction method for every part that it meshes.

    Raises
    ------
    SettingsError
        There is none.
    """
    names = meshed(scene)
    if not names:
        raise SettingsError(f"--method {method}: scene {scene.name} has no model to reduce")
    return changed(scene, {f"bodies.{name}.reduction.method": method for name in names})
