"""Viscosity and density of an oil: pressure, temperature, shear rate, named grades.

**Temperature.** Kinematic viscosity follows the Walther equation of ASTM D341,

    log10 log10 (nu + 0.7) = A - B log10 T,    nu in mm2/s, T in K,

through its values at 40 and 100 C. The standard adds terms that matter below 2 mm2/s: temperatures
at which nu is above `LARGEST` or below `SMALLEST` are refused. Density falls linearly. Dynamic
viscosity is their product.

**Grades.** A grade has two nominal kinematic viscosities. The standard specifies one of them:
ISO 3448 the number of an ISO VG grade at 40 C, SAE J300 a range at 100 C, whose middle is taken
(fuchs.com, "Viscosity charts"; "SAE 10", a winter grade, has the range from 4.1 mm2/s to the lower
limit of 15W). The other follows from an assumed viscosity index by ASTM D2270, whose formulas are
at dgaequipment.com and whose table of L and H is in ``chemicals.viscosity`` (CalebBell/chemicals).
Indices replace a product's data sheet: 95 for ISO and single grades, as in the chart at
noco.ca/viscosity-chart, and the values of `GRADES` for multigrade oils. Density and specific heat
are the defaults of `Oil`.

**Shear thinning.** The shear rate is that of the sliding surfaces, ``gamma = |U| / h``. It is the
mean of du/dy over the thickness for every slope of the pressure. The contribution of the pressure
is antisymmetric: ``-h/2`` to ``h/2`` times ``(dp/dy) / eta``, zero in the middle and small against
U / h in a sliding film. The viscosity is therefore constant across the film, and Reynolds' equation
keeps its form. The oil between surfaces that do not slide, a squeeze film, does not thin. Models
with a viscosity that varies across the film (Dowson's generalised equation) differ if h^2 dp/dy /
(2 eta U) is not small.

**Laws.** Viscosity laws for pressure, position and shear rate are multiplied. A law is the ratio to
the value at ambient pressure, or at rest. One expression defines it, for arrays of values and for
UFL's symbols in the weak form, which differentiates the law (`fenics_ehd.film.weak_form`). Position
enters by a factor on either property, given at the Gauss points (`Lubricant.viscosity_field`).
Settings choose the laws of a `Lubricant` in `make_lubricant`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import attrs
import numpy as np
from scipy.special import erf

from fenics_ehd.base.arguments import require_callable, require_class, require_number
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

#: Decrease of the density per kelvin, over the density at 15 C [1/K]: between the 5.8e-4 of a
#: synthetic oil (MadsKirkFoged/SharpFluids, SHC230.cs) and the 6.7e-4 of an engine oil of 1061.3 -
#: 0.5921 T.
EXPANSION = 6.5e-4


@runtime_checkable
class TemperatureLaw(Protocol):
    """Viscosity and density of an oil at every temperature, from which a `Lubricant` is made.

    The film, the heat balance and scene files use these members only. `Oil` is the Walther law; the
    Vogel law is worked in ``docs/extending.md``.

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
        """Dynamic viscosity at a temperature [C], at ambient pressure [Pa s].

        Raises
        ------
        SettingsError
            The law does not hold at this temperature.
        """

    def viscosity_slope(self, temperature: float) -> float:
        """Derivative of the dynamic viscosity along the temperature [Pa s/K]; errors likewise."""

    def density(self, temperature: float) -> float:
        """Density at a temperature [C], at ambient pressure [kg/m3]."""


@dataclass(frozen=True)
class WaltherLine:
    """Line of the doubly logarithmic kinematic viscosity over the logarithmic temperature.

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
        logarithm = 10 ** (self.intercept - self.slope * np.log10(temperature + ZERO_CELSIUS))
        return float(10**logarithm - 0.7)

    def derivative(self, temperature: float) -> float:
        """Derivative of the kinematic viscosity along the temperature [mm2/(s K)]."""
        kelvin = temperature + ZERO_CELSIUS
        logarithm = 10 ** (self.intercept - self.slope * np.log10(kelvin))
        return float(-(10**logarithm) * np.log(10.0) * self.slope * logarithm / kelvin)

    def temperature(self, viscosity: float) -> float:
        """Temperature of a kinematic viscosity [mm2/s] [C]."""
        exponent = (self.intercept - np.log10(np.log10(viscosity + 0.7))) / self.slope
        return float(10**exponent - ZERO_CELSIUS)


@attrs.frozen
class Oil:
    """A `TemperatureLaw`: kinematic viscosity by Walther's equation, density falling linearly.

    Raises
    ------
    SettingsError
        A value is out of range.
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
        """Temperature below which the Walther equation is refused [C]."""
        return self._line().temperature(LARGEST)

    @property
    def hottest(self) -> float:
        """Temperature above which the Walther equation is refused [C]."""
        return self._line().temperature(SMALLEST)

    def kinematic_viscosity(self, temperature: float) -> float:
        """Kinematic viscosity at a temperature [mm2/s].

        Raises
        ------
        SettingsError
            At this temperature it is out of the range of the Walther equation.
        """
        if not self.coldest <= temperature <= self.hottest:
            raise SettingsError(
                f"temperature = {temperature:g} C of the oil must lie between {self.coldest:.4g} C "
                f"and {self.hottest:.4g} C, where its kinematic viscosity is {LARGEST:g} and "
                f"{SMALLEST:g} mm2/s"
            )
        return self._line()(temperature)

    def viscosity(self, temperature: float) -> float:
        """Dynamic viscosity [Pa s]; errors as `kinematic_viscosity`."""
        return 1e-6 * self.kinematic_viscosity(temperature) * self.density(temperature)

    def viscosity_slope(self, temperature: float) -> float:
        """Derivative of the dynamic viscosity [Pa s/K]; errors as `kinematic_viscosity`."""
        viscosity = self.kinematic_viscosity(temperature)
        by_density = -self.density_15 * self.expansion * viscosity
        return 1e-6 * (
            self._line().derivative(temperature) * self.density(temperature) + by_density
        )

    def density(self, temperature: float) -> float:
        """Density at a temperature [kg/m3]."""
        return self.density_15 * (1.0 - self.expansion * (temperature - 15.0))

    def _line(self) -> WaltherLine:
        return WaltherLine.through((40.0, self.viscosity_40), (100.0, self.viscosity_100))


class Functions(NamedTuple):
    """Functions in the expressions of laws: of arrays here, of UFL's expressions in the weak form.

    Attributes
    ----------
    exp, erf
        Functions of one argument.
    where
        Function of a condition and two values. Both values are evaluated: both must be defined.
    """

    exp: Callable[[Any], Any]
    erf: Callable[[Any], Any]
    where: Callable[[Any, Any, Any], Any]


ARRAYS = Functions(np.exp, erf, np.where)

#: Largest shear rate over gamma_c, and largest exponent, whose power does not overflow; and the
#: rate below which oil counts as at rest, because a power of the rate has no slope at zero.
LARGEST_RELATIVE_RATE = 1e30
LARGEST_EXPONENT = 10.0
SMALLEST_RELATIVE_RATE = 1e-30


class Law:
    """Formula of the ratio of a property to its value at rest, or at ambient pressure.

    Laws are classes of attrs, or dataclasses, whose fields are the formula's numbers.
    """

    __match_args__: ClassVar[tuple[str, ...]] = ()

    @property
    def numbers(self) -> tuple[float, ...]:
        """Arguments of `ratio`."""
        return tuple(getattr(self, name) for name in type(self).__match_args__)

    @staticmethod
    def ratio(f: Functions, at: Any, *numbers: Any) -> Any:
        """Ratio [-] at pressures [Pa] or shear rates [1/s] >= 0.

        The arguments are arrays and numbers, or UFL's expressions and constants; `f` has the
        conditions and functions for them.
        """
        raise NotImplementedError

    def __call__(self, at: np.ndarray) -> np.ndarray:
        """Ratio [-] of arrays."""
        return self.ratio(ARRAYS, at, *self.numbers)


@attrs.frozen
class Cross(Law):
    """Cross's law ``eta = eta_2 + (eta_0 - eta_2) / (1 + (gamma / gamma_c)^m)``.

    With an exponent m below 1 the slope at rest is infinite; the law uses zero.
    """

    rate: float = number(REQUIRED, "gamma_c, at which half of what can go is gone [1/s]", above=0)
    exponent: float = number(1.0, "m [-]", above=0, below=LARGEST_EXPONENT)
    second: float = number(0.5, "eta_2 / eta_0 [-]", least=0, most=1)

    @staticmethod
    def ratio(f: Functions, shear_rate: Any, critical: Any, exponent: Any, second: Any) -> Any:
        """Viscosity over that at rest, of shear rates >= 0 [1/s]."""
        # At the largest numbers whose powers do not overflow the viscosity has fallen to eta_2.
        largest = LARGEST_RELATIVE_RATE * critical
        relative = f.where(shear_rate < largest, shear_rate, largest) / critical
        moving = relative > SMALLEST_RELATIVE_RATE
        power = f.where(moving, relative, 1.0) ** exponent
        return second + (1.0 - second) / (1.0 + f.where(moving, power, 0.0))


@dataclass(frozen=True)
class Grade:
    """Nominal kinematic viscosities at 40 and 100 C [mm2/s] and the assumed viscosity index."""

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
    """Name of a grade without variations of spelling: ``sae 5w30`` is SAE 5W-30."""
    return name.upper().replace(" ", "").replace("-", "")


def _spoken(name: str) -> tuple[str, ...]:
    """Short names of a listed grade: ``VG 32`` is ISO VG 32, ``5W-30`` is SAE 5W-30."""
    full = _plain(name)
    short = full.removeprefix("ISO").removeprefix("SAE")
    return (full, short) if not short.isdigit() else (full,)


_BY_PLAIN_NAME = {plain: name for name in GRADES for plain in _spoken(name)}


def grade_name(name: str) -> str:
    """Name of a grade in `GRADES`, however it is spelled.

    Raises
    ------
    SettingsError
        The grade is not listed.
    """
    listed = _BY_PLAIN_NAME.get(_plain(name))
    if listed is None:
        raise SettingsError(
            f"grade = {name!r} is not one of {', '.join(GRADES)}: give viscosity_40 and "
            "viscosity_100 of another"
        )
    return listed


def oil_of_grade(name: str, **properties: float) -> Oil:
    """Oil of a named grade; `properties` of `Oil` in place of its defaults."""
    grade = GRADES[grade_name(name)]
    return Oil(grade.viscosity_40, grade.viscosity_100, **properties)


#: Ratio of viscosities beyond which no solution is computed: oil is glass at much smaller ratios.
LARGEST_RATIO = 1e30


class PressureLaw(Law):
    """Law of the pressure; it refuses pressures at which oil is glass.

    Attributes
    ----------
    constant
        Whether the property is the same at every pressure.
    """

    constant: ClassVar[bool] = False

    def __call__(self, pressure: np.ndarray) -> np.ndarray:
        """Ratio [-] at pressures >= 0 [Pa].

        Raises
        ------
        ViscosityError
            The ratio is above `LARGEST_RATIO`, or not a number.
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
        """One, as a number."""
        return 1.0


@attrs.frozen
class Barus(PressureLaw):
    """``eta = eta_0 exp(alpha p)`` (Barus 1893)."""

    coefficient: float = number(REQUIRED, "alpha [1/Pa]", above=0)

    @staticmethod
    def ratio(f: Functions, pressure: Any, coefficient: Any) -> Any:
        """Exponential of the pressure."""
        return f.exp(coefficient * pressure)


@attrs.frozen
class Roelands(PressureLaw):
    """``eta = eta_0 exp((ln eta_0 + 9.67) ((1 + p / 0.196 GPa)^Z - 1))`` (Roelands 1966)."""

    viscosity: float = number(REQUIRED, "eta_0 at ambient pressure, above exp(-9.67) [Pa s]")
    index: float = number(0.6, "pressure index Z [-], 0.6 for mineral oils", above=0)

    #: ln of Roelands' limit viscosity 6.315e-5 Pa s and his reference pressure [Pa].
    LOG_LIMIT = -9.67
    REFERENCE = 1.96e8

    def __attrs_post_init__(self) -> None:
        if not self.viscosity > np.exp(self.LOG_LIMIT):
            raise SettingsError(
                f"viscosity = {self.viscosity:g} Pa s must be above 6.3e-5 Pa s for Roelands' law"
            )

    @property
    def numbers(self) -> tuple[float, ...]:
        """Factor and index Z of the exponent."""
        return float(np.log(self.viscosity)) - self.LOG_LIMIT, self.index

    @staticmethod
    def ratio(f: Functions, pressure: Any, strength: Any, index: Any) -> Any:
        """Viscosity of Roelands' formula over that without pressure."""
        return f.exp(strength * ((1 + pressure / Roelands.REFERENCE) ** index - 1))


@attrs.frozen
class DowsonHigginson(PressureLaw):
    """``rho = rho_0 (1 + a p / (1 + b p))`` (Dowson and Higginson 1966)."""

    compressibility: float = number(COMPRESSIBILITY, "a [1/Pa]", least=0)
    stiffening: float = number(STIFFENING, "b [1/Pa]", least=0)

    @staticmethod
    def ratio(f: Functions, pressure: Any, compressibility: Any, stiffening: Any) -> Any:
        """Density of Dowson and Higginson's formula over that without pressure."""
        return 1 + compressibility * pressure / (1 + stiffening * pressure)


#: Factor [-] at angles [rad] and heights [m] of points on the bore.
Field = Callable[[np.ndarray, np.ndarray], np.ndarray]


@attrs.frozen
class Lubricant:
    """One oil."""

    viscosity: float = number(REQUIRED, "dynamic, at ambient pressure [Pa s]", above=0)
    #: How viscosity and density change with pressure.
    viscosity_law: PressureLaw = attrs.field(factory=Constant)
    density_law: PressureLaw = attrs.field(factory=Constant)
    #: Factors that depend on the place, of a known temperature for instance; None for an oil that
    #: is the same everywhere.
    viscosity_field: Field | None = None
    density_field: Field | None = None
    # The film's pressure does not depend on these two: they make masses and heat of the volumes
    # that flow.
    density: float = number(DENSITY, "at ambient pressure [kg/m3]", above=0)
    specific_heat: float = number(SPECIFIC_HEAT, "at ambient pressure [J/(kg K)]", above=0)
    #: Law of the temperature; None: viscosity and density are known at one temperature only.
    oil: TemperatureLaw | None = None
    #: Temperature of viscosity and density [C]; None: not known.
    temperature: float | None = None
    #: How the viscosity falls with the shear rate; None: it does not.
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
        """An oil at a temperature [C], its viscosity the same at every pressure.

        Raises
        ------
        SettingsError
            See `TemperatureLaw.viscosity`.
        """
        return cls(
            oil.viscosity(temperature),
            density=oil.density(temperature),
            specific_heat=oil.specific_heat,
            oil=oil,
            temperature=temperature,
        )

    def at(self, temperature: float) -> Lubricant:
        """The same lubricant at another temperature [C], its laws and fields kept.

        Roelands' law starts from the viscosity there; Barus' and Cross's numbers stay.

        Raises
        ------
        SettingsError
            The lubricant has no law of the temperature, or see `TemperatureLaw.viscosity`.
        """
        if self.oil is None:
            raise SettingsError(
                f"a lubricant of viscosity = {self.viscosity:g} Pa s has no other at "
                f"{temperature:g} C: give a grade, or viscosity_40 and viscosity_100"
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
        """True if the Reynolds equation is linear in the pressure."""
        return self.viscosity_law.constant and self.density_law.constant


def make_lubricant(settings: OilSettings, viscosity: float | None = None) -> Lubricant:
    """Make a lubricant of settings, or with another `viscosity` [Pa s] than they have.

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


#: Law of every word of `OilSettings.temperature_law`, made of the kinematic viscosities at 40 and
#: 100 C [mm2/s] with the keywords ``density_15`` and ``specific_heat``.
LAWS_OF_TEMPERATURE: Mapping[str, Callable[..., TemperatureLaw]] = {"walther": Oil}


def _oil(settings: OilSettings, viscosity: float) -> TemperatureLaw | None:
    """Temperature law of the settings; None if they give a viscosity."""
    kinematic = settings.viscosity_40, settings.viscosity_100
    graded = settings.grade != NONE
    if bool(viscosity) + graded + any(kinematic) != 1:
        raise SettingsError(
            "give a viscosity, a grade, or viscosity_40 and viscosity_100, one of them"
        )
    if viscosity:
        return None
    properties = {"density_15": settings.density, "specific_heat": settings.specific_heat}
    law = LAWS_OF_TEMPERATURE[settings.temperature_law]
    if graded:
        grade = GRADES[grade_name(settings.grade)]
        return law(grade.viscosity_40, grade.viscosity_100, **properties)
    if not all(kinematic):
        missing = "viscosity_40" if settings.viscosity_100 else "viscosity_100"
        raise SettingsError(f"{missing} is missing: kinematic viscosities come in pairs [mm2/s]")
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
