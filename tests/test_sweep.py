"""Rows of a sweep: where they come from, what becomes of those that are there already."""

import json
import shutil
from pathlib import Path

import pytest
from mpi4py import MPI
from sweep_cases import (
    LOAD_FILE,
    LOADED_JOURNAL,
    ROTOR,
    SLIDER_CRANK,
    SOME_FAIL,
    call,
    exit_of,
    given_values,
    results,
    rows_of,
    sweep_inline,
    write_scene,
)

from fenics_ehd.errors import InputError, InUseError
from fenics_ehd.sweeps.errors import OtherSweepError
from fenics_ehd.sweeps.plan import make_plan
from fenics_ehd.sweeps.table import FIGURES, SweepTable


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return write_scene(tmp_path_factory.mktemp("scene"))


@pytest.fixture(scope="module")
def swept(scene, tmp_path_factory):
    """Folder of a sweep by two processes, histories kept; some cases cannot run."""
    directory = tmp_path_factory.mktemp("swept")
    result = call(
        "sweep", scene, *given_values(SOME_FAIL), "-o", directory, "--workers", 2, "--keep"
    )
    assert result.returncode == 1, result.stderr
    assert "FailedCasesError: 4 of 6 cases failed" in result.stderr.splitlines()[-1]
    assert "Traceback" not in result.stderr
    return directory


@pytest.fixture
def again(swept, tmp_path):
    """A copy of that folder to go on in."""
    return Path(shutil.copytree(swept, tmp_path / "again"))


def test_failures_are_rows(swept):
    rows = results(rows_of(swept))
    assert sorted(rows) == list("123456")
    assert {case for case, row in rows.items() if row["status"] == "complete"} == {"1", "3"}
    assert rows["5"]["status"].startswith("failed: SettingsError: bearing.clearance = 0.002")
    assert rows["2"]["status"].startswith("failed: SettingsError: time.smallest_step = 1e-05 s")
    assert rows["2"]["max_pressure_Pa"] == ""
    assert rows["1"]["bearing.clearance"] == "1.4e-05"
    assert float(rows["1"]["max_pressure_Pa"]) != float(rows["3"]["max_pressure_Pa"])


def test_folder_has_one_body_and_the_histories(swept):
    assert len(list((swept / "bodies").iterdir())) == 1
    histories = sorted(path.parent.name for path in swept.glob("runs/*/history.h5"))
    assert histories == ["0001", "0003"]
    names = {path.name for path in (swept / "runs" / "0003").iterdir()}
    assert names == {"history.csv", "history.h5", "summary.json", "scene.toml", "body.h5"}


def test_kept_case_is_a_run_to_animate_and_to_repeat(swept, tmp_path, capfd):
    kept = swept / "runs" / "0003"
    picture = tmp_path / "moving.gif"
    status, _, errors = exit_of(capfd, "animate", kept, "--frames", 3, "-o", picture)
    assert status == 0, errors
    assert picture.stat().st_size > 1000
    status, _, errors = exit_of(
        capfd, "run", kept / "scene.toml", "--body", kept / "body.h5", "-o", tmp_path, "--no-plots"
    )
    assert status == 0, errors
    assert (tmp_path / "history.csv").read_text() == (kept / "history.csv").read_text()


def test_row_is_that_of_a_run_on_its_own(swept, tmp_path, capfd):
    alone = write_scene(tmp_path, SLIDER_CRANK + "[bearing]\nclearance = 14e-6\n")
    status, _, errors = exit_of(capfd, "run", alone, "-o", tmp_path / "out", "--no-plots")
    assert status == 0, errors
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    kept = json.loads((swept / "runs" / "0001" / "summary.json").read_text())
    row = results(rows_of(swept))["1"]
    # The worker that runs loads a body, and no Gmsh.
    timed = ("reduction_time_s", "wall_time_s", "processor_time_s", "versions")
    assert {k: v for k, v in kept.items() if k not in timed} == {
        k: v for k, v in summary.items() if k not in timed
    }
    for name in set(FIGURES) - set(timed):
        assert row[name] == ("" if summary[name] is None else json.dumps(summary[name]))
    ours, theirs = (d / "history.csv" for d in (tmp_path / "out", swept / "runs" / "0001"))
    assert ours.read_text() == theirs.read_text()


@pytest.mark.parametrize(
    ("text", "assignment"),
    [
        (ROTOR, "viscosity=0.02"),
        (LOADED_JOURNAL, "viscosity=0.02"),
    ],
    ids=["rotor", "loaded-journal"],
)
def test_other_scenes_have_the_rows_of_their_runs(text, assignment, tmp_path, capfd):
    plan = make_plan(write_scene(tmp_path, text), [assignment])
    _, rows = sweep_inline(plan, tmp_path / "swept")
    alone = write_scene(tmp_path, text + f"[bearing]\n{assignment}\n")
    status, output, errors = exit_of(
        capfd, "run", alone, "-o", tmp_path / "out", "--no-plots", "--json"
    )
    assert status == 0, errors
    summary = json.loads(output)
    for name in ("status", "max_pressure_Pa", "min_film_thickness_m", "steps"):
        assert rows[0][name] == summary[name]


def test_one_worker_finds_the_same_rows(scene, swept, tmp_path, capfd):
    values = given_values(SOME_FAIL)
    status, output, _ = exit_of(
        capfd, "sweep", scene, *values, "-o", tmp_path, "--workers", 1, "--json"
    )
    assert status == 1
    assert results(rows_of(tmp_path)) == results(rows_of(swept))
    result = json.loads(output)
    assert (result["cases"], result["failed"]) == (6, 4)
    assert [row["case"] for row in result["rows"]] == [1, 2, 3, 4, 5, 6]
    assert result["rows"][0]["bearing.clearance"] == 14e-6
    assert result["rows"][1]["steps"] is None
    assert not (tmp_path / "runs").exists()


@pytest.mark.mpi
def test_processes_and_ranks_find_the_rows_of_this_process(tmp_path, capfd):
    comm = MPI.COMM_WORLD
    directory = comm.bcast(tmp_path)
    path = comm.bcast(write_scene(tmp_path))
    assignments = ["clearance=14e-6,17e-6", "viscosity=0.01,0.02"]
    status, _, errors = exit_of(
        capfd, "sweep", path, *given_values(assignments), "-o", directory / "swept"
    )
    assert status == 0, errors
    if comm.rank == 0:
        sweep_inline(make_plan(path, assignments), directory / "inline")
        assert results(rows_of(directory / "swept")) == results(rows_of(directory / "inline"))
    comm.barrier()


# What is there already


def test_only_what_is_missing_runs_again(scene, again):
    plan = make_plan(scene, SOME_FAIL)
    lines = (again / "sweep.csv").read_text().splitlines(keepends=True)
    without = [line for line in lines if not line.startswith("3,")]
    (again / "sweep.csv").write_text("".join(without))
    pool, rows = sweep_inline(plan, again)
    assert pool.cases == [2, 3, 4, 5, 6]
    assert [row["status"] for row in rows].count("complete") == 2
    assert (again / "sweep.csv").read_text().startswith("".join(without))  # nothing is rewritten
    assert len(rows_of(again)) == 5 + 5


def test_torn_row_is_run_again(scene, again):
    text = (again / "sweep.csv").read_text()
    row = next(line for line in text.splitlines() if line.startswith("1,"))
    others = text.replace(row + "\n", "")
    (again / "sweep.csv").write_text(others + row[:30])
    pool, _ = sweep_inline(make_plan(scene, SOME_FAIL), again)
    assert 1 in pool.cases
    assert 3 not in pool.cases
    assert results(rows_of(again))["1"]["status"] == "complete"


def test_complete_sweep_runs_nothing(scene, swept, again, capfd):
    rows = [row for row in rows_of(swept) if row["status"] == "complete"]
    plan = make_plan(scene, ["clearance=14e-6,17e-6"])
    figures = {name: json.loads(rows[0][name] or "null") for name in FIGURES}
    with SweepTable(again / "full", plan) as table:
        for case in plan.cases:
            table.add(case, "complete", {k: v for k, v in figures.items() if v is not None})
    status, output, _ = exit_of(
        capfd, "sweep", scene, "--set", "clearance=14e-6,17e-6", "-o", again / "full", "--resume"
    )
    assert status == 0
    assert len(rows_of(again / "full")) == 2
    assert not (again / "full" / "bodies").exists()
    assert output.splitlines()[0].split()[:2] == ["case", "bearing.clearance"]
    assert output.splitlines()[1].split()[:2] == ["1", "1.4e-05"]


@pytest.mark.parametrize(
    ("text", "assignments", "named"),
    [
        (SLIDER_CRANK, ["clearance=14e-6,18e-6", SOME_FAIL[1]], "bearing.clearance = 1.4e-05, "),
        (SLIDER_CRANK + "[bearing]\nviscosity = 0.02\n", SOME_FAIL, "bearing.viscosity = 0.01"),
        (LOADED_JOURNAL, ["clearance=14e-6"], "belongs to another sweep"),
    ],
    ids=["values", "scene file", "scene"],
)
def test_rows_of_another_sweep_are_refused_unless_overwritten(
    text, assignments, named, again, tmp_path
):
    plan = make_plan(write_scene(tmp_path, text), assignments)
    with pytest.raises(OtherSweepError) as error:
        SweepTable(again, plan)
    assert named in str(error.value)
    assert "--overwrite" in str(error.value)
    assert len(rows_of(again)) == 6
    with SweepTable(again, plan, overwrite=True) as table:
        assert table.rows() == []
    assert rows_of(again) == []
    assert not list((again / "runs").iterdir())
    assert list((again / "bodies").iterdir())


@pytest.mark.parametrize("damage", ["sweep.json", "sweep.csv", "row"])
def test_rows_that_are_no_sweeps_are_refused(damage, scene, again):
    plan = make_plan(scene, SOME_FAIL)
    if damage == "row":
        with open(again / "sweep.csv", "a") as file:
            file.write("9,1e-5,complete\n")
    else:
        (again / damage).write_text("[no sweep of ours\n")
    before = (again / "sweep.csv").read_bytes()
    with pytest.raises(OtherSweepError):
        SweepTable(again, plan)
    assert (again / "sweep.csv").read_bytes() == before


def test_changed_file_is_another_sweep(tmp_path):
    path = write_scene(tmp_path, LOADED_JOURNAL)
    SweepTable(tmp_path / "out", make_plan(path, ["clearance=14e-6"])).__exit__(None, None, None)
    (tmp_path / "load.csv").write_text(LOAD_FILE.replace("1200", "1300"))
    with pytest.raises(OtherSweepError, match=r"load\.file = load\.csv"):
        SweepTable(tmp_path / "out", make_plan(path, ["clearance=14e-6"]))


def test_two_sweeps_do_not_share_a_folder(scene, again):
    plan = make_plan(scene, SOME_FAIL)
    with SweepTable(again, plan), pytest.raises(InUseError):
        SweepTable(again, plan)


def test_resume_needs_a_sweep(scene, tmp_path):
    with pytest.raises(InputError, match="nothing to resume"):
        SweepTable(tmp_path, make_plan(scene, SOME_FAIL), resume=True)
