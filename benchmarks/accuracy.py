"""Runs to an accuracy: their true errors, and their time over that of the cheapest run.

    python benchmarks/accuracy.py [--only four-bar ...] [--accuracy 0.03 0.01] [--cache FOLDER]

For each scene and accuracy a row with the result of `output.accuracy`: the largest estimate of the
run chosen; its largest true error, against the reference of `benchmarks/error_budget.py`, which has
three times the scene's own cells either way, M4 and short steps with a thirtieth of its tolerance;
processor time of the runs before it with their budgets, and of its own integration.
Then the cheapest run of a grid, each from the start, whose true error meets the accuracy
and which is trustworthy, and the time over its time.
The grid varies one setting at a time around the choice: tolerances times 1/10, 1/4, 4, 10, cells
times 0.7, 0.85, 1.2, 1.5.
"""

from __future__ import annotations

import argparse
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

from error_budget import METHOD, SCENES, References, extremes_of, finer, reduced, strict

import fenics_ehd as ehd
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.summary import RunSummary
from fenics_ehd.multibody.trust import ENERGY_LIMIT
from fenics_ehd.scenes.accuracy import start_search
from fenics_ehd.scenes.run import run_accurately
from fenics_ehd.scenes.scene import changed, stored
from fenics_ehd.scenes.schema import FEWEST_CELLS

TOLERANCES, CELLS = (0.1, 0.25, 4.0, 10.0), (0.7, 0.85, 1.2, 1.5)


@dataclass(frozen=True)
class Tried:
    """A run of a grid: largest true error, processor time, whether it may be trusted."""

    error: float
    seconds: float
    trusted: bool


def true_error(own: Mapping[str, list[float]], exact: Mapping[str, list[float]]) -> float:
    """Largest of all joints' figures."""
    return max(
        abs(value / better - 1.0)
        for name in own
        for value, better in zip(own[name], exact[name], strict=True)
    )


def exact_extremes(scene: ehd.Scene, references: References) -> dict[str, list[float]]:
    """Of the reference of a scene as it is written."""
    run, _ = references.run(scene)
    basis = {METHOD: "m4"} if reduced(scene) else {}
    return references.extremes(changed(scene, strict(scene) | basis | finer(scene, run, 3)))


def tried(
    scene: ehd.Scene, references: References, exact: Mapping[str, list[float]]
) -> Tried | None:
    """A run with given settings; None: it comes to no end."""
    try:
        run, cycles = references.run(scene)
        solved, began = Recorder(run, scene.span, cycles), process_time()
        deque(solved.steps(), maxlen=0)
    except ehd.errors.EhdError:
        return None
    seconds = process_time() - began
    return Tried(
        true_error(extremes_of(solved), exact),
        seconds,
        RunSummary(solved).energy_error <= ENERGY_LIMIT,
    )


def around(scene: ehd.Scene) -> Iterator[dict[str, Any]]:
    """Values of a grid around a scene's, one setting at a time."""
    yield {}
    for factor in TOLERANCES:
        yield {"time.tolerance": min(0.05, factor * scene.time.tolerance)}
    for factor in CELLS:
        yield {
            f"joints.{name}.cells": [
                max(least, round(factor * cells))
                for cells, least in zip(scene.joints[name].cells, FEWEST_CELLS, strict=True)
            ]
            for name in scene.films
        }


def chosen(scene: ehd.Scene, accuracy: float) -> tuple[ehd.Scene, dict[str, Any]]:
    """The scene of the run that comes out, and the summary of it."""
    asked = changed(scene, {"output.accuracy": accuracy, "output.error_budget": True})
    pilot, search = start_search(stored(asked))
    with TemporaryDirectory() as folder:
        built = ehd.build(pilot, cache=False)
        last, _, summary = run_accurately(
            pilot,
            built,
            Path(folder),
            search,
            interval=1e9,
            cache=False,
        )
    return last, summary


def stated(summary: Mapping[str, Any]) -> dict[str, list[float]]:
    """Extremes of every joint in a summary."""
    return {
        name: [figures["max_pressure_Pa"], figures["min_film_thickness_m"]]
        for name, figures in summary["joints"].items()
    }


def row(name: str, accuracy: float, references: References) -> tuple[str, bool, float]:
    """Line of the table, whether the true error meets the accuracy, time over the cheapest."""
    shipped, changes = SCENES[name]
    scene = ehd.read_scene(shipped, **changes)
    exact = exact_extremes(scene, references)
    last, summary = chosen(scene, accuracy)
    found = summary["accuracy"]
    grid = [tried(changed(last, values), references, exact) for values in around(last)]
    error, seconds = true_error(stated(summary), exact), summary["processor_time_s"]
    good = [run for run in grid if run is not None and run.trusted and run.error <= accuracy]
    least = min((run.seconds for run in good), default=float("nan"))
    pilot = found["pilot_processor_time_s"]
    ratio = (pilot + seconds) / least
    settings = [f"{last.time.tolerance:g}"] + [
        " x ".join(map(str, last.joints[joint].cells)) for joint in last.films
    ]
    cells = [
        name,
        f"{100 * accuracy:g} %",
        ", ".join(settings),
        str(len(found["runs"])),
        f"{100 * found['estimate']:.2f} %",
        f"{100 * error:.2f} %",
        f"{pilot:.1f} s",
        f"{seconds:.1f} s",
        f"{least:.1f} s",
        f"{ratio:.2f}",
    ]
    return "| " + " | ".join(cells) + " |", error <= accuracy, ratio


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", choices=SCENES, default=list(SCENES))
    parser.add_argument("--accuracy", nargs="*", type=float, default=[0.03, 0.01])
    parser.add_argument("--cache", type=Path, default=Path("results/error-budget"))
    arguments = parser.parse_args()
    references = References(arguments.cache)
    header = "scene, asked, chosen, runs, estimate, true, pilot, run, cheapest, time over cheapest"
    print("| " + " | ".join(header.split(", ")) + " |\n" + "|---" * 10 + "|")
    found = []
    for name in arguments.only:
        for accuracy in arguments.accuracy:
            line, met, ratio = row(name, accuracy, references)
            print(line, flush=True)
            found.append((met, ratio))
    print(f"met: {sum(met for met, _ in found)} of {len(found)}")
    print(f"within 1.5 times: {sum(ratio <= 1.5 for _, ratio in found)} of {len(found)}")


if __name__ == "__main__":
    main()
