"""Contact of a rough shaft with its bearing: force, stiffness, figures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.bearing.settings import BearingSettings
from fenics_ehd.film.asperities import Asperities, Touch
from fenics_ehd.film.film import Film
from fenics_ehd.film.kinematics import Gap, GapDerivatives
from fenics_ehd.film.rough_surfaces import DEEPEST_CONTACT, RoughSurfaces
from fenics_ehd.film.shear import in_supply


def surfaces_of(settings: BearingSettings) -> RoughSurfaces | None:
    """Surfaces of shaft and bore, None for smooth ones."""
    s = settings
    roughness = float(np.hypot(s.journal_roughness, s.bore_roughness))
    if not roughness:
        return None
    asperities = Asperities(
        roughness, s.asperity_product, s.asperity_slenderness, s.contact_modulus, s.summit_offset
    )
    return RoughSurfaces(
        s.journal_roughness, s.bore_roughness, asperities, s.boundary_friction, s.flow_factors
    )


def least_gap(settings: BearingSettings) -> float:
    """What the smallest nominal gap must be above [m]: rough surfaces may overlap."""
    roughness = float(np.hypot(settings.journal_roughness, settings.bore_roughness))
    return DEEPEST_CONTACT * roughness if roughness else 0.0


@dataclass(frozen=True)
class ContactFigures:
    """Contact of a bearing in operation.

    Attributes
    ----------
    load
        Resultant of the contact pressure [N].
    share
        Over the load; contact and film act along different lines, their sizes do not add up.
    max_pressure
        [Pa].
    power
        Lost by boundary friction [W].
    """

    load: float
    share: float
    max_pressure: float
    power: float


class BearingContact:
    """Contact on the mesh of a film between rough surfaces."""

    def __init__(self, film: Film):
        surfaces = film.parameters.surfaces
        assert surfaces is not None
        self._surfaces = surfaces
        supplied = in_supply(film, film.points.angle, film.points.height)
        area = film.parameters.grid.radius**2 * film.assembly.area
        self._area = np.where(supplied, 0.0, area)
        self._normal = np.stack([n.ravel() for n in film.points.normal])

    def _touch(self, gap: Gap) -> Touch:
        return self._surfaces.asperities.touch(gap.thickness)

    def push(self, gap: Gap) -> np.ndarray:
        """Force on the bore, x and y, shape (2,) [N]."""
        return self._normal @ (self._area * self._touch(gap).pressure).ravel()

    def stiffness(self, gap: Gap, derivatives: GapDerivatives) -> np.ndarray:
        """Its derivative along n changes of the gap, shape (2, n)."""
        factor = (self._area * self._touch(gap).slope).ravel()
        changes = derivatives.thickness.reshape(factor.size, -1)
        return (self._normal * factor) @ changes

    def figures(self, gap: Gap, load: float) -> ContactFigures:
        """In operation under a load [N]."""
        pressure = np.where(self._area > 0.0, self._touch(gap).pressure, 0.0)
        own = float(np.hypot(*self.push(gap)))
        rubbing = self._surfaces.rubbing(gap.sliding_velocity)[0]
        power = float(np.sum(self._area * pressure * rubbing * gap.sliding_velocity))
        return ContactFigures(own, own / load if load else 0.0, float(pressure.max()), power)
