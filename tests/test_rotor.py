"""The rotor in its housing: film maps, derivatives, energy, the scene."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from rotor_cases import (
    FREE_SHAFT,
    MODES,
    SPEED,
    C,
    R,
    flexible,
    held_body,
    linearise,
    make_film,
    shifted,
    steps_of,
)

from fenics_ehd.errors import SettingsError
from fenics_ehd.film import ShaftMotion, shaft_gap
from fenics_ehd.multibody.bdf import StepControl
from fenics_ehd.multibody.dry_system import DrySystem
from fenics_ehd.multibody.energy import EnergyBalance
from fenics_ehd.multibody.shaft_journal import ShaftJournal
from fenics_ehd.scenes.rotor import Rotor
from fenics_ehd.scenes.rotor_run import (
    build_mechanism,
    build_rotor,
    check_before_reduction,
    rotor_system,
    simulate,
)
from fenics_ehd.scenes.rotor_settings import Force, RotorSettings, Shaft, Time
from fenics_ehd.scenes.transient import Totals
from fenics_ehd.settings import build

pytestmark = pytest.mark.kernels

# --- The film's linear maps


@pytest.fixture(scope="module")
def film():
    return make_film()


@pytest.fixture(scope="module")
def journal(film):
    return ShaftJournal(flexible(film), film, FREE_SHAFT)


def test_gap_of_a_tilting_shaft_is_the_films_own(film, journal):
    x, rate = np.zeros((2, journal.size))
    x[:4], rate[:4] = [3e-7, -2e-7, 1e-5, 3e-5], [2e-3, 1e-3, 0.2, -0.1]
    exact = shaft_gap(
        film.points,
        R,
        C,
        ShaftMotion(x[:2], SPEED, eccentricity_rate=rate[:2], tilt=x[2:4], tilt_rate=rate[2:4]),
    )
    found = journal.film_gap(x, rate, SPEED)
    # What is left out is e_t^2 / 2 R and its rate.
    furthest, fastest = 7e-7, 5e-3
    assert np.abs(found.thickness - exact.thickness).max() < furthest**2 / R
    assert np.abs(found.thickness_rate - exact.thickness_rate).max() < furthest * fastest / R
    assert np.abs(found.mean_velocity - exact.mean_velocity).max() < SPEED * furthest**2 / R
    assert np.abs(found.sliding_velocity - exact.sliding_velocity).max() < SPEED * furthest**2 / R
    # And of the right sign: the gap changes by as much as the shaft moves.
    assert np.ptp(found.thickness) == pytest.approx(np.ptp(exact.thickness), rel=1e-4)
    assert np.ptp(found.thickness) > 1e-6


def test_gap_of_a_bent_bore_is_the_films_own(film):
    # Modes that leave the bore's mean where it is, so that both see velocities from there.
    modes = [mode for mode in MODES if mode is not shifted]
    journal = ShaftJournal(held_body(film, modes, (1e3, 1e3, 1e3)), film, FREE_SHAFT)
    rng = np.random.default_rng(4)
    q, q_rate = 1e-7 * rng.uniform(-1, 1, (2, 3))
    shape = (*film.points.angle.shape, -1)
    normal = journal.thickness[:, 4:].reshape(shape)
    tangential = -journal.sliding_velocity[:, 4:].reshape(shape)
    expected = shaft_gap(
        film.points, R, C, ShaftMotion(np.zeros(2), SPEED),
        bore_displacement=(normal @ q, tangential @ q),
        bore_velocity=(normal @ q_rate, tangential @ q_rate),
    )  # fmt: skip
    found = journal.film_gap(np.append(np.zeros(4), q), np.append(np.zeros(4), q_rate), SPEED)
    for name in ("thickness", "thickness_rate", "mean_velocity", "sliding_velocity"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-12)
    angle, height = film.points.angle, film.points.height
    waves = np.cos(3 * angle) * (1 + 20 * height)
    assert np.abs(normal[..., 2] - waves).max() < 0.03  # quadratic cells, 12 around


def test_a_bore_that_moves_is_a_shaft_that_moves_back(film):
    journal = ShaftJournal(held_body(film, [shifted], (1e3,)), film, FREE_SHAFT)
    back = -np.array([1.0, 0.5])
    for name in ("thickness", "mean_velocity", "sliding_velocity"):
        columns = getattr(journal, name)
        np.testing.assert_allclose(columns[:, 4], columns[:, :2] @ back, atol=1e-12)
    load = journal.load[1:]
    np.testing.assert_allclose(load[4], back @ load[:2], atol=1e-12 * np.abs(load).max())
    np.testing.assert_allclose(journal.centre[:, 4], back, atol=1e-12)


def test_gap_and_force_are_conjugate(film, journal, figure):
    rng = np.random.default_rng(2)
    pressure = rng.uniform(0, 1e6, len(film.parameters.grid.nodes))
    rate = rng.uniform(-1e-3, 1e-3, journal.size)
    # Power on the surfaces, point by point: p dh/dt.
    opening = journal.film_gap(np.zeros(journal.size), rate, 0.0).thickness_rate
    values = film.assembly.at_points(pressure)[0]
    power = R**2 * np.sum(film.assembly.area * values * opening)
    error = abs(journal.load[1:] @ pressure @ rate / power - 1)
    figure("rotor", "power of the pressure, on gap and on coordinates", error, most=1e-12)


def test_tilting_moments_of_a_pressure(film, journal):
    # p = z cos(phi): a moment on the shaft about y, none about x, no force.
    angle, z = film.parameters.grid.node_positions.T
    load = journal.load[1:5] @ (z * np.cos(angle))
    width = film.parameters.grid.width
    expected = [0.0, 0.0, 0.0, -np.pi * R * width**3 / 12]
    np.testing.assert_allclose(load, expected, atol=1e-4 * abs(expected[3]))


def test_watched_gap_holds_gauss_points_and_nodes(film, journal):
    x = 1e-6 * np.random.default_rng(8).uniform(-1, 1, journal.size)
    inside = journal.film_gap(x, x, SPEED).thickness.ravel()
    gap = journal.gap(x)
    np.testing.assert_allclose(gap[: len(inside)], inside, rtol=1e-12)
    angle, z = film.parameters.grid.node_positions.T
    e_x, e_y, psi_x, psi_y = x[:4]
    rigid = x.copy()
    rigid[4:] = 0.0
    moved = (e_x + z * psi_y) * np.cos(angle) + (e_y - z * psi_x) * np.sin(angle)
    np.testing.assert_allclose(journal.gap(rigid)[len(inside) :], C - moved, rtol=1e-12)


# --- Residual and derivative


def shaft_in_housing(film, **dry):
    """Rigid shaft that tilts, on springs, in a flexible bore: eight coordinates."""
    body = flexible(film)
    journal = ShaftJournal(body, film, FREE_SHAFT)
    mass, inertia, gyroscopic = 4.0, 0.02, 0.005 * SPEED
    damping = np.zeros((4, 4))
    damping[2, 3], damping[3, 2] = gyroscopic, -gyroscopic
    damping += np.diag([50.0, 50.0, 0.5, 0.5])

    def force(time):
        turning = 2000.0 * np.array([np.cos(SPEED * time), np.sin(SPEED * time)])
        return np.array([*turning, -0.02 * turning[1], 0.02 * turning[0]])

    shaft = DrySystem(
        np.diag([mass, mass, inertia, inertia]), damping, np.diag([2e6, 2e6, 8e3, 8e3]), force
    )
    stiffness = body.stiffness
    housing = DrySystem(body.mass, 1e-6 * stiffness, stiffness, lambda time: np.zeros(body.modes))
    return Rotor(shaft.beside(housing), journal, SPEED)


@pytest.mark.parametrize("shifts", [(0.0, 0.0), (2e3, 4e6), (1e6, 1e12)])
@pytest.mark.parametrize("seed", [1, 2])
def test_derivative_equals_central_differences(film, shifts, seed):
    rotor = shaft_in_housing(film)
    rng = np.random.default_rng(seed)
    scale = np.array([4e-6, 4e-6, 2e-4, 2e-4, *4 * [5e-7]])
    x = scale * rng.uniform(-1, 1, 8)
    state = x, 1e3 * scale * rng.uniform(-1, 1, 8), 1e6 * scale * rng.uniform(-1, 1, 8)
    _, found, here = linearise(rotor, 1e-3, *state, shifts)
    full = here.pressure > 1e-9 * here.pressure.max()

    def residual(change):
        follow = [a + f * change for a, f in zip(state, (1.0, *shifts), strict=True)]
        values, _, there = linearise(rotor, 1e-3, *follow, shifts, here)
        flooded = there.pressure > 1e-9 * there.pressure.max()
        assert np.array_equal(full, flooded), "choose a state away from a change of partition"
        return values

    size = min(1e-5, 1.0 / (1.0 + shifts[0])) * scale
    expected = np.column_stack(
        [
            (residual(s * u) - residual(-s * u)) / (2 * s)
            for s, u in zip(size, np.eye(8), strict=True)
        ]
    )
    limit = np.sqrt(np.outer(np.diag(np.abs(expected)), np.diag(np.abs(expected))))
    assert np.all(np.abs(found - expected) <= 1e-5 * limit)


def test_steps_solve_the_equations_of_motion(film):
    rotor = shaft_in_housing(film)
    rest = np.zeros(rotor.size)
    control = StepControl(1e-4, 1e-8, 1e-14, 1e-3)
    for step in steps_of(rotor, 1e-4, rest, rest, control):
        state = step.x, step.rate, step.acceleration
        residual, _, found = linearise(rotor, step.time, *state, (0.0, 0.0))
        sizes = np.abs(rotor.dry.mass @ step.acceleration) + np.abs(rotor.dry.stiffness @ step.x)
        sizes += np.abs(rotor.journal.load[1:]) @ found.pressure
        assert np.all(np.abs(residual) < 1e-4 * sizes.max())
    assert step.watched.min() < 0.99 * C


def balance_of(rotor, end, tolerance):
    """Energy balance error of a run from rest."""
    rest = np.zeros(rotor.size)
    balance = EnergyBalance(0.0, rotor.initial_powers())
    control = StepControl(tolerance, 1e-8, 1e-14, 1e-3)
    for step in steps_of(rotor, end, rest, rest, control):
        balance.add(step.time, rotor.powers(step.x, step.rate, step.auxiliary))
    return balance.error


def test_energy_balance_closes_with_the_tolerance(film, figure):
    rotor = shaft_in_housing(film)
    # A force that is there at once is the hardest start: order 2 is tolerance^(2/3).
    loose, tight = (balance_of(rotor, 5e-4, tolerance) for tolerance in (1e-4, 1e-6))
    figure("rotor", "energy balance from a sudden force", tight, most=3e-3, unit="%")
    assert tight < loose / 8


# --- The scene


def short(**sections):
    given = {
        "shaft": Shaft(revolutions=0.02),
        "force": Force(ramp=0.0),
        "time": Time(tolerance=1e-4),
    }
    return RotorSettings(**{**given, **sections})


def run(settings, body):
    rows = []
    totals = simulate(settings, body, Totals(), lambda row, fields: rows.append((row, fields)))
    columns = {name: np.array([row[name] for row, _ in rows]) for name in rows[0][0]}
    return totals, columns, rows[-1][1]


@pytest.fixture(scope="module")
def scene_film():
    return make_film((20, 3))


def test_scene_runs_and_says_what_it_did(scene_film):
    body = flexible(scene_film)
    totals, columns, fields = run(short(), body)
    end = 0.02 * 2 * np.pi / SPEED
    assert columns["time_s"][-1] == pytest.approx(end, rel=1e-12)
    assert totals.steps == len(columns["time_s"])
    assert totals.energy_error < 2e-2
    assert totals.max_pressure == columns["max_pressure_Pa"].max() > 0
    assert totals.min_film_thickness == columns["min_film_thickness_m"].min()
    assert list(columns)[:3] == ["time_s", "max_pressure_Pa", "min_film_thickness_m"]
    assert len(fields["coordinates"]) == 24
    assert np.all(columns["drive_W"] > 0)
    assert np.all(columns["film_loss_W"] >= 0)


def test_a_force_half_way_does_not_tilt(scene_film):
    _, columns, _ = run(short(force=Force(position=0.5, ramp=0.0)), held_body(scene_film))
    assert np.abs(columns["tilt_x_rad"]).max() < 1e-12
    assert np.abs(columns["tilt_y_rad"]).max() < 1e-12
    assert columns["eccentricity_x_m"][-1] > 1e-9
    _, columns, _ = run(short(), held_body(scene_film))
    assert columns["tilt_y_rad"][-1] > 1e-9


def test_a_run_goes_on_from_where_it_was(scene_film):
    settings, body = short(), flexible(scene_film)
    rows, memories, resumed = [], [], []
    simulate(
        settings,
        body,
        Totals(),
        lambda row, _: rows.append(row),
        checkpoint=lambda run: memories.append(deepcopy(run.memory())),
    )
    half = len(rows) // 2
    simulate(
        settings, body, Totals(), lambda row, _: resumed.append(row), memory=memories[half - 1]
    )
    # To the last bit; the error estimate is not a number, as nothing is known of the rest.
    expected, found = ([list(row.values()) for row in part] for part in (rows[half:], resumed))
    np.testing.assert_array_equal(found, expected)


def test_a_ramp_begins_gently():
    settings = short(force=Force(ramp=0.1))
    rotor = build_rotor(settings)
    assert rotor.size == 20
    force, end = rotor_system(settings, rotor).force, 0.1 * 2 * np.pi / SPEED
    assert np.abs(force(0.0)).max() == 0.0
    assert np.abs(force(1e-3 * end)).max() < 1e-5 * np.abs(force(end)).max()
    turned = 3600 * np.array([np.cos(0.2 * np.pi), np.sin(0.2 * np.pi)])
    np.testing.assert_allclose(force(end), rotor.deflection(0.75).T @ turned)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"shaft": {"modes": 7}}, "shaft.modes = 7 must be even"),
        ({"shaft": {"modes": 20, "elements": 3}}, "at most 16"),
        ({"bearing": {"clearance": 2e-3}}, "bearing.clearance = 0.002"),
        ({"shaft": {"diameter": 0.05}}, "shaft.diameter = 0.05 m must be that of the bore, 0.045"),
        ({"shaft": {"diameter": 0.0444}}, "0.045 m, within 1 %"),
        ({"time": {"smallest_step": 1e-5}}, "time.smallest_step = 1e-05"),
    ],
)
def test_scenes_that_cannot_be_built_are_named(scene_film, tables, message):
    with pytest.raises(SettingsError, match=message):
        simulate(build(RotorSettings, tables), held_body(scene_film), Totals())


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"shaft": {"diameter": 45}}, "shaft.diameter = 45.0 must be below 10: in m, 0.025 for"),
        ({"shaft": {"length": 1000}}, "shaft.length = 1000.0 must be below 100: in m"),
        ({"bearing": {"clearance": 17}}, "bearing.clearance = 17.0 must be below 0.005: in m"),
        ({"shaft": {"clearance": 17e-6}}, "did you mean bearing.clearance?"),
    ],
)
def test_lengths_in_millimetres_are_refused(tables, message):
    with pytest.raises(SettingsError) as caught:
        build(RotorSettings, tables)
    assert message in str(caught.value)


def test_what_needs_no_housing_is_refused_before_its_reduction():
    check_before_reduction(RotorSettings())
    for tables, message in (
        ({"shaft": {"modes": 7}}, "shaft.modes = 7"),
        ({"time": {"smallest_step": 1e-5}}, "time.smallest_step = 1e-05"),
    ):
        with pytest.raises(SettingsError, match=message):
            check_before_reduction(build(RotorSettings, tables))


def test_a_free_body_is_no_housing(scene_film):
    body = replace(held_body(scene_film), frame="mean-axis")
    with pytest.raises(SettingsError, match="frame is mean-axis"):
        build_mechanism(RotorSettings(), body)
