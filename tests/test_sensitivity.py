"""Exact derivatives of the film's pressure, and its powers."""

import numpy as np
import pytest
from film_cases import ETA, FAMILIES, OMEGA, C, R, gap_of, given_gap, make_film, moved, shaft
from nested_film import GapChange, pressure_derivative

import fenics_ehd as ehd
from fenics_ehd.film.kinematics import Gap

OILS = {
    "constant": ehd.Lubricant(ETA),
    "position": ehd.Lubricant(
        ETA,
        viscosity_field=lambda phi, z: 1.5 + np.sin(phi),
        density_field=lambda phi, z: 1 + 0.1 * np.cos(phi),
    ),
    "Barus": ehd.Lubricant(ETA, viscosity_law=ehd.Barus(5e-9)),
    "Roelands": ehd.Lubricant(ETA, viscosity_law=ehd.Roelands(ETA)),
    "Cross": ehd.Lubricant(ETA, shear_law=ehd.Cross(5e5, 0.7, 0.4)),
    "Cross and Barus": ehd.Lubricant(
        ETA, viscosity_law=ehd.Barus(5e-9), shear_law=ehd.Cross(5e5, 1.2, 0.0)
    ),
    "compressible": ehd.Lubricant(
        ETA, viscosity_law=ehd.Barus(1e-8), density_law=ehd.DowsonHigginson()
    ),
}


def bore_like(film, seed):
    """Gap of a deformed bore and a direction of change, unlike at every Gauss point."""
    random = np.random.default_rng(seed)
    gap = gap_of(film, shaft(0.7, 0.1, rate=(0.0, 30.0)))
    values = random.standard_normal((6, *gap.thickness.shape))
    scale = np.array(
        [0.02 * C, C * OMEGA * 0.02, C, 0.1 * C * OMEGA, 0.1 * R * OMEGA, 0.1 * R * OMEGA]
    )
    bump, bump_rate, *direction = values * scale[:, None, None]
    thickness, rate = gap.thickness + bump, gap.thickness_rate + bump_rate
    gap = Gap(thickness, rate, gap.mean_velocity, gap.sliding_velocity)
    return gap, GapChange(*(x[..., None] for x in direction))


def assert_exact(film, gap, slopes, *, tolerance=1e-7, step=1e-6):
    state = film.solve(gap)
    exact = pressure_derivative(film, state, slopes)[:, 0]
    sides = [film.solve(moved(gap, slopes, h), state) for h in (step, -step)]
    for side in sides:
        assert np.array_equal(side.cavitation.full_film, state.cavitation.full_film)
    difference = (sides[0].pressure - sides[1].pressure) / (2 * step)
    assert np.abs(exact - difference).max() < tolerance * np.abs(difference).max()


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("oil", OILS)
def test_sensitivity_is_the_exact_derivative(family, oil):
    film = make_film((20, 4), family, oil=OILS[oil], tolerance=1e-13)
    assert_exact(film, *bore_like(film, seed=3))


@pytest.mark.parametrize("family", FAMILIES)
def test_sensitivity_is_exact_with_supplied_oil(family):
    more = {"sides": ehd.Sides(2e5, None), "regions": (ehd.AxialGroove(2.0, 0.7, 8e5),)}
    film = make_film((20, 4), family, oil=OILS["Barus"], tolerance=1e-13, **more)
    assert_exact(film, *bore_like(film, seed=4))


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("oil", ["constant", "Barus"])
def test_sensitivity_is_that_of_the_state_given_whatever_was_solved_since(family, oil):
    first, second = (make_film((20, 4), family, oil=OILS[oil]) for _ in range(2))
    gap, slopes = bore_like(first, seed=3)
    state = first.solve(gap)
    expected = pressure_derivative(first, state, slopes)
    other = second.solve(gap_of(second, shaft(0.2, -0.5)))
    pressure_derivative(second, other, slopes)
    # Solved, then something else solved, then asked; and solved from itself, in no iterations.
    late = second.solve(gap)
    second.solve(gap_of(second, shaft(0.3, -0.5)))
    tolerance = 1e-8 * np.abs(expected).max()
    np.testing.assert_allclose(pressure_derivative(second, late, slopes), expected, atol=tolerance)
    pressure_derivative(second, other, slopes)
    again = second.solve(gap, late)
    assert again.cavitation.iterations == 0
    np.testing.assert_allclose(pressure_derivative(second, again, slopes), expected, atol=tolerance)


@pytest.mark.parametrize("family", FAMILIES)
def test_film_that_cavitates_everywhere_has_no_slope(family):
    film = make_film((12, 3), family)
    state = film.solve(given_gap(film, 1.0, rate=1.0))
    slopes = bore_like(film, seed=1)[1]
    assert np.all(pressure_derivative(film, state, slopes) == 0.0)


# In units of the drag. Not for 8 nodes: their p is orthogonal to N^-1 (A p - b), not to A p - b.
@pytest.mark.parametrize("family", ["bilinear", "lagrange"])
@pytest.mark.parametrize("oil", ["constant", "position", "Barus", "Roelands", "Cross"])
def test_pressure_work_equals_drag_less_dissipation(family, oil):
    film = make_film(width=0.022, family=family, oil=OILS[oil])
    gap = gap_of(film, shaft(0.6, rate=(50.0, 100.0), tilt=np.array([2e-4, 1e-4])))
    state = film.solve(gap)
    loss, drag = film.powers(state)
    field = film.parameters.lubricant.density_field
    density = field(film.points.angle, film.points.height) if field else 1.0
    work = -film.load((density * gap.thickness_rate)[:, :, None])[0] @ state.pressure
    assert loss - drag == pytest.approx(work, rel=1e-8)
    assert loss > 0
