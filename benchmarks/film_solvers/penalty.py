"""Penalty method: negative pressure is drained instead of forbidden.

``A p + (D / epsilon) min(p, 0) = b`` with D the diagonal of A, so that epsilon has
no units. Piecewise linear: its semismooth Newton iteration solves with the penalty
on the nodes where the last pressure was negative, which is also its Picard iteration.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from film_solvers.linear import LinearSolver
from film_solvers.solution import Solution


def penalty(
    matrix: sparse.csr_matrix,
    rhs: np.ndarray,
    guess: np.ndarray | None,
    tolerance: float,
    solve: LinearSolver,
    *,
    epsilon: float,
    mass: sparse.csr_matrix | None = None,
    max_iterations: int = 200,
) -> Solution:
    """Solve the penalised problem and cut off what is left of negative pressures.

    Parameters
    ----------
    matrix, rhs
        ``A`` (n, n) csr, ``b`` (n,).
    guess
        Pressure (n,) whose nodes without pressure are penalised first; None: no node is.
    tolerance
        On the 2-norm of the residual of the penalised equation, relative to ``|b|``.
    solve
        Linear solver; the pattern of the matrix is always that of A.
    epsilon
        Penalty parameter: negative pressures are ``epsilon`` times flux over D.
    mass
        ``N`` with the pattern of A, for ``A p + N (D / epsilon) min(p, 0) = b`` with D the
        diagonal of A over that of N: the flux is then ``N^-1 (A p - b)``.
    max_iterations
        Largest number of linear solves.
    """
    film = np.ones(len(rhs), dtype=bool) if guess is None else guess > 0
    if mass is None:
        mass = _identity_in(matrix)
    weights = matrix.diagonal() / mass.diagonal() / epsilon
    pressure = np.zeros(len(rhs))
    for iterations in range(1, max_iterations + 1):
        data = matrix.data + np.where(film, 0.0, weights)[matrix.indices] * mass.data
        penalised = sparse.csr_matrix((data, matrix.indices, matrix.indptr), shape=matrix.shape)
        pressure = solve(penalised, rhs)
        film, previous = pressure >= 0, film
        # Solved exactly with the previous zones: what is left is what the new ones change.
        change = mass @ (weights * pressure * (previous.astype(float) - film.astype(float)))
        if np.linalg.norm(change) <= tolerance * np.linalg.norm(rhs):
            return Solution(np.maximum(pressure, 0.0), iterations, True)
    return Solution(np.maximum(pressure, 0.0), iterations, False)


def _identity_in(matrix: sparse.csr_matrix) -> sparse.csr_matrix:
    """Identity with the pattern of a csr matrix that holds its diagonal."""
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    data = (rows == matrix.indices).astype(float)
    return sparse.csr_matrix((data, matrix.indices, matrix.indptr), shape=matrix.shape)
