"""Scene files of bodies and joints: every kind, every refusal, every shipped scene."""

import re
import tomllib

import attrs
import numpy as np
import pytest
from bench_machines import System
from bench_parts import rigid
from bench_scenes import (
    fields,
    films,
    part_settings,
    scene_of,
    schema,
    shipped,
    shipped_names,
    with_method,
)
from bench_scenes import part as elastic_part
from mechanism_cases import GOLDEN, deviation
from mpi4py import MPI
from scene_cases import tables_of

import fenics_ehd as ehd

FOUR_BAR = shipped("four-bar")
SLIDER_CRANK = shipped("slider-crank-paper")
ROTOR = shipped("rotor-two-bearings")


def tables(text, *changes, extra=""):
    """Tables of a scene with lines changed, ``(old, new)``, and others behind."""
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    return tomllib.loads(text + extra)


def made(text, *changes, extra="", method=None, **options):
    scene = scene_of(tables(text, *changes, extra=extra), "case")
    scene = with_method(scene, method) if method else scene
    return ehd.build(scene, **options)


@pytest.fixture
def reduced_at_once(monkeypatch, rod_structure, housing_structure):
    """Parts with one bore are not meshed; all are reduced without elasticity or its estimate."""
    parts = {"conrod": rod_structure, "housing": housing_structure}
    assembled, reduce = elastic_part._assembled, elastic_part.reduce_structure

    def without_estimate(part, settings, *rest, **options):
        return reduce(part, attrs.evolve(settings, estimate_error=False), *rest, **options)

    monkeypatch.setattr(elastic_part, "reduce_structure", without_estimate)
    monkeypatch.setattr(
        elastic_part,
        "_assembled",
        lambda key, s, *rest: parts[s.model] if len(s.bores) == 1 else assembled(key, s, *rest),
    )
    return "rigid"


@pytest.fixture
def nothing_reduced(monkeypatch, rod_structure):
    """A test whose scene has to be refused before its part is reduced."""
    monkeypatch.setattr(elastic_part, "_assembled", lambda *_: rod_structure)
    monkeypatch.setattr(elastic_part, "reduce_structure", None)


# --- Shipped scenes


@pytest.mark.parametrize("name", shipped_names())
def test_shipped_scenes_read_assemble_and_run(name, reduced_at_once):
    scene = ehd.read_scene(name)
    assert scene.warnings == ()
    flexible = any(isinstance(b, schema.FlexibleSettings) for b in scene.bodies.values())
    scene = with_method(scene, reduced_at_once) if flexible else scene
    built = ehd.build(scene)
    assert {part.method for part in built.bodies.values()} <= {"rigid"}
    assert built.reduced.keys() == built.bodies.keys()
    assert (built.period is None) != (built.end is None)
    result = ehd.simulate(built.mechanism, 1e-6, **{**vars(built.steps), "tolerance": 1e-2})
    assert len(result.time) > 3
    for joint in result.joints.values():
        assert joint.min_film_thickness.min() > 0
        assert joint.max_pressure.max() > 0


def test_shipped_scenes_explain_every_setting():
    texts = [shipped(name) for name in shipped_names()]
    written = set(re.findall(r"^(?:# )?(\w+) *=[^#\n]*#", "\n".join(texts), re.MULTILINE))
    written |= set(re.findall(r"\[(?:[\w.]+\.)?(\w+)\]", "\n".join(texts)))
    classes = set(schema.KINDS) and {
        type(entry)
        for name in shipped_names()
        for table in schema.KINDS
        for entry in getattr(ehd.read_scene(name), table).values()
    }
    for cls in classes | {
        fields.Material,
        fields.Deviations,
        part_settings.ReductionSettings,
        schema.TimeSettings,
        part_settings.OutputSettings,
    }:
        declared = {a.name for a in attrs.fields(cls) if a.metadata}
        keys = declared - {"velocity", "speed", "end", "period"}
        assert keys <= written, (cls, keys - written)


def test_a_shipped_scene_is_the_file_that_init_prints(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(FOUR_BAR)
    assert ehd.read_scene(path).tables == ehd.read_scene("four-bar").tables


def test_shipped_geometry_is_that_of_the_models():
    for name, body in (("slider-crank-paper", "rod"), ("rotor-paper", "housing")):
        part = ehd.read_scene(name).bodies[body]
        model = elastic_part.model_file(part, body).read_text()
        for key, value in part.geometry.items():
            found = re.search(rf"\b{key} *= \{{ *([\d.]+),", model)
            assert float(found[1]) == value, key


GOLDEN_CURVES = [
    ("slider-crank-paper", "slider-crank-m1", "m1", 248, 0.004),
    ("slider-crank-paper", "slider-crank-m3", "m3", 246, 0.004),
    ("slider-crank-paper", "slider-crank-m4", "m4", 247, 0.004),
    ("rotor-paper", "rotor-m4", "m4", 307, 0.01),
]


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "curve", "method", "steps", "largest"), GOLDEN_CURVES)
def test_translated_scenes_give_the_golden_curves(scene, curve, method, steps, largest):
    built = ehd.build(with_method(ehd.read_scene(scene), method))
    result = ehd.simulate(built.mechanism, built.end, **vars(built.steps))
    (joint,) = result.joints.values()
    found = deviation(curve, result.time, joint)
    assert max(found.values()) < largest, found
    assert len(result.time) <= 1.05 * steps
    assert result.summary()["energy_balance_error"] < 0.075 * largest


@pytest.mark.slow
def test_a_torque_gas_and_friction_give_the_golden_curves():
    changed = tables(SLIDER_CRANK, ("friction = false", "friction = true "))
    changed["bodies"]["crank"]["speed"] = 500.0
    changed["drives"]["crank"] = {"kind": "torque", "torque": 1.0, "damping": 0.05, "speed": 500.0}
    gas = {"kind": "angle-table", "point": "piston", "angle_of": "crank"}
    changed["forces"] = {"gas": gas | {"file": str(GOLDEN / "slider-crank-driven-gas.csv")}}
    built = ehd.build(with_method(scene_of(changed, "driven"), "m4"))
    result = ehd.simulate(built.mechanism, built.end, **vars(built.steps))
    found = deviation("slider-crank-driven", result.time, result.joints["big_end"])
    assert max(found.values()) < 0.004, found
    # The golden run looked for ruptures in the frame of the bore, which brakes a little more.
    assert result.bodies["crank"].rates[-1, 2] == pytest.approx(630.0824, rel=2e-4)


@pytest.mark.slow
def test_the_translated_loaded_journal_gives_the_golden_orbit():
    scene = ehd.read_scene("loaded-journal")
    built = ehd.build(scene)
    result = ehd.simulate(
        built.mechanism,
        period=built.period,
        periodicity=scene.time.periodicity,
        cycles=scene.time.cycles,
        **vars(built.steps),
    )
    assert len(result.time) <= 1.05 * 258
    found = deviation("loaded-journal", result.time, result.joints["bearing"])
    # The gap leaves out terms of clearance over radius, 1e-3.
    assert found["pressure"] < 0.004
    assert found["film"] < 0.005


# --- What a scene stands for


def test_bodies_of_every_kind(reduced_at_once):
    crank = made(SLIDER_CRANK, method="rigid").mechanism.bodies["crank"]
    assert isinstance(crank, ehd.RigidBody)
    assert (crank.mass, crank.inertia, crank.points) == (1.0, 1e-3, {"pin": (0.048, 0.0)})
    shaft = made(ROTOR, ("[bodies.shaft]\n", "[bodies.shaft]\nangle = 90.0\n")).mechanism.bodies[
        "shaft"
    ]
    assert isinstance(shaft, ehd.ShaftBody)
    assert shaft.angle == pytest.approx(90.0)
    assert shaft.speed == pytest.approx(300.0)
    # Without supports it moves as a whole, in translation and tilt.
    assert (shaft.rotor.angular == 0).sum() == 2
    steel = 7850.0 * np.pi / 4 * 0.04**2 * 0.6
    assert np.linalg.norm(shaft._carried[:6, 0]) ** 2 == pytest.approx(40.0 + steel, rel=1e-3)
    journal = made(shipped("loaded-journal")).mechanism.bodies["journal"]
    assert (journal.mass, journal.inertia, journal.speed) == (0.0, 0.0, 300.0)


def test_mass_of_a_part_may_be_given_in_place_of_the_models(reduced_at_once):
    rod = made(
        SLIDER_CRANK,
        ("mass = 0.0  ", "mass = 0.9  "),
        ("centre = [0.0, 0.0]       # in", "centre = [0.06, 0.0]       # in"),
        method="rigid",
    ).mechanism.bodies["rod"]
    assert isinstance(rod, ehd.FlexibleBody)
    assert rod.integrals.total_mass == pytest.approx(0.9)
    assert rod.integrals.centre_of_mass == pytest.approx([0.06, 0.0])
    assert rod.integrals.polar_inertia == pytest.approx(rod.reduced.inertia.polar_inertia)


def test_a_part_may_come_from_a_file(rod_structure, tmp_path):
    body = rigid(rod_structure)
    ehd.save_body(body, tmp_path / "rod.h5")
    text = re.sub(r"(?s)\[bodies.rod\].*?\[bodies.piston\]", f"""[bodies.rod]
kind = "flexible"
body = "{tmp_path / 'rod.h5'}"
position = [0.048, 0.0]
[bodies.piston]""", SLIDER_CRANK)  # fmt: skip
    built = made(text)
    assert built.bodies["rod"].method == "rigid"
    assert not built.reduced
    assert built.seconds == 0.0
    with pytest.raises(
        ehd.errors.SettingsError, match=r"method m3: scene case has no model to reduce"
    ):
        made(text, method="m3")
    with pytest.raises(
        ehd.errors.SettingsError, match=r"bodies\.rod\.points do nothing beside body ="
    ):
        made(text, ("position = [0.048, 0.0]\n", 'points = ["pin"]\n'))
    with pytest.raises(ehd.errors.SettingsError, match=r"'rod.pni': body rod has no point pni"):
        made(text, ("rod.pin", "rod.pni"))


@pytest.mark.slow
def test_reductions_of_a_scene_are_those_of_the_program(monkeypatch, rod_structure):
    monkeypatch.setattr(elastic_part, "_assembled", lambda *_: rod_structure)
    m3 = made(SLIDER_CRANK).bodies["rod"]
    assert m3.frequencies == pytest.approx(ehd.load_dependent(rod_structure, 6, 31).frequencies)
    assert m3.provenance["method"] == "m3"
    assert m3.provenance["geometry.rod_length"] == "0.16"


FORCES = """
[forces.push]
kind = "constant"
point = "rocker.tip"
force = [3.0, 4.0]
[forces.belt]
kind = "spring-damper"
between = ["ground.hook", "coupler.tip"]
stiffness = 10.0
damping = 1.0
[forces.weight]
kind = "gravity"
acceleration = [0.0, -9.81]
[forces.turning]
kind = "rotating"
point = "rocker"
amplitude = 2.0
speed = 100.0
[forces.pull]
kind = "time-table"
point = "rocker"
file = "main-bearing"
scale = 0.5
[forces.gas]
kind = "angle-table"
point = "coupler"
file = "gas-force"
angle_of = "crank"
scale = 2.0
"""


def test_forces_of_every_kind():
    two = ("revolutions = 1.0 ", "revolutions = 2.0 ")
    mechanism = made(FOUR_BAR, two, extra=FORCES).mechanism
    assert mechanism.gravity == (0.0, -9.81)
    push, belt = mechanism.forces["push"], mechanism.forces["belt"]
    assert isinstance(push, ehd.PointForce)
    assert push.load(0.0, np.zeros(5), np.zeros(5)).value[:2] == pytest.approx([3.0, 4.0])
    assert belt == ehd.SpringDamper(("ground.hook", "coupler.tip"), 10.0, 1.0)
    assert mechanism.forces["turning"].amplitude == 2.0
    at_start = [mechanism.forces[f"pull.{axis}"].size(0.0)[0] for axis in "xy"]
    assert at_start == pytest.approx([-0.5 * 8650.352, 0.0], abs=1e-6)
    gas = mechanism.forces["gas"]
    assert gas.markers == ("coupler", "crank")
    assert gas.size(np.radians(14.0))[0] == pytest.approx(gas.size(np.radians(734.0))[0])
    assert gas.size(np.radians(14.0))[0] > 5e4


def test_a_torque_drives_a_body_from_its_speed_at_the_start(tmp_path):
    (tmp_path / "torque.csv").write_text("angle_deg,torque_Nm\n0,1\n180,2\n360,1\n")
    drive = f"""
[drives.crank]
kind = "torque"
torque = 3.0
table = "{tmp_path / "torque.csv"}"
damping = 0.5
speed = 90.0
"""
    text = re.sub(r"(?s)\[drives.crank\].*?\n\n", "", FOUR_BAR)
    built = made(text, ("[bodies.crank]\n", "[bodies.crank]\nspeed = 100.0\n"), extra=drive)
    torque = built.mechanism.forces["drive of crank"]
    assert isinstance(torque, ehd.Torque)
    assert (torque.damping, torque.speed, torque.over) == (0.5, 90.0, "angle")
    turned = np.array([0.0, 0.0, np.pi, 0.0, 0.0])
    at_speed = torque.load(0.0, turned, np.array([0.0, 0.0, 90.0, 0.0, 0.0])).value
    assert at_speed[2] == pytest.approx(5.0)
    assert not built.mechanism.drives
    driven = made(FOUR_BAR).mechanism.bodies
    for name, body in built.mechanism.bodies.items():
        if name != "ground":
            # As under a drive of that speed: the mechanism's own motion, not the nearest to rest.
            assert body.speed == pytest.approx(driven[name].speed, abs=1e-9)
    assert built.mechanism.bodies["crank"].speed == pytest.approx(100.0)


def test_a_speed_may_be_given_over_time(tmp_path):
    (tmp_path / "speed.csv").write_text("time_s,speed_rad_per_s\n0,0\n0.1,50\n0.2,100\n")
    path = tmp_path / "speed.csv"
    built = made(
        FOUR_BAR,
        ("speed = 100.0 ", "speed = 0.0 "),
        ('table = "none"', f'table = "{path}"'),
        ("angle = 0.0               # at", "angle = 45.0              # at"),
        ("periodic = true ", "periodic = false"),
        ("revolutions = 1.0         #", "end = 0.05 #"),
    )
    drive = built.mechanism.drives["crank"]
    assert drive(0.0)[0] == pytest.approx(np.pi / 4)
    assert drive(0.2) == pytest.approx((np.pi / 4 + 10.0, 100.0))
    assert drive(0.3) == pytest.approx((np.pi / 4 + 20.0, 100.0))
    times = np.linspace(0.0, 0.25, 11)
    rates = [(drive(t + 1e-6)[0] - drive(t - 1e-6)[0]) / 2e-6 for t in times]
    assert rates == pytest.approx([drive(t)[1] for t in times], abs=1e-3)
    result = ehd.simulate(built.mechanism, 0.02, tolerance=1e-2, order=2)
    assert result.bodies["crank"].coordinates[-1, 2] == pytest.approx(drive(0.02)[0], abs=1e-9)


def test_a_fixed_joint_and_a_slider_in_degrees():
    fixed = """
[joints.weld]
kind = "fixed"
between = ["rocker.tip", "weight"]
angle = 90.0
[bodies.weight]
kind = "rigid"
mass = 0.1
"""
    built = made(FOUR_BAR, extra=fixed)
    assert built.mechanism.joints["weld"] == ehd.Fixed(("rocker.tip", "weight"), 90.0)
    bodies = built.mechanism.bodies
    turned = bodies["weight"].angle - bodies["rocker"].angle
    assert turned == pytest.approx(90.0, abs=1e-7)


def test_the_rough_pose_is_closed():
    bodies = made(FOUR_BAR).mechanism.bodies
    coupler, rocker = bodies["coupler"], bodies["rocker"]
    ends = [
        np.array(b.position) + b.points["tip"][0] * np.array([np.cos(a), np.sin(a)])
        for b, a in ((b, np.radians(b.angle)) for b in (coupler, rocker))
    ]
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)
    assert ends[0][1] > 0


def test_steps_and_times():
    scene = ehd.read_scene("engine")
    assert scene.span == pytest.approx(4 * np.pi / 300)
    built = made(FOUR_BAR, ("revolutions = 1.0 ", "revolutions = 4.0 "))
    assert built.period == pytest.approx(8 * np.pi / 100)
    assert built.steps.largest == pytest.approx(0.005)
    ten = 0.2 * np.pi
    seconds = made(FOUR_BAR, ("revolutions = 1.0 ", f"period = {ten!r} "))
    assert (seconds.period, seconds.end, seconds.steps.largest) == (ten, None, 0.02)


@pytest.mark.mpi
def test_ranks_get_the_same_mechanism_and_the_same_refusal():
    comm = MPI.COMM_WORLD
    scene = with_method(scene_of(tables(SLIDER_CRANK), "case"), "rigid")
    built = ehd.build(scene, comm)
    rod = built.mechanism.bodies["rod"]
    figures = [rod.integrals.total_mass, *rod.fields["pin"][:, 0], *rod.start, *rod.start_rates]
    for others in comm.allgather(figures):
        assert others == pytest.approx(figures, rel=1e-12, abs=1e-12)
    assert figures[:2] == pytest.approx([0.9728, 0.16], rel=1e-3)
    extra = '\n[joints.again]\nkind = "revolute"\nbetween = ["rod.pin", "piston"]\n'
    with pytest.raises(ehd.errors.SettingsError, match="repeats or contradicts other joints"):
        ehd.build(scene_of(tables(SLIDER_CRANK, extra=extra), "case"), comm)


def test_a_bore_that_offers_no_cells_is_refused_before_reduction(nothing_reduced, monkeypatch):
    def no_cells(_):
        raise ehd.errors.InterfaceMismatchError("no cells")

    monkeypatch.setattr(films, "film_grid", no_cells)
    with pytest.raises(ehd.errors.InterfaceMismatchError):
        made(SLIDER_CRANK)


# --- A rod whose pin has a rigid bore


@pytest.mark.slow
def test_a_film_on_a_point_of_a_flexible_rod_moves_with_it(monkeypatch, rod_structure):
    monkeypatch.setattr(elastic_part, "_assembled", lambda *_: rod_structure)
    given = tables(shipped("slider-crank-both-ends"))
    given["bodies"]["rod"]["bores"] = ["bore"]
    given["joints"]["small_end"] |= {"radius": 0.012, "width": 0.022, "cells": [20, 5]}
    scene = scene_of(given, "both")
    films = {}
    for method in ("rigid", "m3"):
        built = ehd.build(with_method(scene, method))
        result = ehd.simulate(built.mechanism, 5e-4, tolerance=1e-3, order=2)
        films[method] = result.joints["small_end"].min_film_thickness[-1]
        pin = built.mechanism.bodies["rod"].marker(
            "pin", np.zeros(3 + len(built.bodies["rod"].kinds))
        )
        assert pin.values[:2] == pytest.approx([0.16, 0.0], abs=1e-6)
    # The rod's elasticity is felt at the small end too, but it is a heavy rod.
    assert films["m3"] == pytest.approx(films["rigid"], rel=0.05)
    assert films["m3"] != pytest.approx(films["rigid"], rel=1e-6)


def test_grooves_and_ambient_pressure_feed_the_film(monkeypatch, rod_structure):
    monkeypatch.setattr(elastic_part, "_assembled", lambda *_: rod_structure)
    fed = ("grooves = []              #", "grooves = [[90, 30, 3e5]] #")
    with pytest.raises(
        ehd.errors.SettingsError, match=r"joints.big_end.cells: grooves need film cells"
    ):
        made(SLIDER_CRANK, fed)
    bars = ("ambient_pressure = 0.0 ", "ambient_pressure = 1e5 ")
    cells = ("cells = []                #", "cells = [20, 5]           #")
    film = made(SLIDER_CRANK, fed, bars, cells, method="rigid").mechanism.joints["big_end"].film
    (groove,) = film.parameters.regions
    assert (groove.angle, groove.pressure) == (pytest.approx(np.pi / 2), 3e5)
    assert film.parameters.sides.lower == 1e5
    for wrong, message in (("1e9", "degrees wide"), ("1e-3", "cannot resolve groove edges")):
        few = ("grooves = []              #", f"grooves = [[90, {wrong}, 3e5]] #")
        with pytest.raises(
            ehd.errors.SettingsError, match=rf"joints.rocker_end.grooves: .*{message}"
        ):
            made(FOUR_BAR, few)


# --- Refusals

WRONG = [
    # keys and kinds
    ("[bodies.crank]\n", "[bodies.crank]\nmas = 1\n", "unknown key bodies.crank.mas .*mass"),
    ("[bodies.crank]\n", "[bodies.crank]\nmodel = 'x'\n", "a key of kind flexible"),
    ("[bodies.crank]\nkind = \"rigid\" ", "[bodies.crank]\nkind = \"rigd\" ", "did you mean rigid"),
    ("[bodies.crank]\nkind = \"rigid\" ", "[bodies.crank]\n", "bodies.crank.kind is missing"),
    ("mass = 0.8\n", "", r"bodies.coupler.mass is missing: \[kg\]"),
    ("[output]", "[outputs]", r"unknown table \[outputs\]: did you mean output\?"),
    ('journal = "rocker.tip" ', 'journal = "coupler" ', "points of one body"),
    ('between = ["ground", "crank"] ', 'between = ["crank", "crank"]', "points of one body"),
    # names
    ('"crank.tip", "coupler"', '"crank.tp", "coupler"', "body crank has no point 'tp', its points"),
    ('"crank.tip", "coupler"', '"crnk.tip", "coupler"', "there is no body 'crnk', there"),
    ("[drives.crank]", "[drives.crnk]", "drives.crnk: there is no body 'crnk'"),
    ("[drives.crank]", "[drives.ground]", "body ground cannot turn"),
    ('lubricant = "oil" ', 'lubricant = "oli" ', r"there is no \[lubricants.oli\], there are: oil"),
    ('lubricant = "oil" ', "", "give a lubricant or a viscosity, one of them"),
    ('lubricant = "oil" ', 'lubricant = "oil"\nviscosity = 0.1 ', "a lubricant or a viscosity"),
    # films
    ("radius = 0.01 ", "", "joints.rocker_end.radius is missing: that of a rigid bore"),
    ("clearance = 20e-6 ", "clearance = 2e-3 ", "rocker_end.clearance = 0.002 m must be"),
    ("clearance = 20e-6 ", "clearance = 20e-9 ", "at least 1e-05 and below 0.1 of the bore radius"),
    ("eccentricity = [0.0, 0.0]", "eccentricity = [0.8, 0.8]", "lies on the bore or beyond"),
    # times
    ("revolutions = 1.0 ", "", "give time.period or time.revolutions, one of them"),
    ("revolutions = 1.0 ", "revolutions = 1.0\nend = 1.0 ", "periodic = true: give time.period"),
    ('of = "crank" ', 'of = "rocker" ', "its speed at the start is 0"),
    ("smallest_step = 1e-13", "smallest_step = 1e-3 ", "must be below time.first_step"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "message"), WRONG)
def test_what_a_scene_cannot_say(old, new, message):
    with pytest.raises(ehd.errors.SettingsError, match=message):
        made(FOUR_BAR, (old, new))


MORE = [
    # A coupler's end held twice, and a body that joints hold already.
    ('[joints.again]\nkind = "revolute"\nbetween = ["ground.hook", "rocker"]', "repeats or contr"),
    ('[joints.stop]\nkind = "fixed"\nbetween = ["ground", "ground.hook"]', "points of one body"),
    ('[bodies.wheel]\nkind = "rigid"\nmass = 1.0\n[joints.pin]\nkind = "revolute"\nbetween = '
     '["ground", "wheel"]', "body wheel can move or turn freely without inertia"),
    ('[bodies.ghost]\nkind = "massless"', "body ghost can move or turn freely without inertia"),
    ('[joints.b]\nkind = "lubricated"\njournal = "crank.tip"\nbore = "coupler.tip"\nradius = 0.01\n'
     'width = 0.01\nclearance = 2e-5\nviscosity = 0.1',
     r"joints.b.bore = 'coupler.tip' is the bore of joints.rocker_end already"),
    ('[forces.f]\nkind = "constant"\npoint = "crank"\nforce = [0, 0]', "one of them not 0"),
    ('[forces.f]\nkind = "angle-table"\npoint = "crank"\nfile = "gas-force"\nangle_of = "x"',
     "forces.f.angle_of: there is no body 'x'"),
    ('[forces.f]\nkind = "angle-table"\npoint = "crank"\nfile = "gas"\nangle_of = "crank"',
     "forces.f.file = 'gas': neither a .csv file nor a shipped table: gas-force, main-bearing"),
    ('[forces.f]\nkind = "time-table"\npoint = "crank"\nfile = "no.csv"',
     "forces.f.file no.csv: No such file"),
    ('[joints.s]\nkind = "slider"\nline = "ground"\npoint = "crank"\ndirection = [0, 0]', "not 0"),
]  # fmt: skip


@pytest.mark.parametrize(("extra", "message"), MORE)
def test_what_cannot_be_put_together(extra, message):
    with pytest.raises(ehd.errors.SettingsError, match=message):
        made(FOUR_BAR, extra=f"\n{extra}\n")


def test_a_loop_that_does_not_close_and_one_that_jams():
    with pytest.raises(ehd.errors.SettingsError, match=r"cannot be assembled from its rough pose"):
        made(FOUR_BAR, ("tip = [0.15, 0.0]", "tip = [0.05, 0.0]"))
    with pytest.raises(
        ehd.errors.SettingsError, match=r"at angles of crank \d+ degrees: the mechanism cannot"
    ):
        made(FOUR_BAR, ("tip = [0.05, 0.0]", "tip = [0.13, 0.0]"), ("hook = [0.14", "hook = [0.1"))


def test_parts_are_refused_before_they_are_reduced(nothing_reduced):
    for changes, message in (
        ([("clearance = 17e-6 ", "clearance = 2.7e-3 ")], "joints.big_end.clearance = 0.0027 m"),
        ([("clearance = 17e-6", "radius = 0.02\nclearance = 17e-6")], "0.02 m must be that of"),
        ([("pin = [0.048, 0.0]", "pin = [0.3, 0.0]")], "cannot be assembled|at angles of crank"),
        ([('bore = "rod.bore"', 'bore = "rod"   ')], r"the bores of rod are rod\.bore"),
        ([('model = "conrod"', 'model = "none"  ')], "give a model or a body, one of them"),
        ([('points = ["pin"]', "points = []     ")], "rod has no point 'pin', its points: bore"),
        ([("inertia = 1e-3            # [kg m2]", "#"), ("hold_rotation = true ",
          "hold_rotation = false")], "body piston can move or turn freely without inertia"),
    ):  # fmt: skip
        with pytest.raises(ehd.errors.SettingsError, match=message):
            made(SLIDER_CRANK, *changes)
    extra = '\n[joints.again]\nkind = "revolute"\nbetween = ["rod.pin", "piston"]\n'
    with pytest.raises(
        ehd.errors.SettingsError, match=r"joint .* repeats or contradicts other joints"
    ):
        made(SLIDER_CRANK, extra=extra)


def test_a_shaft_that_does_not_fit_its_bore_or_has_none():
    with pytest.raises(
        ehd.errors.SettingsError, match=r"bodies.shaft.diameter = 0.05 m must be that of the"
    ):
        made(ROTOR, ("diameter = 0.04 ", "diameter = 0.05 "))
    with pytest.raises(ehd.errors.SettingsError, match=r"a shaft has no bore"):
        made(ROTOR, ('"shaft.left"', '"ground"'), ('"ground.left"', '"shaft.left"'))
    with pytest.raises(ehd.errors.SettingsError, match=r"shaft.points.left = 1.5 must be a share"):
        made(ROTOR, ("left = 0.15", "left = 1.5 "))
    with pytest.raises(ehd.errors.SettingsError, match=r"shaft.modes = 11 must be even"):
        made(ROTOR, ("modes = 12 ", "modes = 11 "))
    with pytest.raises(ehd.errors.SettingsError, match=r"disks: position = 1.5 must be a share"):
        made(ROTOR, ("disks = [[0.5,", "disks = [[1.5,"))


def test_names_of_groups_are_those_of_the_model():
    with pytest.raises(ehd.errors.MeshError, match=r"no physical group 'pni'"):
        made(SLIDER_CRANK, ('points = ["pin"]', 'points = ["pni"]'), ("rod.pin", "rod.pni"))


def test_files_and_names_that_are_no_scenes(tmp_path):
    with pytest.raises(ehd.errors.SettingsError, match=r"scene 'for-bar': did you mean four-bar"):
        ehd.read_scene("for-bar")
    with pytest.raises(ehd.errors.SettingsError, match=r"absent.toml: No such file"):
        ehd.read_scene(tmp_path / "absent.toml")
    with pytest.raises(ehd.errors.SettingsError):
        scene_of(tomllib.loads("[bodies.ground]\nmass = 1"), "case")


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            {"forces.more": {"kind": "gravity"}},
            r"forces.weight, forces.more: .* \[0, -19.62\] m/s2",
        ),
        (
            {"lubricants.oil.viscosity": 1e-4},
            r"joints.left: .* Reynolds number of 2088, .* to 1000",
        ),
        (
            {"bodies.shaft": {"kind": "massless", "points": {"left": [0.0, 0.0]}}},
            "none has a mass, so that gravity",
        ),
    ],
)
def test_what_a_scene_hardly_means_is_a_notice(changes, told):
    if "bodies.shaft" in changes:
        points = ("right", "disk")
        changes = changes | {f"bodies.shaft.points.{point}": [0.0, 0.0] for point in points}
    scene = scene_of(tables_of("rotor-two-bearings", changes), "case")
    assert re.search(told, scene.warnings[0])
    assert not scene_of(tables_of("rotor-two-bearings", {}), "case").warnings


# --- Several bores


def test_both_bores_of_the_rod_are_elastic():
    text = shipped("slider-crank-both-ends")
    coarse = [
        ("bore_cells_around = 20 ", "bore_cells_around = 10 "),
        ("bore_cells_along = 5 ", "bore_cells_along = 1 "),
        ("shank_cells = 12 ", "shank_cells = 4 "),
    ]
    built = made(text, *coarse)
    films = {place.name: place for place in System(built.mechanism).films}
    assert {place.bore for place in films.values()} == {"bore", "pin"}
    cells = [len(films[n].film.film.parameters.grid.cell_nodes) for n in ("big_end", "small_end")]
    assert cells == [10, 8]
    assert built.bodies["rod"].residual.rank > 100


def test_a_bore_that_is_not_listed_is_rigid(reduced_at_once):
    both = shipped("slider-crank-both-ends")
    with pytest.raises(ehd.errors.SettingsError, match=r"joints\.small_end\.radius is missing"):
        made(both, ('bores = ["bore", "pin"]', 'bores = ["bore"]'))
    size = ("clearance = 12e-6", "clearance = 12e-6\nradius = 0.012\nwidth = 0.022")
    built = made(both, ('bores = ["bore", "pin"]', 'bores = ["bore"]'), size, method="rigid")
    bores = {place.name: place.bore for place in System(built.mechanism).films}
    assert bores == {"big_end": "bore", "small_end": ""}


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (
            ('"bore", "pin"]', '"bore", "bore"]'),
            ehd.errors.SettingsError,
            "must be names, each of them once",
        ),
        (
            ('"bore", "pin"]', '"bore", "hole"]'),
            ehd.errors.SettingsError,
            r"small_end\.radius is missing",
        ),
        (
            ('"bore", "pin"]', '"bore", "pin", "hole"]'),
            ehd.errors.MeshError,
            "no physical group 'hole'",
        ),
        (
            ('"bore", "pin"]', '"pin", "bore"]'),
            ehd.errors.MeshError,
            "pin is not a cylinder about the z axis",
        ),
        (
            ("clearance = 12e-6", "clearance = 12e-6\nradius = 0.02"),
            ehd.errors.SettingsError,
            "0.02 m must be",
        ),
        (
            ('bore = "rod.pin"', 'bore = "rod.bore"'),
            ehd.errors.SettingsError,
            "is the bore of joints.big_end",
        ),
    ],
)
def test_bores_that_cannot_be_are_named(change, error, message):
    with pytest.raises(error, match=message):
        made(shipped("slider-crank-both-ends"), change)


def test_a_file_without_the_bore_of_a_film_is_named(tmp_path, rod_structure):
    ehd.save_body(rigid(rod_structure), tmp_path / "rod.h5")
    scene = tables(shipped("slider-crank-both-ends"))
    rod = scene["bodies"]["rod"]
    for key in ("model", "points", "clamped", "cells", "element", "material", "geometry"):
        del rod[key]
    del rod["reduction"]
    rod["body"] = str(tmp_path / "rod.h5")
    with pytest.raises(
        ehd.errors.SettingsError, match=r"small_end\.bore: .*rod\.h5 has the bores bore"
    ):
        ehd.build(scene_of(scene, "case"))


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("youngs_modulus", r"did you mean bodies\.rod\.material\.youngs_modulus\?"),
        ("clearance", r"did you mean joints\.NAME\.clearance\?"),
        ("diameter", r"a key of kind shaft"),
        ("modle", r"did you mean bodies\.rod\.model\?"),
        ("bore_radius", r"a model's dimensions are keys of bodies\.rod\.geometry$"),
    ],
)
def test_key_in_the_wrong_table(key, message):
    tables = {"bodies": {"rod": {"kind": "flexible", "model": "conrod", key: 1.0}}}
    with pytest.raises(
        ehd.errors.SettingsError, match=rf"unknown key bodies\.rod\.{key} of kind.*{message}"
    ):
        scene_of(tables, "new.toml")
