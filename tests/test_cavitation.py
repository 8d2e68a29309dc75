"""Complementarity by SNES-VI against other solvers, and its errors."""

import numpy as np
import pytest
from differences import numbers
from film_cases import FAMILIES, OMEGA, C, R, gap_of, given_gap, make_film, shaft, solve, watch_snes
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from oracle_cavitation import block_pivot, enumerate_active_sets, projected_sor
from petsc4py import PETSc

import fenics_ehd as ehd
from fenics_ehd.film.cavitation import verify_complementarity
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.reduction.elements import ELEMENTS

pytestmark = pytest.mark.kernels

#: Few enough free nodes to try every active set.
SMALL = {"bilinear": (6, 3), "serendipity": (11, 1), "lagrange": (6, 1)}


def linear_system(film, gap):
    """``A`` (free nodes) and ``b`` of (11), dimensionless, of a constant oil."""
    problem = film.equation.problem(gap)
    zero = np.zeros(len(film.free))
    return film.equation.pattern.matrix(problem.entries(zero)), -problem.residual(zero)


def mass_matrix(film):
    """N of (11) on the free nodes of equal cells, dense, by Gauss quadrature of its own."""
    grid = film.parameters.grid
    x, w = np.polynomial.legendre.leggauss(4)
    points = np.array([(a, b) for a in x for b in x]) / 2 + 0.5
    values = ELEMENTS[grid.family].shapes(points)
    weights = np.outer(w, w).ravel() / 4 * 2 * np.pi * grid.width / R / np.prod(grid.cells)
    cell = values.T @ (weights[:, None] * values)
    whole = np.zeros((len(grid.nodes),) * 2)
    for nodes in grid.cell_nodes:
        whole[np.ix_(nodes, nodes)] += cell
    return whole[np.ix_(film.free, film.free)]


def dense_problem(film, gap):
    """Matrix and right-hand side whose complementarity is that of the film."""
    matrix, rhs = linear_system(film, gap)
    matrix = matrix.toarray()
    if film.parameters.grid.family != "serendipity":
        return matrix, rhs
    mass = mass_matrix(film)
    return np.linalg.solve(mass, matrix), np.linalg.solve(mass, rhs)


def rough_gap(film, seed):
    """Smooth bearing with bumps, as of an elastic bore."""
    random = np.random.default_rng(seed)
    gap = gap_of(film, shaft(0.6, 0.2, rate=(20.0, -40.0)))
    bumps, rates = random.uniform(-1, 1, (2, *gap.thickness.shape))
    return Gap(
        gap.thickness + 0.1 * C * bumps,
        gap.thickness_rate + 0.05 * C * OMEGA * rates,
        gap.mean_velocity,
        gap.sliding_velocity,
    )


@pytest.mark.parametrize("family", FAMILIES)
@given(squeeze=numbers(11, 2, largest=0.5), thickness=numbers(11), velocity=st.floats(-0.5, 0.5))
@settings(max_examples=25, suppress_health_check=[HealthCheck.data_too_large])
def test_active_set_is_the_best_of_all(family, squeeze, thickness, velocity):
    around, along = SMALL[family]
    film = make_film((around, along), family, width=R)
    assert len(film.free) <= 14
    cell = np.arange(around * along) // along
    shape = film.points.angle.shape
    # Another squeeze on either half of every cell around.
    half = (film.points.height > 0).astype(int)
    rate = squeeze[cell[:, None], half]
    gap = given_gap(film, 1.0)
    gap = Gap(
        C * (1 + 0.6 * np.broadcast_to(thickness[cell][:, None], shape)),
        C * OMEGA * rate,
        gap.mean_velocity + velocity * OMEGA * R,
        gap.sliding_velocity,
    )
    try:
        found = film.solve(gap).cavitation.pressure
    except ehd.errors.CavitationError:
        assert family == "serendipity"  # N^-1 A is not a P-matrix: there may be no solution
        return
    matrix, rhs = dense_problem(film, gap)
    expected = enumerate_active_sets(matrix, rhs)
    flux = matrix @ found - rhs
    size = np.abs(rhs).max() + 1e-6
    if family == "serendipity":  # nor need it be the only one
        assert flux.min() > -1e-7 * size
        assert np.abs(np.minimum(found / max(found.max(), 1e-9), flux / size)).max() < 1e-7
        return
    np.testing.assert_allclose(found, expected, atol=1e-8 * max(expected.max(), 1e-3))


@pytest.mark.parametrize("family", ["bilinear", "lagrange"])
@pytest.mark.parametrize("cells", [(12, 4), (40, 10)])
def test_snes_vi_agrees_with_relaxation_and_block_pivots(family, cells, figure):
    film = make_film(cells, family)
    gap = rough_gap(film, seed=3)
    state = film.solve(gap)
    matrix, rhs = linear_system(film, gap)
    scale = state.cavitation.pressure.max()
    for expected in (projected_sor(matrix, rhs, 1e-12), block_pivot(matrix, rhs)):
        error = np.abs(state.cavitation.pressure - expected).max() / scale
        figure("film", "pressure, projected relaxation and block pivots", error, most=1e-8)
    assert 0 < len(state.cavitation.full_film) < len(rhs)


@pytest.mark.parametrize("cells", [(12, 3), (20, 5)])
def test_consistent_mass_complementarity_holds_in_its_own_sense(cells):
    film = make_film(cells, "serendipity")
    gap = gap_of(film, shaft(0.6, 0.2, rate=(20.0, -40.0)))
    result = film.solve(gap).cavitation
    matrix, rhs = dense_problem(film, gap)
    flux = matrix @ result.pressure - rhs
    np.testing.assert_allclose(result.flux, flux, atol=1e-9 * np.abs(flux).max())
    assert flux.min() > -1e-8 * np.abs(flux).max()
    assert result.pressure.min() >= 0
    assert np.abs(flux * result.pressure).max() < 1e-8 * np.abs(flux).max() * result.pressure.max()
    # The weak form would not do: its sign at corner nodes is not that of the flux.
    matrix, rhs = linear_system(film, gap)
    weak = matrix @ result.pressure - rhs
    assert weak.min() < -1e-3 * np.abs(weak).max()
    mass = mass_matrix(film).sum(axis=1)
    assert mass.min() < 0 < mass.max()


@pytest.mark.parametrize("family", FAMILIES)
def test_matrix_is_symmetric_positive_definite(family):
    film = make_film((12, 3), family)
    matrix = linear_system(film, rough_gap(film, seed=1))[0].toarray()
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-14 * np.abs(matrix).max())
    assert np.linalg.eigvalsh(matrix)[0] > 0


@pytest.mark.parametrize(("family", "cells"), [("bilinear", (100, 100)), ("lagrange", (50, 25))])
def test_minpack_journal_bearing_has_its_minimum(family, cells, figure):
    # Given to five digits by Averick et al. (1992) for b = 10, eccentricity 0.1.
    grid = ehd.uniform_grid(1.0, 20.0, cells, family)
    film = make_film(grid=grid, clearance=1e-3, regions=(ehd.AxialGroove(0.0, 0.0),))
    gap = given_gap(film, lambda phi, z: 1 + 0.1 * np.cos(phi), 0.0, 1.0)
    pressure = film.solve(gap).cavitation.pressure
    matrix, rhs = linear_system(film, gap)
    error = abs(0.5 * pressure @ matrix @ pressure - rhs @ pressure + 0.18060)
    figure("film", "minimum of the MINPACK-2 journal bearing, -0.18060", error, most=1e-4)


# --- How it is solved, and what happens when it is not


@pytest.mark.parametrize("family", FAMILIES)
def test_every_solve_is_one_of_reduced_space_newton(monkeypatch, family):
    made, begun = watch_snes(monkeypatch)
    film = make_film((64, 6), family)
    state = solve(film, 0.6)
    assert len(made) == len(begun) == 1
    assert {snes.getType() for snes in made} == {"vinewtonrsls"}
    solve(film, 0.61, guess=state)
    assert len(begun) == 2


@pytest.fixture
def petsc_options():
    """Options that are gone after the test."""
    options, names = PETSc.Options(), []

    def add(name, value):
        options[name] = value
        names.append(name)

    yield add
    for name in names:
        options.delValue(name)


@pytest.mark.parametrize("family", FAMILIES)
def test_unfinished_iteration_is_a_named_error_with_its_state(petsc_options, family):
    petsc_options("stubborn_snes_max_it", 1)
    film = make_film((40, 4), family, options_prefix="stubborn_")
    gap = gap_of(film, shaft(0.9))
    with pytest.raises(ehd.errors.CavitationError, match="-stubborn_snes_monitor") as caught:
        film.solve(gap)
    state = caught.value.state
    np.testing.assert_array_equal(state["thickness"], gap.thickness)
    np.testing.assert_array_equal(state["thickness_rate"], gap.thickness_rate)
    np.testing.assert_array_equal(state["mean_velocity"], gap.mean_velocity)
    assert state["pressure"].shape == state["flux"].shape == film.free.shape
    # Other films are not touched, and this one solves an easier problem next.
    assert solve(make_film((40, 4), family), 0.9).pressure.max() > 0
    assert film.solve(given_gap(film, 1.0, rate=1.0)).pressure.max() == 0


def test_options_reach_snes_and_the_factorisation(petsc_options):
    petsc_options("tuned_snes_atol", 1e-3)
    petsc_options("tuned_linear_pc_type", "lu")
    petsc_options("tuned_linear_pc_factor_mat_solver_type", "petsc")
    film = make_film((40, 6), options_prefix="tuned_")
    assert film.cavitation.system._ksp.getPC().getType() == "lu"
    loose, tight = solve(film, 0.8), solve(make_film((40, 6)), 0.8)
    np.testing.assert_allclose(loose.pressure, tight.pressure, atol=1e-2 * tight.pressure.max())


def test_film_too_thin_for_arithmetic_is_a_named_error_and_not_the_end():
    film = make_film((20, 5))
    expected = solve(film, 0.5).pressure
    for thinnest in (1e-60, 1e-110, 1e-110, 1e-200):
        gap = given_gap(film, lambda phi, z, h=thinnest: np.where(np.cos(phi) > 0.95, h, 1), 0, 0.5)
        with pytest.raises(ehd.errors.CavitationError) as caught:
            film.solve(gap)
        assert set(caught.value.state) >= {"thickness", "pressure"}
    np.testing.assert_allclose(solve(film, 0.5).pressure, expected, rtol=1e-9)


@pytest.mark.parametrize("share", [0.5, 2.0])
@pytest.mark.parametrize(
    ("pressure", "flux", "named"),
    [
        ([4.0, 0.0, -4.0], [0.0, 3.0, 0.0], "negative pressure"),
        ([4.0, 0.0, 0.0], [0.0, 3.0, -3.0], "negative flux"),
        ([4.0, 0.0, 4.0], [0.0, 3.0, 3.0], "pressure times flux"),
    ],
)
def test_complementarity_is_verified_to_a_hundred_millionth(pressure, flux, named, share):
    # The third node breaks one condition, by a share of what is allowed.
    pressure, flux = np.array(pressure), np.array(flux)
    (pressure if named == "negative pressure" else flux)[2] *= share * 1e-8
    if share < 1:
        verify_complementarity(pressure, flux, 3.0)
    else:
        with pytest.raises(ehd.errors.CavitationError, match=named) as caught:
            verify_complementarity(pressure, flux, 3.0)
        np.testing.assert_array_equal(caught.value.state["pressure"], pressure)


@pytest.mark.parametrize(
    ("pressure", "flux"), [([np.nan, 1.0], [0.0, 0.0]), ([1.0, 1.0], [np.inf, 0.0])]
)
def test_a_solution_that_is_no_finite_number_says_so(pressure, flux):
    with pytest.raises(ehd.errors.SolverError, match="not a finite number"):
        verify_complementarity(np.array(pressure), np.array(flux), 1.0)
