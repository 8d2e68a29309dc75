"""Viscosity and density of an oil as functions of its temperature.

Kinematic viscosity follows the Walther equation of ASTM D341,

    log10 log10 (nu + 0.7) = A - B log10 T,    nu in mm2/s, T in K,

through its values at 40 and 100 C. The standard adds terms that matter below 2 mm2/s: colder
than where nu is `LARGEST` and hotter than where it is `SMALLEST` the equation is refused.
Density falls linearly. Dynamic viscosity is their product.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.oil import DENSITY, SPECIFIC_HEAT

#: Zero of the Celsius scale [K].
ZERO_CELSIUS = 273.15

#: Range of kinematic viscosity in which the equation stands without more terms [mm2/s].
SMALLEST, LARGEST = 2.0, 2e7

#: Relative fall of density, of that at 15 C [1/K]: between the 5.8e-4 of a synthetic oil
#: (MadsKirkFoged/SharpFluids, SHC230.cs) and the 6.7e-4 of an engine oil of 1061.3 - 0.5921 T.
EXPANSION = 6.5e-4


@dataclass(frozen=True)
class WaltherLine:
    """The straight line of a kinematic viscosity over temperature, both doubly logarithmic.

    Attributes
    ----------
    intercept, slope
        A and B.
    """

    intercept: float
    slope: float

    @classmethod
    def through(cls, first: tuple[float, float], second: tuple[float, float]) -> WaltherLine:
        """Through two pairs of temperature [C] and kinematic viscosity [mm2/s].

        Raises
        ------
        SettingsError
            A viscosity is out of range, or does not fall with temperature.
        """
        (cold, high), (hot, low) = sorted((first, second))
        for temperature, nu in ((cold, high), (hot, low)):
            if not SMALLEST <= nu <= LARGEST:
                raise SettingsError(
                    f"a kinematic viscosity of {nu:g} mm2/s at {temperature:g} C must lie between "
                    f"{SMALLEST:g} and {LARGEST:g} mm2/s for the Walther equation"
                )
        if not (high > low and hot > cold):
            raise SettingsError(
                f"the kinematic viscosity of {low:g} mm2/s at {hot:g} C must be below that of "
                f"{high:g} mm2/s at {cold:g} C"
            )
        y = [np.log10(np.log10(nu + 0.7)) for nu in (high, low)]
        x = [np.log10(temperature + ZERO_CELSIUS) for temperature in (cold, hot)]
        slope = (y[0] - y[1]) / (x[1] - x[0])
        return cls(float(y[0] + slope * x[0]), float(slope))

    def __call__(self, temperature: float) -> float:
        """Kinematic viscosity [mm2/s] at a temperature [C]."""
        return float(10 ** self._inner(temperature) - 0.7)

    def derivative(self, temperature: float) -> float:
        """Of the kinematic viscosity [mm2/(s K)]."""
        inner = self._inner(temperature)
        growth = -self.slope * inner / (temperature + ZERO_CELSIUS)
        return float(np.log(10) * 10**inner * growth)

    def temperature(self, viscosity: float) -> float:
        """At which the kinematic viscosity [mm2/s] is as given [C]."""
        exponent = (self.intercept - np.log10(np.log10(viscosity + 0.7))) / self.slope
        return float(10**exponent - ZERO_CELSIUS)

    def _inner(self, temperature: float) -> float:
        return float(10 ** (self.intercept - self.slope * np.log10(temperature + ZERO_CELSIUS)))


@dataclass(frozen=True)
class Oil:
    """What an oil is at every temperature [C].

    Attributes
    ----------
    viscosity_40, viscosity_100
        Kinematic viscosity at 40 and 100 C [mm2/s].
    density_15
        At 15 C [kg/m3].
    specific_heat
        [J/(kg K)].
    expansion
        Relative fall of density per K, of that at 15 C [1/K].

    Raises
    ------
    SettingsError
        A value is out of range.
    """

    viscosity_40: float
    viscosity_100: float
    density_15: float = DENSITY
    specific_heat: float = SPECIFIC_HEAT
    expansion: float = EXPANSION

    def __post_init__(self) -> None:
        for name, unit in (("density_15", "kg/m3"), ("specific_heat", "J/(kg K)")):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise SettingsError(f"{name} = {value:g} {unit} of an oil must be above 0")
        if not 0 <= self.expansion < 1e-2:
            raise SettingsError(
                f"expansion = {self.expansion:g} 1/K of an oil must be at least 0 and below 0.01"
            )
        self._line()

    @property
    def coldest(self) -> float:
        """Temperature below which the Walther equation is refused [C]."""
        return self._line().temperature(LARGEST)

    @property
    def hottest(self) -> float:
        """Temperature above which the Walther equation is refused [C]."""
        return self._line().temperature(SMALLEST)

    def kinematic_viscosity(self, temperature: float) -> float:
        """[mm2/s].

        Raises
        ------
        SettingsError
            At this temperature it is out of the range of the Walther equation.
        """
        return self._checked(temperature)(temperature)

    def viscosity(self, temperature: float) -> float:
        """Dynamic viscosity [Pa s]; errors as `kinematic_viscosity`."""
        return 1e-6 * self.kinematic_viscosity(temperature) * self.density(temperature)

    def viscosity_derivative(self, temperature: float) -> float:
        """Of the dynamic viscosity [Pa s/K]; errors as `kinematic_viscosity`."""
        line = self._checked(temperature)
        rise = line.derivative(temperature) * self.density(temperature)
        return 1e-6 * (rise - line(temperature) * self.density_15 * self.expansion)

    def density(self, temperature: float) -> float:
        """[kg/m3]."""
        return self.density_15 * (1.0 - self.expansion * (temperature - 15.0))

    def _line(self) -> WaltherLine:
        return WaltherLine.through((40.0, self.viscosity_40), (100.0, self.viscosity_100))

    def _checked(self, temperature: float) -> WaltherLine:
        line = self._line()
        cold, hot = line.temperature(LARGEST), line.temperature(SMALLEST)
        if not cold <= temperature <= hot:
            raise SettingsError(
                f"temperature = {temperature:g} C of the oil must lie between {cold:.4g} C and "
                f"{hot:.4g} C, where its kinematic viscosity is {LARGEST:g} and {SMALLEST:g} mm2/s"
            )
        return line
