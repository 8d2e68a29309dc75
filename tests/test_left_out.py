"""What a scene does not need is neither imported nor made."""

import subprocess
import sys

import numpy as np
import pytest
from hand_made_rod import Joint, flexible, make_body, make_mechanism

from fenics_ehd.multibody.coupled_equations import CoupledEquations
from fenics_ehd.reduction import save_body

#: Modules that no run with a ready body needs, and what each is for.
NEVER = {
    "gmsh": "meshes",
    "matplotlib": "pictures",
    "scipy.interpolate": "tables over time or angle",
    "scipy.optimize": "equilibrium of a bearing",
    "fenics_ehd.geometry": "meshes",
    "fenics_ehd.structure": "finite elements of the part",
    "fenics_ehd.paraview": "ParaView",
    "fenics_ehd.multibody.beam": "the rotor",
    "fenics_ehd.multibody.rotor": "the rotor",
    "fenics_ehd.multibody.massless_journal": "the loaded journal",
    "fenics_ehd.film.mass_conserving": "oil that is conserved",
    "fenics_ehd.film.mixed": "oil that is conserved",
    "fenics_ehd.bearing.equilibrium": "a bearing alone",
    "fenics_ehd.sweeps": "sweeps",
}

LIST_MODULES = """
import sys
from fenics_ehd.cli import main
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


def test_a_run_imports_what_its_scene_needs(tmp_path):
    save_body(make_body(Joint()), tmp_path / "rod.h5")
    (tmp_path / "scene.toml").write_text(
        'scene = "slider-crank"\n[mechanism]\nrevolutions = 0.001\n[time]\ntolerance = 1e-3\n'
    )
    loaded = modules_after(
        "run", tmp_path / "scene.toml", "--body", tmp_path / "rod.h5", "--no-plots",
        "-o", tmp_path / "out",
    )  # fmt: skip
    assert {name: use for name, use in NEVER.items() if name in loaded} == {}


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"], ["init", "slider-crank"]])
def test_help_needs_neither_solvers_nor_arrays(arguments):
    loaded = modules_after(*arguments)
    assert not loaded & {"dolfinx", "petsc4py", "slepc4py", "gmsh", "matplotlib", "scipy"}


def test_a_rod_without_residual_patterns_has_no_compliance():
    joint = Joint()
    mechanism = make_mechanism(flexible(joint)[0], joint)
    equations = CoupledEquations(mechanism, dense_patterns=True)
    assert mechanism.journal.compliance is None
    arrays = [v for v in vars(equations).values() if isinstance(v, np.ndarray)]
    # Nothing as wide as the film's nodes is high.
    assert all(array.ndim == 1 for array in arrays)


def test_a_rigid_rod_has_two_columns_and_no_stiffness():
    joint = Joint()
    mechanism = make_mechanism(make_body(joint), joint)
    journal = mechanism.journal
    assert journal.thickness.shape[1] == journal.mean_velocity.shape[1] == 2
    assert mechanism.size == 2


def test_a_bore_with_the_films_mesh_needs_no_transfer():
    joint = Joint()
    bore = make_mechanism(make_body(joint), joint).journal.bore
    assert bore.matching
    assert bore._mortar is None


def test_a_crank_at_constant_speed_computes_nothing_of_a_free_one(monkeypatch):
    from fenics_ehd.scenes import slider_crank

    def must_not(*arguments):
        raise AssertionError("not needed here")

    for name in ("FreeAngleJournal", "gas_forces", "piston_velocity", "film_friction"):
        monkeypatch.setattr(slider_crank, name, must_not)
    joint = Joint()
    mechanism = make_mechanism(flexible(joint)[0], joint)
    n = mechanism.size
    pressure = np.zeros(len(joint.pressure_nodes))
    found = mechanism.equations(0.0, *np.zeros((3, n)), (1e3, 1e6), pressure)
    assert found.shear is None
    assert found.state.crank.along is None
