"""What the film of forms costs in the loop, beside the one written by hand.

    python benchmarks/film_forms_loop.py [--pairs 9] [--only 1]

Both in one process, run by run in turn: medians of processor seconds, and of the pairs' ratios.
"""

from __future__ import annotations

import argparse
from statistics import median
from typing import Any
from unittest.mock import patch

from film_forms_film import FormsEquation
from scene_runs import CELLS, METHOD, TOLERANCE, Curves, Parts, changed, follow

import fenics_ehd.film.film as film_module
from fenics_ehd.film.reynolds import ReynoldsEquation
from fenics_ehd.multibody.run import Run
from fenics_ehd.scenes.build import Built

THIN = {"journal_roughness": 0.4e-6, "bore_roughness": 0.2e-6}
ROUGH = {f"joints.big_end.contact.{name}": value for name, value in THIN.items()}
OIL = {"lubricants.oil.barus": 1.5e-8, "lubricants.oil.cross_rate": 1e6}

CASES: dict[str, dict[str, Any]] = {
    "constant, 20 x 5": {},
    "constant, 40 x 10": {CELLS: [40, 10]},
    "Barus, Cross, Patir-Cheng, 20 x 5": OIL | ROUGH,
    "Barus, Cross, 20 x 5": OIL,
    "Barus, Cross, Patir-Cheng, 40 x 10": OIL | ROUGH | {CELLS: [40, 10]},
}


def run(built: Built, end: float) -> Curves:
    """One revolution."""
    return follow(Run(built.mechanism, built.steps, end), end)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=9)
    parser.add_argument("--only", type=int, nargs="*")
    arguments = parser.parse_args()
    parts = Parts()
    print("| case | steps | iterations | peak pressure | thinnest film | s | ratio |")
    print("|---|---|---|---|---|---|---|")
    for number, (name, values) in enumerate(CASES.items()):
        if arguments.only is not None and number not in arguments.only:
            continue
        scene = changed(
            "slider-crank-paper",
            {METHOD: "m4", TOLERANCE: 7e-4, "bodies.rod.reduction.estimate_error": False} | values,
        )
        built = []
        for equation in (ReynoldsEquation, FormsEquation):
            with patch.object(film_module, "ReynoldsEquation", equation):
                built.append(parts.build(scene))
        pairs = []
        for _ in range(arguments.pairs + 1):
            pairs.append([run(b, scene.span) for b in built])
        times = [[curves.seconds for curves in pair] for pair in pairs[1:]]
        ratio = median(b / a for a, b in times)
        for curves, kind, t in zip(
            pairs[-1], ("hand", "forms"), zip(*times, strict=True), strict=True
        ):
            if curves.error:
                print(kind, repr(curves.error))
            print(
                f"| {name}, {kind} | {curves.figures['steps']} | "
                f"{curves.figures['newton_iterations']} | {curves.pressure.max():.1f} Pa | "
                f"{1e6 * curves.film.min():.7f} um | {median(t):.2f} | "
                f"{ratio if kind == 'forms' else 1:.3f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
