"""Settings: every bad value is one line that names it."""

import os
import tomllib

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scene_cases import tables_of

import fenics_ehd as ehd
from fenics_ehd.base import units
from fenics_ehd.base.fields import require_thin_film
from fenics_ehd.base.settings import read_toml
from fenics_ehd.fem.elements import FAMILIES
from fenics_ehd.reduction import PRESSURE_SETS, SELECTIONS
from fenics_ehd.scenes import part_settings
from fenics_ehd.scenes.library import shipped_names
from fenics_ehd.scenes.scene import scene_of, scene_text

PAPER = "slider-crank-paper"


@pytest.mark.parametrize("name", shipped_names())
def test_the_text_of_a_shipped_scene_reads_back_as_the_scene(name):
    scene = ehd.read_scene(name)
    again = scene_of(tomllib.loads(scene_text(scene)), name)
    assert scene_text(again) == scene_text(scene)
    for table in ("bodies", "joints", "drives", "lubricants", "time", "output"):
        assert getattr(again, table) == getattr(scene, table)


AT = "joints.bearing"


@pytest.mark.parametrize(
    "changes",
    [
        {
            f"{AT}.supply.inlet": {
                "kind": "hole", "on": "journal", "angle": 90, "diameter": 6e-3, "pressure": 3e5
            },
            f"{AT}.supply.groove": {"kind": "axial-groove", "length": 5e-3, "extent": 30.0},
        },
        {
            "lubricants.oil": {
                "grade": "5w-30", "temperature": 110.0, "barus": 1e-8, "cross_rate": 2e6
            }
        },
        {
            "lubricants.oil": {"grade": "ISO VG 46"},
            f"{AT}.heat": {"supply_temperature": 70.0, "conducted_share": 0.2},
        },
    ],
)  # fmt: skip
def test_the_text_keeps_what_no_shipped_scene_lists(changes):
    plain = scene_of(tables_of("loaded-journal", {}), "plain")
    assert plain.joints["bearing"].supply == {}
    assert plain.joints["bearing"].heat is None
    scene = scene_of(tables_of("loaded-journal", changes), "case")
    again = scene_of(tomllib.loads(scene_text(scene)), "case")
    assert (again.joints, again.lubricants) == (scene.joints, scene.lubricants)


@given(
    clearance=st.floats(1e-9, 1e-3),
    modes=st.integers(0, 500),
    geometry=st.dictionaries(st.sampled_from(["big_end_wall", "pin_radius"]), st.floats(0, 1)),
)
def test_printed_settings_read_back_to_twelve_digits(clearance, modes, geometry):
    changes = {
        "joints.big_end.clearance": clearance,
        "bodies.rod.reduction.residual_modes": modes,
        "bodies.rod.geometry": geometry,
    }
    scene = scene_of(tables_of(PAPER, changes), "case")
    again = scene_of(tomllib.loads(scene_text(scene)), "case")
    assert again.joints["big_end"].clearance == pytest.approx(clearance, rel=1e-11)
    assert again.bodies["rod"].reduction.residual_modes == modes
    assert again.bodies["rod"].geometry == pytest.approx(geometry, rel=1e-11)


TEXT = st.text(
    st.characters(blacklist_categories=["Cs"], blacklist_characters="\0"), min_size=1, max_size=20
)
NAME = st.text(st.characters(whitelist_categories=["L", "Nd"]), min_size=1)


@given(body=NAME, point=TEXT, hole=NAME, folder=TEXT)
@example(body="größe", point="hook left", hole="öl", folder="\U0001f600 \\u")
@example(body="a", point='a "b" = [x] # \x7f\r\n', hole="b", folder="'")
def test_names_that_need_quotes_read_back(body, point, hole, folder):
    tables = tables_of("four-bar", {})
    tables["bodies"][body] = tables["bodies"].pop("rocker") | {"points": {point: [0.12, 0.0]}}
    tables["joints"]["rocker_end"] |= {
        "journal": f"{body}.{point}",
        "supply": {hole: {"kind": "circumferential-groove", "width": 1e-3, "table": folder}},
    }
    tables["joints"]["right"]["between"] = ["ground.hook", body]
    found = scene_of(tables, "case")
    again = scene_of(tomllib.loads(scene_text(found)), "case")
    for table in ("bodies", "joints"):
        assert getattr(again, table) == getattr(found, table)


def test_a_name_that_is_no_text_is_one_line():
    scene = scene_of(tables_of(PAPER, {"bodies.rod.model": "\udcff/rod.geo"}), "case")
    with pytest.raises(ehd.errors.SettingsError, match=r"'.udcff/rod.geo' is not in UTF-8"):
        scene_text(scene)


def rod(**changes):
    return {f"bodies.rod.{key}": value for key, value in changes.items()}


def film(**changes):
    return {f"joints.big_end.{key}": value for key, value in changes.items()}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time.lagrest_step": 0.05}, "did you mean time.largest_step"),
        ({"mechanics": {}}, "unknown table [mechanics]"),
        ({"bodies.crank.mass": -1}, "bodies.crank.mass = -1.0 must be at least 0"),
        (film(clearance=float("nan")), "joints.big_end.clearance = nan must be a finite"),
        ({"lubricants.oil.viscosity": True}, "viscosity = true must be a finite number"),
        (rod(**{"material.poissons_ratio": 0.5}), "poissons_ratio = 0.5 must be below 0.49"),
        (rod(element="cubic"), "bodies.rod.element = 'cubic' must be one of serendipity"),
        (rod(material=3), "bodies.rod.material = 3 must be a table"),
        (rod(points="pin"), "bodies.rod.points = 'pin' must be a list of names"),
        (rod(points=[""]), "bodies.rod.points = [''] must be a list of names"),
        ({"bodies.crank.points": 3}, "bodies.crank.points = 3 must be a table"),
        ({"bodies.crank.points.pin": [1.0]}, "points.pin = [1] must be two finite numbers [x, y]"),
        ({"bodies.crank.points.pin": ["a", 0]}, "points.pin = ['a', 0] must be two finite numbers"),
        ({"bodies.crank.centre": [1e6, 0]}, "bodies.crank.centre = [1e+06, 0] must be two"),
        ({"joints.main.between": ["crank"]}, "between = ['crank'] must be a list of 2 names"),
        ({"joints.main.between": "crank"}, "between = 'crank' must be a list of 2 names"),
        (rod(**{"geometry.pin_radius": "a"}), "geometry.pin_radius = 'a' must be a finite"),
        (rod(**{"geometry.a": float("inf")}), "bodies.rod.geometry.a = inf must be a finite"),
        (rod(geometry=1), "bodies.rod.geometry = 1 must be a table"),
        (rod(**{"reduction.residual_modes": 3.5}), "residual_modes = 3.5 must be a whole"),
        (rod(**{"reduction.estimate_error": 1}), "estimate_error = 1 must be true or"),
        ({"time.order": 6}, "time.order = 6 must be a whole number, at least 1 and at most 3"),
        (film(clearance=30), "clearance = 30.0 must be below 0.005: in m, 30e-6 for"),
        (rod(disks=[]), "unknown key bodies.rod.disks of kind 'flexible': a key of kind shaft"),
        (film(frobnicate=1), "unknown key joints.big_end.frobnicate of kind 'lubricated': known"),
        (film(cells=[3, 1]), "joints.big_end.cells = [3, 1] must be at least [8, 2]"),
        (film(cells=[8, 1]), "joints.big_end.cells = [8, 1] must be at least [8, 2]"),
        (film(cells=[20]), "joints.big_end.cells = [20] must be two whole numbers above 0, or em"),
        (film(cells=[20, -5]), "joints.big_end.cells = [20, -5] must be two whole numbers"),
        (film(cells="10 mm"), "joints.big_end.cells = ['10 mm'] must be two whole numbers"),
        (film(cells=["10 mm", 5]), "cells = ['10 mm', 5] must be two whole numbers above 0"),
        (rod(**{"geometry.bore_cells_around": "20 m"}), "= '20 m' must be a number of cells, with"),
        (rod(**{"geometry.big_end_layers": "2"}), "= '2' must be a number of cells, without a un"),
        (film(clearance="1_7 um"), "clearance = '1_7 um' must be a number in m: '_7 um' is no"),
        (
            film(clearance="١٧ um"),
            "clearance = '١٧ um' must be a finite number in m, or a number with",
        ),
        ({"time.order": "2 mm"}, "time.order = '2 mm' must be a whole number, at least 1"),
        (film(cells=[1000, 1000]), "cells = [1000, 1000]: 1000000 cells are above the limit"),
        (rod(**{"material.density": 7.85}), "density = 7.85 must be at least 100: in kg/m3, 7850"),
        (rod(**{"material.density": 7.85e6}), "density = 7850000.0 must be below 100000: in kg/m"),
        (rod(**{"material.youngs_modulus": 210}), "210.0 must be at least 1e+06: in Pa, 210e9 for"),
        (rod(**{"material.youngs_modulus": 210e3}), "210000.0 must be at least 1e+06: in Pa"),
        ({"lubricants.oil.viscosity": 1e308}, "viscosity = 1e+308 must be below 1e+06: in"),
        ({"time.revolutions": 1e308}, "= 1e+308 must be 0 or from 1e-30 to 1e+30 in magnitude"),
        (film(eccentricity_rate=[-1e40, 0.0]), "eccentricity_rate = [-1e+40, 0] must be two fin"),
        ({"drives.crank.speed": 1e-308}, "= 1e-308 must be 0 or from 1e-30 to 1e+30 in"),
        ({"drives.crank.table": "a\0b.csv"}, "drives.crank.table = 'a\\x00b.csv' must be"),
    ],
)
def test_bad_value_is_named_with_its_limit(changes, message):
    with pytest.raises(ehd.errors.SettingsError) as caught:
        scene_of(tables_of(PAPER, changes), "case")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_numbers_that_are_perhaps_in_another_unit_are_named():
    assert {name: ehd.read_scene(name).warnings for name in shipped_names()} == dict.fromkeys(
        shipped_names(), ()
    )
    # Nothing moves backwards or weighs too little by a zero or a sign.
    still = tables_of("loaded-journal", {"drives.journal.speed": -300.0, "time.revolutions": 2.0})
    assert scene_of(still, "still").warnings == ()
    changes = {
        "bodies.piston.mass": 500.0,
        "drives.crank.speed": 3e4,
        "lubricants.oil.viscosity": 10.0,
        "bodies.rod.material.youngs_modulus": 210e12,
        "bodies.rod.damping_time": 1.0,
        "joints.big_end.supply.inlet": {"kind": "hole", "pressure": 3.0},
    }
    assert set(scene_of(tables_of(PAPER, changes), "case").warnings) == {
        "drives.crank.speed = 30000 is outside the usual 0.01 to 20000: in rad/s, 314 for 3000 rpm",
        "bodies.piston.mass = 500 is outside the usual 0.0001 to 100: in kg, 0.5 for 500 g",
        "lubricants.oil.viscosity = 10 is outside the usual 1e-05 to 1: in Pa s, 0.01 for 10 mPa s",
        "bodies.rod.material.youngs_modulus = 2.1e+14 is outside the usual 1e+09 to 2e+12: in Pa, "
        "210e9 for 210 GPa",
        "bodies.rod.damping_time = 1 is outside the usual 1e-12 to 0.1: in s, 1e-3 for 1 ms",
        "joints.big_end.supply.inlet.pressure = 3 is outside the usual 1000 to 1e+09: in Pa, 3e5 "
        "for 3 bar",
    }


@pytest.mark.parametrize("text", ["1_0", "\u0661\u0660", "1e1_0", "0x10", "1d1", "--1", "", "nan"])
def test_only_plain_digits_are_a_number(text, tmp_path):
    with pytest.raises(ValueError, match="is no number"):
        units.parse_number(text)
    table = tmp_path / "load.csv"
    table.write_text(f"time_s,Fx_N,Fy_N\n0,500,900\n5e-3,{text},500\n10e-3,-5,9\n20e-3,500,900\n")
    with pytest.raises(ehd.errors.SettingsError, match=r"Fx_N = .* must be a finite number"):
        ehd.read_load(table)
    for written in ("1.5", " 2. ", "+.5e-3", "7E+2"):
        assert units.parse_number(written) == float(written)


def test_limits_of_cells_are_inside():
    for cells in ([], [8, 2], [500, 400]):
        scene = scene_of(tables_of(PAPER, film(cells=cells)), "case")
        assert scene.joints["big_end"].cells == tuple(cells)


def test_a_clearance_at_its_limit_is_one_but_for_rounding():
    require_thin_film(0.0225e-5, 0.0225, "clearance")


def test_choices_are_those_of_the_reduction_and_the_elements():
    assert set(part_settings.ELEMENTS) == set(FAMILIES)
    assert set(part_settings.PRESSURE_SETS) == set(PRESSURE_SETS)
    assert set(part_settings.SELECTIONS) == set(SELECTIONS)


def test_broken_toml_is_named(tmp_path):
    path = tmp_path / "broken.toml"
    path.write_text("mechanism = [")
    with pytest.raises(ehd.errors.SettingsError, match=r"broken\.toml"):
        read_toml(path)
    with pytest.raises(ehd.errors.SettingsError, match="No such file"):
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
    with pytest.raises(ehd.errors.SettingsError) as caught:
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
    with pytest.raises(ehd.errors.SettingsError, match="a folder, pipe or device, not a file"):
        read_toml(tmp_path / "scene.toml")
