"""One extreme run and what is expected of it."""

from __future__ import annotations

from dataclasses import dataclass

from extremes_claims import Claim, energy, open_film, same_end, tighter
from extremes_runs import Reducer, changed

from fenics_ehd.errors import EhdError, FilmTooThinError
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings

#: Error of a run at tolerance 1e-4 and of its energy (docs/measurements.md: 0.6 % and 8e-5).
ERROR, ENERGY = 0.015, 2e-3

#: Of every such run.
USUAL = tighter(ERROR), energy(ENERGY)


@dataclass(frozen=True)
class Case:
    """One row of the table; `error` is the named error expected to end the run, None for none."""

    name: str
    settings: SliderCrankSettings
    claims: tuple[Claim, ...]
    error: type[EhdError] | None = None
    reducer: Reducer | None = None


def scene(method: str = "m4", revolutions: float = 1.0, **values: object) -> SliderCrankSettings:
    """The default scene at tolerance 1e-4, with other values."""
    return changed(
        SliderCrankSettings(),
        **{
            "reduction__method": method,
            "reduction__estimate_error": False,
            "mechanism__revolutions": revolutions,
            "time__tolerance": 1e-4,
        }
        | values,
    )


def too_thin(name: str, why: str, settings: SliderCrankSettings) -> Case:
    """A run that must end because the film becomes too thin."""
    end = same_end(0.02)
    claim = Claim(f"{why}; {end.text}", end.limit, end.measure, end.name)
    return Case(name, settings, (claim, open_film()), FilmTooThinError)
