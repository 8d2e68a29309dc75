"""Cost of mechanisms of bodies and joints, side by side with the machines of version 0.1.

    git worktree add --detach ../former ced695c && make -C ../former set-up
    python benchmarks/mechanism_cost.py --former ../former [--repetitions 5] [--only rotor]

Version 0.1 runs `mechanism_cost_former.py` in its own worktree and environment, this one runs
itself; both reduce, then run case by case in turn. Steps are the same in every repetition: the
time of each is the least processor time of all repetitions, or what else the machine does would
count. After that, what M4 costs beside M3 and two films beside one, by this version alone.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_ehd.film import Film, FilmParameters, Lubricant, uniform_grid
from fenics_ehd.multibody.joints import Revolute, Slider, Speed
from fenics_ehd.multibody.lubricated_joint import LubricatedJoint
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.rigid_body import RigidBody
from fenics_ehd.multibody.run import Run, Steps
from fenics_ehd.multibody.tracking import Tracker
from fenics_ehd.scenes.build import build_mechanism
from fenics_ehd.scenes.scene_file import scene_of, shipped

#: Cells of the slider-crank's film, its tolerance and structural damping [s], by what the case
#: is called.
SLIDER_CRANKS = {
    "": ([], 1e-5, 1e-3),
    ", film 40 x 10": ([40, 10], 1e-4, 1e-3),
    ", film 80 x 20": ([80, 20], 1e-4, 1e-3),
    ", no damping": ([], 1e-4, 0.0),
}

CASES = [f"slider-crank {method}{size}" for size in SLIDER_CRANKS for method in ("m3", "m4")]
CASES += ["rotor m4", "loaded journal"]

#: A run of so many cycles: times at which steps ended [s], and iterations of each.
Code = Callable[[int], tuple[list[float], list[int]]]


def steps_of(mechanism: Mechanism, span: float, steps: Steps) -> Code:
    """A run and all that a history and a summary have of it."""

    def code(cycles: int) -> tuple[list[float], list[int]]:
        marks, iterations = [process_time()], []
        run = Run(mechanism, steps, span)
        tracker = Tracker(run.equations, run.norm)
        for step in run.until(cycles * span):
            tracker.add(step)
            marks.append(process_time())
            iterations.append(step.newton_iterations)
        return marks, iterations

    return code


def scene(name: str, changes: Mapping[str, Any]) -> Code:
    """A shipped scene with settings changed, ``{"time.tolerance": 1e-4}``."""
    tables = tomllib.loads(shipped(name))
    for key, value in changes.items():
        *path, last = key.split(".")
        table = tables
        for part in path:
            table = table[part]
        table[last] = value
    read = scene_of(tables, name)
    built = build_mechanism(read, MPI.COMM_SELF)
    return steps_of(built.mechanism, read.span, built.steps)


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
    joints: dict[str, Any] = {
        "main": Revolute("ground", "crank"),
        "big_end": LubricatedJoint("crank.pin", "rod", films[0]),
        "gudgeon": Revolute("rod.pin", "piston"),
        "cylinder": Slider("ground", "piston"),
    }
    if count == 2:
        joints["gudgeon"] = LubricatedJoint("piston", "rod.pin", films[1])
    mechanism = Mechanism(
        bodies={
            "crank": RigidBody(1.0, 1e-3, {"pin": (0.048, 0.0)}),
            "rod": rod,
            "piston": RigidBody(0.5, 1e-3, position=(0.208, 0.0)),
        },
        joints=joints,
        drives={"crank": Speed(500.0)},
    )
    return steps_of(mechanism, 2 * np.pi / 500.0, Steps(tolerance=1e-4, order=2))


def make(case: str) -> Code:
    """The code of a case, of the version at hand."""
    if case == "rotor m4":
        # The force grows over half a turn, as the other version's does.
        changes = {"bodies.housing.reduction.method": "m4", "forces.unbalance.ramp": np.pi / 600}
        return scene("rotor-paper", changes)
    if case == "loaded journal":
        return scene("loaded-journal", {})
    if case.endswith("film") or case.endswith("films"):
        return short_films(1 if case == "one film" else 2)
    method, size = case.removeprefix("slider-crank ")[:2], case.removeprefix("slider-crank ")[2:]
    cells, tolerance, damping_time = SLIDER_CRANKS[size]
    changes = {
        "bodies.rod.reduction.method": method,
        "bodies.rod.damping_time": damping_time,
        "joints.big_end.cells": cells,
        "time.tolerance": tolerance,
    }
    return scene("slider-crank-paper", changes)


def serve(make: Callable[[str], Code]) -> None:
    """Answer lines ``case, cycles`` on stdin: make a case once, run it when asked to."""
    codes: dict[str, Code] = {}
    for line in sys.stdin:
        case, cycles = json.loads(line)
        if case not in codes:
            codes[case] = make(case)
        marks, iterations = codes[case](cycles)
        print(json.dumps([marks, iterations]), flush=True)


class Version:
    """A process that runs one version's codes.

    Parameters
    ----------
    python
        Of its environment.
    script
        That calls `serve`.
    """

    def __init__(self, python: Path, *script: str):
        self._process = subprocess.Popen(
            [str(python), *script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def run(self, case: str, cycles: int) -> tuple[np.ndarray, int]:
        """Processor time of every step [s], and iterations in all."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps([case, cycles]), file=self._process.stdin, flush=True)
        marks, iterations = json.loads(self._process.stdout.readline())
        return np.diff(marks), sum(iterations)


def measure(
    runs: Mapping[str, Callable[[], tuple[np.ndarray, int]]], repetitions: int
) -> dict[str, tuple[int, int, float]]:
    """Steps, iterations and processor time [s] of some runs, in turn."""
    found: dict[str, list[tuple[np.ndarray, int]]] = {name: [] for name in runs}
    for _ in range(repetitions):
        for name, run in runs.items():
            found[name].append(run())
    return {
        name: (len(f[0][0]), f[0][1], float(np.min([times for times, _ in f], axis=0).sum()))
        for name, f in found.items()
    }


def row(name: str, before: tuple[int, int, float], now: tuple[int, int, float]) -> str:
    """Of the table."""
    return (
        f"| {name} | {before[0]}, {now[0]} | {before[1]}, {now[1]} "
        f"| {before[2]:.3f}, {now[2]:.3f} | {now[2] / before[2]:.2f} |"
    )


def pairs(new: Version, old: Version | None) -> Iterator[tuple[str, Any, Any]]:
    """Names of the rows and the two runs of each."""
    for case in CASES:
        if old is not None:
            # The loaded journal runs as many cycles as the old code takes to repeat itself.
            cycles = 3 if case == "loaded journal" else 1
            yield (
                case,
                lambda case=case, old=old: old.run(case, 1),
                lambda case=case, cycles=cycles: new.run(case, cycles),
            )
    for size in SLIDER_CRANKS:
        yield (
            f"m3, m4{size}",
            lambda size=size: new.run(f"slider-crank m3{size}", 1),
            lambda size=size: new.run(f"slider-crank m4{size}", 1),
        )
    yield "one film, two films", lambda: new.run("one film", 1), lambda: new.run("two films", 1)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--former", type=Path, help="worktree of version 0.1, set up")
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--only", default="", help="rows whose name has this in it")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        serve(make)
        return
    new = Version(Path(sys.executable), __file__, "--serve")
    old = None
    if arguments.former:
        script = str(Path(__file__).with_name("mechanism_cost_former.py"))
        old = Version(arguments.former / ".venv" / "bin" / "python", script)
    print("| case | steps before, now | iterations | s | ratio |")
    print("|---|---|---|---|---|")
    for name, before, now in pairs(new, old):
        if arguments.only in name:
            found = measure({"before": before, "now": now}, arguments.repetitions)
            print(row(name, found["before"], found["now"]), flush=True)


if __name__ == "__main__":
    main()
