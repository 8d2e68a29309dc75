"""Film meshes: nodes, interpolation, grading and alignment with grooves."""

import numpy as np
import pytest
from film_cases import FAMILIES, R
from film_grids import graded_grid
from hypothesis import given
from hypothesis import strategies as st

import fenics_ehd as ehd
from fenics_ehd.film.grid import aligned_grid, film_layout, match

COUNTS = {"bilinear": 120, "serendipity": 340, "lagrange": 440}
GRADED = {"focus": 1.0, "ratio": 6.0}


def turned(angles):
    """Angles in -pi..pi."""
    return np.mod(np.asarray(angles) + np.pi, 2 * np.pi) - np.pi


@pytest.mark.parametrize("family", FAMILIES)
def test_twenty_by_five_cells_have_the_nodes_of_the_paper(family):
    grid = ehd.uniform_grid(R, 0.022, (20, 5), family)
    assert len(grid.nodes) == COUNTS[family]
    assert set(grid.cell_nodes.ravel()) == set(range(len(grid.nodes)))
    assert np.linalg.norm(grid.nodes[:, :2], axis=1) == pytest.approx(R, rel=1e-14)
    assert np.ptp(grid.nodes[:, 2]) == pytest.approx(0.022, rel=1e-14)
    angles = grid.node_positions[:, 0]
    columns = [np.count_nonzero(angles == angle) for angle in grid.angles[:-1]]
    assert columns == [6 if family == "bilinear" else 11] * 20


@pytest.mark.parametrize("family", FAMILIES)
def test_interpolation_is_exact_for_the_nodes_and_for_polynomials(family):
    grid = graded_grid(R, R, (12, 3), family, **GRADED)
    angle, height = grid.node_positions.T
    own = grid.interpolation(angle, height).toarray()
    np.testing.assert_allclose(own, np.eye(len(angle)), atol=1e-11)
    # Any turn; the seam breaks a polynomial in the angle, so stay off its cell.
    random = np.random.default_rng(0)
    phi = random.uniform(grid.angles[0], grid.angles[-2], 300)
    z = random.uniform(-R / 2, R / 2, 300)

    def field(a, b):
        linear = 1 + 2 * a - 3 * b / R + a * b / R
        return linear if family == "bilinear" else linear + a**2 - (b / R) ** 2 * (1 + a)

    turns = 2 * np.pi * random.integers(-3, 4, 300)
    found = grid.interpolation(phi + turns, z) @ field(angle, height)
    np.testing.assert_allclose(found, field(phi, z), rtol=1e-10, atol=1e-10)


@given(
    start=st.floats(-7, 7),
    edges=st.lists(st.floats(-10, 10), min_size=1, max_size=4),
    graded=st.booleans(),
)
def test_aligned_boundaries_include_every_edge(start, edges, graded):
    grid = (
        graded_grid(R, R, (48, 2), focus=start, ratio=4.0)
        if graded
        else ehd.uniform_grid(R, R, (48, 2), start=start)
    )
    try:
        aligned = aligned_grid(grid, np.array(edges))
    except ehd.errors.SettingsError:
        # Refused only when two different edges are closer than one cell.
        gaps = np.abs(turned(np.subtract.outer(edges, edges)))
        largest = np.diff(grid.angles).max()
        assert np.any((gaps > 1e-9) & (gaps < largest))
        return
    assert aligned.cells == grid.cells
    distance = np.abs(turned(np.subtract.outer(edges, aligned.angles[:-1]))).min(axis=1)
    assert distance.max() < 1e-8
    # No boundary moves further than a cell.
    moved = np.abs(turned(np.subtract.outer(aligned.angles[:-1], grid.angles[:-1]))).min(axis=1)
    assert moved.max() <= 0.51 * np.diff(grid.angles).max()


def test_edges_that_a_turn_makes_the_same_are_one():
    grid = ehd.uniform_grid(R, R, (36, 2))
    edges = np.radians([-1e-13, 0.0, 30.0, 360.0])
    found = aligned_grid(grid, edges).angles[:-1]
    np.testing.assert_allclose(turned(found - grid.angles[:-1]), 0, atol=1e-12)


def test_edges_in_one_cell_are_refused_with_their_angles():
    grid = ehd.uniform_grid(R, R, (36, 2), start=1.0)
    with pytest.raises(ehd.errors.SettingsError, match=r"36 cells .* 89 and 91 degrees: use more"):
        aligned_grid(grid, np.radians([89.0, 91.0]))


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: ehd.uniform_grid(R, R, (2, 5)), "2 x 5 cells: use at least 3"),
        (lambda: ehd.uniform_grid(R, R, (20, 0)), "20 x 0 cells"),
        (lambda: ehd.uniform_grid(R, R, (-4, -4)), "= -4 must be a whole number"),
        (lambda: ehd.uniform_grid(R, -R, (20, 5)), "width = .* must be above 0"),
        (lambda: ehd.uniform_grid(R, np.nan, (20, 5)), "width = nan must be a finite"),
        (lambda: ehd.uniform_grid(R, R, (20, 5), "hermite"), "'hermite' must be one of lagrange"),
        (lambda: ehd.FilmGrid(R, np.linspace(0, 6, 9), np.arange(3.0)), "6 rad, not one turn"),
        (lambda: ehd.uniform_grid(-R, R, (20, 5)), "radius"),
        (lambda: ehd.uniform_grid(np.nan, R, (20, 5)), "radius"),
    ],
)
def test_impossible_meshes_are_refused(make, named):
    with pytest.raises(ehd.errors.SettingsError, match=named):
        make()


@pytest.mark.parametrize("family", ["serendipity", "lagrange"])
@pytest.mark.parametrize("start", [0.0, 0.1, np.pi / 20, 5.0])
def test_layout_recognises_cells_element_and_start(family, start):
    grid = ehd.uniform_grid(R, 0.022, (20, 5), family, start=start)
    order = np.random.default_rng(0).permutation(len(grid.nodes))
    given = grid.nodes[order]
    assert film_layout(given) == ((20, 5), family)
    found = ehd.film_grid(given)
    assert found.cells == (20, 5)
    assert found.family == family
    np.testing.assert_allclose(given[match(found.nodes, given)], found.nodes, atol=1e-9)


def test_nodes_of_no_structured_mesh_are_refused():
    grid = ehd.uniform_grid(R, 0.022, (20, 5))
    with pytest.raises(ehd.errors.InterfaceMismatchError, match="structured"):
        film_layout(grid.nodes[1:])
    graded = graded_grid(R, 0.022, (20, 5), **GRADED)
    with pytest.raises(ehd.errors.InterfaceMismatchError, match="equal cells"):
        ehd.film_grid(graded.nodes)
    assert match(grid.nodes, grid.nodes[1:]) is None
    assert match(grid.nodes, graded.nodes) is None
