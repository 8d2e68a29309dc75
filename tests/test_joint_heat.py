"""Heat of joints over a cycle: against a steady bearing, an outer search, and the work put in."""

import numpy as np
import pytest
from journal_cases import in_bearing, steady
from mechanism_cases import REVOLUTION, SPEED, rigid_rod, slider_crank
from scipy.optimize import brentq

import fenics_ehd as ehd
from fenics_ehd.multibody import periodic
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.periodic import PeriodicSolver
from fenics_ehd.multibody.run import Run

OIL = ehd.Oil(46.0, 6.645)
SUPPLY = 76.0


def oil_film(cells=(16, 3), radius=22.5e-3, width=22e-3, oil=OIL, temperature=SUPPLY):
    grid = ehd.uniform_grid(radius, width, cells, "lagrange")
    return ehd.Film(ehd.FilmParameters(grid, 17e-6, ehd.Lubricant.of(oil, temperature), rate=SPEED))


def journal(film, unbalance=0.0, load=3000.0, **joint):
    """A massless journal under a constant load and a turning one."""
    turning = {"unbalance": ehd.RotatingForce("journal", unbalance, SPEED)} if unbalance else {}
    return in_bearing(film, {"load": steady(load), **turning}, speed=SPEED, **joint)


def periodic_run(mechanism, **settings):
    return ehd.simulate(
        mechanism, period=REVOLUTION, **{"tolerance": 1e-4, "periodicity": 1e-3, **settings}
    )


@pytest.mark.slow
def test_under_a_constant_load_it_is_that_of_the_steady_bearing(figure):
    heat = ehd.Heat(supply_temperature=SUPPLY, conducted_share=0.1, tolerance=1e-3)
    found = periodic_run(journal(oil_film((32, 6)), heat=heat), tolerance=1e-5, periodicity=1e-5)
    bearing = ehd.solve_bearing(
        ehd.BearingSettings(
            viscosity_40=46.0, viscosity_100=6.645, supply_temperature=SUPPLY, conducted=0.1
        ),
        load=3000.0,
    )
    steady = bearing.heat
    figures = found.figures["bearing"]
    # Half of what the outlet is off the effective temperature is.
    for name, most in (("effective", 0.05), ("outlet", 0.1)):
        off = abs(figures[f"{name}_temperature_C"] - getattr(steady, f"{name}_temperature"))
        figure("heat", f"journal under constant load: {name} temperature from that of the bearing",
               off, most=most, unit="K")  # fmt: skip
    assert figures["supply_temperature_C"] == SUPPLY
    # The sheared zone ends at a row of points, on either mesh another one.
    assert figures["mean_dissipated_power_W"] == pytest.approx(bearing.dissipation, rel=5e-3)
    assert figures["mean_leaving_flow_m3_per_s"] == pytest.approx(steady.flow, rel=2e-3)
    # Columns of the history go with the means.
    assert found.columns["dissipated_power_W"].mean() == pytest.approx(
        bearing.dissipation, rel=5e-3
    )


@pytest.mark.slow
def test_a_run_with_heat_goes_on_as_if_it_had_not_stopped():
    mechanism = journal(oil_film(), 2000.0, heat=ehd.Heat(supply_temperature=SUPPLY))

    def search():
        run = Run(mechanism, IntegratorOptions(tolerance=1e-3), REVOLUTION)
        return run, PeriodicSolver(run, REVOLUTION, 1e-2)

    run, cycles = search()
    whole, stored = [], {}
    for i, step in enumerate(cycles):
        whole.append((step.time, step.x, cycles.number))
        if i in (5, 60, 90):
            stored[i] = run.state, cycles.state
    ends = [i for i in range(1, len(whole)) if whole[i][2] > whole[i - 1][2]]
    assert len(ends) >= 2
    for i, state in stored.items():
        run, cycles = search()
        run.state, cycles.state = state
        rest = [(step.time, step.x) for step in cycles]
        assert len(rest) == len(whole) - i - 1
        for (time, x), (expected_time, expected, _) in zip(rest, whole[i + 1 :], strict=True):
            assert time == expected_time
            np.testing.assert_array_equal(x, expected)


def test_joints_that_share_a_film_have_temperatures_of_their_own():
    film, places = oil_film(), {"a": (0.0, 0.0), "b": (1.0, 0.0)}
    mechanism = ehd.Mechanism(
        bodies={
            "ground": ehd.ground(places),
            **{name: ehd.MasslessBody(position=place) for name, place in places.items()},
        },
        joints={
            name: ehd.LubricatedJoint(
                name,
                f"ground.{name}",
                film,
                heat=ehd.Heat(supply_temperature=SUPPLY, conducted_share=share),
            )
            for name, share in (("a", 0.0), ("b", 0.6))
        },
        drives={"a": ehd.Speed(SPEED), "b": ehd.Speed(SPEED)},
        forces={
            name: ehd.PointForce(name, (1.0, 0.0), lambda _time: (2000.0, 0.0))
            for name in ("a", "b")
        },
    )
    found = periodic_run(mechanism, tolerance=1e-3, periodicity=1e-2).figures
    hot, cool = (found[name]["effective_temperature_C"] for name in ("a", "b"))
    assert hot > cool + 5.0
    assert film.equation.lubricant.temperature == SUPPLY


def test_without_heat_nothing_of_it_is_called(monkeypatch):
    def never(*_args, **_kwargs):
        raise AssertionError

    monkeypatch.setattr(periodic, "TemperatureSearch", never)
    monkeypatch.setattr(periodic, "integral", never)
    result = periodic_run(journal(oil_film()), tolerance=1e-3, periodicity=1e-2)
    assert "effective_temperature_C" not in result.figures["bearing"]
    assert "dissipated_power_W" not in result.columns


# --- What cannot be.


def test_an_initial_value_problem_has_no_balance():
    with pytest.raises(ehd.errors.SettingsError, match="over a cycle"):
        ehd.simulate(journal(oil_film(), heat=ehd.Heat(supply_temperature=SUPPLY)), REVOLUTION)


def test_an_oil_of_one_viscosity_has_no_balance():
    grid = ehd.uniform_grid(22.5e-3, 22e-3, (16, 3), "lagrange")
    film = ehd.Film(ehd.FilmParameters(grid, 17e-6, ehd.Lubricant(0.01), rate=SPEED))
    with pytest.raises(ehd.errors.SettingsError, match="does not depend on its temperature"):
        ehd.LubricatedJoint("journal", "ground", film, heat=ehd.Heat(supply_temperature=SUPPLY))


def test_heat_that_cannot_leave_is_told():
    # Wide and lightly loaded: hardly any oil leaves.
    film = oil_film(width=0.3)
    with pytest.raises(ehd.errors.HeatError, match=r"bearing\.heat: the oil cannot carry away"):
        periodic_run(
            journal(film, load=30.0, heat=ehd.Heat(supply_temperature=SUPPLY)), tolerance=1e-3
        )


def test_a_film_that_heat_thins_away_is_told_as_such(monkeypatch):
    def too_thin(*_args):
        raise ehd.errors.FilmTooThinError("too thin")

    film = oil_film(width=0.3)
    mechanism = journal(film, load=30.0, heat=ehd.Heat(supply_temperature=SUPPLY))
    run = Run(mechanism, IntegratorOptions(tolerance=1e-3), REVOLUTION)
    cycles = PeriodicSolver(run, REVOLUTION)
    with pytest.raises(ehd.errors.HeatError, match="too thin"):  # noqa: PT012
        for _ in cycles:
            if cycles.number == 2:
                monkeypatch.setattr("fenics_ehd.multibody.run._check_film", too_thin)


def test_a_temperature_that_still_moves_is_told():
    mechanism = journal(oil_film(), heat=ehd.Heat(supply_temperature=SUPPLY, tolerance=1e-9))
    with pytest.raises(ehd.errors.PeriodicityError, match=r"bearing\.heat\.tolerance = 1e-09"):
        periodic_run(mechanism, tolerance=1e-3, periodicity=0.5, cycles=2)


# --- The slider-crank.


def crank(heat, cells=(20, 4), temperature=SUPPLY, **joint):
    return slider_crank(rigid_rod(), oil_film(cells, temperature=temperature), heat=heat, **joint)


@pytest.mark.slow
def test_cycle_and_temperature_are_those_of_an_outer_search(figure):
    """Power and flow of whole periodic solutions at constant viscosities, and Brent's method."""

    def excess(temperature):
        still = ehd.Heat(supply_temperature=temperature, outlet_weight=1e-9, tolerance=1e-3)
        found = periodic_run(crank(still, temperature=temperature)).figures["big_end"]
        carried = OIL.density(temperature) * 2000.0 * found["mean_leaving_flow_m3_per_s"]
        return SUPPLY + 0.5 * found["mean_dissipated_power_W"] / carried - temperature

    expected = brentq(excess, 90.0, 110.0, xtol=0.01)
    found = periodic_run(crank(ehd.Heat(supply_temperature=SUPPLY, tolerance=0.01)))
    off = abs(found.figures["big_end"]["effective_temperature_C"] - expected)
    figure("heat", "slider-crank: effective temperature from an outer search", off, most=0.05,
           unit="K")  # fmt: skip
    plain = periodic_run(crank(None, temperature=expected))
    films = [run.joints["big_end"].min_film_thickness.min() for run in (found, plain)]
    assert films[0] == pytest.approx(films[1], rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("supply", [SUPPLY, 40.0])
def test_temperatures_cost_at_most_three_cycles(supply, figure):
    plain = periodic_run(crank(None, temperature=supply)).cycles
    heated = periodic_run(crank(ehd.Heat(supply_temperature=supply), temperature=supply)).cycles
    figure("heat", f"slider-crank, supply at {supply:g} C: cycles more than without heat",
           heated - plain, most=3)  # fmt: skip


@pytest.mark.slow
def test_what_the_bodies_put_into_the_film_leaves_as_heat(figure):
    """Over a cycle, with friction on the bodies, at tolerance 1e-6."""
    heat = ehd.Heat(supply_temperature=SUPPLY, conducted_share=0.25, tolerance=0.01)
    found = periodic_run(crank(heat, (16, 3), friction=True), tolerance=1e-6, periodicity=1e-4)
    figures, columns = found.figures["big_end"], found.columns
    density = OIL.density(figures["effective_temperature_C"])
    rise = figures["outlet_temperature_C"] - SUPPLY
    carried = density * 2000.0 * figures["mean_leaving_flow_m3_per_s"] * rise
    off = abs(carried / (0.75 * figures["mean_film_power_W"]) - 1)
    figure("heat", "slider-crank: heat that leaves over a cycle from the work of both bodies on "
           "the film, tolerance 1e-6", off, most=1e-3)  # fmt: skip
    # As the mechanism's balance has it, of kinetic energies a hundred times as large.
    work, kinetic, dissipated = (
        columns[name][-1] - columns[name][0]
        for name in ("drive_work_J", "kinetic_energy_J", "film_work_J")
    )
    figure("heat", "slider-crank: what the drive puts in over a cycle less that dissipated, "
           "tolerance 1e-6", abs(work - kinetic - dissipated) / dissipated, most=5e-3)  # fmt: skip


@pytest.mark.slow
def test_the_temperature_converges_with_the_steps(figure):
    found = [
        periodic_run(
            crank(ehd.Heat(supply_temperature=SUPPLY, tolerance=5e-3), (16, 3)), tolerance=tolerance
        ).figures["big_end"]["effective_temperature_C"]
        for tolerance in (1e-3, 1e-4, 1e-5)
    ]
    for tolerance, off in zip((1e-3, 1e-4), np.abs(np.array(found[:-1]) - found[-1]), strict=True):
        figure("heat", f"slider-crank: effective temperature at tolerance {tolerance:g} from that "
               "at 1e-5", off, most=0.1 if tolerance > 1e-4 else 0.02, unit="K")  # fmt: skip


def test_an_equilibrium_has_the_temperature_of_the_steady_bearing():
    heat = ehd.Heat(supply_temperature=SUPPLY, conducted_share=0.1, tolerance=1e-3)
    rest = ehd.equilibrium(journal(oil_film((32, 6)), heat=heat))
    bearing = ehd.solve_bearing(
        ehd.BearingSettings(
            viscosity_40=46.0, viscosity_100=6.645, supply_temperature=SUPPLY, conducted=0.1
        ),
        load=3000.0,
    )
    off = abs(rest.temperatures["bearing"] - bearing.heat.effective_temperature)
    assert off < 0.05
    assert rest.temperatures["bearing"] > SUPPLY + 1.0
    heavier = journal(oil_film((32, 6)), load=3500.0, heat=heat)
    anew, continued = ehd.equilibrium(heavier), ehd.equilibrium(heavier, start=rest)
    difference = continued.temperatures["bearing"] - anew.temperatures["bearing"]
    assert abs(difference) < 2 * heat.tolerance


def test_an_equilibrium_whose_heat_cannot_leave_is_refused():
    film = oil_film(radius=22.5e-3, width=0.1)
    with pytest.raises(ehd.errors.HeatError, match=r"bearing\.heat: the oil cannot carry away"):
        ehd.equilibrium(journal(film, load=30.0, heat=ehd.Heat(supply_temperature=SUPPLY)))
