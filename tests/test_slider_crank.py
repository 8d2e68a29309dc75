"""The slider-crank against mechanics written out by hand, and against its own energy."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
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
    fields_at,
    flexible,
    make_body,
    make_mechanism,
    pressure_work,
    some_state,
    spun,
)
from nested_film import NestedFilm
from petsc4py import PETSc
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from fenics_ehd.film import snes_vi
from fenics_ehd.multibody.bdf import StepControl, integrate
from fenics_ehd.multibody.coupled import CoupledSteps
from fenics_ehd.multibody.energy import EnergyBalance
from fenics_ehd.scenes.run import Totals, simulate
from fenics_ehd.scenes.slider_crank_settings import Mechanism, SliderCrankSettings, Time

pytestmark = pytest.mark.kernels

ROOT = Path(__file__).resolve().parents[1]


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
    bore = np.zeros((len(joint.bore_nodes), 3, 3))
    bore[:, 0, 0] = bore[:, 1, 1] = 1.0
    bore[:, :, 2] = spun(joint.bore_nodes[:, :, None])[:, :, 0]
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
        along, across, moment = work @ pressure
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


def rigid_settings(revolutions, tolerance, **time):
    return SliderCrankSettings(
        mechanism=Mechanism(revolutions=revolutions), time=Time(tolerance=tolerance, **time)
    )


def run(settings, body):
    """Totals of a run and its rows as columns."""
    rows = []
    totals = simulate(settings, body, Totals(), lambda row, fields: rows.append(row))
    return totals, {name: np.array([row[name] for row in rows]) for name in rows[0]}


def differences(joint, body, revolutions, tolerances):
    """Largest difference of eccentricity and film thickness from absolute coordinates, over c."""
    runs = [run(rigid_settings(revolutions, tolerance), body)[1] for tolerance in tolerances]
    # Compared at the steps of the runs themselves: nothing of theirs is interpolated.
    times = np.unique(np.concatenate([columns["time_s"] for columns in runs]))
    eccentricity, thickness = absolute_motion(joint, times)
    found = []
    for columns in runs:
        at = np.searchsorted(times, columns["time_s"])
        e = np.column_stack([columns["eccentricity_x_m"], columns["eccentricity_y_m"]])
        gap = columns["min_film_thickness_m"]
        largest = np.abs(e - eccentricity[at]).max(), np.abs(gap - thickness[at]).max()
        found.append(np.array(largest) / CLEARANCE)
    return found


def test_a_rigid_rod_moves_as_in_absolute_coordinates(joint, figure):
    coarse, fine = differences(joint, make_body(joint), 0.05, (1e-4, 1e-6))
    name = "rigid rod against absolute coordinates, of the clearance"
    figure("machines", name, fine.max(), most=1e-4, unit="%")
    # Order 2 with the local error under control: tolerance^(2/3), a factor of 20.
    assert np.all(coarse / fine > 8)


@pytest.mark.slow
def test_a_rigid_rod_moves_as_in_absolute_coordinates_for_a_third_of_a_revolution(joint):
    coarse, fine = differences(joint, make_body(joint), 1 / 3, (1e-5, 1e-7))
    assert np.all(fine < 1e-4)
    assert np.all(coarse < 1e-2)
    assert np.all(coarse / fine > 8)


# --- A flexible rod: residual and derivative


def virtual_work(joint, body, masses, points, modes, time, state, damping_time):
    """Forces on xi from explicitly moved points; the angle by root finding, no formula shared."""
    x, rate, acceleration = state
    everything = np.vstack([points, PIN, joint.bore_nodes])
    weights = np.append(masses, PISTON)
    fields = fields_at(everything, modes)

    def crank(t):
        return CRANK * np.array([np.cos(SPEED * t), np.sin(SPEED * t)])

    def turned(angle):
        c, s = np.cos(angle), np.sin(angle)
        return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])

    def angle(t, xi):
        pin = fields[len(points)] @ np.append(1.0, xi)
        return brentq(lambda a: crank(t)[1] + (turned(a) @ pin)[1], -1.0, 1.0, xtol=1e-15)

    def places(t, xi):
        local = fields @ np.append(1.0, xi)
        return np.append(crank(t), 0.0) + local @ turned(angle(t, xi)).T

    def coordinates(t):
        s = t - time
        return x + s * rate + 0.5 * s**2 * acceleration

    def slope(function, step):
        weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
        pairs = (w * (function(k * step) - function(-k * step)) for k, w in weights.items())
        return sum(pairs) / step

    def curvature(function, step):
        weights = {1: 8 / 5, 2: -1 / 5, 3: 8 / 315, 4: -1 / 560}
        pairs = sum(w * (function(k * step) + function(-k * step)) for k, w in weights.items())
        return (pairs - 205 / 72 * function(0.0)) / step**2

    heavy = slice(0, len(weights))
    now = angle(time, x)
    theta_rate = slope(lambda s: angle(time + s, coordinates(time + s)), 1e-4)
    accelerations = curvature(lambda s: places(time + s, coordinates(time + s))[heavy], 1e-4)
    bore = fields[len(weights) :, :, 1:]
    pressure = joint.solve(bore @ x, bore @ rate, SPEED - theta_rate).pressure
    moved = np.stack(
        [slope(lambda h, u=u: places(time, x + h * u), 1e-3) for u in np.eye(len(x))], axis=2
    )
    inertia = np.einsum("k,kc,kcj->j", weights, accelerations, moved[heavy])
    in_rod = np.einsum("ci,kcj->kij", turned(now), moved[len(weights) :])
    load = pressure_work(joint, in_rod) @ pressure
    elastic = np.append([0.0, 0.0], body.stiffness @ (x + damping_time * rate)[2:])
    return inertia - load + elastic, np.abs(inertia) + np.abs(load) + np.abs(elastic)


@pytest.mark.parametrize("family", ["lagrange", "serendipity"])
@pytest.mark.parametrize("time", [0.0, 1.1e-3, 7.7e-3])
def test_residual_is_the_virtual_work_of_explicitly_moved_points(time, family):
    joint = Joint((12, 3), family)
    body, masses, points, modes = flexible(joint)
    state = some_state(seed=int(1e4 * time))
    expected, size = virtual_work(joint, body, masses, points, modes, time, state, 1e-3)
    found = NestedFilm(make_mechanism(body, joint)).linearise(time, *state, (2e3, 4e6), None)[0]
    assert np.all(np.abs(found - expected) <= 1e-6 * size.max())
    assert np.all(np.abs(found - expected)[2:] <= 1e-6 * size[2:])


def assert_derivative(mechanism, time, state, shifts, guess, tolerance):
    """Compare with central differences along xi, the rates following with the shifts."""
    _, jacobian, here = mechanism.linearise(time, *state, shifts, guess)

    def moved(change):
        follow = [a + f * change for a, f in zip(state, (1.0, *shifts), strict=True)]
        residual, _, there = mechanism.linearise(time, *follow, shifts, here)
        cavitated = there.film.pressure > 1e-9 * there.film.pressure.max()
        assert np.array_equal(cavitated, flooded), "choose a state away from a change of partition"
        return residual

    flooded = here.film.pressure > 1e-9 * here.film.pressure.max()
    # Gaps change by 1e-6 of themselves at most, squeeze velocities by 1e-5 m/s.
    step = min(2e-11, 2e-6 / (1.0 + shifts[0]))
    expected = np.column_stack(
        [(moved(step * u) - moved(-step * u)) / (2 * step) for u in np.eye(mechanism.size)]
    )
    scale = np.sqrt(np.outer(np.diag(np.abs(expected)), np.diag(np.abs(expected))))
    assert np.all(np.abs(jacobian - expected) <= tolerance * scale)


@pytest.mark.parametrize("family", ["lagrange", "serendipity"])
@pytest.mark.parametrize("shifts", [(0.0, 0.0), (2e3, 4e6), (1e6, 1e12)])
@pytest.mark.parametrize("seed", [1, 2])
def test_derivative_equals_central_differences(family, shifts, seed):
    joint = Joint((12, 3), family)
    mechanism = NestedFilm(make_mechanism(flexible(joint)[0], joint))
    assert_derivative(mechanism, 1.3e-3, some_state(seed), shifts, None, 1e-5)


def start(mechanism, tolerance, revolutions):
    """Steps of a run from rest, one by one."""
    control = StepControl(tolerance, 1e-8, 1e-13, REVOLUTION / 50)
    rest = np.zeros(mechanism.size)
    span = (0.0, revolutions * REVOLUTION)
    return integrate(mechanism, span, rest, rest, control, CoupledSteps(mechanism))


def test_derivative_equals_central_differences_along_a_run_from_the_start(joint):
    # Every film solve of a run starts from the pressure of the one before.
    mechanism = make_mechanism(make_body(joint), joint)
    nested = NestedFilm(mechanism)
    steps = list(start(mechanism, tolerance=1e-4, revolutions=0.02))
    for last, step in ((steps[4], steps[5]), (steps[-2], steps[-1])):
        state = step.x, step.rate, step.acceleration
        alpha = 1.5 / (step.time - last.time)
        assert_derivative(nested, step.time, state, (alpha, alpha**2), step.auxiliary, 1e-5)


def test_newton_needs_few_iterations_in_a_run(joint):
    # An exact derivative roughly squares the predictor's error of 1e-3 or less of the gap:
    # two iterations reach 1e-7 of it, and some steps change the partition.
    steps = list(start(make_mechanism(make_body(joint), joint), tolerance=1e-5, revolutions=0.02))
    assert np.mean([step.newton_iterations for step in steps[5:]]) < 3


# --- Energy


def test_an_energy_balance_sees_what_leaks():
    class Steady:
        def __init__(self, stored):
            self.stored, self.drive, self.drag, self.film, self.damping = stored, 5.0, 2.0, 2.0, 1.0
            self.gas = 1.0

    balance = EnergyBalance(0.0, Steady(10.0))
    balance.add(0.5, Steady(12.5))
    balance.add(2.0, Steady(20.0))
    assert balance.error == pytest.approx(0.0, abs=1e-14)
    balance.add(3.0, Steady(24.0))
    # One of 15 J by the drive is missing.
    assert balance.defect == pytest.approx(-1.0)
    assert balance.error == pytest.approx(1 / 15)


def test_energy_balance_closes_with_the_tolerance(joint):
    body = make_body(joint)
    loose, tight = (run(rigid_settings(0.1, t), body)[0].energy_error for t in (1e-4, 1e-6))
    assert loose < 1e-3
    assert tight < loose / 3


@pytest.mark.slow
def test_energy_balance_closes_with_the_tolerance_over_a_revolution(joint):
    body = make_body(joint)
    loose, tight = (run(rigid_settings(1.0, t), body)[0].energy_error for t in (1e-4, 1e-6))
    assert loose < 1e-3
    assert tight < loose / 3


@pytest.mark.parametrize("kind", ["rigid", "flexible"])
def test_every_power_is_needed_to_close_the_energy_balance(joint, kind):
    # The crank lends the rod a hundred times what is lost, so the balance is integrated by
    # splines here and its defect compared with the losses.
    body = make_body(joint) if kind == "rigid" else flexible(joint)[0]
    mechanism = make_mechanism(body, joint)
    times, powers = [], []
    for step in start(mechanism, tolerance=1e-6, revolutions=0.05):
        times.append(step.time)
        # At once: the film's losses are those of its last solve.
        powers.append(mechanism.powers(step.x, step.rate, step.auxiliary))

    def work(name):
        total = CubicSpline(times, [getattr(power, name) for power in powers]).antiderivative()
        return total(times) - total(times[0])

    stored = np.array([power.stored - powers[0].stored for power in powers])
    defect = stored - work("drive") - work("drag") + work("film") + work("damping")
    # Without the drag, the smallest of them, the flexible rod's defect is 1 % of the losses.
    losses = work("film") + work("damping")
    assert np.abs(defect).max() < 5e-3 * losses[-1]


def test_energy_balance_of_a_flexible_rod_closes_with_the_tolerance(joint):
    body = flexible(joint)[0]
    loose, tight = (run(rigid_settings(0.03, t), body)[0].energy_error for t in (1e-3, 1e-5))
    assert tight < 1e-3
    assert tight < loose / 3


# --- Every film solve is SNES-VI's


def test_every_step_is_solved_by_reduced_space_newton(monkeypatch):
    announced, types = [], set()

    class WatchedSNES(PETSc.SNES):
        def create(self, *arguments, **options):
            snes = super().create(*arguments, **options)
            # PETSc itself reports iteration 0 of every solve.
            snes.setMonitor(lambda _, iteration, norm: iteration or announced.append(norm))
            return snes

        def solve(self, *arguments):
            types.add(self.getType())
            return super().solve(*arguments)

    class WatchedPETSc:
        SNES = WatchedSNES

        def __getattr__(self, name):
            return getattr(PETSc, name)

    monkeypatch.setattr(snes_vi, "PETSc", WatchedPETSc())
    joint = Joint()
    steps = list(start(make_mechanism(make_body(joint), joint), tolerance=1e-4, revolutions=0.02))
    rejected = sum(sum(step.rejected.values()) for step in steps)
    assert types == {"vinewtonrsls"}
    assert len(announced) == len(steps) + rejected > 20


def monitored_run(tmp_path, reduction, *options):
    """Summary of a run from the command line, and the SNES solves that PETSc announced."""
    scene = tmp_path / "scene.toml"
    scene.write_text(f'scene = "slider-crank"\n[mechanism]\nrevolutions = 0.005\n{reduction}')
    done = subprocess.run(
        [sys.executable, "-m", "fenics_ehd.cli", "run", str(scene), "--json", "--no-plots",
         "-o", str(tmp_path / "out"), *options],
        env={**os.environ, "PETSC_OPTIONS": "-film_snes_monitor"},
        cwd=tmp_path, capture_output=True, text=True, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    return summary, len(re.findall(r"^\s*0 SNES Function norm", done.stdout, re.MULTILINE))


def test_petsc_announces_every_film_solve_of_a_run(joint, tmp_path):
    from fenics_ehd.reduction import save_body

    save_body(make_body(joint), tmp_path / "rod.h5")
    summary, announced = monitored_run(tmp_path, "", "--body", str(tmp_path / "rod.h5"))
    assert summary["status"] == "complete"
    assert announced == summary["film_solves"] > 20


@pytest.mark.slow
def test_petsc_announces_every_film_solve_of_a_run_with_a_meshed_rod(tmp_path):
    # By path, because a checkout that is not installed has no shipped models.
    reduction = (
        f'[rod]\nmodel = "{ROOT / "meshes" / "conrod.geo"}"\n'
        '[reduction]\nmethod = "rigid"\nestimate_error = false\n'
    )
    summary, announced = monitored_run(tmp_path, reduction)
    assert summary["status"] == "complete"
    assert summary["method"] == "rigid"
    assert announced == summary["film_solves"] > 20


# --- The same motion in other coordinates


def mixed_difference(joint, extra):
    """Relative change of the curves when `extra` is mixed into a mode, both at tolerance 1e-5."""
    plain, mixed = (
        run(rigid_settings(0.03, 1e-5), flexible(joint, extra=added)[0])[1]
        for added in (None, extra)
    )
    times = plain["time_s"]
    return [
        np.abs(np.interp(times, mixed["time_s"], mixed[name]) - plain[name]).max()
        / plain[name].max()
        for name in ("min_film_thickness_m", "max_pressure_Pa")
    ]


@pytest.mark.parametrize("direction", [(0.7, 0.0, 0.0), (-0.4, 1.3, 0.0)])
def test_a_translation_mixed_into_a_mode_leaves_the_physics_alone(joint, direction):
    # A linear change of coordinates that the integrator's formulas and its norm do not notice.
    assert max(mixed_difference(joint, lambda x: np.tile(direction, (len(x), 1)))) < 1e-9


def test_a_rotation_mixed_into_a_mode_leaves_the_physics_alone():
    # Up to the squared angle and to the cylinder's cells, whose normals are not quite radial.
    def turn(x):
        return np.column_stack([-x[:, 1], x[:, 0], 0 * x[:, 0]]) / ROD

    assert max(mixed_difference(Joint((24, 3)), turn)) < 1e-4


def test_a_bore_turned_by_its_modes_drags_the_oil_as_one_turned_by_its_frame():
    # On a thin film: the oil's own thickness is left out of its velocity.
    joint = Joint(clearance=17e-9)
    e = np.array([8e-9, -3e-9, 0.0])
    eccentric = np.broadcast_to(-e, joint.bore_nodes.shape)
    turning = spun(joint.bore_nodes[:, :, None])[:, :, 0]
    # The shaft's centre stays, so that it moves back in a frame that turns with the bore.
    back = np.broadcast_to(-100.0 * np.array([e[1], -e[0], 0.0]), joint.bore_nodes.shape)
    by_modes = joint.solve(eccentric, 100.0 * turning, 600.0).pressure
    by_frame = joint.solve(eccentric, back, 500.0).pressure
    assert np.abs(by_modes - by_frame).max() < 1e-4 * by_frame.max()


def test_a_very_stiff_rod_moves_as_a_rigid_one(joint):
    body, masses, points, modes = flexible(joint)
    stiff = make_body(joint, masses, points, modes, 1e6 * body.stiffness)
    rigid = make_body(joint, masses, points)
    one, other = (run(rigid_settings(0.02, 1e-5), b)[1] for b in (stiff, rigid))
    assert one["min_film_thickness_m"][-1] == pytest.approx(
        other["min_film_thickness_m"][-1], rel=1e-4
    )
