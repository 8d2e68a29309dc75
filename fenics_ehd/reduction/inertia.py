"""Inertia of a reduced part in a planar floating frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Places of the translations and of the elastic modes among the fields of a body.
TRANSLATIONS, ELASTIC = slice(1, 3), slice(3, None)


@dataclass(frozen=True, eq=False)
class InertiaIntegrals:
    """Inertia coupling of a planar floating frame, exact for the finite-element mass matrix.

    Fields, in order: the position x (from the bore centre), the unit
    translations along x and y, the elastic modes; ``B`` holds them as columns,
    ``S`` is ``e_z x`` node by node.

    Attributes
    ----------
    mass
        ``B^T M B``, shape (3 + n, 3 + n).
    spin
        ``B^T M S B``, antisymmetric: Coriolis and Euler accelerations.
    centrifugal
        ``(S B)^T M (S B)``, symmetric.
    """

    mass: np.ndarray
    spin: np.ndarray
    centrifugal: np.ndarray

    @property
    def total_mass(self) -> float:
        """Mass of the part [kg]."""
        return float(self.mass[1, 1])

    @property
    def centre_of_mass(self) -> np.ndarray:
        """Centre of mass from the bore centre, x and y [m]."""
        return self.mass[0, TRANSLATIONS] / self.total_mass

    @property
    def polar_inertia(self) -> float:
        """Moment of inertia about the z axis through the centre of mass [kg m^2]."""
        offset = self.centre_of_mass
        return float(self.centrifugal[0, 0] - self.total_mass * offset @ offset)
