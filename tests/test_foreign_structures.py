"""Parts from other programs: matrices in any form, the part in a file, its boundary points."""

import os
from dataclasses import replace

import h5py
import numpy as np
import pytest
from foreign_parts import ring, ring_arguments, to_scipy
from hypothesis import given, settings
from hypothesis import strategies as st
from mpi4py import MPI
from petsc4py import PETSc
from scipy import io, sparse

import fenics_ehd as ehd
from fenics_ehd.base.sealed_file import seal
from fenics_ehd.reduction.bore import mean_motion
from fenics_ehd.reduction.matrices import as_matrix, reorder
from fenics_ehd.reduction.part_files import load_structure, save_structure
from fenics_ehd.reduction.structure import PointWeights, check_structure

COMM = MPI.COMM_WORLD


@pytest.fixture
def folder(tmp_path):
    """One folder for all ranks."""
    return COMM.bcast(tmp_path)


@pytest.fixture(scope="module")
def arguments():
    return ring_arguments()


@pytest.fixture(scope="module")
def foreign_rod(rod_structure):
    """The default rod as SciPy matrices and plain arrays, shared by all ranks."""
    bore = rod_structure.bore
    weights = rod_structure.attachments["pin"][0].array[::3]
    nodes = np.flatnonzero(weights)
    return ehd.Structure(
        to_scipy(rod_structure.stiffness),
        to_scipy(rod_structure.mass),
        rod_structure.coordinates,
        replace(bore, load=to_scipy(bore.load)),
        {"pin": PointWeights(nodes, 7.0 * weights[nodes])},
    )


def write_hdf5(path, matrix, group="/", shape_is_attribute=True):
    with h5py.File(path, "a") as file:
        csr = file.require_group(group)
        for name in ("data", "indices", "indptr"):
            csr[name] = getattr(matrix, name)
        if shape_is_attribute:
            csr.attrs["shape"] = matrix.shape
        else:
            csr["shape"] = np.array(matrix.shape)


def write_binary(path, matrix):
    own = PETSc.Mat().createAIJ(
        matrix.shape, csr=(matrix.indptr, matrix.indices, matrix.data), comm=PETSc.COMM_SELF
    )
    viewer = PETSc.Viewer().createBinary(str(path), "w", PETSc.COMM_SELF)
    own.view(viewer)
    viewer.destroy()


WRITERS = {
    "whole.mtx": lambda path, a: io.mmwrite(path, a, symmetry="general"),
    "triangle.mtx": lambda path, a: io.mmwrite(path, a, symmetry="symmetric", precision=17),
    "scipy.npz": lambda path, a: sparse.save_npz(path, a),
    "petsc.dat": write_binary,
    "petsc.bin": write_binary,
    "csr.h5": write_hdf5,
    "csr.HDF5": lambda path, a: write_hdf5(path, a, shape_is_attribute=False),
    "csr.hdf5:/part/stiffness": lambda path, a: write_hdf5(
        str(path).split(":")[0], a, "/part/stiffness"
    ),
}


def whole(matrix):
    """All rows of a distributed matrix on every rank, dense."""
    indptr, indices, data = matrix.getValuesCSR()
    mine = sparse.csr_matrix((data, indices, indptr), (len(indptr) - 1, matrix.size[1])).toarray()
    return np.vstack(matrix.comm.tompi4py().allgather(mine))


@pytest.mark.mpi
@pytest.mark.parametrize("name", WRITERS)
def test_every_file_gives_the_matrix_by_whole_nodes(folder, arguments, name):
    path = f"{folder}/{name}"
    if COMM.rank == 0:
        WRITERS[name](path, arguments["stiffness"])
    COMM.barrier()
    matrix = as_matrix(path, COMM, "stiffness")
    assert matrix.getType() in ("seqaij", "mpiaij")
    assert matrix.block_size == 3
    assert matrix.local_size[0] % 3 == 0
    expected = arguments["stiffness"].toarray()
    np.testing.assert_allclose(whole(matrix), expected, rtol=1e-14, atol=1e-14 * expected.max())


@pytest.mark.mpi
@pytest.mark.parametrize("form", ["csr", "csc", "coo", "lil"])
def test_scipy_matrices_keep_the_rows_of_each_rank(arguments, form):
    given = arguments["mass"].asformat(form)
    matrix = as_matrix(given, COMM, "mass")
    np.testing.assert_array_equal(whole(matrix), given.toarray())
    load = as_matrix(arguments["bores"].load, COMM, "load", rows=matrix.local_size[0])
    np.testing.assert_array_equal(whole(load), arguments["bores"].load.toarray())


@pytest.mark.mpi
def test_rectangular_files_have_the_rows_of_the_stiffness_matrix(folder, arguments):
    load = arguments["bores"].load
    if COMM.rank == 0:
        write_binary(folder / "load.dat", load)
        write_hdf5(folder / "load.h5", load)
    COMM.barrier()
    nodes = load.shape[0] // 3
    rows = 3 * (nodes - 5 if COMM.rank == 0 else 5) if COMM.size == 2 else None
    for name in ("load.dat", "load.h5"):
        matrix = as_matrix(folder / name, COMM, "load", rows=rows)
        np.testing.assert_array_equal(whole(matrix), load.toarray())


@settings(max_examples=25)
@given(st.integers(1, 4), st.integers(0, 40), st.integers(0, 2**32 - 1))
def test_entries_in_parts_and_in_any_order_are_summed(nodes, entries, seed):
    random = np.random.default_rng(seed)
    size = 3 * nodes
    rows = np.sort(random.integers(0, size, entries))
    indptr = np.searchsorted(rows, np.arange(size + 1))
    columns, values = random.integers(0, size, entries), random.standard_normal(entries)
    given = sparse.csr_matrix((values, columns, indptr), shape=(size, size))
    matrix = as_matrix(given, MPI.COMM_SELF)
    expected = np.zeros((size, size))
    np.add.at(expected, (rows, columns), values)
    np.testing.assert_allclose(whole(matrix), expected, atol=1e-14)


def test_petsc_matrices_stay_as_they_are():
    part = ring(comm=MPI.COMM_SELF)
    again = replace(part)
    for name in ("stiffness", "mass", "bore", "coordinates"):
        assert getattr(again, name) is getattr(part, name)
    assert again.attachments["left"][0] is part.attachments["left"][0]
    assert again.comm == part.comm


def test_other_petsc_formats_become_aij(arguments):
    matrix = as_matrix(arguments["mass"], MPI.COMM_SELF)
    blocked = matrix.convert("baij", out=PETSc.Mat())
    assert as_matrix(blocked, MPI.COMM_SELF).getType() == "seqaij"
    assert blocked.getType() == "seqbaij"
    shell = PETSc.Mat().createPython(matrix.size, comm=PETSc.COMM_SELF)
    with pytest.raises(ehd.errors.StructureError, match="a matrix of type python to AIJ"):
        as_matrix(shell, MPI.COMM_SELF, "mass")


@pytest.mark.slow
@pytest.mark.mpi
def test_foreign_rod_reduces_to_the_same_body(foreign_rod, rod_body):
    check_structure(foreign_rod)
    body = ehd.load_dependent(foreign_rod, 6, 31)
    np.testing.assert_allclose(body.frequencies, rod_body.frequencies, rtol=1e-7)
    np.testing.assert_array_equal(body.bore_nodes, rod_body.bore_nodes)
    np.testing.assert_allclose(
        body.basis_flexibility(),
        rod_body.basis_flexibility(),
        atol=1e-7 * np.abs(rod_body.basis_flexibility()).max(),
    )


@pytest.mark.mpi
def test_boundary_points_of_every_form_are_the_same(arguments, folder):
    nodes = arguments["attachments"]["right"]
    size = arguments["mass"].shape[0]
    columns = sparse.lil_matrix((size, 3))
    for component in range(3):
        columns[3 * nodes + component, component] = 1 / len(nodes)
    if COMM.rank == 0:
        sparse.save_npz(folder / "point.npz", columns.tocsr())
    COMM.barrier()
    forms = {
        "numbers": nodes,
        "list": nodes.tolist(),
        "pair": (nodes, np.full(len(nodes), -4.0)),
        "record": PointWeights(nodes, np.ones(len(nodes))),
        "repeated": np.tile(nodes, 2),
        "matrix": columns,
        "file": folder / "point.npz",
    }
    part = ring(attachments=forms)
    for vectors in part.attachments.values():
        for component, vector in enumerate(vectors):
            first, last = vector.getOwnershipRange()
            expected = columns.toarray()[first:last, component]
            np.testing.assert_allclose(vector.array, expected, rtol=1e-14)
    again = replace(part, attachments={"vectors": part.attachments["numbers"]})
    assert again.attachments["vectors"] == part.attachments["numbers"]


@pytest.mark.mpi
def test_coordinates_may_be_those_of_this_rank_or_all(arguments):
    part = ring()
    first, last = (row // 3 for row in part.stiffness.getOwnershipRange())
    mine = arguments["coordinates"][first:last]
    np.testing.assert_array_equal(part.coordinates, mine)
    np.testing.assert_array_equal(ring(coordinates=mine.tolist()).coordinates, mine)


# Input that no structure can be made of


BAD = {
    "type": ({"stiffness": [[1.0]]}, "stiffness is a list: give a PETSc matrix"),
    "rows": ({"stiffness": sparse.eye(10)}, "stiffness has 10 rows, not 3 for every node"),
    "mass": ({"mass": sparse.eye(30)}, "mass has 30 rows, but the stiffness matrix has 216"),
    "complex": ({"mass": 1j * sparse.eye(216)}, "mass has complex numbers"),
    "coordinates": ({"coordinates": np.zeros((50, 3))}, r"coordinates have shape \(50, 3\)"),
    "flat": ({"coordinates": np.zeros(216)}, r"coordinates have shape \(216,\).*has 72 nodes"),
    "file": (
        {"mass": "mass.xyz"},
        r"mass, file mass.xyz: the name of the file ends in none of \.mtx",
    ),
    "node": ({"attachments": {"pin": [3, 72]}}, "'pin': node 72 is not one of 0 to 71"),
    "negative": ({"attachments": {"pin": [-1]}}, "'pin': node -1 is not one of 0 to 71"),
    "scalar": ({"attachments": {"pin": (3, 5)}}, r"'pin': node numbers have shape \(\)"),
    "floats": ({"attachments": {"pin": [0.5]}}, "'pin': node numbers have shape .* type float64"),
    "none": ({"attachments": {"pin": []}}, r"'pin': node numbers have shape \(0,\)"),
    "lengths": (
        {"attachments": {"pin": ([1, 2], [1.0])}},
        r"weights have shape \(1,\), but there are 2 nodes",
    ),
    "sum": ({"attachments": {"pin": ([1, 2], [1, -1])}}, "'pin': the sum of the weights is 0"),
    "infinite": ({"attachments": {"pin": ([1], [np.inf])}}, "'pin': the sum of the weights is inf"),
    "columns": ({"attachments": {"pin": sparse.eye(216, 2)}}, "'pin' has 2 columns, not 3"),
}


@pytest.mark.mpi
@pytest.mark.parametrize("case", BAD)
def test_what_is_no_part_is_named(case):
    changes, message = BAD[case]
    with pytest.raises(ehd.errors.StructureError, match=message):
        ring(**changes)


def test_number_of_load_vectors_is_named():
    vector = ring().attachments["left"][0]
    with pytest.raises(ehd.errors.StructureError, match="'pin' has 2 load vectors, not 3"):
        ring(attachments={"pin": (vector, vector)})


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("missing.mtx", "No such file"),
        ("missing.npz", "No such file"),
        ("missing.dat", "No such file"),
        ("missing.h5", "(?i)no such file"),
        ("short.dat", "mmap length is greater"),
        ("text.dat", "not a sparse matrix in PETSc's binary format"),
        ("text.mtx", "text.mtx"),
        ("text.npz", "text.npz"),
        ("text.mtx.gz", "text.mtx.gz"),
        ("text.h5", "(?i)file signature not found"),
        ("pipe.dat", "not a regular file"),
        ("no.h5:/part", "part"),
        ("no.h5:/bare", "indptr"),
    ],
)
def test_unreadable_files_are_named_on_every_rank(folder, arguments, name, message):
    if COMM.rank == 0:
        write_spoiled(folder, name, arguments["stiffness"])
    COMM.barrier()
    with pytest.raises(ehd.errors.StructureError, match=message) as caught:
        as_matrix(f"{folder}/{name}", COMM, "stiffness")
    assert "\n" not in str(caught.value)
    assert name.split(":")[0] in str(caught.value)


def write_spoiled(folder, name, matrix):
    path = folder / name.split(":")[0]
    if name == "short.dat":
        write_binary(path, matrix)
        path.write_bytes(path.read_bytes()[:-8])
    elif name == "pipe.dat":
        os.mkfifo(path)
    elif name.startswith("text"):
        path.write_text("this is no matrix at all, despite its name")
    elif not name.startswith("missing"):
        write_hdf5(path, matrix)
        with h5py.File(path, "a") as file:
            file.create_group("bare").attrs["shape"] = (9, 9)


# The whole part in a file


def same_part(ours, reference):
    """Whether two parts agree to the last bit, on any ranks."""
    for name in ("stiffness", "mass"):
        np.testing.assert_array_equal(whole(getattr(ours, name)), whole(getattr(reference, name)))
    np.testing.assert_array_equal(whole(ours.bore.load), whole(reference.bore.load))
    for name in ("nodes", "coordinates", "pressure_coordinates", "cells", "reference"):
        np.testing.assert_array_equal(getattr(ours.bore, name), getattr(reference.bore, name))
    for name in ("radius", "width", "family", "pressure_family"):
        assert getattr(ours.bore, name) == getattr(reference.bore, name)
    np.testing.assert_array_equal(
        *(np.vstack(p.comm.allgather(p.coordinates)) for p in (ours, reference))
    )
    assert list(ours.attachments) == list(reference.attachments)
    for name, vectors in ours.attachments.items():
        for one, other in zip(vectors, reference.attachments[name], strict=True):
            arrays = (np.concatenate(v.comm.tompi4py().allgather(v.array)) for v in (one, other))
            np.testing.assert_array_equal(*arrays)


@pytest.mark.mpi
def test_file_returns_every_bit_on_any_number_of_ranks(folder):
    part, alone = ring(digits=10), ring(comm=MPI.COMM_SELF)
    save_structure(part, folder / "part.h5")
    again = load_structure(folder / "part.h5")
    same_part(part, again)
    assert again.digits == 10
    check_structure(again)
    same_part(part, load_structure(str(folder / "part.h5"), MPI.COMM_SELF))
    if COMM.rank == 0:
        save_structure(alone, folder / "alone.h5")
    COMM.barrier()
    without = load_structure(folder / "alone.h5")
    same_part(part, without)
    assert without.digits is None
    assert sorted(p.name for p in folder.iterdir()) == ["alone.h5", "part.h5"]


@pytest.mark.mpi
def test_file_of_another_program_may_be_plainer(folder, arguments):
    if COMM.rank == 0:
        for name in ("stiffness", "mass"):
            write_hdf5(folder / "part.h5", arguments[name], name)
        with h5py.File(folder / "part.h5", "a") as file:
            file.attrs.update(format="fenics_ehd structure", format_version=2)
            file["coordinates"] = arguments["coordinates"]
            file["attachments/pin/nodes"] = [3, 5]
            file["attachments/pin/weights"] = [1, 3]
    COMM.barrier()
    part = load_structure(folder / "part.h5")
    assert not part.bores
    assert part.comm.allreduce(part.attachments["pin"][1].array.sum()) == pytest.approx(1)
    check_structure(part)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("coordinates", "coordinates"),
        ("bores/bore/nodes", "nodes"),
        ("bores/bore/load", "load"),
        ("mass/data", "data"),
    ],
)
def test_spoiled_files_are_named(folder, change, message):
    save_structure(ring(), folder / "part.h5")
    if COMM.rank == 0:
        with h5py.File(folder / "part.h5", "a") as file:
            del file[change]
        seal(folder / "part.h5", folder / "part.h5")
    COMM.barrier()
    with pytest.raises(ehd.errors.StructureError, match=message):
        load_structure(folder / "part.h5")


@pytest.mark.mpi
def test_file_that_cannot_be_written_is_named(folder):
    with pytest.raises(ehd.errors.StructureError, match=r"nowhere/part\.h5"):
        save_structure(ring(), folder / "nowhere" / "part.h5")
    with pytest.raises(ehd.errors.StructureError, match="name 'a/b': in a file, names of bores"):
        save_structure(ring(attachments={"a/b": [3]}), folder / "part.h5")


# Numbering of other programs


@settings(max_examples=25)
@given(st.integers(1, 5), st.integers(0, 6), st.integers(0, 2**32 - 1))
def test_reordering_undoes_a_permutation_and_holds_what_is_left_out(nodes, held, seed):
    random = np.random.default_rng(seed)
    size = 3 * nodes
    kept = np.sort(random.permutation(size)[: max(size - held, 1)])
    dofs = np.full(size, -1)
    dofs[kept] = random.permutation(len(kept))
    ours = random.standard_normal((size, size))
    reference = np.zeros((len(kept), len(kept)))
    reference[np.ix_(dofs[kept], dofs[kept])] = ours[np.ix_(kept, kept)]
    result = reorder(sparse.csr_matrix(reference), dofs.reshape(nodes, 3)).toarray()
    expected = np.diag(np.full(size, reference.diagonal().mean()))
    expected[np.ix_(kept, kept)] = ours[np.ix_(kept, kept)]
    np.testing.assert_allclose(result, expected)


@pytest.mark.parametrize(
    ("matrix", "dofs", "message"),
    [
        (sparse.eye(3, 4), [[0, 1, 2]], r"shape \(3, 4\) cannot be reordered"),
        (sparse.eye(3), [0, 1, 2], r"dofs have shape \(3,\)"),
        (sparse.eye(3), [[0.0, 1, 2]], "type float64"),
        (sparse.eye(3), [[0, 1, 3]], "each of the 3 row numbers once, but row 2 is"),
        (sparse.eye(3), [[0, -2, 1]], "each of the 3 row numbers once, but row -2 is"),
        (sparse.eye(3), [[0, 1, 1]], "each of the 3 row numbers once, but row 1 is"),
        (sparse.eye(4), [[0, 1, 2]], "each of the 4 row numbers once, but row 3 is"),
    ],
)
def test_dofs_that_do_not_fit_are_named(matrix, dofs, message):
    with pytest.raises(ehd.errors.StructureError, match=message):
        reorder(matrix, dofs)


# Mean motion


@settings(max_examples=50)
@given(st.integers(3, 12), st.booleans(), st.floats(-3, 3), st.integers(0, 2**32 - 1))
def test_mean_motion_of_a_rigid_motion_is_that_motion(nodes, lumped, exponent, seed):
    random = np.random.default_rng(seed)
    x = 10.0**exponent * random.standard_normal((nodes, 3))
    weights = random.uniform(0.5, 2, nodes)
    root = random.standard_normal((nodes, nodes)) * 0.1
    motion = mean_motion(x, weights if lumped else np.diag(weights) + root @ root.T)
    shift, turn = random.standard_normal(3), random.standard_normal(3)
    mean = np.einsum("ick,ic->k", motion, shift + np.cross(turn, x))
    np.testing.assert_allclose(mean, np.r_[shift, turn], atol=1e-6 * 10.0 ** max(-exponent, 0))
    # As forces: a unit force or moment about the origin and nothing else.
    forces = motion.sum(axis=0)
    moments = np.cross(x[:, :, None], motion, axis=1).sum(axis=0)
    scale = np.abs(x).max()
    np.testing.assert_allclose(forces, np.eye(6)[:3], atol=1e-7 * max(1, 1 / scale))
    np.testing.assert_allclose(moments, np.eye(6)[3:], atol=1e-7 * max(1, scale))


def test_nodes_on_a_line_have_no_mean_rotation():
    with pytest.raises(ehd.errors.StructureError, match="lie on one line"):
        mean_motion(np.outer(np.arange(4.0), [1, 2, 3]), np.ones(4))
