"""What a scene does not need is neither imported nor made."""

import subprocess
import sys

import pytest
from bench_machines import IntegratorOptions, Run, StepEquations, System, Tracker, step_equations
from hand_made_rod import Joint, flexible, make_body
from mechanism_cases import flexible_slider_crank, rigid_rod, short_films, slider_crank
from scene_cases import ROD_OF_A_FILE, write_scene

import fenics_ehd as ehd

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
import sys
from fenics_ehd.cli.main import main
try:
    main(sys.argv[1:])
except SystemExit as end:
    assert not end.code, end.code
print("\\n".join(sys.modules))
"""


def modules_after(*arguments):
    done = subprocess.run(
        [sys.executable, "-c", LIST_MODULES, *map(str, arguments)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return set(done.stdout.split("\n"))


@pytest.mark.parametrize(
    ("options", "may"),
    [
        (["--no-error-budget"], set()),
        ([], {"scipy.interpolate", "scipy.optimize"}),
    ],  # the former takes the latter along
)
def test_a_run_imports_what_its_scene_needs(options, may, tmp_path):
    ehd.save_body(make_body(Joint()), tmp_path / "rod.h5")
    times = {"time.revolutions": 0.001, "time.tolerance": 1e-3}
    scene = write_scene(tmp_path / "scene.toml", "slider-crank-paper", ROD_OF_A_FILE, times)
    loaded = modules_after("run", scene, "--no-plots", *options, "-o", tmp_path / "out")
    assert {name for name in NEVER if name in loaded} <= may


@pytest.mark.parametrize(
    "arguments", [["--help"], ["run", "--help"], ["bearing", "--help"], ["init", "slider-crank"]]
)
def test_help_needs_neither_solvers_nor_arrays(arguments):
    loaded, heavy = modules_after(*arguments), {"dolfinx", "petsc4py", "slepc4py", "gmsh"}
    assert not loaded & (heavy | {"matplotlib", "scipy", "numpy"})


def big_end(body):
    """The film of a big end, and the equations of its mechanism."""
    equations = StepEquations(System(flexible_slider_crank(body)))
    return equations.system.films[0].film, equations


def test_a_rod_without_residual_patterns_has_no_flexibility():
    _, equations = big_end(flexible(Joint())[0])
    assert not equations.responses.bodies
    assert equations.responses.size == 0


def test_a_rigid_rod_has_no_elastic_coordinates():
    film, equations = big_end(make_body(Joint()))
    # Three of the frames of crank, rod and piston each, two of the journal in the bore.
    assert equations.system.n == 11
    assert film.thickness.shape[1] == 2


def test_a_bore_with_the_films_mesh_needs_no_transfer():
    bore = big_end(make_body(Joint()))[0].bore
    assert bore._mortar is None


def test_a_machine_without_friction_computes_none(monkeypatch):
    def must_not(*arguments):
        raise AssertionError("not needed here")

    monkeypatch.setattr(step_equations, "film_friction", must_not)
    run = Run(slider_crank(rigid_rod(), *short_films()), IntegratorOptions(tolerance=1e-2), 1e-7)
    tracker = Tracker(run.equations, run.norm)
    rows = [tracker.add(step) for step in run.until(1e-7)]
    assert not any("friction" in name for row in rows for name in row)


def test_pictures_need_no_dolfinx():
    code = "import sys, fenics_ehd.plotting.pictures; assert 'dolfinx' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
