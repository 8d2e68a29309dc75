"""What the scenes do with an elastic part, whatever it is: reduce it, and know one made before."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol

import attrs
import numpy as np

from fenics_ehd.errors import SettingsError
from fenics_ehd.models import check_model, model_path
from fenics_ehd.reduction import (
    ReducedBody,
    Reductor,
    Structure,
    craig_bampton,
    full_interface,
    load_dependent,
    residual_flexibility,
    rigid,
    two_step_craig_bampton,
)
from fenics_ehd.scenes.part_settings import ELEMENTS, Reduction

#: Keys of [reduction] that each method reads.
METHOD_KEYS = {
    "m1": ("modes",),
    "m2": ("modes", "interior_modes"),
    "m3": ("vibration_modes", "residual_modes", "pressure_set", "snapshots", "selection"),
    "m4": ("vibration_modes", "residual_truncation"),
    "full": ("vibration_modes",),
    "rigid": (),
}


class Part(Protocol):
    """Settings that every elastic part has."""

    @property
    def model(self) -> str:
        """Shipped model, or path of a .geo or .msh file."""

    @property
    def element(self) -> str:
        """Of hexahedra."""

    @property
    def youngs_modulus(self) -> float:
        """[Pa]."""

    @property
    def poissons_ratio(self) -> float:
        """[-]."""

    @property
    def density(self) -> float:
        """[kg/m3]."""

    @property
    def geometry(self) -> dict:
        """Parameters of the Gmsh model."""


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


def model_file(part: Part, section: str) -> Path:
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


def reduce_part(
    build: Callable[[], Structure],
    reduce: Callable[[Structure], ReducedBody],
    provenance: Mapping[str, str],
    check: Callable[[Structure], None] | None = None,
) -> ReducedPart:
    """Build a structure, reduce it with its basis kept, and note what it was made from.

    `check` may refuse the structure before it is reduced.
    """
    start = perf_counter()
    structure = build()
    if check is not None:
        check(structure)
    body = reduce(structure)
    columns = body.columns
    assert columns is not None
    body = replace(body, columns=None, provenance={**body.provenance, **provenance})
    return ReducedPart(body, structure, columns, perf_counter() - start)


def reduce_structure(part: Structure | Reductor, reduction: Reduction) -> ReducedBody:
    """Apply the method that the settings name, and keep the part-size basis.

    A `Reductor` solves as it was made, whatever `solver` the settings name.
    """
    if isinstance(part, Structure):
        part = Reductor(part, solver=reduction.solver)
    if reduction.method == "full":
        return full_interface(part, reduction.vibration_modes, keep_basis=True)
    common: dict[str, Any] = {"keep_basis": True, "estimate_error": reduction.estimate_error}
    if reduction.method == "rigid":
        return rigid(part, **common)
    if reduction.method == "m1":
        return craig_bampton(part, reduction.modes, **common)
    if reduction.method == "m2":
        return two_step_craig_bampton(part, reduction.modes, reduction.interior_modes, **common)
    if reduction.method == "m4":
        return residual_flexibility(
            part,
            reduction.vibration_modes,
            truncation=reduction.residual_truncation,
            centrifugal=part.free,
            **common,
        )
    return load_dependent(
        part,
        reduction.vibration_modes,
        reduction.residual_modes,
        _pressures(part.structure, reduction),
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


def origin(part: Part, model: Path, film_element: str, reduction: Reduction) -> dict[str, str]:
    """What a body depends on, as text by name, for its provenance."""
    values = {
        "model": f"{model.name} {hashlib.sha256(model.read_bytes()).hexdigest()[:12]}",
        "element": part.element,
        "youngs_modulus": repr(part.youngs_modulus),
        "poissons_ratio": repr(part.poissons_ratio),
        "density": repr(part.density),
        "film_element": pressure_family(film_element),
        "method": reduction.method,
        **{f"geometry.{name}": repr(float(v)) for name, v in sorted(part.geometry.items())},
    }
    for name in METHOD_KEYS[reduction.method]:
        values[name] = str(getattr(reduction, name))
    return values


def check_origin(
    body: ReducedBody, asked: Mapping[str, str], tables: Mapping[str, Any], section: str
) -> None:
    """Refuse a body that was not made as a scene file says.

    Only what the file writes of the part, [reduction] and [film] counts; a body
    that was not made from a scene is taken as it is.

    Parameters
    ----------
    body
        From a file.
    asked
        `origin` of the scene.
    tables
        The scene as written.
    section
        Of the part, ``"rod"``.

    Raises
    ------
    SettingsError
        A key in the file differs from the body's.
    """
    made = body.provenance
    if "model" not in made:
        return
    written = {"film_element"} if "element" in tables.get("film", {}) else set()
    for name in (section, "reduction"):
        written |= set(tables.get(name, {}))
    if "geometry" in written:
        written |= {name for name in {*asked, *made} if name.startswith("geometry.")}
    for name in sorted(written & {*asked, *made}):
        if asked.get(name) != made.get(name):
            raise SettingsError(
                f"the body was made with {name} = {made.get(name, 'default')}, the scene says "
                f"{asked.get(name, 'default')}: reduce the {section} again or take the key out"
            )


def as_made(settings: Any, body: ReducedBody) -> Any:
    """Settings of a scene with the part and the reduction that a body was made with.

    A scene takes a body of any method; one that was not made from a scene leaves it as it is.

    Parameters
    ----------
    settings
        Of the scene.
    body
        From a file, or just reduced.
    """
    made, section = body.provenance, "housing" if settings.scene == "rotor" else "rod"
    if not {"model", "method"} <= set(made):
        return settings

    def taken(values: Any, names: Iterable[str]) -> Any:
        known = {n: type(getattr(values, n))(made[n]) for n in names if n in made}
        return attrs.evolve(values, **known)

    geometry = {n.removeprefix("geometry."): float(v) for n, v in made.items() if "geometry." in n}
    part = getattr(settings, section)
    names = ("element", "cells", "youngs_modulus", "poissons_ratio", "density")
    part = attrs.evolve(taken(part, [n for n in names if hasattr(part, n)]), geometry=geometry)
    reduction = taken(settings.reduction, ("method", *METHOD_KEYS.get(made["method"], ())))
    return attrs.evolve(settings, **{section: part, "reduction": reduction})
