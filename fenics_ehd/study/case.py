"""One case of a sweep or a study: a scene with values of its own, and the bodies it needs."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fenics_ehd import __version__
from fenics_ehd.base.errors import SettingsError
from fenics_ehd.reduction.body_file import FORMAT_VERSION
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.part import model_file, reduction_provenance, structure_provenance
from fenics_ehd.scenes.scene import Scene, meshed
from fenics_ehd.study.keys import with_values
from fenics_ehd.study.values import as_text


@dataclass(frozen=True)
class NeededBody:
    """A body to be reduced.

    Attributes
    ----------
    key
        Of the scene, ``"bodies.rod"``.
    settings, film_element
        Of the part, and of the film in its bore.
    part, name
        Checksums of all that its assembled structure and the reduced body depend on.
    """

    key: str
    settings: schema.FlexibleSettings
    film_element: str
    part: str
    name: str


@dataclass(frozen=True, eq=False)
class Case:
    """A case.

    Attributes
    ----------
    name
        In its sweep or study.
    scene
        What is run.
    bodies
        Bodies to be reduced, by their names in the scene.
    values
        Of the swept keys.
    """

    name: str
    scene: Scene
    bodies: Mapping[str, NeededBody]
    values: tuple[Any, ...] = ()


def make_case(name: str, scene: Scene, values: Mapping[str, Any]) -> Case:
    """A case of a scene with full keys replaced.

    Raises
    ------
    SettingsError, MeshError
        A value that cannot be used, or there is no such model.
    """
    own = with_values(scene, values)
    if own.output.accuracy:
        raise SettingsError(
            f"output.accuracy = {own.output.accuracy:g}: cases are compared with the settings that "
            "they have: drop it"
        )
    return Case(name, own, needed_bodies(own), tuple(values.values()))


def needed_bodies(scene: Scene) -> dict[str, NeededBody]:
    """Parts to mesh and reduce, by body; those of files are left out."""
    found = {}
    for name in meshed(scene):
        settings: schema.FlexibleSettings = scene.bodies[name]
        key, element = f"bodies.{name}", scene.film_element(name)
        made = structure_provenance(settings, model_file(settings, key), element) | {
            "version": f"{__version__} {FORMAT_VERSION}",
            "solver": settings.reduction.solver,
        }
        part = checksum(made)
        own = reduction_provenance(settings.reduction)
        if "snapshots" in own:
            # The pressures of a former run, not where they are kept.
            own["snapshots"] = described(settings.reduction.snapshots)
        own |= {"part": part, "estimate_error": str(settings.reduction.estimate_error)}
        found[name] = NeededBody(key, settings, element, part, checksum(own))
    return found


def identity(scene: Scene) -> dict[str, str]:
    """Everything that results depend on, as text by dotted key."""
    return {"version": __version__} | {
        key: described(value) for key, value in _flat(scene.tables, "")
    }


def checksum(values: Mapping[str, str]) -> str:
    """Beginning of a checksum of all values."""
    return hashlib.sha256(json.dumps(dict(values), sort_keys=True).encode()).hexdigest()[:16]


def _flat(tables: Mapping[str, Any], path: str) -> Iterator[tuple[str, Any]]:
    for name, value in tables.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{path}{name}.")
        else:
            yield f"{path}{name}", value


def described(value: object) -> str:
    """A value as text; of a file, or the history of a run's folder, name and checksum."""
    if isinstance(value, str):
        path = Path(value, "history.h5") if Path(value).is_dir() else Path(value)
        if path.is_file():
            state = path.stat()
            return f"{Path(value).name} {_file_checksum(path, state.st_mtime_ns, state.st_size)}"
    return as_text(value)


@functools.cache
def _file_checksum(path: Path, _changed: int, _size: int) -> str:
    """Beginning of a file's checksum: many cases name the same file."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:12]
