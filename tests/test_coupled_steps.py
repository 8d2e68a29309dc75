"""Steps of film and mechanism together: derivatives, the film nested, residual patterns."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_rod import CLEARANCE, REVOLUTION, Joint, flexible, make_body, make_mechanism
from nested_film import NestedFilm
from oracle_quasi_static import massless_coordinates

from fenics_ehd.film import Film, FilmParameters, Lubricant, uniform_grid
from fenics_ehd.multibody import coupled
from fenics_ehd.multibody.bdf import StepControl, integrate
from fenics_ehd.multibody.bordered import SparseSystem
from fenics_ehd.multibody.coupled import CoupledSteps
from fenics_ehd.multibody.coupled_equations import CoupledEquations
from fenics_ehd.multibody.dense_system import DenseSystem
from fenics_ehd.multibody.newton import ImplicitStep
from fenics_ehd.reduction.body import ResidualFlexibility

pytestmark = pytest.mark.kernels

FAMILIES = ["lagrange", "serendipity", "bilinear"]


def with_residual(joint, body, rank=7, seed=0):
    """A body with a residual flexibility of smooth random patterns: ``d = J sigma^-1``-like."""
    rng = np.random.default_rng(seed)
    x, y, z = joint.bore_nodes.T
    angle, height = np.arctan2(y, x), z / z.max()
    k = len(joint.pressure_nodes)
    shapes = np.stack(
        [np.cos((i + 1) * angle + i) * (1 + 0.5 * np.cos(i * height)) for i in range(rank)], axis=-1
    )
    outward = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    displacement = outward[:, :, None] * shapes[:, None, :]
    from hand_made_rod import pressure_work

    load = pressure_work(joint, displacement)
    # Unit amplitudes move the bore by a micrometre under 20 MPa.
    stiffness = 20e6 * rng.uniform(0.5, 2.0, rank) * np.abs(load).sum(axis=1) / 1e-6
    # Amplitudes in pascal: y = V p with V = load / (stiffness of y).
    factor = np.abs(load).sum(axis=1) / stiffness
    displacement = displacement * factor
    load = load * factor[:, None]
    energy = stiffness * factor**2
    residual = ResidualFlexibility(displacement, load / energy[:, None], energy, np.zeros((0, 0)))
    assert residual.patterns.shape == (rank, k)
    return replace(body, residual=residual)


def film_of(joint, family, cells=(12, 3)):
    grid = uniform_grid(joint.film.parameters.grid.radius, joint.film.parameters.grid.width,
                        cells, family)  # fmt: skip
    return Film(FilmParameters(grid, CLEARANCE, Lubricant(0.01), 500.0))


def mechanism_with(family, residual, damping_time=1e-3):
    joint = Joint()
    body = flexible(joint)[0]
    if residual:
        body = with_residual(joint, body)
    joint.film = film_of(joint, family)
    return make_mechanism(body, joint, damping_time)


def some_step(mechanism, shift=2e3, seed=0):
    """A step in the middle of motion, its values random."""
    rng = np.random.default_rng(seed)
    n, size = mechanism.journal.coordinates, mechanism.size
    scale = np.append(np.full(2, 5e-6), np.full(size - 2, 1e-6))
    scale[n:] = 1e6
    past = [factor * scale * rng.uniform(-1, 1, size) for factor in (1e3, 1e7)]
    x = scale * rng.uniform(-1, 1, size)
    return ImplicitStep(1.3e-3, shift, *past, x, x, (np.ones(1), np.ones(1)), 1e-7), rng


def dense(lin, pattern, full):
    """The matrix of all unknowns from its parts, a W^-1 before the film's rows."""
    m, n = len(lin.along), len(lin.slope)
    film = pattern.matrix(lin.entries).toarray()
    if lin.pattern_block is not None:
        film[:, full] += lin.pattern_block(np.arange(m), full)
    film = film + lin.patterns_along @ lin.patterns
    matrix = np.zeros((m + n, m + n))
    matrix[:m, :m], matrix[:m, m:] = film, lin.along
    if lin.weights is not None:
        matrix[:m] = np.linalg.solve(pattern.matrix(lin.weights).toarray(), matrix[:m])
    matrix[m:, :m], matrix[m:, m:] = -lin.coupling, lin.slope
    return matrix


@pytest.mark.parametrize("dense_patterns", [True, False])
@pytest.mark.parametrize("residual", [False, True])
@pytest.mark.parametrize("family", FAMILIES)
def test_derivatives_equal_central_differences(family, residual, dense_patterns):
    mechanism = mechanism_with(family, residual)
    equations = CoupledEquations(mechanism, dense_patterns=dense_patterns)
    step, rng = some_step(mechanism)
    equations.begin(step)
    pressure = 3e7 * rng.uniform(0, 1, equations.film.assembly.size)
    start = equations.unknowns(pressure, step.start[: equations.n])
    here = equations.evaluate(start)
    full = np.arange(equations.m)
    pattern = equations.film.assembly.pattern
    matrix = dense(equations.linearise(here), pattern, full)

    def function(unknowns):
        point = equations.evaluate(unknowns)
        return np.concatenate([point.film, point.motion])

    step_size = 1e-5
    for _ in range(6):
        # Along pressures, along coordinates, along both.
        direction = rng.uniform(-1, 1, len(start))
        sides = [function(start + h * direction) for h in (step_size, -step_size)]
        expected = (sides[0] - sides[1]) / (2 * step_size)
        found = matrix @ direction
        for part in (slice(0, equations.m), slice(equations.m, None)):
            scale = (np.abs(matrix) @ np.abs(direction))[part].max()
            np.testing.assert_allclose(found[part], expected[part], atol=2e-8 * scale)


@pytest.mark.parametrize("changes", [(0, 0), (6, 0), (0, 6), (7, 5)])
@pytest.mark.parametrize("residual", [False, True])
def test_factors_serve_a_partition_that_changed_a_little(residual, changes):
    mechanism = mechanism_with("lagrange", residual)
    step, rng = some_step(mechanism)
    pattern = mechanism.journal.film.assembly.pattern
    equations = CoupledEquations(mechanism, dense_patterns=True)
    equations.begin(step)
    m, n = equations.m, equations.n
    pressure = 3e7 * rng.uniform(0, 1, equations.film.assembly.size)
    point = equations.evaluate(equations.unknowns(pressure, step.start[:n]))
    lin = equations.linearise(point)
    order = rng.permutation(m)
    half, (filled, emptied) = m // 2, changes
    factorised = np.sort(order[:half])
    full = np.sort(order[emptied : half + filled])
    kept, fresh = DenseSystem(pattern), DenseSystem(pattern)
    kept.factorise(lin, factorised)
    assert kept.repartition(full)
    fresh.factorise(lin, full)
    film, rest = np.zeros(m), rng.uniform(-1, 1, n)
    film[full] = rng.uniform(-1, 1, len(full))
    for found, expected in zip(kept.solve(film, rest), fresh.solve(film, rest), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
    # Back to where it was, and too far.
    assert kept.repartition(factorised)
    assert not kept.repartition(np.sort(order[half:]))


@pytest.mark.parametrize("residual", [False, True])
@pytest.mark.parametrize("family", FAMILIES)
def test_both_linear_solvers_solve_the_system_on_a_partition(family, residual):
    mechanism = mechanism_with(family, residual)
    step, rng = some_step(mechanism)
    pattern = mechanism.journal.film.assembly.pattern
    weighted = family == "serendipity"
    for system, patterns in (
        (DenseSystem(pattern), True),
        (SparseSystem(pattern, weighted=weighted, symmetric=True, options_prefix="test_"), False),
    ):
        equations = CoupledEquations(mechanism, dense_patterns=patterns)
        equations.begin(step)
        m, n = equations.m, equations.n
        full = np.flatnonzero(rng.uniform(0, 1, m) > 0.4)
        pressure = 3e7 * rng.uniform(0, 1, equations.film.assembly.size)
        point = equations.evaluate(equations.unknowns(pressure, step.start[:n]))
        lin = equations.linearise(point)
        matrix = dense(lin, pattern, np.arange(m))
        system.factorise(lin, full)
        film, rest = np.zeros(m), rng.uniform(-1, 1, n)
        film[full] = rng.uniform(-1, 1, len(full))
        pressures, xi = system.solve(film, rest)
        assert not np.delete(pressures, full).any()
        rows = np.append(full, np.arange(m, m + n))
        defect = matrix[np.ix_(rows, rows)] @ np.append(pressures[full], xi)
        expected = np.append(film[full], rest)
        np.testing.assert_allclose(defect, expected, atol=1e-9 * np.abs(expected).max())


def curves(mechanism, solve, revolutions=0.02, tolerance=1e-5):
    control = StepControl(tolerance, 1e-8, 1e-13, REVOLUTION / 50)
    rest = np.zeros(mechanism.size)
    span = (0.0, revolutions * REVOLUTION)
    steps = list(integrate(mechanism, span, rest, rest, control, *solve))
    return (
        np.array([s.time for s in steps]),
        np.array([s.auxiliary.film.pressure for s in steps]),
        np.array([s.x for s in steps]),
    )


def assert_same_curves(one, other, tolerance):
    assert len(one[0]) == len(other[0])
    np.testing.assert_allclose(one[0], other[0], rtol=tolerance)
    for a, b in zip(one[1:], other[1:], strict=True):
        np.testing.assert_allclose(a, b, atol=tolerance * np.abs(b).max())


@pytest.mark.parametrize("family", FAMILIES)
def test_steps_are_those_of_the_film_solved_within(family):
    # The same formula and control, another formulation of what a step solves.
    mechanism = mechanism_with(family, residual=False)
    coupled = curves(mechanism, [CoupledSteps(mechanism)])
    # Steps differ by 1e-6 of themselves, what is left of Newton's updates magnified.
    assert_same_curves(coupled, curves(NestedFilm(mechanism), []), 2e-4)


@pytest.mark.parametrize("dense_limit", [0, 10_000])
@pytest.mark.parametrize("damping_time", [1e-6, 1e-3])
def test_residual_patterns_are_coordinates_without_mass(damping_time, dense_limit):
    joint = Joint()
    body = with_residual(joint, flexible(joint)[0])
    mechanism = make_mechanism(body, joint, damping_time)
    found = curves(mechanism, [CoupledSteps(mechanism, dense_limit=dense_limit)])
    other = make_mechanism(massless_coordinates(body), joint, damping_time)
    expected = curves(NestedFilm(other), [])
    # Massless coordinates are metres of the bore; velocities along the circumference, which the
    # patterns leave out, are those of a micrometre in a millisecond against 11 m/s.
    size = np.abs(body.residual.displacement).max(axis=(0, 1))
    found[2][:, -len(size) :] *= size
    moved = np.abs(expected[2][:, -len(size) :]).max()
    assert moved > 1e-8, "the patterns must matter"
    assert len(found[0]) == pytest.approx(len(expected[0]), rel=0.05)
    for name, a, b in zip(("pressure", "state"), found[1:], expected[1:], strict=True):
        np.testing.assert_allclose(a[-1], b[-1], atol=1e-4 * np.abs(b).max(), err_msg=name)


def test_dense_and_sparse_solvers_give_the_same_run():
    mechanism = mechanism_with("lagrange", residual=True)
    runs = [
        curves(mechanism, [CoupledSteps(mechanism, dense_limit=limit)]) for limit in (0, 10_000)
    ]
    assert_same_curves(*runs, 1e-6)


def test_the_film_at_the_end_of_a_step_is_the_solution_for_its_gap():
    mechanism = mechanism_with("lagrange", residual=True)
    control = StepControl(1e-6, 1e-8, 1e-13, REVOLUTION / 50)
    rest = np.zeros(mechanism.size)
    steps = list(
        integrate(mechanism, (0, 0.02 * REVOLUTION), rest, rest, control, CoupledSteps(mechanism))
    )
    for step in steps[3::20]:
        film = step.auxiliary.film
        alone = mechanism.journal.film.solve(film.gap)
        np.testing.assert_allclose(film.pressure, alone.pressure, atol=1e-6 * alone.pressure.max())
        gap = mechanism.journal.gap(step.x)[: film.gap.thickness.size]
        np.testing.assert_allclose(film.gap.thickness.ravel(), gap, rtol=1e-9)


def first_step(mechanism, length=1e-5):
    """From rest, where no extrapolation helps."""
    rest, one = np.zeros(mechanism.size), np.ones(1)
    return ImplicitStep(length, 1 / length, rest, rest, rest, rest, (one, one), 1e-7)


def test_a_film_that_violates_complementarity_is_no_step():
    class Hasty(CoupledSteps):
        """Content with what the first update leaves."""

        def converged(self, iteration):
            return iteration > 0

    mechanism = mechanism_with("lagrange", residual=True)
    assert CoupledSteps(mechanism)(mechanism, first_step(mechanism), None).failure is None
    attempt = Hasty(mechanism)(mechanism, first_step(mechanism), None)
    assert attempt.failure.startswith("CavitationError: the film solution violates complementarity")


def test_full_updates_that_do_not_settle_are_followed_by_damped_ones(monkeypatch):
    mechanism = mechanism_with("lagrange", residual=True)
    usual = CoupledSteps(mechanism)(mechanism, first_step(mechanism), None)
    # One full update is never enough.
    monkeypatch.setattr(coupled, "MAX_ITERATIONS", 1)
    patient = CoupledSteps(mechanism)(mechanism, first_step(mechanism), None)
    assert patient.failure is None
    assert min(usual.iterations, patient.iterations) > 1
    np.testing.assert_allclose(patient.x, usual.x, rtol=1e-6, atol=1e-9 * np.abs(usual.x).max())


def test_a_rigid_body_has_no_elastic_columns():
    joint = Joint()
    mechanism = make_mechanism(make_body(joint), joint)
    assert mechanism.size == mechanism.journal.thickness.shape[1] == 2
    assert CoupledEquations(mechanism, dense_patterns=True).n == 2
