"""A rigid bearing as `Film` sees it and as plain matrices."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from film_solvers import Solution
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from fenics_ehd.film import (
    Film,
    FilmGrid,
    FilmParameters,
    FilmState,
    Gap,
    Lubricant,
    ShaftMotion,
    shaft_gap,
    uniform_grid,
)
from fenics_ehd.film.assembly import Coefficients
from fenics_ehd.film.nested import CoarseTransfer

RADIUS, CLEARANCE, VISCOSITY, SPEED = 0.0225, 17e-6, 0.01, 500.0

#: Relative to the source, for SNES-VI and all others.
TOLERANCE = 1e-8


def linear_system(film: Film, gap: Gap) -> tuple[sparse.csr_matrix, np.ndarray]:
    """``A`` (free nodes) and ``b`` of (11), dimensionless, of a constant oil."""
    problem = film.equation.problem(gap)
    zero = np.zeros(len(film.free))
    return film.assembly.pattern.matrix(problem.entries(zero)), -problem.residual(zero)


@dataclass(frozen=True, eq=False)
class BearingProblem:
    """One film, one position of the shaft.

    Attributes
    ----------
    film
        L/D = 1, constant oil, uniform mesh.
    shaft
        Position of the shaft's centre, shape (2,), in clearances.
    """

    film: Film
    shaft: np.ndarray

    @classmethod
    def create(cls, family: str, cells: tuple[int, int], eccentricity: float) -> BearingProblem:
        """Bearing whose shaft is displaced along x."""
        grid = uniform_grid(RADIUS, 2 * RADIUS, cells, family)
        parameters = FilmParameters(grid, CLEARANCE, Lubricant(VISCOSITY), SPEED)
        return cls(Film(parameters, tolerance=TOLERANCE), np.array([eccentricity, 0.0]))

    def moved(self, change: np.ndarray) -> BearingProblem:
        """The same film with its shaft displaced by `change`, in clearances."""
        return BearingProblem(self.film, self.shaft + change)

    @property
    def grid(self) -> FilmGrid:
        """Its mesh."""
        return self.film.parameters.grid

    @cached_property
    def gap(self) -> Gap:
        """Where every clock starts."""
        motion = ShaftMotion(CLEARANCE * self.shaft, SPEED)
        return shaft_gap(self.film.points, RADIUS, CLEARANCE, motion)

    def system(self) -> tuple[sparse.csr_matrix, np.ndarray]:
        """``A`` and ``b``, dimensionless."""
        return linear_system(self.film, self.gap)

    @cached_property
    def mass(self) -> sparse.csr_matrix | None:
        """``N`` with the pattern of A where the complementarity needs it: 8-node element."""
        if self.grid.family != "serendipity":
            return None
        assembly = self.film.assembly
        zero = np.zeros(assembly.area.shape)
        return assembly.pattern.matrix(assembly.matrix(Coefficients(zero, zero, mass=zero + 1)))

    @cached_property
    def _mass_factors(self) -> SuperLU:
        return splu(self.mass.tocsc())

    def printed_system(self) -> tuple[sparse.csr_matrix, np.ndarray]:
        """``N^-1 A`` (full) and ``N^-1 b`` as in (11), where there is an N."""
        matrix, rhs = self.system()
        if self.mass is None:
            return matrix, rhs
        solve = self._mass_factors.solve
        return sparse.csr_matrix(solve(matrix.toarray())), solve(rhs)

    @cached_property
    def _state(self) -> FilmState:
        return self.film.solve(self.gap)

    def snes_vi(self, guess: np.ndarray | None) -> Solution:
        """`Film.solve` from a pressure (n,), None: from zero and not from coarser meshes."""
        start = np.zeros(len(self.film.free)) if guess is None else guess
        state = replace(self._state, cavitation=replace(self._state.cavitation, pressure=start))
        result = self.film.solve(self.gap, state).cavitation
        return Solution(result.pressure, result.iterations, True)

    @cached_property
    def _coarser(self) -> tuple[Film, CoarseTransfer] | None:
        coarse = self.grid.coarser()
        if coarse is None:
            return None
        film = Film(replace(self.film.parameters, grid=coarse), tolerance=TOLERANCE)
        return film, CoarseTransfer(self.grid, coarse, self.film.assembly.tensors.points)

    def nested_start(self) -> np.ndarray | None:
        """Pressure (n,) from coarser meshes, as `Film` makes it itself; None on the coarsest."""
        if self._coarser is None:
            return None
        film, transfer = self._coarser
        pressure = transfer.prolong(film.solve(transfer.restrict(self.gap)).pressure)
        return pressure[self.film.free] / self.film.parameters.pressure_scale

    @cached_property
    def _load_weights(self) -> np.ndarray:
        normal = np.stack(self.film.points.normal, axis=-1)
        return self.film.load(normal)[:, self.film.free] * self.film.parameters.pressure_scale

    def load(self, pressure: np.ndarray) -> float:
        """Modulus of the film force [N]."""
        return float(np.linalg.norm(self._load_weights @ pressure))
