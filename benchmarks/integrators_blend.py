"""Backward differentiation of order k blended with order k + 1: one more past point, no more work.

``x' = (1 - b) D_k x + b D_(k+1) x``. For k = 2 and b = 1/2 this is the numerical differentiation
formula of Klopfenstein, also known as BDF2-OPT: still A-stable and L-stable, half the error of
BDF2 (Shampine and Reichelt, SIAM J. Sci. Comput. 1997; Vatsa, Carpenter and Lockard 2010).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fenics_ehd.multibody.bdf import (
    IntegratorState,
    Step,
    StepControl,
    Watched,
    advance,
    derivative_weights,
)
from fenics_ehd.multibody.newton import ImplicitStep, StepSolver, newton

#: Share of the higher order by the lower one.
BLENDS = {2: 0.5, 3: 0.5}

#: The formula of order k + 1 is left out while steps grow faster than it is zero-stable for.
GROWTH = {2: 1.55, 3: 1.25}


@dataclass(frozen=True, eq=False)
class BlendedState(IntegratorState):
    """`IntegratorState` with the other formula."""

    def after(self, new: Step, step: float, memory: Any, keep: int) -> BlendedState:
        """See `IntegratorState`."""
        return BlendedState(**vars(super().after(new, step, memory, keep)))

    def _blend(self, order: int, time: float) -> float:
        """Share of the higher order in the next step."""
        if order not in BLENDS or len(self.times) <= order:
            return 0.0
        grown = (time - self.times[0]) / (self.times[0] - self.times[1])
        return BLENDS[order] if grown <= GROWTH[order] else 0.0

    def _weights(self, order: int, time: float, blend: float) -> np.ndarray:
        times = np.concatenate([[time], self.times])
        weights = np.zeros(order + 2)
        weights[:-1] = (1 - blend) * derivative_weights(times[: order + 1])
        if blend:
            weights += blend * derivative_weights(times[: order + 2])
        return weights

    def implicit_step(
        self, problem: Watched, time: float, order: int, tolerance: float
    ) -> ImplicitStep:
        """See `IntegratorState`."""
        asked = super().implicit_step(problem, time, order, tolerance)
        blend = self._blend(order, time)
        if not blend:
            return asked
        weights = self._weights(order, time, blend)
        past = slice(0, order + 1)
        return replace(
            asked,
            shift=float(weights[0]),
            past_x=weights[1:] @ self.x[past],
            past_rate=weights[1:] @ self.rate[past],
        )

    def error_share(self, order: int, time: float) -> float:
        """See `IntegratorState`."""
        blend = self._blend(order, time)
        if not blend:
            return super().error_share(order, time)
        left = (1 - blend) / self._weights(order, time, blend)[0]
        return float(left / (time - self.times[order] + left))


def integrate(
    problem: Any,
    span: tuple[float, float],
    x: np.ndarray,
    rate: np.ndarray,
    control: StepControl,
    solve: StepSolver = newton,
) -> Iterator[Step]:
    """Integrate and yield every accepted step, see `fenics_ehd.multibody.bdf.integrate`."""
    time, end = span
    state: IntegratorState = BlendedState.begin(problem, time, x, rate, control)
    while state.time < end:
        step, state = advance(problem, state, end, control, solve)
        yield step
