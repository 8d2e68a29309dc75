"""Mechanisms with elastohydrodynamically lubricated revolute joints: the public names.

    import fenics_ehd as ehd

    scene = ehd.read_scene("slider-crank", **{"time.tolerance": 1e-4})
    machine = ehd.build(scene)
    history = ehd.simulate(machine.mechanism, **machine.options)

The module of a public name is imported when the name is first used. Therefore `import fenics_ehd`
is fast, `fenics_ehd.reduction` works without dolfinx, and ``fenics-ehd --help`` without PETSc.
"""

import sys

if sys.argv[:1] == ["-m"]:  # Python is still looking for the module to run: fenics_ehd.cli
    from fenics_ehd.base.command_start import leave_current_folder

    leave_current_folder()

from importlib import import_module
from typing import Any

from fenics_ehd.base.lazy import lazily
from fenics_ehd.base.libraries import load_mpi_first, require_matching_numpy

require_matching_numpy()
load_mpi_first()

__version__ = "0.4.0.dev0"

#: Public names by the module that defines them.
_NAMES = {
    "analysis.bearing_settings": ("BearingSettings",),
    "analysis.equilibrium": ("equilibrium", "linearise"),
    "analysis.error_budget": ("error_budget",),
    "analysis.multiplier": ("multiplier",),
    "analysis.replay": ("replay",),
    "analysis.sensitivity": ("sensitivity",),
    "base.shared_settings": ("Material",),
    "fem.models": ("model_path",),
    "fem.structure": ("assemble_structure", "build_mesh"),
    "film.film": ("Film",),
    "film.heat": ("Heat",),
    "film.grid": ("FilmGrid", "film_grid", "uniform_grid"),
    "film.kinematics": ("Shape", "ShapeTable", "ShaftMotion", "shaft_gap"),
    "film.lubricant": ("Barus", "Cross", "DowsonHigginson", "Lubricant", "Oil", "Roelands"),
    "film.parameters": ("FilmParameters",),
    "film.rough_surfaces": ("RoughSurfaces",),
    "film.supply": (
        "AxialGroove",
        "AxialGrooveSupply",
        "CircumferentialGrooveSupply",
        "HoleSupply",
        "Sides",
    ),
    "multibody.body": ("FlexibleBody", "MasslessBody", "RigidBody", "ground"),
    "multibody.forces": ("PointForce", "RotatingForce", "SpringDamper", "Torque", "Unbalance"),
    "multibody.history": ("History", "load_history", "load_results"),
    "multibody.joints": ("Fixed", "Revolute", "Slider", "Speed"),
    "multibody.elastic_bore": ("BoreFilm",),
    "multibody.lubricated_joint": ("LubricatedJoint",),
    "multibody.mechanism": ("Mechanism",),
    "multibody.quantities": ("quantity",),
    "multibody.shaft": ("ModalRotor", "Shaft", "ShaftBody"),
    "multibody.simulation": ("simulate",),
    "plotting.pictures": ("plot",),
    "reduction.body": ("ReducedBody", "load_body", "save_body"),
    "reduction.bore": ("bore_from_faces",),
    "reduction.fixed_interface_modes": ("craig_bampton",),
    "reduction.foreign_matrices": ("read_abaqus", "read_ansys", "read_calculix"),
    "reduction.matrix_check": ("check_matrices",),
    "reduction.nastran_matrices": ("read_dmig", "read_op4"),
    "reduction.load_dependent_basis": ("full_interface", "load_dependent"),
    "reduction.reductor": ("Reductor",),
    "reduction.residual_completion": ("residual_flexibility",),
    "reduction.structure": ("Structure",),
    "scenes.bearing": ("bearing", "solve_bearing"),
    "scenes.bearing_map": ("bearing_map",),
    "scenes.build": ("Machine", "build"),
    "scenes.rotor_map": ("rotor_map",),
    "scenes.run": ("run",),
    "scenes.scene": ("Scene", "read_scene"),
    "scenes.tables": ("read_load",),
    "study.sweep": ("sweep",),
}
#: Present names of public names by the former name, which is accepted with a warning until 0.5.
_FORMER: dict[str, str] = {}

_public = lazily(__name__, _NAMES, _FORMER)

__all__ = ["__version__", "errors", *(name for names in _NAMES.values() for name in names)]


def __dir__() -> list[str]:
    """Names of the module, among them the public names whose modules are not imported yet."""
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> Any:
    """Return a public name of the package; the public name `errors` is a module."""
    return import_module(f"{__name__}.base.errors") if name == "errors" else _public(name)
