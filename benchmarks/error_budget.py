"""Error budgets compared with true errors: one component at a time, and in total.

    python benchmarks/error_budget.py [--only four-bar ...] [--cache FOLDER]

Each row is a shipped scene, or one with some settings changed so that its references are quick. The
reference of a component differs from the run in that alone: a thirtieth of the tolerance; three
times as many cells of every film either way, at that tolerance in both; M4 in place of the method.
For the film there is a second reference with twice as many cells: its difference is the error of
the first one. Steps are limited by a quarter of the largest of the run, too.
Extremes of runs and references are those of their summaries, between nodes and steps.

Scenes of many kinds (`--fresh`) are judged in total and by their steps, against one reference with
a tenth of the tolerance at most, twice as many cells, and M4. No constant was chosen on them but
the tolerance from which on steps are halved, on scenes like the first eight.

Shipped scenes as they are, but for some that are quick, are judged in total, against one reference
with a tenth of the tolerance and one and a half times as many cells; `reference` is then the error
budget of the reference.

`--figures` compares the errors of all figures of a joint on scenes with friction, heat, contact and
elastic rods, against one reference with a tenth of the tolerance at most, twice as many cells
(three times as many with mass-conserving cavitation), and M4 with every pressure.

References are kept in a folder of JSON files and not run again.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

import fenics_ehd as ehd
from fenics_ehd.analysis.error_budget import Estimator
from fenics_ehd.multibody.figures import figures_of, numbers
from fenics_ehd.multibody.periodic import PeriodicSolver
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.summary import RunSummary
from fenics_ehd.multibody.trust import QUANTITIES
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.scene import changed

PIN = "joints.rocker_end"
BIG = "joints.big_end"
JOURNAL = "joints.bearing"
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

#: A rigid rod, and a crank that a torque drives from a speed on.
RIGID_ROD: dict[str, Any] = {
    "bodies.rod": {
        "kind": "rigid",
        "mass": 0.973,
        "inertia": 4e-3,
        "centre": [0.0677, 0.0],
        "position": [0.048, 0.0],
        "points": {"pin": [0.16, 0.0]},
    },
    f"{BIG}.bore": "rod",
    f"{BIG}.radius": 0.0225,
    f"{BIG}.width": 0.022,
    f"{BIG}.cells": [20, 5],
}


def free(speed: float, torque: float, revolutions: float) -> dict[str, Any]:
    """A crank that a torque drives [N m] from a speed [rad/s] on."""
    return {
        "drives.crank": {"kind": "torque", "torque": torque},
        "bodies.crank.speed": speed,
        "time.periodic": False,
        "time.revolutions": revolutions,
    }


def near_whirl(mass: float, tolerance: float) -> dict[str, Any]:
    """A rotor's share of a bearing under an unbalance, whose nodding dies away slowly."""
    return {
        "bodies.journal": {"kind": "rigid", "mass": mass, "inertia": 1e-2},
        "forces.load": {"kind": "constant", "point": "journal", "force": [0.0, -200.0]},
        "forces.unbalance": {
            "kind": "rotating",
            "point": "journal",
            "amplitude": 60.0,
            "speed": 600.0,
        },
        "drives.journal": {"kind": "speed", "speed": 600.0},
        f"{JOURNAL}.cells": [24, 5],
        f"{JOURNAL}.eccentricity": [0.0, -0.4],
        "time.revolutions": 1.0,
        "time.tolerance": tolerance,
        "time.periodicity": 3e-4,
        "time.cycles": 60,
    }


def rough(*heights: float) -> dict[str, float]:
    """Surfaces of a journal and its bore [m]."""
    return dict(zip(("journal_roughness", "bore_roughness"), heights, strict=True))


#: Scenes of many kinds, judged against one reference.
FRESH: dict[str, tuple[str, Mapping[str, Any]]] = {
    "four-bar, 0.1": (
        "four-bar",
        {"time.tolerance": 0.1, "time.largest_step": 0.3, "time.periodicity": 0.04},
    ),
    "four-bar, 1e-2": ("four-bar", {"time.tolerance": 1e-2}),
    "journal, 0.9": (
        "loaded-journal",
        {f"{JOURNAL}.cells": [24, 5], "time.tolerance": 0.9, "time.periodicity": 1e-3},
    ),
    "journal, 1e-2": (
        "loaded-journal",
        {f"{JOURNAL}.cells": [24, 5], "time.tolerance": 1e-2, "time.periodicity": 1e-3},
    ),
    "four-bar, free": ("four-bar", free(60.0, 0.05, 2.0) | {"time.tolerance": 3e-3}),
    "four-bar, free, 1e-3": ("four-bar", free(60.0, 0.05, 2.0) | {"time.tolerance": 1e-3}),
    "slider-crank, free, 1 turn": (
        "slider-crank",
        RIGID_ROD | free(500.0, 20.0, 1.0) | {"time.tolerance": 3e-3},
    ),
    "slider-crank, free, 3 turns": (
        "slider-crank",
        RIGID_ROD | free(500.0, 20.0, 3.0) | {"time.tolerance": 3e-3},
    ),
    "slider-crank, rigid rod": ("slider-crank", RIGID_ROD | {"time.tolerance": 1e-3}),
    "near whirl, 100 kg": ("loaded-journal", near_whirl(100.0, 1e-3)),
    "near whirl, 130 kg": ("loaded-journal", near_whirl(130.0, 3e-4)),
    "four-bar, contact": (
        "four-bar",
        {
            f"{PIN}.contact": rough(0.8e-6, 0.4e-6),
            "lubricants.oil.viscosity": 0.01,
            "drives.crank.speed": 60.0,
            "time.tolerance": 1e-3,
        },
    ),
    "journal, contact": (
        "loaded-journal",
        {
            f"{JOURNAL}.contact": rough(0.6e-6, 0.6e-6),
            f"{JOURNAL}.cells": [32, 5],
            "forces.load.scale": 2.0,
            "time.tolerance": 1e-3,
            "time.periodicity": 1e-3,
        },
    ),
    "four-bar, Roelands": (
        "four-bar",
        {
            "lubricants.oil.roelands": 0.6,
            "drives.crank.speed": 200.0,
            f"{PIN}.cells": [28, 5],
            "time.tolerance": 2e-3,
        },
    ),
    "four-bar, barrel": (
        "four-bar",
        {
            f"{PIN}.bore_shape": {"barrel": 2e-6, "taper": 1e-6},
            f"{PIN}.cells": [20, 5],
            "time.tolerance": 1e-3,
        },
    ),
    "four-bar, wide": (
        "four-bar",
        {
            f"{PIN}.width": 0.02,
            f"{PIN}.cells": [20, 6],
            "drives.crank.speed": 150.0,
            "time.tolerance": 5e-4,
        },
    ),
    "journal, 4-node": (
        "loaded-journal",
        {
            f"{JOURNAL}.cells": [36, 6],
            f"{JOURNAL}.element": "bilinear",
            "time.tolerance": 1e-3,
            "time.periodicity": 1e-3,
        },
    ),
    "journal, 8-node": (
        "loaded-journal",
        {
            f"{JOURNAL}.cells": [20, 4],
            f"{JOURNAL}.element": "serendipity",
            "lubricants.oil.viscosity": 0.02,
            "time.tolerance": 2e-3,
            "time.periodicity": 1e-3,
        },
    ),
    "soft rod": (
        "slider-crank",
        {
            "bodies.rod.material.youngs_modulus": 70e9,
            "bodies.rod.material.density": 2700.0,
            "bodies.rod.geometry.big_end_wall": 0.008,
            "drives.crank.speed": 300.0,
            f"{BIG}.cells": [20, 5],
            "time.tolerance": 1e-3,
        },
    ),
    "journal, conserved": (
        "loaded-journal-starved",
        {f"{JOURNAL}.cells": [48, 4], "forces.load.scale": 0.7},
    ),
    "slider-crank, conserved": (
        "slider-crank",
        RIGID_ROD
        | {
            f"{BIG}.cells": [32, 4],
            f"{BIG}.element": "bilinear",
            f"{BIG}.cavitation": "mass-conserving",
            f"{BIG}.ambient_pressure": 1e5,
            "drives.crank.speed": 300.0,
            "time.tolerance": 1e-3,
            "time.order": 2,
        },
    ),
}
FRESH["soft rod, M3"] = ("slider-crank", {**FRESH["soft rod"][1], METHOD: "m3"})
SCENES |= FRESH

#: Of references of those: most of their tolerance and of their largest step, and cells either way.
FRESH_TOLERANCE = 1e-4
FRESH_STEP = 0.02
FRESH_FINE = 2

#: Of references: share of the tolerance, and of the largest step, which may be what limits a run's.
STRICT = 30
SHORT = 4

#: Shipped scenes as they are, judged in total alone: share of the tolerance, and cells either way,
#: of their reference.
SHIPPED = (
    "slider-crank",
    "slider-crank-both-ends",
    "loaded-journal",
    "loaded-journal-starved",
    "engine",
    "rotor",
)
SCENES |= {name: (name, {}) for name in SHIPPED}
LESS_STRICT = 10
LESS_FINE = 1.5

FRICTION = {f"{PIN}.friction": True}

#: Scenes on which the errors of all figures are judged.
FIGURES: dict[str, tuple[str, Mapping[str, Any]]] = {
    **{
        f"{name}, friction": ("four-bar", {**SCENES[name][1], **FRICTION})
        for name in ("four-bar, 1e-2", "four-bar, contact", "four-bar, Roelands")
    },
    "four-bar, barrel, friction": ("four-bar", {**SCENES["four-bar, barrel"][1], **FRICTION}),
    "slider-crank, rigid rod, friction": (
        "slider-crank",
        {**SCENES["slider-crank, rigid rod"][1], f"{BIG}.friction": True},
    ),
    "journal, heat": (
        "loaded-journal",
        {
            f"{JOURNAL}.cells": [24, 5],
            f"{JOURNAL}.friction": True,
            f"{JOURNAL}.heat": {"supply_temperature": 80.0},
            "lubricants.oil": {"grade": "SAE 10W-40"},
            "forces.load.scale": 0.7,
            "time.tolerance": 1e-3,
            "time.periodicity": 1e-3,
        },
    ),
    **{
        name: SCENES[name]
        for name in (
            "journal, 1e-2",
            "journal, contact",
            "journal, conserved",
            "near whirl, 100 kg",
            "soft rod",
            "slider-crank, 20 x 5",
            "slider-crank-paper, 1e-4",
            "slider-crank-paper, M1, 1e-4",
        )
    },
}

#: Further scenes with errors of all figures; no rule was chosen on them.
FIGURES |= {
    "four-bar, wide, friction": ("four-bar", {**SCENES["four-bar, wide"][1], **FRICTION}),
    "four-bar, rough, friction": ("four-bar", {**SCENES["four-bar, rough"][1], **FRICTION}),
    "journal, 8-node": SCENES["journal, 8-node"],
    "journal, 4-node": SCENES["journal, 4-node"],
    "slider-crank, free, 1 turn": SCENES["slider-crank, free, 1 turn"],
}
SCENES |= FIGURES

#: Cells either way of a reference over those of the run, if not `FRESH_FINE`: the error of a film
#: with mass-conserving cavitation falls slowly with the size of its cells.
MUCH_FINER = {"journal, conserved": 3}

#: Figures that repeat another one, or are proportional to it.
REPEATED = (
    "cycle_max_pressure_Pa",
    "cycle_min_film_thickness_m",
    "cycle_max_specific_load_Pa",
    "cycle_mean_specific_load_Pa",
)

#: Numbers by quantity of every joint.
Errors = dict[str, list[float]]

#: True error of a figure above which its estimate is counted: relative, or in radians.
CLEAR_TRUE = 3e-3

#: A true error is clear of its reference where it is above so many times what that of twice as many
#: cells leaves.
CLEAR = 2.0


@dataclass(frozen=True, eq=False)
class Done:
    """A run that has come to its end.

    Attributes
    ----------
    reported
        Peak pressure and thinnest film of every joint, as its summary has them.
    smooth
        The same of its curve between nodes and steps.
    estimator
        Of its errors.
    seconds
        Processor time [s].
    """

    extremes: dict[str, list[float]]
    estimator: Estimator
    seconds: float


def extremes_of(solved: Recorder) -> dict[str, list[float]]:
    """Of every joint."""
    return {
        name: [found[quantity][0] for quantity in QUANTITIES]
        for name, found in RunSummary(solved).extremes.items()
    }


def done(run: Run, span: float, cycles: PeriodicSolver | None) -> Done:
    """Of a run at its start."""
    solved = Recorder(run, span, cycles)
    before = process_time()
    deque(solved.steps(), maxlen=0)
    seconds = process_time() - before
    return Done(extremes_of(solved), Estimator(solved), seconds)


class References:
    """Extremes of scenes between nodes and steps, kept."""

    def __init__(self, folder: Path):
        self.folder = folder
        self._bodies = {}
        folder.mkdir(parents=True, exist_ok=True)

    def extremes(self, scene: ehd.Scene) -> dict[str, list[float]]:
        """Peak pressure and thinnest film of every joint."""
        return self._kept(scene, "smooth", lambda: self.done(scene).extremes)

    def figures(self, scene: ehd.Scene) -> dict[str, dict[str, float]]:
        """All figures of every joint."""

        def solve() -> dict[str, dict[str, float]]:
            run, cycles = self.run(scene)
            solved = Recorder(run, scene.span, cycles)
            deque(solved.steps(), maxlen=0)
            solved.add_reported()
            joints = RunSummary(solved).entries()["joints"]
            return {name: dict(numbers(joint)) for name, joint in joints.items()}

        figures: dict[str, dict[str, float]] = self._kept(scene, "figures", solve)
        return figures

    def with_budget(
        self, scene: ehd.Scene
    ) -> tuple[dict[str, list[float]], dict[str, list[float]]]:
        """The same, and the totals in the error budget of the reference."""

        def solve() -> list[dict[str, list[float]]]:
            found = self.done(scene)
            joints = found.estimator.budget().joints
            own = {name: [joints[name][key]["known"] for key in QUANTITIES] for name in joints}
            return [found.extremes, own]

        smooth, own = self._kept(scene, "judged", solve)
        return smooth, own

    def _kept(self, scene: ehd.Scene, kind: str, solve: Callable[[], Any]) -> Any:
        text = kind + json.dumps(scene.tables, sort_keys=True, default=str)
        path = self.folder / f"{hashlib.sha256(text.encode()).hexdigest()[:16]}.json"
        if not path.exists():
            path.write_text(json.dumps(solve()))
        return json.loads(path.read_text())

    def run(self, scene: ehd.Scene) -> tuple[Run, PeriodicSolver | None]:
        """At its start."""
        parts = {
            name: json.dumps(
                [scene.tables["bodies"][name], scene.film_element(name)],
                default=str,
                sort_keys=True,
            )
            for name, part in scene.bodies.items()
            if isinstance(part, schema.FlexibleSettings)
        }
        known = {name: self._bodies[key] for name, key in parts.items() if key in self._bodies}
        built = ehd.build(scene, bodies=known, cache=False)
        time = scene.time
        self._bodies |= {parts[name]: body for name, body in built.bodies.items()}
        run = Run(built.mechanism, built.steps, scene.span)
        if not time.periodic:
            return run, None
        return run, PeriodicSolver(run, scene.span, time.periodicity, time.cycles)

    def done(self, scene: ehd.Scene) -> Done:
        """To its end."""
        run, cycles = self.run(scene)
        return done(run, scene.span, cycles)


def minus(one: Errors, other: Errors) -> Errors:
    """Joint by joint."""
    return {
        name: [x - y for x, y in zip(own, other[name], strict=True)] for name, own in one.items()
    }


def strict(scene: ehd.Scene, share: float = STRICT) -> dict[str, Any]:
    """Short steps."""
    time = scene.time
    return {
        "time.tolerance": time.tolerance / share,
        "time.largest_step": time.largest_step / SHORT,
    }


def finer(scene: ehd.Scene, run: Run, factor: float) -> dict[str, Any]:
    """Cells of all films times a factor, an even number around."""
    cells = {p.name: p.film.film.parameters.grid.cells for p in run.equations.system.films}
    return {
        f"joints.{name}.cells": [
            2 * ceil(factor * cells[name][0] / 2),
            ceil(factor * cells[name][1]),
        ]
        for name in scene.films
    }


def reduced(scene: ehd.Scene) -> bool:
    """Whether M4 has more than a part of it."""
    return any(
        isinstance(body, schema.FlexibleSettings) and body.reduction.method != "m4"
        for body in scene.bodies.values()
    )


def judge(name: str, references: References) -> list[dict[str, Any]]:
    """True errors and estimates of a row's joints."""
    shipped, changes = SCENES[name]
    scene = ehd.read_scene(shipped, **changes)
    run, cycles = references.run(scene)
    found = done(run, scene.span, cycles)
    budget = found.estimator.budget()
    if name in FRESH:
        true, reference = against_two(scene, run, found, references)
    elif name in SHIPPED:
        true, reference = against_one(scene, run, found, references)
    else:
        true, reference = by_component(scene, run, found, references)
    return [
        {
            "scene": name,
            "joint": joint,
            "quantity": quantity,
            "true": {part: abs(errors[joint][k]) / reported[k] for part, errors in true.items()},
            "reference": reference[joint][k],
            "estimate": dict(budget.joints[joint][quantity]),
            "cost": budget.seconds / found.seconds,
        }
        for joint, reported in found.extremes.items()
        for k, quantity in enumerate(QUANTITIES)
    ]


def against_one(
    scene: ehd.Scene, run: Run, found: Done, references: References
) -> tuple[Errors, Errors]:
    """Totals against one reference, and the error budget of the reference."""
    values = strict(scene, LESS_STRICT) | finer(scene, run, LESS_FINE)
    smooth, own = references.with_budget(changed(scene, values))
    return {"total": minus(found.extremes, smooth)}, own


def against_two(
    scene: ehd.Scene, run: Run, found: Done, references: References
) -> tuple[dict[str, Errors], Errors]:
    """Totals against one reference, its error budget, and the errors of the steps."""
    time = scene.time
    short = {
        "time.tolerance": min(time.tolerance / LESS_STRICT, FRESH_TOLERANCE),
        "time.largest_step": min(time.largest_step / SHORT, FRESH_STEP),
        "time.periodicity": time.periodicity / LESS_STRICT,
    }
    if reduced(scene):
        short |= {METHOD: "m4"}
    smooth, own = references.with_budget(changed(scene, short | finer(scene, run, FRESH_FINE)))
    true = {"total": minus(found.extremes, smooth)}
    if not reduced(scene):
        true["step_size"] = minus(found.extremes, references.extremes(changed(scene, short)))
    return true, own


def by_component(
    scene: ehd.Scene, run: Run, found: Done, references: References
) -> tuple[dict[str, Errors], Errors]:
    """Errors by component, and what is left of those of the film's mesh with twice the cells."""
    short = strict(scene)
    step = references.extremes(changed(scene, short))
    twice = references.extremes(changed(scene, short | finer(scene, run, 2)))
    thrice = references.extremes(changed(scene, short | finer(scene, run, 3)))
    true = {
        "step_size": minus(found.extremes, step),
        "film_mesh": minus(step, thrice),
        "total": minus(found.extremes, thrice),
    }
    if reduced(scene):
        short |= {METHOD: "m4"}
        fine = references.extremes(changed(scene, short | finer(scene, run, 3)))
        true["basis"] = minus(step, references.extremes(changed(scene, short)))
        true["total"] = minus(found.extremes, fine)
    left = minus(twice, thrice)
    return true, {
        name: [abs(x) / y for x, y in zip(own, found.extremes[name], strict=True)]
        for name, own in left.items()
    }


def judge_figures(name: str, references: References) -> FigureRows:
    """True errors and estimates of all figures of a scene that have an estimated error.

    Errors of angles are in radians, those of temperatures relative to their rise above the supply,
    all others relative.
    """
    shipped, changes = FIGURES[name]
    scene = ehd.read_scene(shipped, **changes)
    if any(isinstance(part, schema.FlexibleSettings) for part in scene.bodies.values()):
        # References have the same mesh of the part.
        scene = changed(scene, {"output.part_mesh_error": False})
    run, cycles = references.run(scene)
    finer_cells = MUCH_FINER.get(name, FRESH_FINE)
    reference = references.figures(changed(scene, fine(scene, run, finer_cells)))
    before = process_time()
    solved = Recorder(run, scene.span, cycles)
    deque(solved.steps(), maxlen=0)
    solved.add_reported()
    seconds = process_time() - before
    budget = Estimator(solved).budget()
    summary = RunSummary(solved, budget.joints).entries()
    rows = []
    for figure in figures_of(summary):
        true = reference.get(figure.joint, {}).get(figure.name)
        if figure.error is None or true is None or figure.name in REPEATED:
            continue
        off = abs(figure.value - true)
        scale = abs(figure.value) or 1.0
        if figure.unit == "deg":
            off = abs((off + 180.0) % 360.0 - 180.0)
            scale = np.degrees(1.0)
        if figure.unit == "C":
            scale = abs(figure.value - summary["joints"][figure.joint]["supply_temperature_C"])
        rows.append((figure.joint, figure.name, off / scale, figure.error / scale))
    return FigureRows(name, rows, budget.seconds / seconds)


@dataclass(frozen=True)
class FigureRows:
    """Figures of a scene with their errors.

    Attributes
    ----------
    scene
        Name of the scene.
    rows
        Joint, name, true error and estimate of every figure.
    cost
        Time of the estimate over that of the run.
    """

    scene: str
    rows: list[tuple[str, str, float, float]]
    cost: float

    @property
    def ratios(self) -> dict[str, float]:
        """True error over its estimate, of figures with a true error above `CLEAR_TRUE`."""
        return {
            f"{joint}: {figure}": true / max(estimate, 1e-12)
            for joint, figure, true, estimate in self.rows
            if true > CLEAR_TRUE
        }

    @property
    def line(self) -> str:
        """Row of the table of scenes."""
        ratios = self.ratios
        worst = max(ratios, key=ratios.__getitem__, default="")
        largest = f"{ratios[worst]:.2f}, {worst}" if worst else ""
        over = sum(ratio < 0.5 for ratio in ratios.values())
        cells = (self.scene, len(self.rows), len(ratios), largest, over, f"{self.cost:.2f}")
        return f"| {' | '.join(map(str, cells))} |"


def fine(scene: ehd.Scene, run: Run, finer_cells: float) -> dict[str, Any]:
    """Settings of a reference for all figures, with cells of all films times a factor."""
    time = scene.time
    settings: dict[str, Any] = {
        "time.tolerance": min(time.tolerance / LESS_STRICT, FRESH_TOLERANCE),
        "time.largest_step": min(time.largest_step / SHORT, FRESH_STEP),
    }
    if time.periodic:
        settings["time.periodicity"] = time.periodicity / LESS_STRICT
    for body, part in scene.bodies.items():
        if isinstance(part, schema.FlexibleSettings):
            settings[f"bodies.{body}.reduction.method"] = "m4"
            settings[f"bodies.{body}.reduction.flexibility_tolerance"] = 0.0
    return settings | finer(scene, run, finer_cells)


def print_figures(names: list[str], references: References) -> None:
    """Print the errors of all figures of several scenes, and their distribution."""
    judged = []
    print("| scene | joint | figure | true | estimated |")
    print("|---|---|---|---|---|")
    for name in names:
        judged.append(judge_figures(name, references))
        for joint, figure, true, estimate in judged[-1].rows:
            print(f"| {name} | {joint} | {figure} | {true:.5f} | {estimate:.5f} |", flush=True)
    print("\n| scene | figures | above 0.3 % | largest ratio | too large by 2 | cost |")
    print("|---|---|---|---|---|---|")
    for each in judged:
        print(each.line)
    values = np.array([ratio for each in judged for ratio in each.ratios.values()])
    print(
        f"{sum(len(each.rows) for each in judged)} figures, {len(values)} with true errors above "
        f"{CLEAR_TRUE:g}: {np.sum(values > 2)} estimates too small by more than 2, "
        f"{np.sum(values < 0.5)} too large by more than 2, {np.sum(values < 1 / 3)} by more than "
        f"3; true over estimate from {values.min():.2f} to {values.max():.2f}, median "
        f"{np.median(values):.2f}"
    )


def estimate_of(row: Mapping[str, Any], component: str) -> Any:
    """Of a component, or all that are estimated: those of parts' meshes have no reference here."""
    found = row["estimate"]
    if component != "total":
        return found[component]
    part = found["part_mesh"]
    return found["known"] - (0.0 if isinstance(part, str) else part)


def line(row: Mapping[str, Any]) -> str:
    """Of the table."""
    cells = [row["scene"], row["joint"], row["quantity"].replace("_", " ")]
    for component in ("step_size", "film_mesh", "basis", "total"):
        true = row["true"].get(component)
        estimate = estimate_of(row, component)
        if true is None or isinstance(estimate, str):
            cells.append("")
            continue
        cells.append(f"{100 * true:.3f}, {100 * estimate:.3f}: {true / estimate:.2f}")
    return "| " + " | ".join([*cells, f"{100 * row['reference']:.3f}", f"{row['cost']:.2f}"]) + " |"


def main() -> None:
    """Print the table and its distribution."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", choices=SCENES, default=list(SCENES))
    parser.add_argument("--fresh", action="store_true", help="scenes of many kinds")
    parser.add_argument("--figures", action="store_true", help="errors of all figures")
    parser.add_argument("--cache", type=Path, default=Path("results/error-budget"))
    arguments = parser.parse_args()
    references = References(arguments.cache)
    if arguments.figures:
        chosen = [name for name in FIGURES if name in arguments.only]
        print_figures(chosen, references)
        return
    print("| scene | joint | quantity | step size | film mesh | basis | total | reference | cost |")
    print("|---|---|---|---|---|---|---|---|---|")
    ratios: dict[str, list[float]] = {}
    for name in FRESH if arguments.fresh else arguments.only:
        for row in judge(name, references):
            print(line(row), flush=True)
            for component in ("step_size", "film_mesh", "basis", "total"):
                true = row["true"].get(component)
                estimate = estimate_of(row, component)
                if true is not None and not isinstance(estimate, str):
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
