"""What a run says of its own errors, and whether it may be believed."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hand_made_rod import SPEED, Joint, flexible, make_body
from test_coupled_steps import with_residual
from test_resume import call

from fenics_ehd.multibody.basis_error import BasisErrorEstimate
from fenics_ehd.multibody.energy import EnergyBalance, Powers
from fenics_ehd.multibody.neglected_inertia import neglected_inertia, slowest_pattern
from fenics_ehd.reduction import save_body
from fenics_ehd.scenes.run import Totals, simulate, verdict
from fenics_ehd.scenes.slider_crank_settings import Mechanism, SliderCrankSettings, Time

# --- Energy


@pytest.mark.parametrize(
    ("exchanged", "dissipated", "said"),
    [
        (0.049, 0.1, "complete"),
        (0.051, 0.1, "energy balance error 5.1 % of the energy exchanged, above 5 %"),
        (0.01, 0.19, "complete"),
        (0.01, 0.21, "energy balance error 21 % of the energy put in for good, above 20 %"),
        (4e-4, 0.21, "complete"),
        (0.01, np.inf, "error inf % of the energy put in for good"),
    ],
)
def test_the_verdict_looks_at_both_energy_errors(exchanged, dissipated, said):
    totals = Totals(energy_error=exchanged, net_energy_error=dissipated)
    assert said in verdict(totals)
    assert verdict(totals).startswith("untrustworthy") == (said != "complete")


def powers_at(angle, dissipation):
    """A flywheel that lends 100 J twice a turn, and what is lost by the way."""
    return Powers(
        kinetic=100 * np.cos(2 * angle), strain=0.0, drag=0.0, damping=0.0, film=dissipation,
        drive=dissipation - 200 * SPEED * np.sin(2 * angle),
    )  # fmt: skip


def test_the_integral_of_what_is_lent_hides_no_loss():
    # Steps of a degree, reached from a short one, and a loss of a thousandth.
    angles = np.radians(np.append(2.0 ** np.arange(-15, 0), np.arange(1.0, 360.5)))
    dissipation = 0.1 * SPEED / (2 * np.pi)
    balance = EnergyBalance(0.0, powers_at(0.0, dissipation))
    for angle in angles:
        balance.add(angle / SPEED, powers_at(angle, dissipation))
    assert balance.work["film"] == pytest.approx(0.1)
    assert balance.net_error < 0.01


def test_energy_that_stays_is_put_in_for_good():
    # Half as much is dissipated as is stored, and a tenth of that is missing.
    balance = EnergyBalance(0.0, Powers(0.0, 0.0, 1.4, 0.0, 0.5, 0.0))
    for time in (1.0, 2.0, 3.0):
        balance.add(time, Powers(time, 0.0, 1.4, 0.0, 0.5, 0.0))
    assert balance.net_error == pytest.approx(0.3 / 4.5)
    # All that was stored is given back.
    balance.add(4.0, Powers(0.0, 0.0, 1.4, 0.0, 0.5, 0.0))
    balance.add(5.0, Powers(1.0, 0.0, 1.4, 0.0, 0.5, 0.0))
    assert balance.net_error == pytest.approx(balance.largest_defect / 2.5)


def test_a_defect_where_nothing_stays_is_infinite():
    balance = EnergyBalance(0.0, powers_at(0.0, 0.0))
    assert balance.net_error == 0.0
    for angle in (0.1, 0.0):
        balance.add(1e-3 * (1 + angle), powers_at(angle, 0.0))
    assert balance.net_error == np.inf


def run_of(body, *, speed=SPEED, revolutions=1.0, **times):
    settings = SliderCrankSettings(
        mechanism=Mechanism(revolutions=revolutions, crank_speed=speed), time=Time(**times)
    )
    rows = []
    totals = simulate(settings, body, Totals(), lambda row, _: rows.append(row))
    return totals, {name: np.array([row[name] for row in rows]) for name in rows[0]}


@pytest.fixture(scope="module")
def body():
    return flexible(Joint((10, 2)))[0]


def test_a_film_that_long_steps_leave_wrong_is_not_called_complete():
    body = make_body(Joint((10, 2)))
    good, curves = run_of(body)
    assert verdict(good) == "complete"
    bad, others = run_of(body, tolerance=0.01, largest_step=30)
    known = np.interp(others["time_s"], curves["time_s"], curves["min_film_thickness_m"])
    off = np.abs(others["min_film_thickness_m"] / known - 1)[others["time_s"] > 2e-4]
    assert off.max() > 0.1, "this test wants a film that is wrong"
    assert verdict(bad).startswith("untrustworthy: energy balance error")
    assert bad.net_energy_error > 20 * good.net_energy_error


@pytest.mark.parametrize("speed", [2.0, 20.0])
def test_a_slow_crank_that_dissipates_little_is_called_complete(body, speed):
    totals, _ = run_of(body, speed=speed, tolerance=1e-3)
    assert verdict(totals) == "complete"


def test_a_run_that_cannot_be_trusted_fails(tmp_path, capfd):
    # Nothing but rigid motion, in steps of 60 degrees.
    scene = tmp_path / "scene.toml"
    scene.write_text('scene = "slider-crank"\n[time]\ntolerance = 0.5\nlargest_step = 60\n')
    save_body(make_body(Joint((10, 2))), tmp_path / "rod.h5")
    status = call("run", scene, "--body", tmp_path / "rod.h5", "--no-plots", "-o", tmp_path / "out")
    assert status == 1
    assert "untrustworthy: energy balance error" in capfd.readouterr().err
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["status"].startswith("untrustworthy")
    assert summary["net_energy_balance_error"] > 0.2


# --- The basis


def estimate_after(estimate, time, *, pressure=0.0, acceleration=0.0, steps=400):
    """The estimate after a time of constant pressure and acceleration."""
    for _ in range(steps):
        error = estimate.add(time / steps, np.full(3, pressure), np.full(2, acceleration))
    return error


@pytest.mark.parametrize("time", [0.3e-3, 1e-3, 3e-3])
def test_missing_flexibility_answers_as_late_as_the_structure(time):
    estimate = BasisErrorEstimate(np.full((4, 3), 1e-15), 1e-3)
    expected = 3e-15 * 1e7 * (1 - np.exp(-time / 1e-3))
    assert estimate_after(estimate, time, pressure=1e7) == pytest.approx(expected, rel=5e-3)


def test_neglected_inertia_needs_time_to_move_the_bore():
    def inert(lag):
        return BasisErrorEstimate(np.zeros((4, 3)), lag, np.full((4, 2), 1e-20), 1e-4)

    for lag, whole in ((1e-3, 1.1e-3), (0.0, 1e-4)):
        # What is over in a microsecond, and what lasts.
        short = estimate_after(inert(lag), 1e-6, acceleration=1e12)
        assert short == pytest.approx(2e-8 * 1e-6 / whole, rel=1e-2)
        settled = estimate_after(inert(lag), 10e-3, acceleration=1e12)
        assert settled == pytest.approx(2e-8, rel=1e-3)


def test_estimates_go_on_where_they_were():
    first, second = (
        BasisErrorEstimate(np.full((4, 3), 1e-15), 1e-3, np.full((4, 2), 1e-20)) for _ in range(2)
    )
    estimate_after(first, 1e-4, pressure=1e7, acceleration=1e12)
    second.restore(first.memory())
    assert second.largest == first.largest
    ends = [estimate_after(e, 1e-4, pressure=2e7, acceleration=-1e11) for e in (first, second)]
    assert ends[0] == ends[1]


@pytest.fixture(scope="module")
def residual_body(body):
    """Patterns of some 20 kHz."""
    joint = Joint((10, 2))
    body = with_residual(joint, body)
    stiffness = body.residual.stiffness
    mass = np.diag(stiffness / (2 * np.pi * np.linspace(2e4, 3e4, len(stiffness))) ** 2)
    none_missing = np.zeros((len(body.bore_nodes), len(body.pressure_nodes)))
    residual = replace(body.residual, mass=mass)
    return replace(body, residual=residual, missing_flexibility=none_missing)


def test_the_slowest_pattern_is_that_of_the_lowest_frequency(body, residual_body):
    assert slowest_pattern(residual_body) == pytest.approx(1 / (2 * np.pi * 2e4))
    assert slowest_pattern(body) == 0.0
    assert neglected_inertia(body).shape == (0, 0)


def test_the_estimate_of_patterns_without_mass_is_not_that_of_the_start(residual_body):
    _, curves = run_of(residual_body, revolutions=0.2, tolerance=1e-4)
    estimates, early = curves["basis_error_estimate_m"], curves["time_s"] < 1e-6
    assert early.sum() > 5
    assert 0 < estimates[early].max() < 0.1 * estimates.max()
