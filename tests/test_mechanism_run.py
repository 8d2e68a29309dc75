"""Scenes of bodies and joints from the command line: results, cycles, runs that go on."""

import json
import signal
from functools import partial

import numpy as np
import pytest
from command_line import assert_same_results, call, start, stop_after
from csv_history import read_history
from mpi4py import MPI
from scene_cases import RIGID_ROD, tables_of

from fenics_ehd import load_results
from fenics_ehd.base.output import to_json
from fenics_ehd.multibody import run as run_module
from fenics_ehd.multibody.simulation import simulate
from fenics_ehd.multibody.step_solver import CoupledSteps
from fenics_ehd.scenes.build import build_mechanism
from fenics_ehd.scenes.scene_file import scene_of, shipped

#: Rows over the crank's angle, beside the scene.
PUSH = "angle_deg,force_N\n0,0\n90,40\n180,0\n270,-40\n360,0\n"


def four_bar(folder, time, force=False):
    """The shipped linkage for another time."""
    text = shipped("four-bar")
    text = text[: text.index("[time]")] + f"[time]\n{time}\n"
    if force:
        (folder / "push.csv").write_text(PUSH)
        text += (
            '[forces.push]\nkind = "angle-table"\npoint = "rocker.tip"\nfile = "push.csv"\n'
            'angle_of = "crank"\n'
        )
    (folder / "scene.toml").write_text(text)
    return folder / "scene.toml"


def command(scene, target, every=0):
    return ("run", scene, "--no-plots", "--checkpoint-every", every, "-o", target)


def test_a_run_leaves_history_summary_and_scene(tmp_path, capsys):
    scene = four_bar(tmp_path, "end = 2e-3", force=True)
    target = tmp_path / "out"
    assert call(*command(scene, target), "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    summary = json.loads((target / "summary.json").read_text())
    assert printed == summary
    assert summary["status"] == "complete"
    history = read_history(target)
    assert len(history["time_s"]) == summary["steps"]
    assert history["max_pressure_Pa"].max() == pytest.approx(summary["max_pressure_Pa"], rel=1e-9)
    assert history["min_film_thickness_m"].min() == pytest.approx(
        summary["min_film_thickness_m"], rel=1e-9
    )
    # The crank turns at 100 rad/s from angle zero.
    assert history["crank.angle_rad"] == pytest.approx(100.0 * history["time_s"], abs=1e-9)
    # The scene it leaves runs again, its table found from anywhere, to the same last bit.
    again = tmp_path / "again"
    assert call(*command(target / "scene.toml", again)) == 0
    assert (target / "history.csv").read_bytes() == (again / "history.csv").read_bytes()


@pytest.mark.slow
def test_a_periodic_run_keeps_its_last_cycle(tmp_path):
    scene = four_bar(
        tmp_path, "revolutions = 1\nperiodic = true\nperiodicity = 0.5\ntolerance = 1e-3"
    )
    assert call(*command(scene, tmp_path / "out")) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    history = read_history(tmp_path / "out")
    assert summary["cycles"] > 1
    assert summary["periodicity_defect"] <= 0.5
    assert set(history["cycle"]) == {summary["cycles"]}
    assert history["cycle_time_s"][0] == 0.0
    assert np.all(np.diff(history["cycle_time_s"]) > 0)
    (joint,) = load_results(tmp_path / "out").joints.values()
    assert joint.film.pressure.max(axis=1) == pytest.approx(history["max_pressure_Pa"], rel=1e-7)
    assert history["max_pressure_Pa"].max() == pytest.approx(summary["max_pressure_Pa"], rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("time", "rows"),
    [
        ("end = 4e-3\ntolerance = 1e-7", 20),
        # 77 steps a cycle: killed in the second and last one.
        ("revolutions = 1\nperiodic = true\nperiodicity = 0.01\ntolerance = 1e-3", 100),
    ],
    ids=["once", "periodic"],
)
def test_a_killed_run_goes_on_to_the_last_bit(tmp_path, time, rows):
    scene = four_bar(tmp_path, time, force=True)
    assert call(*command(scene, tmp_path / "whole")) == 0
    target = tmp_path / "killed"
    process = start(command(scene, target))
    assert stop_after(process, target, rows, signal.SIGKILL) == -signal.SIGKILL
    assert call("run", "--no-plots", "--resume", target) == 0
    assert_same_results(target, tmp_path / "whole")


def test_a_changed_table_is_refused_on_resume(tmp_path, capsys):
    scene = four_bar(tmp_path, "end = 4e-3\ntolerance = 1e-7", force=True)
    target = tmp_path / "killed"
    process = start(command(scene, target))
    stop_after(process, target, 20, signal.SIGKILL)
    (tmp_path / "push.csv").write_text(PUSH.replace("40", "41"))
    assert call("run", "--no-plots", "--resume", target) == 2
    assert "push.csv changed since the run began" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("four-bra",), "four-bar"),
        (("four-bar", "--body", "x.h5"), "--body"),
    ],
)
def test_what_cannot_run_is_refused_in_one_line(tmp_path, capsys, arguments, message):
    assert call("run", *arguments, "-o", tmp_path / "out") == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert message in lines[0]
    assert not (tmp_path / "out").exists()


def test_init_prints_a_scene_of_bodies(capsys):
    assert call("init", "engine") == 0
    assert capsys.readouterr().out == shipped("engine")


def test_numbers_that_are_none_are_null_at_any_depth():
    text = to_json({"joints": {"main": {"estimate": float("nan"), "film": 1e-6}}, "x": np.inf})
    assert json.loads(text) == {"joints": {"main": {"estimate": None, "film": 1e-6}}, "x": None}


@pytest.mark.parametrize("element", ["serendipity", "bilinear"])
@pytest.mark.parametrize("dense_limit", [700, 0])
def test_films_of_all_elements_agree(element, dense_limit, monkeypatch):
    """8-node films weigh what is left of their equations, bilinear ones are coarser."""
    monkeypatch.setattr(run_module, "CoupledSteps", partial(CoupledSteps, dense_limit=dense_limit))
    peaks = {}
    for name in ("lagrange", element):
        changes = RIGID_ROD | {"joints.big_end.element": name, "joints.big_end.cells": [20, 5]}
        scene = scene_of(tables_of("slider-crank-paper", changes), name)
        mechanism = build_mechanism(scene, MPI.COMM_SELF).mechanism
        result = simulate(mechanism, 4e-6, tolerance=1e-3)
        assert result.rejected_steps == 0
        peaks[name] = result.joints["big_end"].max_pressure[-1]
    assert peaks[element] == pytest.approx(peaks["lagrange"], rel=5e-3)
