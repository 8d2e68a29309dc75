"""What is refused before any work is done for it, each in one line."""

import json
import os

import pytest
from bench_output import reduce_part
from command_line import exit_of
from hand_made_rod import Joint, make_body
from scene_cases import LOADED_JOURNAL, ROD_OF_A_FILE, write_scene

import fenics_ehd as ehd

GAS = "angle_deg,force_N\n0,80\n90,10\n180,20\n360,80\n"

#: A table named table.csv, by what it is of.
TABLES = {
    "forces.gas.file": {
        "forces.gas": {
            "kind": "angle-table", "point": "piston", "angle_of": "crank", "file": "table.csv"
        }
    },
    "drives.crank.table": {
        "drives.crank": {"kind": "torque", "table": "table.csv"}, "bodies.crank.speed": 500.0
    },
}  # fmt: skip


def refused(capfd, *arguments):
    """The last line of the error output of a command that must refuse its input."""
    status, output, errors = exit_of(capfd, *arguments)
    assert status == 2, errors
    assert output == ""
    assert "Traceback" not in errors
    assert "reducing" not in errors
    return errors.splitlines()[-1]


@pytest.fixture
def scene(tmp_path):
    def write(*changes, name="slider-crank-paper"):
        return write_scene(tmp_path / "mine.toml", name, *changes)

    return write


@pytest.mark.parametrize(
    ("key", "text", "message"),
    [
        ("forces.gas.file", None, "forces.gas.file"),
        ("forces.gas.file", GAS.replace("360,80", "360,90"), "close the period"),
        (
            "drives.crank.table",
            GAS,
            "line 1: column 'force_N' is not one of angle, torque, with a unit",
        ),
    ],
)
@pytest.mark.parametrize("with_body", [False, True])
def test_tables(key, text, message, with_body, scene, tmp_path, capfd):
    if text is not None:
        (tmp_path / "table.csv").write_text(text)
    path = scene(TABLES[key], ROD_OF_A_FILE if with_body else {})
    if with_body:
        ehd.save_body(make_body(Joint()), tmp_path / "rod.h5")
    assert message in refused(capfd, "run", path, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[", "mine.toml"),
        ("", "no [bodies.NAME] tables; write bodies, joints, drives and forces: 'fenics-ehd init"),
        ("scene = 3\n", "no [bodies.NAME] tables"),
        ("bodies = 3\n", "bodies = 3 must be tables: [bodies.NAME]"),
        ("[bodies]\nrod = 3\n", "bodies.rod = 3 must be a table: [bodies.rod]"),
        ("[bodies.rod]\nkind = 3\n", "bodies.rod.kind = 3: "),
        ("[bodies.rod]\nkind = []\n", "bodies.rod.kind = []: "),
        ("[body.rod]\n[bodies.rod]\n", "unknown table [body]: did you mean bodies?"),
    ],
)
def test_file_that_is_of_no_mechanism(text, message, tmp_path, capfd):
    (tmp_path / "mine.toml").write_text(text)
    line = refused(capfd, "run", tmp_path / "mine.toml", "-o", tmp_path / "out")
    assert message in line


MESH_WITHOUT_BORE = """
SetFactory("Machine-in");
Point(1) = {0, 0, 0};
l[] = Extrude {1, 0, 0} { Point{1}; Layers{2}; Recombine; };
s[] = Extrude {0, 1, 0} { Line{l[1]}; Layers{2}; Recombine; };
v[] = Extrude {0, 0, 1} { Surface{s[1]}; Layers{2}; Recombine; };
Physical Volume("rod", 1) = {v[1]};
Physical Surface("pin", 3) = {s[1]};
"""


ROD, JOURNAL = "slider-crank-paper", "loaded-journal"


@pytest.mark.parametrize(
    ("name", "changes", "arguments", "message"),
    [
        (ROD, {"bodies.rod.model": "no_bore.geo", "bodies.rod.geometry": None}, [], "'bore'"),
        (ROD, {"bodies.rod.model": "nonsense.geo"}, [], "nonsense.geo"),
        (ROD, {"bodies.rod.geometry.big_end_wal": 0.01}, [], "did you mean big_end_wall"),
        (ROD, {"bodies.rod.geometry.bore_cells_along": 2.5}, [], "2.5"),
        (ROD, {"bodies.rod.reduction.residual_modes": 81}, [], "residual_modes 81"),
        (JOURNAL, {"forces.load.file": "absent.csv"}, [], "absent.csv"),
        (JOURNAL, {"forces.load.file": "main-baering"}, [], "main-bearing"),
        (JOURNAL, {"time.period": 0.0}, [], "give time.period or time.revolutions"),
        (JOURNAL, {}, ["--method", "m3"], "--method m3: scene mine has no model to reduce"),
        (JOURNAL, {}, ["--body", "rod.h5"], "has 0 flexible bodies, not one"),
    ],
)
def test_scene_that_cannot_run(name, changes, arguments, message, scene, tmp_path, capfd):
    (tmp_path / "no_bore.geo").write_text(MESH_WITHOUT_BORE)
    (tmp_path / "nonsense.geo").write_text("this is no Gmsh model")
    path = scene(LOADED_JOURNAL if name == JOURNAL else {}, changes, name=name)
    status, _, errors = exit_of(capfd, "run", path, "-o", tmp_path / "out", *arguments)
    assert status == 2
    assert "Traceback" not in errors
    line = errors.splitlines()[-1]
    assert line.startswith("fenics-ehd: ")
    assert message in line


def test_table_that_is_no_file_is_not_waited_for(scene, tmp_path, capfd):
    os.mkfifo(tmp_path / "table.csv")
    path = scene(TABLES["forces.gas.file"])
    assert "pipe or device, not a file" in refused(capfd, "run", path, "-o", tmp_path / "out")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["run", "slider-crank", "--body", "", "-o", "out"], "--body"),
        (["run", "slider-crank", "-o", ""], "-o"),
        (["run", ""], "run"),
        (["reduce", "conrod", "--output="], "--output="),
        (["animate", "out", "-o", ""], "-o"),
        (["report", ""], "report"),
    ],
)
def test_argument_of_a_shell_variable_that_is_not_set(
    arguments, named, tmp_path, capfd, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    line = refused(capfd, *arguments)
    assert line.endswith(f"{named} is followed by nothing: is a shell variable empty?")
    assert not any(tmp_path.iterdir())


def reduce_rod_of(path, target, part="rod"):
    reduce_part(part, str(target), str(path), None, None, (), {}, False)


def test_part_of_another_mechanism_or_of_an_unknown_one(scene, tmp_path):
    with pytest.raises(
        ehd.errors.SettingsError, match="has 0 flexible bodies of that name or model, not one"
    ):
        reduce_rod_of(scene(name="rotor-paper"), tmp_path / "rod.h5")
    with pytest.raises(ehd.errors.SettingsError, match="its flexible bodies with a model: rod"):
        reduce_rod_of(scene(), tmp_path / "rod.h5", "crank")


def test_parameter_that_the_model_does_not_have(scene, tmp_path):
    with pytest.raises(ehd.errors.MeshError) as caught:
        reduce_rod_of(scene({"bodies.rod.geometry.bore_diameter": 0.05}), tmp_path / "rod.h5")
    message = str(caught.value)
    assert "did you mean bore_width or bore_radius? it has big_end_layers," in message
    assert "Model dimension" not in message
    assert "Input files" not in message


def test_model_beside_its_scene_is_found_from_anywhere(scene, tmp_path, monkeypatch):
    (tmp_path / "mine.geo").write_text("Point(1) = {0, 0, 0};\n")
    path = scene({"bodies.rod.model": "mine.geo"})
    monkeypatch.chdir("/")
    with pytest.raises(ehd.errors.MeshError, match=r"mine\.geo"):
        reduce_rod_of(path, tmp_path / "rod.h5")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "slider-crank", "--body", "nobody.h5"], "body file nobody.h5: no such file"),
        (["run", "--resume", "nosuch"], "nosuch: no checkpoint to go on from, no such folder"),
        (["run", "--resume", "junk"], "junk: no checkpoint to go on from, it has no history.h5"),
        (["plot", "junk"], "junk: not a results folder, it has no history.h5"),
        (["plot", "nosuch"], "nosuch: no such folder"),
    ],
)
def test_files_that_are_not_there(arguments, message, tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "junk").mkdir()
    assert refused(capfd, *arguments).endswith(f"Error: {message}")


def test_output_that_cannot_be_written(tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "history.csv").write_text(
        "time_s,max_pressure_Pa,min_film_thickness_m\n0,0,1\n1,1,1\n"
    )
    path = write_scene(tmp_path / "journal.toml", "loaded-journal", LOADED_JOURNAL)
    for arguments in (["plot", "run"], ["run", path], ["run", "slider-crank"]):
        line = refused(capfd, *arguments, "-o", "/proc/no_folder")
        assert "output /proc/no_folder: " in line


def test_output_without_permission_says_what_helps_in_a_container(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)
    line = refused(capfd, "run", "slider-crank", "-o", tmp_path / "out")
    assert f"no permission to write to {tmp_path}" in line
    assert line.endswith('mkdir -p results and give docker run --user "$(id -u):$(id -g)"')


def test_numbers_in_another_unit_perhaps_are_named_and_kept(scene, tmp_path, capfd):
    changes = {"time.revolutions": 0.002, "lubricants.oil.viscosity": 10.0}
    ehd.save_body(make_body(Joint()), tmp_path / "rod.h5")
    path = scene(ROD_OF_A_FILE, changes)
    options = ("-o", tmp_path / "out", "--no-plots", "--no-error-budget")
    status, _, errors = exit_of(capfd, "run", path, *options)
    assert status == 0, errors
    warning = (
        "lubricants.oil.viscosity = 10 is outside the usual 1e-05 to 1: in Pa s, 0.01 for 10 mPa s"
    )
    assert f"fenics-ehd: warning: {warning}\n" in errors
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["warnings"] == [warning]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["-o", "x.npz", "--export", "npz"], "--export npz would write over x.npz of -o"),
        (["-o", "x.h5", "--basis", "./x.h5"], "--basis would write over ./x.h5 of -o"),
        (["-o", "pipe"], "pipe is neither a file nor a folder"),
        (["-o", "x.h5", "--basis", "pipe"], "pipe is neither a file nor a folder"),
        (["-o", "folder.h5", "--export", "npz"], "--export npz would write a file folder.npz: it"),
    ],
)
def test_outputs_of_a_reduction(options, message, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.npz").mkdir()
    # In place of a device: this test must never be able to replace one of the machine's.
    os.mkfifo(tmp_path / "pipe")
    assert message in refused(capfd, "reduce", "conrod", *options)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder.npz", "pipe"]


@pytest.mark.parametrize("option", [False, True])
def test_a_pipe_for_a_body(option, tmp_path, scene, capfd):
    os.mkfifo(tmp_path / "rod.h5")
    more = ("--body", tmp_path / "rod.h5") if option else ()
    arguments = ("run", scene({} if option else ROD_OF_A_FILE), *more, "-o", tmp_path / "out")
    assert "rod.h5: not a regular file" in refused(capfd, *arguments)
