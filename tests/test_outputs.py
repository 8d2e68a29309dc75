"""Outputs that must never replace something: folders of other commands, inputs, other files."""

import os
import shutil

import h5py
import numpy as np
import pytest
from command_line import call, exit_of
from hand_made_rod import Joint, make_body
from scene_cases import ROD_OF_A_FILE, write_scene
from test_run_folder import contents

import fenics_ehd as ehd
from fenics_ehd.base.files import HEADER, claim, listed, made_by, require_output
from fenics_ehd.reduction.body import BODY_KIND, EXPORT_KIND

SHORT = ROD_OF_A_FILE | {"time.revolutions": 0.002, "time.tolerance": 1e-3}


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    """Working directory with a scene and the rod that it names."""
    monkeypatch.chdir(tmp_path)
    ehd.save_body(make_body(Joint()), tmp_path / "rod.h5")
    write_scene(tmp_path / "s.toml", "slider-crank-paper", SHORT)
    return tmp_path


@pytest.fixture(scope="module")
def completed(tmp_path_factory):
    """Folder of a completed run of that scene, made by the command; it is copied, not changed."""
    folder = tmp_path_factory.mktemp("completed")
    ehd.save_body(make_body(Joint()), folder / "rod.h5")
    scene = write_scene(folder / "s.toml", "slider-crank-paper", SHORT)
    assert call("run", scene, "--no-plots", "-o", folder / "done") == 0
    return folder / "done"


#: What each command lists in its folder, in version 0.3.
LISTS = {
    "run": ("summary.json", "vtk/", "history.h5", "history.csv", "scene.toml", "body-rod.h5"),
    "sweep": ("sweep.json", "sweep.csv", "runs/", "bodies/"),
    "study": ("study.json", "table.csv", "reference.json", "figures/", "runs/", "bodies/"),
    "paraview": ("run.pvd", "run_0000.vtm"),
    "plot": ("max_pressure.png", "orbit.svg"),
}

#: Calls that make a folder of their own, its name behind.
OWNERS = {
    "run": ("run", "s.toml", "--no-plots", "-o"),
    "sweep": ("sweep", "s.toml", "--set", "big_end.clearance=17e-6", "-o"),
    "study": ("study", "s.toml", "--quick", "-o"),
    "paraview": ("paraview", "done", "-o"),
    "plot": ("plot", "done", "-o"),
}


def fill(folder, maker, *, entry):
    """A folder as a command leaves it, with the entry of that or without, as in version 0.3."""
    names = LISTS[maker]
    claim(folder, names, maker if entry else "")
    for name in names:
        path = folder / (f"{name}0001/history.h5" if name[-1] == "/" else name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{maker}'s {name}")


@pytest.mark.parametrize("entry", [True, False])
@pytest.mark.parametrize("maker", LISTS)
def test_no_command_writes_into_the_folder_of_another(maker, entry, workplace, completed, capfd):
    shutil.copytree(completed, "done")
    fill(workplace / "there", maker, entry=entry)
    assert made_by(workplace / "there") == maker
    before = contents(workplace / "there")
    for command, arguments in OWNERS.items():
        for more in ((), ("--overwrite",)):
            if command == maker or (more and command in ("plot", "paraview")):
                continue
            status, _, errors = exit_of(capfd, *arguments, "there", *more)
            assert status == 2, (command, more)
            assert f"there was made by fenics-ehd {maker}, not by {command}" in errors
            assert contents(workplace / "there") == before


@pytest.mark.parametrize("maker", ["run", "sweep", "study"])
def test_parts_of_a_folder_are_no_folder_for_a_run(maker, workplace, capfd):
    fill(workplace / "there", maker, entry=True)
    before = contents(workplace / "there")
    for name in (name for name in LISTS[maker] if name[-1] == "/"):
        for more in ((), ("--overwrite",)):
            status, _, errors = exit_of(capfd, *OWNERS["run"], f"there/{name}", *more)
            assert status == 2
            assert "choose another" in errors
            assert contents(workplace / "there") == before


@pytest.mark.slow
def test_a_manifest_says_which_command_made_its_folder(workplace, capfd):
    assert exit_of(capfd, *OWNERS["run"], "out")[0] == 0
    lines = (workplace / "out" / "manifest.txt").read_text().splitlines()
    assert lines[:2] == [HEADER, "command: run"]
    assert not [name for name in listed(workplace / "out") if ":" in name]
    # As version 0.3 left it, which takes the entry for the name of a file that is not there.
    (workplace / "out" / "manifest.txt").write_text("\n".join([lines[0], *lines[2:], ""]))
    assert exit_of(capfd, *OWNERS["run"], "out", "--overwrite")[0] == 0
    assert "command: run" in (workplace / "out" / "manifest.txt").read_text().splitlines()
    assert exit_of(capfd, *OWNERS["sweep"], "many", "--workers", 1, "--keep")[0] == 0
    for folder in ("many", "many/runs", "many/runs/0001"):
        assert made_by(workplace / folder) == "sweep"
    # Its runs are read like any other, and only read.
    assert exit_of(capfd, "plot", "many/runs/0001", "--quantity", "orbit")[0] == 0
    assert exit_of(capfd, *OWNERS["run"], "many/runs/0001", "--overwrite")[0] == 2
    assert exit_of(capfd, "run", "--resume", "many/runs/0001")[0] == 2


@pytest.mark.slow
def test_pictures_of_one_run_do_not_replace_those_of_another(workplace, capfd):
    for name in ("one", "two"):
        assert exit_of(capfd, *OWNERS["run"], name)[0] == 0
    assert exit_of(capfd, "plot", "one", "--quantity", "orbit")[0] == 0
    status, _, errors = exit_of(capfd, "plot", "one", "--quantity", "orbit", "-o", "two")
    assert status == 2
    assert "two was made by fenics-ehd run, not by plot" in errors
    for _ in range(2):
        assert exit_of(capfd, "plot", "one", "--quantity", "orbit", "-o", "pictures")[0] == 0


@pytest.mark.parametrize("status", [None, "interrupted", "failed: history.h5: No space left"])
def test_a_stopped_run_is_not_begun_anew_unasked(status, workplace, completed, capfd):
    shutil.copytree(completed, "out")
    summary = workplace / "out" / "summary.json"
    if status is None:
        summary.unlink()
    else:
        summary.write_text(f'{{"status": "{status}"}}')
    before = contents(workplace / "out")
    code, _, errors = exit_of(capfd, *OWNERS["run"], "out")
    assert code == 2
    assert "out has a run that was stopped: continue it by --resume out" in errors
    assert contents(workplace / "out") == before
    with pytest.raises(ehd.errors.InputError, match="--resume out"):
        ehd.run(ehd.read_scene("s.toml"), "out")
    assert exit_of(capfd, "run", "--resume", "out", "--no-plots")[0] == 0
    summary.unlink()
    assert exit_of(capfd, *OWNERS["run"], "out", "--overwrite")[0] == 0


# Files


def write_png(path):
    path.write_bytes(b"\x89PNG\r\n\x1a\nand so on")


def write_other_hdf5(path):
    with h5py.File(path, "w") as file:
        file["x"] = np.arange(3)


#: Calls whose output is the last argument, and files that it may replace.
WRITERS = {
    "reduce": (("reduce", "rod", "--scene", "s.toml", "-o"), "body.h5"),
    "basis": (("reduce", "rod", "--scene", "s.toml", "-o", "new.h5", "--basis"), "basis.h5"),
    "bearing": (("bearing", "--eccentricity", "0.5", "--cells", "20x4", "--plot"), "a.png"),
    "animate": (("animate", "done", "--frames", "2", "-o"), "a.gif"),
    "part": (("part", "mesh.msh", "--bore", "1", "-o"), "model.msh"),
}

OTHERS = {
    "text": lambda path: path.write_text("mine"),
    "scene": lambda path: path.write_text("[bodies.rod]\n"),
    "HDF5": write_other_hdf5,
    "NumPy": lambda path: np.savez(path.open("wb"), x=np.arange(3)),
    "mesh": lambda path: path.write_text("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"),
    "PNG": write_png,
    "PDF": lambda path: path.write_bytes(b"%PDF-1.4"),
}


@pytest.mark.parametrize("other", OTHERS)
@pytest.mark.parametrize("writer", WRITERS)
def test_an_output_replaces_no_file_of_another_kind(writer, other, workplace, capfd):
    arguments, name = WRITERS[writer]
    OTHERS["mesh"](workplace / "mesh.msh")
    (workplace / "done").mkdir()
    if (name, other) == ("a.png", "PNG"):
        pytest.skip("a picture is replaced by a picture")
    OTHERS[other](workplace / name)
    before = contents(workplace)
    status, output, errors = exit_of(capfd, *arguments, name)
    assert status == 2
    assert f"{name} exists and is not " in errors or "cannot read it" in errors
    assert "Traceback" not in errors
    assert output == ""
    assert contents(workplace) == before


def damaged(content, position):
    """Content with one byte changed."""
    return content[:position] + bytes([content[position] ^ 0xFF]) + content[position + 1 :]


def test_files_that_are_damaged_are_of_no_kind(workplace):
    """Neither HDF5 nor zlib reads what changed: the former may crash, the latter raises its own."""
    body = (workplace / "rod.h5").read_bytes()
    (workplace / "rod.h5").write_bytes(damaged(body, len(body) // 2))
    with pytest.raises(ehd.errors.InputError, match=r"rod\.h5 exists and is not a reduced body"):
        require_output(workplace / "rod.h5", BODY_KIND)
    export = workplace / "rod.npz"
    np.savez_compressed(export, format=np.array("fenics_ehd reduced body, exported"))
    require_output(export, EXPORT_KIND)
    begin = export.read_bytes().index(b"format.npy") + len(b"format.npy")
    # Behind the extra field of zip64, the first block's kind: all ones are of none.
    export.write_bytes(damaged(export.read_bytes(), begin + 20))
    with pytest.raises(ehd.errors.InputError, match="not an exported reduced body"):
        require_output(export, EXPORT_KIND)


@pytest.mark.parametrize("link", [None, os.symlink, os.link])
def test_an_output_replaces_no_input(link, workplace, capfd):
    """Nor through links; a file that the scene names is one, too."""
    for name in ("s.toml", "rod.h5"):
        target = name if link is None else f"to-{name}"
        if link is not None:
            link(name, target)
        before = contents(workplace)
        for option in ("-o", "--basis"):
            more = () if option == "-o" else ("-o", "new.h5")
            status, _, errors = exit_of(
                capfd, "reduce", "rod", "--scene", "s.toml", *more, option, target
            )
            assert status == 2
            assert f"{option} {target}" in errors or "has 0 flexible bodies" in errors
            assert contents(workplace) == before


@pytest.mark.parametrize("more", [(), ("--overwrite",)])
def test_a_folder_of_results_replaces_no_input(more, workplace, completed, capfd):
    """A run of its own scene, of a body of its own, or of a former run's."""
    shutil.copytree(completed, "out")
    before = contents(workplace)
    calls = [
        ("run", "out/scene.toml", "--no-plots", "-o", "out"),
        ("run", "s.toml", "--body", "out/body-rod.h5", "--no-plots", "-o", "out"),
        ("sweep", "many/sweep.csv.toml", "--set", "big_end.clearance=17e-6", "-o", "many"),
    ]
    (workplace / "many").mkdir()
    (workplace / "many" / "sweep.csv.toml").write_text((workplace / "s.toml").read_text())
    for arguments in calls[:2]:
        status, _, errors = exit_of(capfd, *arguments, *more)
        assert status == 2
        assert "-o out: the command reads" in errors
        found = contents(workplace)
        assert {name: found[name] for name in before} == before


def test_a_failed_film_replaces_no_other_file(tmp_path):
    from fenics_ehd.base.files import keeping_failed_film

    path = tmp_path / "failed_film.h5"
    error = ehd.errors.CavitationError("no film", {"gap": np.ones(2), "pressure": np.ones(2)})
    for content in (b"mine", None):
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(ehd.errors.CavitationError) as caught, keeping_failed_film(tmp_path):
            raise error
        if content is not None:
            assert path.read_bytes() == content
            assert "is not from this program" in str(caught.value)
            path.unlink()
    with (
        pytest.raises(ehd.errors.CavitationError, match="is saved in"),
        keeping_failed_film(tmp_path),
    ):
        raise error
