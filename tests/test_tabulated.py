"""Rows of tables that no step may jump over."""

from dataclasses import dataclass, replace

import attrs
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from journal_cases import in_bearing
from mechanism_cases import REVOLUTION, SPEED, film, rigid_rod, slider_crank
from newton_steps import integrate
from scipy.interpolate import CubicSpline, PchipInterpolator, PPoly
from stopped_steps import assert_goes_on
from test_bdf import control, oscillator, profile

import fenics_ehd as ehd
from fenics_ehd.multibody import tabulated
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.tabulated import Curve, TabulatedLoad
from fenics_ehd.scenes.tables import angle_table, load_curves


def curve_through(rows, values):
    """A table over the time."""
    return TabulatedLoad(Curve(CubicSpline(rows, values), periodic=True))


@dataclass(frozen=True, eq=False)
class Placed(TabulatedLoad):
    """A table read at places that a function of times and states gives."""

    at: object = None

    def positions(self, times, states):
        return self.at(times, states)


def largest_missed(load, steps, start):
    """Largest distance of a row from a polynomial that ends with its step, relative to the table.

    That of degree 1, 2 or 3, whichever comes closest: how far back it reaches is for the steps to
    decide.
    """
    times = np.array([0.0, *(s.time for s in steps)])
    places = load.positions(times, np.array([start, *(s.x for s in steps)]))
    of_rows = load.curve.curve.x
    values = np.array([load.curve(place)[0] for place in places])
    rows = np.concatenate([of_rows[:-1] + k * np.ptp(of_rows) for k in range(-60, 60)])
    of_values = load.curve.curve(of_rows)
    wanted = np.tile(of_values[:-1], 120)
    worst = 0.0
    for i in range(1, len(times)):
        at = (rows - places[i - 1]) / (places[i] - places[i - 1])
        within = (at > 0) & (at < 1)
        off = []
        for degree in range(1, min(3, i) + 1):
            some = slice(i - degree, i + 1)
            share = (times[some] - times[i - 1]) / (times[i] - times[i - 1])
            line = np.polyfit(share, values[some], degree)
            distance = np.abs(np.polyval(line, at[within]) - wanted[within])
            off.append(distance.max(initial=0.0))
        worst = max(worst, min(off))
    return worst / np.abs(of_values).max()


@settings(profile, max_examples=30)
@given(
    st.lists(st.floats(0.02, 0.3), min_size=3, max_size=30),
    st.sampled_from(["smooth", "spiked", "rough"]),
    st.sampled_from([0.0, 0.5, -3.0]),
    st.sampled_from([1, 2, 3]),
)
def test_no_step_misses_a_row(gaps, kind, follows, order):
    rows = np.concatenate([[0.0], np.cumsum(gaps)])
    values = {
        "smooth": np.cos(2 * np.pi * rows / rows[-1]),
        "spiked": np.eye(len(rows))[len(rows) // 2],
        "rough": np.random.default_rng(len(rows)).uniform(-1, 1, len(rows)),
    }[kind]
    values[-1] = values[0]
    # An angle that the state decides, as that of a free crank, and a kick that nothing foretells.
    curve = curve_through(rows, values).curve
    load = Placed(curve, at=lambda times, states: times + follows * states[:, 0])
    problem, start = oscillator(0.3, 4.0, lambda t: 1.0 + 5.0 * (t > 1.3)), np.zeros(1)
    sizes = control(tolerance=1e-2, first=1e-3, order=order)
    steps = list(integrate(problem, (0.0, 3.0), start, start, sizes, tables=[load]))
    assert largest_missed(load, steps, start) <= 0.01 * (1 + 1e-6)


def test_a_jump_is_no_reason_to_stop():
    rows, values = np.array([0.0, 1.0, 1.0 + 1e-15, 3.0]), np.array([0.0, 0.0, 1.0, 0.0])
    line = PPoly(np.stack([np.diff(values) / np.diff(rows), values[:-1]]), rows)
    step = TabulatedLoad(Curve(line, periodic=True))
    problem, rest = oscillator(1.0, 4.0, lambda t: step.curve(t)[0]), np.zeros(1)
    steps = list(integrate(problem, (0.0, 2.0), rest, rest, control(), tables=[step]))
    assert steps[-1].time == 2.0


@pytest.mark.parametrize("place", [1e12, -1e300, np.inf, np.nan])
def test_a_step_to_nowhere_is_too_long(place):
    table = curve_through(np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.0, 1.0, -1.0, 0.0]))
    load = Placed(table.curve, at=lambda times, states: np.where(times > 1, place, 0.0))
    when, amount = load.missed(np.array([2.0, 1.0]), np.zeros((2, 1)))
    assert (when, amount) == (1.5, np.inf)


# --- Machines


def machine(curve, kind="gas", **steps):
    """A rigid rod under one table, over a sixteenth of a revolution."""
    return ehd.simulate(under_table(curve, kind), 0.065 * REVOLUTION, **steps)


def under_table(curve, kind="gas"):
    drives, forces = {"crank": ehd.Speed(SPEED)}, {}
    if kind == "gas":
        forces = {"gas": ehd.PointForce("piston", (-1.0, 0.0), curve, "crank")}
    else:
        drives, forces = {}, {"motor": ehd.Torque("crank", curve=curve, damping=0.01, speed=SPEED)}
    mechanism = slider_crank(rigid_rod(), film(22.5e-3, 22e-3, 17e-6, 0.01, (10, 2)))
    crank = attrs.evolve(mechanism.bodies["crank"], speed=SPEED)
    return replace(
        mechanism, bodies={**mechanism.bodies, "crank": crank}, drives=drives, forces=forces
    )


def spike(peak):
    angles = np.radians([0.0, 20.0, 20.1, 20.2, 360.0])
    return angle_table(angles, np.array([0.0, 0.0, peak, 0.0, 0.0]))


@pytest.mark.parametrize(
    ("kind", "peak"), [("gas", 2e5), pytest.param("torque", 1e4, marks=pytest.mark.slow)]
)
def test_default_steps_of_a_machine_see_a_spike(kind, peak):
    default, short, nothing = (
        machine(spike(size), kind, largest=largest)
        for size, largest in ((peak, 0.3), (peak, 0.003), (0.0, 0.3))
    )
    highest = [r.joints["big_end"].max_pressure.max() for r in (default, short, nothing)]
    assert highest[1] > 2 * highest[2]
    assert highest[0] == pytest.approx(highest[1], rel=1e-2)
    assert len(default.time) < len(short.time) / 3


def test_default_steps_of_a_journal_see_a_spike():
    times = np.sort(np.append(np.arange(0, 12.1, 0.1), 6.01)) * 1e-3
    unit = 1e4
    forces = unit * np.column_stack([np.where(times == 6.01e-3, 50.0, 1.0), 0 * times])
    curves = load_curves(times, forces, "linear")
    loads = {
        axis: ehd.PointForce("journal", tuple(np.eye(2)[i]), curve)
        for i, (axis, curve) in enumerate(zip("xy", curves, strict=True))
    }
    mechanism = in_bearing(film(0.02, 0.04, 20e-6, 0.01, (12, 2)), loads, speed=300.0)
    result = ehd.simulate(mechanism, times[-1], tolerance=1e-2)
    assert np.abs(result.time - 6.01e-3).min() < 1e-12
    at = np.abs(result.time - 6.01e-3).argmin()
    assert result.joints["bearing"].force[at, 0] == pytest.approx(-50 * unit, rel=1e-3)


def test_a_spike_of_a_speed_table_is_felt():
    times, speeds = np.array([0.0, 1e-3, 1.01e-3, 1.02e-3, 2e-3]), np.array([1.0, 1, 50, 1, 1])
    drive = ehd.Speed(curve=Curve(PchipInterpolator(times, speeds), periodic=False))
    axle = {"axle": ehd.Revolute(("ground", "wheel"))}
    wheel = ehd.Mechanism({"wheel": ehd.RigidBody(1.0, 1e-3)}, axle, {"wheel": drive})
    result = ehd.simulate(wheel, 2e-3, largest=0.5)
    assert result.bodies["wheel"].rates[:, 2].max() == pytest.approx(50.0, rel=0.05)


@pytest.mark.parametrize("tolerance", [1e-5, 1e-2])
def test_a_smooth_table_costs_no_steps(monkeypatch, tolerance):
    # The gas of an engine of two strokes, in rows of a degree.
    angles = np.radians(np.arange(361.0))
    gas = angle_table(angles, 500 + 2e4 * np.exp(4 * (np.cos(angles - np.radians(15)) - 1)))
    with_rows = len(machine(gas, tolerance=tolerance, largest=0.3).time)
    monkeypatch.setattr(tabulated, "MISSED", np.inf)
    without = len(machine(gas, tolerance=tolerance, largest=0.3).time)
    assert with_rows <= 1.1 * without


def test_a_run_goes_on_from_a_corner_to_the_last_bit():
    angles = np.radians([0.0, 5.0, 5.3, 5.6, 360.0])
    mechanism = under_table(angle_table(angles, np.array([0.0, 0.0, 2e4, 0.0, 0.0])))

    def second_corner(states):
        return [i for i, state in enumerate(states) if len(state.times) == 1][1]

    assert_goes_on(mechanism, IntegratorOptions(tolerance=1e-4), 0.02 * REVOLUTION, second_corner)
