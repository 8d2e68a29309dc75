"""Supplies that conduct oil into the film: flows, convergence, derivatives, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from attrs import evolve
from film_cases import ETA, FAMILIES, OMEGA, C, R, force, gap_of, make_film, shaft, solve
from lone_oil import LoneOil

import fenics_ehd as ehd
from fenics_ehd.film.forces import FilmFlows
from fenics_ehd.film.parameters import EDGES, Feeds

#: What is tried: supply pressure [Pa], a hole, a groove.
SUPPLY = 3e5
HOLE = ehd.HoleSupply(name="a", angle=np.degrees(1.0), height=0.1 * R, diameter=0.5 * R)
GROOVE = ehd.CircumferentialGrooveSupply(name="b", angle=90, extent=36, width=1.2 * R)
OTHER_GROOVE = evolve(GROOVE, angle=np.degrees(4.0), pressure=1e6)
OTHER_HOLE = ehd.HoleSupply(name="b", angle=np.degrees(4.0), diameter=0.4 * R)


def two_lands(width, ratio, pressure):
    """Flow of a groove all around between two lands, to both sides, of a still journal.

    ``dQ = R dphi h^3 / (12 eta) p_s / L`` through each land of length L, integrated over
    ``h = c (1 + eps cos phi)``: ``int (1 + eps cos phi)^3 dphi = 2 pi (1 + 1.5 eps^2)``. Exact, as
    p falls linearly along z at every angle where ``dp/dphi = 0``.
    """
    land = 0.5 * (2 * R - width)
    mean = 2 * np.pi * (1 + 1.5 * ratio**2)
    return 2 * mean * R * C**3 / (12 * ETA) * pressure / land


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("ratio", [0.0, 0.6])
def test_groove_all_around_feeds_its_two_lands(family, ratio, figure):
    width = 0.4 * R
    feed = ehd.CircumferentialGrooveSupply(name="groove", width=width, pressure=SUPPLY)
    errors = []
    for n in (10, 20, 40):  # the edges lie alike in the cells, and nothing changes around
        film = make_film((12, n), family, feeds=(feed,))
        flows = FilmFlows(film, solve(film, ratio, speed=0.0)).balance
        errors.append(abs(flows.supply / two_lands(width, ratio, SUPPLY) - 1))
        assert flows.feeds == {"groove": flows.supply}
    assert errors[0] > 1.6 * errors[1] > 1.6 * 1.6 * errors[2]
    figure("supply", f"flow of a groove all around, {family}, eps {ratio}", errors[2], most=2e-3)


@pytest.mark.parametrize("family", FAMILIES)
def test_flow_through_a_resistance_is_its_pressure_drop_over_it(family):
    resistance = 2e11
    feed = evolve(HOLE, name="hole", pressure=SUPPLY, resistance=resistance, on="journal")
    film = make_film((24, 8), family, feeds=(feed,))
    state = film.solve(replace(gap_of(film, shaft(0.5, 0.2)), turn=0.7))
    pressure = film.assembly.at_points(state.pressure)[0]
    weight = film.assembly.area * film.equation.feeds.shares(0.7)[0][0]
    mean = np.sum(weight * pressure) / weight.sum()
    flow = FilmFlows(film, state).balance.feeds["hole"]
    assert flow * resistance == pytest.approx(SUPPLY - mean, rel=1e-12)


@pytest.mark.parametrize(
    "oil", [ehd.Lubricant(ETA), ehd.Lubricant(ETA, ehd.DowsonHigginson(), ehd.Barus(2e-8))]
)
@pytest.mark.parametrize("family", FAMILIES)
def test_oil_and_power_balance_to_round_off(family, oil):
    feeds = evolve(HOLE, pressure=SUPPLY, resistance=1e11), OTHER_GROOVE
    film = make_film(
        (24, 8), family, oil=oil, feeds=feeds, sides=ehd.Sides(1e5, 0.0), tolerance=1e-13
    )
    state = solve(film, 0.6, 0.1, rate=(30.0, 10.0))
    flows = FilmFlows(film, state).balance
    total = flows.supply + flows.cavities - flows.lower - flows.upper
    assert total == pytest.approx(flows.squeeze, rel=1e-11)
    assert sum(flows.feeds.values()) == pytest.approx(flows.supply, rel=1e-14)


def test_normal_motion_drag_and_supply_give_what_the_flow_loses():
    film = make_film((24, 8), feeds=(evolve(GROOVE, pressure=1e6),), tolerance=1e-13)
    state = solve(film, 0.6, 0.1, rate=(30.0, 10.0))
    pressure = film.assembly.at_points(state.pressure)[0]
    normal = -np.sum(R**2 * film.assembly.area * pressure * state.gap.thickness_rate)
    lost, drag = film.powers(state)
    brought = FilmFlows(film, state).feed_power
    assert normal + drag + brought == pytest.approx(lost, rel=1e-10)
    assert brought > 0.01 * lost


def turned(film, angles):
    """Forces and supply of a journal and its eccentricity turned together, as seen by it."""
    rows, state = [], None
    for angle in angles:
        c, s = np.cos(angle), np.sin(angle)
        state = film.solve(replace(gap_of(film, shaft(-0.6 * c, -0.6 * s)), turn=angle), state)
        x, y = force(film, state.pressure)
        supply = FilmFlows(film, state).balance.feeds["inlet"]
        rows.append([c * x + s * y, c * y - s * x, supply])
    return np.array(rows)


@pytest.mark.slow
@pytest.mark.parametrize("region", [GROOVE, HOLE])
def test_load_and_flow_converge_and_do_not_feel_the_mesh_below(region, figure):
    feed = evolve(region, name="inlet", pressure=SUPPLY, on="journal")
    ripples, means = [], []
    for n in (10, 20, 40):
        film = make_film((4 * n, n), feeds=(feed,))
        values = turned(film, np.pi / (2 * n) * np.array([0.0, 0.25, 0.5, 0.75]))
        ripples.append(np.abs(np.ptp(values, axis=0) / values.mean(axis=0)).max())
        means.append(values.mean(axis=0))
    assert ripples[0] < 4e-3
    assert ripples[0] > 1.5 * ripples[1] > 1.5 * 1.5 * ripples[2]
    assert ripples[0] > 10 * ripples[2]
    changes = np.abs(np.diff(means, axis=0))
    order = np.log2(changes[0] / changes[1])
    name = type(region).__name__
    figure("supply", f"order in the mesh, {name}", order.min(), least=1.6)
    figure("supply", f"load's change with the mesh below, {name}, 160 x 40", ripples[2], most=3e-4)


@pytest.mark.slow
def test_edges_are_where_they_should_be_for_one_constant_alone(monkeypatch):
    # Less conductance lets the film's pressure into the groove, more blows the groove up.
    feed, loads, edge = evolve(GROOVE, pressure=SUPPLY), {}, EDGES["lagrange"]
    for factor in (0.25, 1.0, 4.0, 30.0):
        monkeypatch.setitem(EDGES, "lagrange", factor * edge)
        loads[factor] = [
            force(film, solve(film, -0.6).pressure)[1]
            for film in (make_film((4 * n, n), feeds=(feed,)) for n in (10, 20))
        ]
    monkeypatch.undo()
    fine = make_film((160, 40), feeds=(feed,))
    loads[1.0].append(force(fine, solve(fine, -0.6).pressure)[1])
    limit = loads[1.0][2] + (loads[1.0][2] - loads[1.0][1]) / 3
    errors = {factor: np.abs(np.array(found[:2]) / limit - 1) for factor, found in loads.items()}
    for factor in (0.25, 4.0, 30.0):
        assert np.all(errors[factor] > 2 * errors[1.0])
        assert 1.5 < errors[factor][0] / errors[factor][1] < 2.6  # converges at first order


def test_a_film_between_closed_sides_is_fed():
    film = make_film((24, 6), sides=ehd.Sides(None, None), feeds=(evolve(HOLE, pressure=SUPPLY),))
    np.testing.assert_allclose(solve(film, 0.3, speed=0.0).pressure, SUPPLY, rtol=1e-8)


def test_a_supply_follows_its_table_in_time():
    feed = evolve(HOLE, curve=lambda time: (1e5 + 1e8 * time, 1e8), resistance=1e12)
    film = make_film((24, 8), feeds=(feed,))
    gap = gap_of(film, shaft(speed=0.0))
    states = [film.solve(replace(gap, time=t)) for t in (0.0, 2e-3)]
    one, two = (FilmFlows(film, state).balance.supply for state in states)
    assert two == pytest.approx(3 * one, rel=1e-9)


def test_no_pressure_gives_no_oil():
    film = make_film((24, 8), feeds=(HOLE, OTHER_HOLE))
    assert not solve(film, speed=0.0).pressure.any()


@pytest.mark.parametrize(
    ("feed", "message"),
    [
        (lambda: ehd.HoleSupply(diameter=2 * R), "land remains at both sides"),
        (lambda: ehd.HoleSupply(height=0.9 * R, diameter=0.5 * R), "land remains at both sides"),
        (lambda: ehd.HoleSupply(diameter=0.1 * R), r"use cells = \[63, 20\] or more"),
        (lambda: ehd.HoleSupply(diameter=1.8 * R), r"a land of 2.25 mm, below"),
        (lambda: evolve(GROOVE, extent=3, width=R), "below the cell size of"),
        (lambda: evolve(GROOVE, extent=358, width=R), "below the cell size of"),
        (lambda: evolve(HOLE, pressure=-1), "pressure = -1.0 must be at least 0"),
        (lambda: evolve(HOLE, resistance=-1), "resistance = -1.0 must be at least 0"),
    ],
)
def test_what_no_bearing_or_mesh_can_hold_is_refused(feed, message):
    with pytest.raises(ehd.errors.SettingsError, match=message):
        make_film((40, 10), feeds=(feed(),))


def test_two_supplies_have_two_names():
    with pytest.raises(ehd.errors.SettingsError, match="supplies have the names 'a', 'a'"):
        make_film((40, 10), feeds=(HOLE, evolve(GROOVE, name="a")))


def test_without_supplies_none_of_this_is_called(monkeypatch):
    monkeypatch.setattr(Feeds, "__init__", None)
    film = make_film((12, 3))
    assert film.equation.feeds is None
    assert solve(film, 0.5).pressure.any()


def test_reference_speed_changes_nothing():
    one, two = (
        solve(
            make_film((24, 8), rate=rate, feeds=(evolve(HOLE, pressure=SUPPLY, resistance=1e11),)),
            0.5,
        ).pressure
        for rate in (OMEGA, 3 * OMEGA)
    )
    np.testing.assert_allclose(two, one, atol=1e-8 * one.max())


# --- Films that conserve their oil


def test_a_dry_film_is_filled_by_what_flows_in():
    resistance, step = 1e12, 2e-3
    film = make_film(
        (24, 8), "bilinear", feeds=(evolve(HOLE, pressure=SUPPLY, resistance=resistance),)
    )
    oil, gap = LoneOil(film), gap_of(film, shaft(speed=0.0))
    content, flows = oil.filled(gap, 0.0), []
    for _ in range(40):
        state = oil.solve(gap, content, step)
        balance = FilmFlows(film, state).balance
        grown = (state.content - content).sum()
        assert grown == pytest.approx(step * balance.squeeze, rel=1e-9, abs=1e-20)
        assert balance.supply == pytest.approx(balance.feeds["a"], rel=1e-14)
        content, flows = state.content, [*flows, balance.supply]
    # Into an empty film all of the supply pressure drives the oil; the full one lets out what
    # comes in.
    assert flows[0] == pytest.approx(SUPPLY / resistance, rel=1e-12)
    assert state.fluid_fraction.max() == 1.0
    assert state.fluid_fraction.min() == 0.0  # the far side stays dry
    assert np.all(np.diff(flows) <= 1e-9 * flows[0])


def test_a_film_that_conserves_its_oil_agrees_with_a_full_one():
    # At rest nothing ruptures: lumping alone tells the two apart, and it fades with the mesh.
    errors = []
    for n in (8, 16, 32):
        feeds = evolve(HOLE, pressure=SUPPLY, resistance=1e11), OTHER_GROOVE
        film = make_film((4 * n, n), "bilinear", feeds=feeds)
        gap = gap_of(film, shaft(0.6, speed=0.0))
        full = FilmFlows(film, film.solve(gap)).balance.supply
        errors.append(FilmFlows(film, LoneOil(film).steady(gap)).balance.supply / full - 1)
    assert np.abs(errors).max() < 1e-2
    assert np.abs(errors[-1]) < 4e-3
