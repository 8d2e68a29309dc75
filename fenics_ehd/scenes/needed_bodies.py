"""Reduced bodies that a scene needs, with checksums of everything that a body depends on.

Bodies with equal checksums are equal, so that a body reduced for one scene is used by others.
"""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fenics_ehd import __version__
from fenics_ehd.multibody.history import FIELDS_NAME
from fenics_ehd.reduction.body import FORMAT_VERSION
from fenics_ehd.reduction.pressure_family import edges_text
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.part import model_file, reduction_provenance, structure_provenance
from fenics_ehd.scenes.scene import Scene, meshed


@dataclass(frozen=True)
class NeededBody:
    """A body of a scene that must be meshed and reduced.

    Attributes
    ----------
    key
        Table of the scene with the settings of the body, ``"bodies.rod"``.
    settings
        Settings of the body.
    film_element, film_edges
        Element of the pressures in its bores, see `Scene.film_element`, and edges of the films
        there, see `Scene.film_edges`.
    part
        Checksum of everything that the assembled structure depends on.
    name
        Checksum of everything that the reduced body depends on; name of the body's file.
    """

    key: str
    settings: schema.FlexibleSettings
    film_element: str
    film_edges: Mapping[str, tuple[float, ...]]
    part: str
    name: str


def needed_bodies(scene: Scene) -> dict[str, NeededBody]:
    """Bodies that a scene must mesh and reduce, by name; bodies read from files are omitted.

    Raises
    ------
    SettingsError, MeshError
        The file of a model does not exist or is not a model.
    """
    return {name: _needed_body(scene, name) for name in meshed(scene)}


def _needed_body(scene: Scene, name: str) -> NeededBody:
    """Settings and checksums of one body that has a model."""
    settings: schema.FlexibleSettings = scene.bodies[name]
    key = f"bodies.{name}"
    element = scene.film_element(name)
    edges = scene.film_edges(name)
    part = checksum(
        structure_provenance(settings, model_file(settings, key), element)
        | {
            "version": f"{__version__} {FORMAT_VERSION}",
            "solver": settings.reduction.solver,
            "film_edges": edges_text(edges),
        }
    )
    reduction = reduction_provenance(settings.reduction)
    if "snapshots" in reduction:
        # The body depends on the pressures of the former run, not on the path of its folder.
        folder = settings.reduction.snapshots
        reduction["snapshots"] = content_of(folder) or folder
    reduction |= {"part": part, "estimate_error": str(settings.reduction.estimate_error)}
    return NeededBody(key, settings, element, edges, part, checksum(reduction))


def checksum(values: Mapping[str, str]) -> str:
    """First 16 hexadecimal digits of the SHA-256 checksum of texts by name."""
    return hashlib.sha256(json.dumps(dict(values), sort_keys=True).encode()).hexdigest()[:16]


def content_of(name: str) -> str | None:
    """Name and checksum of a file, or of the history in a folder; None if there is no file."""
    path = Path(name, FIELDS_NAME) if Path(name).is_dir() else Path(name)
    if not path.is_file():
        return None
    state = path.stat()
    return f"{Path(name).name} {_file_checksum(path, state.st_mtime_ns, state.st_size)}"


@functools.cache
def _file_checksum(path: Path, _changed: int, _size: int) -> str:
    """First 12 digits of a file's checksum; cached, because many cases refer to the same file."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:12]
