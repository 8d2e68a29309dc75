"""Shear thinning: viscosity as a function of the shear rate.

The shear rate is that of the sliding surfaces, ``gamma = |U| / h``. It is the mean of du/dy over
the thickness whatever the pressure's slope is, whose own part is antisymmetric: ``-h/2`` to
``h/2`` times ``(dp/dy) / eta``, zero in the middle and small beside U / h in a sliding film. So
the viscosity is one number across the film and Reynolds' equation keeps its form; the film of
surfaces that do not slide, a squeeze film, does not thin. Sources that carry the variation across
the film (Dowson's generalised equation) differ where h^2 dp/dy / (2 eta U) is not small.

Viscosity laws are multiplied: of pressure, of place, of shear rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.base.errors import SettingsError

#: Shear rate over gamma_c, and exponent, whose power is still a number; and the rate below which
#: oil is at rest.
LARGEST_RELATIVE_RATE, LARGEST_EXPONENT, SMALLEST_RELATIVE_RATE = 1e30, 10.0, 1e-30


@dataclass(frozen=True)
class Cross:
    """Cross's law ``eta = eta_2 + (eta_0 - eta_2) / (1 + (gamma / gamma_c)^m)``.

    Attributes
    ----------
    rate
        gamma_c [1/s], at which half of what can go is gone.
    exponent
        m [-]. Below 1 the slope at rest is infinite; it is taken as none.
    second
        ``eta_2 / eta_0``, the second viscosity over the first [-].
    """

    rate: float
    exponent: float = 1.0
    second: float = 0.5

    def __post_init__(self) -> None:
        if not (np.isfinite(self.rate) and self.rate > 0):
            raise SettingsError(f"rate = {self.rate:g} 1/s of Cross's law must be above 0")
        if not 0 < self.exponent < LARGEST_EXPONENT:
            raise SettingsError(
                f"exponent = {self.exponent:g} of Cross's law must be above 0 and below "
                f"{LARGEST_EXPONENT:g}"
            )
        if not 0 <= self.second <= 1:
            raise SettingsError(f"second = {self.second:g} of Cross's law must lie in 0..1")

    def __call__(self, shear_rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Ratio [-] to the viscosity at rest and its derivative [s], at shear rates >= 0 [1/s]."""
        # At the largest numbers that still have powers all that can go is gone.
        relative = np.minimum(shear_rate, LARGEST_RELATIVE_RATE * self.rate) / self.rate
        share = 1.0 / (1.0 + relative**self.exponent)
        change = -(1.0 - self.second) * self.exponent * share * (1.0 - share)
        moving = relative > SMALLEST_RELATIVE_RATE
        slope = np.divide(change, shear_rate, out=np.zeros_like(change), where=moving)
        return self.second + (1.0 - self.second) * share, slope


@dataclass(frozen=True, eq=False)
class Thinning:
    """Effect of the shear rate on the viscosity at the Gauss points, each (cells, points).

    Attributes
    ----------
    ratio
        To the viscosity at rest.
    along_thickness, along_sliding
        Derivatives of its logarithm along the thickness and the sliding velocity, dimensionless
        as these are.
    """

    ratio: np.ndarray
    along_thickness: np.ndarray
    along_sliding: np.ndarray


def thinning(
    law: Cross, thickness: np.ndarray, sliding: np.ndarray, length: float, speed: float
) -> Thinning:
    """Of a gap [m] and its sliding velocity [m/s], in units of a length [m] and a speed [m/s]."""
    rate = np.abs(sliding) / thickness
    ratio, slope = law(rate)
    relative = slope / ratio
    return Thinning(
        ratio,
        -relative * rate * length / thickness,
        relative * np.sign(sliding) * speed / thickness,
    )
