"""Rough surfaces for the tests."""

import numpy as np

from fenics_ehd.film.asperities import Asperities
from fenics_ehd.film.rough_surfaces import RoughSurfaces

#: 1 / E' of steel on steel.
MODULUS = 210e9 / (2 * (1 - 0.3**2))


def surfaces(
    roughness=0.5e-6, share=0.5, *, modulus=MODULUS, friction=0.1, flow_factors=True, offset=0.0
):
    """Of a combined roughness; `share` of its square is the journal's."""
    journal, bore = np.sqrt(share) * roughness, np.sqrt(1 - share) * roughness
    asperities = Asperities(float(np.hypot(journal, bore)), 0.04, 0.01, modulus, offset)
    return RoughSurfaces(journal, bore, asperities, friction, flow_factors)
