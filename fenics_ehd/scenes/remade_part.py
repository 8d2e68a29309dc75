"""A flexible body of a run with its mesh and basis, which its folder does not hold, made again."""

from __future__ import annotations

from dataclasses import replace

import attrs
from mpi4py import MPI

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.reduction.same_basis import basis_of
from fenics_ehd.scenes.elastic_part import elastic_part
from fenics_ehd.scenes.part import ReducedPart
from fenics_ehd.scenes.scene import Scene


def remade_part(scene: Scene, name: str, body: ReducedBody) -> ReducedPart:
    """Mesh and reduce a body of a scene again, with the coordinates that a run recorded; serial.

    Parameters
    ----------
    scene
        Of the run.
    name
        Of a body with a model.
    body
        As the run has it.

    Raises
    ------
    SettingsError, MeshError
        Its model is gone, or is not what it was.
    VerificationError
        From `basis_of`.
    """
    settings = scene.bodies[name]
    # Coordinates do not depend on the estimate.
    reduction = attrs.evolve(settings.reduction, estimate_error=False)
    settings = attrs.evolve(settings, reduction=reduction)
    element = scene.film_element(name)
    made = elastic_part(settings, f"bodies.{name}", element, MPI.COMM_SELF).reduce()
    assert isinstance(made, ReducedPart)
    for key, value in made.body.provenance.items():
        former = body.provenance.get(key, value)
        if former != value:
            raise SettingsError(
                f"bodies.{name} was made with {key} = {former}, which is {value} now: put back "
                "what it was, or run the scene anew"
            )
    return replace(made, body=body, columns=basis_of(body, made.body, made.columns))
