"""Rows of a sweep: where they come from, what becomes of those that are there already."""

import json
import math
import shutil
from pathlib import Path

import pytest
from command_line import call, exit_of
from csv_history import only_joint
from mpi4py import MPI
from scene_cases import LOAD
from sweep_cases import (
    ENGINE,
    LOADED_JOURNAL,
    SLIDER_CRANK,
    SOME_FAIL,
    Inline,
    given_values,
    results,
    rows_of,
    scene_as,
    sweep_inline,
    write_scene,
)

import fenics_ehd as ehd
from fenics_ehd.scenes.scene import scene_text
from fenics_ehd.study.pool import OtherFolderError
from fenics_ehd.study.sweep import FIGURES, JOINT_FIGURES, SweepFolder, make_sweep, run_sweep
from fenics_ehd.study.worker import PROCESSOR_SECONDS, CaseResult, CaseTask, Outcome

THICKER = SLIDER_CRANK.replace("viscosity = 0.01", "viscosity = 0.02")


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return write_scene(tmp_path_factory.mktemp("scene"))


@pytest.fixture(scope="module")
def swept(scene, tmp_path_factory):
    """Folder of a sweep by two processes, histories kept; some cases cannot run."""
    directory = tmp_path_factory.mktemp("swept")
    values = given_values(SOME_FAIL)
    assert call("sweep", scene, *values, "-o", directory, "--workers", 2, "--keep") == 1
    return directory


@pytest.fixture
def again(swept, tmp_path):
    """A copy of that folder to go on in."""
    return Path(shutil.copytree(swept, tmp_path / "again"))


def test_failures_are_rows(swept):
    rows = results(rows_of(swept))
    assert sorted(rows) == list("123456")
    assert {case for case, row in rows.items() if row["status"] == "complete"} == {"1", "3"}
    assert rows["5"]["status"].startswith("failed: SettingsError: joints.big_end.clearance = 0.003")
    assert rows["2"]["status"].startswith("failed: FilmTooThinError: the film of big_end is 14 um")
    assert rows["2"]["big_end.max_pressure_Pa"] == ""
    assert rows["1"]["joints.big_end.clearance"] == "1.4e-05"
    column = "big_end.max_pressure_Pa"
    assert float(rows["1"][column]) != float(rows["3"][column])


def test_folder_has_one_body_and_the_histories(swept):
    (body,) = (swept / "bodies").iterdir()
    histories = sorted(path.parent.name for path in swept.glob("runs/*/history.h5"))
    assert histories == ["0001", "0002", "0003", "0004"]
    for kept in swept.glob("runs/*/"):
        names = {path.name for path in kept.iterdir()}
        if not (kept / "history.h5").exists():
            assert names == {"manifest.txt", "scene.toml", "body-rod.h5"}, names
            continue
        fields = {"history.csv", "history.h5", "manifest.txt"}
        assert names == {*fields, "summary.json", "scene.toml", "body-rod.h5"}
        assert (kept / "body-rod.h5").samefile(body)


def test_row_is_that_of_a_run_on_its_own(swept, tmp_path, capfd):
    changed = SLIDER_CRANK.replace("clearance = 1.7e-05", "clearance = 14e-6")
    assert changed != SLIDER_CRANK
    # The scene of a kept case is that run's.
    alone, scene = write_scene(tmp_path, changed), swept / "runs" / "0001" / "scene.toml"
    assert ehd.read_scene(alone).tables == ehd.read_scene(scene).tables
    options = ("--no-plots", "--no-error-budget")
    status, _, errors = exit_of(capfd, "run", alone, "-o", tmp_path / "out", *options)
    assert status == 0, errors
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    kept = json.loads((swept / "runs" / "0001" / "summary.json").read_text())
    row = results(rows_of(swept))["1"]
    # The worker that runs loads a body, and no Gmsh.
    timed = ("reduction_time_s", "wall_time_s", "processor_time_s", "versions", "inputs")
    assert {k: v for k, v in kept.items() if k not in timed} == {
        k: v for k, v in summary.items() if k not in timed
    }
    figures = {name: summary[name] for name in set(FIGURES) - set(timed)}
    figures |= {f"big_end.{name}": only_joint(summary)[name] for name in JOINT_FIGURES}
    for name, value in figures.items():
        assert row[name] == ("" if value is None else json.dumps(value))
    ours, reference = (d / "history.csv" for d in (tmp_path / "out", swept / "runs" / "0001"))
    assert ours.read_text() == reference.read_text()


@pytest.mark.parametrize(
    "text",
    [LOADED_JOURNAL, pytest.param(ENGINE, marks=pytest.mark.slow)],
    ids=["loaded-journal", "engine"],
)
def test_other_scenes_have_the_rows_of_their_runs(text, tmp_path, capfd):
    sweep = make_sweep(write_scene(tmp_path, text), ["lubricants.oil.viscosity=0.02"])
    _, rows = sweep_inline(sweep, tmp_path / "swept")
    alone = write_scene(tmp_path, scene_text(sweep.cases[0].scene))
    assert ehd.read_scene(alone).tables == sweep.cases[0].scene.tables
    status, output, errors = exit_of(
        capfd, "run", alone, "-o", tmp_path / "out", "--no-plots", "--json"
    )
    assert status == 0, errors
    summary = json.loads(output)
    assert summary["steps"] == rows[0]["steps"]
    assert len(sweep.joints) == (3 if text == ENGINE else 1)
    for joint in sweep.joints:
        figures = summary["joints"][joint]
        for name in JOINT_FIGURES:
            # A pose found from a body's file is that found from its mesh but for round-off.
            expected = pytest.approx(figures[name], rel=1e-12) if figures[name] else None
            assert rows[0][f"{joint}.{name}"] == expected
    assert set(rows[0]) == set(rows_of(tmp_path / "swept")[0])


@pytest.mark.slow
def test_bodies_of_one_part_are_reduced_together_and_once(tmp_path):
    text = scene_as("slider-crank-paper", {"time.revolutions": 0.002, "time.tolerance": 1e-3})
    sweep = make_sweep(write_scene(tmp_path, text), ["method=rigid,m3", "residual_modes=16,31"])
    pool, rows = sweep_inline(sweep, tmp_path / "swept")
    assert [row["status"] for row in rows] == ["complete"] * 4
    (part,) = (task for task in pool.tasks if not isinstance(task, CaseTask))
    found = [body.settings.reduction for body in part.bodies]
    # What M3 keeps of 31 modes serves 16; the rigid part needs neither.
    assert [(r.method, r.residual_modes) for r in found] == [("m3", 31), ("m3", 16), ("rigid", 31)]
    bodies = {path: ehd.load_body(path) for path in (tmp_path / "swept" / "bodies").iterdir()}
    times = [float(body.provenance[PROCESSOR_SECONDS]) for body in bodies.values()]
    assert min(times) > 0
    # Another sweep in the same folder finds them.
    stamps = {path: path.stat().st_mtime_ns for path in bodies}
    with SweepFolder(tmp_path / "swept", sweep, overwrite=True) as folder:
        run_sweep(folder, again := Inline())
    assert again.cases == ["0001", "0002", "0003", "0004"]
    assert len(again.tasks) == 4
    assert stamps == {path: path.stat().st_mtime_ns for path in stamps}


def test_one_worker_finds_the_same_rows(scene, swept, tmp_path, capfd):
    values = given_values(["clearance=14e-6,3e-3", "smallest_film=0.01"])
    status, output, errors = exit_of(
        capfd, "sweep", scene, *values, "-o", tmp_path, "--workers", 1, "--json"
    )
    assert status == 1
    assert "FailedCasesError: 1 of 2 cases failed" in errors.splitlines()[-1]
    assert "Traceback" not in errors
    rows, whole = (results(rows_of(folder)) for folder in (tmp_path, swept))
    assert rows == {"1": whole["1"], "2": whole["5"] | {"case": "2"}}
    result = json.loads(output)
    assert (result["cases"], result["failed"]) == (2, 1)
    assert [row["case"] for row in result["rows"]] == [1, 2]
    assert result["rows"][0]["joints.big_end.clearance"] == 14e-6
    assert result["rows"][1]["steps"] is None
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"bodies", "manifest.txt", "outcomes.jsonl", "sweep.csv", "sweep.json"}


@pytest.mark.mpi
def test_several_ranks_are_refused(tmp_path, capfd):
    comm = MPI.COMM_WORLD
    if comm.size == 1:
        pytest.skip("one rank")
    path = comm.bcast(write_scene(tmp_path))
    options = (*given_values(["clearance=14e-6"]), "-o", comm.bcast(tmp_path) / "swept")
    status, _, errors = exit_of(capfd, "sweep", path, *options)
    assert status == 2
    assert comm.rank or f"runs on {comm.size} ranks, but cases are run" in errors
    assert not comm.rank or not errors


# What is there already


def test_only_what_is_missing_runs_again(scene, again):
    before = rows_of(again)
    path = again / "outcomes.jsonl"
    lines = path.read_text().splitlines(keepends=True)
    # A killed process may leave an incomplete line.
    path.write_text("".join(line for line in lines if '"case": "0003"' not in line) + lines[0][:50])
    pool, rows = sweep_inline(make_sweep(scene, SOME_FAIL), again)
    # What is complete stays as it is.
    assert pool.cases == ["0002", "0003", "0004", "0005", "0006"]
    assert [row["status"] for row in rows].count("complete") == 2
    assert results(rows_of(again)) == results(before)
    assert rows_of(again)[0] == before[0]


def test_complete_sweep_runs_nothing(scene, again, capfd):
    plan = make_sweep(scene, ["clearance=14e-6,17e-6"])
    with SweepFolder(again / "full", plan) as folder:
        for case in folder.cases.values():
            outcome = Outcome("complete", {"steps": 7, "energy_balance_error": math.nan})
            folder.add(case, CaseResult(outcome))
        folder.flush()
    status, output, _ = exit_of(
        capfd, "sweep", scene, "--set", "clearance=14e-6,17e-6", "-o", again / "full", "--resume"
    )
    assert status == 0
    rows = rows_of(again / "full")
    assert [(row["steps"], row["energy_balance_error"]) for row in rows] == [("7", "")] * 2
    assert not (again / "full" / "bodies").exists()
    assert output.splitlines()[0].split()[:2] == ["case", "joints.big_end.clearance"]
    assert output.splitlines()[1].split()[:2] == ["1", "1.4e-05"]


@pytest.mark.parametrize(
    ("text", "assignments", "named"),
    [
        (SLIDER_CRANK, ["clearance=14e-6,18e-6", SOME_FAIL[1]], "big_end.clearance is 1.4e-05, "),
        (THICKER, SOME_FAIL, "lubricants.oil.viscosity is 0.01"),
        (LOADED_JOURNAL, ["clearance=14e-6"], "to another study or sweep"),
    ],
    ids=["values", "scene file", "scene"],
)
def test_rows_of_another_sweep_are_refused_unless_overwritten(
    text, assignments, named, again, tmp_path
):
    plan = make_sweep(write_scene(tmp_path, text), assignments)
    with pytest.raises(OtherFolderError) as error:
        SweepFolder(again, plan)
    assert named in str(error.value)
    assert "--overwrite" in str(error.value)
    assert len(rows_of(again)) == 6
    (again / "runs" / "0001" / "mine.txt").write_text("of somebody else")
    with SweepFolder(again, plan, overwrite=True) as folder:
        assert folder.take_stock() == [*plan.cases]
    assert not (again / "sweep.csv").exists()
    left = [str(path.relative_to(again)) for path in (again / "runs").rglob("*") if path.is_file()]
    assert sorted(left) == ["runs/0001/mine.txt", "runs/manifest.txt"]
    assert list((again / "bodies").iterdir())


def test_changed_file_is_another_sweep_and_another_file_none(tmp_path):
    path = write_scene(tmp_path, LOADED_JOURNAL)
    sweep_inline(make_sweep(path, ["clearance=14e-6"]), tmp_path / "out")
    (tmp_path / "load.csv").write_text(LOAD.replace("1200", "1300"))
    for match in (r"forces\.load\.file is load\.csv", "to another study or sweep"):
        with pytest.raises(OtherFolderError, match=match):
            SweepFolder(tmp_path / "out", make_sweep(path, ["clearance=14e-6"]))
        (tmp_path / "out" / "sweep.json").write_text("[no sweep of ours\n")
