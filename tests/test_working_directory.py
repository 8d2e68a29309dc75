"""The current folder is not trusted: of what lies there, commands use only what the user names."""

import ast
import json
import os
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from command_line import OF_THE_MACHINE, program
from scene_cases import write_scene as write_shipped
from sweep_cases import rows_of, write_scene

import fenics_ehd as ehd
from fenics_ehd.reduction.body import body_digest

#: Modules that Python, libraries and this package import, by names that could lie in a folder.
MODULES = (
    "__future__", "abc", "attrs", "click", "codecs", "contextlib", "dolfinx", "enum", "functools",
    "gmsh", "logging", "matplotlib", "mpi4py", "multiprocessing", "numpy", "petsc4py", "pickle",
    "pyvista", "random", "re", "scipy", "selectors", "setuptools", "sitecustomize", "socket",
    "struct", "tempfile", "typing", "usercustomize",
)  # fmt: skip

#: Options of programs, each of which would change results, load a program, or end the command.
OPTIONS = {
    "ffcx_parameters.json": '{"table_rtol": 1e-2, "table_atol": 1e-2}',
    "ffcx_options.json": '{"table_rtol": 1e-2, "table_atol": 1e-2}',
    "dolfinx_jit_parameters.json": '{"cffi_extra_compile_args": ["-fplugin=./plugin.so"]}',
    "dolfinx_jit_options.json": '{"cffi_extra_compile_args": ["-fplugin=./plugin.so"]}',
    "matplotlibrc": "figure.dpi: 30\nlines.linewidth: 9\naxes.facecolor: red\n",
    ".petscrc": "-film_snes_max_it 1\n-snes_max_it 1\n",
    "petscrc": "-film_snes_max_it 1\n",
    "petsc.cfg": "PETSC_ARCH = /\n",
    "slepc.cfg": "PETSC_ARCH = /\n",
    ".gmshrc": "Mesh.MeshSizeFactor = 2;\n",
    ".gmsh-options": "Mesh.MeshSizeFactor = 2;\n",
    "untitled.geo": "Mesh.MeshSizeFactor = 2;\n",
    "setup.cfg": "[build_ext]\ncompiler = nothing\n",
    "pyproject.toml": "no toml\n",
    "pybuilddir.txt": "nowhere\n",
    "openmpi-mca-params.conf": "btl = nothing\n",
    "fonts.conf": "no xml\n",
}

#: Words of scenes and defaults of options: a folder of that name is none of them.
WORDS = ("conrod", "hex", "none", "pc2", "rigid")


@pytest.fixture(scope="module")
def clean_folders(tmp_path_factory):
    """Folder with a scene for each test function, in which every command runs once."""
    folders = {}

    def clean(name):
        if name not in folders:
            folders[name] = tmp_path_factory.mktemp("clean")
            write_scene(folders[name])
        return folders[name]

    return clean


@pytest.fixture(params=["files", "pipes"])
def folders(request, tmp_path, clean_folders):
    """A folder with a scene, and one that has others' files or pipes as well."""
    clean, hostile = clean_folders(request.function.__name__), tmp_path / "hostile"
    hostile.mkdir()
    write_scene(hostile)
    for name in OPTIONS:
        if request.param == "pipes":
            os.mkfifo(hostile / name)
        else:
            (hostile / name).write_text(OPTIONS[name])
    trap = f"open({str(hostile / 'ran')!r}, 'a').write(__name__)\nraise SystemExit(99)\n"
    for name in MODULES:
        (hostile / f"{name}.py").write_text(trap)
    for word in WORDS:
        (hostile / word).mkdir()
    return clean, hostile


def both(folders, *arguments):
    """Output of a command in both folders; no file there was run."""
    clean, hostile = folders
    outputs = [output_once(clean, *arguments), output(hostile, *arguments)]
    assert not (hostile / "ran").exists()
    return outputs


@cache
def output_once(folder, *arguments):
    """Output of a command in a folder without others' files, where it need not run again."""
    return output(folder, *arguments)


def output(folder, *arguments):
    """Output of a command that succeeds in a folder."""
    done = program(*arguments, cwd=folder)
    assert done.returncode == 0, done.stderr
    return done.stdout


def same_bytes(folders, *names):
    for name in names:
        one, other = ((folder / name).read_bytes() for folder in folders)
        assert one == other, name


def same_figures(folders, name):
    one, other = (json.loads((folder / name).read_text()) for folder in folders)
    for key in set(one) - OF_THE_MACHINE:
        assert one[key] == other[key], key


@pytest.mark.slow
def test_a_bearing_and_its_picture_are_the_same_in_every_folder(folders):
    bearing = ("bearing", "--eccentricity", "0.5", "--cells", "16x4", "--json")
    one, other = both(folders, *bearing, "--plot", "film.png")
    assert one == other
    same_bytes(folders, "film.png")


def test_petsc_is_found_without_the_folder_s_configuration(tmp_path):
    """dolfinx from 0.9 on asks for PETSc's architecture when it is imported."""
    (tmp_path / "petsc.cfg").write_text(OPTIONS["petsc.cfg"])
    code = "import fenics_ehd.base.petsc_start, petsc4py; print(petsc4py.lib.getPathArchPETSc())"
    command = [sys.executable, "-P", "-c", code]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    path, architecture = ast.literal_eval(done.stdout)
    assert Path(path, architecture).is_relative_to(path), architecture


@pytest.mark.slow
def test_workers_of_a_sweep_run_no_file_of_the_folder(folders):
    sweep = ("sweep", "short.toml", "--set", "clearance=17e-6,20e-6", "--workers", "1")
    both(folders, *sweep, "-o", "out", "--keep")
    same_bytes(folders, "out/runs/0001/history.csv", "out/runs/0002/history.csv")
    timed = ("reduction_time_s", "wall_time_s")
    one, other = (
        [{k: v for k, v in row.items() if k not in timed} for row in rows_of(folder / "out")]
        for folder in folders
    )
    assert one == other
    bodies = [sorted(p.name for p in (folder / "out" / "bodies").iterdir()) for folder in folders]
    assert bodies[0] == bodies[1]


@pytest.mark.slow
def test_a_run_its_pictures_and_files_are_the_same_in_every_folder(folders):
    both(folders, "run", "short.toml", "-o", "out")
    same_bytes(folders, "out/history.csv")
    same_figures(folders, "out/summary.json")
    both(folders, "plot", "out", "--quantity", "big_end.orbit", "-o", "pictures")
    same_bytes(folders, "pictures/orbit-big_end.png")
    both(folders, "paraview", "out", "-o", "paraview")
    same_bytes(folders, "paraview/run.pvd")
    both(folders, "animate", "out", "--frames", "4", "-o", "run.gif")
    same_bytes(folders, "run.gif")


def without_times(body):
    """The body without the times that its reduction took."""
    kept = {key: text for key, text in body.provenance.items() if "_time_s" not in key}
    return replace(body, provenance=kept)


@pytest.mark.slow
def test_a_part_is_reduced_the_same_in_every_folder(folders):
    coarse = {"bore_cells_around": 10, "bore_cells_along": 2, "shank_cells": 2}
    changes = {"bodies.rod.model": "own.geo", "bodies.rod.geometry": coarse}
    for folder in folders:
        (folder / "own.geo").write_text(ehd.model_path("conrod").read_text())
        write_shipped(folder / "own.toml", "slider-crank-paper", changes)
    both(folders, "reduce", "rod", "--scene", "own.toml", "-o", "rod.h5")
    one, other = (without_times(ehd.load_body(folder / "rod.h5")) for folder in folders)
    assert body_digest(one) == body_digest(other)


@pytest.mark.slow
def test_forms_that_are_compiled_in_a_folder_obey_none_of_its_files(folders, monkeypatch):
    clean, hostile = folders
    bearing = ("bearing", "--eccentricity", "0.5", "--cells", "16x4", "--json")
    expected = program(*bearing, cwd=clean).stdout
    monkeypatch.setenv("XDG_CACHE_HOME", str(hostile.parent / "cache"))
    done = program(*bearing, cwd=hostile)
    assert done.returncode == 0, done.stderr
    assert done.stdout == expected
    assert list((hostile.parent / "cache").rglob("*.so"))
    assert not (hostile / "ran").exists()


@pytest.mark.slow
@pytest.mark.parametrize("folders", ["pipes"], indirect=True)
def test_an_installation_is_checked_in_every_folder(folders):
    one, other = both(folders, "info")
    assert one == other
    done = program("check", cwd=folders[1])
    assert done.returncode == 0, done.stdout + done.stderr
    assert not (folders[1] / "ran").exists()


NOTEBOOK = """
import fenics_ehd as ehd
from fenics_ehd.plotting import picture
print(picture.matplotlib.rcParams["lines.linewidth"])
"""


def test_a_program_that_imports_the_package_keeps_its_own_options_of_matplotlib(tmp_path):
    (tmp_path / "matplotlibrc").write_text(OPTIONS["matplotlibrc"])
    environment = {k: v for k, v in os.environ.items() if k != "MATPLOTLIBRC"}
    done = subprocess.run(
        [sys.executable, "-c", NOTEBOOK], cwd=tmp_path, env=environment, capture_output=True,
        text=True, timeout=60,
    )  # fmt: skip
    assert done.stdout == "9.0\n", done.stderr


#: Libraries that look for options when they are first imported, and what imports them without.
STARTS = {
    "petsc4py": "fenics_ehd.base.petsc_start",
    "slepc4py": "fenics_ehd.base.petsc_start",
    "dolfinx": "fenics_ehd.base.petsc_start",
    "matplotlib": "fenics_ehd.base.matplotlib_start",
}


def imported(path):
    """Names of modules that a file imports, in order, those for type checkers left out."""
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        for inner in ast.walk(node):
            if isinstance(inner, ast.Import):
                yield from (alias.name for alias in inner.names)
            elif isinstance(inner, ast.ImportFrom):
                yield inner.module


@pytest.mark.parametrize(
    "path", sorted(Path(ehd.__file__).parent.rglob("*.py")), ids=lambda path: path.stem
)
def test_libraries_with_options_are_imported_without_them(path):
    names = list(imported(path))
    if path.stem in ("petsc_start", "matplotlib_start"):
        return
    for library, start in STARTS.items():
        uses = [i for i, name in enumerate(names) if name.partition(".")[0] == library]
        assert not uses or start in names[: uses[0]], library
