"""Displacement of the whole part by the residual patterns of M4, for pictures of it."""

from __future__ import annotations

import numpy as np

from fenics_ehd.errors import VerificationError
from fenics_ehd.reduction.body import ReducedBody
from fenics_ehd.reduction.distributed import blocks, combine, load_columns
from fenics_ehd.reduction.projection import bore_rows
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.reduction.structure import Structure

#: Largest difference from the body's own bore rows, relative to the largest of these.
AGREEMENT = 1e-6


def pattern_fields(
    structure: Structure, body: ReducedBody, columns: np.ndarray, *, solver: str = "auto"
) -> np.ndarray:
    """Displacements of unit amplitudes of the residual patterns V.

        (G_c - T K_r^-1 T^T J) V

    A body keeps their bore rows only, `ResidualFlexibility.displacement`; this solves for all
    rows again, one solve per pattern. Collective.

    Parameters
    ----------
    structure
        The part.
    body
        Its reduction with M4.
    columns
        The part-size basis T, owned rows, shape (owned dofs, n).
    solver
        As in `StaticSolver`.

    Returns
    -------
    numpy.ndarray
        Owned rows, shape (owned dofs, r) [m/Pa]; no columns for a body without patterns.

    Raises
    ------
    VerificationError
        The bore rows are not those of the body: it was made from another part.
    """
    residual = body.residual
    if residual is None or not residual.rank:
        return np.zeros((len(columns), 0))
    bore, patterns = structure.lubricated_bore, residual.patterns.T
    static = StaticSolver(structure, solver=solver)
    covered = np.linalg.solve(body.stiffness, body.load_projection[3:] @ patterns)
    fields = np.empty((len(columns), residual.rank))
    for some in blocks(residual.rank, len(columns), structure.comm):
        responses = static.solve(load_columns(bore.load, patterns[:, some]))
        fields[:, some] = responses - combine(columns, covered[:, some])
    defect = np.abs(bore_rows(structure, fields) - residual.displacement).max()
    if not defect <= AGREEMENT * np.abs(residual.displacement).max():
        raise VerificationError(
            f"residual patterns move the bore by {defect:.1e} m/Pa else than the body says, "
            f"limit {AGREEMENT:.0e} of the largest: was the body made from this part?"
        )
    return fields
