"""Settings: every bad value is one line that names it."""

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fenics_ehd.elements import FAMILIES
from fenics_ehd.errors import SettingsError
from fenics_ehd.reduction import PRESSURE_SETS, SELECTIONS
from fenics_ehd.scenes import slider_crank_settings
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings
from fenics_ehd.settings import build, read_toml, to_toml


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
        ({"scene": "rotor"}, "scene = 'rotor' must be one of slider-crank"),
    ],
)
def test_bad_value_is_named_with_its_limit(tables, message):
    with pytest.raises(SettingsError) as caught:
        build(SliderCrankSettings, tables)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_choices_are_those_of_the_reduction_and_the_elements():
    assert set(slider_crank_settings.ELEMENTS) == set(FAMILIES)
    assert set(slider_crank_settings.PRESSURE_SETS) == set(PRESSURE_SETS)
    assert set(slider_crank_settings.SELECTIONS) == set(SELECTIONS)


def test_broken_toml_is_named(tmp_path):
    path = tmp_path / "broken.toml"
    path.write_text("mechanism = [")
    with pytest.raises(SettingsError, match=r"broken\.toml"):
        read_toml(path)
    with pytest.raises(SettingsError, match="No such file"):
        read_toml(tmp_path / "absent.toml")
