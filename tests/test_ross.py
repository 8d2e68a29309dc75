"""Roots of a rotor with given bearing coefficients against those stored of ROSS.

`tests/ross_case.py` makes the file again, with ROSS in a process of its own (``make figures``).
"""

import json
from pathlib import Path

import numpy as np
import pytest
from ross_case import linearised

import fenics_ehd as ehd
from fenics_ehd.multibody.shaft import beam_plane

STORED = json.loads((Path(__file__).parent / "golden" / "ross.json").read_text())
POINTS = STORED["points"]

#: Largest magnitude of compared roots [1/s], and damping ratio of roots that are not compared.
LARGEST, OVERDAMPED = 1000.0, 0.7


def beam_roots(point):
    """Roots of the full beam with the stored coefficients at its bearings [1/s]."""
    rotor = STORED["rotor"]
    names = ("length", "diameter", "youngs_modulus", "density", "poissons_ratio", "elements")
    shaft = ehd.Shaft(
        **{name: rotor[name] for name in names}, support_stiffness=0.0, theory="timoshenko"
    )
    plane = beam_plane(shaft, rotor["disks"])
    both = np.eye(2)
    stiffness = np.kron(both, plane.stiffness)
    damping = point["speed"] * np.kron([[0.0, 1.0], [-1.0, 0.0]], plane.gyroscopic)
    for name, share in rotor["bearings"].items():
        row = np.kron(both, plane.point(share)[0])
        stiffness = stiffness + row.T @ point["stiffness"][name] @ row
        damping = damping + row.T @ point["damping"][name] @ row
    mass = np.linalg.inv(np.kron(both, plane.mass))
    unit, zero = np.eye(len(mass)), np.zeros_like(mass)
    return np.linalg.eigvals(np.block([[zero, unit], [-mass @ stiffness, -mass @ damping]]))


def largest_distance(roots, point):
    """Largest relative distance of a compared root of ROSS from the nearest of `roots`."""
    stored = np.array([complex(*root) for root in point["roots"]])
    stored = stored[(abs(stored) < LARGEST) & (-stored.real < OVERDAMPED * abs(stored))]
    assert len(stored) >= 2
    return max(np.abs(roots - root).min() / abs(root) for root in stored)


@pytest.mark.parametrize("point", POINTS, ids=lambda point: f"{point['speed']:g}")
def test_a_beam_with_given_coefficients_has_the_roots_of_ross(point, figure):
    error = largest_distance(beam_roots(point), point)
    figure("rotor", "ROSS with the same stiffness and damping, beam alone", error, most=1e-8)


@pytest.mark.parametrize("point", POINTS, ids=lambda point: f"{point['speed']:g}")
def test_a_rotor_linearised_with_its_films_has_the_roots_of_ross(point, figure):
    """The films also resist tilts of the journals, which ROSS does not know."""
    linear, films = linearised(point["speed"])
    for name in films:
        for matrix, stored in zip(films[name], ("stiffness", "damping"), strict=True):
            expected = np.array(point[stored][name])
            np.testing.assert_allclose(matrix, expected, atol=1e-4 * np.abs(expected).max())
    error = largest_distance(linear.roots, point)
    figure("rotor", "ROSS with the same stiffness and damping, roots below 1000 rad/s", error,
           most=0.01, unit="%")  # fmt: skip
