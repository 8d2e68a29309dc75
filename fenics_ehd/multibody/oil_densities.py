"""Density of an oil that pressure makes denser, within the steps of a mechanism.

Under Reynolds' condition the equation of a film has the rate of the density, the last term of (1),

    int rho h' N + h rho' N,    rho' = shift rho + past,

by the formula of the motion. The state of the integration has the density at the Gauss points
behind all else, less that at ambient pressure: what a film without pressure has, also where it
cavitates, is zero. A film that keeps account of its oil has it in its contents instead
(`fenics_ehd.multibody.conserved_oil`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_ehd.film.reynolds import DensityRate
from fenics_ehd.multibody.implicit_step import ImplicitStep
from fenics_ehd.multibody.system import FilmPlace


class OilDensity:
    """Density of the oil in one film under Reynolds' condition, beyond that at ambient pressure.

    Parameters
    ----------
    place
        The joint.
    first
        Place of its first value in the state of the integration.

    Attributes
    ----------
    values
        Places in the state of the values at all Gauss points.
    rate
        Of the density, within the step under way.
    """

    def __init__(self, place: FilmPlace, first: int):
        self._film = place.film.film
        area = self._film.assembly.area
        self.values = slice(first, first + area.size)
        # The density at ambient pressure, where it depends on the place.
        self._ambient = np.broadcast_to(self._film.equation.factors[1], area.shape)

    def begin(self, step: ImplicitStep) -> None:
        """Take another step."""
        past = step.past_x[self.values].reshape(self._ambient.shape)
        self.rate = DensityRate(step.shift, past - step.shift * self._ambient)

    def state(self, nodal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The state's values for dimensionless pressures of all nodes, and their rates."""
        density = self._film.equation.oil(nodal, None).density
        rates = self.rate.shift * density + self.rate.history
        return (density - self._ambient).ravel(), rates.ravel()


def oil_densities(places: Sequence[FilmPlace], first: int) -> dict[int, OilDensity]:
    """Of the films under Reynolds' condition whose oil is compressible, by their numbers."""
    found: dict[int, OilDensity] = {}
    for i, place in enumerate(places):
        law = place.film.film.parameters.lubricant.density_law
        if place.joint.oil is None and not law.constant:
            found[i] = OilDensity(place, first)
            first = found[i].values.stop
    return found
