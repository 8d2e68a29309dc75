"""Scenes of bodies and joints from the command line: results, cycles, runs that go on."""

import json

import numpy as np
import pytest
from command_line import call
from csv_history import read_history
from scene_cases import write_scene

from fenics_ehd.base.extremes import over_time
from fenics_ehd.base.files import to_json
from fenics_ehd.scenes.library import shipped

#: Rows over the crank's angle, in the folder of the scene.
PUSH = "angle_deg,force_N\n0,0\n90,40\n180,0\n270,-40\n360,0\n"


def test_a_run_leaves_history_summary_and_scene(tmp_path, capsys):
    (tmp_path / "push.csv").write_text(PUSH)
    push = {"kind": "angle-table", "point": "rocker.tip", "file": "push.csv", "angle_of": "crank"}
    changes = {"forces.push": push, "time": {"end": 2e-3}}
    scene, target = write_scene(tmp_path / "scene.toml", "four-bar", changes), tmp_path / "out"
    options = "--no-plots", "--no-error-budget", "-o"
    assert call("run", scene, *options, target, "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    summary = json.loads((target / "summary.json").read_text())
    assert printed == summary
    assert summary["status"] == "complete"
    history, entries = read_history(target, "rocker_end"), summary["joints"]["rocker_end"]
    assert len(history["time_s"]) == summary["steps"]
    for column, sign in (("max_pressure_Pa", 1), ("min_film_thickness_m", -1)):
        value = over_time(history["time_s"], history[column], None, sign)[0]
        assert entries[column] == pytest.approx(value, rel=1e-8)
    # The crank turns at 100 rad/s from angle zero.
    assert history["crank.angle_rad"] == pytest.approx(100.0 * history["time_s"], abs=1e-9)
    # The scene it leaves runs again, its table found from anywhere, to the same last bit.
    again = tmp_path / "again"
    assert call("run", target / "scene.toml", *options, again) == 0
    assert (target / "history.csv").read_bytes() == (again / "history.csv").read_bytes()


def test_init_prints_a_scene_of_bodies(capsys):
    assert call("init", "engine") == 0
    assert capsys.readouterr().out == shipped("engine")


def test_numbers_that_are_none_are_null_at_any_depth():
    text = to_json({"joints": {"main": {"estimate": float("nan"), "film": 1e-6}}, "x": np.inf})
    assert json.loads(text) == {"joints": {"main": {"estimate": None, "film": 1e-6}}, "x": None}
