"""Observed convergence rates of the film's three elements."""

import numpy as np
import pytest
from differences import slope
from film_cases import ETA, FAMILIES, OMEGA, C, R, force, given_gap, make_film
from film_grids import graded_grid

import fenics_ehd as ehd

HALF = 0.6  # half width over radius
RATES = {"bilinear": 2.0, "serendipity": 3.0, "lagrange": 3.0}


def grid_of(cells, family, graded, start=0.0, width=2 * HALF * R):
    if graded:
        return graded_grid(R, width, cells, family, focus=start, ratio=4.0)
    return ehd.uniform_grid(R, width, cells, family, start=start)


# --- A full film with a manufactured pressure, dimensionless


def pressure(phi, z):
    return 0.02 * (1 - (z / HALF) ** 2) * (2 + np.sin(phi + 0.5 * z) + 0.4 * np.cos(2 * phi))


def gap(phi, z):
    return 1 + 0.4 * np.cos(phi) + 0.2 * z * np.sin(phi)


def velocity(phi, z):
    return 0.5 + 0.1 * np.sin(phi) * z


def squeeze(mobility):
    """Rate of the gap that makes `pressure` the solution."""

    def flux_around(phi, z):
        across = slope(lambda a: pressure(phi + a, z))
        return mobility(phi, z) * across - gap(phi, z) * velocity(phi, z)

    def flux_along(phi, z):
        return mobility(phi, z) * slope(lambda b: pressure(phi, z + b))

    return lambda phi, z: (
        slope(lambda a: flux_around(phi + a, z)) + slope(lambda b: flux_along(phi, z + b))
    )


def viscosity(phi, z):
    return 1.2 + 0.3 * np.sin(phi) + 0.5 * z


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("graded", [False, True])
@pytest.mark.parametrize("field", [None, viscosity])
def test_full_film_converges_at_the_rate_of_its_element(family, graded, field):
    oil = ehd.Lubricant(
        ETA, viscosity_field=field and (lambda angle, height: field(angle, height / R))
    )
    rate = squeeze(lambda phi, z: gap(phi, z) ** 3 / (field(phi, z) if field else 1.0))
    # Sampled off the Gauss points, where finite elements are better than they are.
    phi, z = (x.ravel() for x in np.meshgrid(np.linspace(0, 6.2, 181), np.linspace(-1, 1, 53)))
    z = HALF * z
    errors = []
    for cells in ((32, 8), (64, 16)):
        film = make_film(grid=grid_of(cells, family, graded, start=1.0), oil=oil)
        state = film.solve(given_gap(film, gap, rate, velocity))
        assert len(state.cavitation.full_film) == len(film.free)
        found = film.parameters.grid.interpolation(phi, R * z) @ state.pressure
        error = found / film.parameters.pressure_scale - pressure(phi, z)
        errors.append(np.sqrt(np.mean(error**2)))
    assert np.log2(errors[0] / errors[1]) > RATES[family] - 0.1


# --- A cavitating bearing, L/D = 1 and eccentricity 0.6: table of `test_film.py`


def cavitated_errors(family, graded, rows):
    """Largest relative error of the load over six positions of the cells.

    For one position alone it depends on where in a cell the film ends.
    """
    load, attitude = 0.436957, np.radians(51.9785)
    exact = 6 * ETA * OMEGA * (R / C) ** 2 * R * 2 * R * load
    errors = []
    for around in rows:
        found = []
        for start in np.arange(6) / 6 * 2 * np.pi / around:
            grid = grid_of((around, around // 4), family, graded, start, width=2 * R)
            film = make_film(grid=grid)
            # Without the terms of order c / R, as the table.
            state = film.solve(given_gap(film, lambda phi, z: 1 - 0.6 * np.cos(phi), 0.0, 0.5))
            found.append(force(film, state.pressure))
        difference = np.array(found) - exact * np.array([np.cos(attitude), -np.sin(attitude)])
        errors.append(np.linalg.norm(difference, axis=1).max() / exact)
    return np.array(errors)


@pytest.mark.parametrize("graded", [False, True])
@pytest.mark.parametrize("family", FAMILIES)
def test_load_of_a_cavitated_film_converges(family, graded, figure):
    # Observed: 2.0 bilinear, 2.2 to 3.2 for the quadratic elements, whose pressure has a
    # curvature that jumps inside a cell where the film ends.
    errors = cavitated_errors(family, graded, (16, 32, 64))
    rates = np.log2(errors[:-1] / errors[1:])
    least, most = (1.9, 6e-3) if family == "bilinear" else (2.0, 2e-4)
    nodes = {"bilinear": "4-node", "serendipity": "8-node", "lagrange": "9-node"}[family]
    kind = f"cavitated film, {nodes} cells"
    figure("film", f"{kind}, observed order of the load", rates.min(), least=least)
    figure("film", f"{kind}, load with 64 cells around, table", errors[-1], most=most, unit="%")
