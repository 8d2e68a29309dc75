"""One scene, built and run in memory: prints processor seconds of both, steps and iterations.

    python benchmarks/house_case.py SCENE.toml

For `house.py`, which runs it in two checkouts: it takes the public names where there are any.
Imports are not counted, what a mechanism sets up is.
"""

import importlib
import json
import sys
from time import process_time


def run_by_modules(path: str) -> dict[str, float]:
    """As of the version before the public names."""
    from mpi4py import MPI

    from fenics_ehd.multibody import simulation
    from fenics_ehd.scenes.build import build_mechanism
    from fenics_ehd.scenes.scene_file import read_scene

    scene = read_scene(path)
    began = process_time()
    built = build_mechanism(scene, MPI.COMM_SELF)
    steps, names = built.steps, ("tolerance", "order", "first", "smallest", "largest")
    options = {name: getattr(steps, name) for name in names}
    if built.period is None:
        found = simulation.simulate(built.mechanism, built.end, **options)
    else:
        options["periodicity"] = scene.time.periodicity
        found = simulation.simulate_periodic(built.mechanism, built.period, **options)
    return {"seconds": process_time() - began, **found.summary}


def run_by_names(path: str) -> dict[str, float]:
    """As of today."""
    ehd = importlib.import_module("fenics_ehd")
    scene = ehd.read_scene(path)
    began = process_time()
    machine = ehd.build(scene)
    found = ehd.simulate(machine.mechanism, **machine.options)
    return {"seconds": process_time() - began, **found.summary()}


if __name__ == "__main__":
    named = hasattr(importlib.import_module("fenics_ehd"), "build")
    answer = (run_by_names if named else run_by_modules)(sys.argv[1])
    print(json.dumps({k: answer[k] for k in ("seconds", "steps", "newton_iterations")}))
