"""Short runs of shipped scenes in folders, as `fenics-ehd run` leaves them."""

from types import MappingProxyType, SimpleNamespace

from scene_cases import write_scene

import fenics_ehd as ehd
from fenics_ehd.plotting.animated_bodies import shape_of_part
from fenics_ehd.plotting.shown import recorded
from fenics_ehd.reduction.part_files import BasisFile, save_basis
from fenics_ehd.results.paraview import gather_part, part_of_basis
from fenics_ehd.scenes.run import run_scene
from fenics_ehd.scenes.scene import as_stored

SOURCE, BASIS = "source.toml", "part.h5"


def short_run(directory, name, changes=MappingProxyType({}), *, budget=False, **time):
    """Run a shipped scene with changes and another [time], once through.

    Without an error budget, unless it is asked for.

    Attributes
    ----------
    run
        All its steps, see `recorded`.
    built, result
        What it was of, and its results.
    parts, shapes
        Whole parts by name of their body, and what an animation shows of them.
    """
    order = ehd.read_scene(name).time.order
    own = {"time": {"order": order, **time}, "output.error_budget": budget}
    scene = as_stored(write_scene(directory / SOURCE, name, changes, own))
    built = ehd.build(scene)
    run_scene(scene, built, directory)
    return _read(directory, built)


def stored_run(directory):
    """Run that `short_run` has left in a folder."""
    return _read(directory, ehd.build(as_stored(directory / SOURCE)))


def _read(directory, built):
    found = SimpleNamespace(
        directory=directory, built=built, run=recorded(directory), parts={}, shapes={},
        result=ehd.load_results(directory),
    )  # fmt: skip
    for body, part in built.reduced.items():
        found.parts[body] = gather_part(part.structure, part.body, part.columns)
        save_basis(directory / BASIS, part.structure, part.columns, stress=False)
        with BasisFile(directory / BASIS) as file:
            found.shapes[body] = shape_of_part(part_of_basis(file, part.body))
    return found
