"""Rows of tables that no step may jump over."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from hand_made_rod import Joint, make_body
from hypothesis import given, settings
from hypothesis import strategies as st
from journal_cases import UNIT_LOAD, orbit, scene
from scipy.interpolate import CubicSpline
from test_bdf import control, oscillator, profile

from fenics_ehd.multibody import tabulated
from fenics_ehd.multibody.bdf import integrate
from fenics_ehd.multibody.tabulated import TabulatedLoad
from fenics_ehd.scenes.load_history import LoadHistory
from fenics_ehd.scenes.run import Totals, simulate
from fenics_ehd.scenes.slider_crank_settings import Mechanism, SliderCrankSettings, Time


def curve_through(rows, values):
    """A table over the time."""
    curve = CubicSpline(rows, values)
    return TabulatedLoad(
        rows, values, lambda t: curve((t - rows[0]) % np.ptp(rows) + rows[0]), lambda t, x: t
    )


def largest_missed(load, steps, start):
    """Largest distance of a row from a polynomial that ends with its step, relative to the table.

    That of degree 1, 2 or 3, whichever comes closest: how far back it reaches is for the steps to
    decide.
    """
    times = np.array([0.0, *(s.time for s in steps)])
    states = [start, *(s.x for s in steps)]
    places = np.array([load.place(t, x) for t, x in zip(times, states, strict=True)])
    values = np.array([load.at(place) for place in places])
    rows = np.concatenate([load.rows[:-1] + k * np.ptp(load.rows) for k in range(-60, 60)])
    wanted = np.tile(load.values[:-1], 120)
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
    return worst / np.abs(load.values).max()


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
    load = replace(curve_through(rows, values), place=lambda t, x: t + follows * x[0])
    problem, start = oscillator(0.3, 4.0, lambda t: 1.0 + 5.0 * (t > 1.3)), np.zeros(1)
    sizes = control(tolerance=1e-2, first_step=1e-3, order=order)
    steps = list(integrate(problem, (0.0, 3.0), start, start, sizes, tables=[load]))
    assert largest_missed(load, steps, start) <= 0.01 * (1 + 1e-6)


def test_a_spike_between_two_steps_is_felt():
    # Two wide periods of nothing, and a hundredth between them: an impulse of 1.
    rows, values = np.array([0.0, 1.0, 1.01, 1.02, 3.0]), np.array([0.0, 0.0, 100.0, 0.0, 0.0])
    spike = TabulatedLoad(rows, values, lambda t: np.interp(t, rows, values), lambda t, x: t)
    x, rest = {}, np.zeros(1)
    for name, tables in (("blind", []), ("seeing", [spike])):
        problem = oscillator(0.0, 4.0, spike.at)
        sizes = control(tolerance=1e-5, largest_step=0.3)
        *_, last = integrate(problem, (0.0, 2.0), rest, rest, sizes, tables=tables)
        x[name] = last.x[0]
    assert x["blind"] == 0.0
    assert x["seeing"] == pytest.approx(0.5 * np.sin(2 * (2.0 - 1.01)), rel=2e-2)


def test_a_jump_is_no_reason_to_stop():
    rows, values = np.array([0.0, 1.0, 1.0 + 1e-15, 3.0]), np.array([0.0, 0.0, 1.0, 0.0])
    step = TabulatedLoad(rows, values, lambda t: np.interp(t, rows, values), lambda t, x: t)
    problem, rest = oscillator(1.0, 4.0, step.at), np.zeros(1)
    steps = list(integrate(problem, (0.0, 2.0), rest, rest, control(), tables=[step]))
    assert steps[-1].time == 2.0


@pytest.mark.parametrize("place", [1e12, -1e300, np.inf, np.nan])
def test_a_step_to_nowhere_is_too_long(place):
    table = curve_through(np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.0, 1.0, -1.0, 0.0]))
    load = replace(table, place=lambda t, x: place if t > 1 else 0.0)
    when, amount = load.missed(np.array([2.0, 1.0]), np.zeros((2, 1)))
    assert (when, amount) == (1.5, np.inf)


def machine_totals(tmp_path, table, **changes):
    """A rigid rod under one table."""
    name, text = table
    path = tmp_path / f"{name}.csv"
    path.write_text(text)
    drive = {"drive": "torque", "drive_damping": 0.01} if name == "drive_torque_table" else {}
    settings = SliderCrankSettings(
        mechanism=Mechanism(revolutions=0.065, **{name: str(path)}, **drive), time=Time(**changes)
    )
    return simulate(settings, make_body(Joint((10, 2))), Totals())


@pytest.mark.parametrize(
    ("name", "column", "peak"),
    [("gas_force", "force_N", 2e5), ("drive_torque_table", "torque_Nm", 1e4)],
)
def test_default_steps_of_a_machine_see_a_spike(tmp_path, name, column, peak):
    spike = f"angle_deg,{column}\n0,0\n20,0\n20.1,{peak}\n20.2,0\n360,0\n"
    default = machine_totals(tmp_path, (name, spike))
    short = machine_totals(tmp_path, (name, spike), largest_step=0.05)
    nothing = machine_totals(tmp_path, (name, f"angle_deg,{column}\n0,0\n180,0\n360,0\n"))
    assert short.max_pressure > 2 * nothing.max_pressure
    assert default.max_pressure == pytest.approx(short.max_pressure, rel=1e-2)
    assert default.steps < short.steps / 3


def test_default_steps_of_a_journal_see_a_spike():
    times = np.sort(np.append(np.arange(0, 12.1, 0.1), 6.01)) * 1e-3
    forces = UNIT_LOAD * np.column_stack([np.where(times == 6.01e-3, 50.0, 1.0), 0 * times])
    load = LoadHistory(times, forces, "linear")
    assert load.largest == 50 * UNIT_LOAD
    rows, _, _ = orbit(scene(cells=(12, 2), periodicity=1e-2), load)
    assert rows["load_x_N"].max() == pytest.approx(load.largest, rel=1e-6)


@pytest.mark.parametrize("tolerance", [1e-5, 1e-2])
def test_a_smooth_table_costs_no_steps(tmp_path, monkeypatch, tolerance):
    # The gas of an engine of two strokes, in rows of a degree.
    angles = np.arange(361.0)
    gas = 500 + 2e4 * np.exp(4 * (np.cos(np.radians(angles - 15)) - 1))
    rows = "".join(f"{angle},{force:.6f}\n" for angle, force in zip(angles, gas, strict=True))
    table = "gas_force", "angle_deg,force_N\n" + rows
    with_rows = machine_totals(tmp_path, table, tolerance=tolerance, largest_step=20.0).steps
    monkeypatch.setattr(tabulated, "MISSED", np.inf)
    without = machine_totals(tmp_path, table, tolerance=tolerance, largest_step=20.0).steps
    assert with_rows <= 1.1 * without


def test_a_run_goes_on_from_a_corner_to_the_last_bit(tmp_path):
    path = tmp_path / "gas.csv"
    path.write_text("angle_deg,force_N\n0,0\n5,0\n5.3,2e4\n5.6,0\n360,0\n")
    settings = SliderCrankSettings(
        mechanism=Mechanism(revolutions=0.02, gas_force=str(path)), time=Time(tolerance=1e-4)
    )
    body, memories, rows, again = make_body(Joint((8, 2))), [], [], []
    simulate(
        settings, body, Totals(), lambda row, _: rows.append(row),
        checkpoint=lambda run: memories.append(deepcopy(run.memory())),
    )  # fmt: skip
    alone = [i for i, memory in enumerate(memories) if len(memory["integrator"]["times"]) == 1]
    assert len(alone) > 1, "this test wants steps that end at corners"
    simulate(settings, body, Totals(), lambda row, _: again.append(row), memory=memories[alone[1]])
    assert repr(again) == repr(rows[alone[1] + 1 :])
