"""Bearings for the tests of the film, in the units of the paper's slider-crank."""

import numpy as np
from petsc4py import PETSc

import fenics_ehd as ehd
from fenics_ehd.base.fields import FILM_ELEMENTS
from fenics_ehd.film import cavitation
from fenics_ehd.film.kinematics import Gap

#: Film elements from the lowest order to the highest.
FAMILIES = FILM_ELEMENTS[::-1]

R, C, OMEGA, ETA = 0.0225, 17e-6, 500.0, 0.01


def make_film(cells=(20, 5), family="lagrange", *, grid=None, width=2 * R, oil=None, **more):
    """Bearing with L/D = 1 by default; `more` goes to parameters or film."""
    options = {name: more.pop(name) for name in ("options_prefix", "tolerance") if name in more}
    grid = ehd.uniform_grid(R, width, cells, family) if grid is None else grid
    values = {"clearance": C, "rate": OMEGA} | more
    oil = ehd.Lubricant(ETA) if oil is None else oil
    return ehd.Film(ehd.FilmParameters(grid, lubricant=oil, **values), **options)


def shaft(x=0.0, y=0.0, *, speed=OMEGA, rate=(0.0, 0.0), **more):
    """Shaft at an eccentricity given, like its rate, in clearances."""
    rate = C * np.array(rate)
    return ehd.ShaftMotion(C * np.array([x, y]), speed, eccentricity_rate=rate, **more)


def gap_of(film, motion):
    p = film.parameters
    return ehd.shaft_gap(film.points, p.grid.radius, p.clearance, motion)


def given_gap(film, thickness, rate=0.0, velocity=0.0):
    """Gap from dimensionless functions of angle and height over radius, or numbers."""
    p = film.parameters
    angle, height = film.points.angle, film.points.height / p.grid.radius

    def values(x):
        return np.broadcast_to(x(angle, height) if callable(x) else x, angle.shape)

    speed = p.rate * p.grid.radius * values(velocity)
    return Gap(
        p.clearance * values(thickness), p.clearance * p.rate * values(rate), speed, 2 * speed
    )


def force(film, pressure):
    """Pressure force on the bore, x and y."""
    return film.load(np.stack(film.points.normal, axis=-1)) @ pressure


def solve(film, *position, guess=None, **motion):
    return film.solve(gap_of(film, shaft(*position, **motion)), guess)


def oval(size: float, angle: float = 0.0, lobes: int = 2) -> ehd.Shape:
    """A surface with lobes of a size [m], the first one at an angle [rad]."""
    return ehd.Shape(ovality=size, ovality_angle=float(np.degrees(angle)), lobes=lobes)


def watch_snes(monkeypatch):
    """SNES that films make from here on, and a norm for every solve that one of them begins."""
    made, begun = [], []

    class WatchedSNES(PETSc.SNES):
        def create(self, *arguments, **options):
            made.append(super().create(*arguments, **options))
            # PETSc itself reports iteration 0 of every solve.
            self.setMonitor(lambda _, iteration, norm: iteration or begun.append(norm))
            return self

    class WatchedPETSc:
        SNES = WatchedSNES

        def __getattr__(self, name):
            return getattr(PETSc, name)

    monkeypatch.setattr(cavitation, "PETSc", WatchedPETSc())
    return made, begun
