"""Flexibility of the bores that a part's mesh misses, and its effect in a run."""

import json

import numpy as np
import pytest
from command_line import call
from csv_history import only_joint
from hand_made_rod import Joint, make_body
from mpi4py import MPI
from scene_cases import ROD_OF_A_FILE, structure, tables_of, write_scene
from scipy import integrate

import fenics_ehd as ehd
from fenics_ehd.base.plane import rotation
from fenics_ehd.fem.models import store_mesh_error, stored_mesh_error
from fenics_ehd.multibody.elastic_bore import sampling_grid
from fenics_ehd.multibody.mechanism import Instant, Motion, System
from fenics_ehd.multibody.trust import NOT_ESTIMATED
from fenics_ehd.reduction.mesh_error import (
    PATTERNS,
    SMOOTH,
    compliance_errors,
    excess,
    mesh_verdict,
    smooth_fields,
    smooth_responses,
)
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.scenes.scene import scene_of

ROD_OF_M1 = {"bodies.rod.reduction.method": "m1", "bodies.rod.reduction.modes": 8}


def rod(around, **changes):
    """A thin aluminium rod of so many cells around its bore."""
    cells = {"bore_cells_around": around, "bore_cells_along": around // 5}
    cells |= {"big_end_layers": around // 10, "shank_cells": around // 2, "big_end_wall": 0.008}
    found = {f"bodies.rod.geometry.{key}": value for key, value in cells.items()}
    return found | {"bodies.rod.material.youngs_modulus": 70e9} | changes


def of_mesh(around, **changes):
    part = structure("slider-crank", "rod", MPI.COMM_SELF, rod(around, **changes))
    return smooth_responses(StaticSolver(part)), part.size


def missing_in(body):
    """Compliance that a body lacks by its displacements: the work of smooth pressures on them."""
    bore = body.bores["bore"]
    grid = sampling_grid(bore)
    height = grid.node_positions[:, 1]
    along = np.unique(height)
    simpson = integrate.simpson(np.eye(len(along)), x=along)
    around = 2 * np.pi * bore.radius / np.sum(height == along[0])
    areas = around * simpson[np.searchsorted(along, height)]
    return smooth_fields(grid.nodes, bore.width).T @ (areas[:, None] * body.mesh_flexibility)


@pytest.fixture(scope="module", params=["hex", pytest.param("tet", marks=pytest.mark.slow)])
def known(request):
    """Error of a rod's mesh that is estimated and, by a finer one, true; its body, and scene."""
    cells = {"bodies.rod.cells": request.param}
    tables = tables_of("slider-crank-paper", rod(10, **cells) | ROD_OF_M1)
    built = ehd.build(scene_of(tables, "rod"))
    body = built.bodies["rod"]
    (own, size), (fine, finest) = of_mesh(10, **cells), of_mesh(30, **cells)
    true = excess(size, finest) * (fine.compliance - own.compliance)
    return body, own.compliance, true


def test_what_a_mesh_misses_is_known_within_two(known):
    """By the work of pressures, and in the displacement of the bore."""
    body, own, true = known
    estimated, true = (compliance_errors(found, own) for found in (missing_in(body), true))
    for name in PATTERNS:
        assert 0.5 < estimated[name] / true[name] < 2.0, name
    most = body.accuracy["flexibility_mesh_error"]
    assert most == pytest.approx(max(estimated.values()), rel=0.2)


def test_what_the_pin_holds_is_part_of_what_a_mesh_misses(known):
    """Of a force across the rod the bore lacks another shape if inertia alone balances it."""
    body, own, true = known
    bore, across = body.bores["bore"], np.zeros(own.shape[1])
    across[2] = 1.0 / (np.pi * bore.radius * bore.width)  # sin phi, of 1 N
    held = across.copy()
    held[SMOOTH + 1] = -1.0
    sin_2, sin_3 = 4, 6
    for shape in (sin_2, sin_3):
        lacks = (true @ held)[shape]
        assert 0.5 < (missing_in(body) @ held)[shape] / lacks < 2.0
        assert (missing_in(body) @ across)[shape] / lacks < 0.0


def test_forces_on_points_are_those_that_accelerate_the_body():
    tables = tables_of("slider-crank-paper", rod(10) | ROD_OF_M1)
    system = System(ehd.build(scene_of(tables, "rod")).mechanism)
    own, random = system.bodies["rod"], np.random.default_rng(0)
    body, z = system.mechanism.bodies["rod"], system.rough_pose[0].copy()
    z[own.start + body.angle_index] = 0.4
    (joint,) = (p for p in system.constraints if "rod.pin" in getattr(p.joint, "markers", ()))
    multipliers = np.zeros(system.m)
    multipliers[joint.rows] = random.standard_normal(joint.rows.stop - joint.rows.start)
    zero = np.zeros(system.n)
    motion = Motion(Instant(system, 0.0, z), zero, zero, multipliers)
    force = rotation(0.4) @ motion.on_points("rod", ["pin"])
    np.testing.assert_allclose(force, -motion.residual[own][:2], rtol=1e-12)
    assert np.linalg.norm(force) > 0.1


def test_meshes_alike_tell_nothing():
    with pytest.raises(ehd.errors.StructureError, match="too similar"):
        excess(1000, 1100)


def test_a_mesh_says_what_it_misses(tmp_path):
    path, size = tmp_path / "part.msh", SMOOTH + 4
    missing = 1e-9 * np.add.outer(np.arange(7), np.arange(size))
    path.write_bytes(b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n")
    with pytest.raises(ehd.errors.MeshError, match="has no mesh error for the bores"):
        stored_mesh_error(path, ["bore"], ["pin"])
    store_mesh_error(path, ["bore"], ["pin", "eye"], 0.02, missing)
    # In the order of their names.
    for points, kept in ((["pin", "eye"], size), (["eye"], size - 2), ([], SMOOTH)):
        error, found = stored_mesh_error(path, ["bore"], points)
        np.testing.assert_allclose(found, missing[:, :kept], rtol=1e-6)
        assert error == 0.02
    _, found = stored_mesh_error(path, ["bore"], ["pin"])
    np.testing.assert_allclose(found[:, SMOOTH:], missing[:, -2:], rtol=1e-6)
    for other in ((["other"], ["pin"]), (["bore"], ["hook"])):
        with pytest.raises(ehd.errors.MeshError):
            stored_mesh_error(path, *other)


def test_a_part_of_which_nothing_is_known_is_said_to_be_so(tmp_path):
    ehd.save_body(make_body(Joint()), tmp_path / "rod.h5")
    short = {"time.revolutions": 0.02, "time.tolerance": 1e-2, "joints.big_end.cells": [12, 3]}
    scene = write_scene(tmp_path / "scene.toml", "slider-crank-paper", ROD_OF_A_FILE, short)
    call("run", scene, "--no-plots", "-o", tmp_path / "run")
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    budget = only_joint(summary)["error_budget"]
    assert budget["max_pressure"]["part_mesh"] == NOT_ESTIMATED
    assert "no other mesh of the part is known" in summary["error_budget_notes"]["part_mesh"]


def test_files_of_parts_are_missed_before_anything_is_meshed(monkeypatch):
    tables = tables_of("slider-crank-both-ends", {})
    tables["bodies"]["other"] = tables["bodies"]["rod"] | {"model": "nowhere.msh"}
    meshed = []
    monkeypatch.setattr("fenics_ehd.scenes.part.elastic_part", lambda *given: meshed.append(given))
    with pytest.raises(ehd.errors.SettingsError, match=r"bodies\.other\.model = 'nowhere\.msh'"):
        ehd.build(scene_of(tables, "two"))
    assert not meshed


@pytest.mark.parametrize(
    ("cell", "error", "word", "ratio"),
    [
        (0.1, 0.018, "good", 1.5),
        (0.1, 0.09, "coarse", np.sqrt(0.09 / 0.02)),
        (0.01, 0.018, "coarse", 1.5),
        (0.1, 0.11, "refuse", 2.2),
        (0.004, 0.001, "refuse", 1.5),
        (0.1, None, "not judged", 1.5),
        (0.004, None, "refuse", 1.5),
    ],
)
def test_a_mesh_is_judged_by_its_worse_figure(cell, error, word, ratio):
    verdict = mesh_verdict(cell, error)
    assert (verdict.word, verdict.ratio) == (word, pytest.approx(ratio))
    assert f"worst cell {cell:.2g}, good from 0.02" in verdict.reason
    if error is not None:
        assert verdict.next_error == pytest.approx(error / ratio**2)
        assert "good up to 2 %, refused above 10 %" in verdict.reason
