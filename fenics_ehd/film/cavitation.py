"""Cavitation complementarity (8), (11) by PETSc SNES-VI.

Find ``p >= 0`` with ``y = r(p) >= 0`` and ``p . y = 0``, component by component,
``r(p) = A p - b`` for an oil of constant properties. With weights W the defect is
``y = W^-1 r``: the consistent mass matrix as printed in (11), needed by the
8-node element, whose corner functions have a negative integral, so that the
sign of r there is not the sign of the flux. The blocks of SNES-VI are solved by
`ActiveSetSystem`, whose options have the prefix ``linear_`` behind that of
SNES-VI. (The mass-conserving condition is `fenics_ehd.film.mass_conserving`.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fenics_ehd.base.errors import CavitationError, SolverError
from fenics_ehd.film.active_set import ActiveSetSystem, FactoredMatrix
from fenics_ehd.film.pattern import Pattern
from fenics_ehd.film.snes_vi import SnesVi

#: Largest allowed violation of p >= 0, y >= 0 and p y = 0, relative to max |p|, |b|.
VERIFY_TOLERANCE = 1e-8


@dataclass(frozen=True, eq=False)
class CavitationResult:
    """Pressure, flux defect and the active set they satisfy.

    Attributes
    ----------
    pressure
        Nodal pressure, shape (n,), >= 0.
    flux
        ``r(p)`` (or ``W^-1`` times it), >= 0 where the film cavitates.
    full_film
        Indices of the nodes where the equation holds and the pressure is free.
    iterations
        SNES iterations used.
    """

    pressure: np.ndarray
    flux: np.ndarray
    full_film: np.ndarray
    iterations: int


@dataclass(frozen=True, eq=False)
class Complementarity:
    """One complementarity problem.

    Attributes
    ----------
    residual
        ``r(p)`` before the weights are applied, shape (n,).
    entries
        Entries of its derivative at p, in the order of the solver's pattern.
    scale
        Norm of b, over the diagonal of W, to which tolerances refer.
    weights
        Entries of W, or None.
    unit
        A pressure of the size of the solution's, or somewhat below it.
    """

    residual: Callable[[np.ndarray], np.ndarray]
    entries: Callable[[np.ndarray], np.ndarray]
    scale: float
    weights: np.ndarray | None = None
    unit: float = 1.0


class CavitationSolver:
    """SNES-VI with its vectors and factorisations, reused from solve to solve.

    Parameters
    ----------
    pattern
        Of the derivative of r and of W, n x n.
    weighted
        Whether problems come with weights W.
    symmetric
        Whether the derivative of r is symmetric positive definite.
    options_prefix
        Prefix of the PETSc options, ``"film_"`` gives ``-film_snes_monitor``
        and ``-film_linear_pc_type``.
    tolerance
        On the 2-norm of the reduced residual, relative to `Complementarity.scale`;
        the option ``snes_atol`` stands for it too.
    """

    def __init__(
        self,
        pattern: Pattern,
        *,
        weighted: bool = False,
        symmetric: bool = True,
        options_prefix: str = "film_",
        tolerance: float = 1e-10,
    ):
        self._pattern = pattern
        self.system = ActiveSetSystem(
            pattern,
            weighted=weighted,
            symmetric=symmetric,
            options_prefix=f"{options_prefix}linear_",
        )
        self._weight_factor = (
            FactoredMatrix(
                pattern,
                symmetric=False,
                options_prefix=f"{options_prefix}weights_",
            )
            if weighted
            else None
        )
        self._weights: np.ndarray | None = None
        self._snes = SnesVi(
            self,
            np.zeros(pattern.size),
            options_prefix=options_prefix,
            tolerance=tolerance,
        )

    # The following four are called by SNES-VI during a solve.

    def function(self, x: np.ndarray) -> np.ndarray:
        """See `VariationalInequality`."""
        return self.defect(self._problem, x * self._problem.unit) / self._problem.scale

    def linearise(self, x: np.ndarray) -> None:
        """See `VariationalInequality`."""
        self._entries = self._problem.entries(x * self._problem.unit)

    def factorise(self, nodes: np.ndarray) -> None:
        """Factorise for the active set SNES-VI has chosen."""
        self._nodes = nodes
        self.system.prepare(self._entries, self._problem.weights, nodes)

    def update(self, rhs: np.ndarray) -> np.ndarray:
        """Newton update of the pressures of the full nodes."""
        whole = np.zeros(self._pattern.size)
        whole[self._nodes] = rhs
        if self._problem.weights is not None:
            whole = self._pattern.multiply(self._problem.weights, whole)
        return self.system.pressures(whole)[self._nodes] * (
            self._problem.scale / self._problem.unit
        )

    def defect(self, problem: Complementarity, pressure: np.ndarray) -> np.ndarray:
        """``y``: r, with the weights taken out, shape (n,)."""
        residual = problem.residual(pressure)
        if problem.weights is None:
            return residual
        assert self._weight_factor is not None
        if self._weights is not problem.weights:
            self._weight_factor.factorise(problem.weights)
            self._weights = problem.weights
        return self._weight_factor.solve(residual)

    def solve(self, problem: Complementarity, guess: np.ndarray) -> CavitationResult:
        """Solve a complementarity problem.

        Parameters
        ----------
        problem
            Its residual and derivative; weights as told to the constructor.
        guess
            Start value; its zeros are the first cavitated nodes.

        Raises
        ------
        CavitationError
            SNES-VI did not converge, or the result fails its own check; its
            `state` holds pressure and flux.
        """
        self._problem = problem
        try:
            x, function, iterations = self._snes.solve(np.maximum(guess, 0.0) / problem.unit)
        except CavitationError as error:
            error.state["pressure"] = error.state.pop("x") * problem.unit
            error.state["flux"] = error.state.pop("function") * problem.scale
            raise
        pressure, flux = x * problem.unit, function * problem.scale
        verify_complementarity(pressure, flux, problem.scale)
        # Round-off leaves pressures of 1e-17 in the cavitated zone: the larger of the two, each in
        # its own scale, tells which equation a node follows.
        full_film = np.flatnonzero(pressure * problem.scale > flux * pressure.max(initial=0.0))
        return CavitationResult(pressure, flux, full_film.astype(np.int32), iterations)

    def derivative(
        self, problem: Complementarity, result: CavitationResult, change: np.ndarray
    ) -> np.ndarray:
        """Change of the pressure when r changes, the active set held.

        Parameters
        ----------
        problem, result
            A problem solved and its solution.
        change
            Changes of r, before the weights, shape (n, k).

        Returns
        -------
        numpy.ndarray
            shape (n, k), zero at the cavitated nodes.
        """
        if not len(result.full_film) or not change.shape[1]:
            return np.zeros_like(change)
        entries = problem.entries(result.pressure)
        self.system.prepare(entries, problem.weights, result.full_film)
        return -self.system.pressures(change)


def verify_complementarity(
    pressure: np.ndarray, flux: np.ndarray, scale: float, tolerance: float = VERIFY_TOLERANCE
) -> None:
    """Check ``p >= 0``, ``y >= 0`` and ``p y = 0``, in the maximum norm.

    Raises
    ------
    CavitationError
        A violation exceeds `tolerance` times the largest pressure or `scale`.
    SolverError
        A pressure or a flux is no finite number.
    """
    if not (np.isfinite(pressure).all() and np.isfinite(flux).all()):
        raise SolverError(
            "the film's pressure is no finite number: are viscosity, speed and given pressures of "
            "sizes that go together?"
        )
    tiny = float(np.finfo(float).tiny)
    largest, scale = max(float(pressure.max(initial=0.0)), tiny), max(scale, tiny)
    violations = {
        "negative pressure": -pressure.min(initial=0.0) / largest,
        "negative flux": -flux.min(initial=0.0) / scale,
        "pressure times flux": np.abs(pressure / largest * flux).max(initial=0.0) / scale,
    }
    for name, value in violations.items():
        if not value <= tolerance:
            raise CavitationError(
                f"the film solution violates complementarity: {name} {value:.2e} "
                f"above {tolerance:.0e}",
                state={"pressure": pressure, "flux": flux},
            )
