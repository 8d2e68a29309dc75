"""Every demo runs, and one number of it is known."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

DEMOS = Path(__file__).parents[1] / "demos"


def demo(name):
    spec = importlib.util.spec_from_file_location(name, DEMOS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_demo_is_tested():
    texts = [path.read_text() for path in Path(__file__).parent.glob("test_*.py")]
    tested = {name for text in texts for name in re.findall(r'demo\("(\w+)"\)', text)}
    assert {path.stem for path in DEMOS.glob("*.py")} == tested


def test_every_demo_has_a_page_with_its_picture():
    pages = {path.stem: path for path in (DEMOS.parent / "docs" / "demos").glob("*.md")}
    assert pages.keys() == {"index", *(path.stem for path in DEMOS.glob("*.py"))}
    for name, page in pages.items():
        pictures = re.findall(r"!\[.+\]\((.+)\)", page.read_text())
        # Exudyn, with which this demo compares frequencies, is not among Debian's packages.
        assert len(pictures) == (name not in ("index", "exudyn_body")), name
        assert all((page.parent / picture).is_file() for picture in pictures), name


@pytest.mark.slow
def test_slider_crank_builds_up_its_film():
    result = demo("slider_crank").main(revolutions=0.05)
    # The inertia of the rod's end against the crank: 38 MPa after a twentieth of a revolution.
    assert result.joints["big_end"].max_pressure.max() == pytest.approx(37.5e6, rel=0.05)
    assert result.summary()["energy_balance_error"] < 1e-2


@pytest.mark.slow
def test_rigid_bearing_becomes_ocvirks():
    # A twentieth as wide as its diameter: what the theory leaves out is of order (B/D)^2 and c/R.
    assert demo("rigid_bearing").main() == pytest.approx(1.0, abs=4e-3)


def test_foreign_matrices_keep_their_frequency():
    found, expected = demo("foreign_matrices").main()
    assert found == pytest.approx(expected, rel=1e-8)


@pytest.mark.slow
def test_foreign_matrices_need_no_dolfinx():
    lines = "import sys; sys.path.insert(0, sys.argv[1]); import foreign_matrices as f; f.main()"
    subprocess.run(
        [sys.executable, "-c", f"{lines}; assert 'dolfinx' not in sys.modules", DEMOS],
        check=True, capture_output=True,
    )  # fmt: skip


@pytest.mark.slow
def test_rotor_follows_its_force():
    result = demo("rotor").main(revolutions=0.1)
    bearing = result.joints["bearing"]
    # 5.279 um at a hundredth of the demo's tolerance, by equations of version 0.1.
    assert bearing.min_film_thickness.min() == pytest.approx(5.279e-6, rel=0.02)
    assert result.summary()["energy_balance_error"] < 1e-2
    # The force begins along x and turns towards y.
    assert np.all(bearing.eccentricity[-1] > 0)


@pytest.mark.slow
def test_journal_finds_the_thinnest_film_of_an_engine_bearing():
    # As it stands in the documentation: what it asks of the steps and of a cycle goes together.
    result = demo("loaded_journal").main()
    film = result.joints["film"]
    assert film.min_film_thickness.min() == pytest.approx(4.263e-6, rel=2e-3)
    assert result.summary()["periodicity_defect"] <= 5e-4
    assert result.cycles <= 4


@pytest.mark.slow
def test_study_finds_what_each_method_costs(tmp_path):
    rows = demo("study").main(tmp_path)
    assert all(row["status"] == "complete" for row in rows.values())
    errors = {row["method"]: row["film_error_max"] for row in rows.values()}
    assert errors["m4"] < 2e-3
    assert 4 * errors["m4"] < errors["m3"] < 0.5 * min(errors["m1"], errors["m2"])
    modes = {row["method"]: row["coordinates"] for row in rows.values()}
    assert modes == {"m1": 24, "m2": 24, "m3": 24, "m4": 9}
    # A second call finds everything there.
    stamps = {path: path.stat().st_mtime_ns for path in tmp_path.glob("runs/*/history.csv")}
    demo("study").main(tmp_path)
    assert stamps == {path: path.stat().st_mtime_ns for path in stamps}
