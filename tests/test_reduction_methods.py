"""M1 to M4 and the full interface against the dense `oracle_reduction.py`, and pushed to limits.

The rod is as coarse as its model allows. Its nodes are numbered along the rod: of three ranks
the last one owns no node of the bore.
"""

import gc
import weakref
from dataclasses import fields, is_dataclass, replace
from functools import cache

import numpy as np
import oracle_reduction as oracle
import pytest
from foreign_parts import ring_matrices, ring_mesh, to_scipy
from hypothesis import given, settings
from hypothesis import strategies as st
from mpi4py import MPI
from petsc4py import PETSc
from scene_cases import structure as structure_of
from scipy import linalg, sparse
from snapshot_cases import WAYS, reduce_by

import fenics_ehd as ehd
from fenics_ehd.reduction import PRESSURE_SETS, eigenmodes
from fenics_ehd.reduction import matrices as distributed
from fenics_ehd.reduction import reductor as loads
from fenics_ehd.reduction import static as linear_solver
from fenics_ehd.reduction.eigenmodes import lowest_modes
from fenics_ehd.reduction.fixed_interface_modes import two_step_craig_bampton
from fenics_ehd.reduction.load_dependent_basis import ranked
from fenics_ehd.reduction.pressure_family import PressureFamily
from fenics_ehd.reduction.reductor import rigid
from fenics_ehd.reduction.static import LinearSolver, StaticSolver

pytestmark = pytest.mark.kernels

WORLD = MPI.COMM_WORLD

COARSE = {
    "bore_cells_around": 10,
    "bore_cells_along": 1,
    "big_end_layers": 1,
    "shank_cells": 2,
    "small_end_layers": 1,
}

#: Relative to the largest entry.
TOLERANCE = 1e-8

#: Sine of the angle between spans, of columns that are nearly dependent.
ANGLE = 1e-7


def rod_on(comm, geometry=None, **rod):
    """A rod meshed and assembled by the ranks of a communicator."""
    sizes = {f"geometry.{name}": value for name, value in {**COARSE, **(geometry or {})}.items()}
    changes = {f"bodies.rod.{name}": value for name, value in {**sizes, **rod}.items()}
    return structure_of("slider-crank-paper", "rod", comm, changes)


def dense_part(structure):
    """What the oracle needs of a structure on one rank."""
    bore = structure.bore
    mean = np.zeros((structure.size // 3, 3, 6))
    mean[bore.nodes] = bore.reference
    points = {
        name: np.column_stack([v.array for v in three])
        for name, three in structure.attachments.items()
    }
    return oracle.Part(
        to_scipy(structure.stiffness).toarray(),
        to_scipy(structure.mass).toarray(),
        structure.coordinates,
        to_scipy(bore.load).toarray(),
        bore.nodes,
        mean.reshape(-1, 6),
        points,
        bore.pressure_coordinates,
    )


@cache
def rod():
    """The rod as a structure on this rank alone."""
    return rod_on(MPI.COMM_SELF)


@cache
def shared_rod(cells_along):
    """The rod meshed and assembled by all ranks together."""
    return rod_on(WORLD, {"bore_cells_along": cells_along})


@cache
def part(name):
    """The rod by its name in `PARTS`, dense."""
    given = dense_part(rod())
    x, y, _ = given.nodes.T
    order = np.lexsort((y, x))
    free = oracle.renumbered(given, order)
    if name == "free":
        return free
    if name == "without points":
        return replace(free, points={})
    if name == "heavy tail":  # a mass that resists along z alone, as no element makes one
        mass = free.mass.copy()
        mass[-1, -1] += 0.2
        return replace(free, mass=mass)
    away_from_pin = np.abs(np.hypot(x[order] - 0.16, y[order]) - 0.012) > 1e-4
    clamped = oracle.renumbered(replace(free, points={}), np.flatnonzero(away_from_pin))
    if name == "clamped":
        return clamped
    assert name == "clamped with a point"
    tip = np.flatnonzero(clamped.nodes[:, 0] < -0.033)
    return replace(clamped, points={"tip": oracle.mean_of(tip, len(clamped.nodes))})


PARTS = ("free", "without points", "heavy tail", "clamped", "clamped with a point")


def as_structure(dense_rod, comm=WORLD, **changes):
    """The dense part as the package takes it, shared by the ranks; `changes` of its bore."""
    bore = {
        "nodes": dense_rod.bore.astype(np.int32),
        "coordinates": dense_rod.nodes[dense_rod.bore],
        "pressure_coordinates": dense_rod.pressure_nodes,
        "load": sparse.csr_matrix(dense_rod.load),
        "reference": dense_rod.mean.reshape(-1, 3, 6)[dense_rod.bore],
    }
    bore = replace(rod().bore, **{**bore, **changes})
    return ehd.Structure(
        sparse.csr_matrix(dense_rod.stiffness),
        sparse.csr_matrix(dense_rod.mass),
        dense_rod.nodes,
        bore,
        {name: sparse.csr_matrix(columns) for name, columns in dense_rod.points.items()},
        comm=comm,
    )


@cache
def structure(name):
    return as_structure(part(name))


@cache
def snapshots(rank=7, count=20):
    """Smooth pressures of a given rank, (k, count) [Pa]."""
    x, y, z = part("free").pressure_nodes.T
    turn = np.arange(rank)[:, None] * np.arctan2(y, x) + np.arange(rank)[:, None] ** 2
    shapes = (1 + np.cos(turn)) * (1 - (np.arange(rank)[:, None] % 3) * (60 * z) ** 2)
    return 1e6 * shapes.T @ np.random.default_rng(5).standard_normal((rank, count))


N_V = 4


def missing(reduced):
    """What a body lacks: nothing that is known pressure by pressure, of an M4."""
    if reduced.residual is None:
        return reduced.missing_flexibility
    return np.zeros_like(reduced.basis_flexibility())


def measured(structure):
    """Reductor of a structure whose missing flexibility is computed for every nodal pressure."""
    return ehd.Reductor(structure, every_pressure=True)


def m3(pressure_set, selection, counts=range(6, 15), directions=(0, 1)):
    """M3 both ways, with as many residual modes as leave no doubt which they are."""

    def pressures(dense_rod):
        given = not isinstance(pressure_set, str)
        return pressure_set if given else oracle.pressure_set(dense_rod, pressure_set)

    def count(dense_rod):
        return oracle.clear_count(dense_rod, N_V, pressures(dense_rod), selection, counts)

    return (
        lambda s, p: reduce_by(
            ehd.Reductor(s, attachment_directions=directions, every_pressure=True),
            N_V,
            count(p),
            pressure_set,
            selection,
            keep_basis=True,
        ),
        lambda p: (
            oracle.load_dependent(p, N_V, count(p), pressures(p), selection, directions),
            None,
        ),
    )


def other_methods(directions=(0, 1)):
    """The package's body and the oracle's basis, with the residual responses of M4."""
    common = {"keep_basis": True}

    def reductor(s):
        return ehd.Reductor(s, attachment_directions=directions, every_pressure=True)

    return {
        "m1": (
            lambda s, p: ehd.craig_bampton(reductor(s), 12, **common),
            lambda p: (oracle.craig_bampton(p, 12, directions), None),
        ),
        "m2": (
            lambda s, p: two_step_craig_bampton(reductor(s), 12, 6, **common),
            lambda p: (oracle.two_step(p, 12, 6, directions), None),
        ),
        "m2 no interior modes": (
            lambda s, p: two_step_craig_bampton(reductor(s), 12, 0, **common),
            lambda p: (oracle.two_step(p, 12, 0, directions), None),
        ),
        "full": (
            lambda s, p: ehd.full_interface(reductor(s), N_V, **common),
            lambda p: (oracle.full_interface(p, N_V, directions), None),
        ),
        "m4": (
            lambda s, p: ehd.residual_flexibility(reductor(s), N_V, tolerance=0.0, **common),
            lambda p: oracle.residual_flexibility(p, N_V, directions),
        ),
        "m4 no vibration modes": (
            lambda s, p: ehd.residual_flexibility(reductor(s), 0, tolerance=0.0, **common),
            lambda p: oracle.residual_flexibility(p, 0, directions),
        ),
        "m4 not centrifugal": (
            lambda s, p: ehd.residual_flexibility(
                reductor(s), 2, tolerance=0.0, centrifugal=False, **common
            ),
            lambda p: oracle.residual_flexibility(p, 2, directions, centrifugal=False),
        ),
    }


METHODS = other_methods() | {
    "m3 no residual modes": (
        lambda s, p: ehd.load_dependent(measured(s), N_V, 0, keep_basis=True),
        lambda p: (oracle.load_dependent(p, N_V, 0, np.eye(60), "every-column"), None),
    ),
    "m3 no vibration modes": (
        lambda s, p: ehd.load_dependent(
            measured(s), 0, 12, selection="largest-eigenvalue", keep_basis=True
        ),
        lambda p: (
            oracle.load_dependent(p, 0, 12, oracle.pressure_set(p, "pc2"), "largest-eigenvalue"),
            None,
        ),
    ),
}
for _set in ("pc1", "pc2"):
    for _selection in WAYS:
        # The proper orthogonal decomposition of the identity is any other.
        if (_set, _selection) != ("pc1", "proper-orthogonal"):
            METHODS[f"m3 {_set} {_selection}"] = m3(_set, _selection)
# Of two clusters of 20 equal singular values: none but a whole one is defined.
METHODS["m3 pc2 proper-orthogonal"] = m3("pc2", "proper-orthogonal", (20,))
for _set in ("pc2-long", "pc2-short"):
    METHODS[f"m3 {_set}"] = m3(_set, "largest-eigenvalue")
for _selection in ("proper-orthogonal", "largest-eigenvalue", "lowest-frequency"):
    METHODS[f"m3 snapshots {_selection}"] = m3(snapshots(), _selection, range(2, 6))
for _directions in ((), (0, 1, 2)):
    for _name, _ways in other_methods(_directions).items():
        if " " not in _name:
            METHODS[f"{_name} {_directions}"] = _ways
    METHODS[f"m3 {_directions}"] = m3("pc2", "lowest-frequency", directions=_directions)

FEW = ("m1", "m2", "m4", "full", "m3 pc2 lowest-frequency", "m3 pc1 largest-eigenvalue")
CASES = [("free", method) for method in METHODS]
CASES += [(name, method) for name in PARTS[1:] for method in FEW]


@cache
def body(name, method):
    return METHODS[method][0](structure(name), part(name))


@cache
def reference(name, method):
    """Basis of the oracle, (N, n), and bore rows of the responses M4 adds, (3 m, k)."""
    basis, residual = METHODS[method][1](part(name))
    bore = part(name).bore_dofs
    return basis, np.zeros((len(bore), 60)) if residual is None else residual[bore]


def every_rank(columns):
    """Rows of all ranks."""
    return np.vstack(WORLD.allgather(columns))


def defect(ours, by_oracle, scale=None):
    """Largest difference relative to the largest entry."""
    assert ours.shape == by_oracle.shape
    return np.abs(ours - by_oracle).max() / np.abs(by_oracle if scale is None else scale).max()


def followed(reduced):
    """Bore displacement (3 m, k) to pressures in balance."""
    return reduced.bore_flexibility().reshape(-1, reduced.load_projection.shape[1])


def elastic_frequencies(reduced):
    """Angular frequencies of the reduced part with its rigid motions, ascending."""
    mass = reduced.mass
    if reduced.frame != "clamped":
        coupling = reduced.rigid_coupling
        mass = mass - coupling.T @ np.linalg.solve(reduced.rigid_mass, coupling)
    return 1.0 / np.sqrt(linalg.eigvalsh(mass, reduced.stiffness)[::-1])


@pytest.mark.mpi
@pytest.mark.parametrize(("name", "method"), CASES)
def test_reduction_agrees(name, method):
    """Flexibility, what is missing of it, frequencies, span and reduced matrices."""
    dense_rod, ours = part(name), body(name, method)
    basis, residual = reference(name, method)
    by_oracle = oracle.basis_flexibility(dense_rod, basis) + residual
    assert ours.modes == basis.shape[1]
    assert defect(followed(ours), by_oracle) < TOLERANCE
    assert defect(ours.basis_flexibility(), dense_rod.outward(by_oracle)) < TOLERANCE
    whole = dense_rod.full_flexibility
    lacking = dense_rod.outward(whole - by_oracle)
    assert defect(missing(ours), lacking, dense_rod.outward(whole)) < TOLERANCE
    if ours.residual is not None:
        assert ours.flexibility_error < TOLERANCE
    expected = oracle.pencil(dense_rod, basis)
    np.testing.assert_allclose(elastic_frequencies(ours), expected, rtol=TOLERANCE)
    columns = every_rank(ours.columns)
    spans = (a / linalg.norm(a, axis=0) for a in (columns, basis))
    assert linalg.subspace_angles(*spans).max() < ANGLE
    for matrix, reduced in ((dense_rod.stiffness, ours.stiffness), (dense_rod.mass, ours.mass)):
        product = columns.T @ matrix @ columns
        sizes = np.sqrt(np.diag(product))
        assert np.abs((reduced - product) / np.outer(sizes, sizes)).max() < TOLERANCE
    np.testing.assert_allclose(
        ours.bore_basis.reshape(-1, ours.modes), columns[dense_rod.bore_dofs], rtol=0, atol=1e-14
    )
    inside = ours.frequencies * 2 * np.pi
    np.testing.assert_allclose(inside**2, np.diag(ours.stiffness) / np.diag(ours.mass), rtol=1e-12)


@pytest.mark.mpi
@pytest.mark.parametrize(("name", "method"), CASES)
def test_inertia_integrals_agree(name, method):
    """Contracted with the answer to each pressure, so that no basis shows."""
    dense_rod, ours = part(name), body(name, method)
    basis = reference(name, method)[0]
    moved = np.hstack([dense_rod.nodes.reshape(-1, 1), dense_rod.motions[:, :2]])
    answers = basis @ oracle.coordinates(dense_rod, basis, dense_rod.load)
    both = np.hstack([moved, answers])
    mine = np.linalg.solve(ours.stiffness, ours.load_projection[3:])
    weights = linalg.block_diag(np.eye(3), mine)
    spun = oracle.spun(both)
    pairs = {
        "mass": (ours.inertia.mass, both, both),
        "spin": (ours.inertia.spin, both, spun),
        "centrifugal": (ours.inertia.centrifugal, spun, spun),
    }
    for what, (found, left, right) in pairs.items():
        wanted = left.T @ dense_rod.mass @ right
        # Positions and translations are of 1, answers of 1e-15: each entry by its own size.
        sizes = [np.sqrt(np.einsum("ij,ij->j", a, dense_rod.mass @ a)) for a in (both, both)]
        sizes = np.outer(*(np.maximum(s, 1e-3 * s[3:].max()) for s in sizes))
        assert np.abs((weights.T @ found @ weights - wanted) / sizes).max() < TOLERANCE, what
    for found, wanted in (
        (ours.load_projection, both.T @ dense_rod.load),
        (ours.spin_load_projection, spun.T @ dense_rod.load),
    ):
        found = weights.T @ found
        assert defect(found[:3], wanted[:3]) < TOLERANCE
        assert defect(found[3:], wanted[3:]) < TOLERANCE
    motions = dense_rod.motions
    assert defect(ours.rigid_mass, motions.T @ dense_rod.mass @ motions) < TOLERANCE
    assert defect(ours.rigid_load, motions.T @ dense_rod.load) < TOLERANCE
    scale = np.sqrt(np.diag(ours.rigid_mass))[:, None]
    by_oracle = motions.T @ dense_rod.mass @ answers / scale
    size = np.sqrt(np.einsum("ij,ij->j", answers, dense_rod.mass @ answers).max())
    assert np.abs(ours.rigid_coupling @ mine / scale - by_oracle).max() < TOLERANCE * size
    for point, columns in dense_rod.points.items():
        found = ours.points[point] @ weights
        assert defect(found[:, :3], columns.T @ moved) < TOLERANCE
        largest = np.abs(answers).max()
        assert np.abs(found[:, 3:] - columns.T @ answers).max() < TOLERANCE * largest


@pytest.mark.mpi
@pytest.mark.parametrize(("name", "method"), [case for case in CASES if case[1] == "m4"])
def test_residual_factors_are_those_of_the_remaining_responses(name, method):
    dense_rod, residual = part(name), body(name, method).residual
    responses = METHODS[method][1](dense_rod)[1]
    found = residual.displacement.reshape(-1, residual.rank) @ residual.patterns
    assert defect(found, responses[dense_rod.bore_dofs]) < TOLERANCE
    energy = dense_rod.load.T @ responses
    ours = residual.patterns.T @ (residual.stiffness[:, None] * residual.patterns)
    assert defect(ours, energy) < TOLERANCE
    inertia = responses.T @ dense_rod.mass @ responses
    assert defect(residual.patterns.T @ residual.mass @ residual.patterns, inertia) < TOLERANCE
    gram = residual.patterns @ residual.patterns.T
    np.testing.assert_allclose(gram, np.eye(residual.rank), atol=1e-12)


def test_a_family_of_pressures_gives_its_nystroem_approximation():
    """From the dense residual flexibility; its verified error is that of the dense matrices."""
    dense_rod = part("free")
    ours = ehd.residual_flexibility(structure("free"), N_V, tolerance=0.5)
    family = PressureFamily(structure("free").bores)
    pressures = family.base
    assert ours.residual.rank == pressures.shape[1] == 21
    basis, responses = oracle.residual_flexibility(dense_rod, N_V)
    energy = dense_rod.load.T @ responses
    core = np.linalg.inv(pressures.T @ energy @ pressures)
    moved = responses[dense_rod.bore_dofs] @ pressures
    expected = moved @ core @ (energy @ pressures).T
    found = ours.residual.displacement.reshape(-1, ours.residual.rank) @ ours.residual.patterns
    assert defect(found, expected) < TOLERANCE
    verification = family.verification()
    exact = responses[dense_rod.bore_dofs]
    errors = dense_rod.outward((exact - expected) @ verification)
    whole = dense_rod.outward((oracle.basis_flexibility(dense_rod, basis) + exact) @ verification)
    error = (np.abs(errors).max(axis=0) / np.abs(whole).max(axis=0)).max()
    assert ours.flexibility_error == pytest.approx(error, rel=1e-6)


@pytest.mark.mpi
@pytest.mark.parametrize("method", FEW)
def test_rank_count_does_not_change_the_flexibility(method):
    """Meshed and assembled in parallel as well, where the nodes have other numbers."""
    alone, together = (METHODS[method][0](s, part("free")) for s in (rod(), shared_rod(1)))
    assert defect(followed(together), followed(alone)) < TOLERANCE
    whole = missing(alone) + alone.basis_flexibility()
    assert defect(missing(together), missing(alone), whole) < TOLERANCE
    np.testing.assert_allclose(
        elastic_frequencies(together), elastic_frequencies(alone), rtol=TOLERANCE
    )


# --- M2 -------------------------------------------------------------------------------------


@pytest.mark.mpi
@pytest.mark.parametrize("method", ["m1", "m2", "m2 no interior modes"])
@pytest.mark.parametrize("name", ["free", "clamped with a point"])
def test_stiffness_of_fixed_boundary_methods_is_block_diagonal(name, method):
    dense_rod, ours = part(name), body(name, method)
    columns = every_rank(ours.columns)
    stiffness = columns.T @ dense_rod.stiffness @ columns
    sizes = np.sqrt(np.diag(stiffness))
    assert ours.kinds == ("fixed-boundary",) * 12 + ("constraint",) * 2
    assert np.abs(stiffness / np.outer(sizes, sizes))[:12, 12:].max() < TOLERANCE
    moved = dense_rod.boundary().T @ columns
    np.testing.assert_allclose(moved, np.eye(14)[12:], atol=1e-10)
    assert np.abs(dense_rod.centre.T @ columns[:, 12:]).max(initial=0.0) < 1e-8
    # A second step that is complete: a displacement of A deforms the bore as in one.
    assert defect(columns[:, 12:], every_rank(body(name, "m1").columns)[:, 12:]) < TOLERANCE


# --- M3: pressure sets and selections --------------------------------------------------------


def missed(reduced, pressures):
    """Largest outward displacement that pressures miss, relative to the largest there is."""
    whole = (reduced.basis_flexibility() + reduced.missing_flexibility) @ pressures
    return np.abs(reduced.missing_flexibility @ pressures).max() / np.abs(whole).max()


@pytest.mark.parametrize(
    ("asked", "kept"), [(1, 20), (14, 20), (20, 20), (21, 40), (40, 40)], ids=str
)
def test_equal_singular_values_are_kept_whole(asked, kept):
    """For any basis of their space that the linear algebra library finds."""
    pressures = PRESSURE_SETS["pc2"](structure("free").bore)
    turned = pressures @ np.linalg.qr(np.random.default_rng(0).standard_normal((40, 40)))[0]
    ours, other = (
        reduce_by(structure("free"), N_V, asked, columns, "proper-orthogonal")
        for columns in (pressures, turned)
    )
    for found in (ours, other):
        assert found.accuracy["static_requested"] == 2 + kept
        assert found.modes == N_V + found.accuracy["static_rank"] >= N_V + 2 + kept - 1
    assert defect(followed(other), followed(ours)) < TOLERANCE


@settings(max_examples=12)
@given(
    rank=st.integers(1, 6),
    spread=st.floats(0.0, 3.0),
    scale=st.sampled_from([1e-6, 1.0, 1e9]),
    selection=st.sampled_from(WAYS),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_snapshots_of_low_rank_are_followed_exactly(rank, spread, scale, selection, seed):
    random = np.random.default_rng(seed)
    shapes = random.standard_normal((60, rank)) * 10.0 ** -np.linspace(0.0, spread, rank)
    pressures = scale * shapes @ random.standard_normal((rank, rank + 3))
    ours = reduce_by(structure("free"), 1, rank, pressures, selection)
    assert missed(ours, pressures) < 1e-7
    assert ours.modes == 1 + 2 + rank


def test_pressures_that_push_no_node_make_no_mode():
    """J of 9-node pressures on 8-node displacements has null vectors; round-off decides here."""
    for name in ("without points", "clamped"):
        for selection in ("smallest-eigenvalue", "largest-eigenvalue"):
            for n_vibration in (0, 1, N_V):
                ours = ehd.load_dependent(
                    structure(name), n_vibration, 60, "pc1", selection, estimate_error=False
                )
                assert ours.modes == n_vibration + 59


def test_positions_around_the_bore_survive_the_scatter_of_a_mesh():
    """A nanometre, of the 22 that the check of the bore allows."""
    exact = part("free").pressure_nodes
    scatter = np.random.default_rng(0).uniform(-1e-9, 1e-9, exact.shape)
    bore = replace(rod().bore, pressure_coordinates=exact + scatter)
    assert PRESSURE_SETS["pc2"](bore).shape == (60, 2 * 20)


def test_a_bore_whose_middle_is_not_at_z_0_is_refused():
    """Its parabolas of (35) would be pressures far below zero."""
    up = np.array([0.0, 0.0, 0.5])
    raised = part("free")
    raised = replace(raised, nodes=raised.nodes + up, pressure_nodes=raised.pressure_nodes + up)
    with pytest.raises(ehd.errors.StructureError):
        ehd.load_dependent(as_structure(raised, reference=None), N_V, 6, "pc2-short")


# --- modes -----------------------------------------------------------------------------------


@cache
def block(cells=(6, 2, 2), size=(0.1, 0.03, 0.02)):
    """Free block of 8-node hexahedra centred at the origin, and its frequencies by scipy."""
    counts = np.array(cells) + 1
    grid = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3)
    nodes = (grid / cells - 0.5) * size
    strides = np.array([counts[1] * counts[2], counts[2], 1])
    corner = np.array([(a, b, c) for c in (0, 1) for b in (0, 1) for a in (0, 1)])
    first = grid[np.all(grid < cells, axis=1)]
    stiffness, mass = ring_matrices(nodes, (first[:, None] + corner) @ strides)
    values = linalg.eigh(stiffness.toarray(), mass.toarray(), eigvals_only=True)
    return ehd.Structure(stiffness, mass, nodes), np.sqrt(values[6:])


@pytest.mark.mpi
@pytest.mark.parametrize("left_out", [0, 2, 4])
def test_a_mode_that_the_eigensolver_leaves_out_is_found_or_missed_aloud(left_out, monkeypatch):
    bar, angular = block()
    solve = eigenmodes._solve

    def forgetful(flexibility, count, *arguments):
        if count == 1:
            return solve(flexibility, count, *arguments)
        values, modes = solve(flexibility, count + 1, *arguments)
        return np.delete(values, left_out), np.delete(modes, left_out, axis=1)

    monkeypatch.setattr(eigenmodes, "_solve", forgetful)
    if left_out:
        np.testing.assert_allclose(lowest_modes(StaticSolver(bar), 5)[0], angular[:5], rtol=1e-9)
        return
    # The lowest, time and again.
    with pytest.raises(ehd.errors.VerificationError, match=r"misses modes: .* Hz was still"):
        lowest_modes(StaticSolver(bar), 5)


@pytest.mark.mpi
@pytest.mark.parametrize("ratio", [1e-3, 1e-5, 1e-7])
def test_modes_of_nearly_the_same_frequency_are_all_found(ratio):
    """Bending in either direction of a nearly square bar."""
    bar, angular = block(size=(0.1, 0.02 * (1 + ratio), 0.02))
    assert 0 < angular[1] / angular[0] - 1 < 2 * ratio
    for count in (1, 2, 3, 6, 9):
        found, modes = lowest_modes(StaticSolver(bar), count)
        np.testing.assert_allclose(found, angular[:count], rtol=1e-9)
        assert modes.shape[1] == count


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("around", "along", "counts"),
    # Of the last two a frequency of the next pair lies 0.2 and 0.5 % above the last one.
    [(12, 2, range(1, 30)), (24, 3, (27,)), (8, 4, (20,))],
)
def test_modes_of_the_same_frequency_are_all_found(around, along, counts):
    """A ring vibrates in pairs."""
    nodes, cells, _ = ring_mesh(around, along, 1)
    stiffness, mass = ring_matrices(nodes, cells)
    angular = np.sqrt(linalg.eigvalsh(stiffness.toarray(), mass.toarray())[6:])
    static = StaticSolver(ehd.Structure(stiffness, mass, nodes))
    for count in counts:
        np.testing.assert_allclose(lowest_modes(static, count)[0], angular[:count], rtol=1e-9)


@pytest.mark.mpi
def test_numbers_of_modes_have_limits():
    free, size = structure("free"), part("free").size
    quarter = rf"{size // 4 + 1} modes: must be between 0 and {size // 4}, a quarter"
    for refused in (
        lambda: ehd.craig_bampton(free, size // 4 + 1),
        lambda: two_step_craig_bampton(free, 5, size // 4 + 1),
        lambda: ehd.load_dependent(free, size // 4 + 1, 5),
        lambda: ehd.full_interface(free, size // 4 + 1),
        lambda: ehd.residual_flexibility(free, size // 4 + 1),
    ):
        with pytest.raises(ehd.errors.SettingsError, match=quarter):
            refused()
    with pytest.raises(ehd.errors.SettingsError, match="modes 0: at least 1"):
        ehd.craig_bampton(free, 0)
    with pytest.raises(ehd.errors.SettingsError, match="modes 0 is not between 1 and 145"):
        two_step_craig_bampton(free, 0, 1)
    with pytest.raises(ehd.errors.SettingsError, match="modes 146 is not between 1 and 145"):
        two_step_craig_bampton(free, 146, 1)
    with pytest.raises(ehd.errors.SettingsError, match="-1 modes: must be between 0 and"):
        two_step_craig_bampton(free, 5, -1)
    with pytest.raises(ehd.errors.SettingsError, match="are both 0"):
        ehd.load_dependent(free, 0, 0)
    with pytest.raises(ehd.errors.SettingsError, match="-1 modes: must be between 0 and"):
        ehd.residual_flexibility(free, -1)
    with pytest.raises(ehd.errors.SettingsError, match="at least one mode"):
        ehd.residual_flexibility(structure("without points"), 0, centrifugal=False)
    assert len(lowest_modes(StaticSolver(free), 0)[0]) == 0


@pytest.mark.parametrize("count", [1, 40, 180])
def test_any_allowed_number_of_modes_is_found(count):
    """To a quarter of the degrees of freedom, 180 of 723."""
    dense_rod = part("free")
    found = lowest_modes(StaticSolver(structure("free")), count)[0]
    np.testing.assert_allclose(found, dense_rod.spectrum[0][:count], rtol=1e-8)


# --- parts that are none, and other solvers ---------------------------------------------------

REDUCTIONS = {
    "m1": lambda s, **options: ehd.craig_bampton(s, 5, **options),
    "m2": lambda s, **options: two_step_craig_bampton(s, 5, 3, **options),
    "m3": lambda s, **options: ehd.load_dependent(s, 4, 6, **options),
    "m4": lambda s, **options: ehd.residual_flexibility(s, 4, tolerance=0.0, **options),
    "full": lambda s, **options: ehd.full_interface(s, 4, **options),
}


def enlarged(dense_rod, stiffness, mass, nodes):
    """The part with more nodes, K grown by a matrix of all of them or of the new ones alone."""
    more = 3 * len(nodes)

    def grown(columns):
        return np.vstack([columns, np.zeros((more, columns.shape[1]))])

    if len(stiffness) == more:
        stiffness = linalg.block_diag(np.zeros_like(dense_rod.stiffness), stiffness)
    return replace(
        dense_rod,
        stiffness=linalg.block_diag(dense_rod.stiffness, np.zeros((more, more))) + stiffness,
        mass=linalg.block_diag(dense_rod.mass, mass),
        nodes=np.vstack([dense_rod.nodes, nodes]),
        load=grown(dense_rod.load),
        mean=grown(dense_rod.mean),
        points={name: grown(columns) for name, columns in dense_rod.points.items()},
    )


def with_loose_piece(dense_rod):
    nodes, cells, _ = ring_mesh(6, 1, 1)
    matrices = [matrix.toarray() for matrix in ring_matrices(nodes, cells)]
    return enlarged(dense_rod, *matrices, nodes + np.array([0.1, 0.1, 0.0]))


def with_node_of_no_stiffness(dense_rod):
    return enlarged(dense_rod, np.zeros((3, 3)), 1e-3 * np.eye(3), [[0.1, 0.1, 0.0]])


def with_a_negative_eigenvalue(dense_rod):
    """A random elastic motion that sets energy free."""
    motion = np.random.default_rng(0).standard_normal((dense_rod.size, 1))
    motion -= dense_rod.motions @ np.linalg.lstsq(dense_rod.motions, motion, rcond=None)[0]
    energy = (motion.T @ dense_rod.stiffness @ motion).item()
    force = dense_rod.stiffness @ motion
    return replace(dense_rod, stiffness=dense_rod.stiffness - 2 / energy * force @ force.T)


@pytest.mark.mpi
@pytest.mark.parametrize("method", REDUCTIONS)
@pytest.mark.parametrize(
    ("change", "names", "named"),
    [
        (with_loose_piece, ("free", "clamped"), "motions other than the rigid ones|loose"),
        (
            with_node_of_no_stiffness,
            ("free",),
            "stiffness has the diagonal entry 0 at node 241, comp",
        ),
        (with_a_negative_eigenvalue, ("free", "clamped"), "1 negative pivots: it is not positive"),
    ],
)
def test_what_is_no_part_is_named(change, names, named, method):
    kinds = (ehd.errors.SolverError, ehd.errors.VerificationError, ehd.errors.StructureError)
    for name in names:
        broken = as_structure(change(part(name)))
        with pytest.raises(kinds, match=named):
            REDUCTIONS[method](broken)


@pytest.mark.mpi
def test_an_iteration_on_an_indefinite_stiffness_is_named():
    indefinite = as_structure(with_a_negative_eigenvalue(part("free")))
    with pytest.raises(ehd.errors.SolverError, match=r"no convergence in .* iterations"):
        ehd.load_dependent(ehd.Reductor(indefinite, solver="iterative"), 4, 6)


@pytest.mark.mpi
def test_factors_on_disk_give_the_body_of_those_in_memory(monkeypatch, tmp_path):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    written = []
    solve = LinearSolver.solve

    def observed(solver, loads):
        written.append(sum(path.stat().st_size for path in tmp_path.iterdir()))
        return solve(solver, loads)

    monkeypatch.setattr(LinearSolver, "solve", observed)
    body = ehd.load_dependent(as_structure(part("free")), 4, 6)
    assert max(written) == 0
    monkeypatch.setattr(linear_solver, "IN_CORE_LIMIT", 100)
    other = ehd.load_dependent(as_structure(part("free")), 4, 6)
    assert max(written) > 0
    assert other.frequencies == pytest.approx(body.frequencies, rel=1e-9)
    flexibility = body.basis_flexibility()
    assert other.basis_flexibility() == pytest.approx(flexibility, abs=1e-10 * flexibility.max())


@pytest.mark.mpi
def test_a_load_whose_iteration_ends_early_is_found_among_those_that_converge():
    structure = as_structure(part("clamped"))
    rows = structure.stiffness.local_size[0]
    first = structure.stiffness.getOwnershipRange()[0]
    loads = np.zeros((rows, 2), order="F")
    loads[:, 0] = np.cos(np.arange(first, first + rows))
    options = PETSc.Options("few_")
    options["ksp_max_it"] = 3
    try:
        solver = LinearSolver(
            structure.stiffness.copy(),
            direct=False,
            near_kernel=np.zeros((rows, 0)),
            kernel=False,
            options_prefix="few_",
        )
    finally:
        options.delValue("ksp_max_it")
    # The last column, of zeros, converges at once.
    with pytest.raises(ehd.errors.SolverError, match="no convergence in 3 iterations"):
        solver.solve(loads)


@pytest.mark.mpi
def test_an_unknown_solver_is_named():
    with pytest.raises(ehd.errors.SettingsError, match="'magic' is not one of auto, direct"):
        ehd.craig_bampton(ehd.Reductor(structure("free"), solver="magic"), 5)


#: Few solves: an iteration for each of them takes long on so small a part.
ITERATED = {
    "m1": lambda s, **options: ehd.craig_bampton(s, 2, **options),
    "m2": lambda s, **options: two_step_craig_bampton(s, 2, 1, **options),
    "m3": lambda s, **options: ehd.load_dependent(s, 1, 2, snapshots()[:, :3], **options),
    "m4": lambda s, **options: ehd.residual_flexibility(s, 0, tolerance=0.0, **options),
}


@pytest.mark.parametrize(
    ("name", "method"),
    [
        ("free", "m1"),
        pytest.param("free", "m2", marks=pytest.mark.slow),
        ("free", "m3"),
        ("clamped with a point", "m4"),
    ],
)
def test_iterative_solver_finds_what_the_direct_one_does(name, method):
    """Of a structure of its own, so that nothing is left in it of another solver."""
    exact, found = (
        ITERATED[method](
            ehd.Reductor(as_structure(part(name)), solver=solver), estimate_error=False
        )
        for solver in ("direct", "iterative")
    )
    assert defect(followed(found), followed(exact)) < 1e-7
    np.testing.assert_allclose(elastic_frequencies(found), elastic_frequencies(exact), rtol=1e-7)


@pytest.mark.mpi
def test_a_structure_can_be_reduced_again_after_an_iterative_solver():
    given_one = as_structure(part("free"))
    iterative = ehd.Reductor(given_one, solver="iterative")
    ehd.load_dependent(iterative, 0, 1, snapshots()[:, :1], estimate_error=False)
    again = ehd.craig_bampton(given_one, 5)
    assert defect(followed(again), followed(ehd.craig_bampton(structure("free"), 5))) < TOLERANCE


# --- many reductions of one part --------------------------------------------------------------

#: In an order in which little of what one computes is what the next one needs.
IN_TURN = {
    "rigid": lambda s, **options: rigid(s, estimate_error=True, **options),
    **REDUCTIONS,
    "m1 with more": lambda s, **options: ehd.craig_bampton(s, 9, **options),
    "m1 with fewer": lambda s, **options: ehd.craig_bampton(s, 3, **options),
    "m2 with more": lambda s, **options: two_step_craig_bampton(s, 9, 3, **options),
    "m3 pc1": lambda s, **options: ehd.load_dependent(
        s, 4, 9, "pc1", "largest-eigenvalue", **options
    ),
    "m3 again": lambda s, **options: ehd.load_dependent(s, 4, 3, "pc1", **options),
    "m3 snapshots": lambda s, **options: ehd.load_dependent(s, 2, 5, snapshots(), **options),
    "m4 truncated": lambda s, **options: ehd.residual_flexibility(s, 4, tolerance=0.05, **options),
    "full with fewer": lambda s, **options: ehd.full_interface(s, 2, **options),
}


def counted(monkeypatch, kind, name):
    """Calls of a method from here on, a list that grows."""
    calls, original = [], getattr(kind, name)

    def count(self, *arguments, **options):
        calls.append(arguments)
        return original(self, *arguments, **options)

    monkeypatch.setattr(kind, name, count)
    return calls


@pytest.mark.mpi
@pytest.mark.parametrize("name", ["free", "clamped with a point"])
def test_bodies_of_one_reductor_are_those_of_a_structure_each(name):
    shared = ehd.Reductor(structure(name))
    for method, reduce_it in IN_TURN.items():
        ours, alone = reduce_it(shared), reduce_it(structure(name))
        assert (ours.method, ours.frame, ours.kinds) == (alone.method, alone.frame, alone.kinds)
        assert ours.accuracy.keys() == alone.accuracy.keys()
        kept = ([r.participation for r in b.inventory if not r.dropped] for b in (ours, alone))
        np.testing.assert_allclose(*kept, rtol=1e-6, atol=1e-9, err_msg=method)
        assert len(ours.inventory) == len(alone.inventory), method
        if method != "rigid":
            assert defect(followed(ours), followed(alone)) < TOLERANCE, method
            frequencies = elastic_frequencies(ours), elastic_frequencies(alone)
            np.testing.assert_allclose(*frequencies, rtol=1e-7, err_msg=method)
        scale = alone.basis_flexibility() + missing(alone)
        assert defect(missing(ours), missing(alone), scale) < TOLERANCE, method
        if alone.residual is not None:
            masses = ours.residual.mass, alone.residual.mass
            np.testing.assert_allclose(*map(np.trace, masses), rtol=1e-7)


@pytest.mark.mpi
def test_a_reductor_factorises_once_and_its_interior_once_and_solves_for_nothing_twice(monkeypatch):
    made = counted(monkeypatch, LinearSolver, "__init__")
    shared = ehd.Reductor(structure("free"))
    rigid(shared)
    assert len(made) == 0
    two_step_craig_bampton(shared, 5, 3, estimate_error=False)
    assert len(made) == 1
    ehd.craig_bampton(shared, 9)
    ehd.load_dependent(shared, 4, 9, "pc1")
    ehd.residual_flexibility(shared, 4)
    assert len(made) == 2
    solves = counted(monkeypatch, LinearSolver, "solve")
    ehd.craig_bampton(shared, 5)
    ehd.load_dependent(shared, 4, 3, "pc1", "largest-eigenvalue")
    ehd.residual_flexibility(shared, 4, tolerance=0.05, estimate_error=False)
    assert not solves
    ehd.load_dependent(shared, 4, 3, "pc2")
    assert solves
    assert len(made) == 2


def test_a_reductor_keeps_the_responses_to_one_pressure_set(monkeypatch):
    kept = weakref.WeakSet()
    original = loads.StaticResponses.__init__

    def remember(store, *arguments):
        kept.add(store)
        original(store, *arguments)

    monkeypatch.setattr(loads.StaticResponses, "__init__", remember)
    shared = ehd.Reductor(structure("free"))
    for pressure_set in ("pc1", "pc2", snapshots()):
        ehd.load_dependent(shared, 4, 6, pressure_set)
        ehd.residual_flexibility(shared, 4)
        gc.collect()
        assert len(kept) == 1
    del shared
    gc.collect()
    assert not kept


def reversed_axes(item, name):
    """Names of the arrays of a body, or of what it holds, with a negative stride."""
    if is_dataclass(item):
        values = {f.name: getattr(item, f.name) for f in fields(item)}
    elif isinstance(item, dict):
        values = item
    else:
        negative = isinstance(item, np.ndarray) and min(item.strides, default=0) < 0
        return [name] if negative else []
    found = []
    for key, value in values.items():
        found += reversed_axes(value, f"{name}.{key}")
    return found


@pytest.mark.parametrize("method", REDUCTIONS)
def test_no_array_of_a_body_is_a_reversed_view(method):
    """NumPy multiplies such views without BLAS."""
    body = REDUCTIONS[method](structure("free"), keep_basis=True)
    assert not reversed_axes(body, method)


@pytest.mark.parametrize("selection", ehd.reduction.SELECTIONS)
def test_no_combination_of_candidates_is_a_reversed_view(selection):
    grown = np.arange(1.0, 7.0) + np.ones((6, 6)) * 0.1
    stiffness = grown @ grown.T + np.eye(6)
    combinations = ranked(selection, stiffness, np.diag(np.arange(1.0, 7.0)))
    assert min(combinations.strides) > 0


@pytest.mark.mpi
def test_modes_are_found_with_a_ninth_of_the_entries_of_an_isotropic_mass(monkeypatch):
    """What SLEPc multiplies with: the matrix of the nodes, whose products are those of M."""
    part_of_ranks = shared_rod(1)
    mass = distributed.MassOperator(part_of_ranks.mass)
    context = mass.matrix.getPythonContext()
    entries = [m.getInfo(info=PETSc.Mat.InfoType.GLOBAL_SUM) for m in (context.nodal, mass._mass)]
    assert 9 * entries[0]["nz_used"] == entries[1]["nz_used"]
    x, product = part_of_ranks.mass.createVecs()
    x.array = np.sin(np.arange(*x.getOwnershipRange()))
    other = product.duplicate()
    part_of_ranks.mass.mult(x, product)
    mass.matrix.mult(x, other)
    other.axpy(-1.0, product)
    assert other.norm() < 1e-13 * product.norm()
    applied = counted(monkeypatch, distributed.NodalProduct, "mult")
    lowest_modes(StaticSolver(part_of_ranks, mass=mass), 3)
    assert len(applied) > 3


def test_another_mass_for_each_direction_is_multiplied_as_it_is():
    matrix = distributed.as_matrix(sparse.diags([1.0, 2.0, 3.0, 1.0, 2.0, 3.0]), MPI.COMM_SELF)
    assert distributed.MassOperator(matrix).matrix == matrix


# --- units, shapes and shares -----------------------------------------------------------------


@pytest.mark.parametrize("method", REDUCTIONS)
@pytest.mark.parametrize(
    ("length", "mass", "stiffness"),
    [
        pytest.param(1e3, 1e-3, 1e-3, id="millimetres and tonnes"),
        pytest.param(1.0, 1.0, 1e-6, id="soft"),
        pytest.param(1.0, 1.0, 1e6, id="stiff"),
        pytest.param(1.0, 1e6, 1.0, id="heavy", marks=pytest.mark.slow),
        pytest.param(1e-2, 1e-6, 1e-2, id="small"),
        pytest.param(1e2, 1e6, 1e2, id="large", marks=pytest.mark.slow),
    ],
)
def test_units_and_scale_do_not_matter(method, length, mass, stiffness):
    base = body_of("free", method)
    scaled = as_structure(
        oracle.in_other_units(part("free"), length, mass, stiffness),
        radius=length * rod().bore.radius,
        width=length * rod().bore.width,
    )
    ours = REDUCTIONS[method](scaled)
    assert ours.modes == base.modes
    factor = length**2 / stiffness
    assert defect(followed(ours) / factor, followed(base)) < TOLERANCE
    whole = missing(base) + base.basis_flexibility()
    assert defect(missing(ours) / factor, missing(base), whole) < TOLERANCE
    np.testing.assert_allclose(
        elastic_frequencies(ours) * (mass / stiffness) ** 0.5, elastic_frequencies(base), rtol=1e-7
    )


@cache
def body_of(name, method):
    return REDUCTIONS[method](structure(name))


@pytest.mark.parametrize(
    "geometry",
    [
        {"rod_length": 0.4},
        pytest.param({"cells": "tet"}, marks=pytest.mark.slow),
        pytest.param({"bore_width": 0.06}, marks=pytest.mark.slow),
        pytest.param({"bore_width": 0.008}, marks=pytest.mark.slow),
        pytest.param({"big_end_wall": 0.005, "small_end_wall": 0.003}, marks=pytest.mark.slow),
        pytest.param(
            {"bore_radius": 0.01, "pin_radius": 0.005, "shank_width_big": 0.01},
            marks=pytest.mark.slow,
        ),
    ],
    ids=lambda geometry: " ".join(f"{name} {size}" for name, size in geometry.items()),
)
def test_extreme_shapes_agree_as_well(geometry):
    """Changed numbers of the model, and cells of another kind."""
    cells = geometry.get("cells", "hex")
    sizes = {name: size for name, size in geometry.items() if name != "cells"}
    given_one = rod_on(MPI.COMM_SELF, sizes, cells=cells)
    dense_rod = dense_part(given_one)
    for method in FEW:
        if cells == "tet" and method == "m3 pc2 lowest-frequency":
            continue  # its oracle has no hats
        # M4 by as many patterns as stand out of the round-off of the whole rod's bending.
        tolerance = 1e-7 if method == "m4" and cells == "hex" else TOLERANCE
        ours = METHODS[method][0](given_one, dense_rod)
        basis, residual = METHODS[method][1](dense_rod)
        by_oracle = oracle.basis_flexibility(dense_rod, basis)
        if residual is not None:
            by_oracle = by_oracle + residual[dense_rod.bore_dofs]
        assert defect(followed(ours), by_oracle) < tolerance
        found = elastic_frequencies(ours)
        np.testing.assert_allclose(found, oracle.pencil(dense_rod, basis), rtol=tolerance)


def share_out(dense_rod, counts):
    """The part as PETSc matrices with so many nodes on each rank."""
    own = counts[WORLD.rank]
    first = sum(counts[: WORLD.rank])
    rows = slice(3 * first, 3 * (first + own))

    def matrix(columns, local):
        part_of_it = sparse.csr_matrix(columns[rows])
        csr = (part_of_it.indptr.astype(np.int32), part_of_it.indices, part_of_it.data)
        sizes = ((3 * own, dense_rod.size), (local, columns.shape[1]))
        return PETSc.Mat().createAIJ(sizes, csr=csr, comm=WORLD)

    stiffness = matrix(dense_rod.stiffness, 3 * own)
    vectors = {}
    for name, columns in dense_rod.points.items():
        vectors[name] = tuple(stiffness.createVecLeft() for _ in range(3))
        for vector, column in zip(vectors[name], columns.T, strict=True):
            vector.array = column[rows]
    bore = replace(
        as_structure(dense_rod, MPI.COMM_SELF).bore,
        # The pressures belong to the last rank.
        load=matrix(dense_rod.load, 60 if WORLD.rank == WORLD.size - 1 else 0),
    )
    nodes = dense_rod.nodes[first : first + own]
    return ehd.Structure(stiffness, matrix(dense_rod.mass, 3 * own), nodes, bore, vectors)


@pytest.mark.mpi
@pytest.mark.skipif(WORLD.size == 1, reason="one rank owns everything")
@pytest.mark.parametrize("method", FEW)
@pytest.mark.parametrize("owner", [0, -1])
def test_ranks_may_own_nothing_or_next_to_nothing(owner, method):
    nodes = len(part("free").nodes)
    for others in (0, 1):
        counts = [others] * WORLD.size
        counts[owner] = nodes - others * (WORLD.size - 1)
        ours = METHODS[method][0](share_out(part("free"), counts), part("free"))
        assert defect(followed(ours), followed(body("free", method))) < TOLERANCE


# --- memory -----------------------------------------------------------------------------------


def arrays(value):
    """Every array in a body."""
    if isinstance(value, np.ndarray):
        yield value
    elif is_dataclass(value):
        for f in fields(value):
            yield from arrays(getattr(value, f.name))
    elif isinstance(value, dict):
        for item in value.values():
            yield from arrays(item)


@pytest.mark.mpi
@pytest.mark.parametrize("method", REDUCTIONS)
def test_a_body_holds_nothing_of_the_size_of_the_part(method):
    given_one = structure("free")
    ours = REDUCTIONS[method](given_one)
    assert isinstance(ours, ehd.ReducedBody)
    assert ours.columns is None
    part_size = {given_one.size, given_one.size // 3, *given_one.stiffness.local_size}
    for array in arrays(ours):
        assert not part_size & set(array.shape)


@pytest.mark.mpi
@pytest.mark.parametrize("method", [*REDUCTIONS, "m3 pc1"])
def test_blocks_stay_narrow_and_change_nothing(method, monkeypatch):
    """No dense block of all pressures or all bore dofs, and each rank has its own rows alone."""
    reduce_it = REDUCTIONS.get(method, lambda s, **options: ehd.load_dependent(s, 4, 6, "pc1"))
    given_one = structure("free")
    usual = reduce_it(given_one)
    widths = []
    solve, dense_matrix = linear_solver.LinearSolver.solve, distributed.dense_matrix

    def watched_solve(self, columns):
        widths.append(columns.shape)
        return solve(self, columns)

    def watched_matrix(columns, comm):
        widths.append(columns.shape)
        return dense_matrix(columns, comm)

    monkeypatch.setattr(linear_solver.LinearSolver, "solve", watched_solve)
    for module in (linear_solver, distributed):
        monkeypatch.setattr(module, "dense_matrix", watched_matrix)
    monkeypatch.setattr(distributed, "BLOCK_COLUMNS", 9)
    monkeypatch.setattr(linear_solver, "KEPT_COLUMNS", 0)
    narrow = reduce_it(given_one)
    rows = {3 * len(given_one.coordinates), 60 if WORLD.size == 1 else None}
    rows |= {given_one.bore.load.local_size[1], len(given_one.coordinates)}
    tall = [shape for shape in widths if shape[0] == 3 * len(given_one.coordinates)]
    assert len(tall) > 10
    # The basis, with the position and two translations at the most.
    assert max(width for _, width in tall) <= max(9, narrow.modes + 3)
    assert defect(followed(narrow), followed(usual)) < TOLERANCE
    whole = missing(usual) + usual.basis_flexibility()
    assert defect(missing(narrow), missing(usual), whole) < TOLERANCE
    np.testing.assert_allclose(elastic_frequencies(narrow), elastic_frequencies(usual), rtol=1e-8)


@pytest.mark.mpi
@pytest.mark.parametrize("method", REDUCTIONS)
def test_ranks_share_the_basis(method):
    shared = shared_rod(2)
    columns = REDUCTIONS[method](shared, keep_basis=True).columns
    rows = WORLD.allgather(len(columns))
    assert sum(rows) == shared.size
    if WORLD.size > 1:
        assert max(rows) < {2: 0.6, 3: 0.45}.get(WORLD.size, 1.0) * shared.size
