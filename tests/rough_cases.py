"""Rough surfaces for the tests."""

import numpy as np

import fenics_ehd as ehd

#: 1 / E' of steel on steel.
MODULUS = 210e9 / (2 * (1 - 0.3**2))


def surfaces(
    roughness=0.5e-6, share=0.5, *, modulus=MODULUS, friction=0.1, flow_factors=True, offset=0.0
):
    """Of a combined roughness; `share` of its square is the journal's."""
    journal, bore = np.sqrt(share) * roughness, np.sqrt(1 - share) * roughness
    return ehd.RoughSurfaces(
        journal_roughness=journal,
        bore_roughness=bore,
        asperity_slenderness=0.01,
        summit_offset=offset,
        modulus=modulus,
        boundary_friction=friction,
        flow_factors=flow_factors,
    )
