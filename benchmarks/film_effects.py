"""What each model of a real film changes in two machines, alone and together.

    python benchmarks/film_effects.py [--scene engine] [--only heat]

The periodic slider-crank and the shipped engine, every lubricated joint with the model. Baseline:
smooth round surfaces, oil of 0.01 Pa s whatever its pressure, temperature and shear rate,
Reynolds' condition, no supply; friction acts in all of them. Films that conserve their oil have
4-node cells, whose baseline is a row of its own. Flow is what leaves the film (`oil_leaving`).
"""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from time import process_time
from typing import Any

from scene_runs import Parts
from scipy.integrate import trapezoid

from fenics_ehd.base.errors import EhdError
from fenics_ehd.film.flow import oil_leaving
from fenics_ehd.multibody.periodic import Cycles
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.scenes.build import Built
from fenics_ehd.scenes.scene_file import scene_of, shipped

#: ISO VG 46, 0.01 Pa s at 76.7 degrees.
GRADE = {"grade": "ISO VG 46", "density": 870.0}
SUPPLY = 76.7

#: Tables of the oil and of every lubricated joint by what the row is called.
MODELS: dict[str, tuple[Mapping[str, Any], Mapping[str, Any]]] = {
    "none": ({}, {}),
    "Barus, 1.5e-8 1/Pa": ({"barus": 1.5e-8}, {}),
    "shear thinning, 1e6 1/s, to half": (
        {"cross_rate": 1e6, "cross_second_viscosity": 0.5},
        {},
    ),
    "half the viscosity": ({"viscosity": 0.005}, {}),
    "heat": (GRADE, {"heat": {"supply_temperature": SUPPLY}}),
    "heat, effective at the outlet": (
        GRADE,
        {"heat": {"supply_temperature": SUPPLY, "mixing": 1.0}},
    ),
    "4-node cells": ({}, {"element": "bilinear"}),
    "oil conserved, sides at 1 bar of oil": (
        {},
        {"element": "bilinear", "cavitation": "mass-conserving", "ambient_pressure": 1e5},
    ),
    "hole in the bore at 90 degrees, 3 bar": (
        {},
        {"supply": {"inlet": {"kind": "hole", "angle": 90.0, "diameter": 6e-3, "pressure": 3e5}}},
    ),
    "oval bore, 3 um": ({}, {"bore_shape": {"ovality": 3e-6}}),
    "barrelled journal, 2 um": ({}, {"journal_shape": {"barrel": -2e-6}}),
    "rough, 0.3 um each": (
        {},
        {"contact": {"journal_roughness": 0.3e-6, "bore_roughness": 0.3e-6}},
    ),
}

#: Rows that stand for others.
VARIANTS = ("none", "half the viscosity", "heat, effective at the outlet", "4-node cells")

#: Cells of every film.
CELLS = [40, 10]


@dataclass(frozen=True)
class Effect:
    """Of one joint over the cycle [Pa], [m], [W], [m3/s], [C], [s]."""

    pressure: float
    film: float
    dissipated: float
    flow: float
    temperature: float | None
    cycles: int
    seconds: float


def models() -> dict[str, tuple[dict[str, Any], dict[str, Any]]]:
    """All rows."""
    rows = {name: (dict(oil), dict(joint)) for name, (oil, joint) in MODELS.items()}
    together: tuple[dict[str, Any], dict[str, Any]] = {}, {}
    for name, tables in MODELS.items():
        if name not in VARIANTS:
            for part, table in zip(together, tables, strict=True):
                part.update(table)
    return {**rows, "all together": together}


def build(parts: Parts, name: str, oil: Mapping[str, Any], joint: Mapping[str, Any]) -> Built:
    """A shipped scene with a model in every lubricated joint."""
    tables = tomllib.loads(shipped(name))
    own = tables["lubricants"]["oil"]
    if "grade" in oil:
        own.clear()
    own.update(oil)
    for entry in tables["joints"].values():
        if entry["kind"] == "lubricated":
            entry.update(cells=CELLS, friction=True)
            entry.update(joint)
    tables["time"].update(tolerance=1e-4, periodicity=1e-3)
    return parts.build(scene_of(tables, name))


def effects(built: Built) -> Iterator[tuple[str, Effect]]:
    """Of every joint over the cycle that repeats."""
    began = process_time()
    assert built.period is not None
    run = Run(built.mechanism, built.steps, built.period)
    search, record = Cycles(run, built.period, 1e-3, 30), Recorder(run)
    films = run.equations.system.films
    times: list[float] = []
    flows: list[list[float]] = []
    number = 0
    for step in search:
        if search.number != number:
            number, times, flows = search.number, [], []
        record.add(step, search)
        times.append(step.time)
        flows.append(
            [oil_leaving(p.film.film, f) for p, f in zip(films, step.solution.films, strict=True)]
        )
    result, seconds = record.result(search), process_time() - began
    means = trapezoid(flows, times, axis=0)
    for place, flow in zip(films, means / (times[-1] - times[0]), strict=True):
        joint, figures = result.joints[place.name], result.figures[place.name]
        yield (
            place.name,
            Effect(
                joint.max_pressure.max(),
                joint.min_film_thickness.min(),
                figures["mean_dissipated_power_W"],
                float(flow),
                figures.get("effective_temperature_C"),
                search.number,
                seconds,
            ),
        )


def row(name: str, joint: str, found: Effect, base: Effect) -> str:
    """Of the table."""

    def change(value: float, reference: float) -> str:
        return "" if found is base else f", {100 * (value / reference - 1):+.1f} %"

    temperature = "" if found.temperature is None else f"{found.temperature:.1f}"
    cells = [
        name,
        joint,
        f"{found.pressure * 1e-6:.2f}{change(found.pressure, base.pressure)}",
        f"{found.film * 1e6:.3f}{change(found.film, base.film)}",
        f"{found.dissipated:.0f}",
        f"{found.flow * 1e6:.2f}",
        temperature,
        f"{found.cycles}",
        f"{found.seconds:.0f}",
    ]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", choices=("slider-crank", "engine"))
    parser.add_argument("--only", default="", help="rows whose name has this in it")
    arguments = parser.parse_args()
    parts = Parts()
    for scene in [arguments.scene] if arguments.scene else ("slider-crank", "engine"):
        print(f"\n## {scene}\n")
        heads = "model | joint | peak [MPa] | film [um] | dissipated [W] | flow [cm3/s] | T [C]"
        print(f"| {heads} | cycles | s |\n|{'---|' * 9}", flush=True)
        bases: dict[str, Effect] = {}
        for name, tables in models().items():
            if name != "none" and arguments.only not in name:
                continue
            try:
                for joint, found in effects(build(parts, scene, *tables)):
                    print(row(name, joint, found, bases.setdefault(joint, found)), flush=True)
            except EhdError as error:
                print(f"| {name} | | {type(error).__name__}: {error} | | | | | | |", flush=True)


if __name__ == "__main__":
    main()
