"""From the settings of a rod to its reduced body."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_ehd.errors import SettingsError
from fenics_ehd.reduction import (
    ReducedBody,
    Structure,
    craig_bampton,
    full_interface,
    load_dependent,
    residual_flexibility,
    rigid,
    two_step_craig_bampton,
)
from fenics_ehd.scenes.slider_crank_settings import ELEMENTS, Reduction, SliderCrankSettings

#: Keys of [reduction] that each method reads.
METHOD_KEYS = {
    "m1": ("modes",),
    "m2": ("modes", "interior_modes"),
    "m3": ("vibration_modes", "residual_modes", "pressure_set", "snapshots", "selection"),
    "m4": ("vibration_modes", "residual_truncation"),
    "full": ("vibration_modes",),
    "rigid": (),
}


@dataclass(frozen=True, eq=False)
class ReducedRod:
    """A reduced rod, and what only displacement fields need.

    `structure` and `columns`, the part-size basis, stay distributed over the
    ranks that reduced the rod.
    """

    body: ReducedBody
    structure: Structure
    columns: np.ndarray
    seconds: float


def _model(settings: SliderCrankSettings) -> Path:
    from fenics_ehd.geometry import model_path

    name = settings.rod.model
    path = Path(name) if Path(name).suffix else model_path(name)
    if not path.is_file():
        raise SettingsError(f"rod.model = {name!r}: there is no file {path}")
    return path


def build_structure(settings: SliderCrankSettings, comm: MPI.Comm) -> Structure:
    """Mesh the rod and assemble its matrices, on every rank of `comm`."""
    from fenics_ehd.geometry import build_mesh
    from fenics_ehd.structure import Material, assemble_structure

    rod = settings.rod
    part = build_mesh(
        _model(settings),
        rod.geometry,
        comm=comm,
        serendipity_geometry=rod.element == "serendipity",
        cells=rod.cells,
    )
    material = Material(rod.youngs_modulus, rod.poissons_ratio, rod.density)
    return assemble_structure(
        part, material, family=rod.element, pressure_family=_pressure_family(settings)
    )


def _pressure_family(settings: SliderCrankSettings) -> str:
    """Family of the pressures in (15): the film's, or 9-node where the film's is no quadratic."""
    element = settings.film.element
    return element if element in ELEMENTS else "lagrange"


def reduce_rod(settings: SliderCrankSettings, comm: MPI.Comm = MPI.COMM_WORLD) -> ReducedRod:
    """Mesh, assemble and reduce the rod.

    Raises
    ------
    MeshError, SettingsError, SolverError
        From the mesh, the settings and the solvers.
    """
    start = perf_counter()
    structure = build_structure(settings, comm)
    body = reduce_structure(structure, settings.reduction)
    columns = body.columns
    assert columns is not None
    body = replace(body, columns=None, provenance={**body.provenance, **origin(settings)})
    return ReducedRod(body, structure, columns, perf_counter() - start)


def reduce_structure(structure: Structure, reduction: Reduction) -> ReducedBody:
    """Apply the method that the settings name, and keep the part-size basis."""
    common: dict[str, Any] = {"keep_basis": True}
    if reduction.method == "rigid":
        return rigid(structure, estimate_error=reduction.estimate_error, **common)
    common["solver"] = reduction.solver
    if reduction.method == "full":
        return full_interface(structure, reduction.vibration_modes, **common)
    common["estimate_error"] = reduction.estimate_error
    if reduction.method == "m1":
        return craig_bampton(structure, reduction.modes, **common)
    if reduction.method == "m2":
        return two_step_craig_bampton(
            structure, reduction.modes, reduction.interior_modes, **common
        )
    if reduction.method == "m4":
        return residual_flexibility(
            structure,
            reduction.vibration_modes,
            truncation=reduction.residual_truncation,
            **common,
        )
    return load_dependent(
        structure,
        reduction.vibration_modes,
        reduction.residual_modes,
        _pressures(structure, reduction),
        reduction.selection,
        **common,
    )


def _pressures(structure: Structure, reduction: Reduction) -> str | np.ndarray:
    """Name of the pressure set, or the pressures of a former run, shape (k, steps) [Pa]."""
    if reduction.snapshots == "none":
        return reduction.pressure_set
    from fenics_ehd.output import read_fields

    found = read_fields(reduction.snapshots, ("pressure_Pa", "pressure_nodes_m"))
    nodes = structure.lubricated_bore.pressure_coordinates
    if found["pressure_nodes_m"].shape != nodes.shape or not np.allclose(
        found["pressure_nodes_m"], nodes, atol=1e-9
    ):
        raise SettingsError(
            f"reduction.snapshots = {reduction.snapshots!r}: its {len(found['pressure_nodes_m'])} "
            f"pressure nodes are not the {len(nodes)} of this bore"
        )
    return found["pressure_Pa"].T


def origin(settings: SliderCrankSettings) -> dict[str, str]:
    """What a body depends on, as text by name, for its provenance."""
    rod, reduction = settings.rod, settings.reduction
    model = _model(settings)
    values = {
        "model": f"{model.name} {hashlib.sha256(model.read_bytes()).hexdigest()[:12]}",
        "cells": rod.cells,
        "element": rod.element,
        "youngs_modulus": repr(rod.youngs_modulus),
        "poissons_ratio": repr(rod.poissons_ratio),
        "density": repr(rod.density),
        "film_element": _pressure_family(settings),
        "method": reduction.method,
        **{f"geometry.{name}": repr(float(v)) for name, v in sorted(rod.geometry.items())},
    }
    for name in METHOD_KEYS[reduction.method]:
        values[name] = str(getattr(reduction, name))
    return values


def check_origin(body: ReducedBody, settings: SliderCrankSettings, tables: Mapping) -> None:
    """Refuse a body that was not made as the scene file says.

    Only what the file writes in [rod], [reduction] and [film] counts; a body
    that was not made from a scene is taken as it is.

    Raises
    ------
    SettingsError
        A key in the file differs from the body's.
    """
    if "model" not in body.provenance:
        return
    asked, made = origin(settings), body.provenance
    written = {"film_element"} if "element" in tables.get("film", {}) else set()
    for section in ("rod", "reduction"):
        written |= set(tables.get(section, {}))
    if "geometry" in written:
        written |= {name for name in {*asked, *made} if name.startswith("geometry.")}
    for name in sorted(written & {*asked, *made}):
        if asked.get(name) != made.get(name):
            raise SettingsError(
                f"the body was made with {name} = {made.get(name, 'default')}, the scene says "
                f"{asked.get(name, 'default')}: reduce the rod again or take the key out"
            )
