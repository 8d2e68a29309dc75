"""Steady balance of a bearing's heat: the temperature at which its oil carries away its power.

See `fenics_ehd.film.heat`. A hotter film is thinner, dissipates less and lets as much oil out or
more: what the balance asks for falls with the temperature, and there is one solution.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import attrs

from fenics_ehd.base.errors import EhdError, HeatError, SettingsError
from fenics_ehd.bearing.film import BearingFilm, Operation
from fenics_ehd.bearing.settings import BearingSettings
from fenics_ehd.film.flow import oil_leaving
from fenics_ehd.film.forces import film_forces
from fenics_ehd.film.heat import Heat, TemperatureSearch, run_away
from fenics_ehd.film.oil_settings import make_lubricant

#: Of the effective temperature [K].
TOLERANCE = 1e-6

#: Change of ln(viscosity) that shows how power over flow follows the viscosity: nothing but the
#: temperature changes them here.
TELLING = 1e-6

MOST_STEPS = 50

Found = tuple[BearingFilm, Operation]


@dataclass(frozen=True)
class BearingHeat:
    """Balanced heat of a bearing.

    Attributes
    ----------
    supply_temperature, effective_temperature, outlet_temperature
        Of the oil [C].
    power
        Dissipated in the film [W].
    flow
        Of the oil that leaves [m3/s], see `FilmFlows.leaving`.
    """

    supply_temperature: float
    effective_temperature: float
    outlet_temperature: float
    power: float
    flow: float


def balanced(
    settings: BearingSettings, find: Callable[[BearingSettings], Found]
) -> tuple[BearingSettings, BearingHeat, Found]:
    """Bearing at the effective temperature of its oil.

    Parameters
    ----------
    settings
        With a supply temperature.
    find
        Operation of a bearing of given temperature.

    Returns
    -------
    settings
        At that temperature.
    heat, found

    Raises
    ------
    SettingsError
        The oil has one viscosity, or none at the supply's temperature.
    HeatError
        There is no such temperature.
    """
    if not settings.graded:
        raise SettingsError(
            f"supply_temperature = {settings.supply_temperature:g} C: the oil has one viscosity; "
            "give a grade, or viscosity_40 and viscosity_100"
        )
    heat = Heat(
        supply_temperature=settings.supply_temperature,
        conducted=settings.conducted,
        mixing=settings.mixing,
        tolerance=TOLERANCE,
    )
    oil = make_lubricant(_at(settings, settings.supply_temperature), 0.0).oil
    assert oil is not None
    search = TemperatureSearch(heat, oil, telling=TELLING)
    for _ in range(MOST_STEPS):
        here = _at(settings, search.temperature)
        bearing, operation = _found(search, find, here)
        forces = film_forces(
            bearing.film, operation.state, operation.motion, settings.shear_rule, bearing.outside
        )
        power, flow = forces.dissipation, oil_leaving(bearing.film, operation.state)
        if abs(search.defect(power, flow)) <= TOLERANCE:
            outlet = heat.outlet(oil, search.temperature, power, flow)
            figures = BearingHeat(
                settings.supply_temperature, search.temperature, outlet, power, flow
            )
            return here, figures, (bearing, operation)
        if not search.move(power, flow):
            raise run_away("bearing", search)
    raise HeatError(
        f"supply_temperature = {settings.supply_temperature:g} C: the effective temperature, "
        f"{search.temperature:.6g} C, is not within {TOLERANCE:g} K of its balance after "
        f"{MOST_STEPS} operating points"
    )


def _at(settings: BearingSettings, temperature: float) -> BearingSettings:
    return attrs.evolve(settings, temperature=temperature)


def _found(
    search: TemperatureSearch, find: Callable[[BearingSettings], Found], settings: BearingSettings
) -> Found:
    """Operation at one temperature; that the heat made the film too thin is said."""
    try:
        return find(settings)
    except EhdError as error:
        if search.without_balance:
            raise run_away("bearing", search, error) from error
        if search.temperature > settings.supply_temperature:
            raise type(error)(
                f"at {search.temperature:.4g} C, the oil's effective temperature by its balance: "
                f"{error}"
            ) from error
        raise
