"""Time, memory and counts of this version over those of another commit, in interleaved pairs.

    python benchmarks/house.py COMMIT [ROW ...] [--pairs 5] [--folder DIR]
    python benchmarks/house.py COMMIT --machines | --large | --scipy | --sweeps
    python benchmarks/house.py --list

COMMIT is checked out and set up in `DIR` (default: `build/former`), or is the folder of a checkout
that is set up. Each row is a command in a process of its own, in the two checkouts by turns. Its
figures are processor seconds of the process and of its phases, wall seconds, peak memory, and the
counts that a commit has. They are medians; the ratio is the median of the ratios of the pairs. The
first run of each checkout compiles forms and is not counted. Reduced bodies are not kept, except
for the row `slider-crank-kept`. Without names, all rows are measured but those on request:

    --machines   scenes of `tests/golden/house` in memory, their bodies stored; `house_case.py`
    --large      reductions of 64 209 degrees of freedom
    --scipy      the same by SciPy, over those of this version
    --sweeps     200 small cases on two processes

Shipped scenes are those of either checkout, with the same values of a few settings.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

HERE = Path(__file__).parents[1]
MACHINES = Path("tests") / "golden" / "house"

#: Constant oil first, then two models and more.
NAMES = (
    "slider-crank-small", "slider-crank-plain", "slider-crank-both", "rotor-tilt",
    "slider-crank-torque", "four-bar-oil", "slider-crank-rough", "slider-crank-conserved",
    "journal-starved",
)  # fmt: skip

#: Figures of a process by their keys in its answer: a summary, or a line of JSON.
PHASES = {
    "reduction_time_s": "reduction, wall s",
    "wall_time_s": "run, wall s",
    "processor_time_s": "run, s",
    "error_budget_processor_time_s": "error budget, s",
    "seconds": "within, s",
    "processor_seconds": "within, processor s",
}

#: Counts that were keys of the answer itself.
FORMER_COUNTS = ("steps", "newton_iterations", "rejected_steps")

#: Degrees of freedom of reductions: rows of the table, and those on request.
SIZE = 21_000
LARGE = 64_000
REDUCTIONS = ("m1-37", "m1-127", "m2-37", "m3-pc2", "m4")


@dataclass(frozen=True)
class Measured:
    """Figures by name, of which ratios are taken, and counts of one process."""

    figures: Mapping[str, float]
    counts: Mapping[str, int]


@dataclass(frozen=True)
class Row:
    """A command that is measured in both checkouts.

    Attributes
    ----------
    name
        Name in the table.
    arguments
        Command with `{python}`, `{program}`, `{here}`, `{checkout}`, `{scene}` and `{out}`.
    scene, changes
        Shipped scene, and values by dotted keys, of which `{scene}` is the file.
    kept
        Whether reduced bodies are kept, so that the measured processes read them.
    asked
        Flag that asks for the row; empty if it is among those without a flag.
    """

    name: str
    arguments: Sequence[str]
    scene: str = ""
    changes: Mapping[str, Any] = field(default_factory=dict)
    kept: bool = False
    asked: str = ""

    def measure(self, checkout: Path, scratch: Path) -> Measured:
        """Run the command once."""
        with tempfile.TemporaryDirectory(dir=scratch) as folder:
            scene = Path(folder) / "scene.toml"
            if self.scene:
                scene.write_text(scene_text(checkout, self.scene, self.changes))
            out = Path(folder) / "out"
            command = [
                part.format(
                    python=checkout / ".venv/bin/python",
                    program=checkout / ".venv/bin/fenics-ehd",
                    here=HERE,
                    checkout=checkout,
                    scene=scene,
                    out=out,
                )
                for part in self.arguments
            ]
            cache = str(scratch / "kept") if self.kept else "off"
            figures, output = timed(command, checkout, cache)
            answer = answer_of(out / "summary.json", output)
        figures |= {text: answer[key] for key, text in PHASES.items() if answer.get(key)}
        if "error budget, s" in figures:
            figures["error budget / run"] = figures["error budget, s"] / figures["run, s"]
        counts = {key: answer[key] for key in FORMER_COUNTS if key in answer}
        return Measured(figures, counts | answer.get("counts", {}))


def timed(command: Sequence[str], checkout: Path, cache: str) -> tuple[dict[str, float], str]:
    """Run a command: its processor seconds, wall seconds and peak memory, and its output."""
    environment = os.environ | {
        "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "FENICS_EHD_CACHE": cache,
    }  # fmt: skip
    with tempfile.TemporaryFile("w+") as output, tempfile.TemporaryFile("w+") as errors:
        began = perf_counter()
        process = subprocess.Popen(
            command, env=environment, cwd=checkout, stdout=output, stderr=errors
        )
        _, status, usage = os.wait4(process.pid, 0)
        wall = perf_counter() - began
        process.returncode = os.waitstatus_to_exitcode(status)
        output.seek(0)
        if process.returncode:
            errors.seek(0)
            reason = (errors.read().strip().splitlines() or ["no message"])[-1]
            raise RuntimeError(f"{' '.join(map(str, command))}: {reason}")
        figures = {
            "process, s": usage.ru_utime + usage.ru_stime,
            "process, wall s": wall,
            "memory, MB": usage.ru_maxrss / 1024,
        }
        return figures, output.read()


def answer_of(summary: Path, output: str) -> dict[str, Any]:
    """Summary of a run, or the JSON that a command printed; else nothing."""
    texts = [summary.read_text()] if summary.exists() else [output, *output.splitlines()[-1:]]
    for text in texts:
        try:
            answer = json.loads(text)
        except ValueError:
            continue
        if isinstance(answer, dict):
            return answer
    return {}


def scene_text(checkout: Path, name: str, changes: Mapping[str, Any]) -> str:
    """Text of a shipped scene of a checkout with other values; a table replaces a table."""
    path = checkout / "fenics_ehd" / "scenes" / "shipped" / f"{name}.toml"
    tables = tomllib.loads(path.read_text())
    for key, value in changes.items():
        *groups, last = key.split(".")
        table = tables
        for group in groups:
            table = table.setdefault(group, {})
        table[last] = value
    return "".join(f"{line}\n" for line in toml_lines(tables))


def toml_lines(tables: Mapping[str, Any], before: str = "") -> list[str]:
    """Lines of TOML, one dotted key each."""
    lines = []
    for key, value in tables.items():
        if isinstance(value, dict) and value:
            lines += toml_lines(value, f"{before}{key}.")
        else:
            lines.append(f"{before}{key} = {json.dumps(value)}")
    return lines


RUN = ("{program}", "run", "{scene}", "--no-plots", "-o", "{out}")
REDUCE = ("{program}", "reduce", "conrod", "--scene", "{scene}", "-o", "{out}.h5", "--json")
CASE = ("{python}", "{checkout}/benchmarks/reduction_case.py", "fenics_ehd")
PAPER = "slider-crank-paper"
FINE = {
    "bodies.rod.geometry.bore_cells_around": 40,
    "bodies.rod.geometry.bore_cells_along": 10,
}
RIGID = {
    "bodies.rod": {
        "kind": "rigid", "mass": 0.973, "inertia": 4e-3, "centre": [0.0677, 0.0],
        "position": [0.048, 0.0], "points": {"bore": [0.0, 0.0], "pin": [0.16, 0.0]},
    },
    "joints.big_end.radius": 0.0225,
    "joints.big_end.width": 0.022,
    "joints.big_end.cells": [12, 3],
    "time.tolerance": 1e-3,
    "time.revolutions": 0.01,
    "output.error_budget": False,
}  # fmt: skip


def machine(name: str, method: str, tolerance: float, cells: Mapping[str, Any]) -> Row:
    """A revolution of the paper's slider-crank, its part reduced, without error estimates."""
    changes = {
        "bodies.rod.reduction.method": method,
        "bodies.rod.reduction.estimate_error": False,
        "time.tolerance": tolerance,
        "output.error_budget": False,
    }
    return Row(name, RUN, PAPER, changes | cells)


def reduction(name: str, method: str, *, estimate: bool) -> Row:
    """The `reduce` of a part with 40 x 10 cells."""
    changes = {
        "bodies.rod.reduction.method": method,
        "bodies.rod.reduction.estimate_error": estimate,
    }
    return Row(name, REDUCE, PAPER, changes | FINE)


ROWS = (
    Row("import", ("{python}", "-c", "import fenics_ehd")),
    Row(
        "import-all",
        ("{python}", "-c", "import fenics_ehd.film.reynolds, fenics_ehd.multibody.simulation"),
    ),
    Row("help", ("{program}", "--help")),
    Row("rigid", RUN, PAPER, RIGID),
    machine("m4-20x5-1e-3", "m4", 1e-3, {}),
    machine("m4-20x5", "m4", 1e-5, {}),
    machine("m3-20x5", "m3", 1e-5, {}),
    machine("m3-40x10", "m3", 1e-5, FINE),
    machine("m4-40x10", "m4", 1e-5, FINE),
    reduction("reduce-m3-40x10", "m3", estimate=True),
    reduction("reduce-m3-40x10-plain", "m3", estimate=False),
    reduction("reduce-m4-40x10", "m4", estimate=True),
    reduction("reduce-m4-40x10-plain", "m4", estimate=False),
    Row("slider-crank", RUN, "slider-crank"),
    Row("slider-crank-kept", RUN, "slider-crank", kept=True),
    Row("starved", RUN, "loaded-journal-starved"),
    Row("engine", RUN, "engine"),
    Row("rotor", RUN, "rotor"),
    *(Row(name, (*CASE, name, str(SIZE))) for name in REDUCTIONS),
    *(
        # The checkout's own scene: keys may have had other names.
        Row(
            name,
            ("{python}", "{here}/benchmarks/house_case.py", f"{{checkout}}/{MACHINES}/{name}.toml"),
            asked="machines",
        )
        for name in NAMES
    ),
    *(Row(f"{name}-64209", (*CASE, name, str(LARGE)), asked="large") for name in REDUCTIONS),
    Row(
        "sweep-200",
        (
            "{program}", "sweep", "{scene}", "--set", "big_end.clearance=10e-6:30e-6:200",
            "--workers", "2", "-o", "{out}",
        ),
        PAPER,
        RIGID,
        asked="sweeps",
    ),
)  # fmt: skip

#: Rows whose runs are compared with each other: M4 over M3 with the same cells.
PAIR = ("m4-40x10", "m3-40x10")


def set_up(commit: str, folder: Path) -> Path:
    """Checkout of a commit, set up."""
    if Path(commit).is_dir():
        return Path(commit).resolve()
    if not folder.exists():
        subprocess.run(["git", "worktree", "add", "--detach", folder, commit], cwd=HERE, check=True)
    subprocess.run(["git", "checkout", "--detach", commit], cwd=folder, check=True)
    subprocess.run(["make", "set-up"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    return folder.resolve()


def compare(row: Row, checkouts: Sequence[Path], pairs: int) -> list[list[Measured]]:
    """Print the lines of a row; return the measurements of both checkouts."""
    with tempfile.TemporaryDirectory() as folder:
        scratches = [Path(folder) / name for name in ("then", "now")]
        for scratch in scratches:
            scratch.mkdir()
        sides = list(zip(checkouts, scratches, strict=True))
        try:
            for side in sides:
                row.measure(*side)  # forms are compiled, files are in memory
            measured = [[row.measure(*side) for side in sides] for _ in range(pairs)]
        except RuntimeError as error:
            print(f"| {row.name} | failed: {error} | | | |", flush=True)
            return []
    both = list(zip(*measured, strict=True))
    for name in both[0][0].figures:
        if all(name in one.figures for side in both for one in side):
            print_ratio(row.name, name, *(np.array([m.figures[name] for m in s]) for s in both))
    then, now = (side[-1].counts for side in both)
    for name, count in now.items():
        if name in then:
            print_counts(row.name, name, then[name], count)
        else:
            print(f"| {row.name} | {name} | | {count} | |", flush=True)
    return [list(side) for side in both]


def print_ratio(row: str, figure: str, then: np.ndarray, now: np.ndarray) -> None:
    """Line of a figure: medians, and the median of the ratios of the pairs."""
    ratio = np.median(now / then)
    print(f"| {row} | {figure} | {np.median(then):.3g} | {np.median(now):.3g} | {ratio:.3f} |")


def print_counts(row: str, name: str, then: int, now: int) -> None:
    """Line of a count."""
    print(f"| {row} | {name} | {then} | {now} | {now / then if then else 1.0:.3f} |", flush=True)


def against_scipy(pairs: int) -> None:
    """Lines of the reductions by SciPy, over those of this version, at `LARGE`."""
    for method in ("m3-pc2", "m1-37"):
        ours = Row(f"{method}-64209", (*CASE, method, str(LARGE)))
        scipy = Row(ours.name, (*CASE[:2], "scipy", method, str(LARGE)))
        with tempfile.TemporaryDirectory() as folder:
            both = [
                [row.measure(HERE, Path(folder)).figures for row in (ours, scipy)]
                for _ in range(pairs)
            ]
        for name in both[0][0]:
            sides = (np.array([pair[i][name] for pair in both]) for i in (0, 1))
            print_ratio(f"{ours.name}, SciPy over this version", name, *sides)


def main() -> None:
    """The table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("commit", nargs="?", help="commit, or folder of a checkout that is set up")
    parser.add_argument("names", nargs="*", metavar="ROW")
    parser.add_argument("--pairs", type=int, default=5)
    parser.add_argument("--folder", type=Path, default=HERE / "build" / "former")
    parser.add_argument("--list", action="store_true", help="names of the rows")
    for flag in ("machines", "large", "scipy", "sweeps"):
        parser.add_argument(f"--{flag}", action="store_true")
    options = parser.parse_args()
    if options.list:
        print("\n".join(f"{row.name:24s}{row.asked and '--' + row.asked}" for row in ROWS))
        return
    if options.commit is None:
        parser.error("give a commit")
    unknown = set(options.names) - {row.name for row in ROWS}
    if unknown:
        parser.error(f"no rows {', '.join(sorted(unknown))}: see --list")
    asked = {flag for flag in ("machines", "large", "scipy", "sweeps") if getattr(options, flag)}
    names = options.names or [r.name for r in ROWS if (r.asked in asked if asked else not r.asked)]
    checkouts = (set_up(options.commit, options.folder), HERE)
    measured = {}
    print("| row | figure | then | now | now / then |\n|---|---|---|---|---|")
    for row in ROWS:
        if row.name in names:
            measured[row.name] = compare(row, checkouts, options.pairs)
    if all(measured.get(name) for name in PAIR):
        runs = (
            [np.array([m.figures["run, s"] for m in side]) for side in measured[name]]
            for name in PAIR
        )
        print_ratio("M4 over M3, 40 x 10", "run", *(m4 / m3 for m4, m3 in zip(*runs, strict=True)))
    if "scipy" in asked:
        against_scipy(options.pairs)


if __name__ == "__main__":
    sys.exit(main())
