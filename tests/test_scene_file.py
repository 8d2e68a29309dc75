"""Scene files of bodies and joints: every kind, every refusal, every shipped scene."""

import re
from dataclasses import replace
from types import MappingProxyType

import attrs
import numpy as np
import pytest
from mechanism_cases import GOLDEN, deviation, simulated_at_nodes
from mpi4py import MPI
from scene_cases import tables_of

import fenics_ehd as ehd
from fenics_ehd.base import shared_settings
from fenics_ehd.multibody.mechanism import System
from fenics_ehd.reduction.reductor import rigid
from fenics_ehd.scenes import films, part_settings, schema
from fenics_ehd.scenes import part as elastic_part
from fenics_ehd.scenes.library import shipped, shipped_names
from fenics_ehd.scenes.part_changes import with_method
from fenics_ehd.scenes.scene import scene_of

FOUR_BAR, SLIDER_CRANK, ROTOR = "four-bar", "slider-crank-paper", "rotor-two-bearings"
BOTH_ENDS = "slider-crank-both-ends"

NONE = MappingProxyType({})

#: A joint that others hold already, in the paper's machine.
TWICE = {"joints.again": {"kind": "revolute", "between": ["rod.pin", "piston"]}}


def made(name, changes=NONE, method=None, **options):
    """A shipped scene with changes, built."""
    scene = scene_of(tables_of(name, changes), "case")
    scene = with_method(scene, method) if method else scene
    return ehd.build(scene, **options)


@pytest.fixture
def rod_at_once(monkeypatch, rod_structure):
    """The rod is not meshed. Its mass matrix is a copy, which the error of the mesh frees."""

    def assembled(*_):
        return replace(rod_structure, mass=rod_structure.mass.copy())

    monkeypatch.setattr(elastic_part, "_assembled", assembled)


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
def nothing_reduced(monkeypatch, rod_at_once):
    """A test whose scene has to be refused before its part is reduced."""
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
    classes = {
        shared_settings.Material,
        shared_settings.Deviations,
        part_settings.ReductionSettings,
    }
    classes |= {schema.TimeSettings, part_settings.OutputSettings}
    for name in shipped_names():
        scene = ehd.read_scene(name)
        for table in schema.KINDS:
            classes |= {type(entry) for entry in getattr(scene, table).values()}
    for cls in classes:
        declared = {a.name for a in attrs.fields(cls) if a.metadata}
        keys = declared - {"velocity", "speed", "end", "period"}
        assert keys <= written, (cls, keys - written)


def test_shipped_geometry_is_that_of_the_models():
    for name, body in ((SLIDER_CRANK, "rod"), ("rotor-paper", "housing")):
        part = ehd.read_scene(name).bodies[body]
        model = elastic_part.model_file(part, body).read_text()
        for key, value in part.geometry.items():
            found = re.search(rf"\b{key} *= \{{ *([\d.]+),", model)
            assert float(found[1]) == value, key


GOLDEN_CURVES = [
    (SLIDER_CRANK, "slider-crank-m1", "m1", 248, 0.004),
    (SLIDER_CRANK, "slider-crank-m3", "m3", 246, 0.004),
    (SLIDER_CRANK, "slider-crank-m4", "m4", 247, 0.004),
    ("rotor-paper", "rotor-m4", "m4", 307, 0.01),
]


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "curve", "method", "steps", "largest"), GOLDEN_CURVES)
def test_translated_scenes_give_the_golden_curves(scene, curve, method, steps, largest):
    built = made(scene, method=method)
    result = simulated_at_nodes(built.mechanism, built.end, **vars(built.steps))
    (joint,) = result.joints.values()
    found = deviation(curve, result.time, joint)
    assert max(found.values()) < largest, found
    assert len(result.time) <= 1.05 * steps
    assert result.summary()["energy_balance_error"] < 0.075 * largest


@pytest.mark.slow
def test_a_torque_gas_and_friction_give_the_golden_curves():
    gas = {"kind": "angle-table", "point": "piston", "angle_of": "crank"}
    changes = {
        "joints.big_end.friction": True,
        "bodies.crank.speed": 500.0,
        "drives.crank": {"kind": "torque", "torque": 1.0, "damping": 0.05, "speed": 500.0},
        "forces.gas": gas | {"file": str(GOLDEN / "slider-crank-driven-gas.csv")},
    }
    built = made(SLIDER_CRANK, changes, "m4")
    result = simulated_at_nodes(built.mechanism, built.end, **vars(built.steps))
    found = deviation("slider-crank-driven", result.time, result.joints["big_end"])
    assert max(found.values()) < 0.004, found
    # The golden run looked for ruptures in the frame of the bore, which brakes a little more.
    assert result.bodies["crank"].rates[-1, 2] == pytest.approx(630.0824, rel=2e-4)


@pytest.mark.slow
def test_the_translated_loaded_journal_gives_the_golden_orbit():
    built = made("loaded-journal")
    result = simulated_at_nodes(built.mechanism, **built.options)
    assert len(result.time) <= 1.05 * 258
    found = deviation("loaded-journal", result.time, result.joints["bearing"])
    # The gap leaves out terms of clearance over radius, 1e-3.
    assert found["pressure"] < 0.004
    assert found["film"] < 0.005


# --- The meaning of a scene


def test_bodies_of_every_kind(reduced_at_once):
    crank = made(SLIDER_CRANK, method="rigid").mechanism.bodies["crank"]
    assert isinstance(crank, ehd.RigidBody)
    assert (crank.mass, crank.inertia, crank.points) == (1.0, 1e-3, {"pin": (0.048, 0.0)})
    shaft = made(ROTOR, {"bodies.shaft.angle": 90.0}).mechanism.bodies["shaft"]
    assert isinstance(shaft, ehd.ShaftBody)
    assert shaft.angle == pytest.approx(90.0)
    assert shaft.speed == pytest.approx(300.0)
    # Without supports it moves as a whole, in translation and tilt.
    assert (shaft.rotor.angular == 0).sum() == 2
    steel = 7850.0 * np.pi / 4 * 0.04**2 * 0.6
    assert np.linalg.norm(shaft._carried[:6, 0]) ** 2 == pytest.approx(40.0 + steel, rel=1e-3)
    journal = made("loaded-journal").mechanism.bodies["journal"]
    assert (journal.mass, journal.inertia, journal.speed) == (0.0, 0.0, 300.0)


def test_mass_of_a_part_may_be_given_in_place_of_the_models(reduced_at_once):
    given = {"bodies.rod.mass": 0.9, "bodies.rod.centre": [0.06, 0.0]}
    rod = made(SLIDER_CRANK, given, "rigid").mechanism.bodies["rod"]
    assert isinstance(rod, ehd.FlexibleBody)
    assert rod.integrals.total_mass == pytest.approx(0.9)
    assert rod.integrals.centre_of_mass == pytest.approx([0.06, 0.0])
    assert rod.integrals.polar_inertia == pytest.approx(rod.reduced.inertia.polar_inertia)


def test_a_part_may_come_from_a_file(rod_structure, tmp_path):
    ehd.save_body(rigid(rod_structure), tmp_path / "rod.h5")
    rod = {"kind": "flexible", "body": str(tmp_path / "rod.h5"), "position": [0.048, 0.0]}
    built = made(SLIDER_CRANK, {"bodies.rod": rod})
    assert built.bodies["rod"].method == "rigid"
    assert not built.reduced
    assert built.seconds == 0.0
    both = {"bores": ["bore", "pin"]}
    for name, changes, method, message in (
        (SLIDER_CRANK, {}, "m3", "method m3: scene case has no part with a model"),
        (
            SLIDER_CRANK,
            {"bodies.rod": rod | {"points": ["pin"]}},
            None,
            "points = .* no effect with",
        ),
        (SLIDER_CRANK, {"joints.gudgeon.between": ["rod.pni", "piston"]}, None, "no point 'pni'"),
        (
            BOTH_ENDS,
            {"bodies.rod": rod | both},
            None,
            r"small_end\.bore: .*h5 has no bore 'pin'",
        ),
    ):
        with pytest.raises(ehd.errors.SettingsError, match=message):
            made(name, {"bodies.rod": rod} | changes, method)


@pytest.mark.slow
def test_reductions_of_a_scene_are_those_of_the_program(rod_at_once, rod_structure):
    m3 = made(SLIDER_CRANK).bodies["rod"]
    assert m3.frequencies == pytest.approx(ehd.load_dependent(rod_structure, 6, 31).frequencies)
    assert m3.provenance["method"] == "m3"
    assert m3.provenance["geometry.rod_length"] == "0.16"


GAS = {"kind": "angle-table", "point": "crank", "angle_of": "crank", "file": "gas-force"}


def test_forces_of_every_kind():
    between = ["ground.hook", "coupler.tip"]
    forces = {
        "push": {"kind": "constant", "point": "rocker.tip", "force": [3.0, 4.0]},
        "belt": {"kind": "spring-damper", "between": between, "stiffness": 10.0, "damping": 1.0},
        "weight": {"kind": "gravity", "acceleration": [0.0, -9.81]},
        "turning": {"kind": "rotating", "point": "rocker", "amplitude": 2.0, "speed": 100.0},
        "pull": {"kind": "time-table", "point": "rocker", "file": "main-bearing", "scale": 0.5},
        "gas": GAS | {"point": "coupler", "scale": 2.0},
    }
    mechanism = made(FOUR_BAR, {"forces": forces, "time.revolutions": 2.0}).mechanism
    assert mechanism.gravity == (0.0, -9.81)
    push, belt = mechanism.forces["push"], mechanism.forces["belt"]
    assert isinstance(push, ehd.PointForce)
    assert push.load(0.0, np.zeros(5), np.zeros(5)).value[:2] == pytest.approx([3.0, 4.0])
    assert belt == ehd.SpringDamper(tuple(between), 10.0, 1.0)
    assert mechanism.forces["turning"].amplitude == 2.0
    at_start = [mechanism.forces[f"pull.{axis}"].size(0.0)[0] for axis in "xy"]
    assert at_start == pytest.approx([-0.5 * 8650.352, 0.0], abs=1e-6)
    gas = mechanism.forces["gas"]
    assert gas.markers == ("coupler", "crank")
    assert gas.size(np.radians(14.0))[0] == pytest.approx(gas.size(np.radians(734.0))[0])
    assert gas.size(np.radians(14.0))[0] > 5e4


def test_a_torque_drives_a_body_from_its_speed_at_the_start(tmp_path):
    table = tmp_path / "torque.csv"
    table.write_text("angle_deg,torque_Nm\n0,1\n180,2\n360,1\n")
    drive = {"kind": "torque", "torque": 3.0, "table": str(table), "damping": 0.5, "speed": 90.0}
    built = made(FOUR_BAR, {"drives.crank": drive, "bodies.crank.speed": 100.0})
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
    path = tmp_path / "speed.csv"
    path.write_text("time_s,speed_rad_per_s\n0,0\n0.1,50\n0.2,100\n")
    once = {"time.periodic": False, "time.revolutions": None, "time.end": 0.05}
    drive = {"drives.crank.speed": 0.0, "drives.crank.table": str(path)}
    built = made(FOUR_BAR, once | drive | {"bodies.crank.angle": 45.0})
    drive = built.mechanism.drives["crank"]
    assert drive(0.0)[0] == pytest.approx(np.pi / 4)
    assert drive(0.2) == pytest.approx((np.pi / 4 + 10.0, 100.0))
    assert drive(0.3) == pytest.approx((np.pi / 4 + 20.0, 100.0))
    times = np.linspace(0.0, 0.25, 11)
    rates = [(drive(t + 1e-6)[0] - drive(t - 1e-6)[0]) / 2e-6 for t in times]
    assert rates == pytest.approx([drive(t)[1] for t in times], abs=1e-3)
    result = ehd.simulate(built.mechanism, 0.02, tolerance=1e-2, order=2)
    assert result.bodies["crank"].coordinates[-1, 2] == pytest.approx(drive(0.02)[0], abs=1e-9)


def test_the_rough_pose_is_closed_and_what_is_fixed_is_turned_in_degrees():
    weld = {"kind": "fixed", "between": ["rocker.tip", "weight"], "angle": 90.0}
    built = made(FOUR_BAR, {"joints.weld": weld, "bodies.weight": {"kind": "rigid", "mass": 0.1}})
    assert built.mechanism.joints["weld"] == ehd.Fixed(("rocker.tip", "weight"), 90.0)
    bodies = built.mechanism.bodies
    turned = bodies["weight"].angle - bodies["rocker"].angle
    assert turned == pytest.approx(90.0, abs=1e-7)
    ends = []
    for body in (bodies["coupler"], bodies["rocker"]):
        angle = np.radians(body.angle)
        along = np.array([np.cos(angle), np.sin(angle)])
        ends.append(np.array(body.position) + body.points["tip"][0] * along)
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)
    assert ends[0][1] > 0


def test_steps_and_times():
    scene = ehd.read_scene("engine")
    assert scene.span == pytest.approx(4 * np.pi / 300)
    built = made(FOUR_BAR, {"time.revolutions": 4.0})
    assert built.period == pytest.approx(8 * np.pi / 100)
    assert built.steps.largest == pytest.approx(0.005)
    ten = 0.2 * np.pi
    seconds = made(FOUR_BAR, {"time.revolutions": None, "time.period": ten})
    assert (seconds.period, seconds.end, seconds.steps.largest) == (ten, None, 0.02)


@pytest.mark.mpi
def test_ranks_get_the_same_mechanism_and_the_same_refusal():
    comm = MPI.COMM_WORLD
    rod = made(SLIDER_CRANK, method="rigid", comm=comm).mechanism.bodies["rod"]
    figures = [rod.integrals.total_mass, *rod.fields["pin"][:, 0], *rod.start, *rod.start_rates]
    for others in comm.allgather(figures):
        assert others == pytest.approx(figures, rel=1e-12, abs=1e-12)
    assert figures[:2] == pytest.approx([0.9728, 0.16], rel=1e-3)
    with pytest.raises(ehd.errors.SettingsError, match="repeats or contradicts other joints"):
        made(SLIDER_CRANK, TWICE, comm=comm)


# --- A rod whose pin has a rigid bore


@pytest.mark.slow
def test_a_film_on_a_point_of_a_flexible_rod_moves_with_it(rod_at_once):
    changes = {"bodies.rod.bores": ["bore"], "joints.small_end.cells": [20, 5]}
    changes |= {"joints.small_end.radius": 0.012, "joints.small_end.width": 0.022}
    films = {}
    for method in ("rigid", "m3"):
        built = made(BOTH_ENDS, changes, method)
        result = ehd.simulate(built.mechanism, 5e-4, tolerance=1e-3, order=2)
        films[method] = result.joints["small_end"].min_film_thickness[-1]
        coordinates = np.zeros(3 + len(built.bodies["rod"].kinds))
        pin = built.mechanism.bodies["rod"].marker("pin", coordinates)
        assert pin.values[:2] == pytest.approx([0.16, 0.0], abs=1e-6)
    # The rod's elasticity is felt at the small end too, but it is a heavy rod.
    assert films["m3"] == pytest.approx(films["rigid"], rel=0.05)
    assert films["m3"] != pytest.approx(films["rigid"], rel=1e-6)


def test_grooves_and_ambient_pressure_feed_the_film(rod_at_once):
    fed = {"joints.big_end.grooves": [[90, 30, 3e5]], "joints.big_end.ambient_pressure": 1e5}
    with pytest.raises(ehd.errors.SettingsError, match=r"big_end.cells is missing: grooves"):
        made(SLIDER_CRANK, fed)
    built = made(SLIDER_CRANK, fed | {"joints.big_end.cells": [20, 5]}, "rigid")
    film = built.mechanism.joints["big_end"].film
    (groove,) = film.parameters.regions
    assert (groove.angle, groove.pressure) == (pytest.approx(np.pi / 2), 3e5)
    assert film.parameters.sides.lower == 1e5


# --- Refusals

CRANK_TO, JOURNAL = "joints.crank_end.between", "joints.rocker_end"
WHEEL = {
    "bodies.wheel": {"kind": "rigid", "mass": 1.0},
    "joints.pin": {"kind": "revolute", "between": ["ground", "wheel"]},
}
FILM = {
    "kind": "lubricated", "journal": "crank.tip", "bore": "coupler.tip", "radius": 0.01,
    "width": 0.01, "clearance": 2e-5, "viscosity": 0.1,
}  # fmt: skip
LINE = {"kind": "slider", "line": "ground", "point": "crank", "direction": [0, 0]}
JAMS = {"bodies.crank.points.tip": [0.13, 0.0], "bodies.ground.points.hook": [0.1, 0.0]}
TILL_AN_END = {"time.revolutions": 1.0, "time.end": 1.0}

OF_A_LINKAGE = [
    # keys and kinds
    ({"bodies.crank.mas": 1}, "unknown key bodies.crank.mas .*mass"),
    ({"bodies.crank.model": "x"}, "a key of kind flexible"),
    ({"bodies.crank.kind": "rigd"}, "did you mean rigid"),
    ({"bodies.crank.kind": None}, "bodies.crank.kind is missing"),
    ({"bodies.coupler.mass": None}, r"bodies.coupler.mass is missing: \[kg\]"),
    ({"outputs": {"plots": True}}, r"unknown table \[outputs\]: did you mean output\?"),
    ({f"{JOURNAL}.journal": "coupler"}, "points of one body"),
    ({"joints.left.between": ["crank.tip", "crank"]}, "points of one body"),
    # names
    ({"bodies.ground.mass": 1.0}, "ground"),
    ({CRANK_TO: ["crank.tp", "coupler"]}, "body crank has no point 'tp', its points"),
    ({CRANK_TO: ["crnk.tip", "coupler"]}, "there is no body 'crnk': choose"),
    ({"drives.crnk": {"kind": "speed", "speed": 1.0}}, "drives.crnk: there is no body 'crnk'"),
    ({"drives.ground": {"kind": "speed", "speed": 1.0}}, "body ground cannot turn"),
    ({f"{JOURNAL}.lubricant": "oli"}, r"there is no \[lubricants.oli\]: choose from oil"),
    ({f"{JOURNAL}.lubricant": None}, "give either a lubricant or a viscosity"),
    ({f"{JOURNAL}.viscosity": 0.1}, "a lubricant or a viscosity"),
    # films
    ({f"{JOURNAL}.radius": None}, r"joints.rocker_end.radius is missing \[m\]: a rigid bore"),
    ({f"{JOURNAL}.clearance": 2e-3}, "rocker_end.clearance = 0.002 m must be"),
    ({f"{JOURNAL}.clearance": 20e-9}, "at least 1e-05 and below 0.1 times the bore radius"),
    ({f"{JOURNAL}.eccentricity": [0.8, 0.8]}, "would touch or penetrate the bore"),
    ({f"{JOURNAL}.grooves": [[90, 1e9, 3e5]]}, "joints.rocker_end.grooves: .*degrees wide"),
    ({f"{JOURNAL}.grooves": [[90, 1e-3, 3e5]]}, "rocker_end.grooves: .*cannot resolve groove"),
    # times
    ({"time.revolutions": None}, "give either time.period or time.revolutions"),
    (TILL_AN_END, "time.end = 1 has no effect with time.periodic"),
    ({"time.of": "rocker"}, "has the speed 0 at the start"),
    ({"time.smallest_step": 1e-3}, "must be below time.first_step"),
    # what cannot be put together
    ({"joints.again": {"kind": "revolute", "between": ["ground.hook", "rocker"]}}, "repeats or co"),
    ({"joints.stop": {"kind": "fixed", "between": ["ground", "ground.hook"]}}, "points of one bod"),
    (WHEEL, "body wheel can move or turn freely without inertia"),
    ({"bodies.ghost": {"kind": "massless"}}, "body ghost can move or turn freely without inertia"),
    ({"joints.b": FILM}, "joints.b.bore = 'coupler.tip' is the bore of joints.rocker_end already"),
    ({"joints.s": LINE}, "not 0"),
    ({"bodies.rocker.points.tip": [0.05, 0.0], "bodies.coupler.points.tip": [0.05, 0.0]}, "pose"),
    (JAMS, r"at drive angles crank \d+ degrees: the mechanism cannot"),
    # forces
    ({"forces.f": {"kind": "constant", "point": "crank", "force": [0, 0]}}, "one of them not 0"),
    ({"forces.f": GAS | {"angle_of": "x"}}, "forces.f.angle_of: there is no body 'x'"),
    ({"forces.f": GAS | {"file": "gas"}}, "file = 'gas': give a .csv file or a shipped table"),
    ({"forces.f": GAS | {"file": "no.csv"}}, "forces.f.file no.csv: No such file"),
]

OF_A_SHAFT = [
    ({"bodies.shaft.diameter": 0.05}, "bodies.shaft.diameter = 0.05 m must be that of the"),
    (
        {"joints.left.journal": "ground", "joints.left.bore": "shaft.left"},
        "a shaft has journals, but",
    ),
    ({"bodies.shaft.points.left": 1.5}, "shaft.points.left = 1.5 must be a share"),
    ({"bodies.shaft.modes": 11}, "shaft.modes = 11 must be even"),
    ({"bodies.shaft.disks": [[1.5, 40.0, 0.3, 0.16]]}, "disks: position = 1.5 must be at least 0"),
    ({"bodies.shaft.disks": [[0.5, 40.0, -0.3, 0.16]]}, "disks: polar_inertia = -0.3 must be at"),
    ({"bodies.shaft.disks": [[0.5, 40.0, 0.3]]}, "must be a list of rows with 4 numbers each"),
    ({"joints.left.journal": "shaft"}, "joints.left.journal = 'shaft': a shaft needs one of its"),
]


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [(FOUR_BAR, *case) for case in OF_A_LINKAGE] + [(ROTOR, *case) for case in OF_A_SHAFT],
)
def test_what_a_scene_cannot_say_and_what_cannot_be_put_together(name, changes, message):
    with pytest.raises(ehd.errors.SettingsError, match=message):
        made(name, changes)


def test_parts_are_refused_before_they_are_reduced(nothing_reduced, monkeypatch):
    freed = {"bodies.piston.inertia": None, "joints.cylinder.hold_rotation": False}
    for changes, message in (
        ({"joints.big_end.clearance": 2.7e-3}, "joints.big_end.clearance = 0.0027 m"),
        ({"joints.big_end.radius": 0.02}, "0.02 m must be that of"),
        ({"bodies.crank.points.pin": [0.3, 0.0]}, "cannot be assembled|at drive angles crank"),
        ({"joints.big_end.bore": "rod"}, r"name one of the bores rod\.bore"),
        ({"bodies.rod.model": "none"}, "give either a model or a body"),
        ({"bodies.rod.points": []}, "rod has no point 'pin', its points: bore"),
        (freed, "body piston can move or turn freely without inertia"),
        (TWICE, "joint .* repeats or contradicts other joints"),
    ):
        with pytest.raises(ehd.errors.SettingsError, match=message):
            made(SLIDER_CRANK, changes)

    def no_cells(_):
        raise ehd.errors.InterfaceMismatchError("no cells")

    monkeypatch.setattr(films, "film_grid", no_cells)
    with pytest.raises(ehd.errors.InterfaceMismatchError):
        made(SLIDER_CRANK)


ENDS = {f"bodies.shaft.points.{name}": [0.0, 0.0] for name in ("left", "right", "disk")}


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        (
            {"forces.more": {"kind": "gravity"}},
            r"forces.weight, forces.more: .* \[0, -19.62\] m/s2",
        ),
        ({"lubricants.oil.viscosity": 1e-4}, "joints.left: .* Reynolds number of 2088, .* to 1000"),
        ({"bodies.shaft": {"kind": "massless"}} | ENDS, "no body has a mass, so gravity"),
    ],
)
def test_what_a_scene_hardly_means_is_a_notice(changes, text):
    scene = scene_of(tables_of(ROTOR, changes), "case")
    assert re.search(text, scene.warnings[0])


# --- Several bores


def test_both_bores_of_the_rod_are_elastic():
    geometry = {"bore_cells_around": 10, "bore_cells_along": 1, "shank_cells": 4}
    coarse = {f"bodies.rod.geometry.{key}": number for key, number in geometry.items()}
    built = made(BOTH_ENDS, coarse)
    films = {place.name: place for place in System(built.mechanism).films}
    bores = [place.surfaces[0] for place in films.values()]
    assert all(bore.surface.elastic for bore in bores)
    assert {bore.point for bore in bores} == {"bore", "pin"}
    cells = [len(films[n].film.film.parameters.grid.cell_nodes) for n in ("big_end", "small_end")]
    assert cells == [10, 8]
    assert built.bodies["rod"].residual.rank == 20 + 1 + 16 + 1


def test_a_bore_that_is_not_listed_is_rigid(reduced_at_once):
    alone = {"bodies.rod.bores": ["bore"]}
    with pytest.raises(ehd.errors.SettingsError, match=r"joints\.small_end\.radius is missing"):
        made(BOTH_ENDS, alone)
    size = {"joints.small_end.radius": 0.012, "joints.small_end.width": 0.022}
    built = made(BOTH_ENDS, alone | size, "rigid")
    elastic = {place.name: place.film.elastic for place in System(built.mechanism).films}
    assert elastic == {"big_end": True, "small_end": False}


@pytest.mark.parametrize(
    ("key", "value", "error", "message"),
    [
        ("bodies.rod.bores", ["bore", "bore"], "SettingsError", "must be one or more different"),
        ("bodies.rod.bores", ["bore", "hole"], "SettingsError", r"small_end\.radius is missing"),
        ("bodies.rod.bores", ["bore", "pin", "hole"], "MeshError", "no physical group 'hole'"),
        ("bodies.rod.bores", ["pin", "bore"], "MeshError", "pin is not a cylinder about the z ax"),
        ("bodies.rod.points", ["pin", "pni"], "MeshError", "no physical group 'pni'"),
        ("joints.small_end.radius", 0.02, "SettingsError", "0.02 m must be"),
        ("joints.small_end.bore", "rod.bore", "SettingsError", "is the bore of joints.big_end"),
    ],
)
def test_bores_and_points_that_cannot_be_are_named(key, value, error, message):
    with pytest.raises(getattr(ehd.errors, error), match=message):
        made(BOTH_ENDS, {key: value})


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
