"""Mass-conserving cavitation against solutions with free boundaries, exact sums and differences."""

from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from lone_oil import STEADY_STEP, LoneOil
from oil_cases import whirling
from oracle_mass_conserving import JournalFilm, SqueezedPlates
from scipy.integrate import solve_ivp

import fenics_ehd as ehd
from fenics_ehd.film.assembly import Assembly
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.film.oil_balance import Strips, Transport

pytestmark = pytest.mark.kernels

R, C, OMEGA, ETA = 0.0225, 17e-6, 500.0, 0.01
CLOSED = ehd.Sides(None, None)


def film(cells, sides=CLOSED, regions=(), width=2 * R, lubricant=None, family="bilinear"):
    grid = ehd.uniform_grid(R, width, cells, family)
    return ehd.Film(
        ehd.FilmParameters(grid, C, lubricant or ehd.Lubricant(ETA), OMEGA, sides, regions)
    )


def turning(film, thickness, speed=OMEGA):
    """Gap of a given thickness between a turning shaft and a bore at rest."""
    thickness = thickness + np.zeros_like(film.points.angle)
    zero = np.zeros_like(thickness)
    return Gap(thickness, zero, zero + speed * R / 2, zero + speed * R)


def eccentric(film, x, y=0.0):
    return ehd.shaft_gap(film.points, R, C, ehd.ShaftMotion(np.array([x, y]) * C, OMEGA))


@pytest.mark.parametrize("supply", [1e5, 3e6])
def test_wide_journal_ruptures_and_reforms_where_the_free_boundary_solution_does(supply, figure):
    errors, leaks = [], []
    for cells in (120, 240, 480):
        bearing = film((cells, 1), CLOSED, (ehd.AxialGroove(0.0, 0.0, supply),), width=R)
        state = LoneOil(bearing).steady(
            turning(bearing, C * (1 + 0.5 * np.cos(bearing.points.angle)))
        )
        scale = bearing.parameters.pressure_scale
        exact = JournalFilm(0.5, 0.5, supply / scale)
        phi = bearing.parameters.grid.node_positions[::2, 0]
        fraction, cell = state.fluid_fraction[::2], 2 * np.pi / cells
        empty = np.flatnonzero(fraction < 1)
        assert abs(phi[empty[0]] - exact.rupture) < cell
        assert abs(phi[empty[-1]] - exact.reformation) < cell
        leak = (fraction * exact.gap(phi))[empty[1:-1]] / exact.gap(exact.rupture)
        leaks.append(np.abs(leak - 1).mean())
        assert np.abs(leak - 1).max() < 0.1 * cell
        assert state.pressure.max() / scale == pytest.approx(exact.largest_pressure, rel=cell**2)
        errors.append(np.sum((1 - fraction) * exact.gap(phi)) * cell / exact.void - 1)
    rates = np.log2(np.abs(errors[:-1]) / np.abs(errors[1:]))
    figure(
        "film", "mass-conserving, wide journal, observed order of the void", rates.min(), least=0.95
    )
    name = "mass-conserving, wide journal, observed order of the oil that passes the void"
    figure("film", name, np.log2(leaks[0] / leaks[-1]) / 2, least=1.7)
    name = "mass-conserving, void of the wide journal, solution with free boundaries"
    figure("film", name, abs(errors[-1]), most=5e-3, unit="%")


def squeeze(cells, steps):
    """Half width of the empty middle and empty volume over a period, relative errors."""
    width, ambient = 0.02, 1e5
    gap = lambda t: C * (1 - np.cos(OMEGA / 5 * t) / 3)  # noqa: E731
    rate = lambda t: C * OMEGA / 5 * np.sin(OMEGA / 5 * t) / 3  # noqa: E731
    plates = film((3, cells), ehd.Sides(ambient, ambient), width=width)
    oil = LoneOil(plates)
    times = np.linspace(0.0, 10 * np.pi / OMEGA, steps + 1)
    weights = np.gradient(plates.parameters.grid.heights)
    content, state = oil.filled(turning(plates, gap(0.0), 0.0)), None
    edges, voids = [], []
    for start, end in pairwise(times):
        state = oil.solve(turning(plates, gap(end), 0.0), content, end - start, state)
        content = state.content
        share = 1 - state.fluid_fraction[: cells + 1]
        edges.append(np.sum(weights[share > 0]) / 2)
        voids.append(gap(end) * np.sum(weights * share))
    chosen = np.arange(steps // 50 - 1, steps, steps // 50)
    exact = SqueezedPlates(width / 2, ETA, ambient, gap, rate)
    edge, void = exact.edges(1e-4, times[1:][chosen])
    assert 0.3 < edge.max() / (width / 2) < 0.9
    return (
        np.sqrt(np.mean((np.array(edges)[chosen] - edge) ** 2)) / (width / 2),
        np.abs(np.array(voids)[chosen] - void).max() / void.max(),
    )


@pytest.mark.slow
def test_squeezed_plates_follow_the_free_boundary_in_time(figure):
    errors = np.array([squeeze(20, 100), squeeze(40, 200), squeeze(80, 400)])
    rates = np.log2(errors[:-1] / errors[1:])
    assert np.all(rates[:, 0] > 0.7)
    assert np.all(rates[:, 1] > 0.9)
    name = "mass-conserving, squeezed plates in time"
    figure("film", f"{name}, edge of the void", errors[-1, 0], most=0.015, unit="%")
    figure("film", f"{name}, its volume", errors[-1, 1], most=0.005, unit="%")


def test_active_set_is_the_only_one_that_satisfies_all_signs():
    bearing = film((6, 1), CLOSED, (ehd.AxialGroove(np.pi, 0.0, 1e5),), width=R)
    oil = LoneOil(bearing)
    gap = eccentric(bearing, 0.6, 0.2)
    state, length = oil.solve(gap, oil.filled(gap), 2.0 / OMEGA), 2.0
    step = oil.balance.ending(gap, length, oil.filled(gap) / (oil.balance.volume_scale * length))
    problem, n = oil.balance.problem(step), len(oil.balance.unknown)
    rows, pattern, found = oil.balance.rows(step, problem), oil.balance.pattern, []
    for full in np.array(list(product([False, True], repeat=n))):
        pressure, void, left = np.zeros(n), np.zeros(n), np.inf
        for _ in range(30):
            transport = oil.balance.transport(step, void)
            defect = problem.residual(pressure) - transport.values
            left = np.abs(defect / rows).max()
            if left < 1e-13:
                break
            entries = problem.entries(pressure), transport.entries
            along_p, along_s = (pattern.matrix(own).toarray() for own in entries)
            both = pressure + void - np.linalg.solve(np.where(full, along_p, -along_s), defect)
            pressure, void = np.where(full, both, 0.0), np.where(full, 0.0, both)
        signs = min(pressure.min() / problem.unit, void.min())
        if left < 1e-13 and signs > -1e-12:
            found.append((full, pressure, void))
    assert len(found) == 1
    full, pressure, void = found[0]
    assert 0 < full.sum() < n
    np.testing.assert_allclose(pressure, state.cavitation.pressure, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(void, state.cavitation.flux, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("sides", [CLOSED, ehd.Sides(0.0, 0.0), ehd.Sides(2e5, 0.0)])
def test_oil_changes_by_side_flow_alone_over_a_hundred_steps(sides, figure):
    bearing = film((24, 6), sides)
    oil = LoneOil(bearing)
    step, state = 0.05 / OMEGA, None
    content = oil.filled(turning(bearing, C), 0.8)
    start, left, largest = content.sum(), 0.0, 0.0
    ends = bearing.parameters.grid.node_positions[:, 1]
    for i in range(100):
        angle = 0.03 * i
        gap = eccentric(bearing, 0.8 * np.sin(angle) * np.cos(angle), 0.8 * np.sin(angle) ** 2)
        state = oil.solve(gap, content, step, state)
        content = state.content
        left += step * state.outflow.sum()
        dry = np.abs(ends - ends.max()) < 1e-9
        assert sides.upper is None or np.all(state.outflow[dry] >= 0)
        assert state.pressure.min() >= 0
        largest = max(largest, state.pressure.max())
        assert -1e-12 < state.fluid_fraction.min() < state.fluid_fraction.max() <= 1
        assert np.abs(state.pressure * (1 - state.fluid_fraction)).max() == 0
    defect = abs(content.sum() + left - start) / start
    figure("film", "mass-conserving, oil lost in 100 steps", defect, most=1e-13)
    assert largest > 1e5
    assert state.fluid_fraction.min() < 0.6


def carried_round(angles):
    """Mean error of a smooth void after a turn of the surfaces, steps in time without error."""
    grid = ehd.FilmGrid(R, angles, np.array([-R, R]), "bilinear")
    strips = Strips(assembly := Assembly(grid), np.arange(len(angles) * 2 - 2))
    one, phi = np.ones_like(assembly.area), grid.node_positions[:, 0]
    flows, room = strips.flows(one), assembly.source(one)
    still = np.zeros_like(room)
    start = 0.5 + 0.3 * np.sin(phi)

    def rate(_, void):
        return -Transport(strips, flows, still, void).nodal / room

    turned = solve_ivp(rate, (0.0, 2 * np.pi), start, rtol=1e-6, atol=1e-8).y[:, -1]
    assert turned @ room == pytest.approx(start @ room, rel=1e-12)
    return np.abs(turned - start) @ room / room.sum()


@pytest.mark.parametrize("stretch", [0.0, 0.5])
def test_transport_of_a_smooth_void_is_of_second_order(stretch, figure):
    errors = []
    for cells in (32, 64, 128):
        angles = np.linspace(0, 2 * np.pi, cells + 1)
        errors.append(carried_round(angles + stretch * np.sin(angles)))
    mesh = f", cells stretched by {1 + stretch:g}" if stretch else ""
    name = f"mass-conserving, smooth void carried round{mesh}"
    figure("film", f"{name}, observed order", np.log2(errors[0] / errors[-1]) / 2, least=1.7)
    figure("film", f"{name}, 128 cells", errors[-1], most=2e-3, unit="%")


@settings(max_examples=30)
@given(
    fraction=hnp.arrays(float, 12, elements=st.floats(0.0, 0.98)),
    courant=st.floats(0.05, 20.0),
    direction=st.sampled_from([-1, 1]),
)
def test_transport_adds_no_extreme_and_no_variation(fraction, courant, direction):
    bearing = film((12, 1))
    oil, gap = LoneOil(bearing), turning(bearing, C, direction * OMEGA)
    start = np.repeat(fraction, 2)
    content = oil.filled(gap, start)
    state = oil.solve(gap, content, courant * 4 * np.pi / 12 / OMEGA)
    found = state.fluid_fraction[::2]
    assert fraction.min() - 1e-9 <= found.min() <= found.max() <= fraction.max() + 1e-9
    before, after = (np.abs(own - np.roll(own, 1)).sum() for own in (fraction, found))
    assert after <= before + 1e-8
    assert state.content.sum() == pytest.approx(content.sum(), rel=1e-12)
    assert state.pressure.max() == 0.0


def test_starved_bearing_balances_its_groove_and_carries_less_than_reynolds():
    grooves = (ehd.AxialGroove(np.pi, 0.0, 2e5, length=R),)
    bearing = film((48, 16), ehd.Sides(), grooves)
    (state,) = ehd.equilibrium(whirling(bearing, 0.7, 0.0)).state.films
    reynolds = bearing.solve(state.gap)
    inflow = -state.outflow[state.outflow < 0].sum()
    assert state.outflow.sum() == pytest.approx(0, abs=1e-9 * inflow)
    ends = np.isin(np.abs(bearing.parameters.grid.node_positions[:, 1]), R)
    assert state.outflow[ends].sum() == pytest.approx(inflow, rel=1e-9)
    assert state.outflow[ends].min() >= 0
    directions = np.stack(bearing.points.normal, axis=-1)
    force, full = (np.linalg.norm(bearing.load(directions) @ s.pressure) for s in (state, reynolds))
    assert 0.9 * full < force < full
    lone = LoneOil(bearing)
    found = lone.solve(state.gap, state.content, STEADY_STEP / OMEGA, state)
    np.testing.assert_allclose(found.pressure, state.pressure, atol=1e-6 * state.pressure.max())
    np.testing.assert_allclose(found.fluid_fraction, state.fluid_fraction, atol=1e-6)
