"""Reduced bodies for others: plain arrays; Exudyn, a demo, must move them right.

What needs Exudyn is skipped without it; it runs with ``pip install --no-deps --target DIR exudyn``
and DIR on PYTHONPATH.
"""

from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI
from scipy import sparse
from test_demos import demo

from fenics_ehd.base.errors import ExportError
from fenics_ehd.reduction import ResidualFlexibility, craig_bampton, load_dependent, rigid
from fenics_ehd.reduction.export import contents, export_npz
from fenics_ehd.reduction.mass import MassOperator
from fenics_ehd.reduction.projection import Basis, gram_matrices, project
from fenics_ehd.reduction.rigid_motion import rigid_fields
from fenics_ehd.scenes.elastic_part import elastic_part
from fenics_ehd.scenes.scene_file import read_scene

exudyn_body = demo("exudyn_body")

METHODS = ("m3", "m1")


@pytest.fixture(scope="module")
def mass(rod_structure):
    return MassOperator(rod_structure.mass)


@pytest.fixture(scope="module")
def bodies(rod_structure):
    kept = {"keep_basis": True, "estimate_error": False}
    return {
        "m3": load_dependent(rod_structure, 6, 31, **kept),
        "m1": craig_bampton(rod_structure, 37, **kept),
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
    bodies = read_scene("slider-crank-both-ends").bodies
    part = elastic_part(bodies["rod"], "rod", "lagrange", MPI.COMM_SELF).source
    body = load_dependent(part, 6, 8, estimate_error=False)
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
    for ours, theirs in (
        (mass, body.inertia.mass),
        (spin[2], body.inertia.spin),
        (centrifugal[2, 2], body.inertia.centrifugal),
    ):
        assert np.abs((ours[square] - theirs) / np.outer(size, size)).max() < 1e-12
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
    with pytest.raises(ExportError, match="M1, M2, M3"):
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


def test_the_frame_does_not_change_the_frequencies(exudyn, rod_structure, mass, bodies, tmp_path):
    body, bore = bodies["m3"], rod_structure.bore
    moved = np.einsum("ick,icn->kn", bore.reference, body.bore_basis)
    columns = body.columns - rigid_fields(rod_structure.coordinates) @ moved
    matrices = gram_matrices(rod_structure, mass, columns)
    basis = Basis(columns, *matrices, body.kinds, (), {})
    other = project(rod_structure, mass, basis, method="m3", frame="bore-centre")
    other = replace(other, columns=columns)
    path = exudyn_body.export(other, rod_structure, tmp_path / "c2.npz")
    expected = exudyn_body.free_frequencies(body)
    np.testing.assert_allclose(exudyn_body.frequencies(path)[6:], expected, rtol=1e-7)


def moving_body(exudyn, path, rates, **motion):
    """System with the body, its numbers, and modal coordinates and rates at the start."""
    container = exudyn.SystemContainer()
    mbs = container.AddSystem()
    ids = exudyn_body.add_body(mbs, path, **motion)
    for name, values in zip(("initialCoordinates", "initialCoordinates_t"), rates, strict=True):
        mbs.SetNodeParameter(ids["nGenericODE2"], name, list(values))
    mbs.Assemble()
    return container, mbs, ids


def part_motion(exudyn, mbs, ids, structure, body):
    """Rotation, Jacobian of angular velocity, nodal positions and velocities along fixed axes."""
    from exudyn.rigidBodyUtilities import EulerParameters2GLocal, EulerParameters2RotationMatrix

    kind = exudyn.OutputVariableType
    rigid, modal = ids["nRigidBody"], ids["nGenericODE2"]
    s = np.add(
        mbs.GetNodeOutput(rigid, kind.Coordinates),
        mbs.GetNodeParameter(rigid, "referenceCoordinates"),
    )
    v = np.array(mbs.GetNodeOutput(rigid, kind.Coordinates_t))
    q, q_rate = (
        np.array(mbs.GetNodeOutput(modal, k)) for k in (kind.Coordinates, kind.Coordinates_t)
    )
    turn, slope = EulerParameters2RotationMatrix(s[3:]), EulerParameters2GLocal(s[3:])
    local = structure.coordinates + (body.columns @ q).reshape(-1, 3)
    rate = np.cross(slope @ v[3:], local) + (body.columns @ q_rate).reshape(-1, 3)
    return turn, slope, s[:3] + local @ turn.T, v[:3] + rate @ turn.T, q


@pytest.mark.parametrize("method", METHODS)
def test_inertia_in_exudyn_is_that_of_every_node(
    exudyn, rod_structure, mass, bodies, files, method
):
    """Mass matrix and velocity forces of a strongly deformed, turning and vibrating part."""
    body, random = bodies[method], np.random.default_rng(1)
    size = np.abs(body.columns).max(axis=0)
    q, q_rate = (a * random.standard_normal(body.modes) / size for a in (1e-2, 3.0))
    axes = np.linalg.qr(random.standard_normal((3, 3)))[0]
    axes *= np.linalg.det(axes)
    omega = 300 * random.standard_normal(3)
    # The container must live as long as its system.
    _container, mbs, ids = moving_body(
        exudyn,
        files[method],
        (q, q_rate),
        positionRef=[0.1, 0.2, 0.3],
        rotationMatrixRef=axes,
        initialVelocity=[1, 2, 3],
        initialAngularVelocity=list(omega),
    )
    solver, options = exudyn.MainSolverImplicitSecondOrder(), exudyn.SimulationSettings()
    options.solution.file.write = False
    solver.InitializeSolver(mbs, options)
    solver.ComputeMassMatrix(mbs)
    n = 7 + body.modes
    found = np.array(solver.GetSystemMassMatrix())[:n, :n]
    solver.ComputeODE2RHS(mbs)
    forces = np.array(solver.GetSystemResidual())[:n]
    solver.FinalizeSolver(mbs, options)
    turn, slope, x, *_ = part_motion(exudyn, mbs, ids, rod_structure, body)
    np.testing.assert_allclose(turn, axes, atol=1e-12)
    p = (x - (0.1, 0.2, 0.3)) @ turn
    spun = -np.cross(p[:, :, None], np.eye(3), axis=1).reshape(-1, 3)
    jacobian = np.hstack([np.tile(turn.T, (len(p), 1)), spun @ slope, body.columns])
    expected = jacobian.T @ mass.multiply(jacobian)
    scale = np.sqrt(np.diag(expected))
    assert np.abs((found - expected) / np.outer(scale, scale)).max() < 1e-9
    w = turn.T @ omega
    relative = (body.columns @ q_rate).reshape(-1, 3)
    acceleration = np.cross(w, np.cross(w, p)) + 2 * np.cross(w, relative)
    velocity_forces = jacobian.T @ mass.multiply(acceleration.reshape(-1, 1))[:, 0]
    forces[7:] += body.stiffness @ q
    for part in (slice(0, 3), slice(3, 7), slice(7, None)):
        worst = np.abs(velocity_forces[part]).max()
        assert np.abs(forces[part] + velocity_forces[part]).max() < 1e-9 * worst


def solve(exudyn, mbs, end, steps):
    options = exudyn.SimulationSettings()
    options.timeIntegration.endTime = end
    options.timeIntegration.numberOfSteps = steps
    options.timeIntegration.verboseMode = 0
    options.timeIntegration.newton.relativeTolerance = 1e-10
    options.timeIntegration.generalizedAlpha.spectralRadius = 1.0
    options.solution.file.write = False
    mbs.SolveDynamic(options, updateInitialValues=True)


@pytest.mark.parametrize("method", METHODS)
def test_free_motion_conserves_energy_and_momentum(
    exudyn, rod_structure, mass, bodies, files, method
):
    body, drifts = bodies[method], []
    rate = np.where(np.arange(body.modes) < 3, 0.5, 0.0)
    for steps in (125, 250):
        _container, mbs, ids = moving_body(
            exudyn,
            files[method],
            (0 * rate, rate),
            initialVelocity=[1, 2, 3],
            initialAngularVelocity=[50, -80, 500],
        )
        figures = []
        for end in (None, 1e-3):
            if end:
                solve(exudyn, mbs, end, steps)
            _, _, x, v, q = part_motion(exudyn, mbs, ids, rod_structure, body)
            # M is the same in every position: it commutes with the rotation.
            momentum = mass.multiply(v.reshape(-1, 1)).reshape(-1, 3)
            energy = 0.5 * np.sum(v * momentum) + 0.5 * q @ body.stiffness @ q
            figures.append([energy, momentum.sum(axis=0), np.cross(x, momentum).sum(axis=0)])
        drifts.append(
            [np.abs(b - a).max() / np.abs(a).max() for a, b in zip(*figures, strict=True)]
        )
    coarse, fine = np.array(drifts)
    assert fine.max() < 2e-5
    assert (coarse / fine).min() > 2.5


@pytest.mark.parametrize("method", METHODS)
def test_free_fall_neither_turns_nor_bends(exudyn, bodies, files, method):
    rest = np.zeros((2, bodies[method].modes))
    gravity = np.array([0.5, -9.81, 1.0])
    _container, mbs, ids = moving_body(exudyn, files[method], rest, gravity=list(gravity))
    solve(exudyn, mbs, 1e-2, 50)
    kind = exudyn.OutputVariableType.Coordinates
    rigid = mbs.GetNodeOutput(ids["nRigidBody"], kind)
    np.testing.assert_allclose(rigid[:3], gravity * 0.5e-4, rtol=1e-9)
    np.testing.assert_allclose(rigid[3:], 0.0, atol=1e-12)
    assert np.abs(mbs.GetNodeOutput(ids["nGenericODE2"], kind)).max() < 1e-15


def test_force_at_a_boundary_point_bends_the_part(exudyn, bodies, files):
    """Frame held: the pin yields by its flexibility, through Exudyn's marker on its mesh node."""
    item = pytest.importorskip("exudyn.itemInterface")

    body, rest = bodies["m1"], np.zeros((2, bodies["m1"].modes))
    _container, mbs, ids = moving_body(exudyn, files["m1"], rest)
    pin = mbs.AddMarker(
        item.MarkerSuperElementPosition(
            bodyNumber=ids["oFFRFreducedOrder"],
            meshNodeNumbers=[len(body.bore_nodes)],
            weightingFactors=[1.0],
        )
    )
    ground = mbs.AddMarker(item.MarkerBodyRigid(bodyNumber=mbs.AddObject(item.ObjectGround())))
    node = mbs.AddMarker(item.MarkerNodeRigid(nodeNumber=ids["nRigidBody"]))
    mbs.AddObject(item.GenericJoint(markerNumbers=[ground, node]))
    force = np.array([0.0, 800.0, 0.0])
    mbs.AddLoad(item.Force(markerNumber=pin, loadVector=list(force)))
    mbs.Assemble()
    kind = exudyn.OutputVariableType.Position
    before = np.array(mbs.GetMarkerOutput(pin, kind))
    options = exudyn.SimulationSettings()
    options.solution.file.write = False
    mbs.SolveStatic(options, updateInitialValues=True)
    row = body.points["pin"]
    np.testing.assert_allclose(before, row[:, 0], atol=1e-12)
    expected = row[:, 3:] @ np.linalg.solve(body.stiffness, row[:, 3:].T @ force)
    found = np.array(mbs.GetMarkerOutput(pin, kind)) - before
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
