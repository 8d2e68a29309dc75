"""Drawings and meshes of other programs as models: faces found, bores round, flexibility right."""

import json
import re
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import attrs
import click
import example_parts
import meshio
import numpy as np
import pytest
from calculix_ring import run_calculix
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from mpi4py import MPI

import fenics_ehd as ehd
from fenics_ehd.cli.main import cli
from fenics_ehd.fem.drawn_part import NamedFaces, open_part, place_part, write_part
from fenics_ehd.fem.faces import fit_cylinder
from fenics_ehd.fem.models import stored_mesh_error
from fenics_ehd.fem.solid import Solid, corner_volumes, raised, refined
from fenics_ehd.fem.structure import part_responses
from fenics_ehd.film.transfer import Surface
from fenics_ehd.reduction.bore import bore_holes
from fenics_ehd.reduction.elements import SOLIDS
from fenics_ehd.reduction.mesh_error import compliance_errors, smooth_responses
from fenics_ehd.reduction.reductor import rigid
from fenics_ehd.reduction.static import StaticSolver
from fenics_ehd.scenes.part import elastic_part

STEEL = ehd.Material(210e9, 0.3, 7850.0)

#: Of the shipped model's default rod [kg].
MASS = 0.97280


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    folder = tmp_path_factory.mktemp("parts")
    # By themselves: Gmsh's meshes depend on those that it has made before.
    command = [sys.executable, example_parts.__file__, str(folder)]
    assert subprocess.run(command, capture_output=True, check=True).stdout == b""
    return folder


#: Gmsh takes a second or two for a drawing: each is opened once.
opened = cache(open_part)


@cache
def placed(path, around=24):
    part = opened(path, "mm")
    bore, pin = part.face("22.5mm", ("bore",)), part.face("12mm", ("bore",))
    return place_part(part, NamedFaces({"bore": bore}, {"pin": pin}), around)


@given(
    st.lists(st.floats(-1, 1), min_size=3, max_size=3).filter(lambda a: np.linalg.norm(a) > 0.1),
    st.floats(1e-3, 10.0),
    st.floats(1.0, 2 * np.pi),
    st.floats(0.2, 4.0),
)
def test_cylinder_through_points_of_an_arc(axis, radius, arc, slenderness):
    axis = np.array(axis) / np.linalg.norm(axis)
    across = np.linalg.svd(axis[None, :])[2][1:]
    phi, z = (g.ravel() for g in np.meshgrid(np.linspace(0, arc, 12), np.linspace(-0.5, 0.5, 5)))
    width, centre = slenderness * radius, radius * np.array([3.0, -2.0, 5.0])
    normals = np.column_stack([np.cos(phi), np.sin(phi)]) @ across
    x = centre + radius * normals + np.outer(width * z, axis)
    found = fit_cylinder(x, normals)
    assert found.radius == pytest.approx(radius, rel=1e-8)
    assert found.width == pytest.approx(width, rel=1e-8)
    assert abs(found.axis @ axis) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(found.centre, centre, atol=1e-7 * radius)
    assert found.deviation < 1e-9 * radius


def test_faces_of_a_drawing(parts):
    faces = opened(parts / "rod.step", "mm").faces
    kinds = [face.kind for face in faces]
    assert kinds == ["bore", "bore", "shaft", "shaft", *["plane"] * 4]
    radii = [face.cylinder.radius for face in faces[:4]]
    assert radii == pytest.approx([0.0225, 0.012, 0.0339, 0.021], rel=1e-9)
    axis = example_parts.rotation() @ [0.0, 0.0, 1.0]
    shift = 1e-3 * np.array(example_parts.SHIFT)
    pin = shift + example_parts.rotation() @ [0.16, 0.0, 0.0]
    for face, centre in zip(faces[:2], (shift, pin), strict=True):
        assert face.cylinder.width == pytest.approx(0.022, rel=1e-9)
        assert abs(face.axis @ axis) == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(face.centre, centre, atol=1e-9)
        assert face.arc == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("name", ["rod.inp", "turned.msh"])
def test_edges_tell_the_faces_of_a_mesh(parts, name):
    faces = opened(parts / name, "mm").faces
    drawn = opened(parts / "rod.step", "mm").faces
    assert [face.kind for face in faces] == [face.kind for face in drawn]
    for ours, expected in zip(faces[:4], drawn[:4], strict=True):
        # Nodes are rounded to 0.1 um.
        assert ours.cylinder.radius == pytest.approx(expected.cylinder.radius, abs=1e-7)
        np.testing.assert_allclose(ours.centre, expected.centre, atol=1e-7)


@pytest.mark.slow
def test_chamfers_end_the_bore_and_a_drilled_one_keeps_its_hole(parts, tmp_path):
    part = open_part(parts / "drilled.step")
    assert part.faces[0].cylinder.width == pytest.approx(0.020, rel=1e-8)
    assert part.faces[2].cylinder.radius == pytest.approx(2.5e-3, rel=1e-8)
    made = place_part(part, NamedFaces({"bore": 1}, {"pin": 2}), 24)
    # In the order of dolfinx: an edge's node has the number of the corner that faces it.
    facets = made.surfaces()["bore"][:, [0, 1, 2, 4, 5, 3]]
    nodes, cells = np.unique(facets, return_inverse=True)
    (hole,) = bore_holes(made.solid.points[nodes], cells.reshape(facets.shape), "triangle")
    assert abs(hole.angle) == pytest.approx(np.pi, abs=0.01)
    # The file is turned, so z may be the other way round.
    assert abs(hole.height) == pytest.approx(2e-3, abs=2e-4)
    assert hole.diameter == pytest.approx(5e-3, rel=0.05)


@pytest.mark.parametrize("name", ["rod.step", "rod.inp", "turned.msh"])
def test_part_lies_as_scenes_want_it(parts, name, tmp_path):
    made = placed(parts / name)
    x = made.solid.points[np.unique(made.surfaces()["bore"])]
    np.testing.assert_allclose(np.linalg.norm(x[:, :2], axis=1), 0.0225, rtol=4e-6)
    assert np.ptp(np.linalg.norm(x[:, :2], axis=1)) < 1e-15
    assert x[:, 2].max() == -x[:, 2].min() == pytest.approx(0.011, abs=1e-7)
    pin = made.solid.points[np.unique(made.surfaces()["pin"])]
    middle = 0.5 * (pin.min(axis=0) + pin.max(axis=0))
    np.testing.assert_allclose(middle, [0.16, 0.0, 0.0], atol=2e-7)
    assert made.moved["bore"] < (1e-12 if name == "rod.step" else 1e-7)
    write_part(tmp_path / "part.msh", made.solid, made.surfaces())
    mesh = ehd.build_mesh(tmp_path / "part.msh", comm=MPI.COMM_SELF)
    assert mesh.cell == ("hexahedron" if name == "turned.msh" else "tetrahedron")
    assert set(mesh.groups) == {"part", "bore", "pin"}


def test_rounded_hexahedra_carry_a_film(parts):
    made = placed(parts / "turned.msh")
    nodes, cells = np.unique(made.surfaces()["bore"], return_inverse=True)
    cells = cells.reshape(-1, 8)[:, [0, 1, 3, 2, 4, 7, 5, 6]]
    surface = Surface.on_cylinder(made.solid.points[nodes], cells, "serendipity")
    assert surface.covered == pytest.approx(2 * np.pi * surface.width, rel=1e-9)


@pytest.fixture(scope="module")
def reference():
    """The shipped rod on a fine mesh."""
    given = {"bore_cells_around": 40, "bore_cells_along": 10, "shank_cells": 24}
    given |= {"big_end_layers": 4, "small_end_layers": 4}
    structure, answers = part_responses(ehd.model_path("conrod"), STEEL, ["bore"], None, given)
    assert rigid(structure).inertia.total_mass == pytest.approx(MASS, rel=1e-4)
    return answers


@pytest.mark.slow
def test_bores_yield_as_that_of_the_shipped_rod(parts, reference, tmp_path, figure):
    worst = 0.0
    for name in ("rod.step", "rod.inp", "turned.msh"):
        stated = made(parts / name, tmp_path / "part.msh")
        assert stated["mass_kg"] == pytest.approx(MASS, rel=1e-4)
        assert 0.05 < stated["worst_cell"] < 1.0
        assert stated["verdict"] in ("good", "coarse")
        _, ours = part_responses(tmp_path / "part.msh", STEEL, ["bore"], None)
        off = difference(ours.compliance, reference.compliance)
        worst = max(worst, off / stated["flexibility_mesh_error"])
    figure(
        "part and reduction", "bores of foreign parts, error over the one stated", worst, most=1.0
    )


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="ccx is not installed (calculix-ccx)")
def test_matrices_of_calculix_yield_as_the_shipped_rod(
    parts, reference, tmp_path, figure, monkeypatch
):
    run_calculix(parts / "calculix.inp")
    text = (Path(__file__).parents[1] / "docs" / "own-part.md").read_text()
    (recipe,) = re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    monkeypatch.chdir(parts.parent)
    names = {}
    exec(recipe.replace("parts/", f"{parts.name}/"), names)
    stated = made(parts / "calculix.inp", tmp_path / "part.msh")
    ours = smooth_responses(StaticSolver(names["rod"])).compliance
    # What comes behind the pressures are forces on the pin, which the reference does not know.
    off = difference(ours[:, : len(ours)], reference.compliance)
    figure(
        "part and reduction",
        "bore by matrices of CalculiX, error over the one stated",
        off / stated["flexibility_mesh_error"],
        most=1.0,
    )


def difference(ours, reference):
    """Largest relative one of the work of bending pressures."""
    return max(compliance_errors(ours - reference, reference).values())


def made(path, target):
    """Figures that `part` prints of a file, whose model is written."""
    call = ["part", str(path), "--unit", "mm", "--bore", "22.5mm", "--point", "12mm"]
    reported = CliRunner().invoke(cli, [*call, "-o", str(target), "--json"])
    assert reported.exit_code == 0, reported.output
    return json.loads(reported.stdout)


@pytest.mark.slow
def test_mesh_with_an_oil_hole_yields_as_its_drawing(parts, tmp_path, figure):
    drawn = placed(parts / "drilled.step", 40)
    write_part(tmp_path / "drawn.msh", drawn.solid, drawn.surfaces())
    structure, reference = part_responses(tmp_path / "drawn.msh", STEEL, ["bore"], None)
    stated = made(parts / "drilled.msh", tmp_path / "part.msh")
    # Nodes on the rim of the hole are nodes of the finer mesh, too.
    assert np.isfinite(stored_mesh_error(tmp_path / "part.msh", ["bore"], ["pin"])[1]).all()
    assert stated["mass_kg"] == pytest.approx(rigid(structure).inertia.total_mass, rel=1e-3)
    _, ours = part_responses(tmp_path / "part.msh", STEEL, ["bore"], None)
    off = difference(ours.compliance, reference.compliance)
    figure(
        "part and reduction",
        "mesh with an oil hole, difference to its drawing over the error stated",
        off / stated["flexibility_mesh_error"],
        most=1.0,
    )


@pytest.mark.slow
def test_cells_cut_in_eight_are_the_same_solid(parts):
    for name in ("rod.inp", "turned.msh"):
        part = opened(parts / name, "mm")
        numbers = np.arange(len(part.facets))
        fine, facets, labels = refined(part.solid, part.facets, numbers)
        assert len(fine.cells) == 8 * len(part.solid.cells)
        assert np.all(np.bincount(labels) == 4)
        # Each piece lies on the facet that it was cut from.
        middles = (
            fine.points[facets].mean(axis=1) - part.solid.points[part.facets].mean(axis=1)[labels]
        )
        size = np.ptp(part.solid.points[part.facets], axis=1).max(axis=1)[labels]
        assert np.all(np.linalg.norm(middles, axis=1) < size)
        assert 0.3 * corner_volumes(part.solid).min() < corner_volumes(fine).min() < 1.0
        # Nodes of a second-order field on the cells: what it holds is kept to the last bit.
        np.testing.assert_array_equal(fine.points[: len(part.solid.points)], part.solid.points)


@pytest.mark.parametrize("kind", ["tet", "hex"])
def test_first_order_cells_get_straight_edges(kind):
    corners = {"tet": np.vstack([np.zeros(3), np.eye(3)])}
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    corners["hex"] = np.array([(*xy, z) for z in (0, 1) for xy in square], dtype=float)
    x = corners[kind]
    solid = raised(x, np.arange(len(x))[None, :], kind)
    for place, (a, b) in enumerate(SOLIDS[kind].edges, len(x)):
        middle = solid.points[solid.cells[0, place]]
        np.testing.assert_array_equal(middle, 0.5 * (x[a] + x[b]))
    assert corner_volumes(solid).min() == pytest.approx(1.0 if kind == "hex" else 0.5)
    turned = Solid(solid.points * [-1.0, 1.0, 1.0], solid.cells, kind)
    assert corner_volumes(turned).max() < 0


#: A part whose material counts.
WRITTEN = ("rod.step", "--bore", "1", "-o", "x.msh")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere.step"], "there is no such file"),
        (
            ["rod.step", "--bore", "20mm", "-o", "x.msh"],
            "no face matches '20mm': give a face by its number: 1 of 22.5 mm",
        ),
        (["rod.step", "--bore", "7", "-o", "x.msh"], "face 7 is a plane, not a bore"),
        (["rod.step", "--bore", "99", "-o", "x.msh"], "by its number: 1 to 8"),
        (["rod.step", "--bore", "big", "-o", "x.msh"], "or its radius with a unit: 22.5mm"),
        (["rod.step", "--bore", "1", "--point", "1", "-o", "x.msh"], "face 1 is given twice"),
        (["rod.step", "--bore", "1", "--bore", "2", "-o", "x.msh"], "'bore' names two faces"),
        (["rod.step", "--bore", "1", "-o", "x.stl"], "must end with .msh"),
        (["rod.step", "--bore", "1", "-o", "none/x.msh"], "folder none does not exist"),
        (["turned.msh", "--unit", "mm", "--bore", "1", "-o", "turned.msh"], "an input file"),
        ([*WRITTEN, "--density", "-5"], "density = -5.0 must be at least 100"),
        ([*WRITTEN, "--youngs-modulus", "nan"], "youngs_modulus = nan must be a finite number"),
        ([*WRITTEN, "--poissons-ratio", "0.5"], "poissons_ratio = 0.5 must be below 0.49"),
        (["nan.vtu"], "not a finite number"),
        (["two.msh", "--unit", "mm"], "has 2 solids, but must have one"),
        (["rod.inp", "--unit", "mm", "--angle", "nan"], "'nan' is no number"),
        (["rod.inp"], "above 5: give its --unit"),
        (["text.inp", "--unit", "mm"], "it needs one kind of solid cells"),
        (["text.step"], r"Gmsh cannot read text\.step: .*'text\.step'"),
        (["text.vtu"], "meshio cannot read it"),
    ],
)
def test_what_cannot_be_is_named(wrong_parts, arguments, message, monkeypatch):
    monkeypatch.chdir(wrong_parts)
    monkeypatch.setattr("fenics_ehd.fem.drawn_part.open_part", opened)
    named = ehd.errors.MeshError, ehd.errors.SettingsError, click.BadParameter
    with pytest.raises(named, match=message):
        CliRunner().invoke(cli, ["part", *arguments], catch_exceptions=False, standalone_mode=False)
    assert not Path("x.msh").exists()


@pytest.fixture(scope="module")
def wrong_parts(parts):
    """Not surfaces: what is next to them."""
    one = meshio.read(parts / "turned.msh")
    other = meshio.Mesh(
        np.vstack([one.points, one.points + 1e3]),
        [("hexahedron27", np.vstack([one.cells[0].data, one.cells[0].data + len(one.points)]))],
    )
    meshio.write(parts / "two.msh", other, file_format="gmsh", binary=False)
    for ending in ("inp", "step", "vtu"):
        (parts / f"text.{ending}").write_text("nothing\n")
    corners = np.vstack([np.full(3, np.nan), np.eye(3)])
    meshio.write(parts / "nan.vtu", meshio.Mesh(corners, [("tetra", [[0, 1, 2, 3]])]))
    return parts


@pytest.mark.slow
def test_mesh_error_is_not_told_from_the_same_mesh(parts, tmp_path):
    target = tmp_path / "x.msh"
    asked = ["part", str(parts / "rod.step"), "--bore", "1", "--cells-around", "8"]
    done = CliRunner().invoke(cli, [*asked, "-o", str(target), "--json"], catch_exceptions=False)
    stated = json.loads(done.stdout)["flexibility_mesh_error"]
    assert stated > 1e-3
    # A scene that takes the model knows it, for any material; Gmsh skips the entry.
    rod = ehd.read_scene("slider-crank-paper").bodies["rod"]
    soft = attrs.evolve(rod.material, youngs_modulus=70e9)
    method = attrs.evolve(rod.reduction, method="m1", modes=8)
    own = {"model": str(target), "geometry": {}, "points": (), "reduction": method}
    rod = attrs.evolve(rod, material=soft, **own)
    made = elastic_part(rod, "bodies.rod", "lagrange", MPI.COMM_SELF).reduce(mesh_error=True)
    assert made.body.accuracy["flexibility_mesh_error"] == pytest.approx(stated, rel=5e-3)
