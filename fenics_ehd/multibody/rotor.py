"""An elastic rotor by its modes at rest, turning at constant speed.

The modes of one plane of bending, mass-normalised, serve both planes: coordinates are
``(a, b)`` with the deflections ``u = Phi a`` along x and ``v = Phi b`` along y. The
gyroscopic matrix stays full in them, so that the modes need not be those of the turning rotor:

    a'' + 2 zeta Omega_r a' + Omega Phi^T G Phi b' + Omega_r^2 a = Phi^T f_x
    b'' + 2 zeta Omega_r b' - Omega Phi^T G Phi a' + Omega_r^2 b = Phi^T f_y
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from fenics_ehd.multibody.beam import BeamPlane
from fenics_ehd.multibody.dry_system import DrySystem

#: Share of its first bending frequency's square below which a shaft's mode is one of the whole.
FREE = 1e-9


@dataclass(frozen=True)
class RotatingForce:
    """Force that turns with the rotor, along x at time zero.

    Attributes
    ----------
    amplitude
        [N].
    speed
        [rad/s].
    ramp
        Time over which it grows, as a cosine does from its minimum to its maximum [s]; 0: there
        from the beginning.
    """

    amplitude: float
    speed: float
    ramp: float = 0.0

    def at(self, time: float) -> np.ndarray:
        """Components along x and y, shape (2,) [N]."""
        share = 1.0
        if time < self.ramp:
            share = 0.5 * (1 - np.cos(np.pi * time / self.ramp))
        angle = self.speed * time
        return share * self.amplitude * np.array([np.cos(angle), np.sin(angle)])


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

    @property
    def frequencies(self) -> np.ndarray:
        """The same in Hz."""
        return self.angular / (2 * np.pi)

    @property
    def size(self) -> int:
        """Number of coordinates, those of both planes."""
        return 2 * len(self.angular)

    def deflection(self, position: float) -> np.ndarray:
        """Deflections along x and y at a share of the length, shape (2, size) [m].

        Read the other way, the generalised forces of unit forces there.
        """
        row = self.beam.point(position)[0] @ self.shapes
        return np.kron(np.eye(2), row)

    def motion(self, position: float) -> np.ndarray:
        """Deflections and tilt ``(u, v, psi_x, psi_y)`` there, shape (4, size) [m], [rad].

        Small rotations about x and y: ``psi_x = -dv/dz`` and ``psi_y = du/dz``.
        """
        slope = np.kron(np.eye(2), self.beam.point(position)[1] @ self.shapes)
        return np.vstack([self.deflection(position), -slope[1], slope[0]])

    def system(
        self,
        speed: float,
        damping_ratio: float,
        force: RotatingForce,
        position: float,
    ) -> DrySystem:
        """Equations of motion of the turning rotor.

        Parameters
        ----------
        speed
            Omega [rad/s].
        damping_ratio
            zeta of every mode.
        force, position
            Force on the rotor and the share of the length where it acts.
        """
        both = np.concatenate([self.angular, self.angular])
        coupling = speed * self.shapes.T @ self.beam.gyroscopic @ self.shapes
        gyroscopic = np.kron(np.array([[0.0, 1.0], [-1.0, 0.0]]), coupling)
        acting = self.deflection(position).T
        return DrySystem(
            mass=np.eye(self.size),
            damping=2 * damping_ratio * np.diag(both) + gyroscopic,
            stiffness=np.diag(both**2),
            force=lambda time: acting @ force.at(time),
        )
