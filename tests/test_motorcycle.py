"""The scene of the second tutorial, for a few degrees, with a rigid rod."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from command_line import exit_of
from csv_history import read_history

from fenics_ehd.base.extremes import over_time

PAGE = Path(__file__).parents[1] / "docs" / "tutorial-motorcycle.md"

#: In place of what takes a minute.
QUICK = {
    'method = "m4"': 'method = "rigid"',
    "cells = [40, 10]": "cells = [16, 3]",
    "periodic = true": "periodic = false",
    "revolutions = 2 ": "revolutions = 0.1 ",
    "tolerance = 1e-4": "tolerance = 1e-3",
    "periodicity = 1e-3": "",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The tutorial's files, quick to run, in the working directory."""
    monkeypatch.chdir(tmp_path)
    text = PAGE.read_text()
    for name in ("gas.csv", "motorcycle.toml"):
        (content,) = re.findall(
            rf"cat > {name} <<'END'\n(.*?)^END$", text, re.DOTALL | re.MULTILINE
        )
        for long, short in QUICK.items() if name.endswith(".toml") else ():
            assert content.count(long) == 1, long
            content = content.replace(long, short)
        (tmp_path / name).write_text(content)
    return tmp_path


def test_motorcycle_runs_from_an_empty_folder(folder, capfd):
    # Rigid, the rod is off by more than what a run is complete with.
    quick = "--no-plots", "--no-error-budget"
    status, message, errors = exit_of(capfd, "run", "motorcycle.toml", *quick, "-o", "answer")
    assert status == 0, errors
    assert "whole run: no full cycle, from 0.000 to 0.667 ms" in message
    assert re.search(r"thinnest of the run .* um  at .* deg of the bore, .* mm, crank", message)
    history = read_history(folder / "answer", "big_end")
    assert list(history)[:2] == ["time_s", "crank_angle_deg"]
    assert history["crank_angle_deg"][-1] == pytest.approx(36.0)
    summary = json.loads((folder / "answer" / "summary.json").read_text())
    largest_force = summary["joints"]["big_end"]["cycle_max_force_N"]
    between_steps, _ = over_time(history["time_s"], history["force_N"], None)
    assert largest_force == pytest.approx(between_steps, rel=1e-9)
    assert 0 < largest_force / np.max(history["force_N"]) - 1 < 0.005
    # 9000 rpm, the pin on a circle of half the stroke.
    assert summary["simulated_time_s"] == pytest.approx(0.1 / 150)
    assert history["rod.x_m"][-1] == pytest.approx(0.0275 * np.cos(np.radians(36)), abs=25e-6)
    status, _, errors = exit_of(capfd, "run", "motorcycle.toml", "--multiplier", "-o", "again")
    assert status == 2
    assert "--multiplier: scene motorcycle has no periodic solution" in errors


@pytest.mark.slow
def test_clearances_of_a_sweep_have_units(folder, capfd):
    key = "joints.big_end.clearance"
    status, _, errors = exit_of(
        capfd, "sweep", "motorcycle.toml", "--set", f"{key}=20 um,30 um", "-o", "c"
    )
    assert status == 0, errors
    rows = (folder / "c" / "sweep.csv").read_text().splitlines()
    assert [row.split(",")[1] for row in rows] == [key, "2e-05", "3e-05"]
    films = [float(row.split(",")[4]) for row in rows[1:]]
    assert films[0] != films[1]
