"""Rigid bearings against tables and exact solutions, and what must not matter to a film."""

import numpy as np
import pytest
from film_cases import ETA, FAMILIES, OMEGA, C, R, force, gap_of, given_gap, make_film, shaft, solve
from film_grids import graded_grid

import fenics_ehd as ehd
from fenics_ehd.film.kinematics import Gap

pytestmark = pytest.mark.kernels

# Plain 360-degree bearing, L/D = 1, Reynolds complementarity, finite volumes on 960 x 96 cells with
# Richardson extrapolation: eccentricity ratio, load W / (6 eta omega (R/c)^2 R L), attitude [deg].
RIGID_BEARING = [(0.2, 0.0849692, 77.66), (0.6, 0.436957, 51.9785), (0.9, 2.81281, 26.7017)]
SCALE = 6 * ETA * OMEGA * (R / C) ** 2


@pytest.mark.parametrize(("eccentricity", "load", "attitude"), RIGID_BEARING)
def test_rigid_bearing_of_4_node_cells_matches_finite_volume_table(eccentricity, load, attitude):
    # Of 9-node cells: `test_bearing.py`; rates of all three: `test_film_convergence.py`.
    film = make_film((240, 60), "bilinear")
    found = force(film, solve(film, eccentricity).pressure)
    assert np.hypot(*found) / (SCALE * R * 2 * R) == pytest.approx(load, rel=2e-3)
    # Load line to line of centres, in the direction of rotation.
    assert np.degrees(np.arctan2(-found[1], found[0])) == pytest.approx(attitude, abs=0.1)


def test_centred_squeeze_film_has_its_exact_pressure():
    # H = 1 sinking uniformly: p = -6 eta h' (B^2/4 - z^2) / h^3, quadratic in z.
    film = make_film((12, 3), width=R)
    z = film.parameters.grid.node_positions[:, 1]
    pressure = film.solve(given_gap(film, 1.0, rate=-0.4)).pressure
    expected = 6 * ETA * 0.4 * C * OMEGA / C**3 * (R**2 / 4 - z**2)
    np.testing.assert_allclose(pressure, expected, atol=1e-10 * expected.max())


def test_infinitely_long_bearing_of_one_cell_width_is_sommerfelds():
    # Closed sides leave no gradient along z. Sommerfeld's pressure with p = p0 at the widest gap;
    # p0 is high enough to keep the film whole.
    e, p0 = 0.5, 1e8
    film = make_film((64, 1), sides=ehd.Sides(None, None), regions=(ehd.AxialGroove(0.0, 0.0, p0),))
    state = solve(film, -e)
    phi = film.parameters.grid.node_positions[:, 0]
    h = 1 + e * np.cos(phi)
    expected = p0 + SCALE * e * np.sin(phi) * (2 + e * np.cos(phi)) / ((2 + e**2) * h**2)
    assert state.pressure.min() > 0
    np.testing.assert_allclose(state.pressure, expected, atol=2e-3 * (expected.max() - p0))


def test_very_short_bearing_is_ocviriks():
    # L/D = 0.0025: p = 3 eta omega / (R C^2) dH/dphi / H^3 (z^2 - B^2/4) where positive.
    film = make_film((128, 2), width=0.005 * R)
    phi, z = film.parameters.grid.node_positions.T
    pressure = solve(film, -0.5).pressure
    h = 1 + 0.5 * np.cos(phi)
    expected = 3 * ETA * OMEGA / C**2 * 0.5 * np.sin(phi) / h**3 * ((0.0025 * R) ** 2 - z**2)
    assert np.abs(pressure - np.maximum(expected, 0)).max() < 2e-3 * expected.max()


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("rate", [1e-3 * OMEGA, 37.0, 1e3 * OMEGA])
def test_reference_rate_does_not_matter(family, rate):
    motion = {"rate": (20.0, -60.0)}
    expected = solve(make_film(family=family), 0.5, 0.3, **motion).pressure
    found = solve(make_film(family=family, rate=rate), 0.5, 0.3, **motion).pressure
    np.testing.assert_allclose(found, expected, atol=1e-9 * expected.max())


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("cells", [(20, 5), (64, 8)])
def test_warm_start_gives_the_cold_pressure_at_once(family, cells):
    film = make_film(cells, family)
    cold = solve(film, 0.7, rate=(0.0, 30.0))
    other = solve(film, 0.4, 0.4)
    warm = solve(film, 0.7, rate=(0.0, 30.0), guess=other)
    again = solve(film, 0.7, rate=(0.0, 30.0), guess=cold)
    tolerance = 1e-9 * cold.pressure.max()
    np.testing.assert_allclose(warm.pressure, cold.pressure, atol=tolerance)
    np.testing.assert_allclose(again.pressure, cold.pressure, atol=tolerance)
    assert again.cavitation.iterations <= 1
    np.testing.assert_array_equal(warm.cavitation.full_film, cold.cavitation.full_film)


@pytest.mark.slow
def test_steep_gap_gives_the_same_load_on_two_meshes():
    loads = []
    for cells in ((160, 24), (320, 32)):
        grid = graded_grid(R, 2 * R, cells, focus=0.0, ratio=100.0)
        film = make_film(grid=grid)
        loads.append(np.hypot(*force(film, solve(film, 0.999).pressure)))
    assert loads[0] == pytest.approx(loads[1], rel=5e-3)


@pytest.mark.parametrize("family", FAMILIES)
def test_tilt_until_the_edge_nearly_touches_bears_a_moment_and_no_force(family):
    film = make_film((40, 10), family)
    z = film.points.height[:, :, None]
    normal = np.stack(film.points.normal, axis=-1)
    moments = []
    for tilt in (0.5, 0.9, 0.9999):
        motion = shaft(tilt=np.array([0.0, tilt * C / R]))
        pressure = film.solve(gap_of(film, motion)).pressure
        size = np.hypot(*force(film, pressure * (film.parameters.grid.node_positions[:, 1] > 0)))
        # One end is the other turned by half a turn.
        assert np.hypot(*force(film, pressure)) < 1e-6 * size
        moments.append(np.hypot(*(film.load(z * normal) @ pressure)))
    assert moments[0] < 0.4 * moments[1] < 0.4 * moments[2]


def test_one_cell_wide_bilinear_film_has_no_unknown_and_says_so():
    with pytest.raises(ehd.errors.SettingsError, match="node of the film has a given pressure"):
        make_film((20, 1), "bilinear")


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("cells", [(12, 3), (20, 5), (33, 7)])
def test_centred_shaft_gives_no_pressure(family, cells):
    # The rest of the source by round-off.
    film = make_film(cells, family)
    for speed in (0.0, OMEGA, -3 * OMEGA):
        for eccentricity in (0.0, 1e-15, 1e-12):
            assert solve(film, eccentricity, speed=speed).pressure.max() < 1e-3


@pytest.mark.parametrize("family", FAMILIES)
def test_growing_gap_cavitates_everywhere(family):
    film = make_film((36, 4), family)
    state = film.solve(given_gap(film, 1.0, rate=lambda phi, z: 1 + 0.5 * np.cos(phi)))
    assert state.pressure.max() == 0.0
    assert len(state.cavitation.full_film) == 0


def test_closed_gap_is_refused_with_its_value():
    film = make_film((12, 3))
    with pytest.raises(ehd.errors.GapClosedError, match=r"-0\.1\d* um, but must be above 0"):
        film.solve(given_gap(film, lambda phi, z: 1 - 1.01 * (np.cos(phi) > 0.9)))


@pytest.mark.parametrize("name", ["thickness", "thickness_rate", "mean_velocity"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_gap_that_is_no_number_is_refused(name, value):
    film = make_film((12, 3))
    values = gap_of(film, shaft(0.5)).__dict__ | {}
    values[name] = values[name].copy()
    values[name][3, 2] = value
    with pytest.raises(
        (ehd.errors.SettingsError, ehd.errors.GapClosedError), match=r"finite|above 0"
    ):
        film.solve(Gap(**values))


@pytest.mark.parametrize(
    ("more", "named"),
    [
        ({"clearance": 0.0}, "clearance = 0"),
        ({"clearance": np.nan}, "clearance = nan"),
        ({"clearance": 1.0}, "clearance = 1 m must be below the radius"),
        ({"rate": -3.0}, "rate = -3"),
        ({"rate": np.inf}, "rate = inf"),
    ],
)
def test_impossible_parameters_are_refused(more, named):
    with pytest.raises(ehd.errors.SettingsError, match=named):
        make_film(**more)


def test_heights_need_not_be_centred():
    angles = np.linspace(0, 2 * np.pi, 25)
    heights = np.array([0.0, 0.2, 0.5, 0.6]) * R
    gap = {"rate": (30.0, 0.0)}
    found, expected = (
        solve(make_film(grid=ehd.FilmGrid(R, angles, z)), 0.5, **gap).pressure
        for z in (heights, heights - 0.3 * R)
    )
    np.testing.assert_allclose(found, expected, atol=1e-9 * expected.max())


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
}


# In units of the drag. Not for 8 nodes: their p is orthogonal to N^-1 (A p - b), not to A p - b.
@pytest.mark.parametrize("family", ["bilinear", "lagrange"])
@pytest.mark.parametrize("oil", OILS)
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
