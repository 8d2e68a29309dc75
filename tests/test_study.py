"""Studies: what is compared with what, errors against known ones, rows that are not made again."""

import json
import shutil
import signal
import subprocess
import time
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from interrupt_case import heed_interrupt
from study_cases import COARSE, TINY, TOO_MANY, run_tiny
from sweep_cases import COMMAND, exit_of

from fenics_ehd.errors import InputError, InUseError, SettingsError
from fenics_ehd.output import read_history
from fenics_ehd.reduction import load_body
from fenics_ehd.settings import to_toml
from fenics_ehd.study import folder as study_folder
from fenics_ehd.study.curves import Reference, RunCurves
from fenics_ehd.study.errors_file import errors_path, read_errors
from fenics_ehd.study.film_check import finer
from fenics_ehd.study.folder import StudyFolder
from fenics_ehd.study.plan import REFERENCE, identity, make_study
from fenics_ehd.study.run import run_study
from fenics_ehd.study.scope import SCOPES
from fenics_ehd.study.table import COLUMNS, ERRORS, read_table
from fenics_ehd.study.variants import film, m4, steps
from fenics_ehd.study.work import RunTask
from fenics_ehd.sweeps.keys import with_values


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    """Folder, study and rows."""
    directory = tmp_path_factory.mktemp("study")
    study, _, rows = run_tiny(directory)
    return directory, study, rows


@pytest.fixture
def again(studied, tmp_path):
    """A copy of that folder to go on in."""
    return Path(shutil.copytree(studied[0], tmp_path / "again", symlinks=True))


def rows_of(rows, group):
    return {row["run"]: row for row in rows if row["group"] == group}


@pytest.mark.parametrize(("scene", "quick"), SCOPES)
def test_nothing_is_judged_by_itself(scene, quick):
    study = make_study(scene, quick=quick)
    runs = study.runs
    reference = runs[REFERENCE]
    for row in study.rows:
        assert row.run in runs
        for other in filter(None, (row.against, row.own)):
            assert runs[other].identity != runs[row.run].identity
    methods = {runs[row.run].case.settings.reduction.method for row in study.rows}
    assert methods >= {"m1", "m2", "m3", "m4", "full"}
    assert reference.case.settings.reduction.method == "full"
    tightest = min(run.case.settings.time.tolerance for run in runs.values())
    assert reference.case.settings.time.tolerance <= 10 * tightest
    assert set(study.checks) == {"step", "film", "basis"}


def test_full_studies_have_the_numbers_of_modes_of_the_paper():
    runs = make_study("slider-crank").runs
    for modes in (37, 67, 127):
        assert {f"m1-{modes}", f"m2-{modes}"} <= set(runs)
    for selection in ("largest-eigenvalue", "lowest-frequency", "smallest-eigenvalue"):
        assert {f"m3-pc1-{selection}-{n}" for n in (31, 61, 121)} <= set(runs)
    rotor = make_study("rotor").runs
    assert {"m1-30", "m2-50", "m3-pc1-largest-eigenvalue-40"} <= set(rotor)


def test_table_has_a_row_for_each_run_and_the_reasons_of_those_that_failed(studied):
    directory, study, rows = studied
    assert len(rows) == len(study.rows)
    failed = [row for row in rows if row["status"] != "complete"]
    assert [row["run"] for row in failed] == [TOO_MANY.name]
    assert failed[0]["status"].startswith("failed: SettingsError: residual_modes 500 is not")
    assert failed[0]["film_error_max"] is None
    assert read_table(directory / "table.csv") == rows
    assert set(rows[0]) == set(COLUMNS)


def test_rows_hold_the_figures_of_their_runs(studied):
    directory, study, rows = studied
    for row in rows:
        if row["status"] != "complete":
            continue
        folder = directory / "runs" / row["run"]
        summary = json.loads((folder / "summary.json").read_text())
        for ours, theirs in (
            ("coordinates", "modes"),
            ("method", "method"),
            ("steps", "steps"),
            ("newton_iterations", "newton_iterations"),
            ("online_s", "processor_time_s"),
        ):
            assert row[ours] == summary[theirs]
        assert row["highest_frequency_Hz"] == max(summary["frequencies_Hz"], default=0.0)
        history = read_history(folder)
        counted = history["basis_error_estimate_m"][history["time_s"] >= study.start]
        assert row["estimated_gap_error_m"] == counted.max()
        assert 0 < row["online_s"] <= row["online_wall_s"] + 0.1
        assert row["offline_s"] > 0
        assert load_body(folder / "body.h5").modes == row["coordinates"]
        assert (folder / "scene.toml").read_text() == to_toml(study.runs[row["run"]].case.settings)


def test_methods_are_ordered_as_they_are_rich(studied):
    methods = rows_of(studied[2], "methods")
    best, rich, poor, none = (
        methods[name]["film_error_max"]
        for name in ("m4-6-1e-04", "m3-pc1-largest-eigenvalue-20", "m1-10", "rigid")
    )
    assert best < rich < poor < none
    assert methods["m4-6-1e-04"]["true_gap_error_m"] < 0.02 * methods["rigid"]["true_gap_error_m"]


def test_errors_of_the_steps_fall_with_the_tolerance(studied):
    rows = rows_of(studied[2], "tolerance")
    loose, tight, finest = (
        rows["m4-6-1e-04-tol-1e-03"],
        rows["m4-6-1e-04"],
        rows["m4-6-1e-04-finest"],
    )
    assert loose["order"] == 2
    assert finest["order"] == 3
    assert tight["own_pressure_error_l2"] < loose["own_pressure_error_l2"]
    # With very fine steps what is left of M4's error is its basis, far below the steps' part.
    assert finest["film_error_max"] < 0.2 * tight["own_film_error_max"]


def test_film_meshes_are_measured_against_the_finest_of_the_same_body(studied):
    rows = list(rows_of(studied[2], "film").values())
    assert [row["film_cells"] for row in rows] == ["10x2", "20x4", "40x8"]
    assert len({row["body"] for row in rows}) == 1
    assert [row["against"] for row in rows] == [rows[-1]["run"]] * 2 + [None]
    assert rows[1]["pressure_error_l2"] < 0.5 * rows[0]["pressure_error_l2"]
    assert rows[0]["film_floor"] == rows[1]["film_error_max"]


def test_reference_has_its_own_errors_and_they_are_the_floors(studied):
    directory, _, rows = studied
    found = json.loads((directory / "reference.json").read_text())
    assert found["method"] == "full"
    assert found["film_cells"] == "10x2"
    assert found["coordinates"] + found["dropped_columns"] == 2 + 8 + found["pressure_columns"]
    floors = {
        (row["pressure_floor"], row["film_floor"]) for row in rows_of(rows, "methods").values()
    }
    own = [
        max(found[kind][name] for kind in ("step", "basis"))
        for name in ("pressure_max", "film_max")
    ]
    assert floors == {tuple(own), (None, None)}
    assert 0 < found["step"]["film_l2"] <= found["step"]["film_max"] < 1e-2
    assert found["film"]["film_max"] > found["step"]["film_max"]


def curves_of(folder, study, name, kind=RunCurves):
    run = study.runs[name]
    return kind(
        folder / "runs" / name, run.case.settings, load_body(folder / "runs" / name / "body.h5")
    )


def test_a_run_has_no_error_against_itself(studied):
    directory, study, _ = studied
    errors = curves_of(directory, study, REFERENCE, Reference).errors(
        curves_of(directory, study, REFERENCE), study.start
    )
    # The table of a history has ten digits.
    assert max(errors.relative().values()) < 1e-9
    assert errors.gap < 1e-18


def test_known_errors_are_found(studied, again):
    _, study, _ = studied
    reference = curves_of(again, study, REFERENCE, Reference)
    folder = again / "runs" / "changed"
    shutil.copytree(again / "runs" / REFERENCE, folder, symlinks=True)
    history = read_history(folder)
    # Half of the pressures 2 % up, the film 3 % down, the shaft moved by 2 nm along x.
    later = history["time_s"] >= study.start
    raised = history["time_s"] > history["time_s"][later].mean()
    history["max_pressure_Pa"] = history["max_pressure_Pa"] * np.where(raised, 1.02, 1.0)
    history["min_film_thickness_m"] = history["min_film_thickness_m"] * 0.97
    rows = np.array(list(history.values())).T
    lines = [",".join(history), *(",".join(map(repr, row)) for row in rows.tolist())]
    (folder / "history.csv").write_text("\n".join(lines) + "\n")
    with h5py.File(folder / "history.h5", "r+") as file:
        file["coordinates"][:, 0] += 2e-9
    run = study.runs[REFERENCE]
    changed = RunCurves(folder, run.case.settings, load_body(folder / "body.h5"))
    errors = reference.errors(changed, study.start)
    exact = reference.pressure[later]
    largest = 0.02 * exact[raised[later]].max() / exact.max()
    assert errors.pressure_max == pytest.approx(largest, rel=1e-6)
    assert 0 < errors.pressure_l2 < 0.02
    assert errors.film_max == pytest.approx(0.03, rel=1e-6)
    assert errors.film_l2 == pytest.approx(0.03, rel=1e-6)
    assert errors.gap == pytest.approx(2e-9, rel=1e-6)


def test_finished_runs_are_not_run_again(studied, again):
    _, study, rows = studied
    _, pool, repeated = run_tiny(again)
    # Only the body that failed.
    assert [task.name for task in pool.tasks] == [study.runs[TOO_MANY.name].body]
    assert repeated == rows


def test_only_what_changed_or_is_missing_runs_again(again):
    shutil.rmtree(again / "runs" / "rigid")
    study = make_study("slider-crank", scope=TINY)
    name = "m1-10"
    settings = with_values(study.runs[name].case.settings, steps(2e-4))
    changed = replace(
        study.runs[name],
        case=replace(study.runs[name].case, settings=settings),
        identity=identity(settings),
    )
    study = replace(study, runs=study.runs | {name: changed})
    _, pool, rows = run_tiny(again, study)
    ran = {task.run.name for task in pool.tasks if isinstance(task, RunTask)}
    assert ran == {"rigid", name}
    assert rows_of(rows, "methods")[name]["tolerance"] == 2e-4
    calls = json.loads((again / "study.json").read_text())["calls"]
    # Those two, and the one that failed is tried again.
    assert [each["runs"] for each in calls] == [len(study.runs), 3]


def test_a_failed_reference_leaves_rows_without_errors(studied, tmp_path):
    scope = replace(TINY, methods=(m4(6),), stepped=(), meshed=(), reference=TOO_MANY)
    _, _, rows = run_tiny(tmp_path, make_study("slider-crank", scope=scope))
    row = rows_of(rows, "methods")["m4-6-1e-04"]
    assert row["status"] == "complete"
    assert row["steps"] > 0
    assert [row[name] for name in (*ERRORS, "film_floor")] == [None] * 5
    found = json.loads((tmp_path / "reference.json").read_text())
    assert found["step"]["film_max"] is None
    assert found["step"]["why"].startswith("reference-step: failed: SettingsError")


def test_folder_of_another_scene_or_process_is_refused(studied, tmp_path):
    directory, study, _ = studied
    with pytest.raises(InputError, match=r"scene = slider-crank there, rotor here"):
        StudyFolder(directory, make_study("rotor"))
    (tmp_path / "study.json").write_text("[]")
    with pytest.raises(InputError, match="unreadable"):
        StudyFolder(tmp_path, study)
    with StudyFolder(directory, study), pytest.raises(InUseError):
        StudyFolder(directory, study)


@pytest.mark.parametrize("start", [1e-3, 2e-4])
def test_a_scene_that_ends_before_enough_errors_count_is_refused(start):
    # The second one leaves 5e-5 s, less than its largest step of 7e-5 s.
    scope = replace(TINY, start=start)
    with pytest.raises(SettingsError, match=r"mechanism.revolutions = 0.02 ends at 0.000251 s"):
        make_study("slider-crank", scope=scope)


def test_lost_bodies_and_histories_are_made_again(again):
    for body in again.glob("bodies/*.h5"):
        body.unlink()
    (again / "runs" / "rigid" / "history.csv").unlink()
    _, pool, rows = run_tiny(again)
    assert [task.run.name for task in pool.tasks if isinstance(task, RunTask)] == ["rigid"]
    assert len(list(again.glob("bodies/*.h5"))) == 6
    assert rows_of(rows, "methods")["rigid"]["film_error_max"] > 0


def ran(pool):
    return {task.run.name for task in pool.tasks if isinstance(task, RunTask)}


def shorten(path, share):
    """Cut a file off, as a full disk or a lost machine leaves it."""
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])


def cut_history(folder):
    """Both files of a history to four steps: each can be read."""
    lines = (folder / "history.csv").read_text().splitlines(keepends=True)
    (folder / "history.csv").write_text("".join(lines[:5]))
    with h5py.File(folder / "history.h5", "r+") as file:
        for name in ("coordinates", "rates", "pressure_Pa"):
            file[name].resize(4, axis=0)


def test_damaged_runs_and_bodies_are_made_again(studied, again):
    _, study, rows = studied
    runs = again / "runs"
    (runs / "rigid" / "history.h5").unlink()
    shorten(runs / "m3-pc1-largest-eigenvalue-20" / "history.h5", 0.5)
    shorten(runs / "m4-6-1e-04" / "history.csv", 0.5)
    cut_history(runs / "m1-10")
    shorten(again / "bodies" / f"{study.runs['rigid'].body}.h5", 0.9)
    shorten(again / "bodies" / f"{study.runs[REFERENCE].body}.h5", 0.9)
    _, pool, repeated = run_tiny(again)
    assert ran(pool) == {"rigid", "m3-pc1-largest-eigenvalue-20", "m4-6-1e-04", "m1-10"}
    assert [row["status"] for row in repeated] == [row["status"] for row in rows]
    for row, before in zip(repeated, rows, strict=True):
        assert row["film_error_max"] == pytest.approx(before["film_error_max"], rel=1e-3)


def test_damage_that_shows_in_the_comparison_is_a_row(again, monkeypatch):
    # As if the files were lost while the study goes on, after they were looked at.
    monkeypatch.setattr(study_folder, "_whole", lambda directory, outcome: True)
    (again / "runs" / "rigid" / "history.h5").unlink()
    _, _, rows = run_tiny(again)
    methods = rows_of(rows, "methods")
    assert methods["rigid"]["status"].startswith("failed: InputError")
    assert methods["rigid"]["film_error_max"] is None
    assert methods["m1-10"]["film_error_max"] > 0
    assert read_table(again / "table.csv") == rows
    monkeypatch.undo()
    _, pool, rows = run_tiny(again)
    assert ran(pool) == {"rigid"}
    assert rows_of(rows, "methods")["rigid"]["film_error_max"] > 0


def test_a_damaged_reference_is_the_one_that_failed(again, monkeypatch):
    monkeypatch.setattr(study_folder, "_whole", lambda directory, outcome: True)
    cut_history(again / "runs" / REFERENCE)
    study = make_study("slider-crank", scope=TINY)
    _, _, rows = run_tiny(again)
    failed = {row["run"] for row in rows if row["status"] != "complete"}
    assert failed == {REFERENCE, TOO_MANY.name}
    assert "fewer than two steps after 0.0001 s" in rows[0]["status"]
    assert {row["film_error_max"] for row in rows if row["against"] == REFERENCE} == {None}
    found = json.loads((again / "reference.json").read_text())
    assert found["basis"]["why"].startswith("reference: failed: InputError")
    with StudyFolder(again, study) as folder:
        # What the next call of the program goes by.
        assert folder.outcome(study.runs[REFERENCE]).status == rows[0]["status"]


def test_errors_over_time_are_kept_beside_the_runs(studied, again):
    directory, study, rows = studied
    compared = [row for row in rows if row["film_error_max"] is not None]
    paths = {
        errors_path(Path("runs", row["run"]), against)
        for row in compared
        for against in filter(None, (row["against"], study.rows[rows.index(row)].own))
        if against != row["run"]
    }
    assert {path.relative_to(directory) for path in directory.glob("runs/*/errors-*")} == paths
    for row in compared:
        folder = directory / "runs" / row["run"]
        found = read_errors(errors_path(folder, row["against"]))
        steps_of = read_history(folder)["time_s"]
        np.testing.assert_array_equal(found["time_s"], steps_of[steps_of >= study.start])
        for name in ("pressure_error", "film_error"):
            assert np.abs(found[name]).max() == row[f"{name}_max"]
    path = errors_path(again / "runs" / "rigid", REFERENCE)
    before = path.read_bytes()
    path.with_name("errors-gone.npz").write_bytes(before)
    shorten(path, 0.5)
    with pytest.raises(InputError, match="not the errors of a run"):
        read_errors(path)
    run_tiny(again)
    assert path.read_bytes() == before
    assert not path.with_name("errors-gone.npz").exists()


class Interrupted:
    """A pool that is interrupted before anything is done."""

    width = 1

    def submit(self, function, task):
        raise KeyboardInterrupt


def test_tables_are_those_of_the_study_from_the_beginning(studied, again):
    _, study, rows = studied
    shutil.rmtree(again / "runs" / "rigid")
    with StudyFolder(again, study) as folder, pytest.raises(KeyboardInterrupt):
        run_study(study, folder, Interrupted())
    found = read_table(again / "table.csv")
    assert [(row["run"], row["group"]) for row in found] == [(r["run"], r["group"]) for r in rows]
    missing = {row["run"]: row for row in found if row["status"] == "not run"}
    assert set(missing) == {"rigid", TOO_MANY.name}
    assert missing["rigid"]["method"] == "rigid"
    assert missing["rigid"]["steps"] is None
    assert found[1] == rows[1]


def test_overwriting_forgets_tables_and_report_too(studied, again):
    study = studied[1]
    (again / "figures").mkdir()
    for name in ("report.html", "report.md", "statements.csv", "figures/a.png"):
        (again / name).write_text("of the former study")
    with StudyFolder(again, study, overwrite=True) as folder:
        assert {path.name for path in again.iterdir()} == {"bodies", "study.lock"}
        with pytest.raises(KeyboardInterrupt):
            run_study(study, folder, Interrupted())
    assert {row["status"] for row in read_table(again / "table.csv")} == {"not run"}
    assert json.loads((again / "reference.json").read_text())["status"] == "not run"


def test_overwriting_leaves_figures_of_something_else_alone(studied, tmp_path):
    (tmp_path / "figures").mkdir()
    with StudyFolder(tmp_path, studied[1], overwrite=True):
        assert (tmp_path / "figures").exists()


@pytest.mark.parametrize(
    ("values", "cells"),
    [
        ({}, (30, 7)),
        ({"film.cells": (12, 3)}, (30, 7)),
        ({"film.cells": (30, 7)}, (45, 11)),
        ({"film.cells": (60, 15)}, (90, 23)),
        ({"rod.geometry": {"bore_cells_around": 40}}, (60, 8)),
        ({"rod.geometry": {"bore_cells_around": 40}, "rod.cells": "tet"}, (30, 7)),
    ],
)
def test_film_mesh_is_checked_by_a_finer_one(values, cells, tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(to_toml(with_values(make_study("slider-crank").settings, values)))
    study = make_study(str(path), quick=True)
    check = study.checks["film"]
    assert study.runs[check.run].case.settings.film.cells == cells
    assert f"film.cells = {cells}" in check.meaning


@pytest.mark.parametrize("scene_quick", SCOPES)
def test_checks_of_the_scopes_are_finer_already(scene_quick):
    study = make_study(scene_quick[0], quick=scene_quick[1])
    asked = SCOPES[scene_quick].film_check["film.cells"]
    assert finer(asked, (20, 5))
    assert study.runs[study.checks["film"].run].case.settings.film.cells == asked


def test_between_steps_a_curve_of_maxima_has_an_error_that_is_estimated(studied):
    directory, study, _ = studied
    reference = curves_of(directory, study, REFERENCE, Reference)
    assert reference.interpolation_error(study.start) == 0
    exact = reference._pressures
    finest = curves_of(directory, study, "m3-pc1-largest-eigenvalue-20-film-40x8", Reference)
    assert finest.interpolation_error(study.start) > 0
    # A curve of which each third step is known, and all that is between.
    few = curves_of(directory, study, REFERENCE, Reference)
    few._nodal = False
    few.times, few.pressure = few.times[::3], few.pressure[::3]
    inside = (reference.times >= study.start) & (reference.times <= few.times[-1])
    times = reference.times[inside]
    true = np.abs(few._pressures(times)[:, 0] - exact(times).max(axis=1)).max()
    true /= few.pressure[few.times >= study.start].max()
    assert true <= few.interpolation_error(study.start) <= 30 * true


def test_film_of_other_cells_than_the_bore_has_a_floor_for_its_interpolation(tmp_path):
    scope = replace(
        TINY,
        settings={**TINY.settings, "film.cells": (12, 3)},
        methods=(m4(6),),
        stepped=(),
        meshed=(),
        film_check=film(12, 3) | steps(1e-4),
    )
    _, _, rows = run_tiny(tmp_path, make_study("slider-crank", scope=scope))
    found = json.loads((tmp_path / "reference.json").read_text())
    assert found["film"]["how"].startswith("with film.cells = (18, 5)")
    between = found["pressure_interpolation_error"]
    assert 0 < between < 0.05
    row = rows_of(rows, "methods")["m4-6-1e-04"]
    own = max(found[kind]["pressure_max"] for kind in ("step", "basis"))
    assert row["pressure_floor"] == max(between, own)


def test_a_film_check_that_is_not_finer_shows_nothing(studied, again):
    study = studied[1]
    check = replace(study.checks["film"], run=study.checks["basis"].run)
    run_tiny(again, replace(study, checks=study.checks | {"film": check}))
    found = json.loads((again / "reference.json").read_text())["film"]
    assert found["film_max"] is None
    assert found["why"] == "reference-basis: its film of 10x2 cells is not finer than 10x2"


def test_table_of_something_else_is_refused(tmp_path):
    (tmp_path / "table.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="its columns are others"):
        read_table(tmp_path / "table.csv")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["loaded-journal"], "scene loaded-journal: there is no study of it"),
        (["gearbox"], "scene 'gearbox'"),
        (["slider-crank", "--workers", "0"], "--workers"),
    ],
)
def test_bad_input_is_one_line(arguments, message, tmp_path, capfd):
    status, _, errors = exit_of(capfd, "study", *arguments, "-o", tmp_path / "out")
    assert status == 2
    assert message in errors
    assert "Traceback" not in errors
    assert not (tmp_path / "out").exists()


def short_scene(directory, **time):
    """A coarse rod over a small part of a revolution, as a scene file."""
    values = {"mechanism.revolutions": 0.03, "rod.geometry": COARSE, "time.largest_step": 2.5}
    settings = make_study("slider-crank").settings
    values |= {f"time.{name}": value for name, value in time.items()}
    path = directory / "scene.toml"
    path.write_text(to_toml(with_values(settings, values)))
    return path


@pytest.mark.slow
def test_command_ends_with_an_error_if_nothing_can_be_compared(tmp_path, capfd):
    # No step may be as short as the first one: every run fails at once.
    scene = short_scene(tmp_path, smallest_step=1e-5)
    arguments = ("study", scene, "--quick", "--no-report", "--json", "-o", tmp_path / "out")
    status, output, errors = exit_of(capfd, *arguments)
    assert status == 1
    assert "nothing was compared: failed: SettingsError: time.smallest_step = 1e-05" in errors
    rows = json.loads(output)["rows"]
    assert {row["status"][:7] for row in rows} == {"failed:"}


@pytest.mark.slow
def test_interrupted_study_goes_on(tmp_path):
    scene, folder = short_scene(tmp_path), tmp_path / "out"
    arguments = [*COMMAND, "study", scene, "--quick", "--workers", "2", "-o", folder]
    process = subprocess.Popen(
        arguments,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed_interrupt,
    )
    deadline = time.monotonic() + 120
    while len(list(folder.glob("runs/*/summary.json"))) < 4 and process.poll() is None:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert process.poll() is None, "the study was over before it was interrupted"
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    assert errors.splitlines()[-1] == "fenics-ehd: interrupted"
    done = {path: path.stat().st_mtime_ns for path in folder.glob("runs/*/outcome.json")}
    assert 4 <= len(done) < len(make_study("slider-crank", quick=True).runs)
    result = subprocess.run(arguments, capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stderr
    assert "ends in" in result.stderr
    assert all(path.stat().st_mtime_ns == before for path, before in done.items())
    rows = read_table(folder / "table.csv")
    assert {row["status"] for row in rows} == {"complete"}
    lines = result.stdout.splitlines()
    assert len(lines) == 1 + len(rows) + 2
    assert lines[-1] == f"report in {folder / 'report.html'}"
    assert (folder / "report.html").is_file()
    assert lines[0].split()[:3] == ["group", "run", "modes"]
    measured = {row["run"]: row["film_error_l2"] for row in rows if row["group"] == "methods"}
    assert measured["m4-6-1e-04"] < measured["m3-pc2-lowest-frequency-31"] < measured["m1-37"]
