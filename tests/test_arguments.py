"""Arguments of public functions and classes: refused as keys of scenes are, dictionaries copied."""

from functools import cache

import numpy as np
import pytest
from hand_made_rod import Joint, make_body
from mpi4py import MPI

import fenics_ehd as ehd
from fenics_ehd.multibody.notices import unusual_totals

NAN = float("nan")
OIL = ehd.Lubricant(0.01)


@cache
def film():
    grid = ehd.uniform_grid(0.02, 0.02, (12, 3))
    return ehd.Film(ehd.FilmParameters(grid, 2e-5, OIL, 100.0))


@cache
def body():
    return make_body(Joint())


def joint(**changes):
    return ehd.LubricatedJoint("a", "b", **({"film": film()} | changes))


def part(**changes):
    return ehd.FlexibleBody(body(), **changes)


def grid(**changes):
    return ehd.uniform_grid(**({"radius": 0.02, "width": 0.02, "cells": (12, 3)} | changes))


def parameters(**changes):
    given = {"grid": grid(), "clearance": 2e-5, "lubricant": OIL, "rate": 100.0}
    return ehd.FilmParameters(**(given | changes))


def mesh(**changes):
    return ehd.build_mesh(ehd.model_path("conrod"), comm=MPI.COMM_SELF, **changes)


def mechanism(**changes):
    return ehd.Mechanism(**({"bodies": {"a": ehd.RigidBody(1.0, 1.0)}, "joints": {}} | changes))


def force(*arguments):
    return ehd.PointForce("a", *arguments)


#: Words, numbers and pairs that nothing has.
VALUES = [
    (lambda: joint(transfer="mortr"), "transfer = 'mortr' must be one of conservative, mortar"),
    (lambda: joint(shear_rule="ful"), "shear_rule = 'ful' must be one of streamers, full, none"),
    (lambda: joint(cavitation="elrod"), "cavitation = 'elrod' must be one of reynolds, mass-con"),
    (lambda: joint(smallest_film=NAN), "smallest_film = nan must be a finite number"),
    (lambda: joint(smallest_film=-1), "smallest_film = -1.0 must be at least 0"),
    (lambda: joint(smallest_film="x"), "smallest_film = 'x' must be a finite number"),
    (lambda: joint(initial_filling=NAN), "initial_filling = nan must be a finite number"),
    (lambda: joint(eccentricity=3), "eccentricity = 3 must be two finite numbers"),
    (lambda: joint(eccentricity_rate=(NAN, 0)), r"eccentricity_rate = \[nan, 0\] must be two fin"),
    (lambda: ehd.BoreFilm(body(), film(), "mortr"), "transfer = 'mortr' must be one of"),
    (lambda: part(mass=-1), "mass = -1.0 must be above 0"),
    (lambda: part(inertia=NAN), "inertia = nan must be a finite number"),
    (lambda: part(centre=(NAN, 0)), "centre = .* must be two finite numbers"),
    (lambda: part(damping_time=-1.0), "damping_time = -1.0 must be at least 0"),
    (lambda: mesh(cells="tets"), "cells = 'tets' must be one of hex, tet"),
    (lambda: mesh(size=NAN), "size = nan must be a finite number"),
    (lambda: grid(family="quad"), "family = 'quad' must be one of lagrange, serendipity, bilin"),
    (lambda: grid(cells=(12.5, 3)), r"cells\[0\] = 12.5 must be a whole number"),
    (lambda: grid(radius=NAN), "radius = nan must be a finite number"),
    (lambda: grid(width=-1.0), "width = -1.0 must be above 0"),
    (lambda: parameters(clearance=NAN), "clearance = nan must be a finite number"),
    (lambda: ehd.Film(parameters(), tolerance=NAN), "tolerance = nan must be a finite number"),
    (lambda: ehd.Shape(barrel=1e-6, half_width=NAN), "half_width = nan must be a finite number"),
    (lambda: ehd.ShapeTable([0, 1, 2, 3], [0], [[1], [2]]), r"shape \(2, 1\), not \(4, 1\)"),
    (lambda: ehd.ShaftMotion((NAN, 0), 1.0), "eccentricity = .* must be two finite numbers"),
    (lambda: ehd.Lubricant(0.01, temperature=NAN), "temperature = nan must be a finite number"),
    (lambda: ehd.AxialGroove(NAN, 0.1), "angle of a groove = nan must be a finite number"),
    (lambda: ehd.AxialGroove("a", 0.1), "angle of a groove = 'a' must be a finite number"),
    (lambda: ehd.Sides("x"), "ambient pressure at the lower side = 'x' must be a finite number"),
    (lambda: force((0.0, 0.0), abs), "direction = .* one of them not 0"),
    (lambda: ehd.Speed(1.0, start=NAN), "start = nan must be a finite number"),
    (lambda: mechanism(gravity=-9.81), "gravity = -9.81 must be two finite numbers"),
    (lambda: ehd.simulate(mechanism(), NAN), "end = nan must be a finite number"),
    (lambda: ehd.simulate(mechanism(), 1, frob=1), "simulate has no argument frob: known: toler"),
    (lambda: ehd.simulate(mechanism(), 1, tolerence=1), "did you mean tolerance?"),
    (lambda: ehd.simulate(mechanism(), period=1.0, cycles=2.5), "cycles = 2.5 must be a whole num"),
    (lambda: ehd.simulate(mechanism(), period=1.0, periodicity=NAN), "periodicity = nan must"),
    (lambda: ehd.equilibrium(mechanism(), tolerance=NAN), "tolerance = nan must be a finite"),
    (lambda: ehd.bearing(load=1e3, clearence=1e-5), "bearing has no argument clearence: did you"),
    (lambda: ehd.bearing(eccentricity=NAN), "eccentricity = nan must be a finite number"),
]

#: Arguments of another class.
CLASSES = [
    (lambda: joint(film=3), "film = 3 is of class int: Film is needed"),
    (lambda: joint(heat=3), "heat = 3 is of class int: Heat is needed"),
    (lambda: joint(bore_shape=3), "bore_shape = 3 is of class int: Shape is needed"),
    (lambda: joint(friction="yes"), "friction = 'yes' is of class str: bool is needed"),
    (lambda: ehd.BoreFilm(3, film()), "body = 3 is of class int: ReducedBody is needed"),
    (lambda: ehd.FlexibleBody(3), "reduced = 3 is of class int: ReducedBody is needed"),
    (lambda: parameters(lubricant=0.01), "lubricant = 0.01 is of class float: Lubricant is ne"),
    (lambda: parameters(feeds=[3]), r"feeds\[0\] = 3 is of class int: Supply is needed"),
    (lambda: ehd.Film(3), "parameters = 3 is of class int: FilmParameters is needed"),
    (lambda: ehd.Lubricant(0.01, viscosity_law="barus"), "viscosity_law = 'barus' is of class str"),
    (lambda: ehd.RigidBody(1.0, points=3), "points = 3 must be a table"),
    (lambda: ehd.ground(3), "points = 3 must be a table"),
    (lambda: force((1, 0), 3.0), "size = 3 is of class float: a function is needed"),
    (lambda: mechanism(bodies={"a": 3}), r"bodies\['a'\] = 3 is of class int: Body is needed"),
    (lambda: mechanism(joints=3), "joints = 3 is of class int: Mapping is needed"),
    (lambda: mechanism(forces={"a": 3}), r"forces\['a'\] = 3 is of class int: Force is needed"),
    (lambda: ehd.simulate(3, 1.0), "mechanism = 3 is of class int: Mechanism is needed"),
    (lambda: ehd.build("slider-crank"), "scene = 'slider-crank' is of class str: Scene is need"),
    (lambda: ehd.run("four-bar", "out"), "scene = 'four-bar' is of class str: Scene is needed"),
    (lambda: ehd.read_scene(3), "source = 3 is of class int: str or Path or Mapping is needed"),
    (lambda: ehd.equilibrium(3), "mechanism = 3 is of class int: Mechanism is needed"),
    (lambda: ehd.linearise(3), "rest = 3 is of class int: Equilibrium or Mechanism is needed"),
    (lambda: ehd.error_budget(3), "history = 3 is of class int: History is needed"),
    (lambda: ehd.replay(3, mechanism()), "history = 3 is of class int: History is needed"),
    (lambda: ehd.solve_bearing(3, load=1.0), "settings = 3 is of class int: BearingSettings is"),
    (lambda: ehd.bearing(load=1.0, grooves=[3]), r"grooves\[0\] = 3 is of class float: AxialG"),
    (lambda: ehd.bearing(load=1.0, bore_shape=3), "bore_shape = 3 is of class int: Shape is nee"),
    (lambda: ehd.Reductor(3), "structure = 3 is of class int: Structure is needed"),
    (lambda: ehd.craig_bampton(3, 3), "part = 3 is of class int: Structure or Reductor is needed"),
    (lambda: ehd.save_body(3, "x.h5"), "body = 3 is of class int: ReducedBody is needed"),
    (lambda: ehd.load_history(3), "directory = 3 is of class int: str or Path is needed"),
    (lambda: ehd.assemble_structure(3, ehd.Material()), "part = 3 is of class int: PartMesh is"),
    (lambda: ehd.shaft_gap(3, 0.02, 2e-5, 3), "points = 3 is of class int: SurfacePoints is nee"),
]


@pytest.mark.parametrize(("make", "message"), [*VALUES, *CLASSES])
def test_what_no_argument_can_be_is_named(make, message):
    with pytest.raises(ehd.errors.InputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


LOAD = "time_s,Fx_N,Fy_N\n0,500,900\n5e-3,0,500\n10e-3,-500,900\n20e-3,500,900\n"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"interpolation": "quadratic"},
            "interpolation = 'quadratic' must be one of cubic",
        ),
        ({"scale": NAN}, "scale = nan must be a finite number"),
        ({"period": -1.0}, "period = -1.0 must be at least 0"),
    ],
)
def test_a_load_is_read_in_words_that_there_are(changes, message, tmp_path):
    (tmp_path / "load.csv").write_text(LOAD)
    with pytest.raises(ehd.errors.SettingsError, match=message):
        ehd.read_load(tmp_path / "load.csv", **changes)


def test_dictionaries_of_the_caller_are_copied():
    bodies, points = {"a": ehd.RigidBody(1.0, 1.0)}, {"pin": (0.1, 0.0)}
    forces = {"load": force((1.0, 0.0), lambda _: (1.0, 0.0))}
    made = ehd.Mechanism(bodies, {}, forces=forces)
    crank = ehd.RigidBody(1.0, 1.0, points)
    bodies["b"], points["pin"] = crank, (5.0, 0.0)
    forces.clear()
    assert set(made.bodies) == {"a"}
    assert set(made.forces) == {"load"}
    assert crank.points == {"pin": (0.1, 0.0)}
    cells = [12, 3]
    scene = dict(ehd.read_scene("four-bar").tables)
    scene["joints"]["rocker_end"]["cells"] = cells
    read = ehd.read_scene(scene)
    cells[0] = 99
    scene["joints"]["rocker_end"]["width"] = 5.0
    assert read.joints["rocker_end"].cells == (12, 3)
    assert read.tables["joints"]["rocker_end"]["cells"] == [12, 3]


def test_totals_that_a_part_hardly_has_are_notices():
    # A rod of 0.16 m with a radius of gyration of 64 mm about its centre of mass, at 68 mm.
    like = part(mass=1.1, inertia=5e-3, centre=(0.06, 0.0))
    assert unusual_totals({"rod": part(), "other": like, "ground": ehd.ground()}) == []
    far, heavy = unusual_totals({"rod": part(centre=(5.0, 0.0), inertia=1e9)})
    assert far.startswith("bodies.rod.centre = [5.0, 0.0] m is 4.93 m from the centre of mass of")
    assert "radius of gyration of 3.21e+04 m, that of the part is 0.0641 m" in heavy
    crank = ehd.RigidBody(1.0, 1e-3, {"pin": (0.048, 0.0)})
    assert unusual_totals({"crank": crank}) == []
    off = ehd.RigidBody(1.0, 1e3, {"pin": (0.048, 0.0)}, (5.0, 0.0))
    assert [line.partition(" = ")[0] for line in unusual_totals({"crank": off})] == [
        "bodies.crank.centre", "bodies.crank.inertia"
    ]  # fmt: skip
    assert np.isfinite(body().inertia.polar_inertia)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ehd.film_grid(np.zeros(5)), r"nodes of shape \(5,\) must be positions"),
        (lambda: ehd.film_grid(np.zeros((5, 2))), r"nodes of shape \(5, 2\) must be positions"),
        (lambda: ehd.save_body(body(), 3), "path = 3 is of class int"),
        (lambda: ehd.build_mesh(3), "path = 3 is of class int"),
        (lambda: ehd.build_mesh("conrod.geo", comm=1), "comm = 1 is of class int"),
        (
            lambda: ehd.simulate(
                ehd.Mechanism({"a": ehd.RigidBody(1.0, 1.0)}, {}), 1e-3, progress=3
            ),
            "progress = 3 is of class int: a function is needed",
        ),
    ],
)
def test_arguments_of_a_wrong_class_or_shape_are_named(call, message):
    with pytest.raises(ehd.errors.SettingsError, match=message):
        call()


def test_a_body_without_joints_falls_freely():
    mechanism = ehd.Mechanism({"a": ehd.RigidBody(1.0, 1.0)}, {}, gravity=(0.0, -9.81))
    history = ehd.simulate(mechanism, 0.1, tolerance=1e-8)
    assert history.time[-1] == pytest.approx(0.1)
    assert np.abs(history.coordinates[-1]).max() == pytest.approx(9.81 * 0.1**2 / 2, rel=1e-5)
