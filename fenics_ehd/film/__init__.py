"""The oil film of a bore: Reynolds equation with cavitation."""

from fenics_ehd.film.film import Film, FilmParameters, FilmState

__all__ = ["Film", "FilmParameters", "FilmState"]
