"""A bearing over speeds and loads: table, picture, points that fail, ``fenics-ehd bearing``."""

import csv
import json
from functools import partial

import numpy as np
import pytest
from command_line import exit_of

import fenics_ehd as ehd
from fenics_ehd.base.progress import Progress
from fenics_ehd.scenes import bearing_map as module

SETTINGS = ehd.BearingSettings(cells_around=24, cells_along=4)
CELLS = ("--cells", "24x4")
FEW_CELLS = ("--cells", "12x2")
ROSS = ["frequency", *(f"{letter}{entry}" for letter in "kc" for entry in ("xx", "xy", "yx", "yy"))]


@pytest.fixture
def call(capsys):
    return partial(exit_of, capsys, "bearing")


def test_points_are_those_of_single_bearings():
    texts: list[str] = []
    progress = Progress(texts.append, interval=0.0)
    points = ehd.bearing_map(
        SETTINGS, speeds=[300.0, 500.0], loads=[1e3, "2 kN"], progress=progress
    )
    assert [text.rpartition(", ")[2] for text in texts] == [f"{n} of 4 points" for n in range(5)]
    rows = points.rows()
    assert [(row["frequency"], row["load_N"]) for row in rows] == [
        (speed, pytest.approx(load)) for speed in (300.0, 500.0) for load in (1e3, 2e3)
    ]
    single = ehd.solve_bearing(SETTINGS, load=2e3, with_coefficients=True)
    linear = single.coefficients
    assert [*rows[3]][:9] == ROSS
    assert [rows[3][name] for name in ROSS[1:5]] == linear.stiffness.ravel().tolist()
    assert [rows[3][name] for name in ROSS[5:]] == linear.damping.ravel().tolist()
    assert rows[3]["critical_mass_kg"] == linear.critical_mass
    assert rows[3]["whirl_frequency_ratio"] == linear.whirl_ratio
    assert rows[3]["stiffness_scatter_N_per_m"] == linear.stiffness_scatter.max()
    assert rows[3]["kyx_scatter_N_per_m"] == linear.stiffness_scatter[1, 0]
    assert rows[3]["critical_mass_scatter_kg"] == linear.critical_mass_scatter
    assert 0.0 < linear.whirl_ratio_scatter < 0.05 * linear.whirl_ratio


def test_coefficients_at_one_eccentricity_follow_similarity():
    """At one eccentricity stiffness is proportional to the speed, and damping constant."""
    slow, fast = ehd.bearing_map(SETTINGS, speeds=[200.0, 800.0], eccentricity=0.5).rows()
    assert fast["load_N"] == pytest.approx(4 * slow["load_N"], rel=1e-6)
    for entry in ("xx", "xy", "yx", "yy"):
        assert fast[f"k{entry}"] == pytest.approx(4 * slow[f"k{entry}"], rel=1e-4)
        assert fast[f"c{entry}"] == pytest.approx(slow[f"c{entry}"], rel=1e-4)
    assert fast["whirl_frequency_ratio"] == pytest.approx(slow["whirl_frequency_ratio"], rel=1e-4)
    with pytest.raises(ehd.errors.SettingsError, match="exactly one of loads and eccentricity"):
        ehd.bearing_map(SETTINGS, speeds=[1.0], loads=[1.0], eccentricity=0.5)


def test_a_map_has_a_table_a_picture_and_printed_rows(call, tmp_path):
    table, picture = tmp_path / "map.csv", tmp_path / "map.svg"
    status, out, err = call(
        "--load", "1 kN", "--speed", "1000rpm:5000rpm:3", *CELLS, "--table", table,
        "--plot", picture,
    )  # fmt: skip
    assert (status, err) == (0, "")
    with open(table) as file:
        rows = [*csv.DictReader(file)]
    assert [*rows[0]][:9] == ROSS
    speeds = [float(row["frequency"]) for row in rows]
    np.testing.assert_allclose(speeds, np.pi / 30 * np.array([1e3, 3e3, 5e3]), rtol=1e-11)
    assert all(float(row["cxx"]) > 0 for row in rows)
    assert "kxx MN/m" in out
    assert out.count(" +- ") == 3 * 10
    assert "whirl" in out
    drawn = picture.read_text()
    for label in (
        "stiffness [MN/m]",
        "damping [kN s/m]",
        "whirl ratio",
        "rigid rotor, per bearing",
    ):
        assert label in drawn


def test_a_point_that_fails_is_named_and_the_others_stay(call, tmp_path):
    table = tmp_path / "map.csv"
    status, out, err = call("--load", "1e3,1e9", *FEW_CELLS, "--table", table, "--json")
    assert status == 1
    assert "speed 500 rad/s, load 1e+09 N: " in err
    assert "1 of 2 points have no result" in err
    values = json.loads(out)
    assert [row["load_N"] for row in values["rows"]] == pytest.approx([1e3])
    assert values["failed"][0]["load_N"] == 1e9
    assert len(table.read_text().splitlines()) == 2
    status, out, _ = call("--load", 1e3, "--speed", "0,0.0", *CELLS)
    assert status == 2  # given twice
    status, out, _ = call("--load", "1e9,2e9", *FEW_CELLS)
    assert status == 1
    assert "no point has a result" in out
    with pytest.raises(ehd.errors.UnknownNameError, match="its names: none"):
        _ = module.BearingMap((), ())["kxx"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--load", "1,2", "--speed", "1:3:2", "--plot", "x.png"], "a picture has one axis"),
        (["--load", 1, "--table", "x.csv"], "a table has a row for each"),
        (["--load", 1, "--speed", "1000rpm:x:4"], "--speed = 'x'"),
        (["--load", "1 m:2 m:3"], "a unit of another quantity"),
        (["--load", "1,2", "--cavitation", "mass-conserving"], "depend on the frequency"),
        (["--load", "0,100"], "load = 0.0 must be above 0"),
        (["--load", "100,-100"], "load = -100.0 must be above 0"),
        (["--load", 100, "--speed", "300,0"], "speed = 0 rad/s: a film that draws in no oil"),
        (["--eccentricity", 0.5, "--speed", "300,0"], "speed = 0 rad/s: a film that draws in no"),
        (["--load", "1,2", "--table", "x.xlsx"], "--table x.xlsx: the file must end with .csv"),
        (["--load", "1,2", "--table", "/dev/null/x.csv"], "/dev/null is not a folder"),
    ],
)
def test_maps_that_are_refused(call, options, message, monkeypatch):
    monkeypatch.setattr(module, "solve_bearing", None)
    status, _, err = call(*options, *CELLS)
    assert status == 2
    assert message in err
    assert err.count("\n") == 1


def test_the_folder_of_a_table_is_made(call, tmp_path):
    table = tmp_path / "new" / "map.csv"
    assert call("--load", "1e3,2e3", *CELLS, "--table", table)[0] == 0
    assert table.read_text().startswith("frequency,")


def test_a_foreign_file_is_not_replaced_by_a_table(call, tmp_path):
    table = tmp_path / "map.csv"
    table.write_text("speed,k\n1,2\n")
    status, _, err = call("--load", "1e3,2e3", *CELLS, "--table", table)
    assert status == 2
    assert "is not a table of bearing coefficients" in err
