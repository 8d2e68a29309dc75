"""``fenics-ehd stress`` on folders of runs."""

import json
import shutil
from types import SimpleNamespace

import attrs
import meshio
import numpy as np
import pytest
from command_line import call, exit_of
from hand_made_rod import Joint, make_body
from mpi4py import MPI
from scene_cases import RIGID_ROD, ROD_OF_A_FILE, write_scene
from test_stress import all_nodes

import fenics_ehd as ehd
from fenics_ehd.base.columns import Quantity
from fenics_ehd.base.files import listed
from fenics_ehd.cli.stress import instants_of
from fenics_ehd.multibody.trust import NOT_ESTIMATED
from fenics_ehd.plotting.shown import recorded
from fenics_ehd.reduction.part_files import von_mises
from fenics_ehd.results.paraview import gather_part
from fenics_ehd.scenes.part import elastic_part
from fenics_ehd.scenes.scene import as_stored

#: The paper's machine for a tenth of a revolution, its rod coarse.
SHORT = {
    "bodies.rod.geometry": {
        "bore_cells_around": 10, "bore_cells_along": 1, "shank_cells": 2, "small_end_layers": 1,
        "big_end_layers": 1,
    },
    "bodies.rod.reduction.method": "m4",
    "bodies.rod.reduction.estimate_error": False,
    "time.revolutions": 0.1,
    "time.tolerance": 1e-3,
    "time.largest_step": 0.2,
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run; its model is in the same folder."""
    place = tmp_path_factory.mktemp("stress")
    shutil.copy(ehd.model_path("conrod"), place / "rod.geo")
    model = {"bodies.rod.model": str(place / "rod.geo")}
    scene = write_scene(place / "short.toml", "slider-crank-paper", SHORT, model)
    assert call("run", scene, "--no-plots", "--no-error-budget", "-o", place / "run") == 0
    return place / "run"


@pytest.fixture(scope="module")
def whole_rod(folder):
    """Stresses at all nodes and instants by another way, with damping and without."""
    run = recorded(folder)
    scene = as_stored(folder / "scene.toml")
    settings = scene.bodies["rod"]
    settings = attrs.evolve(settings, reduction=attrs.evolve(settings.reduction))
    made = elastic_part(settings, "bodies.rod", scene.film_element("rod"), MPI.COMM_SELF).reduce()
    part = gather_part(made.structure, made.body, made.columns)
    found = {}
    for name, motion in (("balance", run.in_equilibrium("rod")), ("elastic", run.elastic("rod"))):
        shapes = [part.displacement(*row).reshape(-1) for row in zip(*motion, strict=True)]
        found[name] = all_nodes(made.structure, np.column_stack(shapes))
    return SimpleNamespace(nodes=part.nodes, **found)


def half_ranges(stress):
    """Of every node, all pairs tried."""
    best = np.zeros(len(stress))
    for i in range(stress.shape[2]):
        half = 0.5 * (stress[:, :, i + 1 :] - stress[:, :, i : i + 1])
        best = np.maximum(best, von_mises(np.moveaxis(half, 1, 2)).max(axis=1, initial=0.0))
    return best


@pytest.mark.parametrize("damping", [pytest.param(True, marks=pytest.mark.slow), False])
def test_command_finds_the_extremes_of_the_run(folder, whole_rod, damping, capfd):
    option = "--damping" if damping else "--no-damping"
    status, out, _ = exit_of(
        capfd, "stress", folder, option, "--json", "--model", folder.parent / "rod.geo"
    )
    assert status == 0
    found = json.loads(out)
    assert found == json.loads((folder / "stress.json").read_text())
    rod, stress = found["bodies"]["rod"], whole_rod.balance if damping else whole_rod.elastic
    exact = half_ranges(stress)
    data = meshio.read(folder / rod["fields"]).point_data
    limit = 1e-6 * exact.max()
    np.testing.assert_allclose(data["half_range_von_mises_Pa"], exact, atol=limit)
    worst = rod["half_range"]
    assert worst["von_mises_Pa"] == pytest.approx(exact.max(), rel=1e-6)
    node = np.argmin(np.linalg.norm(whole_rod.nodes - worst["place_m"], axis=1))
    assert exact[node] == pytest.approx(exact.max(), rel=1e-6)
    times = recorded(folder).time
    pair = np.searchsorted(times, np.array(worst["time_s"]) - 1e-12)
    np.testing.assert_allclose(worst["mean_Pa"], stress[node][:, pair].mean(axis=1), atol=limit)
    assert worst["mean_von_mises_Pa"] == pytest.approx(
        von_mises(np.array(worst["mean_Pa"])), rel=1e-9
    )
    low, high = worst["in_cells_around_Pa"]
    assert low - limit <= worst["von_mises_Pa"] <= high + limit
    errors = worst["errors"]
    assert errors["mesh"] == pytest.approx(0.5 * (high - low) / worst["von_mises_Pa"])
    known = [error for name, error in errors.items() if name != "known" and error != NOT_ESTIMATED]
    assert errors["known"] == pytest.approx(sum(known))
    tensors = np.moveaxis(stress, 1, 2)[..., np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])]
    largest = np.linalg.eigvalsh(tensors)[..., 2].max()
    assert rod["largest_principal"]["stress_Pa"] == pytest.approx(largest, rel=1e-6)
    angle = rod["largest_principal"]["crank_angle_deg"]
    assert angle == pytest.approx(np.degrees(500.0 * rod["largest_principal"]["time_s"]), abs=1e-3)


def test_command_prints_a_table_and_its_files_go_with_the_run(folder, capfd):
    status, out, _ = exit_of(
        capfd, "stress", folder, "--complete", "--model", folder.parent / "rod.geo"
    )
    assert status == 0
    for words in (
        "half-range, von Mises",
        "+- ",
        "mesh ",
        "run ",
        "its mean",
        "largest principal",
        "of crank",
        "piston",
    ):
        assert words in out
    assert "--complete" not in out
    assert json.loads((folder / "stress.json").read_text())["complete"]
    assert {"stress.json", "vtk/"} <= {*listed(folder)}
    assert "rod_stress.vtu" in listed(folder / "vtk")


@pytest.fixture
def refuse(capfd):
    """The line by which the command refuses a folder."""

    def refusal(*arguments):
        capfd.readouterr()
        status, _, message = exit_of(capfd, "stress", *arguments)
        assert status == 2
        message = message.removeprefix("reducing rod\n")
        assert message.startswith("Usage: ") or message.count("\n") == 1
        return message

    return refusal


def test_bodies_without_stresses_are_named(folder, refuse):
    assert "crank: it is rigid" in refuse(folder, "--body", "crank")
    assert "rodd: bodies of this run: crank, rod, piston" in refuse(folder, "--body", "rodd")
    assert "--complete has no effect without --damping" in refuse(
        folder, "--complete", "--no-damping"
    )


def test_folders_without_a_complete_run_are_refused(tmp_path, refuse):
    assert "no such folder" in refuse(tmp_path / "none")
    assert "no complete run: there is no summary.json" in refuse(tmp_path)
    for summary, words in (
        ('{"status": "interrupted"}', "no complete run: interrupted"),
        ('{"status": "complete", "scene": "x"}', "not a results folder, it has no history.h5"),
        ("[1]", "no complete run: there is no summary.json"),
        ('{"status": "complete", "cycle_start_s": Infinity}', "Infinity is not a finite number"),
        ('{"status": "complete", "cycle_start_s": 1e999}', "1e999 is not a finite number"),
        ('{"status": "complete", "cycle_start_s": null}', "cycle_start_s = None has the wrong"),
        ('{"status": "complete", "cycle_start_s": "x"}', "cycle_start_s = 'x' has the wrong type"),
        ('{"status": "complete", "joints": 3}', "joints = 3 has the wrong type"),
        ("{", "summary.json: not a summary of a run"),
    ):
        (tmp_path / "summary.json").write_text(summary)
        assert words in refuse(tmp_path)


@pytest.mark.parametrize(
    ("rod", "words"), [(RIGID_ROD, "it is rigid"), (ROD_OF_A_FILE, "it was read from a file")]
)
def test_runs_without_meshed_parts_are_refused(rod, words, tmp_path, refuse):
    ehd.save_body(make_body(Joint()), tmp_path / "rod.h5")
    times = {"time.revolutions": 0.001, "time.tolerance": 1e-3}
    scene = write_scene(tmp_path / "scene.toml", "slider-crank-paper", rod, times)
    assert call("run", scene, "--no-plots", "--no-error-budget", "-o", tmp_path / "run") == 0
    message = refuse(tmp_path / "run")
    assert "no body of this run has stresses" in message
    assert f"rod: {words}" in message


def test_a_program_that_the_folder_names_runs_only_if_the_user_names_it_unchanged(folder, refuse):
    model, ran = folder.parent / "rod.geo", folder.parent / "ran"
    text = model.read_text()
    model.write_text(f'SystemCall "touch {ran}";\n{text}')
    try:
        assert "but the value is rod.geo" in refuse(folder)
        assert "bodies.rod was made with model = rod.geo" in refuse(folder, "--model", model)
    finally:
        model.write_text(text)
    unnamed, other = refuse(folder), refuse(folder, "--model", folder / "scene.toml")
    assert f"allow it to run by --model {model}" in unnamed == other
    assert not ran.exists()


def test_angles_are_those_of_the_run():
    """Of the fifth cycle of a four-stroke: 370 degrees are no 10, another dead centre."""
    turned = np.array([0.0, 100.0, 370.0, 720.0])
    values = {
        "time": Quantity(turned, "s"),
        "run/time": Quantity(turned, "s"),
        "run/crank_angle": Quantity(turned, "deg"),
        "bodies/crank/angle": Quantity(np.radians(4 * 720.0 + turned), "rad"),
    }
    instants = instants_of(ehd.read_scene("engine"), ehd.History(values))
    np.testing.assert_array_equal(instants["crank_angle_deg"], turned)


def test_instants_are_those_of_the_cycle_that_the_figures_are_of():
    """From its start on, if a step is there; all that a periodic run keeps."""
    time = np.linspace(0.0, 5.0, 26)

    def first(start, skipped=0):
        summary = {"cycle_used": "last of 1", "cycle_start_s": start, "cycle_end_s": 5.0}
        values = {"time": Quantity(time[skipped:], "s")}
        return ehd.History(values, entries=summary).last_cycle().values["time"][0]

    assert first(1.0) == pytest.approx(1.0)
    assert first(1.1) == pytest.approx(1.2)
    assert first(0.0) == 0.0
    assert first(2.0, skipped=11) == time[11]
