"""An elastic part reduced as the settings say, and what it was made from."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.fem.models import check_model, model_path
from fenics_ehd.film.layout import match
from fenics_ehd.reduction import (
    ReducedBody,
    Reductor,
    Structure,
    craig_bampton,
    full_interface,
    load_dependent,
    proper_orthogonal,
    residual_flexibility,
    rigid,
    two_step_craig_bampton,
)
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.part_settings import ELEMENTS, ReductionSettings

#: Keys of [reduction] that each method reads.
METHOD_KEYS = {
    "m1": ("modes",),
    "m2": ("modes", "interior_modes"),
    "m3": ("vibration_modes", "residual_modes", "pressure_set", "snapshots", "selection"),
    "m4": ("vibration_modes", "residual_truncation"),
    "full": ("vibration_modes",),
    "rigid": (),
}


#: Reductions by name, of what, by which settings, and with which options that most have.
METHODS: Mapping[str, Callable[[Reductor, ReductionSettings, Mapping[str, Any]], ReducedBody]] = {
    "m1": lambda part, given, common: craig_bampton(part, given.modes, **common),
    "m2": lambda part, given, common: two_step_craig_bampton(
        part, given.modes, given.interior_modes, **common
    ),
    "m3": lambda part, given, common: load_dependent(
        part,
        given.vibration_modes,
        given.residual_modes,
        given.pressure_set,
        given.selection,
        **common,
    ),
    "m4": lambda part, given, common: residual_flexibility(
        part,
        given.vibration_modes,
        truncation=given.residual_truncation,
        centrifugal=part.free,
        **common,
    ),
    "full": lambda part, given, _: full_interface(part, given.vibration_modes, keep_basis=True),
    "rigid": lambda part, _, common: rigid(part, **common),
}


@dataclass(frozen=True, eq=False)
class ReducedPart:
    """A reduced part, and what only displacement fields need.

    `structure` and `columns`, the part-size basis, stay distributed over the
    ranks that reduced the part.
    """

    body: ReducedBody
    structure: Structure
    columns: np.ndarray
    seconds: float


def model_file(part: schema.FlexibleSettings, section: str) -> Path:
    """The Gmsh model of a part whose settings are in a section of that name.

    Raises
    ------
    SettingsError
        There is no such file.
    MeshError
        It is no model.
    """
    path = Path(part.model) if Path(part.model).suffix else model_path(part.model)
    if not path.is_file():
        raise SettingsError(f"{section}.model = {part.model!r}: there is no file {path}")
    check_model(path)
    return path


def pressure_family(element: str) -> str:
    """Family of the pressures in (15): the film's, or 9-node where the film's is no quadratic."""
    return element if element in ELEMENTS else "lagrange"


def reduce_structure(part: Structure | Reductor, reduction: ReductionSettings) -> ReducedBody:
    """Apply the method that the settings name, and keep the part-size basis.

    A `Reductor` solves as it was made, whatever `solver` the settings name.
    """
    if isinstance(part, Structure):
        part = Reductor(part, solver=reduction.solver)
    common: dict[str, Any] = {"keep_basis": True, "estimate_error": reduction.estimate_error}
    if reduction.method == "m3" and reduction.snapshots != "none":
        return _trained(part, reduction, common)
    return METHODS[reduction.method](part, reduction, common)


def _trained(
    part: Reductor, reduction: ReductionSettings, common: Mapping[str, Any]
) -> ReducedBody:
    """M3 with the main patterns of a former run's pressures, its accuracy with how many more."""
    asked = reduction.residual_modes
    patterns = proper_orthogonal(_snapshots(part.structure, reduction), asked)
    body = load_dependent(
        part, reduction.vibration_modes, patterns.shape[1], patterns, "every-column", **common
    )
    added = {"static_added": float(max(patterns.shape[1] - asked, 0))}
    return replace(body, accuracy={**body.accuracy, **added})


def _snapshots(structure: Structure, reduction: ReductionSettings) -> np.ndarray:
    """Pressures of a former run, shape (k, steps) [Pa]."""
    if len(structure.bores) > 1:
        raise SettingsError(
            f"reduction.snapshots = {reduction.snapshots!r}: a run's pressures are those of one "
            f"bore, the part has {', '.join(structure.bores)}"
        )
    from fenics_ehd.results.load import load_results

    joints = load_results(reduction.snapshots).joints
    if len(joints) != 1:
        raise SettingsError(
            f"reduction.snapshots = {reduction.snapshots!r}: a run with one lubricated joint is "
            f"needed, it has {', '.join(joints) or 'none'}"
        )
    ((_, joint),) = joints.items()
    film, nodes = joint.film, structure.bore.pressure_coordinates
    radius = np.linalg.norm(nodes[:, :2], axis=1).max()
    circle = radius * np.cos(film.angle), radius * np.sin(film.angle)
    places = np.column_stack([*circle, film.height])
    order = match(nodes, places)
    if order is None:
        raise SettingsError(
            f"reduction.snapshots = {reduction.snapshots!r}: its {len(places)} film nodes are not "
            f"the {len(nodes)} pressure nodes of this bore"
        )
    return np.asarray(film.pressure)[:, order].T


def structure_provenance(
    part: schema.FlexibleSettings, model: Path, film_element: str
) -> dict[str, str]:
    """What an assembled part depends on, as text by name."""
    return {
        "model": f"{model.name} {hashlib.sha256(model.read_bytes()).hexdigest()[:12]}",
        "element": part.element,
        # A mesh has the cells it has.
        **({"cells": part.cells} if model.suffix == ".geo" else {}),
        "youngs_modulus": repr(part.material.youngs_modulus),
        "poissons_ratio": repr(part.material.poissons_ratio),
        "density": repr(part.material.density),
        "film_element": pressure_family(film_element),
        "bores": " ".join(part.bores),
        "points": " ".join(part.points),
        "held_by": part.held_by,
        **{f"geometry.{name}": repr(float(v)) for name, v in sorted(part.geometry.items())},
    }


def reduction_provenance(reduction: ReductionSettings) -> dict[str, str]:
    """A method and what it reads of its settings, as text by name."""
    names = ("method", *METHOD_KEYS[reduction.method])
    return {name: str(getattr(reduction, name)) for name in names}


def require_provenance(
    body: ReducedBody, asked: Mapping[str, str], written: set[str], section: str
) -> None:
    """Refuse a body that was not made as a scene file says.

    One that was not made from a scene is taken as it is.

    Parameters
    ----------
    body
        From a file.
    asked
        Provenance that the scene's would have.
    written
        Names in it that the file writes.
    section
        Of the part.

    Raises
    ------
    SettingsError
        A key in the file differs from the body's.
    """
    made = body.provenance
    if "model" not in made:
        return
    if "geometry" in written:
        written |= {name for name in {*asked, *made} if name.startswith("geometry.")}
    for name in sorted(written & {*asked, *made}):
        if asked.get(name) != made.get(name):
            raise SettingsError(
                f"the body was made with {name} = {made.get(name, 'default')}, {section} says "
                f"{asked.get(name, 'default')}: reduce the part again or take the key out"
            )
