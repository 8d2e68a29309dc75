"""Demos of whole machines: each runs, and one number of it is known."""

import numpy as np
import pytest
from test_demos import demo


@pytest.mark.slow
def test_rotor_follows_its_force():
    result = demo("rotor").main(revolutions=0.1)
    bearing = result.joints["bearing"]
    # 5.279 um at a hundredth of the demo's tolerance, by equations of version 0.1.
    assert bearing.min_film_thickness.min() == pytest.approx(5.279e-6, rel=0.02)
    assert result.energy_balance_error < 1e-2
    # The force begins along x and turns towards y.
    assert np.all(bearing.eccentricity[-1] > 0)


def test_journal_finds_the_thinnest_film_of_an_engine_bearing():
    result = demo("loaded_journal").main(tolerance=2e-3)
    film = result.joints["film"]
    assert film.min_film_thickness.min() == pytest.approx(4.26e-6, rel=0.04)
    assert result.periodicity_defect <= 2e-3
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
