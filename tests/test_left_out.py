"""What a scene does not need is neither imported nor made."""

import json
import subprocess
import sys

from hand_made_rod import Joint, flexible, make_body
from mechanism_cases import flexible_slider_crank, rigid_rod, short_films, slider_crank
from scene_cases import ROD_OF_A_FILE, write_scene

import fenics_ehd as ehd
from fenics_ehd.multibody import quantities, step_equations
from fenics_ehd.multibody.bdf import IntegratorOptions
from fenics_ehd.multibody.mechanism import System
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.step_equations import StepEquations

#: Modules that no run with a ready body needs, and what each is for.
NEVER = {
    "gmsh": "meshes",
    "matplotlib": "pictures",
    "scipy.interpolate": "tables over time or angle, and error budgets",
    "fenics_ehd.fem.structure": "meshes and finite elements of the part",
    "fenics_ehd.results.paraview": "ParaView",
    "fenics_ehd.analysis.equilibrium": "a bearing alone",
    "fenics_ehd.study": "sweeps and studies",
}

LIST_MODULES = """
import json, sys
from fenics_ehd.cli.main import main
for arguments in json.loads(sys.argv[1]):
    try:
        main(arguments)
    except SystemExit as end:
        assert not end.code, end.code
    print("\\n", json.dumps(list(sys.modules)))
"""


def modules_after(*commands):
    """Modules of a process after each of its commands."""
    commands = [list(map(str, arguments)) for arguments in commands]
    done = subprocess.run(
        [sys.executable, "-c", LIST_MODULES, json.dumps(commands)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    lines = done.stdout.splitlines()
    return [set(json.loads(line)) for line in lines if line.startswith(' ["')]


def test_a_run_imports_what_its_scene_needs(tmp_path):
    ehd.save_body(make_body(Joint()), tmp_path / "rod.h5")
    times = {"time.revolutions": 0.001, "time.tolerance": 1e-3}
    scene = write_scene(tmp_path / "scene.toml", "slider-crank-paper", ROD_OF_A_FILE, times)
    command = ("run", scene, "--no-plots")
    alone, with_budget = modules_after(
        [*command, "--no-error-budget", "-o", tmp_path / "one"], [*command, "-o", tmp_path / "two"]
    )
    assert not alone & set(NEVER)
    # The former takes the latter along.
    assert with_budget & set(NEVER) <= {"scipy.interpolate", "scipy.optimize"}


def test_help_needs_neither_solvers_nor_arrays():
    *_, loaded = modules_after(
        ["--help"], ["run", "--help"], ["bearing", "--help"], ["init", "slider-crank"]
    )
    heavy = {"dolfinx", "petsc4py", "slepc4py", "gmsh"}
    assert not loaded & (heavy | {"matplotlib", "scipy", "numpy"})


def test_names_import_what_they_need_alone():
    code = (
        "import sys\n"
        "def none_of(*names):\n"
        "    assert not set(names) & set(sys.modules), set(names) & set(sys.modules)\n"
        "import fenics_ehd.reduction\n"
        "none_of('dolfinx', 'ufl', 'gmsh', 'scipy', 'matplotlib')\n"
        "import fenics_ehd as ehd\n"
        "ehd.Reductor, ehd.read_abaqus, ehd.errors.SettingsError\n"
        "none_of('dolfinx', 'gmsh', 'matplotlib')\n"
        "import fenics_ehd.plotting.pictures\n"
        "none_of('dolfinx')"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def big_end(body):
    """The film of a big end, and the equations of its mechanism."""
    equations = StepEquations(System(flexible_slider_crank(body)))
    return equations.system.films[0].film, equations


def test_rods_have_what_they_answer_by_alone():
    _, without_patterns = big_end(flexible(Joint())[0])
    assert not without_patterns.responses.bodies
    assert without_patterns.responses.size == 0
    film, rigid = big_end(make_body(Joint()))
    # Three of the frames of crank, rod and piston each, two of the journal in the bore.
    assert rigid.system.n == 11
    assert film.thickness.shape[1] == 2
    # The bore has the film's mesh.
    assert film.surfaces[0].maps._mortar is None


def test_a_machine_without_friction_computes_none(monkeypatch):
    def must_not(*arguments):
        raise AssertionError("not needed here")

    for module in (step_equations, quantities):
        monkeypatch.setattr(module, "film_friction", must_not)
    run = Run(slider_crank(rigid_rod(), *short_films()), IntegratorOptions(tolerance=1e-2), 1e-7)
    tracker = Recorder(run, 1e-7)
    rows = [tracker.add(step) for step in run.until(1e-7)]
    assert not any("friction" in name for row in rows for name in row)
