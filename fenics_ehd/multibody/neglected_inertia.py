"""What M4 leaves out: the inertia of the bore's residual patterns."""

from __future__ import annotations

import numpy as np

from fenics_ehd.reduction.body import ReducedBody, outward


def neglected_inertia(body: ReducedBody) -> np.ndarray:
    """Gap error per acceleration of the residual amplitudes.

    The force ``-M_rr y''`` that a residual pattern's mass would exert, answered by
    its own stiffness.

    Returns
    -------
    numpy.ndarray
        Outward bore displacement, shape (m, r); no rows if the mass is unknown.
    """
    residual = body.residual
    if residual is None or not residual.mass.size:
        return np.zeros((0, 0))
    shape = outward(body.bore_nodes, residual.displacement)
    return (shape / residual.stiffness) @ residual.mass


def slowest_pattern(body: ReducedBody) -> float:
    """``1 / omega`` of the slowest residual pattern on its own stiffness and mass [s]."""
    residual = body.residual
    if residual is None or not residual.mass.size:
        return 0.0
    root = 1.0 / np.sqrt(residual.stiffness)
    return float(np.sqrt(np.linalg.norm(root[:, None] * residual.mass * root, 2)))
