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
from fenics_ehd.reduction.rigid_motion import rigid_fields
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.reduction.structure import Structure

#: Pressures over the bore whose deformation is compared: the harmonics that bend it, and a
#: sharper one, of an exponential.
PATTERNS = ("cos 2 phi", "sin 2 phi", "cos 3 phi", "sin 3 phi", "exp(4 cos phi)")


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
        Work of each of `PATTERNS` of 1 Pa in each bore, shape (bores, patterns) [J].
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
    return PartFigures(float(mass), structure.size, compliances(structure))


def compliances(structure: Structure) -> np.ndarray:
    """Work of each of `PATTERNS` of 1 Pa in each bore, shape (bores, patterns) [J]."""
    solver = StaticSolver(structure)
    rows = []
    for bore in structure.bores.values():
        phi = np.arctan2(bore.pressure_coordinates[:, 1], bore.pressure_coordinates[:, 0])
        harmonics = [wave(k * phi) for k in (2, 3) for wave in (np.cos, np.sin)]
        pressures = np.column_stack([*harmonics, np.exp(4 * np.cos(phi) - 4)])
        loads = solver.equilibrate(multiply(bore.load, pressures))
        rows.append(np.einsum("ij,ij->j", loads, solver.solve(loads)))
    return np.array(rows)
