"""The oil film of a bore: Reynolds equation with cavitation."""

import fenics_ehd.base.petsc_start  # noqa: F401
from fenics_ehd.film.film import Film, FilmState
from fenics_ehd.film.grid import FilmGrid, uniform_grid
from fenics_ehd.film.kinematics import Gap, ShaftMotion, shaft_gap
from fenics_ehd.film.lubricant import Lubricant
from fenics_ehd.film.parameters import FilmParameters

__all__ = [
    "Film",
    "FilmGrid",
    "FilmParameters",
    "FilmState",
    "Gap",
    "Lubricant",
    "ShaftMotion",
    "shaft_gap",
    "uniform_grid",
]
