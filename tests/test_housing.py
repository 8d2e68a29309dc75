"""The housing: its mesh, its clamped foot, its reduction, and the rotor in it."""

import json
import subprocess
import sys
import tomllib

import numpy as np
import pytest
from mpi4py import MPI
from scipy import sparse
from scipy.sparse.linalg import eigsh

from fenics_ehd.commands.rotor import read_settings
from fenics_ehd.errors import MeshError
from fenics_ehd.geometry import build_mesh
from fenics_ehd.models import model_path
from fenics_ehd.multibody.energy import ENERGY_LIMIT
from fenics_ehd.output import read_history
from fenics_ehd.reduction import save_body
from fenics_ehd.reduction.checks import check_structure
from fenics_ehd.reduction.rigid_body import rigid_body_modes
from fenics_ehd.scenes.housing import build_structure, origin, reduce_housing, reduce_structure
from fenics_ehd.scenes.rotor_run import simulate
from fenics_ehd.scenes.rotor_settings import Housing, Reduction, RotorSettings, Shaft, Time
from fenics_ehd.scenes.transient import Totals
from fenics_ehd.settings import build, to_toml

HEIGHT, THICKNESS, FOOT = 0.060, 0.022, 0.104
COMMAND = [sys.executable, "-m", "fenics_ehd.cli"]

#: Six modes of the held housing, nothing else.
LOWEST = Reduction(method="m1", modes=6, estimate_error=False)

#: Two layers along, one through the ring: for what does not depend on the mesh.
COARSE = {"bore_cells_around": 10, "bore_cells_along": 2, "ring_layers": 1, "web_layers": 2}


def housing_settings(geometry=None, **reduction):
    return RotorSettings(housing=Housing(geometry=geometry or {}), reduction=Reduction(**reduction))


@pytest.fixture(scope="module")
def structure(housing_structure):
    return housing_structure


@pytest.fixture(scope="module")
def coarse():
    return build_structure(housing_settings(COARSE), MPI.COMM_SELF)


@pytest.fixture(scope="module")
def whole(coarse):
    """The coarse housing with its full interface."""
    return reduce_structure(coarse, Reduction(method="full", vibration_modes=4))


def as_scipy(matrix):
    return sparse.csr_matrix(matrix.getValuesCSR()[::-1], shape=matrix.size)


def held_dofs(part):
    """Degrees of freedom on the sole."""
    nodes = np.flatnonzero(np.abs(part.coordinates[:, 1] + HEIGHT) < 1e-9)
    return (3 * nodes[:, None] + np.arange(3)).ravel()


def profile_area():
    """Of the default profile: ring, web and foot."""
    inner, outer = 0.0225, 0.0325
    angle = 0.3 * 2 * np.pi
    top, bottom = 2 * outer * np.sin(angle / 2), 0.080
    height = HEIGHT - 0.012 - outer * np.cos(angle / 2)
    segment = outer**2 / 2 * (angle - np.sin(angle))
    ring = np.pi * (outer**2 - inner**2)
    return ring + 0.5 * (top + bottom) * height - segment + FOOT * 0.012


def test_default_housing_has_the_papers_degrees_of_freedom(structure):
    assert structure.size == 8931
    bore = structure.lubricated_bore
    assert len(bore.nodes) == 340
    assert (bore.radius, bore.width) == pytest.approx((0.0225, THICKNESS))
    # A cell boundary at angle zero, where the film mesh starts.
    angle = np.arctan2(*bore.coordinates[bore.cells[:, :4]].transpose(2, 0, 1)[1::-1])
    assert np.any(np.abs(angle) < 1e-7)


def test_foot_is_held_and_the_mass_is_kept(structure):
    check_structure(structure)
    assert rigid_body_modes(structure).shape[1] == 0
    held = held_dofs(structure)
    assert len(held) == 3 * ((2 * 8 + 1) * (2 * 5 + 1) - 8 * 5)
    stiffness, mass = as_scipy(structure.stiffness), as_scipy(structure.mass)
    for matrix in (stiffness, mass):
        coupled = matrix[held].tocoo()
        off = coupled.col != held[coupled.row]
        assert not coupled.data[off].any()
        assert np.all(coupled.data[~off] > 0)
    # 20 quadratic cells around miss 1e-5 of the circle.
    along = np.tile([1.0, 0.0, 0.0], structure.size // 3)
    expected = 7850 * THICKNESS * profile_area()
    assert along @ mass @ along == pytest.approx(expected, rel=2e-5)


def test_held_modes_are_those_of_the_free_block_of_the_matrices(coarse, figure):
    body = reduce_structure(coarse, LOWEST)
    keep = np.setdiff1d(np.arange(coarse.size), held_dofs(coarse))
    stiffness, mass = (as_scipy(m)[keep][:, keep] for m in (coarse.stiffness, coarse.mass))
    values = eigsh(stiffness.tocsc(), 6, mass.tocsc(), sigma=0.0, return_eigenvectors=False)
    expected = np.sqrt(np.sort(values)) / (2 * np.pi)
    error = np.abs(body.frequencies / expected - 1).max()
    figure(
        "part and reduction",
        "held housing, SciPy on the free block of the matrices",
        error,
        most=1e-8,
    )
    assert body.frame == "clamped"


@pytest.mark.slow
def test_frequencies_converge_from_above():
    found = []
    for n in (1, 2, 3):
        geometry = {
            "bore_cells_around": 10 * n, "bore_cells_along": 2 * n, "ring_layers": n,
            "web_layers": 2 * n, "foot_layers": n, "foot_cells": n,
        }  # fmt: skip
        part = build_structure(housing_settings(geometry), MPI.COMM_SELF)
        found.append(reduce_structure(part, LOWEST).frequencies)
    fallen, falling = -np.diff(found, axis=0)
    # Refined once and once more: order 1 would be a ratio of 3. The corners between ring, web and
    # foot, where stresses are infinite, keep it from the elements' own.
    assert np.all(falling > 0)
    assert np.all(fallen > 4 * falling)
    default = reduce_structure(
        build_structure(housing_settings(), MPI.COMM_SELF), LOWEST
    ).frequencies
    assert np.all((found[2] < default) & (default < found[1]))


METHODS = {
    "m1": {"modes": 12},
    "m2": {"modes": 12, "interior_modes": 5},
    "m3": {"vibration_modes": 4, "residual_modes": 8},
    "m4": {"vibration_modes": 4},
    "full": {"vibration_modes": 4},
    "rigid": {},
}


@pytest.mark.parametrize("method", METHODS)
def test_every_method_reduces_the_held_housing(coarse, whole, method):
    body = reduce_structure(coarse, Reduction(method=method, **METHODS[method]))
    assert body.frame == "clamped"
    pushed = 1.0 + np.cos(np.arctan2(body.pressure_nodes[:, 1], body.pressure_nodes[:, 0]))
    followed = body.basis_flexibility() @ pushed
    missing = body.missing_flexibility @ pushed
    expected = whole.basis_flexibility() @ pushed
    np.testing.assert_allclose(followed + missing, expected, atol=1e-6 * np.abs(expected).max())
    if method == "m4":
        assert body.kinds == ("vibration",) * 4  # it does not turn: no centrifugal mode
    if method in ("m4", "full"):
        assert np.abs(missing).max() < 1e-3 * np.abs(followed).max()


def test_housing_of_tetrahedra_is_refused():
    with pytest.raises(MeshError, match="cells = 'hex'"):
        build_mesh(model_path("housing"), cells="tet", comm=MPI.COMM_SELF)


@pytest.mark.parametrize(
    ("geometry", "message"),
    [
        ({"bore_cells_around": 15}, "multiple of 10"),
        ({"foot_cells": 1.5}, "1.5"),
        ({"centre_height": 0.04}, "raise centre_height"),
        ({"web_width": 0.11}, "foot_width = 0.104"),
        ({"wal": 0.01}, "'wal'"),
    ],
)
def test_geometry_that_cannot_be_is_named(geometry, message):
    with pytest.raises(MeshError, match=message):
        build_mesh(model_path("housing"), geometry, comm=MPI.COMM_SELF)


def test_settings_read_back_as_printed():
    assert build(RotorSettings, tomllib.loads(to_toml(RotorSettings()))) == RotorSettings()


def test_a_model_is_found_again_from_elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    settings = read_settings("scene.toml", {"scene": "rotor", "housing": {"model": "mine.geo"}})
    assert settings.housing.model == str(tmp_path / "mine.geo")


def test_structure_without_a_foot_is_named(tmp_path):
    text = model_path("housing").read_text().replace('Physical Surface("foot", 3)', "x[]")
    (tmp_path / "loose.geo").write_text(text)
    settings = RotorSettings(housing=Housing(model=str(tmp_path / "loose.geo")))
    with pytest.raises(MeshError, match="'foot'"):
        build_structure(settings, MPI.COMM_SELF)


# --- The rotor in it


@pytest.fixture(scope="module")
def body_file(tmp_path_factory):
    settings = housing_settings(COARSE, vibration_modes=4, residual_modes=4)
    path = tmp_path_factory.mktemp("body") / "housing.h5"
    save_body(reduce_housing(settings, MPI.COMM_SELF).body, path)
    return path


def call(*arguments):
    return subprocess.run(
        [*COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=300
    )


SCENE = """
scene = "rotor"
[shaft]
revolutions = 0.01
[reduction]
vibration_modes = 4
residual_modes = 4
[time]
tolerance = 1e-3
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "short.toml"
    path.write_text(SCENE)
    return path


def test_run_writes_everything_it_promises(scene, body_file, tmp_path):
    result = call("run", scene, "--body", body_file, "-o", tmp_path, "--json")
    assert result.returncode == 0, result.stderr
    summary = json.loads(result.stdout)
    promised = {
        "max_pressure_Pa", "min_film_thickness_m", "steps", "newton_iterations",
        "basis_error_estimate_m", "energy_balance_error", "modes", "method", "status",
        "reduction_time_s", "wall_time_s", "versions",
    }  # fmt: skip
    assert promised <= set(summary)
    assert (summary["scene"], summary["method"], summary["modes"]) == ("rotor", "m3", 8)
    assert summary["rotor_mass_kg"] == pytest.approx(12.642, rel=1e-4)
    assert summary["rotor_polar_inertia_kg_m2"] == pytest.approx(3.998e-3, rel=1e-3)
    history = read_history(tmp_path)
    assert len(history["time_s"]) == summary["steps"]
    assert {"eccentricity_x_m", "tilt_y_rad", "kinetic_energy_J", "drive_W"} <= set(history)
    assert (tmp_path / "max_pressure.png").stat().st_size > 1000


def test_run_reports_in_a_few_lines(scene, body_file, tmp_path):
    result = call("run", scene, "--body", body_file, "-o", tmp_path, "--no-plots")
    assert result.returncode == 0, result.stderr
    assert "20 modes of the shaft, m3 with 8 of the housing" in result.stdout


@pytest.mark.slow
def test_reduce_housing_writes_a_body(scene, tmp_path):
    path = tmp_path / "housing.h5"
    options = ["--scene", scene, "--vibration-modes", 3, "--no-estimate-error", "--json"]
    result = call("reduce", "housing", "-o", path, *options)
    assert result.returncode == 0, result.stderr
    summary = json.loads(result.stdout)
    assert (summary["frame"], summary["modes"], summary["part"]) == ("clamped", 7, "housing")
    assert summary["degrees_of_freedom"] == "8931"
    assert summary["mass_kg"] == pytest.approx(0.7596, rel=1e-3)
    other = tmp_path / "other.toml"
    other.write_text('scene = "rotor"\n[housing]\nyoungs_modulus = 200e9\n')
    refused = call("run", other, "--body", path, "-o", tmp_path / "out")
    assert refused.returncode == 2
    assert "youngs_modulus = 210000000000.0" in refused.stderr


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[shaft]\nlenght = 1.0", "shaft.length"),
        ("[shaft]\nmodes = 5", "shaft.modes = 5"),
        ("[housing]\nmodel = 'absent.geo'", "absent.geo"),
        ("[rod]\nelement = 'lagrange'", "rod"),
    ],
)
def test_bad_scene_exits_2_with_one_line(text, named, body_file, tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(f'scene = "rotor"\n{text}\n')
    more = [] if "absent" in text else ["--body", body_file]
    result = call("run", path, *more, "-o", tmp_path / "out")
    assert result.returncode == 2, result.stderr
    last = result.stderr.strip().splitlines()[-1]
    assert last.startswith("fenics-ehd: ")
    assert named in last


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["reduce", "housing", "-o", "h.h5", "--cells", "tet"], "hex"),
        (["run", "rotor", "--vtk", "--body", "a.h5"], "--vtk"),
        (["run", "rotor", "--body", "a.h5", "--method", "m3"], "--body"),
    ],
)
def test_bad_command_exits_2_with_its_name(arguments, named, tmp_path):
    result = subprocess.run(
        [*COMMAND, *arguments], capture_output=True, text=True, timeout=300, cwd=tmp_path
    )
    assert result.returncode == 2, result.stderr
    assert named in result.stderr.splitlines()[-1]


@pytest.mark.slow
def test_quasi_static_bore_moves_as_the_full_interface(coarse, whole):
    settings = RotorSettings(shaft=Shaft(revolutions=0.1), time=Time(tolerance=1e-4))
    ends = []
    for body in (reduce_structure(coarse, Reduction(method="m4", vibration_modes=4)), whole):
        rows = []
        totals = simulate(settings, body, Totals(), lambda row, _, rows=rows: rows.append(row))
        assert totals.energy_error < ENERGY_LIMIT
        ends.append([rows[-1][name] for name in ("max_pressure_Pa", "min_film_thickness_m")])
    np.testing.assert_allclose(*ends, rtol=0.01)


@pytest.mark.mpi
def test_held_housing_is_the_same_on_any_number_of_ranks(coarse):
    shared = build_structure(housing_settings(COARSE), MPI.COMM_WORLD)
    assert rigid_body_modes(shared).shape[1] == 0
    own, found = (reduce_structure(part, LOWEST) for part in (coarse, shared))
    np.testing.assert_allclose(found.frequencies, own.frequencies, rtol=1e-8)
    assert found.inertia.total_mass == pytest.approx(own.inertia.total_mass, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("residual_modes", [20, 40])
def test_a_revolution_with_30_and_50_modes(structure, residual_modes):
    settings = RotorSettings(
        reduction=Reduction(residual_modes=residual_modes), time=Time(tolerance=1e-4)
    )
    body = reduce_structure(structure, settings.reduction)
    assert body.modes == 10 + residual_modes
    totals = simulate(settings, body, Totals())
    assert totals.time == pytest.approx(2 * np.pi / 600)
    assert totals.energy_error < ENERGY_LIMIT
    assert 0 < totals.min_film_thickness < 17e-6


def test_origin_names_what_the_body_depends_on():
    found = origin(housing_settings({"wall": 0.011}, method="m4"))
    assert found["geometry.wall"] == "0.011"
    assert found["residual_truncation"] == "0.0001"
    assert "modes" not in found
