"""Film mesh of a scene with an elastic part."""

from __future__ import annotations

from dataclasses import replace

from fenics_ehd.film import FilmGrid, uniform_grid
from fenics_ehd.film.layout import film_grid
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.scenes.part_settings import Film

#: Film cells around and along a bore that is no structured mesh.
DEFAULT_CELLS = (20, 5)


def film_mesh(settings: Film, body: ReducedBody) -> FilmGrid:
    """The bore's own cells, or those the scene asks for.

    A bore of triangles has no such cells and gets `DEFAULT_CELLS`.

    Raises
    ------
    InterfaceMismatchError
        The bore's cells are wanted and are not a structured quadratic mesh.
    """
    if not settings.cells and body.pressure_family != "triangle":
        grid = film_grid(body.pressure_nodes)
        return replace(grid, family="bilinear") if settings.element == "bilinear" else grid
    around, along = settings.cells or DEFAULT_CELLS
    return uniform_grid(body.bore_radius, body.bore_width, (around, along), settings.element)
