"""What a part's mesh is good for: its mass, its worst cell, how its bores yield."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

from fenics_ehd.fem.geometry import build_mesh
from fenics_ehd.fem.material import Material
from fenics_ehd.fem.structure import assemble_structure
from fenics_ehd.reduction.distributed import inner, multiply
from fenics_ehd.reduction.mesh_error import smooth_answers
from fenics_ehd.reduction.rigid_motion import rigid_fields
from fenics_ehd.reduction.static import StaticSolver


@dataclass(frozen=True, eq=False)
class PartFigures:
    """Of a part's mesh.

    Attributes
    ----------
    mass
        [kg].
    unknowns
        Degrees of freedom.
    compliance
        See `fenics_ehd.reduction.mesh_error.Answers` [J/Pa^2].
    """

    mass: float
    unknowns: int
    compliance: np.ndarray


def part_figures(
    path: Path,
    material: Material,
    bores: Sequence[str],
    clamped: str | None,
    parameters: Mapping[str, float] | None = None,
) -> PartFigures:
    """Assemble a model and load its bores.

    Raises
    ------
    MeshError, StructureError, VerificationError
        The model is no part.
    """
    mesh = build_mesh(path, parameters, comm=MPI.COMM_SELF, bores=bores)
    structure = assemble_structure(mesh, material, bores=bores, attachments=(), clamped=clamped)
    moves = rigid_fields(structure.coordinates)[:, :1]
    mass = inner(moves, multiply(structure.mass, moves), structure.comm)[0, 0]
    answers = smooth_answers(StaticSolver(structure))
    return PartFigures(float(mass), structure.size, answers.compliance)
