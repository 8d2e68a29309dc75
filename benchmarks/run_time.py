"""Run time of the slider-crank: what a scene pays for, and how time grows.

    python benchmarks/run_time.py [--extent 0.1] [--repetitions 3]

First a table of scenes from the rigid rod to M4 with a film mesh of its own: coordinates,
residual patterns, modules imported, arrays kept and time a step. Then time against the number
of modes, film nodes and the step tolerance, with the exponents. Processor time of one process,
medians, the variants in turn.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from time import process_time
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_ehd.reduction import ReducedBody, Reductor
from fenics_ehd.scenes.rod import build_structure, reduce_structure
from fenics_ehd.scenes.run import Totals, build_mechanism, simulate
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings
from fenics_ehd.settings import build

Tables = dict[str, dict[str, Any]]

#: Residual modes of M3 that time is measured against.
MODES = (0, 8, 31, 70, 120)
CELLS = ([10, 3], [20, 5], [30, 8], [40, 10], [60, 15])
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6)


class Rods:
    """One structure, reduced once for every method asked for."""

    def __init__(self) -> None:
        self._part = Reductor(build_structure(SliderCrankSettings(), MPI.COMM_SELF))
        self._bodies: dict[str, ReducedBody] = {}

    def body(self, **reduction: Any) -> ReducedBody:
        """Body for keys of [reduction]."""
        name = repr(sorted(reduction.items()))
        if name not in self._bodies:
            tables = {"reduction": {"estimate_error": False, **reduction}}
            settings = build(SliderCrankSettings, tables)
            self._bodies[name] = reduce_structure(self._part, settings.reduction)
        return self._bodies[name]


def scene(extent: float, tables: Tables) -> SliderCrankSettings:
    """The default scene over part of a revolution, with changes."""
    changed = {section: dict(keys) for section, keys in tables.items()}
    changed.setdefault("mechanism", {})["revolutions"] = extent
    return build(SliderCrankSettings, changed)


def run_once(settings: SliderCrankSettings, body: ReducedBody) -> tuple[float, Totals]:
    """Processor time of a run [s] and its figures."""
    began = process_time()
    totals = simulate(settings, body, Totals())
    return process_time() - began, totals


def measure(
    variants: dict[str, tuple[SliderCrankSettings, ReducedBody]], repetitions: int
) -> dict[str, tuple[float, Totals]]:
    """Median time of every variant, taken in turn."""
    times: dict[str, list[float]] = {name: [] for name in variants}
    figures = {}
    for _ in range(repetitions):
        for name, (settings, body) in variants.items():
            seconds, figures[name] = run_once(settings, body)
            times[name].append(seconds)
    return {name: (float(np.median(times[name])), figures[name]) for name in variants}


def kept_bytes(settings: SliderCrankSettings, body: ReducedBody) -> int:
    """Arrays that the joint of the mechanism keeps."""
    journal = build_mechanism(settings, body).journal
    owners = [journal, journal.bore, journal.compliance]
    arrays = [v for o in owners if o is not None for v in vars(o).values()]
    return sum(v.nbytes for v in arrays if isinstance(v, np.ndarray))


def table_of_scenes(rods: Rods, extent: float, repetitions: int) -> None:
    """What each scene pays for."""
    own: Tables = {"film": {"cells": [30, 7]}}
    mortar: Tables = {"film": {"cells": [30, 7], "transfer": "mortar"}}
    friction: Tables = {"film": {"friction": True}}
    rows: dict[str, tuple[Tables, dict[str, Any]]] = {
        "rigid": ({}, {"method": "rigid"}),
        "m1, 37": ({}, {"method": "m1", "modes": 37}),
        "m3, 31": ({}, {"method": "m3"}),
        "m3, film 30 x 7": (own, {"method": "m3"}),
        "m3, the same by mortar": (mortar, {"method": "m3"}),
        "m3, with friction": (friction, {"method": "m3"}),
        "m4": ({}, {"method": "m4"}),
    }
    variants = {
        name: (scene(extent, tables), rods.body(**keys)) for name, (tables, keys) in rows.items()
    }
    found = measure(variants, repetitions)
    print("| scene | coordinates | patterns | arrays | steps | iterations | ms a step |")
    print("|---|---|---|---|---|---|---|")
    for name, (seconds, totals) in found.items():
        settings, body = variants[name]
        patterns = 0 if body.residual is None else body.residual.rank
        print(
            f"| {name} | {2 + body.modes} | {patterns} | {kept_bytes(settings, body) / 1e6:.1f} MB "
            f"| {totals.steps} | {totals.newton_iterations} | {1e3 * seconds / totals.steps:.2f} |",
            flush=True,
        )


def growth(
    label: str,
    values: list[float],
    make: Callable[[int], tuple[SliderCrankSettings, ReducedBody]],
    repetitions: int,
    per_step: bool,
) -> None:
    """Time against one quantity, with the exponent of its larger half."""
    found = measure({str(i): make(i) for i in range(len(values))}, repetitions)
    seconds = [time / (totals.steps if per_step else 1) for time, totals in found.values()]
    print(f"\n| {label} | {'ms a step' if per_step else 's'} | steps |\n|---|---|---|")
    for value, time, (_, totals) in zip(values, seconds, found.values(), strict=True):
        print(f"| {value:g} | {1e3 * time if per_step else time:.2f} | {totals.steps} |")
    half = len(values) // 2
    exponent = np.polyfit(np.log(values[half:]), np.log(seconds[half:]), 1)[0]
    print(f"\nexponent {exponent:.2f}", flush=True)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--extent", type=float, default=0.1, help="of a revolution")
    parser.add_argument("--repetitions", type=int, default=3)
    arguments = parser.parse_args()
    extent, repetitions, rods = arguments.extent, arguments.repetitions, Rods()
    print(f"{len(sys.modules)} modules imported\n")
    table_of_scenes(rods, extent, repetitions)

    def with_modes(i: int) -> tuple[SliderCrankSettings, ReducedBody]:
        return scene(extent, {}), rods.body(
            method="m3", pressure_set="pc1", residual_modes=MODES[i]
        )

    def with_cells(i: int) -> tuple[SliderCrankSettings, ReducedBody]:
        return scene(extent, {"film": {"cells": CELLS[i]}}), rods.body(method="m3")

    def with_tolerance(i: int) -> tuple[SliderCrankSettings, ReducedBody]:
        return scene(extent, {"time": {"tolerance": TOLERANCES[i]}}), rods.body(method="m4")

    growth("coordinates (m3)", [10.0 + n for n in MODES], with_modes, repetitions, True)
    nodes = [2.0 * a * (2 * b + 1) for a, b in CELLS]
    growth("film nodes (m3)", nodes, with_cells, repetitions, True)
    growth("tolerance (m4)", list(TOLERANCES), with_tolerance, repetitions, False)


if __name__ == "__main__":
    main()
