"""The slider-crank against mechanics written out by hand, and against its own energy."""

from dataclasses import replace

import numpy as np
import pytest
from differences import slope
from film_cases import watch_snes
from hand_made_rod import (
    CENTRE,
    CLEARANCE,
    CRANK,
    INERTIA,
    MASS,
    PIN,
    PISTON,
    RADIUS,
    REVOLUTION,
    ROD,
    SPEED,
    WIDTH,
    Joint,
    driven,
    fields_at,
    flexible,
    gas,
    make_body,
    make_mechanism,
    pressure_work,
    run,
    some_state,
    torque,
)
from mechanism_cases import simulated_at_nodes
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

import fenics_ehd as ehd
from fenics_ehd.base.plane import rotation
from fenics_ehd.multibody.bdf import ImplicitStep, IntegratorOptions
from fenics_ehd.multibody.mechanism import System
from fenics_ehd.multibody.recorder import columns_of
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.multibody.trust import balance_error, energy_row, step_powers

pytestmark = pytest.mark.kernels


@pytest.fixture(scope="module")
def joint():
    return Joint()


@pytest.mark.parametrize("family", ["lagrange", "serendipity"])
def test_the_integrals_over_the_bore_are_those_of_a_cylinder(family):
    # The tests below stand on this quadrature.
    joint = Joint((20, 3), family)
    work = pressure_work(joint, fields_at(joint.bore_nodes, ()))
    x, y, _ = joint.pressure_nodes.T
    area = 2 * np.pi * RADIUS * WIDTH
    assert work[0] @ np.ones(len(x)) == pytest.approx(RADIUS * area, rel=1e-4)
    assert work[1] @ np.ones(len(x)) == pytest.approx(0, abs=1e-12 * area)
    assert work[1:] @ (x / RADIUS) == pytest.approx([area / 2, 0], rel=1e-4, abs=1e-12 * area)
    assert work[1:] @ (y / RADIUS) == pytest.approx([0, area / 2], rel=1e-4, abs=1e-12 * area)


# --- A rigid rod in absolute coordinates


def absolute_motion(joint, times, tolerance=1e-10):
    """Eccentricity (2, steps) and minimum film thickness of a rigid rod, from Lagrange's equations.

    Coordinates: position a of the piston pin along its line and angle of the
    rod. Bore centre ``(a, 0) - l u`` and centre of mass ``(a, 0) - d u`` with
    ``u = (cos, sin)``, ``d = l - 67.7 mm``.
    """
    rest = ROD - CENTRE
    bore = np.zeros((len(joint.bore_nodes), 3, 2))
    bore[:, 0, 0] = bore[:, 1, 1] = 1.0
    work = pressure_work(joint, bore)

    def shaft(t, state):
        """Eccentricity and its rate in the rod's frame."""
        a, theta, a_rate, theta_rate = state
        u, v = np.array([np.cos(theta), np.sin(theta)]), np.array([-np.sin(theta), np.cos(theta)])
        crank = CRANK * np.array([np.cos(SPEED * t), np.sin(SPEED * t)])
        crank_rate = CRANK * SPEED * np.array([-np.sin(SPEED * t), np.cos(SPEED * t)])
        offset = crank - (np.array([a, 0.0]) - ROD * u)
        offset_rate = crank_rate - (np.array([a_rate, 0.0]) - ROD * v * theta_rate)
        e = np.array([u @ offset, v @ offset])
        e_rate = np.array([u @ offset_rate, v @ offset_rate])
        return e, e_rate + theta_rate * np.array([e[1], -e[0]]), u, v

    def displaced(vector):
        return np.broadcast_to([-vector[0], -vector[1], 0.0], joint.bore_nodes.shape)

    def slopes(t, state):
        _, theta, a_rate, theta_rate = state
        e, e_rate, u, v = shaft(t, state)
        pressure = joint.solve(displaced(e), displaced(e_rate), SPEED - theta_rate).pressure
        along, across = work @ pressure
        # The film's force acts at the shaft's centre.
        moment = e[0] * across - e[1] * along
        force = along * u + across * v
        # T = (m + M) a'^2 / 2 + m d sin a' theta' + (I + m d^2) theta'^2 / 2
        coupling = MASS * rest * np.sin(theta)
        inertia = np.array([[MASS + PISTON, coupling], [coupling, INERTIA + MASS * rest**2]])
        loads = np.array([
            force[0] - MASS * rest * np.cos(theta) * theta_rate**2,
            -ROD * v @ force + moment,
        ])  # fmt: skip
        return np.concatenate([[a_rate, theta_rate], np.linalg.solve(inertia, loads)])

    start = [CRANK + ROD, 0.0, 0.0, -CRANK * SPEED / ROD]
    # Positions to a millionth of the clearance; a velocity error is a false squeeze velocity.
    absolute = np.array([1e-2, 1e-1, 1e2, 1e3]) * tolerance
    solution = solve_ivp(
        slopes, (0.0, times[-1]), start, "Radau", times, rtol=tolerance, atol=absolute,
        first_step=1e-8,
    )  # fmt: skip
    assert solution.success, solution.message
    e = np.array([shaft(t, state)[0] for t, state in zip(times, solution.y.T, strict=True)])
    return e, np.array([joint.rigid_gap(row) for row in e])


def differences(joint, body, revolutions, tolerances):
    """Largest difference of eccentricity and film thickness from absolute coordinates, over c."""
    end = revolutions * REVOLUTION
    largest = 0.02 / revolutions
    runs = [
        simulated_at_nodes(make_mechanism(body, joint), end, tolerance=tolerance, largest=largest)
        for tolerance in tolerances
    ]
    # Compared at the steps of the runs themselves: none of their values is interpolated.
    times = np.unique(np.concatenate([result.time for result in runs]))
    eccentricity, thickness = absolute_motion(joint, times)
    found = []
    for result in runs:
        at, film = np.searchsorted(times, result.time), result.joints["big_end"]
        largest = (
            np.abs(film.eccentricity - eccentricity[at]).max(),
            np.abs(film.min_film_thickness - thickness[at]).max(),
        )
        found.append(np.array(largest) / CLEARANCE)
    return found


@pytest.mark.slow
def test_a_rigid_rod_moves_as_in_absolute_coordinates(joint, figure):
    coarse, fine = differences(joint, make_body(joint), 0.05, (1e-4, 1e-6))
    name = "rigid rod against absolute coordinates, of the clearance"
    figure("machines", name, fine.max(), most=1e-4, unit="%")
    # Order 2 with the local error under control: tolerance^(2/3), a factor of 20.
    assert np.all(coarse / fine > 8)


# --- A flexible rod: the equations of motion


class Moved:
    """Rod, crank and piston from what is free to move, as explicit functions.

    The first six coordinates are eccentricity and modes, the last the angle by which the crank
    is ahead of constant speed. The rod's angle is found by its root, no formula shared.
    """

    def __init__(self, joint, points, modes):
        self.fields = fields_at(np.vstack([points, PIN, joint.bore_nodes]), modes)
        self.pin, self.count = len(points), len(modes)

    def angle(self, t, xi):
        return SPEED * t + xi[-1]

    def crank(self, t, xi):
        angle = self.angle(t, xi)
        return CRANK * np.array([np.cos(angle), np.sin(angle)])

    def local(self, xi):
        """In the rod's frame, from the shaft's centre."""
        return self.fields @ np.concatenate([[1.0], -xi[:2], xi[2:-1]])

    def rod_angle(self, t, xi):
        pin = self.local(xi)[self.pin, :2]
        return brentq(
            lambda a: self.crank(t, xi)[1] + (rotation(a) @ pin)[1], -1.0, 1.0, xtol=1e-15
        )

    def places(self, t, xi):
        """All points, the piston's pin and the nodes of the bore, shape (N, 3)."""
        local = self.local(xi)
        plane = self.crank(t, xi) + local[:, :2] @ rotation(self.rod_angle(t, xi)).T
        return np.column_stack([plane, local[:, 2]])

    def coordinates(self, system, t, xi):
        """The same place in the coordinates of a mechanism."""
        z, angle = np.zeros(system.n), self.rod_angle(t, xi)
        z[system.bodies["crank"]] = 0.0, 0.0, self.angle(t, xi)
        z[system.bodies["piston"]] = *self.places(t, xi)[self.pin, :2], 0.0
        bore = self.crank(t, xi) - rotation(angle) @ xi[:2]
        z[system.bodies["rod"]] = np.concatenate([bore, [angle], xi[2:-1]])
        z[system.films[0].xi[:2]] = xi[:2]
        return z


@pytest.mark.parametrize("crank", ["steady", "driven"])
@pytest.mark.parametrize("family", ["lagrange", "serendipity"])
@pytest.mark.parametrize("seed", [0, 11, 77])
def test_residual_is_the_virtual_work_of_explicitly_moved_points(seed, family, crank):
    joint = Joint((12, 3), family)
    body, masses, points, modes = flexible(joint)
    moved, time, shift = Moved(joint, points, modes), 1e-4 * seed, 2e3
    inertia, damping, pull = 2e-3, 0.01, np.array([0.0, -9.81, 0.0])
    push = {
        "torque": ehd.Torque("crank", curve=torque, damping=damping, speed=SPEED),
        "gas": ehd.PointForce("piston", (-1.0, 0.0), gas, "crank"),
    }
    mechanism = driven(make_mechanism(body, joint), inertia, **push)
    system = System(replace(mechanism, gravity=tuple(pull[:2])))
    x, rate, acceleration = (np.append(values, 0.0) for values in some_state(seed))
    x[:2], rate[:2], acceleration[:2] = -x[:2], -rate[:2], -acceleration[:2]
    if crank == "driven":
        x[-1], rate[-1], acceleration[-1] = np.random.default_rng(100 + seed).uniform(-1, 1, 3) * [
            2.0,
            100.0,
            1e5,
        ]

    def path(s):
        return x + s * rate + 0.5 * s**2 * acceleration

    def along(function):
        """First and second derivative along the path."""

        def first(s):
            return slope(lambda h: function(time + h, path(h)), s, step=2e-5)

        return first(0.0), slope(first, step=2e-5)

    def varied(function):
        columns = [slope(lambda h, u=u: function(time, x + h * u), step=2e-4) for u in np.eye(7)]
        return np.stack(columns, axis=-1)

    # The oil, from the nodes of the bore.
    bore = fields_at(joint.bore_nodes, modes)[:, :, 1:]
    signs = np.array([-1, -1, 1, 1, 1, 1.0])
    displacement, moving = bore @ (signs * x[:6]), bore @ (signs * rate[:6])
    turning = SPEED + rate[-1] - along(moved.rod_angle)[0]
    pressure = joint.solve(displacement, moving, turning).pressure
    # Virtual work of every force on the seven motions that the joints leave free.
    heavy, weights = slice(0, moved.pin + 1), np.append(masses, PISTON)
    motions = varied(lambda t, xi: moved.places(t, xi)[heavy])
    accelerations = along(lambda t, xi: moved.places(t, xi)[heavy])[1] - pull
    parts = [np.einsum("k,kc,kcj->j", weights, accelerations, motions)]
    parts.append(np.zeros(7))
    parts[-1][:6] = -signs * (pressure_work(joint, bore) @ pressure)
    parts.append(np.zeros(7))
    parts[-1][2:6] = body.stiffness @ (x + 1e-3 * rate)[2:6]
    ahead = moved.angle(time, x)
    parts.append(gas(ahead)[0] * motions[moved.pin, 0])
    parts.append(np.zeros(7))
    parts[-1][-1] = inertia * acceleration[-1] + damping * rate[-1] - torque(ahead)[0]
    size = np.sum(np.abs(parts), axis=0)

    # The same in the coordinates of bodies and joints.
    def coordinates(t, xi):
        return moved.coordinates(system, t, xi)

    z, (v, a), free = coordinates(time, x), along(coordinates), varied(coordinates)
    equations = StepEquations(system)
    past = v - shift * z, a - shift * v
    nothing = np.ones(1), np.ones(1)
    equations.begin(ImplicitStep(time, shift, *past, z, z, nothing, 1e-7))
    film = system.films[0].film.film
    given = pressure[film.free] / film.parameters.pressure_scale
    point = equations.evaluate(np.concatenate([given, z, np.zeros(2 * system.m)]))
    found = point.rest[: system.n] @ free
    assert np.all(np.abs(found - np.sum(parts, axis=0)) <= 2e-6 * size)
    # Joints stay closed along the path, and do not resist what they leave free.
    assert np.abs(point.rest[system.n :]).max() < 1e-8
    assert np.abs(point.motion.instant.jacobian @ free).max() < 1e-9
    # The joint's own gap and velocities give the same oil.
    own = film.solve(point.films[0].gap).pressure
    assert own == pytest.approx(pressure, abs=1e-6 * pressure.max())


# --- Energy


def test_an_energy_balance_sees_what_leaks():
    rows = []
    for time, stored in ((0.0, 10.0), (0.5, 12.5), (2.0, 20.0), (3.0, 24.0)):
        powers = {"kinetic": stored, "strain": 0.0, "drive": 5.0, "drag": 2.0, "film": 2.0}
        powers |= {"damping": 1.0, "applied": 1.0}
        rows.append({"time_s": time} | energy_row(rows, time, powers))
    assert balance_error(columns_of(rows[:3])) == pytest.approx(0.0, abs=1e-14)
    # One of 15 J by the drive is missing.
    assert rows[-1]["run/energy_defect_J"] == pytest.approx(-1.0)
    assert balance_error(columns_of(rows)) == pytest.approx(1 / 15)


@pytest.mark.parametrize("kind", ["rigid", "flexible"])
def test_every_power_is_needed_to_close_the_energy_balance(joint, kind):
    # The crank lends the rod a hundred times what is lost, so the balance is integrated by
    # splines here and its defect compared with the losses.
    body = make_body(joint) if kind == "rigid" else flexible(joint)[0]
    steps, end = IntegratorOptions(tolerance=1e-6, largest=0.4), 0.05 * REVOLUTION
    going = Run(make_mechanism(body, joint), steps, end)
    # At once: the film's losses are those of its last solve.
    found = [(step.time, step_powers(going.equations, step)) for step in going.until(end)]
    times, powers = zip(*found, strict=True)

    def work(name):
        total = CubicSpline(times, [power[name] for power in powers]).antiderivative()
        return total(times) - total(times[0])

    stored = np.array([power["kinetic"] + power["strain"] for power in powers])
    stored -= stored[0]
    defect = stored - work("drive") - work("drag") + work("film") + work("damping")
    # Without the drag, the smallest of them, the flexible rod's defect is 1 % of the losses.
    losses = work("film") + work("damping")
    assert np.abs(defect).max() < 5e-3 * losses[-1]


# --- Every step is SNES-VI's


def test_every_step_is_solved_by_reduced_space_newton(monkeypatch):
    made, begun = watch_snes(monkeypatch)
    joint = Joint()
    result = run(make_mechanism(make_body(joint), joint), 0.02, 1e-4)
    assert {snes.getType() for snes in made} == {"vinewtonrsls"}
    assert len(begun) == len(result.time) + result.summary()["rejected_steps"] > 20


# --- The same motion in other coordinates


def turned(x):
    return np.column_stack([-x[:, 1], x[:, 0], 0 * x[:, 0]]) / ROD


def test_a_rigid_motion_mixed_into_a_mode_leaves_the_physics_alone():
    joint = Joint((24, 3))
    plain, along_and_across, rotated = (
        run(make_mechanism(flexible(joint, extra=extra)[0], joint), 0.01, 1e-6)
        for extra in (None, lambda x: np.tile([-0.4, 1.3, 0.0], (len(x), 1)), turned)
    )
    # Up to the squared angle and to the cylinder's cells, whose normals are not quite radial.
    for mixed in (along_and_across, rotated):
        for name in ("min_film_thickness_m", "max_pressure_Pa"):
            found = CubicSpline(mixed.time, mixed.columns[name])(plain.time)
            late = plain.time > 1e-5
            change = np.abs(found - plain.columns[name])[late].max()
            assert change < 1e-4 * plain.columns[name].max(), name


def test_a_very_stiff_rod_moves_as_a_rigid_one(joint):
    body, masses, points, modes = flexible(joint)
    stiff = make_body(joint, masses, points, modes, 1e6 * body.stiffness)
    rigid = make_body(joint, masses, points)
    one, other = (
        run(make_mechanism(b, joint), 0.02, 1e-5).joints["big_end"] for b in (stiff, rigid)
    )
    assert one.min_film_thickness[-1] == pytest.approx(other.min_film_thickness[-1], rel=1e-4)
