"""Given pressures: sides, grooves and holes."""

import numpy as np
import pytest
from film_cases import ETA, FAMILIES, OMEGA, R, given_gap, make_film, solve
from film_grids import graded_grid

import fenics_ehd as ehd
from fenics_ehd.film.grid import aligned_grid


@pytest.mark.parametrize("family", FAMILIES)
def test_pressure_between_two_sides_is_linear(family):
    grid = graded_grid(R, 2 * R, (12, 4), family, focus=0.3, ratio=3.0)
    film = make_film(grid=grid, sides=ehd.Sides(1e5, 3e6))
    z = grid.node_positions[:, 1]
    expected = 1e5 + (3e6 - 1e5) * (z / (2 * R) + 0.5)
    # Still, and turning without eccentricity.
    for speed in (0.0, OMEGA):
        np.testing.assert_allclose(solve(film, speed=speed).pressure, expected, rtol=1e-8)


@pytest.mark.parametrize(
    "oil", [ehd.Lubricant(ETA), ehd.Lubricant(ETA, viscosity_law=ehd.Barus(1e-8))]
)
def test_still_film_of_even_pressure_stays_there(oil):
    film = make_film((20, 4), sides=ehd.Sides(2e6, 2e6), oil=oil)
    pressure = solve(film, 0.7, speed=0.0).pressure
    np.testing.assert_allclose(pressure, 2e6, rtol=1e-8)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("side", ["lower", "upper"])
def test_closed_side_is_the_middle_of_a_symmetric_film(family, side):
    heights = np.linspace(-R, R, 9)
    half = heights[4:] if side == "lower" else heights[:5]
    whole = make_film(grid=ehd.FilmGrid(R, np.linspace(0, 2 * np.pi, 25), heights, family))
    part = make_film(
        grid=ehd.FilmGrid(R, np.linspace(0, 2 * np.pi, 25), half, family),
        sides=ehd.Sides(**{side: None}),
    )
    expected, found = (solve(f, 0.6, 0.1, rate=(20.0, 30.0)).pressure for f in (whole, part))
    np.testing.assert_allclose(
        found,
        whole.parameters.grid.interpolation(*part.parameters.grid.node_positions.T) @ expected,
        atol=1e-8 * expected.max(),
    )


def test_ambient_pressure_shifts_a_film_that_stays_whole():
    plain, raised = (make_film((24, 4), sides=ehd.Sides(p, p)) for p in (1e8, 1.5e8))
    one, other = (solve(f, 0.4) for f in (plain, raised))
    assert one.pressure.min() > 0
    np.testing.assert_allclose(other.pressure, one.pressure + 0.5e8, rtol=1e-8)


@pytest.mark.parametrize("family", FAMILIES)
def test_groove_has_its_pressure_between_its_edges(family):
    groove = ehd.AxialGroove(np.radians(40.0), np.radians(25.0), 3e5)
    grid = aligned_grid(ehd.uniform_grid(R, 2 * R, (48, 6), family), np.array(groove.edges))
    film = make_film(grid=grid, regions=(groove,))
    pressure = solve(film, -0.6).pressure
    angle = grid.node_positions[:, 0]
    inside = np.abs(np.mod(angle - groove.angle + np.pi, 2 * np.pi) - np.pi) < 0.2182
    # Up to the sides, and no further than its edges.
    assert np.all(pressure[inside] == 3e5)
    edges = np.isin(np.round(np.degrees(angle), 8), (27.5, 52.5))
    assert np.all(pressure[edges] == 3e5)
    beyond = np.mod(angle - groove.angle, 2 * np.pi)
    assert not np.any(pressure[(beyond > 0.22) & (beyond < 0.5)] == 3e5)


def test_full_groove_makes_strips_whose_pressures_do_not_meet():
    # Two lines of given pressure cut the film in two: what moves on one side is not felt beyond.
    lines = (ehd.AxialGroove(0.0, 0.0, 1e6), ehd.AxialGroove(np.pi, 0.0, 1e6))
    film = make_film((32, 4), regions=lines, sides=ehd.Sides(1e6, 1e6))
    angle = film.parameters.grid.node_positions[:, 0]
    quiet, loud = (
        film.solve(given_gap(film, 1.0, lambda phi, z, s=s: -s * (phi < np.pi))).pressure
        for s in (0.0, 0.1)
    )
    np.testing.assert_allclose(quiet, 1e6, rtol=1e-9)
    np.testing.assert_allclose(loud[angle > np.pi], 1e6, rtol=1e-9)
    assert loud[angle < np.pi].max() > 2e6


def test_part_of_the_width_can_have_a_groove():
    film = make_film((24, 8), regions=(ehd.AxialGroove(1.0, 0.6, 5e5, length=R),))
    angle, z = film.parameters.grid.node_positions.T
    fixed = np.setdiff1d(np.arange(len(z)), film.free)
    inner = fixed[np.abs(z[fixed]) < R * (1 - 1e-9)]
    assert np.abs(z[inner]).max() == pytest.approx(R / 2)
    assert np.abs(angle[inner] - 1.0).max() <= 0.3


def test_later_regions_win():
    regions = (ehd.AxialGroove(1.0, 1.0, 1e5), ehd.AxialGroove(1.0, 0.5, 2e5))
    film = make_film((48, 4), regions=regions)
    pressure = solve(film, 0.3).pressure
    angle = film.parameters.grid.node_positions[:, 0]
    assert np.all(pressure[np.abs(angle - 1.0) < 0.25] == 2e5)


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (
            lambda: make_film((20, 5), regions=(ehd.AxialGroove(0.1, 0.01, 1e5),)),
            "no node .* more cells",
        ),
        (lambda: make_film((20, 5), regions=(ehd.AxialGroove(0.1, 6.28),)), "every node"),
        (
            lambda: make_film((20, 5), regions=(ehd.AxialGroove(np.nan, 0.1),)),
            "angle of a groove = nan",
        ),
        (
            lambda: solve(make_film((20, 5), sides=ehd.Sides(None, None)), 0.5),
            "the film has no node of given pressure",
        ),
        (lambda: ehd.AxialGroove(0.0, 7.0), "401.07 degrees wide"),
        (lambda: ehd.AxialGroove(0.0, -0.1), "degrees wide"),
        (lambda: ehd.AxialGroove(0.0, np.nan), "width of a groove = nan"),
        (lambda: ehd.AxialGroove(0.0, 0.1, -1.0), "pressure of a groove = -1 Pa"),
        (lambda: ehd.AxialGroove(0.0, 0.1, np.nan), "pressure of a groove = nan"),
        (lambda: ehd.Sides(-1.0), "lower side = -1 Pa"),
        (lambda: ehd.Sides(0.0, np.nan), "upper side = nan"),
    ],
)
def test_impossible_supplies_are_refused(make, named):
    with pytest.raises(ehd.errors.SettingsError, match=named):
        make()
