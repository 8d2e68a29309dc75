"""A refusal is one sentence, of Python and of scene files; a scene adds its key."""

import pytest
from test_heat_scene import HEAT, tables

import fenics_ehd as ehd
from fenics_ehd.scenes.scene import scene_of


def refused(function, *arguments, **keywords):
    """Message of the `SettingsError` that a call raises."""
    with pytest.raises(ehd.errors.SettingsError) as error:
        function(*arguments, **keywords)
    return str(error.value)


def film():
    """The film of the scene `tables`, of an oil without a grade."""
    grid = ehd.uniform_grid(0.0225, 0.022, (16, 3), "lagrange")
    return ehd.Film(ehd.FilmParameters(grid, 17e-6, ehd.Lubricant(0.01), 500.0))


def mechanism(**joints):
    """A journal and a rod, connected by the given joints."""
    bodies = {"journal": ehd.MasslessBody(), "rod": ehd.RigidBody(1.0, 1e-3, {"tip": (0.1, 0.0)})}
    return ehd.Mechanism(bodies, joints, {"journal": ehd.Speed(500.0)})


def scene(**joints):
    """The scene `tables` with a rod and the given joints in place of its own."""
    every = tables(oil={"viscosity": 0.01}, periodic=False, end=1e-3, revolutions=0.0)
    every["bodies"]["rod"] = {"kind": "rigid", "mass": 1.0, "points": {"tip": [0.1, 0.0]}}
    every["joints"] = {
        name: tables()["joints"]["bearing"] | joint if "journal" in joint else joint
        for name, joint in joints.items()
    }
    del every["time"]["of"]
    return every


def revolute(*between):
    """A joint in Python and in a scene."""
    return ehd.Revolute(between), {"kind": "revolute", "between": list(between)}


def bearing(**names):
    """A lubricated joint in Python and in a scene."""
    return ehd.LubricatedJoint(film=film(), **names), names


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        (
            {"hinge": revolute("ground", "rood.tip")},
            "joints.hinge.between: there is no body 'rood': choose from ground, journal, rod",
        ),
        (
            {"hinge": revolute("ground", "rod.tap")},
            "joints.hinge.between = 'rod.tap': body rod has no point 'tap', its points: tip",
        ),
        (
            {"film": bearing(journal="rod", bore="rod.tip")},
            "joints.film: rod and rod.tip are points of one body: choose points of two bodies",
        ),
        (
            {
                "a": bearing(journal="journal", bore="ground"),
                "b": bearing(journal="rod", bore="ground"),
            },
            "joints.b.bore = 'ground' is the bore of joints.a already: a bore holds one journal; "
            "give one of the joints another bore",
        ),
    ],
    ids=["no body", "no point", "one body", "one bore"],
)
def test_names_are_refused_alike(joints, message):
    of_python = mechanism(**{name: pair[0] for name, pair in joints.items()})
    of_scene = scene(**{name: pair[1] for name, pair in joints.items()})
    assert refused(ehd.simulate, of_python, 1e-3) == message
    assert refused(scene_of, of_scene, "scene") == message


def test_an_eccentricity_is_refused_alike():
    beyond = (0.9 * 17e-6, 0.9 * 17e-6)
    message = refused(ehd.LubricatedJoint, "journal", "ground", film(), eccentricity=beyond)
    assert message == (
        "eccentricity = 1.27 of the clearance must be below 1: the journal would touch or "
        "penetrate the bore"
    )
    names = {"journal": "journal", "bore": "ground", "eccentricity": [0.9, 0.9]}
    assert refused(scene_of, scene(film=names), "scene") == f"joints.film.{message}"


def test_heat_of_an_oil_without_a_grade_is_refused_alike():
    message = refused(
        ehd.LubricatedJoint, "journal", "ground", film(), heat=ehd.Heat(supply_temperature=70.0)
    )
    assert message.startswith("heat: the viscosity of the lubricant does not depend on its temper")
    of_scene = refused(scene_of, tables(HEAT, {"viscosity": 0.01}), "scene")
    assert of_scene.replace("lubricants.oil", "the lubricant") == f"joints.bearing.{message}"


def test_heat_without_a_cycle_is_refused_alike():
    built = ehd.build(scene_of(tables(HEAT), "scene")).mechanism
    of_scene = tables(HEAT, periodic=False, end=1e-3, revolutions=0.0)
    del of_scene["time"]["of"]
    message = refused(ehd.simulate, built, 1e-3)
    assert message.startswith("joints.bearing.heat: heat is balanced over a cycle, but a run with ")
    assert refused(scene_of, of_scene, "scene") == message
