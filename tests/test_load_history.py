"""Load files, the example load and the settings of a loaded journal."""

import attrs
import numpy as np
import pytest
from scipy.integrate import trapezoid
from test_demos import DEMOS

from fenics_ehd.errors import SettingsError
from fenics_ehd.scenes.engine_load import Engine, engine_load
from fenics_ehd.scenes.load_history import read_load
from fenics_ehd.scenes.loaded_journal_run import OrbitTotals, simulate
from fenics_ehd.scenes.loaded_journal_settings import (
    Bearing,
    Load,
    LoadedJournalSettings,
    Start,
    Time,
)
from fenics_ehd.settings import build


@pytest.mark.parametrize(
    ("tables", "named"),
    [
        ({"bearing": {"grooves": [[90, 10]]}}, "bearing.grooves: (90.0, 10.0) must be one of"),
        ({"bearing": {"grooves": [[90, 10, "a"]]}}, "pressure = 'a' must be a finite"),
        ({"bearing": {"grooves": 3}}, "bearing.grooves = 3 must be a list of [angle, width"),
        ({"film": {"cavitation": "none"}}, "film.cavitation = 'none' must be one of reynolds"),
        ({"film": {"cells": [20]}}, "film.cells"),
        ({"film": {"cells": [3, 1]}}, "film.cells = [3, 1] must be at least [8, 2]"),
        ({"film": {"cells": []}}, "film.cells = [] must be two whole numbers"),
        ({"bearing": {"radius": 25}}, "bearing.radius = 25.0 must be below 5: in m, 0.025 for"),
        ({"bearing": {"width": 20}}, "bearing.width = 20.0 must be below 5: in m"),
        ({"bearing": {"clearance": 25}}, "bearing.clearance = 25.0 must be below 0.005: in m, 30"),
        ({"time": {"cycles": 0}}, "time.cycles = 0"),
        ({"time": {"order": 7}}, "time.order = 7"),
    ],
)
def test_bad_settings_are_named(tables, named):
    with pytest.raises(SettingsError) as error:
        build(LoadedJournalSettings, tables)
    assert named in str(error.value)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"start": Start(0.8, 0.8)}, "start.eccentricity_x"),
        ({"bearing": Bearing(shaft_speed=0.0)}, "bearing.shaft_speed = 0 rad/s must be above 0"),
        ({"bearing": Bearing(clearance=2e-3)}, "bearing.clearance = 0.002"),
        ({"bearing": Bearing(radius=4.0)}, "of the bore radius 4 m: lengths are in metres"),
        ({"bearing": Bearing(bore_speed=1.0, grooves=[[0, 1, 0]])}, "bearing.bore_speed = 1"),
        ({"bearing": Bearing(grooves=[[0, 1, -1]])}, "-1"),
        ({"time": Time(smallest_step=1e-3)}, "time.smallest_step = 0.001"),
        ({"load": Load(period=1.0)}, "load.period = 1 s must be 0"),
        ({"load": Load(file="absent.csv")}, "absent.csv: No such file"),
    ],
)
def test_scenes_that_cannot_run_are_refused(changes, named):
    with pytest.raises(SettingsError) as error:
        simulate(attrs.evolve(LoadedJournalSettings(), **changes), OrbitTotals())
    assert named in str(error.value)


GOOD = "# a comment\n\ntime_ms, Fx [kN], Fy_N\n0,1,-5\n 1, 2 ,0\n# more\n2,0,7\n4,1,-5\n"


def test_load_file_is_read_in_its_units(tmp_path):
    path = tmp_path / "load.csv"
    path.write_text(GOOD)
    for interpolation in ("cubic", "linear"):
        load = read_load(path, scale=2.0, interpolation=interpolation)
        assert load.period == pytest.approx(4e-3)
        assert load(1e-3) == pytest.approx([4000.0, 0.0])
        assert load(9e-3) == pytest.approx([4000.0, 0.0])
        assert load(4e-3) == pytest.approx([2000.0, -10.0])
    assert load(1.5e-3) == pytest.approx([2000.0, 7.0])
    path.write_text(GOOD.replace("4,1,-5\n", ""))
    assert read_load(path, period=4e-3).forces[-1] == pytest.approx([1000.0, -5.0])


@pytest.mark.parametrize(
    ("text", "named"),
    [
        (GOOD.replace(" 1, 2 ,0", "1,2"), "line 5: 2 values for 3 columns"),
        (GOOD.replace(" 2 ", " two "), "line 5: Fx [kN] = 'two' must be a finite number"),
        (
            GOOD.replace(",", ";"),
            "line 3, has 'time_ms; Fx [kN]; Fy_N': separate by commas, decimals with a point",
        ),
        (GOOD.replace(",", "\t"), "separate by commas"),
        (GOOD.replace("7", "nan"), "line 7: Fy_N = 'nan' must be a finite number"),
        (GOOD.replace(" 1, 2", "3, 2"), "line 7: the time 0.002 s must be above 0.003 s"),
        (GOOD.replace("0,1,-5", "0.5,1,-5"), "line 4: the first time is 0.0005 s, it must be 0"),
        (GOOD.replace("4,1,-5", "4,1,-25"), "line 8: the last load (1000, -25) N differs"),
        (GOOD.replace("Fy_N", "Fy"), "line 3: column 'Fy' needs a unit: Fy_N or Fy_kN"),
        (GOOD.replace("Fy_N", "Fy_lbf"), "line 3: column 'Fy_lbf' needs a unit"),
        (GOOD.replace("Fy_N", "Fz_N"), "line 3: column 'Fz_N' is not one of time, Fx and Fy"),
        (GOOD.replace("Fy_N", "Fx_N"), "line 3: column 'Fx_N' appears twice"),
        ("time_s,Fx_N\n0,1\n1,1\n2,1\n", "no column Fy"),
        ("time_s,Fx_N,Fy_N\n0,1,1\n1,1,1\n", "2 rows of numbers, at least 3"),
        ("time_s,Fx_N,Fy_N\n0,0,0\n1,0,0\n2,0,0\n", "the load is 0 throughout"),
        ("# nothing\n", "no header"),
        (b"\xff\xfe\x00", "not a text file"),
    ],
)
def test_bad_load_files_are_refused_by_line_and_value(text, named, tmp_path):
    path = tmp_path / "load.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(SettingsError) as error:
        read_load(path)
    assert str(path) in str(error.value)
    assert named in str(error.value)


def test_period_must_reach_beyond_the_file(tmp_path):
    path = tmp_path / "load.csv"
    path.write_text(GOOD)
    with pytest.raises(SettingsError, match=r"load.period = 0.003 s must be above 0.004 s"):
        read_load(path, period=3e-3)


def test_example_load_is_the_formula(tmp_path):
    shipped = read_load(DEMOS / "loads" / "single_cylinder.csv")
    formula = engine_load(300.0)
    assert shipped.times == pytest.approx(formula.times, abs=1e-9)
    assert shipped.forces == pytest.approx(formula.forces, abs=1e-3)
    # Inertia cancels over the cycle. Gas pushes along the cylinder, and aside when it expands.
    mean = trapezoid(formula.forces, formula.times, axis=0) / formula.period
    assert mean[0] < 0 < mean[1]
    assert mean[0] == pytest.approx(-0.5 * gas_force_mean(), rel=1e-3)


def gas_force_mean():
    engine = Engine()
    angle = np.linspace(-np.pi, 3 * np.pi, 20001)
    area = 0.25 * np.pi * engine.cylinder_bore**2
    return area * np.mean(engine.gas_pressure(angle)[:-1])
