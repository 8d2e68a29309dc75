"""A place for the crank's angle among the coordinates of a rod.

It is the last coordinate and moves no point of the rod relative to the shaft: fields and gap get
an empty column for it, forces an empty row.
"""

from __future__ import annotations

import numpy as np

from fenics_ehd.film import Film
from fenics_ehd.multibody.journal import Journal
from fenics_ehd.reduction.body import InertiaIntegrals, ReducedBody


def with_empty_column(fields: np.ndarray) -> np.ndarray:
    """Fields or derivatives, one a column, and one of zeros."""
    return np.hstack([fields, np.zeros((len(fields), 1))])


def with_empty_field(inertia: InertiaIntegrals) -> InertiaIntegrals:
    """Integrals with one more field, of zeros."""
    matrices = (inertia.mass, inertia.spin, inertia.centrifugal)
    return InertiaIntegrals(*(np.pad(matrix, (0, 1)) for matrix in matrices))


class FreeAngleJournal(Journal):
    """`Journal` whose coordinates end with the angle of the crank."""

    def __init__(
        self,
        body: ReducedBody,
        film: Film,
        transfer: str = "conservative",
        damping_time: float = 0.0,
    ):
        super().__init__(body, film, transfer, damping_time)
        self.thickness, self.mean_velocity, self.sliding_velocity, self._watched = (
            with_empty_column(columns)
            for columns in (
                self.thickness,
                self.mean_velocity,
                self.sliding_velocity,
                self._watched,
            )
        )
        self.load, self.spin_load = (
            np.pad(rows, ((0, 1), (0, 0))) for rows in (self.load, self.spin_load)
        )
