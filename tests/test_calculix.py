"""CalculiX as the other program: the same mesh and element give the same part."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from calculix_ring import (
    DENSITY,
    POISSON,
    YOUNG,
    ring_solid,
    run_calculix,
    surfaces,
    write_deck,
    write_model,
)
from foreign_parts import to_scipy
from mpi4py import MPI

import fenics_ehd as ehd
from fenics_ehd.fem import structure
from fenics_ehd.reduction.foreign_matrices import tetrahedron_mass
from fenics_ehd.reduction.matrices import multiply
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.reduction.structure import PointWeights

pytestmark = pytest.mark.skipif(
    shutil.which("ccx") is None, reason="ccx is not installed (Debian: calculix-ccx)"
)

STEEL = ehd.Material(YOUNG, POISSON, DENSITY)


def both(folder, solid, element):
    """The part by CalculiX and by this program, and the former's dofs in the latter's order."""
    numbers = 11 + 3 * np.random.default_rng(0).permutation(len(solid.points))
    write_deck(folder / "ring.inp", solid, numbers)
    read = ehd.read_calculix(run_calculix(folder / "ring.inp"), numbers)
    write_model(folder / "ring.msh", solid)
    mesh = ehd.build_mesh(folder / "ring.msh", comm=MPI.COMM_SELF, serendipity_geometry=True)
    ours = structure.assemble_structure(
        mesh, STEEL, family="serendipity", pressure_family="serendipity"
    )
    distance = np.linalg.norm(ours.coordinates[:, None] - solid.points[None], axis=2)
    places = np.argmin(distance, axis=1)
    assert distance.min(axis=1).max() < 1e-12
    weights = ours.attachments["pin"][0].array.reshape(-1, 3)[:, 0]
    used = np.flatnonzero(weights)
    faces = read.indices(numbers[surfaces(solid)["bore"]])
    expected = ehd.Structure(
        read.stiffness,
        read.mass,
        solid.points,
        ehd.bore_from_faces(solid.points, faces, element),
        {"pin": PointWeights(places[used], weights[used])},
        comm=MPI.COMM_SELF,
    )
    return expected, ours, (3 * places[:, None] + np.arange(3)).ravel()


def difference(expected, ours, order):
    """Largest difference of matrices, relative to the largest entry."""
    ours, expected = to_scipy(ours), to_scipy(expected)[order][:, order]
    return abs(expected - ours).max() / abs(ours).max()


def with_rule(monkeypatch, cell, **degrees):
    """Quadrature of this program as that of CalculiX."""
    rule = {**structure.DEGREES[cell], **degrees}
    monkeypatch.setitem(structure.DEGREES, cell, rule)


def compliance(part):
    """Work of pressures over the bore [J]."""
    phi = np.arctan2(*part.bore.pressure_coordinates[:, 1::-1].T)
    pressures = np.column_stack([np.cos(2 * phi), np.cos(3 * phi), np.exp(4 * np.cos(phi) - 4)])
    solver = StaticSolver(part)
    loads = solver.equilibrate(multiply(part.bore.load, pressures))
    return np.einsum("ij,ij->j", loads, solver.solve(loads))


def test_ring_of_c3d20_is_the_same_body(tmp_path, figure):
    expected, ours, order = both(tmp_path, ring_solid("hex"), "serendipity")
    group = "part and reduction"
    name = "ring of C3D20, matrices of CalculiX: largest difference of "
    figure(group, name + "K", difference(expected.stiffness, ours.stiffness, order), most=1e-12)
    # The mass by 3 points a direction there, by 4 here.
    figure(group, name + "M", difference(expected.mass, ours.mass, order), most=1e-3)
    masses = [to_scipy(part.mass)[::3, ::3].sum() for part in (expected, ours)]
    assert masses[0] == pytest.approx(masses[1], rel=1e-12)
    work = compliance(expected) / compliance(ours) - 1
    figure(group, name + "the bore's flexibility", np.abs(work).max(), most=1e-9)
    bodies = [ehd.residual_flexibility(part, 6) for part in (expected, ours)]
    ratio = bodies[0].frequencies[:6] / bodies[1].frequencies[:6] - 1
    figure(group, name + "six frequencies of M4", np.abs(ratio).max(), most=3e-5)


def test_mass_of_c3d20_by_the_same_rule_is_the_same(tmp_path, monkeypatch):
    with_rule(monkeypatch, "hexahedron", mass=5)
    expected, ours, order = both(tmp_path, ring_solid("hex"), "serendipity")
    assert difference(expected.mass, ours.mass, order) < 1e-12


def test_c3d10_by_the_same_rule_is_the_same_and_its_mass_is_refused(tmp_path, monkeypatch):
    with_rule(monkeypatch, "tetrahedron", stiffness=2, mass=2)
    expected, ours, order = both(tmp_path, ring_solid("tet"), "triangle")
    for name in ("stiffness", "mass"):
        assert difference(getattr(expected, name), getattr(ours, name), order) < 1e-12
    # Four points a cell: the mass of one has rank 12 of 30.
    with pytest.raises(ehd.errors.StructureError, match="mass is singular"):
        ehd.residual_flexibility(expected, 6)


@pytest.mark.slow
def test_c3d10_with_an_exact_mass_differs_by_the_rule_for_k_alone(tmp_path, figure):
    differences = []
    for around, along, across in ((12, 2, 1), (24, 4, 2)):
        solid = ring_solid("tet", around, along, across)
        expected, ours, order = both(tmp_path, solid, "triangle")
        exact = replace(expected, mass=tetrahedron_mass(solid.points, solid.cells, DENSITY))
        assert difference(exact.mass, ours.mass, order) < 1e-13
        work = compliance(exact) / compliance(ours) - 1
        bodies = [ehd.residual_flexibility(part, 6) for part in (exact, ours)]
        ratio = bodies[0].frequencies[:6] / bodies[1].frequencies[:6] - 1
        differences.append([np.abs(work).max(), np.abs(ratio).max()])
    # Exact where edges are straight: what is left are the arcs. Observed order: 3.3.
    assert (np.log2(np.divide(*differences)) > 3).all()
    name = "ring of C3D10, 24 cells around, K of CalculiX, exact mass: largest difference of "
    figure("part and reduction", name + "the bore's flexibility", differences[1][0], most=2e-3)
    figure("part and reduction", name + "six frequencies of M4", differences[1][1], most=2e-3)
