"""One scene, built and run in memory: prints processor seconds of both, and counts.

    python benchmarks/house_case.py SCENE.toml

For `house.py`, which runs it in two checkouts: it takes the public names where there are any.
Imports are not counted, what a mechanism sets up is.
"""

import importlib
import json
import os
import sys
from importlib.util import find_spec
from time import process_time

os.environ["FENICS_EHD_CACHE"] = "off"  # parts are reduced


def run_by_modules(path: str) -> dict[str, float]:
    """As of the version before the public names."""
    from mpi4py import MPI

    from fenics_ehd.multibody import simulation

    build = importlib.import_module("fenics_ehd.scenes.build").build_mechanism
    module = "scene_file" if find_spec("fenics_ehd.scenes.scene_file") else "scene"
    scene = importlib.import_module(f"fenics_ehd.scenes.{module}").read_scene(path)
    began = process_time()
    built = build(scene, MPI.COMM_SELF)
    steps, names = built.steps, ("tolerance", "order", "first", "smallest", "largest")
    options = {name: getattr(steps, name) for name in names}
    if built.period is None:
        found = simulation.simulate(built.mechanism, built.end, **options)
    else:
        options["periodicity"] = scene.time.periodicity
        periodic = getattr(simulation, "simulate_periodic", None)
        found = (
            periodic(built.mechanism, built.period, **options)
            if periodic
            else simulation.simulate(built.mechanism, period=built.period, **options)
        )
    summary = found.summary() if callable(found.summary) else found.summary
    return {"seconds": process_time() - began, **summary}


def run_by_names(path: str) -> dict[str, float]:
    """As of today."""
    ehd = importlib.import_module("fenics_ehd")
    build, simulate = ehd.build, ehd.simulate
    for late in ("fenics_ehd.film.reynolds", "fenics_ehd.multibody.simulation"):
        importlib.import_module(late)
    scene = ehd.read_scene(path)
    began = process_time()
    machine = build(scene)
    found = simulate(machine.mechanism, **machine.options)
    return {"seconds": process_time() - began, **found.summary()}


if __name__ == "__main__":
    named = hasattr(importlib.import_module("fenics_ehd"), "build")
    answer = (run_by_names if named else run_by_modules)(sys.argv[1])
    keys = ("seconds", "steps", "newton_iterations", "counts")
    print(json.dumps({key: answer[key] for key in keys if key in answer}))
