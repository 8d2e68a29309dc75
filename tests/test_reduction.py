"""The reduction: what M3 promises, on any number of ranks, and its file."""

import gc
import re
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from foreign_parts import ring
from hypothesis import given, settings
from hypothesis import strategies as st
from mpi4py import MPI
from petsc4py import PETSc
from scene_cases import structure as structure_of

import fenics_ehd as ehd
from fenics_ehd.reduction.load_dependent_basis import (
    PRESSURE_SETS,
    energy_orthonormal,
    without_redundancy,
)
from fenics_ehd.reduction.matrices import MassOperator
from fenics_ehd.reduction.reductor import rigid
from fenics_ehd.reduction.static import LinearSolver, StaticSolver

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def structure():
    return structure_of("slider-crank-paper", "rod", MPI.COMM_WORLD)


@pytest.fixture(scope="module")
def body(structure):
    return ehd.load_dependent(structure, 6, 31)


ALONE = """
import runpy, sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {absent}:
            raise ImportError(f"{{name}} is not there")
sys.meta_path.insert(0, Absent())
runpy.run_path({demo!r}, run_name="__main__")
"""


def test_reduction_does_with_what_the_documentation_names():
    needed = {"petsc4py", "slepc4py", "mpi4py", "numpy", "SciPy", "h5py"}
    text = (ROOT / "docs" / "reduction.md").read_text()
    listed = text.partition("`fenics_ehd.reduction` needs ")[2].partition(";")[0]
    assert set(re.split(r", | and ", listed)) == needed
    absent = {"dolfinx", "basix", "ffcx", "ufl", "gmsh", "meshio", "matplotlib", "PIL"}
    absent |= {"attr", "attrs", "click", "jinja2"}
    demo = str(ROOT / "demos" / "foreign_matrices.py")
    command = [sys.executable, "-c", ALONE.format(absent=absent, demo=demo)]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


def test_reduced_matrices_are_diagonal_with_ascending_groups(body):
    assert body.modes == 6 + 2 + 31
    assert body.kinds == ("vibration",) * 6 + ("static",) * 33
    np.testing.assert_array_equal(body.mass, np.eye(body.modes))
    np.testing.assert_allclose(np.diag(body.stiffness), (2 * np.pi * body.frequencies) ** 2)
    assert np.all(np.diff(body.frequencies[:6]) > 0)
    assert np.all(np.diff(body.frequencies[6:]) > 0)
    assert body.accuracy["static_rank"] == 33


@pytest.mark.slow
@pytest.mark.parametrize("pressure_set", ["pc2", pytest.param("pc1", marks=pytest.mark.slow)])
def test_static_response_is_exact_for_the_whole_set(structure, pressure_set, figure):
    pressures = PRESSURE_SETS[pressure_set](structure.bore)
    size = pressures.shape[1]
    whole = ehd.load_dependent(structure, 6, size, pressure_set)
    exact = (whole.basis_flexibility() + whole.missing_flexibility) @ pressures
    missed = whole.missing_flexibility @ pressures
    error = np.abs(missed).max() / np.abs(exact).max()
    figure(
        "part and reduction",
        "static response with every column of a pressure set",
        error,
        most=1e-6,
    )
    assert whole.accuracy["static_dropped"] < 0.2 * size


def test_unknown_names_and_too_many_modes_are_refused(structure):
    with pytest.raises(ehd.errors.SettingsError, match="pressure_set 'pc3' is not one of pc1, pc2"):
        ehd.load_dependent(structure, 6, 31, "pc3")
    with pytest.raises(ehd.errors.SettingsError, match="selection 'best'"):
        ehd.load_dependent(structure, 6, 31, "pc2", "best")
    with pytest.raises(ehd.errors.SettingsError, match="residual_modes 81 is not between 0 and 80"):
        ehd.load_dependent(structure, 6, 81)
    with pytest.raises(ehd.errors.SettingsError, match="-1 modes: must be between 0 and 2622"):
        ehd.load_dependent(structure, -1, 31)


@pytest.mark.mpi
def test_every_rank_holds_the_same_body(body):
    comm = MPI.COMM_WORLD
    for f in fields(ehd.ReducedBody):
        value = getattr(body, f.name)
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(value, comm.bcast(value))


@pytest.mark.mpi
def test_rigid_modes_are_orthonormal_and_store_no_energy(structure, figure):
    modes = StaticSolver(structure).rigid_modes
    comm = structure.comm
    from fenics_ehd.reduction.matrices import inner, multiply

    gram = inner(modes, multiply(structure.mass, modes), comm)
    np.testing.assert_allclose(gram, np.eye(6), atol=1e-12)
    force = multiply(structure.stiffness, modes)
    diagonal = structure.stiffness.getDiagonal().array[:, None] * modes
    sizes = [np.sqrt(comm.allreduce(np.sum(a**2))) for a in (force, diagonal)]
    figure("part and reduction", "rigid motions store no energy", sizes[0] / sizes[1], most=1e-11)


@settings(max_examples=50)
@given(st.integers(1, 8), st.integers(0, 4), st.integers(0, 2**32 - 1))
def test_energy_orthonormalisation_finds_the_rank(rank, dependent, seed):
    random = np.random.default_rng(seed)
    columns = random.standard_normal((20, rank)) * 10.0 ** random.uniform(-4, 4, rank)
    mixed = np.hstack([columns, columns @ random.standard_normal((rank, dependent))])
    gram = mixed.T @ mixed
    combination = energy_orthonormal(gram)
    assert combination.shape[1] == rank
    np.testing.assert_allclose(combination.T @ gram @ combination, np.eye(rank), atol=1e-5)


def test_rigid_part_misses_the_whole_flexibility(structure):
    every = ehd.Reductor(structure, every_pressure=True)
    stiff = rigid(every, estimate_error=True)
    body = ehd.load_dependent(every, 6, 31)
    assert stiff.modes == 0
    np.testing.assert_allclose(stiff.inertia.total_mass, body.inertia.total_mass, rtol=1e-13)
    np.testing.assert_allclose(stiff.load_projection, body.load_projection[:3], atol=1e-18)
    whole = body.basis_flexibility() + body.missing_flexibility
    np.testing.assert_allclose(stiff.missing_flexibility, whole, atol=1e-9 * np.abs(whole).max())


@pytest.mark.slow
def test_journal_pressures_need_fewer_modes_than_single_positions(structure):
    """Response to a pressure that neither set holds, of a finite bearing at eccentricity 0.7."""
    x, y, z = structure.bore.pressure_coordinates.T
    theta = np.arctan2(y, x) - 0.3
    width = structure.bore.width
    pressure = np.maximum(np.sin(theta), 0) / (1 + 0.7 * np.cos(theta)) ** 2
    pressure *= 1 - np.cosh(3 * z / width) / np.cosh(1.5)
    missed = {
        name: np.abs(
            ehd.load_dependent(structure, 6, 12, name, selection).missing_flexibility @ pressure
        ).max()
        for name, selection in (("journal", "largest-eigenvalue"), ("pc2", "lowest-frequency"))
    }
    assert missed["journal"] < 0.3 * missed["pc2"]


@pytest.mark.slow
def test_redundant_patterns_change_nothing(structure):
    random = np.random.default_rng(0)
    patterns = np.cos(random.uniform(0, 3, (440, 6)))
    mixed = patterns @ random.standard_normal((6, 30))
    assert without_redundancy(mixed).shape == (440, 6)
    np.testing.assert_array_equal(without_redundancy(patterns), patterns)
    np.testing.assert_allclose(
        without_redundancy(mixed) @ without_redundancy(mixed).T, mixed @ mixed.T, atol=1e-9
    )
    flexibility = [
        ehd.load_dependent(structure, 6, 3, p, "largest-eigenvalue").basis_flexibility()
        for p in (mixed, mixed @ np.linalg.qr(random.standard_normal((30, 30)))[0])
    ]
    np.testing.assert_allclose(*flexibility, atol=1e-9 * np.abs(flexibility[0]).max())


def test_nothing_of_a_reduction_stays_behind():
    """PETSc keeps what its Python owners let go of last: factors are hundreds of megabytes."""

    def solvers():
        gc.collect()
        return sum(isinstance(o, LinearSolver | MassOperator) for o in gc.get_objects())

    before = solvers()
    ehd.load_dependent(ring(), 3, 4, estimate_error=False)
    assert solvers() == before


def test_a_mass_matrix_is_freed_only_on_request_and_then_refused():
    part = ring()
    kept = StaticSolver(part)
    assert part.mass.norm() > 0
    column = np.ones((part.mass.local_size[0], 1))
    freed = StaticSolver(part, once=True)
    assert np.array_equal(freed.mass.multiply(column), kept.mass.multiply(column))
    with pytest.raises(PETSc.Error):
        part.mass.norm()
