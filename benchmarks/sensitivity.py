"""Derivatives through the steps beside differences: elasticities and processor time.

    python benchmarks/sensitivity.py [SCENE] [--tolerance 1e-4]

One and five numbers of a scene. Differences in the very same steps, of 0.1 and 1 %, and of two runs
in steps of their own, of 1 %, whose time is told, without the reduction.
"""

from __future__ import annotations

import argparse
from time import process_time

from mpi4py import MPI

from fenics_ehd.scenes.build import build_mechanism
from fenics_ehd.scenes.given import changed
from fenics_ehd.scenes.scene_text import as_stored
from fenics_ehd.study.sensitivity import differences, scene_sensitivity

#: Figures and numbers by scene.
ASKED = {
    "slider-crank": (
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
        ("bearing.min_film_thickness", "bearing.max_pressure"),
        (
            "joints.bearing.clearance",
            "lubricants.oil.viscosity",
            "forces.load.scale",
            "joints.bearing.width",
            "joints.bearing.radius",
        ),
    ),
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default="slider-crank", choices=ASKED)
    parser.add_argument("--tolerance", type=float, help="of the steps, in place of the scene's")
    given = parser.parse_args()
    scene = as_stored(given.scene)
    if given.tolerance:
        scene = changed(scene, {"time.tolerance": given.tolerance})
    of, to = ASKED[given.scene]
    bodies = build_mechanism(scene, MPI.COMM_SELF).parts
    one = scene_sensitivity(scene, of, to[:1], bodies=bodies)
    five = scene_sensitivity(scene, of, to, bodies=bodies)
    print(
        "| quantity | along | through the steps | same steps, 0.1 % | same steps, 1 % | own steps |"
        "\n|---|---|---|---|---|---|"
    )
    spent = []
    for number in five.numbers:
        same = [
            differences(scene, number, five.figures, share, bodies, five.record)
            for share in (1e-3, 1e-2)
        ]
        clock = process_time()
        same.append(differences(scene, number, five.figures, bodies=bodies))
        spent.append(process_time() - clock)
        for figure in five.figures:
            per = number.value / five.values[figure]
            slopes = [five.derivatives[figure, number.key], *(own[figure] for own in same)]
            values = " | ".join(f"{per * slope:.4f}" for slope in slopes)
            print(f"| {figure.name} | {number.key} | {values} |", flush=True)
    print(
        "\n| numbers | the run [s] | through the steps [s] | differences [s] |\n|---|---|---|---|"
    )
    for found, count in ((one, 1), (five, len(five.numbers))):
        through, run = found.seconds["through the steps"], found.seconds["run"]
        print(f"| {count} | {run:.1f} | {through:.1f} | {sum(spent[:count]):.1f} |")


if __name__ == "__main__":
    main()
