"""A whole part on one rank, its displacement from what a run records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.multibody.body import Body
from fenics_ehd.multibody.flexible_body import FlexibleBody
from fenics_ehd.reduction import BasisFile, ReducedBody, Structure
from fenics_ehd.reduction.body import bore_fields
from fenics_ehd.reduction.residual_flexibility import pattern_fields

#: meshio's names of quadratic cells, by their number of nodes.
CELL_NAMES = {20: "hexahedron20", 10: "tetra10"}

#: Largest difference of bore rows from the body's, relative to the largest of these.
AGREEMENT = 1e-6


@dataclass(frozen=True, eq=False)
class PartFields:
    """The whole part on one rank, its displacement from what a run records.

    Attributes
    ----------
    nodes
        shape (p, 3) [m].
    cells
        In the order of VTK's quadratic hexahedron or tetrahedron, shape (c, 20 or 10).
    basis
        Displacements of unit elastic coordinates, shape (p, 3, n) [m].
    patterns
        Displacements of unit residual patterns (M4), shape (p, 3, r) [m/Pa]; r = 0 for others.
    """

    nodes: np.ndarray
    cells: np.ndarray
    basis: np.ndarray
    patterns: np.ndarray

    def displacement(self, coordinates: np.ndarray, quasi_static: np.ndarray) -> np.ndarray:
        """Elastic displacement for coordinates (n,) and amplitudes (r,), shape (p, 3) [m]."""
        return self.basis @ coordinates + self.patterns @ quasi_static


def gather_part(structure: Structure, body: ReducedBody, columns: np.ndarray) -> PartFields | None:
    """Collect nodes, cells and displacements of a distributed part on rank 0; None elsewhere.

    Parameters
    ----------
    structure, body
        The part and its reduction.
    columns
        The part-size basis, owned rows.

    Raises
    ------
    SettingsError
        The structure holds no elements.
    VerificationError
        From `pattern_fields`.
    """
    if structure.recovery is None:
        raise SettingsError("the structure has no elements: displacement fields need them")
    patterns = pattern_fields(structure, body, columns)
    parts = structure.comm.gather(
        (structure.coordinates, structure.recovery.cells, columns, patterns)
    )
    if parts is None:
        return None
    nodes, cells, *fields = (np.concatenate(pieces) for pieces in zip(*parts, strict=True))
    basis, patterns = (f.reshape(len(nodes), 3, f.shape[1]) for f in fields)
    return PartFields(nodes, cells, basis, patterns)


def part_of_basis(file: BasisFile, body: ReducedBody) -> PartFields | None:
    """A part by its basis on disk, None if that is not the basis of the body.

    Residual patterns (M4) are not in such a file: they move the bores' nodes only.
    """
    nodes, moved = file.nodes, bore_fields(body)
    distance, bore = cKDTree(nodes).query(body.places())
    if distance.max() > 1e-9 or not len(file.cells) or file.modes != body.modes:
        return None
    basis = np.moveaxis(file.displacement(np.eye(file.modes)), 0, -1)
    rows, found = body.bore_basis, basis[bore]
    # A mode has no sign of its own: two reductions of one part may choose different ones.
    signs = np.where(np.einsum("mcn,mcn->n", rows, found) < 0, -1.0, 1.0)
    if np.abs(signs * found - rows).max(initial=0.0) > AGREEMENT * np.abs(rows).max(initial=0.0):
        return None
    fields = np.zeros((len(nodes), 3, moved.shape[2]))
    fields[..., : body.modes] = signs * basis
    fields[bore] = moved
    return PartFields(nodes, file.cells, *np.split(fields, [body.modes], axis=2))


def parts_of_bases(
    bodies: Mapping[str, Body], bases: Sequence[str | Path]
) -> dict[str, PartFields]:
    """Whole parts of flexible bodies by name, from the files of their bases.

    Raises
    ------
    SettingsError
        A basis given is that of no body.
    """
    reduced = {n: body.reduced for n, body in bodies.items() if isinstance(body, FlexibleBody)}
    parts: dict[str, PartFields] = {}
    for path in bases:
        with BasisFile(path) as file:
            found = {name: part_of_basis(file, part) for name, part in reduced.items()}
        fitting = {name: part for name, part in found.items() if part is not None}
        if not fitting:
            sizes = ", ".join(f"{name} of {part.modes} modes" for name, part in reduced.items())
            raise SettingsError(f"--basis {path}: not that of a flexible body ({sizes or 'none'})")
        parts |= fitting
    return parts
