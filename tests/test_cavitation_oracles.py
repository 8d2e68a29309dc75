"""The competitors of SNES-VI against each other, against all active sets and against tables."""

from itertools import pairwise

import numpy as np
import pytest
from differences import numbers
from film_solvers import (
    PetscLinearSolver,
    block_pivot,
    colour,
    complementarity_residual,
    penalty,
    projected_sor,
    relaxation_factor,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle_cavitation import enumerate_active_sets, finite_volumes, journal_load
from scipy import sparse

EPSILON = 1e-9  # of the penalty

# Plain 360-degree bearing, L/D = 1, periodic complementarity: eccentricity ratio, load over
# 6 eta omega (R/c)^2 R L, attitude [deg], largest pressure over 6 eta omega (R/c)^2.
RIGID_BEARING = [
    (0.2, 0.0849692, 77.66, 0.0802672),
    (0.6, 0.436957, 51.9785, 0.530659),
    (0.9, 2.81281, 26.7017, 5.68401),
    (0.95, 6.27285, 19.5371, 16.369),
]

# Symmetric positive definite, found by a search: whole zones come and go for ever.
CYCLING = [
    [461.0, 140, -180, 220, 120, 0],
    [140, 661, 520, -80, 360, -300],
    [-180, 520, 661, -120, 240, -340],
    [220, -80, -120, 401, 20, -20],
    [120, 360, 240, 20, 341, -100],
    [0, -300, -340, -20, -100, 261],
]


def direct():
    return PetscLinearSolver({"ksp_type": "preonly", "pc_type": "lu"})


def by_relaxation(matrix, rhs, guess=None):
    factor = relaxation_factor(matrix)
    return projected_sor(matrix, rhs, guess, 1e-11, factor=factor, max_sweeps=20_000)


def by_block_pivots(matrix, rhs, guess=None):
    return block_pivot(matrix, rhs, guess, 1e-13, direct())


def by_goenka(matrix, rhs, guess=None):
    return block_pivot(matrix, rhs, guess, 1e-13, direct(), patience=None)


def by_penalty(matrix, rhs, guess=None):
    return penalty(matrix, rhs, guess, 1e-12, direct(), epsilon=EPSILON)


SOLVERS = (by_relaxation, by_block_pivots, by_goenka, by_penalty)


@st.composite
def problems(draw, largest=9):
    """Well-conditioned symmetric positive definite matrices with couplings of both signs."""
    n = draw(st.integers(1, largest))
    factor = draw(numbers(n, n))
    dense = factor @ factor.T + 0.05 * np.eye(n)
    return sparse.csr_matrix(dense), draw(numbers(n))


def bearing(eccentricity, cells=(120, 24), width=2.0):
    return finite_volumes(lambda x: 1 + eccentricity * np.cos(x), width, cells, periodic=True)


def minpack(cells):
    """MINPACK-2's journal bearing: the same equation with a gap of 1 + 0.1 cos x."""
    return finite_volumes(lambda x: 1 + 0.1 * np.cos(x), 20.0, cells, periodic=False)


def energy(volumes, pressure):
    return 0.5 * pressure @ (volumes.matrix @ pressure) - volumes.rhs @ pressure


def close(pressure, expected, accuracy=1e-7):
    return np.abs(pressure - expected).max() <= accuracy * max(1.0, np.abs(expected).max())


@pytest.mark.parametrize("solver", SOLVERS)
@given(problem=problems())
@settings(max_examples=25)
def test_every_solver_finds_the_one_right_active_set(solver, problem):
    matrix, rhs = problem
    expected = enumerate_active_sets(matrix.toarray(), rhs)
    result = solver(matrix, rhs)
    # Exchanging whole zones may cycle, and says so; the other two always arrive.
    assert result.converged or solver in (by_goenka, by_penalty)
    if result.converged:
        # A penalty leaves -epsilon times the defect where it should leave zero.
        defect = np.abs(matrix @ expected - rhs).max()
        slack = EPSILON * defect * np.linalg.cond(matrix.toarray()) if solver is by_penalty else 0.0
        assert np.abs(result.pressure - expected).max() <= slack + 1e-7 * max(1.0, expected.max())


@given(problem=problems(largest=30))
@settings(max_examples=25)
def test_relaxation_and_pivots_agree_where_active_sets_are_too_many(problem):
    matrix, rhs = problem
    relaxed, pivoted = by_relaxation(matrix, rhs), by_block_pivots(matrix, rhs)
    assert relaxed.converged
    assert pivoted.converged
    assert close(relaxed.pressure, pivoted.pressure)
    assert pivoted.pressure.min() >= 0
    if rhs.any():
        assert complementarity_residual(matrix, rhs, pivoted.pressure) < 1e-9


@given(problem=problems(), start=st.integers(0, 2**9 - 1))
@settings(max_examples=25)
def test_the_start_does_not_change_the_solution(problem, start):
    matrix, rhs = problem
    n = len(rhs)
    guess = ((start >> np.arange(n)) % 2).astype(float)
    expected = enumerate_active_sets(matrix.toarray(), rhs)
    for solver in (by_relaxation, by_block_pivots):
        assert close(solver(matrix, rhs, guess).pressure, expected)


def test_enumeration_finds_a_known_solution():
    # The second node would have the pressure -1 in a full film.
    matrix, rhs = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([3.0, 0.0])
    np.testing.assert_allclose(enumerate_active_sets(matrix, rhs), [1.5, 0.0])
    with pytest.raises(ValueError, match="15 nodes"):
        enumerate_active_sets(np.eye(15), np.ones(15))


def test_exchange_of_whole_zones_can_cycle_and_single_pivots_end_it():
    dense = np.array(CYCLING)
    assert np.linalg.eigvalsh(dense)[0] > 0.9
    matrix, rhs = sparse.csr_matrix(dense), np.array([3.0, 1, 0, 3, -2, -1])
    assert not by_goenka(matrix, rhs).converged
    assert not by_penalty(matrix, rhs).converged
    result = by_block_pivots(matrix, rhs)
    assert result.converged
    assert close(result.pressure, enumerate_active_sets(dense, rhs))


@pytest.mark.parametrize("shift", [0.0, 0.05, 0.3, 0.6])
def test_consistent_mass_is_taken_as_printed(shift):
    """Linear elements on a line: p and N^-1 (A p - b) complementary, N never inverted."""
    n = 12
    matrix = sparse.diags([-1.0, 2.0, -1.0], [-1, 0, 1], (n, n), format="csr") * (n + 1)
    mass = sparse.diags([1.0, 4.0, 1.0], [-1, 0, 1], (n, n), format="csr") / 6 / (n + 1)
    rhs = mass @ np.sin(2 * np.pi * (np.arange(1, n + 1) / (n + 1) + shift))
    printed = np.linalg.solve(mass.toarray(), np.column_stack([matrix.toarray(), rhs]))
    expected = enumerate_active_sets(printed[:, :n], printed[:, n])
    pivoted = block_pivot(matrix, rhs, None, 1e-13, direct(), mass=mass)
    penalised = penalty(matrix, rhs, None, 1e-12, direct(), epsilon=EPSILON, mass=mass)
    assert 0 < np.count_nonzero(expected) < n
    for result in (pivoted, penalised):
        assert result.converged
        assert close(result.pressure, expected)


@pytest.mark.parametrize("solver", SOLVERS)
def test_no_source_gives_no_pressure(solver):
    result = solver(bearing(0.0, (12, 6)).matrix, np.zeros(60))
    assert result.converged
    assert not result.pressure.any()


@pytest.mark.parametrize("solver", SOLVERS)
def test_own_solution_as_start_is_recognised_at_once(solver):
    volumes = bearing(0.8, (48, 12))
    cold = solver(volumes.matrix, volumes.rhs)
    warm = solver(volumes.matrix, volumes.rhs, cold.pressure)
    assert cold.iterations > warm.iterations
    assert warm.iterations == (20 if solver is by_relaxation else 1)
    assert close(warm.pressure, cold.pressure)


def test_relaxation_out_of_time_says_so():
    volumes = bearing(0.8, (48, 12))
    factor = relaxation_factor(volumes.matrix)
    result = projected_sor(volumes.matrix, volumes.rhs, None, 1e-13, factor=factor, time_limit=0.0)
    assert not result.converged
    assert not result.pressure.any()


def test_young_s_factor_is_exact_for_the_5_point_scheme():
    # Poisson's equation on 11 x 11 nodes: Jacobi's spectral radius is cos(pi / 12).
    volumes = finite_volumes(np.ones_like, 2 * np.pi, (12, 12), periodic=False)
    assert relaxation_factor(volumes.matrix) == pytest.approx(2 / (1 + np.sin(np.pi / 12)), 1e-6)


def test_nodes_of_a_colour_are_not_coupled():
    matrix = bearing(0.5, (15, 7)).matrix
    colouring = colour(matrix)
    assert sorted(colouring.order) == list(range(matrix.shape[0]))
    for first, last in pairwise(colouring.starts):
        nodes = colouring.order[first:last]
        block = matrix[nodes][:, nodes]
        assert block.nnz == len(nodes)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(("eccentricity", "load", "attitude", "largest"), RIGID_BEARING)
def test_finite_volume_bearing_matches_table(solver, eccentricity, load, attitude, largest):
    volumes = bearing(eccentricity)
    result = solver(volumes.matrix, volumes.rhs)
    assert result.converged
    assert complementarity_residual(volumes.matrix, volumes.rhs, result.pressure) < 1e-9
    found = journal_load(volumes, result.pressure)
    assert abs(found) == pytest.approx(load, rel=5e-3)
    assert np.degrees(np.angle(found)) == pytest.approx(attitude, abs=0.05)
    assert result.pressure.max() == pytest.approx(largest, rel=5e-3)


def test_finite_volume_load_converges_to_second_order():
    errors = []
    for cells in ((80, 16), (160, 32), (320, 64)):
        volumes = bearing(0.6, cells)
        found = journal_load(volumes, by_block_pivots(volumes.matrix, volumes.rhs).pressure)
        errors.append(abs(abs(found) / 0.436957 - 1))
    assert np.log2(np.array(errors[:-1]) / errors[1:]).min() > 1.8
    assert errors[-1] < 5e-4


@pytest.mark.parametrize("solver", SOLVERS)
def test_loads_agree_to_a_millionth(solver):
    volumes = bearing(0.9)
    exact = by_block_pivots(volumes.matrix, volumes.rhs).pressure
    found = solver(volumes.matrix, volumes.rhs).pressure
    load = abs(journal_load(volumes, exact))
    assert abs(journal_load(volumes, found - exact)) < 1e-6 * load


@pytest.mark.parametrize("solver", SOLVERS)
def test_minpack_journal_bearing_minimum(solver):
    """-0.18060: two grids and Richardson's extrapolation."""
    coarse, fine = (minpack(cells) for cells in ((50, 50), (100, 100)))
    results = [solver(v.matrix, v.rhs) for v in (coarse, fine)]
    assert all(result.converged for result in results)
    minima = [energy(v, r.pressure) for v, r in zip((coarse, fine), results, strict=True)]
    assert minima[1] == pytest.approx(-0.18060, abs=1e-4)
    assert minima[1] + (minima[1] - minima[0]) / 3 == pytest.approx(-0.18060, abs=1e-5)
