"""Golden curves: how far today's program is from them.

    python benchmarks/golden.py [NAME ...] [--held] [--make]
    python benchmarks/golden.py --counts [NAME ...] [--make]

Without names all of them, the shipped scenes too. For every one the largest deviation in held
steps, relative to the largest value of its column, and of extremes, steps and iterations of a run
in its own steps. `--make` writes the files anew: a decision, for which the commit gives the reason.

With `--counts`, the counts of work of shortened scenes and of reductions, and those of
`tests/golden/counts.json`, and a mark if the test would refuse them; `--make` writes all of them.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from golden_curves import FOLDER, SHIPPED, SMALL, compared, make
from work_counts import REDUCTIONS, counts_of, differing, store, stored


def line(name: str, held_only: bool) -> str:
    """Row of the table."""
    found = compared(name, own=not held_only)
    column, held = max(found["held"].items(), key=lambda item: item[1])
    extremes = [abs(v) for key, v in found["own"].items() if "." in key]
    counts = [f"{100 * found['own'].get(k, 0.0):+.1f} %" for k in ("steps", "newton_iterations")]
    return (
        f"| {name} | {held:.1e} | {column} | {max(extremes, default=0.0):.1e} | "
        f"{' | '.join(counts)} |"
    )


def print_counts(names: list[str]) -> None:
    """Table of the counts of scenes and reductions, then and now."""
    print("| scene or reduction | count | golden | now | |\n|---|---|---|---|---|")
    for name in names or (*SHIPPED, *REDUCTIONS):
        expected = stored()[name]
        counts = counts_of(name)
        refused = differing(counts, expected)
        for key, number in expected.items():
            mark = "differs" if key in refused else ""
            print(f"| {name} | {key} | {number} | {counts.get(key)} | {mark} |", flush=True)


def main() -> None:
    """The table, or the files."""
    os.environ["FENICS_EHD_CACHE"] = "off"  # parts are reduced
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*")
    parser.add_argument("--held", action="store_true", help="held steps only")
    parser.add_argument("--make", action="store_true", help="write the files anew")
    parser.add_argument("--counts", action="store_true", help="counts of work only")
    options = parser.parse_args()
    if options.counts:
        store() if options.make else print_counts(options.names)
        return
    names = options.names or [*SMALL, *SHIPPED]
    if options.make:
        for name in names:
            make(name).save(FOLDER / f"{name}.json")
            print(name, flush=True)
        return
    print("| scene | held | of | extremes | steps | iterations |\n|---|---|---|---|---|---|")
    for name in names:
        print(line(name, options.held), flush=True)


if __name__ == "__main__":
    main()
