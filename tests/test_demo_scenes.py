"""Demos of whole machines: each runs, and one number of it is known."""

import numpy as np
import pytest
from test_demos import demo


def test_rotor_tilts_in_its_bearing():
    totals, rows = demo("rotor").main(revolutions=0.1)
    # 5.279 um at a hundredth of the demo's tolerance.
    assert totals.min_film_thickness == pytest.approx(5.279e-6, rel=0.02)
    assert totals.energy_error < 1e-2
    # The force begins along x and turns towards y: the shaft follows it.
    tilt = np.array([[row["tilt_x_rad"], row["tilt_y_rad"]] for row in rows])
    assert tilt[-1, 1] > 0 > tilt[-1, 0]


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
