"""What is refused before any work is done for it, each in one line."""

import json
import os

import pytest
from hand_made_rod import Joint, make_body
from sweep_cases import LOADED_JOURNAL, exit_of, write_scene

from fenics_ehd.commands.reduction import reduce_part
from fenics_ehd.errors import MeshError, SettingsError
from fenics_ehd.key_hints import key_hint
from fenics_ehd.reduction import save_body

KIND = 'scene = "slider-crank"\n'
GAS = "angle_deg,force_N\n0,80\n90,10\n180,20\n360,80\n"


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
    def write(text):
        path = tmp_path / "mine.toml"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize(
    ("key", "text", "message"),
    [
        ("gas_force", None, "mechanism.gas_force"),
        ("gas_force", GAS.replace("90", "10e"), "line 3: angle_deg = '10e' must be a finite"),
        ("gas_force", GAS.replace(",", ";"), "line 1, has 'angle_deg;force_N': separate by commas"),
        ("gas_force", GAS.replace("360,80", "360,90"), "close the period"),
        ("gas_force", GAS.replace("10", 200_000 * "1"), "line 3: field larger than field limit"),
        ("gas_force", GAS.replace("10", "1e308"), "'1e308' must be a finite number below 1e+15"),
        ("drive_torque_table", GAS, "the header must be angle_deg,torque_Nm"),
    ],
)
@pytest.mark.parametrize("with_body", [False, True])
def test_tables(key, text, message, with_body, scene, tmp_path, capfd):
    if text is not None:
        (tmp_path / "table.csv").write_text(text)
    drive = 'drive = "torque"\n' if key == "drive_torque_table" else ""
    path = scene(f'{KIND}[mechanism]\n{drive}{key} = "table.csv"\n')
    more = []
    if with_body:
        save_body(make_body(Joint()), tmp_path / "rod.h5")
        more = ["--body", tmp_path / "rod.h5"]
    assert message in refused(capfd, "run", path, "-o", tmp_path / "out", *more)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[start]\neccentricity_x = 0.9\neccentricity_y = 0.9", "start.eccentricity_x"),
        ("[time]\nsmallest_step = 1e-5", "time.smallest_step = 1e-05"),
        ("[mechanism]\ndrive_torque = 5.0", 'set mechanism.drive = "torque"'),
        ("[mechanism]\nclearance = 17e-6", "did you mean bearing.clearance?"),
    ],
)
def test_settings_that_need_no_rod_to_be_seen(text, message, scene, tmp_path, capfd):
    assert message in refused(capfd, "run", scene(KIND + text), "-o", tmp_path / "out")


def test_settings_that_need_no_housing_to_be_seen(scene, tmp_path, capfd):
    path = scene('scene = "rotor"\n[shaft]\nmodes = 7\n')
    assert "shaft.modes = 7 must be even" in refused(capfd, "run", path, "-o", tmp_path / "out")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            f"{KIND}[mechanism]\ncrank_length = 0.2",
            "0.2 m must be below the rod's length of 0.16 m",
        ),
        (f"{KIND}[bearing]\nclearance = 2e-3", "bearing.clearance = 0.002 m must be below 0.05"),
        (f"{KIND}[bearing]\nclearance = 2e-8", "0.0225 m: lengths are in metres"),
        ('scene = "rotor"\n[shaft]\ndiameter = 0.05', "shaft.diameter = 0.05 m must be that of"),
    ],
)
def test_sizes_that_do_not_fit_the_part_are_refused_once_it_is_meshed(
    text, message, scene, tmp_path, capfd, monkeypatch
):
    monkeypatch.delattr("fenics_ehd.scenes.rod.reduce_structure")
    monkeypatch.delattr("fenics_ehd.scenes.housing.reduce_structure")
    status, _, errors = exit_of(capfd, "run", scene(text), "-o", tmp_path / "out")
    assert status == 2, errors
    assert message in errors.splitlines()[-1]


@pytest.mark.parametrize("command", [("run",), ("sweep", "--set", "clearance=1e-5")])
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[mechanism]\n", "scene is missing: slider-crank, rotor or loaded-journal"),
        (LOADED_JOURNAL.replace('scene = "loaded-journal"', ""), "scene is missing: slider-crank"),
        (
            'scene = "slidercrank"\n',
            "scene = 'slidercrank' must be slider-crank, rotor or loaded-journal: did you mean "
            "slider-crank?",
        ),
        ("scene = 3\n", "scene = 3 must be slider-crank, rotor or loaded-journal"),
        ("[scene]\n", "scene = {} must be slider-crank, rotor or loaded-journal"),
    ],
)
def test_file_that_is_of_no_machine(command, text, message, scene, tmp_path, capfd):
    assert message in refused(capfd, *command, scene(text), "-o", tmp_path / "out")


def test_table_that_is_no_file_is_not_waited_for(scene, tmp_path, capfd):
    os.mkfifo(tmp_path / "table.csv")
    path = scene(f'{KIND}[mechanism]\ngas_force = "table.csv"\n')
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


def test_name_of_a_machine_that_is_misspelt(tmp_path, capfd):
    line = refused(capfd, "run", "slider_crank", "-o", tmp_path / "out")
    assert line.endswith("did you mean slider-crank?")


def reduce_rod_of(path, target):
    reduce_part("conrod", str(target), str(path), None, None, (), {}, False)


def test_part_of_another_machine_or_of_an_unknown_one(scene, tmp_path):
    with pytest.raises(SettingsError, match="scene = 'rotor' must be slider-crank here"):
        reduce_rod_of(scene('scene = "rotor"\n'), tmp_path / "rod.h5")
    with pytest.raises(SettingsError, match=r"unknown key load: .*slider-crank assumed"):
        reduce_rod_of(scene("[load]\nscale = 2\n"), tmp_path / "rod.h5")


def test_parameter_that_the_model_does_not_have(scene, tmp_path):
    with pytest.raises(MeshError) as caught:
        reduce_rod_of(scene("[rod.geometry]\nbore_diameter = 0.05\n"), tmp_path / "rod.h5")
    message = str(caught.value)
    assert "did you mean bore_width or bore_radius? it has big_end_layers," in message
    assert "Model dimension" not in message
    assert "Input files" not in message


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "slider-crank", "--body", "nobody.h5"], "body file nobody.h5: no such file"),
        (["run", "--resume", "nosuch"], "nosuch: no checkpoint to go on from, no such folder"),
        (["run", "--resume", "junk"], "junk: no checkpoint to go on from, it has no checkpoint.h5"),
        (["plot", "junk"], "junk: not a results folder, it has no history.csv"),
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
    path = write_scene(tmp_path, LOADED_JOURNAL)
    for arguments in (["plot", "run"], ["run", path], ["run", "slider-crank"]):
        line = refused(capfd, *arguments, "-o", "/proc/no_folder")
        assert "output /proc/no_folder: " in line


def test_output_without_permission_says_what_helps_in_a_container(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)
    line = refused(capfd, "run", "slider-crank", "-o", tmp_path / "out")
    assert f"no permission to write to {tmp_path}" in line
    assert line.endswith('mkdir -p results and give docker run --user "$(id -u):$(id -g)"')


def test_numbers_in_another_unit_perhaps_are_named_and_kept(scene, tmp_path, capfd):
    text = f"{KIND}[mechanism]\nrevolutions = 0.002\n[bearing]\nviscosity = 10\n"
    save_body(make_body(Joint()), tmp_path / "rod.h5")
    given = ["--body", tmp_path / "rod.h5", "-o", tmp_path / "out", "--no-plots"]
    status, _, errors = exit_of(capfd, "run", scene(text), *given)
    assert status == 0, errors
    warning = "bearing.viscosity = 10 is outside the usual 1e-05 to 1: in Pa s, 0.01 for 10 mPa s"
    assert f"fenics-ehd: warning: {warning}\n" in errors
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["warnings"] == [warning]


def test_hint_prefers_the_same_word_then_the_same_section():
    known = ["scene", "bearing", "bearing.clearance", "bearing.radius", "rod", "rod.cells",
             "film", "film.cells"]  # fmt: skip
    assert key_hint(known, "rod.clearance") == "did you mean bearing.clearance?"
    assert key_hint(known, "rod.cell") == "did you mean rod.cells?"
    assert key_hint(known, "road.cell") == "did you mean rod.cells or film.cells?"
    assert key_hint(known, "bering") == "did you mean bearing?"
    assert key_hint(known, "rod.frobnicate") == "known: rod.cells"
    assert key_hint(known, "frobnicate") == "known: scene, bearing, rod, film"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["-o", "x.npz", "--export", "npz"], "--export npz would write over x.npz of -o"),
        (["-o", "x.h5", "--basis", "./x.h5"], "--basis would write over ./x.h5 of -o"),
        (["-o", "pipe"], "pipe is neither a file nor a folder"),
        (["-o", "x.h5", "--basis", "pipe"], "pipe is neither a file nor a folder"),
        (["-o", "folder.h5", "--export", "npz"], "--export npz would write a file folder.npz: it"),
        (["-o", "here.h5", "--export", "mtx"], "--export mtx would write a folder here-mtx: it is"),
    ],
)
def test_outputs_of_a_reduction(options, message, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.npz").mkdir()
    (tmp_path / "here-mtx").write_text("mine")
    # In place of a device: this test must never be able to replace one of the machine's.
    os.mkfifo(tmp_path / "pipe")
    assert message in refused(capfd, "reduce", "conrod", *options)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder.npz", "here-mtx", "pipe"]


def test_a_pipe_for_a_body(tmp_path, scene, capfd):
    os.mkfifo(tmp_path / "rod.h5")
    arguments = ("run", scene(KIND), "--body", tmp_path / "rod.h5", "-o", tmp_path / "out")
    assert "rod.h5: not a regular file" in refused(capfd, *arguments)
