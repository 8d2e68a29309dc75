"""Journals under a load, for the tests."""

import numpy as np
from scipy.optimize import root

from fenics_ehd.film import ShaftMotion, shaft_gap
from fenics_ehd.scenes.load_history import LoadHistory
from fenics_ehd.scenes.loaded_journal import build_film
from fenics_ehd.scenes.loaded_journal_run import OrbitTotals, simulate
from fenics_ehd.scenes.loaded_journal_settings import Bearing, Film, LoadedJournalSettings, Time

R, C, ETA, OMEGA = 0.02, 20e-6, 0.01, 300.0
UNIT_LOAD = 6 * ETA * OMEGA * (R / C) ** 2 * R * 2 * R  # of the table for L/D = 1


def scene(*, width=2 * R, clearance=C, speed=OMEGA, cells=(20, 5), grooves=(), **times):
    return LoadedJournalSettings(
        bearing=Bearing(R, width, clearance, ETA, speed, grooves=grooves),
        film=Film(cells),
        time=Time(**{"tolerance": 1e-4, **times}),
    )


def periodic(force, period, rows=73):
    """Load history of a function of the share of the period."""
    share = np.linspace(0.0, 1.0, rows)
    return LoadHistory(period * share, np.array([force(s) for s in share]))


def orbit(settings, load):
    """Rows of the run, its totals and its last cycle."""
    rows, totals = [], OrbitTotals()
    cycle = simulate(settings, totals, lambda row, _: rows.append(row), load=load)
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    return columns, totals, cycle


def eccentricity(columns):
    return np.column_stack([columns["eccentricity_x_m"], columns["eccentricity_y_m"]])


def equilibrium(settings, load, speed):
    """Eccentricity at which the film at rest bears a load: MINPACK on the film alone."""
    film, clearance = build_film(settings, 1.0), settings.bearing.clearance
    directions = film.load(np.stack(film.points.normal, axis=-1))
    size = np.hypot(*load)

    def imbalance(ratio):
        gap = shaft_gap(film.points, R, clearance, ShaftMotion(clearance * ratio, speed))
        return (directions @ film.solve(gap).pressure - load) / size

    solution = root(imbalance, 0.5 * load / size, tol=1e-10)
    assert solution.success
    return clearance * solution.x
