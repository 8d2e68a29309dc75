"""Balance of a film's heat: against bisection, a published example, and the energy put in."""

from math import exp, log10, pi

import attrs
import numpy as np
import pytest
from scipy.optimize import brentq

import fenics_ehd as ehd
from fenics_ehd.film.forces import FilmFlows, film_fields
from fenics_ehd.film.heat import TemperatureSearch

OIL = ehd.Oil(46.0, 6.645)
#: A thousand times as thin over the temperatures that it has.
STEEP = ehd.Oil(1000.0, 10.0)


def viscosity_by_hand(nu_40, nu_100, temperature, density_15=870.0):
    """Walther's equation and a linear density, written down once more [Pa s]."""
    first, second = (log10(log10(nu + 0.7)) for nu in (nu_40, nu_100))
    slope = (first - second) / (log10(373.15) - log10(313.15))
    nu = 10**10 ** (first - slope * (log10(temperature + 273.15) - log10(313.15))) - 0.7
    return 1e-6 * nu * density_15 * (1 - 6.5e-4 * (temperature - 15.0))


# --- The search.


def searched(oil, heat, power, flow, exponent, tolerance=1e-6):
    """Moves until a film whose P / Q follows a power of the viscosity is balanced."""
    search = TemperatureSearch(heat, oil)
    for moves in range(60):
        ratio = oil.viscosity(search.temperature) / 0.01
        now = power * ratio ** (0.6 * exponent), flow * ratio ** (-0.4 * exponent)
        if abs(search.defect(*now)) <= tolerance:
            return search.temperature, moves
        search.move(*now)
    raise AssertionError("no balance")


@pytest.mark.parametrize("exponent", [0.0, 0.4, 1.0, 1.6, 2.0])
@pytest.mark.parametrize(("oil", "supply"), [(OIL, 60.0), (OIL, 0.0), (STEEP, 20.0)])
def test_the_balance_is_found_from_a_supply_that_is_far_away(oil, supply, exponent):
    heat = ehd.Heat(supply_temperature=supply, conducted_share=0.2)

    def excess(t):
        ratio = oil.viscosity(t) / 0.01
        rise = 0.5 * 0.8 * 300.0 / (oil.density(t) * 2000.0 * 4e-6) * ratio**exponent
        return supply + rise - t

    expected = brentq(excess, supply, oil.hottest - 1e-6)
    found, moves = searched(oil, heat, 300.0, 4e-6, exponent)
    assert found == pytest.approx(expected, abs=1e-5)
    assert moves <= 9


def test_no_oil_that_leaves_and_heat_that_cannot_are_told():
    search = TemperatureSearch(ehd.Heat(supply_temperature=60.0), OIL)
    assert search.heat.outlet(OIL, 60.0, 100.0, 0.0) == np.inf
    temperatures = []
    while search.temperature < OIL.hottest - 1e-6:
        search.move(100.0, 0.0)
        temperatures.append(search.temperature)
    with pytest.raises(ehd.errors.HeatError, match=r"^heat: .* carry away the heat: .* highest"):
        search.move(100.0, 0.0)
    assert search.without_balance
    assert all(np.diff(temperatures) > 0)
    # Not at once: four times as thin each time.
    ratios = [
        OIL.viscosity(a) / OIL.viscosity(b)
        for a, b in zip([60.0, *temperatures], temperatures, strict=False)
    ]
    assert max(ratios) == pytest.approx(4.0)
    # An idle film is as warm as its supply.
    search.move(0.0, 1e-6)
    assert search.temperature == 60.0


@pytest.mark.parametrize(
    ("key", "value"),
    [("conducted_share", 1.0), ("conducted_share", -0.1), ("outlet_weight", 0.0),
     ("outlet_weight", 1.1), ("tolerance", 0.0), ("supply_temperature", np.nan)],
)  # fmt: skip
def test_what_no_balance_can_have_is_refused(key, value):
    with pytest.raises(ehd.errors.SettingsError, match=key):
        ehd.Heat(**{"supply_temperature": 60.0, key: value})


# --- The film at another temperature, and the oil that leaves it.


def film_of(lubricant, **given):
    grid = ehd.uniform_grid(0.0225, 0.022, (24, 6), "lagrange")
    return ehd.Film(ehd.FilmParameters(grid, 17e-6, lubricant, 500.0, **given))


def state_of(film, eccentricity=(0.7, 0.0), rate=(0.0, 0.0), tilt=(0.0, 0.0)):
    place, speed = np.array(eccentricity) * 17e-6, np.array(rate)
    motion = ehd.ShaftMotion(place, 500.0, speed, np.array(tilt))
    return film.solve(ehd.shaft_gap(film.points, 0.0225, 17e-6, motion))


@pytest.mark.parametrize("law", [None, ehd.Barus(2e-8), ehd.Roelands(OIL.viscosity(70.0), 0.6)])
def test_a_warmed_film_is_one_of_that_temperature(law):
    changes = {} if law is None else {"viscosity_law": law}
    lubricant = attrs.evolve(ehd.Lubricant.of(OIL, 70.0), **changes)
    film = film_of(lubricant)
    warmed = film.with_own_temperature()
    warmed.set_temperature(110.0)
    expected, found = film_of(lubricant.at(110.0)), None
    state, found = state_of(expected), state_of(warmed)
    np.testing.assert_allclose(found.pressure, state.pressure, rtol=1e-8, atol=1e-3)
    assert warmed.powers(found) == pytest.approx(expected.powers(state), rel=1e-8)
    leaving = FilmFlows(expected, state).leaving
    assert FilmFlows(warmed, found).leaving == pytest.approx(leaving, rel=1e-7)
    # The film that it came from is as it was.
    assert film.equation.lubricant is lubricant
    assert state_of(film).pressure.max() > 1.5 * found.pressure.max()


def test_through_sides_at_the_cavitation_pressure_the_side_flow_leaves():
    film = film_of(ehd.Lubricant(0.01))
    for motion in ({}, {"rate": (0.02, 0.01)}, {"rate": (-0.02, 0.0)}):
        state = state_of(film, **motion)
        flows = FilmFlows(film, state)
        assert flows.leaving == pytest.approx(flows.balance.side, rel=1e-12)


def test_oil_that_comes_in_over_the_sides_takes_nothing_off_what_leaves():
    film = film_of(ehd.Lubricant(0.01), sides=ehd.Sides(3e5, 3e5))
    state = state_of(film)
    flows, leaving = FilmFlows(film, state).balance, FilmFlows(film, state).leaving
    assert flows.side == pytest.approx(flows.cavities, abs=1e-6 * leaving)
    # What is counted, from the slope of the pressure along the axis just inside the ends.
    fields, gap, height = film_fields(film, state), state.gap.thickness, film.points.height
    along = film.assembly.at_points(state.pressure)[2] / film.parameters.grid.radius
    flux = -(gap**3) / (12 * fields.viscosity) * along * np.sign(height)
    last = np.abs(height) > np.abs(height).max() - 1e-12
    weights = film.assembly.area[last] / film.assembly.area[last].sum()
    over = 2 * 2 * pi * 0.0225 * float(weights @ np.maximum(flux[last], 0.0))
    assert leaving == pytest.approx(over, rel=0.05)
    assert leaving > 1.3 * abs(flows.side)


def test_oil_pressed_into_a_groove_leaves_and_what_is_dragged_through_does_not():
    # A groove at low pressure where the film bears takes oil from it.
    taking = film_of(ehd.Lubricant(0.01), regions=(ehd.AxialGroove(-0.5, 0.3, 0.0),))
    state = state_of(taking, (0.7, 0.0))
    flows, leaving = FilmFlows(taking, state).balance, FilmFlows(taking, state).leaving
    assert flows.supply < 0
    assert leaving == pytest.approx(flows.side + max(0.0, -flows.supply - flows.cavities))
    # At the widest gap oil is dragged in and out.
    feeding = film_of(ehd.Lubricant(0.01), regions=(ehd.AxialGroove(pi, 0.3, 0.0),))
    state = state_of(feeding, (0.7, 0.0))
    flows = FilmFlows(feeding, state)
    assert flows.leaving == pytest.approx(flows.balance.side)


# --- A bearing.

BEARING = ehd.BearingSettings(
    grade="ISO VG 46", supply_temperature=60.0, cells_around=24, cells_along=6
)


def by_bisection(settings, low, high, conducted=0.0, mixing=0.5, **given):
    """Effective temperature between two others, from bearings of given viscosities alone [C]."""
    plain = attrs.evolve(
        settings, grade="none", supply_temperature=-273.15, conducted=0.0, mixing=0.5
    )

    def excess(t):
        result = ehd.solve_bearing(
            attrs.evolve(plain, viscosity=viscosity_by_hand(46.0, 6.645, t)), **given
        )
        density = 870.0 * (1 - 6.5e-4 * (t - 15.0))
        rise = (1 - conducted) * result.dissipation / (density * 2000.0 * result.flow.side)
        return 60.0 + mixing * rise - t

    assert excess(low) > 0 > excess(high)
    while high - low > 1e-5:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return low


@pytest.mark.parametrize(
    ("given", "shares"),
    [
        ({"load": 3000.0}, {}),
        pytest.param({"eccentricity": 0.6}, {"conducted": 0.3}, marks=pytest.mark.slow),
        pytest.param({"load": 20000.0}, {"mixing": 1.0}, marks=pytest.mark.slow),
    ],
)
def test_the_temperature_of_a_bearing_is_that_of_bisection(given, shares, figure):
    result = ehd.solve_bearing(attrs.evolve(BEARING, **shares), **given)
    found = result.heat.effective_temperature
    off = abs(found - by_bisection(BEARING, found - 1e-3, found + 2e-3, **shares, **given))
    figure(
        "heat", f"bearing, {given}, {shares or 'adiabatic'}: effective temperature from bisection",
        off, most=2e-5, unit="K",
    )  # fmt: skip
    # The result is that of a bearing at this temperature, and the heat leaves.
    heat = result.heat
    density = 870.0 * (1 - 6.5e-4 * (heat.effective_temperature - 15.0))
    carried = density * 2000.0 * heat.flow * (heat.outlet_temperature - 60.0)
    kept = 1 - shares.get("conducted", 0.0)
    assert carried == pytest.approx(kept * result.dissipation, rel=1e-9)
    share = (heat.effective_temperature - 60.0) / (heat.outlet_temperature - 60.0)
    assert share == pytest.approx(shares.get("mixing", 0.5), abs=1e-6)
    at = attrs.evolve(BEARING, supply_temperature=-273.15, temperature=heat.effective_temperature)
    again = ehd.solve_bearing(at, **given)
    assert again.heat is None
    assert result.min_film_thickness == pytest.approx(again.min_film_thickness, rel=1e-9)


@pytest.mark.slow
def test_the_temperature_converges_with_the_mesh(figure):
    found = [
        ehd.solve_bearing(
            attrs.evolve(BEARING, cells_around=4 * n, cells_along=n), load=3000.0
        ).heat.effective_temperature
        for n in (3, 6, 12)
    ]
    steps = np.abs(np.diff(found))
    figure("heat", "bearing: order of the temperature in the mesh, 12 x 3 to 48 x 12",
           float(np.log2(steps[0] / steps[1])), least=1.5)  # fmt: skip
    figure("heat", "bearing: change of the temperature from 24 x 6 to 48 x 12 cells",
           float(steps[1]), most=0.05, unit="K")  # fmt: skip


def sae_40(temperature):
    """Fit of the source of the example below [Pa s]."""
    return 6890 * 0.0121e-6 * exp(1474.4 / (1.8 * temperature + 127))


@pytest.mark.slow
def test_a_published_example_of_charts():
    """Shigley's problem of an 80 mm bearing, l/d = 1, 3 kN, 8 rev/s, SAE 40 supplied at 60 C.

    Worked by the chart of temperature rise (Raimondi and Boyd) in github.com/jeevanjyoti4/dome,
    TS6/TS6-3.ipynb: 67.1 C, 32.0 mPa s, S = 0.546. In that chart the heat leaves with
    ``Q - Q_s / 2``, Q the flow at the widest gap, and rho c = 861 kg/m3 1758 J/(kg K) is in its
    factor 0.120. What Q - Q_s / 2 carries more than Q_s is ``conducted`` here.
    """
    density = 860.8 / (1 - 6.5e-4 * (67.1 - 15.0))
    kinematic = {
        f"viscosity_{t}": 1e6 * sae_40(t) / (density * (1 - 6.5e-4 * (t - 15.0))) for t in (40, 100)
    }
    bearing = ehd.BearingSettings(
        radius=0.04, clearance=40e-6, width=0.08, speed=16 * pi, **kinematic, temperature=67.1,
        density=density, specific_heat=1758.5, line_at_max_film=True, shear_rule="full",
        cells_around=32, cells_along=6,
    )  # fmt: skip
    result = ehd.solve_bearing(bearing, load=3000.0)
    film, state = result.film, result.state
    fields, gap = film_fields(film, state), state.gap
    flux = (
        gap.mean_velocity * gap.thickness
        - gap.thickness**3 / (12 * fields.viscosity) * fields.slope_around
    )
    behind = np.mod(film.points.angle - pi, 2 * pi)
    first = np.isclose(behind, behind.min())
    area = film.assembly.area[first]
    total = 0.08 * float(area @ flux[first] / area.sum())
    # Their charts at l/d = 1 and S = 0.546 between 3.59 and 3.99.
    assert total / (0.04 * 40e-6 * 8 * 0.08) == pytest.approx(3.65, rel=0.02)
    s = result.sommerfeld_number
    carrying = total - 0.5 * result.flow.side
    rise = result.dissipation / (860.8 * 1758.5 * carrying)
    chart = (0.349109 + 6.00940 * s + 0.047467 * s**2) * (3000.0 / 0.08**2 * 1e-6) / 0.120
    assert rise == pytest.approx(chart, rel=0.02)
    heated = attrs.evolve(
        bearing, temperature=-273.15, supply_temperature=60.0,
        conducted=1 - result.flow.side / carrying,
    )  # fmt: skip
    heat = ehd.solve_bearing(heated, load=3000.0).heat
    assert heat.effective_temperature == pytest.approx(67.1, abs=0.2)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"grade": "none", "viscosity": 0.01}, "use a lubricant with a grade"),
        ({"supply_temperature": 400.0}, "temperature = 400 C of the oil must lie between"),
        (
            {"supply_temperature": -273.15, "conducted": 0.5},
            "has no effect without supply_temperature",
        ),
        ({"mixing": 1.5}, "mixing = 1.5"),
    ],
)
def test_what_a_bearing_cannot_balance_is_told(changes, message):
    with pytest.raises(ehd.errors.SettingsError, match=message):
        ehd.solve_bearing(attrs.evolve(BEARING, **changes), load=3000.0)


def test_a_bearing_whose_heat_cannot_leave_is_told():
    shut = attrs.evolve(
        BEARING, radius=0.1, width=0.4, clearance=30e-6, speed=3000.0,
    )  # fmt: skip
    with pytest.raises(ehd.errors.HeatError, match=r"oil cannot carry away .* conducted"):
        ehd.solve_bearing(shut, eccentricity=0.05)
