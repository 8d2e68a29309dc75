"""Diagonally implicit Runge-Kutta formulas for second-order systems, a stage a `StepSolver` call.

A stage is ``X = x + h sum a V``, ``V = v + h sum a A`` with V and A the rates of the stages: with
the diagonal entry g of the tableau ``V = X / (h g) + known``, just what a `StepSolver` solves.
All formulas here end with their last stage and, but for `SDIRK2`, begin with that of the step
before.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_ehd.errors import StepSizeError
from fenics_ehd.multibody.bdf import (
    NEWTON_FRACTION,
    SAFETY,
    SHRINKAGE,
    Step,
    StepControl,
)
from fenics_ehd.multibody.differentiation import extrapolation_weights
from fenics_ehd.multibody.newton import ImplicitStep, StepSolver, newton

#: Largest growth of the step. One-step formulas are stable at any, predictions are not good at it.
GROWTH = 3.0


@dataclass(frozen=True, eq=False)
class Tableau:
    """One formula.

    Attributes
    ----------
    matrix, nodes
        Butcher's, shape (s, s) and (s,). The solution is the last stage.
    error
        Weights of the solution minus those of the embedded formula, shape (s,).
    order
        Of the solution.
    estimated
        The embedded difference falls with this power of the step.
    """

    name: str
    matrix: np.ndarray
    error: np.ndarray
    order: int
    estimated: int

    @property
    def nodes(self) -> np.ndarray:
        """Times of the stages in steps."""
        return self.matrix.sum(axis=1)

    @property
    def explicit_first(self) -> bool:
        """Whether the first stage is the last one of the step before."""
        return self.matrix[0, 0] == 0.0


def _lower(*rows: tuple[float, ...]) -> np.ndarray:
    matrix = np.zeros((len(rows), len(rows)))
    for i, row in enumerate(rows):
        matrix[i, : len(row)] = row
    return matrix


def _made(name: str, matrix: np.ndarray, embedded: tuple[float, ...], *orders: int) -> Tableau:
    return Tableau(name, matrix, matrix[-1] - np.array(embedded), *orders)


_A = 1 - np.sqrt(0.5)
#: Two stages, L-stable (Alexander, SIAM J. Numer. Anal. 1977).
SDIRK2 = _made("sdirk2", _lower((_A,), (1 - _A, _A)), (1.0, 0.0), 2, 2)

_D, _W = _A, np.sqrt(2) / 4
#: Trapezoidal rule and BDF2 (Hosea and Shampine, Appl. Numer. Math. 1996).
TR_BDF2 = _made(
    "tr-bdf2",
    _lower((0.0,), (_D, _D), (_W, _W, _D)),
    ((1 - _W) / 3, (3 * _W + 1) / 3, _D / 3),
    2,
    3,
)

_G = 1767732205903 / 4055673282236
#: ESDIRK3(2)4L[2]SA (Kennedy and Carpenter, Appl. Numer. Math. 2003); PETSc's ARKIMEX 3.
ESDIRK3 = _made(
    "esdirk3",
    _lower(
        (0.0,),
        (_G, _G),
        (2746238789719 / 10658868560708, -640167445237 / 6845629431997, _G),
        (
            1471266399579 / 7840856788654,
            -4482444167858 / 7529755066697,
            11266239266428 / 11593286722821,
            _G,
        ),
    ),
    (
        2756255671327 / 12835298489170,
        -10771552573575 / 22201958757719,
        9247589265047 / 10645013368117,
        2193209047091 / 5459859503100,
    ),
    3,
    3,
)

#: ESDIRK4(3)6L[2]SA (Kennedy and Carpenter, Appl. Numer. Math. 2003); PETSc's ARKIMEX 4.
ESDIRK4 = _made(
    "esdirk4",
    _lower(
        (0.0,),
        (1 / 4, 1 / 4),
        (8611 / 62500, -1743 / 31250, 1 / 4),
        (5012029 / 34652500, -654441 / 2922500, 174375 / 388108, 1 / 4),
        (
            15267082809 / 155376265600,
            -71443401 / 120774400,
            730878875 / 902184768,
            2285395 / 8070912,
            1 / 4,
        ),
        (82889 / 524892, 0.0, 15625 / 83664, 69875 / 102672, -2260 / 8211, 1 / 4),
    ),
    (
        4586570599 / 29645900160,
        0.0,
        178811875 / 945068544,
        814220225 / 1159782912,
        -3700637 / 11593932,
        61727 / 225920,
    ),
    4,
    4,
)

#: First step of all: rates and accelerations of the start need not fit together.
EULER = _made("euler", _lower((1.0,)), (1.0,), 1, 2)

TABLEAUS = {t.name: t for t in (SDIRK2, TR_BDF2, ESDIRK3, ESDIRK4)}


@dataclass(frozen=True, eq=False)
class _State:
    """Newest accepted point, what the solver remembers, and points to extrapolate from."""

    time: float
    x: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    memory: Any
    times: np.ndarray
    points: np.ndarray
    watched: np.ndarray

    def with_point(self, time: float, x: np.ndarray, watched: np.ndarray, keep: int) -> _State:
        """The same with one more point to extrapolate from, newest first."""
        return _State(
            self.time,
            self.x,
            self.rate,
            self.acceleration,
            self.memory,
            np.concatenate([[time], self.times])[:keep],
            np.concatenate([x[None], self.points])[:keep],
            np.concatenate([watched[None], self.watched])[:keep],
        )

    def predict(self, problem: Any, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Extrapolation of x and what is watched, or along the initial rate."""
        if len(self.times) == 1:
            x = self.x + (time - self.time) * self.rate
            return x, problem.watch(x)
        weights = extrapolation_weights(self.times, time)
        return weights @ self.points, weights @ self.watched


@dataclass
class _Outcome:
    """Of one attempted step."""

    iterations: int
    failure: str | None = None
    error: float = np.inf
    cause: Exception | None = None


def _attempt(
    problem: Any, state: _State, step: float, tableau: Tableau, tolerance: float, solve: StepSolver
) -> tuple[_Outcome, _State, Any]:
    """All stages; the last state and auxiliary are those of the end of the step."""
    matrix, nodes = tableau.matrix, tableau.nodes
    stages, keep = len(nodes), tableau.order + 1
    rates = np.zeros((stages, len(state.x)))
    accelerations = np.zeros_like(rates)
    outcome, memory, before = _Outcome(0), state.memory, state
    auxiliary, x = None, state.x
    for i in range(stages):
        if i == 0 and tableau.explicit_first:
            rates[0], accelerations[0] = before.rate, before.acceleration
            continue
        shift = 1.0 / (step * matrix[i, i])
        past_x = -shift * (before.x + step * (matrix[i, :i] @ rates[:i]))
        past_rate = -shift * (before.rate + step * (matrix[i, :i] @ accelerations[:i]))
        time = before.time + step * nodes[i]
        predicted, watched = state.predict(problem, time)
        start, start_watched = state.points[0], state.watched[0]
        asked = ImplicitStep(
            time, shift, past_x, past_rate, start, predicted, (start_watched, watched), tolerance
        )
        attempt = solve(problem, asked, memory)
        outcome.iterations += attempt.iterations
        if attempt.failure is not None:
            outcome.failure, outcome.cause = attempt.failure, attempt.cause
            return outcome, before, None
        memory, auxiliary, x = attempt.memory, attempt.auxiliary, attempt.x
        rates[i], accelerations[i] = asked.rates(x)
        state = state.with_point(time, x, problem.watch(x), keep)
    error = problem.watch(x + step * (tableau.error @ rates)) - state.watched[0]
    outcome.error = problem.error_norm(state.watched[0], error)
    end = before.time + step
    new = _State(
        end, x, rates[-1], accelerations[-1], memory, state.times, state.points, state.watched
    )
    return outcome, new, auxiliary


def integrate(
    problem: Any,
    span: tuple[float, float],
    x: np.ndarray,
    rate: np.ndarray,
    control: StepControl,
    tableau: Tableau,
    solve: StepSolver = newton,
) -> Iterator[Step]:
    """Integrate and yield every accepted step, see `fenics_ehd.multibody.bdf.integrate`.

    Raises
    ------
    StepSizeError
        The step fell below the smallest allowed one.
    """
    time, end = span
    watched = problem.watch(x)
    nothing = np.zeros_like(x)
    state = _State(time, x, rate, nothing, None, np.array([time]), x[None], watched[None])
    step, first = control.first_step, True
    iterations, rejected = 0, {}
    while state.time < end:
        if step < control.smallest_step:
            raise StepSizeError(f"the step fell to {step:.1e} s at t = {state.time:.6g} s")
        remaining = end - state.time
        step = remaining if step >= remaining else min(step, max(0.5 * remaining, remaining - step))
        formula = EULER if first else tableau
        outcome, new, auxiliary = _attempt(
            problem, state, step, formula, NEWTON_FRACTION * control.tolerance, solve
        )
        iterations += outcome.iterations
        if outcome.failure is None and (first or outcome.error <= control.tolerance):
            yield Step(
                end if step == remaining else new.time, new.x, new.rate, new.acceleration,
                new.watched[0], auxiliary, iterations, rejected,
            )  # fmt: skip
            state, iterations, rejected = new, 0, {}
            if step == remaining:
                return
        else:
            reason = (outcome.failure or "error above tolerance").split(":")[0]
            rejected[reason] = rejected.get(reason, 0) + 1
        if first and outcome.failure is None:
            factor, first = 1.0, False
        else:
            ratio = control.tolerance / max(outcome.error, 1e-10 * control.tolerance)
            factor = SAFETY * ratio ** (1.0 / tableau.estimated)
        step = min(step * float(np.clip(factor, SHRINKAGE, GROWTH)), control.largest_step)
