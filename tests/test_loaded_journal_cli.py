"""``fenics-ehd run`` of a loaded journal, a periodic solution, as a user meets it."""

import json

import numpy as np
import pytest
from command_line import COMMAND, exit_of, program
from csv_history import read_history
from interrupt_case import interrupted_run
from scene_cases import LOADED_JOURNAL, write_scene

from fenics_ehd.multibody.energy import SIGNS


@pytest.fixture
def scene(tmp_path):
    def write(**changes):
        changes = {key.replace("__", "."): value for key, value in changes.items()}
        return write_scene(tmp_path / "short.toml", "loaded-journal", LOADED_JOURNAL, changes)

    return write


def test_run_writes_everything_it_promises(scene, tmp_path):
    result = program("run", scene(), "-o", tmp_path / "out", "--json")
    assert result.returncode == 0, result.stderr
    summary = json.loads(result.stdout)
    assert summary == json.loads((tmp_path / "out" / "summary.json").read_text())
    promised = {
        "max_pressure_Pa", "max_pressure_time_s", "min_film_thickness_m",
        "min_film_thickness_time_s", "periodicity_defect", "cycles", "steps", "newton_iterations",
        "basis_error_estimate_m", "energy_balance_error", "modes", "method", "status",
        "reduction_time_s", "wall_time_s", "processor_time_s", "versions",
    }  # fmt: skip
    assert promised <= set(summary)
    assert summary["status"] == "complete"
    assert (summary["method"], summary["modes"]) == ("rigid", 0)
    assert summary["periodicity_defect"] <= 1e-3
    # What is kept is the last cycle, and the figures are its alone.
    history = read_history(tmp_path / "out")
    assert set(history["cycle"]) == {summary["cycles"]}
    assert len(history["time_s"]) < summary["steps"]
    assert history["time_s"][-1] == pytest.approx(0.02 * summary["cycles"])
    # Both its ends: what it does over the cycle is a difference of its last row and its first.
    assert history["cycle_time_s"][0] == 0.0
    assert history["cycle_time_s"][-1] == pytest.approx(0.02)
    gained = {n: history[f"{n}_work_J"][-1] - history[f"{n}_work_J"][0] for n in SIGNS}
    balance = sum(sign * gained[name] for name, sign in SIGNS.items())
    assert abs(balance) < 1e-3 * gained["film"]
    for name in ("force_x_N", "eccentricity_x_m", "kinetic_energy_J"):
        assert history[name][0] == history[name][-1]
    assert history["max_pressure_Pa"].max() == pytest.approx(summary["max_pressure_Pa"])
    assert history["min_film_thickness_m"].min() == pytest.approx(summary["min_film_thickness_m"])
    # The film carries the load: at 10 ms it is (-500, 900) N.
    at = int(np.argmin(np.abs(history["cycle_time_s"] - 10e-3)))
    force = history["force_x_N"][at], history["force_y_N"][at]
    assert np.hypot(*force) == pytest.approx(np.hypot(500, 900), rel=0.05)
    pictures = {path.name for path in (tmp_path / "out").glob("*.png")}
    assert {"max_pressure.png", "min_film_thickness.png"} <= pictures


def test_scene_that_a_run_leaves_is_that_run(scene, tmp_path, capfd):
    first, again = tmp_path / "first", tmp_path / "elsewhere" / "again"
    assert exit_of(capfd, "run", scene(), "-o", first, "--no-plots")[0] == 0
    assert exit_of(capfd, "run", first / "scene.toml", "-o", again, "--no-plots")[0] == 0
    assert (again / "history.csv").read_text() == (first / "history.csv").read_text()


def test_films_that_do_not_repeat_exit_1(scene, tmp_path, capfd):
    path = scene(time__cycles=1)
    status, _, errors = exit_of(capfd, "run", path, "-o", tmp_path / "out", "--no-plots")
    assert status == 1
    assert "PeriodicityError: after cycles = 1 of 0.02 s" in errors.splitlines()[-1]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["status"].startswith("failed: after cycles = 1")


@pytest.mark.parametrize(
    ("changes", "arguments", "named"),
    [
        ({"forces__load__file": "absent.csv"}, [], "absent.csv"),
        ({"forces__load__file": "main-baering"}, [], "main-bearing"),
        ({"time__period": 0.0}, [], "give time.period or time.revolutions"),
        ({}, ["--method", "m3"], "--method m3: scene short has no model to reduce"),
        ({}, ["--body", "rod.h5"], "has 0 flexible bodies, not one"),
    ],
    ids=["load", "table", "period", "method", "body"],
)
def test_bad_scene_exits_2_with_one_line(changes, arguments, named, scene, tmp_path, capfd):
    path = scene(**changes)
    status, _, errors = exit_of(capfd, "run", path, "-o", tmp_path / "out", *arguments)
    assert status == 2
    assert "Traceback" not in errors
    assert named in errors.splitlines()[-1]


def test_interrupt_keeps_what_was_computed(scene, tmp_path):
    interrupted_run([*COMMAND, "run", str(scene(time__tolerance=1e-7))], tmp_path / "out")
