"""Version 0.1's side of `mechanism_cost.py`, run in its environment: its modules are imported."""

# ruff: noqa: I001

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from time import process_time
from typing import Any

from mpi4py import MPI

from fenics_ehd.reduction import residual_flexibility
from fenics_ehd.scenes import housing, loaded_journal_run, rotor_run, run
from fenics_ehd.scenes.loaded_journal_settings import LoadedJournalSettings
from fenics_ehd.scenes.rod import reduce_rod
from fenics_ehd.scenes.rotor_settings import RotorSettings
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings
from fenics_ehd.scenes.transient import Totals
from fenics_ehd.settings import build

#: Settings of the slider-crank by what the case is called.
SLIDER_CRANKS: dict[str, dict[str, Any]] = {
    "": {},
    ", film 40 x 10": {"film": {"cells": [40, 10]}, "time": {"tolerance": 1e-4}},
    ", film 80 x 20": {"film": {"cells": [80, 20]}, "time": {"tolerance": 1e-4}},
    ", no damping": {"rod": {"damping_time": 0.0}, "time": {"tolerance": 1e-4}},
}


def make(case: str) -> Callable[[Callable[[int], None]], Any]:
    """A run, which calls its argument with the iterations of every step."""
    if case == "rotor m4":
        settings = build(RotorSettings, {"force": {"ramp": 0.5}})
        body = residual_flexibility(housing.build_structure(settings, MPI.COMM_SELF), 10)
        return lambda done: rotor_run.simulate(
            settings, body, Totals(), progress=lambda _, step: done(step.newton_iterations)
        )
    if case == "loaded journal":
        journal = LoadedJournalSettings()
        return lambda done: loaded_journal_run.simulate(
            journal, loaded_journal_run.OrbitTotals(), progress=lambda _: done(0)
        )
    name = case.removeprefix("slider-crank ")
    tables = {"reduction": {"method": name[:2]}, **SLIDER_CRANKS[name[2:]]}
    crank = build(SliderCrankSettings, tables)
    rod = reduce_rod(crank).body
    return lambda done: run.simulate(
        crank, rod, Totals(), progress=lambda _, step: done(step.newton_iterations)
    )


def main() -> None:
    """Answer lines ``case, cycles`` on stdin."""
    codes = {}
    for line in sys.stdin:
        case, _ = json.loads(line)
        if case not in codes:
            codes[case] = make(case)
        marks, iterations = [process_time()], []

        def done(count: int, marks: list = marks, iterations: list = iterations) -> None:
            marks.append(process_time())
            iterations.append(count)

        codes[case](done)
        print(json.dumps([marks, iterations]), flush=True)


if __name__ == "__main__":
    main()
