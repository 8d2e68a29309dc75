"""Coarser meshes of a scene's parts, which tell what their own are worth."""

from __future__ import annotations

import attrs
from mpi4py import MPI

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.multibody.part_mesh import COARSER
from fenics_ehd.reduction import ReducedBody, Structure, rigid
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.elastic_part import elastic_part
from fenics_ehd.scenes.scene import Scene

#: The models' cells around a bore are a multiple of this.
AROUND = 10


def coarser_part(scene: Scene, name: str) -> ReducedBody:
    """A body of half as many cells, rigid, with the flexibility of its bores; serial.

    Raises
    ------
    SettingsError
        Its model has no numbers of cells among its parameters, or too few.
    """
    settings = scene.bodies[name]
    coarse = attrs.evolve(settings, geometry=_halved(name, settings))
    part = elastic_part(coarse, f"bodies.{name}", scene.film_element(name), MPI.COMM_SELF)
    assert isinstance(part.source, Structure)
    return rigid(part.source, estimate_error=True)


def _halved(name: str, settings: schema.FlexibleSettings) -> dict[str, float]:
    """Parameters of the model with half the cells."""
    geometry = dict(settings.geometry)
    counts = [key for key in geometry if "cells" in key or "layers" in key]
    for key in counts:
        step = AROUND if "around" in key else 1
        half = step * -(-int(geometry[key]) // int(COARSER * step))
        if "around" in key and not half < geometry[key]:
            raise SettingsError(
                f"bodies.{name}.geometry.{key} = {geometry[key]:g}: no coarser mesh of the part"
            )
        geometry[key] = half
    if not counts or settings.cells != "hex":
        raise SettingsError(
            f"bodies.{name}.geometry gives no numbers of cells: no coarser mesh of the part"
        )
    return geometry
