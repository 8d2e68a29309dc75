"""What models of real films cost where a scene lists none, beside another commit of the program.

    git worktree add --detach ../former COMMIT && make -C ../former set-up
    python benchmarks/models_off.py --former ../former [--pairs 15]

Both run this file, each in its own environment, run by run in turn. The results are the same to the
last bit or the row says DIFFERENT; times are processor seconds, the ratio the median of the pairs.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
import tomllib
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

from mpi4py import MPI

from fenics_ehd.multibody.run import Run
from fenics_ehd.multibody.tracking import Tracker
from fenics_ehd.scenes.build import Built, build_mechanism
from fenics_ehd.scenes.scene_file import scene_of, shipped

#: Scene, method of its elastic body, tolerance, and share of its time or period.
CASES = (
    ("slider-crank-paper", "m3", 1e-4, 1.0),
    ("slider-crank-paper", "m4", 1e-4, 1.0),
    ("rotor-paper", "m3", 1e-5, 0.3),
    ("loaded-journal", "", 1e-5, 1.0),
)


def make(name: str, method: str, tolerance: float, share: float) -> tuple[Built, float]:
    """The mechanism and how long to run it [s]."""
    tables = tomllib.loads(shipped(name))
    for body in tables["bodies"].values():
        if body.get("kind") == "flexible":
            body["reduction"]["method"] = method
    tables["time"]["tolerance"] = tolerance
    scene = scene_of(tables, name)
    return build_mechanism(scene, MPI.COMM_SELF), share * scene.span


def run(built: Built, end: float) -> tuple[float, int, int, str]:
    """Processor time [s], steps, iterations, and a digest of all states and pressures."""
    began, digest = process_time(), hashlib.sha256()
    steps = iterations = 0
    way = Run(built.mechanism, built.steps, end)
    tracker = Tracker(way.equations, way.norm)
    for step in way.until(end):
        tracker.add(step)
        for values in (step.x, step.rate, *(film.pressure for film in step.solution.films)):
            digest.update(values.tobytes())
        steps, iterations = steps + 1, iterations + step.newton_iterations
    return process_time() - began, steps, iterations, digest.hexdigest()


def serve() -> None:
    """Answer lines with a case on stdin."""
    made: dict[str, tuple[Built, float]] = {}
    for line in sys.stdin:
        if line not in made:
            made[line] = make(*json.loads(line))
        print(json.dumps(run(*made[line])), flush=True)


class Version:
    """One commit at work in its environment."""

    def __init__(self, python: Path):
        self._process = subprocess.Popen(
            [str(python), __file__, "--serve"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def ask(self, case: tuple) -> Any:
        """See `run`."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps(case), file=self._process.stdin, flush=True)
        return json.loads(self._process.stdout.readline())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--former", type=Path, help="worktree of another commit, set up")
    parser.add_argument("--pairs", type=int, default=15)
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        serve()
        return
    if arguments.former is None:
        parser.error("--former is missing")
    former = Version(arguments.former / ".venv" / "bin" / "python")
    now = Version(Path(sys.executable))
    print(
        "| case | steps | iterations | s before, now | ratio | results |\n|---|---|---|---|---|---|"
    )
    for case in CASES:
        for version in (former, now):
            version.ask(case)  # makes it
        pairs = [(former.ask(case), now.ask(case)) for _ in range(arguments.pairs)]
        before, after = pairs[0]
        ratio = median(b[0] / a[0] for a, b in pairs)
        times = [median(times) for times in zip(*((a[0], b[0]) for a, b in pairs), strict=True)]
        same = "the same" if before[3] == after[3] else "DIFFERENT"
        print(
            f"| {case[0]} {case[1]} | {before[1]}, {after[1]} | {before[2]}, {after[2]} "
            f"| {times[0]:.2f}, {times[1]:.2f} | {ratio:.3f} | {same} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
