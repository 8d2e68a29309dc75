"""Mechanisms with lubricated joints against golden curves and independent answers."""

from dataclasses import replace

import numpy as np
import pytest
from mechanism_cases import (
    REVOLUTION,
    deviation,
    film,
    flexible_slider_crank,
    rigid_rod,
    short_films,
    slider_crank,
)

from fenics_ehd.errors import FilmTooThinError
from fenics_ehd.film import Film, FilmParameters, Lubricant
from fenics_ehd.film.layout import film_grid
from fenics_ehd.multibody.forces import PointForce, RotatingForce
from fenics_ehd.multibody.joints import Revolute, Speed
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.planar_body import FlexibleBody, RigidBody, ground
from fenics_ehd.multibody.shaft_body import ShaftBody
from fenics_ehd.multibody.simulation import simulate, simulate_periodic
from fenics_ehd.reduction import craig_bampton, residual_flexibility
from fenics_ehd.scenes.angle_table import AngleTable
from fenics_ehd.scenes.loaded_journal import build_film, build_load
from fenics_ehd.scenes.loaded_journal_settings import LoadedJournalSettings
from fenics_ehd.scenes.rotor_run import build_rotor
from fenics_ehd.scenes.rotor_settings import RotorSettings

#: Of the golden curves at default tolerance, and steps that version 0.1 took.
LARGEST_DEVIATION = 0.004


def check_slider_crank(name, body, steps):
    result = simulate(flexible_slider_crank(body), REVOLUTION)
    found = deviation(name, result.time, result.joints["big_end"])
    assert max(found.values()) < LARGEST_DEVIATION, found
    assert len(result.time) <= 1.05 * steps
    assert result.energy_balance_error < 3e-4


def test_the_default_rod_gives_the_golden_curves(rod_body):
    check_slider_crank("slider-crank-m3", rod_body, 246)


@pytest.mark.slow
def test_m1_gives_the_golden_curves(rod_structure):
    check_slider_crank("slider-crank-m1", craig_bampton(rod_structure, 37), 248)


@pytest.mark.slow
def test_m4_gives_the_golden_curves(rod_structure):
    check_slider_crank("slider-crank-m4", residual_flexibility(rod_structure, 6), 247)


@pytest.mark.slow
def test_the_rotor_gives_the_golden_curves(housing_structure):
    body = residual_flexibility(housing_structure, 10)
    settings = RotorSettings()
    rotor = build_rotor(settings)
    inertia = rotor.beam.shaft.polar_inertia + settings.disk.polar_inertia
    shaft = ShaftBody(rotor, inertia, 1e-3, {"bearing": 0.5, "force": 0.75})
    bore = Film(FilmParameters(film_grid(body.pressure_nodes), 17e-6, Lubricant(0.01), 600.0))
    mechanism = Mechanism(
        {"shaft": shaft, "housing": FlexibleBody(body)},
        {"bearing": LubricatedJoint("shaft.bearing", "housing.bore", bore)},
        {"shaft": Speed(600.0)},
        {"unbalance": RotatingForce("shaft.force", 3600.0, 600.0, np.pi / 600)},
    )
    turn = 2 * np.pi / 600
    result = simulate(mechanism, turn, order=2, first=1e-6)
    found = deviation("rotor-m4", result.time, result.joints["bearing"])
    assert max(found.values()) < 0.01, found
    assert len(result.time) <= 1.05 * 307


@pytest.mark.slow
def test_a_massless_journal_gives_the_golden_orbit():
    settings = LoadedJournalSettings()
    load = build_load(settings)
    forces = {
        axis: PointForce(
            "journal", tuple(np.eye(2)[place]), lambda t, place=place: (load(t)[place], 0.0)
        )
        for place, axis in enumerate("xy")
    }
    mechanism = Mechanism(
        {"journal": RigidBody(0.0)},
        {"bearing": LubricatedJoint("journal", "ground", build_film(settings, load.period))},
        {"journal": Speed(300.0)},
        forces,
    )
    result = simulate_periodic(mechanism, load.period, tolerance=5e-5, order=2, first=1e-6)
    assert result.cycles <= 3
    assert result.periodicity_defect < 1e-4
    assert len(result.time) <= 1.05 * 258
    found = deviation("loaded-journal", result.time, result.joints["bearing"])
    # The gap leaves out terms of clearance over radius, 1e-3.
    assert found["pressure"] < LARGEST_DEVIATION
    assert found["film"] < 0.005


# --- Short bearings, whose answers another program gave (DESIGN, fact 6)


def test_both_ends_of_a_rod_are_lubricated():
    result = simulate(
        slider_crank(rigid_rod(), *short_films()), REVOLUTION, tolerance=1e-4, order=2
    )
    thinnest = {name: j.min_film_thickness.min() for name, j in result.joints.items()}
    assert thinnest["big_end"] == pytest.approx(3.482e-6, rel=0.01)
    assert thinnest["gudgeon"] == pytest.approx(4.456e-6, rel=0.01)
    joint = result.joints["gudgeon"]
    assert result.time[joint.min_film_thickness.argmin()] == pytest.approx(9.73e-3, rel=0.01)


def rotating_rotor(mains, width):
    """A heavy crank that nothing but its main bearings carries, under a turning force."""
    bearing = {
        f"main_{i}": LubricatedJoint("rotor", "ground", film(22.5e-3, width, 17e-6, 10.0, (24, 4)))
        for i in range(mains)
    }
    return Mechanism(
        {"rotor": RigidBody(2.0, 1e-3)},
        bearing,
        {"rotor": Speed(500.0)},
        {"load": RotatingForce("rotor", 600.0 * mains, 500.0, 2e-3)},
    )


def test_two_main_bearings_carry_what_one_carries_of_half_the_mass_and_force():
    two = simulate(rotating_rotor(2, 2.2e-3), REVOLUTION, tolerance=1e-6, order=2)
    single = rotating_rotor(1, 2.2e-3)
    half = replace(single.bodies["rotor"], mass=1.0)
    one = simulate(replace(single, bodies={"rotor": half}), REVOLUTION, tolerance=1e-6, order=2)
    late = two.time > 1e-3
    expected = np.interp(two.time[late], one.time, one.joints["main_0"].min_film_thickness)
    for joint in two.joints.values():
        assert joint.min_film_thickness[late] == pytest.approx(expected, rel=1e-3)


def floating(friction):
    """Two rigid bodies that float in the plane, tied by one film alone."""
    oil = film(22.5e-3, 22e-3, 50e-6, 0.01, (20, 4))
    return Mechanism(
        {
            "disk": RigidBody(0.5, 1e-3, speed=400.0, velocity=(0.3, 0.0)),
            "ring": RigidBody(
                0.7, 2e-3, {"bore": (0.05, 0.0)}, centre=(0.03, 0.01), position=(-0.05, 0.0),
                velocity=(0.3, 0.0),
            ),
        },
        {
            "film": LubricatedJoint(
                "disk", "ring.bore", oil, friction=friction, eccentricity=(1e-5, 2e-5)
            )
        },
    )  # fmt: skip


@pytest.mark.parametrize("friction", [False, True])
def test_what_floats_free_keeps_its_momentum(friction):
    mechanism = floating(friction)
    result = simulate(mechanism, 4e-3, tolerance=1e-6, order=2)
    momenta = np.zeros((len(result.time), 3))
    for name, body in mechanism.bodies.items():
        x, y, angle = result.bodies[name].T
        vx, vy, omega = result.body_rates[name].T
        cosine, sine = np.cos(angle), np.sin(angle)
        cx, cy = (
            cosine * body.centre[0] - sine * body.centre[1],
            (sine * body.centre[0] + cosine * body.centre[1]),
        )
        px, py = body.mass * (vx - omega * cy), body.mass * (vy + omega * cx)
        spin = body.inertia * omega + (x + cx) * py - (y + cy) * px
        momenta += np.stack([px, py, spin], axis=-1)
    scale = np.array([1.0, 1.0, 0.05]) * np.abs(momenta[0]).max()
    late = momenta[10:]
    assert np.abs((late - late[0]) / scale).max() < 1e-6
    if friction:
        # Without it the film exchanges next to nothing.
        assert result.energy_balance_error < 1e-3
    turning = result.body_rates["disk"][:, 2]
    assert (abs(turning[-1] - turning[0]) > 1e-3) == friction


# --- A four-bar linkage, one joint lubricated, against the ideal one

LINKS = {"crank": 0.05, "coupler": 0.15, "rocker": 0.12}
MASSES = {"crank": 0.4, "coupler": 0.8, "rocker": 0.6}
INERTIAS = {"crank": 1e-4, "coupler": 2e-3, "rocker": 1e-3}
APART, TURNING = 0.14, 100.0


def four_bar(clearance):
    """Crank at constant speed; the oil's viscosity keeps the eccentricity ratio."""
    links = {
        name: RigidBody(
            MASSES[name], INERTIAS[name], {"tip": (length, 0.0)}, centre=(length / 2, 0.0)
        )
        for name, length in LINKS.items()
    }
    rocker = replace(links["rocker"], position=(APART, 0.0), orientation=np.pi / 2)
    oil = film(10e-3, 10e-3, clearance, 0.05 * (clearance / 20e-6) ** 2, (24, 4))
    return Mechanism(
        {**links, "rocker": rocker, "ground": ground({"hook": (APART, 0.0)})},
        {
            "left": Revolute("ground", "crank"),
            "a": Revolute("crank.tip", "coupler"),
            "b": LubricatedJoint("rocker.tip", "coupler.tip", oil),
            "right": Revolute("ground.hook", "rocker"),
        },
        {"crank": Speed(TURNING)},
    )


def ideal_angles(time):
    """Of coupler and rocker, the rocker's tip above the line of centres."""
    turned = TURNING * time
    x, y = LINKS["crank"] * np.cos(turned), LINKS["crank"] * np.sin(turned)
    reach = np.hypot(APART - x, y)
    cosine = (LINKS["coupler"] ** 2 + reach**2 - LINKS["rocker"] ** 2) / (
        2 * LINKS["coupler"] * reach
    )
    coupler = np.arctan2(-y, APART - x) + np.arccos(cosine)
    x, y = x + LINKS["coupler"] * np.cos(coupler), y + LINKS["coupler"] * np.sin(coupler)
    return coupler, np.arctan2(y, x - APART)


def ideal_force(time, step=1e-5):
    """On the rocker in its joint with the coupler, from Newton's and Euler's laws, (2, steps)."""

    def centres(time):
        coupler, rocker = ideal_angles(time)
        x, y = LINKS["crank"] * np.cos(TURNING * time), LINKS["crank"] * np.sin(TURNING * time)
        half = {name: length / 2 for name, length in LINKS.items()}
        return np.array([
            x + half["coupler"] * np.cos(coupler), y + half["coupler"] * np.sin(coupler), coupler,
            APART + half["rocker"] * np.cos(rocker), half["rocker"] * np.sin(rocker), rocker,
        ])  # fmt: skip

    acceleration = (centres(time + step) - 2 * centres(time) + centres(time - step)) / step**2
    coupler, rocker = ideal_angles(time)
    # Moments about the coupler's joint with the crank and about the rocker's hinge.
    half = 0.5 * LINKS["coupler"]
    arm = np.array([np.cos(coupler), np.sin(coupler)])
    swung = INERTIAS["coupler"] * acceleration[2] + MASSES["coupler"] * half * (
        arm[0] * acceleration[1] - arm[1] * acceleration[0]
    )
    other = np.array([np.cos(rocker), np.sin(rocker)])
    held = INERTIAS["rocker"] + MASSES["rocker"] * (0.5 * LINKS["rocker"]) ** 2
    torque = np.array([-swung / LINKS["coupler"], held * acceleration[5] / LINKS["rocker"]])
    rows = np.array([[-arm[1], arm[0]], [-other[1], other[0]]])
    return np.linalg.solve(np.moveaxis(rows, 2, 0), torque.T[:, :, None])[:, :, 0].T


@pytest.mark.slow
def test_a_lubricated_four_bar_approaches_the_ideal_one_with_the_clearance():
    cycle = 2 * np.pi / TURNING
    angles, forces = [], []
    for clearance in (20e-6, 5e-6):
        result = simulate(four_bar(clearance), 1.5 * cycle, order=2)
        late = result.time > 0.5 * cycle
        time = result.time[late]
        angles.append(np.abs(result.bodies["rocker"][late, 2] - ideal_angles(time)[1]).max())
        force = ideal_force(time)
        missed = np.linalg.norm(result.joints["b"].force[late].T - force, axis=0).max()
        forces.append(missed / np.linalg.norm(force, axis=0).max())
    assert angles[0] / angles[1] == pytest.approx(4.0, rel=0.05)
    assert forces[1] < 0.005
    assert forces[1] < 0.5 * forces[0]


def test_the_order_of_the_list_does_not_matter():
    mechanism = slider_crank(rigid_rod(), *short_films())
    turned = replace(
        mechanism,
        bodies=dict(reversed(mechanism.bodies.items())),
        joints=dict(reversed(mechanism.joints.items())),
    )
    a, b = (simulate(m, 0.1 * REVOLUTION, tolerance=1e-4) for m in (mechanism, turned))
    assert a.time == pytest.approx(b.time, rel=1e-10)
    for name, joint in a.joints.items():
        other = b.joints[name]
        assert joint.min_film_thickness == pytest.approx(other.min_film_thickness, rel=1e-10)


def test_a_film_that_becomes_too_thin_ends_the_run_and_is_named():
    with pytest.raises(FilmTooThinError, match=r"film of big_end .* below smallest_film"):
        simulate(
            slider_crank(rigid_rod(), short_films()[0], smallest_film=0.9),
            REVOLUTION,
            tolerance=1e-3,
        )


def test_without_a_film_the_steps_follow_the_motion():
    ideal = slider_crank(rigid_rod(), short_films()[0])
    joints = {**ideal.joints, "big_end": Revolute("crank.pin", "rod")}
    errors = []
    for tolerance in (1e-4, 1e-6):
        result = simulate(replace(ideal, joints=joints), REVOLUTION, tolerance=tolerance, order=2)
        turned = 500.0 * result.time
        sine = 0.3 * np.sin(turned)
        exact = 0.048 * np.cos(turned) + 0.16 * np.sqrt(1 - sine**2)
        errors.append(np.abs(result.bodies["piston"][:, 0] - exact).max())
    # On position level the joints hold to the tolerance of Newton's method, whatever the steps.
    assert errors[0] < 1e-7
    assert errors[1] < 1e-9


def test_no_step_jumps_over_the_rows_of_a_table():
    # 200 kN between 56 and 57 degrees: with steps of any length the piston must feel them.
    angles = np.radians([0.0, 56.0, 56.5, 57.0, 360.0])
    spike = AngleTable(angles, np.array([0.0, 0.0, 2e3, 0.0, 0.0]))
    ideal = slider_crank(rigid_rod(), short_films()[0])
    forces = {"gas": PointForce("piston", (-1.0, 0.0), spike, "crank")}
    result = simulate(replace(ideal, forces=forces), 0.3 * REVOLUTION, tolerance=1e-3)
    turned = np.degrees(result.bodies["crank"][:, 2])
    for row in (56.0, 56.5, 57.0):
        assert np.abs(turned - row).min() < 1e-6
