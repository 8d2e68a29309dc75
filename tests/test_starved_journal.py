"""A journal whose film keeps account of its oil, against Reynolds' condition and steady films."""

import json

import attrs
import numpy as np
import pytest
from click.testing import CliRunner
from journal_cases import ETA, OMEGA, UNIT_LOAD, C, R, orbit, periodic, scene
from scipy.optimize import root

from fenics_ehd.cli import cli
from fenics_ehd.errors import SettingsError
from fenics_ehd.film import ShaftMotion, shaft_gap
from fenics_ehd.film.forces import film_forces
from fenics_ehd.film.mass_conserving import MassConservingFilm
from fenics_ehd.multibody import starved_journal
from fenics_ehd.multibody.bdf import StepControl, integrate
from fenics_ehd.output import read_history
from fenics_ehd.scenes.loaded_journal import build_film, build_journal

PERIOD = 4 * np.pi / OMEGA
GROOVE = (90.0, 30.0, 2e5)


def starved(*, cavitation="mass-conserving", element="bilinear", ambient=0.0, **options):
    settings = scene(**options)
    return attrs.evolve(
        settings,
        bearing=attrs.evolve(settings.bearing, ambient_pressure=ambient),
        film=attrs.evolve(settings.film, element=element, cavitation=cavitation),
    )


def march(journal, load, start, tolerance, *, share, order=1):
    """Steps of so many cycles, from the first start on."""
    control = StepControl(tolerance, 1e-6, 1e-13, 0.1 * load.period, order)
    search, steps = journal.search(control), []
    while share > 0:
        search.begin(start)
        rate = journal.starting_rate(0.0, start, load.largest)
        for step in integrate(journal, (0.0, min(share, 1) * load.period), start, rate, control):
            search.add(step)
            steps.append(step)
        start, share = step.x, share - 1
    return steps


def test_flooded_film_moves_as_under_reynolds_condition_to_first_order():
    load = periodic(
        lambda s: 0.3 * UNIT_LOAD * np.array([np.cos(2 * np.pi * s), 0.5 * np.sin(4 * np.pi * s)]),
        PERIOD,
        rows=37,
    )
    start, share = np.array([0.3, 0.1]) * C, 0.15
    flooded = starved(cells=(12, 2), ambient=1e8)
    full = starved(cells=(12, 2), ambient=1e8, cavitation="reynolds")
    reference = march(build_journal(full, load), load, start, 1e-5, share=share, order=3)
    assert min(step.auxiliary.film.pressure.min() for step in reference) > 0
    tolerances, errors = np.array([1e-2, 1e-3, 1e-4]), []
    for tolerance in tolerances:
        steps = march(build_journal(flooded, load), load, start, tolerance, share=share)
        errors.append(np.hypot(*(steps[-1].x - reference[-1].x)) / C)
        assert errors[-1] < len(steps) * tolerance
    # Nothing is forgotten: local errors ~ step^2 add up to an error ~ step.
    assert np.polyfit(np.log(tolerances), np.log(errors), 1)[0] == pytest.approx(0.5, abs=0.07)


@pytest.fixture(scope="module")
def settled():
    """Constant load and one groove."""
    settings = starved(cells=(24, 4), grooves=(GROOVE,), tolerance=1e-2, periodicity=1e-6)
    load = periodic(lambda _: 0.3 * UNIT_LOAD * np.array([0.0, -1.0]), PERIOD, rows=3)
    return settings, load, orbit(settings, load)


def test_constant_load_ends_at_the_equilibrium_of_the_steady_film(settled):
    settings, load, (columns, totals, cycle) = settled
    film = build_film(settings, load.period)
    oil = MassConservingFilm(film)
    directions = film.load(np.stack(film.points.normal, axis=-1))

    def at(ratio):
        motion = ShaftMotion(C * ratio, OMEGA)
        return oil.steady(shaft_gap(film.points, R, C, motion)), motion

    def imbalance(ratio):
        return (directions @ at(ratio)[0].pressure - load(0.0)) / load.largest

    solution = root(imbalance, cycle.end / C, tol=1e-10)
    assert solution.success
    assert cycle.end / C == pytest.approx(solution.x, abs=2e-6)
    assert 0 < totals.largest_multiplier < 1
    steady, motion = at(solution.x)
    assert columns["min_fluid_fraction"][-1] == pytest.approx(steady.fluid_fraction.min(), abs=1e-4)
    assert 0.2 < steady.fluid_fraction.min() < 0.9
    # Friction is that of the oil there is.
    friction = film_forces(film, steady, motion).friction_torque
    assert columns["friction_torque_Nm"][-1] == pytest.approx(-friction, rel=1e-4)
    assert abs(friction) < 0.99 * abs(film_forces(film, steady, motion, "full").friction_torque)
    assert totals.oil.summary()["mean_side_flow_m3_per_s"] == pytest.approx(
        steady.outflow[steady.outflow > 0].sum(), rel=1e-4
    )


def test_oil_changes_by_supply_and_side_flow_alone(settled):
    _, _, (columns, totals, _) = settled
    content = columns["oil_content_m3"]
    gained = columns["step_s"] * (columns["supply_m3_per_s"] - columns["side_flow_m3_per_s"])
    # Over every cycle but the first, whose start has no row; the largest change is in the first.
    for cycle in range(1, totals.cycle + 1):
        rows = np.flatnonzero(columns["cycle"] == cycle)
        before = content[rows[0] - 1] if cycle > 1 else content[rows[0]]
        change = gained[rows].sum() if cycle > 1 else gained[rows[1:]].sum()
        assert content[rows[-1]] - before == pytest.approx(change, abs=1e-13 * content[-1])
    assert np.ptp(content) > 0.05 * content[-1]
    assert totals.oil.summary()["oil_balance_error"] < 1e-13
    assert np.all(columns["mean_fluid_fraction"] <= 1)


def test_force_derivatives_are_those_of_the_force():
    settings = starved(cells=(16, 4), grooves=(GROOVE,))
    load = periodic(lambda _: UNIT_LOAD * np.array([0.0, -1.0]), PERIOD, rows=3)
    journal = build_journal(settings, load)
    journal.begin(np.array([0.4, -0.3]) * C)
    x, rate, time = np.array([0.5, -0.3]) * C, np.array([1e-3, 2e-3]), 2e-4
    state = journal.state(time, x, rate, None)
    assert 0.1 < (state.film.fluid_fraction < 1).mean() < 0.9
    scale = np.abs(state.force).max()
    for h, slope, moved in (
        (1e-6 * C, state.stiffness, lambda d: (x + d, rate)),
        (1e-4, state.damping, lambda d: (x, rate + d)),
    ):
        difference = np.column_stack(
            [
                journal.state(time, *moved(h * d), state.film).force
                - journal.state(time, *moved(-h * d), state.film).force
                for d in np.eye(2)
            ]
        ) / (2 * h)
        assert slope == pytest.approx(difference, rel=1e-5, abs=1e-6 * scale / C)


def test_shaft_crosses_a_gap_that_has_emptied_whatever_damps_it(monkeypatch):
    width, period = R, 0.01
    size = 3.2 * np.pi * ETA * R * width**3 / C**2 / period
    load = periodic(lambda s: np.array([size * np.sin(2 * np.pi * s), 0.0]), period, rows=37)
    settings = starved(width=width, speed=0.0, cells=(8, 2), ambient=1e5)
    extremes = []
    for damping in (10 * starved_journal.EMPTY_DAMPING, starved_journal.EMPTY_DAMPING):
        monkeypatch.setattr(starved_journal, "EMPTY_DAMPING", damping)
        steps = march(build_journal(settings, load), load, np.zeros(2), 2e-2, share=1.55)
        ratios = np.array([step.x[0] for step in steps]) / C
        extremes.append([ratios.min(), ratios.max()])
    assert extremes[0] == pytest.approx(extremes[1], abs=1e-3)
    # Within a thousandth of the period it falls across a tenth of the clearance.
    assert max(abs(step.rate[0]) for step in steps) > 100 * C / period


SCENE = """
scene = "loaded-journal"
[bearing]
grooves = [[90.0, 30.0, 2e5]]
[film]
cells = [16, 3]
element = "bilinear"
cavitation = "mass-conserving"
[load]
file = "load.csv"
[time]
tolerance = 1e-2
largest_step = 0.1
periodicity = 1e-2
"""
LOAD_FILE = "time_ms,Fx_N,Fy_N\n0,300,-500\n5,0,-800\n10,-300,-500\n15,0,-200\n20,300,-500\n"


def test_scene_file_runs_and_reports_the_oil(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    (tmp_path / "load.csv").write_text(LOAD_FILE)
    out = tmp_path / "out"
    arguments = ["run", str(tmp_path / "scene.toml"), "-o", str(out), "--no-plots"]
    result = CliRunner().invoke(cli, arguments)
    assert result.exit_code == 0, result.output
    assert "fluid fraction" in result.output
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "complete"
    assert summary["cycles"] >= 2
    assert summary["oil_balance_error"] < 1e-12
    assert 0 < summary["min_fluid_fraction"] < summary["mean_fluid_fraction"] < 1
    # What comes in goes out, but for what the tolerance leaves of the change over a cycle.
    assert summary["mean_side_flow_m3_per_s"] == pytest.approx(
        summary["mean_supply_m3_per_s"], rel=1e-2
    )
    history = read_history(out)
    last = history["cycle"] == summary["cycles"]
    assert history["min_fluid_fraction"][last].min() == pytest.approx(summary["min_fluid_fraction"])
    assert history["oil_content_m3"][-1] == pytest.approx(summary["oil_content_m3"])


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({}, "bearing.grooves: film.cavitation = 'mass-conserving' needs a supply"),
        ({"grooves": ((90.0, 30.0, 0.0),)}, "bearing.ambient_pressure above 0"),
        ({"grooves": (GROOVE,), "element": "lagrange"}, "film.element = 'lagrange'"),
    ],
    ids=["dry", "drain", "element"],
)
def test_films_that_cannot_keep_their_oil_are_refused(options, named):
    settings = starved(**options)
    with pytest.raises(SettingsError) as error:
        build_journal(settings, periodic(lambda _: np.ones(2), PERIOD, rows=3))
    assert named in str(error.value)
