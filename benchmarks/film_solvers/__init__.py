"""Other ways to solve the cavitation problem of the film, to measure SNES-VI against.

All take the problem as ``0 <= p`` complementary to ``A p - b >= 0`` with a sparse
``A`` (n, n) whose principal blocks are regular, and return a `Solution`.
"""

from film_solvers.linear import LinearSolver, PetscLinearSolver
from film_solvers.penalty import penalty
from film_solvers.pivoting import block_pivot
from film_solvers.relaxation import Colouring, colour, projected_sor, relaxation_factor
from film_solvers.solution import Solution, complementarity_residual

__all__ = [
    "Colouring",
    "LinearSolver",
    "PetscLinearSolver",
    "Solution",
    "block_pivot",
    "colour",
    "complementarity_residual",
    "penalty",
    "projected_sor",
    "relaxation_factor",
]
