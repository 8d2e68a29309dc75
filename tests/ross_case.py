"""Roots of the shipped rotor on two bearings by ROSS, with the same bearing coefficients.

    python tests/ross_case.py --python .venv/ross/bin/python [-o tests/golden/ross.json]

ROSS (github.com/petrobras/ross) needs other versions of NumPy and SciPy than this package. It runs
in a process of its own with the given Python, from a virtual environment without system packages,
and gets stiffness and damping of the bearings as a file (`tests/ross_roots.py`). Its roots are
stored with the coefficients; `tests/test_ross.py` compares with the stored roots.

The rotor is that of ``rotor-two-bearings`` with shear deformation, without structural damping. ROSS
has no moments of the films on the tilting journals, so that the matrices of this package are
compared in two ways: without them, which tests the beam, and with them.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import fenics_ehd as ehd
from fenics_ehd.analysis.equilibrium import Linearisation

#: Speeds of the shaft [rad/s], and largest magnitude of the stored roots [1/s].
SPEEDS = (300.0, 600.0, 900.0, 1000.0)
LARGEST_ROOT = 3000.0

#: Settings of the scene in which the rotor differs from the shipped one.
CHANGES = {
    "bodies.shaft.theory": "timoshenko",
    "bodies.shaft.damping_ratio": 0.0,
    "bodies.shaft.modes": 40,
    "joints.left.cells": [48, 8],
    "joints.right.cells": [48, 8],
}


def linearised(speed: float) -> tuple[Linearisation, dict[str, np.ndarray]]:
    """Small motions of the rotor about its equilibrium at a speed [rad/s], on one film mesh.

    Returns
    -------
    Linearisation
        Small motions.
    dict
        Stiffness [N/m] and damping [N s/m] of every film without the tilts of its journal, shape
        (2, 2, 2), by the name of its joint.
    """
    machine = ehd.build(ehd.read_scene("rotor-two-bearings", **CHANGES))
    mechanism = replace(machine.mechanism, drives={"shaft": ehd.Speed(speed)}, forces={})
    rest = ehd.equilibrium(mechanism)
    linear = ehd.linearise(rest)
    films = {}
    for binding in rest.system.films:
        # Eccentricity and tilt of the journal in the coordinates of the linearised motions.
        relative = np.linalg.pinv(linear.basis[binding.xi])
        films[binding.name] = (linear.films[binding.name] @ relative)[:, :, :2]
    return linear, films


def coefficients(speed: float) -> dict[str, Any]:
    """Stiffness and damping of the bearings at a speed [rad/s], as ROSS gets them."""
    _, films = linearised(speed)
    return {
        "speed": speed,
        "stiffness": {name: film[0].tolist() for name, film in films.items()},
        "damping": {name: film[1].tolist() for name, film in films.items()},
    }


def rotor_case() -> dict[str, Any]:
    """Rotor and bearing coefficients, as `tests/ross_roots.py` reads them."""
    shaft = ehd.read_scene("rotor-two-bearings", **CHANGES).bodies["shaft"]
    names = ("length", "diameter", "youngs_modulus", "density", "poissons_ratio", "elements")
    rotor = {name: getattr(shaft, name) for name in names}
    rotor |= {"disks": shaft.disks, "largest_root": LARGEST_ROOT}
    rotor["bearings"] = {name: shaft.points[name] for name in ("left", "right")}
    return {"rotor": rotor, "points": [coefficients(speed) for speed in SPEEDS]}


def main() -> None:
    """Compute the roots by ROSS, and store them with the rotor and the coefficients."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--python", required=True, help="Python that has ROSS")
    parser.add_argument("-o", "--output", default="tests/golden/ross.json")
    chosen = parser.parse_args()
    case = rotor_case()
    script = Path(__file__).with_name("ross_roots.py")
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "rotor.json", Path(folder) / "roots.json"
        source.write_text(json.dumps(case))
        command = [chosen.python, "-I", script, source, target]
        # Libraries of ROSS print about programs that they do not find.
        run = subprocess.run(command, capture_output=True, text=True)
        if run.returncode:
            sys.exit(run.stderr)
        result = json.loads(target.read_text())
    for point, roots in zip(case["points"], result["roots"], strict=True):
        point["roots"] = roots
    points = ",\n".join(json.dumps(point) for point in case["points"])
    head = json.dumps({"ross": result["ross"], "rotor": case["rotor"]})[:-1]
    Path(chosen.output).write_text(f'{head},\n"points": [\n{points}\n]}}\n')


if __name__ == "__main__":
    main()
