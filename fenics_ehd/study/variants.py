"""Variants of a scene: a name, and the settings in which they differ from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Variant:
    """Settings by ``section.key``, under a name that is a file name as well."""

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


def steps(tolerance: float, order: int = 2) -> dict[str, Any]:
    """Settings of the time integration."""
    return {"time.tolerance": tolerance, "time.order": order}


def film(around: int, along: int) -> dict[str, Any]:
    """Settings of the film mesh."""
    return {"film.cells": (around, along)}
