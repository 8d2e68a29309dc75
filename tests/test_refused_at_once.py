"""What is refused before any work is done for it, each in one line."""

import json
import os
import shlex

import h5py
import pytest
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


NEITHER = "give either SCENE, to start a run, or --resume DIR, to continue a run"
EMPTY = "is followed by an empty value: is a shell variable empty?"
NO_PLACE = "pipe is neither a file nor a folder"

#: Commands in a folder with texts, a pipe, an HDF5 file and folders.
COMMANDS = [
    ("frobnicate", "frobnicate"),
    ("run for-bar", "scene 'for-bar': did you mean four-bar"),
    ("run absent.toml", "absent.toml: No such file"),
    ("run slider-crank --body text.h5", "text.h5"),
    ("run slider-crank --body other.h5", "not a fenics_ehd reduced body"),
    ("run slider-crank --body missing.h5", "body file missing.h5: no such file"),
    ("run slider-crank --body a.h5 --method m3", "--body"),
    ("run --resume nosuch", "nosuch: no checkpoint to resume from, no such folder"),
    ("run --resume junk", "junk: no checkpoint to resume from, it has no history.h5"),
    ("run --resume junk slider-crank", NEITHER),
    ("run", NEITHER),
    ("run --resume broken", "history.h5"),
    ("plot junk", "junk: not a results folder, it has no history.h5"),
    ("plot nosuch", "nosuch: no such folder"),
    # A shell's variable that is not set.
    ("run slider-crank --body '' -o out", f"--body {EMPTY}"),
    ("run slider-crank -o ''", f"-o {EMPTY}"),
    ("run ''", f"run {EMPTY}"),
    ("reduce conrod --output=", f"--output= {EMPTY}"),
    ("animate out -o ''", f"-o {EMPTY}"),
    ("report ''", f"report {EMPTY}"),
    # Outputs of a reduction.
    ("reduce conrod -o x.h5 --residual-modes -1", "-1"),
    ("reduce conrod -o x.npz --export npz", "--export npz would write over x.npz, the file of -o"),
    ("reduce conrod -o x.h5 --basis ./x.h5", "--basis would write over ./x.h5, the file of -o"),
    ("reduce conrod -o pipe", NO_PLACE),
    ("reduce conrod -o x.h5 --basis pipe", NO_PLACE),
    ("reduce conrod -o folder.h5 --export npz", "folder.npz is a folder, but a file must"),
    # Sweeps.
    ("sweep absent.toml --set clearance=1e-5", "absent.toml"),
    ("sweep crank-slider --set clearance=1e-5", "crank-slider"),
    ("sweep slider-crank-paper", "--set"),
    ("sweep slider-crank-paper --set clearance", "KEY=VALUES"),
    ("sweep slider-crank-paper --set clearance=1 --set big_end.clearance=2", "given twice"),
    ("sweep slider-crank-paper --set rod.model=absent.geo", "absent.geo"),
    ("sweep slider-crank-paper --set rod.model=text.h5", "must be a .geo model or a .msh file"),
    ("sweep slider-crank-paper --set damping_time=1:2:9999 --set order=1,2", "19998 cases"),
    ("sweep slider-crank-paper --set clearance=10:20:3", "3 of 3 cases cannot run: joints.big_end"),
    ("sweep slider-crank-paper --set big_end.cells=[1000,1000]", "1000000 cells are above"),
    ("sweep slider-crank-paper --set big_end.bore=rod.hole", "body rod has no point 'hole'"),
    ("sweep slider-crank-paper --set order=1 --resume", "nothing to resume"),
    ("sweep slider-crank-paper --set order=1 --resume --overwrite", "exclude each other"),
    # Studies.
    ("study loaded-journal -o out", "scene loaded-journal cannot be studied"),
    ("study four-bar -o out", "scene four-bar cannot be studied"),
    ("study slider-crank-paper --start 1 -o out", "errors are evaluated after 1 s"),
    ("study gearbox -o out", "scene 'gearbox'"),
    ("study slider-crank-paper --workers 0 -o out", "--workers"),
]


@pytest.mark.parametrize(("command", "message"), COMMANDS)
def test_a_command_that_cannot_be_obeyed(command, message, tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for folder in ("junk", "broken", "folder.npz"):
        (tmp_path / folder).mkdir()
    for name in ("text.h5", "broken/history.h5"):
        (tmp_path / name).write_text("no HDF5")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["data"] = 1
    # In place of a device: this test must never be able to replace one of the machine's.
    os.mkfifo(tmp_path / "pipe")
    before = sorted(tmp_path.rglob("*"))
    assert message in refused(capfd, *shlex.split(command))
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("key", "text", "message"),
    [
        ("forces.gas.file", None, "forces.gas.file"),
        ("forces.gas.file", GAS.replace("360,80", "360,90"), "make the last value equal"),
        ("drives.crank.table", GAS, "line 1: column 'force_N' is not one of angle, torque: give"),
    ],
)
def test_tables(key, text, message, scene, tmp_path, capfd):
    if text is not None:
        (tmp_path / "table.csv").write_text(text)
    assert message in refused(capfd, "run", scene(TABLES[key]), "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[", "mine.toml"),
        ("", "no [bodies.NAME] tables: write bodies, joints, drives and forces; 'fenics-ehd init"),
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


ROD, JOURNAL, HOUSING = "slider-crank-paper", "loaded-journal", "rotor-paper"
RUN, REDUCE = ("run", "mine.toml", "-o", "out"), ("-o", "rod.h5", "--scene", "mine.toml")

NO_BORE = {"bodies.rod.model": "no_bore.geo", "bodies.rod.geometry": None}
OTHER_PARAMETER = "did you mean bore_width or bore_radius? it has big_end_layers,"


@pytest.mark.parametrize(
    ("name", "changes", "arguments", "message"),
    [
        (ROD, NO_BORE, RUN, "'bore'"),
        (ROD, {"bodies.rod.model": "nonsense.geo"}, RUN, "nonsense.geo"),
        (ROD, {"bodies.rod.geometry.big_end_wal": 0.01}, RUN, "did you mean big_end_wall"),
        (ROD, {"bodies.rod.geometry.bore_cells_along": 2.5}, RUN, "2.5"),
        (ROD, {"bodies.rod.reduction.residual_modes": 81}, RUN, "residual_modes 81"),
        (ROD, {"bodies.rod.geometry.bore_diameter": 0.05}, RUN, OTHER_PARAMETER),
        (JOURNAL, {"forces.load.file": "absent.csv"}, RUN, "absent.csv"),
        (JOURNAL, {"forces.load.file": "main-baering"}, RUN, "main-bearing"),
        (JOURNAL, {"time.period": 0.0}, RUN, "give either time.period or time.revolutions"),
        (JOURNAL, {}, (*RUN, "--method", "m3"), "--method m3: scene mine has no part with a model"),
        (JOURNAL, {}, (*RUN, "--body", "rod.h5"), "has 0 flexible bodies, but must have one"),
        (HOUSING, {}, ("reduce", "rod", *REDUCE), "has 0 flexible bodies of that name or model"),
        (ROD, {}, ("reduce", "crank", *REDUCE), "name one of its bodies with a model, rod"),
    ],
)
def test_scene_that_cannot_run(
    name, changes, arguments, message, scene, tmp_path, capfd, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "no_bore.geo").write_text(MESH_WITHOUT_BORE)
    (tmp_path / "nonsense.geo").write_text("this is no Gmsh model")
    scene(LOADED_JOURNAL if name == JOURNAL else {}, changes, name=name)
    status, _, errors = exit_of(capfd, *arguments)
    assert status == 2
    assert "Traceback" not in errors
    line = errors.splitlines()[-1]
    assert line.startswith("fenics-ehd: ")
    assert message in line
    # No output of Gmsh.
    assert "Model dimension" not in line
    assert "Input files" not in line


def test_model_beside_its_scene_is_found_from_anywhere(scene, tmp_path, capfd, monkeypatch):
    (tmp_path / "mine.geo").write_text("Point(1) = {0, 0, 0};\n")
    path = scene({"bodies.rod.model": "mine.geo"})
    monkeypatch.chdir("/")
    status, _, errors = exit_of(capfd, "reduce", "rod", "--scene", path, "-o", tmp_path / "rod.h5")
    assert status == 2
    assert "MeshError" in errors
    assert "mine.geo" in errors


def test_every_bad_value_of_a_sweep_is_named(scene, tmp_path, capfd):
    given = ["clearance=-1,0", "oil.viscosity=0.01,water", "big_end.cells=[4];[8,2]"]
    options = [word for assignment in given for word in ("--set", assignment)]
    line = refused(capfd, "sweep", scene(), *options, "-o", tmp_path / "out")
    for named in (
        "SettingsError: 8 of 8 cases cannot run",
        "joints.big_end.clearance = -1.0 must be above 0",
        "joints.big_end.clearance = 0.0 must be above 0",
        "lubricants.oil.viscosity = 'water' must be a finite number",
        "joints.big_end.cells = [4] must be two whole numbers",
    ):
        assert named in line
    assert not (tmp_path / "out").exists()


def test_output_that_cannot_be_written(tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = write_scene(tmp_path / "journal.toml", JOURNAL, LOADED_JOURNAL)
    for arguments in (["run", path], ["run", "slider-crank"], ["plot", "."]):
        line = refused(capfd, *arguments, "-o", "/proc/no_folder")
        assert "output /proc/no_folder: " in line
    monkeypatch.setattr(os, "access", lambda *_: False)
    line = refused(capfd, "run", "slider-crank", "-o", tmp_path / "out")
    assert f"no permission to write to {tmp_path}" in line
    # What helps in a container.
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


@pytest.mark.parametrize("what", ["body of the scene", "body of an option", "table"])
def test_a_pipe_is_not_waited_for(what, tmp_path, scene, capfd):
    changes = {"body of the scene": ROD_OF_A_FILE, "table": TABLES["forces.gas.file"]}.get(what, {})
    name, reported = (
        ("table.csv", "pipe or device") if what == "table" else ("rod.h5", "not a regular")
    )
    os.mkfifo(tmp_path / name)
    more = ("--body", tmp_path / name) if what == "body of an option" else ()
    assert reported in refused(capfd, "run", scene(changes), *more, "-o", tmp_path / "out")
