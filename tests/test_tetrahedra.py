"""The unstructured rod of 10-node tetrahedra, and the surface mesh that every bore carries."""

from dataclasses import replace
from types import SimpleNamespace

import gmsh
import meshio
import numpy as np
import pytest
from exact_transfer import conservative_load, intersection_points
from mpi4py import MPI
from scene_cases import structure as structure_of
from scipy import sparse

import fenics_ehd as ehd
from fenics_ehd.fem.gmsh_session import session
from fenics_ehd.fem.solid import GMSH_HEX, GMSH_TET, Solid, inside_out
from fenics_ehd.film.transfer import Surface, interpolation_matrix
from fenics_ehd.reduction.bore import no_cells
from fenics_ehd.reduction.elements import SOLIDS
from fenics_ehd.reduction.load_dependent_basis import (
    _columns,
    _hats,
    bearing_shapes,
    unit_pressures,
)
from fenics_ehd.reduction.matrices import load_columns
from fenics_ehd.reduction.reductor import bore_rows, rigid
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.results.paraview import gather_part, part_block, write_series


def rod_of_tetrahedra(comm):
    return structure_of("slider-crank-paper", "rod", comm, {"bodies.rod.cells": "tet"})


@pytest.fixture(scope="module")
def structure():
    return rod_of_tetrahedra(MPI.COMM_WORLD)


@pytest.fixture(scope="module")
def body(structure):
    return ehd.load_dependent(structure, 6, 31, estimate_error=False, keep_basis=True)


def surfaces(body):
    """Displacement and pressure mesh of a bore."""
    return (
        Surface.on_cylinder(body.bore_nodes, body.bore.cells, body.bore.family),
        Surface.on_cylinder(
            body.pressure_nodes, body.bore.pressure_cells, body.bore.pressure_family
        ),
    )


def smooth_pressures(nodes):
    """Constant, ovalising and local pressures at bore nodes, shape (k, 4)."""
    phi, z = np.arctan2(nodes[:, 1], nodes[:, 0]), nodes[:, 2]
    parabola = 1 - (2 * z / np.ptp(z)) ** 2
    patches = [np.exp(4 * (np.cos(phi - a) - 1)) * parabola for a in (0.0, 2.0)]
    return np.column_stack([np.ones_like(z), np.cos(2 * phi), *patches])


def bore_responses(structure):
    """Static bore displacements of the smooth pressures, shape (m, 3, 4)."""
    bore, solver = structure.bore, StaticSolver(structure)
    loads = load_columns(bore.load, smooth_pressures(bore.pressure_coordinates))
    return bore_rows(structure, solver.solve(loads))


def test_frequencies_and_mass_are_those_of_the_hexahedral_rod(body, rod_body, figure):
    error = np.abs(body.frequencies[:6] / rod_body.frequencies[:6] - 1).max()
    figure(
        "part and reduction",
        "frequencies, tetrahedra against hexahedra",
        error,
        most=5e-3,
        unit="%",
    )
    ours, expected = body.inertia, rod_body.inertia
    assert ours.total_mass == pytest.approx(expected.total_mass, rel=1e-4)
    assert ours.centre_of_mass[0] == pytest.approx(expected.centre_of_mass[0], rel=1e-4)
    assert abs(ours.centre_of_mass[1]) < 1e-4 * expected.centre_of_mass[0]
    assert ours.polar_inertia == pytest.approx(expected.polar_inertia, rel=1e-4)


def test_bore_yields_as_that_of_the_hexahedral_rod(structure, rod_structure, body, rod_body):
    ours, expected = surfaces(body), surfaces(rod_body)
    x = intersection_points(ours[0], expected[0], body.bore.radius, 8)
    normal = np.column_stack([np.cos(x.phi), np.sin(x.phi), np.zeros_like(x.phi)])
    outward, pressures = [], []
    for part, (surface, mesh) in ((structure, ours), (rod_structure, expected)):
        rows = bore_responses(part)
        at_points = interpolation_matrix(surface, x.phi, x.z) @ rows.reshape(len(rows), -1)
        outward.append(np.einsum("pc,pck->pk", normal, at_points.reshape(-1, 3, 4)))
        nodal = smooth_pressures(part.bore.pressure_coordinates)
        pressures.append(interpolation_matrix(mesh, x.phi, x.z) @ nodal)
    difference = np.abs(outward[0] - outward[1]).max(axis=0)
    assert np.all(difference < 0.01 * np.abs(outward[1]).max(axis=0))
    compliance = [x.weights @ (u * p) for u, p in zip(outward, pressures, strict=True)]
    np.testing.assert_allclose(compliance[0], compliance[1], rtol=2e-3)


@pytest.mark.mpi
def test_rank_count_changes_neither_bore_nor_flexibility(structure):
    alone = rod_of_tetrahedra(MPI.COMM_SELF)
    for name in ("coordinates", "pressure_coordinates"):
        ours, expected = getattr(structure.bore, name), getattr(alone.bore, name)
        np.testing.assert_allclose(ours, expected, atol=1e-14)
    for name in ("cells", "pressure_cells"):
        ours, expected = (np.sort(getattr(s.bore, name), axis=1) for s in (structure, alone))
        np.testing.assert_array_equal(ours, expected)
    ours, expected = bore_responses(structure), bore_responses(alone)
    assert np.abs(ours - expected).max() < 1e-9 * np.abs(expected).max()


def test_bore_is_unstructured_and_its_edges_are_straight_when_unwrapped(structure, rod_structure):
    bore = structure.bore
    surface = Surface.on_cylinder(bore.coordinates, bore.cells, bore.family)
    inner = np.abs(bore.coordinates[:, 2]) < 0.49 * bore.width
    assert len(np.unique(np.round(surface.nodes[inner, 0], 4))) > 0.8 * inner.sum()
    place = surface.reference(np.arange(len(surface.cells)), surface.cell_nodes)
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    middles = 0.5 * (corners[[1, 0, 0]] + corners[[2, 2, 1]])
    np.testing.assert_allclose(
        place[:, 3:], np.broadcast_to(middles, place[:, 3:].shape), atol=1e-12
    )
    radii = np.linalg.norm(bore.coordinates[:, :2], axis=1)
    assert np.ptp(radii) < 1e-14
    sizes = structure.size / rod_structure.size, len(bore.nodes) / 440
    assert np.all(np.abs(np.log(sizes)) < np.log(2.5))


@pytest.mark.parametrize("cells", ["hex", "tet"])
def test_surface_mesh_and_load_matrix_belong_together(cells, structure, rod_structure):
    part = structure if cells == "tet" else rod_structure
    bore = part.bore
    surface = Surface.on_cylinder(bore.coordinates, bore.cells, bore.family)
    pressures = Surface.on_cylinder(
        bore.pressure_coordinates, bore.pressure_cells, bore.pressure_family
    )
    assert bore.family == {"tet": "triangle", "hex": "serendipity"}[cells]
    assert bore.pressure_family == {"tet": "triangle", "hex": "lagrange"}[cells]
    rows = (3 * bore.nodes[:, None] + np.arange(3)).ravel()
    starts, columns, values = bore.load.getValuesCSR()
    own = sparse.csr_matrix((values, columns, starts), shape=bore.load.size)[rows]
    x = intersection_points(surface, pressures, bore.radius, 10)
    shapes = interpolation_matrix(pressures, x.phi, x.z)
    unwrapped = conservative_load(surface, x.phi, x.z, x.weights, shapes)
    # The normal of quadratic elements on a circle is that much off between the nodes.
    assert abs(own - unwrapped).max() < 5e-3 * abs(own).max()
    assert own.sum() == pytest.approx(unwrapped.sum(), abs=1e-10 * abs(own).sum())


def test_pressure_sets_need_no_columns_of_nodes(structure, rod_structure):
    nodes = len(structure.bore.pressure_coordinates)
    np.testing.assert_array_equal(unit_pressures(structure.bore), np.eye(nodes))
    shapes = bearing_shapes(structure.bore)
    assert shapes.shape == (nodes, 80)
    np.testing.assert_allclose(shapes[:, :40].sum(axis=1), 1.0, rtol=1e-13)
    assert np.all(shapes.max(axis=0) > 0.3)
    x, y, _ = rod_structure.bore.pressure_coordinates.T
    angle = np.mod(np.arctan2(y, x) + 1e-9, 2 * np.pi)
    np.testing.assert_allclose(_hats(angle), _columns(angle), atol=1e-6)


def test_bore_without_surface_mesh_is_allowed(structure, tmp_path):
    bare = {"cells": no_cells(), "family": "", "pressure_cells": no_cells(), "pressure_family": ""}
    foreign = replace(structure, bores=replace(structure.bore, **bare))
    ehd.save_body(rigid(foreign), tmp_path / "rod.h5")
    again = ehd.load_body(tmp_path / "rod.h5")
    assert again.bore.cells.shape == (0, 0)
    assert again.bore.family == again.bore.pressure_family == ""


def test_paraview_files_hold_quadratic_tetrahedra(structure, body, tmp_path):
    part = gather_part(structure, body, body.columns)
    pairs = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]
    x = part.nodes[part.cells]
    middle = 0.5 * (x[:, [a for a, _ in pairs]] + x[:, [b for _, b in pairs]])
    size = np.linalg.norm(x[:, 1] - x[:, 0], axis=1).max()
    assert np.abs(x[:, 4:] - middle).max() < 0.1 * size
    replay = SimpleNamespace(
        part=lambda name: body,
        marker=lambda name, point: np.zeros((1, 3)),
        elastic=lambda name: (np.zeros((1, body.modes)), np.zeros((1, 0))),
        bore_pressure=lambda name: np.ones((1, len(body.pressure_nodes))),
    )
    write_series(tmp_path, np.zeros(1), [part_block(replay, "rod", part)])
    mesh = meshio.read(tmp_path / "bodies-rod_0000.vtu")
    assert mesh.cells[0].type == "tetra10"
    assert mesh.point_data["pressure_Pa"].sum() == len(body.pressure_nodes)


def test_cells_are_those_that_the_model_gives():
    with pytest.raises(ehd.errors.MeshError, match="no tetrahedra: it needs a parameter"):
        ehd.build_mesh(ehd.model_path("conrod"), {"tetrahedra": 0}, comm=MPI.COMM_SELF, cells="tet")
    found = ehd.build_mesh(ehd.model_path("conrod"), {"tetrahedra": 1}, comm=MPI.COMM_SELF)
    assert found.cell == "tetrahedron"


@pytest.mark.parametrize("kind", ["tet", "hex"])
def test_cells_that_gmsh_calls_inverted_are_refused(kind):
    x = SOLIDS[kind].nodes.copy()
    random, found = np.random.default_rng(1), []
    number, rule = {"tet": (11, "Gauss4"), "hex": (17, "Gauss4")}[kind]
    order = GMSH_TET if kind == "tet" else GMSH_HEX
    for size in np.linspace(0, 0.5, 40):
        points = x + size * random.uniform(-1, 1, x.shape)
        solid = Solid(points, np.arange(len(x))[None, :], kind)
        with session():
            gmsh.model.addDiscreteEntity(3, 1)
            gmsh.model.mesh.addNodes(3, 1, np.arange(1, len(x) + 1), points[order].ravel())
            gmsh.model.mesh.addElementsByType(1, number, [1], np.arange(1, len(x) + 1))
            places = gmsh.model.mesh.getIntegrationPoints(number, rule)[0]
            expected = gmsh.model.mesh.getJacobians(number, places)[1].min()
        found.append((expected <= 0, inside_out(solid)[0]))
    # Ours looks at the edges at corners as well.
    assert all(ours for expected, ours in found if expected)
    assert not found[0][1]
    assert {ours for _, ours in found[:20]} == {False, True}
