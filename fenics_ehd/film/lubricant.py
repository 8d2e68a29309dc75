"""Viscosity and density of the oil as functions of pressure, position and temperature.

A law gives the ratio to the value at ambient pressure and its derivative, both
at arrays of pressures [Pa]. Position enters by a factor on either, given at
the Gauss points (`Lubricant.viscosity_field`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from fenics_ehd.base.errors import SettingsError, ViscosityError
from fenics_ehd.base.oil import COMPRESSIBILITY, DENSITY, SPECIFIC_HEAT, STIFFENING
from fenics_ehd.film.temperature import Oil
from fenics_ehd.film.thinning import Cross

#: Ratio of viscosities beyond which no film is looked for: oil is glass long before.
LARGEST_RATIO = 1e30


class PressureLaw(Protocol):
    """Ratio of a property to its value at zero pressure."""

    @property
    def constant(self) -> bool:
        """Whether the property is the same at every pressure."""

    def __call__(self, pressure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Ratio [-] and its derivative [1/Pa] at pressures [Pa]."""


def _positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise SettingsError(f"{name} = {value:g} must be above 0")


def _power(exponent: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    """Ratio of viscosities exp(exponent) at pressures [Pa].

    Raises
    ------
    ViscosityError
        It is beyond `LARGEST_RATIO`, or no number.
    """
    if not exponent.max(initial=0.0) <= np.log(LARGEST_RATIO):
        raise ViscosityError(
            f"the viscosity runs away with the pressure: at {pressure.max() * 1e-6:.4g} MPa it is "
            f"more than {LARGEST_RATIO:g} times that at ambient pressure: lower the load or the "
            "pressure coefficient (barus, roelands)"
        )
    return np.exp(exponent)


@dataclass(frozen=True)
class Constant:
    """The same at every pressure."""

    constant: bool = field(default=True, init=False)

    def __call__(self, pressure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `PressureLaw`."""
        return np.ones_like(pressure), np.zeros_like(pressure)


@dataclass(frozen=True)
class Barus:
    """``eta = eta_0 exp(alpha p)`` (Barus 1893), `coefficient` alpha [1/Pa]."""

    coefficient: float
    constant: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        _positive("the Barus pressure coefficient", self.coefficient)

    def __call__(self, pressure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `PressureLaw`."""
        ratio = _power(self.coefficient * pressure, pressure)
        return ratio, self.coefficient * ratio


@dataclass(frozen=True)
class Roelands:
    """``eta = eta_0 exp((ln eta_0 + 9.67) ((1 + p / 0.196 GPa)^Z - 1))`` (Roelands 1966).

    Attributes
    ----------
    viscosity
        eta_0 at ambient pressure [Pa s], above exp(-9.67) = 6.3e-5.
    index
        Pressure index Z [-], 0.6 for mineral oils.
    """

    viscosity: float
    index: float = 0.6
    constant: bool = field(default=False, init=False)

    #: ln of Roelands' limit viscosity 6.315e-5 Pa s and his reference pressure [Pa].
    LOG_LIMIT = -9.67
    REFERENCE = 1.96e8

    def __post_init__(self) -> None:
        _positive("the Roelands index", self.index)
        if not self.viscosity > np.exp(self.LOG_LIMIT):
            raise SettingsError(
                f"viscosity = {self.viscosity:g} Pa s must be above 6.3e-5 Pa s for Roelands' law"
            )

    def __call__(self, pressure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `PressureLaw`."""
        strength = np.log(self.viscosity) - self.LOG_LIMIT
        base = 1 + pressure / self.REFERENCE
        ratio = _power(strength * (base**self.index - 1), pressure)
        slope = strength * self.index / self.REFERENCE * base ** (self.index - 1)
        return ratio, ratio * slope


@dataclass(frozen=True)
class DowsonHigginson:
    """``rho = rho_0 (1 + a p / (1 + b p))`` (Dowson and Higginson 1966).

    Attributes
    ----------
    compressibility, stiffening
        a and b [1/Pa].
    """

    compressibility: float = COMPRESSIBILITY
    stiffening: float = STIFFENING
    constant: bool = field(default=False, init=False)

    def __call__(self, pressure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `PressureLaw`."""
        stiff = 1 + self.stiffening * pressure
        return 1 + self.compressibility * pressure / stiff, self.compressibility / stiff**2


#: Factor [-] at angles [rad] and heights [m] of points on the bore.
Field = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Lubricant:
    """One oil.

    Attributes
    ----------
    viscosity
        Dynamic viscosity at ambient pressure [Pa s].
    viscosity_law, density_law
        How they change with pressure.
    viscosity_field, density_field
        Factors that depend on the place, of a known temperature for instance;
        None for an oil that is the same everywhere.
    density, specific_heat
        At ambient pressure [kg/m3], [J/(kg K)]. The film's pressure does not depend on them:
        they make masses and heat of the volumes that flow.
    oil
        What the lubricant is at other temperatures; None: not known.
    temperature
        The one that `viscosity` and `density` belong to [C]; None: not known.
    shear_law
        How the viscosity falls with the shear rate; None: it does not.
    """

    viscosity: float
    viscosity_law: PressureLaw = field(default_factory=Constant)
    density_law: PressureLaw = field(default_factory=Constant)
    viscosity_field: Field | None = None
    density_field: Field | None = None
    density: float = DENSITY
    specific_heat: float = SPECIFIC_HEAT
    oil: Oil | None = None
    temperature: float | None = None
    shear_law: Cross | None = None

    def __post_init__(self) -> None:
        _positive("viscosity", self.viscosity)
        _positive("density", self.density)
        _positive("specific_heat", self.specific_heat)

    @classmethod
    def of(cls, oil: Oil, temperature: float) -> Lubricant:
        """An oil at a temperature [C], its viscosity the same at every pressure.

        Raises
        ------
        SettingsError
            See `Oil.kinematic_viscosity`.
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
            What it is at other temperatures is not known, or see `Oil.kinematic_viscosity`.
        """
        if self.oil is None:
            raise SettingsError(
                f"a lubricant of viscosity = {self.viscosity:g} Pa s has no other at "
                f"{temperature:g} C: give a grade, or viscosity_40 and viscosity_100"
            )
        there = self.of(self.oil, temperature)
        law = self.viscosity_law
        if isinstance(law, Roelands):
            law = replace(law, viscosity=there.viscosity)
        return replace(
            self,
            viscosity=there.viscosity,
            viscosity_law=law,
            density=there.density,
            temperature=temperature,
        )

    @property
    def linear(self) -> bool:
        """Whether the Reynolds equation is linear in the pressure."""
        return self.viscosity_law.constant and self.density_law.constant
