"""Craig-Bampton superelements: what they keep of the body, their files, pyNastran's reading."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from mpi4py import MPI
from pynastran_case import reduced_rod
from scene_cases import structure
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag, eigh

import fenics_ehd as ehd
from fenics_ehd.cli.main import cli
from fenics_ehd.reduction.body import ResidualFlexibility
from fenics_ehd.reduction.nastran_matrices import read_dmig, read_op4_matrices
from fenics_ehd.reduction.reductor import rigid
from fenics_ehd.reduction.superelement import (
    FIRST_MODE,
    INDEPENDENT,
    export_dmig,
    export_op4,
    superelement,
)

STORED = json.loads((Path(__file__).parent / "golden" / "pynastran.json").read_text())
PAGE = (Path(__file__).parents[1] / "docs" / "export.md").read_text()


@pytest.fixture(scope="module")
def rod():
    return reduced_rod()


def whole(body):
    """K and M of a body with its rigid motions."""
    mass = np.block([[body.rigid_mass, body.rigid_coupling], [body.rigid_coupling.T, body.mass]])
    return block_diag(np.zeros((6, 6)), body.stiffness), mass


def frequencies(stiffness, mass):
    squares = eigh(stiffness, mass, eigvals_only=True)
    return np.sqrt(np.maximum(squares, 0.0)) / (2 * np.pi)


def rigid_motion(element, field):
    """Coordinates of a rigid motion: its values at the grid points, and no mode."""
    values = []
    for point in element.grid_points:
        values += [*field(point.position)[: point.components]]
    return np.append(values, np.zeros(len(element.frequencies)))


def test_no_mode_is_lost(rod):
    element = superelement(rod)
    expected = frequencies(*whole(rod))
    found = frequencies(element.stiffness, element.mass)
    np.testing.assert_allclose(found[6:], expected[6:], rtol=1e-9)
    assert found[5] < 1e-4 * expected[6]
    assert [p.name for p in element.grid_points] == ["bore", "pin"]
    assert [p.components for p in element.grid_points] == [6, 3]
    np.testing.assert_allclose(element.grid_points[1].position, [0.16, 0.0, 0.0], atol=1e-6)


def test_rigid_motions_have_no_force_and_the_mass_of_the_part(rod):
    element = superelement(rod)
    largest = np.abs(element.stiffness).max()
    for axis in range(3):
        unit = np.eye(3)[axis]
        moves = rigid_motion(element, lambda x, u=unit: [*u, 0, 0, 0])
        turns = rigid_motion(element, lambda x, u=unit: [*np.cross(u, x), *u])
        for motion in (moves, turns):
            assert np.abs(element.stiffness @ motion).max() < 1e-12 * largest
        np.testing.assert_allclose(moves @ element.mass @ moves, rod.inertia.total_mass, rtol=1e-9)
        np.testing.assert_allclose(
            turns @ element.mass @ turns, rod.rigid_mass[3 + axis, 3 + axis], rtol=1e-9
        )


def test_modes_are_those_of_a_fixed_boundary_and_displacements_are_those_of_the_bore(rod):
    """Definition: modes leave grid points at rest; unit displacements of grid points are there."""
    element = superelement(rod)
    count = sum(point.components for point in element.grid_points)
    np.testing.assert_allclose(
        element.mass[count:, count:], np.eye(len(element.frequencies)), atol=1e-9
    )
    stiffness = element.stiffness[count:, count:]
    np.testing.assert_allclose(np.sqrt(stiffness.diagonal()) / (2 * np.pi), element.frequencies)
    mean = element.bore_displacement.mean(axis=0)
    np.testing.assert_allclose(mean[:, :3], np.eye(3), atol=1e-9)
    size = np.abs(element.bore_displacement).max()
    np.testing.assert_allclose(mean[:, count:], 0.0, atol=1e-9 * size)


def test_a_point_at_a_bore_has_no_grid_point_of_its_own():
    coarse = {"bodies.rod.geometry.bore_cells_along": 2}
    part = structure("slider-crank-both-ends", "rod", MPI.COMM_SELF, coarse)
    element = superelement(ehd.load_dependent(part, 6, 8, estimate_error=False))
    assert [(p.name, p.components) for p in element.grid_points] == [("bore", 6), ("pin", 6)]


def test_bodies_that_no_superelement_can_hold_are_refused(rod, rod_structure):
    m, k, r = len(rod.bore_nodes), len(rod.pressure_nodes), 2
    residual = ResidualFlexibility(np.zeros((m, 3, r)), np.zeros((r, k)), np.ones(r), np.eye(r))
    error = ehd.errors.StructureError
    with pytest.raises(error, match=r"M4 has flexibility without coordinates.*m1, m2 or m3"):
        superelement(replace(rod, residual=residual))
    with pytest.raises(error, match="has no rigid motions: reduce the part again"):
        superelement(replace(rod, rigid_mass=np.zeros((0, 0))))
    element = superelement(rigid(rod_structure))
    assert [p.name for p in element.grid_points] == ["bore"]
    assert INDEPENDENT < 1e-6


# Files


@pytest.fixture(scope="module")
def files(rod, tmp_path_factory):
    folder = tmp_path_factory.mktemp("exports")
    return export_op4(rod, folder / "rod.op4"), export_dmig(rod, folder / "rod.dmig")


def test_files_are_read_back(rod, files):
    element = superelement(rod)
    found = read_op4_matrices(files[0])
    np.testing.assert_array_equal(found["KAA"].toarray(), element.stiffness)
    np.testing.assert_array_equal(found["MAA"].toarray(), element.mass)
    shown = found["UBORE"].toarray().reshape(element.bore_displacement.shape)
    np.testing.assert_array_equal(shown, element.bore_displacement)
    with pytest.raises(ehd.errors.StructureError, match="component 0, that of a scalar point"):
        read_dmig(files[1])


def test_exponents_of_three_digits_do_not_overflow_their_fields(rod, tmp_path, monkeypatch):
    element = superelement(rod)
    element.stiffness[:3, 3] = element.stiffness[3, :3] = [-3e-120, 2.5e-310, -1.5e-99]
    point = replace(element.grid_points[0], position=np.array([-1e-200, 0.0, 1e-3]))
    element = replace(element, grid_points=(point, *element.grid_points[1:]))
    monkeypatch.setattr("fenics_ehd.reduction.superelement.superelement", lambda _: element)
    found = read_op4_matrices(export_op4(rod, tmp_path / "rod.op4"))["KAA"].toarray()
    np.testing.assert_array_equal(found[:3, 3], [0.0, 0.0, -1.5e-99])
    element.stiffness[:2, 3] = element.stiffness[3, :2] = 0.0
    np.testing.assert_array_equal(found, element.stiffness)
    lines = export_dmig(rod, tmp_path / "rod.dmig").read_text().splitlines()
    assert max(len(line) for line in lines if line[0] != "$") <= 72
    (value,) = [line for line in lines if "E-99" in line]
    assert value.endswith("-1.500000000E-99")


def test_pynastran_reads_the_same_from_both_files(rod, figure):
    """Stored figures of an independent reader, against the matrices as they are now."""
    element = superelement(rod)
    size = len(element.mass)
    assert STORED["op4"]["shape"] == STORED["dmig"]["shape"] == [size, size]
    rows = [[number, component] for number, component in element.rows]
    assert STORED["rows"] == rows
    assert rows[-1] == [FIRST_MODE + len(element.frequencies) - 1, 0]
    for number, point in enumerate(element.grid_points, start=1):
        np.testing.assert_allclose(STORED["positions"][str(number)], point.position, atol=1e-8)
    assert STORED["bores"][:2] == [3 * len(rod.bore_nodes), size]
    expected = frequencies(element.stiffness, element.mass)[6:]
    errors = [
        np.abs(np.array(STORED[kind]["frequencies"])[6:] / expected - 1.0).max()
        for kind in ("op4", "dmig")
    ]
    figure(
        "matrices", "superelement as OUTPUT4 read by pyNastran, frequencies", errors[0], most=1e-6
    )
    figure(
        "part and reduction",
        "superelement as DMIG read by pyNastran, frequencies",
        errors[1],
        most=1e-6,
    )


@pytest.mark.slow
def test_a_command_exports_all_forms_and_replaces_only_its_own_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    call = ["reduce", "conrod", "-o", "rod.h5", "--export", "op4"]
    every = [*call, "--method", "m1", "--modes", "8", "--no-estimate-error", "--export", "dmig"]
    run = CliRunner().invoke
    for _ in range(2):
        result = run(cli, every)
        assert result.exit_code == 0, result.output
    assert "exported to rod.op4" in result.output
    (tmp_path / "rod.dmig").write_text("somebody's\n")
    result = run(cli, every)
    assert "rod.dmig" in str(result.exception)
    result = run(cli, [*call, "--method", "m4"])
    assert "--export op4 with method m4" in str(result.exception)


# The page


def test_lines_of_the_page_integrate_the_equations_of_motion(rod, tmp_path, monkeypatch):
    """The centre of mass follows from the force alone."""
    (block,) = [b for b in PAGE.split("```python\n")[1:] if "solve_ivp" in b]
    monkeypatch.chdir(tmp_path)
    ehd.reduction.export_npz(rod, "rod.npz")
    names = {}
    exec(block.split("```")[0], names)
    solution, mass = names["solution"], names["mass"]
    # Momentum along y over the mass is the velocity of the centre.
    velocity = mass[1] @ solution.y[len(mass) :, -1] / mass[1, 1]
    end = solution.t[-1]
    expected = 100.0 * (1.0 - np.cos(1000.0 * end)) / 1000.0 / mass[1, 1]
    np.testing.assert_allclose(velocity, expected, rtol=1e-5)
    assert solve_ivp is names["solve_ivp"]
    for name in np.load("rod.npz").files:
        assert f"`{name}`" in PAGE, name
