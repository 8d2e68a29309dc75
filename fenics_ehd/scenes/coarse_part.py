"""Coarser meshes of a scene's parts, which tell what their own are worth."""

from __future__ import annotations

from math import ceil

import attrs
from mpi4py import MPI

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.multibody.part_mesh import COARSER
from fenics_ehd.reduction import ReducedBody, Structure, rigid
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.elastic_part import elastic_part
from fenics_ehd.scenes.part import model_file
from fenics_ehd.scenes.scene import Scene

#: The models' cells around a bore are a multiple of this.
AROUND = 10

#: Of a factor, that makes no cell more.
ROUNDING = 1e-9


def coarser_part(scene: Scene, name: str) -> ReducedBody:
    """A body of half as many cells, rigid, with the flexibility of its bores; serial.

    Raises
    ------
    SettingsError
        Its model has no numbers of cells among its parameters, or too few.
    """
    settings = with_counts(scene.bodies[name], f"bodies.{name}")
    coarse = attrs.evolve(settings, geometry=_halved(name, settings))
    part = elastic_part(coarse, f"bodies.{name}", scene.film_element(name), MPI.COMM_SELF)
    assert isinstance(part.source, Structure)
    return rigid(part.source, estimate_error=True)


def _halved(name: str, settings: schema.FlexibleSettings) -> dict[str, float]:
    """Parameters of the model with half the cells."""
    geometry, found = part_cells(settings, 1.0 / COARSER), counts(settings)
    for key in found:
        if "around" in key and not geometry[key] < settings.geometry[key]:
            raise SettingsError(
                f"bodies.{name}.geometry.{key} = {settings.geometry[key]:g}: no coarser mesh of "
                "the part"
            )
    if not found:
        raise SettingsError(
            f"bodies.{name}: no coarser mesh of the part: its model {settings.model!r} has no "
            "numbers of hexahedra"
        )
    return geometry


def with_counts(settings: schema.FlexibleSettings, key: str) -> schema.FlexibleSettings:
    """The settings of a part, numbers of cells that are its model's own written out; serial."""
    from fenics_ehd.fem.gmsh_session import model_parameters  # Gmsh

    own = model_parameters(model_file(settings, key))
    whole = counts(attrs.evolve(settings, geometry=own))
    return attrs.evolve(settings, geometry={k: own[k] for k in whole} | settings.geometry)


def counts(settings: schema.FlexibleSettings) -> tuple[str, ...]:
    """Parameters of a part's model that are numbers of its cells."""
    if settings.cells != "hex":
        return ()
    return tuple(key for key in settings.geometry if "cells" in key or "layers" in key)


def part_cells(settings: schema.FlexibleSettings, factor: float) -> dict[str, float]:
    """Parameters of a part's model with so many times its cells."""
    geometry = dict(settings.geometry)
    for key in counts(settings):
        step = AROUND if "around" in key else 1
        geometry[key] = step * ceil(int(geometry[key]) * factor / step - ROUNDING)
    return geometry
