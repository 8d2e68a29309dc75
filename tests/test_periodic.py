"""The search for the cycle that repeats: an affine map, whose fixed point is known, as a run."""

from dataclasses import replace
from types import SimpleNamespace

import attrs
import numpy as np
import pytest
from journal_cases import in_bearing, steady
from mechanism_cases import REVOLUTION, rigid_rod, slider_crank
from mechanism_cases import film as mechanism_film
from scipy.interpolate import CubicSpline, PchipInterpolator

import fenics_ehd as ehd
from fenics_ehd.multibody import periodic
from fenics_ehd.multibody.bdf import IntegratorState
from fenics_ehd.multibody.periodic import PeriodicSolver, check_period, repeating
from fenics_ehd.multibody.tabulated import Curve

#: Multipliers of a cycle: a whirl that dies away slowly, and a film's that dies at once.
SLOW = 0.93 * np.array([[np.cos(1.3), -np.sin(1.3)], [np.sin(1.3), np.cos(1.3)]])
MAP = np.block([[SLOW, np.ones((2, 1))], [np.zeros((1, 2)), 0.01 * np.ones((1, 1))]])
FIXED = np.array([0.01, -0.02, 0.005])


class AffineRun:
    """Gaps ``1 + x`` that every cycle of a second maps so, and an angle that makes two turns."""

    def __init__(self, cycle=MAP, tolerance=1e-12):
        self.map, self.control = cycle, SimpleNamespace(tolerance=tolerance)
        self.norm = SimpleNamespace(
            observe=self.observe,
            gaps=lambda observed: observed[:3],
            lengths=lambda gaps: gaps,
            gap_reduction=lambda before, after: 1.0 - (after / before).min(),
            film_gaps=lambda observed: [observed[:3]],
        )
        system = SimpleNamespace(
            films=[SimpleNamespace(joint=SimpleNamespace(heat=None))],
            mechanism=ehd.Mechanism({}, {}),
            angles={"crank": 3},
        )
        self.equations = SimpleNamespace(
            system=system,
            contents=lambda _x, _gaps: np.zeros(0),
            keep_within=lambda _states, _gaps: None,
        )
        self.state = self.at(0.0, np.zeros(4))

    @staticmethod
    def observe(x):
        return np.concatenate([1.0 + x[:3], x[3:]])

    def at(self, time, x):
        past = np.stack([x, 0.99 * x])
        observed = np.array([self.observe(point) for point in past])
        return IntegratorState(np.array([time, time - 0.1]), past, 2.0 * past, observed, 0.1)

    def until(self, end):
        if self.state.time >= end:
            return
        x = self.state.x[0]
        moved = FIXED + self.map @ (x[:3] - FIXED)
        self.state = self.at(end, np.append(moved, x[3] + 4 * np.pi))
        yield SimpleNamespace(time=end)


def searched(periodicity=1e-10, most=300, **given):
    run = AffineRun(**given)
    search = PeriodicSolver(run, 1.0, periodicity, most)
    ends = [(search.number, run.state.x[0]) for _ in search]
    return run, search, ends


def test_the_fixed_point_of_an_affine_map_is_found_as_soon_as_it_can_be_known():
    run, search, _ = searched()
    # Three differences of changes span three directions; the cycle after that shows it.
    assert search.number == 5
    np.testing.assert_allclose(run.state.x[0, :3], FIXED, atol=1e-9)
    # No angle but whole turns is added by the shift of a start.
    assert run.state.x[0, 3] == pytest.approx(4 * np.pi * search.number, abs=1e-9)


def test_without_former_cycles_it_takes_as_many_as_the_map_needs(monkeypatch):
    monkeypatch.setattr(periodic, "REMEMBERED", 1)
    _, search, _ = searched(1e-6)
    assert search.number > 100


def test_a_search_goes_on_as_if_it_had_not_stopped():
    whole = searched()[2]
    run = AffineRun()
    search = PeriodicSolver(run, 1.0, 1e-10, 300)
    steps = iter(search)
    for _ in range(5):
        next(steps)
    memory, state = search.state, run.state
    again = AffineRun()
    again.state = state
    resumed = PeriodicSolver(again, 1.0, 1e-10, 300)
    resumed.state = memory
    rest = [(resumed.number, again.state.x[0]) for _ in resumed]
    for (number, x), (expected, x_expected) in zip(rest, whole[5:], strict=True):
        assert number == expected
        np.testing.assert_array_equal(x, x_expected)


def test_a_start_that_would_close_a_gap_is_not_taken(monkeypatch):
    monkeypatch.setattr(periodic, "THINNER", -1.0)
    _, search, _ = searched(1e-6)
    assert search.number > 100


@pytest.mark.parametrize(
    ("tolerance", "cure"),
    [
        (0.0, "check the loads$"),
        (0.1, r"same size: lower time\.tolerance = 0\.1"),
        (1e-20, r"allow more cycles .* lower time\.tolerance = 1e-20"),
    ],
)
def test_no_cycle_is_enough_for_a_map_that_turns_for_ever(tolerance, cure):
    with pytest.raises(ehd.errors.PeriodicityError, match=f"above periodicity .*{cure}"):
        searched(periodicity=1e-30, most=5, tolerance=tolerance)


@pytest.mark.parametrize("cycles", [2, 3])
def test_films_that_repeat_every_few_cycles_are_named(cycles):
    turn = 2 * np.pi / cycles
    whirl = np.diag([0.0, 0.0, 0.01])
    whirl[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    run = AffineRun(whirl)
    run.state = run.at(0.0, np.array([0.4, 0.0, 0.0, 0.0]))
    message = f"repeat every {cycles} cycles of 1 s .*: make .* time.period {cycles} times as long"
    search = PeriodicSolver(run, 1.0, 1e-4, 20)
    with pytest.raises(ehd.errors.PeriodicityError, match=message):
        list(search)
    assert search.number <= 2 * cycles


@pytest.mark.slow
def test_half_frequency_whirl_is_named_and_found_over_two_revolutions():
    # A light load on a heavy rotor: its journal goes around every second turn.
    heavy, period = rotor(400.0, 200.0, load=50.0), 2 * np.pi / 300
    steps = {"periodicity": 1e-3, "cycles": 60, "tolerance": 1e-3, "order": 2}
    with pytest.raises(ehd.errors.PeriodicityError, match=r"2 cycles .* half-frequency whirl"):
        ehd.simulate(heavy, period=period, **steps)
    found = ehd.simulate(heavy, period=2 * period, **steps, largest=0.01)
    turns = np.unwrap(np.arctan2(*found.joints["bearing"].eccentricity.T[::-1]))
    assert turns[-1] - turns[0] == pytest.approx(2 * np.pi, abs=0.1)


def over_angle(degrees):
    """A load over the rotor's angle that closes after so many degrees."""
    angles = np.radians([0.0, 0.25 * degrees, 0.5 * degrees, degrees])
    curve = Curve(PchipInterpolator(angles, [300.0, 200.0, 400.0, 300.0]), periodic=True)
    return ehd.PointForce("journal", (0.0, -1.0), curve, angle_of="journal")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gas": over_angle(720.0)}, r"forces\.gas repeats 0\.5 times .* 2 times as long"),
        (
            {"half": ehd.RotatingForce("journal", 9.0, 500.0)},
            r"forces\.half repeats 1\.6666.* 3 times",
        ),
        (
            {"off": ehd.RotatingForce("journal", 9.0, 301.0)},
            r"forces\.off repeats 1\.00333.* another",
        ),
        ({"twice": over_angle(180.0), "on": ehd.RotatingForce("journal", 9.0, 300.00001)}, None),
    ],
    ids=["over two turns", "faster", "beating", "whole numbers"],
)
def test_loads_of_another_period_than_the_cycle_are_refused_at_once(change, message):
    mechanism = rotor(5.0, 60.0)
    mechanism = replace(mechanism, forces={**mechanism.forces, **change})
    if message is None:
        check_period(mechanism, 2 * np.pi / 300, 1e-4)
        return
    with pytest.raises(ehd.errors.SettingsError, match=message):
        ehd.simulate(mechanism, period=2 * np.pi / 300)


def test_a_crank_that_ends_elsewhere_than_it_began_is_no_cycle():
    arm = {"journal": ehd.RigidBody(5.0, 1e-3, {"pin": (0.05, 0.0)})}
    with pytest.raises(ehd.errors.SettingsError, match=r"drives\.journal repeats 1\.5 times"):
        ehd.simulate(replace(rotor(5.0, 60.0), bodies=arm, forces={}), period=3 * np.pi / 300)


def rotor(mass, unbalance, ramp=0.0, load=300.0):
    """A rigid one in a film, under its load and an unbalance that may grow."""
    film = mechanism_film(0.0225, 0.01, 30e-6, 0.01, (16, 3), rate=300.0)
    turning = ehd.RotatingForce("journal", unbalance, 300.0, ramp)
    forces = {"load": steady(0.0, -load), "unbalance": turning}
    return in_bearing(film, forces, mass=mass, inertia=1e-3, speed=300.0)


def peak(ramp, most):
    """Cycles until a film repeats whose force grows over some, and its peak pressure."""
    period = 2 * np.pi / 300
    search = {"periodicity": 1e-2, "cycles": most, "tolerance": 1e-3, "order": 2}
    found = ehd.simulate(rotor(5.0, 600.0, ramp * period), period=period, **search)
    return found.cycles, found.joints["bearing"].max_pressure.max()


@pytest.mark.slow
def test_a_force_that_grows_slowly_is_none_that_repeats():
    # Its films change by less than 1e-2 a cycle: over 300 cycles, for a quarter of the pressure.
    with pytest.raises(
        ehd.errors.PeriodicityError,
        match=r"forces\.unbalance\.ramp changes until 6\.28319 s, .* cycle 301 .* cycles = 4:",
    ):
        peak(300, 4)
    cycles, pressure = peak(3, 20)
    assert 3 < cycles < 7
    assert pressure == pytest.approx(peak(0, 20)[1], rel=5e-3)


def test_a_table_over_time_has_to_be_over():
    rising = Curve(PchipInterpolator([0.0, 2.0], [100.0, 300.0]), periodic=False)
    run_up = replace(rotor(5.0, 600.0, 0.5), drives={"journal": ehd.Speed(curve=rising)})
    assert repeating(run_up)[0] == 2.0
    torque = ehd.Torque("journal", curve=rising, over="time")
    assert repeating(replace(rotor(5.0, 60.0), drives={}, forces={"drive": torque}))[0] == 2.0
    held = Curve(PchipInterpolator([0.0, 0.5, 10.0], [100.0, 300.0, 300.0]), periodic=False)
    assert repeating(replace(run_up, drives={"journal": ehd.Speed(curve=held)}))[0] == 0.5
    even = Curve(PchipInterpolator([0.0, 10.0], [300.0, 300.0]), periodic=False)
    assert (
        repeating(replace(run_up, forces={}, drives={"journal": ehd.Speed(curve=even)}))[0] == 0.0
    )
    over_angle = attrs.evolve(torque, over="angle")
    assert repeating(replace(rotor(5.0, 60.0), drives={}, forces={"drive": over_angle}))[0] == 0.0
    assert repeating(rotor(5.0, 600.0, 0.5))[0] == 0.5


# --- A mechanism, against an initial value problem

CLEARANCE = 17e-6


def orbit(result, times):
    """Eccentricity at given times, over the clearance, shape (times, 2)."""
    joint = result.joints["big_end"]
    return CubicSpline(result.time, joint.eccentricity / CLEARANCE)(times)


@pytest.mark.slow
def test_the_periodic_cycle_is_the_last_of_a_long_run():
    mechanism = slider_crank(rigid_rod(), mechanism_film(22.5e-3, 2.2e-3, CLEARANCE, 10.0, (24, 4)))
    long = ehd.simulate(mechanism, 5 * REVOLUTION, tolerance=1e-5, largest=0.02 / 5)
    times = np.linspace(0.03, 0.97, 200) * REVOLUTION
    first, last = orbit(long, times), orbit(long, times + 4 * REVOLUTION)
    # It is not where the first revolution is, which begins with a centred journal.
    assert np.abs(first - last).max() > 1e-2
    counts = []
    for periodicity in (0.1, 1e-4):
        result = ehd.simulate(mechanism, period=REVOLUTION, periodicity=periodicity, tolerance=1e-5)
        assert result.summary()["periodicity_defect"] <= periodicity
        counts.append(result.cycles)
    assert 2 <= counts[0] < counts[1] < 5
    assert result.time[0] == 0.0
    assert result.time[-1] == pytest.approx(REVOLUTION, rel=1e-12)
    assert np.abs(orbit(result, times) - last).max() < 3e-4
    # Cycles follow each other without a stop: the films of both ends are one film.
    before, after = (result.joints["big_end"].min_film_thickness[at] for at in (1, -1))
    assert before == pytest.approx(after, rel=0.05)
