"""A scene on several film meshes, over which dynamic coefficients are averaged."""

from __future__ import annotations

from fenics_ehd.analysis.film_meshes import extra_cells
from fenics_ehd.scenes.films import planned_cells
from fenics_ehd.scenes.scene import Scene, changed


def scenes_on_meshes(scene: Scene, meshes: int) -> list[Scene]:
    """A scene, followed by copies of it with more film cells around its rigid bores.

    Films in elastic bores keep their meshes.

    Parameters
    ----------
    scene
        The scene.
    meshes
        Number of scenes; they have 0, 2, 4 and 6 more cells around, see
        `fenics_ehd.analysis.film_meshes`.
    """
    rigid = [name for name, joint in scene.films.items() if not scene.elastic_surfaces(joint)]
    scenes = [scene]
    for extra in extra_cells(meshes)[1:] if rigid else ():
        cells = {name: planned_cells(scene, name) for name in rigid}
        finer = {
            f"joints.{name}.cells": [around + extra, along]
            for name, (around, along) in cells.items()
        }
        scenes.append(changed(scene, finer))
    return scenes
