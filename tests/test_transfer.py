"""Transfer between meshes of one cylinder that do not match, section 2.2."""

import numpy as np
import pytest
from exact_transfer import intersection_points
from hypothesis import given, settings
from hypothesis import strategies as st

import fenics_ehd as ehd
from fenics_ehd.film.transfer import Mortar, Surface, interpolation_matrix, overlay, unwrap

pytestmark = pytest.mark.kernels

RADIUS, WIDTH = 0.0225, 0.022
TURN = np.array([2 * np.pi, 0.0])
AREA = 2 * np.pi * RADIUS * WIDTH
FAMILIES = ("bilinear", "serendipity", "lagrange", "triangle")


def rectangles(around, along, family, *, grading=0.0, start=0.0, width=WIDTH, bottom=None):
    """Film mesh; `grading` narrows cells around angle 0 but keeps a boundary at 0 and pi."""
    angles = np.linspace(0, 2 * np.pi, around + 1)
    angles = angles - grading * np.sin(angles) + start
    bottom = -width / 2 if bottom is None else bottom
    heights = np.linspace(bottom, bottom + width, along + 1)
    grid = ehd.FilmGrid(RADIUS, angles, heights, family)
    return Surface(grid.node_positions, grid.cell_nodes, family)


def triangles(around, along, seed=0):
    """Crooked triangles with mixed diagonals and orientations, edges along 0 and pi."""
    random = np.random.default_rng(seed)
    i, j = np.mgrid[:around, : along + 1]
    phi, z = 2 * np.pi * i / around, WIDTH * (j / along - 0.5)
    free = (i != 0) & (2 * i != around)
    phi = phi + free * random.uniform(-0.2, 0.2, phi.shape) * 2 * np.pi / around
    free = (j != 0) & (j != along)
    z = z + free * random.uniform(-0.2, 0.2, z.shape) * WIDTH / along
    vertices = np.column_stack([phi.ravel(), z.ravel()])
    cells = []
    for a in range(around):
        for b in range(along):
            quad = [((a + s) % around) * (along + 1) + b + t for s in (0, 1) for t in (0, 1)]
            halves = [(0, 1, 2), (1, 2, 3)] if random.random() < 0.5 else [(0, 1, 3), (0, 2, 3)]
            cells += [random.permutation([quad[k] for k in half]) for half in halves]
    corners = np.array(cells)
    edges = np.sort(corners[:, [[1, 2], [0, 2], [0, 1]]], axis=2)
    pairs, number = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
    first, second = vertices[pairs[:, 0]], vertices[pairs[:, 1]].copy()
    second[:, 0] = unwrap(second[:, 0], first[:, 0])
    cells = np.hstack([corners, len(vertices) + number.reshape(-1, 3)])
    return Surface(np.vstack([vertices, 0.5 * (first + second)]), cells, "triangle")


def mesh(family, around, along, **options):
    if family == "triangle":
        return triangles(around, along)
    return rectangles(around, along, family, **options)


def polynomials(surface, points):
    """Fields both meshes can represent: linear in phi either side of 0, with kinks at 0 and pi."""
    phi, z = np.abs(unwrap(points[:, 0], 0.0)), points[:, 1] / WIDTH
    linear = [np.ones_like(z), z, phi, phi * z]
    return np.column_stack(linear if surface.family == "bilinear" else [*linear, phi**2, z**2])


def smooth(points):
    """Periodic pressure that vanishes at the ends."""
    phi, z = points.T
    return np.exp(np.cos(phi - 0.3)) * np.cos(np.pi * z / WIDTH) * (1 + 0.5 * z / WIDTH)


def resultants(pressures, points, weights):
    """Force x, y and moment about x, y of pressures at quadrature points."""
    phi, z = points.T
    force = (weights * pressures) * np.array([np.cos(phi), np.sin(phi)])
    return np.concatenate([force.sum(axis=1), [-z @ force[1], z @ force[0]]])


@pytest.mark.parametrize("film_cells", [(8, 3), (22, 7)], ids=["coarser-film", "finer-film"])
@pytest.mark.parametrize("film_family", FAMILIES)
@pytest.mark.parametrize("structure_family", FAMILIES)
def test_mortar_reproduces_common_fields_and_keeps_integrals(
    structure_family, film_family, film_cells
):
    structure, film = mesh(structure_family, 14, 5), mesh(film_family, *film_cells)
    mortar = Mortar(structure, film, RADIUS)
    coarse = min(structure, film, key=lambda surface: surface.family != "bilinear")
    found = mortar.to_structure(polynomials(coarse, film.nodes))
    np.testing.assert_allclose(found, polynomials(coarse, structure.nodes), atol=1e-10)
    pressures = np.random.default_rng(1).standard_normal((len(film.nodes), 4))
    kept = mortar.mass.sum(axis=0) @ mortar.to_structure(pressures)
    np.testing.assert_allclose(kept, mortar.coupling.sum(axis=0) @ pressures, atol=1e-10 * AREA)
    assert mortar.mass.sum() == pytest.approx(AREA, rel=1e-12)


@pytest.mark.parametrize("family", FAMILIES)
def test_mortar_of_matching_meshes_is_the_identity(family):
    surface = mesh(family, 12, 4)
    moved = Surface(surface.nodes + TURN, surface.cells, family)
    identity = np.eye(len(surface.nodes))
    for film in (surface, moved):
        found = Mortar(surface, film, RADIUS).to_structure(identity)
        np.testing.assert_allclose(found, identity, atol=1e-12)


@settings(max_examples=40)
@given(
    st.integers(4, 30),
    st.integers(1, 9),
    st.floats(0.0, 0.9),
    st.floats(-10.0, 10.0),
    st.sampled_from(FAMILIES[:3]),
    st.booleans(),
)
def test_any_film_tiles_the_bore(around, along, grading, start, family, triangular):
    structure = triangles(10, 3) if triangular else rectangles(9, 4, "serendipity")
    film = rectangles(around, along, family, grading=grading, start=start)
    for ours, expected in ((structure, film), (film, structure)):
        mortar = Mortar(ours, expected, RADIUS)
        ones = mortar.to_structure(np.ones(len(expected.nodes)))
        np.testing.assert_allclose(ones, 1.0, atol=1e-10)
        assert mortar.coupling.sum() == pytest.approx(AREA, rel=1e-12)


@pytest.mark.parametrize("structure_family", ["triangle", "serendipity"])
def test_mortar_resultants_converge_at_twice_the_projection_order(structure_family, figure):
    errors = []
    for level in (1, 2, 4):
        structure = mesh(structure_family, 8 * level, 2 * level)
        film = rectangles(12 * level, 3 * level, "lagrange", grading=0.2)
        pressures = smooth(film.nodes)
        x = intersection_points(structure, film, RADIUS, 10)
        points = np.column_stack([x.phi, x.z])
        sent, received = (
            resultants(interpolation_matrix(s, x.phi, x.z) @ p, points, x.weights)
            for s, p in (
                (film, pressures),
                (structure, Mortar(structure, film, RADIUS).to_structure(pressures)),
            )
        )
        sizes = np.abs([received - sent, sent]).reshape(2, 2, 2).max(axis=2)
        errors.append(sizes[0] / sizes[1])  # of force, of moment
    # Pressure and normal are each projected to third order. The crooked triangles of one level
    # are not those of the next, so the rate is taken over both.
    rate = 0.5 * np.log2(errors[0] / errors[2])
    name = "mortar transfer of resultants, observed order"
    figure("part and reduction", name, rate.min(), least=5.5)
    assert np.max(errors[-1]) < 1e-6


@pytest.mark.parametrize("family", FAMILIES)
def test_interpolation_is_exact_for_the_family_and_on_edges(family):
    surface = mesh(family, 12, 3)
    middle = surface.corners.mean(axis=1)
    edges = surface.corners[:, [0, 1]].mean(axis=1)
    points = np.vstack([surface.nodes, middle, edges, surface.nodes + TURN])
    matrix = interpolation_matrix(surface, *points.T)
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, atol=1e-13)
    identity = np.eye(len(surface.nodes))
    np.testing.assert_allclose(matrix[: len(identity)].toarray(), identity, atol=1e-12)
    np.testing.assert_allclose(matrix[-len(identity) :].toarray(), identity, atol=1e-12)
    found = matrix @ polynomials(surface, surface.nodes)
    np.testing.assert_allclose(found, polynomials(surface, points), atol=1e-12)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.95))
def test_every_point_is_found_in_graded_and_crooked_meshes(seed, grading):
    random = np.random.default_rng(seed)
    points = np.column_stack(
        [random.uniform(-20, 20, 200), WIDTH * random.choice([-0.5, 0.5, 0.1, 0.0], 200)]
    )
    for surface in (rectangles(16, 4, "serendipity", grading=grading), triangles(8, 3, seed)):
        matrix = interpolation_matrix(surface, *points.T)
        found = matrix @ polynomials(surface, surface.nodes)
        np.testing.assert_allclose(found, polynomials(surface, points), atol=1e-11)


def test_no_points_give_no_rows():
    assert interpolation_matrix(triangles(6, 2), np.zeros(0), np.zeros(0)).shape[0] == 0


def test_tiles_lie_in_both_cells():
    tiles = overlay(triangles(10, 3), rectangles(7, 4, "bilinear", start=0.4))
    for corners, far in ((tiles.on_structure, lambda x: x.sum(-1)), (tiles.on_film, np.max)):
        assert corners.min() > -1e-12
        assert far(corners).max() < 1 + 1e-12


def test_meshes_of_different_cylinders_are_refused():
    film = rectangles(12, 3, "lagrange", width=0.02)
    with pytest.raises(ehd.errors.InterfaceMismatchError, match=r"0\.02 m wide, .* 0\.022 m wide"):
        Mortar(triangles(8, 3), film, RADIUS)
    shifted = rectangles(12, 3, "lagrange", bottom=0.0)
    with pytest.raises(ehd.errors.InterfaceMismatchError, match=r"z = 0 m.*z = -0\.011 m"):
        Mortar(triangles(8, 3), shifted, RADIUS)
    with pytest.raises(ehd.errors.InterfaceMismatchError, match=r"z = 0\.0121 m lies outside"):
        interpolation_matrix(film, np.array([0.3]), np.array([0.0121]))


def test_meshes_that_are_no_whole_cylinder_are_refused():
    whole = rectangles(12, 3, "lagrange")
    nodes, cells = np.unique(whole.cells[:-3], return_inverse=True)
    with pytest.raises(ehd.errors.InterfaceMismatchError, match="circumference, not a whole turn"):
        Surface(whole.nodes[nodes], cells.reshape(-1, 9), "lagrange")
    crooked = whole.nodes.copy()
    crooked[whole.cells[0, 8], 0] += 0.01
    with pytest.raises(ehd.errors.InterfaceMismatchError, match="cell sizes from its position"):
        Surface(crooked, whole.cells, "lagrange")
