"""Reduced bodies that a scene needs, with checksums of everything that a body depends on.

Bodies with equal checksums are equal, so that a body reduced for one scene is used by others.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fenics_ehd import __version__
from fenics_ehd.reduction.body import FORMAT_VERSION
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.kept_bodies import checksum
from fenics_ehd.scenes.part import model_file, part_texts, reduction_texts
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
    texts = part_texts(settings, model_file(settings, key), element, edges)
    part = checksum(texts | {"version": f"{__version__} {FORMAT_VERSION}"})
    body = checksum(reduction_texts(settings.reduction) | {"part": part})
    return NeededBody(key, settings, element, edges, part, body)
