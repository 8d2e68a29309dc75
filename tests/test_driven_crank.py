"""A crank under a torque, gas on the piston, friction of the film; tables over an angle."""

from dataclasses import replace

import attrs
import numpy as np
import pytest
from hand_made_rod import (
    CENTRE,
    CLEARANCE,
    CRANK,
    MASS,
    PISTON,
    RADIUS,
    REVOLUTION,
    ROD,
    SPEED,
    VISCOSITY,
    WIDTH,
    Joint,
    driven,
    flexible,
    gas,
    make_body,
    make_mechanism,
    run,
    torque,
    with_residual,
)
from hand_made_rod import INERTIA as INERTIA_OF_ROD
from hypothesis import given
from hypothesis import strategies as st
from scene_cases import RIGID_ROD, tables_of
from scipy.integrate import solve_ivp

import fenics_ehd as ehd
from fenics_ehd.base.plane import rotation
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.step_equations import film_friction
from fenics_ehd.scenes.scene import scene_of
from fenics_ehd.scenes.tables import read_angle_table

INERTIA, DAMPING = 2e-3, 0.01


def push(size=gas):
    """On the piston, towards the crank."""
    return ehd.PointForce("piston", (-1.0, 0.0), size, "crank")


def engine(joint, body, **settings):
    """Its crank is driven by `torque`, its piston by `gas`."""
    forces = {
        "torque": ehd.Torque("crank", curve=torque, damping=DAMPING, speed=SPEED),
        "gas": push(),
    }
    return driven(make_mechanism(body, joint, **settings), INERTIA, **forces)


@pytest.fixture(scope="module")
def joint():
    return Joint((10, 2))


# --- A driven crank in motion


def rigid_crank_angle(times):
    """Lead of the crank of a rigid mechanism whose rod has no mass, one degree of freedom."""

    def slopes(t, state):
        phi, speed = SPEED * t + state[0], SPEED + state[1]
        s, c = np.sin(phi), np.cos(phi)
        root = np.sqrt(ROD**2 - CRANK**2 * s**2)
        # x = r cos(phi) + sqrt(l^2 - r^2 sin(phi)^2)
        along = -CRANK * s - CRANK**2 * s * c / root
        curved = -CRANK * c - CRANK**2 * (c**2 - s**2) / root - (CRANK**2 * s * c) ** 2 / root**3
        moment = torque(phi)[0] + DAMPING * (SPEED - speed) - gas(phi)[0] * along
        gain = (moment - PISTON * along * curved * speed**2) / (INERTIA + PISTON * along**2)
        return [state[1], gain]

    return solve_ivp(slopes, (0, times[-1]), [0.0, 0.0], "DOP853", times, rtol=1e-11, atol=1e-12).y


def test_a_rod_without_mass_leaves_one_degree_of_freedom(figure):
    # A small clearance: of 17 um the shaft would stray by 8, 1e-4 of the crank's length.
    joint = Joint((8, 2), clearance=4e-6)
    body, worst = make_body(joint, masses=np.full(2, 1e-9)), []
    for tolerance in (1e-4, 1e-7):
        result = run(engine(joint, body), 0.3, tolerance)
        lead, gain = rigid_crank_angle(result.time)
        assert np.abs(gain).max() > 0.5 * SPEED, "the speed must change"
        found = result.bodies["crank"].coordinates[:, 2] - SPEED * result.time
        speed = result.bodies["crank"].rates[:, 2] / SPEED - 1
        worst.append([np.abs(found - lead).max(), np.abs(speed - gain / SPEED).max()])
    worst = np.array(worst)
    name = "driven crank, rod without mass: angle [rad], one textbook equation"
    figure("machines", name, worst[1].max(), most=3e-5)
    # Order 2 with the local error under control: tolerance^(2/3), a factor of 100.
    assert np.all(worst[0] / worst[1] > 20)


def test_energy_balance_of_a_flexible_rod_closes_with_the_tolerance(joint, figure):
    body = with_residual(joint, flexible(joint)[0])
    mechanism = engine(joint, body, friction=True)
    loose, tight = (run(mechanism, 0.02, t).summary()["energy_balance_error"] for t in (1e-3, 1e-5))
    name = "energy balance, driven crank, flexible rod, friction"
    figure("machines", name, tight, most=1e-3, unit="%")
    assert tight < loose / 3


# --- Friction


def test_crank_and_rod_receive_opposite_forces(joint):
    # Angular momentum of the crank about its bearing and of the rod about its pin, the film's
    # whole resultant on one the reverse of that on the other.
    mechanism = engine(joint, make_body(joint), friction=True)
    end = 0.05 * REVOLUTION
    going = Run(mechanism, IntegratorOptions(tolerance=1e-6, largest=0.4), end)
    system = going.equations.system
    place = system.films[0]
    for number, step in enumerate(going.until(end)):
        if number < 20 or number % 10:
            continue
        (film,) = step.solution.films
        friction = film_friction(place.film, film)
        crank, rod = (step.x[system.bodies[name]] for name in ("crank", "rod"))
        turn = rotation(rod[2])
        on_shaft = turn @ (place.film.load[:2] @ film.pressure + friction.on_xi[:2])
        lever = CRANK * np.array([-np.sin(crank[2]), np.cos(crank[2])])
        drive = torque(crank[2])[0] + DAMPING * (SPEED - step.rate[system.bodies["crank"]][2])
        parts = [drive, friction.torque, lever @ on_shaft]
        gained = INERTIA * step.acceleration[system.bodies["crank"]][2]
        assert gained == pytest.approx(sum(parts), abs=2e-5 * np.abs(parts).sum())
        # About the pin, which the piston takes along the cylinder.
        swung, pushed = (step.acceleration[system.bodies[n]] for n in ("rod", "piston"))
        arm, centre = turn @ np.array([ROD, 0.0]), turn @ np.array([CENTRE - ROD, 0.0])
        inertia = INERTIA_OF_ROD + MASS * (ROD - CENTRE) ** 2
        gained = inertia * swung[2] - MASS * centre[1] * pushed[0]
        shaft = turn @ step.x[place.xi[:2]] - arm
        parts = [-shaft[0] * on_shaft[1], shaft[1] * on_shaft[0], -friction.torque]
        assert gained == pytest.approx(sum(parts), abs=1e-4 * np.abs(parts).sum())


def test_friction_brakes_a_free_crank(joint, figure):
    # Hardly any mass but the crank's: it can turn and heat the oil, after Petroff.
    body = make_body(joint, masses=np.full(2, 1e-6))
    mechanism = driven(make_mechanism(body, joint, friction=True), INERTIA)
    light = attrs.evolve(mechanism.bodies["piston"], mass=1e-5)
    result = run(replace(mechanism, bodies={**mechanism.bodies, "piston": light}), 0.2, 1e-5)
    speed = result.bodies["crank"].rates[-1, 2]
    sliding = speed - result.bodies["rod"].rates[-1, 2]
    area = 2 * np.pi * RADIUS * WIDTH
    petroff = VISCOSITY * sliding * (RADIUS - CLEARANCE) ** 2 * area / CLEARANCE
    # Braking is positive.
    braking = result.columns["friction_torque_Nm"][-1]
    error = abs(braking / petroff - 1)
    figure("machines", "friction torque of a free crank after Petroff", error, most=1e-2, unit="%")
    assert result.columns["friction_power_W"][-1] == pytest.approx(braking * sliding)
    lost = 0.5 * INERTIA * (SPEED**2 - speed**2)
    assert lost == pytest.approx(result.columns["film_work_J"][-1], rel=1e-2)


# --- Tables


FORCE = {"force": {"N": 1.0}}


def table(angles, values):
    rows = "\n".join(f"{a},{v}" for a, v in zip(angles, values, strict=True))
    return f"# a comment\nangle_deg,force_N\n{rows}\n"


@pytest.mark.parametrize(("first", "period"), [(0, 360), (-180, 360), (0, 720), (-360, 720)])
def test_tables_repeat_with_two_or_four_strokes(tmp_path, first, period):
    path = tmp_path / "gas.csv"
    angles = np.linspace(first, first + period, period // 5 + 1)
    wave = 2 * np.pi / period
    path.write_text(table(angles, np.cos(wave * angles)))
    force = read_angle_table(path, "mechanism.gas_force", FORCE)
    assert force.period == pytest.approx(np.radians(period))
    for degrees in (13.0, 377.0, 733.0, -1000.0):
        value, along = force(np.radians(degrees))
        assert value == pytest.approx(np.cos(wave * degrees), abs=1e-6)
        assert along == pytest.approx(-np.degrees(wave) * np.sin(wave * degrees), abs=1e-4)
        once_more = force(np.radians(degrees + 360))[0]
        assert (abs(once_more - value) < 1e-9) == (period == 360)


@given(st.lists(st.integers(-9, 9), min_size=3, max_size=9), st.sampled_from([360, 720]))
def test_curves_through_tables_do_not_overshoot_the_rows(tmp_path_factory, values, period):
    path = tmp_path_factory.mktemp("table") / "gas.csv"
    angles = np.linspace(0, period, len(values) + 1)
    rows = np.array([*values, values[0]], dtype=float)
    path.write_text(table(angles, rows))
    force = read_angle_table(path, "mechanism.gas_force", FORCE)
    fine = np.array([force(np.radians(a)) for a in np.linspace(0, period, 12 * len(values) + 1)])
    for before, after, curve in zip(rows[:-1], rows[1:], fine[:-1, 0].reshape(-1, 12), strict=True):
        assert curve.max() <= max(before, after) + 1e-9
        assert curve.min() >= min(before, after) - 1e-9


# --- Scenes


def test_a_scene_reaches_the_mechanism(tmp_path):
    path = tmp_path / "gas.csv"
    angles = np.linspace(0, 720, 73)
    path.write_text(table(angles, 2e3 + 1e3 * np.cos(np.radians(0.5 * angles))))
    drive = {"kind": "torque", "torque": 10.0, "damping": 0.02}
    push = {
        "kind": "angle-table", "point": "piston", "direction": [-1.0, 0.0], "angle_of": "crank",
        "file": str(path),
    }  # fmt: skip
    changes = {
        "bodies.crank.speed": SPEED, "drives.crank": drive, "forces.gas": push,
        "joints.big_end.friction": True, "time.revolutions": 0.01, "time.tolerance": 1e-4,
    }  # fmt: skip
    scene = scene_of(tables_of("slider-crank-paper", {**RIGID_ROD, **changes}), "engine")
    built = ehd.build(scene)
    result = ehd.simulate(built.mechanism, built.end, **vars(built.steps))
    crank, piston = (result.bodies[name].rates for name in ("crank", "piston"))
    turned, speed = result.bodies["crank"].coordinates[:, 2], crank[:, 2]
    assert turned[-1] == pytest.approx(0.01 * 2 * np.pi, rel=0.01)
    # Joints are closed by what moves, the crank's speed is kept.
    assert speed[0] == pytest.approx(SPEED, rel=1e-5)
    assert speed[-1] != SPEED
    assert result.columns["friction_torque_Nm"][-1] > 0
    # Drive and gas feed in what they do along the way.
    size = 2e3 + 1e3 * np.cos(0.5 * turned)
    power = (10.0 - 0.02 * speed) * speed - size * piston[:, 0]
    work = 0.5 * (power[1:] + power[:-1]) @ np.diff(result.time)
    assert result.columns["applied_work_J"][-1] == pytest.approx(work, rel=1e-3)
