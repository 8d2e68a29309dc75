"""Balance of the oil in a full film: the weak form of (1) and its derivatives, dimensionless."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fenics_ehd.film.assembly import Assembly, Coefficients
from fenics_ehd.film.thinning import Thinning


@dataclass(frozen=True, eq=False)
class OilProperties:
    """Dimensionless oil properties with derivatives along P, and those of P, at Gauss points.

    `conductance` gives the factor of rough surfaces on the mobility at thicknesses, and its
    derivative; None: they are smooth.
    """

    around: np.ndarray
    along: np.ndarray
    viscosity: np.ndarray
    viscosity_derivative: np.ndarray
    density: np.ndarray
    density_derivative: np.ndarray
    expansion: np.ndarray
    expansion_derivative: np.ndarray
    thinning: Thinning | None = None
    conductance: Callable[[np.ndarray], np.ndarray] | None = None

    def mobility(self, thickness: np.ndarray) -> np.ndarray:
        """``k = rho H^3 / eta``."""
        smooth = self.density * thickness**3 / self.viscosity
        return smooth if self.conductance is None else smooth * self.conductance(thickness)[0]

    def mobility_slope(self, thickness: np.ndarray) -> np.ndarray:
        """``dk / dH``."""
        if self.conductance is None:
            return 3 * self.mobility(thickness) / thickness
        factor, along = self.conductance(thickness)
        smooth = self.density * thickness**3 / self.viscosity
        return smooth * (3 * factor / thickness + along)


def balance(
    assembly: Assembly,
    oil: OilProperties,
    thickness: np.ndarray,
    velocity: np.ndarray,
    growth: np.ndarray | float,
) -> np.ndarray:
    """Weak form of (1) tested with every node, shape (nodes,), all dimensionless.

    `growth` is what the density is multiplied with to give the storage: dH/dt, or
    ``H / dt`` for what a step of length dt ends with.
    """
    mobility = oil.mobility(thickness)
    return assembly.vector(
        mobility * oil.around - oil.density * thickness * velocity,
        mobility * oil.along,
        oil.density * growth + thickness * oil.expansion,
    )


def balance_derivative(
    oil: OilProperties, thickness: np.ndarray, velocity: np.ndarray, growth: np.ndarray | float
) -> Coefficients:
    """Coefficients of the derivative of `balance` along the pressure."""
    mobility = oil.mobility(thickness)
    slope = mobility * (
        oil.density_derivative / oil.density - oil.viscosity_derivative / oil.viscosity
    )
    return Coefficients(
        mobility,
        mobility,
        slope * oil.around - oil.density_derivative * thickness * velocity,
        slope * oil.along,
        oil.density_derivative * growth + thickness * oil.expansion_derivative,
    )


def flux_derivatives(
    assembly: Assembly, oil: OilProperties, thickness: np.ndarray, velocity: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the fluxes in `balance` along H and along the mean velocity.

    Dimensionless element data (c, q, k) for `Assembly.gather`.
    """
    slope = oil.mobility_slope(thickness)
    if oil.thinning is not None:
        slope = slope - oil.mobility(thickness) * oil.thinning.along_thickness
    return (
        assembly.flux_elements(slope * oil.around - oil.density * velocity, slope * oil.along),
        assembly.flux_elements(-oil.density * thickness, None),
    )


def sliding_derivative(
    assembly: Assembly, oil: OilProperties, thickness: np.ndarray
) -> np.ndarray | None:
    """As `flux_derivatives` along the sliding velocity; None: no oil that thins."""
    if oil.thinning is None:
        return None
    slope = -oil.mobility(thickness) * oil.thinning.along_sliding
    return assembly.flux_elements(slope * oil.around, slope * oil.along)


def flux_change(
    assembly: Assembly,
    oil: OilProperties,
    thickness: np.ndarray,
    velocity: np.ndarray,
    changes: np.ndarray,
    speeds: np.ndarray,
    slidings: np.ndarray | None = None,
) -> np.ndarray:
    """Change of the fluxes in `balance`, shape (nodes, n).

    `changes` of H, `speeds` and `slidings`, changes of the mean and the sliding velocity,
    dimensionless, are given at the Gauss points for n directions, shape (c * q, n); None: none.
    """
    along_h, along_v = flux_derivatives(assembly, oil, thickness, velocity)
    total = assembly.gather(along_h) @ changes
    if speeds.any():
        total += assembly.gather(along_v) @ speeds
    along_u = None if slidings is None else sliding_derivative(assembly, oil, thickness)
    if along_u is not None:
        total += assembly.gather(along_u) @ slidings
    return total
