"""Runs that stop and go on: killed at any moment, the result is that of an undisturbed run."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from hand_made_rod import Joint, make_body
from interrupt_case import heed_interrupt, interrupted_run, rows_in

from fenics_ehd.checkpoint import CHECKPOINT, Checkpoints, load_checkpoint, save_checkpoint
from fenics_ehd.cli import main
from fenics_ehd.commands.scenes import read_scene
from fenics_ehd.errors import InputError
from fenics_ehd.history_file import HistoryWriter, read_fields, read_history
from fenics_ehd.reduction import load_body, save_body

SCENE = 'scene = "slider-crank"\n[mechanism]\nrevolutions = 0.03\n[time]\ntolerance = 1e-8\n'


def call(*arguments):
    with pytest.raises(SystemExit) as caught:
        main([str(a) for a in arguments])
    return caught.value.code


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """Folder with a scene, a body and the results of an undisturbed run."""
    folder = tmp_path_factory.mktemp("resume")
    (folder / "scene.toml").write_text(SCENE)
    save_body(make_body(Joint()), folder / "rod.h5")
    assert call(*command(folder, "whole")) == 0
    return folder


def command(folder, name, every=0):
    return ("run", folder / "scene.toml", "--body", folder / "rod.h5", "--no-plots",
            "--checkpoint-every", every, "-o", folder / name)  # fmt: skip


def start(arguments):
    return subprocess.Popen(
        [sys.executable, "-m", "fenics_ehd.cli", *map(str, arguments)],
        preexec_fn=heed_interrupt,
        stderr=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
    )


def stop_after(process, folder, rows, how):
    """Send a signal as soon as the history has so many rows; returns the exit status."""
    deadline = time.monotonic() + 120
    while rows_in(folder) < rows and process.poll() is None:
        assert time.monotonic() < deadline
        time.sleep(1e-3)
    assert process.poll() is None, f"the run was over before the signal: {process.returncode}"
    process.send_signal(how)
    return process.wait(timeout=60)


def assert_same_results(one, other):
    assert (one / "history.csv").read_bytes() == (other / "history.csv").read_bytes()
    names = ("coordinates", "rates", "pressure_Pa")
    for name, values in read_fields(one, names).items():
        np.testing.assert_array_equal(values, read_fields(other, (name,))[name])
    ours, theirs = (json.loads((f / "summary.json").read_text()) for f in (one, other))
    # Versions are those of what was imported, by one process or another.
    for key in set(theirs) - {"wall_time_s", "processor_time_s", "reduction_time_s", "versions"}:
        assert ours[key] == theirs[key], key


@pytest.mark.parametrize("every", [0, pytest.param(1000, marks=pytest.mark.slow)])
def test_a_killed_run_goes_on_to_the_same_result(prepared, every):
    folder = prepared / f"killed_{every}"
    process = start(command(prepared, folder.name, every))
    for rows in (15, 45):
        stop_after(process, folder, rows, signal.SIGKILL)
        (run,) = folder.glob(".run-*")
        assert not any(path.is_file() for path in folder.glob("[!.]*"))
        # What was written can be read, and stays.
        before = (run / "history.csv").read_bytes()
        assert len(read_history(run)["time_s"]) >= rows - 2
        last = before.rfind(b"\n") + 1
        assert (prepared / "whole" / "history.csv").read_bytes()[:last] == before[:last]
        process = start(("run", "--resume", folder, "--no-plots", "--checkpoint-every", every))
    assert process.wait(timeout=120) == 0
    assert_same_results(folder, prepared / "whole")
    assert not list(folder.glob(".*"))


def test_an_interrupted_run_goes_on_to_the_same_result(prepared):
    folder = prepared / "interrupted"
    process = start(command(prepared, folder.name, 1000))
    assert stop_after(process, folder, 20, signal.SIGINT) == 130
    assert json.loads((folder / "summary.json").read_text())["status"] == "interrupted"
    # Its last step, whatever the interval.
    steps = load_checkpoint(folder / CHECKPOINT)["memory"]["totals"]["steps"]
    assert steps == len(read_history(folder)["time_s"])
    assert call("run", "--resume", folder, "--no-plots") == 0
    assert_same_results(folder, prepared / "whole")


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    "how",
    [
        signal.SIGTERM,
        pytest.param(signal.SIGHUP, marks=SLOW),
        pytest.param(signal.SIGPIPE, marks=SLOW),
    ],
    ids=lambda how: how.name,
)
def test_every_signal_ends_a_run_as_ctrl_c_does(how, prepared):
    folder = prepared / how.name
    program = [sys.executable, "-m", "fenics_ehd.cli"]
    arguments = command(prepared, folder.name, 1000)
    interrupted_run([*program, *map(str, arguments)], folder, how=how)
    assert call("run", "--resume", folder, "--no-plots") == 0
    assert_same_results(folder, prepared / "whole")


@pytest.mark.slow
def test_a_run_ends_when_nobody_reads_what_it_says(prepared):
    folder = prepared / "unread"
    # Long enough for the bar to be drawn again on any machine.
    (prepared / "long.toml").write_text(SCENE.replace("0.03", "1"))
    read, write = os.pipe()
    # The bar is drawn as often as on a terminal, which a pipe is not.
    code = "import sys; sys.stderr.isatty = lambda: True; from fenics_ehd.cli import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", code, "run", str(prepared / "long.toml"), "--body",
         str(prepared / "rod.h5"), "--no-plots", "-o", str(folder)], stderr=write
    )  # fmt: skip
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
        from fenics_ehd.cli import main
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


def assert_ended_readable(found, folder, whole):
    """One line names a file, no crash; what was written is the beginning of the whole run."""
    assert_one_line(found, folder)
    rows = (folder / "history.csv").read_bytes()
    assert (whole / "history.csv").read_bytes().startswith(rows[: rows.rfind(b"\n") + 1])
    fields = read_fields(folder, ("coordinates", "pressure_Pa"))
    known = load_checkpoint(folder / CHECKPOINT)["rows"]
    for name, values in fields.items():
        assert len(values) >= known > 0
        np.testing.assert_array_equal(values, read_fields(whole, (name,))[name][: len(values)])


@pytest.fixture
def run_limited(prepared):
    def run(size):
        """Run with files of so many bytes at most, as on a disk that is full."""
        # After MPI has begun, which has files of its own.
        code = f"""if True:
            import mpi4py.MPI, resource
            resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))
            from fenics_ehd.cli import main
            main()"""
        arguments = map(str, command(prepared, f"limited_{size}", 0.05))
        found = subprocess.run(
            [sys.executable, "-c", code, *arguments], capture_output=True, text=True, timeout=120
        )
        return found, prepared / f"limited_{size}"

    return run


def test_a_run_whose_files_may_not_grow_ends_in_order_and_goes_on(run_limited, prepared):
    found, folder = run_limited(700_000)
    assert_ended_readable(found, folder, prepared / "whole")
    status = json.loads((folder / "summary.json").read_text())["status"]
    assert status == "failed: history.h5: File too large"
    assert call("run", "--resume", folder, "--no-plots") == 0
    assert_same_results(folder, prepared / "whole")


def test_a_run_without_room_for_its_first_step_leaves_nothing(run_limited):
    found, folder = run_limited(200_000)
    assert_one_line(found, folder)
    assert not folder.exists()


@pytest.mark.slow
@pytest.mark.parametrize("kilobytes", [700, 760, 850])
def test_a_run_on_a_full_disk_ends_in_order_and_goes_on(kilobytes, prepared, tmp_path):
    if subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", tmp_path], check=False
    ).returncode:
        pytest.skip("mounting needs root's rights")
    try:
        # Also a mounted folder, which cannot be renamed.
        folder = tmp_path
        arguments = [*command(prepared, "run", 0.05)[:-1], folder]
        program = [sys.executable, "-m", "fenics_ehd.cli"]
        found = subprocess.run(
            [*program, *map(str, arguments)], capture_output=True, text=True, timeout=120
        )
        assert_ended_readable(found, folder, prepared / "whole")
        subprocess.run(["mount", "-o", "remount,size=10m", tmp_path], check=True)
        assert call("run", "--resume", folder, "--no-plots") == 0
        assert_same_results(folder, prepared / "whole")
    finally:
        subprocess.run(["umount", tmp_path], check=True)


def test_a_complete_run_has_nothing_left_to_do(prepared, capsys):
    before = (prepared / "whole" / "history.csv").read_bytes()
    assert call("run", "--resume", prepared / "whole", "--no-plots", "--json") == 0
    assert json.loads(capsys.readouterr().out)["status"] == "complete"
    assert (prepared / "whole" / "history.csv").read_bytes() == before


def test_what_cannot_go_on_is_refused(prepared, tmp_path, capsys):
    assert call("run", "--resume", tmp_path) == 2
    assert "no checkpoint to go on from" in capsys.readouterr().err
    assert call("run", "--resume", prepared / "whole", "slider-crank") == 2
    assert call("run") == 2
    (tmp_path / CHECKPOINT).write_bytes(b"no HDF5")
    assert call("run", "--resume", tmp_path) == 2
    assert "checkpoint.h5" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "before", "after"),
    [("scene.toml", "tolerance = 1e-08", "tolerance = 1e-07"), ("gas.csv", "0,80", "0,90")],
)
def test_another_scene_or_table_is_refused(name, before, after, prepared, tmp_path, capsys):
    (tmp_path / "gas.csv").write_text("angle_deg,force_N\n0,80\n90,10\n180,20\n360,80\n")
    scene = SCENE.replace("revolutions = 0.03", 'revolutions = 0.005\ngas_force = "gas.csv"')
    (tmp_path / "mine.toml").write_text(scene)
    body, run = prepared / "rod.h5", tmp_path / "run"
    arguments = ("--body", body, "--no-plots", "-o", run)
    assert call("run", tmp_path / "mine.toml", *arguments) == 0
    assert call("run", "--resume", run, "--no-plots") == 0
    capsys.readouterr()
    changed = run / name if name == "scene.toml" else tmp_path / name
    assert before in changed.read_text()
    changed.write_text(changed.read_text().replace(before, after))
    assert call("run", "--resume", run, "--no-plots") == 2
    assert f"{name} changed since the run began" in capsys.readouterr().err


def changed_checkpoint(run, **changes):
    """Write the checkpoint of a run again, keys of nested tables by dots, None for none."""
    tree = load_checkpoint(run / CHECKPOINT)
    for name, change in changes.items():
        *groups, key = name.split("__")
        table = tree
        for group in groups:
            table = table[group]
        table[key] = change(table[key])
        if table[key] is None:
            del table[key]
    save_checkpoint(run / CHECKPOINT, tree)


def filled(value):
    return lambda array: np.full_like(array, value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rows": lambda n: n // 2}, "it is not of step"),
        ({"rows": lambda n: 10 * n}, "the history has"),
        ({"rows": lambda n: 0}, "it counts 0 steps"),
        ({"rows": lambda n: None}, "rows is missing"),
        ({"scene": lambda t: None}, "scene is missing"),
        ({"memory": lambda t: None}, "memory is missing"),
        ({"memory__integrator": lambda t: None}, "memory/integrator is missing"),
        ({"memory__integrator__rate": lambda x: None}, "integrator/rate is missing"),
        ({"memory__integrator__rate": lambda x: x[:-1]}, "integrator/rate has 4 rows, times has 5"),
        ({"memory__integrator__rate": lambda x: x[:, :-1]}, r"rate has shape \(5, 1\), not like"),
        ({"memory__integrator__watched": filled(np.nan)}, "integrator/watched holds a value"),
        ({"memory__integrator__times": lambda t: t[::-1]}, "integrator/times must descend from"),
        (
            {"memory__integrator__step": lambda s: float("nan")},
            "integrator/step holds a value",
        ),
        ({"memory__integrator__step": lambda s: -s}, "integrator/step = .* must be positive"),
        ({"memory__integrator__step": lambda s: "long"}, "integrator/step is of type <U4"),
        ({"memory__integrator__x": lambda x: x[::-1]}, "it is not of step"),
        ({"memory__pressures__times": lambda t: t[::-1]}, "pressures/times must descend from"),
        ({"memory__totals__time": lambda t: t / 2}, "integrator/times must descend from"),
        ({"memory__balance__work": lambda x: x[:-1]}, "balance/work has shape"),
        ({"memory__estimate": lambda t: None}, "estimate is missing"),
    ],
)
def test_a_checkpoint_that_cannot_be_is_refused(changes, message, prepared, tmp_path, capsys):
    run = tmp_path / "run"
    shutil.copytree(prepared / "whole", run)
    changed_checkpoint(run, **changes)
    assert call("run", "--resume", run, "--no-plots") == 2
    error = capsys.readouterr().err
    assert "Traceback" not in error
    assert re.search(f"InputError: .*checkpoint.*{message}", error.splitlines()[-1])


def test_another_body_is_refused(prepared, tmp_path, capsys):
    run = tmp_path / "run"
    shutil.copytree(prepared / "whole", run)
    body = load_body(run / "body.h5")
    shift = np.zeros((3, 3))
    shift[0, 0] = 1e-6
    save_body(replace(body, points={"pin": body.points["pin"] + shift}), run / "body.h5")
    assert call("run", "--resume", run, "--no-plots") == 2
    assert "body.h5 changed since the run began" in capsys.readouterr().err
    save_body(body, run / "body.h5")
    assert call("run", "--resume", run, "--no-plots") == 0


def test_the_scene_that_is_left_is_the_one_that_ran(tmp_path):
    reduced = ("--method", "m1", "--modes", "3", "-o", tmp_path / "rod.h5")
    assert call("reduce", "conrod", *reduced) == 0
    (tmp_path / "mine.toml").write_text(SCENE.replace("1e-8", "1e-4").replace("0.03", "0.002"))
    body, run = tmp_path / "rod.h5", tmp_path / "run"
    arguments = ("--body", body, "--no-plots", "-o", run)
    assert call("run", tmp_path / "mine.toml", *arguments) == 0
    settings = read_scene(str(run / "scene.toml"))[0]
    assert (settings.reduction.method, settings.reduction.modes) == ("m1", 3)


def test_a_checkpoint_returns_what_it_was_given(tmp_path):
    tree = {
        "rows": 3,
        "step": 0.1 + 0.2,
        "name": "m4",
        "deep": {"array": np.arange(6.0).reshape(2, 3), "none": {}, "nan": float("nan")},
    }
    save_checkpoint(tmp_path / "c.h5", tree)
    found = load_checkpoint(tmp_path / "c.h5")
    np.testing.assert_equal(found, tree)
    assert isinstance(found["rows"], int)


def test_a_checkpoint_that_fails_leaves_the_former_one(tmp_path, monkeypatch):
    save_checkpoint(tmp_path / "c.h5", {"rows": 1})
    with pytest.raises(TypeError):
        save_checkpoint(tmp_path / "c.h5", {"rows": 2, "bad": object()})
    assert load_checkpoint(tmp_path / "c.h5")["rows"] == 1


def rows_of(folder, count, start=0, resumed=None):
    writer = HistoryWriter(folder, {"nodes": np.arange(3.0)}, resumed=resumed)
    with writer:
        for i in range(start, count):
            row = {"time_s": i, "max_pressure_Pa": 2 * i, "min_film_thickness_m": 1 + i}
            writer.add(row, {"x": np.array([i, -i])})


@pytest.mark.parametrize(("whole", "rows"), [(True, 2), (False, 1)])
def test_the_last_whole_step_is_stored_where_a_run_ends(whole, rows, tmp_path):
    run = SimpleNamespace(memory=dict)
    history = HistoryWriter(tmp_path, {})
    with history, Checkpoints(history, 1000, {}) as checkpoints:
        for number in range(2):
            run.integrator = number
            history.add({"time_s": number}, {"x": np.zeros(2)})
            checkpoints.follow(run)
        assert load_checkpoint(tmp_path / CHECKPOINT)["rows"] == 1
        if not whole:
            run.integrator = "of a step without a row"
    assert load_checkpoint(tmp_path / CHECKPOINT)["rows"] == rows


def test_history_that_goes_on_keeps_rows_beyond_its_checkpoint(tmp_path):
    rows_of(tmp_path, 8)
    with open(tmp_path / "history.csv", "ab") as file:
        file.write(b"8,16")
    rows_of(tmp_path, 6, start=5, resumed=5)
    # Rows 6 and 7 are from before, the unfinished one is gone.
    assert list(read_history(tmp_path)["time_s"]) == list(range(8))
    rows_of(tmp_path, 10, start=5, resumed=5)
    np.testing.assert_array_equal(read_history(tmp_path)["max_pressure_Pa"], 2.0 * np.arange(10))
    np.testing.assert_array_equal(read_fields(tmp_path, ("x",))["x"][:, 1], -np.arange(10.0))
    with h5py.File(tmp_path / "history.h5") as file:
        assert len(file["nodes"]) == 3


def test_a_history_without_the_checkpoints_rows_is_refused(tmp_path):
    rows_of(tmp_path, 4)
    with pytest.raises(InputError, match="holds 4 steps, its checkpoint 6"):
        rows_of(tmp_path, 8, start=6, resumed=6)


def test_a_run_ends_where_its_film_is_thinner_than_told(prepared, capsys):
    scene = prepared / "thin.toml"
    scene.write_text(SCENE.replace("revolutions = 0.03", "revolutions = 0.2")
                     + "[bearing]\nsmallest_film = 0.6\n")  # fmt: skip
    folder = prepared / "thin"
    arguments = ("run", scene, "--body", prepared / "rod.h5", "--no-plots", "-o", folder)
    assert call(*arguments) == 1
    error = capsys.readouterr().err
    assert "FilmTooThinError" in error
    assert "bearing.smallest_film" in error
    film = read_history(folder)["min_film_thickness_m"]
    assert film[-1] < 0.6 * 17e-6 < film[-2]
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["status"].startswith("failed: the film is")
    assert summary["steps"] == len(film)


def test_a_history_that_was_cut_off_is_not_read(prepared, tmp_path):
    content = (prepared / "whole" / "history.h5").read_bytes()
    for share in (0.3, 0.6, 0.99):
        (tmp_path / "history.h5").write_bytes(content[: int(share * len(content))])
        with pytest.raises(InputError, match=r"history.h5: not a history of a run"):
            read_fields(tmp_path, ("coordinates",))
