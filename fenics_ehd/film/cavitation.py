"""Cavitation complementarity (11) by PETSc SNES-VI.

Find ``p >= 0`` with ``y = A p - b >= 0`` and ``p . y = 0``, component by
component. With `mass` given, ``y = N^-1 (A p - b)`` as printed in the paper:
needed by the 8-node element, whose corner functions have a negative integral,
so that the sign of ``A p - b`` there is not the sign of the flux.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg import cho_factor, cho_solve

from fenics_ehd.errors import CavitationError
from fenics_ehd.petsc_options import configure

#: The problem is linear on each partition: with full steps the reduced-space
#: Newton method is the primal-dual active set method.
DEFAULT_OPTIONS = {"snes_linesearch_type": "basic", "ksp_type": "preonly", "pc_type": "lu"}

#: Largest allowed violation of p >= 0, y >= 0 and p y = 0, relative to max |p|, |b|.
VERIFY_TOLERANCE = 1e-8


@dataclass(frozen=True)
class CavitationResult:
    """Pressure, flux defect and the partition they satisfy.

    Attributes
    ----------
    pressure
        Nodal pressure, shape (n,), >= 0.
    flux
        ``A p - b`` (or ``N^-1`` times it), >= 0 where the film cavitates.
    full_film
        Indices of the nodes where the equation holds and the pressure is free.
    iterations
        SNES iterations used.
    """

    pressure: np.ndarray
    flux: np.ndarray
    full_film: np.ndarray
    iterations: int


class CavitationSolver:
    """SNES-VI with its vectors, reused from solve to solve.

    Parameters
    ----------
    size
        Number of unknowns.
    mass
        Consistent mass matrix (size, size) as a dense array, or None for the weak form.
    options_prefix
        Prefix of the PETSc options, ``"film_"`` gives ``-film_snes_monitor``.
    tolerance
        On the 2-norm of the reduced residual, relative to ``||b||``; the option
        ``snes_atol`` stands for it too.
    smallest_source
        Stands in for ``||b||`` where it is smaller: below it b is round-off, as for
        a centred shaft.
    comm
        Communicator of one rank.
    """

    def __init__(
        self,
        size: int,
        mass: np.ndarray | None = None,
        *,
        comm: PETSc.Comm | MPI.Comm = PETSc.COMM_SELF,
        options_prefix: str = "film_",
        tolerance: float = 1e-10,
        smallest_source: float = 0.0,
    ):
        self._tolerance = tolerance
        self._smallest_source = smallest_source
        self._mass = None if mass is None else cho_factor(mass)
        self._dense: PETSc.Mat | None = None
        self._comm = comm
        self._upper = PETSc.Vec().createSeq(size, comm=comm)
        self._upper.set(PETSc.INFINITY)
        self._lower = self._upper.duplicate()
        self._lower.set(0.0)
        self._unknown = self._upper.duplicate()
        self._residual = self._upper.duplicate()
        self._rhs = self._upper.duplicate()
        self._prefix = options_prefix
        self._current: tuple[PETSc.Mat, PETSc.SNES] | None = None
        self.solves = 0

    def _snes(self, matrix: PETSc.Mat) -> PETSc.SNES:
        """SNES with this matrix as its Jacobian, the same one as long as the matrix is the same."""
        if self._current is None or matrix.handle != self._current[0].handle:
            self._current = (matrix, self._create_snes(matrix))
        return self._current[1]

    def _create_snes(self, matrix: PETSc.Mat) -> PETSc.SNES:
        snes = PETSc.SNES().create(comm=self._comm)
        snes.setType("vinewtonrsls")
        snes.setFunction(self._function, self._residual, args=(matrix,))
        snes.setJacobian(self._jacobian, matrix)
        snes.setVariableBounds(self._lower, self._upper)
        snes.setTolerances(rtol=0.0, stol=0.0, max_it=60)
        configure(snes, self._prefix, DEFAULT_OPTIONS)
        options = PETSc.Options(self._prefix)
        if options.hasName("snes_atol"):
            self._tolerance = options.getReal("snes_atol")
        return snes

    def _function(self, snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec, matrix: PETSc.Mat) -> None:
        matrix.mult(x, f)
        f.axpy(-1.0, self._rhs)

    def _jacobian(
        self, snes: PETSc.SNES, x: PETSc.Vec, jacobian: PETSc.Mat, preconditioner: PETSc.Mat
    ) -> None:
        """The problem is linear: its matrix already is the Jacobian."""

    def reduced_matrix(self, matrix: PETSc.Mat) -> PETSc.Mat:
        """``A``, or ``N^-1 A`` (dense) when the complementarity is taken with N."""
        if self._mass is None:
            return matrix
        if self._dense is None:
            self._dense = matrix.convert("dense", PETSc.Mat())
        dense = matrix.convert("dense", PETSc.Mat())
        self._dense.getDenseArray()[:, :] = cho_solve(self._mass, dense.getDenseArray())
        dense.destroy()
        # Writing through the array does not tell PETSc that the values changed.
        self._dense.assemble()
        return self._dense

    def reduced_rhs(self, rhs: np.ndarray) -> np.ndarray:
        """``b``, or ``N^-1 b``; columns of a 2-D array alike."""
        return rhs if self._mass is None else cho_solve(self._mass, rhs)

    def solve(self, matrix: PETSc.Mat, rhs: np.ndarray, guess: np.ndarray) -> CavitationResult:
        """Solve the complementarity problem.

        Parameters
        ----------
        matrix
            ``A`` or ``N^-1 A``, from `reduced_matrix`.
        rhs
            ``b`` or ``N^-1 b``, from `reduced_rhs`, shape (n,).
        guess
            Start value; its zeros are the first active set.

        Raises
        ------
        CavitationError
            SNES-VI did not converge, or the result fails its own check.
        """
        snes = self._snes(matrix)
        self._rhs.array = rhs
        self._unknown.array = np.maximum(guess, 0.0)
        scale = max(float(np.linalg.norm(rhs)), self._smallest_source)
        snes.setTolerances(atol=self._tolerance * scale)
        snes.solve(None, self._unknown)
        self.solves += 1
        reason = snes.getConvergedReason()
        iterations = snes.getIterationNumber()
        if reason <= 0:
            raise CavitationError(
                f"SNES-VI stopped with reason {reason} after {iterations} iterations, residual "
                f"{snes.getFunctionNorm():.2e} above {self._tolerance * scale:.2e}: "
                f"see -{self._prefix}snes_monitor"
            )
        pressure = self._unknown.array.copy()
        self._function(snes, self._unknown, self._residual, matrix)
        flux = self._residual.array.copy()
        verify_complementarity(pressure, flux, scale)
        # Round-off leaves pressures of 1e-17 in the cavitated zone: the larger of the two, each in
        # its own scale, tells which equation a node follows.
        full_film = np.flatnonzero(pressure * scale > flux * pressure.max()).astype(np.int32)
        return CavitationResult(pressure, flux, full_film, iterations)


def verify_complementarity(pressure: np.ndarray, flux: np.ndarray, scale: float) -> None:
    """Check ``p >= 0``, ``y >= 0`` and ``p y = 0``, in the maximum norm.

    Raises
    ------
    CavitationError
        A violation exceeds `VERIFY_TOLERANCE` times the largest pressure or `scale`.
    """
    largest = max(pressure.max(initial=0.0), np.finfo(float).tiny)
    violations = {
        "negative pressure": -pressure.min(initial=0.0) / largest,
        "negative flux": -flux.min(initial=0.0) / max(scale, np.finfo(float).tiny),
        "pressure times flux": np.abs(pressure * flux).max(initial=0.0)
        / (largest * max(scale, np.finfo(float).tiny)),
    }
    for name, value in violations.items():
        if not value <= VERIFY_TOLERANCE:
            raise CavitationError(
                f"the film solution violates complementarity: {name} {value:.2e} "
                f"above {VERIFY_TOLERANCE:.0e}"
            )
