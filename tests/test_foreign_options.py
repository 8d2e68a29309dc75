"""Options and files that lie about, another person's or another program's, change nothing."""

import os
import subprocess
import sys

import pytest
from calculix_ring import ring_solid, write_model
from mpi4py import MPI

import fenics_ehd as ehd
from fenics_ehd.fem.drawn_part import open_part
from fenics_ehd.fem.gmsh_session import gmsh, session

#: Where PETSc may be started from.
MODULES = (
    "reduction.matrices", "film.film", "base.compat", "fem.structure", "multibody.simulation",
    "study.pool",
)  # fmt: skip


def in_home(code, home, **environment):
    """Output of a program whose home and current folder are one."""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=home, capture_output=True, text=True, timeout=120,
        env=os.environ | {"HOME": str(home)} | environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    "module", [MODULES[0], *(pytest.param(name, marks=pytest.mark.slow) for name in MODULES[1:])]
)
def test_petsc_obeys_what_is_given_on_purpose_alone(module, tmp_path):
    (tmp_path / ".petscrc").write_text("-film_snes_max_it 1\n")
    code = (
        f"import fenics_ehd.{module}\nfrom petsc4py import PETSc as p\nprint(p.Options().getAll())"
    )
    options = in_home(code, tmp_path, PETSC_OPTIONS="-film_snes_atol 1e-9")
    assert "'film_snes_atol': '1e-9'" in options
    assert "max_it" not in options


MESHED = """
from mpi4py import MPI
from fenics_ehd.fem.structure import build_mesh
for cells in ("hex", "tet"):
    print(build_mesh("rod.geo", cells=cells, comm=MPI.COMM_SELF).mesh.geometry.x.shape[0])
"""


@pytest.mark.slow
def test_gmsh_obeys_the_model_alone(tmp_path):
    model = ehd.model_path("conrod").read_text()
    (tmp_path / "rod.geo").write_text(model)
    expected = in_home(MESHED, tmp_path)
    assert len(expected.split()) == 2
    foreign = f'Mesh.MeshSizeFactor = 2;\nSystemCall "touch {tmp_path}/ran";\n'
    for name in (".gmsh-options", ".gmshrc", "rod.geo.opt"):
        (tmp_path / name).write_text(foreign)
    assert in_home(MESHED, tmp_path) == expected
    assert not (tmp_path / "ran").exists()


def test_model_finds_the_files_that_it_includes(tmp_path):
    (tmp_path / "whole.geo").write_text('Include "rod.geo";\n')
    (tmp_path / "rod.geo").write_text(ehd.model_path("conrod").read_text())
    coarse = {"shank_cells": 6, "bore_cells_along": 2}
    assert ehd.build_mesh(tmp_path / "whole.geo", coarse, comm=MPI.COMM_SELF).groups
    (tmp_path / "b\\e.geo").symlink_to(tmp_path / "rod.geo")
    with pytest.raises(ehd.errors.MeshError, match=r"b\\e\.geo: .* double quotes, backslashes"):
        ehd.build_mesh(tmp_path / "b\\e.geo", comm=MPI.COMM_SELF)


def test_mesh_is_read_and_never_run(tmp_path):
    """Gmsh takes what does not begin as a mesh does for a model, and a model is a program."""
    model = ehd.model_path("conrod").read_text()
    (tmp_path / "program.msh").write_text(f'SystemCall "touch {tmp_path}/ran";\n{model}')
    (tmp_path / "program.step").write_text(f'SystemCall "touch {tmp_path}/ran";\n{model}')
    for name, message in (("program.msh", "not a mesh"), ("program.step", "must be a .geo model")):
        with pytest.raises(ehd.errors.MeshError, match=message):
            ehd.build_mesh(tmp_path / name, comm=MPI.COMM_SELF)
    with session():
        gmsh.onelab.clear()
        gmsh.open(str(ehd.model_path("conrod")))
        gmsh.model.mesh.generate(3)
        gmsh.write(str(tmp_path / "rod.msh"))
    (tmp_path / "rod.msh.opt").write_text(f'SystemCall "touch {tmp_path}/ran";\n')
    paths = ehd.model_path("conrod"), tmp_path / "rod.msh"
    meshed, read = (ehd.build_mesh(path, comm=MPI.COMM_SELF) for path in paths)
    assert read.groups == meshed.groups
    assert read.mesh.geometry.x.shape == meshed.mesh.geometry.x.shape
    assert not (tmp_path / "ran").exists()


def test_capitals_in_an_ending_change_nothing(tmp_path):
    solid = ring_solid("tet")
    write_model(tmp_path / "ring.msh", solid)
    with session():
        gmsh.option.setNumber("Mesh.SaveAll", 1)
        gmsh.open(str(tmp_path / "ring.msh"))
        gmsh.write(str(tmp_path / "ring.unv"))
    (tmp_path / "ring.unv").rename(tmp_path / "ring.Unv")
    assert len(open_part(tmp_path / "ring.Unv").solid.cells) == len(solid.cells)


def test_a_broken_model_leaves_nothing_to_the_next(tmp_path):
    (tmp_path / "broken.geo").write_text("Macro a\nPoint(1) = {0, 0, 0;\nIf (1)\nFor i In {0:")
    with pytest.raises(ehd.errors.MeshError, match=r"Gmsh cannot (read|mesh) .*broken\.geo"):
        ehd.build_mesh(tmp_path / "broken.geo", comm=MPI.COMM_SELF)
    next_one = ehd.model_path("conrod"), {"shank_cells": 6, "bore_cells_along": 2}
    assert ehd.build_mesh(*next_one, comm=MPI.COMM_SELF).groups


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("big_end_wall", 11.4, r"geometry.big_end_wall = 11.4 must be from 0.005 to 0.2 in"),
        ("bore_radius", 1e300, r"geometry.bore_radius = 1e\+300 must be from 0.01 to 0.25"),
        ("tetrahedra", 0.5, r"geometry.tetrahedra = 0.5 must be 0 or 1"),
        ("bore_cells_along", 0, r"geometry.bore_cells_along = 0 must be from 1 to 100"),
    ],
)
def test_parameters_obey_the_limits_of_the_model(name, value, message):
    with pytest.raises(ehd.errors.MeshError, match=message):
        ehd.build_mesh(ehd.model_path("conrod"), {name: value}, comm=MPI.COMM_SELF)
