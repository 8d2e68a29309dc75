"""Steps of films and motion together: derivatives, linear algebra, residual patterns."""

from functools import cache

import numpy as np
import pytest
from differences import slope
from hand_made_rod import (
    CLEARANCE,
    RADIUS,
    SPEED,
    WIDTH,
    Joint,
    driven,
    flexible,
    make_mechanism,
    run,
    with_residual,
)
from nested_film import NestedRun
from oracle_quasi_static import massless_coordinates

import fenics_ehd as ehd
from fenics_ehd.multibody import newton as step_solver
from fenics_ehd.multibody.bdf import ImplicitStep, IntegratorOptions
from fenics_ehd.multibody.border import BorderedSystem, ChangedSystem
from fenics_ehd.multibody.mechanism import System, assemble
from fenics_ehd.multibody.newton import CoupledSteps
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.step_equations import StepEquations
from fenics_ehd.multibody.step_norm import StepNorm

pytestmark = pytest.mark.kernels

FAMILIES = ["lagrange", "serendipity", "bilinear"]

#: Oils whose viscosity changes with pressure, with the shear rate, with both.
OILS = {
    "Roelands": ehd.Lubricant(0.01, ehd.Roelands(0.01)),
    "Cross": ehd.Lubricant(0.01, shear_law=ehd.Cross(3e5, 0.8, 0.4)),
    "Barus and Cross": ehd.Lubricant(0.01, ehd.Barus(2e-8), shear_law=ehd.Cross(3e5, 0.8, 0.4)),
}


def mechanism_with(family, residual, oil=None, feeds=()):
    """A crank that torque and gas drive, and a flexible rod."""
    joint = Joint()
    body = flexible(joint)[0]
    if residual:
        body = with_residual(joint, body)
    grid = ehd.uniform_grid(RADIUS, WIDTH, (20, 5) if feeds else (12, 3), family)
    oil = oil or ehd.Lubricant(0.01)
    joint.film = ehd.Film(ehd.FilmParameters(grid, CLEARANCE, oil, SPEED, feeds=feeds))
    return driven(
        make_mechanism(body, joint),
        2e-3,
        torque=ehd.Torque(
            "crank", curve=lambda a: (3 * np.cos(2 * a), -6 * np.sin(2 * a)), damping=0.01
        ),
        gas=ehd.PointForce(
            "piston", (-1.0, 0.0), lambda a: (4e3 * np.sin(a), 4e3 * np.cos(a)), "crank"
        ),
    )


def some_step(equations, shift=2e3, seed=0):
    """Some step and a point of it in the middle of motion, values random; sizes of changes."""
    rng, system = np.random.default_rng(seed), equations.system
    n, m = system.n, system.m
    size = np.where(system.weights == 1.0, 1e-3, 1e-6)
    size[system.films[0].xi[:2]] = 5e-6
    z, _ = assemble(system)
    z = z + size * rng.uniform(-1, 1, n)
    rate, acceleration = 1e3 * size * rng.uniform(-1, 1, n), 1e7 * size * rng.uniform(-1, 1, n)
    y, y_past = 1e6 * rng.uniform(-1, 1, (2, equations.responses.size))
    past = [
        np.concatenate([rate - shift * z, y_past]),
        np.concatenate([acceleration - shift * rate, y_past]),
    ]
    start, nothing = np.concatenate([z, y]), (np.ones(1), np.ones(1))
    equations.begin(ImplicitStep(1.3e-3, shift, *past, start, start, nothing, 1e-7))
    film = system.films[0].film.film
    most = 3e7 / film.parameters.pressure_scale
    nodes = len(equations.films[0].nodes)
    sizes = [np.full(nodes, most), size, np.full(m, 1e3), np.full(m, 1e-3)]
    values = [
        most * rng.uniform(0, 1, nodes), z, 1e3 * rng.uniform(-1, 1, m),
        1e-3 * rng.uniform(-1, 1, m),
    ]  # fmt: skip
    return np.concatenate(values), np.concatenate(sizes), rng


def whole_matrix(equations, derivative):
    """As `joined_matrix`, W^-1 before the film's rows."""
    (film,), found = derivative.films, joined_matrix(equations, derivative)
    m = len(film.inputs)
    if film.weights is not None:
        weights = film.pattern.matrix(film.weights).toarray()
        found[:m] = np.linalg.solve(weights, found[:m])
    return found


def joined_matrix(equations, derivative):
    """Of all unknowns from its parts, leading patterns and contact pressures eliminated."""
    (film,) = derivative.films
    m = len(film.inputs)
    found = np.zeros((m + len(derivative.core),) * 2)
    found[:m, :m] = film.block(np.arange(m), np.arange(m))
    found[:m, m:] = film.inputs @ film.spread
    found[m + film.rows, :m] += film.outputs
    found[m:, m:] = derivative.core
    kept = m + equations.rest_size
    inner = np.linalg.solve(found[kept:, kept:], found[kept:, :kept])
    return found[:kept, :kept] - found[:kept, kept:] @ inner


@pytest.mark.parametrize("residual", [False, True])
@pytest.mark.parametrize("family", FAMILIES)
def test_derivatives_equal_central_differences(family, residual):
    assert_derivatives(mechanism_with(family, residual))


@pytest.mark.parametrize("residual", [False, True])
@pytest.mark.parametrize("oil", OILS)
def test_derivatives_of_oils_that_change_equal_central_differences(oil, residual):
    assert_derivatives(mechanism_with("lagrange", residual, oil=OILS[oil]))


#: A hole that turns with the journal behind a passage, a groove that does, one at rest.
FEEDS = (
    ehd.HoleSupply(
        name="hole",
        on="journal",
        angle=17.0,
        height=1e-3,
        diameter=9e-3,
        pressure=4e6,
        resistance=1e11,
    ),
    ehd.AxialGrooveSupply(
        name="turning", on="journal", angle=115.0, extent=34.0, length=11e-3, pressure=1e6
    ),
    ehd.AxialGrooveSupply(
        name="resting", angle=229.0, height=-1e-3, extent=29.0, length=9e-3, pressure=2e6
    ),
)


@pytest.mark.parametrize("family", FAMILIES)
def test_derivatives_with_supplies_equal_central_differences(family):
    assert_derivatives(mechanism_with(family, False, feeds=FEEDS))


def assert_derivatives(mechanism, most=1e-7):
    """Of all equations along all unknowns and along their kinds; returns where."""
    equations = StepEquations(System(mechanism))
    equations.retain_patterns(100)
    start, sizes, rng = some_step(equations)
    point = equations.evaluate(start)
    matrix = whole_matrix(equations, equations.linearise(point))

    def residual(h):
        return equations.evaluate(start + h * direction).residual

    m, n = len(equations.films[0].nodes), equations.system.n
    parts = (slice(0, m), slice(m, m + n), slice(m + n, None))
    for part in (None, *parts):
        direction = sizes * rng.uniform(-1, 1, len(start))
        if part is not None:
            direction[np.setdiff1d(np.arange(len(start)), np.arange(len(start))[part])] = 0.0
        found, expected = matrix @ direction, slope(residual, step=1e-3)
        # Row by row: forces on frames are next to elastic ones that are 1e9 times as large.
        size = np.abs(matrix) @ sizes
        size[:m] = size[:m].max()
        assert np.all(np.abs(found - expected) <= most * size)
    return point


def linearised(family, residual, seed=0):
    """Equations with their derivatives somewhere, and blocks to factorise."""
    system = System(mechanism_with(family, residual))
    equations = StepEquations(system)
    equations.retain_patterns(100)
    start, _, rng = some_step(equations, seed=seed)
    derivative = equations.linearise(equations.evaluate(start))
    block = equations.films[0].linear_system(f"test_{family}_")
    return equations, derivative, block, rng


@pytest.mark.parametrize("residual", [False, True])
@pytest.mark.parametrize("family", FAMILIES)
def test_the_system_is_solved_on_an_active_set(family, residual):
    equations, derivative, block, rng = linearised(family, residual)
    (matrix,) = derivative.films
    m = len(matrix.inputs)
    whole = whole_matrix(equations, derivative)
    full = np.flatnonzero(rng.uniform(0, 1, m) > 0.4)
    block.prepare(matrix.entries, matrix.weights, full)
    system = BorderedSystem([block], [matrix.on(full)], derivative.core)
    film, rest = np.zeros(m), np.zeros(len(derivative.core))
    film[full] = rng.uniform(-1, 1, len(full))
    rest[: equations.rest_size] = rng.uniform(-1, 1, equations.rest_size)
    weighted = film
    if matrix.weights is not None:
        weighted = matrix.pattern.multiply(matrix.weights, film)
    (pressures,), x = system.solve([weighted], rest)
    assert matrix.weights is not None or not np.delete(pressures, full).any()
    rows = np.append(full, np.arange(m, len(whole)))
    solution = np.append(pressures[full], x[: equations.rest_size])
    expected = np.append(film[full], rest[: equations.rest_size])
    defect = whole[np.ix_(rows, rows)] @ solution - expected
    size = np.abs(whole[np.ix_(rows, rows)]) @ np.abs(solution) + np.abs(expected)
    assert np.all(np.abs(defect) <= 1e-9 * size)


@pytest.mark.parametrize("changes", [(0, 0), (6, 0), (0, 6), (7, 5)])
@pytest.mark.parametrize("residual", [False, True])
def test_factors_serve_an_active_set_that_changed_a_little(residual, changes):
    equations, derivative, block, rng = linearised("lagrange", residual)
    (matrix,) = derivative.films
    m = len(matrix.inputs)
    order = rng.permutation(m)
    half, (filled, emptied) = m // 2, changes
    then, now = np.sort(order[:half]), np.sort(order[emptied : half + filled])
    block.prepare(matrix.entries, None, then)
    former = BorderedSystem([block], derivative.films, derivative.core)
    kept = ChangedSystem(former, [(np.setdiff1d(now, then), np.setdiff1d(then, now))])
    other = equations.films[0].linear_system("test_other_")
    other.prepare(matrix.entries, None, now)
    fresh = BorderedSystem([other], derivative.films, derivative.core)
    film, rest = np.zeros(m), rng.uniform(-1, 1, len(derivative.core))
    film[now] = rng.uniform(-1, 1, len(now))
    for found, expected in zip(
        np.concatenate(kept.solve([film], rest), axis=None),
        np.concatenate(fresh.solve([film], rest), axis=None),
        strict=True,
    ):
        assert found == pytest.approx(expected, rel=1e-6, abs=1e-9)


# --- Runs


@pytest.mark.parametrize("family", FAMILIES)
def test_steps_are_those_of_a_film_solved_within(family):
    # The same formula and control, another formulation of what a step solves.
    mechanism, end = mechanism_with(family, residual=False), 1e-4
    runs = []
    for kind in (Run, NestedRun):
        going = kind(mechanism, IntegratorOptions(tolerance=1e-6), end)
        *before, last = going.until(end)
        runs.append((len(before), going.norm.gaps(last.observed), last.solution.films[0].pressure))
    (steps, gaps, pressure), (expected_steps, expected_gaps, expected) = runs
    assert steps == expected_steps
    np.testing.assert_allclose(gaps, expected_gaps, rtol=1e-6)
    np.testing.assert_allclose(pressure, expected, atol=1e-5 * expected.max())


@cache
def run_without_patterns(damping_time):
    """Of rods whose patterns are coordinates, and are left out."""
    joint = Joint()
    body = flexible(joint)[0]
    return [
        run(make_mechanism(b, joint, damping_time), 0.02, 1e-5)
        for b in (massless_coordinates(with_residual(joint, body)), body)
    ]


@pytest.mark.parametrize("damping_time", [1e-6, 1e-3])
def test_residual_patterns_are_coordinates_without_mass(damping_time):
    joint = Joint()
    body = with_residual(joint, flexible(joint)[0])
    found = run(make_mechanism(body, joint, damping_time), 0.02, 1e-5)
    expected, without = run_without_patterns(damping_time)
    assert len(found.time) == pytest.approx(len(expected.time), rel=0.05)
    # Velocities along the circumference, which the patterns leave out, are those of a micrometre
    # in a millisecond against 11 m/s.
    for name in ("max_pressure_Pa", "min_film_thickness_m"):
        last = [result.columns[name][-1] for result in (found, expected, without)]
        assert last[0] == pytest.approx(last[1], rel=1e-4)
        assert abs(last[2] / last[1] - 1) > 5e-4, "the patterns must matter"


@pytest.mark.parametrize("family", FAMILIES)
def test_the_end_of_a_step_solves_film_and_motion(family):
    mechanism = mechanism_with(family, residual=True)
    going = Run(mechanism, IntegratorOptions(tolerance=1e-6), 2.5e-4)
    system, norm = going.equations.system, going.norm
    place = system.films[0]
    for number, step in enumerate(going.until(2.5e-4)):
        if number % 20 != 3:
            continue
        (film,), motion = step.solution.films, step.solution.motion
        alone = place.film.film.solve(film.gap)
        np.testing.assert_allclose(film.pressure, alone.pressure, atol=1e-6 * alone.pressure.max())
        gap = norm.film_gaps(norm.observe(step.x))[0][: film.gap.thickness.size]
        np.testing.assert_allclose(film.gap.thickness.ravel(), gap, rtol=1e-9)
        # The film's force balances the motion, the joints are closed.
        residual = motion.residual.copy()
        residual[place.xi] -= place.film.load @ film.pressure
        forces = np.abs(motion.multipliers @ motion.instant.jacobian)
        forces[place.xi] += np.abs(place.film.load) @ film.pressure
        assert np.all(np.abs(residual) <= 1e-4 * forces.max())
        assert np.abs(motion.instant.defect).max() < 1e-11
        assert np.abs(motion.instant.rate_defect(step.rate[: system.n])).max() < 1e-8


def attempt(mechanism, solver=CoupledSteps, length=1e-5):
    """A step from rest, where no extrapolation helps."""
    system = System(mechanism)
    solve = solver(system)
    norm = StepNorm(solve.equations)
    z, rates = assemble(system)
    resting = np.zeros(solve.equations.responses.size)
    x, v = np.append(z, resting), np.append(rates, resting)
    shift = 1 / length
    step = ImplicitStep(length, shift, -shift * x, -shift * v, x, x, (norm.observe(x),) * 2, 1e-7)
    return solve(norm, step, None)


@pytest.mark.parametrize("length", [1e-8, 5e-5])
def test_iterations_without_the_derivative_of_friction_shrink_the_error(length):
    # By the largest eigenvalue of what an iteration leaves of an error, on the step's active set.
    joint = Joint((10, 2))
    mechanism = make_mechanism(flexible(joint)[0], joint, friction=True)
    going = Run(driven(mechanism, 2e-3), IntegratorOptions(tolerance=1e-3), 2.5e-4)
    *_, last = going.until(2.5e-4)
    system, equations, shift = going.equations.system, going.equations, 1.5 / length
    film, motion = system.films[0].film.film, last.solution.motion
    past = last.rate - shift * last.x, last.acceleration - shift * last.rate
    nothing = np.ones(1), np.ones(1)
    equations.begin(ImplicitStep(last.time, shift, *past, last.x, last.x, nothing, 1e-7))
    pressure = last.solution.films[0].pressure[film.free] / film.parameters.pressure_scale
    start = np.concatenate([pressure, last.x, motion.multipliers, np.zeros(system.m)])
    matrix = whole_matrix(equations, equations.linearise(equations.evaluate(start)))
    free = np.append(pressure > 1e-12, np.full(equations.rest_size, True))
    steps = np.concatenate(
        [
            np.full(len(pressure), 1e-6),
            np.where(system.weights == 1.0, 1e-6, 1e-10) / max(1.0, 1e-6 * shift),
            np.full(2 * system.m, 1e-2),
        ]
    )

    def function(change):
        return equations.evaluate(start + change).residual[free]

    # Differences of rows and columns of one size.
    exact = np.column_stack([
        slope(lambda h, u=u: function(h * u)) for u in np.diag(steps)[free]
    ])  # fmt: skip
    kept = matrix[np.ix_(free, free)] * steps[free]
    left = np.linalg.eigvals(np.linalg.solve(kept, kept - exact))
    assert 1e-5 < np.abs(left).max() < 1e-3


def test_a_film_that_violates_complementarity_is_no_step():
    class Hasty(CoupledSteps):
        """Content with what the first update leaves."""

        def converged(self, iteration):
            return iteration > 0

    mechanism = mechanism_with("lagrange", residual=True)
    assert attempt(mechanism).solved is not None
    failure = attempt(mechanism, Hasty).cause
    assert isinstance(failure, ehd.errors.CavitationError)
    assert str(failure).startswith("the film solution violates complementarity")


def test_full_updates_that_do_not_settle_are_followed_by_damped_ones(monkeypatch):
    mechanism = mechanism_with("lagrange", residual=True)
    usual = attempt(mechanism)
    # One full update is never enough.
    monkeypatch.setattr(step_solver, "MAX_ITERATIONS", 1)
    patient = attempt(mechanism)
    assert patient.solved is not None
    assert min(usual.iterations, patient.iterations) > 1
    np.testing.assert_allclose(patient.solved.x, usual.solved.x, rtol=1e-6, atol=1e-9)


def test_steps_that_converge_at_once_need_no_search(monkeypatch):
    solve, solves = step_solver.SnesVi.solve, []

    def counted(snes, start):
        solves.append(start)
        return solve(snes, start)

    monkeypatch.setattr(step_solver.SnesVi, "solve", counted)
    mechanism = mechanism_with("lagrange", residual=True)
    going = Run(mechanism, IntegratorOptions(tolerance=1e-5), 2.5e-4)
    steps = list(going.until(2.5e-4))
    assert len(solves) == len(steps) + sum(sum(s.rejected.values()) for s in steps)
