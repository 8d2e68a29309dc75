"""Settings: every bad value is one line that names it."""

import os
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fenics_ehd.elements import FAMILIES
from fenics_ehd.errors import SettingsError
from fenics_ehd.reduction import PRESSURE_SETS, SELECTIONS
from fenics_ehd.scenes import part_settings
from fenics_ehd.scenes.loaded_journal_settings import LoadedJournalSettings
from fenics_ehd.scenes.rotor_settings import RotorSettings
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings
from fenics_ehd.scenes.thin_film import check_thin_film
from fenics_ehd.settings import build, read_toml, to_toml, unusual


def test_printed_defaults_read_back_as_the_defaults():
    assert build(SliderCrankSettings, tomllib.loads(to_toml(SliderCrankSettings()))) == (
        SliderCrankSettings()
    )


@given(
    clearance=st.floats(1e-9, 1e-3),
    modes=st.integers(0, 500),
    geometry=st.dictionaries(st.sampled_from(["big_end_wall", "pin_radius"]), st.floats(0, 1)),
)
def test_printed_settings_read_back_to_twelve_digits(clearance, modes, geometry):
    tables = {
        "bearing": {"clearance": clearance},
        "reduction": {"residual_modes": modes},
        "rod": {"geometry": geometry},
    }
    settings = build(SliderCrankSettings, tables)
    again = build(SliderCrankSettings, tomllib.loads(to_toml(settings)))
    assert again.bearing.clearance == pytest.approx(clearance, rel=1e-11)
    assert again.reduction.residual_modes == modes
    assert again.rod.geometry == pytest.approx(geometry, rel=1e-11)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"mechanism": {"crank_lenght": 0.05}}, "did you mean mechanism.crank_length"),
        ({"mechanics": {}}, "unknown key mechanics"),
        ({"mechanism": {"crank_speed": -1}}, "mechanism.crank_speed = -1.0 must be above 0"),
        ({"bearing": {"clearance": "17 um"}}, "bearing.clearance = '17 um' must be a finite"),
        ({"bearing": {"clearance": float("nan")}}, "bearing.clearance = nan must be a finite"),
        ({"bearing": {"viscosity": True}}, "bearing.viscosity = True must be a finite number"),
        ({"rod": {"poissons_ratio": 0.5}}, "rod.poissons_ratio = 0.5 must be below 0.49"),
        ({"rod": {"element": "cubic"}}, "rod.element = 'cubic' must be one of serendipity"),
        ({"rod": 3}, "rod = 3 must be a table"),
        (
            {"rod": {"geometry": {"pin_radius": "a"}}},
            "rod.geometry.pin_radius = 'a' must be a finite",
        ),
        ({"rod": {"geometry": {"a": float("inf")}}}, "rod.geometry.a = inf must be a finite"),
        ({"rod": {"geometry": 1}}, "rod.geometry = 1 must be a table"),
        ({"reduction": {"residual_modes": 3.5}}, "reduction.residual_modes = 3.5 must be a whole"),
        ({"reduction": {"estimate_error": 1}}, "reduction.estimate_error = 1 must be true or"),
        ({"time": {"order": 6}}, "time.order = 6 must be a whole number, at least 1 and at most 3"),
        (
            {"bearing": {"clearance": "30 um"}},
            "bearing.clearance = '30 um' must be a finite number in m, without unit or quotes",
        ),
        ({"bearing": {"clearance": 30}}, "clearance = 30.0 must be below 0.005: in m, 30e-6 for"),
        ({"mechanism": {"crank_length": 48}}, "mechanism.crank_length = 48.0 must be below 5: in"),
        ({"mechanism": {"clearance": 30e-6}}, "did you mean bearing.clearance?"),
        ({"clearance": 30e-6}, "unknown key clearance: did you mean bearing.clearance?"),
        ({"bearing": {"frobnicate": 1}}, "known: bearing.clearance, bearing.viscosity"),
        ({"film": {"cells": [3, 1]}}, "film.cells = [3, 1] must be at least [8, 2]"),
        ({"film": {"cells": [8, 1]}}, "film.cells = [8, 1] must be at least [8, 2]"),
        ({"film": {"cells": [20]}}, "film.cells = [20] must be two whole numbers above 0, or em"),
        ({"film": {"cells": [20, -5]}}, "film.cells = [20, -5] must be two whole numbers"),
        (
            {"film": {"cells": [1000, 1000]}},
            "film.cells = [1000, 1000]: 1000000 cells, at most 200000 are allowed",
        ),
        ({"scene": "rotor"}, "scene = 'rotor' must be one of slider-crank"),
        ({"rod": {"density": 7.85}}, "rod.density = 7.85 must be at least 100: in kg/m3, 7850 for"),
        ({"rod": {"density": 7.85e6}}, "rod.density = 7850000.0 must be below 100000: in kg/m3"),
        ({"rod": {"youngs_modulus": 210}}, "210.0 must be at least 1e+06: in Pa, 210e9 for 210"),
        ({"rod": {"youngs_modulus": 210e3}}, "210000.0 must be at least 1e+06: in Pa, 210e9 for"),
        ({"bearing": {"viscosity": 1e308}}, "bearing.viscosity = 1e+308 must be below 1e+06: in"),
        (
            {"mechanism": {"revolutions": 1e308}},
            "= 1e+308 must be 0 or from 1e-30 to 1e+30 in size",
        ),
        ({"start": {"velocity_x": -1e40}}, "= -1e+40 must be 0 or from 1e-30 to 1e+30 in size"),
        ({"mechanism": {"crank_speed": 1e-308}}, "= 1e-308 must be 0 or from 1e-30 to 1e+30 in"),
        ({"mechanism": {"gas_force": "a\0b.csv"}}, "mechanism.gas_force = 'a\\x00b.csv' must be"),
    ],
)
def test_bad_value_is_named_with_its_limit(tables, message):
    with pytest.raises(SettingsError) as caught:
        build(SliderCrankSettings, tables)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_numbers_that_are_perhaps_in_another_unit_are_named():
    assert [unusual(kind()) for kind in (SliderCrankSettings, RotorSettings)] == [[], []]
    assert unusual(LoadedJournalSettings()) == []
    # Nothing moves backwards or weighs too little by a zero or a sign.
    still = {"bearing": {"shaft_speed": -300, "bore_speed": 0}}
    assert unusual(build(LoadedJournalSettings, still)) == []
    tables = {
        "mechanism": {"piston_mass": 500, "crank_speed": 3e4},
        "bearing": {"viscosity": 10},
        "rod": {"youngs_modulus": 210e12, "damping_time": 1},
    }
    assert unusual(build(SliderCrankSettings, tables)) == [
        "mechanism.crank_speed = 30000 is outside the usual 0.01 to 20000: in rad/s, 314 for 3000 "
        "rpm",
        "mechanism.piston_mass = 500 is outside the usual 0.0001 to 100: in kg, 0.5 for 500 g",
        "bearing.viscosity = 10 is outside the usual 1e-05 to 1: in Pa s, 0.01 for 10 mPa s",
        "rod.youngs_modulus = 2.1e+14 is outside the usual 1e+09 to 2e+12: in Pa, 210e9 for 210 "
        "GPa",
        "rod.damping_time = 1 is outside the usual 1e-12 to 0.1: in s, 1e-3 for 1 ms",
    ]


def test_limits_of_cells_are_inside():
    for cells in ([], [8, 2], [500, 400]):
        assert build(SliderCrankSettings, {"film": {"cells": cells}}).film.cells == tuple(cells)


@pytest.mark.parametrize(
    ("clearance", "radius", "message"),
    [
        (2e-3, 0.025, "clearance = 0.002 m must be below 0.05 of the bore radius 0.025 m: the"),
        (25e-6, 4.0, "2.5e-05 m must be at least 1e-05 of the bore radius 4 m: lengths are in me"),
    ],
)
def test_clearance_is_a_small_part_of_the_radius_and_not_none_of_it(clearance, radius, message):
    with pytest.raises(SettingsError) as caught:
        check_thin_film(clearance, radius)
    assert message in str(caught.value)
    check_thin_film(25e-6, 0.025)
    check_thin_film(0.0225e-5, 0.0225)


def test_choices_are_those_of_the_reduction_and_the_elements():
    assert set(part_settings.ELEMENTS) == set(FAMILIES)
    assert set(part_settings.PRESSURE_SETS) == set(PRESSURE_SETS)
    assert set(part_settings.SELECTIONS) == set(SELECTIONS)


def test_broken_toml_is_named(tmp_path):
    path = tmp_path / "broken.toml"
    path.write_text("mechanism = [")
    with pytest.raises(SettingsError, match=r"broken\.toml"):
        read_toml(path)
    with pytest.raises(SettingsError, match="No such file"):
        read_toml(tmp_path / "absent.toml")


LONG = "more than 300 characters"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (".".join(["a"] * 50_000) + " = 1", LONG),
        ("[" + " . ".join(["'a.a'"] * 50_000) + "]", LONG),
        ("a = {b = 1, " + ".".join(["a"] * 50_000) + " = 1}", LONG),
        ("a = " + 5000 * "9", LONG),
        ("a = [1, 0x" + 5000 * "f" + "]", LONG),
        ("a = " + 5000 * "[", "scene.toml: "),
        ("\xff", "scene.toml: 'utf-8' codec can't decode"),
    ],
)
def test_text_that_no_scene_has_is_refused(text, message, tmp_path):
    (tmp_path / "scene.toml").write_text(text, encoding="latin-1")
    with pytest.raises(SettingsError) as caught:
        read_toml(tmp_path / "scene.toml")
    assert message in str(caught.value)
    assert len(str(caught.value)) < 300 + len(str(tmp_path))


def test_long_quotations_and_comments_are_read(tmp_path):
    """And the mark that other systems put before UTF-8."""
    text = f"# {500 * 'don’t. '}\na.b = '{500 * 'a.'}'  # {500 * 'a.'}\nc = [1.5, 2.5]\n"
    (tmp_path / "scene.toml").write_text(text, encoding="utf-8-sig")
    assert read_toml(tmp_path / "scene.toml") == {"a": {"b": 500 * "a."}, "c": [1.5, 2.5]}


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir, lambda path: path.symlink_to("/dev/zero")])
def test_scene_that_is_no_file_is_not_waited_for(make, tmp_path):
    make(tmp_path / "scene.toml")
    with pytest.raises(SettingsError, match="a folder, pipe or device, not a file"):
        read_toml(tmp_path / "scene.toml")
