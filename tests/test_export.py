"""Reduced bodies for others: plain arrays; Exudyn, a demo, must move them right.

What needs Exudyn is skipped without it; it runs with ``pip install --no-deps --target DIR exudyn``
and DIR on PYTHONPATH.
"""

from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI
from scene_cases import structure
from scipy import sparse
from test_demos import demo

import fenics_ehd as ehd
from fenics_ehd.reduction.body import ResidualFlexibility, contents, export_npz
from fenics_ehd.reduction.reductor import rigid

exudyn_body = demo("exudyn_body")

METHODS = ("m3", "m1")


@pytest.fixture(scope="module")
def bodies(rod_structure):
    kept = {"keep_basis": True, "estimate_error": False}
    return {
        "m3": ehd.load_dependent(rod_structure, 6, 10, **kept),
        "m1": ehd.craig_bampton(rod_structure, 12, **kept),
    }


@pytest.fixture(scope="module")
def files(bodies, rod_structure, tmp_path_factory):
    folder = tmp_path_factory.mktemp("exudyn")
    return {m: exudyn_body.export(b, rod_structure, folder / f"{m}.npz") for m, b in bodies.items()}


def with_residual(body):
    m, k, r = len(body.bore_nodes), len(body.pressure_nodes), 4
    random = np.random.default_rng(2).standard_normal
    residual = ResidualFlexibility(
        random((m, 3, r)), random((r, k)), np.arange(1.0, 1 + r), np.eye(r)
    )
    return replace(body, residual=residual)


# Plain arrays


@pytest.mark.parametrize("residual", [False, True])
def test_npz_holds_the_body_bit_for_bit_under_documented_names(bodies, tmp_path, residual):
    body = with_residual(bodies["m1"]) if residual else bodies["m1"]
    path = export_npz(body, tmp_path / "rod")
    assert path == tmp_path / "rod.npz"
    with np.load(path, allow_pickle=False) as file:
        found = dict(file)
    assert {name for name in found if f"``{name}``" not in export_npz.__doc__} == set()
    for name, value in contents(body).items():
        np.testing.assert_array_equal(found[name], value)
    np.testing.assert_array_equal(found["pressure_nodes"], body.pressure_nodes)
    for name in ("stiffness", "mass", "bore_basis", "rigid_mass", "rigid_load"):
        assert found[name].tobytes() == getattr(body, name).tobytes()
    assert tuple(found["kinds"]) == body.kinds
    assert ("residual_patterns" in found) == residual


def test_a_rigid_body_has_empty_matrices(rod_structure, tmp_path):
    path = export_npz(rigid(rod_structure), tmp_path / "rod.npz")
    with np.load(path, allow_pickle=False) as file:
        assert file["stiffness"].shape == (0, 0)
        assert file["point_basis"].shape == (1, 3, 0)
        np.testing.assert_allclose(file["point_position"], [[0.16, 0.0, 0.0]], atol=1e-6)


def test_several_bores_stand_one_after_the_other():
    coarse = {"bodies.rod.geometry.bore_cells_along": 2}
    part = structure("slider-crank-both-ends", "rod", MPI.COMM_SELF, coarse)
    body = ehd.load_dependent(part, 6, 8, estimate_error=False)
    found = contents(body)
    first, second = body.bores.values()
    m, k = found["bore_sizes"].T
    assert list(found["bore_names"]) == ["bore", "pin"]
    assert (m.sum(), k.sum()) == (len(body.bore_basis), body.load_projection.shape[1])
    np.testing.assert_allclose(found["bore_centre"], [[0, 0, 0], [0.16, 0, 0]], atol=1e-12)
    there = found["bore_nodes"][found["bore_cells"]]
    for bore, cells in ((first, there[: len(first.cells)]), (second, there[len(first.cells) :])):
        around = np.linalg.norm((cells - bore.centre)[..., :2], axis=-1)
        np.testing.assert_allclose(around, bore.radius, rtol=1e-6)


# Inertia couplings


def tilde(columns):
    """Matrix of the cross product of every column, node by node, shape (3 nodes, 3 k)."""
    nodes = columns.reshape(-1, 3, columns.shape[1])
    skew = np.cross(nodes[:, None, :, :], np.eye(3)[None, :, :, None], axis=2)
    return skew.transpose(0, 2, 3, 1).reshape(len(columns), -1)


def test_plane_motion_is_a_part_of_spatial_motion(rod_structure, bodies):
    body = bodies["m3"]
    mass, spin, centrifugal = exudyn_body.inertia(rod_structure, body.columns)
    plane = np.delete(np.arange(4 + body.modes), 3)
    square = np.ix_(plane, plane)
    size = np.sqrt(np.diag(body.inertia.mass))
    for ours, reference in (
        (mass, body.inertia.mass),
        (spin[2], body.inertia.spin),
        (centrifugal[2, 2], body.inertia.centrifugal),
    ):
        assert np.abs((ours[square] - reference) / np.outer(size, size)).max() < 1e-12
    np.testing.assert_allclose(centrifugal[:, :, 0, 0], body.rigid_mass[3:, 3:], atol=1e-14)


@pytest.mark.parametrize("method", METHODS)
def test_couplings_are_the_sums_over_the_part(rod_structure, bodies, files, method):
    """As Exudyn's own reduction forms them, with its names, from M as a sparse matrix."""
    indptr, indices, data = rod_structure.mass.getValuesCSR()
    m = sparse.csr_matrix((data, indices, indptr))
    psi = bodies[method].columns
    x = rod_structure.coordinates.reshape(-1, 1)
    phi = np.tile(np.eye(3), (len(x) // 3, 1))
    x_tilde, psi_tilde = tilde(x), tilde(psi)
    centre = phi.T @ (m @ x) / (phi.T @ (m @ phi))[0, 0]
    expected = {
        "massMatrixReduced": psi.T @ (m @ psi),
        "Mtt": phi.T @ (m @ phi),
        "inertiaLocal": x_tilde.T @ (m @ x_tilde),
        "chiU": centre[:, 0],
        "chiUtilde": tilde(centre),
        "mPhitTPsi": phi.T @ (m @ psi),
        "mPhitTPsiTilde": phi.T @ (m @ psi_tilde),
        "mXRefTildePsi": x_tilde.T @ (m @ psi),
        "mXRefTildePsiTilde": x_tilde.T @ (m @ psi_tilde),
        "mPsiTildePsi": psi_tilde.T @ (m @ psi),
        "mPsiTildePsiTilde": psi_tilde.T @ (m @ psi_tilde),
    }
    with np.load(files[method], allow_pickle=False) as file:
        found = dict(file)
    for name, value in expected.items():
        assert found[name].shape == value.shape
        # What the symmetry of the rod makes zero is round-off.
        np.testing.assert_allclose(found[name], value, atol=1e-9 * np.abs(value).max() + 1e-13)
    mean = [v.array @ x[:, 0] for v in rod_structure.attachments["pin"]]
    np.testing.assert_allclose(found["xRef"][-3:], mean, atol=1e-12)


@pytest.mark.parametrize(
    "change",
    [
        with_residual,
        lambda b: replace(b, frame="clamped"),
        lambda b: replace(b, frequencies=np.zeros(0)),
    ],
)
def test_what_exudyn_cannot_hold_is_refused(bodies, rod_structure, tmp_path, change):
    with pytest.raises(ehd.errors.InputError, match="M1, M2, M3"):
        exudyn_body.export(change(bodies["m1"]), rod_structure, tmp_path / "rod.npz")
    assert not list(tmp_path.iterdir())


# In Exudyn


@pytest.fixture(scope="module")
def exudyn():
    return pytest.importorskip("exudyn")


@pytest.mark.parametrize("method", METHODS)
def test_exudyn_finds_the_free_frequencies(exudyn, bodies, files, method):
    found = exudyn_body.frequencies(files[method])
    expected = exudyn_body.free_frequencies(bodies[method])
    assert found[:6].max() < 1e-3 * expected[0]
    np.testing.assert_allclose(found[6:], expected, rtol=1e-8)
