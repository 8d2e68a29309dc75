"""Generalised-alpha formula (Chung and Hulbert, J. Appl. Mech. 1993) with variable steps.

Equilibrium holds between the ends of a step, at ``t_a = t + (1 - a_f) h``, and that is where a
step's pressures are: steps are reported there. The formula's acceleration belongs to an instant
beside the end of its step, by a share of the step, and is moved when the step changes (Arnold,
Brüls and Cardona, Numer. Math. 2015).
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
from fenics_ehd.multibody.newton import Attempt, ImplicitStep, StepSolver, newton

#: Largest growth of the step.
GROWTH = 2.0


@dataclass(frozen=True)
class Parameters:
    """Of the formula, from what is left of a stiff oscillation after a step.

    Attributes
    ----------
    radius
        Spectral radius at infinite frequency, 0 to 1.
    """

    radius: float

    @property
    def am(self) -> float:
        """Weight of the old acceleration."""
        return (2 * self.radius - 1) / (1 + self.radius)

    @property
    def af(self) -> float:
        """Weight of the old position and velocity."""
        return self.radius / (1 + self.radius)

    @property
    def gamma(self) -> float:
        """Newmark's."""
        return 0.5 + self.af - self.am

    @property
    def beta(self) -> float:
        """Newmark's."""
        return 0.25 * (1 + self.af - self.am) ** 2

    @property
    def advance(self) -> float:
        """How far the acceleration is ahead of the end of its step, in steps."""
        return self.am - self.af

    @property
    def error(self) -> float:
        """Local error of the position over ``h^3 x'''``."""
        return abs(1 / 6 - self.beta - 0.5 * self.advance)


@dataclass(frozen=True, eq=False)
class AlphaStep(ImplicitStep):
    """Equations between the ends of a step; acceleration and velocity have shifts of their own."""

    rate_shift: float = 0.0

    def rates(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `ImplicitStep`."""
        rate = self.shift * x + self.past_x
        return rate, self.rate_shift * rate + self.past_rate

    @property
    def shifts(self) -> tuple[float, float]:
        """See `ImplicitStep`."""
        return self.shift, self.shift * self.rate_shift


@dataclass(frozen=True, eq=False)
class _State:
    """Ends of the last steps, newest first; rate and acceleration of the newest."""

    times: np.ndarray
    x: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray
    memory: Any

    def predict(self, time: float) -> np.ndarray:
        """Extrapolation through up to three points."""
        return extrapolation_weights(self.times, time) @ self.x

    def after(self, time: float, x: np.ndarray, *rest: Any) -> _State:
        """With one more point."""
        times = np.concatenate([[time], self.times])[:3]
        return _State(times, np.concatenate([x[None], self.x])[:3], *rest)


def _asked(
    problem: Any, state: _State, step: float, p: Parameters, tolerance: float
) -> tuple[AlphaStep, np.ndarray, np.ndarray]:
    """What the step solver is asked, the acceleration in use and the extrapolation to the end."""
    x, v, time = state.x[0], state.rate, state.times[0]
    former = step if len(state.times) == 1 else time - state.times[1]
    a = state.acceleration + p.advance * (step - former) * state.jerk
    # Of x_a alone: x_1 = (x_a - a_f x) / (1 - a_f), Newmark's rates there, and between the ends.
    rest = -x / (1 - p.af)
    a1 = (rest - step * v) / (p.beta * step**2) - (0.5 / p.beta - 1) * a
    v1 = v + step * ((1 - p.gamma) * a + p.gamma * a1)
    past_v = (1 - p.af) * v1 + p.af * v
    past_a = (1 - p.am) * a1 + p.am * a
    shift = p.gamma / (p.beta * step)
    rate_shift = (1 - p.am) / ((1 - p.af) * p.gamma * step)
    end = state.predict(time + step)
    predicted = (1 - p.af) * end + p.af * x
    asked = AlphaStep(
        time + (1 - p.af) * step,
        shift,
        past_v,
        past_a - rate_shift * past_v,
        x,
        predicted,
        (problem.watch(x), problem.watch(predicted)),
        tolerance,
        rate_shift,
    )
    return asked, a, end


def _start(
    problem: Any, time: float, x: np.ndarray, rate: np.ndarray, control: StepControl, solve: Any
) -> tuple[_State, Attempt]:
    """One backward Euler step: rates and accelerations of the start need not fit together."""
    step = control.first_step
    shift = 1.0 / step
    predicted = x + step * rate
    watched = (problem.watch(x), problem.watch(predicted))
    tolerance = NEWTON_FRACTION * control.tolerance
    asked = ImplicitStep(
        time + step, shift, -shift * x, -shift * rate, x, predicted, watched, tolerance
    )
    attempt = solve(problem, asked, None)
    if attempt.failure is not None:
        raise StepSizeError(f"the first step failed: {attempt.failure}") from attempt.cause
    rates = asked.rates(attempt.x)
    nothing = np.zeros_like(x)
    state = _State(np.array([time]), x[None], rate, nothing, nothing, None)
    return state.after(time + step, attempt.x, *rates, nothing, attempt.memory), attempt


def integrate(
    problem: Any,
    span: tuple[float, float],
    x: np.ndarray,
    rate: np.ndarray,
    control: StepControl,
    radius: float,
    solve: StepSolver = newton,
) -> Iterator[Step]:
    """Integrate and yield every accepted step, see `fenics_ehd.multibody.bdf.integrate`.

    Raises
    ------
    StepSizeError
        The step fell below the smallest allowed one.
    """
    time, end = span
    p = Parameters(radius)
    state, first = _start(problem, time, x, rate, control, solve)
    step, iterations, rejected = control.first_step, first.iterations, {}
    while state.times[0] < end:
        if step < control.smallest_step:
            raise StepSizeError(f"the step fell to {step:.1e} s at t = {state.times[0]:.6g} s")
        remaining = end - state.times[0]
        step = remaining if step >= remaining else min(step, max(0.5 * remaining, remaining - step))
        asked, a, predicted = _asked(problem, state, step, p, NEWTON_FRACTION * control.tolerance)
        attempt = solve(problem, asked, state.memory)
        iterations += attempt.iterations
        error = np.inf
        if attempt.failure is None:
            x, v = state.x[0], state.rate
            new = (attempt.x - p.af * x) / (1 - p.af)
            a1 = (new - x - step * v) / (p.beta * step**2) - (0.5 / p.beta - 1) * a
            v1 = v + step * ((1 - p.gamma) * a + p.gamma * a1)
            watched = problem.watch(new)
            distance = problem.error_norm(watched, watched - problem.watch(predicted))
            error = _share(state, step, p) * distance
        if error <= control.tolerance:
            yield Step(
                asked.time, attempt.x, *asked.rates(attempt.x), problem.watch(attempt.x),
                attempt.auxiliary, iterations, rejected,
            )  # fmt: skip
            target = end if step == remaining else state.times[0] + step
            state = state.after(target, new, v1, a1, (a1 - a) / step, attempt.memory)
            iterations, rejected = 0, {}
        else:
            reason = (attempt.failure or "error above tolerance").split(":")[0]
            rejected[reason] = rejected.get(reason, 0) + 1
        ratio = control.tolerance / max(error, 1e-10 * control.tolerance)
        factor = SAFETY * ratio ** (1.0 / 3.0)
        step = min(step * float(np.clip(factor, SHRINKAGE, GROWTH)), control.largest_step)


def _share(state: _State, step: float, p: Parameters) -> float:
    """Part of the distance from the extrapolation that the formula leaves as local error."""
    distances = state.times[0] + step - state.times
    missed = float(np.prod(distances)) / 6 if len(distances) == 3 else step**3 / 6
    left = p.error * step**3
    return left / (missed + left)
