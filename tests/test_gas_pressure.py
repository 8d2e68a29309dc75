"""Gas forces from tables of pressures, tables without their last row, and strokes as words."""

import numpy as np
import pytest
from scene_cases import write_scene

import fenics_ehd as ehd
from fenics_ehd.scenes.inputs import forces
from fenics_ehd.scenes.tables import read_angle_table

DIAMETER = 0.086
AREA = np.pi * DIAMETER**2 / 4

GAS = {
    "kind": "angle-table", "point": "piston", "angle_of": "crank", "file": "gas.csv",
}  # fmt: skip


def pressure(degrees):
    """Absolute gas pressure over 720 degrees [Pa], with its peak at 0."""
    return 1e5 + 59e5 * np.exp(-((1 - np.cos(np.radians(degrees / 2))) * 40))


def write_table(folder, angles, values, column):
    rows = "\n".join(f"{a:.10g},{v:.17g}" for a, v in zip(angles, values, strict=True))
    (folder / "gas.csv").write_text(f"# measured\nangle_deg,{column}\n{rows}\n")


def gas_force(folder, **settings):
    """Force of a scene's table, a function of the crank angle [rad]."""
    path = write_scene(folder / "scene.toml", "slider-crank-paper", {"forces.gas": GAS | settings})
    return forces(ehd.read_scene(path))["gas"].size


@pytest.mark.parametrize(
    ("unit", "factor"), [("bar", 1e-5), ("Pa", 1.0), ("kPa", 1e-3), ("MPa", 1e-6)]
)
@pytest.mark.parametrize("first", [-360.0, 0.0])
def test_a_table_of_pressures_is_one_of_forces(unit, factor, first, tmp_path):
    angles = first + np.arange(0.0, 721.0, 2.0)
    write_table(tmp_path, angles, factor * pressure(angles), f"pressure_{unit}")
    by_pressure = gas_force(tmp_path, piston_diameter="86 mm", crankcase_pressure="1 bar")
    write_table(tmp_path, angles, AREA * (pressure(angles) - 1e5), "force_N")
    by_force = gas_force(tmp_path)
    for degrees in (0.0, 3.0, 100.0, 359.0, 365.0, -20.0):
        np.testing.assert_allclose(
            by_pressure(np.radians(degrees)), by_force(np.radians(degrees)), rtol=1e-9, atol=1e-6
        )
    assert by_pressure(0.0)[0] == pytest.approx(AREA * 59e5, rel=1e-6)


@pytest.mark.parametrize("period", [360, 720])
@pytest.mark.parametrize("step", [0.5, 1.0, 5.0])
def test_a_table_without_its_last_row_is_closed(period, step, tmp_path):
    angles = np.arange(-period / 2, period / 2 + step / 2, step)
    values = 2.0 + np.cos(2 * np.pi * angles / period)
    write_table(tmp_path, angles, values, "force_N")
    closed = read_angle_table(tmp_path / "gas.csv", "gas", {"force": {"N": 1.0}})
    write_table(tmp_path, angles[:-1], values[:-1], "force_N")
    without = read_angle_table(tmp_path / "gas.csv", "gas", {"force": {"N": 1.0}})
    assert without.period == pytest.approx(closed.period, rel=1e-14)
    for degrees in np.linspace(-400.0, 400.0, 41):
        assert without(np.radians(degrees))[0] == pytest.approx(closed(np.radians(degrees))[0])


@pytest.mark.parametrize(
    "angles", [np.arange(0.0, 700.0, 5.0), np.append(np.arange(0.0, 700.0, 5.0), 715.0)]
)
def test_a_table_with_other_gaps_is_refused(angles, tmp_path):
    write_table(tmp_path, angles, np.ones_like(angles), "force_N")
    with pytest.raises(ehd.errors.SettingsError, match="must span 360 or 720 deg"):
        read_angle_table(tmp_path / "gas.csv", "gas", {"force": {"N": 1.0}})


@pytest.mark.parametrize(
    ("column", "settings", "message"),
    [
        ("pressure_bar", {}, r"pressure_bar.* needs forces\.gas\.piston_diameter"),
        ("force_N", {"piston_diameter": 0.08}, r"force_N.* needs no forces\.gas\.piston_diameter"),
        ("pressure_psi", {"piston_diameter": 0.08}, r"give pressure_bar or pressure_Pa"),
    ],
)
def test_a_table_of_another_column_is_refused(column, settings, message, tmp_path):
    write_table(tmp_path, [0, 90, 180, 360], [1, 2, 1, 1], column)
    with pytest.raises(ehd.errors.SettingsError, match=message):
        gas_force(tmp_path, **settings)


def test_a_crankcase_without_a_piston_is_refused(tmp_path):
    write_table(tmp_path, [0, 90, 180, 360], [1, 2, 1, 1], "force_N")
    with pytest.raises(ehd.errors.SettingsError, match=r"crankcase_pressure .* has no effect"):
        gas_force(tmp_path, crankcase_pressure=1e5)


@pytest.mark.parametrize(("word", "revolutions"), [("two-stroke", 1.0), ("four-stroke", 2.0)])
def test_strokes_are_revolutions_of_a_period(word, revolutions):
    scene = ehd.read_scene("engine", **{"time.revolutions": word})
    assert scene.time.revolutions == revolutions
    assert scene.span == pytest.approx(revolutions * 2 * np.pi / 300.0)


def test_an_unknown_stroke_is_refused():
    with pytest.raises(ehd.errors.SettingsError, match=r"revolutions = 'six-stroke'.* four-stroke"):
        ehd.read_scene("engine", **{"time.revolutions": "six-stroke"})
