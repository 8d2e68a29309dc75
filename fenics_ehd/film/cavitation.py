"""Cavitation as a complementarity problem (8), (11), solved by PETSc's active-set method SNES-VI.

An active set contains the nodes at which the film is full (pressure unknown, equation holds). The
film cavitates at the other nodes (pressure zero, defect unknown). SNES-VI cuts the block of the
full nodes out of its Jacobian, a new matrix with a new sparsity pattern for every active set. Here
the block keeps the pattern of the whole film, with ones on the diagonal of cavitated nodes, so that
ordering and symbolic factorisation are done once for a film.

The problem: find ``p >= 0`` with ``y = r(p) >= 0`` and ``p . y = 0``, component by component, where
``r(p) = A p - b`` for an oil of constant properties. With weights W the defect is ``y = W^-1 r``. W
is the consistent mass matrix of (11), which the 8-node element needs: the shape functions of its
corners have a negative integral, and the sign of r there is not the sign of the flux.
`ActiveSetSystem` solves the linear systems with the blocks. The prefix of its PETSc options is the
prefix of SNES-VI followed by ``linear_``. (The mass-conserving condition is in
`fenics_ehd.film.oil_balance`.)
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

from fenics_ehd.base.described import Described
from fenics_ehd.base.errors import CavitationError, SolverError
from fenics_ehd.base.petsc_options import (
    available_factorisation,
    configure,
    destroy_with,
    solve_columns,
)
from fenics_ehd.film.assembly import Pattern

#: PETSc's own Cholesky factorisation is the fastest one for film matrices of which only values
#: change; for large ones CHOLMOD is faster (`docs/measurements.md`), or MUMPS if PETSc contains no
#: CHOLMOD. Film matrices needed no pivoting for stability in any run so far, and every solution is
#: verified.
SYMMETRIC_OPTIONS = {
    "ksp_type": "preonly",
    "pc_type": "cholesky",
    "pc_factor_mat_solver_type": "petsc",
    "pc_factor_mat_ordering_type": "nd",
    # Rows of nodes at which the film is thinnest are up to 1e-14 times smaller than the others.
    "pc_factor_zeropivot": "1e-100",
}
LARGE_OPTIONS = {
    **SYMMETRIC_OPTIONS,
    "pc_factor_mat_solver_type": available_factorisation("cholmod", "mumps"),
}
GENERAL_OPTIONS = {**SYMMETRIC_OPTIONS, "pc_type": "lu"}

#: Number of unknowns from which `LARGE_OPTIONS` are used.
LARGE = 20_000


def _defaults(size: int, symmetric: bool) -> dict[str, str]:
    if not symmetric:
        return GENERAL_OPTIONS
    return LARGE_OPTIONS if size >= LARGE else SYMMETRIC_OPTIONS


class ActiveSetSystem:
    """Linear system of a complementarity problem ``y = W^-1 (A p - b)`` for any active set.

    The pressures ``p_I`` of the full nodes I and the defects ``y_C`` of the cavitated nodes C solve

        A_I p_I - W_C y_C = b,

    in which A_I and W_C are columns of A and W. Without weights W the system for the pressures has
    the block ``A_II`` only, and the defects follow from it.

    Parameters
    ----------
    pattern
        Sparsity pattern of A and W, n x n.
    weighted
        Whether the problem has weights W.
    symmetric
        Whether A is symmetric positive definite.
    options_prefix
        Prefix of the PETSc options of the linear solver (KSP).

    Attributes
    ----------
    factorisations
        Number of factorisations so far.
    solved_columns
        Number of right-hand sides solved so far.
    """

    def __init__(self, pattern: Pattern, *, weighted: bool, symmetric: bool, options_prefix: str):
        # NumPy's index type, because indices of other types are converted at every use.
        self._counts = np.diff(pattern.indptr)
        self._columns = pattern.indices.astype(np.intp)
        self._diagonal = pattern.diagonal
        self._weighted = weighted
        self._size = pattern.size
        # PETSc uses these arrays without a copy.
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
        self.factorisations = 0
        self.solved_columns = 0

    def prepare(
        self, entries: np.ndarray, weights: np.ndarray | None, full_film: np.ndarray
    ) -> None:
        """Factorise the system for an active set, unless its factors exist already.

        Parameters
        ----------
        entries, weights
            Entries of A and W. Changed values must come in new arrays: arrays are compared by
            identity.
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
        # `assemble` notifies PETSc that the values in the shared arrays have changed.
        self._matrix.assemble()
        # PC.setUp, because the KSP factorises only in its own solve, which `solve_columns` avoids.
        self._ksp.pc.setUp()
        self.factorisations += 1
        self._current = (entries, weights, full_film.copy())

    def solution(self, rhs: np.ndarray) -> np.ndarray:
        """Pressures of full nodes and defects of the others, shape (n,) or (n, k), for `rhs`.

        `rhs` is one right-hand side, shape (n,), or k of them, shape (n, k).

        Raises
        ------
        CavitationError
            If the factorisation failed.
        """
        if not self._weighted:
            rhs = np.where(self.full if rhs.ndim == 1 else self.full[:, None], rhs, 0.0)
        self.solved_columns += 1 if rhs.ndim == 1 else rhs.shape[1]
        if rhs.ndim == 2:
            return self._columns_of(rhs)
        self._rhs.array[:] = rhs
        self._ksp.solve(self._rhs, self._solution)
        if self._ksp.getConvergedReason() < 0:
            raise CavitationError(
                "the film matrix cannot be factorised (KSP reason "
                f"{self._ksp.getConvergedReason()}): check the gap for extreme thicknesses"
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


#: The problems are linear on each active set: with full steps (``basic``) the reduced-space Newton
#: method is the primal-dual active set method. Unknowns are scaled to order one, and a pressure
#: below 1e-14 counts as zero.
DEFAULT_OPTIONS = {
    "snes_linesearch_type": "basic",
    "snes_vi_zero_tolerance": 1e-14,
    "ksp_type": "preonly",
}

MAX_ITERATIONS = 200


class VariationalInequality(Protocol):
    """Complementarity problem that `SnesVi` solves, given by functions of its unknowns x.

    Every unknown is either above its lower bound, with ``F(x) = 0``, or at its bound, with
    ``F(x) >= 0``. Unknowns x and values F(x) have the shape (n,) and are scaled to order one.
    """

    def function(self, x: np.ndarray) -> np.ndarray:
        """Values of the function F of the complementarity problem at unknowns x, shape (n,)."""

    def linearise(self, x: np.ndarray) -> None:
        """Compute the derivative of the function F of the problem at unknowns x."""

    def factorise(self, nodes: np.ndarray) -> None:
        """Factorise the block of the derivative for the unknowns above their bounds.

        `nodes` are the indices of these unknowns.
        """

    def update(self, rhs: np.ndarray) -> np.ndarray:
        """Solve the linear system of the block that `factorise` factorised, for `rhs`."""

    def converged(self, iteration: int) -> bool:
        """Whether the last value of `function` meets the tolerance.

        `iteration` is the number of iterations so far.
        """


class SnesVi:
    """PETSc's SNES-VI solver of complementarity problems, with vectors that are reused.

    SNES-VI cuts the block of the unknowns above their bounds out of its Jacobian matrix, a new
    matrix with a new sparsity pattern for every active set. The Jacobian used here only records
    which block is needed; `system` solves with the block.

    Parameters
    ----------
    system
        Functions of the problem. Only a weak reference to it is kept, because PETSc and Python
        would otherwise keep each other alive: the caller must hold it.
    lower
        Lower bounds of the unknowns, shape (n,); there are no upper bounds.
    options_prefix
        Prefix of the PETSc options.
    tolerance
        Tolerance of the 2-norm of the function on the unknowns above their bounds; the option
        ``snes_atol`` overrides it. If it is None, `VariationalInequality.converged` decides.
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
        """Solve the problem, starting from unknowns of shape (n,).

        Returns
        -------
        x, function : numpy.ndarray
            Solution x, and values of the function F at x, shape (n,) each.
        iterations : int
            Number of iterations.

        Raises
        ------
        CavitationError
            If SNES-VI does not converge, or a block cannot be factorised; the `state` of the error
            holds the last iterate and function.
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
                f"{self._snes.getFunctionNorm():.2e} (relative to the source): "
                f"see -{self._prefix}snes_monitor",
                state={"x": x, "function": function},
            )
        return x, function, iterations


class _Callbacks:
    """Functions that PETSc calls: function and Jacobian of SNES, preconditioner of its block.

    An exception that passes through PETSc makes its solvers unusable. The exception is therefore
    stored, and a function value of NaN ends the solve. The stored traceback outlives the solve and
    would keep PETSc's objects, which must be destroyed before the interpreter ends. Each function
    therefore deletes its references to PETSc's objects before an exception can occur.
    """

    def __init__(self, system: VariationalInequality):
        self._system = weakref.ref(system)
        self._failure: BaseException | None = None

    def take_failure(self) -> BaseException | None:
        """Return the exception raised since the last call, or None, and forget it."""
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
    """Python context of a PETSc matrix without entries, with the indices of its unknowns."""

    def __init__(self, nodes: np.ndarray):
        self.nodes = nodes

    def matrix(self) -> PETSc.Mat:
        """PETSc matrix that has this object as its context."""
        matrix = PETSc.Mat().createPython((len(self.nodes),) * 2, self, comm=PETSc.COMM_SELF)
        matrix.setUp()
        return matrix

    def createSubMatrix(
        self, mat: PETSc.Mat, rows: PETSc.IS, columns: PETSc.IS, out: PETSc.Mat | None = None
    ) -> PETSc.Mat:
        return _Jacobian(rows.getIndices().copy()).matrix()


#: Largest violation of p >= 0, y >= 0 and p y = 0 in a solution, relative to the largest pressure
#: and to `Complementarity.scale`.
VERIFY_TOLERANCE = 1e-8


@dataclass(frozen=True, eq=False)
class CavitationResult(Described):
    """Solution of a complementarity problem: pressure, defect and active set.

    Attributes
    ----------
    pressure
        Nodal pressure, shape (n,), >= 0.
    flux
        Defect y, shape (n,): ``y = r(p)``, or ``y = W^-1 r(p)`` if the problem has weights W. It is
        >= 0 at cavitated nodes.
    full_film
        Indices of the full nodes, at which the equation holds and the pressure is unknown.
    iterations
        Number of SNES iterations.
    """

    pressure: np.ndarray
    flux: np.ndarray
    full_film: np.ndarray
    iterations: int


@dataclass(frozen=True, eq=False)
class Complementarity:
    """Complementarity problem of one gap: functions of the dimensionless pressure p, shape (n,).

    Attributes
    ----------
    residual
        Function ``r(p)`` without weights, shape (n,).
    entries
        Function of p: entries of the derivative of r, in the order of the solver's pattern.
    diagonal
        Diagonal of the weights W, shape (n,); ones if the problem has no weights.
    smallest
        Value of `source` below which the source counts as zero.
    weights
        Entries of W in the order of the solver's pattern; None if the problem has no weights.
    """

    residual: Callable[[np.ndarray], np.ndarray]
    entries: Callable[[np.ndarray], np.ndarray]
    diagonal: np.ndarray
    smallest: float
    weights: np.ndarray | None = None

    @property
    def zero(self) -> np.ndarray:
        """Pressure of zero at all n nodes, shape (n,)."""
        return np.zeros(len(self.diagonal))

    @cached_property
    def source(self) -> np.ndarray:
        """Residual at zero pressure, ``-b``, shape (n,)."""
        return self.residual(self.zero)

    @cached_property
    def scale(self) -> float:
        """Scale of the defect, for relative tolerances: 2-norm of `source` / `diagonal`."""
        return max(float(np.linalg.norm(self.source / self.diagonal)), self.smallest)

    @cached_property
    def unit(self) -> float:
        """Scale of the pressure: largest `source` over the largest entry of the derivative of r.

        The source builds up a pressure of this size over one cell. The largest pressure of the
        solution is of the same size or larger.
        """
        largest = max(float(np.abs(self.source).max()), self.smallest)
        return largest / float(self.entries(self.zero).max())


class CavitationSolver:
    """Solver of a film's complementarity problems, with vectors and factorisations reused.

    Parameters
    ----------
    pattern
        Sparsity pattern of the derivative of r and of W, n x n.
    weighted
        Whether problems have weights W.
    symmetric
        Whether the derivative of r is symmetric positive definite.
    options_prefix
        Prefix of the PETSc options: with ``"film_"`` they are ``-film_snes_monitor``,
        ``-film_linear_pc_type`` and so on.
    tolerance
        Tolerance of the 2-norm of the defect on the full nodes, relative to
        `Complementarity.scale`; the option ``snes_atol`` overrides it.
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

    # SNES-VI calls the following methods during a solve, see `VariationalInequality`.

    def function(self, x: np.ndarray) -> np.ndarray:
        """Defect of the current problem over its scale, for scaled pressures x, shape (n,)."""
        return self.defect(self._problem, x * self._problem.unit) / self._problem.scale

    def linearise(self, x: np.ndarray) -> None:
        """Compute the entries of the problem's derivative at scaled pressures x."""
        self._entries = self._problem.entries(x * self._problem.unit)

    def factorise(self, nodes: np.ndarray) -> None:
        """Factorise the linear system for an active set; `nodes` are its full nodes (indices)."""
        self._nodes = nodes
        self.system.prepare(self._entries, self._problem.weights, nodes)

    def update(self, rhs: np.ndarray) -> np.ndarray:
        """Newton update of the scaled pressures of the full nodes, for a right-hand side."""
        right_side = np.zeros(self._pattern.size)
        right_side[self._nodes] = rhs
        if self._problem.weights is not None:
            right_side = self._pattern.multiply(self._problem.weights, right_side)
        solution = self.system.solution(right_side)[self._nodes]
        return solution * (self._problem.scale / self._problem.unit)

    def converged(self, iteration: int) -> bool:
        """Never called, because SNES-VI itself checks the tolerance."""
        raise NotImplementedError

    def defect(self, problem: Complementarity, pressure: np.ndarray) -> np.ndarray:
        """Defect ``y = W^-1 r(p)`` at nodal pressures, shape (n,)."""
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
            Pressures to start from, shape (n,); nodes with zero pressure are cavitated at first.

        Raises
        ------
        CavitationError
            If SNES-VI does not converge, or the solution violates complementarity; the `state` of
            the error holds pressure and flux.
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
        # Pressures in the cavitated zone are round-off, about 1e-17. A node counts as full if its
        # scaled pressure exceeds its scaled defect.
        full_film = np.flatnonzero(pressure * problem.scale > flux * pressure.max(initial=0.0))
        return CavitationResult(pressure, flux, full_film.astype(np.int32), iterations)


def verify_complementarity(
    pressure: np.ndarray, flux: np.ndarray, scale: float, tolerance: float = VERIFY_TOLERANCE
) -> None:
    """Check that pressure p and defect y satisfy ``p >= 0``, ``y >= 0`` and ``p y = 0``.

    Raises
    ------
    CavitationError
        If a violation at any node exceeds `tolerance` times the largest pressure or `scale`.
    SolverError
        If a pressure or a defect is not a finite number.
    """
    if not (np.isfinite(pressure).all() and np.isfinite(flux).all()):
        raise SolverError(
            "the film's pressure is not a finite number: check the units of viscosity, speed and "
            "given pressures"
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
                f"the film solution violates complementarity: {name} is {value:.2e}, "
                f"above the limit of {tolerance:.0e}",
                state={"pressure": pressure, "flux": flux},
            )
