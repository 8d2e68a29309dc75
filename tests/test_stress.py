"""Stresses of parts over a cycle: known ones, static solutions, the command."""

import json
from dataclasses import replace
from types import SimpleNamespace

import meshio
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from mpi4py import MPI
from oracle_stress import csr, factors
from scene_cases import structure as structure_of
from scipy import linalg
from test_recovery import STEEL, ring_under_pressure

import fenics_ehd as ehd
from fenics_ehd.fem import stress as stress_module
from fenics_ehd.fem.stress import NodalStress, largest_half_range, largest_principal
from fenics_ehd.reduction.part_files import von_mises
from fenics_ehd.reduction.residual_completion import basis_of
from fenics_ehd.results.stress import cycle_stress, figures, write_fields

#: Length, and half of height and width, of the bar along x.
LENGTH, HEIGHT, WIDTH = 0.1, 0.01, 0.006

BAR = f"""
DefineConstant[ tetrahedra = {{0, Choices{{0, 1}}, Name "Bar/tetrahedra"}} ];
Point(1) = {{0, -{HEIGHT}, -{WIDTH}}}; Point(2) = {{{LENGTH}, -{HEIGHT}, -{WIDTH}}};
Point(3) = {{{LENGTH}, {HEIGHT}, -{WIDTH}}}; Point(4) = {{0, {HEIGHT}, -{WIDTH}}};
For i In {{1:4}}
  Line(i) = {{i, i % 4 + 1}};
EndFor
Transfinite Curve {{1, 3}} = 6; Transfinite Curve {{2, 4}} = 3;
Curve Loop(1) = {{1:4}}; Plane Surface(1) = {{1}}; Transfinite Surface {{1}};
If (tetrahedra)
  solid[] = Extrude {{0, 0, {2 * WIDTH}}} {{ Surface{{1}}; Layers{{2}}; }};
Else
  Recombine Surface {{1}};
  solid[] = Extrude {{0, 0, {2 * WIDTH}}} {{ Surface{{1}}; Layers{{2}}; Recombine; }};
EndIf
Physical Volume("bar") = {{solid[1]}};
"""

#: Cells and family of the displacements.
KINDS = {
    "hex20": ("hex", "serendipity"),
    "hex27": ("hex", "lagrange"),
    "tet10": ("tet", "lagrange"),
}

#: What `cycle_stress` knows of a body without residual patterns.
PLAIN = SimpleNamespace(residual=None)


@pytest.fixture(scope="module", params=KINDS)
def bar(request, tmp_path_factory):
    cells, family = KINDS[request.param]
    path = tmp_path_factory.mktemp("bar") / "bar.geo"
    path.write_text(BAR)
    part = ehd.build_mesh(
        path,
        comm=MPI.COMM_SELF,
        cells=cells,
        serendipity_geometry=family == "serendipity",
        bores=(),
    )
    return ehd.assemble_structure(part, STEEL, family=family, bores=(), attachments=())


def tension_and_bending(x):
    """Displacements of unit stress s_xx = 1 and of s_xx = y / HEIGHT, shape (3 nodes, 2)."""
    x, y, z = x.T
    nu, modulus = STEEL.poissons_ratio, STEEL.youngs_modulus
    tension = np.column_stack([x, -nu * y, -nu * z]) / modulus
    bending = np.column_stack([x * y, -0.5 * (x**2 + nu * (y**2 - z**2)), -nu * y * z])
    return np.column_stack([tension.ravel(), bending.ravel() / (modulus * HEIGHT)])


def all_nodes(structure, columns):
    nodal = NodalStress(structure.recovery.stress(columns))
    found = np.full((nodal.nodes, 6, columns.shape[1]), np.nan)
    for nodes, stress in nodal.blocks():
        found[nodes] = stress
    return found


@pytest.mark.parametrize("instants", [2, 40])
def test_bar_under_tension_and_bending_has_the_stresses_of_the_textbook(bar, instants):
    """``s_xx = a cos t + b (y / HEIGHT) sin t``: quadratic displacements, exact on these cells.

    Its half-range over a whole turn is sqrt(a^2 + b^2 (y / HEIGHT)^2), with instants at the
    extremes of the outer fibres; of two instants alone half their difference. As many displacements
    as instants at most are taken: both ways are the same.
    """
    a, b, (_, y, _) = 30e6, 40e6, bar.coordinates.T
    # Outer fibres are at their extremes at t0 and pi - t0.
    time = np.arctan2(b, a) + 2 * np.pi * np.arange(instants) / instants
    if instants == 2:
        time = np.array([0.0, 0.5 * np.pi])
    coordinates = np.column_stack([a * np.cos(time), b * np.sin(time)])
    columns, none = tension_and_bending(bar.coordinates), np.zeros((instants, 0))
    found = cycle_stress(bar, PLAIN, columns, coordinates, none)
    history = a * np.cos(time) + b * (y / HEIGHT)[:, None] * np.sin(time)
    exact = 0.5 * np.ptp(history, axis=1)
    np.testing.assert_allclose(found.half_range.von_mises, exact, rtol=1e-9, atol=1e-3)
    np.testing.assert_allclose(found.principal, history.max(axis=1), rtol=1e-9, atol=1e-2)
    mean = 0.5 * (history.max(axis=1) + history.min(axis=1))
    np.testing.assert_allclose(found.half_range.mean[:, 0], mean, atol=1.0)
    if instants == 40:
        worst = figures(found, {"time_s": time})["half_range"]
        assert worst["von_mises_Pa"] == pytest.approx(np.hypot(a, b), rel=1e-9)
        assert abs(worst["place_m"][1]) == pytest.approx(HEIGHT, rel=1e-9)
        np.testing.assert_allclose(worst["in_cells_around_Pa"], np.hypot(a, b), rtol=1e-9)
        # The same from more displacements than instants.
        many = np.hstack([columns, np.zeros((len(columns), 60))])
        wide = np.hstack([coordinates, np.ones((instants, 60))])
        other = cycle_stress(bar, PLAIN, many, wide, none)
        np.testing.assert_allclose(other.half_range.von_mises, exact, rtol=1e-9)


def test_linear_stresses_are_continued_to_the_nodes_of_every_cell(bar):
    stress = all_nodes(bar, tension_and_bending(bar.coordinates))
    exact = np.zeros_like(stress)
    exact[:, 0, 0], exact[:, 0, 1] = 1.0, bar.coordinates[:, 1] / HEIGHT
    assert np.abs(stress - exact).max() < 1e-9
    nodal = NodalStress(bar.recovery.stress(tension_and_bending(bar.coordinates)))
    node = int(np.argmin(np.linalg.norm(bar.coordinates - [0.04, 0, 0], axis=1)))
    around = nodal.around(node)
    assert len(around) > 1
    np.testing.assert_allclose(around, np.broadcast_to(exact[node], around.shape), atol=1e-9)


def test_nodes_have_the_mean_of_the_cells_around_them_in_whatever_blocks(bar, monkeypatch):
    columns = np.random.default_rng(4).normal(size=(bar.size, 2)) * 1e-9
    whole = all_nodes(bar, columns)
    monkeypatch.setattr(stress_module, "_NODAL_BYTES", 1)
    size = np.abs(whole).max()
    assert np.abs(all_nodes(bar, columns) - whole).max() < 1e-12 * size
    nodal = NodalStress(bar.recovery.stress(columns))
    for node in (0, 17, len(bar.coordinates) - 1):
        mean = nodal.around(node).mean(axis=0)
        assert np.abs(mean - whole[node]).max() < 1e-12 * size


def ring_at_its_bore(path, n):
    """Largest error of the hoop stress at the bore's nodes of a ring under 1 Pa inside."""
    ring, displacement = ring_under_pressure(path, n)
    xx, yy, _, _, _, xy = all_nodes(ring, displacement)[ring.bore.nodes, :, 0].T
    c, s = ring.bore.coordinates[:, :2].T / ring.bore.radius
    hoop = s**2 * xx + c**2 * yy - 2 * c * s * xy
    return np.abs(hoop - 5 / 3).max()


@pytest.mark.slow
def test_hoop_stress_at_the_bore_of_a_ring_converges_to_that_of_lame(tmp_path, figure):
    """p (b^2 + a^2) / (b^2 - a^2) at the surface, where stresses are largest: 5/3 for b = 2 a."""
    errors = [ring_at_its_bore(tmp_path / "ring.geo", n) for n in (2, 4, 8)]
    rates = np.log2(np.divide(errors[:-1], errors[1:]))
    assert rates[1] > rates[0]
    name = "hoop stress at a ring's bore of 8 cells through its wall"
    figure("stress", name, errors[2], most=0.011, unit="p")
    figure("stress", "its order of convergence", rates[1], least=1.75)


@pytest.fixture(scope="module")
def reduced(rod_structure):
    return ehd.load_dependent(rod_structure, 6, 12, estimate_error=False, keep_basis=True)


def test_basis_made_again_is_turned_to_the_coordinates_of_the_run(reduced):
    """Signs and mixtures of modes, as another BLAS may give them."""
    n = reduced.modes
    turn = linalg.block_diag(linalg.qr(np.random.default_rng(0).normal(size=(n - 1, n - 1)))[0], -1)
    points = {
        name: np.hstack([field[:, :3], field[:, 3:] @ turn])
        for name, field in reduced.points.items()
    }
    other = replace(
        reduced,
        bore_basis=reduced.bore_basis @ turn,
        points=points,
        stiffness=turn.T @ reduced.stiffness @ turn,
        mass=turn.T @ reduced.mass @ turn,
    )
    columns = basis_of(reduced, other, reduced.columns @ turn)
    assert np.abs(columns - reduced.columns).max() < 1e-7 * np.abs(reduced.columns).max()
    assert basis_of(reduced, reduced, reduced.columns) is reduced.columns
    with pytest.raises(ehd.errors.VerificationError, match="was the model changed"):
        basis_of(reduced, replace(other, mass=1.01 * other.mass), reduced.columns)
    fewer = replace(reduced, bore_basis=reduced.bore_basis[:-1])
    with pytest.raises(ehd.errors.VerificationError, match="bore nodes"):
        basis_of(reduced, fewer, reduced.columns)


def test_paraview_file_holds_the_fields(bar, tmp_path):
    time = np.array([0.0, 0.25, 0.5])
    coordinates = np.column_stack([[1e6, 0.0, 2e6], [0.0, 3e6, 0.0]])
    columns = tension_and_bending(bar.coordinates)
    found = cycle_stress(bar, PLAIN, columns, coordinates, np.zeros((3, 0)))
    write_fields(tmp_path / "vtk" / "bar_stress.vtu", found, time)
    mesh = meshio.read(tmp_path / "vtk" / "bar_stress.vtu")
    assert len(mesh.cells[0].data) == len(bar.recovery.cells)
    data = mesh.point_data
    np.testing.assert_array_equal(data["half_range_von_mises_Pa"], found.half_range.von_mises)
    np.testing.assert_allclose(data["mean_von_mises_Pa"], von_mises(found.half_range.mean))
    np.testing.assert_allclose(
        data["mean_hydrostatic_Pa"], found.half_range.mean[:, :3].mean(axis=1)
    )
    assert set(np.unique(data["largest_principal_at_s"])) <= set(time)
    top = bar.coordinates[:, 1] > 0.9 * HEIGHT
    np.testing.assert_array_equal(data["largest_principal_at_s"][top], 0.25)
    json.dumps(figures(found, {"time_s": time}))


def test_stresses_of_a_held_housing_are_those_of_the_static_solution():
    """Two pressures at rest, M4 with every pattern: half their difference is the half-range."""
    coarse = {"bodies.housing.geometry": {"bore_cells_along": 2}}
    housing = structure_of("rotor-paper", "housing", MPI.COMM_SELF, coarse)
    body = ehd.residual_flexibility(
        housing, 4, tolerance=0.0, centrifugal=False, keep_basis=True, estimate_error=False
    )
    x, y, z = body.pressure_nodes.T
    shape = (1 - (2 * z / np.ptp(z)) ** 2) * 1e7
    pressures = np.column_stack([shape * np.exp(x / 0.01), shape * np.exp(-y / 0.01)])
    coordinates = np.linalg.solve(body.stiffness, body.load_projection[3:] @ pressures)
    amplitudes = body.residual.patterns @ pressures
    found = cycle_stress(housing, body, body.columns, coordinates.T, amplitudes.T)
    stiffness, load = (csr(m) for m in (housing.stiffness, housing.bore.load))
    stress = all_nodes(housing, factors(stiffness).solve(load @ pressures))
    exact = von_mises(0.5 * (stress[..., 1] - stress[..., 0]))
    assert np.abs(found.half_range.von_mises - exact).max() < 1e-5 * exact.max()
    tensors = np.moveaxis(stress, 1, 2)[..., TENSOR]
    exact = np.linalg.eigvalsh(tensors)[..., 2].max(axis=1)
    assert np.abs(found.principal - exact).max() < 1e-5 * exact.max()


# Extremes of histories: half-ranges over pairs of instants, principal stresses

TENSOR = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])


def numbers(shape):
    return hnp.arrays(float, shape, elements=st.floats(-1e8, 1e8, allow_subnormal=False))


@st.composite
def histories(draw):
    """Histories of a few points: anything, few values many times over, or nearly along a line."""
    points, instants = draw(st.integers(1, 4)), draw(st.integers(1, 12))
    stress = draw(numbers((points, 6, instants)))
    kind = draw(st.sampled_from(["any", "repeated", "line"]))
    if kind == "repeated":
        stress = 1e8 * np.sign(stress)
    if kind == "line":
        stress = stress[:, :1] * draw(numbers((points, 6, 1))) * 1e-8 + 1e-9 * stress
    return stress


def by_force(stress):
    """Largest von Mises stress of ``(s_i - s_j) / 2``, all pairs tried."""
    pairs = 0.5 * (stress[:, :, :, None] - stress[:, :, None])
    return von_mises(np.moveaxis(pairs, 1, -1)).max(axis=(1, 2))


@given(histories())
def test_half_range_is_the_largest_of_all_pairs(stress):
    found = largest_half_range(stress)
    size = np.abs(stress).max(initial=1.0)
    np.testing.assert_allclose(found.von_mises, by_force(stress), rtol=1e-12, atol=1e-12 * size)
    for point, (i, j) in enumerate(found.instants):
        assert i <= j
        first, last = stress[point, :, i], stress[point, :, j]
        np.testing.assert_array_equal(found.half_range[point], 0.5 * (last - first))
        np.testing.assert_array_equal(found.mean[point], 0.5 * (last + first))
    np.testing.assert_allclose(von_mises(found.half_range), found.von_mises, rtol=1e-12, atol=1e-6)


@given(histories())
def test_principal_stress_is_the_largest_eigenvalue_of_all_instants(stress):
    values, instants = largest_principal(stress)
    every = np.linalg.eigvalsh(np.moveaxis(stress, 1, 2)[..., TENSOR])[..., 2]
    size = np.abs(stress).max(initial=1.0)
    np.testing.assert_allclose(values, every.max(axis=1), rtol=1e-12, atol=1e-13 * size)
    there = every[np.arange(len(stress)), instants]
    np.testing.assert_allclose(values, there, rtol=1e-12, atol=1e-13 * size)


def turned(angles, principal):
    """Histories of a plane state whose axes are at given angles, shape (1, 6, instants)."""
    c, s = np.cos(angles), np.sin(angles)
    turn = np.array([[c, -s], [s, c]])
    tensor = np.einsum("ikt,k,jkt->ijt", turn, principal, turn)
    zero = np.zeros_like(angles)
    return np.array([[tensor[0, 0], tensor[1, 1], zero, zero, zero, tensor[0, 1]]])


@pytest.mark.parametrize("instants", [7, 360])
def test_uniaxial_stress_that_turns_once_keeps_its_von_mises_stress_and_yet_has_a_range(instants):
    """A tension s whose direction turns about z: its von Mises stress is s at all times.

    Opposite states are a quarter turn apart, (s - 0) / 2 along one axis and (0 - s) / 2 along the
    other, pure shear: sqrt(3) / 2 s. The mean of the pair is s / 2 in both directions.
    """
    angles = np.pi * np.arange(instants) / instants
    stress = turned(angles, np.array([1e8, 0.0]))
    found = largest_half_range(stress)
    apart = np.diff(found.instants[0])[0]
    nearest = np.abs(np.arange(instants) / instants - 0.5).argmin()
    assert apart in (nearest, instants - nearest)
    exact = 0.5 * np.sqrt(3) * np.sin(np.pi * nearest / instants)
    assert found.von_mises[0] == pytest.approx(1e8 * exact, rel=1e-12)
    if instants == 360:
        np.testing.assert_allclose(found.mean[0, :2], 0.5e8, rtol=1e-12)
    values, _ = largest_principal(stress)
    assert values[0] == pytest.approx(1e8, rel=1e-12)


def test_many_points_are_each_their_own():
    stress = np.random.default_rng(2).normal(size=(60, 6, 40))
    # From lines to clouds: from few to many candidates.
    stress *= np.linspace(0, 1, 60)[:, None, None] ** 3 + np.eye(6)[0][:, None] * 2
    np.testing.assert_allclose(largest_half_range(stress).von_mises, by_force(stress), rtol=1e-12)
