"""Journals in one bearing under loads, for the tests."""

import numpy as np
from scipy.optimize import root

import fenics_ehd as ehd
from fenics_ehd.scenes.tables import load_curves

R, C, ETA, OMEGA = 0.02, 20e-6, 0.01, 300.0
UNIT_LOAD = 6 * ETA * OMEGA * (R / C) ** 2 * R * 2 * R  # of the table for L/D = 1


def make_film(cells=(20, 5), *, width=2 * R, clearance=C, oil=None):
    grid = ehd.uniform_grid(R, width, cells, "lagrange")
    return ehd.Film(ehd.FilmParameters(grid, clearance, oil or ehd.Lubricant(ETA), OMEGA))


def ellipse(size, ratio, waves):
    """Load of so many unit loads, as a function of the share of the period."""
    return lambda s: (
        size * UNIT_LOAD * np.stack([np.cos(2 * np.pi * s), ratio * np.sin(2 * np.pi * waves * s)])
    )


def constant(force):
    """Load that is the same at every share of the period."""
    return lambda share: np.broadcast_to(np.asarray(force)[:, None], (2, np.size(share)))


def in_bearing(film, forces, *, mass=0.0, inertia=0.0, speed=OMEGA, **joint):
    """A journal that turns in a film at rest, under forces on it."""
    bearing = ehd.LubricatedJoint("journal", "ground", film, **joint)
    bodies, drives = {"journal": ehd.RigidBody(mass, inertia)}, {"journal": ehd.Speed(speed)}
    return ehd.Mechanism(bodies, {"bearing": bearing}, drives, forces)


def steady(x, y=0.0):
    """A constant force on the journal."""
    return ehd.PointForce("journal", (x, y), lambda _: (float(np.hypot(x, y)), 0.0))


def journal(film, force, period, *, rows=73, **joint):
    """A massless journal under a function of the share of the period, and the period."""
    share = np.linspace(0.0, 1.0, rows)
    curves = load_curves(period * share, np.array(force(share)).T)
    forces = {
        axis: ehd.PointForce("journal", tuple(np.eye(2)[i]), curve)
        for i, (axis, curve) in enumerate(zip("xy", curves, strict=True))
    }
    return in_bearing(film, forces, **joint), period


def orbit(mechanism, period, tolerance=1e-4):
    """Times of the periodic orbit and eccentricities, shape (n,), (n, 2)."""
    result = ehd.simulate(mechanism, period=period, tolerance=tolerance, order=2, first=1e-6)
    return result.time, result.joints["bearing"].eccentricity


def equilibrium(film, load, speed, start=None):
    """Eccentricity at which the film at rest bears a load: MINPACK on the film alone.

    From a start [m], or from half the clearance along the load.
    """
    clearance = film.parameters.clearance
    directions = film.load(np.stack(film.points.normal, axis=-1))
    size = np.hypot(*load)

    def imbalance(ratio):
        gap = ehd.shaft_gap(film.points, R, clearance, ehd.ShaftMotion(clearance * ratio, speed))
        return (directions @ film.solve(gap).pressure - load) / size

    first = 0.5 * load / size if start is None else start / clearance
    solution = root(imbalance, first, tol=1e-10)
    assert solution.success
    return clearance * solution.x
