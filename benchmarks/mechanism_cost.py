"""Cost of mechanisms of bodies and joints, side by side with the machines they replace.

    python benchmarks/mechanism_cost.py [--repetitions 5] [--only slider]

Slider-crank (M3 and M4, on the bore's own cells and finer ones, with and without damping), rotor
and loaded journal, each by both codes in turn; then one film against two. Steps are the same in
every repetition: the time of each is the least processor time of all repetitions, or what else
the machine does would count.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from time import process_time
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_ehd.film import Film, FilmParameters, Lubricant, uniform_grid
from fenics_ehd.multibody.forces import PointForce, RotatingForce
from fenics_ehd.multibody.joints import Revolute, Slider, Speed
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.planar_body import FlexibleBody, RigidBody
from fenics_ehd.multibody.powers import step_powers
from fenics_ehd.multibody.shaft_body import ShaftBody
from fenics_ehd.multibody.simulation import Run, Steps
from fenics_ehd.reduction import ReducedBody, residual_flexibility
from fenics_ehd.scenes import housing, loaded_journal_run, rotor_run, run
from fenics_ehd.scenes.film_mesh import film_mesh
from fenics_ehd.scenes.loaded_journal import build_film, build_load
from fenics_ehd.scenes.loaded_journal_settings import LoadedJournalSettings
from fenics_ehd.scenes.rod import reduce_rod
from fenics_ehd.scenes.rotor_settings import RotorSettings
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings
from fenics_ehd.scenes.transient import Totals
from fenics_ehd.settings import build

#: A run, which calls its argument with the Newton iterations of every step.
Code = Callable[[Callable[[int], None]], None]

REVOLUTION = 2 * np.pi / 500.0


def new(mechanism: Mechanism, end: float, cycles: int = 1, **steps: Any) -> Code:
    """Steps and powers of a mechanism of bodies and joints."""

    def code(step_done: Callable[[int], None]) -> None:
        running = Run(mechanism, Steps(**steps), end)
        for cycle in range(cycles):
            for step in running.until((cycle + 1) * end):
                step_powers(running.equations, step)
                step_done(step.newton_iterations)

    return code


def slider_crank(settings: SliderCrankSettings, body: ReducedBody) -> dict[str, Code]:
    """The paper's machine."""
    tolerance = settings.time.tolerance
    oil = Lubricant(settings.bearing.viscosity)
    grid = film_mesh(settings.film, body)
    rod = FlexibleBody(body, settings.rod.damping_time, position=(0.048, 0.0))
    film = Film(FilmParameters(grid, settings.bearing.clearance, oil, rate=500.0))
    mechanism = linkage(rod, "rod.bore", film)

    def old(step_done: Callable[[int], None]) -> None:
        run.simulate(
            settings, body, Totals(), progress=lambda _, step: step_done(step.newton_iterations)
        )

    return {"old": old, "new": new(mechanism, REVOLUTION, tolerance=tolerance)}


def linkage(rod: Any, bore: str, big_end: Film, gudgeon: Film | None = None) -> Mechanism:
    """Crank, rod and piston of the paper, one or both ends of the rod lubricated."""
    pin = Revolute("rod.pin", "piston")
    return Mechanism(
        bodies={
            "crank": RigidBody(1.0, 1e-3, {"pin": (0.048, 0.0)}),
            "rod": rod,
            "piston": RigidBody(0.5, 1e-3, position=(0.208, 0.0)),
        },
        joints={
            "main": Revolute("ground", "crank"),
            "big_end": LubricatedJoint("crank.pin", bore, big_end),
            "gudgeon": pin if gudgeon is None else LubricatedJoint("piston", "rod.pin", gudgeon),
            "cylinder": Slider("ground", "piston"),
        },
        drives={"crank": Speed(500.0)},
    )


def rotor() -> dict[str, Code]:
    """The paper's rotor, its housing by M4."""
    settings = build(RotorSettings, {"force": {"ramp": 0.5}})
    body = residual_flexibility(housing.build_structure(settings, MPI.COMM_SELF), 10)
    modal = rotor_run.build_rotor(settings)
    inertia = modal.beam.shaft.polar_inertia + settings.disk.polar_inertia
    grid = film_mesh(settings.film, body)
    film = Film(FilmParameters(grid, settings.bearing.clearance, Lubricant(0.01), 600.0))
    mechanism = Mechanism(
        {
            "shaft": ShaftBody(modal, inertia, 1e-3, {"bearing": 0.5, "force": 0.75}),
            "housing": FlexibleBody(body),
        },
        {"bearing": LubricatedJoint("shaft.bearing", "housing.bore", film)},
        {"shaft": Speed(600.0)},
        {"unbalance": RotatingForce("shaft.force", 3600.0, 600.0, np.pi / 600)},
    )

    def old(step_done: Callable[[int], None]) -> None:
        rotor_run.simulate(
            settings, body, Totals(), progress=lambda _, step: step_done(step.newton_iterations)
        )

    return {"old": old, "new": new(mechanism, 2 * np.pi / 600, order=2, first=1e-6)}


def loaded_journal() -> dict[str, Code]:
    """The journal without mass of the engine's load, over as many cycles as the old code takes."""
    settings = LoadedJournalSettings()
    load = build_load(settings)
    totals = loaded_journal_run.OrbitTotals()
    loaded_journal_run.simulate(settings, totals)
    axes = {axis: tuple(np.eye(2)[place]) for place, axis in enumerate("xy")}

    def component(place: int) -> Callable[[float], tuple[float, float]]:
        return lambda time: (load(time)[place], 0.0)

    mechanism = Mechanism(
        {"journal": RigidBody(0.0)},
        {"bearing": LubricatedJoint("journal", "ground", build_film(settings, load.period))},
        {"journal": Speed(300.0)},
        {a: PointForce("journal", axes[a], component(place)) for place, a in enumerate("xy")},
    )

    def old(step_done: Callable[[int], None]) -> None:
        loaded_journal_run.simulate(
            settings, loaded_journal_run.OrbitTotals(), progress=lambda _: step_done(0)
        )

    steps = {"tolerance": 5e-5, "order": 2, "first": 1e-6}
    return {"old": old, "new": new(mechanism, load.period, totals.cycle, **steps)}


def short_films(count: int) -> Code:
    """A rigid rod in one or two short bearings of thick oil."""
    sizes = [(22.5e-3, 2.2e-3, 17e-6), (11e-3, 2e-3, 12e-6)][:count]
    films = [
        Film(
            FilmParameters(
                uniform_grid(radius, width, (40, 4), "lagrange"),
                clearance,
                Lubricant(10.0),
                rate=500.0,
            )
        )
        for radius, width, clearance in sizes
    ]
    rod = RigidBody(0.973, 4e-3, {"pin": (0.16, 0.0)}, centre=(0.0677, 0.0), position=(0.048, 0.0))
    return new(linkage(rod, "rod", *films), REVOLUTION, tolerance=1e-4, order=2)


def scenes() -> Iterator[tuple[str, Callable[[], dict[str, Code]]]]:
    """Both codes of every scene, made when it is its turn."""
    for method in ("m3", "m4"):
        reduction = {"reduction": {"method": method}}
        for label, tables in {
            "": {},
            ", film 40 x 10": {"film": {"cells": [40, 10]}, "time": {"tolerance": 1e-4}},
            ", film 80 x 20": {"film": {"cells": [80, 20]}, "time": {"tolerance": 1e-4}},
            ", no damping": {"rod": {"damping_time": 0.0}, "time": {"tolerance": 1e-4}},
        }.items():
            settings = build(SliderCrankSettings, {**reduction, **tables})
            yield (
                f"slider-crank {method}{label}",
                lambda settings=settings: slider_crank(settings, reduce_rod(settings).body),
            )
    yield "rotor m4", rotor
    yield "loaded journal", loaded_journal
    yield "two films (new) and one (old)", lambda: {"old": short_films(1), "new": short_films(2)}


def measure(codes: dict[str, Code], repetitions: int) -> dict[str, tuple[int, int, float]]:
    """Steps, iterations and processor time [s] of every code, run in turn."""
    found: dict[str, list[tuple[np.ndarray, int]]] = {name: [] for name in codes}
    for _ in range(repetitions):
        for name, code in codes.items():
            marks, iterations = [process_time()], []

            def step_done(count: int, marks: list = marks, iterations: list = iterations) -> None:
                marks.append(process_time())
                iterations.append(count)

            code(step_done)
            found[name].append((np.diff(marks), sum(iterations)))
    return {
        name: (len(runs[0][0]), runs[0][1], float(np.min([t for t, _ in runs], axis=0).sum()))
        for name, runs in found.items()
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--only", default="", help="scenes whose name has this in it")
    arguments = parser.parse_args()
    print("| scene | steps old, new | iterations old, new | s old, new | ratio |")
    print("|---|---|---|---|---|")
    for name, make in scenes():
        if arguments.only in name:
            found = measure(make(), arguments.repetitions)
            old, now = found["old"], found["new"]
            print(
                f"| {name} | {old[0]}, {now[0]} | {old[1]}, {now[1]} | {old[2]:.3f}, {now[2]:.3f} "
                f"| {now[2] / old[2]:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
