"""Values and keys of a sweep as written, and the cases that follow from them."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweep_cases import exit_of, given_values, write_scene

from fenics_ehd.errors import SettingsError
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings
from fenics_ehd.sweeps.keys import resolve_key
from fenics_ehd.sweeps.plan import make_plan
from fenics_ehd.sweeps.values import MOST_CASES, parse_values

NUMBERS = st.floats(1e-6, 1e6) | st.floats(-1e6, -1e-6)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return write_scene(tmp_path_factory.mktemp("scene"))


@given(
    NUMBERS,
    NUMBERS,
    st.integers(2, 60),
)
def test_range_has_its_ends_and_equal_distances(first, last, count):
    if abs(first - last) < 1e-6 * max(abs(first), abs(last)):
        return
    values = parse_values("key", f"{first!r}:{last!r}:{count}", 0.0)
    assert len(values) == count
    assert (values[0], values[-1]) == (first, last)
    step = (last - first) / (count - 1)
    scale = max(abs(first), abs(last))
    for i, value in enumerate(values):
        assert value == pytest.approx(first + i * step, abs=1e-15 * scale * count)


@given(st.floats(1e-9, 1e9), st.floats(1e-9, 1e9), st.integers(2, 60))
def test_logarithmic_range_has_its_ends_and_equal_ratios(first, last, count):
    if abs(first / last - 1) < 1e-6:
        return
    values = parse_values("key", f"{first!r}:{last!r}:{count}:log", 0.0)
    assert len(values) == count
    assert (values[0], values[-1]) == (first, last)
    for i, value in enumerate(values):
        logarithm = math.log(first) + i / (count - 1) * math.log(last / first)
        assert math.log(value) == pytest.approx(logarithm, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "like", "values"),
    [
        ("10e-6:30e-6:5", 1.0, (1e-5, 1.5e-5, 2e-5, 2.5e-5, 3e-5)),
        ("0.001:1:4:log", 1.0, (0.001, 0.01, 0.1, 1.0)),
        ("0.005, 0.01,1:2:3", 1.0, (0.005, 0.01, 1.0, 1.5, 2.0)),
        ("2:10:5", 1, (2, 4, 6, 8, 10)),
        ("1:2:3", 1, (1, 1.5, 2)),
        ("m1,m3,m4", "m3", ("m1", "m3", "m4")),
        ("true,False", True, (True, False)),
        ("[20,5];[40,10];[]", (), ([20, 5], [40, 10], [])),
    ],
)
def test_values_as_written(text, like, values):
    found = parse_values("key", text, like)
    assert found == values
    assert list(map(type, found)) == list(map(type, values))


@pytest.mark.parametrize(
    ("text", "like", "named"),
    [
        ("1:2", 1.0, "first:last:count"),
        ("1:2:3:lin", 1.0, "first:last:count:log"),
        ("1:2:1", 1.0, "count = 1 must be a whole number from 2"),
        (f"1:2:{MOST_CASES + 1}", 1.0, f"count = {MOST_CASES + 1}"),
        ("1:2:2.5", 1.0, "count = 2.5"),
        ("0:2:3:log", 1.0, "above 0 for log"),
        ("a:2:3", 1.0, "finite numbers"),
        ("1:inf:3", 1.0, "finite numbers"),
        ("1,,2", 1.0, "a value is missing"),
        ("", "m3", "a value is missing"),
        ("1,1.0", 1.0, "twice"),
        ("1:1:3", 1.0, "twice"),
        ("20,5", (), "must be a list"),
    ],
)
def test_malformed_values_are_named(text, like, named):
    with pytest.raises(SettingsError) as error:
        parse_values("section.key", text, like)
    assert str(error.value).startswith("section.key = ")
    assert named in str(error.value)


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("clearance", "bearing.clearance"),
        ("bearing.clearance", "bearing.clearance"),
        ("film.cells", "film.cells"),
        ("rod.geometry.big_end_wall", "rod.geometry.big_end_wall"),
    ],
)
def test_key_with_or_without_its_section(name, key):
    assert resolve_key(SliderCrankSettings, name) == key


@pytest.mark.parametrize(
    ("name", "named"),
    [
        ("clearence", "unknown key clearence: did you mean bearing.clearance?"),
        ("bearing.clearence", "did you mean bearing.clearance?"),
        ("film.clearance", "unknown key film.clearance: did you mean bearing.clearance?"),
        ("brearing.clearance", "did you mean bearing.clearance?"),
        ("cells", "key cells is ambiguous: rod.cells or film.cells"),
        ("frobnicate", "known: mechanism.crank_length"),
        ("scene", "unknown key scene"),
        ("rod.geometry", "rod.geometry.NAME"),
        ("rod.geometry.", "unknown key"),
    ],
)
def test_key_that_is_none_is_named(name, named):
    with pytest.raises(SettingsError) as error:
        resolve_key(SliderCrankSettings, name)
    assert named in str(error.value)


def test_cases_are_the_product_in_order(scene):
    plan = make_plan(scene, ["clearance=10e-6:30e-6:5", "viscosity=0.005,0.01,0.02"])
    assert plan.keys == ("bearing.clearance", "bearing.viscosity")
    assert [case.number for case in plan.cases] == list(range(1, 16))
    assert plan.cases[3].values == (1.5e-5, 0.005)
    assert plan.cases[3].settings.bearing.clearance == 1.5e-5
    assert plan.cases[3].settings.mechanism.revolutions == 0.002
    assert len({case.body for case in plan.cases}) == 1


@pytest.mark.parametrize(
    ("assignment", "bodies"),
    [
        ("youngs_modulus=200e9,210e9", 2),
        ("film.element=lagrange,serendipity,bilinear", 2),  # bilinear films load 9-node bores
        ("method=rigid,m3", 2),
        ("residual_modes=10,20", 1),  # of M3 only, and the scene's method is another
        ("film.cells=[20,5];[40,10]", 1),
        ("damping_time=0,1e-3", 1),
    ],
)
def test_one_body_for_equal_bodies(scene, assignment, bodies):
    assert len({case.body for case in make_plan(scene, [assignment]).cases}) == bodies


def test_every_bad_value_is_named_before_anything_runs(scene, tmp_path, capfd):
    values = given_values(["clearance=-1,0", "viscosity=0.01,water", "film.cells=[4];[8,2]"])
    status, _, errors = exit_of(capfd, "sweep", scene, *values, "-o", tmp_path / "out")
    assert status == 2
    line = errors.splitlines()[-1]
    for named in (
        "SettingsError: 8 of 8 cases cannot run",
        "bearing.clearance = -1.0 must be above 0",
        "bearing.clearance = 0.0 must be above 0",
        "bearing.viscosity = 'water' must be a finite number",
        "film.cells = [4] must be two whole numbers",
    ):
        assert named in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["absent.toml", "--set", "clearance=1e-5"], "absent.toml"),
        (["crank-slider", "--set", "clearance=1e-5"], "crank-slider"),
        (["slider-crank"], "--set"),
        (["slider-crank", "--set", "clearance"], "key=values"),
        (["slider-crank", "--set", "clearance=1", "--set", "bearing.clearance=2"], "given twice"),
        (["slider-crank", "--set", "rod.model=absent.geo"], "absent.geo"),
        (["slider-crank", "--set", f"rod.model={__file__}"], "must be a .geo model or a .msh file"),
        (["slider-crank", "--set", "viscosity=1:2:9999", "--set", "order=1,2"], "19998 cases"),
        (["slider-crank", "--set", "clearance=10:20:3"], "3 of 3 cases cannot run: bearing.clear"),
        (["slider-crank", "--set", "film.cells=[1000,1000]"], "1000000 cells, at most 200000"),
        (["slider-crank", "--set", "order=1", "--resume"], "nothing to resume"),
        (["slider-crank", "--set", "order=1", "--resume", "--overwrite"], "exclude each other"),
    ],
)
def test_bad_command_exits_2_with_its_name(arguments, named, tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, _, errors = exit_of(capfd, "sweep", *arguments)
    assert status == 2, errors
    assert "Traceback" not in errors
    assert named in errors.splitlines()[-1]
