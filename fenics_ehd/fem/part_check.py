"""What a part's mesh is good for: its mass, its worst cell, how its bores yield."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

from fenics_ehd.fem.geometry import build_mesh
from fenics_ehd.fem.material import Material
from fenics_ehd.fem.solid import CORNERS, FACES, Solid
from fenics_ehd.fem.structure import assemble_structure
from fenics_ehd.reduction.distributed import inner, multiply
from fenics_ehd.reduction.rigid_motion import rigid_fields
from fenics_ehd.reduction.static import StaticSolver

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
    solver = StaticSolver(structure)
    rows = []
    for bore in structure.bores.values():
        phi = np.arctan2(bore.pressure_coordinates[:, 1], bore.pressure_coordinates[:, 0])
        harmonics = [wave(k * phi) for k in (2, 3) for wave in (np.cos, np.sin)]
        pressures = np.column_stack([*harmonics, np.exp(4 * np.cos(phi) - 4)])
        loads = solver.equilibrate(multiply(bore.load, pressures))
        rows.append(np.einsum("ij,ij->j", loads, solver.solve(loads)))
    return PartFigures(float(mass), structure.size, np.array(rows))


def worst_cell(solid: Solid) -> float:
    """Smallest volume that the edges at a corner span, relative to the product of their lengths.

    1 at the corners of a cube, 0.71 in an even tetrahedron; a cell turned inside out is negative.
    """
    corner_count = CORNERS[solid.kind]
    volumes = []
    for corner in range(corner_count):
        faces = [face for face in FACES[solid.kind] if corner in face]
        ends = sorted({n for face in faces for n in _beside(face, corner)})
        edges = solid.points[solid.cells[:, ends]] - solid.points[solid.cells[:, corner]][:, None]
        lengths = np.linalg.norm(edges, axis=2).prod(axis=1)
        sign = _handed(solid.kind, corner, ends)
        volumes.append(sign * np.linalg.det(edges) / np.maximum(lengths, 1e-300))
    return float(np.min(volumes))


def _beside(face: tuple[int, ...], corner: int) -> tuple[int, int]:
    place = face.index(corner)
    return face[place - 1], face[(place + 1) % len(face)]


def _handed(kind: str, corner: int, ends: Sequence[int]) -> float:
    """Whether the edges from a corner are a right-handed frame in the reference cell."""
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    reference = {
        "tet": np.vstack([np.zeros(3), np.eye(3)]),
        "hex": np.array([(*xy, z) for z in (0, 1) for xy in square], dtype=float),
    }[kind]
    return float(np.sign(np.linalg.det(reference[list(ends)] - reference[corner])))
