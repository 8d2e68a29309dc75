"""PETSc SNES-VI (reduced-space Newton) on a system that solves its own blocks."""

from __future__ import annotations

import weakref
from typing import Protocol

import numpy as np
from petsc4py import PETSc

from fenics_ehd.base.errors import CavitationError
from fenics_ehd.base.petsc_options import configure, destroy_with

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
    """What SNES-VI asks for, all scaled to order one."""

    def function(self, x: np.ndarray) -> np.ndarray:
        """``F(x)``."""

    def linearise(self, x: np.ndarray) -> None:
        """Take the derivative at x."""

    def factorise(self, nodes: np.ndarray) -> None:
        """Prepare the block of the derivative on the inactive unknowns."""

    def update(self, rhs: np.ndarray) -> np.ndarray:
        """Solve with that block."""


class SelfJudging(VariationalInequality, Protocol):
    """A system that tells itself when an iterate is good enough."""

    def converged(self, iteration: int) -> bool:
        """Whether to stop where `function` was called last, after so many iterations."""


class SnesVi:
    """SNES-VI with its vectors, reused from solve to solve.

    SNES-VI cuts the block of the inactive unknowns out of its Jacobian matrix, a
    new matrix with a new pattern for every active set. The Jacobian given to it
    here only notes which block is asked for and leaves the solution to `system`.

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
        On the 2-norm of the reduced function; the option ``snes_atol`` overrides it. None: the
        system is `SelfJudging`.
    max_iterations
        Of one solve.
    """

    def __init__(
        self,
        system: VariationalInequality | SelfJudging,
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
        self._unknown, self._function = bounds[0].duplicate(), bounds[0].duplicate()
        self._callbacks = callbacks = _Callbacks(system)
        jacobian = PETSc.Mat().createPython((len(lower),) * 2, _Jacobian(), comm=PETSc.COMM_SELF)
        jacobian.setUp()
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
            self.tolerance = 0.0
            snes.setConvergenceTest(callbacks.converged)
        else:
            self.tolerance = PETSc.Options(options_prefix).getReal("snes_atol", tolerance)
            snes.setTolerances(atol=self.tolerance)
        self.solves = 0
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
        self.solves += 1
        reason, iterations = self._snes.getConvergedReason(), self._snes.getIterationNumber()
        x, function = self._unknown.array.copy(), self._function.array.copy()
        failure = self._callbacks.take_failure()
        if failure is not None:
            if isinstance(failure, CavitationError):
                failure.state.update(x=x, function=function)
            raise failure
        if reason <= 0:
            raise CavitationError(
                f"SNES-VI stopped with reason {reason} after {iterations} iterations, residual "
                f"{self._snes.getFunctionNorm():.2e}{self._limit} (of the source): "
                f"see -{self._prefix}snes_monitor",
                state={"x": x, "function": function},
            )
        return x, function, iterations

    @property
    def _limit(self) -> str:
        return f" above {self.tolerance:.2e}" if self.tolerance else ""


class _Callbacks:
    """What PETSc calls: function and Jacobian of SNES, and the block's preconditioner.

    An exception must not travel through PETSc, which leaves solvers it went
    through unusable: it is kept, and what is not a number ends the solve. Its
    traceback outlives the solve, so that no frame may hold what PETSc must destroy
    before the interpreter ends: callbacks let go of solvers and matrices first.
    """

    def __init__(self, system: VariationalInequality):
        self._system = weakref.ref(system)
        self._failure: BaseException | None = None

    def take_failure(self) -> BaseException | None:
        """What went wrong since the last call."""
        failure, self._failure = self._failure, None
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
    """Python context of the Jacobian: hands out the block of an active set unassembled."""

    def createSubMatrix(
        self, mat: PETSc.Mat, rows: PETSc.IS, columns: PETSc.IS, out: PETSc.Mat | None = None
    ) -> PETSc.Mat:
        nodes = rows.getIndices().copy()
        block = PETSc.Mat().createPython((len(nodes),) * 2, _Block(nodes), comm=PETSc.COMM_SELF)
        block.setUp()
        return block


class _Block:
    """Python context of the block of an active set: only which unknowns are inactive."""

    def __init__(self, nodes: np.ndarray):
        self.nodes = nodes
