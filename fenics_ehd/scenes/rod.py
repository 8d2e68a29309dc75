"""From the settings of a rod to its reduced body."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from mpi4py import MPI

from fenics_ehd.reduction import ReducedBody, Structure
from fenics_ehd.scenes import part
from fenics_ehd.scenes.part import ReducedPart, model_file, pressure_family, reduce_structure
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings

__all__ = [
    "build_structure",
    "check_origin",
    "origin",
    "reduce_rod",
    "reduce_structure",
    "rod_length",
]

#: Boundary point of the piston.
PIN = "pin"


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


def rod_length(structure: Structure) -> float:
    """Distance of the pin from the bore's axis [m]; collective."""
    # The share of a unit force that a node takes is its weight in the mean position.
    weights = structure.attachments[PIN][0].array.reshape(-1, 3)[:, 0]
    centre = structure.comm.allreduce(weights @ structure.coordinates)
    return float(np.hypot(*centre[:2]))


def reduce_rod(
    settings: SliderCrankSettings,
    comm: MPI.Comm = MPI.COMM_WORLD,
    check: Callable[[Structure], None] | None = None,
) -> ReducedPart:
    """Mesh, assemble and reduce the rod.

    Parameters
    ----------
    settings
        The scene.
    comm
        Ranks that share the work.
    check
        Called with the structure before its reduction, on every rank, to refuse it.

    Raises
    ------
    MeshError, SettingsError, SolverError
        From the mesh, the settings and the solvers.
    """
    return part.reduce_part(
        lambda: build_structure(settings, comm),
        lambda structure: reduce_structure(structure, settings.reduction),
        origin(settings),
        check,
    )


def origin(settings: SliderCrankSettings) -> dict[str, str]:
    """What a body depends on, see `part.origin`."""
    rod = settings.rod
    values = part.origin(rod, model_file(rod, "rod"), settings.film.element, settings.reduction)
    return {**values, "cells": rod.cells}


def check_origin(body: ReducedBody, settings: SliderCrankSettings, tables: Mapping) -> None:
    """See `part.check_origin`."""
    part.check_origin(body, origin(settings), tables, "rod")
