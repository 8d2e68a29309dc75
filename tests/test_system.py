"""Bodies, joints and forces: exact derivatives, textbook motion, what cannot be assembled."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mechanism_cases import film
from scipy.integrate import solve_ivp

import fenics_ehd as ehd
from fenics_ehd.multibody.mechanism import Instant, Motion, System, assemble


def wave(angle):
    return np.sin(angle), np.cos(angle)


def everything(rod_body):
    """A mechanism of every kind of body, joint, drive and force; it need not be possible."""
    crank = ehd.RigidBody(1.0, 1e-3, {"pin": (0.05, 0.01)}, centre=(0.01, 0.002))
    shaft = {"density": 7446.0, "elements": 6, "modes": 6, "disks": [(0.5, 0.8, 1e-3, 5e-4)]}
    return ehd.Mechanism(
        bodies={
            "ground": ehd.ground({"hook": (0.1, 0.2)}),
            "crank": crank,
            "rod": ehd.FlexibleBody(rod_body, 1e-3),
            "heavy": ehd.FlexibleBody(rod_body, 1e-3, mass=2.0, inertia=5e-3, centre=(0.07, 0.0)),
            "piston": ehd.RigidBody(0.5, 2e-3),
            "shaft": ehd.ShaftBody(**shaft, points={"middle": 0.5, "end": 0.9}),
        },
        joints={
            "main": ehd.Revolute(("ground.hook", "crank")),
            "big": ehd.Revolute(("crank.pin", "rod.bore")),
            "gudgeon": ehd.Revolute(("rod.pin", "piston")),
            "glued": ehd.Fixed(("heavy.pin", "piston"), np.degrees(0.3)),
            "cylinder": ehd.Slider("crank", "piston", (1.0, 0.3), angle=np.degrees(0.1)),
            "slot": ehd.Slider("ground", "rod.pin", hold_rotation=False),
        },
        drives={"crank": ehd.Speed(500.0, 0.2), "shaft": ehd.Speed(600.0)},
        forces={
            "spring": ehd.SpringDamper(("rod.pin", "ground.hook"), 1e3, 10.0),
            "motor": ehd.Torque("rod", curve=wave, damping=0.1, speed=3.0),
            "gas": ehd.PointForce("rod.pin", (1.0, 1.0), wave, "crank"),
            "unbalance": ehd.RotatingForce("shaft.end", 10.0, 600.0, 0.2),
            "off axis": ehd.Unbalance("shaft.middle", 3e-3, 40.0),
        },
        gravity=(0.3, -9.81),
    )


def differences(function, x, step=1e-3):
    """Central differences of fourth order, shape (..., n).

    Steps are long, or round-off of forces 1e9 times as large would be what is seen.
    """
    columns = []
    for h in step * np.eye(len(x)):
        near = function(x + h) - function(x - h)
        far = function(x + 2 * h) - function(x - 2 * h)
        columns.append((8 * near - far) / (12 * step))
    return np.stack(columns, axis=-1)


@pytest.fixture(scope="module")
def system(rod_body):
    return System(everything(rod_body))


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=5)
def test_every_derivative_is_exact(system, seed):
    rng = np.random.default_rng(seed)
    # Elastic coordinates are small, or their stiffness drowns the rest in round-off.
    size = np.where(system.weights == 1.0, 1.0, 1e-6)
    z, v, a = (rng.normal(size=system.n) * size for _ in range(3))
    multipliers = rng.normal(size=system.m)

    def residual(z, v, a):
        return Motion(Instant(system, 0.1, z), v, a, multipliers).residual

    instant = Instant(system, 0.1, z)
    motion = Motion(instant, v, a, multipliers)
    exact = motion.derivatives()
    found = {
        "position": (differences(lambda x: residual(x, v, a), z), exact.position),
        "rate": (differences(lambda x: residual(z, x, a), v), exact.rate),
        # Linear: any step will do.
        "acceleration": (differences(lambda x: residual(z, v, x), a, 1.0), exact.acceleration),
        "jacobian": (differences(lambda x: Instant(system, 0.1, x).defect, z), instant.jacobian),
        "carry": (
            differences(lambda x: Instant(system, 0.1, x).rate_defect(v), z),
            motion.carried[1],
        ),
        "bend": (
            differences(lambda x: multipliers @ Instant(system, 0.1, x).jacobian, z),
            instant.force_derivative(multipliers),
        ),
    }
    for name, (difference, derivative) in found.items():
        # Row by row: forces on frames are next to elastic ones that are 1e9 times as large.
        largest = np.abs(difference).max(axis=1, keepdims=True)
        error = np.abs(derivative - difference) / np.maximum(largest, 1e-3)
        assert error.max() < 1e-7, name


def test_a_pendulum_swings_as_its_differential_equation_says():
    mass, inertia, length, gravity = 2.0, 0.01, 0.3, 9.81
    rod = ehd.RigidBody(mass, inertia, centre=(length, 0.0), angle=np.degrees(0.4))
    mechanism = ehd.Mechanism(
        {"rod": rod}, {"hinge": ehd.Revolute(("ground", "rod"))}, gravity=(0.0, -gravity)
    )
    result = ehd.simulate(mechanism, 2.0, tolerance=1e-7)
    about_hinge = inertia + mass * length**2
    exact = solve_ivp(
        lambda t, y: [y[1], -mass * gravity * length * np.cos(y[0]) / about_hinge],
        (0.0, 2.0), [0.4, 0.0], "DOP853", result.time, rtol=1e-11, atol=1e-12,
    )  # fmt: skip
    assert result.bodies["rod"].coordinates[:, 2] == pytest.approx(exact.y[0], abs=3e-4)
    assert result.summary()["energy_balance_error"] < 1e-4
    # The hinge stays closed: positions are not only differentiated.
    assert np.abs(result.bodies["rod"].coordinates[:, :2]).max() < 1e-12


@pytest.mark.parametrize(
    ("bodies", "joints", "drives", "message"),
    [
        ({}, {"a": ehd.Revolute(("ground", "wheel"))}, {}, "a.between: there is no body 'wheel'"),
        ({}, {"a": ehd.Revolute(("ground.hook", "rod"))}, {}, "no point 'hook', it has none but"),
        ({}, {"a": ehd.Revolute(("rod.hook", "ground"))}, {}, "rod has no point 'hook'"),
        ({}, {"a": ehd.Revolute(("ground", "rod"))}, {"wheel": ehd.Speed(1.0)}, "drives.wheel: th"),
        ({}, {"a": ehd.Revolute(("ground", "rod"))}, {"ground": ehd.Speed(1.0)}, "cannot turn"),
        (
            {},
            {"a": ehd.Revolute(("ground", "rod")), "b": ehd.Fixed(("ground", "rod"))},
            {},
            "repeats or contradicts",
        ),
        (
            {
                "far": ehd.ground({"hook": (0.3, 0.0)}),
                "link": ehd.RigidBody(1.0, 1e-3, {"tip": (0.1, 0.0)}, angle=np.degrees(2.0)),
            },
            {
                "a": ehd.Revolute(("ground", "rod")),
                "b": ehd.Revolute(("far.hook", "link")),
                "c": ehd.Revolute(("rod.tip", "link.tip")),
            },
            {},
            "cannot be assembled",
        ),
        (
            {},
            {"a": ehd.Revolute(("ground", "ground"))},
            {},
            "connects only bodies that cannot move",
        ),
        # A parallelogram with all its bars in a line: which way it folds is not known.
        (
            {
                "side": ehd.ground({"hook": (0.25, 0.0)}),
                "coupler": ehd.RigidBody(1.0, 1e-3, {"tip": (0.25, 0.0)}, position=(0.1, 0.0)),
                "other": ehd.RigidBody(1.0, 1e-3, {"tip": (0.1, 0.0)}, position=(0.25, 0.0)),
            },
            {
                "left": ehd.Revolute(("ground", "rod")),
                "a": ehd.Revolute(("rod.tip", "coupler")),
                "b": ehd.Revolute(("coupler.tip", "other.tip")),
                "right": ehd.Revolute(("side.hook", "other")),
            },
            {"rod": ehd.Speed(1.0)},
            "a linkage at a change point has to be assembled in another position",
        ),
    ],
)
def test_what_cannot_be_assembled_is_named(bodies, joints, drives, message):
    rod = ehd.RigidBody(1.0, 1e-3, {"tip": (0.1, 0.0)})
    with pytest.raises(ehd.errors.SettingsError, match=message):
        assemble(System(ehd.Mechanism({"rod": rod, **bodies}, joints, drives)))


def run(bodies, joints, drives=(), forces=()):
    ehd.simulate(ehd.Mechanism(bodies, joints, dict(drives), dict(forces)), 1e-3, tolerance=1e-3)


def test_a_motion_without_inertia_is_named():
    wheel, hinge = {"wheel": ehd.MasslessBody()}, {"hinge": ehd.Revolute(("ground", "wheel"))}
    message = "body wheel can move or turn freely without inertia"
    with pytest.raises(ehd.errors.SettingsError, match=message):
        run(wheel, hinge)
    with pytest.raises(ehd.errors.SettingsError, match=message):
        run(wheel, hinge, forces={"motor": ehd.Torque("wheel", torque=1.0)})
    oil = film(10e-3, 10e-3, 2e-5, 0.05, (12, 2))
    with pytest.raises(ehd.errors.SettingsError, match=message):
        run(wheel, {"bearing": ehd.LubricatedJoint("wheel", "ground", oil)})
    # A drive holds it, and a damper.
    run(wheel, hinge, drives={"wheel": ehd.Speed(1.0)})
    run(wheel, hinge, forces={"brake": ehd.Torque("wheel", damping=1.0)})


def test_a_table_of_a_scene_is_none_of_a_mechanism():
    for loads in (
        {"drives": {"wheel": ehd.Speed(table="speed.csv")}},
        {"forces": {"motor": ehd.Torque("wheel", table="torque.csv")}},
    ):
        with pytest.raises(ehd.errors.SettingsError, match=r"only for scenes: .* a curve"):
            run({"wheel": ehd.RigidBody(1.0, 1e-3)}, {}, **loads)


def test_a_drive_that_gives_no_number_is_named():
    bodies = {"wheel": ehd.RigidBody(1.0, 1e-3)}
    hinge = {"hinge": ehd.Revolute(("ground", "wheel"))}
    with pytest.raises(ehd.errors.SettingsError, match=r"drive of wheel: .* finite numbers"):
        run(bodies, hinge, drives={"wheel": lambda time: (np.nan, 0.0)})


def test_bodies_take_numbers_of_numpy():
    given = ehd.RigidBody(
        np.float32(2.0), np.int64(1), {"tip": np.array([0.1, 0])}, position=np.array([0, 0.5])
    )
    assert given == ehd.RigidBody(2.0, 1.0, {"tip": (0.1, 0.0)}, position=(0.0, 0.5))


def test_a_run_is_replayed_by_a_mechanism_of_other_constraints():
    bodies = {"wheel": ehd.RigidBody(1.0, 1e-3)}
    hinge = {"hinge": ehd.Revolute(("ground", "wheel"))}
    driven = ehd.Mechanism(bodies, hinge, {"wheel": ehd.Speed(10.0)})
    history = ehd.simulate(driven, 1e-2, tolerance=1e-3)
    again = ehd.replay(history, ehd.Mechanism(bodies, hinge, {}, {"it": ehd.Torque("wheel")}))
    assert again["wheel.angle"][-1] == pytest.approx(0.1, rel=1e-9)  # it continues


@pytest.mark.parametrize("degrees", range(0, 360, 10))
def test_a_crank_is_assembled_at_any_angle(degrees):
    """The line of the cylinder moves with the piston: what turns it is round-off of zero."""
    at = np.radians(degrees)
    pin = 0.05 * np.array([np.cos(at), np.sin(at)])
    piston = pin[0] + np.sqrt(0.2**2 - pin[1] ** 2)
    tables = {
        "bodies": {
            "crank": {"kind": "rigid", "mass": 1.0, "inertia": 1e-3, "points": {"pin": [0.05, 0]},
                      "angle": float(degrees)},
            "rod": {"kind": "rigid", "mass": 1.0, "inertia": 1e-3, "points": {"pin": [0.2, 0]},
                    "position": pin.tolist(), "angle": float(np.degrees(-np.arcsin(pin[1] / 0.2)))},
            "piston": {"kind": "rigid", "mass": 0.5, "inertia": 1e-3, "position": [piston, 0.0]},
        },
        "joints": {
            "main": {"kind": "revolute", "between": ["ground", "crank"]},
            "big": {"kind": "revolute", "between": ["crank.pin", "rod"]},
            "small": {"kind": "revolute", "between": ["rod.pin", "piston"]},
            "cylinder": {"kind": "slider", "line": "piston", "point": "ground"},
        },
        "drives": {"crank": {"kind": "speed", "speed": 300.0}},
        "time": {"revolutions": 1.0},
    }  # fmt: skip
    placed = ehd.build(ehd.read_scene(tables)).mechanism.bodies["piston"]
    assert placed.position == pytest.approx((piston, 0.0), abs=1e-9)


def test_joints_that_cannot_be():
    with pytest.raises(ehd.errors.SettingsError, match=r"direction = .* one of them not 0"):
        ehd.Slider("ground", "rod", (0.0, 0.0))
    with pytest.raises(ehd.errors.SettingsError, match=r"points\.x = .* two finite numbers"):
        ehd.ground({"x": (np.nan, 0.0)})
    oil = film(10e-3, 10e-3, 2e-5, 0.05, (12, 2))
    bodies = {name: ehd.RigidBody(1.0, 1e-3, {"tip": (0.1, 0.0)}) for name in ("one", "other")}
    with pytest.raises(
        ehd.errors.SettingsError, match=r"joints.b.bore = 'ground' is the bore of joints.a already"
    ):
        run(
            bodies,
            {n: ehd.LubricatedJoint(j, "ground", oil) for n, j in zip("ab", bodies, strict=True)},
        )
    with pytest.raises(ehd.errors.SettingsError, match=r"one and one\.tip are points of one"):
        run(bodies, {"a": ehd.LubricatedJoint("one", "one.tip", oil)})
    with pytest.raises(ehd.errors.SettingsError, match=r"eccentricity = 1.5 of the clear"):
        ehd.LubricatedJoint("one", "ground", oil, eccentricity=(3e-5, 0.0))


def four_bar(**changes):
    """Crank, coupler and rocker of a Grashof linkage, its links 0.1, 0.25, 0.2 and 0.25 m."""
    links = {
        name: ehd.RigidBody(1.0, 1e-3, {"tip": (length, 0.0)}, **changes.get(name, {}))
        for name, length in (("crank", 0.1), ("coupler", 0.25), ("rocker", 0.2))
    }
    return ehd.Mechanism(
        {**links, "ground": ehd.ground({"hook": (0.25, 0.0)})},
        {
            "left": ehd.Revolute(("ground", "crank")),
            "a": ehd.Revolute(("crank.tip", "coupler")),
            "b": ehd.Revolute(("coupler.tip", "rocker.tip")),
            "right": ehd.Revolute(("ground.hook", "rocker")),
        },
        {"crank": ehd.Speed(10.0, np.pi / 2)},
    )


@pytest.mark.parametrize("above", [True, False])
def test_a_loop_is_assembled_on_the_branch_that_the_rough_pose_says(above):
    rough = {"angle": 90.0 if above else -90.0, "position": (0.25, 0.0)}
    system = System(four_bar(rocker=rough))
    z, v = assemble(system)
    instant = Instant(system, 0.0, z)
    assert np.abs(instant.defect).max() < 1e-11
    assert np.abs(instant.rate_defect(v)).max() < 1e-11
    # The rocker's tip is where circles about its hinge and about the crank's tip meet.
    _, _, angle = z[system.bodies["rocker"]]
    tip = np.array([0.25, 0.0]) + 0.2 * np.array([np.cos(angle), np.sin(angle)])
    assert np.hypot(*(tip - [0.0, 0.1])) == pytest.approx(0.25, abs=1e-11)
    assert (0.25 * (tip[1] - 0.1) + 0.1 * tip[0] > 0) == above
    assert v[system.bodies["crank"]][2] == pytest.approx(10.0)
