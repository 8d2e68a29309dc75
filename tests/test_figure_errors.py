"""Errors of all figures of a run, compared with a stored reference."""

import json
from pathlib import Path

import numpy as np
import pytest
from test_error_budget import END, machine

import fenics_ehd as ehd
from fenics_ehd.analysis.error_curves import near_extreme
from fenics_ehd.analysis.figure_errors import (
    CLOCK,
    CYCLE,
    acting_part,
    distance,
    extreme_column,
    mean_column,
    midpoints_added,
)
from fenics_ehd.cli.run import joint_lines
from fenics_ehd.multibody.figures import (
    ERROR_ITSELF,
    EXACT,
    POSITION,
    Figure,
    figures_of,
    numbers,
)
from fenics_ehd.multibody.summary import RunSummary
from fenics_ehd.multibody.trust import NOT_ESTIMATED

#: Figures of the reference: `machine` with 40 x 10 cells at a tolerance of 1e-5.
REFERENCE = Path(__file__).parent / "golden" / "figures-slider-crank.json"

#: Largest true error over its estimate, and relative true error below which it is not compared.
WITHIN = 2.0
CLEAR = 3e-3


def entries(history, budgets=None):
    return RunSummary(history.solved, budgets or {}).entries()


@pytest.fixture(scope="module")
def summary():
    history = ehd.simulate(machine((16, 4)), END, tolerance=1e-3)
    return entries(history, ehd.error_budget(history).joints)


def test_every_figure_has_an_error_or_a_reason(summary):
    joint = summary["joints"]["big_end"]
    assert set(joint["errors"]) == {name for name, _ in numbers(joint)}
    figures = {(figure.joint, figure.name): figure for figure in figures_of(summary)}
    for (owner, name), figure in figures.items():
        assert figure.known or figure.reason, name
        assert not figure.known or 0.0 <= figure.error < np.inf
        assert figure.value == (summary["joints"][owner] if owner else summary)[name]
    words = {"max_pressure_time_s": POSITION, "cycle_min_film_angle_deg": POSITION}
    assert {name: joint["errors"][name] for name in words} == words
    unknown = {figure.name for figure in figures.values() if figure.reason == NOT_ESTIMATED}
    assert not unknown
    assert figures["", "steps"].reason == EXACT
    assert figures["", "energy_balance_error"].reason == ERROR_ITSELF
    budget = joint["error_budget"]["max_pressure"]
    assert figures["big_end", "max_pressure_Pa"].relative == pytest.approx(budget["total"])


def test_errors_of_figures_are_the_true_ones(summary, figure):
    """The reference differs in tolerance and film mesh."""
    exact = json.loads(REFERENCE.read_text())
    ratios = {}
    for each in figures_of(summary):
        if each.known and each.joint:
            true = abs(each.value - exact[each.name])
            if true > CLEAR * abs(each.value):
                ratios[each.name] = true / each.error
    assert len(ratios) >= 5
    figure(
        "error budget",
        "all figures, true error over its estimate",
        max(ratios.values()),
        most=WITHIN,
    )
    assert max(ratios.values()) < WITHIN, ratios


def test_printed_figures_have_their_errors(summary):
    joint = summary["joints"]["big_end"]
    lines = "\n".join(joint_lines(joint))
    for name in ("cycle_mean_force_N", "cycle_max_eccentricity_ratio", "mean_friction_power_W"):
        (each,) = (one for one in figures_of(summary) if one.name == name)
        assert each.bound in lines
    without = {name: value for name, value in joint.items() if name not in ("errors",)}
    assert joint_lines(without)[2:] != joint_lines(joint)[2:]
    assert "+-" not in "\n".join(joint_lines(without)[2:])


@pytest.mark.parametrize(
    ("name", "value", "error", "reason", "bound"),
    [
        ("cycle_max_force_N", -200.0, 1.0, "", "+- 0.5 %"),
        ("orbit_1x_phase_deg", 30.0, 0.2, "", "+- 0.2 deg"),
        ("effective_temperature_C", 90.0, 0.25, "", "+- 0.25 C"),
        ("mean_contact_share", 0.0, 0.0, "", "+- 0"),
        ("max_pressure_time_s", 1e-3, None, POSITION, POSITION),
    ],
)
def test_text_of_an_error(name, value, error, reason, bound):
    assert Figure("pin", name, value, error, reason).bound == bound


def test_figures_without_a_budget_are_not_estimated():
    summary = {"joints": {"pin": {"max_pressure_Pa": 1e6, "max_pressure_time_s": 1e-3}}}
    assert [each.reason for each in figures_of(summary)] == [NOT_ESTIMATED, POSITION]


def test_extremes_are_known_by_their_columns():
    columns = ("max_pressure_Pa", "force_N", "min_lambda_ratio", "contact_share")
    assert extreme_column("cycle_max_force_N", columns) == "force_N"
    assert extreme_column("max_pressure_Pa", columns) == "max_pressure_Pa"
    assert extreme_column("cycle_min_lambda_ratio", columns) == "min_lambda_ratio"
    assert extreme_column("mean_contact_share", columns) is None
    values = np.array([0.0, 9.5, 10.0, 5.0])
    assert near_extreme(values, np.array([7.0, 3.0, 1.0, 7.0])) == pytest.approx(np.sqrt(5.0))


def test_a_mean_of_short_events_does_not_rely_on_cancellation():
    columns = ("contact_force_N", "force_N")
    assert mean_column("cycle_mean_force_N", columns) == "force_N"
    assert mean_column("cycle_max_force_N", columns) is None
    lengths = np.array([0.1, 0.2, 0.3, 0.4])
    assert acting_part(np.full(4, 3.0), lengths) == pytest.approx(1.0)
    assert acting_part(np.array([0.0, 5.0, 0.0, 0.0]), lengths) == pytest.approx(0.2)
    assert acting_part(np.zeros(4), lengths) == 1.0


def test_columns_between_steps_are_smooth():
    times = np.array([0.0, 1.0, 2.0, 4.0, 5.0, 6.0, 7.0, 8.0])
    columns = {
        "time_s": times,
        CYCLE: np.array([1.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0]),
        CLOCK: np.array([8.0, 1.0, 2.0, 4.0, 5.0, 6.0, 7.0, 8.0]),
        "line": 3.0 * times + 1.0,
        "unknown": np.full(8, np.nan),
    }
    finer = midpoints_added(columns)
    assert len(finer["time_s"]) == 15
    np.testing.assert_allclose(finer["time_s"][:7], [0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0])
    np.testing.assert_allclose(finer["line"], 3.0 * finer["time_s"] + 1.0)
    np.testing.assert_array_equal(finer[CYCLE][:3], [1.0, 2.0, 2.0])
    np.testing.assert_allclose(finer[CLOCK][:4], [8.0, 0.5, 1.0, 1.5])
    assert np.isnan(finer["unknown"]).all()


def test_amplitude_and_phase_of_an_orbit_share_their_errors():
    """A change across the orbit's part is one of its phase, but counts for its amplitude, too."""
    run = {"orbit_1x_amplitude_m": 2e-6, "orbit_1x_phase_deg": 179.0, "mean_force_N": 5.0}
    turned = {"orbit_1x_amplitude_m": 2e-6, "orbit_1x_phase_deg": -179.0, "mean_force_N": 4.0}
    across = 2e-6 * np.radians(2.0)
    assert distance("orbit_1x_amplitude_m", run, turned) == pytest.approx(0.5 * across, rel=1e-3)
    assert distance("orbit_1x_phase_deg", run, turned) == pytest.approx(2.0, rel=1e-3)
    assert distance("mean_force_N", run, turned) == 1.0
    assert np.isnan(distance("mean_flow_m3_per_s", {"mean_flow_m3_per_s": 1.0}, {}))
    resting = run | {"orbit_1x_amplitude_m": 0.0}
    assert distance("orbit_1x_phase_deg", resting, turned) == pytest.approx(91.0)
