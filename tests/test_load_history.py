"""Load files and the example load."""

import make_single_cylinder
import numpy as np
import pytest
from make_single_cylinder import Engine, engine_load
from scipy.integrate import trapezoid

import fenics_ehd as ehd
from fenics_ehd.scenes.library import table_file
from fenics_ehd.scenes.tables import read_angle_table, read_time_table

GOOD = "# a comment\n\ntime_ms, Fx [kN], Fy_N\n0,1,-5\n 1, 2 ,0\n# more\n2,0,7\n4,1,-5\n"


def at(curves, time):
    return [curve(time)[0] for curve in curves]


def test_load_file_is_read_in_its_units(tmp_path):
    path = tmp_path / "load.csv"
    path.write_text(GOOD)
    for interpolation in ("cubic", "linear"):
        curves = ehd.read_load(path, scale=2.0, interpolation=interpolation)
        assert [curve.period for curve in curves] == pytest.approx([4e-3, 4e-3])
        assert at(curves, 1e-3) == pytest.approx([4000.0, 0.0])
        assert at(curves, 9e-3) == pytest.approx([4000.0, 0.0])
        assert at(curves, 4e-3) == pytest.approx([2000.0, -10.0])
    assert at(curves, 1.5e-3) == pytest.approx([2000.0, 7.0])
    with pytest.raises(ehd.errors.SettingsError, match=r"period = 0.003 s must be above 0.004"):
        ehd.read_load(path, period=3e-3)
    path.write_text(GOOD.replace("4,1,-5\n", ""))
    assert at(ehd.read_load(path, period=4e-3), 4e-3) == pytest.approx([1000.0, -5.0])


#: Every refusal of a table once, in files of loads; those of other tables that loads do not know.
LOADS = [
    (GOOD.replace(" 1, 2 ,0", "1,2"), "line 5: 2 values for 3 columns"),
    (GOOD.replace(" 2 ", " two "), "line 5: Fx [kN] = 'two' must be a finite number"),
    (GOOD.replace(",", ";"), "line 3: 'time_ms; Fx [kN]; Fy_N': separate entries by commas"),
    (GOOD.replace(",", "\t"), "separate entries by commas"),
    (GOOD.replace("7", "nan"), "line 7: Fy_N = 'nan' must be a finite number"),
    (GOOD.replace("7", 200_000 * "1"), "line 7: Fy_N = '1111"),
    (GOOD.replace("7", "1e308"), "'1e308' must be a finite number below 1e"),
    (GOOD.replace(" 1, 2", "3, 2"), "line 7: the time 0.002 s must be above 0.003 s"),
    (GOOD.replace("0,1,-5", "0.5,1,-5"), "line 4: the first time is 0.0005 s: it must be 0"),
    (GOOD.replace("4,1,-5", "4,1,-25"), "line 8: the last row (1000, -25) differs from the first"),
    (GOOD.replace("Fy_N", "Fy"), "line 3: column 'Fy' needs a unit: give Fy_N or Fy_kN"),
    (GOOD.replace("Fy_N", "Fy_lbf"), "line 3: column 'Fy_lbf' needs a unit"),
    (GOOD.replace("Fy_N", "Fz_N"), "line 3: column 'Fz_N' is not one of time, Fx, Fy"),
    (GOOD.replace("Fy_N", "Fx_N"), "line 3: column 'Fx_N' appears twice"),
    ("time_s,Fx_N\n0,1\n1,1\n2,1\n", "no column Fy"),
    ("time_s,Fx_N,Fy_N\n0,1,1\n1,1,1\n", "2 rows of numbers, at least 3"),
    ("time_s,Fx_N,Fy_N\n0,0,0\n1,0,0\n2,0,0\n", "the load is 0 in all rows"),
    ("# nothing\n", "the file is empty"),
    (b"\xff\xfe\x00", "not a text file"),
    (None, "No such file"),
]
ANGLES = "angle_deg,force_N\n0,1\n90,2\n180,3\n360,1\n"
OTHERS = [
    (read_angle_table, ANGLES.replace("90,", "190,"), "line 4: the angle 180 deg must be above"),
    (read_angle_table, ANGLES.replace("360", "350"), "the angles span 350 deg, from 0 to 350"),
    (read_angle_table, ANGLES.replace("360,1", "360,2"), "line 5: the last row (2) differs from"),
    (read_time_table, "time_s,force_N\n0,1\n", "1 rows of numbers, at least 2"),
    (read_time_table, "time_s,force_N\n0,1\n0,2\n", "line 3: the time 0 s must be above 0 s"),
]


@pytest.mark.parametrize(
    ("read", "text", "named"),
    [(lambda path, *_: ehd.read_load(path), *case) for case in LOADS] + OTHERS,
)
def test_bad_tables_are_refused_by_line_and_value(read, text, named, tmp_path):
    path = tmp_path / "load.csv"
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ehd.errors.SettingsError) as error:
        read(path, "load.file", {"force": {"N": 1.0}})
    assert str(error.value).startswith(f"load.file {path}")
    assert named in str(error.value)
    assert "\n" not in str(error.value)


def test_example_load_is_the_formula(tmp_path):
    written = make_single_cylinder.main(tmp_path / "load.csv").read_text()
    assert written == make_single_cylinder.FILE.read_text()
    shipped = ehd.read_load(table_file("main-bearing", "load"))
    times, forces = engine_load(300.0)
    assert shipped[0].curve.x == pytest.approx(times, abs=1e-9)
    for curve, values in zip(shipped, forces.T, strict=True):
        assert curve.curve(curve.curve.x) == pytest.approx(values, abs=1e-3)
    # Inertia cancels over the cycle. Gas pushes along the cylinder, and aside when it expands.
    mean = trapezoid(forces, times, axis=0) / times[-1]
    assert mean[0] < 0 < mean[1]
    assert mean[0] == pytest.approx(-0.5 * gas_force_mean(), rel=1e-3)


def test_gas_of_the_example_engine_is_the_same_one():
    engine = Engine()
    gas = read_angle_table(table_file("gas-force", "gas"), "gas", {"force": {"N": 1.0}})
    angle = np.linspace(-np.pi, 3 * np.pi, 361)[:-1]
    area = 0.25 * np.pi * engine.cylinder_bore**2
    found = [gas(a)[0] for a in angle]
    largest = max(found)
    assert found == pytest.approx(area * engine.gas_pressure(angle), abs=2e-3 * largest)


def gas_force_mean():
    engine = Engine()
    angle = np.linspace(-np.pi, 3 * np.pi, 20001)
    area = 0.25 * np.pi * engine.cylinder_bore**2
    return area * np.mean(engine.gas_pressure(angle)[:-1])
