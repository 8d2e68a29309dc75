"""Points: the equations of a film evaluated at one iterate of Newton's method.

A film model (`fenics_ehd.multibody.film_models`) evaluates its equations at unknowns and returns a
point. Derivatives, convergence, oil contents and the state of the film are computed from it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fenics_ehd.film.cavitation import Complementarity
from fenics_ehd.film.kinematics import Gap
from fenics_ehd.film.oil_balance import OilStep, Transport
from fenics_ehd.film.rough_surfaces import AsperityContact
from fenics_ehd.multibody.surface import TurningRows


@dataclass(frozen=True, eq=False)
class FilmPoint:
    """Equations of a film evaluated at one iterate of Newton's method.

    Attributes
    ----------
    pressures
        Dimensionless pressures of the m nodes with unknowns, shape (m,). The unknowns of nodes at
        dry sides are dimensionless outflows in place of pressures.
    nodal
        Dimensionless pressures of all nodes, shape (nodes,).
    gap
        Gap at the Gauss points.
    problem
        Complementarity problem of the equations at this gap.
    defect
        Residual of all equations of the film, scaled to order one, shape (unknowns,).
    contact
        Asperity contact at the Gauss points; None for smooth surfaces.
    turning
        Derivatives of the gap with respect to the coordinates of a turning surface; None if no
        surface turns.
    """

    pressures: np.ndarray
    nodal: np.ndarray
    gap: Gap
    problem: Complementarity
    defect: np.ndarray
    contact: AsperityContact | None = field(default=None, kw_only=True)
    turning: TurningRows | None = field(default=None, kw_only=True)

    @property
    def fluid_fraction(self) -> np.ndarray | None:
        """Fraction of the gap that oil fills, shape (nodes,); None if it is not defined."""
        return None

    @property
    def weights(self) -> np.ndarray | None:
        """Entries of the matrix W that multiplies the film's defects, in the model's pattern.

        None if W is the identity.
        """
        return self.problem.weights


@dataclass(frozen=True, eq=False)
class OilPoint(FilmPoint):
    """Equations of a film with mass-conserving cavitation at one iterate of Newton's method.

    Attributes
    ----------
    void
        Void fractions of the m nodes with unknowns, shape (m,).
    step
        Data of the oil balance for the time step.
    transport
        Transport of the void fractions by the flow of the oil.
    """

    void: np.ndarray
    step: OilStep
    transport: Transport

    @property
    def fluid_fraction(self) -> np.ndarray:
        """Fraction of the gap that oil fills, shape (nodes,)."""
        return 1.0 - self.transport.void

    @property
    def weights(self) -> np.ndarray:
        """Entries of the derivative of the transport of void with respect to void fractions.

        This derivative is the matrix W of the film's equations; its entries are in the model's
        pattern.
        """
        return self.transport.entries

    @property
    def balance(self) -> np.ndarray:
        """Defect of the oil balance at the nodes with unknowns, shape (m,)."""
        return self.defect[len(self.void) :]
