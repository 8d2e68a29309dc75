"""Means of dynamic coefficients over film meshes with slightly different numbers of cells.

Stiffness and damping of a film jump, by up to 1 %, when the edge of the film moves by a row of
nodes. The error of a mesh changes its sign over the distance of two rows. In the mean over four
meshes with 0, 2, 4 and 6 more cells around the bearing, most of these errors cancel. Half the range
of the four values is the scatter, which is reported with a mean.

Matrices of a mechanism are averaged in one basis. The bases Z of two meshes span almost the same
motions, because the equilibria differ little. The coordinates of mesh k are the projection of its
motions on the first basis, ``q_1 = T q_k`` with ``T = Z_1^T Z_k``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fenics_ehd.analysis.equilibrium import Linearisation

#: Number of cells around the bearing by which each mesh exceeds the one before.
CELLS_APART = 2


def extra_cells(meshes: int) -> range:
    """Number of additional cells around the bearing in each of the meshes: 0, 2, 4, ..."""
    return range(0, CELLS_APART * meshes, CELLS_APART)


@dataclass(frozen=True, eq=False)
class MeshMean:
    """Mean of a quantity over film meshes.

    Attributes
    ----------
    value
        Mean, in the shape and unit of the quantity.
    scatter
        Half the range of the values of all meshes, in the shape and unit of the quantity; None for
        a single mesh.
    """

    value: np.ndarray
    scatter: np.ndarray | None

    @classmethod
    def of(cls, values: Sequence[np.ndarray]) -> MeshMean:
        """Mean and scatter of a quantity from its values on all meshes, which have equal shapes."""
        if len(values) == 1:
            return cls(values[0], None)
        return cls(np.mean(values, axis=0), 0.5 * np.ptp(values, axis=0))


def mean_linearisation(parts: Sequence[Linearisation]) -> Linearisation:
    """Small motions of a mechanism, with matrices that are means over several film meshes.

    Parameters
    ----------
    parts
        Linearisations about the equilibria on the meshes, at equal speeds and loads.

    Returns
    -------
    Linearisation
        Means of mass, damping, stiffness, coefficients of the films, and samples of the dynamic
        stiffness; its basis is that of the first mesh.
    """
    first = parts[0]
    if len(parts) == 1:
        return first
    alike = [first, *(in_basis(part, first.basis) for part in parts[1:])]
    mean = Linearisation.combined(alike, [1 / len(alike)] * len(alike))
    return replace(mean, basis=first.basis)


def in_basis(part: Linearisation, basis: np.ndarray) -> Linearisation:
    """Convert small motions to the coordinates of another basis of the same motions.

    `basis` has orthonormal columns, shape (n, k).
    """
    return part.with_coordinates(np.linalg.inv(basis.T @ part.basis))
