"""Time of machines by this version over that of another checkout, run in turn.

    git worktree add --detach ../former COMMIT && make -C ../former set-up
    python benchmarks/house.py --former ../former [--repetitions 10] [NAME ...]

Scenes of `tests/golden/house`, their bodies stored; what a mechanism sets up is counted, imports
and compilation of forms, which a first run does, are not. Medians of processor seconds of one
process each, and the median of the ratios pair by pair.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parents[1]
SCENES = Path("tests") / "golden" / "house"

#: Constant oil first, then two models and more.
NAMES = (
    "slider-crank-small", "slider-crank-plain", "slider-crank-both", "rotor-tilt",
    "slider-crank-torque", "four-bar-oil", "slider-crank-rough", "slider-crank-conserved",
    "journal-starved",
)  # fmt: skip


def run(checkout: Path, name: str) -> dict[str, Any]:
    """One run in a process of its own."""
    quiet = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    found = subprocess.run(
        [
            checkout / ".venv/bin/python",
            HERE / "benchmarks/house_case.py",
            # Its own: keys may have had other names.
            checkout / SCENES / f"{name}.toml",
        ],
        env=quiet,
        capture_output=True,
        text=True,
        check=True,
        cwd=checkout,
    )
    return json.loads(found.stdout.splitlines()[-1])


def row(name: str, former: Path, repetitions: int) -> str:
    """Row of the table."""
    for checkout in (former, HERE):
        run(checkout, name)  # forms are compiled, files are in memory
    pairs = [(run(former, name), run(HERE, name)) for _ in range(repetitions)]
    then, now = (np.array([one[i]["seconds"] for one in pairs]) for i in (0, 1))
    counts = (
        f"{one['steps']} / {one['newton_iterations']}" for one in (pairs[-1][0], pairs[-1][1])
    )
    return (
        f"| {name} | {' | '.join(counts)} | {np.median(then):.2f} | {np.median(now):.2f} | "
        f"{np.median(now / then):.3f} |"
    )


def main() -> None:
    """The table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", default=NAMES)
    parser.add_argument("--former", type=Path, required=True, help="another checkout, set up")
    parser.add_argument("--repetitions", type=int, default=10)
    options = parser.parse_args()
    print("| scene | steps / iterations before | now | seconds before | now | ratio |")
    print("|---|---|---|---|---|---|")
    for name in options.names:
        print(row(name, options.former.resolve(), options.repetitions), flush=True)


if __name__ == "__main__":
    main()
