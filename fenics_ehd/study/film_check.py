"""The finer film mesh that shows how good the reference's own is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fenics_ehd.scenes.film_mesh import DEFAULT_CELLS

#: By how much more cells, in both directions, a mesh counts as finer: a fraction.
LEAST = (6, 5)

#: By how much it is made finer where the one that was meant is not: a fraction.
FINER = (3, 2)


def finer(cells: tuple[int, ...], than: tuple[int, ...]) -> bool:
    """Whether a film mesh is so much finer than another one that it shows its error."""
    more, base = LEAST
    return all(base * a >= more * b for a, b in zip(cells, than, strict=True))


def planned_cells(settings: Any) -> tuple[int, int]:
    """Cells around and along that a scene's film will have, as far as its settings tell."""
    if settings.film.cells:
        around, along = settings.film.cells
        return around, along
    part = settings.housing if settings.scene == "rotor" else settings.rod
    names = ("bore_cells_around", "bore_cells_along")
    if getattr(part, "cells", "hex") != "hex":
        return DEFAULT_CELLS
    around, along = (
        int(part.geometry.get(name, cells))
        for name, cells in zip(names, DEFAULT_CELLS, strict=True)
    )
    return around, along


def film_check(asked: Mapping[str, Any], settings: Any) -> Mapping[str, Any]:
    """Settings of the run that shows the error of the film mesh.

    Parameters
    ----------
    asked
        Settings meant for it, with the cells for a scene of usual ones.
    settings
        Of the scene, whose cells may be as fine as those or finer.
    """
    own = planned_cells(settings)
    if "film.cells" not in asked or finer(asked["film.cells"], own):
        return asked
    more, base = FINER
    return {**asked, "film.cells": tuple(-(-more * cells // base) for cells in own)}
