"""Checks of a part's matrices: every error by its name, on every rank."""

from dataclasses import replace

import numpy as np
import pytest
from foreign_parts import ring, ring_arguments
from hypothesis import given, settings
from hypothesis import strategies as st
from mpi4py import MPI
from petsc4py import PETSc
from scipy import sparse

import fenics_ehd as ehd
from fenics_ehd.reduction.structure import check_structure

ARGUMENTS = ring_arguments()
K, M, BORE = ARGUMENTS["stiffness"], ARGUMENTS["mass"], ARGUMENTS["bores"]
SIZE = K.shape[0]


def entry(matrix, row, column, value):
    changed = matrix.tolil()
    changed[row, column] = value
    return changed.tocsr()


def emptied(matrix, row):
    keep = sparse.diags((np.arange(SIZE) != row).astype(float))
    return (keep @ matrix @ keep).tocsr()


def hidden(matrix, row, value):
    """The matrix with the eigenvalue `value`, times its diagonal, along a vector near a row."""
    vector = np.zeros(SIZE)
    vector[[row, row + 3, row + 6]] = 2, 1, -1
    vector = vector[:, None] / np.linalg.norm(vector)
    others = np.eye(SIZE) - vector @ vector.T
    size = value * matrix.diagonal().mean()
    return sparse.csr_matrix(others @ matrix.toarray() @ others + size * vector @ vector.T)


def held(rows):
    """K with springs to the ground."""
    return (K + sparse.diags(np.isin(np.arange(SIZE), rows) * K.diagonal().mean())).tocsr()


def by_component(matrix):
    """All of x, then y, then z."""
    rows = np.arange(SIZE).reshape(-1, 3).T.ravel()
    return matrix[rows][:, rows]


def in_unit(scale):
    """Nodes, bore and J in another unit of length, K and M as they are."""
    return {
        "coordinates": scale * ARGUMENTS["coordinates"],
        "bores": replace(
            BORE,
            radius=scale * BORE.radius,
            width=scale * BORE.width,
            coordinates=scale * BORE.coordinates,
            pressure_coordinates=scale * BORE.coordinates,
            load=scale**2 * BORE.load,
            reference=BORE.reference / np.r_[1, 1, 1, [scale] * 3],
        ),
    }


def bore(**changes):
    return {"bores": replace(BORE, **changes)}


def shifted(array, row, by):
    changed = np.array(array)
    changed[row] += by
    return changed


POINT = ARGUMENTS["attachments"]["right"]
X = ARGUMENTS["coordinates"]
OFF_BORE = int(np.setdiff1d(np.arange(len(X)), BORE.nodes)[0])

CASES = {
    # name: changed arguments of the ring, message
    "mass shape": ({"mass": sparse.eye(SIZE, SIZE + 3)}, r"mass has shape \(216, 219\), not"),
    "J columns": (bore(load=BORE.load[:, 1:]), "bore.load has 35 columns, but there are 36 pre"),
    "K nan": ({"stiffness": entry(K, 5, 5, np.nan)}, "stiffness has a value that is not finite"),
    "M inf": ({"mass": entry(M, 5, 8, np.inf)}, "mass has a value that is not finite"),
    "J nan": (bore(load=entry(BORE.load, 1, 1, np.nan)), "bore.load has a value that is not"),
    "x nan": (
        {"coordinates": shifted(X, 50, [0, np.nan, 0])},
        "the coordinates of node 50 are not finite",
    ),
    "K unsymmetric": (
        {"stiffness": entry(K, 5, 8, 1.001 * K[5, 8])},
        r"stiffness is not symmetric: relative defect .*e-0., limit 1e-09; both triangles",
    ),
    "M triangle": ({"mass": sparse.triu(M)}, r"mass is not symmetric: relative defect .*e"),
    "K empty row": (
        {"stiffness": emptied(K, 3 * 60 + 1)},
        "stiffness has the diagonal entry 0 at node 60, component y, which must be positive",
    ),
    "K diagonal": (
        {"stiffness": entry(K, 8, 8, -2.0)},
        "stiffness has the diagonal entry -2 at node 2, component z",
    ),
    "M empty row": ({"mass": emptied(M, 200)}, "mass has the diagonal entry 0 at node 66, comp"),
    "M diagonal": ({"mass": entry(M, 3, 3, 0.0)}, "mass has the diagonal entry 0 at node 1, comp"),
    "M singular": (
        {"mass": hidden(M, 99, 0.0)},
        "mass is singular or not positive definite: .*, limit 1e-08; .* node 33, component x",
    ),
    "M indefinite": ({"mass": hidden(M, 9, -0.1)}, "mass is singular or not positive definite: "),
    "K indefinite": (
        {"stiffness": K - 1e-5 * sparse.diags(K.diagonal())},
        "not positive semidefinite: .* has a relative energy of -1.0e-05, limit -1e-09",
    ),
    "some rigid": (
        {"stiffness": held(np.arange(2, SIZE, 3))},
        r"3 of 6 rigid motions .*\(translation along x, translation along y, rotation about z\)",
    ),
    "wrong order": (
        {"coordinates": X[::-1] + 0.01 * X**2},
        "3 of 6 rigid .* not in the same order of",
    ),
    "by component": (
        {"stiffness": by_component(K), "mass": by_component(M)},
        "the degrees of freedom are numbered component by .* must be numbered node by node",
    ),
    "by component, held": (
        {"stiffness": by_component(held(np.arange(24))), "mass": by_component(M)},
        "the degrees of freedom are numbered component by component",
    ),
    "millimetres": (
        in_unit(1000.0),
        r"a mass of 0.283 kg in a box of 60 x 60 x 24 m, 3e-06 kg/m3, .* give coordinates in m",
    ),
    "millimetres, held": ({**in_unit(1000.0), "stiffness": held(range(60))}, "coordinates in m"),
    "one node held": ({"stiffness": held([21, 22, 23])}, "a combination of rigid motions stores"),
    "no coordinates": ({"coordinates": 0 * X}, "all nodes lie at the origin or on one axis"),
    "bore radius": (bore(radius=-1.0), "bore.radius -1 m or width 0.024 m is not above 0"),
    "bore off": (
        {"coordinates": 1.00001 * X, **bore(coordinates=1.00001 * BORE.coordinates)},
        r"bore.coordinates: node \d+ lies 2\.0e-07 m off the cylinder of radius 0\.02 m .* 1e-06",
    ),
    "pressure off": (
        bore(pressure_coordinates=shifted(BORE.coordinates, 4, 1e-3)),
        "bore.pressure_coordinates: node 4 lies .* m off the cylinder",
    ),
    "bore range": (
        bore(nodes=shifted(BORE.nodes, 7, 100)),
        "bore.nodes are 0 to 1.., .* to 71",
    ),
    "bore floats": (bore(nodes=BORE.nodes + 0.0), "bore.nodes are 0.0 to .* must be whole"),
    "bore twice": (
        bore(nodes=shifted(BORE.nodes, 7, BORE.nodes[8] - BORE.nodes[7])),
        f"bore.nodes: node {BORE.nodes[8]} of the part lies",
    ),
    "bore shape": (
        bore(coordinates=BORE.coordinates[:, 1:]),
        r"bore.coordinates has shape \(36, 2\)",
    ),
    "bore nan": (bore(coordinates=np.nan * BORE.coordinates), "bore.coordinates has a value tha"),
    "bore cells": (bore(cells=BORE.cells[12:]), "bore.cells must use each of the 36 nodes"),
    "bore family": (
        bore(family="lagrange"),
        r"bore.cells have shape \(24, 4\), but lagrange needs \(number of faces, 9\)",
    ),
    "no family": (bore(pressure_family=""), "bore.pressure_cells: element '' is not one of"),
    "numbers from 1": (
        bore(nodes=BORE.nodes + 1),
        r"bore.nodes: node \d+ of the part lies .* do the node numbers begin at 0",
    ),
    "J inward": (bore(load=-BORE.load), "pushes the bore outward with -0.9.* times the force"),
    "J units": (bore(load=1e6 * BORE.load), "bore.load: .* with 9.* units must agree"),
    "J elsewhere": (
        bore(load=entry(BORE.load, 3 * OFF_BORE, 0, 1e-6)),
        "bore.load has forces on nodes that are not in bore.nodes",
    ),
    "reference": (
        bore(reference=1.01 * BORE.reference),
        "bore.reference: the mean motion of a rigidly moved bore has .* of 1.0e-02, limit 1e-08",
    ),
    "reference shape": (bore(reference=BORE.reference[:, :2]), "bore.reference has shape"),
    "duplicate": (
        {"attachments": {"pin": POINT, "foot": [1], "bolt": POINT}},
        "attachments 'pin' and 'bolt' are the same point",
    ),
}


@pytest.mark.mpi
@pytest.mark.parametrize("case", CASES)
def test_every_defect_is_named(case):
    changes, message = CASES[case]
    with pytest.raises(ehd.errors.StructureError, match=message) as caught:
        check_structure(ring(**changes))
    assert "\n" not in str(caught.value)


@pytest.mark.mpi
def test_parts_without_defects_pass(rod_structure):
    check_structure(ring())
    check_structure(ring(bores={}, attachments={}))
    check_structure(ring(stiffness=held([21, 22, 23, 63, 64, 65, 200])))
    check_structure(ring(mass=sparse.diags(np.asarray(M.sum(axis=1)).ravel())))
    check_structure(rod_structure)


@settings(max_examples=20)
@given(st.floats(-9, 9), st.floats(0, 9), st.floats(-3, 3))
def test_units_do_not_matter(stiffness, density, length):
    """But for densities that no part has in any usual ones."""
    mass = density + 3 * length
    check_structure(
        ring(stiffness=10.0**stiffness * K, mass=10.0**mass * M, **in_unit(10.0**length))
    )


@settings(max_examples=20)
@given(st.integers(0, SIZE // 3 - 3), st.integers(0, 2), st.sampled_from([0.0, -0.05, 1e-12]))
def test_hidden_null_vectors_of_the_mass_are_found(node, component, value):
    part = ring(mass=hidden(M, 3 * node + component, value), comm=MPI.COMM_SELF)
    with pytest.raises(ehd.errors.StructureError, match=r"mass .* largest at node \d+, component"):
        check_structure(part)


def petsc(matrix):
    matrix = sparse.csr_matrix(matrix)
    csr = (matrix.indptr, matrix.indices, matrix.data)
    return PETSc.Mat().createAIJ(matrix.shape, csr=csr, comm=PETSc.COMM_SELF)


def vector(size):
    return PETSc.Vec().createMPI(size, comm=PETSc.COMM_SELF)


def test_sizes_of_petsc_matrices_that_do_not_fit_are_named():
    part = ring(comm=MPI.COMM_SELF)
    with pytest.raises(ehd.errors.StructureError, match="stiffness has 217 rows, not 3 for every"):
        ring(stiffness=petsc(sparse.eye(217)))
    for changes, message in (
        ({"stiffness": petsc(sparse.eye(216, 219))}, r"stiffness has shape \(216, 219\)"),
        ({"mass": petsc(sparse.eye(213))}, "mass has 213 rows, but the stiffness matrix has 216"),
        (
            {"bores": replace(part.bore, load=petsc(BORE.load[3:]))},
            "bore.load has 213 rows, but the stiffness matrix has 216",
        ),
        ({"attachments": {"pin": (vector(213),) * 3}}, "attachment 'pin' has 213 rows, .* 216"),
    ):
        bare = {"bores": {}, "attachments": {}, **changes}
        with pytest.raises(ehd.errors.StructureError, match=message):
            check_structure(replace(part, **bare))


def test_weights_of_load_vectors_are_checked():
    part = ring(comm=MPI.COMM_SELF)
    x, y, z = part.attachments["left"]
    for vectors, message in (
        ((x, y, 0.5 * z), "'pin': a unit translation along z moves it by 0.5 along z, not 1: "),
        ((x, y + 0.1 * x, z), "'pin': a unit translation along x moves it by 0.1 along y, not 0: "),
        ((x, y, np.nan * z), "'pin': a unit translation along . moves it by nan along"),
    ):
        with pytest.raises(ehd.errors.StructureError, match=message):
            check_structure(replace(part, attachments={"pin": vectors}))


@pytest.mark.mpi
def test_rows_that_split_a_node_are_named():
    comm = MPI.COMM_WORLD
    if comm.size != 2:
        pytest.skip("two ranks have a boundary in the middle of a node")
    rows = 100 if comm.rank == 0 else SIZE - 100
    first = 0 if comm.rank == 0 else 100
    own = K[first : first + rows]
    matrix = PETSc.Mat().createAIJ(
        ((rows, SIZE), (rows, SIZE)), csr=(own.indptr, own.indices, own.data), comm=comm
    )
    nodes = len(X) // 2
    mine = X[:nodes] if comm.rank == 0 else X[nodes:]
    with pytest.raises(ehd.errors.StructureError, match=r"rank owns \d+ rows, not 3 for every"):
        ring(stiffness=matrix, mass=matrix, coordinates=mine)


def test_checks_cost_less_than_forty_products(rod_structure):
    PETSc.Log.begin()
    # The sweeps of the mass check are part of its products.
    events = ("MatMult", "MatMultTranspose", "MatMatMultNum")

    def operations():
        return sum(PETSc.Log.Event(name).getPerfInfo()["flops"] for name in events)

    before = operations()
    check_structure(rod_structure)
    product = 2 * rod_structure.stiffness.getInfo()["nz_used"]
    assert 10 < (operations() - before) / product < 40
