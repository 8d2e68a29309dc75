"""Numbers of cells among the parameters of a part's model."""

from __future__ import annotations

from math import ceil

import attrs

from fenics_ehd.scenes import schema
from fenics_ehd.scenes.part import model_file

#: The models' cells around a bore are a multiple of this.
AROUND = 10

#: Of a factor, that makes no cell more.
ROUNDING = 1e-9


def with_counts(settings: schema.FlexibleSettings, key: str) -> schema.FlexibleSettings:
    """The settings of a part, numbers of cells that are its model's own written out; serial."""
    from fenics_ehd.fem.gmsh_session import model_parameters  # Gmsh

    path = model_file(settings, key)
    own = model_parameters(path) if path.suffix == ".geo" else {}
    whole = counts(attrs.evolve(settings, geometry=own))
    return attrs.evolve(settings, geometry={k: own[k] for k in whole} | settings.geometry)


def counts(settings: schema.FlexibleSettings) -> tuple[str, ...]:
    """Parameters of a part's model that are numbers of its cells."""
    return tuple(key for key in settings.geometry if "cells" in key or "layers" in key)


def part_cells(settings: schema.FlexibleSettings, factor: float) -> dict[str, float]:
    """Parameters of a part's model with so many times its cells."""
    geometry = dict(settings.geometry)
    for key in counts(settings):
        step = AROUND if "around" in key else 1
        geometry[key] = step * ceil(int(geometry[key]) * factor / step - ROUNDING)
    return geometry
