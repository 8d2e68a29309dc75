"""What a film is made of: mesh, clearance, oil and given pressures."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.film.feed import Feed
from fenics_ehd.film.feed_region import FeedRegion
from fenics_ehd.film.grid import FilmGrid
from fenics_ehd.film.lubricant import Lubricant
from fenics_ehd.film.rough_surfaces import RoughSurfaces
from fenics_ehd.film.supply import Region, Sides


@dataclass(frozen=True, eq=False)
class FilmParameters:
    """One bearing and its oil.

    Attributes
    ----------
    grid
        Film mesh: bore radius, width, cells and element family.
    clearance
        Radial clearance c [m].
    lubricant
        The oil.
    rate
        Reference angular speed Omega > 0 [rad/s] that makes the equation
        dimensionless; results do not depend on it beyond round-off.
    sides, regions
        Given pressures.
    feeds
        Supplies that conduct oil into the film.
    recesses
        Deep places of the bore without supply: their pressure is uniform, what flows in flows out.
    surfaces
        Of journal and bore, None for smooth ones that never touch.
    """

    grid: FilmGrid
    clearance: float
    lubricant: Lubricant
    rate: float
    sides: Sides = field(default_factory=Sides)
    regions: tuple[Region, ...] = ()
    feeds: tuple[Feed, ...] = ()
    recesses: tuple[FeedRegion, ...] = ()
    surfaces: RoughSurfaces | None = None

    def __post_init__(self) -> None:
        for name in ("clearance", "rate"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise SettingsError(
                    f"{name} = {value:g} of the film must be a finite number above 0"
                )
        if not np.finfo(float).tiny < self.pressure_scale < np.inf:
            raise SettingsError(
                f"viscosity = {self.lubricant.viscosity:g} Pa s at {self.rate:g} rad/s: the film's "
                f"pressure is of the size of {self.pressure_scale:g} Pa, which cannot be computed"
            )
        if not self.clearance < self.grid.radius:
            raise SettingsError(
                f"clearance = {self.clearance:g} m must be below the radius {self.grid.radius:g} m"
            )

    @property
    def pressure_scale(self) -> float:
        """``p_s = 12 eta Omega (R / c)^2`` [Pa]."""
        ratio = self.grid.radius / self.clearance
        return 12 * self.lubricant.viscosity * self.rate * ratio**2
