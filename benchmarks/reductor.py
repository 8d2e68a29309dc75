"""The reductions of a study one by one, each of the assembled part, and from one Reductor.

    python benchmarks/reductor.py [--scene rotor] [--quick] [--cells-along N]

Processor time of this process [s], one BLAS thread: `alone` factorises the part and computes all
that a body needs, `shared` is what it takes after those above it. Largest first, reductions with
the same pressure set in turn. `defect` is the largest difference of the bore flexibility that both
bodies follow, relative to the largest entry. Mesh and matrices, the same for all, stand below.
"""

from __future__ import annotations

import argparse
from time import process_time

import attrs
import numpy as np
from mpi4py import MPI

from fenics_ehd.reduction import ReducedBody, Reductor, Structure
from fenics_ehd.scenes import housing, rod
from fenics_ehd.scenes.part import METHOD_KEYS, reduce_structure
from fenics_ehd.scenes.slider_crank_settings import Reduction
from fenics_ehd.study.plan import make_study


def in_turn(study) -> list[Reduction]:
    """Every reduction of a study once, those that share most beside each other."""
    found = {}
    for run in study.runs.values():
        reduction = run.case.settings.reduction
        keys = METHOD_KEYS[reduction.method]
        found[reduction.method, *(getattr(reduction, key) for key in keys)] = reduction
    return sorted(
        found.values(),
        key=lambda r: (r.method, r.pressure_set, -r.vibration_modes, -r.modes, -r.residual_modes),
    )


def timed(part: Structure | Reductor, reduction: Reduction) -> tuple[ReducedBody, float]:
    """A body, and the processor time for it."""
    start = process_time()
    body = reduce_structure(part, reduction)
    return body, process_time() - start


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", choices=["slider-crank", "rotor"], default="slider-crank")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--cells-along", type=int, help="of the bore, for a larger part")
    arguments = parser.parse_args()
    study = make_study(arguments.scene, quick=arguments.quick)
    settings = study.settings
    if arguments.cells_along:
        name = "housing" if arguments.scene == "rotor" else "rod"
        part = getattr(settings, name)
        geometry = {**part.geometry, "bore_cells_along": arguments.cells_along}
        settings = attrs.evolve(settings, **{name: attrs.evolve(part, geometry=geometry)})
    build = {"slider-crank": rod, "rotor": housing}[arguments.scene].build_structure
    build(settings, MPI.COMM_SELF)  # compiles the forms
    start = process_time()
    structure = build(settings, MPI.COMM_SELF)
    assembly = process_time() - start
    shared = Reductor(structure)
    print("method  set        selection            modes   alone  shared   defect")
    total = np.zeros(2)
    for reduction in in_turn(study):
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
    print(f"mesh and matrices: {assembly:.2f} s")


if __name__ == "__main__":
    main()
