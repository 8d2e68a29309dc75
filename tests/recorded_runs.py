"""Short runs of shipped scenes in folders, as `fenics-ehd run` leaves them."""

import re
import tomllib
from types import SimpleNamespace

from csv_history import read_history
from mpi4py import MPI

from fenics_ehd.plotting.animation_shape import shape_of_part
from fenics_ehd.plotting.recorded import recorded
from fenics_ehd.reduction import BasisFile, save_basis
from fenics_ehd.results.part_fields import gather_part, part_of_basis
from fenics_ehd.results.progress import progress_bar
from fenics_ehd.scenes.build import build_mechanism
from fenics_ehd.scenes.given import with_method
from fenics_ehd.scenes.run import run_scene
from fenics_ehd.scenes.scene_file import shipped
from fenics_ehd.scenes.scene_text import as_stored

BASIS = "part.h5"


def short_run(directory, name, time, method=None, extra=""):
    """Run a shipped scene with another [time], once through.

    Attributes
    ----------
    run
        All its steps, see `recorded`.
    built, history
        What it was of, and its columns.
    parts, shapes
        Whole parts by name of their body, and what an animation shows of them.
    """
    text = shipped(name)
    order = tomllib.loads(text)["time"].get("order", 3)
    text = re.sub(r"(?ms)^\[time\].*?(?=^\[output\]|\Z)", "", text) + extra
    source = directory / "source.toml"
    source.write_text(f"{text}\n[time]\norder = {order}\n{time}\n")
    scene = as_stored(source)
    scene = with_method(scene, method) if method else scene
    built = build_mechanism(scene, MPI.COMM_SELF)
    run_scene(scene, built, directory, progress_bar(scene.span))
    found = SimpleNamespace(
        directory=directory, built=built, run=recorded(directory),
        history=read_history(directory), parts={}, shapes={},
    )  # fmt: skip
    for body, part in built.reduced.items():
        found.parts[body] = gather_part(part.structure, part.body, part.columns)
        save_basis(directory / BASIS, part.structure, part.columns, stress=False)
        with BasisFile(directory / BASIS) as file:
            found.shapes[body] = shape_of_part(part_of_basis(file, part.body))
    return found
