"""A crank under a torque, gas on the piston, friction of the film."""

from itertools import pairwise

import attrs
import numpy as np
import pytest
from differences import slope
from hand_made_rod import (
    CLEARANCE,
    CRANK,
    PIN,
    PISTON,
    RADIUS,
    REVOLUTION,
    ROD,
    SPEED,
    VISCOSITY,
    WIDTH,
    Joint,
    fields_at,
    flexible,
    make_body,
    pressure_work,
    some_state,
)
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from test_coupled_steps import dense, film_of, with_residual

from fenics_ehd.errors import SettingsError
from fenics_ehd.film.forces import film_forces
from fenics_ehd.film.kinematics import ShaftMotion
from fenics_ehd.multibody.bdf import StepControl, integrate
from fenics_ehd.multibody.coupled import CoupledSteps
from fenics_ehd.multibody.coupled_equations import CoupledEquations
from fenics_ehd.multibody.crank import ConstantSpeedCrank, DrivenCrank
from fenics_ehd.multibody.energy import EnergyBalance
from fenics_ehd.multibody.friction import film_friction
from fenics_ehd.multibody.newton import ImplicitStep
from fenics_ehd.plane import rotation
from fenics_ehd.scenes import slider_crank
from fenics_ehd.scenes.angle_table import read_angle_table
from fenics_ehd.scenes.drive import build_crank
from fenics_ehd.scenes.run import Totals, simulate
from fenics_ehd.scenes.slider_crank import SliderCrank
from fenics_ehd.scenes.slider_crank_settings import (
    BigEndFilm,
    Mechanism,
    SliderCrankSettings,
    Time,
)
from fenics_ehd.settings import build

INERTIA, DAMPING = 2e-3, 0.01


def torque(angle):
    """An engine of two strokes, say."""
    return 3 + 2 * np.cos(2 * angle), -4 * np.sin(2 * angle)


def gas(angle):
    return 4e3 * (1 + np.cos(angle - 0.4)), -4e3 * np.sin(angle - 0.4)


def driven(inertia=INERTIA):
    return DrivenCrank(CRANK, SPEED, inertia, torque, DAMPING)


def steady():
    return ConstantSpeedCrank(CRANK, SPEED)


def machine(joint, body, crank, *, friction=False, gas_force=gas):
    return SliderCrank(
        crank, body, joint.film, PISTON, 1e-3, gas_force=gas_force, friction=friction
    )


@pytest.fixture(scope="module")
def joint():
    return Joint((10, 2))


def run(mechanism, tolerance, revolutions):
    """Accepted steps, their powers and the energy balance."""
    control = StepControl(tolerance, 1e-8, 1e-13, REVOLUTION / 50)
    rest = np.zeros(mechanism.size)
    balance = EnergyBalance(0.0, mechanism.initial_powers())
    steps = []
    for step in integrate(
        mechanism, (0.0, revolutions * REVOLUTION), rest, rest, control, CoupledSteps(mechanism)
    ):
        # At once: the film's losses are those of its last solve.
        balance.add(step.time, mechanism.powers(step.x, step.rate, step.auxiliary))
        steps.append(step)
    return steps, balance


# --- The equations


def free_state(seed):
    """`some_state` and a crank that leads, gains and is accelerated."""
    rng = np.random.default_rng(100 + seed)
    lead = rng.uniform(-1, 1, 3) * [2.0, 100.0, 1e5]
    return tuple(
        np.append(values, more) for values, more in zip(some_state(seed), lead, strict=True)
    )


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_residual_is_the_virtual_work_of_explicitly_moved_points(joint, seed):
    # The angles of rod and crank as functions of all coordinates, no formula shared.
    body, masses, points, modes = flexible(joint)
    x, rate, acceleration = free_state(seed)
    time = 1e-3 * seed
    fields = fields_at(np.vstack([points, PIN, joint.bore_nodes]), modes)
    weights = np.append(masses, PISTON)
    heavy = slice(0, len(weights))

    def phi(t, xi):
        return SPEED * t + xi[-1]

    def c1(t, xi):
        return CRANK * np.array([np.cos(phi(t, xi)), np.sin(phi(t, xi)), 0.0])

    def turned(angle):
        whole = np.eye(3)
        whole[:2, :2] = rotation(angle)
        return whole

    def theta(t, xi):
        pin = fields[len(points)] @ np.append(1.0, xi[:-1])
        return brentq(lambda a: c1(t, xi)[1] + (turned(a) @ pin)[1], -1, 1, xtol=1e-15)

    def places(t, xi):
        return c1(t, xi) + fields @ np.append(1.0, xi[:-1]) @ turned(theta(t, xi)).T

    def path(s):
        return x + s * rate + 0.5 * s**2 * acceleration

    def along_path(s):
        return slope(lambda h: places(time + h, path(h))[heavy], s, step=2e-5)

    moved = np.stack(
        [slope(lambda h, u=u: places(time, x + h * u), step=1e-3) for u in np.eye(len(x))], axis=2
    )
    inertia = np.einsum("k,kc,kcj->j", weights, slope(along_path, step=2e-5), moved[heavy])
    # The film pushes the shaft too, whose centre is carried by the crank.
    carried = np.stack(
        [slope(lambda h, u=u: c1(time, x + h * u), step=1e-3) for u in np.eye(len(x))], 1
    )
    relative = moved[len(weights) :] - carried
    pressure = 2e7 * np.random.default_rng(seed).uniform(0, 1, joint.film.assembly.size)
    in_rod = np.einsum("ci,kcj->kij", turned(theta(time, x)), relative)
    load = pressure_work(joint, in_rod) @ pressure
    elastic = np.zeros(len(x))
    elastic[2:-1] = body.stiffness @ (x + 1e-3 * rate)[2:-1]
    applied = -gas(phi(time, x))[0] * moved[len(points), 0]
    applied[-1] += torque(phi(time, x))[0] - DAMPING * rate[-1] - INERTIA * acceleration[-1]
    expected = inertia - load + elastic - applied
    mechanism = machine(joint, body, driven())
    found = mechanism.equations(time, x, rate, acceleration, (2e3, 4e6), pressure).residual
    size = np.abs(inertia) + np.abs(load) + np.abs(elastic) + np.abs(applied)
    assert np.all(np.abs(found - expected) <= 1e-6 * size)


@pytest.mark.parametrize("crank", [steady, driven])
@pytest.mark.parametrize("shifts", [(0.0, 0.0), (2e3, 4e6)])
@pytest.mark.parametrize("seed", [1, 2])
def test_derivatives_of_the_mechanism_equal_central_differences(joint, crank, shifts, seed):
    mechanism = machine(joint, flexible(joint)[0], crank())
    n = mechanism.journal.coordinates
    state = [values[:n] for values in free_state(seed)]
    pressure = 2e7 * np.random.default_rng(seed).uniform(0, 1, joint.film.assembly.size)

    def at(change):
        follow = [a + f * change for a, f in zip(state, (1.0, *shifts), strict=True)]
        return mechanism.equations(1.3e-3, *follow, shifts, pressure)

    here = at(np.zeros(n))
    assert here.shear is None
    steps = np.append(np.full(6, 1e-6), 1e-3)[:n] / (1 + 1e-2 * shifts[0])

    def columns(name):
        return np.stack(
            [
                slope(lambda h, u=u: getattr(at(h * u), name), step=d)
                for d, u in zip(steps, np.eye(n), strict=True)
            ],
            axis=-1,
        )

    residual, speed = columns("residual"), columns("shaft_rate")
    size = np.abs(np.diag(residual))
    assert np.all(np.abs(here.slope - residual) <= 1e-8 * np.sqrt(np.outer(size, size)))
    assert here.shaft_rate_slope == pytest.approx(speed, abs=1e-8 * np.abs(speed).max())


@pytest.mark.parametrize("residual", [False, True])
@pytest.mark.parametrize("family", ["lagrange", "serendipity"])
def test_derivatives_with_the_film_equal_central_differences(family, residual):
    joint = Joint()
    body = flexible(joint)[0]
    if residual:
        body = with_residual(joint, body)
    joint.film = film_of(joint, family)
    mechanism = machine(joint, body, driven())
    equations = CoupledEquations(mechanism, dense_patterns=True)
    rng = np.random.default_rng(0)
    scale = np.full(mechanism.size, 1e-6)
    scale[: mechanism.journal.coordinates] = [5e-6, 5e-6, *[1e-6] * 4, 1.0]
    scale[mechanism.journal.coordinates :] = 1e6
    past = [factor * scale * rng.uniform(-1, 1, len(scale)) for factor in (1e3, 1e7)]
    x = scale * rng.uniform(-1, 1, len(scale))
    equations.begin(ImplicitStep(1.3e-3, 2e3, *past, x, x, (np.ones(1), np.ones(1)), 1e-7))
    pressure = 3e7 * rng.uniform(0, 1, equations.film.assembly.size)
    start = equations.unknowns(pressure, x[: equations.n])
    full = np.arange(equations.m)
    matrix = dense(
        equations.linearise(equations.evaluate(start)), equations.film.assembly.pattern, full
    )

    def function(h):
        point = equations.evaluate(start + h * direction)
        return np.concatenate([point.film, point.motion])

    for direction in (*rng.uniform(-1, 1, (3, len(start))), np.eye(len(start))[-1]):
        found, expected = matrix @ direction, slope(function, step=1e-5)
        for part in (slice(0, equations.m), slice(equations.m, None)):
            size = (np.abs(matrix) @ np.abs(direction))[part].max()
            np.testing.assert_allclose(found[part], expected[part], atol=1e-8 * size)


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
    # The shaft strays from the bore's centre by 8 um, 1e-4 of the crank's length.
    joint = Joint((8, 2))
    body, worst = make_body(joint, masses=np.zeros(2)), []
    for tolerance in (1e-4, 1e-6):
        steps, _ = run(machine(joint, body, driven()), tolerance, 0.3)
        lead, gain = rigid_crank_angle(np.array([step.time for step in steps]))
        assert np.abs(gain).max() > 0.5 * SPEED, "the speed must change"
        found = np.array([[step.x[-1], step.rate[-1] / SPEED] for step in steps])
        worst.append(np.abs(found - np.column_stack([lead, gain / SPEED])).max(axis=0))
    name = "driven crank, rod without mass: angle [rad], one textbook equation"
    figure("machines", name, worst[1].max(), most=3e-4)
    # Order 2 with the local error under control: tolerance^(2/3), a factor of 20.
    assert np.all(worst[0] / worst[1] > 8)


def test_a_heavy_crank_turns_as_at_constant_speed(joint):
    body = flexible(joint)[0]
    ends = [
        run(machine(joint, body, crank), 1e-5, 0.02)[0][-1].x[:2]
        for crank in (steady(), driven(1.0), driven(10.0), driven(100.0))
    ]
    distance = [np.abs(end - ends[0]).max() / CLEARANCE for end in ends[1:]]
    assert distance[0] < 1e-2
    for heavier, lighter in pairwise(reversed(distance)):
        assert lighter / heavier == pytest.approx(10, rel=0.1)


@pytest.mark.parametrize("friction", [False, True])
@pytest.mark.parametrize("crank", [steady, driven])
def test_energy_balance_closes_with_the_tolerance(joint, crank, friction):
    body = make_body(joint)
    loose, tight = (
        run(machine(joint, body, crank(), friction=friction), tolerance, 0.04)[1].error
        for tolerance in (1e-4, 1e-6)
    )
    assert loose < 3e-3
    assert tight < loose / 5


def test_energy_balance_of_a_flexible_rod_closes_with_the_tolerance(joint, figure):
    body = with_residual(joint, flexible(joint)[0])
    loose, tight = (
        run(machine(joint, body, driven(), friction=True), tolerance, 0.02)[1].error
        for tolerance in (1e-3, 1e-5)
    )
    name = "energy balance, driven crank, flexible rod, friction"
    figure("machines", name, tight, most=1e-3, unit="%")
    assert tight < loose / 3


def test_gas_does_its_work_on_the_piston(joint):
    # Constant force: its work is force times travel.
    body = make_body(joint)
    push = 2e3
    steps, balance = run(machine(joint, body, steady(), gas_force=lambda _: (push, 0.0)), 1e-5, 0.1)
    phi = SPEED * steps[-1].time
    place = CRANK * np.cos(phi) + np.sqrt(ROD**2 - CRANK**2 * np.sin(phi) ** 2)
    assert balance.work["gas"] == pytest.approx(push * (CRANK + ROD - place), rel=2e-3)


# --- Friction


def test_friction_is_that_of_the_two_walls(joint):
    # A rigid bore: the wrenches that the film itself adds up.
    mechanism = machine(joint, make_body(joint), driven(), friction=True)
    step = run(mechanism, 1e-4, 0.05)[0][-1]
    film, known = step.auxiliary.film, step.auxiliary.mechanism
    friction = film_friction(mechanism.journal, film)
    speed = known.crank.speed - known.angle.rate
    motion = ShaftMotion(-step.x[:2], speed, -step.rate[:2])
    forces = film_forces(joint.film, film, motion)
    assert friction.torque == pytest.approx(forces.friction_torque, rel=2e-3)
    # The resultants differ by int h dp/dy t dA.
    between = forces.shear_on_bore.force + forces.shear_on_shaft.force
    assert friction.on_xi[:2] == pytest.approx(
        forces.shear_on_bore.force - between, abs=1e-9 * np.abs(forces.on_bore.force).max()
    )
    assert np.abs(between).max() < 3e-3 * np.abs(forces.on_bore.force).max()
    dissipated = joint.film.powers(film)[0] + friction.sheared
    assert dissipated == pytest.approx(forces.dissipation, rel=1e-10)


def test_crank_and_rod_receive_opposite_forces(joint):
    # The crank's own angular momentum, with the film's whole resultant on the rod reversed.
    mechanism = machine(joint, make_body(joint), driven(), friction=True)
    for step in run(mechanism, 1e-6, 0.05)[0][20::10]:
        known, film = step.auxiliary.mechanism, step.auxiliary.film
        friction = film_friction(mechanism.journal, film)
        on_rod = mechanism.journal.resultant(film.pressure) + friction.on_xi[:2]
        lever = known.crank.along.position
        through_pin = -lever @ rotation(known.angle.angle) @ on_rod
        drive = mechanism.crank.moment(known.crank)[0]
        expected = drive + friction.torque + through_pin
        size = abs(drive) + abs(friction.torque) + abs(through_pin)
        assert INERTIA * step.acceleration[-1] == pytest.approx(expected, abs=2e-5 * size)


def test_friction_brakes_a_free_crank(joint, figure):
    # Hardly any mass but the crank's: it can turn and heat the oil, after Petroff.
    body = make_body(joint, masses=np.full(2, 1e-6))
    crank = DrivenCrank(CRANK, SPEED, INERTIA, lambda _: (0.0, 0.0))
    mechanism = SliderCrank(crank, body, joint.film, 1e-5, 1e-3, friction=True)
    steps, balance = run(mechanism, 1e-5, 0.2)
    last = steps[-1].auxiliary.mechanism
    speed = last.crank.speed - last.angle.rate
    area = 2 * np.pi * RADIUS * WIDTH
    petroff = VISCOSITY * speed * (RADIUS - CLEARANCE) ** 2 * area / CLEARANCE
    error = abs(-mechanism.friction(steps[-1].auxiliary).torque / petroff - 1)
    figure("machines", "friction torque of a free crank after Petroff", error, most=1e-2, unit="%")
    lost = 0.5 * INERTIA * (SPEED**2 - last.crank.speed**2)
    assert lost == pytest.approx(balance.work["film"], rel=1e-2)


def test_friction_left_out_of_newtons_matrix_costs_no_iterations(joint):
    body = flexible(joint)[0]
    counts = [
        np.array(
            [
                s.newton_iterations
                for s in run(machine(joint, body, driven(), friction=f), 1e-5, 0.03)[0]
            ]
        )
        for f in (False, True)
    ]
    assert abs(len(counts[1]) - len(counts[0])) <= 0.05 * len(counts[0])
    assert counts[1].mean() < counts[0].mean() + 0.5
    assert counts[1].max() <= counts[0].max() + 1


@pytest.mark.parametrize("length", [1e-8, 5e-5])
def test_iterations_without_the_derivative_of_friction_shrink_the_error(joint, length):
    # By the largest eigenvalue of what an iteration leaves of an error, on the step's partition.
    mechanism = machine(joint, flexible(joint)[0], driven(), friction=True)
    last, shift = run(mechanism, 1e-3, 0.02)[0][-1], 1.5 / length
    past = last.rate - shift * last.x, last.acceleration - shift * last.rate
    equations = CoupledEquations(mechanism, dense_patterns=True)
    equations.begin(
        ImplicitStep(last.time, shift, *past, last.x, last.x, (np.ones(1), np.ones(1)), 1e-7)
    )
    start = equations.unknowns(last.auxiliary.film.pressure, last.x)
    here, full = equations.evaluate(start), np.arange(equations.m)
    film = equations.film.assembly.pattern
    matrix = dense(equations.linearise(here), film, full)
    free = np.append(start[: equations.m] > 1e-12, np.full(equations.n, True))

    def function(change):
        point = equations.evaluate(start + change)
        return np.concatenate([point.film, point.motion])[free]

    exact = np.stack(
        [slope(lambda h, u=u: function(h * u), step=1e-7) for u in np.eye(len(start))[free]], axis=1
    )
    kept = matrix[np.ix_(free, free)]
    left = np.linalg.eigvals(np.linalg.solve(kept, kept - exact))
    assert np.abs(left).max() < 1e-3


def test_nothing_of_friction_is_computed_without_it(joint, monkeypatch):
    def refuse(*_):
        raise AssertionError

    monkeypatch.setattr(slider_crank, "film_friction", refuse)
    run(machine(joint, make_body(joint), steady(), gas_force=None), 1e-3, 0.002)


# --- Tables


def table(angles, values, column="force_N"):
    rows = "\n".join(f"{a},{v}" for a, v in zip(angles, values, strict=True))
    return f"# a comment\nangle_deg,{column}\n{rows}\n"


@pytest.mark.parametrize(("first", "period"), [(0, 360), (-180, 360), (0, 720), (-360, 720)])
def test_tables_repeat_with_two_or_four_strokes(tmp_path, first, period):
    path = tmp_path / "gas.csv"
    angles = np.linspace(first, first + period, period // 5 + 1)
    wave = 2 * np.pi / period
    path.write_text(table(angles, np.cos(wave * angles)))
    force = read_angle_table(path, "mechanism.gas_force", "force_N")
    assert force.period == pytest.approx(np.radians(period))
    for degrees in (13.0, 377.0, 733.0, -1000.0):
        value, along = force(np.radians(degrees))
        assert value == pytest.approx(np.cos(wave * degrees), abs=1e-6)
        assert along == pytest.approx(-np.degrees(wave) * np.sin(wave * degrees), abs=1e-4)
        once_more = force(np.radians(degrees + 360))[0]
        assert (abs(once_more - value) < 1e-9) == (period == 360)


#: Of the tutorial: an ignition in few rows, beside which a spline falls to -4.7 kN.
IGNITION = [0, 20, 60, 180, 300, 360], [8000, 20000, 8000, 500, 600, 8000]


@given(st.lists(st.integers(-9, 9), min_size=3, max_size=9), st.sampled_from([360, 720]))
def test_curves_through_tables_do_not_overshoot_the_rows(tmp_path_factory, values, period):
    path = tmp_path_factory.mktemp("table") / "gas.csv"
    angles = np.linspace(0, period, len(values) + 1)
    rows = np.array([*values, values[0]], dtype=float)
    path.write_text(table(angles, rows))
    force = read_angle_table(path, "mechanism.gas_force", "force_N")
    fine = np.array([force(np.radians(a)) for a in np.linspace(0, period, 12 * len(values) + 1)])
    for before, after, curve in zip(rows[:-1], rows[1:], fine[:-1, 0].reshape(-1, 12), strict=True):
        assert curve.max() <= max(before, after) + 1e-9
        assert curve.min() >= min(before, after) - 1e-9


def test_an_ignition_in_few_rows_does_not_suck(tmp_path):
    path = tmp_path / "gas.csv"
    path.write_text(table(*IGNITION))
    force = read_angle_table(path, "mechanism.gas_force", "force_N")
    fine = np.array([force(np.radians(angle)) for angle in np.linspace(0, 360, 721)])
    assert fine[:, 0].min() == pytest.approx(500)
    assert fine[:, 0].max() == pytest.approx(20000)
    step = np.radians(0.5)
    differences = np.diff(fine[:, 0]) / step
    assert np.abs(np.diff(differences)).max() < 0.2 * np.abs(differences).max()


GOOD = table([0, 90, 180, 270, 360], [1, 2, 3, 2, 1])


@pytest.mark.parametrize(
    ("text", "named"),
    [
        (GOOD.replace("270,2", "170,2"), "line 6: the angle 170 deg must be above 180 deg"),
        (GOOD.replace("360,1", "350,1"), "the angles span 350 deg, from 0 to 350, they must span"),
        (
            GOOD.replace("360,1", "360,2"),
            "line 7: the last value 2 differs from the first, 1, by 1",
        ),
        (GOOD.replace("90,2", "90,two"), "line 4: force_N = 'two' must be a finite number"),
        (GOOD.replace("90,2", "nan,2"), "line 4: angle_deg = 'nan' must be a finite number"),
        (GOOD.replace("90,2", "90,2,3"), "line 4: 3 values for 2 columns"),
        (GOOD.replace("force_N", "force_kN"), "header must be angle_deg,force_N, the file line 2"),
        ("# nothing\n", "header must be angle_deg,force_N, the file is empty"),
        ("angle_deg,force_N\n0,1\n360,1\n", "2 rows of numbers, at least 3 are needed"),
        (b"\xff\xfe\x00", "not a text file"),
        (None, "No such file"),
    ],
)
def test_bad_tables_are_refused_by_line_and_value(text, named, tmp_path):
    path = tmp_path / "gas.csv"
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(SettingsError) as caught:
        read_angle_table(path, "mechanism.gas_force", "force_N")
    assert str(caught.value).startswith(f"mechanism.gas_force {path}")
    assert named in str(caught.value)
    assert "\n" not in str(caught.value)


# --- Scenes


@pytest.mark.parametrize(
    ("key", "value"), [("drive_torque", 3.0), ("drive_torque_table", "a.csv"), ("drive_damping", 1)]
)
def test_a_torque_on_a_crank_at_constant_speed_is_refused(key, value):
    with pytest.raises(SettingsError, match=f"mechanism.{key} = .* mechanism.drive = "):
        build_crank(build(Mechanism, {key: value}))


@pytest.mark.parametrize(
    ("tables", "named"),
    [
        ({"drive": "motor"}, "drive = 'motor' must be one of speed, torque"),
        ({"crank_inertia": 0}, "crank_inertia = 0.0 must be above 0"),
        ({"drive_damping": -1}, "drive_damping = -1.0 must be at least 0"),
        ({"gas_force": 3}, "gas_force = 3 must be a non-empty text"),
    ],
)
def test_bad_settings_are_named(tables, named):
    with pytest.raises(SettingsError, match=named):
        build(Mechanism, tables)


def test_a_crank_off_its_axis_has_more_inertia(tmp_path):
    path = tmp_path / "torque.csv"
    path.write_text(table([0, 90, 180, 270, 360], [1, 2, 3, 2, 1], "torque_Nm"))
    crank = build_crank(
        Mechanism(drive="torque", crank_mass=2.0, crank_centre=0.03, crank_inertia=1e-3,
                  drive_torque=5.0, drive_torque_table=str(path), drive_damping=0.1)
    )  # fmt: skip
    assert crank.inertia == pytest.approx(1e-3 + 2.0 * 0.03**2)
    motion = crank.at(0.0, (np.pi / 2, 7.0, 0.0), (0.0, 0.0))
    assert crank.moment(motion)[0] == pytest.approx(5.0 + 2.0 - 0.7)


def test_scenes_reach_the_mechanism_and_its_history(joint, tmp_path):
    path = tmp_path / "gas.csv"
    angles = np.linspace(0, 720, 73)
    path.write_text(table(angles, 2e3 + 1e3 * np.cos(np.radians(0.5 * angles))))
    settings = SliderCrankSettings(
        mechanism=Mechanism(
            drive="torque", drive_torque=10.0, drive_damping=0.02, gas_force=str(path),
            revolutions=0.01,
        ),
        film=BigEndFilm(friction=True),
        time=Time(tolerance=1e-4),
    )  # fmt: skip
    body, rows, fields = make_body(joint), [], []
    totals = simulate(
        settings, body, Totals(), lambda row, more: (rows.append(row), fields.append(more))
    )
    last = rows[-1]
    assert totals.time == pytest.approx(0.01 * 2 * np.pi / 500)
    assert last["crank_angle_rad"] == pytest.approx(0.01 * 2 * np.pi, rel=0.01)
    assert last["crank_speed_rad_per_s"] != SPEED
    assert last["friction_torque_Nm"] > 0
    assert last["friction_power_W"] == pytest.approx(
        last["friction_torque_Nm"] * (last["crank_speed_rad_per_s"] - last["rod_rate_rad_per_s"])
    )
    assert len(fields[-1]["coordinates"]) == 3
    assert last["min_film_thickness_m"] < CLEARANCE
    plain = attrs.evolve(settings, mechanism=Mechanism(revolutions=0.002), film=BigEndFilm())
    rows.clear()
    simulate(plain, body, Totals(), lambda row, more: rows.append(row))
    assert not [name for name in rows[0] if "crank" in name or "friction" in name]
