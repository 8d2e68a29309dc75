"""What a part's mesh misses of its bores' flexibility, and what that is worth in a run."""

import json

import numpy as np
import pytest
from command_line import call
from hand_made_rod import Joint, make_body
from mpi4py import MPI
from scene_cases import ROD_OF_A_FILE, structure, tables_of, write_scene

from fenics_ehd.base.errors import MeshError, SettingsError, StructureError
from fenics_ehd.fem.models import store_mesh_error, stored_mesh_error
from fenics_ehd.multibody.error_shares import NOT_ESTIMATED
from fenics_ehd.reduction import save_body
from fenics_ehd.reduction.mesh_error import (
    PATTERNS,
    SMOOTH,
    compliance_errors,
    excess,
    outward_of,
    smooth_answers,
)
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.scenes.build import build_mechanism
from fenics_ehd.scenes.scene_file import scene_of


def rod(around, **changes):
    """A thin aluminium rod of so many cells around its bore."""
    cells = {"bore_cells_around": around, "bore_cells_along": around // 5}
    cells |= {"big_end_layers": around // 10, "shank_cells": around // 2, "big_end_wall": 0.008}
    found = {f"bodies.rod.geometry.{key}": value for key, value in cells.items()}
    return found | {"bodies.rod.material.youngs_modulus": 70e9} | changes


def of_mesh(around, **changes):
    part = structure("slider-crank", "rod", MPI.COMM_SELF, rod(around, **changes))
    return smooth_answers(StaticSolver(part)), part.size


@pytest.fixture(scope="module", params=["hex", pytest.param("tet", marks=pytest.mark.slow)])
def known(request):
    """Error of a rod's mesh that is estimated and, by a finer one, true; its body, and scene."""
    cells = {"bodies.rod.cells": request.param}
    reduction = {"bodies.rod.reduction.method": "m1", "bodies.rod.reduction.modes": 8}
    tables = tables_of("slider-crank-paper", rod(10, **cells) | reduction)
    built = build_mechanism(scene_of(tables, "rod"), MPI.COMM_SELF)
    body = built.parts["rod"]
    (own, size), (fine, finest) = of_mesh(10, **cells), of_mesh(30, **cells)
    true = excess(size, finest) * (fine.compliance - own.compliance)
    return body, own.compliance, compliance_errors(true, own.compliance)


def test_what_a_mesh_misses_is_known_within_two(known):
    """Told by the work of pressures, and in the displacement of the bore."""
    body, own, true = known
    shapes = outward_of(np.eye(SMOOTH), body.bores)
    missing = np.linalg.lstsq(shapes, body.mesh_flexibility, rcond=None)[0]
    estimated = compliance_errors(missing, own)
    for name in PATTERNS:
        assert 0.5 < estimated[name] / true[name] < 2.0, name
    most = body.accuracy["flexibility_mesh_error"]
    assert most == pytest.approx(max(estimated.values()), rel=0.2)


def test_meshes_alike_tell_nothing():
    with pytest.raises(StructureError, match="tell nothing"):
        excess(1000, 1100)


def test_a_mesh_says_what_it_misses(tmp_path):
    path, missing = tmp_path / "part.msh", np.diag(1e-21 * np.arange(SMOOTH))
    path.write_bytes(b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n")
    with pytest.raises(MeshError, match="does not say what its mesh misses"):
        stored_mesh_error(path, ["bore"])
    store_mesh_error(path, ["bore"], missing)
    np.testing.assert_allclose(stored_mesh_error(path, ["bore"]), missing, rtol=1e-3)
    with pytest.raises(MeshError):
        stored_mesh_error(path, ["other"])


def test_a_part_of_which_nothing_is_known_is_said_to_be_so(tmp_path):
    save_body(make_body(Joint()), tmp_path / "rod.h5")
    short = {"time.revolutions": 0.02, "time.tolerance": 1e-2, "joints.big_end.cells": [12, 3]}
    scene = write_scene(tmp_path / "scene.toml", "slider-crank-paper", ROD_OF_A_FILE, short)
    call("run", scene, "--no-plots", "-o", tmp_path / "run")
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    budget = summary["error_budget"]
    assert budget["max_pressure"]["part_mesh"] == NOT_ESTIMATED
    assert "no other mesh of the part is known" in summary["error_budget_notes"]["part_mesh"]


def test_files_of_parts_are_missed_before_anything_is_meshed(monkeypatch):
    tables = tables_of("slider-crank-both-ends", {})
    tables["bodies"]["other"] = tables["bodies"]["rod"] | {"model": "nowhere.msh"}
    meshed = []
    monkeypatch.setattr("fenics_ehd.scenes.build.elastic_part", lambda *given: meshed.append(given))
    with pytest.raises(SettingsError, match=r"bodies\.other\.model = 'nowhere\.msh'"):
        build_mechanism(scene_of(tables, "two"), MPI.COMM_SELF)
    assert not meshed
