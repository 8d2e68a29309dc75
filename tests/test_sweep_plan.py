"""Values and keys of a sweep as written, and the cases that follow from them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweep_cases import LOADED_JOURNAL, write_scene

import fenics_ehd as ehd
from fenics_ehd.scenes.scene import as_stored
from fenics_ehd.study.cases import MOST_CASES, parse_quantities, parse_values, resolve_key
from fenics_ehd.study.sweep import make_sweep


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return write_scene(tmp_path_factory.mktemp("scene"))


@given(st.floats(1e-9, 1e9), st.floats(1e-9, 1e9), st.integers(2, 60), st.booleans(), st.booleans())
def test_range_has_its_ends_and_equal_distances_or_ratios(first, last, count, log, below):
    if abs(first / last - 1) < 1e-6:
        return
    if below and not log:
        first = -first
    written = f"{first!r}:{last!r}:{count}{':log' if log else ''}"
    values = parse_values("key", written, 0.0)
    assert len(values) == count
    assert (values[0], values[-1]) == (first, last)
    # Numbers between the ends have the twelve digits of a scene file.
    found = np.log(values) if log else np.array(values)
    slack = 1e-11 * (1.0 if log else max(abs(first), abs(last)))
    np.testing.assert_allclose(found, np.linspace(found[0], found[-1], count), rtol=0, atol=slack)


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
    with pytest.raises(ehd.errors.SettingsError) as error:
        parse_values("section.key", text, like)
    assert str(error.value).startswith("section.key = ")
    assert named in str(error.value)


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("clearance", "joints.big_end.clearance"),
        ("big_end.clearance", "joints.big_end.clearance"),
        ("joints.big_end.clearance", "joints.big_end.clearance"),
        ("oil.viscosity", "lubricants.oil.viscosity"),
        ("reduction.method", "bodies.rod.reduction.method"),
        ("tolerance", "time.tolerance"),
        ("big_end_wall", "bodies.rod.geometry.big_end_wall"),
        ("rod.geometry.pin_wall", "bodies.rod.geometry.pin_wall"),
        ("points.pin", "bodies.crank.points.pin"),
    ],
)
def test_key_or_the_end_of_it(name, key):
    assert resolve_key(as_stored("slider-crank-paper"), name) == key


@pytest.mark.parametrize(
    ("name", "named"),
    [
        ("clearence", "unknown key clearence: did you mean joints.big_end.clearance?"),
        ("joints.big_end.clearence", "did you mean joints.big_end.clearance?"),
        ("time.clearance", "unknown key time.clearance: did you mean joints.big_end.clearance?"),
        ("big_ent.clearance", "did you mean joints.big_end.clearance?"),
        ("viscosity", "ambiguous: joints.big_end.viscosity or lubricants.oil.viscosity"),
        ("frobnicate", "known: bodies.crank.position"),
        ("kind", "unknown key kind"),
        ("rod.geometry", "bodies.rod.geometry.NAME"),
        ("rod.geometry.", "unknown key"),
        ("", "unknown key"),
    ],
)
def test_key_that_is_none_is_named(name, named):
    with pytest.raises(ehd.errors.SettingsError) as error:
        resolve_key(as_stored("slider-crank-paper"), name)
    assert named in str(error.value)


def test_cases_are_the_product_in_order(scene):
    sweep = make_sweep(scene, ["clearance=10e-6:30e-6:5", "oil.viscosity=0.005,0.01,0.02"])
    assert sweep.keys == ("joints.big_end.clearance", "lubricants.oil.viscosity")
    assert sweep.joints == ("big_end",)
    assert [case.name for case in sweep.cases] == [f"{number:04d}" for number in range(1, 16)]
    assert sweep.cases[3].values == (1.5e-5, 0.005)
    assert sweep.cases[3].scene.joints["big_end"].clearance == 1.5e-5
    assert sweep.cases[3].scene.time.revolutions == 0.002
    assert len({case.bodies["rod"].name for case in sweep.cases}) == 1


@pytest.mark.parametrize(
    ("assignment", "bodies", "parts"),
    [
        ("youngs_modulus=200e9,210e9", 2, 2),
        # Bilinear films load 9-node bores.
        ("big_end.element=lagrange,serendipity,bilinear", 2, 2),
        ("method=rigid,m3", 2, 1),
        ("estimate_error=true,false", 2, 1),
        ("big_end.cells=[20,5];[40,10]", 1, 1),
        ("damping_time=0,1e-3", 1, 1),
    ],
)
def test_one_body_for_equal_bodies_of_one_part(scene, assignment, bodies, parts):
    found = [case.bodies["rod"] for case in make_sweep(scene, [assignment]).cases]
    assert len({body.name for body in found}) == bodies
    assert len({body.part for body in found}) == parts


def test_keys_without_effect_are_refused(scene):
    with pytest.raises(
        ehd.errors.SettingsError, match=r"2 of 2 .*residual_modes = 10 has no effect without"
    ):
        make_sweep(scene, ["residual_modes=10,20"])  # of M3 only, and the scene's method is another


def test_files_given_as_values_are_those_of_the_working_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other.csv").write_text("time_s,Fx_N,Fy_N\n0,0,1\n0.01,0,2\n0.02,0,1\n")
    elsewhere = tmp_path / "scenes"
    elsewhere.mkdir()
    sweep = make_sweep(write_scene(elsewhere, LOADED_JOURNAL), ["load.file=other.csv"])
    assert sweep.cases[0].scene.forces["load"].file == str(tmp_path / "other.csv")
    assert sweep.identity["forces.load.file"].startswith("other.csv ")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("500", (500.0,)),
        ("30 rpm, 60 rpm", (np.pi, 2 * np.pi)),
        ("60rpm:300rpm:3", (2 * np.pi, 6 * np.pi, 10 * np.pi)),
        ("1:100:3:log", (1.0, 10.0, 100.0)),
    ],
)
def test_values_of_an_option_may_have_units(text, expected):
    np.testing.assert_allclose(parse_quantities("--speeds", text, "rad/s"), expected, rtol=1e-11)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fast", "--speeds = 'fast' must be"),
        ("1 m", "--speeds = '1 m' must be .*m is a unit of another quantity"),
        ("1,,2", "a value is missing"),
        ("300,301rpm", "--speeds = '300,301rpm': only some values have a unit"),
        ("1000:10000rpm:4", "only some values have a unit"),
        ("1,1", "--speeds = 1: the value is given twice"),
        ("1rpm:2rpm", "must be first:last:count"),
        ("1rpm:nan:3", "must be"),
        ("-1:5:3:log", "above 0 for log"),
    ],
)
def test_values_of_an_option_that_cannot_be_used_are_refused(text, message):
    with pytest.raises(ehd.errors.SettingsError, match=message):
        parse_quantities("--speeds", text, "rad/s")


def test_ranges_with_units_are_values_with_units():
    assert parse_values("clearance", "20um:30um:3", 1e-5) == ("20.0 um", "25.0 um", "30.0 um")
    with pytest.raises(ehd.errors.SettingsError, match="give first and last the same unit"):
        parse_values("clearance", "20um:30mm:3", 1e-5)
    with pytest.raises(ehd.errors.SettingsError, match="count = 0 must be a whole number from 2"):
        parse_values("clearance", "20um:30um:0", 1e-5)
    with pytest.raises(ehd.errors.SettingsError, match="only some values have a unit"):
        parse_values("clearance", "20um:30um:3, 4e-5", 1e-5)
