"""The reductions of a study one by one, each of the assembled part, and from one Reductor.

    python benchmarks/reductor.py [--scene rotor-paper] [--quick] [--cells-along N]

Processor time of this process [s], one BLAS thread: `alone` factorises the part and computes all
that a body needs, `shared` is what it takes after those above it. Largest first, reductions with
the same pressure set in turn. `defect` is the largest difference of the bore flexibility that both
bodies follow, relative to the largest entry.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from time import process_time

import numpy as np
from mpi4py import MPI
from scene_runs import changed

from fenics_ehd.reduction import ReducedBody, Reductor, Structure
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.elastic_part import elastic_part
from fenics_ehd.scenes.part import reduce_structure
from fenics_ehd.scenes.part_settings import ReductionSettings


def reductions(quick: bool) -> Iterator[ReductionSettings]:
    """Those that share most beside each other."""
    for method in ("m1", "m2"):
        for modes in (127, 37) if quick else (127, 67, 37, 22):
            yield ReductionSettings(method, modes)
    for pressures in ("pc2",) if quick else ("pc1", "pc2", "journal"):
        for selection in ("lowest-frequency", "largest-eigenvalue"):
            for residual_modes in (31, 14) if quick else (100, 60, 31, 16, 8):
                yield ReductionSettings(
                    "m3",
                    residual_modes=residual_modes,
                    pressure_set=pressures,
                    selection=selection,
                )
    yield ReductionSettings("m4")
    yield ReductionSettings("full", vibration_modes=20)


def timed(part: Structure | Reductor, reduction: ReductionSettings) -> tuple[ReducedBody, float]:
    """A body, and the processor time for it."""
    start = process_time()
    body = reduce_structure(part, reduction)
    return body, process_time() - start


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", default="slider-crank-paper")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--cells-along", type=int, help="of the bore, for a larger part")
    arguments = parser.parse_args()
    scene = changed(arguments.scene, {})
    names = [
        name for name, body in scene.bodies.items() if isinstance(body, schema.FlexibleSettings)
    ]
    if arguments.cells_along:
        key = f"bodies.{names[0]}.geometry.bore_cells_along"
        scene = changed(scene, {key: arguments.cells_along})
    structure = elastic_part(scene.bodies[names[0]], names[0], "lagrange", MPI.COMM_SELF).source
    assert isinstance(structure, Structure)
    shared = Reductor(structure)
    print("method  set        selection            modes   alone  shared   defect")
    total = np.zeros(2)
    for reduction in reductions(arguments.quick):
        alone, first = timed(structure, reduction)
        ours, second = timed(shared, reduction)
        total += first, second
        wanted = alone.bore_flexibility()
        scale = max(np.abs(alone.missing_flexibility).max(initial=0.0), np.abs(wanted).max())
        defect = np.abs(ours.bore_flexibility() - wanted).max() / scale
        m3 = reduction.method == "m3"
        print(
            f"{reduction.method:7} {reduction.pressure_set if m3 else '':10} "
            f"{reduction.selection if m3 else '':20} {ours.modes:5d} {first:7.2f} {second:7.2f} "
            f"{defect:8.0e}",
            flush=True,
        )
    print(f"{structure.size} degrees of freedom, all together: {total[0]:17.2f} {total[1]:7.2f}")


if __name__ == "__main__":
    main()
