"""One extreme run and what is expected of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from extremes_claims import Claim, energy, open_film, same_end, tighter
from scene_runs import METHOD, REVOLUTIONS, TOLERANCE, Reduce, changed

from fenics_ehd.base.errors import EhdError, FilmTooThinError
from fenics_ehd.scenes.scene import Scene

#: Error of a run at tolerance 1e-4 and of its energy (docs/measurements.md: 0.2 % and 4e-4; where
#: the film is thick and steps are 7 degrees long the inertia forces' own error is 3e-3).
ERROR, ENERGY = 0.015, 4e-3

#: Difference of similar machines: Newton's method may stop an iteration earlier in one of them.
SIMILAR = 5e-4

#: Of every such run.
USUAL = tighter(ERROR), energy(ENERGY)


@dataclass(frozen=True)
class Case:
    """One row of the table; `error` is the named error expected to end the run, None for none."""

    name: str
    scene: Scene
    claims: tuple[Claim, ...]
    error: type[EhdError] | None = None
    reduce: Reduce | None = None


def scene(
    method: str = "m4", revolutions: float = 1.0, values: Mapping[str, Any] | None = None
) -> Scene:
    """The paper's slider-crank at tolerance 1e-4, with other values."""
    usual = {
        METHOD: method,
        "bodies.rod.reduction.estimate_error": False,
        REVOLUTIONS: revolutions,
        TOLERANCE: 1e-4,
    }
    return changed("slider-crank-paper", usual | dict(values or {}))


def too_thin(name: str, why: str, machine: Scene) -> Case:
    """A run that must end because the film becomes too thin."""
    end = same_end(0.02)
    claim = Claim(f"{why}; {end.text}", end.limit, end.measure, end.name)
    return Case(name, machine, (claim, open_film()), FilmTooThinError)
