"""Oils as scene files, the command line and Python say them."""

import json
import tomllib

import attrs
import pytest
from command_line import exit_of

import fenics_ehd as ehd
from fenics_ehd.base.needs import NO_TEMPERATURE
from fenics_ehd.base.shared_settings import OilSettings
from fenics_ehd.film.lubricant import make_lubricant, oil_of_grade
from fenics_ehd.scenes.films import build_film
from fenics_ehd.scenes.library import shipped
from fenics_ehd.scenes.scene import scene_of

TABLES = tomllib.loads(shipped("loaded-journal"))


def scene_with(**oil):
    return scene_of({**TABLES, "lubricants": {"oil": oil}}, "scene")


def film_oil(scene):
    return build_film(scene, "bearing", None, 300.0, ()).parameters.lubricant


def test_an_oil_by_grade_is_that_of_its_two_viscosities():
    found = film_oil(scene_with(grade="SAE 10W-40", temperature=90.0, density=880.0))
    pair = film_oil(scene_with(viscosity_40=98.96, viscosity_100=14.4, temperature=90, density=880))
    oil = oil_of_grade("SAE 10W-40", density_15=880.0)
    assert found == pair == ehd.Lubricant.of(oil, 90.0)
    assert found.density == oil.density(90.0) < 880.0


def test_laws_are_multiplied_into_one_oil():
    settings = {"barus": 2e-8, "cross_rate": 1e6, "cross_exponent": 0.8,
                "cross_second_viscosity": 0.3, "specific_heat": 1900.0,
                "density_law": "dowson-higginson", "compressibility": 1e-9}  # fmt: skip
    found = film_oil(scene_with(viscosity=0.01, **settings))
    assert found.density_law == ehd.DowsonHigginson(1e-9, 1.7e-9)
    assert (found.viscosity_law, found.shear_law) == (ehd.Barus(2e-8), ehd.Cross(1e6, 0.8, 0.3))
    assert found.specific_heat == 1900.0
    assert not found.linear
    graded = film_oil(scene_with(grade="ISO VG 46", temperature=60, roelands=0.6))
    assert graded.viscosity_law == ehd.Roelands(graded.viscosity, 0.6)


@pytest.mark.parametrize(
    ("oil", "named"),
    [
        ({}, "lubricants.oil: give exactly one of: viscosity, grade, viscosity_40"),
        ({"viscosity": 0.01, "grade": "SAE 30", "temperature": 90}, "give exactly one of"),
        ({"viscosity": 0.01, "viscosity_40": 90, "viscosity_100": 11}, "give exactly one of"),
        ({"grade": "SAE 30", "viscosity_40": 90, "temperature": 9}, "give exactly one of"),
        ({"grade": "SAE 30"}, "lubricants.oil: temperature is missing"),
        ({"viscosity_40": 90.0, "temperature": 90}, "lubricants.oil: viscosity_100 is missing"),
        ({"viscosity_100": 9.0, "temperature": 90}, "lubricants.oil: viscosity_40 is missing"),
        ({"viscosity_40": 9, "viscosity_100": 11, "temperature": 90}, "must be below that of 9"),
        ({"viscosity_40": 9, "viscosity_100": 1.5, "temperature": 90}, "1.5 mm2/s at 100 C must"),
        ({"grade": "SAE 31", "temperature": 90}, "lubricants.oil: grade = 'SAE 31' is not one of"),
        ({"grade": "SAE 30", "temperature": 400}, "temperature = 400 C of the oil must lie"),
        ({"grade": "SAE 30", "temperature": -274}, "temperature = -274.0 must be at least -273.15"),
        ({"viscosity": 0.01, "barus": 1e-8, "roelands": 0.6}, "barus and roelands exclude each"),
        ({"viscosity": 5e-5, "roelands": 0.6}, "lubricants.oil: viscosity = 5e-05 Pa s must be ab"),
        ({"viscosity": 0.01, "cross_exponent": 0.7}, "cross_exponent = 0.7 has no effect without"),
        ({"viscosity": 0.01, "cross_second_viscosity": 0.7}, "without lubricants.oil.cross_rate"),
        ({"viscosity": 0.01, "compressibility": 1e-9}, "compressibility = 1e-09 has no effect"),
        ({"viscosity": 0.01, "stiffening": 1e-9}, "without lubricants.oil.density_law = 'dow"),
        ({"viscosity": 0.01, "cross_rate": 1e6, "cross_second_viscosity": 1.0}, "must be below 1"),
        ({"viscosity": 0.01, "density": 0.87}, "lubricants.oil.density = 0.87 must be at least"),
        ({"viscosity": 0.01, "grad": "x"}, "unknown key lubricants.oil.grad"),
    ],
)  # fmt: skip
def test_contradictions_are_refused_in_a_line(oil, named):
    with pytest.raises(ehd.errors.SettingsError) as caught:
        scene_with(**oil)
    assert named in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_shipped_scene_shows_an_oil_by_its_grade():
    text = shipped("slider-crank")
    lines = [line.removeprefix("# ") for line in text.splitlines() if line.startswith("# ")]
    keys = {a.name for a in attrs.fields(OilSettings)} - {"viscosity"}
    oil = {}
    for line in lines:
        if line.partition(" = ")[0] in keys:
            oil |= tomllib.loads(line)
    assert set(oil) == keys
    del oil["viscosity_40"], oil["viscosity_100"], oil["roelands"]
    assert film_oil(scene_with(**oil)).oil == oil_of_grade("SAE 10W-40")


# --- One bearing


def test_a_bearing_runs_on_an_oil_by_its_grade(capfd):
    status, text, _ = exit_of(capfd, "bearing", "--load", 5000, "--grade", "ISO VG 46",
                              "--temperature", 60, "--cells", "24x4", "--json")  # fmt: skip
    assert status == 0
    values = json.loads(text)
    oil = oil_of_grade("ISO VG 46")
    assert values["temperature_C"] == 60
    assert values["viscosity_Pa_s"] == oil.viscosity(60.0)
    assert values["density_kg_per_m3"] == oil.density(60.0)
    plain = ehd.BearingSettings(viscosity=oil.viscosity(60.0), cells_around=24, cells_along=4)
    expected = ehd.solve_bearing(plain, load=5000.0)
    assert values["eccentricity_ratio"] == pytest.approx(expected.eccentricity_ratio, rel=1e-9)
    assert values["sommerfeld_number"] == pytest.approx(expected.sommerfeld_number, rel=1e-9)


def test_a_bearing_of_an_oil_that_thins_carries_less():
    loads, torques = [], []
    for cross in ({}, {"cross_rate": 5e5, "cross_second_viscosity": 0.4}):
        found = ehd.solve_bearing(ehd.BearingSettings(cells_around=24, cells_along=4, **cross),
                              eccentricity=0.6, with_coefficients=True)  # fmt: skip
        loads.append(found.load)
        torques.append(found.friction_torque)
        # Shaft and film together: what is fed in is dissipated.
        assert found.power_loss == pytest.approx(found.dissipation, rel=1e-8)
    assert 0.4 < loads[1] / loads[0] < 0.7
    assert 0.4 < torques[1] / torques[0] < 0.8


def test_no_temperature_is_absolute_zero():
    assert make_lubricant(OilSettings(viscosity=0.01)).temperature is None
    assert NO_TEMPERATURE < -273
    assert make_lubricant(OilSettings(viscosity=0.01, temperature=40.0)).temperature == 40.0
