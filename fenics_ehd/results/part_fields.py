"""A whole part on one rank, its displacement from what a run records."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.reduction import ReducedBody, Structure
from fenics_ehd.reduction.residual_flexibility import pattern_fields


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
