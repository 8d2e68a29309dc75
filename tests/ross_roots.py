"""Roots of a rotor with given bearing coefficients by ROSS, in a Python that has ROSS alone.

    python tests/ross_roots.py INPUT OUTPUT

INPUT is a JSON file of `tests/ross_case.py` with the rotor, and with stiffness and damping of its
bearings at each speed; OUTPUT gets the version of ROSS and the roots at each speed. The script does
not import this package, whose NumPy may be another one.
"""

import json
import sys
from importlib.metadata import version
from pathlib import Path

import ross

#: Magnitude of a root below which it belongs to a free axial motion or rotation [1/s].
FREE = 1.0


def rotor_at(rotor: dict, point: dict) -> ross.Rotor:
    """Rotor of ROSS with the bearing coefficients at one speed."""
    steel = ross.Material(
        "steel", rho=rotor["density"], E=rotor["youngs_modulus"], Poisson=rotor["poissons_ratio"]
    )
    number = rotor["elements"]
    shaft = [
        ross.ShaftElement(
            rotor["length"] / number, 0.0, rotor["diameter"], material=steel, shear_effects=True
        )
        for _ in range(number)
    ]
    disks = [
        ross.DiskElement(round(share * number), m=mass, Ip=polar, Id=diametral)
        for share, mass, polar, diametral in rotor["disks"]
    ]
    bearings = []
    for name, share in rotor["bearings"].items():
        entries = {}
        for letter, matrix in (("k", point["stiffness"][name]), ("c", point["damping"][name])):
            for i, row in zip("xy", matrix, strict=True):
                entries |= {f"{letter}{i}{j}": v for j, v in zip("xy", row, strict=True)}
        bearings.append(ross.BearingElement(round(share * number), **entries))
    return ross.Rotor(shaft, disks, bearings)


def roots_of(rotor: dict, point: dict) -> list[list[float]]:
    """Roots with an imaginary part of at least 0, as pairs, ascending in magnitude [1/s]."""
    made = rotor_at(rotor, point)
    modal = made.run_modal(point["speed"], num_modes=2 * made.ndof, sparse=False)
    roots = [root for root in modal.evalues if root.imag >= 0.0 and abs(root) > FREE]
    roots = [root for root in roots if abs(root) < rotor["largest_root"]]
    return [[float(root.real), float(root.imag)] for root in sorted(roots, key=abs)]


def main() -> None:
    """Read the rotor, compute the roots at all speeds, and write them."""
    source, target = map(Path, sys.argv[1:])
    case = json.loads(source.read_text())
    roots = [roots_of(case["rotor"], point) for point in case["points"]]
    result = {"ross": version("ross-rotordynamics"), "roots": roots}
    target.write_text(json.dumps(result))


if __name__ == "__main__":
    main()
