"""Relaxation and block pivots, which judge SNES-VI, against all active sets and tables."""

import numpy as np
import pytest
from differences import numbers
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle_cavitation import (
    block_pivot,
    complementarity_residual,
    enumerate_active_sets,
    finite_volumes,
    journal_load,
    projected_sor,
)
from scipy import sparse

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


def by_relaxation(matrix, rhs):
    return projected_sor(matrix, rhs, 1e-11)


SOLVERS = (by_relaxation, block_pivot)


@st.composite
def problems(draw, largest=9):
    """Well-conditioned symmetric positive definite matrices with couplings of both signs."""
    n = draw(st.integers(1, largest))
    factor = draw(numbers(n, n))
    dense = factor @ factor.T + 0.05 * np.eye(n)
    return sparse.csr_matrix(dense), draw(numbers(n))


def bearing(eccentricity, cells=(120, 24), width=2.0):
    return finite_volumes(lambda x: 1 + eccentricity * np.cos(x), width, cells, periodic=True)


def close(pressure, expected, accuracy=1e-7):
    return np.abs(pressure - expected).max() <= accuracy * max(1.0, np.abs(expected).max())


@pytest.mark.parametrize("solver", SOLVERS)
@given(problem=problems())
@settings(max_examples=25)
def test_every_solver_finds_the_one_right_active_set(solver, problem):
    matrix, rhs = problem
    assert close(solver(matrix, rhs), enumerate_active_sets(matrix.toarray(), rhs))


@given(problem=problems(largest=30))
@settings(max_examples=25)
def test_relaxation_and_pivots_agree_where_active_sets_are_too_many(problem):
    matrix, rhs = problem
    pivoted = block_pivot(matrix, rhs)
    assert close(by_relaxation(matrix, rhs), pivoted)
    if rhs.any():
        assert complementarity_residual(matrix, rhs, pivoted) < 1e-9


def test_enumeration_finds_a_known_solution():
    # The second node would have the pressure -1 in a full film.
    matrix, rhs = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([3.0, 0.0])
    np.testing.assert_allclose(enumerate_active_sets(matrix, rhs), [1.5, 0.0])
    with pytest.raises(ValueError, match="15 nodes"):
        enumerate_active_sets(np.eye(15), np.ones(15))


def test_single_pivots_end_exchanges_of_whole_zones_that_cycle():
    dense, rhs = np.array(CYCLING), np.array([3.0, 1, 0, 3, -2, -1])
    found = block_pivot(sparse.csr_matrix(dense), rhs)
    assert close(found, enumerate_active_sets(dense, rhs))


@pytest.mark.parametrize(("eccentricity", "load", "attitude", "largest"), RIGID_BEARING)
def test_finite_volume_bearing_matches_table(eccentricity, load, attitude, largest):
    volumes = bearing(eccentricity)
    pressure = block_pivot(volumes.matrix, volumes.rhs)
    found = journal_load(volumes, pressure)
    assert abs(found) == pytest.approx(load, rel=5e-3)
    assert np.degrees(np.angle(found)) == pytest.approx(attitude, abs=0.05)
    assert pressure.max() == pytest.approx(largest, rel=5e-3)


def test_finite_volume_load_converges_to_second_order():
    errors = []
    for cells in ((80, 16), (160, 32), (320, 64)):
        volumes = bearing(0.6, cells)
        found = journal_load(volumes, block_pivot(volumes.matrix, volumes.rhs))
        errors.append(abs(abs(found) / 0.436957 - 1))
    assert np.log2(np.array(errors[:-1]) / errors[1:]).min() > 1.8
    assert errors[-1] < 5e-4


def test_minpack_journal_bearing_minimum():
    """-0.18060: two grids and Richardson's extrapolation."""
    minima = []
    for cells in ((50, 50), (100, 100)):
        volumes = finite_volumes(lambda x: 1 + 0.1 * np.cos(x), 20.0, cells, periodic=False)
        p = block_pivot(volumes.matrix, volumes.rhs)
        minima.append(0.5 * p @ (volumes.matrix @ p) - volumes.rhs @ p)
    assert minima[1] == pytest.approx(-0.18060, abs=1e-4)
    assert minima[1] + (minima[1] - minima[0]) / 3 == pytest.approx(-0.18060, abs=1e-5)
