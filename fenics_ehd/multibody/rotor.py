"""An elastic rotor by its modes at rest.

The modes of one plane of bending, mass-normalised, serve both planes: coordinates are
``(a, b)`` with the deflections ``u = Phi a`` along x and ``v = Phi b`` along y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from fenics_ehd.multibody.beam import BeamPlane

#: Share of its first bending frequency's square below which a shaft's mode is one of the whole.
FREE = 1e-9


@dataclass(frozen=True, eq=False)
class ModalRotor:
    """Rotor in the coordinates ``(a, b)``, m of each.

    Attributes
    ----------
    beam
        The plane it was reduced from.
    shapes
        Phi, shape (d, m).
    angular
        Angular frequencies of the rotor at rest, its bearing empty, shape (m,) [rad/s].
    """

    beam: BeamPlane
    shapes: np.ndarray
    angular: np.ndarray

    @classmethod
    def of(cls, beam: BeamPlane, modes: int) -> ModalRotor:
        """Keep the lowest `modes` of each plane."""
        # Ascending in 1 / omega^2, the lowest modes are the largest eigenvalues: exact to
        # round-off however high the highest are. A shaft without supports moves as a whole too,
        # at no frequency, and 1 / (omega^2 + shift) is there as well.
        d, shift = len(beam.mass), 0.0 if beam.shaft.support_stiffness else beam.shaft.bending
        raised = beam.stiffness + shift * beam.mass
        values, shapes = eigh(beam.mass, raised, subset_by_index=(d - modes, d - 1))
        squares = 1.0 / values[::-1]
        angular = np.sqrt(np.where(squares - shift > FREE * shift, squares - shift, 0.0))
        return cls(beam, shapes[:, ::-1] * np.sqrt(squares), angular)

    def motion(self, position: float) -> np.ndarray:
        """Deflections and tilt ``(u, v, psi_x, psi_y)`` at a share of the length, shape (4, 2 m).

        Small rotations about x and y: ``psi_x = -dv/dz`` and ``psi_y = du/dz``. Read the other
        way, the generalised forces of unit forces and moments there.
        """
        deflection, slope = (
            np.kron(np.eye(2), row) for row in self.beam.point(position) @ self.shapes
        )
        return np.vstack([deflection, -slope[1], slope[0]])
