"""``fenics-ehd bearing`` as a user meets it."""

import json
import subprocess
import sys
from functools import partial

import h5py
import numpy as np
import pytest
from command_line import exit_of

import fenics_ehd as ehd
import fenics_ehd.scenes.bearing
from fenics_ehd.base.files import keeping_failed_film

PROMISED = {
    "load_N", "attitude_angle_deg", "max_pressure_Pa", "max_pressure_angle_deg",
    "min_film_thickness_m", "eccentricity_ratio", "sommerfeld_number", "side_flow_m3_per_s",
    "friction_torque_Nm", "power_loss_W",
}  # fmt: skip
LINEAR = {"stiffness_N_per_m", "damping_Ns_per_m", "stability_threshold"}


@pytest.fixture
def call(capsys):
    return partial(exit_of, capsys, "bearing")


def refuse(name):
    raise AssertionError(f"{name} is not JSON")


def test_a_process_of_its_own_prints_json_and_nothing_else():
    command = f"{sys.executable} -m fenics_ehd.cli bearing --eccentricity 0.6 --json".split()
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


def test_numbers_may_have_units_as_in_scenes(call):
    plain = call("--load", 5e3, "--speed", 300.0, "--groove", 90, 10, 1e5, "--cells", "20x4")
    units = ("--load", "5 kN", "--speed", "300 rad/s", "--groove", "90 deg", "10", "1 bar")
    assert call(*units, "--cells", "20x4") == plain
    assert plain[0] == 0
    for wrong, reported in (
        ("5 kW", "a unit of that quantity: kW"),
        ("five", "or a number with a unit"),
    ):
        status, _, err = call("--load", wrong)
        assert status == 2
        assert f"'--load': '{wrong}' must be a" in err
        assert reported in err


def test_an_oil_is_told_by_its_grade_or_viscosity(call):
    for given, reported in (
        ((), "viscosity 0.01 Pa s"),
        (("--grade", "ISO VG 46", "--temperature", 60), "ISO VG 46"),
        (
            ("--viscosity-40", 46, "--viscosity-100", 6.6, "--temperature", 80),
            "viscosity 0.00903 Pa s",
        ),
    ):
        status, out, _ = call("--load", 1000, *given, "--cells", "20x4")
        assert status == 0
        assert f"clearance 17 um, {reported}, shaft at" in out


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


@pytest.mark.slow
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
        (["--load", -5], "load = -5 N must be a finite number above 0"),
        (["--load", 5, "--radius", "nan"], "radius = nan must be a finite number"),
        (["--load", 5, "--clearance", 0.004], "below 0.1 times the bore radius 0.0225 m"),
        (["--load", 5, "--clearance", 30], "clearance = 30.0 must be below 0.005: in m, 30e-6 for"),
        (["--load", 5, "--radius", 4], "below 0.1 times the bore radius 4 m: lengths must be in m"),
        (["--load", 5, "--viscosity", 0], "viscosity = 0.0 must be above 0"),
        (
            ["--load", 5, "--tilt", "nan", 0],
            "tilt = [nan, 0] must be two finite numbers [x, y] in rad",
        ),
        (["--load", 5, "--tilt", 2e-3, 0], "tilt = 0.002 rad closes the gap"),
        (["--load", 5, "--cells", "64x-1"], "--cells '64x-1' must be two whole numbers"),
        (["--load", 5, "--cells", "2x2"], "cells_around = 2 must be a whole number, at least 3"),
        (["--load", 5, "--cells", "9999x999"], "the limit is 100000"),
        (
            ["--load", 5, "--groove", 0, 400, 0],
            "a groove is 400 degrees wide: its width must be at least 0",
        ),
        (
            ["--load", 5, "--groove", 0, 10, -1],
            "--groove: the pressure of a groove = -1 Pa",
        ),
        (["--load", 5, "--groove", "nan", 10, 1e5], "--groove: the angle of a groove = nan"),
        (["--load", 5, "--groove", "inf", 10, 1e5], "--groove: the angle of a groove = inf"),
        (["--load", 5, "--groove", 0, "nan", 1e5], "--groove: the width of a groove = nan"),
        (["--load", 5, "--groove", 0, 10, 0, "--line-at-max-film"], "exclude each other"),
        (["--load", 5, "--groove", 0, 10, 0, "--bore-speed", 1], "speed or bore_speed must be 0"),
        (["--load", 2000, "--bore-speed", -500], "draw in no oil: their sum must be at least"),
        (
            ["--load", 5, "--cavitation", "mass-conserving"],
            "needs a supply, a groove or an ambient",
        ),
        (
            ["--load", 5, "--cavitation", "mass-conserving", "--element", "lagrange"],
            "element = 'lagrange' cannot conserve mass without negative fluid fractions",
        ),
        (
            ["--load", 5, "--cavitation", "mass-conserving", "--coefficients"],
            "depend on the frequency",
        ),
        (["--load", 5, "--barus", 1e-8, "--roelands", 0.6], "exclude each other"),
        (["--load", 5, "--viscosity", 1e-40], "viscosity = 1e-40 must be 0 or from 1e-30 to"),
        (["--load", 5, "--viscosity", 1e308], "viscosity = 1e+308 must be below 1e+06: in Pa s"),
        (["--load", 5, "--squeeze", 1e160, 0], "squeeze = [1e+160, 0] must be two finite"),
        (["--load", 5, "--ambient", 1e308], "ambient = 1e+308 must be below 1e+12"),
        (["--load", 5, "--plot", "picture.jpg"], "must end with one of .pdf, .png, .svg"),
        (["--load", 5, "--plot", "/dev/null/picture.png"], "/dev/null is not a folder"),
    ],
)
def test_bad_input_is_one_line_and_status_2(call, arguments, message):
    status, out, err = call(*arguments)
    assert status == 2
    assert out == ""
    assert message in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("as_json", [["--json"], []])
def test_numbers_far_from_any_bearing_end_in_one_line(call, as_json, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, err = call(
        "--eccentricity", 0.3, "--speed", 0, "--squeeze", 1e-300, 0, "--groove", 90, 20, 0.1,
        "--cells", "12x2", *as_json,
    )  # fmt: skip
    assert (status, out) == (1, "")
    assert err.count("\n") == 1


@pytest.mark.parametrize("law", [["--barus", 1e-5], ["--roelands", 50]])
@pytest.mark.parametrize("condition", ["reynolds", "mass-conserving"])
def test_an_oil_that_thickens_without_end_is_named(call, law, condition, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, err = call(
        "--eccentricity", 0.6, "--ambient", 1e5, "--cells", "40x6", "--element", "bilinear",
        "--cavitation", condition, *law,
    )  # fmt: skip
    assert (status, out) == (1, "")
    assert "the viscosity runs away with the pressure" in err
    assert "lower the load or the pressure coefficient" in err
    assert err.count("\n") == 1


def test_oil_that_thickens_is_conserved_as_well(call):
    """Once round the angle the supply must carry more than of a constant oil, and all leaves."""
    supply = ["--eccentricity", 0.6, "--groove", 120, 10, 2e5, "--cells", "48x8", "--json",
              "--cavitation", "mass-conserving"]  # fmt: skip
    constant, thickening = (json.loads(call(*supply, "--barus", barus)[1]) for barus in (0, 5e-8))
    flow = thickening["side_flow_m3_per_s"]
    assert thickening["supply_flow_m3_per_s"] == pytest.approx(flow, rel=1e-8)
    assert thickening["load_N"] > 1.1 * constant["load_N"]


def test_a_line_without_pressure_is_held_for_the_coefficients(call):
    """As a groove of no width, which stands still."""
    options = ["--eccentricity", 0.1, "--coefficients", "--json", "--cells", "48x8"]
    line = json.loads(call(*options, "--line-at-max-film")[1])
    opposite = line["attitude_angle_deg"] + 180
    groove = json.loads(call(*options, "--groove", opposite, 0, 0)[1])
    assert groove["load_N"] == pytest.approx(line["load_N"], rel=1e-3)
    for name in ("stiffness_N_per_m", "damping_Ns_per_m"):
        found, expected = np.array(line[name]), np.array(groove[name])
        assert np.abs(found - expected).max() < 2e-3 * np.abs(expected).max(), name


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
        raise ehd.errors.CavitationError(
            "no solution", {"pressure": np.arange(3.0), "thickness": np.ones((2, 2))}
        )

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(fenics_ehd.scenes.bearing, "solve_bearing", fail)
    status, _, err = call("--eccentricity", 0.5)
    assert status == 1
    assert "no solution; the film is saved in failed_film.h5" in err
    with h5py.File(tmp_path / "failed_film.h5") as file:
        np.testing.assert_array_equal(file["pressure"], [0.0, 1.0, 2.0])
        assert file["thickness"].shape == (2, 2)


def test_film_behind_a_step_that_fell_too_short_is_kept(tmp_path):
    film = ehd.errors.CavitationError(
        "no active set", {"pressure": np.arange(4.0), "thickness": np.eye(2)}
    )
    with (
        pytest.raises(
            ehd.errors.StepSizeError, match=r"too short; the film is saved in .*failed_film\.h5"
        ),
        keeping_failed_film(tmp_path),
    ):
        raise ehd.errors.StepSizeError("too short") from film
    with h5py.File(tmp_path / "failed_film.h5") as file:
        np.testing.assert_array_equal(file["pressure"], np.arange(4.0))
        np.testing.assert_array_equal(file["thickness"], np.eye(2))


def test_error_without_a_film_is_left_alone(tmp_path):
    with pytest.raises(ehd.errors.MeshError, match=r"^no bore$"), keeping_failed_film(tmp_path):
        raise ehd.errors.MeshError("no bore")
    assert not list(tmp_path.iterdir())
