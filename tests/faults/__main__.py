"""Malformed inputs, kills, a full disk, errors on one rank: what the program does about them.

    python tests/faults [--seed 1] [--share 1.0] [--seconds 100] [--only CLASS] [--all]

Every malformed input must be refused in one line, be harmless, or be answered as the intact one;
every stopped run must go on to the result of the undisturbed one or say why it cannot.
"""

# ruff: noqa: E402

import argparse
import os
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from pathlib import Path
from random import Random

# The helpers of the tests in the folder above.
sys.path.append(str(Path(__file__).parent.parent))

# As the command line does, before numpy is imported.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
os.environ["FENICS_EHD_CACHE"] = "off"

import accidents
import binaries
import folders
import parts
import texts
from attempt import launch, side_by_side
from cases import Case
from judge import Verdict, judge
from world import World, make_world

#: Classes of malformed inputs and how many of each make a full round.
CLASSES: dict[str, tuple[Callable[[World, Random], Iterator[Case]], int]] = {
    "scene values": (texts.scene_values, 110),
    "scene extremes": (texts.scene_extremes, 40),
    "scene text": (texts.scene_texts, 50),
    "tables": (texts.tables, 90),
    "options": (texts.options, 130),
    "body": (binaries.bodies, 90),
    "stopped run": (binaries.stopped_runs, 80),
    "structure": (binaries.structures, 60),
    "sealed again": (binaries.sealed_again, 100),
    "matrices": (binaries.matrices, 90),
    "names": (folders.names, 40),
    "folders": (folders.folders, 80),
    "links": (folders.links, 80),
    "limits": (folders.limits, 60),
    "part files": (parts.part_files, 90),
}

#: What else is done to it.
PARTS = {
    "kills": accidents.kills,
    "compilations": accidents.compilations,
    "ranks": accidents.ranks,
    "disk": accidents.full_disk,
}

#: Seconds after which a call hangs.
LIMIT = 40


def malformed(world: World, options: argparse.Namespace) -> Iterator[tuple[str, str, Verdict]]:
    """Class, name and verdict of every malformed input."""
    chosen: list[Case] = []
    for name, (generate, count) in CLASSES.items():
        if options.only in (None, name):
            own = Random(f"{options.seed} {name}")
            chosen += islice(generate(world, own), max(1, round(options.share * count)))
    Random(options.seed).shuffle(chosen)
    root = world.folder / "cases"

    def begin(item: tuple[int, Case]) -> tuple[int, Path]:
        number, case = item
        folder = root / str(number)
        case.prepare(folder)
        return launch(case.call, folder, LIMIT), folder

    numbered = enumerate(chosen)
    for (_, case), folder, outcome in side_by_side(numbered, begin, options.jobs, options.deadline):
        intact = None if case.intact is None else world.answers[case.intact]
        verdict = judge(outcome, folder, intact, slow=case.slow)
        if verdict.good:
            shutil.rmtree(folder, ignore_errors=True)
        yield case.group, case.name, verdict


def report(found: Iterable[tuple[str, str, Verdict]], *, every: bool = False) -> int:
    """Print faults as they come and the count of every class at the end; the number of faults."""
    counts: dict[str, Counter[str]] = {}
    faults = 0
    for group, name, verdict in found:
        counts.setdefault(group, Counter())[verdict.word] += 1
        if not verdict.good:
            faults += 1
        if every or not verdict.good:
            mark = "     " if verdict.good else "FAULT"
            print(f"{mark} {group}: {name}: {verdict.word}: {verdict.detail[:300]}", flush=True)
    for group, words in sorted(counts.items()):
        message = ", ".join(f"{n} {word}" for word, n in words.most_common())
        print(f"{group:16s} {sum(words.values()):4d}: {message}")
    return faults


def arguments() -> argparse.Namespace:
    """Options of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1, help="of all that is random")
    parser.add_argument(
        "--share", type=float, default=1.0, help="of the malformed inputs and kills"
    )
    parser.add_argument("--seconds", type=float, default=1e9, help="none begins after so many")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="at a time")
    parser.add_argument("--only", help=f"a class of malformed inputs, or {', '.join(PARTS)}")
    parser.add_argument("--keep", type=Path, help="folder for the inputs that show a fault")
    parser.add_argument("--all", action="store_true", help="print what was no fault, too")
    options = parser.parse_args()
    options.deadline = time.monotonic() + options.seconds
    return options


def main() -> int:
    """All of it; exit status 1 if anything is at fault."""
    options = arguments()
    root = Path(options.keep or tempfile.mkdtemp(prefix="faults-"))
    try:
        world = make_world(root / "world")

        def everything() -> Iterator[tuple[str, str, Verdict]]:
            if options.only not in PARTS:
                yield from malformed(world, options)
            for name, part in PARTS.items():
                if options.only not in (None, name):
                    continue
                if time.monotonic() > options.deadline:
                    print(f"{name}: not begun, the time is over")
                else:
                    yield from part(world, options)

        faults = report(everything(), every=options.all)
        print(f"{faults} faults, seed {options.seed}, {time.monotonic() - began:.0f} s")
        return min(faults, 1)
    finally:
        if not options.keep:
            shutil.rmtree(root, ignore_errors=True)


if __name__ == "__main__":
    began = time.monotonic()
    sys.exit(main())
