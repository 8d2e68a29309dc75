"""Massless journals under a load, for the tests."""

import numpy as np
from scipy.optimize import root

from fenics_ehd.film import Film, FilmParameters, Lubricant, ShaftMotion, shaft_gap, uniform_grid
from fenics_ehd.multibody.forces import PointForce
from fenics_ehd.multibody.joints import Speed
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.rigid_body import RigidBody
from fenics_ehd.multibody.simulation import simulate_periodic
from fenics_ehd.scenes.load_history import load_curves

R, C, ETA, OMEGA = 0.02, 20e-6, 0.01, 300.0
UNIT_LOAD = 6 * ETA * OMEGA * (R / C) ** 2 * R * 2 * R  # of the table for L/D = 1


def make_film(cells=(20, 5), *, width=2 * R, clearance=C, oil=None):
    grid = uniform_grid(R, width, cells, "lagrange")
    return Film(FilmParameters(grid, clearance, oil or Lubricant(ETA), OMEGA))


def ellipse(size, ratio, waves):
    """Load of so many unit loads, as a function of the share of the period."""
    return lambda s: (
        size * UNIT_LOAD * np.stack([np.cos(2 * np.pi * s), ratio * np.sin(2 * np.pi * waves * s)])
    )


def journal(film, force, period, *, rows=73, speed=OMEGA, eccentricity=(0.0, 0.0)):
    """A massless journal under a function of the share of the period, and the period."""
    share = np.linspace(0.0, 1.0, rows)
    curves = load_curves(period * share, np.array(force(share)).T)
    forces = {
        axis: PointForce("journal", tuple(np.eye(2)[i]), curve)
        for i, (axis, curve) in enumerate(zip("xy", curves, strict=True))
    }
    bearing = LubricatedJoint("journal", "ground", film, eccentricity=eccentricity)
    drives = {"journal": Speed(speed)}
    return Mechanism({"journal": RigidBody(0.0)}, {"bearing": bearing}, drives, forces), period


def orbit(mechanism, period, tolerance=1e-4):
    """Times of the periodic orbit and eccentricities, shape (n,), (n, 2)."""
    result = simulate_periodic(mechanism, period, tolerance=tolerance, order=2, first=1e-6)
    return result.time, result.joints["bearing"].eccentricity


def equilibrium(film, load, speed, start=None):
    """Eccentricity at which the film at rest bears a load: MINPACK on the film alone.

    From a start [m], or from half the clearance along the load.
    """
    clearance = film.parameters.clearance
    directions = film.load(np.stack(film.points.normal, axis=-1))
    size = np.hypot(*load)

    def imbalance(ratio):
        gap = shaft_gap(film.points, R, clearance, ShaftMotion(clearance * ratio, speed))
        return (directions @ film.solve(gap).pressure - load) / size

    first = 0.5 * load / size if start is None else start / clearance
    solution = root(imbalance, first, tol=1e-10)
    assert solution.success
    return clearance * solution.x
