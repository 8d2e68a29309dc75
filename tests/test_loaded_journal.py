"""A journal under a load history, against equilibria, exact properties and the short bearing."""

import attrs
import numpy as np
import pytest
from journal_cases import (
    ETA,
    OMEGA,
    UNIT_LOAD,
    C,
    R,
    eccentricity,
    equilibrium,
    orbit,
    periodic,
    scene,
)
from scipy.integrate import quad, solve_ivp
from test_demos import demo

from fenics_ehd.errors import PeriodicityError
from fenics_ehd.film import ShaftMotion, shaft_gap
from fenics_ehd.multibody.bdf import StepControl, integrate
from fenics_ehd.multibody.massless_journal import MasslessJournal
from fenics_ehd.scenes.load_history import LoadHistory
from fenics_ehd.scenes.loaded_journal import build_film, build_journal
from fenics_ehd.scenes.loaded_journal_run import OrbitTotals, simulate, verdict
from fenics_ehd.scenes.loaded_journal_settings import Start


@pytest.fixture(scope="module")
def constant_load():
    # It comes to rest: long steps, many cycles.
    settings = scene(cells=(32, 6), tolerance=1e-3, largest_step=0.2, periodicity=1e-5)
    load = periodic(lambda _: 0.436957 * UNIT_LOAD * np.array([0.0, -1.0]), 0.02, rows=3)
    return settings, load, orbit(settings, load)


def test_constant_load_ends_at_the_static_equilibrium(constant_load):
    settings, load, (columns, totals, cycle) = constant_load
    expected = equilibrium(settings, load(0.0), OMEGA)
    assert cycle.end == pytest.approx(expected, abs=1e-6 * C)
    last = eccentricity(columns)[columns["cycle"] == totals.cycle]
    assert np.abs(last - expected).max() < 1e-3 * C
    assert totals.periodicity_defect < 1e-4
    assert totals.largest_multiplier < 1


def test_constant_load_matches_the_table_of_rigid_bearings(constant_load, figure):
    _, _, (_, totals, cycle) = constant_load
    # Eccentricity 0.6 bears 0.436957 at 51.98 degrees from the load line, in the sense of rotation.
    error = abs(totals.max_eccentricity_ratio / 0.6 - 1)
    figure(
        "machines",
        "journal under a constant load, eccentricity of the table",
        error,
        most=1e-3,
        unit="%",
    )
    direction = np.degrees(np.arctan2(cycle.end[1], cycle.end[0]))
    assert direction + 90 == pytest.approx(51.98, abs=0.1)


@pytest.mark.parametrize("share", [0.25, 0.75])
def test_rotating_load_sees_the_speed_minus_twice_its_own(share):
    # A thin film: in a turning frame the thin-film equation keeps its form to order c / R only.
    clearance = 0.1 * C
    settings = scene(clearance=clearance)
    size, speed = 100 * 0.15 * UNIT_LOAD, share * OMEGA
    load = periodic(
        lambda s: size * np.array([np.cos(2 * np.pi * s), np.sin(2 * np.pi * s)]),
        2 * np.pi / speed,
    )
    # In the frame of the load the shaft rests; the sense of rotation turns at half speed.
    expected = equilibrium(settings, np.array([size, 0.0]), OMEGA - 2 * speed)
    settings = attrs.evolve(settings, start=Start(*(expected / clearance)))
    columns, totals, _ = orbit(settings, load)
    last = columns["cycle"] == totals.cycle
    angle = speed * columns["cycle_time_s"][last]
    x, y = eccentricity(columns)[last].T
    cosine, sine = np.cos(angle), np.sin(angle)
    turned = np.column_stack([cosine * x + sine * y, cosine * y - sine * x])
    assert np.sign(expected[1]) == (1 if share < 0.5 else -1)
    assert np.abs(turned - expected).max() < 2e-3 * clearance


def test_no_load_can_turn_at_half_speed():
    load = periodic(
        lambda s: 0.15 * UNIT_LOAD * np.array([np.cos(2 * np.pi * s), np.sin(2 * np.pi * s)]),
        4 * np.pi / OMEGA,
    )
    totals = OrbitTotals()
    with pytest.raises(PeriodicityError, match=r"time.cycles = 2 .* above time.periodicity = 0.0"):
        simulate(scene(cells=(12, 2), cycles=2, tolerance=1e-3), totals, load=load)
    assert totals.max_eccentricity_ratio > 0.8


def short_bearing_force(ratio, rate, width, speed):
    """Force of a short bearing's film on the shaft and its slope along the velocity.

    ``p = 6 eta s (z^2 - B^2 / 4) / h^3`` where the source ``s = omega / 2 dh/dphi + dh/dt`` is
    negative, integrated by the midpoint rule.
    """
    angle = 2 * np.pi * (np.arange(720) + 0.5) / 720
    normal = np.stack([np.cos(angle), np.sin(angle)])
    tangent = np.stack([-np.sin(angle), np.cos(angle)])
    source = -0.5 * speed * C * (ratio @ tangent) - rate @ normal
    weight = ETA * width**3 / (C * (1 - ratio @ normal)) ** 3 * R * 2 * np.pi / 720
    weight = weight * (source < 0)
    return (weight * source) @ normal.T, -(weight * normal) @ normal.T


def short_bearing_rate(load, ratio, width, speed):
    """Velocity that bears a load, by Newton's method."""
    rate = np.zeros(2) + 1e-12
    for _ in range(50):
        force, slope = short_bearing_force(ratio, rate, width, speed)
        update = -np.linalg.solve(slope, force + load)
        rate = rate + update
        if np.hypot(*update) < 1e-12 * np.hypot(*rate):
            break
    return rate


def test_squeeze_under_sinusoidal_load_follows_the_short_bearing(figure):
    width, period = 0.05 * 2 * R, 0.01
    size = 3.2 * np.pi * ETA * R * width**3 / C**2 / period
    settings = scene(width=width, speed=0.0, cells=(40, 2), tolerance=3e-4)
    load = periodic(lambda s: np.array([size * np.sin(2 * np.pi * s), 0.0]), period, rows=181)
    columns, totals, cycle = orbit(settings, load)

    def resistance(ratio):
        return quad(lambda a: np.cos(a) ** 2 / (1 - ratio * np.cos(a)) ** 3, -np.pi / 2, np.pi / 2)[
            0
        ]

    def rate(t, ratio):
        force = size * np.sin(2 * np.pi * t / period)
        forward = np.sign(force)
        return force * C**2 / (ETA * R * width**3 * resistance(forward * ratio[0]))

    first = columns["cycle"] == 1
    times = columns["cycle_time_s"][first]
    oracle = solve_ivp(rate, (0, period), [0.0], t_eval=times, rtol=1e-8, atol=1e-10).y[0]
    assert oracle.max() > 0.6
    error = np.abs(eccentricity(columns)[first, 0] / C - oracle).max()
    name = "journal in a short bearing under a sine, of the clearance, one ODE"
    figure("machines", name, error, most=2.5e-3, unit="%")
    # Periodic: it swings as far to either side.
    last = eccentricity(columns)[columns["cycle"] == totals.cycle, 0]
    assert last.max() == pytest.approx(-last.min(), rel=1e-3)
    assert np.abs(cycle.end[1]) < 1e-9 * C


def test_turning_shaft_under_elliptic_load_follows_the_short_bearing():
    width, period = 0.05 * 2 * R, 4 * np.pi / OMEGA
    size = 0.6 * ETA * OMEGA * R * width**3 / C**2
    settings = scene(width=width, cells=(40, 2))
    load = periodic(
        lambda s: size * np.array([np.cos(2 * np.pi * s), 0.4 * np.sin(4 * np.pi * s) - 0.5]),
        period,
        rows=181,
    )
    journal, control = build_journal(settings, load), StepControl(1e-4, 1e-6, 1e-13, 0.02 * period)
    rate = journal.starting_rate(0.0, np.zeros(2), load.largest)
    steps = list(integrate(journal, (0.0, period), np.zeros(2), rate, control))
    oracle = solve_ivp(
        lambda t, ratio: short_bearing_rate(load(t), ratio, width, OMEGA) / C,
        (0, period),
        [0.0, 0.0],
        t_eval=[step.time for step in steps],
        rtol=1e-6,
        atol=1e-8,
    ).y.T
    assert np.hypot(*oracle.T).max() > 0.5
    assert np.abs(np.array([step.x for step in steps]) / C - oracle).max() < 2.5e-3


@pytest.fixture(scope="module")
def small():
    """Turning shaft under an elliptic load, on a small mesh: the integrator does not mind."""
    settings = scene(cells=(12, 2))
    load = periodic(
        lambda s: 0.3 * UNIT_LOAD * np.array([np.cos(2 * np.pi * s), 0.5 * np.sin(4 * np.pi * s)]),
        4 * np.pi / OMEGA,
        rows=37,
    )
    return settings, load, build_journal(settings, load)


def pass_through(journal, load, start, tolerance, *, share=1.0, order=2):
    """One cycle or a share of it."""
    control = StepControl(tolerance, 1e-6, 1e-13, 0.1 * load.period, order)
    search = journal.search(control)
    search.begin(start)
    rate = journal.starting_rate(0.0, start, load.largest)
    for step in integrate(journal, (0.0, share * load.period), start, rate, control):
        search.add(step)
    return search.finish()


def test_error_falls_with_the_tolerance_to_the_two_thirds(small):
    _, load, journal = small
    start = np.array([0.3, 0.1]) * C
    exact = pass_through(journal, load, start, 3e-7, share=0.15, order=3).end
    tolerances = np.array([1e-3, 2e-4, 4e-5, 8e-6])
    ends = [pass_through(journal, load, start, t, share=0.15).end for t in tolerances]
    errors = [np.hypot(*(end - exact)) / C for end in ends]
    # Local error ~ step^3 at the tolerance, error at the end ~ step^2.
    slope = np.polyfit(np.log(tolerances), np.log(errors), 1)[0]
    assert 0.58 < slope < 0.75
    assert errors[-1] < 4e-4


def test_monodromy_is_the_derivative_of_the_end(small):
    _, load, journal = small
    start, h = np.array([0.3, 0.1]) * C, 1e-3 * C

    def end(x):
        return pass_through(journal, load, x, 1e-5, share=0.05)

    differences = [end(start + h * d).end - end(start - h * d).end for d in np.eye(2)]
    differences = np.column_stack(differences) / (2 * h)
    assert np.abs(differences).max() > 0.1
    assert end(start).monodromy == pytest.approx(differences, abs=2e-3)


def test_force_derivatives_are_those_of_the_force(small):
    _, _, journal = small
    x, rate = np.array([0.5, -0.3]) * C, np.array([1e-3, 2e-3])
    state = journal.state(0.0, x, rate, None)
    scale = np.abs(state.force).max()
    for h, slope, moved in (
        (1e-6 * C, state.stiffness, lambda d: (x + d, rate)),
        (1e-9, state.damping, lambda d: (x, rate + d)),
    ):
        difference = np.column_stack(
            [
                journal.state(0.0, *moved(h * d), state.film).force
                - journal.state(0.0, *moved(-h * d), state.film).force
                for d in np.eye(2)
            ]
        ) / (2 * h)
        assert slope == pytest.approx(difference, rel=1e-5, abs=1e-6 * scale / C)


def test_turned_load_turns_the_orbit(small):
    _, load, journal = small
    turned = LoadHistory(load.times, load.forces @ np.array([[0, 1], [-1, 0]]))
    start = np.array([0.3, 0.1]) * C
    first = pass_through(journal, load, start, 1e-3, share=0.3).end
    other = MasslessJournal(journal.film, turned, ShaftMotion(np.zeros(2), OMEGA))
    second = pass_through(other, turned, np.array([-start[1], start[0]]), 1e-3, share=0.3).end
    assert second == pytest.approx([-first[1], first[0]], abs=1e-8 * C)


def test_an_unloaded_film_lets_the_shaft_go_round_at_half_speed(small):
    _, load, journal = small
    # No load for a while: without pressure the gap is carried round with the mean oil speed.
    free = MasslessJournal(journal.film, lambda t: np.zeros(2), ShaftMotion(np.zeros(2), OMEGA))
    start = np.array([0.5, 0.0]) * C
    rate = free.starting_rate(0.0, start, load.largest)
    assert rate == pytest.approx([0.0, 0.5 * OMEGA * start[0]], rel=1e-3, abs=1e-3 * OMEGA * C)
    control = StepControl(1e-5, 1e-6, 1e-13, 1e-3)
    *_, last = integrate(free, (0.0, np.pi / OMEGA), start, rate, control)
    assert last.x == pytest.approx([0.0, 0.5 * C], abs=3e-3 * C)


def test_grooves_feed_the_film():
    settings = scene(cells=(20, 5), grooves=((95.0, 20.0, 2e5), (250.0, 15.0, 1e5)))
    film = build_film(settings, 0.01)
    gap = shaft_gap(film.points, R, C, ShaftMotion(np.zeros(2), 0.0))
    angle, height = film.parameters.grid.node_positions.T
    middle = np.abs(height) < 0.4 * R
    pressure = film.solve(gap).pressure
    for centre, width, fed in settings.bearing.grooves:
        inside = middle & (np.abs(np.degrees(angle) - centre) <= 0.5 * width + 1e-9)
        assert inside.any()
        assert pressure[inside] == pytest.approx(fed)


def test_mesh_too_coarse_for_the_thinnest_film_is_called_untrustworthy():
    totals = OrbitTotals(max_eccentricity_ratio=0.94)
    assert verdict(scene(cells=(20, 5)), totals) == "complete"
    totals.max_eccentricity_ratio = 0.96
    assert verdict(scene(cells=(20, 5)), totals).startswith("untrustworthy: film.cells = 20")
    assert verdict(scene(cells=(40, 5)), totals) == "complete"
    totals.largest_multiplier = 1.1
    assert "repels" in verdict(scene(cells=(40, 5)), totals)


def test_demo_finds_the_thinnest_film_of_an_engine_bearing():
    totals = demo("loaded_journal").main(tolerance=2e-3)
    assert totals.min_film_thickness == pytest.approx(4.26e-6, rel=0.04)
    assert totals.largest_multiplier < 1e-2
