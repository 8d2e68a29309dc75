"""Settings chosen for an accuracy: the rule, the search, and what the chosen run is worth."""

import json
import tomllib
from dataclasses import replace
from math import inf
from types import SimpleNamespace

import attrs
import numpy as np
import pytest
from command_line import call
from mpi4py import MPI
from scene_cases import LOADED_JOURNAL, write_scene

from fenics_ehd.base.errors import AccuracyError, SettingsError
from fenics_ehd.cli.accuracy import accuracy_lines
from fenics_ehd.multibody.error_shares import (
    COMPONENTS,
    NOT_APPLICABLE,
    NOT_ESTIMATED,
    QUANTITIES,
)
from fenics_ehd.multibody.orbit import Orbit
from fenics_ehd.multibody.periodic import Cycles
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.tracking import Tracker
from fenics_ehd.results import recorded_run
from fenics_ehd.scenes.accuracy import begun, choosable, search_of
from fenics_ehd.scenes.accuracy_choice import (
    LOOSEST,
    MOST_CELLS,
    TIGHTEST,
    Figure,
    FilmMesh,
    JudgedRun,
    cheapest,
)
from fenics_ehd.scenes.accuracy_step import account
from fenics_ehd.scenes.build import build_mechanism
from fenics_ehd.scenes.given import changed
from fenics_ehd.scenes.part_cells import counts, part_cells, with_counts
from fenics_ehd.scenes.scene_file import read_scene
from fenics_ehd.study.case import make_case

#: A journal bearing whose runs take less than a second.
QUICK = LOADED_JOURNAL | {"joints.bearing.cells": [16, 3], "output.plots": False}


def judged_run(seed, joints=1, figures=2):
    """A run with errors of the sizes that pilots have, so many figures a joint."""
    random = np.random.default_rng(seed)
    names = [f"joint{k}" for k in range(joints)]
    films = {
        name: FilmMesh(
            (int(random.integers(16, 40)), int(random.integers(3, 10))),
            float(random.choice([2.0, 4.0])),
            float(random.choice([1.0, 4.0, 20.0])),
        )
        for name in names
    }
    found = tuple(
        Figure(name, *10 ** random.uniform(-4, -1.5, 3), 10 ** random.uniform(-5, -3.5))
        for name in names
        for _ in range(figures)
    )
    order = int(random.integers(2, 4))
    return JudgedRun(found, films, 1e-3, order, float(random.uniform(0.0, 0.9)))


def errors(run, choice):
    """Of a choice, by the laws."""
    factors = {
        name: min(new / old for old, new in zip(film.cells, choice.cells[name], strict=True))
        for name, film in run.films.items()
    }
    return run.errors(run.shares(choice.tolerance), factors)


def within_limits(choice):
    cells = np.prod(list(choice.cells.values()), axis=1)
    return choice.tolerance > TIGHTEST and (cells < 0.9 * MOST_CELLS).all()


@pytest.mark.parametrize("joints", [1, 3])
def test_a_choice_meets_the_accuracy_by_its_own_laws(joints):
    met = 0
    for seed in range(100):
        run = judged_run(seed, joints)
        choice = cheapest(run, 0.01)
        if within_limits(choice):
            met += 1
            assert errors(run, choice).max() <= 0.01 * (1 + 1e-6)
            assert choice.expected <= 0.01 * (1 + 1e-6)
    assert met > 80


def time(run, choice):
    """Of a choice, by the laws."""
    ((name, film),) = run.films.items()
    own = np.sqrt(np.prod(choice.cells[name]) / np.prod(film.cells))
    return run.time(run.shares(choice.tolerance), {name: own})


@pytest.mark.parametrize("figures", [1, 2])
def test_a_tighter_accuracy_is_never_coarser_or_quicker(figures):
    for seed in range(100):
        run = judged_run(seed, figures=figures)
        asked = (0.05, 0.03, 0.02, 0.01, 5e-3, 2e-3)
        choices = [cheapest(run, accuracy) for accuracy in asked]
        for loose, tight, accuracy in zip(choices, choices[1:], asked[1:], strict=False):
            if tight.expected > accuracy:
                break
            # But for whole cells and two digits of a tolerance.
            assert time(run, tight) >= 0.9 * time(run, loose)
            if figures > 1:  # another one may come to decide
                continue
            assert tight.tolerance <= loose.tolerance
            for cells, more in zip(loose.cells["joint0"], tight.cells["joint0"], strict=True):
                assert more >= cells


def test_nothing_on_a_grid_is_quicker():
    for seed in range(30):
        run = judged_run(seed)
        (film,) = run.films.values()
        choice = cheapest(run, 0.01)
        if not within_limits(choice):
            continue
        # As if cells came in fractions: what is lost by whole ones is no fault of the rule.
        best = inf
        for factor in np.geomspace(film.coarsest, film.finest, 400):
            left = min(
                (0.01 - f.rest - f.film_mesh * factor**-film.order - f.between_nodes / factor**2)
                / f.step_size
                for f in run.figures
            )
            step = min(left, run.shares(LOOSEST))
            if step > 0.0:
                best = min(best, run.time(step, {"joint0": factor}))
        around = choice.cells["joint0"][0] / film.cells[0]
        own = run.time(run.shares(choice.tolerance), {"joint0": around - 1.0 / film.cells[0]})
        assert own <= 1.1 * best


def test_what_is_kept_stays_and_the_rest_makes_up_for_it():
    run = judged_run(3)
    figures = (Figure("joint0", 4e-3, 0.0, 8e-3, 0.0),)
    run = replace(run, figures=figures, films={"joint0": FilmMesh((20, 5), 4.0, 4.0)})
    free = cheapest(run, 6e-3)
    film = replace(run, films={"joint0": FilmMesh((20, 5), 4.0, 4.0, kept=True)})
    assert cheapest(film, 6e-3).cells == {"joint0": (20, 5)}
    assert cheapest(film, 6e-3).tolerance < free.tolerance
    steps = replace(run, kept=True)
    assert cheapest(steps, 9e-3).tolerance == 1e-3
    assert cheapest(steps, 9e-3).cells["joint0"] > (20, 5)


def test_what_cannot_be_met_is_said_to_be_missed_and_not_paid_for():
    run = replace(judged_run(3), figures=(Figure("joint0", 4e-3, 0.0, 8e-3, 2e-2),))
    choice = cheapest(run, 1e-2)
    assert 2e-2 < choice.expected <= 2.5e-2
    assert choice.tolerance > 1e-4
    assert within_limits(choice)


def test_a_distrusted_run_takes_shorter_steps_whatever_its_errors():
    run = replace(judged_run(3), figures=(Figure("joint0", 1e-4, 0.0, 1e-4, 0.0),))
    loose = cheapest(run, 1e-2)
    tight = cheapest(replace(run, longest=0.2), 1e-2)
    assert run.shares(tight.tolerance) <= 0.2 < run.shares(loose.tolerance)
    assert cheapest(replace(run, coarsest=1.5), 1e-2).cells["joint0"] > loose.cells["joint0"]


def test_without_an_accuracy_a_scene_is_as_given():
    scene = read_scene("four-bar")
    assert begun(scene) == (scene, None)


def test_a_pilot_is_coarse_and_leaves_what_is_kept():
    asked = changed(read_scene("slider-crank"), {"output.accuracy": "1 %"})
    pilot, search = begun(asked)
    assert pilot.output.accuracy == 0.0
    assert pilot.joints["big_end"].cells == (24, 6)
    assert pilot.time.tolerance == search.chosen["time.tolerance"] > 1e-4
    # Its part has the cells that are written.
    assert set(search.chosen) == set(choosable(asked)) - {"bodies.rod.geometry"}
    kept = changed(asked, {"output.accuracy_keeps": ["tolerance", "bodies.rod.reduction.method"]})
    pilot, search = begun(kept)
    assert pilot.time.tolerance == asked.time.tolerance
    assert search.kept == ("time.tolerance", "bodies.rod.reduction")
    assert set(search.chosen) == {"time.periodicity", "joints.big_end.cells"}


def test_a_pilot_is_the_finer_the_tighter_the_accuracy():
    scene, before = read_scene("loaded-journal"), (0, 0.1)
    for accuracy in (0.1, 0.03, 0.01, 3e-3):
        pilot, _ = begun(changed(scene, {"output.accuracy": accuracy}))
        now = pilot.joints["bearing"].cells[0], pilot.time.tolerance
        assert now[0] >= before[0]
        assert now[1] <= before[1]
        before = now


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"output.accuracy_keeps": ["mass"]}, "'mass' is none of what is chosen: time.tolerance"),
        ({"output.error_budget": False}, "needs output.error_budget = true"),
        ({"output.accuracy": "1 um"}, "output.accuracy = '1 um'"),
        ({"output.accuracy": 2.0}, "output.accuracy = 2.0 must be below 0.5: 0.01 for 1 %"),
        ({"output.accuracy": 0.0, "output.accuracy_keeps": ["cells"]}, "without output.accuracy"),
    ],
)
def test_what_cannot_be_asked_is_refused(values, told):
    with pytest.raises(SettingsError, match=told):
        begun(changed(read_scene("four-bar"), {"output.accuracy": 0.01} | values))


@pytest.fixture(scope="module")
def tight_run(tmp_path_factory):
    """Folder of a run that the pilot's settings are not enough for."""
    folder = tmp_path_factory.mktemp("accuracy")
    scene = write_scene(
        folder / "scene.toml", "loaded-journal", QUICK, {"output.accuracy": "0.5 %"}
    )
    assert call("run", scene, "-o", folder / "run") == 0
    return folder / "run"


def test_a_run_meets_its_accuracy_and_says_how(tight_run, capsys):
    summary = json.loads((tight_run / "summary.json").read_text())
    found = summary["accuracy"]
    assert found["asked"] == 0.005
    assert found["met"]
    assert found["estimate"] <= 0.005 < found["pilot_estimate"]
    budget = summary["error_budget"]
    assert found["estimate"] == max(budget[quantity]["total"] for quantity in QUANTITIES)
    assert found["pilot_processor_time_s"] > 0.0
    lines = "\n".join(accuracy_lines(summary))
    assert "accuracy, 0.5 % asked" in lines
    assert "largest by step size" in lines


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
        assert same[key] == pytest.approx(found[key], rel=0.005)
    # A start of its own takes it more.
    assert found["steps"] < 0.8 * same["steps"]
    assert found["cycles"] > len(found["accuracy"]["runs"])


def test_a_run_on_the_orbit_of_another_goes_on_to_the_same_result(tight_run, monkeypatch):
    show, began = recorded_run._show, {}

    def interrupted(bar, recorded, step):
        show(bar, recorded, step)
        # In the first cycle of the run after the pilot.
        began.setdefault(id(recorded), recorded.cycles.number)
        if len(began) > 1 and recorded.tracker.counts["steps"] > 10:
            assert began[id(recorded)] > 1
            raise KeyboardInterrupt

    folder = tight_run.parent / "interrupted"
    command = ("run", tight_run.parent / "scene.toml", "-o", folder)
    with monkeypatch.context() as patched:
        patched.setattr(recorded_run, "_show", interrupted)
        assert call(*command) == 130
    assert len(search_of(folder).runs) == 1
    assert call("run", "--resume", folder) == 0
    whole, own = (
        json.loads((path / "summary.json").read_text())["accuracy"] for path in (tight_run, folder)
    )
    assert (folder / "history.csv").read_bytes() == (tight_run / "history.csv").read_bytes()
    assert [run["estimate"] for run in own["runs"]] == [run["estimate"] for run in whole["runs"]]


def test_a_search_is_found_again_in_its_folder(tight_run):
    search = search_of(tight_run)
    search.leave(tight_run)
    assert search_of(tight_run) == search
    assert search.met
    assert not search.wanted
    assert search_of(tight_run.parent) is None


def test_an_error_that_is_not_estimated_is_refused_by_name():
    scene, search = begun(changed(read_scene("four-bar"), {"output.accuracy": 0.01}))
    known = dict.fromkeys(COMPONENTS, 1e-3) | dict.fromkeys(("basis", "part_mesh"), NOT_APPLICABLE)
    lacking = known | {"film_mesh": NOT_ESTIMATED}
    budget = {"max_pressure": known | {"known": 2e-3}, "min_film_thickness": lacking}
    recorded = SimpleNamespace(tracker=SimpleNamespace(worth={"pin": budget}))
    notes = {"error_budget_notes": {"film_mesh": "the oil is compressible"}}
    with pytest.raises(AccuracyError, match=r"joints.pin by film mesh .* the oil is compressible"):
        account(search, scene, recorded, notes)


def judged_rod(**errors):
    """Stand-in of a slider-crank's run with some errors of its figures."""
    grid = SimpleNamespace(cells=(22, 6), family="lagrange")
    film = SimpleNamespace(film=SimpleNamespace(parameters=SimpleNamespace(grid=grid)))
    place = SimpleNamespace(name="big_end", bore="bore", bore_body="rod", film=film)
    budget = dict.fromkeys(COMPONENTS, 1e-4) | errors
    budget = {"known": sum(budget.values())} | budget
    budget["between_nodes"] = 0.5 * budget["film_mesh"]
    worth = {"big_end": dict.fromkeys(QUANTITIES, budget)}
    system = SimpleNamespace(films=[place])
    run = SimpleNamespace(
        equations=SimpleNamespace(system=system),
        control=SimpleNamespace(order=3, largest_step=2.5e-4),
        state=SimpleNamespace(time=2.5e-2),
    )
    tracker = SimpleNamespace(
        worth=worth, counts={"steps": 200}, verdict=lambda _=0: "complete", balance=None
    )
    return SimpleNamespace(run=run, tracker=tracker, processor_time=1.0)


WORTH = {"error_budget_notes": {}, "error_budget_processor_time_s": 0.5}


def test_every_component_moves_its_own_setting():
    scene = changed(read_scene("slider-crank"), {"output.accuracy": 0.01})

    def wanted(keeps=(), **errors):
        kept = changed(scene, {"output.accuracy_keeps": list(keeps)})
        pilot, search = begun(kept)
        account(search, pilot, judged_rod(**errors), WORTH)
        return search.chosen, search.wanted

    before, after = wanted(basis=0.011)
    assert after["bodies.rod.reduction"]["vibration_modes"] == 12
    assert after["bodies.rod.reduction"]["method"] == "m4"
    # Four times as good with twice the cells, and a quarter of the accuracy is left for it.
    before, after = wanted(part_mesh=0.01)
    assert after["bodies.rod.geometry"]["bore_cells_around"] == 40
    assert "bodies.rod.reduction" not in after
    before, after = wanted(start=2e-3, film_mesh=0.02)
    assert after["time.periodicity"] == pytest.approx(0.5 * before["time.periodicity"])
    # Cycles differ by what steps leave.
    before, after = wanted(start=0.02)
    assert after["time.periodicity"] == pytest.approx(0.05 * before["time.periodicity"], rel=0.1)
    assert after["time.tolerance"] <= after["time.periodicity"]
    before, after = wanted(["tolerance"], start=0.02)
    assert after["time.periodicity"] == pytest.approx(1e-4)
    before, after = wanted(film_mesh=0.02)
    assert after["joints.big_end.cells"] > [22, 6]
    before, after = wanted(step_size=0.02)
    assert after["time.tolerance"] < before["time.tolerance"]
    before, after = wanted(["tolerance", "geometry"], step_size=6e-3, part_mesh=6e-3)
    assert set(after) <= {"joints.big_end.cells"}
    # Whatever is cheaper by the laws.
    before, after = wanted(film_mesh=0.02)
    assert "time.tolerance" not in after or after["time.tolerance"] < before["time.tolerance"]
    assert wanted()[1] == {}


def test_joints_of_rigid_bores_have_no_basis():
    scene, search = begun(changed(read_scene("engine"), {"output.accuracy": 0.01}))
    recorded = judged_rod(film_mesh=4e-3)
    rigid = dict.fromkeys(("basis", "part_mesh"), NOT_APPLICABLE)
    own = recorded.tracker.worth["big_end"]["max_pressure"]
    recorded.tracker.worth["front"] = dict.fromkeys(QUANTITIES, own | rigid)
    account(search, scene, recorded, WORTH)
    assert search.met
    assert search.runs[0]["errors"]["basis"] == 1e-4


def test_a_search_ends_and_says_what_is_in_the_way():
    scene = changed(
        read_scene("slider-crank"), {"output.accuracy": 0.01, "output.accuracy_keeps": ["cells"]}
    )
    scene, search = begun(scene)
    for _ in range(9):
        found = account(search, scene, judged_rod(film_mesh=0.02), WORTH)
        if not search.wanted:
            break
        scene = search.go_on(scene)
    assert not search.met
    assert len(search.runs) <= 4
    assert "is not met: the estimate is 0.02" in found["warnings"][-1]
    assert "film mesh 0.02 (joints.big_end.cells kept)" in found["warnings"][-1]


def test_numbers_of_cells_that_are_not_written_are_those_of_the_model():
    rod = read_scene("slider-crank").bodies["rod"]
    bare = attrs.evolve(rod, geometry={"bore_radius": 0.02, "shank_cells": 6})
    cells = {k: v for k, v in rod.geometry.items() if k in counts(rod)}
    assert with_counts(bare, "bodies.rod").geometry == cells | bare.geometry
    assert with_counts(rod, "bodies.rod").geometry == rod.geometry


def test_a_finer_mesh_of_a_part_is_one_that_its_model_has():
    rod = read_scene("slider-crank").bodies["rod"]
    for factor in (0.5, 1.0, 1.2, 3.0):
        cells = part_cells(rod, factor)
        assert cells["bore_cells_around"] % 10 == 0
        for key in counts(rod):
            assert cells[key] >= factor * rod.geometry[key]
        assert cells["bore_radius"] == rod.geometry["bore_radius"]
    assert part_cells(rod, 1.0) == rod.geometry


def test_cases_of_a_study_have_their_own_settings():
    asked = changed(read_scene("four-bar"), {"output.accuracy": 0.01})
    with pytest.raises(SettingsError, match="drop it"):
        make_case("one", asked, {"time.tolerance": 1e-3})


def to_its_orbit(scene, orbit=None):
    """Peak pressure and thinnest film of the four-bar's pin, the orbit, steps."""
    built = build_mechanism(scene, MPI.COMM_SELF)
    run = Run(built.mechanism, built.steps, scene.span)
    entered = None if orbit is None else orbit.entered(run, built.parts)
    tracker, cycles = Tracker(run.equations, run.norm), Cycles(run, scene.span, 1e-4)
    if entered:
        cycles.follow(orbit.cycles)
        tracker.enter(entered[0])
    for step in cycles:
        tracker.begins(cycles)
        row, _ = tracker.add(step)
        # Whatever cycle it begins with, and after whatever steps.
        assert 0.0 < row["crank_angle_deg"] <= 360.0 * (1 + 1e-9)
        assert row["step_s"] <= 1.001 * built.steps.largest * scene.span
    found = tracker.extremes["rocker_end"]
    values = np.array([getattr(found, quantity) for quantity in QUANTITIES])
    return values, Orbit(run, cycles, built.parts), tracker.counts["steps"]


def test_a_run_that_begins_on_the_orbit_of_another_finds_its_own():
    coarse = {"joints.rocker_end.cells": [16, 3], "time.tolerance": 1e-3}
    fine = changed(read_scene("four-bar"), {"time.tolerance": 2e-4})
    other, orbit, _ = to_its_orbit(changed(fine, coarse))
    own, _, many = to_its_orbit(fine)
    found, last, few = to_its_orbit(fine, orbit)
    assert np.abs(other / own - 1.0).max() > 5e-3
    np.testing.assert_allclose(found, own, rtol=5e-4)
    assert few < 0.7 * many
    assert last.cycles.number > orbit.cycles.number


def test_an_orbit_of_other_parts_is_none_to_begin_on():
    _, orbit, _ = to_its_orbit(changed(read_scene("four-bar"), {"time.tolerance": 1e-2}))
    scene = read_scene("four-bar")
    built = build_mechanism(scene, MPI.COMM_SELF)
    run = Run(built.mechanism, built.steps, scene.span)
    start = run.state
    assert replace(orbit, parts={"rod": object()}).entered(run, {"rod": object()}) is None
    assert run.state is start
    # No film is thick enough for that: the run begins at its own start.
    thick = changed(scene, {"joints.rocker_end.smallest_film": 0.9})
    built = build_mechanism(thick, MPI.COMM_SELF)
    run = Run(built.mechanism, built.steps, scene.span)
    start = run.state
    assert orbit.entered(run, built.parts) is None
    assert run.state is start


@pytest.mark.slow
@pytest.mark.parametrize("accuracy", [0.03, 0.01])
def test_true_errors_meet_the_accuracy(tmp_path, accuracy, figure):
    directory = tmp_path / "run"
    scene = write_scene(tmp_path / "scene.toml", "four-bar")
    assert call("run", scene, "--accuracy", accuracy, "--no-plots", "-o", directory) == 0
    summary = json.loads((directory / "summary.json").read_text())
    own = np.array([summary["max_pressure_Pa"], summary["min_film_thickness_m"]])
    fine = {"joints.rocker_end.cells": [60, 10], "time.tolerance": 3e-6}
    exact, *_ = to_its_orbit(changed(read_scene("four-bar"), fine))
    error = float(np.abs(own / exact - 1.0).max())
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
    assert errors[0] > 0.25 * 1.5e-2 > errors[-1]
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
    assert "output.accuracy = '1 um'" in capfd.readouterr().err
    assert call("run", scene, "--accuracy", "1e-9", "-o", tmp_path / "run") == 2
    assert "output.accuracy = 1e-09 is below 0.0001" in capfd.readouterr().err
    assert call("run", scene, "--accuracy", "1%", "--no-error-budget", "-o", tmp_path / "run") == 2
    assert "needs output.error_budget = true" in capfd.readouterr().err
