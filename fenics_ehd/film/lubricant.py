"""Viscosity and density of an oil as functions of pressure, temperature and shear rate; grades.

**Temperature.** Kinematic viscosity follows the Walther equation of ASTM D341,

    log10 log10 (nu + 0.7) = A - B log10 T,    nu in mm2/s, T in K,

through its values at 40 and 100 C. The standard adds terms that matter below 2 mm2/s: temperatures
at which nu is above `LARGEST` or below `SMALLEST` are refused. Density falls linearly with
temperature. Dynamic viscosity is the product of kinematic viscosity and density.

**Grades.** A grade has two nominal kinematic viscosities. A standard specifies one of them: ISO
3448 the value of an ISO VG grade at 40 C, SAE J300 a range at 100 C, of which the middle is used
(fuchs.com, "Viscosity charts"; SAE 60 and 0W-8 to 0W-16: the edition of 2015 at raso.name). "SAE
10", a winter grade, is given the range from 4.1 mm2/s to the lower limit of 15W. The other
viscosity follows from an assumed viscosity index by ASTM D2270, whose formulas are at
dgaequipment.com and whose table of L and H is in ``chemicals.viscosity`` (CalebBell/chemicals). The
assumed index, which a product's data sheet would give, is 95 for ISO and single grades, as in the
chart at noco.ca/viscosity-chart, and the value in `GRADES` for multigrade oils. Density and
specific heat are the defaults of `Oil`.

**Shear thinning.** The shear rate is that of the sliding surfaces, ``gamma = |U| / h``. It is the
mean of the velocity gradient over the thickness, for every slope of the pressure. The pressure adds
a part that varies over the thickness from ``-h/2`` to ``h/2`` times ``(dp/dy) / eta``, is zero in
the middle, and is small against U / h in a sliding film. It is neglected: the viscosity is constant
across the film, and Reynolds' equation keeps its form. The oil between surfaces that do not slide,
a squeeze film, does not thin. Models with a viscosity that varies across the film (Dowson's
generalised equation) give other results if h^2 dp/dy / (2 eta U) is not small.

**Laws.** Viscosity laws for pressure, position and shear rate are multiplied. A law is the ratio of
a property to its value at ambient pressure, or at rest. One expression defines it, for arrays of
values and for UFL's symbols in the weak form, which differentiates the law
(`fenics_ehd.film.weak_form`). Position enters as a factor on viscosity or density at the Gauss
points (`Lubricant.viscosity_field`). `make_lubricant` chooses the laws of a `Lubricant` from
settings.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import attrs
import numpy as np
from scipy.special import erf

from fenics_ehd.base.arguments import require_callable, require_class, require_number
from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import SettingsError, ViscosityError
from fenics_ehd.base.fields import REQUIRED, number
from fenics_ehd.base.needs import NO_TEMPERATURE, NONE
from fenics_ehd.base.shared_settings import (
    COMPRESSIBILITY,
    DENSITY,
    SPECIFIC_HEAT,
    STIFFENING,
    OilSettings,
)

#: Zero of the Celsius scale [K].
ZERO_CELSIUS = 273.15

#: Smallest and largest kinematic viscosity at which the Walther equation needs no further terms
#: [mm2/s].
SMALLEST = 2.0
LARGEST = 2e7

#: Decrease of the density per kelvin, over the density at 15 C [1/K]. It lies between that of a
#: synthetic oil, 5.8e-4 (MadsKirkFoged/SharpFluids, SHC230.cs), and that of an engine oil with the
#: density 1061.3 - 0.5921 T, 6.7e-4.
EXPANSION = 6.5e-4


@runtime_checkable
class TemperatureLaw(Protocol):
    """Viscosity and density of an oil at any temperature, from which a `Lubricant` is made.

    The film, the heat balance and scene files use these members only. `Oil` is the Walther law;
    ``docs/extending.md`` develops the Vogel law as an example.

    Attributes
    ----------
    specific_heat
        Specific heat [J/(kg K)].
    hottest
        Highest temperature for which the law holds [C].
    """

    @property
    def specific_heat(self) -> float:
        """Specific heat [J/(kg K)]."""

    @property
    def hottest(self) -> float:
        """Highest temperature for which the law holds [C]."""

    def viscosity(self, temperature: float) -> float:
        """Dynamic viscosity at a temperature [C] and ambient pressure [Pa s].

        Raises
        ------
        SettingsError
            If the law does not hold at this temperature.
        """

    def viscosity_slope(self, temperature: float) -> float:
        """Derivative of the dynamic viscosity with respect to temperature [Pa s/K].

        Raises
        ------
        SettingsError
            If the law does not hold at this temperature.
        """

    def density(self, temperature: float) -> float:
        """Density at a temperature [C] and ambient pressure [kg/m3]."""


@dataclass(frozen=True)
class WaltherLine:
    """Walther's line ``log10 log10 (nu + 0.7) = A - B log10 T``, nu in mm2/s and T in K.

    Attributes
    ----------
    intercept, slope
        Coefficients A and B [-].
    """

    intercept: float
    slope: float

    @classmethod
    def through(cls, first: tuple[float, float], second: tuple[float, float]) -> WaltherLine:
        """Line through two pairs of temperature [C] and kinematic viscosity [mm2/s].

        Raises
        ------
        SettingsError
            If a viscosity is out of range, or does not fall with temperature.
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
        logarithm = 10 ** (self.intercept - self.slope * np.log10(temperature + ZERO_CELSIUS))
        return float(10**logarithm - 0.7)

    def derivative(self, temperature: float) -> float:
        """Derivative of the kinematic viscosity with respect to temperature [mm2/(s K)]."""
        kelvin = temperature + ZERO_CELSIUS
        logarithm = 10 ** (self.intercept - self.slope * np.log10(kelvin))
        return float(-(10**logarithm) * np.log(10.0) * self.slope * logarithm / kelvin)

    def temperature(self, viscosity: float) -> float:
        """Temperature [C] at which the kinematic viscosity has a given value [mm2/s]."""
        exponent = (self.intercept - np.log10(np.log10(viscosity + 0.7))) / self.slope
        return float(10**exponent - ZERO_CELSIUS)


@attrs.frozen
class Oil(Described):
    """Temperature law of an oil: viscosity by Walther's equation, density falling linearly.

    Raises
    ------
    SettingsError
        If a value is out of range.
    """

    viscosity_40: float = number(REQUIRED, "kinematic viscosity at 40 C [mm2/s]", above=0)
    viscosity_100: float = number(REQUIRED, "kinematic viscosity at 100 C [mm2/s]", above=0)
    density_15: float = number(DENSITY, "at 15 C [kg/m3]", above=0)
    specific_heat: float = number(SPECIFIC_HEAT, "[J/(kg K)]", above=0)
    expansion: float = number(
        EXPANSION, "relative fall of density, of that at 15 C [1/K]", least=0, below=1e-2
    )

    def __attrs_post_init__(self) -> None:
        self._line()

    @property
    def coldest(self) -> float:
        """Lowest temperature for which the Walther equation is used [C]."""
        return self._line().temperature(LARGEST)

    @property
    def hottest(self) -> float:
        """Highest temperature for which the Walther equation is used [C]."""
        return self._line().temperature(SMALLEST)

    def kinematic_viscosity(self, temperature: float) -> float:
        """Kinematic viscosity at a temperature [C], in mm2/s.

        Raises
        ------
        SettingsError
            If the temperature is below `coldest` or above `hottest`.
        """
        if not self.coldest <= temperature <= self.hottest:
            raise SettingsError(
                f"temperature = {temperature:g} C of the oil must lie between {self.coldest:.4g} C "
                f"and {self.hottest:.4g} C, at which its kinematic viscosity is {LARGEST:g} and "
                f"{SMALLEST:g} mm2/s"
            )
        return self._line()(temperature)

    def viscosity(self, temperature: float) -> float:
        """Dynamic viscosity of the oil at a temperature [C], in Pa s.

        It raises the errors of `kinematic_viscosity`.
        """
        return 1e-6 * self.kinematic_viscosity(temperature) * self.density(temperature)

    def viscosity_slope(self, temperature: float) -> float:
        """Derivative of the dynamic viscosity with respect to temperature [Pa s/K].

        It raises the errors of `kinematic_viscosity`.
        """
        viscosity = self.kinematic_viscosity(temperature)
        by_density = -self.density_15 * self.expansion * viscosity
        return 1e-6 * (
            self._line().derivative(temperature) * self.density(temperature) + by_density
        )

    def density(self, temperature: float) -> float:
        """Density at a temperature [C], in kg/m3."""
        return self.density_15 * (1.0 - self.expansion * (temperature - 15.0))

    def _line(self) -> WaltherLine:
        return WaltherLine.through((40.0, self.viscosity_40), (100.0, self.viscosity_100))


class Functions(NamedTuple):
    """Functions that the formulas of laws call: NumPy's for arrays, or UFL's for the weak form.

    Attributes
    ----------
    exp, erf
        Exponential and error function.
    where
        Function ``where(condition, a, b)``: a if the condition is true, else b. Both are evaluated,
        so that both must be defined.
    """

    exp: Callable[[Any], Any]
    erf: Callable[[Any], Any]
    where: Callable[[Any, Any, Any], Any]


ARRAYS = Functions(np.exp, erf, np.where)

#: Largest shear rate over gamma_c, and largest exponent, whose power does not overflow. Below the
#: smallest rate the oil counts as at rest, because a power of the rate has no slope at zero.
LARGEST_RELATIVE_RATE = 1e30
LARGEST_EXPONENT = 10.0
SMALLEST_RELATIVE_RATE = 1e-30


class Law(Described):
    """Law of viscosity or density: its ratio to the value at rest, or at ambient pressure.

    Laws are attrs classes or dataclasses, whose fields are the coefficients of the formula.
    """

    __match_args__: ClassVar[tuple[str, ...]] = ()

    @property
    def numbers(self) -> tuple[float, ...]:
        """Coefficients of the formula: the last arguments of `ratio`."""
        return tuple(getattr(self, name) for name in type(self).__match_args__)

    @staticmethod
    def ratio(f: Functions, at: Any, *numbers: Any) -> Any:
        """Viscosity or density over its value at ambient pressure or at rest [-].

        `at` are pressures [Pa] or shear rates [1/s], which are not negative; `numbers` are the
        coefficients of the law. `at` and `numbers` are either numbers and arrays, or symbols of
        UFL; `f` has the functions that accept them.
        """
        raise NotImplementedError

    def __call__(self, at: np.ndarray) -> np.ndarray:
        """Viscosity or density over its value at ambient pressure or at rest [-].

        `at` is an array of pressures [Pa] or of shear rates [1/s].
        """
        return self.ratio(ARRAYS, at, *self.numbers)


@attrs.frozen
class Cross(Law):
    """Cross's law ``eta = eta_2 + (eta_0 - eta_2) / (1 + (gamma / gamma_c)^m)``.

    With an exponent m below 1 the slope at rest is infinite; the law uses zero.
    """

    rate: float = number(REQUIRED, "gamma_c, for the mean of eta_0 and eta_2 [1/s]", above=0)
    exponent: float = number(1.0, "m [-]", above=0, below=LARGEST_EXPONENT)
    second: float = number(0.5, "eta_2 / eta_0 [-]", least=0, most=1)

    @staticmethod
    def ratio(f: Functions, shear_rate: Any, critical: Any, exponent: Any, second: Any) -> Any:
        """Viscosity over the viscosity at rest [-], at shear rates >= 0 [1/s]."""
        # Shear rates are limited so that powers do not overflow: the viscosity is eta_2 there.
        largest = LARGEST_RELATIVE_RATE * critical
        relative = f.where(shear_rate < largest, shear_rate, largest) / critical
        moving = relative > SMALLEST_RELATIVE_RATE
        power = f.where(moving, relative, 1.0) ** exponent
        return second + (1.0 - second) / (1.0 + f.where(moving, power, 0.0))


@dataclass(frozen=True)
class Grade:
    """Oil grade: kinematic viscosities at 40 and 100 C [mm2/s], and assumed viscosity index."""

    viscosity_40: float
    viscosity_100: float
    index: int = 95


GRADES = {
    "ISO VG 10": Grade(10, 2.637),
    "ISO VG 15": Grade(15, 3.381),
    "ISO VG 22": Grade(22, 4.254),
    "ISO VG 32": Grade(32, 5.289),
    "ISO VG 46": Grade(46, 6.645),
    "ISO VG 68": Grade(68, 8.53),
    "ISO VG 100": Grade(100, 11.07),
    "ISO VG 150": Grade(150, 14.55),
    "ISO VG 220": Grade(220, 18.75),
    "ISO VG 320": Grade(320, 23.96),
    "ISO VG 460": Grade(460, 30.35),
    "ISO VG 680": Grade(680, 39.06),
    "SAE 10": Grade(27.58, 4.85),
    "SAE 20": Grade(62.82, 8.1),
    "SAE 30": Grade(97.78, 10.9),
    "SAE 40": Grade(147.8, 14.4),
    "SAE 50": Grade(226.4, 19.1),
    "SAE 60": Grade(320.9, 24.0),
    "SAE 0W-8": Grade(24.28, 5.05, 140),
    "SAE 0W-12": Grade(30.46, 6.05, 150),
    "SAE 0W-16": Grade(36.97, 7.15, 160),
    "SAE 0W-20": Grade(43.92, 8.1, 160),
    "SAE 0W-30": Grade(63.21, 10.9, 165),
    "SAE 0W-40": Grade(83.49, 14.4, 180),
    "SAE 5W-20": Grade(46.01, 8.1, 150),
    "SAE 5W-30": Grade(64.85, 10.9, 160),
    "SAE 5W-40": Grade(88.12, 14.4, 170),
    "SAE 10W-30": Grade(72.35, 10.9, 140),
    "SAE 10W-40": Grade(98.96, 14.4, 150),
    "SAE 15W-40": Grade(105.4, 14.4, 140),
    "SAE 20W-50": Grade(173.7, 19.1, 125),
}


def _plain(name: str) -> str:
    """Name of a grade in capitals without spaces and hyphens: ``sae 5w-30`` gives SAE5W30."""
    return name.upper().replace(" ", "").replace("-", "")


def _spoken(name: str) -> tuple[str, ...]:
    """Accepted spellings of a grade's name, in the form of `_plain`: SAE5W30 and 5W30."""
    full = _plain(name)
    short = full.removeprefix("ISO").removeprefix("SAE")
    return (full, short) if not short.isdigit() else (full,)


_BY_PLAIN_NAME = {plain: name for name in GRADES for plain in _spoken(name)}


def grade_name(name: str) -> str:
    """Name in `GRADES` of a grade in any spelling.

    Raises
    ------
    SettingsError
        If the grade is not listed.
    """
    listed = _BY_PLAIN_NAME.get(_plain(name))
    if listed is None:
        raise SettingsError(
            f"grade = {name!r} is not one of {', '.join(GRADES)}: for another grade give "
            "viscosity_40 and viscosity_100"
        )
    return listed


def oil_of_grade(name: str, **properties: float) -> Oil:
    """Make an oil of a named grade; `properties` are further arguments of `Oil`."""
    grade = GRADES[grade_name(name)]
    return Oil(grade.viscosity_40, grade.viscosity_100, **properties)


#: Largest ratio of viscosities for which a film is solved: real oil is a glass at far smaller ones.
LARGEST_RATIO = 1e30


class PressureLaw(Law):
    """Law of viscosity or density as a function of pressure.

    Attributes
    ----------
    constant
        Whether viscosity or density is the same at every pressure.
    """

    constant: ClassVar[bool] = False

    def __call__(self, pressure: np.ndarray) -> np.ndarray:
        """Viscosity or density over its value at ambient pressure [-], at pressures >= 0 [Pa].

        Raises
        ------
        ViscosityError
            If the ratio is above `LARGEST_RATIO`, or not a number.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            ratio = np.ones_like(pressure) * super().__call__(pressure)
        if not ratio.max(initial=0.0) <= LARGEST_RATIO:
            raise ViscosityError(
                f"the viscosity runs away with the pressure: at {pressure.max() * 1e-6:.4g} MPa it "
                f"is more than {LARGEST_RATIO:g} times that at ambient pressure: lower the load or "
                "the pressure coefficient (barus, roelands)"
            )
        return ratio


@dataclass(frozen=True)
class Constant(PressureLaw):
    """Law of a property that is the same at every pressure."""

    constant: ClassVar[bool] = True

    @staticmethod
    def ratio(f: Functions, pressure: Any) -> Any:
        """Viscosity or density over its value at ambient pressure: 1 at every pressure."""
        return 1.0


@attrs.frozen
class Barus(PressureLaw):
    """Barus' law of viscosity, ``eta = eta_0 exp(alpha p)`` (1893)."""

    coefficient: float = number(REQUIRED, "alpha [1/Pa]", above=0)

    @staticmethod
    def ratio(f: Functions, pressure: Any, coefficient: Any) -> Any:
        """Viscosity over the viscosity at ambient pressure [-]."""
        return f.exp(coefficient * pressure)


@attrs.frozen
class Roelands(PressureLaw):
    """Roelands' law, ``eta = eta_0 exp((ln eta_0 + 9.67) ((1 + p / 0.196 GPa)^Z - 1))`` (1966)."""

    viscosity: float = number(REQUIRED, "eta_0 at ambient pressure, above exp(-9.67) [Pa s]")
    index: float = number(0.6, "pressure index Z [-], 0.6 for mineral oils", above=0)

    #: Logarithm of Roelands' limit viscosity, 6.315e-5 Pa s, and his reference pressure [Pa].
    LOG_LIMIT = -9.67
    REFERENCE = 1.96e8

    def __attrs_post_init__(self) -> None:
        if not self.viscosity > np.exp(self.LOG_LIMIT):
            raise SettingsError(
                f"viscosity = {self.viscosity:g} Pa s must be above 6.3e-5 Pa s for Roelands' law"
            )

    @property
    def numbers(self) -> tuple[float, ...]:
        """Factor ``ln eta_0 + 9.67`` and pressure index Z of the exponent."""
        return float(np.log(self.viscosity)) - self.LOG_LIMIT, self.index

    @staticmethod
    def ratio(f: Functions, pressure: Any, strength: Any, index: Any) -> Any:
        """Viscosity over the viscosity at ambient pressure [-]."""
        return f.exp(strength * ((1 + pressure / Roelands.REFERENCE) ** index - 1))


@attrs.frozen
class DowsonHigginson(PressureLaw):
    """Dowson and Higginson's law of density, ``rho = rho_0 (1 + a p / (1 + b p))`` (1966)."""

    compressibility: float = number(COMPRESSIBILITY, "a [1/Pa]", least=0)
    stiffening: float = number(STIFFENING, "b [1/Pa]", least=0)

    @staticmethod
    def ratio(f: Functions, pressure: Any, compressibility: Any, stiffening: Any) -> Any:
        """Density over the density at ambient pressure [-]."""
        return 1 + compressibility * pressure / (1 + stiffening * pressure)


#: Function of angles [rad] and heights [m] of points on the bore that returns a factor [-].
Field = Callable[[np.ndarray, np.ndarray], np.ndarray]


@attrs.frozen
class Lubricant(Described):
    """Properties of the oil of a film, with the laws by which they change."""

    viscosity: float = number(REQUIRED, "dynamic, at ambient pressure [Pa s]", above=0)
    #: Laws of viscosity and density as functions of pressure.
    viscosity_law: PressureLaw = attrs.field(factory=Constant)
    density_law: PressureLaw = attrs.field(factory=Constant)
    #: Factors on viscosity and density that depend on position, for a known temperature field for
    #: instance; None for an oil that is the same everywhere.
    viscosity_field: Field | None = None
    density_field: Field | None = None
    # The film's pressure does not depend on these two: they convert volume flows to mass and heat.
    density: float = number(DENSITY, "at ambient pressure [kg/m3]", above=0)
    specific_heat: float = number(SPECIFIC_HEAT, "at ambient pressure [J/(kg K)]", above=0)
    #: Law of temperature; None if viscosity and density are known at one temperature only.
    oil: TemperatureLaw | None = None
    #: Temperature at which viscosity and density hold [C]; None if unknown.
    temperature: float | None = None
    #: Law of viscosity as a function of shear rate; None if the oil does not thin.
    shear_law: Law | None = None

    def __attrs_post_init__(self) -> None:
        for name in ("viscosity_law", "density_law"):
            require_class(name, getattr(self, name), PressureLaw)
        for name in ("viscosity_field", "density_field"):
            require_callable(name, getattr(self, name), optional=True)
        if not isinstance(self.oil, TemperatureLaw):
            require_class("oil", self.oil, Oil, optional=True)
        require_class("shear_law", self.shear_law, Law, optional=True)
        if self.temperature is not None:
            require_number("temperature", self.temperature, above=NO_TEMPERATURE)

    @classmethod
    def of(cls, oil: TemperatureLaw, temperature: float) -> Lubricant:
        """Make a lubricant of an oil at a temperature [C], without dependence on pressure.

        Raises
        ------
        SettingsError
            If the oil's law does not hold at this temperature.
        """
        return cls(
            oil.viscosity(temperature),
            density=oil.density(temperature),
            specific_heat=oil.specific_heat,
            oil=oil,
            temperature=temperature,
        )

    def at(self, temperature: float) -> Lubricant:
        """Return this lubricant at another temperature [C], with the same laws and fields.

        Roelands' law uses the viscosity at the new temperature as eta_0; the coefficients of Barus'
        and Cross's laws do not change.

        Raises
        ------
        SettingsError
            If the lubricant has no law of temperature, or its law does not hold at `temperature`.
        """
        if self.oil is None:
            raise SettingsError(
                f"the lubricant has only a viscosity of {self.viscosity:g} Pa s; its viscosity at "
                f"{temperature:g} C is unknown: give a grade, or viscosity_40 and viscosity_100"
            )
        there = self.of(self.oil, temperature)
        law = self.viscosity_law
        if isinstance(law, Roelands):
            law = attrs.evolve(law, viscosity=there.viscosity)
        return attrs.evolve(
            self,
            viscosity=there.viscosity,
            viscosity_law=law,
            density=there.density,
            temperature=temperature,
        )

    @property
    def linear(self) -> bool:
        """Whether the Reynolds equation is linear in the pressure: no law of pressure is in use."""
        return self.viscosity_law.constant and self.density_law.constant


def make_lubricant(settings: OilSettings) -> Lubricant:
    """Make a lubricant from settings.

    Raises
    ------
    SettingsError
        If settings contradict each other, or one is missing.
    """
    viscosity = settings.viscosity
    oil = _oil(settings)
    temperature = None if settings.temperature <= NO_TEMPERATURE else settings.temperature
    if oil is None:
        density = settings.density
    elif temperature is None:
        raise SettingsError(
            "temperature is missing: an oil with a grade or kinematic viscosities needs it [C]"
        )
    else:
        viscosity = oil.viscosity(temperature)
        density = oil.density(temperature)
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


#: Temperature law for every value of `OilSettings.temperature_law`. It is called with the kinematic
#: viscosities at 40 and 100 C [mm2/s] and the keywords ``density_15`` and ``specific_heat``.
LAWS_OF_TEMPERATURE: Mapping[str, Callable[..., TemperatureLaw]] = {"walther": Oil}


def _oil(settings: OilSettings) -> TemperatureLaw | None:
    """Temperature law from settings; None if they have a viscosity instead."""
    kinematic = settings.viscosity_40, settings.viscosity_100
    graded = settings.grade != NONE
    if bool(settings.viscosity) + graded + any(kinematic) != 1:
        raise SettingsError(
            "give exactly one of: viscosity, grade, viscosity_40 with viscosity_100; their values "
            f"are {settings.viscosity:g} Pa s, {settings.grade!r}, {kinematic[0]:g} and "
            f"{kinematic[1]:g} mm2/s"
        )
    if settings.viscosity:
        return None
    properties = {"density_15": settings.density, "specific_heat": settings.specific_heat}
    law = LAWS_OF_TEMPERATURE[settings.temperature_law]
    if graded:
        grade = GRADES[grade_name(settings.grade)]
        return law(grade.viscosity_40, grade.viscosity_100, **properties)
    if not all(kinematic):
        missing = "viscosity_40" if settings.viscosity_100 else "viscosity_100"
        raise SettingsError(f"{missing} is missing [mm2/s]: give both kinematic viscosities")
    return law(*kinematic, **properties)


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
    return Constant()


def _shear_law(settings: OilSettings) -> Law | None:
    if settings.cross_rate:
        return Cross(settings.cross_rate, settings.cross_exponent, settings.cross_second_viscosity)
    return None
