"""Studies: what is compared with what, errors against known ones, rows that are not made again."""

import csv
import json
import re
import shutil
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import exit_of
from csv_history import edited, read_history
from study_cases import COARSE, SCENE, START, TINY, TOO_MANY, run_tiny, tiny_study
from sweep_cases import Inline, scene_as, sweep_inline

import fenics_ehd as ehd
from fenics_ehd.base import progress
from fenics_ehd.base.extremes import FilmRows
from fenics_ehd.base.files import claim
from fenics_ehd.scenes.films import planned_cells
from fenics_ehd.scenes.library import shipped_names
from fenics_ehd.scenes.scene import scene_text
from fenics_ehd.study.compare import (
    COLUMNS,
    ERROR_COLUMNS,
    StoredRun,
    StudyFolder,
    errors_path,
    read_errors,
    run_study,
)
from fenics_ehd.study.plan import REFERENCE, film, full, m3, m4, make_study, rigid, steps
from fenics_ehd.study.sweep import make_sweep
from fenics_ehd.study.worker import CaseTask


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


def read_table(directory):
    """Rows of a table, numbers as numbers."""

    def value(cell):
        try:
            return json.loads(cell)
        except ValueError:
            return cell or None

    with open(directory / "table.csv", newline="") as file:
        return [{n: value(cell) for n, cell in row.items()} for row in csv.DictReader(file)]


#: Without a part to reduce.
RIGID_ONES = ("loaded-journal", "loaded-journal-starved", "four-bar", "rotor-two-bearings")
STUDIED = [name for name in shipped_names() if name not in RIGID_ONES]


@pytest.mark.parametrize("scene", STUDIED)
@pytest.mark.parametrize("quick", [False, True])
def test_nothing_is_judged_by_itself(scene, quick):
    study = make_study(scene, quick=quick)
    assert study.start == (0.0 if study.scene.time.periodic else 0.02 * study.scene.span)
    for row in study.rows:
        assert row.run in study.cases
        for other in filter(None, (row.against, row.fine_run)):
            assert study.cases[other].identity != study.cases[row.run].identity
    reductions = {
        name: {body.settings.reduction for body in case.bodies.values()}
        for name, case in study.cases.items()
    }
    # Every part of a scene is reduced alike, for any keys of the scene.
    methods = {row.run: {r.method for r in reductions[row.run]} for row in study.rows}
    assert all(len(found) == 1 for found in methods.values())
    assert set.union(*methods.values()) >= {"m1", "m2", "m3", "m4", "full"}
    assert methods[REFERENCE] == {"full"}
    tightest = min(case.scene.time.tolerance for case in study.cases.values())
    assert study.cases[REFERENCE].scene.time.tolerance <= 10 * tightest
    assert set(study.checks) == {"step", "film", "basis"}


@pytest.mark.slow
def test_table_has_a_row_for_each_run_and_the_reasons_of_those_that_failed(studied):
    directory, study, rows = studied
    assert len(rows) == len(study.rows)
    failed = [row for row in rows if row["status"] != "complete"]
    assert [row["run"] for row in failed] == [TOO_MANY.name]
    assert failed[0]["status"].startswith("failed: SettingsError: residual_modes 500 is not")
    assert failed[0]["film_error_max"] is None
    assert read_table(directory) == rows
    assert set(rows[0]) == set(COLUMNS)


@pytest.mark.slow
def test_rows_hold_the_figures_of_their_runs(studied):
    directory, study, rows = studied
    for row in rows:
        if row["status"] != "complete":
            continue
        folder = directory / "runs" / row["run"]
        summary = json.loads((folder / "summary.json").read_text())
        for ours, expected in (
            ("steps", "steps"),
            ("newton_iterations", "newton_iterations"),
            ("online_s", "processor_time_s"),
        ):
            assert row[ours] == summary[expected]
        assert {"method": row["method"], "modes": row["coordinates"]} == summary["bodies"]["rod"]
        result = ehd.load_results(folder, films=False)
        counted = result.joints["big_end"].basis_error_estimate[result.time >= study.start]
        assert row["estimated_gap_error_m"] == counted.max()
        assert 0 < row["online_s"] <= row["online_wall_s"] + 0.1
        assert row["offline_s"] > 0
        body = ehd.load_body(folder / "body-rod.h5")
        assert body.modes == row["coordinates"]
        assert row["highest_frequency_Hz"] == body.frequencies.max(initial=0.0)
        assert (folder / "body-rod.h5").samefile(directory / "bodies" / f"{row['body']}.h5")
        assert (folder / "scene.toml").read_text() == scene_text(study.cases[row["run"]].scene)


@pytest.mark.slow
def test_methods_steps_and_meshes_are_ordered_as_they_are_rich(studied):
    methods = rows_of(studied[2], "methods")
    best, rich, poor, none = (
        methods[name]["film_error_max"]
        for name in ("m4-6-2e-03", "m3-pc1-largest-eigenvalue-20", "m1-10", "rigid")
    )
    assert best < rich < poor < none
    assert methods["m4-6-2e-03"]["true_gap_error_m"] < 0.02 * methods["rigid"]["true_gap_error_m"]
    tolerances = rows_of(studied[2], "tolerance")
    loose, tight, finest = (tolerances[f"m4-6-2e-03{end}"] for end in ("-tol-1e-03", "", "-finest"))
    assert tight["own_pressure_error_l2"] < loose["own_pressure_error_l2"]
    # With very fine steps what is left of M4's error is its basis, far below the steps' part.
    assert finest["film_error_max"] < 0.2 * tight["own_film_error_max"]
    # Film meshes are measured against the finest of the same body.
    rows = list(rows_of(studied[2], "film").values())
    assert [row["film_cells"] for row in rows] == ["10x2", "20x4", "40x8"]
    assert len({row["body"] for row in rows}) == 1
    assert [row["against"] for row in rows] == [rows[-1]["run"]] * 2 + [None]
    assert rows[1]["pressure_error_l2"] < 0.5 * rows[0]["pressure_error_l2"]
    assert rows[0]["film_floor"] == rows[1]["film_error_max"]


@pytest.mark.slow
def test_reference_has_its_own_errors_and_they_are_the_floors(studied):
    directory, _, rows = studied
    found = json.loads((directory / "reference.json").read_text())
    assert found["method"] == "full"
    assert found["film_cells"] == {"big_end": "10x2"}
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


def curves_of(folder, study, name):
    return StoredRun(folder / "runs" / name, study.cases[name].scene, study.start)


def errors_of(reference, run):
    curves, found = reference.differences(run)
    assert set(found) == {"big_end"}
    assert len(curves["time_s"]) == np.count_nonzero(run.times >= START)
    return SimpleNamespace(**found["big_end"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "values"),
    [
        ("slider-crank-both-ends", {"time.periodic": False, "time.revolutions": 0.01}),
        ("rotor-paper", {"time.revolutions": 0.05}),
    ],
    ids=["two bores", "tilt"],
)
def test_gaps_made_of_stored_coordinates_are_those_of_the_run(scene, values, tmp_path):
    values = {**values, **steps(1e-3), "reduction.method": "m4", "film": 0.5}
    path = tmp_path / "scene.toml"
    path.write_text(scene_as(scene, values))
    sweep = make_sweep(str(path), ["first_step=1e-7"])
    sweep_inline(sweep, tmp_path, keep=True)
    run = StoredRun(tmp_path / "runs" / "0001", sweep.cases[0].scene, 0.0)
    assert run.result.quasi_static.size
    for joint, gaps in run.gaps(run.result, sweep.cases[0].scene).items():
        film = run.filmed.joints[joint].film
        nodal = gaps[:, -len(film.angle) :]
        thinnest = -FilmRows.of(film.angle, film.height).largest(-nodal)[0]
        expected = run.result.joints[joint].min_film_thickness
        np.testing.assert_allclose(thinnest, expected, rtol=1e-9)
        assert np.ptp(gaps, axis=1).max() > 1e-9


@pytest.mark.slow
def test_known_errors_are_found_and_none_of_a_run_against_itself(studied, again):
    _, study, _ = studied
    reference = curves_of(again, study, REFERENCE)
    errors = errors_of(reference, curves_of(again, study, REFERENCE))
    assert max(errors.film_max, errors.film_l2) < 1e-12
    # Pressures at nodes are stored in single precision.
    assert max(errors.pressure_max, errors.pressure_l2) <= 2.0**-24
    assert errors.gap < 1e-18
    folder = again / "runs" / "changed"
    shutil.copytree(again / "runs" / REFERENCE, folder, symlinks=True)
    # Half of the pressures 2 % up, the film 3 % down, the journal moved by 2 nm along x.
    with edited(folder) as file:
        time, joint = file["time"][()], file["joints/big_end"]
        later = time >= study.start
        raised = time > time[later].mean()
        joint["max_pressure"][:] *= np.where(raised, 1.02, 1.0)
        joint["min_film_thickness"][:] *= 0.97
        coordinates = file["state/coordinates"]
        names = list(coordinates.attrs["names"])
        coordinates[:, names.index(b"joints/big_end/eccentricity_x")] += 2e-9
    changed = StoredRun(folder, study.cases[REFERENCE].scene, study.start)
    errors = errors_of(reference, changed)
    exact = reference.result.joints["big_end"].max_pressure[later]
    largest = 0.02 * exact[raised[later]].max() / exact.max()
    assert errors.pressure_max == pytest.approx(largest, rel=1e-6)
    assert 0 < errors.pressure_l2 < 0.02
    assert errors.film_max == pytest.approx(0.03, rel=1e-6)
    assert errors.film_l2 == pytest.approx(0.03, rel=1e-6)
    assert errors.gap == pytest.approx(2e-9, rel=1e-6)


@pytest.mark.slow
def test_only_what_changed_or_is_missing_runs_again(studied, again):
    _, study, before = studied
    # Bodies that nothing needs are not made again.
    shutil.rmtree(again / "runs" / "rigid")
    for body in again.glob("bodies/*.h5"):
        body.unlink()
    name = "m1-10"
    other = tiny_study(replace(TINY, settings={**TINY.settings, **steps(2e-4)}))
    study = replace(study, cases={**study.cases, name: other.cases[name]})
    _, pool, rows = run_tiny(again, study)
    assert set(pool.cases) == {"rigid", name}
    assert len(list(again.glob("bodies/*.h5"))) == 2
    # The body that failed is tried again, and no other that is not needed.
    tried = {
        body.name for task in pool.tasks if not isinstance(task, CaseTask) for body in task.bodies
    }
    needed = [study.cases[case].bodies for case in (TOO_MANY.name, name, "rigid")]
    assert tried == {body.name for bodies in needed for body in bodies.values()}
    changed = {"rigid", name}
    for row, former in zip(rows, before, strict=True):
        assert row == former or row["run"] in changed
    methods = rows_of(rows, "methods")
    assert methods[name]["tolerance"] == 2e-4
    assert methods["rigid"]["film_error_max"] > 0
    calls = json.loads((again / "study.json").read_text())["calls"]
    assert [each["runs"] for each in calls] == [len(study.cases), 3]


@pytest.mark.slow
def test_a_failed_reference_leaves_rows_without_errors(studied, tmp_path):
    scope = replace(TINY, methods=(m4(6),), stepped=(), meshed=(), reference=TOO_MANY)
    _, _, rows = run_tiny(tmp_path, tiny_study(scope))
    row = rows_of(rows, "methods")["m4-6-2e-03"]
    assert row["status"] == "complete"
    assert row["steps"] > 0
    assert [row[name] for name in (*ERROR_COLUMNS, "film_floor")] == [None] * 5
    found = json.loads((tmp_path / "reference.json").read_text())
    assert found["step"]["film_max"] is None
    assert found["step"]["why"].startswith("reference-step: failed: SettingsError")


@pytest.mark.slow
def test_folder_of_another_scene_or_process_is_refused(studied, tmp_path):
    directory, study, _ = studied
    with pytest.raises(
        ehd.errors.InputError, match=r"scene is slider-crank-paper in the folder, but rotor-paper"
    ):
        StudyFolder(directory, make_study("rotor-paper", quick=True))
    claim(tmp_path, ["study.json"])
    (tmp_path / "study.json").write_text("[]")
    with pytest.raises(ehd.errors.InputError, match="scene is None in the folder"):
        StudyFolder(tmp_path, study)
    with StudyFolder(directory, study), pytest.raises(ehd.errors.InUseError):
        StudyFolder(directory, study)


@pytest.mark.parametrize("start", [1e-3, 2e-4])
def test_a_scene_that_ends_before_enough_errors_count_is_refused(start):
    # The second one leaves 5e-5 s, less than its largest step of 7e-5 s.
    with pytest.raises(ehd.errors.SettingsError, match=r"errors are .* ends at 0.000251 s"):
        tiny_study(start=start)


def shorten(path, share):
    """Cut a file off, as a full disk or a lost machine leaves it."""
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])


def cut_history(folder, steps=4):
    """A history to so many steps: it can be read."""
    ehd.load_results(folder).each(lambda values: values[:steps]).save(folder)


@pytest.mark.slow
def test_damaged_runs_and_bodies_are_made_again(studied, again):
    _, study, rows = studied
    runs = again / "runs"
    (runs / "rigid" / "history.h5").unlink()
    shorten(runs / "m3-pc1-largest-eigenvalue-20" / "history.h5", 0.5)
    shorten(runs / "m4-6-2e-03" / "history.h5", 0.9)
    # There would be enough to compare.
    cut_history(runs / "m1-10", len(read_history(runs / "m1-10")["time_s"]) - 2)
    body = study.cases["reference-basis"].bodies["rod"].name
    for path in (again / "bodies" / f"{body}.h5", runs / "reference-basis" / "body-rod.h5"):
        path.write_bytes(path.read_bytes()[:-1000])
    _, pool, repeated = run_tiny(again)
    damaged = {"rigid", "m3-pc1-largest-eigenvalue-20", "m4-6-2e-03", "m1-10", "reference-basis"}
    assert set(pool.cases) == damaged
    assert [row["status"] for row in repeated] == [row["status"] for row in rows]
    for row, before in zip(repeated, rows, strict=True):
        assert row["film_error_max"] == pytest.approx(before["film_error_max"], rel=1e-3)


class Damaging(Inline):
    """A pool on a machine that loses the steps of the reference."""

    def __init__(self, scratch):
        super().__init__()
        self.scratch = scratch

    def submit(self, function, letter):
        future = super().submit(function, letter)
        task = self.tasks[-1]
        if not isinstance(task, CaseTask) or task.case.name != REFERENCE:
            return future
        result = future.result()
        for name, content in result.files.items():
            (self.scratch / name).write_bytes(content)
        cut_history(self.scratch)
        files = {name: (self.scratch / name).read_bytes() for name in result.files}
        damaged = Future()
        damaged.set_result(replace(result, files=files))
        return damaged


@pytest.mark.slow
def test_a_damaged_reference_is_the_one_that_failed(again, tmp_path_factory):
    study = tiny_study()
    shutil.rmtree(again / "runs" / REFERENCE)
    with StudyFolder(again, study) as folder:
        rows = run_study(folder, Damaging(tmp_path_factory.mktemp("damaged")))
    failed = {row["run"] for row in rows if row["status"] != "complete"}
    assert failed == {REFERENCE, TOO_MANY.name}
    assert "fewer than two steps after 0.0001 s" in rows[0]["status"]
    assert {row["film_error_max"] for row in rows if row["against"] == REFERENCE} == {None}
    found = json.loads((again / "reference.json").read_text())
    assert found["basis"]["why"].startswith("reference: failed: InputError")
    assert read_table(again) == rows
    with StudyFolder(again, study) as folder:
        # What the next call of the program goes by.
        assert study.cases[REFERENCE] in folder.take_stock()
        assert folder.outcomes[REFERENCE].status == rows[0]["status"]


@pytest.mark.slow
def test_errors_over_time_are_kept_beside_the_runs(studied, again):
    directory, study, rows = studied
    compared = [row for row in rows if row["film_error_max"] is not None]
    paths = {
        errors_path(Path("runs", row["run"]), against)
        for row in compared
        for against in filter(None, (row["against"], study.rows[rows.index(row)].fine_run))
        if against != row["run"]
    }
    assert {path.relative_to(directory) for path in directory.glob("runs/*/errors-*")} == paths
    for row in compared:
        folder = directory / "runs" / row["run"]
        found = read_errors(errors_path(folder, row["against"]))
        steps_of = ehd.load_results(folder, films=False).time
        np.testing.assert_array_equal(found["time_s"], steps_of[steps_of >= study.start])
        for name in ("pressure_error", "film_error"):
            assert np.abs(found[f"big_end.{name}"]).max() == row[f"{name}_max"]
    path = errors_path(again / "runs" / "rigid", REFERENCE)
    before = path.read_bytes()
    claim(path.parent, ["errors-gone.npz"])
    path.with_name("errors-gone.npz").write_bytes(before)
    shorten(path, 0.5)
    with pytest.raises(ehd.errors.InputError, match="not a file with the errors of a run"):
        read_errors(path)
    run_tiny(again)
    assert path.read_bytes() == before
    assert not path.with_name("errors-gone.npz").exists()


class Interrupted:
    """A pool that is interrupted before anything is done."""

    width = 1

    def submit(self, function, task):
        raise KeyboardInterrupt


@pytest.mark.slow
def test_tables_are_those_of_the_study_from_the_beginning(studied, again):
    _, study, rows = studied
    shutil.rmtree(again / "runs" / "rigid")
    with StudyFolder(again, study) as folder, pytest.raises(KeyboardInterrupt):
        run_study(folder, Interrupted())
    found = read_table(again)
    assert [(row["run"], row["group"]) for row in found] == [(r["run"], r["group"]) for r in rows]
    (missing,) = (row for row in found if row["status"] == "not run")
    assert (missing["run"], missing["method"], missing["steps"]) == ("rigid", "rigid", None)
    assert found[1] == rows[1]


@pytest.mark.slow
def test_overwriting_forgets_tables_and_report_too(studied, again):
    study = studied[1]
    claim(again / "figures", ["a.png"])
    for name in ("report.html", "report.md", "figures/a.png"):
        (again / name).write_text("of the former study")
    (again / "runs" / "mine.txt").write_text("of somebody else")
    with StudyFolder(again, study, overwrite=True) as folder:
        assert {path.name for path in again.iterdir()} == {"bodies", "manifest.txt", "runs"}
        assert {path.name for path in (again / "runs").iterdir()} == {"mine.txt"}
        with pytest.raises(KeyboardInterrupt):
            run_study(folder, Interrupted())
    assert {row["status"] for row in read_table(again)} == {"not run"}
    assert json.loads((again / "reference.json").read_text())["status"] == "not run"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["figures/mine.png", "runs/reference/mine", "bodies/mine.h5"])
@pytest.mark.parametrize("link", [False, True])
def test_a_folder_that_holds_what_is_not_of_a_study_is_refused(name, link, studied, tmp_path):
    path = tmp_path / "out" / name
    (tmp_path / "elsewhere").mkdir()
    path.parent.parent.mkdir(parents=True)
    if link:
        path.parent.symlink_to(tmp_path / "elsewhere")
        path = tmp_path / "elsewhere" / path.name
    else:
        path.parent.mkdir()
    path.write_text("mine")
    for overwrite in (False, True):
        with pytest.raises(ehd.errors.InputError, match="not from a former run"):
            StudyFolder(tmp_path / "out", studied[1], overwrite=overwrite)
    assert path.read_text() == "mine"


@pytest.mark.parametrize(
    ("values", "cells"),
    [
        ({}, (20, 5)),
        ({"joints.big_end.cells": (12, 3)}, (12, 3)),
        ({"bodies.rod.geometry.bore_cells_around": 40}, (40, 5)),
        ({"bodies.rod.geometry.bore_cells_around": 40, "bodies.rod.cells": "tet"}, (20, 5)),
    ],
)
def test_film_mesh_is_checked_by_a_finer_one(values, cells, tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(scene_as(SCENE, values))
    study = make_study(str(path), quick=True)
    assert planned_cells(study.scene, "big_end") == cells
    run, meaning = study.checks["film"]
    assert "film cells times 1.5" in meaning
    found = study.cases[run].scene.joints["big_end"].cells
    # Half a cell more is rounded up.
    assert found == tuple(int(1.5 * n + 0.5) for n in cells)
    assert study.cases[REFERENCE].scene.joints["big_end"].cells == values.get(
        "joints.big_end.cells", ()
    )


@pytest.mark.parametrize("factor", [{}, film(1)])
def test_a_film_check_that_is_not_finer_is_refused(factor):
    with pytest.raises(ehd.errors.SettingsError, match=r"film_check has film\(1\), a"):
        tiny_study(replace(TINY, film_check=factor | steps(1e-5)))


#: What the runs of a small study have in common, but for methods and the film.
SMALL = replace(
    TINY,
    methods=(m4(6), rigid()),
    stepped=(),
    meshed=(),
    step_check=None,
    reference_steps=steps(1e-5),
    basis_check=(full(6), steps(1e-4)),
)


@pytest.mark.slow
def test_film_of_other_cells_than_the_bore_has_nodal_pressures_too(tmp_path):
    # M4 with every nodal pressure, so that only the cells differ from those of the bore.
    scope = replace(
        SMALL,
        methods=(m4(6, 0.0), rigid()),
        settings={**TINY.settings, "joints.big_end.cells": (12, 3)},
        film_check=film(1.5) | steps(1e-4),
    )
    _, _, rows = run_tiny(tmp_path, tiny_study(scope))
    found = json.loads((tmp_path / "reference.json").read_text())
    assert found["film_cells"] == {"big_end": "12x3"}
    row = rows_of(rows, "methods")["m4-6-0e+00"]
    assert row["film_cells"] == "12x3"
    # Between the reference's steps the peak moves from node to node: its curve has kinks there
    # that cost 1e-3 if the curve is what is interpolated.
    assert row["pressure_error_max"] < 5e-4
    assert row["film_error_max"] < 2e-4


@pytest.mark.slow
def test_cycles_that_repeat_are_compared_in_their_own_time(tmp_path):
    scope = replace(
        SMALL,
        settings={
            **COARSE,
            **steps(1e-4),
            "time.periodic": True,
            "time.periodicity": 1e-2,
            "time.first_step": 1e-6,
        },
        methods=(m4(6), m3("pc1", "largest-eigenvalue", 20)),
        basis_check=(full(6), steps(1e-4)),
        film_check=film(2) | steps(1e-4),
    )
    study, _, rows = run_tiny(tmp_path, tiny_study(scope, start=None))
    assert study.start == 0.0
    methods = rows_of(rows, "methods")
    for name, row in methods.items():
        history = read_history(tmp_path / "runs" / name)
        assert history["cycle"].min() == history["cycle"].max() > 1
        times = read_errors(errors_path(tmp_path / "runs" / name, REFERENCE))["time_s"]
        assert 0 == times[0] < times[-1] <= study.scene.span
        assert len(times) >= len(history["time_s"]) - 2
        assert row["true_gap_error_m"] > 0
    # Compared at another place in the cycle M4's film would be tens of per cent off.
    assert methods["m4-6-2e-03"]["film_error_max"] < 0.02
    assert (
        methods["m3-pc1-largest-eigenvalue-20"]["film_error_max"]
        > 2 * methods["m4-6-2e-03"]["film_error_max"]
    )
    # A second call finds complete runs, whose histories have the last cycle only.
    _, pool, _ = run_tiny(tmp_path, study)
    assert pool.tasks == []


@pytest.mark.slow
def test_every_lubricated_joint_has_rows_and_errors_of_its_own(tmp_path):
    """A film at either end, and the rod's at the big end."""
    path = tmp_path / "scene.toml"
    once = {"time.periodic": False, "time.revolutions": 0.01, "film": 0.5}
    path.write_text(scene_as("engine", once))
    scope = replace(
        SMALL,
        settings={**COARSE, **steps(1e-3), "time.largest_step": 2e-3},
        reference_steps=steps(1e-4),
        basis_check=(full(6), steps(1e-3)),
        film_check=film(1.5) | steps(1e-3),
    )
    study, _, rows = run_tiny(tmp_path / "out", tiny_study(scope, str(path), start=None))
    assert study.joints == ("front", "back", "big_end")
    assert [(row["run"], row["joint"]) for row in rows[:3]] == [
        (REFERENCE, joint) for joint in study.joints
    ]
    assert {row["status"] for row in rows} == {"complete"}
    found = {(row["run"], row["joint"]): row for row in rows if row["group"] == "methods"}
    assert len(found) == 6
    folder = tmp_path / "out" / "runs" / "rigid"
    kept = read_errors(errors_path(folder, REFERENCE))
    summary = json.loads((folder / "summary.json").read_text())["joints"]
    for joint in study.joints:
        row = found["rigid", joint]
        assert np.abs(kept[f"{joint}.film_error"]).max() == row["film_error_max"]
        assert np.abs(kept[f"{joint}.pressure_error"]).max() == row["pressure_error_max"]
        assert row["max_pressure_Pa"] == summary[joint]["max_pressure_Pa"]
    # Only the big end's bore bends.
    assert found["rigid", "big_end"]["estimated_gap_error_m"] > 0
    assert found["rigid", "front"]["estimated_gap_error_m"] is None
    assert (
        found["rigid", "big_end"]["true_gap_error_m"]
        > 5 * found["rigid", "front"]["true_gap_error_m"]
        > 0
    )
    reference = json.loads((tmp_path / "out" / "reference.json").read_text())
    assert set(reference["film_cells"]) == set(study.joints)
    own = reference["basis"]
    assert own["film_max"] == max(e["film_max"] for e in own["joints"].values())


@pytest.mark.slow
def test_command_prints_its_table_and_ends_with_an_error_if_nothing_can_be_compared(
    tmp_path, capfd, monkeypatch
):
    # The film begins as thin as it must not become: every run fails at once.
    scene = tmp_path / "scene.toml"
    short = {"time.revolutions": 0.03, "time.largest_step": 0.007}
    scene.write_text(scene_as(SCENE, COARSE | short | {"joints.big_end.smallest_film": 0.9999}))
    arguments = ("study", scene, "--quick", "--no-report", "-o", tmp_path / "out")
    monkeypatch.setattr(progress, "LOG_INTERVAL", 0.0)
    status, output, errors = exit_of(capfd, *arguments)
    assert status == 1
    assert "nothing is compared: failed: FilmTooThinError: the film of big_end" in errors
    assert "reduced bodies: 13 made" in errors
    assert re.search(r"^progress: study: .* of \d+ cases", errors, re.MULTILINE)
    heads, *lines, message = output.splitlines()
    assert heads.split()[:3] == ["group", "run", "joint"]
    assert message.startswith(f"rows in {tmp_path / 'out' / 'table.csv'}")
    assert len(lines) == len(read_table(tmp_path / "out"))
    assert all("failed:" in line for line in lines)
