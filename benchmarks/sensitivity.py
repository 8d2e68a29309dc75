"""Derivatives in the same steps: elasticities by change, on a finer film, in own steps, and time.

    python benchmarks/sensitivity.py [SCENE] [--tolerance 1e-4]

Of 1 and 0.1 % in the very same steps, on films of half as many cells again either way, and of two
runs in steps of their own, of 1 %. Times are without the reduction.
"""

from __future__ import annotations

import argparse
from time import process_time
from typing import Any

import fenics_ehd as ehd
from fenics_ehd.analysis.sensitivity import SHARE, derivatives
from fenics_ehd.study.sensitivity import mechanism_parameter, scene_sensitivity

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
    scene = ehd.read_scene(given.scene, **changes)
    bodies = ehd.build(scene, cache=False).bodies
    every = scene_sensitivity(scene, of, to, bodies=bodies, finer=True, cache=False)
    plain = scene_sensitivity(scene, of, to, bodies=bodies, cache=False)
    print(
        "| quantity | along | same steps, 1 % | same steps, 0.1 % | finer film, 1 % | own steps |"
        "\n|---|---|---|---|---|---|"
    )
    spent = 0.0
    for along in every.parameters:
        number = mechanism_parameter(scene, along, bodies)
        small = derivatives(plain.trajectory, number, plain.objectives, share=1e-3)
        clock = process_time()
        names = [f"{objective.joint}.{objective.name}" for objective in every.objectives]
        above, below = (
            scene_sensitivity(
                along.change(scene, share), names, [], bodies=bodies, cache=False
            ).values
            for share in (SHARE, -SHARE)
        )
        spent += process_time() - clock
        for objective in every.objectives:
            per, key = along.value / every.values[objective], (objective, along.key)
            slopes = (
                every.derivatives[key],
                small[objective],
                every.finer[key],
                (above[objective] - below[objective]) / (2 * SHARE * along.scale),
            )
            values = " | ".join(f"{per * slope:.4f}" for slope in slopes)
            print(f"| {objective.name} | {along.key} | {values} |", flush=True)
    run, found = plain.seconds.values()
    print(
        "\n| numbers | the run [s] | derivatives | with finer films | in own steps |"
        f"\n|---|---|---|---|---|\n| {len(every.parameters)} | {run:.1f} | {found:.1f} | "
        f"{every.seconds['derivatives']:.1f} | {spent:.1f} |"
    )


if __name__ == "__main__":
    main()
