"""Cavitation complementarity (8), (11) by PETSc SNES-VI on one active set after another.

An active set contains the nodes at which the film is full (pressure unknown, equation holds). The
film cavitates at the other nodes (pressure zero, defect unknown). SNES-VI cuts the block of the
full nodes out of its Jacobian, a new matrix with a new pattern for every active set. Here that
block keeps the pattern of the whole film: ones stand on the diagonal of the cavitated nodes, so
that ordering and symbolic factorisation are done once in the life of a film.

Find ``p >= 0`` with ``y = r(p) >= 0`` and ``p . y = 0``, component by component,
``r(p) = A p - b`` for an oil of constant properties. With weights W the defect is
``y = W^-1 r``: the consistent mass matrix as printed in (11), needed by the
8-node element, whose corner functions have a negative integral, so that the
sign of r there is not the sign of the flux. The blocks of SNES-VI are solved by
`ActiveSetSystem`, whose options have the prefix ``linear_`` behind that of
SNES-VI. (The mass-conserving condition is `fenics_ehd.film.oil_balance`.)
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import fenics_ehd.base.petsc_start  # noqa: F401  # isort: skip
import numpy as np
from petsc4py import PETSc

from fenics_ehd.base.errors import CavitationError, SolverError
from fenics_ehd.base.petsc_options import configure, destroy_with, solve_columns
from fenics_ehd.film.assembly import Pattern

#: Fastest of PETSc's factorisations on these matrices when only values change; CHOLMOD takes over
#: for large ones (`docs/measurements.md`). Film matrices needed no pivoting for stability in any
#: run so far, and every solution is verified.
SYMMETRIC_OPTIONS = {
    "ksp_type": "preonly",
    "pc_type": "cholesky",
    "pc_factor_mat_solver_type": "petsc",
    "pc_factor_mat_ordering_type": "nd",
    # Rows where the film is a thousandth of the clearance thick are 1e-14 of the other rows.
    "pc_factor_zeropivot": "1e-100",
}
LARGE_OPTIONS = {**SYMMETRIC_OPTIONS, "pc_factor_mat_solver_type": "cholmod"}
GENERAL_OPTIONS = {**SYMMETRIC_OPTIONS, "pc_type": "lu"}

#: Unknowns from which a matrix is large.
LARGE = 20_000


def _defaults(size: int, symmetric: bool) -> dict[str, str]:
    if not symmetric:
        return GENERAL_OPTIONS
    return LARGE_OPTIONS if size >= LARGE else SYMMETRIC_OPTIONS


class ActiveSetSystem:
    """Systems of a complementarity problem ``y = W^-1 (A p - b)`` on any active set.

    With I the full and C the cavitated nodes, the pressure of the full nodes
    and the defect y of the others solve

        A_I p_I - W_C y_C = b,

    all rows at once. Without weights W the defect decouples, and only the block ``A_II`` remains.

    Parameters
    ----------
    pattern
        Pattern of A and W, n x n.
    weighted
        Whether there is a W.
    symmetric
        Whether A is symmetric positive definite.
    options_prefix
        Prefix of the KSP's options.
    """

    def __init__(self, pattern: Pattern, *, weighted: bool, symmetric: bool, options_prefix: str):
        # The integer type of NumPy's indices: other types would be converted at every active set.
        self._counts = np.diff(pattern.indptr)
        self._columns = pattern.indices.astype(np.intp)
        self._diagonal = pattern.diagonal
        self._weighted = weighted
        self._size = pattern.size
        # PETSc uses these arrays themselves.
        self._csr = (
            np.array(pattern.indptr, dtype=PETSc.IntType),
            np.array(pattern.indices, dtype=PETSc.IntType),
            np.zeros(len(pattern.indices)),
        )
        size = (pattern.size, pattern.size)
        self._matrix = PETSc.Mat().createAIJWithArrays(size, self._csr, comm=PETSc.COMM_SELF)
        symmetric = symmetric and not weighted
        self._matrix.setOption(PETSc.Mat.Option.SPD, symmetric)
        self._ksp = PETSc.KSP().create(PETSc.COMM_SELF)
        self._ksp.setOperators(self._matrix)
        configure(self._ksp, options_prefix, _defaults(pattern.size, symmetric))
        self._rhs, self._solution = self._matrix.createVecs()
        destroy_with(self, self._ksp, self._matrix, self._rhs, self._solution)
        self._current: tuple[np.ndarray, np.ndarray | None, np.ndarray] | None = None

    def prepare(
        self, entries: np.ndarray, weights: np.ndarray | None, full_film: np.ndarray
    ) -> None:
        """Factorise for an active set, unless the last factorisation is of the same one.

        Parameters
        ----------
        entries, weights
            Entries of A and W. A caller that changes values passes new arrays.
        full_film
            Indices of the full nodes.
        """
        if self._current is not None:
            former, former_weights, nodes = self._current
            if former is entries and former_weights is weights and np.array_equal(nodes, full_film):
                return
        full = np.zeros(self._size, dtype=bool)
        full[full_film] = True
        self.full = full
        if self._weighted:
            assert weights is not None
            values = np.where(full[self._columns], entries, -weights)
        else:
            values = entries * (full[self._columns] & np.repeat(full, self._counts))
            values[self._diagonal[~full]] = 1.0
        self._current = None
        self._csr[2][:] = values
        # Assembly notifies PETSc that the values in the shared arrays have changed.
        self._matrix.assemble()
        # PC.setUp, because the KSP factorises only in its own solve, which `solve_columns` avoids.
        self._ksp.pc.setUp()
        self._current = (entries, weights, full_film.copy())

    def solution(self, rhs: np.ndarray) -> np.ndarray:
        """Pressure of the full and defect of the other nodes, right-hand sides (n,) or (n, k).

        Raises
        ------
        CavitationError
            The factorisation failed.
        """
        if not self._weighted:
            rhs = np.where(self.full if rhs.ndim == 1 else self.full[:, None], rhs, 0.0)
        if rhs.ndim == 2:
            return self._columns_of(rhs)
        self._rhs.array[:] = rhs
        self._ksp.solve(self._rhs, self._solution)
        if self._ksp.getConvergedReason() < 0:
            raise CavitationError(
                "the film matrix cannot be factorised (KSP reason "
                f"{self._ksp.getConvergedReason()}): is the gap extremely uneven?"
            )
        return self._solution.array.copy()

    def _columns_of(self, rhs: np.ndarray) -> np.ndarray:
        right = PETSc.Mat().createDense(
            rhs.shape, array=np.asfortranarray(rhs), comm=self._matrix.comm
        )
        solution = right.duplicate()
        solve_columns(self._ksp, right, solution)
        values = np.array(solution.getDenseArray())
        right.destroy()
        solution.destroy()
        return values


#: The problems are linear on each active set: with full steps the reduced-space
#: Newton method is the primal-dual active set method. Unknowns are scaled to order
#: one: a pressure counts as zero below 1e-14 of that.
DEFAULT_OPTIONS = {
    "snes_linesearch_type": "basic",
    "snes_vi_zero_tolerance": 1e-14,
    "ksp_type": "preonly",
}

MAX_ITERATIONS = 200


class VariationalInequality(Protocol):
    """Functions that SNES-VI calls, all scaled to order one."""

    def function(self, x: np.ndarray) -> np.ndarray:
        """``F(x)``."""

    def linearise(self, x: np.ndarray) -> None:
        """Compute the derivative at x."""

    def factorise(self, nodes: np.ndarray) -> None:
        """Prepare the block of the derivative on the inactive unknowns."""

    def update(self, rhs: np.ndarray) -> np.ndarray:
        """Solve with that block."""

    def converged(self, iteration: int) -> bool:
        """True if the last call of `function`, after so many iterations, met the tolerance."""


class SnesVi:
    """SNES-VI with its vectors, reused from solve to solve.

    SNES-VI cuts the block of the inactive unknowns out of its Jacobian matrix, a
    new matrix with a new pattern for every active set. The Jacobian used here only records which
    block is needed; `system` solves with the block.

    Parameters
    ----------
    system
        The problem; its owner must keep it alive (a weak reference is held, or
        PETSc and Python would keep each other alive for ever).
    lower
        Lower bounds, shape (n,); there are no upper ones.
    options_prefix
        Prefix of the PETSc options.
    tolerance
        Tolerance on the 2-norm of the reduced function; the option ``snes_atol`` overrides it.
        None: `VariationalInequality.converged` decides.
    max_iterations
        Largest number of iterations of one solve.
    """

    def __init__(
        self,
        system: VariationalInequality,
        lower: np.ndarray,
        *,
        options_prefix: str,
        tolerance: float | None,
        max_iterations: int = MAX_ITERATIONS,
    ):
        self._prefix = options_prefix
        bounds = [PETSc.Vec().createSeq(len(lower), comm=PETSc.COMM_SELF) for _ in range(2)]
        bounds[0].array = lower
        bounds[1].set(PETSc.INFINITY)
        self._unknown = bounds[0].duplicate()
        self._function = bounds[0].duplicate()
        self._callbacks = callbacks = _Callbacks(system)
        jacobian = _Jacobian(np.arange(len(lower))).matrix()
        self._snes = snes = PETSc.SNES().create(comm=PETSc.COMM_SELF)
        snes.setType("vinewtonrsls")
        snes.setFunction(callbacks.function, self._function)
        snes.setJacobian(callbacks.jacobian, jacobian)
        snes.setVariableBounds(*bounds)
        snes.setTolerances(rtol=0.0, stol=0.0, max_it=max_iterations)
        block = snes.getKSP().getPC()
        block.setType("python")
        block.setPythonContext(callbacks)
        configure(snes, options_prefix, DEFAULT_OPTIONS)
        if tolerance is None:
            snes.setConvergenceTest(callbacks.converged)
        else:
            snes.setTolerances(atol=PETSc.Options(options_prefix).getReal("snes_atol", tolerance))
        destroy_with(self, snes, jacobian, self._unknown, self._function)

    def solve(self, start: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
        """Solve from a start.

        Returns
        -------
        x, function : numpy.ndarray
            Solution and ``F`` there, shape (n,).
        iterations : int

        Raises
        ------
        CavitationError
            No convergence, or a block that cannot be factorised; its `state` holds
            the last iterate and function.
        """
        self._unknown.array = start
        self._snes.solve(None, self._unknown)
        reason = self._snes.getConvergedReason()
        iterations = self._snes.getIterationNumber()
        x = self._unknown.array.copy()
        function = self._function.array.copy()
        failure = self._callbacks.take_failure()
        if failure is not None:
            if isinstance(failure, CavitationError):
                failure.state.update(x=x, function=function)
            raise failure
        if reason <= 0:
            raise CavitationError(
                f"SNES-VI stopped with reason {reason} after {iterations} iterations, residual "
                f"{self._snes.getFunctionNorm():.2e} (of the source): "
                f"see -{self._prefix}snes_monitor",
                state={"x": x, "function": function},
            )
        return x, function, iterations


class _Callbacks:
    """Callbacks of PETSc: function and Jacobian of SNES, and the block's preconditioner.

    An exception that passes through PETSc makes its solvers unusable. The exception is therefore
    stored, and a function value of NaN ends the solve. The stored traceback outlives the solve, and
    PETSc's objects must be destroyed before the interpreter ends: callbacks release solvers and
    matrices before they raise.
    """

    def __init__(self, system: VariationalInequality):
        self._system = weakref.ref(system)
        self._failure: BaseException | None = None

    def take_failure(self) -> BaseException | None:
        """Exception since the last call, or None."""
        failure = self._failure
        self._failure = None
        return failure

    def _call(self, name: str, argument: np.ndarray | int) -> np.ndarray | float | None:
        if self._failure is not None:
            return np.nan
        try:
            return getattr(self._system(), name)(argument)
        except BaseException as error:  # an interrupt too
            self._failure = error
            return np.nan

    def function(self, snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec) -> None:
        del snes
        f.array = self._call("function", x.getArray(readonly=True))

    def jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, a: PETSc.Mat, b: PETSc.Mat) -> None:
        del snes, a, b
        self._call("linearise", x.getArray(readonly=True))

    def converged(self, snes: PETSc.SNES, iteration: int, norms: tuple) -> int:
        del snes, norms
        reasons = PETSc.SNES.ConvergedReason
        good = self._call("converged", iteration)
        if self._failure is not None:
            return reasons.DIVERGED_FUNCTION_DOMAIN
        return reasons.CONVERGED_FNORM_ABS if good else reasons.ITERATING

    def setUp(self, pc: PETSc.PC) -> None:
        nodes = pc.getOperators()[0].getPythonContext().nodes
        del pc
        self._call("factorise", nodes)

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        del pc
        y.array = self._call("update", x.getArray(readonly=True))


class _Jacobian:
    """Python context of a Jacobian that stores the indices of its unknowns and no matrix."""

    def __init__(self, nodes: np.ndarray):
        self.nodes = nodes

    def matrix(self) -> PETSc.Mat:
        """PETSc's matrix of this context."""
        matrix = PETSc.Mat().createPython((len(self.nodes),) * 2, self, comm=PETSc.COMM_SELF)
        matrix.setUp()
        return matrix

    def createSubMatrix(
        self, mat: PETSc.Mat, rows: PETSc.IS, columns: PETSc.IS, out: PETSc.Mat | None = None
    ) -> PETSc.Mat:
        return _Jacobian(rows.getIndices().copy()).matrix()


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
    diagonal
        Diagonal of W, or ones, shape (n,).
    smallest
        Size below which a source counts as zero.
    weights
        Entries of W, or None.
    """

    residual: Callable[[np.ndarray], np.ndarray]
    entries: Callable[[np.ndarray], np.ndarray]
    diagonal: np.ndarray
    smallest: float
    weights: np.ndarray | None = None

    @property
    def zero(self) -> np.ndarray:
        """Zero pressure, shape (n,)."""
        return np.zeros(len(self.diagonal))

    @cached_property
    def source(self) -> np.ndarray:
        """Residual without pressure, ``-b``, shape (n,)."""
        return self.residual(self.zero)

    @cached_property
    def scale(self) -> float:
        """Norm of the source, over the diagonal of W, to which tolerances refer."""
        return max(float(np.linalg.norm(self.source / self.diagonal)), self.smallest)

    @cached_property
    def unit(self) -> float:
        """Pressure that the source builds up over one cell, at most of the size of the solution."""
        largest = max(float(np.abs(self.source).max()), self.smallest)
        return largest / float(self.entries(self.zero).max())


class CavitationSolver:
    """SNES-VI with its vectors and factorisations, reused from solve to solve.

    Parameters
    ----------
    pattern
        Pattern of the derivative of r and of W, n x n.
    weighted
        Whether problems come with weights W.
    symmetric
        Whether the derivative of r is symmetric positive definite.
    options_prefix
        Prefix of the PETSc options, ``"film_"`` gives ``-film_snes_monitor``
        and ``-film_linear_pc_type``.
    tolerance
        Tolerance on the 2-norm of the reduced residual, relative to `Complementarity.scale`;
        the option ``snes_atol`` overrides it.
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
        self._every = np.arange(pattern.size)
        self.system = ActiveSetSystem(
            pattern,
            weighted=weighted,
            symmetric=symmetric,
            options_prefix=f"{options_prefix}linear_",
        )
        if weighted:
            self._weights = ActiveSetSystem(
                pattern,
                weighted=False,
                symmetric=False,
                options_prefix=f"{options_prefix}weights_",
            )
        self._snes = SnesVi(
            self, np.zeros(pattern.size), options_prefix=options_prefix, tolerance=tolerance
        )

    # The following are called by SNES-VI during a solve.

    def function(self, x: np.ndarray) -> np.ndarray:
        """Defect divided by its scale."""
        return self.defect(self._problem, x * self._problem.unit) / self._problem.scale

    def linearise(self, x: np.ndarray) -> None:
        """Entries of the derivative."""
        self._entries = self._problem.entries(x * self._problem.unit)

    def factorise(self, nodes: np.ndarray) -> None:
        """Factorise for the active set SNES-VI has chosen."""
        self._nodes = nodes
        self.system.prepare(self._entries, self._problem.weights, nodes)

    def update(self, rhs: np.ndarray) -> np.ndarray:
        """Newton update of the pressures of the full nodes."""
        right_side = np.zeros(self._pattern.size)
        right_side[self._nodes] = rhs
        if self._problem.weights is not None:
            right_side = self._pattern.multiply(self._problem.weights, right_side)
        solution = self.system.solution(right_side)[self._nodes]
        return solution * (self._problem.scale / self._problem.unit)

    def converged(self, iteration: int) -> bool:
        """Never called: SNES-VI has a tolerance of its own."""
        raise NotImplementedError

    def defect(self, problem: Complementarity, pressure: np.ndarray) -> np.ndarray:
        """Defect ``y = W^-1 r``, shape (n,)."""
        residual = problem.residual(pressure)
        if problem.weights is None:
            return residual
        self._weights.prepare(problem.weights, None, self._every)
        return self._weights.solution(residual)

    def solve(self, problem: Complementarity, guess: np.ndarray) -> CavitationResult:
        """Solve a complementarity problem.

        Parameters
        ----------
        problem
            Residual and derivative of the problem; with weights if the solver is `weighted`.
        guess
            Start value of the pressure; nodes at which it is zero are cavitated at first.

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
        pressure = x * problem.unit
        flux = function * problem.scale
        verify_complementarity(pressure, flux, problem.scale)
        # Round-off causes pressures of 1e-17 in the cavitated zone. A node is full if its scaled
        # pressure exceeds its scaled defect.
        full_film = np.flatnonzero(pressure * problem.scale > flux * pressure.max(initial=0.0))
        return CavitationResult(pressure, flux, full_film.astype(np.int32), iterations)


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
    largest = max(float(pressure.max(initial=0.0)), tiny)
    scale = max(scale, tiny)
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
