"""Finite elements of a round shaft after Bernoulli and Euler.

A node has four degrees of freedom: the deflections u, v along x and y and the slopes u', v'
along the shaft. A round shaft has the same matrices in both planes, so that one plane is
assembled, with two degrees of freedom a node, and the planes are coupled by the gyroscopic
matrix G alone. At the angular speed Omega about z

    M u'' + Omega G v' + K u = f_x,      M v'' - Omega G u' + K v = f_y

(dashes here: time). G is twice the rotary inertia of the shaft, whose polar inertia is twice
the diametral one, and the polar inertia of the disks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Shaft:
    """Uniform round shaft on two springs.

    Attributes
    ----------
    length, diameter
        [m].
    youngs_modulus, density
        [Pa], [kg/m^3].
    support_stiffness
        Of the spring at either end, the same in all directions [N/m].
    elements
        Of equal length.
    """

    length: float
    diameter: float
    youngs_modulus: float
    density: float
    support_stiffness: float
    elements: int

    @property
    def area(self) -> float:
        """Cross section [m^2]."""
        return np.pi / 4 * self.diameter**2

    @property
    def second_moment(self) -> float:
        """Second moment of area about a diameter [m^4]."""
        return np.pi / 64 * self.diameter**4

    @property
    def mass(self) -> float:
        """[kg]."""
        return self.density * self.area * self.length

    @property
    def bending(self) -> float:
        """About the square of its first free bending frequency [rad^2/s^2]."""
        flexural = self.youngs_modulus * self.second_moment
        return 500.0 * flexural / (self.density * self.area * self.length**4)

    @property
    def polar_inertia(self) -> float:
        """About the axis [kg m^2]."""
        return 2 * self.density * self.second_moment * self.length


@dataclass(frozen=True)
class Disk:
    """Rigid disk fixed to the shaft.

    Attributes
    ----------
    position
        Share of the shaft's length.
    mass
        [kg].
    polar_inertia, diametral_inertia
        About the shaft's axis and about a diameter [kg m^2].
    """

    position: float
    mass: float
    polar_inertia: float
    diametral_inertia: float


@dataclass(frozen=True, eq=False)
class BeamPlane:
    """Matrices of one plane of bending.

    Degrees of freedom are ``2 * node`` (deflection) and ``2 * node + 1`` (slope).

    Attributes
    ----------
    shaft
        What was discretised.
    stiffness, mass, gyroscopic
        K, M and G, symmetric, shape (d, d), d = 2 (elements + 1).
    """

    shaft: Shaft
    stiffness: np.ndarray
    mass: np.ndarray
    gyroscopic: np.ndarray

    def point(self, position: float) -> np.ndarray:
        """Deflection and slope at a share of the length, shape (2, d).

        Read the other way, the generalised forces of a unit force and a unit moment there.
        """
        n = self.shaft.elements
        element = min(int(position * n), n - 1)
        size = self.shaft.length / n
        rows = np.zeros((2, 2 * (n + 1)))
        rows[:, 2 * element : 2 * element + 4] = _hermite(position * n - element, size)
        return rows


def beam_plane(shaft: Shaft, disks: Sequence[Disk] = ()) -> BeamPlane:
    """Assemble one plane: consistent mass with rotary inertia, gyroscopic matrix, end springs."""
    n = shaft.elements
    size = shaft.length / n
    bending, translation, rotation = _element(size)
    rotary = shaft.density * shaft.second_moment * rotation
    stiffness, mass, gyroscopic = (np.zeros((2 * n + 2, 2 * n + 2)) for _ in range(3))
    for e in range(n):
        place = slice(2 * e, 2 * e + 4)
        stiffness[place, place] += shaft.youngs_modulus * shaft.second_moment * bending
        mass[place, place] += shaft.density * shaft.area * translation + rotary
        gyroscopic[place, place] += 2 * rotary
    for end in (0, 2 * n):
        stiffness[end, end] += shaft.support_stiffness
    beam = BeamPlane(shaft, stiffness, mass, gyroscopic)
    for disk in disks:
        deflection, slope = beam.point(disk.position)
        mass += disk.mass * np.outer(deflection, deflection)
        mass += disk.diametral_inertia * np.outer(slope, slope)
        gyroscopic += disk.polar_inertia * np.outer(slope, slope)
    return beam


def _element(h: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Integrals of N'' N'', N N and N' N' over an element of length h, shape (4, 4) each."""
    bending = np.array(
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, 4 * h**2, -6 * h, 2 * h**2],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, 2 * h**2, -6 * h, 4 * h**2],
        ]
    )
    translation = np.array(
        [
            [156, 22 * h, 54, -13 * h],
            [22 * h, 4 * h**2, 13 * h, -3 * h**2],
            [54, 13 * h, 156, -22 * h],
            [-13 * h, -3 * h**2, -22 * h, 4 * h**2],
        ]
    )
    rotation = np.array(
        [
            [36, 3 * h, -36, 3 * h],
            [3 * h, 4 * h**2, -3 * h, -(h**2)],
            [-36, -3 * h, 36, -3 * h],
            [3 * h, -(h**2), -3 * h, 4 * h**2],
        ]
    )
    return bending / h**3, translation * h / 420, rotation / (30 * h)


def _hermite(s: float, h: float) -> np.ndarray:
    """Cubic shape functions of an element of length h and their slopes, s from 0 to 1: (2, 4)."""
    values = [
        1 - 3 * s**2 + 2 * s**3,
        h * (s - 2 * s**2 + s**3),
        3 * s**2 - 2 * s**3,
        h * (s**3 - s**2),
    ]
    slopes = [
        6 * (s**2 - s) / h,
        1 - 4 * s + 3 * s**2,
        6 * (s - s**2) / h,
        3 * s**2 - 2 * s,
    ]
    return np.array([values, slopes])
