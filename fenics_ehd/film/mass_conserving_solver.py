"""Complementarity of pressure and void fraction, both unknown, by PETSc SNES-VI.

Find ``p >= 0`` and ``s >= 0`` with ``r(p) = t(s)`` and ``p . s = 0``, component by
component. ``t^-1(r(p)) >= 0`` as the function of p alone is no help here: t
transports along the film, so that the sign of one component tells about all the
nodes upstream. With both as variables SNES-VI solves

    p >= 0   complementary to   s + gamma d >= 0,      d = r(p) - t(s) = 0.

``gamma d`` vanishes at the solution. On the way it is what tells a full node
whose Newton update was negative, and was cut off at p = 0, to empty: its void fraction is
zero, and only its defect d knows. Each Newton step then solves

    A_I p_I - T_C s_C = b,    A = dr/dp,  T = dt/ds,

on the full nodes I and the others C, one sparse system of one pattern
(`ActiveSetSystem`), and moves between I and C the nodes with a wrong sign.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from fenics_ehd.base.errors import CavitationError
from fenics_ehd.film.active_set import ActiveSetSystem
from fenics_ehd.film.cavitation import (
    CavitationResult,
    verify_complementarity,
)
from fenics_ehd.film.oil_balance import OilProblem
from fenics_ehd.film.oil_state import DEFECT_WEIGHT
from fenics_ehd.film.pattern import Pattern
from fenics_ehd.film.snes_vi import SnesVi


class MassConservingSolver:
    """SNES-VI for pressure and void fraction, reused from solve to solve.

    Parameters
    ----------
    pattern
        Of A and T, n x n.
    options_prefix
        Prefix of the PETSc options, ``"oil_"`` gives ``-oil_snes_monitor`` and
        ``-oil_linear_pc_type``.
    tolerance
        On the 2-norm of defects and of the void fractions at full nodes, each row of the
        balance over the diagonals of T and A; times `Complementarity.scale`.
    """

    def __init__(
        self,
        pattern: Pattern,
        *,
        options_prefix: str = "oil_",
        tolerance: float = 1e-10,
    ):
        self._pattern = pattern
        self._n = n = pattern.size
        self.system = ActiveSetSystem(
            pattern,
            weighted=True,
            symmetric=False,
            options_prefix=f"{options_prefix}linear_",
        )
        self._snes = SnesVi(
            self,
            np.append(np.zeros(n), np.full(n, PETSc.NINFINITY)),
            options_prefix=options_prefix,
            tolerance=tolerance,
        )

    # The following four are called by SNES-VI during a solve.

    def function(self, x: np.ndarray) -> np.ndarray:
        """See `VariationalInequality`."""
        pressure, void = x[: self._n] * self._problem.unit, x[self._n :]
        defect = (self._problem.residual(pressure) - self._problem.transport(void)) / self._rows
        return np.concatenate([void + DEFECT_WEIGHT * defect, defect]) / self._problem.scale

    def linearise(self, x: np.ndarray) -> None:
        """See `VariationalInequality`."""
        self._entries = self._problem.entries(x[: self._n] * self._problem.unit)
        self._transport = self._problem.transport_entries(x[self._n :])

    def factorise(self, nodes: np.ndarray) -> None:
        """Factorise for the active set SNES-VI has chosen."""
        self._full = nodes[nodes < self._n]
        self.system.prepare(self._entries, self._transport, self._full)

    def update(self, rhs: np.ndarray) -> np.ndarray:
        """Newton update of the pressures of the full nodes and of all void fractions."""
        given = rhs * self._problem.scale
        count = len(self._full)
        defect, void = given[count:], np.zeros(self._n)
        void[self._full] = given[:count] - DEFECT_WEIGHT * defect[self._full]
        carried = self._pattern.multiply(self._transport, void)
        update = self.system.solution(defect * self._rows + carried)
        pressure = update[self._full] / self._problem.unit
        return np.concatenate([pressure, np.where(self.system.full, void, update)])

    def solve(
        self, problem: OilProblem, pressure: np.ndarray, void: np.ndarray
    ) -> CavitationResult:
        """Solve a complementarity problem.

        Parameters
        ----------
        problem
            r and t.
        pressure, void
            Start values, shape (n,): the zeros of the pressure with a positive void fraction
            are the first empty nodes.

        Raises
        ------
        CavitationError
            SNES-VI did not converge, or the result fails its own check; its
            `state` holds pressure and void fraction.
        """
        self._problem, self._rows = problem, problem.rows
        start = np.maximum(pressure, 0.0) / problem.unit
        try:
            x, _, iterations = self._snes.solve(np.append(start, np.maximum(void, 0.0)))
        except CavitationError as error:
            pressure, void = np.split(error.state.pop("x"), 2)
            error.state |= {"pressure": pressure * problem.unit, "void_fraction": void}
            raise
        pressure, void = np.split(x, 2)
        pressure = pressure * problem.unit
        verify_complementarity(pressure, void, 1.0)
        # Round-off leaves void fractions of 1e-17 in the full film: the larger of the two tells.
        full = pressure > void * pressure.max(initial=0.0)
        return CavitationResult(
            pressure, np.where(full, 0.0, void), np.flatnonzero(full).astype(np.int32), iterations
        )

    def derivative(
        self, problem: OilProblem, result: CavitationResult, change: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Changes (n, k) of pressure and void fraction with ``r - t``, the active set held."""
        transport = problem.transport_entries(result.flux)
        self.system.prepare(problem.entries(result.pressure), transport, result.full_film)
        both = -self.system.solution(change)
        full = self.system.full[:, None]
        return np.where(full, both, 0.0), np.where(full, 0.0, both)
