"""The command line as a user meets it, in processes of its own."""

import json
import os
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from command_line import COMMAND
from command_line import program as call
from csv_history import read_history
from interrupt_case import interrupted_run
from scene_cases import write_scene

from fenics_ehd.reduction import BasisFile

#: The rod without elasticity over the first degrees of crank angle: everything but the many modes.
SHORT = {
    "bodies.rod.reduction": {"method": "rigid", "estimate_error": False},
    "time.revolutions": 0.02,
    "time.tolerance": 1e-3,
}


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "short.toml"
    return write_scene(path, "slider-crank-paper", SHORT)


@pytest.fixture(scope="module")
def body(tmp_path_factory):
    path = tmp_path_factory.mktemp("body") / "conrod.h5"
    result = call("reduce", "conrod", "--residual-modes", 4, "-o", path)
    assert result.returncode == 0, result.stderr
    assert "12 modes" in result.stdout
    assert "polar inertia" in result.stdout
    return path


def test_reduce_writes_basis_and_exports(tmp_path):
    path = tmp_path / "new" / "rod.h5"
    options = ["--method", "m1", "--modes", 4, "--no-estimate-error", "--json"]
    files = ["--basis", tmp_path / "part.h5", "--export", "npz"]
    result = call("reduce", "conrod", "-o", path, *options, *files)
    assert result.returncode == 0, result.stderr
    summary = json.loads(result.stdout)
    assert (summary["method"], summary["frame"], summary["modes"]) == ("m1", "bore-centre", 6)
    assert sum(summary["participation"]) == pytest.approx(1.0)
    with np.load(summary["exports"]["npz"]) as exported:
        np.testing.assert_array_equal(exported["frequencies"], summary["frequencies_Hz"])
    with BasisFile(tmp_path / "part.h5") as basis:
        assert basis.modes == 6
        assert np.isfinite(basis.stress(np.ones(6))).all()


@pytest.mark.slow
def test_inventory_says_what_was_dropped(tmp_path):
    result = call("reduce", "conrod", "--residual-modes", 2, "-o", tmp_path / "rod.h5")
    assert result.returncode == 0, result.stderr
    assert "dropped: 78," in result.stdout
    assert "not selected" in result.stdout
    assert "of the bore's flexibility" in result.stdout


def test_help_imports_no_finite_elements():
    code = (
        "import sys\nfrom fenics_ehd.cli.main import cli\n"
        "cli.main(['--help'], standalone_mode=False)\n"
        "heavy = {'dolfinx', 'petsc4py', 'gmsh', 'numpy', 'matplotlib'} & set(sys.modules)\n"
        "sys.exit(', '.join(heavy) or 0)"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert "Commands:" in result.stdout


def test_run_writes_everything_it_promises(scene, tmp_path):
    result = call("run", scene, "-o", tmp_path, "--json")
    assert result.returncode == 0, result.stderr
    summary = json.loads(result.stdout)
    assert summary == json.loads((tmp_path / "summary.json").read_text())
    promised = {
        "max_pressure_Pa", "min_film_thickness_m", "steps", "newton_iterations",
        "basis_error_estimate_m", "energy_balance_error", "modes", "method", "status",
        "reduction_time_s", "wall_time_s", "versions",
    }  # fmt: skip
    assert promised <= set(summary)
    assert summary["status"] == "complete"
    assert summary["basis_error_estimate_m"] is None
    history = read_history(tmp_path)
    first = ["time_s", "crank_angle_deg", "max_pressure_Pa", "min_film_thickness_m"]
    assert list(history)[:4] == first
    assert len(history["time_s"]) == summary["steps"]
    assert history["time_s"][-1] == pytest.approx(0.02 * 2 * np.pi / 500, rel=1e-9)
    with h5py.File(tmp_path / "history.h5") as file:
        pressure = file["joints/big_end/film/pressure"][()]
    assert pressure.shape == (summary["steps"], 440)
    assert pressure.max() == pytest.approx(summary["max_pressure_Pa"])
    for name in ("max_pressure", "min_film_thickness"):
        assert (tmp_path / f"{name}.png").stat().st_size > 1000
    assert not (tmp_path / "vtk").exists()


@pytest.mark.slow
def test_run_from_body_file_equals_run_from_mesh(body, tmp_path):
    few = SHORT | {"bodies.rod.reduction": {"method": "m3", "residual_modes": 4}}
    unsaid = SHORT | {"bodies.rod.reduction": None}
    whole = write_scene(tmp_path / "whole.toml", "slider-crank-paper", few)
    online = write_scene(tmp_path / "online.toml", "slider-crank-paper", unsaid)
    results = [
        call("run", whole, "-o", tmp_path / "a", "--no-plots", "--json", "--vtk", "--frames", "3"),
        call("run", online, "--body", body, "-o", tmp_path / "b", "--no-plots", "--json"),
    ]
    a, b = (json.loads(r.stdout) for r in results)
    assert a["max_pressure_Pa"] == b["max_pressure_Pa"]
    assert a["min_film_thickness_m"] == b["min_film_thickness_m"]
    assert not (tmp_path / "a" / "max_pressure.png").exists()
    meshio = pytest.importorskip("meshio")
    assert len(list((tmp_path / "a" / "vtk").glob("*.vtm"))) == 3
    mesh = meshio.read(tmp_path / "a" / "vtk" / "bodies-rod_0002.vtu")
    with h5py.File(tmp_path / "a" / "history.h5") as file:
        peak = file["joints/big_end/film/pressure"][-1].max()
    # The 20-node rod lacks the film's cell centres, so the peak may lie between its nodes.
    assert 0.7 * peak < mesh.point_data["pressure_Pa"].max() <= peak
    assert 0 < np.abs(mesh.point_data["displacement_m"]).max() < 1e-4


def test_body_that_contradicts_the_scene_is_refused(body, tmp_path):
    softer = {"bodies.rod.material.youngs_modulus": 200e9, "bodies.rod.reduction": None}
    path = write_scene(tmp_path / "other.toml", "slider-crank-paper", softer)
    result = call("run", path, "--body", body, "-o", tmp_path / "out")
    assert result.returncode == 2
    assert "youngs_modulus = 210000000000.0" in result.stderr


@pytest.mark.slow
def test_plot_draws_several_runs(scene, tmp_path):
    call("run", scene, "-o", tmp_path / "one", "--no-plots")
    call("run", scene, "-o", tmp_path / "two", "--no-plots")
    result = call("plot", tmp_path / "one", tmp_path / "two", "-o", tmp_path)
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "max_pressure-comparison.svg").exists()


def test_options_reach_the_film_solver(scene, tmp_path):
    environment = os.environ | {"PETSC_OPTIONS": "-motion_snes_monitor"}
    options = ("--no-plots", "--no-error-budget")
    result = call("run", scene, "-o", tmp_path, *options, env=environment)
    assert result.returncode == 0, result.stderr
    summary = json.loads((tmp_path / "summary.json").read_text())
    starts = result.stdout.count("  0 SNES Function norm")
    attempts = summary["steps"] + summary["rejected_steps"]
    assert starts == attempts < summary["newton_iterations"]


MESH_WITHOUT_BORE = """
SetFactory("Built-in");
Point(1) = {0, 0, 0};
l[] = Extrude {1, 0, 0} { Point{1}; Layers{2}; Recombine; };
s[] = Extrude {0, 1, 0} { Line{l[1]}; Layers{2}; Recombine; };
v[] = Extrude {0, 0, 1} { Surface{s[1]}; Layers{2}; Recombine; };
Physical Volume("rod", 1) = {v[1]};
Physical Surface("pin", 3) = {s[1]};
"""


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"bodies.rod.lenght": 1.0}, "bodies.rod.lenght"),
        ({"joints.big_end.clearance": -1e-6}, "clearance"),
        ({"bodies.rod.model": "absent.geo"}, "absent.geo"),
        ({"bodies.rod.model": "no_bore.geo", "bodies.rod.geometry": None}, "'bore'"),
        ({"bodies.rod.model": "nonsense.geo"}, "nonsense.geo"),
        ({"bodies.rod.geometry.big_end_wal": 0.01}, "did you mean big_end_wall"),
        ({"bodies.rod.geometry.bore_cells_around": 15}, "multiple of 10"),
        ({"bodies.rod.geometry.bore_cells_along": 2.5}, "2.5"),
        ({"bodies.rod.reduction.residual_modes": 81}, "residual_modes 81"),
        ({"joints.big_end.clearance": 2e-3}, "joints.big_end.clearance = 0.002"),
        ({"time.smallest_step": 1e-5}, "time.smallest_step = 1e-05"),
        ({"bodies.crank.points.pin": [0.2, 0.0]}, "cannot be assembled"),
        (None, "scene.toml"),
    ],
)
def test_bad_scene_exits_2_with_one_line(changes, named, tmp_path):
    path = tmp_path / "scene.toml"
    if changes is None:
        path.write_text("[[")
    else:
        write_scene(path, "slider-crank-paper", changes)
    (tmp_path / "no_bore.geo").write_text(MESH_WITHOUT_BORE)
    (tmp_path / "nonsense.geo").write_text("this is no Gmsh model")
    result = call("run", path, "-o", tmp_path / "out")
    assert result.returncode == 2, result.stderr
    assert "Traceback" not in result.stderr
    last = result.stderr.strip().splitlines()[-1]
    assert last.startswith("fenics-ehd: ")
    assert named in last


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["run", "crank-slider"], "crank-slider"),
        (["run", "absent.toml"], "absent.toml"),
        (["run", "slider-crank", "--body", "absent.h5"], "absent.h5"),
        (["run", "slider-crank", "--body", __file__], "test_cli.py"),
        (["run", "slider-crank", "--body", "a.h5", "--method", "m3"], "--body"),
        (["reduce", "conrod", "-o", "conrod.h5", "--residual-modes", "-1"], "-1"),
        (["plot", "/nonexistent"], "/nonexistent"),
        (["frobnicate"], "frobnicate"),
    ],
)
def test_bad_command_exits_2_with_its_name(arguments, named, tmp_path):
    result = call(*arguments, cwd=tmp_path)
    assert result.returncode == 2, result.stderr
    assert "Traceback" not in result.stderr
    assert named in result.stderr.splitlines()[-1]


def test_body_of_another_format_is_refused(tmp_path):
    path = tmp_path / "other.h5"
    with h5py.File(path, "w") as file:
        file["data"] = 1
    result = call("run", "slider-crank", "--body", path, "-o", tmp_path / "out")
    assert result.returncode == 2
    assert "not a fenics_ehd reduced body" in result.stderr


def test_interrupt_keeps_what_was_computed(tmp_path):
    path = tmp_path / "long.toml"
    write_scene(path, "slider-crank-paper", SHORT, {"time.revolutions": 50})
    columns = interrupted_run([*COMMAND, "run", str(path)], tmp_path / "out")
    with h5py.File(tmp_path / "out" / "history.h5") as file:
        assert len(file["joints/big_end/film/pressure"]) == len(columns["time_s"])


@pytest.mark.parametrize("command", [["check"], ["run", "four-bar"], ["bearing", "--load", "5"]])
def test_a_python_without_debians_packages_is_told_what_to_install(command, tmp_path):
    code = """if True:
        import sys
        for name in ("dolfinx", "petsc4py", "slepc4py", "mpi4py", "h5py"):
            sys.modules[name] = None
        from fenics_ehd.cli.main import main
        main(sys.argv[1:])"""
    found = subprocess.run(
        [sys.executable, "-c", code, *command], capture_output=True, text=True, cwd=tmp_path
    )
    assert found.returncode == 1
    (line,) = found.stderr.splitlines()
    packages = "python3-dolfinx python3-petsc4py python3-slepc4py python3-mpi4py python3-h5py"
    assert f"lacks Debian's packages {packages}: install them" in line


@pytest.mark.parametrize("closed", ["<&-", ">&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_streams_that_are_closed_take_no_file(closed, scene, tmp_path):
    command = " ".join([*COMMAND, "run", str(scene), "--no-plots", "-o", "out", closed])
    found = subprocess.run(["sh", "-c", command], capture_output=True, text=True, cwd=tmp_path)
    assert found.returncode == 0
    assert "Traceback" not in found.stderr
    assert len(read_history(tmp_path / "out")["time_s"]) > 1


@pytest.mark.parametrize("most", [100_000, 500_000, 700_000])
def test_too_little_memory_is_one_line(most, tmp_path):
    """OpenBLAS asks for ever for what it cannot have."""
    command = f"ulimit -v {most}; exec {' '.join(COMMAND)} bearing --eccentricity 0.5"
    found = subprocess.run(["sh", "-c", command], capture_output=True, text=True, timeout=30)
    assert found.returncode == 1
    assert found.stderr.startswith("fenics-ehd: EhdError: less than 768 MB of address space left")
    assert found.stderr.count("\n") == 1


def test_info_names_the_package_and_its_models():
    found = json.loads(call("info", "--json").stdout)
    assert Path(found["package"], "cli", "main.py").is_file()
    assert Path(found["conrod_model"]).is_file()
    assert found["dolfinx"] != "missing"
