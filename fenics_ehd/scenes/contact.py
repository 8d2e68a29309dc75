"""Rough surfaces of a scene's lubricated joints."""

from __future__ import annotations

import numpy as np

from fenics_ehd.film.asperities import Asperities
from fenics_ehd.film.rough_surfaces import RoughSurfaces
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.fields import NONE
from fenics_ehd.scenes.scene import Scene

#: Young's modulus of a bore whose material nothing tells [Pa]: steel.
STEEL = 210e9


def rough_surfaces(scene: Scene, joint: schema.LubricatedSettings) -> RoughSurfaces | None:
    """Surfaces of a joint, None for smooth ones."""
    contact = joint.contact
    roughness = float(np.hypot(contact.journal_roughness, contact.bore_roughness))
    if not roughness:
        return None
    product, slenderness = contact.asperity_product, contact.asperity_slenderness
    if contact.asperity_radius:
        product = contact.asperity_density * contact.asperity_radius * roughness
        slenderness = roughness / contact.asperity_radius
    journal = contact.journal_modulus, contact.journal_poissons_ratio
    bore = contact.bore_modulus, contact.bore_poissons_ratio
    if not contact.bore_modulus:
        bore = _bore_material(scene, joint)
    modulus = 1.0 / sum((1 - ratio**2) / own for own, ratio in (journal, bore))
    return RoughSurfaces(
        contact.journal_roughness,
        contact.bore_roughness,
        Asperities(roughness, product, slenderness, modulus, contact.summit_offset),
        contact.boundary_friction,
        contact.flow_factors,
    )


def _bore_material(scene: Scene, joint: schema.LubricatedSettings) -> tuple[float, float]:
    """Young's modulus [Pa] and Poisson's ratio of a bore: its part's, or steel's."""
    body = scene.bodies.get(joint.bore.partition(".")[0])
    if isinstance(body, schema.FlexibleSettings) and body.model != NONE:
        return body.material.youngs_modulus, body.material.poissons_ratio
    return STEEL, 0.3
