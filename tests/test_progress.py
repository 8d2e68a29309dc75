"""Progress of long work: its text, where it is shown, and what opens stages."""

import os
import pty
import re
import subprocess
import sys

import pytest

import fenics_ehd as ehd
from fenics_ehd.base import progress as progress_module
from fenics_ehd.base.processes import RANKS
from fenics_ehd.base.progress import (
    SILENT,
    Progress,
    duration,
    read_progress,
    shown_progress,
    written_progress,
)
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run


@pytest.fixture
def clock(monkeypatch):
    """Time in seconds, which only the test advances."""
    now = [100.0]
    monkeypatch.setattr(progress_module, "monotonic", lambda: now[0])
    return now


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.4, "0 s"), (59.4, "59 s"), (65.0, "1 min 05 s"), (7620.0, "2 h 07 min")],
)
def test_durations_are_readable(seconds, text):
    assert duration(seconds) == text


def test_the_time_left_is_that_of_the_present_rate(clock):
    texts = []
    with Progress(texts.append).stage("solves", 200) as stage:
        clock[0] += 3.0
        stage.to(50, "first bore")
        clock[0] += 0.1
        stage.to(60)  # too early to be shown
    assert texts == ["solves: 0 %, 0 of 200", "solves: 25 %, 9 s left, 50 of 200, first bore"]


def test_a_round_begins_anew_and_a_resumed_stage_counts_its_own_work(clock):
    texts = []
    with Progress(texts.append, interval=0.0).stage("run", 40.0, "ms", done=20.0) as stage:
        clock[0] += 5.0
        stage.to(30.0)
        stage.to(1.0, "cycle 2")  # the next cycle of the run
        clock[0] += 1.0
        stage.to(11.0, "cycle 2")
    assert texts[1:] == [
        "run: 75 %, 5 s left, 30 of 40 ms",
        "run: 2 %, 1 of 40 ms, cycle 2",
        "run: 28 %, 3 s left, 11 of 40 ms, cycle 2",
    ]


def test_stages_within_stages_and_unknown_amounts(clock):
    texts = []
    ends = []
    progress = Progress(texts.append, ends.append)
    with progress.stage("rod"):
        clock[0] += 2.0
        with progress.stage("mesh"):
            clock[0] += 1.0
    assert texts == ["rod", "rod: 2 s - mesh"]
    assert ends == ["rod: 3 s"]


def test_logs_have_lines_only_of_long_work_and_ranks_but_the_first_none(clock, monkeypatch, capfd):
    for name in RANKS:
        monkeypatch.delenv(name, raising=False)
    assert shown_progress() is SILENT  # of a program whose output is no terminal
    with shown_progress(logs=True).stage("solves", 100) as stage:
        for done in range(100):
            clock[0] += 0.25
            stage.to(done)
    lines = capfd.readouterr().err.splitlines()
    assert lines == [
        "progress: solves: 39 %, 16 s left, 39 of 100",
        "progress: solves: 79 %, 5 s left, 79 of 100",
    ]
    monkeypatch.setenv("OMPI_COMM_WORLD_RANK", "1")
    assert shown_progress(logs=True) is SILENT


def in_terminal(code):
    """Standard error of a program whose standard error is a real terminal."""
    try:
        master, terminal = pty.openpty()
    except OSError as error:
        pytest.skip(f"this system gives no terminal: {error}")
    environment = {name: value for name, value in os.environ.items() if name not in RANKS}
    subprocess.run([sys.executable, "-c", code], stderr=terminal, check=True, env=environment)
    os.close(terminal)
    text = os.read(master, 4096).decode()
    os.close(master)
    return text


def test_a_line_of_a_terminal_is_rewritten_and_removed():
    """The cursor stays at the start of the line."""
    text = in_terminal(
        "from fenics_ehd.base.progress import shown_progress\n"
        "with shown_progress().stage('solves', 2) as stage:\n"
        "    stage.to(1)\n"
    )
    assert text == f"solves: 0 %, 0 of 2\r{' ' * 19}\r"


def test_a_warning_replaces_a_line_of_progress():
    """Nothing of a longer line remains behind a warning."""
    text = in_terminal(
        "from fenics_ehd.base.progress import shown_progress\n"
        "from fenics_ehd.cli.options import warn_of\n"
        "with shown_progress().stage('a long name of a stage', 2) as stage:\n"
        "    warn_of(['low'])\n"
    )
    line, warning, _ = re.split("\r\n?", text, maxsplit=2)
    assert line == "a long name of a stage: 0 %, 0 of 2"
    assert warning.rstrip() == "fenics-ehd: warning: low"
    assert len(warning) > len(line)


def test_a_program_without_standard_error_is_silent(monkeypatch):
    monkeypatch.setattr(sys, "stderr", None)
    progress_module.say("low")


def test_a_note_is_made_only_for_a_line_that_is_shown():
    """A run has thousands of steps, of which a line shows few or none."""
    made = []

    def note():
        made.append(1)
        return "p 3 MPa"

    with SILENT.stage("run", 4) as stage:
        stage.to(1, note)
    assert not made
    texts = []
    with Progress(texts.append, interval=1e3).stage("run", 4) as stage:
        stage.to(1, note)
    assert not made
    with Progress(texts.append, interval=0.0).stage("run", 4) as stage:
        stage.to(1, note)
    assert texts[-1] == "run: 25 %, 1 of 4, p 3 MPa"
    assert len(made) == 1


def test_workers_write_to_a_file_that_their_parent_reads(tmp_path):
    path = tmp_path / "reference"
    assert read_progress(path) == ""
    with written_progress(path).stage("run", 2.0, "ms"):
        assert read_progress(path) == "run: 0 %, 0 of 2 ms"
    assert written_progress(None) is SILENT


def test_a_part_shows_the_stages_of_its_mesh_and_reduction():
    texts = []
    progress = Progress(texts.append, interval=0.0)
    scene = ehd.read_scene(
        "slider-crank-paper",
        **{
            "bodies.rod.geometry": {"bore_cells_around": 10, "bore_cells_along": 2},
            "bodies.rod.reduction.method": "m4",
            "joints.big_end.cells": [10, 2],
            "output.error_budget": False,
        },
    )
    ehd.build(scene, cache=False, progress=progress)
    stages = {part.partition(":")[0] for text in texts for part in text.split(" - ")}
    assert {"rod", "mesh", "matrices", "static solves", "masses of patterns"} <= stages
    assert any(name.endswith("vibration modes") for name in stages)
    assert any("factorisation" in name for name in stages)


def test_a_run_and_its_error_budget_show_how_far_they_are():
    changes = {"time.periodic": False, "time.revolutions": 0.005}
    machine = ehd.build(ehd.read_scene("loaded-journal", **changes))
    texts = []
    steps = []
    recorder = Recorder(Run(machine.mechanism, machine.steps, machine.end), machine.end)
    with recorder.shown(Progress(texts.append, interval=0.0), "loaded-journal") as show:
        for step, _ in recorder.steps():
            steps.append(step)
            show(step)
    pattern = rf"loaded-journal: 100 %, .*, step {len(steps)}, p [0-9.]+ MPa"
    assert re.fullmatch(pattern, texts[-1]), texts[-1]
    history = ehd.simulate(machine.mechanism, **machine.options, progress=steps.append)
    assert len(steps) == 2 * len(history)
    texts.clear()
    ehd.error_budget(history, progress=Progress(texts.append, interval=0.0))
    assert any(re.match(r"error budget: 0 %, .* - replay: \d+ %", text) for text in texts)
    assert any(re.match(r"error budget: .*, film mesh - replay: ", text) for text in texts)
