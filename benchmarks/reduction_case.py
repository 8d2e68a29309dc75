"""One reduction of one rod, timed: run by `reduction.py` in a process or under mpirun of its own.

Prints a line of JSON: degrees of freedom, seconds of the reduction alone, peak memory of every
rank before and after it, and figures of the result to compare.
"""

from __future__ import annotations

import argparse
import json
import resource
from time import perf_counter, process_time

import numpy as np
from mpi4py import MPI
from reduction_scipy import SCIPY_METHODS

import fenics_ehd as ehd
from fenics_ehd.reduction import two_step_craig_bampton
from fenics_ehd.scenes.part import body_counts, elastic_part

#: No error estimate: that is one more block of solves for every method but M4.
METHODS = {
    "m1-37": lambda part: ehd.craig_bampton(part, 37, estimate_error=False),
    "m1-127": lambda part: ehd.craig_bampton(part, 127, estimate_error=False),
    "m2-37": lambda part: two_step_craig_bampton(part, 37, 20, estimate_error=False),
    "m3-pc2": lambda part: ehd.load_dependent(part, 6, 31, estimate_error=False),
    "m3-pc1": lambda part: ehd.load_dependent(part, 6, 31, "pc1", estimate_error=False),
    "m4": lambda part: ehd.residual_flexibility(part, 6, estimate_error=False),
}


def geometry(size: int) -> dict[str, float]:
    """Mesh parameters of about `size` degrees of freedom, 20 cells around the bore."""

    def cells(t: float) -> tuple[int, int, int]:
        return max(1, round(5 * t)), max(1, round(2 * t**1.3)), max(2, round(12 * t**1.28))

    def count(t: float) -> float:
        along, layers, shank = cells(t)
        # Nodes of the corners and edges of blocks along x layers x length.
        around = 36 * layers + 4 * shank
        return 3 * (4 * around * along + 1.3 * around + 1.2 * (20 + 16) * along + 60 * along)

    low, high = 0.3, 12.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if count(middle) <= size else (low, middle)
    along, layers, shank = cells(low)
    return {
        "bore_cells_along": along,
        "big_end_layers": layers,
        "small_end_layers": layers,
        "shank_cells": shank,
    }


def peak_memory() -> float:
    """Largest memory of this process so far [bytes]."""
    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def make(size: int) -> ehd.Structure:
    """Rod of about `size` degrees of freedom, over all ranks."""
    cells = {f"bodies.rod.geometry.{name}": value for name, value in geometry(size).items()}
    rod = ehd.read_scene("slider-crank-paper", **cells).bodies["rod"]
    source = elastic_part(rod, "rod", "lagrange", MPI.COMM_WORLD).source
    assert isinstance(source, ehd.Structure)
    return source


def main() -> None:
    """Reduce once and print what it took."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program", choices=["fenics_ehd", "scipy"])
    parser.add_argument("method", choices=METHODS)
    parser.add_argument("size", type=int)
    parser.add_argument("--solver", default="auto")
    arguments = parser.parse_args()
    comm = MPI.COMM_WORLD
    structure = make(arguments.size)
    before = comm.gather(peak_memory())
    comm.barrier()
    start = perf_counter()
    start_of_process = process_time()
    counts = {}
    if arguments.program == "scipy":
        frequencies, flexibility = SCIPY_METHODS[arguments.method](structure)
    else:
        body = METHODS[arguments.method](ehd.Reductor(structure, solver=arguments.solver))
        frequencies, flexibility = body.frequencies, body.basis_flexibility()
        counts = body_counts(body)
    comm.barrier()
    seconds = perf_counter() - start
    processor_seconds = process_time() - start_of_process
    after = comm.gather(peak_memory())
    if comm.rank == 0:
        result = {
            "size": structure.size,
            "seconds": seconds,
            "processor_seconds": processor_seconds,
            "counts": counts,
            "memory_before": before,
            "memory": after,
            "lowest_Hz": float(frequencies[0]),
            "flexibility": float(np.linalg.norm(flexibility)),
        }
        print(json.dumps(result), flush=True)


if __name__ == "__main__":
    main()
