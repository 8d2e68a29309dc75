"""A flexible body of a run with its mesh and basis, which its folder does not hold, made again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import attrs
from mpi4py import MPI

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.fem.models import is_program
from fenics_ehd.reduction import ReducedBody
from fenics_ehd.reduction.same_basis import basis_of
from fenics_ehd.scenes.elastic_part import elastic_part
from fenics_ehd.scenes.part import (
    ReducedPart,
    model_file,
    reduction_provenance,
    structure_provenance,
)
from fenics_ehd.scenes.scene import Scene


def remade_part(
    scene: Scene, name: str, body: ReducedBody, programs: Sequence[str | Path] = ()
) -> ReducedPart:
    """Mesh and reduce a body of a scene again, with the coordinates that a run recorded; serial.

    Nothing is meshed unless settings and model are those that the body was made with.

    Parameters
    ----------
    scene
        Of the run.
    name
        Of a body with a model.
    body
        As the run has it.
    programs
        Models that may be run: the scene of a run's folder may be another person's.

    Raises
    ------
    SettingsError, MeshError
        Its model is gone, is not what it was, or is a program that is not among those.
    VerificationError
        From `basis_of`.
    """
    settings, key = scene.bodies[name], f"bodies.{name}"
    # Coordinates do not depend on the estimate.
    reduction = attrs.evolve(settings.reduction, estimate_error=False)
    settings = attrs.evolve(settings, reduction=reduction)
    element, model = scene.film_element(name), model_file(settings, key)
    found = structure_provenance(settings, model, element) | reduction_provenance(reduction)
    for made, value in found.items():
        former = body.provenance.get(made, value)
        if former != value:
            raise SettingsError(
                f"{key} was made with {made} = {former}, which is {value} now: put back what it "
                "was, or run the scene anew"
            )
    if is_program(model) and not any(model.samefile(program) for program in programs):
        raise SettingsError(
            f"{key}.model = {settings.model!r} is a program, which the run's folder names: if you "
            f"know it, have it run by --model {model}"
        )
    part = elastic_part(settings, key, element, MPI.COMM_SELF).reduce()
    assert isinstance(part, ReducedPart)
    return replace(part, body=body, columns=basis_of(body, part.body, part.columns))
