"""PETSc's integrators around a nested film, with exact derivatives.

Unknowns are ``x / length`` and, of integrators for first-order systems, ``T x' / length``: a
length changes the gap by up to a clearance. Time is in units of T; it is so short that velocities,
to which generalised-alpha applies the same tolerance, are small. Only positions are controlled,
by the largest of their errors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from integrators_case import FIRST_STEP, SMALLEST_STEP, Case, Trajectory, Window
from integrators_scaled import ScaledFilm
from petsc4py import PETSc

from fenics_ehd.errors import SolverError
from fenics_ehd.multibody.bdf import NEWTON_FRACTION

#: Unit of time [s].
UNIT = 1e-7

#: Tolerance of what is not controlled.
FREE = 1e30


@dataclass(frozen=True)
class Method:
    """One of PETSc's integrators.

    Attributes
    ----------
    type
        Of TS.
    options
        Of TS, without ``ts_``.
    growth
        Largest growth of the step.
    second_order
        Whether it takes second-order systems as they are.
    """

    type: str
    options: dict[str, str]
    growth: float = 2.0
    second_order: bool = False


class _Callbacks:
    """What TS calls; a film that cannot be solved is no number, which shortens the step."""

    def __init__(self, system: ScaledFilm, start: float):
        self.system, self.start, self.n = system, start, system.size

    def time(self, scaled: float) -> float:
        return self.start + UNIT * scaled

    def _fill(self, vector: PETSc.Vec, values: Callable[[], np.ndarray]) -> None:
        try:
            vector.setArray(values())
        except SolverError:
            vector.set(np.nan)

    def _fill_matrix(self, matrix: PETSc.Mat, values: Callable[[], np.ndarray]) -> None:
        try:
            found = values()
        except SolverError:
            found = np.full(matrix.getSize(), np.nan)
        matrix.getDenseArray()[...] = found
        matrix.assemble()

    def _first_order(self, u: PETSc.Vec, dot: PETSc.Vec) -> tuple[np.ndarray, ...]:
        length, n = self.system.length, self.n
        a, b = u.getArray(readonly=True), dot.getArray(readonly=True)
        return a[:n] * length, a[n:] * length / UNIT, b[n:] * length / UNIT**2, b[:n] - a[n:]

    def function(self, ts: PETSc.TS, t: float, u: PETSc.Vec, dot: PETSc.Vec, f: PETSc.Vec) -> None:
        x, rate, acceleration, defect = self._first_order(u, dot)
        self._fill(
            f,
            lambda: np.concatenate(
                [defect, self.system.residual(self.time(t), x, rate, acceleration)]
            ),
        )

    def jacobian(self, ts, t, u, dot, shift, matrix, preconditioner) -> bool:
        x, rate, acceleration, _ = self._first_order(u, dot)

        def values() -> np.ndarray:
            k, c, m = self.system.derivatives(self.time(t), x, rate, acceleration)
            unit = np.eye(self.n)
            return np.block([[shift * unit, -unit], [k, c / UNIT + shift * m / UNIT**2]])

        self._fill_matrix(preconditioner, values)
        return True

    def _second_order(self, *vectors: PETSc.Vec) -> tuple[np.ndarray, ...]:
        return tuple(
            v.getArray(readonly=True) * (self.system.length / UNIT**i)
            for i, v in enumerate(vectors)
        )

    def function2(self, ts, t, u, dot, dotdot, f) -> None:
        state = self._second_order(u, dot, dotdot)
        self._fill(f, lambda: self.system.residual(self.time(t), *state))

    def jacobian2(self, ts, t, u, dot, dotdot, shift, shift2, matrix, preconditioner) -> bool:
        state, shifts = self._second_order(u, dot, dotdot), (shift / UNIT, shift2 / UNIT**2)
        self._fill_matrix(
            preconditioner, lambda: self.system.combined(self.time(t), *state, shifts)
        )
        return True


class _UpdateTest:
    """Stops Newton's method when what is left of the positions is small, judged by contraction."""

    def __init__(self, n: int, tolerance: float):
        self._n, self._tolerance, self._former = n, tolerance, np.inf

    def __call__(self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]) -> int:
        if not np.isfinite(norms[2]):
            return PETSc.SNES.ConvergedReason.DIVERGED_FNORM_NAN
        if iteration == 0:
            self._former = np.inf
            return 0
        update = snes.getSolutionUpdate().getArray(readonly=True)[: self._n]
        size = float(np.abs(update).max())
        contraction = min(size / self._former, 1.0) if iteration > 1 else 1.0
        self._former = size
        left = size * contraction / (1 - contraction) if contraction < 1.0 else size
        if left <= self._tolerance:
            return PETSc.SNES.ConvergedReason.CONVERGED_SNORM_RELATIVE
        return 0


def integrate(method: Method, case: Case, window: Window, tolerance: float) -> Trajectory:
    """Integrate a machine without residual patterns.

    Raises
    ------
    RuntimeError
        PETSc did not reach the end.
    """
    system = ScaledFilm(case)
    n, found = system.size, Trajectory()
    ts, solution = _solver(method, case, window, tolerance, system)

    def note(ts: PETSc.TS, index: int, t: float, u: PETSc.Vec) -> None:
        time = window.start + UNIT * t
        if found.times and time <= found.times[-1]:
            return
        if method.second_order:
            x, rate = (v.getArray(readonly=True) for v in ts.getSolution2())
        else:
            x, rate = np.split(u.getArray(readonly=True), [n])
        found.times.append(time)
        found.states.append((x * system.length, rate * system.length / UNIT))

    ts.setMonitor(note)
    try:
        ts.solve(solution)
        found.failed, found.iterations = ts.getStepRejections(), ts.getSNESIterations()
        found.evaluations = system.evaluations
        reason = ts.getConvergedReason()
    except PETSc.Error as error:
        raise RuntimeError(f"PETSc error {error.ierr}: {error}") from error
    finally:
        ts.destroy()
    if reason < 0:
        raise RuntimeError(f"TS stopped for reason {reason} at t = {found.times[-1]:.6g} s")
    return found


def _solver(
    method: Method, case: Case, window: Window, tolerance: float, system: ScaledFilm
) -> tuple[PETSc.TS, PETSc.Vec]:
    """TS at the start of the window, and its solution."""
    calls, n = _Callbacks(system, window.start), system.size
    x, rate = window.x / system.length, UNIT * window.rate / system.length
    size = n if method.second_order else 2 * n
    matrix = PETSc.Mat().createDense([size, size], comm=PETSc.COMM_SELF)
    matrix.setUp()
    residual = PETSc.Vec().createSeq(size)
    ts = PETSc.TS().create(PETSc.COMM_SELF)
    ts.setProblemType(PETSc.TS.ProblemType.NONLINEAR)
    weights = np.full(size, FREE)
    weights[:n] = tolerance
    if method.second_order:
        ts.setI2Function(calls.function2, residual)
        ts.setI2Jacobian(calls.jacobian2, matrix, matrix)
        solution = PETSc.Vec().createWithArray(x)
        ts.setSolution2(solution, PETSc.Vec().createWithArray(rate))
    else:
        ts.setEquationType(PETSc.TS.EquationType.IMPLICIT)
        ts.setIFunction(calls.function, residual)
        ts.setIJacobian(calls.jacobian, matrix, matrix)
        solution = PETSc.Vec().createWithArray(np.concatenate([x, rate]))
        ts.setSolution(solution)
    ts.setTolerances(
        rtol=PETSc.Vec().createWithArray(np.zeros(size)),
        atol=PETSc.Vec().createWithArray(weights),
    )
    ts.setTimeStep(FIRST_STEP / UNIT)
    ts.setMaxTime((window.end - window.start) / UNIT)
    ts.setMaxSteps(10**6)
    ts.setExactFinalTime(PETSc.TS.ExactFinalTime.MATCHSTEP)
    ts.setMaxSNESFailures(-1)
    ts.setMaxStepRejections(50)
    _set_options(ts, method, case)
    ts.getSNES().setConvergenceTest(_UpdateTest(n, NEWTON_FRACTION * tolerance))
    return ts, solution


def _set_options(ts: PETSc.TS, method: Method, case: Case) -> None:
    """What only options can set."""
    options = PETSc.Options("integrators_")
    given = {
        "ts_type": method.type,
        "ts_adapt_type": "basic",
        "ts_adapt_wnormtype": "infinity",
        "ts_adapt_clip": f"0.2,{method.growth}",
        "ts_adapt_dt_min": str(SMALLEST_STEP / UNIT),
        "ts_adapt_dt_max": str(case.largest_step / UNIT),
        "snes_max_it": "12",
        "ksp_type": "preonly",
        "pc_type": "lu",
        **{f"ts_{name}": value for name, value in method.options.items()},
    }
    for name, value in given.items():
        options[name] = value
    ts.setOptionsPrefix("integrators_")
    ts.setFromOptions()
    for name in given:
        options.delValue(name)


def _arkimex(name: str) -> Method:
    return Method(
        "arkimex",
        {
            "arkimex_type": name,
            "arkimex_fully_implicit": "true",
            "arkimex_initial_guess_extrapolate": "true",
        },
        growth=3.0,
    )


METHODS = {
    "TS bdf 2": Method("bdf", {"bdf_order": "2"}),
    "TS bdf 3": Method("bdf", {"bdf_order": "3"}, growth=1.5),
    "TS bdf 4": Method("bdf", {"bdf_order": "4"}, growth=1.25),
    "TS alpha2": Method("alpha2", {"alpha_radius": "0.5"}, second_order=True),
    "TS arkimex l2": _arkimex("l2"),
    "TS arkimex 2e": _arkimex("2e"),
    "TS arkimex 3": _arkimex("3"),
    "TS arkimex 4": _arkimex("4"),
    "TS arkimex 5": _arkimex("5"),
}
