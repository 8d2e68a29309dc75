"""``fenics-ehd run loaded-journal`` as a user meets it."""

import json
import signal
import subprocess
import sys
import time
import tomllib

import numpy as np
import pytest
from interrupt_case import interrupted_run, rows_in

from fenics_ehd.cli import main
from fenics_ehd.output import read_fields, read_history
from fenics_ehd.scenes.loaded_journal_settings import LoadedJournalSettings
from fenics_ehd.settings import build

COMMAND = [sys.executable, "-m", "fenics_ehd.cli"]

SHORT = """
scene = "loaded-journal"
[load]
file = "load.csv"
[film]
cells = [12, 2]
[time]
tolerance = 1e-3
largest_step = 0.1
periodicity = 1e-3
"""
LOAD_FILE = "time_ms,Fx_N,Fy_N\n0,500,900\n5,0,500\n10,-500,900\n15,0,1200\n20,500,900\n"


def call(*arguments, **options):
    return subprocess.run(
        [*COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=300, **options
    )


def exit_of(capfd, *arguments):
    """Status and error output of the command, in this process."""
    with pytest.raises(SystemExit) as end:
        main([*map(str, arguments)])
    return end.value.code, capfd.readouterr().err


@pytest.fixture
def scene_file(tmp_path):
    path = tmp_path / "short.toml"
    path.write_text(SHORT)
    (tmp_path / "load.csv").write_text(LOAD_FILE)
    return path


def test_run_writes_everything_it_promises(scene_file, tmp_path, capfd):
    result = call("run", scene_file, "-o", tmp_path / "out", "--json")
    assert result.returncode == 0, result.stderr
    summary = json.loads(result.stdout)
    assert summary == json.loads((tmp_path / "out" / "summary.json").read_text())
    promised = {
        "max_pressure_Pa", "max_pressure_time_s", "min_film_thickness_m",
        "min_film_thickness_time_s", "max_eccentricity_ratio", "periodicity_defect", "cycles",
        "steps", "newton_iterations", "film_solves", "basis_error_estimate_m",
        "energy_balance_error", "modes", "method", "status", "reduction_time_s", "wall_time_s",
        "versions",
    }  # fmt: skip
    assert promised <= set(summary)
    assert summary["status"] == "complete"
    assert summary["method"] == "rigid"
    assert summary["period_s"] == pytest.approx(0.02)
    assert summary["periodicity_defect"] <= 1e-3
    history = read_history(tmp_path / "out")
    assert len(history["time_s"]) == summary["steps"]
    assert history["cycle"][-1] == summary["cycles"]
    assert history["time_s"][-1] == pytest.approx(0.02 * summary["cycles"])
    last = history["cycle"] == summary["cycles"]
    assert last.sum() == summary["cycle_steps"]
    assert history["max_pressure_Pa"][last].max() == pytest.approx(summary["max_pressure_Pa"])
    assert (tmp_path / "out" / "orbit.png").stat().st_size > 1000
    status, errors = exit_of(capfd, "plot", tmp_path / "out", "-o", tmp_path / "pictures")
    assert status == 0, errors
    assert (tmp_path / "pictures" / "orbit.svg").exists()


def test_scene_that_a_run_leaves_is_that_run(scene_file, tmp_path, capfd):
    first, again = tmp_path / "first", tmp_path / "elsewhere" / "again"
    assert exit_of(capfd, "run", scene_file, "-o", first, "--no-plots")[0] == 0
    assert exit_of(capfd, "run", first / "scene.toml", "-o", again, "--no-plots")[0] == 0
    assert (again / "history.csv").read_text() == (first / "history.csv").read_text()


def test_init_prints_the_scene():
    result = call("init", "loaded-journal")
    assert result.returncode == 0, result.stderr
    assert build(LoadedJournalSettings, tomllib.loads(result.stdout)) == LoadedJournalSettings()


def test_orbit_that_does_not_repeat_exits_1(scene_file, tmp_path, capfd):
    scene_file.write_text(SHORT + "cycles = 1\n")
    status, errors = exit_of(capfd, "run", scene_file, "-o", tmp_path / "out", "--no-plots")
    assert status == 1
    assert "PeriodicityError: after time.cycles = 1 cycles" in errors.splitlines()[-1]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["status"].startswith("failed: after time.cycles = 1")


@pytest.mark.parametrize(
    ("text", "arguments", "named"),
    [
        (SHORT.replace("load.csv", "absent.csv"), [], "absent.csv"),
        (SHORT, ["--method", "m3"], "--method"),
    ],
    ids=["load", "method"],
)
def test_bad_scene_exits_2_with_one_line(text, arguments, named, scene_file, tmp_path, capfd):
    scene_file.write_text(text)
    status, errors = exit_of(capfd, "run", scene_file, "-o", tmp_path / "out", *arguments)
    assert status == 2
    assert "Traceback" not in errors
    assert named in errors.splitlines()[-1]


def test_interrupt_keeps_what_was_computed(scene_file, tmp_path):
    scene_file.write_text(SHORT.replace("1e-3", "1e-7"))
    interrupted_run([*COMMAND, "run", str(scene_file)], tmp_path / "out")


OIL = SHORT.replace(
    "[12, 2]",
    """[24, 2]
element = "bilinear"
cavitation = "mass-conserving"
[bearing]
grooves = [[180.0, 30.0, 2e5]]""",
).replace("1e-3", "1e-2")


@pytest.mark.parametrize(
    "text", [SHORT, pytest.param(OIL, marks=pytest.mark.slow)], ids=["film", "oil"]
)
@pytest.mark.slow
def test_a_killed_run_goes_on_to_the_same_result(text, scene_file, tmp_path, capfd):
    scene_file.write_text(text)
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert exit_of(capfd, "run", scene_file, "-o", whole, "--no-plots")[0] == 0
    lines = (whole / "history.csv").read_bytes().splitlines(keepends=True)
    cycles = list(read_history(whole)["cycle"])
    command = ["run", str(scene_file), "-o", str(killed), "--no-plots", "--checkpoint-every", "0"]
    # Within the first cycle, and in the next one.
    for rows in (7, cycles.index(2) + 3):
        process = subprocess.Popen([*COMMAND, *command], stderr=subprocess.DEVNULL)
        while rows_in(killed) <= rows and process.poll() is None:
            time.sleep(1e-3)
        process.kill()
        assert process.wait() == -signal.SIGKILL
        (run,) = killed.glob(".run-*")
        before = (run / "history.csv").read_bytes()
        assert b"".join(lines).startswith(before[: before.rfind(b"\n") + 1])
        command = ["run", "--resume", str(killed), "--no-plots", "--checkpoint-every", "0"]
    assert exit_of(capfd, *command)[0] == 0
    assert (killed / "history.csv").read_bytes() == b"".join(lines)
    names = ("eccentricity_m", "eccentricity_rate_m_per_s", "pressure_Pa")
    for name, values in read_fields(killed, names).items():
        np.testing.assert_array_equal(values, read_fields(whole, (name,))[name])
    ours, theirs = (json.loads((f / "summary.json").read_text()) for f in (killed, whole))
    for key in set(theirs) - {"wall_time_s", "versions"}:
        assert ours[key] == theirs[key], key
