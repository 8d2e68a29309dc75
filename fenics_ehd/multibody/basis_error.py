"""Error of the gap caused by the bore flexibility that a truncated basis misses."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np


class BasisErrorEstimate:
    """``(S_full - S_basis) w`` along a run, with ``w + zeta dw/dt = P``.

    The quasi-static answer of the missing flexibility to the pressure of the
    run, damped as the structure is. An estimate within a factor of two or so,
    not a bound. It says nothing of M4, which misses no flexibility but the
    inertia of most of it: the answer to that is added,

        S_res M y'',   late by zeta and by the time that the patterns' own inertia takes.

    Patterns that carry no mass begin to move at once when a run begins, with accelerations that
    are over within microseconds: too soon for what they leave out to have moved the bore.

    Parameters
    ----------
    missing_flexibility
        Outward bore displacement per nodal pressure, shape (m, k) [m/Pa].
    damping_time
        zeta [s].
    neglected_inertia
        Outward bore displacement per acceleration of the residual amplitudes, shape (m, r); no
        rows if no inertia is neglected.
    inertia_time
        Of the slowest of the patterns [s], see `slowest_pattern`.
    """

    def __init__(
        self,
        missing_flexibility: np.ndarray,
        damping_time: float,
        neglected_inertia: np.ndarray | None = None,
        inertia_time: float = 0.0,
    ):
        self._missing = missing_flexibility
        self._damping_time = damping_time
        self._inertia = np.zeros((0, 0)) if neglected_inertia is None else neglected_inertia
        self._inertia_time = damping_time + inertia_time
        self._filtered = np.zeros(missing_flexibility.shape[1])
        self._accelerated = np.zeros(self._inertia.shape[1])
        self.largest = 0.0 if missing_flexibility.size else float("nan")

    def add(
        self, step: float, pressure: np.ndarray, acceleration: np.ndarray | None = None
    ) -> float:
        """Largest gap error over the bore after one step of this length [s], in [m]."""
        if not self._missing.size:
            return float("nan")
        # Backward Euler on the first-order lags.
        share = step / (step + self._damping_time)
        self._filtered += share * (pressure - self._filtered)
        field = self._missing @ self._filtered
        if len(self._inertia) and acceleration is not None:
            share = step / (step + self._inertia_time)
            self._accelerated += share * (acceleration - self._accelerated)
            field = field + self._inertia @ self._accelerated
        error = float(np.abs(field).max())
        self.largest = max(self.largest, error)
        return error

    def memory(self) -> dict[str, np.ndarray]:
        """All that the estimate knows, as arrays, for `restore`."""
        return {
            "filtered": self._filtered,
            "accelerated": self._accelerated,
            "largest": np.array(self.largest),
        }

    def restore(self, memory: Mapping[str, np.ndarray]) -> None:
        """Go on where another estimate of the same body was."""
        self._filtered = np.array(memory["filtered"])
        self._accelerated = np.array(memory["accelerated"])
        self.largest = float(memory["largest"])
