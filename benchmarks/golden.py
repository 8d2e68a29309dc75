"""Golden curves: how far today's program is from them.

    python benchmarks/golden.py [NAME ...] [--held] [--make]

Without names all of them, the shipped scenes too. For every one the largest deviation in held
steps, relative to the largest value of its column, and of extremes, steps and iterations of a run
in its own steps. `--make` writes the files anew: a decision, for which the commit gives the reason.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from golden_curves import FOLDER, SHIPPED, SMALL, compared, make


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


def main() -> None:
    """The table, or the files."""
    os.environ["FENICS_EHD_CACHE"] = "off"  # parts are reduced
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", default=[*SMALL, *SHIPPED])
    parser.add_argument("--held", action="store_true", help="held steps only")
    parser.add_argument("--make", action="store_true", help="write the files anew")
    options = parser.parse_args()
    if options.make:
        for name in options.names:
            make(name).save(FOLDER / f"{name}.json")
            print(name, flush=True)
        return
    print("| scene | held | of | extremes | steps | iterations |\n|---|---|---|---|---|---|")
    for name in options.names:
        print(line(name, options.held), flush=True)


if __name__ == "__main__":
    main()
