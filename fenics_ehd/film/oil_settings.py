"""Lubricants from settings."""

from __future__ import annotations

import attrs

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.oil import NO_GRADE, NO_TEMPERATURE, OilSettings
from fenics_ehd.film.grades import oil_of_grade
from fenics_ehd.film.lubricant import (
    Barus,
    Constant,
    DowsonHigginson,
    Lubricant,
    PressureLaw,
    Roelands,
)
from fenics_ehd.film.temperature import Oil
from fenics_ehd.film.thinning import Cross


def make_lubricant(settings: OilSettings, viscosity: float | None = None) -> Lubricant:
    """The lubricant that settings stand for; a `viscosity` [Pa s] counts in place of theirs.

    Raises
    ------
    SettingsError
        They contradict each other, or lack something.
    """
    viscosity = settings.viscosity if viscosity is None else viscosity
    oil = _oil(settings, viscosity)
    temperature = None if settings.temperature <= NO_TEMPERATURE else settings.temperature
    if oil is None:
        density = settings.density
    elif temperature is None:
        raise SettingsError(
            "temperature is missing: that of the oil of a grade or of kinematic viscosities [C]"
        )
    else:
        viscosity, density = oil.viscosity(temperature), oil.density(temperature)
    return Lubricant(
        viscosity,
        _pressure_law(settings, viscosity),
        _density_law(settings),
        density=density,
        specific_heat=settings.specific_heat,
        oil=oil,
        temperature=temperature,
        shear_law=_shear_law(settings),
    )


def _oil(settings: OilSettings, viscosity: float) -> Oil | None:
    """Its oil at every temperature, None for one of given viscosity."""
    kinematic = settings.viscosity_40, settings.viscosity_100
    graded = settings.grade != NO_GRADE
    if bool(viscosity) + graded + any(kinematic) != 1:
        raise SettingsError(
            "give a viscosity, a grade, or viscosity_40 and viscosity_100, one of them"
        )
    if viscosity:
        return None
    properties = {"density_15": settings.density, "specific_heat": settings.specific_heat}
    if graded:
        return oil_of_grade(settings.grade, **properties)
    if not all(kinematic):
        missing = "viscosity_40" if settings.viscosity_100 else "viscosity_100"
        raise SettingsError(f"{missing} is missing: kinematic viscosities come in pairs [mm2/s]")
    return Oil(*kinematic, **properties)


def _pressure_law(settings: OilSettings, viscosity: float) -> PressureLaw:
    if settings.barus and settings.roelands:
        raise SettingsError("barus and roelands exclude each other: give one of them")
    if settings.barus:
        return Barus(settings.barus)
    if settings.roelands:
        return Roelands(viscosity, settings.roelands)
    return Constant()


def _density_law(settings: OilSettings) -> PressureLaw:
    if settings.density_law != "constant":
        return DowsonHigginson(settings.compressibility, settings.stiffening)
    _unused(settings, "density_law = 'dowson-higginson'", "compressibility", "stiffening")
    return Constant()


def _shear_law(settings: OilSettings) -> Cross | None:
    if settings.cross_rate:
        return Cross(settings.cross_rate, settings.cross_exponent, settings.cross_second_viscosity)
    _unused(settings, "cross_rate", "cross_exponent", "cross_second_viscosity")
    return None


def _unused(settings: OilSettings, needed: str, *names: str) -> None:
    """Refuse other values than the defaults of what does nothing."""
    defaults = attrs.fields_dict(type(settings))
    for name in names:
        value = getattr(settings, name)
        if value != defaults[name].default:
            raise SettingsError(
                f"{name} = {value:g} does nothing without {needed}: drop it, or give that"
            )
