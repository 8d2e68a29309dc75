"""Error of the gap caused by the bore flexibility that a truncated basis misses."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np


class BasisErrorEstimate:
    """``(S_full - S_basis) w`` along a run, with ``w + zeta dw/dt = P``.

    The quasi-static answer of the missing flexibility to the pressure of the
    run, damped as the structure is. An estimate within a factor of two or so,
    not a bound. It says nothing of M4, which misses no flexibility but the
    inertia of most of it: the answer to that is added.

    Parameters
    ----------
    missing_flexibility
        Outward bore displacement per nodal pressure, shape (m, k) [m/Pa].
    damping_time
        zeta [s].
    neglected_inertia
        Outward bore displacement per acceleration of the residual amplitudes, shape (m, r); no
        rows if no inertia is neglected.
    """

    def __init__(
        self,
        missing_flexibility: np.ndarray,
        damping_time: float,
        neglected_inertia: np.ndarray | None = None,
    ):
        self._missing = missing_flexibility
        self._damping_time = damping_time
        self._inertia = neglected_inertia
        self._filtered = np.zeros(missing_flexibility.shape[1])
        self.largest = 0.0 if missing_flexibility.size else float("nan")

    def add(
        self, step: float, pressure: np.ndarray, acceleration: np.ndarray | None = None
    ) -> float:
        """Largest gap error over the bore after one step of this length [s], in [m]."""
        if not self._missing.size:
            return float("nan")
        # Backward Euler on the first-order lag.
        share = step / (step + self._damping_time)
        self._filtered += share * (pressure - self._filtered)
        field = self._missing @ self._filtered
        if self._inertia is not None and len(self._inertia) and acceleration is not None:
            field = field + self._inertia @ acceleration
        error = float(np.abs(field).max())
        self.largest = max(self.largest, error)
        return error

    def memory(self) -> dict[str, np.ndarray]:
        """All that the estimate knows, as arrays, for `restore`."""
        return {"filtered": self._filtered, "largest": np.array(self.largest)}

    def restore(self, memory: Mapping[str, np.ndarray]) -> None:
        """Go on where another estimate of the same body was."""
        self._filtered = np.array(memory["filtered"])
        self.largest = float(memory["largest"])
