"""Derivatives through the steps beside differences: elasticities and processor time.

    python benchmarks/sensitivity.py [SCENE] [--tolerance 1e-4]

Along one and along all numbers of a scene. Differences in the very same steps, of 0.1 and 1 %, and
of two runs in steps of their own, of 1 %, whose time is told, without the reduction.
"""

from __future__ import annotations

import argparse
from time import process_time
from typing import Any

from mpi4py import MPI

from fenics_ehd.scenes.build import build_mechanism
from fenics_ehd.scenes.given import changed
from fenics_ehd.scenes.scene_text import as_stored
from fenics_ehd.study.sensitivity import differences, scene_sensitivity

#: Steps for scenes that take long.
COARSE = {"time.tolerance": 1e-3}

#: What is changed, figures and numbers, by scene.
ASKED: dict[str, tuple[dict[str, Any], tuple[str, ...], tuple[str, ...]]] = {
    "slider-crank": (
        {},
        ("big_end.min_film_thickness", "big_end.max_pressure"),
        (
            "joints.big_end.clearance",
            "lubricants.oil.viscosity",
            "bodies.piston.mass",
            "drives.crank.speed",
            "bodies.rod.damping_time",
        ),
    ),
    "loaded-journal": (
        {},
        ("bearing.min_film_thickness", "bearing.max_pressure"),
        (
            "joints.bearing.clearance",
            "lubricants.oil.viscosity",
            "forces.load.scale",
            "joints.bearing.width",
            "joints.bearing.radius",
        ),
    ),
    "loaded-journal-starved": (
        {"joints.bearing.cells": [60, 6]},
        ("bearing.min_film_thickness", "bearing.max_pressure", "bearing.mean_side_flow"),
        ("joints.bearing.clearance",),
    ),
    "engine": (
        COARSE
        | {
            "joints.front.cells": [12, 2],
            "joints.back.cells": [12, 2],
            "joints.big_end.cells": [20, 5],
        },
        ("big_end.min_film_thickness", "big_end.max_pressure", "front.max_pressure"),
        ("joints.big_end.clearance", "forces.gas.scale"),
    ),
    "rotor": (
        COARSE | {"joints.bearing.cells": [20, 5]},
        ("bearing.min_film_thickness", "bearing.max_pressure"),
        ("joints.bearing.clearance", "forces.unbalance.amplitude"),
    ),
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default="slider-crank", choices=ASKED)
    parser.add_argument("--tolerance", type=float, help="of the steps, in place of the scene's")
    given = parser.parse_args()
    changes, of, to = ASKED[given.scene]
    if given.tolerance:
        changes = changes | {"time.tolerance": given.tolerance}
    scene = changed(as_stored(given.scene), changes)
    bodies = build_mechanism(scene, MPI.COMM_SELF).parts
    one = scene_sensitivity(scene, of, to[:1], bodies=bodies)
    every = scene_sensitivity(scene, of, to, bodies=bodies)
    print(
        "| quantity | along | through the steps | same steps, 0.1 % | same steps, 1 % | own steps |"
        "\n|---|---|---|---|---|---|"
    )
    spent = []
    for number in every.numbers:
        same = [
            differences(scene, number, every.figures, share, bodies, every.record)
            for share in (1e-3, 1e-2)
        ]
        clock = process_time()
        same.append(differences(scene, number, every.figures, bodies=bodies))
        spent.append(process_time() - clock)
        for figure in every.figures:
            per = number.value / every.values[figure]
            slopes = [every.derivatives[figure, number.key], *(own[figure] for own in same)]
            values = " | ".join(f"{per * slope:.4f}" for slope in slopes)
            print(f"| {figure.name} | {number.key} | {values} |", flush=True)
    print(
        "\n| numbers | the run [s] | through the steps [s] | differences [s] |\n|---|---|---|---|"
    )
    for found, count in ((one, 1), (every, len(every.numbers))):
        through, run = found.seconds["through the steps"], found.seconds["run"]
        print(f"| {count} | {run:.1f} | {through:.1f} | {sum(spent[:count]):.1f} |")


if __name__ == "__main__":
    main()
