"""SNES-VI against other solvers of the cavitation problem: time, accuracy, growth with the mesh.

    OPENBLAS_NUM_THREADS=1 python benchmarks/cavitation_solvers.py [--largest 160] [--rounds 5]

A rigid bearing with L/D = 1. Every time is that from a given gap to its pressure,
assembly included, in processor time (one thread), which other programs disturb least.
"cold" knows nothing; "warm" starts from the pressure of a shaft that stood a small
step beside. All solvers take their turn in every round, so that a busy machine
slows them alike; medians of the rounds. Outside the clock: symbolic
factorisation and the colouring, made once in the life of a film, and the
over-relaxation factor.

"nested" means a cold start from coarser meshes, which is how `Film.solve` starts
by itself. The other solvers are shown with it too: what the start saves is not
the merit of SNES-VI.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from time import process_time

import numpy as np
from bearing_problem import TOLERANCE, BearingProblem
from film_solvers import (
    PetscLinearSolver,
    Solution,
    block_pivot,
    colour,
    complementarity_residual,
    penalty,
    projected_sor,
    relaxation_factor,
)

from fenics_ehd.film.active_set import GENERAL_OPTIONS, LARGE, LARGE_OPTIONS, SYMMETRIC_OPTIONS

CELLS = ((20, 5), (40, 10), (80, 20), (160, 40), (320, 80))
CASES = (("serendipity", CELLS[:1]), ("lagrange", CELLS), ("bilinear", CELLS))

#: How far the shaft has moved since the warm start, in clearances: at an eccentricity of 0.6
#: about the angle of a 450th of a revolution.
CHANGE = np.array([2e-3, 8e-3])

#: Keeps the load to 2e-9 on these meshes up to an eccentricity of 0.95; 1e-6, to 2e-7, is as fast.
EPSILON = 1e-8

#: What takes longer is measured once [s].
LONG = 5.0

#: A relaxation that is not done by then is given up [s].
TIME_LIMIT = 20.0

#: From the pressure of a start (or None) to a solution.
Run = Callable[[np.ndarray | None], Solution]


@dataclass(frozen=True, eq=False)
class Measurement:
    """One solver on one problem: seconds (median), and its last solution."""

    seconds: float
    solution: Solution
    residual: float
    load: float


def linear_options(size: int, symmetric: bool) -> dict[str, str]:
    """Those that SNES-VI uses for the whole film."""
    if not symmetric:
        return GENERAL_OPTIONS
    return LARGE_OPTIONS if size >= LARGE else SYMMETRIC_OPTIONS


def competitors(problem: BearingProblem) -> dict[str, Run]:
    """Solvers by name, each from the gap of the problem to the pressure."""
    printed, _ = problem.printed_system()
    mass = problem.mass
    options = linear_options(len(problem.film.free), symmetric=mass is None)
    direct, fixed = PetscLinearSolver(options), PetscLinearSolver(options)
    colouring = colour(printed)
    # N^-1 A is not symmetric and has no Young's factor: plain Gauss-Seidel.
    factor = relaxation_factor(printed) if mass is None else 1.0

    def run(solver: Callable[..., Solution], *arguments: object, **options: object) -> Run:
        def from_gap(guess: np.ndarray | None) -> Solution:
            return solver(*problem.system(), guess, TOLERANCE, *arguments, **options)

        return from_gap

    def relax(guess: np.ndarray | None) -> Solution:
        options = {"factor": factor, "colouring": colouring, "time_limit": TIME_LIMIT}
        return projected_sor(*problem.printed_system(), guess, TOLERANCE, **options)

    return {
        "SNES-VI": problem.snes_vi,
        "block pivots": run(block_pivot, direct, mass=mass),
        "Goenka": run(block_pivot, direct, mass=mass, patience=None),
        "penalty": run(penalty, fixed, mass=mass, epsilon=EPSILON),
        f"PSOR {factor:.3f}": relax,
    }


def measure(
    problem: BearingProblem, runs: dict[str, Callable[[], Solution]], rounds: int
) -> dict[str, Measurement]:
    """Run all in turn, round after round."""
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    solutions: dict[str, Solution] = {}
    for _ in range(rounds):
        for name, run in runs.items():
            if name in solutions and seconds[name][-1] > LONG:
                continue
            start = process_time()
            solutions[name] = run()
            seconds[name].append(process_time() - start)
    matrix, rhs = problem.printed_system()
    return {
        name: Measurement(
            median(seconds[name]),
            solution,
            complementarity_residual(matrix, rhs, solution.pressure),
            problem.load(solution.pressure),
        )
        for name, solution in solutions.items()
    }


def cold_and_warm(
    family: str, cells: tuple[int, int], eccentricity: float, rounds: int
) -> tuple[BearingProblem, dict[str, dict[str, Measurement]]]:
    """All solvers from nothing, from coarser meshes, and from a neighbouring state."""
    problem = BearingProblem.create(family, cells, eccentricity)
    solvers = competitors(problem)
    former = problem.moved(-CHANGE).snes_vi(problem.nested_start()).pressure
    starts: dict[str, Callable[[], np.ndarray | None]] = {
        "cold": lambda: None,
        "cold, nested": problem.nested_start,
        "warm": lambda: former,
    }
    if problem.nested_start() is None:
        del starts["cold, nested"]
    results = {}
    for label, start in starts.items():
        runs = {name: (lambda r=run, s=start: r(s())) for name, run in solvers.items()}
        results[label] = measure(problem, runs, rounds)
    return problem, results


def print_case(problem: BearingProblem, results: dict[str, dict[str, Measurement]]) -> None:
    """One block of the table."""
    family, cells, nodes = problem.grid.family, problem.grid.cells, problem.film.assembly.size
    print(
        f"\n{family} {cells[0]} x {cells[1]}: {nodes} nodes, {len(problem.film.free)} of them free"
    )
    print("start         solver        time [ms]  iterations  residual  load [N]      x SNES-VI")
    for label, measurements in results.items():
        unit = measurements["SNES-VI"].seconds
        for name, m in measurements.items():
            mark = " " if m.solution.converged else ">"
            print(
                f"{label:12s}  {name:12s} {mark}{1e3 * m.seconds:10.2f}  "
                f"{m.solution.iterations:10d}  {m.residual:8.1e}  {m.load:12.5f}  "
                f"{mark}{m.seconds / unit:8.2f}"
            )


def print_ratios(family: str, cases: list[tuple[int, dict[str, dict[str, Measurement]]]]) -> None:
    """Cold times over that of `Film.solve`, which starts from coarser meshes; warm times too."""
    print(f"\n{family}: time over that of SNES-VI as Film.solve uses it")
    for start in ("cold", "warm"):
        for nodes, results in cases:
            # The coarsest mesh has no coarser one to start from.
            own = (
                results.get("cold, nested", results["cold"]) if start == "cold" else results[start]
            )
            unit = own["SNES-VI"].seconds
            ratios = (
                f"{name} {'' if m.solution.converged else '>'}{m.seconds / unit:.2f}"
                for name, m in results[start].items()
                if not (start == "warm" and name == "SNES-VI")
            )
            print(f"{start:5s} {nodes:7d} nodes:  {',  '.join(ratios)}")


def print_growth(family: str, cases: list[tuple[int, dict[str, dict[str, Measurement]]]]) -> None:
    """Exponents of time against nodes, least squares in logarithms."""
    times: dict[tuple[str, str], list[tuple[int, float]]] = {}
    for nodes, results in cases:
        for label, measurements in results.items():
            for name, m in measurements.items():
                if m.solution.converged:
                    times.setdefault((label, name.split(" 1.")[0]), []).append((nodes, m.seconds))
    print(f"\n{family}: time ~ nodes^k")
    for (label, name), points in times.items():
        if len(points) > 1:
            nodes, seconds = np.log(np.array(points)).T
            slope = np.polyfit(nodes, seconds, 1)[0]
            print(f"{label:12s}  {name:12s}  k = {slope:.2f}   ({len(points)} meshes)")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--largest", type=int, default=320, help="cells around, at most")
    parser.add_argument("--rounds", type=int, default=5, help="measurements of each")
    parser.add_argument("--eccentricity", type=float, default=0.6, help="ratio")
    arguments = parser.parse_args()
    print(
        f"eccentricity {arguments.eccentricity}, tolerance {TOLERANCE:.0e}, penalty {EPSILON:.0e}"
    )
    for family, meshes in CASES:
        cases = []
        for cells in meshes:
            if cells[0] > arguments.largest:
                continue
            problem, results = cold_and_warm(
                family, cells, arguments.eccentricity, arguments.rounds
            )
            print_case(problem, results)
            cases.append((problem.film.assembly.size, results))
        print_ratios(family, cases)
        if len(cases) > 1:
            print_growth(family, cases)


if __name__ == "__main__":
    main()
