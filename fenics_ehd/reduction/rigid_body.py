"""Rigid-body modes U of (26), from geometry."""

from __future__ import annotations

import numpy as np

from fenics_ehd.base.errors import VerificationError
from fenics_ehd.reduction.distributed import inner, multiply
from fenics_ehd.reduction.rigid_motion import rigid_fields
from fenics_ehd.reduction.structure import Structure

#: Largest strain energy of a rigid-body mode, relative to that of the same
#: nodal values taken node by node (the diagonal of K).
FREE_TOLERANCE = 1e-9


def rigid_body_modes(structure: Structure) -> np.ndarray:
    """Mass-orthonormal rigid-body modes of a free part, none of a clamped one.

    Returns
    -------
    numpy.ndarray
        Owned rows, shape (owned dofs, 6) or (owned dofs, 0).

    Raises
    ------
    VerificationError
        Some but not all rigid motions are free of strain energy.
    """
    fields = rigid_fields(structure.coordinates)
    comm = structure.comm
    diagonal = structure.stiffness.getDiagonal().array
    energy = np.diag(inner(fields, multiply(structure.stiffness, fields), comm))
    bound = np.diag(inner(fields, diagonal[:, None] * fields, comm))
    free = np.abs(energy) <= FREE_TOLERANCE * bound
    if not free.any():
        return fields[:, :0]
    if not free.all():
        raise VerificationError(
            f"{free.sum()} of 6 rigid-body motions store no energy; a part must be free "
            f"or clamped (largest relative energy {np.max(np.abs(energy) / bound):.1e})"
        )
    gram = inner(fields, multiply(structure.mass, fields), comm)
    return np.linalg.solve(np.linalg.cholesky(gram), fields.T).T
