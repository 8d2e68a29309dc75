"""An elastic part of a scene, meshed or read, then reduced."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import attrs
import numpy as np
from mpi4py import MPI

from fenics_ehd.film.layout import film_grid
from fenics_ehd.reduction import ReducedBody, Structure, load_body
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.fields import NONE
from fenics_ehd.scenes.part import (
    ReducedPart,
    model_file,
    origin,
    pressure_family,
    reduce_part,
    reduce_structure,
)
from fenics_ehd.scenes.scene import BORE


@dataclass(frozen=True, eq=False)
class ElasticPart:
    """An elastic part before its reduction.

    Attributes
    ----------
    settings
        Of the body.
    source
        The assembled structure, or the reduced body of a file.
    film_element
        Of the film in its bore.
    """

    settings: schema.Flexible
    source: Structure | ReducedBody
    film_element: str

    @property
    def radius(self) -> float:
        """Of the bore [m]."""
        if isinstance(self.source, ReducedBody):
            return self.source.bore_radius
        return self.source.lubricated_bore.radius

    @property
    def width(self) -> float:
        """Of the bore [m]."""
        if isinstance(self.source, ReducedBody):
            return self.source.bore_width
        return self.source.lubricated_bore.width

    def check_cells(self) -> None:
        """Refuse a bore that offers no cells to a film without cells of its own.

        Raises
        ------
        InterfaceMismatchError
            See `film_grid`.
        """
        if isinstance(self.source, ReducedBody):
            nodes, family = self.source.pressure_nodes, self.source.pressure_family
        else:
            bore = self.source.lubricated_bore
            nodes, family = bore.pressure_coordinates, bore.pressure_family or ""
        if family != "triangle":
            film_grid(nodes)

    @property
    def held(self) -> bool:
        """Whether it does not move as a whole."""
        if isinstance(self.source, ReducedBody):
            return self.source.frame == "clamped"
        return self.settings.held_by != NONE

    def points(self) -> Mapping[str, tuple[float, float]]:
        """Points by name, from the bore's centre [m]; collective."""
        if isinstance(self.source, ReducedBody):
            found = {name: field[:2, 0] for name, field in self.source.points.items()}
        else:
            found = {name: _mean_place(self.source, name) for name in self.source.attachments}
        return {BORE: (0.0, 0.0)} | {name: (float(x), float(y)) for name, (x, y) in found.items()}

    def reduce(self, method: str | None) -> ReducedPart | ReducedBody:
        """The reduced part, that of a file as it is; collective.

        Parameters
        ----------
        method
            In place of the scene's; None: that.
        """
        source, settings = self.source, self.settings
        if isinstance(source, ReducedBody):
            return source
        reduction = settings.reduction
        if method is not None:
            reduction = attrs.evolve(reduction, method=method)
        made = origin(settings, model_file(settings, "body"), self.film_element, reduction)
        return reduce_part(
            lambda: source,
            lambda structure: reduce_structure(structure, reduction),
            {**made, "cells": settings.cells},
        )


def _mean_place(structure: Structure, name: str) -> np.ndarray:
    """Mean position of a boundary point, shape (2,) [m]; collective."""
    # The share of a unit force that a node takes is its weight in the mean position.
    weights = structure.attachments[name][0].array.reshape(-1, 3)[:, 0]
    return structure.comm.allreduce(weights @ structure.coordinates)[:2]


def elastic_part(
    settings: schema.Flexible, key: str, film_element: str, comm: MPI.Comm
) -> ElasticPart:
    """Mesh and assemble a part, or read its reduced body; collective.

    Raises
    ------
    SettingsError, MeshError, BodyFileError
        Naming what is wrong with its model or file.
    """
    if settings.body != NONE:
        return ElasticPart(settings, load_body(settings.body), film_element)
    return ElasticPart(settings, _assembled(key, settings, film_element, comm), film_element)


def _assembled(key: str, settings: schema.Flexible, film_element: str, comm: MPI.Comm) -> Structure:
    # Gmsh and dolfinx are for scenes that mesh a part.
    from fenics_ehd.geometry import build_mesh
    from fenics_ehd.structure import Material, assemble_structure

    mesh = build_mesh(
        model_file(settings, key),
        settings.geometry,
        comm=comm,
        serendipity_geometry=settings.element == "serendipity",
        cells=settings.cells,
    )
    material = settings.material
    return assemble_structure(
        mesh,
        Material(material.youngs_modulus, material.poissons_ratio, material.density),
        family=settings.element,
        pressure_family=pressure_family(film_element),
        attachments=settings.points,
        clamped=None if settings.held_by == NONE else settings.held_by,
    )
