"""Parts of every kind reduced by ranks of mpirun to the bodies that one process makes."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from calculix_ring import ring_solid, write_model
from foreign_parts import ring_arguments
from scene_cases import write_scene
from scipy import sparse

import fenics_ehd as ehd
from fenics_ehd.base.processes import for_mpirun, mpirun
from fenics_ehd.fem.gmsh_session import gmsh, session

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(mpirun() is None, reason="mpirun is not installed"),
]

#: Cells of the shipped rod's model, few of them.
COARSE = {
    "bore_cells_around": 10, "bore_cells_along": 2, "big_end_layers": 1, "shank_cells": 2,
    "small_end_layers": 1,
}  # fmt: skip

#: Both bodies are exact but for round-off and the tolerance of eigenvalues.
TOLERANCE = 1e-10


def write_own_model(folder):
    """The shipped model under another name: Gmsh runs it in a process of its own."""
    (folder / "own.geo").write_text(ehd.model_path("conrod").read_text())


def write_mesh(folder):
    write_model(folder / "mesh.msh", ring_solid("hex"))


def plate():
    """A plate with a bore and a pin's hole in Gmsh's current model, in millimetres."""
    occ = gmsh.model.occ
    solid = [(3, occ.addBox(-30, -30, -6, 90, 60, 12))]
    holes = [(3, occ.addCylinder(x, 0, -6, 0, 0, 12, r)) for x, r in ((0, 20), (40, 8))]
    occ.cut(solid, holes)
    occ.synchronize()


def write_abaqus(folder):
    with session():
        plate()
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 12)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 20)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        gmsh.model.mesh.optimize("HighOrderFastCurving")
        gmsh.write(str(folder / "deck.inp"))


def write_step(folder):
    with session():
        plate()
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        gmsh.write(str(folder / "drawing.step"))


def write_iges(folder):
    """The stored drawing of a ring, whose bore is that of the shipped housing."""
    shutil.copy(Path(__file__).parent / "parts" / "ring.igs", folder)


def write_matrices(folder):
    """Files of `foreign_parts`, to be read by every rank."""
    arguments = ring_arguments()
    for name in ("stiffness", "mass"):
        sparse.save_npz(folder / f"{name}.npz", arguments[name])


#: Files of each kind of part: what makes them, and the arguments of `part`, of those that need it.
KINDS = {
    "own": (write_own_model, None),
    "mesh": (write_mesh, None),
    "deck": (write_abaqus, "deck.inp --unit mm --bore 20mm --point 8mm --no-check"),
    "step": (write_step, "drawing.step --bore 20mm --point 8mm --no-check --cells-around 8"),
    "iges": (write_iges, "ring.igs --bore 22.5mm --held 2 --no-check --cells-around 8"),
    "matrices": (write_matrices, None),
}

#: What a launch does: commands, and the reduction of matrices by the public names.
REDUCE = """
import sys
from pathlib import Path
import foreign_parts
import fenics_ehd as ehd
from fenics_ehd.cli.main import main

def command(line):
    try:
        main(line.split())
    except SystemExit as end:
        assert not end.code, (line, end.code)

folder, *lines = sys.argv[1:]
for line in lines:
    command(line)
matrices = {name: f"{name}.npz" for name in ("stiffness", "mass")}
body = ehd.residual_flexibility(foreign_parts.ring(**matrices), 4)
from mpi4py import MPI
if MPI.COMM_WORLD.rank == 0:
    ehd.save_body(body, f"{folder}/matrices.h5")
"""


def scene_of_part(folder, name, model, geometry, *, held):
    """A scene with the shipped rod replaced by a part, or the shipped housing by a held one."""
    scene, body = ("rotor", "housing") if held else ("slider-crank-paper", "rod")
    settings = {"model": model, "geometry": geometry, "reduction.vibration_modes": 4}
    settings |= {"reduction.method": "m4", "reduction.estimate_error": False}
    settings |= {"clamped": "held"} if held else {"bores": ["bore"], "points": ["pin"]}
    keys = {f"bodies.{body}.{key}": value for key, value in settings.items()}
    write_scene(folder / f"{name}.toml", scene, keys)
    return body


def lines_of(folder, target):
    """Commands that make the body of every kind into a folder."""
    for name, (_, part) in KINDS.items():
        if part:
            yield f"part {part} -o {target}/{name}.msh"
        if name != "matrices":
            model = f"{target}/{name}.msh" if part else {"own": "own.geo"}.get(name, f"{name}.msh")
            geometry, held = COARSE if name == "own" else {}, "--held" in (part or "")
            body = scene_of_part(folder, f"{target}-{name}", model, geometry, held=held)
            yield f"reduce {body} --scene {target}-{name}.toml -o {target}/{name}.h5"


def launch(folder, target, *launcher):
    (folder / target).mkdir()
    paths = os.pathsep.join([str(Path(__file__).parent), *filter(None, sys.path)])
    environment = for_mpirun() | {"PYTHONPATH": paths}
    command = [*launcher, sys.executable, "-c", REDUCE, target, *lines_of(folder, target)]
    done = subprocess.run(
        ["timeout", "400", *command], cwd=folder, capture_output=True, text=True,
        env=environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.fixture(scope="module")
def bodies(tmp_path_factory):
    """Folder of the bodies made by one process, by one rank, and by two."""
    folder = tmp_path_factory.mktemp("parts")
    for write, _ in KINDS.values():
        write(folder)
    launch(folder, "serial")
    for ranks in ("1", "2"):
        launch(folder, f"ranks-{ranks}", mpirun(), "-n", ranks)
    return folder


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_ranks_make_the_same_body(kind, ranks, bodies):
    one, other = (
        ehd.load_body(bodies / folder / f"{kind}.h5") for folder in ("serial", f"ranks-{ranks}")
    )
    mass = one.inertia.total_mass
    assert other.inertia.total_mass == pytest.approx(mass, rel=TOLERANCE)
    np.testing.assert_allclose(other.frequencies, one.frequencies, rtol=TOLERANCE)
    expected = one.basis_flexibility()
    largest = np.abs(expected).max()
    assert largest > 0.0
    np.testing.assert_allclose(other.basis_flexibility(), expected, atol=TOLERANCE * largest)
