"""The fastest revolution of the slider-crank whose curves are within a limit of the full interface.

    python benchmarks/one_per_cent.py [--limit 1] [--repetitions 5] [--keep DIR]

Reference: every column of P_c1, step tolerance 1e-7, kept in DIR for another call. Each body then
runs at tolerances from loose to tight, its history written, until the largest error of peak
pressure (over its peak) and of minimum film (pointwise, from 0.2 ms on) is below the limit. That
run is repeated without a history, the bodies in turn. Seconds are processor time of the integration
alone: the reduction comes first and is not counted. The body with snapshots learns from a run of
the default body at a tolerance of 1e-3.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

from mpi4py import MPI
from tqdm import tqdm

from fenics_ehd.history_file import HistoryWriter
from fenics_ehd.reduction import ReducedBody, Reductor
from fenics_ehd.results import bore_constants
from fenics_ehd.scenes.rod import build_structure, reduce_structure
from fenics_ehd.scenes.run import Totals, simulate
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings
from fenics_ehd.settings import build
from fenics_ehd.study.curves import Errors, Reference, RunCurves

TOLERANCES = (1.2e-3, 1e-3, 8e-4, 7e-4, 6e-4, 5e-4, 4e-4, 3e-4, 2e-4, 1e-4, 1e-5)

#: Errors count from here on [s]: before, the film builds up from no pressure at all.
START = 2e-4

FULL = {"method": "full", "vibration_modes": 20}
BODIES: dict[str, dict[str, Any]] = {
    "M3, P_c2, lowest frequencies": {},
    "M3, 20 patterns of a former run": {
        "selection": "proper-orthogonal",
        "residual_modes": 20,
    },
    "M4": {"method": "m4"},
}


def settings_at(tolerance: float, reduction: dict[str, Any] | None = None) -> SliderCrankSettings:
    """The default scene."""
    tables = {"time": {"tolerance": tolerance}, "reduction": reduction or {}}
    return build(SliderCrankSettings, tables)


def recorded(folder: Path, body: ReducedBody, tolerance: float) -> tuple[RunCurves, Totals]:
    """A revolution, its history in a folder."""
    settings, totals = settings_at(tolerance), Totals()
    with HistoryWriter(folder, bore_constants(body)) as history:
        simulate(settings, body, totals, history.add)
    return RunCurves(folder, settings, body), totals


def once(body: ReducedBody, tolerance: float) -> float:
    """Seconds of a revolution [s]."""
    start = process_time()
    simulate(settings_at(tolerance), body, Totals())
    return process_time() - start


def within(
    limit: float, body: ReducedBody, reference: Reference
) -> tuple[float, Errors, Totals] | None:
    """The loosest tolerance whose errors are below the limit, and that run."""
    for tolerance in TOLERANCES:
        with TemporaryDirectory() as folder:
            run, totals = recorded(Path(folder), body, tolerance)
            errors = reference.errors(run, START)
        if max(errors.pressure_max, errors.film_max) <= limit:
            return tolerance, errors, totals
    return None


def make_reference(folder: Path, body: ReducedBody) -> Reference:
    """The full interface, run unless it is there."""
    if not (folder / "done").exists():
        recorded(folder, body, 1e-7)
        (folder / "done").touch()
    return Reference(folder, settings_at(1e-7), body)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--limit", type=float, default=1.0, help="of both errors [%%]")
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--keep", type=Path, help="folder for the reference")
    arguments = parser.parse_args()
    part = Reductor(build_structure(SliderCrankSettings(), MPI.COMM_SELF))

    def reduce(reduction: dict[str, Any]) -> ReducedBody:
        return reduce_structure(part, settings_at(1e-5, reduction).reduction)

    with TemporaryDirectory() as temporary:
        folder = Path(arguments.keep or temporary)
        reference = make_reference(folder / "reference", reduce(FULL))
        recorded(folder / "former", reduce({}), 1e-3)
        learned = {"snapshots": str(folder / "former")}
        bodies = {
            name: reduce(keys | learned if "selection" in keys else keys)
            for name, keys in BODIES.items()
        }
        found = {
            name: within(1e-2 * arguments.limit, body, reference)
            for name, body in tqdm(bodies.items(), leave=False)
        }
    names = [name for name, run in found.items() if run is not None]
    seconds: dict[str, list[float]] = {name: [] for name in names}
    for _ in range(arguments.repetitions):
        for name in names:
            seconds[name].append(once(bodies[name], found[name][0]))
    print("| body | coordinates | tolerance | steps | iterations | pressure | film | time |")
    print("|---|---|---|---|---|---|---|---|")
    for name, run in found.items():
        if run is None:
            print(f"| {name} | {bodies[name].modes} | not within {arguments.limit} % | | | | | |")
            continue
        tolerance, errors, totals = run
        print(
            f"| {name} | {bodies[name].modes} | {tolerance:.1g} | {totals.steps} | "
            f"{totals.newton_iterations} | {100 * errors.pressure_max:.2f} % | "
            f"{100 * errors.film_max:.2f} % | {median(seconds[name]):.2f} s |"
        )


if __name__ == "__main__":
    main()
