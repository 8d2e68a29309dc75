"""Settings and options that would have no effect are refused; defaults are accepted everywhere."""

import tomllib

import attrs
import pytest
from command_line import exit_of
from scene_cases import RIGID_ROD, tables_of, toml

import fenics_ehd as ehd
from fenics_ehd.scenes.library import shipped_names
from fenics_ehd.scenes.scene import changed, scene_of

CRANK, JOURNAL, PARTS = "slider-crank-paper", "loaded-journal", "rotor-two-bearings"
FILM, ROD, SHAPE = "joints.big_end", "bodies.rod", "joints.big_end.bore_shape"
M4 = {f"{ROD}.reduction.method": "m4"}
ROUGH = {f"{FILM}.contact.journal_roughness": 1e-6}
OF_A_FILE = {f"{ROD}.model": None, f"{ROD}.body": "rod.h5"}

#: What is given alone, and what it needs, or what it cannot have.
ALONE = [
    (CRANK, {f"{SHAPE}.lobes": 3}, f"without {SHAPE}.ovality"),
    (CRANK, {f"{SHAPE}.ovality_angle": 30.0}, f"without {SHAPE}.ovality"),
    (CRANK, {f"{FILM}.initial_filling": 0.5}, f"without {FILM}.cavitation = 'mass-conserving'"),
    (CRANK, {f"{FILM}.ambient": "oil"}, f"without {FILM}.cavitation = 'mass-conserving'"),
    (CRANK, {f"{FILM}.contact.flow_factors": False}, "without journal_roughness or bore_rough"),
    (CRANK, {f"{FILM}.contact.journal_modulus": 1e11}, "without journal_roughness or bore_rou"),
    (CRANK, ROUGH | {f"{FILM}.contact.bore_poissons_ratio": 0.2}, "without .*bore_modulus"),
    (CRANK, ROUGH | {f"{FILM}.contact.asperity_radius": 1e-5}, "without .*asperity_density"),
    (CRANK, M4 | {f"{ROD}.reduction.residual_modes": 20}, "without .*reduction.method = 'm3'"),
    (CRANK, M4 | {f"{ROD}.reduction.snapshots": "none there"}, "without .*method = 'm3'"),
    (CRANK, {f"{ROD}.reduction.modes": 20}, "without .*reduction.method = 'm1' or 'm2'"),
    (CRANK, {f"{ROD}.reduction.flexibility_tolerance": 1e-3}, "without .*method = 'm4'"),
    (CRANK, {f"{ROD}.cells": "tet", f"{ROD}.element": "lagrange"}, "without .*cells = 'hex'"),
    (CRANK, {f"{ROD}.clamped": "pin", f"{ROD}.mass": 1.0}, f"with {ROD}.clamped = 'pin'"),
    (CRANK, OF_A_FILE | {f"{ROD}.cells": "tet"}, f"with {ROD}.body = 'rod.h5'"),
    (CRANK, {"drives.crank.kind": "torque", "drives.crank.table": None,
             "bodies.crank.speed": 500.0}, "without drives.crank.damping"),
    (CRANK, {"bodies.crank.speed": 400.0}, "with drives.crank.kind = 'speed'"),
    (CRANK, {"time.period": 0.01}, "without time.periodic = true"),
    (CRANK, {"output.frames": 5}, "without output.paraview = true"),
    (CRANK, {"output.error_budget": False, "output.error_limit": 0.1}, "without output.error_b"),
    (CRANK, {"output.accuracy_keeps": ["tolerance"]}, "without output.accuracy"),
    (CRANK, {"lubricants.oil.temperature": 80.0}, "without a grade, or viscosity_40 and"),
    (CRANK, {"lubricants.oil.cross_exponent": 0.5}, "without lubricants.oil.cross_rate"),
    (CRANK, {"lubricants.oil.stiffening": 1e-9}, "without .*density_law = 'dowson-higginson'"),
    (CRANK, RIGID_ROD | {f"{FILM}.transfer": "mortar"}, "without a flexible bore"),
    (CRANK, RIGID_ROD | {f"{ROD}.mass": 0.0}, f"without {ROD}.mass"),
    (JOURNAL, {"time.end": 0.1}, "with time.periodic = true"),
    (JOURNAL, {"joints.bearing.supply.ring": {"kind": "circumferential-groove", "width": 2e-3,
               "angle": 30.0}}, "with a groove all around"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "changes", "message"), ALONE)
def test_what_is_given_without_its_need_is_refused(name, changes, message):
    with pytest.raises(ehd.errors.SettingsError, match=message) as caught:
        scene_of(tables_of(name, changes), "case")
    assert " has no effect w" in str(caught.value)
    assert "\n" not in str(caught.value)


def with_defaults(settings, table):
    """A table with every key that has a default, written out."""
    found = dict(table)
    for field in attrs.fields(type(settings)):
        about, default = field.metadata, field.default
        value = getattr(settings, field.name, None)
        if "section" in about and value is not None:
            found[field.name] = with_defaults(value, found.get(field.name, {}))
        elif about and not {"section", "table"} & set(about) and default is not attrs.NOTHING:
            found.setdefault(field.name, list(default) if type(default) is tuple else default)
    return found


@pytest.mark.parametrize("name", shipped_names())
def test_a_scene_that_lists_every_default_is_accepted(name):
    plain = ehd.read_scene(name)
    tables = tables_of(name, {})
    for table in ("bodies", "joints", "drives", "forces", "lubricants"):
        for entry, settings in getattr(plain, table).items():
            tables[table][entry] = with_defaults(settings, tables[table][entry])
    for table in ("time", "output"):
        tables[table] = with_defaults(getattr(plain, table), tables[table])
    listed = scene_of(tomllib.loads(toml(tables)), name)
    for table in ("bodies", "joints", "drives", "lubricants", "time", "output"):
        assert getattr(listed, table) == getattr(plain, table)


def classes(cls):
    """A settings class and all those below it."""
    yield cls
    for field in attrs.fields(cls):
        inner = [field.metadata["section"]] if "section" in field.metadata else []
        for other in [*inner, *field.metadata.get("kinds", {}).values()]:
            yield from classes(other)


def test_every_need_is_a_setting():
    known = {*classes(ehd.Scene), ehd.BearingSettings}
    names = {name for cls in known for name in (*dir(cls), *attrs.fields_dict(cls))}
    keys = [
        key
        for cls in known
        for field in attrs.fields(cls)
        for condition in field.metadata.get("needs", ())
        for key in condition.keys
    ]
    assert len(keys) > 50
    assert {word for key in keys for word in key.split(".")} <= names


#: Keys that every shipped scene lists, without effect once another of its keys is switched.
SWITCHED = [
    (CRANK, ROUGH | {f"{FILM}.smallest_film": 0.1}, f"{FILM}.smallest_film = 0.1 has no effect"),
    (CRANK, {"time.periodicity": 1e-3}, "time.periodicity = 0.001 has no effect without"),
    (CRANK, {"time.cycles": 5}, "time.cycles = 5 has no effect without time.periodic = true"),
]


@pytest.mark.parametrize(("name", "changes", "message"), SWITCHED)
def test_what_a_switch_leaves_without_effect_is_a_notice(name, changes, message):
    (line,) = scene_of(tables_of(name, changes), "case").warnings
    assert message in line
    assert scene_of(tables_of(name, ROUGH), "case").warnings == ()


def test_a_table_without_keys_is_refused():
    for table in ("bore_shape", "contact"):
        changes = {f"{FILM}.{table}": {}}
        with pytest.raises(ehd.errors.SettingsError, match=rf"\[{FILM}.{table}\] is empty"):
            scene_of(tables_of(CRANK, changes), "case")


def test_a_change_takes_along_what_depended_on_it():
    changes = {
        f"{ROD}.reduction.residual_modes": 20,
        f"{FILM}.element": "bilinear",
        f"{FILM}.cavitation": "mass-conserving",
        f"{FILM}.initial_filling": 0.5,
    }
    scene = scene_of(tables_of(CRANK, changes), "case")
    full = {f"{FILM}.cavitation": "reynolds"}
    other = changed(scene, {f"{ROD}.reduction.method": "m1", **full})
    assert other.bodies["rod"].reduction.residual_modes == 31
    assert other.joints["big_end"].initial_filling == 1.0
    with pytest.raises(ehd.errors.SettingsError, match="residual_modes = 25 has no effect"):
        changed(scene, {f"{ROD}.reduction.method": "m1", f"{ROD}.reduction.residual_modes": 25})
    again = changed(scene, {"time.tolerance": 1e-4})
    assert again.bodies["rod"].reduction.residual_modes == 20


def test_a_run_of_a_version_that_accepted_more_can_be_read(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(toml(tables_of(CRANK, M4 | {f"{ROD}.reduction.residual_modes": 20})))
    with pytest.raises(ehd.errors.SettingsError, match="residual_modes = 20 has no effect"):
        ehd.read_scene(path)
    (tmp_path / "manifest.txt").write_text("")
    assert ehd.read_scene(path).bodies["rod"].reduction.residual_modes == 31


def test_snapshots_of_no_run_are_refused_before_anything_is_meshed(tmp_path):
    changes = {f"{ROD}.reduction.snapshots": str(tmp_path)}
    scene = scene_of(tables_of(CRANK, changes), "case")
    with pytest.raises(ehd.errors.SettingsError, match=r"rod.reduction.snapshots = .* no history"):
        ehd.build(scene)


#: Commands whose option has no effect, and why.
COMMANDS = [
    ("run loaded-journal --frames 5", "without output.paraview = true"),
    ("run --resume old --vtk", "--vtk has no effect with --resume"),
    ("run --resume old -o new", "--output has no effect with --resume"),
    ("run --resume old --method m3", "--method has no effect with --resume"),
    ("run --resume old --frames 5", "--frames has no effect with --resume"),
    ("reduce conrod --method m4 --residual-modes 20 -o a.h5", "without bodies.rod.reduction.meth"),
    ("part a.step --held 3", "--held has no effect without --output"),
    ("part a.step --point 3", "--point has no effect without --output"),
    ("part a.step --cells-around 20", "--cells-around has no effect without --output"),
    ("part a.step --no-check", "--no-check has no effect without --output"),
    ("part a.step --density 7000", "--density has no effect without --output"),
    ("stress run --no-damping --complete", "--complete has no effect without --damping"),
    ("bearing --load 1000 --lobes 3", "lobes = 3 has no effect without ovality"),
    ("bearing --load 1000 --conducted 0.5", "conducted = 0.5 has no effect without supply_temp"),
    ("bearing --load 1000 --mixing 0.4", "mixing = 0.4 has no effect without supply_temperature"),
    ("bearing --load 1000 --temperature 80", "temperature = 80 has no effect without a grade"),
    ("bearing --load 1000 --boundary-friction 0.2", "= 0.2 has no effect without journal_rough"),
    ("bearing --load 1000 --no-flow-factors", "flow_factors = false has no effect without jour"),
    ("bearing --load 1000 --contact-modulus 1e11", "contact_modulus = 1e+11 has no effect with"),
]


@pytest.mark.parametrize(("command", "message"), COMMANDS)
def test_an_option_without_effect_is_refused(command, message, tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, output, errors = exit_of(capfd, *command.split())
    assert (status, output) == (2, "")
    assert message in errors
    assert len(errors.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_default_written_out_is_accepted(tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _, _, errors = exit_of(capfd, "part", "absent.step", "--cells-around", 40, "--check")
    assert "has no effect" not in errors
    options = ("--lobes", 2, "--mixing", 0.5, "--boundary-friction", 0.1, "--cells", "24x4")
    assert exit_of(capfd, "bearing", "--load", 1000, *options)[0] == 0
