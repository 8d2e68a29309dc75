"""Evaluations of film equations: one point of Newton's method.

A film model (`fenics_ehd.multibody.film_models`) evaluates its equations at unknowns and returns a
point; derivatives, convergence, contents and the state of the film are computed from it.
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
    """One evaluation of a film's equations.

    Attributes
    ----------
    pressures
        Dimensionless pressures of the m nodes with unknowns, of dry sides their outflows.
    nodal
        Dimensionless pressures of all nodes.
    gap
        The gap.
    problem
        Complementarity problem of the equations at this gap.
    defect
        Residual of all unknowns of the film, of order one.
    contact
        Asperity contact at the Gauss points; None: smooth surfaces.
    turning
        Rows of the turning surface; None: no surface turns.
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
        """Fraction of the gap that oil fills at all nodes; None if the model has none."""
        return None

    @property
    def weights(self) -> np.ndarray | None:
        """Entries of W in the model's pattern; None: identity."""
        return self.problem.weights


@dataclass(frozen=True, eq=False)
class OilPoint(FilmPoint):
    """One evaluation of a film with mass-conserving cavitation.

    Attributes
    ----------
    void
        Void fractions of the m nodes with unknowns.
    step
        The time step of the oil balance.
    transport
        Transport of the void fractions.
    """

    void: np.ndarray
    step: OilStep
    transport: Transport

    @property
    def fluid_fraction(self) -> np.ndarray:
        """Fraction of the gap that oil fills at all nodes."""
        return 1.0 - self.transport.void

    @property
    def weights(self) -> np.ndarray:
        """Entries of W: derivative of the transport along the void fractions."""
        return self.transport.entries

    @property
    def balance(self) -> np.ndarray:
        """Defect of the oil balance at the m nodes."""
        return self.defect[len(self.void) :]
