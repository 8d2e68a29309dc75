"""From the settings of a rod to its reduced body."""

from __future__ import annotations

from collections.abc import Mapping

from mpi4py import MPI

from fenics_ehd.reduction import ReducedBody, Structure
from fenics_ehd.scenes import part
from fenics_ehd.scenes.part import ReducedPart, model_file, pressure_family, reduce_structure
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings

__all__ = ["build_structure", "check_origin", "origin", "reduce_rod", "reduce_structure"]


def build_structure(settings: SliderCrankSettings, comm: MPI.Comm) -> Structure:
    """Mesh the rod and assemble its matrices, on every rank of `comm`."""
    from fenics_ehd.geometry import build_mesh
    from fenics_ehd.structure import Material, assemble_structure

    rod = settings.rod
    mesh = build_mesh(
        model_file(rod, "rod"),
        rod.geometry,
        comm=comm,
        serendipity_geometry=rod.element == "serendipity",
        cells=rod.cells,
    )
    material = Material(rod.youngs_modulus, rod.poissons_ratio, rod.density)
    return assemble_structure(
        mesh,
        material,
        family=rod.element,
        pressure_family=pressure_family(settings.film.element),
    )


def reduce_rod(settings: SliderCrankSettings, comm: MPI.Comm = MPI.COMM_WORLD) -> ReducedPart:
    """Mesh, assemble and reduce the rod.

    Raises
    ------
    MeshError, SettingsError, SolverError
        From the mesh, the settings and the solvers.
    """
    return part.reduce_part(
        lambda: build_structure(settings, comm),
        lambda structure: reduce_structure(structure, settings.reduction),
        origin(settings),
    )


def origin(settings: SliderCrankSettings) -> dict[str, str]:
    """What a body depends on, see `part.origin`."""
    rod = settings.rod
    values = part.origin(rod, model_file(rod, "rod"), settings.film.element, settings.reduction)
    return {**values, "cells": rod.cells}


def check_origin(body: ReducedBody, settings: SliderCrankSettings, tables: Mapping) -> None:
    """See `part.check_origin`."""
    part.check_origin(body, origin(settings), tables, "rod")
