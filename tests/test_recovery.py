"""Displacements and stresses of the whole part from modal coordinates."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from mpi4py import MPI
from scene_cases import structure as structure_of
from scipy.spatial import cKDTree

import fenics_ehd as ehd
from fenics_ehd.fem.stress import StressField
from fenics_ehd.reduction.part_files import BasisFile, save_basis, von_mises
from fenics_ehd.reduction.static import StaticSolver

STEEL = ehd.Material(youngs_modulus=210e9, poissons_ratio=0.3, density=7850.0)
COARSE = {"bodies.rod.geometry": {"bore_cells_around": 10, "shank_cells": 4}}
PARTS = {
    "serendipity": COARSE | {"bodies.rod.element": "serendipity"},
    "lagrange": COARSE | {"bodies.rod.element": "lagrange"},
    "tetrahedra": {"bodies.rod.cells": "tet"},
}


@pytest.fixture(scope="module", params=PARTS)
def structure(request):
    """A rod of curved cells of one kind, on all ranks."""
    return structure_of("slider-crank-paper", "rod", MPI.COMM_WORLD, PARTS[request.param])


@pytest.fixture(scope="module")
def columns(rod_structure):
    return np.random.default_rng(3).normal(size=(rod_structure.size, 40))


@pytest.fixture(scope="module")
def basis_file(rod_structure, columns, tmp_path_factory):
    path = tmp_path_factory.mktemp("basis") / "rod.h5"
    save_basis(path, rod_structure, columns)
    return path


def hooke(strain):
    modulus, ratio = STEEL.youngs_modulus, STEEL.poissons_ratio
    dilatation = ratio / (1 - 2 * ratio) * np.trace(strain) * np.eye(3)
    stress = modulus / (1 + ratio) * (strain + dilatation)
    return stress[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]


def waves(x):
    """Displacement columns that do not depend on the numbering of the nodes, shape (3 nodes, 7)."""
    numbers = np.random.default_rng(5).normal(size=(7, 3, 3)) * 40.0
    return 1e-6 * np.sin(np.einsum("kcd,nd->nck", numbers, x)).reshape(-1, 7)


@pytest.mark.mpi
def test_uniform_strain_gives_its_stress_in_every_cell(structure):
    gradients = np.random.default_rng(1).normal(size=(4, 3, 3))
    x = structure.coordinates
    field = structure.recovery.stress(np.einsum("kcd,nd->nck", gradients, x).reshape(-1, 4))
    stress = field.block()
    exact = np.array([hooke(0.5 * (g + g.T)) for g in gradients]).T
    assert np.abs(stress - exact).max(initial=0) < 1e-11 * np.abs(exact).max()


@pytest.mark.mpi
def test_stresses_lie_inside_their_cells(structure):
    cells, comm = structure.recovery.cells, structure.comm
    nodes = np.concatenate(comm.allgather(structure.coordinates))[cells]
    at = structure.recovery.stress(np.zeros((3 * len(structure.coordinates), 0))).positions()
    assert at.shape == (len(cells), 8 if cells.shape[1] == 20 else 4, 3)
    assert np.all((at > nodes.min(axis=1)[:, None]) & (at < nodes.max(axis=1)[:, None]))


def test_blocks_are_parts_of_the_whole(rod_structure, columns):
    field = rod_structure.recovery.stress(columns)
    part, whole = field.block(slice(10, 21), slice(5, 9)), field.block()
    assert whole.shape == field.shape
    assert np.abs(part - whole[10:21, :, :, 5:9]).max() < 1e-13 * np.abs(whole).max()


RING = """
DefineConstant[ n = {1, Name "Ring/n"} ]; Point(9) = {0, 0, -0.01};
For i In {0:3}
  Point(10 + i) = {0.02 * Cos(i * Pi / 2), 0.02 * Sin(i * Pi / 2), -0.01};
  Point(20 + i) = {0.04 * Cos(i * Pi / 2), 0.04 * Sin(i * Pi / 2), -0.01};
  Line(30 + i) = {10 + i, 20 + i};
EndFor
Transfinite Curve {30:33} = n + 1;
ring[] = {}; bore[] = {};
For i In {0:3}
  Circle(40 + i) = {10 + i, 9, 10 + (i + 1) % 4};
  Circle(50 + i) = {20 + i, 9, 20 + (i + 1) % 4};
  Transfinite Curve {40 + i, 50 + i} = 3 * n + 1;
  Curve Loop(60 + i) = {40 + i, 30 + (i + 1) % 4, -(50 + i), -(30 + i)};
  Plane Surface(70 + i) = {60 + i}; Transfinite Surface {70 + i}; Recombine Surface {70 + i};
  swept[] = Extrude {0, 0, 0.02} { Surface{70 + i}; Layers{1}; Recombine; };
  ring[] += {swept[1]}; bore[] += {swept[2]};
EndFor
Physical Volume("ring") = {ring[]}; Physical Surface("bore") = {bore[]};
"""


def ring_under_pressure(path, n):
    """A ring of steel and its displacement under 1 Pa inside."""
    path.write_text(RING.replace("n = {1,", f"n = {{{n},"))
    ring = ehd.assemble_structure(ehd.build_mesh(path, comm=MPI.COMM_SELF), STEEL, attachments=())
    pressure, force = ring.bore.load.createVecs()
    pressure.set(1.0)
    ring.bore.load.mult(pressure, force)
    return ring, StaticSolver(ring).solve(force.array[:, None])


def test_pressurised_ring_has_the_stresses_of_lame(tmp_path):
    errors = []
    for n in (2, 4):
        ring, displacement = ring_under_pressure(tmp_path / "ring.geo", n)
        field = ring.recovery.stress(displacement)
        x, stress = field.positions().reshape(-1, 3), field.block().reshape(-1, 6)
        r2 = (x[:, :2] ** 2).sum(axis=1)
        c, s = x[:, :2].T / np.sqrt(r2)
        xx, yy, _, _, _, xy = stress.T
        radial = c**2 * xx + s**2 * yy + 2 * c * s * xy
        ratio = 0.04**2 / r2
        # p a^2 / (b^2 - a^2) (1 -+ b^2 / r^2), and none along the free axis.
        exact = np.column_stack([1 - ratio, 1 + ratio, np.zeros_like(r2)]) / 3
        found = np.column_stack([radial, xx + yy - radial, stress[:, 2]])
        errors.append(np.sqrt(((found - exact) ** 2).mean()))
    assert np.abs(found - exact).max() < 1e-3 * 5 / 3
    # Elsewhere in the cells the stress of a quadratic displacement is of order 2 only.
    assert np.log2(errors[0] / errors[1]) > 2.5


def test_file_returns_the_displacement_of_the_columns(basis_file, rod_structure, columns):
    q = np.random.default_rng(4).normal(size=(3, 40))
    exact = (columns @ q.T).T.reshape(3, -1, 3)
    with BasisFile(basis_file) as basis:
        assert basis.modes == 40
        np.testing.assert_array_equal(basis.nodes, rod_structure.coordinates)
        np.testing.assert_array_equal(basis.cells, rod_structure.recovery.cells)
        np.testing.assert_allclose(basis.displacement(q), exact, atol=1e-12)
        np.testing.assert_allclose(basis.displacement(q[0]), exact[0], atol=1e-12)


def test_stress_of_a_reduced_solution_is_that_of_its_displacement(
    basis_file, rod_structure, columns
):
    q = np.random.default_rng(6).normal(size=(2, 40))
    field = rod_structure.recovery.stress(columns @ q.T)
    exact = np.moveaxis(field.block().reshape(-1, 6, 2), 2, 0)
    with BasisFile(basis_file) as basis:
        stress = basis.stress(q)
        np.testing.assert_array_equal(basis.stress_points, field.positions().reshape(-1, 3))
    assert np.abs(stress - exact).max() < 1e-10 * np.abs(exact).max()


def test_neither_writing_nor_reading_holds_the_whole_table(rod_structure, tmp_path):
    path, wide = tmp_path / "wide.h5", np.zeros((rod_structure.size, 320))
    tracemalloc.start()
    try:
        save_basis(path, rod_structure, wide)
        with BasisFile(path) as basis:
            basis.stress(np.zeros(320))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < path.stat().st_size / 4


@pytest.mark.mpi
def test_rank_count_does_not_change_the_fields(structure, request, tmp_path):
    comm = structure.comm
    folder = Path(comm.bcast(str(tmp_path)))
    save_basis(folder / "shared.h5", structure, waves(structure.coordinates))
    if comm.rank:
        return
    changes = PARTS[request.node.callspec.params["structure"]]
    alone = structure_of("slider-crank-paper", "rod", MPI.COMM_SELF, changes)
    save_basis(folder / "alone.h5", alone, waves(alone.coordinates))
    q = np.random.default_rng(7).normal(size=7)
    with BasisFile(folder / "shared.h5") as ours, BasisFile(folder / "alone.h5") as expected:
        for points, values in (("nodes", "displacement"), ("stress_points", "stress")):
            tree = cKDTree(getattr(expected, points))
            distance, match = tree.query(getattr(ours, points))
            assert distance.max() < 1e-12
            assert np.array_equal(np.sort(match), np.arange(tree.n))
            there = getattr(expected, values)(q)[match]
            assert np.abs(getattr(ours, values)(q) - there).max() < 1e-10 * np.abs(there).max()
        centres = [np.sort(f.nodes[f.cells].mean(axis=1), axis=0) for f in (ours, expected)]
        np.testing.assert_allclose(*centres, atol=1e-12)


@given(hnp.arrays(float, 6, elements=st.floats(-1e3, 1e3)))
def test_equivalent_stress_is_that_of_the_deviator(stress):
    xx, yy, zz, yz, xz, xy = stress
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    deviator = tensor - np.trace(tensor) / 3 * np.eye(3)
    assert von_mises(stress) == pytest.approx(np.sqrt(1.5 * (deviator**2).sum()), abs=1e-9)


def test_what_does_not_fit_is_refused(basis_file, rod_structure, columns, tmp_path):
    with (
        BasisFile(basis_file) as basis,
        pytest.raises(ehd.errors.SettingsError, match=r"shape \(39,\), but the basis has 40 modes"),
    ):
        basis.displacement(np.zeros(39))
    for wrong in (columns[:-3], columns[:, 0]):
        with pytest.raises(ehd.errors.SettingsError, match="on a rank: one row"):
            save_basis(tmp_path / "rod.h5", rod_structure, wrong)
    save_basis(tmp_path / "rod.h5", rod_structure, columns, stress=False)
    with BasisFile(tmp_path / "rod.h5") as basis:
        with pytest.raises(ehd.errors.BodyFileError, match="has no stresses"):
            basis.stress(np.zeros(40))


@pytest.mark.mpi
def test_a_save_that_fails_on_one_rank_fails_on_all_and_keeps_the_former_file(
    structure, tmp_path, monkeypatch
):
    def fail(*_):
        raise OSError("disk full")

    comm = structure.comm
    path = Path(comm.bcast(str(tmp_path))) / "rod.h5"
    if comm.rank == 0:
        path.write_text("former")
    columns = waves(structure.coordinates)
    with monkeypatch.context() as last:
        if comm.rank == comm.size - 1:
            last.setattr(StressField, "block", fail)
        with pytest.raises(ehd.errors.BodyFileError, match=r"rod\.h5 cannot be written: disk full"):
            save_basis(path, structure, columns)
    comm.Barrier()
    assert [p.name for p in path.parent.iterdir()] == ["rod.h5"]
    assert path.read_text() == "former"
    with pytest.raises(ehd.errors.BodyFileError, match="cannot be written"):
        save_basis(path.parent / "no" / "rod.h5", structure, columns)
