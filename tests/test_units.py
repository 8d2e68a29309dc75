"""Numbers with their units in scene files."""

from __future__ import annotations

import tomllib
from math import pi

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scene_cases import tables_of

import fenics_ehd as ehd
from fenics_ehd.base.units import in_unit
from fenics_ehd.scenes.scene import scene_of, scene_text


@pytest.mark.parametrize(
    ("written", "unit", "value"),
    [
        ("20 um", "m", 20e-6),
        ("20µm", "m", 20e-6),
        ("38 mm", "m", 38e-3),
        ("1 in", "m", 0.0254),
        ("2 bar", "Pa", 2e5),
        ("210 GPa", "Pa", 210e9),
        ("5 mPa s", "Pa s", 5e-3),
        ("5 mPa*s", "Pa s", 5e-3),
        ("5 cP", "Pa s", 5e-3),
        ("46 cSt", "mm2/s", 46.0),
        ("15 1/GPa", "1/Pa", 15e-9),
        ("15 /GPa", "1/Pa", 15e-9),
        ("7.85 g/cm3", "kg/m3", 7850.0),
        ("10 kg cm^2", "kg m2", 1e-3),
        ("2 kJ/(kg K)", "J/(kg K)", 2000.0),
        ("100 N/um", "N/m", 1e8),
        ("1.5 Nm", "N m", None),
        ("3 bar min/l", "Pa s/m3", 3e5 * 60 / 1e-3),
        ("60 deg", "degrees", 60.0),
        ("20 °", "degrees", 20.0),
        ("0.1 mrad", "rad", 1e-4),
        ("40 C", "C", 40.0),
        ("313.15 K", "C", 40.0),
        ("104 F", "C", 40.0),
        ("0.1 K", "K", 0.1),
        ("35 %", "", 0.35),
        ("-1e-3 mm", "m", -1e-6),
    ],
)
def test_number_is_the_one_written_out(written, unit, value):
    """To the last bit, so that a scene with units is the scene without."""
    if value is None:
        with pytest.raises(ehd.errors.SettingsError):
            in_unit(written, unit)
    else:
        assert in_unit(written, unit) == value


def test_a_turn_a_minute():
    assert in_unit("9000 rpm", "rad/s") == 300 * pi
    for unit in ("1/min", "/min", "min-1", "r/min", "1 / min"):
        assert in_unit(f"9000 {unit}", "rad/s") == 300 * pi
    assert in_unit("1 rev/s", "rad/s") == 2 * pi
    assert in_unit("1 rad", "degrees") == pytest.approx(57.29577951308232, rel=1e-15)


@given(st.floats(1e-9, 1e9), st.sampled_from(["um", "mm", "cm", "m", "km"]))
def test_lengths_are_decimal(number, unit):
    factor = {"um": "e-6", "mm": "e-3", "cm": "e-2", "m": "", "km": "e3"}[unit]
    plain = format(number, ".17f").rstrip("0")
    assert in_unit(f"{plain} {unit}", "m") == float(plain + factor)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joints.big_end.clearance": "17 s"}, "clearance = '17 s' must be a number in m, or"),
        (
            {"joints.big_end.clearance": "17 mn"},
            "must be a number in m: 'mn' is not a known unit",
        ),
        ({"joints.big_end.clearance": "17"}, "= '17' must be a finite number in m, or a number"),
        ({"joints.big_end.clearance": "1e999 m"}, "= '1e999 m' must be a finite number in m"),
        ({"joints.big_end.clearance": f"{'1' * 5000} m"}, "m' must be a finite number in m"),
        ({"joints.big_end.clearance": "17 mm"}, "clearance = 0.017 must be below 0.005: in m"),
        ({"drives.crank.speed": "80 Hz"}, "speed = '80 Hz' must be a number in rad/s, or a"),
        ({"bodies.crank.points.pin": ["48 s", 0]}, "must be two finite numbers [x, y] in m"),
        ({"bodies.rod.geometry.bore_radius": "2 bar"}, "= '2 bar' must be a number in m"),
        ({"joints.big_end.grooves": [["9 m", 3, 0]]}, "grooves: angle = '9 m' must be a number in"),
        ({"lubricants.oil.temperature": "90 m"}, "= '90 m' must be a number in C"),
        (
            {"time.tolerance": "1 mm"},
            "time.tolerance = '1 mm' must be a number, or a number with a unit",
        ),
    ],
)
def test_other_dimension_is_one_line(changes, message):
    with pytest.raises(ehd.errors.SettingsError) as caught:
        scene_of(tables_of("slider-crank", changes), "case")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_scene_with_units_is_the_scene_without():
    plain = {
        "joints.big_end.clearance": 17e-6,
        "joints.big_end.grooves": [[90.0, 10.0, 3e5]],
        "bodies.crank.points.pin": [0.048, 0.0],
        "bodies.crank.inertia": 1e-3,
        "bodies.rod.geometry.bore_radius": 0.0225,
        "bodies.rod.material.youngs_modulus": 210e9,
        "lubricants.oil.viscosity": 0.01,
    }
    units = {
        "joints.big_end.clearance": "17 um",
        "joints.big_end.grooves": [["90 deg", "10 deg", "3 bar"]],
        "bodies.crank.points.pin": ["48 mm", 0],
        "bodies.crank.inertia": "10 kg cm2",
        "bodies.rod.geometry.bore_radius": "22.5 mm",
        "bodies.rod.material.youngs_modulus": "210 GPa",
        "lubricants.oil.viscosity": "10 mPa s",
    }
    first, second = (scene_of(tables_of("slider-crank", given), "s") for given in (plain, units))
    assert scene_text(first) == scene_text(second)
    again = scene_of(tomllib.loads(scene_text(second)), "s")
    assert again.joints["big_end"] == first.joints["big_end"]
