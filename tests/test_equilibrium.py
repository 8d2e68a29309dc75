"""Mechanisms at rest and their small motions: exact derivatives, in any mechanism."""

import warnings
from dataclasses import replace

import attrs
import numpy as np
import pytest
from scipy.interpolate import PPoly

import fenics_ehd as ehd
from fenics_ehd.multibody.tabulated import Curve

R, C, WIDTH, SPEED, LOAD = 0.0225, 17e-6, 0.022, 500.0, 4000.0

ROUGH = ehd.RoughSurfaces(journal_roughness=0.3e-6, bore_roughness=0.4e-6, modulus=115e9)


def film(family="lagrange", cells=(24, 6), oil=None, **more):
    grid = ehd.FilmGrid(
        R, np.linspace(0.0, 2 * np.pi, cells[0] + 1),
        WIDTH * np.linspace(-0.5, 0.5, cells[1] + 1), family,
    )  # fmt: skip
    return ehd.Film(ehd.FilmParameters(grid, C, oil or ehd.Lubricant(0.01), SPEED, **more))


def journal(on, force=(LOAD, 0.0), rate=(0.0, 0.0), **joint):
    """A journal of 2 kg under a force [N], that moves at a rate [m/s]."""
    start = {"eccentricity": (0.3 * C, 0.4 * C), "eccentricity_rate": rate}
    shaft = ehd.RigidBody(2.0, 1e-3, position=start["eccentricity"], velocity=rate)
    size = float(np.hypot(*force))
    return ehd.Mechanism(
        {"shaft": shaft},
        {"bearing": ehd.LubricatedJoint("shaft", "ground", on, **start, **joint)},
        {"shaft": ehd.Speed(SPEED)},
        {"load": ehd.PointForce("shaft", force, lambda _: (size, 0.0))},
    )


def place(mechanism):
    found = ehd.equilibrium(mechanism, tolerance=1e-13)
    return found.z[found.system.bodies["shaft"]][:2], found


@pytest.mark.parametrize(
    ("on", "joint"),
    [
        (film(), {}),
        (film("bilinear", oil=ehd.Lubricant(0.01, ehd.Barus(2e-8))), {}),
        (film("serendipity", (20, 5)), {}),
        (film(regions=(ehd.AxialGroove(-1.4, 0.4, 2e5),)), {}),
        (film(), {"bore_shape": ehd.Shape(misalignment=(-2e-4, 3e-4))}),
        (film(surfaces=ROUGH), {}),
    ],
    ids=["plain", "barus", "8-node", "groove", "tilted", "rough"],
)
def test_stiffness_and_damping_are_differences_of_equilibria(on, joint):
    middle = place(journal(on, **joint))[1]
    small = ehd.linearise(middle).along(middle.system.bodies["shaft"].start + np.arange(2))
    np.testing.assert_allclose(small.mass, 2.0 * np.eye(2), atol=1e-12)
    change, velocity = 1e-4 * LOAD, 1e-5 * C * SPEED
    for direction in np.eye(2):
        loads = [np.array((LOAD, 0.0)) + sign * change * direction for sign in (1, -1)]
        ends = [place(journal(on, load, **joint))[0] for load in loads]
        moved = small.stiffness @ (ends[0] - ends[1]) / (2 * change)
        np.testing.assert_allclose(moved, direction, atol=2e-4)
        # Under the same load, moving: the film's stiffness gives what its damping takes.
        ends = [
            place(journal(on, rate=tuple(sign * velocity * direction), **joint))[0]
            for sign in (1, -1)
        ]
        given = -small.stiffness @ (ends[0] - ends[1]) / (2 * velocity)
        taken = small.damping @ direction
        np.testing.assert_allclose(given, taken, atol=2e-4 * np.abs(small.damping).max())


def test_films_that_keep_account_of_their_oil_answer_by_frequency():
    on = film("bilinear", sides=ehd.Sides(1e5, 1e5))
    with pytest.raises(ehd.errors.SettingsError, match="depend on the frequency"):
        ehd.linearise(journal(on, cavitation="mass-conserving"))


def with_force(force, name="more"):
    mechanism = journal(film())
    return replace(mechanism, forces={**mechanism.forces, name: force})


def table(last):
    """A line over one second."""
    return Curve(PPoly(np.array([[last - 100.0], [100.0]]), np.array([0.0, 1.0])), periodic=False)


def test_rotating_forces_are_left_out_with_a_notice():
    force = ehd.RotatingForce(point="shaft", amplitude=100.0, speed=SPEED)
    with pytest.warns(UserWarning, match="without the rotating force more of 100 N"):
        without = ehd.equilibrium(with_force(force), tolerance=1e-13)
    assert without.notices
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plain = ehd.equilibrium(journal(film()), tolerance=1e-13)
    assert not plain.notices
    np.testing.assert_array_equal(without.z, plain.z)


def eccentric(**body):
    """A shaft that carries a mass, or a point under a load, around."""
    mechanism = journal(film())
    shaft = attrs.evolve(mechanism.bodies["shaft"], **body)
    return replace(mechanism, bodies={"shaft": shaft})


def carried_point():
    mechanism = eccentric(points={"rim": (0.01, 0.0)})
    load = ehd.PointForce("shaft.rim", (1.0, 0.0), lambda _: (1.0, 0.0))
    return replace(mechanism, forces={**mechanism.forces, "rim": load})


def driven_at(speed):
    return replace(journal(film()), drives={"shaft": speed})


def oval_journal():
    shape = ehd.Shape(ovality=2e-6)
    return journal(film(), journal_shape=shape)


def fed(curve):
    feed = ehd.HoleSupply(diameter=8e-3, angle=180.0, curve=curve, name="hole")
    return journal(film(feeds=(feed,)))


VARYING = {
    "no drive": (
        lambda: driven_at_nothing(),
        "nothing holds body shaft at an angle or a speed: add drives.shaft",
    ),
    "a table of force over time": (
        lambda: with_force(ehd.PointForce("shaft", (1.0, 0.0), table(200.0))),
        "forces.more varies",
    ),
    "a function of time": (
        lambda: with_force(ehd.PointForce("shaft", (1.0, 0.0), lambda t: (np.cos(t), 0.0))),
        "forces.more varies",
    ),
    "a table over an angle that turns": (
        lambda: with_force(ehd.PointForce("shaft", (1.0, 0.0), table(200.0), "shaft")),
        "forces.more varies",
    ),
    "a speed over time": (
        lambda: driven_at(ehd.Speed(curve=table(200.0))),
        "drives.shaft: its speed varies with time",
    ),
    "a supply over time": (
        lambda: fed(table(200.0)),
        "joints.bearing: the pressure of a supply varies",
    ),
    "a centre of mass off the axis": (
        lambda: eccentric(centre=(1e-6, 0.0)),
        "centre of mass of shaft is carried around",
    ),
    "a point off the axis": (carried_point, "shaft.rim is carried around"),
    "a shape that turns": (oval_journal, "shape or a supply of the journal of bearing turns"),
    "a linkage": (
        lambda: ehd.build(ehd.read_scene("four-bar")).mechanism,
        "crank.tip is carried around",
    ),
}


def driven_at_nothing():
    return replace(journal(film()), drives={})


@pytest.mark.parametrize("what", VARYING)
def test_what_varies_has_no_equilibrium(what):
    make, message = VARYING[what]
    with pytest.raises(ehd.errors.SettingsError, match=f"^no equilibrium: .*{message}"):
        ehd.equilibrium(make())


CONSTANT = {
    "a table of one value": lambda: with_force(ehd.PointForce("shaft", (1.0, 0.0), table(100.0))),
    "a table over an angle": lambda: resting(table(200.0)),
    "a round shape": lambda: journal(film(), journal_shape=ehd.Shape()),
    "a supply of one pressure": lambda: fed(table(100.0)),
}


def resting(curve):
    """A bore that turns about a shaft at rest, under a table over the shaft's angle."""
    mechanism = with_force(ehd.PointForce("shaft", (1.0, 0.0), curve, "shaft"))
    bodies = {**mechanism.bodies, "ring": ehd.MasslessBody()}
    # In the frame of the ring the shaft's place turns back.
    back = (SPEED * 0.4 * C, -SPEED * 0.3 * C)
    bearing = replace(mechanism.joints["bearing"], bore="ring", eccentricity_rate=back)
    joints = {"bearing": bearing, "axis": ehd.Revolute(("ring", "ground"))}
    drives = {"shaft": ehd.Speed(0.0), "ring": ehd.Speed(SPEED)}
    return replace(mechanism, bodies=bodies, joints=joints, drives=drives)


@pytest.mark.parametrize("what", CONSTANT)
def test_what_is_the_same_at_all_times_has_one(what):
    assert not ehd.equilibrium(CONSTANT[what]()).notices


def test_a_film_that_runs_dry_is_refused_with_words_about_the_equilibrium():
    on = film("bilinear", sides=ehd.Sides(0.0, 0.0))
    with pytest.raises(ehd.errors.SolverError, match=r"^no equilibrium found .*'reynolds', or sim"):
        ehd.equilibrium(journal(on, cavitation="mass-conserving"))


def test_an_equilibrium_continues_from_a_former_one_in_fewer_iterations():
    former = ehd.equilibrium(journal(film()))
    heavier = journal(film(), (1.1 * LOAD, 0.0))
    anew = ehd.equilibrium(heavier)
    continued = ehd.equilibrium(heavier, start=former)
    np.testing.assert_allclose(continued.z, anew.z, rtol=1e-8, atol=1e-9 * C)
    assert continued.iterations < anew.iterations
    other = journal(film(cells=(20, 5)))
    with pytest.raises(ehd.errors.SettingsError, match=r"^start: .* another mechanism"):
        ehd.equilibrium(other, start=former)
