"""A part with several lubricated bores: the connecting rod with both of its ends."""

from dataclasses import replace

import numpy as np
import pytest
from foreign_parts import to_scipy
from mpi4py import MPI
from scipy import linalg, sparse

import fenics_ehd as ehd
from fenics_ehd.film.grid import film_layout
from fenics_ehd.reduction.body import body_digest
from fenics_ehd.reduction.bore import outward
from fenics_ehd.reduction.fixed_interface_modes import two_step_craig_bampton
from fenics_ehd.reduction.part_files import load_structure, save_structure
from fenics_ehd.reduction.reductor import rigid
from fenics_ehd.reduction.structure import check_structure
from fenics_ehd.scenes.part import reduce_structure
from fenics_ehd.scenes.part_settings import ReductionSettings

#: A mesh that a dense eigenvalue problem takes.
COARSE = {
    "bore_cells_around": 10,
    "bore_cells_along": 1,
    "big_end_layers": 1,
    "shank_cells": 4,
    "small_end_layers": 1,
}
LENGTH, RADII = 0.16, {"bore": 0.0225, "pin": 0.012}


def rod(comm=MPI.COMM_WORLD, bores=("bore", "pin"), cells="hex"):
    mesh = ehd.build_mesh(ehd.model_path("conrod"), COARSE, comm=comm, cells=cells, bores=bores)
    return ehd.assemble_structure(mesh, ehd.Material(210e9, 0.3, 7850.0), bores=bores)


@pytest.fixture(scope="module")
def structure():
    return rod()


@pytest.fixture(scope="module")
def part(structure):
    return ehd.Reductor(structure, every_pressure=True)


@pytest.fixture(scope="module")
def bodies(part):
    return {
        "full": ehd.full_interface(part, 6),
        "m4": ehd.residual_flexibility(part, 6, tolerance=0.0),
        "m3": ehd.load_dependent(part, 6, 20),
        "m1": ehd.craig_bampton(part, 12),
        "m2": two_step_craig_bampton(part, 12),
        "rigid": rigid(part, estimate_error=True),
    }


@pytest.fixture(scope="module")
def dense_flexibility(structure):
    """Outward displacement of both bores by their nodal pressures, without this package."""
    k, m = (to_scipy(a).toarray() for a in (structure.stiffness, structure.mass))
    _, vectors = linalg.eigh(k, m)
    motions = vectors[:, :6]
    load = sparse.hstack([to_scipy(b.load) for b in structure.bores.values()]).toarray()
    load -= m @ motions @ (motions.T @ load)
    bordered = np.block([[k, m @ motions], [motions.T @ m, np.zeros((6, 6))]])
    scale = 1 / np.sqrt(np.abs(np.diag(k)).max())
    size = np.concatenate([np.full(len(k), scale), np.full(6, 1.0)])
    rhs = np.vstack([load, np.zeros((6, load.shape[1]))])
    found = np.linalg.solve(bordered * np.outer(size, size), size[:, None] * rhs)
    response = (size[:, None] * found)[: len(k)].reshape(-1, 3, load.shape[1])
    rows = []
    for bore, x in zip(structure.bores.values(), (0.0, LENGTH), strict=True):
        radial = structure.coordinates[bore.nodes] - [x, 0.0, 0.0]
        radial[:, 2] = 0.0
        radial /= np.linalg.norm(radial, axis=1)[:, None]
        rows.append(np.einsum("ic,ick->ik", radial, response[bore.nodes]))
    return np.vstack(rows)


def blocks(structure, flexibility):
    m = [len(b.nodes) for b in structure.bores.values()]
    k = [len(b.pressure_coordinates) for b in structure.bores.values()]
    for name, rows in zip(structure.bores, np.split(flexibility, [m[0]]), strict=True):
        for other, block in zip(structure.bores, np.split(rows, [k[0]], axis=1), strict=True):
            yield f"{name} by {other}", block


@pytest.mark.parametrize("cells", ["hex", "tet"])
def test_every_bore_is_a_cylinder_about_its_own_centre(cells):
    part = rod(MPI.COMM_SELF, cells=cells)
    for (name, bore), x in zip(part.bores.items(), (0.0, LENGTH), strict=True):
        np.testing.assert_allclose(bore.centre, [x, 0, 0], atol=1e-9)
        assert bore.radius == pytest.approx(RADII[name], rel=1e-9)
        radii = np.linalg.norm(bore.coordinates[:, :2], axis=1)
        np.testing.assert_allclose(radii, RADII[name], rtol=1e-9)
        there = part.coordinates[bore.nodes]
        np.testing.assert_allclose(bore.centre + bore.coordinates, there, atol=1e-15)
        if cells == "hex":
            assert film_layout(bore.pressure_coordinates)[0] == ((10, 1), (8, 1))[name == "pin"]
    check_structure(part)


@pytest.mark.parametrize("method", ["full", "m4"])
def test_flexibility_of_every_bore_by_every_other(structure, bodies, dense_flexibility, method):
    ours = dict(blocks(structure, bodies[method].basis_flexibility()))
    for name, block in blocks(structure, dense_flexibility):
        assert np.abs(ours[name] - block).max() < 1e-8 * np.abs(block).max(), name


@pytest.mark.parametrize("method", ["m1", "m2", "m3", "rigid"])
def test_what_a_basis_misses_and_what_it_has_are_the_whole(bodies, dense_flexibility, method):
    body = bodies[method]
    whole = body.basis_flexibility() + body.missing_flexibility
    assert np.abs(whole - dense_flexibility).max() < 1e-8 * np.abs(dense_flexibility).max()


def test_what_one_bore_does_to_the_other_is_reciprocal(part):
    responses = part.measured_responses()
    energy = responses.work @ responses.pressures.T
    k = len(part.structure.bores["bore"].pressure_coordinates)
    there, back = energy[:k, k:], energy[k:, :k].T
    assert np.abs(there).max() > 1e-4 * np.abs(energy).max()
    assert np.abs(there - back).max() < 1e-9 * np.abs(there).max()


def test_a_patterns_work_on_both_bores_is_its_own(bodies):
    """``V^T J^T G_res J V`` is diagonal over all bores together."""
    body, r = bodies["m4"], bodies["m4"].residual
    np.testing.assert_allclose(r.patterns @ r.patterns.T, np.eye(r.rank), atol=1e-10)
    apart = [body.at_bore(name).residual.patterns for name in body.bores]
    assert [p.shape[1] for p in apart] == [40 * 3 // 2, 48]
    assert all(np.abs(p).max() > 0.05 for p in apart)


@pytest.mark.parametrize("method", ["full", "m4"])
def test_a_bore_that_nothing_loads_changes_nothing(bodies, method):
    """The rod with one bore has the same flexibility there."""
    reduce = {
        "full": ehd.full_interface,
        "m4": lambda p, n: ehd.residual_flexibility(p, n, tolerance=0.0),
    }
    alone = reduce[method](rod(MPI.COMM_SELF, ("bore",)), 6)
    ours = bodies[method].at_bore("bore").basis_flexibility()
    expected = alone.basis_flexibility()
    assert np.abs(ours - expected).max() < 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize("method", ["full", "m4", "m3", "m2", "rigid"])
def test_a_file_returns_all_bores_in_their_order(bodies, tmp_path, method):
    body = bodies[method]
    order = dict(zip(("z", "a"), body.bores.values(), strict=True))
    body = replace(body, bores=order)
    ehd.save_body(body, tmp_path / "rod.h5")
    again = ehd.load_body(tmp_path / "rod.h5")
    assert list(again.bores) == ["z", "a"]
    assert body_digest(again) == body_digest(body)
    np.testing.assert_array_equal(again.bores["a"].centre, body.bores["a"].centre)


def test_a_part_in_a_file_keeps_all_bores(structure, tmp_path):
    part = replace(structure, bores=dict(zip(("z", "a"), structure.bores.values(), strict=True)))
    save_structure(part, tmp_path / "part.h5")
    again = load_structure(tmp_path / "part.h5")
    assert list(again.bores) == ["z", "a"]
    assert (to_scipy(again.load) != to_scipy(structure.load)).nnz == 0
    np.testing.assert_array_equal(again.bores["a"].centre, structure.bores["pin"].centre)


def test_the_bore_of_several_must_be_named(structure, bodies):
    for part, what in ((structure, "structure"), (bodies["m4"], "reduced body")):
        with pytest.raises(ehd.errors.SettingsError, match=f"{what} has the bores bore, pin: name"):
            part.bore  # noqa: B018
    with pytest.raises(ehd.errors.SettingsError, match="bore, pin: name one of them"):
        bodies["m4"].bore_nodes  # noqa: B018
    with pytest.raises(ehd.errors.SettingsError, match="no bore 'small': its bores are bore, pin"):
        bodies["m4"].at_bore("small")


def test_snapshots_of_a_run_are_those_of_one_bore(structure):
    with pytest.raises(ehd.errors.SettingsError, match="one bore, but the part has the bores bore"):
        reduce_structure(structure, ReductionSettings(method="m3", snapshots="run"))


def test_bores_of_one_place_and_of_another_origin_are_refused(structure):
    bore, pin = structure.bores.values()
    with pytest.raises(ehd.errors.StructureError, match=r"pin\.centre is .*: the centre of"):
        check_structure(replace(structure, bores={"pin": pin, "bore": bore}))
    with pytest.raises(ehd.errors.StructureError, match=r"bore, again: node .* occurs 2 times"):
        check_structure(replace(structure, bores={"bore": bore, "again": bore}))


@pytest.mark.mpi
@pytest.mark.parametrize("method", ["m4", "m3", "m2"])
def test_any_number_of_ranks_gives_the_same_body(method):
    reductions = {
        "m4": lambda p: ehd.residual_flexibility(p, 6),
        "m3": lambda p: ehd.load_dependent(p, 6, 20),
        "m2": lambda p: two_step_craig_bampton(p, 12),
    }
    ours, alone = (reductions[method](rod(c)) for c in (MPI.COMM_WORLD, MPI.COMM_SELF))
    np.testing.assert_allclose(ours.frequencies, alone.frequencies, rtol=1e-8)
    for found in ("missing_flexibility", "basis_flexibility"):
        one, other = (getattr(b, found) for b in (ours, alone))
        one, other = (x() if callable(x) else x for x in (one, other))
        largest = np.abs(one - other).max(initial=0.0)
        assert largest < 1e-8 * np.abs(alone.basis_flexibility()).max()


def test_outward_is_away_from_each_bores_own_axis(bodies):
    body = bodies["m3"]
    whole = body.outward(body.bore_basis)
    for rows in body.each_bore():
        own = outward(rows.surface.coordinates, body.bore_basis[rows.nodes])
        np.testing.assert_array_equal(whole[rows.nodes], own)
