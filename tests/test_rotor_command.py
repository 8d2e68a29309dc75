"""The command rotor: results, tables, pictures, interrupted maps, and bad input in one line."""

import csv
import json
from dataclasses import replace
from io import BytesIO
from shutil import copyfile, copytree
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import call, exit_of

import fenics_ehd as ehd
from fenics_ehd.analysis import rotor_map as engine
from fenics_ehd.cli.main import main
from fenics_ehd.cli.rotor import _mode_lines, report
from fenics_ehd.multibody.mechanism import System
from fenics_ehd.plotting.picture import plt
from fenics_ehd.plotting.rotor import (
    LABEL_DISTANCE,
    MARGIN,
    campbell,
    decrement,
    label_curves,
    mode_shapes,
)
from fenics_ehd.scenes.kept_bodies import checksum
from fenics_ehd.scenes.rotor_map import plan_map
from fenics_ehd.scenes.scene import scene_text
from fenics_ehd.study import rotor_folder
from fenics_ehd.study.rotor_folder import StoredPoints

COARSE = {"joints.left.cells": [16, 3], "joints.right.cells": [16, 3]}
SPEEDS = "3000rpm:11000rpm:5"


def write(folder, **changes):
    """Scene file of the shipped rotor with coarse films and an unbalance in place of its force."""
    scene = ehd.read_scene("rotor-two-bearings")
    tables = {**scene.tables, "forces": {**scene.tables["forces"]}}
    tables["forces"]["unbalance"] = {"kind": "unbalance", "point": "shaft.disk", "magnitude": 4e-4}
    path = folder / "machine.toml"
    path.write_text(scene_text(ehd.read_scene(tables, **COARSE, **changes)))
    return path


@pytest.fixture(scope="module")
def complete(tmp_path_factory):
    """Scene file, and folder of a complete map of it on one film mesh."""
    folder = tmp_path_factory.mktemp("rotor")
    path = write(folder)
    out = folder / "map"
    assert call("rotor", path, "--speeds", SPEEDS, "--meshes", "1", "-o", out) == 0
    return path, out


def rows(path):
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_tables_summary_and_pictures_are_those_of_the_map(complete):
    path, out = complete
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "complete"
    chart = ehd.rotor_map(ehd.read_scene(path), np.linspace(3000, 11000, 5) * np.pi / 30, meshes=1)
    np.testing.assert_allclose(summary["stability_limit_rad_per_s"], chart.stable_below, rtol=1e-6)
    (limit,) = summary["stability_limits"]
    assert 0.4 < limit["whirl_ratio"] < 0.55
    assert limit["stability"] == "lost"
    assert limit["direction"] > 0.5
    for each in (*summary["critical_speeds"], *summary["resonances"]):
        assert each["unstable"] == (each["speed_rad_per_s"] > chart.stable_below)
    modes = rows(out / "modes.csv")
    assert len(modes) == (chart.tracks >= 0).sum()
    lost = [row for row in modes if float(row["real_part_1_per_s"]) > 1.0]
    assert min(float(row["speed_rad_per_s"]) for row in lost) > chart.stable_below
    for row in modes:
        decrement = row["logarithmic_decrement"]
        assert bool(decrement) == (float(row["frequency_rad_per_s"]) != 0.0)
    films = rows(out / "films.csv")
    assert len(films) == len(chart.speeds)
    assert float(films[0]["left.reynolds_number"]) > 1.0
    assert {row["point"] for row in rows(out / "shapes.csv")} >= {"shaft.disk", "shaft[0]"}
    response = rows(out / "unbalance.csv")
    middle = chart.response.amplitude("shaft.disk")
    np.testing.assert_allclose(
        [float(row["shaft.disk.amplitude_m"]) for row in response], middle, rtol=1e-6
    )
    for name in ("campbell", "decrement", "mode_shapes-1", "unbalance"):
        assert (out / f"{name}.png").stat().st_size > 5000


def test_a_map_again_reads_its_points_and_further_speeds_are_added(complete, capfd, monkeypatch):
    path, out = complete
    stored = len(list((out / "points").glob("*.npz")))
    before = (out / "modes.csv").read_bytes()

    def refused(*_arguments, **_settings):
        raise AssertionError("a stored speed was computed again")

    with monkeypatch.context() as patch:
        patch.setattr(engine, "equilibrium", refused)
        status, printed, _ = exit_of(
            capfd, "rotor", path, "--speeds", SPEEDS, "--meshes", "1", "-o", out, "--json",
            "--no-plots",
        )  # fmt: skip
    assert status == 0
    assert json.loads(printed)["speeds"] == len(
        {r["speed_rad_per_s"] for r in rows(out / "modes.csv")}
    )
    assert (out / "modes.csv").read_bytes() == before
    more = f"{SPEEDS},350 rad/s"
    assert call("rotor", path, "--speeds", more, "--meshes", "1", "-o", out, "--no-plots") == 0
    assert len(list((out / "points").glob("*.npz"))) >= stored + 1


def test_an_interrupted_map_is_continued(complete, tmp_path, monkeypatch):
    path, out = complete
    folder = tmp_path / "map"
    arguments = ("rotor", path, "--speeds", SPEEDS, "--meshes", "1", "-o", folder, "--no-plots")
    once = engine.equilibrium
    calls = []

    def stopping(*positional, **settings):
        calls.append(1)
        if len(calls) > 3:
            raise KeyboardInterrupt
        return once(*positional, **settings)

    with monkeypatch.context() as patch:
        patch.setattr(engine, "equilibrium", stopping)
        assert call(*arguments) == 130
    assert not (folder / "summary.json").exists()
    assert len(list((folder / "points").glob("*.npz"))) == 3
    assert call(*arguments) == 0
    summaries = [json.loads((f / "summary.json").read_text()) for f in (out, folder)]
    for name in ("stability_limit_rad_per_s", "whirl_ratio"):
        np.testing.assert_allclose(summaries[1][name], summaries[0][name], rtol=1e-4)


def changed(**others):
    """Function that changes arrays of a stored point, and keeps its other arrays."""

    def change(content):
        with np.load(BytesIO(content)) as stored:
            arrays = {name: stored[name] for name in stored.files}
        arrays |= {name: make(arrays[name]) for name, make in others.items()}
        written = BytesIO()
        np.savez(written, **arrays)
        return written.getvalue()

    return change


def array_alone(_content):
    written = BytesIO()
    np.save(written, np.ones(3))
    return written.getvalue()


DAMAGES = {
    "a file cut short": lambda content: content[:500],
    "an array alone": array_alone,
    "small matrices": changed(mass=lambda _: np.eye(2), damping=lambda _: np.eye(2)),
    "numbers that are not finite": changed(stiffness=lambda matrix: np.nan * matrix),
    "another number of coordinates": changed(basis=lambda basis: basis[:, :-1]),
    "another speed": changed(speed=lambda speed: 1.1 * speed),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_point_is_not_used(damage, complete, tmp_path):
    _, out = complete
    made_by = checksum(json.loads((out / "rotor.json").read_text()))
    points = copytree(out / "points", tmp_path / "points")
    first, *others = sorted(points.glob("*.npz"))
    first.write_bytes(DAMAGES[damage](first.read_bytes()))
    stored = StoredPoints(points, made_by)
    assert len(stored) == len(others)
    (notice,) = stored.notices
    assert notice.startswith(f"{first} is damaged, or belongs to a map with other settings")


def test_a_point_of_another_map_is_computed_again_with_one_line(complete, tmp_path, capfd):
    _, out = complete
    other = write(tmp_path, **{"joints.left.clearance": 41e-6})
    (tmp_path / "map" / "points").mkdir(parents=True)
    arguments = ("--speeds", "3000rpm", "--meshes", "1", "-o", tmp_path / "map", "--no-plots")
    assert call("rotor", other, *arguments) == 0
    before = (tmp_path / "map" / "modes.csv").read_bytes()
    for path in (tmp_path / "map" / "points").glob("*.npz"):
        copyfile(out / "points" / "0001.npz", path)
    capfd.readouterr()
    status, _, error = exit_of(capfd, "rotor", other, *arguments)
    assert status == 0
    assert error.count("0001.npz is damaged, or belongs to a map with other settings") == 1
    assert (tmp_path / "map" / "modes.csv").read_bytes() == before


def test_a_folder_of_another_scene_is_refused(complete, tmp_path, capfd):
    _, out = complete
    other = write(tmp_path, **{"joints.left.clearance": 41e-6})
    arguments = ("rotor", other, "--speeds", "500", "--meshes", "1", "-o", out, "--no-plots")
    status, _, error = exit_of(capfd, *arguments)
    assert status == 2
    assert "has the rotor map of another scene (joints.left.clearance is 4e-05" in error
    assert "--overwrite" in error


def test_another_unbalance_of_the_scene_uses_the_stored_points(complete, tmp_path, monkeypatch):
    path, out = complete
    folder = copytree(out, tmp_path / "map")
    heavier = tmp_path / "machine.toml"
    heavier.write_text(path.read_text().replace("magnitude = 0.0004", "magnitude = 0.0008"))
    assert heavier.read_text() != path.read_text()
    monkeypatch.setattr(engine, "equilibrium", None)
    arguments = ("--speeds", SPEEDS, "--meshes", "1", "-o", folder, "--no-plots")
    assert call("rotor", heavier, *arguments) == 0
    before, after = (rows(each / "unbalance.csv")[0] for each in (out, folder))
    column = "shaft.disk.amplitude_m"
    assert float(after[column]) == pytest.approx(2 * float(before[column]))


def test_requested_mode_shapes_are_those_of_their_own_speeds(complete, tmp_path):
    path, out = complete
    folder = copytree(out, tmp_path / "map")
    arguments = ("--speeds", SPEEDS, "--meshes", "1", "-o", folder, "--no-plots")
    assert call("rotor", path, *arguments, "--shapes", "400,100 rad/s:500 rad/s:2") == 2
    assert call("rotor", path, *arguments, "--shapes", "3000 1/min,4000 1/min") == 0
    shown = sorted({float(row["speed_rad_per_s"]) for row in rows(folder / "shapes.csv")})
    assert shown == pytest.approx([100 * np.pi, 400 / 3 * np.pi])


def test_unbalances_that_cancel_each_other_are_named(complete, tmp_path, capfd):
    path, out = complete
    folder = copytree(out, tmp_path / "map")
    both = ("--unbalance", "shaft.disk=1e-4@20", "--unbalance", "shaft.disk=1e-4@200")
    arguments = ("--speeds", SPEEDS, "--meshes", "1", "-o", folder, "--no-plots", *both)
    status, printed, error = exit_of(capfd, "rotor", path, *arguments)
    assert status == 0
    assert "the unbalances at shaft.disk cancel each other: no force acts" in error
    assert "resonance" not in printed
    assert {float(row["shaft.disk.amplitude_m"]) for row in rows(folder / "unbalance.csv")} == {0.0}


def test_a_map_needs_neither_times_nor_a_drive():
    tables = json.loads(json.dumps(ehd.read_scene("rotor-two-bearings", **COARSE).tables))
    chart = ehd.rotor_map(ehd.read_scene(tables), [500.0], meshes=1)
    del tables["time"]
    del tables["drives"]
    scene = ehd.read_scene(tables)
    bare = ehd.rotor_map(scene, [500.0], meshes=1)
    slow = np.abs(chart.roots[:, 0]) < 1000.0
    np.testing.assert_allclose(bare.roots[slow], chart.roots[slow], rtol=1e-5)
    with pytest.raises(ehd.errors.SettingsError, match=r"^give either time\.end or time\.revolut"):
        ehd.build(scene)


def test_a_map_of_a_scene_without_times_takes_further_speeds():
    """The times that such a scene gets for its steps depend on the speeds, its points do not."""
    tables = json.loads(json.dumps(ehd.read_scene("rotor-two-bearings", **COARSE).tables))
    del tables["time"]
    scene = ehd.read_scene(tables)
    first, second = (plan_map(scene, speeds, meshes=1) for speeds in ([500.0], [300.0, 500.0]))
    assert first.scene.time != second.scene.time
    assert rotor_folder._identity(first) == rotor_folder._identity(second)


def test_a_folder_without_points_takes_another_scene(complete, tmp_path):
    path, _ = complete
    light = write(tmp_path, **{"joints.left.clearance": 41e-6})
    heavy = tmp_path / "heavy.toml"
    heavy.write_text(
        light.read_text().replace("acceleration = [0.0, -9.81]", "acceleration = [0.0, -1e7]")
    )
    arguments = ("--speeds", "500", "--meshes", "1", "-o", tmp_path / "map", "--no-plots")
    assert call("rotor", heavy, *arguments) == 1
    assert call("rotor", path, *arguments) == 0


def test_a_speed_without_equilibrium_gives_status_1_and_the_others_stay(
    complete, tmp_path, capfd, monkeypatch
):
    path, _ = complete
    once = engine.equilibrium

    def failing(mechanism, **settings):
        if mechanism.drives["shaft"].speed > 1000.0:
            raise ehd.errors.SolverError("no equilibrium found from the pose at the start: why")
        return once(mechanism, **settings)

    monkeypatch.setattr(engine, "equilibrium", failing)
    arguments = ("--meshes", "1", "-o", tmp_path / "map", "--no-plots")
    status, printed, error = exit_of(capfd, "rotor", path, "--speeds", "500,600,1100", *arguments)
    assert status == 1
    assert (
        "1 of 3 speeds have no equilibrium, the first is 1100 rad/s: no equilibrium found" in error
    )
    assert "2 speeds from 500 rad/s" in printed
    summary = json.loads((tmp_path / "map" / "summary.json").read_text())
    assert summary["status"].startswith("incomplete")
    assert [failed["speed_rad_per_s"] for failed in summary["failed_speeds"]] == [1100.0]


REFUSED = {
    "a speed of another kind": (["--speeds", "1000 m"], "--speeds = '1000 m' must be a number"),
    "a range without a count": (["--speeds", "1:2"], "first:last:count"),
    "no speed": (["--speeds", "0"], "--speeds: 0 rad/s has no equilibrium"),
    "both senses": (["--speeds", "500,-500"], "different signs"),
    "an unknown body": (["--speeds", "500", "--of", "rotor"], "--of: there is no body 'rotor'"),
    "a malformed unbalance": (
        ["--speeds", "500", "--unbalance", "shaft.disk"],
        "--unbalance 'shaft.disk' must be POINT=MAGNITUDE",
    ),
    "an unbalance at no point": (
        ["--speeds", "500", "--unbalance", "shaft.rim=1e-4"],
        "body shaft has no point 'rim'",
    ),
    "an option twice": (["--speeds", "300", "--speeds=500"], "--speeds is given 2 times: give it"),
    "an unbalance of a shaft": (
        ["--speeds", "500", "--unbalance", "shaft=1e-4"],
        "unbalance = 'shaft': a shaft needs one of its points: shaft.left, shaft.",
    ),
    "an unbalance of the ground": (
        ["--speeds", "500", "--unbalance", "ground.left=1e-4"],
        "body ground does not rotate at the speeds",
    ),
    "a negative unbalance": (
        ["--speeds", "500", "--unbalance", "shaft.disk=-1"],
        "magnitude = -1.0 must be at least 0",
    ),
    "another unit of an unbalance": (
        ["--speeds", "500", "--unbalance", "shaft.disk=1 kg"],
        "kg is a unit of another quantity",
    ),
    "shapes outside the range": (
        ["--speeds", "500:600:2", "--shapes", "400,700"],
        "--shapes: 400 rad/s (3820 1/min) is not between the speeds of the map, 500 rad/s",
    ),
    "too many meshes": (["--speeds", "500", "--meshes", "9"], "9 is not in the range 1<=x<=4"),
}


ARGUMENTS = {
    "one speed": ({"speeds": 400.0}, "speeds = 400 must be a list of speeds [rad/s]"),
    "an array of one speed": ({"speeds": np.array(400.0)}, "speeds = 400 must be a list"),
    "rows of speeds": ({"speeds": np.ones((2, 2))}, "speeds[0] = [1, 1] must be a finite"),
    "a text": ({"speeds": "400"}, "speeds = '400' must be a list"),
    "a speed in kg": ({"speeds": ["4000 kg"]}, "speeds[0] = '4000 kg' must be a number in rad/s"),
    "an unknown speed": ({"speeds": [400.0, None]}, "speeds[1] = None must be a finite number"),
    "a complex speed": ({"speeds": [1j]}, "speeds[0] = 1j must be a finite number"),
    "a speed beyond all bounds": ({"speeds": [np.inf]}, "speeds[0] = inf must be a finite number"),
    "several bodies": ({"of": ["shaft"]}, "of = ['shaft'] is of class list: str is needed"),
    "a magnitude alone": ({"unbalance": 5}, "unbalance = 5 must be a list of Unbalance forces"),
    "a point alone": ({"unbalance": "shaft.disk"}, "unbalance = 'shaft.disk' must be a list"),
    "a magnitude as text": (
        {"unbalance": {"shaft.disk": "1e-4"}},
        "unbalance['shaft.disk']: magnitude = '1e-4' must be a number in kg m",
    ),
    "a number as point": ({"unbalance": {5: 1e-4}}, "point = 5 must be"),
    "part of a mesh": ({"meshes": 1.5}, "meshes = 1.5 must be a whole number, at least 1 and at"),
}


@pytest.mark.parametrize("what", ARGUMENTS)
def test_bad_arguments_are_named_in_one_line(what):
    changes, message = ARGUMENTS[what]
    arguments = {"speeds": [400.0], **changes}
    with pytest.raises(ehd.errors.SettingsError) as refused:
        ehd.rotor_map(ehd.read_scene("rotor-two-bearings"), **arguments)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_numbers_of_numpy_and_units_are_accepted():
    scene = ehd.read_scene("rotor-two-bearings")
    unbalance = {"shaft.disk": "140 g mm"}
    plan = plan_map(scene, np.array([500, 400]), unbalance=unbalance, meshes=np.int64(1))
    assert plan.unbalances[0].magnitude == pytest.approx(1.4e-4)
    assert plan.speeds == (400.0, 500.0)
    assert type(plan.meshes) is int


@pytest.mark.parametrize("what", REFUSED)
def test_bad_input_gives_one_line(what, complete, tmp_path, capfd):
    arguments, message = REFUSED[what]
    status, printed, error = exit_of(capfd, "rotor", complete[0], *arguments, "-o", tmp_path / "m")
    assert status == 2
    assert message in " ".join(error.split())
    assert not printed
    if "Usage" not in error:
        assert len(error.strip().splitlines()) == 1


SCENES = {
    "four-bar": "four-bar",
    "a film that conserves mass": {
        "joints.left.cavitation": "mass-conserving", "joints.left.element": "bilinear",
    },
    "a groove of the journal": {
        "joints.left.supply.hole.kind": "hole", "joints.left.supply.hole.diameter": 8e-3,
        "joints.left.supply.hole.angle": 0.0, "joints.left.supply.hole.on": "journal",
        "joints.left.supply.hole.pressure": 1e5, "joints.left.cells": [16, 5],
    },
    "a shape of the journal": {"joints.left.journal_shape.ovality": 2e-6},
    "a load that no film carries": {"forces.weight.acceleration": [0.0, -1e7]},
}  # fmt: skip
REASONS = {
    "four-bar": "no equilibrium: crank.tip is carried around as its body turns: run it",
    "a film that conserves mass": "a rotor map is made of small motions about equilibria",
    "a groove of the journal": "a supply of the journal of left turns: run it",
    "a shape of the journal": "the shape or a supply of the journal of left turns: run it",
    "a load that no film carries": "no equilibrium at any speed; at 500 rad/s: no equil",
}


@pytest.mark.parametrize("what", SCENES)
def test_rotors_without_equilibria_are_refused(what):
    changes = SCENES[what]
    if isinstance(changes, str):
        scene = ehd.read_scene(changes)
    else:
        scene = ehd.read_scene("rotor-two-bearings", **{**COARSE, **changes})
    kinds = (ehd.errors.SettingsError, ehd.errors.SolverError)
    with pytest.raises(kinds) as caught:
        ehd.rotor_map(scene, [500.0], meshes=1)
    assert REASONS[what] in str(caught.value)


FORCES = {
    "unbalance": {"kind": "unbalance", "point": "shaft", "magnitude": 1e-4},
    "constant": {"kind": "constant", "point": "shaft", "force": [0.0, -10.0]},
    "spring-damper": {"kind": "spring-damper", "between": ["shaft", "ground"], "stiffness": 1.0},
}


@pytest.mark.parametrize("kind", FORCES)
def test_a_force_on_a_shaft_without_a_point_is_refused(kind):
    tables = json.loads(json.dumps(ehd.read_scene("rotor-two-bearings").tables))
    tables["forces"]["more"] = FORCES[kind]
    with pytest.raises(
        ehd.errors.SettingsError, match=r"forces\.more\.\w+ = 'shaft': a shaft needs .*shaft\.disk"
    ):
        ehd.read_scene(tables)


def test_a_force_of_a_mechanism_on_a_shaft_without_a_point_is_refused():
    mechanism = ehd.build(ehd.read_scene("rotor-two-bearings", **COARSE)).mechanism
    forces = {"more": ehd.Unbalance("shaft", 1e-4)}
    with pytest.raises(ehd.errors.SettingsError, match=r"forces\.more\.point = 'shaft': a shaft"):
        System(replace(mechanism, forces=forces))


def test_two_shafts_of_different_speed_need_a_choice():
    scene = ehd.read_scene("rotor-two-bearings", **COARSE)
    tables = json.loads(json.dumps(scene.tables))
    tables["bodies"]["spindle"] = {"kind": "massless"}
    tables["joints"]["seat"] = {"kind": "revolute", "between": ["spindle", "ground"]}
    tables["drives"]["spindle"] = {"kind": "speed", "speed": 100.0}
    both = ehd.read_scene(tables)
    with pytest.raises(
        ehd.errors.SettingsError, match=r"shaft \(300 rad/s\), spindle \(100 rad/s\)"
    ):
        ehd.rotor_map(both, [500.0], meshes=1)
    chart = ehd.rotor_map(both, [500.0], of="shaft", meshes=1)
    alone = ehd.rotor_map(scene, [500.0], meshes=1)
    np.testing.assert_allclose(chart.roots, alone.roots, rtol=1e-6)


def test_the_limit_of_laminar_flow_gives_a_notice():
    thin = {"lubricants.oil.viscosity": 2e-4, "forces.weight.acceleration": [0.0, -0.5]}
    chart = ehd.rotor_map(
        ehd.read_scene("rotor-two-bearings", **COARSE, **thin), [500.0, 900.0], meshes=1
    )
    (notice,) = [line for line in chart.notices if line.startswith("joints.left")]
    assert "above Taylor's limit of laminar flow, 41 sqrt(R / c) = 916.8" in notice


def test_heat_is_balanced_at_each_speed():
    oil = {"lubricants.oil.viscosity": 0.0, "lubricants.oil.grade": "ISO VG 32"}
    heat = {f"joints.{name}.heat.supply_temperature": 45.0 for name in ("left", "right")}
    scene = ehd.read_scene("rotor-two-bearings", **COARSE, **oil, **heat)
    chart = ehd.rotor_map(scene, [400.0, 700.0], meshes=1)
    column = "left.effective_temperature_C"
    temperatures = [point.figures[column] for point in chart.points]
    assert 45.0 < temperatures[0] < temperatures[-1]
    flow, power = (chart.points[-1].figures[f"left.{name}"] for name in (
        "leaving_flow_m3_per_s", "dissipated_power_W"))  # fmt: skip
    bearing = chart.points[-1]
    assert flow > 0.0
    assert power > 0.0
    assert bearing.starts[0].temperatures.keys() == {"left", "right"}


def test_pictures_are_drawn_without_a_limit_and_without_a_shaft():
    body = ehd.RigidBody(6.0, 1e-3, position=(4e-6, -16e-6))
    film = ehd.Film(
        ehd.FilmParameters(
            ehd.uniform_grid(0.02, 0.02, (16, 3)), 40e-6, ehd.Lubricant(0.008), 500.0
        )
    )
    joint = ehd.LubricatedJoint("rotor", "ground", film, eccentricity=(4e-6, -16e-6))

    def make(speed):
        drives = {"rotor": ehd.Speed(speed)}
        return ehd.Mechanism({"rotor": body}, {"b": joint}, drives, gravity=(0.0, -9.81))

    chart = engine.rotor_map_of([make], [500.0])
    assert not chart.limits
    for figure in (campbell(chart), decrement(chart), mode_shapes(chart, 0)):
        assert figure.axes
    curves = [line for line in decrement(chart).axes[0].lines if len(line.get_xdata()) == 1]
    assert curves
    assert all(line.get_marker() == "o" for line in curves)
    failed = replace(chart, failures={900.0: "no equilibrium found"})
    for figure in (campbell(failed), decrement(failed)):
        (axes, *_) = figure.axes
        labels = [text.get_text() for text in axes.get_legend().get_texts()]
        assert labels[-1] == "no equilibrium"
        ends = np.array([500.0 - MARGIN * 400.0, 900.0 + MARGIN * 400.0])
        assert axes.get_xlim() == pytest.approx(ends * 30 / np.pi)
    # The map of one speed prints its modes; the diagram reaches 15 % above the 1x line.
    (axes, *_) = campbell(chart).axes
    assert axes.get_ylim()[1] == pytest.approx(1.15 * 500.0 / (2 * np.pi))
    summary = {"scene": "rotor", "stable_at_first_speed": True, "meshes": 1, "directory": "map"}
    lines = report(chart, summary)
    root = next(root for root in chart.roots[:, 0] if root.imag > 0)
    (line,) = [line.split() for line in lines if line.startswith("1 ")]
    assert line[1] == f"{root.imag:.5g}"
    assert float(line[3]) == pytest.approx(-root.real / abs(root), abs=5e-4)


def test_numbers_of_curves_that_end_at_one_speed_are_apart_and_within_the_diagram():
    figure, axes = plt.subplots()
    axes.set(xlim=(0.0, 10.0), ylim=(0.0, 100.0))
    heights = [10.0, 10.5, 11.0, 98.0, 99.0, 99.5]
    label_curves(axes, {number: (8.0, height) for number, height in enumerate(heights)})
    positions = [text.xyann for text in axes.texts]
    drawn = np.array([height for _, height in positions])
    assert np.diff(drawn).min() >= 100.0 * LABEL_DISTANCE * (1 - 1e-9)
    assert drawn.max() <= 100.0
    assert {text.xy for text in axes.texts} == {(8.0, height) for height in heights}
    plt.close(figure)


def test_help_loads_no_arrays(capfd):
    with pytest.raises(SystemExit):
        main(["rotor", "--help"])
    assert "Campbell diagram" in capfd.readouterr().out


def test_modes_of_a_single_speed_have_their_scatter():
    chart = SimpleNamespace(
        roots=np.array([[-3.0 + 4.0j]]),
        scatter=np.array([[0.1 + 0.2j]]),
        direction=lambda n, track: 1.0,
    )
    # nu (nu 0.1 + sigma 0.2) / |root|^3 = 4 (0.4 + 0.6) / 125
    assert _mode_lines(chart)[1].split()[:8] == [
        "1",
        "4",
        "+-",
        "0.2",
        "38",
        "0.600",
        "+-",
        "0.032",
    ]
