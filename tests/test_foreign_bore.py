"""The bore of a part from another program: faces to load matrix and mean motion."""

import dolfinx
import numpy as np
import pytest
import ufl
from dolfinx import fem
from foreign_parts import RADIUS, WIDTH, to_scipy
from hypothesis import given, settings
from hypothesis import strategies as st
from mpi4py import MPI
from petsc4py import PETSc
from scene_cases import tables_of

import fenics_ehd as ehd
from fenics_ehd.base import compat
from fenics_ehd.fem.elements import quadratic_element
from fenics_ehd.reduction.bore import _unrolled as unrolled
from fenics_ehd.reduction.bore import bore_load_matrix, rigid_fields, surface_gram
from fenics_ehd.reduction.elements import ELEMENTS, package_order
from fenics_ehd.scenes.part import elastic_part
from fenics_ehd.scenes.scene import scene_of

RODS = {
    "serendipity": {"element": "serendipity"},
    "lagrange": {"element": "lagrange"},
    "triangle": {"cells": "tet"},
}


@pytest.fixture(scope="module", params=RODS)
def rod(request):
    """Rod whose pressures have the bore's shape functions."""
    changes = {f"bodies.rod.{key}": value for key, value in RODS[request.param].items()}
    settings = scene_of(tables_of("slider-crank-paper", changes), "rod").bodies["rod"]
    return elastic_part(
        settings, "bodies.rod", RODS[request.param].get("element", "lagrange"), MPI.COMM_SELF
    ).source


def cylinder(element, around=12, along=3, radius=RADIUS, width=WIDTH):
    """Nodes and faces, the nodes of the cells of a regular grid in (phi, z)."""
    kind = ELEMENTS[element]
    s, t = (a.ravel() for a in np.meshgrid(np.arange(around), np.arange(along), indexing="ij"))
    corner = np.column_stack([s, t])[:, None]
    places = corner + kind.nodes
    if kind.corners == 3:
        places = np.vstack([places, corner + 1 - kind.nodes])
    # Half steps, so that whole numbers distinguish nodes.
    keys = np.round(2 * places).astype(int)
    keys[:, :, 0] %= 2 * around
    grid, faces = np.unique(keys.reshape(-1, 2), axis=0, return_inverse=True)
    phi, z = np.pi / around * grid[:, 0], width * (grid[:, 1] / (2 * along) - 0.5)
    nodes = np.column_stack([radius * np.cos(phi), radius * np.sin(phi), z])
    return nodes, faces.reshape(keys.shape[:2])


def test_bore_and_load_matrix_are_those_of_the_volume_mesh(rod):
    other = rod.bore
    ours = ehd.bore_from_faces(rod.coordinates, other.nodes[other.cells], other.family)
    for name in ("nodes", "coordinates", "pressure_coordinates", "cells", "pressure_cells"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(other, name))
        assert getattr(ours, name).dtype == getattr(other, name).dtype
    for name in ("radius", "width", "family", "pressure_family"):
        assert getattr(ours, name) == getattr(other, name)
    load = to_scipy(other.load)
    assert abs(ours.load - load).max() < 1e-10 * abs(load).max()


def test_mean_motion_is_that_of_the_volume_mesh(rod):
    bore, mesh = rod.bore, rod.owner
    cell = mesh.topology.cell_type.name
    family = "lagrange" if bore.family == "triangle" else bore.family
    space = compat.functionspace(mesh, quadratic_element(family, cell, (3,)))
    facets = dolfinx.mesh.locate_entities_boundary(
        mesh, 2, lambda x: np.isclose(np.hypot(x[0], x[1]), bore.radius, rtol=1e-6)
    )
    facets = np.sort(facets)
    tags = dolfinx.mesh.meshtags(mesh, 2, facets, np.ones(len(facets), dtype=np.int32))
    ds = ufl.Measure("ds", domain=mesh, subdomain_data=tags, metadata={"quadrature_degree": 14})(1)
    x, v = ufl.SpatialCoordinate(mesh), ufl.TestFunction(space)
    along, about = (fem.Constant(mesh, np.zeros(3)) for _ in range(2))
    form = fem.form(ufl.inner(along + ufl.cross(about, x), v) * ds)
    weighted = []
    for numbers in np.eye(6):
        along.value[:], about.value[:] = numbers[:3], numbers[3:]
        vector = compat.fem_petsc().assemble_vector(form)
        vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        weighted.append(vector.array)
    weighted = np.column_stack(weighted)
    motion = weighted @ np.linalg.inv(weighted.T @ rigid_fields(rod.coordinates))
    expected = motion.reshape(-1, 3, 6)[bore.nodes]
    found = ehd.bore_from_faces(rod.coordinates, bore.nodes[bore.cells], bore.family).reference
    for part in (slice(0, 3), slice(3, 6)):
        scale = np.abs(expected[..., part]).max()
        assert np.abs(found[..., part] - expected[..., part]).max() < 1e-9 * scale


@pytest.mark.parametrize(
    ("element", "order"),
    [("bilinear", 2), ("linear triangle", 2), ("serendipity", 4), ("lagrange", 4), ("triangle", 4)],
)
def test_force_on_a_sector_converges_at_the_order_of_the_geometry(element, order):
    errors = []
    for around in (12, 24, 48):
        nodes, faces = cylinder(element, around, around // 4)
        bore = ehd.bore_from_faces(nodes, faces, element)
        pressures = bore.coordinates[:, 0] / RADIUS
        force = (bore.load @ pressures).reshape(-1, 3).sum(axis=0)
        errors.append(abs(force[0] / (np.pi * RADIUS * WIDTH) - 1))
        np.testing.assert_allclose(force[1:], 0, atol=1e-12 * force[0])
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(rates, order, atol=0.15)


@pytest.mark.parametrize("element", ELEMENTS)
def test_uniform_pressure_pushes_outward_and_is_in_equilibrium(element):
    nodes, faces = cylinder(element)
    bore = ehd.bore_from_faces(nodes, faces, element)
    # No film has cells of three nodes.
    assert bore.family == bore.pressure_family == ("" if element == "linear triangle" else element)
    assert (bore.radius, bore.width) == pytest.approx((RADIUS, WIDTH))
    force = (bore.load @ np.ones(len(bore.nodes))).reshape(-1, 3)
    work = np.einsum("nc,nc->", force[:, :2], nodes[:, :2]) / RADIUS
    assert work == pytest.approx(2 * np.pi * RADIUS * WIDTH, rel=0.06)
    resultant = force.sum(axis=0), np.cross(nodes, force).sum(axis=0)
    np.testing.assert_allclose(resultant, 0, atol=1e-13 * work)


@settings(max_examples=30)
@given(st.sampled_from(list(ELEMENTS)), st.integers(0, 2**32 - 1))
def test_neither_numbers_nor_orientation_of_faces_matter(element, seed):
    random = np.random.default_rng(seed)
    nodes, faces = cylinder(element)
    bore = ehd.bore_from_faces(nodes, faces, element)
    numbers = random.permutation(len(nodes))
    moved = np.empty_like(nodes)
    moved[numbers] = nodes
    mirror = ELEMENTS[element].nodes[:, ::-1]
    swap = [int(np.flatnonzero((row == ELEMENTS[element].nodes).all(axis=1))[0]) for row in mirror]
    flipped = faces.copy()
    some = random.random(len(faces)) < 0.5
    flipped[some] = flipped[some][:, swap]
    again = ehd.bore_from_faces(moved, random.permutation(numbers[flipped]), element)
    np.testing.assert_array_equal(again.nodes, numbers[bore.nodes])
    np.testing.assert_array_equal(again.coordinates, bore.coordinates)
    dofs = (3 * numbers[:, None] + np.arange(3)).ravel()
    assert abs(again.load[dofs] - bore.load).max() < 1e-12 * abs(bore.load).max()
    np.testing.assert_allclose(again.reference, bore.reference, atol=1e-10 / RADIUS)


@pytest.mark.parametrize("element", ELEMENTS)
def test_reference_reproduces_rigid_motion(element):
    nodes, faces = cylinder(element)
    bore = ehd.bore_from_faces(nodes, faces, element)
    fields = rigid_fields(bore.coordinates).reshape(-1, 3, 6)
    motion = np.einsum("ick,icl->kl", bore.reference, fields)
    np.testing.assert_allclose(motion, np.eye(6), atol=1e-12 / RADIUS)
    order = np.argsort(bore.nodes)
    cells = order[np.searchsorted(bore.nodes, faces, sorter=order)]
    areas = surface_gram(bore.coordinates, cells, element).sum(axis=1)
    weights = np.asarray(areas).ravel() / areas.sum()
    for component in range(3):
        np.testing.assert_allclose(bore.reference[:, component, component], weights, atol=1e-12)


def same_faces(found, faces, kind):
    """The same nodes, the same corners, every middle between the two corners it belongs to."""
    n = kind.corners
    np.testing.assert_array_equal(np.sort(found), np.sort(faces))
    np.testing.assert_array_equal(np.sort(found[:, :n]), np.sort(faces[:, :n]))
    for face, expected in zip(found, faces, strict=True):
        assert edges_of(face, kind) == edges_of(expected, kind)


def edges_of(face, kind):
    middles = [None] * len(kind.edges) if len(face) == kind.corners else face[kind.corners :]
    pairs = (frozenset(face[edge]) for edge in kind.edges)
    return set(zip(pairs, middles[: len(kind.edges)], strict=True))


@settings(max_examples=30)
@given(
    st.sampled_from([e for e in ELEMENTS if e != "linear triangle"]),
    st.integers(3, 40),
    st.integers(1, 20),
    st.integers(0, 2**32 - 1),
)
def test_order_is_found_on_slender_and_irregular_cells(element, around, along, seed):
    random = np.random.default_rng(seed)
    kind = ELEMENTS[element]
    nodes, faces = cylinder(element, around, along)
    # Shear, and every face with an order of its own.
    turn = 0.5 * 2 * np.pi / around * np.sin(np.pi * nodes[:, 2] / WIDTH)
    c, s = np.cos(turn), np.sin(turn)
    x, y, z = nodes.T
    nodes = np.column_stack([c * x - s * y, s * x + c * y, z])
    n = kind.corners
    mixed = np.hstack([random.permuted(part, axis=1) for part in (faces[:, :n], faces[:, n:])])
    same_faces(package_order(unrolled(nodes[mixed]), mixed, element), faces, kind)


def without(face):
    return lambda nodes, faces: (nodes, np.delete(faces, face, axis=0))


def replaced(face, place, node):
    def change(nodes, faces):
        faces = faces.copy()
        faces[face, place] = node
        return nodes, faces

    return change


def moved(node, shift):
    def change(nodes, faces):
        nodes = nodes.copy()
        nodes[node] += shift
        return nodes, faces

    return change


def straight(nodes, faces):
    nodes = nodes.copy()
    nodes[faces[:, 4]] = 0.5 * (nodes[faces[:, 0]] + nodes[faces[:, 1]])
    return nodes, faces


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (without(5), "not a complete cylinder: the edge of nodes .* belongs to 1 faces, not 2"),
        (without(slice(0, None, 5)), "not a complete cylinder"),
        (lambda n, f: (n, np.vstack([f, f[:1]])), "belongs to [23] faces, not [12]"),
        (lambda n, f: (n + np.array([0, 0, 1e-3]), f), r"at z = 0, .* at z = 1\.000e-03"),
        (lambda n, f: (n + np.array([1e-5, 0, 0]), f), "not a cylinder about the z axis: node"),
        (moved(7, [0, 0, np.nan]), "a node of the faces has a coordinate that is not finite"),
        (moved(17, [1e-4, 0, 0]), "node 17 lies .* off the mean radius"),
        (straight, "midpoints of edges must lie on the cylinder too"),
        (replaced(3, 0, 10_000), "faces refer to nodes 0 to 10000"),
        (replaced(3, 0, -1), "faces refer to nodes -1 to"),
        (lambda n, f: (n, f.astype(float)), "type float64"),
        (lambda n, f: (n, f[:, [0, 0, 1, 2, 3, 4, 5, 6]]), "face 0 has a node twice"),
        (lambda n, f: (n, f[:, [4, 5, 6, 7, 0, 1, 2, 3]]), "face 0 .* is folded .*come first"),
        (lambda n, f: (n, f[:, :7]), r"faces have shape \(36, 7\), but serendipity needs"),
        (lambda n, f: (n, f[:0]), r"faces have shape \(0, 8\)"),
        (lambda n, f: (n[:, :2], f), r"nodes have shape \(\d+, 2\)"),
    ],
)
def test_faces_that_are_no_bore_are_named(change, message):
    with pytest.raises(ehd.errors.StructureError, match=message):
        ehd.bore_from_faces(*change(*cylinder("serendipity")), "serendipity")


def test_unknown_element_and_flat_face_are_named():
    nodes, faces = cylinder("bilinear")
    with pytest.raises(ehd.errors.StructureError, match="'quad' is not one of bilinear"):
        bore_load_matrix(nodes, faces, "quad")
    disk = np.array([[1.0, 1, 0], [2, 1, 0], [1, 2, 0], [2, 2, 0]])
    with pytest.raises(ehd.errors.StructureError, match="does not face the z axis"):
        bore_load_matrix(disk, np.arange(4)[None], "bilinear")
