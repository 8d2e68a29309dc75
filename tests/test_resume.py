"""Runs that stop and go on: killed at any moment, the result is that of an undisturbed run."""

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections import deque
from contextlib import closing
from dataclasses import replace
from functools import partial
from itertools import islice

import numpy as np
import pytest
from command_line import (
    assert_same_results,
    call,
    killed_again_and_again,
    program,
    rows_in,
    start,
    stop_after,
)
from csv_history import read_history
from hand_made_rod import Joint, make_body
from mechanism_cases import film, rigid_rod, slider_crank
from scene_cases import LOADED_JOURNAL, ROD_OF_A_FILE, write_scene

import fenics_ehd as ehd
from fenics_ehd.base.files import claim, listed
from fenics_ehd.base.layout import Group
from fenics_ehd.base.sealed_file import digest
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.history import fixed
from fenics_ehd.multibody.periodic import PeriodicSolver
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.results.recorded_run import CsvFile, load_run_state, recorded_steps, save_run_state

#: Changes of a short run of a journal, by the model whose state it carries.
MODELS = {
    "heated": {
        "lubricants.oil": {"grade": "ISO VG 46"},
        "joints.bearing.heat": {"supply_temperature": 70.0},
    },
    "rough": {
        "joints.bearing.contact": {
            "journal_roughness": 0.8e-6, "bore_roughness": 0.8e-6, "asperity_product": 0.04,
            "asperity_slenderness": 1e-3, "bore_modulus": 210e9,
        },
    },
    "starved": {
        "joints.bearing.element": "bilinear",
        "joints.bearing.cavitation": "mass-conserving",
    },
}  # fmt: skip

#: Error budgets of runs that go on are in the slow test of periodic ones.
TIMES = {"time.revolutions": 0.03, "time.tolerance": 1e-8, "output.error_budget": False}


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """Folder with a scene, a body and the results of an undisturbed run."""
    folder = tmp_path_factory.mktemp("resume")
    write_scene(folder / "press.toml", "slider-crank-paper", ROD_OF_A_FILE, TIMES)
    ehd.save_body(make_body(Joint()), folder / "rod.h5")
    assert call(*command(folder, "whole")) == 0
    return folder


def command(folder, name, every=0, scene="press.toml"):
    return ("run", folder / scene, "--no-plots", "--checkpoint-every", every, "-o", folder / name)


@pytest.mark.slow
@pytest.mark.parametrize("every", [0, 1000])
def test_a_killed_run_goes_on_to_the_same_result(prepared, every):
    folder, whole = prepared / f"killed_{every}", prepared / "whole"
    resume = ("run", "--resume", folder, "--no-plots", "--checkpoint-every", every)
    moments = iter((15, 45))
    for run in killed_again_and_again(
        folder, command(prepared, folder.name, every), resume, (15, 45)
    ):
        assert not (run / "summary.json").exists()
        # What was written can be read, and stays.
        assert len(read_history(run)["time_s"]) >= next(moments) - 2
        assert_beginning(run, whole)
    assert_same_results(folder, whole)
    assert {path.name for path in folder.iterdir()} <= {*listed(folder), "manifest.txt"}


def steps_of(folder):
    """Steps up to the checkpoint of a run."""
    return load_run_state(folder).state["counts"]["steps"]


@pytest.mark.parametrize(
    "how",
    [
        signal.SIGINT,
        pytest.param(signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param(signal.SIGHUP, marks=pytest.mark.slow),
        pytest.param(signal.SIGPIPE, marks=pytest.mark.slow),
    ],
    ids=lambda how: how.name,
)
def test_a_run_that_a_signal_ends_goes_on_to_the_same_result(how, prepared):
    folder = prepared / how.name
    process = start(command(prepared, folder.name, 1000), stderr=subprocess.PIPE, text=True)
    assert stop_after(process, folder, 20, how) == 130
    message = process.stderr.read()
    assert "Traceback" not in message
    assert "PETSC" not in message
    assert message.splitlines()[-1] == "fenics-ehd: interrupted"
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["status"] == "interrupted"
    # Its last step, for any interval.
    assert steps_of(folder) == len(read_history(folder)["time_s"]) == summary["steps"]
    # Files made from the former run are removed, unknown files stay.
    names = ("max_pressure-big_end.png", "animation.gif", "stress.json")
    made = [folder / name for name in names]
    claim(folder, names)
    for path in (*made, folder / "mine.png"):
        path.write_bytes(b"")
    assert call("run", "--resume", folder, "--no-plots") == 0
    assert not any(path.exists() for path in made)
    (folder / "mine.png").unlink()
    assert_same_results(folder, prepared / "whole")


@pytest.mark.slow
def test_a_run_ends_when_nobody_reads_what_it_says(prepared):
    folder = prepared / "unread"
    # Long enough for the bar to be drawn again on any machine.
    write_scene(
        prepared / "long.toml", "slider-crank-paper", ROD_OF_A_FILE, TIMES, {"time.revolutions": 1}
    )
    read, write = os.pipe()
    # The bar is drawn as often as on a terminal, which a pipe is not.
    code = (
        "import sys; sys.stderr.isatty = lambda: True\nfrom fenics_ehd.cli.main import main; main()"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, *map(str, command(prepared, "unread", 10, "long.toml"))],
        stderr=write,
    )
    os.close(write)
    while rows_in(folder) < 20 and process.poll() is None:
        os.read(read, 4096)
    os.close(read)
    assert process.wait(timeout=60) == 130
    assert json.loads((folder / "summary.json").read_text())["status"] == "interrupted"


@pytest.mark.parametrize("name", ["click", "petsc4py"])
def test_ctrl_c_during_imports_is_no_traceback(name, prepared):
    """Sent when a module is looked for, where other modules make an ImportError of it."""
    folder = prepared / f"import_{name}"
    code = f"""if True:
        import os, signal, sys
        class Interrupting:
            def find_spec(name, path, target=None):
                if name == {name!r}:
                    os.kill(os.getpid(), signal.SIGINT)
        sys.meta_path.insert(0, Interrupting)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        from fenics_ehd.cli.main import main
        main()"""
    arguments = map(str, command(prepared, folder.name))
    found = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, timeout=60
    )
    assert (found.returncode, found.stderr) == (130, "fenics-ehd: interrupted\n")


def assert_one_line(found, folder):
    assert found.returncode == 1, found.stderr
    assert "Traceback" not in found.stderr
    line = found.stderr.splitlines()[-1]
    assert line.startswith(f"fenics-ehd: OutputError: {folder}/")
    assert line.endswith(("File too large", "No space left on device"))


def assert_beginning(folder, whole):
    """The table in a folder has the first rows of that of the whole run.

    It lacks the columns that are computed when a run has ended.
    """
    text = (folder / "history.csv").read_text()
    beginning, complete = (
        list(csv.DictReader(lines.splitlines()))
        for lines in (text[: text.rfind("\n") + 1], (whole / "history.csv").read_text())
    )
    assert beginning
    for row, same in zip(beginning, complete, strict=False):
        assert row.items() <= same.items()


def assert_ends_in_order_and_goes_on(found, folder, whole, make_room=lambda: None):
    """One line names a file, no crash; what was written is the beginning of the whole run."""
    assert_one_line(found, folder)
    assert_beginning(folder, whole)
    found, undisturbed = ehd.load_history(folder), ehd.load_history(whole)
    assert len(found) >= steps_of(folder) > 0
    for name, values in found.values.items():
        if not fixed(name):
            np.testing.assert_array_equal(values, undisturbed.values[name][: len(found)])
    make_room()
    assert call("run", "--resume", folder, "--no-plots") == 0
    assert_same_results(folder, whole)


@pytest.mark.slow
def test_a_run_whose_files_may_not_grow_ends_in_order_and_goes_on(prepared):
    """As on a disk that is full; without room for its first files it leaves nothing."""

    def limited(size):
        # After MPI has begun, which has files of its own.
        code = f"""if True:
            import mpi4py.MPI, resource
            resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))
            from fenics_ehd.cli.main import main
            main()"""
        arguments = map(str, command(prepared, f"limited_{size}", 0.05))
        found = subprocess.run(
            [sys.executable, "-c", code, *arguments], capture_output=True, text=True, timeout=120
        )
        return found, prepared / f"limited_{size}"

    found, folder = limited(30_000)
    assert_one_line(found, folder)
    assert not folder.exists()
    found, folder = limited(250_000)
    status = json.loads((folder / "summary.json").read_text())["status"]
    assert status == "failed: history.h5: File too large"
    assert_ends_in_order_and_goes_on(found, folder, prepared / "whole")


@pytest.mark.slow
@pytest.mark.parametrize("kilobytes", [400, 500, 600])
def test_a_run_on_a_full_disk_ends_in_order_and_goes_on(kilobytes, prepared, tmp_path):
    if subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", tmp_path], check=False
    ).returncode:
        pytest.skip("mounting needs root's rights")
    try:
        # Also a mounted folder, which cannot be renamed.
        found = program(*command(prepared, "run", 0.05)[:-1], tmp_path)
        larger = partial(subprocess.run, ["mount", "-o", "remount,size=10m", tmp_path], check=True)
        assert_ends_in_order_and_goes_on(found, tmp_path, prepared / "whole", larger)
    finally:
        subprocess.run(["umount", tmp_path], check=True)


def test_no_model_is_run_in_place_of_a_body_that_is_missing(prepared, tmp_path, capsys):
    run = tmp_path / "run"
    shutil.copytree(prepared / "whole", run)
    (run / "body-rod.h5").unlink()
    (run / "rod.geo").write_text(f'SystemCall "touch {tmp_path}/ran";')
    text = (run / "scene.toml").read_text()
    body = re.search('^body = ".*"', text, flags=re.MULTILINE)[0]
    model = re.search('^model = "none"', text, flags=re.MULTILINE)[0]
    text = text.replace(body, 'points = ["pin"]').replace(model, 'model = "rod.geo"')
    (run / "scene.toml").write_text(text)
    assert call("run", "--resume", run, "--no-plots") == 2
    assert "body-rod.h5: no such file" in capsys.readouterr().err
    assert not (tmp_path / "ran").exists()


def test_another_scene_or_table_is_refused(prepared, tmp_path, capsys):
    (tmp_path / "other").mkdir()
    for folder in (tmp_path, tmp_path / "other"):
        (folder / "gas.csv").write_text("angle_deg,force_N\n0,80\n90,10\n180,20\n360,80\n")
    gas = {"kind": "angle-table", "point": "piston", "angle_of": "crank", "file": "gas.csv"}
    more = gas | {"file": "other/gas.csv"}
    changes = {"forces.gas": gas, "forces.more": more, "time.revolutions": 0.005}
    write_scene(tmp_path / "mine.toml", "slider-crank-paper", ROD_OF_A_FILE, TIMES, changes)
    shutil.copy(prepared / "rod.h5", tmp_path)
    run = tmp_path / "run"
    assert call("run", tmp_path / "mine.toml", "--no-plots", "-o", run) == 0
    assert call("run", "--resume", run, "--no-plots") == 0
    for changed, before, after in (
        (run / "scene.toml", "tolerance = 1e-08", "tolerance = 1e-07"),
        (tmp_path / "gas.csv", "0,80", "0,90"),
        (tmp_path / "other" / "gas.csv", "0,80", "0,90"),
    ):
        capsys.readouterr()
        text = changed.read_text()
        assert before in text
        changed.write_text(text.replace(before, after))
        assert call("run", "--resume", run, "--no-plots") == 2
        assert f"{changed.name} changed since the run started" in capsys.readouterr().err
        changed.write_text(text)


def test_a_complete_run_has_nothing_left_to_do_and_no_other_body(prepared, tmp_path, capsys):
    """Nor does it need the file that its body was read from."""
    run = tmp_path / "run"
    shutil.copytree(prepared / "whole", run)
    (run / "bore.png").write_bytes(b"")
    before = (run / "history.csv").read_bytes()
    (prepared / "rod.h5").rename(prepared / "moved.h5")
    try:
        assert call("run", "--resume", run, "--no-plots", "--json") == 0
    finally:
        (prepared / "moved.h5").rename(prepared / "rod.h5")
    assert json.loads(capsys.readouterr().out)["status"] == "complete"
    assert (run / "history.csv").read_bytes() == before
    assert (run / "bore.png").exists()
    body = ehd.load_body(run / "body-rod.h5")
    shift = np.zeros((3, 3))
    shift[0, 0] = 1e-6
    ehd.save_body(replace(body, points={"pin": body.points["pin"] + shift}), run / "body-rod.h5")
    assert call("run", "--resume", run, "--no-plots") == 2
    assert "body-rod.h5 changed since the run started" in capsys.readouterr().err


def test_the_scene_that_is_left_is_the_one_that_ran(prepared, tmp_path, monkeypatch):
    """From anywhere, with the files that it names."""
    monkeypatch.chdir(tmp_path)
    whole, again = prepared / "whole", tmp_path / "again"
    assert call("run", whole / "scene.toml", "--no-plots", "-o", again) == 0
    assert (again / "history.csv").read_bytes() == (whole / "history.csv").read_bytes()


BEGAN = {"about": {"reduction_time_s": 0.0, "scene": "case"}, "digests": {}}


@pytest.mark.parametrize(("whole", "steps"), [(True, 2), (False, 1)])
def test_the_last_whole_step_is_stored_where_a_run_ends(whole, steps, tmp_path):
    mechanism = slider_crank(rigid_rod(), film(22.5e-3, 22e-3, 17e-6, 0.01, (12, 2)))
    run = Run(mechanism, IntegratorOptions(tolerance=1e-2), 1e-5)
    with closing(recorded_steps(Recorder(run, 1e-5), tmp_path, BEGAN, 1000)) as steps_so_far:
        deque(islice(steps_so_far, 2), maxlen=0)
        assert steps_of(tmp_path) == len(ehd.load_history(tmp_path)) == 1
        if not whole:
            run.state = "of a step without a row"
    assert steps_of(tmp_path) == len(ehd.load_history(tmp_path)) == steps


def table_of(folder, count, before=0):
    table = CsvFile(folder / "history.csv", before)
    for i in range(before, count):
        table.write({"time_s": i, "max_pressure_Pa": 2 * i})


def test_a_table_goes_on_after_the_rows_of_its_checkpoint(tmp_path):
    table_of(tmp_path, 8)
    with open(tmp_path / "history.csv", "ab") as file:
        file.write(b"8,16")
    table_of(tmp_path, 10, before=5)
    np.testing.assert_array_equal(read_history(tmp_path)["max_pressure_Pa"], 2.0 * np.arange(10))
    table_of(tmp_path, 4)
    with pytest.raises(ehd.errors.InputError, match="does not belong to the run to resume"):
        table_of(tmp_path, 8, before=6)


def test_a_run_ends_where_its_film_is_thinner_than_told(prepared, capsys):
    changes = {"time.revolutions": 0.2, "joints.big_end.smallest_film": 0.6}
    write_scene(prepared / "thin.toml", "slider-crank-paper", ROD_OF_A_FILE, TIMES, changes)
    folder = prepared / "thin"
    assert call(*command(prepared, "thin", 10, "thin.toml")) == 1
    error = capsys.readouterr().err
    assert "FilmTooThinError" in error
    assert "joints.big_end.smallest_film" in error
    film = read_history(folder)["big_end.min_film_thickness_m"]
    assert film[-1] < 0.6 * 17e-6 < film[-2]
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["status"].startswith("failed: the film of big_end is")
    assert summary["steps"] == len(film)


def test_a_complete_periodic_run_has_nothing_left_to_do(tmp_path, capsys):
    alone = {"output.error_budget": False}
    scene = write_scene(tmp_path / "scene.toml", "loaded-journal", LOADED_JOURNAL, alone)
    assert call("run", scene, "--no-plots", "-o", tmp_path / "out") == 0
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    capsys.readouterr()
    assert call("run", "--resume", tmp_path / "out") == 0
    assert "periodic after" in capsys.readouterr().out
    assert {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "settings", "rows"),
    [
        ("loaded-journal", LOADED_JOURNAL, (7, 40)),
        ("four-bar", {"time.tolerance": 1e-3, "time.periodicity": 0.01}, (7, 100)),
        (
            "loaded-journal-starved",
            {"joints.bearing.cells": [60, 2], "output.error_budget": False},
            (7, 300),
        ),
    ],
)
def test_a_periodic_run_that_was_killed_goes_on_to_the_same_result(tmp_path, name, settings, rows):
    """Within its first cycle, and in a later one."""
    scene = write_scene(tmp_path / "scene.toml", name, settings)
    options = ("--no-plots", "--checkpoint-every", 0)
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert call("run", scene, *options, "-o", whole) == 0
    begin, resume = ("run", scene, *options, "-o", killed), ("run", "--resume", killed, *options)
    cycles = [
        read_history(run)["cycle"][-1]
        for run in killed_again_and_again(killed, begin, resume, rows)
    ]
    assert cycles[0] == 1 < cycles[1]
    assert_same_results(killed, whole)


#: Layout of the state of a run.
STATE = Group(Recorder.carried)


@pytest.mark.parametrize("name", ["heated", "rough", "starved"])
def test_a_state_is_the_same_after_a_file(name, tmp_path):
    path = write_scene(tmp_path / "s.toml", "loaded-journal", LOADED_JOURNAL, MODELS[name])
    built = ehd.build(ehd.read_scene(path))
    run = Run(built.mechanism, IntegratorOptions(tolerance=0.1), built.period)
    simulation = Recorder(run, built.period, PeriodicSolver(run, built.period, 0.9))
    deque(islice(simulation.steps(), 5), maxlen=0)
    found = []
    for _ in range(2):
        save_run_state(simulation, tmp_path, BEGAN)
        found.append(load_run_state(tmp_path))
        simulation.state = found[-1].state
        simulation.take(found[-1].history)
    first, second = ((digest(STATE.tree(own.state)), digest(own.history.values)) for own in found)
    assert first == second
