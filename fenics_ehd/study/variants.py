"""Variants of a scene: a name, and the settings in which they differ from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fenics_ehd.scenes.fields import FEWEST_CELLS, NONE
from fenics_ehd.scenes.films import planned_cells
from fenics_ehd.scenes.scene import Scene, lubricated_joints, meshed

#: Stands for the cells of every film, as many times the scene's own in both directions.
FILM = "film"


@dataclass(frozen=True)
class Variant:
    """Settings under a name that is a file name as well.

    `values` are by full key, by ``reduction.KEY`` for all parts that are reduced alike, and by
    `FILM` for all films.
    """

    name: str
    values: Mapping[str, Any]

    def but(self, suffix: str, values: Mapping[str, Any]) -> Variant:
        """With more settings, and the suffix behind its name."""
        return Variant(f"{self.name}-{suffix}", {**self.values, **values})


def m1(modes: int) -> Variant:
    """Craig-Bampton with so many fixed-boundary modes."""
    return _reduction(f"m1-{modes}", method="m1", modes=modes)


def m2(modes: int) -> Variant:
    """Two Craig-Bampton steps with so many modes in the end."""
    return _reduction(f"m2-{modes}", method="m2", modes=modes)


def m3(pressure_set: str, selection: str, modes: int) -> Variant:
    """Load-dependent reduction with so many residual modes."""
    return _reduction(
        f"m3-{pressure_set}-{selection}-{modes}",
        method="m3",
        pressure_set=pressure_set,
        snapshots=NONE,
        selection=selection,
        residual_modes=modes,
    )


def m4(vibration_modes: int, truncation: float = 1e-4) -> Variant:
    """Residual-flexibility completion, its patterns cut off at a relative displacement."""
    return _reduction(
        f"m4-{vibration_modes}-{truncation:.0e}",
        method="m4",
        vibration_modes=vibration_modes,
        residual_truncation=truncation,
    )


def full(vibration_modes: int) -> Variant:
    """Every column of ``P_c1`` (34)."""
    return _reduction(f"full-{vibration_modes}", method="full", vibration_modes=vibration_modes)


def rigid() -> Variant:
    """No elasticity."""
    return _reduction("rigid", method="rigid")


def _reduction(name: str, **values: Any) -> Variant:
    return Variant(name, {f"reduction.{key}": value for key, value in values.items()})


def steps(tolerance: float) -> dict[str, Any]:
    """Settings of the time integration."""
    return {"time.tolerance": tolerance}


def film(factor: float) -> dict[str, Any]:
    """Settings of the film meshes: so many times the cells in both directions."""
    return {FILM: factor}


def values_in(scene: Scene, values: Mapping[str, Any]) -> dict[str, Any]:
    """Values of a variant by full key."""
    found: dict[str, Any] = {}
    for key, value in values.items():
        if key.startswith("reduction."):
            found |= {f"bodies.{name}.{key}": value for name in meshed(scene)}
        elif key == FILM:
            joints = lubricated_joints(scene)
            found |= {f"joints.{joint}.cells": _times(scene, joint, value) for joint in joints}
        else:
            found[key] = value
    return found


def _times(scene: Scene, joint: str, factor: float) -> list[int]:
    """Cells of a film multiplied; those of the scene itself stay as they are written."""
    if factor == 1.0:
        return list(scene.joints[joint].cells)
    own = planned_cells(scene, joint)
    return [
        max(int(factor * cells + 0.5), least)
        for cells, least in zip(own, FEWEST_CELLS, strict=True)
    ]
