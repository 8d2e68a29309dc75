"""``fenics-ehd bearing`` as a user meets it."""

import json
import subprocess
import sys

import h5py
import numpy as np
import pytest

import fenics_ehd.bearing.operating_point
from fenics_ehd.cli import main
from fenics_ehd.errors import CavitationError

PROMISED = {
    "load_N", "attitude_angle_deg", "max_pressure_Pa", "max_pressure_angle_deg",
    "min_film_thickness_m", "eccentricity_ratio", "sommerfeld_number", "side_flow_m3_per_s",
    "friction_torque_Nm", "power_loss_W",
}  # fmt: skip
LINEAR = {"stiffness_N_per_m", "damping_Ns_per_m", "stability_threshold"}


@pytest.fixture
def call(capsys):
    def run(*arguments):
        with pytest.raises(SystemExit) as exit_:
            main(["bearing", *map(str, arguments)])
        captured = capsys.readouterr()
        return exit_.value.code, captured.out, captured.err

    return run


def refuse(name):
    raise AssertionError(f"{name} is not JSON")


def test_a_process_of_its_own_prints_json_and_nothing_else():
    command = [sys.executable, "-m", "fenics_ehd.cli", "bearing", "--eccentricity", "0.6", "--json"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stderr
    values = json.loads(result.stdout, parse_constant=refuse)
    assert set(values) >= PROMISED
    assert not LINEAR & set(values)
    # B = 22 mm, R = 22.5 mm, c = 17 um, 0.01 Pa s, 500 rad/s: the paper's bearing.
    assert values["load_N"] == pytest.approx(4156.8, rel=2e-4)
    assert values["attitude_angle_deg"] == pytest.approx(48.18, abs=0.02)
    assert values["power_loss_W"] == pytest.approx(500 * values["friction_torque_Nm"])
    mean = values["load_N"] / (0.045 * 0.022)
    sommerfeld = 0.01 * 500 / (2 * np.pi) / mean * (0.0225 / 17e-6) ** 2
    assert values["sommerfeld_number"] == pytest.approx(sommerfeld)


def test_help_imports_no_numerics():
    code = (
        "import sys\nfrom fenics_ehd.cli import cli\n"
        "cli.main(['bearing', '--help'], standalone_mode=False)\n"
        "heavy = {'dolfinx', 'petsc4py', 'numpy', 'matplotlib'} & set(sys.modules)\n"
        "sys.exit(', '.join(heavy) or 0)"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert "attitude angle, from x to the" in result.stdout


def test_coefficients(call):
    status, out, _ = call("--load", 3000, "--coefficients", "--json", "--cells", "40x6")
    values = json.loads(out, parse_constant=refuse)
    assert status == 0
    assert set(values) >= PROMISED | LINEAR
    assert np.shape(values["stiffness_N_per_m"]) == np.shape(values["damping_Ns_per_m"]) == (2, 2)
    threshold = 500 * np.sqrt(17e-6 * values["critical_mass_kg"] / 3000)
    assert values["stability_threshold"] == pytest.approx(threshold)
    status, out, _ = call("--eccentricity", 0.9, "--coefficients", "--json", "--cells", "40x6")
    assert json.loads(out)["stability_threshold"] is None


def test_undefined_figures_are_null(call):
    status, out, _ = call("--eccentricity", 0, "--json", "--cells", "20x4")
    values = json.loads(out, parse_constant=refuse)
    assert status == 0
    assert values["load_N"] == 0
    assert values["attitude_angle_deg"] is None
    assert values["sommerfeld_number"] is None
    assert values["max_pressure_angle_deg"] is None


def test_table_and_picture(call, tmp_path):
    path = tmp_path / "new" / "bearing.png"
    status, out, _ = call(
        "--load", 2000, "--tilt", 1e-4, -1e-4, "--groove", -90, 20, 2e5, "--groove", 90, 20, 2e5,
        "--squeeze", 1e-4, -1e-4, "--coefficients", "--plot", path, "--cells", "40x6",
    )  # fmt: skip
    assert status == 0
    for words in ("load                              2000 N", "degrees", "supply flow",
                  "tilting moment on shaft", "stiffness xx, xy", "40 x 6 lagrange"):  # fmt: skip
        assert words in out
    assert path.stat().st_size > 10_000


def test_pictures_without_a_film(call, tmp_path):
    for number, arguments in enumerate((["--speed", 0], ["--line-at-max-film"])):
        path = tmp_path / f"{number}.svg"
        status, _, _ = call("--eccentricity", 0.5, *arguments, "--cells", "20x4", "--plot", path)
        assert status == 0
        assert path.exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "either --eccentricity or --load"),
        (["--load", 5, "--eccentricity", 0.5], "either --eccentricity or --load"),
        (["--eccentricity", 1], "eccentricity = 1 must be at least 0 and below 1"),
        (["--eccentricity", -0.1], "eccentricity = -0.1 must be at least 0"),
        (["--eccentricity", "nan"], "eccentricity = nan must be"),
        (["--load", -5], "load = -5 N must be a finite number above 0"),
        (["--load", "inf"], "load = inf N must be"),
        (["--load", 5, "--radius", "nan"], "radius = nan must be a finite number"),
        (["--load", 5, "--width", -1], "width = -1.0 must be above 0"),
        (["--load", 5, "--clearance", 0], "clearance = 0.0 must be above 0"),
        (["--load", 5, "--clearance", 0.004], "0.1 of radius = 0.0225 m"),
        (["--load", 5, "--clearance", 30], "clearance = 30.0 must be below 0.005: in m, 30e-6 for"),
        (
            ["--load", 5, "--clearance", 1e-7],
            "1e-05 and 0.1 of radius = 0.0225 m: lengths are in m",
        ),
        (["--load", 5, "--radius", 22.5], "radius = 22.5 must be below 5: in m, 0.025 for 25 mm"),
        (["--load", 5, "--radius", 4], "between 1e-05 and 0.1 of radius = 4 m: lengths are in m"),
        (["--load", 5, "--width", 22], "width = 22.0 must be below 5: in m"),
        (["--load", 5, "--viscosity", 0], "viscosity = 0.0 must be above 0"),
        (["--load", 5, "--speed", "nan"], "speed = nan must be a finite number"),
        (["--load", 5, "--tilt", "nan", 0], "tilt = (nan, 0.0) must be two finite numbers"),
        (["--load", 5, "--tilt", 2e-3, 0], "tilt = 0.002 rad closes the gap"),
        (["--load", 5, "--ambient", -1], "ambient = -1.0 must be at least 0"),
        (["--load", 5, "--cells", "64"], "--cells '64' must be two whole numbers"),
        (["--load", 5, "--cells", "64x-1"], "--cells '64x-1' must be two whole numbers"),
        (["--load", 5, "--cells", "2x2"], "cells_around = 2 must be a whole number, at least 3"),
        (["--load", 5, "--cells", "9999x999"], "at most 100000"),
        (["--load", 5, "--groove", 0, 400, 0], "a width of 400 degrees must lie in 0..360"),
        (["--load", 5, "--groove", 0, 10, -1], "--groove: pressure = -1.0 must be at least 0"),
        (["--load", 5, "--groove", 0, 10, 0, "--line-at-max-film"], "exclude each other"),
        (["--load", 5, "--groove", 0, 10, 0, "--bore-speed", 1], "shaft or bore must"),
        (
            ["--load", 5, "--cavitation", "mass-conserving"],
            "needs a supply, a groove or an ambient",
        ),
        (
            ["--load", 5, "--cavitation", "mass-conserving", "--element", "lagrange"],
            "element = 'lagrange': cavitation = 'mass-conserving' needs 'bilinear'",
        ),
        (
            ["--load", 5, "--cavitation", "mass-conserving", "--coefficients"],
            "depend on the frequency",
        ),
        (["--load", 5, "--barus", 1e-8, "--roelands", 0.6], "exclude each other"),
        (["--load", 5, "--plot", "picture.xyz"], "its ending must be one of"),
        (["--load", 5, "--plot", "/dev/null/picture.png"], "/dev/null is not a folder"),
    ],
)
def test_bad_input_is_one_line_and_status_2(call, arguments, message):
    status, out, err = call(*arguments)
    assert status == 2
    assert out == ""
    assert message in err
    assert err.count("\n") == 1


def test_supplied_oil_all_leaves_at_the_sides_when_mass_is_conserved(call):
    supply = ["--eccentricity", 0.6, "--groove", 120, 10, 2e5, "--cells", "48x8", "--json"]
    conserving, reynolds = (
        json.loads(call(*supply, "--element", "bilinear", "--cavitation", condition)[1])
        for condition in ("mass-conserving", "reynolds")
    )
    flow = conserving["side_flow_m3_per_s"]
    assert conserving["supply_flow_m3_per_s"] == pytest.approx(flow, rel=1e-8)
    # Reynolds' condition makes oil anew where the film forms: it asks less of the groove.
    assert reynolds["supply_flow_m3_per_s"] < 0.5 * reynolds["side_flow_m3_per_s"]
    assert 0.9 * reynolds["load_N"] < conserving["load_N"] < reynolds["load_N"]


def test_failed_film_is_kept(call, tmp_path, monkeypatch):
    def fail(*_arguments, **_options):
        raise CavitationError("no luck", {"pressure": np.arange(3.0), "thickness": np.ones((2, 2))})

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(fenics_ehd.bearing.operating_point, "solve_bearing", fail)
    status, _, err = call("--eccentricity", 0.5)
    assert status == 1
    assert "no luck; the film is kept in failed_film.h5" in err
    with h5py.File(tmp_path / "failed_film.h5") as file:
        np.testing.assert_array_equal(file["pressure"], [0.0, 1.0, 2.0])
        assert file["thickness"].shape == (2, 2)
