"""What every solver returns, and the one measure they are all held to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse


@dataclass(frozen=True, eq=False)
class Solution:
    """Result of a solver of the cavitation problem.

    Attributes
    ----------
    pressure
        Shape (n,), >= 0.
    iterations
        Sweeps of a relaxation, linear solves of the others.
    converged
        Whether the tolerance was reached before a limit or a cycle stopped the solver.
    """

    pressure: np.ndarray
    iterations: int
    converged: bool


def complementarity_residual(
    matrix: sparse.csr_matrix, rhs: np.ndarray, pressure: np.ndarray
) -> float:
    """``|min(D p, A p - b)| / |b|`` in the 2-norm, D the diagonal of A: zero at a solution.

    Where ``p > 0`` and small fluxes it is the residual of the film equation, the
    norm in which SNES-VI is stopped; D gives pressure the units of a flux.
    """
    flux = matrix @ pressure - rhs
    defect = np.minimum(matrix.diagonal() * pressure, flux)
    smallest = np.finfo(float).tiny  # without a source no pressure is the exact solution
    return float(np.linalg.norm(defect) / max(np.linalg.norm(rhs), smallest))
