"""What an elastic part is made of."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Material:
    """Isotropic elastic material: Young's modulus [Pa], Poisson's ratio, density [kg/m^3]."""

    youngs_modulus: float
    poissons_ratio: float
    density: float
