"""The folder of a run: held by one process, and never without the best result it had."""

import json
import os
from pathlib import Path

import pytest
from command_line import exit_of
from hand_made_rod import Joint, make_body
from scene_cases import ROD_OF_A_FILE, write_scene

from fenics_ehd.base.errors import InputError, InUseError
from fenics_ehd.reduction import save_body
from fenics_ehd.results.checkpoint import CHECKPOINT
from fenics_ehd.results.run_folder import RunFolder

SCENE = ROD_OF_A_FILE | {"time.revolutions": 0.005, "time.tolerance": 1e-4}
COARSER = SCENE | {"time.tolerance": 1e-3}
FAILS = SCENE | {"time.revolutions": 0.2, "joints.big_end.smallest_film": 0.6}


@pytest.fixture
def run(tmp_path, capfd):
    """Calls ``fenics-ehd run`` into the folder ``out``; returns status and error output."""
    save_body(make_body(Joint()), tmp_path / "rod.h5")

    def call(changes, *options):
        scene = write_scene(tmp_path / "scene.toml", "slider-crank-paper", changes)
        arguments = ("--no-plots", "-o", tmp_path / "out")
        status, _, errors = exit_of(capfd, "run", scene, *arguments, *options)
        return status, errors

    return call


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_complete_results_are_replaced_only_when_told_to(run, tmp_path, monkeypatch):
    out = tmp_path / "out"
    assert run(SCENE)[0] == 0
    before = contents(out)
    assert {"summary.json", "history.csv", "history.h5", "scene.toml", "body-rod.h5"} <= set(before)
    # Before any work: the body is not even read.
    with monkeypatch.context() as patch:
        patch.delattr("fenics_ehd.scenes.elastic_part.load_body")
        status, errors = run(COARSER)
    assert status == 2
    line = errors.splitlines()[-1]
    assert f"{out}: holds a complete result, choose another folder or --overwrite" in line
    assert contents(out) == before
    (out / "max_pressure.png").write_text("stale")
    (out / "notes.txt").write_text("not of a run")
    assert run(COARSER, "--overwrite")[0] == 0
    after = contents(out)
    assert set(after) == set(before) | {"notes.txt"}
    assert after["history.csv"] != before["history.csv"]


def test_a_run_that_fails_leaves_complete_results_as_they_were(run, tmp_path):
    out = tmp_path / "out"
    assert run(SCENE)[0] == 0
    before = contents(out)
    status, errors = run(FAILS, "--overwrite")
    assert status == 1
    (failed,) = out.glob(".run-*")
    assert f"{out}: its complete result stays, this run is in {failed}" in errors
    assert {name: (out / name).read_bytes() for name in before} == before
    assert "failed: the film" in json.loads((failed / "summary.json").read_text())["status"]
    # Once there is something better, it goes.
    assert run(SCENE, "--overwrite")[0] == 0
    assert set(contents(out)) == set(before)


def test_failed_results_are_replaced_without_asking(run, tmp_path):
    assert run(FAILS)[0] == 1
    summary = tmp_path / "out" / "summary.json"
    assert json.loads(summary.read_text())["status"].startswith("failed: the film")
    assert run(SCENE)[0] == 0
    assert json.loads(summary.read_text())["status"] == "complete"


def test_a_run_that_cannot_start_leaves_nothing(run, tmp_path):
    (tmp_path / "rod.h5").unlink()
    assert run(SCENE)[0] == 2
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("more", [(), ("--overwrite",)])
def test_two_runs_do_not_share_a_folder(more, run, tmp_path, capfd):
    out = tmp_path / "out"
    with RunFolder(out):
        status, errors = run(SCENE, *more)
        assert status == 2
        assert "InUseError" in errors
        assert "another process is writing to this folder" in errors.splitlines()[-1]
        assert exit_of(capfd, "run", "--resume", out)[0] == 2
        with pytest.raises(InUseError):
            RunFolder(out, resume=True)
    assert run(SCENE, *more)[0] == 0


def test_links_are_replaced_and_not_followed(run, tmp_path):
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    out.mkdir()
    elsewhere.mkdir()
    names = ("history.csv", "history.h5", "summary.json", CHECKPOINT, "scene.toml", "body-rod.h5")
    for name in names:
        (elsewhere / name).write_text("mine")
        (out / name).symlink_to(elsewhere / name)
        (out / f"{name}.part").symlink_to(elsewhere / name)
    (elsewhere / "vtk").mkdir()
    (elsewhere / "vtk" / "rod.pvd").write_text("mine")
    (out / "vtk").symlink_to(elsewhere / "vtk")
    assert run(SCENE)[0] == 0
    for name in names:
        assert (elsewhere / name).read_text() == "mine"
        assert (out / name).is_file()
        assert not (out / name).is_symlink()
    assert (elsewhere / "vtk" / "rod.pvd").read_text() == "mine"


def test_the_lock_follows_no_link(tmp_path):
    (tmp_path / ".lock").symlink_to(tmp_path / "victim")
    with pytest.raises(OSError):
        RunFolder(tmp_path)
    assert not (tmp_path / "victim").exists()


class Killed(BaseException):
    """Ends a process at once, as far as files are concerned."""


def write_run(path, content, status):
    for name in ("history.csv", "history.h5", CHECKPOINT, "scene.toml", "body-rod.h5"):
        (path / name).write_text(content)
    (path / "summary.json").write_text(json.dumps({"status": status, "content": content}))


def state_of(folder):
    """What a folder holds: the content of a whole run, by how it ended."""
    summary = json.loads((folder / "summary.json").read_text())
    names = ("history.csv", "history.h5", CHECKPOINT, "scene.toml", "body-rod.h5")
    assert {(folder / name).read_text() for name in names} == {summary["content"]}
    return summary["content"], summary["status"]


@pytest.mark.parametrize("former", ["nothing", "complete", "interrupted"])
@pytest.mark.parametrize("status", ["complete", "interrupted"])
def test_killed_while_files_are_exchanged(former, status, tmp_path):
    """Whatever was done by then, the next one finds a run to go on with or whole results."""
    step = 0
    while exchange_until(tmp_path / str(step), former, status, step) == step:
        step += 1
    assert step >= (1 if former == "complete" and status != "complete" else 9)


def exchange_until(out, former, status, step):
    """Kill an exchange before the operation of this number; how many were done before."""
    out.mkdir()
    if former != "nothing":
        write_run(out, "old", former)
    folder, done = RunFolder(out, overwrite=True), 0

    def counted(original):
        def operation(*arguments, **options):
            nonlocal done
            if done == step:
                raise Killed
            done += 1
            return original(*arguments, **options)

        return operation

    with pytest.MonkeyPatch.context() as patch:
        try:
            with folder:
                write_run(folder.path, "new", status)
                for name in ("rename", "replace", "unlink"):
                    patch.setattr(Path, name, counted(getattr(Path, name)))
        except Killed:
            pass
    folder._lock.close()
    with RunFolder(out, resume=True) as resumed:
        found = state_of(resumed.path)
    keeps = former == "complete" and status != "complete"
    assert found == ("new", status)
    if not keeps:
        assert state_of(out) == ("new", status)
        assert not list(out.glob(".*"))
    else:
        assert state_of(out) == ("old", "complete")
    return done


def test_what_was_killed_before_its_first_checkpoint_is_cleared_away(tmp_path):
    (tmp_path / ".run-0").mkdir()
    (tmp_path / ".run-0" / "history.csv").write_text("time_s\n")
    with pytest.raises(InputError, match="nosuch: no checkpoint to go on from"):
        RunFolder(tmp_path / "nosuch", resume=True)
    with RunFolder(tmp_path):
        assert not (tmp_path / ".run-0").exists()
    assert not list(tmp_path.iterdir())


def test_resume_takes_the_run_that_was_killed_last(tmp_path):
    write_run(tmp_path, "complete", "complete")
    for number, name in enumerate(("b", "a")):
        path = tmp_path / f".run-{name}"
        path.mkdir()
        write_run(path, name, "killed")
        os.utime(path / CHECKPOINT, (number, number))
    with RunFolder(tmp_path, resume=True) as folder:
        assert folder.path.name == ".run-a"
