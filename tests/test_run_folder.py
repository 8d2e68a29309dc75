"""The folder of a run: held by one process, and never without the best result it had."""

import json
import os
import re
from contextlib import suppress
from pathlib import Path

import pytest
from command_line import exit_of
from hand_made_rod import Joint, make_body
from scene_cases import ROD_OF_A_FILE, write_scene

import fenics_ehd as ehd
from fenics_ehd.base.files import HEADER, clear, complete_result
from fenics_ehd.results.recorded_run import RunFolder

SCENE = ROD_OF_A_FILE | {"time.revolutions": 0.005, "time.tolerance": 1e-4}
COARSER = SCENE | {"time.tolerance": 1e-3}
FAILS = SCENE | {"time.revolutions": 0.2, "joints.big_end.smallest_film": 0.6}


@pytest.fixture
def run(tmp_path, capfd):
    """Calls ``fenics-ehd run`` into the folder ``out``; returns status and error output."""
    ehd.save_body(make_body(Joint()), tmp_path / "rod.h5")

    def call(changes, *options):
        scene = write_scene(tmp_path / "scene.toml", "slider-crank-paper", changes)
        arguments = ("--no-plots", "--no-error-budget", "-o", tmp_path / "out")
        status, _, errors = exit_of(capfd, "run", scene, *arguments, *options)
        return status, errors

    return call


def contents(folder):
    """Files of a folder, and of those in it, by their paths; links by where they lead."""
    found = (path for path in folder.rglob("*") if path.is_symlink() or path.is_file())
    return {
        str(path.relative_to(folder)): (path.is_symlink() and path.readlink()) or path.read_bytes()
        for path in found
    }


def test_complete_results_are_replaced_only_when_told_to(run, tmp_path, monkeypatch):
    out = tmp_path / "out"
    assert run(SCENE)[0] == 0
    before = contents(out)
    assert {"summary.json", "history.csv", "history.h5", "scene.toml", "body-rod.h5"} <= set(before)
    # Before any work: the body is not even read.
    with monkeypatch.context() as patch:
        patch.delattr("fenics_ehd.scenes.part.load_body")
        status, errors = run(COARSER)
    assert status == 2
    line = errors.splitlines()[-1]
    assert f"{out} has a complete result: choose another folder or use --overwrite" in line
    assert contents(out) == before
    (out / "max_pressure.png").write_text("stale")
    (out / "notes.txt").write_text("not of a run")
    (out / "orbit-notes.svg").write_text("not of a run either")
    assert run(COARSER, "--overwrite")[0] == 0
    after = contents(out)
    assert set(after) == set(before) | {"notes.txt", "orbit-notes.svg"}
    assert after["history.csv"] != before["history.csv"]


def test_a_run_that_fails_leaves_complete_results_as_they_were(run, tmp_path):
    out = tmp_path / "out"
    assert run(FAILS)[0] == 1
    assert "failed: the film" in json.loads((out / "summary.json").read_text())["status"]
    # What failed is replaced without asking.
    assert run(SCENE)[0] == 0
    assert json.loads((out / "summary.json").read_text())["status"] == "complete"
    before = contents(out)
    status, errors = run(FAILS, "--overwrite")
    assert status == 1
    failed = out / "replacement"
    assert f"{out} keeps its complete result, this run is in {failed}" in errors
    assert {name: (out / name).read_bytes() for name in before} == before
    assert "failed: the film" in json.loads((failed / "summary.json").read_text())["status"]
    # Once there is something better, it goes.
    assert run(SCENE, "--overwrite")[0] == 0
    assert set(contents(out)) == set(before)


@pytest.mark.parametrize("more", [(), ("--overwrite",)])
def test_two_runs_do_not_share_a_folder(more, run, tmp_path, capfd):
    out = tmp_path / "out"
    with RunFolder(out):
        status, errors = run(SCENE, *more)
        assert status == 2
        assert "InUseError" in errors
        assert "another process is writing to this folder" in errors.splitlines()[-1]
        assert exit_of(capfd, "run", "--resume", out)[0] == 2
        with pytest.raises(ehd.errors.InUseError):
            RunFolder(out, resume=True)
    assert run(SCENE, *more)[0] == 0


#: What a folder may hold that is not of a run.
OTHERS = (
    "rod.h5", "animation.pptx", "orbit-notes.svg", "stress.json", "coarser-housing.h5",
    ".run-backup/history.csv", ".moving-a1/d/summary.json", ".ended-x/summary.json",
)  # fmt: skip

#: What a run would write over.
TAKEN = (
    "scene.toml", "body-rod.h5", "orbit.png", "summary.json.part", "vtk/mine.vtu", "manifest.txt"
)  # fmt: skip


def test_a_folder_that_holds_what_is_not_of_a_run_is_refused(run, tmp_path, monkeypatch):
    """Before any work, and nothing is touched, nor by a run that needs none of these names."""
    out = tmp_path / "out"
    for other in (*OTHERS, *TAKEN):
        (out / other).parent.mkdir(parents=True, exist_ok=True)
        (out / other).write_text(f"my {other}")
    with monkeypatch.context() as patch:
        patch.delattr("fenics_ehd.scenes.part.load_body")
        for name in TAKEN:
            before = contents(out)
            for more in ((), ("--overwrite",)):
                status, errors = run(SCENE, *more)
                assert status == 2
                assert re.search(r"out/\S+: (not of a former run|fenics-ehd did not write)", errors)
            assert contents(out) == before
            (out / name).unlink()
    before = contents(out)
    for more in ((), ("--overwrite",)):
        assert run(SCENE, *more)[0] == 0
        assert contents(out).items() >= before.items()


LINKS = ("manifest.txt", "history.h5", "summary.json", "vtk", "replacement", "replacement/vtk",
         ".moving-a1/d", ".ended-x")  # fmt: skip


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("listing", [False, True])
def test_nothing_is_done_through_links(link, listing, tmp_path):
    """In a folder of somebody else, who may have written a manifest, too."""
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    elsewhere.mkdir()
    write_run(elsewhere, "mine", "complete")
    target = elsewhere / link if link in ("history.h5", "summary.json") else elsewhere
    if link == "manifest.txt":
        target = elsewhere / "list"
        target.write_text(f"{HEADER}\nhistory.h5\n")
    (out / link).parent.mkdir(parents=True)
    if link == "replacement/vtk":
        write_run(out / "replacement", "other", "complete")
    (out / link).symlink_to(target)
    if listing:
        for folder in {out, out / "replacement", elsewhere}:
            names = [path.name + "/" * path.is_dir() for path in folder.glob("*")]
            if names and not (folder / "manifest.txt").exists():
                (folder / "manifest.txt").write_text("\n".join([HEADER, *names]))
    before = contents(elsewhere)
    for options in ({"overwrite": True}, {"resume": True}, {}):
        with suppress(ehd.errors.InputError), RunFolder(out, ["rod"], **options) as folder:
            clear(folder.path)
            write_run(folder.path, "new", "complete")
        assert contents(elsewhere) == before


@pytest.mark.parametrize("name", ["../elsewhere/notes", "/notes", "..", "../", "a/b", "\0", "/"])
def test_a_manifest_that_names_what_is_not_in_its_folder_is_refused(name, run, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "notes").write_text("mine")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "manifest.txt").write_text(f"{HEADER}\nhistory.csv\n{name}\n")
    before = contents(tmp_path)
    status, errors = run(SCENE)
    assert status == 2
    assert "is not the name of a file in this folder" in errors
    before["scene.toml"] = (tmp_path / "scene.toml").read_bytes()
    assert contents(tmp_path) == before


@pytest.mark.parametrize("content", [b"[" * 100_000, b"[]", b"7", b'{"status": 3}'], ids=len)
def test_a_summary_of_another_kind_is_none(content, tmp_path):
    (tmp_path / "summary.json").write_bytes(content)
    assert complete_result(tmp_path) is None


def test_a_pipe_in_place_of_a_summary_is_not_waited_for(run, tmp_path, capfd):
    assert run(SCENE)[0] == 0
    (tmp_path / "out" / "summary.json").unlink()
    os.mkfifo(tmp_path / "out" / "summary.json")
    assert run(SCENE)[0] == 2
    status, _, errors = exit_of(capfd, "plot", tmp_path / "out")
    assert status == 2
    assert "summary.json: not a summary of a run" in errors


class Killed(BaseException):
    """Ends a process at once, as far as files are concerned."""


def write_run(path, content, status):
    for name in ("history.csv", "history.h5", "scene.toml", "body-rod.h5"):
        (path / name).write_text(content)
    (path / "summary.json").write_text(json.dumps({"status": status, "content": content}))


def state_of(folder):
    """What a folder holds: the content of a whole run, by how it ended."""
    summary = json.loads((folder / "summary.json").read_text())
    names = ("history.csv", "history.h5", "scene.toml", "body-rod.h5")
    assert {(folder / name).read_text() for name in names} == {summary["content"]}
    return summary["content"], summary["status"]


@pytest.mark.parametrize("former", ["nothing", "complete", "interrupted"])
@pytest.mark.parametrize("status", ["complete", "interrupted"])
def test_killed_while_files_are_exchanged(former, status, tmp_path):
    """At any moment, the next one finds a run to resume or complete results."""
    step = 0
    while exchange_until(tmp_path / str(step), former, status, step) == step:
        step += 1
    assert step >= (14 if former == status == "complete" else 0)


def exchange_until(out, former, status, step):
    """Kill an exchange before the operation of this number; how many were done before."""
    out.mkdir()
    if former != "nothing":
        with RunFolder(out, ["rod"]) as folder:
            write_run(folder.path, "old", former)
            (folder.path / "orbit.png").write_text("old")
            (folder.path / "vtk").mkdir()
            (folder.path / "vtk" / "mine").write_text("not of a run")
    folder, done = RunFolder(out, ["rod"], overwrite=True), 0
    clear(folder.path)

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
                for name in ("replace", "unlink", "rmdir"):
                    patch.setattr(Path, name, counted(getattr(Path, name)))
        except Killed:
            pass
    folder._lock.close()
    with RunFolder(out, resume=True) as resumed:
        found = state_of(resumed.path)
    keeps = former == "complete" and status != "complete"
    assert found == ("new", status)
    assert (out / "replacement").exists() == keeps
    assert state_of(out) == (("old", "complete") if keeps else ("new", status))
    assert (out / "orbit.png").exists() == keeps
    assert (out / "vtk" / "mine").exists() == (former != "nothing")
    return done


def test_nothing_stays_of_a_run_without_a_step(tmp_path):
    with RunFolder(tmp_path) as folder:
        (folder.path / "history.csv").write_text("time_s\n")
    assert not list(tmp_path.iterdir())


def test_resume_takes_the_run_that_was_to_replace_another_one(tmp_path):
    with RunFolder(tmp_path, ["rod"]) as folder:
        write_run(folder.path, "old", "complete")
    folder = RunFolder(tmp_path, ["rod"], overwrite=True)
    write_run(folder.path, "new", "killed")
    folder._lock.close()
    with RunFolder(tmp_path, resume=True) as again:
        assert again.path == folder.path != tmp_path
        write_run(again.path, "newer", "complete")
    assert state_of(tmp_path) == ("newer", "complete")
    assert not folder.path.exists()
