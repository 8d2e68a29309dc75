"""Error budgets beside true errors: one component at a time, and in total.

    python benchmarks/error_budget.py [--only four-bar ...] [--cache FOLDER]

Each row is a shipped scene, or one with some settings changed so that its references are quick. The
reference of a component differs from the run in that alone: a thirtieth of the tolerance; three
times as many cells of every film either way, at that tolerance in both; M4 in place of the method.
Of the film the reference of twice as many cells stands beside it: what that leaves tells how far
the reference itself is off. Steps are limited by a quarter of the largest of the run, too.
References are kept in a folder of JSON files and not run again.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from scene_runs import Parts, changed

from fenics_ehd.multibody.error_budget import QUANTITIES, judged
from fenics_ehd.multibody.periodic import Cycles
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.tracking import Tracker
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.scene import Scene

PIN, BIG, JOURNAL = "joints.rocker_end", "joints.big_end", "joints.bearing"
METHOD = "bodies.rod.reduction.method"

#: Shipped scene and what is changed, by name of the row.
SCENES: dict[str, tuple[str, Mapping[str, Any]]] = {
    "four-bar": ("four-bar", {}),
    "four-bar, thin oil, 16 x 3": (
        "four-bar",
        {f"{PIN}.cells": [16, 3], "lubricants.oil.viscosity": 0.02},
    ),
    "four-bar, 4-node 40 x 8": (
        "four-bar",
        {f"{PIN}.element": "bilinear", f"{PIN}.cells": [40, 8]},
    ),
    "four-bar, Barus": ("four-bar", {"lubricants.oil.barus": 2e-8}),
    "four-bar, groove": (
        "four-bar",
        {f"{PIN}.grooves": [[90.0, 20.0, 3e5]], f"{PIN}.cells": [18, 4]},
    ),
    "four-bar, rough": (
        "four-bar",
        {
            f"{PIN}.contact": {"journal_roughness": 0.5e-6, "bore_roughness": 0.5e-6},
            "lubricants.oil.viscosity": 0.02,
        },
    ),
    "four-bar, oval": ("four-bar", {f"{PIN}.bore_shape": {"ovality": 4e-6}}),
    "four-bar, loose": ("four-bar", {"time.tolerance": 1e-3}),
    "loaded-journal, 24 x 5": (
        "loaded-journal",
        {f"{JOURNAL}.cells": [24, 5], "time.tolerance": 5e-4, "time.periodicity": 1e-3},
    ),
    "loaded-journal-starved, 30 x 4": ("loaded-journal-starved", {f"{JOURNAL}.cells": [30, 4]}),
    "slider-crank-paper, 1e-4": ("slider-crank-paper", {"time.tolerance": 1e-4}),
    "slider-crank-paper, M1, 1e-4": (
        "slider-crank-paper",
        {"time.tolerance": 1e-4, METHOD: "m1"},
    ),
    "slider-crank, 20 x 5": ("slider-crank", {f"{BIG}.cells": [20, 5]}),
    "rotor-two-bearings": ("rotor-two-bearings", {}),
}

#: Of references: share of the tolerance, and of the largest step, which may be what limits a run's.
STRICT, SHORT = 30, 4

#: A true error is clear of its reference where it is above so many times what that of twice as many
#: cells leaves.
CLEAR = 2.0


class References:
    """Extremes of scenes, kept."""

    def __init__(self, folder: Path):
        self.folder, self.parts = folder, Parts()
        folder.mkdir(parents=True, exist_ok=True)

    def extremes(self, scene: Scene) -> dict[str, list[float]]:
        """Peak pressure and thinnest film of every joint."""
        text = json.dumps(scene.tables, sort_keys=True, default=str)
        digest = hashlib.sha256(text.encode()).hexdigest()[:16]
        path = self.folder / f"{digest}.json"
        if not path.exists():
            run, cycles = self.run(scene)
            tracker = Tracker(run.equations, run.norm)
            for step in run.until(scene.span) if cycles is None else cycles:
                tracker.begins(cycles)
                tracker.add(step)
            path.write_text(json.dumps(extremes_of(tracker)))
        found: dict[str, list[float]] = json.loads(path.read_text())
        return found

    def run(self, scene: Scene) -> tuple[Run, Cycles | None]:
        """At its start."""
        built, time = self.parts.build(scene), scene.time
        run = Run(built.mechanism, built.steps, scene.span)
        if not time.periodic:
            return run, None
        return run, Cycles(run, scene.span, time.periodicity, time.cycles)


def extremes_of(tracker: Tracker) -> dict[str, list[float]]:
    """Of every joint."""
    return {
        name: [getattr(found, quantity) for quantity in QUANTITIES]
        for name, found in tracker.extremes.items()
    }


def strict(scene: Scene) -> dict[str, Any]:
    """Short steps."""
    time = scene.time
    return {
        "time.tolerance": time.tolerance / STRICT,
        "time.largest_step": time.largest_step / SHORT,
    }


def finer(scene: Scene, run: Run, factor: int) -> dict[str, Any]:
    """Cells of all films times a factor."""
    cells = {p.name: p.film.film.parameters.grid.cells for p in run.equations.system.films}
    return {
        f"joints.{name}.cells": [factor * n for n in cells[name]]
        for name, _ in scene.joints_of(schema.LubricatedSettings)
    }


def reduced(scene: Scene) -> bool:
    """Whether M4 has more than a part of it."""
    return any(
        isinstance(body, schema.FlexibleSettings) and body.reduction.method != "m4"
        for body in scene.bodies.values()
    )


def judge(name: str, references: References) -> list[dict[str, Any]]:
    """True errors and estimates of a row's joints."""
    shipped, changes = SCENES[name]
    scene = changed(shipped, changes)
    run, cycles = references.run(scene)
    began = process_time()
    tracker, budget = judged(run, scene.span, cycles)
    whole = process_time() - began
    own = extremes_of(tracker)
    short = strict(scene)
    step = references.extremes(changed(scene, short))
    twice = references.extremes(changed(scene, short | finer(scene, run, 2)))
    thrice = references.extremes(changed(scene, short | finer(scene, run, 3)))
    basis, total = step, thrice
    if reduced(scene):
        basis = references.extremes(changed(scene, short | {METHOD: "m4"}))
        total = references.extremes(changed(scene, short | {METHOD: "m4"} | finer(scene, run, 3)))
    rows = []
    for joint, (values, *others) in (
        (joint, (own[joint], step[joint], twice[joint], thrice[joint], basis[joint], total[joint]))
        for joint in own
    ):
        for k, quantity in enumerate(QUANTITIES):
            value, s, f2, f3, b, t = values[k], *(other[k] for other in others)
            true = {
                "step_size": abs(value - s),
                "film_mesh": abs(s - f3),
                "basis": abs(s - b) if reduced(scene) else float("nan"),
                "total": abs(value - t),
            }
            rows.append(
                {
                    "scene": name,
                    "joint": joint,
                    "quantity": quantity,
                    "true": {key: error / value for key, error in true.items()},
                    "reference": abs(f2 - f3) / value,
                    "estimate": dict(budget.joints[joint][quantity]),
                    "cost": budget.seconds / (whole - budget.seconds),
                }
            )
    return rows


def line(row: Mapping[str, Any]) -> str:
    """Of the table."""
    cells = [row["scene"], row["joint"], row["quantity"].replace("_", " ")]
    for component in ("step_size", "film_mesh", "basis", "total"):
        true, estimate = row["true"][component], row["estimate"][component]
        if isinstance(estimate, str) or np.isnan(true):
            cells.append("")
            continue
        cells.append(f"{100 * true:.3f}, {100 * estimate:.3f}: {true / estimate:.2f}")
    return "| " + " | ".join([*cells, f"{100 * row['reference']:.3f}", f"{row['cost']:.2f}"]) + " |"


def main() -> None:
    """Print the table and its distribution."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", choices=SCENES, default=list(SCENES))
    parser.add_argument("--cache", type=Path, default=Path("results/error-budget"))
    arguments = parser.parse_args()
    references = References(arguments.cache)
    print("| scene | joint | quantity | step size | film mesh | basis | total | reference | cost |")
    print("|---|---|---|---|---|---|---|---|---|")
    ratios: dict[str, list[float]] = {}
    for name in arguments.only:
        for row in judge(name, references):
            print(line(row), flush=True)
            for component in ("step_size", "film_mesh", "basis", "total"):
                true, estimate = row["true"][component], row["estimate"][component]
                if not isinstance(estimate, str) and not np.isnan(true):
                    found = true / max(estimate, 1e-12)
                    ratios.setdefault(component, []).append(found)
                    if component == "total" and true > CLEAR * row["reference"]:
                        ratios.setdefault("total, clear of its reference", []).append(found)
    for component, found in ratios.items():
        values = np.array(found)
        print(
            f"{component}: {len(values)} judged, true over estimate from {values.min():.2f} to "
            f"{values.max():.2f}, median {np.median(values):.2f}; within a factor of 2 "
            f"{np.sum((values > 0.5) & (values < 2))}, above 2 {np.sum(values > 2)}"
        )


if __name__ == "__main__":
    main()
