"""Heat balance of a film: one effective temperature, from dissipated power and outflow of oil.

Journal and bore conduct the share ``conducted_share`` of the power P dissipated in the film. The
oil carries away the rest,

    (1 - conducted_share) P = rho c Q (T_out - T_supply),

and has the viscosity of an effective temperature between those of supply and outlet,

    T = T_supply + outlet_weight (T_out - T_supply).

Design calculations use the mean of these two temperatures, ``outlet_weight = 0.5`` (DIN 31652 as
explained at inggo.com/teachnet/53-waermebilanz.html). Q is the flow of the oil that leaves
(`FilmFlows.leaving`); the same flow enters at the supply temperature. rho is the density at the
effective temperature, and c the specific heat.

Imports inside functions: `scipy.optimize` is slow to import, and only heat balances need it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar

import attrs
import numpy as np

from fenics_ehd.base import shared_settings
from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import HeatError, SettingsError
from fenics_ehd.base.fields import REQUIRED, number
from fenics_ehd.base.layout import Stateful, Value

if TYPE_CHECKING:
    from fenics_ehd.film.lubricant import TemperatureLaw


#: Exponent n of ``P / (rho Q) ~ viscosity^n`` until it is computed from two temperatures. It is
#: exact for a journal at a fixed position; the iteration contracts for every true n between 0 and
#: 2.
FIRST_EXPONENT = 1.0

#: Limits of n; n is 2 if supply pressure drives all the flow through the film.
EXPONENTS = (0.0, 2.0)

#: Smallest change of ln(viscosity) from which n is computed. In the cycle after a change of
#: temperature the film still depends on the previous one: power and flow have an error of 0.1 % per
#: K of the change.
LEAST_CHANGE = 0.05

#: Distance that temperatures keep from the highest one of the oil, because of round-off [K].
ROUNDING = 1e-9

#: Factor by which the viscosity is lowered if no temperature balances power and flow of a cycle:
#: the power may be too large in a first cycle, in which the film builds up.
THINNER = 4.0


@attrs.frozen(kw_only=True)
class Heat(Described):
    """Settings of a film's heat balance over a cycle.

    It needs `time.periodic` and an oil whose viscosity depends on the temperature.
    """

    supply_temperature: float = shared_settings.supply_temperature(
        REQUIRED, "of the oil that comes in [C]"
    )
    conducted_share: float = shared_settings.conducted_share(
        "of the dissipated power that journal and bore conduct away [-]"
    )
    outlet_weight: float = shared_settings.outlet_weight()
    tolerance: float = number(
        0.1, "largest difference of the effective temperature from its balance [K]", above=0
    )

    def outlet(self, oil: TemperatureLaw, temperature: float, power: float, flow: float) -> float:
        """Outlet temperature T_out of the oil [C]; infinite if no oil leaves the film.

        Parameters
        ----------
        oil, temperature
            Oil, and its effective temperature [C].
        power, flow
            Dissipated power P [W] and flow Q of the oil that leaves [m3/s].
        """
        carried = oil.density(temperature) * oil.specific_heat * flow
        rise = (1.0 - self.conducted_share) * power
        if not rise > 0.0:
            return self.supply_temperature
        return self.supply_temperature + rise / carried if carried > 0.0 else np.inf

    def balanced(self, oil: TemperatureLaw, temperature: float, power: float, flow: float) -> float:
        """Effective temperature [C] of a film whose flow carries away the dissipated power.

        The power [W] and the flow [m3/s] were computed at `temperature` [C].
        """
        outlet = self.outlet(oil, temperature, power, flow)
        return self.supply_temperature + self.outlet_weight * (outlet - self.supply_temperature)


def require_graded(graded: bool, *, key: str = "heat", lubricant: str = "the lubricant") -> None:
    """Refuse a heat balance if the viscosity of the lubricant does not depend on temperature.

    Parameters
    ----------
    graded
        Whether the lubricant is an oil with a grade or with two kinematic viscosities.
    key, lubricant
        Key of the heat balance, and name of the lubricant, for the message.

    Raises
    ------
    SettingsError
        If the lubricant is not graded; the message names the key and the lubricant.
    """
    if not graded:
        raise SettingsError(
            f"{key}: the viscosity of {lubricant} does not depend on its temperature: use a "
            "lubricant with a grade, or with viscosity_40 and viscosity_100"
        )


def require_cycle(periodic: bool, key: str) -> None:
    """Refuse a heat balance in a run without a cycle.

    Raises
    ------
    SettingsError
        If the run is not periodic; the message names the key.
    """
    if not periodic:
        raise SettingsError(
            f"{key}: heat is balanced over a cycle, but a run with time.periodic = false has no "
            "cycle: set time.periodic = true, or remove the table heat, so that the oil has the "
            "temperature of its lubricant"
        )


class TemperatureSearch(Stateful):
    """Search for the effective temperature of a film, by power and flow at trial temperatures.

    The ratio of dissipated power to flow is assumed to be proportional to ``viscosity^n`` between
    two temperatures. The viscosity at every temperature is known. The exponent n changes little
    even if the viscosity changes a thousandfold.

    Parameters
    ----------
    heat, oil
        Settings of the heat balance, and oil of the film.
    name
        Name of the film, or key of the settings of its heat balance, for messages.
    least_change
        Change of ln(viscosity) between two trial temperatures above which the exponent n is
        computed from the results at both.

    Attributes
    ----------
    temperature
        Current effective temperature [C]; the search starts at the supply temperature.
    power, flow
        Power [W] and flow [m3/s] from which the current temperature was computed.
    without_balance
        True if no temperature balances this power and flow.
    exponent
        Exponent n of the viscosity.
    last
        Natural logarithms of viscosity [Pa s] and of the balanced temperature rise [K] at the last
        temperature, shape (2,); None at first.
    """

    carried: ClassVar = {
        "temperature": Value("real"),
        "power": Value("real", finite=False),
        "flow": Value("real", finite=False),
        "without_balance": Value("truth"),
        "exponent": Value("real"),
        "last": Value("float", (2,), required=False),
    }

    def __init__(
        self,
        heat: Heat,
        oil: TemperatureLaw,
        name: str = "heat",
        *,
        least_change: float = LEAST_CHANGE,
    ):
        self.heat = heat
        self.oil = oil
        self._name = name
        self._least_change = least_change
        oil.viscosity(heat.supply_temperature)  # refuses a temperature out of range
        self.temperature = heat.supply_temperature
        self.without_balance = False
        self.power = self.flow = float("nan")
        self.last: np.ndarray | None = None
        self.exponent = FIRST_EXPONENT

    @property
    def viscosity(self) -> float:
        """Dynamic viscosity at the current temperature [Pa s]."""
        return self.oil.viscosity(self.temperature)

    def shift(self, change: float) -> None:
        """Add `change` [K] to the current temperature.

        The result is at least the supply temperature and at most the oil's highest temperature.
        """
        hottest = self.oil.hottest - ROUNDING
        wanted = self.temperature + change
        self.temperature = float(np.clip(wanted, self.heat.supply_temperature, hottest))

    def defect(self, power: float, flow: float) -> float:
        """Balanced temperature less the current temperature [K].

        At the balanced temperature the flow [m3/s] carries away the dissipated power [W].
        """
        return self.heat.balanced(self.oil, self.temperature, power, flow) - self.temperature

    def settled(self, power: float, flow: float) -> bool:
        """Whether the flow [m3/s] carries away the power [W] at the current temperature.

        The balanced temperature may differ from the current one by `Heat.tolerance`.
        """
        return abs(self.defect(power, flow)) <= self.heat.tolerance

    def move(self, power: float, flow: float) -> None:
        """Set the next trial temperature from power [W] and flow [m3/s] at the current one.

        Raises
        ------
        HeatError
            The current temperature is the oil's highest, and the balance requires a higher one.
        """
        heat = self.heat
        oil = self.oil
        here = self.temperature
        supply = heat.supply_temperature
        hottest = oil.hottest - ROUNDING
        rise = heat.balanced(oil, here, power, flow) - supply
        self.power = power
        self.flow = flow
        self.without_balance = False
        if not rise > 0.0:
            self.temperature = supply
            self.last = None
            return
        viscosity = oil.viscosity(here)
        if rise < np.inf:
            self._learn(float(np.log(viscosity)), float(np.log(rise)))

        def excess(temperature: float) -> float:
            thinner = oil.viscosity(temperature) / viscosity
            return supply + rise * thinner**self.exponent - temperature

        if excess(hottest) > 0.0:
            self.without_balance = True
            if here >= hottest:
                raise self._run_away(", the highest at which the viscosity of the oil is known")
            self.temperature = min(_thinner(oil, here, hottest), hottest)
            return
        self.temperature = _root(excess, supply, hottest)

    def cause_of(self, error: Exception) -> HeatError | None:
        """Make the heat error that explains an error of the film; None if heat can be balanced."""
        return self._run_away(f" ({error})") if self.without_balance else None

    def _run_away(self, last: str) -> HeatError:
        """Make the error of a film whose heat no temperature balances.

        Parameters
        ----------
        last
            Remark on the last temperature, for the message.
        """
        return HeatError(
            f"{self._name}: the oil cannot carry away the heat: a flow of "
            f"{1e6 * self.flow:.3g} cm3/s does not remove {self.power:.3g} W at any effective "
            f"temperature up to {self.temperature:.4g} C{last}: raise the clearance, the flow of "
            "oil or conducted_share, or lower supply_temperature or the speed"
        )

    def _learn(self, viscosity: float, rise: float) -> None:
        """Set the exponent of the viscosity in the power law of the temperature rise.

        It is computed from the natural logarithms of viscosity and temperature rise at two
        temperatures; the temperature rise is proportional to power over flow.
        """
        if self.last is not None and abs(viscosity - self.last[0]) > self._least_change:
            slope = (rise - self.last[1]) / (viscosity - self.last[0])
            self.exponent = float(np.clip(slope, *EXPONENTS))
        self.last = np.array([viscosity, rise])


def _thinner(oil: TemperatureLaw, temperature: float, hottest: float) -> float:
    """Temperature [C] at which the viscosity is `THINNER` times lower than at `temperature` [C].

    The result is at most `hottest` [C].
    """
    wanted = oil.viscosity(temperature) / THINNER
    if oil.viscosity(hottest) >= wanted:
        return hottest
    return _root(lambda t: oil.viscosity(t) - wanted, temperature, hottest)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    from scipy.optimize import brentq

    return float(brentq(function, low, high, xtol=1e-12))
