"""The command line as a user meets it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from command_line import COMMAND, exit_of, program
from csv_history import only_joint, read_history
from scene_cases import LOADED_JOURNAL, RIGID_ROD, write_scene
from study_cases import COARSE

import fenics_ehd as ehd
from fenics_ehd.base.columns import split_unit
from fenics_ehd.base.extremes import FilmRows, over_time
from fenics_ehd.cli import check
from fenics_ehd.cli.options import answer
from fenics_ehd.multibody.recorder import COUNTS, STEP_COUNTS
from fenics_ehd.multibody.trust import SIGNS
from fenics_ehd.plotting.shown import TIME, ShownRun
from fenics_ehd.reduction.part_files import BasisFile

#: The rod without elasticity over the first degrees of crank angle: everything but the many modes.
TIMES = {"time.revolutions": 0.02, "time.tolerance": 1e-3}
SHORT = TIMES | {"bodies.rod.reduction": {"method": "rigid", "estimate_error": False}}
#: A start with a rigid rod.
START = RIGID_ROD | TIMES | {"time.revolutions": 0.002}


def test_a_body_is_reduced_with_basis_and_exports_and_fits_no_other_material(tmp_path, capfd):
    path = tmp_path / "new" / "rod.h5"
    scene = write_scene(tmp_path / "scene.toml", "slider-crank-paper", COARSE)
    options = ["--method", "m1", "--modes", 4, "--no-estimate-error", "--json"]
    files = ["--basis", tmp_path / "part.h5", "--export", "npz", "--scene", scene]
    status, out, _ = exit_of(capfd, "reduce", "conrod", "-o", path, *options, *files)
    assert status == 0
    summary = json.loads(out)
    assert (summary["method"], summary["frame"], summary["modes"]) == ("m1", "bore-centre", 6)
    assert sum(summary["participation"]) == pytest.approx(1.0)
    counts = summary["counts"]
    assert counts["part_factorisations"] == counts["mesh_error_part_factorisations"] == 1
    assert counts["eigensolver_applications"] > 4
    # Boundary forces, start vectors and checks; no pressures without an estimate.
    assert 0 < counts["static_solves"] < counts["mesh_error_static_solves"]
    assert not counts.keys() & summary.keys()
    with np.load(summary["exports"]["npz"]) as exported:
        np.testing.assert_array_equal(exported["frequencies"], summary["frequencies_Hz"])
    with BasisFile(tmp_path / "part.h5") as basis:
        assert basis.modes == 6
        assert np.isfinite(basis.stress(np.ones(6))).all()
    softer = {"bodies.rod.material.youngs_modulus": 200e9, "bodies.rod.reduction": None}
    other = write_scene(tmp_path / "other.toml", "slider-crank-paper", COARSE, softer)
    status, _, errors = exit_of(capfd, "run", other, "--body", path, "-o", tmp_path / "out")
    assert status == 2
    assert "youngs_modulus = 210000000000.0" in errors


@pytest.mark.slow
def test_inventory_says_what_was_dropped(tmp_path, capfd):
    arguments = ("reduce", "conrod", "--residual-modes", 2, "-o", tmp_path / "rod.h5")
    status, out, _ = exit_of(capfd, *arguments)
    assert status == 0
    for reported in (
        "10 modes",
        "polar inertia",
        "dropped: 78,",
        "not selected",
        "of the bore's flex",
        "factorisations: 1, static solves: ",
    ):
        assert reported in out


def test_run_writes_everything_it_promises(tmp_path, capfd):
    scene = write_scene(tmp_path / "short.toml", "slider-crank-paper", SHORT, COARSE)
    options = ("-o", tmp_path, "--json", "--no-error-budget")
    status, out, errors = exit_of(capfd, "run", scene, *options)
    assert status == 0, errors
    summary = json.loads(out)
    assert summary == json.loads((tmp_path / "summary.json").read_text())
    promised = {
        "joints", "counts", "steps", "newton_iterations", "energy_balance_error", "modes",
        "method", "status", "reduction_time_s", "wall_time_s", "versions",
    }  # fmt: skip
    assert promised <= set(summary)
    assert summary["status"] == "complete"
    counts = summary["counts"]
    assert set(counts) == set(COUNTS)
    assert all(counts[name] == summary[name] for name in STEP_COUNTS)
    # An iteration evaluates the equations once, and every solve once more at its start.
    assert counts["evaluations"] > counts["newton_iterations"] >= counts["film_factorisations"] > 0
    assert counts["triangular_solves"] > counts["newton_iterations"]
    entries = summary["joints"]["big_end"]
    assert entries["basis_error_estimate_m"] is None
    history = read_history(tmp_path)
    first = ["time_s", "crank_angle_deg", "big_end.max_pressure_Pa", "big_end.min_film_thickness_m"]
    assert list(history)[:4] == first
    assert len(history["time_s"]) == summary["steps"]
    assert history["time_s"][-1] == pytest.approx(0.02 * 2 * np.pi / 500, rel=1e-9)
    with h5py.File(tmp_path / "history.h5") as file:
        film = {name: values[()] for name, values in file["joints/big_end/film"].items()}
    pressure = film["pressure"]
    assert pressure.shape == (summary["steps"], 100)
    peaks = FilmRows.of(film["angle"], film["height"]).largest(pressure)[0]
    assert peaks.max() == pytest.approx(history["big_end.max_pressure_Pa"].max())
    assert 1.0 <= entries["max_pressure_Pa"] / peaks.max() < 1.01
    for name in ("max_pressure", "min_film_thickness"):
        assert (tmp_path / f"{name}.png").stat().st_size > 1000
    assert not (tmp_path / "vtk").exists()


def test_a_periodic_run_writes_its_last_cycle(tmp_path, capfd):
    scene = write_scene(tmp_path / "short.toml", "loaded-journal", LOADED_JOURNAL)
    options = ("-o", tmp_path / "out", "--no-plots", "--json")
    status, out, _ = exit_of(capfd, "run", scene, *options)
    assert status == 0
    summary = json.loads(out)
    assert summary == json.loads((tmp_path / "out" / "summary.json").read_text())
    assert {"joints", "cycles", "processor_time_s"} <= set(summary)
    entries = summary["joints"]["bearing"]
    assert {"max_pressure_time_s", "min_film_thickness_time_s"} <= set(entries)
    assert summary["status"] == "complete"
    assert (summary["method"], summary["modes"]) == ("rigid", 0)
    assert summary["periodicity_defect"] <= 1e-3
    # What is kept is the last cycle, and the figures are its alone.
    history = read_history(tmp_path / "out", "bearing")
    assert set(history["cycle"]) == {summary["cycles"]}
    assert len(history["time_s"]) < summary["steps"]
    assert history["time_s"][-1] == pytest.approx(0.02 * summary["cycles"])
    # Both its ends: what it does over the cycle is a difference of its last row and its first.
    assert history["cycle_time_s"][0] == 0.0
    assert history["cycle_time_s"][-1] == pytest.approx(0.02)
    gained = {n: history[f"{n}_work_J"][-1] - history[f"{n}_work_J"][0] for n in SIGNS}
    balance = sum(sign * gained[name] for name, sign in SIGNS.items())
    assert abs(balance) < 1e-3 * gained["film"]
    for name in ("force_x_N", "eccentricity_x_m", "kinetic_energy_J"):
        assert history[name][0] == history[name][-1]
    shown = ShownRun("", tmp_path / "out")
    for column, sign in (("max_pressure_Pa", 1), ("min_film_thickness_m", -1)):
        times = history["cycle_time_s"][1:]
        value, time = over_time(times, history[column][1:], times[-1], sign)
        assert entries[column] == pytest.approx(value)
        # Times of extremes are from the start of the cycle in history, summary and pictures.
        name = split_unit(column)[0]
        assert entries[f"{name}_time_s"] == pytest.approx(time)
        position, drawn = shown.joints["bearing"].extreme(column, TIME)
        assert position == pytest.approx(1e3 * time)
        assert drawn == entries[column]
    assert shown.time_name == "time in the cycle"
    assert shown.time.tolist() == pytest.approx(history["cycle_time_s"].tolist())
    # The film carries the load: at 10 ms it is (-500, 900) N.
    at = int(np.argmin(np.abs(history["cycle_time_s"] - 10e-3)))
    force = history["force_x_N"][at], history["force_y_N"][at]
    assert np.hypot(*force) == pytest.approx(np.hypot(500, 900), rel=0.05)


def test_films_that_do_not_repeat_exit_1(tmp_path, capfd):
    once = LOADED_JOURNAL | {"time.cycles": 1}
    path = write_scene(tmp_path / "short.toml", "loaded-journal", once)
    status, _, errors = exit_of(capfd, "run", path, "-o", tmp_path / "out", "--no-plots")
    assert status == 1
    assert "PeriodicityError: after cycles = 1 of 0.02 s" in errors.splitlines()[-1]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["status"].startswith("failed: after cycles = 1")


@pytest.mark.slow
def test_run_from_body_file_equals_run_from_mesh(tmp_path, capfd):
    body = tmp_path / "conrod.h5"
    assert exit_of(capfd, "reduce", "conrod", "--residual-modes", 4, "-o", body)[0] == 0
    few = SHORT | {"bodies.rod.reduction": {"method": "m3", "residual_modes": 4}}
    unsaid = SHORT | {"bodies.rod.reduction": None}
    whole = write_scene(tmp_path / "whole.toml", "slider-crank-paper", few)
    online = write_scene(tmp_path / "online.toml", "slider-crank-paper", unsaid)
    results = [
        exit_of(capfd, "run", *asked, "--no-plots", "--no-error-budget", "--json")
        for asked in ((whole, "-o", tmp_path / "a"), (online, "--body", body, "-o", tmp_path / "b"))
    ]
    a, b = (only_joint(json.loads(out)) for _, out, _ in results)
    assert a["max_pressure_Pa"] == b["max_pressure_Pa"]
    assert a["min_film_thickness_m"] == b["min_film_thickness_m"]
    assert not (tmp_path / "a" / "max_pressure.png").exists()


#: Options whose numbers Python would read, and the message.
WRITTEN = [
    ("bearing --load 1_0", "'1_0' must be a number in N"),
    ("bearing --load \u0663", "must be a finite number in N"),
    ("bearing --load 1 --cells \u0661\u0666x4", "must be two whole numbers, the cells around"),
    ("bearing --load 1 --lobes 1_0", "'1_0' is not a whole number"),
    ("bearing --load 1 --groove nan 10 1e5", "the angle of a groove = nan must be a finite"),
    ("animate out --scale nan", "'nan' is no number"),
    ("animate out --frames 1_0", "'1_0' is not a whole number"),
    ("run four-bar --checkpoint-every inf", "'inf' is no number"),
    ("sweep four-bar --set tolerance=1_0e-5", "tolerance = '1_0e-5' must be a number"),
    ("sweep four-bar --set tolerance=1e-5:1e-4:\u0663", "count = \u0663 must be a whole number"),
]


@pytest.mark.parametrize(("command", "message"), WRITTEN)
def test_options_have_plain_digits(command, message, capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, output, errors = exit_of(capfd, *command.split())
    assert (status, output) == (2, "")
    assert message in errors.splitlines()[-1]


def test_what_could_control_a_terminal_is_escaped(tmp_path, capfd):
    name = "a\x1b[31m\u202eb\x7f.toml"
    for command in (["run", name], ["plot", name], ["run", "four-bar", "--body", name], [name]):
        _, _, errors = exit_of(capfd, *command)
        assert "a\\x1b[31m\\u202eb\\x7f.toml" in errors
        assert "\x1b" not in errors
    status, output, errors = exit_of(
        capfd, "reduce", "conrod", "--method", "rigid", "-o", tmp_path / f"{name}.h5"
    )
    assert status == 0, errors
    assert "\\x1b[31m" in output
    assert "\x1b" not in output


def test_a_path_that_is_not_utf_8_is_answered(tmp_path):
    bad = os.fsdecode(b"\xff.toml")
    commands = (["run", bad], ["stress", bad], ["plot", bad], ["sweep", bad, "--set", "a=1"])
    # All in one process, which takes most of its time to start.
    calls = """
import os, sys
from fenics_ehd.cli.main import main
for line in os.fsencode(sys.argv[1]).split(b";"):
    try:
        main([os.fsdecode(word) for word in line.split()])
    except SystemExit as end:
        print(end.code)
"""
    lines = ";".join(" ".join(command) for command in commands)
    done = subprocess.run(
        [sys.executable, "-c", calls, lines], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.stdout.split() == ["2"] * len(commands), done.stderr
    errors = done.stderr.splitlines()
    assert len(errors) == len(commands), errors
    assert all("\\udcff.toml" in error for error in errors)


#: A NumPy that is found before Debian's, and the message about it.
OTHER_NUMPY = {
    "raise ImportError('numpy.core.multiarray failed to import')": "multiarray failed to import",
    "__version__ = '9.9'": "numpy 9.9 of {place} does not work",
    "x = 1 +": "SyntaxError",
}


@pytest.mark.parametrize(
    "text",
    [
        text if "import" in text else pytest.param(text, marks=pytest.mark.slow)
        for text in OTHER_NUMPY
    ],
)
def test_a_numpy_that_does_not_work_is_explained(text, tmp_path):
    place = tmp_path / "numpy" / "__init__.py"
    place.parent.mkdir()
    place.write_text(text)
    paths = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = os.environ | {"PYTHONPATH": paths}
    for command in ("info", "check", "bearing --load 1000", "run four-bar -o out"):
        done = program(*command.split(), cwd=tmp_path, env=environment)
        assert done.returncode == 1
        (line,) = done.stderr.splitlines()
        assert OTHER_NUMPY[text].format(place=place) in line
        assert f"of {place}" in line
        assert f"PYTHONPATH = {tmp_path}" in line
        assert ("scipy" in done.stdout) == (command in ("info", "check"))
    assert program("init", "four-bar", env=environment).returncode == 0


def test_options_reach_the_film_solver(tmp_path):
    scene = write_scene(tmp_path / "s.toml", "slider-crank-paper", START)
    environment = os.environ | {"PETSC_OPTIONS": "-motion_snes_monitor"}
    options = ("--no-plots", "--no-error-budget")
    result = program("run", scene, "-o", tmp_path / "out", *options, env=environment)
    assert result.returncode == 0, result.stderr
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    starts = result.stdout.count("  0 SNES Function norm")
    attempts = summary["steps"] + summary["rejected_steps"]
    assert starts == attempts < summary["newton_iterations"]


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
    names = ("dolfinx", "petsc4py", "slepc4py", "mpi4py", "h5py")
    packages = " ".join(f"python3-{name}" for name in names)
    assert f"lacks {', '.join(names)}: install them with pip install 'fenics-ehd[wheels]'" in line
    assert f"Debian's packages {packages}, and" in line


@pytest.mark.parametrize("closed", [pytest.param(">&-", marks=pytest.mark.slow), "<&- >&- 2>&-"])
def test_streams_that_are_closed_take_no_file(closed, tmp_path):
    scene = write_scene(tmp_path / "s.toml", "slider-crank-paper", START)
    options = ["--no-plots", "--no-error-budget", "-o", "out"]
    command = " ".join([*COMMAND, "run", str(scene), *options, closed])
    found = subprocess.run(["sh", "-c", command], capture_output=True, text=True, cwd=tmp_path)
    assert found.returncode == 0
    assert "Traceback" not in found.stderr
    assert len(read_history(tmp_path / "out")["time_s"]) > 1


@pytest.mark.parametrize("most", [100_000, 700_000])
def test_too_little_memory_is_one_line(most):
    """OpenBLAS asks for ever for what it cannot have."""
    command = f"ulimit -v {most}; exec {' '.join(COMMAND)} bearing --eccentricity 0.5"
    found = subprocess.run(["sh", "-c", command], capture_output=True, text=True, timeout=30)
    assert found.returncode == 1
    assert found.stderr.startswith("fenics-ehd: EhdError: less than 768 MB of address space")
    assert found.stderr.count("\n") == 1


def test_no_figure_that_is_not_finite_is_printed(capsys):
    found = {"joint": {"peak_Pa": float("nan"), "film_m": 1e-6, "flows": [float("inf")]}}
    with pytest.raises(ehd.errors.VerificationError, match="flows, peak_Pa: not a finite number"):
        answer(found, "  peak        nan MPa\n  film 1 um", as_json=False)
    with pytest.raises(ehd.errors.VerificationError, match="in the line 'at 3 ms, -inf % of it'"):
        answer(found, "film 1 um\n  at 3 ms, -inf % of it", as_json=False)
    # Names of joints, bodies and folders.
    answer(found, "  nan\n  inf: m4 with 3 modes\n  results in nan", as_json=False)
    answer({"film_m": 1e-6}, "  of inf", as_json=False)
    answer(found, "", as_json=True)
    out = capsys.readouterr().out
    assert "peak " not in out
    assert '"peak_Pa": null' in out


def test_info_names_the_package_and_its_models(capfd):
    found = json.loads(exit_of(capfd, "info", "--json")[1])
    assert Path(found["package"], "cli", "main.py").is_file()
    assert Path(found["conrod_model"]).is_file()
    assert found["dolfinx"] != "missing"


@pytest.mark.slow
def test_an_installation_tests_itself(monkeypatch, capsys):
    status, printed, _ = exit_of(capsys, "check")
    assert status == 0
    assert printed.endswith("all checks passed\n")
    assert "attitude angle 51.9" in printed
    # And reports it if it does not work.
    monkeypatch.setitem(check.CHECKS, "film", lambda _: check._within(50.0, 51.98, 0.1, "{:.2f}"))
    for name in ("reduction", "steps", "two ranks"):
        monkeypatch.delitem(check.CHECKS, name)
    status, _, errors = exit_of(capsys, "check")
    assert status == 1
    assert "film" in errors
