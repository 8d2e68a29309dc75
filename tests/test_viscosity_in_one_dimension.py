"""Viscosity laws against solutions in one dimension: a long slider wound round the bore.

``d/ds (H^3 / eta dp/ds) = A dH/ds`` with no pressure at both ends has for constant viscosity the
solution Q in closed form; with ``dq = dp / r(p)`` every law r of pressure has it for q, and a
viscosity that depends on the thickness alone is a quadrature.
"""

import numpy as np
import pytest
from film_cases import ETA, OMEGA, C, R, given_gap, make_film
from scipy.integrate import cumulative_trapezoid, solve_ivp

import fenics_ehd as ehd

GROUP = "oil"

#: Thickness at inlet and outlet over the clearance, and mean velocity over Omega R.
INLET, OUTLET, VELOCITY = 2.0, 1.0, 0.3

CROSS = ehd.Cross(2e5, 0.8, 0.3)


def thickness(angle):
    return INLET - (INLET - OUTLET) * angle / (2 * np.pi)


def slider(cells, family, oil):
    """Nodal angles at mid-width and pressures of the film."""
    line = ehd.AxialGroove(0.0, 0.0)
    film = make_film((cells, 1), family, oil=oil, sides=ehd.Sides(None, None), regions=(line,))
    state = film.solve(given_gap(film, lambda phi, z: thickness(phi), 0.0, VELOCITY))
    angle, height = film.parameters.grid.node_positions.T
    middle = height == height.min()
    return angle[middle], state.pressure[middle]


def reduced(angle, thinned=lambda shear_rate: 1.0):
    """Exact q at angles, the shear law's by fine quadrature [Pa]."""
    s = np.linspace(0.0, 2 * np.pi, 200_001)
    h = C * thickness(s)
    speed = VELOCITY * OMEGA * R
    factor = 12 * ETA * R * thinned(2 * speed / h)
    carried, driven = (cumulative_trapezoid(factor / h**power, s, initial=0.0) for power in (2, 3))
    flow = speed * carried[-1] / driven[-1]
    return np.interp(angle, s, speed * carried - flow * driven)


def closed_form(angle):
    """Exact q for constant viscosity [Pa]."""
    h = thickness(angle)
    mean = 2 * INLET * OUTLET / (INLET + OUTLET)
    scale = 12 * ETA * VELOCITY * OMEGA * R * 2 * np.pi * R / (C**2 * (INLET - OUTLET))
    return scale * (1 / h - 1 / INLET - mean / 2 * (1 / h**2 - 1 / INLET**2))


def test_the_quadrature_is_the_closed_form_where_there_is_one():
    angle = np.linspace(0, 2 * np.pi, 50)
    exact = closed_form(angle)
    np.testing.assert_allclose(reduced(angle), exact, atol=1e-9 * exact.max())


def observed(oil, family, exact, cells=(20, 40, 80)):
    """Largest nodal errors over the largest pressure on finer and finer meshes."""
    errors = []
    for count in cells:
        angle, pressure = slider(count, family, oil)
        expected = exact(angle)
        errors.append(np.abs(pressure - expected).max() / expected.max())
    return errors


def order(errors):
    return np.log2(errors[-2] / errors[-1])


#: Nodal values of quadratic elements converge with order 4 where the coefficients are smooth.
ORDERS = {"bilinear": 1.8, "lagrange": 3.0}


@pytest.mark.parametrize("share", [0.5, 0.9])
@pytest.mark.parametrize("family", ORDERS)
def test_barus_slider_has_its_exact_pressure(family, share, figure):
    alpha = share / closed_form(np.linspace(0, 2 * np.pi, 5000)).max()
    oil = ehd.Lubricant(ETA, ehd.Barus(alpha))
    errors = observed(oil, family, lambda a: -np.log1p(-alpha * closed_form(a)) / alpha)
    assert order(errors) > ORDERS[family]
    if family == "lagrange":
        name = f"long slider, Barus, {share:g} of what the law can bear, 80 cells"
        figure(GROUP, name, errors[-1], most=1e-5, unit="%")


@pytest.mark.parametrize("family", ORDERS)
def test_roelands_slider_is_the_quadrature_of_the_reduced_pressure(family, figure):
    viscosity = 0.06
    law = ehd.Roelands(viscosity, 0.6)
    oil = ehd.Lubricant(viscosity, law)

    def exact(angle):
        # dp/dq = r(p), by an integrator of its own.
        q = closed_form(angle) * viscosity / ETA
        most = q.max()
        solution = solve_ivp(
            lambda _, p: law(p)[0], (0.0, most), [0.0], rtol=1e-12, atol=1e-3, dense_output=True
        )
        return solution.sol(q)[0]

    errors = observed(oil, family, exact)
    assert exact(np.linspace(0, 6, 500)).max() > 1.3 * closed_form(np.pi) * viscosity / ETA
    assert order(errors) > ORDERS[family]
    if family == "lagrange":
        figure(GROUP, "long slider, Roelands, 80 cells", errors[-1], most=1e-5, unit="%")


@pytest.mark.parametrize("family", ORDERS)
def test_cross_slider_is_a_quadrature(family, figure):
    oil = ehd.Lubricant(ETA, shear_law=CROSS)

    def thinned(rate):
        # Cross's law in its own words.
        return 0.3 + 0.7 / (1 + (rate / 2e5) ** 0.8)

    errors = observed(oil, family, lambda a: reduced(a, thinned))
    ends = thinned(2 * VELOCITY * OMEGA * R / (C * np.array([INLET, OUTLET])))
    assert ends[1] < ends[0] - 0.05 < 0.75
    assert order(errors) > ORDERS[family]
    if family == "lagrange":
        figure(GROUP, "long slider, Cross, 80 cells", errors[-1], most=1e-5, unit="%")


def test_laws_of_pressure_and_shear_rate_multiply():
    def thinned(rate):
        return 0.3 + 0.7 / (1 + (rate / 2e5) ** 0.8)

    alpha = 0.7 / reduced(np.linspace(0, 2 * np.pi, 5000), thinned).max()
    oil = ehd.Lubricant(ETA, ehd.Barus(alpha), shear_law=CROSS)
    errors = observed(oil, "lagrange", lambda a: -np.log1p(-alpha * reduced(a, thinned)) / alpha)
    assert order(errors) > ORDERS["lagrange"]
    assert errors[-1] < 1e-4


def test_surfaces_that_do_not_slide_do_not_thin_the_oil():
    thin, plain = (
        make_film((20, 4), oil=ehd.Lubricant(ETA, shear_law=law)) for law in (CROSS, None)
    )
    pressures = [
        film.solve(given_gap(film, lambda phi, z: 1 + 0.3 * np.cos(phi), -0.2)).pressure
        for film in (thin, plain)
    ]
    np.testing.assert_allclose(*pressures, rtol=1e-12, atol=1e-9 * pressures[1].max())
