"""Settings refined for an accuracy: what is refined, the runs, and the error of the last one."""

import json
import tomllib
from contextlib import contextmanager
from math import ceil
from types import SimpleNamespace

import attrs
import numpy as np
import pytest
from command_line import call
from csv_history import only_joint
from scene_cases import LOADED_JOURNAL, write_scene

import fenics_ehd as ehd
from fenics_ehd.cli.run import accuracy_lines
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.trust import COMPONENTS, NOT_APPLICABLE, NOT_ESTIMATED, QUANTITIES
from fenics_ehd.scenes.accuracy import (
    account,
    choosable,
    search_of,
    start_search,
    water_filling_level,
)
from fenics_ehd.scenes.part import with_counts
from fenics_ehd.scenes.scene import changed
from fenics_ehd.study.cases import make_case

#: A journal bearing whose runs take less than a second.
QUICK = LOADED_JOURNAL | {"joints.bearing.cells": [16, 3], "output.plots": False}


def test_without_an_accuracy_a_scene_is_as_given():
    scene = ehd.read_scene("four-bar")
    assert start_search(scene) == (scene, None)


def test_a_pilot_is_coarse_and_leaves_what_is_kept():
    asked = changed(ehd.read_scene("slider-crank"), {"output.accuracy": "1 %"})
    pilot, search = start_search(asked)
    assert pilot.output.accuracy == 0.0
    assert pilot.joints["big_end"].cells == (24, 6)
    assert pilot.time.tolerance == search.chosen["time.tolerance"] > 1e-4
    # Its part has the cells that are written.
    assert set(search.chosen) == set(choosable(asked)) - {"bodies.rod.geometry"}
    kept = changed(asked, {"output.accuracy_keeps": ["tolerance", "bodies.rod.reduction.method"]})
    pilot, search = start_search(kept)
    assert pilot.time.tolerance == asked.time.tolerance
    assert search.kept == ("time.tolerance", "bodies.rod.reduction")
    assert set(search.chosen) == {"time.periodicity", "joints.big_end.cells"}


def test_a_pilot_is_the_finer_the_tighter_the_accuracy():
    scene, before = ehd.read_scene("loaded-journal"), (0, 0.1)
    for accuracy in (0.1, 0.03, 0.01, 3e-3):
        pilot, _ = start_search(changed(scene, {"output.accuracy": accuracy}))
        now = pilot.joints["bearing"].cells[0], pilot.time.tolerance
        assert now[0] >= before[0]
        assert now[1] <= before[1]
        before = now


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (
            {"output.accuracy_keeps": ["mass"]},
            "'mass' is not a setting that accuracy chooses: choose from time",
        ),
        ({"output.error_budget": False}, "needs output.error_budget = true"),
        ({"output.accuracy": "1 um"}, "output.accuracy = '1 um'"),
        ({"output.accuracy": 2.0}, "output.accuracy = 2.0 must be below 0.5: 0.01 for 1 %"),
        ({"output.accuracy": 0.0, "output.accuracy_keeps": ["cells"]}, "without output.accuracy"),
    ],
)
def test_what_cannot_be_asked_is_refused(values, message):
    with pytest.raises(ehd.errors.SettingsError, match=message):
        start_search(changed(ehd.read_scene("four-bar"), {"output.accuracy": 0.01} | values))


@pytest.fixture(scope="module")
def tight_run(tmp_path_factory):
    """Folder of a run that the pilot's settings are not enough for."""
    folder = tmp_path_factory.mktemp("accuracy")
    scene = write_scene(
        folder / "scene.toml", "loaded-journal", QUICK, {"output.accuracy": "0.5 %"}
    )
    assert call("run", scene, "-o", folder / "run") == 0
    return folder / "run"


@pytest.mark.slow
def test_a_run_meets_its_accuracy_and_says_how(tight_run, capsys):
    summary = json.loads((tight_run / "summary.json").read_text())
    found = summary["accuracy"]
    assert found["asked"] == 0.005
    assert found["met"]
    assert found["estimate"] <= 0.005 < found["pilot_estimate"]
    budget = only_joint(summary)["error_budget"]
    assert found["estimate"] == max(budget[quantity]["total"] for quantity in QUANTITIES)
    assert found["pilot_processor_time_s"] > 0.0
    lines = "\n".join(accuracy_lines(summary))
    assert "accuracy, 0.5 % requested" in lines
    assert "largest by step size" in lines


@pytest.mark.slow
def test_its_scene_is_run_again_without_a_pilot(tight_run):
    scene = tomllib.loads((tight_run / "scene.toml").read_text())
    found = json.loads((tight_run / "summary.json").read_text())
    chosen = found["accuracy"]["chosen"]
    assert scene["output"]["accuracy"] == 0.0
    assert scene["time"]["tolerance"] == chosen["time.tolerance"]
    assert scene["joints"]["bearing"]["cells"] == chosen["joints.bearing.cells"]
    again = tight_run.parent / "again"
    assert call("run", tight_run / "scene.toml", "-o", again) == 0
    same = json.loads((again / "summary.json").read_text())
    assert "accuracy" not in same
    for key in ("max_pressure_Pa", "min_film_thickness_m"):
        assert only_joint(same)[key] == only_joint(found)[key]
    assert (found["steps"], found["cycles"]) == (same["steps"], same["cycles"])


@pytest.mark.slow
def test_a_search_that_is_stopped_goes_on_to_the_same_result(tight_run, monkeypatch):
    shown, runs = Recorder.shown, set()

    @contextmanager
    def interrupted(recorded, progress, name):
        runs.add(id(recorded))
        with shown(recorded, progress, name) as show:

            def show_and_stop(step):
                show(step)
                # In the first cycle of the run after the pilot.
                if len(runs) > 1 and recorded.counts["steps"] > 10:
                    raise KeyboardInterrupt

            yield show_and_stop

    folder = tight_run.parent / "interrupted"
    command = ("run", tight_run.parent / "scene.toml", "-o", folder)
    with monkeypatch.context() as patched:
        patched.setattr(Recorder, "shown", interrupted)
        assert call(*command) == 130
    assert len(search_of(folder).runs) == 1
    assert call("run", "--resume", folder) == 0
    whole, own = (
        json.loads((path / "summary.json").read_text())["accuracy"] for path in (tight_run, folder)
    )
    assert (folder / "history.csv").read_bytes() == (tight_run / "history.csv").read_bytes()
    assert [run["estimate"] for run in own["runs"]] == [run["estimate"] for run in whole["runs"]]


def test_an_error_that_is_not_estimated_is_refused_by_name():
    scene, search = start_search(changed(ehd.read_scene("four-bar"), {"output.accuracy": 0.01}))
    known = dict.fromkeys(COMPONENTS, 1e-3) | dict.fromkeys(("basis", "part_mesh"), NOT_APPLICABLE)
    lacking = known | {"film_mesh": NOT_ESTIMATED}
    budget = {"max_pressure": known | {"known": 2e-3}, "min_film_thickness": lacking}
    notes = {"error_budget_notes": {"film_mesh": "the oil is compressible"}}
    with pytest.raises(
        ehd.errors.AccuracyError, match=r"pin due to film mesh .* oil is compressible"
    ):
        account(search, scene, None, {"pin": budget}, notes)


def judged_rod(**errors):
    """Stand-in of a slider-crank's run with some errors of its figures."""
    grid = SimpleNamespace(cells=(22, 6), family="lagrange")
    film = SimpleNamespace(film=SimpleNamespace(parameters=SimpleNamespace(grid=grid)))
    surfaces = [
        SimpleNamespace(body=body, surface=SimpleNamespace(elastic=body == "rod"))
        for body in ("rod", "crank")
    ]
    place = SimpleNamespace(name="big_end", surfaces=surfaces, film=film)
    budget = dict.fromkeys(COMPONENTS, 1e-4) | errors
    budget = {"known": sum(budget.values())} | budget
    budget["between_nodes"] = 0.5 * budget["film_mesh"]
    budgets = {"big_end": dict.fromkeys(QUANTITIES, budget)}
    system = SimpleNamespace(films=[place])
    run = SimpleNamespace(
        equations=SimpleNamespace(system=system),
        control=SimpleNamespace(order=3, largest_step=2.5e-4),
        state=SimpleNamespace(time=2.5e-2),
    )
    return SimpleNamespace(run=run, counts={"steps": 200}, processor_time=1.0), budgets


ENTRIES = {
    "error_budget_notes": {}, "error_budget_processor_time_s": 0.5, "status": "complete",
}  # fmt: skip


def test_every_component_moves_its_own_setting():
    scene = changed(ehd.read_scene("slider-crank"), {"output.accuracy": 0.01})

    def wanted(keeps=(), **errors):
        kept = changed(scene, {"output.accuracy_keeps": list(keeps)})
        pilot, search = start_search(kept)
        account(search, pilot, *judged_rod(**errors), ENTRIES)
        return search.chosen, search.wanted

    before, after = wanted(basis=0.011)
    assert set(after) == {"bodies.rod.reduction"}
    # Seven tenths of the accuracy less four components of 1e-4 each.
    assert after["bodies.rod.reduction"]["vibration_modes"] == ceil(6 * 0.011 / 6.6e-3)
    assert after["bodies.rod.reduction"]["method"] == "m4"
    # Two thirds of it with 1.2 times the cells, in tens.
    before, after = wanted(part_mesh=0.01)
    assert set(after) == {"bodies.rod.geometry"}
    assert after["bodies.rod.geometry"]["bore_cells_around"] == 30
    before, after = wanted(start=0.012)
    assert after["time.periodicity"] == pytest.approx(0.55 * before["time.periodicity"], rel=0.1)
    # Cycles differ by what steps leave.
    before, after = wanted(start=0.1)
    assert after["time.periodicity"] == pytest.approx(before["time.periodicity"] / 15, rel=0.1)
    assert after["time.tolerance"] <= after["time.periodicity"]
    before, after = wanted(["tolerance"], start=0.1)
    assert after["time.periodicity"] >= 1e-4
    # A third of an error of order three.
    before, after = wanted(film_mesh=0.02)
    assert after == {"joints.big_end.cells": [32, 9]}
    before, after = wanted(step_size=0.012)
    assert set(after) == {"time.tolerance"}
    share = after["time.tolerance"] / before["time.tolerance"]
    assert share == pytest.approx(0.55 ** (4 / 3), rel=0.1)
    before, after = wanted(["tolerance", "geometry"], step_size=6e-3, part_mesh=6e-3)
    assert set(after) <= {"joints.big_end.cells", "time.periodicity", "bodies.rod.reduction"}
    # Both come down to one level.
    before, after = wanted(film_mesh=5e-3, step_size=8e-3)
    assert set(after) == {"joints.big_end.cells", "time.tolerance"}
    assert wanted()[1] == {}


@pytest.mark.parametrize("total", [0.1, 1.0, 2.5, 4.0, 9.0])
def test_errors_above_a_level_come_down_to_it(total):
    errors = [0.5, 2.0, 0.0, 1.5]
    level = water_filling_level(errors, total)
    assert sum(min(error, level) for error in errors) == pytest.approx(min(total, sum(errors)))


def test_a_run_that_may_not_be_trusted_takes_shorter_steps_and_finer_films():
    scene = changed(ehd.read_scene("slider-crank"), {"output.accuracy": 0.01})
    pilot, search = start_search(scene)
    entries = ENTRIES | {"status": "untrustworthy: energy balance error"}
    account(search, pilot, *judged_rod(), entries)
    assert set(search.wanted) == {"time.tolerance", "joints.big_end.cells"}


def test_joints_of_rigid_bores_have_no_basis():
    scene, search = start_search(changed(ehd.read_scene("engine"), {"output.accuracy": 0.01}))
    recorded, budgets = judged_rod(film_mesh=4e-3)
    rigid = dict.fromkeys(("basis", "part_mesh"), NOT_APPLICABLE)
    own = budgets["big_end"]["max_pressure"]
    budgets["front"] = dict.fromkeys(QUANTITIES, own | rigid)
    account(search, scene, recorded, budgets, ENTRIES)
    assert search.met
    assert search.runs[0]["errors"]["basis"] == 1e-4


def test_a_search_ends_and_says_what_is_in_the_way():
    scene = changed(
        ehd.read_scene("slider-crank"),
        {"output.accuracy": 0.01, "output.accuracy_keeps": ["cells"]},
    )
    scene, search = start_search(scene)
    for _ in range(9):
        found = account(search, scene, *judged_rod(film_mesh=0.02), ENTRIES)
        if not search.wanted:
            break
        scene = search.continue_search(scene)
    assert not search.met
    assert len(search.runs) <= 4
    assert "is not met: the estimate is 0.02" in found["warnings"][-1]
    assert "film mesh 0.02 (joints.big_end.cells kept)" in found["warnings"][-1]


def test_numbers_of_cells_that_are_not_written_are_those_of_the_model():
    rod = ehd.read_scene("slider-crank").bodies["rod"]
    bare = attrs.evolve(rod, geometry={"bore_radius": 0.02, "shank_cells": 6})
    cells = {k: v for k, v in rod.geometry.items() if k in rod.cell_counts}
    assert with_counts(bare, "bodies.rod").geometry == cells | bare.geometry
    assert with_counts(rod, "bodies.rod").geometry == rod.geometry


def test_a_finer_mesh_of_a_part_is_one_that_its_model_has():
    rod = ehd.read_scene("slider-crank").bodies["rod"]
    for factor in (0.5, 1.0, 1.2, 3.0):
        cells = rod.geometry_of(factor)
        assert cells["bore_cells_around"] % 10 == 0
        for key in rod.cell_counts:
            assert cells[key] >= factor * rod.geometry[key]
        assert cells["bore_radius"] == rod.geometry["bore_radius"]
    assert rod.geometry_of(1.0) == rod.geometry


def test_cases_of_a_study_have_their_own_settings():
    asked = changed(ehd.read_scene("four-bar"), {"output.accuracy": 0.01})
    with pytest.raises(ehd.errors.SettingsError, match="drop the key"):
        make_case("one", asked, {"time.tolerance": 1e-3})


def extremes_of(directory):
    """Largest pressure and thinnest film of a stored run."""
    summary = only_joint(json.loads((directory / "summary.json").read_text()))
    return np.array([summary["max_pressure_Pa"], summary["min_film_thickness_m"]])


@pytest.fixture(scope="module")
def converged(tmp_path_factory):
    """Extremes of the four-bar on a fine film in short steps."""
    folder = tmp_path_factory.mktemp("converged")
    fine = {"joints.rocker_end.cells": [60, 10], "time.tolerance": 3e-6}
    scene = write_scene(folder / "fine.toml", "four-bar", fine)
    assert call("run", scene, "--no-error-budget", "--no-plots", "-o", folder / "run") == 0
    return extremes_of(folder / "run")


@pytest.mark.slow
@pytest.mark.parametrize("accuracy", [0.03, 0.01])
def test_true_errors_meet_the_accuracy(tmp_path, accuracy, converged, figure):
    scene = write_scene(tmp_path / "scene.toml", "four-bar")
    command = ("run", scene, "--accuracy", accuracy, "--no-plots", "-o", tmp_path / "run")
    assert call(*command) == 0
    error = float(np.abs(extremes_of(tmp_path / "run") / converged - 1.0).max())
    name = f"four-bar, {100 * accuracy:g} % asked: true error of the run"
    figure("error budget", name, error, most=accuracy)


@pytest.mark.slow
def test_a_finer_mesh_of_a_real_part_is_chosen_and_is_as_good_as_expected(tmp_path):
    coarse = {"bore_cells_along": 2, "big_end_layers": 1, "shank_cells": 4, "small_end_layers": 1}
    values = {f"bodies.rod.geometry.{key}": cells for key, cells in coarse.items()} | {
        "joints.big_end.cells": [16, 3],
        "time.revolutions": 0.6,
        "time.tolerance": 1e-3,
        "output.accuracy": 1.5e-2,
        "output.accuracy_keeps": ["tolerance", "cells"],
    }
    scene = write_scene(tmp_path / "scene.toml", "slider-crank-paper", values)
    assert call("run", scene, "--no-plots", "-o", tmp_path / "run") == 0
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    runs = summary["accuracy"]["runs"]
    errors = [run["errors"]["part_mesh"] for run in runs]
    meshes = [run["chosen"]["bodies.rod.geometry"]["bore_cells_around"] for run in runs[1:]]
    assert errors[0] > 1.5e-2 > 3 * errors[-1]
    # Of what the kept cells leave no other component would be seen.
    assert runs[-1]["chosen"]["bodies.rod.reduction"]["vibration_modes"] == 6
    assert [20, *meshes] == sorted({20, *meshes})
    # As the law has it, or nearly.
    assert errors[1] < 2.0 * errors[0] * (20 / meshes[0]) ** 2
    scene = tomllib.loads((tmp_path / "run" / "scene.toml").read_text())
    assert scene["bodies"]["rod"]["geometry"] == runs[-1]["chosen"]["bodies.rod.geometry"]
    assert scene["joints"]["big_end"]["cells"] == [16, 3]
    assert "joints.big_end.cells kept" in summary["warnings"][-1]


def test_an_option_that_is_no_accuracy_is_refused(tmp_path, capfd):
    scene = write_scene(tmp_path / "scene.toml", "loaded-journal", QUICK)
    assert call("run", scene, "--accuracy", "1 um", "-o", tmp_path / "run") == 2
    assert "'--accuracy': '1 um' must be a number" in capfd.readouterr().err
    assert call("run", scene, "--accuracy", "1e-9", "-o", tmp_path / "run") == 2
    assert "output.accuracy = 1e-09 is below 0.0001" in capfd.readouterr().err
    assert call("run", scene, "--accuracy", "1%", "--no-error-budget", "-o", tmp_path / "run") == 2
    assert "needs output.error_budget = true" in capfd.readouterr().err
